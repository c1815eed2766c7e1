//! What a simulated control must be told.

use core::net::{IpAddr, Ipv4Addr, SocketAddr};
use core::time::Duration;

use volcomp_protocol::{Axis, ControlHello, DEFAULT_PORT, MachineState, Name, PROTOCOL_VERSION, Tool};
use volcomp_units::axes::AxisKind;

use super::wire::ControlIdentity;
use crate::motion::MachineAxes;
use crate::motion::profile::{ProfileError, checked_cycle_s};

/// What to do in lock step while no daemon is connected.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Absent {
    /// Simulated time goes on.
    #[default]
    GoOn,
    /// Simulated time stands still until one connects, at most this long.
    Wait(Duration),
}

/// How cycles follow each other.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pacing {
    /// At the cycle time, by absolute deadlines; corrections are taken when they are there.
    RealTime,
    /// As fast as possible: every position waits for its answer, so that runs are the same every time.
    LockStep {
        /// Longest wait for one answer.
        answer_timeout: Duration,
        /// What to do while there is no daemon.
        absent: Absent,
    },
}

impl Pacing {
    /// Lock step with the usual 200 ms for an answer.
    #[must_use]
    pub const fn lock_step() -> Self {
        Self::LockStep { answer_timeout: Duration::from_millis(200), absent: Absent::GoOn }
    }
}

/// How a daemon talks to the control.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Interface {
    /// Frames, one position a cycle (`docs/protocol.md`).
    #[default]
    Frames,
    /// Calls that read positions and write offsets (`docs/reference/read-write.md`).
    Calls {
        /// What the control says of its watchdog: time without a write after which it takes the offset out, ms.
        hold_ms: u32,
    },
}

impl Interface {
    /// Calls, with the usual watchdog of 100 ms.
    pub const CALLS: Self = Self::Calls { hold_ms: 100 };
}

/// Limits of the offset of one axis: mm or deg, per s, per s^2.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OffsetLimits {
    /// Largest offset.
    pub size: f64,
    /// Largest rate of change.
    pub rate: f64,
    /// Largest change of that rate.
    pub acceleration: f64,
}

/// The control's own check of offsets, independent of the daemon.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OffsetConfig {
    /// Limits of linear axes while a daemon corrects.
    pub linear: OffsetLimits,
    /// Limits of rotary axes while a daemon corrects.
    pub rotary: OffsetLimits,
    /// Rate and acceleration at which the control takes an offset back by itself, linear axes.
    pub ramp_linear: OffsetLimits,
    /// The same for rotary axes.
    pub ramp_rotary: OffsetLimits,
    /// How long the last offset is held when corrections are missing, s.
    pub hold_s: f64,
    /// Cycles from a position to the use of its correction, at least 1.
    pub delay_cycles: u32,
    /// Room beyond the travel for commanded position plus offset, mm or deg.
    pub overtravel: [f64; 2],
}

impl Default for OffsetConfig {
    fn default() -> Self {
        Self {
            linear: OffsetLimits { size: 1.0, rate: 1.0, acceleration: 1000.0 },
            rotary: OffsetLimits { size: 0.1, rate: 1.0, acceleration: 1000.0 },
            ramp_linear: OffsetLimits { size: 1.0, rate: 0.1, acceleration: 1.0 },
            ramp_rotary: OffsetLimits { size: 0.1, rate: 0.1, acceleration: 1.0 },
            hold_s: 0.1,
            delay_cycles: 1,
            overtravel: [1.0, 0.1],
        }
    }
}

impl OffsetConfig {
    pub(super) fn of(&self, kind: AxisKind) -> (OffsetLimits, OffsetLimits, f64) {
        match kind {
            AxisKind::Linear => (self.linear, self.ramp_linear, self.overtravel[0]),
            AxisKind::Rotary => (self.rotary, self.ramp_rotary, self.overtravel[1]),
        }
    }
}

/// Something that happens to the machine at a given cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScriptedEvent {
    /// Cycle, counted from the first of this control.
    pub cycle: u64,
    /// What happens.
    pub what: Happening,
}

/// What can happen to a machine.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Happening {
    /// These bits of the machine state are set.
    Set(u16),
    /// These bits of the machine state are cleared.
    Clear(u16),
    /// Another tool is in the spindle.
    Tool(Tool),
}

impl Happening {
    /// Emergency stop is pressed.
    pub const ESTOP: Self = Self::Set(MachineState::ESTOP);
    /// Emergency stop is released.
    pub const ESTOP_RELEASED: Self = Self::Clear(MachineState::ESTOP);
}

