//! What the targets of the link share.

use volcomp::protocol::{Frame, field, frame};

/// Writes the check sum that the bytes of a frame ask for, so that the fuzzer gets behind it.
/// Returns the length of the frame, `None` where the bytes are not the beginning of a whole one.
pub fn repair(bytes: &mut [u8]) -> Option<usize> {
    let length = usize::from(field::header::LENGTH.get(bytes));
    if bytes.len() < frame::MIN_FRAME || !(frame::MIN_FRAME..=bytes.len()).contains(&length) {
        return None;
    }
    let mut view = Frame::new_unchecked(&mut bytes[..length]);
    view.set(field::header::MAGIC, frame::MAGIC);
    view.fill_crc();
    Some(length)
}
