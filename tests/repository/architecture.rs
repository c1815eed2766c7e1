//! The dependency rule: which room may use which, read from the `use` lines and paths in the source.

#![expect(
    clippy::expect_used,
    clippy::disallowed_methods,
    reason = "a test reads files, and stops where its own set-up is wrong"
)]

use std::fs;
use std::path::{Path, PathBuf};

/// A room (folder or file below `src`), and the rooms of this crate that it may name.
const ROOMS: &[(&str, &[&str])] = &[
    ("config", &["config", "core"]),
    ("identify", &["identify", "core"]),
    ("evaluate", &["evaluate", "core"]),
    ("diagnose", &["diagnose", "core"]),
    ("formats", &["formats", "identify", "evaluate", "core"]),
    // a crate of its own: nothing of volcomp
    ("state", &["audit", "bounded_read", "counters", "disk", "memory", "models", "utc"]),
    ("runtime", &["runtime", "config", "diagnose", "core"]),
    ("cli", &["cli", "runtime", "config", "formats", "identify", "evaluate", "diagnose", "core"]),
    ("bin", &["cli"]),
];

/// Rooms that are crates of their own: their manifests are their arrows.
const CRATES: &[&str] = &["model", "protocol", "engine", "estimate"];

/// Crates that only the shell (runtime, cli) may use.
const IMPURE: &[&str] = &[
    "tokio",
    "socket2",
    "mio",
    "tracing",
    "rustix",
    "thread_priority",
    "sd_notify",
    "crossbeam_channel",
    "std::fs",
    "std::net",
    "std::thread",
    "std::time",
    "std::process",
    "std::env",
];

/// What the simulator may take from volcomp.
const SIMULATOR_MAY_USE: &[&str] = &["core::axes", "core::units", "core::protocol", "core::record"];
/// The simulator's front room starts the product's programs and reads their figures; it holds no machine model.
const SIMULATOR_FRONT: &[&str] = &["demo", "scenarios", "cli", "cli.rs", "main.rs"];

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

fn sources(path: &Path, found: &mut Vec<PathBuf>) {
    if path.is_file() {
        if path.extension().is_some_and(|e| e == "rs") {
            found.push(path.to_owned());
        }
        return;
    }
    let mut entries: Vec<_> =
        fs::read_dir(path).expect("readable folder").map(|e| e.expect("entry").path()).collect();
    entries.sort();
    for entry in entries {
        sources(&entry, found);
    }
}

/// The code of a file without comments, strings left in (no path of ours stands in one).
fn code(path: &Path) -> String {
    let text = fs::read_to_string(path).expect("source");
    text.lines().map(|l| l.split("//").next().unwrap_or("")).collect::<Vec<_>>().join("\n")
}

/// Every `prefix::a::b` in the code, as `a::b`; a group `prefix::{a, b}` gives each member.
fn paths(code: &str, prefix: &str) -> Vec<String> {
    let mut found = Vec::new();
    let needle = format!("{prefix}::");
    for (at, _) in code.match_indices(&needle) {
        let before = code[..at].chars().next_back();
        if before.is_some_and(|c| c.is_alphanumeric() || c == '_' || c == ':') {
            continue;
        }
        let rest = &code[at + needle.len()..];
        expand(rest, "", &mut found);
    }
    found
}

fn expand(rest: &str, head: &str, found: &mut Vec<String>) {
    let rest = rest.trim_start();
    if let Some(group) = rest.strip_prefix('{') {
        let mut depth = 1;
        let end = group
            .char_indices()
            .find(|(_, c)| {
                match c {
                    '{' => depth += 1,
                    '}' => depth -= 1,
                    _ => {}
                }
                depth == 0
            })
            .map_or(group.len(), |(i, _)| i);
        let mut depth = 0;
        for member in group[..end].split(|c| {
            match c {
                '{' => depth += 1,
                '}' => depth -= 1,
                _ => {}
            }
            c == ',' && depth == 0
        }) {
            if !member.trim().is_empty() {
                expand(member, head, found);
            }
        }
        return;
    }
    let word: String = rest.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect();
    let path = if head.is_empty() { word.clone() } else { format!("{head}::{word}") };
    match rest[word.len()..].strip_prefix("::") {
        Some(more) if path.matches("::").count() < 1 => expand(more, &path, found),
        _ => found.push(path),
    }
}

