//! `volcomp diagnose` from the outside: files in, report, page and addition out, key by key (`docs/reference/session-files.md`); bad
//! input one by one.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
#![expect(clippy::disallowed_methods, reason = "the test writes and reads files")]

use std::fmt::Write as _;
use std::path::Path;
use std::process::{Command, Output, Stdio};

use crate::page::is_a_page;
use crate::support::{Campaign, NOISE, Noise, State, raw, rpm, temperatures};
use serde_json::Value;
use volcomp::diagnose::session::Raw;

const MODEL: &str = r#"
format = "volcomp-model/1"
machine = "test"
chain = "[w C' X' b Y Z t]"
[frame]
workpiece-origin-mm = [0, 0, 0]
tool-tip-mm = [0, 0, 0]
gauge-point-mm = [0, 0, 0]
[axes.x]
travel-mm = [-200, 700]
[axes.y]
travel-mm = [-200, 700]
[axes.z]
travel-mm = [-200, 700]
[axes.c]
travel-deg = [-360, 360]
point-mm = [250, 200, 0]
[errors.eyy.table]
position-mm = [-200, 700]
value-um = [-6, 21]
"#;

/// What the model knows, and a lost motion of 5 um that it does not.
fn truth(s: &State) -> [f64; 3] {
    [-2.5 * s.dir[0], 0.03 * s.p[1], 0.0]
}

fn csv(raw: &Raw) -> String {
    let mut text = format!("instrument,{}\n", raw.names.join(","));
    for i in 0..raw.len() {
        text.push_str(&raw.instruments[i]);
        for c in &raw.columns {
            if c[i].is_finite() {
                write!(text, ",{:.9}", c[i]).unwrap();
            } else {
                text.push(',');
            }
        }
        text.push('\n');
    }
    text
}

fn log() -> String {
    let mut text = "t_s,spindle_rpm,temp_x_degc,temp_spindle_degc,temp_ambient_degc\n".to_owned();
    for k in 0..800 {
        let t = f64::from(k) * 30.0;
        let [x, spindle, ambient] = temperatures(t);
        writeln!(text, "{t},{},{x:.4},{spindle:.4},{ambient:.4}", rpm(t)).unwrap();
    }
    text
}

