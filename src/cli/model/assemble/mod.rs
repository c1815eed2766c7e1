//! `model assemble`: several measurements into one model file, with a report of what agreed and where all came from.

mod input;
mod text_report;

use input::Loaded;

use crate::files::read_model_file;
use crate::prelude::*;
use volcomp_identify::assemble::{Assembled, Options, assemble};

/// Put several measurements together: one model, one datum and reference-line convention, overlaps tested, sources kept
///
/// Inputs are model files as `volcomp fit` and `volcomp identify` write them, each with some errors, and tables of
/// measured motions. Where two state the same error they are transferred to one reference point and compared; what
/// agrees becomes the mean weighted by the uncertainties, what does not is refused until --prefer or --average
/// decides. Slopes of straightnesses and constants of angles count only in files that state the squareness, too (or
/// with --absolute): otherwise they are how the instrument stood.
///
///   volcomp model assemble x-laser.toml y-laser.toml square.toml --motion z=z-axis.csv --out machine.toml
#[derive(Debug, clap::Parser)]
pub(crate) struct Args {
    /// Model files (volcomp-model/1) to put together; the first says chain, frame and axes
    #[arg(value_name = "MODEL")]
    models: Vec<PathBuf>,
    /// A table of measured motions of an axis, as for `volcomp fit`: axis and file, such as z=z-axis.csv
    #[arg(long, value_name = "AXIS=FILE", value_parser = input::motion)]
    motion: Vec<(AxisName, PathBuf)>,
    /// Where a table of motions was measured, in M at home, mm: file and point, such as z-axis.csv=400,250,-100
    #[arg(long, value_name = "FILE=X,Y,Z", value_parser = input::place)]
    measured_at: Vec<(PathBuf, [f64; 3])>,
    /// The file that says chain, frame, axes and reference points instead of the first one; its errors are not used
    #[arg(long, value_name = "MODEL")]
    base: Option<PathBuf>,
    /// Where to write the model; - is stdout
    #[arg(long, value_name = "OUT.toml")]
    out: PathBuf,
    /// Take this file where several state an error: a file, or a file for one error, such as x-laser.toml:exx
    #[arg(long, value_name = "FILE[:ERROR]")]
    prefer: Vec<String>,
    /// Take the mean even where files do not agree: of these errors, such as exx,ec0y, or of all
    #[arg(long, value_name = "ERRORS|all", value_delimiter = ',')]
    average: Vec<String>,
    /// A file whose lines were all measured in one set-up: its slopes and constants are squareness and location
    #[arg(long, value_name = "FILE")]
    absolute: Vec<PathBuf>,
    /// Standard uncertainty (k = 1) of lengths for files that state none
    #[arg(long, value_name = "UM")]
    assume_std_um: Option<f64>,
    /// Standard uncertainty (k = 1) of angles for files that state none
    #[arg(long, value_name = "ARCSEC")]
    assume_std_arcsec: Option<f64>,
    /// Probability below which files are said to disagree
    #[arg(long, value_name = "P", default_value_t = 0.01)]
    significance: f64,
    /// Machine id of the model
    #[arg(long, value_name = "ID")]
    machine: Option<String>,
    /// Print one JSON object instead of text
    #[arg(long)]
    json: bool,
}

pub(super) fn run(args: &Args) -> Result<()> {
    let loaded = input::load(args)?;
    let options = options(args, &loaded)?;
    let sources: Vec<_> = loaded.iter().map(|l| l.source.clone()).collect();
    let done = assemble(&sources, &options).map_err(|e| failure!(EX_DATAERR, "{e}"))?;
    let file = model_file(args, &loaded, &done);
    let names = loaded.iter().map(|l| l.source.name.as_str()).joined(", ");
    let comment = format!("Assembled from {names} by volcomp model assemble.");
    write_model(&args.out, &config::model::write_file(&file, &[comment]))?;
    note!("model written: {}", args.out.display());
    if args.out.as_os_str() == "-" {
        return Ok(());
    }
    let report = text_report::Report { loaded: &loaded, done: &done, significance: options.significance };
    if args.json {
        let mut json = report.as_json();
        json["out"] = args.out.display().to_string().into();
        return crate::exit::print(&format!("{json:#}\n"));
    }
    crate::exit::print(&(report.lines().join("\n") + "\n"))
}

