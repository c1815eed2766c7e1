//! Shadow mode: what the engine would do, worked out beside the machine and never sent.
//!
//! A second [`Compensator`] sees the frames of the machine as they would be if its offsets were applied: what it has
//! asked for is read back one cycle later, and added to the actual position. Everything else is the real machine:
//! states, feeds, gaps, late frames. Its score says how much of the error that the model knows would be left by
//! gain, ramps, limits, holds and fading. What the model does not know it cannot say: measure, or compare with the parts.

use super::compensator::Compensator;
use super::config::{EngineConfig, EngineError};
use super::output::{Command, CycleOutput, State};
use volcomp_model::Model;
use volcomp_model::axes::{AxisArray, MAX_AXES};
use volcomp_model::geometry::Vec3;
use volcomp_model::units::MonoTime;
use volcomp_protocol::Position;

/// One axis of a [`ShadowScore`], mm or rad.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct AxisScore {
    before_squares: f64,
    after_squares: f64,
    /// Largest correction of the model.
    pub before_max: f64,
    /// Largest part of it that would have been left.
    pub after_max: f64,
    /// Cycles in which size, rate or acceleration would have been limited.
    pub limited_cycles: u64,
}

/// What compensation would have done since shadow mode was switched on. Axes in wire order.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ShadowScore {
    /// Frames answered.
    pub cycles: u64,
    /// Of these: with the correction on, ramps done; the figures of the axes are over these.
    pub active_cycles: u64,
    /// Faults that would have been latched.
    pub faults: u64,
    /// Times the correction would have been held or taken out for anything but the operator.
    pub interruptions: u64,
    /// Per axis.
    pub axes: [AxisScore; MAX_AXES],
}

impl ShadowScore {
    /// RMS of the correction of the model, whatever the gain, mm or rad; `None` before the first active cycle.
    #[must_use]
    pub fn before_rms(&self, axis: usize) -> Option<f64> {
        self.rms(self.axes.get(axis)?.before_squares)
    }

    /// RMS of what would have been left of it, mm or rad; `None` before the first active cycle.
    #[must_use]
    pub fn after_rms(&self, axis: usize) -> Option<f64> {
        self.rms(self.axes.get(axis)?.after_squares)
    }

    fn rms(&self, squares: f64) -> Option<f64> {
        (self.active_cycles > 0).then(|| (squares / self.active_cycles as f64).sqrt())
    }

    fn count(&mut self, output: &CycleOutput, before: State) {
        self.cycles += 1;
        self.faults += u64::from(output.state == State::Faulted && before != State::Faulted);
        self.interruptions += u64::from(output.state == State::Holding && before != State::Holding);
        if !matches!(output.state, State::Active | State::FadingToStatic) {
            return;
        }
        self.active_cycles += 1;
        for (k, axis) in self.axes.iter_mut().enumerate() {
            let (known, left) = (output.known[k], output.known[k] - output.offset[k]);
            axis.before_squares += known * known;
            axis.after_squares += left * left;
            axis.before_max = axis.before_max.max(known.abs());
            axis.after_max = axis.after_max.max(left.abs());
            axis.limited_cycles += u64::from(output.limited >> k & 1);
        }
    }
}

/// An engine whose offsets nobody applies. Built once beside the real one, idle until it is switched on.
#[derive(Debug, Clone)]
pub struct Shadow {
    engine: Compensator,
    on: bool,
    /// Asked for at the frame before, wire units: what this frame would read back.
    asked: AxisArray,
    tip: Option<Vec3>,
    score: ShadowScore,
}

impl Shadow {
    /// A shadow engine that is off.
    ///
    /// # Errors
    /// The configuration is incomplete or does not fit the model.
    pub fn new(config: &EngineConfig, model: &Model) -> Result<Self, EngineError> {
        let engine = Compensator::new(config, model)?;
        Ok(Self { engine, on: false, asked: [0.0; MAX_AXES], tip: None, score: ShadowScore::default() })
    }

    /// Switches it on, with a new score, or off.
    ///
    /// # Cycle   no allocation, no panic, bounded time
    pub fn set(&mut self, now: MonoTime, on: bool) {
        self.on = on;
        self.score = ShadowScore::default();
        self.engine.on_command(now, Command::Disable);
        self.begin(now);
        // a fault of the last time is not one of this time
        self.engine.clear();
        if on {
            self.engine.on_command(now, Command::Enable);
        }
    }

    /// True while it is on.
    #[must_use]
    pub const fn is_on(&self) -> bool {
        self.on
    }

    /// A new link; the score goes on.
    pub fn on_link_up(&mut self, now: MonoTime) {
        // the control tells its tool anew on every link
        self.tip = None;
        self.begin(now);
    }

    fn begin(&mut self, now: MonoTime) {
        self.asked = [0.0; MAX_AXES];
        self.engine.on_link_up(now);
        if let Some(tip) = self.tip {
            self.engine.on_tool(tip);
        }
    }

    /// The link is gone.
    pub fn on_link_down(&mut self, now: MonoTime) {
        self.engine.on_link_down(now);
    }

    /// See [`Compensator::on_tool`].
    pub fn on_tool(&mut self, tip: Vec3) {
        self.tip = Some(tip);
        self.engine.on_tool(tip);
    }

    /// See [`Compensator::on_live`].
    pub fn on_live(&mut self, now: MonoTime, channel: usize, value: f64) {
        self.engine.on_live(now, channel, value);
    }

    /// See [`Compensator::on_model`]; the score starts over, for it is the model's.
    ///
    /// # Errors
    /// The model has an axis that the control has not.
    pub fn on_model(&mut self, model: &Model) -> Result<(), EngineError> {
        self.engine.on_model(model)?;
        self.score = ShadowScore::default();
        Ok(())
    }

    /// Another gain, 0 to 1.
    pub fn on_gain(&mut self, now: MonoTime, gain: f64) {
        self.engine.on_command(now, Command::SetGain(gain));
    }

    /// One position frame of the machine.
    ///
    /// # Cycle   no allocation, no panic, bounded time
    pub fn on_position(&mut self, now: MonoTime, frame: &Position, model: &Model) -> Option<CycleOutput> {
        if !self.on {
            return None;
        }
        let mut imagined = *frame;
        for k in 0..MAX_AXES {
            imagined.actual[k] += self.asked[k] - frame.applied[k];
            imagined.applied[k] = self.asked[k];
        }
        let before = self.engine.state();
        let output = self.engine.on_position(now, &imagined, model)?;
        self.take(&output, before);
        Some(output)
    }

    /// No position has arrived: see [`Compensator::on_deadline`].
    pub fn on_deadline(&mut self, now: MonoTime) -> Option<CycleOutput> {
        if !self.on {
            return None;
        }
        let before = self.engine.state();
        let output = self.engine.on_deadline(now)?;
        self.take(&output, before);
        Some(output)
    }

    /// The state that the engine would be in.
    #[must_use]
    pub const fn state(&self) -> State {
        self.engine.state()
    }

    /// The score so far.
    #[must_use]
    pub const fn score(&self) -> &ShadowScore {
        &self.score
    }

    fn take(&mut self, output: &CycleOutput, before: State) {
        self.asked = self.engine.message(output).offset;
        self.score.count(output, before);
    }
}
