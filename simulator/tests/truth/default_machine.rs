//! The example configuration and the machine that is simulated by default.

#![expect(clippy::disallowed_methods, reason = "a test reads its files")]

use simulator::truth::{TruthMachine, VMC_850};
use volcomp::config::model;
use volcomp::model::{Model, Pose};

/// The example of the vertical machining centre is the machine that cncsim simulates by default: what its model
/// predicts is what that machine does, but for the fine waviness, the lost motion and the drift no map can hold.
#[test]
fn the_model_of_the_default_machine_predicts_it() {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../config/examples/vmc-850/model.toml");
    let spec =
        model::parse("model.toml", &std::fs::read_to_string(&path).expect("the example")).expect("valid");
    let truth = TruthMachine::from_toml(VMC_850).expect("the default machine");
    assert_eq!(spec.machine, truth.machine());
    for (k, axis) in truth.axes().into_iter().enumerate() {
        assert_eq!(spec.axis(axis).travel, Some(truth.travel(k)), "{axis}");
    }
    // poses are in the order of the chain, samples in that of the link: the same here
    assert_eq!(spec.chain.axes().iter().map(|a| a.name).collect::<Vec<_>>(), truth.axes());
    let model = Model::new(&spec).expect("a sound model");
    let (mut before, mut after, mut n) = (0.0f64, 0.0f64, 0.0);
    for i in 0..=10 {
        for j in 0..=10 {
            for k in 0..=10 {
                let share = |v: i32| f64::from(v) / 10.0;
                let q = [850.0 * share(i), 500.0 * share(j), -500.0 * share(k), 0.0, 0.0, 0.0, 0.0, 0.0];
                let really = truth.deviation(&q, &[1; 8]).tip_mm;
                let predicted = model.deviation(&Pose::at(q)).position;
                for c in 0..3 {
                    before += really[c] * really[c];
                    after += (really[c] - predicted[c]).powi(2);
                    n += 1.0;
                }
            }
        }
    }
    let rms_um = |sum: f64| (sum / n).sqrt() * 1e3;
    assert!(rms_um(before) > 10.0, "the machine has errors worth correcting: {} um", rms_um(before));
    assert!(rms_um(after) < 0.05 * rms_um(before), "{} um of {} um stay", rms_um(after), rms_um(before));
}
