//! A case of the reference vectors.

use serde::Deserialize;

use crate::Failure;
use crate::identify::case::CaseFile;
use crate::identify::method::{Found, printed};
use volcomp_identify::circles::{CirclesInput, solve};
use volcomp_model::geometry::Vec3;

#[derive(Debug, Deserialize)]
struct Case {
    points_1: Vec<[f64; 3]>,
    points_2: Vec<[f64; 3]>,
    nominal_axis: [f64; 3],
    tip_beyond_centre_2: f64,
    sigma: Option<f64>,
    /// Standard deviation of the offset between the frames of both circles, mm.
    #[serde(default)]
    sigma_registration: f64,
}

pub(super) fn run(file: CaseFile<'_>) -> Result<Box<dyn Found>, Failure> {
    let case: Case = file.read()?;
    let vectors = |points: &[[f64; 3]]| points.iter().map(|p| Vec3::from(*p)).collect::<Vec<_>>();
    let (one, two) = (vectors(&case.points_1), vectors(&case.points_2));
    let input = CirclesInput {
        points_1: &one,
        points_2: &two,
        nominal_axis: Vec3::from(case.nominal_axis),
        tip_beyond_centre_2: case.tip_beyond_centre_2,
        sigma: case.sigma,
        registration: case.sigma_registration,
    };
    let found = solve(&input).map_err(|e| file.bad(e))?;
    let stated = case.sigma.is_some();
    Ok(printed(super::json_of(&found, stated), move || super::print(&found, stated)))
}
