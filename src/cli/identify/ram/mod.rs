//! `volcomp identify ram`: tool poses at several positions of the head to the errors of the ram.

mod case;
mod read;

use std::path::PathBuf;

use serde_json::{Value, json};

use super::case::{CaseArgs, print_json};
use super::motion_curves::{CurveArgs, Origin, in_print_units, motions_json, names, print_motions};
use crate::arg_parsers::{above_zero, linear_axis, point};
use crate::files::read_model;
use crate::model_writer::default_chain;
use crate::{EX_DATAERR, Failure};
use volcomp_identify::motion::MotionRow;
use volcomp_identify::ram::{Head, Prior, RamFit, RamNoise, solve};
use volcomp_model::geometry::Vec3;
use volcomp_model::statistics::SIGNIFICANT;
use volcomp_model::{Component, ModelSpec};
use volcomp_units::axes::{AxisName, Travel};
use volcomp_units::{mm_from_um, rad_from_arcsec};

/// Errors of the ram from tool poses at several positions of its two-axis head.
///
/// At every position of the ram the head takes several poses C, A; tip and tool direction are measured at each, for
/// example by two circles. The head's own errors are taken off by a model of the head.
#[derive(Debug, clap::Args)]
#[command(after_long_help = HELP)]
pub(super) struct Args {
    #[command(flatten)]
    case: CaseArgs,
    /// The poses; once per file.
    #[arg(long, value_name = "FILE", conflicts_with = "input", alias = "poses")]
    data: Vec<PathBuf>,
    /// The axis of the ram.
    #[arg(long, value_name = "LETTER", default_value = "z", value_parser = linear_axis)]
    axis: AxisName,
    /// From the reference point of the ram to the A axis, head at home.
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true)]
    a_axis_mm: Option<Vec3>,
    /// From the A axis to the tool tip.
    #[arg(long, value_name = "MM", value_parser = above_zero)]
    tool_length_mm: Option<f64>,
    /// The reference point of the ram in M at home: ex, ey, ez hold there.
    #[arg(long, value_name = "X,Y,Z", default_value = "0,0,0", value_parser = point, allow_hyphen_values = true)]
    reference_mm: Vec3,
    /// Standard deviation of a coordinate of the tip, um.
    #[arg(long, value_name = "UM", value_parser = above_zero)]
    sigma_position_um: Option<f64>,
    /// Standard deviation of a component of the direction, arcsec.
    #[arg(long, value_name = "ARCSEC", value_parser = above_zero)]
    sigma_direction_arcsec: Option<f64>,
    /// Model of the head: the errors of its rotary axes are taken off the poses.
    #[arg(long, value_name = "FILE")]
    head: Option<PathBuf>,
    /// Model with the ram's errors as known before: the mean of the prior; without it the mean is zero.
    #[arg(long, value_name = "FILE", requires = "prior_std_arcsec")]
    prior: Option<PathBuf>,
    /// Standard deviation of the prior's ex, ey, ez, um; without it nothing is known of them.
    #[arg(long, value_name = "UM", value_parser = above_zero, requires = "prior_std_arcsec")]
    prior_std_um: Option<f64>,
    /// Standard deviation of the prior's ea, eb, ec, arcsec: fixes what the poses leave free.
    #[arg(long, value_name = "ARCSEC", value_parser = above_zero)]
    prior_std_arcsec: Option<f64>,
    #[command(flatten)]
    curves: CurveArgs,
}

const HELP: &str = "\
File (CSV), actual minus nominal, in M; dir is a difference of unit vectors (tip to spindle):
  [z_mm,][cycle,][direction,]c_deg,a_deg,tip_x_um,tip_y_um,tip_z_um,dir_x_arcsec,dir_y_arcsec,dir_z_arcsec
Rows of equal z_mm, cycle and direction belong together. volcomp identify circles --add-pose writes such rows.

