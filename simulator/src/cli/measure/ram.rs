//! `cncsim measure ram`: tip and direction of the tool at stops of the ram, each with several poses of the head.

use std::fmt::Write as _;

use volcomp_units::axes::{AxisArray, AxisName, MAX_AXES};
use volcomp_units::{arcsec_from_rad, um_from_mm};

use super::common::{AxisPlan, not_negative};
use crate::cli::{EX_USAGE, Failure};
use crate::instruments::tracker::PointNoise;

/// Tool poses at stops of the ram (Z), each with several positions C, A of the head.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    #[command(flatten)]
    plan: AxisPlan,
    /// Positions of the head as C:A, deg.
    #[arg(long, value_name = "C:A", value_delimiter = ',', value_parser = pose, allow_hyphen_values = true, default_value = "0:30,90:-40,180:45,-90:-20,45:60")]
    poses: Vec<(f64, f64)>,
    /// Standard deviation of a coordinate of the tip, um.
    #[arg(long, default_value = "2", value_parser = not_negative)]
    noise_position_um: f64,
    /// Standard deviation of a component of the direction, arcsec.
    #[arg(long, default_value = "2", value_parser = not_negative)]
    noise_direction_arcsec: f64,
}

fn pose(text: &str) -> Result<(f64, f64), String> {
    let (c, a) = text.split_once(':').ok_or("write for example 90:-40")?;
    match (c.trim().parse::<f64>(), a.trim().parse::<f64>()) {
        (Ok(c), Ok(a)) if c.is_finite() && a.is_finite() => Ok((c, a)),
        _ => Err(format!("'{text}' is not two finite numbers")),
    }
}

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    let (machine, axis, k) = args.plan.open()?;
    let index = |name: AxisName| {
        machine.index_of(name).ok_or_else(|| {
            Failure::new(
                EX_USAGE,
                format_args!(
                    "machine {} has no axis {name}; a head needs C and A (gantry-5ax)",
                    machine.machine()
                ),
            )
        })
    };
    let (c_axis, a_axis) = (index(AxisName::C)?, index(AxisName::A)?);
    let mut tips = PointNoise::new(args.noise_position_um, args.plan.seed);
    let mut directions =
        PointNoise::with_std(args.noise_direction_arcsec, args.plan.seed.wrapping_add(1 << 32));
    let mut text = String::from(
        "z_mm,cycle,direction,c_deg,a_deg,tip_x_um,tip_y_um,tip_z_um,dir_x_arcsec,dir_y_arcsec,dir_z_arcsec\n",
    );
    for stop in args.plan.stops(machine.travel(k)) {
        for (c, a) in &args.poses {
            let mut q = AxisArray::default();
            (q[k], q[c_axis], q[a_axis]) = (stop.position, *c, *a);
            let mut direction = [0; MAX_AXES];
            direction[k] = stop.direction;
            let (actual, nominal) = (machine.pose(&q, &direction), machine.nominal(&q));
            let tip: [f64; 3] =
                core::array::from_fn(|i| um_from_mm(actual.tip_mm[i] - nominal.tip_mm[i] + tips.draw()));
            let turn: [f64; 3] = core::array::from_fn(|i| {
                arcsec_from_rad(actual.direction[i] - nominal.direction[i]) + directions.draw()
            });
            let _ = writeln!(
                text,
                "{},{},{},{c},{a},{:.5},{:.5},{:.5},{:.6},{:.6},{:.6}",
                stop.position, stop.cycle, stop.direction, tip[0], tip[1], tip[2], turn[0], turn[1], turn[2]
            );
        }
    }
    args.plan.write("poses.csv", &text)?;
    // the reference point of the ram is the origin of M
    let point = machine.drawing(a_axis).map_or([0.0; 3], |joint| joint.point_mm);
    let tip = machine.tool_tip_mm();
    say!(
        "volcomp identify ram --axis {} --data {} --a-axis-mm {},{},{} --tool-length-mm {} --sigma-position-um {} --sigma-direction-arcsec {} --chain \"{}\" --machine {}",
        axis.lower(),
        args.plan.file("poses.csv"),
        point[0],
        point[1],
        point[2],
        point[2] - tip[2],
        args.noise_position_um.max(1e-6),
        args.noise_direction_arcsec.max(1e-6),
        machine.chain().text(),
        machine.machine()
    );
    Ok(())
}
