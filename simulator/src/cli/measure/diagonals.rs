//! `cncsim measure diagonals`: a laser along the four body diagonals.

use std::path::PathBuf;

use volcomp_units::axes::AxisName;

use super::straightness::{point, write};
use crate::cli::serve::built_in_or_file;
use crate::cli::{EX_DATAERR, EX_USAGE, Failure};
use crate::instruments::diagonal::{BodyDiagonals, Diagonal};

/// A laser along the four body diagonals of a box, out and back.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// The machine: a truth file, or one of the built-in vmc-850, gantry-5ax.
    #[arg(long, value_name = "FILE|NAME", default_value = "vmc-850")]
    machine: PathBuf,
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
    write(&args.out, "diagonals.csv", &text)?;
    let list = |[x, y, z]: [f64; 3]| format!("{x},{y},{z}");
    say!(
        "volcomp identify diagonals --data {}/diagonals.csv --low-mm {} --box-mm {} --reflector-mm {} --model angles.toml --into angles.toml --out model.toml",
        args.out.display(),
        list(low_mm),
        list(size),
        list(machine.tool_tip_mm())
    );
    Ok(())
}
