//! What happened in one cycle, and its CSV form.

use std::io::Write;

use volcomp_protocol::{Correction, MachineState};
use volcomp_units::axes::AxisArray;

use crate::motion::MachineAxes;
use crate::truth::Sample;

/// One control cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CycleRecord {
    /// Sequence number on the wire.
    pub sequence: u32,
    /// Cycle, counted from the first of this control.
    pub cycle: u64,
    /// Time of the cycle, s.
    pub time_s: f64,
    /// Commanded positions without offset, mm or deg.
    pub commanded: AxisArray,
    /// Offset in force, mm or deg.
    pub applied: AxisArray,
    /// The last correction received during this cycle (in lock step: the answer to it).
    pub correction: Option<Correction>,
    /// What the machine did.
    pub sample: Sample,
    /// State of the machine.
    pub state: MachineState,
    /// Speed along the path, mm/min.
    pub feed_mm_per_min: f64,
    /// Counts for results.
    pub scored: bool,
    /// A daemon is connected.
    pub connected: bool,
    /// Line of the program or recording.
    pub line: u32,
}

/// Writes records as CSV; columns end in their unit.
///
/// `x_mm` commanded, `x_actual_mm` encoder, `x_true_mm` where the axis really stands, `x_offset_mm` the offset in
/// force, `x_asked_mm` the offset asked for (empty without a correction), `tip_x_mm` the tool tip.
pub struct TraceWriter<W: Write> {
    writer: csv::Writer<W>,
    axes: usize,
}

impl<W: Write> TraceWriter<W> {
    /// A writer; writes the header.
    ///
    /// # Errors
    /// The output cannot be written.
    pub fn new(output: W, axes: &MachineAxes) -> Result<Self, csv::Error> {
        let mut writer = csv::Writer::from_writer(output);
        let mut header: Vec<String> =
            ["t_s", "sequence", "line", "moving", "scored", "connected", "state"].map(str::to_owned).into();
        header.push("feed_mm_per_min".to_owned());
        for axis in axes.as_slice() {
            let letter = axis.name.lower();
            let unit = match axis.name.kind() {
                volcomp_units::axes::AxisKind::Linear => "mm",
                volcomp_units::axes::AxisKind::Rotary => "deg",
            };
            header.push(format!("{letter}_{unit}"));
            for what in ["actual", "true", "offset", "asked"] {
                header.push(format!("{letter}_{what}_{unit}"));
            }
        }
        header.extend(["tip_x_mm", "tip_y_mm", "tip_z_mm", "tool_i", "tool_j", "tool_k"].map(str::to_owned));
        writer.write_record(&header)?;
        Ok(Self { writer, axes: axes.len() })
    }

    /// Writes one record.
    ///
    /// # Errors
    /// The output cannot be written.
    pub fn write(&mut self, r: &CycleRecord) -> Result<(), csv::Error> {
        let flag = |on: bool| if on { "1" } else { "0" };
        self.writer.write_field(format!("{:.6}", r.time_s))?;
        self.writer.write_field(r.sequence.to_string())?;
        self.writer.write_field(r.line.to_string())?;
        self.writer.write_field(flag(r.state.has(MachineState::MOVING)))?;
        self.writer.write_field(flag(r.scored))?;
        self.writer.write_field(flag(r.connected))?;
        self.writer.write_field(format!("0x{:04x}", r.state.bits))?;
        self.writer.write_field(format!("{:.3}", r.feed_mm_per_min))?;
        for k in 0..self.axes {
            for value in [r.commanded[k], r.sample.encoder[k], r.sample.axis[k], r.applied[k]] {
                self.writer.write_field(format!("{value:.9}"))?;
            }
            self.writer.write_field(r.correction.map_or(String::new(), |c| format!("{:.9}", c.offset[k])))?;
        }
        for value in r.sample.tip_mm.iter().chain(&r.sample.direction) {
            self.writer.write_field(format!("{value:.9}"))?;
        }
        self.writer.write_record(None::<&[u8]>)
    }

    /// Writes what is still buffered.
    ///
    /// # Errors
    /// The output cannot be written.
    pub fn finish(mut self) -> std::io::Result<()> {
        self.writer.flush()
    }
}