fn volcomp(directory: &Path, args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_volcomp"))
        .current_dir(directory)
        .args(args)
        .stdin(Stdio::null())
        .output()
        .unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

fn number(v: &Value, key: &str) -> f64 {
    v[key].as_f64().unwrap_or_else(|| panic!("{key} is no number in {v}"))
}

fn places(v: &Value) {
    const BY: [&str; 11] = [
        "axis",
        "direction",
        "position",
        "speed",
        "acceleration",
        "time",
        "temperature",
        "tool-length",
        "instrument",
        "setup",
        "column",
    ];
    for p in v.as_array().unwrap() {
        assert!(BY.contains(&p["by"].as_str().unwrap()), "{p}");
        assert!(p["of"].is_string() && p["detail"].is_string(), "{p}");
        assert!((0.0..=1.0).contains(&number(p, "share")), "{p}");
    }
}

/// Every key of `docs/reference/session-files.md` 4.
fn is_a_report(r: &Value) {
    assert_eq!(r["format"], "volcomp-gap/1");
    assert!(r["rows"].as_u64().unwrap() > 0);
    let verdict = r["verdict"].as_str().unwrap();
    assert!(["explained", "partly-explained", "unexplained", "no-gap"].contains(&verdict), "{verdict}");
    let gap = &r["gap"];
    assert!((number(gap, "rms_um") / number(gap, "noise_um") - number(gap, "rms_over_noise")).abs() < 1e-9);
    places(&r["where"]);
    let mut before = f64::INFINITY;
    for c in r["causes"].as_array().unwrap() {
        assert!(c["effect"].is_string() && c["subject"].is_string() && c["declared"].is_boolean(), "{c}");
        assert!(["machine", "instrument", "stochastic"].contains(&c["kind"].as_str().unwrap()), "{c}");
        let p = number(c, "probability");
        assert!((0.0..=1.0).contains(&p) && p <= before, "sorted by probability: {c}");
        before = p;
        assert!(c["confounded_with"].as_array().unwrap().iter().all(Value::is_string), "{c}");
        for (name, v) in c["parameters"].as_object().unwrap() {
            assert!(name.contains('_') && v["value"].is_number() && v["std"].is_number(), "{name}: {v}");
        }
        assert!(c["shrink"].is_number(), "{c}");
    }
    let s = &r["shrink"];
    let fraction = 1.0 - number(s, "rms_after_um") / number(s, "rms_before_um");
    assert!((fraction - number(s, "fraction")).abs() < 1e-6, "{s}");
    let ci: Vec<f64> = s["ci90"].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect();
    assert!(ci.len() == 2 && ci[0] <= fraction && fraction <= ci[1] && s["how"].is_string(), "{s}");
    let u = &r["unexplained"];
    assert!(u["significant"].is_boolean() && u["rms_um"].is_number() && u["looks_like"].is_string(), "{u}");
    places(&u["where"]);
    for n in r["next_measurement"].as_array().unwrap() {
        assert!(
            n["do"].is_string() && n["separates"].as_array().unwrap().iter().all(Value::is_string),
            "{n}"
        );
    }
}

/// Labels declared, of a report as JSON.
pub(crate) fn declared(r: &Value) -> Vec<String> {
    let all = r["causes"].as_array().unwrap();
    let label = |c: &Value| format!("{}:{}", c["effect"].as_str().unwrap(), c["subject"].as_str().unwrap());
    all.iter().filter(|c| c["declared"] == true).map(label).collect()
}

#[test]
fn a_session_becomes_a_report_a_page_and_an_addition() {
    let directory = tempfile::tempdir().unwrap();
    let d = directory.path();
    let campaign = Campaign::full();
    std::fs::write(d.join("m.toml"), MODEL).unwrap();
    std::fs::write(d.join("s.csv"), csv(&raw(&campaign, &truth, NOISE))).unwrap();
    std::fs::write(d.join("f.csv"), csv(&raw(&campaign, &truth, Noise { seed: 7, ..NOISE }))).unwrap();
    std::fs::write(d.join("h.csv"), log()).unwrap();
    let args = ["diagnose", "--model", "m.toml", "--data", "s.csv", "--history", "h.csv", "--fresh", "f.csv"];
    let first = volcomp(d, &[&args[..], &["--out", "a", "--json"]].concat());
    assert!(first.status.success(), "{}", text(&first.stderr));
    let read = |name: &str| std::fs::read_to_string(d.join(name)).unwrap();
    let r: Value = serde_json::from_str(&text(&first.stdout)).unwrap();
    assert_eq!(r, serde_json::from_str::<Value>(&read("a/report.json")).unwrap());
    is_a_report(&r);
    assert_eq!(declared(&r), ["backlash:x"], "{r:#}");
    let width = number(&r["causes"][0]["parameters"]["width_um"], "value");
    assert!((width - 5.0).abs() < 0.3, "{width}");
    assert_eq!(r["verdict"], "explained");
    let (seen, ci) = (number(&r["fresh"], "fraction"), &r["shrink"]["ci90"]);
    assert!(seen >= ci[0].as_f64().unwrap() && seen <= ci[1].as_f64().unwrap(), "{seen} in {ci}");
    let charts = is_a_page(&read("a/report.html"), &r);
    // backlash, measured against predicted, residual over time and four axes
    assert!(charts >= 7, "{charts}");
    // the same input gives the same bytes
    let again = volcomp(d, &[&args[..], &["--out", "b"]].concat());
    assert!(again.status.success(), "{}", text(&again.stderr));
    for name in ["report.json", "report.html", "addition.toml"] {
        assert_eq!(read(&format!("a/{name}")), read(&format!("b/{name}")), "{name}");
    }
    // the addition closes the gap, as a prediction and in the next diagnosis
    std::fs::write(d.join("p.csv"), "x_mm,y_mm,dir_x,since_reversal_x_mm\n100,0,1,90\n100,0,-1,90\n")
        .unwrap();
    let p = volcomp(
        d,
        &["predict", "--model", "m.toml", "--add", "a/addition.toml", "--points", "p.csv", "--out", "e.csv"],
    );
    assert!(p.status.success(), "{}", text(&p.stderr));
    let table = read("e.csv");
    let mut lines = table.lines();
    let at = lines.next().unwrap().split(',').position(|c| c == "dx_um").unwrap();
    let dx: Vec<f64> = lines.map(|l| l.split(',').nth(at).unwrap().parse().unwrap()).collect();
    assert!((dx[1] - dx[0] - width).abs() < 1e-3, "{dx:?}");
    let closed = volcomp(d, &[&args[..], &["--add", "a/addition.toml", "--out", "c", "--json"]].concat());
    let c: Value = serde_json::from_str(&text(&closed.stdout)).unwrap();
    assert_eq!(c["verdict"], "no-gap", "{c:#}");
}

/// A line of X up and down, twice, with one change.
fn line(change: &dyn Fn(usize, &mut Vec<String>)) -> String {
    let mut text = "t_s,instrument,setup,run,repeat,x_mm,u_x,u_y,u_z,deviation_um\n".to_owned();
    for n in 0..80usize {
        let (repeat, k) = (n / 40, n % 40);
        let x = 20.0 * if k < 20 { k as f64 } else { (39 - k) as f64 };
        let d = (n as f64 * 2.399).sin();
        let mut row: Vec<String> = format!("{},laser,1,{},{},{x},1,0,0,{d:.4}", 5 * n, n / 20, repeat)
            .split(',')
            .map(str::to_owned)
            .collect();
        change(n, &mut row);
        if !row.is_empty() {
            writeln!(text, "{}", row.join(",")).unwrap();
        }
    }
    text
}

#[test]
fn bad_input_is_refused_with_its_place_and_a_remedy() {
    let directory = tempfile::tempdir().unwrap();
    let d = directory.path();
    let refused = |content: String| {
        std::fs::write(d.join("s.csv"), content).unwrap();
        let done = volcomp(d, &["diagnose", "--data", "s.csv", "--out", "out"]);
        assert_eq!(done.status.code(), Some(65), "{}", text(&done.stderr));
        assert!(done.stdout.is_empty() && !d.join("out").exists(), "nothing is written");
        text(&done.stderr)
    };
    let set = |column: usize, value: &'static str| {
        move |n: usize, row: &mut Vec<String>| {
            if n == 30 {
                row[column] = value.to_owned();
            }
        }
    };
    for (wanted, content) in [
        ("s.csv:32: t_s goes back from 145 s to 3 s", line(&set(0, "3"))),
        ("s.csv:32", line(&set(9, "nan"))),
        ("s.csv:32: x_mm is empty", line(&set(5, ""))),
        ("every deviation_um is 0; nothing was measured", line(&|_, r| r[9] = "0".to_owned())),
        (
            "are these mm? the column is in µm",
            line(&|n, r| r[9] = format!("{}", 1e-3 * (n as f64 * 2.399).sin())),
        ),
        (
            "10 usable readings, at least 20 are needed",
            line(&|n, r| {
                if n >= 10 {
                    r.clear();
                }
            }),
        ),
        ("column repeat is missing; number the repetitions", line(&|_, _| {}).replace("repeat", "again")),
        ("no data rows", line(&|_, r| r.clear())),
    ] {
        let said = refused(content);
        assert!(said.contains(wanted), "{wanted}: {said}");
    }
}

