//! Set point of the offset for a frame: the model's correction at the predicted position, times the gain, inside the soft
//! limits of the machine.

use super::config::{AxisLimits, EngineConfig, EngineError, PositionSource};
use super::input_validation::InputValidation;
use super::live::LiveInputs;
use super::lookahead::LagMeter;
use super::motion::{MotionEstimator, Sample};
use super::output::Detail;
use volcomp_model::axes::{AxisArray, MAX_AXES};
use volcomp_model::geometry::Vec3;
use volcomp_model::units::MonoTime;
use volcomp_model::{AxisCorrection, Model, Pose};
use volcomp_protocol::Position;

/// Share of the offset's limits that is used to retreat from a soft limit ahead of the axis; the rest is for following.
const RETREAT: f64 = 0.25;

/// What a frame asks for. Wire order, mm and rad.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Setpoint {
    pub(super) offset: AxisArray,
    /// The correction of the model, without the gain and what soft limits take off.
    pub(super) known: AxisArray,
    /// The part of it that returns to zero when the axes come to rest; none where the model has no such part.
    pub(super) transient: Option<AxisArray>,
    /// Bit k: the size limit left no room for all of the transient part of axis k.
    pub(super) limited: u8,
    /// Bit k: a soft limit of axis k left no room for more.
    pub(super) at_soft_limit: u8,
    /// Bit k: outside the travel or a curve's range.
    pub(super) out_of_range: u8,
    /// Bit k: harmonics of axis k have faded at this feed.
    pub(super) faded: u8,
    /// Bit k: axis k is outside the travel of the model.
    pub(super) out_of_travel: u8,
    /// Bit k: the correction of axis k is beyond its stop limit.
    pub(super) beyond_stop: u8,
    /// False where the model gave something that is not a number.
    pub(super) finite: bool,
    /// The offsets, lowest and highest, that keep each axis inside its soft limits.
    pub(super) room: [[f64; 2]; MAX_AXES],
    /// The numbers behind the first of what is wrong.
    pub(super) detail: Option<Detail>,
}

impl Setpoint {
    /// Nothing is asked for.
    pub(super) const NONE: Self = Self {
        offset: [0.0; MAX_AXES],
        known: [0.0; MAX_AXES],
        transient: None,
        limited: 0,
        at_soft_limit: 0,
        out_of_range: 0,
        faded: 0,
        out_of_travel: 0,
        beyond_stop: 0,
        finite: true,
        room: [[f64::NEG_INFINITY, f64::INFINITY]; MAX_AXES],
        detail: None,
    };
}

/// What a frame says, and what was sent before it. Wire order.
#[derive(Debug, Clone, Copy)]
pub(super) struct CycleInput<'a> {
    /// Position that counts, wire units.
    pub(super) position: &'a AxisArray,
    /// Commanded position, wire units: motion is estimated from it whatever the position source, for in actual positions the
    /// offset comes back late, which would make a feedback loop of the feed-forward.
    pub(super) commanded: &'a AxisArray,
    /// When it came.
    pub(super) time: MonoTime,
    /// Control time that the answer may use, s.
    pub(super) dt: f64,
    /// Share of the correction.
    pub(super) gain: f64,
    /// The offset sent last, mm and rad.
    pub(super) offset: AxisArray,
}

/// From frames to targets.
#[derive(Debug, Clone)]
pub(super) struct SetpointGenerator {
    /// mm or rad per wire unit.
    scale: AxisArray,
    /// Wire index of each axis of the model; MAX_AXES for the spindle.
    wire_index: [usize; MAX_AXES],
    joints: usize,
    pub(super) lag: LagMeter,
    pub(super) live: LiveInputs,
    motion: MotionEstimator,
    pub(super) tool_tip: Option<Vec3>,
}

impl SetpointGenerator {
    pub(super) fn new(config: &EngineConfig, scale: AxisArray, model: &Model) -> Result<Self, EngineError> {
        let mut dead_band = [0.0; MAX_AXES];
        for (slot, band) in dead_band.iter_mut().zip(&config.reversal_deadband) {
            *slot = *band;
        }
        let mut generator = Self {
            scale,
            wire_index: [0; MAX_AXES],
            joints: 0,
            lag: LagMeter::new(config.lag, config.axes.len()),
            live: LiveInputs::new(model.sensors().len(), config.live_max_age_s, config.ramp_s),
            motion: MotionEstimator::new(config.cycle_s, &dead_band),
            tool_tip: None,
        };
        generator.take(config, model)?;
        Ok(generator)
    }

