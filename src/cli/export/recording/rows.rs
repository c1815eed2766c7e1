//! Entries to rows: time on one clock, velocities, directions, distances since the last reversal.

use super::sensors::Sensors;
use crate::prelude::*;
use volcomp_engine::fault;
use volcomp_protocol::record::{Change, Cycle, Entry, Item};
use volcomp_protocol::{ControlHello, MachineState, Tool};
use volcomp_units::{MonoTime, NS_PER_S};

/// Kind of a column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Number,
    Whole,
    Text,
}

/// A column.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Column {
    pub(super) name: String,
    pub(super) kind: Kind,
}

/// A cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Cell {
    Empty,
    Number(f64),
    Whole(i64),
    Text(&'static str),
}

impl core::fmt::Display for Cell {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Empty => Ok(()),
            Self::Number(v) => write!(f, "{v}"),
            Self::Whole(v) => write!(f, "{v}"),
            Self::Text(v) => f.write_str(v),
        }
    }
}

impl Cell {
    /// A number where it is one.
    fn number(value: f64) -> Self {
        if value.is_finite() { Self::Number(value) } else { Self::Empty }
    }
}

/// How an axis has moved. mm and s, or deg and s.
#[derive(Debug, Clone, Copy)]
struct Motion {
    last: f64,
    /// Furthest position in the present direction.
    turning: f64,
    /// Direction of travel; 0 before the first move.
    direction: i8,
    /// Where and when it reversed last; the first position counts as one.
    reversed: (f64, f64),
    velocity: Option<f64>,
}

impl Motion {
    const fn start(position: f64, t_s: f64) -> Self {
        Self { last: position, turning: position, direction: 0, reversed: (position, t_s), velocity: None }
    }

    fn step(&mut self, position: f64, t_s: f64, dt: f64, deadband: f64) {
        let beyond = position - self.turning;
        let onward = beyond * f64::from(self.direction) > 0.0;
        let back = (self.direction == 0 && beyond != 0.0 || beyond * f64::from(self.direction) < 0.0)
            && beyond.abs() > deadband;
        if back {
            self.direction = if beyond > 0.0 { 1 } else { -1 };
            self.reversed = (self.turning, t_s);
        }
        if onward || back {
            self.turning = position;
        }
        self.velocity = (dt > 0.0).then(|| (position - self.last) / dt);
        self.last = position;
    }
}

#[derive(Debug, Clone, Copy)]
struct Axis {
    name: AxisName,
    deadband: f64,
    motion: Option<Motion>,
}

/// Time of the control on one line that goes on over links.
#[derive(Debug, Clone, Copy)]
struct Anchor {
    control_ns: i64,
    t_s: f64,
}

/// What takes a column: its name, made where it is asked for, its kind, and a cell.
type Put<'a> = dyn FnMut(core::fmt::Arguments<'_>, (Kind, Cell)) + 'a;

/// Turns entries into rows.
#[derive(Default)]
pub(super) struct Rows {
    config: Option<MachineConfig>,
    sensors: Sensors,
    axes: Vec<Axis>,
    /// The columns of the axes known.
    pub(super) columns: Vec<Column>,
    /// The last row.
    pub(super) cells: Vec<Cell>,
    first: Option<MonoTime>,
    anchor: Option<Anchor>,
    last_control_ns: i64,
    /// Its time.
    pub(super) t_s: f64,
    tool: Option<Tool>,
    /// Links seen: each is a mounting of its own for the columns of sessions.
    links: i64,
}

impl Rows {
    pub(super) fn new(config: Option<MachineConfig>, sensors: Sensors) -> Self {
        let mut rows = Self { config, sensors, ..Self::default() };
        rows.columns = rows.names();
        rows
    }

    /// Takes an item; true where it gave a row.
    pub(super) fn feed(&mut self, item: &Item) -> Result<bool, String> {
        match item {
            Item::Gap { context, record, .. } => {
                if let Some(hello) = &context.hello {
                    self.control(hello, *record)?;
                }
                self.tool = context.tool;
                self.sensors.switch(context.model);
                self.interrupt();
                Ok(false)
            }
            Item::Unknown { .. } => Ok(false),
            Item::Entry { record, entry } => {
                self.first.get_or_insert(entry.now());
                match entry {
                    Entry::Engine { hello, .. } => self.control(hello, *record)?,
                    Entry::Tool { tool, .. } => self.tool = Some(*tool),
                    Entry::Model { hash, .. } => self.sensors.switch(Some(*hash)),
                    Entry::Live { told, values, .. } => self.sensors.update(*told, values),
                    Entry::LinkUp { .. } => {
                        self.links += 1;
                        self.tool = None;
                        self.interrupt();
                    }
                    Entry::Cycle(cycle) if !self.axes.is_empty() => {
                        self.cycle(*record, cycle);
                        return Ok(true);
                    }
                    _ => {}
                }
                Ok(false)
            }
        }
    }

