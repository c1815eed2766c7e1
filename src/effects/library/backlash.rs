//! Steps at the reversals of an axis: along it and across it.

use crate::prelude::*;

/// Transition lengths, mm, and the longest.
const LENGTHS: [f64; 6] = [0.0, 0.05, 0.2, 0.6, 2.0, 6.0];
const LONGEST_MM: f64 = 15.0;
/// Widths of play, mm, each crossed over itself.
const PLAYS: [f64; 16] =
    [0.002, 0.003, 0.004, 0.005, 0.006, 0.008, 0.01, 0.013, 0.016, 0.02, 0.025, 0.032, 0.04, 0.05, 0.07, 0.1];
/// Lengths of travel after a reversal that are drawn, in transition lengths.
const DRAWN: f64 = 6.0;

const ONE_WAY: &str = "the axis is measured in one direction only";

/// Variants of `backlash`.
pub(super) fn backlash(data: &Data, of: &Subject) -> Variants {
    let axis = of.axis;
    if data.moved(axis)?.is_none() || !axis.is_linear() && !data.reverses[axis.slot()] {
        return Ok(Vec::new());
    }
    if !data.reverses[axis.slot()] {
        return Err(ONE_WAY.into());
    }
    if let (false, Some(frame)) = (axis.is_linear(), data.frame(axis)) {
        return Ok(vec![RotaryBacklash { frame }.into()]);
    }
    let mut shapes: Vec<Shape> =
        [false, true].into_iter().flat_map(|slope| grid(axis, &[axis], slope)).collect();
    if data.encoders_only || data.moves[axis.slot()] {
        // read while the play is crossed: what every reading has crossed already is a step
        let nearest = data.nearest[axis.slot()];
        let play =
            |length_mm| Backlash { axis, along: vec![axis], length_mm, slope: false, play: true }.into();
        shapes.extend(PLAYS.into_iter().filter(|p| *p > nearest).map(play));
    }
    Ok(shapes)
}

/// Variants of `lateral-play`.
pub(super) fn lateral_play(data: &Data, of: &Subject) -> Variants {
    let axis = of.axis;
    if data.moved(axis)?.is_none() {
        return Ok(Vec::new());
    }
    if !data.reverses[axis.slot()] {
        return Err(ONE_WAY.into());
    }
    let others = axis.others();
    let ways = others.iter().map(|o| vec![*o]).chain([others.clone()]);
    data.structural(ways.flat_map(|along| grid(axis, &along, false)).collect())
}

fn grid(axis: Axis, along: &[Axis], slope: bool) -> [Shape; 6] {
    LENGTHS.map(|length_mm| Backlash { axis, along: along.to_vec(), length_mm, slope, play: false }.into())
}

/// `d_along = -w/2 dir (1 - exp(-s/length))`, times `1 + g x` where it has a slope; play is crossed evenly instead, from the other
/// side: `-w/2 dir min(1, 2 s/length - 1)`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct Backlash {
    pub axis: Axis,
    pub along: Vec<Axis>,
    pub length_mm: f64,
    pub slope: bool,
    #[serde(default, skip_serializing_if = "core::ops::Not::not")]
    pub play: bool,
}

impl Form for Backlash {
    fn parameters(&self) -> Vec<String> {
        let mut names = Vec::new();
        for a in &self.along {
            let stem = if self.along.len() > 1 { format!("width_{a}") } else { "width".to_owned() };
            names.push(format!("{stem}_um"));
            if self.slope {
                names.push(format!("{stem}_slope_um_per_m"));
            }
        }
        names
    }

    fn width(&self) -> usize {
        self.along.len() * (1 + usize::from(self.slope))
    }

