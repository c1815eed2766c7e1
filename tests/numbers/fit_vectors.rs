//! The reference vectors of curve fits.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use serde_json::Value;
use volcomp::identify::Reading;
use volcomp::identify::curve::{Basis, Period, Request, fit};
use volcomp::model::axes::Travel;

fn vectors() -> Value {
    serde_json::from_str(include_str!("../vectors/fits.json")).unwrap()
}

fn readings(x: &[f64], y: impl Fn(usize, f64) -> f64) -> Vec<Reading> {
    x.iter()
        .enumerate()
        .map(|(i, &position)| Reading { cycle: 1, travel: Travel::Forward, position, value: y(i, position) })
        .collect()
}

fn with_basis(basis: Basis) -> Request {
    Request { basis: Some(basis), ..Request::default() }
}

fn list(v: &Value) -> Vec<f64> {
    v.as_array().unwrap().iter().map(|n| n.as_f64().unwrap()).collect()
}

/// Ridge case of the vectors and all others: request and expectation.
fn request_of(case: &Value) -> Request {
    let number = |key: &str| case[key].as_f64();
    let order = case["order_fit"].as_u64().or(case["order"].as_u64()).map(|o| o as usize);
    let period = match (number("period"), &case["period_search"]) {
        (Some(p), _) => Period::Given(p),
        (None, Value::Array(r)) => Period::Within([r[0].as_f64().unwrap(), r[1].as_f64().unwrap()]),
        _ => Period::Auto,
    };
    Request {
        basis: Some(if case["basis"] == "fourier" { Basis::Fourier } else { Basis::Chebyshev }),
        order,
        period,
        linear: case["linear"].as_bool(),
        ridge: case["ridge"]["lam"].as_f64(),
        ..Request::default()
    }
}

fn assert_figure(id: &str, name: &str, got: Option<f64>, expected: &Value) {
    let Some(expected) = expected.as_f64() else {
        assert_eq!(got, None, "{id} {name}");
        return;
    };
    let got = got.unwrap_or_else(|| panic!("{id} {name} is missing"));
    let tolerance = 1e-15f64.max(1e-8 * expected.abs());
    assert!((got - expected).abs() <= tolerance, "{id} {name}: {got} instead of {expected}");
}

#[test]
fn the_reference_vectors() {
    let file = vectors();
    let tolerance = |key: &str| file["tolerance"][key].as_f64().unwrap();
    let cases = file["cases"].as_array().unwrap();
    assert_eq!(cases.len(), 5);
    for case in cases {
        let id = case["id"].as_str().unwrap();
        let (x, y) = (list(&case["x"]), list(&case["y"]));
        let fit = fit(&readings(&x, |i, _| y[i]), &request_of(case)).unwrap();
        let expect = &case["expect"];
        if let Some(best) = expect["best_order"].as_u64() {
            assert_eq!(fit.order, Some(best as usize), "{id}");
        }
        if let Some(period) = expect["period"].as_f64() {
            let off = (fit.period.unwrap() - period).abs();
            assert!(off <= tolerance("period"), "{id} period off by {off:e}");
        }
        let fitted_period = expect["period"].is_f64();
        for (i, (got, want)) in fit.coefficients.iter().zip(list(&expect["coefficients"])).enumerate() {
            // coefficients follow the period within its tolerance
            let allowed = if fitted_period { 1e-8 } else { tolerance("coefficients") };
            assert!((got - want).abs() <= allowed, "{id} coefficient {i}: {got} instead of {want}");
        }
        assert_eq!(fit.coefficients.len(), list(&expect["coefficients"]).len(), "{id}");
        for pair in expect["eval"].as_array().unwrap() {
            let (x, want) = (pair[0].as_f64().unwrap(), pair[1].as_f64().unwrap());
            let allowed = if fitted_period { 1e-8 } else { tolerance("eval") };
            let got = fit.curve.value(x, Travel::Forward);
            assert!((got - want).abs() <= allowed, "{id} at {x}: {got} instead of {want}");
        }
        let f = fit.figures;
        assert_figure(id, "sse", Some(f.sse), &expect["sse"]);
        assert_figure(id, "rmse_n", Some(f.rmse_n), &expect["rmse_n"]);
        assert_figure(id, "rmse_dof", f.rmse_dof, &expect["rmse_dof"]);
        assert_figure(id, "r2", f.r2, &expect["r2"]);
        assert_figure(id, "e_max", Some(f.e_max), &expect["e_max"]);
        assert_figure(id, "aicc", f.aicc, &expect["aicc"]);
    }
}

#[test]
fn the_table_of_orders_of_the_vectors() {
    let file = vectors();
    let case = &file["cases"][2];
    let (x, y) = (list(&case["x"]), list(&case["y"]));
    for row in case["expect"]["aicc_table"].as_array().unwrap() {
        let order = row["order"].as_u64().unwrap() as usize;
        let request = Request { order: Some(order), ..with_basis(Basis::Chebyshev) };
        let fit = fit(&readings(&x, |i, _| y[i]), &request).unwrap();
        assert_figure("order", "sse", Some(fit.figures.sse), &row["sse"]);
        assert_figure("order", "aicc", fit.figures.aicc, &row["aicc"]);
    }
}