#[test]
fn what_is_missing_is_named_and_nothing_is_made_of_noise() {
    let directory = tempfile::tempdir().unwrap();
    let d = directory.path();
    // every fifth row twice, one reading lost, a temperature that never changes
    let content = line(&|n, r| {
        r[9] = if n == 7 { String::new() } else { r[9].clone() };
    });
    let mut rows: Vec<String> = Vec::new();
    for (n, l) in content.lines().enumerate() {
        let l = format!("{l},{}", if n == 0 { "temp_air_degc" } else { "20" });
        rows.push(l.clone());
        if n % 5 == 4 {
            rows.push(l);
        }
    }
    std::fs::write(d.join("s.csv"), rows.join("\n")).unwrap();
    let done = volcomp(d, &["diagnose", "--data", "s.csv", "--out", "out", "--json"]);
    assert!(done.status.success(), "{}", text(&done.stderr));
    let r: Value = serde_json::from_slice(&done.stdout).unwrap();
    is_a_report(&r);
    assert!(declared(&r).is_empty() && r["verdict"] == "no-gap", "{r:#}");
    let page = std::fs::read_to_string(d.join("out/report.html")).unwrap();
    assert_eq!(is_a_page(&page, &r), 2, "the gap over time and x");
    let notes = r["notes"].to_string();
    for wanted in [
        "1 of 96 readings are lost",
        "rows were there twice and count once",
        "one set-up only",
        "cannot be identified from them: reversal-spike:x",
    ] {
        assert!(notes.contains(wanted), "{wanted}: {notes}");
    }
    let unseen = r["cannot_be_seen"].to_string();
    for wanted in ["no temperature that changes by 0.2 K", "one tool length only", "no force is logged"] {
        assert!(unseen.contains(wanted), "{wanted}: {unseen}");
    }
}

