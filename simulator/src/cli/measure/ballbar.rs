//! `cncsim measure ballbar`: circles of the machine, its drives and friction included.

use std::fmt::Write;
use std::path::PathBuf;

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::straightness::point;
use crate::cli::serve::built_in_or_file;
use crate::cli::{EX_DATAERR, EX_IOERR, Failure};
use crate::instruments::ballbar::{Ballbar, Run};
use crate::truth::TruthMachine;

/// Run ballbar circles in one or more planes, both directions; prints the command that ranks their causes.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// The machine: a truth file, or one of the built-in vmc-850, gantry-5ax, grinder-ab.
    #[arg(long, value_name = "FILE|NAME", default_value = "vmc-850")]
    machine: PathBuf,
    /// Folder for ballbar-xy.csv ..; made where it does not exist.
    #[arg(long, value_name = "FOLDER")]
    out: PathBuf,
    /// Planes, such as xy,yz,zx.
    #[arg(long, value_name = "PLANES", value_delimiter = ',', default_value = "xy")]
    plane: Vec<PlaneArg>,
    /// Programmed X, Y, Z at the centre; default: the middle of the travels.
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true)]
    centre_mm: Option<[f64; 3]>,
    /// Radius.
    #[arg(long, value_name = "MM", default_value_t = 150.0)]
    radius_mm: f64,
    /// Feeds, each in both directions.
    #[arg(long, value_name = "FEEDS", value_delimiter = ',', default_value = "1000")]
    feed_mm_per_min: Vec<f64>,
    /// Arc: 360 is a full circle, 220 what a ballbar does in a vertical plane.
    #[arg(long, value_name = "DEG", default_value_t = 360.0)]
    arc_deg: f64,
    /// Where the measured part begins, from the first axis of the plane towards the second.
    #[arg(long, value_name = "DEG", default_value_t = 0.0, allow_hyphen_values = true)]
    start_deg: f64,
    /// Arc before and behind the measured part; it stays in the files.
    #[arg(long, value_name = "DEG", default_value_t = 180.0)]
    overshoot_deg: f64,
    /// Readings per second.
    #[arg(long, value_name = "HZ", default_value_t = 200.0)]
    rate_hz: f64,
    /// Standard deviation of a reading.
    #[arg(long, value_name = "UM", default_value_t = 0.1)]
    noise_um: f64,
    /// Standard deviation of the offset with which the centre ball is mounted.
    #[arg(long, value_name = "UM", default_value_t = 20.0)]
    mounting_um: f64,
    /// Seed of the noise.
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum PlaneArg {
    Xy,
    Yz,
    Zx,
}

impl PlaneArg {
    const fn name_and_axes(self) -> (&'static str, [usize; 2]) {
        match self {
            Self::Xy => ("xy", [0, 1]),
            Self::Yz => ("yz", [1, 2]),
            Self::Zx => ("zx", [2, 0]),
        }
    }
}

/// Control cycle, s.
const CYCLE_S: f64 = 0.001;

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    let mut machine = built_in_or_file(&args.machine)?;
    let centre = centre(args, &machine);
    crate::cli::make_folder(&args.out).map_err(|e| Failure::in_file(EX_IOERR, &args.out, e))?;
    let mut command = String::from("volcomp identify ballbar");
    for (index, plane) in args.plane.iter().enumerate() {
        let (name, axes) = plane.name_and_axes();
        let text = circles(args, &mut machine, centre, axes, args.seed.wrapping_add(1000 * index as u64))?;
        let path = args.out.join(format!("ballbar-{name}.csv"));
        crate::cli::write_file(&path, text).map_err(|e| Failure::in_file(EX_IOERR, &path, e))?;
        // writing into a string cannot fail
        let _ = write!(command, " --data {name}={}", path.display());
    }
    note!("circles run; now rank their causes with");
    let [x, y, z] = centre;
    let cut =
        if args.arc_deg < 360.0 { format!(" --overshoot-deg {}", args.overshoot_deg) } else { String::new() };
    say!("{command} --radius-mm {} --centre-mm={x},{y},{z}{cut}", args.radius_mm);
    Ok(())
}

fn centre(args: &Args, machine: &TruthMachine) -> [f64; 3] {
    use volcomp_units::axes::AxisName;
    if let Some(centre) = args.centre_mm {
        return centre;
    }
    [AxisName::X, AxisName::Y, AxisName::Z].map(|axis| {
        machine.index_of(axis).map_or(0.0, |k| {
            let [low, high] = machine.travel(k);
            (low + high) / 2.0
        })
    })
}

/// All feeds and directions in one mounting of the instrument, as a table.
fn circles(
    args: &Args,
    machine: &mut TruthMachine,
    centre_mm: [f64; 3],
    plane: [usize; 2],
    seed: u64,
) -> Result<String, Failure> {
    let cannot = |e| Failure::in_file(EX_DATAERR, &args.machine, e);
    let every = (1.0 / (CYCLE_S * args.rate_hz)).round().max(1.0) as usize;
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut mounting = [0, 1, 2].map(|_| {
        let unit: f64 = StandardNormal.sample(&mut random);
        args.mounting_um / 1e3 * unit
    });
    // across the plane the bar is set level
    mounting[3 - plane[0] - plane[1]] = 0.0;
    let mut text = String::from("angle_deg,deviation_um,direction,feed_mm_per_min\n");
    for (f, feed) in args.feed_mm_per_min.iter().enumerate() {
        for (d, counter_clockwise) in [true, false].into_iter().enumerate() {
            let run = Run {
                centre_mm,
                radius_mm: args.radius_mm,
                plane,
                feed_mm_per_min: *feed,
                counter_clockwise,
                from_to_deg: [args.start_deg, args.start_deg + args.arc_deg],
                overshoot_deg: args.overshoot_deg,
                cycle_s: CYCLE_S,
                every,
            };
            let points = run.on(machine, seed.wrapping_add((2 * f + d) as u64)).map_err(cannot)?;
            let home = machine_centre(machine, centre_mm);
            let ballbar = Ballbar {
                centre_mm: [0, 1, 2].map(|i| home[i] + mounting[i]),
                radius_mm: args.radius_mm,
                plane,
                noise_um: args.noise_um,
                seed: seed.wrapping_add(100 + (2 * f + d) as u64),
            };
            for r in ballbar.trace(&points).map_err(cannot)?.readings {
                // writing into a string cannot fail
                let _ = writeln!(text, "{:.6},{:.5},{},{feed}", r.angle_deg, r.deviation_um, r.direction);
            }
        }
    }
    Ok(text)
}

/// Nominal place of the tip in the workpiece frame with the axes at the centre.
fn machine_centre(machine: &TruthMachine, centre_mm: [f64; 3]) -> [f64; 3] {
    use volcomp_units::axes::{AxisArray, AxisName};
    let mut q = AxisArray::default();
    for (axis, value) in [AxisName::X, AxisName::Y, AxisName::Z].into_iter().zip(centre_mm) {
        if let Some(k) = machine.index_of(axis) {
            q[k] = value;
        }
    }
    machine.nominal(&q).tip_mm
}
