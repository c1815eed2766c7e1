//! Noise that grows with the distance: of an instrument that measures angles.

use std::collections::{BTreeMap, VecDeque};

use super::super::constants::{FEW, HALF, SIGNIFICANT};
use super::super::library::line_of_sight;
use super::super::moment::Moment;
use super::super::session::Session;
use super::{by_pair, moves};

/// Noise that grows with the distance.
#[derive(Debug, Clone, PartialEq)]
pub struct RangeNoise {
    /// The instrument class.
    pub instrument: usize,
    /// The noise goes with this power of the range.
    pub exponent: f64,
    /// Twice the logarithm of the likelihood of as many independent readings, against noise that is the same at all distances.
    pub evidence: f64,
}

/// Powers of the range that are tried, in steps of a tenth.
const TENTHS: core::ops::RangeInclusive<u8> = 2..=40;

/// Readings before that one is compared with: [`OVERLAP`] is of three.
const BEFORE: usize = 3;
/// How much more the sum of squares of differences from the mean of three readings before varies than that of independent normal
/// readings, as their squares correlate (Hall, Kay, Titterington 1990), and by how much more for each unit of dispersion beyond 1.
const OVERLAP: [f64; 2] = [43.0 / 36.0, 12.0 / 7.0];

/// What differs between repeats, by the distance.
#[must_use]
pub fn range_noise(session: &Session, residuals: &[f64]) -> Option<RangeNoise> {
    (0..session.instruments.len())
        .filter_map(|class| {
            let of = |m: &Moment| (m.range_mm > 0.0).then_some(m.range_mm);
            let (exponent, evidence) = by_range(&apart(session, residuals, class, of)?)?;
            Some(RangeNoise { instrument: class, exponent, evidence })
        })
        .max_by(|a, b| a.evidence.total_cmp(&b.evidence))
}

/// Power of the range and its evidence.
fn by_range(rows: &[Apart]) -> Option<(f64, f64)> {
    let scatter = Scatter::of(rows)?;
    let middle = rows.iter().map(|r| r.of.ln()).sum::<f64>() / rows.len() as f64;
    let shape = |exponent: f64| move |k: usize| (2.0 * exponent * (rows[k].of.ln() - middle)).exp();
    scatter.likeliest(TENTHS.map(|tenths| 0.1 * f64::from(tenths)), shape)
}

/// Run, repeat and the direction in which it looks.
type Pass = (usize, i64, usize);

/// A reading at rest whose residual is known.
struct Single {
    pass: Pass,
    residual: f64,
    /// What was asked.
    of: f64,
    /// Share of it that is independent of its repeats.
    independent: f64,
}

/// A reading beside those before it in its pass that look the same way.
struct Apart {
    /// Square of its residual's difference from the mean of theirs, of the size of the noise: a drift is no noise.
    square: f64,
    /// What was asked, each reading by its share in the square.
    of: f64,
    /// The direction in which they look.
    axis: usize,
    /// Share of it that is independent of its repeats.
    independent: f64,
}

/// Readings of one class at rest whose residuals are known, beside those before; `of` is asked of each, `None` leaves a reading out.
/// What shakes a moving axis is no noise of the instrument. None where they are too few.
fn apart(
    session: &Session,
    residuals: &[f64],
    class: usize,
    of: impl Fn(&Moment) -> Option<f64>,
) -> Option<Vec<Apart>> {
    let known: Vec<bool> = residuals.iter().map(|r| r.is_finite()).collect();
    let pairs = by_pair(session, &known);
    let of_class = |i: &usize| known[*i] && session.readings[*i].instrument == class;
    let readings = (0..residuals.len()).filter(of_class).filter_map(|i| {
        let (r, m) = (&session.readings[i], &session.moments[i]);
        let single = Single {
            pass: (r.run, r.repeat, m.u.iamax()),
            residual: residuals[i],
            of: of(m)?,
            independent: 1.0 - 1.0 / pairs[r.pair?].len() as f64,
        };
        (!moves(m)).then_some(single)
    });
    let all = beside_before(readings);
    (all.len() >= 5 * FEW).then_some(all)
}