#[test]
fn a_small_session_gets_a_short_page_and_programs_for_its_control() {
    let directory = tempfile::tempdir().unwrap();
    let d = directory.path();
    // nine positions, to and fro, five times, with play that no two positions share
    let mut rows = "t_s,instrument,setup,run,repeat,x_mm,u_x,u_y,u_z,deviation_um,dir_x\n".to_owned();
    for n in 0..90usize {
        let (cycle, k) = (n / 18, n % 18);
        let (at, way) = if k < 9 { (k, 1) } else { (17 - k, -1) };
        let play = 6.0 + 3.0 * (at as f64 * 1.7).sin();
        let deviation = 0.4 * (n as f64 * 2.399).sin() - 0.5 * play * f64::from(way);
        writeln!(rows, "{},laser,1,{cycle},{cycle},{},1,0,0,{deviation:.4},{way}", 20 * n, 60 * at).unwrap();
    }
    std::fs::write(d.join("s.csv"), rows).unwrap();
    let done = volcomp(d, &["diagnose", "--data", "s.csv", "--out", "out", "--dialect", "fanuc", "--json"]);
    assert!(done.status.success(), "{}", text(&done.stderr));
    let r: Value = serde_json::from_slice(&done.stdout).unwrap();
    is_a_report(&r);
    let page = std::fs::read_to_string(d.join("out/report.html")).unwrap();
    assert!(is_a_page(&page, &r) >= 2);
    let programs: Vec<&str> =
        r["next_measurement"].as_array().unwrap().iter().map(|n| n["gcode"].as_str().unwrap()).collect();
    let moving: Vec<&&str> = programs.iter().filter(|p| p.contains("G1 X")).collect();
    assert!(!moving.is_empty(), "{programs:?}");
    for program in moving {
        assert!(program.contains("dialect Fanuc: G4 P in milliseconds"), "{program}");
        assert!(!program.contains("G4 P3\n") && !program.contains("G4 P1\n"), "{program}");
    }
    for n in r["next_measurement"].as_array().unwrap() {
        assert!(n["minutes"].as_f64().unwrap() >= 1.0 && !n["decides"].as_str().unwrap().is_empty(), "{n}");
    }
    let other = volcomp(d, &["diagnose", "--data", "s.csv", "--out", "out", "--dialect", "basic"]);
    assert!(
        text(&other.stderr).contains("expected one of linuxcnc, fanuc, sinumerik"),
        "{}",
        text(&other.stderr)
    );
}

