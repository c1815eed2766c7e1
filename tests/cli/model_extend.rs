//! `volcomp model extend`: what a diagnosis has found becomes part of a model, on both sides of the bed, and nothing else
//! does.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
#![expect(clippy::disallowed_methods, reason = "the test writes and reads files")]

use std::path::Path;
use std::process::{Command, Output};

use volcomp::config::model::parse_file;
use volcomp::model::axes::{MAX_AXES, Travel};
use volcomp::model::{Model, Pose};

/// X carries the workpiece, Y and Z the tool; C turns the workpiece.
const MODEL: &str = r#"
format = "volcomp-model/1"
machine = "m"
chain = "[w C' X' b Y Z t]"
[frame]
tool-tip-mm = [0, 0, -100]
gauge-point-mm = [0, 0, 0]
[axes.x]
travel-mm = [0, 500]
[axes.y]
travel-mm = [0, 400]
[axes.z]
travel-mm = [-300, 0]
[axes.c]
travel-deg = [-180, 180]
point-mm = [250, 200, 0]
[errors.eyy.table]
position-mm = [0, 400]
value-um = [0, 8]
"#;

const VALID: &str = "x_mm = [0, 500]\ny_mm = [0, 400]\nz_mm = [-300, 0]\nc_deg = [-180, 180]\n\
                     temp_x_degc = [18, 26]\nspindle_rpm = [0, 12000]\n";

/// An entry of an addition.
fn effect(name: &str, subject: &str, values: &str, shape: &str) -> String {
    kind(name, subject, "machine", values, shape)
}

fn kind(name: &str, subject: &str, kind: &str, values: &str, shape: &str) -> String {
    let names = "\"p\", ".repeat(values.split(',').count());
    format!(
        "[[effect]]\nname = \"{name}\"\nsubject = \"{subject}\"\nkind = \"{kind}\"\nprobability = 0.99\n\
         confounded-with = []\nparameter-names = [{names}]\nvalues = [{values}]\ncovariance = []\n\
         [effect.valid]\n{VALID}[effect.shape]\n{shape}\n"
    )
}

fn addition(machine: &str, effects: &[String]) -> String {
    format!("format = \"volcomp-addition/1\"\nmachine = \"{machine}\"\nsense = \"\"\n{}", effects.concat())
}

fn volcomp(dir: &Path, args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_volcomp")).args(args).current_dir(dir).output().unwrap()
}

/// Extends the model; the model and what was said.
fn extended(effects: &[String]) -> (Model, String) {
    extended_from(MODEL, effects)
}

fn extended_from(model: &str, effects: &[String]) -> (Model, String) {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("m.toml"), model).unwrap();
    std::fs::write(dir.path().join("a.toml"), addition("m", effects)).unwrap();
    let out = volcomp(
        dir.path(),
        &["model", "extend", "--model", "m.toml", "--add", "a.toml", "--out", "n.toml", "--json"],
    );
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    let text = std::fs::read_to_string(dir.path().join("n.toml")).unwrap();
    let file = parse_file("n.toml", &text).unwrap();
    (Model::new(&file.spec).unwrap(), String::from_utf8(out.stdout).unwrap())
}

/// Deviation of the tool against the workpiece, um in W, at X Y Z (mm) and C (deg), all axes travelling alike.
fn deviation_um(model: &Model, [x, y, z, c]: [f64; 4], travel: Travel) -> [f64; 3] {
    let mut position = [0.0; MAX_AXES];
    for (k, axis) in model.axes().enumerate() {
        position[k] = match axis.name.letter() {
            'X' => x,
            'Y' => y,
            'Z' => z,
            _ => c.to_radians(),
        };
    }
    let d = model.deviation(&Pose { travel: [travel; MAX_AXES], ..Pose::at(position) }).position;
    [d.x * 1e3, d.y * 1e3, d.z * 1e3]
}

fn near(found: [f64; 3], expected: [f64; 3]) {
    let away = found.iter().zip(expected).map(|(f, e)| (f - e).abs()).fold(0.0, f64::max);
    assert!(away < 0.02, "{found:?}, expected {expected:?}");
}

