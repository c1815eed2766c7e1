//! What a report that is handed over states beside its results: the head, tolerances with verdicts by ISO 14253-1, and lines
//! to sign. `docs/how-to/reports.md` is its description.

mod head_file;
pub(crate) mod verdicts;

use crate::prelude::*;
use head_file::Numbers;
pub(crate) use head_file::{Compensation, HeadFile, Text};
pub(crate) use verdicts::{Assessed, Judged, NOT_STATED, summary};

/// Arguments of every report that is handed over.
#[derive(Debug, Clone, Default, clap::Args)]
#[command(next_help_heading = "Head, tolerances and verdicts of the report")]
pub(crate) struct HeadArgs {
    /// Head of the report in TOML: machine, test, instrument, tolerances (docs/how-to/reports.md).
    #[arg(long, value_name = "HEAD.toml")]
    head: Option<PathBuf>,
    /// Model that compensated the machine in this test; name and hash enter the report.
    #[arg(long, value_name = "MODEL.toml")]
    active_model: Option<PathBuf>,
    /// Tolerance of a figure, such as a-um=8, beside those of the head; may be repeated.
    #[arg(long, value_name = "FIGURE=LIMIT", value_parser = tolerance)]
    tolerance: Vec<(String, f64)>,
}

impl HeadArgs {
    /// Arguments that name a head only.
    pub(crate) const fn of_head(head: Option<PathBuf>) -> Self {
        Self { head, active_model: None, tolerance: Vec::new() }
    }
}

fn tolerance(text: &str) -> Result<(String, f64), String> {
    let wrong = || format!("invalid tolerance '{text}'; write a figure and its limit, such as a-um=8");
    let (key, value) = text.split_once('=').ok_or_else(wrong)?;
    let value = value.parse::<f64>().ok().filter(|v| v.is_finite()).ok_or_else(wrong)?;
    Ok((toml_key(key), value))
}

/// The key of a figure in TOML and on the command line.
fn toml_key(json_key: &str) -> String {
    json_key.replace('_', "-")
}

/// What the files of the data state about the test.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Stated {
    /// Machine.
    pub(crate) machine: Option<String>,
    /// Its serial number.
    pub(crate) serial_number: Option<String>,
    /// Where it stands.
    pub(crate) location: Option<String>,
    /// Who measured.
    pub(crate) operator: Option<String>,
    /// Day of the test.
    pub(crate) date: Option<String>,
    /// Instrument.
    pub(crate) instrument: Option<String>,
    /// Temperature of the material at start and end, degrees Celsius.
    pub(crate) temperature_degc: Option<[f64; 2]>,
    /// Feed, mm/min.
    pub(crate) feed_mm_per_min: Option<f64>,
}

/// Head, tolerances and stated uncertainties of one test.
#[derive(Debug, Clone, Default)]
pub(crate) struct Acceptance {
    head: HeadFile,
    /// Model that was active: file and hash.
    model: Option<(String, String)>,
    tolerances: Numbers,
    uncertainties: Numbers,
}

impl Acceptance {
    /// Reads what the arguments name; `keys` are the figures of the test that may have a tolerance.
    pub(crate) fn load(args: &HeadArgs, test: &str, keys: &[String]) -> Result<Self> {
        let mut head = args.head.as_deref().map(HeadFile::read).transpose()?.unwrap_or_default();
        let keys: Vec<String> = keys.iter().map(|k| toml_key(k)).collect();
        let expected = format!("expected one of {}", keys.join(", "));
        let [mut tolerances, uncertainties] =
            [&mut head.tolerance, &mut head.uncertainty].map(|tests| tests.remove(test).unwrap_or_default());
        if let (Some(path), Some(key)) =
            (&args.head, tolerances.keys().chain(uncertainties.keys()).find(|k| !keys.contains(k)))
        {
            return Err(mistake!(path, "unknown figure `{key}` of {test}; {expected}"));
        }
        for (key, limit) in &args.tolerance {
            if !keys.contains(key) {
                let why = if keys.is_empty() { "this test has no tolerances" } else { &expected };
                return Err(usage!("--tolerance {key}: unknown figure; {why}"));
            }
            if *limit < 0.0 && !head_file::is_lower(key) {
                return Err(usage!("--tolerance {key}={limit}: expected 0 or above"));
            }
            tolerances.insert(key.clone(), *limit);
        }
        let mut model = None;
        if let Some(path) = &args.active_model {
            let (spec, _, hash) = crate::files::read_hashed_model(path)?;
            head.machine.name.get_or_insert(spec.machine);
            model = Some((file_name(path), hash));
        }
        Ok(Self { head, model, tolerances, uncertainties })
    }

