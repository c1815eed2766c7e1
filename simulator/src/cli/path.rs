//! `cncsim path`: standard test paths as part programs.

use clap::{Subcommand, ValueEnum};

use super::Failure;
use crate::motion::paths::{
    self, Circle, Cone, Plane, RotaryTilt, SPath, Targets, Tilt, Turn, body_diagonals, line_with_targets,
};

/// Which path.
#[derive(Debug, clap::Parser)]
pub(super) struct Args {
    #[command(subcommand)]
    kind: Kind,
}

#[derive(Debug, Subcommand)]
enum Kind {
    /// A ballbar circle (ISO 230-4) with feed-in, overshoot and feed-out.
    Circle(CircleArgs),
    /// The four body diagonals (ISO 230-6).
    Diagonals(DiagonalArgs),
    /// A rectangle.
    Rectangle(RectangleArgs),
    /// There and back between two points, with targets (ISO 230-2).
    Line(LineArgs),
    /// A cone in the manner of NAS 979.
    Cone(ConeArgs),
    /// An S in the manner of ISO 10791-7, test M4.
    SPath(SPathArgs),
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum PlaneArg {
    Xy,
    Zx,
    Yz,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum TiltArg {
    /// No rotary axes.
    None,
    /// Axes A and C.
    Ac,
    /// Axes B and C.
    Bc,
}

impl From<PlaneArg> for Plane {
    fn from(plane: PlaneArg) -> Self {
        match plane {
            PlaneArg::Xy => Self::Xy,
            PlaneArg::Zx => Self::Zx,
            PlaneArg::Yz => Self::Yz,
        }
    }
}

impl From<TiltArg> for Tilt {
    fn from(tilt: TiltArg) -> Self {
        match tilt {
            TiltArg::None => Self::None,
            TiltArg::Ac => Self::AndC(RotaryTilt::A),
            TiltArg::Bc => Self::AndC(RotaryTilt::B),
        }
    }
}

/// A finite number.
fn finite(text: &str) -> Result<f64, String> {
    match text.trim().parse::<f64>() {
        Ok(v) if v.is_finite() => Ok(v),
        _ => Err("not a finite number".to_owned()),
    }
}

fn positive(text: &str) -> Result<f64, String> {
    finite(text).and_then(|v| if v > 0.0 { Ok(v) } else { Err("must be above 0".to_owned()) })
}

fn not_negative(text: &str) -> Result<f64, String> {
    finite(text).and_then(|v| if v >= 0.0 { Ok(v) } else { Err("must be 0 or above".to_owned()) })
}

/// A point as `X,Y,Z`.
pub(super) fn point(text: &str) -> Result<[f64; 3], String> {
    let values = text.split(',').map(finite).collect::<Result<Vec<_>, _>>()?;
    <[f64; 3]>::try_from(values).map_err(|v| format!("{} numbers; give three: X,Y,Z", v.len()))
}

#[derive(Debug, clap::Args)]
struct CircleArgs {
    /// Plane.
    #[arg(long, value_enum, default_value = "xy")]
    plane: PlaneArg,
    /// Centre X,Y,Z in mm.
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true, default_value = "425,250,-250")]
    centre_mm: [f64; 3],
    /// Radius in mm.
    #[arg(long, value_parser = positive, default_value = "150")]
    radius_mm: f64,
    /// Feed in mm/min.
    #[arg(long, value_parser = positive, default_value = "1000")]
    feed: f64,
    /// Clockwise (G2) instead of counter-clockwise (G3).
    #[arg(long)]
    cw: bool,
    /// Angle at which the measured turn starts, deg.
    #[arg(long, value_parser = finite, allow_hyphen_values = true, default_value = "0")]
    start_deg: f64,
    /// Arc before and behind the measured turn, deg.
    #[arg(long, value_parser = not_negative, default_value = "180")]
    overshoot_deg: f64,
    /// Feed-in and feed-out along the radius, mm.
    #[arg(long, value_parser = not_negative, default_value = "1.5")]
    feed_in_mm: f64,
}

#[derive(Debug, clap::Args)]
struct TargetArgs {
    /// Number of targets at which to stop, both ends included; 0: none between the ends.
    #[arg(long, default_value = "0", value_parser = clap::value_parser!(u32).range(0..=10_000))]
    targets: u32,
    /// Standstill at each target, s.
    #[arg(long, value_parser = not_negative, default_value = "0")]
    dwell_s: f64,
    /// Runs there and back.
    #[arg(long, default_value = "1", value_parser = clap::value_parser!(u32).range(1..=1000))]
    cycles: u32,
    /// Feed in mm/min.
    #[arg(long, value_parser = positive, default_value = "2000")]
    feed: f64,
}

impl TargetArgs {
    fn targets(&self) -> Targets {
        let (count, cycles) = (self.targets, self.cycles);
        Targets { count, dwell_s: self.dwell_s, cycles, feed_mm_per_min: self.feed }
    }
}

#[derive(Debug, clap::Args)]
struct DiagonalArgs {
    /// Lower corner of the volume, mm.
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true, default_value = "0,0,-500")]
    low_mm: [f64; 3],
    /// Upper corner of the volume, mm.
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true, default_value = "850,500,0")]
    high_mm: [f64; 3],
    #[command(flatten)]
    targets: TargetArgs,
}

