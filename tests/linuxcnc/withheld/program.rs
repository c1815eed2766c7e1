//! The part program of the measurement: lines along the axes and the body diagonals, measured at rest in both directions
//! (ISO 230-2, ISO 230-6), each target approached from beyond the end of the line.

use std::fmt::Write as _;

/// Half the length of a line along each axis, mm; a body diagonal goes from corner to corner.
const HALF_MM: [f64; 3] = [200.0, 200.0, 160.0];
const AXIS_TARGETS: u32 = 17;
const DIAGONAL_TARGETS: u32 = 9;
const CYCLES: u32 = 3;
/// How far the motion goes beyond the outermost targets before it reverses, as a share of half the length.
const OVERRUN: f64 = 1.03;
/// Of 200 mm/s and 2000 mm/s^2, which the machine has.
const FEED_MM_PER_MIN: u32 = 10_000;
const DWELL_S: f64 = 0.2;
/// Signs of the ends of the four body diagonals.
const DIAGONALS: [[f64; 3]; 4] = [[1.0, 1.0, 1.0], [-1.0, 1.0, 1.0], [1.0, -1.0, 1.0], [1.0, 1.0, -1.0]];

/// A programmed stop at which the instrument is read.
#[derive(Clone, Copy)]
pub(super) struct Target {
    /// One line, for which the instrument is mounted anew.
    pub(super) setup: u32,
    /// One passage of a line in one direction.
    pub(super) run: u32,
    pub(super) repeat: u32,
    /// The same in each repetition.
    pub(super) pair: u32,
    pub(super) position: [f64; 3],
    /// Along the line, in the direction of its forward passages.
    pub(super) direction: [f64; 3],
}

pub(super) struct Program {
    pub(super) text: String,
    pub(super) targets: Vec<Target>,
}

impl Program {
    pub(super) fn new() -> Self {
        let mut program =
            Self { text: format!("G21 G90 G94 G17 G40 G49 G61\nF{FEED_MM_PER_MIN}\n"), targets: Vec::new() };
        for (axis, half) in HALF_MM.iter().enumerate() {
            let mut end = [0.0; 3];
            end[axis] = *half;
            program.line(end, AXIS_TARGETS);
        }
        for signs in DIAGONALS {
            program.line(core::array::from_fn(|k| signs[k] * HALF_MM[k]), DIAGONAL_TARGETS);
        }
        program.go([0.0; 3]);
        program.text.push_str("M2\n");
        program
    }

    fn go(&mut self, [x, y, z]: [f64; 3]) {
        writeln!(self.text, "G1 X{x:.4} Y{y:.4} Z{z:.4}").expect("text");
    }

    /// The line through zero to `end`.
    fn line(&mut self, end: [f64; 3], targets: u32) {
        let length = end.iter().map(|v| v * v).sum::<f64>().sqrt();
        let setup = self.targets.last().map_or(1, |t| t.setup + 1);
        for repeat in 1..=CYCLES {
            for (passage, sense) in [(0, 1.0), (1, -1.0)] {
                let run = self.targets.last().map_or(1, |t| t.run + 1);
                self.go(end.map(|v| -OVERRUN * sense * v));
                for k in 0..targets {
                    let share = sense * (2.0 * f64::from(k) / f64::from(targets - 1) - 1.0);
                    let position = end.map(|v| share * v);
                    self.go(position);
                    writeln!(self.text, "G4 P{DWELL_S}").expect("text");
                    let pair = 1000 * setup + passage * targets + k;
                    let direction = end.map(|v| v / length);
                    self.targets.push(Target { setup, run, repeat, pair, position, direction });
                }
                self.go(end.map(|v| OVERRUN * sense * v));
            }
        }
    }
}
