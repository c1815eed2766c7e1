//! An error motion that several sources state: comparison where they overlap, and their mean.

use super::{AssembleError, Assembly, Candidate, Check, How, Origin};
use crate::prelude::*;
use volcomp_model::curve::ErrorFunction;

/// Least places of a curve that is sampled.
const PLACES_MIN: usize = 33;
/// Places per number of a curve that is sampled.
const PLACES_PER_NUMBER: usize = 8;

/// A source's curve made ready for comparison.
struct Stated {
    source: usize,
    function: ErrorFunction,
    range: [f64; 2],
    std: Option<f64>,
    /// True where it tells the directions of travel apart.
    directed: bool,
    /// Line of the set-up that is added to bring it to the others: constant, slope, about `middle`.
    aligned: [f64; 2],
    middle: f64,
}

impl Stated {
    fn value(&self, x: f64, travel: Travel) -> f64 {
        self.function.value(x, travel) + self.aligned[0] + self.aligned[1] * (x - self.middle)
    }

    fn covers(&self, x: f64) -> bool {
        (self.range[0]..=self.range[1]).contains(&x)
    }

    /// Share of the weight at a place: falls towards an end of the source inside another one.
    fn taper(&self, x: f64, hull: [f64; 2]) -> f64 {
        if !self.covers(x) {
            return 0.0;
        }
        let width = 0.1 * (self.range[1] - self.range[0]);
        let end =
            |inside: bool, distance: f64| if inside { (distance / width).clamp(1e-6, 1.0) } else { 1.0 };
        let tolerance = 1e-9 * (hull[1] - hull[0]);
        end(self.range[0] > hull[0] + tolerance, x - self.range[0])
            * end(self.range[1] < hull[1] - tolerance, self.range[1] - x)
    }
}

impl Assembly<'_> {
    /// One function from all candidates.
    pub(super) fn combined(
        &mut self,
        symbol: ErrorSymbol,
        candidates: Vec<Candidate>,
        preferred: Option<usize>,
    ) -> Result<ErrorFunction, AssembleError> {
        if let [only] = &candidates[..] {
            let how = if preferred.is_some() && self.stating(symbol).len() > 1 {
                How::Preferred
            } else {
                How::Only
            };
            self.errors.push(Origin { symbol, how, from: vec![(only.source, 1.0)] });
            return Ok(only.function.clone());
        }
        let plain = |f: &ErrorFunction| f.grids.is_empty() && f.live.is_empty();
        if let Some(bad) = candidates.iter().find(|c| !plain(&c.function)) {
            if let Some(chosen) = candidates.iter().find(|c| Some(c.source) == preferred) {
                self.errors.push(Origin { symbol, how: How::Preferred, from: vec![(chosen.source, 1.0)] });
                return Ok(chosen.function.clone());
            }
            return Err(AssembleError::NotComparable { symbol, source_name: self.name(bad.source) });
        }
        let mut stated: Vec<Stated> = candidates.into_iter().map(|c| self.stated(symbol, c)).collect();
        let first = self.checks.len();
        for i in 0..stated.len() {
            for j in 0..i {
                match check(symbol, &stated[j], &stated[i]) {
                    Some(found) => self.checks.push(found),
                    None if preferred.is_some() || stated.len() > 2 => {}
                    None => return Err(self.disjoint(symbol, &stated[j], &stated[i])),
                }
            }
        }
        let checks = self.checks[first..].to_vec();
        if let Some(chosen) = stated.iter().find(|s| Some(s.source) == preferred) {
            self.errors.push(Origin { symbol, how: How::Preferred, from: vec![(chosen.source, 1.0)] });
            return Ok(chosen.function.clone());
        }
        let same_range = |s: &Stated| s.range == stated[0].range;
        if checks.iter().all(Check::is_identical) && stated.iter().all(same_range) {
            let from = stated.iter().map(|s| (s.source, 1.0 / stated.len() as f64)).collect();
            self.errors.push(Origin { symbol, how: How::Same, from });
            return Ok(stated.swap_remove(0).function);
        }
        let birge = self.judge(symbol, &checks)?;
        self.align(symbol, &mut stated)?;
        let (function, from, joined) = mean(&stated, birge);
        let how = if joined { How::Joined } else { How::Mean };
        self.errors.push(Origin { symbol, how, from });
        Ok(function)
    }

    fn disjoint(&self, symbol: ErrorSymbol, a: &Stated, b: &Stated) -> AssembleError {
        AssembleError::Disjoint { symbol, first: self.name(a.source), second: self.name(b.source) }
    }

    fn stated(&self, symbol: ErrorSymbol, c: Candidate) -> Stated {
        let ready = &self.ready[c.source];
        let covered = ready.covered.iter().find(|(s, _)| *s == symbol).map(|(_, r)| *r);
        // a constant holds over the travel; relative sense runs over the programmed coordinate, as the travel does
        let travel = ready.travel.iter().find(|(a, _)| *a == symbol.axis()).map(|(_, r)| *r);
        let range = covered.or(travel).unwrap_or([0.0, 0.0]);
        let directed =
            c.function.curves.iter().any(|k| matches!(k, Curve::Table(t) if t.columns().2.is_some()));
        Stated {
            source: c.source,
            std: self.std(symbol, &c.function),
            function: c.function,
            range,
            directed,
            aligned: [0.0; 2],
            middle: 0.5 * (range[0] + range[1]),
        }
    }

    /// The factor by which the uncertainty of the mean grows; sources that may not be averaged are conflicts.
    pub(super) fn judge(&mut self, symbol: ErrorSymbol, checks: &[Check]) -> Result<f64, AssembleError> {
        let mut birge = 1.0f64;
        for c in checks.iter().filter(|c| !c.is_identical()) {
            let Some((chi, p)) = c.chi_square.zip(c.p) else {
                if self.averages(symbol) {
                    continue;
                }
                return Err(AssembleError::Untested {
                    symbol,
                    first: self.name(c.sources[0]),
                    second: self.name(c.sources[1]),
                    largest: c.largest,
                });
            };
            if p < self.options.significance {
                if self.averages(symbol) {
                    birge = birge.max((chi / c.dof.max(1) as f64).sqrt());
                } else {
                    self.conflicts.push(c.clone());
                }
            }
        }
        Ok(birge)
    }

    /// Brings all curves to the set-up of the first, each to the one before with which it overlaps most.
    fn align(&self, symbol: ErrorSymbol, stated: &mut [Stated]) -> Result<(), AssembleError> {
        let mut done = vec![0usize];
        while done.len() < stated.len() {
            let overlap = |i: usize, j: usize| {
                let [a, b] = [&stated[i].range, &stated[j].range];
                a[1].min(b[1]) - a[0].max(b[0])
            };
            let open = (0..stated.len()).filter(|i| !done.contains(i));
            let pairs = open.flat_map(|i| done.iter().map(move |j| (i, *j)));
            let best = pairs.max_by(|a, b| overlap(a.0, a.1).total_cmp(&overlap(b.0, b.1)));
            let Some((i, j)) = best else { break };
            let Some(found) = check(symbol, &stated[j], &stated[i]) else {
                return Err(self.disjoint(symbol, &stated[j], &stated[i]));
            };
            let middle = found.over.map_or(0.0, |[low, high]| 0.5 * (low + high));
            let s = &mut stated[i];
            s.aligned = [-(found.constant + found.slope * (s.middle - middle)), -found.slope];
            done.push(i);
        }
        Ok(())
    }
}

