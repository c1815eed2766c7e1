//! A laser test computed from a model.

use super::{Deviation, Entry, Rtl, write};
use crate::motion_table::FREE;
use crate::prelude::*;
use crate::sample::sample_positioning;

/// The positioning error of a linear axis as a test of one run in each direction; with the points that are in it.
///
/// # Errors
/// The axis is rotary or has no positioning error, or cannot be sampled so.
pub fn of_model(
    spec: &ModelSpec,
    axis: AxisName,
    sampling: &Sampling,
) -> Result<(String, AxisTable), ExportError> {
    if axis.kind() == AxisKind::Rotary {
        let (format, known) = ("rtl", "linear ones: the unit of angles is not documented");
        return Err(ExportError::NoSuchAxis { axis, format, known });
    }
    let table = sample_positioning(spec, axis, sampling, &Limits { format: "rtl", ..FREE })?;
    let column = &table.columns[0];
    let entry = |key: &str, text: String| Entry { key: key.to_owned(), text };
    // as written: without the rounding of the curve's evaluation
    let um = |v: f64| rounded(um_from_mm(v), 3).parse::<f64>().unwrap_or(v);
    let row = |run, i: usize, v: f64| Deviation { run, target: i as u32 + 1, value: um(v), line: 0 };
    let mut deviations: Vec<Deviation> =
        column.forward.iter().enumerate().map(|(i, v)| row(1, i, *v)).collect();
    let one_way = column.reverse.is_none();
    if let Some(reverse) = &column.reverse {
        deviations.extend(reverse.iter().enumerate().rev().map(|(i, v)| row(2, i, *v)));
    }
    let file = Rtl {
        header: vec![
            entry("File type", "rtl".into()),
            entry("Owner", "volcomp".into()),
            entry("Version no", env!("CARGO_PKG_VERSION").into()),
        ],
        filetype: "ISO".to_owned(),
        targets: table.positions.clone(),
        flags: vec![0, i64::from(one_way), 2, 0],
        user_text: vec![
            entry("Machine", spec.machine.clone()),
            entry("Axis", axis.to_string()),
            entry("TITLE", "computed from a model, not measured".into()),
        ],
        run_count: if one_way { 1 } else { 2 },
        deviations,
        ..Rtl::default()
    };
    Ok((write(&file), table))
}
