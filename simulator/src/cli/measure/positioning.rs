//! `cncsim measure positioning`: an interferometer along an axis, both directions.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use std::fmt::Write as _;
use std::path::PathBuf;

use volcomp_units::axes::{AxisArray, AxisName};

use super::straightness::{linear_axis, point, write};
use super::through::{self, ThroughArgs};
use crate::cli::serve::built_in_or_file;
use crate::cli::{EX_DATAERR, EX_USAGE, Failure};
use crate::instruments::interferometer::{Interferometer, Positioning, PositioningRow, csv};
use crate::instruments::no_offset;
use crate::through::{Measured, Want};

/// An interferometer along an axis: positioning in both directions, for volcomp evaluate iso230-2.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// The machine: a truth file, or one of the built-in vmc-850, gantry-5ax, grinder-ab.
    #[arg(long, value_name = "FILE|NAME", default_value = "vmc-850")]
    machine: PathBuf,
    #[command(flatten)]
    through: ThroughArgs,
    /// Folder for positioning-x.csv ..; made where it does not exist.
    #[arg(long, value_name = "FOLDER")]
    out: PathBuf,
    /// The axis that moves.
    #[arg(long, value_parser = linear_axis, default_value = "x")]
    axis: AxisName,
    /// Where X, Y and Z stand meanwhile, programmed; default: the middle of the travels.
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true)]
    at_mm: Option<[f64; 3]>,
    /// Targets over the travel, an overrun of 1 % at either end left out; at random distances (ISO 230-2, 5.3.1).
    #[arg(long, default_value = "21", value_parser = clap::value_parser!(u32).range(2..=10_000))]
    targets: u32,
    /// Runs, each in both directions.
    #[arg(long, default_value = "5", value_parser = clap::value_parser!(u32).range(1..=1000))]
    cycles: u32,
    /// Standard deviation of a reading, um.
    #[arg(long, default_value = "0.1", value_parser = super::common::not_negative)]
    noise_um: f64,
    /// Seed of the noise.
    #[arg(long, default_value = "1")]
    seed: u64,
}

/// Share of the travel that is left for overrun at either end.
const OVERRUN: f64 = 0.01;

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    let rows = match args.through.open(&args.machine, &args.out)? {
        Some(mut machine) => under_control(args, machine.as_mut())?,
        None => at_rest(args)?,
    };
    let name = format!("positioning-{}.csv", args.axis.lower());
    let text = format!("# {}\n{}", args.through.how(&args.machine), csv(&rows));
    write(&args.out, &name, &text)?;
    say!("volcomp evaluate iso230-2 --data {}", args.out.join(name).display());
    Ok(())
}

/// Random share of the interval by which each target is moved on.
const SPREAD: f64 = 0.3;

/// The targets in whole micrometres: `P_i = (i - 1) p + r`, each with an `r` of its own, so that periodic errors are not
/// sampled at one phase (ISO 230-2:2014, 5.3.1). The same at each measurement of an axis, as those of a part program.
fn targets(count: u32, axis: AxisName, [low, high]: [f64; 2]) -> Vec<f64> {
    let margin = OVERRUN * (high - low);
    let (low, high) = (low + margin, high - margin);
    let step = (high - low) / (f64::from(count - 1) + SPREAD);
    let mut random = ChaCha8Rng::seed_from_u64(axis.direction() as u64);
    (0..count)
        .map(|i| {
            let r = SPREAD * step * random.random::<f64>();
            ((low + step * f64::from(i) + r) * 1e3).round() / 1e3
        })
        .collect()
}

/// The machine alone, without control and corrections.
fn at_rest(args: &Args) -> Result<Vec<PositioningRow>, Failure> {
    let machine = built_in_or_file(&args.machine)?;
    let missing = || {
        let message = format_args!("machine {} has no axis {}", machine.machine(), args.axis);
        Failure::new(EX_USAGE, message)
    };
    let k = machine.index_of(args.axis).ok_or_else(missing)?;
    let mut at = AxisArray::default();
    for (i, axis) in [AxisName::X, AxisName::Y, AxisName::Z].into_iter().enumerate() {
        if let Some(k) = machine.index_of(axis) {
            let [low, high] = machine.travel(k);
            at[k] = args.at_mm.map_or((low + high) / 2.0, |at| at[i]);
        }
    }
    let plan = Positioning {
        axis: args.axis,
        at,
        targets_mm: targets(args.targets, args.axis, machine.travel(k)),
        cycles: args.cycles as usize,
    };
    Interferometer { noise_um: args.noise_um, seed: args.seed }
        .positioning(&machine, &plan, no_offset)
        .map_err(|e| Failure::new(EX_DATAERR, e))
}

fn under_control(args: &Args, machine: &mut dyn Measured) -> Result<Vec<PositioningRow>, Failure> {
    let letter = args.axis;
    let travel = through::travel(machine, letter)?;
    let targets = targets(args.targets, letter, travel);
    let mut start = String::new();
    for (i, axis) in [AxisName::X, AxisName::Y, AxisName::Z].into_iter().enumerate() {
        if let Some([low, high]) = machine.about().travel(axis) {
            let at = args.at_mm.map_or((low + high) / 2.0, |at| at[i]);
            let at = if axis == letter { travel[0] } else { at };
            // writing into a string cannot fail
            let _ = write!(start, "{axis}{at} ");
        }
    }
    let mut places = Vec::new();
    let mut plan = Vec::new();
    for cycle in 1..=args.cycles as usize {
        for direction in [1_i8, -1] {
            let mut run = targets.clone();
            if direction < 0 {
                run.reverse();
            }
            // from beyond the first target, so that it is approached in the direction of the run
            places.push(format!("~{letter}{}", travel[usize::from(direction < 0)]));
            for target in run {
                places.push(format!("{letter}{target}"));
                plan.push((cycle, direction, target));
            }
        }
    }
    let program = through::stops(&start, places.iter().map(String::as_str));
    let points = through::run(machine, &program, Want::Stops)?;
    let Some(first) = points.first().filter(|_| points.len() == plan.len()) else {
        let message = format_args!("{} stops were programmed, {} measured", plan.len(), points.len());
        return Err(Failure::new(EX_DATAERR, message));
    };
    let mut unit = [0.0; 3];
    unit[letter.direction()] = 1.0;
    let mut random = ChaCha8Rng::seed_from_u64(args.seed);
    Ok(plan
        .iter()
        .zip(&points)
        .map(|((cycle, direction, target), p)| {
            let noise: f64 = StandardNormal.sample(&mut random);
            PositioningRow {
                cycle: *cycle,
                direction: *direction,
                target_mm: *target,
                deviation_um: through::displacement_um(first, p, unit) + args.noise_um * noise,
            }
        })
        .collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn targets_are_spread_within_the_travel() {
        let at = targets(21, AxisName::X, [0.0, 850.0]);
        let steps: Vec<f64> = at.windows(2).map(|w| w[1] - w[0]).collect();
        let (least, most) = steps.iter().fold((f64::MAX, 0.0_f64), |(l, m), s| (l.min(*s), m.max(*s)));
        assert!(
            at[0] >= 8.5 && at[20] <= 841.5 && least > 25.0 && most < 55.0 && most - least > 5.0,
            "{at:?}"
        );
        assert_eq!(targets(21, AxisName::X, [0.0, 850.0]), at, "the same part program each time");
    }
}
