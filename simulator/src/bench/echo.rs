//! The bare limit: a process that answers every position frame with bytes of a correction's size, and nothing else.
//!
//! Socket options, thread, reads and writes are those of volcompd (`src/daemon/link.rs` there): one blocking read
//! with a time limit that is set once, one write; with busy polling, a sleep in `poll` until shortly before the next
//! frame is expected and reads that do not wait from then on. It does not look at what it reads, checks no check sum
//! and computes nothing: whatever volcompd takes longer is its own.

use core::net::SocketAddr;
use core::time::Duration;
use std::io::{self, ErrorKind, Read, Write};
use std::net::TcpStream;
use std::time::Instant;

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;
use rustix::net::{RecvFlags, recv};
use socket2::{SockRef, TcpKeepalive};
use volcomp_protocol::{Correction, MAX_FRAME, Message, encode};

use super::thread::ThreadSettings;

/// Bytes of a position frame.
pub const POSITION_BYTES: usize = 228;
/// Read time limit of volcompd during cycles.
const READ_LIMIT: Duration = Duration::from_millis(21);
/// Stack of the answering thread, as volcompd's.
const STACK_BYTES: usize = 1 << 20;

/// What the echo is started with.
#[derive(Debug, Clone, Copy)]
pub struct EchoSettings {
    /// Address of the control.
    pub address: SocketAddr,
    /// Its thread.
    pub thread: ThreadSettings,
    /// Time to poll before and after the moment at which a frame is expected.
    pub busy_poll: Duration,
    /// Control cycle.
    pub cycle: Duration,
}

/// Connects and echoes until the control closes the connection.
///
/// # Errors
/// The socket's.
pub fn run(settings: EchoSettings) -> io::Result<()> {
    let thread = std::thread::Builder::new()
        .name("bare-echo".into())
        .stack_size(STACK_BYTES)
        .spawn(move || serve(&settings))?;
    thread.join().unwrap_or_else(|_| Err(io::Error::other("the echo panicked")))
}

fn serve(settings: &EchoSettings) -> io::Result<()> {
    let _ = settings.thread.apply();
    let mut stream = TcpStream::connect(settings.address)?;
    options(&stream)?;
    let mut answer = [0; MAX_FRAME];
    let length = encode(&Message::Correction(Correction::default()), &mut answer);
    let answer = &answer[..length];
    let mut buffer = [0; 4 * MAX_FRAME];
    let mut pending = 0;
    let mut last: Option<Instant> = None;
    let mut interval = settings.cycle;
    loop {
        let received = if settings.busy_poll.is_zero() {
            taken(stream.read(&mut buffer))?
        } else {
            let expected = last.map(|last| last + interval);
            poll_busily(&stream, &mut buffer, expected, settings.busy_poll)?
        };
        let Some(count) = received else { continue };
        if !settings.busy_poll.is_zero() {
            let now = Instant::now();
            interval = last.map_or(interval, |last| now.duration_since(last)).min(settings.cycle);
            last = Some(now);
        }
        if count == 0 {
            return Ok(());
        }
        pending += count;
        while pending >= POSITION_BYTES {
            pending -= POSITION_BYTES;
            stream.write_all(answer)?;
        }
    }
}

fn options(stream: &TcpStream) -> io::Result<()> {
    let second = Duration::from_secs(1);
    stream.set_nodelay(true)?;
    stream.set_read_timeout(Some(READ_LIMIT))?;
    stream.set_write_timeout(Some(second))?;
    let socket = SockRef::from(stream);
    socket.set_tcp_keepalive(
        &TcpKeepalive::new().with_time(2 * second).with_interval(second).with_retries(3),
    )?;
    socket.set_tcp_user_timeout(Some(5 * second))?;
    socket.set_tcp_quickack(true)
}

/// Sleeps until `margin` before a frame is expected, then reads without waiting until as long after it.
fn poll_busily(
    stream: &TcpStream,
    buffer: &mut [u8],
    expected: Option<Instant>,
    margin: Duration,
) -> io::Result<Option<usize>> {
    let end = Instant::now() + READ_LIMIT;
    loop {
        let now = Instant::now();
        if now >= end {
            return Ok(None);
        }
        let sleep = match expected {
            Some(expected) if now + margin < expected => (expected - margin).min(end) - now,
            Some(expected) if now < expected + margin => Duration::ZERO,
            _ => end - now,
        };
        if !sleep.is_zero() && !wait_for_data(stream, sleep)? {
            continue;
        }
        let count = recv(stream, &mut *buffer, RecvFlags::DONTWAIT).map(|(_, count)| count);
        if let Some(count) = taken(count.map_err(io::Error::from))? {
            return Ok(Some(count));
        }
        core::hint::spin_loop();
    }
}

fn wait_for_data(stream: &TcpStream, limit: Duration) -> io::Result<bool> {
    let limit = Timespec::try_from(limit).unwrap_or(Timespec { tv_sec: 1, tv_nsec: 0 });
    match poll(&mut [PollFd::new(stream, PollFlags::IN)], Some(&limit)) {
        Ok(count) => Ok(count > 0),
        Err(Errno::INTR) => Ok(false),
        Err(e) => Err(e.into()),
    }
}

/// Bytes read; `None` where nothing came within the time limit.
fn taken(result: io::Result<usize>) -> io::Result<Option<usize>> {
    match result {
        Ok(count) => Ok(Some(count)),
        Err(e)
            if matches!(e.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted) =>
        {
            Ok(None)
        }
        Err(e) => Err(e),
    }
}
