//! Error symbols of ISO 230-1 and ISO 230-7: `EXX`, `EAY`, `EC0Y`, `EX0C`.

use core::fmt;

use crate::axes::{AxisKind, AxisName};

/// Direction of an error: displacement along x y z or rotation about x y z.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[expect(missing_docs, reason = "the letters are their own description")]
pub enum Component {
    X,
    Y,
    Z,
    A,
    B,
    C,
}

impl Component {
    /// All six, in the order in which error motions are stored: EX EY EZ EA EB EC.
    pub const ALL: [Self; 6] = [Self::X, Self::Y, Self::Z, Self::A, Self::B, Self::C];

    /// Position in [`Component::ALL`].
    #[must_use]
    pub const fn index(self) -> usize {
        self as usize
    }

    /// True for A, B, C.
    #[must_use]
    pub const fn is_angle(self) -> bool {
        matches!(self, Self::A | Self::B | Self::C)
    }

    /// The upper-case letter.
    #[must_use]
    pub const fn letter(self) -> char {
        match self {
            Self::X => 'X',
            Self::Y => 'Y',
            Self::Z => 'Z',
            Self::A => 'A',
            Self::B => 'B',
            Self::C => 'C',
        }
    }

    /// The component of a letter, upper or lower case.
    #[must_use]
    pub fn from_letter(letter: char) -> Option<Self> {
        Self::ALL.into_iter().find(|c| c.letter() == letter.to_ascii_uppercase())
    }
}

/// A geometric error by its ISO symbol.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum ErrorSymbol {
    /// An error motion of an axis, a function of its coordinate: `EXX`, `EAC`.
    Motion {
        /// Direction of the error.
        component: Component,
        /// The moving axis.
        axis: AxisName,
    },
    /// A constant rotation of the line of motion of a linear axis: `EC0Y`, `EB0Z`, `EA0Z` only (equations 1.7).
    Squareness {
        /// The rotation: C for Y, A or B for Z.
        component: Component,
        /// Y or Z.
        axis: AxisName,
    },
    /// A constant location error of a rotary axis: `EX0C EY0C EA0C EB0C` and, as zero offset, `EC0C`.
    Location {
        /// Direction of the error.
        component: Component,
        /// The rotary axis.
        axis: AxisName,
    },
}

impl ErrorSymbol {
    /// Reads a symbol such as `exx`, `EC0Y` or `ex0c`.
    ///
    /// A location error along the axis itself (`ez0c`) and squarenesses other than `ec0y eb0z ea0z`
    /// do not exist and give `None`.
    #[must_use]
    pub fn parse(text: &str) -> Option<Self> {
        let mut chars = text.chars();
        if !chars.next()?.eq_ignore_ascii_case(&'e') {
            return None;
        }
        let component = Component::from_letter(chars.next()?)?;
        let third = chars.next()?;
        let symbol = if third == '0' {
            let axis = AxisName::from_letter(chars.next()?)?;
            match (component, axis) {
                (Component::C, AxisName::Y) | (Component::A | Component::B, AxisName::Z) => {
                    Self::Squareness { component, axis }
                }
                _ if axis.kind() == AxisKind::Rotary && component.index() != axis.direction() => {
                    Self::Location { component, axis }
                }
                _ => return None,
            }
        } else {
            Self::Motion { component, axis: AxisName::from_letter(third)? }
        };
        chars.next().is_none().then_some(symbol)
    }

    /// True where the value is an angle.
    #[must_use]
    pub const fn is_angle(self) -> bool {
        self.component().is_angle()
    }

    /// The direction of the error.
    #[must_use]
    pub const fn component(self) -> Component {
        match self {
            Self::Motion { component, .. }
            | Self::Squareness { component, .. }
            | Self::Location { component, .. } => component,
        }
    }

    /// The axis to which the error belongs.
    #[must_use]
    pub const fn axis(self) -> AxisName {
        match self {
            Self::Motion { axis, .. } | Self::Squareness { axis, .. } | Self::Location { axis, .. } => axis,
        }
    }

    /// True for squareness and location errors: one number, no curve.
    #[must_use]
    pub const fn is_constant(self) -> bool {
        !matches!(self, Self::Motion { .. })
    }
}

impl fmt::Display for ErrorSymbol {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let zero = if self.is_constant() { "0" } else { "" };
        f.pad(&format!("E{}{zero}{}", self.component().letter(), self.axis()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_symbol_reads_back_from_its_display() {
        for text in ["exx", "eyx", "ecz", "ebc", "ec0y", "eb0z", "ea0z", "ex0c", "ec0c", "ey0a", "eaw"] {
            let symbol = ErrorSymbol::parse(text).unwrap_or_else(|| panic!("{text}"));
            assert_eq!(symbol.to_string(), text.to_uppercase());
            assert_eq!(ErrorSymbol::parse(&symbol.to_string()), Some(symbol));
        }
    }

    #[test]
    fn symbols_that_do_not_exist_are_refused() {
        for text in ["", "e", "ex", "exq", "fxx", "exxx", "ea0x", "ea0y", "ez0c", "ex0a", "ec0z", "ex0x"] {
            assert_eq!(ErrorSymbol::parse(text), None, "{text}");
        }
    }
}
