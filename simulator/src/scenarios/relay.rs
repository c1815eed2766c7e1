//! A relay between daemon and control that does to the frames whatever a scenario asks for.

#![expect(clippy::disallowed_methods, reason = "a relay has sockets and threads")]

use std::io::{self, ErrorKind, Read, Write};
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex, PoisonError, mpsc};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use volcomp_protocol::frame::{HEADER_LEN, Header};
use volcomp_protocol::{Message, decode};
use volcomp_units::axes::{AxisArray, MAX_AXES};

use super::fault::{Direction, FaultKind, Lane, LinkFault, Passage};
use crate::monitor::{DirectionTap, SharedMonitor};

/// Longest wait of a pump before it looks whether the relay has ended.
const SLICE: Duration = Duration::from_millis(20);

/// The link as it should be.
const NO_FAULT: LinkFault =
    LinkFault { kind: FaultKind::None, direction: Direction::ToDaemon, every: 1, frames: None };

/// What pumps and the scenario share.
struct Shared {
    /// Number of the fault, the fault, and the frames that it has met.
    fault: Mutex<(u64, LinkFault, u64)>,
    ended: AtomicBool,
    links: AtomicU64,
    seed: u64,
    /// Watches the daemon's end: what the daemon receives and what it sends.
    monitor: Option<SharedMonitor>,
    /// The offset in the daemon's newest correction.
    asked: Mutex<AxisArray>,
}

/// A relay in front of a control.
pub struct Relay {
    address: SocketAddr,
    shared: Arc<Shared>,
    acceptor: Option<JoinHandle<()>>,
}

impl Relay {
    /// Listens on a free port of loopback and passes every connection on to `control`; a monitor sees the frames as the
    /// daemon does, behind whatever damage the relay has done.
    ///
    /// # Errors
    /// It cannot listen.
    pub fn open(control: SocketAddr, seed: u64, monitor: Option<SharedMonitor>) -> io::Result<Self> {
        let listener = TcpListener::bind(("127.0.0.1", 0))?;
        listener.set_nonblocking(true)?;
        let address = listener.local_addr()?;
        let shared = Arc::new(Shared {
            fault: Mutex::new((0, NO_FAULT, 0)),
            ended: AtomicBool::new(false),
            links: AtomicU64::new(0),
            seed,
            monitor,
            asked: Mutex::new([0.0; MAX_AXES]),
        });
        let inside = Arc::clone(&shared);
        let acceptor = std::thread::Builder::new().name("relay".to_owned()).spawn(move || {
            let mut pumps = Vec::new();
            while !inside.ended.load(Relaxed) {
                match listener.accept() {
                    Ok((daemon, _)) => pumps.extend(connect(daemon, control, &inside).unwrap_or_default()),
                    Err(_) => std::thread::sleep(Duration::from_millis(2)),
                }
            }
            for pump in pumps {
                // a pump that has panicked has nothing more to say
                let _ = pump.join();
            }
        })?;
        Ok(Self { address, shared, acceptor: Some(acceptor) })
    }

    /// Where the daemon connects to.
    #[must_use]
    pub const fn address(&self) -> SocketAddr {
        self.address
    }

    /// From now on this happens to the frames.
    ///
    /// The fault that ends with it, where it has met no frame at all.
    pub fn set(&self, fault: LinkFault) -> Option<LinkFault> {
        let mut now = self.shared.fault.lock().unwrap_or_else(PoisonError::into_inner);
        let (number, before, met) = *now;
        *now = (number + 1, fault, 0);
        (before.kind != FaultKind::None && met < before.every).then_some(before)
    }

    /// As [`Relay::set`] without any fault.
    pub fn clear(&self) -> Option<LinkFault> {
        self.set(NO_FAULT)
    }

    /// Connections so far.
    #[must_use]
    pub fn links(&self) -> u64 {
        self.shared.links.load(Relaxed)
    }
}

impl Drop for Relay {
    fn drop(&mut self) {
        self.shared.ended.store(true, Relaxed);
        if let Some(acceptor) = self.acceptor.take() {
            // nothing is left to be done where it has panicked
            let _ = acceptor.join();
        }
    }
}

