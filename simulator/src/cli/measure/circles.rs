//! `cncsim measure circles`: a target on the turning spindle, seen at two heights.

use std::fmt::Write as _;
use std::path::PathBuf;

use nalgebra::Vector3;
use volcomp_units::axes::{AxisArray, AxisName, MAX_AXES};

use super::common::{not_negative, write};
use crate::cli::serve::built_in_or_file;
use crate::cli::{EX_USAGE, Failure};
use crate::instruments::tracker::{PointNoise, on_tool};

/// A tracker sees a target on the turning spindle draw two circles, at one pose of the machine.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// The machine: a truth file, or one of the built-in vmc-850, gantry-5ax, grinder-ab.
    #[arg(long, value_name = "FILE", default_value = "gantry-5ax")]
    machine: PathBuf,
    /// Where the axes stand, such as z=-200,c=30,a=-20 (mm, deg); the others at home.
    #[arg(long, value_name = "AXIS=VALUE", value_delimiter = ',', value_parser = coordinate, allow_hyphen_values = true)]
    at: Vec<(AxisName, f64)>,
    /// Radius of both circles, mm.
    #[arg(long, default_value = "50", value_parser = not_negative)]
    radius_mm: f64,
    /// Distance of the circles, mm.
    #[arg(long, default_value = "150", value_parser = not_negative)]
    distance_mm: f64,
    /// Distance of the tip from the nearer circle, mm.
    #[arg(long, default_value = "100", value_parser = not_negative)]
    tip_beyond_mm: f64,
    /// Points per circle.
    #[arg(long, default_value = "72", value_parser = clap::value_parser!(u32).range(3..=100_000))]
    points: u32,
    /// Standard deviation of a coordinate, um.
    #[arg(long, default_value = "2", value_parser = not_negative)]
    noise_um: f64,
    /// Seed of the noise.
    #[arg(long, default_value = "1")]
    seed: u64,
    /// Folder for the files; made where it is missing.
    #[arg(long, value_name = "DIR", default_value = ".")]
    out: PathBuf,
}

/// `z=-200`.
fn coordinate(text: &str) -> Result<(AxisName, f64), String> {
    let (axis, value) = text.split_once('=').ok_or("write for example z=-200")?;
    let mut letters = axis.trim().chars();
    let axis = letters
        .next()
        .filter(|_| letters.next().is_none())
        .and_then(AxisName::from_letter)
        .ok_or_else(|| format!("unknown axis '{axis}'"))?;
    match value.trim().parse::<f64>() {
        Ok(v) if v.is_finite() => Ok((axis, v)),
        _ => Err(format!("'{value}' is not a finite number")),
    }
}

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    let machine = built_in_or_file(&args.machine)?;
    let mut q = AxisArray::default();
    for (axis, value) in &args.at {
        let k = machine.index_of(*axis).ok_or_else(|| {
            Failure::new(EX_USAGE, format_args!("machine {} has no axis {axis}", machine.machine()))
        })?;
        q[k] = *value;
    }
    let mut noise = PointNoise::new(args.noise_um, args.seed);
    let mut text = String::from("circle,x_mm,y_mm,z_mm\n");
    for (circle, height) in [(1, args.tip_beyond_mm + args.distance_mm), (2, args.tip_beyond_mm)] {
        let on_circle: Vec<[f64; 3]> = (0..args.points)
            .map(|i| {
                let (s, c) = (f64::from(i) * core::f64::consts::TAU / f64::from(args.points)).sin_cos();
                [args.radius_mm * c, args.radius_mm * s, height]
            })
            .collect();
        for p in on_tool(&machine, &q, &[0; MAX_AXES], &on_circle) {
            let [x, y, z] = noise.read(p);
            let _ = writeln!(text, "{circle},{x:.7},{y:.7},{z:.7}");
        }
    }
    write(&args.out, "circles.csv", &text)?;
    let nominal = machine.nominal(&q);
    let tip = Vector3::from(nominal.tip_mm) + Vector3::from(machine.workpiece_origin_mm());
    let list = |v: [f64; 3]| v.map(|x| x.to_string()).join(",");
    say!(
        "volcomp identify circles --data {} --tip-beyond-mm {} --noise-um {} --nominal-axis {} --nominal-tip-mm {}",
        args.out.join("circles.csv").display(),
        args.tip_beyond_mm,
        args.noise_um.max(1e-6),
        list(nominal.direction),
        list(tip.into())
    );
    Ok(())
}