fn allowed(path: &str, may: &[&str]) -> bool {
    may.iter()
        .any(|m| path == *m || path.starts_with(&format!("{m}::")) || m.starts_with(&format!("{path}::")))
}

#[test]
fn rooms_use_only_what_their_line_lists() {
    let mut wrong = Vec::new();
    for (room, may) in ROOMS {
        let mut files = Vec::new();
        sources(&root().join("src").join(room), &mut files);
        assert!(!files.is_empty(), "room {room} is empty");
        for file in files {
            for path in paths(&code(&file), "crate").into_iter().chain(paths(&code(&file), "volcomp")) {
                if !allowed(&path, may) {
                    wrong.push(format!("{} uses {path}", file.display()));
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn every_source_file_belongs_to_a_room() {
    let mut files = Vec::new();
    sources(&root().join("src"), &mut files);
    for file in files {
        let relative = file.strip_prefix(root().join("src")).expect("below src");
        let known = relative == Path::new("lib.rs")
            || CRATES.iter().any(|room| relative.starts_with(room))
            || ROOMS.iter().any(|(room, _)| relative.starts_with(room));
        assert!(known, "{} belongs to no room", relative.display());
    }
}

#[test]
fn pure_rooms_name_no_clock_socket_file_or_thread() {
    let mut wrong = Vec::new();
    for room in CRATES.iter().chain(&["config", "identify", "evaluate", "diagnose", "formats"]) {
        let mut files = Vec::new();
        sources(&root().join("src").join(room), &mut files);
        for file in files {
            let code = code(&file);
            for impure in IMPURE {
                let hit = code.match_indices(impure).any(|(i, _)| {
                    let before = code[..i].chars().next_back();
                    let after = code[i + impure.len()..].chars().next();
                    !before.is_some_and(|c| c.is_alphanumeric() || c == '_' || c == ':')
                        && after.is_some_and(|c| c == ':' || c == ';')
                });
                if hit {
                    wrong.push(format!("{} names {impure}", file.display()));
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn the_simulated_machine_shares_no_model_code() {
    let mut wrong = Vec::new();
    let mut files = Vec::new();
    let src = root().join("simulator/src");
    sources(&src, &mut files);
    for file in files {
        let relative = file.strip_prefix(&src).expect("below simulator/src");
        if SIMULATOR_FRONT.iter().any(|f| relative.starts_with(f)) {
            continue;
        }
        for path in paths(&code(&file), "volcomp") {
            if !allowed(&path, SIMULATOR_MAY_USE) {
                wrong.push(format!("{} uses {path}", file.display()));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn the_second_generator_shares_nothing_with_the_first() {
    let mut files = Vec::new();
    sources(&root().join("simulator/src/formulas"), &mut files);
    assert!(!files.is_empty());
    for file in files {
        for prefix in ["crate", "volcomp", "simulator"] {
            let found = paths(&code(&file), prefix);
            assert!(found.is_empty(), "{} uses {prefix}::{}", file.display(), found.join(", "));
        }
    }
}

#[test]
fn the_front_room_of_the_simulator_starts_programs_and_no_models() {
    let src = root().join("simulator/src");
    let mut wrong = Vec::new();
    for front in SIMULATOR_FRONT {
        let path = src.join(front);
        if !path.exists() {
            continue;
        }
        let mut files = Vec::new();
        sources(&path, &mut files);
        for file in files {
            for path in paths(&code(&file), "volcomp") {
                if !allowed(&path, &["cli", "core::axes", "core::units", "core::protocol"]) {
                    wrong.push(format!("{} uses {path}", file.display()));
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn the_reader_of_paths_sees_groups_and_nesting() {
    let code =
        "use crate::core::{axes::AxisName, model::{Chain, Model}}; crate::config::parse(); mycrate::x::y();";
    let found = paths(code, "crate");
    assert_eq!(found, ["core::axes", "core::model", "config::parse"]);
}
