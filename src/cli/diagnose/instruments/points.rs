//! Points measured in the instrument's own frame: positions of the axes, and the coordinates (or range, azimuth and elevation)
//! of a target at the tool tip.
//!
//! The frame stands still relative to the workpiece. It is registered to W by the best rigid motion of each set-up, which the
//! diagnosis refines by its small rotation; deviations are actual - nominal in M (equations 1.1). A tracker's are given along,
//! across and above the beam, because range and angles scatter differently.

use super::{Measurement, Rows};
use crate::prelude::*;
use volcomp_diagnose::session::{Raw, Times};
use volcomp_effects::machine_state::Light;
use volcomp_identify::primitives::procrustes;
use volcomp_identify::threepoint::Observation;
use volcomp_model::Pose;
use volcomp_model::geometry::Mat3;
use volcomp_units::RAD_PER_DEG;

const CARTESIAN: [&str; 3] = ["measured_x_mm", "measured_y_mm", "measured_z_mm"];
const SPHERICAL: [&str; 3] = ["measured_range_mm", "measured_azimuth_deg", "measured_elevation_deg"];
/// Positions of the axes of a machine without rotary axes under another name.
const NOMINAL: [&str; 3] = ["nominal_x_mm", "nominal_y_mm", "nominal_z_mm"];
/// Instrument where the file names none.
const TRACKER: &str = "tracker";
/// Columns of every reading that the points state or that are counted, and those that are computed.
const COUNTED: [&str; 5] = ["t_s", "setup", "run", "repeat", "moving"];
const COMPUTED: [&str; 8] =
    ["u_x", "u_y", "u_z", "deviation_um", "station_x_mm", "station_y_mm", "station_z_mm", "range_mm"];
/// Deviation beyond which a point is not that of its positions, mm.
const FOREIGN_MM: f64 = 5.0;
/// Share of the beam's direction below which it stands upright and has no direction across.
const UPRIGHT: f64 = 1e-6;

/// True for the columns of such a file, complete or not: positions of axes, and something measured that is no deviation.
pub(super) fn is_list(header: &[&str]) -> bool {
    let has = |name: &str| header.contains(&name);
    let positions = AxisName::ALL.iter().any(|a| has(&column_of(*a))) || NOMINAL.iter().all(|n| has(n));
    positions && header.iter().any(|c| c.starts_with("measured_")) && !has("u_x") && !has("deviation_um")
}

fn column_of(axis: AxisName) -> String {
    format!("{}_{}", axis.lower(), position_unit(axis))
}

/// Where the tool tip nominally is at a row.
struct Nominal {
    /// In W, mm.
    in_w: Vec3,
    /// In M, mm.
    in_m: Vec3,
    /// From M to W.
    bed: Mat3,
}

/// The points of one set-up.
#[derive(Default)]
struct Setup {
    /// Rows with a point.
    rows: Vec<usize>,
    /// Position at the beginning of the repetition, whether it was left since, and the number of the repetition.
    begin: Option<(Vec3, bool)>,
    repeat: f64,
}

/// Reads the points; `model` places the tool tip.
pub(super) fn read(path: &Path, model: Option<&Model>) -> Result<Measurement> {
    let mut table = table::open(path)?;
    let mut raw = super::super::input::read(&mut table)?;
    for (name, axis) in NOMINAL.iter().zip(["x_mm", "y_mm", "z_mm"]) {
        if raw.column(axis).is_none()
            && let Some(at) = raw.names.iter().position(|n| n == name)
        {
            raw.names[at] = axis.to_owned();
        }
    }
    if table.find("instrument").is_none() {
        raw.instruments.fill(TRACKER.to_owned());
    }
    let measured = measured(&raw)?;
    let nominal: Vec<Nominal> = (0..raw.len()).map(|i| nominal(&raw, i, model)).collect::<Result<_>>()?;
    let mut setups: BTreeMap<i64, Setup> = BTreeMap::new();
    let mut repeats = Vec::with_capacity(raw.len());
    for (i, (point, at)) in measured.iter().zip(&nominal).enumerate() {
        let setup = setups.entry(value(&raw, "setup", i, 1.0) as i64).or_default();
        repeats.push(setup.repetition(at.in_w));
        if point.is_some() {
            setup.rows.push(i);
        }
    }
    let kept: Vec<usize> = (0..raw.names.len()).filter(|c| is_kept(&raw.names[*c])).collect();
    let names = COUNTED.iter().chain(&COMPUTED).map(|n| (*n).to_owned());
    let mut rows = Rows::new(path, names.chain(kept.iter().map(|c| raw.names[*c].clone())));
    let mut registered: Vec<Option<([Reading; 3], Vec3)>> = vec![None; raw.len()];
    let mut notes = Vec::new();
    for (number, setup) in &setups {
        notes.push(setup.register(*number, &raw, &measured, &nominal, &mut registered)?);
    }
    for (i, found) in registered.iter().enumerate() {
        let Some((readings, station)) = found else { continue };
        let counted = [i as f64, 1.0, repeats[i], repeats[i], 0.0];
        let counted: [f64; 5] = std::array::from_fn(|c| value(&raw, COUNTED[c], i, counted[c]));
        for reading in readings {
            let mut row = counted.to_vec();
            row.extend([reading.u.x, reading.u.y, reading.u.z, reading.deviation_um]);
            row.extend([station.x, station.y, station.z, reading.range_mm]);
            row.extend(kept.iter().map(|c| raw.columns[*c][i]));
            rows.push(raw.lines[i], &reading.instrument, &row);
        }
    }
    let times = if raw.column("t_s").is_some() { None } else { Some(Times::Ordinal) };
    let mut found = Measurement::new(rows, Times::Ordinal, "points measured in the frame of the instrument");
    found.raw.times = times;
    let points = counted(raw.len(), "point");
    found.note(format!("{points}; target at the tool tip, instrument at rest relative to the workpiece"));
    found.notes.extend(notes);
    if raw.column("repeat").is_none() && setups.values().any(|s| s.repeat > 1.0) {
        found.note("repetitions counted where the first position returns; a column repeat states them");
    }
    Ok(found)
}