    /// What was known of the motion does not go on.
    fn interrupt(&mut self) {
        self.anchor = None;
        self.axes.iter_mut().for_each(|axis| axis.motion = None);
    }

    fn control(&mut self, hello: &ControlHello, record: u64) -> Result<(), String> {
        let names: Vec<AxisName> = hello.used_axes().iter().map(|axis| axis.name).collect();
        if self.axes.is_empty() {
            let configured = self.config.iter().flat_map(|c| &c.axes);
            let deadband = |name: AxisName| {
                let axis = configured.clone().find(|a| a.name == name);
                axis.map_or(0.0, |a| name.kind().position_out(a.reversal_deadband))
            };
            let axis = |name: &AxisName| Axis { name: *name, deadband: deadband(*name), motion: None };
            self.axes = names.iter().map(axis).collect();
            self.columns = self.names();
        } else if !self.axes.iter().map(|a| a.name).eq(names) {
            return Err(format!(
                "record {record}: the control comes back with other axes; export the files apart"
            ));
        }
        Ok(())
    }

    /// Columns for the axes known.
    fn names(&self) -> Vec<Column> {
        let mut columns = Vec::new();
        self.columns_of(None, &mut |name, (kind, _)| columns.push(Column { name: name.to_string(), kind }));
        columns
    }

    /// Time of the row: the control's clock, which has no jitter, set to ours at the beginning of every link.
    fn time(&mut self, cycle: &Cycle) -> f64 {
        let first = *self.first.get_or_insert(cycle.now);
        let control_ns = cycle.frame.control_ns;
        if control_ns < self.last_control_ns {
            self.interrupt();
        }
        self.last_control_ns = control_ns;
        let t_s = cycle.now.seconds_since(first).max(self.t_s);
        let anchor = *self.anchor.get_or_insert(Anchor { control_ns, t_s });
        anchor.t_s + control_ns.saturating_sub(anchor.control_ns) as f64 / NS_PER_S
    }

    fn cycle(&mut self, record: u64, cycle: &Cycle) {
        let frame = &cycle.frame;
        let before = self.t_s;
        let t_s = self.time(cycle);
        self.t_s = t_s;
        for (axis, position) in self.axes.iter_mut().zip(frame.commanded) {
            match &mut axis.motion {
                _ if !position.is_finite() => axis.motion = None,
                Some(motion) => motion.step(position, t_s, t_s - before, axis.deadband),
                None => axis.motion = Some(Motion::start(position, t_s)),
            }
        }
        let mut cells = core::mem::take(&mut self.cells);
        cells.clear();
        self.columns_of(Some((record, cycle)), &mut |_, (_, cell)| cells.push(cell));
        self.cells = cells;
    }

