//! Who is at the other end: the checks between connecting and cycling.

use std::io;
use std::net::SocketAddr;

use crate::config::MachineConfig;
use crate::core::axes::{AxisKind, AxisName, MAX_AXES};
use crate::core::engine::EngineError;
use crate::core::protocol::{
    AxisUnit, ControlHello, DaemonHello, ErrorCode, FrameError, Name, PROTOCOL_VERSION,
};
use crate::core::units::NS_PER_S;

/// Relative difference between two cycle times that still are the same.
const CYCLE_TOLERANCE: f64 = 1e-6;

/// Why there is no link.
#[derive(Debug, thiserror::Error)]
pub(super) enum LinkError {
    #[error("control {address}: {source}")]
    Connect { address: SocketAddr, source: io::Error },
    #[error("control {address}: no {waiting_for} within {limit_s} s")]
    Timeout { address: SocketAddr, waiting_for: &'static str, limit_s: f64 },
    #[error("control {address}: closed the connection before its hello")]
    Closed { address: SocketAddr },
    #[error("control {address}: {source}; is this the compensation port of a control?")]
    Frame { address: SocketAddr, source: FrameError },
    #[error("control {address}: sent a {found} where its hello was due")]
    Unexpected { address: SocketAddr, found: &'static str },
    #[error("control {address}: refused this daemon: {code:?} ({detail})")]
    Refused { address: SocketAddr, code: ErrorCode, detail: Name },
    #[error(
        "control {address}: speaks protocol version {found}, this daemon {PROTOCOL_VERSION}; \
         install matching versions"
    )]
    Version { address: SocketAddr, found: u8 },
    #[error(
        "control {address}: is machine `{found}`, this daemon is configured for `{expected}`; \
         correct `address` or `machine` in the machine file"
    )]
    Machine { address: SocketAddr, found: Name, expected: Name },
    #[error("control {address}: announces {found} axes, the link carries 1 to {MAX_AXES}")]
    AxisCount { address: SocketAddr, found: u8 },
    #[error("control {address}: announces axis {axis} twice")]
    AxisTwice { address: SocketAddr, axis: AxisName },
    #[error(
        "control {address}: does not have axis {axis} of the machine file; it has {present}; \
         correct the axes of the machine file or of the control"
    )]
    AxisMissing { address: SocketAddr, axis: AxisName, present: AxisLetters },
    #[error("control {address}: announces axis {axis} in {found:?}, expected {expected:?}")]
    AxisWrongUnit { address: SocketAddr, axis: AxisName, found: AxisUnit, expected: AxisUnit },
    #[error(
        "control {address}: has a cycle of {found_ns} ns, the machine file says {expected_s} s; \
         correct `cycle-s` or the control"
    )]
    Cycle { address: SocketAddr, found_ns: u64, expected_s: f64 },
    #[error("control {address}: {source}")]
    Engine { address: SocketAddr, source: EngineError },
}

/// The axes of a control, for messages.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct AxisLetters {
    letters: [Option<AxisName>; MAX_AXES],
}

impl core::fmt::Display for AxisLetters {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let mut gap = "";
        for axis in self.letters.iter().flatten() {
            write!(f, "{gap}{axis}")?;
            gap = " ";
        }
        Ok(())
    }
}

impl LinkError {
    /// True where waiting does not help: somebody has to change something.
    pub(super) const fn needs_a_person(&self) -> bool {
        match self {
            Self::Connect { .. } | Self::Timeout { .. } | Self::Closed { .. } => false,
            Self::Refused { code, .. } => matches!(
                code,
                ErrorCode::Version | ErrorCode::WrongMachine | ErrorCode::WrongAxes | ErrorCode::WrongCycle
            ),
            _ => true,
        }
    }

    /// What to tell the control before closing, where it is worth telling.
    pub(super) const fn code(&self) -> Option<ErrorCode> {
        match self {
            Self::Frame { .. } => Some(ErrorCode::BadFrame),
            Self::Unexpected { .. } => Some(ErrorCode::Unexpected),
            Self::Version { .. } => Some(ErrorCode::Version),
            Self::Machine { .. } => Some(ErrorCode::WrongMachine),
            Self::AxisCount { .. }
            | Self::AxisTwice { .. }
            | Self::AxisMissing { .. }
            | Self::AxisWrongUnit { .. }
            | Self::Engine { .. } => Some(ErrorCode::WrongAxes),
            Self::Cycle { .. } => Some(ErrorCode::WrongCycle),
            Self::Connect { .. } | Self::Timeout { .. } | Self::Closed { .. } | Self::Refused { .. } => None,
        }
    }
}

/// The hello of this daemon.
pub(super) fn daemon_hello(config: &MachineConfig) -> DaemonHello {
    DaemonHello {
        version_min: PROTOCOL_VERSION,
        version_max: PROTOCOL_VERSION,
        machine: Name::new(&config.machine),
        software: Name::new(concat!("volcompd ", env!("CARGO_PKG_VERSION"))),
    }
}

/// The axes that a control announced.
pub(super) fn announced(hello: &ControlHello) -> &[crate::core::protocol::Axis] {
    &hello.axes[..usize::from(hello.axis_count).min(MAX_AXES)]
}

/// Checks the control's hello against the machine file.
///
/// # Errors
/// The first thing that does not fit.
pub(super) fn check(hello: &ControlHello, config: &MachineConfig) -> Result<(), LinkError> {
    let address = config.link.address;
    if hello.version != PROTOCOL_VERSION {
        return Err(LinkError::Version { address, found: hello.version });
    }
    let expected = Name::new(&config.machine);
    if hello.machine != expected {
        return Err(LinkError::Machine { address, found: hello.machine, expected });
    }
    if hello.axis_count == 0 || usize::from(hello.axis_count) > MAX_AXES {
        return Err(LinkError::AxisCount { address, found: hello.axis_count });
    }
    let axes = announced(hello);
    for (i, axis) in axes.iter().enumerate() {
        if axes[..i].iter().any(|a| a.name == axis.name) {
            return Err(LinkError::AxisTwice { address, axis: axis.name });
        }
        let expected = match axis.name.kind() {
            AxisKind::Linear => AxisUnit::Millimetre,
            AxisKind::Rotary => AxisUnit::Degree,
        };
        if axis.unit != expected {
            return Err(LinkError::AxisWrongUnit { address, axis: axis.name, found: axis.unit, expected });
        }
    }
    if let Some(missing) = config.axes.iter().find(|a| axes.iter().all(|b| b.name != a.name)) {
        let mut letters = [None; MAX_AXES];
        for (letter, axis) in letters.iter_mut().zip(axes) {
            *letter = Some(axis.name);
        }
        let present = AxisLetters { letters };
        return Err(LinkError::AxisMissing { address, axis: missing.name, present });
    }
    let found_s = hello.cycle_ns as f64 / NS_PER_S;
    if (found_s - config.link.cycle_s).abs() > CYCLE_TOLERANCE * config.link.cycle_s {
        let expected_s = config.link.cycle_s;
        return Err(LinkError::Cycle { address, found_ns: hello.cycle_ns, expected_s });
    }
    Ok(())
}
