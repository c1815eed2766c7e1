//! `model report`: what ISO/TR 16907 asks the documentation of a compensation to state, on one page.

use super::gauge::NEGLIGIBLE;
use super::picture;
use super::report::Report;
use crate::acceptance::{HeadArgs, NOT_STATED, sign};
use crate::check::Size;
use crate::files::read_model_file;
use crate::prelude::*;
use volcomp_model::curve::Interpolation;
use volcomp_model::extremes::search;
use volcomp_model::gauge::normalise;

/// Write the documentation of a compensation on one page: what ISO/TR 16907 asks for
///
/// Error functions with grid, interpolation and extrapolation; compensations of the control that stay active; validation;
/// what is not compensated; limits; day of the next check. What the files do not state is marked as not stated.
///
/// Example: volcomp model report model.toml --config machine.toml --head head.toml --validation x.json --html model.html
#[derive(Debug, clap::Parser)]
pub(crate) struct Args {
    /// Model file (volcomp-model/1)
    #[arg(value_name = "MODEL")]
    file: PathBuf,
    /// Where to write the page; - is stdout
    #[arg(long, value_name = "OUT.html", visible_alias = "report")]
    html: PathBuf,
    /// Machine file of volcompd: limits and axes that are offset
    #[arg(long, value_name = "MACHINE.toml")]
    config: Option<PathBuf>,
    /// Head of the report in TOML: machine, instrument, compensations of the control, validation (docs/how-to/reports.md)
    #[arg(long, value_name = "HEAD.toml")]
    head: Option<PathBuf>,
    /// A comparison that volcomp verify --json wrote; may be repeated
    #[arg(long, value_name = "VERIFY.json")]
    validation: Vec<PathBuf>,
    /// One JSON object on stdout
    #[arg(long)]
    json: bool,
}

pub(super) fn run(args: &Args) -> Result<()> {
    if args.json && args.html.as_os_str() == "-" {
        return Err(Failure::usage("--json and the page cannot both go to stdout"));
    }
    let file = read_model_file(&args.file)?;
    let model = Model::new(&file.spec).map_err(|e| Failure::new(EX_CONFIG, e))?;
    let machine = args.config.as_deref().map(crate::status::machine).transpose()?;
    if let Some(other) = machine.as_ref().filter(|m| m.machine != file.spec.machine) {
        let [own, other] = [&file.spec.machine, &other.machine];
        return Err(mistake!(args.file, "the model is of machine {own}, the machine file of {other}"));
    }
    let mut acceptance = Acceptance::load(&HeadArgs::of_head(args.head.clone()), "", &[])?;
    acceptance.fill(Stated {
        machine: Some(file.spec.machine.clone()),
        operator: file.provenance.operator.clone(),
        date: file.provenance.date.clone(),
        instrument: file.provenance.instrument.clone(),
        temperature_degc: file.provenance.temperature_degc.map(|t| [t; 2]),
        ..Stated::default()
    });
    let mut validations = stated_validations(&acceptance);
    for path in &args.validation {
        validations.push(read_validation(path)?);
    }
    let found = search(&file.spec, &model, |_, _| {});
    let name = file_name(&args.file);
    let documented = Documented {
        file: &file,
        machine: machine.as_ref(),
        acceptance: &acceptance,
        validations: &validations,
        report: Report { file: &file, name: &name, found: &found },
        hash: input::hash(&args.file, InputKind::Model),
    };
    write_text(&args.html, &documented.page(&model)?)?;
    if args.json {
        say!("{:#}", documented.json());
    } else if args.html.as_os_str() != "-" {
        note!("report written: {}", args.html.display());
    }
    Ok(())
}

/// A measurement with the compensation active: measurement, date, instrument, points, without to with compensation.
type Validation = [String; 5];

