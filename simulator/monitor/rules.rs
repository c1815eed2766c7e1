//! Permitted changes of state on the wire, and how far an offset that is braked may still go.

use volcomp_protocol::CorrectionState::{
    self, Active, Armed, FadingToStatic, Faulted, Holding, Off, RampingIn, RampingOut,
};

use super::AxisLimits;

/// States of a first answer on a link, and of the first one after a silence: nothing is compensated yet.
pub(super) const fn may_be_first(to: CorrectionState) -> bool {
    matches!(to, Off | Armed | Faulted | RampingIn | RampingOut)
}

/// States in which an offset never grows.
pub(super) const fn never_grows(state: CorrectionState) -> bool {
    matches!(state, Off | Armed | Faulted)
}

/// Changes of state from one answer to the next. A command takes effect between two answers, so that the state behind it
/// (off, armed) need not be seen: `enable` leads from off to ramping in, `enable --clear-fault` from faulted to ramping
/// in. Active and fading are reached through ramping in only; so nothing leads from a fault to them.
pub(super) const fn may_follow(from: CorrectionState, to: CorrectionState) -> bool {
    match from {
        Off | Armed => matches!(to, Off | Armed | RampingIn | RampingOut | Faulted),
        // a stop that keeps the offset, in the cycle in which the control took over: through holding to off at once
        RampingIn => matches!(to, RampingIn | Active | Holding | RampingOut | Off | Faulted),
        Active | FadingToStatic => {
            matches!(to, Active | FadingToStatic | RampingIn | Holding | RampingOut | Off | Faulted)
        }
        Holding => matches!(to, Holding | RampingIn | RampingOut | Off | Faulted),
        RampingOut => matches!(to, RampingOut | RampingIn | Holding | Off | Armed | Faulted),
        Faulted => matches!(to, Faulted | Off | Armed | RampingIn),
    }
}

/// What is known of one axis. mm or deg, s.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct AxisTrack {
    /// Largest offset permitted at present.
    pub(super) ceiling: f64,
    /// Control time beyond the limit, s.
    pub(super) beyond_s: f64,
    /// Bounds of the state that was entered last.
    pub(super) rest: Rest,
    /// Answers that started from the read-back, and the count of answers at which one was last forgiven.
    pub(super) follows: u32,
    pub(super) followed: u64,
    /// Upper bound of the present rate of change, per s.
    speed: f64,
}

/// Bounds of an offset that is no longer to move, from the change of state on.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Rest {
    /// The offset in the answer before the change of state.
    pub(super) from: f64,
    /// Distance that braking takes.
    pub(super) braking: f64,
    /// Largest offset while off, armed or faulted.
    pub(super) ceiling: f64,
}

impl AxisTrack {
    /// Distance in which the present rate is braked to rest, with two cycles of room.
    pub(super) fn braking_distance(&self, limits: &AxisLimits, cycle_s: f64) -> f64 {
        // it may have sped up within the last cycle
        let speed = self.speed + limits.acceleration * cycle_s;
        speed * speed / (2.0 * limits.acceleration) + 2.0 * speed * cycle_s
    }

    /// An answer has changed the offset: at what rate is not known exactly, for the control may have moved a part of it.
    pub(super) fn note_change(&mut self, change: f64, limits: &AxisLimits, cycle_s: f64) {
        let bound = limits.rate.min(change.abs() / cycle_s);
        // braked by one cycle at most
        self.speed = bound.max(self.speed - limits.acceleration * cycle_s);
    }
}

impl Rest {
    /// Rest from `from` on, after braking.
    pub(super) fn at(from: f64, braking: f64) -> Self {
        Self { from, braking, ceiling: from.abs() + braking }
    }

    /// The control has moved the offset to `moved_to`, and the answer has gone along.
    pub(super) fn move_to(&mut self, offset: f64, moved_to: f64) {
        self.from = offset;
        self.ceiling = self.ceiling.max(moved_to.abs());
    }

    /// What has become smaller does not grow again, but for the distance that braking still takes beyond zero.
    pub(super) fn follow(&mut self, offset: f64, before: f64, braking: f64) {
        if offset.abs() < before.abs() {
            self.ceiling = self.ceiling.min(offset.abs().max(braking - offset.abs()));
        }
    }
}
