//! The offset that the control reports: what is believed, what is followed, and what ends in a fault.

use super::*;
use crate::config::{UNLISTED_MAX_DEG, UNLISTED_MAX_MM};

const ESTOP: MachineState = MachineState::from_bits(READY.bits | MachineState::ESTOP);
const RAMPING_OUT: MachineState = MachineState::from_bits(READY.bits | MachineState::OFFSET_RAMPING_OUT);

fn not_told() -> AxisArray {
    [f64::NAN; MAX_AXES]
}

/// Active with -10 um of X.
fn active() -> World {
    World::active(&config())
}

// --- not told ---

#[test]
fn an_offset_that_is_not_told_is_no_reason_to_fall_silent_while_answers_follow_each_other() {
    for lost in [0, 1] {
        let mut w = active();
        w.lost_cycles(lost);
        let out = w.reports(not_told()).expect("what the control holds is known");
        assert_eq!((out.state, reason(&out)), (State::Holding, Some(Reason::NotFinite)));
    }
}

#[test]
fn where_the_control_may_have_acted_on_its_own_and_does_not_tell_its_offset_nothing_is_sent() {
    // after a gap
    let mut w = active();
    w.lost_cycles(2);
    assert_eq!(w.reports(not_told()), None);
    // at an emergency stop, and with the drives off
    for state in [ESTOP, MachineState::from_bits(MachineState::HOMED)] {
        let mut w = active();
        w.frame.state = state;
        assert_eq!(w.reports(not_told()), None);
        // and right after one
        let mut w = active();
        w.frame.state = state;
        assert!(w.reports(x_only(-0.010)).is_some());
        w.frame.state = READY;
        assert_eq!(w.reports(not_told()), None);
        assert!(w.reports(x_only(-0.010)).is_some(), "until it is told");
    }
}

// --- after a gap ---

#[test]
fn after_a_gap_another_offset_within_a_step_is_followed_after_a_single_lost_frame_it_is_not() {
    for (lost, followed) in [(0, false), (1, false), (2, true), (20, true)] {
        let mut w = active();
        let before = w.last.offset;
        w.lost_cycles(lost);
        let held = x_only(-0.0095);
        let out = w.reports(held).unwrap();
        assert_eq!(out.offset, if followed { held } else { before }, "{lost} lost");
        let took_over = (State::Holding, Some(Reason::ControlTookOver));
        let expected = if followed { took_over } else { (State::Active, None) };
        assert_eq!((out.state, reason(&out)), expected, "{lost} lost");
    }
}

#[test]
fn a_control_with_another_offset_after_every_gap_is_followed_ten_times_and_then_left_to_the_watch() {
    let mut w = active();
    // positions that cannot be used: nothing ever settles
    w.frame.commanded[1] = f64::NAN;
    let mut held = w.last.offset;
    let mut after_a_gap = |w: &mut World| {
        held[0] += 2e-4;
        w.lost_cycles(20);
        (w.reports(held), held)
    };
    for n in 1..=10 {
        let (out, held) = after_a_gap(&mut w);
        assert_eq!(out.unwrap().offset, held, "gap {n}");
    }
    for n in 1.. {
        let (out, held) = after_a_gap(&mut w);
        let Some(out) = out else { break };
        assert_ne!(out.offset, held);
        assert!(n < 12, "an offset that changes for ever is never a fault");
    }
    assert_eq!(w.engine.state(), State::Faulted);
    assert!(w.engine.is_silenced());
}

#[test]
fn a_link_that_must_end_is_not_judged_any_more() {
    let mut w = active();
    w.lost_cycles(700);
    assert_eq!(w.reports([0.0; MAX_AXES]), None);
    assert!(w.engine.needs_new_link() && !w.engine.is_silenced());
    w.frame.state = ESTOP;
    assert_eq!(w.reports(x_only(5.0)), None);
    assert_eq!(w.engine.state(), State::Holding, "the next link is judged by what it reports itself");
}

// --- the control takes the offset out ---

#[test]
fn a_control_that_takes_its_offset_out_is_followed_at_rest() {
    let mut w = active();
    w.frame.state = RAMPING_OUT;
    let held = x_only(-0.0099);
    let out = w.reports(held).unwrap();
    assert_eq!((out.offset, out.state, reason(&out)), (held, State::Holding, Some(Reason::ControlTookOver)));
}

