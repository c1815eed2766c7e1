//! `volcomp identify threepoint`: laser-tracker points on a carriage to six error motions.

mod plan;
mod read;
mod report;

use super::motion_curves::Origin;
use crate::identify::prelude::*;
use volcomp_identify::motion::{MotionRow, slope, to_relative};
use volcomp_identify::threepoint::{
    Geometry, Observation, PoseErrors, Seen, Series, ThreePointError, TrackerNoise, geometry, sides, solve,
    solve_series,
};
use volcomp_model::geometry::Mat3;

/// Six error motions of a linear axis from three or more points on its carriage, seen by a laser tracker.
///
/// The carriage stands still at positions of its axis, all other axes at home; at each the tracker measures every
/// point. The points move like a rigid body: from three that are not on a line follow displacement and rotation.
#[derive(Debug, clap::Args)]
#[command(after_long_help = include_str!("help.txt"))]
pub(crate) struct Args {
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

/// A case of the reference vectors.
#[derive(Debug, Deserialize)]
struct Case {
    points_platform: Vec<[f64; 3]>,
    platform_origin_nominal: [f64; 3],
    points_measured: Option<Vec<[f64; 3]>>,
    sigma: Option<f64>,
    tracker_origin: Option<[f64; 3]>,
    observations_range_az_el: Option<Vec<[f64; 3]>>,
    sigma_range: Option<f64>,
    sigma_angle: Option<f64>,
}

impl Case {
    fn seen(&self) -> Result<Vec<Seen>, String> {
        let measured: Vec<(Vec3, Mat3)> = match (&self.points_measured, &self.observations_range_az_el) {
            (Some(points), None) => {
                let variance = match self.sigma {
                    None => 1.0,
                    Some(s) if s > 0.0 => s * s,
                    Some(s) => return Err(format!("sigma {s} mm is not above 0")),
                };
                points.iter().map(|p| (Vec3::from(*p), Mat3::identity() * variance)).collect()
            }
            (None, Some(observations)) => {
                let noise = TrackerNoise {
                    range: self.sigma_range.unwrap_or(1.0),
                    range_share: 0.0,
                    angle: self.sigma_angle.unwrap_or(1.0),
                };
                let station = Vec3::from(self.tracker_origin.ok_or("tracker_origin is missing")?);
                let seen = |[range, azimuth, elevation]: &[f64; 3]| {
                    let o = Observation { range: *range, azimuth: *azimuth, elevation: *elevation };
                    (station + o.point(), o.covariance(&noise))
                };
                observations.iter().map(seen).collect()
            }
            _ => return Err("give either points_measured or observations_range_az_el".to_owned()),
        };
        let [seen, known] = [measured.len(), self.points_platform.len()];
        if seen != known {
            return Err(format!(
                "{seen} measured points for {known} platform points; every point needs both"
            ));
        }
        let pairs = self.points_platform.iter().zip(measured);
        let seen =
            pairs.map(|(p, (measured, covariance))| Seen { platform: (*p).into(), measured, covariance });
        Ok(seen.collect())
    }
}

impl Method for Args {
    fn front(&self) -> Front<'_> {
        self.curves.front(&self.case)
    }

