//! Reports that are handed over: head, verdicts, causes by rank, trend, documentation of a model; printed by Chromium.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
#![expect(clippy::disallowed_methods, reason = "the test writes files")]

use std::fmt::Write as _;
use std::path::Path;
use std::process::{Command, Output};

use serde_json::Value;

const HEAD: &str = r#"
[machine]
manufacturer = "Muster"
name = "VMC 850"
serial-number = 4711
control = "LinuxCNC 2.9"
location = "hall <3>"
[test]
operator = "A. Meister"
customer = "B. Kunde"
date = 2026-03-12
feed-mm-per-min = 1000
warm-up = "60 min, X at 10 m/min"
temperature-start-degc = 20.1
temperature-end-degc = 20.6
[instrument]
name = "laser interferometer"
serial-number = "L-17"
certificate = "D-K-1234"
calibrated = 2025-11-03
[tolerance.iso230-2]
a-um = 30
e-um = 10
m-um = 14.9
r-arcsec = 1
[tolerance.iso230-4]
g-bi-um = 20
fmin-um = -1
[uncertainty.iso230-4]
g-bi-um = 0.9
[compensation]
native = ["backlash of X"]
not-compensated = ["warping of the table under load"]
re-check = 2027-03-12
[[compensation.validation]]
measurement = "body diagonals"
date = 2026-03-13
points = 44
before-um = 60
after-um = 8.5
"#;

fn volcomp(folder: &Path, args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_volcomp")).args(args).current_dir(folder).output().unwrap()
}