/// A simulated control.
#[derive(Debug, Clone, PartialEq)]
pub struct ControlConfig {
    /// Machine id.
    pub machine: String,
    /// Axes in wire order.
    pub axes: MachineAxes,
    /// Interval between cycles, s: 0.00025 to 0.01, whole ns.
    pub cycle_s: f64,
    /// Address to listen on; port 0 takes a free one.
    pub listen: SocketAddr,
    /// The only address that a daemon may come from, where given.
    pub peer: Option<IpAddr>,
    /// Mutual TLS; `None` is plain TCP.
    pub identity: Option<ControlIdentity>,
    /// Silence of a daemon after which its link is dead.
    pub silence: Duration,
    /// How cycles follow each other.
    pub pacing: Pacing,
    /// How daemons talk to it.
    pub interface: Interface,
    /// Check and use of offsets.
    pub offset: OffsetConfig,
    /// False: corrections are received and recorded but not applied.
    pub apply: bool,
    /// The tool in the spindle; `None`: the control does not know its tools.
    pub tool: Option<Tool>,
    /// Homed and enabled at the start.
    pub ready: bool,
    /// What happens during the run, by cycle.
    pub script: Vec<ScriptedEvent>,
}

impl ControlConfig {
    /// A control of this machine with the usual settings: 1 ms, real time, loopback, default port.
    #[must_use]
    pub fn new(machine: impl Into<String>, axes: MachineAxes) -> Self {
        Self {
            machine: machine.into(),
            axes,
            cycle_s: 0.001,
            listen: SocketAddr::from((Ipv4Addr::LOCALHOST, DEFAULT_PORT)),
            peer: None,
            identity: None,
            silence: Duration::from_secs(1),
            pacing: Pacing::RealTime,
            interface: Interface::Frames,
            offset: OffsetConfig::default(),
            apply: true,
            tool: None,
            ready: true,
            script: Vec::new(),
        }
    }

    /// What the control says of itself to a daemon.
    pub(super) fn hello(&self, cycle_ns: u64) -> ControlHello {
        let axes = self.axes.as_slice();
        let axis = |k: usize| Axis::new(axes.get(k).map_or(axes[0].name, |a| a.name));
        ControlHello {
            version: PROTOCOL_VERSION,
            machine: Name::new(&self.machine),
            software: Name::new(concat!("cncsim ", env!("CARGO_PKG_VERSION"))),
            cycle_ns,
            axis_count: u8::try_from(axes.len()).unwrap_or(u8::MAX),
            axes: core::array::from_fn(axis),
        }
    }

    /// Checks every number.
    ///
    /// # Errors
    /// The first that makes no sense.
    pub fn check(&self) -> Result<(), ConfigError> {
        checked_cycle_s(self.cycle_s)?;
        let o = &self.offset;
        if o.delay_cycles == 0 || o.delay_cycles > 1000 {
            return Err(ConfigError::Delay { cycles: o.delay_cycles });
        }
        for (what, limits) in [
            ("linear", &o.linear),
            ("rotary", &o.rotary),
            ("linear ramp", &o.ramp_linear),
            ("rotary ramp", &o.ramp_rotary),
        ] {
            for value in [limits.size, limits.rate, limits.acceleration] {
                if !value.is_finite() || value <= 0.0 {
                    return Err(ConfigError::Limit { what, value });
                }
            }
        }
        for (what, value) in
            [("hold time", o.hold_s), ("overtravel", o.overtravel[0]), ("overtravel", o.overtravel[1])]
        {
            if !value.is_finite() || value < 0.0 {
                return Err(ConfigError::Negative { what, value });
            }
        }
        let id = &self.machine;
        if id.is_empty() || id.len() > Name::MAX || id.chars().any(char::is_control) {
            return Err(ConfigError::Machine { id: id.clone() });
        }
        Ok(())
    }
}

/// Why a control cannot be set up like this.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[expect(missing_docs, reason = "the fields are what the message prints")]
pub enum ConfigError {
    /// A cycle time that no control has.
    #[error("{0}")]
    Cycle(#[from] ProfileError),
    /// A correction cannot act before it was computed.
    #[error("delay of {cycles} cycles; a correction takes 1 to 1000 cycles")]
    Delay { cycles: u32 },
    /// A limit that makes no sense.
    #[error("offset limits ({what}): {value}; give finite numbers above 0")]
    Limit { what: &'static str, value: f64 },
    /// A negative number.
    #[error("{what} {value}; give a finite number, 0 or above")]
    Negative { what: &'static str, value: f64 },
    /// An id that the link cannot carry.
    #[error("machine id {id:?}; give 1 to 32 bytes without control characters")]
    Machine { id: String },
}
