//! Closed streams end no command with a panic; numbers, texts and selections outside their range are refused.

#![expect(
    clippy::expect_used,
    clippy::disallowed_methods,
    reason = "a test of processes and files, which stops where its own set-up is wrong"
)]

use std::fs::{self, File};
use std::process::{Command, Output, Stdio};

const VOLCOMP: &str = env!("CARGO_BIN_EXE_volcomp");
const MACHINE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/config/examples/vmc-850/machine.toml");
const MODEL: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/config/examples/vmc-850/model.toml");

/// A pipe whose reader has ended.
fn broken() -> Stdio {
    let (reader, writer) = std::io::pipe().expect("a pipe");
    drop(reader);
    writer.into()
}

fn full() -> Stdio {
    File::options().write(true).open("/dev/full").expect("/dev/full").into()
}

fn run(words: &[&str], stdout: Stdio, stderr: Stdio) -> Output {
    let mut command = Command::new(VOLCOMP);
    command.args(words).stdin(Stdio::null()).stdout(stdout).stderr(stderr).output().expect("volcomp runs")
}

/// Every leaf of the command tree, as words.
fn leaves(command: &clap::Command, path: &[&str], found: &mut Vec<Vec<String>>) {
    let subcommands: Vec<_> = command.get_subcommands().collect();
    if subcommands.is_empty() || !command.is_subcommand_required_set() && !path.is_empty() {
        found.push(path.iter().map(|s| (*s).to_owned()).collect());
    }
    for command in subcommands {
        leaves(command, &[path, &[command.get_name()]].concat(), found);
    }
}

