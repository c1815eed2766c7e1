//! `cncsim measure threepoint`: a laser tracker looks at points on a carriage.

use super::common::{AxisPlan, not_negative};
use crate::cli::Failure;
use crate::instruments::tracker::{Tracker, TrackerErrors};

/// A laser tracker measures points on the carriage of one axis at every stop, and reference points on the bed.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    #[command(flatten)]
    plan: AxisPlan,
    /// Side of the triangle of points (a fourth stands above it), mm.
    #[arg(long, default_value = "300", value_parser = not_negative)]
    side_mm: f64,
    /// Standard deviation of a range, um.
    #[arg(long, default_value = "0.5", value_parser = not_negative)]
    noise_range_um: f64,
    /// Standard deviation of azimuth and elevation, arcsec.
    #[arg(long, default_value = "0.75", value_parser = not_negative)]
    noise_angle_arcsec: f64,
    /// Without refraction, encoder errors and warm-up drift of the tracker.
    #[arg(long)]
    noise_only: bool,
    /// Only the three points of the triangle.
    #[arg(long)]
    three: bool,
    /// Where the tracker stands, in M.
    #[arg(long, value_name = "X,Y,Z", default_value = "2600,-1500,300", value_parser = crate::cli::path::point, allow_hyphen_values = true)]
    tracker_mm: [f64; 3],
    /// How the tracker is turned about z, deg.
    #[arg(long, default_value = "112", allow_hyphen_values = true)]
    turn_deg: f64,
}

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    let (machine, axis, k) = args.plan.open()?;
    let mut tracker = Tracker::new(
        args.tracker_mm,
        args.turn_deg,
        args.noise_range_um,
        args.noise_angle_arcsec,
        args.plan.seed,
    );
    if !args.noise_only {
        tracker = tracker.with_errors(TrackerErrors::shop(args.plan.seed), 0.0);
    }
    let targets: Vec<(String, [f64; 3])> = points(args, machine.tool_tip_mm())
        .into_iter()
        .enumerate()
        .map(|(i, p)| (format!("p{}", i + 1), p))
        .collect();
    let files = tracker.measure(&machine, k, &targets, &args.plan.stops(machine.travel(k)));
    let name = format!("threepoint-{}.csv", axis.lower());
    args.plan.write("registration.csv", &files.registration)?;
    args.plan.write("points.csv", &files.points)?;
    args.plan.write(&name, &files.data)?;
    say!(
        "volcomp identify threepoint --axis {} --points {} --data {} --registration {} --sigma-range-um {} --sigma-angle-arcsec {} --chain \"{}\" --machine {}",
        axis.lower(),
        args.plan.file("points.csv"),
        args.plan.file(&name),
        args.plan.file("registration.csv"),
        args.noise_range_um,
        args.noise_angle_arcsec,
        machine.chain().text(),
        machine.machine()
    );
    Ok(())
}

/// An equilateral triangle about the tool tip, and a point above it.
fn points(args: &Args, tip: [f64; 3]) -> Vec<[f64; 3]> {
    let s = args.side_mm;
    let mut points = vec![
        [tip[0], tip[1] + s / 3f64.sqrt(), tip[2]],
        [tip[0] - s / 2.0, tip[1] - s / 12f64.sqrt(), tip[2]],
        [tip[0] + s / 2.0, tip[1] - s / 12f64.sqrt(), tip[2]],
    ];
    if !args.three {
        points.push([tip[0], tip[1], tip[2] + s]);
    }
    points.iter().map(|p| p.map(|v| (v * 1e3).round() / 1e3)).collect()
}
