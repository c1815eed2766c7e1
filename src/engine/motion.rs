//! The motion of each axis, estimated from the commanded positions that the control reports: velocity, acceleration, direction of
//! travel of command plus offset, distance and time since the last reversal; and from that the signals of a model's
//! dynamic terms at the moment at which a correction takes effect.
//!
//! A polynomial fading-memory filter of second degree per axis: exact for constant acceleration, O(1), no allocation. Its
//! memory is as short as the noise of the positions allows (quantisation, encoder): the noise is the median of the third
//! differences, and the memory follows from the noise that a correction may have ([`CORRECTION_NOISE_MM`]).
//!
//! Assumptions: frames are regular up to missing ones. After a gap the velocity is that over the gap; after an implausible
//! frame or a silence the filter begins anew at rest, so that transient signals return to zero. The direction is kept.
//!
//! Source: Morrison, Introduction to Sequential Smoothing and Prediction, 1969, ch. 9 (fading-memory polynomial filters).

use volcomp_model::axes::{AxisArray, MAX_AXES, Travel};
use volcomp_model::{AxisMotion, DYNAMIC_MAX, Law, Model};

/// Noise of a correction that the memory of the filter is chosen for, mm.
const CORRECTION_NOISE_MM: f64 = 0.3e-3;
/// The same for angles, rad: 0.3 um at 0.3 m.
const CORRECTION_NOISE_RAD: f64 = 1e-6;
/// The dead band of reversals is so many standard deviations of the extrapolated position.
const DIRECTION_NOISE: f64 = 8.0;
/// Shortest and longest memory: share of a sample in the estimate.
const SHARE_MAX: f64 = 0.7;
const SHARE_MIN: f64 = 0.04;
/// Noise of velocity and acceleration of the filter: `sigma_v = VELOCITY share^1.5 sigma / dt`, `sigma_a = ACCELERATION
/// share^2.5 sigma / dt^2`, for small shares.
const VELOCITY: f64 = 1.4;
const ACCELERATION: f64 = 0.9;
/// Median of the absolute third difference of white noise of unit variance: 0.6745 sqrt(20).
const MEDIAN_PER_SIGMA: f64 = 3.016;
/// Relative step of the median per cycle.
const MEDIAN_STEP: f64 = 0.02;
/// Noise of positions before any is known, and the least that is assumed, mm or rad.
const NOISE_FIRST: f64 = 3e-4;
const NOISE_LEAST: f64 = 1e-6;
/// Noise of positions that is added to the dead band of reversals, in standard deviations.
const NOISE_DEAD_BAND: f64 = 4.0;
/// A gap of so many cycles begins the filter anew.
const GAP_CYCLES: f64 = 3.5;
/// An axis moves where it has gone so many dead bands in the last so many cycles.
const ACTIVE: f64 = 30.0;
const ACTIVITY_CYCLES: f64 = 32.0;
/// Speeds below so many dead bands per second are standstill.
const STANDSTILL_PER_S: f64 = 0.1;

/// The motion of one axis; mm or rad, s.
#[derive(Debug, Clone, Copy)]
struct AxisState {
    position: f64,
    velocity: f64,
    acceleration: f64,
    /// The newest positions, newest first.
    last: [f64; 3],
    /// Samples since the filter began, up to 3.
    samples: u32,
    /// Noise of the positions.
    noise: f64,
    /// Gains of velocity and acceleration in the corrections, each over the noise that a correction may have.
    gains: [f64; 2],
    dead_band: f64,
    /// +1, -1; 0 before the axis has moved.
    direction: f64,
    /// Furthest position of command plus offset in this direction.
    turning_point: f64,
    /// Where command plus offset turned last.
    reversed_at: f64,
    /// Time since then, s.
    since_s: f64,
    /// Time since command plus offset was at the turning point, s.
    behind_s: f64,
    /// Way that command plus offset has gone on, or back from the turning point, in the last cycle.
    step: f64,
    /// Way of the last [`ACTIVITY_CYCLES`] cycles or so.
    activity: f64,
    /// Command plus offset is known.
    started: bool,
}

impl AxisState {
    const fn new(dead_band: f64) -> Self {
        Self {
            position: 0.0,
            velocity: 0.0,
            acceleration: 0.0,
            last: [0.0; 3],
            samples: 0,
            noise: NOISE_FIRST,
            gains: [0.0; 2],
            dead_band,
            direction: 0.0,
            turning_point: 0.0,
            reversed_at: f64::NAN,
            since_s: f64::INFINITY,
            behind_s: 0.0,
            step: 0.0,
            activity: 0.0,
            started: false,
        }
    }

    /// Forgets velocity and acceleration; direction and noise stay.
    const fn rest(&mut self) {
        self.samples = 0;
        self.velocity = 0.0;
        self.acceleration = 0.0;
    }

    /// Frames are missing: the velocity is that between the position before and the next one.
    fn bridge(&mut self) {
        self.samples = self.samples.min(1);
        self.acceleration = 0.0;
    }

