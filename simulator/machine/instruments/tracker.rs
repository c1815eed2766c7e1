//! A laser tracker beside the machine: range, azimuth and elevation to targets on a carriage, on the tool or on the bed.
//!
//! The tracker stands in M at a place and turned about its standing axis; neither is known to who evaluates. Targets on a
//! carriage follow from the pose of the tool relative to the workpiece while that axis moves alone.

use std::fmt::Write as _;

use nalgebra::{Matrix4, Vector3, Vector4};
use volcomp_units::axes::{AxisArray, MAX_AXES};
use volcomp_units::{mm_from_um, rad_from_arcsec, rad_from_deg};

use super::{Noise, Stop};
use crate::truth::TruthMachine;
use crate::truth::chain::Side;
use crate::truth::transform::{inverse, translation};

/// Systematic errors of a tracker: the same in every run, or drifting over minutes; averaging does not remove them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackerErrors {
    /// Error of the refractive index in use, 1e-6: a scale of all ranges.
    pub refraction_ppm: f64,
    /// Vertical temperature gradient of the air, K/m: bends the beam.
    pub gradient_k_per_m: f64,
    /// Amplitude of the encoders' errors, once and twice per turn and 8 times, arcsec.
    pub encoder_arcsec: [f64; 3],
    /// Phases of these for azimuth and elevation, rad.
    pub encoder_phase: [[f64; 3]; 2],
    /// Drift of range (um), azimuth and elevation (arcsec) during warm-up, from the first reading to infinity.
    pub warm_up: [f64; 3],
    /// Time constant of the warm-up, s.
    pub warm_up_s: f64,
    /// Time of one reading with aiming, s.
    pub reading_s: f64,
}

impl TrackerErrors {
    /// No systematic error.
    pub const NONE: Self = Self {
        refraction_ppm: 0.0,
        gradient_k_per_m: 0.0,
        encoder_arcsec: [0.0; 3],
        encoder_phase: [[0.0; 3]; 2],
        warm_up: [0.0; 3],
        warm_up_s: 1800.0,
        reading_s: 4.0,
    };

    /// A tracker in a shop: weather station off by a degree, encoders of 0.3 arcsec, switched on half an hour ago.
    #[must_use]
    pub fn shop(seed: u64) -> Self {
        let mut noise = Noise::new(seed ^ 0x7_4ac6);
        let mut phases = || [0.0; 3].map(|_: f64| noise.draw(10.0));
        let encoder_phase = [phases(), phases()];
        Self {
            refraction_ppm: noise.draw(1.0),
            gradient_k_per_m: noise.draw(0.3),
            encoder_arcsec: [0.3, 0.2, 0.1].map(|a| noise.draw(a)),
            encoder_phase,
            warm_up: [noise.draw(3.0), noise.draw(1.0), noise.draw(1.0)],
            ..Self::NONE
        }
    }

    /// Errors of range (mm), azimuth and elevation (rad) of a beam at a time.
    fn of(&self, range_mm: f64, angles: [f64; 2], time_s: f64) -> [f64; 3] {
        let encoder = |i: usize| -> f64 {
            [1.0, 2.0, 8.0]
                .iter()
                .zip(self.encoder_arcsec)
                .zip(self.encoder_phase[i])
                .map(|((order, amplitude), phase)| amplitude * (order * angles[i] + phase).sin())
                .sum()
        };
        let warm = 1.0 - (-time_s / self.warm_up_s).exp();
        // index of air falls by 0.93e-6 per K; the beam bends towards the colder side
        let bent = 0.93e-6 * self.gradient_k_per_m * range_mm * 1e-3 / 2.0;
        [
            self.refraction_ppm * 1e-6 * range_mm + mm_from_um(self.warm_up[0] * warm),
            rad_from_arcsec(encoder(0) + self.warm_up[1] * warm),
            rad_from_arcsec(encoder(1) + self.warm_up[2] * warm) + bent,
        ]
    }
}

/// The instrument.
#[derive(Debug, Clone)]
pub struct Tracker {
    /// Where it stands, in M.
    station_mm: [f64; 3],
    /// How it is turned about z.
    turn_rad: f64,
    range_mm: f64,
    angle_rad: f64,
    /// Part of the range noise that grows with the range.
    range_share: f64,
    errors: TrackerErrors,
    readings: u32,
    noise: Noise,
}

/// One reading.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Observation {
    /// Distance.
    pub range_mm: f64,
    /// Angle about the standing axis.
    pub azimuth_deg: f64,
    /// Angle above the horizontal.
    pub elevation_deg: f64,
}

impl Tracker {
    /// A tracker with the standard deviations of its readings.
    #[must_use]
    pub fn new(
        station_mm: [f64; 3],
        turn_deg: f64,
        noise_range_um: f64,
        noise_angle_arcsec: f64,
        seed: u64,
    ) -> Self {
        Self {
            station_mm,
            turn_rad: rad_from_deg(turn_deg),
            range_mm: mm_from_um(noise_range_um),
            angle_rad: rad_from_arcsec(noise_angle_arcsec),
            range_share: 0.0,
            errors: TrackerErrors::NONE,
            readings: 0,
            noise: Noise::new(seed),
        }
    }

