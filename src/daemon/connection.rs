//! The TCP connection to the control: options, bytes in and out, plain or over TLS.
//!
//! The socket blocks with a read timeout. The timeout is only handed to the kernel when it has to change, so that a
//! steady link costs one `recv` and one `send` a cycle; the kernel rounds it up to its tick (1 to 10 ms), so shorter
//! waits, as while no positions come, sleep in `poll`, which is exact. With busy
//! polling the thread sleeps in `poll` until shortly before a frame is expected ([`super::poll_schedule`]) and then reads
//! without waiting until it is there.

use std::io::{self, ErrorKind, Read, Write};
use std::net::{Shutdown, SocketAddr, TcpStream};
use std::time::Duration;

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;
use rustix::net::{RecvFlags, SendFlags, recv, send};
use socket2::{Domain, Protocol, SockRef, Socket, TcpKeepalive, Type};

use super::clock::Clock;
use super::link::Received;
use super::poll_schedule::{PollSchedule, Wait};
use super::tls::{Identity, TlsStream};
use volcomp_config::{LinkConfig, RealtimeConfig};
use volcomp_units::MonoTime;

/// Longest blocking write outside the cycle: a control that has not read for that long is gone.
const WRITE_LIMIT: Duration = Duration::from_secs(1);
/// Read timeouts are multiples of this, so that a steady link asks for the same one every cycle.
const TIMEOUT_STEP: Duration = Duration::from_millis(1);
/// Shorter waits than this must be exact: while positions fail, the offset moves once per cycle.
const EXACT: Duration = Duration::from_millis(8);
/// Time for the control to take the last frames in before the socket is closed.
const LINGER: Duration = Duration::from_secs(1);

/// A socket that is being connected.
#[derive(Debug)]
pub(super) struct Connecting {
    socket: Socket,
    address: SocketAddr,
}

/// A connection.
#[derive(Debug)]
pub(super) struct Connection {
    stream: TcpStream,
    /// `None`: the bytes lie on the socket as they are.
    tls: Option<Box<TlsStream>>,
    clock: Clock,
    read_timeout: Duration,
    /// When data are expected; `None` without busy polling.
    poll_schedule: Option<PollSchedule>,
}

impl Connecting {
    /// Starts to connect without waiting.
    pub(super) fn start(address: SocketAddr) -> io::Result<Self> {
        let socket = Socket::new(Domain::for_address(address), Type::STREAM, Some(Protocol::TCP))?;
        socket.set_nonblocking(true)?;
        Ok(Self { socket, address })
    }

    /// True once connected, false while under way.
    pub(super) fn poll(&self) -> io::Result<bool> {
        match self.socket.connect(&self.address.into()) {
            Ok(()) => Ok(true),
            // the raw codes are EINPROGRESS, EALREADY and EISCONN of Linux, for which io has no names
            Err(e) => match (e.kind(), e.raw_os_error()) {
                (ErrorKind::WouldBlock, _) | (_, Some(115 | 114)) => Ok(false),
                (_, Some(106)) => Ok(true),
                _ => Err(e),
            },
        }
    }

    /// Sets the options and hands the connection over.
    pub(super) fn finish(
        self,
        link: &LinkConfig,
        realtime: &RealtimeConfig,
        clock: Clock,
    ) -> io::Result<Connection> {
        let silence = seconds(link.silence_s);
        self.socket.set_nonblocking(false)?;
        self.socket.set_tcp_nodelay(true)?;
        let keepalive = TcpKeepalive::new()
            .with_time(silence.max(Duration::from_secs(1)))
            .with_interval(Duration::from_secs(1))
            .with_retries(3);
        self.socket.set_tcp_keepalive(&keepalive)?;
        let stream: TcpStream = self.socket.into();
        stream.set_write_timeout(Some(silence.clamp(TIMEOUT_STEP, WRITE_LIMIT)))?;
        let socket = SockRef::from(&stream);
        // written bytes that nobody acknowledges end the link as silence does
        socket.set_tcp_user_timeout(Some(silence.max(Duration::from_secs(1))))?;
        // only for the hello: during cycles every position is acknowledged by its own correction
        socket.set_tcp_quickack(true)?;
        Ok(Connection {
            stream,
            tls: None,
            clock,
            read_timeout: Duration::ZERO,
            poll_schedule: (realtime.busy_poll_s > 0.0)
                .then(|| PollSchedule::new(seconds(link.cycle_s), seconds(realtime.busy_poll_s))),
        })
    }
}

