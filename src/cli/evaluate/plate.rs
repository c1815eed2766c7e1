//! `evaluate plate`: a hole plate or ball plate, measured or made in a plane.

use std::io::Cursor;

use super::Output;
use super::page;
use super::picture::plate::{self as drawing, Shown};
use crate::prelude::*;
use crate::table::Table as Csv;
use volcomp_evaluate::plate::Estimate;
use volcomp_evaluate::{PlateFit, PlateModel, PlateNorm, PlatePoint};
use volcomp_formats::hole_plate;
use volcomp_model::statistics::normal_two_sided;

/// A hole plate or ball plate: offset, rotation, scale and squareness in a plane
///
/// Measured = offset + rotation and scale of nominal. For a calibrated plate measured on a machine, and for a plate
/// that a machine drilled, measured on a CMM: what a plate drilled by the machine shows is the machine's error itself.
/// Squareness is EC0Y of the plane: above zero the angle from X to Y is above 90 deg.
#[derive(Debug, clap::Parser)]
pub(crate) struct Args {
    /// CSV with nominal_x_mm,nominal_y_mm and measured_x_mm,measured_y_mm or deviation_x_um,deviation_y_um; or the table
    /// of a CMM (Meas X, Meas Y, Nom X, Nom Y, ..); - is stdin.
    #[arg(long, value_name = "FILE", required_unless_present = "file")]
    data: Option<PathBuf>,
    /// What may differ.
    #[arg(long, value_parser = one_of(MODELS), default_value = "affine")]
    model: PlateModel,
    /// What is minimised.
    #[arg(long, value_parser = one_of(NORMS), default_value = "l2")]
    norm: PlateNorm,
    /// Only holes of this nominal diameter, mm (column nominal_diameter_mm, Nom D).
    #[arg(long, value_name = "MM")]
    nominal_diameter_mm: Option<f64>,
    /// Standard uncertainty (k = 1) of a measured coordinate; gives a test of fit.
    #[arg(long, value_name = "UM")]
    std_um: Option<f64>,
    #[command(flatten)]
    output: Output,
}

const MODELS: &[(&str, &str, PlateModel)] = &[
    ("rigid", "Offset and rotation", PlateModel::Rigid),
    ("similarity", "And one scale", PlateModel::Similarity),
    ("affine", "And a scale for each axis, and squareness", PlateModel::Affine),
];
const NORMS: &[(&str, &str, PlateNorm)] = &[
    ("l2", "Sum of squares", PlateNorm::Squares),
    ("l4", "Sum of fourth powers, as some published fits of drilled plates", PlateNorm::Fourth),
];

/// A plate with its title.
struct Plate {
    title: Option<String>,
    points: Vec<PlatePoint>,
}

fn read(args: &Args) -> Result<Plate> {
    let path = args.output.data(&args.data);
    let text = input::read_text(path, InputKind::Table)?;
    let keep = |diameter: Option<f64>| match (args.nominal_diameter_mm, diameter) {
        (Some(wanted), Some(d)) => (d - wanted).abs() < 5e-4,
        _ => true,
    };
    let plate = if hole_plate::recognises(&text) {
        let plate = hole_plate::parse(&text).map_err(|e| format_failure(&path.display().to_string(), &e))?;
        let holes = plate.holes.iter().filter(|h| keep(Some(h.diameter)));
        Plate { points: holes.map(|h| h.place).collect(), title: Some(plate.title).filter(|t| !t.is_empty()) }
    } else {
        Plate { title: None, points: read_csv(args, text, keep)? }
    };
    if plate.points.is_empty() {
        return Err(data!(path, "no hole of the nominal diameter selected"));
    }
    Ok(plate)
}

