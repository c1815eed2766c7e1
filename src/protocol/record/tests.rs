//! Round trips bit for bit, damage, and bytes that nobody wrote.

use proptest::prelude::*;

use super::block::{self, BlockKind, Found};
use super::entry::request;
use super::reader::hashed;
use super::*;
use crate::{Axis, AxisUnit, ControlHello, CorrectionState, MachineState, Name, Position, Tool};
use volcomp_units::MonoTime;
use volcomp_units::axes::{AxisName, MAX_AXES};

fn hello() -> ControlHello {
    let axis = |name| Axis { name, unit: AxisUnit::Millimetre };
    let mut axes = [axis(AxisName::X); MAX_AXES];
    axes[1] = axis(AxisName::Y);
    axes[2] = axis(AxisName::Z);
    let name = Name::new("m");
    ControlHello { version: 1, machine: name, software: name, cycle_ns: 1_000_000, axis_count: 3, axes }
}

/// A circle with a small servo lag, an offset that follows, and a read-back one cycle behind.
fn run(count: u32) -> Vec<Entry> {
    let at =
        |k: u32| MonoTime::from_ns(5_000_000_000 + i64::from(k) * 1_000_000 + i64::from(k * 7919 % 9973));
    let mut all = vec![
        Entry::Engine { now: at(0), hello: hello() },
        Entry::Request { now: at(0), request: Request { code: request::ENABLE, value: 0.0 } },
        Entry::LinkUp { now: at(0) },
        Entry::Tool { now: at(0), tool: Tool { number: 3, tip: [0.0, 0.0, -120.0] } },
    ];
    let mut sent = [0.0; MAX_AXES];
    for k in 1..=count {
        let phase = f64::from(k) * 1e-3;
        let point =
            |p: f64| [200.0 + 100.0 * p.cos(), 200.0 + 100.0 * p.sin(), -50.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        let (commanded, lagging) = (point(phase), point(phase - 5e-3));
        let frame = Position {
            sequence: k,
            control_ns: i64::from(k) * 1_000_000,
            state: MachineState::from_bits(MachineState::HOMED | MachineState::ENABLED),
            feed_mm_per_min: 6000.0,
            commanded,
            actual: core::array::from_fn(|a| lagging[a] + sent[a]),
            applied: sent,
        };
        let mut offset = [0.0; MAX_AXES];
        offset[0] = 1e-2 * (2.0 * phase).sin();
        offset[1] = -4e-3 * phase.cos();
        sent = offset;
        let state = CorrectionState::Active;
        let answer =
            Answer { sequence: k, state, lag_cycles: 1, offset, wanted: offset, ..Answer::default() };
        all.push(Entry::Cycle(Cycle { now: at(k), frame, enabled: true, answer: Some(answer) }));
    }
    all.push(Entry::LinkDown { now: at(count) });
    all
}

fn meta() -> Meta {
    Meta { format: meta::FORMAT.to_owned(), machine: "m".to_owned(), run: "r".to_owned(), ..Meta::default() }
}

/// A file of blocks of `per_block` entries; the places where the blocks begin.
fn file(entries: &[Entry], per_block: usize) -> (Vec<u8>, Vec<usize>) {
    let mut bytes = block::file_header().to_vec();
    let text = meta().to_text().unwrap();
    bytes.extend(block::seal(BlockKind::Meta, 0, 0, 0, text.as_bytes()).unwrap());
    bytes.extend(block::seal(BlockKind::Model, 0, 0, 0, &hashed(&[7; 32], "model text")).unwrap());
    let mut encoder = Encoder::new();
    let (mut places, mut rows) = (Vec::new(), Vec::new());
    for part in entries.chunks(per_block) {
        part.iter().for_each(|entry| encoder.push(entry));
        let (first_record, first_ns, records) = encoder.pending();
        places.push(bytes.len());
        rows.push(IndexRow { at: bytes.len() as u64, first_record, first_ns, records });
        bytes.extend(encoder.seal().unwrap());
    }
    bytes.extend(block::index(&rows, bytes.len() as u64).unwrap());
    (bytes, places)
}

fn bits(entry: &Entry) -> String {
    // the shortest text of a float is its own; NaN is told apart by its bits
    match entry {
        Entry::Cycle(c) => {
            let [offset, wanted] = c.answer.map_or([[0.0; 8]; 2], |a| [a.offset, a.wanted]);
            let arrays = [c.frame.commanded, c.frame.actual, c.frame.applied, offset, wanted];
            format!(
                "{entry:?} {:x?} {:x}",
                arrays.map(|a| a.map(f64::to_bits)),
                c.frame.feed_mm_per_min.to_bits()
            )
        }
        other => format!("{other:?}"),
    }
}

fn read(bytes: &[u8]) -> (Vec<Item>, Vec<Note>) {
    let recording = Recording::parse(bytes).unwrap();
    let mut reader = recording.reader(0);
    let items: Vec<Item> = reader.by_ref().collect();
    (items, [recording.notes.clone(), reader.notes].concat())
}

#[test]
fn what_was_written_is_read_bit_for_bit() {
    let entries = run(2500);
    let (bytes, places) = file(&entries, 500);
    let recording = Recording::parse(&bytes).unwrap();
    assert!(recording.closed && recording.notes.is_empty());
    assert_eq!(recording.meta, meta());
    assert_eq!(recording.models, [([7; 32], "model text".to_owned())]);
    assert_eq!(recording.records(), entries.len() as u64);
    let (items, notes) = read(&bytes);
    assert_eq!(notes, []);
    for (k, (item, entry)) in items.iter().zip(&entries).enumerate() {
        let Item::Entry { record, entry: found } = item else { panic!("{item:?}") };
        assert_eq!((*record, bits(found)), (k as u64, bits(entry)));
    }
    assert_eq!(items.len(), entries.len());
    // the index says the same as the blocks
    let rows = block::read_index(&bytes).unwrap();
    assert_eq!(rows.iter().map(|r| usize::try_from(r.at).unwrap()).collect::<Vec<_>>(), places);
    assert_eq!(rows.iter().map(|r| u64::from(r.records)).sum::<u64>(), entries.len() as u64);
    // a smooth path of three axes takes far less than its 250 bytes of plain numbers
    let per_cycle = bytes.len() as f64 / entries.len() as f64;
    assert!(per_cycle < 60.0, "{per_cycle} bytes a cycle");
}

#[test]
fn a_file_torn_anywhere_keeps_everything_before() {
    let entries = run(300);
    let (bytes, places) = file(&entries, 50);
    for end in places[0]..bytes.len() {
        let (items, notes) = read(&bytes[..end]);
        let whole = places.iter().skip(1).filter(|p| **p <= end).count();
        let whole = if end >= bytes.len() - 200 { items.len().div_ceil(50).max(whole) } else { whole };
        assert!(items.len() >= whole * 50 - if whole == places.len() { 50 } else { 0 }, "cut at {end}");
        for (item, entry) in items.iter().zip(&entries) {
            let Item::Entry { entry: found, .. } = item else { panic!("{item:?}") };
            assert_eq!(bits(found), bits(entry));
        }
        assert!(notes.iter().all(|n| matches!(n, Note::Torn { .. })), "cut at {end}: {notes:?}");
    }
}

#[test]
fn damage_costs_one_block_and_says_how_much() {
    let entries = run(300);
    let (bytes, places) = file(&entries, 50);
    // in the content, then in the header of the third block
    for hit in [places[2] + block::BLOCK_HEADER + 5, places[2] + 9] {
        let mut bytes = bytes.clone();
        bytes[hit] ^= 0x10;
        let (items, notes) = read(&bytes);
        assert_eq!(notes.len(), 1, "{notes:?}");
        let gaps: Vec<_> = items.iter().filter(|i| matches!(i, Item::Gap { .. })).collect();
        let [Item::Gap { record: 150, dropped: 50, context }] = gaps[..] else { panic!("{gaps:?}") };
        assert!(context.enabled && context.link && context.hello == Some(hello()));
        assert_eq!(context.tool.map(|t| t.number), Some(3));
        assert_eq!(items.len(), entries.len() - 50 + 1);
    }
}

#[test]
fn a_damaged_report_of_live_estimation_costs_no_entry() {
    let (mut bytes, places) = file(&run(20), 10);
    let report = block::seal(BlockKind::Health, 0, 0, 5, b"{}").unwrap();
    let at = places[1];
    bytes.splice(at..at, report.iter().copied());
    let (items, notes) = read(&bytes);
    assert!(notes.is_empty(), "{notes:?}");
    bytes[at + block::BLOCK_HEADER + 1] ^= 1;
    let (same, notes) = read(&bytes);
    assert_eq!((same, notes.as_slice()), (items, [Note::Health { at: at as u64 }].as_slice()));
    assert!(!notes[0].is_damage() && notes[0].to_string().contains("no record is missing"));
}

#[test]
fn skipped_entries_leave_a_gap_that_tells_how_things_stand() {
    let entries = run(100);
    let mut encoder = Encoder::new();
    let mut bytes = file(&[], 1).0;
    bytes.truncate(bytes.len() - block::TRAILER - block::BLOCK_HEADER);
    entries[..50].iter().for_each(|e| encoder.push(e));
    bytes.extend(encoder.seal().unwrap());
    entries[50..80].iter().for_each(|e| encoder.skip(e));
    encoder.skip(&Entry::Request {
        now: MonoTime::ZERO,
        request: Request { code: request::SET_GAIN, value: 0.5 },
    });
    entries[80..].iter().for_each(|e| encoder.push(e));
    bytes.extend(encoder.seal().unwrap());
    let (items, notes) = read(&bytes);
    assert_eq!(notes, []);
    let Item::Gap { record: 81, dropped: 31, context } = items[50] else { panic!("{:?}", items[50]) };
    assert_eq!(context.gain, Some(0.5));
    assert!(matches!(items[51], Item::Entry { record: 81, .. }));
}

#[test]
fn what_a_later_version_adds_is_passed_over_or_refused() {
    let entries = run(3);
    let mut encoder = Encoder::new();
    entries.iter().for_each(|e| encoder.push(e));
    let sealed = encoder.seal().unwrap();
    let Found::Block(block, _) = block::look(&sealed) else { panic!("a block") };
    let mut content = block.content().unwrap();
    for tag in [9, 200] {
        content.extend([tag, 3, 0, 1, 2]);
    }
    let mut decoder = Decoder::new(content).unwrap();
    let mut unknown = Vec::new();
    while let Some(decoded) = decoder.next_entry().unwrap() {
        if let Decoded::Unknown { tag } = decoded {
            unknown.push(tag);
        }
    }
    assert_eq!(unknown, [9, 200]);

    let (bytes, _) = file(&entries, 10);
    let with = |code| [&bytes[..], &block::seal(BlockKind::Other(code), 0, 0, 0, b"new").unwrap()].concat();
    let mut later = bytes[..bytes.len() - block::TRAILER].to_vec();
    later.extend(block::seal(BlockKind::Other(77), 0, 0, 0, b"new").unwrap());
    assert!(matches!(Recording::parse(&later).unwrap().notes[..], [Note::UnknownBlock { kind: 77, .. }]));
    let _ = with(77);
    later.extend(block::seal(BlockKind::Other(177), 0, 0, 0, b"new").unwrap());
    let refused = Recording::parse(&later).unwrap_err();
    assert!(
        matches!(refused, RecordError::BlockKind { kind: 177, .. }) && refused.to_string().contains("newer")
    );

    let mut version = bytes;
    version[8] = 9;
    assert_eq!(Recording::parse(&version).unwrap_err(), RecordError::Header);
    assert_eq!(Recording::parse(b"t_s,x_mm\n").unwrap_err(), RecordError::NotARecording);
}

#[test]
fn numbers_survive_at_both_ends() {
    for value in [0, 1, 127, 128, u64::MAX, u64::MAX - 1] {
        let mut out = Vec::new();
        bytes::put_varint(&mut out, value);
        assert_eq!(bytes::Cursor::new(&out).varint(), Ok(value));
        assert_eq!(bytes::zigzag(bytes::unzigzag(value)), value);
    }
    assert_eq!(bytes::Cursor::new(&[0xff; 11]).varint(), Err(RecordError::Number));
    let over = [0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 2];
    assert_eq!(bytes::Cursor::new(&over).varint(), Err(RecordError::Number));
}

fn any_number() -> impl Strategy<Value = f64> {
    prop_oneof![any::<u64>().prop_map(f64::from_bits), -500.0..500.0f64, Just(0.0), Just(-0.0)]
}

fn any_array() -> impl Strategy<Value = [f64; MAX_AXES]> {
    prop_oneof![
        proptest::array::uniform3(any_number()).prop_map(|[a, b, c]| [a, b, c, 0.0, 0.0, 0.0, 0.0, 0.0]),
        proptest::array::uniform8(any_number()),
    ]
}

fn any_answer() -> impl Strategy<Value = Answer> {
    let state = || (0..8u8).prop_map(|code| CorrectionState::from_code(code).unwrap());
    let change = (state(), any::<u16>()).prop_map(|(from, cause)| Change { from, cause });
    let numbers = (any_array(), any_array());
    (any::<u32>(), state(), any::<[u8; 5]>(), any::<bool>(), numbers, proptest::option::of(change)).prop_map(
        |(sequence, state, [limited, warning, out_of_range, faded, lag_cycles], stopped, numbers, change)| {
            let (offset, wanted) = numbers;
            Answer {
                sequence,
                state,
                limited,
                warning,
                out_of_range,
                faded,
                lag_cycles,
                stopped,
                offset,
                wanted,
                change,
            }
        },
    )
}

fn any_entry() -> impl Strategy<Value = Entry> {
    let now = || any::<i64>().prop_map(MonoTime::from_ns);
    let frame =
        (any::<u32>(), any::<i64>(), any::<u16>(), any_number(), any_array(), any_array(), any_array())
            .prop_map(|(sequence, control_ns, bits, feed_mm_per_min, commanded, actual, applied)| Position {
                sequence,
                control_ns,
                state: MachineState::from_bits(bits),
                feed_mm_per_min,
                commanded,
                actual,
                applied,
            });
    prop_oneof![
        (now(), frame, any::<bool>(), proptest::option::of(any_answer()))
            .prop_map(|(now, frame, enabled, answer)| Entry::Cycle(Cycle { now, frame, enabled, answer })),
        (now(), any::<bool>(), proptest::option::of(any_answer()))
            .prop_map(|(now, enabled, answer)| Entry::Deadline { now, enabled, answer }),
        now().prop_map(|now| Entry::LinkUp { now }),
        now().prop_map(|now| Entry::Engine { now, hello: hello() }),
        (now(), any::<u8>(), -1.0..1.0f64)
            .prop_map(|(now, code, value)| Entry::Request { now, request: Request { code, value } }),
        (now(), any::<[u8; 32]>()).prop_map(|(now, hash)| Entry::Model { now, hash }),
        (
            now(),
            prop_oneof![any::<u16>().prop_map(u32::from), any::<u32>()],
            proptest::array::uniform32(any_number())
        )
            .prop_map(|(now, told, mut values)| {
                for (_, untold) in values.iter_mut().enumerate().filter(|(k, _)| told >> k & 1 == 0) {
                    *untold = 0.0;
                }
                Entry::Live { now, told, values }
            }),
    ]
}

proptest! {
    #[test]
    fn whatever_the_numbers_are_they_come_back(entries in proptest::collection::vec(any_entry(), 1..60)) {
        let (bytes, _) = file(&entries, 7);
        let (items, notes) = read(&bytes);
        prop_assert_eq!(notes, []);
        prop_assert_eq!(items.len(), entries.len());
        for (item, entry) in items.iter().zip(&entries) {
            let Item::Entry { entry: found, .. } = item else { panic!("{item:?}") };
            prop_assert_eq!(bits(found), bits(entry));
        }
    }

    #[test]
    fn bytes_that_nobody_wrote_do_no_harm(mut bytes in proptest::collection::vec(any::<u8>(), 0..300), cut in 0..2000usize, flip in any::<u8>()) {
        let (mut file, _) = file(&run(20), 5);
        let at = cut % file.len();
        file[at] ^= flip;
        file.splice(at..at, bytes.drain(..));
        if let Ok(recording) = Recording::parse(&file) {
            let _ = recording.reader(0).count();
        }
        // content that passed its check sums and is wrong all the same
        if let Ok(mut decoder) = Decoder::new(file[at.min(16)..].to_vec()) {
            while let Ok(Some(_)) = decoder.next_entry() {}
        }
    }
}

/// The table in `docs/reference/recording.md`: three axes, blocks of 500 cycles.
#[test]
fn a_cycle_takes_few_bytes() {
    let smooth = run(5000);
    let with = |change: fn(u32, f64) -> f64| -> Vec<Entry> {
        let mut entries = smooth.clone();
        for (k, entry) in (0..).zip(&mut entries) {
            if let Entry::Cycle(cycle) = entry {
                for actual in &mut cycle.frame.actual[..3] {
                    *actual = change(k, *actual);
                }
            }
        }
        entries
    };
    // an encoder of 10 nm with 20 nm of noise
    let encoder =
        with(|k, v| ((v * 1e5).round() + f64::from(k.wrapping_mul(2_654_435_761) >> 30) - 2.0) * 1e-5);
    let mut standing = smooth.clone();
    let still = smooth.iter().find_map(|e| if let Entry::Cycle(c) = e { Some(*c) } else { None }).unwrap();
    for entry in &mut standing {
        if let Entry::Cycle(cycle) = entry {
            cycle.frame = Position {
                sequence: cycle.frame.sequence,
                control_ns: cycle.frame.control_ns,
                ..still.frame
            };
            cycle.answer = still.answer.map(|a| Answer { sequence: cycle.frame.sequence, ..a });
        }
    }
    for (name, entries, limit) in
        [("standing still", &standing, 8.0), ("smooth", &smooth, 50.0), ("10 nm encoders", &encoder, 60.0)]
    {
        let per_cycle = file(entries, 500).0.len() as f64 / 5000.0;
        println!("{name}: {per_cycle:.1} bytes a cycle");
        assert!(per_cycle < limit, "{name}: {per_cycle} bytes a cycle");
    }
}

#[test]
fn the_examples_for_fuzzing_are_what_is_written_now() {
    let (bytes, places) = file(&run(40), 20);
    assert!(bytes == include_bytes!("../../../fuzz/corpus/record/short.bin"));
    let torn = include_bytes!("../../../fuzz/corpus/record/torn_in_its_last_block.bin");
    assert!(bytes[..places[1] + 30] == *torn);
    let Found::Block(found, _) = block::look(&bytes[places[0]..]) else { panic!("a block") };
    let content = include_bytes!("../../../fuzz/corpus/record/content_of_a_block.bin");
    assert!(found.content().unwrap() == content);
}
