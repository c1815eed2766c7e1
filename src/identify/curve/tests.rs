//! Recovery of known curves, the figures by brute force, and what must be refused.

use proptest::prelude::*;

use super::*;

fn readings(x: &[f64], y: impl Fn(usize, f64) -> f64) -> Vec<Reading> {
    x.iter()
        .enumerate()
        .map(|(i, &position)| Reading { cycle: 1, travel: Travel::Forward, position, value: y(i, position) })
        .collect()
}

fn grid(n: usize, step: f64) -> Vec<f64> {
    (0..n).map(|i| i as f64 * step).collect()
}

/// Deterministic noise of about unit size.
fn noise(i: usize) -> f64 {
    let u = |k: usize| {
        let h = (k as u64).wrapping_add(1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        let h = (h ^ (h >> 31)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        ((h ^ (h >> 29)) >> 11) as f64 / (1u64 << 53) as f64
    };
    (0..12).map(|k| u(12 * i + k)).sum::<f64>() - 6.0
}

fn with_basis(basis: Basis) -> Request {
    Request { basis: Some(basis), ..Request::default() }
}

/// Plain least squares with a shape that keeps its range, written out: the value of the curve as a function.
fn brute(shape: &basis::Shape, readings: &[Reading]) -> impl Fn(f64) -> f64 {
    let mut row = vec![0.0; shape.len()];
    let design = nalgebra::DMatrix::from_fn(readings.len(), shape.len(), |i, j| {
        shape.row(readings[i].position, &mut row);
        row[j]
    });
    let y = nalgebra::DVector::from_iterator(readings.len(), readings.iter().map(|r| r.value));
    let c = design.svd(true, true).solve(&y, 1e-14).unwrap();
    let shape = shape.clone();
    move |x| {
        let mut row = vec![0.0; shape.len()];
        shape.row(x, &mut row);
        row.iter().zip(c.iter()).map(|(a, b)| a * b).sum()
    }
}

#[test]
fn leave_one_out_is_what_leaving_one_out_gives() {
    let x = grid(15, 20.0);
    let all = readings(&x, |i, x| 1e-3 * (x / 60.0).sin() + 1e-4 * noise(i));
    for basis in [Basis::Chebyshev, Basis::Fourier] {
        let request =
            Request { order: Some(2), period: Period::Given(150.0), linear: Some(true), ..with_basis(basis) };
        let whole = fit(&all, &request).unwrap();
        // the shape must keep its range, so only inner readings are left out
        let (mut sum, mut inner) = (0.0, 0.0);
        let shape = basis::Shape { basis, order: 2, range: [0.0, 280.0], periods: vec![150.0], linear: true };
        for skip in 0..all.len() {
            let rest: Vec<Reading> =
                all.iter().enumerate().filter(|(i, _)| *i != skip).map(|(_, r)| *r).collect();
            let error = (all[skip].value - brute(&shape, &rest)(all[skip].position)).powi(2);
            sum += error;
            if (1..all.len() - 1).contains(&skip) {
                inner += error;
            }
        }
        let direct = (sum / all.len() as f64).sqrt();
        assert!((whole.figures.loo_rmse.unwrap() - direct).abs() < 1e-15, "{basis:?}");
        let direct = (inner / (all.len() - 2) as f64).sqrt();
        assert!((whole.figures.position_rmse.unwrap() - direct).abs() < 1e-15, "{basis:?}");
    }
}

#[test]
fn repeated_positions_are_left_out_together_whatever_the_direction() {
    let x: Vec<f64> = grid(12, 25.0).into_iter().flat_map(|x| [x, x, x]).collect();
    let mut all = readings(&x, |i, x| 1e-3 * (x / 80.0).cos() + 1e-4 * noise(i));
    let shape = basis::Shape {
        basis: Basis::Chebyshev,
        order: 3,
        range: [0.0, 275.0],
        periods: Vec::new(),
        linear: false,
    };
    for directions in [1, 2] {
        if directions == 2 {
            all.iter_mut().skip(1).step_by(3).for_each(|r| r.travel = Travel::Reverse);
        }
        let request = Request { order: Some(3), reversal: Reversal::Mean, ..with_basis(Basis::Chebyshev) };
        let whole = fit(&all, &request).unwrap();
        let mut sum = 0.0;
        for skip in grid(12, 25.0).into_iter().skip(1).take(10) {
            let (out, rest): (Vec<Reading>, Vec<Reading>) = all.iter().partition(|r| r.position == skip);
            let curve = brute(&shape, &rest);
            sum += out.iter().map(|r| (r.value - curve(skip)).powi(2)).sum::<f64>();
        }
        let direct = (sum / (all.len() - 6) as f64).sqrt();
        assert!((whole.figures.position_rmse.unwrap() - direct).abs() < 1e-14);
    }
}

#[test]
fn auto_finds_the_screw_wave_and_its_period() {
    let truth = |x: f64| {
        2e-3 + 1.5e-3 * (x / 250.0 - 1.0) + 4e-3 * (2.0 * core::f64::consts::PI * x / 97.0 + 0.4).sin()
    };
    let all = readings(&grid(51, 10.0), |i, x| truth(x) + 0.4e-3 * noise(i));
    let found = fit(&all, &Request::default()).unwrap();
    assert_eq!(found.basis, Basis::Fourier);
    assert!((found.period.unwrap() - 97.0).abs() < 1.0, "{:?}", found.period);
    assert!(found.period_fitted && found.figures.m == found.coefficients.len() + 1);
    for i in 0..500 {
        let x = f64::from(i);
        assert!((found.curve.value(x, Travel::Forward) - truth(x)).abs() < 0.6e-3, "{x}");
    }
}

#[test]
fn auto_keeps_a_straight_line_straight() {
    let all = readings(&grid(21, 25.0), |i, x| 1e-5 * x + 0.3e-3 * noise(i));
    let found = fit(&all, &Request::default()).unwrap();
    assert!(found.coefficients.len() <= 3, "{:?} {:?}", found.basis, found.coefficients);
}

#[test]
fn auto_takes_a_table_where_the_reversal_is_clear() {
    let mut all = Vec::new();
    for cycle in 1..=5u32 {
        for (i, x) in grid(9, 5.0).into_iter().enumerate() {
            for (travel, reversal) in [(Travel::Forward, 4e-3), (Travel::Reverse, -4e-3)] {
                let value = reversal
                    + 5e-3 * noise(i)
                    + 0.2e-3 * noise(100 * cycle as usize + i + usize::from(reversal > 0.0) * 50);
                all.push(Reading { cycle, travel, position: x, value });
            }
        }
    }
    let found = fit(&all, &Request::default()).unwrap();
    assert_eq!(found.basis, Basis::Table);
    assert!(found.figures.rmse_dof.unwrap() < 0.35e-3);
    let smooth = Request { reversal: Reversal::Mean, ..with_basis(Basis::HalfRange) };
    let smooth = fit(&all, &smooth).unwrap();
    let reversal = smooth.notes.iter().find_map(|n| match n {
        Note::ReversalLeftOut { mean } => Some(*mean),
        _ => None,
    });
    assert!((reversal.unwrap() - 8e-3).abs() < 0.3e-3);
}

#[test]
fn a_table_is_the_mean_at_each_target() {
    let mut all = readings(&[0.0, 10.0, 20.0], |i, _| i as f64);
    all.extend(readings(&[0.0, 10.0, 20.0], |i, _| i as f64 + 2.0));
    let one = fit(&all, &with_basis(Basis::Table)).unwrap();
    assert_eq!(one.coefficients, [1.0, 2.0, 3.0]);
    assert_eq!((one.figures.n, one.figures.m, one.order), (6, 3, None));
    // each reading is predicted by the other one at its target
    assert!((one.figures.loo_rmse.unwrap() - 2.0).abs() < 1e-15);
    for r in &mut all[3..] {
        r.travel = Travel::Reverse;
    }
    let two = fit(&all, &with_basis(Basis::Table)).unwrap();
    assert_eq!(two.coefficients, [0.0, 1.0, 2.0, 2.0, 3.0, 4.0]);
    assert_eq!(two.curve.value(10.0, Travel::Reverse), 3.0);
    all.pop();
    assert_eq!(
        fit(&all, &with_basis(Basis::Table)).unwrap_err(),
        FitError::DirectionMissing { position: 20.0, travel: Travel::Reverse }
    );
}

#[test]
fn what_cannot_be_fitted_is_refused() {
    let few = readings(&grid(9, 10.0), |i, _| noise(i) * 1e-3);
    assert_eq!(
        fit(&few, &Request { order: Some(7), ..with_basis(Basis::Chebyshev) }).unwrap_err(),
        FitError::OrderTooHigh { basis: Basis::Chebyshev, order: 7, limit: 6, positions: 9 }
    );
    assert_eq!(
        fit(&few, &Request { order: Some(0), ..with_basis(Basis::Fourier) }).unwrap_err(),
        FitError::NoHarmonic
    );
    // a 10 mm screw pitch cannot be seen with targets every 10 mm
    let aliased = Request { order: Some(1), period: Period::Given(10.0), ..with_basis(Basis::Fourier) };
    assert!(matches!(fit(&few, &aliased).unwrap_err(), FitError::Degenerate { .. }));
    let reversed =
        Request { order: Some(1), period: Period::Within([50.0, 20.0]), ..with_basis(Basis::Fourier) };
    assert!(matches!(fit(&few, &reversed).unwrap_err(), FitError::PeriodSearchEmpty { .. }));
    for travel in [0.0, 1e-300, 1e-160, 1e-20, f64::NAN] {
        let request = Request { order: Some(1), range: Some([0.0, travel]), ..with_basis(Basis::Fourier) };
        assert!(matches!(fit(&few, &request).unwrap_err(), FitError::EmptyRange { .. }), "{travel}");
    }
    let negative = Request { order: Some(1), period: Period::Given(-5.0), ..with_basis(Basis::Fourier) };
    assert_eq!(fit(&few, &negative).unwrap_err(), FitError::PeriodNotPositive { value: -5.0 });
    assert_eq!(
        fit(&few, &Request { ridge: Some(-1.0), ..Request::default() }).unwrap_err(),
        FitError::BadRidge { value: -1.0 }
    );
    assert_eq!(
        fit(&few[..1], &Request::default()).unwrap_err(),
        FitError::TooFewPositions { found: 1, needed: 2 }
    );
    assert_eq!(fit(&[], &Request::default()).unwrap_err(), FitError::TooFewPositions { found: 0, needed: 2 });
    let mut bad = few;
    bad[3].value = f64::NAN;
    assert_eq!(fit(&bad, &Request::default()).unwrap_err(), FitError::NotFinite { row: 4 });
}

#[test]
fn a_fitted_period_stays_where_it_was_searched() {
    // the wave of 150 mm pulls at the lower end
    let all =
        readings(&grid(41, 10.0), |i, x| 1e-3 * (x * core::f64::consts::TAU / 150.0).sin() + 1e-4 * noise(i));
    for range in [[180.0, 480.0], [60.0, 140.0]] {
        let request = Request { order: Some(1), period: Period::Within(range), ..with_basis(Basis::Fourier) };
        let period = fit(&all, &request).unwrap().period.unwrap();
        assert!((range[0]..=range[1]).contains(&period), "{period} in {range:?}");
    }
}

#[test]
fn a_wave_without_amplitude_has_a_finite_uncertainty() {
    // a column of zeros beside others is common in tables of error motions
    for size in [0.0, 1e-12, 1e-9] {
        let all = readings(&grid(21, 20.0), |i, _| size * noise(i));
        let request = Request { order: Some(1), period: Period::Auto, ..with_basis(Basis::Fourier) };
        let found = fit(&all, &request).unwrap();
        let std = found.standard_uncertainty().unwrap();
        assert!(std.is_finite() && std <= 10.0 * size, "{size}: {std}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    #[test]
    fn known_curves_are_recovered_exactly(
        c in prop::collection::vec(-5e-3..5e-3f64, 6),
        start in -500.0..500.0f64,
        step in 0.5..40.0f64,
        which in 0usize..2,
    ) {
        let basis = [Basis::HalfRange, Basis::Chebyshev][which];
        let order = if which == 0 { 4 } else { 5 };
        let x: Vec<f64> = (0..25).map(|i| start + f64::from(i) * step).collect();
        let shape = basis::Shape { basis, order, range: [x[0], x[24]], periods: Vec::new(), linear: false };
        let curve = shape.curves(&c).unwrap().remove(0);
        let all = readings(&x, |_, x| curve.value(x, Travel::Forward));
        let found = fit(&all, &Request { order: Some(order), ..with_basis(basis) }).unwrap();
        for (a, b) in found.coefficients.iter().zip(&c) {
            prop_assert!((a - b).abs() < 1e-15);
        }
    }

    #[test]
    fn scaling_the_values_scales_the_fit(scale in 1e-6..1e6f64) {
        let x = grid(30, 10.0);
        let base = readings(&x, |i, x| (x / 70.0).sin() + 0.1 * noise(i));
        let scaled: Vec<Reading> = base.iter().map(|r| Reading { value: r.value * scale, ..*r }).collect();
        let (a, b) = (fit(&base, &Request::default()).unwrap(), fit(&scaled, &Request::default()).unwrap());
        prop_assert_eq!(a.order, b.order);
        prop_assert!((a.figures.aicc_in_unit(scale).unwrap() - b.figures.aicc.unwrap()).abs() < 1e-6);
    }
}

#[test]
fn unequal_targets_show_the_wave_of_a_screw_and_equal_ones_a_table() {
    let wave = |x: f64| 2e-3 * (core::f64::consts::TAU * x / 10.0 + 0.4).sin();
    let tested = |targets: &[f64], value: &dyn Fn(usize, f64) -> f64| -> CurveFit {
        let cycle = |cycle: u32| {
            let noise = move |i: usize| 5e-4 * noise(i + 100 * cycle as usize);
            readings(targets, |i, x| value(i, x) + noise(i)).into_iter().map(move |r| Reading { cycle, ..r })
        };
        let all: Vec<Reading> = (1..=5).flat_map(cycle).collect();
        fit(&all, &Request::default()).unwrap()
    };
    let unequal: Vec<f64> =
        (0..21).map(|i| 20.0 * f64::from(i) + 10.0 * f64::from(i * i * 7919 % 1009) / 1009.0).collect();
    let found = tested(&unequal, &|_, x| wave(x));
    assert_eq!(found.basis, Basis::Fourier);
    assert!((found.period.unwrap() - 10.0).abs() < 0.01, "{:?}", found.period);
    assert!(found.figures.position_rmse.unwrap() < 6e-4, "{:?}", found.figures);
    let equal = tested(&grid(21, 21.0), &|_, x| wave(x));
    assert!(equal.period.is_none_or(|p| p > 42.0), "{:?}", equal.period);
    // values that have nothing to do with each other are no wave
    assert_eq!(tested(&unequal, &|i, _| 2e-3 * noise(7000 + i)).basis, Basis::Table);
}

#[test]
fn a_position_far_from_all_others_takes_no_longer() {
    let mut x = grid(21, 20.0);
    x.push(1e9);
    let all = readings(&x, |i, x| 1e-3 * (x / 70.0).sin() + 1e-4 * noise(i));
    assert!(fit(&all, &Request::default()).is_ok());
}
