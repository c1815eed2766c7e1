//! `volcomp import` and `volcomp export` from the outside: files in, tables and models out, and back.

#![expect(
    clippy::unwrap_used,
    clippy::disallowed_methods,
    reason = "a test reads files, and stops where its own set-up is wrong"
)]

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use tempfile::TempDir;

fn volcomp(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_volcomp")).args(args).output().unwrap()
}

fn ok(args: &[&str]) -> String {
    let out = volcomp(args);
    let stderr = String::from_utf8(out.stderr).unwrap();
    assert!(out.status.success(), "{args:?}: {stderr}");
    stderr
}

/// Runs, expects a failure, and gives its message.
fn fails(code: i32, args: &[&str]) -> String {
    let out = volcomp(args);
    let stderr = String::from_utf8(out.stderr).unwrap();
    assert_eq!(out.status.code(), Some(code), "{args:?}: {stderr}");
    assert!(out.stdout.is_empty());
    stderr
}

fn fixture(name: &str) -> String {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/formats").join(name).display().to_string()
}

/// A folder, and paths in it as text.
struct Scratch(TempDir);

impl Scratch {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }
    fn path(&self, name: &str) -> String {
        self.0.path().join(name).display().to_string()
    }
    fn write(&self, name: &str, text: impl AsRef<[u8]>) -> String {
        fs::write(self.0.path().join(name), text).unwrap();
        self.path(name)
    }
    fn read(&self, name: &str) -> String {
        fs::read_to_string(self.0.path().join(name)).unwrap()
    }
    fn names(&self) -> Vec<PathBuf> {
        fs::read_dir(self.0.path()).unwrap().map(|e| e.unwrap().path()).collect()
    }
}

const ISG: &str = "// two axes\nX EXX EYX ECX\n0.0 0.0 0.0 0.0\n100.0 0.005 -0.002 0.00001\n300.0 0.001 0.004 -0.00002\n#\nZ X EZX\n-200 0 0.001\n-200 300 0.002\n0 0 0.0\n0 300 0.004\n#\nC0Y\n0.00003\n";

#[test]
fn a_laser_test_becomes_the_products_table() {
    let s = Scratch::new();
    let said = ok(&["import", &fixture("laser-x.rtl"), "--out", &s.path("x.csv")]);
    for expected in [
        "Renishaw laser test (.rtl)",
        "machine VMC 850",
        "5 targets, 4 runs, both ways",
        "air 20.34 to 20.38 degC",
        "sensors that were not there: Mat temp 2, Mat temp 3",
        "20 readings at 5 positions from -100 to 100 mm, 2 cycles, 10 of them towards minus",
        "rows stand in the order measured; no time per reading",
    ] {
        assert!(said.contains(expected), "{expected}: {said}");
    }
    let table = s.read("x.csv");
    // the runs in their order, though the second stands first in the file
    let runs: Vec<&str> = table.lines().collect();
    assert_eq!(runs[..3], ["cycle,direction,target_mm,deviation_um", "1,1,-100,0", "1,1,-50,1.2"], "{table}");
    assert_eq!(runs[5..8], ["1,1,100,4.7", "1,-1,100,4.2", "1,-1,50,3.1"], "{table}");
    // the same figures straight from the file, through the table, and through a fit
    let direct = volcomp(&["evaluate", "iso230-2", "--data", &fixture("laser-x.rtl"), "--json"]);
    let through = volcomp(&["evaluate", "iso230-2", "--data", &s.path("x.csv"), "--json"]);
    assert!(direct.status.success(), "{}", String::from_utf8_lossy(&direct.stderr));
    let figures = |o: &Output| {
        serde_json::from_slice::<serde_json::Value>(&o.stdout).unwrap()["m_um"].as_f64().unwrap()
    };
    assert!((figures(&direct) - figures(&through)).abs() < 1e-9 && figures(&direct) > 0.0);
    ok(&[
        "fit",
        "--errors",
        &fixture("laser-x.rtl"),
        "--axis",
        "x",
        "--basis",
        "table",
        "--out",
        &s.path("m.toml"),
    ]);
    // and back into the instrument's format
    ok(&["export", &s.path("m.toml"), "--format", "rtl", "--axis", "x", "--out", &s.path("back.rtl")]);
    ok(&["import", &s.path("back.rtl"), "--out", &s.path("back.csv")]);
    let back = s.read("back.csv");
    assert_eq!(back.lines().count(), 11);
    assert!(back.contains("1,1,-50,1.25\n") && back.contains("1,-1,100,4.25\n"), "{back}");
}

