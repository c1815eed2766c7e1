//! `cncsim dev bench-link`: round trips of volcompd beside the bare limit.

use core::net::SocketAddr;
use core::time::Duration;
use std::path::PathBuf;

use indicatif::{ProgressBar, ProgressStyle};

use super::{EX_IOERR, EX_SOFTWARE, EX_USAGE, Failure};
use crate::bench::echo::{self, EchoSettings};
use crate::bench::error::BenchError;
use crate::bench::files::Axes;
use crate::bench::process::Programs;
use crate::bench::report::Report;
use crate::bench::rounds::Mode;
use crate::bench::thread::ThreadSettings;
use crate::bench::{Options, run};

/// Exit code of `--check` where a figure is above its limit.
const EX_BEYOND: u8 = 1;
/// Measurements of which one has to be within the limits.
const ATTEMPTS: u32 = 2;

#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum AxesArg {
    Three,
    Five,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum ModeArg {
    BackToBack,
    Paced,
    Sustained,
}

#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// Print the figures as one JSON object.
    #[arg(long)]
    json: bool,
    /// Write the JSON object to this file as well.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Length of each mode, s.
    #[arg(long, value_name = "S", default_value = "10")]
    seconds: f64,
    /// Modes to measure. `sustained` runs both sides all the time, half a cycle apart, instead of in blocks.
    #[arg(
        long,
        value_name = "MODE",
        value_enum,
        value_delimiter = ',',
        default_value = "back-to-back,paced"
    )]
    mode: Vec<ModeArg>,
    /// Control cycle in ms, 0.25 to 10.
    #[arg(long, value_name = "MS", default_value = "1")]
    paced_ms: f64,
    /// The machine: three axes with 18 error motions, or five with 30.
    #[arg(long, value_enum, default_value = "three")]
    axes: AxesArg,
    /// Length of one side's turn, ms.
    #[arg(long, value_name = "MS", default_value = "100")]
    block_ms: f64,
    /// SCHED_FIFO priority of control, echo and daemon; 0 leaves the scheduling class alone.
    #[arg(long, value_name = "N", default_value = "40", value_parser = clap::value_parser!(u8).range(0..=99))]
    priority: u8,
    /// Processor of the control.
    #[arg(long, value_name = "N")]
    cpu_control: Option<u16>,
    /// Processor of echo and daemon.
    #[arg(long, value_name = "N")]
    cpu_daemon: Option<u16>,
    /// Do not lock the memory of echo and daemon.
    #[arg(long)]
    no_lock_memory: bool,
    /// Echo and daemon poll their socket from so long before to so long after a frame is expected, us.
    #[arg(long, value_name = "US", default_value = "0")]
    busy_poll_us: f64,
    /// volcompd's link over mutual TLS, with certificates made for the run; the bare echo stays plain, and so the
    /// limits do not apply.
    #[arg(long, conflicts_with = "check")]
    tls: bool,
    /// Measure each mode without and with everything that reads the daemon, in turns of 5 s: 200 event streams of the page, a
    /// scrape of /metrics a second, a gateway to a Mosquitto broker with a subscriber, 8 MTConnect clients. Needs
    /// mosquitto and mosquitto_sub.
    #[arg(long)]
    outputs: bool,
    /// Leave out the computation alone.
    #[arg(long)]
    no_compute: bool,
    /// Exit with 1 where a figure is above its limit in three measurements of three.
    #[arg(long)]
    check: bool,
    /// Another file of volcompd than the one built into this program.
    #[arg(long, value_name = "FILE")]
    volcompd: Option<PathBuf>,
    /// Folder for the files of the run; without one they are removed at the end.
    #[arg(long, value_name = "FOLDER")]
    folder: Option<PathBuf>,
}

/// The bare echo as a process of its own; `cncsim dev bench-link` starts it.
#[derive(Debug, clap::Args)]
pub(super) struct EchoArgs {
    #[arg(long)]
    control: SocketAddr,
    #[arg(long, default_value = "0")]
    priority: u8,
    #[arg(long)]
    cpu: Option<u16>,
    #[arg(long)]
    lock_memory: bool,
    #[arg(long, default_value = "0")]
    busy_poll_us: u64,
    #[arg(long, default_value = "1000")]
    cycle_us: u64,
}

pub(super) fn echo(args: &EchoArgs) -> Result<(), Failure> {
    let EchoArgs { control, priority, cpu, lock_memory, busy_poll_us, cycle_us } = *args;
    let thread = ThreadSettings { priority, cpu, lock_memory };
    let [busy_poll, cycle] = [busy_poll_us, cycle_us].map(Duration::from_micros);
    echo::run(EchoSettings { address: control, thread, busy_poll, cycle })
        .map_err(|e| Failure::new(EX_IOERR, e))
}

