//! A scenario from its first cycle to its verdict.

#![expect(clippy::disallowed_methods, reason = "a scenario waits for processes")]

use std::io::Write;
use std::net::TcpStream;
use std::os::unix::net::UnixStream;
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use rustix::fs::{FileType, Mode};
use rustix::process::Signal;
use volcomp_protocol::MachineState;

use super::plan::{Action, Scenario};
use super::relay::Relay;
use super::stage::{CENTRE_MM, PATIENCE, RADIUS_MM, Stage, scaled_model, write};
use super::verdict::{Seen, Verdict, judge};
use crate::control::{CycleRecord, Happening};
use crate::demo::figures;
use crate::demo::programs::{Daemon, Programs};

const CYCLE_S: f64 = 1e-3;
/// Cycles at the end of the motion over which accuracy is judged.
const JUDGED: usize = 1000;
/// Lines of the log that are kept where something does not hold.
const LAST_WORDS: usize = 40;
/// How long awaited words of the log may follow the last cycle.
const LOG_LAG: Duration = Duration::from_secs(10);

/// Runs a scenario, as often as it may be tried.
///
/// # Errors
/// It could not be run at all; what did not hold is in the verdict.
pub fn run(scenario: &Scenario, programs: &Programs) -> anyhow::Result<Verdict> {
    let mut runs = 1;
    loop {
        let verdict = run_once(scenario, programs)?;
        // a broken promise is never a matter of the computer's own time
        if verdict.ok || runs >= scenario.tries || !verdict.monitor.is_clean() {
            return Ok(Verdict { runs, ..verdict });
        }
        retried(scenario, &verdict);
        runs += 1;
    }
}

/// Reports a repetition past the capture of tests: the gate lists every line that begins with `retried:`.
fn retried(scenario: &Scenario, verdict: &Verdict) {
    let failures = verdict.failures.join("; ");
    let _ = writeln!(std::io::stderr(), "retried: scenario {} ({failures})", scenario.number);
}

fn run_once(scenario: &Scenario, programs: &Programs) -> anyhow::Result<Verdict> {
    let mut stage = Stage::set(scenario, programs)?;
    if scenario.daemon {
        stage.start_daemon()?;
    }
    let mut last_action = 0;
    for step in &scenario.actions {
        if !stage.run_to(Some(step.at))? {
            bail!("the motion ends before cycle {}", step.at);
        }
        act(&mut stage, &step.action).with_context(|| format!("cycle {}: {:?}", step.at, step.action))?;
        last_action = stage.records.last().map_or(0, |r| r.cycle);
    }
    stage.run_to(None)?;
    // the log is written beside the cycle, its last words may follow the last answer
    let _ = stage.is_so_within(LOG_LAG, |s| {
        let words = s.all_words();
        scenario.accept.log.iter().all(|w| words.contains(w))
    });
    if stage.exit.is_none() && scenario.accept.exit.is_some() {
        stage.exit = ended(&mut stage.daemon)?;
    }
    let residual = residual_um(&stage)?;
    let seen = Seen { records: &stage.records, residual_um: &residual, monitor: stage.monitor.report() };
    let mut verdict = judge(scenario, &seen, last_action, CYCLE_S, &stage.all_words());
    let second = if scenario.accept.second_exit.is_some() { ended(&mut stage.second)? } else { None };
    for (which, found, wanted) in
        [("daemon", stage.exit, scenario.accept.exit), ("second daemon", second, scenario.accept.second_exit)]
    {
        if found != wanted {
            verdict.fail(format!("exit code of the {which} {found:?}, not {wanted:?}"));
        }
    }
    stage.idle_faults.extend(stage.relay.as_ref().and_then(Relay::clear));
    for fault in &stage.idle_faults {
        verdict.fail(format!("no frame has met {:?}", fault.kind));
    }
    if !verdict.ok {
        let words = stage.all_words();
        let lines = words.lines().count();
        verdict.last_words =
            words.lines().skip(lines.saturating_sub(LAST_WORDS)).map(str::to_owned).collect();
    }
    Ok(verdict)
}