fn ok(folder: &Path, args: &[&str]) -> String {
    let output = volcomp(folder, args);
    assert!(output.status.success(), "{args:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

fn refused(folder: &Path, code: i32, args: &[&str]) -> String {
    let output = volcomp(folder, args);
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(code), "{message}");
    message
}

fn read(folder: &Path, name: &str) -> String {
    std::fs::read_to_string(folder.join(name)).unwrap()
}

/// A positioning test of so many targets 50 mm apart; reversal 4 um and slope times `scale`.
fn positioning(folder: &Path, name: &str, targets: u32, scale: f64) {
    let mut csv = String::from("cycle,direction,target_mm,deviation_um\n");
    for cycle in 1..=5u32 {
        for direction in [1, -1] {
            for i in 0..targets {
                let noise = 0.1 * (f64::from((cycle * 7 + i * 3) % 5) - 2.0);
                let d = scale * (1.2 * f64::from(i) + 2.0 * f64::from(direction)) + noise;
                writeln!(csv, "{cycle},{direction},{},{d:.4}", 50 * i).unwrap();
            }
        }
    }
    std::fs::write(folder.join(name), csv).unwrap();
}

/// Circles with a squareness of 40 um/m and lost motion of X, a scatter of 0.2 um.
fn circles(folder: &Path, name: &str, play_um: f64) {
    let mut csv = String::from("angle_deg,deviation_um,direction,feed_mm_per_min\n");
    for feed in [1000, 3000] {
        for direction in [1.0, -1.0] {
            for i in 0..720u32 {
                let degrees = if direction > 0.0 { 0.5 * f64::from(i) } else { 360.0 - 0.5 * f64::from(i) };
                let (sin, cos) = degrees.to_radians().sin_cos();
                let square = -150.0 * 40e-3 * sin * cos;
                let play = 0.5 * play_um * direction * sin.signum() * cos;
                let noise = 0.2 * (f64::from(i) * 2.399 + f64::from(feed)).sin();
                writeln!(csv, "{degrees},{:.4},{direction},{feed}", square + play + noise).unwrap();
            }
        }
    }
    std::fs::write(folder.join(name), csv).unwrap();
}

/// The words of a page without markup and style.
fn words(page: &str) -> String {
    let body = page.split("<body>").nth(1).unwrap();
    let mut out = String::new();
    for part in body.split('<') {
        out.push_str(part.split_once('>').map_or(part, |(_, text)| text));
        out.push(' ');
    }
    out.split_whitespace().collect::<Vec<_>>().join(" ")
}

fn holds(text: &str, wanted: &[&str]) {
    for w in wanted {
        assert!(text.contains(w), "{w} in {text}");
    }
}

#[test]
fn an_acceptance_report_has_its_head_and_verdicts() {
    let folder = tempfile::tempdir().unwrap();
    let d = folder.path();
    positioning(d, "after.csv", 11, 1.0);
    positioning(d, "before.csv", 11, 3.0);
    std::fs::write(d.join("head.toml"), HEAD).unwrap();
    let model = concat!(env!("CARGO_MANIFEST_DIR"), "/config/examples/vmc-850/model.toml");
    let common =
        ["evaluate", "iso230-2", "--data", "after.csv", "--before", "before.csv", "--head", "head.toml"];
    let args: Vec<&str> = common
        .into_iter()
        .chain(["--u-device-um", "1", "--html", "r.html", "--active-model", model, "--tolerance", "b-um=8"])
        .collect();
    let json: Value = serde_json::from_str(&ok(d, &[&args[..], &["--json"]].concat())).unwrap();
    // A about 17 of 30, E about 16 of 10, M 12 of 14.9 with U 1, B 4 of 8
    let verdict = |key: &str| json["conformity"][key]["verdict"].as_str().unwrap().to_owned();
    assert_eq!(verdict("a_um"), "conformity");
    assert_eq!(verdict("e_um"), "non-conformity");
    // reversal knows drift only, which is not stated
    assert_eq!(verdict("b_um"), "uncertainty-not-stated");
    let drift = [&args[..], &["--drift-um", "0.5", "--json"]].concat();
    let with_drift: Value = serde_json::from_str(&ok(d, &drift)).unwrap();
    assert_eq!(with_drift["conformity"]["b_um"]["verdict"], "conformity");
    ok(d, &args);
    assert_eq!(json["conformity"]["a_um"]["limit"], 30.0);
    assert!((json["conformity"]["a_um"]["expanded_uncertainty_k2"].as_f64().unwrap() - 1.0).abs() < 1e-9);
    assert_eq!(json["conformity"].as_object().unwrap().len(), 4);
    let page = read(d, "r.html");
    let hash = blake3::hash(&std::fs::read(model).unwrap()).to_hex();
    let data = blake3::hash(&std::fs::read(d.join("before.csv")).unwrap()).to_hex();
    holds(
        &words(&page),
        &[
            "ISO 230-2:2014",
            "Non-conformity: bidirectional systematic positioning error E.",
            "Muster, VMC 850",
            "serial number 4711",
            "LinuxCNC 2.9",
            "hall &lt;3&gt;",
            "A. Meister",
            "B. Kunde",
            "2026-03-12",
            "1000 mm/min",
            "20.1 °C / 20.6 °C",
            "60 min, X at 10 m/min",
            "laser interferometer",
            "L-17",
            "D-K-1234",
            "2025-11-03",
            concat!("volcomp ", env!("CARGO_PKG_VERSION")),
            &hash,
            &data,
            "U (k = 2) / µm tolerance / µm verdict",
            "Measured by (name, signature)",
            "ISO 14253-1",
        ],
    );
    assert!(!page.contains(" src=") && !page.contains(" href=") && page.contains("counter(pages)"));
    // within the uncertainty neither is proved; without one nothing is
    let neither = [&common[..], &["--u-device-um", "3", "--tolerance", "m-um=12.5"]].concat();
    holds(&ok(d, &neither), &["neither: tolerance within U"]);
    holds(&ok(d, &common), &["not decided: U not stated"]);
    // without a head every field says so
    ok(d, &["evaluate", "iso230-2", "--data", "after.csv", "--html", "bare.html"]);
    let bare = words(&read(d, "bare.html"));
    assert!(bare.matches("not stated").count() >= 15, "{bare}");
    holds(&bare, &["calibration certificate not stated", "warm-up not stated"]);
    holds(
        &refused(d, 64, &["evaluate", "iso230-2", "--data", "after.csv", "--tolerance", "q-um=1"]),
        &["--tolerance q-um: unknown figure; expected one of b-um"],
    );
    std::fs::write(d.join("wrong.toml"), "[tolerance.iso230-2]\ng-um = 1\n").unwrap();
    let wrong = ["evaluate", "iso230-2", "--data", "after.csv", "--head", "wrong.toml"];
    holds(&refused(d, 78, &wrong), &["wrong.toml: unknown figure `g-um` of iso230-2"]);
}

#[test]
fn a_laser_file_fills_the_head() {
    let folder = tempfile::tempdir().unwrap();
    let laser = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/formats/laser-x.rtl");
    ok(folder.path(), &["evaluate", "iso230-2", "--data", laser, "--report", "r.html"]);
    holds(
        &words(&read(folder.path(), "r.html")),
        &["machine VMC 850", "serial number 17", "hall 3", "12 Dec 2016", "ann", "20.2 °C / 20.3 °C"],
    );
}

#[test]
fn before_and_after_stand_in_one_report_with_verdicts() {
    let folder = tempfile::tempdir().unwrap();
    let d = folder.path();
    positioning(d, "after.csv", 11, 0.5);
    positioning(d, "before.csv", 11, 3.0);
    std::fs::write(d.join("head.toml"), HEAD).unwrap();
    let args = [
        "verify",
        "--before",
        "before.csv",
        "--after",
        "after.csv",
        "--head",
        "head.toml",
        "--u-device-um",
        "0.8",
        "--html",
        "v.html",
        "--json",
    ];
    let json: Value = serde_json::from_str(&ok(d, &args)).unwrap();
    assert_eq!(json["conformity"]["a_um"]["verdict"], "conformity");
    assert_eq!(json["readings"], serde_json::json!([110, 110]));
    holds(
        &words(&read(d, "v.html")),
        &[
            "Conformity with all 3 stated tolerances",
            "VMC 850",
            "D-K-1234",
            "before / µm after / µm reduction",
            "Accepted by",
        ],
    );
    // the same figures before and after have no sign of zero
    let same = ok(d, &["evaluate", "iso230-2", "--data", "after.csv", "--before", "after.csv"]);
    assert!(same.contains(" 0 %") && !same.contains("+0 %") && !same.contains("-0"), "{same}");
}

#[test]
fn a_change_within_the_uncertainty_is_not_significant_and_exchanged_files_are_noticed() {
    let folder = tempfile::tempdir().unwrap();
    let d = folder.path();
    positioning(d, "before.csv", 11, 3.0);
    positioning(d, "after.csv", 11, 0.1);
    let verify = |before, after| {
        let output = volcomp(d, &["verify", "--before", before, "--after", after, "--html", "v.html"]);
        assert!(output.status.success());
        [output.stdout, output.stderr].map(|bytes| String::from_utf8(bytes).unwrap())
    };
    let [text, notes] = verify("before.csv", "after.csv");
    let row = |name: &str| text.lines().find(|l| l.starts_with(name)).unwrap_or_default().to_owned();
    // the repeatability is that of the noise in both tests but for the reversal
    assert!(row("repeatability R, forward").contains("not significant"), "{text}");
    let accuracy = row("bidirectional positioning accuracy A");
    assert!(accuracy.matches('±').count() == 3 && accuracy.contains('%'), "{text}");
    assert!(row("RMS of the mean deviations, about zero").contains('%'), "{text}");
    assert!(text.contains("± expanded uncertainty, k = 2") && !notes.contains("exchanged"), "{notes}");
    let page = read(d, "v.html");
    holds(&words(&page), &["After, same scale", "After, own scale", "not significant"]);
    assert!(page.contains("mean of both") && !page.contains("(dashed)"), "the key is dashed itself");
    let [_, notes] = verify("after.csv", "before.csv");
    holds(&notes, &["are --before and --after exchanged"]);
    holds(&words(&read(d, "v.html")), &["are --before and --after exchanged"]);
    let json = ok(d, &["verify", "--before", "before.csv", "--after", "after.csv", "--json"]);
    let json: Value = serde_json::from_str(&json).unwrap();
    assert_eq!(json["figures"]["r_fwd_um"]["significant"], false);
    assert_eq!(json["figures"]["a_um"]["significant"], true);
    assert!(json["figures"]["a_um"]["before_u95"].as_f64().unwrap() > 0.0, "{json}");
}

#[test]
fn files_that_cannot_be_compared_are_named_by_what_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let d = folder.path();
    positioning(d, "x.csv", 5, 1.0);
    std::fs::write(d.join("d.csv"), "diagonal,cycle,direction,target_mm,deviation_um\nppp,1,1,0,0\n")
        .unwrap();
    std::fs::write(d.join("machine.toml"), "format = \"volcomp-machine/1\"\nmachine = \"m\"\n").unwrap();
    let verify = |after| refused(d, 65, &["verify", "--before", "x.csv", "--after", after]);
    holds(&verify("machine.toml"), &["error: machine.toml: not a table of readings"]);
    holds(
        &verify("d.csv"),
        &["x.csv is a positioning test (ISO 230-2), this is a test of body diagonals (ISO 230-6)"],
    );
}

