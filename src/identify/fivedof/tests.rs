use proptest::prelude::*;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::align::{Level, align};
use super::resting::{RestingError, RestingReading, calibrate};
use super::*;
use volcomp_units::axes::AxisName;

const FOCAL: [f64; 3] = [230.0, 250.0, 210.0];
const BEAMS: [[f64; 2]; 2] = [[-35.0, 8.0], [33.0, 8.0]];

/// The optics with true signs, gains and dead path, written from the README of the vectors.
#[derive(Clone, Copy)]
struct Optics {
    focal: [f64; 3],
    beams: [[f64; 2]; 2],
    signs: Channels,
    gain: f64,
    dead_path: f64,
}

const PLAIN: Optics = Optics { focal: FOCAL, beams: BEAMS, signs: [[1.0; 2]; 5], gain: 1.0, dead_path: 0.0 };

impl Optics {
    fn read(&self, [ey, ez, ea, eb, ec]: [f64; 5], theta: [[f64; 2]; 2], d: f64) -> Channels {
        let [f1, f2, f3] = self.focal;
        let cube = |b: [f64; 2]| [ey - ea * b[1], ez + ea * b[0]];
        let lever = self.gain * (d + self.dead_path);
        let quadrant = |j: usize| {
            let [y, z] = cube(self.beams[j]);
            [2.0 * (y - lever * theta[j][0]), 2.0 * (z - lever * theta[j][1])]
        };
        let plain = [
            [f1 * (-2.0 * ec + theta[0][0]), f1 * (2.0 * eb + theta[0][1])],
            [-f2 * theta[0][0], -f2 * theta[0][1]],
            [-f3 * theta[1][0], -f3 * theta[1][1]],
            quadrant(1),
            quadrant(0),
        ];
        std::array::from_fn(|c| std::array::from_fn(|i| self.signs[c][i] * plain[c][i]))
    }
}

fn head() -> Head {
    Head::nominal(FOCAL, BEAMS).unwrap()
}

proptest! {
    #[test]
    fn any_errors_and_any_drift_are_found(
        motion in prop::array::uniform5(-1e-4..1e-4f64),
        drift in prop::array::uniform4(-1e-5..1e-5f64),
        distance in 100.0..5000.0f64,
        beams in prop::array::uniform4(-60.0..60.0f64),
        signs in prop::array::uniform10(prop::bool::ANY),
    ) {
        let beams = [[beams[0], beams[1]], [beams[2], beams[3]]];
        prop_assume!((beams[1][0] - beams[0][0]).hypot(beams[1][1] - beams[0][1]) > 10.0);
        let signs: Channels =
            std::array::from_fn(|c| std::array::from_fn(|i| if signs[2 * c + i] { -1.0 } else { 1.0 }));
        let optics = Optics { beams, signs, ..PLAIN };
        let change = optics.read(motion, [[drift[0], drift[1]], [drift[2], drift[3]]], distance);
        let head = Head { beams, signs, ..head() };
        let found = head.reduce(&Readings { distance, change });
        for i in 0..5 {
            let limit = if i < 2 { 1e-13 } else { 1e-14 };
            prop_assert!((found.motion[i] - motion[i]).abs() < limit, "{i} {:?} {motion:?}", found.motion);
        }
        prop_assert!(found.stretch.abs() < 1e-15);
    }
}

#[test]
fn the_printed_factor_leaves_half_of_the_drift() {
    let change = PLAIN.read([0.0; 5], [[1e-6, 0.0]; 2], 3000.0);
    let with = |gain: f64| {
        let head = Head { gain: [[gain; 2]; 2], ..head() };
        head.reduce(&Readings { distance: 3000.0, change }).motion[0]
    };
    assert!(with(1.0).abs() < 1e-15);
    // 1.5 um per urad at 3 m, as in equations 4.2, (4)
    assert!((with(0.5) + 1.5e-3).abs() < 1e-9 && (with(0.0) + 3e-3).abs() < 1e-9);
}

