//! Curves over the position of an axis: positioning and straightness.

use super::pitch_table;
use crate::polynomial::legendre;
use crate::prelude::*;

/// Degrees of positioning curves, of such with values for each direction, and of straightness.
const TABLE: [usize; 6] = [3, 4, 5, 8, 13, 20];
const BOTH_WAYS: [usize; 5] = [3, 4, 5, 8, 13];
const ACROSS: [usize; 4] = [2, 3, 5, 8];
/// Positions below which a table of values at each stands beside the polynomials: too few to tell a smooth curve from a rough one.
const FEW: usize = 12;
/// Curves are held beyond so many half ranges of the data.
const HELD: f64 = 1.2;
/// Degrees of a polynomial, from 0 on, at most.
const DEGREES: usize = WIDTH_MAX + 8;
/// Points of a model's table from one value of a rough curve to the next.
const BETWEEN: usize = 4;

/// Variants of `positioning`.
pub(super) fn positioning(data: &Data, of: &Subject) -> Variants {
    let axis = of.axis;
    let Some([low, high]) = data.moved(axis)? else { return Ok(Vec::new()) };
    if !axis.is_linear() {
        let tables = pitch_table::tables(data, axis);
        let needs = "a table of values needs 4 to 41 targets, most of them read more than once";
        return if tables.is_empty() { Err(needs.into()) } else { Ok(tables) };
    }
    let (centre_mm, half_mm) = (0.5 * (low + high), 0.5 * (high - low));
    let mut shapes = polynomials(data, axis, axis, &TABLE);
    let targets = &data.targets[axis.slot()];
    if (4..FEW).contains(&targets.len()) {
        shapes.push(PositionTable { axis, targets_mm: targets.clone() }.into());
    }
    shapes.extend(pitch_table::tables(data, axis));
    // with more than one setup, other programs tell lost motion from a table: then the two stay apart
    if data.reverses[axis.slot()] && data.one_setup {
        for high in data.degrees(axis, Some(axis), &BOTH_WAYS) {
            let reverses = [1, 3, high].into_iter().filter(|r| *r <= high);
            shapes.extend(reverses.map(|reverse| Reverse { axis, high, reverse, centre_mm, half_mm }.into()));
        }
    }
    data.structural(shapes)
}

/// Variants of `straightness`.
pub(super) fn straightness(data: &Data, of: &Subject) -> Variants {
    let mut shapes = polynomials(data, of.first, of.axis, &ACROSS);
    if data.range[of.axis.slot()].is_some() {
        shapes.extend(pitch_table::tables_across(data, of.first, of.axis));
    }
    data.structural(shapes)
}

/// Curves without and then with slopes of their own: the line from which a curve is counted is a choice. They span the positions at
/// which readings look along: over a part of the span their coefficients would be large and cancel each other.
fn polynomials(data: &Data, along: Axis, over: Axis, degrees: &[usize]) -> Vec<Shape> {
    let looked_at = &data.looked_at[over.slot()][along.slot()];
    let Some((from, to)) = looked_at.first().zip(looked_at.last()).filter(|(from, to)| from < to) else {
        return Vec::new();
    };
    let (centre_mm, half_mm) = (0.5 * (from + to), 0.5 * (to - from));
    let degrees = data.degrees(over, Some(along), degrees);
    let of = |low: usize| degrees.iter().map(move |high| (low, *high));
    let shape = |(low, high)| Polynomial { along, over, low, high, centre_mm, half_mm }.into();
    of(2).chain(of(1)).map(shape).collect()
}

/// `d_along = SUM c_k P_k((x_over - centre)/half)`, Legendre polynomials of degree low..high.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct Polynomial {
    pub along: Axis,
    pub over: Axis,
    pub low: usize,
    pub high: usize,
    pub centre_mm: f64,
    pub half_mm: f64,
}

impl Form for Polynomial {
    fn parameters(&self) -> Vec<String> {
        coefficients(self.low..=self.high)
    }

    fn width(&self) -> usize {
        (self.high + 1).saturating_sub(self.low)
    }

    fn evaluate(&self, m: &MachineState, _: &Read<'_>, out: &mut [Vec3]) {
        let values = values(m, self.over, self.centre_mm, self.half_mm, self.high);
        for (o, v) in out.iter_mut().zip(&values[self.low..=self.high]) {
            *o = unit(self.along.direction()) * *v;
        }
    }

    fn becomes(&self, model: &Extended, entry: &Entry) -> Becomes {
        displacements(model, entry, self.over, Sampling::Polynomial)
    }

    fn is_valid(&self) -> bool {
        self.half_mm > 0.0 && self.low <= self.high && self.high < DEGREES && self.centre_mm.is_finite()
    }

    fn traits(&self) -> Traits {
        Traits { is_free_curve: true, ..Traits::motion(self.along, self.over) }
    }
}

