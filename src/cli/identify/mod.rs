//! `volcomp identify METHOD`: instrument data to error models, one file per method.
//!
//! Every method takes `--input case.json` (the reference vectors' form, mm and rad) or the files of its instrument,
//! and writes JSON for machines, a report for people and curves into a model file.

pub(crate) mod ballbar;
mod case;
mod circles;
pub(crate) mod columns;
mod curve_fits;
mod diagonals;
mod fits;
mod fivedof;
mod grinder;
mod kalman;
mod method;
mod motion_curves;
mod nineline;
mod probe;
mod ram;
mod straightness;
mod threepoint;
mod tracker_points;

use case::{CaseArgs, CaseFile};
pub(crate) use columns::{Column, Columns};
use columns::{RunColumns, Stops};
use curve_fits::CurveFits;
use method::{Found, Front, Method, printed};
use motion_curves::{CurveArgs, Motions};
use tracker_points::{Frame, PointColumns, Registered, TrackerArgs};

/// Turn instrument data into an error model.
#[derive(Debug, clap::Parser)]
pub(super) struct Args {
    #[command(subcommand)]
    method: Chosen,
}

/// The methods as subcommands.
macro_rules! methods {
    ($($(#[$about:meta])* $name:ident($args:ty),)*) => {
        #[derive(Debug, clap::Subcommand)]
        enum Chosen { $($(#[$about])* $name(Box<$args>),)* }

        pub(super) fn run(args: &Args) -> crate::Result<()> {
            match &args.method { $(Chosen::$name(method) => method::run(method.as_ref()),)* }
        }
    };
}

methods! {
    /// Six error motions from three or more points on the carriage, seen by a laser tracker.
    Threepoint(threepoint::Args),
    /// Six error motions from nine lines measured with an interferometer.
    Nineline(nineline::Args),
    /// Straightness, roll, pitch and yaw from the readings of a 5-DOF laser.
    Fivedof(fivedof::Args),
    /// Straightness and angles of a 6D interferometer, about least-squares, end-point and minimum-zone lines.
    Straightness(straightness::Args),
    /// Squareness from four body diagonals.
    Diagonals(diagonals::Args),
    /// Tool axis and tip from two circles in space.
    Circles(circles::Args),
    /// Ram errors from several poses of the tool.
    Ram(ram::Args),
    Probe(probe::Args),
    Grinder(grinder::Args),
    Ballbar(ballbar::Args),
    /// Error curves: the same as volcomp fit, on a case of the reference vectors.
    Fits(fits::Args),
    /// Kalman filter on node values of a grid.
    Kalman(kalman::Args),
}
