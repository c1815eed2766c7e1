//! The cycle thread of a simulated daemon: the product's request handling and engine beside a control without sockets.

use std::sync::atomic::Ordering::Relaxed;

use shuttle::rand::Rng;

use super::instance::Instance;
use crate::clock::Clock;
use crate::control::{Control, Stop};
use crate::link_session::{LinkSession, Reaction};
use crate::load::Loaded;
use crate::sync::point;
use volcomp_protocol::{
    Axis, AxisUnit, ControlHello, MachineState, Message, Name, PROTOCOL_VERSION, Position,
};
use volcomp_units::axes::{AxisArray, AxisName, MAX_AXES};

const CYCLE_NS: u64 = 1_000_000;

/// What the control says of itself; `turned` in another order of axes, so that it needs an engine of its own.
pub(crate) fn hello(turned: bool) -> ControlHello {
    let axis = |name| Axis { name, unit: AxisUnit::Millimetre };
    let mut axes = [axis(AxisName::X); MAX_AXES];
    (axes[1], axes[2]) =
        if turned { (axis(AxisName::Z), axis(AxisName::Y)) } else { (axis(AxisName::Y), axis(AxisName::Z)) };
    ControlHello {
        version: PROTOCOL_VERSION,
        machine: Name::new(super::MACHINE),
        software: Name::new("simulated"),
        cycle_ns: CYCLE_NS,
        axis_count: 3,
        axes,
    }
}

/// The control.
#[derive(Debug, Default)]
struct Peer {
    up: bool,
    sequence: u32,
    control_ns: i64,
    applied: AxisArray,
    /// Frames in which somebody else writes the offset.
    meddled: u32,
}

impl Peer {
    fn frame(&mut self) -> Position {
        self.sequence += 1;
        self.control_ns += CYCLE_NS as i64;
        if self.meddled > 0 {
            self.meddled -= 1;
            self.applied[0] = 0.05;
        }
        Position {
            sequence: self.sequence,
            control_ns: self.control_ns,
            state: MachineState::from_bits(MachineState::HOMED | MachineState::ENABLED),
            feed_mm_per_min: 0.0,
            commanded: [0.0; MAX_AXES],
            actual: self.applied,
            applied: self.applied,
        }
    }
}

/// The cycle thread's life, until it is stopped, killed or nobody has work for it.
pub(super) fn cycle(instance: &Instance, loaded: &Loaded, mut control: Control, clock: Clock) -> Control {
    let mut seat: Option<(ControlHello, LinkSession)> = None;
    let mut peer = Peer::default();
    let mut random = shuttle::rand::thread_rng();
    while !instance.is_dead() {
        point();
        let now = clock.now();
        control.channels.progress.beat();
        let idle = control.channels.requests.is_empty();
        control.take_requests(now, seat.as_mut().map(|(_, session)| session));
        let stopped = match control.stop {
            Stop::No => false,
            Stop::By(limit) => {
                now >= limit
                    || !peer.up
                    || seat.as_ref().is_none_or(|(_, session)| session.engine().is_stopped())
            }
            Stop::Now => true,
        };
        if stopped || instance.is_over() && idle {
            break;
        }
        if !peer.up {
            if random.gen_bool(0.3) {
                let hello = hello(random.gen_bool(0.2));
                let config = loaded.config.engine_config(&hello).expect("the hello fits");
                control.prepare(now, &config, &hello, &mut seat).expect("an engine");
                let (_, session) = seat.as_mut().expect("an engine");
                control.link_up(now, &hello, session);
                peer = Peer { up: true, applied: peer.applied, ..Peer::default() };
            }
            continue;
        }
        let (_, session) = seat.as_mut().expect("an engine");
        if random.gen_bool(0.02) {
            control.link_down(now, session);
            // the control takes the offset out by itself
            peer = Peer::default();
            continue;
        }
        if random.gen_bool(0.01) {
            peer.meddled = 20;
        }
        let frames = if peer.meddled > 0 { 20 } else { 1 };
        for _ in 0..frames {
            let reaction = session.handle(clock.now(), &Message::Position(peer.frame()));
            if let Reaction::Answer(correction) = reaction {
                peer.applied = correction.offset;
            }
            control.report(session, matches!(reaction, Reaction::Answer(_)));
        }
        if session.engine().needs_new_link() {
            control.link_down(now, session);
            peer = Peer::default();
        }
        instance.stall(&mut random);
    }
    control.channels.progress.cycle_ended.store(true, Relaxed);
    control
}