impl Connection {
    /// Starts TLS: nothing but [`Self::shake`] may follow until that is done.
    pub(super) fn secure(&mut self, identity: &Identity) -> io::Result<()> {
        self.tls = Some(Box::new(TlsStream::start(identity)?));
        Ok(())
    }

    /// One step of the handshake, waiting up to `wait`; true once it is done.
    pub(super) fn shake(&mut self, wait: Duration) -> io::Result<bool> {
        self.set_read_timeout(wait)?;
        let Some(tls) = &mut self.tls else { return Ok(true) };
        match tls.shake(&mut waiting(&self.stream)) {
            Err(e) if would_block(&e) => Ok(false),
            done => done,
        }
    }

    /// The time now, of the clock of all times on this link.
    pub(super) fn now(&self) -> MonoTime {
        self.clock.now()
    }

    /// Sends bytes.
    ///
    /// # Cycle   no allocation without TLS, no wait
    ///
    /// # Errors
    /// `WouldBlock` where the send buffer is full: part of the bytes may have gone, so the link must end.
    pub(super) fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        let mut socket = at_once(&self.stream);
        match &mut self.tls {
            None => socket.write_all(bytes),
            Some(tls) => tls.write_all(&mut socket, bytes),
        }
    }

    /// The socket, for a test that lets nothing else be used.
    #[cfg(test)]
    pub(super) const fn socket(&self) -> &TcpStream {
        &self.stream
    }

    /// Waits up to `wait` for bytes, which go into `space`; zero takes what is there.
    ///
    /// # Cycle   no allocation without TLS
    pub(super) fn receive(&mut self, wait: Duration, space: &mut [u8]) -> io::Result<Received> {
        if wait.is_zero() || self.tls.as_ref().is_some_and(|tls| tls.has_more()) {
            // what has been decrypted is not on the socket any more, where a wait would look for it
            return self.read_at_once(space);
        }
        if let Some(poll_schedule) = self.poll_schedule {
            return self.poll_busily(poll_schedule, wait, space);
        }
        if wait < EXACT {
            return if self.wait_for_data(wait)? { self.read_at_once(space) } else { Ok(Received::Nothing) };
        }
        self.set_read_timeout(wait)?;
        self.read(space)
    }

    fn set_read_timeout(&mut self, wait: Duration) -> io::Result<()> {
        if let Some(timeout) = new_timeout(self.read_timeout, wait) {
            self.stream.set_read_timeout(Some(timeout))?;
            self.read_timeout = timeout;
        }
        Ok(())
    }

    /// Ends the sending side and waits shortly until the control has taken the last bytes in.
    pub(super) fn close(mut self) {
        // the link ends either way: an error here changes nothing
        if let Some(tls) = &mut self.tls {
            tls.close(&mut waiting(&self.stream));
        }
        let _ = self.stream.shutdown(Shutdown::Write);
        // closing with unread bytes would make the kernel reset the connection and discard what we just sent
        let _ = self.stream.set_read_timeout(Some(LINGER / 10));
        let deadline = self.clock.now().plus_seconds(LINGER.as_secs_f64());
        let mut scrap = [0; 1024];
        while self.clock.now() < deadline {
            match self.stream.read(&mut scrap) {
                Ok(1..) => {}
                Err(e) if would_block(&e) => {}
                Ok(0) | Err(_) => break,
            }
        }
    }

    /// Sleeps until data are expected, then reads again and again without sleeping.
    fn poll_busily(
        &mut self,
        poll_schedule: PollSchedule,
        wait: Duration,
        space: &mut [u8],
    ) -> io::Result<Received> {
        let mut now = self.clock.now();
        let end = now.plus_seconds(wait.as_secs_f64());
        while let Some(wait) = poll_schedule.wait(now, end) {
            let received = match wait {
                Wait::Sleep(limit) if !self.wait_for_data(limit)? => Received::Nothing,
                Wait::Sleep(_) | Wait::Poll => self.read_at_once(space)?,
            };
            if received != Received::Nothing {
                return Ok(received);
            }
            core::hint::spin_loop();
            now = self.clock.now();
        }
        Ok(Received::Nothing)
    }

    /// True where data, the end of the stream or an error are there within the limit.
    fn wait_for_data(&self, limit: Duration) -> io::Result<bool> {
        let limit = Timespec::try_from(limit).unwrap_or(Timespec { tv_sec: 1, tv_nsec: 0 });
        match poll(&mut [PollFd::new(&self.stream, PollFlags::IN)], Some(&limit)) {
            Ok(count) => Ok(count > 0),
            Err(Errno::INTR) => Ok(false),
            Err(e) => Err(e.into()),
        }
    }

    /// Takes what is there.
    fn read_at_once(&mut self, space: &mut [u8]) -> io::Result<Received> {
        let room = space.len();
        let mut socket = at_once(&self.stream);
        let result = match &mut self.tls {
            None => socket.read(space),
            Some(tls) => tls.read(&mut socket, space),
        };
        self.taken(result, room)
    }

    /// Waits for at most the read timeout.
    fn read(&mut self, space: &mut [u8]) -> io::Result<Received> {
        let room = space.len();
        let result = match &mut self.tls {
            None => self.stream.read(space),
            Some(tls) => tls.read(&mut waiting(&self.stream), space),
        };
        self.taken(result, room)
    }

    fn taken(&mut self, result: io::Result<usize>, room: usize) -> io::Result<Received> {
        match result {
            // no room is no end of the stream: what is in the buffer comes first
            Ok(0) if room == 0 => Ok(Received::Bytes { at: self.clock.now(), count: 0, more: true }),
            Ok(0) => Ok(Received::Closed),
            Ok(count) => {
                let at = self.clock.now();
                if let Some(poll_schedule) = &mut self.poll_schedule {
                    poll_schedule.arrived(at);
                }
                Ok(Received::Bytes { at, count, more: count == room })
            }
            Err(e) if would_block(&e) => Ok(Received::Nothing),
            Err(e) => Err(e),
        }
    }
}

