//! `volcomp identify nineline`: displacement and straightness along lines to six error motions.

mod case;
mod compare;

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use super::case::{CaseArgs, print_json};
use super::motion_curves::{CurveArgs, Origin, motions_json, names, print_motions};
use crate::arg_parsers::{above_zero, linear_axis, point};
use crate::model_writer::default_chain;
use crate::table::{nearest, open};
use crate::{EX_DATAERR, Failure};
use volcomp_identify::motion::MotionRow;
use volcomp_identify::nineline::{LineReading, NineLine, solve};
use volcomp_identify::twist::moved;
use volcomp_model::geometry::Vec3;
use volcomp_model::statistics::{SIGNIFICANT, chi_square_upper};
use volcomp_units::axes::{AxisName, Travel};
use volcomp_units::mm_from_um;

/// Six error motions of a linear axis from displacement and straightness along lines parallel to it.
///
/// An interferometer measures along lines parallel to the axis, its target on the carriage: displacement on three
/// lines, one straightness on two of them, the other on one. More lines and readings are welcome: then the fit is tested.
#[derive(Debug, clap::Args)]
#[command(after_long_help = HELP)]
pub(super) struct Args {
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

const HELP: &str = "\
Files (CSV; BOM, CRLF, blank lines and # comments are fine):
  --lines  line,x_mm,y_mm,z_mm       carriage coordinates of the target while that line was measured
  --data   position_mm[,cycle][,direction], then LINE_dx_um, LINE_dy_um, LINE_dz_um (actual minus nominal);
           an empty field is no reading. Files are joined by position, cycle and direction.

Example, lines 1 2 3, displacement on all, y on 1 and 2, z on 1:
  volcomp identify nineline --axis x --lines lines.csv --data x.csv --noise-um 0.3 --out model.toml

Signs: readings along M, right-handed angles. A carriage on the workpiece side (X' in the chain) is measured by its own
motion; the model gets the motion of the tool relative to it, which is minus that.";

/// A reading column: which line, which direction.
struct Column {
    index: usize,
    line: usize,
    direction: usize,
}

/// The readings of one stop.
struct Stop {
    position: f64,
    cycle: u32,
    travel: Travel,
    readings: Vec<LineReading>,
}

/// The stops of all files, found again by where and when they were.
#[derive(Default)]
struct Stops {
    all: Vec<Stop>,
    places: HashMap<(i64, u32, bool), usize>,
}

impl Stops {
    /// The stop at this position, made where it is missing.
    fn index_of(&mut self, position: f64, cycle: u32, travel: Travel) -> usize {
        let cell = (position / SAME_POSITION).round() as i64;
        let key = |cell| (cell, cycle, travel == Travel::Forward);
        // a position near the edge of its cell may have met its like in the next one
        let same = |i: &&usize| (self.all[**i].position - position).abs() < SAME_POSITION;
        let near = [cell, cell.saturating_sub(1), cell.saturating_add(1)];
        if let Some(found) = near.into_iter().filter_map(|c| self.places.get(&key(c))).find(same) {
            return *found;
        }
        self.all.push(Stop { position, cycle, travel, readings: Vec::new() });
        self.places.insert(key(cell), self.all.len() - 1);
        self.all.len() - 1
    }
}

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    if let Some(file) = args.case.file() {
        file.writes_no_model(args.curves.writes())?;
        return case::run(file, args.case.json);
    }
    let data = args.case.all(&args.data);
    let (Some(lines), Some(axis), false) = (&args.lines, args.axis, data.is_empty()) else {
        return Err(Failure::usage("give --lines, --axis and --data, or --input with a case"));
    };
    let Some(sigma) = args.noise_um else {
        return Err(Failure::usage(
            "--noise-um is missing: without it the uncertainty of six readings is unknown",
        ));
    };
    let straightness = args.sigma_straightness_um.unwrap_or(sigma);
    let sigmas =
        core::array::from_fn(|i| mm_from_um(if i == axis.direction() { sigma } else { straightness }));
    let lines_of_file = read_lines(lines)?;
    let mut stops = Stops::default();
    for path in data {
        read_readings(path, &lines_of_file, &sigmas, &mut stops)?;
    }
    let base = args.curves.model.base(|| default_chain([axis]))?;
    let sign = if base.spec.is_workpiece_side(axis) { -1.0 } else { 1.0 };
    let mean = lines_of_file.iter().map(|l| l.1).sum::<Vec3>() / lines_of_file.len() as f64;
    let reference = args.reference_mm.unwrap_or(mean);
    let (rows, solved) = solve_stops(&stops.all, &reference, sign, &names(data))?;
    let mut files = vec![lines.clone()];
    files.extend(data.iter().cloned());
    let origin = Origin { axis, reference, method: "nineline", files: &files };
    let gauged = args.curves.gauge(rows, &origin)?;
    let quiet = args.curves.model.takes_stdout();
    let fit = Misfit::of(&solved);
    let compared = match &args.compare {
        Some(path) => Some(compare::with(path, axis, &gauged)?),
        None => None,
    };
    if args.case.json && !quiet {
        print_json(&serde_json::json!({
            "motions": motions_json(&gauged, &origin),
            "condition_scaled": fit.condition,
            "chi2": fit.chi2,
            "dof": fit.dof,
            "p_value": fit.p_value(),
            "compared": compared.as_ref().map(compare::Comparison::json),
        }));
    } else if !quiet {
        fit.print(axis, lines_of_file.len(), gauged.rows.len(), &reference);
        print_motions(&gauged, axis);
        if let Some(compared) = &compared {
            compared.print(axis);
        }
    }
    fit.warn();
    args.curves.write(&gauged, &origin, base, !args.case.json)
}

/// Every stop on its own, at the reference point, times `sign`.
fn solve_stops(
    stops: &[Stop],
    reference: &Vec3,
    sign: f64,
    files: &str,
) -> Result<(Vec<MotionRow>, Vec<NineLine>), Failure> {
    let mut rows = Vec::with_capacity(stops.len());
    let mut solved = Vec::with_capacity(stops.len());
    for stop in stops {
        let found = solve(&stop.readings).map_err(|e| {
            Failure::new(
                EX_DATAERR,
                format_args!("error: {files}: position {} mm, cycle {}: {e}", stop.position, stop.cycle),
            )
        })?;
        let (motion, covariance) = moved(&found.motion, &found.covariance, reference);
        rows.push(MotionRow {
            position: stop.position,
            cycle: stop.cycle,
            travel: stop.travel,
            motion: motion * sign,
            covariance,
        });
        solved.push(found);
    }
    Ok((rows, solved))
}

fn read_lines(path: &Path) -> Result<Vec<(String, Vec3)>, Failure> {
    let mut table = open(path)?;
    let name = table.require("line")?;
    let [x, y, z] = [table.require("x_mm")?, table.require("y_mm")?, table.require("z_mm")?];
    let mut lines: Vec<(String, Vec3)> = Vec::new();
    while table.advance()? {
        let word = table.word(name);
        if word.is_empty() || lines.iter().any(|(n, _)| *n == word) {
            return Err(table.fail(name, format_args!("line '{word}' has no name or occurs twice")));
        }
        lines.push((word, Vec3::new(table.number(x)?, table.number(y)?, table.number(z)?)));
    }
    if lines.is_empty() {
        return Err(Failure::new(
            EX_DATAERR,
            format_args!("error: {}: no lines below the header", path.display()),
        ));
    }
    Ok(lines)
}

fn read_readings(
    path: &Path,
    lines: &[(String, Vec3)],
    sigmas: &[f64; 3],
    stops: &mut Stops,
) -> Result<(), Failure> {
    let mut table = open(path)?;
    let position = table.require("position_mm")?;
    let (cycle, direction) = (table.find("cycle"), table.find("direction"));
    let names: Vec<String> =
        lines.iter().flat_map(|(n, _)| ["dx", "dy", "dz"].map(|d| format!("{n}_{d}_um"))).collect();
    let mut columns = Vec::new();
    for (index, column) in table.columns().iter().enumerate() {
        match names.iter().position(|n| n == column) {
            Some(k) => columns.push(Column { index, line: k / 3, direction: k % 3 }),
            None if index == position || Some(index) == cycle || Some(index) == direction => {}
            None => {
                let hint = match nearest(column, names.iter().map(String::as_str)) {
                    Some(near) => format!("is {near} meant?"),
                    None => format!("columns are position_mm, cycle, direction, {}", names.join(", ")),
                };
                return Err(table.fail(index, format_args!("unknown column; {hint}")));
            }
        }
    }
    while table.advance()? {
        let at = table.number(position)?;
        let cycle = cycle.map_or(Ok(0), |c| table.count(c))?;
        let travel = direction.map_or(Ok(Travel::Forward), |c| table.travel(c))?;
        let index = stops.index_of(at, cycle, travel);
        for c in columns.iter().filter(|c| !table.word(c.index).is_empty()) {
            stops.all[index].readings.push(LineReading {
                target: lines[c.line].1,
                direction: c.direction,
                value: mm_from_um(table.number(c.index)?),
                sigma: sigmas[c.direction],
            });
        }
    }
    if stops.all.is_empty() {
        return Err(Failure::new(EX_DATAERR, format_args!("error: {}: no data rows", path.display())));
    }
    Ok(())
}

/// Positions of two files closer than this (mm) are the same stop.
const SAME_POSITION: f64 = 1e-6;

/// Condition and redundancy over all stops.
struct Misfit {
    condition: f64,
    chi2: f64,
    dof: usize,
}

impl Misfit {
    fn of(solved: &[NineLine]) -> Self {
        solved.iter().fold(Self { condition: 0.0, chi2: 0.0, dof: 0 }, |m, s| Self {
            condition: m.condition.max(s.condition_scaled),
            chi2: m.chi2 + s.chi2,
            dof: m.dof + s.dof,
        })
    }

