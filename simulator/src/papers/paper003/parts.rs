//! The parts: flanks that the tool mills with its side, their part programs, and what a coordinate measuring machine finds.
//!
//! A flank is a family of straight lines, each the axis of the tool at one moment: the deviation of the surface is that of the
//! tool axis, across it, at the height of the contact.

use std::fmt::Write as _;

use nalgebra::Vector3;

use crate::control::CycleRecord;
use crate::twin::Dice;

/// Tool tip in programmed coordinates, mm, and direction from the tip to the spindle.
type Ruling = (Vector3<f64>, Vector3<f64>);

/// Measured points at every height: share of the way and deviation, um.
pub(super) type Rows = Vec<Vec<(f64, f64)>>;

/// A part.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Part {
    /// S-shaped ruled flank in the manner of ISO 10791-7, annex M.
    S,
    /// Tilted cone frustum in the manner of ISO 10791-7, M3, and NAS 979, with the diameters of the paper.
    Cone,
}

/// Middle of the S and of the cone, programmed, mm.
const S_CENTRE: [f64; 3] = [1450.0, 950.0, -600.0];
const CONE_CENTRE: [f64; 3] = [1750.0, 1050.0, -600.0];
/// Length and width of the S, mm.
const S_SIZE: [f64; 2] = [300.0, 150.0];
/// Largest tilt of the tool on the S, deg.
const S_TILT_DEG: f64 = 18.0;
/// Radii of the cone, mm, its half angle and the tilt of its axis, deg.
const CONE_RADII: [f64; 2] = [43.0, 20.0];
const CONE_HALF_DEG: f64 = 15.0;
const CONE_TILT_DEG: f64 = 10.0;
/// Undulations per revolution that roundness holds, the filter of ISO 12181-2.
const UPR: u32 = 15;
/// Radius of the cutter, mm.
const CUTTER_MM: f64 = 10.0;
/// Step for slopes along the part.
const STEP: f64 = 1e-5;

impl Part {
    /// Heights of the contacts that are measured, along the tool from the tip, mm.
    pub(super) fn heights(self) -> Vec<f64> {
        match self {
            Self::S => vec![5.0, 20.0, 35.0],
            Self::Cone => {
                let flank = (CONE_RADII[0] - CONE_RADII[1]) / CONE_HALF_DEG.to_radians().sin();
                vec![0.0, flank]
            }
        }
    }

    /// Feed, mm/min.
    const fn feed(self) -> f64 {
        match self {
            Self::S => 700.0,
            Self::Cone => 600.0,
        }
    }

    const fn blocks(self) -> u32 {
        match self {
            Self::S => 2000,
            Self::Cone => 1440,
        }
    }

    /// Measured points at each height.
    const fn points(self) -> u32 {
        match self {
            Self::S => 30,
            Self::Cone => 72,
        }
    }

    /// The tool at a share 0 to 1 of the way.
    fn at(self, u: f64) -> Ruling {
        let turn = std::f64::consts::TAU * u;
        match self {
            Self::S => {
                let [length, width] = S_SIZE;
                let place = Vector3::new(length * (u - 0.5), 0.5 * width * turn.sin(), 0.0);
                let tilt = S_TILT_DEG.to_radians() * (0.7 + 0.3 * turn.cos());
                let slope = 0.5 * width * std::f64::consts::TAU * turn.cos() / length;
                let heading = std::f64::consts::FRAC_PI_2 + slope.atan();
                let direction =
                    Vector3::new(tilt.sin() * heading.cos(), tilt.sin() * heading.sin(), tilt.cos());
                (Vector3::from(S_CENTRE) + place, direction)
            }
            Self::Cone => {
                let (sin_half, cos_half) = CONE_HALF_DEG.to_radians().sin_cos();
                let (sin, cos) = turn.sin_cos();
                let normal = Vector3::new(cos_half * cos, cos_half * sin, sin_half);
                let contact = Vector3::new(CONE_RADII[0] * cos, CONE_RADII[0] * sin, 0.0);
                let direction = Vector3::new(-sin_half * cos, -sin_half * sin, cos_half);
                let tilt =
                    nalgebra::Rotation3::from_axis_angle(&Vector3::x_axis(), CONE_TILT_DEG.to_radians());
                (Vector3::from(CONE_CENTRE) + tilt * (contact + normal * CUTTER_MM), tilt * direction)
            }
        }
    }

