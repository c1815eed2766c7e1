//! The cycle thread: connect, shake hands, cycle, and again.

use std::io::{self, ErrorKind};
use std::sync::Arc;
use std::time::Duration;

use super::age::AgeEstimator;
use super::backoff::Backoff;
use super::channels::{CycleChannels, LastOffset, Report};
use super::clock::Clock;
use super::connection::{Connecting, Connection, seconds};
use super::control::{Control, Start};
use super::cycle::{Cycle, SLICE};
use super::cycle_time::CycleTimeMonitor;
use super::handshake::{self, LinkError};
use super::link::{self, ControlLink, Received};
use super::link_end::LinkEnd;
use super::link_session::LinkSession;
use super::load::Loaded;
use super::realtime;
use volcomp_protocol::{CloseReason, ControlHello, Message, PROTOCOL_VERSION};
use volcomp_units::MonoTime;

/// Pause between two looks at a connection that is being made.
const CONNECT_POLL: Duration = Duration::from_millis(2);
/// A link that lasted this long, s, makes the pauses start over (`docs/reference/protocol-session.md`, section 6.2).
const PROVEN_S: f64 = 10.0;
/// A link that is up, and what the control said of itself.
type Opened = (Box<dyn ControlLink>, ControlHello);

/// The cycle thread's own state.
#[derive(Debug)]
pub(super) struct Worker {
    loaded: Arc<Loaded>,
    control: Control,
    clock: Clock,
    backoff: Backoff,
    /// The engine lives on over links with the same control, and with it its faults.
    session: Option<(ControlHello, LinkSession)>,
}

impl Worker {
    pub(super) fn new(loaded: Arc<Loaded>, start: Start, channels: CycleChannels, clock: Clock) -> Self {
        let control = Control::new(channels, &loaded.config, start);
        let backoff = Backoff::new(loaded.config.link.reconnect_s);
        Self { loaded, control, clock, backoff, session: None }
    }

    /// The thread's life: returns when the service asked it to stop.
    pub(super) fn run(mut self) {
        let report = realtime::apply(&self.loaded.config.realtime);
        self.control.channels.report(Report::Realtime(report));
        let offset = loop {
            match self.open() {
                Ok(Some((link, hello))) => {
                    if let Some(offset) = self.serve(link, &hello) {
                        break offset;
                    }
                }
                Ok(None) => break LastOffset::NoLink,
                Err(error) => self.failed(error),
            }
            if self.control.stopping() {
                break LastOffset::NoLink;
            }
        };
        self.control.channels.report(Report::Stopped { offset });
    }

    /// Connects and shakes hands; `None` where a stop came in between.
    fn open(&mut self) -> Result<Option<Opened>, LinkError> {
        let loaded = Arc::clone(&self.loaded);
        let config = &loaded.config;
        let address = config.link.address;
        let connect = |source| LinkError::Connect { address, source };
        let limit_s = config.link.connect_timeout_s;
        let deadline = self.clock.now().plus_seconds(limit_s);
        let connecting = Connecting::start(address).map_err(connect)?;
        while !connecting.poll().map_err(connect)? {
            if self.idle(CONNECT_POLL) {
                return Ok(None);
            }
            if self.clock.now() >= deadline {
                return Err(LinkError::Timeout { address, waiting_for: "connection", limit_s });
            }
        }
        let mut connection =
            connecting.finish(&config.link, &config.realtime, self.clock).map_err(connect)?;
        if !self.secure(&mut connection, deadline)? {
            return Ok(None);
        }
        let mut link = link::driver(connection, &config.link);
        match self.handshake(&mut *link, deadline) {
            Ok(Some(hello)) => Ok(Some((link, hello))),
            // no close frame: the control may hold an offset that it has to take out by itself
            Ok(None) => Ok(None),
            Err(error) => {
                if let Some((code, detail)) = error.report() {
                    link.close(Some((code, &detail)), CloseReason::Error);
                }
                Err(error)
            }
        }
    }

