//! Outputs that would be written over an input or over a file of another kind.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
#![expect(clippy::disallowed_methods, reason = "the test writes and reads files")]

use std::path::Path;
use std::process::Command;

const DATA: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/cli/outputs/data/");

/// Exit code and stderr of a command line in a folder.
fn run(folder: &Path, line: &str) -> (i32, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_volcomp"))
        .args(line.split_whitespace())
        .current_dir(folder)
        .output()
        .unwrap();
    (output.status.code().unwrap(), String::from_utf8(output.stderr).unwrap())
}

#[test]
fn no_command_writes_over_what_it_reads() {
    let scratch = tempfile::tempdir().unwrap();
    let d = scratch.path();
    for (from, to) in [
        ("fit/x.csv", "x.csv"),
        ("linear-after.csv", "after.csv"),
        ("linear-before.csv", "before.csv"),
        ("model-full.toml", "model.toml"),
        ("points.csv", "points.csv"),
    ] {
        std::fs::copy(format!("{DATA}{from}"), d.join(to)).unwrap();
    }
    std::os::unix::fs::symlink(d.join("x.csv"), d.join("link.csv")).unwrap();
    std::fs::create_dir(d.join("sub")).unwrap();
    let contents = |name: &str| std::fs::read(d.join(name)).unwrap();
    for (line, input, named) in [
        ("fit --errors x.csv --axis x --out x.csv", "x.csv", "--out x.csv: is the file of --errors"),
        ("fit --errors x.csv --axis x --out sub/../x.csv", "x.csv", "is the file of --errors"),
        ("fit --errors x.csv --axis x --out link.csv", "x.csv", "--out link.csv: is the file of"),
        ("fit --errors link.csv --axis x --out m.toml --json x.csv", "x.csv", "--json x.csv: is"),
        (
            "fit --errors x.csv --axis x --out m.toml --html m.toml",
            "x.csv",
            "--out m.toml: is the file of --html",
        ),
        ("evaluate iso230-2 --data after.csv --html after.csv", "after.csv", "--html after.csv: is"),
        (
            "evaluate iso230-2 after.csv --svg after.csv",
            "after.csv",
            "--svg after.csv: is the file of [FILE]",
        ),
        (
            "verify --before before.csv --after after.csv --html before.csv",
            "before.csv",
            "is the file of --before",
        ),
        (
            "predict --model model.toml --points points.csv --out points.csv",
            "points.csv",
            "is the file of --points",
        ),
        ("model show model.toml --html model.toml", "model.toml", "--html model.toml: is"),
        ("model normalise model.toml --out model.toml", "model.toml", "--out model.toml: is"),
        // a compound value is compared at the moment of writing
        (
            "model assemble --base model.toml --motion x=x.csv --out x.csv",
            "x.csv",
            "x.csv: exists and is not a model file",
        ),
    ] {
        let before = contents(input);
        let (code, stderr) = run(d, line);
        assert_eq!(code, 64, "{line}: {stderr}");
        assert!(stderr.contains(named), "{line}: {stderr}");
        assert_eq!(contents(input), before, "{line}");
    }
    assert!(!d.join("m.toml").exists());
}

#[test]
fn a_model_replaces_a_model_and_nothing_else() {
    let scratch = tempfile::tempdir().unwrap();
    let d = scratch.path();
    std::fs::copy(format!("{DATA}fit/x.csv"), d.join("x.csv")).unwrap();
    std::fs::write(d.join("machine.toml"), "[machine]\nid = \"vmc\"\n").unwrap();
    let (code, stderr) = run(d, "fit --errors x.csv --axis x --out machine.toml");
    assert_eq!(code, 64);
    assert!(stderr.contains("machine.toml: exists and is not a model file"), "{stderr}");
    assert_eq!(std::fs::read_to_string(d.join("machine.toml")).unwrap(), "[machine]\nid = \"vmc\"\n");
    for line in [
        "fit --errors x.csv --axis x --out m.toml",
        "fit --errors x.csv --axis x --out m.toml",
        "fit --errors x.csv --axis x --into m.toml",
        "fit --errors x.csv --axis x --into m.toml --out m.toml",
    ] {
        let (code, stderr) = run(d, line);
        assert_eq!(code, 0, "{line}: {stderr}");
    }
}