fn read_csv(args: &Args, text: String, keep: impl Fn(Option<f64>) -> bool) -> Result<Vec<PlatePoint>> {
    let mut table = Csv::new(Cursor::new(text), args.output.data(&args.data).display().to_string())?;
    let nominal = [table.require("nominal_x_mm")?, table.require("nominal_y_mm")?];
    let deviations = table.find("deviation_x_um").is_some() || table.find("deviation_y_um").is_some();
    let names =
        if deviations { ["deviation_x_um", "deviation_y_um"] } else { ["measured_x_mm", "measured_y_mm"] };
    let values = [table.require(names[0])?, table.require(names[1])?];
    table.only(&["nominal_x_mm", "nominal_y_mm", names[0], names[1], "nominal_diameter_mm", "name"])?;
    let diameter = table.find("nominal_diameter_mm");
    if args.nominal_diameter_mm.is_some() && diameter.is_none() {
        let what = "holes are to be selected by diameter, but column nominal_diameter_mm is missing";
        return Err(data!(args.output.data(&args.data), "{what}"));
    }
    let points = table.some_rows(|table| {
        let at = |column: usize| table.number(column);
        let nominal = [at(nominal[0])?, at(nominal[1])?];
        let v = [at(values[0])?, at(values[1])?];
        let measured =
            if deviations { [nominal[0] + mm_from_um(v[0]), nominal[1] + mm_from_um(v[1])] } else { v };
        Ok(keep(diameter.map(at).transpose()?).then_some(PlatePoint { nominal, measured }))
    })?;
    Ok(points.into_iter().flatten().collect())
}

pub(super) fn run(args: &Args) -> Result<()> {
    let acceptance = Acceptance::load(&args.output.head, "", &[])?;
    let judged = Judged { acceptance, figures: Vec::new() };
    if let Some(bad) = args.std_um.filter(|s| !(s.is_finite() && *s > 0.0)) {
        return Err(usage!("--std-um {bad} is not above 0"));
    }
    let plate = read(args)?;
    let fit = PlateFit::new(&plate.points, args.model, args.norm, args.std_um.map(mm_from_um))
        .map_err(|e| data!(args.output.data(&args.data), "{e}"))?;
    refuse_implausible(args, &fit)?;
    let title = args.output.title(plate.title.as_deref().unwrap_or("Plate"));
    let shown = |title| Shown { title, points: &plate.points, fit: &fit };
    args.output.deliver(
        &judged,
        || drawing::whole(&shown(title)),
        || report(args, title, &judged, &plate, &fit),
        || (as_json(&plate, &fit), None),
        || {
            say!("{}: {title}, {} places", args.output.data(&args.data).display(), plate.points.len());
            estimates(&fit).print();
            quality(&fit).print();
        },
    )
}

/// Scale and squareness (rad) beyond which columns or units are wrong, not the machine.
const IMPLAUSIBLE: f64 = 0.01;

/// Refuses what no machine does: exchanged columns, other units.
fn refuse_implausible(args: &Args, fit: &PlateFit) -> Result<()> {
    let path = args.output.data(&args.data);
    let scales = fit.scales.into_iter().flatten().chain(fit.scale);
    if let Some(scale) = scales.map(|e| e.value).find(|v| v.abs() > IMPLAUSIBLE) {
        return Err(data!(
            path,
            "measured places are {:.4} times the nominal ones (limit 1 +- {IMPLAUSIBLE}): are all columns in mm, deviations in um, and \
             the columns of X and Y not exchanged?",
            1.0 + scale
        ));
    }
    if let Some(value) = fit.squareness.map(|e| e.value).filter(|v| v.abs() > IMPLAUSIBLE) {
        let [off, limit] = [value, IMPLAUSIBLE].map(deg_from_rad);
        return Err(data!(
            path,
            "the angle from X to Y would be {off:.3} deg off a right angle (limit {limit:.3} deg): are the nominal or the measured \
             columns of X and Y exchanged, or is one of them mirrored?"
        ));
    }
    Ok(())
}

/// Probability of a value at least as far from zero where it is zero.
fn p_value(e: Estimate) -> f64 {
    if e.std > 0.0 { normal_two_sided(e.value / e.std) } else { f64::from(u8::from(e.value == 0.0)) }
}

fn significance(e: Estimate) -> String {
    match p_value(e) {
        p if p < 0.01 => "significant".to_owned(),
        p => format!("not significant (p = {p:.2})"),
    }
}

fn quality(fit: &PlateFit) -> Table {
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
    Table::new(["", ""]).rows(out.into_iter().map(|(name, words)| [name.to_owned(), words]))
}

