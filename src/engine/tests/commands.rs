//! Commands and the end of the link: what is wanted, and when a stop has been carried out.

use super::*;

#[test]
fn the_engine_tells_whether_compensation_is_wanted() {
    let mut w = World::new(&config());
    assert!(!w.engine.is_enabled() && !w.engine.is_stopped(), "default off");
    w.engine.on_command(w.now, Command::Enable);
    assert!(w.engine.is_enabled());
    w.engine.on_command(w.now, Command::Disable);
    assert!(!w.engine.is_enabled());
}

#[test]
fn disabling_during_the_way_in_turns_round_at_once() {
    let mut w = World::new(&config());
    w.engine.on_command(w.now, Command::Enable);
    w.run(100);
    assert_eq!(w.last.state, State::RampingIn);
    w.engine.on_command(w.now, Command::Disable);
    let out = w.cycle();
    assert_eq!((out.state, reason(&out)), (State::RampingOut, Some(Reason::Command)));
}

#[test]
fn a_stop_that_keeps_the_offset_is_carried_out_once_nothing_moves_and_ends_off() {
    let mut w = World::new(&EngineConfig { rest: RestOffset::Hold, ..config() });
    w.engine.on_command(w.now, Command::Enable);
    w.run(110);
    assert_eq!(w.last.state, State::RampingIn);
    w.engine.on_command(w.now, Command::Stop);
    assert!(!w.engine.is_stopped(), "the offset is still moving");
    let out = w.cycle();
    assert_eq!((out.state, reason(&out)), (State::Holding, Some(Reason::Command)));
    while !w.engine.is_stopped() {
        w.cycle();
        assert!(w.frame.sequence < 300, "is never carried out");
    }
    let kept = w.last.offset;
    let out = w.run(20);
    assert_eq!((out.state, out.offset), (State::Off, kept));
}

#[test]
fn a_stop_during_an_emergency_stop_is_carried_out_where_the_offset_is() {
    let mut w = World::active(&config());
    w.frame.state = MachineState::from_bits(READY.bits | MachineState::ESTOP);
    w.run(5);
    w.engine.on_command(w.now, Command::Stop);
    assert!(!w.engine.is_stopped());
    let out = w.cycle();
    assert!(out.stopped && (out.offset[0] + 0.010).abs() < 1e-12, "moving it would move nothing");
}

#[test]
fn without_a_stop_nothing_counts_as_one() {
    let mut w = World::active(&config());
    w.frame.state = MachineState::from_bits(READY.bits | MachineState::ESTOP);
    assert!(!w.run(5).stopped);
    w.frame.state = READY;
    w.run(400);
    w.foreign_writer();
    assert!(!w.engine.is_stopped());
}

#[test]
fn a_link_that_is_gone_takes_everything_with_it_that_was_to_be_sent() {
    let mut w = World::active(&config());
    assert!(w.engine.next_deadline().is_some());
    w.engine.on_link_down(w.now);
    assert_eq!((w.engine.state(), w.engine.next_deadline()), (State::Armed, None));
    assert!(!w.engine.is_stopped());
    // nobody listens any more: a stop has nothing left to do
    let mut w = World::active(&config());
    w.engine.on_command(w.now, Command::Stop);
    w.engine.on_link_down(w.now);
    assert!(w.engine.is_stopped());
    assert_eq!(w.engine.state(), State::Off);
}

#[test]
fn a_silencing_fault_carries_a_stop_out_at_once() {
    let mut w = World::active(&config());
    w.engine.on_command(w.now, Command::Stop);
    for _ in 0..30 {
        assert!(!w.engine.is_stopped());
        if w.reports(x_only(5.0)).is_none() {
            break;
        }
    }
    assert!(w.engine.is_silenced() && w.engine.is_stopped(), "before any other link");
}
