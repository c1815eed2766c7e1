//! Exact circles, stated uncertainty against many seeds, the closed formulas, and refusals.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::*;

struct Rig {
    axis: Vec3,
    centre_2: Vec3,
    distance: f64,
    radii: [f64; 2],
    tip: f64,
    n: usize,
    arc: f64,
}

const RIG: Rig = Rig {
    axis: Vec3::new(0.3, -0.2, 0.932_737_905_308_882),
    centre_2: Vec3::new(1800.0, 420.0, 610.0),
    distance: 150.0,
    radii: [42.0, 55.0],
    tip: 90.0,
    n: 72,
    arc: core::f64::consts::TAU,
};

impl Rig {
    fn points(&self, noise: f64, seed: u64) -> [Vec<Vec3>; 2] {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let axis = self.axis.normalize();
        let u = Vec3::new(axis.z, 0.0, -axis.x).normalize();
        let v =
            Vec3::new(axis.y * u.z - axis.z * u.y, axis.z * u.x - axis.x * u.z, axis.x * u.y - axis.y * u.x);
        [self.distance, 0.0].map(|height| {
            let radius = self.radii[usize::from(height == 0.0)];
            (0..self.n)
                .map(|i| {
                    let (s, c) = (0.4 + self.arc * i as f64 / self.n as f64).sin_cos();
                    let error: [f64; 3] = core::array::from_fn(|_| {
                        let unit: f64 = StandardNormal.sample(&mut random);
                        noise * unit
                    });
                    self.centre_2 + axis * height + u * (radius * c) + v * (radius * s) + Vec3::from(error)
                })
                .collect()
        })
    }

    fn solve(&self, noise: f64, sigma: Option<f64>, seed: u64) -> ToolAxis {
        let [one, two] = self.points(noise, seed);
        solve(&CirclesInput {
            points_1: &one,
            points_2: &two,
            nominal_axis: Vec3::new(0.3, -0.2, 0.9),
            tip_beyond_centre_2: self.tip,
            sigma,
            registration: 0.0,
        })
        .unwrap()
    }

    fn true_tip(&self) -> Vec3 {
        self.centre_2 - self.axis.normalize() * self.tip
    }
}

#[test]
fn exact_circles_give_axis_and_tip_both_ways() {
    for arc in [core::f64::consts::TAU, 2.5] {
        let rig = Rig { arc, ..RIG };
        let found = rig.solve(0.0, Some(0.001), 1);
        assert!((found.direction - RIG.axis.normalize()).norm() < 1e-12);
        assert!((found.tip - rig.true_tip()).norm() < 1e-9);
        assert_eq!(found.predicted.is_some(), arc > 6.0);
        let joint = found.coaxial.unwrap();
        assert!((joint.direction - RIG.axis.normalize()).norm() < 1e-12);
        assert!((joint.tip - rig.true_tip()).norm() < 1e-9 && (joint.radii[1] - 55.0).abs() < 1e-9);
    }
}

#[test]
fn the_stated_uncertainty_holds_and_the_closed_formulas_agree() {
    let sigma = 0.004;
    for arc in [core::f64::consts::TAU, 3.5] {
        let rig = Rig { arc, n: 48, ..RIG };
        let truth = RIG.axis.normalize();
        let u = perpendicular(&truth);
        let (mut inside, mut inside_tip, mut joint_inside, mut squares) = (0, 0, 0, 0.0);
        let seeds = 2000;
        for seed in 0..seeds {
            let found = rig.solve(sigma, Some(sigma), seed);
            let std = (u.transpose() * found.direction_covariance * u)[0].sqrt();
            let error = (found.direction - truth).dot(&u);
            squares += error * error;
            inside += u32::from(error.abs() < 1.96 * std);
            let tip_std = (u.transpose() * found.tip_covariance * u)[0].sqrt();
            inside_tip += u32::from((found.tip - rig.true_tip()).dot(&u).abs() < 1.96 * tip_std);
            if arc > 6.0 {
                let joint = found.coaxial.unwrap();
                joint_inside +=
                    u32::from((joint.direction - truth).dot(&u).abs() < 1.96 * joint.direction_std);
            }
        }
        let rate = |n: u32| f64::from(n) / seeds as f64;
        assert!((0.935..=0.965).contains(&rate(inside)), "direction {arc}: {}", rate(inside));
        assert!((0.935..=0.965).contains(&rate(inside_tip)), "tip {arc}: {}", rate(inside_tip));
        if arc > 6.0 {
            assert!((0.935..=0.965).contains(&rate(joint_inside)), "joint: {}", rate(joint_inside));
            let found = rig.solve(0.0, Some(sigma), 0);
            let predicted = found.predicted.unwrap();
            let seen = (squares / seeds as f64).sqrt();
            assert!((seen / predicted.direction - 1.0).abs() < 0.05, "{seen} {}", predicted.direction);
            assert!((found.direction_std()[1] / predicted.direction - 1.0).abs() < 1e-6);
            assert!((found.tip_lateral_std()[1] / predicted.tip_lateral - 1.0).abs() < 1e-6);
        }
    }
}

