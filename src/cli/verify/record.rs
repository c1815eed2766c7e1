//! `--record`: the result as the file that the daemon's page shows as the last verification.

use super::Verified;
use crate::prelude::*;
use volcomp_daemon::Verification;

/// The file, and what only a person knows.
#[derive(Debug, clap::Args)]
pub(super) struct RecordArgs {
    /// Write the result for the page of the daemon: `verification` of `http` in the machine file names this file.
    #[arg(long, value_name = "FILE.json", requires_all = ["date", "instrument"])]
    record: Option<PathBuf>,
    /// Day of the measurement, with --record.
    #[arg(long, value_name = "YYYY-MM-DD", value_parser = day, requires = "record")]
    date: Option<String>,
    /// Instrument with its serial number, with --record; at most 1 KiB.
    #[arg(long, value_name = "TEXT", value_parser = crate::arg_parsers::reason, requires = "record")]
    instrument: Option<String>,
    /// The model that compensated the machine: its hash goes into the record, so that the page can say whether it is still
    /// in use.
    #[arg(long, value_name = "MODEL.toml", requires = "record")]
    model: Option<PathBuf>,
}

fn day(text: &str) -> Result<String, String> {
    let date = text.parse::<toml::value::Datetime>().ok().filter(|d| d.date.is_some() && d.time.is_none());
    date.map(|_| text.to_owned()).ok_or_else(|| format!("'{text}' is not a day such as 2026-05-03"))
}

/// Writes the record, where one is asked for.
pub(super) fn write(args: &super::Args, verified: &Verified) -> Result<()> {
    let RecordArgs { record: Some(path), date: Some(date), instrument: Some(instrument), model } =
        &args.record
    else {
        return Ok(());
    };
    let model = model.as_ref().map(|model| input::read(model, InputKind::Model)).transpose()?;
    let model_hash = model.map(|bytes| blake3::hash(&bytes).to_hex().to_string());
    let [before, after] = verified.sizes;
    let reduction = verified.reductions[1];
    let record = Verification {
        format: Verification::format(),
        date: date.clone(),
        instrument: instrument.clone(),
        title: args.title.clone().unwrap_or_else(|| verified.test.standard.to_owned()),
        test: verified.test.test.to_owned(),
        unit: if verified.test.unit == "arcsec" { "arcsec" } else { "um" }.to_owned(),
        range: [before.range.value, after.range.value],
        rms: [before.rms.value, after.rms.value],
        reduction: reduction.map(|r| r.fraction),
        reduction_u95: reduction.and_then(|r| r.std).map(|std| 2.0 * std),
        model_hash,
    };
    let text = serde_json::to_string_pretty(&record).map_err(|e| Failure::new(EX_SOFTWARE, e))?;
    write_text(path, &(text + "\n"))?;
    note!("record written: {}", path.display());
    Ok(())
}
