//! The machine file, `volcomp-machine/1`.

use core::net::SocketAddr;
use std::path::PathBuf;

use super::diagnostic::ConfigErrors;
use crate::core::axes::AxisName;
use crate::core::engine::{AxisLimits, EngineConfig, EngineError, OutOfTravel, PositionSource, RestOffset};
use crate::core::protocol::ControlHello;

/// A validated machine file.
#[derive(Debug, Clone, PartialEq)]
pub struct MachineConfig {
    /// Machine id; must equal that of the model and of the control.
    pub machine: String,
    /// The model file, as written (relative to the machine file).
    pub model: PathBuf,
    /// The link to the control.
    pub link: LinkConfig,
    /// Engine settings that do not depend on the axis order of the control.
    pub engine: EngineSettings,
    /// One entry per axis to be corrected.
    pub axes: Vec<AxisConfig>,
    /// Real-time settings of the cycle thread.
    pub realtime: RealtimeConfig,
    /// The status and command socket.
    pub status: StatusConfig,
    /// Logging.
    pub log: LogConfig,
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

/// Engine settings; see [`EngineConfig`] for the meaning of each.
#[derive(Debug, Clone, PartialEq)]
#[expect(missing_docs, reason = "each field is described at EngineConfig")]
pub struct EngineSettings {
    pub start: StartMode,
    pub ramp_s: f64,
    pub stale_s: f64,
    pub hold_s: f64,
    pub gain: f64,
    pub position_source: PositionSource,
    pub out_of_travel: OutOfTravel,
    pub rest: RestOffset,
    pub read_back_cycles: u32,
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
    /// Poll the socket this long before blocking, s.
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

impl MachineConfig {
    /// Reads a machine file.
    ///
    /// # Errors
    /// Every mistake found, each with its place.
    pub fn parse(file: &str, text: &str) -> Result<Self, ConfigErrors> {
        Err(ConfigErrors { file: file.to_owned(), source: text.to_owned(), diagnostics: Vec::new() })
    }

    /// The engine's configuration for a control that announced itself with `hello`: settings in its wire order.
    ///
    /// # Errors
    /// The control has another machine id, lacks an axis, has one in another unit, or another cycle time.
    pub fn engine_config(&self, _hello: &ControlHello) -> Result<EngineConfig, EngineError> {
        Err(EngineError::TooManyAxes { found: 0 })
    }
}
