//! A million cycles of a link session, from message to correction, without one allocation.

#![allow(clippy::expect_used, reason = "a test program: it fails by panicking")]

use std::path::Path;
use std::sync::Arc;

use assert_no_alloc::assert_no_alloc;
use volcomp::daemon::{LinkSession, Loaded, Reaction, live_ends, load, tap};
use volcomp::engine::Command;
use volcomp::estimate::NodeGrid;
use volcomp::estimate::live::LiveTable;
use volcomp::estimate::live::table::{Source, TableMap};
use volcomp::model::axes::MAX_AXES;
use volcomp::model::geometry::Vec3;
use volcomp::model::units::MonoTime;
use volcomp::model::{DynamicTerm, ErrorFunction, ErrorSymbol, Law, Model, SENSORS_MAX, ToolErrors};
use volcomp::protocol::{
    Axis, AxisUnit, ControlHello, CorrectionState, FrameReader, Heartbeat, MAX_FRAME, MachineState, Message,
    Name, PROTOCOL_VERSION, Position, Tool, encode,
};

const CYCLES: u32 = 1_000_000;
const CYCLE_NS: i64 = 1_000_000;

fn hello(loaded: &Loaded) -> ControlHello {
    let axis = |k: usize| {
        let name = loaded.config.axes[k.min(loaded.config.axes.len() - 1)].name;
        Axis { name, unit: AxisUnit::Millimetre }
    };
    ControlHello {
        version: PROTOCOL_VERSION,
        machine: Name::new(&loaded.config.machine),
        software: Name::new("test"),
        cycle_ns: CYCLE_NS.unsigned_abs(),
        axis_count: u8::try_from(loaded.config.axes.len()).expect("few axes"),
        axes: std::array::from_fn(axis),
    }
}

/// A slow tour through the working volume, with everything that can go wrong now and then.
fn message(cycle: u32, applied: [f64; MAX_AXES]) -> Message {
    let phase = f64::from(cycle) * 1e-4;
    let mut commanded = [0.0; MAX_AXES];
    commanded[0] = 200.0 + 150.0 * phase.sin();
    commanded[1] = 200.0 + 150.0 * (0.7 * phase).sin();
    commanded[2] = -250.0 + 150.0 * (0.3 * phase).sin();
    let mut bits = MachineState::HOMED | MachineState::ENABLED;
    match cycle {
        c if c % 100_003 < 50 => bits |= MachineState::ESTOP,
        c if c % 70_001 == 0 => commanded[0] = f64::NAN,
        c if c % 50_021 == 0 => {
            return Message::Tool(Tool { number: c, tip: [0.0, 0.0, f64::from(c % 7)] });
        }
        c if c % 997 == 0 => return Message::Heartbeat(Heartbeat::default()),
        _ => {}
    }
    Message::Position(Position {
        sequence: cycle,
        control_ns: i64::from(cycle) * CYCLE_NS,
        state: MachineState::from_bits(bits),
        feed_mm_per_min: 1000.0,
        commanded,
        actual: commanded,
        applied,
    })
}

#[test]
fn a_million_cycles_allocate_nothing() {
    let loaded = example();
    let model = Arc::clone(&loaded.model.model);
    cycles_allocate_nothing(&loaded, model, CYCLES);
}

/// Every law on every linear axis, and errors of the tool.
#[test]
fn terms_that_follow_motion_allocate_nothing() {
    let loaded = example();
    let mut spec = loaded.model.spec.clone();
    spec.gauge_point = Some(Vec3::zeros());
    spec.tool = ToolErrors { tilt: [1e-5, -2e-5], length: 1e-4 };
    let laws = [
        (Law::Reversal { build_up: 0.2 }, 0.004),
        (Law::FrictionPeak { rise_s: 0.002, fall_s: 0.02 }, 0.002),
        (Law::Friction { speed: 0.1 }, 0.001),
        (Law::Velocity, -1e-4),
        (Law::Acceleration, 1e-6),
    ];
    for symbol in ["exx", "eyy", "ezz"].map(|s| ErrorSymbol::parse(s).expect("a symbol")) {
        let terms = laws.map(|(law, gain)| DynamicTerm { law, gain, growth: 1e-4, limit: 0.01 });
        if !spec.errors.iter().any(|(s, _)| *s == symbol) {
            spec.errors.push((symbol, ErrorFunction::default()));
        }
        for (_, function) in spec.errors.iter_mut().filter(|(s, _)| *s == symbol) {
            function.dynamics.extend(terms);
        }
    }
    let model = Arc::new(Model::new(&spec).expect("a model"));
    assert!(model.has_transients() && model.dynamics().len() == 15);
    cycles_allocate_nothing(&loaded, model, CYCLES / 4);
}

fn example() -> Loaded {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("config/examples/vmc-850/machine.toml");
    load(&file).expect("the example loads")
}

