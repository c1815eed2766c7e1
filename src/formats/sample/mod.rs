//! Curves of a model to the support points of a control's table.
//!
//! Controls interpolate linearly between the points of their tables, so the points are chosen such that straight
//! lines between them stay within a tolerance of the model. A length tolerance t holds for angles as t over a lever of
//! one metre. Values come out in the relative sense over the programmed coordinate (equations 1.4), whatever sense the
//! model is stored in, and where asked for at the origin instead of the axis' reference points (equations 1.5).

mod error;

pub use error::ExportError;

use crate::prelude::*;

use volcomp_model::chain_notation::Side;
use volcomp_model::geometry::Vec3;
use volcomp_model::spec::ReferenceBody;
use volcomp_model::{AxisMotion, AxisSpec, DynamicTerm, Law, Sense};

/// Which values go into a table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Way {
    /// Those for travel towards plus.
    Forward,
    /// Those for travel towards minus.
    Reverse,
    /// The mean of both.
    Mean,
}

/// How the points are chosen.
#[derive(Debug, Clone, PartialEq)]
pub struct Sampling {
    /// Lines between points stay this close to the model, mm (angles: over one metre).
    pub tolerance: f64,
    /// Distance of the points, mm or rad, instead of a tolerance.
    pub step: Option<f64>,
    /// First and last position, mm or rad; else the travel, else what the curves cover.
    pub range: Option<[f64; 2]>,
    /// One set of values for both directions, where the format has only one.
    pub way: Option<Way>,
}

impl Default for Sampling {
    fn default() -> Self {
        Self { tolerance: 0.05e-3, step: None, range: None, way: None }
    }
}

/// What a format can hold.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    /// Its name, for messages.
    pub format: &'static str,
    /// Positions must be equally spaced.
    pub equidistant: bool,
    /// Most positions.
    pub points: usize,
    /// Values for both directions.
    pub two_directions: bool,
    /// Decimals of positions, mm or deg.
    pub decimals: usize,
}

impl Limits {
    /// A position as it is printed, in units of the last decimal.
    pub(super) fn printed(&self, axis: AxisName, q: f64) -> f64 {
        (axis.kind().position_out(q) * 10f64.powi(self.decimals as i32)).round()
    }

    /// Positions without those that print alike; the ends stay.
    pub(super) fn apart(&self, axis: AxisName, mut positions: Vec<f64>) -> Vec<f64> {
        let alike = |a: f64, b: f64| self.printed(axis, a) == self.printed(axis, b);
        let Some(end) = positions.pop() else { return positions };
        positions.dedup_by(|next, kept| alike(*kept, *next));
        if positions.len() > 1 && positions.last().is_some_and(|last| alike(*last, end)) {
            positions.pop();
        }
        positions.push(end);
        positions
    }
}

/// Lever over which an angle counts as a length, mm.
const LEVER: f64 = 1000.0;
/// Points at which a curve that is no table is looked at, at least.
const DENSE_MIN: usize = 2048;
const DENSE_MAX: usize = 200_000;
/// Looks per wave of the shortest harmonic.
const PER_WAVE: f64 = 48.0;

/// The error motions of one axis as functions of its programmed coordinate.
#[derive(Debug)]
pub struct Motions<'a> {
    axis: AxisSpec,
    functions: [Option<&'a ErrorFunction>; 6],
    inverted: bool,
    side: Side,
    at_origin: bool,
}

impl<'a> Motions<'a> {
    /// The motions of an axis; with `at_origin`, linear components are carried from their reference points to the origin.
    ///
    /// # Errors
    /// The axis is not in the chain, or a motion has live values.
    pub fn new(spec: &'a ModelSpec, axis: AxisName, at_origin: bool) -> Result<Self, ExportError> {
        let in_chain = spec.chain.axes().iter().find(|a| a.name == axis);
        let side = in_chain.ok_or(ExportError::AxisNotInChain { axis })?.side;
        let functions = Component::ALL.map(|component| spec.error(ErrorSymbol::Motion { component, axis }));
        for (component, function) in Component::ALL.into_iter().zip(functions) {
            if function.is_some_and(|f| !f.live.is_empty()) {
                return Err(ExportError::Live { symbol: ErrorSymbol::Motion { component, axis } });
            }
        }
        let entry = spec.axis(axis);
        let inverted = entry.sense == Sense::Carriage && side == Side::Workpiece;
        Ok(Self { axis: entry, functions, inverted, side, at_origin })
    }

