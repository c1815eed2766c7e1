//! `volcomp predict --circle`: the circle that the model predicts against the circle that a ballbar measured.

use super::Args;
use super::readings::live_values;
use crate::evaluate::circular::samples;
use crate::identify::ballbar::reading;
use crate::prelude::*;
use crate::report_page::{Page, Plot, Style, Table};
use volcomp_evaluate::circle_prediction::predict;
use volcomp_evaluate::{CirclePrediction, CircularReading, Circularity};
use volcomp_identify::ballbar::Plane;

/// A measured circle.
#[derive(Debug, clap::Args)]
pub(super) struct CircleArgs {
    /// Measured circle to compare with the prediction: angle_deg,deviation_um,direction; - is stdin.
    #[arg(long, value_name = "CSV", requires_all = ["centre_mm", "radius_mm"])]
    circle: Option<PathBuf>,
    /// Programmed X, Y, Z at the centre.
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true, requires = "circle")]
    centre_mm: Option<Vec3>,
    /// Nominal radius.
    #[arg(long, value_name = "MM", value_parser = above_zero, requires = "circle")]
    radius_mm: Option<f64>,
    /// Plane of the circle: xy, yz or zx.
    #[arg(long, value_name = "AXES", value_parser = one_of(PLANES), default_value = "xy")]
    plane: Plane,
    /// Print the figures as JSON.
    #[arg(long, requires = "circle")]
    json: bool,
    /// Report with the curves (HTML).
    #[arg(long = "html", value_name = "FILE.html", alias = "report", requires = "circle")]
    report: Option<PathBuf>,
}

const PLANES: &[(&str, &str, Plane)] = &[("xy", "", Plane::Xy), ("yz", "", Plane::Yz), ("zx", "", Plane::Zx)];

impl CircleArgs {
    /// True where a circle is to be predicted.
    pub(super) const fn is_wanted(&self) -> bool {
        self.circle.is_some()
    }
}

pub(super) fn run(args: &Args) -> Result<()> {
    let c = &args.circle;
    let (Some(path), Some(centre), Some(radius)) = (&c.circle, c.centre_mm, c.radius_mm) else {
        return Err(Failure::usage("--circle needs --centre-mm and --radius-mm"));
    };
    if !args.add.is_empty() {
        return Err(usage!(
            "--add acts on tables with times; for --circle write the addition into the model with volcomp model extend"
        ));
    }
    let (_, model) = read_model(&args.model)?;
    let readings: Vec<CircularReading> = samples(path)?.iter().map(reading).collect();
    let live = live_values(&args.model, &model, &args.reading)?;
    let [a, b] = c.plane.axes();
    let predicted = predict(&model, &live, &readings, (centre, radius), [a, b], args.exact)
        .ok_or_else(|| usage!("--plane: the chain of the model has no axes {a} and {b}"))?;
    let result = CirclePrediction::new(&readings, &predicted, radius).map_err(|e| data!(path, "{e}"))?;
    if let Some(report) = &c.report {
        write_text(report, &page(&result, &readings, args, path))?;
    }
    if c.json {
        say!("{:#}", as_json(&result, readings.len()));
    } else if c.report.as_deref() != Some(Path::new("-")) {
        table(&result).print();
    }
    Ok(())
}

/// Figures with their keys: um, except the reduction.
fn figures(r: &CirclePrediction) -> [(&'static str, &'static str, f64); 7] {
    let g = |c: &Circularity| um_from_mm(CirclePrediction::g(c));
    [
        ("g_measured_um", "circular error G, measured", g(&r.measured)),
        ("g_predicted_um", "circular error G, predicted", g(&r.predicted)),
        ("residual_max_um", "residual, largest", um_from_mm(r.largest)),
        ("residual_rms_um", "residual, RMS", um_from_mm(r.rms)),
        ("residual_radius_um", "residual, mean radius", um_from_mm(r.radius)),
        ("g_ideal_um", "circular error G after an ideal correction", g(&r.residual)),
        ("ideal_reduction_percent", "reduction by an ideal correction", 100.0 * r.ideal_reduction()),
    ]
}

fn as_json(r: &CirclePrediction, readings: usize) -> Value {
    let mut out: Map<String, Value> =
        figures(r).iter().map(|(key, _, value)| ((*key).to_owned(), json!(value))).collect();
    out.insert("centre_measured_um".to_owned(), json!(r.measured.centre.map(um_from_mm)));
    out.insert("centre_predicted_um".to_owned(), json!(r.predicted.centre.map(um_from_mm)));
    out.insert("readings".to_owned(), json!(readings));
    Value::Object(out)
}

fn table(r: &CirclePrediction) -> Table {
    let row = |(key, name, value): (&str, &str, f64)| match key.ends_with("percent") {
        true => [name.to_owned(), format!("{value:.1} %")],
        false => [name.to_owned(), format!("{value:.2} µm")],
    };
    Table::new(["figure", ">value"]).rows(figures(r).map(row))
}

/// The report: figures, both curves, the residual.
fn page(r: &CirclePrediction, readings: &[CircularReading], args: &Args, data: &Path) -> String {
    let mut page = Page::new("Predicted and measured circle");
    page.paragraph(format_args!("Model {}, measured circle {}.", args.model.display(), data.display()));
    table(r).put_stacked(&mut page);
    let step = (readings.len() / 720).max(1);
    let of = |c: &Circularity, travel: Travel| -> Vec<(f64, f64)> {
        let own = readings.iter().zip(&c.radial).filter(|(reading, _)| reading.travel == travel);
        let mut points: Vec<(f64, f64)> = own
            .step_by(step)
            .map(|(reading, radial)| (reading.angle.to_degrees().rem_euclid(360.0), um_from_mm(*radial)))
            .collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        points
    };
    let plot = |title: &str, travel: Travel| {
        Plot::new(title, "angle, deg", "radial error, µm")
            .with(Style::Line, "measured", of(&r.measured, travel))
            .with(Style::Line, "predicted", of(&r.predicted, travel))
            .with(Style::Line, "residual", of(&r.residual, travel))
    };
    page.charts(&[plot("counter-clockwise", Travel::Forward), plot("clockwise", Travel::Reverse)]);
    page.note("Each about its own least-squares centre; the mean radius is kept.");
    page.finish()
}
