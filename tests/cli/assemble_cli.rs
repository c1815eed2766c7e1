//! `volcomp model assemble` and `volcomp diff` on files: sources kept, overlaps tested, exit codes.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
#![expect(clippy::disallowed_methods, reason = "the test writes files")]

use std::path::Path;
use std::process::{Command, Output};

use serde_json::Value;

fn volcomp(folder: &Path, args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_volcomp")).current_dir(folder).args(args).output().unwrap()
}

fn ok(folder: &Path, args: &[&str]) -> String {
    let output = volcomp(folder, args);
    assert!(output.status.success(), "{args:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

const HEAD: &str = "format = \"volcomp-model/1\"\nmachine = \"vmc\"\nchain = \"[w X' b Y Z t]\"\n";

/// A model file with a table of EXX, 41 places, `slope` um over 400 mm, uncertainty 0.2 um.
fn laser(slope: f64, extra: &str) -> String {
    let x: Vec<String> = (0..41).map(|i| format!("{}", 10 * i)).collect();
    let y: Vec<String> = (0..41)
        .map(|i| format!("{:.4}", 4.0 * (f64::from(i) / 6.0).sin() + slope * f64::from(i) / 40.0))
        .collect();
    format!(
        "{HEAD}{extra}[axes.x]\ntravel-mm = [0, 400]\n[errors.exx]\nstd-um = 0.2\n[errors.exx.table]\nposition-mm = [{}]\nvalue-um = [{}]\n",
        x.join(", "),
        y.join(", ")
    )
}

const LASER: &str = "[provenance]\ninstrument = \"laser\"\ndate = 2026-03-01\nsource = \"raw.csv\"\nsource-hash = \"blake3:00\"\nexpiry = 2027-03-01\n";

fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    write("a.toml", &laser(0.0, LASER));
    write("b.toml", &laser(0.1, "[provenance]\ninstrument = \"encoder\"\ndate = 2026-04-01\n"));
    write("bad.toml", &laser(9.0, ""));
    let square = "[errors.ec0y]\nstd-arcsec = 0.3\n[errors.ec0y.constant]\nvalue-arcsec = 4\n";
    write("square.toml", &format!("{HEAD}{square}"));
    // a straight edge that lay 20 arcsec askew
    let mut motion = String::from("position_mm,exy_um,ecy_arcsec,cycle,direction\n");
    for cycle in 1..=3 {
        for i in 0..21 {
            let y = 20.0 * f64::from(i);
            let noise = 0.05 * f64::from((7 * i + 3 * cycle) % 5 - 2);
            let line = 1e3 * y * 20.0 * core::f64::consts::PI / 648_000.0;
            motion.push_str(&format!(
                "{y},{},{},{cycle},1\n",
                3.0 * (y / 130.0).sin() + line + noise,
                0.01 * y + noise
            ));
        }
    }
    write("y.csv", &motion);
    folder
}

#[test]
fn sources_are_kept_and_the_straight_edge_counts_for_nothing() {
    let folder = folder();
    let f = folder.path();
    let text = ok(
        f,
        &[
            "model",
            "assemble",
            "a.toml",
            "b.toml",
            "square.toml",
            "--motion",
            "y=y.csv",
            "--measured-at",
            "y.csv=0,0,-150",
            "--out",
            "m.toml",
        ],
    );
    assert!(text.contains("EXX   mean of a.toml 50 %, b.toml 50 %"), "{text}");
    assert!(
        text.contains("they agree")
            && text.contains("EXY slope")
            && text.contains("in y.csv, which does not state ec0y"),
        "{text}"
    );
    assert!(text.contains("datum and reference-line convention: met"), "{text}");
    let model = std::fs::read_to_string(f.join("m.toml")).unwrap();
    let parsed: toml::Value = model.parse::<toml::Table>().unwrap().into();
    let square = parsed["errors"]["ec0y"]["constant"]["value-arcsec"]
        .as_float()
        .or(parsed["errors"]["ec0y"]["constant"]["value-arcsec"].as_integer().map(|v| v as f64))
        .unwrap();
    assert!((square - 4.0).abs() < 1e-6, "{square}");
    // every input with the hash of its content
    let sources = parsed["provenance"]["sources"].as_array().unwrap();
    assert_eq!(sources.len(), 4);
    let hash =
        |name: &str| format!("blake3:{}", blake3::hash(&std::fs::read(f.join(name)).unwrap()).to_hex());
    assert_eq!(sources[0]["source-hash"].as_str().unwrap(), hash("a.toml"));
    assert_eq!(parsed["provenance"]["expiry"].to_string(), "\"2027-03-01\"");
    let exx = parsed["errors"]["exx"]["sources"].as_array().unwrap();
    assert_eq!(
        (exx[0]["instrument"].as_str(), exx[1]["instrument"].as_str()),
        (Some("laser"), Some("encoder"))
    );
    assert_eq!(parsed["errors"]["exy"]["source"].as_str(), Some("y.csv"));
    assert_eq!(parsed["errors"]["exy"]["source-hash"].as_str().unwrap(), hash("y.csv"));
    assert_eq!(parsed["axes"]["y"]["reference-points-mm"]["x"][2].as_integer(), Some(-150));
    // the model loads, and is its own normal form
    ok(f, &["check", "m.toml"]);
    // assembled again from the result and one more file, nothing changes
    ok(f, &["model", "assemble", "m.toml", "square.toml", "--out", "n.toml"]);
    let again = volcomp(f, &["model", "assemble", "m.toml", "square.toml", "--out", "n.toml"]);
    let note = String::from_utf8(again.stderr).unwrap();
    assert!(note.contains("m.toml was made from square.toml"), "{note}");
    // the same number twice is one measurement: neither value nor uncertainty changes
    assert_eq!(volcomp(f, &["diff", "m.toml", "n.toml"]).status.code(), Some(0));
}

#[test]
fn contradictions_name_numbers_and_remedies() {
    let folder = folder();
    let f = folder.path();
    let refused = volcomp(f, &["model", "assemble", "a.toml", "bad.toml", "--out", "m.toml"]);
    let message = String::from_utf8(refused.stderr).unwrap();
    assert_eq!(refused.status.code(), Some(65), "{message}");
    assert!(
        message.contains("EXX: a.toml and bad.toml differ by up to 4.50 µm") && message.contains("chi2"),
        "{message}"
    );
    assert!(!f.join("m.toml").exists(), "nothing is written");
    let json: Value = serde_json::from_str(&ok(
        f,
        &["model", "assemble", "a.toml", "bad.toml", "--prefer", "bad.toml:exx", "--out", "m.toml", "--json"],
    ))
    .unwrap();
    assert_eq!(json["errors"][0]["how"], "preferred");
    assert_eq!(
        (json["checks"][0]["agree"].as_bool(), json["checks"][0]["dof"].as_u64()),
        (Some(false), Some(40))
    );
    let json: Value = serde_json::from_str(&ok(
        f,
        &["model", "assemble", "a.toml", "bad.toml", "--average", "exx", "--out", "m.toml", "--json"],
    ))
    .unwrap();
    assert_eq!(json["errors"][0]["how"], "mean");
    for (args, code, words) in [
        (&["--prefer", "c.toml"][..], 64, "no such input; inputs are a.toml, bad.toml"),
        (&["--average", "nonsense"], 64, "unknown error 'nonsense'"),
        (&["--absolute", "c.toml"], 64, "no such input"),
        (&["--motion", "c=y.csv"], 64, "has no such axis"),
        (&["--motion", "y=none.csv"], 74, "none.csv"),
        (&["--motion", "x=y.csv"], 65, "EXY is an error of axis Y, but the axis given is X"),
        (&["--assume-std-um", "0"], 64, "not above 0"),
    ] {
        let mut all = vec!["model", "assemble", "a.toml", "bad.toml", "--out", "x.toml"];
        all.extend(args);
        let output = volcomp(f, &all);
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(code), "{args:?}: {message}");
        assert!(message.contains(words), "{args:?}: {message}");
    }
}