#[test]
fn a_logger_test_keeps_the_order_measured_and_its_start_up_outliers() {
    let s = Scratch::new();
    let said = ok(&["import", &fixture("sessions/stage.dat"), "--out", &s.path("x.csv")]);
    for expected in [
        "rows stand in the order of the standard test cycle; no time per reading",
        "stage.dat:12: start-up outlier at 5 mm forward, cycle 1: 84.1 µm, +89.8 µm from the median of the other cycles",
        "stage.dat:13: start-up outlier at 17.5 mm forward, cycle 1",
        "kept; accuracy A ",
    ] {
        assert!(said.contains(expected), "{expected}: {said}");
    }
    let rows: Vec<Vec<f64>> =
        s.read("x.csv").lines().skip(1).map(|l| l.split(',').map(|f| f.parse().unwrap()).collect()).collect();
    assert_eq!(rows.len(), 50, "no reading is removed");
    assert!(rows.windows(2).all(|w| w[1][0] >= w[0][0]), "cycle by cycle");
    for pass in rows.chunks(5) {
        assert!(pass.windows(2).all(|w| (w[1][2] - w[0][2]) * w[0][1] > 0.0), "along the travel: {pass:?}");
    }
    // a test without them has no warning
    assert!(!ok(&["import", &fixture("laser-x.rtl"), "--out", &s.path("y.csv")]).contains("start-up"));
}

#[test]
fn a_rotary_laser_test_needs_its_unit() {
    let s = Scratch::new();
    let text = fs::read_to_string(fixture("laser-x.rtl")).unwrap().replace("Axis: X", "Axis: C");
    let c = s.write("c.rtl", text);
    let out = s.path("c.csv");
    assert!(fails(64, &["import", &c, "--out", &out]).contains("give --deviation-unit mrad, urad or arcsec"));
    assert!(
        fails(64, &["evaluate", "iso230-2", "--data", &c])
            .contains("volcomp import --axis c --deviation-unit")
    );
    ok(&["import", &c, "--deviation-unit", "arcsec", "--out", &out]);
    let table = s.read("c.csv");
    assert!(table.starts_with("cycle,direction,target_deg,deviation_arcsec\n1,1,-100,"), "{table}");
    assert!(table.contains("\n1,-1,100,4.2\n"), "{table}");
}

#[test]
fn damaged_files_name_the_place_and_leave_nothing() {
    let good = fs::read_to_string(fixture("laser-x.rtl")).unwrap();
    let edge = fs::read_to_string(fixture("sinumerik-840dsl/capture.json")).unwrap();
    for (name, text, expected) in [
        ("a.rtl", good.replace("1 3 1.900", "1 3 1.9oo"), "a.rtl:35:5: '1.9oo' is not a finite number"),
        ("b.rtl", good[..good.find("4 2 0.6").unwrap()].to_owned(), "readings: 20 announced, 18 found"),
        ("c.json", edge[..edge.len() / 2].to_owned(), "c.json:"),
        (
            "d.b5r",
            "<A><FEATURE NAME=\"a\" DT=\"UT_ANGLE\">x</FEATURE></A>".to_owned(),
            "d.b5r:1:4: 'x' is not",
        ),
        ("e.pos", "Position   \tBidirectional Avg Error\n0 y\n".to_owned(), "e.pos:2:3: 'y' is not"),
        ("f.log", "A 2022-11-08 10:00:00.0 1\nB 2022-11-08 10:00 on\n".to_owned(), "f.log:2:20: 'on' is not"),
    ] {
        let s = Scratch::new();
        let file = s.write(name, text);
        let message = fails(65, &["import", &file, "--out", &s.path("out.csv")]);
        assert!(message.contains(expected), "{message}");
        assert_eq!(s.names(), [PathBuf::from(&file)], "{name} left something behind");
    }
}

