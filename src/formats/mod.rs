//! Files of instruments and controls: text or bytes to readings, and models to the tables that controls load.
//!
//! Pure: the shell reads and writes the files. A damaged file gives line, column and what was expected, never a
//! partial result. One file per format; what is known of each format stands in its head.

pub mod hole_plate;
pub mod iso230_dat;
