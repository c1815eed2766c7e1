//! Data that contradict each other, columns that are exchanged, poses that repeat: what the tools say of measurements.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
#![expect(clippy::disallowed_methods, reason = "the test writes files")]

use std::fmt::Write;
use std::path::Path;
use std::process::{Command, Output};

use serde_json::Value;

fn volcomp(folder: &Path, args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_volcomp")).current_dir(folder).args(args).output().unwrap()
}

/// Stdout and stderr of a run that succeeds.
fn ok(folder: &Path, args: &[&str]) -> (String, String) {
    let output = volcomp(folder, args);
    let [out, said] = [output.stdout, output.stderr].map(|b| String::from_utf8(b).unwrap());
    assert!(output.status.success(), "{args:?}: {said}");
    (out, said)
}

/// The message of a run that is refused as bad data.
fn refused(folder: &Path, args: &[&str]) -> String {
    let output = volcomp(folder, args);
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(65), "{args:?}: {said}");
    said
}

fn write(folder: &Path, name: &str, text: &str) {
    std::fs::write(folder.join(name), text).unwrap();
}

/// A turn of C in steps of 30 deg, both directions.
fn turn() -> String {
    let mut text = "position_deg,ecc_arcsec,exc_um,cycle,direction\n".to_owned();
    for cycle in 1..=2 {
        for (direction, wobble) in [(1, 0.02), (-1, -0.02)] {
            for i in 0..=12 {
                let degrees = 30 * if direction > 0 { i } else { 12 - i };
                let angle = f64::from(degrees).to_radians();
                let ecc = 4.0 * angle.sin() + 2.0 * (2.0 * angle).cos() + wobble * f64::from(cycle);
                writeln!(text, "{degrees},{ecc},{},{cycle},{direction}", 3.0 * angle.cos()).unwrap();
            }
        }
    }
    text
}

#[test]
fn a_whole_turn_holds_at_every_turn_of_the_travel() {
    let folder = tempfile::tempdir().unwrap();
    let d = folder.path();
    write(d, "c.csv", &turn());
    write(d, "poses.csv", "c_deg\n-270\n90\n-90\n270\n-360\n0\n360\n");
    for basis in ["auto", "table", "fourier"] {
        let fit = [
            "fit",
            "--errors",
            "c.csv",
            "--axis",
            "c",
            "--basis",
            basis,
            "--chain",
            "[w C' b X Y Z t]",
            "--travel",
            "c=-360:360",
            "--out",
            "c.toml",
        ];
        let (_, said) = ok(d, &fit);
        assert!(said.contains("ECC: the data cover a whole turn; the curve repeats over"), "{basis}: {said}");
        let (table, _) = ok(d, &["predict", "--model", "c.toml", "--points", "poses.csv", "--out", "-"]);
        let rows: Vec<Vec<&str>> = table.lines().skip(1).map(|l| l.split(',').collect()).collect();
        for [a, b] in [[0usize, 1], [2, 3], [4, 5], [5, 6]] {
            for (a, b) in rows[a].iter().zip(&rows[b]).skip(1).take(6) {
                let [a, b] = [a, b].map(|field| field.parse::<f64>().unwrap());
                assert!((a - b).abs() < 1e-5, "{basis}: {table}");
            }
        }
        assert!(!table.contains("out-of-range"), "{basis}: {table}");
    }
    // half a turn is no turn: it ends where it was measured
    let half: String = turn()
        .lines()
        .filter(|l| l.split(',').next().unwrap().parse().map_or(true, |q: f64| q < 200.0))
        .fold(String::new(), |all, l| all + l + "\n");
    write(d, "half.csv", &half);
    let (_, said) = ok(
        d,
        &[
            "fit",
            "--errors",
            "half.csv",
            "--axis",
            "c",
            "--chain",
            "[w C' b X Y Z t]",
            "--travel",
            "c=-360:360",
            "--out",
            "h.toml",
        ],
    );
    assert!(!said.contains("repeats"), "{said}");
}