#[test]
fn an_edge_capture_keeps_its_gap_apart() {
    let s = Scratch::new();
    let capture = fixture("sinumerik-840dsl/capture.json");
    let said = ok(&["import", &capture, "--axes", "x=1,c=4", "--out", &s.path("run.csv")]);
    assert!(said.contains("gap: 3859 cycles (7.718 s) missing after row 20"), "{said}");
    assert!(said.contains("not kept: 1 HFTimestamp"), "{said}");
    let table = s.read("run.csv");
    let mut lines = table.lines();
    assert_eq!(lines.next(), Some("t_s,segment,cycle,x_enc_pos_mm,c_enc_pos_deg,x_des_pos_mm,c_des_pos_deg"));
    let rows: Vec<Vec<f64>> = lines.map(|l| l.split(',').map(|v| v.parse().unwrap()).collect()).collect();
    assert_eq!(rows.len(), 40);
    assert_eq!((rows[19][1], rows[20][1]), (0.0, 1.0));
    assert!((rows[20][0] - rows[19][0] - 7.72).abs() < 1e-9);
    ok(&["import", &capture, "--out", &s.path("all.csv")]);
    assert!(s.read("all.csv").starts_with("t_s,segment,cycle,enc_pos_1_mm_or_deg,"));
    let message = fails(64, &["import", &capture, "--axes", "x=9", "--out", &s.path("no.csv")]);
    assert!(message.contains("the capture has axes [1, 2, 4, 6]"), "{message}");
}

#[test]
#[cfg_attr(
    not(data_sinumerik_edge_capture),
    ignore = "needs ../shared/data/sinumerik_edge_capture or VOLCOMP_DATA"
)]
fn the_whole_capture_reads_like_its_published_extract() {
    let set = Path::new(env!("VOLCOMP_DATA_FOLDER")).join("sinumerik_edge_capture");
    let capture = set.join("capture_840Dsl.json");
    let s = Scratch::new();
    ok(&["import", &capture.display().to_string(), "--axes", "x=1,y=2", "--out", &s.path("run.csv")]);
    let column = |text: &str, name: &str| -> Vec<f64> {
        let index = text.lines().next().unwrap().split(',').position(|c| c == name).unwrap();
        text.lines().skip(1).map(|l| l.split(',').nth(index).unwrap().parse().unwrap()).collect()
    };
    let ours = s.read("run.csv");
    let extract = fs::read_to_string(set.join("capture_linear_axes.csv")).unwrap();
    for (our, theirs) in [("cycle", "CYCLE"), ("x_des_pos_mm", "DES_POS|1"), ("y_enc_pos_mm", "ENC_POS|2")] {
        assert_eq!(column(&ours, our), column(&extract, theirs), "{our}");
    }
}

#[test]
fn ballbar_figures_as_table_and_as_json() {
    let s = Scratch::new();
    let file = s.write("t.b5r", "<B><T TEST_PLANE=\"XY\"/><OPERATOR>ann</OPERATOR>\n<FEATURE NAME=\"AF_SQUARENESS\" DT=\"UT_SQUARENESS\">-12.5</FEATURE></B>");
    ok(&["import", &file, "--out", &s.path("t.csv")]);
    assert_eq!(s.read("t.csv"), "feature,value,unit\nAF_SQUARENESS,-12.5,um/m\n");
    ok(&["import", &file, "--out", &s.path("t.json")]);
    let json: serde_json::Value = serde_json::from_str(&s.read("t.json")).unwrap();
    assert_eq!((json["plane"].as_str(), json["features"][0]["value"].as_f64()), (Some("XY"), Some(-12.5)));
}

