//! The offset that the control reports: where the engine starts from, and when it must not believe the report.
//!
//! Rules (`docs/explanation/safety.md`, "What is always true"): a reported offset never makes an answer larger than the size limit
//! nor a step between two answers larger than the limits allow. A link starts at the reported offset, up to
//! [`FOUND_FACTOR`] times the limit. Later on the link the engine follows a report only within one step, or in bounded
//! steps while the machine cannot move; a larger difference ends the link, and the next one starts anew. A report that
//! cannot be right latches a fault, after which nothing is sent: the control then removes its offset by its own rule.

use super::{Compensator, Detail, Event, Position, Reason, State};
use crate::config::{FOUND_FACTOR, UNLISTED_MAX_DEG, UNLISTED_MAX_MM};
use volcomp_model::axes::{AxisArray, AxisKind};
use volcomp_model::units::{NS_PER_S, RAD_PER_DEG};
use volcomp_protocol::MachineState;

/// So many cycles without a frame, and the control may have acted on its own.
pub(super) const GAP_CYCLES: u32 = 2;

/// So often in a row an answer may start anew from the read-back after a gap: corrections that were late may still act.
const FOLLOWS_MAX: u32 = 10;

/// Drives off or emergency stop: what is sent never acts.
pub(super) const fn is_immobile(machine: MachineState) -> bool {
    machine.has(MachineState::ESTOP) || !machine.has(MachineState::ENABLED)
}

/// Whether corrections are sent on the present link.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Sending {
    /// Nothing was sent on this link yet: it may start at any plausible offset.
    NotYet,
    /// Corrections are sent; each starts from the one before.
    Running,
    /// The control holds another offset than the last one sent: a new link must start from it.
    NeedsNewLink,
}

impl Compensator {
    /// Cycles since the frame before, by its number or by its time, whichever is more: the control may have acted on
    /// its own. In those that both agree on it has had no answer, and the last offset sent has long taken effect.
    pub(super) fn count_gap(&mut self, frame: &Position) {
        let numbers = frame.sequence.wrapping_sub(self.last_sequence);
        let passed_s = frame.control_ns.saturating_sub(self.last_control_ns) as f64 / NS_PER_S;
        let passed = (passed_s / self.config.cycle_s).round() as u32;
        self.gap_cycles = numbers.max(passed);
        self.gap_s = passed_s.max(f64::from(numbers) * self.config.cycle_s);
        self.read_back.pass(numbers.min(passed).saturating_sub(1));
        (self.last_sequence, self.last_control_ns) = (frame.sequence, frame.control_ns);
    }

    /// True where corrections may be sent: the offset in force is known, and no fault forbids it.
    pub(super) fn may_send(&self) -> bool {
        self.synchronised && !self.silenced && self.sending != Sending::NeedsNewLink
    }

    /// True where the control holds what it was sent, as far as a frame that is not used otherwise tells.
    pub(super) fn is_held(&self, frame: &Position) -> bool {
        let applied = self.reported_offset(frame);
        self.may_send()
            && !frame.state.has(MachineState::OFFSET_RAMPING_OUT)
            && self.read_back.knows(&applied, self.axes)
    }

