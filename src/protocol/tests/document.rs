//! `docs/protocol.md` and its page of messages describe the program: tables and hex dumps are read back and compared.

use super::*;

const DOCUMENT: &str = include_str!("../../../docs/protocol.md");
const MESSAGES: &str = include_str!("../../../docs/reference/protocol-messages.md");

/// One row of an offset table.
struct Row<'a> {
    offset: usize,
    size: usize,
    kind: &'a str,
    field: &'a str,
    example: &'a str,
}

/// The part of the document that describes a message.
struct Section<'a> {
    code: u8,
    name: &'a str,
    version: u8,
    length: usize,
    rows: Vec<Row<'a>>,
    bytes: Vec<u8>,
}

fn cells(line: &str) -> Vec<&str> {
    line.trim().trim_matches('|').split('|').map(str::trim).collect()
}

fn hex(text: &str) -> u8 {
    u8::from_str_radix(text.trim_start_matches("0x"), 16).unwrap()
}

fn section(text: &str) -> Section<'_> {
    let (title, body) = text.split_once('\n').unwrap();
    let (heading, sizes) = title.split_once(" (version ").unwrap();
    let (code, name) = heading.split_once(' ').unwrap();
    let (version, length) = sizes.trim_end_matches(" bytes)").split_once(", ").unwrap();
    let rows = body
        .lines()
        .filter(|l| l.starts_with("| ") && l.as_bytes()[2].is_ascii_digit())
        .map(|line| {
            let c = cells(line);
            let [offset, size, kind, field, _, example] = c[..] else { panic!("{line}") };
            Row { offset: offset.parse().unwrap(), size: size.parse().unwrap(), kind, field, example }
        })
        .collect();
    let dump = body.split_once("```hex\n").unwrap().1.split_once("```").unwrap().0;
    let bytes = dump.lines().flat_map(|l| l.split_whitespace().skip(1).map(hex)).collect();
    Section {
        code: hex(code),
        name,
        version: version.parse().unwrap(),
        length: length.parse().unwrap(),
        rows,
        bytes,
    }
}

fn sections() -> Vec<Section<'static>> {
    let messages = MESSAGES.split_once("\n## 4 Messages").unwrap().1;
    messages.split("\n### ").skip(1).map(section).collect()
}

/// The bytes that a value has according to section 3 of the document.
fn bytes_of_value(kind: &str, value: &str) -> Vec<u8> {
    let number = || match value.strip_prefix("0x") {
        Some(digits) => u64::from_str_radix(digits, 16).unwrap(),
        None => value.parse().unwrap(),
    };
    let padded = |mut bytes: Vec<u8>, size: usize| {
        assert!(bytes.len() <= size);
        bytes.resize(size, 0);
        bytes
    };
    let floats = |count: usize| {
        let all = value.split(", ").flat_map(|v| v.parse::<f64>().unwrap().to_le_bytes()).collect();
        padded(all, 8 * count)
    };
    match kind {
        "u8" => number().to_le_bytes()[..1].to_vec(),
        "u16" => number().to_le_bytes()[..2].to_vec(),
        "u32" => number().to_le_bytes()[..4].to_vec(),
        "u64" | "i64" => number().to_le_bytes().to_vec(),
        "f64" => floats(1),
        "f64[3]" => floats(3),
        "f64[8]" => floats(8),
        "char[4]" => padded(value.into(), 4),
        "char[32]" => padded(value.into(), 32),
        "axes" => {
            let pair = |axis: &str| [axis.as_bytes()[0], if axis.ends_with(" deg") { 2 } else { 1 }];
            padded(value.split(", ").flat_map(pair).collect(), 16)
        }
        _ if kind.starts_with("zero[") && value == "0" => {
            vec![0; kind["zero[".len()..kind.len() - 1].parse().unwrap()]
        }
        _ => panic!("type {kind}"),
    }
}

#[test]
fn every_message_has_its_section() {
    let sections = sections();
    assert_eq!(sections.len(), Kind::ALL.len());
    for (kind, s) in Kind::ALL.into_iter().zip(&sections) {
        assert_eq!((s.code, s.version, s.length), (kind.code(), kind.version(), kind.length()), "{kind:?}");
        assert_eq!(s.name, format!("{kind:?}"));
    }
}

#[test]
fn offset_tables_are_those_of_the_program() {
    for (kind, s) in Kind::ALL.into_iter().zip(sections()) {
        let told: Vec<_> = s.rows.iter().map(|r| (r.field, r.offset, r.size)).collect();
        let mut fields: Vec<_> = field::header::ALL.iter().chain(fields_of(kind)).copied().collect();
        fields.push(("crc", kind.length() - frame::CRC_LEN, frame::CRC_LEN));
        assert_eq!(told, fields, "{kind:?}");
    }
}