#[derive(Debug, clap::Args)]
struct RectangleArgs {
    /// Plane.
    #[arg(long, value_enum, default_value = "xy")]
    plane: PlaneArg,
    /// First corner, mm.
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true, default_value = "200,100,-250")]
    corner_mm: [f64; 3],
    /// Size along the first axis of the plane, mm.
    #[arg(long, value_parser = positive, default_value = "300")]
    length_mm: f64,
    /// Size along the second axis of the plane, mm.
    #[arg(long, value_parser = positive, default_value = "200")]
    width_mm: f64,
    /// Feed in mm/min.
    #[arg(long, value_parser = positive, default_value = "2000")]
    feed: f64,
}

#[derive(Debug, clap::Args)]
struct LineArgs {
    /// Start, mm.
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true, default_value = "0,250,-250")]
    from_mm: [f64; 3],
    /// End, mm.
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true, default_value = "850,250,-250")]
    to_mm: [f64; 3],
    #[command(flatten)]
    targets: TargetArgs,
}

#[derive(Debug, clap::Args)]
struct ConeArgs {
    /// Centre of the circle, mm.
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true, default_value = "425,250,-250")]
    centre_mm: [f64; 3],
    /// Radius, mm.
    #[arg(long, value_parser = positive, default_value = "80")]
    radius_mm: f64,
    /// Half angle of the cone, deg.
    #[arg(long, value_parser = finite, allow_hyphen_values = true, default_value = "15")]
    half_angle_deg: f64,
    /// Tilt of its axis about x, deg.
    #[arg(long, value_parser = finite, allow_hyphen_values = true, default_value = "10")]
    tilt_deg: f64,
    /// Rotary axes that point the tool along the flank.
    #[arg(long, value_enum, default_value = "none")]
    rotary: TiltArg,
    /// Switch tool-centre-point motion on (G43.4): the path is that of the tool tip while the rotary axes turn.
    #[arg(long)]
    tool_centre: bool,
    /// Blocks of the turn.
    #[arg(long, default_value = "720", value_parser = clap::value_parser!(u32).range(8..=1_000_000))]
    blocks: u32,
    /// Feed in mm/min.
    #[arg(long, value_parser = positive, default_value = "1000")]
    feed: f64,
}

#[derive(Debug, clap::Args)]
struct SPathArgs {
    /// Middle of the S, mm.
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true, default_value = "425,250,-250")]
    centre_mm: [f64; 3],
    /// Length along x, mm.
    #[arg(long, value_parser = positive, default_value = "200")]
    length_mm: f64,
    /// Width along y, mm.
    #[arg(long, value_parser = positive, default_value = "100")]
    width_mm: f64,
    /// Rise along z, mm.
    #[arg(long, value_parser = finite, allow_hyphen_values = true, default_value = "20")]
    rise_mm: f64,
    /// Largest tilt of the tool, deg.
    #[arg(long, value_parser = finite, default_value = "15")]
    tilt_deg: f64,
    /// Rotary axes that tilt the tool.
    #[arg(long, value_enum, default_value = "none")]
    rotary: TiltArg,
    /// Switch tool-centre-point motion on (G43.4): the path is that of the tool tip while the rotary axes turn.
    #[arg(long)]
    tool_centre: bool,
    /// Blocks.
    #[arg(long, default_value = "1000", value_parser = clap::value_parser!(u32).range(8..=1_000_000))]
    blocks: u32,
    /// Feed in mm/min.
    #[arg(long, value_parser = positive, default_value = "2000")]
    feed: f64,
}

/// The program with tool-centre-point motion where that is asked for.
fn tool_centre(on: bool, text: String) -> String {
    if on { text.replacen("G64\n", "G64\nG43.4 H1\n", 1) } else { text }
}

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    let text = match &args.kind {
        Kind::Circle(c) => paths::circle(&Circle {
            plane: c.plane.into(),
            centre_mm: c.centre_mm,
            radius_mm: c.radius_mm,
            feed_mm_per_min: c.feed,
            turn: if c.cw { Turn::Clockwise } else { Turn::CounterClockwise },
            start_deg: c.start_deg,
            overshoot_deg: c.overshoot_deg,
            feed_in_mm: c.feed_in_mm,
        }),
        Kind::Diagonals(d) => body_diagonals(d.low_mm, d.high_mm, &d.targets.targets()),
        Kind::Rectangle(r) => {
            paths::rectangle(r.plane.into(), r.corner_mm, [r.length_mm, r.width_mm], r.feed)
        }
        Kind::Line(l) => line_with_targets(l.from_mm, l.to_mm, &l.targets.targets()),
        Kind::Cone(c) => tool_centre(
            c.tool_centre,
            paths::cone(&Cone {
                centre_mm: c.centre_mm,
                radius_mm: c.radius_mm,
                half_angle_deg: c.half_angle_deg,
                tilt_deg: c.tilt_deg,
                feed_mm_per_min: c.feed,
                blocks: c.blocks,
                rotary: c.rotary.into(),
            }),
        ),
        Kind::SPath(s) => tool_centre(
            s.tool_centre,
            paths::s_path(&SPath {
                centre_mm: s.centre_mm,
                length_mm: s.length_mm,
                width_mm: s.width_mm,
                rise_mm: s.rise_mm,
                tilt_deg: s.tilt_deg,
                feed_mm_per_min: s.feed,
                blocks: s.blocks,
                rotary: s.rotary.into(),
            }),
        ),
    };
    say!("{}", text.trim_end());
    Ok(())
}
