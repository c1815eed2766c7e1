//! `volcomp identify ram`: tool poses at several positions of the head to the errors of the ram.

use super::motion_curves::Origin;
use crate::identify::prelude::*;
use volcomp_identify::motion::MotionRow;
use volcomp_identify::ram::{Head, HeadPose, Prior, RamError, RamFit, RamNoise, solve};

/// Errors of the ram from tool poses at several positions of its two-axis head.
///
/// At every position of the ram the head takes several poses C, A; tip and tool direction are measured at each, for
/// example by two circles. The head's own errors are taken off by a model of the head.
#[derive(Debug, clap::Args)]
#[command(after_long_help = include_str!("help.txt"))]
pub(crate) struct Args {
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
    /// From the reference point of the ram to a point on the C axis; by default as the --head model states the axis, without one
    /// zero: the reference point lies on it.
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true)]
    c_axis_mm: Option<Vec3>,
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

/// A case of the reference vectors.
#[derive(Debug, Deserialize)]
struct Case {
    head: CaseHead,
    #[serde(default = "one")]
    sigma_position: f64,
    #[serde(default = "one")]
    sigma_direction: f64,
    poses: Vec<CasePose>,
    prior: Option<CasePrior>,
}

#[derive(Debug, Deserialize)]
#[expect(non_snake_case, reason = "the names of the reference vectors")]
struct CaseHead {
    A_axis_from_Z_reference: [f64; 3],
    tool_length: f64,
}

#[derive(Debug, Deserialize)]
#[expect(non_snake_case, reason = "the names of the reference vectors")]
struct CasePose {
    C: f64,
    A: f64,
    tip_position_error: [f64; 3],
    tool_direction_error: [f64; 3],
}

/// Mean and standard deviations; a missing one (null) is not known.
#[derive(Debug, Deserialize)]
#[expect(non_snake_case, reason = "the names of the reference vectors")]
struct CasePrior {
    E: [f64; 6],
    sigma: [Option<f64>; 6],
}

const fn one() -> f64 {
    1.0
}

impl Method for Args {
    fn front(&self) -> Front<'_> {
        self.curves.front(&self.case)
    }

    fn of_case(&self, file: CaseFile<'_>) -> Result<Box<dyn Found + '_>> {
        let case: Case = file.read()?;
        let head = Head {
            a_axis: Vec3::from(case.head.A_axis_from_Z_reference),
            c_axis: Vec3::zeros(),
            tool_length: case.head.tool_length,
        };
        let pose = |p: &CasePose| {
            let (tip_error, direction_error) = (p.tip_position_error.into(), p.tool_direction_error.into());
            HeadPose { c: p.C, a: p.A, tip_error, direction_error }
        };
        let poses: Vec<HeadPose> = case.poses.iter().map(pose).collect();
        let noise = RamNoise { position: case.sigma_position, direction: case.sigma_direction };
        let prior = case
            .prior
            .map(|p| Prior { mean: p.E.into(), std: p.sigma.map(|s| s.unwrap_or(f64::INFINITY)).into() });
        match solve(&head, &poses, &noise, prior.as_ref()) {
            Ok(fit) => Ok(printed(json_of(&fit), move || print(&fit))),
            Err(ref e @ RamError::Deficient { rank, ref unobservable, .. }) if self.case.json => {
                Ok(refused(json!({ "rank": rank, "unobservable": unobservable.as_slice() }), e))
            }
            Err(e) => Err(file.bad(e)),
        }
    }

    fn of_data(&self) -> Result<Option<Box<dyn Found + '_>>> {
        let (data, axis) = (self.case.all(&self.data), self.axis);
        let (Some(a_axis), Some(tool_length), false) = (self.a_axis_mm, self.tool_length_mm, data.is_empty())
        else {
            return Err(usage!("give --data, --a-axis-mm and --tool-length-mm, or --input with a case"));
        };
        let (Some(position), Some(direction)) = (self.sigma_position_um, self.sigma_direction_arcsec) else {
            return Err(usage!(
                "--sigma-position-um and --sigma-direction-arcsec are needed: they weigh tips against directions"
            ));
        };
        let head = Head { a_axis, c_axis: self.c_axis()?, tool_length };
        let noise = RamNoise { position: mm_from_um(position), direction: rad_from_arcsec(direction) };
        let stops = self.stops(&head)?;
        let known = self.prior.as_deref().map(read_model).transpose()?.map(|m| m.0);
        let (mut rows, mut fits) = (Vec::new(), Vec::new());
        for (at, poses) in &stops.all {
            let &Reading { position, cycle, travel, .. } = at;
            let prior = |std| Prior::of_model(known.as_ref(), std, axis, position, travel);
            let prior = self.prior_std().map(prior);
            let fit = solve(&head, poses, &noise, prior.as_ref())
                .map_err(|e| data_error(data, format_args!("{axis} {position} mm: {e}")))?;
            let covariance = fit.covariance * fit.misfit().powi(2);
            rows.push(MotionRow { position, cycle, travel, motion: fit.motion, covariance });
            fits.push(fit);
        }
        if rows.iter().all(|r| r.position == rows[0].position) {
            return self.single(fits).map(Some);
        }
        let base = self.curves.model.base(|| default_chain([axis, AxisName::C, AxisName::A]))?;
        if base.spec.is_workpiece_side(axis) {
            return Err(usage!("axis {axis} is on the workpiece side of the chain; a ram bears the tool"));
        }
        let files = data.iter().chain(&self.head).chain(&self.prior).cloned().collect();
        let origin = Origin { axis, reference: self.reference_mm, method: "ram", files };
        let gauged = self.curves.gauge(rows, &origin)?;
        let report = Box::new(Fits(fits));
        Ok(Some(Box::new(Motions { args: &self.curves, gauged, origin, base, report })))
    }
}

