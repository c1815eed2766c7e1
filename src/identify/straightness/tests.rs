use proptest::prelude::*;

use super::*;

/// The smallest band over all lines through two points: exact, and slow.
fn by_enumeration(x: &[f64], y: &[f64]) -> f64 {
    let mut best = f64::INFINITY;
    for i in 0..x.len() {
        for j in 0..i {
            if x[i] != x[j] {
                let [low, high] = band(x, y, (y[i] - y[j]) / (x[i] - x[j]));
                best = best.min(high - low);
            }
        }
    }
    best
}

#[test]
fn a_bow_has_its_height_about_the_end_points_and_less_elsewhere() {
    let x: Vec<f64> = (0..=20).map(|i| f64::from(i) * 25.0).collect();
    let y: Vec<f64> = x.iter().map(|x| 3e-5 * x + 0.004 * (1.0 - (x / 250.0 - 1.0).powi(2))).collect();
    let [ls, ep, mz] = Rule::ALL.map(|rule| Line::fit(&x, &y, rule).unwrap());
    for line in [ls, ep, mz] {
        assert!((line.slope - 3e-5).abs() < 1e-15, "{line:?}");
        assert!((line.straightness - 0.004).abs() < 1e-15);
    }
    assert!((ep.intercept).abs() < 1e-15 && (mz.intercept - 0.002).abs() < 1e-15);
    assert!((ep.deviations(&x, &y)[10] - 0.004).abs() < 1e-15);
}

#[test]
fn uncertainty_of_the_slopes() {
    let x = [0.0, 100.0, 200.0, 300.0, 400.0];
    let y = [0.0, 0.001, -0.001, 0.002, 0.0];
    let [ls, ep, mz] = Rule::ALL.map(|rule| Line::fit(&x, &y, rule).unwrap().slope_std);
    assert!((ls - 1.0 / 100_000f64.sqrt()).abs() < 1e-15);
    assert!((ep - 2f64.sqrt() / 400.0).abs() < 1e-15);
    assert!(mz > ls);
}

#[test]
fn two_points_are_straight_and_one_is_nothing() {
    for rule in Rule::ALL {
        let line = Line::fit(&[10.0, -10.0], &[1.0, 0.0], rule).unwrap();
        assert!((line.slope - 0.05).abs() < 1e-15 && line.straightness.abs() < 1e-15, "{rule:?} {line:?}");
        assert_eq!(Line::fit(&[], &[], rule), Err(LineError::TooFewPositions { found: 0 }));
        assert_eq!(
            Line::fit(&[5.0; 3], &[1.0, 2.0, 3.0], rule),
            Err(LineError::TooFewPositions { found: 1 })
        );
        assert_eq!(Line::fit(&[0.0, 1.0], &[0.0, f64::NAN], rule), Err(LineError::NotFinite { row: 2 }));
        assert!(Line::fit(&[0.0], &[], rule).is_err());
    }
}

proptest! {
    #[test]
    fn the_minimum_zone_is_the_smallest_band(
        points in prop::collection::vec((-20i32..20, -1000i32..1000), 2..40),
    ) {
        let x: Vec<f64> = points.iter().map(|p| f64::from(p.0) * 12.5).collect();
        let y: Vec<f64> = points.iter().map(|p| f64::from(p.1) * 1e-5).collect();
        prop_assume!(x.iter().any(|v| *v != x[0]));
        let [ls, ep, mz] = Rule::ALL.map(|rule| Line::fit(&x, &y, rule).unwrap());
        prop_assert!((mz.straightness - by_enumeration(&x, &y)).abs() < 1e-12);
        prop_assert!(mz.straightness <= ls.straightness + 1e-12 && mz.straightness <= ep.straightness + 1e-12);
        let deviations = mz.deviations(&x, &y);
        let high = deviations.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        prop_assert!((high - mz.straightness / 2.0).abs() < 1e-12, "the line runs in the middle of its band");
    }
}
