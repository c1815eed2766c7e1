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

pub(crate) use columns::{Column, Columns};

/// The vocabulary of the methods, with that of the command line.
mod prelude {
    pub(super) use super::case::{CaseArgs, CaseFile, refused, rows};
    pub(super) use super::columns::{self, Column, Columns, Named, RunColumns, Stops};
    pub(super) use super::curve_fits::CurveFits;
    pub(super) use super::method::{Found, Front, Method, printed};
    pub(super) use super::motion_curves::{CurveArgs, Motions, Report};
    pub(super) use super::tracker_points::{Frame, PointColumns, Registered, TrackerArgs};
    pub(super) use crate::prelude::*;
}

subcommands! {
    /// Turn instrument data into an error model.
    pub(super) enum Chosen {
        /// Six error motions from three or more points on the carriage, seen by a laser tracker.
        Threepoint(Box<threepoint::Args>) => method::run,
        /// Six error motions from nine lines measured with an interferometer.
        Nineline(Box<nineline::Args>) => method::run,
        /// Straightness, roll, pitch and yaw from the readings of a 5-DOF laser.
        Fivedof(Box<fivedof::Args>) => method::run,
        /// Straightness and angles of a 6D interferometer, about least-squares, end-point and minimum-zone lines.
        Straightness(Box<straightness::Args>) => method::run,
        /// Squareness from four body diagonals.
        Diagonals(Box<diagonals::Args>) => method::run,
        /// Tool axis and tip from two circles in space.
        Circles(Box<circles::Args>) => method::run,
        /// Ram errors from several poses of the tool.
        Ram(Box<ram::Args>) => method::run,
        Probe(Box<probe::Args>) => method::run,
        Grinder(Box<grinder::Args>) => method::run,
        Ballbar(Box<ballbar::Args>) => method::run,
        /// Error curves: the same as volcomp fit, on a case of the reference vectors.
        Fits(Box<fits::Args>) => method::run,
        /// Kalman filter on node values of a grid.
        Kalman(Box<kalman::Args>) => method::run,
    }
}
