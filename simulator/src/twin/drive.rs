//! What lies between the set point of a linear axis and its carriage: servo, friction, screw, play, springs.
//!
//! Everything is a differential equation integrated in time (semi-implicit Euler, friction exactly), or a function of
//! where the nut really is. Lengths in mm, times in s.

use super::file::Effect;
use super::random::{Dice, Table};

/// Set point of an axis: position (mm), speed (mm/s), acceleration (mm/s^2).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SetPoint {
    /// Position, mm.
    pub q: f64,
    /// Speed, mm/s.
    pub v: f64,
    /// Acceleration, mm/s^2.
    pub a: f64,
}

/// Bandwidth of the speed loop, 1/s.
const SPEED_LOOP: f64 = 150.0;
/// Gain of the position loop, 1/s.
const POSITION_LOOP: f64 = 30.0;
/// Typical speed at which sizes are meant, mm/s.
const TYPICAL_SPEED: f64 = 30.0;
/// Typical acceleration at which sizes are meant, mm/s^2.
const TYPICAL_ACCELERATION: f64 = 30.0;

/// Friction with presliding after Dahl: from -1 to +1 over a distance after each reversal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Dahl {
    length_mm: f64,
    state: f64,
}

impl Dahl {
    /// Friction that has turned after a few times `length_mm`.
    #[must_use]
    pub const fn new(length_mm: f64) -> Self {
        Self { length_mm, state: 0.0 }
    }

    /// Moves on by `dx` and returns the friction, -1 to 1.
    pub fn step(&mut self, dx: f64) -> f64 {
        if dx != 0.0 {
            let sign = dx.signum();
            self.state = sign + (self.state - sign) * (-dx.abs() / self.length_mm).exp();
        }
        self.state
    }
}

/// A servo with position loop, PI speed loop, feedforward of speed and acceleration, and friction at the motor.
#[derive(Debug, Clone, PartialEq)]
struct Servo {
    /// What is missing of the feedforward of speed, a share.
    missing: f64,
    /// Friction, mm/s^2.
    friction: f64,
    integral_per_s: f64,
    dahl: Dahl,
    x: f64,
    v: f64,
    integral: f64,
    started: bool,
}

impl Servo {
    fn step(&mut self, dt: f64, set: SetPoint) -> f64 {
        if !self.started {
            (self.x, self.v, self.started) = (set.q, set.v, true);
        }
        // the loop compares set point, place and speed of the same moment: a speed one step old would lag by a dt and,
        // through the integral, leave a place error of a dt over the position gain
        let here = self.x + (self.v + 0.5 * set.a * dt) * dt;
        let wanted = set.v * (1.0 - self.missing) + POSITION_LOOP * (set.q - here);
        let friction = self.friction * self.dahl.step(self.v * dt);
        let speed_error = wanted - (self.v + set.a * dt);
        self.integral += SPEED_LOOP * self.integral_per_s * speed_error * dt;
        // the feedforward of acceleration is right, as its error shows up as the structure's compliance
        let before = self.v;
        self.v += (set.a + SPEED_LOOP * speed_error + self.integral - friction) * dt;
        self.x += 0.5 * (before + self.v) * dt;
        self.x
    }
}

/// A mass on a spring with damping, its foot moved: the error is where it lags behind.
#[derive(Debug, Clone, PartialEq)]
pub struct Oscillator {
    /// Natural frequency, rad/s.
    omega: f64,
    damping: f64,
    x: f64,
    v: f64,
}

impl Oscillator {
    /// A structure that yields by `compliance` per unit of acceleration.
    #[must_use]
    pub fn new(compliance: f64, damping: f64) -> Self {
        Self { omega: (1.0 / compliance.abs().max(1e-9)).sqrt().min(400.0), damping, x: 0.0, v: 0.0 }
    }

    /// Moves on with the foot accelerated by `a`; the place against the foot.
    pub fn step(&mut self, dt: f64, a: f64) -> f64 {
        // in the moving frame: x'' = -w^2 x - 2 z w x' - a
        self.v += (-self.omega.powi(2) * self.x - 2.0 * self.damping * self.omega * self.v - a) * dt;
        self.x += self.v * dt;
        self.x
    }
}

