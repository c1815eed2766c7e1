//! A case of the reference vectors.

use serde::Deserialize;
use serde_json::json;

use crate::Failure;
use crate::identify::case::{CaseFile, refused};
use crate::identify::method::{Found, printed};
use volcomp_identify::ram::{Head, HeadPose, Prior, RamError, RamNoise, solve};
use volcomp_model::geometry::Vec3;

#[derive(Debug, Deserialize)]
struct Case {
    head: CaseHead,
    #[serde(default = "one")]
    sigma_position: f64,
    #[serde(default = "one")]
    sigma_direction: f64,
    poses: Vec<CasePose>,
    prior: Option<CasePrior>,
}

#[derive(Debug, Deserialize)]
#[expect(non_snake_case, reason = "the names of the reference vectors")]
struct CaseHead {
    A_axis_from_Z_reference: [f64; 3],
    tool_length: f64,
}

#[derive(Debug, Deserialize)]
#[expect(non_snake_case, reason = "the names of the reference vectors")]
struct CasePose {
    C: f64,
    A: f64,
    tip_position_error: [f64; 3],
    tool_direction_error: [f64; 3],
}

/// Mean and standard deviations; a missing one (null) is not known.
#[derive(Debug, Deserialize)]
#[expect(non_snake_case, reason = "the names of the reference vectors")]
struct CasePrior {
    E: [f64; 6],
    sigma: [Option<f64>; 6],
}

const fn one() -> f64 {
    1.0
}

pub(super) fn run(file: CaseFile<'_>, as_json: bool) -> Result<Box<dyn Found>, Failure> {
    let case: Case = file.read()?;
    let head =
        Head { a_axis: Vec3::from(case.head.A_axis_from_Z_reference), tool_length: case.head.tool_length };
    let poses: Vec<HeadPose> = case
        .poses
        .iter()
        .map(|p| HeadPose {
            c: p.C,
            a: p.A,
            tip_error: Vec3::from(p.tip_position_error),
            direction_error: Vec3::from(p.tool_direction_error),
        })
        .collect();
    let noise = RamNoise { position: case.sigma_position, direction: case.sigma_direction };
    let prior = case
        .prior
        .map(|p| Prior { mean: p.E.into(), std: p.sigma.map(|s| s.unwrap_or(f64::INFINITY)).into() });
    match solve(&head, &poses, &noise, prior.as_ref()) {
        Ok(fit) => Ok(printed(super::json_of(&fit), move || super::print(&fit))),
        Err(ref e @ RamError::Deficient { rank, ref unobservable, .. }) if as_json => {
            Ok(refused(json!({ "rank": rank, "unobservable": unobservable.as_slice() }), e))
        }
        Err(e) => Err(file.bad(e)),
    }
}
