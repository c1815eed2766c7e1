//! After a gap: what the control did meanwhile counts.

use super::*;

#[test]
fn one_stray_number_does_not_deafen_the_engine() {
    let mut w = World::active(&config());
    let sequence = w.frame.sequence;
    w.frame.sequence = sequence.wrapping_add(1000);
    w.send();
    w.frame.sequence = sequence;
    // five frames that follow each other are believed, ten more make them good
    w.run(30);
    assert_eq!(w.last.sequence, sequence.wrapping_add(30));
    w.run(400);
    assert_eq!(w.last.state, State::Active);
}

#[test]
fn a_control_that_took_all_of_the_offset_back_meanwhile_is_followed_from_zero() {
    let mut w = World::active(&config());
    assert!(w.last.offset[0] < -0.009);
    // this process stood still for 0.7 s; the control held for 0.1 s, took the offset back and is done with it
    w.now = w.now.plus_seconds(0.7);
    w.frame.sequence += 700;
    w.frame.control_ns += 700_000_000;
    w.frame.applied = [0.0; MAX_AXES];
    // an answer of zero would be a step of ten micrometres, one of ten micrometres a step of the machine
    assert_eq!(w.engine.on_position(w.now, &w.frame, &w.model), None);
    let event = w.engine.take_event();
    assert!(matches!(event, Some(Event::StateChanged { reason: Reason::ControlTookOver, .. })));
    assert!(w.engine.needs_new_link());
    w.last.offset = [0.0; MAX_AXES];
    w.new_link();
    assert_eq!(w.cycle().offset[0], 0.0);
    w.run(500);
    assert_eq!(w.last.state, State::Active);
    assert!((w.last.offset[0] + 0.010).abs() < 1e-12);
}

#[test]
fn a_gap_in_which_nothing_happened_changes_nothing() {
    let mut w = World::active(&config());
    let before = w.last.offset;
    w.now = w.now.plus_seconds(0.02);
    w.frame.sequence += 20;
    w.frame.control_ns += 20_000_000;
    w.cycle();
    assert_eq!((w.last.state, w.last.offset), (State::Active, before));
}

#[test]
fn a_small_offset_that_was_taken_back_in_a_gap_is_not_sent_again_as_a_step() {
    let mut w = World::new(&config());
    w.engine.on_command(MonoTime::ZERO, Command::Enable);
    w.run(37);
    let small = w.last.offset[0];
    assert!(small < -1.2e-4 && w.engine.state() == State::RampingIn, "{small}");
    // nothing for 0.3 s; zero was sent less than ten answers ago, but that is long past
    w.now = w.now.plus_seconds(0.3);
    w.frame.sequence += 300;
    w.frame.control_ns += 300_000_000;
    w.frame.applied = [0.0; MAX_AXES];
    let out = w.engine.on_position(w.now, &w.frame, &w.model).expect("synchronised");
    assert_eq!(out.offset[0], 0.0);
}

#[test]
fn an_answer_to_a_number_of_the_future_does_not_become_two_steps() {
    // the control takes no answer that names a number above its own: what was sent with one must be sent again alone
    for (ahead, clock_ns) in [(5, 0), (6, 0), (7, 0), (4, -1_000_000), (5, -1_000_000), (6, -1_000_000)] {
        let mut w = World::new(&config());
        w.engine.on_command(MonoTime::ZERO, Command::Enable);
        w.run(60);
        assert_eq!(w.engine.state(), State::RampingIn);
        let mut applied = w.last.offset;
        for n in 0..20 {
            w.now = w.now.plus_seconds(CYCLE_S);
            w.frame.sequence += 1;
            w.frame.control_ns += 1_000_000;
            w.frame.applied = applied;
            let mut frame = w.frame;
            if n == 3 {
                frame.sequence += ahead;
                frame.control_ns += clock_ns;
            }
            let Some(out) = w.engine.on_position(w.now, &frame, &w.model) else { continue };
            if out.sequence == w.frame.sequence {
                let step = (out.offset[0] - applied[0]).abs();
                assert!(
                    step <= LIMITS.rate * CYCLE_S * 1.000_001,
                    "{step} in frame {n}, number {ahead} ahead"
                );
                applied = out.offset;
            }
        }
    }
}