/// The exit code of a daemon that ends by itself; none where it goes on and on.
fn ended(daemon: &mut Option<Daemon>) -> anyhow::Result<Option<i32>> {
    let Some(daemon) = daemon else { return Ok(None) };
    let begin = Instant::now();
    while daemon.is_running() {
        if begin.elapsed() > PATIENCE {
            return Ok(None);
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    Ok(daemon.wait()?.code())
}

/// Radial deviations over the last second of motion.
fn residual_um(stage: &Stage) -> anyhow::Result<Vec<f64>> {
    let moving = |r: &&CycleRecord| r.scored && r.state.has(MachineState::MOVING);
    let scored: Vec<CycleRecord> = stage.records.iter().filter(moving).copied().collect();
    let Some(last) = scored.len().checked_sub(JUDGED).map(|from| &scored[from..]) else {
        bail!("only {} cycles on the circle", scored.len())
    };
    let trace = figures::ballbar(stage.shop.machine(), CENTRE_MM, RADIUS_MM, last)?;
    Ok(trace.readings.iter().map(|r| r.deviation_um).collect())
}

fn act(stage: &mut Stage, action: &Action) -> anyhow::Result<()> {
    let set = |stage: &mut Stage, bits| stage.shop.control().happen(Happening::Set(bits));
    let clear = |stage: &mut Stage, bits| stage.shop.control().happen(Happening::Clear(bits));
    match action {
        Action::StartDaemon => stage.start_daemon()?,
        Action::SpawnDaemon => stage.daemon = Some(stage.spawn()?),
        Action::StartSecondDaemon { same_socket } => stage.spawn_second(*same_socket)?,
        Action::KillDaemon => {
            if let Some(mut daemon) = stage.daemon.take() {
                daemon.kill()?;
            }
        }
        Action::TermDaemon => stage.signal(Signal::TERM)?,
        Action::SuspendDaemon => stage.signal(Signal::STOP)?,
        Action::ResumeDaemon => stage.signal(Signal::CONT)?,
        Action::HangupDaemon => stage.signal(Signal::HUP)?,
        Action::WaitForExit => {
            stage.wait_until("the daemon's end", |s| s.daemon.as_mut().is_none_or(|d| !d.is_running()))?;
            stage.exit = ended(&mut stage.daemon)?;
        }
        Action::WaitForLog { words } => stage.wait_until(words, |s| s.all_words().contains(words))?,
        Action::Pause { ms } => idle(stage, *ms),
        Action::HangDaemon { ms } => {
            stage.signal(Signal::STOP)?;
            std::thread::sleep(Duration::from_millis(*ms));
            stage.signal(Signal::CONT)?;
        }
        Action::Estop => set(stage, MachineState::ESTOP),
        Action::EstopRelease => clear(stage, MachineState::ESTOP),
        Action::DrivesOff => clear(stage, MachineState::ENABLED),
        Action::DrivesOn => set(stage, MachineState::ENABLED),
        Action::Unhome => clear(stage, MachineState::HOMED),
        Action::Home => set(stage, MachineState::HOMED),
        Action::Tool { longer_mm } => {
            let mut tool = stage.shop.control().tool().unwrap_or_default();
            tool.number += 1;
            tool.tip[2] -= longer_mm;
            stage.shop.control().happen(Happening::Tool(tool));
        }
        Action::Volcomp { args, exit } => stage.volcomp(args, *exit)?,
        Action::ScaleModel { file, by } => write(&stage.file(file), &scaled_model(*by)?)?,
        Action::WriteFile { file, text } => write(&stage.file(file), text)?,
        Action::MakePipe { file } => {
            let path = stage.file(file);
            rustix::fs::mknodat(rustix::fs::CWD, &path, FileType::Fifo, Mode::RUSR | Mode::WUSR, 0)?;
        }
        Action::ReplaceInFile { file, from, to } => {
            let path = stage.file(file);
            let text = std::fs::read_to_string(&path)?;
            if !text.contains(from.as_str()) {
                bail!("{} does not hold {from:?}", path.display());
            }
            write(&path, &text.replace(from.as_str(), to))?;
        }
        Action::Link(fault) => match &stage.relay {
            Some(relay) => {
                let idle = relay.set(*fault);
                stage.idle_faults.extend(idle);
            }
            None => bail!("the scenario has no relay: set relay = true"),
        },
        Action::Tracker(fault) => stage.tracker()?.begin(*fault),
        Action::BusyProcessors { ms } => busy(Duration::from_millis(*ms))?,
        Action::RestartControl => {
            stage.end_control(true)?;
            stage.start_control()?;
        }
        Action::KillControl => stage.end_control(false)?,
        Action::StartControl => stage.start_control()?,
        Action::HangControl { ms } => std::thread::sleep(Duration::from_millis(*ms)),
        Action::ConnectionStorm { count } => {
            let address = stage.shop.address();
            for _ in 0..*count {
                drop(TcpStream::connect(&address)?);
            }
            idle(stage, 50);
        }
        Action::CommandStorm { count } => {
            let socket = stage.file("volcompd.sock");
            for k in 0..*count {
                let mut stream = UnixStream::connect(&socket)?;
                // nonsense, half a command, and nothing at all; whoever is one too many is refused
                let words: &[u8] =
                    [&b"{\"command\": \"explode\"}\n"[..], b"{\"command\": ", b""][k as usize % 3];
                let _ = stream.write_all(words);
            }
            idle(stage, 100);
        }
        Action::WaitForDaemon => stage.wait_for_daemon()?,
        Action::Mark => {}
    }
    Ok(())
}

/// The control keeps the link alive for a while; simulated time stands still.
fn idle(stage: &mut Stage, ms: u64) {
    stage.shop.control().idle(Duration::from_millis(ms));
}

/// Twice as many threads as processors count for a while, beside everything else.
fn busy(time: Duration) -> anyhow::Result<()> {
    let threads = 2 * std::thread::available_parallelism()?.get();
    for _ in 0..threads {
        std::thread::Builder::new().name("busy".to_owned()).spawn(move || {
            let begin = Instant::now();
            let mut count = 0u64;
            while begin.elapsed() < time {
                count = std::hint::black_box(count.wrapping_add(1));
            }
        })?;
    }
    Ok(())
}
