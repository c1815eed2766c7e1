//! The way of a simulated sensor's lines to the daemon: a connection that is made again, and costs nothing else.

#![expect(clippy::disallowed_methods, reason = "a sensor waits between two attempts to connect")]

use core::net::SocketAddr;
use core::time::Duration;
use std::io::Write as _;
use std::net::TcpStream;
use std::time::Instant;

/// Pause between two attempts to connect.
const RETRY: Duration = Duration::from_millis(500);
/// Patience with the daemon.
const PATIENCE: Duration = Duration::from_millis(50);

/// A connection to a daemon's `[sensors] listen`.
#[derive(Debug)]
pub struct SensorLink {
    address: SocketAddr,
    stream: Option<TcpStream>,
    tried: Option<Instant>,
}

impl SensorLink {
    /// Nothing is connected before there is something to say.
    #[must_use]
    pub const fn new(address: SocketAddr) -> Self {
        Self { address, stream: None, tried: None }
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

    /// Hangs up; the next text connects at once.
    pub fn hang_up(&mut self) {
        (self.stream, self.tried) = (None, None);
    }
}