#[test]
fn what_is_missing_is_named() {
    let scratch = tempfile::tempdir().unwrap();
    let d = scratch.path();
    std::fs::copy(format!("{DATA}fit/x.csv"), d.join("x.csv")).unwrap();
    for (line, named) in [
        ("fit --errors none.csv --axis x --out m.toml", "none.csv: no such file"),
        ("fit --errors no/x.csv --axis x --out m.toml", "no/x.csv: folder no does not exist"),
        ("fit --errors x.csv/x.csv --axis x --out m.toml", "x.csv is not a folder"),
        ("fit --errors x.csv --axis x --out no/m.toml", "no/m.toml: folder no does not exist"),
        ("fit --errors x.csv --axis x --into none.toml", "none.toml: no such file"),
    ] {
        let (code, stderr) = run(d, line);
        assert_eq!(code, 74, "{line}: {stderr}");
        assert!(stderr.contains(named) && !stderr.contains("os error"), "{line}: {stderr}");
        // before anything is computed
        assert!(!stderr.contains("note:"), "{line}: {stderr}");
    }
}

#[test]
fn a_negative_number_meets_the_range_of_its_option() {
    let scratch = tempfile::tempdir().unwrap();
    let d = scratch.path();
    std::fs::copy(format!("{DATA}linear-after.csv"), d.join("t.csv")).unwrap();
    let (code, stderr) =
        run(d, "evaluate iso230-2 t.csv --temperature-degc -5 --u-expansion-um-per-m-degc 1");
    assert_eq!(code, 0, "{stderr}");
    for (line, named) in [
        ("evaluate iso230-2 t.csv --u-device-um -3", "'-3' for '--u-device-um <UM>': expected 0 to 100000"),
        (
            "evaluate iso230-2 t.csv --temperature-degc -60 --u-expansion-um-per-m-degc 1",
            "expected -50 to 150",
        ),
        (
            "fit --errors t.csv --axis x --out m.toml --order -3",
            "'-3' is neither a number from 0 up nor auto",
        ),
        ("diagnose --data t.csv --seed -1", "'-1' for '--seed <N>': expected a whole number from 0 up"),
    ] {
        let (code, stderr) = run(d, line);
        assert_eq!(code, 64, "{line}: {stderr}");
        assert!(stderr.contains(named), "{line}: {stderr}");
    }
}

#[test]
fn a_file_of_another_kind_is_named() {
    let scratch = tempfile::tempdir().unwrap();
    let d = scratch.path();
    for (from, to) in
        [("model-full.toml", "model.toml"), ("points.csv", "points.csv"), ("addition.toml", "addition.toml")]
    {
        std::fs::copy(format!("{DATA}{from}"), d.join(to)).unwrap();
    }
    for (line, named) in [
        (
            "model extend --model model.toml --add model.toml --out o.toml",
            "volcomp-model/1 file, not an addition",
        ),
        ("export points.csv --format csv --out o.csv", "not TOML: this is a table of data"),
        ("predict --model points.csv --points points.csv --out -", "not TOML: this is a table of data"),
    ] {
        let (code, stderr) = run(d, line);
        assert_eq!(code, 78, "{line}: {stderr}");
        assert!(stderr.contains(named) && stderr.matches("error:").count() == 1, "{line}: {stderr}");
    }
    std::fs::write(d.join("points-of-x.csv"), "x_mm\n100\n").unwrap();
    let (code, stderr) = run(d, "predict --model model.toml --points points-of-x.csv --out -");
    assert_eq!(code, 0, "{stderr}");
    assert!(
        stderr.contains("no column dir_x: errors of axis X that depend on its direction are those of travel"),
        "{stderr}"
    );
}