#[test]
fn a_point_on_a_rotary_axis_that_nobody_stated_is_noted() {
    let folder = tempfile::tempdir().unwrap();
    let d = folder.path();
    write(d, "c.csv", &turn());
    let fit = ["fit", "--errors", "c.csv", "--axis", "c", "--chain", "[w C' b X Y Z t]", "--out", "c.toml"];
    let (_, said) = ok(d, &fit);
    assert!(said.contains("c.toml: [axes.c] point-mm = [0, 0, 0] is an assumption"), "{said}");
    // once it stands in the model, it is what the user wants
    let (_, said) = ok(d, &["fit", "--errors", "c.csv", "--axis", "c", "--into", "c.toml"]);
    assert!(!said.contains("assumption"), "{said}");
}

#[test]
fn a_step_cycle_needs_its_directions() {
    let folder = tempfile::tempdir().unwrap();
    let d = folder.path();
    let rows = "0,1.5\n0,1.5\n0,-1.5\n0,-1.5\n100,2.5\n100,2.5\n100,-0.5\n100,-0.5\n";
    write(d, "step.csv", &format!("pos,err\n{rows}"));
    let map = "target=pos:mm,deviation=err:um";
    let said = refused(d, &["import", "step.csv", "--columns", map, "--out", "out.csv"]);
    assert!(
        said.contains("step.csv:3: target 0 mm follows itself") && said.contains("direction=NAME"),
        "{said}"
    );
    assert!(!d.join("out.csv").exists());
    let signs = [1, 1, -1, -1, 1, 1, -1, -1];
    let rows: String = rows.lines().zip(signs).fold(String::new(), |all, (l, s)| format!("{all}{l},{s}\n"));
    write(d, "step.csv", &format!("pos,err,dir\n{rows}"));
    ok(d, &["import", "step.csv", "--columns", &format!("{map},direction=dir"), "--out", "out.csv"]);
    let text = std::fs::read_to_string(d.join("out.csv")).unwrap();
    assert_eq!(text.lines().filter(|l| l.split(',').nth(1) == Some("-1")).count(), 4, "{text}");
}

/// Four diagonals of a box of 400 mm, out and back, three cycles; `bump_um` half way along.
fn diagonals(bump_um: f64) -> String {
    let length = 400.0 * 3f64.sqrt();
    let mut text = "diagonal,cycle,direction,target_mm,deviation_um\n".to_owned();
    for name in ["ppp", "npp", "pnp", "ppn"] {
        for cycle in 1..=3 {
            for (direction, order) in [(1, [0, 1, 2, 3, 4]), (-1, [4, 3, 2, 1, 0])] {
                for i in order {
                    let noise = 0.2 * f64::from((i * 7 + cycle * 3) % 5 - 2);
                    let value = noise + if i == 2 { bump_um } else { 0.0 };
                    let target = length * f64::from(i) / 4.0;
                    writeln!(text, "{name},{cycle},{direction},{target},{value}").unwrap();
                }
            }
        }
    }
    text
}

