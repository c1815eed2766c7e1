//! Why sources do not make a model, with the numbers and what to do.

use super::Check;
use crate::prelude::*;
use volcomp_model::{Chain, ModelError};
use volcomp_units::{arcsec_from_rad, um_from_mm};

/// Why sources do not make a model.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum AssembleError {
    /// Nothing to assemble.
    #[error("no source states an error")]
    Empty,
    /// Chains differ.
    #[error(
        "{source_name}: chain {found}, but {expected} is assembled; give all files the chain of the machine"
    )]
    Chain {
        /// The source.
        source_name: String,
        /// Its chain.
        found: Chain,
        /// The chain of the result.
        expected: Chain,
    },
    /// Machines differ.
    #[error("{source_name}: machine {found}, but {expected} is assembled")]
    Machine {
        /// The source.
        source_name: String,
        /// Its machine.
        found: String,
        /// The machine of the result.
        expected: String,
    },
    /// Points on rotary axes differ.
    #[error("{source_name}: axis {axis} turns about ({:.3}, {:.3}, {:.3}) mm, elsewhere about ({:.3}, {:.3}, {:.3}); its errors act at that point: give all files the same point-mm", found.x, found.y, found.z, expected.x, expected.y, expected.z)]
    AxisPoint {
        /// The source.
        source_name: String,
        /// The axis.
        axis: AxisName,
        /// Its point there.
        found: Vec3,
        /// The point of the result.
        expected: Vec3,
    },
    /// A sensor tells values in the other sense.
    #[error(
        "{source_name}: a sensor tells an error of axis {axis} in the other sense than the result is stored in; give both files the same sense"
    )]
    LiveSense {
        /// The source.
        source_name: String,
        /// The axis.
        axis: AxisName,
    },
    /// A source, or the result, breaks a rule of models.
    #[error("{source_name}: {error}")]
    Model {
        /// The source.
        source_name: String,
        /// The rule.
        error: ModelError,
    },
    /// Reference points differ and no source states the angle that ties them together.
    #[error(
        "{symbol} of {source_name} was measured {lever_mm:.1} mm away from the other source in a direction in which {angle} acts, and no source states {angle}; measure it, or prefer one source"
    )]
    NoAngle {
        /// The error.
        symbol: ErrorSymbol,
        /// The source.
        source_name: String,
        /// The angle that is missing.
        angle: ErrorSymbol,
        /// The lever.
        lever_mm: f64,
    },
    /// Nothing ties two ranges together.
    #[error(
        "{symbol}: {first} and {second} have no range in common, so that nothing says how they continue each other; measure an overlap, or prefer one"
    )]
    Disjoint {
        /// The error.
        symbol: ErrorSymbol,
        /// One source.
        first: String,
        /// The other.
        second: String,
    },
    /// Grids and live values are not compared.
    #[error(
        "{symbol} of {source_name} has a grid or a sensor and is stated by others, too; prefer one source"
    )]
    NotComparable {
        /// The error.
        symbol: ErrorSymbol,
        /// The source.
        source_name: String,
    },
    /// Different numbers without uncertainties.
    #[error("{symbol}: {first} and {second} differ by up to {} and not both state an uncertainty, so that nothing says whether that matters; state std-um or std-arcsec, assume one, prefer one source or ask for the mean", size(*symbol, *largest))]
    Untested {
        /// The error.
        symbol: ErrorSymbol,
        /// One source.
        first: String,
        /// The other.
        second: String,
        /// Largest difference, mm or rad.
        largest: f64,
    },
    /// Sources that contradict each other.
    #[error("{}", inconsistent(.checks, .names))]
    Inconsistent {
        /// The comparisons that failed.
        checks: Vec<Check>,
        /// Names of all sources.
        names: Vec<String>,
    },
}

fn size(symbol: ErrorSymbol, v: f64) -> String {
    if symbol.is_angle() {
        format!("{:.2} arcsec", arcsec_from_rad(v.abs()))
    } else {
        format!("{:.2} um", um_from_mm(v.abs()))
    }
}

fn probability(p: f64) -> String {
    if p < 1e-99 { "< 1e-99".to_owned() } else { format!("= {p:.1e}") }
}

fn inconsistent(checks: &[Check], names: &[String]) -> String {
    let line = |c: &Check| {
        let [a, b] = c.sources.map(|i| names.get(i).map_or("", String::as_str));
        let std = c
            .std
            .map_or(String::new(), |s| format!(" where u (k=1) of a difference is {}", size(c.symbol, s)));
        format!(
            "{}: {a} and {b} differ by up to {}{std} (chi2 {:.1} for {} degrees of freedom, p {})",
            c.symbol,
            size(c.symbol, c.largest),
            c.chi_square.unwrap_or(0.0),
            c.dof,
            probability(c.p.unwrap_or(1.0))
        )
    };
    let lines: Vec<String> = checks.iter().map(line).collect();
    format!("sources contradict each other; prefer one, or ask for the mean\n  {}", lines.join("\n  "))
}
