//! What a bad link does to the frames that pass.
//!
//! A fault acts on whole frames of one direction or both, from the moment it is set until it has met so many frames
//! (or until it is cleared). Random choices come from a seed.

use std::collections::VecDeque;
use std::time::Duration;

use serde::{Deserialize, Serialize};
use volcomp_protocol::{Message, decode, encode};
use volcomp_units::axes::AxisArray;

/// Which frames are met.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Direction {
    /// Position frames, on their way to the daemon.
    #[default]
    ToDaemon,
    /// Corrections, on their way to the control.
    ToControl,
    /// Both.
    Both,
}

/// What happens to a frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(tag = "fault", rename_all = "kebab-case", rename_all_fields = "kebab-case", deny_unknown_fields)]
pub enum FaultKind {
    /// Nothing any more.
    None,
    /// It comes later, by a fixed and a random part.
    Delay {
        /// Fixed part.
        ms: f64,
        /// Largest random part.
        #[serde(default)]
        jitter_ms: f64,
    },
    /// It is written in pieces of so many bytes.
    Split {
        /// Size of a piece.
        bytes: usize,
    },
    /// It waits for others and comes with them in one piece.
    Merge {
        /// Frames in one piece.
        together: usize,
    },
    /// One byte of it is changed.
    Corrupt,
    /// It carries another number.
    WrongSequence {
        /// Added to the number.
        by: i64,
    },
    /// It comes twice.
    Duplicate,
    /// It comes after the next one.
    Reorder,
    /// It does not come.
    Drop,
    /// Its last bytes are missing.
    Truncate {
        /// So many.
        bytes: usize,
    },
    /// In its place comes a header that announces the longest frame there is, and nothing behind it.
    Huge,
    /// So many random bytes come before it.
    Garbage {
        /// Bytes.
        bytes: usize,
    },
    /// The connection is reset.
    Reset,
    /// The connection is closed in order.
    Close,
    /// Nothing passes any more, and the connection stays open.
    HalfOpen,
    /// It is written byte by byte, with a pause before each.
    SlowLoris {
        /// Pause before a byte.
        ms: f64,
    },
    /// Its first position (or offset) is no number.
    Nan,
    /// Its first position (or offset) is elsewhere.
    Jump {
        /// By so much.
        mm: f64,
    },
    /// The clock of the control has jumped.
    ClockStep {
        /// By so much.
        ms: f64,
    },
    /// Its positions are those of the first frame that was met.
    Freeze,
    /// The offset read back is another one.
    ReadBack {
        /// By so much.
        um: f64,
    },
    /// The read-back is the true one times a factor: another unit, another sign, none at all.
    ReadBackTimes {
        /// The factor.
        by: f64,
    },
    /// The read-back of the first axis is always the same.
    ReadBackIs {
        /// The value.
        mm: f64,
    },
    /// The read-back stays as it was in the first frame that was met.
    ReadBackStuck,
    /// The read-back is the offset that the daemon asked for last, times a factor.
    ReadBackFeedback {
        /// The factor.
        by: f64,
    },
    /// The read-back is that of so many frames before.
    ReadBackLate {
        /// Frames.
        cycles: usize,
    },
    /// The read-backs of the first two axes are exchanged.
    ReadBackSwapped,
    /// The control has another number of axes (in its hello).
    AxisCount {
        /// So many.
        count: u8,
    },
}

/// A fault and which frames it meets.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LinkFault {
    /// What happens.
    #[serde(flatten)]
    pub kind: FaultKind,
    /// To frames of which direction.
    #[serde(default)]
    pub direction: Direction,
    /// To every so-manieth frame.
    #[serde(default = "one")]
    pub every: u64,
    /// To so many frames in all; without a number until it is cleared.
    #[serde(default)]
    pub frames: Option<u64>,
}

/// Pause before and after a frame that must be seen by itself.
const APART: Duration = Duration::from_millis(2);

const fn one() -> u64 {
    1
}

impl Direction {
    /// True where frames to the control (or to the daemon) are met.
    #[must_use]
    pub fn meets(self, to_control: bool) -> bool {
        match self {
            Self::Both => true,
            Self::ToControl => to_control,
            Self::ToDaemon => !to_control,
        }
    }
}

/// What the link does instead of passing a frame on.
#[derive(Debug, Clone, PartialEq)]
pub enum Passage {
    /// Write these bytes so much later than they came.
    Later(Duration, Vec<u8>),
    /// Write these bytes after a pause behind those before.
    Write(Duration, Vec<u8>),
    /// Reset the connection.
    Reset,
    /// Close the connection.
    Close,
    /// Pass nothing any more.
    Silence,
}

