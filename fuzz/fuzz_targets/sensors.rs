//! What sensors send: however the bytes are cut, the same is heard; never a panic.
//!
//! Input: one byte with the number of sizes of pieces (0 to 15), the sizes (0 = all that is left), the stream.

#![no_main]
#![expect(clippy::disallowed_methods, reason = "the macro of libFuzzer reads its input file")]

use libfuzzer_sys::fuzz_target;
use volcomp::daemon::sensors::parse_stream;

/// Bytes of a binary message before its name, and its check sum behind the numbers.
const HEAD: usize = 20;
const SUM: usize = 4;

fuzz_target!(|data: &[u8]| {
    let Some((&count, rest)) = data.split_first() else { return };
    let Some((sizes, raw)) = rest.split_at_checked(usize::from(count % 16)) else { return };
    check(raw, sizes);
    let mut bytes = raw.to_vec();
    if repair(&mut bytes) {
        check(&bytes, sizes);
    }
});

fn check(bytes: &[u8], sizes: &[u8]) {
    let whole = read(bytes, &[0]);
    assert_eq!(read(bytes, &[1]), whole, "byte by byte");
    if !sizes.is_empty() {
        assert_eq!(read(bytes, sizes), whole, "in pieces of {sizes:?}");
    }
}

/// What is heard, as text: a direction that was not measured is no number, and equals nothing.
fn read(bytes: &[u8], sizes: &[u8]) -> String {
    let mut rest = bytes;
    let pieces = sizes.iter().cycle().map_while(|&size| {
        let n = if size == 0 { rest.len() } else { usize::from(size).min(rest.len()) };
        let piece;
        (piece, rest) = rest.split_at(n);
        (n > 0).then_some(piece)
    });
    format!("{:?}", parse_stream(pieces.collect::<Vec<_>>()))
}

/// Sets the check sum of every whole binary message right, so that the fuzzer gets behind it.
fn repair(bytes: &mut [u8]) -> bool {
    let (mut at, mut any) = (0, false);
    while at < bytes.len() {
        let rest = &mut bytes[at..];
        if rest[0] != b'V' {
            let Some(end) = rest.iter().position(|b| *b == b'\n') else { break };
            at += end + 1;
            continue;
        }
        if rest.len() < HEAD {
            break;
        }
        let numbers = usize::from(u16::from_le_bytes([rest[6], rest[7]]));
        let length = HEAD + usize::from(rest[5]) + 8 * numbers + SUM;
        let Some(message) = rest.get_mut(..length) else { break };
        let (content, sum) = message.split_at_mut(length - SUM);
        sum.copy_from_slice(&crc32c::crc32c(content).to_le_bytes());
        any = true;
        at += length;
    }
    any
}
