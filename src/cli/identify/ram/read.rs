//! The file of poses, and what the head itself does to them.

use std::path::Path;

use super::Stop;
use crate::files::read_model;
use crate::identify::columns;
use crate::{EX_CONFIG, Failure};
use volcomp_identify::ram::{Head, HeadPose};
use volcomp_model::Model;
use volcomp_units::axes::{AxisKind, AxisName};

pub(super) fn poses(path: &Path, stops: &mut Vec<Stop>) -> Result<(), Failure> {
    let mut table = columns::open(path)?;
    let [z, cycle, direction] = ["z_mm", "cycle", "direction"].map(|name| table.find(name));
    let (c, a) = (table.require("c_deg")?, table.require("a_deg")?);
    let tip = table.three(["tip_x_um", "tip_y_um", "tip_z_um"])?;
    let axis = table.three(["dir_x_arcsec", "dir_y_arcsec", "dir_z_arcsec"])?;
    table.some_rows(|row| {
        let (position, cycle, travel) = (row.value_or(z, 0.0)?, row.count(cycle)?, row.travel(direction)?);
        let pose = HeadPose {
            c: row.value(c)?,
            a: row.value(a)?,
            tip_error: row.point(tip)?,
            direction_error: row.point(axis)?,
        };
        let same = |s: &Stop| s.cycle == cycle && s.travel == travel && (s.position - position).abs() < 1e-6;
        match stops.iter_mut().find(|s| same(s)) {
            Some(stop) => stop.poses.push(pose),
            None => stops.push(Stop { position, cycle, travel, poses: vec![pose] }),
        }
        Ok(())
    })?;
    Ok(())
}

/// Takes off what the rotary axes of a model do: first order, ram at home.
pub(super) fn take_off_head(path: &Path, head: &Head, stops: &mut [Stop]) -> Result<(), Failure> {
    let (mut spec, _) = read_model(path)?;
    spec.errors.retain(|(symbol, _)| symbol.axis().kind() == AxisKind::Rotary);
    let model = Model::new(&spec)
        .map_err(|e| Failure::new(EX_CONFIG, format_args!("error: {}: {e}", path.display())))?;
    for pose in stops.iter_mut().flat_map(|s| &mut s.poses) {
        let of_head = model.deviation(&model.pose_of(&[(AxisName::C, pose.c), (AxisName::A, pose.a)]));
        pose.tip_error -= of_head.position;
        pose.direction_error -= of_head.rotation.cross(&head.at(pose.c, pose.a).0);
    }
    Ok(())
}
