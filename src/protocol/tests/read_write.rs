//! Lines of a control that is read and written by calls.

use proptest::prelude::*;

use crate::message::{CorrectionState, MachineState, Name, Position, Tool};
use crate::read_write::{LINE_MAX, LineError, LineReader, Machine, Reply, Request};
use volcomp_units::axes::{AxisName, MAX_AXES};

fn line_of(write: impl FnOnce(&mut [u8; LINE_MAX]) -> usize) -> Vec<u8> {
    let mut out = [0; LINE_MAX];
    let length = write(&mut out);
    assert_eq!(out[length - 1], b'\n');
    out[..length - 1].to_vec()
}

fn finite() -> impl Strategy<Value = f64> {
    prop_oneof![any::<f64>().prop_filter("finite", |v| v.is_finite()), -1e4..1e4]
}

fn values(count: usize) -> impl Strategy<Value = [f64; MAX_AXES]> {
    prop::collection::vec(finite(), count)
        .prop_map(|v| core::array::from_fn(|k| v.get(k).copied().unwrap_or(0.0)))
}

proptest! {
    #[test]
    fn offsets_come_back_bit_by_bit(axes in 1..MAX_AXES, all in values(MAX_AXES)) {
        let mut offset = all;
        offset[axes..].fill(0.0);
        let request = Request::Offset(offset);
        let line = line_of(|out| request.write(axes, out));
        prop_assert_eq!(Request::parse(&line, axes), Ok(request));
        prop_assert!(Request::parse(&line, axes - 1).is_err());
        prop_assert!(Request::parse(&line, axes + 1).is_err());
    }

    #[test]
    fn positions_come_back_bit_by_bit(
        (sequence, control_ns, bits) in (any::<u32>(), any::<i64>(), any::<u16>()),
        tool in any::<Option<u32>>(),
        (commanded, actual, applied) in (values(5), values(5), values(5)),
    ) {
        let state = MachineState::from_bits(bits);
        let feed_mm_per_min = commanded[0];
        let position = Position { sequence, control_ns, state, feed_mm_per_min, commanded, actual, applied };
        let line = line_of(|out| Reply::Position(position, tool).write(5, out));
        prop_assert_eq!(Reply::parse(&line, 5), Ok(Reply::Position(position, tool)));
    }

    #[test]
    fn hostile_bytes_are_an_error_and_never_a_panic(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
        let _ = Reply::parse(&bytes, 3);
        let _ = Request::parse(&bytes, 3);
        let mut reader = LineReader::default();
        for part in bytes.chunks(7) {
            reader.space()[..part.len()].copy_from_slice(part);
            reader.advance(part.len());
            while let Ok(Some(line)) = reader.next_line() {
                prop_assert!(!line.contains(&b'\n'));
            }
        }
    }

    #[test]
    fn lines_come_out_as_they_went_in(
        lines in prop::collection::vec("[ -~]{0,200}", 1..40),
        part in 1_usize..300,
    ) {
        let bytes: Vec<u8> = lines.iter().flat_map(|l| l.bytes().chain([b'\n'])).collect();
        let mut reader = LineReader::default();
        let mut seen = Vec::new();
        for part in bytes.chunks(part) {
            reader.space()[..part.len()].copy_from_slice(part);
            reader.advance(part.len());
            while let Some(line) = reader.next_line().unwrap() {
                seen.push(String::from_utf8(line.to_vec()).unwrap());
            }
        }
        prop_assert_eq!(seen, lines);
    }
}

#[test]
fn what_a_control_says_of_itself() {
    let mut axes = [AxisName::X; MAX_AXES];
    axes[1] = AxisName::Z;
    axes[2] = AxisName::B;
    let machine =
        Machine { cycle_ns: 4_000_000, hold_ms: 100, axes, axis_count: 3, machine: Name::new("mill no 1") };
    let line = line_of(|out| Reply::Machine(machine).write(3, out));
    assert_eq!(line, b"machine 4000000 100 XZB mill no 1");
    assert_eq!(Reply::parse(&line, 0), Ok(Reply::Machine(machine)));
    for tool in [None, Some(Tool { number: 7, tip: [0.0, -1.5, 120.0] })] {
        let line = line_of(|out| Reply::Tool(tool).write(3, out));
        assert_eq!(Reply::parse(&line, 3), Ok(Reply::Tool(tool)));
    }
    assert_eq!(Reply::parse(b"ok", 3), Ok(Reply::Done));
    assert_eq!(Reply::parse(b"ok\r", 3), Ok(Reply::Done), "line ends of other systems");
    for is_busy in [true, false] {
        let reply = Reply::Error { is_busy, detail: Name::new("no axes") };
        let line = line_of(|out| reply.write(3, out));
        assert_eq!(Reply::parse(&line, 3), Ok(reply));
    }
}

