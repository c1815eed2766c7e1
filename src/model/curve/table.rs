//! Support points with linear or monotone cubic interpolation, optionally one curve per direction.

use super::{CurveError, all_finite};
use crate::axes::Travel;

/// How values between support points are found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Interpolation {
    /// Straight lines.
    #[default]
    Linear,
    /// Cubic Hermite with slopes limited so that the curve never overshoots its support points.
    ///
    /// Source: Fritsch and Butland 1984 (weighted harmonic mean), as in PCHIP.
    MonotoneCubic,
}

/// A table over strictly increasing positions.
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    positions: Vec<f64>,
    forward: Branch,
    reverse: Option<Branch>,
    interpolation: Interpolation,
    /// Where positions are equally spaced: 1 / spacing, so that look-up needs no search.
    per_spacing: Option<f64>,
}

/// A position among the support points of a table.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    interval: usize,
    width: f64,
    share: f64,
}

#[derive(Debug, Clone, PartialEq)]
struct Branch {
    values: Vec<f64>,
    /// Slopes at the support points; empty for linear interpolation.
    slopes: Vec<f64>,
}

impl Table {
    /// A table; `reverse` holds the values for travel in the negative direction.
    ///
    /// # Errors
    /// Fewer than two positions, positions that do not increase strictly, values that are not finite
    /// or whose number differs from that of the positions.
    pub fn new(
        positions: Vec<f64>,
        values: Vec<f64>,
        reverse: Option<Vec<f64>>,
        interpolation: Interpolation,
    ) -> Result<Self, CurveError> {
        if positions.len() < 2 {
            return Err(CurveError::TooFewPoints { needed: 2, found: positions.len() });
        }
        all_finite(&positions)?;
        for (i, pair) in positions.windows(2).enumerate() {
            if pair[1] <= pair[0] {
                return Err(CurveError::NotIncreasing { row: i + 2, value: pair[1], previous: pair[0] });
            }
        }
        let forward = Branch::new(&positions, values, interpolation)?;
        let reverse = reverse.map(|r| Branch::new(&positions, r, interpolation)).transpose()?;
        let per_spacing = equal_spacing(&positions).map(|h| 1.0 / h);
        Ok(Self { positions, forward, reverse, interpolation, per_spacing })
    }

    /// The value at `position`; beyond the ends the end value is held.
    #[must_use]
    pub fn value(&self, position: f64, travel: Travel) -> f64 {
        self.value_at(&self.place(position), travel)
    }

    /// Where `position` (held at the ends) lies among the support points.
    #[must_use]
    pub fn place(&self, position: f64) -> Place {
        let [low, high] = self.range();
        let x = position.clamp(low, high);
        let interval = self.interval(x);
        let width = self.positions[interval + 1] - self.positions[interval];
        Place { interval, width, share: (x - self.positions[interval]) / width }
    }

    /// True where a place found in `other` is right in this table, too.
    #[must_use]
    pub fn shares_look_up(&self, other: &Self) -> bool {
        self.positions == other.positions
    }

    /// The value at a place found by [`Table::place`] in a table over the same positions.
    #[must_use]
    pub fn value_at(&self, place: &Place, travel: Travel) -> f64 {
        let branch = match (&self.reverse, travel) {
            (Some(reverse), Travel::Reverse) => reverse,
            _ => &self.forward,
        };
        let Place { interval: i, width, share: u } = *place;
        let (v0, v1) = (branch.values[i], branch.values[i + 1]);
        if branch.slopes.is_empty() {
            return v0 + u * (v1 - v0);
        }
        let (m0, m1) = (branch.slopes[i] * width, branch.slopes[i + 1] * width);
        let w = 1.0 - u;
        // cubic Hermite basis
        v0 * (1.0 + 2.0 * u) * w * w + m0 * u * w * w + v1 * u * u * (3.0 - 2.0 * u) - m1 * u * u * w
    }

    /// First and last position.
    #[must_use]
    pub fn range(&self) -> [f64; 2] {
        [self.positions[0], self.positions[self.positions.len() - 1]]
    }

    /// The positions, forward values and, where present, reverse values.
    #[must_use]
    pub fn columns(&self) -> (&[f64], &[f64], Option<&[f64]>) {
        (&self.positions, &self.forward.values, self.reverse.as_ref().map(|r| r.values.as_slice()))
    }

    /// The interpolation rule.
    #[must_use]
    pub const fn interpolation(&self) -> Interpolation {
        self.interpolation
    }

    /// Index of the interval that holds `x` (inside the range); constant time where equally spaced.
    fn interval(&self, x: f64) -> usize {
        let last = self.positions.len() - 2;
        match self.per_spacing {
            Some(per_spacing) => {
                let i = (((x - self.positions[0]) * per_spacing) as usize).min(last);
                // rounding may put x one interval off
                if x < self.positions[i] {
                    i - 1
                } else if i < last && x >= self.positions[i + 1] {
                    i + 1
                } else {
                    i
                }
            }
            None => self.positions.partition_point(|&p| p <= x).saturating_sub(1).min(last),
        }
    }
}

impl Branch {
    fn new(positions: &[f64], values: Vec<f64>, interpolation: Interpolation) -> Result<Self, CurveError> {
        if values.len() != positions.len() {
            return Err(CurveError::LengthMismatch { expected: positions.len(), found: values.len() });
        }
        all_finite(&values)?;
        let slopes = match interpolation {
            Interpolation::Linear => Vec::new(),
            Interpolation::MonotoneCubic => monotone_slopes(positions, &values),
        };
        Ok(Self { values, slopes })
    }
}