#[test]
fn no_command_panics_on_a_stream_that_cannot_be_written() {
    let mut forms = Vec::new();
    leaves(&volcomp::cli::command(), &[], &mut forms);
    assert!(forms.len() > 35, "{}", forms.len());
    // each with its help, with a mistake, and with a file that is not there
    let works =
        [vec!["check", MACHINE], vec!["model", "show", MODEL], vec!["explain"], vec!["diff", MODEL, MODEL]];
    let mut lines: Vec<Vec<&str>> = works.to_vec();
    for form in &forms {
        let words: Vec<&str> = form.iter().map(String::as_str).collect();
        lines.push([&words[..], &["--help"]].concat());
        lines.push([&words[..], &["--no-such-option"]].concat());
    }
    for words in [
        &["check", "/none"][..],
        &["status", "--socket", "/none"],
        &["load", "/none"],
        &["replay", "/none"],
        &["audit", "verify", "/none"],
        &["export", "/none", "--format", "csv", "--out", "-"],
        &["fit", "--axis", "x", "--errors", "/none", "--out", "-"],
        &["diagnose", "--list-effects"],
    ] {
        lines.push(words.to_vec());
    }
    for words in lines {
        let expected = run(&words, Stdio::null(), Stdio::null()).status.code();
        assert!(expected.is_some_and(|code| code != 101), "{words:?}: {expected:?}");
        for (what, output) in [
            ("stdout without reader", run(&words, broken(), Stdio::null())),
            ("stderr without reader", run(&words, Stdio::null(), broken())),
            ("stderr full", run(&words, Stdio::null(), full())),
            ("both without reader", run(&words, broken(), broken())),
        ] {
            assert_eq!(output.status.code(), expected, "{words:?}: {what}");
        }
        let output = run(&words, full(), Stdio::piped());
        let said = String::from_utf8_lossy(&output.stderr);
        let wrote = expected == Some(0);
        assert_eq!(
            output.status.code(),
            if wrote { Some(74) } else { expected },
            "{words:?}: full stdout, {said}"
        );
        let closed = Command::new("sh")
            .args(["-c", r#"exec "$@" >&- 2>&-"#, "sh", VOLCOMP])
            .args(&words)
            .stdin(Stdio::null())
            .status()
            .expect("sh runs");
        assert_eq!(closed.code(), expected, "{words:?}: closed streams");
    }
}

#[test]
fn a_reader_that_has_seen_enough_ends_the_work() {
    // both would go on without end
    for line in [
        r#"(echo x_mm,y_mm,z_mm; yes 1,2,-3) | "$1" predict --model "$2" --points - --out -; echo "code $?" >&2"#,
        r#"yes "" | "$1" predict --model "$2" --points <(echo x_mm,y_mm,z_mm; yes 1,2,-3) --out -; echo "code $?" >&2"#,
    ] {
        let output = Command::new("bash")
            .args(["-c", &format!("({line}) | head -2"), "bash", VOLCOMP, MODEL])
            .output()
            .expect("bash runs");
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(said, "code 0\n");
        assert_eq!(String::from_utf8_lossy(&output.stdout).lines().count(), 2);
    }
}

fn refused(words: &[&str]) -> String {
    let output = run(words, Stdio::piped(), Stdio::piped());
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(64), "{words:?}: {said}");
    said
}

#[test]
fn numbers_outside_their_range_are_refused() {
    let ballbar = ["identify", "ballbar", "--data", "xy=none.csv"];
    for (words, parts) in [
        (&["enable", "--temperature-degc", "1e308"][..], ["'--temperature-degc <T>'", "expected -50 to 150"]),
        (&["enable", "--temperature-degc=-500"], ["'-500'", "expected -50 to 150"]),
        (&["enable", "--temperature-degc", "nan"], ["NaN", "expected -50 to 150"]),
        (
            &[&ballbar[..], &["--radius-mm", "1e308"]].concat(),
            ["'--radius-mm <MM>'", "expected 0.01 to 10000"],
        ),
        (
            &[&ballbar[..], &["--radius-mm", "150", "--centre-mm=1e29,0,0"]].concat(),
            ["--centre-mm", "100000"],
        ),
        (&["diff", MODEL, MODEL, "--tolerance-um", "inf"], ["--tolerance-um", ""]),
        (
            &["identify", "diagonals", "--data", "d.csv", "--box-mm", "1,1,1", "--noise-um=-1"],
            ["--noise-um", ""],
        ),
        (
            &["fit", "--axis", "x", "--errors", "e.csv", "--out", "o", "--period-mm", "1e300"],
            ["--period-mm", ""],
        ),
    ] {
        let said = refused(words);
        for part in parts {
            assert!(said.contains(part), "{words:?}: no {part:?} in {said}");
        }
    }
    // the ends of a range are inside: what is wrong then is the daemon that is not there
    for degc in ["-50", "150"] {
        let words = ["enable", "--socket", "/none", &format!("--temperature-degc={degc}")];
        assert_eq!(run(&words, Stdio::null(), Stdio::null()).status.code(), Some(74));
    }
}

#[test]
fn a_long_reason_is_refused_before_it_is_sent() {
    let (most, more) = ("x".repeat(1024), "x".repeat(1025));
    for form in [&["enable"][..], &["disable"], &["gain", "1"], &["rollback"], &["filter", "forget", "m"]] {
        let words = [form, &["--socket", "/none", "--reason"]].concat();
        let said = refused(&[&words[..], &[&more]].concat());
        assert!(said.contains("1025 bytes, the limit is 1024"), "{said}");
        let sent = run(&[&words[..], &[&most]].concat(), Stdio::null(), Stdio::null());
        assert_eq!(sent.status.code(), Some(74));
    }
    let _ = refused(&["load", MODEL, "--confirm", &more, "--reason", "r", "--socket", "/none"]);
}

#[test]
fn the_exit_codes_are_documented() {
    let page = fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/docs/reference/limits.md"))
        .expect("the page");
    for code in [0, 1, 2, 64, 65, 70, 74, 78] {
        assert!(page.contains(&format!("\n| {code} | ")), "{code}");
    }
}
