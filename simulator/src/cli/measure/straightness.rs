//! `cncsim measure straightness`: a 6D interferometer on one axis, with a tilt test.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use volcomp_units::axes::{AxisKind, AxisName};

use super::through::{self, ThroughArgs};
use crate::cli::serve::built_in_or_file;
use crate::cli::{EX_DATAERR, EX_IOERR, EX_USAGE, Failure};
use crate::instruments::carriage::{Carriage, Mount};
use crate::instruments::sixd::{SixD, SixDErrors, run_csv, sign_table, tilt_csv};
use crate::through::{Measured, Want};
use crate::truth::TruthMachine;
use crate::truth::chain::Side;

/// A 6D interferometer on one axis: run, tilt test and sign table.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// The machine: a truth file, or one of the built-in vmc-850, gantry-5ax, grinder-ab.
    #[arg(long, value_name = "FILE|NAME", default_value = "vmc-850")]
    machine: PathBuf,
    /// With it the straightness of the tool's path is measured, as straightness-x.csv, and no angle.
    #[command(flatten)]
    through: ThroughArgs,
    /// Folder for the files; made where it does not exist.
    #[arg(long, value_name = "FOLDER")]
    out: PathBuf,
    /// The axis that moves.
    #[arg(long, value_parser = linear_axis, default_value = "x")]
    axis: AxisName,
    /// Where instrument and optics stand.
    #[arg(long, value_enum, default_value = "carriage")]
    mount: MountArg,
    /// Reflector of the distance, in M at home.
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true, default_value = "400,250,-600")]
    abbe_mm: [f64; 3],
    /// Reflector of the straightnesses, in M at home.
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true, default_value = "430,250,-560")]
    bryan_mm: [f64; 3],
    /// An instrument whose pitch and yaw are not right-handed, as that of paper 004.
    #[arg(long)]
    left_handed: bool,
    /// Positions over the travel.
    #[arg(long, default_value = "35")]
    positions: usize,
    /// Runs out and back.
    #[arg(long, default_value = "3")]
    cycles: usize,
    /// Standard deviation of a length, um.
    #[arg(long, default_value = "0.2")]
    noise_um: f64,
    /// Standard deviation of an angle, arcsec.
    #[arg(long, default_value = "0.1")]
    noise_arcsec: f64,
    /// Seed of the noise.
    #[arg(long, default_value = "1")]
    seed: u64,
}

/// Where instrument and optics stand.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub(super) enum MountArg {
    /// Instrument on the bed side, optics on the carriage.
    Carriage,
    /// Instrument on the workpiece side, optics on the tool side.
    Relative,
}

impl From<MountArg> for Mount {
    fn from(arg: MountArg) -> Self {
        match arg {
            MountArg::Carriage => Self::Carriage,
            MountArg::Relative => Self::Relative,
        }
    }
}

impl MountArg {
    /// For `--sense`.
    pub(super) const fn sense(self) -> &'static str {
        match self {
            Self::Carriage => "carriage",
            Self::Relative => "relative",
        }
    }

    /// For `--body`: optics on the tool side stand with the bed while a workpiece-side axis moves.
    pub(super) fn body(self, machine: &TruthMachine, axis: AxisName) -> &'static str {
        let primed = machine
            .index_of(axis)
            .and_then(|k| machine.drawing(k))
            .is_some_and(|joint| joint.side == Side::Workpiece);
        if self == Self::Relative && primed { "bed" } else { "carriage" }
    }
}

/// A linear axis by its letter.
pub(super) fn linear_axis(text: &str) -> Result<AxisName, String> {
    let mut letters = text.chars();
    match (letters.next().and_then(AxisName::from_letter), letters.next()) {
        (Some(axis), None) if axis.kind() == AxisKind::Linear => Ok(axis),
        _ => Err(format!("invalid linear axis '{text}'; expected one of x y z u v w")),
    }
}

/// Three numbers.
pub(super) fn point(text: &str) -> Result<[f64; 3], String> {
    let numbers: Option<Vec<f64>> =
        text.split(',').map(|t| t.trim().parse().ok().filter(|v: &f64| v.is_finite())).collect();
    numbers
        .and_then(|n| n.try_into().ok())
        .ok_or_else(|| format!("invalid point '{text}'; write three numbers, such as 0,250,-120"))
}

