//! What was recorded, one row per servo cycle, and what it says.

use std::fs;
use std::path::Path;

use volcomp::config::model::parse;
use volcomp::model::axes::{MAX_AXES, Travel};
use volcomp::model::{Model, Pose};

const UM_PER_MM: f64 = 1000.0;
/// Travel after which volcompd takes a reversal for one, mm.
const DEADBAND_MM: f64 = 0.001;
/// The longest way from nominal to motor that is looked for, cycles.
const LAG_MAX: usize = 8;

/// State of a correction: compensating.
const ACTIVE: u8 = 3;

/// One servo cycle.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Row {
    pub(crate) sequence: u64,
    pub(crate) nominal: [f64; 3],
    /// What comes back from the machine: while it is on and homed, its tool with all errors.
    pub(crate) feedback: [f64; 3],
    pub(crate) motor: [f64; 3],
    pub(crate) applied: [f64; 3],
    pub(crate) mark: i32,
    pub(crate) state: u8,
    pub(crate) enabled: bool,
    pub(crate) ramping_out: bool,
    pub(crate) estop_released: bool,
    /// The offset that was asked for.
    pub(crate) asked: [f64; 3],
    /// Whether the row is judged.
    counts: bool,
    /// Which way each axis goes, and for how many cycles none has turned.
    travel: [Travel; MAX_AXES],
    since_reversal: usize,
}

/// RMS and maximum of the length of a vector, um.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Size {
    pub(crate) rms_um: f64,
    pub(crate) max_um: f64,
}

impl Size {
    fn of(lengths_mm: impl Iterator<Item = f64>) -> Self {
        let (mut sum, mut max, mut count) = (0.0, 0.0_f64, 0.0);
        for length in lengths_mm {
            sum += length * length;
            max = max.max(length);
            count += 1.0;
        }
        Self { rms_um: UM_PER_MM * (sum / count).sqrt(), max_um: UM_PER_MM * max }
    }
}

/// Rows that follow each other.
#[derive(Debug, Clone)]
pub(crate) struct Trace {
    pub(crate) rows: Vec<Row>,
}

impl Trace {
    pub(crate) fn read(path: &Path) -> Self {
        let text = fs::read_to_string(path).expect("records");
        // the last line may be half written
        let complete = text.rfind('\n').map_or("", |end| &text[..end]);
        let mut rows: Vec<Row> = complete.lines().filter_map(row).collect();
        assert!(!rows.is_empty(), "nothing recorded");
        for pair in rows.windows(2) {
            assert_eq!(pair[1].sequence, pair[0].sequence + 1, "the recorder has lost cycles");
        }
        find_reversals(&mut rows);
        Self { rows }
    }

    /// The rows with a mark, without those that stand still before and after the motion.
    pub(crate) fn moving(&self, mark: i32) -> Self {
        let marked: Vec<Row> = self.rows.iter().filter(|r| r.mark == mark).copied().collect();
        let moves = |pair: &[Row]| pair[0].nominal != pair[1].nominal;
        let first = marked.windows(2).position(moves).expect("something moves");
        let last = marked.windows(2).rposition(moves).expect("something moves");
        Self { rows: marked[first..=last].to_vec() }
    }

    /// All rows with a mark.
    pub(crate) fn marked(&self, mark: i32) -> Self {
        Self { rows: self.rows.iter().filter(|r| r.mark == mark).copied().collect() }
    }

    /// Only the rows in which volcompd says that it compensates are judged: a computer with too much to do may hold the bridge
    /// up for so long that volcompd holds and blends in again, as it should.
    pub(crate) fn while_active(mut self) -> Self {
        for row in &mut self.rows {
            row.counts = row.state == ACTIVE;
        }
        self
    }

    /// Share of the rows that are judged.
    pub(crate) fn judged(&self) -> f64 {
        self.rows.iter().filter(|r| r.counts).count() as f64 / self.rows.len() as f64
    }

    /// Cycles from the nominal position to the motor: where the motor without its offset is the nominal one.
    pub(crate) fn lag(&self) -> usize {
        let misfit = |lag: usize| {
            let pairs = self.rows[LAG_MAX..].iter().zip(&self.rows[LAG_MAX - lag..]);
            pairs.map(|(motor, nominal)| distance(&motor.motor, &nominal.nominal)).sum::<f64>()
        };
        let misfits: Vec<f64> = (0..=LAG_MAX).map(misfit).collect();
        (0..=LAG_MAX).min_by(|a, b| misfits[*a].total_cmp(&misfits[*b])).expect("lags were tried")
    }

