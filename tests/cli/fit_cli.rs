//! `volcomp fit` from the outside: data to model file to prediction, reports, and bad input one by one.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
#![expect(clippy::disallowed_methods, reason = "the test writes and reads files")]

use std::path::Path;
use std::process::{Command, Output};

use serde_json::Value;
use volcomp::model::axes::Travel;
use volcomp::model::{ErrorSymbol, ModelSpec};

fn volcomp(directory: &Path, args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_volcomp")).current_dir(directory).args(args).output().unwrap()
}

fn succeed(directory: &Path, args: &[&str]) -> Output {
    let output = volcomp(directory, args);
    assert!(output.status.success(), "{args:?}: {}", String::from_utf8_lossy(&output.stderr));
    output
}

fn model(directory: &Path, name: &str) -> ModelSpec {
    let text = std::fs::read_to_string(directory.join(name)).unwrap();
    volcomp::config::model::parse(name, &text).unwrap_or_else(|e| panic!("{e}\n{text}"))
}

fn value_um(spec: &ModelSpec, symbol: &str, x: f64, travel: Travel) -> f64 {
    let symbol = ErrorSymbol::parse(symbol).unwrap();
    let (_, function) = spec.errors.iter().find(|(s, _)| *s == symbol).unwrap();
    function.value(x, travel) * 1e3
}

/// A smooth positioning error and a yaw, every 20 mm, three cycles.
fn motion() -> String {
    let mut csv = String::from("# laser, 2 runs\r\nposition_mm,exx_um,ecx_arcsec,cycle\r\n");
    for cycle in 1..=3 {
        for i in 0..26 {
            let x = f64::from(i) * 20.0;
            let wobble = f64::from((i * 7 + cycle * 3) % 5 - 2) * 0.05;
            let exx = 2.0 + 0.01 * x + 3.0 * (x / 160.0).sin() + wobble;
            csv.push_str(&format!("{x},{exx},{},{cycle}\r\n", 0.5 - x / 500.0));
        }
    }
    csv
}

#[test]
fn every_error_keeps_the_name_and_hash_of_its_own_data() {
    let directory = tempfile::tempdir().unwrap();
    let d = directory.path();
    std::fs::write(d.join("x.csv"), motion()).unwrap();
    std::fs::write(d.join("y.csv"), motion().replace("exx", "eyy").replace("ecx", "ecy")).unwrap();
    let fit =
        ["fit", "--axis", "x", "--errors", "x.csv", "--axis", "y", "--errors", "y.csv", "--out", "one.toml"];
    succeed(d, &fit);
    // a later fit replaces what it fits, and keeps where the rest came from
    succeed(d, &["fit", "--axis", "y", "--errors", "y.csv", "--into", "one.toml", "--out", "two.toml"]);
    for name in ["one.toml", "two.toml"] {
        let text = std::fs::read_to_string(d.join(name)).unwrap();
        let file = volcomp::config::model::parse_file(name, &text).unwrap();
        for (symbol, data) in [("exx", "x.csv"), ("ecx", "x.csv"), ("eyy", "y.csv"), ("ecy", "y.csv")] {
            let symbol = ErrorSymbol::parse(symbol).unwrap();
            let (_, from) = file.of_errors.iter().find(|(s, _)| *s == symbol).unwrap();
            let hash = format!("blake3:{}", blake3::hash(&std::fs::read(d.join(data)).unwrap()).to_hex());
            assert_eq!(from.source.as_deref(), Some(data), "{name} {symbol}");
            assert_eq!(from.source_hash.as_deref(), Some(hash.as_str()), "{name} {symbol}");
        }
    }
}

