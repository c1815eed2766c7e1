//! The machine file, `volcomp-machine/1`, and whether a control and a model belong to it.

mod gateway;
mod http;
mod read;
mod sensors;
mod tls;

pub use gateway::{MqttConfig, MtconnectConfig};
pub use http::HttpConfig;
pub use read::known_keys;
pub use sensors::SensorsConfig;
pub use tls::TlsConfig;

use crate::prelude::*;
use core::fmt;

use volcomp_engine::{AxisLimits, EngineConfig};
use volcomp_protocol::{Axis, AxisUnit, ControlHello};
use volcomp_units::NS_PER_S;
use volcomp_units::axes::MAX_AXES;

/// The `format` of a machine file.
pub const FORMAT: &str = "volcomp-machine/1";

/// A validated machine file.
#[derive(Debug, Clone, PartialEq)]
pub struct MachineConfig {
    /// Machine id; must equal that of the model and of the control.
    pub machine: String,
    /// The model file, as written (relative to the machine file).
    pub model: PathBuf,
    /// Additions of a diagnosis that become part of the model, as written (relative to the machine file).
    pub additions: Vec<PathBuf>,
    /// The link to the control.
    pub link: LinkConfig,
    /// When compensation starts.
    pub start: StartMode,
    /// The engine without its axes: their settings are in `axes`, their order is that of the control.
    pub engine: EngineConfig,
    /// One entry per axis to be corrected.
    pub axes: Vec<AxisConfig>,
    /// Real-time settings of the cycle thread.
    pub realtime: RealtimeConfig,
    /// The status and command socket.
    pub status: StatusConfig,
    /// Logging.
    pub log: LogConfig,
    /// Recording of every cycle.
    pub recording: RecordingConfig,
    /// What outlives the daemon: counters, audit log, models in use.
    pub state: StateConfig,
    /// What a model must be before it is used.
    pub guard: GuardConfig,
    /// Sensors and the maps that they feed.
    pub sensors: SensorsConfig,
    /// The page and the metrics.
    pub http: HttpConfig,
    /// Publishing by MQTT (`volcomp gateway`).
    pub mqtt: Option<MqttConfig>,
    /// The MTConnect adapter (`volcomp gateway`).
    pub mtconnect: MtconnectConfig,
}

/// The link to the control.
#[derive(Debug, Clone, PartialEq)]
pub struct LinkConfig {
    /// Address of the control.
    pub address: SocketAddr,
    /// Expected interval between position frames, s; the control must announce the same.
    pub cycle_s: f64,
    /// Time allowed to connect and to answer the hello, s.
    pub connect_timeout_s: f64,
    /// First and longest pause between attempts to connect, s (doubles in between).
    pub reconnect_s: [f64; 2],
    /// Pause after which the daemon sends a heartbeat of its own, s.
    pub heartbeat_s: f64,
    /// Silence after which the link is given up, s.
    pub silence_s: f64,
    /// Mutual TLS; `None` is plain TCP.
    pub tls: Option<TlsConfig>,
    /// A control on another computer may be talked to without TLS.
    pub plain_remote: bool,
    /// How the control is talked to.
    pub interface: Interface,
}

/// How the control is talked to.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Interface {
    /// The control sends a frame each cycle and takes the answer (`docs/protocol.md`).
    #[default]
    Frames,
    /// Positions are read and offsets written by separate calls (`docs/reference/read-write.md`).
    ReadWrite {
        /// Interval between reads, s; 0 reads again as soon as the last reply has been dealt with.
        poll_s: f64,
    },
}

impl LinkConfig {
    /// True where frames leave this computer without authentication and encryption.
    #[must_use]
    pub fn is_exposed(&self) -> bool {
        self.tls.is_none() && self.is_remote()
    }

    /// True where the control is on another computer.
    #[must_use]
    pub fn is_remote(&self) -> bool {
        !is_this_computer(self.address.ip())
    }
}

/// True for an address that only this computer reaches.
#[must_use]
pub const fn is_this_computer(ip: IpAddr) -> bool {
    ip.to_canonical().is_loopback()
}

/// When compensation starts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum StartMode {
    /// Only on `volcomp enable` (the default).
    #[default]
    OnCommand,
    /// As soon as the control is connected and the machine ready.
    OnConnect,
}

