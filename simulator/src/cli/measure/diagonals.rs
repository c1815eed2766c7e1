//! `cncsim measure diagonals`: a laser along the four body diagonals.

use std::fmt::Write as _;
use std::path::PathBuf;

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use volcomp_units::axes::AxisName;

use super::straightness::{point, write};
use super::through::{self, ThroughArgs};
use crate::cli::serve::built_in_or_file;
use crate::cli::{EX_DATAERR, EX_USAGE, Failure};
use crate::instruments::diagonal::{BodyDiagonals, Diagonal};
use crate::through::{Measured, Want};

/// A laser along the four body diagonals of a box, out and back.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// The machine: a truth file, or one of the built-in vmc-850, gantry-5ax.
    #[arg(long, value_name = "FILE|NAME", default_value = "vmc-850")]
    machine: PathBuf,
    #[command(flatten)]
    through: ThroughArgs,
    /// Folder for the file; made where it does not exist.
    #[arg(long, value_name = "FOLDER")]
    out: PathBuf,
    /// Lower corner of the box, programmed; default: the lower ends of the travels.
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true)]
    low_mm: Option<[f64; 3]>,
    /// Sides of the box; default: up to the upper ends of the travels.
    #[arg(long, value_name = "A,B,C", value_parser = point)]
    box_mm: Option<[f64; 3]>,
    /// Reflector in M at home; default: the tool tip.
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true)]
    reflector_mm: Option<[f64; 3]>,
    /// Steps along each diagonal.
    #[arg(long, default_value = "10")]
    steps: usize,
    /// Out and back so many times.
    #[arg(long, default_value = "5")]
    cycles: usize,
    /// Drift of laser and machine from reading to reading, um.
    #[arg(long, default_value = "0.02", allow_hyphen_values = true)]
    drift_um: f64,
    /// Standard deviation of a reading, um.
    #[arg(long, default_value = "0.3")]
    noise_um: f64,
    /// Seed of the noise.
    #[arg(long, default_value = "1")]
    seed: u64,
}

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    let commented = |text: &str| format!("# {}\n{text}", args.through.how(&args.machine));
    if let Some(mut machine) = args.through.open(&args.machine, &args.out)? {
        let text = under_control(args, machine.as_mut())?;
        write(&args.out, "diagonals.csv", &commented(&text))?;
        say!("volcomp evaluate iso230-6 --data {}", args.out.join("diagonals.csv").display());
        return Ok(());
    }
    let mut machine = built_in_or_file(&args.machine)?;
    if let Some(reflector) = args.reflector_mm {
        machine.set_tool_tip_mm(reflector);
    }
    let mut xyz = [0; 3];
    for (slot, axis) in xyz.iter_mut().zip([AxisName::X, AxisName::Y, AxisName::Z]) {
        *slot = machine.index_of(axis).ok_or_else(|| {
            Failure::new(
                EX_USAGE,
                format_args!("the machine has no axis {axis}; body diagonals need X, Y and Z"),
            )
        })?;
    }
    let low_mm = args.low_mm.unwrap_or_else(|| xyz.map(|k| machine.travel(k)[0]));
    let size = args.box_mm.unwrap_or_else(|| std::array::from_fn(|i| machine.travel(xyz[i])[1] - low_mm[i]));
    let plan = BodyDiagonals {
        xyz,
        low_mm,
        high_mm: std::array::from_fn(|i| low_mm[i] + size[i]),
        steps: args.steps,
        cycles: args.cycles,
        drift_um: args.drift_um,
        noise_um: args.noise_um,
        seed: args.seed,
    };
    let text = Diagonal::body_diagonals(&machine, &plan).map_err(|e| Failure::new(EX_DATAERR, e))?;
    write(&args.out, "diagonals.csv", &commented(&text))?;
    let list = |[x, y, z]: [f64; 3]| format!("{x},{y},{z}");
    note!("with a model whose angular error motions are known (here angles.toml, for example):");
    say!(
        "volcomp identify diagonals --data {}/diagonals.csv --low-mm {} --box-mm {} --reflector-mm {} --model angles.toml --into angles.toml --out model.toml",
        args.out.display(),
        list(low_mm),
        list(size),
        list(machine.tool_tip_mm())
    );
    Ok(())
}

/// The diagonals of the machine under its control: the laser keeps its zero at the start of the first way out.
fn under_control(args: &Args, machine: &mut dyn Measured) -> Result<String, Failure> {
    if args.reflector_mm.is_some() {
        return Err(Failure::new(EX_USAGE, "--through measures at the tool tip; leave --reflector-mm out"));
    }
    let mut travel = [[0.0; 2]; 3];
    for (slot, axis) in travel.iter_mut().zip([AxisName::X, AxisName::Y, AxisName::Z]) {
        *slot = through::travel(machine, axis)?;
    }
    let low = args.low_mm.unwrap_or_else(|| travel.map(|t| t[0]));
    let size = args.box_mm.unwrap_or_else(|| std::array::from_fn(|i| travel[i][1] - low[i]));
    let length = size.iter().map(|v| v * v).sum::<f64>().sqrt();
    if args.steps == 0 || length <= 0.0 {
        return Err(Failure::new(EX_USAGE, "body diagonals need steps and a box with sides above 0"));
    }
    let (mut random, mut drift_um) = (ChaCha8Rng::seed_from_u64(args.seed), 0.0);
    let mut text = String::from("diagonal,cycle,direction,target_mm,deviation_um\n");
    for signs in [[1.0, 1.0, 1.0], [-1.0, 1.0, 1.0], [1.0, -1.0, 1.0], [1.0, 1.0, -1.0]] {
        let place = |step: usize| {
            let share = step as f64 / args.steps as f64;
            let at = |i: usize| {
                let way = if signs[i] > 0.0 { share } else { 1.0 - share };
                // whole tenths of a micrometre, as a part program has them
                ((low[i] + way * size[i]) * 1e4).round() / 1e4
            };
            format!("X{} Y{} Z{}", at(0), at(1), at(2))
        };
        let there = (0..=args.steps).map(|s| (1, s));
        let back = (0..=args.steps).rev().map(|s| (-1, s));
        let run: Vec<(i32, usize)> = there.chain(back).collect();
        let plan: Vec<(usize, i32, usize)> =
            (1..=args.cycles).flat_map(|c| run.iter().map(move |(d, s)| (c, *d, *s))).collect();
        let places: Vec<String> = plan.iter().map(|(_, _, step)| place(*step)).collect();
        let program = through::stops(&place(0), places.iter().map(String::as_str));
        let points = through::run(machine, &program, Want::Stops)?;
        let Some(first) = points.first().filter(|_| points.len() == plan.len()) else {
            let message = format_args!("{} stops were programmed, {} measured", plan.len(), points.len());
            return Err(Failure::new(EX_DATAERR, message));
        };
        let unit = std::array::from_fn(|i| signs[i] * size[i] / length);
        let name: String = signs.iter().map(|s| if *s > 0.0 { 'p' } else { 'n' }).collect();
        for ((cycle, direction, step), p) in plan.iter().zip(&points) {
            let noise: f64 = StandardNormal.sample(&mut random);
            drift_um += args.drift_um;
            let target = length * *step as f64 / args.steps as f64;
            let reading = through::displacement_um(first, p, unit) + drift_um + args.noise_um * noise;
            // writing into a string cannot fail
            let _ = writeln!(text, "{name},{cycle},{direction},{target:.6},{reading:.5}");
        }
    }
    Ok(text)
}
