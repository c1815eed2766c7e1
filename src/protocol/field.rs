//! Where each value stands in a frame, as offsets from the first byte of the frame.
//!
//! The same tables stand in `docs/protocol.md`; a test compares the two. Reading or writing a field never
//! panics: one that does not lie in the buffer reads as zero and is not written (after
//! [`Frame::check_len`](super::Frame::check_len) every field of the frame's own type lies in it).

use core::marker::PhantomData;

/// A value with a fixed number of bytes, little-endian.
pub trait Value: Copy {
    /// Bytes on the wire.
    const SIZE: usize;
    /// What a field outside the buffer reads as.
    const ZERO: Self;
    /// From exactly [`Value::SIZE`] bytes.
    fn read(bytes: &[u8]) -> Option<Self>;
    /// To exactly [`Value::SIZE`] bytes; anything else stays untouched.
    fn write(self, bytes: &mut [u8]);
}

/// A named place in a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Field<V> {
    name: &'static str,
    at: usize,
    value: PhantomData<V>,
}

impl<V: Value> Field<V> {
    /// A field at an offset.
    #[must_use]
    pub const fn new(name: &'static str, at: usize) -> Self {
        Self { name, at, value: PhantomData }
    }

    /// Its name, as in `docs/protocol.md`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        self.name
    }

    /// Its offset from the first byte of the frame.
    #[must_use]
    pub const fn at(self) -> usize {
        self.at
    }

    /// Its value in a frame.
    #[must_use]
    pub fn get(self, frame: &[u8]) -> V {
        frame.get(self.at..self.at + V::SIZE).and_then(V::read).unwrap_or(V::ZERO)
    }

    /// Puts a value into a frame.
    pub fn set(self, frame: &mut [u8], value: V) {
        if let Some(bytes) = frame.get_mut(self.at..self.at + V::SIZE) {
            value.write(bytes);
        }
    }
}

macro_rules! numbers {
    ($($type:ty)*) => {$(
        impl Value for $type {
            const SIZE: usize = size_of::<$type>();
            const ZERO: Self = 0 as Self;

            fn read(bytes: &[u8]) -> Option<Self> {
                bytes.try_into().ok().map(Self::from_le_bytes)
            }

            fn write(self, bytes: &mut [u8]) {
                if let Some(place) = bytes.first_chunk_mut() {
                    *place = self.to_le_bytes();
                }
            }
        }
    )*};
}

numbers!(u8 u16 u32 u64 i64 f64);

impl<const N: usize> Value for [u8; N] {
    const SIZE: usize = N;
    const ZERO: Self = [0; N];

    fn read(bytes: &[u8]) -> Option<Self> {
        bytes.try_into().ok()
    }

    fn write(self, bytes: &mut [u8]) {
        if let Some(place) = bytes.first_chunk_mut() {
            *place = self;
        }
    }
}

impl<const N: usize> Value for [f64; N] {
    const SIZE: usize = 8 * N;
    const ZERO: Self = [0.0; N];

    fn read(bytes: &[u8]) -> Option<Self> {
        let mut values = [0.0; N];
        let (chunks, rest) = bytes.as_chunks::<8>();
        if chunks.len() != N || !rest.is_empty() {
            return None;
        }
        for (value, chunk) in values.iter_mut().zip(chunks) {
            *value = f64::from_le_bytes(*chunk);
        }
        Some(values)
    }

    fn write(self, bytes: &mut [u8]) {
        for (chunk, value) in bytes.as_chunks_mut::<8>().0.iter_mut().zip(self) {
            *chunk = value.to_le_bytes();
        }
    }
}