/// One direction of a connection: what it has kept back.
#[derive(Debug, Default)]
pub struct Lane {
    waiting: Vec<u8>,
    waiting_frames: usize,
    held: Option<Vec<u8>>,
    frozen: Option<AxisArray>,
    /// Read-backs of the frames before, the oldest first.
    read_backs: VecDeque<AxisArray>,
    /// The offset that the daemon asked for last.
    pub(super) asked: AxisArray,
}

impl Lane {
    /// What becomes of a frame; `random` gives numbers from 0 to 1.
    /// `met` counts the frames that this fault has met, this one included, over all connections.
    pub fn pass(
        &mut self,
        fault: &LinkFault,
        met: u64,
        frame: &[u8],
        random: &mut dyn FnMut() -> f64,
    ) -> Vec<Passage> {
        // of several that come in one piece, only the newest is looked at
        let apart = |first: &[u8], second: &[u8]| {
            vec![
                Passage::Write(Duration::ZERO, first.to_vec()),
                Passage::Write(APART, second.to_vec()),
                Passage::Write(APART, Vec::new()),
            ]
        };
        if let Some(older) = self.held.take() {
            return apart(frame, &older);
        }
        if fault.kind == FaultKind::None {
            return self.let_go(frame);
        }
        let counted = met.is_multiple_of(fault.every.max(1));
        let spent = fault.frames.is_some_and(|n| met > n.saturating_mul(fault.every.max(1)));
        if spent || !counted {
            return self.let_go(frame);
        }
        let now = |bytes: Vec<u8>| vec![Passage::Write(Duration::ZERO, bytes)];
        match fault.kind {
            FaultKind::None => self.let_go(frame),
            FaultKind::Delay { ms, jitter_ms } => {
                vec![Passage::Later(millis(ms + jitter_ms * random()), frame.to_vec())]
            }
            FaultKind::Split { bytes } => frame
                .chunks(bytes.max(1))
                .map(|piece| Passage::Write(Duration::from_micros(20), piece.to_vec()))
                .collect(),
            FaultKind::Merge { together } => {
                self.waiting.extend_from_slice(frame);
                self.waiting_frames += 1;
                if self.waiting_frames < together { Vec::new() } else { self.let_go(&[]) }
            }
            FaultKind::Corrupt => {
                let mut bytes = frame.to_vec();
                let at = ((random() * bytes.len() as f64) as usize).min(bytes.len() - 1);
                bytes[at] ^= 1 << ((random() * 8.0) as u32).min(7);
                now(bytes)
            }
            FaultKind::Duplicate => apart(frame, frame),
            FaultKind::Reorder => {
                self.held = Some(frame.to_vec());
                Vec::new()
            }
            FaultKind::Drop => Vec::new(),
            FaultKind::Truncate { bytes } => now(frame[..frame.len().saturating_sub(bytes)].to_vec()),
            FaultKind::Huge => now(frame[..6].iter().copied().chain([0xff, 0xff]).collect()),
            FaultKind::Garbage { bytes } => {
                let mut all: Vec<u8> = (0..bytes).map(|_| (random() * 256.0) as u8).collect();
                all.extend_from_slice(frame);
                now(all)
            }
            FaultKind::Reset => vec![Passage::Reset],
            FaultKind::Close => vec![Passage::Close],
            FaultKind::HalfOpen => vec![Passage::Silence],
            FaultKind::SlowLoris { ms } => {
                frame.iter().map(|byte| Passage::Write(millis(ms), vec![*byte])).collect()
            }
            _ => now(self.falsify(fault.kind, frame)),
        }
    }

    /// Another fault begins.
    pub fn renew(&mut self) {
        self.frozen = None;
        self.read_backs.clear();
    }

    /// The frame, behind whatever was kept back.
    fn let_go(&mut self, frame: &[u8]) -> Vec<Passage> {
        let mut bytes = core::mem::take(&mut self.waiting);
        self.waiting_frames = 0;
        bytes.extend_from_slice(frame);
        vec![Passage::Write(Duration::ZERO, bytes)]
    }

    /// The same frame with something false in it and a right check sum.
    fn falsify(&mut self, kind: FaultKind, frame: &[u8]) -> Vec<u8> {
        let Ok(message) = decode(frame) else { return frame.to_vec() };
        let mut bytes = [0; volcomp_protocol::MAX_FRAME];
        let length = encode(&self.false_message(kind, message), &mut bytes);
        bytes[..length].to_vec()
    }

