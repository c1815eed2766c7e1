//! Noise that grows with the distance: of an instrument that measures angles.

use std::collections::BTreeMap;

use super::super::constants::{FEW, HALF, SIGNIFICANT};
use super::super::library::line_of_sight;
use super::super::moment::Moment;
use super::super::session::Session;
use super::moves;

/// Noise that grows with the distance.
#[derive(Debug, Clone, PartialEq)]
pub struct RangeNoise {
    /// The instrument class.
    pub instrument: usize,
    /// The noise goes with this power of the range.
    pub exponent: f64,
    /// Twice the logarithm of the likelihood against noise that is the same at all distances.
    pub evidence: f64,
}

/// Powers of the range that are tried, in steps of a tenth.
const TENTHS: core::ops::RangeInclusive<u8> = 2..=40;

/// What differs between repeats, by the distance.
#[must_use]
pub fn range_noise(session: &Session, residuals: &[f64]) -> Option<RangeNoise> {
    (0..session.instruments.len())
        .filter_map(|class| {
            let all = neighbours(session, residuals, class, |m| m.range_mm);
            let of = all.iter().filter(|n| n.of_both > 0.0);
            let (rows, axes): (Vec<(f64, f64)>, Vec<usize>) =
                of.map(|n| ((n.square, n.of_both), n.axis)).unzip();
            if rows.len() < 5 * FEW {
                return None;
            }
            let (exponent, evidence) = by_range(&rows, &axes)?;
            Some(RangeNoise { instrument: class, exponent, evidence })
        })
        .max_by(|a, b| a.evidence.total_cmp(&b.evidence))
}

/// Power of the range and its evidence from squares of residuals and ranges; `axes` are the directions.
fn by_range(rows: &[(f64, f64)], axes: &[usize]) -> Option<(f64, f64)> {
    let scatter = Scatter::of(rows, axes)?;
    let middle = rows.iter().map(|r| r.1.ln()).sum::<f64>() / rows.len() as f64;
    let power = |exponent: f64| scatter.likelihood(&|k| (2.0 * exponent * (rows[k].1.ln() - middle)).exp());
    let (exponent, best) = TENTHS
        .map(|tenths| 0.1 * f64::from(tenths))
        .map(|exponent| (exponent, power(exponent)))
        .max_by(|a, b| a.1.total_cmp(&b.1))?;
    let evidence = scatter.evidence(best)?;
    Some((exponent, evidence))
}

/// Two readings that follow each other in a run and look the same way.
struct Neighbours {
    /// Half the square of the difference of their residuals: a drift is no noise, and what changes between repeats neither.
    square: f64,
    /// The mean of what was asked of both.
    of_both: f64,
    /// The direction in which they look.
    axis: usize,
}

/// Neighbours of one class at rest whose residuals are known; `of` is asked of both, NaN leaves a reading out. What shakes a moving
/// axis is no noise of the instrument.
fn neighbours(
    session: &Session,
    residuals: &[f64],
    class: usize,
    of: impl Fn(&Moment) -> f64,
) -> Vec<Neighbours> {
    let mut last: BTreeMap<(usize, i64, usize), (f64, f64)> = BTreeMap::new();
    let mut all = Vec::new();
    let of_class = |i: &usize| session.readings[*i].instrument == class && residuals[*i].is_finite();
    for i in (0..residuals.len()).filter(of_class) {
        let (r, m) = (&session.readings[i], &session.moments[i]);
        let (axis, own) = (m.u.iamax(), of(m));
        if own.is_nan() || moves(m) {
            continue;
        }
        if let Some((residual, other)) = last.insert((r.run, r.repeat, axis), (residuals[i], own)) {
            let square = 0.5 * (residuals[i] - residual).powi(2);
            all.push(Neighbours { square, of_both: 0.5 * (own + other), axis });
        }
    }
    all
}

