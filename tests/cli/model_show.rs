//! `volcomp model show`, `volcomp model normalise` and the bad input of models through `volcomp check`, as programs.

#![expect(clippy::unwrap_used, reason = "a test may stop at what it does not expect")]
#![expect(clippy::disallowed_methods, reason = "the test writes and reads the files of the programs")]

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::Value;

const HEAD: &str = "format = \"volcomp-model/1\"\nmachine = \"m\"\n";

fn volcomp(args: &[&str], dir: &Path) -> Output {
    Command::new(env!("CARGO_BIN_EXE_volcomp")).args(args).current_dir(dir).output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

/// Runs a verb that must succeed and gives its stdout.
#[track_caller]
fn stdout(args: &[&str], dir: &Path) -> String {
    let out = volcomp(args, dir);
    assert_eq!(out.status.code(), Some(0), "{args:?}: {}", text(&out.stderr));
    text(&out.stdout)
}

fn example(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("config/examples").join(name).join("model.toml")
}

/// A directory with `model.toml`.
fn directory(model: &str) -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("model.toml"), model).unwrap();
    dir
}

const SLOPED: &str = "chain = \"[w X' b Y Z t]\"\naxes.x.travel-mm = [0, 500]\naxes.y.travel-mm = [0, 400]\n\
    axes.z.travel-mm = [-300, 0]\n[errors.exx]\nstd-um = 0.4\ninstrument = \"laser 7\"\n[errors.exx.table]\nposition-mm = [0, 500]\n\
    value-um = [3, 8]\n[errors.eyx.table]\nposition-mm = [0, 250, 500]\nvalue-um = [0, 4, 5]\n";

#[test]
fn show_says_what_is_in_the_model_and_where_it_is_worst() {
    let dir = directory(&format!("{HEAD}{SLOPED}"));
    let shown = stdout(&["model", "show", "model.toml"], dir.path());
    for part in [
        "model.toml: model of m, chain [w X' b Y Z t]",
        "[ X' ]",
        "0..500 mm",
        "exx  table",
        "laser 7",
        "largest position error",
        // 8 um in X, 5 um in Y at the far end
        "9.43 µm",
        "at X 500",
        "-8.00 µm",
        "add --html model.html",
    ] {
        assert!(shown.contains(part), "{part} not in\n{shown}");
    }
    // without being asked nothing is written
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1);
}

#[test]
fn show_as_json_carries_the_same_numbers() {
    let dir = directory(&format!("{HEAD}{SLOPED}"));
    let json: Value =
        serde_json::from_str(&stdout(&["model", "show", "model.toml", "--json"], dir.path())).unwrap();
    let exx = &json["errors"][0];
    assert_eq!((exx["lowest_um"].as_f64(), exx["highest_um"].as_f64()), (Some(3.0), Some(8.0)));
    assert_eq!((exx["peak_to_peak_um"].as_f64(), exx["std_um"].as_f64()), (Some(5.0), Some(0.4)));
    assert_eq!(exx["provenance"]["instrument"], "laser 7");
    let worst = &json["worst"]["position"];
    assert!((worst["size_um"].as_f64().unwrap() - 89f64.sqrt()).abs() < 1e-6);
    assert_eq!(worst["at"]["x_mm"].as_f64(), Some(500.0));
    assert_eq!(json["corrections"]["x"]["largest_um"].as_f64(), Some(-8.0));
    assert_eq!(json["gauge"]["normal"], false);
}

#[test]
fn pictures_are_written_where_they_are_asked_for() {
    let dir = tempfile::tempdir().unwrap();
    for name in ["vmc-850", "gantry-5ax", "lathe-2ax", "grinder-xyba"] {
        let model = example(name).display().to_string();
        let shown =
            stdout(&["model", "show", &model, "--html", "page.html", "--svg", "picture.svg"], dir.path());
        assert!(shown.contains("written: page.html") && shown.contains("written: picture.svg"));
        let page = std::fs::read_to_string(dir.path().join("page.html")).unwrap();
        let svg = std::fs::read_to_string(dir.path().join("picture.svg")).unwrap();
        assert!(svg.starts_with("<svg") && svg.trim_end().ends_with("</svg>"));
        for part in
            ["Distorted volume", "magnified", "EXX", "Largest corrections", "Datums and reference lines"]
        {
            assert!(page.contains(part), "{name}: {part}");
        }
        // one file that needs no other
        let body = page.split("<body>").nth(1).unwrap();
        assert!(body.contains("µm") && !body.contains(" um"), "{name}");
        assert!(!page.contains("src=") && !page.contains("href="), "{name}");
    }
}

