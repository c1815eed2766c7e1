//! What the engine must be told before it may move anything.

use super::lookahead::{LAG_CYCLES_MAX, Lag};
use volcomp_model::axes::{AxisName, MAX_AXES};

/// An offset found on a new link is led back where it is at most so many times the size limit (a limit that was
/// lowered, a restart); a larger one is a fault (VC-4007) and nothing is sent.
pub const FOUND_FACTOR: f64 = 2.0;
/// The largest offset of a linear axis without limits in the machine file that is answered unchanged, mm.
pub const UNLISTED_MAX_MM: f64 = 1.0;
/// The same for a rotary axis, degrees.
pub const UNLISTED_MAX_DEG: f64 = 0.1;

/// Limits of the offset of one axis: mm, mm/s, mm/s^2 (rotary: rad, rad/s, rad/s^2).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisLimits {
    /// Offset at which a warning is reported.
    pub warning: f64,
    /// Offset that is never exceeded.
    pub size: f64,
    /// Correction beyond which something must be wrong: a fault, and the offset is taken back.
    pub stop: f64,
    /// Rate of change that is never exceeded.
    pub rate: f64,
    /// Change of the rate that is never exceeded.
    pub acceleration: f64,
    /// Change of the offset from one answer to the next that is never exceeded, whatever time has passed: mm or rad.
    pub step: f64,
}

impl AxisLimits {
    /// The fastest change of the offset at this cycle: mm/s or rad/s.
    #[must_use]
    pub fn fastest(&self, cycle_s: f64) -> f64 {
        self.rate.min(self.step / cycle_s)
    }

    /// Time from rest at the size limit to rest at zero, s.
    #[must_use]
    pub fn leaving_s(&self, cycle_s: f64) -> f64 {
        let (distance, rate, acceleration) = (self.size, self.fastest(cycle_s), self.acceleration);
        // with a stretch at full rate, or turning round half way
        if rate * rate <= distance * acceleration {
            distance / rate + rate / acceleration
        } else {
            2.0 * (distance / acceleration).sqrt()
        }
    }
}

/// Which position the errors are looked up at.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum PositionSource {
    /// The commanded position, free of any offset (the default; no feedback of the correction).
    #[default]
    Commanded,
    /// The actual position minus the applied offset.
    Actual,
}

/// What happens where an axis leaves the travel that the model was made for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum OutOfTravel {
    /// The errors at the end of the travel are held.
    #[default]
    Hold,
    /// The correction is ramped out until all axes are back.
    RampOut,
}

/// Which offset is left when the daemon stops.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum RestOffset {
    /// The offset is ramped to zero.
    #[default]
    Zero,
    /// The last offset stays.
    Hold,
}

/// What follows once positions were lost for so long that the offset is back at zero.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum AfterLoss {
    /// A fault: compensation stays off until a person has looked.
    #[default]
    Latch,
    /// Armed: it comes back by itself with good positions.
    Resume,
}

/// Whose time the limits of rate and acceleration hold in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum LimitTime {
    /// The control's time stamps: for a simulated control that runs faster than real time.
    #[default]
    Control,
    /// The control's time stamps, and this computer's clock where that has advanced less.
    Computer,
}

/// Everything the engine is configured with. Axes are in the control's wire order. The default is no valid configuration.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct EngineConfig {
    /// Axis letters in the order of the link.
    pub axes: Vec<AxisName>,
    /// Limits, one per axis; an axis with size limit 0 is never offset.
    pub limits: Vec<AxisLimits>,
    /// Interval between position frames, s.
    pub cycle_s: f64,
    /// Whose time the limits of rate and acceleration hold in.
    pub limit_time: LimitTime,
    /// Duration of every ramp, s of control time.
    pub ramp_s: f64,
    /// Age of the newest position at which it is stale, s.
    pub stale_s: f64,
    /// How long the last offset is held when data are stale or implausible before it is ramped out, s.
    pub hold_s: f64,
    /// After that.
    pub after_loss: AfterLoss,
    /// Largest plausible change of a position from one frame to the next, mm or rad per axis.
    pub jump_limit: Vec<f64>,
    /// Share of the correction to apply, 0 to 1.
    pub gain: f64,
    /// Which position the errors are looked up at.
    pub position_source: PositionSource,
    /// Beyond the travel.
    pub out_of_travel: OutOfTravel,
    /// On stop.
    pub rest: RestOffset,
    /// Travel after which a reversal counts as one, mm or rad per axis (keeps noise from switching curves).
    pub reversal_deadband: Vec<f64>,
    /// Difference between the offset asked for and the one read back that is tolerated, mm or rad per axis.
    pub read_back_tolerance: Vec<f64>,
    /// Cycles after which the read-back must show an offset.
    pub read_back_cycles: u32,
    /// Soft limits of the machine, mm or rad per axis; infinite where there are none.
    pub soft_limits: Vec<[f64; 2]>,
    /// From a position to the effect of its correction.
    pub lag: Lag,
    /// By how much the lag may be off, in control cycles (an offset that is held for a cycle: half a cycle).
    pub lag_uncertainty_cycles: f64,
    /// Age at which a live value counts as lost, s.
    pub live_max_age_s: f64,
}

