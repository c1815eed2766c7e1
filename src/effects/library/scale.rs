//! Scale errors: positioning errors proportional to the position.

use crate::prelude::*;

/// What is known of it.
pub(crate) static SCALE: Effect = Effect {
    name: "scale",
    title: "scale error of {}",
    synonyms: "positioning-scale linear-error pitch-error-linear",
    kind: Kind::Machine,
    subjects: Subjects::Axes,
    cause: "Linear error of the scale or screw; wrong scale factor, or one temperature off 20 degC.",
    formula: "d_a = s x_a",
    looks_like: "Deviation grows with the coordinate, alike in both directions and at every feed.",
    confused_with: "thermal expansion at one temperature, compliance under acceleration on circles of one feed, refraction of a laser",
    settles: "A laser line at rest, repeated on a warm machine; circles at two feeds.",
    changes_with: &[],
    remedy: "correct the scale factor of the encoder or screw",
    variants: |data, of| {
        let axis = of.axis;
        if axis.is_linear() {
            let moved = data.moved(axis)?;
            return data.structural(moved.map(|_| Scale { axis }.into()).into_iter().collect());
        }
        Ok(data.frame(axis).map(|frame| RotaryScale { frame }.into()).into_iter().collect())
    },
};

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

    fn acts_along(&self) -> Option<Axis> {
        Some(self.axis)
    }

    fn over(&self) -> Option<Axis> {
        Some(self.axis)
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
        rotation(model, entry, axis, axis, &|q| arcsec * q)
    }

    fn over(&self) -> Option<Axis> {
        Some(self.frame.axis)
    }
}
