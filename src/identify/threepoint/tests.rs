//! The solver against exact motions, its stated uncertainty against many seeds, and what it refuses.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::*;

const TRIANGLE: [[f64; 3]; 3] = [[-120.0, -80.0, 10.0], [180.0, -70.0, -20.0], [20.0, 190.0, 40.0]];
const ORIGIN: [f64; 3] = [812.0, -40.0, 77.0];

/// A rotation written out element by element, so that no code of the product is its own judge.
fn rotation(a: f64, b: f64, c: f64) -> Mat3 {
    let ((sa, ca), (sb, cb), (sc, cc)) = (a.sin_cos(), b.sin_cos(), c.sin_cos());
    Mat3::new(
        cc * cb,
        cc * sb * sa - sc * ca,
        cc * sb * ca + sc * sa,
        sc * cb,
        sc * sb * sa + cc * ca,
        sc * sb * ca - cc * sa,
        -sb,
        cb * sa,
        cb * ca,
    )
}

fn exact(points: &[[f64; 3]], truth: &[f64; 6], covariance: Mat3) -> Vec<Seen> {
    let turn = rotation(truth[3], truth[4], truth[5]);
    let shift = Vec3::new(truth[0], truth[1], truth[2]);
    points
        .iter()
        .map(|p| {
            let platform = Vec3::from(*p);
            Seen { platform, measured: Vec3::from(ORIGIN) + shift + turn * platform, covariance }
        })
        .collect()
}

const TRUTH: [f64; 6] = [0.021, -0.013, 0.034, 6e-5, -4e-5, 9e-5];

#[test]
fn exact_points_give_the_rigid_motion_exactly_and_the_linear_one_to_second_order() {
    let fit = solve(&exact(&TRIANGLE, &TRUTH, Mat3::identity() * 1e-6), &Vec3::from(ORIGIN)).unwrap();
    for (i, truth) in TRUTH.iter().enumerate() {
        assert!((fit.rigid[i] - truth).abs() < 2e-12, "{i}: {}", fit.rigid[i]);
        // eps^2 r / 2
        assert!((fit.motion[i] - truth).abs() < if i < 3 { 3e-6 } else { 2e-8 });
    }
    assert_eq!((fit.dof, fit.geometry.rank), (3, 6));
}

/// Share of seeds in which each of the six lies within 1.96 of its stated standard deviations, and in which the
/// rigidity test at 5 % passes.
fn coverage(points: &[[f64; 3]], noise: impl Fn(&Vec3) -> Mat3, seeds: u64) -> ([f64; 6], f64) {
    let mut inside = [0u32; 6];
    let mut passed = 0u32;
    for seed in 0..seeds {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut seen = exact(points, &TRUTH, Mat3::identity());
        for s in &mut seen {
            s.covariance = noise(&s.measured);
            let unit: [f64; 3] = core::array::from_fn(|_| StandardNormal.sample(&mut random));
            s.measured += s.covariance.cholesky().unwrap().l() * Vec3::from(unit);
        }
        let fit = solve(&seen, &Vec3::from(ORIGIN)).unwrap();
        for i in 0..6 {
            inside[i] += u32::from((fit.motion[i] - TRUTH[i]).abs() < 1.96 * fit.covariance[(i, i)].sqrt());
        }
        passed += u32::from(fit.p_value > 0.05);
    }
    (inside.map(|n| f64::from(n) / seeds as f64), f64::from(passed) / seeds as f64)
}

#[test]
fn the_stated_interval_holds_the_truth_at_the_stated_rate() {
    let isotropic = |_: &Vec3| Mat3::identity() * 1e-6;
    let tracker = |p: &Vec3| {
        let beam = p - Vec3::new(2500.0, 2800.0, 300.0);
        let range = beam.norm();
        let along = beam / range;
        along * along.transpose() * 4e-6
            + (Mat3::identity() - along * along.transpose()) * (range * 3e-6).powi(2)
    };
    let mut five = TRIANGLE.to_vec();
    five.extend([[0.0, 0.0, 200.0], [-150.0, 150.0, -90.0]]);
    for (rates, passed) in [
        coverage(&TRIANGLE, isotropic, 2000),
        coverage(&TRIANGLE, tracker, 2000),
        coverage(&five, tracker, 2000),
    ] {
        // 95 % of 2000 seeds: three standard deviations of the count are 1.5 %
        assert!(rates.iter().chain([&passed]).all(|r| (0.935..=0.965).contains(r)), "{rates:?} {passed}");
    }
}

#[test]
fn the_reference_point_at_the_centroid_decouples() {
    let fit = solve(&exact(&TRIANGLE, &TRUTH, Mat3::identity() * 1e-6), &Vec3::from(ORIGIN)).unwrap();
    let (motion, covariance) = fit.at(&fit.geometry.centroid);
    assert!(covariance.fixed_view::<3, 3>(0, 3).norm() < 1e-18);
    assert!((covariance[(0, 0)] - 1e-6 / 3.0).abs() < 1e-15);
    let eps = Vec3::new(motion[3], motion[4], motion[5]);
    let expected = motion[0] - eps.cross(&fit.geometry.centroid).x;
    assert!((fit.motion[0] - expected).abs() < 1e-15);
}