#[test]
fn nothing_begins_while_the_control_takes_the_offset_back() {
    let mut w = active();
    w.frame.state = RAMPING_OUT;
    let mut events = Vec::new();
    // answers stay on their way: the control comes to zero
    for cycle in (0..100).rev() {
        let out = w.reports(x_only(-1e-4 * f64::from(cycle))).expect("within a step");
        events.extend(reason(&out).map(|cause| (out.state, cause)));
    }
    assert_eq!(events, [(State::Holding, Reason::ControlTookOver)]);
    w.frame.state = READY;
    assert_eq!(w.reports(x_only(0.0)).map(|out| out.state), Some(State::RampingIn));
    assert_eq!(w.run(400).state, State::Active);
}

#[test]
fn one_that_says_so_while_its_offset_grows_is_not_followed() {
    for grown in [-0.0102, 0.0102] {
        let mut w = active();
        let before = w.last.offset;
        w.frame.state = RAMPING_OUT;
        let out = w.reports(x_only(grown)).unwrap();
        assert_eq!((out.offset, out.state), (before, State::Active));
    }
}

#[test]
fn an_axis_without_limits_does_not_hinder_that() {
    let never = AxisLimits { size: 0.0, ..LIMITS };
    let mut w = World::active(&EngineConfig { limits: vec![LIMITS, never, LIMITS], ..config() });
    w.frame.state = RAMPING_OUT;
    let mut held = x_only(-0.0099);
    held[1] = 0.4;
    let out = w.reports(held).unwrap();
    assert_eq!((out.offset, out.state), (held, State::Holding));
}

#[test]
fn a_fault_that_is_followed_so_begins_its_way_to_zero_there() {
    let mut w = active();
    w.use_model(constant_model(0.2));
    assert_eq!(w.run(60).state, State::Faulted);
    let mut held = w.last.offset;
    held[0] *= 0.98;
    w.frame.state = RAMPING_OUT;
    assert_eq!(w.reports(held).unwrap().offset, held);
    w.frame.state = READY;
    // ramp-s is 200 ms, of which 60 had passed
    assert!(w.run(170).offset[0] < -1e-6, "a whole ramp from here");
    assert_eq!(w.run(60).offset[0], 0.0);
}

// --- the machine cannot move ---

#[test]
fn an_emergency_stop_is_told_as_one() {
    let mut w = active();
    w.frame.state = ESTOP;
    let out = w.reports(x_only(-0.010)).unwrap();
    assert_eq!((out.state, reason(&out)), (State::Holding, Some(Reason::EmergencyStop)));
}

#[test]
fn an_offset_at_its_limit_may_be_read_back_with_its_tolerance() {
    let mut w = World::new(&config());
    w.use_model(constant_model(0.06));
    w.engine.on_command(w.now, Command::Enable);
    assert_eq!(w.run(600).offset[0], -LIMITS.size);
    w.frame.state = ESTOP;
    // 0.1 um of tolerance
    let out = w.reports(x_only(-LIMITS.size - 0.9e-4)).expect("no fault");
    assert_eq!(out.offset[0], -LIMITS.size, "and it does not grow by that");
    assert_eq!(w.reports(x_only(-LIMITS.size - 1.1e-4)), None);
    assert!(w.engine.is_silenced());
}

#[test]
fn an_offset_that_is_led_back_does_not_grow_by_the_delay_of_the_read_back() {
    let mut w = World::new(&config());
    w.last.offset = x_only(0.08);
    w.run(40);
    let before = w.last.offset;
    assert!((LIMITS.size..0.08).contains(&before[0]), "{before:?}");
    w.frame.state = ESTOP;
    let out = w.reports(x_only(before[0] + 0.5e-4)).unwrap();
    assert_eq!(out.offset, before);
}

#[test]
fn an_axis_without_limits_is_echoed_while_the_machine_cannot_move() {
    let never = AxisLimits { size: 0.0, ..LIMITS };
    let mut w = World::active(&EngineConfig { limits: vec![LIMITS, never, LIMITS], ..config() });
    w.frame.state = ESTOP;
    let mut held = w.last.offset;
    held[1] = 0.4;
    assert_eq!(w.reports(held).unwrap().offset, held);
}

