//! Bounds the offset of one axis in size, rate and acceleration, whatever is asked of it.
//!
//! The offset follows its target exactly while the target keeps the limits; otherwise it goes after it and
//! brakes in time, relative to the mean motion of the target; it settles about the range over which one that breaks the limits
//! goes to and fro. Invariants, for any sequence of targets and intervals:
//! `|v'| <= rate`, `|p' - p| <= step`, `|p'| <= size` once inside, and `|v' - v| <= acceleration dt` unless the step
//! limit asks for more (a longer interval than before at full speed).
//!
//! Braking rule: after a step the distance left must allow a stop, `v'^2 / (2a) <= left`, so
//! `v' <= a (-dt + sqrt(dt^2 + 2 d / a))` with `d` the distance before the step. Braking sums end velocities
//! of intervals, so the rule holds for intervals of any later length.

use super::config::AxisLimits;

/// The offset of one axis and how fast it changes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limiter {
    limits: AxisLimits,
    position: f64,
    velocity: f64,
    last_target: f64,
    /// Rate of the target over the last step.
    last_moved: f64,
    /// The rate of the target that is followed.
    along: f64,
}

impl Limiter {
    /// At rest at zero. A size limit of zero means: this axis is never moved.
    #[must_use]
    pub const fn new(limits: AxisLimits) -> Self {
        Self { limits, position: 0.0, velocity: 0.0, last_target: 0.0, last_moved: 0.0, along: 0.0 }
    }

    /// The offset.
    #[must_use]
    pub const fn position(&self) -> f64 {
        self.position
    }

    /// Its rate of change over the last step.
    #[must_use]
    pub const fn velocity(&self) -> f64 {
        self.velocity
    }

    /// True above the warning limit.
    #[must_use]
    pub fn is_warning(&self) -> bool {
        self.position.abs() > self.limits.warning
    }

    /// Starts at rest at an offset that somebody else has left; beyond the size limit it can only come back.
    pub const fn start_at(&mut self, position: f64) {
        self.position = position;
        self.velocity = 0.0;
        self.last_target = position;
        (self.last_moved, self.along) = (0.0, 0.0);
    }

    /// One step of `dt` seconds towards `target`; true where size, rate, acceleration or step kept it from getting there.
    ///
    /// # Cycle   no allocation, no panic; a target that is not finite brakes instead
    pub fn step(&mut self, target: f64, dt: f64) -> bool {
        let size = self.limits.size;
        self.step_between([-size, size], target, dt)
    }

    /// The same on the way to zero: brakes in time for it, however fast the target goes there itself.
    ///
    /// # Cycle   no allocation, no panic; a target that is not finite brakes instead
    pub fn step_to_zero(&mut self, target: f64, dt: f64) -> bool {
        let size = self.limits.size;
        let side = if self.position > 0.0 { [0.0, size] } else { [-size, 0.0] };
        self.step_between(side, target, dt)
    }

    /// One step that can always be braked before either wall.
    fn step_between(&mut self, [low, high]: [f64; 2], target: f64, dt: f64) -> bool {
        let AxisLimits { size, rate, acceleration, step, .. } = self.limits;
        if size <= 0.0 {
            return target != self.position;
        }
        if !target.is_finite() {
            self.brake(dt);
            return true;
        }
        if dt <= 0.0 {
            return target != self.position;
        }
        let inside = target.clamp(-size, size);
        let moved = ((inside - self.last_target) / dt).clamp(-rate, rate);
        let along = self.followed(moved, acceleration * dt);
        // zero is a wall on the way there only, and there no motion of the target leads outwards
        let along = along.clamp(if high == 0.0 { 0.0 } else { -rate }, if low == 0.0 { 0.0 } else { rate });
        (self.last_target, self.last_moved, self.along) = (inside, moved, along);
        let error = inside - self.position - along * dt;
        let closing = if error.abs() <= acceleration * dt * dt {
            error / dt
        } else {
            braking_speed(error.abs(), dt, acceleration).copysign(error)
        };
        let lowest = (self.velocity - acceleration * dt).max(-rate);
        let highest = (self.velocity + acceleration * dt).min(rate);
        let velocity = (along + closing).clamp(lowest, highest);
        let free = self.position + velocity.clamp(-step / dt, step / dt) * dt;
        // never faster than still allows a stop before the walls
        let (above, below) = (high - self.position, self.position - low);
        let velocity = if is_too_fast(velocity, above, dt, acceleration) {
            velocity.min(wall_speed(above, dt, acceleration).max(lowest))
        } else if is_too_fast(-velocity, below, dt, acceleration) {
            velocity.max((-wall_speed(below, dt, acceleration)).min(highest))
        } else {
            velocity
        };
        // a step is worse than a kink: this bound comes after that of the acceleration
        let velocity = velocity.clamp(-step / dt, step / dt);
        let next = self.position + velocity * dt;
        self.velocity = velocity;
        // rounding must not keep the offset a fraction of a femtometre away from its target
        let equal = |position: f64| (position - inside).abs() <= 1e-15 * size;
        self.position = if equal(next) { inside } else { next };
        // settling at a wall in more steps than the limits ask for is no limit of the machine file
        target != inside || !(equal(next) || equal(free))
    }

