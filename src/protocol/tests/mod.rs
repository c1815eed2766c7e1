//! Tests that look at the whole room: examples, strategies and what the submodules prove with them.

mod document;
mod hostile;
mod read_write;
mod round_trip;
mod stream;

use proptest::prelude::*;

use super::field;
use super::frame::{Frame, Kind};
use super::*;
use volcomp_units::axes::{AxisArray, AxisName, MAX_AXES};

/// Names, offsets and sizes of the fields of a type, header and check sum apart.
pub(super) const fn fields_of(kind: Kind) -> &'static [(&'static str, usize, usize)] {
    match kind {
        Kind::DaemonHello => field::daemon_hello::ALL,
        Kind::ControlHello => field::control_hello::ALL,
        Kind::Error => field::error::ALL,
        Kind::Close => field::close::ALL,
        Kind::Position => field::position::ALL,
        Kind::Correction => field::correction::ALL,
        Kind::Heartbeat => field::heartbeat::ALL,
        Kind::Tool => field::tool::ALL,
    }
}

/// The messages of the documentation, one of each type in the order of [`Kind::ALL`].
pub(super) fn examples() -> [Message; 8] {
    let mm = |name| Axis { name, unit: AxisUnit::Millimetre };
    let mut axes = [mm(AxisName::X); MAX_AXES];
    axes[1] = mm(AxisName::Y);
    axes[2] = mm(AxisName::Z);
    axes[3] = Axis { name: AxisName::C, unit: AxisUnit::Degree };
    let first = |values: [f64; 4]| {
        let mut all: AxisArray = [0.0; MAX_AXES];
        all[..4].copy_from_slice(&values);
        all
    };
    [
        Message::DaemonHello(DaemonHello {
            version_min: 1,
            version_max: 1,
            machine: Name::new("vmc-850"),
            software: Name::new("volcompd 0.1.0"),
        }),
        Message::ControlHello(ControlHello {
            version: 1,
            machine: Name::new("vmc-850"),
            software: Name::new("cncsim 0.1.0"),
            cycle_ns: 1_000_000,
            axis_count: 4,
            axes,
        }),
        Message::Error(ErrorReport { code: ErrorCode::WrongMachine, detail: Name::new("vmc-850 expected") }),
        Message::Close(Close { reason: CloseReason::Operator }),
        Message::Position(Position {
            sequence: 4_294_967_295,
            control_ns: 12_000_500_000,
            state: MachineState::from_bits(
                MachineState::HOMED | MachineState::ENABLED | MachineState::MOVING,
            ),
            feed_mm_per_min: 2000.0,
            commanded: first([100.0, -12.5, 0.0, 90.0]),
            actual: first([100.0078125, -12.5, 0.0009765625, 90.0]),
            applied: first([0.0078125, 0.0, 0.0009765625, 0.0]),
        }),
        Message::Correction(Correction {
            sequence: 4_294_967_295,
            state: CorrectionState::Active,
            limited: 0b101,
            offset: first([0.01171875, -0.001953125, 0.0009765625, 0.0]),
        }),
        Message::Heartbeat(Heartbeat { count: 7, time_ns: 12_100_000_000 }),
        Message::Tool(Tool { number: 12, tip: [0.0, 0.0, -145.25] }),
    ]
}

/// The bytes of a message.
pub(super) fn bytes_of(message: &Message) -> Vec<u8> {
    let mut buffer = [0xa5; MAX_FRAME];
    let used = encode(message, &mut buffer);
    assert!(buffer[used..].iter().all(|&b| b == 0xa5), "bytes beyond the frame were touched");
    buffer[..used].to_vec()
}

/// A frame of any type code, with a valid check sum.
pub(super) fn frame_of(version: u8, code: u8, payload: &[u8]) -> Vec<u8> {
    let length = frame::MIN_FRAME + payload.len();
    let mut bytes = vec![0; length];
    bytes[frame::HEADER_LEN..length - frame::CRC_LEN].copy_from_slice(payload);
    seal(&mut bytes, version, code);
    bytes
}

