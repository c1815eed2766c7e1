//! How much smaller a deviation is after compensation, with the uncertainty that the scatter of the readings leaves.
//!
//! Readings at one place (target and direction, or sector of a circle) are averaged. Figures are the range of the means and
//! their RMS. The variance of a mean is the pooled variance of the readings at one place over their number, or, where
//! these follow each other within one run and so are autocorrelated, that of a single reading; of a range it is that of its two ends.
//! What the noise of the means adds to a range or an RMS, however small the deviation itself is, is known and not taken off: it is one
//! more contribution. `reduction = 1 - after / before`, its variance by first-order propagation.
//!
//! An error of the instrument is added by [`Size::with_device`] as independent in either measurement; one that is the same
//! in both changes the reduction by less.
//!
//! Source: GUM (JCGM 100:2008), 5.1.2; kinds of contributions as in ISO/TR 230-9:2005.

use std::collections::BTreeMap;
use volcomp_model::random::SplitMix64;
use volcomp_model::statistics::hull;
use volcomp_units::axes::Travel;

/// Simulated ranges at most, and values of all of them.
const DRAWS: usize = 400;
const VALUES: usize = 400_000;
const SEED: u64 = 2309;

/// One reading.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placed {
    /// Curve that it belongs to (diagonal, error motion); ranges and RMS are taken over all.
    pub curve: u32,
    /// Place on the curve: readings of one place are repetitions.
    pub place: i64,
    /// The deviation.
    pub value: f64,
}

impl Placed {
    /// Targets are told apart to a thousandth of their unit.
    const PER_UNIT: f64 = 1e3;

    /// A reading at a target, each direction a place of its own.
    #[must_use]
    pub fn at_target(curve: u32, target: f64, travel: Travel, value: f64) -> Self {
        let reverse = i64::from(travel == Travel::Reverse);
        Self { curve, place: 2 * (target * Self::PER_UNIT).round() as i64 + reverse, value }
    }

    /// The target of [`at_target`](Self::at_target).
    #[must_use]
    pub fn target(&self) -> f64 {
        self.place.div_euclid(2) as f64 / Self::PER_UNIT
    }
}

/// A figure with its standard uncertainty (k = 1); none where no place has two readings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Uncertain {
    /// The value.
    pub value: f64,
    /// Standard uncertainty.
    pub std: Option<f64>,
}

/// Figures of one measurement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Size {
    /// Range of the means over all curves.
    pub range: Uncertain,
    /// RMS of the means.
    pub rms: Uncertain,
    /// Smallest mean.
    pub low: f64,
    /// Largest mean.
    pub high: f64,
}

/// The standard uncertainty (k = 1) of the instrument, and what it is stated for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Device {
    /// A distance over the measured length.
    Distance(f64),
    /// A single reading; those of two places are independent.
    Reading(f64),
}

/// What is gone of a figure.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reduction {
    /// `1 - after / before`.
    pub fraction: f64,
    /// Standard uncertainty (k = 1), where both figures have one.
    pub std: Option<f64>,
}

impl Size {
    /// The figures of a measurement; `None` without readings. `repeated` readings at one place are of different runs.
    #[must_use]
    pub fn of(readings: &[Placed], repeated: bool) -> Option<Self> {
        let mut places: BTreeMap<(u32, i64), (f64, f64)> = BTreeMap::new();
        for r in readings.iter().filter(|r| r.value.is_finite()) {
            let (n, sum) = places.entry((r.curve, r.place)).or_default();
            *n += 1.0;
            *sum += r.value;
        }
        let mean = |r: &Placed| places.get(&(r.curve, r.place)).map(|(n, sum)| sum / n);
        let squares: f64 = readings
            .iter()
            .filter_map(|r| Some((r.value - mean(r)?).powi(2)))
            .filter(|v| v.is_finite())
            .sum();
        let count: f64 = places.values().map(|(n, _)| n).sum();
        let free = count - places.len() as f64;
        let variance = (free > 0.0).then(|| squares / free);
        let means = || places.values().map(|(n, sum)| (sum / n, *n));
        let weight = |n: f64| if repeated { n } else { 1.0 };
        let (high, n_high) = means().max_by(|a, b| a.0.total_cmp(&b.0))?;
        let (low, n_low) = means().min_by(|a, b| a.0.total_cmp(&b.0))?;
        let total = places.len() as f64;
        let rms = (means().map(|(m, _)| m * m).sum::<f64>() / total).sqrt();
        let rms_variance = |v: f64| {
            let sum: f64 = means().map(|(m, n)| m * m * v / weight(n)).sum();
            let of_mean = v * means().map(|(_, n)| 1.0 / weight(n)).sum::<f64>() / total;
            let bias = rms - (rms * rms - at_most(of_mean, total)).max(0.0).sqrt();
            if rms > 0.0 { sum / (total * rms).powi(2) + bias * bias } else { 0.0 }
        };
        let of_means = |v: f64| means().map(|(m, n)| (m, (v / weight(n)).sqrt())).collect::<Vec<_>>();
        Some(Self {
            range: Uncertain {
                value: high - low,
                std: variance
                    .map(|v| (v / weight(n_high) + v / weight(n_low)).sqrt().hypot(range_bias(&of_means(v)))),
            },
            rms: Uncertain { value: rms, std: variance.map(|v| rms_variance(v).sqrt()) },
            low,
            high,
        })
    }

