//! Where the axes will be when a correction takes effect.
//!
//! A correction computed from frame n shows in the read-back of frame n + lag. The lag is measured: while the offsets
//! change, the read-back equals exactly one of the offsets sent before. The position is then extrapolated at the
//! present speed; at an acceleration a and a lag t this errs by `a t^2 / 2`, 2 um at 1 m/s^2 and 2 ms, which no error
//! curve notices.

use volcomp_model::axes::{AxisArray, MAX_AXES};

/// The longest lag that can be measured, in control cycles.
pub const LAG_CYCLES_MAX: usize = 32;
/// Agreeing read-backs in a row before a lag is believed.
const AGREEING: u32 = 16;
/// An offset is recognised where it is so many times closer than any other one sent.
const CLEARLY: f64 = 4.0;
/// Read-backs closer than this to an offset sent are that offset, mm or rad (conversion to degrees and back).
const SAME: f64 = 1e-10;

/// Cycles from a position to the effect of its correction.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Lag {
    /// From the read-back; until it is known, one cycle.
    #[default]
    Measured,
    /// Given, in control cycles.
    Cycles(f64),
}

/// Measures the lag from the offsets sent and read back. mm and rad.
#[derive(Debug, Clone)]
pub(super) struct LagMeter {
    configured: Lag,
    axes: usize,
    /// Newest at `next - 1`.
    sent: [(u32, AxisArray); LAG_CYCLES_MAX + 1],
    next: usize,
    filled: usize,
    candidate: u32,
    agreeing: u32,
    measured: Option<u32>,
}

impl LagMeter {
    pub(super) const fn new(configured: Lag, axes: usize) -> Self {
        Self {
            configured,
            axes,
            sent: [(0, [0.0; MAX_AXES]); LAG_CYCLES_MAX + 1],
            next: 0,
            filled: 0,
            candidate: 0,
            agreeing: 0,
            measured: None,
        }
    }

    /// A new link: another control may lag differently.
    pub(super) const fn restart(&mut self) {
        // offsets of the old link must not be taken for those of this one
        self.next = 0;
        self.filled = 0;
        self.agreeing = 0;
        self.measured = None;
    }

    /// The lag in use, in control cycles.
    pub(super) fn cycles(&self) -> f64 {
        match (self.configured, self.measured) {
            (Lag::Cycles(cycles), _) => cycles,
            (Lag::Measured, Some(cycles)) => f64::from(cycles),
            (Lag::Measured, None) => 1.0,
        }
    }

    /// The lag measured on this link, in control cycles.
    pub(super) const fn measured(&self) -> Option<u32> {
        self.measured
    }

    /// Goes on with a lag that was measured elsewhere.
    pub(super) const fn assume(&mut self, measured: Option<u32>) {
        self.measured = measured;
        self.agreeing = 0;
    }

    /// The offset that answers frame `sequence`.
    pub(super) fn sent(&mut self, sequence: u32, offset: &AxisArray) {
        self.sent[self.next] = (sequence, *offset);
        self.next = (self.next + 1) % self.sent.len();
        self.filled = (self.filled + 1).min(self.sent.len());
    }

    /// The offset that frame `sequence` reports as applied.
    pub(super) fn read_back(&mut self, sequence: u32, applied: &AxisArray) {
        if let Some(lag) = self.measured.filter(|lag| self.is_as_sent(sequence, *lag, applied)) {
            // the ordinary case costs one comparison; what spoke for another lag was no row
            if self.candidate != lag {
                (self.candidate, self.agreeing) = (lag, 0);
            }
            return;
        }
        let Some(lag) = self.recognise(sequence, applied) else { return };
        if lag == self.candidate {
            self.agreeing += 1;
        } else {
            (self.candidate, self.agreeing) = (lag, 1);
        }
        if self.agreeing >= AGREEING {
            self.measured = Some(lag);
        }
    }

    /// True where frame `sequence` reports exactly what was sent `lag` cycles before, and no answer is missing since.
    fn is_as_sent(&self, sequence: u32, lag: u32, applied: &AxisArray) -> bool {
        let back = lag as usize;
        if back == 0 || back > self.filled {
            return false;
        }
        let (of, offset) = &self.sent[(self.next + self.sent.len() - back) % self.sent.len()];
        sequence.wrapping_sub(*of) == lag && (0..self.axes).all(|k| (offset[k] - applied[k]).abs() <= SAME)
    }