#[test]
fn any_table_through_a_column_map() {
    let s = Scratch::new();
    let file = s.write("soll.csv", "Messung 7\r\n\r\nSoll;Ist;Abw\r\n0,0;0,001;1\r\n10,0;10,003;3\r\n20,0;20,004;4\r\n20,0;20,003;3\r\n10,0;10,001;1\r\n0,0;0,0;0\r\n");
    let map = ["--delimiter", ";", "--decimal-comma", "--skip-lines", "2"];
    let mut args = vec!["import", &file, "--columns", "target=Soll:mm,deviation=Abw:um", "--out"];
    let out = s.path("a.csv");
    args.push(&out);
    args.extend(map);
    assert!(ok(&args).contains("cycles and directions from the order of the positions"));
    let expected = "cycle,direction,target_mm,deviation_um\n1,1,0,1\n1,1,10,3\n1,1,20,4\n1,-1,20,3\n1,-1,10,1\n1,-1,0,0\n";
    assert_eq!(s.read("a.csv"), expected);
    let toml = s.write("map.toml", "delimiter = \";\"\ndecimal-comma = true\nskip-lines = 2\n[columns]\ntarget = \"Soll:mm\"\nactual = \"Ist:mm\"\n");
    ok(&["import", &file, "--map", &toml, "--out", &s.path("b.csv")]);
    assert_eq!(s.read("b.csv"), expected);
    let bad = s.write("bad.toml", "delimiter = \";\"\nskip = 2\n[columns]\ntarget = \"Soll:mm\"\n");
    assert!(
        fails(65, &["import", &file, "--map", &bad, "--out", &s.path("c.csv")])
            .contains("bad.toml:2:1: unknown field `skip`")
    );
    // a capture of a tracker: stamps become seconds
    let tracker = s.write(
        "t.csv",
        b"X [mm];Tilt\xb0;Zeit\n1.5;0;'08.11.2022 15:23:24.953\n1.75;0;'08.11.2022 15:23:25.953\n",
    );
    ok(&["import", &tracker, "--columns", "t_s=Zeit:dmy,x_mm=X [mm]:mm", "--out", &s.path("d.csv")]);
    assert_eq!(s.read("d.csv"), "t_s,x_mm\n0,1.5\n1,1.75\n");
}

#[test]
fn a_volumetric_table_goes_in_and_comes_out_again() {
    let s = Scratch::new();
    let table = s.write("vc.csv", ISG);
    let chain = ["--chain", "[w X' b Y Z t]", "--machine", "m1"];
    let message = fails(64, &["import", &table, "--chain", "[w X' b Y Z t]", "--out", &s.path("m.toml")]);
    assert!(message.contains("vc.csv:2:3: the file does not say whose motion"), "{message}");
    for sense in ["relative", "carriage"] {
        let (model, again) = (s.path("m.toml"), s.path("again.csv"));
        let mut args = vec!["import", &table, "--sense", sense, "--out", &model];
        args.extend(chain);
        let said = ok(&args);
        assert!(
            said.contains("ISG volumetric compensation, 5 errors")
                && said.contains("EZX: grid, 2 along Z, 2 along X"),
            "{said}"
        );
        assert!(s.read("m.toml").contains("source-hash = \"blake3:"));
        ok(&["check", &model]);
        let said = ok(&["export", &model, "--format", "isg", "--sense", sense, "--out", &again]);
        assert!(said.contains("at most 0.000 µm from the model"), "{said}");
        let back = s.path("back.toml");
        let mut args = vec!["import", &again, "--sense", sense, "--out", &back];
        args.extend(chain);
        ok(&args);
        let twice = s.path("twice.csv");
        ok(&["export", &back, "--format", "isg", "--sense", sense, "--out", &twice]);
        assert_eq!(s.read("again.csv"), s.read("twice.csv"));
    }
    // what was read in one sense is the opposite in the other
    let relative = ok(&["export", &s.path("m.toml"), "--format", "isg", "--sense", "relative", "--out", "-"]);
    assert!(relative.contains("written: -"));
    let message = fails(64, &["export", &s.path("m.toml"), "--format", "isg", "--out", &s.path("no.csv")]);
    assert!(message.contains("axis X is on the workpiece side"), "{message}");
}

