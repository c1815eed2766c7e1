//! Bending of beams and rams under weights.

use crate::prelude::*;

/// Lengths of beams, as multiples of the travel, and the longest: a longer one is a parabola under another name.
const LENGTHS: [f64; 3] = [1.0, 1.5, 2.5];
const LONGEST: f64 = 3.0;

/// Overhangs of a ram that is drawn in, as shares of its travel; the largest that is one.
const OVERHANGS: [f64; 3] = [0.0, 0.25, 0.6];
const OVERHANG_MAX: f64 = 1.0;
/// How far from the tool the point may lie about which the slope of a ram turns it, as a multiple of the longest travel.
const PIVOT_MAX: f64 = 1.0;

/// Variants of `sag`.
pub(super) fn sag(data: &Data, of: &Subject) -> Variants {
    let axis = of.axis;
    let up = data.machine.up();
    let Some(range) = data.moved(axis)?.filter(|_| axis != up) else { return Ok(Vec::new()) };
    let [low, high] = outwards(axis, range);
    if data.only_angles || !data.sees[up.slot()] {
        return Err("no readings along the vertical: its slope alone is an angular error motion".into());
    }
    let (half, own) = (0.5 * (high - low), data.lever(axis));
    // under a head the slope turns all that hangs on it
    let under = data.head().then_some(own);
    let mut shapes: Vec<Shape> = Vec::new();
    let across = Axis::LINEAR[3 - axis.direction() - up.direction()];
    // a turn about the tool moves nothing
    let turns_tool = data.tools && across != Axis::Z || under.is_some();
    for length_mm in LENGTHS.map(|f| 2.0 * half * f) {
        for tool in [false, true].into_iter().filter(|t| !t || turns_tool) {
            let (start_mm, lever) = (placed(axis, low), under.filter(|_| tool));
            shapes.push(Sag { axis, up, start_mm, length_mm, tool, lever }.into());
        }
    }
    // the drop is that of the reference points or of the nose
    let levers = [data.arm(axis, across), Lever { home_mm: data.below_nose().into(), ..own }];
    // drawn in as far as it goes, a ram may hang over already
    for start in OVERHANGS.map(|o| if o > 0.0 { low - o * 2.0 * half } else { low.min(0.0) }) {
        let (start_mm, reach_mm) = (placed(axis, start), low + 2.0 * half - start);
        for lever in levers {
            let rams = [(false, false), (true, false), (true, true)]
                .map(|(moment, beam)| Ram { axis, up, start_mm, reach_mm, lever, moment, beam }.into());
            shapes.extend(rams);
        }
    }
    data.structural(shapes)
}

/// The sense of an axis in which what hangs over grows: a spindle comes out against Z (ISO 841).
fn outward(axis: Axis) -> f64 {
    if axis == Axis::Z { -1.0 } else { 1.0 }
}

/// A place in that sense as a position, or the reverse; no zero of it is negative.
fn placed(axis: Axis, at_mm: f64) -> f64 {
    outward(axis) * at_mm + 0.0
}

/// A range in that sense.
fn outwards(axis: Axis, range: [f64; 2]) -> [f64; 2] {
    let [a, b] = range.map(|at_mm| placed(axis, at_mm));
    [a.min(b), a.max(b)]
}

const fn z() -> Axis {
    Axis::Z
}

fn is_z(axis: &Axis) -> bool {
    *axis == Axis::Z
}

/// Bending of a cantilever: drop `w s^2 (3 L - s)/(2 L^3)`, `s` its way out from the start, and its slope times the tool length.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct Sag {
    pub axis: Axis,
    /// The axis against which it drops.
    #[serde(default = "z", skip_serializing_if = "is_z")]
    pub up: Axis,
    pub start_mm: f64,
    pub length_mm: f64,
    pub tool: bool,
    /// What the slope turns under a head; the tool length alone where nothing is said.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lever: Option<Lever>,
}

impl Sag {
    /// Drop and slope at a position, per unit of the parameters.
    fn bent(&self, position_mm: f64) -> [f64; 2] {
        let (s, length) = (outward(self.axis) * (position_mm - self.start_mm), self.length_mm);
        [s * s * (3.0 * length - s), 6.0 * length * s - 3.0 * s * s].map(|v| v / (2.0 * length.powi(3)))
    }
}

impl Form for Sag {
    fn parameters(&self) -> Vec<String> {
        plain(&["sag_um", "tip_slope_um"][..self.width()])
    }

    fn width(&self) -> usize {
        1 + usize::from(self.tool)
    }

    fn evaluate(&self, m: &MachineState, _: &Read<'_>, out: &mut [Vec3]) {
        let [drop, slope] = self.bent(m.position[self.axis.slot()]);
        let up = unit(self.up.direction());
        out[0] = -up * drop;
        if self.tool {
            let arm = self.lever.map_or_else(|| unit(2) * -m.tool_length_mm, |l| l.at(m));
            out[1] = unit(self.axis.direction()).cross(&up).cross(&arm) * (outward(self.axis) * slope);
        }
    }

    fn columns(&self) -> Vec<String> {
        let tool = (self.tool && self.lever.is_none_or(|l| l.tool)).then(|| "tool_length_mm".to_owned());
        [self.axis.column()].into_iter().chain(tool).collect()
    }

    fn drawing(&self) -> Drawing {
        Drawing::from(Over::Position(self.axis)).by(Branch::Tool)
    }