/// Lost motion: wind-up against the table's friction, and dead play.
#[derive(Debug, Clone, PartialEq)]
struct LostMotion {
    half_mm: f64,
    play_share: f64,
    dahl: Dahl,
    before: Option<f64>,
    play: f64,
}

impl LostMotion {
    fn step(&mut self, x: f64) -> f64 {
        let dx = x - self.before.unwrap_or(x);
        self.before = Some(x);
        let wind_up = self.dahl.step(dx);
        // play: the nut moves freely between two stops
        let width = 2.0 * self.half_mm.abs() * self.play_share;
        let stop = width / 2.0;
        self.play = (self.play - dx).clamp(-stop, stop);
        -self.half_mm * (1.0 - self.play_share) * wind_up + self.play * self.half_mm.signum()
    }
}

/// Errors that are functions of where the nut is.
#[derive(Debug, Clone, PartialEq)]
enum Screw {
    /// Relative change of length.
    Scale(f64),
    /// Errors of the lead, added up.
    Lead(Table),
    /// Wobble: amplitudes once and twice per turn, phases, pitch.
    Wobble { pitch_mm: f64, first: f64, second: f64, phases: [f64; 2] },
    /// A worn stretch: depth, centre, half length.
    Worn { depth: f64, centre: f64, half: f64 },
}

impl Screw {
    fn at(&self, x: f64) -> f64 {
        match self {
            Self::Scale(s) => s * x,
            Self::Lead(table) => table.at(x),
            Self::Wobble { pitch_mm, first, second, phases } => {
                let turn = std::f64::consts::TAU * x / pitch_mm;
                first * (turn + phases[0]).sin() + second * (2.0 * turn + phases[1]).sin()
            }
            Self::Worn { depth, centre, half } => {
                let s = ((x - centre) / half).powi(2);
                if s < 1.0 { depth * (1.0 - s).powi(2) } else { 0.0 }
            }
        }
    }
}

/// A linear axis.
#[derive(Debug, Clone, PartialEq)]
pub struct Drive {
    travel: [f64; 2],
    servo: Option<Servo>,
    lost: Vec<LostMotion>,
    screws: Vec<Screw>,
    spring: Vec<(f64, Oscillator)>,
    /// Sideways pushes: friction and mm in each direction.
    aside: Vec<(Dahl, [f64; 3])>,
    /// Tilts: sign, oscillator (rad per mm/s^2), direction about which.
    tilt: Vec<(f64, Oscillator, usize)>,
    before: Option<f64>,
    /// Error along the axis, mm.
    pub along: f64,
    /// Other error motions EX EY EZ (mm), EA EB EC (rad).
    pub motion: [f64; 6],
}

impl Drive {
    /// A perfect axis.
    #[must_use]
    pub const fn new(travel: [f64; 2]) -> Self {
        Self {
            travel,
            servo: None,
            lost: Vec::new(),
            screws: Vec::new(),
            spring: Vec::new(),
            aside: Vec::new(),
            tilt: Vec::new(),
            before: None,
            along: 0.0,
            motion: [0.0; 6],
        }
    }