impl EngineConfig {
    /// Checks everything that does not depend on a model.
    ///
    /// # Errors
    /// The first rule broken.
    pub fn validate(&self) -> Result<(), EngineError> {
        let expected = self.axes.len();
        if expected > MAX_AXES {
            return Err(EngineError::TooManyAxes { found: expected });
        }
        for (what, found) in [
            ("limits", self.limits.len()),
            ("jump limits", self.jump_limit.len()),
            ("reversal dead bands", self.reversal_deadband.len()),
            ("read-back tolerances", self.read_back_tolerance.len()),
            ("soft limits", self.soft_limits.len()),
        ] {
            if found != expected {
                return Err(EngineError::Length { what, expected, found });
            }
        }
        for (what, value) in [
            ("cycle", self.cycle_s),
            ("ramp", self.ramp_s),
            ("stale age", self.stale_s),
            ("age of live values", self.live_max_age_s),
        ] {
            positive(what, value)?;
        }
        not_negative("hold time", self.hold_s)?;
        if !(0.0..=1.0).contains(&self.gain) {
            return Err(EngineError::Range { what: "gain", must: "from 0 to 1", value: self.gain });
        }
        for limits in &self.limits {
            not_negative("size limit", limits.size)?;
            if limits.size > 0.0 {
                positive("warning limit", limits.warning)?;
                positive("rate limit", limits.rate)?;
                positive("acceleration limit", limits.acceleration)?;
                above_zero("step limit", limits.step)?;
                above_zero("stop limit", limits.stop)?;
            }
        }
        not_negative("uncertainty of the lag", self.lag_uncertainty_cycles)?;
        if let Lag::Cycles(cycles) = self.lag
            && !(0.0..=LAG_CYCLES_MAX as f64).contains(&cycles)
        {
            return Err(EngineError::Range { what: "lag", must: "from 0 to 32 cycles", value: cycles });
        }
        for [low, high] in &self.soft_limits {
            if low.is_nan() || high.is_nan() || low >= high {
                return Err(EngineError::Range {
                    what: "lower soft limit",
                    must: "below the upper one",
                    value: *low,
                });
            }
        }
        for value in &self.jump_limit {
            positive("jump limit", *value)?;
        }
        for value in &self.reversal_deadband {
            not_negative("reversal dead band", *value)?;
        }
        for value in &self.read_back_tolerance {
            positive("read-back tolerance", *value)?;
        }
        Ok(())
    }
}

fn positive(what: &'static str, value: f64) -> Result<(), EngineError> {
    if value.is_finite() && value > 0.0 {
        Ok(())
    } else {
        Err(EngineError::Range { what, must: "above 0", value })
    }
}

/// Like [`positive`]; infinite means no limit.
fn above_zero(what: &'static str, value: f64) -> Result<(), EngineError> {
    if value > 0.0 { Ok(()) } else { Err(EngineError::Range { what, must: "above 0", value }) }
}

fn not_negative(what: &'static str, value: f64) -> Result<(), EngineError> {
    if value.is_finite() && value >= 0.0 {
        Ok(())
    } else {
        Err(EngineError::Range { what, must: "0 or above", value })
    }
}

/// Why an engine cannot be built.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum EngineError {
    /// A list does not have one entry per axis.
    #[error("{what}: {found} entries for {expected} axes")]
    Length {
        /// The list.
        what: &'static str,
        /// Number of axes.
        expected: usize,
        /// Number of entries.
        found: usize,
    },
    /// More axes than the link carries.
    #[error("{found} axes exceed the limit of {limit}", limit = MAX_AXES)]
    TooManyAxes {
        /// Number of axes.
        found: usize,
    },
    /// A quantity that must be positive (or within its range) is not.
    #[error("{what} must be {must}, found {value}")]
    Range {
        /// The quantity.
        what: &'static str,
        /// Its range in words.
        must: &'static str,
        /// The value found.
        value: f64,
    },
    /// The model corrects an axis that the control does not have.
    #[error("the model has axis {axis}, the control has not")]
    AxisMissing {
        /// The axis.
        axis: AxisName,
    },
}
