//! Is this position frame believable? Finite, in order, in time, and no further away than an axis can go.

use super::config::EngineConfig;
use super::output::Reason;
use crate::core::axes::{AxisArray, MAX_AXES, Travel};
use crate::core::protocol::Position;
use crate::core::units::NS_PER_S;

/// Good frames in a row before compensation starts again.
pub(super) const GOOD_FRAMES: u32 = 10;
/// The most cycles that one frame may stand for; more than that is a jump of the clock.
const CYCLES_LOST_MAX: f64 = 1000.0;

/// Judges frames by those before them.
#[derive(Debug, Clone)]
pub(super) struct Intake {
    axes: usize,
    cycle_s: f64,
    jump_limit: AxisArray,
    deadband: AxisArray,
    last: Option<Last>,
    travel: [Travel; MAX_AXES],
    /// Furthest position in the present direction of travel.
    turning_point: AxisArray,
    good: u32,
}

#[derive(Debug, Clone, Copy)]
struct Last {
    sequence: u32,
    control_ns: i64,
    position: AxisArray,
}

impl Intake {
    pub(super) fn new(config: &EngineConfig, scale: &AxisArray) -> Self {
        let mut jump_limit = [0.0; MAX_AXES];
        let mut deadband = [0.0; MAX_AXES];
        // the configuration is in mm and rad, frames are in mm and deg
        for (k, scale) in scale.iter().enumerate().take(config.axes.len()) {
            jump_limit[k] = config.jump_limit[k] / scale;
            deadband[k] = config.reversal_deadband[k] / scale;
        }
        Self {
            axes: config.axes.len(),
            cycle_s: config.cycle_s,
            jump_limit,
            deadband,
            last: None,
            travel: [Travel::Forward; MAX_AXES],
            turning_point: [0.0; MAX_AXES],
            good: 0,
        }
    }

    /// A new link: nothing of the old one may be compared with it.
    pub(super) fn restart(&mut self) {
        self.last = None;
        self.good = 0;
    }

    /// Good frames in a row, counted up to [`GOOD_FRAMES`].
    pub(super) const fn is_settled(&self) -> bool {
        self.good >= GOOD_FRAMES
    }

    /// A silence has passed: frames must prove themselves again.
    pub(super) const fn unsettle(&mut self) {
        self.good = 0;
    }

    /// Direction of travel of each axis.
    pub(super) const fn travel(&self) -> &[Travel; MAX_AXES] {
        &self.travel
    }

    /// Seconds of control time since the frame before.
    ///
    /// # Errors
    /// Why the frame must not be used. It is compared with the next one all the same (except where it is not
    /// finite), so that a real jump is one bad frame and not an endless row of them.
    pub(super) fn accept(&mut self, frame: &Position, position: &AxisArray) -> Result<f64, Reason> {
        let used = ..self.axes;
        let finite = |v: &AxisArray| v[used].iter().all(|x| x.is_finite());
        if !(finite(position) && finite(&frame.applied)) {
            self.good = 0;
            return Err(Reason::NotFinite);
        }
        let Some(last) = self.last else {
            self.remember(frame, position);
            self.turning_point = *position;
            return Ok(0.0);
        };
        let verdict = self.compare(&last, frame, position);
        match verdict {
            Ok(_) => self.good = self.good.saturating_add(1),
            Err(_) => self.good = 0,
        }
        // an old or repeated frame is no new reference
        if verdict != Err(Reason::Sequence) {
            self.remember(frame, position);
            self.follow(position);
        }
        verdict
    }

    fn remember(&mut self, frame: &Position, position: &AxisArray) {
        self.last =
            Some(Last { sequence: frame.sequence, control_ns: frame.control_ns, position: *position });
    }

    fn compare(&self, last: &Last, frame: &Position, position: &AxisArray) -> Result<f64, Reason> {
        // wraps at 2^32: anything in the upper half lies in the past
        let ahead = frame.sequence.wrapping_sub(last.sequence);
        if ahead == 0 || ahead > u32::MAX / 2 {
            return Err(Reason::Sequence);
        }
        let dt = frame.control_ns.saturating_sub(last.control_ns) as f64 / NS_PER_S;
        let cycles = dt / self.cycle_s;
        if !(dt > 0.0 && cycles <= CYCLES_LOST_MAX.max(2.0 * f64::from(ahead))) {
            return Err(Reason::ControlClock);
        }
        let reach = cycles.max(f64::from(ahead)).max(1.0);
        let moves = position.iter().zip(&last.position).zip(&self.jump_limit).take(self.axes);
        let jumped = moves.into_iter().any(|((now, before), limit)| (now - before).abs() > limit * reach);
        if jumped { Err(Reason::Jump) } else { Ok(dt) }
    }

    /// Turns the direction of travel where an axis has come back by more than the dead band.
    fn follow(&mut self, position: &AxisArray) {
        for (k, &position) in position.iter().enumerate().take(self.axes) {
            let beyond = position - self.turning_point[k];
            let (onward, back) = match self.travel[k] {
                Travel::Forward => (beyond > 0.0, beyond < -self.deadband[k]),
                Travel::Reverse => (beyond < 0.0, beyond > self.deadband[k]),
            };
            if back {
                self.travel[k] = self.travel[k].reversed();
            }
            if onward || back {
                self.turning_point[k] = position;
            }
        }
    }
}
