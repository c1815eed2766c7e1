//! `volcomp identify nineline`: displacement and straightness along lines to six error motions.

mod compare;

use super::motion_curves::Origin;
use crate::identify::prelude::*;
use volcomp_identify::motion::{Comparison, MotionRow};
use volcomp_identify::nineline::{LineReading, NineLine, NineLineError, solve};
use volcomp_identify::twist::moved;
use volcomp_model::statistics::ChiSquare;

/// Six error motions of a linear axis from displacement and straightness along lines parallel to it.
///
/// An interferometer measures along lines parallel to the axis, its target on the carriage: displacement on three
/// lines, one straightness on two of them, the other on one. More lines and readings are welcome: then the fit is tested.
#[derive(Debug, clap::Args)]
#[command(after_long_help = include_str!("help.txt"))]
pub(crate) struct Args {
    #[command(flatten)]
    case: CaseArgs,
    /// Readings; once per file, as one line is usually measured after the other.
    #[arg(long, value_name = "FILE", conflicts_with = "input")]
    data: Vec<PathBuf>,
    /// Where the target stood on the carriage for each line: CSV with line, x_mm, y_mm, z_mm (M at home).
    #[arg(long, value_name = "FILE", conflicts_with = "input")]
    lines: Option<PathBuf>,
    /// The axis that moved.
    #[arg(long, value_name = "LETTER", value_parser = linear_axis)]
    axis: Option<AxisName>,
    /// Standard deviation of a displacement reading, um.
    #[arg(long, value_name = "UM", value_parser = above_zero, alias = "sigma-um")]
    noise_um: Option<f64>,
    /// Standard deviation of a straightness reading, um; default: that of a displacement.
    #[arg(long, value_name = "UM", value_parser = above_zero)]
    sigma_straightness_um: Option<f64>,
    /// The carriage point at which ex, ey, ez are stated, in M at home; default: the mean of the targets.
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true)]
    reference_mm: Option<Vec3>,
    /// Compare with a motion table of another method (volcomp identify threepoint --motions).
    #[arg(long, value_name = "FILE")]
    compare: Option<PathBuf>,
    #[command(flatten)]
    curves: CurveArgs,
}

/// A case of the reference vectors.
#[derive(Debug, Deserialize)]
struct Case {
    lines_yz: Vec<[f64; 2]>,
    x_target: f64,
    readings: BTreeMap<String, f64>,
    sigma: Option<f64>,
}

impl Case {
    /// `dy2` is the displacement along y on the second line.
    fn readings(&self) -> Result<Vec<LineReading>, String> {
        let (sigma, count) = (self.sigma.unwrap_or(1.0), self.lines_yz.len());
        let reading = |(name, value): (&String, &f64)| {
            let unknown = || format!("reading {name}: write dx1, dy1, dz1 for the first of {count} lines");
            let rest = name.strip_prefix('d').ok_or_else(unknown)?;
            let direction = ["x", "y", "z"].iter().position(|d| rest.starts_with(d)).ok_or_else(unknown)?;
            let line: usize = rest[1..].parse().map_err(|_| unknown())?;
            let [y, z] = line.checked_sub(1).and_then(|i| self.lines_yz.get(i)).ok_or_else(unknown)?;
            Ok(LineReading { target: Vec3::new(self.x_target, *y, *z), direction, value: *value, sigma })
        };
        self.readings.iter().map(reading).collect()
    }
}

fn json_of(found: &NineLine, stated: bool) -> Value {
    // without a stated noise this is the covariance for readings of unit variance
    let covariance = if stated { "cov" } else { "cofactor" };
    let matrix = rows(|at| found.covariance[at]);
    fields!(found; condition_scaled, dof, chi2; "E": found.motion.as_slice(), "rank": 6, covariance: matrix)
}

fn print(found: &NineLine) {
    for c in Component::ALL {
        let units = Units::of_component(c);
        say_text!("E{}{:>14.4}  {}", c.letter(), (units.of_value)(found.motion[c.index()]), units.value);
    }
    say!("condition {:.1}, {} degrees of freedom", found.condition_scaled, found.dof);
}

