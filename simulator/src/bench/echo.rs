//! The bare limit: a process that answers every position frame with bytes of a correction's size, and nothing else.
//!
//! Socket options, thread, reads and writes are those of volcompd (`src/runtime/link.rs` there): one blocking read
//! with a time limit that is set once, one write; with busy polling, reads of a non-blocking socket. It does not look
//! at what it reads, checks no check sum and computes nothing: whatever volcompd takes longer is its own.

use core::net::SocketAddr;
use core::time::Duration;
use std::io::{self, ErrorKind, Read, Write};
use std::net::TcpStream;
use std::time::Instant;

use socket2::{SockRef, TcpKeepalive};
use volcomp::core::protocol::{Correction, MAX_FRAME, Message, encode};

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
    /// Time to poll before sleeping.
    pub busy_poll: Duration,
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
    let mut nonblocking = false;
    loop {
        let Some(count) = receive(&mut stream, &mut buffer, settings.busy_poll, &mut nonblocking)? else {
            continue;
        };
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

/// Bytes read; `None` where nothing came within the time limit.
fn receive(
    stream: &mut TcpStream,
    buffer: &mut [u8],
    busy_poll: Duration,
    nonblocking: &mut bool,
) -> io::Result<Option<usize>> {
    if !busy_poll.is_zero() {
        if !*nonblocking {
            stream.set_nonblocking(true)?;
            *nonblocking = true;
        }
        let until = Instant::now() + busy_poll;
        loop {
            match read(stream, buffer)? {
                None if Instant::now() < until => core::hint::spin_loop(),
                None => break,
                count => return Ok(count),
            }
        }
        stream.set_nonblocking(false)?;
        *nonblocking = false;
    }
    read(stream, buffer)
}

fn read(stream: &mut TcpStream, buffer: &mut [u8]) -> io::Result<Option<usize>> {
    match stream.read(buffer) {
        Ok(count) => Ok(Some(count)),
        Err(e)
            if matches!(e.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted) =>
        {
            Ok(None)
        }
        Err(e) => Err(e),
    }
}