#[test]
fn a_bent_carriage_shows_in_the_stretch() {
    let mut change = PLAIN.read([0.0; 5], [[0.0; 2]; 2], 1000.0);
    change[3][0] += 2.0 * 0.004;
    let head = Head { noise: [[0.2e-3; 2]; 5], ..head() };
    assert!((head.reduce(&Readings { distance: 1000.0, change }).stretch - 0.004).abs() < 1e-12);
    // two quadrants of 0.1 um, two pointings of 0.2 um / f times 1 m
    let expected = (2.0f64 * 0.1e-3f64.powi(2) + (0.2f64 / 250.0).powi(2) + (0.2f64 / 210.0).powi(2)).sqrt();
    assert!((head.stretch_std(1000.0) - expected).abs() < 1e-9);
}

#[test]
fn the_covariance_is_that_of_simulated_noise() {
    let sigma = [[0.3e-3, 0.4e-3], [0.2e-3, 0.25e-3], [0.2e-3; 2], [0.5e-3; 2], [0.6e-3, 0.5e-3]];
    let head = Head { noise: sigma, ..head() };
    let covariance = head.covariance(800.0);
    let mut sums = [0.0; 5];
    let n = 20_000;
    for seed in 0..n {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let change = sigma.map(|c| {
            c.map(|s| {
                let noise: f64 = StandardNormal.sample(&mut random);
                s * noise
            })
        });
        let m = head.reduce(&Readings { distance: 800.0, change }).motion;
        for i in 0..5 {
            sums[i] += m[i] * m[i];
        }
    }
    for i in 0..5 {
        let ratio = sums[i] / n as f64 / covariance[(i, i)];
        assert!((0.95..1.05).contains(&ratio), "{i} {ratio}");
    }
}

#[test]
fn roles_rotate_with_the_axis() {
    let m = [1.0, 2.0, 3.0, 4.0, 5.0];
    assert_eq!(to_machine(AxisName::X, m), [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]);
    assert_eq!(to_machine(AxisName::Y, m), [2.0, 0.0, 1.0, 5.0, 3.0, 4.0]);
    assert_eq!(to_machine(AxisName::Z, m), [1.0, 2.0, 0.0, 4.0, 5.0, 3.0]);
    assert_eq!(lateral(AxisName::Y), ['z', 'x']);
}

#[test]
fn impossible_instruments_are_refused() {
    assert!(matches!(
        Head::nominal([230.0, -1.0, 200.0], BEAMS),
        Err(HeadError::Focal { detector: Detector::Psd2, .. })
    ));
    assert!(matches!(Head::nominal(FOCAL, [[1.0, 1.0]; 2]), Err(HeadError::Beams { .. })));
    let mut odd = head();
    odd.signs[3][1] = 0.5;
    assert!(matches!(odd.check(), Err(HeadError::Sign { detector: Detector::Qd1, .. })));
}

/// A run of 13 positions with a roll of `roll(s)` and beams that are `skew` (rad) apart, s from 0 to 1.
fn run(roll: impl Fn(f64) -> f64, skew: f64) -> (Vec<f64>, Vec<FiveDof>) {
    let positions: Vec<f64> = (0..13).map(|i| f64::from(i) * 250.0).collect();
    let rows = positions
        .iter()
        .map(|x| {
            let s = x / 3000.0;
            let bow = 0.01 * s * (1.0 - s);
            let motion = [bow + 2e-5 * x, -2.0 * bow, roll(s), 1e-5 * s, 0.0];
            let mut change = PLAIN.read(motion, [[0.0; 2]; 2], 500.0 + x);
            change[4][1] += 2.0 * skew * x;
            head().reduce(&Readings { distance: 500.0 + x, change })
        })
        .collect();
    (positions, rows)
}

