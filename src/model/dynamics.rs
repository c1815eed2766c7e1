//! Terms of an error motion that follow the motion of their own axis: direction, velocity, acceleration.
//!
//! `E = gain (1 + growth x) signal`, kept within plus and minus `limit`. The signal is a pure function of the motion of
//! the axis, see [`Law`]. All signals are odd in the direction of motion. Lengths mm, angles rad, times s.
//!
//! Source: ISO 230-1:2012, 3.4 (reversal error), 3.5 (motion errors); the laws are those of `docs/reference/session-files.md`, 4.

use crate::axes::Travel;

/// The most dynamic terms of a model.
pub const DYNAMIC_MAX: usize = 24;
/// Movement below this is standstill, mm/s or rad/s.
const STANDSTILL: f64 = 1e-6;

/// What a dynamic term follows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Law {
    /// Reversal error: `-1/2` after travel in the positive direction, `+1/2` after travel in the negative direction. Half
    /// of the change comes at once, the rest builds up over `build_up` (mm or rad; 0: all at once).
    Reversal {
        /// Length over which the second half builds up.
        build_up: f64,
    },
    /// Friction peak after a reversal, while the axis moves: `dir (exp(-t/fall) - exp(-t/rise))`, t since the reversal.
    FrictionPeak {
        /// Rise time, s.
        rise_s: f64,
        /// Fall time, s.
        fall_s: f64,
    },
    /// Kinetic friction while the axis moves: `-tanh(v/speed)`.
    Friction {
        /// Speed from which friction has about its full size, mm/s or rad/s.
        speed: f64,
    },
    /// Velocity, mm/s or rad/s.
    Velocity,
    /// Acceleration, mm/s^2 or rad/s^2.
    Acceleration,
}

/// The motion of one axis at one moment; mm or rad, s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisMotion {
    /// Velocity.
    pub velocity: f64,
    /// Acceleration.
    pub acceleration: f64,
    /// Direction of travel since the last reversal: +1 or -1; 0 where it is not known.
    pub direction: f64,
    /// Distance travelled since the last reversal; infinite where that was long ago.
    pub since: f64,
    /// Time since the last reversal; infinite where that was long ago.
    pub since_s: f64,
}

impl AxisMotion {
    /// At rest after long travel in a direction.
    #[must_use]
    pub fn after(travel: Travel) -> Self {
        Self {
            velocity: 0.0,
            acceleration: 0.0,
            direction: travel.sign(),
            since: f64::INFINITY,
            since_s: f64::INFINITY,
        }
    }
}

/// A dynamic term of an error motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DynamicTerm {
    /// What it follows.
    pub law: Law,
    /// Error per unit of the signal.
    pub gain: f64,
    /// Relative change of the gain per mm or rad of coordinate.
    pub growth: f64,
    /// The term is kept within plus and minus this, mm or rad.
    pub limit: f64,
}

impl Law {
    /// The signal that the law makes of a motion whose last but one reversal was long ago.
    #[must_use]
    pub fn signal(&self, motion: &AxisMotion) -> f64 {
        let decayed = |t: f64, tau: f64| if t.is_finite() { (-t.abs() / tau).exp() } else { 0.0 };
        match *self {
            Self::Reversal { build_up } => {
                let built = if build_up > 0.0 { 1.0 - decayed(motion.since, build_up) } else { 1.0 };
                -0.5 * motion.direction * built
            }
            Self::FrictionPeak { rise_s, fall_s } => {
                let moving = f64::from(u8::from(motion.velocity.abs() > STANDSTILL));
                moving
                    * motion.direction
                    * (decayed(motion.since_s, fall_s) - decayed(motion.since_s, rise_s))
            }
            Self::Friction { speed } => -(motion.velocity / speed).tanh(),
            Self::Velocity => motion.velocity,
            Self::Acceleration => motion.acceleration,
        }
    }

    /// Largest absolute value of the signal; `None` where only the motion bounds it.
    #[must_use]
    pub fn largest_signal(&self) -> Option<f64> {
        match *self {
            Self::Reversal { .. } => Some(0.5),
            Self::FrictionPeak { rise_s, fall_s } if rise_s == fall_s => Some(0.0),
            Self::FrictionPeak { rise_s, fall_s } => {
                let peak_s = rise_s * fall_s / (fall_s - rise_s) * (fall_s / rise_s).ln();
                Some(((-peak_s / fall_s).exp() - (-peak_s / rise_s).exp()).abs())
            }
            Self::Friction { .. } => Some(1.0),
            Self::Velocity | Self::Acceleration => None,
        }
    }

    /// True where the signal returns to zero when the axis comes to rest.
    #[must_use]
    pub const fn is_transient(&self) -> bool {
        !matches!(self, Self::Reversal { .. })
    }
}

impl DynamicTerm {
    /// The error at coordinate `x`, mm or rad. A signal that is not finite counts as zero.
    ///
    /// # Cycle   no allocation
    #[must_use]
    pub fn value(&self, x: f64, signal: f64) -> f64 {
        let value = self.gain * (1.0 + self.growth * x) * signal;
        if value.is_finite() { value.clamp(-self.limit, self.limit) } else { 0.0 }
    }