    /// Outward normal of the flank at a height.
    fn normal(self, u: f64, height: f64) -> Vector3<f64> {
        let [a, b] = [u - STEP, u + STEP].map(|u| {
            let (tip, direction) = self.at(u);
            tip + direction * height
        });
        (b - a).cross(&self.at(u).1).normalize()
    }

    /// The part program, with tool-centre-point motion.
    pub(super) fn program(self) -> String {
        let mut rows: Vec<([f64; 3], f64, f64)> = Vec::new();
        let mut last_deg = 0.0;
        for k in 0..=self.blocks() {
            let (tip, d) = self.at(f64::from(k) / f64::from(self.blocks()));
            let a_deg = -d.x.hypot(d.y).atan2(d.z).to_degrees();
            let heading = d.y.atan2(d.x).to_degrees() - 90.0;
            let c_deg = heading + 360.0 * ((last_deg - heading) / 360.0_f64).round();
            last_deg = c_deg;
            rows.push((tip.into(), a_deg, c_deg));
        }
        // C in the middle of its travel
        let middle = rows.iter().map(|r| r.2).sum::<f64>() / rows.len().max(1) as f64;
        let shift = 360.0 * (middle / 360.0).round();
        let mut text = String::from("(SCORE OFF)\nG21 G90 G94 G64\nF3000\nG43.4 H1\n");
        for (k, ([x, y, z], a, c)) in rows.into_iter().enumerate() {
            if k == 0 {
                let _ = writeln!(text, "G1 X{x:.6} Y{y:.6} Z{:.6}", z + 100.0);
                let _ = writeln!(text, "G1 A{a:.6} C{:.6}\nG1 Z{z:.6}\nG4 P3", c - shift);
                let _ = writeln!(text, "F{}\n(SCORE ON)", self.feed());
                continue;
            }
            let _ = writeln!(text, "G1 X{x:.6} Y{y:.6} Z{z:.6} A{a:.6} C{:.6}", c - shift);
        }
        let _ = write!(text, "(SCORE OFF)\nF3000\nG91\nG1 Z100\nG90\nG49\nM30\n");
        text
    }
}

/// A cut part as the machine left it: share of the way and deviation at every height, mm.
#[derive(Debug, Clone, Default)]
pub(super) struct Flank(Vec<(f64, Vec<f64>)>);

impl Flank {
    /// What the tool left: cycles as tip (workpiece frame) and direction; `origin` is the tip in the workpiece frame with all
    /// axes at zero.
    pub(super) fn cut(
        part: Part,
        cycles: impl Iterator<Item = ([f64; 3], [f64; 3])>,
        origin: [f64; 3],
    ) -> Self {
        let heights = part.heights();
        let mut u = 0.0;
        let mut rows = Vec::new();
        for (tip, direction) in cycles {
            let tip = Vector3::from(tip) - Vector3::from(origin);
            for _ in 0..3 {
                let tangent = (part.at(u + STEP).0 - part.at(u - STEP).0) / (2.0 * STEP);
                u += (tip - part.at(u).0).dot(&tangent) / tangent.norm_squared();
            }
            let (nominal, ruling) = part.at(u);
            let deviation = heights
                .iter()
                .map(|h| {
                    let off = tip - nominal + (Vector3::from(direction) - ruling) * *h;
                    part.normal(u, *h).dot(&off)
                })
                .collect();
            rows.push((u, deviation));
        }
        Self(rows)
    }

    /// The same of recorded cycles.
    pub(super) fn of(part: Part, cycles: &[CycleRecord], origin: [f64; 3]) -> Self {
        Self::cut(part, cycles.iter().map(|r| (r.sample.tip_mm, r.sample.direction)), origin)
    }

    fn at(&self, u: f64, height: usize) -> f64 {
        let i = self.0.partition_point(|r| r.0 < u).min(self.0.len().saturating_sub(1));
        self.0.get(i).and_then(|r| r.1.get(height)).copied().unwrap_or(f64::NAN)
    }
}

