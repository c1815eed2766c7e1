//! `volcomp predict --circle`: the circle that the model predicts against the circle that a ballbar measured.

use core::f64::consts::{FRAC_PI_2, PI};
use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::Args;
use super::readings::live_values;
use crate::arg_parsers::{above_zero, point};
use crate::files::{read_model, write_text};
use crate::positioning_data::no_rows;
use crate::report_page::{Entry, Plot, ReportPage, Style};
use crate::{EX_DATAERR, EX_USAGE, Failure, table};
use volcomp_evaluate::{CirclePrediction, CircularReading, Circularity};
use volcomp_model::geometry::Vec3;
use volcomp_model::{Model, Pose, SENSORS_MAX};
use volcomp_units::axes::{AxisKind, AxisName, MAX_AXES, Travel};
use volcomp_units::{mm_from_um, rad_from_deg, um_from_mm};

pub(super) const HELP: &str = "\
A measured circle:
  volcomp predict --model model.toml --circle ballbar.csv --centre-mm 343.507,-285.090,-286.430 --radius-mm 100

--circle reads angle_deg,deviation_um,direction (1 counter-clockwise, -1 clockwise), as volcomp evaluate iso230-4 does;
a column feed_mm_per_min is ignored. The model is evaluated at the programmed positions of the axes, in their
direction of travel; behind a reversal an axis rests until it has made up its lost motion. Eccentricities are taken out of measured, predicted and residual, because a ballbar does not know
where its centre is; the mean radius stays. The residual is what an ideal correction with this model leaves.";

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
    #[arg(long, value_name = "AXES", value_parser = ["xy", "yz", "zx"], default_value = "xy")]
    plane: String,
    /// Print the figures as JSON.
    #[arg(long, requires = "circle")]
    json: bool,
    /// Report with the curves (HTML).
    #[arg(long = "html", value_name = "FILE.html", alias = "report", requires = "circle")]
    report: Option<PathBuf>,
}

impl CircleArgs {
    /// True where a circle is to be predicted.
    pub(super) const fn is_wanted(&self) -> bool {
        self.circle.is_some()
    }

    fn plane(&self) -> [AxisName; 2] {
        match self.plane.as_str() {
            "yz" => [AxisName::Y, AxisName::Z],
            "zx" => [AxisName::Z, AxisName::X],
            _ => [AxisName::X, AxisName::Y],
        }
    }
}

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    let c = &args.circle;
    let (Some(path), Some(centre), Some(radius)) = (&c.circle, c.centre_mm, c.radius_mm) else {
        return Err(Failure::usage("--circle needs --centre-mm and --radius-mm"));
    };
    if !args.add.is_empty() {
        return Err(Failure::new(
            EX_USAGE,
            "error: --add acts on tables with times; for --circle write the addition into the model with volcomp model extend",
        ));
    }
    let (_, model) = read_model(&args.model)?;
    let readings = read(path)?;
    let live = live_values(&args.model, &model, &args.reading)?;
    let predicted = predict((&model, &live), &readings, centre, radius, c.plane(), args.exact)?;
    let result = CirclePrediction::new(&readings, &predicted, radius)
        .map_err(|e| Failure::new(EX_DATAERR, format_args!("error: {}: {e}", path.display())))?;
    if let Some(report) = &c.report {
        write_text(report, &page(&result, &readings, args, path))?;
    }
    if c.json {
        say!("{:#}", as_json(&result, readings.len()));
    } else if c.report.as_deref() != Some(Path::new("-")) {
        print(&result);
    }
    Ok(())
}

fn read(path: &Path) -> Result<Vec<CircularReading>, Failure> {
    let mut table = table::open(path)?;
    let (angle, deviation, direction) =
        (table.require("angle_deg")?, table.require("deviation_um")?, table.require("direction")?);
    let known = ["angle_deg", "deviation_um", "direction", "feed_mm_per_min"];
    if let Some(i) = table.columns().iter().position(|c| !known.contains(&c.as_str())) {
        return Err(table.fail(i, format_args!("unknown column; columns are {}", known.join(", "))));
    }
    let mut readings = Vec::new();
    while table.advance()? {
        readings.push(CircularReading {
            angle: rad_from_deg(table.number(angle)?),
            deviation: mm_from_um(table.number(deviation)?),
            travel: table.travel(direction)?,
        });
    }
    if readings.is_empty() {
        return Err(no_rows(table.file()));
    }
    Ok(readings)
}