#[test]
fn the_level_restores_the_slope_of_roll_and_the_beams_lose_theirs() {
    let truth = |s: f64| 3e-5 * s + 1e-5 * (6.0 * s).sin();
    let (positions, rows) = run(truth, 4e-6);
    let change = truth(1.0) - truth(0.0);
    let aligned = align(&head(), &positions, &rows, Level::Read(change)).unwrap();
    for (x, m) in positions.iter().zip(&aligned.motion) {
        let s = x / 3000.0;
        assert!((m[2] - truth(s)).abs() < 1e-12, "roll at {x}");
        let bow = 0.01 * s * (1.0 - s);
        assert!((m[0] - bow).abs() < 1e-12, "straightness at {x}");
    }
    assert!((aligned.roll_slope + 4e-6 / 68.0).abs() < 1e-12);
    assert!((aligned.slopes[1][0] - (2e-5 - change * 8.0 / 3000.0)).abs() < 1e-12);
    // without a level: the same about its end points
    let bare = align(&head(), &positions, &rows, Level::None).unwrap();
    for (x, m) in positions.iter().zip(&bare.motion) {
        let s = x / 3000.0;
        assert!((m[2] - (truth(s) - change * s)).abs() < 1e-12);
    }
    assert!(align(&head(), &positions[..2], &rows[..2], Level::None).is_err());
}

/// A log of a resting carriage: pointing wanders by `step` rad per reading, noise in mm.
fn log(optics: &Optics, seed: u64, distances: &[f64], step: f64, noise: f64) -> Vec<RestingReading> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut normal = move || -> f64 { StandardNormal.sample(&mut random) };
    let mut theta = [[0.0; 2]; 2];
    let mut speed = [[0.0; 2]; 2];
    let mut all = Vec::new();
    for &distance in distances {
        for _ in 0..120 {
            for j in 0..2 {
                for i in 0..2 {
                    // a smooth wander: pointing drifts as the head warms, it does not jitter
                    speed[j][i] = 0.9 * speed[j][i] + step * normal();
                    theta[j][i] += speed[j][i];
                }
            }
            let mut channels = optics.read([0.0; 5], theta, distance);
            for c in channels.as_flattened_mut() {
                *c += noise * normal();
            }
            all.push(RestingReading { distance, push: [0.0; 2], channels });
        }
    }
    all
}

const WIRED: Optics = Optics {
    signs: [[-1.0, 1.0], [1.0, -1.0], [-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0]],
    gain: 1.0,
    dead_path: 140.0,
    ..PLAIN
};

/// What a user knows: focal lengths, beams, and where plus is on the quadrant detectors.
fn wired_head() -> Head {
    let mut head = head();
    head.signs[3] = WIRED.signs[3];
    head.signs[4] = WIRED.signs[4];
    head
}

#[test]
fn a_resting_log_gives_gain_path_and_signs_within_its_intervals() {
    let (mut inside_gain, mut inside_path, mut inside_angle) = (0, 0, 0);
    let seeds = 2000;
    for seed in 0..seeds {
        let c = calibrate(&wired_head(), &log(&WIRED, seed, &[300.0, 2800.0], 1.5e-6, 0.3e-3)).unwrap();
        assert_eq!(c.head.signs, WIRED.signs, "seed {seed}");
        for i in 0..2 {
            inside_angle += usize::from((c.angle_gain[i].value - 1.0).abs() < 1.96 * c.angle_gain[i].std);
            for beam in 0..2 {
                let (g, p) = (c.gain[beam][i], c.path[beam][i]);
                inside_gain += usize::from((g.value - 1.0).abs() < 1.96 * g.std);
                inside_path += usize::from((p.value - 140.0).abs() < 1.96 * p.std);
                assert!(g.value - 0.5 > 3.0 * g.std, "the halved gain is excluded");
            }
        }
    }
    for (count, of) in [(inside_gain, 4), (inside_path, 4), (inside_angle, 2)] {
        let share = f64::from(count as u32) / f64::from(seeds as u32 * of);
        assert!((0.935..0.965).contains(&share), "{share}");
    }
}

