//! `cncsim serve` and `cncsim replay`: a machine, its control and its motion on the link.

use core::net::{IpAddr, SocketAddr};
use core::time::Duration;
use std::fs::File;
use std::io::{self, BufWriter};
use std::path::{Path, PathBuf};

use volcomp_protocol::Tool;
use volcomp_units::axes::{AxisArray, AxisName};

use super::sensors::{SensorArgs, Sensors};
use super::{EX_CONFIG, EX_DATAERR, EX_IOERR, EX_SOFTWARE, EX_USAGE, Failure, InputKind, read};
use crate::control::{
    Absent, Control, ControlConfig, ControlError, ControlIdentity, CycleRecord, Flow, Happening,
    IdentityError, Interface, Pacing, RunSummary, ScriptedEvent, TraceWriter,
};
use crate::monitor::{Figures, Settings, SharedMonitor};
use crate::motion::gcode::interpret;
use crate::motion::profile::checked_cycle_s;
use crate::motion::recorded::{self, Description, Interpolation, Replay};
use crate::motion::{Dynamics, MachineAxes, MotionSource, Trajectory};
use crate::through::server::{MeasuringPort, Pending};
use crate::through::{About, Selection};
use crate::truth::{GANTRY_5AX, GRINDER_AB, TruthMachine, VMC_850};

/// Standstill cycles of a control without a program, at a time, s.
const STANDSTILL_S: f64 = 3600.0;

#[derive(Debug, clap::Args)]
struct Common {
    /// The machine: a truth file, or one of the built-in vmc-850, gantry-5ax, grinder-ab.
    #[arg(long, value_name = "FILE|NAME", default_value = "vmc-850")]
    machine: PathBuf,
    /// Address to listen on; port 0 takes a free one. Elsewhere than on loopback it needs --peer.
    #[arg(long, value_name = "IP:PORT", default_value = "127.0.0.1:7878")]
    listen: SocketAddr,
    /// The one address that a daemon may connect from.
    #[arg(long, value_name = "IP")]
    peer: Option<IpAddr>,
    /// Mutual TLS: authorities (PEM) that issue the certificates of daemons. See cncsim dev certificates.
    #[arg(long, value_name = "FILE", requires_all = ["tls_certificate", "tls_key"])]
    tls_ca: Option<PathBuf>,
    /// Mutual TLS: the control's own certificate (PEM).
    #[arg(long, value_name = "FILE", requires = "tls_ca")]
    tls_certificate: Option<PathBuf>,
    /// Mutual TLS: the private key of that certificate (PEM).
    #[arg(long, value_name = "FILE", requires = "tls_ca")]
    tls_key: Option<PathBuf>,
    /// Control cycle in ms, 0.25 to 10.
    #[arg(long, value_name = "MS", default_value = "1")]
    cycle_ms: f64,
    /// Do not keep real time: each position waits for its answer. The same seed gives the same trace.
    #[arg(long)]
    as_fast_as_possible: bool,
    /// The control sends frames, or replies to calls that read positions and write offsets.
    #[arg(long, value_name = "frames|read-write", default_value = "frames", value_parser = ["frames", "read-write"])]
    interface: String,
    /// Seed of the machine's noise; default: the one of the machine file.
    #[arg(long)]
    seed: Option<u64>,
    /// Cycles from a position to the use of its correction.
    #[arg(long, value_name = "N", default_value = "1")]
    delay_cycles: u32,
    /// Hold time when corrections are missing, ms; then the control takes the offset back by itself.
    #[arg(long, value_name = "MS", default_value = "100")]
    hold_ms: f64,
    /// Receive and record corrections but do not apply them.
    #[arg(long)]
    no_apply: bool,
    /// Wait at most so many seconds for a daemon before anything moves.
    #[arg(long, value_name = "S")]
    wait_s: Option<f64>,
    /// Standstill before and after each run, s: time for the daemon to ramp in.
    #[arg(long, value_name = "S", default_value = "2")]
    settle_s: f64,
    /// Emergency stop at this time since the start, s.
    #[arg(long, value_name = "S")]
    estop_at_s: Option<f64>,
    /// The emergency stop is released after so many seconds.
    #[arg(long, value_name = "S", default_value = "1", requires = "estop_at_s")]
    estop_for_s: f64,
    /// Run again and again until interrupted.
    #[arg(long = "loop")]
    again: bool,
    /// Write every cycle to this CSV file.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Check every correction against the limits of this machine file (the daemon's); exit code 70 on a violation.
    #[arg(long, value_name = "FILE")]
    monitor: Option<PathBuf>,
    #[command(flatten)]
    sensors: SensorArgs,
}

