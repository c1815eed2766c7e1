use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::*;

/// Touches of a bar at `(y0, z0)` with a ball of radius `ball`, by exact geometry; noise along the normal.
fn touches(angles_deg: &[f64], y0: f64, z0: f64, bar: f64, ball: f64, sigma: f64, seed: u64) -> Vec<Contact> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let touch = |deg: &f64| {
        let noise: f64 = StandardNormal.sample(&mut random);
        let far = bar + ball + sigma * noise;
        Contact { y: y0 + far * deg.to_radians().cos(), z: z0 + far * deg.to_radians().sin() }
    };
    angles_deg.iter().map(touch).collect()
}

fn both_sides() -> Vec<f64> {
    (0..81).map(|i| 90.0 + f64::from(i)).chain((0..81).map(|i| -90.0 - f64::from(i))).collect()
}

fn one_side() -> Vec<f64> {
    (0..81).map(|i| 90.0 + 0.9 * f64::from(i)).collect()
}

#[test]
fn the_numbers_of_the_paper_come_back_exactly() {
    // 001: 162 points, spacing 0.2 mm, arm 173.7135 mm at -39.025 deg
    let arm = Arm { length: 173.7135, zero: (-39.025f64).to_radians() };
    let (y0, z0, rc) = (168.8053, 0.0024, 16.4935);
    let mut contacts = Vec::new();
    for side in [1.0, -1.0] {
        for i in 0..81 {
            let away = 0.2 * f64::from(i);
            let height = z0 + side * (rc * rc - away * away).sqrt();
            contacts.push(arm.contact(y0 - away, arm.zero + (height / arm.length).asin()));
        }
    }
    let found = calibrate(&contacts, 15.0, &Request::default()).unwrap();
    for circle in [found.geometric, found.kasa] {
        assert!((circle.y0 - y0).abs() < 1e-10 && (circle.z0 - z0).abs() < 1e-10, "{circle:?}");
        assert!((circle.radius - rc).abs() < 1e-10);
    }
    assert!((found.probe_radius - 1.4935).abs() < 1e-10);
    assert!((found.condition_raw_normal / 30_632_791.843_287_513 - 1.0).abs() < 1e-9);
    assert!(found.outliers.is_empty() && found.notes.is_empty(), "{:?}", found.notes);
}

#[test]
fn intervals_hold_the_truth_at_their_rate_on_both_kinds_of_arc() {
    for angles in [both_sides(), one_side()] {
        let mut inside = [0u32; 3];
        for seed in 0..2000 {
            let contacts = touches(&angles, 168.8, 0.5, 15.0, 1.4935, 0.001, seed);
            let found = calibrate(&contacts, 15.0, &Request::default()).unwrap();
            let std = found.covariance().unwrap().diagonal().map(f64::sqrt) * found.coverage_95();
            let off = [found.geometric.y0 - 168.8, found.geometric.z0 - 0.5, found.probe_radius - 1.4935];
            for k in 0..3 {
                inside[k] += u32::from(off[k].abs() < std[k]);
            }
        }
        for count in inside {
            assert!((1870..=1930).contains(&count), "{inside:?}");
        }
    }
}

#[test]
fn one_side_of_the_bar_is_uncertain_and_says_so() {
    let found = calibrate(&touches(&one_side(), 168.8, 0.0, 15.0, 1.5, 0.001, 3), 15.0, &Request::default());
    let found = found.unwrap();
    let std = found.covariance().unwrap()[(2, 2)].sqrt();
    assert!(std > 1.5 * 0.001, "{std}: 1 um of noise must become more in the radius");
    assert!(matches!(found.notes[..], [Note::OneSided { amplification, .. }] if amplification > 10.0));
    assert!((found.arc.to_degrees() - 72.0).abs() < 0.1);
}

#[test]
fn an_outlier_is_named_and_taken_out_where_asked_for() {
    let clean = touches(&both_sides(), 168.8, 0.0, 15.0, 1.5, 0.0005, 9);
    let mut dirty = clean.clone();
    dirty[17].z += 0.02;
    dirty[100].y -= 0.015;
    let kept = calibrate(&dirty, 15.0, &Request::default()).unwrap();
    assert!(kept.outliers.contains(&17));
    let out = calibrate(&dirty, 15.0, &Request { reject_outliers: true, ..Request::default() }).unwrap();
    assert_eq!(out.outliers, [17, 100]);
    let reference = calibrate(&clean, 15.0, &Request::default()).unwrap();
    assert!((out.probe_radius - reference.probe_radius).abs() < 0.1e-3);
    assert!((kept.probe_radius - reference.probe_radius).abs() > 0.1e-3);
    assert_eq!(out.residuals.len(), dirty.len());
}

#[test]
fn stated_noise_is_tested() {
    let contacts = touches(&both_sides(), 168.8, 0.0, 15.0, 1.5, 0.001, 5);
    let at =
        |sigma| calibrate(&contacts, 15.0, &Request { sigma: Some(sigma), ..Request::default() }).unwrap();
    assert!(at(0.001).test.unwrap().p_value > 0.01 && at(0.001).notes.is_empty());
    let doubted = at(0.0005);
    assert!(matches!(doubted.notes[..], [Note::MoreThanNoise { .. }]));
    let own = calibrate(&contacts, 15.0, &Request::default()).unwrap();
    assert_eq!((doubted.covariance(), doubted.dof), (own.covariance(), own.dof), "their scatter counts");
    assert_eq!(at(0.001).dof, None);
}

#[test]
fn what_determines_no_circle_is_refused_with_its_numbers() {
    let few = touches(&[0.0, 90.0], 0.0, 0.0, 15.0, 1.5, 0.0, 1);
    assert_eq!(
        calibrate(&few, 15.0, &Request::default()).unwrap_err(),
        ProbeError::Circle(BallError::TooFewPoints { found: 2, needed: 3 })
    );
    let short: Vec<f64> = (0..50).map(|i| 90.0 + 0.3 * f64::from(i)).collect();
    let short = touches(&short, 168.8, 0.0, 15.0, 1.5, 0.0, 1);
    let refused = calibrate(&short, 15.0, &Request::default()).unwrap_err();
    assert!(matches!(refused, ProbeError::ArcTooShort { amplification, .. } if amplification > 300.0));
    assert!(refused.to_string().contains("touch the bar from both sides"));
    let line: Vec<Contact> = (0..20).map(|i| Contact { y: f64::from(i), z: 0.0 }).collect();
    assert!(matches!(calibrate(&line, 15.0, &Request::default()), Err(ProbeError::Circle(_))));
    let good = touches(&both_sides(), 168.8, 0.0, 15.0, 1.5, 0.0, 1);
    assert!(matches!(calibrate(&good, 30.0, &Request::default()), Err(ProbeError::SmallerThanBar { .. })));
    for bar in [0.0, -1.0, f64::NAN] {
        assert!(matches!(calibrate(&good, bar, &Request::default()), Err(ProbeError::NotPositive { .. })));
    }
    let mut rough = good;
    for (i, c) in rough.iter_mut().enumerate().filter(|(i, _)| i % 5 == 0) {
        c.z += 0.3 + 0.01 * i as f64;
    }
    let strict = Request { reject_outliers: true, sigma: Some(1e-4) };
    assert!(matches!(calibrate(&rough, 15.0, &strict), Err(ProbeError::TooManyOutliers { limit: 16, .. })));
}