    /// Adds the standard uncertainty (k = 1) of the instrument, in the unit of the figures. Stated for a distance, it
    /// enters the range once, as it does E of ISO 230-2; stated for a reading, a range compares two: `sqrt(2)` of it.
    #[must_use]
    pub fn with_device(self, device: Device) -> Self {
        let add = |u: Uncertain, std: f64| Uncertain { std: Some(u.std.unwrap_or(0.0).hypot(std)), ..u };
        let (in_range, in_rms) = match device {
            Device::Distance(std) => (std, std),
            Device::Reading(std) => (core::f64::consts::SQRT_2 * std, std),
        };
        Self { range: add(self.range, in_range), rms: add(self.rms, in_rms), ..self }
    }
}

/// The mean square of noise of this variance over `n` values, with twice its standard deviation.
fn at_most(variance: f64, n: f64) -> f64 {
    variance * (1.0 + 2.0 * (2.0 / n).sqrt())
}

/// What noise adds to a range: the mean of simulated ranges of means, shrunk towards their average by what their noise explains of
/// their scatter. Each mean with its standard deviation; the seed is fixed.
fn range_bias(means: &[(f64, f64)]) -> f64 {
    let n = means.len() as f64;
    if means.len() < 2 {
        return 0.0;
    }
    let average = means.iter().map(|m| m.0).sum::<f64>() / n;
    let scatter = means.iter().map(|m| (m.0 - average).powi(2)).sum::<f64>() / (n - 1.0);
    let of_noise = means.iter().map(|m| m.1 * m.1).sum::<f64>() / n;
    let shrunk =
        if scatter > 0.0 { (1.0 - at_most(of_noise, n - 1.0) / scatter).max(0.0).sqrt() } else { 0.0 };
    let range = |values: &mut dyn Iterator<Item = f64>| {
        let [low, high] = hull(values);
        high - low
    };
    let mut random = SplitMix64(SEED);
    let draws = (VALUES / means.len()).clamp(1, DRAWS);
    let mut simulated = || range(&mut means.iter().map(|(m, std)| shrunk * m + std * random.normal()));
    let mean = (0..draws).map(|_| simulated()).sum::<f64>() / draws as f64;
    (mean - range(&mut means.iter().map(|m| shrunk * m.0))).max(0.0)
}

impl Reduction {
    /// What is gone of a figure; `None` where there was nothing before.
    #[must_use]
    pub fn of(before: Uncertain, after: Uncertain) -> Option<Self> {
        if before.value <= 0.0 {
            return None;
        }
        let ratio = after.value / before.value;
        let std = before.std.zip(after.std).map(|(b, a)| (a / before.value).hypot(ratio * b / before.value));
        Some(Self { fraction: 1.0 - ratio, std })
    }
}

