//! Plausibility of a position frame: finite, in order, in time, and no further away than an axis can go.

use super::config::EngineConfig;
use super::output::{Detail, Quantity, Reason};
use volcomp_model::axes::{AxisArray, MAX_AXES, Travel};
use volcomp_model::units::NS_PER_S;
use volcomp_protocol::{MachineState, Position};

/// Good frames in a row before compensation starts again.
pub(super) const GOOD_FRAMES: u32 = 10;
/// The most cycles by which a control's clock may run ahead of its count (a pause of the control); more is a jump.
const CYCLES_AHEAD_MAX: f64 = 20.0;

/// So many frames out of order that follow each other are the right ones.
const STRAYS: u32 = 5;
/// Path at the feed told, in mm, after which positions that do not change at all are frozen. Coarse enough for
/// controls that round positions to a micrometre.
const FROZEN_MM: f64 = 0.05;
const SECONDS_PER_MINUTE: f64 = 60.0;

/// Judges frames by those before them.
#[derive(Debug, Clone)]
pub(super) struct InputValidation {
    axes: usize,
    cycle_s: f64,
    jump_limit: AxisArray,
    deadband: AxisArray,
    last: Option<Last>,
    /// Number of the newest frame in order, used or not.
    newest: Option<u32>,
    travel: [Travel; MAX_AXES],
    /// Furthest position in the present direction of travel.
    turning_point: AxisArray,
    good: u32,
    /// Wire units per second between the last two good frames.
    speed: AxisArray,
    /// Control time between the last two good frames, s.
    elapsed_s: f64,
    /// The last frame that was out of order: number, time, and how many before it followed each other.
    stray: Option<(u32, i64, u32)>,
    /// Path that the feed says was travelled while no axis moved, mm.
    unmoved_mm: f64,
    /// The numbers behind the last frame that was not believed.
    pub(super) detail: Option<Detail>,
}

#[derive(Debug, Clone, Copy)]
struct Last {
    sequence: u32,
    control_ns: i64,
    position: AxisArray,
}

/// Wraps at 2^32: anything in the upper half lies in the past.
const fn is_not_after(newest: u32, sequence: u32) -> bool {
    let ahead = sequence.wrapping_sub(newest);
    ahead == 0 || ahead > u32::MAX / 2
}

