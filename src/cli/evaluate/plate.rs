//! `evaluate plate`: a hole plate or ball plate, measured or made in a plane.

use std::io::Cursor;
use std::path::{Path, PathBuf};

use clap::ValueEnum;
use serde_json::{Map, Value, json};

use super::page::{self, Origin};
use super::picture::plate::{self as drawing, Shown};
use super::{Output, bad_data, only};
use crate::acceptance::Acceptance;
use crate::input::{self, InputKind};
use crate::positioning_data::no_rows;
use crate::report::page::Cell;
use crate::table::Table;
use crate::{EX_DATAERR, EX_USAGE, Failure};
use volcomp_evaluate::plate::Estimate;
use volcomp_evaluate::{PlateFit, PlateModel, PlateNorm, PlatePoint};
use volcomp_formats::hole_plate;
use volcomp_model::statistics::normal_two_sided;
use volcomp_units::{arcsec_from_rad, deg_from_rad, mm_from_um, um_from_mm};

/// A hole plate or ball plate: offset, rotation, scale and squareness in a plane
///
/// Measured = offset + rotation and scale of nominal. For a calibrated plate measured on a machine, and for a plate
/// that a machine drilled, measured on a CMM: what a plate drilled by the machine shows is the machine's error itself.
/// Squareness is EC0Y of the plane: above zero the angle from X to Y is above 90 deg.
#[derive(Debug, clap::Parser)]
pub(super) struct Args {
    /// CSV with nominal_x_mm,nominal_y_mm and measured_x_mm,measured_y_mm or deviation_x_um,deviation_y_um; or the table
    /// of a CMM (Meas X, Meas Y, Nom X, Nom Y, ..); - is stdin.
    #[arg(long, value_name = "FILE", required_unless_present = "file")]
    data: Option<PathBuf>,
    /// What may differ.
    #[arg(long, value_enum, default_value = "affine")]
    model: ModelArg,
    /// What is minimised.
    #[arg(long, value_enum, default_value = "l2")]
    norm: NormArg,
    /// Only holes of this nominal diameter, mm (column nominal_diameter_mm, Nom D).
    #[arg(long, value_name = "MM")]
    nominal_diameter_mm: Option<f64>,
    /// Standard uncertainty (k = 1) of a measured coordinate; gives a test of fit.
    #[arg(long, value_name = "UM")]
    std_um: Option<f64>,
    #[command(flatten)]
    output: Output,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum ModelArg {
    /// Offset and rotation.
    Rigid,
    /// And one scale.
    Similarity,
    /// And a scale for each axis, and squareness.
    Affine,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum NormArg {
    /// Sum of squares.
    L2,
    /// Sum of fourth powers, as some published fits of drilled plates.
    L4,
}

/// A plate with its title.
struct Plate {
    title: Option<String>,
    points: Vec<PlatePoint>,
}

fn read(args: &Args) -> Result<Plate, Failure> {
    let path = args.output.data(&args.data);
    let text = input::read_text(path, InputKind::Table)?;
    let keep = |diameter: Option<f64>| match (args.nominal_diameter_mm, diameter) {
        (Some(wanted), Some(d)) => (d - wanted).abs() < 5e-4,
        _ => true,
    };
    let plate = if hole_plate::recognises(&text) {
        let plate = hole_plate::parse(&text).map_err(|e| {
            let place = if e.line == 0 { String::new() } else { format!("{}:{}:", e.line, e.column) };
            Failure::new(EX_DATAERR, format_args!("error: {}:{place} {}", path.display(), e.kind))
        })?;
        let holes = plate.holes.iter().filter(|h| keep(Some(h.diameter)));
        Plate { points: holes.map(|h| h.place).collect(), title: Some(plate.title).filter(|t| !t.is_empty()) }
    } else {
        Plate { title: None, points: read_csv(args, text, keep)? }
    };
    if plate.points.is_empty() {
        return Err(bad_data(path, "no hole of the nominal diameter selected"));
    }
    Ok(plate)
}

fn read_csv(
    args: &Args,
    text: String,
    keep: impl Fn(Option<f64>) -> bool,
) -> Result<Vec<PlatePoint>, Failure> {
    let mut table = Table::new(Cursor::new(text), args.output.data(&args.data).display().to_string())?;
    let nominal = [table.require("nominal_x_mm")?, table.require("nominal_y_mm")?];
    let deviations = table.find("deviation_x_um").is_some() || table.find("deviation_y_um").is_some();
    let names =
        if deviations { ["deviation_x_um", "deviation_y_um"] } else { ["measured_x_mm", "measured_y_mm"] };
    let values = [table.require(names[0])?, table.require(names[1])?];
    only(&table, &["nominal_x_mm", "nominal_y_mm", names[0], names[1], "nominal_diameter_mm", "name"])?;
    let diameter = table.find("nominal_diameter_mm");
    if args.nominal_diameter_mm.is_some() && diameter.is_none() {
        return Err(bad_data(
            args.output.data(&args.data),
            "holes are to be selected by diameter, but column nominal_diameter_mm is missing",
        ));
    }
    let mut points = Vec::new();
    let mut rows = 0;
    while table.advance()? {
        rows += 1;
        let at = |column: usize| table.number(column);
        let nominal = [at(nominal[0])?, at(nominal[1])?];
        let v = [at(values[0])?, at(values[1])?];
        let measured =
            if deviations { [nominal[0] + mm_from_um(v[0]), nominal[1] + mm_from_um(v[1])] } else { v };
        if keep(diameter.map(at).transpose()?) {
            points.push(PlatePoint { nominal, measured });
        }
    }
    if rows == 0 { Err(no_rows(table.file())) } else { Ok(points) }
}

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    let acceptance = Acceptance::load(&args.output.head, "", &[])?;
    if let Some(bad) = args.std_um.filter(|s| !(s.is_finite() && *s > 0.0)) {
        return Err(Failure::new(EX_USAGE, format_args!("error: --std-um {bad} is not above 0")));
    }
    let plate = read(args)?;
    let model = match args.model {
        ModelArg::Rigid => PlateModel::Rigid,
        ModelArg::Similarity => PlateModel::Similarity,
        ModelArg::Affine => PlateModel::Affine,
    };
    let norm = match args.norm {
        NormArg::L2 => PlateNorm::Squares,
        NormArg::L4 => PlateNorm::Fourth,
    };
    let fit = PlateFit::new(&plate.points, model, norm, args.std_um.map(mm_from_um))
        .map_err(|e| bad_data(args.output.data(&args.data), e))?;
    let given = args.output.title.as_deref().or(plate.title.as_deref());
    let title = given.unwrap_or("Plate");
    let shown = |title| Shown { title, points: &plate.points, fit: &fit };
    args.output
        .write(|| drawing::whole(&shown(title)), || report(args, (title, &acceptance), &plate, &fit))?;
    if args.output.json {
        say!("{:#}", Value::Object(as_json(&plate, &fit)));
        return Ok(());
    }
    let stdout_taken =
        [&args.output.svg, &args.output.report].into_iter().flatten().any(|p| p.as_os_str() == "-");
    if !stdout_taken {
        print(args.output.data(&args.data), title, &plate, &fit);
    }
    Ok(())
}

/// One line of the result: words, unit, value, standard uncertainty, significance.
struct Line {
    name: &'static str,
    unit: &'static str,
    decimals: usize,
    of: Estimate,
    /// Whether "is it zero?" is a question.
    tested: bool,
}

fn lines(fit: &PlateFit) -> Vec<Line> {
    let scaled = |e: Estimate, f: fn(f64) -> f64| Estimate { value: f(e.value), std: f(e.std) };
    let line = |name, unit, decimals, of, tested| Line { name, unit, decimals, of, tested };
    let ppm = |v: f64| v * 1e6;
    let mut out = vec![
        line("offset X", "µm", 1, scaled(fit.offset[0], um_from_mm), false),
        line("offset Y", "µm", 1, scaled(fit.offset[1], um_from_mm), false),
        line("rotation", "arcsec", 2, scaled(fit.rotation, arcsec_from_rad), false),
    ];
    out.extend(fit.scale.map(|e| line("scale, mean", "ppm", 1, scaled(e, ppm), true)));
    if let Some([x, y]) = fit.scales {
        out.push(line("scale X", "ppm", 1, scaled(x, ppm), true));
        out.push(line("scale Y", "ppm", 1, scaled(y, ppm), true));
    }
    out.extend(fit.differential.map(|e| line("scale X - scale Y", "ppm", 1, scaled(e, ppm), true)));
    out.extend(
        fit.squareness.map(|e| line("squareness EC0Y", "arcsec", 2, scaled(e, arcsec_from_rad), true)),
    );
    out
}

/// Probability of a value at least as far from zero where it is zero.
fn p_value(e: Estimate) -> f64 {
    if e.std > 0.0 { normal_two_sided(e.value / e.std) } else { f64::from(u8::from(e.value == 0.0)) }
}

fn significance(line: &Line) -> String {
    match line.tested.then(|| p_value(line.of)) {
        None => String::new(),
        Some(p) if p < 0.01 => "significant".to_owned(),
        Some(p) => format!("not significant (p = {p:.2})"),
    }
}

fn quality(fit: &PlateFit) -> Vec<(&'static str, String)> {
    let mut out = vec![
        ("radial rms before", format!("{:.2} µm", um_from_mm(fit.rms_before))),
        ("radial rms of the residuals", format!("{:.2} µm", um_from_mm(fit.rms))),
    ];
    out.extend(
        fit.rms_left_out.map(|r| ("each predicted by the others", format!("{:.2} µm", um_from_mm(r)))),
    );
    out.push((
        "largest residual",
        format!("{:.2} µm, place {}", um_from_mm(fit.largest.1), fit.largest.0 + 1),
    ));
    out.extend(fit.chi_square.map(|(chi, p)| {
        let verdict = if p < 0.01 {
            "more than the stated uncertainty explains"
        } else {
            "explained by the stated uncertainty"
        };
        ("test of fit", format!("chi2 {chi:.1} for {} degrees of freedom, p = {p:.2e}: {verdict}", fit.dof))
    }));
    out
}

fn print(file: &Path, title: &str, plate: &Plate, fit: &PlateFit) {
    say!("{}: {title}, {} places", file.display(), plate.points.len());
    say!("{:<28}{:>12}{:>12}", "", "value", "u (k=1)");
    for l in lines(fit) {
        let (value, std, d) = (l.of.value, l.of.std, l.decimals);
        let unit = l.unit.replace('µ', "u");
        let line = format!("{:<28}{value:>12.d$}{std:>12.d$} {unit:<7} {}", l.name, significance(&l));
        say!("{}", line.trim_end());
    }
    for (name, text) in quality(fit) {
        say!("{name:<28} {}", text.replace('µ', "u"));
    }
}

fn as_json(plate: &Plate, fit: &PlateFit) -> Map<String, Value> {
    let estimate = |e: Estimate, f: fn(f64) -> f64| json!({"value": f(e.value), "std": f(e.std)});
    let ppm = |v: f64| v * 1e6;
    let mut out = Map::new();
    let mut put = |key: &str, value: Value| {
        out.insert(key.to_owned(), value);
    };
    put("points", json!(plate.points.len()));
    put("title", json!(plate.title));
    put("offset_x_mm", estimate(fit.offset[0], |v| v));
    put("offset_y_mm", estimate(fit.offset[1], |v| v));
    put("rotation_deg", estimate(fit.rotation, deg_from_rad));
    put("scale_ppm", json!(fit.scale.map(|e| estimate(e, ppm))));
    put("scale_x_ppm", json!(fit.scales.map(|[x, _]| estimate(x, ppm))));
    put("scale_y_ppm", json!(fit.scales.map(|[_, y]| estimate(y, ppm))));
    put("scale_x_minus_y_ppm", json!(fit.differential.map(|e| estimate(e, ppm))));
    put("ec0y_arcsec", json!(fit.squareness.map(|e| estimate(e, arcsec_from_rad))));
    put("rms_before_um", json!(um_from_mm(fit.rms_before)));
    put("rms_um", json!(um_from_mm(fit.rms)));
    put("rms_left_out_um", json!(fit.rms_left_out.map(um_from_mm)));
    put("largest_um", json!(um_from_mm(fit.largest.1)));
    put("largest_point", json!(fit.largest.0 + 1));
    put("dof", json!(fit.dof));
    put("chi_square", json!(fit.chi_square.map(|c| c.0)));
    put("p_value", json!(fit.chi_square.map(|c| c.1)));
    let residuals: Vec<[f64; 2]> = fit.residuals.iter().map(|r| r.map(um_from_mm)).collect();
    put("residuals_um", json!(residuals));
    out
}

fn report(
    args: &Args,
    (title, acceptance): (&str, &Acceptance),
    plate: &Plate,
    fit: &PlateFit,
) -> Result<String, Box<dyn std::error::Error>> {
    let model = match args.model {
        ModelArg::Rigid => "offset and rotation",
        ModelArg::Similarity => "offset, rotation and one scale",
        ModelArg::Affine => "offset, rotation, scale of X and of Y, squareness",
    };
    let norm = match args.norm {
        NormArg::L2 => "sum of squares",
        NormArg::L4 => "sum of fourth powers",
    };
    let facts = [
        ("places", plate.points.len().to_string()),
        ("fitted", model.to_owned()),
        ("minimised", norm.to_owned()),
    ];
    let origins = [Origin::of("data", args.output.data(&args.data))];
    let mut page = page::start(
        title,
        "Plate in a plane: measured = offset + matrix times nominal",
        acceptance,
        &[],
        &origins,
        &facts,
    );
    let head =
        [Cell::head(""), Cell::number("value"), Cell::number("u (k=1)"), Cell::head(""), Cell::head("")];
    let rows: Vec<Vec<Cell>> = lines(fit)
        .iter()
        .map(|l| {
            let number = |v: f64| Cell::number(format!("{v:.d$}", d = l.decimals));
            vec![
                Cell::head(l.name),
                number(l.of.value),
                number(l.of.std),
                Cell::text(l.unit),
                Cell::text(significance(l)),
            ]
        })
        .collect();
    page.table(&head, &rows);
    let rows: Vec<Vec<Cell>> =
        quality(fit).into_iter().map(|(n, t)| vec![Cell::head(n), Cell::text(t)]).collect();
    page.table(&[], &rows);
    let shown = Shown { title: "", points: &plate.points, fit };
    page.figure(
        &drawing::whole(&shown)?,
        "Left: measured minus nominal. Right: what the fit leaves. Arrows start at the nominal place and are magnified as \
         the scales say; vermillion: the largest.",
    );
    Ok(page::finish(page, &[]))
}
