//! Everything that passes between the cycle thread and the service.
//!
//! The cycle thread only ever uses `try_send`, `try_recv` and relaxed atomics. The service must never block on
//! these channels: a sleeping receiver would make the sender take the channel's wake-up lock; it polls instead.

use core::sync::atomic::{
    AtomicBool, AtomicI64, AtomicU8, AtomicU16, AtomicU64,
    Ordering::{Acquire, Relaxed, Release},
};
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use crossbeam_channel::{Receiver, Sender, bounded};

use super::handshake::LinkError;
use super::link_end::LinkEnd;
use super::realtime::RealtimeReport;
use super::recorder::Tap;
use volcomp_engine::{Command, Event, Reason, ShadowScore, State};
use volcomp_model::Model;
use volcomp_protocol::{ControlHello, MachineState};
use volcomp_units::MonoTime;
use volcomp_units::axes::AxisArray;

/// Records in flight: two seconds at 4 kHz.
const RECORDS: usize = 8192;
/// Reports in flight.
const REPORTS: usize = 1024;
/// Requests in flight.
const REQUESTS: usize = 16;

/// What the service asks of the cycle thread.
#[derive(Debug, Clone)]
pub(super) enum Request {
    /// A command for the engine; remembered while there is none.
    Engine(Command),
    /// Go on with another model. The service keeps the old one until this has been carried out, so that nothing is
    /// freed on the cycle.
    Model {
        /// The model.
        model: Arc<Model>,
        /// BLAKE3 of its file.
        hash: [u8; 32],
    },
    /// Work the correction out beside the machine without applying it, or stop that.
    Shadow(bool),
}

impl Request {
    /// True for an order that takes compensation out: it is carried out however late it comes.
    pub(super) const fn is_safe(&self) -> bool {
        matches!(
            self,
            Self::Engine(Command::Disable | Command::KeepFault | Command::Stop) | Self::Shadow(false)
        )
    }
}

/// A request with its number.
#[derive(Debug, Clone)]
pub(super) struct Ticket {
    pub(super) number: u64,
    pub(super) request: Request,
    /// Not carried out any more from then on: its client has been told so. [`Request::is_safe`] ones always are.
    pub(super) expires: MonoTime,
}

/// A stop that was asked for by a signal.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum StopWish {
    /// None.
    No,
    /// Ramp to the rest offset, close the link, end the thread.
    Clean,
    /// Close the link and end the thread at once.
    Now,
}

/// Something rare that belongs into the log.
#[derive(Debug)]
#[expect(clippy::large_enum_variant, reason = "a box would be allocated on the cycle")]
pub(super) enum Report {
    /// Scheduling and memory settings of the cycle thread.
    Realtime(RealtimeReport),
    /// No link: why, and the pause before the next attempt.
    ConnectFailed { error: LinkError, pause: Duration },
    /// The link is up.
    LinkUp { address: SocketAddr, hello: ControlHello },
    /// The link is gone.
    LinkDown { end: LinkEnd, cycles: u64 },
    /// The engine says what happened.
    Engine(Event),
    /// What the shadow engine would have done so far and the state it would be in; `None` where it has just been
    /// switched on or off.
    Shadow(Option<(State, ShadowScore)>),
    /// The service gives no sign of life: compensation was switched off.
    ServiceSilent,
    /// The thread ends as it was asked to.
    Stopped { offset: LastOffset },
}

/// Where the offset was when the thread ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum LastOffset {
    /// At its rest value.
    AtRest,
    /// A fault is latched, so nothing was sent, and the control reported no offset.
    Released,
    /// Not yet at its rest value.
    OnItsWay,
    /// There was no link.
    NoLink,
}

/// One position frame, for statistics and status.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct CycleRecord {
    /// False where nothing may be sent: offset, correction and times are not those of this frame.
    pub(super) answered: bool,
    pub(super) state: State,
    pub(super) machine_state: MachineState,
    pub(super) limited: u8,
    pub(super) warning: u8,
    pub(super) out_of_range: u8,
    pub(super) lagging: u8,
    /// Control cycles from a position to the effect of its correction, where they could be measured.
    pub(super) lag_cycles: Option<u32>,
    /// Offset asked for, mm or rad.
    pub(super) offset: AxisArray,
    /// Correction asked for by the model, times the gain, mm or rad.
    pub(super) wanted: AxisArray,
    /// Commanded position, mm or deg.
    pub(super) position: AxisArray,
    /// Offset read back, mm or deg.
    pub(super) applied: AxisArray,
    /// Age of the position when the correction had been handed to the kernel, ns.
    pub(super) age_ns: i64,
    /// From the frame's bytes in hand to the correction handed to the kernel, ns.
    pub(super) turnaround_ns: i64,
    /// From the frame's bytes in hand to the correction computed, ns.
    pub(super) compute_ns: i64,
}

