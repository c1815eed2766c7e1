//! Thermal expansion of screws and scales.

use crate::data::{Hidden, is_spindle};
use crate::extend::expansion;
use crate::prelude::*;

/// Variants of `thermal-expansion`.
pub(super) fn thermal_expansion(data: &Data, of: &Subject) -> Variants {
    let axis = of.axis;
    if data.range[axis.slot()].is_none() {
        return Ok(Vec::new());
    }
    // the spindle's own temperature says nothing of a scale where others are logged
    let others = data.temperatures().any(|(s, _)| !is_spindle(s));
    let mut shapes = Vec::new();
    for (source, first) in data.temperatures().filter(|(s, _)| !others || !is_spindle(s)) {
        let signal = Signal::of(source.clone(), 0.0);
        let kinds = [(REFERENCE_DEGC, false), (first, false), (REFERENCE_DEGC, true)];
        shapes.extend(kinds.map(|(reference_degc, with_offset)| {
            Thermal { axis, signal: signal.clone(), reference_degc, with_offset }.into()
        }));
    }
    if shapes.is_empty() {
        return Err(Hidden::unrecorded("no temperature that changes by 0.2 K is logged"));
    }
    data.structural(shapes)
}

/// `d_a = alpha (T - T0) x_a`, and `k (T - T0)` where the reference is not at zero.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct Thermal {
    pub axis: Axis,
    pub signal: Signal,
    pub reference_degc: f64,
    pub with_offset: bool,
}

impl Form for Thermal {
    fn parameters(&self) -> Vec<String> {
        plain(&["expansion_ppm_per_k", "shift_um_per_k"][..self.width()])
    }

    fn width(&self) -> usize {
        1 + usize::from(self.with_offset)
    }

    fn evaluate(&self, m: &MachineState, read: &Read<'_>, out: &mut [Vec3]) {
        let dt = read(&self.signal) - self.reference_degc;
        out[0] = unit(self.axis.direction()) * (dt * m.position[self.axis.slot()] * 1e-3);
        if self.with_offset {
            out[1] = unit(self.axis.direction()) * dt;
        }
    }

    fn columns(&self) -> Vec<String> {
        vec![self.axis.column(), self.signal.source.to_string()]
    }

    fn drawing(&self) -> Drawing {
        let warmth = Weight::Warmth(self.signal.clone(), self.reference_degc);
        Drawing::from(Over::Position(self.axis)).scaled(warmth)
    }

    fn becomes(&self, model: &Extended, entry: &Entry) -> Becomes {
        expansion(model, entry, self.axis, &self.signal, self.reference_degc)
    }

    fn fixed(&self) -> Vec<(String, f64)> {
        let tau_s = self.signal.tau_s;
        let all = [("reference_degc", self.reference_degc), ("time_constant_s", tau_s)];
        named(&all[..1 + usize::from(tau_s > 0.0)])
    }

    fn traits(&self) -> Traits {
        Traits { over: Some(self.axis), ..Traits::default() }
    }

    fn signals(&self) -> Vec<&Signal> {
        vec![&self.signal]
    }
}
