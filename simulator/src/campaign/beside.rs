//! What stands beside the control and offsets its set points while it moves, as volcompd does.
//!
//! The machine knows nothing of it but the set points that arrive.

use crate::twin::Command;
use crate::twin::heat::Heat;

/// Something beside the control.
pub trait Beside {
    /// The control is switched on and stands at a place.
    fn begin(&mut self, at: &Command);

    /// Another tool is in the spindle, this long, mm; the control reports it.
    fn tool(&mut self, length_mm: f64);

    /// Heat has gone on for so many seconds; sensors may be read.
    fn warm(&mut self, seconds: f64, heat: &Heat);

    /// A control cycle of 1 ms: the set points with the offset that is in force in it.
    fn step(&mut self, command: &Command) -> Command;
}
