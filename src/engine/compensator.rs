//! The state machine between positions and corrections.
//!
//! The output is always `limiter(blend(from, to, s))`: `from` is the offset at the last change of plan, `to` the
//! correction (or zero), `s` a smooth share that grows from 0 to 1 over the ramp. So nothing ever steps, from
//! whatever offset and in whatever state a change of plan comes; the limiter bounds what is left.

mod commands;
mod decisions;
mod offset_resync;

use offset_resync::{GAP_CYCLES, Sending, is_immobile};

use super::config::{AxisLimits, EngineConfig, EngineError, LimitTime, RestOffset};
use super::input_validation::InputValidation;
use super::limiter::Limiter;
use super::output::{CycleOutput, Detail, Event, Reason, State};
use super::ramp::Ramp;
use super::read_back::ReadBack;
use super::setpoint::{CycleInput, Setpoint, SetpointGenerator};
use super::shortfall::Shortfall;
use super::time_budget::TimeBudget;
use volcomp_model::Model;
use volcomp_model::axes::{AxisArray, AxisKind, MAX_AXES};
use volcomp_model::geometry::Vec3;
use volcomp_model::units::{MonoTime, RAD_PER_DEG};
use volcomp_protocol::{Correction, MachineState, Position};

/// The most control time that one output may use, in cycles: a late frame must not become a long step.
const STEP_CYCLES_MAX: f64 = 2.0;

/// Turns positions into bounded corrections.
#[derive(Debug, Clone)]
pub struct Compensator {
    config: EngineConfig,
    axes: usize,
    /// mm or rad per wire unit.
    scale: AxisArray,
    input: InputValidation,
    setpoints: SetpointGenerator,
    read_back: ReadBack,
    limiters: [Limiter; MAX_AXES],
    state: State,
    /// The wish of the operator.
    enabled: bool,
    stopping: bool,
    stopped: bool,
    gain: f64,
    gain_wanted: f64,
    from: AxisArray,
    /// The way that each axis needed to come to rest when the plan changed: a ramp begins at rest.
    braking: AxisArray,
    ramp: Ramp,
    /// The part of the present offset that returns to zero when the axes come to rest.
    transient: AxisArray,
    /// What of it is still to be taken out while the rest is held.
    unwinding: AxisArray,
    /// False until the first believable frame of a link has told which offset the control holds.
    synchronised: bool,
    /// What is sent on the present link.
    sending: Sending,
    /// A latched fault forbids every correction.
    silenced: bool,
    /// Frames were missing, or said nothing: the control may have acted on its own.
    unobserved: bool,
    /// Answers since then that started anew from the read-back.
    follows: u32,
    /// The newest finite offset that the control has reported on this link, mm and rad.
    reported: Option<AxisArray>,
    /// Least and largest offset sent on this link, zero included, mm and rad: what the control may hold when the next one begins.
    reach: Option<[[f64; 2]; MAX_AXES]>,
    /// The offset at which this link began, mm and rad.
    found: AxisArray,
    /// The machine is not ready: no offset is moved, and the control may change its own meanwhile.
    frozen: bool,
    /// Drives off or emergency stop: the control cannot move any offset.
    immobile: bool,
    /// How long the present hold has lasted, s.
    held_s: f64,
    /// The offset is on its way to zero because positions were lost.
    lost: bool,
    /// Compensation was enabled since the last change of plan.
    commanded: bool,
    /// When the last frame came.
    heard: Option<MonoTime>,
    /// The numbers behind what this cycle has found.
    detail: Option<Detail>,
    /// What kept the newest frame, or its absence, from being compensated.
    obstacle: Option<Reason>,
    shortfall: Shortfall,
    last_sequence: u32,
    last_control_ns: i64,
    /// Control cycles from the frame before to this one.
    gap_cycles: u32,
    /// The same in control time, s.
    gap_s: f64,
    /// Frames that were old or repeated.
    strays: u64,
    next_deadline: Option<MonoTime>,
    /// When a frame or a deadline was answered last.
    told: Option<MonoTime>,
    /// Where the limits hold in this computer's time.
    budget: Option<TimeBudget>,
    /// Not yet told.
    event: Option<Event>,
    /// Every single change of state, for the tests that hold them against the rules.
    #[cfg(test)]
    pub(super) trace: Vec<(State, State, Reason)>,
}