#[test]
fn units_and_uncertainties_that_no_machine_has_are_noted() {
    let folder = tempfile::tempdir().unwrap();
    let d = folder.path();
    positioning(d, "um.csv", 5, 1.0);
    positioning(d, "mm.csv", 5, 0.001);
    let text = read(d, "mm.csv");
    let small: Vec<String> = text
        .lines()
        .map(|l| match l.rsplit_once(',').and_then(|(l, v)| Some((l, v.parse::<f64>().ok()?))) {
            Some((l, v)) => format!("{l},{}", v / 1000.0),
            None => l.to_owned(),
        })
        .collect();
    std::fs::write(d.join("mm.csv"), small.join("\n")).unwrap();
    let notes = |args: &[&str]| {
        String::from_utf8(volcomp(d, &[&["evaluate", "iso230-2"], args].concat()).stderr).unwrap()
    };
    assert!(notes(&["um.csv"]).is_empty());
    holds(&notes(&["mm.csv"]), &["no deviation exceeds 0.1 µm", "is deviation_um in µm?"]);
    holds(&notes(&["um.csv", "--u-device-um-per-m", "1500"]), &["is larger than A itself", "--u-device-um"]);
    std::fs::write(d.join("named.csv"), text.replace("deviation_um", "deviation_mm")).unwrap();
    let words = "deviation_mm is in mm: multiply by 1000 and name it deviation_um";
    holds(&refused(d, 65, &["evaluate", "iso230-2", "named.csv"]), &[words]);
    holds(&refused(d, 65, &["verify", "--before", "um.csv", "--after", "named.csv"]), &[words]);
}