#[test]
fn hex_dumps_are_what_the_encoder_writes() {
    for (message, s) in examples().iter().zip(sections()) {
        assert_eq!(s.bytes, bytes_of(message), "{}", s.name);
        assert_eq!(decode(&s.bytes).as_ref(), Ok(message), "{}", s.name);
    }
}

#[test]
fn example_values_are_those_of_the_hex_dumps() {
    for s in sections() {
        for row in &s.rows {
            let bytes = bytes_of_value(row.kind, row.example);
            assert_eq!(bytes.len(), row.size, "{} {}: size of {}", s.name, row.field, row.kind);
            assert_eq!(bytes, s.bytes[row.offset..row.offset + row.size], "{} {}", s.name, row.field);
        }
    }
}

/// Code and name of each row of the table under a heading.
fn codes(heading: &str) -> Vec<(u8, &'static str)> {
    let text = DOCUMENT.split_once(heading).unwrap().1;
    let rows = text.lines().skip_while(|l| !l.starts_with('|')).take_while(|l| l.starts_with('|')).skip(2);
    rows.map(|line| (cells(line)[0].parse().unwrap(), cells(line)[1])).collect()
}

#[test]
fn code_tables_are_complete() {
    let expected = |debug: &dyn Fn(u8) -> String, codes: &[(u8, &str)]| {
        for &(code, name) in codes {
            assert_eq!(debug(code), name);
        }
    };
    let states = codes("### 5.1");
    expected(&|c| format!("{:?}", CorrectionState::from_code(c).unwrap()), &states);
    assert_eq!(states.len(), (0..=u8::MAX).filter_map(CorrectionState::from_code).count());
    let errors = codes("### 5.2");
    expected(&|c| format!("{:?}", ErrorCode::from_code(c)), &errors);
    let named = |c: &u8| !matches!(ErrorCode::from_code(*c), ErrorCode::Other(_));
    assert_eq!(errors.len(), (0..=u8::MAX).filter(named).count());
    let reasons = codes("### 5.3");
    expected(&|c| format!("{:?}", CloseReason::from_code(c)), &reasons);
    let named = |c: &u8| !matches!(CloseReason::from_code(*c), CloseReason::Other(_));
    assert_eq!(reasons.len(), (0..=u8::MAX).filter(named).count());
}

#[test]
fn state_bits_are_those_of_the_program() {
    let text = DOCUMENT.split_once("### 5.4").unwrap().1.split_once("\n## ").unwrap().0;
    let told: Vec<_> = text.lines().filter(|l| l.starts_with("| ") && l.contains("0x")).map(cells).collect();
    assert_eq!(told.len(), 6);
    for (k, row) in told.iter().enumerate() {
        assert_eq!(row[0], k.to_string());
        assert_eq!(row[1], format!("{:#06x}", 1 << k));
        let name = row[2].to_lowercase().replace('_', "-");
        assert_eq!(format!("{:?}", MachineState::from_bits(1 << k)), format!("[{name:?}]"));
    }
}

#[test]
fn axis_letters_units_port_and_limits_are_told() {
    let letters: String = AxisName::ALL.iter().flat_map(|a| [a.letter(), ' ']).collect();
    assert!(MESSAGES.contains(&format!("Letters: {},", letters.trim())));
    assert!(MESSAGES.contains("(1 = mm, 2 = deg)") && AxisUnit::Degree.code() == 2);
    assert!(DOCUMENT.contains(&format!("127.0.0.1 port {DEFAULT_PORT}")));
    assert!(DOCUMENT.contains(&format!("| axes | {MAX_AXES} |")));
    assert!(DOCUMENT.contains(&format!("| text | {} bytes |", Name::MAX)));
    let largest = Kind::ALL.map(Kind::length).into_iter().max().unwrap();
    assert!(DOCUMENT.contains(&format!("{MAX_FRAME} (largest in version 1: {largest})")));
}

/// The seeds of the fuzz target that are examples of the document.
const SEEDS: [&[u8]; 8] = [
    include_bytes!("../../../fuzz/corpus/frame/daemon_hello.bin"),
    include_bytes!("../../../fuzz/corpus/frame/control_hello.bin"),
    include_bytes!("../../../fuzz/corpus/frame/error.bin"),
    include_bytes!("../../../fuzz/corpus/frame/close.bin"),
    include_bytes!("../../../fuzz/corpus/frame/position.bin"),
    include_bytes!("../../../fuzz/corpus/frame/correction.bin"),
    include_bytes!("../../../fuzz/corpus/frame/heartbeat.bin"),
    include_bytes!("../../../fuzz/corpus/frame/tool.bin"),
];

#[test]
fn seeds_of_the_fuzz_target_are_the_examples() {
    for (message, seed) in examples().iter().zip(SEEDS) {
        assert_eq!(bytes_of(message), seed, "{message:?}");
    }
}
