//! `cncsim measure INSTRUMENT`: the data a person would bring from a measurement, taken on the simulated machine.
//!
//! The truth machine moves, the instrument adds its noise; the files are those that `volcomp identify` reads.

mod ballbar;
mod circles;
mod common;
mod diagonals;
mod fivedof;
pub(crate) mod grinder;
mod nineline;
mod positioning;
mod probe;
mod ram;
mod straightness;
mod threepoint;
mod through;

use super::Failure;

/// Measure the simulated machine with an instrument, as files for volcomp identify.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    #[command(subcommand)]
    instrument: Instrument,
}

#[derive(Debug, clap::Subcommand)]
enum Instrument {
    /// For volcomp identify threepoint.
    Threepoint(Box<threepoint::Args>),
    /// For volcomp identify nineline.
    Nineline(Box<nineline::Args>),
    /// For volcomp identify fivedof.
    Fivedof(Box<fivedof::Args>),
    /// For volcomp identify straightness.
    Straightness(Box<straightness::Args>),
    /// For volcomp identify diagonals.
    Diagonals(Box<diagonals::Args>),
    /// For volcomp identify circles.
    Circles(Box<circles::Args>),
    /// For volcomp identify ram.
    Ram(Box<ram::Args>),
    Probe(Box<probe::Args>),
    Grinder(Box<grinder::Args>),
    Ballbar(Box<ballbar::Args>),
    Circle(Box<ballbar::CircleArgs>),
    Positioning(Box<positioning::Args>),
}

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    match &args.instrument {
        Instrument::Threepoint(a) => threepoint::run(a),
        Instrument::Nineline(a) => nineline::run(a),
        Instrument::Fivedof(a) => fivedof::run(a),
        Instrument::Straightness(a) => straightness::run(a),
        Instrument::Diagonals(a) => diagonals::run(a),
        Instrument::Circles(a) => circles::run(a),
        Instrument::Ram(a) => ram::run(a),
        Instrument::Probe(a) => probe::run(a),
        Instrument::Grinder(a) => grinder::run(a),
        Instrument::Ballbar(a) => ballbar::run(a),
        Instrument::Circle(a) => ballbar::run_circle(a),
        Instrument::Positioning(a) => positioning::run(a),
    }
}