#[test]
fn diagonals_that_contradict_the_model_enlarge_the_uncertainty() {
    let folder = tempfile::tempdir().unwrap();
    let d = folder.path();
    let mut model =
        "format = \"volcomp-model/1\"\nmachine = \"vmc\"\nchain = \"[w X' b Y Z t]\"\n".to_owned();
    for axis in ["x", "y", "z"] {
        for error in ["ex", "ey", "ez", "ea", "eb", "ec"] {
            let unit = if ["ex", "ey", "ez"].contains(&error) { "um" } else { "arcsec" };
            writeln!(model, "[errors.{error}{axis}.table]\nposition-mm = [0, 400]\nvalue-{unit} = [0, 0]")
                .unwrap();
        }
    }
    write(d, "model.toml", &model);
    let run = |bump: f64| {
        write(d, "d.csv", &diagonals(bump));
        let args = [
            "identify",
            "diagonals",
            "--data",
            "d.csv",
            "--box-mm=400,400,400",
            "--model",
            "model.toml",
            "--out",
            "out.toml",
            "--json",
        ];
        let (out, said) = ok(d, &args);
        assert!(!said.contains("no --chain given"), "{said}");
        (serde_json::from_str::<Value>(&out).unwrap(), said)
    };
    let (good, said) = run(0.0);
    assert!(!said.contains("warning"), "{said}");
    assert_eq!((&good["steps_passed"], &good["enlarged"]), (&Value::Bool(true), &serde_json::json!(1.0)));
    let (bad, said) = run(12.0);
    assert!(
        said.contains("d.csv: 12 steps between the ends lie") && said.contains("346.410 mm: +11."),
        "{said}"
    );
    assert_eq!(bad["steps_passed"], false);
    let std = |v: &Value| v["ec0y_std_arcsec"].as_f64().unwrap();
    let factor = bad["enlarged"].as_f64().unwrap();
    assert!(factor > 5.0 && (std(&bad) / std(&good) - factor).abs() < 0.01 * factor, "{good} {bad}");
}

#[test]
fn lines_that_contradict_each_other_enlarge_the_uncertainty() {
    let folder = tempfile::tempdir().unwrap();
    let d = folder.path();
    write(d, "lines.csv", "line,x_mm,y_mm,z_mm\n1,40,-150,-90\n2,40,150,-90\n3,40,0,160\n");
    let run = |fault: f64| {
        let heads = ["1", "2", "3"].map(|l| ["x", "y", "z"].map(|c| format!("{l}_d{c}_um")).join(","));
        let mut text = format!("position_mm,{}\n", heads.join(","));
        for i in 0..6 {
            let mut values = [0.0; 9];
            for (k, v) in values.iter_mut().enumerate() {
                *v = 0.1 * (((7 * k + 5 * i) % 5) as f64 - 2.0);
            }
            if i == 3 {
                values[4] += fault;
            }
            writeln!(text, "{},{}", 100 * i, values.map(|v| v.to_string()).join(",")).unwrap();
        }
        write(d, "x.csv", &text);
        let args = [
            "identify",
            "nineline",
            "--axis",
            "x",
            "--lines",
            "lines.csv",
            "--data",
            "x.csv",
            "--noise-um",
            "0.2",
            "--json",
        ];
        let (out, said) = ok(d, &args);
        (serde_json::from_str::<Value>(&out).unwrap(), said)
    };
    let (good, said) = run(0.0);
    assert!(good["enlarged"] == 1.0 && !said.contains("contradict"), "{said}");
    let (bad, said) = run(20.0);
    assert!(
        said.contains("2_dy_um at 300 mm") && said.contains("uncertainties given are enlarged"),
        "{said}"
    );
    let sigma = |v: &Value| v["motions"]["sigma"][0].as_f64().unwrap();
    let factor = bad["enlarged"].as_f64().unwrap();
    assert!(factor > 3.0 && (sigma(&bad) / sigma(&good) - factor).abs() < 0.01 * factor, "{good} {bad}");
}

#[test]
fn a_ballbar_run_against_its_direction_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let d = folder.path();
    let mut text = "angle_deg,deviation_um,direction\n".to_owned();
    for (direction, order) in [(-1, 1), (1, -1)] {
        for k in 0..=360 {
            writeln!(text, "{},0.1,{direction}", if order > 0 { k } else { 360 - k }).unwrap();
        }
    }
    write(d, "xy.csv", &text);
    let said = refused(d, &["identify", "ballbar", "--data", "xy=xy.csv", "--radius-mm", "150"]);
    assert!(
        said.contains(
            "xy.csv:2: angle_deg increases by 360 deg over the run that begins here, against its direction -1"
        ) && said.contains("exchange 1 and -1"),
        "{said}"
    );
}

