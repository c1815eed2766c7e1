//! One connected daemon: whole messages in and out, as frames or as calls, never blocking longer than asked.

use core::sync::atomic::Ordering;
use core::time::Duration;
use std::io::{ErrorKind, Read};
use std::net::{Shutdown, TcpStream};
use std::sync::Arc;
use std::time::Instant;

use volcomp_protocol::read_write::LINE_MAX;
use volcomp_protocol::{
    Close, CloseReason, ErrorCode, ErrorReport, FrameReader, Heartbeat, MAX_FRAME, Message, Name, encode,
};

use super::calls::{Call, Calls};
use super::error::LinkEnd;
use super::server::Shared;
use super::wire::Wire;

/// Own silence after which a heartbeat is sent.
pub(super) const HEARTBEAT: Duration = Duration::from_millis(100);

/// How reads wait.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Wait {
    Never,
    UpTo(Duration),
}

/// Longest frame or line.
const OUT_MAX: usize = if LINE_MAX > MAX_FRAME { LINE_MAX } else { MAX_FRAME };

/// How the daemon talks to this control.
#[derive(Debug)]
pub(super) enum Codec {
    /// `docs/protocol.md`.
    Frames(Box<FrameReader>),
    /// `docs/reference/read-write.md`.
    Calls(Box<Calls>),
}

impl Codec {
    fn space(&mut self) -> &mut [u8] {
        match self {
            Self::Frames(reader) => reader.space(),
            Self::Calls(calls) => calls.space(),
        }
    }

    fn advance(&mut self, count: usize) {
        match self {
            Self::Frames(reader) => reader.advance(count),
            Self::Calls(calls) => calls.advance(count),
        }
    }
}

/// A connected daemon; dropping it frees the place for the next.
pub(super) struct Link {
    wire: Wire,
    codec: Codec,
    /// The rest of a frame or line that the send buffer did not take.
    rest: [u8; OUT_MAX],
    rest_from: usize,
    rest_to: usize,
    wait: Option<Wait>,
    last_heard: Instant,
    last_sent: Instant,
    heartbeats: u32,
    pub(super) left_out: u64,
    shared: Arc<Shared>,
}

impl Link {
    /// A link whose hello is done; takes the place that was reserved in `shared`.
    pub(super) fn new(wire: Wire, codec: Codec, shared: Arc<Shared>) -> Self {
        let now = Instant::now();
        Self {
            wire,
            codec,
            rest: [0; OUT_MAX],
            rest_from: 0,
            rest_to: 0,
            wait: None,
            last_heard: now,
            last_sent: now,
            heartbeats: 0,
            left_out: 0,
            shared,
        }
    }

    pub(super) const fn wire(&mut self) -> &mut Wire {
        &mut self.wire
    }

    fn set_wait(&mut self, wait: Wait) -> Result<(), LinkEnd> {
        if self.wait == Some(wait) {
            return Ok(());
        }
        let stream = self.wire.stream();
        let result = match wait {
            Wait::Never => stream.set_nonblocking(true),
            Wait::UpTo(limit) => stream
                .set_nonblocking(false)
                .and_then(|()| stream.set_read_timeout(Some(limit.max(Duration::from_micros(1))))),
        };
        self.wait = Some(wait);
        result.map_err(|e| LinkEnd::Io(e.kind()))
    }

