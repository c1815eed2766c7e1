//! Bytes that are no frame: each with its reason, none with a panic.

use super::*;

/// The example of a type, changed by `edit` and sealed again, so that only the rule under test is broken.
fn broken(kind: Kind, edit: impl FnOnce(&mut Vec<u8>)) -> Result<Message, FrameError> {
    let at = Kind::ALL.iter().position(|&k| k == kind).unwrap();
    let mut bytes = bytes_of(&examples()[at]);
    edit(&mut bytes);
    seal(&mut bytes, kind.version(), kind.code());
    decode(&bytes)
}

proptest! {
    #[test]
    fn random_bytes_never_panic(bytes in proptest::collection::vec(any::<u8>(), 0..600)) {
        let _ = decode(&bytes);
        let _ = Frame::new_checked(&bytes);
    }

    #[test]
    fn random_payloads_with_a_right_check_sum_never_panic_and_re_encode(
        kind in 0_usize..8, payload in proptest::collection::vec(any::<u8>(), 216), sparse in any::<bool>(),
    ) {
        let kind = Kind::ALL[kind];
        let mut bytes = payload[..kind.length() - frame::MIN_FRAME].to_vec();
        if sparse {
            bytes.iter_mut().enumerate().filter(|(k, _)| k % 8 > 1).for_each(|(_, b)| *b = 0);
        }
        let bytes = frame_of(kind.version(), kind.code(), &bytes);
        if let Ok(message) = decode(&bytes) {
            prop_assert_eq!(bytes_of(&message), bytes);
        }
    }

    #[test]
    fn up_to_five_flipped_bits_are_detected(
        message in any_message(), flips in proptest::collection::vec(any::<prop::sample::Index>(), 1..=5),
    ) {
        let good = bytes_of(&message);
        let mut bytes = good.clone();
        for flip in flips {
            let bit = flip.index(8 * bytes.len());
            bytes[bit / 8] ^= 1 << (bit % 8);
        }
        prop_assert!(bytes == good || decode(&bytes).is_err());
    }
}

#[test]
fn every_single_flipped_bit_is_detected() {
    for message in examples() {
        let good = bytes_of(&message);
        for bit in 0..8 * good.len() {
            let mut bytes = good.clone();
            bytes[bit / 8] ^= 1 << (bit % 8);
            assert!(decode(&bytes).is_err(), "{message:?}: bit {bit}");
        }
    }
}

#[test]
fn every_burst_of_up_to_32_bits_is_detected() {
    for message in examples() {
        let good = bytes_of(&message);
        for at in 0..=good.len() - 4 {
            for mask in [0xffff_ffff_u32, 0x8000_0001, 0xa5a5_a5a5, 0x00ff_ff00] {
                let mut bytes = good.clone();
                bytes[at..at + 4].iter_mut().zip(mask.to_le_bytes()).for_each(|(b, m)| *b ^= m);
                assert!(decode(&bytes).is_err(), "{message:?}: {mask:08x} at {at}");
            }
        }
    }
}

#[test]
fn every_impossible_length_is_refused() {
    for (kind, message) in Kind::ALL.into_iter().zip(examples()) {
        let good = bytes_of(&message);
        for cut in 0..good.len() {
            let needed = if cut < frame::HEADER_LEN { frame::HEADER_LEN } else { good.len() };
            assert_eq!(decode(&good[..cut]), Err(FrameError::Truncated { needed, found: cut }));
        }
        for length in 0..=u16::MAX {
            let mut bytes = good.clone();
            bytes[6..8].copy_from_slice(&length.to_le_bytes());
            let result = decode(&bytes);
            if usize::from(length) == good.len() {
                assert_eq!(result, Ok(message));
            } else {
                let expected = u16::try_from(good.len()).unwrap();
                let error = FrameError::Length { code: kind.code(), found: length, expected };
                assert_eq!(result, Err(error));
            }
        }
    }
}