    /// Adds an effect of axis `k` (0 = X); true where it is one of this axis.
    pub fn add(&mut self, e: &Effect, k: usize, dice: &mut Dice) -> bool {
        let mm = e.size_um * 1e-3;
        let [low, high] = self.travel;
        match e.name.as_str() {
            "scale" => self.screws.push(Screw::Scale(mm / (0.3 * (high - low)))),
            "positioning" => {
                let length = e.constant("length-mm", dice.between(60.0, 200.0));
                let table = Table::integrated(dice, self.travel, low, length, 1).without_line(self.travel);
                self.screws.push(Screw::Lead(table.scaled(self.travel, mm)));
            }
            "cyclic" => {
                let pitch_mm =
                    e.constant("pitch-mm", dice.one_of(&[8.0, 10.0, 12.0, 16.0, 20.0, 25.0, 30.0, 32.0]));
                let second = e.constant("second", dice.between(0.0, 0.4));
                let turn = std::f64::consts::TAU;
                let phases = [dice.between(0.0, turn), dice.between(0.0, turn)];
                self.screws.push(Screw::Wobble {
                    pitch_mm,
                    first: 1.4 * mm,
                    second: 1.4 * mm * second,
                    phases,
                });
            }
            "wear" => {
                let centre = e.constant(
                    "centre-mm",
                    dice.between(low + 0.25 * (high - low), high - 0.25 * (high - low)),
                );
                let half = e.constant("half-mm", dice.between(0.06, 0.16) * (high - low));
                self.screws.push(Screw::Worn { depth: 3.0 * mm, centre, half });
            }
            "backlash" => self.lost.push(LostMotion {
                half_mm: mm,
                play_share: e.constant("play-share", dice.between(0.0, 0.6)).clamp(0.0, 1.0),
                dahl: Dahl::new(e.constant("length-mm", dice.between(0.02, 0.5)).max(1e-4)),
                before: None,
                play: 0.0,
            }),
            "lateral-play" => {
                let dahl = Dahl::new(e.constant("length-mm", dice.between(0.02, 0.5)).max(1e-4));
                let (first, second) = ((k + 1) % 3, (k + 2) % 3);
                let both = e.constant("both", dice.between(0.0, 1.0)) > 0.5;
                let mut push = [0.0; 3];
                let main = if dice.between(0.0, 1.0) > 0.5 { first } else { second };
                push[main] = mm;
                if both {
                    push[first + second - main] = mm * dice.between(-0.8, 0.8);
                }
                self.aside.push((dahl, push));
            }
            "reversal-spike" => {
                let integral_per_s = e.constant("integral-per-s", dice.between(3.0, 9.0)).max(0.1);
                let presliding = e.constant("presliding-mm", dice.between(0.003, 0.02)).max(1e-5);
                let servo = self.servo_mut();
                servo.integral_per_s = integral_per_s;
                servo.dahl = Dahl::new(presliding);
                // a step of the friction moves the carriage by about friction/(speed loop * position loop)
                servo.friction += mm * SPEED_LOOP * POSITION_LOOP / 0.6;
            }
            // what is missing of the speed divides by the loop gain into a following error
            "servo-mismatch" => self.servo_mut().missing += mm / TYPICAL_SPEED * POSITION_LOOP,
            "inertial" => {
                let compliance = mm / TYPICAL_ACCELERATION;
                let damping = e.constant("damping", dice.between(0.1, 0.4));
                self.spring.push((compliance.signum(), Oscillator::new(compliance, damping)));
            }
            "inertial-cross" => {
                // 200 mm of lever make the size; accelerating X tilts about Y, Y about X, Z about X or Y
                let angle = mm / 200.0 / TYPICAL_ACCELERATION;
                let damping = e.constant("damping", dice.between(0.1, 0.4));
                let about = match k {
                    0 => 1,
                    1 => 0,
                    _ => dice.below(2),
                };
                // the structure's frequency is far above the motion: 25 Hz
                let omega2 = 157.0_f64.powi(2);
                self.tilt.push((angle * omega2, Oscillator::new(1.0 / omega2, damping), about));
            }
            _ => return false,
        }
        true
    }

    fn servo_mut(&mut self) -> &mut Servo {
        self.servo.get_or_insert_with(|| Servo {
            missing: 0.0,
            friction: 0.0,
            integral_per_s: 6.0,
            dahl: Dahl::new(0.01),
            x: 0.0,
            v: 0.0,
            integral: 0.0,
            started: false,
        })
    }

    /// True where standing still takes time to come to rest.
    #[must_use]
    pub const fn is_slow(&self) -> bool {
        self.servo.is_some() || !self.spring.is_empty() || !self.tilt.is_empty()
    }

