//! Lines of a control that is read and written by calls: however they are cut, the same lines come out and the same error
//! ends them; what is accepted as a request or a reply is written and read back the same.
//!
//! Input: one byte with the number of axes (low half, 1 to 8) and of chunk sizes (high half), the sizes (0 = as much as
//! fits), the lines.

#![no_main]
#![expect(clippy::disallowed_methods, reason = "the macro of libFuzzer reads its input file")]

use libfuzzer_sys::fuzz_target;
use volcomp::protocol::read_write::{LINE_MAX, LineError, LineReader, Reply, Request};

fuzz_target!(|data: &[u8]| {
    let Some((&first, rest)) = data.split_first() else { return };
    let axes = usize::from(first % 8) + 1;
    let Some((sizes, stream)) = rest.split_at_checked(usize::from(first >> 4)) else { return };
    let whole = lines(stream, &[0]);
    assert_eq!(lines(stream, &[1]), whole, "byte by byte");
    if !sizes.is_empty() {
        assert_eq!(lines(stream, sizes), whole, "in chunks of {sizes:?}");
    }
    for line in &whole.0 {
        if let Ok(request) = Request::parse(line, axes) {
            let written = bytes(|out| request.write(axes, out));
            let again =
                Request::parse(&written[..written.len() - 1], axes).expect("a written request is one");
            assert_eq!(bytes(|out| again.write(axes, out)), written);
        }
        // a name may end in a carriage return, which a reader takes for the end of the line
        if let Ok(reply) = Reply::parse(line, axes)
            && let written = bytes(|out| reply.write(axes, out))
            && !written.ends_with(b"\r\n")
        {
            let again = Reply::parse(&written[..written.len() - 1], axes).expect("a written reply is one");
            assert_eq!(bytes(|out| again.write(axes, out)), written);
        }
    }
});

/// What is written.
fn bytes(write: impl FnOnce(&mut [u8; LINE_MAX]) -> usize) -> Vec<u8> {
    let mut out = [0; LINE_MAX];
    let length = write(&mut out);
    out[..length].to_vec()
}

/// The lines, and the error that ended them.
fn lines(bytes: &[u8], sizes: &[u8]) -> (Vec<Vec<u8>>, Option<LineError>) {
    let mut reader = LineReader::default();
    let mut lines = Vec::new();
    let mut rest = bytes;
    for &size in sizes.iter().cycle() {
        if rest.is_empty() {
            break;
        }
        let space = reader.space();
        assert!(!space.is_empty(), "no room after a drain");
        let wanted = if size == 0 { usize::MAX } else { usize::from(size) };
        let n = wanted.min(rest.len()).min(space.len());
        space[..n].copy_from_slice(&rest[..n]);
        reader.advance(n);
        rest = &rest[n..];
        loop {
            match reader.next_line() {
                Ok(Some(line)) => {
                    assert!(line.len() < LINE_MAX);
                    lines.push(line.to_vec());
                }
                Ok(None) => break,
                Err(error) => return (lines, Some(error)),
            }
        }
    }
    (lines, None)
}
