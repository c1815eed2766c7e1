//! Jerk-limited speed over one stretch of path: speed up, cruise, slow down, each with no acceleration at its ends.
//!
//! A change of speed by dv takes T = 2 sqrt(dv/j) where the acceleration limit is not reached (dv <= a^2/j), else
//! dv/a + a/j; by symmetry it covers (v0 + v1)/2 T. Both follow from integrating the jerk.

/// Limits along the path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Speed, 1/s.
    pub velocity: f64,
    /// Acceleration, 1/s^2.
    pub acceleration: f64,
    /// Jerk, 1/s^3.
    pub jerk: f64,
}

/// Motion along the path at one moment.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Along {
    /// Length covered.
    pub length: f64,
    /// Speed.
    pub velocity: f64,
    /// Acceleration.
    pub acceleration: f64,
}

#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Phase {
    begin: Along,
    jerk: f64,
    from_s: f64,
}

/// Speed over one stretch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Profile {
    phases: [Phase; 7],
    length: f64,
    duration_s: f64,
    exit: f64,
}

/// Time that a change of speed takes.
fn change_time(dv: f64, limits: &Limits) -> f64 {
    let dv = dv.abs();
    if dv <= limits.acceleration * limits.acceleration / limits.jerk {
        2.0 * (dv / limits.jerk).sqrt()
    } else {
        dv / limits.acceleration + limits.acceleration / limits.jerk
    }
}

/// Length that a change of speed takes.
fn change_length(from: f64, to: f64, limits: &Limits) -> f64 {
    0.5 * (from + to) * change_time(to - from, limits)
}

/// Highest value in `low..=high` for which `fits` holds; `fits(low)` is taken for granted, `fits` falls once.
fn highest(low: f64, high: f64, fits: impl Fn(f64) -> bool) -> f64 {
    if fits(high) {
        return high;
    }
    let (mut low, mut high) = (low, high);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if fits(middle) {
            low = middle;
        } else {
            high = middle;
        }
    }
    low
}

/// The highest speed that can be reached from `from` within `length`.
#[must_use]
pub fn reachable(from: f64, length: f64, limits: &Limits) -> f64 {
    if from >= limits.velocity {
        return from;
    }
    highest(from, limits.velocity, |to| change_length(from, to, limits) <= length)
}

impl Profile {
    /// From speed `entry` to speed `exit` over `length`. Both speeds must be within reach of each other
    /// (see [`reachable`]) and of the limits.
    #[must_use]
    pub fn new(length: f64, entry: f64, exit: f64, limits: &Limits) -> Self {
        let both = |peak: f64| change_length(entry, peak, limits) + change_length(peak, exit, limits);
        let lowest = entry.max(exit);
        let peak = highest(lowest, limits.velocity.max(lowest), |v| both(v) <= length);
        let cruise_s = if peak > 0.0 { ((length - both(peak)) / peak).max(0.0) } else { 0.0 };
        let mut profile = Self { phases: [Phase::default(); 7], length, duration_s: 0.0, exit };
        let mut at = Along { length: 0.0, velocity: entry, acceleration: 0.0 };
        let mut time = 0.0;
        let up = ramp(peak - entry, limits);
        let down = ramp(exit - peak, limits);
        let parts = [up[0], up[1], up[2], (0.0, cruise_s), down[0], down[1], down[2]];
        for (phase, (jerk, span)) in profile.phases.iter_mut().zip(parts) {
            *phase = Phase { begin: at, jerk, from_s: time };
            at = advance(at, jerk, span);
            time += span;
        }
        profile.duration_s = time;
        profile
    }

    /// How long it takes.
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        self.duration_s
    }

    /// The motion at a time since its start; held at its ends beyond them.
    #[must_use]
    pub fn at(&self, time_s: f64) -> Along {
        if time_s >= self.duration_s {
            return Along { length: self.length, velocity: self.exit, acceleration: 0.0 };
        }
        let time_s = time_s.max(0.0);
        let phase = self.phases.iter().rev().find(|p| p.from_s <= time_s).unwrap_or(&self.phases[0]);
        let mut at = advance(phase.begin, phase.jerk, time_s - phase.from_s);
        at.length = at.length.clamp(0.0, self.length);
        at.velocity = at.velocity.max(0.0);
        at
    }
}

/// Jerk and duration of the three phases of a change of speed.
fn ramp(dv: f64, limits: &Limits) -> [(f64, f64); 3] {
    let sign = dv.signum();
    let total = change_time(dv, limits);
    let edge = (total / 2.0).min(limits.acceleration / limits.jerk);
    let flat = (total - 2.0 * edge).max(0.0);
    [(sign * limits.jerk, edge), (0.0, flat), (-sign * limits.jerk, edge)]
}

fn advance(at: Along, jerk: f64, t: f64) -> Along {
    Along {
        length: at.length + t * (at.velocity + t * (at.acceleration / 2.0 + t * jerk / 6.0)),
        velocity: at.velocity + t * (at.acceleration + t * jerk / 2.0),
        acceleration: at.acceleration + t * jerk,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn limits_hold_everywhere(
            length in 1e-4..2000.0_f64, v in 0.1..800.0_f64, a in 10.0..10_000.0_f64, j in 100.0..1e6_f64,
            entry_share in 0.0..1.0_f64, exit_share in 0.0..1.0_f64,
        ) {
            let limits = Limits { velocity: v, acceleration: a, jerk: j };
            let entry = entry_share * v;
            let fastest = reachable(entry, length, &limits);
            // an exit that can be reached both ways
            let exit = (exit_share * v).min(fastest);
            prop_assume!(entry <= exit || reachable(exit, length, &limits) >= entry);
            let p = Profile::new(length, entry, exit, &limits);
            let n = 500;
            let dt = p.duration_s() / f64::from(n);
            let mut before = p.at(0.0);
            prop_assert!((before.velocity - entry).abs() <= 1e-9 * v);
            for k in 1..=n {
                let now = p.at(f64::from(k) * dt);
                prop_assert!(now.velocity <= v * (1.0 + 1e-9));
                prop_assert!(now.acceleration.abs() <= a * (1.0 + 1e-6));
                prop_assert!((now.acceleration - before.acceleration).abs() <= j * dt * (1.0 + 1e-6) + a * 1e-9);
                prop_assert!(now.length >= before.length - 1e-9 * length);
                prop_assert!(now.length - before.length <= v * dt * (1.0 + 1e-6) + 1e-7 * length);
                before = now;
            }
            prop_assert_eq!(p.at(p.duration_s()).length, length);
            prop_assert_eq!(p.at(p.duration_s()).velocity, exit);
        }
    }

    #[test]
    fn a_long_move_takes_the_textbook_time() {
        // v/a + a/j ramps at both ends: T = L/v + v/a + a/j
        let limits = Limits { velocity: 100.0, acceleration: 1000.0, jerk: 20_000.0 };
        let p = Profile::new(500.0, 0.0, 0.0, &limits);
        assert!((p.duration_s() - (5.0 + 0.1 + 0.05)).abs() < 1e-9);
    }
}