#[test]
fn a_calibrated_head_takes_the_drift_out() {
    let c = calibrate(&wired_head(), &log(&WIRED, 7, &[300.0, 1500.0, 2800.0], 3e-7, 0.1e-3)).unwrap();
    let motion = [0.004, -0.003, 2e-5, 1e-5, -3e-5];
    let change = WIRED.read(motion, [[8e-6, -5e-6], [4e-6, 6e-6]], 2000.0);
    let found = c.head.reduce(&Readings { distance: 2000.0, change });
    for (found, truth) in found.motion.iter().zip(motion).take(2) {
        assert!((found - truth).abs() < 3e-4, "{found} {truth}");
    }
    assert_eq!(c.linearity.1, 4);
    assert!(c.linearity.0 < 20.0, "{:?}", c.linearity);
}

#[test]
fn pushes_give_the_signs_of_the_quadrants() {
    let mut log = log(&WIRED, 3, &[300.0, 2800.0], 3e-7, 0.1e-3);
    for (k, r) in log.iter_mut().enumerate() {
        if k % 120 >= 60 {
            r.push = [0.05, -0.03];
            for detector in [3, 4] {
                for i in 0..2 {
                    r.channels[detector][i] += WIRED.signs[detector][i] * 2.0 * r.push[i];
                }
            }
        }
    }
    // nothing is known about signs here
    let c = calibrate(&head(), &log).unwrap();
    assert_eq!((c.head.signs, c.pushed), (WIRED.signs, [true; 2]));
    for r in &mut log {
        r.push = r.push.map(|p| p * 1e3);
    }
    assert!(matches!(calibrate(&head(), &log), Err(RestingError::Push { .. })));
}

#[test]
fn a_push_is_read_beside_pointing_that_jumps_from_reading_to_reading() {
    let mut random = ChaCha8Rng::seed_from_u64(5);
    let mut normal = move || -> f64 { StandardNormal.sample(&mut random) };
    for _ in 0..20 {
        let (mut theta, mut all) = ([[0.0; 2]; 2], Vec::new());
        for k in 0..320 {
            theta.as_flattened_mut().iter_mut().for_each(|t| *t += 8e-6 * normal());
            let distance = if k < 160 { 200.0 } else { 2800.0 };
            let mut channels = WIRED.read([0.0; 5], theta, distance);
            channels.as_flattened_mut().iter_mut().for_each(|c| *c += 0.1e-3 * normal());
            // forty readings without and forty with a push that is as small as what the pointing does
            let push = if k % 80 < 40 { [0.0; 2] } else { [0.02; 2] };
            for detector in [3, 4] {
                for i in 0..2 {
                    channels[detector][i] += WIRED.signs[detector][i] * 2.0 * push[i];
                }
            }
            all.push(RestingReading { distance, push, channels });
        }
        let c = calibrate(&head(), &all).unwrap();
        assert_eq!((c.head.signs, c.pushed), (WIRED.signs, [true; 2]));
    }
}

#[test]
fn logs_that_say_nothing_are_refused() {
    let calibrate = |log: &[RestingReading]| calibrate(&wired_head(), log).unwrap_err();
    let near = |e: RestingError, text: &str| assert!(e.to_string().contains(text), "{e}");
    near(calibrate(&log(&WIRED, 1, &[300.0], 3e-7, 0.1e-3)), "one distance only (300.0 mm)");
    near(calibrate(&log(&WIRED, 1, &[300.0, 2800.0], 0.0, 0.3e-3)), "no pointing drift");
    let weak = calibrate(&log(&WIRED, 5, &[300.0, 2800.0], 2e-8, 0.5e-3));
    assert!(matches!(weak, RestingError::NoiseAboveDrift { .. } | RestingError::NoDrift { .. }), "{weak}");
    near(calibrate(&log(&WIRED, 1, &[300.0, 301.0], 3e-7, 0.3e-3)), "take distances farther apart");
    near(calibrate(&log(&WIRED, 1, &[300.0, 2800.0], 3e-7, 0.1e-3)[..130]), "10 readings at 2800.0 mm");
    assert!(matches!(calibrate(&[]), RestingError::OneDistance { .. }));
}
