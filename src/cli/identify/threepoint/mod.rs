//! `volcomp identify threepoint`: laser-tracker points on a carriage to six error motions.

mod case;
mod plan;
mod read;
mod report;

use std::path::PathBuf;

use super::case::{CaseArgs, CaseFile};
use super::method::{Found, Front, Method, printed};
use super::motion_curves::{CurveArgs, Origin};
use super::tracker_points::{Frame, TrackerArgs};
use crate::Result;
use crate::arg_parsers::{linear_axis, point};
use crate::model_writer::{data_error, default_chain};
use volcomp_identify::motion::to_relative;
use volcomp_identify::threepoint::{Series, sides, solve_series};
use volcomp_model::geometry::Vec3;
use volcomp_units::axes::AxisName;

/// Six error motions of a linear axis from three or more points on its carriage, seen by a laser tracker.
///
/// The carriage stands still at positions of its axis, all other axes at home; at each the tracker measures every
/// point. The points move like a rigid body: from three that are not on a line follow displacement and rotation.
#[derive(Debug, clap::Args)]
#[command(after_long_help = include_str!("help.txt"))]
pub(super) struct Args {
    #[command(flatten)]
    case: CaseArgs,
    /// The measured positions; once per file. - is stdin.
    #[arg(long, value_name = "FILE", conflicts_with = "input")]
    data: Vec<PathBuf>,
    /// The points on the carriage: CSV with point, x_mm, y_mm, z_mm (platform coordinates, home).
    #[arg(long, value_name = "FILE", conflicts_with = "input")]
    points: Option<PathBuf>,
    /// The axis that moved.
    #[arg(long, value_name = "LETTER", value_parser = linear_axis)]
    axis: Option<AxisName>,
    /// Platform origin in M at home; 0,0,0 where --points are in M already.
    #[arg(long, value_name = "X,Y,Z", default_value = "0,0,0", value_parser = point, allow_hyphen_values = true)]
    origin_mm: Vec3,
    /// The carriage point at which ex, ey, ez are stated, in M at home; default: the centroid of the points, where
    /// they do not depend on the angles.
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true)]
    reference_mm: Option<Vec3>,
    /// Only compare the distances between the points over all rows: is it a rigid body, how noisy is the tracker?
    /// Needs neither points file nor axis.
    #[arg(long)]
    rigidity: bool,
    #[command(flatten)]
    plan: plan::PlanArgs,
    #[command(flatten)]
    tracker: TrackerArgs,
    #[command(flatten)]
    curves: CurveArgs,
}

impl Method for Args {
    fn front(&self) -> Front<'_> {
        self.curves.front(&self.case)
    }

    fn of_case(&self, file: CaseFile<'_>) -> Result<Box<dyn Found + '_>> {
        case::run(file, self.case.json)
    }

    fn of_data(&self) -> Result<Option<Box<dyn Found + '_>>> {
        if self.plan.plan {
            return plan::run(self).map(Some);
        }
        let data = self.case.all(&self.data);
        if data.is_empty() {
            return Err(usage!("--input, --data or --plan is missing"));
        }
        let frame = self.tracker.frame()?;
        if self.rigidity {
            return rigidity(data, &frame).map(Some);
        }
        let (Some(points), Some(axis)) = (&self.points, self.axis) else {
            return Err(usage!("--points and --axis are needed (or --rigidity, which needs neither)"));
        };
        let named = read::points(points)?;
        let mut shots = Vec::new();
        for path in data {
            shots.extend(read::shots(path, &named, &frame, &self.tracker)?);
        }
        let base = self.curves.model.base(|| default_chain([axis]))?;
        let centroid = named.iter().map(|p| p.1).sum::<Vec3>() / named.len() as f64;
        let reference = self.reference_mm.map_or(centroid, |r| r - self.origin_mm);
        let workpiece_side = base.spec.is_workpiece_side(axis);
        let series = Series { axis, workpiece_side, origin: self.origin_mm, reference };
        let mut fit = solve_series(&shots, &series).map_err(|e| data_error(data, e))?;
        report::scale_by_misfit(&mut fit, frame.noise_is_stated());
        if workpiece_side {
            to_relative(&mut fit.rows);
        }
        let files = [points].into_iter().chain(data).chain(self.tracker.files()).cloned().collect();
        let origin = Origin { axis, reference: self.origin_mm + reference, method: "threepoint", files };
        let gauged = self.curves.gauge(fit.rows.clone(), &origin)?;
        let names = named.into_iter().map(|p| p.0).collect();
        let report = report::Threepoint { names, fit, frame, workpiece_side };
        Ok(self.curves.motions(gauged, origin, base, report))
    }
}

/// Distances between the points over all rows of all files.
fn rigidity(data: &[PathBuf], frame: &Frame) -> Result<Box<dyn Found>> {
    let (mut poses, mut names) = (Vec::new(), Vec::new());
    for path in data {
        poses.extend(read::poses(path, frame, &mut names)?);
    }
    let Some(sides) = sides(&poses) else {
        return Err(data_error(
            data,
            "no two points were seen together in two rows; rigidity needs at least two of each",
        ));
    };
    let json = report::sides_json(&sides, &names, poses.len());
    Ok(printed(json, move || report::print_sides(&sides, &names, poses.len())))
}
