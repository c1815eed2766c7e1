//! A case of the reference vectors.

use serde::Deserialize;
use serde_json::{Value, json};
use std::collections::BTreeMap;

use crate::Failure;
use crate::identify::case::{CaseFile, refused, rows};
use crate::identify::method::{Found, printed};
use crate::units::Units;
use volcomp_identify::nineline::{LineReading, NineLine, NineLineError, solve};
use volcomp_model::Component;
use volcomp_model::geometry::Vec3;

#[derive(Debug, Deserialize)]
struct Case {
    lines_yz: Vec<[f64; 2]>,
    x_target: f64,
    readings: BTreeMap<String, f64>,
    sigma: Option<f64>,
}

pub(super) fn run(file: CaseFile<'_>, as_json: bool) -> Result<Box<dyn Found>, Failure> {
    let case: Case = file.read()?;
    let readings = case.readings().map_err(|e| file.bad(e))?;
    match solve(&readings) {
        Ok(found) => Ok(printed(json_of(&found, case.sigma.is_some()), move || print(&found))),
        Err(ref e @ NineLineError::Deficient { rank, ref unobservable, .. }) if as_json => {
            Ok(refused(json!({ "rank": rank, "unobservable": unobservable.as_slice() }), e))
        }
        Err(e) => Err(file.bad(e)),
    }
}

impl Case {
    /// `dy2` is the displacement along y on the second line.
    fn readings(&self) -> Result<Vec<LineReading>, String> {
        let sigma = self.sigma.unwrap_or(1.0);
        self.readings
            .iter()
            .map(|(name, value)| {
                let unknown = || {
                    format!(
                        "reading {name}: write dx1, dy1, dz1 for the first of {} lines",
                        self.lines_yz.len()
                    )
                };
                let rest = name.strip_prefix('d').ok_or_else(unknown)?;
                let direction =
                    ["x", "y", "z"].iter().position(|d| rest.starts_with(d)).ok_or_else(unknown)?;
                let line: usize = rest[1..].parse().map_err(|_| unknown())?;
                let [y, z] = line.checked_sub(1).and_then(|i| self.lines_yz.get(i)).ok_or_else(unknown)?;
                Ok(LineReading { target: Vec3::new(self.x_target, *y, *z), direction, value: *value, sigma })
            })
            .collect()
    }
}

fn json_of(found: &NineLine, stated: bool) -> Value {
    // without a stated noise this is the covariance for readings of unit variance
    let covariance = if stated { "cov" } else { "cofactor" };
    json!({
        "E": found.motion.as_slice(),
        "condition_scaled": found.condition_scaled,
        "rank": 6,
        "dof": found.dof,
        "chi2": found.chi2,
        covariance: rows(|at| found.covariance[at]),
    })
}

fn print(found: &NineLine) {
    for c in Component::ALL {
        let units = Units::of_component(c);
        say!("E{}{:>14.4}  {}", c.letter(), (units.of_value)(found.motion[c.index()]), units.value);
    }
    say!("condition {:.1}, {} degrees of freedom", found.condition_scaled, found.dof);
}