#[test]
fn every_basis_becomes_a_model_that_predicts() {
    let directory = tempfile::tempdir().unwrap();
    let d = directory.path();
    std::fs::write(d.join("m.csv"), motion()).unwrap();
    std::fs::write(d.join("p.csv"), "x_mm\n100\n333\n").unwrap();
    for basis in ["auto", "half-range", "chebyshev", "fourier", "table"] {
        succeed(
            d,
            &[
                "fit",
                "--errors",
                "m.csv",
                "--axis",
                "x",
                "--basis",
                basis,
                "--out",
                "model.toml",
                "--json",
                "r.json",
                "--machine",
                "m1",
            ],
        );
        let spec = model(d, "model.toml");
        assert_eq!(spec.machine, "m1");
        succeed(d, &["predict", "--model", "model.toml", "--points", "p.csv", "--out", "e.csv"]);
        let e = std::fs::read_to_string(d.join("e.csv")).unwrap();
        for (line, x) in e.lines().skip(1).zip([100.0f64, 333.0]) {
            let dx: f64 = line.split(',').nth(1).unwrap().parse().unwrap();
            let truth = 2.0 + 0.01 * x + 3.0 * (x / 160.0).sin();
            assert!((dx - truth).abs() < 0.15, "{basis} at {x}: {dx} instead of {truth}");
            assert!((dx - value_um(&spec, "exx", x, Travel::Forward)).abs() < 1e-6);
        }
    }
}

#[test]
fn the_report_has_the_keys_of_the_contract() {
    let directory = tempfile::tempdir().unwrap();
    let d = directory.path();
    std::fs::write(d.join("m.csv"), motion()).unwrap();
    succeed(
        d,
        &[
            "fit",
            "--errors",
            "m.csv",
            "--axis",
            "x",
            "--basis",
            "chebyshev",
            "--order",
            "5",
            "--out",
            "model.toml",
            "--json",
            "r.json",
        ],
    );
    let report: Value = serde_json::from_str(&std::fs::read_to_string(d.join("r.json")).unwrap()).unwrap();
    let exx = &report["exx"];
    let number = |key: &str| exx[key].as_f64().unwrap_or_else(|| panic!("{key} in {exx}"));
    assert_eq!(exx["basis"], "chebyshev");
    assert_eq!(exx["order"], 5);
    assert!(exx["period_mm"].is_null());
    assert_eq!(exx["coefficients"].as_array().unwrap().len(), 6);
    let (n, m) = (number("n"), number("m"));
    assert_eq!((n, m), (78.0, 6.0));
    let sse = number("sse_um2");
    assert!((number("rmse_n_um") - (sse / n).sqrt()).abs() < 1e-12);
    assert!((number("rmse_dof_um") - (sse / (n - m)).sqrt()).abs() < 1e-12);
    let k = m + 1.0;
    let aicc = n * (sse / n).ln() + 2.0 * k + 2.0 * k * (k + 1.0) / (n - k - 1.0);
    assert!((number("aicc") - aicc).abs() < 1e-6);
    assert!(number("r2") > 0.9 && number("emax_um") < 1.5 && number("loo_rmse_um") > number("rmse_n_um"));
    for key in ["sse_arcsec2", "rmse_n_arcsec", "rmse_dof_arcsec", "emax_arcsec", "loo_rmse_arcsec"] {
        assert!(report["ecx"][key].is_number(), "{key}");
    }
}

#[test]
fn a_fitted_period_is_found_and_given_periods_are_kept() {
    let directory = tempfile::tempdir().unwrap();
    let d = directory.path();
    let mut csv = String::from("position_mm,exx_um\n");
    for i in 0..61 {
        let x = f64::from(i) * 10.0;
        csv.push_str(&format!(
            "{x},{}\n",
            4.0 * (core::f64::consts::TAU * x / 87.0).sin() + 0.1 * f64::from((i * i) % 7)
        ));
    }
    std::fs::write(d.join("m.csv"), csv).unwrap();
    let args = [
        "fit", "--errors", "m.csv", "--axis", "x", "--basis", "fourier", "--order", "1", "--out", "o.toml",
        "--json", "r.json",
    ];
    let report =
        || -> Value { serde_json::from_str(&std::fs::read_to_string(d.join("r.json")).unwrap()).unwrap() };
    succeed(d, &[&args[..], &["--period-mm", "auto"]].concat());
    let found = report();
    assert!((found["exx"]["period_mm"].as_f64().unwrap() - 87.0).abs() < 0.5);
    assert_eq!(
        found["exx"]["m"].as_u64().unwrap(),
        found["exx"]["coefficients"].as_array().unwrap().len() as u64 + 1
    );
    succeed(d, &[&args[..], &["--period-mm", "87", "--linear", "no"]].concat());
    assert_eq!(report()["exx"]["period_mm"], 87.0);
    assert_eq!(report()["exx"]["m"], 3);
}