/// Predicted radial error of every reading, mm.
fn predict(
    (model, live): (&Model, &[f64; SENSORS_MAX]),
    readings: &[CircularReading],
    centre: Vec3,
    radius: f64,
    plane: [AxisName; 2],
    exact: bool,
) -> Result<Vec<f64>, Failure> {
    let index = |name: AxisName| model.axes().position(|a| a.name == name);
    let [Some(first), Some(second)] = plane.map(index) else {
        let [a, b] = plane;
        return Err(Failure::new(
            EX_USAGE,
            format_args!("error: --plane: the chain of the model has no axes {a} and {b}"),
        ));
    };
    let mut home = [0.0; MAX_AXES];
    for (k, axis) in model.axes().enumerate().filter(|(_, a)| a.name.kind() == AxisKind::Linear) {
        if [AxisName::X, AxisName::Y, AxisName::Z].contains(&axis.name) {
            home[k] = centre[axis.name.direction()];
        }
    }
    let [u, v] = plane.map(AxisName::direction);
    let travel = |speed: f64| if speed < 0.0 { Travel::Reverse } else { Travel::Forward };
    let of = |r: &CircularReading| {
        let (sin, cos) = r.angle.sin_cos();
        let sense = if r.travel == Travel::Reverse { -1.0 } else { 1.0 };
        let mut pose = Pose::at(home);
        pose.live = *live;
        pose.position[first] += radius * cos;
        pose.position[second] += radius * sin;
        pose.travel[first] = travel(-sense * sin);
        pose.travel[second] = travel(sense * cos);
        let deviation = |pose: &Pose| {
            let (deviation, _) = if exact { model.correct_exact(pose) } else { model.correct(pose) };
            deviation.position
        };
        let settled = deviation(&pose);
        let mut now = settled;
        for (axis, direction, reversal) in [(first, u, 0.0), (second, v, FRAC_PI_2)] {
            let mut before = pose;
            before.travel[axis] = pose.travel[axis].reversed();
            let change = deviation(&before) - settled;
            let since = (sense * r.angle - reversal).rem_euclid(PI);
            let (moved, lost) = (radius * (1.0 - since.cos()), change[direction].abs());
            // behind a reversal the carriage rests until the drive has made up the lost motion
            if moved < lost {
                now += change * (1.0 - moved / lost);
            }
        }
        now[u] * cos + now[v] * sin
    };
    Ok(readings.iter().map(of).collect())
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
    let mut out: serde_json::Map<String, Value> =
        figures(r).iter().map(|(key, _, value)| ((*key).to_owned(), json!(value))).collect();
    out.insert("centre_measured_um".to_owned(), json!(r.measured.centre.map(um_from_mm)));
    out.insert("centre_predicted_um".to_owned(), json!(r.predicted.centre.map(um_from_mm)));
    out.insert("readings".to_owned(), json!(readings));
    Value::Object(out)
}

fn shown(key: &str, value: f64) -> String {
    if key.ends_with("percent") { format!("{value:.1} %") } else { format!("{value:.2} µm") }
}

fn print(r: &CirclePrediction) {
    for (key, name, value) in figures(r) {
        say!("{name:<48} {:>10}", shown(key, value));
    }
}

/// The report: figures, both curves, the residual.
fn page(r: &CirclePrediction, readings: &[CircularReading], args: &Args, data: &Path) -> String {
    let mut page = ReportPage::new("Predicted and measured circle");
    page.paragraph(&format!("Model {}, measured circle {}.", args.model.display(), data.display()));
    let rows: Vec<Vec<Entry>> = figures(r)
        .iter()
        .map(|(key, name, value)| vec![Entry::Head((*name).to_owned()), Entry::Number(shown(key, *value))])
        .collect();
    page.table(&["figure", "value"], &rows);
    let step = (readings.len() / 720).max(1);
    let of = |c: &Circularity, travel: Travel| -> Vec<(f64, f64)> {
        let mut points: Vec<(f64, f64)> = readings
            .iter()
            .zip(&c.radial)
            .filter(|(reading, _)| reading.travel == travel)
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
    page.plots(&[plot("counter-clockwise", Travel::Forward), plot("clockwise", Travel::Reverse)]);
    page.note("Each about its own least-squares centre; the mean radius is kept.");
    page.finish()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lost_motion_builds_up_behind_a_reversal() {
        let text = "format = \"volcomp-model/1\"\nmachine = \"m\"\nchain = \"[w b X Y Z t]\"\n\
            [errors.exx.table]\nposition-mm = [-200, 200]\nvalue-um = [0, 0]\nreverse-um = [4, 4]\n";
        let file = volcomp_config::model::parse_file("m", text).unwrap();
        let model = Model::new(&file.spec).unwrap();
        // 4 um of 100 mm (1 - cos): half of the lost motion is made up 0.36 deg behind the reversal, all of it 0.51 deg behind
        let [half, whole] = [2e-5f64, 4e-5].map(|share| (1.0 - share).acos());
        let at = |angle: f64, travel| CircularReading { angle, deviation: 0.0, travel };
        let readings = [
            at(1e-6, Travel::Forward),
            at(half, Travel::Forward),
            at(1.01 * whole, Travel::Forward),
            at(-half, Travel::Reverse),
            at(PI + half, Travel::Forward),
            at(-1e-6, Travel::Forward),
        ];
        let live = [0.0; SENSORS_MAX];
        let plane = [AxisName::X, AxisName::Y];
        let found = predict((&model, &live), &readings, Vec3::zeros(), 100.0, plane, false).unwrap();
        for (value, expected) in found.iter().zip([0.0, 2e-3, 4e-3, 2e-3, -2e-3, 0.0]) {
            assert!((value - expected).abs() < 1e-6, "{found:?}");
        }
    }
}
