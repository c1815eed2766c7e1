//! A recording as a source of motion, resampled to the control cycle.

use volcomp_units::axes::{AxisArray, MAX_AXES};

use super::super::axes::MachineAxes;
use super::super::profile::checked_cycle_s;
use super::super::{MotionCycle, MotionSource};
use super::connect::{Connection, Motion};
use super::description::Description;
use super::read::{Part, RecordingError, Row, read_parts};

/// How positions between two samples are found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Interpolation {
    /// Straight.
    Linear,
    /// Cubic through the samples with the slopes of their neighbours (Catmull-Rom), inside a part only.
    #[default]
    Cubic,
}

/// Slower than this is standing still, mm/s (noise of the encoders stays below).
const STANDSTILL_MM_PER_S: f64 = 0.05;

#[derive(Debug, Clone)]
enum Stretch {
    Recorded(Part),
    Connecting(Box<Connecting>),
}

/// A move that the control inserts.
#[derive(Debug, Clone)]
struct Connecting {
    commanded: Connection,
    actual: Connection,
}

/// A recording being replayed.
#[derive(Debug, Clone)]
pub struct Replay {
    stretches: Vec<Stretch>,
    interpolation: Interpolation,
    cycle_s: f64,
    linear: [bool; MAX_AXES],
    stretch: usize,
    cycle: u64,
}

impl Replay {
    /// A replay of a recording at a control cycle; axes that it does not have stand at `rest`.
    ///
    /// # Errors
    /// The first thing that is wrong with the recording, with its line; a cycle time outside 0.25 to 10 ms.
    pub fn new(
        text: &str,
        description: &Description,
        axes: &MachineAxes,
        rest: AxisArray,
        cycle_s: f64,
        interpolation: Interpolation,
    ) -> Result<Self, RecordingError> {
        let cycle_s = checked_cycle_s(cycle_s)?;
        let parts = read_parts(text, description, axes, rest)?;
        let mut linear = [false; MAX_AXES];
        for (k, flag) in linear.iter_mut().enumerate() {
            *flag = axes.is_linear(k);
        }
        let mut replay = Self { stretches: Vec::new(), interpolation, cycle_s, linear, stretch: 0, cycle: 0 };
        let limits = (description.connect_speed_mm_per_s, description.connect_acceleration_mm_per_s2);
        let mut before: Option<Part> = None;
        for part in parts {
            if let Some(before) = &before {
                let connect = |pick: fn(&Row) -> &AxisArray| {
                    Connection::new(
                        &replay.exit(before, pick),
                        &replay.entry(&part, pick),
                        limits.0,
                        limits.1,
                        cycle_s,
                    )
                };
                let (commanded, actual) = (connect(|r| &r.commanded), connect(|r| &r.actual));
                // one duration for both, the longer
                let (commanded, actual) = match commanded.duration_s.total_cmp(&actual.duration_s) {
                    core::cmp::Ordering::Equal => (commanded, actual),
                    _ => replay.same_duration(before, &part, commanded.duration_s.max(actual.duration_s)),
                };
                replay.stretches.push(Stretch::Connecting(Box::new(Connecting { commanded, actual })));
            }
            replay.stretches.push(Stretch::Recorded(part.clone()));
            before = Some(part);
        }
        Ok(replay)
    }

    /// The shipped recording of a SINUMERIK 840D sl.
    ///
    /// # Errors
    /// The machine lacks X, Y or Z or their travel; a cycle time outside 0.25 to 10 ms.
    pub fn shipped(axes: &MachineAxes, cycle_s: f64) -> Result<Self, ShippedError> {
        let description = Description::from_toml(super::SHIPPED_DESCRIPTION)?;
        let replay = Self::new(
            super::SHIPPED_DATA,
            &description,
            axes,
            [0.0; MAX_AXES],
            cycle_s,
            Interpolation::Cubic,
        )?;
        Ok(replay)
    }

