//! `volcomp identify circles`: two circles in space to tool axis and tip.

mod out;

use crate::identify::prelude::*;
use volcomp_identify::circles::{CirclesInput, ToolAxis, solve};
use volcomp_model::statistics::ChiSquare;

/// Tool axis and tip from two circles that a target on the turning tool draws at two heights.
///
/// The target is clamped to the spindle, the spindle turns, a tracker measures points all around; then the same
/// closer to the tip. The line through both centres is the tool axis.
#[derive(Debug, clap::Args)]
#[command(after_long_help = include_str!("help.txt"))]
pub(crate) struct Args {
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

/// A case of the reference vectors.
#[derive(Debug, Deserialize)]
struct Case {
    points_1: Vec<[f64; 3]>,
    points_2: Vec<[f64; 3]>,
    nominal_axis: [f64; 3],
    tip_beyond_centre_2: f64,
    sigma: Option<f64>,
    /// Standard deviation of the offset between the frames of both circles, mm.
    #[serde(default)]
    sigma_registration: f64,
}

impl Method for Args {
    fn front(&self) -> Front<'_> {
        Front { writes_more: self.add_pose.is_some(), ..self.case.front(&self.model) }
    }

    fn of_case(&self, file: CaseFile<'_>) -> Result<Box<dyn Found + '_>> {
        let case: Case = file.read()?;
        let vectors = |points: &[[f64; 3]]| points.iter().map(|p| Vec3::from(*p)).collect::<Vec<_>>();
        let (one, two) = (vectors(&case.points_1), vectors(&case.points_2));
        let input = CirclesInput {
            points_1: &one,
            points_2: &two,
            nominal_axis: Vec3::from(case.nominal_axis),
            tip_beyond_centre_2: case.tip_beyond_centre_2,
            sigma: case.sigma,
            registration: case.sigma_registration,
        };
        let found = solve(&input).map_err(|e| file.bad(e))?;
        let stated = is_stated(case.sigma, &found);
        Ok(printed(json_of(&found, stated), move || print(&found, stated)))
    }

    fn of_data(&self) -> Result<Option<Box<dyn Found + '_>>> {
        let (Some(data), Some(tip)) = (self.case.data(&self.data), self.tip_beyond_mm) else {
            return Err(usage!("give --data and --tip-beyond-mm, or --input with a case"));
        };
        let mut frames = vec![self.tracker.frame()?];
        let mut circles = [Vec::new(), Vec::new()];
        read(data, &frames[0], &self.tracker, &mut circles)?;
        let mut files: Vec<PathBuf> = [data].into_iter().chain(self.tracker.files()).cloned().collect();
        if let Some(path) = &self.data_2 {
            let other = self.tracker.frame_of(self.registration_2.as_deref())?;
            read(path, &other, &self.tracker, &mut circles)?;
            files.extend([path].into_iter().chain(&self.registration_2).cloned());
            frames.push(other);
        }
        let sigma = self.tracker.cartesian_sigma();
        let input = CirclesInput {
            points_1: &circles[0],
            points_2: &circles[1],
            nominal_axis: self.nominal_axis,
            tip_beyond_centre_2: tip,
            sigma,
            registration: between(self, &frames[0], frames.get(1), &circles),
        };
        let axis = solve(&input).map_err(|e| data_error(&files, e))?;
        Ok(Some(Box::new(Outcome { args: self, stated: is_stated(sigma, &axis), axis, frames, files })))
    }
}

/// A tool axis found from files.
struct Outcome<'a> {
    args: &'a Args,
    axis: ToolAxis,
    /// True where the noise taken is the stated one.
    stated: bool,
    frames: Vec<Frame>,
    files: Vec<PathBuf>,
}

impl Found for Outcome<'_> {
    fn json(&self) -> Value {
        json_of(&self.axis, self.stated)
    }

    fn warn(&self) {
        let Some(test) = self.axis.residual_test.filter(|t| t.has_failed()) else { return };
        let (factor, p) = (test.enlarged(), small(test.p_value().unwrap_or_default()));
        note!(
            "warning: the residuals of the circles are {factor:.1} times the stated noise (p {p}); does the spindle wander, or is \
             --noise-um too small?"
        );
        note!(
            "note: the noise is taken from the residuals: the uncertainties given are enlarged by {factor:.1}"
        );
    }

    fn print(&self) {
        print(&self.axis, self.stated);
        self.frames.iter().filter_map(|f| f.registered.as_ref()).for_each(|r| r.print());
    }

    fn write(&self, _end: &mut String) -> Result<()> {
        if let Some(path) = &self.args.add_pose {
            out::add_pose(path, self.args, &self.axis)?;
        }
        if self.args.model.target().is_some() {
            out::write_model(self.args, &self.axis, &self.files)?;
        }
        Ok(())
    }
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

