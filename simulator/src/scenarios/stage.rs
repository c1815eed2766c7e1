//! Machine, control, link and daemon of a scenario.

#![expect(clippy::disallowed_methods, reason = "a stage has files, processes and a clock")]

use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use rustix::process::{Pid, Signal, kill_process};
use toml::{Table, Value};

use super::fault::LinkFault;
use super::plan::{Pacing as PlanPacing, Scenario, merge};
use super::relay::Relay;
use super::tracker::Tracker;
use crate::certificates::{Authority, Issued, Role, Validity};
use crate::control::{Absent, ControlConfig, ControlIdentity, CycleRecord, Flow, OffsetConfig, Pacing};
use crate::demo::programs::{Daemon, Programs};
use crate::demo::shop::Shop;
use crate::monitor::{Settings, SharedMonitor};
use crate::motion::{MachineAxes, MotionCycle, MotionSource, Trajectory};
use crate::truth::{TruthMachine, VMC_850};
use volcomp_units::axes::{AxisArray, AxisName};

const MACHINE_FILE: &str = include_str!("../../../config/examples/vmc-850/machine.toml");
const MODEL_FILE: &str = include_str!("../../../config/examples/vmc-850/model.toml");
/// Far beyond anything that a loaded computer takes.
pub(super) const PATIENCE: Duration = Duration::from_secs(60);
const CYCLE_S: f64 = 1e-3;
/// The circle.
pub(super) const RADIUS_MM: f64 = 20.0;
pub(super) const CENTRE_MM: [f64; 3] = [425.0, 250.0, -250.0];

/// Everything that plays in a scenario.
pub(super) struct Stage {
    pub(super) shop: Shop,
    pub(super) relay: Option<Relay>,
    tracker: Option<Tracker>,
    pub(super) daemon: Option<Daemon>,
    pub(super) second: Option<Daemon>,
    pub(super) records: Vec<CycleRecord>,
    /// Checks every correction: at the relay's end towards the daemon, else in the control.
    pub(super) monitor: SharedMonitor,
    watch_control: bool,
    /// Faults of the link that no frame has met.
    pub(super) idle_faults: Vec<LinkFault>,
    /// The exit code of a daemon that has ended by itself.
    pub(super) exit: Option<i32>,
    /// Where the control listened that was killed and has not come back.
    control_port: Option<u16>,
    /// What `volcomp` has said.
    said: String,
    folder: tempfile::TempDir,
    programs: Programs,
    motion: Trajectory,
    at: AxisArray,
    scenario: Scenario,
}

impl Stage {
    pub(super) fn set(scenario: &Scenario, programs: &Programs) -> anyhow::Result<Self> {
        let machine = TruthMachine::from_toml(VMC_850)?;
        let start = MachineAxes::of(&machine)?.middle();
        let folder = tempfile::tempdir()?;
        if scenario.certificates {
            write_certificates(folder.path())?;
        }
        let mut shop = open(scenario, folder.path(), 0, &start, scenario.ready)?;
        let control: SocketAddr = shop.address().parse()?;
        let names: Vec<AxisName> = shop.axes().as_slice().iter().map(|a| a.name).collect();
        let monitor = SharedMonitor::new(Settings::from_machine_file(MACHINE_FILE, &names)?);
        // a relay cannot read what is encrypted
        let watch_control = !scenario.relay || scenario.control.tls;
        let at_relay = (!watch_control).then(|| monitor.clone());
        if watch_control {
            shop.control().set_monitor(monitor.clone());
        }
        let relay = if scenario.relay { Some(Relay::open(control, scenario.seed, at_relay)?) } else { None };
        let motion = shop.trajectory(&circles(scenario.turns, scenario.feed_mm_per_min))?;
        let stage = Self {
            shop,
            relay,
            monitor,
            watch_control,
            tracker: scenario.sensors.map(|part| Tracker::new(part, scenario.seed)).transpose()?,
            daemon: None,
            second: None,
            control_port: None,
            exit: None,
            records: Vec::new(),
            idle_faults: Vec::new(),
            said: String::new(),
            folder,
            programs: programs.clone(),
            motion,
            at: start,
            scenario: scenario.clone(),
        };
        let address = stage.relay.as_ref().map_or(control, Relay::address);
        std::fs::write(stage.config(), stage.machine_file(&address, "volcompd.sock")?)?;
        std::fs::write(stage.file("second.toml"), stage.machine_file(&address, "second.sock")?)?;
        let mut model: Table = MODEL_FILE.parse()?;
        merge(&mut model, &scenario.model);
        std::fs::write(stage.file("model.toml"), toml::to_string(&model)?)?;
        Ok(stage)
    }

