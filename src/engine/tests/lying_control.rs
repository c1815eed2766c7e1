//! A control whose read-back is wrong: no answer beyond the limits, no step, a latched fault, and silence.

use super::*;
use crate::FOUND_FACTOR;

/// What the control reports instead of the offset it was sent, mm.
type Lie = fn(f64) -> f64;

/// Runs an enabled machine whose control reports `lie` of what it was sent from `begin` cycles on.
fn deceived(lie: Lie, begin: usize) -> World {
    let mut w = World::new(&config());
    w.engine.on_command(MonoTime::ZERO, Command::Enable);
    w.run(begin);
    for _ in 0..400 {
        w.now = w.now.plus_seconds(CYCLE_S);
        w.frame.sequence += 1;
        w.frame.control_ns += 1_000_000;
        w.frame.applied = w.last.offset.map(lie);
        // holds every answer against size and step
        w.send();
        if w.engine.is_silenced() {
            break;
        }
    }
    w
}

#[test]
fn a_wrong_read_back_is_a_latched_fault_and_silence() {
    let lies: [(&str, Lie); 7] = [
        ("um for mm", |v| v * 1e3),
        ("ten times, which fed back would grow without bound", |v| v * 10.0),
        ("sign flipped", |v| -v),
        ("always zero", |_| 0.0),
        ("always 1e308", |_| 1e308),
        ("always 5 mm", |_| 5.0),
        ("always 40 um", |_| 0.04),
    ];
    for (name, lie) in lies {
        for begin in [1, 100, 300] {
            let mut w = deceived(lie, begin);
            assert!(w.engine.is_silenced(), "{name} from cycle {begin}");
            assert_eq!(w.engine.state(), State::Faulted, "{name}");
            // no command and no frame lifts it while the control claims to hold something
            w.engine.on_command(w.now, Command::Enable);
            for _ in 0..50 {
                w.frame.sequence += 1;
                w.frame.control_ns += 1_000_000;
                w.frame.applied[0] = 5.0;
                assert_eq!(w.engine.on_position(w.now, &w.frame, &w.model), None, "{name}");
                w.engine.on_command(w.now, Command::ClearFault);
            }
            assert_eq!(w.engine.state(), State::Faulted, "{name}");
            assert_eq!(w.engine.next_deadline(), None, "{name}: silence is no reason to send");
        }
    }
}

#[test]
fn after_such_a_fault_a_control_at_zero_and_a_person_lead_back() {
    let mut w = deceived(|_| 0.04, 300);
    w.last.offset = [0.0; MAX_AXES];
    w.frame.applied = [0.0; MAX_AXES];
    w.run(30);
    assert_eq!(w.engine.state(), State::Faulted);
    w.engine.on_command(w.now, Command::ClearFault);
    assert_eq!(w.engine.state(), State::Off);
    w.engine.on_command(w.now, Command::Enable);
    w.fresh = true;
    assert_eq!(w.run(400).state, State::Active);
}

#[test]
fn without_a_link_or_a_report_of_zero_no_fault_is_cleared() {
    let mut w = deceived(|_| 0.04, 300);
    let clear = |w: &mut World| {
        w.engine.on_command(w.now, Command::ClearFault);
        w.engine.state()
    };
    // the fault has ended the link: what the control holds is not known
    w.engine.on_link_down(w.now);
    assert_eq!(clear(&mut w), State::Faulted);
    w.new_link();
    assert_eq!(clear(&mut w), State::Faulted);
    for (held, state) in [(0.03, State::Faulted), (0.0, State::Off)] {
        w.frame.applied = x_only(held);
        w.frame.sequence += 1;
        w.frame.control_ns += 1_000_000;
        assert_eq!(w.engine.on_position(w.now, &w.frame, &w.model), None);
        assert_eq!(clear(&mut w), state, "{held} mm reported");
    }
}

