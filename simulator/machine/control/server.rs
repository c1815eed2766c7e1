//! Listening, greeting, refusing: everything about a connection before the cycle takes it over.
//!
//! One thread accepts; each greeting has a thread of its own, so that one slow peer does not keep the others waiting;
//! at most [`GREETINGS`] at a time.

use core::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr};
use core::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use core::time::Duration;
use std::io::ErrorKind;
use std::net::{TcpListener, TcpStream};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Instant;

use socket2::{Domain, Protocol, SockRef, Socket, TcpKeepalive, Type};
use volcomp_protocol::read_write::{LINE_MAX, Reply};
use volcomp_protocol::{
    ControlHello, DaemonHello, ErrorCode, ErrorReport, FrameReader, MAX_FRAME, Message, Name,
    PROTOCOL_VERSION, Tool, encode,
};

use super::calls::Calls;
use super::config::{ControlConfig, Interface};
use super::error::{ControlError, LinkEvent};
use super::link::{Codec, Link, drain};
use super::wire::{ControlIdentity, Wire};

/// Time for the hello of a daemon.
const HELLO: Duration = Duration::from_secs(1);
/// Connections being greeted at a time; more are closed at once.
const GREETINGS: usize = 8;
/// Link events kept for the cycle to report; more are dropped.
const EVENTS: usize = 256;

/// What greeting threads and the cycle share.
pub(super) struct Shared {
    hello: ControlHello,
    interface: Interface,
    peer: Option<IpAddr>,
    identity: Option<ControlIdentity>,
    /// Silence of the daemon after which the link is dead.
    pub(super) silence: Duration,
    pub(super) tool: Mutex<Option<Tool>>,
    /// A daemon has the place.
    pub(super) occupied: AtomicBool,
    stopping: AtomicBool,
    greeting: AtomicUsize,
}

/// The listening side.
pub(super) struct Server {
    pub(super) address: SocketAddr,
    pub(super) shared: Arc<Shared>,
    links: Receiver<Link>,
    events: Receiver<LinkEvent>,
    thread: Option<JoinHandle<()>>,
}

impl Server {
    pub(super) fn bind(
        address: SocketAddr,
        hello: ControlHello,
        tool: Option<Tool>,
        config: &ControlConfig,
    ) -> Result<Self, ControlError> {
        let ControlConfig { peer, identity, silence, interface, .. } = config.clone();
        let listener = listen(address).map_err(|source| match source.kind() {
            ErrorKind::AddrInUse => ControlError::InUse { address },
            _ => ControlError::Listen { address, source },
        })?;
        let failed = |source| ControlError::Listen { address, source };
        let bound = listener.local_addr().map_err(failed)?;
        let shared = Arc::new(Shared {
            hello,
            interface,
            peer,
            identity,
            silence,
            tool: Mutex::new(tool),
            occupied: AtomicBool::new(false),
            stopping: AtomicBool::new(false),
            greeting: AtomicUsize::new(0),
        });
        // one link at a time can be under way, because it holds the place
        let (link_out, links) = sync_channel(1);
        let (event_out, events) = sync_channel(EVENTS);
        let for_thread = Arc::clone(&shared);
        let thread = std::thread::Builder::new()
            .name("cnc-accept".into())
            .spawn(move || accept(&listener, &for_thread, &link_out, &event_out))
            .map_err(failed)?;
        Ok(Self { address: bound, shared, links, events, thread: Some(thread) })
    }

    /// A daemon that has just been greeted.
    pub(super) fn link(&self) -> Option<Link> {
        self.links.try_recv().ok()
    }

    /// A daemon that is greeted within a time.
    pub(super) fn wait(&self, limit: Duration) -> Option<Link> {
        self.links.recv_timeout(limit).ok()
    }

    pub(super) fn event(&self) -> Option<LinkEvent> {
        self.events.try_recv().ok()
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.shared.stopping.store(true, Ordering::Release);
        // wakes the accepting thread
        let mut wake = self.address;
        if wake.ip().is_unspecified() {
            wake.set_ip(match wake.ip() {
                IpAddr::V4(_) => Ipv4Addr::LOCALHOST.into(),
                IpAddr::V6(_) => Ipv6Addr::LOCALHOST.into(),
            });
        }
        let woken = TcpStream::connect_timeout(&wake, Duration::from_millis(500)).is_ok();
        if let Some(thread) = self.thread.take()
            && woken
        {
            let _ = thread.join();
        }
    }
}

