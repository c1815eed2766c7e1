//! Scale errors: positioning errors proportional to the position.

use crate::prelude::*;

/// Variants of `scale`.
pub(super) fn scale(data: &Data, of: &Subject) -> Variants {
    let axis = of.axis;
    if axis.is_linear() {
        let moved = data.moved(axis)?;
        return data.structural(moved.map(|_| Scale { axis }.into()).into_iter().collect());
    }
    Ok(data.frame(axis).map(|frame| RotaryScale { frame }.into()).into_iter().collect())
}

/// `d_a = s x_a`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Scale {
    pub axis: Axis,
}

impl Form for Scale {
    fn parameters(&self) -> Vec<String> {
        plain(&["scale_ppm"])
    }

    fn evaluate(&self, m: &MachineState, _: &Read<'_>, out: &mut [Vec3]) {
        out[0] = unit(self.axis.direction()) * (m.position[self.axis.slot()] * 1e-3);
    }

    fn becomes(&self, model: &Extended, entry: &Entry) -> Becomes {
        displacements(model, entry, self.axis, Sampling::Line)
    }

    fn traits(&self) -> Traits {
        Traits::motion(self.axis, self.axis)
    }
}

/// `s q` about the axis itself, times the radius.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RotaryScale {
    pub frame: RotaryFrame,
}

impl Form for RotaryScale {
    fn parameters(&self) -> Vec<String> {
        plain(&["scale_ppm"])
    }

    fn evaluate(&self, m: &MachineState, _: &Read<'_>, out: &mut [Vec3]) {
        out[0] = self.frame.um_per_rad(m) * (1e-6 * m.position[self.frame.axis.slot()]);
    }

    fn becomes(&self, model: &Extended, entry: &Entry) -> Becomes {
        let (axis, arcsec) = (self.frame.axis, 1e-6 * entry.value(0) / RAD_PER_ARCSEC);
        rotation(model, entry, axis, (axis, None), Sampling::Even, &|q| arcsec * q)
    }

    fn traits(&self) -> Traits {
        Traits::rotation(self.frame.axis)
    }
}
