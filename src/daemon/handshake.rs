//! Who is at the other end: failures between connecting and cycling, and the Error sent to the control.

use std::io;
use std::net::SocketAddr;

use super::tls::TlsError;
use volcomp_config::MachineConfig;
use volcomp_config::machine::HelloMismatch;
use volcomp_engine::EngineError;
use volcomp_engine::fault::Code;
use volcomp_protocol::{
    Axis, AxisUnit, ControlHello, DaemonHello, ErrorCode, ErrorReport, FrameError, Name, PROTOCOL_VERSION,
};
use volcomp_units::axes::MAX_AXES;

/// The reason of a failed connection; the commonest one in words that need no manual.
fn reason(error: &io::Error) -> String {
    match error.kind() {
        io::ErrorKind::ConnectionRefused => "no program listens there (Connection refused)".to_owned(),
        _ => error.to_string(),
    }
}

/// Why there is no link.
#[derive(Debug, thiserror::Error)]
pub(super) enum LinkError {
    #[error("control {address}: {}", reason(source))]
    Connect { address: SocketAddr, source: io::Error },
    #[error("control {address}: {source}")]
    Tls { address: SocketAddr, source: TlsError },
    #[error(
        "control {address}: closed the connection during the TLS handshake; does it speak TLS, and may this computer \
         connect?"
    )]
    ClosedBeforeTls { address: SocketAddr },
    #[error("control {address}: speaks TLS; add [link.tls] to the machine file")]
    WantsTls { address: SocketAddr },
    #[error("control {address}: no {waiting_for} within {limit_s} s")]
    Timeout { address: SocketAddr, waiting_for: &'static str, limit_s: f64 },
    #[error("control {address}: closed the connection before its hello")]
    Closed { address: SocketAddr },
    #[error("control {address}: {source}; is this the compensation port of a control?")]
    Frame { address: SocketAddr, source: FrameError },
    #[error("control {address}: sent a {found} where its hello was due")]
    Unexpected { address: SocketAddr, found: &'static str },
    #[error("control {address}: refused this daemon, which is for machine \"{machine}\": {code} ({detail})")]
    Refused { address: SocketAddr, machine: String, code: ErrorCode, detail: Name },
    #[error(
        "control {address}: speaks protocol version {found}, this daemon {PROTOCOL_VERSION}; \
         install matching versions"
    )]
    Version { address: SocketAddr, found: u8 },
    #[error("control {address}: {source}")]
    Mismatch { address: SocketAddr, source: HelloMismatch },
    #[error("control {address}: {source}")]
    Engine { address: SocketAddr, source: EngineError },
}

/// First bytes of what an end that speaks TLS says to one that does not: an alert, or a handshake.
const TLS_RECORDS: [u8; 2] = [0x15, 0x16];

impl LinkError {
    /// A failure of the connection.
    pub(super) fn of_stream(address: SocketAddr, source: io::Error) -> Self {
        match TlsError::of(&source) {
            Some(source) => Self::Tls { address, source },
            None => Self::Connect { address, source },
        }
    }

    /// Bytes that are no frame.
    pub(super) fn of_frame(address: SocketAddr, source: FrameError) -> Self {
        match source {
            FrameError::Magic { at: 0, found, .. } if TLS_RECORDS.contains(&found) => {
                Self::WantsTls { address }
            }
            source => Self::Frame { address, source },
        }
    }

    /// True where waiting does not help: somebody has to change something.
    pub(super) const fn needs_a_person(&self) -> bool {
        match self {
            Self::Connect { .. }
            | Self::Timeout { .. }
            | Self::Closed { .. }
            | Self::ClosedBeforeTls { .. } => false,
            Self::Tls { source, .. } => source.needs_a_person(),
            Self::Refused { code, .. } => matches!(
                code,
                ErrorCode::Version | ErrorCode::WrongMachine | ErrorCode::WrongAxes | ErrorCode::WrongCycle
            ),
            _ => true,
        }
    }

    /// Its number.
    pub(super) fn fault(&self) -> Code {
        match self {
            Self::Connect { .. } | Self::Timeout { .. } | Self::Closed { .. } => Code::CONNECT_FAILED,
            Self::Frame { source, .. } => match ErrorReport::from(*source).code {
                ErrorCode::BadFrame => Code::BAD_FRAME,
                _ => Code::HELLO_MISMATCH,
            },
            Self::Tls { .. } | Self::ClosedBeforeTls { .. } | Self::WantsTls { .. } => Code::TLS_FAILED,
            Self::Unexpected { .. } => Code::BAD_FRAME,
            Self::Refused { code: ErrorCode::Busy, .. } => Code::CONTROL_BUSY,
            Self::Refused { .. } | Self::Version { .. } | Self::Mismatch { .. } | Self::Engine { .. } => {
                Code::HELLO_MISMATCH
            }
        }
    }