/// The fits at the stops of the ram.
struct Fits(Vec<RamFit>);

impl Report for Fits {
    fn json(&self, motions: Value) -> Value {
        json!({"motions": motions, "stops": self.0.iter().map(json_of).collect::<Vec<_>>()})
    }

    fn print(&self, motions: &Motions<'_>) {
        let chi2: f64 = self.0.iter().map(|f| f.chi2).sum();
        let dof: usize = self.0.iter().map(|f| f.dof).sum();
        let (axis, stops) = (motions.origin.axis, self.0.len());
        say!("{axis} at {stops} stops, fit: chi2 {chi2:.1}, {dof} degrees of freedom");
    }

    fn warn(&self, _: usize) {
        warn(&self.0);
    }
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
    /// From the reference point to the C axis, mm.
    fn c_axis(&self) -> Result<Vec3> {
        let (None, Some(head)) = (self.c_axis_mm, &self.head) else {
            return Ok(self.c_axis_mm.unwrap_or_default());
        };
        let point = read_model_file(head)?.spec.axis(AxisName::C).point;
        // nobody stated it
        Ok(if point == Vec3::zeros() { point } else { point - self.reference_mm })
    }

    /// The poses by position of the ram, what the head does taken off.
    fn stops(&self, head: &Head) -> Result<Stops<HeadPose>> {
        let mut stops = Stops::default();
        for path in self.case.all(&self.data) {
            poses(path, self.axis, &mut stops)?;
        }
        if let Some(path) = &self.head {
            take_off_head(path, head, &mut stops)?;
        }
        Ok(stops)
    }

    /// One position of the ram makes no curve.
    fn single(&self, fits: Vec<RamFit>) -> Result<Box<dyn Found>> {
        if self.curves.model.target().is_some() {
            let what = format_args!(
                "all poses are at one position of {0}; a model needs at least two (column {1}_mm)",
                self.axis,
                self.axis.lower()
            );
            return Err(data_error(self.case.all(&self.data), what));
        }
        warn(&fits);
        // both directions or several cycles are several fits
        let json = match &fits[..] {
            [one] => json_of(one),
            several => several.iter().map(json_of).collect(),
        };
        Ok(printed(json, move || fits.iter().for_each(print)))
    }

    /// Standard deviations of the prior, mm and rad; none where nothing is known.
    fn prior_std(&self) -> Option<[f64; 6]> {
        let angle = rad_from_arcsec(self.prior_std_arcsec?);
        let length = self.prior_std_um.map_or(f64::INFINITY, mm_from_um);
        Some([length, length, length, angle, angle, angle])
    }
}

fn poses(path: &Path, ram: AxisName, stops: &mut Stops<HeadPose>) -> Result<()> {
    let mut table = table::open(path)?;
    // --add-pose writes z_mm whatever the axis
    let position = table.find_column(&format!("{}_mm", ram.lower())).or_else(|| table.find_column("z_mm"));
    let [cycle, direction] = ["cycle", "direction"].map(|name| table.find_column(name));
    let (c, a) = (table.column("c_deg")?, table.column("a_deg")?);
    let tip = table.three(["tip_x_um", "tip_y_um", "tip_z_um"])?;
    let axis = table.three(["dir_x_arcsec", "dir_y_arcsec", "dir_z_arcsec"])?;
    table.only_known()?;
    table.some_rows(|row| {
        let position = row.value_or(position, 0.0)?;
        let at =
            Reading { position, cycle: row.count_of(cycle)?, travel: row.travel_of(direction)?, value: 0.0 };
        stops.at(at).push(HeadPose {
            c: row.value(c)?,
            a: row.value(a)?,
            tip_error: row.deviations(tip)?,
            direction_error: row.deviations(axis)?,
        });
        Ok(())
    })?;
    Ok(())
}

/// Takes off what the rotary axes of a model do: first order, ram at home.
fn take_off_head(path: &Path, head: &Head, stops: &mut Stops<HeadPose>) -> Result<()> {
    let (mut spec, _) = read_model(path)?;
    spec.errors.retain(|(symbol, _)| symbol.axis().kind() == AxisKind::Rotary);
    let model = Model::new(&spec).map_err(|e| mistake!(path, "{e}"))?;
    stops.all.iter_mut().flat_map(|(_, poses)| poses).for_each(|pose| pose.take_off(&model, head));
    Ok(())
}

fn json_of(fit: &RamFit) -> Value {
    let (sigma, covariance) = (Component::ALL.map(|c| std(fit, c)), rows(|at| fit.covariance[at]));
    fields!(fit; rank, chi2, dof, p_value; "E_lsq": fit.motion.as_slice(), "sigma": sigma, "cov": covariance)
}

fn std(fit: &RamFit, component: Component) -> f64 {
    fit.covariance[(component.index(), component.index())].sqrt()
}

fn print(fit: &RamFit) {
    for c in Component::ALL {
        let units = Units::of_component(c);
        let [value, std] = [fit.motion[c.index()], std(fit, c)].map(units.of_value);
        say_text!("E{}{value:>14.4} +- {std:.4} {} (k=1)", c.letter(), units.value);
    }
    let RamFit { rank, chi2, dof, p_value, .. } = fit;
    say!("rank {rank} of 6; chi2 {chi2:.2}, {dof} degrees of freedom, p {p_value:.3}");
}
