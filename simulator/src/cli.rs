//! The program `cncsim`: arguments, files, exit codes. Data goes to stdout, all else to stderr.

/// Like `println!`, but never panics: a reader that has seen enough is no failure, a full disk is one at the end.
macro_rules! say {
    () => { volcomp_cli::line(format_args!("")) };
    ($($text:tt)*) => { volcomp_cli::line(format_args!($($text)*)) };
}

/// Like `eprintln!`, but never panics.
macro_rules! note {
    () => { volcomp_cli::note(format_args!("")) };
    ($($text:tt)*) => { volcomp_cli::note(format_args!($($text)*)) };
}

mod bench_link;
#[cfg(feature = "diagnosis")]
mod blind;
mod campaign;
mod certificates;
mod demo;
mod manuals;
pub(crate) mod measure;
mod paper;
mod path;
mod scenarios;
mod sensors;
mod serve;
mod tool;

use core::fmt;
use std::ffi::OsString;
use std::path::Path;
use std::process::ExitCode;

use clap::{CommandFactory, Parser, Subcommand};

use volcomp_cli::input::InputKind;
pub use volcomp_cli::{EX_CONFIG, EX_DATAERR, EX_IOERR, EX_SOFTWARE, EX_USAGE};

/// Why the program ends without having done its work.
#[derive(Debug)]
pub struct Failure {
    /// Exit code.
    pub code: u8,
    /// What to tell the user.
    pub message: String,
}

impl Failure {
    /// A failure with its exit code.
    pub fn new(code: u8, message: impl fmt::Display) -> Self {
        Self { code, message: format!("error: {message}") }
    }

    /// Something wrong in a file.
    pub fn in_file(code: u8, path: &Path, message: impl fmt::Display) -> Self {
        Self::new(code, format_args!("{}: {message}", path.display()))
    }
}

impl From<volcomp_cli::Failure> for Failure {
    fn from(failure: volcomp_cli::Failure) -> Self {
        Self { code: failure.code, message: failure.message }
    }
}

/// A simulated CNC control and machine tool to run volcomp against.
#[derive(Debug, Parser)]
#[command(name = "cncsim", version, arg_required_else_help = true, after_help = volcomp_cli::EXIT_CODES)]
#[command(mut_subcommands(hide_former))]
struct Cli {
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Debug, Subcommand)]
enum Verb {
    /// Watch a machine tool become more accurate: survey, fit, compensate, compare.
    ///
    /// Runs control, machine and daemon over real TCP on loopback, a circle, body diagonals and recorded motion
    /// without and with compensation, and leaves a picture and a page of both. Takes well under a minute.
    Demo(demo::DemoArgs),
    /// Measure all error motions of a simulated machine with noisy instruments, as tables for volcomp fit.
    Survey(demo::SurveyArgs),
    /// Measure the simulated machine with an instrument, as files for volcomp identify.
    Measure(measure::Args),
    /// Run a part program on the simulated machine and serve its control on the link.
    ///
    /// Without a daemon the machine runs uncompensated. Without a program it stands still and serves.
    Serve(serve::ServeArgs),
    /// Run a standard measurement campaign on a machine with known effects, as files for volcomp diagnose.
    ///
    /// Lines, circles in three planes at two feeds, a tracker grid with two tools, warm-up, R-test, loads and dynamics
    /// on a machine whose physics (servo, friction, heat, bending ..) a truth file switches on. Takes seconds.
    Campaign(campaign::Args),
    /// Replay recorded motion of a real machine and serve the control on the link.
    Replay(serve::ReplayArgs),
    /// Print a standard test path as a part program.
    Path(path::Args),
    /// Tests and measurements of volcomp itself: blind tests, scenarios, papers, latency of the link, certificates.
    #[command(subcommand)]
    Dev(Dev),
    // the names before `dev`, hidden
    #[command(flatten)]
    Former(Dev),
    /// The bare echo of bench-link.
    #[command(hide = true)]
    BenchEcho(bench_link::EchoArgs),
    /// The product's daemon, for the demo and its tests.
    #[command(hide = true, disable_help_flag = true)]
    Volcompd(Program),
    /// The product's daemon without the permissions that real time needs, for the scenarios.
    #[command(hide = true, disable_help_flag = true)]
    HumbleVolcompd(Program),
    /// The product's tool, for the demo and its tests.
    #[command(hide = true, disable_help_flag = true)]
    Volcomp(Program),
}

