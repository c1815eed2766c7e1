//! Everything that can happen to a compensation, by number: what it means, what volcomp does, what a person can do.
//!
//! Numbers never change their meaning and are never used again. Thousands tell the room: 1 orders, 2 machine,
//! 3 positions, 4 offsets, 5 model, 6 link, 7 service, 8 sensors. Pure: tables and look-ups.

use core::fmt;

use crate::Reason;

// `CATALOGUE`, every entry by number, and a constant of [`Code`] for each: made from catalogue.toml by build.rs
include!(concat!(env!("OUT_DIR"), "/catalogue.rs"));

/// How serious it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Severity {
    /// The ordinary course of things.
    Notice,
    /// Compensation goes on, holds or waits; it comes back by itself.
    Warning,
    /// Compensation ends until a person has looked.
    Fault,
}

/// The number of an entry, written `VC-3001`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Code(pub u16);

/// One entry.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Entry {
    /// Its number.
    pub code: Code,
    /// Its name in status, log and recordings.
    pub name: &'static str,
    /// How serious it is.
    pub severity: Severity,
    /// What it is, in one line.
    pub text: &'static str,
    /// Where it comes from.
    pub cause: &'static str,
    /// What volcomp does, and what that means for the machine.
    pub reaction: &'static str,
    /// What a person can do.
    pub remedy: &'static str,
}

impl Severity {
    /// The word for it.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Notice => "notice",
            Self::Warning => "warning",
            Self::Fault => "fault",
        }
    }
}

impl fmt::Display for Code {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "VC-{:04}", self.0)
    }
}

impl Code {
    /// Reads `VC-3001`, `vc3001` or `3001`.
    #[must_use]
    pub fn parse(text: &str) -> Option<Self> {
        let digits = text.trim();
        let digits = digits.strip_prefix("VC").or_else(|| digits.strip_prefix("vc")).unwrap_or(digits);
        let digits = digits.strip_prefix('-').unwrap_or(digits);
        (digits.len() == 4 && digits.bytes().all(|b| b.is_ascii_digit()))
            .then(|| digits.parse().ok().map(Self))
            .flatten()
    }

    /// Its entry, where there is one.
    #[must_use]
    pub fn entry(self) -> Option<&'static Entry> {
        CATALOGUE.iter().find(|e| e.code == self)
    }
}

/// The entry with a name.
#[must_use]
pub fn named(name: &str) -> Option<&'static Entry> {
    CATALOGUE.iter().find(|e| e.name == name)
}

/// The entry of a reason of the engine.
#[must_use]
pub fn of_reason(reason: Reason) -> &'static Entry {
    let code = reason_code(reason);
    // a test holds that every reason has its entry
    CATALOGUE.iter().find(|e| e.code == code).unwrap_or(&CATALOGUE[0])
}

/// The number of a reason of the engine.
#[must_use]
pub const fn reason_code(reason: Reason) -> Code {
    Code(reason as u16)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_and_names_are_unique_and_in_order() {
        for pair in CATALOGUE.windows(2) {
            assert!(pair[0].code < pair[1].code, "{} {}", pair[0].code, pair[1].code);
        }
        for (i, entry) in CATALOGUE.iter().enumerate() {
            assert_eq!(CATALOGUE.iter().position(|e| e.name == entry.name), Some(i), "{}", entry.name);
            for text in [entry.text, entry.cause, entry.reaction, entry.remedy] {
                assert!(text.len() > 10 && !text.ends_with('.'), "{}: {text}", entry.code);
            }
        }
    }

    #[test]
    fn every_reason_has_its_own_entry() {
        for reason in Reason::ALL {
            assert_eq!(of_reason(reason).code, reason_code(reason));
        }
    }

    #[test]
    fn a_latched_fault_names_the_command_that_clears_it() {
        for reason in [Reason::DataLost, Reason::ReadBack, Reason::StopLimit, Reason::ImplausibleOffset] {
            let entry = of_reason(reason);
            assert_eq!(entry.severity, Severity::Fault);
            assert!(
                entry.remedy.contains("`volcomp enable --clear-fault`"),
                "{}: {}",
                entry.code,
                entry.remedy
            );
        }
    }

    #[test]
    fn numbers_are_read_as_people_write_them() {
        for text in ["VC-3001", "vc-3001", "VC3001", "3001", " 3001 "] {
            assert_eq!(Code::parse(text), Some(Code(3001)));
        }
        for text in ["", "VC-", "31", "VC-30011", "30-01", "-3001x"] {
            assert_eq!(Code::parse(text), None, "{text}");
        }
        assert_eq!(Code(3001).to_string(), "VC-3001");
        assert!(Code(9999).entry().is_none());
    }
}