/// What one cycle found out before it moves anything.
struct Plan<'a> {
    target: &'a Setpoint,
    /// Time that the offset may use, s: control time of the frame, one cycle without one, within the time budget.
    dt: f64,
    /// Time that has passed, s: ramps and gain go by it.
    elapsed_s: f64,
}

impl Compensator {
    /// An engine that is off.
    ///
    /// # Errors
    /// The configuration is incomplete or does not fit the model.
    pub fn new(config: &EngineConfig, model: &Model) -> Result<Self, EngineError> {
        config.validate()?;
        let axes = config.axes.len();
        let mut scale = [1.0; MAX_AXES];
        let mut tolerance = [0.0; MAX_AXES];
        let mut limiters = [Limiter::new(NO_LIMITS); MAX_AXES];
        for (k, name) in config.axes.iter().enumerate() {
            scale[k] = if name.kind() == AxisKind::Rotary { RAD_PER_DEG } else { 1.0 };
            tolerance[k] = config.read_back_tolerance[k];
            limiters[k] = Limiter::new(config.limits[k]);
        }
        Ok(Self {
            input: InputValidation::new(config, &scale),
            setpoints: SetpointGenerator::new(config, scale, model)?,
            read_back: ReadBack::new(config.read_back_cycles as usize, tolerance),
            ramp: Ramp::start(config.ramp_s),
            gain: config.gain,
            gain_wanted: config.gain,
            config: config.clone(),
            axes,
            scale,
            limiters,
            state: State::Off,
            enabled: false,
            stopping: false,
            stopped: false,
            from: [0.0; MAX_AXES],
            braking: [0.0; MAX_AXES],
            transient: [0.0; MAX_AXES],
            unwinding: [0.0; MAX_AXES],
            synchronised: false,
            sending: Sending::NotYet,
            silenced: false,
            unobserved: false,
            follows: 0,
            reported: None,
            reach: None,
            found: [0.0; MAX_AXES],
            frozen: false,
            immobile: false,
            held_s: 0.0,
            lost: false,
            commanded: false,
            heard: None,
            detail: None,
            obstacle: None,
            shortfall: Shortfall::new(config),
            last_sequence: 0,
            last_control_ns: 0,
            gap_cycles: 0,
            gap_s: 0.0,
            strays: 0,
            next_deadline: None,
            told: None,
            budget: (config.limit_time == LimitTime::Computer)
                .then(|| TimeBudget::new(config.stale_s.max(STEP_CYCLES_MAX * config.cycle_s))),
            event: None,
            #[cfg(test)]
            trace: Vec::new(),
        })
    }

    /// A new link: the control may hold any offset; the first position frame tells which, and the engine starts there.
    pub fn on_link_up(&mut self, _now: MonoTime) {
        self.input.restart();
        (self.unobserved, self.follows) = (false, 0);
        self.read_back.restart();
        self.setpoints.restart();
        self.forget_transients();
        self.synchronised = false;
        self.sending = Sending::NotYet;
        self.reported = None;
        self.next_deadline = None;
        self.event = None;
        if self.state == State::Faulted {
            // the control has been left to its own rule meanwhile: no correction until a person has looked
            self.silenced = true;
        } else {
            self.state = if self.enabled { State::Armed } else { State::Off };
        }
    }

    /// The link is gone: nothing can be sent until [`Compensator::on_link_up`].
    pub fn on_link_down(&mut self, now: MonoTime) {
        self.on_link_up(now);
        if self.stopping {
            // nobody listens any more; the control's own watchdog takes the offset out
            self.stopped = true;
        }
    }

    /// A live value, mm or rad, for channel `channel` of [`Model::sensors`]; counts until it is too old.
    pub fn on_live(&mut self, now: MonoTime, channel: usize, value: f64) {
        self.setpoints.live.update(now, channel, value);
    }

    /// Goes on with a lag that was measured elsewhere: for an engine that takes up a recording in its middle.
    pub const fn assume_lag(&mut self, cycles: Option<u32>) {
        self.setpoints.lag.assume(cycles);
    }

