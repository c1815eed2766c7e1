//! The files of the n-point method.

use crate::identify::prelude::*;
use volcomp_identify::threepoint::{Seen, Shot};

/// Endings of the columns of a point.
const ENDINGS: [&str; 6] = ["_x_mm", "_y_mm", "_z_mm", "_range_mm", "_azimuth_deg", "_elevation_deg"];

/// Names and platform coordinates.
pub(super) fn points(path: &Path) -> Result<Vec<Named>> {
    columns::named_points(path, "point", |word| match word {
        "" => "a point without a name".to_owned(),
        _ => format!("point {word} occurs twice; remove one"),
    })
}

/// The rows of a measured file.
pub(super) fn shots(
    path: &Path,
    points: &[Named],
    frame: &Frame,
    tracker: &TrackerArgs,
) -> Result<Vec<Shot>> {
    let mut table = table::open(path)?;
    let run = table.run("position_mm")?;
    let mut columns = Vec::with_capacity(points.len());
    for (i, (name, _)) in points.iter().enumerate() {
        if let Some(found) = PointColumns::find(&mut table, &format!("{name}_"))? {
            found.check_frame(tracker, frame, path)?;
            columns.push((i, found));
        }
    }
    table.only_asked(|column| {
        let wanted: Vec<String> =
            points.iter().flat_map(|(name, _)| ENDINGS.map(|e| format!("{name}{e}"))).collect();
        columns::hint(column, &wanted, "position_mm, cycle, direction and NAME_x_mm, NAME_y_mm, NAME_z_mm (or NAME_range_mm, NAME_azimuth_deg, NAME_elevation_deg) for the points of --points")
    })?;
    let absent: Vec<&str> = (0..points.len())
        .filter(|i| columns.iter().all(|(seen, _)| seen != i))
        .map(|i| points[i].0.as_str())
        .collect();
    if !absent.is_empty() {
        note!("note: {}: no columns of point {}, which is left out", path.display(), absent.join(", "));
    }
    table.some_rows(|row| {
        let at = row.reading(&run)?;
        let (mut ids, mut seen) = (Vec::with_capacity(columns.len()), Vec::with_capacity(columns.len()));
        for (i, c) in columns.iter().filter(|(_, c)| !c.is_empty(row)) {
            let (measured, covariance) = frame.read(row, *c)?;
            ids.push(*i);
            seen.push(Seen { platform: points[*i].1, measured, covariance });
        }
        Ok(Shot { position: at.position, cycle: at.cycle, travel: at.travel, ids, seen })
    })
}

/// The points of every row, whatever their names; `names` grows with the files.
pub(super) fn poses(path: &Path, frame: &Frame, names: &mut Vec<String>) -> Result<Vec<Vec<Option<Vec3>>>> {
    let mut table = table::open(path)?;
    let mut columns: Vec<(usize, PointColumns)> = Vec::new();
    for column in table.columns().to_vec() {
        let Some(name) = column.strip_suffix("_x_mm").or_else(|| column.strip_suffix("_range_mm")) else {
            continue;
        };
        let Some(found) = PointColumns::find(&mut table, &format!("{name}_"))? else { continue };
        let index = names.iter().position(|n| n == name).unwrap_or_else(|| {
            names.push(name.to_owned());
            names.len() - 1
        });
        columns.push((index, found));
    }
    if columns.len() < 2 {
        return Err(data!(
            path,
            "{} points; rigidity compares distances between points with columns NAME_x_mm, NAME_y_mm, NAME_z_mm (or NAME_range_mm, NAME_azimuth_deg, NAME_elevation_deg)",
            columns.len()
        ));
    }
    table.rows(|row| {
        let mut pose = vec![None; names.len()];
        for (i, c) in columns.iter().filter(|(_, c)| !c.is_empty(row)) {
            pose[*i] = Some(frame.place(row, *c)?);
        }
        Ok(pose)
    })
}
