//! What an axis does beyond its drive position: wind-up, friction at the reversal, structures that yield to acceleration.
//!
//! Lengths in the axis' own unit (mm or deg), times in s. Every law is integrated in time from the drive position alone.

use std::collections::VecDeque;

/// Friction with presliding after Dahl: -1 to +1, built up over a length after each reversal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Presliding {
    length: f64,
    state: f64,
}

impl Presliding {
    /// Friction that has turned after a few times `length`; 0 turns at once.
    #[must_use]
    pub const fn new(length: f64) -> Self {
        Self { length, state: 0.0 }
    }

    /// Moves on by `dx` and returns the friction.
    pub fn step(&mut self, dx: f64) -> f64 {
        if dx != 0.0 {
            let sign = dx.signum();
            let kept = if self.length > 0.0 { (-dx.abs() / self.length).exp() } else { 0.0 };
            self.state = sign + (self.state - sign) * kept;
        }
        self.state
    }
}

/// A mass on a damped spring whose foot is accelerated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spring {
    omega: f64,
    damping: f64,
    x: f64,
    v: f64,
}

impl Spring {
    /// At rest. `frequency_hz` is the natural frequency, `damping` a share of the critical one.
    #[must_use]
    pub const fn new(frequency_hz: f64, damping: f64) -> Self {
        Self { omega: core::f64::consts::TAU * frequency_hz, damping, x: 0.0, v: 0.0 }
    }

    /// Moves on with the foot accelerated by `a`; returns the acceleration that the spring transmits, which is `a` once settled.
    pub fn step(&mut self, dt_s: f64, a: f64) -> f64 {
        // substeps keep the semi-implicit rule exact enough whatever the cycle time
        let steps = (self.omega * dt_s / 0.05).ceil().clamp(1.0, 1000.0);
        let h = dt_s / steps;
        for _ in 0..steps as usize {
            self.v += (-self.omega * self.omega * self.x - 2.0 * self.damping * self.omega * self.v - a) * h;
            self.x += self.v * h;
        }
        -self.omega * self.omega * self.x
    }
}

/// What is wrong with the dynamics of an axis; all zero is an axis that only has its drive.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StructureSpec {
    /// Delay of the control between set point and drive, s.
    pub delay_s: f64,
    /// Wind-up of the drive train against friction, from stop to stop.
    pub wind_up: f64,
    /// Length over which it builds up after a reversal.
    pub wind_up_length: f64,
    /// Sideways shift of the carriage from stop to stop, mm along x, y, z.
    pub lateral_mm: [f64; 3],
    /// Height of the peak that friction makes after a reversal, and its rise and fall, s.
    pub peak: f64,
    /// Time in which the peak rises, s.
    pub rise_s: f64,
    /// Time in which it falls, s.
    pub fall_s: f64,
    /// Shift of the carriage per acceleration, s^2; it lags behind where this is positive.
    pub compliance_s2: f64,
    /// Turn of the carriage about a, b, c per acceleration of the axis, rad per unit/s^2.
    pub tilt: [f64; 3],
    /// Natural frequency of the structure that yields, Hz.
    pub frequency_hz: f64,
    /// Its damping, as a share of the critical one.
    pub damping: f64,
}

impl StructureSpec {
    /// A stiff structure and a drive train without friction.
    pub const RIGID: Self = Self {
        delay_s: 0.0,
        wind_up: 0.0,
        wind_up_length: 0.0,
        lateral_mm: [0.0; 3],
        peak: 0.0,
        rise_s: 0.002,
        fall_s: 0.02,
        compliance_s2: 0.0,
        tilt: [0.0; 3],
        frequency_hz: 40.0,
        damping: 0.3,
    };
}

/// The set points of the last moments.
#[derive(Debug, Clone)]
pub struct Delay {
    waiting: VecDeque<(f64, f64)>,
    now_s: f64,
    last: f64,
}

impl Delay {
    /// Nothing is under way; the axis stands at `start`.
    #[must_use]
    pub const fn new(start: f64) -> Self {
        Self { waiting: VecDeque::new(), now_s: 0.0, last: start }
    }

    /// One cycle: takes a set point, returns that of `delay_s` ago, interpolated.
    pub fn step(&mut self, dt_s: f64, delay_s: f64, set_point: f64) -> f64 {
        if delay_s <= 0.0 {
            return set_point;
        }
        if self.waiting.is_empty() {
            self.waiting.push_back((self.now_s, self.last));
        }
        self.now_s += dt_s;
        self.waiting.push_back((self.now_s, set_point));
        let wanted = self.now_s - delay_s;
        while self.waiting.get(1).is_some_and(|(at, _)| *at <= wanted) {
            self.waiting.pop_front();
        }
        let first = self.waiting.front().copied().unwrap_or((self.now_s, set_point));
        self.last = match self.waiting.get(1) {
            Some(next) if wanted > first.0 => {
                first.1 + (next.1 - first.1) * (wanted - first.0) / (next.0 - first.0)
            }
            _ => first.1,
        };
        self.last
    }
}