#[test]
fn optional_types_have_a_length_range() {
    for length in 0..=u16::MAX {
        let mut bytes = *b"VCMP\x01\x80\x00\x00";
        bytes[6..].copy_from_slice(&length.to_le_bytes());
        let result = frame::Header::parse(&bytes);
        if (12..=512).contains(&length) {
            assert_eq!(result.unwrap().unwrap().length, usize::from(length));
        } else {
            let error = FrameError::LengthRange { code: 0x80, found: length, min: 12, max: 512 };
            assert_eq!(result, Err(error));
        }
    }
}

#[test]
fn magic_is_judged_byte_by_byte() {
    assert_eq!(decode(b"GET / HTTP/1.1"), Err(FrameError::Magic { at: 0, found: b'G', expected: b'V' }));
    assert_eq!(decode(b"VCN"), Err(FrameError::Magic { at: 2, found: b'N', expected: b'M' }));
    assert_eq!(decode(b"VC"), Err(FrameError::Truncated { needed: 8, found: 2 }));
}

#[test]
fn versions_and_types_that_do_not_fit_are_refused() {
    let version = |code, found, expected| Err(FrameError::Version { code, found, expected });
    assert_eq!(decode(&frame_of(2, 0x10, &[0; 216])), version(0x10, 2, 1));
    assert_eq!(decode(&frame_of(0, 0x10, &[0; 216])), version(0x10, 0, 1));
    assert_eq!(decode(&frame_of(1, 0x01, &[0; 72])), version(0x01, 1, 0));
    // An unknown type of a later version is first of all of a later version.
    assert_eq!(decode(&frame_of(2, 0x20, &[])), version(0x20, 2, 1));
    assert_eq!(decode(&frame_of(2, 0x80, &[])), version(0x80, 2, 1));
    for code in [0x00, 0x05, 0x0f, 0x14, 0x7f, 0x80, 0xff] {
        assert_eq!(decode(&frame_of(1, code, &[1, 2, 3])), Err(FrameError::UnknownType { code }));
    }
}

#[test]
fn a_wrong_check_sum_tells_both() {
    let mut bytes = bytes_of(&examples()[6]);
    let sent = u32::from_le_bytes(bytes[24..].try_into().unwrap());
    bytes[24] ^= 1;
    assert_eq!(decode(&bytes), Err(FrameError::Crc { expected: sent, found: sent ^ 1 }));
}

#[test]
fn every_reserved_byte_must_be_zero() {
    let mut seen = 0;
    for kind in Kind::ALL {
        for &(_, at, size) in fields_of(kind).iter().filter(|f| f.0 == "reserved") {
            for offset in at..at + size {
                let result = broken(kind, |b| b[offset] = 0x40);
                assert_eq!(result, Err(FrameError::Reserved { offset, found: 0x40 }), "{kind:?}");
                seen += 1;
            }
        }
    }
    assert_eq!(seen, 6 + 6 + 7 + 3 + 2 + 2 + 4 + 4);
}

#[test]
fn axes_must_be_known_once_and_counted() {
    let hello = |edit: &dyn Fn(&mut Vec<u8>)| broken(Kind::ControlHello, |b| edit(b));
    for count in [0, 9, 255] {
        assert_eq!(hello(&|b| b[9] = count), Err(FrameError::AxisCount { found: count }));
    }
    assert_eq!(hello(&|b| b[90] = b'X'), Err(FrameError::AxisTwice { axis: AxisName::X }));
    assert_eq!(hello(&|b| b[94] = b'Y'), Err(FrameError::AxisTwice { axis: AxisName::Y }));
    let letter = |found| Err(FrameError::Value { field: "axis letter", found });
    assert_eq!(hello(&|b| b[88] = b'x'), letter(b'x'));
    assert_eq!(hello(&|b| b[94] = b'Q'), letter(b'Q'));
    assert_eq!(hello(&|b| b[94] = 0), letter(0));
    let unit = |found| Err(FrameError::Value { field: "axis unit", found });
    assert_eq!(hello(&|b| b[89] = 0), unit(0));
    assert_eq!(hello(&|b| b[95] = 3), unit(3));
    // Entries beyond the count are reserved.
    assert_eq!(hello(&|b| b[96] = b'A'), Err(FrameError::Reserved { offset: 96, found: b'A' }));
    assert_eq!(hello(&|b| b[103] = 1), Err(FrameError::Reserved { offset: 103, found: 1 }));
    assert_eq!(hello(&|b| b[9] = 3), Err(FrameError::Reserved { offset: 94, found: b'C' }));
}