#[derive(Debug, clap::Args)]
pub(super) struct ServeArgs {
    #[command(flatten)]
    common: Common,
    /// Part program (G-code); without one the machine stands still. After G43.4 X, Y and Z are those of the tool tip while
    /// rotary axes turn (tool-centre-point motion), until G49.
    #[arg(long, value_name = "FILE")]
    program: Option<PathBuf>,
    /// Take part programs from `cncsim measure .. --through IP:PORT` on this address of loopback and report where the tool
    /// went; port 0 takes a free one.
    #[arg(long, value_name = "IP:PORT", conflicts_with_all = ["program", "again"])]
    measure: Option<SocketAddr>,
}

#[derive(Debug, clap::Args)]
pub(super) struct ReplayArgs {
    #[command(flatten)]
    common: Common,
    /// Description of a recording; default: the shipped recording of a SINUMERIK 840D sl.
    #[arg(long, value_name = "FILE")]
    recording: Option<PathBuf>,
    /// Straight lines instead of cubics between the samples.
    #[arg(long)]
    linear: bool,
}

type Trace = Option<(PathBuf, TraceWriter<BufWriter<File>>)>;

/// Everything that runs.
struct Shop {
    control: Control,
    machine: TruthMachine,
    axes: MachineAxes,
    cycle_s: f64,
    seed: u64,
    trace: Trace,
    monitor: Option<SharedMonitor>,
    sensors: Option<Sensors>,
    /// The machine as the lasers on its carriages see it.
    seen: TruthMachine,
}

pub(super) fn serve(args: &ServeArgs) -> Result<(), Failure> {
    let common = &args.common;
    let (machine, axes) = machine(&common.machine)?;
    let start = axes.middle();
    let program = match &args.program {
        Some(path) => {
            let text = read(path, InputKind::PartProgram)?;
            // mistakes come out before anything listens
            interpret(&text, &axes, start).map_err(|e| Failure::in_file(EX_DATAERR, path, e))?;
            Some((path, text))
        }
        None => None,
    };
    let mut shop = Shop::open(common, machine, axes, start)?;
    if let Some(address) = args.measure {
        let about = About::of(&shop.machine, shop.cycle_s);
        let port = MeasuringPort::open(address, about)
            .map_err(|e| Failure::new(EX_IOERR, format_args!("--measure {address}: {e}")))?;
        note!("measuring port {}", port.address());
        shop.wait(common)?;
        return shop.measured(&port);
    }
    shop.wait(common)?;
    loop {
        match &program {
            None => {
                shop.stand(STANDSTILL_S)?;
                shop.check_monitor()?;
                continue;
            }
            Some((path, text)) => {
                let from = shop.control.position();
                let parsed =
                    interpret(text, &shop.axes, from).map_err(|e| Failure::in_file(EX_DATAERR, path, e))?;
                let mut motion =
                    Trajectory::new(from, &parsed.segments, &shop.axes, &Dynamics::default(), shop.cycle_s)
                        .map_err(|e| Failure::new(EX_USAGE, e))?;
                shop.run(common, &mut motion)?;
            }
        }
        if !common.again {
            return shop.close();
        }
    }
}

pub(super) fn replay(args: &ReplayArgs) -> Result<(), Failure> {
    let common = &args.common;
    let (machine, axes) = machine(&common.machine)?;
    let cycle_s = cycle(common)?;
    let interpolation = if args.linear { Interpolation::Linear } else { Interpolation::Cubic };
    let rest = axes.middle();
    let (name, description, data) = match &args.recording {
        None => {
            let description = Description::from_toml(recorded::SHIPPED_DESCRIPTION)
                .map_err(|e| Failure::new(super::EX_SOFTWARE, e))?;
            (PathBuf::from("shipped recording"), description, recorded::SHIPPED_DATA.to_owned())
        }
        Some(path) => {
            let description = Description::from_toml(&read(path, InputKind::Description)?)
                .map_err(|e| Failure::in_file(EX_CONFIG, path, e))?;
            let file = path.parent().unwrap_or(Path::new("")).join(&description.file);
            let data = read(&file, InputKind::Table)?;
            (file, description, data)
        }
    };
    let mut motion = Replay::new(&data, &description, &axes, rest, cycle_s, interpolation)
        .map_err(|e| Failure::in_file(EX_DATAERR, &name, e))?;
    let mut shop = Shop::open(common, machine, axes, motion.start())?;
    shop.wait(common)?;
    loop {
        shop.run(common, &mut motion)?;
        if !common.again {
            return shop.close();
        }
        let (from, to) = (shop.control.position(), motion.start());
        let mut back = Trajectory::rapid(from, to, &shop.axes, &Dynamics::default(), cycle_s)
            .map_err(|e| Failure::new(EX_USAGE, e))?;
        shop.move_along(&mut back)?;
        motion.rewind();
    }
}