fn stated_validations(acceptance: &Acceptance) -> Vec<Validation> {
    let sizes = |b: f64, a: f64| format!("{} to {} µm", plain(b, 2), plain(a, 2));
    let of = acceptance.compensation().validation.iter().map(|v| {
        [
            v.measurement.clone(),
            v.date.as_ref().map(|d| d.0.clone()),
            v.instrument.clone(),
            v.points.map(|n| n.to_string()),
            v.before_um.zip(v.after_um).map(|(b, a)| sizes(b, a)),
        ]
        .map(or_not_stated)
    });
    of.collect()
}

fn or_not_stated(words: Option<String>) -> String {
    words.unwrap_or_else(|| NOT_STATED.to_owned())
}

/// Reads what `volcomp verify --json` wrote.
fn read_validation(path: &std::path::Path) -> Result<Validation> {
    let text = input::read_text(path, InputKind::Case)?;
    let wrong = |what: &str| data!(path, "{what}; expected the output of volcomp verify --json");
    let report: Value = serde_json::from_str(&text).map_err(|e| wrong(&e.to_string()))?;
    let test = report["test"].as_str().ok_or_else(|| wrong("no test"))?;
    let size = |unit: &str, words: &str| -> Option<String> {
        let of = |when: &str| {
            let value = report["range"][format!("{when}_{unit}")].as_f64()?;
            let u = report["range"][format!("{when}_u95_{unit}")].as_f64();
            Some(plain(value, 2) + &u.map_or(String::new(), |u| format!(" ± {u:.2}")))
        };
        Some(format!("range of the means {} to {} {words}", of("before")?, of("after")?))
    };
    let sizes = size("um", "µm").or_else(|| size("arcsec", "arcsec")).ok_or_else(|| wrong("no range"))?;
    let points = report["readings"][1].as_u64().map(|n| n.to_string());
    let measurement = format!("{test}, {}", file_name(path));
    Ok([Some(measurement), None, None, points, Some(sizes)].map(or_not_stated))
}

struct Documented<'a> {
    file: &'a ModelFile,
    machine: Option<&'a MachineConfig>,
    acceptance: &'a Acceptance,
    validations: &'a [Validation],
    report: Report<'a>,
    hash: Option<String>,
}