    /// Code and reason for the control before closing, where it is worth telling; the reason in at most [`Name::MAX`] bytes.
    pub(super) fn report(&self) -> Option<(ErrorCode, String)> {
        let axes = |detail: String| (ErrorCode::WrongAxes, detail);
        let (code, detail) = match self {
            Self::Frame { source, .. } => {
                (ErrorCode::BadFrame, ErrorReport::from(*source).detail.as_str().to_owned())
            }
            Self::Unexpected { found, .. } => (ErrorCode::Unexpected, format!("{found} before the hello")),
            Self::Version { found, .. } => {
                (ErrorCode::Version, format!("version {found}, not {PROTOCOL_VERSION}"))
            }
            Self::Mismatch { source, .. } => match source {
                // the end of a long id is what is cut
                HelloMismatch::Machine { expected, .. } => {
                    (ErrorCode::WrongMachine, format!("expected {expected}"))
                }
                HelloMismatch::Cycle { expected_ms, found_ms } => {
                    (ErrorCode::WrongCycle, format!("cycle {found_ms} ms, not {expected_ms} ms"))
                }
                HelloMismatch::AxisMissing { axis, .. } => axes(format!("axis {axis} is missing")),
                HelloMismatch::AxisUnit { axis, found } => {
                    let unit = if *found == AxisUnit::Degree { "mm, not deg" } else { "deg, not mm" };
                    axes(format!("axis {axis} must be in {unit}"))
                }
                HelloMismatch::AxisTwice { axis } => axes(format!("axis {axis} twice")),
                HelloMismatch::AxisCount { found } => axes(format!("{found} axes, must be 1 to {MAX_AXES}")),
            },
            Self::Engine { source: EngineError::AxisMissing { axis }, .. } => {
                axes(format!("the model needs axis {axis}"))
            }
            Self::Engine { .. } => axes("axes do not fit the machine file".to_owned()),
            Self::Connect { .. } | Self::Timeout { .. } | Self::Closed { .. } | Self::Refused { .. } => {
                return None;
            }
            // there is no common language to say it in
            Self::Tls { .. } | Self::ClosedBeforeTls { .. } | Self::WantsTls { .. } => return None,
        };
        Some((code, detail))
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
pub(super) fn announced(hello: &ControlHello) -> &[Axis] {
    &hello.axes[..usize::from(hello.axis_count).min(MAX_AXES)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use volcomp_units::axes::AxisName::{A, X};

    #[test]
    fn the_control_is_told_the_reason_in_full() {
        let address: SocketAddr = "127.0.0.1:7878".parse().expect("an address");
        let mismatch = |source| LinkError::Mismatch { address, source };
        let axis = HelloMismatch::AxisMissing { axis: X, found: volcomp_config::machine::AxisList(vec![A]) };
        let all = [
            (LinkError::Frame { address, source: FrameError::Crc { expected: 1, found: 2 } }, "check sum"),
            (LinkError::Unexpected { address, found: "daemon hello" }, "daemon hello before the hello"),
            (LinkError::Version { address, found: 255 }, "version 255, not 1"),
            (
                mismatch(HelloMismatch::Machine { expected: "vmc-850".to_owned(), found: "m".to_owned() }),
                "expected vmc-850",
            ),
            (
                mismatch(HelloMismatch::Cycle { expected_ms: 0.333, found_ms: 1000.25 }),
                "cycle 1000.25 ms, not 0.333 ms",
            ),
            (mismatch(axis), "axis X is missing"),
            (
                mismatch(HelloMismatch::AxisUnit { axis: A, found: AxisUnit::Millimetre }),
                "axis A must be in deg, not mm",
            ),
            (mismatch(HelloMismatch::AxisTwice { axis: X }), "axis X twice"),
            (mismatch(HelloMismatch::AxisCount { found: 0 }), "0 axes, must be 1 to 8"),
            (
                LinkError::Engine { address, source: EngineError::AxisMissing { axis: A } },
                "the model needs axis A",
            ),
            (
                LinkError::Engine { address, source: EngineError::TooManyAxes { found: 9 } },
                "axes do not fit the machine file",
            ),
        ];
        for (error, expected) in all {
            let (_, detail) = error.report().expect("told");
            assert_eq!(Name::new(&detail).as_str(), expected, "nothing is cut");
        }
        assert_eq!(LinkError::Closed { address }.report(), None);
    }
}