#[test]
fn an_effect_to_leave_out_must_be_one() {
    let directory = tempfile::tempdir().unwrap();
    let d = directory.path();
    std::fs::write(d.join("s.csv"), line(&|_, _| {})).unwrap();
    for (label, wanted) in [
        ("backlash:q", "backlash has no subject 'q'; its subjects are: x, y, z, a, b, c"),
        ("spindle-growth:x", "its subjects are: none"),
        ("nope", "unknown effect 'nope'"),
    ] {
        let done = volcomp(d, &["diagnose", "--data", "s.csv", "--plan", "--without", label]);
        let said = text(&done.stderr);
        assert!(done.status.code() == Some(64) && said.contains(wanted), "{label}: {said}");
    }
    let done = volcomp(d, &["diagnose", "--data", "s.csv", "--plan", "--without", "scale:x"]);
    assert!(done.status.success() && !text(&done.stdout).contains("scale:x"), "{}", text(&done.stdout));
}

#[test]
fn a_file_given_twice_is_refused() {
    let directory = tempfile::tempdir().unwrap();
    let d = directory.path();
    std::fs::write(d.join("s.csv"), line(&|_, _| {})).unwrap();
    let done = volcomp(d, &["diagnose", "--data", "s.csv", "--data", "s.csv", "--out", "out"]);
    let said = text(&done.stderr);
    assert!(done.status.code() == Some(65) && said.contains("leave s.csv out"), "{said}");
}

#[test]
fn rotary_axes_need_a_chain() {
    let directory = tempfile::tempdir().unwrap();
    let d = directory.path();
    std::fs::write(d.join("m.toml"), MODEL).unwrap();
    let other = MODEL.replace("w C' X' b Y Z t", "w X' b Y Z t");
    let other: Vec<&str> = other
        .lines()
        .filter(|l| !["axes.c", "-360", "point-mm = [250"].iter().any(|w| l.contains(w)))
        .collect();
    std::fs::write(d.join("o.toml"), other.join("\n")).unwrap();
    let turning: Vec<String> = line(&|_, _| {})
        .lines()
        .enumerate()
        .map(|(n, l)| if n == 0 { format!("{l},c_deg") } else { format!("{l},{}", (7 * n) % 300) })
        .collect();
    std::fs::write(d.join("s.csv"), turning.join("\n")).unwrap();
    for (model, wanted) in [
        (&[][..], "s.csv: axis c turns, and nothing says where it stands in the chain; give the model"),
        (&["--model", "o.toml"][..], "axis c turns, but the chain of test has no such axis"),
    ] {
        let done = volcomp(d, &[&["diagnose", "--data", "s.csv", "--out", "out"], model].concat());
        let said = text(&done.stderr);
        assert!(done.status.code() == Some(65) && said.contains(wanted), "{said}");
    }
    let done = volcomp(d, &["diagnose", "--data", "s.csv", "--plan", "--model", "m.toml"]);
    assert!(done.status.success(), "{}", text(&done.stderr));
}

#[test]
fn positions_outside_the_travel_of_the_model_ask_for_the_right_model() {
    let directory = tempfile::tempdir().unwrap();
    let d = directory.path();
    std::fs::write(d.join("m.toml"), MODEL).unwrap();
    std::fs::write(
        d.join("o.toml"),
        MODEL.replace("[axes.x]\ntravel-mm = [-200, 700]", "[axes.x]\ntravel-mm = [0, 90]"),
    )
    .unwrap();
    std::fs::write(d.join("s.csv"), line(&|_, _| {})).unwrap();
    let said = |model: &str| {
        let done = volcomp(d, &["diagnose", "--data", "s.csv", "--model", model]);
        assert!(done.status.success(), "{}", text(&done.stderr));
        text(&done.stdout)
    };
    let wanted = "the travel of the model is 0.0 to 90.0 mm: is it the model of this machine?";
    assert!(said("o.toml").contains(wanted), "{}", said("o.toml"));
    assert!(!said("m.toml").contains("the travel of the model is"));
}

