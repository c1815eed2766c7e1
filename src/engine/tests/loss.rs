//! What is latched, and what a change of state tells about its cause.

use super::*;

/// The event of a cycle, if it changed the state.
fn change(out: &CycleOutput) -> (State, Reason, Option<Detail>) {
    match out.event {
        Some(Event::StateChanged { to, reason, detail, .. }) => (to, reason, detail),
        None => panic!("no change of state in {out:?}"),
    }
}

/// Runs until the state changes.
fn next_change(w: &mut World) -> (State, Reason, Option<Detail>) {
    for _ in 0..5000 {
        let out = w.cycle();
        if out.event.is_some() {
            return change(&out);
        }
    }
    panic!("nothing changed in {:?}", w.last.state);
}

#[test]
fn positions_lost_until_the_offset_is_zero_are_a_fault_that_stays_until_cleared() {
    let mut w = World::active(&config());
    w.frame.commanded[1] = f64::NAN;
    assert_eq!(next_change(&mut w).0, State::Holding);
    assert_eq!(next_change(&mut w).0, State::RampingOut);
    let (state, reason, _) = next_change(&mut w);
    assert_eq!((state, reason, w.last.offset), (State::Faulted, Reason::DataLost, [0.0; MAX_AXES]));
    w.frame.commanded[1] = 0.0;
    assert_eq!(w.run(500).state, State::Faulted, "good data alone do not bring it back");
    w.engine.on_command(w.now, Command::Enable);
    assert_eq!(w.run(50).state, State::Faulted, "enabling does not clear a fault");
    w.engine.on_command(w.now, Command::ClearFault);
    w.engine.on_command(w.now, Command::Enable);
    assert_eq!(w.run(400).state, State::Active);
}

#[test]
fn data_that_come_back_before_zero_turn_the_ramp_round() {
    let mut w = World::active(&config());
    w.frame.commanded[1] = f64::NAN;
    assert_eq!(next_change(&mut w).0, State::Holding);
    assert_eq!(next_change(&mut w).0, State::RampingOut);
    w.run(50);
    w.frame.commanded[1] = 0.0;
    let (state, reason, _) = next_change(&mut w);
    assert_eq!((state, reason), (State::RampingIn, Reason::DataGood), "nobody has given a command");
    assert_eq!(w.run(400).state, State::Active);
    // the same, but the operator disables and enables meanwhile
    w.frame.commanded[1] = f64::NAN;
    assert_eq!(next_change(&mut w).0, State::Holding);
    assert_eq!(next_change(&mut w).0, State::RampingOut);
    w.engine.on_command(w.now, Command::Disable);
    w.run(10);
    w.engine.on_command(w.now, Command::Enable);
    w.frame.commanded[1] = 0.0;
    let (state, reason, _) = next_change(&mut w);
    assert_eq!((state, reason), (State::RampingIn, Reason::Command));
}

#[test]
fn a_machine_that_is_switched_off_meanwhile_is_no_loss() {
    let mut w = World::active(&config());
    w.engine.on_command(w.now, Command::Disable);
    w.frame.commanded[1] = f64::NAN;
    assert_eq!(w.run(800).state, State::Off);
    let mut w = World::active(&config());
    w.frame.commanded[1] = f64::NAN;
    w.frame.state = MachineState::from_bits(READY.bits | MachineState::ESTOP);
    assert_eq!(w.run(800).state, State::Holding);
}

#[test]
fn where_configured_it_comes_back_by_itself() {
    let mut w = World::active(&EngineConfig { after_loss: AfterLoss::Resume, ..config() });
    w.frame.commanded[1] = f64::NAN;
    assert_eq!(w.run(800).state, State::Armed);
    w.frame.commanded[1] = 0.0;
    assert_eq!(w.run(400).state, State::Active);
}

#[test]
fn a_new_engine_keeps_the_fault_of_the_old_one() {
    let mut w = World::new(&config());
    w.engine.on_command(w.now, Command::KeepFault);
    w.engine.on_command(w.now, Command::Enable);
    assert_eq!(w.run(400).state, State::Faulted);
    // an engine at work is not stopped by it
    let mut w = World::active(&config());
    w.engine.on_command(w.now, Command::KeepFault);
    assert_eq!(w.run(50).state, State::Active);
}