/// A coordinate measuring machine: noise of a touch, and errors of its scales.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cmm {
    /// Standard deviation of a touch, um.
    pub(super) noise_um: f64,
    /// Errors of the scales, um/m.
    pub(super) scale_um_per_m: [f64; 3],
    /// Seed of the noise.
    pub(super) seed: u64,
}

impl Cmm {
    /// Deviations, um, of all points at each height: share of the way and value.
    pub(super) fn measure(&self, part: Part, flank: &Flank) -> Rows {
        let mut dice = Dice::new(self.seed, "touches of paper 003");
        let centre = Vector3::from(if part == Part::S { S_CENTRE } else { CONE_CENTRE });
        part.heights()
            .iter()
            .enumerate()
            .map(|(n, h)| {
                let row = (0..part.points()).map(|k| {
                    // the ends of the S are left out, the cone closes
                    let u = match part {
                        Part::S => 0.02 + 0.96 * f64::from(k) / f64::from(part.points() - 1),
                        Part::Cone => (f64::from(k) + 0.5) / f64::from(part.points()),
                    };
                    let (tip, direction) = part.at(u);
                    let place = tip + direction * *h - centre;
                    let own = Vector3::from(self.scale_um_per_m).component_mul(&place) * 1e-3;
                    let noise = self.noise_um * dice.normal();
                    (u, 1e3 * flank.at(u, n) + part.normal(u, *h).dot(&own) + noise)
                });
                row.collect()
            })
            .collect()
    }
}

/// Largest, mean and standard deviation of the absolute deviations, um.
pub(super) fn figures(rows: &[Vec<(f64, f64)>]) -> [f64; 3] {
    let all: Vec<f64> = rows.iter().flatten().map(|(_, d)| d.abs()).collect();
    let n = all.len().max(1) as f64;
    let mean = all.iter().sum::<f64>() / n;
    let std = (all.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n).sqrt();
    [all.iter().copied().fold(0.0, f64::max), mean, std]
}

/// Filtered radial deviation from the least-squares circle at one height of the cone, um: angle, deg, and value; the mean, and how far
/// its centre is off.
pub(super) fn circle(row: &[(f64, f64)]) -> (Vec<(f64, f64)>, f64, f64) {
    let n = row.len().max(1) as f64;
    let radial: Vec<(f64, f64)> =
        row.iter().map(|(u, d)| (std::f64::consts::TAU * u, d / CONE_HALF_DEG.to_radians().cos())).collect();
    let mean = radial.iter().map(|r| r.1).sum::<f64>() / n;
    let wave =
        |f: fn(f64) -> f64, order: f64| 2.0 / n * radial.iter().map(|(a, d)| d * f(order * a)).sum::<f64>();
    let waves: Vec<(f64, f64, f64)> =
        (2..=UPR).map(f64::from).map(|order| (order, wave(f64::cos, order), wave(f64::sin, order))).collect();
    let form = radial
        .iter()
        .map(|(a, _)| {
            let sum = waves.iter().map(|(k, c, s)| c * (k * a).cos() + s * (k * a).sin()).sum();
            (a.to_degrees(), sum)
        })
        .collect();
    (form, mean, wave(f64::cos, 1.0).hypot(wave(f64::sin, 1.0)))
}

