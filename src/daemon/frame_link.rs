//! The driver for controls that speak frames: one position a cycle, one answer (`docs/protocol.md`).

use std::io;
use std::time::Duration;

use super::connection::Connection;
use super::link::{ControlLink, LifeSigns, Received};
use volcomp_protocol::{
    Close, CloseReason, ErrorCode, ErrorReport, FrameError, FrameReader, Heartbeat, MAX_FRAME, Message, Name,
    encode,
};

/// A link of frames.
#[derive(Debug)]
pub(super) struct FrameLink {
    connection: Connection,
    reader: FrameReader,
    out: [u8; MAX_FRAME],
    heartbeats: u32,
    life_signs: LifeSigns,
}

impl FrameLink {
    pub(super) fn new(connection: Connection) -> Self {
        let now = connection.now();
        let reader = FrameReader::default();
        Self {
            connection,
            reader,
            out: [0; MAX_FRAME],
            heartbeats: 0,
            life_signs: LifeSigns { received: now, sent: now },
        }
    }
}

impl ControlLink for FrameLink {
    fn receive(&mut self, wait: Duration) -> io::Result<Received> {
        let received = self.connection.receive(wait, self.reader.space())?;
        if let Received::Bytes { count, .. } = received {
            self.reader.advance(count);
        }
        Ok(received)
    }

    fn next_message(&mut self) -> Result<Option<Message>, FrameError> {
        self.reader.next()
    }

    fn skipped(&self) -> u64 {
        self.reader.skipped()
    }

    fn send(&mut self, message: &Message) -> io::Result<()> {
        let length = encode(message, &mut self.out);
        self.connection.send(&self.out[..length])?;
        self.life_signs.sent = self.connection.now();
        Ok(())
    }

    fn send_heartbeat(&mut self) -> io::Result<()> {
        self.heartbeats = self.heartbeats.wrapping_add(1);
        let beat = Heartbeat { count: self.heartbeats, time_ns: self.connection.now().ns };
        self.send(&Message::Heartbeat(beat))
    }

    fn life_signs(&mut self) -> &mut LifeSigns {
        &mut self.life_signs
    }

    fn close(mut self: Box<Self>, error: Option<(ErrorCode, &str)>, reason: CloseReason) {
        // the link ends either way: an error here changes nothing
        if let Some((code, detail)) = error {
            let _ = self.send(&Message::Error(ErrorReport { code, detail: Name::new(detail) }));
        }
        let _ = self.send(&Message::Close(Close { reason }));
        self.connection.close();
    }
}
