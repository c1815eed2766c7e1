//! The readings of an instrument at the stops of the part program, joined by servo cycle with volcompd's recording.

use std::collections::HashMap;
use std::fmt::Write as _;

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::program::Target;
use crate::trace::{Row, Trace};

/// The instrument: noise of a reading (standard deviation), step of its display, offset of a mounting.
const NOISE_UM: f64 = 0.3;
const RESOLUTION_UM: f64 = 0.1;
const MOUNTING_UM: f64 = 5.0;
/// Stands shorter than this are turning points and corners of the path; the dwell of the program is longer.
const STAND_CYCLES: usize = 120;
/// Of a stand, the cycles that the instrument averages: the last but a few.
const AVERAGED_CYCLES: usize = 50;
const SPARED_CYCLES: usize = 10;
/// LinuxCNC rounds a programmed position less than this.
const SAME_PLACE_MM: f64 = 1e-3;
/// halsampler writes six decimals.
const SAME_NUMBER_MM: f64 = 2e-6;
/// The two samplers start together; their numbers may differ by the order in the servo thread.
const NUMBERS_APART: i64 = 3;

const AXES: [&str; 3] = ["x", "y", "z"];
/// Columns that the session takes from the recording as they are.
const TAKEN: [&str; 14] = [
    "t_s",
    "x_mm",
    "y_mm",
    "z_mm",
    "dir_x",
    "dir_y",
    "dir_z",
    "since_reversal_x_mm",
    "since_reversal_y_mm",
    "since_reversal_z_mm",
    "since_reversal_x_s",
    "since_reversal_y_s",
    "since_reversal_z_s",
    "moving",
];

/// Cycles of a recording by number, as `volcomp export` writes them.
pub(super) struct Recording {
    columns: HashMap<String, usize>,
    rows: HashMap<i64, Vec<String>>,
}

impl Recording {
    pub(super) fn parse(csv: &str) -> Self {
        let mut lines = csv.lines();
        let heading = lines.next().expect("a heading");
        let columns: HashMap<String, usize> =
            heading.split(',').enumerate().map(|(k, name)| (name.to_owned(), k)).collect();
        let sequence = columns["sequence"];
        let row = |line: &str| {
            let words: Vec<String> = line.split(',').map(str::to_owned).collect();
            Some((words.get(sequence)?.parse().ok()?, words))
        };
        Self { rows: lines.filter_map(row).collect(), columns }
    }

    pub(super) fn cycles(&self) -> usize {
        self.rows.len()
    }

    fn text(&self, cycle: i64, column: &str) -> Option<&str> {
        let at = *self.columns.get(column).expect("a column of the export");
        Some(self.rows.get(&cycle)?[at].as_str())
    }

    fn position(&self, cycle: i64, kind: &str) -> Option<[f64; 3]> {
        let mut position = [0.0; 3];
        for (axis, value) in AXES.iter().zip(&mut position) {
            *value = self.text(cycle, &format!("{axis}{kind}_mm"))?.parse().ok()?;
        }
        Some(position)
    }

    /// Number in the recording minus number in the trace: that with which the moving cycles agree.
    fn apart(&self, trace: &Trace) -> i64 {
        let moving: Vec<&Row> =
            trace.rows.windows(2).filter(|r| r[0].nominal != r[1].nominal).map(|r| &r[1]).collect();
        let (mut best, mut most) = (0, 0);
        for apart in -NUMBERS_APART..=NUMBERS_APART {
            let agrees = |row: &&&Row| {
                self.position(number(row) + apart, "").is_some_and(|p| near(&p, &row.nominal, SAME_NUMBER_MM))
            };
            let agreeing = moving.iter().filter(agrees).count();
            if agreeing > most {
                (best, most) = (apart, agreeing);
            }
        }
        let present = moving.iter().filter(|r| self.rows.contains_key(&(number(r) + best))).count();
        assert!(
            2 * present > moving.len() && 1000 * most > 999 * present,
            "of {} moving cycles {present} are recorded and {most} agree",
            moving.len()
        );
        best
    }
}

fn number(row: &Row) -> i64 {
    i64::try_from(row.sequence).expect("a cycle number")
}

fn near(a: &[f64; 3], b: &[f64; 3], within: f64) -> bool {
    a.iter().zip(b).all(|(a, b)| (a - b).abs() <= within)
}

/// One measurement of the whole program.
pub(super) struct Session {
    pub(super) csv: String,
    /// Deviation and setup of each reading.
    readings: Vec<(u32, f64)>,
    /// Encoder or scale minus commanded position, um, and direction of the passage, for the lines along axes.
    pub(super) feedback: Vec<([f64; 3], Target)>,
}