#[test]
fn a_change_of_state_tells_axis_value_and_limit() {
    let axis = |k, value, limit| Some(Detail { axis: Some(k), quantity: Quantity::Axis, value, limit });
    let mut w = World::active(&config());
    w.frame.commanded[1] += 7.0;
    assert_eq!(change(&w.cycle()), (State::Holding, Reason::Jump, axis(1, 7.0, 1.0)));

    let mut w = World::active(&config());
    w.frame.commanded[2] = f64::INFINITY;
    let (_, reason, detail) = change(&w.cycle());
    assert_eq!(
        (reason, detail.map(|d| (d.axis, d.value))),
        (Reason::NotFinite, Some((Some(2), f64::INFINITY)))
    );

    let mut w = World::active(&config());
    w.frame.control_ns += 900_000_000;
    let (_, reason, detail) = change(&w.cycle());
    let found = detail.unwrap();
    assert_eq!((reason, found.quantity), (Reason::ControlClock, Quantity::Time));
    assert!((found.value - 0.901).abs() < 1e-9 && (found.limit - 0.021).abs() < 1e-9, "{found:?}");

    let mut w = World::active(&config());
    let due = w.engine.next_deadline().unwrap();
    let (_, reason, detail) = change(&w.engine.on_deadline(due).unwrap());
    assert_eq!(reason, Reason::Stale);
    assert_eq!(detail, Some(Detail { axis: None, quantity: Quantity::Time, value: 0.02, limit: 0.02 }));

    let mut w = World::active(&config());
    let found = loop {
        w.now = w.now.plus_seconds(CYCLE_S);
        w.frame.sequence += 1;
        w.frame.control_ns += 1_000_000;
        // X has been sent -10 um
        w.frame.applied[0] = 0.002;
        let out = w.send();
        if out.event.is_some() {
            break change(&out);
        }
        assert!(w.frame.sequence < 400, "is never a fault");
    };
    let detail = found.2.unwrap();
    assert_eq!((found.0, found.1, detail.axis), (State::Faulted, Reason::ReadBack, Some(0)));
    assert!((detail.value - 0.012).abs() < 1e-9 && detail.limit == 1e-4, "{detail:?}");
}

#[test]
fn an_offset_on_its_way_to_zero_is_taken_back_ahead_of_a_soft_limit() {
    let limits = EngineConfig { soft_limits: vec![[0.0, 500.0]; 3], ramp_s: 5.0, ..config() };
    let mut w = World::new(&limits);
    w.engine.on_command(MonoTime::ZERO, Command::Enable);
    assert_eq!(w.run(6000).state, State::Active);
    // the correction is -10 um; towards the lower limit with 100 mm/s, and disabled shortly before it
    let mut limited = false;
    for n in 0..1500 {
        w.frame.commanded[0] = (100.0 - 0.1 * f64::from(n)).max(0.0);
        if n == 900 {
            w.engine.on_command(w.now, Command::Disable);
        }
        let out = w.cycle();
        limited |= n > 900 && out.at_soft_limit == 1;
        assert!(w.frame.commanded[0] + out.offset[0] >= -1e-4, "{} in cycle {n}", out.offset[0]);
    }
    assert!(limited && w.last.state == State::RampingOut, "the ramp alone takes 5 s");
}

#[test]
fn the_first_position_after_a_recount_among_frames_that_were_not_finite_uses_its_own_cycle() {
    let mut w = World::active(&config());
    w.frame.commanded[1] = f64::NAN;
    // past the stray frames of the other count, and into the way out
    w.frame.sequence = w.frame.sequence.wrapping_add(u32::MAX / 2);
    while w.last.state != State::RampingOut {
        w.cycle();
    }
    // half way out, where the offset moves fastest
    w.run((config().ramp_s / CYCLE_S / 2.0) as usize);
    w.frame.commanded[1] = 0.0;
    let mut offsets = vec![w.last.offset[0]];
    offsets.extend((0..4).map(|_| w.cycle().offset[0]));
    let changes: Vec<f64> = offsets.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let most = LIMITS.acceleration * CYCLE_S * CYCLE_S;
    assert!(changes.windows(2).all(|pair| (pair[1] - pair[0]).abs() <= most * 1.000_001), "{changes:?}");
}
