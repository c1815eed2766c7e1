//! Holding: why it begins, how long it lasts, and that a bad frame makes no time.

use super::*;

#[test]
fn it_lasts_until_ten_good_frames_have_followed_each_other() {
    let mut w = World::active(&config());
    w.frame.commanded[1] = f64::NAN;
    w.cycle();
    w.frame.commanded[1] = 0.0;
    assert_eq!(w.run(9).state, State::Holding);
    w.frame.commanded[1] = f64::NAN;
    w.cycle();
    w.frame.commanded[1] = 0.0;
    assert_eq!(w.run(9).state, State::Holding, "the count begins again");
    assert_eq!(w.cycle().state, State::RampingIn);
}

#[test]
fn what_is_not_ready_is_named() {
    use MachineState as M;
    for (bits, expected) in [
        (M::HOMED | M::ENABLED | M::ESTOP, Reason::EmergencyStop),
        (M::ESTOP, Reason::EmergencyStop),
        (M::HOMED, Reason::NotEnabled),
        (0, Reason::NotEnabled),
        (M::ENABLED, Reason::NotHomed),
    ] {
        let mut w = World::active(&config());
        w.frame.state = M::from_bits(bits);
        let out = w.cycle();
        assert_eq!((out.state, reason(&out)), (State::Holding, Some(expected)));
    }
}

#[test]
fn an_offset_found_with_bad_data_is_held_for_the_hold_time_and_on_a_new_link_anew() {
    // hold-s is 0.1 s, and each of the first three links lasts 80 ms
    let mut w = World::new(&config());
    w.frame.commanded[0] = f64::NAN;
    w.last.offset = x_only(-0.010);
    for _ in 0..3 {
        for _ in 0..80 {
            let out = w.cycle();
            assert_eq!((out.state, out.offset[0]), (State::Off, -0.010));
        }
        w.new_link();
    }
    assert_eq!(w.run(98).state, State::Off);
    let out = w.run(4);
    assert_eq!(out.state, State::RampingOut);
    assert_eq!(w.run(400).offset[0], 0.0);
}

/// On a way to zero that takes longer than the rate of 1 mm/s allows; that rate is reached at once.
fn at_full_rate() -> World {
    let fast = AxisLimits { acceleration: 1e4, step: f64::INFINITY, ..LIMITS };
    let mut w = World::new(&EngineConfig { limits: vec![fast; 3], ramp_s: 0.01, ..config() });
    w.use_model(constant_model(0.045));
    w.engine.on_command(w.now, Command::Enable);
    assert_eq!(w.run(300).state, State::Active);
    w.engine.on_command(w.now, Command::Disable);
    w.run(10);
    w
}

#[test]
fn a_bad_frame_makes_no_time_that_the_next_one_could_use() {
    let mut w = at_full_rate();
    for n in 0..20 {
        w.frame.commanded[1] = if n % 2 == 0 { f64::NAN } else { 0.0 };
        let before = w.last.offset[0];
        let out = w.cycle();
        let step = (out.offset[0] - before).abs();
        assert!(out.state == State::RampingOut && out.offset[0] < -0.01);
        assert!(step > 0.0 && step <= LIMITS.rate * CYCLE_S * 1.000_001, "{step} mm in frame {n}");
    }
}

#[test]
fn a_late_frame_moves_the_offset_by_two_cycles_at_most() {
    for (lost, cycles) in [(0, 1.0), (1, 2.0), (2, 2.0), (10, 2.0)] {
        let mut w = at_full_rate();
        let before = w.last.offset;
        w.lost_cycles(lost);
        let step = w.reports(before).unwrap().offset[0] - before[0];
        assert!((step - LIMITS.rate * cycles * CYCLE_S).abs() < 1e-12, "{step} mm after {lost} lost");
    }
}

#[test]
fn a_sensor_that_has_fallen_silent_is_told_once_and_until_its_part_is_gone() {
    use volcomp_model::curve::Live;
    let mut spec = ModelSpec::new("m", Chain::parse("[w b X Y Z t]").unwrap());
    let live = vec![Live { sensor: "ram".to_owned(), limit: 0.05, reference: None }];
    let function = ErrorFunction { live, ..ErrorFunction::single(Curve::Constant(0.010)) };
    spec.errors.push((ErrorSymbol::parse("exx").unwrap(), function));
    let mut w = World::new(&config());
    w.use_model(Model::new(&spec).unwrap());
    w.engine.on_command(w.now, Command::Enable);
    for _ in 0..800 {
        w.engine.on_live(w.now, 0, 0.005);
        w.cycle();
    }
    let mut told = Vec::new();
    for n in 0..500 {
        let out = w.cycle();
        told.extend(reason(&out).map(|reason| (out.state, reason, n)));
    }
    let [(State::FadingToStatic, Reason::LiveLost, begun), (State::Active, Reason::RampDone, ended)] =
        told[..]
    else {
        panic!("{told:?}")
    };
    assert!((195..=205).contains(&(ended - begun)), "over ramp-s: {told:?}");
}