    /// One sample after `dt` seconds; `share`-wise as the noise allows.
    fn sample(&mut self, position: f64, dt: f64, ahead_s: f64, cycle_s: f64) {
        // a position that is no number says nothing: the axis counts as at rest where it was
        let position = if position.is_finite() { position } else { self.last[0] };
        if self.samples == 0 || dt <= 0.0 {
            (self.position, self.last, self.samples) = (position, [position; 3], 1);
            return;
        }
        self.measure_noise(position);
        let share = self.share(dt, ahead_s);
        let kept = 1.0 - share;
        let predicted = self.position + (self.velocity + 0.5 * self.acceleration * dt) * dt;
        let residual = position - predicted;
        self.position = predicted + (1.0 - kept * kept * kept) * residual;
        self.velocity += self.acceleration * dt + 1.5 * share * share * (1.0 + kept) * residual / dt;
        self.acceleration += share * share * share * residual / (dt * dt);
        self.samples = (self.samples + 1).min(4);
        if self.samples == 2 {
            // two positions know a velocity
            (self.position, self.velocity, self.acceleration) =
                (position, (position - self.last[0]) / dt, 0.0);
        }
        let whole = position == self.last[0] && position == self.last[1] && position == self.last[2];
        if whole && dt < 1.5 * cycle_s {
            // an axis that stands still is known to stand still
            (self.position, self.velocity, self.acceleration) = (position, 0.0, 0.0);
        }
        self.last = [position, self.last[0], self.last[1]];
    }

    /// Moves the median of the third differences; at standstill they say nothing.
    fn measure_noise(&mut self, position: f64) {
        if self.samples < 4 {
            return;
        }
        let [a, b, c] = self.last;
        if position == a && a == b && b == c {
            return;
        }
        let third = (position - 3.0 * a + 3.0 * b - c).abs();
        let step = if third > MEDIAN_PER_SIGMA * self.noise { 1.0 + MEDIAN_STEP } else { 1.0 - MEDIAN_STEP };
        self.noise = (self.noise * step).clamp(NOISE_LEAST, 100.0 * NOISE_FIRST);
    }

    /// The share of a sample at which velocity and acceleration are as quiet as the corrections ask for, and the position
    /// ahead as quiet as reversals do.
    fn share(&self, dt: f64, ahead_s: f64) -> f64 {
        let per_length = DIRECTION_NOISE / self.dead_band.max(NOISE_LEAST);
        let per_velocity = self.gains[0] + per_length * ahead_s;
        let per_acceleration = self.gains[1] + 0.5 * per_length * ahead_s * ahead_s;
        let by_velocity = (VELOCITY * self.noise * per_velocity / dt).max(1e-9).powf(-1.0 / 1.5);
        let by_acceleration =
            (ACCELERATION * self.noise * per_acceleration / (dt * dt)).max(1e-9).powf(-1.0 / 2.5);
        by_velocity.min(by_acceleration).clamp(SHARE_MIN, SHARE_MAX)
    }

    /// Where the axis will be in `ahead_s`.
    fn predicted(&self, ahead_s: f64) -> f64 {
        self.position + (self.velocity + 0.5 * self.acceleration * ahead_s) * ahead_s
    }

    /// Turns the direction where command plus offset has come back by more than the dead band. The position of an axis that
    /// moves is extrapolated to the moment of effect; that of one that stands, or dithers, is taken as it is reported.
    fn follow(&mut self, offset: f64, ahead_s: f64, dt: f64) {
        let is_moving = self.activity > ACTIVE * self.dead_band;
        let at = offset + if is_moving { self.predicted(ahead_s) } else { self.last[0] };
        self.since_s += dt;
        self.behind_s += dt;
        self.step = 0.0;
        if !self.started {
            (self.started, self.turning_point) = (true, at);
            return;
        }
        self.activity += (self.last[0] - self.last[1]).abs() - self.activity / ACTIVITY_CYCLES;
        let beyond = at - self.turning_point;
        // what noise may do is no reversal
        let dead_band = self.dead_band + NOISE_DEAD_BAND * self.noise;
        if self.direction == 0.0 {
            if beyond.abs() > dead_band {
                self.direction = beyond.signum();
                (self.turning_point, self.behind_s) = (at, 0.0);
            }
            return;
        }
        let onward = beyond * self.direction;
        if onward < -dead_band {
            // the reversal was at the turning point, when it was there
            self.direction = -self.direction;
            (self.reversed_at, self.since_s, self.step) = (self.turning_point, self.behind_s, -onward);
            (self.turning_point, self.behind_s) = (at, 0.0);
        } else if onward > 0.0 {
            self.step = onward;
            (self.turning_point, self.behind_s) = (at, 0.0);
        }
    }

    fn motion(&self, ahead_s: f64) -> AxisMotion {
        let velocity = self.velocity + self.acceleration * ahead_s;
        let still = STANDSTILL_PER_S * self.dead_band;
        let velocity = if velocity.abs() <= still { 0.0 } else { velocity };
        let since = (self.turning_point - self.reversed_at).abs();
        AxisMotion {
            velocity,
            acceleration: self.acceleration,
            direction: self.direction,
            since: if since.is_nan() { f64::INFINITY } else { since },
            since_s: self.since_s,
        }
    }
}