#[test]
fn a_circle_may_have_runs() {
    let folder = tempfile::tempdir().unwrap();
    let d = folder.path();
    write(d, "m.toml", "format = \"volcomp-model/1\"\nmachine = \"m\"\nchain = \"[w b X Y Z t]\"\n");
    let mut text = "angle_deg,deviation_um,direction,run\n".to_owned();
    for k in 0..360 {
        writeln!(text, "{k},0.1,1,1").unwrap();
    }
    write(d, "c.csv", &text);
    ok(d, &["predict", "--model", "m.toml", "--circle", "c.csv", "--centre-mm=0,0,0", "--radius-mm=100"]);
}

#[test]
fn a_plate_with_exchanged_columns_or_units_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let d = folder.path();
    let plate = |nominal: fn(f64, f64) -> [f64; 2], factor: f64| {
        let mut text = "nominal_x_mm,nominal_y_mm,measured_x_mm,measured_y_mm\n".to_owned();
        for i in 0..16 {
            let (x, y) = (100.0 * f64::from(i % 4), 80.0 * f64::from(i / 4));
            let [a, b] = nominal(x, y);
            writeln!(text, "{a},{b},{},{}", factor * x + 0.001, factor * y).unwrap();
        }
        text
    };
    write(d, "p.csv", &plate(|x, y| [x, y], 1.0));
    ok(d, &["evaluate", "plate", "--data", "p.csv"]);
    write(d, "p.csv", &plate(|x, y| [y, x], 1.0));
    let said = refused(d, &["evaluate", "plate", "--data", "p.csv"]);
    assert!(said.contains("exchanged"), "{said}");
    write(d, "p.csv", &plate(|x, y| [x, y], 1000.0));
    let said = refused(d, &["evaluate", "plate", "--data", "p.csv"]);
    assert!(said.contains("p.csv: measured places are 1000.0000 times the nominal ones"), "{said}");
}

#[test]
fn two_measurements_of_different_ranges_are_noted() {
    let folder = tempfile::tempdir().unwrap();
    let d = folder.path();
    let test = |step: f64| {
        let mut text = "cycle,direction,target_mm,deviation_um\n".to_owned();
        for cycle in 1..=3 {
            for (direction, order) in [(1, [0, 1, 2, 3, 4, 5]), (-1, [5, 4, 3, 2, 1, 0])] {
                for i in order {
                    let value = f64::from(i) + 0.1 * f64::from((i + cycle) % 3);
                    writeln!(text, "{cycle},{direction},{},{value}", step * f64::from(i)).unwrap();
                }
            }
        }
        text
    };
    write(d, "long.csv", &test(200.0));
    write(d, "short.csv", &test(100.0));
    let (_, said) = ok(d, &["verify", "--before", "long.csv", "--after", "short.csv"]);
    assert!(said.contains("before covers 0 to 1000 mm, after 0 to 500 mm"), "{said}");
    write(d, "later.csv", &test(199.0));
    let (_, said) = ok(d, &["verify", "--before", "long.csv", "--after", "later.csv"]);
    assert!(!said.contains("covers"), "{said}");
    std::fs::copy(d.join("long.csv"), d.join("copy.csv")).unwrap();
    let output = volcomp(d, &["verify", "--before", "long.csv", "--after", "copy.csv"]);
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(65));
    assert!(said.contains("copy.csv: holds the same data as long.csv"), "{said}");
}

#[test]
fn exchanged_columns_of_a_motion_table_are_noted() {
    let folder = tempfile::tempdir().unwrap();
    let d = folder.path();
    let mut text = "exx_um,position_mm\n".to_owned();
    for i in 0..20 {
        writeln!(text, "{},{}", 10 * i, f64::from((7 * i) % 11) * 0.3 + 0.01 * f64::from(i)).unwrap();
    }
    write(d, "x.csv", &text);
    let args =
        |file| ["fit", "--errors", file, "--axis", "x", "--chain", "[w X' b Y Z t]", "--out", "x.toml"];
    let (_, said) = ok(d, &args("x.csv"));
    assert!(said.contains("x.csv: EXX rises in equal steps and position_mm does not"), "{said}");
    write(d, "y.csv", &text.replace("exx_um,position_mm", "position_mm,exx_um"));
    let (_, said) = ok(d, &args("y.csv"));
    assert!(!said.contains("exchanged"), "{said}");
}