Example:
  volcomp identify ram --data poses.csv --a-axis-mm 0,0,-180 --tool-length-mm 320 --sigma-position-um 2 \\
    --sigma-direction-arcsec 2 --head head.toml --into model.toml

One pose leaves the rotation about the tool axis free and is refused; --prior-std-arcsec fixes it.";

/// The poses at one position of the ram.
struct Stop {
    position: f64,
    cycle: u32,
    travel: Travel,
    poses: Vec<volcomp_identify::ram::HeadPose>,
}

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    if let Some(file) = args.case.file() {
        file.writes_no_model(args.curves.writes())?;
        return case::run(file, args.case.json);
    }
    let (Some(a_axis), Some(tool_length), false) =
        (args.a_axis_mm, args.tool_length_mm, args.case.all(&args.data).is_empty())
    else {
        return Err(Failure::usage("give --data, --a-axis-mm and --tool-length-mm, or --input with a case"));
    };
    let (Some(position), Some(direction)) = (args.sigma_position_um, args.sigma_direction_arcsec) else {
        return Err(Failure::usage(
            "--sigma-position-um and --sigma-direction-arcsec are needed: they weigh tips against directions",
        ));
    };
    let head = Head { a_axis, tool_length };
    let noise = RamNoise { position: mm_from_um(position), direction: rad_from_arcsec(direction) };
    let stops = args.stops(&head)?;
    let prior = args.prior()?;
    let mut rows = Vec::with_capacity(stops.len());
    let mut fits = Vec::with_capacity(stops.len());
    for stop in &stops {
        let prior = prior.as_ref().map(|p| p.at(args.axis, stop));
        let fit = solve(&head, &stop.poses, &noise, prior.as_ref()).map_err(|e| {
            Failure::new(
                EX_DATAERR,
                format_args!(
                    "error: {}: {} {} mm: {e}",
                    names(args.case.all(&args.data)),
                    args.axis,
                    stop.position
                ),
            )
        })?;
        rows.push(MotionRow {
            position: stop.position,
            cycle: stop.cycle,
            travel: stop.travel,
            motion: fit.motion,
            covariance: fit.covariance * misfit(&fit).powi(2),
        });
        fits.push(fit);
    }
    let positions: std::collections::BTreeSet<u64> = rows.iter().map(|r| r.position.to_bits()).collect();
    if positions.len() == 1 {
        return single(args, &fits);
    }
    let base = args.curves.model.base(|| default_chain([args.axis, AxisName::C, AxisName::A]))?;
    if base.spec.is_workpiece_side(args.axis) {
        return Err(Failure::usage(format_args!(
            "axis {} is on the workpiece side of the chain; a ram bears the tool",
            args.axis
        )));
    }
    let mut files = args.case.all(&args.data).to_vec();
    files.extend(args.head.iter().chain(&args.prior).cloned());
    let origin = Origin { axis: args.axis, reference: args.reference_mm, method: "ram", files: &files };
    let gauged = args.curves.gauge(rows, &origin)?;
    let quiet = args.curves.model.takes_stdout();
    if args.case.json && !quiet {
        let stops: Vec<Value> = fits.iter().map(json_of).collect();
        print_json(&json!({"motions": motions_json(&gauged, &origin), "stops": stops}));
    } else if !quiet {
        let chi2: f64 = fits.iter().map(|f| f.chi2).sum();
        let dof: usize = fits.iter().map(|f| f.dof).sum();
        say!("{} at {} stops, fit: chi2 {chi2:.1}, {dof} degrees of freedom", args.axis, fits.len());
        print_motions(&gauged, args.axis);
    }
    warn(&fits);
    args.curves.write(&gauged, &origin, base, !args.case.json)
}

/// One position of the ram: six numbers, no curves.
fn single(args: &Args, fits: &[RamFit]) -> Result<(), Failure> {
    if args.curves.model.target().is_some() {
        return Err(Failure::new(
            EX_DATAERR,
            format_args!(
                "error: {}: all poses are at one position of {}; a model needs at least two (column z_mm)",
                names(args.case.all(&args.data)),
                args.axis
            ),
        ));
    }
    for fit in fits {
        if args.case.json {
            print_json(&json_of(fit));
        } else {
            print(fit);
        }
    }
    warn(fits);
    Ok(())
}

