//! The way of a simulated sensor's lines to the daemon: a connection that is made again, and costs nothing else.

#![expect(clippy::disallowed_methods, reason = "a sensor waits between two attempts to connect")]

use core::net::SocketAddr;
use core::time::Duration;
use std::io::{self, Read as _, Write as _};
use std::net::TcpStream;
use std::time::Instant;

/// Pause between two attempts to connect.
const RETRY: Duration = Duration::from_millis(500);
/// Patience with the daemon.
const PATIENCE: Duration = Duration::from_millis(50);

/// Patience with a daemon that is in lock step: a computer that stalls is no part of an experiment.
const LOCK_STEP_PATIENCE: Duration = Duration::from_secs(60);

/// A connection to a daemon's `[sensors] listen`.
#[derive(Debug)]
pub struct SensorLink {
    address: SocketAddr,
    stream: Option<TcpStream>,
    tried: Option<Instant>,
    /// Number of the last text that was waited for.
    synced: u64,
}

impl SensorLink {
    /// Nothing is connected before there is something to say.
    #[must_use]
    pub const fn new(address: SocketAddr) -> Self {
        Self { address, stream: None, tried: None, synced: 0 }
    }

    /// Where the daemon listens.
    #[must_use]
    pub const fn address(&self) -> SocketAddr {
        self.address
    }

    /// Sends text; what finds no daemon is lost.
    pub fn send(&mut self, text: &[u8]) {
        if self.stream.is_none() && self.tried.is_none_or(|at| at.elapsed() > RETRY) {
            self.tried = Some(Instant::now());
            self.stream = TcpStream::connect_timeout(&self.address, PATIENCE).ok();
            if let Some(stream) = &self.stream {
                let _ = stream.set_nodelay(true);
                let _ = stream.set_write_timeout(Some(PATIENCE));
            }
        }
        if let Some(stream) = &mut self.stream
            && stream.write_all(text).is_err()
        {
            self.stream = None;
        }
    }

    /// Sends text and waits until the estimator has it.
    ///
    /// # Errors
    /// There is no daemon, it ends, or it does not answer.
    pub fn send_and_wait(&mut self, text: &[u8]) -> io::Result<()> {
        if self.stream.is_none() {
            let stream = TcpStream::connect_timeout(&self.address, LOCK_STEP_PATIENCE)?;
            stream.set_nodelay(true)?;
            stream.set_write_timeout(Some(LOCK_STEP_PATIENCE))?;
            stream.set_read_timeout(Some(LOCK_STEP_PATIENCE))?;
            self.stream = Some(stream);
        }
        let Some(stream) = &mut self.stream else { return Ok(()) };
        self.synced += 1;
        let wanted = format!("{{\"sync\":{}}}", self.synced);
        stream.write_all(&[text, wanted.as_bytes(), b"\n"].concat())?;
        let mut said = Vec::new();
        let mut buffer = [0; 512];
        loop {
            let count = stream.read(&mut buffer)?;
            if count == 0 {
                return Err(io::ErrorKind::UnexpectedEof.into());
            }
            said.extend_from_slice(&buffer[..count]);
            let Some(end) = said.iter().position(|b| *b == b'\n') else { continue };
            let line = said[..end].trim_ascii();
            return if line == wanted.as_bytes() {
                Ok(())
            } else {
                // a daemon that complains of a reading would spoil the experiment without a word
                Err(io::Error::other(String::from_utf8_lossy(line).into_owned()))
            };
        }
    }

    /// Hangs up; the next text connects at once.
    pub fn hang_up(&mut self) {
        (self.stream, self.tried) = (None, None);
    }
}