#[test]
fn a_loose_point_fails_the_test_and_is_named() {
    let mut points = TRIANGLE.to_vec();
    points.extend([[0.0, 0.0, 200.0], [-150.0, 150.0, -90.0]]);
    let mut seen = exact(&points, &TRUTH, Mat3::identity() * 1e-6);
    seen[3].measured.y += 0.02;
    let fit = solve(&seen, &Vec3::from(ORIGIN)).unwrap();
    assert!(fit.p_value < 1e-6, "{}", fit.p_value);
    let (suspect, lead) = fit.suspect().unwrap();
    assert!(suspect == 3 && lead > 1.5, "{:?}", fit.relief);
    // setting the loose point free takes all of the misfit away
    assert!((fit.relief[3] - fit.chi2).abs() < 1e-3 * fit.chi2);
}

#[test]
fn lines_and_single_places_are_refused_with_the_reason() {
    let line: Vec<[f64; 3]> = (0..4).map(|i| [100.0 * f64::from(i), 20.0 * f64::from(i), 0.0]).collect();
    let error = solve(&exact(&line, &TRUTH, Mat3::identity()), &Vec3::from(ORIGIN)).unwrap_err();
    assert!(matches!(error, ThreePointError::Deficient { points: 4, rank: 5, line: Some(_) }), "{error}");
    assert!(
        error.to_string().contains("rotation about the line (0.981 0.196 0.000) is not observable"),
        "{error}"
    );
    let place = solve(&exact(&[[1.0, 2.0, 3.0]; 3], &TRUTH, Mat3::identity()), &Vec3::zeros()).unwrap_err();
    assert!(matches!(place, ThreePointError::Deficient { rank: 3, line: None, .. }), "{place}");
    let mut near = line;
    near[1][2] = 0.05;
    let error = solve(&exact(&near, &TRUTH, Mat3::identity()), &Vec3::zeros()).unwrap_err();
    assert!(error.to_string().contains("exceeds the limit of 1000"), "{error}");
    let flat = solve(&exact(&TRIANGLE, &TRUTH, Mat3::zeros()), &Vec3::zeros()).unwrap_err();
    assert_eq!(flat, ThreePointError::Covariance { point: 1 });
    let mut bad = exact(&TRIANGLE, &TRUTH, Mat3::identity());
    bad[2].measured.x = f64::NAN;
    assert_eq!(solve(&bad, &Vec3::zeros()).unwrap_err(), ThreePointError::NotFinite { point: 3 });
}

#[test]
fn sag_of_conditioning_is_the_growth_of_the_roll() {
    for height in [200.0, 20.0, 2.0] {
        let points = [[-150.0, 0.0, 0.0], [150.0, 0.0, 0.0], [0.0, height, 0.0]];
        let fit = solve(&exact(&points, &TRUTH, Mat3::identity() * 1e-6), &Vec3::from(ORIGIN)).unwrap();
        let roll = fit.covariance[(3, 3)].sqrt();
        let other = fit.covariance[(4, 4)].min(fit.covariance[(5, 5)]).sqrt();
        assert!(
            (roll / other - fit.geometry.roll_growth).abs() < 0.01 * fit.geometry.roll_growth,
            "{height}"
        );
        assert_eq!(
            fit.geometry.warning().is_some(),
            height < 15.0,
            "{height}: {}",
            fit.geometry.condition_centroid
        );
    }
}

#[test]
fn a_far_platform_origin_is_no_lack_of_points() {
    let far: Vec<[f64; 3]> = TRIANGLE.iter().map(|p| [p[0] + 9e3, p[1], p[2]]).collect();
    let fit = solve(&exact(&far, &TRUTH, Mat3::identity() * 1e-6), &Vec3::from(ORIGIN)).unwrap();
    assert!(fit.geometry.condition_scaled > 1e3 && fit.geometry.condition_centroid < 10.0);
}

#[test]
fn a_carriage_on_the_workpiece_side_moves_the_other_way() {
    use volcomp_units::axes::{AxisName, Travel};
    let shot = |position: f64, sign: f64| {
        let mut seen = exact(&TRIANGLE, &TRUTH, Mat3::identity() * 1e-6);
        for s in &mut seen {
            s.measured.y += sign * position;
        }
        Shot { position, cycle: 1, travel: Travel::Forward, ids: vec![0, 1, 2], seen }
    };
    for (workpiece_side, sign) in [(true, -1.0), (false, 1.0)] {
        let series = Series {
            axis: AxisName::Y,
            workpiece_side,
            origin: Vec3::from(ORIGIN),
            reference: Vec3::zeros(),
        };
        let fit = solve_series(&[shot(0.0, sign), shot(450.0, sign)], &series).unwrap();
        assert!((fit.rows[1].motion - fit.rows[0].motion).norm() < 1e-12, "{workpiece_side}");
        assert_eq!(fit.dof, 6);
        let wrong = solve_series(&[shot(450.0, -sign)], &series).unwrap();
        assert!(wrong.rows[0].motion[1].abs() > 800.0);
    }
}