#[test]
fn into_keeps_the_rest_of_the_model() {
    let directory = tempfile::tempdir().unwrap();
    let d = directory.path();
    std::fs::write(d.join("x.csv"), motion()).unwrap();
    std::fs::write(d.join("y.csv"), "position_mm,eyy_um\n0,1\n100,3\n200,2\n").unwrap();
    succeed(
        d,
        &[
            "fit",
            "--errors",
            "x.csv",
            "--axis",
            "x",
            "--errors",
            "y.csv",
            "--axis",
            "y",
            "--basis",
            "table",
            "--chain",
            "[w X' b Y Z t]",
            "--squareness",
            "ec0y=-3.1,eb0z=22.3",
            "--travel",
            "x=0:500",
            "--out",
            "model.toml",
        ],
    );
    let first = model(d, "model.toml");
    assert_eq!(first.errors.len(), 5);
    assert_eq!(value_um(&first, "eyy", 100.0, Travel::Forward), 3.0);
    std::fs::write(d.join("y2.csv"), "position_mm,eyy_um,direction\n0,5,1\n200,7,1\n0,6,-1\n200,8,-1\n")
        .unwrap();
    succeed(d, &["fit", "--errors", "y2.csv", "--axis", "y", "--basis", "table", "--into", "model.toml"]);
    let second = model(d, "model.toml");
    assert_eq!(second.errors.len(), 5);
    assert!((value_um(&second, "eyy", 100.0, Travel::Forward) - 6.0).abs() < 1e-9);
    assert!((value_um(&second, "eyy", 100.0, Travel::Reverse) - 7.0).abs() < 1e-9);
    assert_eq!(
        value_um(&second, "exx", 60.0, Travel::Forward),
        value_um(&first, "exx", 60.0, Travel::Forward)
    );
    assert_eq!(second.axis(volcomp::model::axes::AxisName::X).travel, Some([0.0, 500.0]));
    assert_eq!(second.chain, first.chain);
}

#[test]
#[cfg_attr(
    not(data_iso230_2_linear_axes),
    ignore = "needs ../shared/data/iso230_2_linear_axes or VOLCOMP_DATA"
)]
fn a_real_positioning_test_becomes_a_model() {
    let path = Path::new(env!("VOLCOMP_DATA_FOLDER"))
        .join("iso230_2_linear_axes/ess_target_b02_report_target_y.md_ISO230.dat");
    let directory = tempfile::tempdir().unwrap();
    let d = directory.path();
    for basis in ["table", "chebyshev", "fourier", "half-range", "auto"] {
        succeed(
            d,
            &[
                "fit",
                "--errors",
                path.to_str().unwrap(),
                "--axis",
                "y",
                "--cycles",
                "1-4",
                "--basis",
                basis,
                "--out",
                "y.toml",
            ],
        );
        let spec = model(d, "y.toml");
        // mean of forward and reverse at 20 mm over cycles 1 to 4, from the file
        if basis == "table" {
            let both =
                value_um(&spec, "eyy", 20.0, Travel::Forward) + value_um(&spec, "eyy", 20.0, Travel::Reverse);
            assert!((both / 2.0 + 19.17).abs() < 0.5, "{both}");
        }
    }
}

#[test]
fn start_up_outliers_are_kept_and_named_with_a_remedy() {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/formats/sessions/stage.dat");
    let directory = tempfile::tempdir().unwrap();
    let d = directory.path();
    let fit = |more: &[&str]| {
        let base =
            ["fit", "--errors", data.to_str().unwrap(), "--axis", "x", "--basis", "table", "--out", "x.toml"];
        let output = succeed(d, &[&base[..], &["--json", "r.json"], more].concat());
        let report: Value =
            serde_json::from_str(&std::fs::read_to_string(d.join("r.json")).unwrap()).unwrap();
        (String::from_utf8_lossy(&output.stderr).into_owned(), report["exx"].clone())
    };
    let (said, exx) = fit(&[]);
    for text in [
        "stage.dat:12: EXX: start-up outlier at 5 mm forward, cycle 1: 84.1 µm, +89.8 µm from the median",
        "stage.dat:13: EXX: start-up outlier",
        "kept in the fit\n",
        "note: EXX: 2 start-up outliers kept in the fit: leave out with --robust",
    ] {
        assert!(said.contains(text), "{text}: {said}");
    }
    let lines: Vec<u64> =
        exx["start_up_outliers"].as_array().unwrap().iter().map(|o| o["line"].as_u64().unwrap()).collect();
    assert_eq!(lines, [12, 13]);
    assert!(exx["notes"].to_string().contains("--robust"), "{exx}");
    // left out, or not among the cycles: nothing is kept
    for more in [&["--robust"][..], &["--cycles", "2-5"]] {
        let (said, exx) = fit(more);
        assert!(!said.contains("start-up") && exx["start_up_outliers"].is_null(), "{more:?}: {said}");
    }
    let reverse = fit(&["--direction", "reverse"]).1;
    assert!(reverse["start_up_outliers"].is_null(), "{reverse}");
}

