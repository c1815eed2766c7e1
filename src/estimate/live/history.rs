//! Where the machine stood: the last seconds of positions, for readings that come later than they were taken.

use std::collections::VecDeque;

use volcomp_model::axes::{AxisArray, MAX_AXES};
use volcomp_model::geometry::Vec3;
use volcomp_model::units::MonoTime;

/// How long positions are kept, s.
const KEPT_S: f64 = 4.0;
/// Positions further apart than this are not connected, s.
const GAP_S: f64 = 0.1;

/// Positions of the machine at one time: axes in chain order, mm and rad.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MotionSample {
    /// When, on the daemon's time line.
    pub at: MonoTime,
    /// Commanded.
    pub commanded: AxisArray,
    /// Where the encoders are, applied offsets included.
    pub actual: AxisArray,
    /// Tool tip in M at home, where the control has told it.
    pub tool_tip: Option<Vec3>,
}

/// The last seconds.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct MotionHistory {
    samples: VecDeque<MotionSample>,
}

impl MotionHistory {
    /// One more. The time line may be corrected by a little: what was newer gives way; by more, and all is void.
    pub fn push(&mut self, sample: MotionSample) {
        if self.samples.back().is_some_and(|last| last.at.seconds_since(sample.at) > GAP_S) {
            self.samples.clear();
        }
        while self.samples.back().is_some_and(|last| sample.at <= last.at) {
            self.samples.pop_back();
        }
        self.samples.push_back(sample);
        while self.samples.front().is_some_and(|first| sample.at.seconds_since(first.at) > KEPT_S) {
            self.samples.pop_front();
        }
    }

    /// The newest.
    #[must_use]
    pub fn newest(&self) -> Option<&MotionSample> {
        self.samples.back()
    }

    /// Everything is void.
    pub fn clear(&mut self) {
        self.samples.clear();
    }

    /// Where the machine stood at `at`, between two positions on a line; `None` where it is not known.
    #[must_use]
    pub fn at(&self, at: MonoTime) -> Option<MotionSample> {
        let after = self.samples.partition_point(|m| m.at < at);
        let Some(b) = self.samples.get(after) else {
            // a little ahead of the newest frame the machine is where it goes
            let (last, before) =
                (self.samples.back()?, self.samples.get(self.samples.len().checked_sub(2)?)?);
            return (at.seconds_since(last.at) < GAP_S).then(|| between(before, last, at));
        };
        let a = match after.checked_sub(1) {
            Some(k) => self.samples.get(k)?,
            None if b.at == at => return Some(*b),
            None => return None,
        };
        (b.at.seconds_since(a.at) < GAP_S).then(|| between(a, b, at))
    }
}

fn between(a: &MotionSample, b: &MotionSample, at: MonoTime) -> MotionSample {
    let share = at.seconds_since(a.at) / b.at.seconds_since(a.at);
    let mix = |x: &AxisArray, y: &AxisArray| -> AxisArray {
        let mut out = [0.0; MAX_AXES];
        for (k, out) in out.iter_mut().enumerate() {
            *out = x[k] + (y[k] - x[k]) * share;
        }
        out
    };
    MotionSample {
        at,
        commanded: mix(&a.commanded, &b.commanded),
        actual: mix(&a.actual, &b.actual),
        tool_tip: b.tool_tip,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample(ms: i64, x: f64) -> MotionSample {
        let mut commanded = [0.0; MAX_AXES];
        commanded[0] = x;
        MotionSample { at: MonoTime::from_ns(ms * 1_000_000), commanded, actual: commanded, tool_tip: None }
    }

    fn x_at(history: &MotionHistory, us: i64) -> Option<f64> {
        history.at(MonoTime::from_ns(us * 1000)).map(|m| m.commanded[0])
    }

    #[test]
    fn positions_are_found_between_frames_and_a_little_ahead() {
        let mut history = MotionHistory::default();
        assert_eq!(x_at(&history, 0), None);
        (0..6000).for_each(|ms| history.push(sample(ms, 0.1 * ms as f64)));
        assert!((x_at(&history, 5_000_500).unwrap() - 500.05).abs() < 1e-9);
        assert!((x_at(&history, 6_020_000).unwrap() - 602.0).abs() < 1e-9);
        assert_eq!(x_at(&history, 6_200_000), None, "nobody knows");
        assert_eq!(x_at(&history, 1_000_000), None, "forgotten");
        history.push(sample(6500, 7.0));
        assert_eq!(x_at(&history, 6_200_000), None, "not connected");
        assert_eq!(x_at(&history, 6_500_000), None, "no speed there");
        history.push(sample(100, 1.0));
        assert_eq!(history.newest().unwrap().commanded[0], 1.0);
        assert_eq!(x_at(&history, 5_000_500), None, "another time line");
    }
}