#[test]
fn normalise_keeps_origin_and_uncertainty_and_is_done_after_one_time() {
    let dir = directory(&format!("{HEAD}{SLOPED}"));
    let said = stdout(&["model", "normalise", "model.toml", "--out", "once.toml"], dir.path());
    assert!(
        said.contains("ec0y 0 arcsec becomes -2.063 arcsec")
            && said.contains("shift of the workpiece (3, 0, 0) µm")
    );
    let once = std::fs::read_to_string(dir.path().join("once.toml")).unwrap();
    for part in ["std-um = 0.4", "instrument = \"laser 7\"", "[errors.ec0y.constant]", "value-um = [0, 5]"] {
        assert!(once.contains(part), "{part} not in\n{once}");
    }
    let said = stdout(&["model", "normalise", "once.toml", "--out", "twice.toml"], dir.path());
    assert!(said.contains("datum and reference-line convention: met"), "{said}");
    let twice = std::fs::read_to_string(dir.path().join("twice.toml")).unwrap();
    let body = |t: &str| t.lines().skip(1).collect::<Vec<_>>().join("\n");
    assert_eq!(body(&once), body(&twice));
}

#[test]
fn check_reports_the_gauge() {
    let dir = directory(&format!("{HEAD}{SLOPED}"));
    let shown = stdout(&["check", "model.toml"], dir.path());
    let of_convention =
        |text: &str| text.lines().filter(|l| l.contains("convention") || l.contains("eyx slope")).count();
    assert!(shown.contains("convention: 2 offsets and slopes are kept"), "{shown}");
    assert_eq!((of_convention(&shown), shown.contains("becomes")), (1, false), "one line: {shown}");
    for args in [["check", "--verbose", "model.toml"], ["model", "show", "model.toml"]] {
        assert!(stdout(&args, dir.path()).contains("datum and reference-line convention: "));
    }
    let all = stdout(&["check", "--verbose", "model.toml"], dir.path());
    assert!(all.contains("eyx slope over 0 to 500 mm, 2.063 arcsec -> ec0y -2.063 arcsec"), "{all}");
    assert!(all.contains("ec0y 0 arcsec becomes -2.063 arcsec"), "{all}");
    let json: Value = serde_json::from_str(&stdout(&["check", "model.toml", "--json"], dir.path())).unwrap();
    let gauge = &json["files"][0]["gauge"];
    assert_eq!(gauge["normal"], false);
    let slope = gauge["moved"].as_array().unwrap().iter().find(|m| m["part"] == "slope").unwrap();
    assert_eq!((slope["symbol"].as_str(), slope["to"][0]["symbol"].as_str()), (Some("eyx"), Some("ec0y")));
    let change = &gauge["changes"][0];
    assert_eq!(change["before_arcsec"].as_f64(), Some(0.0));
    assert!((change["after_arcsec"].as_f64().unwrap() + 2.062_648).abs() < 1e-6);
    assert_eq!(gauge["rigid"]["shift_um"][0].as_f64(), Some(3.0));
}

/// `volcomp check` of a model with one mistake: exit code 78, and these parts of the message.
#[track_caller]
fn refused(model: &str, parts: &[&str]) {
    let dir = directory(&format!("{HEAD}{model}"));
    for args in [&["check", "model.toml"][..], &["model", "show", "model.toml"]] {
        let out = volcomp(args, dir.path());
        let said = text(&out.stderr);
        assert_eq!(out.status.code(), Some(78), "{said}");
        assert!(!said.contains("mistakes"), "one mistake, one message:\n{said}");
        for part in parts {
            assert!(said.contains(part), "{part} not in\n{said}");
        }
    }
}

const TABLE: &str = "chain = \"[w C' X' b Y Z t]\"\naxes.c.point-mm = [0, 0, 0]\n";
const THREE: &str = "chain = \"[w X' b Y Z t]\"\n";

#[test]
fn underspecified_models_are_told_what_is_missing() {
    refused(
        "chain = \"[w C' X' b Y Z t]\"\n",
        &[
            "rotary axis C has no [axes.c], so it is not known where it turns",
            "model.toml:3:",
            "point-mm = [x, y, z]",
        ],
    );
    refused(
        "chain = \"[w C' X' b Y Z t]\"\naxes.c.travel-deg = [0, 360]\n",
        &["axes.c.point-mm is missing", "model.toml:4:", "a point on the axis of rotation at home"],
    );
    refused(
        &format!("{THREE}[axes.w.reference-points-mm]\nx = [0, 0, 0]\n"),
        &[
            "axis W has an entry but is not in the chain",
            "model.toml:4:",
            "the chain is [w X' b Y Z t]: add W to it",
        ],
    );
    refused(
        &format!("{TABLE}[errors.ez0c.constant]\nvalue-um = 5\n"),
        &[
            "ez0c is not an error symbol",
            "a shift of a rotary axis along itself has no effect",
            "model.toml:5:9",
        ],
    );
    refused(
        &format!("{TABLE}[errors.ey0a.constant]\nvalue-um = 5\n"),
        &["EY0A: axis A is not in the chain", "model.toml:5:9", "the chain is [w C' X' b Y Z t]"],
    );
    refused(
        "chain = \"[w b X Z t]\"\n[errors.ea0z.constant]\nvalue-arcsec = 5\n",
        &["EA0Z is a squareness to axis Y, which is not in the chain", "model.toml:4:9"],
    );
    refused(
        &format!(
            "{THREE}[errors.ezy.grid]\naxes = [\"y\", \"w\"]\ny-mm = [0, 1]\nw-mm = [0, 1]\nvalue-um = [0, 0, 0, 1]\n"
        ),
        &["EZY: its grid runs over axis W, which is not in the chain", "model.toml:4:9"],
    );
    refused(
        &format!("{THREE}axes.x.point-mm = [0, 0, 0]\n"),
        &["only a rotary axis turns about a point", "model.toml:4:"],
    );
    refused(
        &format!("{TABLE}[axes.c.reference-points-mm]\nx = [0, 0, 0]\n"),
        &["reference points belong to linear axes; a rotary axis has point-mm"],
    );
}

