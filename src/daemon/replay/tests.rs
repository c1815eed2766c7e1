//! Links with everything that an engine can be told, recorded and replayed; with gaps, forgeries and other models.

use std::collections::VecDeque;
use std::path::Path;

use super::*;
use crate::{Loaded, load, tap};
use volcomp_engine::{Lag, PositionSource};
use volcomp_protocol::record::{Decoded, Decoder, Encoder, Request, block};
use volcomp_protocol::{Axis, AxisUnit, MachineState, Name, PROTOCOL_VERSION, Position, Tool};
use volcomp_units::axes::{AxisArray, MAX_AXES};

const CYCLE_NS: i64 = 1_000_000;

fn loaded() -> Loaded {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/examples/vmc-850/machine.toml");
    load(&file).expect("the example loads")
}

fn hello(loaded: &Loaded) -> ControlHello {
    let axes = &loaded.config.axes;
    let axis = |k: usize| Axis { name: axes[k.min(axes.len() - 1)].name, unit: AxisUnit::Millimetre };
    ControlHello {
        version: PROTOCOL_VERSION,
        machine: Name::new(&loaded.config.machine),
        software: Name::new("test"),
        cycle_ns: CYCLE_NS.unsigned_abs(),
        axis_count: u8::try_from(axes.len()).expect("few"),
        axes: std::array::from_fn(axis),
    }
}

/// The machine with another machine file and model, made from the example's.
fn machine(change: impl FnOnce(&mut MachineConfig), errors: &str) -> Loaded {
    let mut loaded = loaded();
    change(&mut loaded.config);
    loaded.model.text.push_str(errors);
    loaded.model.model = model(&loaded.model.text);
    loaded
}

fn model(text: &str) -> Arc<Model> {
    let spec = volcomp_config::model::parse("model", text).expect("valid");
    Arc::new(Model::new(&spec).expect("a model"))
}

/// One cycle before it happens; a script changes it.
struct Turn<'a> {
    cycle: u32,
    now: MonoTime,
    session: &'a mut LinkSession,
    commanded: AxisArray,
    bits: u16,
    feed_mm_per_min: f64,
    /// Read-backs to come, the next one first.
    applied: &'a mut VecDeque<AxisArray>,
}

