//! The length of a ballbar.

use crate::prelude::*;

/// Variants of `ballbar-length`.
pub(super) fn ballbar_length(data: &Data, _: &Subject) -> Variants {
    if data.ballbar_setups.is_empty() {
        return Err("needs circles of a ballbar".into());
    }
    let own = (2..=WIDTH_MAX).contains(&data.ballbar_setups.len()).then(|| data.ballbar_setups.clone());
    Ok([Vec::new()].into_iter().chain(own).map(|setups| BallbarLength { setups }.into()).collect())
}

/// Along the direction of sensitivity of a ballbar: `c`, or one for each set-up: a bar is set to zero, and is warmer, each time.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BallbarLength {
    /// Set-ups with a length of their own; empty where one length serves all.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub setups: Vec<usize>,
}

impl Form for BallbarLength {
    fn parameters(&self) -> Vec<String> {
        if self.setups.is_empty() {
            return plain(&["length_error_um"]);
        }
        (1..=self.setups.len()).map(|k| format!("length_error_{k}_um")).collect()
    }

    fn width(&self) -> usize {
        self.setups.len().max(1)
    }

    fn evaluate(&self, m: &MachineState, _: &Read<'_>, out: &mut [Vec3]) {
        let along = if m.is_ballbar { m.u } else { Vec3::zeros() };
        if self.setups.is_empty() {
            out[0] = along;
        }
        for (o, setup) in out.iter_mut().zip(&self.setups) {
            *o = if m.setup == *setup { along } else { Vec3::zeros() };
        }
    }
}