fn connect(daemon: TcpStream, control: SocketAddr, shared: &Arc<Shared>) -> io::Result<Vec<JoinHandle<()>>> {
    let link = shared.links.fetch_add(1, Relaxed);
    let control = TcpStream::connect_timeout(&control, Duration::from_secs(1))?;
    for socket in [&daemon, &control] {
        socket.set_nonblocking(false)?;
        socket.set_nodelay(true)?;
        socket.set_read_timeout(Some(SLICE))?;
    }
    // a connection is reset when the last handle of a socket that does not linger is closed
    let dead = Arc::new(AtomicBool::new(false));
    let pairs = [(control.try_clone()?, daemon.try_clone()?, false), (daemon, control, true)];
    pairs
        .into_iter()
        .map(|(from, to, to_control)| {
            let (shared, dead) = (Arc::clone(shared), Arc::clone(&dead));
            let seed = shared.seed ^ (link << 1 | u64::from(to_control));
            let tap = shared.monitor.clone().map(|monitor| DirectionTap::new(monitor, link));
            std::thread::Builder::new().name("relay pump".to_owned()).spawn(move || {
                let _ = pump(&from, &to, to_control, (&shared, &dead), (seed, tap));
                if !dead.load(Relaxed) {
                    // the other direction ends, too
                    let _ = from.shutdown(Shutdown::Both);
                    let _ = to.shutdown(Shutdown::Both);
                }
            })
        })
        .collect()
}

/// Passes frames on until the connection ends.
fn pump(
    mut from: &TcpStream,
    to: &TcpStream,
    to_control: bool,
    (shared, dead): (&Shared, &AtomicBool),
    (seed, tap): (u64, Option<DirectionTap>),
) -> io::Result<()> {
    // the daemon's end: frames are seen as they come from it, and as they are written to it
    let (mut incoming, outgoing) = if to_control { (tap, None) } else { (None, tap) };
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut random = move || random.random::<f64>();
    let (mut bytes, mut chunk) = (Vec::new(), [0; 4096]);
    let (mut lane, mut seen, mut silent) = (Lane::default(), 0, false);
    let (queue, due) = mpsc::channel::<(Instant, Vec<u8>)>();
    let writer = to.try_clone()?;
    std::thread::Builder::new()
        .name("relay writer".to_owned())
        .spawn(move || write_in_time(&writer, &due, outgoing))?;
    let mut free = Instant::now();
    while !shared.ended.load(Relaxed) && !dead.load(Relaxed) {
        match from.read(&mut chunk) {
            Ok(0) => break,
            Ok(n) => {
                bytes.extend_from_slice(&chunk[..n]);
                if let Some(tap) = &mut incoming {
                    tap.feed(&chunk[..n]);
                }
            }
            Err(e) if matches!(e.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {}
            Err(e) => return Err(e),
        }
        while let Some(frame) = next_frame(&mut bytes) {
            let (number, fault, met) = {
                let mut now = shared.fault.lock().unwrap_or_else(PoisonError::into_inner);
                now.2 += u64::from(now.1.direction.meets(to_control));
                *now
            };
            if number != seen {
                seen = number;
                lane.renew();
            }
            if silent {
                continue;
            }
            let mut asked = shared.asked.lock().unwrap_or_else(PoisonError::into_inner);
            if let Ok(Message::Correction(correction)) = decode(&frame) {
                *asked = correction.offset;
            }
            lane.asked = *asked;
            drop(asked);
            let concerned = fault.direction.meets(to_control);
            let fault = if concerned { fault } else { LinkFault { kind: FaultKind::None, ..fault } };
            for passage in lane.pass(&fault, met, &frame, &mut random) {
                let now = Instant::now();
                match passage {
                    // frames keep their order, however late they are
                    Passage::Later(delay, piece) => {
                        free = free.max(now + delay);
                        queue.send((free, piece)).map_err(io::Error::other)?;
                    }
                    Passage::Write(pause, piece) => {
                        free = free.max(now) + pause;
                        queue.send((free, piece)).map_err(io::Error::other)?;
                    }
                    Passage::Reset => {
                        for socket in [from, to] {
                            socket2::SockRef::from(socket).set_linger(Some(Duration::ZERO))?;
                        }
                        dead.store(true, Relaxed);
                        return Ok(());
                    }
                    Passage::Close => return Ok(()),
                    Passage::Silence => silent = true,
                }
            }
        }
    }
    Ok(())
}

/// Writes each piece when it is due.
fn write_in_time(
    mut to: &TcpStream,
    due: &mpsc::Receiver<(Instant, Vec<u8>)>,
    mut tap: Option<DirectionTap>,
) {
    while let Ok((at, piece)) = due.recv() {
        let wait = at.saturating_duration_since(Instant::now());
        if !wait.is_zero() {
            std::thread::sleep(wait);
        }
        if let Some(tap) = &mut tap {
            tap.feed(&piece);
        }
        if to.write_all(&piece).is_err() {
            return;
        }
    }
}

/// Takes the first whole frame out of `bytes`; what is no frame is passed on as it is.
fn next_frame(bytes: &mut Vec<u8>) -> Option<Vec<u8>> {
    if bytes.len() < HEADER_LEN {
        return None;
    }
    let length = match Header::parse(bytes) {
        Ok(Some(header)) => header.length,
        Ok(None) => return None,
        Err(_) => bytes.len(),
    };
    (bytes.len() >= length).then(|| bytes.drain(..length).collect())
}
