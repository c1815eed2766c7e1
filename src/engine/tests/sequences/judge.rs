//! What an answer may be, written from the promises of `docs/explanation/safety.md` and not from the engine.

use super::super::*;
use volcomp_model::axes::AxisArray;

/// Good frames after which the control is known not to have acted on its own, and strays before them.
const IN_DOUBT: u32 = 20;
/// The most control time that one answer may use, s.
const LONGEST_S: f64 = 2.0 * CYCLE_S;
/// Rounding, relative and in mm.
const RELATIVE: f64 = 1e-9;
const ABSOLUTE: f64 = 1e-12;

/// Judges answers by the limits alone.
#[derive(Debug)]
pub(super) struct Judge {
    limits: Vec<AxisLimits>,
    last: Option<AxisArray>,
    /// Rates of change that each axis may have at present: more than one where the interval is not known exactly.
    rates: Vec<Vec<f64>>,
    in_doubt: u32,
    immobile: bool,
    state: State,
}

/// What came before an answer.
#[derive(Debug, Clone, Copy)]
pub(super) struct Circumstances<'a> {
    /// The frame that is answered; none where time alone has passed.
    pub(super) frame: Option<&'a Position>,
    /// Control time that may have been used, s.
    pub(super) intervals: &'a [f64],
}

impl Judge {
    pub(super) fn new(config: &EngineConfig) -> Self {
        let rates = vec![vec![0.0]; config.axes.len()];
        let limits = config.limits.clone();
        Self { limits, last: None, rates, in_doubt: 0, immobile: false, state: State::Off }
    }

    /// A new link: the control may hold anything.
    pub(super) fn link_up(&mut self) {
        self.last = None;
        self.in_doubt = IN_DOUBT;
    }

    /// Something was wrong with a frame, or one is missing: the control may have acted on its own.
    pub(super) fn doubt(&mut self) {
        self.in_doubt = IN_DOUBT;
    }

    /// Panics where an answer breaks a promise.
    pub(super) fn check(&mut self, out: &CycleOutput, seen: Circumstances<'_>) {
        let axes = self.limits.len();
        assert!(out.offset[..axes].iter().all(|v| v.is_finite()), "{:?}", out.offset);
        let first = self.last.is_none();
        let from = self.last.or(seen.frame.map(|f| f.applied)).unwrap_or(out.offset);
        let in_doubt = seen.frame.is_some_and(|frame| self.may_follow(frame));
        let mut rates = Vec::with_capacity(axes);
        for (k, from) in from.iter().enumerate().take(axes) {
            let before: &[f64] = if first { &[0.0] } else { &self.rates[k] };
            let followed = seen.frame.filter(|_| in_doubt).map(|frame| frame.applied[k]);
            let on = self.goes_on(k, *from, out.offset[k], before, seen.intervals);
            // both may fit, and then both count
            match (on, followed.is_some_and(|held| self.follows(k, *from, out.offset[k], held))) {
                (Ok(mut now), also) => {
                    now.extend(also.then_some(0.0));
                    rates.push(now);
                }
                (Err(_), true) => rates.push(vec![0.0]),
                (Err(why), false) => {
                    panic!("{:?} -> {:?} (interval {:?}):{why}", self.state, out, seen.intervals)
                }
            }
        }
        self.rates = rates;
        self.last = Some(out.offset);
        self.state = out.state;
        self.in_doubt = self.in_doubt.saturating_sub(1);
    }

    /// The rates at which an axis can have gone from one offset to the next.
    fn goes_on(
        &self,
        k: usize,
        from: f64,
        to: f64,
        before: &[f64],
        intervals: &[f64],
    ) -> Result<Vec<f64>, String> {
        let limits = &self.limits[k];
        let change = to - from;
        if limits.size <= 0.0 {
            return if change == 0.0 { Ok(vec![0.0]) } else { Err(format!(" axis {k} must not move")) };
        }
        if to.abs() > limits.size.max(from.abs()) + ABSOLUTE {
            return Err(format!(" axis {k} beyond its size: {to}"));
        }
        if change.abs() > limits.step * (1.0 + RELATIVE) + ABSOLUTE {
            return Err(format!(" axis {k} beyond its step: {change}"));
        }
        // a step at its own limit may need to slow down faster than the acceleration allows
        let at_step = change.abs() >= limits.step * (1.0 - RELATIVE);
        let mut now = Vec::new();
        for dt in intervals {
            if *dt <= 0.0 {
                if change == 0.0 {
                    now.extend_from_slice(before);
                }
                continue;
            }
            let rate = change / dt;
            let slack = ABSOLUTE / dt;
            let possible = rate.abs() <= limits.rate * (1.0 + RELATIVE) + slack;
            let reach = limits.acceleration * dt * (1.0 + RELATIVE) + slack;
            if possible && (at_step || before.iter().any(|v| (rate - v).abs() <= reach)) {
                now.push(rate);
            }
        }
        if now.is_empty() {
            return Err(format!(" axis {k} changes by {change} after {before:?} mm/s"));
        }
        // two intervals of nothing would double the list in every cycle
        now.sort_by(f64::total_cmp);
        now.dedup();
        Ok(now)
    }

    /// Whether an answer may go towards what the control holds: by one step, and not beyond it.
    fn follows(&self, k: usize, from: f64, to: f64, held: f64) -> bool {
        let limits = &self.limits[k];
        if limits.size <= 0.0 {
            return to == held;
        }
        let most = limits.step.min(limits.rate * LONGEST_S);
        (to - from).abs() <= most * (1.0 + RELATIVE) + ABSOLUTE
            && (to - from.min(held)) >= -ABSOLUTE
            && (to - from.max(held)) <= ABSOLUTE
    }

    /// Whether the control may have moved the offset by itself, or cannot move it.
    fn may_follow(&mut self, frame: &Position) -> bool {
        let bits = frame.state;
        let immobile = bits.has(MachineState::ESTOP) || !bits.has(MachineState::ENABLED);
        let was_immobile = core::mem::replace(&mut self.immobile, immobile);
        if !bits.is_ready() || bits.has(MachineState::OFFSET_RAMPING_OUT) {
            self.in_doubt = IN_DOUBT;
        }
        let reported = frame.applied.iter().all(|v| v.is_finite());
        reported && (self.in_doubt > 0 || immobile || was_immobile)
    }
}