    /// The rate of the target that is followed: the mean of its last two steps, built up by at most `change` a step from zero.
    ///
    /// Of a target that jumps to and fro the rate of a step would outweigh the distance left, and the offset would leave its range far.
    fn followed(&self, moved: f64, change: f64) -> f64 {
        let mean = f64::midpoint(moved, self.last_moved);
        let built_up = if mean * self.along > 0.0 { self.along.abs() } else { 0.0 };
        mean.clamp(-built_up - change, built_up + change)
    }

    /// One step of `dt` seconds of slowing down to rest.
    pub fn brake(&mut self, dt: f64) {
        if dt > 0.0 {
            let change = self.limits.acceleration * dt;
            self.velocity -= self.velocity.clamp(-change, change);
            // an interval longer than the one before must not make a step
            let step = self.limits.step / dt;
            self.velocity = self.velocity.clamp(-step, step);
            self.position += self.velocity * dt;
            self.last_target = self.position;
            (self.last_moved, self.along) = (0.0, 0.0);
        }
    }

    /// The way that it takes to come to rest.
    #[must_use]
    pub fn stopping_distance(&self) -> f64 {
        if self.velocity == 0.0 {
            0.0
        } else {
            self.velocity * self.velocity / (2.0 * self.limits.acceleration)
        }
    }

    /// True where nothing moves.
    #[must_use]
    pub fn is_at_rest(&self) -> bool {
        self.velocity == 0.0
    }
}

/// The speed at which `distance` can still be stopped in, after a step of `dt` at that speed.
fn braking_speed(distance: f64, dt: f64, acceleration: f64) -> f64 {
    acceleration * ((dt * dt + 2.0 * distance / acceleration).sqrt() - dt)
}

/// True where `speed` towards a wall is more than [`wall_speed`], without its root: `v dt + v^2 / (2 a) > d`.
fn is_too_fast(speed: f64, distance: f64, dt: f64, acceleration: f64) -> bool {
    speed > 0.0 && speed * (2.0 * acceleration * dt + speed) > 2.0 * acceleration * distance
}