#[test]
fn a_read_back_beside_the_truth_does_not_make_the_offset_grow_from_link_to_link() {
    for enabled in [false, true] {
        let mut w = World::new(&config());
        if enabled {
            w.engine.on_command(MonoTime::ZERO, Command::Enable);
        }
        let mut real = x_only(0.0);
        for link in 0..8 {
            w.new_link();
            for _ in 0..6 {
                w.now = w.now.plus_seconds(CYCLE_S);
                w.frame.sequence += 1;
                w.frame.control_ns += 1_000_000;
                w.frame.applied = x_only(real[0] + 0.030);
                if let Some(out) = w.engine.on_position(w.now, &w.frame, &w.model) {
                    real = out.offset;
                }
            }
            assert!(real[0].abs() <= 0.030 + 1e-12, "{real:?} at link {link}, enabled {enabled}");
        }
        assert_eq!(w.engine.state(), State::Faulted, "enabled {enabled}");
    }
}

#[test]
fn what_the_control_was_sent_on_the_link_before_or_less_is_where_a_new_one_starts() {
    for (held, is_believed) in [(-0.010, true), (-0.004, true), (0.0, true), (-0.0102, false), (0.001, false)]
    {
        let mut w = World::active(&config());
        w.new_link();
        w.frame.applied = x_only(held);
        w.frame.sequence += 1;
        w.frame.control_ns += 1_000_000;
        let out = w.engine.on_position(w.now, &w.frame, &w.model);
        assert_eq!(out.is_some(), is_believed, "{held}");
        assert_eq!(w.engine.is_silenced(), !is_believed, "{held}");
    }
}

#[test]
fn an_offset_that_was_followed_in_the_last_answer_of_a_link_is_where_a_new_one_starts() {
    let mut w = World::active(&config());
    w.lost_cycles(20);
    let held = x_only(-0.0105);
    assert_eq!(w.reports(held).expect("answered").offset, held);
    w.new_link();
    assert!(w.reports(held).is_some() && !w.engine.is_silenced());
}

#[test]
fn an_offset_found_on_a_new_link_is_led_back_up_to_twice_the_limit() {
    for (found, led_back) in [(0.049, true), (0.051, true), (0.0999, true), (0.1001, false), (5.0, false)] {
        for (sign, enabled) in [(1.0, false), (-1.0, false), (1.0, true), (-1.0, true)] {
            let mut w = World::new(&config());
            if enabled {
                w.engine.on_command(MonoTime::ZERO, Command::Enable);
            }
            w.last.offset[0] = sign * found;
            let mut last = found;
            for _ in 0..600 {
                w.cycle();
                if !led_back {
                    assert!(w.engine.is_silenced(), "{found} mm is beyond {FOUND_FACTOR} times the limit");
                    break;
                }
                let now = w.last.offset[0].abs();
                assert!(now <= last.max(LIMITS.size) + 1e-15, "grew from {last} to {now}");
                last = now;
            }
            let state = if enabled { State::Active } else { State::Off };
            let expected = if led_back { state } else { State::Faulted };
            assert_eq!(w.engine.state(), expected, "{found} mm, enabled {enabled}");
        }
    }
}

#[test]
fn an_emergency_stop_with_another_offset_is_followed_in_allowed_steps() {
    let mut w = World::active(&config());
    w.frame.state = MachineState::from_bits(READY.bits | MachineState::ESTOP);
    // the control has taken 10 um into its axis position; every answer is checked for its step
    for _ in 0..50 {
        w.last.offset = [0.0; MAX_AXES];
        let held = w.last;
        w.last.offset = w.engine.offset();
        w.frame.applied = held.offset;
        w.now = w.now.plus_seconds(CYCLE_S);
        w.frame.sequence += 1;
        w.frame.control_ns += 1_000_000;
        w.send();
    }
    assert_eq!(w.last.offset[0], 0.0, "arrived, without a step");
    w.frame.state = READY;
    assert_eq!(w.run(400).state, State::Active);
    // and one that cannot be is no offset at all
    w.frame.state = MachineState::from_bits(READY.bits | MachineState::ESTOP);
    w.last.offset[0] = 1e308;
    w.now = w.now.plus_seconds(CYCLE_S);
    w.frame.sequence += 1;
    w.frame.control_ns += 1_000_000;
    w.frame.applied = w.last.offset;
    assert_eq!(w.engine.on_position(w.now, &w.frame, &w.model), None);
    assert!(matches!(
        w.engine.take_event(),
        Some(Event::StateChanged { to: State::Faulted, reason: Reason::ImplausibleOffset, .. })
    ));
}