/// Writes magic, version, type, length and check sum into bytes.
pub(super) fn seal(bytes: &mut [u8], version: u8, code: u8) {
    let length = u16::try_from(bytes.len()).unwrap();
    let mut frame = Frame::new_unchecked(bytes);
    frame.set(field::header::MAGIC, frame::MAGIC);
    frame.set(field::header::VERSION, version);
    frame.set(field::header::TYPE, code);
    frame.set(field::header::LENGTH, length);
    frame.fill_crc();
}

fn any_name() -> impl Strategy<Value = Name> {
    prop_oneof![Just(Name::default()), "\\PC{0,40}".prop_map(|s| Name::new(&s))]
}

/// Any 64 bits, so that NaN payloads, infinities and denormals occur.
fn any_float() -> impl Strategy<Value = f64> {
    prop_oneof![
        any::<u64>().prop_map(f64::from_bits),
        -1e4..1e4,
        Just(f64::NAN),
        Just(f64::NEG_INFINITY),
        Just(-0.0)
    ]
}

fn any_array() -> impl Strategy<Value = AxisArray> {
    proptest::array::uniform8(any_float())
}

fn any_axes() -> impl Strategy<Value = (u8, [Axis; MAX_AXES])> {
    let unit = prop_oneof![Just(AxisUnit::Millimetre), Just(AxisUnit::Degree)];
    let units = proptest::array::uniform8(unit);
    (1..=MAX_AXES, Just(AxisName::ALL.to_vec()).prop_shuffle(), units).prop_map(|(count, names, units)| {
        let axis = |k: usize| Axis { name: names[k], unit: units[k] };
        let axes = core::array::from_fn(|k| if k < count { axis(k) } else { axis(0) });
        (u8::try_from(count).unwrap(), axes)
    })
}

fn any_daemon_hello() -> impl Strategy<Value = Message> {
    (1..=u8::MAX, any::<u8>(), any_name(), any_name()).prop_map(|(a, b, machine, software)| {
        let (version_min, version_max) = (a.min(b.max(1)), a.max(b));
        Message::DaemonHello(DaemonHello { version_min, version_max, machine, software })
    })
}

fn any_control_hello() -> impl Strategy<Value = Message> {
    (1..=u8::MAX, any_name(), any_name(), any::<u64>(), any_axes()).prop_map(
        |(version, machine, software, cycle_ns, (axis_count, axes))| {
            Message::ControlHello(ControlHello { version, machine, software, cycle_ns, axis_count, axes })
        },
    )
}

fn any_position() -> impl Strategy<Value = Message> {
    (any::<u32>(), any::<i64>(), any::<u16>(), any_float(), any_array(), any_array(), any_array()).prop_map(
        |(sequence, control_ns, bits, feed_mm_per_min, commanded, actual, applied)| {
            let state = MachineState::from_bits(bits);
            Message::Position(Position {
                sequence,
                control_ns,
                state,
                feed_mm_per_min,
                commanded,
                actual,
                applied,
            })
        },
    )
}

fn any_correction() -> impl Strategy<Value = Message> {
    (any::<u32>(), 0_u8..7, any::<u8>(), any_array()).prop_map(|(sequence, state, limited, offset)| {
        let state = CorrectionState::from_code(state).unwrap();
        Message::Correction(Correction { sequence, state, limited, offset })
    })
}

/// Any message of any type.
pub(super) fn any_message() -> impl Strategy<Value = Message> {
    prop_oneof![
        any_daemon_hello(),
        any_control_hello(),
        any_position(),
        any_correction(),
        (any::<u32>(), any::<i64>())
            .prop_map(|(count, time_ns)| Message::Heartbeat(Heartbeat { count, time_ns })),
        (any::<u32>(), proptest::array::uniform3(any_float()))
            .prop_map(|(number, tip)| Message::Tool(Tool { number, tip })),
        any::<u8>().prop_map(|c| Message::Close(Close { reason: CloseReason::from_code(c) })),
        (any::<u8>(), any_name())
            .prop_map(|(c, detail)| Message::Error(ErrorReport { code: ErrorCode::from_code(c), detail })),
    ]
}
