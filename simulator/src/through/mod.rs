//! Measuring a machine through its control: part programs go in, tool tips at stops or along paths come out, with
//! everything that control and daemon do.
//!
//! [`Remote`] is a running pair: `cncsim serve --measure IP:PORT` and a daemon. [`Local`] starts both from the machine file
//! of the daemon and measures in simulated time.
//!
//! The link of a measurement is TCP on loopback, one JSON object a line: the server says [`About`], the client sends
//! [`Request`], the server answers with [`Answer`].

mod client;
mod local;
pub mod server;

use std::collections::VecDeque;

use serde::{Deserialize, Serialize};
use volcomp_protocol::CorrectionState;
use volcomp_units::axes::{AxisArray, AxisName};

use crate::control::CycleRecord;
use crate::truth::TruthMachine;

pub use client::Remote;
pub use local::Local;

/// The longest line of the link, bytes.
pub(crate) const LINE_MAX: u64 = 64 << 20;

/// The machine at the other end.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct About {
    /// Its id.
    pub machine: String,
    /// Its chain.
    pub chain: String,
    /// Letters of its axes in wire order.
    pub axes: String,
    /// Their travels, mm or deg.
    pub travel: Vec<[f64; 2]>,
    /// Tool tip in M at home.
    pub tool_tip_mm: [f64; 3],
    /// Control cycle, s.
    pub cycle_s: f64,
}

/// Least cycles of a dwell.
const DWELL_CYCLES: usize = 5;

/// What is wanted of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Want {
    /// The last cycle of every dwell of at least five cycles.
    Stops,
    /// The same with the mean tool tip over so many last cycles of the dwell, as an interferometer averages.
    MeanStops(usize),
    /// One of so many cycles of everything between `(SCORE ON)` and `(SCORE OFF)`.
    Path(usize),
}

/// A part program to run and measure.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Request {
    /// The text.
    pub program: String,
    /// What is wanted.
    pub want: Want,
}

/// A moment of a run.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Point {
    /// Time of the control, s.
    pub time_s: f64,
    /// Line of the part program.
    pub line: u32,
    /// Commanded position in wire order.
    pub commanded: AxisArray,
    /// Tool tip in the workpiece frame without errors at the commanded position, mm.
    pub nominal_mm: [f64; 3],
    /// Tool tip, mm.
    pub actual_mm: [f64; 3],
    /// The daemon compensates in full.
    pub compensated: bool,
}

/// What comes back.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Answer {
    /// The moments, in order.
    Points(Vec<Point>),
    /// Why there are none.
    Error(String),
}

/// A machine that can be moved by part programs and measured.
pub trait Measured {
    /// The machine.
    fn about(&self) -> &About;
    /// Runs a part program.
    ///
    /// # Errors
    /// The program is wrong, or the other end is gone.
    fn run(&mut self, program: &str, want: Want) -> anyhow::Result<Vec<Point>>;
}

impl About {
    /// Of a machine.
    #[must_use]
    pub fn of(machine: &TruthMachine, cycle_s: f64) -> Self {
        let axes = machine.axes();
        Self {
            machine: machine.machine().to_owned(),
            chain: machine.chain().text().to_owned(),
            axes: axes.iter().map(ToString::to_string).collect(),
            travel: (0..axes.len()).map(|k| machine.travel(k)).collect(),
            tool_tip_mm: machine.tool_tip_mm(),
            cycle_s,
        }
    }

    /// Travel of an axis; `None` where the machine lacks it.
    #[must_use]
    pub fn travel(&self, axis: AxisName) -> Option<[f64; 2]> {
        let k = self.axes.chars().position(|c| AxisName::from_letter(c) == Some(axis))?;
        self.travel.get(k).copied()
    }
}

/// Picks the moments that are wanted from the cycles of a run.
#[derive(Debug)]
pub struct Selection {
    want: Want,
    count: usize,
    /// The last cycle of the dwell that is going on, and its cycles.
    standing: Option<(CycleRecord, usize)>,
    /// Tool tips of the last cycles of this dwell, mm, of which the mean is wanted.
    tips_mm: VecDeque<[f64; 3]>,
    points: Vec<Point>,
}

impl Selection {
    /// Nothing seen yet.
    #[must_use]
    pub const fn new(want: Want) -> Self {
        Self { want, count: 0, standing: None, tips_mm: VecDeque::new(), points: Vec::new() }
    }

    /// A cycle of the run.
    pub fn see(&mut self, machine: &TruthMachine, r: &CycleRecord) {
        if !r.scored {
            self.end_of_dwell(machine);
            return;
        }
        match self.want {
            Want::Stops | Want::MeanStops(_) => {
                let stands = r.feed_mm_per_min == 0.0;
                if !stands || self.standing.is_some_and(|(before, _)| before.line != r.line) {
                    self.end_of_dwell(machine);
                }
                if stands {
                    let cycles = self.standing.map_or(0, |(_, cycles)| cycles);
                    self.standing = Some((*r, cycles + 1));
                    if let Want::MeanStops(last) = self.want {
                        self.tips_mm.push_back(r.sample.tip_mm);
                        if self.tips_mm.len() > last.max(1) {
                            self.tips_mm.pop_front();
                        }
                    }
                }
            }
            Want::Path(every) => {
                if self.count.is_multiple_of(every.max(1)) {
                    self.points.push(point(machine, r));
                }
                self.count += 1;
            }
        }
    }

    fn end_of_dwell(&mut self, machine: &TruthMachine) {
        // one cycle at rest between two moves is no dwell
        if let Some((r, _)) = self.standing.take().filter(|(_, cycles)| *cycles >= DWELL_CYCLES) {
            let mut point = point(machine, &r);
            if !self.tips_mm.is_empty() {
                let count = self.tips_mm.len() as f64;
                point.actual_mm =
                    [0, 1, 2].map(|i| self.tips_mm.iter().map(|tip| tip[i]).sum::<f64>() / count);
            }
            self.points.push(point);
        }
        self.tips_mm.clear();
    }

    /// The moments, in order.
    #[must_use]
    pub fn finish(mut self, machine: &TruthMachine) -> Vec<Point> {
        self.end_of_dwell(machine);
        self.points
    }
}

fn point(machine: &TruthMachine, r: &CycleRecord) -> Point {
    Point {
        time_s: r.time_s,
        line: r.line,
        commanded: r.commanded,
        nominal_mm: machine.nominal(&r.commanded).tip_mm,
        actual_mm: r.sample.tip_mm,
        compensated: r.correction.is_some_and(|c| c.state == CorrectionState::Active),
    }
}
