//! Part programs: text to segments.
//!
//! | words | meaning |
//! |---|---|
//! | `G0` `G1` | rapid, line at feed `F` (mm/min; deg/min where only rotary axes move) |
//! | `G2` `G3` | arc or helix, clockwise or counter-clockwise seen from the plus end of the third axis; centre `I J K` from the start, or radius `R` (negative: the long way round); end equal to start with a centre: full circle |
//! | `G4 P` | dwell, `P` in seconds |
//! | `G17` `G18` `G19` | plane XY, ZX, YZ |
//! | `G90` `G91` | absolute, incremental |
//! | `G43.4` `G49` | tool-centre-point motion on, off ([`super::tool_centre`]): X, Y, Z are those of the tool tip, interpolated with the nominal kinematics while rotary axes turn; `H` accepted |
//! | `G21` `G94` `G40` `G80` | accepted: what the control does anyway |
//! | `G61` `G64` | exact stop at every block, continuous path (default) |
//! | `M0` `M1` | accepted: whoever would press start again does so at once |
//! | `M2` `M30` | end; the rest of the text is not read |
//! | `M3 M4 M5 M7 M8 M9`, `S` | accepted, without effect on the axes |
//! | `N` | block number, not checked |
//! | `( .. )`, `; ..`, `%`, lines starting with `#` | comments; `(SCORE ON)` and `(SCORE OFF)` mark what counts for results |
//!
//! Without a score mark every feed move counts and no rapid does. Everything else is refused with line and column,
//! never skipped: a simulator that ignores a word would measure another path than the part program.
//! Meaning as in RS-274; LinuxCNC counts dwell in seconds too.

mod interpret;
mod lex;

use volcomp_units::axes::{AxisArray, AxisName};

use super::segment::Segment;

pub use interpret::interpret;

/// The most segments that a program may have.
pub const MAX_SEGMENTS: usize = 2_000_000;
/// The longest dwell, s; longer ones are taken for milliseconds.
pub const MAX_DWELL_S: f64 = 600.0;
/// Largest difference between the radius at the start and at the end of an arc, mm.
pub const MAX_RADIUS_DIFFERENCE_MM: f64 = 0.005;

/// A part program.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Program {
    /// What it does, in order.
    pub segments: Vec<Segment>,
    /// Where it ends, mm or deg.
    pub end: AxisArray,
}

/// What is wrong with a program, and where.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("line {line}, column {column}: {problem}")]
pub struct GcodeError {
    /// Line, 1-based.
    pub line: u32,
    /// Column in characters, 1-based.
    pub column: u32,
    /// What is wrong.
    pub problem: Problem,
}

/// What can be wrong with a program.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[expect(missing_docs, reason = "the fields are what the message prints")]
pub enum Problem {
    /// A character that starts no word.
    #[error("{found:?} starts no word; words are a letter and a number, comments stand in ( ) or after ;")]
    Character { found: char },
    /// A comment without end.
    #[error("comment without end; close it with )")]
    OpenComment,
    /// A letter without a number.
    #[error("{letter} without a number; give one, such as {letter}1.5")]
    NoNumber { letter: char },
    /// A number that cannot be read.
    #[error("{letter}{text} is no finite number; write digits with at most one point, such as {letter}-12.5")]
    BadNumber { letter: char, text: String },
    /// Programming with variables.
    #[error("variables and expressions are not supported; write the numbers out")]
    Variable,
    /// Block delete.
    #[error("block delete (/) is not supported; remove the block or the slash")]
    BlockDelete,
    /// A code that is not known.
    #[error(
        "{letter}{value} is not supported; the codes are G0-4 G17-19 G21 G40 G43.4 G49 G61 G64 G80 G90 G91 G94 and M0-5 M7-9 M30"
    )]
    Unsupported { letter: char, value: f64 },
    /// Inches.
    #[error("G20 (inch) is not supported; convert the program to mm and use G21")]
    Inch,
    /// A word that belongs to nothing in this block.
    #[error("word {letter} has no meaning in this block; it belongs to {belongs_to}")]
    Meaningless { letter: char, belongs_to: &'static str },
    /// A letter twice in a block.
    #[error("{letter} stands twice in this block; keep one")]
    Twice { letter: char },
    /// Two codes of one modal group.
    #[error("{letter}{first} and {letter}{second} exclude each other in one block; keep one")]
    SameGroup { letter: char, first: f64, second: f64 },
    /// An axis that the machine lacks.
    #[error("axis {letter} is not on this machine, which has {axes}")]
    NoAxis { letter: char, axes: String },
    /// Motion without feed.
    #[error("no feed; give F above 0 before the first G1, G2 or G3")]
    NoFeed,
    /// A feed that makes no sense.
    #[error("feed F{value} is not above 0 mm/min; limit 1000000")]
    Feed { value: f64 },
    /// Outside travel.
    #[error("axis {axis} reaches {value} (travel {low} to {high}); move the program or correct the number")]
    Travel { axis: AxisName, value: f64, low: f64, high: f64 },
    /// A dwell without, or with a strange, time.
    #[error("dwell P{value} s is not within 0 to {MAX_DWELL_S} s; P counts seconds")]
    Dwell { value: f64 },
    /// G4 without P.
    #[error("G4 without P; give the time in seconds, such as G4 P0.5")]
    NoDwell,
    /// Neither centre nor radius.
    #[error("arc without centre or radius; give {offsets}, or R")]
    NoCentre { offsets: &'static str },
    /// Both centre and radius.
    #[error("arc with both centre and R; keep one of them")]
    CentreAndRadius,
    /// A centre offset along the third axis.
    #[error("{letter} does not lie in the plane of this arc; the plane takes {offsets}")]
    NotInPlane { letter: char, offsets: &'static str },
    /// Start and end radius differ.
    #[error(
        "arc radius is {start_mm} mm at the start and {end_mm} mm at the end (limit of the difference {MAX_RADIUS_DIFFERENCE_MM} mm); correct centre or end"
    )]
    Radius { start_mm: f64, end_mm: f64 },
    /// A radius too small for the chord.
    #[error("R{radius_mm} mm is too small: the end is {chord_mm} mm away; R is at least half of that")]
    ShortRadius { radius_mm: f64, chord_mm: f64 },
    /// A full circle by radius.
    #[error("a full circle cannot be given by R; give the centre {offsets}")]
    FullByRadius { offsets: &'static str },
    /// The machine lacks an axis of the plane.
    #[error("arc in plane {plane} needs axes that this machine does not have ({axes})")]
    NoPlane { plane: &'static str, axes: String },
    /// Tool-centre-point motion on a machine that cannot.
    #[error("G43.4 needs X, Y, Z and a rotary axis; this machine has {axes}")]
    NoToolCentre { axes: String },
    /// Too much.
    #[error("more than {MAX_SEGMENTS} blocks with motion; split the program")]
    TooLong,
}
