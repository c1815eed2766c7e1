//! The stream reader: however bytes arrive, the messages are the same.

use super::*;

type Read = (Vec<Vec<u8>>, Option<FrameError>, u64);

/// Feeds bytes in chunks of the given sizes (cycled) and returns what came out, as bytes.
fn read(bytes: &[u8], chunks: &[usize]) -> Read {
    let mut reader = FrameReader::default();
    let mut messages = Vec::new();
    let mut rest = bytes;
    let mut sizes = chunks.iter().cycle();
    while !rest.is_empty() {
        let space = reader.space();
        assert!(space.len() >= MAX_FRAME, "room for a frame after every drain");
        let n = (*sizes.next().unwrap()).clamp(1, rest.len().min(space.len()));
        space[..n].copy_from_slice(&rest[..n]);
        reader.advance(n);
        rest = &rest[n..];
        loop {
            match reader.next() {
                Ok(Some(message)) => messages.push(bytes_of(&message)),
                Ok(None) => break,
                Err(error) => {
                    assert_eq!(reader.next(), Err(error), "the error stays");
                    return (messages, Some(error), reader.skipped());
                }
            }
        }
    }
    (messages, None, reader.skipped())
}

proptest! {
    #[test]
    fn any_split_and_merge_gives_the_same_messages(
        messages in proptest::collection::vec(any_message(), 1..30),
        chunks in proptest::collection::vec(prop_oneof![1_usize..20, 1_usize..3000], 1..40),
    ) {
        let frames: Vec<_> = messages.iter().map(bytes_of).collect();
        let (read, error, _) = read(&frames.concat(), &chunks);
        prop_assert_eq!(error, None);
        prop_assert_eq!(read, frames);
    }

    #[test]
    fn hostile_bytes_give_the_same_error_however_they_arrive(
        messages in proptest::collection::vec(any_message(), 0..6),
        tail in proptest::collection::vec(any::<u8>(), 1..700),
        forged in any::<bool>(),
        chunks in proptest::collection::vec(1_usize..900, 1..20),
    ) {
        let frames: Vec<_> = messages.iter().map(bytes_of).collect();
        let mut bytes = frames.concat();
        if forged {
            bytes.extend(frame::MAGIC);
        }
        bytes.extend(tail);
        let whole = read(&bytes, &[usize::MAX]);
        prop_assert_eq!(&whole.0[..frames.len()], &frames[..]);
        prop_assert_eq!(&read(&bytes, &[1]), &whole);
        prop_assert_eq!(&read(&bytes, &chunks), &whole);
    }

    #[test]
    fn any_operations_in_any_order_are_harmless(
        operations in proptest::collection::vec((0_u8..4, any::<usize>(), any::<u8>()), 0..200),
    ) {
        let mut reader = FrameReader::default();
        for (operation, count, byte) in operations {
            match operation {
                0 => { reader.space().fill(byte); }
                1 => reader.advance(count),
                2 => if reader.next() == Ok(None) { prop_assert!(reader.space().len() >= MAX_FRAME); },
                _ => reader.advance(count % 64),
            }
            prop_assert!(reader.pending() <= 4 * MAX_FRAME);
        }
    }
}

/// Puts bytes into a reader.
fn feed(reader: &mut FrameReader, bytes: &[u8]) {
    reader.space()[..bytes.len()].copy_from_slice(bytes);
    reader.advance(bytes.len());
}

#[test]
fn a_bad_header_is_noticed_without_waiting_for_its_length() {
    let mut reader = FrameReader::default();
    feed(&mut reader, b"V");
    assert_eq!(reader.next(), Ok(None));
    feed(&mut reader, b"X");
    assert_eq!(reader.next(), Err(FrameError::Magic { at: 1, found: b'X', expected: b'C' }));

    let mut reader = FrameReader::default();
    feed(&mut reader, b"VCMP\x01\x10\xff\xff");
    let error = FrameError::Length { code: 0x10, found: 0xffff, expected: 228 };
    assert_eq!(reader.next(), Err(error));
}

#[test]
fn after_an_error_bytes_are_dropped_until_cleared() {
    let mut reader = FrameReader::default();
    let good = bytes_of(&examples()[4]);
    let mut bad = good.clone();
    bad[100] ^= 1;
    feed(&mut reader, &[good.as_slice(), &bad, &good].concat());
    assert_eq!(reader.next(), Ok(Some(examples()[4])));
    let error = reader.next().unwrap_err();
    assert!(matches!(error, FrameError::Crc { .. }));
    for _ in 0..100 {
        feed(&mut reader, &good);
        assert_eq!(reader.next(), Err(error));
        assert_eq!(reader.pending(), 0);
    }
    reader.clear();
    feed(&mut reader, &good);
    assert_eq!(reader.next(), Ok(Some(examples()[4])));
    assert_eq!(reader.next(), Ok(None));
}

#[test]
fn unknown_optional_frames_are_skipped_and_counted() {
    let good = bytes_of(&examples()[5]);
    let skip = [frame_of(1, 0x80, &[]), frame_of(0, 0xff, &[7; 500]), frame_of(1, 0xa0, &[1; 33])];
    let bytes = [&skip[0], &good, &skip[1], &skip[2], &good, &skip[0]].map(Vec::as_slice).concat();
    for chunks in [&[1_usize][..], &[usize::MAX], &[11, 500, 3]] {
        assert_eq!(read(&bytes, chunks), (vec![good.clone(), good.clone()], None, 4));
    }
    let mut damaged = frame_of(1, 0x80, &[1, 2, 3]);
    damaged[9] ^= 4;
    let (messages, error, skipped) = read(&damaged, &[1]);
    assert!(messages.is_empty() && skipped == 0 && matches!(error, Some(FrameError::Crc { .. })));
    let (_, error, _) = read(&frame_of(1, 0x7f, &[1]), &[1]);
    assert_eq!(error, Some(FrameError::UnknownType { code: 0x7f }));
}

#[test]
fn a_partial_frame_is_pending_and_completes() {
    let mut reader = FrameReader::default();
    let bytes = bytes_of(&examples()[4]);
    feed(&mut reader, &bytes[..200]);
    assert_eq!((reader.next(), reader.pending()), (Ok(None), 200));
    feed(&mut reader, &bytes[200..]);
    assert_eq!((reader.next(), reader.pending()), (Ok(Some(examples()[4])), 0));
}

#[test]
fn whole_frames_never_make_the_buffer_move() {
    let mut reader = FrameReader::default();
    let bytes = bytes_of(&examples()[4]);
    for _ in 0..100 {
        assert_eq!(reader.space().len(), 4 * MAX_FRAME, "starts at the front each time");
        feed(&mut reader, &bytes);
        assert_eq!(reader.next(), Ok(Some(examples()[4])));
    }
}

#[test]
fn a_full_buffer_is_drained_without_loss() {
    let mut reader = FrameReader::default();
    let bytes = bytes_of(&examples()[4]).repeat(20);
    let mut fed = 0;
    let mut seen = 0;
    while seen < 20 {
        let n = reader.space().len().min(bytes.len() - fed);
        feed(&mut reader, &bytes[fed..fed + n]);
        fed += n;
        // One message at a time, so that the buffer stays as full as it can.
        assert_eq!(reader.next(), Ok(Some(examples()[4])));
        seen += 1;
    }
    assert_eq!((reader.next(), reader.pending()), (Ok(None), 0));
}
