//! Two laser trackers: registered to the machine by common reference balls, on circles of a rod and on the head while it cuts.

use std::fmt::Write as _;

use anyhow::Context;
use nalgebra::{Matrix3, Matrix4, Rotation3, Vector3};
use volcomp_units::axes::{AxisArray, MAX_AXES};

use super::World;
use crate::control::CycleRecord;
use crate::instruments::tracker::{Observation, Tracker, TrackerErrors};
use crate::truth::TruthMachine;

/// Standard deviations of a reading: range, um, and angles, arcsec.
pub(super) const RANGE_UM: f64 = 0.5;
pub(super) const ANGLE_ARCSEC: f64 = 0.75;
/// Readings of each ball in a registration.
const BALL_READINGS: u32 = 40;
/// Reflectors on the housing of the spindle, from the tip, machine axes with all axes at zero, mm.
const REFLECTORS: [[f64; 3]; 2] = [[90.0, 0.0, 120.0], [-60.0, 70.0, 300.0]];

/// Where two trackers stand and the balls about the place of work, in M, mm.
#[derive(Debug, Clone, Copy)]
pub(super) struct Setup {
    stations: [[f64; 3]; 2],
    balls: [[f64; 3]; 5],
}

/// About the ram at home, for circle following.
pub(super) const AT_HOME: Setup = Setup {
    stations: [[-1700.0, -1500.0, -900.0], [1500.0, -1900.0, -800.0]],
    balls: [
        [-500.0, -450.0, -1400.0],
        [550.0, -400.0, -1380.0],
        [500.0, 450.0, -1400.0],
        [-450.0, 500.0, -900.0],
        [400.0, 420.0, -450.0],
    ],
};

/// About the parts.
pub(super) const AT_PARTS: Setup = Setup {
    stations: [[-100.0, -700.0, -1000.0], [3100.0, -800.0, -950.0]],
    balls: [
        [1150.0, 650.0, -1300.0],
        [2050.0, 600.0, -1280.0],
        [2000.0, 1350.0, -1300.0],
        [1100.0, 1400.0, -1000.0],
        [2100.0, 1250.0, -900.0],
    ],
};

/// A tracker in its place; the same seed makes the same instrument.
fn tracker(world: &World, setup: &Setup, n: usize, reading_s: f64, seed: u64) -> Tracker {
    let own = world.seed.wrapping_mul(7).wrapping_add(n as u64);
    let errors = if world.tracker_errors {
        TrackerErrors { reading_s, ..TrackerErrors::shop(own) }
    } else {
        TrackerErrors::NONE
    };
    Tracker::new(setup.stations[n], 20.0 + 70.0 * n as f64, RANGE_UM, ANGLE_ARCSEC, own ^ seed)
        .with_errors(errors, 0.0)
}

fn cartesian(o: &Observation) -> Vector3<f64> {
    let (azimuth, elevation) = (o.azimuth_deg.to_radians(), o.elevation_deg.to_radians());
    o.range_mm
        * Vector3::new(elevation.cos() * azimuth.cos(), elevation.cos() * azimuth.sin(), elevation.sin())
}

/// Both trackers on circles that targets on a turning rod draw.
pub(super) struct Followers {
    trackers: [Tracker; 2],
    /// Files `--registration`.
    pub(super) registrations: [String; 2],
}

impl Followers {
    pub(super) fn new(world: &World) -> Self {
        let mut trackers = [0, 1].map(|n| tracker(world, &AT_HOME, n, 0.2, 0x51));
        let registrations = trackers.each_mut().map(|t| {
            let mut text =
                "point,machine_x_mm,machine_y_mm,machine_z_mm,range_mm,azimuth_deg,elevation_deg\n"
                    .to_owned();
            for (i, ball) in AT_HOME.balls.iter().enumerate() {
                let o = mean(t, *ball);
                let [x, y, z] = ball;
                let _ = writeln!(
                    text,
                    "r{i},{x},{y},{z},{:.6},{:.10},{:.10}",
                    o.range_mm, o.azimuth_deg, o.elevation_deg
                );
            }
            text
        });
        Self { trackers, registrations }
    }

    /// The table of one circle: number, points in M.
    pub(super) fn circle(&mut self, n: usize, points: &[[f64; 3]]) -> String {
        let mut text = "circle,range_mm,azimuth_deg,elevation_deg\n".to_owned();
        for p in points {
            let o = self.trackers[n].observe(*p);
            let _ =
                writeln!(text, "{},{:.6},{:.10},{:.10}", n + 1, o.range_mm, o.azimuth_deg, o.elevation_deg);
        }
        text
    }
}

/// Mean of the readings of a ball.
fn mean(tracker: &mut Tracker, ball: [f64; 3]) -> Observation {
    let mut sum = [0.0; 3];
    for _ in 0..BALL_READINGS {
        let o = tracker.observe(ball);
        sum[0] += o.range_mm;
        sum[1] += o.azimuth_deg;
        sum[2] += o.elevation_deg;
    }
    let [range_mm, azimuth_deg, elevation_deg] = sum.map(|v| v / f64::from(BALL_READINGS));
    Observation { range_mm, azimuth_deg, elevation_deg }
}