/// Writes a file into a folder, which is made where it does not exist.
pub(super) fn write(folder: &Path, name: &str, text: &str) -> Result<(), Failure> {
    let path = folder.join(name);
    crate::cli::make_folder(folder)
        .and_then(|()| crate::cli::write_file(&path, text))
        .map_err(|e| Failure::in_file(EX_IOERR, &path, e))?;
    note!("written: {}", path.display());
    Ok(())
}

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    if let Some(mut machine) = args.through.open(&args.machine, &args.out)? {
        let letter = args.axis.lower();
        let name = format!("straightness-{letter}.csv");
        write(&args.out, &name, &under_control(args, machine.as_mut())?)?;
        say!("volcomp identify straightness --axis {letter} --data {}", args.out.join(name).display());
        return Ok(());
    }
    let machine = built_in_or_file(&args.machine)?;
    // distance and vertical as in the machine, horizontal the other way round: roll and yaw change sign with it
    let mut signs = [1.0, -1.0, 1.0, -1.0, 1.0, -1.0];
    if args.left_handed {
        signs[4] = -signs[4];
        signs[5] = -signs[5];
    }
    let instrument = SixD {
        abbe_mm: args.abbe_mm,
        bryan_mm: args.bryan_mm,
        signs,
        skew_arcsec: [25.0, -14.0],
        noise_um: args.noise_um,
        noise_arcsec: args.noise_arcsec,
        errors: SixDErrors::NONE,
        seed: args.seed,
    };
    let fail = |e| Failure::new(EX_DATAERR, e);
    let carriage = Carriage::new(&machine, args.axis, args.mount.into()).map_err(fail)?;
    let rows = instrument.run(args.axis, &carriage, args.positions, args.cycles).map_err(fail)?;
    let letter = args.axis.lower();
    write(&args.out, "sixd-signs.toml", &sign_table(args.axis, &signs))?;
    write(&args.out, "sixd-tilt.csv", &tilt_csv(&instrument.tilts(args.axis, 20.0)))?;
    write(&args.out, &format!("sixd-{letter}.csv"), &run_csv(&rows))?;
    let (chain, folder) = (machine.chain().text(), args.out.display());
    let list = |[x, y, z]: [f64; 3]| format!("{x},{y},{z}");
    say!(
        "volcomp identify straightness --axis {letter} --signs {folder}/sixd-signs.toml --tilt-test {folder}/sixd-tilt.csv --data {folder}/sixd-{letter}.csv --chain \"{chain}\" --sense {} --body {} --abbe-mm {} --bryan-mm {} --out model.toml",
        args.mount.sense(),
        args.mount.body(&machine, args.axis),
        list(args.abbe_mm),
        list(args.bryan_mm)
    );
    Ok(())
}

/// The tool's path aside while one axis moves under the control, in both directions.
fn under_control(args: &Args, machine: &mut dyn Measured) -> Result<String, Failure> {
    let letter = args.axis;
    let [low, high] = through::travel(machine, letter)?;
    if args.positions < 3 || args.cycles == 0 {
        return Err(Failure::new(EX_USAGE, "straightness needs at least 3 positions and a cycle"));
    }
    let mut start = String::new();
    for axis in [AxisName::X, AxisName::Y, AxisName::Z] {
        if let Some([low, high]) = machine.about().travel(axis) {
            let at = if axis == letter { low } else { (low + high) / 2.0 };
            // writing into a string cannot fail
            let _ = write!(start, "{axis}{at} ");
        }
    }
    let step = (high - low) / (args.positions - 1) as f64;
    let at = |i: usize| ((low + step * i as f64) * 1e3).round() / 1e3;
    let there = (0..args.positions).map(|i| (1, at(i)));
    let run: Vec<(i8, f64)> = there.clone().chain(there.rev().map(|(_, q)| (-1, q))).collect();
    let plan: Vec<(usize, i8, f64)> =
        (1..=args.cycles).flat_map(|c| run.iter().map(move |(d, q)| (c, *d, *q))).collect();
    let places: Vec<String> = plan.iter().map(|(_, _, q)| format!("{letter}{q}")).collect();
    let program = through::stops(&start, places.iter().map(String::as_str));
    let points = through::run(machine, &program, Want::Stops)?;
    if points.len() != plan.len() {
        let message = format_args!("{} stops were programmed, {} measured", plan.len(), points.len());
        return Err(Failure::new(EX_DATAERR, message));
    }
    let lateral = [1, 2].map(|i| (letter.direction() + i) % 3);
    let [first, second] = lateral.map(|i| format!("e{}{}_um", ['x', 'y', 'z'][i], letter.lower()));
    let mut text = format!("cycle,direction,position_mm,{first},{second}\n");
    let mut random = ChaCha8Rng::seed_from_u64(args.seed);
    for ((cycle, direction, q), p) in plan.iter().zip(&points) {
        let [a, b] = lateral.map(|i| {
            let noise: f64 = StandardNormal.sample(&mut random);
            1e3 * (p.actual_mm[i] - p.nominal_mm[i]) + args.noise_um * noise
        });
        let _ = writeln!(text, "{cycle},{direction},{q},{a:.5},{b:.5}");
    }
    Ok(text)
}
