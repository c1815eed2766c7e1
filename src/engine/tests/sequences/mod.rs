//! Whatever comes in whatever order: random events against the engine, beside a control that behaves like a real one.
//!
//! What is allowed stands in [`judge`] and [`plant`], written from the promises and not from the engine: every answer is
//! finite, within its size, and goes on from the one before within step, rate and acceleration; it may start anew only
//! from what the control holds, at rest, and only where the control may have acted on its own; the offset in force
//! never steps; every change of state is reported; and nothing moves unless somebody has enabled it.

mod every_rule;
mod judge;
mod plant;

use super::*;
use crate::transitions;
use plant::{Damage, Plant};
use volcomp_model::curve::{Fourier, Live};

/// What may happen.
#[derive(Debug, Clone, Copy)]
enum Op {
    Run {
        mm_per_cycle: f64,
        cycles: u8,
    },
    Command(Command),
    State(u16),
    Damaged(Damage, u8),
    Repeat,
    /// A frame comes after the next one.
    Swap,
    Lose(u16),
    /// The daemon stands still.
    Hang(u16),
    /// The control counts its cycles from another number on.
    Recount(u32),
    Clock(i64),
    Model(Kind),
    Tool(f64),
    /// X stands there.
    Place(f64),
    /// Z stands there, far beyond everything.
    Far(f64),
    Live(f64, u8),
    Feed(f64),
    Foreign(f64, u8),
    Link(u16),
}

/// A model.
#[derive(Debug, Clone, Copy)]
enum Kind {
    Constant(f64),
    Wave(f64, f64),
    /// Also from a sensor.
    Live(f64),
    /// With a lever that may overflow.
    Tilt(f64),
}

fn model_of(kind: Kind) -> Model {
    let mut spec = ModelSpec::new("m", Chain::parse("[w b X Y Z t]").unwrap());
    let mut x = AxisSpec::new(AxisName::X);
    x.travel = Some([0.0, 500.0]);
    spec.axes.push(x);
    let mut error =
        |symbol: &str, function| spec.errors.push((ErrorSymbol::parse(symbol).unwrap(), function));
    match kind {
        Kind::Constant(size) => error("exx", ErrorFunction::single(Curve::Constant(size))),
        Kind::Wave(size, wave) => {
            let curve = Fourier::new(0.0, 500.0, wave, 0.0, 0.0, &[], &[size]).unwrap();
            error("exx", ErrorFunction::single(Curve::Fourier(curve)));
            error("eyx", ErrorFunction::single(Curve::Constant(-size)));
        }
        Kind::Live(size) => {
            let live = vec![Live { sensor: "ram".to_owned(), limit: 0.05, reference: None }];
            error("ezz", ErrorFunction { live, ..ErrorFunction::single(Curve::Constant(size)) });
            // nothing to speak of, but for a lever of a kilometre
            error("eax", ErrorFunction::single(Curve::Constant(1e-9)));
        }
        Kind::Tilt(angle) => {
            error("eax", ErrorFunction::single(Curve::Constant(angle)));
            error("ebx", ErrorFunction::single(Curve::Constant(-angle)));
        }
    }
    Model::new(&spec).unwrap()
}

fn carry_out(plant: &mut Plant, op: Op) {
    match op {
        Op::Run { mm_per_cycle, cycles } => {
            for _ in 0..cycles {
                plant.frame.commanded[0] += mm_per_cycle;
                plant.frame.commanded[2] -= 0.3 * mm_per_cycle;
                plant.cycle(Damage::None);
            }
        }
        Op::Command(command) => plant.command(command),
        Op::State(bits) => plant.frame.state = MachineState::from_bits(bits),
        Op::Damaged(damage @ Damage::Number(_), _) => {
            plant.cycle(damage);
            // the control has counted right all along, and enough frames of its own count follow
            (0..6).for_each(|_| plant.cycle(Damage::None));
        }
        Op::Damaged(damage, cycles) => (0..cycles).for_each(|_| plant.cycle(damage)),
        Op::Repeat => {
            let frame = plant.sent;
            plant.deliver(&frame);
        }
        Op::Swap => {
            plant.cycle(Damage::Lost);
            let (older, link) = (plant.sent, plant.links);
            plant.cycle(Damage::None);
            // a new link carries no frame of the old one
            if plant.links == link {
                plant.deliver(&older);
            }
        }
        Op::Lose(cycles) => (0..cycles).for_each(|_| plant.cycle(Damage::Lost)),
        Op::Hang(cycles) => {
            plant.hangs = true;
            (0..cycles).for_each(|_| plant.cycle(Damage::Lost));
            plant.hangs = false;
        }
        Op::Recount(by) => plant.frame.sequence = plant.frame.sequence.wrapping_add(by),
        Op::Clock(ns) => plant.frame.control_ns = plant.frame.control_ns.saturating_add(ns),
        Op::Model(kind) => plant.model(model_of(kind)),
        Op::Tool(z) => plant.tool(z),
        Op::Place(x) => plant.frame.commanded[0] = x,
        Op::Far(z) => plant.frame.commanded[2] = z,
        Op::Live(value, cycles) => {
            for _ in 0..cycles {
                plant.engine.on_live(plant.now, 0, value);
                plant.cycle(Damage::None);
            }
        }
        Op::Feed(feed) => {
            plant.frame.feed_mm_per_min = feed;
            plant.frame.state.bits ^= MachineState::MOVING;
        }
        Op::Foreign(mm, cycles) => {
            plant.foreign = Some(mm);
            (0..cycles).for_each(|_| plant.cycle(Damage::None));
            plant.foreign = None;
        }
        Op::Link(cycles) => plant.link(cycles),
    }
}