/// Noise across the line of sight that goes with the distance: that of the angles of a tracker.
#[derive(Debug, Clone, PartialEq)]
pub struct AngleNoise {
    /// The instrument class.
    pub instrument: usize,
    /// Standard deviation across the line of sight per distance, um/m.
    pub um_per_m: f64,
    /// Twice the logarithm of the likelihood against noise that is the same in all directions.
    pub evidence: f64,
}

/// Least square of a distance across as a share of the largest, in one direction, from which an instrument saw one place only.
const ELSEWHERE: f64 = 0.8;

/// What differs between repeats, by the angle to the line of sight and the distance.
#[must_use]
pub fn angle_noise(session: &Session, residuals: &[f64]) -> Option<AngleNoise> {
    (0..session.instruments.len())
        .filter_map(|class| {
            let all = neighbours(session, residuals, class, |m| across_m2(m).unwrap_or(f64::NAN));
            let rows: Vec<(f64, f64)> = all.iter().map(|n| (n.square, n.of_both)).collect();
            let axes: Vec<usize> = all.iter().map(|n| n.axis).collect();
            if rows.len() < 5 * FEW || !is_elsewhere(&rows, &axes) {
                return None;
            }
            let (um_per_m, evidence) = by_angle(&rows, &axes)?;
            Some(AngleNoise { instrument: class, um_per_m, evidence })
        })
        .max_by(|a, b| a.evidence.total_cmp(&b.evidence))
}

/// False where the distance across hardly changes in any direction: at one place a vibration along the direction of an axis
/// looks the same.
fn is_elsewhere(rows: &[(f64, f64)], axes: &[usize]) -> bool {
    (0..3).any(|axis| {
        let of: Vec<f64> = rows.iter().zip(axes).filter(|(_, a)| **a == axis).map(|(r, _)| r.1).collect();
        let (low, high) = of.iter().fold((f64::INFINITY, 0.0f64), |(l, h), q| (l.min(*q), h.max(*q)));
        low < ELSEWHERE * high
    })
}

/// Square of the distance, times the share of the direction that lies across the line of sight.
fn across_m2(m: &Moment) -> Option<f64> {
    let beam = line_of_sight(m)?;
    let share = (1.0 - m.u.dot(&beam).powi(2)).max(0.0);
    (m.range_mm > 0.0).then(|| share * (1e-3 * m.range_mm).powi(2))
}

/// Noise per distance and its evidence from squares of residuals and squares of distances across; `axes` are the directions.
fn by_angle(rows: &[(f64, f64)], axes: &[usize]) -> Option<(f64, f64)> {
    let scatter = Scatter::of(rows, axes)?;
    let far = rows.iter().map(|r| r.1).sum::<f64>() / rows.len() as f64;
    if far <= 0.0 {
        return None;
    }
    // variance = size times (1 - share + share q / mean of q)
    let (share, best) = (1..=50)
        .map(|k| f64::from(k) / 50.0 * 0.999)
        .map(|share| (share, scatter.likelihood(&|k| 1.0 - share + share * rows[k].1 / far)))
        .max_by(|a, b| a.1.total_cmp(&b.1))?;
    let evidence = scatter.evidence(best)?;
    (share >= HALF).then(|| ((scatter.mean * share / far).sqrt(), evidence))
}

/// Squares of residuals whose variance may have a shape.
struct Scatter<'a> {
    /// Squares, clipped.
    squares: Vec<f64>,
    /// Direction of each.
    axes: &'a [usize],
    /// Their mean before that.
    mean: f64,
}

impl<'a> Scatter<'a> {
    fn of(rows: &[(f64, f64)], axes: &'a [usize]) -> Option<Self> {
        let mean = rows.iter().map(|r| r.0).sum::<f64>() / rows.len() as f64;
        let most = SIGNIFICANT * SIGNIFICANT * mean;
        let squares = rows.iter().map(|r| r.0.min(most)).collect();
        (mean > 0.0).then_some(Self { squares, axes, mean })
    }

    /// Logarithm of the likelihood where the variance has a shape.
    fn likelihood(&self, shape: &dyn Fn(usize) -> f64) -> f64 {
        let n = self.squares.len();
        let size = self.squares.iter().enumerate().map(|(k, s)| s / shape(k)).sum::<f64>() / n as f64;
        -0.5 * (n as f64 * size.max(1e-300).ln() + (0..n).map(|k| shape(k).ln()).sum::<f64>())
    }

