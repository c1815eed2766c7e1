//! What the methods of `identify` refuse in a table: unknown columns, a part of a point, readings that no machine has.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
#![expect(clippy::disallowed_methods, reason = "the test writes files")]

use std::fmt::Write;
use std::path::Path;
use std::process::{Command, Output};

use serde_json::Value;

fn identify(folder: &Path, line: &str) -> Output {
    let words = line.split_whitespace();
    Command::new(env!("CARGO_BIN_EXE_volcomp"))
        .current_dir(folder)
        .arg("identify")
        .args(words)
        .output()
        .unwrap()
}

/// Stdout and stderr of a run that succeeds.
fn ok(folder: &Path, line: &str) -> (String, String) {
    let output = identify(folder, line);
    let [out, said] = [output.stdout, output.stderr].map(|b| String::from_utf8(b).unwrap());
    assert!(output.status.success(), "{line}: {said}");
    (out, said)
}

/// The message of a run that is refused as bad data.
fn refused(folder: &Path, line: &str) -> String {
    let output = identify(folder, line);
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(65), "{line}: {said}");
    said
}

fn write(folder: &Path, name: &str, text: &str) {
    std::fs::write(folder.join(name), text).unwrap();
}

/// Poses of a head at three positions of the ram, which leans by 5 arcsec per 100 mm about X; `column` holds the position.
fn poses(column: &str) -> String {
    let mut text =
        format!("{column},c_deg,a_deg,tip_x_um,tip_y_um,tip_z_um,dir_x_arcsec,dir_y_arcsec,dir_z_arcsec\n");
    for (position, (c, a)) in [0, 100, 200].into_iter().flat_map(|p| [(0, 30), (90, -40)].map(|h| (p, h))) {
        let lean = f64::from(position) / 20.0;
        writeln!(text, "{position},{c},{a},{lean},{lean},0,0,{},0", -lean).unwrap();
    }
    text
}

const RAM: &str =
    "ram --a-axis-mm 0,0,-180 --tool-length-mm 320 --sigma-position-um 50 --sigma-direction-arcsec 50";

#[test]
fn the_position_of_a_ram_is_the_column_of_its_axis() {
    let folder = tempfile::tempdir().unwrap();
    let d = folder.path();
    for column in ["y_mm", "z_mm", "yy_mm"] {
        write(d, &format!("{column}.csv"), &poses(column));
    }
    for name in ["y_mm.csv", "z_mm.csv"] {
        let (out, _) = ok(d, &format!("{RAM} --axis y --data {name}"));
        assert!(out.contains("Y at 3 stops"), "{out}");
    }
    let said = refused(d, &format!("{RAM} --axis y --data yy_mm.csv"));
    assert!(said.contains("yy_mm.csv:1:1: yy_mm: unknown column; is y_mm meant?"), "{said}");
    // a ram along Z has no position along Y
    let said = refused(d, &format!("{RAM} --data y_mm.csv"));
    assert!(said.contains("y_mm.csv:1:1: y_mm: unknown column"), "{said}");
}

#[test]
fn columns_that_are_not_known_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let d = folder.path();
    write(d, "circles.csv", "circle,x_mm,y_mm,z_mm,registraton\n1,0,0,0,1\n");
    write(d, "points.csv", "point,x_mm,y_mm,z_mm,weigth\np1,0,0,0,1\n");
    write(d, "lines.csv", "line,x_mm,y_mm,z_mm,weigth\nl1,0,0,0,1\n");
    let registration = "point,machine_x_mm,machine_y_mm,machine_z_mm,x_mm,y_mm,z_mm,machine_z\n";
    write(d, "registration.csv", &format!("{registration}r1,0,0,0,0,0,0,0\n"));
    write(d, "motion.csv", "position_mm\n0\n");
    for (line, named) in [
        (
            "circles --tip-beyond-mm 120 --data circles.csv",
            "circles.csv:1:23: registraton: unknown column; columns are",
        ),
        (
            "threepoint --axis x --data motion.csv --points points.csv",
            "points.csv:1:22: weigth: unknown column; columns are",
        ),
        (
            "nineline --axis x --noise-um 1 --data motion.csv --lines lines.csv",
            "lines.csv:1:21: weigth: unknown column",
        ),
        (
            "circles --tip-beyond-mm 120 --data circles.csv --registration registration.csv",
            "registration.csv:1:61: machine_z: unknown column; machine_z states no unit: name it machine_z_mm",
        ),
    ] {
        let said = refused(d, line);
        assert!(said.contains(named), "{line}: {said}");
    }
}