impl StartMode {
    /// Its word in the machine file.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::OnCommand => "on-command",
            Self::OnConnect => "on-connect",
        }
    }
}

/// One axis. Linear: mm; rotary: rad.
#[derive(Debug, Clone, PartialEq)]
pub struct AxisConfig {
    /// Its letter.
    pub name: AxisName,
    /// Limits of its offset.
    pub limits: AxisLimits,
    /// Largest plausible change of position per cycle.
    pub jump_limit: f64,
    /// Travel after which a reversal counts.
    pub reversal_deadband: f64,
    /// Tolerated difference between offset sent and read back.
    pub read_back_tolerance: f64,
    /// Soft limits of the machine; infinite where none are given.
    pub soft_limits: [f64; 2],
}

/// Real-time settings of the cycle thread.
#[derive(Debug, Clone, PartialEq)]
pub struct RealtimeConfig {
    /// SCHED_FIFO priority 1 to 99; `None` leaves the scheduling class alone.
    pub priority: Option<u8>,
    /// Processor to run on.
    pub cpu: Option<u16>,
    /// Lock all memory.
    pub lock_memory: bool,
    /// Poll the socket from this long before to this long after a frame is expected, s.
    pub busy_poll_s: f64,
}

/// The status and command socket.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StatusConfig {
    /// Path of the Unix socket; `None` switches it off.
    pub socket: Option<PathBuf>,
}

/// Where log lines go.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum LogTarget {
    /// journald where stderr is connected to it, else stderr.
    #[default]
    Auto,
    /// journald.
    Journald,
    /// Standard error.
    Stderr,
}

/// Logging.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LogConfig {
    /// Where to.
    pub target: LogTarget,
    /// A filter such as `info` or `volcomp=debug`.
    pub level: String,
}

/// What happens when recordings have reached their total size.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum WhenFull {
    /// Nothing more is recorded until somebody makes room.
    #[default]
    Stop,
    /// The oldest recordings are deleted.
    DeleteOldest,
}

/// Recording of every cycle.
#[derive(Debug, Clone, PartialEq)]
pub struct RecordingConfig {
    /// Where recordings are written, as written (relative to the machine file); `None` records nothing.
    pub directory: Option<PathBuf>,
    /// Size at which a new file is begun, bytes.
    pub file_bytes: u64,
    /// Age at which a new file is begun, s.
    pub file_s: f64,
    /// Size of all recordings in the directory together, bytes.
    pub total_bytes: u64,
    /// What happens when that is reached.
    pub when_full: WhenFull,
    /// Interval at which blocks go to the disk, s.
    pub flush_s: f64,
}

/// What outlives the daemon.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StateConfig {
    /// Where it is kept, as written (relative to the machine file); `None` is the state directory that systemd gives
    /// the service, and nowhere without one.
    pub directory: Option<PathBuf>,
}

/// What happens where a model should not be used any more, or not now.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Policy {
    /// It is said, and nothing else.
    Warn,
    /// Compensation is not enabled; one that is on goes on.
    #[default]
    Refuse,
    /// Compensation is not enabled; one that is on is ramped out.
    RampOut,
}

/// What a model must be before it is used.
#[derive(Debug, Clone, PartialEq)]
pub struct GuardConfig {
    /// Change of the tip anywhere in the working volume that needs no confirmation, mm.
    pub change_limit: f64,
    /// Change of the tool's direction that needs no confirmation, rad.
    pub change_limit_angle: f64,
    /// BLAKE3 of the only model file that may be used, in hex.
    pub hash: Option<String>,
    /// After the expiry that the model states.
    pub expired: Policy,
    /// Temperatures of the machine for which the model holds, degrees Celsius; `None` does not ask.
    pub temperature_degc: Option<[f64; 2]>,
    /// Age at which a stated temperature counts as unknown, s.
    pub temperature_max_age_s: f64,
    /// Outside these temperatures, or where none is known.
    pub outside_temperature: Policy,
}

