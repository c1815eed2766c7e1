//! What can be wrong with a file of an instrument or a control, and where.

use core::fmt;

use volcomp_model::curve::CurveError;

/// Where a mistake stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Place {
    /// The file as a whole.
    File,
    /// 1-based line and column, in characters.
    Text {
        /// 1-based line.
        line: usize,
        /// 1-based column, in characters.
        column: usize,
    },
    /// Offset from the beginning of a binary file.
    Byte(u64),
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::File => Ok(()),
            Self::Text { line, column } => write!(f, "{line}:{column}"),
            Self::Byte(offset) => write!(f, "byte {offset}"),
        }
    }
}

/// A mistake with its place.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{}{kind}", Prefix(*.place))]
pub struct FormatError {
    /// Where.
    pub place: Place,
    /// What.
    pub kind: FormatErrorKind,
}

/// A place in front of a message.
struct Prefix(Place);

impl fmt::Display for Prefix {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            Place::File => Ok(()),
            place => write!(f, "{place}: "),
        }
    }
}

impl FormatError {
    /// A mistake of the file as a whole.
    #[must_use]
    pub const fn of_file(kind: FormatErrorKind) -> Self {
        Self { place: Place::File, kind }
    }

    /// A mistake at a line and column.
    #[must_use]
    pub const fn at(line: usize, column: usize, kind: FormatErrorKind) -> Self {
        Self { place: Place::Text { line, column }, kind }
    }

    /// Something is missing at a line.
    pub(super) const fn missing(line: usize, what: &'static str, remedy: &'static str) -> Self {
        Self::at(line, 1, FormatErrorKind::Missing { what, remedy })
    }
}

/// What is wrong.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FormatErrorKind {
    /// Something else stands where it must not.
    #[error("found '{found}', expected {expected}")]
    Expected {
        /// What should stand there.
        expected: &'static str,
        /// What stands there, shortened.
        found: String,
    },
    /// Not a number that can be measured.
    #[error("'{text}' is not a finite number up to 1e30; {what} is expected")]
    Number {
        /// What stands there, shortened.
        text: String,
        /// The quantity.
        what: &'static str,
    },
    /// An error of a machine that is none.
    #[error(
        "{value} is larger than any error of a machine ({limit} {unit}); is it a position, or in another unit?"
    )]
    TooLarge {
        /// The value found, in `unit`.
        value: f64,
        /// Largest size.
        limit: f64,
        /// mm or mrad.
        unit: &'static str,
    },
    /// A number outside of what is possible.
    #[error("{what} is {value}; it must be from {low} to {high}")]
    Range {
        /// The quantity.
        what: &'static str,
        /// The value found.
        value: f64,
        /// Lowest.
        low: f64,
        /// Highest.
        high: f64,
    },
    /// Something that must be there is not.
    #[error("{what} is missing; {remedy}")]
    Missing {
        /// What.
        what: &'static str,
        /// What to do.
        remedy: &'static str,
    },
    /// The same entry again.
    #[error("{what} was given before, on line {first}; remove one")]
    Twice {
        /// The entry.
        what: String,
        /// Line of the first.
        first: usize,
    },
    /// Counts that differ from what the file announces.
    #[error("{what}: {announced} announced, {found} found; the file is cut or the count wrong")]
    Count {
        /// What is counted.
        what: &'static str,
        /// The number announced.
        announced: u64,
        /// The number found.
        found: u64,
    },
    /// A row with more fields than the header has columns.
    #[error("{found} fields, the header has {columns} columns; is there a decimal comma?")]
    Surplus {
        /// Columns of the header.
        columns: usize,
        /// Fields of the row.
        found: usize,
    },
    /// A column that is not the difference of two others.
    #[error(
        "measured minus nominal is {difference:.3} mm, the error column says {stated:.3} mm; are the columns in order?"
    )]
    Contradiction {
        /// From the places, mm.
        difference: f64,
        /// From the error column, mm.
        stated: f64,
    },
    /// More entries than the format or this program allows.
    #[error("{what}: {found} found, the limit is {limit}")]
    TooMany {
        /// What is counted.
        what: &'static str,
        /// The number found.
        found: usize,
        /// Most allowed.
        limit: usize,
    },
    /// Positions that must increase do not.
    #[error("position {value} is not above {previous}, the one before it; sort the rows by position")]
    NotIncreasing {
        /// The position.
        value: f64,
        /// The one before it.
        previous: f64,
    },
    /// Positions that must be equally spaced are not.
    #[error("position {value} breaks the equal spacing of {spacing}; the format needs equidistant positions")]
    NotEquidistant {
        /// The position.
        value: f64,
        /// The spacing up to it.
        spacing: f64,
    },
    /// Something that exists in the format but whose meaning is not documented, or that this program cannot hold.
    #[error("{name} is not read: {why}")]
    NotRead {
        /// What.
        name: String,
        /// Why, and what to do.
        why: &'static str,
    },
    /// A unit or word that has to be stated by the user, because the file does not say it.
    #[error("the file does not say {what}; {remedy}")]
    NotStated {
        /// What.
        what: &'static str,
        /// How to state it.
        remedy: &'static str,
    },
    /// Broken JSON or XML.
    #[error("{message}")]
    Syntax {
        /// What the reader of the language says.
        message: String,
    },
    /// Numbers that make no curve.
    #[error("{0}")]
    Curve(#[from] CurveError),
    /// A character that the encoding does not have.
    #[error("the file is not {encoding} text; name its encoding")]
    Encoding {
        /// The encoding tried.
        encoding: &'static str,
    },
    /// A line that no text file has.
    #[error("the line has more than {limit} bytes; is this a text file?")]
    LineTooLong {
        /// Most bytes accepted.
        limit: usize,
    },
}

/// A mistake in the data or a failure of the source they come from.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// The source failed.
    #[error("{0}")]
    Io(#[from] std::io::Error),
    /// The data are wrong.
    #[error("{0}")]
    Format(#[from] FormatError),
}

/// At most 40 characters of a text, for messages.
pub(super) fn short(text: &str) -> String {
    text.trim().chars().filter(|c| !c.is_control()).take(40).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_start_with_the_place() {
        let kind = || FormatErrorKind::Number { text: "1,5".into(), what: "a target in mm" };
        assert_eq!(
            FormatError::at(12, 3, kind()).to_string(),
            "12:3: '1,5' is not a finite number up to 1e30; a target in mm is expected"
        );
        let missing = FormatErrorKind::Missing { what: "DEVIATIONS::", remedy: "is the file cut?" };
        assert_eq!(FormatError::of_file(missing).to_string(), "DEVIATIONS:: is missing; is the file cut?");
        let e = FormatError { place: Place::Byte(812), kind: kind() };
        assert!(e.to_string().starts_with("byte 812: "));
    }
}