    fn of_case(&self, file: CaseFile<'_>) -> Result<Box<dyn Found + '_>> {
        let case: Case = file.read()?;
        let seen = case.seen().map_err(|e| file.bad(e))?;
        let platform: Vec<Vec3> = case.points_platform.iter().map(|p| Vec3::from(*p)).collect();
        match solve(&seen, &Vec3::from(case.platform_origin_nominal)) {
            Ok(pose) => Ok(printed(json_of(&pose), move || print(&pose))),
            Err(e @ (ThreePointError::Deficient { .. } | ThreePointError::IllConditioned { .. }))
                if self.case.json =>
            {
                let g = geometry(&platform);
                let mut known = of_geometry(&g);
                if g.rank == 5 || matches!(e, ThreePointError::IllConditioned { .. }) {
                    known["unobservable_direction"] = json!(g.line.as_slice());
                }
                Ok(refused(known, e))
            }
            Err(e) => Err(file.bad(e)),
        }
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
        follows_the_axis(data, &series, &fit.rows)?;
        fit.scale_by_misfit(frame.noise_is_stated);
        if workpiece_side {
            to_relative(&mut fit.rows);
        }
        let files = [points].into_iter().chain(data).chain(self.tracker.files()).cloned().collect();
        let origin = Origin { axis, reference: self.origin_mm + reference, method: "threepoint", files };
        let gauged = self.curves.gauge(fit.rows.clone(), &origin)?;
        let names = named.into_iter().map(|p| p.0).collect();
        let report = Box::new(report::Threepoint { names, fit, frame, workpiece_side });
        Ok(Some(Box::new(Motions { args: &self.curves, gauged, origin, base, report })))
    }
}

/// Share of the travel that no positioning error reaches.
const NO_ERROR: f64 = 0.01;

/// Refuses points that do not move by what the axis moves: another unit, axis or sign. `rows` hold the carriage's own motion.
fn follows_the_axis(files: &[PathBuf], series: &Series, rows: &[MotionRow]) -> Result<()> {
    let axis = series.axis;
    let slope = slope(rows, axis.direction());
    if slope.abs() <= NO_ERROR {
        return Ok(());
    }
    // of a carriage on the workpiece side the points go the other way
    let moved = if series.workpiece_side { 1.0 - slope } else { 1.0 + slope };
    Err(data_error(
        files,
        format_args!(
            "E{axis}{axis} would grow by {:.4} mm per mm of position_mm (limit {NO_ERROR}): it looks like the position itself. The points \
             move by {moved:.4} mm per mm instead of 1: is --axis {} right, are the coordinates in mm, do they hold the places of the points \
             and not deviations, and does the sign of the chain (--chain) fit?",
            slope.abs(),
            axis.lower()
        ),
    ))
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

fn of_geometry(g: &Geometry) -> Value {
    // infinite numbers become null
    fields!(g; rank, rms_radius, condition_scaled, condition_centroid, roll_growth;
        "singular_values_scaled": g.singular_values)
}

fn json_of(pose: &PoseErrors) -> Value {
    let mut json = of_geometry(&pose.geometry);
    json["E_lsq"] = json!(pose.motion.as_slice());
    json["cov"] = json!(rows(|at| pose.covariance[at]));
    json["cov_diag_sqrt"] = json!(Component::ALL.map(|c| std(pose, c)));
    json["chi2"] = json!(pose.chi2);
    json["dof"] = json!(pose.dof);
    json["p_value"] = json!(pose.p_value);
    json["E_rigid_exact"] = json!(pose.rigid.as_slice());
    json["residuals"] = pose.residuals.iter().map(|r| r.as_slice()).collect();
    json["suspect_point"] = json!(pose.suspect().map(|(i, _)| i + 1));
    json
}

fn std(pose: &PoseErrors, component: Component) -> f64 {
    pose.covariance[(component.index(), component.index())].sqrt()
}

fn print(pose: &PoseErrors) {
    say!("{:<6}{:>14}{:>12}{:>14}", "", "linear", "std (k=1)", "rigid");
    for c in Component::ALL {
        let (i, units) = (c.index(), Units::of_component(c));
        let [linear, std, rigid] = [pose.motion[i], std(pose, c), pose.rigid[i]].map(units.of_value);
        say_text!("E{:<5}{linear:>14.4}{std:>12.4}{rigid:>14.4}  {}", c.letter(), units.value);
    }
    let PoseErrors { chi2, dof, p_value, geometry, .. } = pose;
    let Geometry { condition_scaled, condition_centroid, .. } = geometry;
    say!(
        "rigidity: chi2 {chi2:.2}, {dof} degrees of freedom, p {p_value:.3}; condition {condition_scaled:.1} at the platform origin, {condition_centroid:.1} at the centroid"
    );
    if let Some(warning) = geometry.warning() {
        note!("warning: {warning}");
    }
}