/// Counters that the cycle thread writes and anybody reads.
#[derive(Debug, Default)]
pub(super) struct Progress {
    /// Counts turns of the cycle thread's loops, link or no link: its sign of life.
    pub(super) beats: AtomicU64,
    /// Position frames handled.
    pub(super) cycles: AtomicU64,
    /// Of these: answered later than one cycle after the sample, or not answered because a newer one was there.
    pub(super) late: AtomicU64,
    /// Of the late: not answered.
    pub(super) skipped: AtomicU64,
    /// Frames that were old or repeated.
    pub(super) out_of_order: AtomicU64,
    /// Cycles in which a limit of size, rate or acceleration held an offset back.
    pub(super) limited: AtomicU64,
    /// Cycles in which a soft limit of the machine held an offset back.
    pub(super) at_soft_limit: AtomicU64,
    /// Cycles in which an axis outside the travel of the model was compensated all the same.
    pub(super) out_of_travel: AtomicU64,
    /// Cycles in which the control said that it limits the offset.
    pub(super) control_limited: AtomicU64,
    /// Cycles in which an offset stayed away from its correction for longer than its limits explain.
    pub(super) lagging: AtomicU64,
    /// Cycles in which the control held an offset of an axis that the machine file does not list.
    pub(super) unlisted: AtomicU64,
    /// Cycles in which the interval between frames was not the announced cycle time.
    pub(super) off_cycle: AtomicU64,
    /// That interval, ns.
    pub(super) interval_ns: AtomicI64,
    /// Mean times of calls to a control that is read and written by calls, ns; 0 where there are none.
    pub(super) read_ns: AtomicI64,
    pub(super) write_ns: AtomicI64,
    /// Records that found the queue full.
    pub(super) records_dropped: AtomicU64,
    /// Reports that found the queue full.
    pub(super) reports_dropped: AtomicU64,
    /// Number of the newest request that was looked at.
    requests_done: AtomicU64,
    /// Bit k: the newest request whose number is k modulo 64 was refused.
    requests_refused: AtomicU64,
    /// Counts turns of the service's loop: its sign of life for the cycle thread.
    pub(super) service_beats: AtomicU64,
    /// The stop that signals have asked for, as [`StopWish`].
    stop: AtomicU8,
    /// The cycle thread has ended.
    pub(super) cycle_ended: AtomicBool,
    /// State of the engine, by its code.
    state: AtomicU8,
    /// Why an enabled compensation waits, by its number in the catalogue, or 0.
    waits_for: AtomicU16,
    /// Whether the link is up.
    link: AtomicBool,
    /// Whether compensation is wanted by the operator or the configuration.
    pub(super) wanted: AtomicBool,
}

impl Progress {
    pub(super) fn beat(&self) {
        // the cycle thread is the only writer: a plain add needs no locked instruction
        self.beats.store(self.beats.load(Relaxed).wrapping_add(1), Relaxed);
    }

    /// A sign of life of the service.
    pub(super) fn service_beat(&self) {
        self.service_beats.fetch_add(1, Relaxed);
    }

    /// Asks for a stop; a stop at once is never taken back.
    pub(super) fn ask_stop(&self, wish: StopWish) {
        self.stop.fetch_max(wish as u8, Relaxed);
    }

    /// The stop that was asked for.
    pub(super) fn stop(&self) -> StopWish {
        match self.stop.load(Relaxed) {
            0 => StopWish::No,
            1 => StopWish::Clean,
            _ => StopWish::Now,
        }
    }

    /// A request was looked at. Everything stored before is seen by whoever sees this.
    pub(super) fn done(&self, number: u64, refused: bool) {
        let bit = 1 << (number % 64);
        let bits = self.requests_refused.load(Relaxed);
        self.requests_refused.store(if refused { bits | bit } else { bits & !bit }, Relaxed);
        self.requests_done.store(number, Release);
    }

    /// Whether a request was looked at.
    pub(super) fn is_done(&self, number: u64) -> bool {
        self.requests_done.load(Acquire) >= number
    }

    /// Whether a request that was looked at was refused.
    pub(super) fn is_refused(&self, number: u64) -> bool {
        self.requests_refused.load(Relaxed) >> (number % 64) & 1 == 1
    }

    pub(super) fn add(counter: &AtomicU64, count: u64) {
        counter.store(counter.load(Relaxed).wrapping_add(count), Relaxed);
    }

    pub(super) fn set_state(&self, state: State) {
        self.state.store(state.code(), Relaxed);
    }

