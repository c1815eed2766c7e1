//! The filter on node values and the look-up of its map work in memory made at construction.

use assert_no_alloc::assert_no_alloc;
use volcomp::estimate::{
    Adaptation, MeasurementNoise, NodeFilter, NodeGrid, Observation, Process, Rules, Verdict,
};

#[test]
fn updates_predictions_and_look_ups_allocate_nothing() {
    let grid = NodeGrid::new(vec![0.0, 400.0, 800.0], vec![0.0, 300.0], vec![0.0, 250.0]).unwrap();
    let adaptation = Some(Adaptation { share: 0.05, low: 1e-14, high: 1e-9 });
    let mut noise = MeasurementNoise::new(1e-12, adaptation).unwrap();
    for process in [Process::RandomWalk { variance_per_s: 1e-13 }, Process::MeanReverting { tau_s: 100.0 }] {
        let mut filter =
            NodeFilter::new(&grid, &[0.0; 36], &[1e-5; 3], 300.0, process, Rules::default()).unwrap();
        assert_no_alloc(|| {
            for i in 0..200 {
                let share = f64::from(i) / 200.0;
                let place = grid.place([800.0 * share, 300.0 * (1.0 - share), 250.0 * (share * 7.0).fract()]);
                // every tenth reading is wild and meets the gate
                let value = if i % 10 == 9 { 1.0 } else { 1e-6 * share };
                let weights = [1.0, -0.5, 0.2, 0.0, 0.0, 0.0];
                let update =
                    filter.update(&Observation { place, weights, value, nuisance: None }, &mut noise);
                assert!((update.verdict == Verdict::Rejected) == (i % 10 == 9));
                filter.predict(0.5);
                assert!(filter.value(0, &place).is_finite() && filter.std_at(2, &place).is_finite());
            }
        });
    }
}