#[test]
fn letters_spaces_and_numbers_are_those_of_the_page() {
    for (line, is_reply) in [
        ("ok", true),
        ("OK", false),
        ("tool none ", false),
        ("tool none", true),
        ("tool None", false),
        ("tool 7 1 2 -2.5e-7", true),
        ("tool 7  1 2 3", false),
        ("tool 7 NaN 2 3", true),
        ("tool 7 1,5 2 3", false),
        ("Machine 1000000 100 X m", false),
    ] {
        assert_eq!(Reply::parse(line.as_bytes(), 1).is_ok(), is_reply, "{line}");
    }
    let letters = |line: &[u8]| match Reply::parse(line, 0) {
        Ok(Reply::Machine(machine)) => machine.axes[..machine.axis_count].to_vec(),
        other => panic!("{other:?}"),
    };
    assert_eq!(letters(b"machine 1000000 100 xZ m\r"), [AxisName::X, AxisName::Z]);
    let position = |applied: &str| Reply::parse(format!("position 1 5 3 0 none 1 1 {applied}").as_bytes(), 1);
    for applied in ["nan", "-inf"] {
        let Ok(Reply::Position(position, None)) = position(applied) else { panic!("{applied}") };
        assert!(!position.applied[0].is_finite());
    }
}

#[test]
fn a_state_is_one_that_there_is() {
    for code in 0..=u8::MAX {
        let line = format!("WRITE state {code}");
        match CorrectionState::from_code(code) {
            Some(state) => {
                assert_eq!(line_of(|out| Request::State(state).write(3, out)), line.as_bytes());
                assert_eq!(Request::parse(line.as_bytes(), 3), Ok(Request::State(state)));
            }
            None => assert_eq!(Request::parse(line.as_bytes(), 3), Err(LineError::Field { field: "state" })),
        }
    }
}

#[test]
fn the_longest_line_fits() {
    let position = Position {
        sequence: u32::MAX,
        control_ns: i64::MIN,
        state: MachineState::from_bits(u16::MAX),
        feed_mm_per_min: -123_456.789_012_345_67,
        commanded: [-12_345.678_901_234_567; MAX_AXES],
        actual: [-12_345.678_901_234_567; MAX_AXES],
        applied: [-0.000_123_456_789_012_345; MAX_AXES],
    };
    let line = line_of(|out| Reply::Position(position, Some(u32::MAX)).write(MAX_AXES, out));
    assert_eq!(Reply::parse(&line, MAX_AXES), Ok(Reply::Position(position, Some(u32::MAX))));
    let tiny = [-2.225_073_858_507_201_4e-308; MAX_AXES];
    let position = Position { commanded: tiny, actual: tiny, applied: tiny, ..position };
    let line = line_of(|out| Reply::Position(position, None).write(MAX_AXES, out));
    assert_eq!(Reply::parse(&line, MAX_AXES), Ok(Reply::Position(position, None)));
}

#[test]
fn errors_name_the_field() {
    assert_eq!(Request::parse(b"WRITE offset 1 x", 2), Err(LineError::Field { field: "offset" }));
    assert_eq!(Reply::parse(b"position 1 2 3 4", 2), Err(LineError::Field { field: "tool number" }));
    assert_eq!(Reply::parse(b"tool 1 2 3 4 5", 2), Err(LineError::Excess { call: "tool", fields: 4 }));
    assert_eq!(Reply::parse("ök".as_bytes(), 2), Err(LineError::NotText { at: 0 }));
    let mut reader = LineReader::default();
    for _ in 0..2 {
        let space = reader.space();
        let count = space.len().min(LINE_MAX);
        space[..count].fill(b'a');
        reader.advance(count);
    }
    assert_eq!(reader.next_line(), Err(LineError::Length));
}