#[test]
fn a_ballbar_report_ranks_causes_and_shows_what_changed() {
    let folder = tempfile::tempdir().unwrap();
    let d = folder.path();
    for (name, play) in [("jan.csv", 1.0), ("feb.csv", 2.0), ("mar.csv", 5.0)] {
        circles(d, name, play);
    }
    std::fs::write(d.join("head.toml"), HEAD).unwrap();
    let args = [
        "evaluate",
        "ballbar",
        "--data",
        "2026-03-02=mar.csv",
        "--data",
        "2026-01-12=jan.csv",
        "--data",
        "2026-02-10=feb.csv",
        "--radius-mm",
        "150",
        "--head",
        "head.toml",
        "--html",
        "b.html",
        "--json",
    ];
    let json: Value = serde_json::from_str(&ok(d, &args)).unwrap();
    let labels: Vec<&str> =
        json["tests"].as_array().unwrap().iter().map(|t| t["test"].as_str().unwrap()).collect();
    assert_eq!(labels, ["2026-01-12", "2026-02-10", "2026-03-02"]);
    let quantity = |start: &str| {
        let all = json["trend"]["quantities"].as_array().unwrap();
        all.iter().find(|q| q["quantity"].as_str().unwrap().starts_with(start)).unwrap().clone()
    };
    // what is noise in every test is no part of the trend
    assert_eq!(json["trend"]["quantities"].as_array().unwrap().len(), 4);
    let square = quantity("squareness error of X to Y");
    assert_eq!(square["significant"], false, "{square}");
    assert!((square["values"][2].as_f64().unwrap() - 40.0).abs() < 1.0, "{square}");
    let play = quantity("reversal error (backlash) of X");
    assert_eq!(play["significant"], true, "{play}");
    assert!((play["change"].as_f64().unwrap() - 4.0).abs() < 0.4, "{play}");
    assert_eq!(json["conformity"]["g_bi_um"]["verdict"], "conformity");
    assert_eq!(json["conformity"]["fmin_um"]["verdict"], "uncertainty-not-stated");
    let page = read(d, "b.html");
    let text = words(&page);
    holds(
        &text,
        &[
            "ISO 230-4:2022",
            "bidirectional circular error G(b)",
            "Largest cause: squareness error of X to Y",
            "align the guideways, or compensate the axis-to-axis error",
            "reversal compensation",
            "days since 2026-01-12",
            "2026-02-10",
            "changed",
            "within U",
            "counter-clockwise",
            "at 1000 mm/min",
            "at 3000 mm/min",
        ],
    );
    let minus_zero =
        |w: &str| w.starts_with('-') && w.len() > 1 && w.trim_matches(['-', '0', '.']).is_empty();
    assert!(!page.contains("NaN") && !text.split([' ', '(']).any(minus_zero), "{text}");
    assert!(text.contains("feed 1000 mm/min"), "{text}");
    // one test has no trend; days for some tests only are refused
    ok(d, &["evaluate", "ballbar", "--data", "jan.csv", "--radius-mm", "150", "--report", "one.html"]);
    assert!(!words(&read(d, "one.html")).contains("Trend"));
    let mixed =
        ["evaluate", "ballbar", "--data", "2026-01-12=jan.csv", "--data", "feb.csv", "--radius-mm", "150"];
    holds(&refused(d, 64, &mixed), &["give it for all"]);
}