/// Like [`braking_speed`]; zero beyond the wall.
fn wall_speed(distance: f64, dt: f64, acceleration: f64) -> f64 {
    braking_speed(distance.max(0.0), dt, acceleration)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const LIMITS: AxisLimits = AxisLimits {
        warning: 0.08,
        size: 0.1,
        stop: f64::INFINITY,
        rate: 1.0,
        acceleration: 20.0,
        step: f64::INFINITY,
    };

    #[test]
    fn follows_a_target_within_the_limits_exactly() {
        let mut l = Limiter::new(LIMITS);
        let mut limited = 0;
        for i in 0..5000 {
            let t = f64::from(i) * 1e-3;
            // 0.05 mm at 1 Hz: 0.31 mm/s, 1.97 mm/s^2
            let target = 0.05 * (1.0 - (core::f64::consts::TAU * t).cos()) / 2.0;
            if l.step(target, 1e-3) {
                limited += 1;
            } else {
                assert_eq!(l.position(), target);
            }
        }
        assert_eq!(limited, 0);
    }

    #[test]
    fn a_step_is_reached_without_overshoot_and_in_about_the_least_time() {
        let mut l = Limiter::new(LIMITS);
        let mut steps = 0;
        while l.step(0.09, 1e-3) {
            assert!(l.position() <= 0.09 + 1e-12);
            steps += 1;
            assert!(steps < 1000, "never arrives");
        }
        // 0.09 mm, 1 mm/s, 20 mm/s^2: bang-bang with cruising takes 0.14 s
        assert!((135..=160).contains(&steps), "{steps}");
        assert!(!l.step(0.09, 1e-3));
        assert!(l.is_at_rest());
    }

    #[test]
    fn on_the_way_to_zero_an_earlier_motion_of_the_target_never_leads_outwards() {
        for side in [1.0, -1.0] {
            let mut l = Limiter::new(LIMITS);
            l.start_at(side * 0.009);
            // a target beyond the offset, as that of the correction, and then the way to zero
            l.step(side * 0.0094, 1e-3);
            l.brake(1e-3);
            l.step(l.position(), 1e-3);
            let mut before = l.position();
            l.last_moved = side * 0.37;
            for _ in 0..400 {
                l.step_to_zero(0.999 * l.position(), 1e-3);
                assert!(l.position().abs() <= before.abs(), "{} after {before}", l.position());
                before = l.position();
            }
        }
    }

    #[test]
    fn an_offset_left_beyond_the_size_limit_comes_back_and_never_goes_further_out() {
        let mut l = Limiter::new(LIMITS);
        l.start_at(0.3);
        let mut last = 0.3;
        for _ in 0..2000 {
            l.step(1.0, 1e-3);
            assert!(l.position() <= last + 1e-15);
            last = l.position();
        }
        assert!((l.position() - 0.1).abs() < 1e-9, "{}", l.position());
    }

    #[test]
    fn a_warning_begins_above_its_limit_on_either_side() {
        let mut l = Limiter::new(LIMITS);
        for (position, warned) in [(0.0, false), (0.08, false), (-0.08, false), (0.081, true), (-0.081, true)]
        {
            l.start_at(position);
            assert_eq!(l.is_warning(), warned, "{position}");
        }
    }

    #[test]
    fn a_target_that_stops_at_zero_faster_than_allowed_is_not_followed_past_it() {
        // 0.9 mm/s until zero; 20 mm/s^2 need 20 um to stop
        let way = |step: fn(&mut Limiter, f64, f64) -> bool, sign: f64| {
            let mut l = Limiter::new(LIMITS);
            l.start_at(0.09 * sign);
            (0..400).fold(0.0_f64, |past, k| {
                step(&mut l, sign * (0.09 - 0.9e-3 * f64::from(k)).max(0.0), 1e-3);
                past.max(-sign * l.position())
            })
        };
        for sign in [1.0, -1.0] {
            assert!(way(Limiter::step, sign) > 0.005, "followed as any other target, it passes zero");
            assert!(way(Limiter::step_to_zero, sign) <= 1e-15, "{sign}");
        }
    }

    proptest! {
        /// Positions of a control that alternate, or that are those of some cycles ago in every second frame: the offset stays
        /// within three quarters of their range beside it, whatever rate^2 / (2 acceleration) is.
        #[test]
        fn a_target_to_and_fro_keeps_the_offset_near_its_range(
            middle in -0.05..0.05_f64,
            half in 1e-4..0.03_f64,
            pattern in prop_oneof![
                prop::collection::vec(-1.0..1.0_f64, 2..20),
                (2..20_u32).prop_map(|n| (0..n).map(|k| 1.0 - 2.0 * f64::from(k) / f64::from(n)).collect()),
            ],
            start in -0.1..0.1_f64,
            way_there in 0..40_u32,
        ) {
            let mut l = Limiter::new(LIMITS);
            l.start_at(start);
            for k in 0..way_there {
                l.step(start - start * f64::from(k) / 40.0, 1e-3);
            }
            let targets: Vec<f64> = pattern.iter().map(|p| middle + half * p).collect();
            let low = targets.iter().copied().fold(f64::INFINITY, f64::min);
            let high = targets.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            for (k, target) in targets.iter().cycle().take(3000).enumerate() {
                l.step(*target, 1e-3);
                if k > 1000 {
                    let outside = (l.position() - high).max(low - l.position());
                    prop_assert!(outside <= 0.75 * (high - low), "cycle {k}: {outside} mm outside {low} to {high}");
                }
            }
        }
    }

    #[test]
    fn an_axis_with_size_limit_zero_is_never_moved() {
        let mut l = Limiter::new(AxisLimits { size: 0.0, ..LIMITS });
        l.start_at(0.02);
        assert!(l.step(0.05, 1e-3));
        assert_eq!(l.position(), 0.02);
    }

    #[test]
    fn no_time_is_no_movement_and_no_memory() {
        let mut l = Limiter::new(LIMITS);
        l.step(0.09, 1e-3);
        let before = l;
        assert!(l.step(0.05, 0.0), "has not arrived");
        assert!(!l.step(l.position(), 0.0), "is there already");
        l.brake(0.0);
        assert_eq!(l, before);
    }

    #[test]
    fn an_axis_without_size_says_whether_it_is_where_it_should_be() {
        let mut l = Limiter::new(AxisLimits { size: 0.0, ..LIMITS });
        assert!(l.step(0.05, 1e-3) && !l.step(0.0, 1e-3));
    }

    #[test]
    fn it_is_at_rest_only_where_it_does_not_move() {
        let mut l = Limiter::new(LIMITS);
        assert!(l.is_at_rest());
        l.step(0.09, 1e-3);
        assert!(!l.is_at_rest());
        l.brake(1e-3);
        assert!(l.is_at_rest());
    }

    #[test]
    fn both_directions_are_limited_alike() {
        for step in [Limiter::step, Limiter::step_to_zero] {
            let mut pair = [Limiter::new(LIMITS); 2];
            pair[0].start_at(0.05);
            pair[1].start_at(-0.05);
            for k in 0..400 {
                // 4 mm/s out and back between 20 um and 80 um: both walls and every limit are met, zero is not
                let phase = f64::from(k % 30);
                let target = 0.02 + 0.004 * if phase < 15.0 { phase } else { 30.0 - phase };
                assert_eq!(step(&mut pair[0], target, 1e-3), step(&mut pair[1], -target, 1e-3));
                assert_eq!(pair[0].position(), -pair[1].position(), "cycle {k}");
            }
        }
    }

    #[test]
    fn a_target_running_towards_a_wall_is_left_only_as_late_as_it_can_be_braked() {
        for sign in [1.0, -1.0] {
            let mut l = Limiter::new(LIMITS);
            // up to 0.9 mm/s; 20 mm/s^2 need 20 um to stop, so up to some 80 um it is followed
            l.start_at(-0.09 * sign);
            let (mut target, mut speed, mut last_followed) = (-0.09, 0.0_f64, 0.0);
            for _ in 0..300 {
                speed = (speed + 0.01).min(0.9);
                target += speed * 1e-3;
                l.step(sign * target, 1e-3);
                if (l.position() - sign * target).abs() < 1e-12 {
                    last_followed = target;
                }
                assert!(l.position() * sign <= LIMITS.size);
            }
            assert!((0.076..0.082).contains(&last_followed), "{last_followed}");
            assert!(l.position() * sign > 0.0999, "and the wall is reached all the same");
        }
    }

    #[test]
    fn a_small_axis_does_not_jump_the_last_part_of_its_way() {
        // a rotary axis: one microradian, and 0.1 nrad per cycle within reach of the acceleration
        let mut l =
            Limiter::new(AxisLimits { warning: 1e-6, size: 1e-6, rate: 1e-3, acceleration: 1e-4, ..LIMITS });
        for _ in 0..20 {
            let before = l.position();
            l.step(5e-10, 1e-3);
            assert!((l.position() - before - l.velocity() * 1e-3).abs() <= 1e-21);
        }
        assert_eq!(l.position(), 5e-10);
    }

    #[test]
    fn the_speed_of_a_stop_at_the_wall_is_not_too_fast() {
        // 1 mm/s for 1 s, then 0.5 mm of braking
        assert_eq!(wall_speed(1.5, 1.0, 1.0), 1.0);
        assert!(!is_too_fast(1.0, 1.5, 1.0, 1.0));
        assert!(is_too_fast(1.0, 1.499, 1.0, 1.0) && is_too_fast(1.001, 1.5, 1.0, 1.0));
        for away_or_resting in [0.0, -0.5, -10.0] {
            assert!(!is_too_fast(away_or_resting, -0.1, 1.0, 1.0));
            assert!(!is_too_fast(away_or_resting, 0.1, 1.0, 1.0));
        }
    }

    proptest! {
        #[test]
        fn too_fast_is_what_is_above_the_speed_at_the_wall(
            distance in prop_oneof![4 => 1e-9..0.2f64, 1 => -0.1..0.0f64],
            (dt, acceleration) in (1e-4..2.0f64, 0.1..50.0f64),
            factor in prop_oneof![Just(0.5), Just(0.999), Just(1.001), Just(2.0)],
        ) {
            let most = wall_speed(distance, dt, acceleration);
            if most > 0.0 {
                prop_assert_eq!(is_too_fast(most * factor, distance, dt, acceleration), factor > 1.0);
            } else {
                prop_assert!(is_too_fast(factor, distance, dt, acceleration));
            }
        }

        #[test]
        fn the_limits_hold_whatever_is_asked(
            steps in prop::collection::vec((prop_oneof![
                4 => -0.3..0.3f64, 1 => Just(f64::NAN), 1 => Just(f64::INFINITY), 1 => Just(1e300), 1 => Just(0.0)
            ], prop_oneof![8 => Just(1e-3), 1 => 1e-5..5e-3f64, 1 => Just(0.0)], 0..40u8), 1..60),
        ) {
            let mut l = Limiter::new(LIMITS);
            for (target, dt, repeat) in steps {
                for i in 0..=repeat {
                    let (p, v) = (l.position(), l.velocity());
                    if i == 39 { l.brake(dt) } else { l.step(target, dt); }
                    prop_assert!(l.position().abs() <= LIMITS.size + 1e-12, "size {}", l.position());
                    prop_assert!(l.velocity().abs() <= LIMITS.rate * (1.0 + 1e-12), "rate {}", l.velocity());
                    prop_assert!((l.velocity() - v).abs() <= LIMITS.acceleration * dt * (1.0 + 1e-9) + 1e-12);
                    prop_assert!((l.position() - p - l.velocity() * dt).abs() <= 1e-12);
                }
            }
        }

        #[test]
        fn no_step_is_larger_than_allowed(
            steps in prop::collection::vec((prop::option::weighted(0.8, -0.3..0.3f64), 1e-4..1e-2f64), 1..200),
            step in 1e-5..1e-3f64,
        ) {
            let mut l = Limiter::new(AxisLimits { step, ..LIMITS });
            for (target, dt) in steps {
                let before = l.position();
                match target {
                    Some(target) => { l.step(target, dt); }
                    None => l.brake(dt),
                }
                prop_assert!((l.position() - before).abs() <= step * (1.0 + 1e-9) + 1e-15);
                prop_assert!(l.position().abs() <= LIMITS.size + 1e-12);
            }
        }

        #[test]
        fn on_the_way_to_zero_nothing_passes_it(
            start in -0.1..0.1f64, step in 1e-4..1e-2f64, shares in prop::collection::vec(0.0..1.0f64, 1..300),
        ) {
            let mut l = Limiter::new(AxisLimits { step, ..LIMITS });
            l.start_at(start);
            let mut last = start.abs();
            let mut target = start;
            for share in shares {
                // targets that only go to zero, at any speed
                target *= share;
                l.step_to_zero(target, 1e-3);
                prop_assert!(l.position() * start >= -1e-18, "{start} -> {}", l.position());
                last = last.max(l.position().abs());
            }
            prop_assert!(last <= start.abs() + 1e-12, "{start} grew to {last}");
        }

        #[test]
        fn every_constant_target_inside_is_reached(start in -0.1..0.1f64, target in -0.1..0.1f64, dt in 1e-4..1e-2f64) {
            let mut l = Limiter::new(LIMITS);
            l.start_at(start);
            for _ in 0..(2.0 / dt) as usize { l.step(target, dt); }
            prop_assert!((l.position() - target).abs() < 1e-12, "{} {}", l.position(), target);
        }
    }
}
