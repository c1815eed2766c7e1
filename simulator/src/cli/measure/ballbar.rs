//! `cncsim measure ballbar`: circles of the machine, its drives and friction included.

use std::fmt::Write;
use std::path::PathBuf;

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use volcomp_units::axes::{AxisArray, AxisName};

use super::straightness::point;
use super::through::{self, ThroughArgs};
use crate::cli::serve::built_in_or_file;
use crate::cli::{EX_DATAERR, EX_IOERR, Failure};
use crate::instruments::ballbar::{Ballbar, CirclePoint, Run};
use crate::through::{Measured, Want};
use crate::truth::TruthMachine;

/// Run ballbar circles in one or more planes, both directions; prints the command that ranks their causes.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// The machine: a truth file, or one of the built-in vmc-850, gantry-5ax, grinder-ab.
    #[arg(long, value_name = "FILE|NAME", default_value = "vmc-850")]
    machine: PathBuf,
    #[command(flatten)]
    through: ThroughArgs,
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

/// Run circles in one or more planes as a grid encoder sees them: about the programmed centre, for volcomp evaluate
/// iso230-4.
#[derive(Debug, clap::Args)]
pub(super) struct CircleArgs {
    #[command(flatten)]
    circles: Args,
}

/// `cncsim measure circle`: no mounting offset.
pub(super) fn run_circle(args: &CircleArgs) -> Result<(), Failure> {
    run_as(&args.circles, "circle", 0.0)
}

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    run_as(args, "ballbar", args.mounting_um)
}

fn run_as(args: &Args, file: &str, mounting_um: f64) -> Result<(), Failure> {
    let mut under_control = args.through.open(&args.machine, &args.out)?;
    let mut machine = built_in_or_file(&args.machine)?;
    let centre = match &under_control {
        Some(control) => centre_of_travels(args, |axis| control.about().travel(axis)),
        None => centre_of_travels(args, |axis| machine.index_of(axis).map(|k| machine.travel(k))),
    };
    crate::cli::make_folder(&args.out).map_err(|e| Failure::in_file(EX_IOERR, &args.out, e))?;
    let mut command = String::from("volcomp identify ballbar");
    for (index, plane) in args.plane.iter().enumerate() {
        let (name, axes) = plane.name_and_axes();
        let seed = args.seed.wrapping_add(1000 * index as u64);
        let mut source = match &mut under_control {
            Some(control) => Source::Control(control.as_mut()),
            None => Source::Machine(&mut machine),
        };
        let text = circles(args, &mut source, (centre, axes), seed, mounting_um)?;
        let path = args.out.join(format!("{file}-{name}.csv"));
        crate::cli::write_file(&path, text).map_err(|e| Failure::in_file(EX_IOERR, &path, e))?;
        // writing into a string cannot fail
        let _ = write!(command, " --data {name}={}", path.display());
    }
    if file == "circle" {
        for plane in &args.plane {
            let (name, _) = plane.name_and_axes();
            let path = args.out.join(format!("{file}-{name}.csv"));
            say!(
                "volcomp evaluate iso230-4 --data {} --plane {name} --radius-mm {}",
                path.display(),
                args.radius_mm
            );
        }
        return Ok(());
    }
    note!("circles run; now rank their causes with");
    let [x, y, z] = centre;
    let cut =
        if args.arc_deg < 360.0 { format!(" --overshoot-deg {}", args.overshoot_deg) } else { String::new() };
    say!("{command} --radius-mm {} --centre-mm={x},{y},{z}{cut}", args.radius_mm);
    Ok(())
}