    /// The components that have a curve, a grid or a reversal error.
    #[must_use]
    pub fn present(&self) -> Vec<Component> {
        let holds = |f: &ErrorFunction| {
            !(f.curves.is_empty() && f.grids.is_empty()) || f.dynamics.iter().any(is_reversal)
        };
        let stored = |c: Component| self.functions[c.index()].is_some_and(holds);
        let moved =
            |c: Component| self.is_moved() && !c.is_angle() && Component::ALL[3..].iter().any(|a| stored(*a));
        Component::ALL.into_iter().filter(|c| stored(*c) || moved(*c)).collect()
    }

    /// True where a reference point makes the values at the origin others than the stored ones.
    fn is_moved(&self) -> bool {
        let elsewhere =
            |r: &volcomp_model::ReferencePoint| r.point != Vec3::zeros() || r.body == ReferenceBody::Bed;
        self.at_origin
            && self.axis.name.kind() == AxisKind::Linear
            && self.axis.reference_points.iter().any(elsewhere)
    }

    /// The other axes on which a motion depends.
    #[must_use]
    pub fn other_axes(&self) -> Vec<AxisName> {
        let mut found: Vec<AxisName> =
            self.functions.iter().flatten().flat_map(|f| &f.grids).flat_map(|g| g.axes()).collect();
        found.sort_unstable();
        found.dedup();
        found.retain(|a| *a != self.axis.name);
        found
    }

    /// The first of the given components that depends on several axes.
    #[must_use]
    pub fn first_grid(&self, components: &[Component]) -> Option<ErrorSymbol> {
        let has = |c: &&Component| self.functions[c.index()].is_some_and(|f| !f.grids.is_empty());
        components.iter().find(has).map(|c| ErrorSymbol::Motion { component: *c, axis: self.axis.name })
    }

    /// The first of the components whose values differ between the directions.
    #[must_use]
    pub fn first_two_way(&self, components: &[Component]) -> Option<ErrorSymbol> {
        let two = |c: &Curve| matches!(c, Curve::Table(t) if t.columns().2.is_some());
        let any = |c: Component| {
            self.functions[c.index()]
                .is_some_and(|f| f.curves.iter().any(two) || f.dynamics.iter().any(is_reversal))
        };
        let moved = self.is_moved() && Component::ALL[3..].iter().any(|a| any(*a));
        let found = components.iter().find(|c| any(**c) || (moved && !c.is_angle()));
        found.map(|c| ErrorSymbol::Motion { component: *c, axis: self.axis.name })
    }

    /// A component at coordinate `q`, mm or rad; `others` are the coordinates of [`other_axes`](Self::other_axes).
    #[must_use]
    pub fn value(&self, component: Component, q: f64, others: &[(AxisName, f64)], way: Way) -> f64 {
        match way {
            Way::Forward => self.one_way(component, q, others, Travel::Forward),
            Way::Reverse => self.one_way(component, q, others, Travel::Reverse),
            Way::Mean => {
                let forward = self.one_way(component, q, others, Travel::Forward);
                0.5 * (forward + self.one_way(component, q, others, Travel::Reverse))
            }
        }
    }

    fn one_way(&self, component: Component, q: f64, others: &[(AxisName, f64)], travel: Travel) -> f64 {
        let stored = |c: Component| self.stored(c, q, others, travel);
        if component.is_angle() || !self.is_moved() {
            return stored(component);
        }
        let i = component.index();
        let reference = &self.axis.reference_points[i];
        let mut r = reference.point;
        if reference.body == ReferenceBody::Bed {
            let sigma = if self.side == Side::Workpiece { 1.0 } else { -1.0 };
            r[self.axis.name.direction()] += sigma * q;
        }
        let turn = Vec3::new(stored(Component::A), stored(Component::B), stored(Component::C));
        stored(component) - turn.cross(&r)[i]
    }

    /// A stored component in the relative sense over the programmed coordinate.
    fn stored(&self, component: Component, q: f64, others: &[(AxisName, f64)], travel: Travel) -> f64 {
        let Some(function) = self.functions[component.index()] else { return 0.0 };
        let held = self.axis.travel.map_or(q, |[low, high]| q.clamp(low, high));
        let (x, travel, sign) =
            if self.inverted { (-held, travel.reversed(), -1.0) } else { (held, travel, 1.0) };
        let grids = function.grids.iter().map(|g| {
            let mut at = [0.0; 3];
            for (slot, name) in at.iter_mut().zip(g.axes()) {
                let other = others.iter().find(|(a, _)| *a == name).map_or(0.0, |(_, v)| *v);
                *slot = if name == self.axis.name { x } else { other };
            }
            g.value(&at[..g.axes().len()]).0
        });
        // after long travel in a direction, as where no motion is known
        let motion = AxisMotion::after(travel);
        let reversal =
            function.dynamics.iter().filter(|d| is_reversal(d)).map(|d| d.value(x, d.law.signal(&motion)));
        sign * (function.value(x, travel) + grids.sum::<f64>() + reversal.sum::<f64>())
    }

