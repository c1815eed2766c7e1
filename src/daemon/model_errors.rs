//! Which error motions, axis-to-axis and location errors a model covers.

use super::status::ModelErrors;
use volcomp_model::{ErrorSymbol, ModelSpec};
use volcomp_units::axes::{AxisKind, AxisName};

/// Error motions of one axis.
const MOTIONS: usize = 6;
/// Location errors of a rotary axis.
const LOCATIONS: usize = 4;

/// What a model covers of what its chain has.
pub(super) fn model_errors(spec: &ModelSpec) -> ModelErrors {
    let axes: Vec<AxisName> =
        spec.chain.axes().iter().filter(|axis| !axis.spindle).map(|axis| axis.name).collect();
    let has = |name| axes.contains(&name);
    let squarenesses = [(AxisName::X, AxisName::Y), (AxisName::X, AxisName::Z), (AxisName::Y, AxisName::Z)];
    let pairs = squarenesses.iter().filter(|(a, b)| has(*a) && has(*b)).count();
    let rotary = axes.iter().filter(|axis| axis.kind() == AxisKind::Rotary).count();
    let possible = MOTIONS * axes.len() + pairs + LOCATIONS * rotary;
    let mut found: Vec<ErrorSymbol> = Vec::new();
    for (symbol, _) in &spec.errors {
        if !found.contains(symbol) {
            found.push(*symbol);
        }
    }
    // the zero offset of a rotary axis (EC0C) and errors of the spindle are not among those counted
    let counted = |symbol: &&ErrorSymbol| match symbol {
        ErrorSymbol::Motion { axis, .. } => has(*axis),
        ErrorSymbol::Squareness { .. } => true,
        ErrorSymbol::Location { component, axis } => component.index() != 3 + axis.direction(),
    };
    let covered = found.iter().filter(counted).count().min(possible);
    ModelErrors { symbols: found.iter().map(ErrorSymbol::to_string).collect(), covered, possible }
}

#[cfg(test)]
mod tests {
    use super::*;
    use volcomp_config::model;

    fn of(chain: &str, errors: &str) -> (usize, usize) {
        let text = format!("format = \"volcomp-model/1\"\nmachine = \"m\"\nchain = \"{chain}\"\n{errors}");
        let spec = model::parse("m.toml", &text).expect("a model");
        let ModelErrors { covered, possible, .. } = model_errors(&spec);
        (covered, possible)
    }

    #[test]
    fn a_three_axis_machine_has_21_and_a_five_axis_machine_41() {
        let constant = |symbol: &str| format!("[errors.{symbol}.constant]\nvalue-um = 1.0\n");
        assert_eq!(of("[w X' b Y Z t]", ""), (0, 21));
        assert_eq!(of("[w X' b Y Z t]", &(constant("exx") + &constant("eyx"))), (2, 21));
        let points = "[axes.c]\npoint-mm = [0.0, 0.0, 0.0]\n[axes.a]\npoint-mm = [0.0, 0.0, 0.0]\n";
        assert_eq!(of("[w C' A' X' b Y Z t]", &(constant("ex0c") + points)), (1, 41));
    }
}
