//! The service's side of the channels: drains, logs with bounds, passes requests on.

use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;
use std::time::Duration;

use tracing::{info, warn};

use super::board::{Board, state_name};
use super::clock::Clock;
use super::cycle::LinkEnd;
use super::handshake;
use super::load::Loaded;
use super::logging::LogLimiter;
use super::notices::Notices;
use super::ports::{LastOffset, Progress, Report, Request, ServicePorts, Ticket};
use super::realtime::RealtimeReport;
use super::status::Status;
use crate::core::engine::{Event, State};
use crate::core::fault::{self, Code};
use crate::core::protocol::ControlHello;
use crate::core::units::NS_PER_S;

/// Records taken in one go, so that requests are never kept waiting by statistics.
const RECORDS_AT_ONCE: usize = 4096;

/// The service's view of the cycle thread.
#[derive(Debug)]
pub(super) struct Service {
    ports: ServicePorts,
    board: Board,
    clock: Clock,
    ticket: u64,
    failures: LogLimiter,
    links: LogLimiter,
    events: LogLimiter,
    notices: Notices,
}

impl Service {
    pub(super) fn new(
        loaded: Arc<Loaded>,
        ports: ServicePorts,
        clock: Clock,
    ) -> Result<Self, hdrhistogram::CreationError> {
        let board = Board::new(loaded, Arc::clone(&ports.progress), clock)?;
        Ok(Self {
            ports,
            board,
            clock,
            ticket: 0,
            failures: LogLimiter::new(3, Duration::from_secs(60)),
            links: LogLimiter::new(10, Duration::from_secs(10)),
            events: LogLimiter::new(20, Duration::from_secs(1)),
            notices: Notices::new(clock.now()),
        })
    }

    pub(super) fn progress(&self) -> &Arc<Progress> {
        &self.ports.progress
    }

    /// Passes a request to the cycle thread; gives its number, `None` where the queue is full.
    pub(super) fn request(&mut self, request: Request) -> Option<u64> {
        let number = self.ticket + 1;
        self.ports.requests.try_send(Ticket { number, request }).ok()?;
        self.ticket = number;
        Some(number)
    }

    /// Whether the cycle thread has carried out a request.
    pub(super) fn is_done(&self, number: u64) -> bool {
        self.ports.progress.requests_done.load(Relaxed) >= number
    }

    /// Takes in what the cycle thread has said since the last call.
    pub(super) fn drain(&mut self) {
        // reports first: a link that came up resets the statistics before its first record
        while let Ok(report) = self.ports.reports.try_recv() {
            self.report(report);
        }
        for _ in 0..RECORDS_AT_ONCE {
            let Ok(record) = self.ports.records.try_recv() else { break };
            self.board.record(&record);
        }
        self.notices.look(self.clock.now(), &self.ports.progress);
    }

    pub(super) fn status(&mut self) -> Status {
        self.drain();
        self.board.status()
    }

    pub(super) fn headline(&self) -> String {
        self.board.headline()
    }

    pub(super) fn state(&self) -> &'static str {
        self.board.state()
    }

    fn report(&mut self, report: Report) {
        match report {
            Report::Realtime(report) => {
                self.board.realtime(&report);
                log_realtime(&report);
            }
            Report::ConnectFailed { error, pause } => {
                let text = error.to_string();
                if let Some(held_back) = self.failures.admit(self.clock.now()) {
                    let (retry_s, code) = (pause.as_secs_f64(), error.fault());
                    warn!(retry_s, %code, held_back, "no link: {text}");
                }
                self.board.connect_failed(text);
            }
            Report::LinkUp { address, hello } => {
                if let Some(held_back) = self.links.admit(self.clock.now()) {
                    log_link_up(&address, &hello, held_back);
                }
                self.board.link_up(&hello);
            }
            Report::LinkDown { end, cycles } => {
                match end {
                    LinkEnd::Stopped { .. } => info!(cycles, "link closed: {end}"),
                    _ => {
                        if let Some(held_back) = self.links.admit(self.clock.now()) {
                            warn!(cycles, code = %end.fault(), held_back, "link down: {end}");
                        }
                    }
                }
                self.board.link_down(end.to_string());
            }
            Report::Engine(event) => {
                if let Some(held_back) = self.events.admit(self.clock.now()) {
                    log_event(&event, held_back);
                }
                self.board.event(&event);
            }
            Report::Stopped { offset: LastOffset::AtRest } => info!("the offset is at its rest value"),
            Report::Stopped { offset: LastOffset::NoLink } => {
                info!("there is no link; a control that still holds an offset takes it out by itself");
            }
            Report::Stopped { offset: LastOffset::OnItsWay } => {
                warn!("stopped before the offset was at its rest value; the control takes it out by itself");
            }
        }
    }
}

fn log_realtime(report: &RealtimeReport) {
    let (fifo, affinity) = (report.fifo.text(), report.affinity.text());
    let memory_lock = report.memory_lock.text();
    let (priority, cpu) = (report.priority, report.cpu);
    if report.has_refusal() {
        warn!(
            priority,
            fifo,
            cpu,
            affinity,
            memory_lock,
            code = %Code::REALTIME_REFUSED,
            "real-time settings not fully granted; cycles may be late under load \
             (set LimitRTPRIO= and LimitMEMLOCK= in the unit)"
        );
    } else {
        info!(priority, fifo, cpu, affinity, memory_lock, "real-time settings");
    }
}

fn log_link_up(address: &std::net::SocketAddr, hello: &ControlHello, held_back: u64) {
    let mut axes = String::new();
    for axis in handshake::announced(hello) {
        axes.push(axis.name.letter());
    }
    let cycle_s = hello.cycle_ns as f64 / NS_PER_S;
    info!(%address, control = %hello.software, machine = %hello.machine, axes, cycle_s, held_back, "link up");
}

fn log_event(event: &Event, held_back: u64) {
    let Event::StateChanged { from, to, reason } = event;
    let (from, to_name, entry) = (state_name(*from), state_name(*to), fault::of_reason(*reason));
    let code = entry.code;
    match (to, reason) {
        (State::Faulted | State::Holding, _) => {
            warn!(from, to = to_name, reason = entry.name, %code, held_back, "{}", entry.text);
        }
        _ => info!(from, to = to_name, reason = entry.name, %code, held_back, "{}", entry.text),
    }
}
