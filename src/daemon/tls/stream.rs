//! What lies between the socket of a link and its frames.
//!
//! Reads and writes go through a socket that the caller lends for the call, with its own way of waiting: a read that
//! waits at most the socket's timeout, or one that takes what is there.

use std::io::{self, ErrorKind, Read, Write};
use std::sync::Arc;

use rustls::ClientConnection;

use super::Identity;

/// One side of a TLS connection.
#[derive(Debug)]
pub(crate) struct TlsStream {
    connection: ClientConnection,
    /// Bytes that have been decrypted and that nobody has read.
    waiting: usize,
}

impl TlsStream {
    /// A connection whose handshake is still to come.
    pub(crate) fn start(identity: &Identity) -> io::Result<Self> {
        ClientConnection::new(Arc::clone(&identity.config), identity.server_name.clone())
            .map(|connection| Self { connection, waiting: 0 })
            .map_err(failure)
    }

    /// One step of the handshake: at most one read. True once it is done, as far as this side can tell: whether the
    /// control accepts the daemon's certificate shows in its first answer.
    pub(crate) fn shake(&mut self, socket: &mut (impl Read + Write)) -> io::Result<bool> {
        self.flush(socket)?;
        if self.connection.is_handshaking() {
            if self.connection.read_tls(socket)? == 0 {
                return Err(ErrorKind::UnexpectedEof.into());
            }
            self.process(socket)?;
        }
        Ok(!self.connection.is_handshaking())
    }

    /// True where bytes have been decrypted that nobody has read: a wait on the socket would wait in vain.
    pub(crate) const fn has_more(&self) -> bool {
        self.waiting > 0
    }

    /// Reads what has been decrypted, or else once from the socket. `WouldBlock` where no whole record is there, zero at
    /// the end of the stream: a link ends with a frame that says so, so an end without TLS's own is no other end.
    ///
    /// # Cycle   one allocation per record that comes in; waits for nothing but the socket
    pub(crate) fn read(&mut self, socket: &mut (impl Read + Write), space: &mut [u8]) -> io::Result<usize> {
        match self.take(space) {
            Err(e) if e.kind() == ErrorKind::WouldBlock => {}
            taken => return taken,
        }
        if self.connection.read_tls(socket)? == 0 {
            return Ok(0);
        }
        self.process(socket)?;
        self.take(space)
    }

    /// Sends bytes as one record.
    ///
    /// # Cycle   one allocation per record; waits for nothing but the socket
    pub(crate) fn write_all(&mut self, socket: &mut impl Write, bytes: &[u8]) -> io::Result<()> {
        self.connection.writer().write_all(bytes)?;
        self.flush(socket)
    }

    /// Says that nothing more will be sent.
    pub(crate) fn close(&mut self, socket: &mut impl Write) {
        self.connection.send_close_notify();
        // the link ends either way
        let _ = self.flush(socket);
    }

    fn process(&mut self, socket: &mut impl Write) -> io::Result<()> {
        let processed = self.connection.process_new_packets();
        // an alert that says what is wrong, or the answer to a change of keys
        let flushed = self.flush(socket);
        self.waiting = processed.map_err(failure)?.plaintext_bytes_to_read();
        flushed
    }

    fn take(&mut self, space: &mut [u8]) -> io::Result<usize> {
        match self.connection.reader().read(space) {
            Ok(count) => {
                self.waiting = self.waiting.saturating_sub(count);
                Ok(count)
            }
            Err(e) if e.kind() == ErrorKind::UnexpectedEof => Ok(0),
            Err(e) => Err(e),
        }
    }

    fn flush(&mut self, socket: &mut impl Write) -> io::Result<()> {
        while self.connection.wants_write() {
            if self.connection.write_tls(socket)? == 0 {
                return Err(ErrorKind::WriteZero.into());
            }
        }
        Ok(())
    }
}

/// A failure of TLS as one of the stream; [`super::TlsError::of`] finds it again.
fn failure(error: rustls::Error) -> io::Error {
    io::Error::new(ErrorKind::InvalidData, error)
}
