//! What an answer tells beside the offset: flags by axis, what is wanted, the lag; and answers to repeated frames.

use super::*;

/// Errors of X, Y and Z, mm, everywhere.
fn three_constants(errors: [f64; 3]) -> Model {
    let mut spec = ModelSpec::new("m", Chain::parse("[w b X Y Z t]").unwrap());
    for (symbol, size) in ["exx", "eyx", "ezx"].iter().zip(errors) {
        let function = ErrorFunction::single(Curve::Constant(size));
        spec.errors.push((ErrorSymbol::parse(symbol).unwrap(), function));
    }
    Model::new(&spec).unwrap()
}

fn compensated(errors: [f64; 3]) -> World {
    let mut w = World::new(&config());
    w.use_model(three_constants(errors));
    w.engine.on_command(w.now, Command::Enable);
    assert_eq!(w.run(600).state, State::Active);
    w
}

#[test]
fn each_axis_has_its_own_flag_of_warning_and_limit() {
    // warning from 30 um, limit 50 um
    let cases = [
        ([0.01, 0.01, 0.01], 0, 0),
        ([0.04, 0.01, 0.01], 0b001, 0),
        ([0.01, 0.04, 0.01], 0b010, 0),
        ([0.01, 0.01, -0.04], 0b100, 0),
        ([0.04, 0.06, 0.01], 0b011, 0b010),
        ([0.01, 0.04, -0.06], 0b110, 0b100),
    ];
    for (errors, warning, limited) in cases {
        let out = compensated(errors).last;
        assert_eq!((out.warning, out.limited), (warning, limited), "{errors:?}");
    }
}

#[test]
fn a_soft_limit_on_the_way_to_zero_is_flagged_for_its_axis() {
    // Z has an offset of -10 um and runs to its lower limit while that is taken back
    let limits = EngineConfig {
        soft_limits: vec![[f64::NEG_INFINITY, f64::INFINITY], [-500.0, 500.0], [-1.0, 500.0]],
        ..config()
    };
    let mut w = World::new(&limits);
    w.use_model(three_constants([0.0, 0.0, 0.010]));
    w.frame.commanded[2] = -0.5;
    w.engine.on_command(w.now, Command::Enable);
    assert_eq!(w.run(600).state, State::Active);
    w.engine.on_command(w.now, Command::Disable);
    let mut flags = 0;
    for _ in 0..50 {
        w.frame.commanded[2] = (w.frame.commanded[2] - 0.02).max(-1.0);
        flags |= w.cycle().at_soft_limit;
    }
    assert_eq!((w.last.state, flags), (State::RampingOut, 0b100));
    assert_eq!(w.last.limited & 0b011, 0);
}

#[test]
fn the_answer_to_a_repeated_frame_moves_nothing_wants_nothing_and_is_not_limited() {
    let mut w = World::new(&config());
    w.engine.on_command(w.now, Command::Enable);
    w.run(110);
    let before = w.last;
    assert_eq!(before.state, State::RampingIn);
    let out = w.engine.on_position(w.now, &w.frame, &w.model).unwrap();
    assert!(out.out_of_order);
    assert_eq!((out.offset, out.wanted, out.limited), (before.offset, before.offset, 0));
}

#[test]
fn repeated_frames_are_counted_and_do_not_shorten_the_watch() {
    // the control applies what it is sent eight cycles later; the watch looks back ten answers
    let mut w = World::new(&config());
    w.engine.on_command(w.now, Command::Enable);
    let mut sent = std::collections::VecDeque::from(vec![[0.0; MAX_AXES]; 8]);
    for _ in 0..100 {
        let applied = sent.pop_front().unwrap();
        sent.push_back(w.reports(applied).unwrap().offset);
    }
    assert!((w.frame.applied[0] - w.last.offset[0]).abs() > 3e-4, "it is far behind");
    assert_eq!(w.engine.strays(), 0);
    for n in 1..=30 {
        assert!(w.engine.on_position(w.now, &w.frame, &w.model).is_some(), "repetition {n}");
        assert_eq!(w.engine.strays(), n);
    }
}

#[test]
fn a_lag_that_was_measured_elsewhere_is_gone_on_with() {
    let mut w = World::new(&config());
    assert_eq!(w.cycle().lag_cycles, None);
    w.engine.assume_lag(Some(4));
    assert_eq!(w.cycle().lag_cycles, Some(4));
    w.engine.assume_lag(None);
    assert_eq!(w.cycle().lag_cycles, None);
}