fn options(args: &Args, loaded: &[Loaded]) -> Result<Options> {
    let base = args.base.as_deref().map(read_model_file).transpose()?.map(|f| f.spec);
    let base = match (base, loaded.iter().all(|l| l.is_table)) {
        (Some(base), _) => Some(base),
        (None, false) => None,
        (None, true) => {
            return Err(Failure::usage(
                "tables of motions do not say what machine they belong to; give --base",
            ));
        }
    };
    let prefer = args.prefer.iter().map(|text| preference(text, loaded)).collect::<Result<_, _>>()?;
    let average = match &args.average[..] {
        [] => None,
        [all] if all == "all" => Some(None),
        list => Some(Some(list.iter().map(|t| error_symbol(t)).collect::<Result<Vec<_>, _>>()?)),
    };
    for (name, value) in
        [("--assume-std-um", args.assume_std_um), ("--assume-std-arcsec", args.assume_std_arcsec)]
    {
        if let Some(bad) = value.filter(|v| !(v.is_finite() && *v > 0.0)) {
            return Err(usage!("{name} {bad} is not above 0"));
        }
    }
    if !(0.0..1.0).contains(&args.significance) {
        return Err(usage!("--significance {} is not from 0 to below 1", args.significance));
    }
    Ok(Options {
        base: base.map(|b| ModelSpec { machine: args.machine.clone().unwrap_or(b.machine.clone()), ..b }),
        prefer,
        average,
        significance: args.significance,
        std_length: args.assume_std_um.map(mm_from_um),
        std_angle: args.assume_std_arcsec.map(rad_from_arcsec),
    })
}

fn error_symbol(text: &str) -> Result<ErrorSymbol> {
    ErrorSymbol::parse(text)
        .ok_or_else(|| usage!("unknown error '{text}'; write a symbol such as exx or ec0y"))
}

/// `FILE` or `FILE:ERROR`.
fn preference(text: &str, loaded: &[Loaded]) -> Result<(usize, Option<ErrorSymbol>)> {
    let find = |name: &str| loaded.iter().position(|l| l.is_named(name));
    if let Some(index) = find(text) {
        return Ok((index, None));
    }
    if let Some((file, symbol)) = text.rsplit_once(':')
        && let Some(index) = find(file)
    {
        return Ok((index, Some(error_symbol(symbol)?)));
    }
    let names = loaded.iter().map(|l| l.source.name.as_str()).joined(", ");
    Err(usage!("--prefer {text}: no such input; inputs are {names}"))
}

/// The assembled model with where each error came from.
fn model_file(args: &Args, loaded: &[Loaded], done: &Assembled) -> ModelFile {
    let mut file = ModelFile::new(done.spec.clone());
    if let Some(machine) = &args.machine {
        file.spec.machine.clone_from(machine);
    }
    // entries that say nothing are left out
    file.spec.axes.retain(|a| *a != AxisSpec::new(a.name));
    let entries = loaded.iter().map(|l| SourceEntry {
        instrument: l.file.instrument.clone(),
        date: l.file.date.clone(),
        ..l.entry()
    });
    file.provenance.sources = entries.collect();
    // the model as a whole holds no longer than the first of its parts
    file.provenance.expiry = loaded.iter().filter_map(|l| l.file.expiry.clone()).min();
    for origin in &done.errors {
        let provenance = match &origin.from[..] {
            [(only, _)] => of_one(&loaded[*only], origin.symbol),
            several => Provenance {
                sources: several.iter().map(|(i, _)| entry_for(&loaded[*i], origin.symbol)).collect(),
                ..Provenance::default()
            },
        };
        if file.spec.error(origin.symbol).is_some() {
            file.of_errors.push((origin.symbol, provenance));
        }
    }
    file.of_errors.sort_by_key(|(s, _)| *s);
    file
}

/// What an input says about an error; what it says about itself where it does not.
fn stated(loaded: &Loaded, symbol: ErrorSymbol) -> &Provenance {
    loaded.of_errors.iter().find(|(s, _)| *s == symbol).map_or(&loaded.file, |(_, p)| p)
}

fn entry_for(loaded: &Loaded, symbol: ErrorSymbol) -> SourceEntry {
    let own = stated(loaded, symbol);
    SourceEntry {
        instrument: own.instrument.clone().or_else(|| loaded.file.instrument.clone()),
        date: own.date.clone().or_else(|| loaded.file.date.clone()),
        ..loaded.entry()
    }
}

/// Provenance of an error from one input: the input and its hash; what that was made from is kept beside it.
fn of_one(loaded: &Loaded, symbol: ErrorSymbol) -> Provenance {
    let own = stated(loaded, symbol);
    let entry = entry_for(loaded, symbol);
    let mut sources = own.sources.clone();
    if own.source.is_some() || own.source_hash.is_some() {
        sources.push(SourceEntry {
            source: own.source.clone(),
            source_hash: own.source_hash.clone(),
            ..SourceEntry::default()
        });
    }
    Provenance {
        source: entry.source,
        source_hash: entry.source_hash,
        instrument: entry.instrument,
        date: entry.date,
        sources,
        ..own.clone()
    }
}
