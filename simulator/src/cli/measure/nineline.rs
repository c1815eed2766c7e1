//! `cncsim measure nineline`: an interferometer along three lines of an axis.

use std::fmt::Write as _;

use super::common::{AxisPlan, not_negative};
use crate::cli::Failure;
use crate::instruments::tracker::{PointNoise, on_carriage, on_workpiece_side};

/// An interferometer measures displacement and straightness on three lines parallel to one axis.
///
/// Every run reads zero at its first stop. All lines are read for displacement; two for one straightness, one for the
/// other, or all of them with --all.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    #[command(flatten)]
    plan: AxisPlan,
    /// Distance of the lines from the tool tip, mm.
    #[arg(long, default_value = "150", value_parser = not_negative)]
    reach_mm: f64,
    /// Standard deviation of a reading, um.
    #[arg(long, default_value = "0.1", value_parser = not_negative)]
    noise_um: f64,
    /// Read all three directions on all lines: three readings more than needed test the others.
    #[arg(long)]
    all: bool,
}

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    let (machine, axis, k) = args.plan.open()?;
    let tip = machine.tool_tip_mm();
    let (u, r) = (axis.direction(), args.reach_mm);
    // lines 1 and 2 at equal height, line 3 above between them
    let (v, w) = ((u + 1) % 3, (u + 2) % 3);
    let targets: Vec<[f64; 3]> = [[-r, -r], [r, -r], [0.0, r]]
        .iter()
        .map(|offset| {
            let mut p = tip;
            p[v] += offset[0];
            p[w] += offset[1];
            p.map(|x| (x * 1e3).round() / 1e3)
        })
        .collect();
    // the first straightness needs two lines apart in the other direction: 1 and 3
    let read = |line: usize, d: usize| args.all || d == u || (d == v && line != 1) || (d == w && line == 0);
    let mut table = String::from("line,x_mm,y_mm,z_mm\n");
    let mut data = String::from("position_mm,cycle,direction");
    for (i, p) in targets.iter().enumerate() {
        let _ = writeln!(table, "l{},{},{},{}", i + 1, p[0], p[1], p[2]);
        for d in (0..3).filter(|d| read(i, *d)) {
            let _ = write!(data, ",l{}_d{}_um", i + 1, ["x", "y", "z"][d]);
        }
    }
    data.push('\n');
    let mut noise = PointNoise::new(args.noise_um, args.plan.seed);
    let stops = args.plan.stops(machine.travel(k));
    let sign = if on_workpiece_side(&machine, k) { -1.0 } else { 1.0 };
    let mut zero: Option<Vec<[f64; 3]>> = None;
    let mut run = 0;
    for stop in &stops {
        let mut shift = [0.0; 3];
        shift[u] = sign * stop.position;
        let error: Vec<[f64; 3]> = on_carriage(&machine, k, stop.position, stop.direction, &targets)
            .iter()
            .zip(&targets)
            .map(|(actual, home)| core::array::from_fn(|i| actual[i] - home[i] - shift[i]))
            .collect();
        if stop.cycle != run {
            run = stop.cycle;
            zero = Some(error.clone());
        }
        let zero = zero.as_ref().unwrap_or(&error);
        let _ = write!(data, "{},{},{}", stop.position, stop.cycle, stop.direction);
        for (i, (e, z)) in error.iter().zip(zero).enumerate() {
            for d in (0..3).filter(|d| read(i, *d)) {
                let _ = write!(data, ",{:.4}", (e[d] - z[d] + noise.draw()) * 1e3);
            }
        }
        data.push('\n');
    }
    let name = format!("nineline-{}.csv", axis.lower());
    args.plan.write("lines.csv", &table)?;
    args.plan.write(&name, &data)?;
    say!(
        "volcomp identify nineline --axis {} --lines {} --data {} --noise-um {} --chain \"{}\" --machine {}",
        axis.lower(),
        args.plan.file("lines.csv"),
        args.plan.file(&name),
        args.noise_um.max(1e-6),
        machine.chain().text(),
        machine.machine()
    );
    Ok(())
}
