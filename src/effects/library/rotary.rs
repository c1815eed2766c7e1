//! Rotary axes: location, error motion, eccentricity of the encoder.

use super::cyclic::harmonics;
use crate::prelude::*;
use volcomp_model::{Component, ErrorSymbol};

/// Harmonics of the error motion: first and last.
const HARMONICS: [[usize; 2]; 3] = [[2, 2], [2, 3], [2, 5]];

/// Variants of `rotary-location`.
pub(super) fn rotary_location(data: &Data, of: &Subject) -> Variants {
    let Some(frame) = data.frame(of.axis) else {
        let stands = data.axes.contains(&of.axis);
        return if stands { Err("the axis stands still in these data".into()) } else { Ok(Vec::new()) };
    };
    // what the axis carries either counts as right at its zero, or is wrong with it; a workpiece may be aligned at zero or not at all
    let is_distinct = !frame.workpiece_side || !frame.inner.is_empty();
    let kinds = [(false, false, true), (true, false, is_distinct), (true, true, frame.workpiece_side)];
    let of = |(tied, unaligned, _)| RotaryLocation { frame: frame.clone(), tied, unaligned }.into();
    data.structural(kinds.into_iter().filter(|k| k.2).map(of).collect())
}

/// Variants of `rotary-motion`.
pub(super) fn rotary_motion(data: &Data, of: &Subject) -> Variants {
    let axis = of.axis;
    let Some(frame) = data.frame(axis) else { return Ok(Vec::new()) };
    // what stands on another rotary axis turns with it
    let frame = Some(frame).filter(|f| !f.outer.is_empty());
    let ways = [vec![Axis::X], vec![Axis::Y], vec![Axis::Z], Axis::LINEAR.to_vec()];
    let all = ways.iter().flat_map(|along| HARMONICS.map(|h| (along.clone(), h)));
    let shape = |(along, [low, high]): (Vec<Axis>, [usize; 2])| {
        RotaryMotion { axis, along, low, high, frame: frame.clone() }.into()
    };
    data.structural(all.map(shape).collect())
}

/// Variants of `rotary-eccentricity`.
pub(super) fn rotary_eccentricity(data: &Data, of: &Subject) -> Variants {
    let Some(frame) = data.frame(of.axis) else { return Ok(Vec::new()) };
    Ok([1, 2].map(|harmonics| RotaryEccentricity { frame: frame.clone(), harmonics }.into()).into())
}

/// Two shifts and two tilts of a rotary axis; no deviation at zero but of what is not aligned there.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RotaryLocation {
    pub frame: RotaryFrame,
    /// What the axis carries is wrong with it, at its zero, too (equations 1.9). Of a head, shifts then show only on an axis that
    /// another one turns. Of a table, the axes beyond it are carried along, and the workpiece was aligned with all axes at zero.
    #[serde(default, skip_serializing_if = "core::ops::Not::not")]
    pub tied: bool,
    /// Of a table that is tied: the workpiece was not aligned, so that the error shows with all axes at zero, too, as it does in the
    /// deviation that a model predicts.
    #[serde(default, skip_serializing_if = "core::ops::Not::not")]
    pub unaligned: bool,
}

impl RotaryLocation {
    /// The two directions across the axis.
    fn across(&self) -> [usize; 2] {
        let a = self.frame.axis.direction();
        [(a + 1) % 3, (a + 2) % 3]
    }
}

impl Form for RotaryLocation {
    fn parameters(&self) -> Vec<String> {
        let [b, c] = self.across().map(|k| Axis::LINEAR[k]);
        let all = [
            format!("shift_{b}_um"),
            format!("shift_{c}_um"),
            format!("tilt_{b}_arcsec"),
            format!("tilt_{c}_arcsec"),
        ];
        all[4 - self.width()..].to_vec()
    }

    fn width(&self) -> usize {
        if self.tied && self.frame.outer.is_empty() && !self.frame.workpiece_side { 2 } else { 4 }
    }

    fn evaluate(&self, m: &MachineState, _: &Read<'_>, out: &mut [Vec3]) {
        let (outer, own, p) = self.frame.state(m);
        let (sign, tilts) = (self.frame.sign(), self.width() - 2);
        // what is right at the zero of the axis is wrong by the same in the turned frame
        let (at_zero, home) = match (self.tied, self.frame.workpiece_side && !self.unaligned) {
            (false, _) => (own, p),
            (true, false) => (Mat3::zeros(), p),
            (true, true) => {
                let (inner, home) = self.frame.carried_by(p, m);
                (own * inner, home)
            }
        };
        for (i, k) in self.across().into_iter().enumerate() {
            let l = unit(k);
            if tilts > 0 {
                out[i] = outer * (l - at_zero * l) * sign;
            }
            let d = l.cross(&(own * p)) - at_zero * l.cross(&home);
            out[tilts + i] = outer * d * (sign * UM_PER_ARCSEC_MM);
        }
    }