impl Documented<'_> {
    const fn spec(&self) -> &ModelSpec {
        &self.file.spec
    }

    fn page(&self, model: &Model) -> Result<String> {
        let spec = self.spec();
        let mut page = Page::new(&format!("Compensation of {}", spec.machine));
        page.html("<div class=\"dense\">");
        page.paragraph(
            "Documentation of the numerical compensation of geometric errors, after ISO/TR 16907:2015",
        );
        self.acceptance.head(&mut page);
        let hash = self.hash.as_ref().map_or(String::new(), |h| format!(", blake3 {h}"));
        let axes = spec.chain.axes().iter().filter(|a| !a.spindle).map(|a| self.axis(a.name)).joined("; ");
        page.facts([
            ("model file", format!("{}{hash}", self.report.name)),
            ("kinematic representation", format!("{}; {axes}", spec.chain)),
            ("determined from", or_not_stated(origin(&self.file.provenance))),
            ("re-check", or_not_stated(self.re_check())),
        ]);
        let [covered, all] = [self.covered().len(), spec.chain.error_symbols().len()];
        page.heading(format_args!("Error functions, {covered} of {all}"));
        self.functions(&mut page);
        page.heading("Application");
        self.application(&mut page);
        page.heading("Validation");
        self.validation(&mut page);
        page.heading("Not compensated");
        page.list(&self.not_compensated());
        sign(&mut page);
        page.html("</div>");
        if let Some(volume) = picture::distorted(spec, model)? {
            page.sheet("Errors predicted in the working volume");
            page.picture(&volume);
        }
        Ok(page.finish())
    }

    /// Travel of an axis.
    fn axis(&self, name: AxisName) -> String {
        let travel = self.spec().axis(name).travel;
        travel.map_or_else(
            || format!("{name}: travel not stated"),
            |range| format!("{name} {}", range_words(name, range)),
        )
    }

    /// The day of the next check: of the head, else the expiry of the model.
    fn re_check(&self) -> Option<String> {
        let stated = self.acceptance.compensation().re_check.as_ref().map(|d| d.0.clone());
        stated.or_else(|| self.file.earliest_expiry().map(|day| format!("{day} (expiry of the model)")))
    }

    /// Symbols with an error function that the chain has.
    fn covered(&self) -> Vec<ErrorSymbol> {
        let of = |s: &ErrorSymbol| self.spec().error(*s).is_some();
        self.spec().chain.error_symbols().into_iter().filter(of).collect()
    }

    fn functions(&self, page: &mut Page) {
        // errors determined elsewhere than the file as a whole
        let of_file = origin(&self.file.provenance);
        let own = |symbol: ErrorSymbol| {
            self.file.origin_of(symbol).and_then(origin).filter(|o| Some(o) != of_file.as_ref())
        };
        let apart = self.spec().errors.iter().any(|(s, _)| own(*s).is_some());
        let heads =
            ["", "error", "function, grid, interpolation", "over", ">lowest to highest", ">U (k = 2)"];
        let rows = self.spec().errors.iter().map(|(symbol, function)| {
            let size = Size::of(*symbol, function, self.spec());
            let (unit, position) = (size.unit, position_unit(symbol.axis()));
            let over = size.range.map_or("everywhere".to_owned(), |[a, b]| format!("{a} to {b} {position}"));
            let mut row = vec![
                symbol.to_string(),
                meaning(*symbol).to_owned(),
                representation(*symbol, function),
                over,
                span(size.low, size.high, unit),
                or_not_stated(
                    function.std.map(|s| format!("{} {unit}", plain(2.0 * error_out(*symbol, s), 2))),
                ),
            ];
            row.extend(apart.then(|| own(*symbol).unwrap_or_else(|| "as the file".to_owned())));
            row
        });
        Table::new(heads.into_iter().chain(apart.then_some("determined from"))).rows(rows).put_stacked(page);
    }

    fn application(&self, page: &mut Page) {
        let mut rows: Vec<(&str, String)> = vec![
            (
                "interpolation",
                "as listed for each function, evaluated at the commanded position of every cycle; sums of terms and axes through \
                 the kinematic chain"
                    .to_owned(),
            ),
            ("extrapolation", self.extrapolation()),
            ("compensations of the control that stay active", self.native()),
            ("applied by", self.applied()),
        ];
        if let Some(machine) = self.machine {
            let limit = |a: &volcomp_config::machine::AxisConfig| {
                format!("{} {} {}", a.name, offset_out(a.name, a.limits.size), micro(offset_unit(a.name)))
            };
            let limits: Vec<String> = machine.axes.iter().map(limit).collect();
            rows.push(("limits of the correction", limits.join(", ")));
            let window = machine.guard.temperature_degc.map(|[low, high]| format!("{low} to {high} °C"));
            rows.push(("temperatures for which it holds", or_not_stated(window)));
        }
        let words = self.report.worst_words();
        rows.push(("errors predicted without it", micro(&words)));
        page.facts(rows);
    }

    /// What happens outside of the functions' ranges, and where they are narrower than the travel.
    fn extrapolation(&self) -> String {
        let held = "none: outside the range of a function its end value is held and the point is flagged";
        let notes = crate::check::model_notes(self.file).into_iter();
        let short = notes.filter(|n| n.contains("its end value is held"));
        let short = short.map(|n| n.split(';').next().unwrap_or(&n).to_owned()).joined("; ");
        if short.is_empty() {
            format!("{held}; every function covers the travel stated")
        } else {
            format!("{held}; {short}")
        }
    }

    /// Compensations of the control.
    fn native(&self) -> String {
        match &self.acceptance.compensation().native {
            None => NOT_STATED.to_owned(),
            Some(none) if none.is_empty() => "none".to_owned(),
            Some(list) => list.join("; "),
        }
    }

    fn applied(&self) -> String {
        let axes = match self.machine {
            Some(machine) => machine.axes.iter().map(|a| a.name.to_string()).joined(", "),
            None => NOT_STATED.to_owned(),
        };
        format!("offsets of the axes, each cycle; axes offset: {axes}")
    }

    fn validation(&self, page: &mut Page) {
        if self.validations.is_empty() {
            page.paragraph(NOT_STATED);
            return;
        }
        let head = ["measurement", "date", "instrument", "points", "without to with compensation"];
        Table::new(head).rows(self.validations).put_stacked(page);
    }

    /// Squarenesses and location errors without a function of their own that slopes and offsets of other curves hold, rad
    /// or mm.
    fn held_by_curves(&self) -> Vec<(ErrorSymbol, f64)> {
        let (covered, own) = (self.covered(), self.spec().chain.error_symbols());
        let is_open = |s: &ErrorSymbol| own.contains(s) && !covered.contains(s);
        let gauged = normalise(self.spec()).ok();
        let all = gauged.into_iter().flat_map(|g| g.total.errors);
        all.filter(|(s, amount)| is_open(s) && error_out(*s, *amount).abs() > NEGLIGIBLE).collect()
    }

    /// What follows from model and machine file, and what the head adds.
    fn not_compensated(&self) -> Vec<String> {
        let spec = self.spec();
        let covered = self.covered();
        let mut out = Vec::new();
        let held = self.held_by_curves();
        let is_held = |s: &ErrorSymbol| held.iter().any(|(other, _)| other == s);
        let symbols = spec.chain.error_symbols().into_iter();
        let left = symbols.filter(|s| !covered.contains(s) && !is_held(s)).joined(" ");
        out.push(if left.is_empty() {
            "no error motion, squareness or location error of the chain is without a function".to_owned()
        } else {
            format!("without a function: {left}")
        });
        if !held.is_empty() {
            let words = |(s, amount): &(ErrorSymbol, f64)| {
                format!("{s} {} {}", signed(error_out(*s, *amount), 2), error_unit(*s))
            };
            let all = held.iter().map(words).joined(", ");
            out.push(format!(
                "compensated as slopes or offsets of other curves: {all} (volcomp model normalise gives them functions of their own)"));
        }
        if let Some(machine) = self.machine {
            let never = machine.uncorrected_axes(spec);
            if !never.is_empty() {
                let names = never.iter().joined(", ");
                out.push(format!("axes that are never offset: {names}"));
            }
        }
        let rotary = spec.chain.axes().iter().any(|a| !a.spindle && a.name.kind() == AxisKind::Rotary);
        if !rotary {
            out.push(
                "orientation of the tool: the displacement that angular errors cause at the tool tip is corrected, the \
                 angle stays"
                    .to_owned(),
            );
        }
        if self.file.growths_in_use().next().is_none() {
            out.push("thermal displacement: the model has no thermal term".to_owned());
        }
        if !spec.errors.iter().any(|(_, f)| !f.dynamics.is_empty()) {
            out.push("errors that depend on direction, velocity or acceleration, beyond reverse branches of tables".to_owned());
        }
        out.push(
            "errors that do not repeat; deformation by cutting force and workpiece; tool wear".to_owned(),
        );
        out.extend(self.acceptance.compensation().not_compensated.iter().cloned());
        out
    }

    fn json(&self) -> Value {
        let symbols = |list: Vec<ErrorSymbol>| list.into_iter().map(key).collect::<Vec<_>>();
        let covered = self.covered();
        let left = self.spec().chain.error_symbols().into_iter().filter(|s| !covered.contains(s)).collect();
        let functions = self.spec().errors.iter();
        let functions =
            functions.map(|(s, f)| json!({ "symbol": key(*s), "representation": representation(*s, f) }));
        json!({
            "machine": self.spec().machine,
            "model_hash": self.hash,
            "covered": symbols(covered),
            "without_function": symbols(left),
            "functions": functions.collect::<Value>(),
            "extrapolation": self.extrapolation(),
            "native_compensations": self.acceptance.compensation().native,
            "not_compensated": self.not_compensated(),
            "validations": self.validations.len(),
            "re_check": self.re_check(),
        })
    }
}

