//! From every state, after every command, everything that can happen: each rule of [`transitions`] is met, and no other
//! change of state occurs.

use std::collections::BTreeSet;

use super::super::*;
use super::plant::{Damage, Plant};
use super::{Kind, Op, carry_out, model_of, transitions};

const ALL_FRAMES: u8 = u8::MAX;

/// Ways into each state, with a sensor in use.
fn beginnings() -> Vec<Vec<Op>> {
    let enable = Op::Command(Command::Enable);
    let still = |cycles| Op::Run { mm_per_cycle: 0.0, cycles };
    let live = Op::Live(0.004, ALL_FRAMES);
    let active = vec![enable, live, live, live];
    let and = |begin: &[Op], more: &[Op]| [begin, more].concat();
    vec![
        // off, with and without an offset that somebody has left; armed, the same
        vec![still(20)],
        vec![Op::Foreign(0.004, 1)],
        vec![Op::State(0), enable, still(20)],
        vec![Op::State(0), Op::Foreign(0.004, 1), enable, still(1), Op::State(READY.bits)],
        vec![enable, Op::Foreign(0.004, 1)],
        // armed with good data, for nothing is measured there
        vec![Op::Place(500.3), enable, still(20)],
        // ramping in, early and late
        vec![enable, Op::Live(0.004, 20)],
        vec![enable, Op::Live(0.004, 80)],
        active.clone(),
        and(&active, &[still(120)]),
        // holding: the machine, the data, an axis that is not homed
        and(&active, &[Op::State(0), still(5), Op::State(READY.bits)]),
        and(&active, &[Op::Damaged(Damage::Nan, 1), still(3)]),
        and(&active, &[Op::Damaged(Damage::Nan, 1), still(9)]),
        // ramping out: told to, and because nothing is measured there
        and(&active, &[Op::Command(Command::Disable), still(10)]),
        and(&active, &[Op::Command(Command::Disable), still(200)]),
        and(&active, &[Op::Place(500.3), still(60)]),
        // faulted, on the way and at zero
        and(&active, &[Op::Foreign(0.002, 40)]),
        and(&active, &[Op::Foreign(0.002, 40), still(ALL_FRAMES), still(ALL_FRAMES)]),
    ]
}

fn commands() -> Vec<Vec<Op>> {
    let command = |c| vec![Op::Command(c)];
    vec![
        vec![],
        command(Command::Enable),
        command(Command::Disable),
        command(Command::Stop),
        command(Command::ClearFault),
        command(Command::KeepFault),
    ]
}

/// What happens then.
fn happenings() -> Vec<Vec<Op>> {
    let mut list: Vec<Vec<Op>> = vec![
        vec![],
        // just beyond the travel, without a jump; and the same with one
        vec![Op::Place(500.3)],
        vec![Op::Place(600.0)],
        vec![Op::State(0)],
        vec![Op::State(MachineState::HOMED)],
        vec![Op::State(MachineState::ENABLED)],
        vec![Op::State(READY.bits | MachineState::ESTOP)],
        vec![Op::Lose(400)],
        vec![Op::Hang(160)],
        vec![Op::Hang(400)],
        vec![Op::Foreign(0.003, 40)],
        // after a gap the report counts, and this one cannot be right
        vec![Op::Lose(5), Op::Foreign(1.0, 3)],
        vec![Op::Link(5)],
        vec![Op::Link(400)],
        vec![Op::Tool(-50.0)],
        vec![Op::Model(Kind::Constant(-0.003))],
        vec![Op::Model(Kind::Live(1.0))],
        vec![Op::Model(Kind::Live(0.003)), Op::Run { mm_per_cycle: 0.0, cycles: 120 }],
        // the feed says that it moves, and it does not
        vec![Op::Feed(6000.0)],
        vec![Op::Far(f64::MAX)],
        vec![Op::Far(1e9)],
        vec![Op::Clock(-1_000_000_000)],
        vec![Op::Live(0.004, 60)],
        // bad data until just before the hold time ends, then none
        vec![Op::Damaged(Damage::Nan, 49), Op::Lose(60)],
    ];
    for damage in [Damage::Nan, Damage::Off(400.0)] {
        list.push(vec![Op::Damaged(damage, 1)]);
        list.push(vec![Op::Damaged(damage, ALL_FRAMES)]);
    }
    let one = Op::Run { mm_per_cycle: 0.0, cycles: 1 };
    list.push([Op::Far(f64::MAX), one, Op::Far(0.0), one].repeat(60));
    // alternately here and there, so that every frame is a jump; or with a clock that never fits
    list.push([Op::Damaged(Damage::Off(400.0), 1), one].repeat(100));
    list.push([Op::Clock(-3_000_000), one].repeat(200));
    list
}

fn plants() -> Vec<EngineConfig> {
    let soft = EngineConfig { ramp_s: 0.1, hold_s: 0.05, out_of_travel: OutOfTravel::RampOut, ..config() };
    // where no jump is too far, what the model makes of it may be no number
    let boundless = EngineConfig { jump_limit: vec![f64::MAX; 3], ..soft.clone() };
    // every answer must be read back with the next frame
    let strict = EngineConfig { read_back_cycles: 1, ..soft.clone() };
    let forgiving = EngineConfig { after_loss: AfterLoss::Resume, ..soft.clone() };
    vec![EngineConfig { rest: RestOffset::Hold, ..soft.clone() }, boundless, strict, forgiving, soft]
}

#[test]
fn every_rule_is_met_and_no_other_change_of_state_occurs() {
    let mut met = BTreeSet::new();
    for config in plants() {
        for begin in beginnings() {
            for command in commands() {
                for happening in happenings() {
                    let mut plant = Plant::new(&config, model_of(Kind::Live(0.002)), 1);
                    let end = Op::Run { mm_per_cycle: 0.0, cycles: 30 };
                    carry_out(&mut plant, Op::Place(499.6));
                    for op in begin.iter().chain(&command).chain(&happening).chain([&end]) {
                        carry_out(&mut plant, *op);
                    }
                    met.append(&mut plant.transitions);
                }
            }
        }
    }
    let rules: BTreeSet<_> = transitions::all().collect();
    let unknown: Vec<_> = met.difference(&rules).collect();
    let unmet: Vec<_> = rules.difference(&met).collect();
    assert!(unknown.is_empty() && unmet.is_empty(), "no rule for {unknown:#?}\nnot met: {unmet:#?}");
}