/// The structure of one axis in time.
#[derive(Debug, Clone)]
pub struct Structure {
    spec: StructureSpec,
    wind_up: Presliding,
    lateral: Presliding,
    /// Direction of the last movement.
    direction: f64,
    /// Friction behind the fast and the slow time constant.
    peak: [f64; 2],
    spring: Spring,
    position: f64,
    speed: f64,
    /// Shift along the axis, in its own unit.
    pub along: f64,
    /// Other motions: EX EY EZ in mm, EA EB EC in rad.
    pub motion: [f64; 6],
}

impl Structure {
    /// At rest at `start`.
    #[must_use]
    pub const fn new(spec: StructureSpec, start: f64) -> Self {
        Self {
            spec,
            wind_up: Presliding::new(spec.wind_up_length),
            lateral: Presliding::new(spec.wind_up_length),
            direction: 0.0,
            peak: [0.0; 2],
            spring: Spring::new(spec.frequency_hz, spec.damping),
            position: start,
            speed: 0.0,
            along: 0.0,
            motion: [0.0; 6],
        }
    }

    /// One cycle in which the drive has gone to `position`.
    pub fn step(&mut self, dt_s: f64, position: f64) {
        if self.spec == StructureSpec::RIGID || dt_s <= 0.0 {
            return;
        }
        let dx = position - self.position;
        let speed = dx / dt_s;
        let acceleration = (speed - self.speed) / dt_s;
        (self.position, self.speed) = (position, speed);
        if dx != 0.0 {
            self.direction = dx.signum();
        }
        let yielded = self.spring.step(dt_s, acceleration);
        for (lagged, tau) in self.peak.iter_mut().zip([self.spec.rise_s, self.spec.fall_s]) {
            *lagged += (self.direction - *lagged) * (1.0 - (-dt_s / tau).exp());
        }
        // a turn of the friction is a step of two
        let peak = self.spec.peak * (self.peak[0] - self.peak[1]) / 2.0;
        self.along =
            -self.spec.wind_up / 2.0 * self.wind_up.step(dx) - peak - self.spec.compliance_s2 * yielded;
        let slid = self.lateral.step(dx);
        for (i, motion) in self.motion.iter_mut().enumerate() {
            *motion =
                if i < 3 { self.spec.lateral_mm[i] / 2.0 * slid } else { self.spec.tilt[i - 3] * yielded };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_delayed_set_point_is_that_of_so_long_ago() {
        let mut delay = Delay::new(0.0);
        let ramp = |k: i32| 0.04 * f64::from(k);
        for k in 1..200 {
            let out = delay.step(1e-3, 0.0075, ramp(k));
            if k > 10 {
                assert!((out - (ramp(k) - 40.0 * 0.0075)).abs() < 1e-9, "{k}: {out}");
            }
        }
    }

    #[test]
    fn wind_up_builds_up_over_its_length_and_forgets_no_short_reversal() {
        let mut s =
            Structure::new(StructureSpec { wind_up: 0.01, wind_up_length: 0.1, ..StructureSpec::RIGID }, 0.0);
        (1..=1000).for_each(|k| s.step(1e-3, 0.01 * f64::from(k)));
        assert!((s.along + 0.005).abs() < 1e-9);
        s.step(1e-3, 9.99);
        assert!(s.along < -0.0035, "a tenth of the length turns a tenth of it: {}", s.along);
        (1..=200).for_each(|k| s.step(1e-3, 9.99 - 0.01 * f64::from(k)));
        assert!((s.along - 0.005).abs() < 1e-9);
    }

    #[test]
    fn a_structure_yields_to_acceleration_and_not_to_speed() {
        let mut s = Structure::new(
            StructureSpec {
                compliance_s2: 1e-5,
                tilt: [0.0, 1e-9, 0.0],
                damping: 0.7,
                ..StructureSpec::RIGID
            },
            0.0,
        );
        let mut x = 0.0;
        for k in 1..400 {
            let t = 1e-3 * f64::from(k);
            x = 0.5 * 500.0 * t * t;
            s.step(1e-3, x);
        }
        assert!((s.along + 5e-3).abs() < 1e-5 && (s.motion[4] - 5e-7).abs() < 1e-9, "{}", s.along);
        for k in 1..400 {
            s.step(1e-3, x + 0.2 * f64::from(k));
        }
        assert!(s.along.abs() < 1e-6, "{}", s.along);
    }

    #[test]
    fn friction_makes_a_peak_that_goes() {
        let mut s = Structure::new(StructureSpec { peak: 0.004, ..StructureSpec::RIGID }, 0.0);
        (1..=1000).for_each(|k| s.step(1e-3, 0.01 * f64::from(k)));
        assert!(s.along.abs() < 1e-9);
        let mut largest = 0.0f64;
        for k in 1..=300 {
            s.step(1e-3, 10.0 - 0.01 * f64::from(k));
            largest = largest.max(s.along);
        }
        // the carriage stays behind in the old direction
        assert!(largest > 0.0025 && s.along.abs() < 1e-6, "{largest} {}", s.along);
    }
}