impl Method for Args {
    fn front(&self) -> Front<'_> {
        self.curves.front(&self.case)
    }

    fn of_case(&self, file: CaseFile<'_>) -> Result<Box<dyn Found + '_>> {
        let case: Case = file.read()?;
        let readings = case.readings().map_err(|e| file.bad(e))?;
        match solve(&readings) {
            Ok(found) => Ok(printed(json_of(&found, case.sigma.is_some()), move || print(&found))),
            Err(ref e @ NineLineError::Deficient { rank, ref unobservable, .. }) if self.case.json => {
                Ok(refused(json!({ "rank": rank, "unobservable": unobservable.as_slice() }), e))
            }
            Err(e) => Err(file.bad(e)),
        }
    }

    fn of_data(&self) -> Result<Option<Box<dyn Found + '_>>> {
        let data = self.case.all(&self.data);
        let (Some(lines), Some(axis), false) = (&self.lines, self.axis, data.is_empty()) else {
            return Err(usage!("give --lines, --axis and --data, or --input with a case"));
        };
        let Some(sigma) = self.noise_um else {
            return Err(usage!(
                "--noise-um is missing: without it the uncertainty of six readings is unknown"
            ));
        };
        let straightness = self.sigma_straightness_um.unwrap_or(sigma);
        let sigmas =
            core::array::from_fn(|i| mm_from_um(if i == axis.direction() { sigma } else { straightness }));
        let lines_of_file = columns::named_points(lines, "line", |word| {
            format!("line '{word}' has no name or occurs twice")
        })?;
        let mut stops = Stops::default();
        for path in data {
            read_readings(path, &lines_of_file, &sigmas, &mut stops)?;
        }
        let base = self.curves.model.base(|| default_chain([axis]))?;
        let sign = if base.spec.is_workpiece_side(axis) { -1.0 } else { 1.0 };
        let mean = lines_of_file.iter().map(|l| l.1).sum::<Vec3>() / lines_of_file.len() as f64;
        let reference = self.reference_mm.unwrap_or(mean);
        let (mut rows, solved) = solve_stops(&stops.all, &reference, sign, data)?;
        let mut misfit = Misfit::of(&solved, lines_of_file.len());
        misfit.worst = worst(&stops.all, &solved, &lines_of_file);
        for row in &mut rows {
            row.covariance *= misfit.fit.enlarged().powi(2);
        }
        let files = [core::slice::from_ref(lines), data].concat();
        let origin = Origin { axis, reference, method: "nineline", files };
        let gauged = self.curves.gauge(rows, &origin)?;
        let compared = self.compare.as_ref().map(|path| compare::with(path, axis, &gauged)).transpose()?;
        misfit.compared = compared.map(|compared| (compared, axis));
        Ok(Some(Box::new(Motions { args: &self.curves, gauged, origin, base, report: Box::new(misfit) })))
    }
}

/// What was read at one stop.
type Stop = (Reading, Vec<LineReading>);

/// Every stop on its own, at the reference point, times `sign`.
fn solve_stops(
    stops: &[Stop],
    reference: &Vec3,
    sign: f64,
    files: &[PathBuf],
) -> Result<(Vec<MotionRow>, Vec<NineLine>)> {
    let one = |(at, readings): &Stop| {
        let &Reading { position, cycle, travel, .. } = at;
        let found = solve(readings)
            .map_err(|e| data_error(files, format_args!("position {position} mm, cycle {cycle}: {e}")))?;
        let (motion, covariance) = moved(&found.motion, &found.covariance, reference);
        Ok((MotionRow { position, cycle, travel, motion: motion * sign, covariance }, found))
    };
    stops.iter().map(one).collect::<Result<Vec<_>, _>>().map(|all| all.into_iter().unzip())
}

fn read_readings(
    path: &Path,
    lines: &[Named],
    sigmas: &[f64; 3],
    stops: &mut Stops<LineReading>,
) -> Result<()> {
    let mut table = table::open(path)?;
    let run = table.run("position_mm")?;
    let names: Vec<String> =
        lines.iter().flat_map(|(n, _)| ["dx", "dy", "dz"].map(|d| format!("{n}_{d}_um"))).collect();
    let columns: Vec<_> =
        names.iter().enumerate().filter_map(|(k, n)| Some((k, table.find_column(n)?))).collect();
    table.only_asked(|column| {
        columns::hint(column, &names, format_args!("position_mm, cycle, direction, {}", names.join(", ")))
    })?;
    table.rows(|row| {
        let at = row.reading(&run)?;
        let readings = stops.at(at);
        for (k, column) in columns.iter().filter(|(_, c)| !row.word(*c).is_empty()) {
            readings.push(LineReading {
                target: lines[k / 3].1,
                direction: k % 3,
                value: row.deviation(*column)?,
                sigma: sigmas[k % 3],
            });
        }
        Ok(())
    })?;
    if stops.all.is_empty() { Err(data!(path, "no data rows")) } else { Ok(()) }
}