    /// One position frame (wire units) received at `now`; returns the correction that answers it.
    ///
    /// `None` until the control has told, in finite numbers, which offset it holds: whatever was sent before that
    /// could be a step.
    ///
    /// # Cycle   no allocation, no panic, bounded time
    #[must_use]
    pub fn on_position(&mut self, now: MonoTime, frame: &Position, model: &Model) -> Option<CycleOutput> {
        let position = self.setpoints.position(&self.config, frame);
        let verdict = self.input.accept(frame, &position);
        if verdict == Err(Reason::Sequence) {
            // old or repeated: says nothing new, and does not count as a sign of life
            self.strays = self.strays.saturating_add(1);
            self.obstacle = Some(Reason::Sequence);
            if !self.is_held(frame) {
                return None;
            }
            let output = self.move_on(&Plan { target: &self.stay(), dt: 0.0, elapsed_s: 0.0 });
            return Some(CycleOutput { out_of_order: true, ..output });
        }
        self.count_gap(frame);
        (self.told, self.heard) = (Some(now), Some(now));
        self.detail = self.input.detail;
        // the clock of a bad frame is not to be trusted; time that was used for a bad frame is not used again
        let dt =
            verdict.unwrap_or(self.config.cycle_s).min(self.gap_s).min(STEP_CYCLES_MAX * self.config.cycle_s);
        let usable_s = self.usable(now, dt);
        let told = frame.applied[..self.axes].iter().all(|v| v.is_finite());
        self.obstacle = (!told).then_some(Reason::NotFinite);
        let mut resynchronised = false;
        if told {
            resynchronised = self.resynchronise(frame, usable_s);
            self.check_read_back(frame);
        } else if self.gap_cycles > GAP_CYCLES || self.immobile || is_immobile(frame.state) {
            // the control may have acted on its own and does not say what it holds
            self.synchronised = false;
        } else {
            self.unobserved = true;
        }
        if !self.may_send() {
            return None;
        }
        self.sending = Sending::Running;
        self.next_deadline = Some(now.plus_seconds(self.config.stale_s));
        let target = match verdict {
            Ok(_) => {
                let input = CycleInput {
                    position: &position,
                    commanded: &frame.commanded,
                    time: now,
                    dt,
                    gain: self.gain,
                    offset: self.offset(),
                };
                self.setpoints.at(&self.config, &self.input, model, &input)
            }
            Err(_) => Setpoint::NONE,
        };
        self.detail = self.detail.or(target.detail);
        let bad = verdict.err().or((!target.finite).then_some(Reason::ModelNotFinite));
        self.decide(frame.state, bad, &target, usable_s);
        // a resynchronisation has used the time of this frame for its own step
        let moving_s = if resynchronised { 0.0 } else { usable_s };
        let output = self.move_on(&Plan { target: &target, dt: moving_s, elapsed_s: usable_s });
        self.setpoints.lag.sent(frame.sequence, &output.offset);
        Some(output)
    }

    /// When [`Compensator::on_deadline`] wants to be called if no position arrives; `None` while nothing is due.
    #[must_use]
    pub const fn next_deadline(&self) -> Option<MonoTime> {
        self.next_deadline
    }

    /// No position has arrived by the deadline: holds, then ramps out. Calling early is harmless and gives `None`.
    #[must_use]
    pub fn on_deadline(&mut self, now: MonoTime) -> Option<CycleOutput> {
        let due = self.next_deadline?;
        if now < due {
            return None;
        }
        self.obstacle = Some(Reason::Stale);
        if !self.may_send() {
            // what the control holds is not known, or a fault forbids it: nothing may be sent
            self.next_deadline = None;
            return None;
        }
        self.input.unsettle();
        self.unobserved = true;
        let dt = self.config.cycle_s;
        // what is waited for goes by the clock, however late this call is; the offset moves by one cycle's worth
        let elapsed_s = self.told.map_or(dt, |then| now.seconds_since(then).max(0.0));
        self.told = Some(now);
        let silent_s = self.heard.map_or(elapsed_s, |then| now.seconds_since(then));
        self.detail = Some(Detail::of_time(silent_s, self.config.stale_s));
        self.hold_or_give_up(Reason::Stale, elapsed_s);
        let usable_s = self.usable(now, dt);
        let output = self.move_on(&Plan { target: &self.stay(), dt: usable_s, elapsed_s });
        let resting = self.is_at_rest();
        let faulted = self.state == State::Faulted && !self.is_zero();
        let waiting = matches!(self.state, State::Holding | State::RampingOut) || faulted || !resting;
        self.next_deadline = waiting.then(|| now.plus_seconds(dt));
        Some(output)
    }