/// Fields of one part of a frame, and their list for the comparison with the documentation.
macro_rules! fields {
    ($($(#[$doc:meta])* $field:ident: $type:ty = $at:literal, $name:literal;)*) => {
        $($(#[$doc])* pub const $field: Field<$type> = Field::new($name, $at);)*
        /// Name, offset and size of each, in order.
        #[cfg(test)]
        pub(crate) const ALL: &[(&str, usize, usize)] = &[$(($name, $at, <$type as super::Value>::SIZE)),*];
    };
}

/// The first bytes of every frame of every version.
pub mod header {
    use super::Field;

    fields! {
        /// Says that a frame begins.
        MAGIC: [u8; 4] = 0, "magic";
        /// 0 for the frames that never change, else the version agreed on.
        VERSION: u8 = 4, "version";
        /// What the frame is.
        TYPE: u8 = 5, "type";
        /// Bytes of the whole frame.
        LENGTH: u16 = 6, "length";
    }
}

/// [`DaemonHello`](super::DaemonHello).
pub mod daemon_hello {
    use super::Field;

    fields! {
        /// Lowest version understood.
        VERSION_MIN: u8 = 8, "version_min";
        /// Highest version understood.
        VERSION_MAX: u8 = 9, "version_max";
        /// Zero.
        RESERVED: [u8; 6] = 10, "reserved";
        /// The machine the daemon is configured for.
        MACHINE: [u8; 32] = 16, "machine";
        /// Program and version.
        SOFTWARE: [u8; 32] = 48, "software";
    }
}

/// [`ControlHello`](super::ControlHello).
pub mod control_hello {
    use super::Field;

    fields! {
        /// The version chosen.
        CHOSEN: u8 = 8, "chosen_version";
        /// Number of axes.
        AXIS_COUNT: u8 = 9, "axis_count";
        /// Zero.
        RESERVED: [u8; 6] = 10, "reserved";
        /// Interval between position frames, ns.
        CYCLE_NS: u64 = 16, "cycle_ns";
        /// Machine id.
        MACHINE: [u8; 32] = 24, "machine";
        /// Program and version.
        SOFTWARE: [u8; 32] = 56, "software";
        /// Letter and unit of each axis.
        AXES: [u8; 16] = 88, "axes";
    }
}

/// [`ErrorReport`](super::ErrorReport).
pub mod error {
    use super::Field;

    fields! {
        /// What went wrong.
        CODE: u8 = 8, "code";
        /// Zero.
        RESERVED: [u8; 7] = 9, "reserved";
        /// A word about it.
        DETAIL: [u8; 32] = 16, "detail";
    }
}

/// [`Close`](super::Close).
pub mod close {
    use super::Field;

    fields! {
        /// Why.
        REASON: u8 = 8, "reason";
        /// Zero.
        RESERVED: [u8; 3] = 9, "reserved";
    }
}

/// [`Position`](super::Position).
pub mod position {
    use super::Field;
    use volcomp_units::axes::AxisArray;

    fields! {
        /// Counts control cycles.
        SEQUENCE: u32 = 8, "sequence";
        /// State of the machine.
        STATE: u16 = 12, "state";
        /// Zero.
        RESERVED: [u8; 2] = 14, "reserved";
        /// The control's own time of the sample, ns.
        CONTROL_NS: i64 = 16, "control_ns";
        /// Feed along the path, mm/min.
        FEED: f64 = 24, "feed_mm_per_min";
        /// Commanded positions.
        COMMANDED: AxisArray = 32, "commanded";
        /// Actual positions.
        ACTUAL: AxisArray = 96, "actual";
        /// Offset in force.
        APPLIED: AxisArray = 160, "applied";
    }
}

/// [`Correction`](super::Correction).
pub mod correction {
    use super::Field;
    use volcomp_units::axes::AxisArray;

    fields! {
        /// The sequence answered.
        SEQUENCE: u32 = 8, "sequence";
        /// What the daemon is doing.
        STATE: u8 = 12, "state";
        /// Axes whose offset is limited.
        LIMITED: u8 = 13, "limited";
        /// Zero.
        RESERVED: [u8; 2] = 14, "reserved";
        /// Offset to apply.
        OFFSET: AxisArray = 16, "offset";
    }
}

/// [`Heartbeat`](super::Heartbeat).
pub mod heartbeat {
    use super::Field;

    fields! {
        /// Counts heartbeats.
        COUNT: u32 = 8, "count";
        /// Zero.
        RESERVED: [u8; 4] = 12, "reserved";
        /// The sender's own time, ns.
        TIME_NS: i64 = 16, "time_ns";
    }
}

/// [`Tool`](super::Tool).
pub mod tool {
    use super::Field;

    fields! {
        /// Tool number.
        NUMBER: u32 = 8, "number";
        /// Zero.
        RESERVED: [u8; 4] = 12, "reserved";
        /// Tool tip in M at home, mm.
        TIP: [f64; 3] = 16, "tip_mm";
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::{CRC_LEN, Kind};
    use crate::tests::fields_of;

    #[test]
    fn fields_follow_each_other_without_gap_and_numbers_are_aligned() {
        for kind in Kind::ALL {
            let mut at = 0;
            for &(name, offset, size) in header::ALL.iter().chain(fields_of(kind)) {
                assert_eq!(offset, at, "{kind:?} {name}");
                if name != "reserved" {
                    assert_eq!(offset % size.min(8), 0, "{kind:?} {name} is not aligned");
                }
                at += size;
            }
            assert_eq!(at + CRC_LEN, kind.length(), "{kind:?}");
        }
    }

    #[test]
    fn a_field_outside_the_buffer_reads_as_zero_and_is_not_written() {
        let mut short = [0xff; 100];
        assert_eq!(position::APPLIED.get(&short), [0.0; 8]);
        position::APPLIED.set(&mut short, [1.0; 8]);
        position::ACTUAL.set(&mut short, [1.0; 8]);
        assert_eq!(short, [0xff; 100]);
        assert_eq!(position::SEQUENCE.get(&short[..11]), 0);
        assert_eq!(position::SEQUENCE.get(&short[..12]), u32::MAX);
    }
}
