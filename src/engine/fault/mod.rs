//! Everything that can happen to a compensation, by number: what it means, what volcomp does, what a person can do.
//!
//! Numbers never change their meaning and are never used again. Thousands tell the room: 1 orders, 2 machine,
//! 3 positions, 4 offsets, 5 model, 6 link, 7 service, 8 sensors. Pure: tables and look-ups.

mod catalogue;

use core::fmt;

use crate::Reason;

pub use catalogue::CATALOGUE;

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
    /// No link to the control.
    pub const CONNECT_FAILED: Self = Self(6001);
    /// The link to the control has ended.
    pub const LINK_LOST: Self = Self(6002);
    /// The control has moved its offset on its own.
    pub const CONTROL_TOOK_OVER: Self = Self(4003);
    /// Bytes from the control are no frame, or none that belongs there.
    pub const BAD_FRAME: Self = Self(6003);
    /// The control is not the one of the machine file.
    pub const HELLO_MISMATCH: Self = Self(6004);
    /// Another daemon has the control.
    pub const CONTROL_BUSY: Self = Self(6005);
    /// Corrections come later than one control cycle.
    pub const LATE_CYCLES: Self = Self(6006);
    /// The two ends cannot agree on TLS.
    pub const TLS_FAILED: Self = Self(6007);
    /// Position frames come at another interval than the control announces.
    pub const CYCLE_TIME: Self = Self(6008);
    /// Position frames out of order or repeated.
    pub const SEQUENCE: Self = Self(3004);
    /// An offset is held back by its limit.
    pub const LIMITED: Self = Self(4005);
    /// An offset is held back by a soft limit of the machine.
    pub const SOFT_LIMIT: Self = Self(4006);
    /// An axis is outside the travel of the model.
    pub const OUT_OF_TRAVEL: Self = Self(3007);
    /// The control limits the offset.
    pub const CONTROL_LIMITED: Self = Self(4008);
    /// An offset stays away from its correction.
    pub const OFFSET_BEHIND: Self = Self(4009);
    /// The control holds an offset of an axis that the machine file does not list.
    pub const UNLISTED_OFFSET: Self = Self(4010);
    /// The model is of another machine.
    pub const MODEL_FOREIGN: Self = Self(5002);
    /// The model has expired.
    pub const MODEL_EXPIRED: Self = Self(5003);
    /// The machine is outside the temperatures of the model, or its temperature is not known.
    pub const TEMPERATURE_ENVELOPE: Self = Self(5004);
    /// The model file is not the one that the machine file names.
    pub const MODEL_HASH: Self = Self(5005);
    /// The new model differs from the one in use by more than allowed.
    pub const MODEL_CHANGE: Self = Self(5006);
    /// The model cannot be read.
    pub const MODEL_INVALID: Self = Self(5007);
    /// Cycles are missing in the recording.
    pub const RECORDS_LOST: Self = Self(7001);
    /// The recording cannot be written.
    pub const RECORDING_STOPPED: Self = Self(7002);
    /// The saved counters could not be read.
    pub const COUNTERS_DAMAGED: Self = Self(7003);
    /// The audit log is not the one that was written.
    pub const AUDIT_BROKEN: Self = Self(7004);
    /// The counters cannot be saved.
    pub const COUNTERS_NOT_SAVED: Self = Self(7006);
    /// The service gives no sign of life.
    pub const SERVICE_SILENT: Self = Self(7007);
    /// Real-time scheduling or memory lock is not permitted.
    pub const REALTIME_REFUSED: Self = Self(7005);

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
    Code(match reason {
        Reason::Command => 1001,
        Reason::MachineReady => 1002,
        Reason::RampDone => 1003,
        Reason::DataGood => 1004,
        Reason::ModelChanged => 1005,
        Reason::ToolChanged => 1006,
        Reason::NotHomed => 2001,
        Reason::NotEnabled => 2002,
        Reason::EmergencyStop => 2003,
        Reason::Stale => 3001,
        Reason::NotFinite => 3002,
        Reason::Jump => 3003,
        Reason::Sequence => 3004,
        Reason::ControlClock => 3005,
        Reason::Frozen => 3006,
        Reason::OutOfTravel => 3007,
        Reason::DataLost => 3008,
        Reason::ReadBack => 4001,
        Reason::FoundOffset => 4002,
        Reason::ControlTookOver => 4003,
        Reason::StopLimit => 4004,
        Reason::ImplausibleOffset => 4007,
        Reason::ModelNotFinite => 5001,
        Reason::LiveLost => 8001,
    })
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
