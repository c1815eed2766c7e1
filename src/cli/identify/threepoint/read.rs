//! The files of the n-point method.

use std::path::Path;

use crate::identify::tracker_points::{Columns, Frame, TrackerArgs};
use crate::table::{nearest, open};
use crate::{EX_DATAERR, Failure};
use volcomp_identify::threepoint::{Seen, Shot};
use volcomp_model::geometry::Vec3;
use volcomp_units::axes::Travel;

/// Endings of the columns of a point.
const ENDINGS: [&str; 6] = ["_x_mm", "_y_mm", "_z_mm", "_range_mm", "_azimuth_deg", "_elevation_deg"];

/// Names and platform coordinates.
pub(super) fn points(path: &Path) -> Result<Vec<(String, Vec3)>, Failure> {
    let mut table = open(path)?;
    let name = table.require("point")?;
    let [x, y, z] = [table.require("x_mm")?, table.require("y_mm")?, table.require("z_mm")?];
    let mut points: Vec<(String, Vec3)> = Vec::new();
    while table.advance()? {
        let word = table.word(name);
        if word.is_empty() {
            return Err(table.fail(name, "a point without a name"));
        }
        if points.iter().any(|(n, _)| *n == word) {
            return Err(table.fail(name, format_args!("point {word} occurs twice; remove one")));
        }
        points.push((word, Vec3::new(table.number(x)?, table.number(y)?, table.number(z)?)));
    }
    if points.is_empty() {
        return Err(Failure::new(
            EX_DATAERR,
            format_args!("error: {}: no points below the header", path.display()),
        ));
    }
    Ok(points)
}

/// The rows of a measured file.
pub(super) fn shots(
    path: &Path,
    points: &[(String, Vec3)],
    frame: &Frame,
    tracker: &TrackerArgs,
    into: &mut Vec<Shot>,
) -> Result<(), Failure> {
    let mut table = open(path)?;
    let position = table.require("position_mm")?;
    let (cycle, direction) = (table.find("cycle"), table.find("direction"));
    let mut columns = Vec::with_capacity(points.len());
    let mut known = vec![Some(position), cycle, direction];
    for (i, (name, _)) in points.iter().enumerate() {
        if let Some(found) = Columns::find(&table, &format!("{name}_")) {
            found.check_frame(tracker, frame, path)?;
            known.extend(found.indices().map(Some));
            columns.push((i, found));
        }
    }
    if let Some(other) = (0..table.columns().len()).find(|c| !known.contains(&Some(*c))) {
        let wanted: Vec<String> =
            points.iter().flat_map(|(name, _)| ENDINGS.map(|e| format!("{name}{e}"))).collect();
        let hint = match nearest(&table.columns()[other], wanted.iter().map(String::as_str)) {
            Some(near) => format!("is {near} meant?"),
            None => "columns are position_mm, cycle, direction and NAME_x_mm, NAME_y_mm, NAME_z_mm (or NAME_range_mm, NAME_azimuth_deg, NAME_elevation_deg) for the points of --points".to_owned(),
        };
        return Err(table.fail(other, format_args!("unknown column; {hint}")));
    }
    let before = into.len();
    while table.advance()? {
        let mut shot = Shot {
            position: table.number(position)?,
            cycle: cycle.map_or(Ok(0), |c| table.count(c))?,
            travel: direction.map_or(Ok(Travel::Forward), |c| table.travel(c))?,
            ids: Vec::with_capacity(columns.len()),
            seen: Vec::with_capacity(columns.len()),
        };
        for (i, c) in columns.iter().filter(|(_, c)| !c.is_empty(&table)) {
            let (measured, covariance) = frame.read(&table, *c)?;
            shot.ids.push(*i);
            shot.seen.push(Seen { platform: points[*i].1, measured, covariance });
        }
        into.push(shot);
    }
    if into.len() == before {
        return Err(Failure::new(EX_DATAERR, format_args!("error: {}: no data rows", path.display())));
    }
    Ok(())
}

/// The points of every row, whatever their names; `names` grows with the files.
pub(super) fn poses(
    path: &Path,
    frame: &Frame,
    names: &mut Vec<String>,
    into: &mut Vec<Vec<Option<Vec3>>>,
) -> Result<(), Failure> {
    let mut table = open(path)?;
    let mut columns: Vec<(usize, Columns)> = Vec::new();
    for column in table.columns() {
        let Some(name) = column.strip_suffix("_x_mm").or_else(|| column.strip_suffix("_range_mm")) else {
            continue;
        };
        let Some(found) = Columns::find(&table, &format!("{name}_")) else { continue };
        let index = names.iter().position(|n| n == name).unwrap_or_else(|| {
            names.push(name.to_owned());
            names.len() - 1
        });
        columns.push((index, found));
    }
    if columns.len() < 2 {
        return Err(Failure::new(
            EX_DATAERR,
            format_args!(
                "error: {}: {} points; rigidity compares distances between points with columns NAME_x_mm, NAME_y_mm, NAME_z_mm (or NAME_range_mm, NAME_azimuth_deg, NAME_elevation_deg)",
                path.display(),
                columns.len()
            ),
        ));
    }
    while table.advance()? {
        let mut pose = vec![None; names.len()];
        for (i, c) in columns.iter().filter(|(_, c)| !c.is_empty(&table)) {
            pose[*i] = Some(frame.place(&table, *c)?);
        }
        into.push(pose);
    }
    Ok(())
}
