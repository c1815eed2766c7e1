//! From a checked frame to a message and back, one type after the other.
//!
//! Floating-point values are carried as they are, NaN and infinity included: what is to be done about them
//! is the engine's and the session's rule, not the codec's. Codes, names and reserved bytes are checked.

use super::FrameError;
use super::field::{self, Field};
use super::frame::{Frame, Kind};
use super::message::{
    Axis, AxisUnit, Close, CloseReason, ControlHello, Correction, CorrectionState, DaemonHello, ErrorCode,
    ErrorReport, Heartbeat, MachineState, Name, Position, Tool,
};
use volcomp_units::axes::{AxisName, MAX_AXES};

/// A message that has a frame.
pub trait Payload: Sized {
    /// Its type.
    const KIND: Kind;

    /// Reads it from a checked frame of its type.
    ///
    /// # Errors
    /// A field breaks a rule.
    fn parse<T: AsRef<[u8]>>(frame: &Frame<T>) -> Result<Self, FrameError>;

    /// Writes its fields into a frame that was started; reserved bytes stay zero.
    fn emit<T: AsRef<[u8]> + AsMut<[u8]>>(&self, frame: &mut Frame<T>);

    /// Bytes of the whole frame.
    fn buffer_len(&self) -> usize {
        Self::KIND.length()
    }
}

impl Payload for DaemonHello {
    const KIND: Kind = Kind::DaemonHello;

    fn parse<T: AsRef<[u8]>>(frame: &Frame<T>) -> Result<Self, FrameError> {
        use field::daemon_hello as f;
        zero(frame, f::RESERVED)?;
        let (min, max) = (frame.get(f::VERSION_MIN), frame.get(f::VERSION_MAX));
        if min == 0 || min > max {
            return Err(FrameError::VersionRange { min, max });
        }
        Ok(Self {
            version_min: min,
            version_max: max,
            machine: name(frame, f::MACHINE)?,
            software: name(frame, f::SOFTWARE)?,
        })
    }

    fn emit<T: AsRef<[u8]> + AsMut<[u8]>>(&self, frame: &mut Frame<T>) {
        use field::daemon_hello as f;
        frame.set(f::VERSION_MIN, self.version_min);
        frame.set(f::VERSION_MAX, self.version_max);
        frame.set(f::MACHINE, *self.machine.bytes());
        frame.set(f::SOFTWARE, *self.software.bytes());
    }
}

impl Payload for ControlHello {
    const KIND: Kind = Kind::ControlHello;

    fn parse<T: AsRef<[u8]>>(frame: &Frame<T>) -> Result<Self, FrameError> {
        use field::control_hello as f;
        zero(frame, f::RESERVED)?;
        let version = frame.get(f::CHOSEN);
        if version == 0 {
            return Err(FrameError::Value { field: f::CHOSEN.name(), found: version });
        }
        let axis_count = frame.get(f::AXIS_COUNT);
        Ok(Self {
            version,
            machine: name(frame, f::MACHINE)?,
            software: name(frame, f::SOFTWARE)?,
            cycle_ns: frame.get(f::CYCLE_NS),
            axis_count,
            axes: axes(&frame.get(f::AXES), axis_count)?,
        })
    }

    fn emit<T: AsRef<[u8]> + AsMut<[u8]>>(&self, frame: &mut Frame<T>) {
        use field::control_hello as f;
        let mut axes = [0; 2 * MAX_AXES];
        for (place, axis) in axes.as_chunks_mut().0.iter_mut().zip(self.used_axes()) {
            *place = [axis_letter(axis.name), axis.unit.code()];
        }
        frame.set(f::CHOSEN, self.version);
        frame.set(f::AXIS_COUNT, self.axis_count);
        frame.set(f::CYCLE_NS, self.cycle_ns);
        frame.set(f::MACHINE, *self.machine.bytes());
        frame.set(f::SOFTWARE, *self.software.bytes());
        frame.set(f::AXES, axes);
    }
}

impl Payload for ErrorReport {
    const KIND: Kind = Kind::Error;

    fn parse<T: AsRef<[u8]>>(frame: &Frame<T>) -> Result<Self, FrameError> {
        use field::error as f;
        zero(frame, f::RESERVED)?;
        Ok(Self { code: ErrorCode::from_code(frame.get(f::CODE)), detail: name(frame, f::DETAIL)? })
    }

    fn emit<T: AsRef<[u8]> + AsMut<[u8]>>(&self, frame: &mut Frame<T>) {
        use field::error as f;
        frame.set(f::CODE, self.code.code());
        frame.set(f::DETAIL, *self.detail.bytes());
    }
}

impl Payload for Close {
    const KIND: Kind = Kind::Close;

    fn parse<T: AsRef<[u8]>>(frame: &Frame<T>) -> Result<Self, FrameError> {
        use field::close as f;
        zero(frame, f::RESERVED)?;
        Ok(Self { reason: CloseReason::from_code(frame.get(f::REASON)) })
    }

    fn emit<T: AsRef<[u8]> + AsMut<[u8]>>(&self, frame: &mut Frame<T>) {
        frame.set(field::close::REASON, self.reason.code());
    }
}

impl Payload for Position {
    const KIND: Kind = Kind::Position;