#[test]
fn while_the_machine_is_not_ready_a_control_that_changes_its_offset_is_no_fault() {
    let mut w = active();
    // not homed, but the drives are on: it can move its offset by itself
    w.frame.state = MachineState::from_bits(MachineState::ENABLED);
    let mut held = w.last.offset;
    for _ in 0..200 {
        held[0] += 3e-5;
        assert!(w.reports(held).is_some());
    }
    assert_eq!(w.engine.state(), State::Holding);
    // ready again, it is one after a window of ten
    w.frame.state = READY;
    for n in 0..12 {
        held[0] += 3e-5;
        assert!(w.reports(held).is_some() || n >= 10, "frame {n}");
    }
    assert!(w.engine.is_silenced());
}

// --- faults ---

#[test]
fn a_wrong_read_back_after_another_fault_does_not_take_its_place() {
    let mut w = active();
    w.use_model(constant_model(0.2));
    assert_eq!(reason(&w.cycle()), Some(Reason::StopLimit));
    for _ in 0..40 {
        assert!(w.reports(x_only(0.004)).is_some(), "the way to zero goes on");
    }
    assert!(!w.engine.is_silenced());
}

#[test]
fn a_fault_while_corrections_are_sent_ends_the_link_one_before_the_first_leaves_it() {
    let mut w = active();
    while w.reports(x_only(5.0)).is_some() {
        assert!(w.frame.sequence < 400, "is never a fault");
    }
    assert!(w.engine.is_silenced() && w.engine.needs_new_link());
    let mut w = World::new(&config());
    assert_eq!(w.reports(x_only(5.0)), None);
    assert!(w.engine.is_silenced() && !w.engine.needs_new_link(), "another link would report the same");
}

#[test]
fn an_offset_of_just_twice_the_limit_is_led_back() {
    for found in [0.1, -0.1] {
        let mut w = World::new(&config());
        assert!(w.reports(x_only(found)).is_some());
        assert_eq!(w.run(600).offset[0], 0.0);
    }
}

/// What a fault told: axis, value and limit in units of the wire.
fn told(w: &mut World) -> (Reason, Option<u8>, f64, f64) {
    let Some(Event::StateChanged { to: State::Faulted, reason, detail: Some(detail), .. }) =
        w.engine.take_event()
    else {
        panic!("no fault was reported")
    };
    (reason, detail.axis, detail.value, detail.limit)
}

fn five(limits: [AxisLimits; 5]) -> World {
    let (config, model) = five_axes(limits);
    let mut w = World::new(&config);
    w.engine = Compensator::new(&config, &model).unwrap();
    w.engine.on_link_up(w.now);
    w.model = model;
    w
}

fn close(a: f64, b: f64) -> bool {
    (a - b).abs() <= 1e-12 * b.abs()
}

#[test]
fn an_offset_of_a_rotary_axis_that_cannot_be_right_is_told_in_degrees() {
    let mut w = five([LIMITS; 5]);
    let mut applied = [0.0; MAX_AXES];
    applied[4] = -7.0;
    assert_eq!(w.reports(applied), None);
    let (reason, axis, value, limit) = told(&mut w);
    assert_eq!((reason, axis), (Reason::ImplausibleOffset, Some(4)));
    assert!(close(value, -7.0) && close(limit, 0.1_f64.to_degrees()), "{value} {limit}");
}

#[test]
fn a_wrong_read_back_of_a_rotary_axis_is_told_in_degrees() {
    let mut w = five([LIMITS; 5]);
    w.run(30);
    let mut applied = [0.0; MAX_AXES];
    applied[3] = 0.5;
    while w.reports(applied).is_some() {
        assert!(w.frame.sequence < 60, "is never a fault");
    }
    let (reason, axis, value, limit) = told(&mut w);
    assert_eq!((reason, axis), (Reason::ReadBack, Some(3)));
    assert!(close(value, 0.5) && close(limit, 1e-4_f64.to_degrees()), "{value} {limit}");
}

#[test]
fn each_kind_of_axis_without_limits_is_echoed_up_to_its_own_bound() {
    let never = AxisLimits { size: 0.0, ..LIMITS };
    for (axis, bound) in [(0, UNLISTED_MAX_MM), (3, UNLISTED_MAX_DEG)] {
        for (share, answered) in [(0.99, true), (-0.99, true), (1.01, false), (-1.01, false)] {
            let mut w = five([never; 5]);
            let mut applied = [0.0; MAX_AXES];
            applied[axis] = share * bound;
            let answer = w.reports(applied);
            assert_eq!(answer.is_some(), answered, "axis {axis}, {share} of its bound");
            assert!(answer.is_none_or(|out| close(w.engine.message(&out).offset[axis], share * bound)));
        }
    }
}
