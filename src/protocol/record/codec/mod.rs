//! Entries to few bytes and back, bit for bit.
//!
//! Numbers that follow a path are predicted from those before them, and only the difference of their bit patterns is
//! kept, in as many bytes as it needs. Which of four predictions was nearest stands beside it. Predictions use
//! additions only, which every IEEE 754 machine rounds alike; one that is not finite falls back to the value before.

mod decode;
mod encode;

pub use decode::{Decoded, Decoder};
pub use encode::Encoder;

use super::entry::{Answer, LIVE_MAX};
use super::error::RecordError;
use crate::Position;
use volcomp_units::axes::MAX_AXES;

/// Tags of entries. From 128 on an entry is an input of the engine; all but cycles, deadlines and live values carry
/// their length.
mod tag {
    pub(super) const GAP: u8 = 1;
    pub(super) const CYCLE: u8 = 128;
    pub(super) const DEADLINE: u8 = 129;
    pub(super) const TOOL: u8 = 130;
    pub(super) const REQUEST: u8 = 131;
    pub(super) const LINK_UP: u8 = 132;
    pub(super) const LINK_DOWN: u8 = 133;
    pub(super) const ENGINE: u8 = 134;
    pub(super) const MODEL: u8 = 135;
    pub(super) const LIVE: u8 = 136;
    /// As [`LIVE`], with channels beyond the sixteenth.
    pub(super) const LIVE_MANY: u8 = 137;
}

/// Bits of a cycle's and a deadline's first byte.
mod bit {
    pub(super) const ANSWERED: u8 = 1;
    pub(super) const MACHINE: u8 = 1 << 1;
    pub(super) const FEED: u8 = 1 << 2;
    pub(super) const STATUS: u8 = 1 << 3;
    /// All slots of the arrays are there, not only those of the axes.
    pub(super) const WIDE: u8 = 1 << 4;
    pub(super) const STEP: u8 = 1 << 5;
    /// The answer names another frame.
    pub(super) const OTHER: u8 = 1 << 6;
    /// The state has changed.
    pub(super) const CHANGE: u8 = 1 << 7;
}

/// The last values of one quantity of one axis, newest first, as bits.
#[derive(Debug, Clone, Copy, Default)]
struct Track([u64; 4]);

impl Track {
    fn push(&mut self, value: f64) {
        let [a, b, c, _] = self.0;
        self.0 = [value.to_bits(), a, b, c];
    }

    fn last(self) -> f64 {
        f64::from_bits(self.0[0])
    }

    /// Straight on, in a parabola, in a cubic.
    fn onward(self) -> [f64; 3] {
        let [a, b, c, d] = self.0.map(f64::from_bits);
        let (d1, d2, d3) = (a - b, b - c, c - d);
        let (s1, s2) = (d1 - d2, d2 - d3);
        [a + d1, a + (d1 + s1), a + (d1 + (s1 + (s1 - s2)))]
    }

    /// Passes the next value of a quantity that goes its own way.
    fn pass<P: Port>(&mut self, port: &mut P, value: f64) -> Result<f64, RecordError> {
        let [line, parabola, cubic] = self.onward();
        let last = self.last();
        let value = port.number(value, &[last, line, parabola, cubic], last)?;
        self.push(value);
        Ok(value)
    }
}

/// Where a number goes, or comes from.
trait Port {
    /// Passes one number, next to its predictions; gives it back.
    fn number(&mut self, value: f64, predictions: &[f64; 4], fallback: f64) -> Result<f64, RecordError>;
}

/// What is known of the entries before.
#[derive(Debug, Clone, Default)]
struct Past {
    now: i64,
    interval: i64,
    sequence: u32,
    control_ns: i64,
    control_interval: i64,
    machine: u16,
    feed: Track,
    status: Status,
    commanded: [Track; MAX_AXES],
    /// Actual minus commanded and applied.
    following: [Track; MAX_AXES],
    applied: [Track; MAX_AXES],
    offset: [Track; MAX_AXES],
    wanted: [Track; MAX_AXES],
    live: [Track; LIVE_MAX],
}

/// State, limited, warning, out of range, faded, lag, and a byte with bit 0: stopped, bit 1: compensation wanted.
type Status = [u8; 7];

impl Past {
    const fn enabled(&self) -> bool {
        let [.., flags] = self.status;
        flags & 2 != 0
    }

    fn arrays<P: Port>(
        &mut self,
        port: &mut P,
        frame: &mut Position,
        count: usize,
    ) -> Result<(), RecordError> {
        for k in 0..count {
            frame.commanded[k] = self.commanded[k].pass(port, frame.commanded[k])?;
        }
        for k in 0..count {
            let sent = self.offset[k];
            let track = &mut self.applied[k];
            let last = track.last();
            let before = f64::from_bits(sent.0[1]);
            frame.applied[k] =
                port.number(frame.applied[k], &[sent.last(), last, before, track.onward()[0]], last)?;
            track.push(frame.applied[k]);
        }
        for k in 0..count {
            let track = &mut self.following[k];
            let ideal = frame.commanded[k] + frame.applied[k];
            let near = [ideal, ideal + track.last(), ideal + track.onward()[0], frame.commanded[k]];
            frame.actual[k] = port.number(frame.actual[k], &near, 0.0)?;
            track.push(frame.actual[k] - ideal);
        }
        Ok(())
    }

    fn offsets<P: Port>(
        &mut self,
        port: &mut P,
        answer: &mut Answer,
        count: usize,
    ) -> Result<(), RecordError> {
        for (track, offset) in self.offset.iter_mut().zip(&mut answer.offset).take(count) {
            *offset = track.pass(port, *offset)?;
        }
        for k in 0..count {
            let track = &mut self.wanted[k];
            let [line, parabola, cubic] = track.onward();
            // an active engine that is not limited gives what is wanted
            let near = [answer.offset[k], line, parabola, cubic];
            answer.wanted[k] = port.number(answer.wanted[k], &near, track.last())?;
            track.push(answer.wanted[k]);
        }
        Ok(())
    }

    fn live<P: Port>(
        &mut self,
        port: &mut P,
        told: u32,
        values: &mut [f64; LIVE_MAX],
    ) -> Result<(), RecordError> {
        for (k, (track, value)) in self.live.iter_mut().zip(values).enumerate() {
            if told >> k & 1 == 1 {
                *value = track.pass(port, *value)?;
            }
        }
        Ok(())
    }
}

/// Bytes of a difference, without its leading zeros.
const fn length_of(difference: u64) -> usize {
    8 - (difference.leading_zeros() / 8) as usize
}

fn usable(prediction: f64, fallback: f64) -> u64 {
    if prediction.is_finite() { prediction.to_bits() } else { fallback.to_bits() }
}