#[test]
fn play_scale_and_squareness_stand_in_the_model_on_both_sides_of_the_bed() {
    let (model, said) = extended(&[
        effect(
            "backlash",
            "x",
            "5",
            "form = \"backlash\"\naxis = \"x\"\nalong = [\"x\"]\nlength-mm = 0\nslope = false",
        ),
        effect(
            "backlash",
            "y",
            "-4",
            // what circles show: crossed over its own width
            "form = \"backlash\"\naxis = \"y\"\nalong = [\"y\"]\nlength-mm = 0.004\nslope = false\nplay = true",
        ),
        effect("scale", "x", "10", "form = \"scale\"\naxis = \"x\""),
        effect("scale", "y", "-20", "form = \"scale\"\naxis = \"y\""),
        effect("squareness", "xy", "3", "form = \"squareness\"\nalong = \"x\"\nover = \"y\""),
    ]);
    assert!(!said.contains("\"taken\": false"), "{said}");
    // the table of EYY says 2 um per 100 mm; -w/2 in the direction of travel; ppm; 3 arcsec over Y
    let lean_um = 3.0 * 200.0 * std::f64::consts::PI / 648.0;
    let at = [300.0, 200.0, -50.0, 0.0];
    let forward = [10e-3 * 300.0 - 2.5 + lean_um, 4.0 - 20e-3 * 200.0 + 2.0, 0.0];
    let reverse = [forward[0] + 5.0, forward[1] - 4.0, 0.0];
    near(deviation_um(&model, at, Travel::Forward), forward);
    near(deviation_um(&model, at, Travel::Reverse), reverse);
}

#[test]
fn waves_bends_and_leaning_carriages_become_curves() {
    let lever = "lever = { axes = [false, true, true], home-mm = [0, 0, -100], tool = false }";
    let (model, said) = extended(&[
        effect(
            "pitch-error",
            "y",
            "1, 2",
            "form = \"cyclic\"\naxis = \"y\"\nalong = \"y\"\npitch-mm = 10\nharmonics = 1",
        ),
        effect(
            "straightness",
            "ezy",
            "6",
            "form = \"polynomial\"\nalong = \"z\"\nover = \"y\"\nlow = 2\nhigh = 2\ncentre-mm = 200\nhalf-mm = 200",
        ),
        effect(
            "angular",
            "eax",
            "4",
            &format!("form = \"angular\"\nabout = \"a\"\nover = \"x\"\ndegree = 1\nhalf-mm = 500\n{lever}"),
        ),
    ]);
    assert!(!said.contains("\"taken\": false"), "{said}");
    let arcsec = std::f64::consts::PI / 648_000.0;
    for y in [3.0, 101.5, 200.0, 397.25] {
        let (x, z) = (250.0, -120.0);
        let phase = std::f64::consts::TAU * y / 10.0;
        let s: f64 = (y - 200.0) / 200.0;
        let tilt = 4.0 * arcsec * x / 500.0;
        // e x r with r to the tool tip: Y and Z carry the tool
        let turned = [-tilt * (z - 100.0) * 1e3, tilt * y * 1e3];
        let wave = phase.cos() - 1.0 + 2.0 * phase.sin();
        let bend = 6.0 * (1.5 * s * s - 0.5);
        let expected = [0.0, 2.0 * y / 100.0 + wave + turned[0], bend + turned[1]];
        let reference = [0.0, -0.0, bend - 6.0 * (1.5 * s * s - 0.5)];
        assert!(reference[2].abs() < 1e-9);
        near(deviation_um(&model, [x, y, z, 0.0], Travel::Forward), expected);
    }
}

#[test]
fn a_rough_curve_is_its_polynomial_and_a_table() {
    let beyond = |y: f64| if y < 100.0 { 0.01 * y } else { 2.0 - 0.01 * y };
    let list = |of: &dyn Fn(f64) -> f64| {
        (0..=80).map(|k| of(5.0 * f64::from(k)).to_string()).collect::<Vec<_>>().join(", ")
    };
    let shape = |positions: &dyn Fn(f64) -> f64| {
        format!(
            "form = \"rough-curve\"\npositions-mm = [{}]\nbeyond-um = [{}]\n[effect.shape.curve]\nform = \"polynomial\"\n\
             along = \"z\"\nover = \"y\"\nlow = 2\nhigh = 2\ncentre-mm = 200\nhalf-mm = 200",
            list(positions),
            list(&beyond)
        )
    };
    let (model, said) = extended(&[effect("straightness", "ezy", "6, 3", &shape(&|y| y))]);
    assert!(!said.contains("\"taken\": false"), "{said}");
    for y in [0.0, 62.5, 100.0, 250.0, 400.0] {
        let s: f64 = (y - 200.0) / 200.0;
        let expected = [0.0, 2.0 * y / 100.0, 6.0 * (1.5 * s * s - 0.5) + 3.0 * beyond(y)];
        near(deviation_um(&model, [250.0, y, -120.0, 0.0], Travel::Forward), expected);
    }
    // a table that goes back is refused
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("m.toml"), MODEL).unwrap();
    let back = effect("straightness", "ezy", "6, 3", &shape(&|y| -y));
    std::fs::write(dir.path().join("a.toml"), addition("m", &[back])).unwrap();
    let args = ["model", "extend", "--model", "m.toml", "--add", "a.toml", "--out", "n.toml"];
    let out = volcomp(dir.path(), &args);
    assert!(!out.status.success(), "{}", String::from_utf8_lossy(&out.stdout));
}