/// A link whose control applies an offset `lag` cycles after the position that it answers; everything that was
/// recorded, once through bytes.
fn play(loaded: &Loaded, cycles: u32, lag: usize, mut script: impl FnMut(&mut Turn<'_>)) -> Vec<Item> {
    let hello = hello(loaded);
    let engine = loaded.config.engine_config(&hello).expect("fits");
    let mut session = LinkSession::new(&engine, Arc::clone(&loaded.model.model)).expect("an engine");
    let (tap, entries) = tap(8 * cycles as usize);
    session.record_to(tap, MonoTime::ZERO, &hello);
    session.link_up(MonoTime::ZERO);
    session.command(MonoTime::ZERO, Command::Enable);
    let mut applied = VecDeque::from(vec![[0.0; MAX_AXES]; lag]);
    for cycle in 1..=cycles {
        let phase = f64::from(cycle) * 1e-3;
        let mut commanded = [0.0; MAX_AXES];
        commanded[0] = 200.0 + 150.0 * phase.sin();
        commanded[1] = 200.0 + 150.0 * (0.7 * phase).sin();
        commanded[2] = -250.0 + 150.0 * (0.3 * phase).sin();
        let mut turn = Turn {
            cycle,
            now: MonoTime::from_ns(i64::from(cycle) * CYCLE_NS + i64::from(cycle % 17) * 1000),
            session: &mut session,
            commanded,
            bits: MachineState::HOMED | MachineState::ENABLED,
            feed_mm_per_min: 9000.0,
            applied: &mut applied,
        };
        script(&mut turn);
        let Turn { now, commanded, bits, feed_mm_per_min, .. } = turn;
        let read_back = applied.pop_front().expect("one per cycle");
        let frame = Position {
            sequence: cycle,
            control_ns: i64::from(cycle) * CYCLE_NS,
            state: MachineState::from_bits(bits),
            feed_mm_per_min,
            commanded,
            actual: std::array::from_fn(|k| commanded[k] + read_back[k]),
            applied: read_back,
        };
        let sent = match session.handle(now, &Message::Position(frame)) {
            Reaction::Answer(correction) => correction.offset,
            _ => read_back,
        };
        applied.push_back(sent);
        session.record();
    }
    drop(session);
    through_bytes(&entries.try_iter().collect::<Vec<_>>())
}

/// What a reader finds of these entries.
fn through_bytes(entries: &[Entry]) -> Vec<Item> {
    let mut encoder = Encoder::new();
    let mut items = Vec::new();
    for part in entries.chunks(700) {
        part.iter().for_each(|entry| encoder.push(entry));
        let sealed = encoder.seal().expect("entries");
        let block::Found::Block(found, _) = block::look(&sealed) else { panic!("a block") };
        let mut decoder = Decoder::new(found.content().expect("sound")).expect("sound");
        while let Some(decoded) = decoder.next_entry().expect("sound") {
            let Decoded::Entry(entry) = decoded else { panic!("{decoded:?}") };
            items.push(Item::Entry { record: items.len() as u64, entry });
        }
    }
    items
}

/// A link with emergency stop, bad positions, gain, tool, silence and a new link.
fn record(loaded: &Loaded, cycles: u32) -> Vec<Item> {
    play(loaded, cycles, 1, |turn| {
        let Turn { cycle, now, session, commanded, bits, applied, .. } = turn;
        match cycle {
            7_000..7_050 => *bits |= MachineState::ESTOP,
            11_000 => commanded[0] = f64::NAN,
            14_000 => session.command(*now, Command::SetGain(0.5)),
            16_000 => {
                let tool = Tool { number: 2, tip: [0.0, 0.0, -80.0] };
                let _ = session.handle(*now, &Message::Tool(tool));
            }
            18_000 => {
                for _ in 0..30 {
                    *now = session.next_deadline().map_or(*now, |due| due.max(*now));
                    if let Some(correction) = session.deadline(*now) {
                        applied[0] = correction.offset;
                    }
                }
            }
            20_000 => {
                session.link_down(*now);
                session.link_up(*now);
            }
            _ => {}
        }
    })
}

fn replay(loaded: &Loaded, items: &[Item]) -> Report {
    replay_with(loaded, &[], items)
}

fn replay_with(loaded: &Loaded, models: &[([u8; 32], Arc<Model>)], items: &[Item]) -> Report {
    let mut replay = Replay::new(loaded.config.clone(), Arc::clone(&loaded.model.model));
    for (hash, model) in models {
        replay.add_model(*hash, Arc::clone(model));
    }
    items.iter().for_each(|item| replay.feed(item));
    replay.finish()
}

/// Every answer in its order.
fn answers(items: &[Item]) -> impl Iterator<Item = Answer> {
    items.iter().filter_map(|item| match item {
        Item::Entry {
            entry: Entry::Cycle(Cycle { answer, .. }) | Entry::Deadline { answer, .. }, ..
        } => *answer,
        _ => None,
    })
}

/// Every cause of a change of state, in order.
fn causes(items: &[Item]) -> Vec<u16> {
    answers(items).filter_map(|answer| answer.change).map(|change| change.cause).collect()
}

/// Every cycle is compared, and comes out the same.
#[track_caller]
fn all_the_same(report: &Report) {
    assert_eq!((report.differing, report.differences.len()), (0, 0), "{:?}", report.differences);
    assert_eq!(report.compared, report.cycles);
    assert!(report.gaps.is_empty() && report.refused.is_empty(), "{:?}", report.refused);
}

/// The same with the items from `from` to `to` missing.
fn with_gap(items: &[Item], from: usize, to: usize) -> Vec<Item> {
    let mut context = Context::default();
    for item in &items[..to] {
        if let Item::Entry { entry, .. } = item {
            context.follow(entry);
        }
    }
    let gap = Item::Gap { record: to as u64, dropped: (to - from) as u64, context };
    [&items[..from], &[gap], &items[to..]].concat()
}

#[test]
fn the_same_inputs_give_the_same_corrections_bit_for_bit() {
    let loaded = loaded();
    let items = record(&loaded, 24_000);
    let report = replay(&loaded, &items);
    all_the_same(&report);
    assert!(report.compared > 24_000, "{}", report.compared);
}

#[test]
fn the_lag_is_measured_in_the_replay_as_it_was() {
    let loaded = loaded();
    let items = play(&loaded, 12_000, 4, |_| ());
    let lags: Vec<u8> = answers(&items).map(|answer| answer.lag_cycles).collect();
    assert!(lags[0] == 0 && lags[11_999] == 4, "{lags:?}");
    all_the_same(&replay(&loaded, &items));
    // an engine that looks less far ahead corrects otherwise
    let other = machine(|config| config.engine.lag = Lag::Cycles(1.0), "");
    assert!(replay(&other, &items).differing > 1_000);
}

#[test]
fn harmonics_fade_in_the_replay_as_they_did() {
    // 150 mm/s and half a cycle of doubt are 0.08 mm: a wave of 0.4 mm cannot be placed
    let wave = "[[errors.exx.fourier]]\norigin-mm = 0\nspan-mm = 850\nperiod-mm = 0.4\nsin-um = [1.0]\n";
    let text = loaded().model.text;
    let at = text.find("[[errors.exx.fourier]]").expect("in the example");
    let mut loaded = loaded();
    loaded.model.model = model(&[&text[..at], wave, &text[at..]].concat());
    let items = play(&loaded, 6_000, 2, |_| ());
    let faded = answers(&items).filter(|answer| answer.faded & 1 == 1).count();
    assert!((1_000..6_000).contains(&faded), "{faded} cycles faded");
    all_the_same(&replay(&loaded, &items));
}

const LIVE: &str = "\n[errors.exx.live]\nsensor = \"ram\"\nlimit-um = 50\n\
                    [errors.eyx.live]\nsensor = \"column\"\nlimit-um = 50\n";

/// Two sensors at different rates; the second falls silent for a while.
fn send_live_values(turn: &mut Turn<'_>) {
    let value = |rate: f64| 0.01 * (f64::from(turn.cycle) * rate).sin();
    turn.session.live(turn.now, 0, value(1e-3));
    if turn.cycle.is_multiple_of(3) && !(5_000..9_000).contains(&turn.cycle) {
        turn.session.live(turn.now, 1, value(2e-3));
    }
    if turn.cycle == 4_000 {
        turn.session.live(turn.now, 1, f64::NAN);
        turn.session.live(turn.now, 99, 1.0);
    }
}

#[test]
fn live_values_and_the_fading_to_the_static_model_are_replayed() {
    let loaded = machine(|_| (), LIVE);
    let items = play(&loaded, 14_000, 2, send_live_values);
    let fading = answers(&items).filter(|a| a.state == State::FadingToStatic).count();
    assert!(fading > 1_000, "{fading} cycles fading");
    assert!(causes(&items).contains(&8001), "{:?}", causes(&items));
    all_the_same(&replay(&loaded, &items));
    // they are inputs: without them it comes out otherwise
    let is_live = |item: &&Item| !matches!(item, Item::Entry { entry: Entry::Live { .. }, .. });
    let without: Vec<Item> = items.iter().filter(is_live).copied().collect();
    assert_eq!(items.len() - without.len(), 14_000, "one entry for all that is told at a time");
    assert!(replay(&loaded, &without).differing > 5_000);
}

#[test]
fn switches_to_another_model_are_replayed_with_its_text() {
    let loaded = loaded();
    let text = loaded.model.text.replace("[-11.5, -5.5]", "[-3.5, 4.5]") + LIVE;
    let other = ([5; 32], model(&text));
    let first = ([6; 32], Arc::clone(&loaded.model.model));
    let items = play(&loaded, 12_000, 2, |turn| {
        let to = match turn.cycle {
            4_000 => &other,
            8_000 => &first,
            _ => return,
        };
        let _ = turn.session.switch_model(turn.now, Arc::clone(&to.1), to.0).expect("the same axes");
    });
    assert_eq!(causes(&items).iter().filter(|cause| **cause == 1005).count(), 2, "{:?}", causes(&items));
    all_the_same(&replay_with(&loaded, &[first.clone(), other.clone()], &items));
    // with the gap over the switch the context tells the model
    let report = replay_with(&loaded, &[first, other], &with_gap(&items, 3_900, 4_500));
    assert_eq!(report.differing, 0, "{:?}", report.differences);
    assert!(report.gaps[0].caught_up.is_some_and(|cycles| cycles < 3_000), "{:?}", report.gaps);
    // a text that is nowhere is said, and nothing is compared with the wrong model
    let report = replay(&loaded, &items);
    assert_eq!((report.differing, report.refused.len()), (0, 2), "{:?}", report.refused);
    assert!(report.refused[0].1.contains("0505050505") && report.compared < 4_100);
}

#[test]
fn soft_limits_and_changes_of_gain_are_replayed() {
    let loaded = machine(|config| config.axes[0].soft_limits = [55.0, 345.0], "");
    let items = play(&loaded, 14_000, 3, |turn| {
        let gain = match turn.cycle {
            4_000 => 0.25,
            7_000 => 1.0,
            10_000 => 0.0,
            11_000 => 0.75,
            _ => return,
        };
        turn.session.command(turn.now, Command::SetGain(gain));
    });
    let limited = answers(&items).filter(|answer| answer.limited & 1 == 1).count();
    assert!(limited > 100, "{limited} cycles at the soft limit");
    all_the_same(&replay(&loaded, &items));
    let free = machine(|config| config.axes[0].soft_limits = [f64::NEG_INFINITY, f64::INFINITY], "");
    assert!(replay(&free, &items).differing > 100);
}

#[test]
fn faults_are_replayed_with_their_numbers() {
    // the machine says that it moves and does not; somebody else writes the offset
    let loaded = loaded();
    let mut stuck = None;
    let items = play(&loaded, 12_000, 1, |turn| match turn.cycle {
        3_000..3_020 => {
            turn.commanded = *stuck.get_or_insert(turn.commanded);
            turn.bits |= MachineState::MOVING;
        }
        6_000 => turn.commanded[0] += 100.0,
        9_000.. => turn.applied[0][1] += 0.5,
        _ => {}
    });
    let found = causes(&items);
    for cause in [3006, 3003] {
        assert!(found.contains(&cause), "{cause} of {found:?}");
    }
    // after VC-4001 nothing is sent: the frames are recorded without an answer, and replayed without one
    let answered = answers(&items).count();
    assert!((9_000..9_100).contains(&answered), "{answered}");
    all_the_same(&replay(&loaded, &items));

    // the stop limit of an axis
    let tight = machine(|config| config.axes[0].limits.stop = 0.008, "");
    let items = play(&tight, 6_000, 1, |_| ());
    assert!(causes(&items).contains(&4004), "{:?}", causes(&items));
    all_the_same(&replay(&tight, &items));
    assert!(replay(&loaded, &items).differing > 100);
}

#[test]
fn after_a_gap_lag_live_values_and_model_are_taken_up_again() {
    for source in [PositionSource::Commanded, PositionSource::Actual] {
        let loaded = machine(|config| config.engine.position_source = source, LIVE);
        let other = ([5; 32], model(&loaded.model.text.replace("[-11.5, -5.5]", "[-3.5, 4.5]")));
        let items = play(&loaded, 20_000, 4, |turn| {
            send_live_values(turn);
            if turn.cycle == 2_000 {
                let switched = turn.session.switch_model(turn.now, Arc::clone(&other.1), other.0);
                let _ = switched.expect("the same axes");
            }
        });
        // two entries a cycle; before the lag is known, in steady work, over the loss of a sensor
        for (from, to) in [(20, 30), (7_000, 7_800), (9_900, 12_400)] {
            let report = replay_with(&loaded, std::slice::from_ref(&other), &with_gap(&items, from, to));
            let differences = &report.differences;
            assert_eq!(report.differing, 0, "{source:?}, gap {from}..{to}: {differences:?}");
            let caught_up = report.gaps[0].caught_up;
            assert!(
                caught_up.is_some_and(|cycles| cycles < 9_000),
                "{source:?}, gap {from}..{to}: {caught_up:?}"
            );
        }
    }
}

#[test]
fn the_last_bit_of_one_offset_is_found_with_its_place_and_both_values() {
    let loaded = loaded();
    let mut items = record(&loaded, 6_000);
    let Some(Item::Entry { entry: Entry::Cycle(cycle), .. }) = items.get_mut(5_000) else {
        panic!("a cycle")
    };
    let sequence = cycle.frame.sequence;
    let answer = cycle.answer.as_mut().expect("answered");
    let before = answer.offset[1];
    assert!(before != 0.0);
    answer.offset[1] = f64::from_bits(before.to_bits() ^ 1);
    let forged = format!("{:?}", answer.offset[1]);
    let report = replay(&loaded, &items);
    assert_eq!(report.differing, 1);
    let expected = Difference {
        record: 5_000,
        sequence: Some(sequence),
        what: "offset",
        axis: Some(AxisName::Y),
        recorded: forged,
        replayed: format!("{before:?}"),
    };
    assert_eq!(report.differences, [expected]);
    assert!(report.largest > 0.0 && report.largest < 1e-15);
}

#[test]
fn another_model_is_not_the_same() {
    let loaded = loaded();
    let items = record(&loaded, 6_000);
    let mut spec = volcomp_config::model::parse("other", &loaded.model.text).expect("valid");
    spec.errors.clear();
    let model = Arc::new(Model::new(&spec).expect("a model without errors"));
    let mut replay = Replay::new(loaded.config, model);
    items.iter().for_each(|item| replay.feed(item));
    assert!(replay.finish().differing > 1000);
}

#[test]
fn after_a_gap_the_engine_catches_up_and_then_agrees_bit_for_bit() {
    let loaded = loaded();
    let items = record(&loaded, 24_000);
    // in the middle of steady work; over the change of gain; over the e-stop; over the new link
    for (from, to) in [(4_000, 4_500), (13_900, 14_500), (6_990, 7_100), (19_900, 20_200)] {
        let report = replay(&loaded, &with_gap(&items, from, to));
        assert_eq!(report.differing, 0, "gap {from}..{to}: {:?}", report.differences);
        let [gap] = report.gaps[..] else { panic!("{:?}", report.gaps) };
        assert_eq!(gap.dropped, (to - from) as u64);
        let cycles = gap.caught_up.expect("caught up");
        assert!(cycles < 5_000, "gap {from}..{to}: {cycles} cycles");
        let lost = report.cycles - report.compared;
        assert_eq!(lost, cycles, "all else is compared");
    }
}

#[test]
fn what_cannot_be_repeated_is_said_and_not_compared() {
    let loaded = loaded();
    let mut items = record(&loaded, 2_000);
    let now = MonoTime::from_ns(1);
    let request = Request { code: 99, value: 0.0 };
    items.insert(1_000, Item::Entry { record: 1_000, entry: Entry::Request { now, request } });
    let report = replay(&loaded, &items);
    assert_eq!((report.differing, report.refused.len()), (0, 1));
    assert!(report.refused[0].1.contains("code 99"), "{:?}", report.refused);
    assert!(report.compared < 1_000);
    items[1_000] = Item::Unknown { record: 1_000, tag: 201 };
    assert!(replay(&loaded, &items).refused[0].1.contains("kind 201"));
    items[1_000] = Item::Unknown { record: 1_000, tag: 20 };
    let report = replay(&loaded, &items);
    assert_eq!((report.refused.len(), report.compared), (0, 2_000));
}