    /// The lag of the one offset sent that is clearly closest; `None` where several look alike.
    fn recognise(&self, sequence: u32, applied: &AxisArray) -> Option<u32> {
        let mut best: Option<(f64, u32)> = None;
        let mut second = f64::INFINITY;
        for (of, offset) in &self.sent[..self.filled] {
            let lag = sequence.wrapping_sub(*of);
            if lag == 0 || lag as usize > LAG_CYCLES_MAX {
                continue;
            }
            let apart = (0..self.axes).map(|k| (offset[k] - applied[k]).abs()).fold(0.0, f64::max);
            match best {
                Some((least, _)) if apart >= least => second = second.min(apart),
                _ => {
                    second = best.map_or(f64::INFINITY, |(least, _)| least);
                    best = Some((apart, lag));
                }
            }
        }
        let (least, lag) = best?;
        (second > CLEARLY * least.max(SAME) && second.is_finite()).then_some(lag)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Offsets that change all the time, applied `lag` cycles later with steps of `step` mm.
    fn measure(lag: u32, step: f64, lost: u32) -> Option<u32> {
        let mut meter = LagMeter::new(Lag::Measured, 3);
        let offset = |n: u32| -> AxisArray {
            let mut o = [0.0; MAX_AXES];
            o[0] = (f64::from(n) * 1e-3).sin() * 0.02;
            o
        };
        for n in 0..200u32 {
            if lost > 0 && n % lost == 0 {
                continue;
            }
            let mut applied = offset(n.saturating_sub(lag));
            if step > 0.0 {
                applied[0] = (applied[0] / step).round() * step;
            }
            meter.read_back(n, &applied);
            meter.sent(n, &offset(n));
        }
        meter.measured()
    }

    #[test]
    fn the_lag_is_found_exactly() {
        for lag in 1..=12 {
            assert_eq!(measure(lag, 0.0, 0), Some(lag));
        }
    }

    #[test]
    fn a_coarse_read_back_is_recognised_where_it_can_be() {
        // 20 um per s at 1 ms: offsets differ by 20 nm; a read-back in steps of 1 nm still tells them apart
        assert_eq!(measure(3, 1e-6, 0), Some(3));
        // in steps of 1 um it does not, and nothing is claimed
        assert_eq!(measure(3, 1e-3, 0), None);
    }

    #[test]
    fn frames_that_are_lost_do_not_mislead() {
        // a lost frame has no offset of its own: the control keeps the one before, which looks one cycle older
        assert_eq!(measure(2, 0.0, 10), Some(2));
    }

    #[test]
    fn a_new_link_is_measured_as_soon_as_the_first_and_by_its_own_offsets_only() {
        let mut meter = LagMeter::new(Lag::Measured, 3);
        let mut known = [None; 2];
        for (link, known) in known.iter_mut().enumerate() {
            meter.restart();
            let offset = |n: u32| [(f64::from(n) * 0.3).sin(); MAX_AXES];
            // both links count from 0; the second one lags by two cycles more
            let lag = 1 + 2 * link as u32;
            // so many cycles that the ring stands in its middle
            for n in 0..50 {
                meter.read_back(n, &offset(n.saturating_sub(lag)));
                meter.sent(n, &offset(n));
                if known.is_none() && meter.measured().is_some() {
                    *known = meter.measured().map(|lag| (lag, n));
                }
            }
        }
        let [Some((1, first)), Some((3, second))] = known else { panic!("{known:?}") };
        assert!(second <= first + 2, "after {first} cycles, then after {second}");
    }

    #[test]
    fn a_lag_that_changes_on_a_link_is_measured_anew() {
        let mut meter = LagMeter::new(Lag::Measured, 3);
        let offset = |n: u32| [(f64::from(n) * 0.3).sin(); MAX_AXES];
        for n in 0..200 {
            let lag = if n < 100 { 2 } else { 5 };
            meter.read_back(n, &offset(n.saturating_sub(lag)));
            meter.sent(n, &offset(n));
            match n {
                25..100 => assert_eq!(meter.measured(), Some(2), "cycle {n}"),
                116.. => assert_eq!(meter.measured(), Some(5), "cycle {n}"),
                _ => {}
            }
        }
    }

    #[test]
    fn standstill_tells_nothing() {
        let mut meter = LagMeter::new(Lag::Measured, 3);
        for n in 0..100 {
            meter.read_back(n, &[0.01; MAX_AXES]);
            meter.sent(n, &[0.01; MAX_AXES]);
        }
        assert_eq!(meter.measured(), None);
        assert_eq!(meter.cycles(), 1.0);
    }
}