#[test]
fn tables_of_an_extended_model_go_to_a_control_and_back() {
    let dir = tempfile::tempdir().unwrap();
    let bow = "form = \"polynomial\"\nalong = \"y\"\nover = \"x\"\nlow = 2\nhigh = 2\ncentre-mm = 250\nhalf-mm = 250";
    let cosine = "form = \"cyclic\"\naxis = \"x\"\nalong = \"x\"\npitch-mm = 100\nharmonics = 1";
    let effects = [effect("straightness", "eyx", "-3", bow), effect("cyclic", "x", "2, 1", cosine)];
    std::fs::write(dir.path().join("m.toml"), MODEL).unwrap();
    std::fs::write(dir.path().join("a.toml"), addition("m", &effects)).unwrap();
    for args in [
        &["model", "extend", "--model", "m.toml", "--add", "a.toml", "--out", "n.toml"][..],
        &["export", "n.toml", "--format", "isg", "--axis", "x", "--sense", "relative", "--out", "x.isg"],
        &["import", "x.isg", "--chain", "[w C' X' b Y Z t]", "--sense", "relative", "--out", "back.toml"],
    ] {
        let out = volcomp(dir.path(), args);
        assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    }
    // the middle of the travel, where both tables have a point
    let text = std::fs::read_to_string(dir.path().join("n.toml")).unwrap();
    assert!(!text.contains("249.9999") && text.contains("250"), "{text}");
}

#[test]
fn degrees_and_constants_out_of_range_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("m.toml"), MODEL).unwrap();
    let polynomial = |low: i64, high: i64| {
        format!(
            "form = \"polynomial\"\nalong = \"z\"\nover = \"y\"\nlow = {low}\nhigh = {high}\ncentre-mm = 200\nhalf-mm = 200"
        )
    };
    let rough = |curve: &str| {
        format!(
            "form = \"rough-curve\"\npositions-mm = [0, 400]\nbeyond-um = [0, 1]\n[effect.shape.curve]\n{curve}"
        )
    };
    let cyclic =
        "form = \"cyclic\"\naxis = \"y\"\nalong = \"y\"\npitch-mm = 10\nharmonics = 9223372036854775807";
    let shapes = [
        polynomial(5, 2),
        polynomial(41, 60),
        cyclic.to_owned(),
        rough(&polynomial(5, 2)),
        rough(cyclic),
        rough(&rough(cyclic).replace("[effect.shape.curve]", "[effect.shape.curve.curve]")),
        rough(&polynomial(41, 60)),
        rough(&polynomial(2, 2)).replace("[0, 1]", "[0, nan]"),
        rough(&polynomial(2, 2)).replace("[0, 1]", "[0, 1, 2]"),
        rough("form = \"scale\"\naxis = \"y\""),
    ];
    for shape in shapes {
        std::fs::write(
            dir.path().join("a.toml"),
            addition("m", &[effect("straightness", "ezy", "6", &shape)]),
        )
        .unwrap();
        let args = ["model", "extend", "--model", "m.toml", "--add", "a.toml", "--out", "n.toml"];
        let out = volcomp(dir.path(), &args);
        let said = String::from_utf8_lossy(&out.stderr);
        // 101 is a panic
        assert!(!matches!(out.status.code(), Some(0 | 101) | None), "{shape}: {said}");
        assert!(said.contains("a.toml"), "{shape}: {said}");
    }
}