    fn p_value(&self) -> Option<f64> {
        (self.dof > 0).then(|| chi_square_upper(self.chi2, self.dof))
    }

    fn print(&self, axis: AxisName, lines: usize, rows: usize, r: &Vec3) {
        say!(
            "{axis} on {lines} lines at {rows} stops; ex ey ez at ({:.3} {:.3} {:.3}) mm in M at home",
            r.x,
            r.y,
            r.z
        );
        match self.p_value() {
            Some(p) => say!(
                "condition {:.1}; fit: chi2 {:.1}, {} degrees of freedom, p {p:.3}: {}",
                self.condition,
                self.chi2,
                self.dof,
                if p < SIGNIFICANT { "FAILED" } else { "passed" }
            ),
            None => say!("condition {:.1}; six readings per stop: the fit cannot be tested", self.condition),
        }
        say!();
    }

    fn warn(&self) {
        if self.p_value().is_some_and(|p| p < SIGNIFICANT) {
            note!(
                "warning: the readings contradict each other by more than their noise (chi2 {:.1}, {} degrees of freedom); is a line misplaced, or --noise-um too small?",
                self.chi2,
                self.dof
            );
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stops_meet_again_in_any_order() {
        let mut stops = Stops::default();
        let mut at = |position, cycle, travel| stops.index_of(position, cycle, travel);
        assert_eq!(at(10.0, 1, Travel::Forward), 0);
        assert_eq!((at(10.0, 2, Travel::Forward), at(10.0, 1, Travel::Reverse)), (1, 2));
        assert_eq!(at(10.000_000_9, 1, Travel::Forward), 0);
        assert_eq!((at(10.000_002, 1, Travel::Forward), at(-10.0, 1, Travel::Forward)), (3, 4));
        assert_eq!(at(10.0 - 0.9e-6, 2, Travel::Forward), 1);
    }
}