/// A tracker on a reflector of the head, its readings in the frame of the machine.
#[derive(Debug)]
struct Watcher {
    tracker: Tracker,
    rotation: Matrix3<f64>,
    shift: Vector3<f64>,
    reflector: Vector3<f64>,
}

/// Both trackers on the head while it works.
#[derive(Debug)]
pub(super) struct Watchers {
    watchers: Vec<Watcher>,
    every_s: f64,
    next_s: f64,
    /// Feed of the last cycles, mm/min, and for how many it has been the same.
    feed: (f64, u32),
    /// The machine at this time, for the place of the reflectors.
    machine: TruthMachine,
    origin: Vector3<f64>,
}

impl Watchers {
    /// Trackers that are registered to the balls about the parts and read every so often.
    pub(super) fn new(world: &World, machine: &TruthMachine, every_s: f64) -> anyhow::Result<Self> {
        let mut watchers = Vec::new();
        for (n, reflector) in REFLECTORS.into_iter().enumerate() {
            let mut tracker = tracker(world, &AT_PARTS, n, every_s, 0xc07);
            let seen: Vec<Vector3<f64>> =
                AT_PARTS.balls.iter().map(|b| cartesian(&mean(&mut tracker, *b))).collect();
            let balls = AT_PARTS.balls.map(Vector3::from);
            let (rotation, shift) = best_fit(&seen, &balls)?;
            watchers.push(Watcher { tracker, rotation, shift, reflector: reflector.into() });
        }
        let origin = machine.workpiece_origin_mm().into();
        Ok(Self { watchers, every_s, next_s: 0.0, feed: (0.0, 0), machine: machine.clone(), origin })
    }

    /// Takes the feed of a cycle; true where it has not changed for ten cycles.
    pub(super) fn is_steady(&mut self, feed: f64) -> bool {
        let (last, count) = self.feed;
        self.feed = if (feed - last).abs() < 0.1 { (feed, count.saturating_add(1)) } else { (feed, 0) };
        self.feed.1 >= 10
    }

    /// The line about this cycle where one is due: both reflectors, measured minus nominal at the command.
    pub(super) fn line(&mut self, sensor: &str, r: &CycleRecord) -> Option<String> {
        if r.time_s < self.next_s {
            return None;
        }
        self.next_s = r.time_s + self.every_s;
        self.machine.set_time_s(r.time_s);
        let body = body(&self.machine, &r.sample.axis, r.sample.tip_mm, r.sample.direction);
        let nominal = self.machine.nominal(&r.commanded).matrix;
        let mut text = format!("{{\"sensor\":\"{sensor}\",\"t_s\":{:.6},\"points\":[", r.time_s);
        for (n, w) in self.watchers.iter_mut().enumerate() {
            let at = |m: &Matrix4<f64>| (m * w.reflector.push(1.0)).xyz();
            let there = at(&body) + self.origin;
            let seen = w.rotation * cartesian(&w.tracker.observe(there.into())) + w.shift;
            let [x, y, z]: [f64; 3] = ((seen - self.origin - at(&nominal)) * 1e3).into();
            let [i, j, k]: [f64; 3] = w.reflector.into();
            let std_um = RANGE_UM
                .hypot(ANGLE_ARCSEC * 4.848e-6 * (there - Vector3::from(AT_PARTS.stations[n])).norm() * 1e3);
            let _ = write!(
                text,
                "{}{{\"offset_mm\":[{i},{j},{k}],\"deviation_um\":[{x:.4},{y:.4},{z:.4}],\"std_um\":{std_um:.2}}}",
                if n > 0 { "," } else { "" }
            );
        }
        Some(text + "]}\n")
    }
}

/// The tool as a rigid body whose tip and direction are known; the turn about its own axis is that at rest.
fn body(machine: &TruthMachine, axes: &AxisArray, tip: [f64; 3], direction: [f64; 3]) -> Matrix4<f64> {
    let at_rest = machine.pose(axes, &[0; MAX_AXES]);
    let rotation: Matrix3<f64> = at_rest.matrix.fixed_view::<3, 3>(0, 0).into_owned();
    // a few arcseconds: the sine is the angle
    let lean = Rotation3::new(Vector3::from(at_rest.direction).cross(&Vector3::from(direction)));
    let mut body = Matrix4::identity();
    body.fixed_view_mut::<3, 3>(0, 0).copy_from(&(lean.matrix() * rotation));
    body.fixed_view_mut::<3, 1>(0, 3).copy_from(&Vector3::from(tip));
    body
}

/// Rotation and shift that lead points to their places by least squares.
fn best_fit(
    points: &[Vector3<f64>],
    places: &[Vector3<f64>],
) -> anyhow::Result<(Matrix3<f64>, Vector3<f64>)> {
    let n = points.len().max(1) as f64;
    let centre = |list: &[Vector3<f64>]| list.iter().sum::<Vector3<f64>>() / n;
    let (a, b) = (centre(points), centre(places));
    let product: Matrix3<f64> = points.iter().zip(places).map(|(p, q)| (q - b) * (p - a).transpose()).sum();
    let svd = product.svd(true, true);
    let (u, v) = (svd.u.context("registration")?, svd.v_t.context("registration")?);
    let sign = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, (u * v).determinant().signum()));
    let rotation = u * sign * v;
    Ok((rotation, b - rotation * a))
}
