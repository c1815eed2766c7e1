//! Bytes to one frame: never a panic, and what is accepted packs to the same bytes again.

#![no_main]
#![expect(clippy::disallowed_methods, reason = "the macro of libFuzzer reads its input file")]

use libfuzzer_sys::fuzz_target;
use volcomp::protocol::{Frame, MAX_FRAME, decode, encode};
use volcomp_fuzz::repair;

fuzz_target!(|data: &[u8]| {
    check(data);
    let mut bytes = data.to_vec();
    if let Some(length) = repair(&mut bytes) {
        check(&bytes[..length]);
        check(&bytes);
    }
});

fn check(bytes: &[u8]) {
    let view = Frame::new_unchecked(bytes);
    let _ = (view.version(), view.code(), view.kind(), view.length(), view.payload(), view.crc());
    match decode(bytes) {
        Ok(message) => {
            let mut buffer = [0xa5; MAX_FRAME];
            let used = encode(&message, &mut buffer);
            assert_eq!(&buffer[..used], bytes, "{message:?} packs to other bytes");
        }
        Err(error) => {
            let _ = error.to_string();
        }
    }
}
