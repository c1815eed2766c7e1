//! What can be wrong with a truth file.

use volcomp_units::axes::{AxisName, MAX_AXES};

use super::chain::ChainError;

/// Why a truth file is refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TruthError {
    /// Not TOML, an unknown key, or a value of the wrong kind; says line and column.
    #[error("truth file: {0}")]
    Toml(#[from] toml::de::Error),
    /// The chain does not parse.
    #[error(transparent)]
    Chain(#[from] ChainError),
    /// Another format.
    #[error("truth file: format {found:?} is not known; this program reads \"volcomp-truth/1\"")]
    Format {
        /// What the file says.
        found: String,
    },
    /// An unknown axis.
    #[error("truth file: unknown axis {name:?}; expected one of X Y Z U V W A B C S")]
    AxisName {
        /// The name.
        name: String,
    },
    /// An axis with two entries.
    #[error("truth file: axis {axis} has two [[axes]] entries")]
    AxisTwice {
        /// The axis.
        axis: AxisName,
    },
    /// An axis of the chain without an entry.
    #[error("truth file: axis {axis} of the chain has no [[axes]] entry")]
    AxisMissing {
        /// The axis.
        axis: AxisName,
    },
    /// An entry that the chain does not have.
    #[error("truth file: axis {axis} has an [[axes]] entry but is not in the chain {chain:?}")]
    AxisNotInChain {
        /// The axis.
        axis: AxisName,
        /// The chain.
        chain: String,
    },
    /// Too many entries.
    #[error("truth file: {count} axes, at most {MAX_AXES} fit on the link")]
    TooManyAxes {
        /// How many.
        count: usize,
    },
    /// A key that must be there.
    #[error("truth file: {place} needs {key}")]
    Missing {
        /// Where.
        place: Place,
        /// The key.
        key: String,
    },
    /// A key that does not belong there.
    #[error("truth file: {place}: unknown key {key:?}; expected {expected}")]
    UnknownKey {
        /// Where.
        place: Place,
        /// The key.
        key: String,
        /// The keys that may stand there.
        expected: String,
    },
    /// A value that is not a finite number (or list of them).
    #[error("truth file: {place}: {key} must be {wanted}")]
    NotANumber {
        /// Where.
        place: Place,
        /// The key.
        key: String,
        /// What is wanted.
        wanted: &'static str,
    },
    /// A number out of its range.
    #[error("truth file: {place}: {key} = {value} is out of range; it must be {limit}")]
    Range {
        /// Where.
        place: Place,
        /// The key.
        key: String,
        /// Its value.
        value: f64,
        /// The condition in words.
        limit: &'static str,
    },
    /// Coordinates that do not rise.
    #[error("truth file: {place}: {key} must rise; {value} (entry {row}) is not above {before}")]
    NotRising {
        /// Where.
        place: Place,
        /// The key.
        key: String,
        /// Entry, counted from 1.
        row: usize,
        /// Its value.
        value: f64,
        /// The value before it.
        before: f64,
    },
    /// Lists of different length.
    #[error("truth file: {place}: {key} has {count} entries, {wanted} are needed")]
    Length {
        /// Where.
        place: Place,
        /// The key.
        key: String,
        /// How many there are.
        count: usize,
        /// How many there must be.
        wanted: usize,
    },
    /// An error symbol that this machine does not have.
    #[error(
        "truth file: {place}: no error motion of an axis of this machine; symbols are like exx, eay, ebc"
    )]
    Symbol {
        /// Where.
        place: Place,
    },
    /// A slope in a straightness.
    #[error("truth file: {place}: the slope of a straightness is squareness; use [squareness]")]
    StraightnessSlope {
        /// Where.
        place: Place,
    },
    /// An error motion beyond belief.
    #[error("truth file: {place} reaches {value:.1} {unit}, more than {limit} {unit}; is the unit right?")]
    TooLarge {
        /// Where.
        place: Place,
        /// Its largest value.
        value: f64,
        /// The limit.
        limit: f64,
        /// Unit of both.
        unit: &'static str,
    },
}

/// A place in a truth file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Place {
    /// An `[[axes]]` entry.
    Axis(AxisName),
    /// A table outside the axes.
    Table(&'static str),
    /// An error symbol.
    Symbol {
        /// The symbol.
        symbol: String,
        /// Line in the file.
        line: usize,
    },
    /// One shape of an error symbol.
    Shape {
        /// The symbol.
        symbol: String,
        /// Line in the file where the list of shapes starts.
        line: usize,
        /// Position in the list, from 1.
        number: usize,
        /// Kind of the shape as written.
        kind: String,
    },
}

impl std::fmt::Display for Place {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Axis(axis) => write!(f, "axis {axis}"),
            Self::Table(table) => write!(f, "[{table}]"),
            Self::Symbol { symbol, line } => write!(f, "{symbol} (line {line})"),
            Self::Shape { symbol, line, number, kind } => {
                write!(f, "{symbol} (line {line}), shape {number} ({kind})")
            }
        }
    }
}
