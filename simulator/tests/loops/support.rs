//! The shipped machine, its control and the real daemon as a process, and what must hold whatever happens to them.
//!
//! Lock step: simulated time stands still while a test waits for a process, so moments are counted in control cycles.

#![expect(clippy::disallowed_methods, reason = "helpers of tests with processes, sockets and files")]
#![expect(clippy::unwrap_used, clippy::expect_used, reason = "helpers of tests")]

pub(crate) mod rules;

use std::cell::RefCell;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process};
use simulator::control::{
    Absent, Control, ControlConfig, CycleRecord, Flow, Interface, LinkEvent, Observer, OffsetConfig, Pacing,
    ScriptedEvent,
};
use simulator::demo::programs::{Daemon, Programs};
use simulator::demo::shop::Shop;
use simulator::motion::{MachineAxes, MotionCycle, MotionSource, Trajectory};
use simulator::truth::{TruthMachine, VMC_850};
use tempfile::TempDir;
use volcomp::model::axes::AxisArray;
use volcomp::protocol::{CorrectionState, MachineState};

/// The machine file that is shipped for this machine, and its model.
const MACHINE_FILE: &str = include_str!("../../../config/examples/vmc-850/machine.toml");
const MODEL_FILE: &str = include_str!("../../../config/examples/vmc-850/model.toml");
pub(crate) const CNCSIM: &str = env!("CARGO_BIN_EXE_cncsim");
/// Far beyond anything that a loaded computer takes.
pub(crate) const PATIENCE: Duration = Duration::from_secs(60);
/// More cycles than any ramp here.
const CYCLES_LIMIT: usize = 20_000;
/// The daemon's ramp, s.
pub(crate) const RAMP_S: f64 = 0.5;
pub(crate) const SEED: u64 = 3;
pub(crate) const RADIUS_MM: f64 = 20.0;
pub(crate) const CENTRE_MM: [f64; 3] = [425.0, 250.0, -250.0];

/// Feed of the usual circles, mm/min.
pub(crate) const FEED: u32 = 2000;

/// Whole turns of R 20 mm about the middle of the machine; at F2000 one turn is 3.8 s.
pub(crate) fn circles(turns: usize, feed: u32) -> String {
    let [x, y, _] = CENTRE_MM;
    let (left, right) = (x - RADIUS_MM, x + RADIUS_MM);
    let turn = format!("G3 X{left} Y{y} I-{RADIUS_MM} J0\nG3 X{right} Y{y} I{RADIUS_MM} J0\n");
    format!(
        "G21 G90 G64 G17\n(SCORE OFF)\nG0 X{right} Y{y}\nF{feed}\n(SCORE ON)\n{}(SCORE OFF)\nM30\n",
        turn.repeat(turns)
    )
}

/// How a bench differs from the usual one.
pub(crate) struct Setup {
    pub(crate) port: u16,
    pub(crate) pacing: Pacing,
    pub(crate) interface: Interface,
    /// Cycles from a position to the use of its correction.
    pub(crate) delay_cycles: u32,
    pub(crate) ready: bool,
    pub(crate) cycle_s: f64,
    pub(crate) feed: u32,
    /// Axes of the control; all of the machine's where there is no number.
    pub(crate) axes: Option<usize>,
    pub(crate) start: Option<AxisArray>,
    pub(crate) script: Vec<ScriptedEvent>,
    /// Changes of the machine file.
    pub(crate) edit: fn(&mut toml::Table),
}

impl Default for Setup {
    fn default() -> Self {
        Self {
            port: 0,
            pacing: Pacing::LockStep { answer_timeout: PATIENCE, absent: Absent::GoOn },
            interface: Interface::Frames,
            delay_cycles: 1,
            ready: true,
            cycle_s: 0.001,
            feed: FEED,
            axes: None,
            start: None,
            script: Vec::new(),
            edit: |_| {},
        }
    }
}

/// Sets a key of the machine file.
pub(crate) fn set(file: &mut toml::Table, table: &str, key: &str, value: impl Into<toml::Value>) {
    let entry = file.entry(table).or_insert_with(|| toml::Table::new().into());
    entry.as_table_mut().unwrap().insert(key.to_owned(), value.into());
}