/// Verbs for developers of volcomp, below `dev`.
#[derive(Debug, Subcommand)]
enum Dev {
    /// Run blind tests of the diagnosis on machines with sealed faults, and count.
    ///
    /// Draws machines with one effect, two, none, and effects outside the library, seals the labels, runs volcomp
    /// diagnose on the session files alone, and only then compares.
    #[cfg(feature = "diagnosis")]
    Blind(blind::Args),
    /// Inject every catalogued fault, by number, and check the reaction of the real daemon.
    Scenarios(scenarios::Args),
    /// Run the experiments of the source papers and compare their figures.
    ///
    /// Simulated instruments, volcomp's own commands, volcompd over TCP, and the compensated machine measured again with
    /// the instrument of the paper; prints a table and writes an HTML report per paper. Takes minutes.
    Paper(paper::Args),
    /// Measure round trips of volcompd beside a bare echo on the same kind of sockets, and what the computation costs.
    ///
    /// Both answer the same frames on loopback, in short alternating blocks, so that noise of the computer hits
    /// both: ratios count. Starts all it needs by itself.
    BenchLink(Box<bench_link::Args>),
    /// Make an authority and certificates of control and daemon, to try the link over TLS.
    Certificates(certificates::Args),
    /// Write manual pages and shell completions, for packages.
    Manuals(manuals::Args),
}

impl Dev {
    fn run(self) -> Result<(), Failure> {
        match self {
            #[cfg(feature = "diagnosis")]
            Self::Blind(args) => blind::run(&args),
            Self::Scenarios(args) => scenarios::run_all(&args),
            Self::Paper(args) => paper::paper(&args),
            Self::BenchLink(args) => bench_link::bench_link(&args),
            Self::Certificates(args) => certificates::run(&args),
            Self::Manuals(args) => manuals::run(&args),
        }
    }
}

/// Hides the verbs for developers at the top level, where their names before `dev` still work.
fn hide_former(verb: clap::Command) -> clap::Command {
    if Dev::has_subcommand(verb.get_name()) { verb.hide(true) } else { verb }
}

/// Arguments that belong to one of the product's programs.
#[derive(Debug, clap::Args)]
struct Program {
    #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
    args: Vec<OsString>,
}

impl Program {
    /// With the name of the program in front.
    fn named(self, name: &str) -> impl Iterator<Item = OsString> {
        std::iter::once(OsString::from(name)).chain(self.args)
    }
}

/// The command tree, for tests that go through every command form.
#[must_use]
pub fn command() -> clap::Command {
    Cli::command()
}

/// Runs the program on `args` (the first is the program's name).
#[must_use]
pub fn cncsim(args: impl IntoIterator<Item = OsString>) -> ExitCode {
    let parsed: Cli = match volcomp_cli::parse(args) {
        Ok(parsed) => parsed,
        Err(e) => return volcomp_cli::not_parsed(&e),
    };
    let result = match parsed.verb {
        Verb::BenchEcho(args) => bench_link::echo(&args),
        Verb::Demo(args) => demo::demo(&args),
        Verb::Survey(args) => demo::survey(&args),
        Verb::Volcompd(program) => {
            end_with_parent();
            return volcomp_cli::volcompd(program.named("volcompd"));
        }
        Verb::HumbleVolcompd(program) => return humble_volcompd(program),
        Verb::Volcomp(program) => return volcomp_cli::volcomp(program.named("volcomp")),
        Verb::Dev(verb) | Verb::Former(verb) => verb.run(),
        Verb::Campaign(args) => campaign::run(&args),
        Verb::Measure(args) => measure::run(&args),
        Verb::Serve(args) => serve::serve(&args),
        Verb::Replay(args) => serve::replay(&args),
        Verb::Path(args) => path::run(&args),
    };
    let complete = || volcomp_cli::output_complete().map_err(Failure::from);
    match result.and_then(|()| complete()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            note!("{}", failure.message.trim_end());
            ExitCode::from(failure.code)
        }
    }
}

/// Lets the kernel end this process with the one that started it, however that one ends.
fn end_with_parent() {
    use rustix::process::{Signal, set_parent_process_death_signal};
    // only an invalid signal is refused
    let _ = set_parent_process_death_signal(Some(Signal::KILL));
}

/// Gives up what real time needs, then is the daemon.
fn humble_volcompd(program: Program) -> ExitCode {
    end_with_parent();
    match scenarios::renounce() {
        Ok(()) => volcomp_cli::volcompd(program.named("volcompd")),
        Err(e) => {
            note!("error: permissions could not be given up: {e}");
            ExitCode::from(EX_SOFTWARE)
        }
    }
}

/// Writes a whole file.
#[expect(clippy::disallowed_methods, reason = "the one place that writes files")]
fn write_file(path: impl AsRef<Path>, content: impl AsRef<[u8]>) -> std::io::Result<()> {
    std::fs::write(path, content)
}

/// Makes a folder and those above it.
#[expect(clippy::disallowed_methods, reason = "the one place that makes folders")]
fn make_folder(path: impl AsRef<Path>) -> std::io::Result<()> {
    std::fs::create_dir_all(path)
}

/// Removes a file, or a folder with its content.
#[cfg(feature = "diagnosis")]
#[expect(clippy::disallowed_methods, reason = "the one place that removes files")]
fn remove(path: &Path) -> std::io::Result<()> {
    if path.is_dir() { std::fs::remove_dir_all(path) } else { std::fs::remove_file(path) }
}

/// The text of a file, no larger than its kind allows.
fn read(path: &Path, kind: InputKind) -> Result<String, Failure> {
    Ok(volcomp_cli::input::read_text(path, kind)?)
}
