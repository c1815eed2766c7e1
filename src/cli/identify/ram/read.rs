//! The file of poses, and what the head itself does to them.

use std::path::Path;

use super::Stop;
use crate::files::read_model;
use crate::table::open;
use crate::{EX_CONFIG, EX_DATAERR, Failure};
use volcomp_identify::ram::{Head, HeadPose};
use volcomp_model::Model;
use volcomp_model::geometry::Vec3;
use volcomp_units::axes::{AxisKind, AxisName, Travel};
use volcomp_units::{mm_from_um, rad_from_arcsec, rad_from_deg};

pub(super) fn poses(path: &Path, stops: &mut Vec<Stop>) -> Result<(), Failure> {
    let mut table = open(path)?;
    let (z, cycle, direction) = (table.find("z_mm"), table.find("cycle"), table.find("direction"));
    let (c, a) = (table.require("c_deg")?, table.require("a_deg")?);
    let mut tip = [0; 3];
    let mut axis = [0; 3];
    for (i, letter) in ["x", "y", "z"].into_iter().enumerate() {
        tip[i] = table.require(&format!("tip_{letter}_um"))?;
        axis[i] = table.require(&format!("dir_{letter}_arcsec"))?;
    }
    let mut rows = 0usize;
    while table.advance()? {
        rows += 1;
        let position = z.map_or(Ok(0.0), |z| table.number(z))?;
        let cycle = cycle.map_or(Ok(0), |c| table.count(c))?;
        let travel = direction.map_or(Ok(Travel::Forward), |d| table.travel(d))?;
        let three = |columns: &[usize; 3], unit: fn(f64) -> f64| -> Result<Vec3, Failure> {
            Ok(Vec3::new(
                unit(table.number(columns[0])?),
                unit(table.number(columns[1])?),
                unit(table.number(columns[2])?),
            ))
        };
        let pose = HeadPose {
            c: rad_from_deg(table.number(c)?),
            a: rad_from_deg(table.number(a)?),
            tip_error: three(&tip, mm_from_um)?,
            direction_error: three(&axis, rad_from_arcsec)?,
        };
        match stops
            .iter_mut()
            .find(|s| s.cycle == cycle && s.travel == travel && (s.position - position).abs() < 1e-6)
        {
            Some(stop) => stop.poses.push(pose),
            None => stops.push(Stop { position, cycle, travel, poses: vec![pose] }),
        }
    }
    if rows == 0 {
        return Err(Failure::new(EX_DATAERR, format_args!("error: {}: no data rows", path.display())));
    }
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
