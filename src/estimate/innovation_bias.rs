//! Test of the innovations of a sensor for a mean that persists.
//!
//! A filter that learns takes away what its readings have in common: what is left has no mean. A sensor whose axes are
//! exchanged or whose sign is wrong does not see the offset that is applied for what it said, or sees it in another
//! direction: what was learned makes the difference larger, the filter follows, and learns to believe more noise
//! meanwhile, so that no single reading is ever beyond the gate. Its innovations have a mean then that stays and grows.
//!
//! Windows of [`READINGS`] readings and at least [`SECONDS`]: one whose mean is beyond [`LIMIT`] standard deviations of the
//! the noise of the initialisation is suspicious, a second one on end that points the same way
//! contradicts. Noise that is correlated over a fifth of a second stays below that; a share [`PRIOR_SHARE`] of what the offline map
//! is uncertain by does no harm and is allowed on top. A machine that changes by as much at once, without going beyond
//! the gate, looks the same: it is reported instead of followed.

use super::sensor_initialisation::InnovationSample;
use volcomp_model::units::MonoTime;

/// Fewest readings of a window.
pub const READINGS: u32 = 25;
/// Shortest window, s.
pub const SECONDS: f64 = 0.5;
/// Largest mean of an innovation over a window, in standard deviations of the noise of one reading.
pub const LIMIT: f64 = 3.0;
/// Share of the offline map's standard deviation below which a mean does not matter.
pub const PRIOR_SHARE: f64 = 0.25;

/// What a reading has ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Window {
    /// No window.
    Open,
    /// One without a mean to speak of.
    Quiet,
    /// One with a mean.
    Suspicious,
    /// The second one with the same.
    Contradicts,
}

/// Watches the innovations of one sensor.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct InnovationBias {
    began: Option<MonoTime>,
    readings: u32,
    /// Per row: sum of innovations, sum of squared limits.
    sums: Vec<[f64; 2]>,
    /// Per row: where the last window pointed, -1, 0, 1.
    pointed: Vec<i8>,
}

impl InnovationBias {
    /// A reading that was used, row by row in units of its present noise; `noise` is the variance of lengths and of
    /// angles as initialised, in the same units.
    pub fn add(&mut self, now: MonoTime, rows: &[InnovationSample], noise: [f64; 2]) -> Window {
        if rows.len() != self.sums.len() {
            *self =
                Self { sums: vec![[0.0; 2]; rows.len()], pointed: vec![0; rows.len()], ..Self::default() };
        }
        let began = *self.began.get_or_insert(now);
        self.readings += 1;
        for (sum, row) in self.sums.iter_mut().zip(rows) {
            sum[0] += row.innovation;
            sum[1] += LIMIT * LIMIT * noise[row.kind.index()] + PRIOR_SHARE * PRIOR_SHARE * row.prior;
        }
        if self.readings < READINGS || now.seconds_since(began) < SECONDS {
            return Window::Open;
        }
        let n = f64::from(self.readings);
        let mut found = Window::Quiet;
        for ([sum, limit], pointed) in self.sums.iter().zip(&mut self.pointed) {
            let mean = sum / n;
            let beyond = mean * mean > limit / n;
            let points = i8::from(beyond && mean > 0.0) - i8::from(beyond && mean < 0.0);
            if points != 0 && points == *pointed {
                found = Window::Contradicts;
            } else if points != 0 && found == Window::Quiet {
                found = Window::Suspicious;
            }
            *pointed = points;
        }
        (self.began, self.readings) = (None, 0);
        self.sums.fill([0.0; 2]);
        found
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    use super::*;
    use crate::Kind;

    /// Windows of a sensor with noise of one standard deviation and this mean at each reading; 100 readings a second.
    fn watch(readings: i64, memory: f64, mean: impl Fn(i64) -> f64) -> Vec<Window> {
        let mut random = ChaCha8Rng::seed_from_u64(5);
        let (mut it, mut slow) = (InnovationBias::default(), 0.0);
        (0..readings)
            .map(|k| {
                let fresh: f64 = StandardNormal.sample(&mut random);
                slow = memory * slow + (1.0 - memory * memory).sqrt() * fresh;
                let row = |innovation: f64, kind| InnovationSample {
                    innovation,
                    uncertainty: 0.1,
                    prior: 4.0,
                    kind,
                };
                let rows = [row(mean(k) + slow, Kind::Length), row(0.0, Kind::Angle)];
                it.add(MonoTime::from_ns(k * 10_000_000), &rows, [1.0; 2])
            })
            .filter(|window| *window != Window::Open)
            .collect()
    }

    #[test]
    fn noise_is_quiet_even_where_it_is_slow() {
        for memory in [0.0, 0.9, 0.95] {
            let windows = watch(100_000, memory, |_| 0.0);
            assert!(windows.len() > 1900 && !windows.contains(&Window::Contradicts), "{memory}");
        }
    }

    #[test]
    fn a_mean_that_stays_contradicts_at_the_second_window_and_one_that_swings_never() {
        let windows = watch(1000, 0.0, |k| if k > 500 { 5.0 } else { 0.0 });
        let first = windows.iter().position(|w| *w == Window::Suspicious).unwrap();
        assert!(windows[..first].iter().all(|w| *w == Window::Quiet));
        assert_eq!(windows[first + 1], Window::Contradicts);
        let swings = watch(5000, 0.0, |k| if k / 60 % 2 == 0 { 5.0 } else { -5.0 });
        assert!(!swings.contains(&Window::Contradicts), "{swings:?}");
        let small = watch(5000, 0.0, |_| 1.0);
        assert!(small.iter().all(|w| *w == Window::Quiet));
    }
}
