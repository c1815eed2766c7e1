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

use super::Result;

/// Turn instrument data into an error model.
#[derive(Debug, clap::Parser)]
pub(super) struct Args {
    #[command(subcommand)]
    method: Method,
}

#[derive(Debug, clap::Subcommand)]
enum Method {
    /// Six error motions from three or more points on the carriage, seen by a laser tracker.
    Threepoint(Box<threepoint::Args>),
    /// Six error motions from nine lines measured with an interferometer.
    Nineline(Box<nineline::Args>),
    /// Straightness, roll, pitch and yaw from the readings of a 5-DOF laser.
    Fivedof(Box<fivedof::Args>),
    /// Straightness and angles of a 6D interferometer, about least-squares, end-point and minimum-zone lines.
    Straightness(Box<straightness::Args>),
    /// Squareness from four body diagonals.
    Diagonals(Box<diagonals::Args>),
    /// Tool axis and tip from two circles in space.
    Circles(Box<circles::Args>),
    /// Ram errors from several poses of the tool.
    Ram(Box<ram::Args>),
    Probe(Box<probe::Args>),
    Grinder(Box<grinder::Args>),
    Ballbar(Box<ballbar::Args>),
    /// Error curves: the same as volcomp fit, on a case of the reference vectors.
    Fits(Box<fits::Args>),
    /// Kalman filter on node values of a grid.
    Kalman(Box<kalman::Args>),
}

pub(super) fn run(args: &Args) -> Result<()> {
    method::run(match &args.method {
        Method::Threepoint(a) => a.as_ref(),
        Method::Nineline(a) => a.as_ref(),
        Method::Fivedof(a) => a.as_ref(),
        Method::Straightness(a) => a.as_ref(),
        Method::Diagonals(a) => a.as_ref(),
        Method::Circles(a) => a.as_ref(),
        Method::Ram(a) => a.as_ref(),
        Method::Probe(a) => a.as_ref(),
        Method::Grinder(a) => a.as_ref(),
        Method::Ballbar(a) => a.as_ref(),
        Method::Fits(a) => a.as_ref(),
        Method::Kalman(a) => a.as_ref(),
    })
}