/// Names of coefficients, which say nothing without the curve.
pub(super) fn coefficients(orders: core::ops::RangeInclusive<usize>) -> Vec<String> {
    orders.map(|k| format!("p{k}_um")).collect()
}

/// True for positions that go up.
pub(super) fn are_targets(targets_mm: &[f64]) -> bool {
    targets_mm.windows(2).all(|w| w[0] < w[1]) && targets_mm.iter().all(|x| x.is_finite())
}

/// The upper of the two places about a position, and the share of the way from the lower one to it; held beyond the ends.
pub(super) fn bracket(places: &[f64], position: f64) -> (usize, f64) {
    let [Some(low), Some(high)] = [places.first(), places.last()] else { return (1, f64::NAN) };
    let x = position.clamp(*low, *high);
    let after = places.partition_point(|p| *p <= x).clamp(1, places.len().max(2) - 1);
    let between = places.get(after - 1).zip(places.get(after));
    (after, between.map_or(f64::NAN, |(from, to)| (x - from) / (to - from)))
}

/// Values at the targets, straight lines between, counted from their least-squares line: a column for each target but the two
/// at the ends, which the others determine.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct PositionTable {
    pub axis: Axis,
    pub targets_mm: Vec<f64>,
}

impl Form for PositionTable {
    fn parameters(&self) -> Vec<String> {
        coefficients(1..=self.width())
    }

    fn width(&self) -> usize {
        self.targets_mm.len().saturating_sub(2)
    }

    fn evaluate(&self, m: &MachineState, _: &Read<'_>, out: &mut [Vec3]) {
        let [Some(low), Some(high)] = [self.targets_mm.first(), self.targets_mm.last()] else { return };
        // held beyond the targets
        let x = m.position[self.axis.slot()].clamp(*low, *high);
        let n = self.targets_mm.len() as f64;
        let mean = self.targets_mm.iter().sum::<f64>() / n;
        let square: f64 = self.targets_mm.iter().map(|t| (t - mean).powi(2)).sum();
        for (o, w) in out.iter_mut().zip(self.targets_mm.windows(3)) {
            let share = if x < w[1] { (x - w[0]) / (w[1] - w[0]) } else { (w[2] - x) / (w[2] - w[1]) };
            let line = 1.0 / n + (w[1] - mean) * (x - mean) / square;
            *o = unit(self.axis.direction()) * (share.max(0.0) - line);
        }
    }

    fn becomes(&self, model: &Extended, entry: &Entry) -> Becomes {
        displacements(model, entry, self.axis, Sampling::At(&self.targets_mm))
    }

    fn is_valid(&self) -> bool {
        are_targets(&self.targets_mm) && (1..=WIDTH_MAX).contains(&self.width())
    }

    fn traits(&self) -> Traits {
        Traits { is_free_curve: true, ..Traits::motion(self.axis, self.axis) }
    }
}

/// A curve with what the error is beyond it: straight lines between values at positions, of RMS 1 um.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct RoughCurve {
    pub curve: Box<Shape>,
    pub positions_mm: Vec<f64>,
    pub beyond_um: Vec<f64>,
}

impl RoughCurve {
    fn beyond_um(&self, position_mm: f64) -> f64 {
        let (after, share) = bracket(&self.positions_mm, position_mm);
        let [from, to] = [after - 1, after].map(|k| self.beyond_um.get(k).copied().unwrap_or_default());
        from + share * (to - from)
    }
}

impl Form for RoughCurve {
    fn parameters(&self) -> Vec<String> {
        self.curve.parameters().into_iter().chain(plain(&["roughness_um"])).collect()
    }

    fn width(&self) -> usize {
        self.curve.width().saturating_add(1)
    }

    fn evaluate(&self, m: &MachineState, read: &Read<'_>, out: &mut [Vec3]) {
        let width = self.curve.width();
        self.curve.form().evaluate(m, read, &mut out[..width]);
        let Traits { acts_along: Some(along), over: Some(over), .. } = self.traits() else { return };
        out[width] = unit(along.direction()) * self.beyond_um(m.position[over.slot()]);
    }

    fn becomes(&self, model: &Extended, entry: &Entry) -> Becomes {
        let over = self.traits().over.ok_or("it is no curve over an axis")?;
        // between its values the curve bends
        let between = |at: &[f64]| {
            (0..BETWEEN).map(|k| at[0] + (at[1] - at[0]) * k as f64 / BETWEEN as f64).collect::<Vec<_>>()
        };
        let last = self.positions_mm.last().copied();
        let at: Vec<f64> = self.positions_mm.windows(2).flat_map(between).chain(last).collect();
        displacements(model, entry, over, Sampling::At(&at))
    }