    fn false_message(&mut self, kind: FaultKind, message: Message) -> Message {
        match (kind, message) {
            (FaultKind::WrongSequence { by }, Message::Position(mut p)) => {
                p.sequence = p.sequence.wrapping_add(by as u32);
                Message::Position(p)
            }
            (FaultKind::WrongSequence { by }, Message::Correction(mut c)) => {
                c.sequence = c.sequence.wrapping_add(by as u32);
                Message::Correction(c)
            }
            (FaultKind::Nan, Message::Position(mut p)) => {
                p.commanded[0] = f64::NAN;
                Message::Position(p)
            }
            (FaultKind::Nan, Message::Correction(mut c)) => {
                c.offset[0] = f64::NAN;
                Message::Correction(c)
            }
            (FaultKind::Jump { mm }, Message::Position(mut p)) => {
                p.commanded[0] += mm;
                Message::Position(p)
            }
            (FaultKind::Jump { mm }, Message::Correction(mut c)) => {
                c.offset[0] += mm;
                Message::Correction(c)
            }
            (FaultKind::ClockStep { ms }, Message::Position(mut p)) => {
                p.control_ns += (ms * 1e6) as i64;
                Message::Position(p)
            }
            (FaultKind::Freeze, Message::Position(mut p)) => {
                p.commanded = *self.frozen.get_or_insert(p.commanded);
                Message::Position(p)
            }
            (_, Message::Position(mut p)) => {
                p.applied = self.false_read_back(kind, p.applied);
                Message::Position(p)
            }
            (FaultKind::AxisCount { count }, Message::ControlHello(mut h)) => {
                h.axis_count = count;
                Message::ControlHello(h)
            }
            (_, other) => other,
        }
    }
}

impl Lane {
    /// What a control reports whose read-back lies, where it holds `applied`.
    fn false_read_back(&mut self, kind: FaultKind, applied: AxisArray) -> AxisArray {
        let mut told = applied;
        match kind {
            FaultKind::ReadBack { um } => told[0] += um / 1e3,
            FaultKind::ReadBackTimes { by } => told = applied.map(|v| v * by),
            FaultKind::ReadBackIs { mm } => told[0] = mm,
            FaultKind::ReadBackStuck => told = *self.frozen.get_or_insert(applied),
            FaultKind::ReadBackFeedback { by } => told = self.asked.map(|v| v * by),
            FaultKind::ReadBackLate { cycles } => {
                self.read_backs.push_back(applied);
                if self.read_backs.len() > cycles + 1 {
                    self.read_backs.pop_front();
                }
                told = self.read_backs.front().copied().unwrap_or(applied);
            }
            FaultKind::ReadBackSwapped => told.swap(0, 1),
            _ => {}
        }
        told
    }
}

fn millis(ms: f64) -> Duration {
    Duration::from_secs_f64((ms / 1e3).max(0.0))
}

#[cfg(test)]
mod tests {
    use volcomp_protocol::Position;

    use super::*;

    fn told(lane: &mut Lane, kind: FaultKind, x: f64, y: f64) -> [f64; 2] {
        let mut position = Position::default();
        [position.applied[0], position.applied[1]] = [x, y];
        let Message::Position(p) = lane.false_message(kind, Message::Position(position)) else {
            return [f64::NAN; 2];
        };
        [p.applied[0], p.applied[1]]
    }

    #[test]
    fn a_read_back_lies_as_its_fault_says() {
        let mut lane = Lane::default();
        assert_eq!(told(&mut lane, FaultKind::ReadBackTimes { by: 1000.0 }, 0.01, -0.02), [10.0, -20.0]);
        assert_eq!(told(&mut lane, FaultKind::ReadBackTimes { by: 0.0 }, 0.01, 0.02), [0.0, 0.0]);
        assert_eq!(told(&mut lane, FaultKind::ReadBackIs { mm: 1e308 }, 0.01, 0.02), [1e308, 0.02]);
        assert_eq!(told(&mut lane, FaultKind::ReadBackSwapped, 0.01, 0.02), [0.02, 0.01]);
        lane.asked[0] = 0.5;
        assert_eq!(told(&mut lane, FaultKind::ReadBackFeedback { by: 10.0 }, 0.01, 0.02), [5.0, 0.0]);
        for (held, stuck, late) in
            [(0.01, 0.01, 0.01), (0.02, 0.01, 0.01), (0.03, 0.01, 0.01), (0.04, 0.01, 0.02)]
        {
            assert_eq!(told(&mut lane, FaultKind::ReadBackStuck, held, 0.0)[0], stuck);
            assert_eq!(told(&mut lane, FaultKind::ReadBackLate { cycles: 2 }, held, 0.0)[0], late);
        }
        lane.renew();
        assert_eq!(told(&mut lane, FaultKind::ReadBackStuck, 0.04, 0.0)[0], 0.04);
    }
}
