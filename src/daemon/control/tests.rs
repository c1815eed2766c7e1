//! What the cycle thread does with requests, stops and the silence of the service, without a socket.

use super::*;
use crate::channels::{ServiceChannels, Ticket, channels};
use crate::link_session::Reaction;
use crate::simulation::{self, hello};
use volcomp_protocol::{MachineState, Message, Position};

fn control(kept_fault: bool) -> (Control, ServiceChannels) {
    let (cycle, service) = channels();
    let loaded = simulation::loaded();
    let start = Start {
        model: Arc::clone(&loaded.model.model),
        permitted: true,
        kept_fault,
        service_silent_s: SERVICE_SILENT_S,
        live: None,
    };
    (Control::new(cycle, &loaded.config, start), service)
}

fn at(s: f64) -> MonoTime {
    MonoTime::ZERO.plus_seconds(s)
}

/// Sends a request that expires at 1.5 s; gives whether it was refused at `now_s`.
fn refused(control: &mut Control, service: &ServiceChannels, request: Request, now_s: f64) -> bool {
    let number = 1 + (now_s * 1e3) as u64;
    service.requests.try_send(Ticket { number, request, expires: at(1.5) }).expect("room");
    control.take_requests(at(now_s), None);
    assert!(service.progress.is_done(number));
    service.progress.is_refused(number)
}

#[test]
fn two_seconds_without_a_beat_switch_off_and_nothing_switches_on_meanwhile() {
    let (mut control, service) = control(false);
    let wanted = || service.progress.wanted.load(Relaxed);
    for k in 0..200 {
        service.progress.service_beat();
        control.take_requests(at(0.02 * f64::from(k)), None);
    }
    assert!(wanted(), "a service that beats");
    let silent = |k: i32| at(4.0 + 0.02 * f64::from(k));
    for k in 0..=98 {
        control.take_requests(silent(k), None);
        assert!(wanted(), "{k}: not yet two seconds");
    }
    control.take_requests(silent(101), None);
    assert!(!wanted());
    assert!(service.reports.try_iter().any(|report| matches!(report, Report::ServiceSilent)));
    let ticket = |number, request| Ticket { number, request, expires: silent(10_000) };
    service.requests.try_send(ticket(7, Request::Engine(Command::Enable))).expect("room");
    control.take_requests(silent(102), None);
    assert!(service.progress.is_refused(7) && !wanted(), "sent before the service hung");
    // back again: an order counts, and silence is told anew
    service.progress.service_beat();
    service.requests.try_send(ticket(8, Request::Engine(Command::Enable))).expect("room");
    control.take_requests(silent(103), None);
    assert!(!service.progress.is_refused(8) && wanted());
    assert_eq!(service.reports.try_iter().count(), 0);
}

#[test]
fn a_process_that_was_stopped_as_a_whole_was_not_silent() {
    let mut watch = ServiceWatch::new(SERVICE_SILENT_S);
    assert!(!watch.look(at(0.0), 0) && !watch.look(at(1000.0), 0));
    assert!(!watch.is_silent(), "one turn counts as {SILENCE_STEP_S} s at most");
    let mut never = ServiceWatch::new(0.0);
    assert!(!(0..1000).any(|k| never.look(at(f64::from(k)), 0)) && !never.is_silent());
}

#[test]
fn a_late_order_is_refused_unless_it_switches_off() {
    let (mut control, service) = control(false);
    let enable = Request::Engine(Command::Enable);
    assert!(!refused(&mut control, &service, enable.clone(), 1.0));
    service.progress.service_beat();
    for late in [enable, Request::Engine(Command::SetGain(1.0)), Request::Shadow(true)] {
        assert!(refused(&mut control, &service, late, 1.6));
    }
    assert!(service.progress.wanted.load(Relaxed));
    assert!(!refused(&mut control, &service, Request::Engine(Command::Disable), 1.7));
    assert!(!service.progress.wanted.load(Relaxed));
}

#[test]
fn a_kept_fault_is_latched_before_the_first_link_and_not_cleared_without_one() {
    let (mut control, service) = control(true);
    let progress = &service.progress;
    assert!(progress.is_faulted() && !progress.wanted.load(Relaxed));
    assert!(refused(&mut control, &service, Request::Engine(Command::Enable), 0.1));
    assert!(!progress.wanted.load(Relaxed));
    assert!(refused(&mut control, &service, Request::Engine(Command::ClearFault), 0.2));
    assert!(progress.is_faulted());
    assert!(refused(&mut control, &service, Request::Engine(Command::Enable), 0.3));
    assert!(!progress.wanted.load(Relaxed));
}

#[test]
fn where_nothing_is_latched_an_acknowledgement_changes_nothing() {
    let (mut control, service) = control(false);
    assert!(!refused(&mut control, &service, Request::Engine(Command::Enable), 0.1));
    assert!(!refused(&mut control, &service, Request::Engine(Command::ClearFault), 0.2));
    assert!(service.progress.wanted.load(Relaxed));
}

#[test]
fn a_control_that_comes_back_with_another_hello_is_held_to_what_it_was_sent() {
    let (mut control, _service) = control(false);
    let loaded = simulation::loaded();
    let mut seat = None;
    for (turned, reported, is_answered) in [(false, 0.0, true), (true, 0.0, true), (false, 0.05, false)] {
        let hello = hello(turned);
        let config = loaded.config.engine_config(&hello).expect("the hello fits");
        control.prepare(at(1.0), &config, &hello, &mut seat).expect("an engine");
        let (_, session) = seat.as_mut().expect("an engine");
        control.link_up(at(1.0), &hello, session);
        let state = MachineState::from_bits(MachineState::HOMED | MachineState::ENABLED);
        let mut frame = Position { sequence: 1, control_ns: 1_000_000, state, ..Position::default() };
        frame.applied[0] = reported;
        let reaction = session.handle(at(1.0), &Message::Position(frame));
        assert_eq!(matches!(reaction, Reaction::Answer(_)), is_answered, "{reported} mm reported");
        control.link_down(at(1.0), session);
    }
}

#[test]
fn a_stop_needs_no_service() {
    let (mut control, service) = control(false);
    service.progress.ask_stop(StopWish::Clean);
    control.take_requests(at(1.0), None);
    assert!(matches!(control.stop, Stop::By(limit) if limit > at(1.0)));
    let by = control.stop;
    control.take_requests(at(2.0), None);
    assert_eq!(control.stop, by, "the limit does not move");
    service.progress.ask_stop(StopWish::Now);
    control.take_requests(at(2.0), None);
    assert_eq!(control.stop, Stop::Now);
}