/// A Legendre polynomial of degree n has a slope of n (n + 1) / 2 at the ends of the data, n (n + 1) / 4 spacings of a
/// table with 200 equal ones.
#[test]
fn a_positioning_error_of_degree_thirteen_is_in_the_model_up_to_the_ends_of_the_data() {
    let values = [2.10, 3.51, -3.96, 0.82, -1.57, 3.67, 2.05, -3.53, -0.49, -1.98, 3.02, -2.04];
    let list = values.map(|v| v.to_string()).join(", ");
    let shape = "form = \"polynomial\"\nalong = \"y\"\nover = \"y\"\nlow = 2\nhigh = 13\ncentre-mm = 200\nhalf-mm = 200";
    let (model, said) = extended(&[effect("positioning", "y", &list, shape)]);
    assert!(!said.contains("\"taken\": false"), "{said}");
    let expected_um = |y: f64| {
        let s = (y - 200.0) / 200.0;
        let (mut before, mut here, mut sum) = (1.0, s, 0.0);
        for (n, value) in (2..).zip(values) {
            let n = f64::from(n);
            (before, here) = (here, ((2.0 * n - 1.0) * s * here - (n - 1.0) * before) / n);
            sum += value * here;
        }
        sum
    };
    let at = |y: f64| deviation_um(&model, [0.0, y, 0.0, 0.0], Travel::Forward)[1] - 0.02 * y;
    for k in 0..=4000 {
        let y = 0.1 * f64::from(k);
        let difference = at(y) - at(200.0) - (expected_um(y) - expected_um(200.0));
        assert!(difference.abs() < 0.05, "{difference} um at {y} mm");
    }
}

#[test]
fn what_turns_a_head_goes_through_the_lever_that_the_head_has() {
    // the model's own kinematics checks every entry: a lever that forgot the head would be refused
    let fork = r#"
format = "volcomp-model/1"
machine = "m"
chain = "[w b X Z Y C A t]"
[frame]
tool-tip-mm = [0, 0, -100]
gauge-point-mm = [0, 0, 0]
[axes.x]
travel-mm = [0, 500]
[axes.y]
travel-mm = [0, 400]
[axes.z]
travel-mm = [-300, 0]
[axes.c]
travel-deg = [-180, 180]
point-mm = [15, -5, 0]
[axes.a]
travel-deg = [-90, 90]
point-mm = [0, 0, 250]
"#;
    let lever = "lever = { axes = [false, true, true], home-mm = [0, 0, -100], tool = false }";
    let frame = "frame = { axis = \"c\", workpiece-side = false, point-mm = [15, -5, 0], outer = [], inner = [\"a\"], \
                 inner-points-mm = [[0, 0, 250]], tip-mm = [0, 0, -100], nose-mm = [0, 0, 0] }";
    let (_, said) = extended_from(
        fork,
        &[
            effect(
                "angular",
                "ebx",
                "4",
                &format!(
                    "form = \"angular\"\nabout = \"b\"\nover = \"x\"\ndegree = 1\nhalf-mm = 500\n{lever}"
                ),
            ),
            effect(
                "rotary-location",
                "c",
                "12, -7",
                &format!("form = \"rotary-location\"\ntied = true\n{frame}"),
            ),
        ],
    );
    assert!(!said.contains("\"taken\": false"), "{said}");
}

#[test]
fn heat_becomes_growths_that_sensors_tell() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("m.toml"), MODEL).unwrap();
    let effects = [
        effect(
            "thermal-expansion",
            "x",
            "11, 2",
            "form = \"thermal\"\naxis = \"x\"\nreference-degc = 20\nwith-offset = true\n\
             signal = { source = { temperature = \"x\" }, tau-s = 600 }",
        ),
        effect(
            "spindle-growth",
            "",
            "-3, 1.5",
            "form = \"growth\"\nalong = [\"y\", \"z\"]\nreference = 0\n\
             signals = [{ source = \"spindle\", tau-s = 1200 }]",
        ),
    ];
    std::fs::write(dir.path().join("a.toml"), addition("m", &effects)).unwrap();
    let args = ["model", "extend", "--model", "m.toml", "--add", "a.toml", "--out", "n.toml"];
    let out = volcomp(dir.path(), &args);
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    let file = parse_file("n.toml", &std::fs::read_to_string(dir.path().join("n.toml")).unwrap()).unwrap();
    let model = Model::new(&file.spec).unwrap();
    let growth = |name: &str| file.thermal.iter().find(|t| t.name == name).unwrap();
    // 11 um/(m K): the model takes the strain over X, whichever way its carriage counts
    let expansion = growth("expansion-x");
    assert!(expansion.expansion && expansion.inputs[0].sensor == "temp_x");
    assert_eq!((expansion.inputs[0].lags_s.clone(), expansion.inputs[0].reference), (vec![600.0], 20.0));
    assert_eq!(growth("spindle-y").inputs[0].sensor, "spindle");
    // what the sensors would tell at 24 degC and 10000 1/min, into the live values
    let mut pose = Pose::at([0.0; MAX_AXES]);
    for (k, axis) in model.axes().enumerate() {
        pose.position[k] = if axis.name.letter() == 'X' { 400.0 } else { 0.0 };
    }
    for (k, name) in model.sensors().iter().enumerate() {
        let input = &growth(name).inputs[0];
        let units = if input.sensor == "spindle" { 10.0 } else { 24.0 - 20.0 };
        pose.live[k] = input.coefficients[0] * units;
    }
    let d = model.deviation(&pose).position;
    near([d.x * 1e3, d.y * 1e3, d.z * 1e3], [11.0 * 4.0 * 0.4 + 2.0 * 4.0, -30.0, 15.0]);
}