    fn becomes(&self, _: &Extended, entry: &Entry) -> Becomes {
        let [b, c] = self.across();
        let places = [b, c, b + 3, c + 3];
        let constant = |(k, place): (usize, &usize)| {
            let v = entry.value(k);
            let v = if *place < 3 { mm_from_um(v) } else { v * RAD_PER_ARCSEC };
            let (component, axis) = (Component::ALL[*place], self.frame.axis.name());
            Part::constant(ErrorSymbol::Location { component, axis }, v)
        };
        // two values are the tilts alone
        Ok(places[4 - self.width()..].iter().enumerate().map(constant).collect::<Vec<_>>().into())
    }

    fn traits(&self) -> Traits {
        Traits { over: Some(self.frame.axis), ..Traits::default() }
    }
}

/// Harmonics of the rotation: shifts `cos(n q) - 1`, `sin(n q)` along the directions listed, of the machine or of what the
/// axis stands on (with `frame`).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RotaryMotion {
    pub axis: Axis,
    pub along: Vec<Axis>,
    pub low: usize,
    pub high: usize,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frame: Option<RotaryFrame>,
}

impl Form for RotaryMotion {
    fn parameters(&self) -> Vec<String> {
        let of = |a: &Axis| {
            let names = |n: usize| [format!("cos{n}_{a}_um"), format!("sin{n}_{a}_um")];
            (self.low..=self.high).flat_map(names).collect::<Vec<_>>()
        };
        self.along.iter().flat_map(of).collect()
    }

    fn width(&self) -> usize {
        2 * self.along.len() * (self.high + 1 - self.low)
    }

    fn evaluate(&self, m: &MachineState, _: &Read<'_>, out: &mut [Vec3]) {
        let q = m.position[self.axis.slot()];
        let turned = self.frame.as_ref().map_or_else(Mat3::identity, |f| f.product(&f.outer, m));
        let each = 2 * (self.high + 1 - self.low);
        for (a, out) in self.along.iter().zip(out.chunks_mut(each)) {
            let way = turned * unit(a.direction());
            out.iter_mut().zip(harmonics(self.low..=self.high, q)).for_each(|(o, v)| *o = way * v);
        }
    }

    fn becomes(&self, model: &Extended, entry: &Entry) -> Becomes {
        displacements(model, entry, self.axis, Sampling::Even)
    }

    fn traits(&self) -> Traits {
        Traits { over: Some(self.axis), is_free_curve: true, ..Traits::default() }
    }
}

/// Angular error `SUM c_n (cos n q - 1) + s_n sin n q` about the axis itself, times the radius.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RotaryEccentricity {
    pub frame: RotaryFrame,
    #[serde(default = "one", skip_serializing_if = "is_one")]
    pub harmonics: usize,
}

const fn one() -> usize {
    1
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde asks so")]
const fn is_one(n: &usize) -> bool {
    *n == 1
}

impl Form for RotaryEccentricity {
    fn parameters(&self) -> Vec<String> {
        let number = |n: usize| if n == 1 { String::new() } else { n.to_string() };
        let names = |n: String| [format!("cos{n}_arcsec"), format!("sin{n}_arcsec")];
        (1..=self.harmonics).map(number).flat_map(names).collect()
    }

    fn width(&self) -> usize {
        2 * self.harmonics
    }

    fn evaluate(&self, m: &MachineState, _: &Read<'_>, out: &mut [Vec3]) {
        let q = m.position[self.frame.axis.slot()];
        self.frame.turn_by(m, harmonics(1..=self.harmonics, q), out);
    }

    fn becomes(&self, model: &Extended, entry: &Entry) -> Becomes {
        let angle = |q: f64| harmonics(1..=self.harmonics, q).zip(&entry.values).map(|(c, v)| c * v).sum();
        rotation(model, entry, self.frame.axis, (self.frame.axis, None), Sampling::Even, &angle)
    }

    fn traits(&self) -> Traits {
        Traits::rotation(self.frame.axis)
    }
}