/// Columns that go into the session as they are.
fn is_kept(name: &str) -> bool {
    !(COUNTED.contains(&name)
        || COMPUTED.contains(&name)
        || CARTESIAN.contains(&name)
        || SPHERICAL.contains(&name)
        || NOMINAL.contains(&name))
}

/// Value of a column of numbers at a row; `otherwise` without the column or where it is empty.
fn value(raw: &Raw, name: &str, row: usize, otherwise: f64) -> f64 {
    raw.column(name).map(|c| c[row]).filter(|v| !v.is_nan()).unwrap_or(otherwise)
}

/// The points in the frame of the instrument, mm; none where nothing was measured.
fn measured(raw: &Raw) -> Result<Vec<Option<Vec3>>> {
    let has = |names: [&str; 3]| names.iter().all(|n| raw.column(n).is_some());
    let is_cartesian = has(CARTESIAN);
    let names = if is_cartesian { CARTESIAN } else { SPHERICAL };
    if !has(names) {
        let [one, other] = [CARTESIAN, SPHERICAL].map(|names| names.join(", "));
        let what = format!("points in the frame of an instrument have the columns {one} or {other}");
        return Err(Failure::data(&raw.file, what));
    }
    let at = |i: usize| {
        let values = names.map(|n| value(raw, n, i, f64::NAN));
        match values.iter().filter(|v| v.is_nan()).count() {
            3 => Ok(None),
            0 if is_cartesian => Ok(Some(Vec3::from(values))),
            0 => {
                let [range, azimuth, elevation] = values;
                let (azimuth, elevation) = (azimuth * RAD_PER_DEG, elevation * RAD_PER_DEG);
                Ok(Some(Observation { range, azimuth, elevation }.point()))
            }
            _ => {
                let (line, all) = (format!("{}:{}", raw.file, raw.lines[i]), names.join(", "));
                Err(data!(line, "a point is whole: all of {all} or none"))
            }
        }
    };
    (0..raw.len()).map(at).collect()
}

fn nominal(raw: &Raw, row: usize, model: Option<&Model>) -> Result<Nominal> {
    let mut coordinates = Vec::with_capacity(3);
    for axis in AxisName::ALL {
        let name = column_of(axis);
        let Some(column) = raw.column(&name) else { continue };
        let at = column[row];
        if at.is_nan() {
            let line = format!("{}:{}", raw.file, raw.lines[row]);
            return Err(data!(line, "{name} is empty; a point needs the positions of all axes"));
        }
        coordinates.push((axis, if axis.kind() == AxisKind::Linear { at } else { at * RAD_PER_DEG }));
    }
    let Some(model) = model else {
        let turning = coordinates.iter().find(|(a, _)| a.kind() == AxisKind::Rotary);
        if let Some((axis, _)) = turning {
            let what = "turns, and nothing says where it stands in the chain; give the model with --model";
            return Err(data!(raw.file, "axis {axis} {what}"));
        }
        let tip = Vec3::from(["x", "y", "z"].map(|a| value(raw, &format!("{a}_mm"), row, 0.0)));
        return Ok(Nominal { in_w: tip, in_m: tip, bed: Mat3::identity() });
    };
    let long = value(raw, "tool_length_mm", row, f64::NAN);
    let tool_tip = Some(long).filter(|l| !l.is_nan()).and_then(|l| model.tool_tip_for_length(l));
    let tool = model.nominal_tool(&Pose { tool_tip, ..model.pose_of(&coordinates) });
    // without the turn of the table W is M at home
    let turns_table = |a: AxisName| {
        model.axes().any(|b| b.name == a && b.side == Side::Workpiece && a.kind() == AxisKind::Rotary)
    };
    coordinates.retain(|(a, _)| !turns_table(*a));
    let still = model.nominal_tool(&Pose { tool_tip, ..model.pose_of(&coordinates) });
    Ok(Nominal { in_w: tool.tip, in_m: still.tip + model.workpiece_origin(), bed: tool.bed })
}

