//! The kinematic chain, written from the workpiece through the bed to the tool: `[w X' b Y Z (S) t]`.

use core::fmt;

use crate::prelude::*;

/// On which side of the bed an axis sits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// Between workpiece and bed; written with a prime.
    Workpiece,
    /// Between bed and tool.
    Tool,
}

/// One axis of a chain.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ChainAxis {
    /// Its letter.
    pub name: AxisName,
    /// Its side of the bed.
    pub side: Side,
    /// Written in parentheses: turns, but is never corrected.
    pub spindle: bool,
}

/// A parsed chain: the axes in string order, without `w`, `b`, `t`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Chain {
    axes: Vec<ChainAxis>,
}

/// What is wrong with a chain, and in which column (1-based, in characters) of the text.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("column {column}: {kind}")]
pub struct ChainError {
    /// 1-based column of the first offending character.
    pub column: usize,
    /// What is wrong.
    pub kind: ChainErrorKind,
}

/// What is wrong with a chain.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum ChainErrorKind {
    /// No brackets around it.
    #[error("a chain stands in brackets, for example [w X' b Y Z t]")]
    NoBrackets,
    /// Does not start at the workpiece.
    #[error("a chain starts with w, the workpiece")]
    NoWorkpiece,
    /// Does not end at the tool.
    #[error("a chain ends with t, the tool")]
    NoTool,
    /// The bed is missing.
    #[error("the bed b is missing; it separates workpiece-side axes (with prime) from tool-side axes")]
    NoBed,
    /// The bed occurs twice.
    #[error("the bed b occurs twice")]
    BedTwice,
    /// An unknown axis.
    #[error("unknown axis '{letter}'; expected one of X Y Z U V W A B C and the spindle (S)")]
    UnknownAxis {
        /// Its first character.
        letter: char,
    },
    /// The same axis again.
    #[error("axis {axis} occurs twice")]
    AxisTwice {
        /// The axis.
        axis: AxisName,
    },
    /// A prime on the tool side.
    #[error(
        "axis {axis} has a prime but stands after the bed; primed axes carry the workpiece and stand between w and b"
    )]
    PrimeOnToolSide {
        /// The axis.
        axis: AxisName,
    },
    /// No prime on the workpiece side.
    #[error("axis {axis} stands between w and b and so carries the workpiece: write {axis}'")]
    PrimeMissing {
        /// The axis.
        axis: AxisName,
    },
    /// A spindle without parentheses, or parentheses around something else.
    #[error("the spindle S stands in parentheses, (S), and nothing else does")]
    SpindleParentheses,
    /// The spindle is not next to the tool.
    #[error("the spindle (S) is the last axis before the tool t")]
    SpindleNotLast,
    /// No axis at all.
    #[error("the chain has no axis")]
    NoAxis,
    /// More axes than the link carries.
    #[error("the chain has more than {limit} axes", limit = MAX_AXES)]
    TooManyAxes,
}

impl Chain {
    /// Reads a chain.
    ///
    /// # Errors
    /// The first thing that is wrong, with its column.
    pub fn parse(text: &str) -> Result<Self, ChainError> {
        let fail = |column, kind| Err(ChainError { column, kind });
        let words = words(text)?;
        let end_column = text.chars().count();
        match words.first() {
            Some((_, "w")) => {}
            Some((column, _)) => return fail(*column, ChainErrorKind::NoWorkpiece),
            None => return fail(end_column, ChainErrorKind::NoWorkpiece),
        }
        let (inner, last) = words[1..].split_at(words.len().saturating_sub(2));
        match last.first() {
            Some((_, "t")) => {}
            Some((column, _)) => return fail(*column, ChainErrorKind::NoTool),
            None => return fail(end_column, ChainErrorKind::NoTool),
        }
        let has_bed = inner.iter().any(|(_, w)| *w == "b");
        let mut axes: Vec<ChainAxis> = Vec::new();
        let mut side = Side::Workpiece;
        for &(column, word) in inner {
            if word == "b" {
                if side == Side::Tool {
                    return fail(column, ChainErrorKind::BedTwice);
                }
                side = Side::Tool;
                continue;
            }
            let axis = ChainAxis::parse(word, side, has_bed).map_err(|kind| ChainError { column, kind })?;
            if axes.iter().any(|a| a.name == axis.name) {
                return fail(column, ChainErrorKind::AxisTwice { axis: axis.name });
            }
            if axes.last().is_some_and(|a| a.spindle) {
                return fail(column, ChainErrorKind::SpindleNotLast);
            }
            if axes.len() == MAX_AXES {
                return fail(column, ChainErrorKind::TooManyAxes);
            }
            axes.push(axis);
        }
        if !has_bed {
            return fail(end_column, ChainErrorKind::NoBed);
        }
        if axes.is_empty() {
            return fail(end_column, ChainErrorKind::NoAxis);
        }
        Ok(Self { axes })
    }

    /// The axes from workpiece to tool.
    #[must_use]
    pub fn axes(&self) -> &[ChainAxis] {
        &self.axes
    }

    /// The error motions, squarenesses and location errors that a machine of this chain has: 21 of three axes. Zero offsets
    /// of rotary axes and errors of the spindle are not among them.
    #[must_use]
    pub fn error_symbols(&self) -> Vec<ErrorSymbol> {
        let axes = || self.axes.iter().filter(|a| !a.spindle).map(|a| a.name);
        let mut out: Vec<ErrorSymbol> = axes()
            .flat_map(|axis| Component::ALL.map(|component| ErrorSymbol::Motion { component, axis }))
            .collect();
        for (component, axis, other) in [
            (Component::C, AxisName::Y, AxisName::X),
            (Component::B, AxisName::Z, AxisName::X),
            (Component::A, AxisName::Z, AxisName::Y),
        ] {
            if axes().any(|a| a == axis) && axes().any(|a| a == other) {
                out.push(ErrorSymbol::Squareness { component, axis });
            }
        }
        for axis in axes().filter(|a| a.kind() == AxisKind::Rotary) {
            let own = axis.direction();
            let location = Component::ALL.into_iter().filter(|c| c.index() != own && c.index() != 3 + own);
            out.extend(location.map(|component| ErrorSymbol::Location { component, axis }));
        }
        out
    }