/// Who may connect: on a network exactly one address.
fn peer(common: &Common) -> Result<Option<IpAddr>, Failure> {
    if common.listen.ip().to_canonical().is_loopback() {
        return Ok(common.peer);
    }
    if common.peer.is_none() {
        let message = format_args!(
            "--listen {} can be reached from other computers; name the one that may connect with --peer",
            common.listen
        );
        return Err(Failure::new(EX_USAGE, message));
    }
    if common.tls_ca.is_none() {
        note!(
            "warning: the link on {} has neither authentication nor encryption; see cncsim dev certificates",
            common.listen
        );
    }
    Ok(common.peer)
}

fn identity(common: &Common) -> Result<Option<ControlIdentity>, Failure> {
    let (Some(ca), Some(certificate), Some(key)) = (&common.tls_ca, &common.tls_certificate, &common.tls_key)
    else {
        return Ok(None);
    };
    let code = |e: &IdentityError| if matches!(e, IdentityError::Read { .. }) { EX_IOERR } else { EX_CONFIG };
    ControlIdentity::from_files(ca, certificate, key).map(Some).map_err(|e| Failure::new(code(&e), e))
}

fn cycle(common: &Common) -> Result<f64, Failure> {
    checked_cycle_s(common.cycle_ms * 1e-3).map_err(|e| Failure::new(EX_USAGE, e))
}

/// Machines by name.
const BUILT_IN: [(&str, &str); 3] =
    [("vmc-850", VMC_850), ("gantry-5ax", GANTRY_5AX), ("grinder-ab", GRINDER_AB)];

/// Neither a file nor a name.
fn unknown_machine(path: &Path) -> Failure {
    let names = BUILT_IN.map(|(name, _)| name);
    let hint = volcomp_cli::suggestion(&path.to_string_lossy(), &names, "");
    let hint = if hint.starts_with("did") { format!("; {hint}") } else { String::new() };
    let what = format_args!("neither a file nor one of the built-in {}{hint}", names.join(", "));
    Failure::in_file(EX_IOERR, path, what)
}

/// A machine by name or by its truth file.
pub(super) fn built_in_or_file(path: &Path) -> Result<TruthMachine, Failure> {
    let built_in = BUILT_IN.iter().find(|(name, _)| path.as_os_str() == *name);
    let text = match built_in {
        Some((_, text)) => (*text).to_owned(),
        None if !path.exists() => return Err(unknown_machine(path)),
        None => read(path, InputKind::Description)?,
    };
    TruthMachine::from_toml(&text).map_err(|e| Failure::in_file(EX_CONFIG, path, e))
}

fn machine(path: &Path) -> Result<(TruthMachine, MachineAxes), Failure> {
    let machine = built_in_or_file(path)?;
    let axes = MachineAxes::of(&machine).map_err(|e| Failure::in_file(EX_CONFIG, path, e))?;
    Ok((machine, axes))
}

fn seconds(what: &str, value: f64) -> Result<f64, Failure> {
    if (0.0..=1e6).contains(&value) {
        Ok(value)
    } else {
        Err(Failure::new(EX_USAGE, format_args!("{what} {value}; give 0 to 1000000")))
    }
}