/// Four points on a carriage that moves along X, seen at places `seen(position)` times the move.
fn points(seen: f64, fault_mm: f64) -> String {
    let mut text =
        "position_mm,p_x_mm,p_y_mm,p_z_mm,q_x_mm,q_y_mm,q_z_mm,r_x_mm,r_y_mm,r_z_mm,s_x_mm,s_y_mm,s_z_mm\n"
            .to_owned();
    for i in 0..10 {
        let position = 80.0 * f64::from(i);
        let mut fields = vec![position];
        for (k, [x, y, z]) in [[0.0, 0.0, 0.0], [300.0, 0.0, 20.0], [0.0, 250.0, 0.0], [280.0, 240.0, 90.0]]
            .into_iter()
            .enumerate()
        {
            let noise = 0.001 * (((3 * i + 5 * k as i32) % 3) as f64 - 1.0);
            let fault = if i == 6 && k == 2 { fault_mm } else { 0.0 };
            fields.extend([x + seen * position + noise, y - noise, z + fault]);
        }
        writeln!(text, "{}", fields.iter().map(f64::to_string).collect::<Vec<_>>().join(",")).unwrap();
    }
    text
}

#[test]
fn points_that_do_not_follow_the_axis_and_a_single_outlier_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let d = folder.path();
    write(d, "p.csv", "point,x_mm,y_mm,z_mm\np,0,0,0\nq,300,0,20\nr,0,250,0\ns,280,240,90\n");
    let args = [
        "identify",
        "threepoint",
        "--axis",
        "x",
        "--points",
        "p.csv",
        "--data",
        "x.csv",
        "--chain",
        "[w b X Y Z t]",
        "--noise-um",
        "2",
        "--json",
    ];
    for seen in [0.0, 0.001, -1.0] {
        write(d, "x.csv", &points(seen, 0.0));
        let said = refused(d, &args);
        assert!(
            said.contains("it looks like the position itself") && said.contains("--axis x right"),
            "{said}"
        );
    }
    write(d, "x.csv", &points(1.0, 0.0));
    let (_, said) = ok(d, &args);
    assert!(!said.contains("warning"), "{said}");
    write(d, "x.csv", &points(1.0, 0.1));
    let (out, said) = ok(d, &args);
    assert!(said.contains("(1 of 10 rows fail, worst row 7 at 480 mm, chi2"), "{said}");
    let report: Value = serde_json::from_str(&out).unwrap();
    assert_eq!(report["rigidity"]["worst_row"], 7);
}

#[test]
fn a_column_in_another_unit_is_noted_or_refused_alike() {
    let folder = tempfile::tempdir().unwrap();
    let d = folder.path();
    let test = |scale: f64| {
        let mut text = "cycle,direction,target_mm,deviation_um\n".to_owned();
        for (cycle, i) in (1..=5).flat_map(|cycle| (0..6).map(move |i| (cycle, i))) {
            let value = scale * (f64::from(i) + 0.1 * f64::from((i + cycle) % 3));
            writeln!(text, "{cycle},1,{},{value}", 100 * i).unwrap();
        }
        text
    };
    write(d, "mm.csv", &test(1e-3));
    write(d, "nm.csv", &test(2e3));
    for (name, code, place, named) in [
        ("mm.csv", 0, "mm.csv: ", "(largest 0.0052 µm): is "),
        (
            "nm.csv",
            65,
            "nm.csv:19: ",
            "reaches 10400 µm; the limit is 5000 µm: were these values in nm, not in µm?",
        ),
    ] {
        for args in [
            &["evaluate", "iso230-2", "--data", name][..],
            &["fit", "--axis", "x", "--errors", name, "--out", "m.toml"],
        ] {
            let output = volcomp(d, args);
            let said = String::from_utf8_lossy(&output.stderr);
            assert_eq!(output.status.code(), Some(code), "{args:?}: {said}");
            assert!(said.contains(place) && said.contains(named), "{args:?}: {said}");
        }
    }
}