    fn evaluate(&self, m: &MachineState, _: &Read<'_>, out: &mut [Vec3]) {
        let i = self.axis.slot();
        let (since, length) = (m.since_mm[i], self.length_mm);
        let share = match since.abs() / length {
            way if self.play && way.is_finite() => (2.0 * way - 1.0).min(1.0),
            way if length > 0.0 && way.is_finite() => 1.0 - (-way).exp(),
            _ => 1.0,
        };
        let v = -0.5 * m.direction[i] * share;
        let each = 1 + usize::from(self.slope);
        for (j, a) in self.along.iter().enumerate() {
            out[each * j] = unit(a.direction()) * v;
            if self.slope {
                out[each * j + 1] = unit(a.direction()) * (v * m.position[i] * 1e-3);
            }
        }
    }

    fn columns(&self) -> Vec<String> {
        let since = (self.length_mm > 0.0).then(|| format!("since_reversal_{}_mm", self.axis));
        [format!("dir_{}", self.axis)].into_iter().chain(since).collect()
    }

    fn drawing(&self) -> Drawing {
        let over = if self.length_mm > 0.0 {
            Over::SinceReversal(self.axis, DRAWN * self.length_mm)
        } else {
            Over::Position(self.axis)
        };
        Drawing::from(over).by(Branch::Direction(self.axis))
    }

    fn becomes(&self, model: &Extended, entry: &Entry) -> Becomes {
        let (axis, slope) = (self.axis, self.slope);
        // play is crossed at once where the axis turns round
        let build_up = if self.play { 0.0 } else { self.length_mm };
        let (law, unit) = (Law::Reversal { build_up }, mm_from_um(1.0));
        let each = 1 + usize::from(slope);
        let term = |(j, a): (usize, &Axis)| {
            let symbol = shift(*a, axis);
            Term { axis, symbol, law, most: 0.5, at: each * j, slope, unit }
        };
        terms(model, entry, self.along.iter().enumerate().map(term))
    }

    fn fixed(&self) -> Vec<(String, f64)> {
        if self.length_mm > 0.0 { named(&[("transition_length_mm", self.length_mm)]) } else { Vec::new() }
    }

    fn changed(&self, f: f64) -> Vec<Shape> {
        // play is as wide as it is long: a free length would make something else of it
        if self.play { Vec::new() } else { vec![with(self, |s| s.length_mm *= f)] }
    }

    fn is_itself(&self) -> bool {
        self.length_mm <= LONGEST_MM
    }

    fn traits(&self) -> Traits {
        Traits {
            acts_along: (self.along.len() == 1).then(|| self.along[0]),
            is_of_drive: self.along == [self.axis],
            ..Traits::default()
        }
    }

    fn builds_up(&self) -> (f64, f64) {
        // of play the model has what is behind its crossing
        let grows = self.length_mm > 0.0 && !self.play;
        (if grows { self.length_mm } else { f64::INFINITY }, f64::INFINITY)
    }
}

/// `-w/2 dir` about the axis itself, times the radius.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RotaryBacklash {
    pub frame: RotaryFrame,
}

impl Form for RotaryBacklash {
    fn parameters(&self) -> Vec<String> {
        plain(&["width_arcsec"])
    }

    fn evaluate(&self, m: &MachineState, _: &Read<'_>, out: &mut [Vec3]) {
        let half_turn = -0.5 * m.direction[self.frame.axis.slot()];
        out[0] = self.frame.um_per_rad(m) * RAD_PER_ARCSEC * half_turn;
    }

    fn drawing(&self) -> Drawing {
        Drawing::from(Over::Position(self.frame.axis)).by(Branch::Direction(self.frame.axis))
    }

    fn becomes(&self, model: &Extended, entry: &Entry) -> Becomes {
        let (axis, law) = (self.frame.axis, Law::Reversal { build_up: 0.0 });
        let symbol = turn(axis, axis);
        terms(
            model,
            entry,
            [Term { axis, symbol, law, most: 0.5, at: 0, slope: false, unit: RAD_PER_ARCSEC }],
        )
    }

    fn traits(&self) -> Traits {
        Traits { is_of_drive: true, ..Traits::default() }
    }
}
