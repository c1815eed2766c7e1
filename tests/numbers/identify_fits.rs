//! `volcomp identify fits`: the reference vectors, and NIST's certified values digit by digit.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
#![expect(clippy::disallowed_methods, reason = "the test reads and writes files")]

use std::path::Path;
use std::process::{Command, Output};

use serde_json::{Value, json};

fn volcomp(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_volcomp")).args(args).output().unwrap()
}

fn identify(case: &Value) -> Value {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("case.json");
    std::fs::write(&path, case.to_string()).unwrap();
    let output = volcomp(&["identify", "fits", "--input", path.to_str().unwrap(), "--json"]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

fn number(v: &Value) -> f64 {
    v.as_f64().unwrap_or_else(|| panic!("{v} is no number"))
}

fn list(v: &Value) -> Vec<f64> {
    v.as_array().unwrap_or_else(|| panic!("{v} is no list")).iter().map(number).collect()
}

fn vectors() -> Value {
    serde_json::from_str(include_str!("../vectors/fits.json")).unwrap()
}

/// A figure: relative 1e-8, or rounding where the exact one is zero.
fn assert_near(what: &str, got: &Value, expected: &Value) {
    if expected.is_null() {
        assert!(got.is_null(), "{what}: {got} instead of null");
        return;
    }
    let (got, expected) = (number(got), number(expected));
    assert!((got - expected).abs() <= 1e-15 + 1e-8 * expected.abs(), "{what}: {got} instead of {expected}");
}

#[test]
fn every_case_gives_the_keys_and_values_of_expect() {
    let file = vectors();
    let tolerance = |key: &str| number(&file["tolerance"][key]);
    for case in file["cases"].as_array().unwrap() {
        let mut inputs = case.clone();
        inputs.as_object_mut().unwrap().remove("expect");
        let (id, got, expect) = (case["id"].as_str().unwrap(), identify(&inputs), &case["expect"]);
        // coefficients follow a fitted period within its tolerance
        let follow = if expect["period"].is_null() { 1.0 } else { 10.0 };
        for (key, want) in expect.as_object().unwrap() {
            let have = &got[key];
            let what = format!("{id} {key}");
            match key.as_str() {
                "coefficients" => {
                    let (have, want) = (list(have), list(want));
                    assert_eq!(have.len(), want.len(), "{what}");
                    for (a, b) in have.iter().zip(&want) {
                        assert!((a - b).abs() <= follow * tolerance("coefficients"), "{what}: {a} {b}");
                    }
                }
                "eval" => {
                    for (a, b) in have.as_array().unwrap().iter().zip(want.as_array().unwrap()) {
                        let (a, b) = (list(a), list(b));
                        assert!((a[0] - b[0]).abs() < 1e-9, "{what}");
                        assert!((a[1] - b[1]).abs() <= follow * tolerance("eval"), "{what}: {a:?} {b:?}");
                    }
                }
                "period" => {
                    let off = (number(have) - number(want)).abs();
                    assert!(off <= tolerance("period"), "{what} off by {off:e}");
                    assert!(off <= 1e-8, "{what} off by {off:e}");
                }
                "best_order" => assert_eq!(have, want, "{what}"),
                "aicc_table" => {
                    assert_eq!(have.as_array().unwrap().len(), want.as_array().unwrap().len());
                    for (a, b) in have.as_array().unwrap().iter().zip(want.as_array().unwrap()) {
                        assert_eq!(a["order"], b["order"]);
                        assert_near(&what, &a["sse"], &b["sse"]);
                        assert_near(&what, &a["aicc"], &b["aicc"]);
                    }
                }
                "polynomial7" => {
                    for (inner, want) in want.as_object().unwrap() {
                        assert_near(&format!("{what} {inner}"), &have[inner], want);
                    }
                }
                _ => assert_near(&what, have, want),
            }
        }
    }
}

#[test]
fn a_case_is_taken_from_a_file_of_cases() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/vectors/fits.json");
    let path = path.to_str().unwrap();
    let output = volcomp(&["identify", "fits", "--input", path, "--case", "FIT-o3"]);
    assert!(output.status.success());
    assert!(String::from_utf8_lossy(&output.stdout).contains("chebyshev of order 5: n 31, m 6"));
    let output = volcomp(&["identify", "fits", "--input", path, "--case", "FIT-x"]);
    assert_eq!(output.status.code(), Some(65));
    assert!(String::from_utf8_lossy(&output.stderr).contains("no case FIT-x; there are: FIT-o1, FIT-o2"));
}

/// Correct decimal digits.
fn digits(got: f64, certified: f64) -> f64 {
    let off = if certified == 0.0 { got.abs() } else { (got / certified - 1.0).abs() };
    if off == 0.0 { 16.0 } else { (-off.log10()).min(16.0) }
}

fn fewest(got: &[f64], certified: &[f64]) -> f64 {
    assert_eq!(got.len(), certified.len());
    got.iter().zip(certified).map(|(g, c)| digits(*g, *c)).fold(f64::INFINITY, f64::min)
}

#[test]
fn certified_polynomials_of_nist() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/nist_strd/linear_polynomials.json");
    let sets: Value = serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
    for (name, needed) in [
        ("Wampler1", 8.0),
        ("Wampler2", 8.0),
        ("Wampler3", 8.0),
        ("Wampler4", 8.0),
        ("Wampler5", 6.0),
        ("Pontius", 8.0),
        ("NoInt1", 8.0),
        ("Filip", 6.0),
    ] {
        let set = &sets[name];
        let (mut b, mut std) = (list(&set["certified_coeff_low_to_high"]), list(&set["certified_std"]));
        let order = b.len() - 1;
        let intercept = name != "NoInt1";
        if !intercept {
            (b, std) = (b.split_off(1), std.split_off(1));
        }
        let got = identify(&json!({
            "basis": "polynomial", "order": order, "intercept": intercept, "x": set["x"], "y": set["y"]
        }));
        let found = fewest(&list(&got["coefficients"]), &b);
        let of_std = if std.iter().all(|s| *s == 0.0) {
            // an exact polynomial: what is left is rounding of the largest value
            let largest = list(&set["y"]).into_iter().fold(0.0f64, |a, y| a.max(y.abs()));
            digits(number(&got["rmse_dof"]) / largest, 0.0)
        } else {
            fewest(&list(&got["coefficients_std"]), &std)
        };
        eprintln!("{name:<9} coefficients {found:>5.1} digits, standard deviations {of_std:>5.1}");
        assert!(found >= needed, "{name}: {found} digits");
        assert!(of_std >= needed, "{name}: {of_std} digits of the standard deviations");
    }
}