/// Condition and redundancy over all stops, and what another method says.
struct Misfit {
    lines: usize,
    condition: f64,
    fit: ChiSquare,
    /// The reading that fits least: where it is, and its residual in standard deviations.
    worst: Option<(String, f64)>,
    compared: Option<(Comparison, AxisName)>,
}

/// The reading with the largest residual in units of its noise.
fn worst(stops: &[Stop], solved: &[NineLine], lines: &[Named]) -> Option<(String, f64)> {
    let all = stops.iter().zip(solved).flat_map(|((at, readings), found)| {
        readings.iter().zip(&found.residuals).map(move |(reading, residual)| (at, reading, *residual))
    });
    let (at, reading, residual) = all.max_by(|a, b| a.2.abs().total_cmp(&b.2.abs()))?;
    let (line, _) = lines.iter().find(|(_, target)| *target == reading.target)?;
    let direction = ["dx", "dy", "dz"].get(reading.direction)?;
    let place = format!("{line}_{direction}_um at {} mm, cycle {}", at.position, at.cycle);
    Some((place, residual))
}

impl Misfit {
    fn of(solved: &[NineLine], lines: usize) -> Self {
        Self {
            lines,
            condition: solved.iter().fold(0.0, |m, s| s.condition_scaled.max(m)),
            fit: ChiSquare {
                sum: solved.iter().fold(0.0, |sum, s| sum + s.chi2),
                dof: solved.iter().map(|s| s.dof).sum(),
            },
            worst: None,
            compared: None,
        }
    }
}

impl Report for Misfit {
    fn json(&self, motions: Value) -> Value {
        json!({
            "motions": motions,
            "condition_scaled": self.condition,
            "chi2": self.fit.sum,
            "dof": self.fit.dof,
            "p_value": self.fit.p_value(),
            "noise_factor": self.fit.noise_factor(),
            "enlarged": self.fit.enlarged(),
            "worst": self.worst.as_ref().map(|(place, residual)| json!({"reading": place, "residual_over_noise": residual})),
            "compared": self.compared.as_ref().map(|(c, _)| compare::as_json(c)),
        })
    }

    fn print(&self, motions: &Motions<'_>) {
        let (axis, [x, y, z]): (_, [f64; 3]) = (motions.origin.axis, motions.origin.reference.into());
        let (lines, rows) = (self.lines, motions.gauged.rows.len());
        say!("{axis} on {lines} lines at {rows} stops; ex ey ez at ({x:.3} {y:.3} {z:.3}) mm in M at home");
        let Self { condition, fit: ChiSquare { sum: chi2, dof }, .. } = self;
        match self.fit.p_value() {
            Some(p) => {
                let verdict = if p < SIGNIFICANT { "FAILED" } else { "passed" };
                say!(
                    "condition {condition:.1}; fit: chi2 {chi2:.1}, {dof} degrees of freedom, p {p:.3}: {verdict}"
                );
            }
            None => say!("condition {condition:.1}; six readings per stop: the fit cannot be tested"),
        }
        say!();
    }

    fn print_below(&self) {
        self.compared.iter().for_each(|(compared, axis)| compare::print(compared, *axis));
    }

    fn warn(&self, _: usize) {
        let ChiSquare { sum: chi2, dof } = self.fit;
        if self.fit.has_failed() {
            let worst = self.worst.as_ref().map_or_else(String::new, |(place, residual)| {
                format!("; the largest residual is {place}: {residual:+.1} times its noise")
            });
            note!(
                "warning: the readings contradict each other by more than their noise (chi2 {chi2:.1}, {dof} degrees of freedom){worst}; is a line misplaced, or --noise-um too small?"
            );
            note!("note: the uncertainties given are enlarged by {:.1}", self.fit.enlarged());
        }
    }
}
