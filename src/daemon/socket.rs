//! What is said on the status socket: one JSON object per line and direction.
//!
//! `{"command": "status" | "histograms" | "enable" | "disable" | "clear-fault" | "gain" | "load" | "rollback" | "compare" | "filter" |
//! "forget"}`, with what
//! belongs to it. `POST /api/v1/command` of the HTTP service takes the same object. Answers: `{"ok": true, "state": ..}` with more for some, or `{"ok": false, "error": ".."}`.

use serde::{Deserialize, Serialize};
use volcomp_state::bounded_read::MODEL_BYTES_MAX;

use super::latency::Histograms;
use super::models::ModelComparison;
use super::sensors::FilterStatus;
use super::status::Status;

/// Longest reason, bytes.
pub const REASON_BYTES_MAX: usize = 1024;
/// Longest name of a person or a map, bytes.
pub const NAME_BYTES_MAX: usize = 256;
/// Longest path of a model, bytes.
pub const ORIGIN_BYTES_MAX: usize = 4096;
/// Longest request, bytes: room for the largest model, of which every second byte may be escaped.
pub(super) const REQUEST_BYTES_MAX: u64 = 2 * MODEL_BYTES_MAX + (64 << 10);
/// Temperatures that a machine may have, degrees Celsius.
pub const TEMPERATURE_DEGC: [f64; 2] = [-50.0, 150.0];

/// Whether a reason is short enough.
///
/// # Errors
/// In words, with the limit.
pub fn check_reason(text: &str) -> Result<(), String> {
    check_length("the reason", text, REASON_BYTES_MAX)
}

/// Whether a machine may have this temperature.
///
/// # Errors
/// In words, with the range.
pub fn check_temperature(degc: f64) -> Result<(), String> {
    let [low, high] = TEMPERATURE_DEGC;
    if (low..=high).contains(&degc) {
        return Ok(());
    }
    Err(format!("temperature {degc:?} is outside of {low} to {high} degC"))
}

fn check_length(what: &str, text: &str, limit: usize) -> Result<(), String> {
    if text.len() <= limit {
        return Ok(());
    }
    Err(format!("{what} has {} bytes, the limit is {limit}", text.len()))
}

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
    /// What `load` of the model sent along, or `rollback` without one, would change; changes nothing.
    Compare,
    /// Sensors and maps with their nodes.
    Filter,
    /// A map goes back to the offline map.
    Forget,
}

impl Verb {
    /// Whether it changes nothing.
    #[must_use]
    pub const fn is_read_only(self) -> bool {
        matches!(self, Self::Status | Self::Histograms | Self::Filter | Self::Compare)
    }
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
    /// Who, for the audit log, where the way in does not tell: over HTTP.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
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
    /// With `load` and `rollback`: carried out only if this is still the hash of the model in use.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub old_hash: Option<String>,
    /// With `rollback`: carried out only if the model before has this hash.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub new_hash: Option<String>,
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
    /// What another model would change, where that was asked for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub comparison: Option<Box<ModelComparison>>,
    /// What should be known although it was done.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub notes: Vec<String>,
    /// Why it was not done.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
    /// What the audit log says instead of `error`.
    #[serde(skip)]
    pub(super) record: Option<String>,
}

impl Ask {
    /// Whether every part of it is within its limits.
    ///
    /// # Errors
    /// In words, with the limit.
    pub(super) fn check(&self) -> Result<(), String> {
        if let Some(reason) = &self.reason {
            check_reason(reason)?;
        }
        if let Some(degc) = self.temperature_degc {
            check_temperature(degc)?;
        }
        for name in [&self.confirm, &self.name].into_iter().flatten() {
            check_length("the name", name, NAME_BYTES_MAX)?;
        }
        if let Some(map) = &self.map {
            check_length("the name of the map", map, NAME_BYTES_MAX)?;
        }
        let Some(SentModel { origin, text }) = &self.model else { return Ok(()) };
        check_length("the path of the model", origin, ORIGIN_BYTES_MAX)?;
        let limit = usize::try_from(MODEL_BYTES_MAX).unwrap_or(usize::MAX);
        check_length("the model", text, limit)
    }
}

/// How far a new model is from the one before.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
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
    pub(super) fn refused(error: impl Into<String>) -> Self {
        Self { ok: false, error: Some(error.into()), ..Self::default() }
    }

    pub(super) fn done(state: &str) -> Self {
        Self { ok: true, state: Some(state.to_owned()), ..Self::default() }
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

    #[test]
    fn every_part_of_a_request_has_its_limit() {
        let reason = |length| Ask { reason: Some("x".repeat(length)), ..Ask::default() };
        assert_eq!(reason(REASON_BYTES_MAX).check(), Ok(()));
        let error = reason(REASON_BYTES_MAX + 1).check().expect_err("too long");
        assert_eq!(error, "the reason has 1025 bytes, the limit is 1024");
        let warm = |degc| Ask { temperature_degc: Some(degc), ..Ask::default() };
        for degc in [-50.0, 20.0, 150.0] {
            assert_eq!(warm(degc).check(), Ok(()));
        }
        for degc in [-50.1, 150.1, -500.0, 1e308, f64::INFINITY, f64::NAN] {
            let error = warm(degc).check().expect_err("outside");
            assert!(error.contains("-50 to 150 degC"), "{error}");
        }
        let model = |origin: usize, text: usize| Ask {
            model: Some(SentModel { origin: "o".repeat(origin), text: "t".repeat(text) }),
            ..Ask::default()
        };
        let most = usize::try_from(MODEL_BYTES_MAX).expect("fits");
        assert_eq!(model(ORIGIN_BYTES_MAX, most).check(), Ok(()));
        assert!(model(ORIGIN_BYTES_MAX + 1, 1).check().is_err() && model(1, most + 1).check().is_err());
        let long = Some("n".repeat(NAME_BYTES_MAX + 1));
        assert!(Ask { confirm: long.clone(), ..Ask::default() }.check().is_err());
        assert!(Ask { map: long, ..Ask::default() }.check().is_err());
    }
}