#[test]
fn diff_says_what_changed_and_what_it_does() {
    let folder = folder();
    let f = folder.path();
    let same = volcomp(f, &["diff", "a.toml", "a.toml"]);
    assert_eq!((same.status.code(), String::from_utf8_lossy(&same.stderr).as_ref()), (Some(0), ""));
    assert!(String::from_utf8(same.stdout).unwrap().contains("the same model"));
    let yaw = "[errors.ecx.chebyshev]\nrange-mm = [0, 400]\ncoefficients-arcsec = [2, 2]\n";
    std::fs::write(f.join("c.toml"), laser(9.0, "") + yaw + "[axes.y]\ntravel-mm = [0, 300]\n").unwrap();
    let output = volcomp(f, &["diff", "a.toml", "c.toml", "--json", "--svg", "d.svg", "--report", "d.html"]);
    assert_eq!(output.status.code(), Some(1));
    let json: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(json["same"], false);
    assert_eq!(json["changes"][0], "travel of Y: not stated -> 0 to 300 mm");
    let symbols: Vec<&str> =
        json["errors"].as_array().unwrap().iter().map(|e| e["symbol"].as_str().unwrap()).collect();
    assert_eq!(symbols, ["exx", "ecx"]);
    assert!((json["errors"][0]["largest_um"].as_f64().unwrap() - 9.0).abs() < 1e-3);
    assert_eq!(json["errors"][1]["what"], "only in second");
    // 9 um of scale against 4 arcsec of yaw over 300 mm in x, and over the 400 mm of the primed axis itself in y
    let arcsec = core::f64::consts::PI / 648_000.0 * 1e3;
    let (dx, dy) = (9.0 - 4.0 * arcsec * 300.0, 4.0 * arcsec * 400.0);
    let largest = json["volume"]["position"]["largest_um"].as_f64().unwrap();
    let expected = dx.hypot(dy).max(9.0f64.hypot(dy));
    assert!((largest - expected).abs() < 0.01, "{largest} instead of {expected}");
    assert!(json["volume"]["position"]["bound_um"].as_f64().unwrap() >= largest);
    assert!((json["volume"]["rotation"]["largest_arcsec"].as_f64().unwrap() - 4.0).abs() < 1e-6);
    let provenance = json["provenance"].to_string();
    assert!(provenance.contains("file instrument: laser -> -"), "{provenance}");
    let page = std::fs::read_to_string(f.join("d.html")).unwrap();
    assert!(
        page.contains("EXX") && page.contains("<svg") && !page.contains(" src=") && !page.contains(" href="),
        "self-contained"
    );
    assert!(std::fs::read_to_string(f.join("d.svg")).unwrap().contains("ECX"));
    // tolerances
    for (tolerance, code) in [("100", 0), ("5", 1)] {
        let output = volcomp(f, &["diff", "a.toml", "c.toml", "--tolerance-um", tolerance]);
        assert_eq!(output.status.code(), Some(code), "{tolerance}");
    }
    assert_eq!(volcomp(f, &["diff", "a.toml", "none.toml"]).status.code(), Some(74));
    std::fs::write(f.join("wrong.toml"), "format = 3").unwrap();
    assert_eq!(volcomp(f, &["diff", "a.toml", "wrong.toml"]).status.code(), Some(78));
}