/// How many numbers a function has within a range.
fn numbers(f: &ErrorFunction, [low, high]: [f64; 2]) -> usize {
    let of = |c: &Curve| match c {
        Curve::Constant(_) => 1,
        Curve::Table(t) => t.columns().0.iter().filter(|x| (low..=high).contains(*x)).count(),
        Curve::Fourier(f) => 2 * f.harmonics().len() + 2,
        Curve::HalfRange(h) => h.coefficients().2.count() + 2,
        Curve::Chebyshev(c) => c.coefficients().len(),
    };
    // what reference points added has the same places as the rest
    f.curves.iter().map(of).max().unwrap_or(1)
}

/// Places at which two functions are compared: the support points of the coarser one, else as many places.
fn places(a: &Stated, b: &Stated, over: [f64; 2]) -> Vec<f64> {
    let coarse = if numbers(&b.function, over) < numbers(&a.function, over) { b } else { a };
    let table = coarse.function.curves.iter().find_map(|c| match c {
        Curve::Table(t) => Some(t.columns().0),
        _ => None,
    });
    let tolerance = 1e-9 * (over[1] - over[0]);
    match table {
        Some(x) => {
            x.iter().copied().filter(|x| (over[0] - tolerance..=over[1] + tolerance).contains(x)).collect()
        }
        None => {
            let n = numbers(&coarse.function, over).max(2);
            (0..n).map(|i| over[0] + (over[1] - over[0]) * i as f64 / (n - 1) as f64).collect()
        }
    }
}

