//! What the control holds, and what it says that it holds.

use volcomp_model::axes::{AxisArray, MAX_AXES};
use volcomp_protocol::{Correction, MachineState, Position};

/// Cycles without an answer after which the control takes the offset back.
const HOLD_CYCLES: u32 = 100;
/// What it takes back per cycle, mm or deg.
const TAKE_BACK: f64 = 1e-4;

/// How the read-back differs from what is held.
#[derive(Debug, Clone, Copy)]
pub(super) enum Lie {
    None,
    Times(f64),
    Always(f64),
    /// The read-back of before.
    Stuck,
    /// X as Y and Y as X.
    Exchanged,
}

/// A place in a frame.
#[derive(Debug, Clone, Copy)]
pub(super) enum Place {
    Commanded(usize),
    Actual(usize),
    Applied(usize),
    Feed,
}

impl Place {
    pub(super) const fn of(byte: u8) -> Self {
        let axis = (byte >> 2) as usize % MAX_AXES;
        match byte % 4 {
            0 => Self::Commanded(axis),
            1 => Self::Actual(axis),
            2 => Self::Applied(axis),
            _ => Self::Feed,
        }
    }
}

/// The control.
#[derive(Debug)]
pub(super) struct Control {
    pub(super) frame: Position,
    pub(super) held: AxisArray,
    pub(super) lie: Lie,
    axes: usize,
    cycle_ns: i64,
    due: Option<AxisArray>,
    missing: u32,
}

impl Control {
    pub(super) fn new(axes: usize, cycle_ns: i64) -> Self {
        let state = MachineState::from_bits(MachineState::HOMED | MachineState::ENABLED);
        let mut frame = Position { state, ..Position::default() };
        frame.commanded[0] = 100.0;
        Self { frame, held: [0.0; MAX_AXES], lie: Lie::None, axes, cycle_ns, due: None, missing: 0 }
    }

    pub(super) const fn set(&mut self, place: Place, value: f64) {
        match place {
            Place::Commanded(k) => self.frame.commanded[k] = value,
            Place::Actual(k) => self.frame.actual[k] = value,
            Place::Applied(k) => self.frame.applied[k] = value,
            Place::Feed => self.frame.feed_mm_per_min = value,
        }
    }

    pub(super) const fn receive(&mut self, correction: &Correction) {
        self.due = Some(correction.offset);
        self.missing = 0;
    }

    /// One cycle: the answer of the cycle before acts, or none is there for too long.
    pub(super) fn advance(&mut self) {
        let frame = &mut self.frame;
        frame.sequence = frame.sequence.wrapping_add(1);
        frame.control_ns = frame.control_ns.saturating_add(self.cycle_ns);
        let state = frame.state;
        let due = self.due.take();
        self.missing = self.missing.saturating_add(1);
        if state.has(MachineState::ENABLED) && !state.has(MachineState::ESTOP) {
            if let Some(offset) = due {
                self.held = offset;
            } else if self.missing > HOLD_CYCLES {
                self.held.iter_mut().for_each(|v| *v -= v.clamp(-TAKE_BACK, TAKE_BACK));
            }
        }
        let held = self.held;
        for (k, applied) in self.frame.applied.iter_mut().enumerate().take(self.axes) {
            *applied = match self.lie {
                Lie::None => held[k],
                Lie::Times(factor) => held[k] * factor,
                Lie::Always(value) => value,
                Lie::Stuck => *applied,
                Lie::Exchanged if k < 2 => held[1 - k],
                Lie::Exchanged => held[k],
            };
        }
        for (k, held) in held.iter().enumerate().take(self.axes) {
            self.frame.actual[k] = self.frame.commanded[k] + held;
        }
    }
}