#[test]
fn versions_in_hellos_are_checked() {
    for (min, max) in [(0, 1), (2, 1), (0, 0), (255, 254)] {
        let result = broken(Kind::DaemonHello, |b| b[8..10].copy_from_slice(&[min, max]));
        assert_eq!(result, Err(FrameError::VersionRange { min, max }));
    }
    let result = broken(Kind::ControlHello, |b| b[8] = 0);
    assert_eq!(result, Err(FrameError::Value { field: "chosen_version", found: 0 }));
}

#[test]
fn names_are_clean_text_padded_with_zeros() {
    let detail = |bytes: &[u8]| {
        broken(Kind::Error, |b| {
            b[16..48].fill(0);
            b[16..16 + bytes.len()].copy_from_slice(bytes);
        })
    };
    let name = |at, fault| Err(FrameError::Name { field: "detail", at, fault });
    assert_eq!(detail(b"ab\xff"), name(2, NameFault::NotUtf8));
    assert_eq!(detail(&[b'a', 0xc3]), name(1, NameFault::NotUtf8));
    assert_eq!(detail(b"a\nb"), name(1, NameFault::Control));
    assert_eq!(detail(b"a\x1b[31m"), name(1, NameFault::Control));
    assert_eq!(detail(b"\xc2\x9b31m"), name(0, NameFault::Control));
    assert_eq!(detail(b"ab\0c"), name(3, NameFault::AfterEnd));
    assert_eq!(detail(b"\0c"), name(1, NameFault::AfterEnd));
    let Ok(Message::Error(full)) = detail("Fräsmaschine Nummer sieben süd".as_bytes()) else {
        panic!("a name may fill all 32 bytes")
    };
    assert_eq!(full.detail.as_str(), "Fräsmaschine Nummer sieben süd");
    assert!(matches!(detail(b""), Ok(Message::Error(e)) if e.detail.as_str().is_empty()));
}

#[test]
fn codes_without_meaning_are_refused_in_a_correction_and_kept_in_errors() {
    for found in 8..=u8::MAX {
        let result = broken(Kind::Correction, |b| b[12] = found);
        assert_eq!(result, Err(FrameError::Value { field: "state", found }));
    }
    let Ok(Message::Error(error)) = broken(Kind::Error, |b| b[8] = 200) else { panic!("not readable") };
    assert_eq!(error.code, ErrorCode::Other(200));
    let Ok(Message::Close(close)) = broken(Kind::Close, |b| b[8] = 99) else { panic!("not readable") };
    assert_eq!(close.reason, CloseReason::Other(99));
}

#[test]
fn nan_and_undefined_state_bits_are_carried() {
    let Ok(Message::Position(p)) = broken(Kind::Position, |b| {
        b[12..14].copy_from_slice(&[0xff, 0xff]);
        b[32..40].copy_from_slice(&f64::NAN.to_le_bytes());
    }) else {
        panic!("the codec must not judge numbers")
    };
    assert!(p.commanded[0].is_nan());
    assert_eq!(p.state.bits, 0xffff);
}

#[test]
fn a_message_that_breaks_its_own_rule_is_packed_and_refused() {
    let Message::ControlHello(hello) = examples()[1] else { panic!("order of examples") };
    let bytes = bytes_of(&Message::ControlHello(ControlHello { axis_count: 200, ..hello }));
    assert_eq!(decode(&bytes), Err(FrameError::AxisCount { found: 200 }));
    let bytes = bytes_of(&Message::DaemonHello(DaemonHello::default()));
    assert_eq!(decode(&bytes), Err(FrameError::VersionRange { min: 0, max: 0 }));
}