/// One direction of a point.
#[derive(Debug, Clone)]
struct Reading {
    instrument: String,
    /// In M.
    u: Vec3,
    deviation_um: f64,
    range_mm: f64,
}

impl Setup {
    /// The repetition of a row at a nominal position: a new one begins where the first position returns.
    fn repetition(&mut self, at: Vec3) -> f64 {
        let is_first = |p: Vec3| (p - at).norm() < 1e-6;
        match &mut self.begin {
            Some((first, left)) if is_first(*first) && *left => {
                (*left, self.repeat) = (false, self.repeat + 1.0);
            }
            Some((first, left)) => *left |= !is_first(*first),
            None => (self.begin, self.repeat) = (Some((at, false)), 1.0),
        }
        self.repeat
    }

    /// Registers the instrument's frame to W and turns its points into readings with the place of the station, both in M.
    fn register(
        &self,
        number: i64,
        raw: &Raw,
        measured: &[Option<Vec3>],
        nominal: &[Nominal],
        out: &mut [Option<([Reading; 3], Vec3)>],
    ) -> Result<String> {
        let from: Vec<Vec3> = self.rows.iter().filter_map(|i| measured[*i]).collect();
        let to: Vec<Vec3> = self.rows.iter().map(|i| nominal[*i].in_w).collect();
        let (rotation, translation) = procrustes(&from, &to).ok_or_else(|| {
            data!(
                raw.file,
                "set-up {number}: its {} do not determine the frame of the instrument: at least three positions off one line are \
                 needed; measure more, or give deviations along known directions as a session file",
                counted(from.len(), "point")
            )
        })?;
        let station = translation;
        let up = rotation * Vec3::z();
        let mut square_mm2 = 0.0;
        let mut worst = (0.0, 0);
        for (i, q) in self.rows.iter().zip(&from) {
            let at = &nominal[*i];
            let deviation = rotation * q + translation - at.in_w;
            let size = deviation.norm();
            square_mm2 += size * size;
            if size > worst.0 {
                worst = (size, *i);
            }
            let to_m = at.bed.transpose();
            let beam = at.in_w - station;
            let name = &raw.instruments[*i];
            let is_tracker = Light::of(name) == Some(Light::Tracker);
            let (directions, suffix) = if is_tracker {
                (beam_frame(&beam, &up), [" range", " angle", " angle"])
            } else {
                ([at.bed * Vec3::x(), at.bed * Vec3::y(), at.bed * Vec3::z()], [""; 3])
            };
            let readings = std::array::from_fn(|k| Reading {
                instrument: format!("{name}{}", suffix[k]),
                u: to_m * directions[k],
                deviation_um: um_from_mm(deviation.dot(&directions[k])),
                range_mm: if is_tracker { q.norm() } else { f64::NAN },
            });
            let place = if is_tracker { at.in_m - to_m * beam } else { Vec3::repeat(f64::NAN) };
            out[*i] = Some((readings, place));
        }
        if worst.0 > FOREIGN_MM {
            return Err(data!(
                format!("{}:{}", raw.file, raw.lines[worst.1]),
                "the measured point is {:.1} mm from the nominal one after the best rigid motion of set-up {number}, limit {FOREIGN_MM} mm: \
                 are the columns the positions of the axes at that point, in mm, the coordinates of a right-handed frame that stands still \
                 relative to the workpiece, and the chain that of the machine?",
                worst.0
            ));
        }
        let rms_um = um_from_mm((square_mm2 / self.rows.len() as f64).sqrt());
        // no negative zeros
        let [x, y, z]: [f64; 3] = station.map(|v| (10.0 * v).round() / 10.0 + 0.0).into();
        Ok(format!(
            "set-up {number}: {}, origin of the instrument's frame at ({x:.1}, {y:.1}, {z:.1}) mm in W by the best rigid motion, after which \
             {rms_um:.1} µm RMS are left",
            counted(self.rows.len(), "point"),
        ))
    }
}

/// Along the beam, across it in the horizontal plane of the tracker, and above it; unit vectors in the frame of `beam`.
fn beam_frame(beam: &Vec3, up: &Vec3) -> [Vec3; 3] {
    let along = beam.normalize();
    let across = up.cross(&along);
    let across =
        if across.norm() > UPRIGHT { across } else { along.cross(&Vec3::x()) + along.cross(&Vec3::y()) };
    let across = across.normalize();
    [along, across, along.cross(&across)]
}