    /// Support points of an axis in all grids.
    #[must_use]
    pub fn grid_positions(&self, axis: AxisName) -> Vec<f64> {
        let mut all = Vec::new();
        for grid in self.functions.iter().flatten().flat_map(|f| &f.grids) {
            for (i, name) in grid.axes().enumerate() {
                if name == axis {
                    let own = axis == self.axis.name && self.inverted;
                    all.extend(grid.positions(i).iter().map(|p| if own { -p } else { *p }));
                }
            }
        }
        sorted(all)
    }

    /// The range to write: as asked, else the travel, else what the curves cover.
    ///
    /// # Errors
    /// None of them is known, or it is empty.
    pub fn range(&self, asked: Option<[f64; 2]>) -> Result<[f64; 2], ExportError> {
        let axis = self.axis.name;
        let curves = || {
            let covered =
                self.functions.iter().flatten().flat_map(|f| f.curves.iter().filter_map(Curve::range));
            let covered = covered.reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])]);
            covered.map(|[a, b]| if self.inverted { [-b, -a] } else { [a, b] })
        };
        let grids = || {
            let own = self.grid_positions(axis);
            Some([*own.first()?, *own.last()?])
        };
        let [low, high] =
            asked.or(self.axis.travel).or_else(curves).or_else(grids).ok_or(ExportError::NoRange { axis })?;
        if low < high && low.is_finite() && high.is_finite() {
            return Ok([low, high]);
        }
        Err(ExportError::EmptyRange { axis, low, high })
    }

    /// What the values of some components are made of.
    fn behind<'b>(&'b self, components: &'b [Component]) -> impl Iterator<Item = &'b ErrorFunction> {
        let needed = |c: Component| components.contains(&c) || (self.is_moved() && c.is_angle());
        Component::ALL.into_iter().filter(move |c| needed(*c)).filter_map(|c| self.functions[c.index()])
    }

    /// Positions of the tables of some components inside the range, and the shortest wave of their other curves; the flag is true
    /// where straight lines between the positions are exact.
    fn knots(&self, components: &[Component], [low, high]: [f64; 2]) -> (Vec<f64>, f64, bool) {
        let (mut knots, mut wave, mut exact) = (vec![low, high], f64::INFINITY, true);
        for curve in self.behind(components).flat_map(|f| &f.curves) {
            match curve {
                Curve::Constant(_) => {}
                Curve::Table(t) => {
                    let sign = if self.inverted { -1.0 } else { 1.0 };
                    knots.extend(t.columns().0.iter().map(|p| sign * p));
                    exact &= t.interpolation() == Interpolation::Linear;
                }
                Curve::Fourier(f) => {
                    wave = wave.min(f.period() / f.harmonics().len().max(1) as f64);
                    exact = false;
                }
                Curve::HalfRange(h) => {
                    let [a, b] = h.range();
                    wave = wave.min(2.0 * (b - a) / h.coefficients().2.count().max(1) as f64);
                    exact = false;
                }
                Curve::Chebyshev(c) => {
                    let [a, b] = c.range();
                    knots.extend([a, b].map(|p| if self.inverted { -p } else { p }));
                    // waves are shortest near the ends, by a factor of the degree
                    wave = wave.min((b - a) / (c.coefficients().len() as f64).powi(2));
                    exact = false;
                }
            }
        }
        // a width that changes along the axis may reach its limit between two points
        exact &= self.behind(components).flat_map(|f| &f.dynamics).all(|d| d.growth == 0.0);
        // beyond its travel an axis keeps the value at the end
        knots.extend(self.axis.travel.into_iter().flatten());
        knots.extend(self.grid_positions(self.axis.name));
        knots.retain(|k| (low..=high).contains(k));
        let bed = self.axis.reference_points.iter().any(|r| r.body == ReferenceBody::Bed);
        (sorted(knots), wave, exact && !(bed && self.is_moved()))
    }
}

/// A reversal error: the dynamic term whose two end values a table with two directions can hold.
fn is_reversal(term: &DynamicTerm) -> bool {
    matches!(term.law, Law::Reversal { .. }) && term.gain != 0.0
}