    /// The TLS handshake, where there is to be one; false where a stop came in between.
    fn secure(&mut self, link: &mut Connection, deadline: MonoTime) -> Result<bool, LinkError> {
        let loaded = Arc::clone(&self.loaded);
        let Some(identity) = &loaded.identity else { return Ok(true) };
        let address = loaded.config.link.address;
        let failed = |source: io::Error| match source.kind() {
            ErrorKind::UnexpectedEof => LinkError::ClosedBeforeTls { address },
            _ => LinkError::of_stream(address, source),
        };
        link.secure(identity).map_err(failed)?;
        while !link.shake(SLICE).map_err(failed)? {
            if self.clock.now() >= deadline {
                let limit_s = loaded.config.link.connect_timeout_s;
                return Err(LinkError::Timeout { address, waiting_for: "TLS handshake", limit_s });
            }
            if self.idle(Duration::ZERO) {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// Exchanges hellos, checks them, and has an engine ready.
    fn handshake(
        &mut self,
        link: &mut dyn ControlLink,
        deadline: MonoTime,
    ) -> Result<Option<ControlHello>, LinkError> {
        let loaded = Arc::clone(&self.loaded);
        let config = &loaded.config;
        let address = config.link.address;
        let connect = |source| LinkError::of_stream(address, source);
        link.send(&Message::DaemonHello(handshake::daemon_hello(config))).map_err(connect)?;
        let message = loop {
            if let Some(message) =
                link.next_message().map_err(|source| LinkError::of_frame(address, source))?
            {
                break message;
            }
            if self.clock.now() >= deadline {
                let limit_s = config.link.connect_timeout_s;
                return Err(LinkError::Timeout { address, waiting_for: "hello", limit_s });
            }
            if self.idle(Duration::ZERO) {
                return Ok(None);
            }
            if link.receive(SLICE).map_err(connect)? == Received::Closed {
                return Err(LinkError::Closed { address });
            }
        };
        let hello = match message {
            Message::ControlHello(hello) => hello,
            Message::Error(report) => {
                let machine = config.machine.clone();
                return Err(LinkError::Refused {
                    address,
                    machine,
                    code: report.code,
                    detail: report.detail,
                });
            }
            Message::Close(_) => return Err(LinkError::Closed { address }),
            Message::Position(_) => return Err(LinkError::Unexpected { address, found: "position" }),
            Message::Tool(_) => return Err(LinkError::Unexpected { address, found: "tool" }),
            Message::Heartbeat(_) => return Err(LinkError::Unexpected { address, found: "heartbeat" }),
            Message::DaemonHello(_) => {
                return Err(LinkError::Unexpected { address, found: "daemon hello" });
            }
            Message::Correction(_) => {
                return Err(LinkError::Unexpected { address, found: "correction" });
            }
        };
        if hello.version != PROTOCOL_VERSION {
            return Err(LinkError::Version { address, found: hello.version });
        }
        self.prepare(&hello)?;
        link.life_signs().received = self.clock.now();
        Ok(Some(hello))
    }

    /// An engine for this control: the present one where nothing about the control has changed.
    fn prepare(&mut self, hello: &ControlHello) -> Result<(), LinkError> {
        let address = self.loaded.config.link.address;
        let config = self
            .loaded
            .config
            .engine_config(hello)
            .map_err(|source| LinkError::Mismatch { address, source })?;
        self.control
            .prepare(self.clock.now(), &config, hello, &mut self.session)
            .map_err(|source| LinkError::Engine { address, source })
    }

    /// One link from up to down; says where the offset was where the link ended by a stop.
    fn serve(&mut self, mut link: Box<dyn ControlLink>, hello: &ControlHello) -> Option<LastOffset> {
        let (_, session) = self.session.as_mut()?;
        let config = &self.loaded.config;
        self.control.channels.report(Report::LinkUp { address: config.link.address, hello: *hello });
        let up = self.clock.now();
        self.control.link_up(up, hello, session);
        let mut cycle = Cycle {
            control: &mut self.control,
            session,
            clock: self.clock,
            limits: &config.link,
            ages: AgeEstimator::new(),
            cycle_time: CycleTimeMonitor::new(config.link.cycle_s),
            cycles: 0,
        };
        let end = cycle.run(&mut *link);
        let cycles = cycle.cycles;
        if let Some((error, reason)) = end.close_frame() {
            link.close(error, reason);
        }
        let released = cycle.session.is_released();
        cycle.control.link_down(self.clock.now(), cycle.session);
        self.control.channels.report(Report::LinkDown { end, cycles });
        if let LinkEnd::Stopped { at_rest } = end {
            return Some(match (at_rest, released) {
                (true, _) => LastOffset::AtRest,
                (false, true) => LastOffset::Released,
                (false, false) => LastOffset::OnItsWay,
            });
        }
        if self.clock.now().seconds_since(up) >= PROVEN_S {
            self.backoff.reset();
        }
        let pause = self.backoff.pause();
        self.pause(pause);
        None
    }

    fn failed(&mut self, error: LinkError) {
        let pause = if error.needs_a_person() { self.backoff.longest() } else { self.backoff.pause() };
        self.control.channels.report(Report::ConnectFailed { error, pause });
        self.pause(pause);
    }

    /// Waits, but shows life and listens to the service all the while.
    fn pause(&mut self, pause: Duration) {
        let until = self.clock.now().plus_seconds(pause.as_secs_f64());
        loop {
            let left = until.seconds_since(self.clock.now());
            if left <= 0.0 || self.idle(seconds(left).min(SLICE)) {
                return;
            }
        }
    }

    /// Sleeps once, shows life, takes requests; true where a stop has been asked for.
    fn idle(&mut self, sleep: Duration) -> bool {
        if !sleep.is_zero() {
            std::thread::sleep(sleep);
        }
        self.control.channels.progress.beat();
        let now = self.clock.now();
        self.control.take_requests(now, self.session.as_mut().map(|(_, session)| session));
        self.control.stopping()
    }
}