    /// What a shape of this likelihood says against an even scatter: half of the ratio of likelihoods counts, because partners in
    /// repeats are not independent. None where the directions explain it.
    fn evidence(&self, likelihood: f64) -> Option<f64> {
        let evidence = likelihood - self.likelihood(&|_| 1.0);
        let own: [f64; 3] = core::array::from_fn(|axis| {
            let of_axis = self.squares.iter().zip(self.axes).filter(|(_, a)| **a == axis);
            let (sum, n) = of_axis.fold((0.0, 0usize), |(sum, n), (s, _)| (sum + s, n + 1));
            (sum / n.max(1) as f64).max(1e-9 * self.mean)
        });
        let is_a_direction = self.likelihood(&|k| own[self.axes[k]]) - likelihood > HALF * evidence;
        (!is_a_direction).then_some(evidence)
    }
}

#[cfg(test)]
mod tests {
    use super::super::Random;
    use super::{by_angle, by_range, is_elsewhere};

    /// Readings along three axes at three distances from a station; noise of the angles per metre, of the length, of one axis.
    fn readings(angles: f64, length: f64, one_axis: f64) -> (Vec<(f64, f64)>, Vec<usize>) {
        let mut random = Random::new(3);
        let across = [0.3, 0.7, 0.98];
        (0..600)
            .map(|i| {
                let (axis, range_m) = (i % 3, 1.8 + 0.2 * f64::from((i / 3) as u32 % 3));
                let q = across[axis] * range_m * range_m;
                let own = if axis == 2 { one_axis } else { 0.0 };
                let std = (angles * angles * q + length * length + own * own).sqrt();
                (((std * random.normal()).powi(2), q), axis)
            })
            .unzip()
    }

    #[test]
    fn noise_of_angles_is_found_with_its_size() {
        let (rows, axes) = readings(5.0, 1.0, 0.0);
        let (um_per_m, evidence) = by_angle(&rows, &axes).unwrap();
        assert!((um_per_m - 5.0).abs() < 0.5 && evidence > 30.0, "{um_per_m} {evidence}");
    }

    #[test]
    fn an_instrument_that_looks_at_one_place_shows_no_angles() {
        let here: Vec<(f64, f64)> = (0..90).map(|i| (1.0, [0.02, 0.9, 1.0][i % 3])).collect();
        let axes: Vec<usize> = (0..90).map(|i| i % 3).collect();
        assert!(!is_elsewhere(&here, &axes));
        let (rows, axes) = readings(5.0, 1.0, 0.0);
        assert!(is_elsewhere(&rows, &axes));
    }

    #[test]
    fn noise_that_grows_with_the_range_is_found_with_its_power() {
        let mut random = Random::new(5);
        let mut readings = |exponent: f64| {
            let rows: Vec<(f64, f64)> = (0..360)
                .map(|i| {
                    let range = 700.0 + 3.6 * f64::from(i);
                    ((2.0 * (range / 1300.0).powf(exponent) * random.normal()).powi(2), range)
                })
                .collect();
            let axes: Vec<usize> = (0..360).map(|i| i % 3).collect();
            by_range(&rows, &axes)
        };
        let (exponent, evidence) = readings(1.0).unwrap();
        assert!((exponent - 1.0).abs() < 0.4 && evidence > 8.0, "{exponent} {evidence}");
        assert!(readings(0.0).is_none_or(|(_, evidence)| evidence < 4.0));
    }

    #[test]
    fn noise_of_the_length_and_of_one_axis_is_none() {
        let (rows, axes) = readings(0.0, 2.0, 0.0);
        assert!(by_angle(&rows, &axes).is_none_or(|(_, evidence)| evidence < 10.0));
        let (rows, axes) = readings(0.0, 1.0, 4.0);
        assert_eq!(by_angle(&rows, &axes), None);
    }
}
