//! `volcomp identify circles`: two circles in space to tool axis and tip.

mod case;
mod out;

use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::case::{CaseArgs, print_json};
use super::motion_curves::names;
use super::tracker_points::{Columns, Frame, TrackerArgs};
use crate::arg_parsers::{not_negative, point};
use crate::model_writer::ModelWriter;
use crate::table::open;
use crate::{EX_DATAERR, Failure};
use volcomp_identify::circles::{CirclesInput, ToolAxis, solve};
use volcomp_model::geometry::Vec3;
use volcomp_model::statistics::SIGNIFICANT;
use volcomp_units::{arcsec_from_rad, mm_from_um, um_from_mm};

/// Tool axis and tip from two circles that a target on the turning tool draws at two heights.
///
/// The target is clamped to the spindle, the spindle turns, a tracker measures points all around; then the same
/// closer to the tip. The line through both centres is the tool axis.
#[derive(Debug, clap::Args)]
#[command(after_long_help = HELP)]
pub(super) struct Args {
    #[command(flatten)]
    case: CaseArgs,
    /// The points: CSV with circle (1 farther from the tip, 2 nearer) and x_mm, y_mm, z_mm (or range, azimuth,
    /// elevation).
    #[arg(long, value_name = "FILE", conflicts_with = "input")]
    data: Option<PathBuf>,
    /// Points of a second tracker, in its own frame.
    #[arg(long, value_name = "FILE", requires = "data")]
    data_2: Option<PathBuf>,
    /// Registration of the second tracker, as --registration.
    #[arg(long, value_name = "FILE", requires = "data_2")]
    registration_2: Option<PathBuf>,
    /// Offset between the frames of two trackers, um per direction (k=1); default: from both registrations.
    #[arg(long, value_name = "UM", value_parser = not_negative)]
    between_um: Option<f64>,
    /// Direction of the tool axis as it should be, from the tip to the spindle, in M.
    #[arg(long, value_name = "X,Y,Z", default_value = "0,0,1", value_parser = point, allow_hyphen_values = true)]
    nominal_axis: Vec3,
    /// Distance of the tool tip beyond the centre of circle 2.
    #[arg(long, value_name = "MM", allow_hyphen_values = true)]
    tip_beyond_mm: Option<f64>,
    /// The tip as it should be, in M; needed by --out and --add-pose.
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true)]
    nominal_tip_mm: Option<Vec3>,
    /// Add the errors of this pose to a file for volcomp identify ram.
    #[arg(long, value_name = "FILE", requires_all = ["c_deg", "a_deg", "nominal_tip_mm"])]
    add_pose: Option<PathBuf>,
    /// C of the head in this pose.
    #[arg(long, value_name = "DEG", allow_hyphen_values = true)]
    c_deg: Option<f64>,
    /// A of the head in this pose.
    #[arg(long, value_name = "DEG", allow_hyphen_values = true)]
    a_deg: Option<f64>,
    /// Z of the ram in this pose.
    #[arg(long, value_name = "MM", default_value = "0", allow_hyphen_values = true)]
    z_mm: f64,
    #[command(flatten)]
    tracker: TrackerArgs,
    #[command(flatten)]
    model: ModelWriter,
}

const HELP: &str = "\
File (CSV): circle,x_mm,y_mm,z_mm  or  circle,range_mm,azimuth_deg,elevation_deg

Examples:
  volcomp identify circles --data circles.csv --tip-beyond-mm 120 --noise-um 5
  volcomp identify circles --data left.csv --registration left-ref.csv --data-2 right.csv \\
    --registration-2 right-ref.csv --tip-beyond-mm 120
  volcomp identify circles --data p1.csv --tip-beyond-mm 120 --nominal-axis 0,-0.5,0.866 --nominal-tip-mm 10,20,-480 \\
    --c-deg 0 --a-deg 30 --z-mm -200 --add-pose poses.csv

