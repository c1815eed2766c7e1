//! Plates: lists of hole or ball positions from a CMM, drilled by the machine or measured on it.

use super::{Measurement, Rows, along};
use crate::prelude::*;
use volcomp_diagnose::session::Times;
use volcomp_evaluate::PlatePoint;
use volcomp_formats::hole_plate;

const COLUMNS: &str = "t_s setup run repeat moving x_mm y_mm dir_x dir_y u_x u_y u_z deviation_um hole_mm";

/// The list of a CMM with its nine columns.
pub(super) fn cmm_list(path: &Path) -> Result<Measurement> {
    let text = input::read_text(path, InputKind::Instrument)?;
    let plate = hole_plate::parse(&text).map_err(|e| format_failure(&path.display().to_string(), &e))?;
    let mut rows = Rows::new(path, COLUMNS.split(' '));
    let mut repeats = Repeats::default();
    for (i, hole) in plate.holes.iter().enumerate() {
        let repeat = repeats.next(hole.place.nominal);
        hole_rows(&mut rows, i, hole.line as u64, repeat, &hole.place, hole.diameter);
    }
    let title = if plate.title.is_empty() { String::new() } else { format!(" ({})", plate.title) };
    Ok(finished(rows, plate.holes.len(), &format!("plate measured on a CMM{title}")))
}

/// The table of `volcomp evaluate plate`.
pub(super) fn table(path: &Path) -> Result<Measurement> {
    let mut table = table::open(path)?;
    let nominal = [table.require("nominal_x_mm")?, table.require("nominal_y_mm")?];
    let deviations = table.find("deviation_x_um").is_some();
    let names =
        if deviations { ["deviation_x_um", "deviation_y_um"] } else { ["measured_x_mm", "measured_y_mm"] };
    let values = [table.require(names[0])?, table.require(names[1])?];
    let diameter = table.find("nominal_diameter_mm");
    let mut rows = Rows::new(path, COLUMNS.split(' '));
    let (mut count, mut repeats) = (0, Repeats::default());
    table.some_rows(|table| {
        let at = |column: usize| table.number(column);
        let nominal = [at(nominal[0])?, at(nominal[1])?];
        let v = [at(values[0])?, at(values[1])?];
        let measured = if deviations { [nominal[0] + v[0] * 1e-3, nominal[1] + v[1] * 1e-3] } else { v };
        let diameter = diameter.map_or(Ok(f64::NAN), at)?;
        let repeat = repeats.next(nominal);
        hole_rows(&mut rows, count, table.line(), repeat, &PlatePoint { nominal, measured }, diameter);
        count += 1;
        Ok(())
    })?;
    Ok(finished(rows, count, "plate (nominal and measured positions)"))
}

/// How often each position was measured before.
#[derive(Default)]
struct Repeats(BTreeMap<[i64; 2], u32>);

impl Repeats {
    fn next(&mut self, nominal: [f64; 2]) -> f64 {
        let count = self.0.entry(nominal.map(|v| (v * 1e3).round() as i64)).or_default();
        *count += 1;
        f64::from(*count)
    }
}

/// One sample of two rows: x and y of a hole.
fn hole_rows(rows: &mut Rows, count: usize, line: u64, repeat: f64, place: &PlatePoint, diameter: f64) {
    for axis in 0..2 {
        let [x, y, z] = along(axis);
        let d = um_from_mm(place.measured[axis] - place.nominal[axis]);
        let [nx, ny] = place.nominal;
        // the list does not tell from which side the machine approached a hole
        let values = [count as f64, 1.0, 1.0, repeat, 0.0, nx, ny, 0.0, 0.0, x, y, z, d, diameter];
        rows.push(line, "cmm", &values);
    }
}

fn finished(rows: Rows, holes: usize, format: &str) -> Measurement {
    let mut found = Measurement::new(rows, Times::Ordinal, format);
    found.note(format!("{} in the xy plane, z at 0", counted(holes, "hole")));
    found.note(
        "the machine made or measured the plate along its X and Y, parallel to those of the list; position and rotation of the \
         plate in the list are those of its clamping",
    );
    found.note("the order of the list is taken as the order measured; the order of machining and the directions of approach are not known");
    found
}
