//! What is shipped is valid, and the reference, the documentation and the code say the same.

#![expect(clippy::expect_used, reason = "a test may stop at what it does not expect")]
#![expect(clippy::disallowed_methods, reason = "the test reads the shipped files")]

use volcomp::config::{self, FileKind, MachineConfig, model};

/// A machine file of axis X with its limits, and more.
fn machine(more: &str) -> String {
    format!(
        "format = \"volcomp-machine/1\"\nmachine = \"m\"\nmodel = \"model.toml\"\n[axes.x]\n\
         limit-um = 50\nrate-um-per-s = 100\nacceleration-um-per-s2 = 1000\n{more}"
    )
}

/// Every TOML file below `config/`.
fn shipped() -> Vec<std::path::PathBuf> {
    let mut found = Vec::new();
    let mut open = vec![std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("config")];
    while let Some(directory) = open.pop() {
        for entry in std::fs::read_dir(directory).expect("config/ is there") {
            let path = entry.expect("readable").path();
            if path.is_dir() {
                open.push(path);
            } else if path.extension().is_some_and(|e| e == "toml") {
                found.push(path);
            }
        }
    }
    found.sort();
    found
}

fn read(path: &std::path::Path) -> String {
    std::fs::read_to_string(path).expect("readable")
}

#[test]
fn every_shipped_file_is_valid_and_every_machine_has_its_model() {
    let mut machines = 0;
    for path in shipped() {
        let (name, text) = (path.display().to_string(), read(&path));
        match config::kind_of_file(&name, &text).unwrap_or_else(|e| panic!("{e}")) {
            FileKind::Model => drop(model::parse(&name, &text).unwrap_or_else(|e| panic!("{e}"))),
            FileKind::Machine => {
                machines += 1;
                let machine = MachineConfig::parse(&name, &text).unwrap_or_else(|e| panic!("{e}"));
                let of = path.parent().expect("a file has a directory").join(&machine.model);
                let spec =
                    model::parse(&of.display().to_string(), &read(&of)).unwrap_or_else(|e| panic!("{e}"));
                assert_eq!(machine.check_model(&spec), [], "{name}");
            }
        }
    }
    assert!(machines >= 4, "the reference and three examples at least, found {machines}");
}

#[test]
fn shipped_models_survive_writing() {
    for path in shipped() {
        let (name, text) = (path.display().to_string(), read(&path));
        if config::kind_of_file(&name, &text).expect("valid") == FileKind::Model {
            let file = model::parse_file(&name, &text).expect("valid");
            assert_eq!(
                model::parse_file(&name, &model::write_file(&file, &[])).expect("valid"),
                file,
                "{name}"
            );
        }
    }
}

/// The last part of a key path.
fn last(key: &str) -> &str {
    key.rsplit('.').next().unwrap_or(key)
}

#[test]
fn the_reference_file_names_every_key() {
    let text = read(&std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("config/machine.toml"));
    for key in config::machine::known_keys().into_keys() {
        let name = last(&key);
        let written = text.lines().map(|l| l.trim_start_matches(['#', ' '])).any(|l| {
            l.split_once('=').is_some_and(|(k, _)| k.trim() == name)
                || l.starts_with(&format!("[{name}]"))
                || l.starts_with(&format!("[[{name}]]"))
                || l.starts_with(&format!("[{key}]"))
                || (key == "axes" && l.starts_with("[axes."))
        });
        assert!(written, "{key} is not in config/machine.toml");
    }
}

#[test]
fn the_defaults_in_the_reference_file_are_those_of_the_code() {
    let text = read(&std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("config/machine.toml"));
    let full = MachineConfig::parse("machine.toml", &text).unwrap_or_else(|e| panic!("{e}"));
    // whatever is marked as default may be left out
    let short: String = text.lines().filter(|l| !l.contains("# default")).map(|l| format!("{l}\n")).collect();
    assert!(!short.contains("ramp-s =") && short.contains("limit-um ="), "{short}");
    assert_eq!(MachineConfig::parse("short.toml", &short).unwrap_or_else(|e| panic!("{e}")), full);
    // and what is marked as required may not
    for (i, line) in text.lines().enumerate().filter(|(_, l)| l.contains("# required") && !l.starts_with('#'))
    {
        let without: String =
            text.lines().enumerate().filter(|(j, _)| *j != i).map(|(_, l)| format!("{l}\n")).collect();
        assert!(MachineConfig::parse("without.toml", &without).is_err(), "{line}");
    }
    // the commented table of a rotary axis is right too
    let start = text.find("# [axes.c]").expect("rotary example");
    let rotary: String =
        text[start..].lines().take_while(|l| l.starts_with('#')).map(|l| format!("{}\n", &l[2..])).collect();
    let with = MachineConfig::parse("c.toml", &machine(&rotary)).unwrap_or_else(|e| panic!("{e}"));
    let bare: String =
        rotary.lines().filter(|l| !l.contains("# default")).map(|l| format!("{l}\n")).collect();
    assert_eq!(MachineConfig::parse("c.toml", &machine(&bare)).unwrap_or_else(|e| panic!("{e}")), with);
    // and so is that of TLS
    let start = text.find("# [link.tls]").expect("example of TLS");
    let tls: String =
        text[start..].lines().take_while(|l| l.starts_with('#')).map(|l| format!("{}\n", &l[2..])).collect();
    let with = MachineConfig::parse("t.toml", &machine(&tls)).unwrap_or_else(|e| panic!("{e}"));
    let bare: String = tls
        .lines()
        .filter(|l| l.starts_with('[') || !l.contains("# default"))
        .map(|l| format!("{l}\n"))
        .collect();
    assert!(with.link.tls.is_some() && !bare.contains("server-name"), "{bare}");
    assert_eq!(MachineConfig::parse("t.toml", &machine(&bare)).unwrap_or_else(|e| panic!("{e}")), with);
}

#[test]
fn the_documentation_names_every_key() {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/reference");
    let text = read(&folder.join("configuration.md")) + &read(&folder.join("model-keys.md"));
    for key in config::machine::known_keys().keys().chain(model::known_keys().keys()) {
        let name = last(key);
        let dynamic = ["x", "y", "z", "c"].contains(&name)
            || key.starts_with("errors.") && name.len() <= 4 && key.matches('.').count() == 1
            || key.starts_with("thermal.") && key.matches('.').count() == 1;
        assert!(
            dynamic
                || text.contains(&format!("`{name}`"))
                || text.contains(&format!("`[{name}]`"))
                || text.contains(&format!("`[{key}]`")),
            "{key}"
        );
    }
}
