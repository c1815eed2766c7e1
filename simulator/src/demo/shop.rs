//! The workshop of the demo: one machine, its control, and the daemon beside it.

use std::path::Path;
use std::time::Duration;

use anyhow::{Context, bail};
use volcomp_protocol::CorrectionState;
use volcomp_units::axes::{AxisArray, AxisName};

use super::programs::{Daemon, Programs};
use crate::control::{Control, ControlConfig, CycleRecord, Flow, Interface, Observer, Pacing, RunSummary};
use crate::monitor::{Settings, SharedMonitor};
use crate::motion::gcode::interpret;
use crate::motion::{Dynamics, MachineAxes, MotionSource, Trajectory};
use crate::truth::TruthMachine;

/// How long the daemon may take to connect.
const CONNECT_LIMIT: Duration = Duration::from_secs(10);
/// How often it is looked after meanwhile.
const LOOK_AFTER: Duration = Duration::from_millis(100);
/// How long ramping in may take, s of control time.
const RAMP_LIMIT_S: f64 = 10.0;

/// A machine with its control.
pub struct Shop {
    machine: TruthMachine,
    axes: MachineAxes,
    control: Control,
    monitor: Option<SharedMonitor>,
    cycle_s: f64,
}

impl Shop {
    /// A machine that stands in the middle of its travel, its control listening on a free port of loopback.
    ///
    /// # Errors
    /// The control cannot listen.
    pub fn open(machine: TruthMachine, seed: u64, cycle_s: f64) -> anyhow::Result<Self> {
        Self::with_interface(machine, seed, cycle_s, Interface::Frames)
    }

    /// The same, with a control that daemons talk to in this way.
    ///
    /// # Errors
    /// The control cannot listen.
    pub fn with_interface(
        machine: TruthMachine,
        seed: u64,
        cycle_s: f64,
        interface: Interface,
    ) -> anyhow::Result<Self> {
        let config = ControlConfig {
            cycle_s,
            listen: ([127, 0, 0, 1], 0).into(),
            pacing: Pacing::lock_step(),
            interface,
            ..ControlConfig::new(machine.machine(), MachineAxes::of(&machine)?)
        };
        let middle = config.axes.middle();
        Self::with_control(machine, seed, config, &middle)
    }

    /// A machine that stands at `start` under a control of one's own choice; its axes are the machine's first ones.
    ///
    /// # Errors
    /// The control cannot be set up.
    pub fn with_control(
        mut machine: TruthMachine,
        seed: u64,
        config: ControlConfig,
        start: &AxisArray,
    ) -> anyhow::Result<Self> {
        machine.reset(seed, start);
        let (axes, cycle_s) = (config.axes.clone(), config.cycle_s);
        let mut control = Control::bind(config)?;
        control.set_position(*start);
        Ok(Self { machine, axes, control, monitor: None, cycle_s })
    }

    /// Address of the control.
    #[must_use]
    pub fn address(&self) -> String {
        self.control.address().to_string()
    }

    /// The machine.
    #[must_use]
    pub const fn machine(&self) -> &TruthMachine {
        &self.machine
    }

    /// The axes in wire order.
    #[must_use]
    pub const fn axes(&self) -> &MachineAxes {
        &self.axes
    }

    /// Control cycle, s.
    #[must_use]
    pub const fn cycle_s(&self) -> f64 {
        self.cycle_s
    }

    /// The control.
    pub const fn control(&mut self) -> &mut Control {
        &mut self.control
    }

    /// The control is gone without a word.
    pub fn vanish(self) {
        self.control.vanish();
    }

    /// Has every correction from now on checked against the limits of a daemon's machine file; a motion in which one
    /// breaks an invariant fails.
    ///
    /// # Errors
    /// The file holds no limits.
    pub fn monitor(&mut self, machine_file: &str) -> anyhow::Result<SharedMonitor> {
        let names: Vec<AxisName> = self.axes.as_slice().iter().map(|a| a.name).collect();
        let settings = Settings::from_machine_file(machine_file, &names)?;
        let monitor = SharedMonitor::new(Settings { cycle_s: self.cycle_s, ..settings });
        self.control.set_monitor(monitor.clone());
        self.monitor = Some(monitor.clone());
        Ok(monitor)
    }

    fn check_monitor(&self) -> anyhow::Result<()> {
        let report = self.monitor.as_ref().map(SharedMonitor::report).unwrap_or_default();
        if !report.is_clean() {
            bail!("the monitor found violations:\n{}", report.lines().join("\n"));
        }
        Ok(())
    }