--out writes the location errors of the spindle (ex0s ey0s ea0s eb0s) and needs the head at home (axis along z). At
other poses of the head the error belongs to several axes: collect poses and let volcomp identify ram sort them.";

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    if let Some(file) = args.case.file() {
        file.writes_no_model(args.model.target().is_some() || args.add_pose.is_some())?;
        return case::run(file, args.case.json);
    }
    let (Some(data), Some(tip)) = (args.case.data(&args.data), args.tip_beyond_mm) else {
        return Err(Failure::usage("give --data and --tip-beyond-mm, or --input with a case"));
    };
    let frame = args.tracker.frame()?;
    let mut circles = [Vec::new(), Vec::new()];
    read(data, &frame, &args.tracker, &mut circles)?;
    let mut files = vec![data.clone()];
    files.extend(args.tracker.files().cloned());
    let mut second = None;
    if let Some(path) = &args.data_2 {
        let other = args.tracker.frame_of(args.registration_2.as_deref())?;
        read(path, &other, &args.tracker, &mut circles)?;
        files.push(path.clone());
        files.extend(args.registration_2.clone());
        second = Some(other);
    }
    let between = between(args, &frame, second.as_ref(), &circles);
    let input = CirclesInput {
        points_1: &circles[0],
        points_2: &circles[1],
        nominal_axis: args.nominal_axis,
        tip_beyond_centre_2: tip,
        sigma: args.tracker.cartesian_sigma(),
        registration: between,
    };
    let found =
        solve(&input).map_err(|e| Failure::new(EX_DATAERR, format_args!("error: {}: {e}", names(&files))))?;
    let quiet = args.model.takes_stdout();
    if args.case.json && !quiet {
        print_json(&json_of(&found, args.tracker.cartesian_sigma()));
    } else if !quiet {
        print(&found, args.tracker.cartesian_sigma().is_some());
        for registered in
            [Some(&frame), second.as_ref()].into_iter().flatten().filter_map(|f| f.registered.as_ref())
        {
            registered.print();
        }
    }
    if let Some(path) = &args.add_pose {
        out::add_pose(path, args, &found)?;
    }
    if args.model.target().is_some() {
        out::write_model(args, &found, &files)?;
    }
    Ok(())
}

/// The uncertainty between two frames, mm: as given, else from the registrations at the circles.
fn between(args: &Args, frame: &Frame, second: Option<&Frame>, circles: &[Vec<Vec3>; 2]) -> f64 {
    if let Some(um) = args.between_um {
        return mm_from_um(um);
    }
    let Some(second) = second else { return 0.0 };
    let at = |f: &Frame, points: &[Vec3]| {
        let centre = points.iter().sum::<Vec3>() / points.len().max(1) as f64;
        f.registered.as_ref().map_or(0.0, |r| r.std_at(&centre))
    };
    let g = at(frame, &circles[0]).hypot(at(second, &circles[1]));
    if g == 0.0 {
        note!(
            "note: two trackers, but nothing is known of the offset between their frames; give --between-um or both registrations"
        );
    }
    g
}

fn read(path: &Path, frame: &Frame, tracker: &TrackerArgs, into: &mut [Vec<Vec3>; 2]) -> Result<(), Failure> {
    let mut table = open(path)?;
    let circle = table.require("circle")?;
    let columns = Columns::find(&table, "").ok_or_else(|| {
        Failure::new(
            EX_DATAERR,
            format_args!(
                "error: {}: columns x_mm, y_mm, z_mm (or range_mm, azimuth_deg, elevation_deg) are missing",
                path.display()
            ),
        )
    })?;
    columns.check_frame(tracker, frame, path)?;
    while table.advance()? {
        let which = match table.number(circle)? {
            1.0 => 0,
            2.0 => 1,
            other => {
                return Err(table.fail(
                    circle,
                    format_args!("{other} is not a circle; write 1 (farther from the tip) or 2 (nearer)"),
                ));
            }
        };
        into[which].push(frame.place(&table, columns)?);
    }
    Ok(())
}