impl Session {
    /// Reads the instrument at each stand of `trace`, whose feedback is the tool tip. The positions are the recording's.
    pub(super) fn take(trace: &Trace, recording: &Recording, targets: &[Target], seed: u64) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut normal = move || -> f64 { StandardNormal.sample(&mut random) };
        let apart = recording.apart(trace);
        let stands = stands(trace);
        assert_eq!(stands.len(), targets.len(), "stands of the program");
        let mut csv =
            format!("{},instrument,setup,run,repeat,pair,u_x,u_y,u_z,deviation_um\n", TAKEN.join(","));
        let (mut readings, mut feedback) = (Vec::new(), Vec::new());
        let (mut setup, mut zero) = (0, 0.0);
        for (target, rows) in targets.iter().zip(stands) {
            let middle = number(&rows[rows.len() / 2]) + apart;
            let half = i64::try_from(rows.len() / 2).expect("cycles");
            let cycle = (0..half)
                .flat_map(|k| [middle - k, middle + k])
                .find(|cycle| recording.rows.contains_key(cycle))
                .expect("a recorded cycle of the stand");
            let commanded = recording.position(cycle, "").expect("a commanded position");
            assert!(
                near(&commanded, &target.position, SAME_PLACE_MM),
                "{commanded:?} at {:?}",
                target.position
            );
            assert!(near(&commanded, &rows[0].nominal, SAME_NUMBER_MM), "the recording has the stand");
            let mean: [f64; 3] =
                core::array::from_fn(|k| rows.iter().map(|r| r.feedback[k]).sum::<f64>() / rows.len() as f64);
            let along: f64 = (0..3).map(|k| target.direction[k] * (mean[k] - commanded[k])).sum();
            if target.setup != setup {
                (setup, zero) = (target.setup, MOUNTING_UM * normal());
            }
            let read = 1000.0 * along + zero + NOISE_UM * normal();
            let deviation = (read / RESOLUTION_UM).round() * RESOLUTION_UM;
            for column in TAKEN {
                write!(csv, "{},", recording.text(cycle, column).unwrap_or_default()).expect("text");
            }
            let Target { run, repeat, pair, direction: [x, y, z], .. } = target;
            writeln!(csv, "laser,{setup},{run},{repeat},{pair},{x:.9},{y:.9},{z:.9},{deviation:.1}")
                .expect("text");
            readings.push((setup, deviation));
            let actual = recording.position(cycle, "").zip(actual(recording, cycle));
            let (commanded, actual) = actual.expect("a feedback position");
            feedback.push((core::array::from_fn(|k| 1000.0 * (actual[k] - commanded[k])), *target));
        }
        Self { csv, readings, feedback }
    }

    /// RMS of the deviations without the offset of each setup, um.
    pub(super) fn rms_um(&self) -> f64 {
        let mut sums: HashMap<u32, (f64, f64)> = HashMap::new();
        for (setup, deviation) in &self.readings {
            let sum = sums.entry(*setup).or_default();
            *sum = (sum.0 + deviation, sum.1 + 1.0);
        }
        let square = |(setup, deviation): &(u32, f64)| {
            let (sum, count) = sums[setup];
            (deviation - sum / count).powi(2)
        };
        (self.readings.iter().map(square).sum::<f64>() / self.readings.len() as f64).sqrt()
    }

    /// Reversal error that the feedback of each axis shows on its line: forward minus backward, mean, um.
    pub(super) fn feedback_reversal_um(&self) -> [f64; 3] {
        core::array::from_fn(|axis| {
            let mean = |forward: bool| {
                let of_axis = self.feedback.iter().filter(|(_, t)| t.direction[axis] == 1.0);
                let values: Vec<f64> =
                    of_axis.filter(|(_, t)| (t.run % 2 == 1) == forward).map(|(um, _)| um[axis]).collect();
                values.iter().sum::<f64>() / values.len() as f64
            };
            mean(true) - mean(false)
        })
    }
}

fn actual(recording: &Recording, cycle: i64) -> Option<[f64; 3]> {
    let mut position = [0.0; 3];
    for (axis, value) in AXES.iter().zip(&mut position) {
        *value = recording.text(cycle, &format!("actual_{axis}_mm"))?.parse().ok()?;
    }
    Some(position)
}

/// The averaged cycles of each stand between the first and the last motion.
fn stands(trace: &Trace) -> Vec<&[Row]> {
    trace
        .rows
        .chunk_by(|a, b| a.nominal == b.nominal)
        .filter(|rows| rows.len() >= STAND_CYCLES)
        .map(|rows| &rows[rows.len() - SPARED_CYCLES - AVERAGED_CYCLES..rows.len() - SPARED_CYCLES])
        .collect()
}