    /// Every column in its order: name, kind, and its cell of the cycle; empty where none is given.
    fn columns_of(&self, of: Option<(u64, &Cycle)>, put: &mut Put<'_>) {
        let frame = of.map(|(_, cycle)| &cycle.frame);
        let answer = of.and_then(|(_, cycle)| cycle.answer.as_ref());
        let number = |value: Option<f64>| (Kind::Number, value.map_or(Cell::Empty, Cell::number));
        let whole = |value: Option<i64>| (Kind::Whole, value.map_or(Cell::Empty, Cell::Whole));
        let flag = |set: Option<bool>| whole(set.map(i64::from));
        let text = |words: Option<&'static str>| (Kind::Text, words.map_or(Cell::Empty, Cell::Text));
        put(format_args!("t_s"), number(Some(self.t_s)));
        put(format_args!("instrument"), text(Some("recording")));
        put(format_args!("setup"), whole(Some(self.links)));
        put(format_args!("run"), whole(Some(0)));
        put(format_args!("repeat"), whole(Some(0)));
        for (k, Axis { name, .. }) in self.axes.iter().enumerate() {
            let cell = number(frame.map(|f| f.commanded[k]));
            put(format_args!("{}_{}", name.lower(), position_unit(*name)), cell);
        }
        for name in ["u_x", "u_y", "u_z", "deviation_um"] {
            put(format_args!("{name}"), number(None));
        }
        for (k, axis) in self.axes.iter().enumerate() {
            let (letter, unit, fine) = (axis.name.lower(), position_unit(axis.name), offset_unit(axis.name));
            let kind = axis.name.kind();
            let offset = |v: f64| kind.offset_out(kind.position_in(v));
            let moved = axis.motion.filter(|m| m.direction != 0);
            let bit = |bits: Option<u8>| flag(bits.map(|b| b >> k & 1 == 1));
            put(format_args!("v{letter}_{unit}_per_s"), number(axis.motion.and_then(|m| m.velocity)));
            put(format_args!("dir_{letter}"), whole(moved.map(|m| m.direction.into())));
            let since = moved.map(|m| ((m.last - m.reversed.0).abs(), self.t_s - m.reversed.1));
            put(format_args!("since_reversal_{letter}_{unit}"), number(since.map(|s| s.0)));
            put(format_args!("since_reversal_{letter}_s"), number(since.map(|s| s.1)));
            put(format_args!("actual_{letter}_{unit}"), number(frame.map(|f| f.actual[k])));
            put(format_args!("offset_{letter}_{fine}"), number(answer.map(|a| offset(a.offset[k]))));
            put(format_args!("applied_{letter}_{fine}"), number(frame.map(|f| offset(f.applied[k]))));
            put(format_args!("wanted_{letter}_{fine}"), number(answer.map(|a| offset(a.wanted[k]))));
            for (name, bits) in [
                ("limited", answer.map(|a| a.limited)),
                ("warning", answer.map(|a| a.warning)),
                ("out_of_range", answer.map(|a| a.out_of_range)),
                ("faded", answer.map(|a| a.faded)),
            ] {
                put(format_args!("{name}_{letter}"), bit(bits));
            }
        }
        let has = |bit| flag(frame.map(|f| f.state.has(bit)));
        put(format_args!("moving"), has(MachineState::MOVING));
        for (k, name) in ["tool_x_mm", "tool_y_mm", "tool_z_mm"].into_iter().enumerate() {
            put(format_args!("{name}"), number(self.tool.map(|tool| tool.tip[k])));
        }
        put(format_args!("feed_mm_per_min"), number(frame.map(|f| f.feed_mm_per_min)));
        for (name, unit, value) in self.sensors.values() {
            put(format_args!("live_{name}_{unit}"), number(value));
        }
        put(format_args!("state"), text(answer.map(|a| a.state.name())));
        put(format_args!("cause"), text(answer.and_then(|a| a.change).map(cause)));
        let lag = answer.map(|a| a.lag_cycles).filter(|cycles| *cycles > 0);
        put(format_args!("lag_cycles"), whole(lag.map(i64::from)));
        for (name, bit) in [
            ("homed", MachineState::HOMED),
            ("enabled", MachineState::ENABLED),
            ("estop", MachineState::ESTOP),
            ("offset_limited", MachineState::OFFSET_LIMITED),
            ("offset_ramping_out", MachineState::OFFSET_RAMPING_OUT),
        ] {
            put(format_args!("{name}"), has(bit));
        }
        put(format_args!("sequence"), whole(frame.map(|f| f.sequence.into())));
        let record = of.map(|(record, _)| i64::try_from(record).unwrap_or(i64::MAX));
        put(format_args!("record"), whole(record));
        put(format_args!("control_s"), number(frame.map(|f| f.control_ns as f64 / NS_PER_S)));
        let received = of.map(|(_, cycle)| self.first.map_or(0.0, |first| cycle.now.seconds_since(first)));
        put(format_args!("received_s"), number(received));
    }
}

/// Name of what changed the state.
fn cause(change: Change) -> &'static str {
    fault::Code(change.cause).entry().map_or("unknown", |entry| entry.name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reversal_counts_beyond_the_dead_band_only() {
        let mut motion = Motion::start(10.0, 0.0);
        motion.step(10.0, 0.001, 0.001, 0.005);
        assert_eq!((motion.direction, motion.velocity), (0, Some(0.0)));
        motion.step(11.0, 0.002, 0.001, 0.005);
        assert_eq!(motion.direction, 1);
        assert!((motion.velocity.expect("moving") - 1000.0).abs() < 1e-9);
        motion.step(10.996, 0.003, 0.001, 0.005);
        assert_eq!(motion.direction, 1, "within the dead band");
        motion.step(10.9, 0.004, 0.001, 0.005);
        assert_eq!(motion.direction, -1);
        assert_eq!(motion.reversed, (11.0, 0.004));
        assert!(((motion.last - motion.reversed.0).abs() - 0.1).abs() < 1e-12);
    }
}