/// Both directions, four cycles, every 20 mm, 3 um of reversal, one spike.
fn both_ways() -> String {
    let mut csv = String::from("position_mm,exx_um,cycle,direction\n");
    for cycle in 1..=4 {
        for i in 0..26 {
            let x = f64::from(i) * 20.0;
            for direction in [1, -1] {
                let wobble = f64::from((i * 7 + cycle * 3 + direction) % 5 - 2) * 0.1;
                let spike = if (cycle, i, direction) == (2, 6, 1) { 50.0 } else { 0.0 };
                let exx = 3.0 * (x / 160.0).sin() + 1.5 * f64::from(direction) + wobble + spike;
                csv.push_str(&format!("{x},{exx},{cycle},{direction}\n"));
            }
        }
    }
    csv
}

#[test]
fn reversal_outliers_bands_and_pictures() {
    let directory = tempfile::tempdir().unwrap();
    let d = directory.path();
    std::fs::write(d.join("m.csv"), both_ways()).unwrap();
    let base =
        ["fit", "--errors", "m.csv", "--axis", "x", "--basis", "half-range", "--robust", "--out", "o.toml"];
    let output = succeed(d, &[&base[..], &["--json", "r.json", "--picture", "p.html"]].concat());
    let notes = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(notes.contains("outlier: m.csv:66: EXX at 120 mm, cycle 2, towards plus: +5"), "{notes}");
    assert!(
        notes.contains("an error of 5, 10, 20 mm pitch looks like an offset, one of 6, 8, 12, 16 mm"),
        "{notes}"
    );
    let report: Value = serde_json::from_str(&std::fs::read_to_string(d.join("r.json")).unwrap()).unwrap();
    let exx = &report["exx"];
    assert_eq!(exx["outliers"][0]["line"], 66);
    assert_eq!(exx["n"], 207);
    let half = exx["reversal_half_coefficients_um"][0].as_f64().unwrap();
    assert!((half - 1.5).abs() < 0.05, "{half}");
    let coefficients = exx["coefficients"].as_array().unwrap().len();
    assert_eq!(exx["coefficients_std_um"].as_array().unwrap().len(), coefficients);
    let band = &exx["band"];
    for key in ["position_mm", "value_um", "std_um", "reverse_um", "reverse_std_um"] {
        assert_eq!(band[key].as_array().unwrap().len(), 101, "{key}");
    }
    assert!((band["factor_95"].as_f64().unwrap() - 1.97).abs() < 0.01);
    let page = std::fs::read_to_string(d.join("p.html")).unwrap();
    assert!(page.contains("<svg") && page.contains("EXX") && page.contains("off the curve, left out"));
    let spec = model(d, "o.toml");
    let reversal =
        value_um(&spec, "exx", 250.0, Travel::Forward) - value_um(&spec, "exx", 250.0, Travel::Reverse);
    assert!((reversal - 3.0).abs() < 0.1, "{reversal}");
    succeed(
        d,
        &[&base[..], &["--picture", "p.svg", "--reversal", "mean", "--screw-pitch-mm", "none"]].concat(),
    );
    assert!(std::fs::read_to_string(d.join("p.svg")).unwrap().starts_with("<svg"));
    let output = succeed(d, &[&base[..], &["--screw-pitch-mm", "50"]].concat());
    assert!(!String::from_utf8_lossy(&output.stderr).contains("cannot show"));
    succeed(
        d,
        &[
            "fit",
            "--errors",
            "m.csv",
            "--axis",
            "x",
            "--basis",
            "table",
            "--smoothing",
            "auto",
            "--out",
            "t.toml",
        ],
    );
}

