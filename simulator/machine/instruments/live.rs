//! Instruments that measure while the machine works, with everything that goes wrong with them: a laser tracker on the
//! tool and 5-DOF lasers along the axes, with reduced readings or with those of their detectors.
//!
//! They look at the true pose and write the JSON lines of `docs/how-to/sensors.md`. Each has a clock of its own. Noise, outliers
//! and dropouts are seeded; a bias and a step of the clock come when the plan says so.

use core::fmt::Write as _;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use volcomp_units::axes::AxisName;
use volcomp_units::{arcsec_from_rad, mm_from_um, rad_from_arcsec, um_from_mm};

use super::Noise;
use super::carriage::Seen;
use super::fivedof::{FiveDofLaser, Pointing};

/// What a live tracker is like.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LivePlan {
    /// Time between readings, s.
    pub every_s: f64,
    /// Noise of the tip, um.
    pub noise_um: f64,
    /// Noise of the direction, arcsec.
    pub noise_arcsec: f64,
    /// Share of readings that are off by 50 times the noise.
    pub outliers: f64,
    /// Share of readings after which the next two seconds are missing.
    pub dropouts: f64,
    /// Its clock minus the machine's, s.
    pub clock_s: f64,
    /// From this time on everything is off by so much in x: s, um.
    pub bias: Option<[f64; 2]>,
    /// From this time on the clock is off by so much more: s, s.
    pub skew: Option<[f64; 2]>,
}

impl Default for LivePlan {
    fn default() -> Self {
        Self {
            every_s: 0.02,
            noise_um: 5.0,
            noise_arcsec: 4.0,
            outliers: 0.0,
            dropouts: 0.0,
            clock_s: 86_400.0,
            bias: None,
            skew: None,
        }
    }
}

/// Length of a dropout, s.
const DROPOUT_S: f64 = 2.0;
/// Size of an outlier in standard deviations.
const OUTLIER: f64 = 50.0;

/// A tracker that follows the tool.
#[derive(Debug, Clone)]
pub struct LiveTracker {
    plan: LivePlan,
    random: ChaCha8Rng,
    next_s: f64,
}

impl LiveTracker {
    /// A tracker; the same seed makes the same mistakes.
    #[must_use]
    pub fn new(plan: LivePlan, seed: u64) -> Self {
        Self { plan, random: ChaCha8Rng::seed_from_u64(seed), next_s: 0.0 }
    }

    /// From now on it is like this.
    pub const fn set_plan(&mut self, plan: LivePlan) {
        self.plan = plan;
    }

    fn normal(&mut self) -> f64 {
        StandardNormal.sample(&mut self.random)
    }

    /// The line it sends `t_s` after the beginning about a tool with this tip and direction in the workpiece frame;
    /// `None` where it says nothing.
    pub fn line(&mut self, sensor: &str, t_s: f64, tip_mm: [f64; 3], direction: [f64; 3]) -> Option<String> {
        if t_s < self.next_s {
            return None;
        }
        self.next_s = (self.next_s + self.plan.every_s).max(t_s);
        let since =
            |event: Option<[f64; 2]>| event.filter(|[from, _]| t_s >= *from).map_or(0.0, |[_, size]| size);
        let plan = self.plan;
        if self.random.random::<f64>() < plan.dropouts {
            self.next_s = t_s + DROPOUT_S;
            return None;
        }
        let wild = if self.random.random::<f64>() < plan.outliers { OUTLIER } else { 1.0 };
        let mut tip = tip_mm.map(|v| v + wild * mm_from_um(plan.noise_um) * self.normal());
        tip[0] += mm_from_um(since(plan.bias));
        let turned = direction.map(|v| v + rad_from_arcsec(plan.noise_arcsec) * self.normal());
        let length = turned.iter().map(|v| v * v).sum::<f64>().sqrt();
        let [x, y, z] = turned.map(|v| v / length);
        let stamp_s = t_s + plan.clock_s + since(plan.skew);
        Some(format!(
            "{{\"sensor\":\"{sensor}\",\"t_s\":{stamp_s:.9},\"pose\":{{\"tip_mm\":[{:.7},{:.7},{:.7}],\
             \"direction\":[{x:.10},{y:.10},{z:.10}]}}}}\n",
            tip[0], tip[1], tip[2]
        ))
    }
}

