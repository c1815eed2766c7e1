//! `cncsim measure fivedof`: a 5-DOF laser on one axis, with its log of the resting carriage.

use std::path::PathBuf;

use volcomp_units::axes::AxisName;

use super::straightness::{MountArg, linear_axis, point, write};
use crate::cli::serve::built_in_or_file;
use crate::cli::{EX_DATAERR, Failure};
use crate::instruments::carriage::Carriage;
use crate::instruments::fivedof::{FiveDofLaser, rest_csv, run_csv};

/// A 5-DOF laser on one axis: run, resting log and instrument file.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// The machine: a truth file, or one of the built-in vmc-850, gantry-5ax, grinder-ab.
    #[arg(long, value_name = "FILE|NAME", default_value = "vmc-850")]
    machine: PathBuf,
    /// Folder for the files; made where it does not exist.
    #[arg(long, value_name = "FOLDER")]
    out: PathBuf,
    /// The axis that moves.
    #[arg(long, value_parser = linear_axis, default_value = "x")]
    axis: AxisName,
    /// Where head and optics stand.
    #[arg(long, value_enum, default_value = "carriage")]
    mount: MountArg,
    /// Point between the corner cubes, in M at home.
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true, default_value = "400,250,-600")]
    point_mm: [f64; 3],
    /// Positions over the travel.
    #[arg(long, default_value = "21")]
    positions: usize,
    /// Runs out and back.
    #[arg(long, default_value = "2")]
    cycles: usize,
    /// Readings of the resting log at each of two distances.
    #[arg(long, default_value = "200")]
    resting: usize,
    /// Wander of the pointing from reading to reading, arcsec.
    #[arg(long, default_value = "0.1")]
    drift_arcsec: f64,
    /// Standard deviation of a detector channel, um.
    #[arg(long, default_value = "0.1")]
    noise_um: f64,
    /// Standard deviation of the level, arcsec.
    #[arg(long, default_value = "0.1")]
    noise_arcsec: f64,
    /// Seed of the noise.
    #[arg(long, default_value = "1")]
    seed: u64,
}

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    let machine = built_in_or_file(&args.machine)?;
    let laser = FiveDofLaser {
        drift_arcsec: args.drift_arcsec,
        noise_um: args.noise_um,
        noise_arcsec: args.noise_arcsec,
        ..FiveDofLaser::built_in(args.point_mm, args.seed)
    };
    let fail = |e| Failure::new(EX_DATAERR, e);
    let carriage = Carriage::new(&machine, args.axis, args.mount.into()).map_err(fail)?;
    let rows = laser.run(args.axis, &carriage, args.positions, args.cycles).map_err(fail)?;
    let rest = laser.rest(args.axis, &carriage, args.resting, 50.0);
    let [f1, f2, f3] = laser.focal_mm;
    let [[y1, z1], [y2, z2]] = laser.beams_mm;
    let head = format!(
        "format = \"volcomp-fivedof/1\"\ninstrument = \"cncsim 5-DOF laser\"\n\
        focal-mm = {{ psd1 = {f1}, psd2 = {f2}, psd3 = {f3} }}\nbeam-1-mm = [{y1}, {z1}]\nbeam-2-mm = [{y2}, {z2}]\n"
    );
    let letter = args.axis.lower();
    write(&args.out, "fivedof-head.toml", &head)?;
    write(&args.out, &format!("fivedof-rest-{letter}.csv"), &rest_csv(args.axis, &rest))?;
    write(&args.out, &format!("fivedof-{letter}.csv"), &run_csv(args.axis, &rows))?;
    let (chain, folder) = (machine.chain().text(), args.out.display());
    let [x, y, z] = args.point_mm;
    say!(
        "volcomp identify fivedof --axis {letter} --calibration {folder}/fivedof-head.toml --resting {folder}/fivedof-rest-{letter}.csv --data {folder}/fivedof-{letter}.csv --chain \"{chain}\" --sense {} --body {} --point-mm {x},{y},{z} --out model.toml",
        args.mount.sense(),
        args.mount.body(&machine, args.axis)
    );
    Ok(())
}