#[test]
fn a_rotary_axis_measured_all_round_gets_a_curve_that_closes() {
    let directory = tempfile::tempdir().unwrap();
    let d = directory.path();
    let mut csv = String::from("position_deg,ecc_arcsec\n");
    for i in 0..36 {
        let angle = f64::from(i) * 10.0;
        csv.push_str(&format!("{angle},{}\n", 4.0 * angle.to_radians().sin() + 0.1 * f64::from(i * i % 5)));
    }
    std::fs::write(d.join("c.csv"), csv).unwrap();
    for basis in ["auto", "fourier", "table"] {
        succeed(d, &["fit", "--errors", "c.csv", "--axis", "c", "--basis", basis, "--out", "c.toml"]);
        let spec = model(d, "c.toml");
        let symbol = ErrorSymbol::parse("ecc").unwrap();
        let (_, function) = spec.errors.iter().find(|(s, _)| *s == symbol).unwrap();
        let [low, high] = function.range().unwrap();
        assert!((high - low - core::f64::consts::TAU).abs() < 1e-9, "{basis}");
        let step = function.value(high, Travel::Forward) - function.value(low, Travel::Forward);
        assert!(step.abs() < 1e-12, "{basis} {step:e}");
    }
    let output =
        succeed(d, &["fit", "--errors", "c.csv", "--axis", "c", "--basis", "chebyshev", "--out", "c.toml"]);
    assert!(String::from_utf8_lossy(&output.stderr).contains("this basis does not close"));
}

#[test]
fn bad_input_is_refused_with_its_place() {
    let directory = tempfile::tempdir().unwrap();
    let d = directory.path();
    let base = ["fit", "--errors", "m.csv", "--axis", "x", "--out", "o.toml"];
    for (csv, extra, code, expected) in [
        ("", &[][..], 65, "m.csv: the file is empty"),
        ("position_mm\n1\n", &[], 65, "no column with an error of axis X"),
        ("exx_um\n1\n", &[], 65, "column position_mm is missing"),
        ("position_mm,exx_um,exx_um\n", &[], 65, "column exx_um occurs twice"),
        ("position_mm,exx_um,notes\n", &[], 65, "notes: unknown column"),
        ("position_mm,exx_um\n0,nan\n", &[], 65, "m.csv:2:3: exx_um: nan is not finite"),
        ("position_mm,exx_um\n0,1e31\n", &[], 65, "m.csv:2:3: exx_um: 1e31 is beyond 1e30"),
        ("position_mm,exx_um\n0,1\n10,two\n", &[], 65, "m.csv:3:4: exx_um: 'two' is not a number"),
        ("position_mm,exx_um\n0,1\n", &[], 65, "EXX: 1 distinct positions"),
        ("position_mm,exx_um\n0,1\n10,9000000\n", &["--basis", "table"], 65, "the limit is 5000 µm"),
        (
            "position_mm,exx_um\n0,1\n10,2\n20,1\n",
            &["--basis", "chebyshev", "--order", "3"],
            65,
            "order 3 of the chebyshev basis exceeds the limit of 2 for 3 positions",
        ),
        (
            "position_mm,exx_um\n0,1\n10,2\n",
            &["--basis", "table", "--order", "3"],
            64,
            "a table has no order",
        ),
        (
            "position_mm,exx_um\n0,1\n10,2\n",
            &["--basis", "chebyshev", "--period-mm", "10"],
            64,
            "only --basis fourier has a period",
        ),
        ("position_mm,exx_um\n0,1\n10,2\n", &["--period-deg", "10"], 64, "use --period-mm"),
        ("position_mm,exx_um\n0,1\n10,2\n", &["--chain", "[w b Y t]"], 65, "axis X"),
        ("position_mm,exx_um\n0,1\n10,2\n", &["--chain", "w b X t"], 64, "--chain"),
        ("position_mm,exx_um\n0,1\n10,2\n", &["--squareness", "exx=3"], 64, "unknown squareness"),
        ("position_mm,exx_um\n0,1\n10,2\n", &["--order", "many"], 64, "neither a number from 0 up nor auto"),
        (
            "position_mm,exx_um\n0,1\n10,2\n",
            &["--cycles", "3"],
            65,
            "cycle 3 selected, but the file has cycles [0]",
        ),
        (
            "position_mm,exx_um\n0,1\n10,2\n",
            &["--errors", "m.csv", "--errors", "m.csv", "--axis", "y"],
            64,
            "3 files but 2 axes",
        ),
        ("position_mm,exx_um\n0,1\n10,2\n", &["--into", "none.toml"], 74, "none.toml"),
        ("position_mm,exx_um\n0,1\n10,2\n", &["--picture", "p.png"], 64, "must end in .svg or .html"),
        ("position_mm,exx_um\n0,1\n10,2\n", &["--smoothing", "much"], 64, "neither none, auto nor a number"),
        (
            "position_mm,exx_um\n0,1\n10,2\n",
            &["--smoothing", "auto", "--basis", "fourier"],
            64,
            "only a table is smoothed",
        ),
        ("position_mm,exx_um\n0,1\n10,2\n", &["--screw-pitch-mm", "-5"], 64, "is not above 0"),
    ] {
        std::fs::write(d.join("m.csv"), csv).unwrap();
        let output = volcomp(d, &[&base[..], extra].concat());
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(code), "{csv:?} {extra:?}: {message}");
        assert!(message.contains(expected), "{csv:?} {extra:?} gives {message:?}");
        assert!(!d.join("o.toml").exists(), "{csv:?} {extra:?} wrote a model");
    }
}

