//! Every form of `cncsim` that reads a file refuses one without an end, in bounded memory.

#![expect(clippy::disallowed_methods, reason = "the test runs the program")]

use std::collections::BTreeSet;
use std::process::Command;

/// Address space of the program under test, bytes.
const MEMORY: u64 = 2 << 30;

/// Forms that read a file by another argument than `--machine`: command, argument, command line.
const INPUTS: &[(&str, &str, &str)] = &[
    ("campaign", "truth", "campaign --truth /dev/zero --out {out}"),
    // handed to volcomp, whose forms have a test of their own
    ("campaign", "add", ""),
    ("dev scenarios", "file", "dev scenarios --file /dev/zero"),
    ("serve", "program", "serve --program /dev/zero --listen 127.0.0.1:0"),
    (
        "serve",
        "tls_ca",
        "serve --listen 127.0.0.1:0 --tls-ca /dev/zero --tls-certificate /dev/zero --tls-key /dev/zero",
    ),
    ("serve", "tls_certificate", ""),
    ("serve", "tls_key", ""),
    ("serve", "monitor", "serve --monitor /dev/zero --listen 127.0.0.1:0"),
    ("replay", "monitor", ""),
    ("replay", "recording", "replay --recording /dev/zero --listen 127.0.0.1:0"),
    ("replay", "tls_ca", ""),
    ("replay", "tls_certificate", ""),
    ("replay", "tls_key", ""),
    ("measure grinder", "poses", "measure grinder --poses /dev/zero --out {out}"),
];

/// Arguments that name what is written, a folder, or a program.
const OTHERS: &[&str] = &["out", "folder", "volcompd", "tool", "drawing", "generator_program"];

fn file_arguments(command: &clap::Command, path: &str, found: &mut BTreeSet<(String, String)>) {
    for argument in command.get_arguments() {
        let is_path = argument.get_value_parser().type_id() == std::any::TypeId::of::<std::path::PathBuf>();
        if is_path && !OTHERS.contains(&argument.get_id().as_str()) {
            found.insert((path.to_owned(), argument.get_id().to_string()));
        }
    }
    // hidden names of a verb are parsed as the verb is
    for command in command.get_subcommands().filter(|c| !c.is_hide_set()) {
        file_arguments(command, format!("{path} {}", command.get_name()).trim(), found);
    }
}

#[test]
fn every_form_refuses_an_endless_file() {
    let mut tree = BTreeSet::new();
    file_arguments(&simulator::cli::command(), "", &mut tree);
    let (machines, others): (BTreeSet<_>, BTreeSet<_>) = tree.into_iter().partition(|(_, a)| a == "machine");
    let listed: BTreeSet<_> = INPUTS.iter().map(|(c, a, _)| ((*c).to_owned(), (*a).to_owned())).collect();
    assert_eq!(others, listed);
    assert!(machines.len() > 10, "{machines:?}");
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let required = |form: &str| {
        let root = simulator::cli::command();
        let leaf = form.split(' ').fold(&root, |at, name| at.find_subcommand(name).unwrap());
        let out = leaf.get_arguments().any(|a| a.get_id() == "out" && a.is_required_set());
        match form {
            "serve" | "replay" => "--listen 127.0.0.1:0",
            "measure grinder" => "--drawing {out}",
            _ if out => "--out {out}",
            _ => "",
        }
    };
    let forms = machines
        .iter()
        .map(|(form, _)| format!("{form} --machine /dev/zero {}", required(form)))
        .chain(INPUTS.iter().map(|(_, _, line)| (*line).to_owned()).filter(|line| !line.is_empty()));
    for form in forms {
        let line = form.replace("{out}", out.to_str().unwrap());
        let output = Command::new("prlimit")
            .arg(format!("--as={MEMORY}"))
            .arg(env!("CARGO_BIN_EXE_cncsim"))
            .args(line.split_whitespace())
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(matches!(output.status.code(), Some(65 | 74 | 78)), "{line}: {}\n{said}", output.status);
        assert!(said.contains("/dev/zero") && said.contains("more than"), "{line}: {said}");
    }
}