/// Column of NIST's file format: certified values and standard deviations, then the data as (y, x).
fn enso() -> (Vec<[f64; 2]>, Vec<[f64; 2]>) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/nist_strd/ENSO.dat");
    let text = std::fs::read_to_string(path).unwrap();
    let lines: Vec<&str> = text.lines().collect();
    let numbers =
        |line: &str| -> Vec<f64> { line.split_whitespace().filter_map(|w| w.parse().ok()).collect() };
    let certified = lines[40..49].iter().map(|l| {
        let v = numbers(l);
        [v[v.len() - 2], v[v.len() - 1]]
    });
    let data = lines[60..228].iter().map(|l| {
        let v = numbers(l);
        [v[0], v[1]]
    });
    (certified.collect(), data.collect())
}

#[test]
fn the_southern_oscillation_has_the_certified_periods() {
    let (certified, data) = enso();
    assert_eq!((certified.len(), data.len()), (9, 168));
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("enso.csv");
    let rows: String = data.iter().map(|[y, x]| format!("{x},{y}\n")).collect();
    std::fs::write(&path, format!("month,pressure\n{rows}")).unwrap();
    let path = path.to_str().unwrap();
    let output = volcomp(&[
        "identify",
        "fits",
        "--data",
        path,
        "--x",
        "month",
        "--y",
        "pressure",
        "--basis",
        "fourier",
        "--order",
        "1",
        "--periods",
        "12,auto,auto",
        "--x0",
        "0",
        "--json",
    ]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let got: Value = serde_json::from_slice(&output.stdout).unwrap();
    let (c, std) = (list(&got["coefficients"]), list(&got["coefficients_std"]));
    let (periods, periods_std) = (list(&got["periods"]), list(&got["periods_std"]));
    assert_eq!((c.len(), periods.len(), periods_std.len()), (7, 3, 2));
    // NIST's order: mean, annual pair, then each period with its pair
    let in_order = |c: &[f64], p: [f64; 2]| [c[0], c[1], c[2], p[0], c[3], c[4], p[1], c[5], c[6]];
    let of = |which: usize| certified.iter().map(|p| p[which]).collect::<Vec<f64>>();
    let reached = fewest(&in_order(&c, [periods[1], periods[2]]), &of(0));
    let of_std = fewest(&in_order(&std, [periods_std[0], periods_std[1]]), &of(1));
    let sse = digits(number(&got["sse"]), 788.539_786_68);
    eprintln!(
        "ENSO      parameters {reached:>7.1} digits, standard deviations {of_std:>5.1}, sum of squares {sse:.1}"
    );
    assert!(reached >= 6.0 && of_std >= 6.0 && sse >= 8.0);
}

#[test]
fn what_cannot_be_answered_is_refused_with_a_reason() {
    let x: Vec<f64> = (0..6).map(f64::from).collect();
    for (case, expected) in [
        (json!({"basis": "polynomial", "x": x, "y": x}), "a polynomial needs an order"),
        (
            json!({"basis": "polynomial", "order": 7, "x": x, "y": x}),
            "6 distinct positions cannot determine 8",
        ),
        (json!({"basis": "chebyshev", "order": 5, "x": x, "y": [1.0]}), "6 x but 1 y"),
        (json!({"basis": "fourier", "order": 1, "period": -3.0, "x": x, "y": x}), "period -3 is not above 0"),
        (json!({"basis": "spline", "x": x, "y": x}), "unknown variant `spline`"),
    ] {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("case.json");
        std::fs::write(&path, case.to_string()).unwrap();
        let output = volcomp(&["identify", "fits", "--input", path.to_str().unwrap(), "--json"]);
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(65), "{message}");
        assert!(message.contains(expected), "{message}");
        assert!(output.stdout.is_empty());
    }
}
