//! Learning, weights, ages, limits, what is kept.

use super::*;
use crate::Adaptation;

fn rules() -> MapRules {
    MapRules {
        grid: NodeGrid::new(vec![0.0, 500.0, 1000.0], vec![0.0, 400.0], vec![0.0, 300.0]).unwrap(),
        components: vec![
            ComponentRules { std: 0.02, variance_per_s: 1e-9, limit: 0.05 },
            ComponentRules { std: 2e-5, variance_per_s: 1e-15, limit: 4e-5 },
        ],
        correlation_mm: 400.0,
        tau_s: None,
        gate: 10.8,
    }
}

/// One row of the length, one of the length plus a lever times the angle; sensor of 1 um.
fn rows(length: f64, angle: f64) -> [Row; 2] {
    let (lever, sigma) = (500.0, 1e-3);
    let row = |w: [f64; 2]| {
        let mut weights = [0.0; COMPONENTS_MAX];
        weights[..2].copy_from_slice(&w.map(|w| w / sigma));
        Row { weights, value: (w[0] * length + w[1] * angle) / sigma, delay: 0.0, kind: Kind::Length }
    };
    [row([1.0, 0.0]), row([1.0, lever])]
}

fn unit_noise() -> [MeasurementNoise; 2] {
    let adaptation = Some(Adaptation { share: 0.005, low: 0.01, high: 100.0 });
    [MeasurementNoise::new(1.0, adaptation).unwrap(); 2]
}

/// The numbers of a tour through the volume.
fn points() -> impl Iterator<Item = [f64; 3]> {
    (0..400).map(|i| {
        let f = |k: f64| (f64::from(i) * k).fract();
        [1000.0 * f(0.618), 400.0 * f(0.414), 300.0 * f(0.732)]
    })
}

#[test]
fn what_is_there_is_learned_and_used_what_is_not_is_left_alone() {
    let mut map = LiveMap::new(rules()).unwrap();
    let mut noise = unit_noise();
    for (i, point) in points().enumerate() {
        map.predict(0.1);
        let place = map.place(point);
        // an alternating micrometre of noise, and nothing in the angle
        let wobble = if i % 2 == 0 { 1e-3 } else { -1e-3 };
        let mut rows = rows(0.015, 0.0);
        rows.iter_mut().for_each(|row| row.value += wobble / 1e-3);
        assert!(map.judge(0, &place, &rows, &noise).rows == 2);
        map.update(0, &place, &rows, &mut noise);
    }
    let place = map.place([500.0, 200.0, 150.0]);
    assert!((map.output(0, &place) - 0.015).abs() < 1e-3, "{}", map.output(0, &place));
    assert!(map.output(1, &place).abs() < 4e-7, "{}", map.output(1, &place));
    assert!(map.weight() > 0.95, "{:?}", map.evidence());
    let (_, std) = map.estimate(0, &place);
    assert!(std < 1e-3);
}

#[test]
fn noise_about_a_map_that_is_right_is_not_used() {
    let mut map = LiveMap::new(rules()).unwrap();
    let mut noise = unit_noise();
    for (i, point) in points().enumerate() {
        let place = map.place(point);
        let mut rows = rows(0.0, 0.0);
        for (k, row) in rows.iter_mut().enumerate() {
            // without memory, of unit variance
            row.value = 3.46 * (((i * 2 + k) as f64 * 12.9898).sin() * 43_758.545_3).rem_euclid(1.0) - 1.73;
        }
        map.update(0, &place, &rows, &mut noise);
    }
    assert!(map.weight() < 0.2, "{}", map.evidence());
}

#[test]
fn the_output_is_limited_and_an_outlier_is_told_from_a_reading() {
    let mut map = LiveMap::new(rules()).unwrap();
    let mut noise = [MeasurementNoise::unit(); 2];
    for point in points() {
        let place = map.place(point);
        map.update(0, &place, &rows(0.08, 0.0), &mut noise);
    }
    let place = map.place([300.0, 100.0, 100.0]);
    assert!((map.estimate(0, &place).0 - 0.08).abs() < 1e-3);
    assert!(map.output(0, &place) <= 0.05 + 1e-15);
    let good = map.judge(0, &place, &rows(0.08, 0.0), &noise);
    assert!(map.is_inside_gate(&good));
    let bad = map.judge(0, &place, &rows(0.2, 0.0), &noise);
    assert!(!map.is_inside_gate(&bad) && bad.worst > 1000.0);
    let blind = [Row { weights: [0.0; COMPONENTS_MAX], value: 5.0, delay: 0.0, kind: Kind::Angle }];
    let blind = map.judge(0, &place, &blind, &noise);
    assert!(blind.rows == 0 && !map.is_inside_gate(&blind), "what sees nothing updates nothing");
}

