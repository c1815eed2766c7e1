//! `volcomp identify .. --into`: what the model holds already is not found a second time.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
#![expect(clippy::disallowed_methods, reason = "the test writes files")]

use std::fmt::Write;
use std::path::Path;
use std::process::{Command, Output};

fn volcomp(folder: &Path, args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_volcomp")).current_dir(folder).args(args).output().unwrap()
}

fn ok(folder: &Path, args: &[&str]) -> String {
    let output = volcomp(folder, args);
    assert!(output.status.success(), "{args:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

const MODEL: &str = r#"
format = "volcomp-model/1"
machine = "vmc"
chain = "[w X' b Y Z t]"
[axes.x]
travel-mm = [0, 800]
[axes.y]
travel-mm = [0, 500]
[axes.z]
travel-mm = [-500, 0]
[errors.ec0y.constant]
value-arcsec = 5.0
[errors.ecx.table]
position-mm = [0, 800]
value-arcsec = [0, 20]
[errors.eby.table]
position-mm = [0, 500]
value-arcsec = [0, 10]
"#;

const CENTRE: [f64; 2] = [400.0, 150.0];
const RADIUS: f64 = 150.0;

/// Predicted radial deviation at angles of the circle, um.
fn radial_um(folder: &Path, model: &str) -> Vec<f64> {
    let place = |k: i32| f64::from(k).to_radians().sin_cos();
    let mut points = "x_mm,y_mm,z_mm\n".to_owned();
    for k in 0..360 {
        let (sin, cos) = place(k);
        writeln!(points, "{},{},-300", CENTRE[0] + RADIUS * cos, CENTRE[1] + RADIUS * sin).unwrap();
    }
    std::fs::write(folder.join("points.csv"), points).unwrap();
    let table = ok(folder, &["predict", "--model", model, "--points", "points.csv", "--out", "-"]);
    let names: Vec<&str> = table.lines().next().unwrap().split(',').collect();
    let [dx, dy] = ["dx_um", "dy_um"].map(|name| names.iter().position(|n| *n == name).unwrap());
    let radial = |(k, line): (i32, &str)| {
        let fields: Vec<&str> = line.split(',').collect();
        let (sin, cos) = place(k);
        fields[dx].parse::<f64>().unwrap() * cos + fields[dy].parse::<f64>().unwrap() * sin
    };
    (0..360).zip(table.lines().skip(1)).map(radial).collect()
}

/// Largest minus smallest about the least-squares centre, um.
fn circularity_um(radial: &[f64]) -> f64 {
    let wave = |of: fn(f64) -> f64| {
        2.0 / 360.0 * radial.iter().zip(0..).map(|(r, k)| r * of(f64::from(k).to_radians())).sum::<f64>()
    };
    let (a, b) = (wave(f64::cos), wave(f64::sin));
    let about = |(r, k): (&f64, i32)| {
        let angle = f64::from(k).to_radians();
        r - a * angle.cos() - b * angle.sin()
    };
    let left: Vec<f64> = radial.iter().zip(0..).map(about).collect();
    left.iter().copied().fold(f64::MIN, f64::max) - left.iter().copied().fold(f64::MAX, f64::min)
}

/// Circles of both directions and two feeds on the machine of a model.
fn write_circles(folder: &Path, truth: &[f64]) {
    let mut table = "angle_deg,deviation_um,direction,feed_mm_per_min\n".to_owned();
    for (feed, direction) in [(1000, 1), (1000, -1), (3000, 1), (3000, -1)] {
        for k in 0..360 {
            let angle = if direction > 0 { k } else { 359 - k };
            // the resolution of the instrument
            let deviation = (truth[angle] * 10.0).round() / 10.0;
            writeln!(table, "{angle},{deviation},{direction},{feed}").unwrap();
        }
    }
    std::fs::write(folder.join("circle.csv"), table).unwrap();
}

const BALLBAR: [&str; 6] =
    ["identify", "ballbar", "--data=xy=circle.csv", "--radius-mm=150", "--centre-mm=400,150,-300", "--json"];

/// What correction by a model leaves of the circle, um.
fn residual_um(folder: &Path, truth: &[f64], model: &str) -> f64 {
    let left: Vec<f64> = truth.iter().zip(radial_um(folder, model)).map(|(a, b)| a - b).collect();
    circularity_um(&left)
}

#[test]
fn a_ballbar_adds_nothing_to_an_exact_model() {
    let folder = tempfile::tempdir().unwrap();
    let d = folder.path();
    std::fs::write(d.join("model.toml"), MODEL).unwrap();
    let truth = radial_um(d, "model.toml");
    assert!(circularity_um(&truth) > 2.0, "{}", circularity_um(&truth));
    write_circles(d, &truth);
    let output = volcomp(d, &[&BALLBAR[..], &["--into", "model.toml", "--out", "more.toml"]].concat());
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(said.contains("the prediction of model.toml at the circles was subtracted"), "{said}");
    let residual = residual_um(d, &truth, "more.toml");
    assert!(residual < 0.1, "{residual} um");
}

#[test]
fn a_ballbar_adds_what_the_model_lacks_to_its_errors() {
    let folder = tempfile::tempdir().unwrap();
    let d = folder.path();
    // the bow of Y along X is a curve of the model already, the squareness is 12 arcsec and not 5
    let bow = "[errors.eyx]\nsource = \"bow.csv\"\n[errors.eyx.table]\nposition-mm = [0, 400, 800]\nvalue-um = [0, 9, 0]\n";
    std::fs::write(d.join("model.toml"), [MODEL, bow].concat()).unwrap();
    std::fs::write(d.join("truth.toml"), [&MODEL.replace("5.0", "12.0"), bow].concat()).unwrap();
    let truth = radial_um(d, "truth.toml");
    write_circles(d, &truth);
    let before = residual_um(d, &truth, "model.toml");
    assert!(before > 4.0, "{before} um");
    ok(d, &[&BALLBAR[..], &["--into", "model.toml"]].concat());
    let after = residual_um(d, &truth, "model.toml");
    assert!(after < 0.1, "{after} um");
    let text = std::fs::read_to_string(d.join("model.toml")).unwrap();
    let squareness: f64 = {
        let (_, rest) = text.split_once("[errors.ec0y.constant]").unwrap();
        rest.split_once("value-arcsec = ").unwrap().1.lines().next().unwrap().parse().unwrap()
    };
    assert!((squareness - 12.0).abs() < 0.05, "{text}");
    assert!(text.contains("bow.csv"), "{text}");
    // the same circles once more find nothing
    ok(d, &[&BALLBAR[..], &["--into", "model.toml", "--out", "again.toml"]].concat());
    assert!(residual_um(d, &truth, "again.toml") < 0.1);
}

#[test]
fn a_box_of_diagonals_lies_in_the_travel_of_the_model() {
    let folder = tempfile::tempdir().unwrap();
    let d = folder.path();
    std::fs::write(d.join("model.toml"), MODEL).unwrap();
    std::fs::write(d.join("d.csv"), "diagonal,cycle,direction,target_mm,deviation_um\nppp,1,1,0,0\n")
        .unwrap();
    let args = [
        "identify",
        "diagonals",
        "--data",
        "d.csv",
        "--box-mm=700,400,400",
        "--model",
        "model.toml",
        "--json",
    ];
    let output = volcomp(d, &args);
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(!output.status.success());
    assert!(
        said.contains("the box runs from Z 0 to 400 mm, the travel of the model from -500 to 0 mm"),
        "{said}"
    );
}

#[test]
fn a_spindle_found_by_circles_is_where_the_tip_says_and_moves_nothing_along_it() {
    let folder = tempfile::tempdir().unwrap();
    let d = folder.path();
    // an axis 20 um beside (100, 200) mm, tilted by 30 and -20 arcsec about the tip
    let (tilt, shift) = ([30.0, -20.0].map(|a: f64| (a / 3600.0).to_radians()), [0.02, -0.01]);
    let mut points = "circle,x_mm,y_mm,z_mm\n".to_owned();
    for (circle, height) in [(1, 250.0), (2, 100.0)] {
        for k in 0..72 {
            let (sin, cos) = f64::from(5 * k).to_radians().sin_cos();
            let (x, y) = (80.0 * cos, 80.0 * sin);
            // a small rotation about x and y turns (x, y, height) about the tip
            let turned = [x + tilt[1] * height, y - tilt[0] * height, height + tilt[0] * y - tilt[1] * x];
            let at = [100.0 + shift[0] + turned[0], 200.0 + shift[1] + turned[1], -300.0 + turned[2]];
            writeln!(points, "{circle},{},{},{}", at[0], at[1], at[2]).unwrap();
        }
    }
    std::fs::write(d.join("circles.csv"), points).unwrap();
    let args = ["identify", "circles", "--data", "circles.csv", "--tip-beyond-mm", "100"];
    let more = ["--nominal-tip-mm", "100,200,-300", "--chain", "[w b X Y Z (S) t]", "--out", "m.toml"];
    ok(d, &[&args[..], &more].concat());
    let model = std::fs::read_to_string(d.join("m.toml")).unwrap();
    assert!(model.contains("tool-tip-mm = [100, 200, -300]"), "{model}");
    assert!(model.contains("point-mm = [100, 200, 0]"), "{model}");
    std::fs::write(d.join("p.csv"), "x_mm,y_mm,z_mm\n0,0,0\n").unwrap();
    let table = ok(d, &["predict", "--model", "m.toml", "--points", "p.csv", "--out", "-"]);
    let [names, values] = [0, 1].map(|i| table.lines().nth(i).unwrap().split(',').collect::<Vec<_>>());
    for (name, wanted) in [("dx_um", 20.0), ("dy_um", -10.0), ("dz_um", 0.0)] {
        let value: f64 = values[names.iter().position(|n| *n == name).unwrap()].parse().unwrap();
        assert!((value - wanted).abs() < 0.01, "{name} {value}: {table}");
    }
}
