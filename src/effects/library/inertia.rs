//! What gives way under acceleration.

use crate::extend::{acceleration_term, steepest};
use crate::prelude::*;

/// How far from the tool the point may lie about which a structure tilts, as a multiple of the longest travel: about a point far away
/// everything moves alike, which is another effect.
const PIVOT_MAX: f64 = 0.5;
/// mm/s^2 per m/s^2, and mm per m.
const PER_M: f64 = 1e-3;

/// Variants of `inertial`.
pub(super) fn inertial(data: &Data, of: &Subject) -> Variants {
    let axis = of.axis;
    let shape = |slope| Inertial { axis, along: axis, slope }.into();
    data.structural(if accelerates(data, axis)? { [false, true].map(shape).into() } else { Vec::new() })
}

/// Variants of `inertial-cross`.
pub(super) fn inertial_cross(data: &Data, of: &Subject) -> Variants {
    let axis = of.axis;
    if !accelerates(data, axis)? {
        return Ok(Vec::new());
    }
    let others = axis.others();
    // a tilt of the structure turns whatever the travels are, so all of them are levers; or the carriage itself
    // turns, and only what lies behind it is a lever
    let carriage = data.lever(axis);
    let mut levers = vec![Lever { axes: [true; 3], ..carriage }, carriage];
    levers.dedup();
    let mut shapes: Vec<Shape> = Vec::new();
    for lever in levers {
        let ways = others.iter().map(|a| vec![*a]).chain([others.clone()]);
        shapes.extend(ways.map(|about| InertialTilt { axis, about, lever }.into()));
    }
    shapes.extend(others.iter().map(|along| Inertial { axis, along: *along, slope: false }.into()));
    data.structural(shapes)
}

fn accelerates(data: &Data, axis: Axis) -> Result<bool, crate::data::Hidden> {
    if data.moved(axis)?.is_none() {
        return Ok(false);
    }
    if !data.moves[axis.slot()] {
        return Err("no readings while the axis moves".into());
    }
    Ok(data.accelerates[axis.slot()])
}

/// `d_along = k a_axis`, and `k' a_axis x_axis` where it has a slope.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Inertial {
    pub axis: Axis,
    pub along: Axis,
    pub slope: bool,
}

impl Form for Inertial {
    fn parameters(&self) -> Vec<String> {
        let names = ["compliance_um_per_m_per_s2", "compliance_slope_um_per_m_per_s2_per_m"];
        plain(&names[..self.width()])
    }

    fn width(&self) -> usize {
        1 + usize::from(self.slope)
    }

    fn evaluate(&self, m: &MachineState, _: &Read<'_>, out: &mut [Vec3]) {
        let k = m.acceleration[self.axis.slot()] * 1e-3;
        out[0] = unit(self.along.direction()) * k;
        if self.slope {
            out[1] = unit(self.along.direction()) * (k * m.position[self.axis.slot()] * 1e-3);
        }
    }

    fn drawing(&self) -> Drawing {
        Over::Acceleration(self.axis).into()
    }

    fn becomes(&self, model: &Extended, entry: &Entry) -> Becomes {
        let (axis, slope, most) = (self.axis, self.slope, steepest(entry, self.axis)?);
        let (symbol, law, unit) = (shift(self.along, axis), Law::Acceleration, mm_from_um(PER_M));
        terms(model, entry, [Term { axis, symbol, law, most, at: 0, slope, unit }])
    }

    fn traits(&self) -> Traits {
        Traits { acts_along: Some(self.along), ..Traits::default() }
    }
}

/// `d = k a_axis (e_about x lever)` for each direction listed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct InertialTilt {
    pub axis: Axis,
    pub about: Vec<Axis>,
    pub lever: Lever,
}

impl Form for InertialTilt {
    fn parameters(&self) -> Vec<String> {
        self.about.iter().map(|b| format!("tilt_{b}_arcsec_per_m_per_s2")).collect()
    }

    fn width(&self) -> usize {
        self.about.len()
    }

    fn evaluate(&self, m: &MachineState, _: &Read<'_>, out: &mut [Vec3]) {
        let (r, a) = (self.lever.at(m), m.acceleration[self.axis.slot()]);
        for (o, b) in out.iter_mut().zip(&self.about) {
            *o = unit(b.direction()).cross(&r) * (UM_PER_ARCSEC_MM * a * 1e-3);
        }
    }

    fn columns(&self) -> Vec<String> {
        vec![self.axis.acceleration_column()]
    }

    fn drawing(&self) -> Drawing {
        let drawing = Drawing::from(Over::Acceleration(self.axis));
        match self.about[..] {
            [about] => drawing.scaled(Weight::Lever(about, self.lever)),
            _ => drawing,
        }
    }

    fn becomes(&self, model: &Extended, entry: &Entry) -> Becomes {
        let (spec, axis, most) = (&model.spec, self.axis, steepest(entry, self.axis)?);
        let mut parts = Vec::new();
        for (i, b) in self.about.iter().enumerate() {
            let angle = entry.value(i) * RAD_PER_ARCSEC * PER_M;
            parts.extend(acceleration_term(turn(*b, axis), angle, most));
            // the model turns about the reference points of the axis, the structure about a point of its own
            let home = self.lever.home_at_tip(spec);
            for (k, along) in Axis::LINEAR.into_iter().enumerate() {
                let reference = spec.axis(axis.name()).reference_points[k].point;
                let gain = angle * unit(b.direction()).cross(&(home - spec.tool_tip + reference))[k];
                parts.extend(acceleration_term(shift(along, axis), gain, most));
            }
        }
        Ok(parts.into())
    }

    fn changed(&self, f: f64) -> Vec<Shape> {
        let slots = (0..3).filter(|k| self.about.iter().any(|b| b.direction() != *k));
        slots.map(|k| with(self, |s| s.lever.move_pivot(k, f))).collect()
    }

    fn is_within(&self, span: &Span<'_>, _: [f64; 3]) -> bool {
        self.lever.is_within(span, PIVOT_MAX)
    }
}