    /// Another model: its axes must be those of the control.
    pub(super) fn take(&mut self, config: &EngineConfig, model: &Model) -> Result<(), EngineError> {
        let mut wire_index = [MAX_AXES; MAX_AXES];
        for (k, axis) in model.axes().enumerate() {
            match config.axes.iter().position(|name| *name == axis.name) {
                Some(index) => wire_index[k] = index,
                // the spindle turns, but nothing depends on where it stands
                None if axis.spindle => {}
                None => return Err(EngineError::AxisMissing { axis: axis.name }),
            }
        }
        self.wire_index = wire_index;
        self.joints = model.axes().len();
        self.live = LiveInputs::new(model.sensors().len(), config.live_max_age_s, config.ramp_s);
        self.motion.take(model, &self.wire_index);
        Ok(())
    }

    /// A new link: lag and motion are measured anew, and the control tells its tool.
    pub(super) fn restart(&mut self) {
        self.lag.restart();
        self.motion.restart();
        self.tool_tip = None;
    }

    /// The position that counts, in wire units.
    pub(super) fn position(&self, config: &EngineConfig, frame: &Position) -> AxisArray {
        match config.position_source {
            PositionSource::Commanded => frame.commanded,
            PositionSource::Actual => core::array::from_fn(|k| frame.actual[k] - frame.applied[k]),
        }
    }

    /// The correction for a position.
    ///
    /// # Cycle   no allocation
    pub(super) fn at(
        &mut self,
        config: &EngineConfig,
        input: &InputValidation,
        model: &Model,
        now: &CycleInput<'_>,
    ) -> Setpoint {
        let CycleInput { position, gain, .. } = *now;
        let mut pose = Pose { tool_tip: self.tool_tip, ..Pose::at([0.0; MAX_AXES]) };
        self.live.advance(now.time, now.dt, &mut pose.live);
        let ahead_s = self.lag.cycles() * config.cycle_s;
        let unsure_s = config.lag_uncertainty_cycles * config.cycle_s;
        let speed = input.speed();
        for (k, &wire) in self.wire_index.iter().enumerate().take(self.joints) {
            if wire < MAX_AXES {
                let scale = self.scale[wire];
                let size = config.limits[wire].size;
                let (at, ahead) = (position[wire], position[wire] + speed[wire] * ahead_s);
                pose.fixed |= u16::from(size <= 0.0) << k;
                pose.position[k] = within_travel(at * scale, ahead * scale, model.travel(k), size);
                pose.spread[k] = (speed[wire] * unsure_s * scale).abs();
                pose.travel[k] = input.travel()[wire];
            }
        }
        let moving = !model.dynamics().is_empty();
        if moving {
            self.follow_motion(model, input, now, ahead_s, &mut pose);
        }
        let (deviation, correction) = model.correct(&pose);
        let flags = deviation.flags;
        let outside = flags.out_of_travel | flags.out_of_range;
        let mut target = Setpoint::NONE;
        for (k, &wire) in self.wire_index.iter().enumerate().take(self.joints) {
            if wire < MAX_AXES {
                let wanted = gain * correction.offset[k];
                target.offset[wire] = wanted;
                target.known[wire] = correction.offset[k];
                target.out_of_range |= u8::from(outside >> k & 1 == 1) << wire;
                target.out_of_travel |= u8::from(flags.out_of_travel >> k & 1 == 1) << wire;
                target.faded |= u8::from(flags.faded >> k & 1 == 1) << wire;
                let limits = &config.limits[wire];
                let beyond = limits.size > 0.0 && wanted.abs() > limits.stop;
                target.beyond_stop |= u8::from(beyond) << wire;
                if !wanted.is_finite() {
                    let detail = Some(Detail::of_axis(wire, wanted, f64::NAN));
                    return Setpoint { finite: false, detail, ..Setpoint::NONE };
                }
                let scale = self.scale[wire];
                if beyond {
                    target.detail = Some(Detail::of_axis(wire, wanted / scale, limits.stop / scale));
                } else if flags.out_of_travel >> k & 1 == 1 && target.beyond_stop == 0 {
                    target.detail = Some(Detail::of_axis(wire, position[wire], f64::NAN));
                }
            }
        }
        if moving && model.has_transients() {
            pose.dynamic = Some(self.motion.signals(model, &self.wire_index, ahead_s, true));
            let (_, with_transients) = model.correct(&pose);
            self.add_transients(config, &correction, &with_transients, gain, &mut target);
        }
        self.keep_inside(config, speed, position, &mut target);
        target
    }

