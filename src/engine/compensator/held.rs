//! What the control holds: where to go on from it, and whether it is what was sent.

use super::{Compensator, Detail, Position, Reason, State};
use volcomp_model::axes::AxisArray;
use volcomp_model::units::NS_PER_S;
use volcomp_protocol::MachineState;

/// So many cycles without a frame, and the control may have acted on its own.
pub(super) const GAP_CYCLES: u32 = 2;

/// Drives off or emergency stop: what is sent never acts.
pub(super) const fn is_immobile(machine: MachineState) -> bool {
    machine.has(MachineState::ESTOP) || !machine.has(MachineState::ENABLED)
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

    /// True where the control holds what it was sent, as far as a frame that is not used otherwise tells.
    pub(super) fn is_held(&self, frame: &Position) -> bool {
        let applied = self.held_by_control(frame);
        self.synchronised
            && !frame.state.has(MachineState::OFFSET_RAMPING_OUT)
            && self.read_back.knows(&applied, self.axes)
    }

    /// Takes over the offset that the control holds: at the first frame of a link, after it has acted on its own,
    /// while it cannot move any offset, and where it has changed its offset while the machine was not ready.
    pub(super) fn synchronise(&mut self, frame: &Position) {
        let applied = self.held_by_control(frame);
        // braking past the offset that an immobile machine holds would be a step when it moves again
        let immobile = is_immobile(frame.state);
        let was_immobile = core::mem::replace(&mut self.immobile, immobile);
        let took_over = frame.state.has(MachineState::OFFSET_RAMPING_OUT);
        // after a gap the control may have acted on its own and be done with it
        let unseen = self.frozen || self.gap_cycles > GAP_CYCLES || !self.intake.is_settled();
        let moved = unseen && !immobile && !self.read_back.knows_after(self.gap_cycles, &applied, self.axes);
        if self.synchronised && !took_over && !moved && !immobile && !was_immobile {
            return;
        }
        self.start_at(&applied);
        self.read_back.restart();
        self.read_back.sent(&applied);
        if (took_over || moved) && self.is_moving() {
            self.intake.unsettle();
            self.plan(State::Holding, Reason::ControlTookOver);
        }
        if self.state == State::Faulted || !self.synchronised {
            // the way to zero starts from here, not from an offset that the control no longer holds
            self.plan(self.state, Reason::ReadBack);
        }
        self.synchronised = true;
    }

    /// The offset that the control reports, mm and rad.
    fn held_by_control(&self, frame: &Position) -> AxisArray {
        core::array::from_fn(|k| frame.applied[k] * self.scale[k])
    }

    /// At rest at an offset that the control holds.
    fn start_at(&mut self, held: &AxisArray) {
        for (limiter, held) in self.limiters.iter_mut().zip(held).take(self.axes) {
            limiter.start_at(*held);
        }
    }

    pub(super) fn check_read_back(&mut self, frame: &Position) {
        let applied = self.held_by_control(frame);
        self.aim.lag.read_back(frame.sequence, &applied);
        let watched =
            self.synchronised && self.state != State::Faulted && frame.state.is_ready() && !self.frozen;
        if watched && self.read_back.is_foreign(&applied, self.axes) {
            self.enabled = false;
            self.detail = self
                .read_back
                .foreign(&applied, self.axes)
                .map(|(k, by, tolerance)| Detail::of_axis(k, by / self.scale[k], tolerance / self.scale[k]));
            // the way back to zero starts from what the control really holds
            self.start_at(&applied);
            // once cleared, the next fault needs a whole window of its own
            self.read_back.restart();
            self.plan(State::Faulted, Reason::ReadBack);
        }
    }
}