#[test]
fn tables_of_one_axis_go_in_and_come_out_again() {
    let s = Scratch::new();
    let comp = s.write("x.comp", "0 0 -0.001\n50 50.002 49.999\n100 100.004 100.001\n");
    let (model, chain) = (s.path("m.toml"), "[w b X Y Z t]");
    assert!(
        fails(64, &["import", &comp, "--format", "linuxcnc", "--axis", "x", "--out", &model])
            .contains("give --comp-type")
    );
    assert!(fails(64, &["import", &comp, "--out", &model]).contains("does not give its format away"));
    ok(&[
        "import",
        &comp,
        "--format",
        "linuxcnc",
        "--axis",
        "x",
        "--comp-type",
        "0",
        "--chain",
        chain,
        "--out",
        &model,
    ]);
    let export = |format: &str, more: &[&str], name: &str| {
        let out = s.path(name);
        let mut args = vec!["export", &model, "--format", format, "--axis", "x", "--out", &out];
        args.extend(more);
        ok(&args)
    };
    export("linuxcnc", &["--comp-type", "1"], "x1.comp");
    assert_eq!(
        s.read("x1.comp"),
        "0.000000 0.000000 0.001000\n50.000000 -0.002000 0.001000\n100.000000 -0.004000 -0.001000\n"
    );
    export("isg-lis", &[], "x.lis");
    assert!(
        s.read("x.lis").contains("kw.ssfk.table[1].pos 20\n")
            && s.read("x.lis").contains("kw.ssfk.table[2].neg 10\n")
    );
    export("heidenhain", &["--sign", "correction"], "x.com");
    assert!(
        s.read("x.com").contains("NR AXISPOS BACKLASH X\r\n")
            && s.read("x.com").contains("1 50.0000 0.0010 -0.0020\r\n")
    );
    let out = s.path("n.com");
    assert!(
        fails(64, &["export", &model, "--format", "heidenhain", "--axis", "x", "--out", &out])
            .contains("the sign of the values is not documented")
    );
    // all of them mean the same: back into models, and out as the same table
    let reads = [
        ("x1.comp", vec!["--format", "linuxcnc", "--comp-type", "1"]),
        ("x.lis", vec![]),
        ("x.com", vec!["--sign", "correction"]),
    ];
    export("csv", &[], "first.csv");
    for (name, more) in reads {
        let (file, back) = (s.path(name), s.path("back.toml"));
        let mut args = vec!["import", &file, "--axis", "x", "--chain", chain, "--out", &back];
        args.extend(more);
        ok(&args);
        ok(&["export", &back, "--format", "csv", "--axis", "x", "--out", &s.path("back.csv")]);
        assert_eq!(s.read("back.csv"), s.read("first.csv"), "{name}");
    }
    assert!(s.read("first.csv").starts_with("position_mm,exx_um,direction\n0,0,1\n50,2,1\n"));
}

