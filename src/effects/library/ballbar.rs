//! The length of a ballbar.

use crate::prelude::*;

/// Variants of `ballbar-length`.
pub(super) fn ballbar_length(data: &Data, _: &Subject) -> Variants {
    if !data.ballbar {
        return Err("needs circles of a ballbar".into());
    }
    Ok(vec![BallbarLength {}.into()])
}

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
