//! The dependency rule, read from the manifests: which crate of the workspace may use which, and what keeps the pure ones
//! pure. That no pure crate names a file, socket, thread or clock is checked by clippy (`clippy.toml`, forbidden there).

#![expect(clippy::disallowed_methods, reason = "cargo lists the manifests")]
#![expect(clippy::expect_used, reason = "a test stops where its own set-up is wrong")]

use std::collections::BTreeMap;
use std::process::Command;

use serde_json::Value;

/// The crates of the workspace that a crate may depend on, from the inside out. Tests may use more.
const ARROWS: &[(&str, &[&str])] = &[
    ("volcomp-units", &[]),
    ("volcomp-model", &["units"]),
    ("volcomp-protocol", &["units"]),
    ("volcomp-engine", &["units", "model", "protocol"]),
    ("volcomp-estimate", &["units", "model"]),
    ("volcomp-evaluate", &["units", "model"]),
    ("volcomp-effects", &["units", "model", "estimate"]),
    ("volcomp-identify", &["units", "model", "estimate"]),
    ("volcomp-formats", &["units", "model", "evaluate", "identify"]),
    ("volcomp-diagnose", &["units", "model", "effects"]),
    ("volcomp-config", &["units", "model", "protocol", "engine", "estimate"]),
    ("volcomp-state", &[]),
    ("volcomp-daemon", &["units", "model", "protocol", "engine", "estimate", "effects", "config", "state"]),
    ("volcomp-gateway", &["config", "daemon", "state"]),
    // the simulated machine must not share a model with the compensator
    ("volcomp-monitor", &["units", "protocol"]),
    ("simulated-machine", &["units", "protocol", "monitor"]),
    ("volcomp-adversary", &["units", "model", "protocol", "engine", "monitor"]),
    ("simulator", &["units", "protocol", "monitor", "simulated-machine", "cli"]),
];

/// Crates without I/O and clock.
const PURE: &[&str] = &[
    "volcomp-units",
    "volcomp-model",
    "volcomp-protocol",
    "volcomp-engine",
    "volcomp-estimate",
    "volcomp-evaluate",
    "volcomp-effects",
    "volcomp-identify",
    "volcomp-formats",
    "volcomp-diagnose",
    "volcomp-config",
];

/// All that pure crates may use from outside: mathematics, derives, parsers of text.
const PURE_MAY_USE: &[&str] = &[
    "annotate-snippets",
    "crc32c",
    "encoding_rs",
    "lz4_flex",
    "nalgebra",
    "rayon",
    "roxmltree",
    "serde",
    "serde_json",
    "statrs",
    "strsim",
    "thiserror",
    "toml",
    "wide",
];

/// Names of the ordinary dependencies of each crate of the workspace.
fn dependencies() -> BTreeMap<String, Vec<String>> {
    let output = Command::new(env!("CARGO"))
        .args(["metadata", "--no-deps", "--offline", "--format-version", "1"])
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .expect("cargo runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let metadata: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    let text = |value: &Value| value.as_str().expect("a name").to_owned();
    let packages = metadata["packages"].as_array().expect("packages");
    packages
        .iter()
        .map(|package| {
            let all = package["dependencies"].as_array().expect("dependencies");
            let normal = all.iter().filter(|d| d["kind"].is_null()).map(|d| text(&d["name"]));
            (text(&package["name"]), normal.collect())
        })
        .collect()
}

#[test]
fn crates_depend_on_what_lies_further_in_only() {
    let found = dependencies();
    for (name, may) in ARROWS {
        let own = found.get(*name).expect("a member of the workspace");
        for dependency in own.iter().filter(|d| found.contains_key(*d)) {
            let short = dependency.trim_start_matches("volcomp-");
            assert!(may.contains(&short), "{name} depends on {dependency}");
        }
    }
    let outer = ["volcomp", "volcomp-cli"];
    for name in found.keys() {
        let listed = ARROWS.iter().any(|(n, _)| n == name) || outer.contains(&name.as_str());
        assert!(listed, "{name} has no place in the architecture: add it to ARROWS");
    }
}

#[test]
fn pure_crates_depend_on_no_input_output_or_clock() {
    let found = dependencies();
    for name in PURE {
        for dependency in found.get(*name).expect("a member of the workspace") {
            let pure = PURE.contains(&dependency.as_str()) || PURE_MAY_USE.contains(&dependency.as_str());
            assert!(pure, "{name} depends on {dependency}");
        }
    }
}