    fn becomes(&self, model: &Extended, entry: &Entry) -> Becomes {
        if !self.tool {
            return displacements(model, entry, self.axis, Sampling::Even);
        }
        let lever = self.lever.unwrap_or(Lever { axes: [false; 3], home_mm: [0.0; 3], tool: true });
        let drop = |q: f64| entry.value(0) * self.bent(q)[0];
        let slope = |q: f64| entry.value(1) * self.bent(q)[1];
        bending(model, entry, (self.axis, self.up), &lever, [&drop, &slope])
    }

    fn fixed(&self) -> Vec<(String, f64)> {
        named(&[("length_mm", self.length_mm), ("start_mm", self.start_mm)])
    }

    fn is_valid(&self) -> bool {
        self.length_mm > 0.0
    }

    fn changed(&self, f: f64) -> Vec<Shape> {
        vec![with(self, |s| s.length_mm *= f)]
    }

    fn is_within(&self, span: &Span<'_>, _: [f64; 3]) -> bool {
        let [low, high] = span(self.axis);
        self.length_mm <= LONGEST * (high - low)
    }

    fn traits(&self) -> Traits {
        Traits {
            acts_along: (!self.tool).then_some(self.up),
            over: Some(self.axis),
            is_free_curve: true,
            ..Traits::default()
        }
    }
}

/// A ram that moves out by s: weight at its end and own weight, drop `w1 s^3 + w2 s^4` over powers of its reach, and
/// the slope of that times the lever to the tool; with a moment at its end, too, `w3 s^2`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct Ram {
    pub axis: Axis,
    /// The axis against which it drops.
    #[serde(default = "z", skip_serializing_if = "is_z")]
    pub up: Axis,
    pub start_mm: f64,
    pub reach_mm: f64,
    pub lever: Lever,
    #[serde(default, skip_serializing_if = "core::ops::Not::not")]
    pub moment: bool,
    /// The axis runs along a beam that stays where it is: the slope is the derivative of the drop.
    #[serde(default, skip_serializing_if = "core::ops::Not::not")]
    pub beam: bool,
}

impl Ram {
    /// Drop and slope at a position, per unit of each parameter: a weight at the end bends it by s^3, its own by s^4, a moment by s^2.
    fn bent(&self, position_mm: f64) -> [[f64; 2]; 3] {
        // slopes of the end as multiples of the drop per length: 3/2, 4/3 and 2 where the ram moves out
        let slopes = if self.beam { [3.0, 4.0, 2.0] } else { [1.5, 4.0 / 3.0, 2.0] };
        let s = (outward(self.axis) * (position_mm - self.start_mm)).max(0.0) / self.reach_mm;
        let at = |k: usize| {
            let power = [3, 4, 2][k];
            [s.powi(power), slopes[k] * s.powi(power - 1) / self.reach_mm]
        };
        core::array::from_fn(at)
    }
}

impl Form for Ram {
    fn parameters(&self) -> Vec<String> {
        let names = ["sag_of_end_weight_um", "sag_of_own_weight_um", "sag_of_end_moment_um"];
        plain(&names[..self.width()])
    }

    fn width(&self) -> usize {
        2 + usize::from(self.moment)
    }

    fn evaluate(&self, m: &MachineState, _: &Read<'_>, out: &mut [Vec3]) {
        let up = unit(self.up.direction());
        // turns what points out down
        let arm = unit(self.axis.direction()).cross(&up).cross(&self.lever.at(m)) * outward(self.axis);
        for (o, [drop, slope]) in out.iter_mut().zip(self.bent(m.position[self.axis.slot()])) {
            *o = -up * drop - arm * slope;
        }
    }

    fn columns(&self) -> Vec<String> {
        [self.axis.column()].into_iter().chain(self.lever.columns()).collect()
    }

    fn drawing(&self) -> Drawing {
        Drawing::from(Over::Position(self.axis)).by(Branch::Tool)
    }

    fn becomes(&self, model: &Extended, entry: &Entry) -> Becomes {
        let sum = |k: usize| {
            move |q: f64| self.bent(q).iter().zip(&entry.values).map(|(bent, value)| bent[k] * value).sum()
        };
        bending(model, entry, (self.axis, self.up), &self.lever, [&sum(0), &sum(1)])
    }

    fn fixed(&self) -> Vec<(String, f64)> {
        named(&[("reach_mm", self.reach_mm), ("start_mm", self.start_mm)])
    }

    fn is_valid(&self) -> bool {
        self.reach_mm > 0.0
    }

    fn changed(&self, f: f64) -> Vec<Shape> {
        let longer_by_mm = self.reach_mm * (f - 1.0);
        let (start_mm, reach_mm) =
            (self.start_mm - outward(self.axis) * longer_by_mm, self.reach_mm + longer_by_mm);
        let longer = Self { start_mm, reach_mm, ..self.clone() }.into();
        // a moment at the end bends to so much that any pivot would do
        let across = [self.axis.slot(), self.up.slot()].into_iter().filter(|_| !self.moment);
        std::iter::once(longer).chain(across.map(|k| with(self, |s| s.lever.move_pivot(k, f)))).collect()
    }

    fn is_within(&self, span: &Span<'_>, _: [f64; 3]) -> bool {
        let [low, high] = outwards(self.axis, span(self.axis));
        let hangs_over =
            (0.0..=OVERHANG_MAX * (high - low)).contains(&(low - outward(self.axis) * self.start_mm));
        hangs_over && self.lever.is_within(span, PIVOT_MAX)
    }

    fn traits(&self) -> Traits {
        Traits { over: Some(self.axis), is_free_curve: true, ..Traits::default() }
    }
}