/// Why a control and a machine file do not belong together.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum HelloMismatch {
    /// The control is another machine.
    #[error(
        "the control is machine \"{found}\", the machine file is for \"{expected}\": connect to the right control or correct `machine` in the machine file"
    )]
    Machine {
        /// Id in the machine file.
        expected: String,
        /// Id announced.
        found: String,
    },
    /// The control lacks an axis that is to be corrected.
    #[error("the control has no axis {axis}; it has {found}: take [axes.{}] out or correct the control's axis names", axis.lower())]
    AxisMissing {
        /// The axis.
        axis: AxisName,
        /// The axes announced.
        found: AxisList,
    },
    /// The control gives an axis in a unit that does not suit it.
    #[error("the control gives axis {axis} in {}, but it is {}", unit_name(*found), kind_name(*axis))]
    AxisUnit {
        /// The axis.
        axis: AxisName,
        /// Unit announced.
        found: AxisUnit,
    },
    /// The control announces an axis twice.
    #[error("the control announces axis {axis} twice")]
    AxisTwice {
        /// The axis.
        axis: AxisName,
    },
    /// The control announces no axis or more than the link carries.
    #[error("the control announces {found} axes; 1 to {limit} are possible", limit = MAX_AXES)]
    AxisCount {
        /// Number announced.
        found: usize,
    },
    /// The control has another cycle time.
    #[error(
        "the control's cycle is {found_ms} ms, the machine file says cycle-ms = {expected_ms}: correct [link] cycle-ms"
    )]
    Cycle {
        /// In the machine file, ms.
        expected_ms: f64,
        /// Announced, ms.
        found_ms: f64,
    },
}

/// Axis letters for a message.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AxisList(pub Vec<AxisName>);

impl fmt::Display for AxisList {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names: Vec<String> = self.0.iter().map(AxisName::to_string).collect();
        f.write_str(&names.join(" "))
    }
}

/// Why a model and a machine file do not belong together.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ModelMismatch {
    /// The model is of another machine.
    #[error("the model is of machine \"{found}\", the machine file is for \"{expected}\"")]
    Machine {
        /// Id in the machine file.
        expected: String,
        /// Id in the model.
        found: String,
    },
    /// An axis with limits that the chain of the model does not have.
    #[error("axis {axis} has limits but is not in the model's chain {chain}")]
    AxisNotInChain {
        /// The axis.
        axis: AxisName,
        /// The chain.
        chain: Chain,
    },
    /// The spindle cannot be offset.
    #[error("axis {axis} is the spindle; it is never offset")]
    Spindle {
        /// The axis.
        axis: AxisName,
    },
}

impl ModelMismatch {
    /// The key of the machine file that is concerned.
    #[must_use]
    pub fn key(&self) -> Vec<String> {
        match self {
            Self::Machine { .. } => vec!["machine".to_owned()],
            Self::AxisNotInChain { axis, .. } | Self::Spindle { axis } => {
                vec!["axes".to_owned(), axis.lower().to_string()]
            }
        }
    }

    /// What to do about it.
    #[must_use]
    pub fn remedy(&self) -> String {
        match self {
            Self::Machine { .. } => {
                "name the model of this machine behind model =, or correct the id".to_owned()
            }
            Self::AxisNotInChain { axis, .. } | Self::Spindle { axis } => {
                format!("take [axes.{}] out, or correct the chain of the model", axis.lower())
            }
        }
    }
}

const fn unit_name(unit: AxisUnit) -> &'static str {
    match unit {
        AxisUnit::Millimetre => "mm",
        AxisUnit::Degree => "deg",
    }
}

const fn kind_name(axis: AxisName) -> &'static str {
    match axis.kind() {
        AxisKind::Linear => "linear and needs mm",
        AxisKind::Rotary => "rotary and needs deg",
    }
}

/// Limits of an axis that the machine file does not list: a size of zero, so it is never offset.
const NEVER_OFFSET: AxisLimits = AxisLimits {
    warning: 0.0,
    size: 0.0,
    stop: f64::INFINITY,
    rate: 1.0,
    acceleration: 1.0,
    step: f64::INFINITY,
};

/// Soft limits of an axis that has none.
const NO_SOFT_LIMITS: [f64; 2] = [f64::NEG_INFINITY, f64::INFINITY];

/// Share by which the control's cycle time may differ from the configured one (a rounded decimal such as 0.333 ms).
const CYCLE_TOLERANCE: f64 = 2e-3;

