//! Files of instruments and controls: text or bytes to readings, and models to the tables that controls load.
//!
//! Pure: the shell reads and writes the files. A damaged file gives line, column and what was expected, never a
//! partial result. One file per format; what is known of each format stands in its head. Equations:
//! `docs/reference/equations.md`.

#![forbid(unsafe_code)]
#![cfg_attr(not(test), forbid(clippy::disallowed_methods))]

pub mod api_pos;
pub mod axis_table;
pub mod b5r;
pub mod camonitor;
pub mod columns;
pub mod detect;
pub mod edge;
pub mod error;
pub mod heidenhain;
pub mod hole_plate;
pub mod isg;
pub mod isg_lis;
pub mod iso230_dat;
pub mod linuxcnc;
pub mod motion_table;
pub mod part_program;
pub mod positioning_test;
mod prelude;
pub mod reflector_poses;
pub mod rtl;
pub mod rtx;
pub mod sample;
pub mod start_up;
pub mod text;

pub use error::{FormatError, FormatErrorKind, Place, ReadError};
