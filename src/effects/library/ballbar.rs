//! The length of a ballbar.

use crate::prelude::*;

/// What is known of it.
pub(crate) static BALLBAR_LENGTH: Effect = Effect {
    name: "ballbar-length",
    title: "length error of the ballbar",
    synonyms: "bar-length",
    kind: Kind::Instrument,
    subjects: Subjects::Whole,
    cause: "The ballbar was not set against a calibrator, or at another temperature.",
    formula: "along the bar: c",
    looks_like: "The radius of all circles is wrong by the same length.",
    confused_with: "equal scales of the axes of the plane",
    settles: "A calibrated length at 20 degC, or a laser along one axis.",
    changes_with: &[Measurement::SecondInstrument],
    remedy: "calibrate the length of the ballbar; without a calibrator circles show the difference of two scales, not their mean",
    variants: |data, _| {
        if !data.ballbar {
            return Err("needs circles of a ballbar".into());
        }
        Ok(vec![BallbarLength {}.into()])
    },
};

/// Along the direction of sensitivity of a ballbar: `c`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BallbarLength {}

impl Form for BallbarLength {
    fn parameters(&self) -> Vec<String> {
        plain(&["length_error_um"])
    }

    fn evaluate(&self, m: &MachineState, _: &Read<'_>, out: &mut [Vec3]) {
        out[0] = if m.is_ballbar { m.u } else { Vec3::zeros() };
    }
}
