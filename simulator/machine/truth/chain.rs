//! The chain string, read into joints from the workpiece through the bed to the tool.
//!
//! `[w X' Y' b Z t]`: `w` workpiece, `b` bed, `t` tool; a prime marks an axis on the workpiece side; the spindle
//! stands in parentheses, `(S)`. Source: equations 2.

use volcomp_units::axes::{AxisName, MAX_AXES};

/// On which side of the bed an axis stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// Between workpiece and bed (primed).
    Workpiece,
    /// Between bed and tool.
    Tool,
}

/// One axis of a chain.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Link {
    /// Its letter.
    pub axis: AxisName,
    /// Its side of the bed.
    pub side: Side,
}

/// A chain as written: its links in the order of the string.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Chain {
    text: String,
    links: Vec<Link>,
}

/// What is wrong with a chain string.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ChainError {
    /// No brackets around it.
    #[error("chain {text:?} does not stand in brackets; write it like \"[w X' Y' b Z t]\"")]
    Brackets {
        /// The string.
        text: String,
    },
    /// It does not run from workpiece to tool.
    #[error("chain {text:?} does not run from w (workpiece) to t (tool)")]
    Ends {
        /// The string.
        text: String,
    },
    /// An unknown word, neither axis nor bed.
    #[error(
        "chain: unknown axis {word:?} (word {place}); expected one of X Y Z U V W A B C, primed on the workpiece side, and (S)"
    )]
    Word {
        /// The word.
        word: String,
        /// Counted from 1, `w` included.
        place: usize,
    },
    /// No bed.
    #[error("chain {text:?} has no b (bed), so the sides of its axes are not known")]
    NoBed {
        /// The string.
        text: String,
    },
    /// More than one bed.
    #[error("chain {text:?} has more than one b (bed)")]
    TwoBeds {
        /// The string.
        text: String,
    },
    /// An axis named twice.
    #[error("chain: axis {axis} stands in it twice")]
    Twice {
        /// The axis.
        axis: AxisName,
    },
    /// A prime on the tool side.
    #[error("chain: axis {axis} is primed but stands between b and t; a prime marks the workpiece side")]
    Prime {
        /// The axis.
        axis: AxisName,
    },
    /// No prime on the workpiece side.
    #[error("chain: axis {axis} stands between w and b and needs a prime, {axis}'")]
    NoPrime {
        /// The axis.
        axis: AxisName,
    },
    /// Spindle without parentheses, or another axis within them.
    #[error("chain: {word:?} (word {place}): the spindle S, and only it, stands in parentheses")]
    Parentheses {
        /// The word.
        word: String,
        /// Counted from 1, `w` included.
        place: usize,
    },
    /// No axis at all.
    #[error("chain {text:?} has no axis")]
    Empty {
        /// The string.
        text: String,
    },
    /// More axes than a machine may have.
    #[error("chain: {count} axes, at most {MAX_AXES} are possible")]
    TooMany {
        /// How many.
        count: usize,
    },
}

impl Chain {
    /// Reads a chain string.
    /// # Errors
    /// [`ChainError`] names the word or axis that is wrong.
    pub fn parse(text: &str) -> Result<Self, ChainError> {
        let owned = || text.trim().to_owned();
        let inner = text
            .trim()
            .strip_prefix('[')
            .and_then(|t| t.strip_suffix(']'))
            .ok_or_else(|| ChainError::Brackets { text: owned() })?;
        let words: Vec<&str> = inner.split_whitespace().collect();
        if words.len() < 2 || words.first() != Some(&"w") || words.last() != Some(&"t") {
            return Err(ChainError::Ends { text: owned() });
        }
        let middle = &words[1..words.len() - 1];
        let bed = middle.iter().position(|w| *w == "b").ok_or_else(|| ChainError::NoBed { text: owned() })?;
        if middle.iter().filter(|w| **w == "b").count() > 1 {
            return Err(ChainError::TwoBeds { text: owned() });
        }
        let mut links: Vec<Link> = Vec::new();
        for (index, word) in middle.iter().enumerate().filter(|(index, _)| *index != bed) {
            let side = if index < bed { Side::Workpiece } else { Side::Tool };
            let link = read_word(word, index + 2, side)?;
            if links.iter().any(|l| l.axis == link.axis) {
                return Err(ChainError::Twice { axis: link.axis });
            }
            links.push(link);
        }
        match links.len() {
            0 => Err(ChainError::Empty { text: owned() }),
            count if count > MAX_AXES => Err(ChainError::TooMany { count }),
            _ => Ok(Self { text: owned(), links }),
        }
    }

    /// The links from workpiece to tool.
    #[must_use]
    pub fn links(&self) -> &[Link] {
        &self.links
    }

    /// The string it was read from.
    #[must_use]
    pub fn text(&self) -> &str {
        &self.text
    }
}

fn read_word(word: &str, place: usize, side: Side) -> Result<Link, ChainError> {
    let unbracketed = word.strip_prefix('(').and_then(|w| w.strip_suffix(')'));
    let bare = unbracketed.unwrap_or(word);
    let primed = bare.ends_with('\'');
    let mut letters = bare.strip_suffix('\'').unwrap_or(bare).chars();
    let axis = match (letters.next(), letters.next()) {
        (Some(letter), None) if letter.is_ascii_uppercase() => AxisName::from_letter(letter),
        _ => None,
    }
    .ok_or_else(|| ChainError::Word { word: word.to_owned(), place })?;
    if (axis == AxisName::S) != unbracketed.is_some() {
        return Err(ChainError::Parentheses { word: word.to_owned(), place });
    }
    match (side, primed) {
        (Side::Tool, true) => Err(ChainError::Prime { axis }),
        (Side::Workpiece, false) => Err(ChainError::NoPrime { axis }),
        _ => Ok(Link { axis, side }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sides_follow_the_bed() {
        let chain = Chain::parse("[w C' X' b Y Z (S) t]").unwrap();
        let sides: Vec<_> = chain.links().iter().map(|l| (l.axis.letter(), l.side == Side::Tool)).collect();
        assert_eq!(sides, [('C', false), ('X', false), ('Y', true), ('Z', true), ('S', true)]);
        assert_eq!(chain.text(), "[w C' X' b Y Z (S) t]");
    }

    #[test]
    fn every_mistake_has_its_own_error() {
        let error = |text: &str| Chain::parse(text).unwrap_err();
        assert!(matches!(error("w X' b t"), ChainError::Brackets { .. }));
        assert!(matches!(error("[X' b Y Z t]"), ChainError::Ends { .. }));
        assert!(matches!(error("[w X' b Q t]"), ChainError::Word { place: 4, .. }));
        assert!(matches!(error("[w b x t]"), ChainError::Word { place: 3, .. }));
        assert!(matches!(error("[w X' Y' t]"), ChainError::NoBed { .. }));
        assert!(matches!(error("[w b X b Y t]"), ChainError::TwoBeds { .. }));
        assert!(matches!(error("[w X' b X t]"), ChainError::Twice { axis: AxisName::X }));
        assert!(matches!(error("[w b X' t]"), ChainError::Prime { axis: AxisName::X }));
        assert!(matches!(error("[w X b Y t]"), ChainError::NoPrime { axis: AxisName::X }));
        assert!(matches!(error("[w b X S t]"), ChainError::Parentheses { place: 4, .. }));
        assert!(matches!(error("[w b (C) t]"), ChainError::Parentheses { .. }));
        assert!(matches!(error("[w b t]"), ChainError::Empty { .. }));
        assert!(matches!(error("[w b X Y Z U V W A B C t]"), ChainError::TooMany { count: 9 }));
    }
}