/// The daemon's folder: machine file, model, log.
pub(crate) struct Files {
    folder: TempDir,
}

/// Machine, control, the daemon's files, and everything that was recorded.
pub(crate) struct Bench {
    pub(crate) files: Files,
    pub(crate) shop: Shop,
    pub(crate) records: Vec<CycleRecord>,
    pub(crate) events: Rc<RefCell<Vec<LinkEvent>>>,
    pub(crate) motion: Trajectory,
    /// Where the motion stands.
    at: AxisArray,
}

impl Bench {
    /// A bench with its control listening and one turn after another to come; no daemon yet.
    pub(crate) fn new(setup: Setup, turns: usize) -> Self {
        let machine = TruthMachine::from_toml(VMC_850).unwrap();
        let all = MachineAxes::of(&machine).unwrap();
        let axes =
            setup.axes.map_or(all.clone(), |n| MachineAxes::new(all.as_slice()[..n].to_vec()).unwrap());
        let start = setup.start.unwrap_or_else(|| axes.middle());
        let config = ControlConfig {
            cycle_s: setup.cycle_s,
            listen: ([127, 0, 0, 1], setup.port).into(),
            pacing: setup.pacing,
            interface: setup.interface,
            offset: OffsetConfig { delay_cycles: setup.delay_cycles, ..OffsetConfig::default() },
            ready: setup.ready,
            script: setup.script,
            ..ControlConfig::new(machine.machine(), axes)
        };
        let mut shop = Shop::with_control(machine, SEED, config, &start).unwrap();
        let events = Rc::new(RefCell::new(Vec::new()));
        let heard = Rc::clone(&events);
        shop.control().set_listener(move |event| heard.borrow_mut().push(event.clone()));
        let motion = shop.trajectory(&circles(turns, setup.feed)).unwrap();
        let files = Files::new(&shop.address(), setup.edit);
        shop.monitor(&std::fs::read_to_string(files.config()).unwrap()).unwrap();
        Self { files, shop, records: Vec::new(), events, motion, at: start }
    }

    /// Starts a daemon and waits until it is connected, while simulated time stands still.
    pub(crate) fn connected_daemon(&mut self) -> Daemon {
        let daemon = self.files.daemon();
        self.wait_for_daemon();
        daemon
    }

    fn wait_for_daemon(&mut self) {
        if let Err(e) = self.control().wait_for_daemon(PATIENCE) {
            panic!("{e}:\n{}", self.files.log());
        }
    }

    pub(crate) fn control(&mut self) -> &mut Control {
        self.shop.control()
    }

    /// Goes on with the motion until a cycle is the wanted one; it is the last of the records then.
    pub(crate) fn run_until(&mut self, what: &str, mut wanted: impl FnMut(&CycleRecord) -> bool) {
        let mut count = 0;
        let mut found = false;
        self.go_on(&mut |r| {
            count += 1;
            found = wanted(r);
            Ok(if found || count == CYCLES_LIMIT { Flow::Stop } else { Flow::GoOn })
        });
        assert!(found, "not within {count} cycles: {what}; log:\n{}", self.files.log());
    }

    /// Goes on with the motion until the daemon is in this state.
    pub(crate) fn run_until_state(&mut self, state: CorrectionState) {
        self.run_until(&format!("{state:?}"), |r| r.correction.is_some_and(|c| c.state == state));
    }

    /// Goes on with the motion for so many cycles.
    pub(crate) fn run_cycles(&mut self, cycles: usize) {
        let mut count = 0;
        self.run_until("end of the motion", |_| {
            count += 1;
            count == cycles
        });
    }

    /// Runs the motion to its end.
    pub(crate) fn run_to_end(&mut self) {
        self.go_on(&mut |_| Ok(Flow::GoOn));
        assert!(self.motion.next_cycle().is_none());
    }

    fn go_on(&mut self, observer: Observer<'_>) {
        let mut part = Part { motion: &mut self.motion, at: &mut self.at };
        let records = &mut self.records;
        self.shop
            .watch(&mut part, &mut |r| {
                records.push(*r);
                observer(r)
            })
            .unwrap();
    }