    /// Largest absolute value over a range of coordinates, mm or rad.
    #[must_use]
    pub fn bound(&self, range: [f64; 2]) -> f64 {
        let gain = range.map(|x| (self.gain * (1.0 + self.growth * x)).abs());
        self.law.largest_signal().map_or(self.limit, |s| (s * gain[0].max(gain[1])).min(self.limit))
    }

    /// True where every number can be evaluated.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        let law = match self.law {
            Law::Reversal { build_up } => build_up.is_finite() && build_up >= 0.0,
            Law::FrictionPeak { rise_s, fall_s } => {
                rise_s.is_finite() && fall_s.is_finite() && rise_s > 0.0 && fall_s > 0.0
            }
            Law::Friction { speed } => speed.is_finite() && speed > 0.0,
            Law::Velocity | Law::Acceleration => true,
        };
        law && self.gain.is_finite() && self.growth.is_finite() && self.limit.is_finite() && self.limit > 0.0
    }
}

/// What is wrong with tool and spindle: both follow the length of the tool.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ToolErrors {
    /// Tilt of the spindle about x and y of the machine at home, rad.
    pub tilt: [f64; 2],
    /// Relative error of the tool length: positive is longer than stated.
    pub length: f64,
}

impl ToolErrors {
    /// True where there is none.
    #[must_use]
    pub fn is_zero(&self) -> bool {
        *self == Self::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn moving(direction: f64, since: f64, since_s: f64) -> AxisMotion {
        AxisMotion { velocity: 10.0 * direction, acceleration: 0.0, direction, since, since_s }
    }

    #[test]
    fn a_reversal_error_builds_up_over_its_length() {
        let law = Law::Reversal { build_up: 0.2 };
        assert_eq!(law.signal(&AxisMotion::after(Travel::Forward)), -0.5);
        assert_eq!(law.signal(&AxisMotion::after(Travel::Reverse)), 0.5);
        assert_eq!(law.signal(&moving(1.0, 0.0, 0.0)), 0.0);
        assert!((law.signal(&moving(1.0, 0.2, 0.01)) + 0.5 * (1.0 - (-1.0f64).exp())).abs() < 1e-12);
        assert_eq!(Law::Reversal { build_up: 0.0 }.signal(&moving(-1.0, 0.0, 0.0)), 0.5);
        assert_eq!(law.signal(&AxisMotion { direction: 0.0, ..moving(1.0, 1.0, 1.0) }), 0.0);
    }

    #[test]
    fn a_friction_peak_rises_falls_and_ends_at_rest() {
        let law = Law::FrictionPeak { rise_s: 0.002, fall_s: 0.02 };
        assert_eq!(law.signal(&moving(1.0, 0.0, 0.0)), 0.0);
        assert!(law.signal(&moving(1.0, 0.0, 0.005)) > 0.6);
        assert!(law.signal(&moving(-1.0, 0.0, 0.5)).abs() < 1e-9);
        assert_eq!(law.signal(&AxisMotion { velocity: 0.0, ..moving(1.0, 0.0, 0.005) }), 0.0);
    }

    #[test]
    fn the_law_bounds_a_term_below_its_limit() {
        let term = |law, gain| DynamicTerm { law, gain, growth: 1e-3, limit: 9e-3 };
        let reversal = term(Law::Reversal { build_up: 0.1 }, 12e-3);
        assert!((reversal.bound([0.0, 0.0]) - 6e-3).abs() < 1e-15);
        assert!((reversal.bound([-200.0, 250.0]) - 7.5e-3).abs() < 1e-15);
        assert_eq!(reversal.bound([0.0, 1e3]), 9e-3);
        assert_eq!(term(Law::Velocity, 1e-6).bound([0.0, 1.0]), 9e-3);
        let law = Law::FrictionPeak { rise_s: 0.002, fall_s: 0.02 };
        let sampled =
            (0..10_000).map(|i| law.signal(&moving(1.0, 0.0, f64::from(i) * 1e-5))).fold(0.0, f64::max);
        assert!((law.largest_signal().unwrap() - sampled).abs() < 1e-6);
    }

    proptest! {
        #[test]
        fn a_term_never_exceeds_its_limit_and_is_odd(
            gain in -1e3..1e3f64, growth in -1.0..1.0f64, limit in 1e-6..1.0f64, x in -1e3..1e3f64,
            v in prop_oneof![8 => -1e5..1e5f64, 1 => Just(f64::NAN), 1 => Just(f64::INFINITY)],
        ) {
            for law in [Law::Velocity, Law::Acceleration, Law::Friction { speed: 0.1 }] {
                let term = DynamicTerm { law, gain, growth, limit };
                let signal = law.signal(&AxisMotion { velocity: v, acceleration: v, ..AxisMotion::after(Travel::Forward) });
                let value = term.value(x, signal);
                prop_assert!(value.abs() <= limit);
                prop_assert_eq!(term.value(x, -signal), -value);
            }
        }
    }
}