    /// Completes the head with what the data state.
    pub(crate) fn fill(&mut self, stated: Stated) {
        fn or<T>(own: &mut Option<T>, other: Option<T>) {
            if own.is_none() {
                *own = other;
            }
        }
        let (machine, test) = (&mut self.head.machine, &mut self.head.test);
        or(&mut machine.name, stated.machine);
        or(&mut machine.serial_number, stated.serial_number.map(Text));
        or(&mut machine.location, stated.location);
        or(&mut test.operator, stated.operator);
        or(&mut test.date, stated.date.map(Text));
        or(&mut test.feed_mm_per_min, stated.feed_mm_per_min);
        or(&mut test.temperature_start_degc, stated.temperature_degc.map(|t| t[0]));
        or(&mut test.temperature_end_degc, stated.temperature_degc.map(|t| t[1]));
        or(&mut self.head.instrument.name, stated.instrument);
    }

    /// A figure with its tolerance; an uncertainty of the head takes the place of the computed one.
    pub(crate) fn assess(
        &self,
        key: &str,
        name: &'static str,
        value: Option<f64>,
        computed: Option<f64>,
    ) -> Assessed {
        let of = |numbers: &Numbers| numbers.get(&toml_key(key)).copied();
        let expanded = of(&self.uncertainties).or(computed);
        let limit = of(&self.tolerances);
        Assessed { key: key.to_owned(), name, value, expanded, compared: expanded, limit }
    }

    /// The head, two columns of key and value.
    pub(crate) fn head(&self, page: &mut Page) {
        let (machine, test, instrument) = (&self.head.machine, &self.head.test, &self.head.instrument);
        let text = |t: &Option<Text>| t.as_ref().map(|t| t.0.clone());
        let both = |parts: [Option<String>; 2]| {
            Some(parts.into_iter().flatten().joined(", ")).filter(|parts| !parts.is_empty())
        };
        let number = |v: Option<f64>, unit: &str| v.map(|v| format!("{v} {unit}"));
        let temperature = [test.temperature_start_degc, test.temperature_end_degc];
        let temperatures = temperature.iter().any(Option::is_some).then(|| {
            temperature.map(|t| t.map_or_else(|| NOT_STATED.to_owned(), |t| format!("{t:.1} °C"))).join(" / ")
        });
        let rows: [(&str, Option<String>); 16] = [
            ("machine", both([machine.manufacturer.clone(), machine.name.clone()])),
            ("instrument", instrument.name.clone()),
            ("serial number", text(&machine.serial_number)),
            ("its serial number", text(&instrument.serial_number)),
            ("control", machine.control.clone()),
            ("calibration certificate", text(&instrument.certificate)),
            ("location", machine.location.clone()),
            ("calibrated on", text(&instrument.calibrated)),
            ("date of the test", text(&test.date)),
            ("feed", number(test.feed_mm_per_min, "mm/min")),
            ("operator", test.operator.clone()),
            ("temperature, start / end", temperatures),
            ("customer", test.customer.clone()),
            ("warm-up", test.warm_up.clone()),
            ("active model", self.model.as_ref().map(|(name, _)| name.clone())),
            ("software", Some(software())),
        ];
        let value = |v: &Option<String>| match v {
            Some(v) => Cell::text(v),
            None => Cell::text(NOT_STATED).faint(),
        };
        let pairs =
            rows.chunks(2).map(|pair| pair.iter().flat_map(|(label, v)| [Cell::head(label), value(v)]));
        page.head_table(&pairs.map(Iterator::collect).collect::<Vec<Vec<Cell>>>());
        if let Some((_, hash)) = &self.model {
            page.note(format_args!("Hash of the active model: blake3 {hash}."));
        }
        if let Some(note) = &test.note {
            page.paragraph(note);
        }
    }

    /// `[compensation]` of the head.
    pub(crate) const fn compensation(&self) -> &Compensation {
        &self.head.compensation
    }
}

/// The rule of the verdicts, in small print.
pub(crate) const RULE: &str = "Verdicts by ISO 14253-1 with the expanded uncertainty U (k = 2) as guard band: conformity where \
    figure + U is within the tolerance, non-conformity where figure - U is beyond it, otherwise neither.";

/// Name and version of the program.
pub(crate) fn software() -> String {
    format!("volcomp {}", env!("CARGO_PKG_VERSION"))
}

/// Lines to sign.
pub(crate) fn sign(page: &mut Page) {
    page.html(
        "<div class=\"sign\"><div>Place and date</div><div>Measured by (name, signature)</div><div>Accepted by (name, \
         signature)</div></div>",
    );
}

/// The name of a file without its folder.
pub(crate) fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}