/// Compares two functions; `None` where their ranges have nothing in common.
fn check(symbol: ErrorSymbol, a: &Stated, b: &Stated) -> Option<Check> {
    let over = [a.range[0].max(b.range[0]), a.range[1].min(b.range[1])];
    if over[0] >= over[1] {
        return None;
    }
    let at = places(a, b, over);
    let travels: &[Travel] =
        if a.directed && b.directed { &[Travel::Forward, Travel::Reverse] } else { &[Travel::Forward] };
    let value = |s: &Stated, x: f64, travel: Travel| match a.directed == b.directed {
        true => s.value(x, travel),
        // one knows the directions, the other their mean
        false => 0.5 * (s.value(x, Travel::Forward) + s.value(x, Travel::Reverse)),
    };
    let points: Vec<(f64, f64)> =
        travels.iter().flat_map(|t| at.iter().map(|x| (*x, value(b, *x, *t) - value(a, *x, *t)))).collect();
    let straightness = !symbol.is_angle()
        && symbol.axis().kind() == AxisKind::Linear
        && symbol.component().index() != symbol.axis().direction();
    let middle = 0.5 * (over[0] + over[1]);
    let n = points.len() as f64;
    let mean_x = points.iter().map(|p| p.0).sum::<f64>() / n;
    let mean_d = points.iter().map(|p| p.1).sum::<f64>() / n;
    let (sxx, sxd) = points
        .iter()
        .fold((0.0, 0.0), |(xx, xd), (x, d)| (xx + (x - mean_x).powi(2), xd + (x - mean_x) * (d - mean_d)));
    let slope = if straightness && sxx > 0.0 { sxd / sxx } else { 0.0 };
    let constant = mean_d + slope * (middle - mean_x);
    let left = points.iter().map(|(x, d)| (*x, d - constant - slope * (x - middle)));
    let (mut largest, mut place, mut sum) = (0.0f64, over[0], 0.0);
    for (x, d) in left {
        sum += d * d;
        if d.abs() > largest.abs() {
            (largest, place) = (d, x);
        }
    }
    let dof = points.len().saturating_sub(if straightness { 2 } else { 1 });
    let std = a.std.zip(b.std).map(|(x, y)| x.hypot(y)).filter(|_| dof > 0);
    let chi_square = std.map(|s| sum / (s * s));
    Some(Check {
        symbol,
        sources: [a.source, b.source],
        over: Some(over),
        places: points.len(),
        constant,
        slope,
        largest,
        at: place,
        rms: (sum / n).sqrt(),
        std,
        chi_square,
        dof,
        p: chi_square.map(|c| chi_square_upper(c, dof)),
    })
}

/// The weighted mean of aligned functions as a table, the share of each, and whether ranges were joined.
fn mean(stated: &[Stated], birge: f64) -> (ErrorFunction, Vec<(usize, f64)>, bool) {
    let hull = hull(stated.iter().flat_map(|s| s.range));
    let mut x: Vec<f64> = stated.iter().flat_map(|s| own_places(s, hull)).collect();
    x.sort_by(f64::total_cmp);
    x.dedup_by(|b, a| *b - *a <= 1e-9 * (hull[1] - hull[0]));
    // without uncertainties all count alike
    let known = stated.iter().all(|s| s.std.is_some());
    let weight = |s: &Stated| if known { s.std.map_or(1.0, |u| 1.0 / (u * u)) } else { 1.0 };
    let directed = stated.iter().any(|s| s.directed);
    let (mut shares, mut largest) = (vec![0.0; stated.len()], 0.0f64);
    let mut at = |q: f64, travel: Travel| {
        let weights: Vec<f64> = stated.iter().map(|s| weight(s) * s.taper(q, hull)).collect();
        let total: f64 = weights.iter().sum();
        for (share, w) in shares.iter_mut().zip(&weights) {
            *share += w / total;
        }
        // the uncertainty of the mean with these weights
        let variance: f64 =
            stated.iter().zip(&weights).map(|(s, w)| (w / total * s.std.unwrap_or(0.0)).powi(2)).sum();
        largest = largest.max(variance.sqrt());
        stated
            .iter()
            .zip(&weights)
            .filter(|(_, w)| **w > 0.0)
            .map(|(s, w)| w / total * s.value(q, travel))
            .sum::<f64>()
    };
    let forward: Vec<f64> = x.iter().map(|q| at(*q, Travel::Forward)).collect();
    let reverse = directed.then(|| x.iter().map(|q| at(*q, Travel::Reverse)).collect());
    let passes = x.len() as f64 * if directed { 2.0 } else { 1.0 };
    let from = stated.iter().zip(shares).map(|(s, share)| (s.source, share / passes)).collect();
    let joined = stated.iter().any(|s| s.range != hull);
    let function = match Table::new(x, forward, reverse, Interpolation::Linear) {
        Ok(table) => ErrorFunction {
            std: known.then_some(birge * largest),
            ..ErrorFunction::single(Curve::Table(table))
        },
        // places are distinct and values finite; a single place cannot be a table
        Err(_) => stated[0].function.clone(),
    };
    (function, from, joined)
}

/// Places that hold a function: its support points, or enough for its waves; and the ends of its tapers.
fn own_places(s: &Stated, hull: [f64; 2]) -> Vec<f64> {
    let mut out: Vec<f64> = Vec::new();
    for curve in &s.function.curves {
        match curve {
            Curve::Table(t) if t.interpolation() == Interpolation::Linear => out.extend(t.columns().0),
            Curve::Constant(_) => {}
            other => {
                let n = (PLACES_PER_NUMBER * numbers(&ErrorFunction::single(other.clone()), s.range))
                    .max(PLACES_MIN);
                let [low, high] = other.range().unwrap_or(s.range);
                out.extend((0..n).map(|i| low + (high - low) * i as f64 / (n - 1) as f64));
            }
        }
    }
    out.retain(|x| s.covers(*x));
    out.extend(s.range);
    let width = 0.1 * (s.range[1] - s.range[0]);
    if s.range[0] > hull[0] {
        out.push(s.range[0] + width);
    }
    if s.range[1] < hull[1] {
        out.push(s.range[1] - width);
    }
    out
}
