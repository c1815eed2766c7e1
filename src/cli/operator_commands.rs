//! `enable`, `disable`, `gain`, `load`, `rollback`: commands to a running daemon.

use super::status::{Which, failure, json, socket};
use crate::prelude::*;
use volcomp_daemon::client::{self, ClientError};
use volcomp_daemon::socket::{Answer, Ask, SentModel, Verb};

/// What every order has.
#[derive(Debug, clap::Args)]
pub(super) struct Common {
    #[command(flatten)]
    pub(super) which: Which,
    /// Why, for the audit log; at most 1 KiB.
    #[arg(long, value_name = "TEXT", value_parser = super::arg_parsers::reason)]
    pub(super) reason: Option<String>,
    /// Print one JSON object instead of text.
    #[arg(long)]
    pub(super) json: bool,
}

/// Switch compensation on: it is ramped in as soon as the machine is ready; prints the state that follows.
///
/// Refused where the model has expired or the machine is outside its temperatures (`guard` in the machine file).
#[derive(Debug, clap::Parser)]
#[command(after_help = "Examples:\n  volcomp enable --reason \"warm-up done\" --temperature-degc 21.5\n  \
                        volcomp enable --shadow      # work it out and score it, apply nothing; volcomp status shows the score")]
pub(super) struct EnableArgs {
    #[command(flatten)]
    common: Common,
    /// Acknowledge a latched fault first; its cause must be gone.
    #[arg(long)]
    clear_fault: bool,
    /// Temperature of the machine, -50 to 150 degrees Celsius; the daemon remembers it.
    #[arg(long, value_name = "T", allow_negative_numbers = true)]
    temperature_degc: Option<f64>,
    /// Although the model has expired; needs a --reason.
    #[arg(long, requires = "reason")]
    accept_expired: bool,
    /// Shadow mode: work out what compensation would do and score it, but apply nothing.
    #[arg(long)]
    shadow: bool,
}

/// Switch compensation (or shadow mode) off: the offset is ramped out; prints the state that follows.
#[derive(Debug, clap::Parser)]
pub(super) struct DisableArgs {
    #[command(flatten)]
    common: Common,
    /// Acknowledge a latched fault first; its cause must be gone.
    #[arg(long)]
    clear_fault: bool,
}

/// Change the share of the correction that is applied; the offset goes there over the ramp.
#[derive(Debug, clap::Parser)]
#[command(after_help = "Example:\n  volcomp gain 0.5 --reason \"half for a first test cut\"")]
pub(super) struct GainArgs {
    /// Share of the correction, 0 (none) to 1 (all).
    #[arg(value_name = "SHARE", value_parser = share, allow_negative_numbers = true)]
    gain: f64,
    #[command(flatten)]
    common: Common,
}

/// Take another model into use while the machine runs: the offset goes from the old correction to the new one over
/// the ramp.
///
/// A model that differs from the one in use by more than change-limit-um of `guard` anywhere in the working volume needs
/// a name and a reason. The choice outlives a restart, the model before is kept for `volcomp rollback`, and all of it
/// goes into the audit log.
#[derive(Debug, clap::Parser)]
#[command(
    after_help = "Examples:\n  volcomp diff old.toml new.toml      # look first\n  volcomp load new.toml --reason \"survey of 3 May\"\n  \
                        volcomp load new.toml --confirm \"A. Smith\" --reason \"new ball screw on X\""
)]
pub(super) struct LoadArgs {
    /// The model file.
    #[arg(value_name = "MODEL")]
    model: PathBuf,
    /// Name of the person who confirms a large change; needs a --reason.
    #[arg(long, value_name = "NAME", requires = "reason", value_parser = super::arg_parsers::reason)]
    confirm: Option<String>,
    #[command(flatten)]
    common: Common,
}

/// Go back to the model that was in use before; a second time undoes the first.
#[derive(Debug, clap::Parser)]
pub(super) struct RollbackArgs {
    #[command(flatten)]
    common: Common,
}

pub(super) fn enable(args: &EnableArgs) -> Result<()> {
    clear_fault(args.clear_fault, &args.common)?;
    let ask = Ask {
        command: Verb::Enable,
        temperature_degc: args.temperature_degc,
        accept_expired: args.accept_expired,
        shadow: args.shadow,
        ..Ask::default()
    };
    send(ask, &args.common)
}

