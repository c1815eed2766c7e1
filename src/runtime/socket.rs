//! What is said on the status socket: one JSON object per line and direction.
//!
//! `{"command": "status" | "histograms" | "enable" | "disable" | "clear-fault" | "gain" | "load" | "rollback" | "filter" | "forget"}`, with what
//! belongs to it. Answers: `{"ok": true, "state": ..}` with more for some, or `{"ok": false, "error": ".."}`.

use serde::{Deserialize, Serialize};

use super::latency::Histograms;
use super::sensors::FilterStatus;
use super::status::Status;

/// What a client asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verb {
    /// The status.
    #[default]
    Status,
    /// The latencies of the present link in full.
    Histograms,
    /// Compensate as soon as the machine is ready.
    Enable,
    /// Ramp out and stay off.
    Disable,
    /// Acknowledge a fault.
    ClearFault,
    /// Another share of the correction.
    Gain,
    /// Another model.
    Load,
    /// Back to the model before.
    Rollback,
    /// Sensors and maps with their nodes.
    Filter,
    /// A map goes back to the offline map.
    Forget,
}

/// A model file sent along.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SentModel {
    /// Where it came from, for people.
    pub origin: String,
    /// Its content.
    pub text: String,
}

/// One request.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Ask {
    /// What is asked for.
    pub command: Verb,
    /// Why, for the audit log.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// With `gain`: the share, 0 to 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gain: Option<f64>,
    /// With `load`: the model.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub model: Option<SentModel>,
    /// With `forget`: the map.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub map: Option<String>,
    /// With `load`: name of the person who confirms a large change.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub confirm: Option<String>,
    /// With `enable`: the machine's temperature, degrees Celsius.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub temperature_degc: Option<f64>,
    /// With `enable`: although the model has expired.
    #[serde(default, skip_serializing_if = "core::ops::Not::not")]
    pub accept_expired: bool,
    /// With `enable`: only work it out, apply nothing.
    #[serde(default, skip_serializing_if = "core::ops::Not::not")]
    pub shadow: bool,
}

/// One answer.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Answer {
    /// Whether it was done.
    pub ok: bool,
    /// The state that followed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub state: Option<String>,
    /// The status, where it was asked for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub status: Option<Box<Status>>,
    /// The histograms, where they were asked for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub histograms: Option<Box<Histograms>>,
    /// Sensors and maps, where they were asked for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub filter: Option<Box<FilterStatus>>,
    /// How far a new model is from the one before.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub change: Option<ModelChange>,
    /// What should be known although it was done.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub notes: Vec<String>,
    /// Why it was not done.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
}

/// How far a new model is from the one before.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ModelChange {
    /// Hash of the model before.
    pub old_hash: String,
    /// Hash of the new one.
    pub new_hash: String,
    /// Largest change of the tip in the working volume, um; `null` where the models have different axes.
    pub largest_um: Option<f64>,
    /// Largest change of the tool's direction, arcsec.
    pub largest_arcsec: Option<f64>,
}

impl Answer {
    pub(super) fn refused(error: String) -> Self {
        Self { ok: false, error: Some(error), ..Self::default() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn requests_are_read_to_the_letter() {
        let ask: Ask = serde_json::from_str(r#"{"command": "clear-fault"}"#).expect("known");
        assert_eq!(ask, Ask { command: Verb::ClearFault, ..Ask::default() });
        let ask: Ask = serde_json::from_str(r#"{"command": "enable", "reason": "warm"}"#).expect("known");
        assert_eq!(ask.reason.as_deref(), Some("warm"));
        let load = Ask {
            command: Verb::Load,
            model: Some(SentModel { origin: "m.toml".to_owned(), text: "a\nb".to_owned() }),
            confirm: Some("eve".to_owned()),
            ..Ask::default()
        };
        let line = serde_json::to_string(&load).expect("written");
        assert!(!line.contains('\n'), "one line");
        assert_eq!(serde_json::from_str::<Ask>(&line).expect("read"), load);
        for wrong in [r#"{"command": "Enable"}"#, r#"{"command": "enable", "force": true}"#, "{}", "[]"] {
            assert!(serde_json::from_str::<Ask>(wrong).is_err(), "{wrong}");
        }
    }
}