/// The motion of all axes, in wire order, and the memory of the reversal terms of a model.
#[derive(Debug, Clone)]
pub(super) struct MotionEstimator {
    cycle_s: f64,
    axes: [AxisState; MAX_AXES],
    /// Built-up half of each reversal term, -1 to 1.
    built_up: [f64; DYNAMIC_MAX],
}

/// Input of the estimator in a cycle. Wire order, mm and rad.
pub(super) struct Sample<'a> {
    /// Reported positions without any offset.
    pub(super) position: &'a AxisArray,
    /// The offset sent last.
    pub(super) offset: &'a AxisArray,
    /// Control time since the last good frame, s; 0 where there is none.
    pub(super) elapsed_s: f64,
    /// From this frame to the effect of its correction, s.
    pub(super) ahead_s: f64,
    /// The frame before was not good.
    pub(super) interrupted: bool,
}

impl MotionEstimator {
    /// Nothing has moved. `dead_band`: mm and rad, wire order.
    pub(super) fn new(cycle_s: f64, dead_band: &AxisArray) -> Self {
        Self { cycle_s, axes: dead_band.map(AxisState::new), built_up: [0.0; DYNAMIC_MAX] }
    }

    /// Another link: the axes may have moved in any direction meanwhile.
    pub(super) fn restart(&mut self) {
        for axis in &mut self.axes {
            let noise = axis.noise;
            *axis = AxisState { noise, gains: axis.gains, ..AxisState::new(axis.dead_band) };
        }
        self.built_up = [0.0; DYNAMIC_MAX];
    }

    /// Another model: how much velocity and acceleration count, by the axes' wire indices.
    pub(super) fn take(&mut self, model: &Model, wire_index: &[usize; MAX_AXES]) {
        for axis in &mut self.axes {
            axis.gains = [0.0; 2];
        }
        for d in model.dynamics() {
            let Some(axis) = wire_index.get(d.axis).and_then(|wire| self.axes.get_mut(*wire)) else {
                continue;
            };
            let allowed = if d.component.is_angle() { CORRECTION_NOISE_RAD } else { CORRECTION_NOISE_MM };
            let place = match d.term.law {
                Law::Velocity => 0,
                Law::Acceleration => 1,
                _ => continue,
            };
            axis.gains[place] += d.term.gain.abs() / allowed;
        }
        self.built_up = [0.0; DYNAMIC_MAX];
        for (built, d) in self.built_up.iter_mut().zip(model.dynamics()) {
            let wire = wire_index.get(d.axis).copied().unwrap_or(MAX_AXES);
            *built = self.axes.get(wire).map_or(0.0, |axis| axis.direction);
        }
    }

    /// One good frame.
    ///
    /// # Cycle   no allocation, no panic
    pub(super) fn advance(&mut self, model: &Model, wire_index: &[usize; MAX_AXES], sample: &Sample<'_>) {
        for (k, axis) in self.axes.iter_mut().enumerate() {
            if sample.interrupted || sample.elapsed_s <= 0.0 {
                axis.rest();
            } else if sample.elapsed_s > GAP_CYCLES * self.cycle_s {
                axis.bridge();
            }
            axis.sample(sample.position[k], sample.elapsed_s, sample.ahead_s, self.cycle_s);
            axis.follow(sample.offset[k], sample.ahead_s, sample.elapsed_s);
        }
        for (built, d) in self.built_up.iter_mut().zip(model.dynamics()) {
            let Law::Reversal { build_up } = d.term.law else { continue };
            let Some(axis) = wire_index.get(d.axis).and_then(|wire| self.axes.get(*wire)) else { continue };
            let kept = if build_up > 0.0 { (-axis.step / build_up).exp() } else { 0.0 };
            *built = axis.direction + (*built - axis.direction) * kept;
        }
    }

    /// The direction of travel of an axis, of command plus offset.
    pub(super) fn travel(&self, wire: usize) -> Travel {
        if self.axes[wire].direction < 0.0 { Travel::Reverse } else { Travel::Forward }
    }

    /// The signals of the terms of a model when a correction takes effect, `ahead_s` from the newest frame; those of
    /// transient terms only where asked for, else zero.
    ///
    /// # Cycle   no allocation, no panic
    pub(super) fn signals(
        &self,
        model: &Model,
        wire_index: &[usize; MAX_AXES],
        ahead_s: f64,
        transients: bool,
    ) -> [f64; DYNAMIC_MAX] {
        let mut out = [0.0; DYNAMIC_MAX];
        for ((signal, built), d) in out.iter_mut().zip(&self.built_up).zip(model.dynamics()) {
            let Some(axis) = wire_index.get(d.axis).and_then(|wire| self.axes.get(*wire)) else { continue };
            *signal = match d.term.law {
                Law::Reversal { build_up } if build_up > 0.0 => -0.25 * (axis.direction + built),
                Law::Reversal { .. } => -0.5 * axis.direction,
                law if transients => law.signal(&axis.motion(ahead_s)),
                _ => 0.0,
            };
        }
        out
    }
}