#[test]
fn a_model_of_curves_is_sampled_to_the_tolerance() {
    let s = Scratch::new();
    let model = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("config/examples/vmc-850/model.toml")
        .display()
        .to_string();
    let out = s.path("y.comp");
    let said =
        ok(&["export", &model, "--format", "linuxcnc", "--axis", "y", "--comp-type", "0", "--out", &out]);
    assert!(
        said.contains("not in this file:") && said.contains("EXX") && said.contains("angular errors"),
        "{said}"
    );
    assert!(s.read("y.comp").lines().count() <= 256);
    let message = fails(
        65,
        &[
            "export",
            &model,
            "--format",
            "heidenhain",
            "--sign",
            "deviation",
            "--axis",
            "x",
            "--tolerance-um",
            "0.001",
            "--out",
            &s.path("x.com"),
        ],
    );
    assert!(message.contains("heidenhain holds 256"), "{message}");
    assert_eq!(s.names().len(), 1);
    // the volumetric table of the whole machine predicts what the model predicts
    let table = s.path("vc.csv");
    ok(&["export", &model, "--format", "isg", "--sense", "carriage", "--out", &table]);
    let imported = s.path("imported.toml");
    let base = s.write(
        "base.toml",
        "format = \"volcomp-model/1\"\nmachine = \"vmc-850\"\nchain = \"[w X' Y' b Z t]\"\n[frame]\nworkpiece-origin-mm = [0, 0, -620]\ntool-tip-mm = [0, 0, -120]\n",
    );
    ok(&["import", &table, "--sense", "carriage", "--into", &base, "--out", &imported]);
    let points =
        s.write("p.csv", "x_mm,y_mm,z_mm\n0,0,0\n100,50,-20\n425,250,-250\n777,333,-444\n850,500,-500\n");
    let predict = |model: &str, name: &str| -> Vec<Vec<f64>> {
        ok(&["predict", "--model", model, "--points", &points, "--out", &s.path(name)]);
        let number = |v: &str| v.parse().unwrap();
        s.read(name).lines().skip(1).map(|l| l.split(',').take(9).map(number).collect()).collect()
    };
    for (a, b) in predict(&model, "a.csv").iter().zip(predict(&imported, "b.csv")) {
        for (k, (u, v)) in a.iter().zip(b).enumerate() {
            let limit = if k < 6 { 0.6 } else { 0.1 };
            assert!((u - v).abs() < limit, "column {k}: {u} and {v}");
        }
    }
}

#[test]
fn a_million_rows_in_seconds_and_bounded_memory() {
    let s = Scratch::new();
    let imported = |samples: u32| {
        let head = format!(
            "HEADER::\r\nFilename: a.rtx\r\nSample no: {samples}\r\nActual sample rate: 50000\r\nData:\r\n"
        );
        let mut bytes = head.into_bytes();
        for i in 0..samples {
            bytes.extend_from_slice(&f64::from(i % 977).mul_add(1e-6, 0.5).to_le_bytes());
        }
        bytes.extend_from_slice(b"\r\nEOF::\r\n");
        let file = s.write("a.rtx", bytes);
        let began = std::time::Instant::now();
        let said = ok(&["import", &file, "--out", &s.path("a.csv")]);
        (said, began.elapsed())
    };
    let (_, tenth) = imported(100_001);
    let (said, whole) = imported(1_000_001);
    assert!(whole < 40 * tenth, "{whole:?}, a tenth of it {tenth:?}: the time grows faster than the rows");
    assert!(said.contains("1000001 samples at 50000 Hz, 20.000 s"), "{said}");
    let text = s.read("a.csv");
    assert!(text.starts_with("t_s,displacement_mm\n0,0.5\n0.00002,0.500001\n"), "{}", &text[..60]);
    assert_eq!(text.lines().count(), 1_000_002);
}

#[test]
fn the_file_that_is_read_is_not_written_over() {
    let s = Scratch::new();
    let file = s.write("x.rtl", fs::read(fixture("laser-x.rtl")).unwrap());
    assert!(fails(64, &["import", &file, "--out", &file]).contains("is the file of <FILE>"));
    assert!(fails(64, &["import", &file]).contains("--out is not given"));
    assert!(fails(74, &["import", &s.path("no.rtl"), "--out", &s.path("x.csv")]).contains("no.rtl"));
}

#[test]
fn an_exported_recording_is_a_session_without_readings() {
    let s = Scratch::new();
    let recording = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/recordings/three-axes.vcrec");
    ok(&["export", recording, "--format", "csv", "--out", &s.path("r.csv")]);
    let said = fails(65, &["diagnose", "--data", &s.path("r.csv")]);
    assert!(
        said.contains("deviation_um is empty in every row; a recording of the daemon measures no deviation"),
        "{said}"
    );
}