    /// Starts a daemon and waits until it compensates; its corrections are monitored from its start on.
    ///
    /// # Errors
    /// It does not start, does not connect, or does not become active; the message is what the daemon said last, and where
    /// its log is.
    pub fn start_daemon(&mut self, programs: &Programs, config: &Path, log: &Path) -> anyhow::Result<Daemon> {
        self.monitor(&std::fs::read_to_string(config)?)?;
        // the log goes on from earlier runs
        let before = std::fs::read_to_string(log).unwrap_or_default().len();
        let said =
            || last_words(std::fs::read_to_string(log).unwrap_or_default().get(before..).unwrap_or_default());
        let mut daemon = programs.volcompd(config, log)?;
        let see = || format!("  its log: {}", log.display());
        let mut waited = Duration::ZERO;
        while let Err(e) = self.control.wait_for_daemon(LOOK_AFTER) {
            waited += LOOK_AFTER;
            if !daemon.is_running() {
                bail!("volcompd has ended: {}\n{}", said(), see());
            }
            if waited >= CONNECT_LIMIT {
                return Err(e).with_context(|| format!("volcompd does not connect: {}\n{}", said(), see()));
            }
        }
        let mut active = false;
        self.control.run_until(&mut self.machine, RAMP_LIMIT_S, &mut |r| {
            active = r.correction.is_some_and(|c| c.state == CorrectionState::Active);
            Ok(if active { Flow::Stop } else { Flow::GoOn })
        })?;
        if !active {
            bail!("volcompd is connected but does not compensate: {}\n{}", said(), see());
        }
        Ok(daemon)
    }

    /// Stands still for so long.
    ///
    /// # Errors
    /// The control's.
    pub fn dwell(&mut self, seconds: f64) -> anyhow::Result<()> {
        self.control.dwell(&mut self.machine, seconds)?;
        self.check_monitor()
    }

    /// Runs a part program and returns the cycles that count.
    ///
    /// # Errors
    /// The program is wrong, or the control's.
    pub fn program(&mut self, text: &str) -> anyhow::Result<Vec<CycleRecord>> {
        let motion = self.trajectory(text)?;
        self.motion(motion)
    }

    /// A part program from where the machine stands as positions in time, without running it.
    ///
    /// # Errors
    /// The program is wrong.
    pub fn trajectory(&self, text: &str) -> anyhow::Result<Trajectory> {
        let start = self.control.position();
        let program = interpret(text, &self.axes, start)?;
        Ok(Trajectory::new(start, &program.segments, &self.axes, &Dynamics::default(), self.cycle_s)?)
    }

    /// Goes to a position in rapid.
    ///
    /// # Errors
    /// The control's.
    pub fn go_to(&mut self, position: &AxisArray) -> anyhow::Result<()> {
        let from = self.control.position();
        let motion = Trajectory::rapid(from, *position, &self.axes, &Dynamics::default(), self.cycle_s)?;
        self.motion(motion)?;
        Ok(())
    }

    /// Runs any motion and returns the cycles that count.
    ///
    /// # Errors
    /// The control's.
    pub fn motion(&mut self, mut motion: impl MotionSource) -> anyhow::Result<Vec<CycleRecord>> {
        let mut cycles = Vec::new();
        self.control.run(&mut motion, &mut self.machine, &mut |r| {
            if r.scored {
                cycles.push(*r);
            }
            Ok(Flow::GoOn)
        })?;
        self.check_monitor()?;
        Ok(cycles)
    }

    /// Runs a motion until it ends or the observer, who sees every cycle, has seen enough.
    ///
    /// # Errors
    /// The control's.
    pub fn watch(
        &mut self,
        motion: &mut dyn MotionSource,
        observer: Observer<'_>,
    ) -> anyhow::Result<RunSummary> {
        let summary = self.control.run(motion, &mut self.machine, observer)?;
        self.check_monitor()?;
        Ok(summary)
    }

    /// Stands still until the observer has seen enough, at most so long.
    ///
    /// # Errors
    /// The control's.
    pub fn watch_standing(&mut self, limit_s: f64, observer: Observer<'_>) -> anyhow::Result<RunSummary> {
        let summary = self.control.run_until(&mut self.machine, limit_s, observer)?;
        self.check_monitor()?;
        Ok(summary)
    }

    /// The middle of every travel.
    #[must_use]
    pub fn middle(&self) -> AxisArray {
        self.axes.middle()
    }

    /// Lower and upper corner of the working volume.
    #[must_use]
    pub fn corners(&self) -> [[f64; 3]; 2] {
        let travel = |end: usize| [0, 1, 2].map(|k| self.machine.travel(k)[end]);
        [travel(0), travel(1)]
    }
}

/// What a daemon said last: its error with the hint, else why compensation stays off, else its last warning, else that it
/// said nothing.
fn last_words(log: &str) -> String {
    let mut lines: Vec<&str> = log.lines().map(str::trim_end).collect();
    if let Some(at) = lines.iter().rposition(|l| l.starts_with("error:")) {
        return lines.split_off(at).join("\n").trim_start_matches("error: ").to_owned();
    }
    let warnings = lines.iter().filter_map(|l| l.split_once(" WARN ").or_else(|| l.split_once(" ERROR ")));
    // the last of those that say why, else of all: a busy host adds warnings of late frames after it
    let said = warnings.max_by_key(|(_, said)| said.contains("stays off"));
    said.map_or("no error and no warning in its log", |(_, said)| said.trim()).to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_error_with_its_hint_comes_first() {
        let log = "error: an earlier run\n  hint: no\n2026 WARN no link code=VC-6001\nerror: m.toml: no model\n  hint: fit one\n";
        assert_eq!(last_words(log), "m.toml: no model\n  hint: fit one");
        assert_eq!(last_words("t  WARN refused: expired\nt  INFO on\n"), "refused: expired");
        let busy = "t  WARN compensation stays off: expired\nt  WARN corrections come late code=VC-6006\n";
        assert_eq!(last_words(busy), "compensation stays off: expired");
        assert!(last_words("").contains("no error"));
    }
}