impl Shop {
    #[expect(clippy::disallowed_methods, reason = "the trace is written while the control runs")]
    fn open(
        common: &Common,
        mut machine: TruthMachine,
        axes: MachineAxes,
        start: AxisArray,
    ) -> Result<Self, Failure> {
        let cycle_s = cycle(common)?;
        let mut config = ControlConfig::new(machine.machine(), axes.clone());
        config.cycle_s = cycle_s;
        config.listen = common.listen;
        config.peer = peer(common)?;
        config.identity = identity(common)?;
        config.offset.delay_cycles = common.delay_cycles;
        config.offset.hold_s = seconds("--hold-ms", common.hold_ms)? * 1e-3;
        config.apply = !common.no_apply;
        if common.interface == "read-write" {
            config.interface = Interface::Calls { hold_ms: (config.offset.hold_s * 1e3).round() as u32 };
        }
        config.tool = Some(Tool { number: 1, tip: machine.tool_tip_mm() });
        config.script = script(common, cycle_s)?;
        if common.as_fast_as_possible {
            let absent = match common.wait_s {
                Some(s) => Absent::Wait(Duration::from_secs_f64(seconds("--wait-s", s)?)),
                None => Absent::GoOn,
            };
            config.pacing = Pacing::LockStep { answer_timeout: Duration::from_millis(200), absent };
        }
        seconds("--settle-s", common.settle_s)?;
        let trace = match &common.out {
            None => None,
            Some(path) => {
                let failed = |e: io::Error| Failure::in_file(EX_IOERR, path, e);
                let file = File::create(path).map_err(failed)?;
                let writer =
                    TraceWriter::new(BufWriter::new(file), &axes).map_err(|e| failed(io::Error::other(e)))?;
                Some((path.clone(), writer))
            }
        };
        let monitor = common.monitor.as_deref().map(|path| open_monitor(path, &axes, cycle_s)).transpose()?;
        let mut control = Control::bind(config).map_err(|e| failure(&e))?;
        if let Some(monitor) = &monitor {
            control.set_monitor(monitor.clone());
        }
        control.set_listener(|event| note!("{event}"));
        control.set_position(start);
        let seed = common.seed.unwrap_or_else(|| machine.seed());
        machine.reset(seed, &start);
        common.sensors.disturb(&mut machine, seed);
        let sensors = common.sensors.open(&machine, seed)?;
        note!("listening on {}", control.address());
        let seen = machine.clone();
        Ok(Self { control, machine, axes, cycle_s, seed, trace, monitor, sensors, seen })
    }

    fn wait(&mut self, common: &Common) -> Result<(), Failure> {
        let Some(wait_s) = common.wait_s else { return Ok(()) };
        let limit = Duration::from_secs_f64(seconds("--wait-s", wait_s)?);
        self.control.wait_for_daemon(limit).map_err(|e| failure(&e))
    }

    /// Standstill, the motion, standstill; tells what it was like.
    fn run(&mut self, common: &Common, motion: &mut dyn MotionSource) -> Result<(), Failure> {
        self.stand(common.settle_s)?;
        let summary = self.move_along(motion)?;
        self.stand(common.settle_s)?;
        note!("{}", describe(&summary, self.seed, &self.axes));
        self.check_monitor()
    }

    /// Fails where a correction has broken an invariant.
    fn check_monitor(&self) -> Result<(), Failure> {
        let Some(monitor) = &self.monitor else { return Ok(()) };
        let report = monitor.report();
        let Figures { answers, unanswered, .. } = report.figures;
        note!(
            "monitor: {answers} corrections, {unanswered} positions unanswered, {} violations",
            report.total
        );
        if report.is_clean() {
            return Ok(());
        }
        Err(Failure::new(
            EX_SOFTWARE,
            format_args!("the monitor found violations:\n{}", report.lines().join("\n")),
        ))
    }

    fn move_along(&mut self, motion: &mut dyn MotionSource) -> Result<RunSummary, Failure> {
        let Self { trace, sensors, seen, .. } = self;
        let mut observer = |r: &CycleRecord| observe(trace, sensors, seen, r);
        self.control.run(motion, &mut self.machine, &mut observer).map_err(|e| failure(&e))
    }

    fn stand(&mut self, time_s: f64) -> Result<(), Failure> {
        let Self { trace, sensors, seen, .. } = self;
        let mut observer = |r: &CycleRecord| observe(trace, sensors, seen, r);
        self.control.run_until(&mut self.machine, time_s, &mut observer).map(drop).map_err(|e| failure(&e))
    }

    /// Stands still and runs what is sent to the measuring port.
    fn measured(mut self, port: &MeasuringPort) -> Result<(), Failure> {
        loop {
            let mut pending = None;
            let Self { control, machine, trace, sensors, seen, .. } = &mut self;
            let mut observer = |r: &CycleRecord| {
                pending = port.request();
                let flow = observe(trace, sensors, seen, r)?;
                Ok(if pending.is_some() { Flow::Stop } else { flow })
            };
            control.run_until(machine, STANDSTILL_S, &mut observer).map_err(|e| failure(&e))?;
            self.check_monitor()?;
            if let Some(pending) = pending {
                self.measure(pending)?;
            }
        }
    }