/// A table over one axis, mm or rad, relative sense.
#[derive(Debug, Clone, PartialEq)]
pub struct AxisTable {
    /// The axis.
    pub axis: AxisName,
    /// Increasing positions.
    pub positions: Vec<f64>,
    /// Values by component.
    pub columns: Vec<Column>,
    /// Largest distance between the model and the lines between the points, mm (angles: over one metre).
    pub largest_error: f64,
}

/// The values of one component.
#[derive(Debug, Clone, PartialEq)]
pub struct Column {
    /// The component.
    pub component: Component,
    /// For travel towards plus, or for both.
    pub forward: Vec<f64>,
    /// For travel towards minus, where different.
    pub reverse: Option<Vec<f64>>,
}

/// Samples the positioning error of an axis.
///
/// # Errors
/// No such error, and what the format cannot hold.
pub fn sample_positioning(
    spec: &ModelSpec,
    axis: AxisName,
    sampling: &Sampling,
    limits: &Limits,
) -> Result<AxisTable, ExportError> {
    let motions = Motions::new(spec, axis, false)?;
    let component = positioning(axis);
    if !motions.present().contains(&component) {
        return Err(ExportError::NoError { what: "positioning error", axis });
    }
    sample_axis(&motions, &[component], sampling, limits)
}

/// Samples components of an axis that depend on nothing else.
///
/// # Errors
/// What the format cannot hold.
pub fn sample_axis(
    motions: &Motions<'_>,
    components: &[Component],
    sampling: &Sampling,
    limits: &Limits,
) -> Result<AxisTable, ExportError> {
    if let Some(symbol) = motions.first_grid(components) {
        return Err(ExportError::Grid { symbol, format: limits.format });
    }
    let two_way = motions.first_two_way(components);
    let ways = match (two_way, sampling.way) {
        (_, Some(way)) => vec![way],
        (None, None) => vec![Way::Forward],
        (Some(_), None) if limits.two_directions => vec![Way::Forward, Way::Reverse],
        (Some(symbol), None) => return Err(ExportError::TwoDirections { symbol, format: limits.format }),
    };
    let (positions, largest_error) = positions(motions, components, &[Vec::new()], &ways, sampling, limits)?;
    let at =
        |c: Component, way| positions.iter().map(|q| motions.value(c, *q, &[], way)).collect::<Vec<f64>>();
    let columns = components
        .iter()
        .map(|&component| Column {
            component,
            forward: at(component, ways[0]),
            reverse: ways.get(1).map(|way| at(component, *way)),
        })
        .collect();
    Ok(AxisTable { axis: motions.axis.name, positions, columns, largest_error })
}

/// Chooses positions along the axis, and says how far lines between them are from the model. `combinations` are the
/// coordinates of the other axes at which the motions are looked at.
///
/// # Errors
/// More positions than the format holds, a range that is not known.
pub fn positions(
    motions: &Motions<'_>,
    components: &[Component],
    combinations: &[Vec<(AxisName, f64)>],
    ways: &[Way],
    sampling: &Sampling,
    limits: &Limits,
) -> Result<(Vec<f64>, f64), ExportError> {
    let [low, high] = motions.range(sampling.range)?;
    let span = high - low;
    let (knots, wave, exact) = motions.knots(components, [low, high]);
    let apart = |positions| limits.apart(motions.axis.name, positions);
    let knots = apart(knots);
    let count = ((span / wave * PER_WAVE) as usize).clamp(DENSE_MIN, DENSE_MAX);
    let dense = sorted(
        (0..=count).map(|i| low + span * (i as f64 / count as f64)).chain(knots.iter().copied()).collect(),
    );
    let mut curves = Vec::new();
    for &c in components {
        let weight = if c.is_angle() { LEVER } else { 1.0 };
        for others in combinations {
            for &way in ways {
                curves.push(
                    dense.iter().map(|q| weight * motions.value(c, *q, others, way)).collect::<Vec<f64>>(),
                );
            }
        }
    }
    let equal = |n: usize| {
        (0..=n).map(|i| if i == n { high } else { low + span * (i as f64 / n as f64) }).collect::<Vec<f64>>()
    };
    let error =
        |positions: &[f64]| curves.iter().map(|c| deviation(&dense, c, positions)).fold(0.0, f64::max);
    if let Some(step) = sampling.step {
        if !(step > 0.0 && step < span) {
            return Err(ExportError::Step { step, span });
        }
        let n = (span / step).ceil().min(1e9) as usize;
        check_count(n + 1, limits, || error(&equal(limits.points - 1)))?;
        // the last interval is shorter where the step does not divide the range and the format allows it
        let divides = (span / step - (span / step).round()).abs() < 1e-9;
        let chosen = if limits.equidistant || divides {
            equal(if divides { (span / step).round() as usize } else { n })
        } else {
            (0..n).map(|i| low + step * i as f64).chain([high]).collect()
        };
        let chosen = apart(chosen);
        let reached = error(&chosen);
        return Ok((chosen, reached));
    }
    let tolerance = sampling.tolerance;
    let chosen = if limits.equidistant {
        equidistant(&knots, exact, tolerance, limits, &equal, &error)?
    } else if exact && knots.len() <= limits.points {
        knots
    } else {
        apart(thinned(&dense, &curves, 0.9 * tolerance))
    };
    if chosen.len() > limits.points {
        let most = equal(limits.points - 1);
        let reached = error(&most);
        check_count(if reached <= tolerance { most.len() } else { chosen.len() }, limits, || reached)?;
        return Ok((most, reached));
    }
    let reached = error(&chosen);
    if reached > tolerance {
        let (format, decimals) = (limits.format, limits.decimals);
        return Err(ExportError::Jump {
            axis: motions.axis.name,
            format,
            decimals,
            reached_um: reached * 1e3,
        });
    }
    Ok((chosen, reached))
}