fn json_of(found: &ToolAxis, sigma: Option<f64>) -> Value {
    let list = |v: &Vec3| v.as_slice().to_vec();
    let [one, two] = &found.circles;
    let mut value = json!({
        "centre_1": list(&one.centre),
        "radius_1": one.radius,
        "normal_1": list(&one.normal),
        "centre_2": list(&two.centre),
        "radius_2": two.radius,
        "normal_2": list(&two.normal),
        "axis_direction": list(&found.direction),
        "tip": list(&found.tip),
        "direction_error_rotvec": list(&found.direction_error),
        "rms_radial": [one.rms_radial, two.rms_radial],
        "rms_axial": [one.rms_axial, two.rms_axial],
        "sigma": found.sigma,
        "sigma_stated": sigma.is_some(),
        "sigma_direction": found.direction_std(),
        "sigma_tip_lateral": found.tip_lateral_std(),
        "registration_share": found.registration_share,
        "arc": [one.arc, two.arc],
        "coaxial": found.coaxial.as_ref().map(|c| json!({
            "axis_direction": list(&c.direction),
            "tip": list(&c.tip),
            "radii": c.radii,
            "sigma_direction": c.direction_std,
            "sigma_tip_lateral": c.tip_lateral_std,
            "sigma_residual": c.sigma,
            "p_value": c.p_value,
        })),
    });
    if let Some(p) = found.predicted.filter(|_| found.sigma > 0.0) {
        value["sigma_predicted"] = json!({
            "centre_inplane": p.centre_in_plane,
            "direction": p.direction,
            "tip_lateral": p.tip_lateral,
        });
    }
    value
}

fn print(found: &ToolAxis, stated: bool) {
    for (k, c) in found.circles.iter().enumerate() {
        say!(
            "circle {}: centre ({:.4} {:.4} {:.4}) mm, radius {:.4} mm, {} points over {:.0} deg, rms {:.2} um radial, {:.2} um axial",
            k + 1,
            c.centre.x,
            c.centre.y,
            c.centre.z,
            c.radius,
            c.points,
            c.arc.to_degrees(),
            um_from_mm(c.rms_radial),
            um_from_mm(c.rms_axial)
        );
    }
    let (d, t, e) = (found.direction, found.tip, found.direction_error);
    let [dl, dh] = found.direction_std().map(arcsec_from_rad);
    let [tl, th] = found.tip_lateral_std().map(um_from_mm);
    say!(
        "noise of a coordinate: {:.2} um ({})",
        um_from_mm(found.sigma),
        if stated { "stated" } else { "from the residuals" }
    );
    say!("axis ({:.9} {:.9} {:.9}), +- {dl:.2} to {dh:.2} arcsec (k=1)", d.x, d.y, d.z);
    say!(
        "  off the nominal one by a rotation of {:+.2} {:+.2} {:+.2} arcsec about x y z",
        arcsec_from_rad(e.x),
        arcsec_from_rad(e.y),
        arcsec_from_rad(e.z)
    );
    say!("tip ({:.4} {:.4} {:.4}) mm, across the axis +- {tl:.2} to {th:.2} um (k=1)", t.x, t.y, t.z);
    if found.registration_share > 0.0 {
        say!(
            "  of it from the offset between the frames: {:.2} arcsec",
            arcsec_from_rad(found.registration_share)
        );
    }
    if let Some(joint) = &found.coaxial {
        say!(
            "fitted as two coaxial circles: axis +- {:.2} arcsec, tip +- {:.2} um, {:.2} arcsec and {:.2} um from the above",
            arcsec_from_rad(joint.direction_std),
            um_from_mm(joint.tip_lateral_std),
            arcsec_from_rad(joint.direction.cross(&found.direction).norm()),
            um_from_mm((joint.tip - found.tip).norm())
        );
        if let Some(p) = joint.p_value.filter(|p| *p < SIGNIFICANT) {
            note!(
                "warning: the planes of the circles are not across the line of their centres (p {p:.1e}): does the target wobble, or is the noise larger than stated?"
            );
        }
    }
}