    /// Takes the frame into the estimate of motion; direction of travel and reversal terms of the pose follow from it.
    fn follow_motion(
        &mut self,
        model: &Model,
        input: &InputValidation,
        now: &CycleInput<'_>,
        ahead_s: f64,
        pose: &mut Pose,
    ) {
        let position: AxisArray = core::array::from_fn(|k| now.commanded[k] * self.scale[k]);
        let sample = Sample {
            position: &position,
            offset: &now.offset,
            elapsed_s: input.elapsed_s(),
            ahead_s,
            interrupted: input.was_interrupted() || position.iter().any(|v| !v.is_finite()),
        };
        self.motion.advance(model, &self.wire_index, &sample);
        for (k, &wire) in self.wire_index.iter().enumerate().take(self.joints) {
            if wire < MAX_AXES {
                pose.travel[k] = self.motion.travel(wire);
            }
        }
        pose.dynamic = Some(self.motion.signals(model, &self.wire_index, ahead_s, false));
    }

    /// Adds what follows velocity and acceleration, as far as the size limit leaves room for it: it never asks for more than
    /// the limit, so that it cannot trip the stop limit.
    fn add_transients(
        &self,
        config: &EngineConfig,
        rest: &AxisCorrection,
        with_transients: &AxisCorrection,
        gain: f64,
        target: &mut Setpoint,
    ) {
        let mut transient = [0.0; MAX_AXES];
        for (k, &wire) in self.wire_index.iter().enumerate().take(self.joints) {
            if wire >= MAX_AXES {
                continue;
            }
            let wanted = gain * (with_transients.offset[k] - rest.offset[k]);
            let at_rest = target.offset[wire];
            let size = config.limits[wire].size.max(at_rest.abs());
            let total = (at_rest + wanted).clamp(-size, size);
            if !total.is_finite() {
                target.finite = false;
                return;
            }
            target.limited |= u8::from(total != at_rest + wanted) << wire;
            transient[wire] = total - at_rest;
            target.offset[wire] = total;
            target.known[wire] = with_transients.offset[k];
        }
        target.transient = Some(transient);
    }

    /// Leaves no offset that would carry an axis over its soft limit; where the axis runs towards it, early enough to
    /// retreat in time. An axis that is already outside may only be offset inwards.
    fn keep_inside(
        &self,
        config: &EngineConfig,
        speed: &AxisArray,
        position: &AxisArray,
        target: &mut Setpoint,
    ) {
        let late_s = (self.lag.cycles() + 1.0) * config.cycle_s;
        for (k, [low, high]) in config.soft_limits.iter().enumerate() {
            if *low == f64::NEG_INFINITY && *high == f64::INFINITY {
                continue;
            }
            let (at, v) = (position[k] * self.scale[k], speed[k] * self.scale[k]);
            let room_up = room(high - at, v, late_s, &config.limits[k]);
            let room_down = room(at - low, -v, late_s, &config.limits[k]);
            target.room[k] = [-room_down, room_up];
            let wanted = target.offset[k];
            let kept = wanted.min(room_up).max(-room_down);
            if kept != wanted {
                target.offset[k] = kept;
                target.at_soft_limit |= 1 << k;
            }
        }
    }
}

/// Where an axis at `at` is expected, for which its speed says `ahead`: it stops at the end of its travel, beyond which it stands by
/// its offset, at most `size`. One that is farther out goes on.
fn within_travel(at: f64, ahead: f64, travel: Option<[f64; 2]>, size: f64) -> f64 {
    match travel {
        Some([low, high]) if at >= low - size && at <= high + size => ahead.max(low).min(high),
        _ => ahead,
    }
}

/// The offset that may be left towards a soft limit at `distance`, approached at `speed`: on the way there what is left
/// when the offset takes effect, `late_s` from now, and no more than can still be taken back, with [`RETREAT`] of rate and
/// acceleration, before the axis is there; on the way back what was left as long ago, for the motor may be as far behind.
fn room(distance: f64, speed: f64, late_s: f64, limits: &AxisLimits) -> f64 {
    if !distance.is_finite() {
        return distance.max(0.0);
    }
    let left = (distance - speed.abs() * late_s).max(0.0);
    if speed.is_nan() || speed <= 0.0 {
        return left;
    }
    let left_s = left / speed;
    let (rate, acceleration) = (RETREAT * limits.rate, RETREAT * limits.acceleration);
    let to_full_rate_s = 2.0 * rate / acceleration;
    let way = if left_s < to_full_rate_s {
        acceleration * left_s * left_s / 4.0
    } else {
        rate * (left_s - to_full_rate_s / 2.0)
    };
    left.min(way)
}