    /// Stands still for so many cycles.
    pub(crate) fn stand(&mut self, cycles: usize) {
        let records = &mut self.records;
        let mut left = cycles;
        self.shop
            .watch_standing(1e6, &mut |r| {
                records.push(*r);
                left -= 1;
                Ok(if left == 0 { Flow::Stop } else { Flow::GoOn })
            })
            .unwrap();
    }

    pub(crate) fn last(&self) -> &CycleRecord {
        self.records.last().unwrap()
    }

    /// This control ends as a process does that is told to, and another one starts in its place: on the same port, where
    /// the motion stands, without any offset.
    pub(crate) fn with_new_control(self, meanwhile: impl FnOnce(&Files, u16)) -> Self {
        let Self { files, shop, motion, at, .. } = self;
        let port = shop.address().parse::<SocketAddr>().unwrap().port();
        drop(shop);
        meanwhile(&files, port);
        let mut new = Self::new(Setup { port, start: Some(at), ..Setup::default() }, 1);
        new.shop.monitor(&std::fs::read_to_string(files.config()).unwrap()).unwrap();
        new.files = files;
        new.motion = motion;
        new.at = at;
        new.wait_for_daemon();
        new
    }
}

impl Files {
    fn new(address: &str, edit: fn(&mut toml::Table)) -> Self {
        let files = Self { folder: tempfile::tempdir().unwrap() };
        let mut file: toml::Table = MACHINE_FILE.parse().unwrap();
        set(&mut file, "link", "address", address);
        // a loaded computer is no fault of the daemon
        set(&mut file, "link", "silence-s", 60.0);
        set(&mut file, "link", "reconnect-min-s", 0.02);
        set(&mut file, "link", "reconnect-max-s", 0.1);
        set(&mut file, "engine", "stale-ms", 10_000.0);
        set(&mut file, "engine", "start", "on-connect");
        set(&mut file, "engine", "ramp-s", RAMP_S);
        set(&mut file, "realtime", "priority", 0);
        set(&mut file, "realtime", "lock-memory", false);
        set(&mut file, "status", "socket", "");
        set(&mut file, "log", "target", "stderr");
        set(&mut file, "log", "level", "debug");
        edit(&mut file);
        std::fs::write(files.config(), toml::to_string(&file).unwrap()).unwrap();
        files.write_model(MODEL_FILE);
        files
    }

    fn write_model(&self, text: &str) {
        std::fs::write(self.folder.path().join("model.toml"), text).unwrap();
    }

    /// The shipped model as if it were of another machine.
    pub(crate) fn write_model_of(&self, machine: &str) {
        let text = MODEL_FILE.replace("machine = \"vmc-850\"", &format!("machine = \"{machine}\""));
        assert_ne!(text, MODEL_FILE);
        self.write_model(&text);
    }

    pub(crate) fn path(&self) -> &Path {
        self.folder.path()
    }

    fn config(&self) -> PathBuf {
        self.folder.path().join("machine.toml")
    }

    fn log_path(&self) -> PathBuf {
        self.folder.path().join("volcompd.log")
    }

    /// What all daemons of this bench have said.
    pub(crate) fn log(&self) -> String {
        std::fs::read_to_string(self.log_path()).unwrap_or_default()
    }

    /// Waits until the daemons have said something so often.
    pub(crate) fn wait_for_log(&self, words: &str, times: usize) {
        let begin = Instant::now();
        while self.log().matches(words).count() < times {
            assert!(begin.elapsed() < PATIENCE, "no `{words}` in the log:\n{}", self.log());
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    /// Starts a daemon.
    pub(crate) fn daemon(&self) -> Daemon {
        programs().volcompd(&self.config(), &self.log_path()).unwrap()
    }
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

fn programs() -> Programs {
    Programs::at(CNCSIM)
}

/// Sends a signal to a process that this test has started.
pub(crate) fn signal(process: u32, signal: Signal) {
    let pid = Pid::from_raw(i32::try_from(process).unwrap()).unwrap();
    kill_process(pid, signal).unwrap();
}

pub(crate) fn ramping_out(r: &CycleRecord) -> bool {
    r.state.has(MachineState::OFFSET_RAMPING_OUT)
}

/// The largest offset of a cycle, mm.
pub(crate) fn largest(offset: &AxisArray) -> f64 {
    offset.iter().fold(0.0, |l, v| l.max(v.abs()))
}