#[test]
fn an_axis_without_limits_is_never_moved_and_echoed_up_to_its_bound() {
    let never = AxisLimits { size: 0.0, ..LIMITS };
    let config = EngineConfig { limits: vec![LIMITS, never, LIMITS], ..config() };
    let mut w = World::new(&config);
    w.last.offset[1] = 0.4;
    for _ in 0..30 {
        w.cycle();
        assert_eq!(w.last.offset[1], 0.4);
        w.fresh = true;
    }
    let mut w = World::new(&config);
    w.last.offset[1] = 1.5;
    w.cycle();
    assert!(w.engine.is_silenced(), "more than any control can have been sent");
}

#[test]
fn a_stop_after_such_a_fault_ends_at_once() {
    let mut w = World::active(&config());
    w.engine.on_command(w.now, Command::Stop);
    w.frame.applied[0] = 5.0;
    for _ in 0..12 {
        w.now = w.now.plus_seconds(CYCLE_S);
        w.frame.sequence += 1;
        w.frame.control_ns += 1_000_000;
        w.frame.applied[0] = 5.0;
        w.send();
    }
    assert!(w.engine.is_silenced() && w.engine.is_stopped());
}

#[test]
fn a_read_back_off_by_less_than_the_tolerance_does_not_creep_from_link_to_link() {
    let config = config();
    let [tolerance, bias] = [1.0, 0.8].map(|share| share * config.read_back_tolerance[0]);
    // too few frames to be settled: the offset is kept where it was found; a few more, and it is led back by less than that
    for (frames, sign) in [(6, 1.0), (11, 1.0), (13, -1.0), (20, 1.0), (20, -1.0)] {
        let mut w = World::new(&config);
        w.engine.on_command(MonoTime::ZERO, Command::Enable);
        let mut real = x_only(0.0);
        let mut most = 0.0_f64;
        for _ in 0..200 {
            w.new_link();
            for _ in 0..frames {
                w.lost_cycles(1);
                w.frame.applied = x_only(sign * bias + real[0]);
                if let Some(out) = w.engine.on_position(w.now, &w.frame, &w.model) {
                    real = out.offset;
                    most = most.max(sign * real[0]);
                }
            }
        }
        // the model asks for -10 um
        let wanted = if sign < 0.0 { 0.010 } else { 0.0 };
        assert!(most <= wanted + 2.0 * tolerance, "{frames} frames a link: {most} mm");
    }
}

#[test]
fn a_control_that_comes_back_with_another_hello_is_believed_no_more() {
    // -10 um of X stand at the third place now
    for (place, is_believed) in [(2, true), (0, false)] {
        let mut w = World::active(&config());
        let swapped = EngineConfig { axes: config().axes.into_iter().rev().collect(), ..config() };
        let before = core::mem::replace(&mut w.engine, Compensator::new(&swapped, &w.model).unwrap());
        w.engine.succeed(&before);
        w.new_link();
        let mut held = [0.0; MAX_AXES];
        held[place] = -0.010;
        assert_eq!(
            (w.reports(held).is_some(), w.engine.is_silenced()),
            (is_believed, !is_believed),
            "{place}"
        );
    }
}
