//! Files of instruments and controls as sessions: the format is detected from the content, and every assumption is stated.
//!
//! One file per kind of measurement. What is no measurement of a machine, or holds no readings, is refused with the reason
//! ([`unsuitable`]).

mod capture;
mod circular;
mod displacement;
mod plate;
mod points;
mod positioning;
mod unsuitable;

use clap::Args;

use super::ideal::Rotary;
use crate::import::DEVIATION_UNITS;
use crate::prelude::*;
use volcomp_diagnose::session::{Note, Raw, Times};
use volcomp_formats::rtl::DeviationUnit;
use volcomp_formats::{detect, hole_plate, reflector_poses, text};
use volcomp_identify::ballbar::Plane;

/// What files of instruments do not state.
#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "Files of instruments and controls (docs/reference/session-files.md 1.7)")]
pub(super) struct InstrumentArgs {
    /// Axis of a positioning test that does not name it [default: x].
    #[arg(long, value_name = "LETTER", value_parser = axis_letter)]
    axis: Option<AxisName>,
    /// Unit of the deviations of an .rtl of a rotary axis.
    #[arg(long, value_parser = one_of(DEVIATION_UNITS))]
    deviation_unit: Option<DeviationUnit>,
    /// Plane of a circular test: xy, yz or zx [default: xy].
    #[arg(long, value_name = "PLANE", value_parser = plane)]
    plane: Option<Plane>,
    /// Nominal radius of a circular test [default: 150].
    #[arg(long, value_name = "MM")]
    radius_mm: Option<f64>,
    /// Programmed X, Y, Z at the centre of a circular test.
    #[arg(long, value_name = "X,Y,Z", value_parser = crate::arg_parsers::point, allow_hyphen_values = true)]
    centre_mm: Option<Vec3>,
    /// Feed of a circular test without a column for it.
    #[arg(long, value_name = "MM/MIN")]
    feed_mm_per_min: Option<f64>,
    /// Axes of an Edge capture by number, such as x=1,y=2,z=6 [default: by their names].
    #[arg(long, value_delimiter = ',', value_name = "AXIS=NUMBER", value_parser = numbered)]
    axes: Vec<(AxisName, u32)>,
    /// Of a capture only the following error of this axis.
    #[arg(long, value_name = "LETTER", value_parser = axis_letter)]
    only: Option<AxisName>,
    /// Columns of a log of displacement by direction, such as x=ch1_um,z=ch5_um.
    #[arg(long, value_delimiter = ',', value_name = "DIRECTION=COLUMN", value_parser = directed)]
    series: Vec<(usize, String)>,
}

fn numbered(text: &str) -> Result<(AxisName, u32), String> {
    let wrong = || format!("'{text}' is not AXIS=NUMBER, such as x=1");
    let (axis, number) = text.split_once('=').ok_or_else(wrong)?;
    Ok((axis_letter(axis)?, number.parse().map_err(|_| wrong())?))
}

fn directed(text: &str) -> Result<(usize, String), String> {
    let wrong = || format!("'{text}' is not DIRECTION=COLUMN with x, y or z, such as z=ch5_um");
    let (direction, column) = text.split_once('=').ok_or_else(wrong)?;
    let at = ["x", "y", "z"].iter().position(|d| *d == direction).ok_or_else(wrong)?;
    Ok((at, column.to_owned()))
}

fn plane(text: &str) -> Result<Plane, String> {
    Plane::parse(text).ok_or_else(|| format!("invalid plane '{text}'; write xy, yz or zx"))
}

/// A file of an instrument or a control as a session.
#[derive(Debug)]
pub(super) struct Measurement {
    /// The readings.
    pub(super) raw: Raw,
    /// The format, in words.
    pub(super) format: String,
    /// What was found and assumed.
    pub(super) notes: Vec<String>,
    /// The rotary axis tested and the radius at which its deviations are given.
    pub(super) rotary: Option<Rotary>,
}

impl Measurement {
    fn new(rows: Rows, times: Times, format: impl Into<String>) -> Self {
        let mut raw = rows.raw;
        raw.times = Some(times);
        Self { raw, format: format.into(), notes: Vec::new(), rotary: None }
    }

