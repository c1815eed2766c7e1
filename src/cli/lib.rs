//! Arguments, human and JSON output, exit codes. Data goes to stdout, all else to stderr. Equations:
//! `docs/reference/equations.md`.

#![cfg_attr(test, expect(clippy::disallowed_methods, reason = "tests read and write files"))]

/// Like `println!`, but never panics: see [`exit::line`].
macro_rules! say {
    () => { $crate::line(format_args!("")) };
    ($($text:tt)*) => { $crate::line(format_args!($($text)*)) };
}

/// Like `eprintln!`, but never panics: see [`exit::note`].
macro_rules! note {
    ($($text:tt)*) => { $crate::note(format_args!($($text)*)) };
}

/// A wrong command line, in the words of `format!`.
macro_rules! usage {
    ($($text:tt)*) => { $crate::Failure::usage(format_args!($($text)*)) };
}

/// Bad data in a file: the file, then words as for `format!`.
macro_rules! data {
    ($file:expr, $($text:tt)*) => { $crate::Failure::data(&$file, format_args!($($text)*)) };
}

/// A mistake in a machine or model file: the file, then words as for `format!`.
macro_rules! mistake {
    ($file:expr, $($text:tt)*) => { $crate::Failure::mistake(&$file, format_args!($($text)*)) };
}

mod acceptance;
mod additions;
mod arg_parsers;
mod audit;
mod bench;
mod check;
mod correct;
mod daemon;
#[cfg(feature = "diagnosis")]
mod diagnose;
mod diff;
mod evaluate;
mod exit;
mod explain;
mod export;
mod files;
mod filter;
mod fit;
mod gateway;
mod help;
mod identify;
mod identity;
mod import;
pub mod input;
mod model;
mod model_writer;
mod numerals;
mod operator_commands;
mod positioning_data;
mod predict;
mod progress;
mod ranges;
mod recordings;
mod replay;
mod report;
pub mod report_page;
mod schema;
mod start_up;
mod status;
mod table;
mod units;
mod verify;

use std::ffi::OsString;
use std::process::ExitCode;

use clap::{CommandFactory, Parser, Subcommand};

pub use ranges::parse;

pub use exit::{
    EX_CONFIG, EX_DATAERR, EX_IOERR, EX_SOFTWARE, EX_USAGE, Failure, line, not_parsed, note, note_text,
    output_complete,
};

/// What ends in an exit code where it fails.
type Result<T, E = Failure> = core::result::Result<T, E>;

/// The end of the help of every program.
pub const EXIT_CODES: &str = "Exit codes: 0 done; 1 differs (diff, replay); 2 incomplete (replay); \
    64 wrong command line; 65 bad data, or a file beyond its limit; 70 error of the program; \
    74 file, socket or stdout not usable; 78 mistake in a machine or model file.\n\
    Largest files, ranges of numbers, closed streams: docs/reference/limits.md";

/// Geometric-error compensation for machine tools: check, predict, fit, identify, evaluate, exchange files with
/// instruments and controls, and talk to the daemon.
#[derive(Debug, Parser)]
#[command(name = "volcomp", version, arg_required_else_help = true)]
#[command(after_help = EXIT_CODES)]
struct Cli {
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Debug, Subcommand)]
enum Verb {
    Bench(bench::Args),
    Check(check::Args),
    Predict(predict::Args),
    Correct(Box<correct::Args>),
    Fit(Box<fit::Args>),
    Identify(identify::Args),
    Import(Box<import::Args>),
    Export(Box<export::Args>),
    Evaluate(evaluate::Args),
    Verify(verify::Args),
    #[cfg(feature = "diagnosis")]
    Diagnose(Box<diagnose::Args>),
    Model(model::Args),
    Explain(explain::Args),
    Diff(diff::Args),
    Status(status::StatusArgs),
    Enable(operator_commands::EnableArgs),
    Disable(operator_commands::DisableArgs),
    Gain(operator_commands::GainArgs),
    Load(operator_commands::LoadArgs),
    Rollback(operator_commands::RollbackArgs),
    Replay(replay::Args),
    Audit(audit::Args),
    Filter(filter::Args),
    Gateway(gateway::Args),
    Schema(schema::Args),
}

/// The command tree of `volcomp`, for tests that go through every command form.
#[must_use]
pub fn command() -> clap::Command {
    Cli::command().help_template(help::template())
}

/// The arguments of `volcompd`.
#[must_use]
pub fn daemon_command() -> clap::Command {
    daemon::Args::command()
}

/// The program `volcomp`: runs it on `args` (the first is the program's name).
#[must_use]
pub fn volcomp(args: impl IntoIterator<Item = OsString>) -> ExitCode {
    let args: Vec<OsString> = args.into_iter().collect();
    let asks_for_help = args.len() < 2 || args.iter().any(|a| a == "help" || a == "--help" || a == "-h");
    // the verbs by group take a millisecond: only where they may be printed
    let tree = if asks_for_help { command() } else { Cli::command() };
    exit::run(tree, args, |cli: Cli| match cli.verb {
        Verb::Bench(a) => bench::run(&a),
        Verb::Check(a) => check::run(&a),
        Verb::Correct(a) => correct::run(&a),
        Verb::Predict(a) => predict::run(&a),
        Verb::Fit(a) => fit::run(&a),
        Verb::Identify(a) => identify::run(&a),
        Verb::Import(a) => import::run(&a),
        Verb::Export(a) => export::run(&a),
        Verb::Evaluate(a) => evaluate::run(&a),
        Verb::Verify(a) => verify::run(&a),
        #[cfg(feature = "diagnosis")]
        Verb::Diagnose(a) => diagnose::run(&a),
        Verb::Explain(a) => explain::run(&a),
        Verb::Model(a) => model::run(&a),
        Verb::Diff(a) => diff::run(&a),
        Verb::Status(a) => status::status(&a),
        Verb::Enable(a) => operator_commands::enable(&a),
        Verb::Disable(a) => operator_commands::disable(&a),
        Verb::Gain(a) => operator_commands::gain(&a),
        Verb::Load(a) => operator_commands::load(&a),
        Verb::Rollback(a) => operator_commands::rollback(&a),
        Verb::Replay(a) => replay::run(&a),
        Verb::Audit(a) => audit::run(&a),
        Verb::Filter(a) => filter::run(&a),
        Verb::Gateway(a) => gateway::run(&a),
        Verb::Schema(a) => schema::run(&a),
    })
}

/// The program `volcompd`: runs it on `args` (the first is the program's name).
#[must_use]
pub fn volcompd(args: impl IntoIterator<Item = OsString>) -> ExitCode {
    exit::run(daemon_command(), args, |args: daemon::Args| daemon::run(&args))
}
