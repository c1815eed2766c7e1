//! Bytes to a stream of frames: however they are cut, the messages, the error and the count of skipped
//! frames are the same, and the reader always has room.
//!
//! Input: one byte with the number of chunk sizes (0 to 15), the sizes (0 = as much as fits), the stream.

#![no_main]
#![expect(clippy::disallowed_methods, reason = "the macro of libFuzzer reads its input file")]

use libfuzzer_sys::fuzz_target;
use volcomp::protocol::{FrameError, FrameReader, MAX_FRAME, encode};
use volcomp_fuzz::repair;

fuzz_target!(|data: &[u8]| {
    let Some((&count, rest)) = data.split_first() else { return };
    let Some((sizes, raw)) = rest.split_at_checked(usize::from(count % 16)) else { return };
    check(raw, sizes);
    let mut bytes = raw.to_vec();
    let mut at = 0;
    while let Some(length) = repair(&mut bytes[at..]) {
        at += length;
    }
    if at > 0 {
        check(&bytes, sizes);
    }
});

fn check(bytes: &[u8], sizes: &[u8]) {
    let whole = read(bytes, &[0]);
    assert_eq!(read(bytes, &[1]), whole, "byte by byte");
    if !sizes.is_empty() {
        assert_eq!(read(bytes, sizes), whole, "in chunks of {sizes:?}");
    }
    // What was accepted is exactly what was sent, as long as nothing was skipped.
    if whole.2 == 0 {
        assert!(bytes.starts_with(&whole.0));
    }
}

/// The accepted frames packed again, the error that ended the stream, the frames skipped.
fn read(bytes: &[u8], sizes: &[u8]) -> (Vec<u8>, Option<FrameError>, u64) {
    let mut reader = FrameReader::default();
    let mut accepted = Vec::new();
    let mut rest = bytes;
    for &size in sizes.iter().cycle() {
        if rest.is_empty() {
            break;
        }
        let space = reader.space();
        assert!(space.len() >= MAX_FRAME, "no room after a drain");
        let wanted = if size == 0 { usize::MAX } else { usize::from(size) };
        let n = wanted.min(rest.len()).min(space.len());
        space[..n].copy_from_slice(&rest[..n]);
        reader.advance(n);
        rest = &rest[n..];
        loop {
            match reader.next() {
                Ok(Some(message)) => {
                    let mut buffer = [0; MAX_FRAME];
                    let used = encode(&message, &mut buffer);
                    accepted.extend_from_slice(&buffer[..used]);
                }
                Ok(None) => break,
                Err(error) => {
                    assert_eq!(reader.next(), Err(error), "an error stays");
                    assert_eq!(reader.pending(), 0);
                    return (accepted, Some(error), reader.skipped());
                }
            }
        }
        assert!(reader.pending() < MAX_FRAME, "a whole frame was left lying");
    }
    (accepted, None, reader.skipped())
}