    /// Takes over the offset that the control reports (finite values): at the first frame of a link, after it has acted
    /// on its own, while it cannot move any offset, and where it has changed its offset while the machine was not ready.
    /// `dt`: control time that the answer may use, s. True where the offset was changed by it.
    pub(super) fn resynchronise(&mut self, frame: &Position, dt: f64) -> bool {
        let applied = self.reported_offset(frame);
        self.reported = Some(applied);
        // braking past the offset that an immobile machine holds would be a step when it moves again
        let immobile = is_immobile(frame.state);
        let was_immobile = core::mem::replace(&mut self.immobile, immobile);
        let took_over = frame.state.has(MachineState::OFFSET_RAMPING_OUT) && self.shrinks(&applied);
        if self.frozen || self.gap_cycles > GAP_CYCLES {
            self.unobserved = true;
        } else if self.input.is_settled() {
            self.unobserved = false;
            self.follows = 0;
        }
        // a control that keeps changing its offset without a gap is left to the read-back watch
        let moved = self.unobserved
            && !immobile
            && self.follows < FOLLOWS_MAX
            && !self.read_back.knows_after(self.gap_cycles, &applied, self.axes);
        self.follows += u32::from(moved);
        let unchanged = self.synchronised && !took_over && !moved && !immobile && !was_immobile;
        if unchanged || self.silenced || self.sending == Sending::NeedsNewLink {
            return false;
        }
        if let Some(detail) = self.implausible(&applied) {
            self.silence(Reason::ImplausibleOffset, Some(detail));
            return false;
        }
        let within_a_step = (0..self.axes).all(|k| {
            let difference = (applied[k] - self.limiters[k].position()).abs();
            !self.is_listed(k) || difference <= self.allowance(k, dt)
        });
        // one that is being led back never grows, not even by the delay of the read-back
        let held: AxisArray = core::array::from_fn(|k| {
            if self.sending == Sending::NotYet || k >= self.axes || !self.is_listed(k) {
                return applied[k];
            }
            let most = self.config.limits[k].size.max(self.limiters[k].position().abs());
            applied[k].clamp(-most, most)
        });
        if self.sending == Sending::NotYet {
            self.begin_reach(&held);
        }
        if self.sending == Sending::NotYet || within_a_step {
            self.start_at(&held);
        } else if immobile {
            // nothing moves: the answers approach what the control holds, in steps that would be allowed anyway
            for (k, held) in held.iter().enumerate().take(self.axes) {
                let at = self.limiters[k].position();
                let most = self.allowance(k, dt);
                let next = if self.is_listed(k) { at + (held - at).clamp(-most, most) } else { *held };
                self.limiters[k].start_at(next);
            }
        } else {
            self.sending = Sending::NeedsNewLink;
            self.next_deadline = None;
        }
        self.forget_transients();
        self.read_back.restart();
        self.read_back.sent(&self.offset());
        if (took_over || moved || self.sending == Sending::NeedsNewLink) && self.is_moving() {
            self.input.unsettle();
            self.plan(State::Holding, Reason::ControlTookOver);
        }
        if self.state == State::Faulted || !self.synchronised {
            // the way to zero starts from here, not from an offset that the control no longer holds
            self.plan(self.state, Reason::ReadBack);
        }
        self.synchronised = true;
        true
    }

    /// True where no axis is further out than the last answer: what a control that takes its offset back reports.
    fn shrinks(&self, applied: &AxisArray) -> bool {
        (0..self.axes).all(|k| {
            let most = self.limiters[k].position().abs() + self.config.read_back_tolerance[k];
            !self.synchronised || !self.is_listed(k) || applied[k].abs() <= most
        })
    }

    /// The largest change of axis `k` within `dt` seconds, mm or rad.
    fn allowance(&self, k: usize, dt: f64) -> f64 {
        let limits = &self.config.limits[k];
        limits.step.min(limits.rate * dt)
    }

    /// True where the machine file has limits for the axis: only then is it ever moved.
    fn is_listed(&self, k: usize) -> bool {
        self.config.limits[k].size > 0.0
    }

    /// The first axis whose reported offset cannot be right, with the bound it exceeds.
    fn implausible(&self, applied: &AxisArray) -> Option<Detail> {
        (0..self.axes).find_map(|k| {
            let [low, high] = self.believed(k);
            let bound = if applied[k] < low { -low } else { high };
            let beyond = applied[k] < low || applied[k] > high;
            beyond.then(|| Detail::of_axis(k, applied[k] / self.scale[k], bound / self.scale[k]))
        })
    }

    /// The offsets of axis `k` that are believed, mm or rad. A control may hold or take back what it was sent on the link before;
    /// one that holds more has it from elsewhere, and starting there would let it grow from link to link.
    fn believed(&self, k: usize) -> [f64; 2] {
        let bound = self.bound(k);
        match self.reach {
            Some(reach) if self.sending == Sending::NotYet && self.is_listed(k) => {
                let tolerance = self.config.read_back_tolerance[k];
                [(reach[k][0] - tolerance).max(-bound), (reach[k][1] + tolerance).min(bound)]
            }
            _ => [-bound, bound],
        }
    }

    /// The range of the offsets of a link that begins at `found`. What lies outside the range of the link before is the tolerance
    /// of its read-back: taken over, it would grow by as much with every link.
    fn begin_reach(&mut self, found: &AxisArray) {
        let before = self.reach;
        self.reach = Some(core::array::from_fn(|k| {
            let [low, high] = before.map_or([found[k]; 2], |reach| reach[k]);
            let at = found[k].max(low).min(high);
            [at.min(0.0), at.max(0.0)]
        }));
        self.found = *found;
    }