    /// Where the joints' feedback, and with it the tool, is beside where it was to be.
    pub(crate) fn error(&self, lag: usize) -> Size {
        let judged = self.rows[lag..].iter().zip(&self.rows).filter(|(r, _)| r.counts);
        Size::of(judged.map(|(r, n)| distance(&r.feedback, &n.nominal)))
    }

    /// What the way of the correction leaves at the motor: motor beside nominal position plus the model's correction
    /// for the very place; without the `around` cycles after a reversal of an axis.
    pub(crate) fn path_residual(&self, lag: usize, model: &Model, around: usize) -> Size {
        let lengths =
            self.rows[lag..].iter().zip(&self.rows).filter(|(r, n)| r.counts && n.since_reversal >= around);
        Size::of(lengths.map(|(row, n)| {
            let mut position = [0.0; MAX_AXES];
            position[..3].copy_from_slice(&n.nominal);
            let (_, correction) = model.correct(&Pose { travel: n.travel, ..Pose::at(position) });
            distance(&row.motor, &core::array::from_fn(|k| n.nominal[k] + correction.offset[k]))
        }))
    }

    /// The largest change of an offset, applied or only asked for, from one cycle to the next, um. Where LinuxCNC is switched
    /// on it makes the offset part of the position: that change moves nothing.
    pub(crate) fn largest_step_um(&self) -> f64 {
        let changed = |a: &[f64; 3], b: &[f64; 3]| (0..3).map(|k| (a[k] - b[k]).abs()).fold(0.0, f64::max);
        let step = |pair: &[Row]| {
            changed(&pair[0].applied, &pair[1].applied).max(changed(&pair[0].asked, &pair[1].asked))
        };
        let pairs = self.rows.windows(2).filter(|pair| pair[0].enabled == pair[1].enabled);
        UM_PER_MM * pairs.map(step).fold(0.0, f64::max)
    }

    /// How far any motor comes away from where it was in the row `from`, um.
    pub(crate) fn farthest_um(&self, from: &Row) -> f64 {
        let away = |row: &Row| (0..3).map(|k| (row.motor[k] - from.motor[k]).abs()).fold(0.0, f64::max);
        UM_PER_MM * self.rows.iter().map(away).fold(0.0, f64::max)
    }

    pub(crate) fn last(&self) -> &Row {
        self.rows.last().expect("rows")
    }
}

fn find_reversals(rows: &mut [Row]) {
    let mut travel = [Travel::Forward; MAX_AXES];
    let mut turning = rows[0].nominal;
    let mut since = 0;
    for row in rows {
        since += 1;
        for k in 0..3 {
            let sign = if travel[k] == Travel::Forward { 1.0 } else { -1.0 };
            let beyond = sign * (row.nominal[k] - turning[k]);
            if beyond < -DEADBAND_MM {
                travel[k] = travel[k].reversed();
                since = 0;
            }
            if !(-DEADBAND_MM..=0.0).contains(&beyond) {
                turning[k] = row.nominal[k];
            }
        }
        (row.travel, row.since_reversal) = (travel, since);
    }
}

fn distance(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f64>().sqrt()
}

fn row(line: &str) -> Option<Row> {
    let words: Vec<&str> = line.split_whitespace().collect();
    let three = |at: usize| -> Option<[f64; 3]> {
        Some([
            words.get(at)?.parse().ok()?,
            words.get(at + 1)?.parse().ok()?,
            words.get(at + 2)?.parse().ok()?,
        ])
    };
    let bit = |at: usize| words.get(at).map(|w| *w == "1");
    Some(Row {
        sequence: words.first()?.parse().ok()?,
        nominal: three(1)?,
        feedback: three(4)?,
        motor: three(7)?,
        applied: three(10)?,
        mark: words.get(13)?.parse().ok()?,
        state: words.get(14)?.parse().ok()?,
        enabled: bit(15)?,
        ramping_out: bit(16)?,
        estop_released: bit(17)?,
        asked: three(18)?,
        counts: true,
        travel: [Travel::Forward; MAX_AXES],
        since_reversal: 0,
    })
}

/// The model of the example.
pub(crate) fn example_model() -> Model {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("config/examples/linuxcnc/model.toml");
    let text = fs::read_to_string(path).expect("model");
    Model::new(&parse("model.toml", &text).expect("model file")).expect("model")
}
