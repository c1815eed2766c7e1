//! Why a measurement cannot be made.

use std::io;
use std::path::PathBuf;

use volcomp_protocol::{CorrectionState, FrameError};

/// Why a measurement cannot be made.
#[derive(Debug, thiserror::Error)]
#[expect(missing_docs, reason = "the fields are what the message prints")]
pub enum BenchError {
    /// A file cannot be written.
    #[error("{}: {source}", path.display())]
    File { path: PathBuf, source: io::Error },
    /// A process cannot be started.
    #[error("cannot start {what}: {source}")]
    Start { what: &'static str, source: io::Error },
    /// A socket does not do what it should.
    #[error("link to {peer}: {source}")]
    Link { peer: &'static str, source: io::Error },
    /// Nothing came within the time allowed.
    #[error("{peer} did not {what} within {limit_s} s")]
    Timeout { peer: &'static str, what: &'static str, limit_s: f64 },
    /// The other side ended the link.
    #[error("{peer} ended the link: {said}")]
    Ended { peer: &'static str, said: String },
    /// The bytes are no frame.
    #[error("link to {peer}: {source}")]
    Frame { peer: &'static str, source: FrameError },
    /// The daemon does not compensate, so its figures would mean nothing.
    #[error("volcompd is {state:?} where it should be active; its log is {}", log.display())]
    NotActive { state: CorrectionState, log: PathBuf },
    /// The tool failed.
    #[error("volcomp {verb}: {said}")]
    Tool { verb: &'static str, said: String },
    /// A setting that cannot be measured.
    #[error("{what} {value}; give {allowed}")]
    Setting { what: &'static str, value: f64, allowed: &'static str },
    /// A histogram cannot be made.
    #[error("histogram: {0}")]
    Histogram(#[from] hdrhistogram::CreationError),
}
