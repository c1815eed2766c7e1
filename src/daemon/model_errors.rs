//! Which error motions, axis-to-axis and location errors a model covers.

use super::status::ModelErrors;
use volcomp_model::{ErrorSymbol, ModelSpec};

/// What a model covers of what its chain has.
pub(super) fn model_errors(spec: &ModelSpec) -> ModelErrors {
    let mut symbols: Vec<ErrorSymbol> = Vec::new();
    for (symbol, _) in &spec.errors {
        if !symbols.contains(symbol) {
            symbols.push(*symbol);
        }
    }
    let possible = spec.chain.error_symbols();
    let covered = possible.iter().filter(|symbol| symbols.contains(symbol)).count();
    let symbols = symbols.iter().map(ErrorSymbol::to_string).collect();
    ModelErrors { symbols, covered, possible: possible.len() }
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
