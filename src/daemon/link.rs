//! The link to the control, as the cycle sees it: messages in, messages out, whatever the control understands.
//!
//! Two drivers: [`super::frame_link`] for controls that speak `docs/protocol.md`, [`super::read_write_link`] for those that
//! are read and written by separate calls.

use core::fmt;
use std::io;
use std::time::Duration;

use super::connection::Connection;
use super::frame_link::FrameLink;
use super::read_write_link::ReadWriteLink;
use volcomp_config::{Interface, LinkConfig};
use volcomp_protocol::{CloseReason, CorrectionState, ErrorCode, FrameError, Message};
use volcomp_units::MonoTime;

/// What a read has brought.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Received {
    /// So many bytes at this time; `more` where the buffer was filled and more may be waiting.
    Bytes { at: MonoTime, count: usize, more: bool },
    /// Nothing within the time allowed.
    Nothing,
    /// The control has closed its side.
    Closed,
}

/// How long the calls of a control take, ns; means over the last 64.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct CallTimes {
    /// From the request to the positions.
    pub(super) read_ns: i64,
    /// From an offset to its confirmation.
    pub(super) write_ns: i64,
}

/// The last signs of life of either side.
#[derive(Debug, Clone, Copy)]
pub(super) struct LifeSigns {
    /// When the last message or life sign came in.
    pub(super) received: MonoTime,
    /// When the last bytes went out.
    pub(super) sent: MonoTime,
}

/// A driver for one kind of control.
///
/// # Cycle   nothing but [`ControlLink::close`] allocates (without TLS), waits longer than asked, or panics
pub(super) trait ControlLink: fmt::Debug {
    /// Waits up to `wait` for bytes; zero takes what is there.
    fn receive(&mut self, wait: Duration) -> io::Result<Received>;
    /// The next message among the bytes received; `None` where more are needed.
    fn next_message(&mut self) -> Result<Option<Message>, FrameError>;
    /// What came in so far that carries no message, but shows that the control lives.
    fn skipped(&self) -> u64;
    /// Sends one message, or does what stands for it with this control.
    ///
    /// # Errors
    /// `WouldBlock` where the send buffer is full: the link must end.
    fn send(&mut self, message: &Message) -> io::Result<()>;
    /// Shows a control that has a display for it what the daemon is doing, where that has changed and no message tells it.
    fn show(&mut self, _state: CorrectionState) -> io::Result<()> {
        Ok(())
    }
    /// Shows the control that this side lives.
    fn send_heartbeat(&mut self) -> io::Result<()>;
    /// When either side was last heard.
    fn life_signs(&mut self) -> &mut LifeSigns;
    /// How long calls take; `None` where there are none.
    fn call_times(&self) -> Option<CallTimes> {
        None
    }
    /// Says why, says good-bye, and waits shortly until the control has taken it in.
    fn close(self: Box<Self>, error: Option<(ErrorCode, &str)>, reason: CloseReason);
}

/// The driver that the machine file asks for.
pub(super) fn driver(connection: Connection, config: &LinkConfig) -> Box<dyn ControlLink> {
    match config.interface {
        Interface::Frames => Box::new(FrameLink::new(connection)),
        Interface::ReadWrite { poll_s } => Box::new(ReadWriteLink::new(connection, poll_s)),
    }
}