    /// The present state.
    #[must_use]
    pub const fn state(&self) -> State {
        self.state
    }

    /// Frames so far that were old or repeated, answered or not.
    #[must_use]
    pub const fn strays(&self) -> u64 {
        self.strays
    }

    /// True where the operator wants compensation.
    #[must_use]
    pub const fn is_enabled(&self) -> bool {
        self.enabled
    }

    /// Why an enabled compensation waits or is held: what is wrong with the machine, its positions or the model now.
    #[must_use]
    pub fn waits_for(&self) -> Option<Reason> {
        self.obstacle.filter(|_| self.enabled && !self.follows_target())
    }

    /// True once a [`super::output::Command::Stop`] has been carried out.
    #[must_use]
    pub const fn is_stopped(&self) -> bool {
        self.stopped
    }

    /// The present offsets in wire order, mm or rad.
    #[must_use]
    pub fn offset(&self) -> AxisArray {
        core::array::from_fn(|k| self.limiters[k].position())
    }

    /// The part of `dt` seconds of control time that offsets may use at `now`.
    fn usable(&mut self, now: MonoTime, dt: f64) -> f64 {
        self.budget.as_mut().map_or(dt, |budget| budget.grant(now, dt))
    }

    /// The target that is the present offset.
    fn stay(&self) -> Setpoint {
        let offset = self.offset();
        Setpoint { offset, known: offset, ..Setpoint::NONE }
    }

    /// The wire message for an output: mm and deg.
    #[must_use]
    pub fn message(&self, output: &CycleOutput) -> Correction {
        Correction {
            sequence: output.sequence,
            state: output.state,
            limited: output.limited,
            offset: self.wire(&output.offset),
        }
    }

    /// Values of the engine, mm and rad, as they go over the wire: mm and deg.
    #[must_use]
    pub fn wire(&self, values: &AxisArray) -> AxisArray {
        core::array::from_fn(|k| values[k] / self.scale[k])
    }

    /// True while the offset follows the correction or goes to or from it.
    const fn is_moving(&self) -> bool {
        matches!(self.state, State::Active | State::FadingToStatic | State::RampingIn | State::RampingOut)
    }

    /// True where a stop leaves the last offset in place.
    fn keeps_offset(&self) -> bool {
        self.stopping && self.config.rest == RestOffset::Hold
    }

    /// A change of plan: everything starts again from the present offset.
    fn plan(&mut self, state: State, reason: Reason) {
        self.from = self.offset();
        self.braking = core::array::from_fn(|k| self.limiters[k].stopping_distance());
        // what follows velocity and acceleration must not be held when nobody tells them any more
        self.unwinding = if state == State::Holding { self.transient } else { [0.0; MAX_AXES] };
        self.transient = [0.0; MAX_AXES];
        self.ramp = Ramp::start(self.config.ramp_s);
        self.held_s = 0.0;
        self.lost = false;
        self.commanded = false;
        self.enter(state, reason);
    }

    /// The offset is another one: nothing is known of the parts of it.
    const fn forget_transients(&mut self) {
        self.transient = [0.0; MAX_AXES];
        self.unwinding = [0.0; MAX_AXES];
    }

    fn enter(&mut self, state: State, reason: Reason) {
        if state != self.state {
            #[cfg(test)]
            self.trace.push((self.state, state, reason));
            // what happened between two frames and was not told yet becomes one change with this one
            let from = match self.event {
                Some(Event::StateChanged { from, .. }) => from,
                None => self.state,
            };
            let detail = self.detail.filter(|_| reason.has_numbers());
            self.event = (from != state).then_some(Event::StateChanged { from, to: state, reason, detail });
            self.state = state;
        }
    }

    /// True where the offset is on the correction or on its way there.
    const fn follows_target(&self) -> bool {
        matches!(self.state, State::Active | State::FadingToStatic | State::RampingIn)
    }