    fn is_valid(&self) -> bool {
        let finite = self.beyond_um.iter().all(|v| v.is_finite());
        let (n, at) = (self.beyond_um.len(), &self.positions_mm);
        let (form, traits) = (self.curve.form(), self.traits());
        let is_curve = traits.is_free_curve && traits.acts_along.zip(traits.over).is_some();
        is_curve
            && form.is_valid()
            && self.width() <= WIDTH_MAX
            && finite
            && n > 1
            && n == at.len()
            && are_targets(at)
    }

    fn traits(&self) -> Traits {
        self.curve.form().traits()
    }

    fn columns(&self) -> Vec<String> {
        self.curve.form().columns()
    }

    fn drawing(&self) -> Drawing {
        self.curve.form().drawing()
    }

    fn fixed(&self) -> Vec<(String, f64)> {
        self.curve.form().fixed()
    }
}

/// A curve with values of its own in each direction of travel: `d_a = SUM p_k P_k(s) - dir/2 SUM r_k P_k(s)`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct Reverse {
    pub axis: Axis,
    pub high: usize,
    pub reverse: usize,
    pub centre_mm: f64,
    pub half_mm: f64,
}

impl Form for Reverse {
    fn parameters(&self) -> Vec<String> {
        // means from the second degree (the first is the scale), reversals from the constant
        let means = (2..=self.high).map(|k| format!("p{k}_um"));
        means.chain((0..=self.reverse).map(|k| format!("reversal_p{k}_um"))).collect()
    }

    fn width(&self) -> usize {
        self.high + self.reverse
    }

    fn evaluate(&self, m: &MachineState, _: &Read<'_>, out: &mut [Vec3]) {
        let values = values(m, self.axis, self.centre_mm, self.half_mm, self.high.max(self.reverse));
        let along = unit(self.axis.direction());
        let half_turn = -0.5 * m.direction[self.axis.slot()];
        let means = values[2..=self.high].iter().map(|v| along * *v);
        let reversals = values[..=self.reverse].iter().map(|v| along * (*v * half_turn));
        out.iter_mut().zip(means.chain(reversals)).for_each(|(o, d)| *o = d);
    }

    fn drawing(&self) -> Drawing {
        Drawing::from(Over::Position(self.axis)).by(Branch::Direction(self.axis))
    }

    fn becomes(&self, model: &Extended, entry: &Entry) -> Becomes {
        displacements(model, entry, self.axis, Sampling::Polynomial)
    }

    fn is_valid(&self) -> bool {
        self.half_mm > 0.0
            && self.high >= 2
            && self.high.max(self.reverse) < DEGREES
            && self.centre_mm.is_finite()
    }

    fn traits(&self) -> Traits {
        Traits { is_free_curve: true, ..Traits::motion(self.axis, self.axis) }
    }
}

/// Legendre polynomials of a position up to a degree.
fn values(m: &MachineState, axis: Axis, centre_mm: f64, half_mm: f64, high: usize) -> [f64; DEGREES] {
    let s = (m.position[axis.slot()] - centre_mm) / half_mm;
    let mut values = [0.0; DEGREES];
    legendre(s.clamp(-HELD, HELD), &mut values[..=high]);
    values
}

impl Shape {
    /// True for a straightness that brings its own slope; it comes in only in the place of one without.
    #[must_use]
    pub const fn has_slope(&self) -> bool {
        matches!(self, Self::Polynomial(Polynomial { low: 1, .. }))
    }

    /// False for a curve that brings the slope of a squareness or scale, or the reversal of a backlash, as its own.
    #[must_use]
    pub const fn has_own_name(&self) -> bool {
        !self.has_slope() && !matches!(self, Self::Reverse { .. })
    }

    /// The same curve with (true) or without the slope of its own; other effects as they are.
    #[must_use]
    pub fn with_line(&self, line: bool) -> Self {
        let mut shape = self.clone();
        if let Self::Polynomial(curve) = &mut shape {
            curve.low = if line { 1 } else { 2 };
        }
        shape
    }

    /// True for what a curve with a slope of its own may stand for: neither a line, which every such curve could say, nor a
    /// curve that is counted from a line.
    #[must_use]
    pub const fn allows_lines(&self) -> bool {
        let is_line = matches!(self, Self::Squareness { .. } | Self::Scale { .. });
        let is_counted = matches!(
            self,
            Self::Polynomial { .. }
                | Self::PositionTable { .. }
                | Self::PitchTable { .. }
                | Self::Reverse { .. }
                | Self::Cyclic { .. }
        );
        !is_line && !is_counted
    }

    /// True for a straight line in the direction and over the axis of a curve; a squareness is one in both directions.
    #[must_use]
    pub fn may_be_the_slope_of(&self, curve: &Self) -> bool {
        let Self::Polynomial(Polynomial { along, over, .. }) = curve else { return false };
        match self {
            Self::Squareness(s) => [(s.along, s.over), (s.over, s.along)].contains(&(*along, *over)),
            Self::Scale(s) => s.axis == *along && s.axis == *over,
            _ => false,
        }
    }
}
