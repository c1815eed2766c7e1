//! Where the monitor listens: a handle that control and relay share, and the bytes of one direction as frames.

use std::sync::{Arc, Mutex, PoisonError};

use volcomp_protocol::{Correction, FrameReader, Message, Position};

use super::{Monitor, Report, Settings};

/// A monitor that several threads feed.
#[derive(Debug, Clone)]
pub struct SharedMonitor(Arc<Mutex<Monitor>>);

impl SharedMonitor {
    /// A monitor with these limits.
    #[must_use]
    pub fn new(settings: Settings) -> Self {
        Self(Arc::new(Mutex::new(Monitor::new(settings))))
    }

    fn with<T>(&self, action: impl FnOnce(&mut Monitor) -> T) -> T {
        action(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// [`Monitor::set_settings`].
    pub fn set_settings(&self, settings: Settings) {
        self.with(|m| m.set_settings(settings));
    }

    /// [`Monitor::link_opened`].
    pub fn link_opened(&self, link: u64) {
        self.with(|m| m.link_opened(link));
    }

    /// [`Monitor::position`].
    pub fn position(&self, link: u64, frame: &Position) {
        self.with(|m| m.position(link, frame));
    }

    /// [`Monitor::correction`].
    pub fn correction(&self, link: u64, correction: &Correction) {
        self.with(|m| m.correction(link, correction));
    }

    /// [`Monitor::report`].
    #[must_use]
    pub fn report(&self) -> Report {
        self.with(|m| m.report().clone())
    }
}

/// One direction of a connection at the daemon's end. The hello of the control opens the link.
#[derive(Debug)]
pub struct DirectionTap {
    monitor: SharedMonitor,
    link: u64,
    reader: FrameReader,
}

impl DirectionTap {
    /// A tap on connection `link`.
    #[must_use]
    pub fn new(monitor: SharedMonitor, link: u64) -> Self {
        Self { monitor, link, reader: FrameReader::default() }
    }

    /// Takes the next bytes of the stream. To be called before they are written to the daemon, so that no answer is seen
    /// before its position. Bytes that are no frame end the tap, as they end the link.
    pub fn feed(&mut self, mut bytes: &[u8]) {
        while !bytes.is_empty() {
            let space = self.reader.space();
            let count = space.len().min(bytes.len());
            let (now, rest) = bytes.split_at(count);
            space[..count].copy_from_slice(now);
            self.reader.advance(count);
            bytes = rest;
            loop {
                match self.reader.next() {
                    Ok(Some(Message::ControlHello(_))) => self.monitor.link_opened(self.link),
                    Ok(Some(Message::Position(frame))) => self.monitor.position(self.link, &frame),
                    Ok(Some(Message::Correction(c))) => self.monitor.correction(self.link, &c),
                    Ok(Some(_)) => {}
                    Ok(None) => break,
                    Err(_) => return,
                }
            }
        }
    }
}
