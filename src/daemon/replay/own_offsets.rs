//! Read-back for an engine that catches up: its own offsets, not those that the recorded one had sent.

use std::collections::VecDeque;

use volcomp_engine::LAG_CYCLES_MAX;
use volcomp_protocol::{MachineState, Position};
use volcomp_units::axes::AxisArray;

/// Steps of the last bit within which a position is looked for that gives the recorded one again.
const LAST_BITS: i64 = 2;

/// The last offsets of the engine, newest last; mm or deg.
#[derive(Debug, Default)]
pub(super) struct OwnOffsets {
    sent: VecDeque<(u32, AxisArray)>,
}

impl OwnOffsets {
    pub(super) fn clear(&mut self) {
        self.sent.clear();
    }

    /// The offset that answers frame `sequence`.
    pub(super) fn sent(&mut self, sequence: u32, offset: AxisArray) {
        if self.sent.len() > LAG_CYCLES_MAX {
            self.sent.pop_front();
        }
        self.sent.push_back((sequence, offset));
    }

    /// The frame with the engine's own offset as the read-back, as late as the control was: an engine that catches up is
    /// not the one that the control listened to, and must not take that for a foreign writer. A control that moves the
    /// offset by itself, or a machine that cannot move at all, is told as it was.
    pub(super) fn read_back(&self, frame: &Position, lag: u32) -> Position {
        let by_itself = frame.state.has(MachineState::OFFSET_RAMPING_OUT);
        let late = |of: u32| {
            let ahead = frame.sequence.wrapping_sub(of);
            ahead >= lag.max(1) && ahead < u32::MAX / 2
        };
        let applied = self.sent.iter().rev().find(|(of, _)| late(*of)).or_else(|| self.sent.front());
        let Some((_, applied)) = applied.filter(|_| frame.state.is_ready() && !by_itself) else {
            return *frame;
        };
        let actual = core::array::from_fn(|k| above(frame.actual[k] - frame.applied[k], applied[k]));
        Position { actual, applied: *applied, ..*frame }
    }
}

/// A sum from which taking `offset` off gives `position` to the last bit, where there is one.
fn above(position: f64, offset: f64) -> f64 {
    let sum = position + offset;
    let near = |steps: i64| f64::from_bits(sum.to_bits().wrapping_add_signed(steps));
    let fits = |sum: &f64| (*sum - offset).to_bits() == position.to_bits();
    (0..=LAST_BITS).flat_map(|k| [near(k), near(-k)]).find(fits).unwrap_or(sum)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_read_back_is_as_late_as_the_control_was() {
        let mut own = OwnOffsets::default();
        let ready = MachineState::from_bits(MachineState::HOMED | MachineState::ENABLED);
        let frame = |sequence| Position { sequence, state: ready, ..Position::default() };
        assert_eq!(own.read_back(&frame(9), 3), frame(9), "nothing has been sent yet");
        for sequence in 0..10 {
            own.sent(sequence, [f64::from(sequence); 8]);
        }
        for (lag, expected) in [(0, 9.0), (1, 9.0), (3, 7.0), (8, 2.0), (200, 0.0)] {
            assert_eq!(own.read_back(&frame(10), lag).applied[0], expected, "lag {lag}");
        }
        let estop = Position { state: MachineState::from_bits(MachineState::ESTOP), ..frame(10) };
        assert_eq!(own.read_back(&estop, 1), estop);
    }

    #[test]
    fn the_position_behind_the_read_back_is_the_recorded_one_to_the_last_bit() {
        let mut found = 0;
        for k in 0..10_000_u32 {
            let position = 100.0 + 90.0 * (f64::from(k) * 0.017).sin();
            let offset = 0.03 * (f64::from(k) * 0.11).cos();
            found += u32::from((above(position, offset) - offset).to_bits() == position.to_bits());
        }
        assert!(found > 9_900, "{found}");
    }
}