    /// The same tracker with systematic errors, and range noise that grows by so much per metre.
    #[must_use]
    pub const fn with_errors(mut self, errors: TrackerErrors, noise_range_um_per_m: f64) -> Self {
        self.errors = errors;
        self.range_share = noise_range_um_per_m * 1e-6;
        self
    }

    /// Aims at a point of M.
    pub fn observe(&mut self, point_mm: [f64; 3]) -> Observation {
        let beam = Vector3::from(point_mm) - Vector3::from(self.station_mm);
        let (sine, cosine) = self.turn_rad.sin_cos();
        let (x, y) = (cosine * beam.x + sine * beam.y, cosine * beam.y - sine * beam.x);
        let true_angles = [y.atan2(x), beam.z.atan2(x.hypot(y))];
        let time_s = f64::from(self.readings) * self.errors.reading_s;
        self.readings += 1;
        let error = self.errors.of(beam.norm(), true_angles, time_s);
        let range_std = self.range_mm.hypot(self.range_share * beam.norm());
        let range = beam.norm() + error[0] + self.noise.draw(range_std);
        let azimuth = true_angles[0] + error[1] + self.noise.draw(self.angle_rad);
        let elevation = true_angles[1] + error[2] + self.noise.draw(self.angle_rad);
        Observation {
            range_mm: range,
            azimuth_deg: azimuth.to_degrees(),
            elevation_deg: elevation.to_degrees(),
        }
    }
}

/// Reference points on the bed, in M, mm: they tie the tracker's frame to the machine's.
const REFERENCES_MM: [[f64; 3]; 6] = [
    [-600.0, -500.0, -300.0],
    [1200.0, -450.0, -280.0],
    [1150.0, 900.0, -310.0],
    [-550.0, 850.0, 200.0],
    [1100.0, 950.0, 420.0],
    [-650.0, -480.0, 350.0],
];

/// The three files of a measurement, for `volcomp identify threepoint`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TrackerFiles {
    /// `point,x_mm,y_mm,z_mm`: the targets on the carriage at home, in M.
    pub points: String,
    /// Reference points in M and as the tracker sees them.
    pub registration: String,
    /// Range, azimuth and elevation of every target, stop by stop.
    pub data: String,
}

impl Tracker {
    /// Looks at the reference points on the bed, then at targets on the carriage of axis `k` at every stop.
    ///
    /// `targets`: names, and places in M with the axis at home, mm.
    pub fn measure(
        &mut self,
        machine: &TruthMachine,
        k: usize,
        targets: &[(String, [f64; 3])],
        stops: &[Stop],
    ) -> TrackerFiles {
        let mut see = |p: [f64; 3]| {
            let o = self.observe(p);
            // 1 nm at 10 m are 6e-9 deg
            format!("{:.6},{:.10},{:.10}", o.range_mm, o.azimuth_deg, o.elevation_deg)
        };
        let mut registration =
            String::from("point,machine_x_mm,machine_y_mm,machine_z_mm,range_mm,azimuth_deg,elevation_deg\n");
        for (i, p) in REFERENCES_MM.iter().enumerate() {
            // writing into a string cannot fail
            let _ = writeln!(registration, "r{},{},{},{},{}", i + 1, p[0], p[1], p[2], see(*p));
        }
        let mut data = String::from("position_mm,cycle,direction");
        for (name, _) in targets {
            let _ = write!(data, ",{name}_range_mm,{name}_azimuth_deg,{name}_elevation_deg");
        }
        data.push('\n');
        let places: Vec<[f64; 3]> = targets.iter().map(|t| t.1).collect();
        for stop in stops {
            let _ = write!(data, "{},{},{}", stop.position, stop.cycle, stop.direction);
            for p in on_carriage(machine, k, stop.position, stop.direction, &places) {
                let _ = write!(data, ",{}", see(p));
            }
            data.push('\n');
        }
        TrackerFiles { points: points_csv(targets), registration, data }
    }
}

/// `point,x_mm,y_mm,z_mm` of targets.
#[must_use]
pub fn points_csv(targets: &[(String, [f64; 3])]) -> String {
    let mut text = String::from("point,x_mm,y_mm,z_mm\n");
    for (name, [x, y, z]) in targets {
        // writing into a string cannot fail
        let _ = writeln!(text, "{name},{x},{y},{z}");
    }
    text
}

/// Seeded normal noise on the coordinates of a point, or on other readings of equal noise.
#[derive(Debug, Clone)]
pub struct PointNoise {
    noise: Noise,
    std: f64,
}

impl PointNoise {
    /// Noise with a standard deviation per coordinate.
    #[must_use]
    pub fn new(std_um: f64, seed: u64) -> Self {
        Self::with_std(mm_from_um(std_um), seed)
    }

    /// Noise in any unit.
    #[must_use]
    pub fn with_std(std: f64, seed: u64) -> Self {
        Self { noise: Noise::new(seed), std }
    }