    /// Position of an axis in the chain.
    #[must_use]
    pub fn index_of(&self, name: AxisName) -> Option<usize> {
        self.axes.iter().position(|a| a.name == name)
    }
}

impl ChainAxis {
    fn parse(word: &str, side: Side, has_bed: bool) -> Result<Self, ChainErrorKind> {
        let bare = word.strip_prefix('(').and_then(|w| w.strip_suffix(')'));
        let spindle = bare.is_some();
        let word = bare.unwrap_or(word);
        let mut chars = word.chars();
        let letter = chars.next().unwrap_or('(');
        let prime = match chars.as_str() {
            "" => false,
            "'" | "\u{2019}" => true,
            _ => return Err(ChainErrorKind::UnknownAxis { letter }),
        };
        let axis = letter
            .is_ascii_uppercase()
            .then(|| AxisName::from_letter(letter))
            .flatten()
            .ok_or(ChainErrorKind::UnknownAxis { letter })?;
        if spindle != (axis == AxisName::S) {
            return Err(ChainErrorKind::SpindleParentheses);
        }
        match (side, prime) {
            // without a bed no side is known; the missing bed is the error to report
            _ if !has_bed => {}
            (Side::Workpiece, false) => return Err(ChainErrorKind::PrimeMissing { axis }),
            (Side::Tool, true) => return Err(ChainErrorKind::PrimeOnToolSide { axis }),
            _ => {}
        }
        Ok(Self { name: axis, side, spindle })
    }

    /// Linear or rotary.
    #[must_use]
    pub const fn kind(&self) -> AxisKind {
        self.name.kind()
    }
}

impl fmt::Display for Chain {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "[w")?;
        for a in self.axes.iter().filter(|a| a.side == Side::Workpiece) {
            write!(f, " {}'", a.name)?;
        }
        write!(f, " b")?;
        for a in self.axes.iter().filter(|a| a.side == Side::Tool) {
            if a.spindle { write!(f, " ({})", a.name)? } else { write!(f, " {}", a.name)? }
        }
        write!(f, " t]")
    }
}

/// The words between the brackets with their 1-based columns.
fn words(text: &str) -> Result<Vec<(usize, &str)>, ChainError> {
    let trimmed = text.trim();
    let lead = text.chars().take_while(|c| c.is_whitespace()).count();
    let inner = trimmed
        .strip_prefix('[')
        .and_then(|t| t.strip_suffix(']'))
        .ok_or(ChainError { column: lead + 1, kind: ChainErrorKind::NoBrackets })?;
    let mut out = Vec::new();
    let mut column = lead + 2;
    for word in inner.split(' ') {
        if !word.is_empty() {
            out.push((column, word));
        }
        column += word.chars().count() + 1;
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_chain_has_its_errors() {
        let count = |chain: &str| Chain::parse(chain).unwrap().error_symbols().len();
        assert_eq!(
            [count("[w X' b Y Z t]"), count("[w C' A' X' b Y Z t]"), count("[w b X Z (S) t]")],
            [21, 41, 13]
        );
    }

    #[test]
    fn chains_read_back_from_their_display() {
        for text in [
            "[w b X Y Z t]",
            "[w X' b Y Z t]",
            "[w X' Y' Z' b t]",
            "[w b X Y Z C A (S) t]",
            "[w A' b X Y B t]",
            "[w C' X' b Y Z (S) t]",
        ] {
            assert_eq!(Chain::parse(text).unwrap().to_string(), text);
        }
        assert_eq!(Chain::parse("  [ w  X'  b Y Z t ]").unwrap().to_string(), "[w X' b Y Z t]");
    }

    #[test]
    fn each_mistake_has_its_message_and_column() {
        use ChainErrorKind as K;
        for (text, column, kind) in [
            ("w b X t", 1, K::NoBrackets),
            ("[X b t]", 2, K::NoWorkpiece),
            ("[w b X]", 6, K::NoTool),
            ("[w X Y Z t]", 11, K::NoBed),
            ("[w b X b t]", 8, K::BedTwice),
            ("[w b Q t]", 6, K::UnknownAxis { letter: 'Q' }),
            ("[w b x t]", 6, K::UnknownAxis { letter: 'x' }),
            ("[w b X Y X t]", 10, K::AxisTwice { axis: AxisName::X }),
            ("[w X' b X t]", 9, K::AxisTwice { axis: AxisName::X }),
            ("[w X b Y t]", 4, K::PrimeMissing { axis: AxisName::X }),
            ("[w b Y' t]", 6, K::PrimeOnToolSide { axis: AxisName::Y }),
            ("[w b X S t]", 8, K::SpindleParentheses),
            ("[w b X (Y) t]", 8, K::SpindleParentheses),
            ("[w b X (S) Z t]", 12, K::SpindleNotLast),
            ("[w b t]", 7, K::NoAxis),
            ("[]", 2, K::NoWorkpiece),
            ("[w]", 3, K::NoTool),
        ] {
            assert_eq!(Chain::parse(text), Err(ChainError { column, kind }), "{text}");
        }
    }
}