#[test]
fn a_model_report_states_what_a_compensation_documents() {
    let folder = tempfile::tempdir().unwrap();
    let d = folder.path();
    let example = |name: &str| format!("{}/config/examples/vmc-850/{name}", env!("CARGO_MANIFEST_DIR"));
    positioning(d, "after.csv", 11, 0.2);
    positioning(d, "before.csv", 11, 3.0);
    std::fs::write(d.join("head.toml"), HEAD).unwrap();
    let verified = ok(d, &["verify", "--before", "before.csv", "--after", "after.csv", "--json"]);
    std::fs::write(d.join("x.json"), verified).unwrap();
    let (model, machine) = (example("model.toml"), example("machine.toml"));
    let args = [
        "model",
        "report",
        &model,
        "--config",
        &machine,
        "--head",
        "head.toml",
        "--validation",
        "x.json",
        "--html",
        "m.html",
        "--json",
    ];
    let json: Value = serde_json::from_str(&ok(d, &args)).unwrap();
    assert_eq!(json["covered"].as_array().unwrap().len(), 21);
    assert_eq!(json["without_function"], serde_json::json!([]));
    assert_eq!(json["re_check"], "2027-03-12");
    holds(
        &words(&read(d, "m.html")),
        &[
            "ISO/TR 16907:2015",
            "21 of 21",
            "EXX positioning Chebyshev degree",
            "EBZ yaw",
            "EC0Y squareness constant everywhere",
            "extrapolation none: outside the range",
            "backlash of X",
            "body diagonals 2026-03-13",
            "60.00 to 8.50 µm",
            "iso230-2, x.json",
            "warping of the table under load",
            "orientation of the tool",
            "limits of the correction X 150 µm",
            "re-check 2027-03-12",
            "blake3",
        ],
    );
    // what nothing states is said, and a part of a model names what is missing
    let part = "format = \"volcomp-model/1\"\nmachine = \"m\"\nchain = \"[w b X Y t]\"\n[errors.exx.table]\n\
                position-mm = [0, 50, 100]\nvalue-um = [0, 4, 1]\n";
    std::fs::write(d.join("part.toml"), part).unwrap();
    ok(d, &["model", "report", "part.toml", "--html", "part.html"]);
    holds(
        &words(&read(d, "part.html")),
        &[
            "1 of 13",
            "table, 3 points every 50 mm, linear",
            "without a function: EYX",
            "stay active not stated",
            "Validation not stated",
            "re-check not stated",
        ],
    );
    // 10 um over 500 mm is an angle of 20 urad about Z, whatever curve holds it
    let slope = "format = \"volcomp-model/1\"\nmachine = \"m\"\nchain = \"[w b X Y t]\"\n[errors.exy.table]\n\
                 position-mm = [0, 500]\nvalue-um = [0, 10]\n[axes.y]\ntravel-mm = [0, 500]\n";
    std::fs::write(d.join("slope.toml"), slope).unwrap();
    ok(d, &["model", "report", "slope.toml", "--html", "slope.html"]);
    holds(
        &words(&read(d, "slope.html")),
        &["compensated as slopes or offsets of other curves: EC0Y -4.13 arcsec"],
    );
    let other = ["model", "report", "part.toml", "--config", &machine, "--html", "x.html"];
    holds(&refused(d, 78, &other), &["the model is of machine m, the machine file of vmc-850"]);
}