pub(super) fn bench_link(args: &Args) -> Result<(), Failure> {
    let scratch = tempfile::tempdir().map_err(|e| Failure::new(EX_IOERR, e))?;
    let folder = args.folder.clone().unwrap_or_else(|| scratch.path().to_owned());
    let options = options(args, folder)?;
    let attempts = if args.check { ATTEMPTS } else { 1 };
    let mut attempt = 1;
    let report = loop {
        let report = measured(&options)?;
        let beyond = report.beyond_limits();
        if beyond.is_empty() || attempt >= attempts {
            break report;
        }
        note!("retried: bench-link, measurement {attempt}: {}", beyond.join("; "));
        attempt += 1;
    };
    print(args, &report, attempt)?;
    let beyond = report.beyond_limits();
    if args.check && !beyond.is_empty() {
        return Err(Failure::new(EX_BEYOND, beyond.join("\nerror: ")));
    }
    Ok(())
}

fn print(args: &Args, report: &Report, attempt: u32) -> Result<(), Failure> {
    let mut object = report.json();
    object["attempts"] = attempt.into();
    if let Some(path) = &args.out {
        crate::cli::write_file(path, format!("{object:#}\n"))
            .map_err(|e| Failure::in_file(EX_IOERR, path, e))?;
    }
    if args.json {
        say!("{object}");
    } else {
        for line in report.lines() {
            say!("{line}");
        }
    }
    Ok(())
}

fn measured(options: &Options) -> Result<Report, Failure> {
    let bar = ProgressBar::new(1000);
    if let Ok(style) = ProgressStyle::with_template("{msg:14} {wide_bar} {percent:>3} %") {
        bar.set_style(style);
    }
    let report = run(options, &mut |what, share| {
        if bar.message() != what {
            bar.set_message(what.to_owned());
        }
        bar.set_position((share * 1000.0) as u64);
    });
    bar.finish_and_clear();
    report.map_err(|e| failure(&e))
}

fn failure(error: &BenchError) -> Failure {
    let code = match error {
        BenchError::File { .. }
        | BenchError::Start { .. }
        | BenchError::Link { .. }
        | BenchError::Timeout { .. } => EX_IOERR,
        BenchError::Setting { .. } => EX_USAGE,
        BenchError::Ended { .. }
        | BenchError::Frame { .. }
        | BenchError::NotActive { .. }
        | BenchError::Tool { .. }
        | BenchError::Histogram(_) => EX_SOFTWARE,
    };
    Failure::new(code, error)
}

fn options(args: &Args, folder: PathBuf) -> Result<Options, Failure> {
    let within = |what: &'static str, value: f64, range: core::ops::RangeInclusive<f64>, allowed| {
        if range.contains(&value) {
            Ok(value)
        } else {
            Err(failure(&BenchError::Setting { what, value, allowed }))
        }
    };
    let cycle_ms = within("--paced-ms", args.paced_ms, 0.25..=10.0, "0.25 to 10")?;
    let block_ms = within("--block-ms", args.block_ms, 10.0..=1000.0, "10 to 1000")?;
    let seconds = within("--seconds", args.seconds, 0.1..=100_000.0, "0.1 to 100000")?;
    let busy_poll_us = within("--busy-poll-us", args.busy_poll_us, 0.0..=10_000.0, "0 to 10000")?;
    let cycle = Duration::from_secs_f64(cycle_ms * 1e-3);
    let cncsim = std::env::current_exe().map_err(|e| Failure::new(EX_IOERR, e))?;
    Ok(Options {
        programs: Programs { cncsim, volcompd: args.volcompd.clone() },
        folder,
        axes: match args.axes {
            AxesArg::Three => Axes::Three,
            AxesArg::Five => Axes::Five,
        },
        seconds,
        modes: args
            .mode
            .iter()
            .map(|mode| match mode {
                ModeArg::BackToBack => Mode::BackToBack,
                ModeArg::Paced => Mode::Paced(cycle),
                ModeArg::Sustained => Mode::Sustained(cycle),
            })
            .collect(),
        cycle,
        block: Duration::from_secs_f64(block_ms * 1e-3),
        priority: args.priority,
        cpus: [args.cpu_control, args.cpu_daemon],
        lock_memory: !args.no_lock_memory,
        busy_poll: Duration::from_secs_f64(busy_poll_us * 1e-6),
        compute: !args.no_compute,
        tls: args.tls,
        outputs: args.outputs,
    })
}