    /// How long it takes, s.
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        self.stretches.iter().map(|s| self.cycles_of(s) as f64 * self.cycle_s).sum()
    }

    fn same_duration(&self, before: &Part, after: &Part, duration_s: f64) -> (Connection, Connection) {
        let both = |pick: fn(&Row) -> &AxisArray| {
            Connection::lasting(&self.exit(before, pick), &self.entry(after, pick), duration_s)
        };
        (both(|r| &r.commanded), both(|r| &r.actual))
    }

    /// The last cycle that begins within a part: not after its last row.
    fn last_cycle(&self, part: &Part) -> u64 {
        (duration(part) / self.cycle_s + 1e-6).floor() as u64
    }

    /// Cycles that begin within a stretch.
    fn cycles_of(&self, stretch: &Stretch) -> u64 {
        match stretch {
            Stretch::Recorded(part) => self.last_cycle(part) + 1,
            // its first state is the last of the part before
            Stretch::Connecting(inserted) => {
                ((inserted.commanded.duration_s / self.cycle_s).round() as u64).saturating_sub(1)
            }
        }
    }

    /// The motion at the last cycle of a part: from its rows alone.
    fn exit(&self, part: &Part, pick: fn(&Row) -> &AxisArray) -> Motion {
        let end = self.position(part, self.last_cycle(part) as f64 * self.cycle_s, pick);
        Motion { position: end, velocity: slope(&part.rows, pick, true), acceleration: [0.0; MAX_AXES] }
    }

    /// The motion at the first row of a part: from its rows alone.
    fn entry(&self, part: &Part, pick: fn(&Row) -> &AxisArray) -> Motion {
        let position = part.rows.first().map_or([0.0; MAX_AXES], |r| *pick(r));
        Motion { position, velocity: slope(&part.rows, pick, false), acceleration: [0.0; MAX_AXES] }
    }

    /// Position at a time within a part.
    fn position(&self, part: &Part, time_s: f64, pick: fn(&Row) -> &AxisArray) -> AxisArray {
        let rows = &part.rows;
        let after = rows.partition_point(|r| r.time_s <= time_s + 1e-9).clamp(1, rows.len() - 1);
        let (a, b) = (&rows[after - 1], &rows[after]);
        let span = b.time_s - a.time_s;
        let u = ((time_s - a.time_s) / span).clamp(0.0, 1.0);
        let (pa, pb) = (pick(a), pick(b));
        // exact samples stay exact
        if u < 1e-6 {
            return *pa;
        }
        if u > 1.0 - 1e-6 {
            return *pb;
        }
        let before = after.checked_sub(2).map(|i| &rows[i]);
        let behind = rows.get(after + 1);
        let mut q = [0.0; MAX_AXES];
        for (k, value) in q.iter_mut().enumerate() {
            let straight = (pb[k] - pa[k]) / span;
            if self.interpolation == Interpolation::Linear {
                *value = pa[k] + straight * span * u;
                continue;
            }
            let from = before.map_or(straight, |r| (pb[k] - pick(r)[k]) / (b.time_s - r.time_s));
            let to = behind.map_or(straight, |r| (pick(r)[k] - pa[k]) / (r.time_s - a.time_s));
            let (u2, u3) = (u * u, u * u * u);
            *value = (2.0 * u3 - 3.0 * u2 + 1.0) * pa[k]
                + (u3 - 2.0 * u2 + u) * span * from
                + (3.0 * u2 - 2.0 * u3) * pb[k]
                + (u3 - u2) * span * to;
        }
        q
    }

    fn speed(&self, q: &AxisArray, behind: &AxisArray, dt_s: f64) -> f64 {
        let squares = (0..MAX_AXES).filter(|&k| self.linear[k]).map(|k| ((behind[k] - q[k]) / dt_s).powi(2));
        squares.sum::<f64>().sqrt()
    }

    fn sample(&self, stretch: &Stretch, cycle: u64) -> MotionCycle {
        let (commanded, measured, speed, scored, line) = match stretch {
            Stretch::Recorded(part) => {
                let t = cycle as f64 * self.cycle_s;
                let last = duration(part);
                let h = self.cycle_s.min(0.5 * last);
                let t_slope = t.min(last - h).max(0.0);
                let pick: fn(&Row) -> &AxisArray = |r| &r.commanded;
                let speed = self.speed(
                    &self.position(part, t_slope, pick),
                    &self.position(part, t_slope + h, pick),
                    h,
                );
                let row = part.rows.partition_point(|r| r.time_s <= t + 1e-9).max(1) - 1;
                let actual = self.position(part, t, |r| &r.actual);
                (self.position(part, t, pick), actual, speed, true, part.rows[row].line)
            }
            Stretch::Connecting(inserted) => {
                let t = (cycle + 1) as f64 * self.cycle_s;
                let m = inserted.commanded.at(t);
                let speed = self.speed(&[0.0; MAX_AXES], &m.velocity, 1.0);
                (m.position, inserted.actual.at(t).position, speed, false, 0)
            }
        };
        MotionCycle {
            commanded,
            measured: Some(measured),
            feed_mm_per_min: speed * 60.0,
            moving: speed > STANDSTILL_MM_PER_S,
            scored,
            line,
        }
    }
}

/// Why the shipped recording cannot be replayed on a machine.
#[derive(Debug, thiserror::Error)]
pub enum ShippedError {
    /// Its description is broken.
    #[error("shipped recording: {0}")]
    Description(#[from] super::DescriptionError),
    /// It does not fit the machine or the cycle.
    #[error("shipped recording: {0}")]
    Recording(#[from] RecordingError),
}

fn duration(part: &Part) -> f64 {
    part.rows.last().map_or(0.0, |r| r.time_s)
}

/// Mean speed over up to five samples at an end of a part (one step would mostly be encoder noise).
fn slope(rows: &[Row], pick: fn(&Row) -> &AxisArray, at_end: bool) -> AxisArray {
    let n = rows.len().min(5);
    let part = if at_end { &rows[rows.len() - n..] } else { &rows[..n] };
    let mut v = [0.0; MAX_AXES];
    if let (Some(a), Some(b)) = (part.first(), part.last()) {
        for (k, value) in v.iter_mut().enumerate() {
            *value = (pick(b)[k] - pick(a)[k]) / (b.time_s - a.time_s).max(1e-9);
        }
    }
    v
}

impl MotionSource for Replay {
    fn start(&self) -> AxisArray {
        match self.stretches.first() {
            Some(stretch) => self.sample(stretch, 0).commanded,
            None => [0.0; MAX_AXES],
        }
    }

    fn next_cycle(&mut self) -> Option<MotionCycle> {
        while self.cycle >= self.cycles_of(self.stretches.get(self.stretch)?) {
            self.stretch += 1;
            self.cycle = 0;
        }
        let cycle = self.sample(self.stretches.get(self.stretch)?, self.cycle);
        self.cycle += 1;
        Some(cycle)
    }

    fn rewind(&mut self) {
        (self.stretch, self.cycle) = (0, 0);
    }
}

#[cfg(test)]
mod tests;