/// Takes the line through the mean readings at both ends out.
pub fn about_end_points(rows: &mut [(f64, Travel, f64)]) {
    let [low, high] = hull(rows.iter().map(|r| r.0));
    let mean = |q: f64| {
        let (n, sum) = rows.iter().filter(|r| r.0 == q).fold((0.0, 0.0), |(n, s), r| (n + 1.0, s + r.2));
        sum / n
    };
    if high > low {
        let (first, last) = (mean(low), mean(high));
        let slope = (last - first) / (high - low);
        rows.iter_mut().for_each(|r| r.2 -= first + slope * (r.0 - low));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    /// Normal noise of a counter: splitmix64, Box and Muller.
    fn noise(i: u32) -> f64 {
        let uniform = |k: u64| {
            let mut z = (2 * u64::from(i) + k).wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
            z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
        };
        (-2.0 * uniform(0).max(1e-12).ln()).sqrt() * (TAU * uniform(1)).cos()
    }

    fn test(size: f64, first: u32) -> Vec<Placed> {
        (0..21 * 10)
            .map(|i| {
                let place = i64::from(i % 21);
                let value = size * (place as f64 / 20.0 - 0.5) + noise(first + i);
                Placed { curve: 0, place, value }
            })
            .collect()
    }

    #[test]
    fn the_uncertainty_holds_the_error_of_the_instrument() {
        // each measurement has an error of the instrument of its own at each place, the same in all its runs
        let device = 2.0;
        let measured = |size: f64, k: u32| {
            let mut readings = test(size, 1000 * k);
            readings.iter_mut().for_each(|r| r.value += device * noise(900_000 + 40 * k + r.place as u32));
            Size::of(&readings, true).unwrap().with_device(Device::Reading(device))
        };
        let reductions: Vec<Reduction> = (0..400)
            .map(|k| {
                let [before, after] = [(100.0, 2 * k), (20.0, 2 * k + 1)].map(|(size, k)| measured(size, k));
                Reduction::of(before.range, after.range).unwrap()
            })
            .collect();
        let mean = reductions.iter().map(|r| r.fraction).sum::<f64>() / 400.0;
        let found = (reductions.iter().map(|r| (r.fraction - mean).powi(2)).sum::<f64>() / 399.0).sqrt();
        let stated = reductions.iter().filter_map(|r| r.std).sum::<f64>() / 400.0;
        assert!((0.7..1.6).contains(&(stated / found)), "stated {stated}, found {found}");
        let without = Size::of(&test(100.0, 0), true).unwrap();
        let of_reading = without.with_device(Device::Reading(device)).range.std;
        let of_distance = without.with_device(Device::Distance(device)).range.std;
        assert!(of_reading > of_distance && of_distance > without.range.std);
    }

    #[test]
    fn an_error_of_the_measured_length_enters_the_range_once() {
        let device = 2.0;
        let ranges: Vec<Uncertain> = (0..400)
            .map(|k| {
                let mut readings = test(100.0, 1000 * k);
                let of_length = device * noise(900_000 + k);
                readings.iter_mut().for_each(|r| r.value += of_length * r.place as f64 / 20.0);
                Size::of(&readings, true).unwrap().with_device(Device::Distance(device)).range
            })
            .collect();
        let mean = ranges.iter().map(|r| r.value).sum::<f64>() / 400.0;
        let found = (ranges.iter().map(|r| (r.value - mean).powi(2)).sum::<f64>() / 399.0).sqrt();
        let stated = ranges.iter().filter_map(|r| r.std).sum::<f64>() / 400.0;
        assert!((0.9..1.15).contains(&(stated / found)), "stated {stated}, found {found}");
    }

    #[test]
    fn the_uncertainty_is_that_of_repeated_tests() {
        let reductions: Vec<Reduction> = (0..400)
            .map(|k| {
                let [before, after] = [(100.0, 0), (20.0, 210)]
                    .map(|(size, shift)| Size::of(&test(size, 420 * k + shift), true).unwrap().range);
                Reduction::of(before, after).unwrap()
            })
            .collect();
        let n = reductions.len() as f64;
        let mean = reductions.iter().map(|r| r.fraction).sum::<f64>() / n;
        let scatter = (reductions.iter().map(|r| (r.fraction - mean).powi(2)).sum::<f64>() / n).sqrt();
        let stated = reductions.iter().map(|r| r.std.unwrap()).sum::<f64>() / n;
        assert!((mean - 0.8).abs() < 0.005, "{mean}");
        assert!((stated / scatter - 1.0).abs() < 0.25, "{stated} {scatter}");
    }

    #[test]
    fn the_interval_of_what_noise_alone_leaves_reaches_zero() {
        // ten repeats of noise of unit variance at 21 places: compensation without an error, and with one as large as the noise
        for (size, least) in [(0.0, 0.9), (2.0, 0.9)] {
            let truth: Vec<f64> = (0..21).map(|p| size * (f64::from(p) / 20.0 - 0.5)).collect();
            let rms = (truth.iter().map(|v| v * v).sum::<f64>() / 21.0).sqrt();
            let holds = |u: Uncertain, truth: f64| (u.value - truth).abs() <= 2.0 * u.std.unwrap();
            let all: Vec<Size> = (0..200).map(|k| Size::of(&test(size, 210 * k), true).unwrap()).collect();
            let share = |of: &dyn Fn(&Size) -> bool| all.iter().filter(|s| of(s)).count() as f64 / 200.0;
            let [of_range, of_rms] = [share(&|s| holds(s.range, size)), share(&|s| holds(s.rms, rms))];
            assert!(of_range >= least && of_rms >= least, "{size}: {of_range} {of_rms}");
        }
    }

    #[test]
    fn one_reading_at_each_place_states_no_uncertainty() {
        let one: Vec<Placed> = (0..5).map(|place| Placed { curve: 0, place, value: place as f64 }).collect();
        let size = Size::of(&one, true).unwrap();
        assert_eq!((size.range.value, size.range.std), (4.0, None));
        // far larger than the noise, to which its range owes nothing
        let run = test(1e4, 0);
        let [repeated, of_one_run] = [true, false].map(|r| Size::of(&run, r).unwrap().range.std.unwrap());
        assert!((of_one_run / repeated - 10f64.sqrt()).abs() < 0.02);
        assert!(Size::of(&[], true).is_none());
        let nothing = Uncertain { value: 0.0, std: None };
        assert!(Reduction::of(nothing, size.range).is_none());
    }

    #[test]
    fn a_straightness_loses_its_line_and_keeps_its_bow() {
        let mut rows: Vec<(f64, Travel, f64)> =
            (0..=10).map(f64::from).map(|q| (q, Travel::Forward, 3.0 + 2.0 * q + q * (10.0 - q))).collect();
        about_end_points(&mut rows);
        for (q, _, v) in rows {
            assert!((v - q * (10.0 - q)).abs() < 1e-12);
        }
    }
}
