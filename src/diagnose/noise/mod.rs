//! What is not the machine's systematic error: white noise and drift from repeats and from what is left, outliers,
//! rounding, vibration, noise that grows with the range.

mod classes;
mod filter;
mod line;
mod outliers;
mod path;
mod quantisation;
mod random;
mod range;
mod space;
mod vibration_spectrum;

use std::collections::BTreeMap;

use super::constants::{CREEP, SIGNIFICANT};
use super::moment::MachineState;
use super::session::Session;

pub use classes::{from_remainder, from_repeats, pair_residuals, repeats_tell};
pub use filter::{ClassNoise, Filter};
pub use outliers::{Tails, all_but, from_partners, off_the_fit, outliers, tails};
pub use quantisation::lattices;
pub use random::Random;
pub use range::{AngleNoise, RangeNoise, angle_noise, range_noise};
pub use space::{is_revisited, neighbours, spacing};
pub use vibration_spectrum::{Cycle, Tone, beside_repeats, cycle, tone};

/// Factor between the median of absolute deviations and the standard deviation of a normal distribution.
pub const MAD: f64 = 1.482_602_218_505_602;

/// How many of some readings each pair has, and the first of them.
fn repeats_of(session: &Session, rows: impl IntoIterator<Item = usize>) -> BTreeMap<usize, (usize, usize)> {
    let mut repeats: BTreeMap<usize, (usize, usize)> = BTreeMap::new();
    for i in rows {
        if let Some(pair) = session.readings[i].pair {
            repeats.entry(pair).or_insert((0, i)).0 += 1;
        }
    }
    repeats
}

/// The readings `used` of each pair, by its number.
fn by_pair(session: &Session, used: &[bool]) -> Vec<Vec<usize>> {
    let pairs = session.readings.iter().filter_map(|r| r.pair).max().map_or(0, |p| p + 1);
    let mut groups = vec![Vec::new(); pairs];
    for (i, r) in session.readings.iter().enumerate() {
        if let (Some(p), true) = (r.pair, used[i]) {
            groups[p].push(i);
        }
    }
    groups
}

/// True where an axis is known to move; unknown velocities are NaN.
fn moves(m: &MachineState) -> bool {
    m.velocity.iter().any(|v| v.abs() > CREEP)
}

/// The median; NaN of nothing.
#[must_use]
pub fn median(values: &mut [f64]) -> f64 {
    if values.is_empty() {
        return f64::NAN;
    }
    let n = values.len();
    let (_, upper, _) = values.select_nth_unstable_by(n / 2, f64::total_cmp);
    let upper = *upper;
    if n % 2 == 1 {
        return upper;
    }
    let lower = values[..n / 2].iter().copied().fold(f64::NEG_INFINITY, f64::max);
    0.5 * (lower + upper)
}

/// Standard deviation about zero that single outliers do not move: values are clipped.
#[must_use]
pub fn clipped_deviation(values: &[f64]) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    let mut sizes: Vec<f64> = values.iter().map(|v| v.abs()).collect();
    let robust = MAD * median(&mut sizes);
    let limit = if robust > 0.0 { SIGNIFICANT * robust } else { f64::INFINITY };
    let sum: f64 = values.iter().map(|v| v.abs().min(limit)).map(|v| v * v).sum();
    (sum / values.len() as f64).sqrt()
}