    /// The next message; `None` where none came within `limit` (zero: none is there now).
    pub(super) fn receive(&mut self, limit: Duration) -> Result<Option<Message>, LinkEnd> {
        let wait = if limit.is_zero() { Wait::Never } else { Wait::UpTo(limit) };
        let deadline = (!limit.is_zero()).then(|| Instant::now() + limit);
        if let (Codec::Calls(calls), Wait::Never) = (&mut self.codec, wait) {
            calls.age();
        }
        loop {
            if let Some(message) = self.next_message()? {
                return Ok(Some(message));
            }
            self.set_wait(wait)?;
            match self.wire.read(self.codec.space()) {
                Ok(0) => return Err(LinkEnd::EndOfStream),
                Ok(count) => {
                    self.codec.advance(count);
                    self.last_heard = Instant::now();
                }
                Err(e) if e.kind() == ErrorKind::Interrupted => {}
                Err(e) if matches!(e.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {
                    if self.last_heard.elapsed() > self.shared.silence {
                        return Err(LinkEnd::Silence);
                    }
                    if deadline.is_none_or(|d| Instant::now() >= d) {
                        return Ok(None);
                    }
                }
                Err(e) => return Err(LinkEnd::Io(e.kind())),
            }
        }
    }

    /// Replies to the first call; false where none comes in time.
    pub(super) fn first_call(&mut self, deadline: Instant) -> bool {
        loop {
            let Codec::Calls(calls) = &mut self.codec else { return false };
            match calls.next() {
                Ok(Some(call)) => return call.length > 0 && self.put(call.length).is_ok(),
                Ok(None) => {}
                Err(_) => return false,
            }
            let left = deadline.saturating_duration_since(Instant::now());
            if left.is_zero() || self.set_wait(Wait::UpTo(left)).is_err() {
                return false;
            }
            match self.wire.read(self.codec.space()) {
                Ok(0) | Err(_) => return false,
                Ok(count) => self.codec.advance(count),
            }
        }
    }

    /// The next message among the bytes received; calls on the way to it are replied to.
    fn next_message(&mut self) -> Result<Option<Message>, LinkEnd> {
        loop {
            let call = match &mut self.codec {
                Codec::Frames(reader) => return reader.next().map_err(LinkEnd::BadFrame),
                Codec::Calls(calls) => calls.next().map_err(LinkEnd::BadFrame)?,
            };
            let Some(Call { length, message }) = call else { return Ok(None) };
            if length > 0 {
                self.put(length)?;
            }
            if message.is_some() {
                return Ok(message);
            }
        }
    }

    /// Sends the line of so many bytes that the calls have ready.
    fn put(&mut self, length: usize) -> Result<(), LinkEnd> {
        // a daemon that does not read its replies has no use for more of them
        if !self.flush()? {
            return Err(LinkEnd::Io(ErrorKind::WouldBlock));
        }
        if let Codec::Calls(calls) = &self.codec {
            self.rest[..length].copy_from_slice(calls.line(length));
            (self.rest_from, self.rest_to) = (0, length);
        }
        self.flush()?;
        self.last_sent = Instant::now();
        Ok(())
    }

    /// Sends a message; leaves it out, and counts it, where the send buffer is full. Waits for room only where the last
    /// [`Link::receive`] was allowed to wait (lock step).
    pub(super) fn send(&mut self, message: &Message) -> Result<(), LinkEnd> {
        if let Codec::Calls(calls) = &mut self.codec {
            let length = calls.line_for(message);
            return length.map_or(Ok(()), |length| self.put(length));
        }
        if !self.flush()? {
            self.left_out += 1;
            return Ok(());
        }
        let mut frame = [0; MAX_FRAME];
        self.rest_to = encode(message, &mut frame);
        self.rest[..MAX_FRAME].copy_from_slice(&frame);
        self.rest_from = 0;
        if !self.flush()? && self.rest_from == 0 {
            // not a byte went out: leave the frame out as a whole
            self.rest_to = 0;
            self.left_out += 1;
        }
        self.last_sent = Instant::now();
        Ok(())
    }

    /// True where nothing is left to send.
    fn flush(&mut self) -> Result<bool, LinkEnd> {
        if !self.wire.pump().map_err(|e| LinkEnd::Io(e.kind()))? {
            return Ok(false);
        }
        while self.rest_from < self.rest_to {
            match self.wire.write(&self.rest[self.rest_from..self.rest_to]) {
                Ok(0) => return Err(LinkEnd::EndOfStream),
                Ok(count) => self.rest_from += count,
                Err(e) if e.kind() == ErrorKind::Interrupted => {}
                Err(e) if e.kind() == ErrorKind::WouldBlock => return Ok(false),
                Err(e) => return Err(LinkEnd::Io(e.kind())),
            }
        }
        (self.rest_from, self.rest_to) = (0, 0);
        Ok(true)
    }

    /// Sends a heartbeat where nothing else was sent for a while.
    pub(super) fn keep_alive(&mut self, time_ns: i64) -> Result<(), LinkEnd> {
        if self.last_sent.elapsed() < HEARTBEAT {
            return Ok(());
        }
        self.heartbeats = self.heartbeats.wrapping_add(1);
        self.send(&Message::Heartbeat(Heartbeat { count: self.heartbeats, time_ns }))
    }

    /// Tells the daemon why the link ends, and ends it.
    pub(super) fn end(mut self, end: LinkEnd) {
        let code = match end {
            LinkEnd::BadFrame(_) => ErrorCode::BadFrame,
            LinkEnd::Unexpected => ErrorCode::Unexpected,
            // nobody is there to be told
            LinkEnd::EndOfStream | LinkEnd::Silence | LinkEnd::Io(_) => return,
        };
        let detail = Name::new(&end.to_string());
        let _ = self.send(&Message::Error(ErrorReport { code, detail }));
        self.linger();
    }

    /// Ends the link in order.
    pub(super) fn close(mut self, reason: CloseReason) {
        let _ = self.send(&Message::Close(Close { reason }));
        self.linger();
    }

    /// Ends the link without a word; what is on its way is lost.
    pub(super) fn abort(self) {
        // where the system refuses, the connection is closed instead of reset: just as sudden
        let _ = socket2::SockRef::from(self.wire.stream()).set_linger(Some(Duration::ZERO));
    }

    /// Lets the last frame arrive without keeping the cycle: closing with unread bytes would reset the connection.
    pub(super) fn linger(mut self) {
        self.wire.finish();
        if let Ok(stream) = self.wire.stream().try_clone() {
            let _ = std::thread::Builder::new().name("cnc-linger".into()).spawn(move || drain(&stream));
        }
    }
}

impl Drop for Link {
    fn drop(&mut self) {
        self.shared.occupied.store(false, Ordering::Release);
    }
}

/// Ends the sending side and reads until the end of the stream, at most for a second.
pub(super) fn drain(stream: &TcpStream) {
    let deadline = Instant::now() + Duration::from_secs(1);
    let _ = stream.shutdown(Shutdown::Write);
    let _ = stream.set_nonblocking(false);
    let _ = stream.set_read_timeout(Some(Duration::from_millis(200)));
    let mut sink = [0; 1024];
    let mut stream = stream;
    while Instant::now() < deadline {
        match stream.read(&mut sink) {
            Ok(0) => break,
            Ok(_) => {}
            Err(e)
                if matches!(
                    e.kind(),
                    ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted
                ) => {}
            Err(_) => break,
        }
    }
}
