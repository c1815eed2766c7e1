//! The instruments of paper 000 and their files.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use anyhow::Context;

use super::super::Setting;
use super::super::machine::travels;
use crate::instruments::there_and_back;
use crate::instruments::tracker::{PointNoise, Tracker, TrackerErrors, on_carriage, on_workpiece_side};
use crate::truth::TruthMachine;
use volcomp_units::axes::AxisName;

/// Stops of the axis.
const STOPS: u32 = 21;
/// Places of the tracker in M: beside the machine, and in the line of X.
pub(super) const STATION_MM: [[f64; 3]; 2] = [[2600.0, -1500.0, 300.0], [2600.0, 250.0, -450.0]];
/// Turn of the tracker about z, deg.
const TURN_DEG: f64 = 112.0;
/// Specification of the tracker.
pub(super) struct Specification {
    range_um: f64,
    range_um_per_m: f64,
    angle_arcsec: f64,
}

/// The tracker.
pub(super) const TRACKER: Specification =
    Specification { range_um: 0.5, range_um_per_m: 0.2, angle_arcsec: 0.75 };

impl Specification {
    /// Options that state the noise.
    pub(super) fn sigmas(&self) -> Vec<String> {
        vec![
            "--sigma-range-um".to_owned(),
            self.range_um.to_string(),
            "--sigma-range-um-per-m".to_owned(),
            self.range_um_per_m.to_string(),
            "--sigma-angle-arcsec".to_owned(),
            self.angle_arcsec.to_string(),
        ]
    }
}

/// Positions of X.
pub(super) fn stops(machine: &TruthMachine) -> Vec<f64> {
    let [low, high] = travels(machine)[0];
    (0..STOPS).map(|i| low + (high - low) * f64::from(i) / f64::from(STOPS - 1)).collect()
}

/// Three points 300 mm apart in the middle of the table, as in the paper.
pub(super) fn triangle(machine: &TruthMachine) -> Vec<(String, [f64; 3])> {
    let [x, y, z] = machine.workpiece_origin_mm();
    let (x, y, s) = (x + 425.0, y + 250.0, 300.0);
    [[0.0, s / 3f64.sqrt()], [-s / 2.0, -s / 12f64.sqrt()], [s / 2.0, -s / 12f64.sqrt()]]
        .into_iter()
        .enumerate()
        .map(|(i, [dx, dy])| (format!("t{}", i + 1), [x + dx, y + dy, z].map(|v| (v * 1e3).round() / 1e3)))
        .collect()
}

/// The corners of the table and posts of 350 mm above them.
pub(super) fn corner_points(machine: &TruthMachine) -> Vec<(String, [f64; 3])> {
    let [x, y, z] = machine.workpiece_origin_mm();
    let mut points = Vec::new();
    for (name, height) in [("low", 30.0), ("high", 350.0)] {
        for (i, (dx, dy)) in
            [(25.0, 25.0), (825.0, 25.0), (825.0, 475.0), (25.0, 475.0)].into_iter().enumerate()
        {
            points.push((format!("{name}{}", i + 1), [x + dx, y + dy, z + height]));
        }
    }
    points
}

/// A measurement with the tracker.
pub(super) struct TrackerRun {
    pub(super) station_mm: [f64; 3],
    pub(super) runs: u32,
    pub(super) seed: u64,
    pub(super) errors: TrackerErrors,
    pub(super) noise: bool,
    pub(super) points: Vec<(String, [f64; 3])>,
}

impl TrackerRun {
    /// Measures and writes points, registration and data.
    pub(super) fn write(&self, machine: &TruthMachine, setting: &Setting, name: &str) -> anyhow::Result<()> {
        let k = machine.index_of(AxisName::X).context("the machine has no X")?;
        let size = if self.noise { 1.0 } else { 1e-3 };
        let [range, share, angle] =
            [TRACKER.range_um, TRACKER.range_um_per_m, TRACKER.angle_arcsec].map(|v| v * size);
        let mut tracker =
            Tracker::new(self.station_mm, TURN_DEG, range, angle, self.seed).with_errors(self.errors, share);
        let files = tracker.measure(machine, k, &self.points, &there_and_back(&stops(machine), self.runs));
        setting.write(&format!("{name}-points.csv"), &files.points)?;
        setting.write(&format!("{name}-registration.csv"), &files.registration)?;
        setting.write(&format!("{name}.csv"), &files.data)
    }
}