impl MachineConfig {
    /// Reads a machine file.
    ///
    /// # Errors
    /// Every mistake found, each with its place.
    pub fn parse(file: &str, text: &str) -> Result<Self, ConfigErrors> {
        crate::reader::read_file(file, text, |top, _| read::read(top))
    }

    /// The engine's configuration for a control that announced itself with `hello`: settings in its wire order.
    ///
    /// An axis of the control that this file does not list gets limits of size zero: it is never offset, and no
    /// jump or read-back of it is judged.
    ///
    /// # Errors
    /// The control has another machine id, lacks an axis, has one in another unit, or another cycle time.
    pub fn engine_config(&self, hello: &ControlHello) -> Result<EngineConfig, HelloMismatch> {
        let axes = self.check_hello(hello)?;
        let listed: Vec<Option<&AxisConfig>> =
            axes.iter().map(|name| self.axes.iter().find(|a| a.name == *name)).collect();
        let each = |pick: fn(&AxisConfig) -> f64, other: f64| -> Vec<f64> {
            listed.iter().map(|axis| axis.map_or(other, pick)).collect()
        };
        Ok(EngineConfig {
            limits: listed.iter().map(|axis| axis.map_or(NEVER_OFFSET, |a| a.limits)).collect(),
            jump_limit: each(|a| a.jump_limit, f64::MAX),
            reversal_deadband: each(|a| a.reversal_deadband, 0.0),
            read_back_tolerance: each(|a| a.read_back_tolerance, f64::MAX),
            soft_limits: listed.iter().map(|axis| axis.map_or(NO_SOFT_LIMITS, |a| a.soft_limits)).collect(),
            axes,
            ..self.engine.clone()
        })
    }

    /// The control's axes, where it is the machine of this file.
    fn check_hello(&self, hello: &ControlHello) -> Result<Vec<AxisName>, HelloMismatch> {
        let found = hello.machine.as_str();
        if found != self.machine {
            return Err(HelloMismatch::Machine { expected: self.machine.clone(), found: found.to_owned() });
        }
        let count = usize::from(hello.axis_count);
        if count == 0 || count > MAX_AXES {
            return Err(HelloMismatch::AxisCount { found: count });
        }
        let mut names = Vec::with_capacity(count);
        for axis in &hello.axes[..count] {
            if names.contains(&axis.name) {
                return Err(HelloMismatch::AxisTwice { axis: axis.name });
            }
            if *axis != Axis::new(axis.name) {
                return Err(HelloMismatch::AxisUnit { axis: axis.name, found: axis.unit });
            }
            names.push(axis.name);
        }
        if let Some(missing) = self.axes.iter().find(|a| !names.contains(&a.name)) {
            return Err(HelloMismatch::AxisMissing { axis: missing.name, found: AxisList(names) });
        }
        let found_s = hello.cycle_ns as f64 / NS_PER_S;
        if (found_s - self.link.cycle_s).abs() > CYCLE_TOLERANCE * self.link.cycle_s {
            let ms = |s: f64| (s * 1e9).round() / 1e6;
            return Err(HelloMismatch::Cycle { expected_ms: ms(self.link.cycle_s), found_ms: ms(found_s) });
        }
        Ok(names)
    }

    /// Everything by which a model does not belong to this machine file.
    #[must_use]
    pub fn check_model(&self, model: &ModelSpec) -> Vec<ModelMismatch> {
        let mut found = Vec::new();
        if model.machine != self.machine {
            found.push(ModelMismatch::Machine {
                expected: self.machine.clone(),
                found: model.machine.clone(),
            });
        }
        for axis in self.axes.iter().map(|a| a.name) {
            match model.chain.axes().iter().find(|a| a.name == axis) {
                None => found.push(ModelMismatch::AxisNotInChain { axis, chain: model.chain.clone() }),
                Some(a) if a.spindle => found.push(ModelMismatch::Spindle { axis }),
                Some(_) => {}
            }
        }
        found
    }

    /// Axes of the model's chain that this file does not list: they are never offset.
    #[must_use]
    pub fn uncorrected_axes(&self, model: &ModelSpec) -> Vec<AxisName> {
        let chain = model.chain.axes().iter().filter(|a| !a.spindle).map(|a| a.name);
        chain.filter(|name| !self.axes.iter().any(|a| a.name == *name)).collect()
    }
}

#[cfg(test)]
mod tests;