    /// Moves the offset for one cycle and reports.
    fn move_on(&mut self, plan: &Plan<'_>) -> CycleOutput {
        let dt = plan.dt;
        let gain_step = plan.elapsed_s / self.config.ramp_s;
        self.gain += (self.gain_wanted - self.gain).clamp(-gain_step, gain_step);
        self.ramp.advance(plan.elapsed_s);
        let share = self.ramp.share();
        let mut at_soft_limit = if self.follows_target() { plan.target.at_soft_limit } else { 0 };
        let mut limited = 0;
        let mut warning = 0;
        let crowded = if self.follows_target() { plan.target.limited } else { 0 };
        for (k, limiter) in self.limiters.iter_mut().enumerate().take(self.axes) {
            let blend = |to: f64| self.from[k] + (to - self.from[k]) * share;
            let held_back = match self.state {
                _ if self.frozen => {
                    limiter.brake(dt);
                    false
                }
                State::RampingIn => {
                    let wanted = blend(plan.target.offset[k]);
                    limiter.step(wanted, dt) && (limiter.position() - wanted).abs() > self.braking[k]
                }
                State::Active | State::FadingToStatic => limiter.step(plan.target.offset[k], dt),
                State::RampingOut | State::Faulted => {
                    // on its way to zero, too, an offset must not carry an axis over its soft limit
                    let [low, high] = plan.target.room[k];
                    // one that moved inwards when the way began must not be taken out again to where it began
                    let at = limiter.position();
                    let wanted = blend(0.0).abs().min(at.abs()).copysign(at);
                    let kept = wanted.min(high).max(low);
                    at_soft_limit |= u8::from(kept != wanted) << k;
                    // ahead of the ramp is not held back
                    limiter.step_to_zero(kept, dt) && limiter.position().abs() > kept.abs() + self.braking[k]
                }
                State::Holding if self.unwinding[k] != 0.0 => {
                    let rest = limiter.position() - self.unwinding[k];
                    limiter.step(rest, dt);
                    self.unwinding[k] = limiter.position() - rest;
                    false
                }
                State::Off | State::Armed | State::Holding => {
                    limiter.brake(dt);
                    false
                }
            };
            if let Some(transient) = plan.target.transient {
                // what a limit still keeps from its target at rest is to go there, too
                let at_rest = plan.target.offset[k] - transient[k];
                self.transient[k] = match self.state {
                    State::RampingIn => limiter.position() - blend(at_rest),
                    State::Active | State::FadingToStatic => limiter.position() - at_rest,
                    _ => 0.0,
                };
            }
            limited |= u8::from(held_back && dt > 0.0) << k;
            warning |= u8::from(limiter.is_warning()) << k;
        }
        let following = self.follows_target();
        let offset = self.offset();
        let lagging = self.shortfall.look(&plan.target.offset, &offset, following, plan.elapsed_s);
        limited |= at_soft_limit | crowded;
        if dt > 0.0 {
            self.read_back.sent(&offset);
        }
        self.note_reach();
        self.detail = None;
        self.note_stop();
        CycleOutput {
            sequence: self.last_sequence,
            state: self.state,
            offset,
            limited,
            at_soft_limit,
            warning,
            out_of_order: false,
            out_of_range: plan.target.out_of_range,
            out_of_travel: if following { plan.target.out_of_travel } else { 0 },
            lagging,
            faded: plan.target.faded,
            wanted: plan.target.offset,
            known: plan.target.known,
            lag_cycles: self.setpoints.lag.measured(),
            // what a command, a tool or a model has changed since the last cycle is told with this one
            event: self.event.take(),
            stopped: self.stopped,
        }
    }

    /// True where no offset is changing.
    fn is_at_rest(&self) -> bool {
        self.limiters[..self.axes].iter().all(Limiter::is_at_rest)
    }

    /// True where every axis that may be moved is at zero.
    fn is_zero(&self) -> bool {
        (0..self.axes).all(|k| self.config.limits[k].size <= 0.0 || self.limiters[k].position() == 0.0)
    }
}

/// Limits of a slot without an axis.
const NO_LIMITS: AxisLimits = AxisLimits {
    warning: 0.0,
    size: 0.0,
    stop: f64::INFINITY,
    rate: 0.0,
    acceleration: 0.0,
    step: f64::INFINITY,
};