/// Roundness at each height of the cone, um, the error of its included angle, arcsec, and how far the lower circle is off its
/// place, um.
pub(super) fn cone_figures(rows: &[Vec<(f64, f64)>]) -> ([f64; 2], f64, f64) {
    let mut roundness = [f64::NAN; 2];
    let mut means = [f64::NAN; 2];
    for (i, row) in rows.iter().take(2).enumerate() {
        let (form, mean, _) = circle(row);
        let (low, high) = form.iter().fold((f64::MAX, f64::MIN), |(l, h), (_, d)| (l.min(*d), h.max(*d)));
        (roundness[i], means[i]) = (high - low, mean);
    }
    let height = (CONE_RADII[0] - CONE_RADII[1]) / CONE_HALF_DEG.to_radians().tan();
    // the wall leans less where the upper circle is larger
    let half = (CONE_RADII[0] - CONE_RADII[1] + 1e-3 * (means[0] - means[1])).atan2(height);
    let place = rows.first().map_or(f64::NAN, |row| circle(row).2);
    (roundness, 2.0 * (half.to_degrees() - CONE_HALF_DEG) * 3600.0, place)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motion::gcode::interpret;
    use crate::motion::{Dynamics, MachineAxes, MotionSource, Trajectory};
    use crate::truth::{GANTRY_5AX, TruthMachine};

    /// Poses of the scored cycles of a machine without errors whose head has turned by `lean` (rad about x) more.
    fn cut(part: Part, lean: f64) -> Flank {
        let text = GANTRY_5AX.replace("travel-deg = [-180, 180]", "travel-deg = [-360, 360]");
        let machine = TruthMachine::from_toml(&text).unwrap();
        let axes = MachineAxes::of(&machine).unwrap();
        let start = axes.middle();
        let program = interpret(&part.program(), &axes, start).unwrap();
        let mut path = Trajectory::new(start, &program.segments, &axes, &Dynamics::default(), 0.01).unwrap();
        let mut poses = Vec::new();
        while let Some(cycle) = path.next_cycle() {
            if cycle.scored {
                let pose = machine.nominal(&cycle.commanded);
                let [x, y, z] = pose.direction;
                poses.push((pose.tip_mm, [x, y - lean * z, z + lean * y]));
            }
        }
        Flank::cut(part, poses.into_iter(), machine.nominal(&[0.0; 8]).tip_mm)
    }

    fn largest(rows: &[Vec<(f64, f64)>]) -> f64 {
        rows.iter().flatten().map(|(_, d)| d.abs()).fold(0.0, f64::max)
    }

    #[test]
    fn an_ideal_machine_cuts_within_half_a_micrometre() {
        let cmm = Cmm { noise_um: 0.0, scale_um_per_m: [0.0; 3], seed: 1 };
        for part in [Part::S, Part::Cone] {
            let rows = cmm.measure(part, &cut(part, 0.0));
            assert!(largest(&rows) < 0.5, "{part:?}: {} um", largest(&rows));
        }
        let (roundness, taper, place) = cone_figures(&cmm.measure(Part::Cone, &cut(Part::Cone, 0.0)));
        assert!(roundness[0] < 0.3 && roundness[1] < 0.3 && taper.abs() < 1.0 && place < 0.1);
    }

    #[test]
    fn a_leaning_tool_shows_at_the_height_where_it_leans() {
        let cmm = Cmm { noise_um: 0.0, scale_um_per_m: [0.0; 3], seed: 1 };
        let rows = cmm.measure(Part::S, &cut(Part::S, 1e-4));
        let at = |n: usize| rows[n].iter().map(|r| r.1.abs()).fold(0.0, f64::max);
        assert!(at(2) > 2.5 && at(2) < 3.6 && (at(0) - at(2) / 7.0).abs() < 0.5, "{} {}", at(0), at(2));
        // a lean to one side is no taper, it moves the upper circle
        let (_, taper, _) = cone_figures(&cmm.measure(Part::Cone, &cut(Part::Cone, 1e-4)));
        assert!(taper.abs() < 2.0, "{taper}");
    }

    #[test]
    fn taper_and_roundness_are_those_of_a_known_surface() {
        let row = |mean: f64, oval: f64| -> Vec<(f64, f64)> {
            (0..72)
                .map(|k| {
                    (
                        f64::from(k) / 72.0,
                        mean + oval * (2.0 * std::f64::consts::TAU * f64::from(k) / 72.0).cos(),
                    )
                })
                .collect()
        };
        let cos = CONE_HALF_DEG.to_radians().cos();
        let ([lower, upper], taper, _) = cone_figures(&[row(10.0 * cos, 2.0 * cos), row(0.0, cos)]);
        assert!((lower - 4.0).abs() < 1e-9 && (upper - 2.0).abs() < 1e-9, "{lower} {upper}");
        // 10 um more below, over 85.8 mm of height: twice the half angle
        let height = 23.0 / CONE_HALF_DEG.to_radians().tan();
        let expected = 2.0 * (0.010 / height * cos * cos).to_degrees() * 3600.0;
        assert!((taper - expected).abs() < 0.05, "{taper} {expected}");
    }
}