#[test]
fn ten_micrometres_between_two_trackers_are_fourteen_arcsec() {
    let [one, two] = RIG.points(0.0, 1);
    let input = CirclesInput {
        points_1: &one,
        points_2: &two,
        nominal_axis: RIG.axis,
        tip_beyond_centre_2: RIG.tip,
        sigma: Some(0.01),
        registration: 0.01,
    };
    let with = solve(&input).unwrap();
    let without = solve(&CirclesInput { registration: 0.0, ..input.clone() }).unwrap();
    let arcsec = |rad: f64| rad.to_degrees() * 3600.0;
    assert!((arcsec(with.registration_share) - 13.75).abs() < 0.01);
    assert!((arcsec(without.direction_std()[1]) - 3.24).abs() < 0.01);
    let both = with.registration_share.hypot(without.direction_std()[1]);
    assert!((with.direction_std()[1] / both - 1.0).abs() < 1e-6);
    assert!(with.tip_lateral_std()[1] > without.tip_lateral_std()[1]);
}

#[test]
fn planes_help_where_the_circles_are_large_and_close() {
    let close = Rig { distance: 40.0, radii: [150.0, 150.0], ..RIG };
    let found = close.solve(0.0, Some(0.01), 1);
    assert!(found.coaxial.unwrap().direction_std < 0.5 * found.predicted.unwrap().direction);
    let far = Rig { distance: 500.0, radii: [20.0, 20.0], ..RIG }.solve(0.0, Some(0.01), 1);
    let joint = far.coaxial.unwrap().direction_std;
    assert!(joint > 0.95 * far.predicted.unwrap().direction);
}

#[test]
fn residuals_larger_than_the_stated_noise_take_its_place() {
    let sigma = 0.004;
    let own = RIG.solve(sigma, None, 3);
    let stated = RIG.solve(sigma, Some(sigma), 3);
    assert!(!stated.residual_test.unwrap().has_failed() && stated.sigma == sigma);
    let doubted = RIG.solve(sigma, Some(sigma / 10.0), 3);
    assert!(doubted.residual_test.unwrap().has_failed());
    assert_eq!((doubted.sigma, doubted.tip_covariance), (own.sigma, own.tip_covariance));
}

#[test]
fn a_common_axis_is_tested() {
    let [one, mut two] = RIG.points(0.002, 7);
    let input = |two: &[Vec3]| {
        let input = CirclesInput {
            points_1: &one,
            points_2: two,
            nominal_axis: RIG.axis,
            tip_beyond_centre_2: RIG.tip,
            sigma: Some(0.002),
            registration: 0.0,
        };
        solve(&input).unwrap().coaxial.unwrap().p_value.unwrap()
    };
    assert!(input(&two) > 1e-3);
    for p in &mut two {
        p.x += 0.2;
    }
    assert!(input(&two) < 1e-3, "planes no longer across the line of the centres");
}

#[test]
fn what_has_no_axis_is_refused() {
    let [one, two] = RIG.points(0.0, 1);
    let with = |points_1: &[Vec3], points_2: &[Vec3], nominal_axis: Vec3, sigma: f64| {
        solve(&CirclesInput {
            points_1,
            points_2,
            nominal_axis,
            tip_beyond_centre_2: 1.0,
            sigma: Some(sigma),
            registration: 0.0,
        })
    };
    let error = with(&two, &one, RIG.axis, 0.001).unwrap_err();
    assert!(error.to_string().contains("are the circles exchanged"), "{error}");
    assert!(matches!(with(&one, &one, RIG.axis, 0.001), Err(CirclesError::CentresTogether { .. })));
    assert!(matches!(with(&one, &two, Vec3::zeros(), 0.001), Err(CirclesError::Input { .. })));
    assert!(matches!(with(&one, &two, RIG.axis, -1.0), Err(CirclesError::Input { what: "sigma", .. })));
    let error = with(&one[..2], &two, RIG.axis, 0.001).unwrap_err();
    assert!(error.to_string().starts_with("circle 1: 2 points"), "{error}");
}