pub(super) fn disable(args: &DisableArgs) -> Result<()> {
    clear_fault(args.clear_fault, &args.common)?;
    send(Ask { command: Verb::Disable, ..Ask::default() }, &args.common)
}

pub(super) fn gain(args: &GainArgs) -> Result<()> {
    send(Ask { command: Verb::Gain, gain: Some(args.gain), ..Ask::default() }, &args.common)
}

pub(super) fn load(args: &LoadArgs) -> Result<()> {
    let text = input::read_text(&args.model, InputKind::Model)?;
    // the daemon shows this name later, wherever it was typed
    let origin =
        std::path::absolute(&args.model).unwrap_or_else(|_| args.model.clone()).display().to_string();
    let model = Some(SentModel { origin, text });
    send(Ask { command: Verb::Load, model, confirm: args.confirm.clone(), ..Ask::default() }, &args.common)
}

pub(super) fn rollback(args: &RollbackArgs) -> Result<()> {
    send(Ask { command: Verb::Rollback, ..Ask::default() }, &args.common)
}

fn clear_fault(wanted: bool, common: &Common) -> Result<()> {
    if wanted {
        let ask = Ask { command: Verb::ClearFault, reason: common.reason.clone(), ..Ask::default() };
        client::ask(&socket(&common.which)?, &ask).map_err(|e| refusal(&e))?;
    }
    Ok(())
}

fn send(ask: Ask, common: &Common) -> Result<()> {
    let ask = Ask { reason: common.reason.clone(), ..ask };
    let answer = client::ask(&socket(&common.which)?, &ask).map_err(|e| refusal(&e))?;
    if common.json {
        say!("{}", json(&answer_only(&answer))?);
    } else {
        if let Some(change) = &answer.change {
            let figure =
                |value: Option<f64>, unit| value.map_or_else(|| "?".to_owned(), |v| format!("{v:.2} {unit}"));
            let [um, arcsec] = [figure(change.largest_um, "um"), figure(change.largest_arcsec, "arcsec")];
            say_text!("largest change in the working volume: {um}, {arcsec}");
        }
        say!("{}", answer.state.as_deref().unwrap_or("?"));
    }
    for note in &answer.notes {
        note!("note: {note}");
    }
    if ask.shadow {
        note!("{SHADOW}");
    }
    if let Some(words) = consequence(ask.command, answer.state.as_deref()) {
        note!("{words}");
    }
    Ok(())
}

/// What shadow mode does: the state that follows is that of the compensation, which stays off.
const SHADOW: &str = "note: shadow mode is on: the correction is calculated and scored, nothing is applied; volcomp status shows the score";

/// What a state means for a request that was accepted.
fn consequence(command: Verb, state: Option<&str>) -> Option<&'static str> {
    match (command, state?) {
        (_, "faulted") => Some("hint: `volcomp status` names the fault; --clear-fault acknowledges it"),
        (Verb::Enable | Verb::Gain, "disconnected") => Some(
            "note: the link to the control is down; the request is stored and takes effect with the link",
        ),
        _ => None,
    }
}

/// What an answer holds beside `ok`.
fn answer_only(answer: &Answer) -> serde_json::Value {
    let mut object = serde_json::json!({ "state": answer.state });
    if let Some(change) = &answer.change {
        object["change"] = serde_json::json!(change);
    }
    if !answer.notes.is_empty() {
        object["notes"] = serde_json::json!(answer.notes);
    }
    object
}

/// A refusal is bad data or a wrong moment, anything else a broken conversation.
pub(super) fn refusal(error: &ClientError) -> Failure {
    match error {
        ClientError::Refused { .. } => Failure::new(EX_DATAERR, error),
        other => failure(other),
    }
}

fn share(text: &str) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|_| format!("{text} is no number"))?;
    if (0.0..=1.0).contains(&value) { Ok(value) } else { Err(format!("{value} is not from 0 to 1")) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_request_without_link_is_said_to_be_stored() {
        let said = consequence(Verb::Enable, Some("disconnected")).unwrap();
        assert!(said.contains("stored and takes effect with the link"));
        assert_eq!(consequence(Verb::Disable, Some("disconnected")), None);
        assert!(consequence(Verb::Disable, Some("faulted")).is_some());
        assert_eq!(consequence(Verb::Enable, Some("armed")), None);
    }
}