/// An addition of one effect with one value each.
fn addition(machine: &str, name: &str, shape: volcomp::diagnose::library::Shape) -> String {
    use volcomp::diagnose::addition::{Addition, Entry, FORMAT};
    let names = shape.parameters();
    let n = names.len();
    let entry = Entry {
        name: name.to_owned(),
        subject: String::new(),
        kind: volcomp::diagnose::library::Kind::Machine,
        probability: 0.9,
        confounded_with: Vec::new(),
        values: vec![1.0; n],
        covariance: vec![vec![0.0; n]; n],
        parameter_names: names,
        valid: std::collections::BTreeMap::new(),
        shape,
    };
    let effects = vec![entry];
    let sense = "actual minus nominal".to_owned();
    toml::to_string(&Addition {
        format: FORMAT.to_owned(),
        machine: machine.to_owned(),
        sense,
        base: None,
        effects,
    })
    .unwrap()
}

#[test]
fn an_addition_needs_its_columns_and_its_machine() {
    use volcomp::diagnose::library::{Shape, forms};
    let directory = tempfile::tempdir().unwrap();
    let d = directory.path();
    // a model without a gauge point: it says nothing of tool lengths, the addition does
    std::fs::write(d.join("m.toml"), MODEL.replace("gauge-point-mm = [0, 0, 0]\n", "")).unwrap();
    std::fs::write(d.join("s.csv"), line(&|_, _| {})).unwrap();
    std::fs::write(
        d.join("tilt.toml"),
        addition("test", "spindle-tilt", Shape::SpindleTilt(forms::SpindleTilt {})),
    )
    .unwrap();
    std::fs::write(
        d.join("other.toml"),
        addition("other-9", "spindle-tilt", Shape::SpindleTilt(forms::SpindleTilt {})),
    )
    .unwrap();
    let with = |add: &str| {
        let args = ["diagnose", "--data", "s.csv", "--model", "m.toml", "--add", add, "--out", "out"];
        let done = volcomp(d, &args);
        (done.status.code(), text(&done.stderr))
    };
    let (code, said) = with("tilt.toml");
    assert!(
        code == Some(65) && said.contains("s.csv:2: effect spindle-tilt needs column tool_length_mm"),
        "{said}"
    );
    let (code, said) = with("other.toml");
    assert!(code == Some(78) && said.contains("found on machine 'other-9', the model is of 'test"), "{said}");
    std::fs::write(d.join("p.csv"), "x_mm,tool_length_mm\n0,0\n0,100\n").unwrap();
    let predict = |more: &[&str]| {
        let args = ["predict", "--model", "m.toml", "--points", "p.csv", "--out", "-"];
        volcomp(d, &[&args, more].concat())
    };
    let done = predict(&["--add", "tilt.toml"]);
    assert!(done.status.success(), "{}", text(&done.stderr));
    let dx: Vec<String> =
        text(&done.stdout).lines().skip(1).map(|l| l.split(',').nth(2).unwrap().to_owned()).collect();
    assert_ne!(dx[0], dx[1], "the tilt grows with the tool");
    // of a session file what is empty and what the effect does not ask for is not known, as for `diagnose`
    std::fs::write(
        d.join("p.csv"),
        "t_s,x_mm,dir_x,tool_length_mm,range_mm,target_x_mm,deviation_um\n0,0,0,0,,,1\n1,0,,100,,,1\n2,0,1,,,,1\n",
    )
    .unwrap();
    let done = predict(&["--add", "tilt.toml"]);
    let said = text(&done.stderr);
    assert_eq!(done.status.code(), Some(65));
    assert!(said.contains("p.csv:4: effect spindle-tilt needs column tool_length_mm"), "{said}");
    let done = predict(&[]);
    assert!(done.status.success() && text(&done.stderr).contains("the lengths are not used"));
    std::fs::write(d.join("p.csv"), "x_mm,tool_length_mm\n0,0\n0,100\n").unwrap();
    let said = text(&predict(&[]).stderr);
    assert!(said.contains("the model has no gauge point"), "{said}");
}