#[test]
fn a_part_of_the_columns_of_a_point_is_refused_and_a_point_without_columns_named() {
    let folder = tempfile::tempdir().unwrap();
    let d = folder.path();
    let names = ["p1", "p2", "p3", "p4"];
    let places = [[0.0, 0.0, 0.0], [300.0, 0.0, 0.0], [0.0, 200.0, 0.0], [0.0, 0.0, 100.0]];
    let mut points = "point,x_mm,y_mm,z_mm\n".to_owned();
    let mut head = "position_mm".to_owned();
    for (name, [x, y, z]) in names.iter().zip(places) {
        writeln!(points, "{name},{x},{y},{z}").unwrap();
        write!(head, ",{name}_x_mm,{name}_y_mm,{name}_z_mm").unwrap();
    }
    let mut data = head + "\n";
    for position in [0.0, 100.0, 200.0] {
        write!(data, "{position}").unwrap();
        for [x, y, z] in places {
            write!(data, ",{},{y},{z}", x + position).unwrap();
        }
        data.push('\n');
    }
    // without the columns from the given one on, up to another
    let without = |from: usize, to: usize| {
        let keep = |line: &str| {
            let fields = line.split(',').enumerate().filter(|(k, _)| !(from..to).contains(k));
            fields.map(|(_, field)| field).collect::<Vec<_>>().join(",") + "\n"
        };
        data.lines().map(keep).collect::<String>()
    };
    write(d, "points.csv", &points);
    write(d, "part.csv", &without(2, 3));
    write(d, "three.csv", &without(1, 4));
    let line = "threepoint --axis x --points points.csv --noise-um 1 --data";
    let said = refused(d, &format!("{line} part.csv"));
    assert!(said.contains("part.csv:1: p1_y_mm is missing beside p1_x_mm, p1_z_mm"), "{said}");
    let said = refused(d, "threepoint --rigidity --data part.csv");
    assert!(said.contains("part.csv:1: p1_y_mm is missing"), "{said}");
    let (_, said) = ok(d, &format!("{line} three.csv"));
    assert!(said.contains("three.csv: no columns of point p1, which is left out"), "{said}");
}

