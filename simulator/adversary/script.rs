//! Bytes to operations: any bytes are a script.

use volcomp_engine::Command;

use super::control::{Lie, Place};

/// Values that have broken something before, or might: mm, deg, mm/min.
const VALUES: [f64; 24] = [
    0.0,
    -0.0,
    1e-9,
    1e-4,
    1.1e-4,
    0.002,
    -0.002,
    0.01,
    -0.01,
    0.049,
    0.05,
    0.051,
    0.0999,
    0.1001,
    -0.15,
    0.31,
    5.0,
    -1000.0,
    1e300,
    f64::MAX,
    f64::MIN_POSITIVE,
    f64::NAN,
    f64::INFINITY,
    f64::NEG_INFINITY,
];

/// One thing that happens.
#[derive(Debug, Clone, Copy)]
pub(super) enum Operation {
    /// Cycles with frames, X moving by so many mm each.
    Cycles {
        count: u8,
        speed: f64,
    },
    /// What the control reports from now on.
    Lie(Lie),
    /// Bits of the machine state.
    State(u16),
    /// One frame with this value in it.
    Value {
        place: Place,
        value: f64,
    },
    /// The control holds another offset.
    Hold {
        axis: usize,
        value: f64,
    },
    /// The number of the frames jumps.
    Sequence(i32),
    /// The control's clock jumps.
    Clock(i64),
    /// Cycles without frames; `deadlines`: the daemon keeps running.
    Silence {
        cycles: u16,
        deadlines: bool,
    },
    /// The newest frame once more.
    Repeat,
    /// The link breaks for so many cycles.
    Reconnect {
        cycles: u16,
    },
    Command(Command),
    Feed(f64),
    Tool(f64),
    Live(f64),
    Model(usize),
}

/// Reads a script.
#[derive(Debug)]
pub(super) struct Script<'a>(&'a [u8]);

impl<'a> Script<'a> {
    pub(super) const fn new(bytes: &'a [u8]) -> Self {
        Self(bytes)
    }

    /// The next byte, zero at the end.
    pub(super) fn byte(&mut self) -> u8 {
        let Some((first, rest)) = self.0.split_first() else { return 0 };
        self.0 = rest;
        *first
    }

    fn long(&mut self) -> u16 {
        u16::from_le_bytes([self.byte(), self.byte()])
    }

    /// A value: one of those above, or any eight bytes.
    fn value(&mut self) -> f64 {
        let choice = self.byte();
        match VALUES.get(usize::from(choice)) {
            Some(value) => *value,
            None if choice < 240 => f64::from(choice) * 1e-3 - 0.13,
            None => f64::from_le_bytes(core::array::from_fn(|_| self.byte())),
        }
    }

    /// The next operation, `None` at the end.
    pub(super) fn next(&mut self) -> Option<Operation> {
        if self.0.is_empty() {
            return None;
        }
        Some(match self.byte() % 24 {
            0..=4 => {
                let count = self.byte();
                Operation::Cycles { count, speed: f64::from(self.byte().cast_signed()) * 0.007 }
            }
            5 | 6 => Operation::Lie(self.lie()),
            7 => Operation::State(u16::from(self.byte()) & 0x3f),
            8 | 9 => Operation::State(0x0003),
            10 | 11 => {
                let place = Place::of(self.byte());
                Operation::Value { place, value: self.value() }
            }
            12 => {
                let axis = usize::from(self.byte() % 4);
                Operation::Hold { axis, value: self.value() }
            }
            13 => Operation::Sequence(i32::from(self.byte().cast_signed())),
            14 => Operation::Sequence(i32::from_le_bytes(core::array::from_fn(|_| self.byte()))),
            15 => Operation::Clock(i64::from(self.long().cast_signed()) * 100_000),
            16 => {
                let deadlines = self.byte() & 1 == 0;
                Operation::Silence { cycles: self.long() % 800, deadlines }
            }
            17 => Operation::Repeat,
            18 => Operation::Reconnect { cycles: self.long() % 400 },
            19 | 20 => Operation::Command(super::COMMANDS[usize::from(self.byte() % 8)]),
            21 => {
                if self.byte() & 1 == 0 {
                    Operation::Feed(self.value())
                } else {
                    Operation::Tool(self.value() * 1e3)
                }
            }
            22 => Operation::Live(self.value()),
            _ => Operation::Model(usize::from(self.byte())),
        })
    }

    fn lie(&mut self) -> Lie {
        match self.byte() % 8 {
            0 | 1 => Lie::None,
            2 => Lie::Times(self.value()),
            3 => Lie::Always(self.value()),
            4 => Lie::Times(-1.0),
            5 => Lie::Times(1e3),
            6 => Lie::Stuck,
            _ => Lie::Exchanged,
        }
    }
}
