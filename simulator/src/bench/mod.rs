//! Round trips of the real daemon beside the bare limit, in the same run.
//!
//! The same frames go through a bare [`echo`] and through volcompd, each a process of its own on the same kind of
//! socket, thread and settings. The sides take turns in short blocks ([`rounds`]), so that noise of the computer
//! hits both: ratios count, never absolute times. What the computation alone costs is asked of `volcomp bench`.
//! Assumption: one loopback connection each, one frame on the way, as a control in lock step has it.

#![expect(
    clippy::disallowed_methods,
    reason = "a measurement is made of clocks, sockets and processes, and writes their files"
)]

pub mod echo;
pub mod error;
pub mod files;
pub mod outputs;
pub mod partner;
pub mod process;
pub mod report;
pub mod rounds;
pub mod thread;
mod trial;

#[cfg(test)]
mod tests;

use core::time::Duration;
use std::path::{Path, PathBuf};
use std::time::Instant;

use volcomp_protocol::CorrectionState;

use echo::EchoSettings;
use error::BenchError;
use files::{Axes, DaemonSettings};
use outputs::{Addresses, Switch};
use partner::{Partner, Place};
use process::Programs;
use report::{Compute, Report, Setting};
use rounds::{Mode, Pair, Round, measure};
use thread::{Granted, ThreadSettings};

/// Cycles that a daemon gets to become active.
const SETTLE_CYCLES: u32 = 2_000;
/// Cycles of the computation that are timed.
const COMPUTE_CYCLES: &str = "200000";

/// Longest time with the readers on, or off, s.
const TURN_S: f64 = 5.0;