fn check_count(found: usize, limits: &Limits, reached: impl Fn() -> f64) -> Result<(), ExportError> {
    if found <= limits.points {
        return Ok(());
    }
    let (limit, format) = (limits.points, limits.format);
    Err(ExportError::TooManyPoints { found, limit, format, reached_um: reached() * 1e3 })
}

/// The fewest equal steps that keep the tolerance; the points of a table where they are equally spaced themselves.
fn equidistant(
    knots: &[f64],
    exact: bool,
    tolerance: f64,
    limits: &Limits,
    equal: &dyn Fn(usize) -> Vec<f64>,
    error: &dyn Fn(&[f64]) -> f64,
) -> Result<Vec<f64>, ExportError> {
    let natural = equal(knots.len() - 1);
    let span = knots[knots.len() - 1] - knots[0];
    if exact
        && knots.len() <= limits.points
        && knots.iter().zip(&natural).all(|(a, b)| (a - b).abs() <= 1e-9 * span)
    {
        return Ok(knots.to_vec());
    }
    let mut n = 1;
    while n < limits.points {
        let chosen = equal(n);
        if error(&chosen) <= tolerance {
            return Ok(chosen);
        }
        n = (n + 1).max(n * 9 / 8);
    }
    let (found, limit, format) = (n + 1, limits.points, limits.format);
    let reached_um = error(&equal(limit - 1)) * 1e3;
    Err(ExportError::TooManyPoints { found, limit, format, reached_um })
}

/// Largest distance between a curve and the lines between its values at some of its positions.
fn deviation(x: &[f64], y: &[f64], positions: &[f64]) -> f64 {
    let at = |p: f64| {
        let i = x.partition_point(|v| *v <= p).clamp(1, x.len() - 1);
        y[i - 1] + (y[i] - y[i - 1]) * (p - x[i - 1]) / (x[i] - x[i - 1])
    };
    let mut worst = 0.0f64;
    let mut from = 0;
    for pair in positions.windows(2) {
        let (a, b) = (at(pair[0]), at(pair[1]));
        while from < x.len() && x[from] <= pair[1] {
            let line = a + (b - a) * (x[from] - pair[0]) / (pair[1] - pair[0]);
            worst = worst.max((y[from] - line).abs());
            from += 1;
        }
    }
    worst
}

/// Douglas-Peucker over several curves at once: keeps positions until every line is within the tolerance.
fn thinned(x: &[f64], curves: &[Vec<f64>], tolerance: f64) -> Vec<f64> {
    let mut keep = BTreeSet::from([0, x.len() - 1]);
    let mut open = vec![(0, x.len() - 1)];
    while let Some((a, b)) = open.pop() {
        let mut worst = (tolerance, None);
        for y in curves {
            for i in a + 1..b {
                let line = y[a] + (y[b] - y[a]) * (x[i] - x[a]) / (x[b] - x[a]);
                let off = (y[i] - line).abs();
                if off > worst.0 {
                    worst = (off, Some(i));
                }
            }
        }
        if let Some(i) = worst.1 {
            keep.insert(i);
            open.extend([(a, i), (i, b)]);
        }
    }
    keep.into_iter().map(|i| x[i]).collect()
}

/// Increasing and without repetition.
pub(super) fn sorted(mut values: Vec<f64>) -> Vec<f64> {
    values.sort_by(f64::total_cmp);
    // -0 and 0 are one position
    values.dedup_by(|a, b| a == b);
    values
}

#[cfg(test)]
mod tests;