#[test]
fn an_addition_found_beside_another_model_of_the_machine_is_noted() {
    use volcomp::diagnose::library::{Shape, forms};
    let directory = tempfile::tempdir().unwrap();
    let d = directory.path();
    std::fs::write(d.join("m.toml"), MODEL).unwrap();
    std::fs::write(d.join("s.csv"), line(&|_, _| {})).unwrap();
    std::fs::write(d.join("p.csv"), "x_mm,tool_length_mm\n0,100\n").unwrap();
    let tilt = addition("test", "spindle-tilt", Shape::SpindleTilt(forms::SpindleTilt {}));
    let beside = |hash: &str| {
        let text = tilt.replacen(
            "[[effect]]",
            &format!("[base]\nfile = \"m.toml\"\nhash = \"{hash}\"\n\n[[effect]]"),
            1,
        );
        std::fs::write(d.join("tilt.toml"), text).unwrap();
    };
    let warned = |args: &[&str]| {
        text(&volcomp(d, args).stderr).contains("what was put into it since then would count twice")
    };
    let predict = ["predict", "--model", "m.toml", "--points", "p.csv", "--out", "-", "--add", "tilt.toml"];
    let diagnose = ["diagnose", "--data", "s.csv", "--model", "m.toml", "--add", "tilt.toml"];
    for (hash, expected) in
        [(blake3::hash(MODEL.as_bytes()).to_hex().to_string(), false), ("0123".repeat(16), true)]
    {
        beside(&hash);
        assert_eq!((warned(&predict), warned(&diagnose)), (expected, expected), "{hash}");
    }
}

#[test]
fn a_log_on_another_clock_is_not_used() {
    const COLD: &str = "no temperature that changes by 0.2 K is logged";
    let directory = tempfile::tempdir().unwrap();
    let d = directory.path();
    std::fs::write(d.join("s.csv"), line(&|_, _| {})).unwrap();
    let log = |start: u32, warm: f64| {
        let rows: Vec<String> =
            (0..20).map(|k| format!("{},{},1", start + 20 * k, warm + 0.2 * f64::from(k))).collect();
        format!("t_s,temp_air_degc,load_x\n{}\n", rows.join("\n"))
    };
    std::fs::write(d.join("h.csv"), log(0, 20.0)).unwrap();
    std::fs::write(d.join("day2.csv"), log(86_400, 20.0)).unwrap();
    std::fs::write(d.join("same.csv"), log(10, 35.0)).unwrap();
    let with = |logs: &[&str]| {
        let logs: Vec<&str> = logs.iter().flat_map(|l| ["--history", l]).collect();
        volcomp(d, &[&["diagnose", "--data", "s.csv", "--plan"], &logs[..]].concat())
    };
    let said = text(&with(&["h.csv"]).stdout);
    assert!(said.contains("note: h.csv: load_x not used"), "{said}");
    assert!(!said.contains(COLD), "{said}");
    let said = text(&with(&["day2.csv"]).stdout);
    assert!(
        said.contains("day2.csv: temp_air_degc from 86400 to 86780 s does not touch the readings of s.csv"),
        "{said}"
    );
    assert!(said.contains(COLD), "{said}");
    let done = with(&["h.csv", "same.csv"]);
    let said = text(&done.stderr);
    assert!(
        done.status.code() == Some(65)
            && said.contains("same.csv: temp_air_degc at the same times as in h.csv")
            && said.contains("--fresh-history"),
        "{said}"
    );
    // of logs that contradict each other those beside the session are its own, whatever their order
    for (day, text) in
        [("day2", "t_s,temp_air_degc\n0,35\n200,35\n400,35\n".to_owned()), ("day3", log(10, 50.0))]
    {
        std::fs::create_dir(d.join(day)).unwrap();
        std::fs::write(d.join(day).join("log.csv"), text).unwrap();
    }
    for logs in [["day2/log.csv", "day3/log.csv", "./h.csv"], ["h.csv", "day3/log.csv", "day2/log.csv"]] {
        let done = with(&logs);
        assert!(done.status.success(), "{}", text(&done.stderr));
        let said = text(&done.stdout);
        assert!(!said.contains(COLD), "{said}");
        assert!(said.contains("day2/log.csv: temp_air_degc contradicts"), "{said}");
    }
    std::fs::copy(d.join("s.csv"), d.join("day2/s.csv")).unwrap();
    let args =
        ["diagnose", "--data", "day2/s.csv", "--plan", "--history", "h.csv", "--history", "day2/log.csv"];
    let said = text(&volcomp(d, &args).stdout);
    assert!(said.contains(COLD), "a day of one temperature: {said}");
    // rows know their own temperature
    let rows =
        line(&|_, r| r.push("25.0".to_owned())).replace("deviation_um\n", "deviation_um,temp_air_degc\n");
    std::fs::write(d.join("s.csv"), rows).unwrap();
    let said = text(&with(&["h.csv"]).stdout);
    assert!(said.contains("h.csv: temp_air_degc contradicts the rows of s.csv"), "{said}");
    assert!(said.contains("the log is not used there"), "{said}");
    assert!(said.contains(COLD), "{said}");
}