/// A 5-DOF laser along an axis, with reduced readings; its zero and its line are its own.
#[derive(Debug, Clone)]
pub struct LiveLaser {
    every_s: f64,
    noise_um: f64,
    noise_arcsec: f64,
    /// Offset and slope of the line, mm and rad.
    line: [f64; 2],
    random: ChaCha8Rng,
    next_s: f64,
}

impl LiveLaser {
    /// A laser that is off by 80 um and 15 urad.
    #[must_use]
    pub fn new(every_s: f64, noise_um: f64, noise_arcsec: f64, seed: u64) -> Self {
        let random = ChaCha8Rng::seed_from_u64(seed);
        Self { every_s, noise_um, noise_arcsec, line: [0.08, 15e-6], random, next_s: 0.0 }
    }

    /// The line it sends about a carriage with the axis at `q` (mm) and these EY EZ EA EB EC of the carriage (carriage
    /// sense) in laser coordinates (mm, rad).
    pub fn line(&mut self, sensor: &str, t_s: f64, q: f64, motion: [f64; 5]) -> Option<String> {
        self.line_of(sensor, t_s, q, || motion)
    }

    /// The same with a motion that is asked for only where a line is due.
    pub fn line_of(
        &mut self,
        sensor: &str,
        t_s: f64,
        q: f64,
        motion: impl FnOnce() -> [f64; 5],
    ) -> Option<String> {
        if t_s < self.next_s {
            return None;
        }
        let motion = motion();
        self.next_s = (self.next_s + self.every_s).max(t_s);
        let [offset, slope] = self.line;
        let mut text = format!("{{\"sensor\":\"{sensor}\",\"t_s\":{:.9},\"five_dof\":{{", t_s + 4711.0);
        for (k, (name, value)) in
            ["ey_um", "ez_um", "ea_arcsec", "eb_arcsec", "ec_arcsec"].iter().zip(motion).enumerate()
        {
            let noise: f64 = StandardNormal.sample(&mut self.random);
            let value = if k < 2 {
                um_from_mm(value + offset + slope * q) + self.noise_um * noise
            } else {
                arcsec_from_rad(value) + 20.0 + self.noise_arcsec * noise
            };
            // writing to a string cannot fail
            let _ = write!(text, "{}\"{name}\":{value:.6}", if k > 0 { "," } else { "" });
        }
        Some(text + "}}\n")
    }
}

/// A 5-DOF laser along an axis that tells its detectors, its pointing wandering.
#[derive(Debug, Clone)]
pub struct LiveRawLaser {
    laser: FiveDofLaser,
    axis: AxisName,
    /// Lower end of the travel, mm.
    low: f64,
    every_s: f64,
    noise: Noise,
    pointing: Pointing,
    reference: Option<[[f64; 2]; 5]>,
    next_s: f64,
}

impl LiveRawLaser {
    /// A laser whose channels count from its first reading.
    #[must_use]
    pub fn new(laser: FiveDofLaser, axis: AxisName, low: f64, every_s: f64) -> Self {
        let (noise, pointing) = (Noise::new(laser.seed), Pointing::default());
        Self { laser, axis, low, every_s, noise, pointing, reference: None, next_s: 0.0 }
    }

    /// The channels at this moment as changes since the first reading, um, with the distance, mm; `None` where it says
    /// nothing.
    pub fn channels(
        &mut self,
        t_s: f64,
        q: f64,
        seen: impl FnOnce() -> Seen,
    ) -> Option<(f64, [[f64; 2]; 5])> {
        if t_s < self.next_s {
            return None;
        }
        let seen = seen();
        self.next_s = (self.next_s + self.every_s).max(t_s);
        self.pointing.step(&mut self.noise, rad_from_arcsec(self.laser.drift_arcsec));
        let along = q - self.low;
        let now = self.laser.read(self.axis, &seen, along, &self.pointing, [0.0; 2], &mut self.noise);
        let zero = *self.reference.get_or_insert(now);
        let change = std::array::from_fn(|c| std::array::from_fn(|i| now[c][i] - zero[c][i]));
        Some((self.laser.distance_mm + along, change))
    }