/// What was fitted, each with its standard uncertainty and whether it is significant.
fn estimates(fit: &PlateFit) -> Table {
    type Unit = (&'static str, usize, fn(f64) -> f64);
    const UM: Unit = ("um", 1, um_from_mm);
    const ARCSEC: Unit = ("arcsec", 2, arcsec_from_rad);
    const PPM: Unit = ("ppm", 1, |v| v * 1e6);
    let mut table = Table::new(["", ">value", ">u (k=1)", "", ""]);
    let mut add = |name: &str, (unit, d, out): Unit, e: Estimate, significance: String| {
        let [value, std] = [e.value, e.std].map(|v| format!("{:.d$}", out(v)));
        table.row([name, &value, &std, unit, &significance]);
    };
    add("offset X", UM, fit.offset[0], String::new());
    add("offset Y", UM, fit.offset[1], String::new());
    add("rotation", ARCSEC, fit.rotation, String::new());
    let [x, y] = [fit.scales.map(|s| s[0]), fit.scales.map(|s| s[1])];
    for (name, unit, found) in [
        ("scale, mean", PPM, fit.scale),
        ("scale X", PPM, x),
        ("scale Y", PPM, y),
        ("scale X - scale Y", PPM, fit.differential),
        ("squareness EC0Y", ARCSEC, fit.squareness),
    ] {
        found.into_iter().for_each(|e| add(name, unit, e, significance(e)));
    }
    table
}

fn as_json(plate: &Plate, fit: &PlateFit) -> Map<String, Value> {
    let estimate = |e: Estimate, f: fn(f64) -> f64| json!({"value": f(e.value), "std": f(e.std)});
    let ppm = |v: f64| v * 1e6;
    let report = json!({
        "points": plate.points.len(),
        "title": plate.title,
        "offset_x_mm": estimate(fit.offset[0], |v| v),
        "offset_y_mm": estimate(fit.offset[1], |v| v),
        "rotation_deg": estimate(fit.rotation, deg_from_rad),
        "scale_ppm": fit.scale.map(|e| estimate(e, ppm)),
        "scale_x_ppm": fit.scales.map(|[x, _]| estimate(x, ppm)),
        "scale_y_ppm": fit.scales.map(|[_, y]| estimate(y, ppm)),
        "scale_x_minus_y_ppm": fit.differential.map(|e| estimate(e, ppm)),
        "ec0y_arcsec": fit.squareness.map(|e| estimate(e, arcsec_from_rad)),
        "rms_before_um": um_from_mm(fit.rms_before),
        "rms_um": um_from_mm(fit.rms),
        "rms_left_out_um": fit.rms_left_out.map(um_from_mm),
        "largest_um": um_from_mm(fit.largest.1),
        "largest_point": fit.largest.0 + 1,
        "dof": fit.dof,
        "chi_square": fit.chi_square.map(|c| c.0),
        "p_value": fit.chi_square.map(|c| c.1),
        "residuals_um": fit.residuals.iter().map(|r| r.map(um_from_mm)).collect::<Vec<_>>(),
    });
    report.as_object().cloned().unwrap_or_default()
}

fn report(args: &Args, title: &str, judged: &Judged, plate: &Plate, fit: &PlateFit) -> Result<String> {
    let model = match args.model {
        PlateModel::Rigid => "offset and rotation",
        PlateModel::Similarity => "offset, rotation and one scale",
        PlateModel::Affine => "offset, rotation, scale of X and of Y, squareness",
    };
    let norm = match args.norm {
        PlateNorm::Squares => "sum of squares",
        PlateNorm::Fourth => "sum of fourth powers",
    };
    let places = plate.points.len().to_string();
    let facts = [("places", places), ("fitted", model.to_owned()), ("minimised", norm.to_owned())];
    let standard = "Plate in a plane: measured = offset + matrix times nominal";
    let mut page = args.output.page([&args.data, &None], (title, standard), judged, &facts);
    estimates(fit).put(&mut page);
    quality(fit).put(&mut page);
    page.figure(
        &drawing::whole(&Shown { title: "", points: &plate.points, fit })?,
        "Left: measured minus nominal. Right: what the fit leaves. Arrows start at the nominal place and are magnified as \
         the scales say; vermillion: the largest.",
    );
    Ok(page::finish(page, judged))
}