/// What runs the circles.
enum Source<'a> {
    /// The machine with its drives, without a control.
    Machine(&'a mut TruthMachine),
    /// The machine under its control.
    Control(&'a mut dyn Measured),
}

impl Source<'_> {
    /// Commanded and actual tip along a run, and the nominal centre, in the workpiece frame.
    fn circle(&mut self, args: &Args, run: &Run, seed: u64) -> Result<(Vec<CirclePoint>, [f64; 3]), Failure> {
        match self {
            Self::Machine(machine) => {
                let points =
                    run.on(machine, seed).map_err(|e| Failure::in_file(EX_DATAERR, &args.machine, e))?;
                Ok((points, machine_centre(machine, run.centre_mm)))
            }
            Self::Control(control) => {
                let cycle_s = control.about().cycle_s;
                let every = (1.0 / (cycle_s * args.rate_hz)).round().max(1.0) as usize;
                let points = through::run(*control, &program(run), Want::Path(every))?;
                let axes = control.about().axes.clone();
                // the workpiece frame stands still: linear axes move the nominal tip one by one
                let home = std::array::from_fn(|i| {
                    let k = axes.chars().position(|c| c == ['X', 'Y', 'Z'][i]);
                    let first = points.first();
                    let nominal = first.map_or(0.0, |p| p.nominal_mm[i]);
                    let commanded = first.zip(k).map_or(0.0, |(p, k)| p.commanded[k]);
                    run.centre_mm[i] + nominal - commanded
                });
                let circle =
                    points.iter().map(|p| CirclePoint { commanded_mm: p.nominal_mm, actual_mm: p.actual_mm });
                Ok((circle.collect(), home))
            }
        }
    }
}

/// The part program of a run: arcs of at most a third of a turn.
fn program(run: &Run) -> String {
    let letters = ['X', 'Y', 'Z'];
    let [a, b] = run.plane;
    let plane = match run.plane {
        [0, 1] => 17,
        [2, 0] => 18,
        _ => 19,
    };
    let [from, to] = run.from_to_deg;
    let (begin, end) = (from - run.overshoot_deg, to + run.overshoot_deg);
    let (begin, end) = if run.counter_clockwise { (begin, end) } else { (end, begin) };
    let arcs = ((end - begin).abs() / 120.0).ceil().max(1.0) as usize;
    let at = |deg: f64| {
        let (sin, cos) = deg.to_radians().sin_cos();
        let mut place = run.centre_mm;
        place[a] += run.radius_mm * cos;
        place[b] += run.radius_mm * sin;
        place
    };
    let [x, y, z] = at(begin);
    let mut text = format!(
        "G21 G90 G94 G{plane}\n(SCORE OFF)\nG0 X{x:.6} Y{y:.6} Z{z:.6}\nG4 P0.5\nF{}\n(SCORE ON)\n",
        run.feed_mm_per_min
    );
    let word = if run.counter_clockwise { "G3" } else { "G2" };
    let centre = ['I', 'J', 'K'];
    let mut here = at(begin);
    for i in 1..=arcs {
        let next = at(begin + (end - begin) * i as f64 / arcs as f64);
        // writing into a string cannot fail
        let _ = writeln!(
            text,
            "{word} {}{:.6} {}{:.6} {}{:.6} {}{:.6}",
            letters[a],
            next[a],
            letters[b],
            next[b],
            centre[a],
            run.centre_mm[a] - here[a],
            centre[b],
            run.centre_mm[b] - here[b]
        );
        here = next;
    }
    text + "(SCORE OFF)\nM30\n"
}

/// The centre that was asked for, or the middle of the travels.
fn centre_of_travels(args: &Args, travel: impl Fn(AxisName) -> Option<[f64; 2]>) -> [f64; 3] {
    args.centre_mm.unwrap_or_else(|| {
        [AxisName::X, AxisName::Y, AxisName::Z]
            .map(|axis| travel(axis).map_or(0.0, |[low, high]| (low + high) / 2.0))
    })
}

/// All feeds and directions in one mounting of the instrument, as a table.
fn circles(
    args: &Args,
    source: &mut Source<'_>,
    (centre_mm, plane): ([f64; 3], [usize; 2]),
    seed: u64,
    mounting_um: f64,
) -> Result<String, Failure> {
    let cannot = |e| Failure::in_file(EX_DATAERR, &args.machine, e);
    let every = (1.0 / (CYCLE_S * args.rate_hz)).round().max(1.0) as usize;
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut mounting = [0, 1, 2].map(|_| {
        let unit: f64 = StandardNormal.sample(&mut random);
        mounting_um / 1e3 * unit
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
            let (points, home) = source.circle(args, &run, seed.wrapping_add((2 * f + d) as u64))?;
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
    let mut q = AxisArray::default();
    for (axis, value) in [AxisName::X, AxisName::Y, AxisName::Z].into_iter().zip(centre_mm) {
        if let Some(k) = machine.index_of(axis) {
            q[k] = value;
        }
    }
    machine.nominal(&q).tip_mm
}