fn cycles_allocate_nothing(loaded: &Loaded, model: Arc<Model>, cycles: u32) {
    let hello = hello(loaded);
    let config = loaded.config.engine_config(&hello).expect("the hello fits");
    let mut other = Arc::new((*model).clone());
    let mut session = LinkSession::new(&config, model).expect("an engine");
    let mut reader = FrameReader::default();
    let mut buffer = [0; MAX_FRAME];
    let mut applied = [0.0; MAX_AXES];
    // the recording is on the cycle, too: its queue is emptied now and then, so that both full and not are met
    let (tap, entries) = tap(64);
    session.record_to(tap, MonoTime::ZERO, &hello);
    let mut recorded = 0_u32;
    let (mut answers, mut active, mut stale) = (0_u32, 0_u32, 0_u32);
    assert_no_alloc(|| {
        session.command(MonoTime::ZERO, Command::Enable);
        session.link_up(MonoTime::ZERO);
        for cycle in 1..=cycles {
            let now = MonoTime::from_ns(i64::from(cycle) * CYCLE_NS);
            if cycle % 30_011 == 0 {
                // a silence: hold and ramp out on the daemon's own clock
                let mut silent = now;
                for _ in 0..50 {
                    silent = session.next_deadline().map_or(silent, |due| due.max(silent));
                    if let Some(correction) = session.deadline(silent) {
                        applied = correction.offset;
                        stale += 1;
                    }
                }
            }
            // over the wire format, as in the daemon
            let length = encode(&message(cycle, applied), &mut buffer);
            reader.space()[..length].copy_from_slice(&buffer[..length]);
            reader.advance(length);
            let Ok(Some(received)) = reader.next() else { continue };
            if cycle % 3 == 0 {
                session.live(now, 0, 1e-6);
            }
            if cycle % 40_009 == 0 {
                let old = session.switch_model(now, Arc::clone(&other), [1; 32]).expect("the same axes");
                other = old;
            }
            if let Reaction::Answer(correction) = session.handle(now, &received) {
                applied = correction.offset;
                answers += 1;
                active += u32::from(correction.state == CorrectionState::Active);
            }
            session.record();
            if let Some(correction) = session.deadline(now) {
                applied = correction.offset;
            }
            if cycle % 100 == 0 {
                while entries.try_recv().is_ok() {
                    recorded += 1;
                }
            }
        }
    });
    assert!(recorded > cycles / 2, "{recorded} entries recorded");
    assert!(answers > cycles / 100 * 99, "{answers} answers");
    assert!(active > cycles / 2, "{active} cycles active: the model must have been at work");
    assert!(stale > cycles / 2000, "{stale} answers to silence");
    assert!(applied.iter().any(|offset| *offset != 0.0));
}

/// A table of a map and of single values, made at `made`.
fn table(made: MonoTime, level: f64) -> Arc<LiveTable> {
    let grid = NodeGrid::new(vec![0.0, 200.0, 400.0], vec![0.0, 400.0], vec![-500.0, 0.0]).expect("a grid");
    let values = (0..6 * grid.nodes()).map(|n| level * n as f64).collect();
    let mut sources = [Source::Value { value: level, heard: made }; SENSORS_MAX];
    for (component, source) in sources.iter_mut().enumerate().take(6) {
        *source = Source::Map { map: 0, component };
    }
    sources[15] = Source::None;
    let maps = vec![Arc::new(TableMap { grid, values })];
    Arc::new(LiveTable { model: [1; 32], made, sources, maps })
}

#[test]
fn live_tables_are_swapped_and_evaluated_without_allocation() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("config/examples/vmc-850/machine.toml");
    let loaded = load(&file).expect("the example loads");
    let hello = hello(&loaded);
    let config = loaded.config.engine_config(&hello).expect("the hello fits");
    let mut session = LinkSession::new(&config, loaded.model.model).expect("an engine");
    let (mut live, estimator) = live_ends([1; 32]);
    let (tap, entries) = tap(64);
    session.record_to(tap, MonoTime::ZERO, &hello);
    live.link_up(&hello);
    let second = |k: u32| MonoTime::from_ns(i64::from(k) * 1_000_000_000);
    // the estimator's side: tables made beside the cycle and kept until they are out of use
    let tables: Vec<Arc<LiveTable>> = (0..100).map(|k| table(second(k), 1e-6 * f64::from(k))).collect();
    let (mut told, mut positions) = (0_u32, 0_u32);
    assert_no_alloc(|| {
        session.link_up(MonoTime::ZERO);
        for cycle in 1..100_000_u32 {
            let now = MonoTime::from_ns(i64::from(cycle) * CYCLE_NS);
            if cycle % 1000 == 1 {
                let table = &tables[(cycle / 1000) as usize];
                estimator.tables.try_send(Arc::clone(table)).expect("room");
            }
            let Message::Position(frame) = message(cycle, [0.0; MAX_AXES]) else { continue };
            let _ = session.handle(now, &Message::Position(frame));
            session.record();
            live.after(now, &frame, &mut session);
            while estimator.motions.try_recv().is_ok() {
                positions += 1;
            }
            while let Ok(entry) = entries.try_recv() {
                told += u32::from(matches!(entry, volcomp::protocol::record::Entry::Live { .. }));
            }
        }
    });
    assert!(positions > 99_000, "{positions}");
    assert!(told > 9_000, "{told} times live values were told");
    assert!(tables.iter().filter(|table| Arc::strong_count(table) > 1).count() == 1, "one is in use");
}