/// The common spacing where every interval agrees to 1e-9 of it.
fn equal_spacing(positions: &[f64]) -> Option<f64> {
    let n = positions.len() - 1;
    let h = (positions[n] - positions[0]) / n as f64;
    let equal =
        positions.iter().enumerate().all(|(i, &p)| (p - (positions[0] + i as f64 * h)).abs() <= 1e-9 * h);
    equal.then_some(h)
}

/// Slopes of the monotone cubic (PCHIP): weighted harmonic mean inside, limited one-sided at the ends.
fn monotone_slopes(x: &[f64], y: &[f64]) -> Vec<f64> {
    let n = x.len();
    let h: Vec<f64> = x.windows(2).map(|w| w[1] - w[0]).collect();
    let d: Vec<f64> = y.windows(2).zip(&h).map(|(w, h)| (w[1] - w[0]) / h).collect();
    if n == 2 {
        return vec![d[0], d[0]];
    }
    let mut m = vec![0.0; n];
    for i in 1..n - 1 {
        if d[i - 1] * d[i] > 0.0 {
            let (w1, w2) = (2.0 * h[i] + h[i - 1], h[i] + 2.0 * h[i - 1]);
            m[i] = (w1 + w2) / (w1 / d[i - 1] + w2 / d[i]);
        }
    }
    m[0] = end_slope(h[0], h[1], d[0], d[1]);
    m[n - 1] = end_slope(h[n - 2], h[n - 3], d[n - 2], d[n - 3]);
    m
}

/// Three-point end slope, kept on the side of its interval and below three times its secant.
fn end_slope(h0: f64, h1: f64, d0: f64, d1: f64) -> f64 {
    let m = ((2.0 * h0 + h1) * d0 - h0 * d1) / (h0 + h1);
    if m * d0 <= 0.0 {
        0.0
    } else if d0 * d1 <= 0.0 && m.abs() > 3.0 * d0.abs() {
        3.0 * d0
    } else {
        m
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn table(interpolation: Interpolation) -> Table {
        Table::new(
            vec![0.0, 10.0, 20.0, 50.0],
            vec![0.0, 1.5, 0.7, 0.7],
            Some(vec![1.0, 2.5, 1.7, 1.7]),
            interpolation,
        )
        .unwrap()
    }

    #[test]
    fn support_points_edges_and_beyond() {
        for rule in [Interpolation::Linear, Interpolation::MonotoneCubic] {
            let t = table(rule);
            for (x, v) in [(0.0, 0.0), (10.0, 1.5), (20.0, 0.7), (50.0, 0.7), (-99.0, 0.0), (99.0, 0.7)] {
                assert!((t.value(x, Travel::Forward) - v).abs() < 1e-12, "{rule:?} {x}");
                assert!((t.value(x, Travel::Reverse) - v - 1.0).abs() < 1e-12, "{rule:?} {x}");
            }
        }
        assert!((table(Interpolation::Linear).value(5.0, Travel::Forward) - 0.75).abs() < 1e-15);
    }

    #[test]
    fn one_curve_serves_both_directions_where_no_reverse_is_given() {
        let t = Table::new(vec![0.0, 1.0], vec![2.0, 3.0], None, Interpolation::Linear).unwrap();
        assert_eq!(t.value(0.5, Travel::Reverse), t.value(0.5, Travel::Forward));
    }

    #[test]
    fn bad_tables_are_refused_with_the_row() {
        let err = |p: &[f64], v: &[f64]| {
            Table::new(p.to_vec(), v.to_vec(), None, Interpolation::Linear).unwrap_err()
        };
        assert_eq!(err(&[0.0], &[1.0]), CurveError::TooFewPoints { needed: 2, found: 1 });
        assert_eq!(
            err(&[0.0, 5.0, 5.0], &[1.0, 2.0, 3.0]),
            CurveError::NotIncreasing { row: 3, value: 5.0, previous: 5.0 }
        );
        assert_eq!(err(&[0.0, 1.0], &[1.0]), CurveError::LengthMismatch { expected: 2, found: 1 });
        assert_eq!(err(&[0.0, 1.0], &[1.0, f64::NAN]), CurveError::NotFinite { row: 2 });
        assert_eq!(err(&[0.0, f64::INFINITY], &[1.0, 1.0]), CurveError::NotFinite { row: 2 });
    }

    proptest! {
        #[test]
        fn monotone_cubic_never_overshoots(values in prop::collection::vec(-10.0..10.0f64, 2..12), u in 0.0..1.0f64) {
            let x: Vec<f64> = (0..values.len()).map(|i| (i * i) as f64).collect();
            let t = Table::new(x.clone(), values.clone(), None, Interpolation::MonotoneCubic).unwrap();
            let p = u * x[x.len() - 1];
            let i = x.partition_point(|&k| k <= p).saturating_sub(1).min(x.len() - 2);
            let (lo, hi) = (values[i].min(values[i + 1]), values[i].max(values[i + 1]));
            let v = t.value(p, Travel::Forward);
            prop_assert!(v >= lo - 1e-9 && v <= hi + 1e-9);
        }

        #[test]
        fn equally_spaced_look_up_equals_search(n in 2usize..200, h in 0.1..30.0f64, start in -500.0..500.0f64, u in -0.1..1.1f64) {
            let x: Vec<f64> = (0..n).map(|i| start + i as f64 * h).collect();
            let v: Vec<f64> = (0..n).map(|i| (i as f64 * 0.7).sin()).collect();
            let mut t = Table::new(x, v, None, Interpolation::Linear).unwrap();
            let p = start + u * h * (n - 1) as f64;
            let fast = t.value(p, Travel::Forward);
            t.per_spacing = None;
            prop_assert!((fast - t.value(p, Travel::Forward)).abs() < 1e-9);
        }
    }
}