#[test]
fn what_no_offset_takes_out_is_named_and_where_nothing_is_left_no_model_is_written() {
    let load = effect("load", "x", "2", "form = \"load\"\naxis = \"x\"\nalong = \"x\"\npower = 1");
    let tracker = kind(
        "dead-path",
        "",
        "instrument",
        "1, 1",
        "form = \"dead-path\"\nsignal = { source = { temperature = \"x\" }, tau-s = 0 }",
    );
    let scale = effect("scale", "z", "5", "form = \"scale\"\naxis = \"z\"");
    let (_, said) = extended(&[load.clone(), tracker.clone(), scale]);
    let said: serde_json::Value = serde_json::from_str(&said).unwrap();
    let taken: Vec<bool> = (0..3).map(|k| said["effects"][k]["taken"].as_bool().unwrap()).collect();
    assert_eq!(taken, [false, false, true], "{said}");
    assert!(said["effects"][0]["why"].as_str().unwrap().contains("forces"));
    assert_eq!(said["effects"][2]["symbols"], serde_json::json!(["EZZ"]));

    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("m.toml"), MODEL).unwrap();
    std::fs::write(dir.path().join("a.toml"), addition("m", &[load])).unwrap();
    std::fs::write(dir.path().join("other.toml"), addition("lathe", &[tracker])).unwrap();
    let run = |add: &str| {
        let out =
            volcomp(dir.path(), &["model", "extend", "--model", "m.toml", "--add", add, "--out", "n.toml"]);
        (out.status.code().unwrap(), String::from_utf8(out.stderr).unwrap())
    };
    let (code, message) = run("a.toml");
    assert!(code == 65 && message.contains("load:x: not in the model"), "{code}: {message}");
    let (code, message) = run("other.toml");
    assert!(code == 78 && message.contains("machine 'lathe'"), "{code}: {message}");
    assert_eq!(run("missing.toml").0, 74);
    assert!(!dir.path().join("n.toml").exists());
}

/// Two effects, the model with them, and the addition with and without the model that it was found with.
fn found_and_added(dir: &Path) -> [String; 2] {
    let backlash = moving(
        "backlash",
        "x",
        "12",
        "form = \"backlash\"\naxis = \"x\"\nalong = [\"x\"]\nlength-mm = 0.0879\nslope = false",
    );
    let lean = effect("squareness", "xy", "-5.6", "form = \"squareness\"\nalong = \"x\"\nover = \"y\"");
    let old = addition("m", &[backlash, lean]);
    let hash = blake3::hash(MODEL.as_bytes()).to_hex();
    let base = format!("sense = \"\"\n[base]\nfile = \"m.toml\"\nhash = \"{hash}\"\n");
    let new = old.replace("sense = \"\"\n", &base);
    std::fs::write(dir.join("m.toml"), MODEL).unwrap();
    std::fs::write(dir.join("new.toml"), &new).unwrap();
    std::fs::write(dir.join("old.toml"), &old).unwrap();
    let args = ["model", "extend", "--model", "m.toml", "--add", "new.toml", "--out", "better.toml"];
    let out = volcomp(dir, &args);
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    [old, new]
}