#[test]
fn the_point_of_a_rotary_axis_is_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let rows: String = (0..13).map(|k| format!("{},{}\n", 30 * k, (k % 4) - 1)).collect();
    std::fs::write(folder.path().join("c.csv"), format!("position_deg,ecc_arcsec\n{rows}")).unwrap();
    let args = ["fit", "--errors", "c.csv", "--axis", "c", "--chain", "[w C' b X Y Z t]", "--out", "m.toml"];
    let output = succeed(folder.path(), &args);
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(
        said.contains("m.toml: [axes.c] point-mm = [0, 0, 0] is an assumption: set it to a point on axis C"),
        "{said}"
    );
}

#[test]
fn positions_are_checked_before_the_fit() {
    let directory = tempfile::tempdir().unwrap();
    let d = directory.path();
    std::fs::write(d.join("x.csv"), motion()).unwrap();
    std::fs::write(d.join("again.csv"), motion()).unwrap();
    for position in ["1e5", "1e7", "1e9"] {
        std::fs::write(d.join("far.csv"), motion() + position + ",1,1,3\r\n").unwrap();
        let output = volcomp(d, &["fit", "--axis", "x", "--errors", "far.csv", "--out", "m.toml"]);
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(65));
        assert!(stderr.contains("far.csv:81: position 1"), "{stderr}");
        assert!(stderr.contains("lies far from all others, 0 to 500 mm"), "{stderr}");
    }
    let twice = ["fit", "--axis", "x", "--errors", "x.csv", "--errors", "again.csv", "--out", "m.toml"];
    let output = volcomp(d, &twice);
    assert_eq!(output.status.code(), Some(65));
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(stderr.contains("again.csv: all of its 78 readings of EXX stand in x.csv, too"), "{stderr}");
    // the travel of the command line, then that of the model
    let fit = ["fit", "--axis", "x", "--errors", "x.csv", "--travel", "x=0:400", "--out", "m.toml"];
    for args in [&fit[..], &["fit", "--axis", "x", "--errors", "x.csv", "--into", "m.toml"]] {
        let stderr = String::from_utf8_lossy(&succeed(d, args).stderr).into_owned();
        assert!(
            stderr
                .contains("x.csv:24: position 420 mm is outside the travel of axis X, 0 to 400 mm (15 of 78"),
            "{stderr}"
        );
    }
}

#[test]
fn a_curve_that_swings_between_far_positions_is_named() {
    let directory = tempfile::tempdir().unwrap();
    let d = directory.path();
    std::fs::write(d.join("far.csv"), motion() + "9000,1,1,3\r\n").unwrap();
    let output = volcomp(d, &["fit", "--axis", "x", "--errors", "far.csv", "--out", "m.toml"]);
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(65), "{stderr}");
    assert!(stderr.contains("between the positions, the readings"), "{stderr}");
}