impl InputValidation {
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
            newest: None,
            travel: [Travel::Forward; MAX_AXES],
            turning_point: [0.0; MAX_AXES],
            good: 0,
            speed: [0.0; MAX_AXES],
            elapsed_s: 0.0,
            stray: None,
            unmoved_mm: 0.0,
            detail: None,
        }
    }

    /// A new link: nothing of the old one may be compared with it.
    pub(super) fn restart(&mut self) {
        (self.last, self.newest) = (None, None);
        self.good = 0;
        self.speed = [0.0; MAX_AXES];
        self.elapsed_s = 0.0;
        self.unmoved_mm = 0.0;
    }

    /// Good frames in a row, counted up to [`GOOD_FRAMES`].
    pub(super) const fn is_settled(&self) -> bool {
        self.good >= GOOD_FRAMES
    }

    /// A silence has passed: frames must prove themselves again.
    pub(super) const fn unsettle(&mut self) {
        self.good = 0;
    }

    /// Speed of each axis between the last two good frames, wire units per second.
    pub(super) const fn speed(&self) -> &AxisArray {
        &self.speed
    }

    /// Control time from the good frame before to the newest good one, s; 0 where there is none.
    pub(super) const fn elapsed_s(&self) -> f64 {
        self.elapsed_s
    }

    /// True where the frame before the newest good one was not good.
    pub(super) const fn was_interrupted(&self) -> bool {
        self.good <= 1
    }

    /// Direction of travel of each axis.
    pub(super) const fn travel(&self) -> &[Travel; MAX_AXES] {
        &self.travel
    }

    /// Seconds of control time since the frame before: none for the first of a link, one cycle after frames that were not finite.
    ///
    /// # Errors
    /// Why the frame must not be used. It is compared with the next one all the same (except where it is not
    /// finite), so that a real jump is one bad frame and not an endless row of them.
    pub(super) fn accept(&mut self, frame: &Position, position: &AxisArray) -> Result<f64, Reason> {
        self.detail = None;
        let used = ..self.axes;
        let bad = |v: &AxisArray| v[used].iter().position(|x| !x.is_finite()).map(|k| (k, v[k]));
        let not_finite = bad(position).or_else(|| bad(&frame.applied));
        if self.newest.is_some_and(|newest| is_not_after(newest, frame.sequence)) {
            self.good = 0;
            self.speed = [0.0; MAX_AXES];
            // an old or repeated frame is no new reference, but several in good order among themselves are
            if self.is_new_count(frame) {
                if not_finite.is_none() {
                    self.remember(frame, position);
                    self.follow(position);
                } else {
                    (self.last, self.newest) = (None, Some(frame.sequence));
                }
            }
            return Err(Reason::Sequence);
        }
        if let Some((axis, value)) = not_finite {
            self.newest = Some(frame.sequence);
            self.stray = None;
            self.good = 0;
            self.detail = Some(Detail::of_axis(axis, value, f64::NAN));
            return Err(Reason::NotFinite);
        }
        let Some(last) = self.last else {
            // time has passed since frames that were not finite, though no position tells how much
            let since = self.newest.map_or(0.0, |_| self.cycle_s);
            self.remember(frame, position);
            self.turning_point = *position;
            return Ok(since);
        };
        let verdict = self.compare(&last, frame, position);
        let verdict = verdict.and_then(|dt| self.watch_motion(&last, frame, position, dt));
        match verdict {
            Ok(dt) => {
                self.good = self.good.saturating_add(1);
                self.elapsed_s = dt;
                for (k, speed) in self.speed.iter_mut().enumerate().take(self.axes) {
                    *speed = (position[k] - last.position[k]) / dt;
                }
            }
            Err(_) => {
                self.good = 0;
                self.speed = [0.0; MAX_AXES];
            }
        }
        // a number ahead of its time is no new reference, but several in good order among themselves are
        if verdict != Err(Reason::Sequence) || self.is_new_count(frame) {
            self.remember(frame, position);
            self.follow(position);
        }
        verdict
    }

    /// True for the last of [`STRAYS`] frames out of order that follow each other: the one before them was the stray.
    fn is_new_count(&mut self, frame: &Position) -> bool {
        let follows = self.stray.is_some_and(|(sequence, ns, _)| {
            frame.sequence.wrapping_sub(sequence) == 1 && frame.control_ns > ns
        });
        let count = if follows { self.stray.map_or(1, |(_, _, count)| count + 1) } else { 1 };
        self.stray = (count < STRAYS).then_some((frame.sequence, frame.control_ns, count));
        count >= STRAYS
    }

    fn remember(&mut self, frame: &Position, position: &AxisArray) {
        self.stray = None;
        self.newest = Some(frame.sequence);
        self.last =
            Some(Last { sequence: frame.sequence, control_ns: frame.control_ns, position: *position });
    }

    fn compare(&mut self, last: &Last, frame: &Position, position: &AxisArray) -> Result<f64, Reason> {
        let ahead = frame.sequence.wrapping_sub(last.sequence);
        let dt = frame.control_ns.saturating_sub(last.control_ns) as f64 / NS_PER_S;
        let cycles = dt / self.cycle_s;
        // a number that runs ahead of its own time is a stray: an answer that names it would be in the future, and it must
        // be reached before so many strays have made another count that the next answer is a step further
        if f64::from(ahead) >= cycles.max(0.0).round() + f64::from(STRAYS) {
            return Err(Reason::Sequence);
        }
        // a clock that runs ahead of the cycles counted has stepped, and says nothing about how far axes may have gone
        let most = f64::from(ahead) + CYCLES_AHEAD_MAX.max(f64::from(ahead));
        if !(dt > 0.0 && cycles <= most) {
            self.detail = Some(Detail::of_time(dt, most * self.cycle_s));
            return Err(Reason::ControlClock);
        }
        let reach = cycles.max(1.0);
        let moves = position.iter().zip(&last.position).map(|(now, before)| (now - before).abs());
        let jumped = moves.zip(&self.jump_limit).take(self.axes).position(|(way, limit)| way > limit * reach);
        let Some(axis) = jumped else { return Ok(dt) };
        let way = (position[axis] - last.position[axis]).abs();
        self.detail = Some(Detail::of_axis(axis, way, self.jump_limit[axis] * reach));
        Err(Reason::Jump)
    }

    /// A machine that says it moves must move.
    fn watch_motion(
        &mut self,
        last: &Last,
        frame: &Position,
        position: &AxisArray,
        dt: f64,
    ) -> Result<f64, Reason> {
        let moved = position.iter().zip(&last.position).take(self.axes).any(|(now, before)| now != before);
        let feed = frame.feed_mm_per_min;
        if moved || !frame.state.has(MachineState::MOVING) || !(feed.is_finite() && feed > 0.0) {
            self.unmoved_mm = 0.0;
            return Ok(dt);
        }
        self.unmoved_mm += feed / SECONDS_PER_MINUTE * dt;
        if self.unmoved_mm <= FROZEN_MM {
            return Ok(dt);
        }
        let quantity = Quantity::Length;
        self.detail = Some(Detail { axis: None, quantity, value: self.unmoved_mm, limit: FROZEN_MM });
        Err(Reason::Frozen)
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