#[test]
fn what_a_model_holds_already_is_not_added_again() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    found_and_added(d);
    let run = |add: &[&str]| {
        let args = ["model", "extend", "--model", "better.toml", "--out", "twice.toml"];
        let out = volcomp(d, &[&args[..], add].concat());
        (out.status.code().unwrap(), String::from_utf8(out.stderr).unwrap())
    };
    let hash = |name: &str| blake3::hash(&std::fs::read(d.join(name)).unwrap()).to_hex()[..16].to_owned();
    let (code, message) = run(&["--add", "new.toml"]);
    assert_eq!(code, 78, "{message}");
    let hashes = [hash("m.toml"), hash("better.toml")];
    for part in ["new.toml: found with m.toml", &hashes[0], &hashes[1], "--model better.toml", "--force"] {
        assert!(message.contains(part), "{part} not in {message}");
    }
    // an addition of an earlier version is compared term by term, also behind another one
    let (code, message) = run(&["--add", "old.toml"]);
    assert!(code == 78 && message.contains("already (backlash:x, squareness:xy)"), "{code}: {message}");
    assert!(!d.join("twice.toml").exists());
    let args =
        ["model", "extend", "--model", "m.toml", "--add", "old.toml", "--add", "old.toml", "--out", "t.toml"];
    assert_eq!(volcomp(d, &args).status.code(), Some(78));
    // even by force a term stays single
    let (code, message) = run(&["--add", "new.toml", "--force"]);
    assert!(code == 65 && message.contains("the model has the same terms already"), "{code}: {message}");
    // another base by force
    std::fs::write(d.join("other.toml"), format!("# another day\n{MODEL}")).unwrap();
    let args = ["model", "extend", "--model", "other.toml", "--add", "new.toml", "--out", "o.toml"];
    assert_eq!(volcomp(d, &args).status.code(), Some(78));
    assert!(volcomp(d, &[&args[..], &["--force"]].concat()).status.success());
}

#[test]
fn a_machine_file_does_not_add_again_what_its_model_holds() {
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    found_and_added(d);
    let axes = ["x", "y", "z"].map(|axis| format!("[axes.{axis}]\n{LIMITS}")).concat();
    for (model, add, wanted) in [
        ("m.toml", "new.toml", None),
        ("m.toml", "old.toml", None),
        ("better.toml", "new.toml", Some("found with m.toml")),
        ("better.toml", "old.toml", Some("already (backlash:x, squareness:xy)")),
    ] {
        let machine = MACHINE.replace("m.toml", model);
        std::fs::write(d.join("machine.toml"), format!("{machine}additions = [\"{add}\"]\n{axes}")).unwrap();
        let check = volcomp(d, &["check", "machine.toml"]);
        let message = String::from_utf8(check.stderr).unwrap();
        assert_eq!(check.status.code(), Some(wanted.map_or(0, |_| 78)), "{message}");
        assert!(
            wanted.is_none_or(|w| message.contains(w) && message.contains("--model better.toml")),
            "{message}"
        );
        assert_eq!(volcomp::daemon::load(&d.join("machine.toml")).is_ok(), wanted.is_none());
    }
}

#[test]
fn a_report_in_place_of_the_addition_is_named() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("m.toml"), MODEL).unwrap();
    std::fs::write(dir.path().join("report.json"), "{\n  \"format\": \"volcomp-gap/1\"\n}\n").unwrap();
    let args = ["model", "extend", "--model", "m.toml", "--add", "report.json", "--out", "n.toml"];
    let message = String::from_utf8(volcomp(dir.path(), &args).stderr).unwrap();
    assert!(
        message.contains("not volcomp-addition/1 (TOML)") && message.contains("addition.toml beside"),
        "{message}"
    );
}

const MACHINE: &str = "format = \"volcomp-machine/1\"\nmachine = \"m\"\nmodel = \"m.toml\"\n";
const LIMITS: &str = "limit-um = 100\nrate-um-per-s = 1000\nacceleration-um-per-s2 = 10000\njump-mm = 5\n";