#[test]
fn what_was_kept_comes_back_and_nonsense_is_refused() {
    let mut map = LiveMap::new(rules()).unwrap();
    let mut noise = unit_noise();
    points().for_each(|point| {
        let place = map.place(point);
        map.update(0, &place, &rows(0.01, 1e-5), &mut noise);
    });
    let kept: Vec<_> = map.nodes().collect();
    let evidence = map.evidence();
    let mut other = LiveMap::new(rules()).unwrap();
    assert!(other.restore(&kept, evidence));
    for (a, b) in other.outputs().zip(map.outputs()) {
        assert!((a - b).abs() < 1e-12, "{a} {b}");
    }
    let mut bad = kept.clone();
    bad[1].0 = 0.6;
    assert!(!other.restore(&bad, evidence), "far beyond the limit");
    bad[1] = (0.0, -1.0);
    assert!(!other.restore(&bad, evidence));
    assert!(!other.restore(&kept[1..], evidence) && !other.restore(&kept, f64::NAN));
    other.forget();
    assert!(other.outputs().all(|v| v == 0.0));
}

fn learned() -> LiveMap {
    let mut map = LiveMap::new(rules()).unwrap();
    let mut noise = unit_noise();
    for point in points() {
        let place = map.place(point);
        map.update(0, &place, &rows(0.015, 1e-5), &mut noise);
    }
    map
}

#[test]
fn what_was_learned_fades_with_its_age_and_after_months_nothing_is_used() {
    let place = NodeGrid::new(vec![0.0, 500.0, 1000.0], vec![0.0, 400.0], vec![0.0, 300.0]).unwrap();
    let place = place.place([500.0, 200.0, 150.0]);
    // 0.02 mm of prior, 1e-9 mm2 per second: a memory of 2 x 4e5 s
    let mut map = learned();
    assert!((map.memory_s() / 8e5 - 1.0).abs() < 1e-9, "{}", map.memory_s());
    let fresh = map.output(0, &place);
    assert!(fresh > 0.014);
    let mut last = fresh;
    for hour in 1..=2000 {
        map.predict(3600.0);
        let used = map.output(0, &place);
        assert!(used <= last && last - used < 0.03 * fresh, "hour {hour}: {used} after {last}");
        last = used;
    }
    assert!(last.abs() < 1e-6, "{last}");
    // in one piece, as after a restart
    let mut kept = LiveMap::new(rules()).unwrap();
    let source = learned();
    assert!(kept.restore(&source.nodes().collect::<Vec<_>>(), source.evidence()));
    kept.predict(90.0 * 24.0 * 3600.0);
    assert!(kept.output(0, &place).abs() < 1e-6 && kept.output(1, &place).abs() < 1e-9);
    assert!(kept.weight() < 0.05, "{}", kept.weight());
}

#[test]
fn impossible_maps_are_refused() {
    let mut large = rules();
    large.grid =
        NodeGrid::new((0..30).map(f64::from).collect(), (0..30).map(f64::from).collect(), vec![0.0, 1.0])
            .unwrap();
    let error = LiveMap::new(large).unwrap_err().to_string();
    assert!(error.contains("1800 nodes") && error.contains("fewer"), "{error}");
    let mut wrong = rules();
    wrong.components[1].limit = 0.0;
    assert!(matches!(LiveMap::new(wrong), Err(MapError::NotPositive { what: "limit of the map", .. })));
    let mut wrong = rules();
    wrong.tau_s = Some(-1.0);
    assert!(LiveMap::new(wrong).is_err());
    let mut none = rules();
    none.components.clear();
    assert!(matches!(LiveMap::new(none), Err(MapError::Filter(_))));
}