fn read(path: &Path, frame: &Frame, tracker: &TrackerArgs, into: &mut [Vec<Vec3>; 2]) -> Result<()> {
    let mut table = table::open(path)?;
    let circle = table.column("circle")?;
    let at = PointColumns::of_table(&mut table)?;
    at.check_frame(tracker, frame, path)?;
    table.rows(|row| {
        let which = match row.value(circle)? {
            1.0 => 0,
            2.0 => 1,
            other => {
                let what = "is not a circle; write 1 (farther from the tip) or 2 (nearer)";
                return Err(row.fail(circle, format_args!("{other} {what}")));
            }
        };
        into[which].push(frame.place(row, at)?);
        Ok(())
    })?;
    Ok(())
}

/// True where the noise taken is a stated one: none of which the residuals show more.
fn is_stated(sigma: Option<f64>, found: &ToolAxis) -> bool {
    sigma.is_some() && !found.residual_test.is_some_and(ChiSquare::has_failed)
}

fn json_of(found: &ToolAxis, stated: bool) -> Value {
    let [one, two] = &found.circles;
    let mut json = fields!(found; sigma, registration_share;
        "residual_p_value": found.residual_test.and_then(ChiSquare::p_value),
        "centre_1": one.centre.as_slice(),
        "radius_1": one.radius,
        "normal_1": one.normal.as_slice(),
        "centre_2": two.centre.as_slice(),
        "radius_2": two.radius,
        "normal_2": two.normal.as_slice(),
        "axis_direction": found.direction.as_slice(),
        "tip": found.tip.as_slice(),
        "direction_error_rotvec": found.direction_error.as_slice(),
        "rms_radial": [one.rms_radial, two.rms_radial],
        "rms_axial": [one.rms_axial, two.rms_axial],
        "sigma_stated": stated,
        "sigma_direction": found.direction_std(),
        "sigma_tip_lateral": found.tip_lateral_std(),
        "arc": [one.arc, two.arc],
        "coaxial": found.coaxial.as_ref().map(|c| fields!(c; radii, p_value;
            "axis_direction": c.direction.as_slice(),
            "tip": c.tip.as_slice(),
            "sigma_direction": c.direction_std,
            "sigma_tip_lateral": c.tip_lateral_std,
            "sigma_residual": c.sigma,
        )),
    );
    if let Some(p) = found.predicted.filter(|_| found.sigma > 0.0) {
        json["sigma_predicted"] = fields!(p; direction, tip_lateral; "centre_inplane": p.centre_in_plane);
    }
    json
}

fn print(found: &ToolAxis, stated: bool) {
    for (k, c) in found.circles.iter().enumerate() {
        let ([x, y, z], arc): ([f64; 3], _) = (c.centre.into(), c.arc.to_degrees());
        let [radial, axial] = [c.rms_radial, c.rms_axial].map(um_from_mm);
        let (number, radius, points) = (k + 1, c.radius, c.points);
        say_text!(
            "circle {number}: centre ({x:.4} {y:.4} {z:.4}) mm, radius {radius:.4} mm, {points} points over {arc:.0} deg, rms {radial:.2} um radial, {axial:.2} um axial"
        );
    }
    let (d, t, e) = (found.direction, found.tip, found.direction_error.map(arcsec_from_rad));
    let [dl, dh] = found.direction_std().map(arcsec_from_rad);
    let [tl, th] = found.tip_lateral_std().map(um_from_mm);
    let origin = if stated { "stated" } else { "from the residuals" };
    say_text!("noise of a coordinate: {:.2} um ({origin})", um_from_mm(found.sigma));
    say!("axis ({:.9} {:.9} {:.9}), +- {dl:.2} to {dh:.2} arcsec (k=1)", d.x, d.y, d.z);
    say!("  off the nominal one by a rotation of {:+.2} {:+.2} {:+.2} arcsec about x y z", e.x, e.y, e.z);
    say_text!("tip ({:.4} {:.4} {:.4}) mm, across the axis +- {tl:.2} to {th:.2} um (k=1)", t.x, t.y, t.z);
    if found.registration_share > 0.0 {
        let share = arcsec_from_rad(found.registration_share);
        say!("  of it from the offset between the frames: {share:.2} arcsec");
    }
    let Some(joint) = &found.coaxial else { return };
    let turn = joint.direction.cross(&found.direction).norm();
    let [axis, turn] = [joint.direction_std, turn].map(arcsec_from_rad);
    let [tip, shift] = [joint.tip_lateral_std, (joint.tip - found.tip).norm()].map(um_from_mm);
    say_text!(
        "fitted as two coaxial circles: axis +- {axis:.2} arcsec, tip +- {tip:.2} um, {turn:.2} arcsec and {shift:.2} um from the above"
    );
    if let Some(p) = joint.p_value.filter(|p| *p < SIGNIFICANT) {
        note!(
            "warning: the planes of the circles are not across the line of their centres (p {p:.1e}): does the target wobble, or is the noise larger than stated?"
        );
    }
}