    /// Runs one part program and answers where the tool went.
    fn measure(&mut self, pending: Pending) -> Result<(), Failure> {
        let from = self.control.position();
        let parsed = match interpret(&pending.request.program, &self.axes, from) {
            Ok(parsed) => parsed,
            Err(e) => {
                pending.refuse(e);
                return Ok(());
            }
        };
        let dynamics = Dynamics::default();
        let mut motion = match Trajectory::new(from, &parsed.segments, &self.axes, &dynamics, self.cycle_s) {
            Ok(motion) => motion,
            Err(e) => {
                pending.refuse(e);
                return Ok(());
            }
        };
        let mut selection = Selection::new(pending.request.want);
        let truth = self.machine.clone();
        let Self { trace, sensors, seen, .. } = self;
        let mut observer = |r: &CycleRecord| {
            selection.see(&truth, r);
            observe(trace, sensors, seen, r)
        };
        let summary =
            self.control.run(&mut motion, &mut self.machine, &mut observer).map_err(|e| failure(&e))?;
        note!("{}", describe(&summary, self.seed, &self.axes));
        pending.answer(selection.finish(&truth));
        Ok(())
    }

    fn close(mut self) -> Result<(), Failure> {
        self.control.close();
        match self.trace {
            Some((path, writer)) => writer.finish().map_err(|e| Failure::in_file(EX_IOERR, &path, e)),
            None => Ok(()),
        }
    }
}

fn observe(
    trace: &mut Trace,
    sensors: &mut Option<Sensors>,
    seen: &mut TruthMachine,
    record: &CycleRecord,
) -> io::Result<Flow> {
    if let Some(sensors) = sensors {
        seen.set_time_s(record.time_s);
        sensors.look(record, seen);
    }
    if let Some((path, writer)) = trace {
        writer.write(record).map_err(|e| io::Error::other(format!("{}: {e}", path.display())))?;
    }
    Ok(Flow::GoOn)
}

/// A monitor with the limits of a machine file.
fn open_monitor(path: &Path, axes: &MachineAxes, cycle_s: f64) -> Result<SharedMonitor, Failure> {
    let names: Vec<AxisName> = axes.as_slice().iter().map(|a| a.name).collect();
    let settings = Settings::from_machine_file(&read(path, InputKind::Machine)?, &names)
        .map_err(|e| Failure::in_file(EX_DATAERR, path, e))?;
    Ok(SharedMonitor::new(Settings { cycle_s, ..settings }))
}

fn script(common: &Common, cycle_s: f64) -> Result<Vec<ScriptedEvent>, Failure> {
    let Some(at_s) = common.estop_at_s else { return Ok(Vec::new()) };
    let at = seconds("--estop-at-s", at_s)?;
    let until = at + seconds("--estop-for-s", common.estop_for_s)?;
    let cycle = |s: f64| (s / cycle_s).round() as u64;
    Ok(vec![
        ScriptedEvent { cycle: cycle(at), what: Happening::ESTOP },
        ScriptedEvent { cycle: cycle(until), what: Happening::ESTOP_RELEASED },
    ])
}

fn failure(error: &ControlError) -> Failure {
    let code = match error {
        ControlError::Config(_) => EX_USAGE,
        ControlError::InUse { .. }
        | ControlError::Listen { .. }
        | ControlError::NoDaemon { .. }
        | ControlError::Observer(_) => EX_IOERR,
        ControlError::Start { .. } => EX_DATAERR,
    };
    Failure::new(code, error)
}

fn describe(s: &RunSummary, seed: u64, axes: &MachineAxes) -> String {
    let largest: Vec<String> = axes
        .as_slice()
        .iter()
        .zip(&s.largest_offset)
        .map(|(axis, offset)| match axis.name.kind() {
            volcomp_units::axes::AxisKind::Linear => format!("{} {:.2} um", axis.name, offset * 1e3),
            volcomp_units::axes::AxisKind::Rotary => format!("{} {:.3} arcsec", axis.name, offset * 3600.0),
        })
        .collect();
    format!(
        "run of {:.3} s, {} cycles, seed {seed}: {} corrections used, {} refused, {} positions unanswered, \
         {} cycles late, {} limited, {} ramping out; largest offset {}",
        s.duration_s,
        s.cycles,
        s.corrections,
        s.rejected,
        s.unanswered,
        s.late,
        s.limited,
        s.ramping_out,
        largest.join(", ")
    )
}