#[test]
fn a_reversal_is_exported_by_direction_and_other_dynamic_terms_are_named() {
    let s = Scratch::new();
    let head = "format = \"volcomp-model/1\"\nmachine = \"m\"\nchain = \"[w b X Y Z t]\"\n[axes.x]\ntravel-mm = [0, 300]\n";
    let velocity = "[errors.exx.velocity]\ngain-um-s-per-mm = -4\nlimit-um = 50\n";
    let reversal = format!(
        "{head}[errors.exx.reversal]\nwidth-um = 12\nlimit-um = 6\n{velocity}[tool]\nspindle-tilt-arcsec = [5, 0]\n[frame]\ngauge-point-mm = [0, 0, 0]\ntool-tip-mm = [0, 0, -100]\n"
    );
    let model = s.write("m.toml", reversal);
    let args = ["export", &model, "--axis", "x", "--format"];
    let out = s.path("x.comp");
    let said = ok(&[&args[..], &["linuxcnc", "--comp-type", "0", "--out", &out]].concat());
    assert!(said.contains("not in this file: EXX velocity, [tool] spindle-tilt-arcsec\n"), "{said}");
    // as predict says: -6 um towards plus, +6 um towards minus
    assert_eq!(s.read("x.comp"), "0.000000 -0.006000 0.006000\n300.000000 299.994000 300.006000\n");
    ok(&[&args[..], &["heidenhain", "--sign", "deviation", "--out", &s.path("x.com")]].concat());
    assert!(s.read("x.com").contains("NR AXISPOS BACKLASH X\r\n0 0.0000 0.0060 -0.0060\r\n"));
    let said = fails(64, &[&args[..], &["isg", "--out", &s.path("no.csv")]].concat());
    assert!(said.contains("EXX differs between the directions of travel"), "{said}");
    let nothing = s.write("v.toml", format!("{head}{velocity}"));
    let said =
        fails(65, &["export", &nothing, "--axis", "x", "--format", "isg-lis", "--out", &s.path("no.lis")]);
    assert!(said.contains("no positioning error over the position of axis X"), "{said}");
}

#[test]
fn a_row_with_more_fields_than_the_header_is_refused() {
    let s = Scratch::new();
    let table = s.write("t.csv", "Soll [mm],Abw [um]\n100,5,2,5\n");
    let columns = "target=Soll [mm]:mm,deviation=Abw [um]:um";
    let said = fails(65, &["import", &table, "--columns", columns, "--out", &s.path("no.csv")]);
    assert!(
        said.contains("t.csv:2:1: 4 fields, the header has 2 columns; is there a decimal comma?"),
        "{said}"
    );
    let table = s.write("e.csv", "Soll [mm],Abw [um]\n100,5,\n200,6,\n300,7,\n");
    ok(&["import", &table, "--columns", columns, "--out", &s.path("e.out.csv")]);
}

#[test]
fn an_empty_file_is_bad_data() {
    let s = Scratch::new();
    let said = fails(65, &["import", &s.write("e.csv", ""), "--out", &s.path("no.csv")]);
    assert!(said.contains("e.csv: the file is empty"), "{said}");
}

#[test]
fn tables_in_utf_16_are_read() {
    let s = Scratch::new();
    let text: Vec<u16> = "\u{feff}t;d\r\n0;1,5\r\n10;2,5\r\n20;3,5\r\n".encode_utf16().collect();
    let little: Vec<u8> = text.iter().flat_map(|c| c.to_le_bytes()).collect();
    let big: Vec<u8> = text.iter().flat_map(|c| c.to_be_bytes()).collect();
    for bytes in [little, big] {
        for encoding in [&["--encoding", "utf-16"][..], &[]] {
            let (table, out) = (s.write("t.csv", &bytes), s.path("out.csv"));
            let args = ["import", &table, "--decimal-comma", "--columns", "target=t:mm,deviation=d:um"];
            ok(&[&args[..], encoding, &["--out", &out]].concat());
            assert_eq!(s.read("out.csv").lines().nth(1), Some("1,1,0,1.5"));
        }
    }
}
