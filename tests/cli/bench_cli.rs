//! `volcomp bench` as its user meets it.

#![expect(clippy::disallowed_methods, reason = "the test runs the program")]
#![allow(clippy::expect_used, reason = "a test program: it fails by panicking")]

use std::path::Path;
use std::process::{Command, Output};

fn bench(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_volcomp")).arg("bench").args(args).output().expect("volcomp runs")
}

fn example(name: &str) -> String {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("config/examples").join(name).join("machine.toml");
    file.display().to_string()
}

#[test]
fn the_cost_of_a_cycle_is_told_for_every_example() {
    for (name, axes) in [("vmc-850", 3), ("gantry-5ax", 5), ("grinder-xyba", 4)] {
        let out = bench(&["--json", "--cycles", "2000", "--config", &example(name)]);
        assert!(out.status.success(), "{name}: {}", String::from_utf8_lossy(&out.stderr));
        let told: serde_json::Value = serde_json::from_slice(&out.stdout).expect("JSON");
        assert_eq!((&told["axes"], &told["cycles"]), (&axes.into(), &2000.into()), "{name}");
        let figures = ["p50", "p90", "p99", "p999", "max"]
            .map(|p| told[format!("compute_us_{p}")].as_f64().expect("a figure"));
        assert!(figures.is_sorted() && figures[0] > 0.0, "{name}: {figures:?}");
        assert!(told["realtime"]["fifo"].is_string(), "{told}");
    }
}

#[test]
fn mistakes_are_named() {
    for (args, code, says) in [
        (vec!["--config", "none.toml"], 74, "none.toml"),
        (vec!["--config", &example("vmc-850"), "--cycles", "0"], 64, "--cycles 0; give 1 to"),
        (vec![], 64, "--config"),
    ] {
        let out = bench(&args);
        let message = String::from_utf8_lossy(&out.stderr).into_owned();
        assert_eq!(out.status.code(), Some(code), "{args:?}: {message}");
        assert!(message.contains(says), "{args:?}: {message}");
        assert!(out.stdout.is_empty());
    }
}