    fn machine_file(&self, address: &SocketAddr, socket: &str) -> anyhow::Result<String> {
        let mut file: Table = MACHINE_FILE.parse()?;
        let text = |path: PathBuf| Value::String(path.display().to_string());
        let mut over = Table::new();
        let mut set = |table: &str, key: &str, value: Value| {
            if let Value::Table(t) = over.entry(table).or_insert_with(|| Table::new().into()) {
                t.insert(key.to_owned(), value);
            }
        };
        set("link", "address", address.to_string().into());
        set("link", "reconnect-min-s", 0.02.into());
        set("link", "reconnect-max-s", 0.1.into());
        set("engine", "start", "on-connect".into());
        set("engine", "ramp-s", 0.5.into());
        set("realtime", "priority", 0.into());
        set("realtime", "lock-memory", false.into());
        set("status", "socket", text(self.file(socket)));
        set("log", "target", "stderr".into());
        set("log", "level", "debug".into());
        if let Some(tracker) = &self.tracker {
            set("sensors", "listen", tracker.address().to_string().into());
        }
        merge(&mut file, &over);
        merge(&mut file, &self.scenario.machine);
        Ok(toml::to_string(&file)?)
    }

    pub(super) fn file(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn config(&self) -> PathBuf {
        self.file("machine.toml")
    }

    /// What all daemons have said.
    pub(super) fn log(&self) -> String {
        std::fs::read_to_string(self.file("volcompd.log")).unwrap_or_default()
    }

    /// The same, and what `volcomp` has said.
    pub(super) fn all_words(&self) -> String {
        self.log() + &self.said
    }

    /// Starts the daemon and waits until it is connected, while simulated time stands still.
    pub(super) fn start_daemon(&mut self) -> anyhow::Result<()> {
        self.daemon = Some(self.spawn()?);
        self.wait_for_daemon()
    }

    /// Simulated time stands still until a daemon is connected.
    pub(super) fn wait_for_daemon(&mut self) -> anyhow::Result<()> {
        self.shop.control().wait_for_daemon(PATIENCE).with_context(|| self.log())
    }

    /// The tracker of the scenario.
    pub(super) fn tracker(&mut self) -> anyhow::Result<&mut Tracker> {
        self.tracker.as_mut().context("the scenario has no tracker: add [scenario.sensors]")
    }

    /// Starts a daemon.
    pub(super) fn spawn(&self) -> anyhow::Result<Daemon> {
        self.spawn_with(&self.config())
    }

    /// Starts a daemon beside the first one, on the same status socket or on one of its own.
    pub(super) fn spawn_second(&mut self, same_socket: bool) -> anyhow::Result<()> {
        let config = if same_socket { self.config() } else { self.file("second.toml") };
        self.second = Some(self.spawn_with(&config)?);
        Ok(())
    }

    fn spawn_with(&self, config: &Path) -> anyhow::Result<Daemon> {
        // the limits that this daemon reads; where it cannot read them, it does not start
        let names: Vec<AxisName> = self.shop.axes().as_slice().iter().map(|a| a.name).collect();
        if let Ok(settings) = Settings::from_machine_file(&std::fs::read_to_string(config)?, &names) {
            self.monitor.set_settings(settings);
        }
        let log = self.file("volcompd.log");
        match self.scenario.file_limit_kib {
            Some(kib) => self.programs.cramped_volcompd(config, &log, kib),
            None if self.scenario.privileges => self.programs.volcompd(config, &log),
            None => self.programs.humble_volcompd(config, &log),
        }
    }

    /// Simulated time stands still, with the link kept alive, until something is so.
    pub(super) fn wait_until(&mut self, what: &str, so: impl FnMut(&mut Self) -> bool) -> anyhow::Result<()> {
        if !self.is_so_within(PATIENCE, so) {
            bail!("waited in vain for {what}; the log: {}", self.log());
        }
        Ok(())
    }

    /// The same for a time at most; false where it is not so by then.
    pub(super) fn is_so_within(&mut self, patience: Duration, mut so: impl FnMut(&mut Self) -> bool) -> bool {
        let begin = Instant::now();
        while !so(self) {
            if begin.elapsed() > patience {
                return false;
            }
            self.shop.control().idle(Duration::from_millis(10));
        }
        true
    }

    /// Sends the daemon a signal.
    pub(super) fn signal(&self, signal: Signal) -> anyhow::Result<()> {
        let Some(daemon) = &self.daemon else { bail!("there is no daemon") };
        let pid = Pid::from_raw(i32::try_from(daemon.id())?).context("process id 0")?;
        Ok(kill_process(pid, signal)?)
    }

    /// Runs `volcomp ARGS` against the daemon of this stage while the control stands still but keeps the link alive.
    pub(super) fn volcomp(&mut self, args: &[String], exit: i32) -> anyhow::Result<()> {
        let socket = self.file("volcompd.sock").display().to_string();
        let folder = self.folder.path().display().to_string();
        let args: Vec<String> = args.iter().map(|a| a.replace("{folder}", &folder)).collect();
        let (programs, words) = (self.programs.clone(), args.clone());
        let thread = std::thread::spawn(move || {
            let mut all: Vec<&str> = words.iter().map(String::as_str).collect();
            all.extend(["--socket", &socket]);
            programs.exit_of(&all)
        });
        while !thread.is_finished() {
            self.shop.control().idle(Duration::from_millis(5));
        }
        let Ok(ran) = thread.join() else { bail!("volcomp could not be run") };
        let (code, said) = ran?;
        if code != exit {
            bail!("volcomp {}: exit code {code}, expected {exit}: {said}", args.join(" "));
        }
        self.said.push_str(&said);
        self.said.push('\n');
        Ok(())
    }

    /// The control ends in order, or is gone without a word.
    pub(super) fn end_control(&mut self, in_order: bool) -> anyhow::Result<()> {
        self.control_port = Some(self.shop.address().parse::<SocketAddr>()?.port());
        // one that nobody knows stands in for it, because there is always a machine
        let spare = open(&self.scenario, self.folder.path(), 0, &self.at, true)?;
        let old = core::mem::replace(&mut self.shop, spare);
        if in_order {
            drop(old)
        } else {
            old.vanish()
        }
        Ok(())
    }

    /// A new control listens in the place of the old one, where the motion stands, without any offset.
    pub(super) fn start_control(&mut self) -> anyhow::Result<()> {
        let Some(port) = self.control_port.take() else { bail!("the control has not been killed") };
        let begin = Instant::now();
        self.shop = loop {
            match open(&self.scenario, self.folder.path(), port, &self.at, true) {
                Ok(shop) => break shop,
                Err(e) if begin.elapsed() > PATIENCE => return Err(e),
                Err(_) => std::thread::sleep(Duration::from_millis(10)),
            }
        };
        if self.watch_control {
            self.shop.control().set_monitor(self.monitor.clone());
        }
        self.wait_for_daemon()
    }

    /// Goes on with the motion until so many cycles have been run in all; `false` at its end.
    pub(super) fn run_to(&mut self, cycles: Option<u64>) -> anyhow::Result<bool> {
        let mut done = self.records.len() as u64;
        if cycles.is_some_and(|n| done >= n) {
            return Ok(true);
        }
        let mut part = Part { motion: &mut self.motion, at: &mut self.at };
        let (records, tracker) = (&mut self.records, &mut self.tracker);
        self.shop.watch(&mut part, &mut |r| {
            records.push(*r);
            if let Some(tracker) = tracker.as_mut() {
                tracker.look(r);
            }
            done += 1;
            Ok(if cycles == Some(done) { Flow::Stop } else { Flow::GoOn })
        })?;
        Ok(cycles == Some(done))
    }
}

/// Whole turns about the middle of the machine.
fn circles(turns: usize, feed: u32) -> String {
    let [x, y, _] = CENTRE_MM;
    let (left, right) = (x - RADIUS_MM, x + RADIUS_MM);
    let turn = format!("G3 X{left} Y{y} I-{RADIUS_MM} J0\nG3 X{right} Y{y} I{RADIUS_MM} J0\n");
    format!(
        "G21 G90 G64 G17\n(SCORE OFF)\nG0 X{right} Y{y}\nF{feed}\n(SCORE ON)\n{}(SCORE OFF)\nM30\n",
        turn.repeat(turns)
    )
}

/// An authority with a control and a daemon, and another one with another daemon.
fn write_certificates(folder: &Path) -> anyhow::Result<()> {
    let issue = |stem: &str, issued: &Issued| {
        issued.write(folder, stem).map_err(|(path, e)| anyhow::anyhow!("{}: {e}", path.display()))
    };
    for prefix in ["", "other-"] {
        let authority = Authority::new(&format!("{prefix}test"), Validity::days(2))?;
        issue(&format!("{prefix}ca"), &authority.own())?;
        let control = authority.issue(Role::Control, &["127.0.0.1"], Validity::days(1))?;
        issue(&format!("{prefix}control"), &control)?;
        let daemon = authority.issue(Role::Daemon, &["volcompd"], Validity::days(1))?;
        issue(&format!("{prefix}daemon"), &daemon)?;
    }
    Ok(())
}

fn open(
    scenario: &Scenario,
    folder: &Path,
    port: u16,
    start: &AxisArray,
    ready: bool,
) -> anyhow::Result<Shop> {
    let mut machine = TruthMachine::from_toml(VMC_850)?;
    machine.set_ram_drift(scenario.sensors.map(|part| part.ram(scenario.seed)));
    let id = scenario.control.machine.clone().unwrap_or_else(|| machine.machine().to_owned());
    let mut offset = OffsetConfig { delay_cycles: scenario.delay_cycles, ..OffsetConfig::default() };
    if let Some(limit_um) = scenario.control.limit_um {
        offset.linear.size = limit_um / 1e3;
    }
    let file = |name: &str| folder.join(name);
    let identity = if scenario.control.tls {
        Some(ControlIdentity::from_files(&file("ca.pem"), &file("control.pem"), &file("control.key"))?)
    } else {
        None
    };
    let silence = scenario.control.silence_s.map(Duration::from_secs_f64);
    let answer_timeout = Duration::from_secs_f64(scenario.answer_ms / 1e3);
    let config = ControlConfig {
        cycle_s: CYCLE_S,
        listen: ([127, 0, 0, 1], port).into(),
        pacing: match scenario.pacing {
            PlanPacing::LockStep => Pacing::LockStep { answer_timeout, absent: Absent::GoOn },
            PlanPacing::RealTime => Pacing::RealTime,
        },
        ready,
        offset,
        identity,
        silence: silence.unwrap_or(Duration::from_secs(1)),
        ..ControlConfig::new(id, MachineAxes::of(&machine)?)
    };
    Shop::with_control(machine, scenario.seed, config, start)
}

/// The model file with every value of every error times `by`.
pub(super) fn scaled_model(by: f64) -> anyhow::Result<String> {
    let mut model: Table = MODEL_FILE.parse()?;
    if let Some(errors) = model.get_mut("errors") {
        scale(errors, by, "");
    }
    Ok(toml::to_string(&model)?)
}

fn scale(value: &mut Value, by: f64, key: &str) {
    let is_value = ["-um", "-arcsec"].iter().any(|unit| key.ends_with(unit));
    match value {
        Value::Table(table) => table.iter_mut().for_each(|(key, v)| scale(v, by, key)),
        Value::Array(list) if is_value => list.iter_mut().for_each(|v| scale(v, by, key)),
        Value::Float(v) if is_value => *v *= by,
        Value::Integer(v) if is_value => *value = Value::Float(*v as f64 * by),
        _ => {}
    }
}

/// Writes a file of the stage.
pub(super) fn write(path: &Path, text: &str) -> anyhow::Result<()> {
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
    }
    std::fs::write(path, text).with_context(|| path.display().to_string())
}

/// The rest of a motion that was left in the middle.
struct Part<'a> {
    motion: &'a mut Trajectory,
    at: &'a mut AxisArray,
}

impl MotionSource for Part<'_> {
    fn start(&self) -> AxisArray {
        *self.at
    }

    fn next_cycle(&mut self) -> Option<MotionCycle> {
        let next = self.motion.next_cycle()?;
        *self.at = next.commanded;
        Some(next)
    }

    fn rewind(&mut self) {
        self.motion.rewind();
        *self.at = self.motion.start();
    }
}
