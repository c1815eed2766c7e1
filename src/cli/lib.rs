//! Arguments, human and JSON output, exit codes. Data goes to stdout, all else to stderr. Equations:
//! `docs/reference/equations.md`.

#![cfg_attr(test, expect(clippy::disallowed_methods, reason = "tests read and write files"))]

/// Like `println!`, but never panics: see [`exit::line`].
macro_rules! say {
    () => { $crate::line(format_args!("")) };
    ($($text:tt)*) => { $crate::line(format_args!($($text)*)) };
}

/// Like [`say!`] for text, not data: units as a person writes them.
macro_rules! say_text {
    ($($text:tt)*) => { $crate::line(format_args!("{}", $crate::numerals::micro(&format!($($text)*)))) };
}

/// Like `eprintln!`, but never panics: see [`exit::note`].
macro_rules! note {
    ($($text:tt)*) => { $crate::note(format_args!($($text)*)) };
}

/// A failure with its exit code, in the words of `format!`.
macro_rules! failure {
    ($code:expr, $($text:tt)*) => {
        $crate::Failure::new($code, format_args!("error: {}", format_args!($($text)*)))
    };
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

/// An object with fields of a struct under their own names, and others as for `json!`.
macro_rules! fields {
    ($of:expr; $($name:ident),* $(; $($other:tt)*)?) => {
        serde_json::json!({ $(stringify!($name): $of.$name,)* $($($other)*)? })
    };
}

/// Subcommands with what runs them.
macro_rules! subcommands {
    ($(#[$about:meta])* $shown:vis enum $name:ident {
        $($(#[$meta:meta])* $verb:ident($args:ty) => $run:path $(where feature = $feature:literal)?,)*
    }) => {
        #[derive(Debug, clap::Subcommand)]
        $(#[$about])*
        $shown enum $name { $($(#[cfg(feature = $feature)])? $(#[$meta])* $verb($args),)* }

        impl $name {
            $shown fn run(&self) -> Result<(), $crate::Failure> {
                match self { $($(#[cfg(feature = $feature)])? Self::$verb(args) => $run(args),)* }
            }
        }
    };
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
mod prelude;
mod progress;
mod quantities;
mod ranges;
mod recordings;
mod replay;
mod report;
pub mod report_page;
mod schema;
mod start_up;
mod status;
mod table;
mod targets;
mod units;
mod verify;

use std::ffi::OsString;
use std::process::ExitCode;

use clap::{CommandFactory, Parser};

pub use ranges::parse;
pub use volcomp_config::{suggestion, with_nearest};

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

subcommands! {
    enum Verb {
        Bench(bench::Args) => bench::run,
        Check(check::Args) => check::run,
        Predict(predict::Args) => predict::run,
        Correct(Box<correct::Args>) => correct::run,
        Fit(Box<fit::Args>) => fit::run,
        #[command(subcommand)]
        Identify(identify::Chosen) => identify::Chosen::run,
        Import(Box<import::Args>) => import::run,
        Export(Box<export::Args>) => export::run,
        #[command(subcommand)]
        Evaluate(evaluate::Test) => evaluate::Test::run,
        Verify(verify::Args) => verify::run,
        Diagnose(Box<diagnose::Args>) => diagnose::run where feature = "diagnosis",
        #[command(subcommand)]
        Model(model::Verb) => model::Verb::run,
        Explain(explain::Args) => explain::run,
        Diff(diff::Args) => diff::run,
        Status(status::StatusArgs) => status::status,
        Watch(status::WatchArgs) => status::watch,
        Enable(operator_commands::EnableArgs) => operator_commands::enable,
        Disable(operator_commands::DisableArgs) => operator_commands::disable,
        Gain(operator_commands::GainArgs) => operator_commands::gain,
        Load(operator_commands::LoadArgs) => operator_commands::load,
        Rollback(operator_commands::RollbackArgs) => operator_commands::rollback,
        Replay(replay::Args) => replay::run,
        #[command(subcommand)]
        Audit(audit::Verb) => audit::Verb::run,
        #[command(subcommand)]
        Filter(filter::What) => filter::What::run,
        Gateway(gateway::Args) => gateway::run,
        Schema(schema::Args) => schema::run,
    }
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
    exit::run(tree, args, |cli: Cli| cli.verb.run())
}

/// The program `volcompd`: runs it on `args` (the first is the program's name).
#[must_use]
pub fn volcompd(args: impl IntoIterator<Item = OsString>) -> ExitCode {
    exit::run(daemon_command(), args, |args: daemon::Args| daemon::run(&args))
}