/// Each reading beside up to three before it.
fn beside_before(readings: impl Iterator<Item = Single>) -> Vec<Apart> {
    let mut before: BTreeMap<Pass, VecDeque<[f64; 2]>> = BTreeMap::new();
    let mut all = Vec::new();
    for Single { pass, residual, of, independent } in readings {
        let before = before.entry(pass).or_default();
        let n = before.len() as f64;
        if !before.is_empty() {
            let [mean, other] = before.iter().fold([0.0; 2], |[s, o], b| [s + b[0] / n, o + b[1] / n]);
            let square = (residual - mean).powi(2) / (1.0 + 1.0 / n);
            all.push(Apart { square, of: (of + other / n) / (1.0 + 1.0 / n), axis: pass.2, independent });
        }
        before.push_back([residual, of]);
        if before.len() > BEFORE {
            before.pop_front();
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
    /// Twice the logarithm of the likelihood of as many independent readings, against noise that is the same in all directions.
    pub evidence: f64,
}

/// Least square of a distance across as a share of the largest, in one direction, from which an instrument saw one place only.
const ELSEWHERE: f64 = 0.8;

/// What differs between repeats, by the angle to the line of sight and the distance.
#[must_use]
pub fn angle_noise(session: &Session, residuals: &[f64]) -> Option<AngleNoise> {
    (0..session.instruments.len())
        .filter_map(|class| {
            let rows = apart(session, residuals, class, across_m2)?;
            let (um_per_m, evidence) = is_elsewhere(&rows).then(|| by_angle(&rows))??;
            Some(AngleNoise { instrument: class, um_per_m, evidence })
        })
        .max_by(|a, b| a.evidence.total_cmp(&b.evidence))
}

/// False where the distance across hardly changes in any direction: at one place a vibration along the direction of an axis
/// looks the same.
fn is_elsewhere(rows: &[Apart]) -> bool {
    (0..3).any(|axis| {
        let of = rows.iter().filter(|r| r.axis == axis).map(|r| r.of);
        let (low, high) = of.fold((f64::INFINITY, 0.0f64), |(l, h), q| (l.min(q), h.max(q)));
        low < ELSEWHERE * high
    })
}

/// Square of the distance, times the share of the direction that lies across the line of sight.
fn across_m2(m: &Moment) -> Option<f64> {
    let beam = line_of_sight(m)?;
    let share = (1.0 - m.u.dot(&beam).powi(2)).max(0.0);
    (m.range_mm > 0.0).then(|| share * (1e-3 * m.range_mm).powi(2))
}

/// Noise per distance and its evidence, of squares of distances across.
fn by_angle(rows: &[Apart]) -> Option<(f64, f64)> {
    let scatter = Scatter::of(rows)?;
    let far = rows.iter().map(|r| r.of).sum::<f64>() / rows.len() as f64;
    if far <= 0.0 {
        return None;
    }
    // variance = size times (1 - share + share q / mean of q)
    let shape = |share: f64| move |k: usize| 1.0 - share + share * rows[k].of / far;
    let (share, evidence) = scatter.likeliest((1..=50).map(|k| f64::from(k) / 50.0 * 0.999), shape)?;
    (share >= HALF).then(|| ((scatter.mean * share / far).sqrt(), evidence))
}

/// Squares of residuals whose variance may have a shape.
struct Scatter<'a> {
    /// Squares, clipped.
    squares: Vec<f64>,
    rows: &'a [Apart],
    /// Their mean before that.
    mean: f64,
}

impl<'a> Scatter<'a> {
    fn of(rows: &'a [Apart]) -> Option<Self> {
        let mean = rows.iter().map(|r| r.square).sum::<f64>() / rows.len() as f64;
        let most = SIGNIFICANT * SIGNIFICANT * mean;
        let squares = rows.iter().map(|r| r.square.min(most)).collect();
        (mean > 0.0).then_some(Self { squares, rows, mean })
    }

    /// The value whose shape is the likeliest, and its evidence.
    fn likeliest<S: Fn(usize) -> f64>(
        &self,
        values: impl Iterator<Item = f64>,
        shape: impl Fn(f64) -> S,
    ) -> Option<(f64, f64)> {
        let (value, best) =
            values.map(|value| (value, self.likelihood(&shape(value)))).max_by(|a, b| a.1.total_cmp(&b.1))?;
        Some((value, self.evidence(best, &shape(value))?))
    }

    /// Mean square where the variance has a shape.
    fn size(&self, shape: &dyn Fn(usize) -> f64) -> f64 {
        self.squares.iter().enumerate().map(|(k, s)| s / shape(k)).sum::<f64>() / self.squares.len() as f64
    }

    /// Logarithm of the likelihood where the variance has a shape.
    fn likelihood(&self, shape: &dyn Fn(usize) -> f64) -> f64 {
        let n = self.squares.len();
        let size = self.size(shape).max(1e-300);
        -0.5 * (n as f64 * size.ln() + (0..n).map(|k| shape(k).ln()).sum::<f64>())
    }

    /// What a shape of this likelihood says against an even scatter, by quasi-likelihood: of what is independent, and less where
    /// the noise has heavy tails, whose squares vary more than twice the square of their mean (McCullagh, Nelder 1989, 9.2).
    /// None where the directions explain it.
    fn evidence(&self, likelihood: f64, shape: &dyn Fn(usize) -> f64) -> Option<f64> {
        let gain = likelihood - self.likelihood(&|_| 1.0);
        let own: [f64; 3] = core::array::from_fn(|axis| {
            let of_axis = self.squares.iter().zip(self.rows).filter(|(_, r)| r.axis == axis);
            let (sum, n) = of_axis.fold((0.0, 0usize), |(sum, n), (s, _)| (sum + s, n + 1));
            (sum / n.max(1) as f64).max(1e-9 * self.mean)
        });
        let is_a_direction = self.likelihood(&|k| own[self.rows[k].axis]) - likelihood > HALF * gain;
        let (n, size) = (self.rows.len() as f64, self.size(shape));
        let square = |(k, s): (usize, &f64)| (s / (size * shape(k)) - 1.0).powi(2);
        let dispersion = (HALF * self.squares.iter().enumerate().map(square).sum::<f64>() / n).max(1.0);
        let independent = self.rows.iter().map(|r| r.independent).sum::<f64>() / n;
        let inflation = OVERLAP[0] + OVERLAP[1] * (dispersion - 1.0);
        (!is_a_direction).then(|| 2.0 * gain * independent / inflation)
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::constants::STRONG;
    use super::super::Random;
    use super::{Apart, OVERLAP, Single, beside_before, by_angle, by_range, is_elsewhere};

    /// Readings along three axes at three distances from a station; noise of the angles per metre, of the length, of one axis.
    fn readings(angles: f64, length: f64, one_axis: f64) -> Vec<Apart> {
        let mut random = Random::new(3);
        let across = [0.3, 0.7, 0.98];
        (0..600)
            .map(|i| {
                let (axis, range_m) = (i % 3, 1.8 + 0.2 * f64::from((i / 3) as u32 % 3));
                let of = across[axis] * range_m * range_m;
                let own = if axis == 2 { one_axis } else { 0.0 };
                let std = (angles * angles * of + length * length + own * own).sqrt();
                Apart { square: (std * random.normal()).powi(2), of, axis, independent: 1.0 }
            })
            .collect()
    }

    /// Two passes over a line away from the instrument, along two axes, whose repeats were compared; `noise` of each reading by its
    /// range in m.
    fn passes(noise: &mut impl FnMut(f64) -> f64) -> Vec<Apart> {
        let points = 120;
        let differences: Vec<f64> = (0..points)
            .map(|i| {
                let range_m = range_m(i);
                noise(range_m) - noise(range_m)
            })
            .collect();
        let single = |(repeat, i): (i64, usize)| Single {
            pass: (0, repeat, i % 2),
            residual: (0.5 - repeat as f64) * differences[i] * 2f64.sqrt(),
            of: range_m(i),
            independent: 0.5,
        };
        beside_before((0..2).flat_map(|repeat| (0..points).map(move |i| (repeat, i))).map(single))
    }

    fn range_m(i: usize) -> f64 {
        0.7 + 1.3 * (i / 2) as f64 / 60.0
    }

    #[test]
    fn differences_are_as_large_as_the_noise_and_overlap_as_stated() {
        let mut random = Random::new(7);
        let noise: Vec<f64> = (0..40_000).map(|_| random.normal()).collect();
        let single = |(i, residual): (usize, f64)| Single {
            pass: (i / 4000, 1, 0),
            residual,
            of: 1.0,
            independent: 1.0,
        };
        let squares: Vec<f64> =
            beside_before(noise.into_iter().enumerate().map(single)).iter().map(|r| r.square - 1.0).collect();
        let lagged = |lag: usize| squares.iter().zip(&squares[lag..]).map(|(a, b)| a * b).sum::<f64>();
        assert!(squares.iter().sum::<f64>().abs() < 0.03 * squares.len() as f64);
        let inflation = 1.0 + 2.0 * (1..=3).map(lagged).sum::<f64>() / lagged(0);
        assert!((inflation - OVERLAP[0]).abs() < 0.05, "{inflation}");
    }

    #[test]
    fn noise_of_angles_is_found_with_its_size() {
        let (um_per_m, evidence) = by_angle(&readings(5.0, 1.0, 0.0)).unwrap();
        assert!((um_per_m - 5.0).abs() < 0.5 && evidence > 30.0, "{um_per_m} {evidence}");
    }

    #[test]
    fn an_instrument_that_looks_at_one_place_shows_no_angles() {
        let across = [0.02, 0.9, 1.0];
        let here = |i: usize| Apart { square: 1.0, of: across[i % 3], axis: i % 3, independent: 1.0 };
        assert!(!is_elsewhere(&(0..90).map(here).collect::<Vec<_>>()));
        assert!(is_elsewhere(&readings(5.0, 1.0, 0.0)));
    }

    #[test]
    fn noise_that_grows_with_the_range_is_found_with_its_power() {
        let mut random = Random::new(5);
        let (exponent, evidence) = by_range(&passes(&mut |r| 2.0 * r.powi(2) * random.normal())).unwrap();
        assert!((exponent - 2.0).abs() < 0.5 && evidence > 2.0 * STRONG, "{exponent} {evidence}");
    }

    #[test]
    fn chance_is_no_noise_that_grows_with_the_range() {
        let mut random = Random::new(11);
        let mut alarms = |heavy: bool| {
            let mut noise = |_: f64| {
                // Student's t of four degrees of freedom
                let squares = (0..4).map(|_| random.normal().powi(2)).sum::<f64>();
                random.normal() / if heavy { (squares / 4.0).sqrt() } else { 1.0 }
            };
            (0..400).filter(|_| by_range(&passes(&mut noise)).is_some_and(|(_, e)| e > STRONG)).count()
        };
        let [normal, heavy] = [alarms(false), alarms(true)];
        // 0.2 % of one-sided tests of one degree of freedom
        assert!(normal <= 4 && heavy <= 6, "{normal} and {heavy} of 400");
    }

    #[test]
    fn noise_of_the_length_and_of_one_axis_is_none() {
        let even = by_angle(&readings(0.0, 2.0, 0.0));
        assert!(even.is_none_or(|(_, evidence)| evidence < STRONG), "{even:?}");
        assert_eq!(by_angle(&readings(0.0, 1.0, 4.0)), None);
    }
}
