//! What moves and measures one axis: delay, servo lag, lost motion, slow non-repeatability, encoder, yielding structure.
//!
//! Coordinates in mm or deg. The order along the axis: set point -> servo -> drive position (what the encoder
//! reads) -> lost motion, non-repeatability and structure -> carriage.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::structure::{Delay, Structure, StructureSpec};

/// The drive train of one axis; lengths in the axis' own unit (mm or deg).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DriveSpec {
    /// Time constant of the position loop, s; 0 follows at once.
    pub lag_s: f64,
    /// Share of the following error that velocity feed-forward takes away, 0 to 1.
    pub feed_forward: f64,
    /// Lost motion between drive and carriage on reversal.
    pub backlash: f64,
    /// Way over which a reversal takes effect at least.
    pub reversal: f64,
    /// Standard deviation of the slowly wandering non-repeatability.
    pub repeatability: f64,
    /// Correlation time of that, s.
    pub repeatability_s: f64,
    /// Step of the encoder; 0 is continuous.
    pub encoder_step: f64,
    /// Standard deviation of the encoder noise.
    pub encoder_noise: f64,
    /// What lies behind the drive.
    pub structure: StructureSpec,
}

/// Where one axis is now.
#[derive(Debug, Clone)]
pub struct Drive {
    spec: DriveSpec,
    set_point: f64,
    position: f64,
    /// -1: lost motion taken up towards minus; +1: towards plus.
    slack: f64,
    wander: f64,
    random: ChaCha8Rng,
    delay: Delay,
    structure: Structure,
}

impl DriveSpec {
    /// An axis that follows its command exactly.
    pub const IDEAL: Self = Self {
        lag_s: 0.0,
        feed_forward: 0.0,
        backlash: 0.0,
        reversal: 0.002,
        repeatability: 0.0,
        repeatability_s: 5.0,
        encoder_step: 0.0,
        encoder_noise: 0.0,
        structure: StructureSpec::RIGID,
    };
}

impl Drive {
    /// An axis at rest at `start`, lost motion not taken up on either side.
    #[must_use]
    pub fn new(spec: DriveSpec, seed: u64, stream: u64, start: f64) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        random.set_stream(stream);
        let wander = spec.repeatability * normal(&mut random);
        let (delay, structure) = (Delay::new(start), Structure::new(spec.structure, start));
        Self { spec, set_point: start, position: start, slack: 0.0, wander, random, delay, structure }
    }

    /// One cycle towards a set point that moves evenly through the cycle (drives interpolate finely).
    ///
    /// Exact solution of `lag x' = u + feed_forward lag u' - x` for a ramp u; steady following error
    /// `(1 - feed_forward) lag v`.
    pub fn follow(&mut self, dt_s: f64, set_point: f64) {
        let set_point = self.delay.step(dt_s, self.spec.structure.delay_s, set_point);
        let next = if self.spec.lag_s > 0.0 && dt_s > 0.0 {
            let rate = (set_point - self.set_point) / dt_s;
            let behind = (1.0 - self.spec.feed_forward) * rate * self.spec.lag_s;
            let decay = (-dt_s / self.spec.lag_s).exp();
            set_point - behind + (self.position - self.set_point + behind) * decay
        } else {
            set_point
        };
        self.set_point = set_point;
        self.arrive(dt_s, next);
    }

    /// One cycle in which the axis is known to have gone to `position`.
    pub fn place(&mut self, dt_s: f64, position: f64) {
        self.set_point = position;
        self.arrive(dt_s, position);
    }

    fn arrive(&mut self, dt_s: f64, position: f64) {
        let half_way = (self.spec.backlash / 2.0).max(self.spec.reversal / 2.0);
        if half_way > 0.0 {
            self.slack = (self.slack + (position - self.position) / half_way).clamp(-1.0, 1.0);
        }
        self.position = position;
        self.structure.step(dt_s, position);
        if self.spec.repeatability > 0.0 && self.spec.repeatability_s > 0.0 {
            let kept = (-dt_s / self.spec.repeatability_s).exp();
            let fresh = (1.0 - kept * kept).sqrt() * self.spec.repeatability;
            self.wander = kept * self.wander + fresh * normal(&mut self.random);
        }
    }

    /// Position of the drive.
    #[must_use]
    pub const fn position(&self) -> f64 {
        self.position
    }

    /// How far the way of a reversal is taken up: -1 towards minus to +1 towards plus.
    #[must_use]
    pub const fn slack(&self) -> f64 {
        self.slack
    }

    /// What the structure does beside the shift along the axis: EX EY EZ in mm, EA EB EC in rad.
    #[must_use]
    pub const fn structure_motion(&self) -> &[f64; 6] {
        &self.structure.motion
    }

    /// Position of the carriage: the drive's, less lost motion, plus what does not repeat and what yields.
    #[must_use]
    pub fn carriage(&self) -> f64 {
        self.position - self.slack * self.spec.backlash / 2.0 + self.wander + self.structure.along
    }

    /// What the encoder reports now; draws noise.
    pub fn read_encoder(&mut self) -> f64 {
        let noisy = if self.spec.encoder_noise > 0.0 {
            self.position + self.spec.encoder_noise * normal(&mut self.random)
        } else {
            self.position
        };
        if self.spec.encoder_step > 0.0 {
            (noisy / self.spec.encoder_step).round() * self.spec.encoder_step
        } else {
            noisy
        }
    }
}