/// The pages of a report as Chromium prints it, as text.
#[cfg(all(tool_chromium, tool_pdftotext))]
fn printed(folder: &Path, page: &str) -> Vec<String> {
    let status = Command::new("chromium")
        .args(["--headless", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--no-first-run"])
        .args(["--disable-background-networking", "--print-to-pdf=out.pdf", "--no-pdf-header-footer"])
        .arg(format!("--user-data-dir={}", folder.join("profile").display()))
        .arg(format!("file://{}", folder.join(page).display()))
        .current_dir(folder)
        .stderr(std::process::Stdio::null())
        .status()
        .unwrap();
    assert!(status.success());
    let text =
        Command::new("pdftotext").args(["-layout", "out.pdf", "-"]).current_dir(folder).output().unwrap();
    let text = String::from_utf8(text.stdout).unwrap();
    text.split('\u{c}').filter(|p| !p.trim().is_empty()).map(str::to_owned).collect()
}

#[test]
#[cfg_attr(not(all(tool_chromium, tool_pdftotext)), ignore = "needs chromium and pdftotext")]
fn printed_reports_cut_no_table_and_number_their_pages() {
    #[cfg(all(tool_chromium, tool_pdftotext))]
    {
        let folder = tempfile::tempdir().unwrap();
        let d = folder.path();
        std::fs::write(d.join("head.toml"), HEAD).unwrap();
        for (targets, title) in [(11u32, "short"), (70, "long")] {
            positioning(d, "after.csv", targets, 1.0);
            positioning(d, "before.csv", targets, 3.0);
            let args = ["evaluate", "iso230-2", "--data", "after.csv", "--before", "before.csv"];
            let more = ["--head", "head.toml", "--u-device-um", "1", "--title", title, "--html", "r.html"];
            ok(d, &[&args[..], &more].concat());
            let pages = printed(d, "r.html");
            for (k, page) in pages.iter().enumerate() {
                let number = format!("page {} of {}", k + 1, pages.len());
                assert!(page.contains(&number) && page.contains(title), "{number}: {page}");
                // a row of targets stands below a head, on every sheet
                let target = |l: &&str| {
                    let mut cells = l.split_whitespace();
                    let first = cells.next().and_then(|c| c.parse::<f64>().ok());
                    first.is_some_and(|t| t % 50.0 == 0.0) && cells.filter(|c| c.contains('.')).count() == 7
                };
                let rows = page.lines().filter(target).count();
                let heads = page.lines().filter(|l| l.contains("mean forward")).count();
                assert!(rows == 0 || heads > 0, "rows without a head: {page}");
                if targets == 11 {
                    assert_eq!(rows % 11, 0, "a table is cut: {page}");
                }
            }
            holds(&pages[0], &["Non-conformity", "D-K-1234", "A. Meister", "60 min, X at 10 m/min"]);
            holds(pages.last().unwrap(), &["Accepted by (name, signature)"]);
        }
        let example = |name: &str| format!("{}/config/examples/vmc-850/{name}", env!("CARGO_MANIFEST_DIR"));
        let (model, machine) = (example("model.toml"), example("machine.toml"));
        ok(d, &["model", "report", &model, "--config", &machine, "--head", "head.toml", "--html", "m.html"]);
        let pages = printed(d, "m.html");
        // the documentation is one sheet, the picture of the volume another one
        assert_eq!(pages.len(), 2, "{pages:?}");
        holds(&pages[0], &["EXX", "EA0Z", "re-check", "Accepted by"]);
        // both circles and the signatures stand on one sheet
        circles(d, "before.csv", 3.0);
        circles(d, "after.csv", 0.5);
        let feed = ["--feed-mm-per-min", "1000", "--radius-mm", "150"];
        let args = ["verify", "--before", "before.csv", "--after", "after.csv", "--report", "v.html"];
        ok(d, &[&args[..], &feed].concat());
        let pages = printed(d, "v.html");
        assert_eq!(pages.len(), 2, "{pages:?}");
        holds(&pages[1], &["Before", "After, same scale", "Accepted by"]);
    }
}

#[test]
fn help_is_wrapped_once() {
    let folder = tempfile::tempdir().unwrap();
    for method in ["ballbar", "kalman", "fits", "grinder", "probe"] {
        let help = ok(folder.path(), &["identify", method, "--help"]);
        let about = help.split("Usage:").next().unwrap();
        // a line that is broken by hand ends early, and the next one begins in the middle of the sentence
        let lines: Vec<&str> = about.lines().collect();
        for pair in lines.windows(2) {
            let continued = pair[1].starts_with(|c: char| c.is_ascii_lowercase()) && !pair[0].is_empty();
            let next = pair[1].split(' ').next().unwrap().len();
            assert!(!continued || pair[0].len() + 1 + next > 70, "{method}: {pair:?}");
        }
    }
}

#[test]
fn what_no_axis_has_is_noted_once() {
    let folder = tempfile::tempdir().unwrap();
    let machine = concat!(env!("CARGO_MANIFEST_DIR"), "/config/examples/vmc-850/machine.toml");
    let text = ok(folder.path(), &["check", machine]);
    assert_eq!(text.matches("soft-limit-mm").count(), 1, "{text}");
    assert!(text.contains("no soft-limit-mm for X, Y, Z"), "{text}");
}