fn listen(address: SocketAddr) -> std::io::Result<TcpListener> {
    let socket = Socket::new(Domain::for_address(address), Type::STREAM, Some(Protocol::TCP))?;
    // a control that restarts must not wait for old connections to time out
    socket.set_reuse_address(true)?;
    socket.bind(&address.into())?;
    socket.listen(16)?;
    Ok(socket.into())
}

fn accept(
    listener: &TcpListener,
    shared: &Arc<Shared>,
    links: &SyncSender<Link>,
    events: &SyncSender<LinkEvent>,
) {
    for stream in listener.incoming() {
        if shared.stopping.load(Ordering::Acquire) {
            return;
        }
        let Ok(stream) = stream else {
            // out of file descriptors, or reset before accept: go on, but not in a tight loop
            std::thread::sleep(Duration::from_millis(10));
            continue;
        };
        if shared.greeting.fetch_add(1, Ordering::AcqRel) >= GREETINGS {
            shared.greeting.fetch_sub(1, Ordering::AcqRel);
            continue;
        }
        let (for_thread, links, events) = (Arc::clone(shared), links.clone(), events.clone());
        let spawned = std::thread::Builder::new().name("cnc-greet".into()).spawn(move || {
            handshake(stream, &for_thread, &links, &events);
            for_thread.greeting.fetch_sub(1, Ordering::AcqRel);
        });
        if spawned.is_err() {
            shared.greeting.fetch_sub(1, Ordering::AcqRel);
        }
    }
}

fn options(stream: &TcpStream) -> std::io::Result<()> {
    let socket = SockRef::from(stream);
    socket.set_tcp_nodelay(true)?;
    let keepalive =
        TcpKeepalive::new().with_time(Duration::from_secs(1)).with_interval(Duration::from_secs(1));
    #[cfg(target_os = "linux")]
    let keepalive = keepalive.with_retries(3);
    socket.set_tcp_keepalive(&keepalive)?;
    #[cfg(target_os = "linux")]
    socket.set_tcp_user_timeout(Some(Duration::from_secs(1)))?;
    socket.set_write_timeout(Some(HELLO))
}

/// Greets one connection and hands it to the cycle, or tells it why not.
fn handshake(
    stream: TcpStream,
    shared: &Arc<Shared>,
    links: &SyncSender<Link>,
    events: &SyncSender<LinkEvent>,
) {
    let Ok(peer) = stream.peer_addr() else { return };
    if options(&stream).is_err() {
        return;
    }
    let Some(mut wire) = wire(stream, peer, shared, events) else { return };
    if let Interface::Calls { hold_ms } = shared.interface {
        call(wire, peer, hold_ms, shared, links, events);
        return;
    }
    let mut reader = FrameReader::default();
    match hello(&mut wire, &mut reader, shared) {
        Ok(daemon) => {
            // from here on the place is this link's, and its end frees it
            let mut link = Link::new(wire, Codec::Frames(Box::new(reader)), Arc::clone(shared));
            if welcome(link.wire(), shared).is_ok() {
                let _ = events.try_send(LinkEvent::Connected { peer, software: daemon.software });
                let _ = links.send(link);
            }
        }
        Err(refusal) => {
            // without one it left, or reported an error itself
            if let Some((code, detail)) = refusal {
                let detail = Name::new(&detail);
                let _ = events.try_send(LinkEvent::Refused { peer, code, detail });
                let _ = write(&mut wire, &Message::Error(ErrorReport { code, detail }));
            }
            wire.finish();
            drain(wire.stream());
        }
    }
}

/// Hands a connection that calls to the cycle, which replies from the first call on; a second daemon is refused.
fn call(
    mut wire: Wire,
    peer: SocketAddr,
    hold_ms: u32,
    shared: &Arc<Shared>,
    links: &SyncSender<Link>,
    events: &SyncSender<LinkEvent>,
) {
    if take_place(shared) {
        let tool = *shared.tool.lock().unwrap_or_else(PoisonError::into_inner);
        let calls = Calls::new(&shared.hello, hold_ms, tool);
        let mut link = Link::new(wire, Codec::Calls(Box::new(calls)), Arc::clone(shared));
        // who connects and asks nothing does not keep the place
        if link.first_call(Instant::now() + HELLO) {
            let _ = events.try_send(LinkEvent::Connected { peer, software: Name::new("read and write") });
            let _ = links.send(link);
        }
        return;
    }
    let (code, detail) = (ErrorCode::Busy, Name::new("another daemon is connected"));
    let _ = events.try_send(LinkEvent::Refused { peer, code, detail });
    let mut line = [0; LINE_MAX];
    let length = Reply::Error { is_busy: true, detail }.write(0, &mut line);
    let _ = wire.write_all(&line[..length]);
    wire.finish();
    drain(wire.stream());
}