/// The socket as TLS uses it: the same two system calls as without.
struct Lent<'a> {
    stream: &'a TcpStream,
    flags: RecvFlags,
}

impl Read for Lent<'_> {
    fn read(&mut self, space: &mut [u8]) -> io::Result<usize> {
        recv(self.stream, space, self.flags).map(|(_, count)| count).map_err(io::Error::from)
    }
}

impl Write for Lent<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let wait =
            if self.flags.contains(RecvFlags::DONTWAIT) { SendFlags::DONTWAIT } else { SendFlags::empty() };
        send(self.stream, bytes, wait | SendFlags::NOSIGNAL).map_err(io::Error::from)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Neither reads nor writes wait.
const fn at_once(stream: &TcpStream) -> Lent<'_> {
    Lent { stream, flags: RecvFlags::DONTWAIT }
}

/// Reads wait at most the socket's read timeout.
const fn waiting(stream: &TcpStream) -> Lent<'_> {
    Lent { stream, flags: RecvFlags::empty() }
}

/// The read timeout to set for a wait; `None` where the present one will do. Waking too early is harmless, so a
/// timeout that is short enough stays until one of twice its length would do: a wait that varies around a whole
/// number of steps costs no system call.
fn new_timeout(present: Duration, wait: Duration) -> Option<Duration> {
    let wanted = TIMEOUT_STEP * u32::try_from(wait.as_millis() + 1).unwrap_or(1000);
    (present > wanted || present * 2 < wanted).then_some(wanted)
}

/// Configured seconds as a duration; what cannot be one becomes zero.
pub(super) fn seconds(seconds: f64) -> Duration {
    Duration::try_from_secs_f64(seconds).unwrap_or(Duration::ZERO)
}

fn would_block(error: &io::Error) -> bool {
    matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted)
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn ms(ms: u64) -> Duration {
        Duration::from_millis(ms)
    }

    #[test]
    fn a_timeout_changes_only_where_it_has_to() {
        assert_eq!(new_timeout(Duration::ZERO, ms(20)), Some(ms(21)), "none is set yet");
        assert_eq!(new_timeout(ms(21), ms(20)), None);
        assert_eq!(new_timeout(ms(21), ms(19)), Some(ms(20)), "a deadline must not be slept over");
        for wait in [19, 20, 25, 38] {
            assert_eq!(new_timeout(ms(20), ms(wait)), None, "short enough, and not much too short");
        }
        assert_eq!(new_timeout(ms(2), ms(20)), Some(ms(21)), "or it would wake ten times for nothing");
        assert_eq!(new_timeout(ms(2), Duration::ZERO), Some(ms(1)));
    }

    #[test]
    fn waits_that_vary_settle_after_one_change() {
        let mut present = Duration::ZERO;
        let mut changes = 0;
        for cycle in 0..1000_u64 {
            // a deadline 20 ms after the last frame, seen a little earlier or later
            if let Some(timeout) = new_timeout(present, Duration::from_micros(18_500 + cycle * 7919 % 1500)) {
                present = timeout;
                changes += 1;
            }
        }
        assert!(changes <= 2, "{changes} changes");
    }
}