#[test]
fn a_machine_file_may_name_additions_and_the_daemon_starts_with_them_in_its_model() {
    let dir = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(dir.path().join(name), text).unwrap();
    let scale = effect("scale", "z", "5", "form = \"scale\"\naxis = \"z\"");
    let backlash = effect(
        "backlash",
        "y",
        "3",
        "form = \"backlash\"\naxis = \"y\"\nalong = [\"y\"]\nlength-mm = 0\nslope = false",
    );
    let load = effect("load", "x", "2", "form = \"load\"\naxis = \"x\"\nalong = \"x\"\npower = 1");
    write("m.toml", MODEL);
    write("one.toml", &addition("m", &[scale, load.clone()]));
    write("two.toml", &addition("m", &[backlash]));
    write("load.toml", &addition("m", &[load]));
    write("lathe.toml", &addition("lathe", &[effect("scale", "z", "5", "form = \"scale\"\naxis = \"z\"")]));
    let axes = ["x", "y", "z"].map(|axis| format!("[axes.{axis}]\n{LIMITS}")).concat();
    let machine =
        |additions: &str| write("machine.toml", &format!("{MACHINE}additions = {additions}\n{axes}"));
    machine(r#"["one.toml", "two.toml"]"#);
    let loaded = volcomp::daemon::load(&dir.path().join("machine.toml")).unwrap();
    let out = volcomp(
        dir.path(),
        &[
            "model", "extend", "--model", "m.toml", "--add", "one.toml", "--add", "two.toml", "--out",
            "n.toml",
        ],
    );
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    let by_hand =
        parse_file("n.toml", &std::fs::read_to_string(dir.path().join("n.toml")).unwrap()).unwrap().spec;
    assert_eq!(loaded.model.spec, by_hand, "as model extend would make it");
    let plain = parse_file("m.toml", MODEL).unwrap().spec;
    assert_ne!(loaded.model.spec, plain);
    // hash and text are those of the model with the additions, so that a recording of it can be replayed
    assert_eq!(loaded.model.hash, blake3::hash(loaded.model.text.as_bytes()).to_hex().to_string());
    assert_eq!(parse_file("again.toml", &loaded.model.text).unwrap().spec, by_hand);

    let check = volcomp(dir.path(), &["check", "machine.toml", "--json"]);
    let said: serde_json::Value = serde_json::from_slice(&check.stdout).unwrap();
    let taken: Vec<bool> =
        (0..3).map(|k| said["files"][0]["additions"][k]["taken"].as_bool().unwrap()).collect();
    assert_eq!(taken, [true, false, true], "{said}");
    let check = volcomp(dir.path(), &["check", "machine.toml"]);
    let text = String::from_utf8(check.stdout).unwrap();
    assert!(text.contains("addition load:x: not in the model"), "{text}");

    for (additions, code, wanted) in [
        (r#"["lathe.toml"]"#, 78, "found on machine 'lathe', the model is of 'm'"),
        (r#"["load.toml"]"#, 78, "nothing in it can be part of a model"),
        (r#"["m.toml"]"#, 78, "m.toml"),
        (r#"["missing.toml"]"#, 74, "are taken relative to the machine file"),
        (r#"[""]"#, 78, "an addition has an empty name"),
        (r#""one.toml""#, 78, "a list of texts"),
    ] {
        machine(additions);
        let check = volcomp(dir.path(), &["check", "machine.toml"]);
        let message = String::from_utf8(check.stderr).unwrap();
        assert_eq!(check.status.code(), Some(code), "{additions}: {message}");
        assert!(message.contains(wanted), "{additions}: {message}");
        assert!(volcomp::daemon::load(&dir.path().join("machine.toml")).is_err(), "{additions}");
    }
}

/// Ranges of the motion that the data have seen.
const MOTION: &str = "vx_mm_per_s = [-100, 80]\nvy_mm_per_s = [-100, 80]\nvz_mm_per_s = [-50, 50]\n\
                      vc_deg_per_s = [-90, 90]\nax_mm_per_s2 = [-900, 1000]\ntool_length_mm = [60, 240]\n";

fn moving(name: &str, subject: &str, values: &str, shape: &str) -> String {
    effect(name, subject, values, shape).replace("[effect.valid]\n", &format!("[effect.valid]\n{MOTION}"))
}

/// The model's own kinematics checks every entry against the formula of the addition before it is written.
#[test]
fn effects_of_motion_and_tool_become_terms_on_both_sides_of_the_bed() {
    let lever = "lever = { axes = [true, true, true], home-mm = [0, 0, -60], tool = false }";
    let frame = "frame = { axis = \"c\", workpiece-side = true, point-mm = [250, 200, 0], outer = [], inner = [], \
                 tip-mm = [0, 0, -100], nose-mm = [0, 0, 0] }";
    let (model, said) = extended(&[
        moving(
            "backlash",
            "x",
            "5, 2",
            "form = \"backlash\"\naxis = \"x\"\nalong = [\"x\"]\nlength-mm = 0.4\nslope = true",
        ),
        moving(
            "lateral-play",
            "y",
            "3, -2",
            "form = \"backlash\"\naxis = \"y\"\nalong = [\"x\", \"z\"]\nlength-mm = 0\nslope = false",
        ),
        moving("latency", "", "4", "form = \"lag\"\naxes = [\"x\", \"y\", \"z\"]\ntie-ms = 0"),
        moving("inertial", "x", "6", "form = \"inertial\"\naxis = \"x\"\nalong = \"y\"\nslope = false"),
        moving(
            "inertial-cross",
            "x",
            "9",
            &format!("form = \"inertial-tilt\"\naxis = \"x\"\nabout = [\"b\"]\n{lever}"),
        ),
        moving(
            "reversal-spike",
            "y",
            "4",
            "form = \"spike\"\naxis = \"y\"\nrise-s = 0.002\nfall-s = 0.03\nslope = false",
        ),
        moving("friction", "z", "1", "form = \"friction\"\naxis = \"z\""),
        moving("tool-length", "", "150", "form = \"tool-length\""),
        moving("spindle-tilt", "", "12, -9", "form = \"spindle-tilt\""),
        moving("rotary-backlash", "c", "3", &format!("form = \"rotary-backlash\"\n{frame}")),
    ]);
    assert!(!said.contains("\"taken\": false"), "{said}");
    assert!(said.contains("\"tool\""), "{said}");
    assert!(model.has_transients());
    // after long travel, at rest: play of X with its slope and of Y in X, the tool of the model 100 mm long
    let at = [300.0, 200.0, -50.0, 0.0];
    let tilt = |arcsec: f64| arcsec * 100.0 * std::f64::consts::PI / 648.0;
    let tool = [tilt(9.0), tilt(12.0), -15.0];
    let half = |direction: f64| {
        let turned = 3.0 * 0.5 * std::f64::consts::PI / 648.0;
        let arm = [at[0] - 250.0, at[1] - 200.0];
        [
            -direction * (0.5 * (5.0 + 2.0 * 0.3) + 1.5) + tool[0] + direction * turned * arm[1],
            4.0 + tool[1] - direction * turned * arm[0],
            direction + tool[2],
        ]
    };
    near(deviation_um(&model, at, Travel::Forward), half(1.0));
    near(deviation_um(&model, at, Travel::Reverse), half(-1.0));
}

#[test]
fn each_effect_states_its_part_of_the_forecast_shrink() {
    let dir = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(dir.path().join(name), text).unwrap();
    write("m.toml", MODEL);
    let load = effect("load", "x", "2", "form = \"load\"\naxis = \"x\"\nalong = \"x\"\npower = 1");
    write(
        "addition.toml",
        &addition("m", &[effect("scale", "z", "5", "form = \"scale\"\naxis = \"z\""), load]),
    );
    let cause = |effect: &str, subject: &str, shrink: f64| serde_json::json!({ "effect": effect, "subject": subject, "kind": "machine", "declared": true, "shrink": shrink });
    let report = serde_json::json!({
        "causes": [cause("scale", "z", 0.4), cause("load", "x", 0.1)],
        "shrink": { "rms_before_um": 5.0, "rms_after_um": 1.0 },
    });
    let args = ["model", "extend", "--model", "m.toml", "--add", "addition.toml", "--out", "n.toml"];
    let plain = String::from_utf8(volcomp(dir.path(), &args).stdout).unwrap();
    assert!(!plain.contains("shrink"), "no report: {plain}");
    write("report.json", &report.to_string());
    let text = String::from_utf8(volcomp(dir.path(), &args).stdout).unwrap();
    assert!(text.contains("scale:z: in the model, EZZ; shrink 0.40 of 0.40"), "{text}");
    assert!(text.contains("shrink 0.00 of 0.10"), "{text}");
    assert!(text.contains("shrink of the gap: 0.49 of 0.80 forecast"), "{text}");
    let out = volcomp(dir.path(), &[&args[..], &["--json"]].concat());
    let said: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
    assert_eq!(said["effects"][1]["shrink_deliverable"], 0.0);
    assert!((said["shrink"]["deliverable"].as_f64().unwrap() - 0.4903).abs() < 1e-3, "{said}");
    write("wrong.json", "{}");
    let out = volcomp(dir.path(), &[&args[..], &["--report", "wrong.json"]].concat());
    assert_eq!(out.status.code(), Some(65));
    // a file that nobody named
    write("report.json", "{}");
    let out = volcomp(dir.path(), &args);
    let said = String::from_utf8(out.stderr).unwrap();
    assert!(out.status.success() && said.contains("report.json: no shrink and causes"), "{said}");
}