/// True where the place was free; it is taken now.
fn take_place(shared: &Shared) -> bool {
    shared.occupied.compare_exchange(false, true, Ordering::AcqRel, Ordering::Acquire).is_ok()
}

/// The connection as it is to be used; `None` where it may not be used at all.
fn wire(
    stream: TcpStream,
    peer: SocketAddr,
    shared: &Shared,
    events: &SyncSender<LinkEvent>,
) -> Option<Wire> {
    let allowed = shared.peer.is_none_or(|allowed| same_host(allowed, peer.ip()));
    if !allowed {
        let detail = Name::new("not the address that may connect");
        let _ = events.try_send(LinkEvent::Refused { peer, code: ErrorCode::Unexpected, detail });
    }
    let Some(identity) = &shared.identity else {
        let mut wire = Wire::plain(stream);
        if allowed {
            return Some(wire);
        }
        let detail = Name::new("this address may not connect");
        let _ = write(&mut wire, &Message::Error(ErrorReport { code: ErrorCode::Unexpected, detail }));
        drain(wire.stream());
        return None;
    };
    if !allowed {
        // no handshake for a stranger
        return None;
    }
    match Wire::secure(stream, identity, Instant::now() + HELLO) {
        Ok(wire) => Some(wire),
        Err((why, stream)) => {
            let _ = events.try_send(LinkEvent::Insecure { peer, why });
            drain(&stream);
            None
        }
    }
}

/// An IPv4 address may arrive in the clothes of IPv6.
fn same_host(a: IpAddr, b: IpAddr) -> bool {
    a.to_canonical() == b.to_canonical()
}

fn welcome(wire: &mut Wire, shared: &Shared) -> std::io::Result<()> {
    write(wire, &Message::ControlHello(shared.hello))?;
    let tool = *shared.tool.lock().unwrap_or_else(PoisonError::into_inner);
    match tool {
        Some(tool) => write(wire, &Message::Tool(tool)),
        None => Ok(()),
    }
}

fn write(wire: &mut Wire, message: &Message) -> std::io::Result<()> {
    let mut buffer = [0; MAX_FRAME];
    let length = encode(message, &mut buffer);
    wire.write_all(&buffer[..length])
}

type Refusal = Option<(ErrorCode, String)>;

/// Reads and judges the hello; on success the place is taken.
fn hello(wire: &mut Wire, reader: &mut FrameReader, shared: &Shared) -> Result<DaemonHello, Refusal> {
    let busy = || Some((ErrorCode::Busy, "another daemon is connected".to_owned()));
    if shared.occupied.load(Ordering::Acquire) {
        return Err(busy());
    }
    let message = first_message(wire, reader)?;
    let daemon = match message {
        Message::DaemonHello(daemon) => daemon,
        Message::Error(_) | Message::Close(_) => return Err(None),
        _ => return Err(Some((ErrorCode::Unexpected, "DaemonHello expected".to_owned()))),
    };
    if !(daemon.version_min..=daemon.version_max).contains(&PROTOCOL_VERSION) {
        return Err(Some((ErrorCode::Version, format!("this control speaks {PROTOCOL_VERSION}"))));
    }
    if daemon.machine != shared.hello.machine {
        return Err(Some((ErrorCode::WrongMachine, format!("this is {}", shared.hello.machine))));
    }
    if take_place(shared) { Ok(daemon) } else { Err(busy()) }
}

fn first_message(wire: &mut Wire, reader: &mut FrameReader) -> Result<Message, Refusal> {
    let deadline = Instant::now() + HELLO;
    loop {
        match reader.next() {
            Ok(Some(message)) => return Ok(message),
            Ok(None) => {}
            Err(e) => return Err(Some((ErrorCode::BadFrame, e.to_string()))),
        }
        let left = deadline.saturating_duration_since(Instant::now());
        if left.is_zero() || wire.stream().set_read_timeout(Some(left)).is_err() {
            return Err(Some((ErrorCode::Unexpected, "no DaemonHello in time".to_owned())));
        }
        match wire.read(reader.space()) {
            Ok(0) => return Err(None),
            Ok(count) => reader.advance(count),
            Err(e)
                if matches!(
                    e.kind(),
                    ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted
                ) => {}
            Err(_) => return Err(None),
        }
    }
}