#[test]
fn unit_mistakes_are_named_with_the_likely_unit() {
    for (error, parts) in [
        (
            "[errors.exx.table]\nposition-mm = [0, 9]\nvalue-um = [0, 8000]\n",
            ["EXX reaches 8000 µm", "in nm, not in µm?", "model.toml:6:16"],
        ),
        (
            "[errors.exx.table]\nposition-mm = [0, 9]\nvalue-um = [0, 1e7]\n",
            ["the limit is 5000 µm (5 mm)", "are these positions instead of deviations?", "model.toml:6:16"],
        ),
        (
            "[errors.eax.constant]\nvalue-arcsec = 2500\n",
            ["EAX reaches 2500 arcsec", "in urad, not in arcsec?", "model.toml:5:16"],
        ),
        (
            "[errors.ec0y.constant]\nvalue-arcsec = -5000\n",
            ["EC0Y reaches 5000 arcsec", "the limit is 2063 arcsec (10 mrad)", "model.toml:5:16"],
        ),
        (
            "[errors.eby.constant]\nvalue-arcsec = 2e7\n",
            ["EBY reaches 20000000 arcsec", "angles instead of their errors?", "model.toml:5:16"],
        ),
        (
            "[errors.eyx.fourier]\nspan-mm = 500\nperiod-mm = 500\nsin-um = [6000]\n",
            ["EYX reaches 6000 µm", "in nm, not in µm?", "model.toml:7:11"],
        ),
        (
            "[errors.ecx.chebyshev]\nrange-mm = [0, 500]\ncoefficients-arcsec = [2, 3000]\n",
            ["ECX reaches 3002 arcsec", "in urad, not in arcsec?", "model.toml:6:27"],
        ),
        (
            "[errors.ezy.grid]\naxes = [\"y\", \"z\"]\ny-mm = [0, 1]\nz-mm = [0, 1]\nvalue-um = [0, 0, 0, 7000]\n",
            ["EZY reaches 7000 µm", "in nm, not in µm?", "model.toml:8:22"],
        ),
    ] {
        refused(&format!("{THREE}{error}"), &parts);
    }
}

#[test]
fn files_that_cannot_be_used_have_their_exit_codes() {
    let dir = directory("format = 1");
    let code = |args: &[&str]| volcomp(args, dir.path()).status.code();
    assert_eq!(code(&["model", "show", "absent.toml"]), Some(74));
    assert_eq!(code(&["model", "show", "model.toml"]), Some(78));
    assert_eq!(code(&["model", "show"]), Some(64));
    std::fs::write(dir.path().join("bytes.toml"), b"# \xff\n").unwrap();
    assert_eq!(code(&["model", "show", "bytes.toml"]), Some(78));
    std::fs::write(dir.path().join("good.toml"), format!("{HEAD}{SLOPED}")).unwrap();
    assert_eq!(code(&["model", "show", "good.toml", "--html", "no/such/place.html"]), Some(74));
    assert_eq!(code(&["model", "normalise", "good.toml", "--out", "no/such/place.toml"]), Some(74));
    // an error without errors to show is a model too
    std::fs::write(dir.path().join("empty.toml"), format!("{HEAD}{THREE}")).unwrap();
    assert!(stdout(&["model", "show", "empty.toml", "--svg", "e.svg"], dir.path()).contains("no errors"));
}

/// Every example of the guide can be pasted into a file.
#[test]
fn the_examples_of_the_guide_are_valid() {
    let guide = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/reference/model-files.md");
    let guide = std::fs::read_to_string(guide).unwrap();
    let blocks: Vec<&str> =
        guide.split("```toml\n").skip(1).map(|b| b.split("```").next().unwrap()).collect();
    assert!(blocks.len() >= 8, "{}", blocks.len());
    for block in blocks {
        // what is said about an error needs a curve of it
        let curve = if block.contains("[errors.ezx]") { "[errors.ezx.constant]\nvalue-um = 1\n" } else { "" };
        let dir = directory(&format!("{HEAD}{THREE}{block}{curve}"));
        stdout(&["check", "model.toml"], dir.path());
    }
    for chain in
        guide.lines().filter_map(|l| l.strip_prefix('|')?.split('`').nth(1)).filter(|c| c.starts_with("[w"))
    {
        assert!(volcomp::model::Chain::parse(chain).is_ok(), "{chain}");
    }
}