/// A row with a value that no machine has is refused with its place and the unit it may have been in.
#[test]
fn readings_larger_than_any_machine_has_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let d = folder.path();
    let diagonal = |name: &str| format!("{name},1,1,0,0\n{name},1,1,300,1\n");
    let diagonals = ["ppp", "npp", "pnp"].map(diagonal).concat();
    let tables = [
        ("lines.csv", "line,x_mm,y_mm,z_mm\nl1,0,0,0\nl2,0,100,0\n".to_owned()),
        ("nineline.csv", "position_mm,l1_dx_um\n0,1\n100,40000\n".to_owned()),
        ("straightness.csv", "position_mm,eyx_um,ecx_arcsec\n0,1,0\n100,1,4e4\n".to_owned()),
        ("ram.csv", poses("z_mm") + "300,0,30,1e29,0,0,0,0,0\n"),
        (
            "diagonals.csv",
            format!("diagonal,cycle,direction,target_mm,deviation_um\n{diagonals}ppn,1,1,0,0\nppn,1,1,300,40000\n"),
        ),
        ("grinder.csv", "x_mm,dx_um,dy_um,dz_um\n0,0,0,0\n10,0,-40000,0\n".to_owned()),
        ("kalman.csv", "x_mm,y_mm,z_mm,eaz_arcsec\n0,0,0,1\n10,0,0,5000\n".to_owned()),
        ("ballbar.csv", "angle_deg,deviation_um,direction\n0,1,1\n1,40000,1\n".to_owned()),
        (
            "fivedof.csv",
            "position_mm,distance_mm,psd1_y_um,psd1_z_um,psd2_y_um,psd2_z_um,psd3_y_um,psd3_z_um,qd1_y_um,qd1_z_um,\
             qd2_y_um,qd2_z_um\n0,400,0,0,0,0,0,0,0,0,0,0\n100,500,0,0,0,0,0,0,0,0,0,40000\n"
                .to_owned(),
        ),
        (
            "head.toml",
            "format = \"volcomp-fivedof/1\"\nfocal-mm = { psd1 = 200, psd2 = 200, psd3 = 200 }\n\
             beam-1-mm = [-30, 0]\nbeam-2-mm = [30, 0]\n"
                .to_owned(),
        ),
    ];
    for (name, text) in tables {
        write(d, name, &text);
    }
    let nm = "40000 µm; the limit is 5000 µm: were these values in nm, not in µm?";
    for (line, place, what) in [
        (
            "nineline --axis x --noise-um 1 --lines lines.csv --data nineline.csv",
            "nineline.csv:3:5: l1_dx_um",
            nm,
        ),
        (
            "straightness --axis x --data straightness.csv",
            "straightness.csv:3:7: ecx_arcsec",
            "40000 arcsec; the limit is 2063 arcsec: were these values in nrad",
        ),
        (
            &format!("{RAM} --data ram.csv"),
            "ram.csv:8:10: tip_x_um",
            "are these positions instead of deviations?",
        ),
        (
            "diagonals --box-mm 200,200,100 --accept-bias-arcsec 5 --data diagonals.csv",
            "diagonals.csv:9: deviation_um",
            nm,
        ),
        ("grinder --step x=grinder.csv", "grinder.csv:3:6: dy_um", nm),
        (
            "kalman --first 0,100 --second 0,100 --third 0,100 --sigma 5 --noise 1 --data kalman.csv",
            "kalman.csv:3:8: eaz_arcsec",
            "were these values in urad, not in arcsec?",
        ),
        (
            "ballbar --radius-mm 150 --centre-mm 0,0,0 --data xy=ballbar.csv",
            "ballbar.csv:3:3: deviation_um",
            nm,
        ),
        (
            "fivedof --axis x --calibration head.toml --data fivedof.csv",
            "fivedof.csv:3:",
            "the limit is 25000 µm",
        ),
    ] {
        let said = refused(d, line);
        assert!(said.contains(place) && said.contains(what), "{line}: {said}");
    }
}

/// Four diagonals of a cube of 100 mm, three cycles out, whose end lies `open_um` too far along ppp and npp.
fn diagonals(open_um: f64) -> String {
    let mut text = "diagonal,cycle,direction,target_mm,deviation_um\n".to_owned();
    for (name, sign) in [("ppp", 1.0), ("npp", -1.0), ("pnp", 0.0), ("ppn", 0.0)] {
        for cycle in 1..=3 {
            let end = sign * open_um + 2.0 * f64::from(cycle - 2);
            let length = 100.0 * 3f64.sqrt();
            writeln!(text, "{name},{cycle},1,0,0\n{name},{cycle},1,{length},{end}").unwrap();
        }
    }
    text
}

const DIAGONALS: &str = "diagonals --box-mm 100,100,100 --accept-bias-arcsec 5 --data d.csv";

#[test]
fn a_noise_that_the_cycles_contradict_is_replaced_by_their_scatter() {
    let folder = tempfile::tempdir().unwrap();
    let d = folder.path();
    write(d, "d.csv", &diagonals(0.0));
    let run = |more: &str| {
        let (out, said) = ok(d, &format!("{DIAGONALS} --json {more}"));
        (serde_json::from_str::<Value>(&out).unwrap(), said)
    };
    let (own, _) = run("");
    let (fits, said) = run("--noise-um 2");
    assert!(!said.contains("the cycles scatter"), "{said}");
    assert!(fits["noise_p_value"].as_f64().unwrap() > 0.001 && own["noise_p_value"].is_null(), "{fits}");
    let (doubted, said) = run("--noise-um 0.05");
    assert!(said.contains("d.csv: the cycles scatter by 2.00 µm, 40.0 times the stated 0.05 µm"), "{said}");
    assert!(said.contains("the uncertainties given are enlarged by 40.0"), "{said}");
    assert_eq!(doubted["ec0y_std_arcsec"], own["ec0y_std_arcsec"]);
    assert!((doubted["noise_factor"].as_f64().unwrap() - 40.0).abs() < 1e-9, "{doubted}");
}

#[test]
fn a_squareness_that_no_machine_has_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let d = folder.path();
    write(d, "d.csv", &diagonals(4000.0));
    let said = refused(d, DIAGONALS);
    assert!(said.contains("d.csv: the squareness EC0Y would be -714"), "{said}");
    assert!(
        said.contains("the limit is 2063 arcsec (10 mrad): were the readings in nm, not in µm"),
        "{said}"
    );
}

