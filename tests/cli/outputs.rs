//! Outputs of the commands as committed snapshots: a changed word, figure or key is seen in review.
//!
//! `INSTA_UPDATE=always cargo test --release --test cli outputs::` writes them anew; read the difference before you commit it.

#![expect(clippy::unwrap_used, reason = "helpers of tests")]
#![expect(clippy::disallowed_methods, reason = "the tests run programs and read their files")]

mod evaluate;
mod exchange;
mod fit;
mod identify;
mod model;
mod operate;

use std::io::{BufRead as _, BufReader, Write as _};
use std::os::unix::net::UnixListener;
use std::path::Path;
use std::process::Command;

use serde_json::Value;

/// Runs `volcomp` in the folder of the repository and compares its exit code, its streams and the text files that it writes
/// into `SCRATCH/` (a folder that lasts for the call) with the snapshot of that name.
fn check(name: &str, args: &[&str]) {
    let scratch = tempfile::tempdir().unwrap();
    let folder = scratch.path().to_str().unwrap();
    if args.iter().any(|a| a.contains("SCRATCH/daemon.sock")) {
        answer_as_the_daemon(&scratch.path().join("daemon.sock"));
    }
    let output = Command::new(env!("CARGO_BIN_EXE_volcomp"))
        .args(args.iter().map(|a| a.replace("SCRATCH", folder)))
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .env("COLUMNS", "100")
        .output()
        .unwrap();
    let mut all = format!("$ volcomp {}\nexit code {}\n", args.join(" "), output.status.code().unwrap());
    for (stream, bytes) in [("stdout", output.stdout), ("stderr", output.stderr)] {
        add(&mut all, stream, &String::from_utf8(bytes).unwrap());
    }
    for path in files_of(scratch.path()) {
        let inside = path.strip_prefix(scratch.path()).unwrap().display().to_string();
        add(&mut all, &inside, &std::fs::read_to_string(&path).unwrap());
    }
    // a note on the processors of this computer, which others have not
    let all: String = all.split_inclusive('\n').filter(|line| !line.contains("realtime.cpu is ")).collect();
    insta::with_settings!({ snapshot_path => "outputs", prepend_module_to_snapshot => false, omit_expression => true }, {
        insta::assert_snapshot!(name, all.replace(folder, "SCRATCH").replace(env!("CARGO_PKG_VERSION"), "VERSION"));
    });
}

/// Runs a command line, in which `DATA/` is the folder of the inputs and `~` a space within a word, once with each of the
/// endings.
fn each(prefix: &str, command: &str, endings: &[(&str, &str)]) {
    for (suffix, ending) in endings {
        let line = format!("{command} {ending}").replace("DATA/", "tests/cli/outputs/data/");
        let words: Vec<String> = line.split_whitespace().map(|word| word.replace('~', " ")).collect();
        check(&format!("{prefix}{suffix}"), &words.iter().map(String::as_str).collect::<Vec<_>>());
    }
}

/// What a person reads of a page or a picture: its words, without markup and style.
fn words(markup: &str) -> String {
    let mut out = String::new();
    for part in markup.split('<') {
        let (tag, text) = part.split_once('>').unwrap_or(("", part));
        let ends_line =
            ["/tr", "/p", "/h1", "/h2", "/li", "/svg", "/figcaption", "/text", "/pre"].contains(&tag);
        match tag {
            _ if ends_line => out.push('\n'),
            "/td" | "/th" => out.push_str(" | "),
            _ => {}
        }
        if !matches!(tag, "style" | "title") {
            out.push_str(text.trim_matches('\n'));
        }
    }
    out.lines().map(str::trim).filter(|line| !line.is_empty()).map(|line| line.to_owned() + "\n").collect()
}

/// Answers every question at that socket alike, until the test program ends.
fn answer_as_the_daemon(socket: &Path) {
    let listener = UnixListener::bind(socket).unwrap();
    let answer: Value = serde_json::from_str(include_str!("outputs/data/answer.json")).unwrap();
    std::thread::spawn(move || {
        for stream in listener.incoming() {
            let mut stream = stream.unwrap();
            BufReader::new(&stream).read_line(&mut String::new()).unwrap();
            writeln!(stream, "{answer}").unwrap();
        }
    });
}

/// One stream or file; numbers of JSON are rounded, for their last digits differ between processors.
fn add(all: &mut String, what: &str, text: &str) {
    let is_markup = text.starts_with("<!DOCTYPE html>") || text.starts_with("<svg");
    let text = match serde_json::from_str::<Value>(text) {
        Ok(value) => format!("{:#}\n", rounded(value)),
        Err(_) if is_markup => words(text),
        Err(_) => shortened(text),
    };
    if !text.is_empty() {
        all.push_str(&format!("---- {what}\n{text}"));
    }
}

/// Text with its long decimal numbers to seven significant digits, for the same reason.
fn shortened(text: &str) -> String {
    text.split_inclusive(|c: char| !(c.is_ascii_alphanumeric() || ".+-_".contains(c)))
        .map(|word| {
            let number = word.trim_end_matches(|c: char| !c.is_ascii_alphanumeric());
            match number.parse::<f64>() {
                Ok(value) if number.len() > 10 && number.contains('.') => {
                    let value =
                        if value.abs() < 1e-12 { 0.0 } else { format!("{value:.6e}").parse().unwrap() };
                    word.replacen(number, &value.to_string(), 1)
                }
                _ => word.to_owned(),
            }
        })
        .collect()
}

/// Every number to six significant digits, what is below 1e-12 as zero.
fn rounded(value: Value) -> Value {
    match value {
        Value::Number(n) if !n.is_i64() && !n.is_u64() => {
            let v = n.as_f64().unwrap();
            let v = if v.abs() < 1e-12 { 0.0 } else { format!("{v:.5e}").parse().unwrap() };
            Value::from(v)
        }
        Value::Array(of) => of.into_iter().map(rounded).collect(),
        Value::Object(of) => of.into_iter().map(|(key, v)| (key, rounded(v))).collect(),
        other => other,
    }
}

/// The files of a folder and those below it, in order of their names.
fn files_of(folder: &Path) -> Vec<std::path::PathBuf> {
    let mut entries: Vec<_> = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).collect();
    entries.sort();
    entries
        .into_iter()
        .flat_map(|p| if p.is_dir() { files_of(&p) } else { p.is_file().then_some(p).into_iter().collect() })
        .collect()
}