    fn parse<T: AsRef<[u8]>>(frame: &Frame<T>) -> Result<Self, FrameError> {
        use field::position as f;
        zero(frame, f::RESERVED)?;
        Ok(Self {
            sequence: frame.get(f::SEQUENCE),
            control_ns: frame.get(f::CONTROL_NS),
            state: MachineState::from_bits(frame.get(f::STATE)),
            feed_mm_per_min: frame.get(f::FEED),
            commanded: frame.get(f::COMMANDED),
            actual: frame.get(f::ACTUAL),
            applied: frame.get(f::APPLIED),
        })
    }

    fn emit<T: AsRef<[u8]> + AsMut<[u8]>>(&self, frame: &mut Frame<T>) {
        use field::position as f;
        frame.set(f::SEQUENCE, self.sequence);
        frame.set(f::STATE, self.state.bits);
        frame.set(f::CONTROL_NS, self.control_ns);
        frame.set(f::FEED, self.feed_mm_per_min);
        frame.set(f::COMMANDED, self.commanded);
        frame.set(f::ACTUAL, self.actual);
        frame.set(f::APPLIED, self.applied);
    }
}

impl Payload for Correction {
    const KIND: Kind = Kind::Correction;

    fn parse<T: AsRef<[u8]>>(frame: &Frame<T>) -> Result<Self, FrameError> {
        use field::correction as f;
        zero(frame, f::RESERVED)?;
        let found = frame.get(f::STATE);
        let state =
            CorrectionState::from_code(found).ok_or(FrameError::Value { field: f::STATE.name(), found })?;
        Ok(Self {
            sequence: frame.get(f::SEQUENCE),
            state,
            limited: frame.get(f::LIMITED),
            offset: frame.get(f::OFFSET),
        })
    }

    fn emit<T: AsRef<[u8]> + AsMut<[u8]>>(&self, frame: &mut Frame<T>) {
        use field::correction as f;
        frame.set(f::SEQUENCE, self.sequence);
        frame.set(f::STATE, self.state.code());
        frame.set(f::LIMITED, self.limited);
        frame.set(f::OFFSET, self.offset);
    }
}

impl Payload for Heartbeat {
    const KIND: Kind = Kind::Heartbeat;

    fn parse<T: AsRef<[u8]>>(frame: &Frame<T>) -> Result<Self, FrameError> {
        use field::heartbeat as f;
        zero(frame, f::RESERVED)?;
        Ok(Self { count: frame.get(f::COUNT), time_ns: frame.get(f::TIME_NS) })
    }

    fn emit<T: AsRef<[u8]> + AsMut<[u8]>>(&self, frame: &mut Frame<T>) {
        use field::heartbeat as f;
        frame.set(f::COUNT, self.count);
        frame.set(f::TIME_NS, self.time_ns);
    }
}

impl Payload for Tool {
    const KIND: Kind = Kind::Tool;

    fn parse<T: AsRef<[u8]>>(frame: &Frame<T>) -> Result<Self, FrameError> {
        use field::tool as f;
        zero(frame, f::RESERVED)?;
        Ok(Self { number: frame.get(f::NUMBER), tip: frame.get(f::TIP) })
    }

    fn emit<T: AsRef<[u8]> + AsMut<[u8]>>(&self, frame: &mut Frame<T>) {
        use field::tool as f;
        frame.set(f::NUMBER, self.number);
        frame.set(f::TIP, self.tip);
    }
}

/// Reserved bytes must be zero, so that a later version can give them a meaning.
fn zero<T: AsRef<[u8]>, const N: usize>(frame: &Frame<T>, field: Field<[u8; N]>) -> Result<(), FrameError> {
    let bytes = frame.get(field);
    match bytes.iter().position(|&b| b != 0) {
        Some(k) => Err(FrameError::Reserved { offset: field.at() + k, found: bytes[k] }),
        None => Ok(()),
    }
}

fn name<T: AsRef<[u8]>>(frame: &Frame<T>, field: Field<[u8; Name::MAX]>) -> Result<Name, FrameError> {
    Name::from_bytes(frame.get(field)).map_err(|(at, fault)| FrameError::Name {
        field: field.name(),
        at,
        fault,
    })
}

fn axes(bytes: &[u8; 2 * MAX_AXES], count: u8) -> Result<[Axis; MAX_AXES], FrameError> {
    let used = usize::from(count);
    if used == 0 || used > MAX_AXES {
        return Err(FrameError::AxisCount { found: count });
    }
    let pairs = bytes.as_chunks::<2>().0;
    let mut axes = [axis(pairs[0])?; MAX_AXES];
    for k in 1..MAX_AXES {
        if k >= used {
            let offset = field::control_hello::AXES.at() + 2 * k;
            let [letter, unit] = pairs[k];
            for (offset, found) in [(offset, letter), (offset + 1, unit)] {
                if found != 0 {
                    return Err(FrameError::Reserved { offset, found });
                }
            }
            continue;
        }
        axes[k] = axis(pairs[k])?;
        if axes[..k].iter().any(|other| other.name == axes[k].name) {
            return Err(FrameError::AxisTwice { axis: axes[k].name });
        }
    }
    Ok(axes)
}

fn axis([letter, unit]: [u8; 2]) -> Result<Axis, FrameError> {
    let name = AxisName::ALL
        .into_iter()
        .find(|&a| axis_letter(a) == letter)
        .ok_or(FrameError::Value { field: "axis letter", found: letter })?;
    let unit = AxisUnit::from_code(unit).ok_or(FrameError::Value { field: "axis unit", found: unit })?;
    Ok(Axis { name, unit })
}

/// The upper-case ASCII letter.
const fn axis_letter(axis: AxisName) -> u8 {
    axis.letter() as u8
}
