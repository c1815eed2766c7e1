//! A real axis: fit on four cycles, judge on the fifth, which the model has not seen.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
#![expect(clippy::disallowed_methods, reason = "the test reads files")]

use std::path::Path;

use volcomp::formats::iso230_dat;
use volcomp::identify::curve::{Basis, Request, fit};
use volcomp::identify::reading::{Reading, repeatability};

fn b02_y() -> Vec<Reading> {
    let path = Path::new(env!("VOLCOMP_DATA_FOLDER"))
        .join("iso230_2_linear_axes/ess_target_b02_report_target_y.md_ISO230.dat");
    iso230_dat::parse(&std::fs::read_to_string(&path).unwrap()).unwrap().readings
}

fn rms_um(values: impl Iterator<Item = f64>) -> f64 {
    let values: Vec<f64> = values.collect();
    1e3 * (values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64).sqrt()
}

/// RMS of the left-out cycle before and after the map of the others.
fn left_out(all: &[Reading], cycle: u32, request: &Request) -> (f64, f64) {
    let (test, train): (Vec<Reading>, Vec<Reading>) = all.iter().partition(|r| r.cycle == cycle);
    let found = fit(&train, request).unwrap();
    let residual = |r: &Reading| r.value - found.value(r.position, r.travel);
    (rms_um(test.iter().map(|r| r.value)), rms_um(test.iter().map(residual)))
}

#[test]
#[cfg_attr(
    not(data_iso230_2_linear_axes),
    ignore = "needs ../shared/data/iso230_2_linear_axes or VOLCOMP_DATA"
)]
fn a_table_of_four_cycles_takes_most_out_of_the_fifth() {
    let all = b02_y();
    assert_eq!(all.len(), 90);
    let table = Request { basis: Some(Basis::Table), ..Request::default() };
    let static_part = 1e3 * repeatability(&all).unwrap();
    let mut after_all = Vec::new();
    for cycle in 1..=5 {
        let (before, after) = left_out(&all, cycle, &table);
        eprintln!(
            "cycle {cycle}: {before:.1} um before, {after:.1} um after; repeatable to {static_part:.1} um"
        );
        assert!(after < before, "cycle {cycle}: {before} to {after}");
        after_all.push(after);
    }
    let (before, after) = left_out(&all, 5, &table);
    assert!((before - 24.2).abs() < 3.0, "{before}");
    assert!(after < 0.35 * before, "{after} of {before}");
    // the rest is what no static map can remove: the axis drifts from cycle to cycle
    let mean_after = rms_um(after_all.iter().map(|v| v * 1e-3));
    assert!(mean_after < 1.6 * static_part, "{mean_after} against {static_part}");
}

#[test]
#[cfg_attr(
    not(data_iso230_2_linear_axes),
    ignore = "needs ../shared/data/iso230_2_linear_axes or VOLCOMP_DATA"
)]
fn whatever_auto_picks_is_no_worse_than_the_smooth_curves() {
    let all = b02_y();
    let (_, auto) = left_out(&all, 5, &Request::default());
    for basis in [Basis::HalfRange, Basis::Chebyshev] {
        let (before, smooth) = left_out(&all, 5, &Request { basis: Some(basis), ..Request::default() });
        eprintln!("{}: {before:.1} um before, {smooth:.1} um after; auto {auto:.1} um", basis.name());
        assert!(smooth < before);
        assert!(auto <= smooth * 1.01);
    }
}
