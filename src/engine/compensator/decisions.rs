//! Which state a cycle belongs to: the rules of [`crate::transitions`] as they are carried out.

use super::{Compensator, MachineState, Reason, Setpoint, State};
use crate::config::{AfterLoss, OutOfTravel};

impl Compensator {
    /// Which state this cycle belongs to.
    pub(super) fn decide(&mut self, machine: MachineState, bad: Option<Reason>, target: &Setpoint, dt: f64) {
        self.frozen = !machine.is_ready();
        if self.frozen {
            self.wait_for_machine(machine);
            return;
        }
        let outside = target.out_of_travel != 0 && self.config.out_of_travel == OutOfTravel::RampOut;
        self.obstacle = bad.or(outside.then_some(Reason::OutOfTravel));
        if let Some(reason) = bad {
            self.hold_or_give_up(reason, dt);
            return;
        }
        if matches!(self.state, State::Off | State::Armed) {
            self.held_s = 0.0;
        }
        if target.beyond_stop != 0 && self.follows_target() {
            self.enabled = false;
            self.plan(State::Faulted, Reason::StopLimit);
            return;
        }
        let wanted = self.enabled && !outside;
        let reason = if outside { Reason::OutOfTravel } else { Reason::Command };
        // while the control takes the offset back, what is sent does not act
        let settled = self.input.is_settled() && !machine.has(MachineState::OFFSET_RAMPING_OUT);
        match self.state {
            State::Faulted => {}
            State::Off | State::Armed if wanted && settled => {
                self.plan(State::RampingIn, Reason::MachineReady);
            }
            State::Off | State::Armed if !self.is_zero() && settled && !self.keeps_offset() => {
                self.plan(State::RampingOut, Reason::FoundOffset);
            }
            State::Off | State::Armed => self.rest(Reason::Command),
            State::RampingIn if !wanted => self.leave(reason),
            State::RampingIn if self.ramp.is_done() => self.enter(State::Active, Reason::RampDone),
            State::RampingIn => {}
            State::Active | State::FadingToStatic if !wanted => self.leave(reason),
            State::Active if self.setpoints.live.is_fading() => {
                self.enter(State::FadingToStatic, Reason::LiveLost);
            }
            State::FadingToStatic if !self.setpoints.live.is_fading() => {
                self.enter(State::Active, Reason::RampDone)
            }
            State::Active | State::FadingToStatic => {}
            State::Holding if self.keeps_offset() => self.rest(Reason::Command),
            State::Holding if settled => {
                if wanted {
                    self.plan(State::RampingIn, Reason::DataGood);
                } else {
                    self.leave(reason);
                }
            }
            State::Holding => {}
            State::RampingOut if wanted && settled => {
                let reason = if self.commanded { Reason::Command } else { Reason::DataGood };
                self.plan(State::RampingIn, reason);
            }
            State::RampingOut => self.rest_where_done(),
        }
    }

    /// Ramps out, or keeps the offset where the stop is configured so.
    fn leave(&mut self, reason: Reason) {
        if self.keeps_offset() {
            self.plan(State::Holding, reason);
        } else {
            self.plan(State::RampingOut, reason);
        }
    }

    /// Nothing to do: off or armed.
    fn rest(&mut self, reason: Reason) {
        self.enter(if self.enabled { State::Armed } else { State::Off }, reason);
    }

    /// A stop has been carried out where nothing moves any more and the offset is the one that is to stay.
    pub(super) fn note_stop(&mut self) {
        self.stopped |= self.stopping && self.is_at_rest() && (self.is_zero() || self.keeps_offset());
    }

    /// Drives off or emergency stop: the offset stays where it is, for moving it would move nothing, or jump later.
    fn wait_for_machine(&mut self, machine: MachineState) {
        let reason = if machine.has(MachineState::ESTOP) {
            Reason::EmergencyStop
        } else if !machine.has(MachineState::ENABLED) {
            Reason::NotEnabled
        } else {
            Reason::NotHomed
        };
        self.obstacle = Some(reason);
        self.input.unsettle();
        self.held_s = 0.0;
        self.stopped |= self.stopping;
        if self.is_moving() {
            self.plan(State::Holding, reason);
        }
    }

    /// Stale or implausible data: hold, and when that lasts, ramp out.
    pub(super) fn hold_or_give_up(&mut self, reason: Reason, dt: f64) {
        match self.state {
            State::RampingIn | State::Active | State::FadingToStatic => self.plan(State::Holding, reason),
            State::Holding => {
                self.held_s += dt;
                if (self.held_s >= self.config.hold_s || self.stopping) && !self.frozen {
                    self.leave(reason);
                    self.lost = true;
                }
            }
            State::RampingOut => self.rest_where_done(),
            // an offset that somebody else has left
            State::Off | State::Armed if !self.is_zero() && !self.keeps_offset() && !self.frozen => {
                self.held_s += dt;
                if self.held_s >= self.config.hold_s || self.stopping {
                    self.plan(State::RampingOut, reason);
                }
            }
            State::Off | State::Armed | State::Faulted => {}
        }
    }

    /// The end of a way to zero: at rest, or latched where lost positions were the cause of it.
    fn rest_where_done(&mut self) {
        if !(self.ramp.is_done() && self.is_zero()) {
            return;
        }
        if self.lost && self.enabled && !self.stopping && self.config.after_loss == AfterLoss::Latch {
            self.enabled = false;
            self.plan(State::Faulted, Reason::DataLost);
        } else {
            self.rest(Reason::RampDone);
        }
    }
}