fn normal(random: &mut ChaCha8Rng) -> f64 {
    StandardNormal.sample(random)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lagging(feed_forward: f64) -> Drive {
        Drive::new(DriveSpec { lag_s: 0.005, feed_forward, ..DriveSpec::IDEAL }, 1, 0, 0.0)
    }

    #[test]
    fn following_error_of_a_ramp_is_speed_times_lag_at_any_cycle_time() {
        for (dt, feed_forward) in [(0.000_25, 0.0), (0.001, 0.0), (0.01, 0.0), (0.001, 0.8)] {
            let mut drive = lagging(feed_forward);
            let speed = 40.0;
            let mut set_point = 0.0;
            for _ in 0..(0.2 / dt) as usize {
                set_point += speed * dt;
                drive.follow(dt, set_point);
            }
            let behind = set_point - drive.position();
            assert!((behind - (1.0 - feed_forward) * speed * 0.005).abs() < 1e-12, "{dt}: {behind}");
        }
    }

    #[test]
    fn two_half_cycles_equal_one_whole() {
        let (mut halves, mut whole) = (lagging(0.3), lagging(0.3));
        for k in 1..20 {
            halves.follow(0.001, 0.5 * f64::from(2 * k - 1));
            halves.follow(0.001, f64::from(k));
            whole.follow(0.002, f64::from(k));
            assert!((halves.position() - whole.position()).abs() < 1e-12);
        }
    }

    #[test]
    fn lost_motion_shows_on_reversal_and_is_hidden_from_the_encoder() {
        let mut drive = Drive::new(DriveSpec { backlash: 0.01, ..DriveSpec::IDEAL }, 1, 0, 0.0);
        drive.place(0.001, 5.0);
        assert!((drive.carriage() - 4.995).abs() < 1e-12);
        drive.place(0.001, 4.995);
        assert!((drive.carriage() - 4.995).abs() < 1e-12, "the drive takes up the play first");
        drive.place(0.001, 4.0);
        assert!((drive.carriage() - 4.005).abs() < 1e-12);
        assert_eq!(drive.read_encoder(), 4.0);
    }

    #[test]
    fn the_encoder_counts_in_its_steps() {
        let mut drive = Drive::new(DriveSpec { encoder_step: 1e-4, ..DriveSpec::IDEAL }, 1, 0, 0.0);
        drive.place(0.001, 0.123_46);
        assert!((drive.read_encoder() - 0.1235).abs() < 1e-12);
    }

    #[test]
    fn wandering_has_its_standard_deviation() {
        let spec = DriveSpec { repeatability: 0.002, repeatability_s: 0.01, ..DriveSpec::IDEAL };
        let mut drive = Drive::new(spec, 9, 0, 0.0);
        let cycles = 50_000;
        let power: f64 = (0..cycles)
            .map(|_| {
                drive.place(0.01, 0.0);
                drive.carriage().powi(2)
            })
            .sum();
        let deviation = (power / f64::from(cycles)).sqrt();
        assert!((deviation - 0.002).abs() < 0.0001, "{deviation}");
    }
}
