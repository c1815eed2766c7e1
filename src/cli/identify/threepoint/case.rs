//! A case of the reference vectors.

use serde::Deserialize;
use serde_json::{Map, Value, json};

use crate::Failure;
use crate::identify::case::{CaseFile, print_json};
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

pub(super) fn run(file: CaseFile<'_>, as_json: bool) -> Result<(), Failure> {
    let case: Case = file.read()?;
    let seen = case.seen().map_err(|e| file.bad(e))?;
    let platform: Vec<Vec3> = case.points_platform.iter().map(|p| Vec3::from(*p)).collect();
    let geometry = geometry(&platform);
    match solve(&seen, &Vec3::from(case.platform_origin_nominal)) {
        Ok(pose) if as_json => print_json(&json_of(&pose)),
        Ok(pose) => print(&pose),
        // what the points cannot determine is a result, too
        Err(e @ (ThreePointError::Deficient { .. } | ThreePointError::IllConditioned { .. })) if as_json => {
            print_json(&refusal(&geometry, &e));
        }
        Err(e) => return Err(file.bad(e)),
    }
    Ok(())
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

fn of_geometry(g: &Geometry) -> Map<String, Value> {
    let mut map = Map::new();
    map.insert("rank".into(), json!(g.rank));
    map.insert("rms_radius".into(), json!(g.rms_radius));
    map.insert("singular_values_scaled".into(), json!(g.singular_values));
    let finite = |v: f64| v.is_finite().then_some(v);
    map.insert("condition_scaled".into(), json!(finite(g.condition_scaled)));
    map.insert("condition_centroid".into(), json!(finite(g.condition_centroid)));
    map.insert("roll_growth".into(), json!(finite(g.roll_growth)));
    map
}

fn json_of(pose: &PoseErrors) -> Value {
    let mut map = of_geometry(&pose.geometry);
    let rows: Vec<Vec<f64>> = (0..6).map(|i| pose.covariance.row(i).iter().copied().collect()).collect();
    let roots: Vec<f64> = (0..6).map(|i| pose.covariance[(i, i)].sqrt()).collect();
    map.insert("E_lsq".into(), json!(pose.motion.as_slice()));
    map.insert("cov".into(), json!(rows));
    map.insert("cov_diag_sqrt".into(), json!(roots));
    map.insert("chi2".into(), json!(pose.chi2));
    map.insert("dof".into(), json!(pose.dof));
    map.insert("p_value".into(), json!(pose.p_value));
    map.insert("E_rigid_exact".into(), json!(pose.rigid.as_slice()));
    map.insert(
        "residuals".into(),
        json!(pose.residuals.iter().map(|r| r.as_slice().to_vec()).collect::<Vec<_>>()),
    );
    map.insert("suspect_point".into(), json!(pose.suspect().map(|(i, _)| i + 1)));
    Value::Object(map)
}

fn refusal(g: &Geometry, error: &ThreePointError) -> Value {
    let mut map = of_geometry(g);
    if g.rank == 5 || matches!(error, ThreePointError::IllConditioned { .. }) {
        map.insert("unobservable_direction".into(), json!(g.line.as_slice()));
    }
    map.insert("note".into(), json!(error.to_string()));
    map.insert("refused".into(), json!(true));
    Value::Object(map)
}

fn print(pose: &PoseErrors) {
    say!("{:<6}{:>14}{:>12}{:>14}", "", "linear", "std (k=1)", "rigid");
    for c in Component::ALL {
        let i = c.index();
        let show = |v: f64| crate::identify::motion_curves::in_print_units(c, v);
        say!(
            "E{:<5}{:>14.4}{:>12.4}{:>14.4}  {}",
            c.letter(),
            show(pose.motion[i]),
            show(pose.covariance[(i, i)].sqrt()),
            show(pose.rigid[i]),
            if c.is_angle() { "arcsec" } else { "um" }
        );
    }
    say!(
        "rigidity: chi2 {:.2}, {} degrees of freedom, p {:.3}; condition {:.1} at the platform origin, {:.1} at the centroid",
        pose.chi2,
        pose.dof,
        pose.p_value,
        pose.geometry.condition_scaled,
        pose.geometry.condition_centroid
    );
    if let Some(warning) = pose.geometry.warning() {
        note!("warning: {warning}");
    }
}
