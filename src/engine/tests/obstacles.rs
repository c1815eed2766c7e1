//! What the engine says about a compensation that waits, and about an offset that does not follow its correction.

use super::*;

#[test]
fn an_enabled_compensation_names_what_it_waits_for() {
    let mut w = World::new(&config());
    w.frame.state = MachineState::from_bits(MachineState::ENABLED);
    w.run(3);
    assert_eq!(w.engine.waits_for(), None, "off: nothing is waited for");
    w.engine.on_command(w.now, Command::Enable);
    for (bits, reason) in [
        (MachineState::ENABLED, Reason::NotHomed),
        (MachineState::HOMED, Reason::NotEnabled),
        (MachineState::HOMED | MachineState::ENABLED | MachineState::ESTOP, Reason::EmergencyStop),
    ] {
        w.frame.state = MachineState::from_bits(bits);
        assert_eq!(w.run(3).state, State::Armed);
        assert_eq!(w.engine.waits_for(), Some(reason));
    }
    w.frame.state = READY;
    for _ in 0..50 {
        w.frame.commanded[0] += 5.0;
        assert_eq!(w.cycle().state, State::Armed);
        assert_eq!(w.engine.waits_for(), Some(Reason::Jump));
    }
    w.run(300);
    assert_eq!((w.last.state, w.engine.waits_for()), (State::Active, None));
}

#[test]
fn missing_positions_and_read_backs_are_named() {
    let mut w = World::new(&config());
    w.engine.on_command(w.now, Command::Enable);
    w.lost_cycles(1);
    w.frame.applied[0] = f64::NAN;
    assert_eq!(w.engine.on_position(w.now, &w.frame, &w.model), None);
    assert_eq!(w.engine.waits_for(), Some(Reason::NotFinite), "the control does not say what it holds");
    w.run(3);
    assert_eq!(w.engine.waits_for(), None);
    let _ = w.engine.on_deadline(w.now.plus_seconds(1.0));
    assert_eq!(w.engine.waits_for(), Some(Reason::Stale));
}

#[test]
fn waiting_outside_the_travel_is_named() {
    let mut w = World::new(&EngineConfig { out_of_travel: OutOfTravel::RampOut, ..config() });
    w.frame.commanded[0] = 600.0;
    w.engine.on_command(w.now, Command::Enable);
    assert_eq!(w.run(50).state, State::Armed);
    assert_eq!(w.engine.waits_for(), Some(Reason::OutOfTravel));
}

#[test]
fn the_travel_is_flagged_while_the_offset_follows_and_not_while_off() {
    let mut w = World::active(&config());
    for _ in 0..500 {
        w.frame.commanded[0] += 0.9;
        w.cycle();
    }
    assert_eq!((w.last.state, w.last.out_of_travel), (State::Active, 1));
    w.engine.on_command(w.now, Command::Disable);
    let out = w.run(400);
    assert_eq!((out.out_of_range, out.out_of_travel), (1, 0), "nothing is corrected there");
}

/// Longest time that is explained: ramp 0.2 s, 0.1 mm at 1 mm/s, twice 1 mm/s at 20 mm/s2.
const EXPLAINED_CYCLES: usize = 400;

#[test]
fn an_offset_that_stays_away_from_its_correction_is_told_after_the_time_that_its_limits_explain() {
    let mut w = World::new(&config());
    // beyond the limit of 50 um, below the stop limit of 150 um
    w.use_model(constant_model(0.06));
    w.engine.on_command(w.now, Command::Enable);
    w.run(10);
    let begun = (0..3 * EXPLAINED_CYCLES).position(|_| w.cycle().lagging != 0).expect("told");
    assert!((EXPLAINED_CYCLES - 10..EXPLAINED_CYCLES + 20).contains(&begun), "{begun} cycles");
    assert_eq!((w.last.lagging, w.last.state), (1, State::Active));
    w.use_model(constant_model(0.05));
    assert_eq!(w.run(300).lagging, 0, "reached");
}

#[test]
fn a_ramp_and_a_small_difference_are_not_told() {
    let mut w = World::new(&config());
    // 1 um beyond the limit: less than 5 % of it
    w.use_model(constant_model(0.051));
    w.engine.on_command(w.now, Command::Enable);
    let told = (0..4 * EXPLAINED_CYCLES).any(|_| w.cycle().lagging != 0);
    assert!(!told && w.last.limited == 1, "{:?}", w.last);
}
