//! Text of instruments and loggers to readings. Takes `&str`; the shell reads the files.

pub mod iso230_dat;
