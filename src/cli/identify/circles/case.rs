//! A case of the reference vectors.

use std::path::Path;

use serde::Deserialize;

use crate::cli::identify::case::print_json;
use crate::cli::identify::cases::read_case;
use crate::cli::{EX_DATAERR, Failure};
use crate::core::geometry::Vec3;
use crate::identify::circles::{CirclesInput, solve};

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

pub(super) fn run(path: &Path, id: Option<&str>, as_json: bool) -> Result<(), Failure> {
    let case: Case = read_case(path, id)?;
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
    let found = solve(&input)
        .map_err(|e| Failure::new(EX_DATAERR, format_args!("error: {}: {e}", path.display())))?;
    if as_json {
        print_json(&super::json_of(&found, case.sigma));
    } else {
        super::print(&found, case.sigma.is_some());
    }
    Ok(())
}