    pub(super) fn set_waits_for(&self, reason: Option<Reason>) {
        self.waits_for.store(reason.map_or(0, |reason| reason as u16), Relaxed);
    }

    /// Why an enabled compensation waits.
    pub(super) fn waits_for(&self) -> Option<Reason> {
        let number = self.waits_for.load(Relaxed);
        Reason::ALL.into_iter().find(|reason| *reason as u16 == number)
    }

    pub(super) fn set_link(&self, up: bool) {
        self.link.store(up, Relaxed);
    }

    /// State of the engine; `None` while there is no link.
    pub(super) fn state(&self) -> Option<State> {
        self.link.load(Relaxed).then(|| self.engine_state())
    }

    /// True while a fault is latched, with or without a link.
    pub(super) fn is_faulted(&self) -> bool {
        self.engine_state() == State::Faulted
    }

    fn engine_state(&self) -> State {
        let code = self.state.load(Relaxed);
        State::from_code(code).unwrap_or(State::Off)
    }
}

/// The cycle thread's ends.
#[derive(Debug)]
pub(super) struct CycleChannels {
    pub(super) requests: Receiver<Ticket>,
    reports: Sender<Report>,
    records: Sender<CycleRecord>,
    pub(super) progress: Arc<Progress>,
    /// The recording's end, until an engine has it.
    pub(super) tap: Option<Tap>,
}

impl CycleChannels {
    /// Passes a report on, or counts it as dropped.
    pub(super) fn report(&self, report: Report) {
        if self.reports.try_send(report).is_err() {
            Progress::add(&self.progress.reports_dropped, 1);
        }
    }

    /// Passes a record on, or counts it as dropped.
    pub(super) fn record(&self, record: CycleRecord) {
        if self.records.try_send(record).is_err() {
            Progress::add(&self.progress.records_dropped, 1);
        }
    }
}

/// The service's ends.
#[derive(Debug)]
pub(super) struct ServiceChannels {
    pub(super) requests: Sender<Ticket>,
    pub(super) reports: Receiver<Report>,
    pub(super) records: Receiver<CycleRecord>,
    pub(super) progress: Arc<Progress>,
}

/// Both ends.
pub(super) fn channels() -> (CycleChannels, ServiceChannels) {
    let (request_sender, requests) = bounded(REQUESTS);
    let (reports, report_receiver) = bounded(REPORTS);
    let (records, record_receiver) = bounded(RECORDS);
    let progress = Arc::new(Progress::default());
    let cycle = CycleChannels { requests, reports, records, progress: Arc::clone(&progress), tap: None };
    let (requests, reports, records) = (request_sender, report_receiver, record_receiver);
    (cycle, ServiceChannels { requests, reports, records, progress })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_state_survives_its_code() {
        let progress = Progress::default();
        progress.set_link(true);
        for state in State::ALL {
            progress.set_state(state);
            assert_eq!(progress.state(), Some(state));
        }
        progress.set_state(State::Faulted);
        assert!(progress.is_faulted());
        progress.set_link(false);
        assert_eq!(progress.state(), None);
        assert!(progress.is_faulted(), "a fault outlives the link");
    }

    #[test]
    fn every_reason_to_wait_survives_its_code() {
        let progress = Progress::default();
        assert_eq!(progress.waits_for(), None);
        for reason in Reason::ALL.map(Some).into_iter().chain([None]) {
            progress.set_waits_for(reason);
            assert_eq!(progress.waits_for(), reason);
        }
    }

    #[test]
    fn each_request_has_its_own_verdict() {
        let progress = Progress::default();
        progress.done(5, true);
        progress.done(6, false);
        progress.done(7, true);
        assert_eq!(
            [5, 6, 7].map(|n| (progress.is_done(n), progress.is_refused(n))),
            [(true, true), (true, false), (true, true)]
        );
        assert!(!progress.is_done(8));
        progress.done(5 + 64, false);
        assert!(!progress.is_refused(5 + 64));
    }

    #[test]
    fn a_stop_at_once_is_not_taken_back() {
        let progress = Progress::default();
        assert_eq!(progress.stop(), StopWish::No);
        for (wish, then) in [
            (StopWish::Clean, StopWish::Clean),
            (StopWish::Now, StopWish::Now),
            (StopWish::Clean, StopWish::Now),
        ] {
            progress.ask_stop(wish);
            assert_eq!(progress.stop(), then);
        }
    }

    #[test]
    fn a_full_queue_drops_and_counts() {
        let (cycle, service) = channels();
        for _ in 0..REPORTS + 3 {
            cycle.report(Report::Stopped { offset: LastOffset::AtRest });
        }
        assert_eq!(service.progress.reports_dropped.load(Relaxed), 3);
        assert_eq!(service.reports.len(), REPORTS);
    }
}
