//! Numbers outside their range are refused, and streams that cannot be written end no command with a panic.

#![expect(clippy::disallowed_methods, reason = "the test runs the program")]
#![expect(clippy::unwrap_used, reason = "a test stops where its own set-up is wrong")]

use std::process::{Command, Output, Stdio};

fn cncsim(words: &str) -> Output {
    Command::new(env!("CARGO_BIN_EXE_cncsim")).args(words.split(' ')).stdin(Stdio::null()).output().unwrap()
}

#[test]
fn numbers_outside_their_range_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    for (words, part) in [
        ("survey --out {out} --step-mm 1e-9", "expected 0.01 to 100000"),
        ("survey --out {out} --noise-um nan", "expected 0 to 100000"),
        ("survey --out {out} --noise-arcsec=-1", "expected 0 to 100000"),
        ("measure ballbar --out {out} --radius-mm 1e308", "expected 0.01 to 10000"),
        ("measure ballbar --out {out} --feed-mm-per-min inf", "--feed-mm-per-min"),
        ("measure probe --out {out} --spacing-mm 1e-12", "--spacing-mm"),
        ("path circle --radius-mm 1e308", "expected 0.01 to 10000"),
        ("path circle --centre-mm 1e200,0,0", "--centre-mm"),
        ("path line --feed 1e308", "--feed"),
        ("path s-path --blocks 4000000000", "--blocks"),
        ("serve --cycle-ms nan", "--cycle-ms"),
        ("serve --tracker-outliers 7", "expected 0 to 1"),
        ("demo --out {out} --cycle-ms 1e308", "--cycle-ms"),
    ] {
        let output = cncsim(&words.replace("{out}", out.to_str().unwrap()));
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(64), "{words}: {said}");
        assert!(said.contains(part), "{words}: {said}");
        assert!(!out.exists(), "{words}");
    }
}

#[test]
fn a_plan_with_too_many_points_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    for (words, part) in [
        (
            "measure ballbar --radius-mm 10000 --feed-mm-per-min 0.001 --out {out}",
            "cycles on a circle; the limit is",
        ),
        (
            "measure probe --spacing-mm 0.001 --bar-radius-mm 1000 --out {out}",
            "contacts on a side; the limit is",
        ),
    ] {
        let output = cncsim(&words.replace("{out}", folder.path().to_str().unwrap()));
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(65), "{words}: {said}");
        assert!(said.contains(part), "{words}: {said}");
    }
}

#[test]
fn no_command_panics_on_a_stream_without_a_reader() {
    fn leaves(command: &clap::Command, path: &str, found: &mut Vec<String>) {
        if command.get_subcommands().next().is_none() {
            found.push(path.to_owned());
        }
        for command in command.get_subcommands() {
            leaves(command, format!("{path} {}", command.get_name()).trim(), found);
        }
    }
    let mut forms = Vec::new();
    leaves(&simulator::cli::command(), "", &mut forms);
    let broken = || {
        let (reader, writer) = std::io::pipe().unwrap();
        drop(reader);
        Stdio::from(writer)
    };
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let mut lines =
        vec!["path circle".to_owned(), format!("survey --out {out}"), "scenarios --list".to_owned()];
    lines.push(format!("measure probe --out {out}"));
    lines.push("serve --machine /none".to_owned());
    // these hand everything on to the product's programs
    forms.retain(|form| !form.ends_with("volcomp") && !form.ends_with("volcompd"));
    lines
        .extend(forms.iter().flat_map(|form| [format!("{form} --help"), format!("{form} --no-such-option")]));
    for line in lines {
        let expected = cncsim(&line).status.code();
        for (stdout, stderr) in [(broken(), Stdio::null()), (Stdio::null(), broken()), (broken(), broken())] {
            let mut command = Command::new(env!("CARGO_BIN_EXE_cncsim"));
            let status =
                command.args(line.split(' ')).stdin(Stdio::null()).stdout(stdout).stderr(stderr).status();
            assert_eq!(status.unwrap().code(), expected, "{line}");
        }
        assert!(expected.is_some_and(|code| code != 101), "{line}");
    }
}