    /// Extends the range of the offsets of this link by the present one, where it has moved out from the one that was found: on the way
    /// back from there it may still be beyond everything that was ever wanted.
    pub(super) fn note_reach(&mut self) {
        let offset = self.offset();
        let Some(reach) = &mut self.reach else { return };
        for (k, [low, high]) in reach.iter_mut().enumerate() {
            if offset[k] > self.found[k] {
                *high = high.max(offset[k]);
            } else if offset[k] < self.found[k] {
                *low = low.min(offset[k]);
            }
        }
    }

    /// Takes over from the engine before what the control may hold, axis by axis: a control that comes back with another hello is
    /// still the one that holds it. Anything of an axis that it did not have.
    pub fn succeed(&mut self, before: &Self) {
        let Some(reach) = before.reach else { return };
        let of = |k: usize| {
            let name = self.config.axes.get(k)?;
            before.config.axes.iter().position(|known| known == name).map(|at| reach[at])
        };
        self.reach = Some(core::array::from_fn(|k| of(k).unwrap_or([f64::NEG_INFINITY, f64::INFINITY])));
    }

    /// The largest offset of axis `k` that is believed, mm or rad.
    fn bound(&self, k: usize) -> f64 {
        let size = self.config.limits[k].size;
        match (self.is_listed(k), self.sending) {
            (false, _) if self.config.axes[k].kind() == AxisKind::Rotary => UNLISTED_MAX_DEG * RAD_PER_DEG,
            (false, _) => UNLISTED_MAX_MM,
            (true, Sending::NotYet) => FOUND_FACTOR * size,
            // one that is being led back may be beyond the limit, but never grows
            (true, _) => size.max(self.limiters[k].position().abs()) + self.config.read_back_tolerance[k],
        }
    }

    /// The offset that the control reports, mm and rad; slots without an axis are not looked at.
    fn reported_offset(&self, frame: &Position) -> AxisArray {
        core::array::from_fn(|k| frame.applied[k] * self.scale[k])
    }

    /// At rest at an offset that the control holds.
    fn start_at(&mut self, held: &AxisArray) {
        for (limiter, held) in self.limiters.iter_mut().zip(held).take(self.axes) {
            limiter.start_at(*held);
        }
    }

    /// Compares the read-back of a frame (finite values) with what was sent; a lasting difference is a fault.
    pub(super) fn check_read_back(&mut self, frame: &Position) {
        let applied = self.reported_offset(frame);
        self.setpoints.lag.read_back(frame.sequence, &applied);
        let watched =
            self.may_send() && self.state != State::Faulted && frame.state.is_ready() && !self.frozen;
        if watched && self.read_back.is_foreign(&applied, self.axes) {
            let detail = self
                .read_back
                .foreign(&applied, self.axes)
                .map(|(k, by, tolerance)| Detail::of_axis(k, by / self.scale[k], tolerance / self.scale[k]));
            // once cleared, the next fault needs a whole window of its own
            self.read_back.restart();
            self.silence(Reason::ReadBack, detail);
        }
    }

    /// A fault after which nothing is sent: what the control holds is not known, so any offset could be a step. The
    /// control misses its corrections and removes what it really holds (`docs/reference/protocol-session.md`, section 7, rule 4).
    fn silence(&mut self, reason: Reason, detail: Option<Detail>) {
        self.enabled = false;
        self.detail = detail;
        self.plan(State::Faulted, reason);
        self.detail = None;
        self.silenced = true;
        self.stopped |= self.stopping;
        self.next_deadline = None;
        if self.sending == Sending::Running {
            self.sending = Sending::NeedsNewLink;
        }
    }

    /// True where the control must be left to its own rule: a latched fault forbids every correction.
    #[must_use]
    pub const fn is_silenced(&self) -> bool {
        self.silenced
    }

    /// True where this link must end, so that the next one starts from what the control then reports.
    #[must_use]
    pub fn needs_new_link(&self) -> bool {
        self.sending == Sending::NeedsNewLink
    }

    /// The change of state that no answer has reported, because none was sent.
    pub const fn take_event(&mut self) -> Option<Event> {
        self.event.take()
    }

    /// A silenced fault may be cleared once the control reports on this link that it holds nothing; any other one once the offset
    /// is back at zero.
    pub(super) fn may_clear(&self) -> bool {
        if self.silenced { self.reports_zero() } else { self.is_zero() }
    }

    /// True where the control has reported on this link that it holds no offset, within the tolerance.
    #[must_use]
    pub fn reports_zero(&self) -> bool {
        let tolerance = &self.config.read_back_tolerance;
        self.reported.is_some_and(|reported| {
            (0..self.axes).all(|k| !self.is_listed(k) || reported[k].abs() <= tolerance[k])
        })
    }
}