fn kinds() -> impl Strategy<Value = Kind> {
    prop_oneof![
        3 => (-0.12..0.12).prop_map(Kind::Constant),
        1 => (-0.5..0.5).prop_map(Kind::Constant),
        3 => ((-0.05..0.05), (5.0..300.0)).prop_map(|(a, w)| Kind::Wave(a, w)),
        2 => (-0.02..0.02).prop_map(Kind::Live),
        2 => (-1e-4..1e-4).prop_map(Kind::Tilt),
    ]
}

fn damages() -> impl Strategy<Value = Damage> {
    prop_oneof![
        Just(Damage::Lost),
        Just(Damage::Nan),
        Just(Damage::AppliedNan),
        (-400.0..400.0).prop_map(Damage::Off),
        any::<i32>().prop_map(Damage::Number),
        (-9..9i32).prop_map(Damage::Number),
    ]
}

/// Offsets that the control reports without having been sent them, mm.
fn foreign_offsets() -> impl Strategy<Value = f64> {
    prop_oneof![6 => -0.06..0.06, 2 => -0.3..0.3, 1 => -2.0..2.0, 1 => Just(1e308), 1 => Just(0.0)]
}

fn ops() -> impl Strategy<Value = Op> {
    let commands = prop_oneof![
        6 => Just(Command::Enable), 2 => Just(Command::Disable), 2 => Just(Command::ClearFault),
        2 => (-0.5..1.5).prop_map(Command::SetGain), 1 => Just(Command::Stop),
        1 => Just(Command::SetGain(f64::NAN)), 1 => Just(Command::KeepFault),
    ];
    prop_oneof![
        10 => ((-0.9..0.9), any::<u8>()).prop_map(|(mm_per_cycle, cycles)| Op::Run { mm_per_cycle, cycles }),
        4 => any::<u8>().prop_map(|cycles| Op::Run { mm_per_cycle: 0.0, cycles }),
        6 => commands.prop_map(Op::Command),
        2 => (0..16u16).prop_map(Op::State),
        4 => Just(Op::State(READY.bits)),
        2 => (damages(), 1..4u8).prop_map(|(d, n)| Op::Damaged(d, n)),
        2 => (damages(), any::<u8>()).prop_map(|(d, n)| Op::Damaged(d, n)),
        1 => Just(Op::Repeat),
        1 => Just(Op::Swap),
        3 => (0..1500u16).prop_map(Op::Lose),
        1 => (0..1500u16).prop_map(Op::Hang),
        1 => any::<u32>().prop_map(Op::Recount),
        1 => prop_oneof![-3_600_000_000_000..3_600_000_000_000i64, -3_000_000..3_000_000i64].prop_map(Op::Clock),
        3 => kinds().prop_map(Op::Model),
        2 => prop_oneof![8 => -200.0..0.0, 1 => Just(f64::MAX), 1 => Just(f64::MIN)].prop_map(Op::Tool),
        1 => prop_oneof![8 => Just(0.0), 1 => Just(f64::MAX), 1 => Just(f64::MIN)].prop_map(Op::Far),
        2 => ((-0.08..0.08), any::<u8>()).prop_map(|(v, n)| Op::Live(v, n)),
        1 => (0.0..20_000.0).prop_map(Op::Feed),
        2 => (foreign_offsets(), any::<u8>()).prop_map(|(v, n)| Op::Foreign(v, n)),
        1 => (0..800u16).prop_map(Op::Link),
    ]
}

fn limits() -> impl Strategy<Value = AxisLimits> {
    (0.005..0.1, 0.1..2.0, 2.0..40.0, prop_oneof![Just(1.0), 0.0002..0.004]).prop_map(
        |(size, rate, acceleration, step)| AxisLimits {
            warning: 0.5 * size,
            size,
            stop: 3.0 * size,
            rate,
            acceleration,
            step,
        },
    )
}

fn configs() -> impl Strategy<Value = EngineConfig> {
    let x_only = any::<bool>();
    let ways = (any::<bool>(), any::<bool>(), any::<bool>());
    (
        limits(),
        limits(),
        x_only,
        ways,
        (0.02..0.4, 0.0..0.3),
        prop_oneof![Just(Lag::Measured), (0.0..5.0).prop_map(Lag::Cycles)],
    )
        .prop_map(|(x, z, x_only, (hold, out, actual), (ramp_s, hold_s), lag)| {
            let never = AxisLimits { size: 0.0, ..LIMITS };
            EngineConfig {
                limits: vec![x, if x_only { never } else { LIMITS }, z],
                soft_limits: vec![[-200.0, 200.0], [-1e4, 1e4], [f64::NEG_INFINITY, f64::INFINITY]],
                rest: if hold { RestOffset::Hold } else { RestOffset::Zero },
                out_of_travel: if out { OutOfTravel::RampOut } else { OutOfTravel::Hold },
                position_source: if actual { PositionSource::Actual } else { PositionSource::Commanded },
                ramp_s,
                hold_s,
                after_loss: if hold == out { AfterLoss::Latch } else { AfterLoss::Resume },
                lag,
                ..config()
            }
        })
}

proptest! {
    #[test]
    fn no_sequence_of_events_breaks_a_promise(
        config in configs(), kind in kinds(), delay in 1..5u32, list in prop::collection::vec(ops(), 1..60),
    ) {
        let mut plant = Plant::new(&config, model_of(kind), delay);
        for op in list {
            carry_out(&mut plant, op);
        }
        for seen in plant.transitions {
            prop_assert!(transitions::all().any(|t| t == seen), "{seen:?} is not among the rules");
        }
    }
}