/// Residuals over stated noise, where larger.
fn misfit(fit: &RamFit) -> f64 {
    if fit.dof == 0 { 1.0 } else { (fit.chi2 / fit.dof as f64).sqrt().max(1.0) }
}

fn warn(fits: &[RamFit]) {
    let failing = fits.iter().filter(|f| f.p_value < SIGNIFICANT).count();
    if failing > 0 {
        note!(
            "warning: at {failing} of {} stops the poses contradict each other by more than their noise: has the head errors of its own (--head), or is the noise larger than stated? the uncertainties given are enlarged",
            fits.len()
        );
    }
    let short = fits.iter().filter(|f| f.rank < 6).count();
    if short > 0 {
        note!(
            "note: at {short} of {} stops the poses alone determine fewer than six ram errors; the rest is the prior's",
            fits.len()
        );
    }
}

impl Args {
    /// The poses by position of the ram, what the head does taken off.
    fn stops(&self, head: &Head) -> Result<Vec<Stop>, Failure> {
        let mut stops = Vec::new();
        for path in self.case.all(&self.data) {
            read::poses(path, &mut stops)?;
        }
        if let Some(path) = &self.head {
            read::take_off_head(path, head, &mut stops)?;
        }
        Ok(stops)
    }

    /// Mean and standard deviations of the prior.
    fn prior(&self) -> Result<Option<PriorSource>, Failure> {
        let Some(angle) = self.prior_std_arcsec else { return Ok(None) };
        let angle = rad_from_arcsec(angle);
        let length = self.prior_std_um.map_or(f64::INFINITY, mm_from_um);
        let model = self.prior.as_deref().map(read_model).transpose()?.map(|m| m.0);
        Ok(Some(PriorSource { model, std: [length, length, length, angle, angle, angle] }))
    }
}

/// Where the prior comes from.
struct PriorSource {
    /// Its means; zero without a model.
    model: Option<ModelSpec>,
    /// Standard deviations, mm and rad; infinite where nothing is known.
    std: [f64; 6],
}

impl PriorSource {
    /// The prior at a position of the ram.
    fn at(&self, axis: AxisName, stop: &Stop) -> Prior {
        let mut mean = [0.0; 6];
        for (symbol, function) in self.model.iter().flat_map(|m| &m.errors) {
            if symbol.axis() == axis && !symbol.is_constant() {
                mean[symbol.component().index()] = function.value(stop.position, stop.travel);
            }
        }
        Prior { mean: mean.into(), std: self.std.into() }
    }
}

fn json_of(fit: &RamFit) -> Value {
    json!({
        "rank": fit.rank,
        "E_lsq": fit.motion.as_slice(),
        "sigma": (0..6).map(|i| fit.covariance[(i, i)].sqrt()).collect::<Vec<_>>(),
        "cov": (0..6).map(|i| fit.covariance.row(i).iter().copied().collect()).collect::<Vec<Vec<f64>>>(),
        "chi2": fit.chi2,
        "dof": fit.dof,
        "p_value": fit.p_value,
    })
}

fn print(fit: &RamFit) {
    for c in Component::ALL {
        let i = c.index();
        say!(
            "E{}{:>14.4} +- {:.4} {} (k=1)",
            c.letter(),
            in_print_units(c, fit.motion[i]),
            in_print_units(c, fit.covariance[(i, i)].sqrt()),
            if c.is_angle() { "arcsec" } else { "um" }
        );
    }
    say!(
        "rank {} of 6; chi2 {:.2}, {} degrees of freedom, p {:.3}",
        fit.rank,
        fit.chi2,
        fit.dof,
        fit.p_value
    );
}