/// The message of a command line that is refused.
fn usage(folder: &Path, line: &str) -> String {
    let output = identify(folder, line);
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(64), "{line}: {said}");
    said
}

#[test]
fn a_noise_of_zero_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    for line in ["grinder --noise-um 0 --step x=x.csv", "probe --noise-um 0 --data p.csv --bar-radius-mm 15"]
    {
        let said = usage(folder.path(), line);
        assert!(said.contains("'0' for '--noise-um <UM>'") && said.contains("above 0"), "{line}: {said}");
    }
}

#[test]
fn the_nodes_of_a_grid_may_begin_below_zero() {
    let folder = tempfile::tempdir().unwrap();
    let d = folder.path();
    write(d, "k.csv", "x_mm,y_mm,z_mm,eaz_arcsec\n-400,-10,0,1\n0,10,-50,1.2\n400,0,-100,0.8\n");
    let (out, _) =
        ok(d, "kalman --data k.csv --first -400,0,400 --second -10,10 --third -100,0 --sigma 5 --noise 1");
    assert!(out.contains("3 readings, 0 rejected"), "{out}");
}

#[test]
fn a_polynomial_through_all_points_has_no_standard_deviations() {
    let folder = tempfile::tempdir().unwrap();
    let d = folder.path();
    write(d, "f.csv", "x,y\n0,1\n1,3\n2,2\n");
    let line = "fits --data f.csv --basis polynomial --order 2";
    let (out, said) = ok(d, line);
    assert!(!out.contains("+-") && !out.contains("NaN"), "{out}");
    assert!(said.contains("f.csv: 3 coefficients for 3 points leave no degree of freedom"), "{said}");
    let (out, _) = ok(d, &format!("{line} --json"));
    assert!(serde_json::from_str::<Value>(&out).unwrap()["coefficients_std"].is_null(), "{out}");
    let (out, said) = ok(d, "fits --data f.csv --basis polynomial --order 1");
    assert!(out.contains("+-") && said.is_empty(), "{out}{said}");
}

/// Readings at every degree from `from` to `to` and back at two feeds.
fn arc(from: i32, to: i32) -> String {
    let mut text = "angle_deg,deviation_um,direction,feed_mm_per_min,run\n".to_owned();
    for (run, (feed, direction)) in [(500, 1), (500, -1), (2000, 1), (2000, -1)].into_iter().enumerate() {
        for k in from..=to {
            let angle = if direction > 0 { k } else { from + to - k };
            let noise = 0.01 * f64::from((7 * k + 3 * direction) % 11 - 5);
            writeln!(text, "{angle},{noise},{direction},{feed},{run}").unwrap();
        }
    }
    text
}

#[test]
fn reversals_that_an_arc_does_not_have_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let d = folder.path();
    write(d, "arc.csv", &arc(-20, 200));
    let line = "ballbar --data yz=arc.csv --radius-mm 150 --centre-mm 0,0,0";
    let (out, _) = ok(d, &format!("{line} --json"));
    let json: Value = serde_json::from_str(&out).unwrap();
    let absent = json["planes"][0]["not_determined"].as_array().unwrap();
    for effect in ["backlash:z", "lateral-play:z", "reversal-spike:z"] {
        let is_named = |m: &Value| {
            m["effect"] == effect && m["reason"].as_str().unwrap().contains("at the negative end of travel")
        };
        assert!(absent.iter().any(is_named), "{effect}: {absent:?}");
    }
    let said = usage(d, &format!("{line} --pitch-mm y=10 --pitch-mm x=5"));
    assert!(said.contains("--pitch-mm x=5: axis X does not move in plane yz"), "{said}");
}

#[test]
fn a_feed_with_too_few_readings_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let d = folder.path();
    let text = arc(0, 360).replacen("100,0.05,1,500,", "100,0.05,1,501,", 1);
    assert!(text.contains(",501,"), "{text}");
    write(d, "xy.csv", &text);
    let said = refused(d, "ballbar --data xy=xy.csv --radius-mm 150 --centre-mm 0,0,0");
    assert!(
        said.contains("xy.csv:102: 1 reading at 501 mm/min in one direction; a circle needs 8"),
        "{said}"
    );
}