    /// The line it sends about a carriage with the axis at `q`.
    pub fn line(&mut self, sensor: &str, t_s: f64, q: f64, seen: impl FnOnce() -> Seen) -> Option<String> {
        let stamp_s = t_s + 4711.0;
        let (distance, change) = self.channels(t_s, q, seen)?;
        let mut text = format!(
            "{{\"sensor\":\"{sensor}\",\"t_s\":{stamp_s:.9},\"five_dof_raw\":{{\"distance_mm\":{distance:.4}"
        );
        for (name, [a, b]) in ["psd1_um", "psd2_um", "psd3_um", "qd1_um", "qd2_um"].iter().zip(change) {
            // writing to a string cannot fail
            let _ = write!(text, ",\"{name}\":[{a:.6},{b:.6}]");
        }
        Some(text + "}}\n")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lines(plan: LivePlan) -> Vec<(f64, [f64; 3])> {
        let mut tracker = LiveTracker::new(plan, 3);
        (0..20_000)
            .filter_map(|k| {
                let line = tracker.line("t", f64::from(k) * 1e-3, [1.0, 2.0, 3.0], [0.0, 0.0, 1.0])?;
                let json: serde_json::Value = serde_json::from_str(&line).unwrap();
                let at = |k: usize| json["pose"]["tip_mm"][k].as_f64().unwrap();
                Some((json["t_s"].as_f64().unwrap(), [at(0), at(1), at(2)]))
            })
            .collect()
    }

    #[test]
    fn noise_bias_and_clock_are_those_of_the_plan() {
        let plan = LivePlan { bias: Some([10.0, 300.0]), skew: Some([15.0, 0.05]), ..LivePlan::default() };
        let found = lines(plan);
        assert!((found.len() as f64 - 1000.0).abs() < 10.0, "{}", found.len());
        let of = |a: f64, b: f64| -> Vec<f64> {
            let own = |t: f64| t - plan.clock_s;
            found.iter().filter(|(t, _)| (a..b).contains(&own(*t))).map(|(_, tip)| tip[0] - 1.0).collect()
        };
        let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len() as f64;
        let (early, late) = (of(0.0, 10.0), of(10.0, 14.9));
        let std = (early.iter().map(|v| v * v).sum::<f64>() / early.len() as f64).sqrt();
        assert!((std - 0.005).abs() < 0.0006, "{std}");
        assert!((mean(&late) - 0.3).abs() < 0.002);
        let steps: Vec<f64> = found.windows(2).map(|w| w[1].0 - w[0].0).collect();
        assert!((steps.iter().copied().fold(0.0, f64::max) - 0.07).abs() < 2e-3);
    }

    #[test]
    fn dropouts_leave_holes_and_outliers_stand_out() {
        let found = lines(LivePlan { dropouts: 0.01, outliers: 0.02, ..LivePlan::default() });
        assert!(found.windows(2).any(|w| w[1].0 - w[0].0 > 1.9));
        assert!(found.iter().any(|(_, tip)| (tip[0] - 1.0).abs() > 0.08));
    }

    #[test]
    fn a_laser_has_its_own_line() {
        let mut laser = LiveLaser::new(0.1, 0.0, 0.0, 1);
        let line = laser.line("laser-x", 0.0, 1000.0, [0.002, 0.0, 1e-5, 0.0, 0.0]).unwrap();
        let json: serde_json::Value = serde_json::from_str(&line).unwrap();
        assert!((json["five_dof"]["ey_um"].as_f64().unwrap() - (2.0 + 80.0 + 15.0)).abs() < 1e-5);
        assert!(laser.line("laser-x", 0.05, 0.0, [0.0; 5]).is_none());
    }
}