/// Instrument, day and file of a determination, where stated.
fn origin(p: &Provenance) -> Option<String> {
    let stated = [&p.instrument, &p.date, &p.source].into_iter().flatten().joined(", ");
    Some(stated).filter(|stated| !stated.is_empty())
}

fn meaning(symbol: ErrorSymbol) -> &'static str {
    match symbol {
        ErrorSymbol::Motion { .. } => picture::meaning(symbol),
        ErrorSymbol::Squareness { .. } => "squareness",
        ErrorSymbol::Location { .. } => "location",
    }
}

/// Function, grid and interpolation of an error.
fn representation(symbol: ErrorSymbol, function: &ErrorFunction) -> String {
    let unit = position_unit(symbol.axis());
    let step = |positions: &[f64], axis: AxisName| {
        let steps = positions.windows(2).map(|w| position_out(axis, w[1]) - position_out(axis, w[0]));
        let (low, high) = steps.fold((f64::INFINITY, 0.0f64), |(l, h), s| (l.min(s), h.max(s)));
        if high - low < 1e-6 * high {
            format!("every {} {}", rounded(high), position_unit(axis))
        } else {
            format!("every {} to {} {}", rounded(low), rounded(high), position_unit(axis))
        }
    };
    let curve = |c: &Curve| match c {
        Curve::Constant(_) => "constant".to_owned(),
        Curve::Table(t) => {
            let (positions, _, reverse) = t.columns();
            let how = match t.interpolation() {
                Interpolation::Linear => "linear",
                Interpolation::MonotoneCubic => "monotone cubic",
            };
            let both = if reverse.is_some() { ", both directions" } else { "" };
            let points = counted(positions.len(), "point");
            format!("table, {points} {}, {how}{both}", step(positions, symbol.axis()))
        }
        Curve::Fourier(f) => format!("Fourier {}", counted(f.harmonics().len(), "harmonic")),
        Curve::HalfRange(h) => format!("sine half waves, {}", counted(h.coefficients().2.count(), "term")),
        Curve::Chebyshev(c) => {
            format!("Chebyshev degree {}", c.coefficients().len().saturating_sub(1))
        }
    };
    let mut terms: Vec<String> = function.curves.iter().map(curve).collect();
    terms.extend(function.grids.iter().map(|grid| {
        let along =
            |(i, axis)| format!("{axis} {} {}", grid.positions(i).len(), step(grid.positions(i), axis));
        format!("grid, {}, linear", grid.axes().enumerate().map(along).joined(", "))
    }));
    terms.extend(function.live.iter().map(|live| format!("live value of {}", live.sensor)));
    if !function.dynamics.is_empty() {
        terms.push(format!("{} that follow motion", counted(function.dynamics.len(), "term")));
    }
    if terms.is_empty() {
        return format!("no term over {unit}");
    }
    terms.join(" + ")
}

/// Lowest to highest value; one where both are the same.
fn span(low: f64, high: f64, unit: &str) -> String {
    let [low, high] = [low, high].map(|v| plain(v, 2));
    if low == high { format!("{low} {unit}") } else { format!("{low} to {high} {unit}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_states_its_grid() {
        use volcomp_model::curve::Table;
        let table = |positions: Vec<f64>, how| {
            let n = positions.len();
            ErrorFunction::single(Curve::Table(Table::new(positions, vec![0.0; n], None, how).unwrap()))
        };
        let exx = ErrorSymbol::parse("exx").unwrap();
        let even = representation(exx, &table(vec![0.0, 50.0, 100.0], Interpolation::Linear));
        assert_eq!(even, "table, 3 points every 50 mm, linear");
        let uneven = representation(exx, &table(vec![0.0, 10.0, 100.0], Interpolation::MonotoneCubic));
        assert_eq!(uneven, "table, 3 points every 10 to 90 mm, monotone cubic");
    }
}