    /// The point as it is read.
    pub fn read(&mut self, point_mm: [f64; 3]) -> [f64; 3] {
        point_mm.map(|v| v + self.noise.draw(self.std))
    }

    /// One number as it is read.
    pub fn draw(&mut self) -> f64 {
        self.noise.draw(self.std)
    }
}

/// Where points that ride on the carriage of axis `k` are, in M, with axis `k` at `q` and the others at home.
///
/// `points_mm` are their places at home on the machine without errors.
#[must_use]
pub fn on_carriage(
    machine: &TruthMachine,
    k: usize,
    q: f64,
    direction: i8,
    points_mm: &[[f64; 3]],
) -> Vec<[f64; 3]> {
    let mut position = AxisArray::default();
    position[k] = q;
    let mut directions = [0i8; MAX_AXES];
    directions[k] = direction;
    let seen = machine.pose(&position, &directions).matrix;
    let origin = translation(machine.workpiece_origin_mm());
    let tip = translation(machine.tool_tip_mm());
    // the tool side of the machine relative to the workpiece side, both as bodies whose coordinates are those of M at home
    let relative = origin * seen * inverse(&tip);
    let body = if on_workpiece_side(machine, k) { inverse(&relative) } else { relative };
    points_mm.iter().map(|p| apply(&body, *p)).collect()
}

/// True where axis `k` carries the workpiece: its carriage moves by minus the programmed coordinate.
#[must_use]
pub fn on_workpiece_side(machine: &TruthMachine, k: usize) -> bool {
    machine.drawing(k).is_some_and(|joint| joint.side == Side::Workpiece)
}

/// Where points of the tool are relative to the workpiece, in M at home; `points_mm` are relative to the tip, z towards
/// the spindle.
#[must_use]
pub fn on_tool(
    machine: &TruthMachine,
    q: &AxisArray,
    direction: &[i8; MAX_AXES],
    points_mm: &[[f64; 3]],
) -> Vec<[f64; 3]> {
    let body = translation(machine.workpiece_origin_mm()) * machine.pose(q, direction).matrix;
    points_mm.iter().map(|p| apply(&body, *p)).collect()
}

fn apply(body: &Matrix4<f64>, p: [f64; 3]) -> [f64; 3] {
    let image = body * Vector4::new(p[0], p[1], p[2], 1.0);
    [image.x, image.y, image.z]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::truth::VMC_850;

    #[test]
    fn a_point_is_where_range_and_angles_say() {
        let mut tracker = Tracker::new([2000.0, -500.0, 100.0], 30.0, 0.0, 0.0, 1);
        let o = tracker.observe([100.0, 900.0, 400.0]);
        let (azimuth, elevation) = ((o.azimuth_deg + 30.0).to_radians(), o.elevation_deg.to_radians());
        let point = [
            2000.0 + o.range_mm * elevation.cos() * azimuth.cos(),
            -500.0 + o.range_mm * elevation.cos() * azimuth.sin(),
            100.0 + o.range_mm * elevation.sin(),
        ];
        for (found, wanted) in point.iter().zip([100.0, 900.0, 400.0]) {
            assert!((found - wanted).abs() < 1e-9);
        }
    }

    #[test]
    fn systematic_errors_repeat_and_warm_up_ends() {
        let errors = TrackerErrors { refraction_ppm: 2.0, warm_up: [4.0, 0.0, 0.0], ..TrackerErrors::NONE };
        let mut tracker = Tracker::new([0.0; 3], 0.0, 0.0, 0.0, 1).with_errors(errors, 0.0);
        let first = tracker.observe([3000.0, 0.0, 0.0]).range_mm;
        assert!((first - 3000.0 - 0.006).abs() < 1e-9);
        for _ in 0..5000 {
            tracker.observe([3000.0, 0.0, 0.0]);
        }
        let last = tracker.observe([3000.0, 0.0, 0.0]).range_mm;
        assert!((last - first - 0.004).abs() < 1e-6, "{last} {first}");
        assert_eq!(TrackerErrors::shop(3), TrackerErrors::shop(3));
    }

    #[test]
    fn carriages_move_their_way() {
        let machine = TruthMachine::from_toml(VMC_850).unwrap();
        for (name, sign) in [("X", -1.0), ("Y", -1.0), ("Z", 1.0)] {
            let k = machine.axes().iter().position(|a| a.to_string() == name).unwrap();
            let q = machine.travel(k).iter().sum::<f64>() / 2.0;
            let direction = machine.axes()[k].direction();
            let home = on_carriage(&machine, k, 0.0, 0, &[[10.0, 20.0, 30.0]])[0];
            let there = on_carriage(&machine, k, q, 0, &[[10.0, 20.0, 30.0]])[0];
            for i in 0..3 {
                let expected = if i == direction { sign * q } else { 0.0 };
                assert!((there[i] - home[i] - expected).abs() < 0.2, "{name} {i}: {}", there[i] - home[i]);
            }
        }
    }
}
