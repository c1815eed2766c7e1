//! Why bytes are no recording.

/// Why bytes are no recording, or not a whole one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum RecordError {
    /// The file does not begin like one.
    #[error("not a recording of volcompd: it does not begin with \"VCRECORD\"")]
    NotARecording,
    /// The file header is damaged.
    #[error("the header of the recording is damaged (check sum)")]
    Header,
    /// A later version.
    #[error(
        "the recording has format version {found}, this program reads up to {known}; use a newer volcomp"
    )]
    Version {
        /// Version of the file.
        found: u16,
        /// The newest one known.
        known: u16,
    },
    /// The description of the recording is missing or damaged.
    #[error("the recording has no readable description block; nothing tells which machine it is of")]
    NoMeta,
    /// The description is not understood.
    #[error("the description of the recording is not understood")]
    Meta,
    /// A block that this program must understand and does not.
    #[error(
        "byte {at}: a block of kind {kind}, which this program must understand and does not; use a newer volcomp"
    )]
    BlockKind {
        /// Where the block begins.
        at: u64,
        /// Its kind.
        kind: u8,
    },
    /// Bytes end in the middle of a value.
    #[error("the bytes end in the middle of an entry")]
    Short,
    /// A number with too many bytes.
    #[error("a number has too many bytes")]
    Number,
    /// A value that its field cannot have.
    #[error("a field has the value {found}, which it cannot have")]
    Value {
        /// The value.
        found: u64,
    },
    /// The packed bytes cannot be unpacked to the length stated.
    #[error("the packed bytes do not unpack to the length stated")]
    Packed,
}
