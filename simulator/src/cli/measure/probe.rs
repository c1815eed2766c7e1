//! `cncsim measure probe`: contacts of a touch probe with a gauge bar.

use std::fmt::Write;
use std::path::PathBuf;

use crate::cli::serve::built_in_or_file;
use crate::cli::{EX_DATAERR, EX_IOERR, Failure};
use crate::instruments::probe::{Arm, GaugeBar};

/// Touch a gauge bar in the A axis with a probe on an arm about B; prints the command that identifies the probe.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// The machine: a truth file, or one of the built-in vmc-850, gantry-5ax, grinder-ab.
    #[arg(long, value_name = "FILE|NAME", default_value = "grinder-ab")]
    machine: PathBuf,
    /// Folder for contacts.csv; made where it does not exist.
    #[arg(long, value_name = "FOLDER")]
    out: PathBuf,
    /// Radius of the bar.
    #[arg(long, value_name = "MM", default_value_t = 15.0)]
    bar_radius_mm: f64,
    /// Effective radius of the ball.
    #[arg(long, value_name = "MM", default_value_t = 1.4935)]
    ball_radius_mm: f64,
    /// Distance of neighbouring contacts in Y.
    #[arg(long, value_name = "MM", default_value_t = 0.2)]
    spacing_mm: f64,
    /// Touch the upper side of the bar only.
    #[arg(long)]
    one_side: bool,
    /// Standard deviation of a contact along its normal.
    #[arg(long, value_name = "UM", default_value_t = 0.5)]
    noise_um: f64,
    /// Seed of the noise.
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    let machine = built_in_or_file(&args.machine)?;
    let bar = GaugeBar {
        bar_radius_mm: args.bar_radius_mm,
        ball_radius_mm: args.ball_radius_mm,
        spacing_mm: args.spacing_mm,
        both_sides: !args.one_side,
        noise_um: args.noise_um,
        seed: args.seed,
    };
    let cannot = |e| Failure::in_file(EX_DATAERR, &args.machine, e);
    let arm = Arm::of(&machine).map_err(cannot)?;
    let touches = bar.touches(&machine).map_err(cannot)?;
    let mut text = String::from("y_mm,b_deg\n");
    for t in &touches {
        // writing into a string cannot fail
        let _ = writeln!(text, "{:.7},{:.10}", t.y_mm, t.b_deg);
    }
    crate::cli::make_folder(&args.out).map_err(|e| Failure::in_file(EX_IOERR, &args.out, e))?;
    let path = args.out.join("contacts.csv");
    crate::cli::write_file(&path, text).map_err(|e| Failure::in_file(EX_IOERR, &path, e))?;
    note!("{} contacts; now calibrate the probe with", touches.len());
    say!(
        "volcomp identify probe --data {} --arm-mm {:.7} --arm-zero-deg={:.9} --bar-radius-mm {} --nominal-mm={},{} --out {}",
        path.display(),
        arm.length_mm,
        arm.zero_deg,
        args.bar_radius_mm,
        arm.bar_y_mm,
        arm.bar_z_mm,
        args.out.join("model.toml").display()
    );
    Ok(())
}