    /// Tells stderr what was detected and assumed; the same as notes of the session.
    pub(super) fn announce(&self, path: &Path) -> Vec<Note> {
        let file = path.display();
        note!("{file}: {}", self.format);
        for note in &self.notes {
            note!("  {note}");
        }
        let all = std::iter::once(&self.format).chain(&self.notes);
        all.map(|text| Note::new(format!("{file}: {text}"))).collect()
    }

    fn note(&mut self, text: impl Into<String>) {
        self.notes.push(text.into());
    }
}

/// The session in a file of an instrument or a control; `None` where the beginning of the file gives none away.
pub(super) fn recognised(
    path: &Path,
    head: &[u8],
    args: &InstrumentArgs,
    model: Option<&Model>,
) -> Result<Option<Measurement>> {
    if !args.series.is_empty() {
        return displacement::read(path, args).map(Some);
    }
    let decoded = text::decode(head);
    let start = decoded.text.as_ref();
    let header = header(start);
    let has = |name: &str| header.contains(&name);
    if points::is_list(&header) {
        return points::read(path, model).map(Some);
    }
    // a session file, complete or not
    if has("u_x") || has("setup") {
        return Ok(None);
    }
    use detect::Format::{ApiPos, Edge, Iso230Dat, Rtl};
    match detect::format(head) {
        Some(Iso230Dat | Rtl | ApiPos) => return positioning::read(path, args).map(Some),
        Some(Edge) => return capture::json(path, args).map(Some),
        Some(other) => return Err(unsuitable::format(path, other)),
        None => {}
    }
    if hole_plate::recognises(start) {
        return plate::cmm_list(path).map(Some);
    }
    if let Some(poses) = reflector_poses::recognise(start) {
        return Err(unsuitable::robot(path, &poses));
    }
    if has("cycle") && (has("target_mm") || has("target_deg")) {
        return positioning::table(path, args).map(Some);
    }
    if has("angle_deg") && has("deviation_um") && has("direction") {
        return circular::read(path, args).map(Some);
    }
    if has("nominal_x_mm") && has("nominal_y_mm") {
        return plate::table(path).map(Some);
    }
    if has("CYCLE") && header.iter().any(|c| c.starts_with("DES_POS|")) {
        return capture::table(path, args).map(Some);
    }
    if displacement::is_log(&header) {
        return displacement::read(path, args).map(Some);
    }
    Ok(None)
}

/// Names of the columns of a table: the first line that is neither blank nor a comment.
fn header(start: &str) -> Vec<&str> {
    let line = start.lines().map(str::trim).find(|l| !l.is_empty() && !l.starts_with('#'));
    line.map_or_else(Vec::new, |l| l.split(',').map(|c| c.trim().trim_matches('"')).collect())
}

/// Rows under construction.
struct Rows {
    raw: Raw,
}

impl Rows {
    fn new(path: &Path, names: impl IntoIterator<Item: Into<String>>) -> Self {
        let names: Vec<String> = names.into_iter().map(Into::into).collect();
        let columns = vec![Vec::new(); names.len()];
        Self { raw: Raw { file: path.display().to_string(), names, columns, ..Raw::default() } }
    }

    fn push(&mut self, line: u64, instrument: &str, values: &[f64]) {
        debug_assert_eq!(values.len(), self.raw.names.len(), "a value for each column");
        for (c, v) in self.raw.columns.iter_mut().zip(values) {
            c.push(*v);
        }
        self.raw.instruments.push(instrument.to_owned());
        self.raw.lines.push(line);
    }
}

/// In how many directions was measured, in words.
fn ways(travels: impl Iterator<Item = Travel> + Clone) -> &'static str {
    let both = [Travel::Forward, Travel::Reverse].iter().all(|way| travels.clone().any(|t| t == *way));
    if both { "both directions" } else { "one direction" }
}

/// Unit vector along x, y or z.
fn along(direction: usize) -> [f64; 3] {
    std::array::from_fn(|k| f64::from(u8::from(k == direction)))
}