/// What the links gave.
struct Measured {
    granted: Granted,
    rounds: Vec<Round>,
    daemon: serde_json::Value,
    received: Option<[(&'static str, u64); 5]>,
}

/// Hears what is being measured, and which share of it is done.
pub type Say<'a> = &'a mut (dyn FnMut(&str, f64) + Send);

/// What to measure.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// The programs.
    pub programs: Programs,
    /// Folder for the files of the run.
    pub folder: PathBuf,
    /// Which machine the link carries.
    pub axes: Axes,
    /// Length of each mode, s.
    pub seconds: f64,
    /// Modes to measure.
    pub modes: Vec<Mode>,
    /// Cycle that control and daemon agree on.
    pub cycle: Duration,
    /// Length of one side's turn.
    pub block: Duration,
    /// SCHED_FIFO priority of all three threads, 0 for none.
    pub priority: u8,
    /// Processor of the control, and of echo and daemon.
    pub cpus: [Option<u16>; 2],
    /// Lock the memory of echo and daemon.
    pub lock_memory: bool,
    /// Time that echo and daemon poll before and after the moment at which a frame is expected.
    pub busy_poll: Duration,
    /// Measure the computation alone as well.
    pub compute: bool,
    /// volcompd's link is mutual TLS; the bare echo stays plain.
    pub tls: bool,
    /// Measure each mode with everything that reads the daemon, too, in turns.
    pub outputs: bool,
}

/// Measures everything that was asked for; `say` hears what is being done, and the share that is done.
///
/// # Errors
/// A program does not start or does not answer.
pub fn run(options: &Options, say: Say<'_>) -> Result<Report, BenchError> {
    let load_before = load_average();
    let setting = Setting::of(options);
    let compute = if options.compute { compute(options, say)? } else { Vec::new() };
    // the thread that measures has settings of its own, and they must not outlive the measurement
    let measured = std::thread::scope(|scope| {
        let control = scope.spawn(|| links(options, say));
        control
            .join()
            .unwrap_or_else(|_| Err(BenchError::Tool { verb: "bench-link", said: "panicked".to_owned() }))
    })?;
    let Measured { granted, rounds, daemon, received } = measured;
    let load_average = [load_before, load_average()];
    Ok(Report { setting, granted, load_average, compute, rounds, daemon, received })
}

fn control_thread(options: &Options) -> ThreadSettings {
    ThreadSettings { priority: options.priority, cpu: options.cpus[0], lock_memory: false }
}

/// Starts both sides, measures every mode, and asks the daemon what it has seen.
fn links(options: &Options, say: Say<'_>) -> Result<Measured, BenchError> {
    let folder = &options.folder;
    let [echo_place, daemon_place] = [Place::open("the bare echo")?, Place::open("volcompd")?];
    let addresses = options.outputs.then(Addresses::free).transpose()?;
    let socket = write_files(options, options.axes, folder, daemon_place.address()?, addresses.as_ref())?;
    let identity = options.tls.then(|| trial::identity(folder)).transpose()?;
    let log = folder.join("volcompd.log");
    let echo_settings = EchoSettings {
        address: echo_place.address()?,
        thread: ThreadSettings {
            priority: options.priority,
            cpu: options.cpus[1],
            lock_memory: options.lock_memory,
        },
        busy_poll: options.busy_poll,
        cycle: options.cycle,
    };
    let _echo = options.programs.echo(&echo_settings)?;
    let _daemon = options.programs.volcompd(&folder.join("machine.toml"), &log)?;
    let origin = Instant::now();
    let mut echo = echo_place.accept(options.axes, origin, None)?;
    let mut daemon = daemon_place.accept(options.axes, origin, identity.as_ref())?;
    let switch = addresses.map(|a| Switch::new(&options.programs, a, &folder.join("machine.toml")));
    // not before both run: a process inherits class and processor of the thread that starts it
    let granted = control_thread(options).apply();
    daemon.handshake(options.cycle)?;
    settle(&mut daemon, &mut echo, options.cycle, &log)?;

    let mut rounds = Vec::new();
    for mode in &options.modes {
        let mut pair = Pair { echo: &mut echo, daemon: &mut daemon };
        let length = Duration::from_secs_f64(options.seconds);
        let mut tick = |share| say(mode.name(), share);
        let mut quiet = Round::new(*mode, false)?;
        match &switch {
            None => measure(&mut pair, &mut quiet, length, options.block, &mut tick)?,
            Some(switch) => {
                let mut read = Round::new(*mode, true)?;
                in_turns(&mut pair, [&mut quiet, &mut read], switch, options, &mut tick)?;
                rounds.push(read);
            }
        }
        rounds.push(quiet);
        still_active(&daemon, &log)?;
    }
    let received = switch.map(|switch| switch.received().counts());
    let status =
        options.programs.volcomp("status", &["--json", "--socket", &socket.display().to_string()])?;
    daemon.close();
    drop(echo);
    Ok(Measured { granted, rounds, daemon: status, received })
}

/// Measures without and with readers in turns, so that a change of the computer hits both.
fn in_turns(
    pair: &mut Pair<'_>,
    [quiet, read]: [&mut Round; 2],
    switch: &Switch,
    options: &Options,
    tick: &mut dyn FnMut(f64),
) -> Result<(), BenchError> {
    let turns = (options.seconds / TURN_S).ceil().max(1.0);
    let length = Duration::from_secs_f64(options.seconds / turns);
    let all = 2 * turns as u32;
    for turn in 0..all {
        // off, on, on, off: neither is always the second
        let on = matches!(turn % 4, 1 | 2);
        switch.set(on)?;
        let round = if on { &mut *read } else { &mut *quiet };
        let mut share = |part: f64| tick((f64::from(turn) + part) / f64::from(all));
        measure(pair, round, length, options.block, &mut share)?;
    }
    switch.set(false)
}

/// Cycles until the daemon compensates, and warms the echo up alike.
fn settle(daemon: &mut Partner, echo: &mut Partner, cycle: Duration, log: &Path) -> Result<(), BenchError> {
    for _ in 0..SETTLE_CYCLES {
        for side in [&mut *daemon, &mut *echo] {
            side.prepare();
            side.exchange()?;
        }
        if daemon.answer.state == CorrectionState::Active {
            return Ok(());
        }
        std::thread::sleep(cycle);
    }
    still_active(daemon, log)
}

fn still_active(daemon: &Partner, log: &Path) -> Result<(), BenchError> {
    match daemon.answer.state {
        CorrectionState::Active => Ok(()),
        state => Err(BenchError::NotActive { state, log: log.to_owned() }),
    }
}

/// What the computation alone costs, for three and for five axes.
fn compute(options: &Options, say: Say<'_>) -> Result<Vec<Compute>, BenchError> {
    let mut all = Vec::new();
    // the computation knows no link, and needs no certificates
    let options = &Options { tls: false, ..options.clone() };
    for axes in [Axes::Three, Axes::Five] {
        say("compute", if all.is_empty() { 0.0 } else { 0.5 });
        let folder = options.folder.join(axes.name());
        write_files(options, axes, &folder, ([127, 0, 0, 1], 7878).into(), None)?;
        let config = folder.join("machine.toml").display().to_string();
        let figures = options
            .programs
            .volcomp("bench", &["--json", "--cycles", COMPUTE_CYCLES, "--config", &config])?;
        all.push(Compute { axes, figures });
    }
    Ok(all)
}

/// Writes machine and model file; gives the path of the status socket.
fn write_files(
    options: &Options,
    axes: Axes,
    folder: &Path,
    address: core::net::SocketAddr,
    outputs: Option<&Addresses>,
) -> Result<PathBuf, BenchError> {
    let file = |path: &Path| {
        let path = path.to_owned();
        move |source| BenchError::File { path, source }
    };
    std::fs::create_dir_all(folder).map_err(file(folder))?;
    let socket = folder.join("volcompd.sock");
    let settings = DaemonSettings {
        address,
        cycle_ms: options.cycle.as_secs_f64() * 1e3,
        priority: options.priority,
        cpu: options.cpus[1],
        lock_memory: options.lock_memory,
        busy_poll_us: options.busy_poll.as_secs_f64() * 1e6,
        tls: options.tls,
    };
    let machine =
        axes.machine_file(&settings, &socket) + &outputs.map_or_else(String::new, Addresses::tables);
    for (name, text) in [("machine.toml", machine), ("model.toml", axes.model_file())] {
        let path = folder.join(name);
        std::fs::write(&path, text).map_err(file(&path))?;
    }
    Ok(socket)
}

/// The load average of the last minute; `None` where the system does not tell.
fn load_average() -> Option<f64> {
    let text = std::fs::read_to_string("/proc/loadavg").ok()?;
    text.split_whitespace().next()?.parse().ok()
}