#[test]
fn fresh_data_of_another_day_have_a_log_of_their_own() {
    use volcomp::diagnose::library::{Shape, forms};
    use volcomp::diagnose::machine_state::{Axis, Source};
    use volcomp::effects::Signal;
    let directory = tempfile::tempdir().unwrap();
    let d = directory.path();
    let signal = Signal::of(Source::Temperature("air".to_owned()), 0.0);
    let shape =
        Shape::Thermal(forms::Thermal { axis: Axis::X, signal, reference_degc: 20.0, with_offset: false });
    std::fs::write(d.join("a.toml"), addition("test", "thermal-expansion", shape)).unwrap();
    // the two days have clocks that begin alike, and only their temperatures differ
    for (name, start) in [("cold", 20.0), ("warm", 60.0)] {
        let readings = line(&|n, r| {
            let [x, noise] = [5, 9].map(|c: usize| r[c].parse::<f64>().unwrap());
            r[9] = format!("{:.4}", noise + 1e-3 * x * (start + 0.05 * n as f64 - 20.0));
        });
        let log: Vec<String> =
            (0..41).map(|k| format!("{},{}", 10 * k, start + 0.1 * f64::from(k))).collect();
        std::fs::write(d.join(format!("{name}.csv")), readings).unwrap();
        std::fs::write(d.join(format!("{name}-log.csv")), format!("t_s,temp_air_degc\n{}\n", log.join("\n")))
            .unwrap();
    }
    let before = |more: &[&str]| {
        let args = ["diagnose", "--add", "a.toml", "--data", "cold.csv", "--history", "cold-log.csv"];
        let fresh = ["--fresh", "warm.csv", "--out", "out", "--json"];
        let done = volcomp(d, &[&args[..], &fresh, more].concat());
        assert!(done.status.success(), "{}", text(&done.stderr));
        number(&serde_json::from_str::<Value>(&text(&done.stdout)).unwrap()["fresh"], "rms_before_um")
    };
    let (own, other) = (before(&["--fresh-history", "warm-log.csv"]), before(&[]));
    assert!(own < 1.0 && other > 3.0, "the expansion of the day is known: {own}, {other}");
}
