//! A case of the reference vectors.

use serde::Deserialize;
use serde_json::{Value, json};

use crate::Result;
use crate::identify::case::{CaseFile, refused, rows};
use crate::identify::method::{Found, printed};
use crate::units::Units;
use volcomp_identify::threepoint::{
    Geometry, Observation, PoseErrors, Seen, ThreePointError, TrackerNoise, geometry, solve,
};
use volcomp_model::Component;
use volcomp_model::geometry::{Mat3, Vec3};

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

pub(super) fn run(file: CaseFile<'_>, as_json: bool) -> Result<Box<dyn Found>> {
    let case: Case = file.read()?;
    let seen = case.seen().map_err(|e| file.bad(e))?;
    let platform: Vec<Vec3> = case.points_platform.iter().map(|p| Vec3::from(*p)).collect();
    match solve(&seen, &Vec3::from(case.platform_origin_nominal)) {
        Ok(pose) => Ok(printed(json_of(&pose), move || print(&pose))),
        Err(e @ (ThreePointError::Deficient { .. } | ThreePointError::IllConditioned { .. })) if as_json => {
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
                observations
                    .iter()
                    .map(|[range, azimuth, elevation]| {
                        let o = Observation { range: *range, azimuth: *azimuth, elevation: *elevation };
                        (station + o.point(), o.covariance(&noise))
                    })
                    .collect()
            }
            _ => return Err("give either points_measured or observations_range_az_el".to_owned()),
        };
        if measured.len() != self.points_platform.len() {
            return Err(format!(
                "{} measured points for {} platform points; every point needs both",
                measured.len(),
                self.points_platform.len()
            ));
        }
        Ok(self
            .points_platform
            .iter()
            .zip(measured)
            .map(|(p, (measured, covariance))| Seen { platform: Vec3::from(*p), measured, covariance })
            .collect())
    }
}

fn of_geometry(g: &Geometry) -> Value {
    // infinite numbers become null
    json!({
        "rank": g.rank,
        "rms_radius": g.rms_radius,
        "singular_values_scaled": g.singular_values,
        "condition_scaled": g.condition_scaled,
        "condition_centroid": g.condition_centroid,
        "roll_growth": g.roll_growth,
    })
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
        say!("E{:<5}{linear:>14.4}{std:>12.4}{rigid:>14.4}  {}", c.letter(), units.value);
    }
    let (PoseErrors { chi2, dof, p_value, .. }, g) = (pose, &pose.geometry);
    say!(
        "rigidity: chi2 {chi2:.2}, {dof} degrees of freedom, p {p_value:.3}; condition {:.1} at the platform origin, {:.1} at the centroid",
        g.condition_scaled,
        g.condition_centroid
    );
    if let Some(warning) = g.warning() {
        note!("warning: {warning}");
    }
}
