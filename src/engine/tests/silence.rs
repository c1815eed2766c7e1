//! No frame comes: how long the engine goes on answering by the clock, and when it is done.

use super::*;

/// Answers by the clock until none is due any more.
fn until_nothing_is_due(w: &mut World) -> usize {
    for calls in 0..3000 {
        let Some(due) = w.engine.next_deadline() else { return calls };
        let Some(out) = w.engine.on_deadline(due) else { return calls };
        w.check_step(&out);
        (w.last, w.now) = (out, due);
    }
    panic!("never ends: {:?}", w.last);
}

/// A correction beyond the stop limit, so many cycles ago.
fn stop_limit_exceeded(cycles: usize) -> World {
    let mut w = World::active(&config());
    w.use_model(constant_model(0.2));
    assert_eq!(w.run(cycles).state, State::Faulted);
    assert!(!w.engine.is_silenced());
    w
}

#[test]
fn a_fault_on_its_way_to_zero_gets_there_without_frames() {
    let mut w = stop_limit_exceeded(50);
    assert!(w.last.offset[0] < -0.005);
    assert!(until_nothing_is_due(&mut w) > 50);
    assert_eq!((w.last.state, w.last.offset), (State::Faulted, [0.0; MAX_AXES]));
}

#[test]
fn a_fault_at_zero_has_nothing_left_to_answer() {
    let mut w = stop_limit_exceeded(600);
    assert_eq!(w.last.offset, [0.0; MAX_AXES]);
    assert_eq!(until_nothing_is_due(&mut w), 1);
}

#[test]
fn a_stopped_engine_that_keeps_its_offset_has_nothing_left_to_answer() {
    let mut w = World::active(&EngineConfig { rest: RestOffset::Hold, ..config() });
    w.engine.on_command(w.now, Command::Stop);
    assert_eq!(w.run(50).state, State::Off);
    assert_eq!(until_nothing_is_due(&mut w), 1);
    assert!((w.last.offset[0] + 0.010).abs() < 1e-12);
}

#[test]
fn a_fault_frozen_by_an_emergency_stop_is_held_by_answers_for_as_long_as_it_lasts() {
    let mut w = stop_limit_exceeded(50);
    w.frame.state = MachineState::from_bits(READY.bits | MachineState::ESTOP);
    let frozen = w.run(100);
    assert_eq!(w.run(300).offset, frozen.offset, "not moved while the machine is not ready");
    assert!(frozen.state == State::Faulted && frozen.offset[0] < -0.005);
    // nothing moves, and yet the control would miss the answers and take the offset out by itself
    for _ in 0..500 {
        let due = w.engine.next_deadline().expect("an answer is still needed");
        assert_eq!(w.engine.on_deadline(due).unwrap().offset, frozen.offset);
    }
}
