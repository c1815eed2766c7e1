//! Why a link ended.

use std::io::ErrorKind;

use volcomp_protocol::{CloseReason, ErrorReport, FrameError};

/// Why a link ended.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub(super) enum LinkEnd {
    #[error("the control closed the connection without a close frame")]
    Closed,
    #[error("the control closed the link: {0}")]
    ClosedByControl(CloseReason),
    #[error("the control reported an error: {code} ({detail})", code = .0.code, detail = .0.detail)]
    Refused(ErrorReport),
    #[error("bytes from the control are not a frame: {0}")]
    BadFrame(FrameError),
    #[error("the control sent a {0}, which is not allowed here")]
    Unexpected(&'static str),
    #[error("nothing from the control for {limit_s} s")]
    Silent { limit_s: f64 },
    #[error("the control does not read: its receive buffer is full")]
    Congested,
    #[error("the connection failed: {0}")]
    Io(ErrorKind),
    #[error("the control sent a frame with a value that is not allowed: {0}")]
    Malformed(&'static str),
    #[error("the control holds another offset than the last one sent; the next link starts from it")]
    OffsetMoved,
    #[error("a fault is latched and nothing more is sent; the control removes its offset by its own rule")]
    Silenced,
    #[error("this daemon stops")]
    Stopped { at_rest: bool },
}

#[cfg(test)]
mod tests {
    use super::*;
    use volcomp_protocol::{ErrorCode, Name};

    #[test]
    fn codes_of_later_versions_are_told_by_their_number() {
        let refused = |code| LinkEnd::Refused(ErrorReport { code, detail: Name::new("drive 3") }).to_string();
        assert_eq!(refused(ErrorCode::Busy), "the control reported an error: Busy (drive 3)");
        assert_eq!(
            refused(ErrorCode::Other(200)),
            "the control reported an error: code 200, which this version does not know (drive 3)"
        );
        assert_eq!(
            LinkEnd::ClosedByControl(CloseReason::Other(9)).to_string(),
            "the control closed the link: reason 9, which this version does not know"
        );
    }
}