    /// One step towards a set point.
    pub fn step(&mut self, dt: f64, set: SetPoint) {
        let motor = self.servo.as_mut().map_or(set.q, |s| s.step(dt, set));
        let dx = motor - self.before.unwrap_or(motor);
        self.before = Some(motor);
        self.along = motor - set.q;
        self.along += self.lost.iter_mut().map(|l| l.step(motor)).sum::<f64>();
        self.along += self.screws.iter().map(|s| s.at(motor)).sum::<f64>();
        self.along += self.spring.iter_mut().map(|(sign, s)| *sign * s.step(dt, set.a)).sum::<f64>();
        self.motion = [0.0; 6];
        for (dahl, push) in &mut self.aside {
            let friction = dahl.step(dx);
            for (m, p) in self.motion.iter_mut().zip(*push) {
                *m += friction * p;
            }
        }
        for (factor, spring, about) in &mut self.tilt {
            let behind = spring.step(dt, set.a);
            if let Some(m) = self.motion.get_mut(3 + *about) {
                *m += *factor * behind;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn drive(name: &str, size_um: f64, constants: &[(&str, f64)]) -> Drive {
        let mut e = Effect::new(name, "x", size_um);
        e.constants = constants.iter().map(|(k, v)| ((*k).to_owned(), *v)).collect();
        let mut d = Drive::new([0.0, 500.0]);
        assert!(d.add(&e, 0, &mut Dice::new(1, "test")));
        d
    }

    fn ramp(d: &mut Drive, from: f64, v: f64, seconds: f64) -> f64 {
        let n = (seconds / 1e-3) as usize;
        for k in 0..=n {
            d.step(1e-3, SetPoint { q: from + v * k as f64 * 1e-3, v, a: 0.0 });
        }
        d.along
    }

    #[test]
    fn a_missing_feedforward_makes_a_lag_in_proportion_to_the_speed() {
        let mut d = drive("servo-mismatch", 3.0, &[]);
        let slow = ramp(&mut d, 0.0, 10.0, 4.0);
        let mut d = drive("servo-mismatch", 3.0, &[]);
        let fast = ramp(&mut d, 0.0, 30.0, 4.0);
        assert!((slow + 0.001).abs() < 1e-5 && (fast + 0.003).abs() < 2e-5, "{slow} {fast}");
    }

    #[test]
    fn lost_motion_depends_on_the_way_one_came() {
        let mut d = drive("backlash", 2.0, &[("length-mm", 0.1), ("play-share", 0.5)]);
        let up = ramp(&mut d, 0.0, 20.0, 2.0);
        let down = ramp(&mut d, 40.0, -20.0, 2.0);
        assert!((up + 0.002).abs() < 1e-6 && (down - 0.002).abs() < 1e-6, "{up} {down}");
        let begun = ramp(&mut d, 0.0, 20.0, 0.005);
        assert!(begun > -0.002 && begun < 0.002, "on the way from one stop to the other: {begun}");
    }

    #[test]
    fn friction_makes_a_spike_at_the_reversal_that_dies_away() {
        let mut d = drive("reversal-spike", 4.0, &[("integral-per-s", 6.0), ("presliding-mm", 0.01)]);
        ramp(&mut d, 0.0, 20.0, 5.0);
        assert!(d.along.abs() < 1e-6, "the integral carries the friction: {}", d.along);
        let mut largest = 0.0f64;
        for k in 0..3000 {
            d.step(1e-3, SetPoint { q: 100.0 - 0.02 * f64::from(k), v: -20.0, a: 0.0 });
            // the corner itself makes an error without friction, too: look behind it
            if k > 60 {
                largest = largest.max(d.along);
            }
        }
        assert!(largest > 0.002 && d.along.abs() < 1e-5, "{largest} {}", d.along);
    }

    #[test]
    fn a_spring_lags_behind_by_compliance_times_acceleration() {
        let mut d = drive("inertial", 3.0, &[("damping", 0.7)]);
        for _ in 0..4000 {
            d.step(1e-3, SetPoint { q: 0.0, v: 0.0, a: 60.0 });
        }
        assert!((d.along + 0.006).abs() < 1e-6, "{}", d.along);
    }
}
