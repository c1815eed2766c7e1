//! What the control does with corrections: delay, own limits, watchdog on the daemon.
//!
//! The rules are those of section 7 of `docs/protocol.md`; the offset is never stepped. Beyond them the rate of change is
//! itself bounded (acceleration), so that holding, taking back and coming back are smooth. All values are mm or deg.

use std::collections::VecDeque;

use volcomp_protocol::Correction;
use volcomp_units::axes::AxisArray;

use super::config::{OffsetConfig, OffsetLimits};
use crate::motion::MachineAxes;

/// What became of a correction.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Verdict {
    /// It is the target from its cycle on.
    Good,
    /// A value is not finite.
    NotFinite,
    /// It answers a position that was never sent, or one from before the hold time.
    WrongAge,
    /// It answers an older position than the one before it.
    OutOfOrder,
}

/// Offsets of one cycle.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Applied {
    /// The offset in force.
    pub(super) offset: AxisArray,
    /// The control holds something back.
    pub(super) limited: bool,
    /// The control takes the offset back by itself.
    pub(super) ramping_out: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Mode {
    /// Corrections come, or none ever came.
    Following,
    /// The daemon left in order: the offset stays.
    Kept,
    /// None came for longer than the hold time.
    RampingOut,
}

#[derive(Debug, Clone, Copy)]
struct AxisStage {
    follow: OffsetLimits,
    ramp: OffsetLimits,
    /// Lowest and highest commanded position plus offset.
    reach: [f64; 2],
    offset: f64,
    rate: f64,
    target: f64,
    target_rate: f64,
}

/// From corrections to the offset in force, cycle by cycle.
#[derive(Debug, Clone)]
pub(super) struct OffsetStage {
    axes: Vec<AxisStage>,
    dt_s: f64,
    delay_cycles: u64,
    hold_cycles: u64,
    waiting: VecDeque<(u64, AxisArray)>,
    mode: Mode,
    last_good: Option<u64>,
    last_answered: Option<u32>,
}

impl OffsetStage {
    /// Offsets of a machine at rest: zero.
    #[must_use]
    pub(super) fn new(config: &OffsetConfig, axes: &MachineAxes, cycle_s: f64) -> Self {
        let stage = |axis: &crate::motion::AxisSetup| {
            let (follow, ramp, room) = config.of(axis.name.kind());
            AxisStage {
                follow,
                ramp,
                reach: [axis.travel[0] - room, axis.travel[1] + room],
                offset: 0.0,
                rate: 0.0,
                target: 0.0,
                target_rate: 0.0,
            }
        };
        Self {
            axes: axes.as_slice().iter().map(stage).collect(),
            dt_s: cycle_s,
            delay_cycles: u64::from(config.delay_cycles),
            hold_cycles: (config.hold_s / cycle_s).round() as u64,
            waiting: VecDeque::with_capacity(2048),
            mode: Mode::Following,
            last_good: None,
            last_answered: None,
        }
    }

    /// A new link: its answers start anew, the offset stays.
    pub(super) fn link_opened(&mut self) {
        self.last_answered = None;
        self.waiting.clear();
    }

    /// The daemon left in order: the offset stays as it is.
    pub(super) fn link_closed_in_order(&mut self) {
        if self.mode == Mode::Following {
            self.mode = Mode::Kept;
        }
    }

    /// Judges a correction that was received in cycle `now`, whose number is `present`, whether its position was sent or
    /// not: a control that was silent must not accept corrections older than the hold time.
    pub(super) fn receive(&mut self, correction: &Correction, now: u64, present: u32) -> Verdict {
        if correction.offset[..self.axes.len()].iter().any(|v| !v.is_finite()) {
            return Verdict::NotFinite;
        }
        let age = i64::from(present.wrapping_sub(correction.sequence).cast_signed());
        let Some(age) = u64::try_from(age).ok().filter(|a| *a <= self.hold_cycles.max(1) && *a <= now) else {
            return Verdict::WrongAge;
        };
        let older = |last: u32| correction.sequence.wrapping_sub(last).cast_signed() < 0;
        if self.last_answered.is_some_and(older) {
            return Verdict::OutOfOrder;
        }
        self.last_answered = Some(correction.sequence);
        self.last_good = Some(now);
        self.mode = Mode::Following;
        if self.waiting.len() < self.waiting.capacity() {
            self.waiting.push_back((now - age + self.delay_cycles, correction.offset));
        }
        Verdict::Good
    }

    /// The offset of cycle `now`. `movable`: drives are on and no emergency stop is active.
    pub(super) fn advance(&mut self, now: u64, commanded: &AxisArray, movable: bool) -> Applied {
        let missing_since = self.last_good.map_or(0, |last| now.saturating_sub(last));
        if self.mode == Mode::Following && missing_since > self.hold_cycles {
            self.mode = Mode::RampingOut;
            self.waiting.clear();
        }
        let mut due = None;
        while self.waiting.front().is_some_and(|(cycle, _)| *cycle <= now) {
            due = self.waiting.pop_front();
        }
        let mut applied = Applied::default();
        let mut at_rest = true;
        for (k, axis) in self.axes.iter_mut().enumerate() {
            let before = axis.target;
            match (self.mode, due) {
                (Mode::RampingOut, _) => axis.target = 0.0,
                (_, Some((_, offset))) => axis.target = offset[k],
                (_, None) => {}
            }
            axis.target_rate = (axis.target - before) / self.dt_s;
            if movable {
                let ramping = self.mode == Mode::RampingOut;
                axis.approach(self.dt_s, if ramping { axis.ramp } else { axis.follow }, ramping);
            } else {
                axis.rate = 0.0;
            }
            let reachable = (commanded[k] + axis.offset).clamp(axis.reach[0], axis.reach[1]);
            // only where the limit acts, so that the sum does not lose digits
            applied.offset[k] =
                if reachable == commanded[k] + axis.offset { axis.offset } else { reachable - commanded[k] };
            applied.limited |= applied.offset[k] != axis.target && self.mode != Mode::RampingOut;
            at_rest &= axis.offset == 0.0;
        }
        applied.ramping_out = self.mode == Mode::RampingOut && !at_rest;
        applied
    }
}

impl AxisStage {
    /// One cycle towards the target: exactly onto it where rate and acceleration allow, else as fast as they allow and so
    /// that it can still stop there.
    fn approach(&mut self, dt_s: f64, limits: OffsetLimits, to_rest: bool) {
        let target = self.target.clamp(-limits.size, limits.size);
        let target_rate = if to_rest { 0.0 } else { self.target_rate.clamp(-limits.rate, limits.rate) };
        let step = limits.acceleration * dt_s;
        let gap = target - self.offset;
        let needed = gap / dt_s;
        if needed.abs() <= limits.rate
            && (needed - self.rate).abs() <= step
            && (needed - target_rate).abs() <= step
        {
            self.offset = target;
            self.rate = needed;
            return;
        }
        // braking by 0.8 of the limit leaves room for the last, incomplete step
        let brake = 0.8 * step;
        let stoppable = brake * ((0.25 + 2.0 * gap.abs() / (brake * dt_s)).sqrt() - 0.5);
        let wanted = (target_rate + stoppable.copysign(gap)).clamp(-limits.rate, limits.rate);
        self.rate = wanted.clamp(self.rate - step, self.rate + step);
        self.offset += self.rate * dt_s;
    }
}

#[cfg(test)]
mod tests;