/// Two runs of an axis with an error motion of each quantity: a scale, a bow and a pitch.
fn motions([scale_um_per_m, bow_um, pitch_arcsec_per_m]: [f64; 3]) -> String {
    let mut text = "position_mm,cycle,exx_um,eyx_um,eax_arcsec\n".to_owned();
    for (cycle, shift) in [(1, 0.05), (2, -0.05)] {
        for x in (0..=800).step_by(100).map(f64::from) {
            let bow = bow_um * (1.0 - (x / 400.0 - 1.0).powi(2)) + shift;
            let [scale, pitch] = [scale_um_per_m, pitch_arcsec_per_m].map(|v| 1e-3 * v * x + shift);
            writeln!(text, "{x},{cycle},{scale},{bow},{pitch}").unwrap();
        }
    }
    text
}

#[test]
fn error_motions_of_one_quantity_are_verified_about_what_they_count_from() {
    let folder = tempfile::tempdir().unwrap();
    let d = folder.path();
    write(d, "before.csv", &motions([40.0, 5.0, 4.0]));
    write(d, "after.csv", &motions([1.0, 0.5, 0.0]));
    let args = |more: &[&'static str]| {
        [&["verify", "--before", "before.csv", "--after", "after.csv"], more].concat()
    };
    let said = refused(d, &args(&[]));
    assert!(
        said.contains("before.csv: exx_um (positioning) and eyx_um (straightness) have no range"),
        "{said}"
    );
    assert!(said.contains("--columns exx_um"), "{said}");
    for (column, test, [before, after]) in [
        ("exx_um", "positioning", [32.0, 0.8]),
        ("eyx_um", "straightness", [5.0, 0.5]),
        ("eax_arcsec", "angular", [3.2, 0.0]),
    ] {
        let (out, _) = ok(d, &args(&["--columns", column, "--json"]));
        let out: Value = serde_json::from_str(&out).unwrap();
        assert_eq!(out["test"], test);
        let unit = if test == "angular" { "arcsec" } else { "um" };
        for (key, wanted) in [("before", before), ("after", after)] {
            let range = out["range"][format!("{key}_{unit}")].as_f64().unwrap();
            assert!((range - wanted).abs() < 1e-9, "{column} {key}: {range}");
        }
    }
    assert!(refused(d, &args(&["--columns", "ezx_um"])).contains("ezx_um"));
}

#[test]
fn readings_that_stand_twice_or_are_missing_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let d = folder.path();
    let header = "cycle,direction,target_mm,deviation_um\n".to_owned();
    let rows: Vec<String> = (1..=5)
        .flat_map(|cycle| {
            [0, 100, 200].map(|target| format!("{cycle},1,{target},{}\n", (target + cycle) % 7))
        })
        .collect();
    let evaluate = ["evaluate", "iso230-2", "--data", "x.csv"];
    // the third row of the second cycle once more
    write(d, "x.csv", &(header.clone() + &rows.concat() + &rows[5]));
    let said = refused(d, &evaluate);
    assert!(
        said.contains("x.csv:17: cycle 2, direction 1, target 200 mm stands in line 7, too; remove one"),
        "{said}"
    );
    let without = [&rows[..5], &rows[6..]].concat().concat();
    write(d, "x.csv", &(header.clone() + &without));
    let (_, said) = ok(d, &evaluate);
    assert!(said.contains("x.csv: no reading of cycle 2, direction 1, target 200 mm\n"), "{said}");
    write(d, "x.csv", &(header + &rows.concat()));
    let (_, said) = ok(d, &evaluate);
    assert!(!said.contains("no reading of"), "{said}");
}