/// An interferometer along three lines, two runs each.
#[derive(Debug, Clone, Copy)]
pub(super) struct NineLine {
    pub(super) seed: u64,
    /// Change of air and expansion from line to line, 1e-6 of the displacement.
    pub(super) scale_ppm: [f64; 3],
}

impl NineLine {
    /// Noise only.
    pub(super) const fn ideal(seed: u64) -> Self {
        Self { seed, scale_ppm: [0.0; 3] }
    }

    /// Measures and writes `lines.csv` and `nineline.csv`.
    pub(super) fn write(&self, machine: &TruthMachine, setting: &Setting) -> anyhow::Result<()> {
        let k = machine.index_of(AxisName::X).context("the machine has no X")?;
        let [_, y, z] = machine.workpiece_origin_mm();
        let lines =
            [[425.0, y + 100.0, z + 100.0], [425.0, y + 400.0, z + 100.0], [425.0, y + 250.0, z + 350.0]];
        let mut table = String::from("line,x_mm,y_mm,z_mm\n");
        for (i, [x, y, z]) in lines.iter().enumerate() {
            let _ = writeln!(table, "l{},{x},{y},{z}", i + 1);
        }
        let mut data = String::from("position_mm,cycle,direction");
        for i in 1..=3 {
            let _ = write!(data, ",l{i}_dx_um,l{i}_dy_um,l{i}_dz_um");
        }
        data.push('\n');
        let mut noise = PointNoise::new(0.1, self.seed ^ 0x9_11e5);
        let sign = if on_workpiece_side(machine, k) { -1.0 } else { 1.0 };
        let mut zero: Vec<[f64; 3]> = Vec::new();
        for (n, stop) in there_and_back(&stops(machine), 2).into_iter().enumerate() {
            let q = stop.position;
            let seen: Vec<[f64; 3]> = on_carriage(machine, k, q, stop.direction, &lines)
                .iter()
                .zip(&lines)
                .zip(self.scale_ppm)
                .map(|((p, home), ppm)| {
                    let mut d: [f64; 3] = core::array::from_fn(|i| p[i] - home[i]);
                    d[0] -= sign * q;
                    d[0] += ppm * 1e-6 * sign * q;
                    d
                })
                .collect();
            // the display is set to zero at the first stop of a run there and back
            if n % (2 * STOPS as usize) == 0 {
                zero.clone_from(&seen);
            }
            let _ = write!(data, "{q},{},{}", stop.cycle, stop.direction);
            for (d, z) in seen.iter().zip(&zero) {
                for i in 0..3 {
                    let _ = write!(data, ",{:.4}", (d[i] - z[i] + noise.draw()) * 1e3);
                }
            }
            data.push('\n');
        }
        setting.write("lines.csv", &table)?;
        setting.write("nineline.csv", &data)
    }
}

/// Motions of a table, means over directions and cycles by position: um and arcsec.
pub(super) fn read_motions(path: &Path) -> anyhow::Result<Vec<(f64, [f64; 6])>> {
    let text = fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
    let mut reader =
        csv::ReaderBuilder::new().comment(Some(b'#')).trim(csv::Trim::All).from_reader(text.as_bytes());
    let header = reader.headers()?.clone();
    let column = |name: &str| {
        header.iter().position(|h| h == name).with_context(|| format!("{}: no column {name}", path.display()))
    };
    let position = column("position_mm")?;
    let names = ["exx_um", "eyx_um", "ezx_um", "eax_arcsec", "ebx_arcsec", "ecx_arcsec"];
    let columns = names.map(column).into_iter().collect::<anyhow::Result<Vec<usize>>>()?;
    let mut sums: Vec<(f64, [f64; 6], f64)> = Vec::new();
    for record in reader.records() {
        let record = record?;
        let number = |i: usize| record.get(i).and_then(|t| t.parse::<f64>().ok()).context("not a number");
        let q = number(position)?;
        let mut row = [0.0; 6];
        for (to, i) in row.iter_mut().zip(&columns) {
            *to = number(*i)?;
        }
        match sums.iter_mut().find(|s| (s.0 - q).abs() < 1e-6) {
            Some(sum) => {
                sum.1.iter_mut().zip(row).for_each(|(s, v)| *s += v);
                sum.2 += 1.0;
            }
            None => sums.push((q, row, 1.0)),
        }
    }
    let mut means: Vec<(f64, [f64; 6])> = sums.into_iter().map(|(q, s, n)| (q, s.map(|v| v / n))).collect();
    means.sort_by(|a, b| a.0.total_cmp(&b.0));
    Ok(means)
}
