//! Every message survives packing and unpacking, bit for bit.

use super::*;

proptest! {
    #[test]
    fn any_message_survives(message in any_message()) {
        let bytes = bytes_of(&message);
        let back = decode(&bytes).unwrap();
        // NaN differs from itself, so equality is that of the bytes; and of the values where all are numbers.
        prop_assert_eq!(&bytes_of(&back), &bytes);
        let text = format!("{message:?}");
        prop_assert_eq!(format!("{back:?}"), text);
    }

    #[test]
    fn the_bits_of_every_float_survive(bits in proptest::array::uniform8(any::<u64>())) {
        let offset = bits.map(f64::from_bits);
        let message = Message::Correction(Correction { offset, ..Correction::default() });
        let Message::Correction(back) = decode(&bytes_of(&message)).unwrap() else { panic!("another type") };
        prop_assert_eq!(back.offset.map(f64::to_bits), bits);
    }

    #[test]
    fn names_cut_from_any_text_are_accepted(text in any::<String>()) {
        let name = Name::new(&text);
        prop_assert_eq!(Name::from_bytes(*name.bytes()), Ok(name));
    }

    #[test]
    fn accepted_names_read_back_as_text(bytes in proptest::array::uniform32(any::<u8>())) {
        if let Ok(name) = Name::from_bytes(bytes) {
            prop_assert_eq!(Name::new(name.as_str()), name);
        }
    }
}

#[test]
fn the_view_reads_a_literal_packet_without_copying() {
    // Packed by hand, with the check sum of another implementation.
    let bytes = *b"VCMP\x01\x12\x1c\x00\x07\x00\x00\x00\x00\x00\x00\x00\
        \x00\x59\x37\xd1\x02\x00\x00\x00\
        \xba\x04\x43\xdf";
    let frame = Frame::new_checked(bytes.as_slice()).unwrap();
    assert_eq!((frame.version(), frame.code(), frame.length()), (1, 0x12, 28));
    assert_eq!(frame.kind(), Some(Kind::Heartbeat));
    assert_eq!(frame.get(field::heartbeat::COUNT), 7);
    assert_eq!(frame.get(field::heartbeat::TIME_NS), 12_100_000_000);
    assert_eq!(frame.payload(), &bytes[8..24]);
    assert_eq!(frame.crc().to_le_bytes(), bytes[24..]);
    assert_eq!(frame.message(), Ok(examples()[6]));
    assert_eq!(bytes_of(&examples()[6]), bytes);
}

#[test]
fn a_view_of_a_longer_buffer_sees_its_own_frame_only() {
    let mut bytes = bytes_of(&examples()[3]);
    bytes.extend([0xff; 40]);
    let frame = Frame::new_checked(&bytes).unwrap();
    assert_eq!((frame.length(), frame.payload().len()), (16, 4));
    assert_eq!(decode(&bytes), Err(FrameError::Excess { length: 16, found: 56 }));
}

#[test]
fn accessors_of_an_unchecked_view_do_not_panic() {
    for length in 0..20 {
        let frame = Frame::new_unchecked(vec![0xff; length]);
        let _ = (frame.version(), frame.code(), frame.kind(), frame.length(), frame.crc());
        assert!(frame.payload().is_empty());
        assert!(frame.check_len().is_err());
    }
    let mut short = Frame::new_unchecked(vec![0_u8; 3]);
    short.start(Kind::Position);
    short.fill_crc();
}

#[test]
fn the_check_sum_is_crc_32c() {
    // Check value of the catalogue for "123456789".
    assert_eq!(crc32c::crc32c(b"123456789"), 0xe306_9283);
    // Computed here bit by bit, as the documentation describes it.
    for message in examples() {
        let bytes = bytes_of(&message);
        let (covered, sent) = bytes.split_at(bytes.len() - 4);
        let mut sum = u32::MAX;
        for &byte in covered {
            sum ^= u32::from(byte);
            for _ in 0..8 {
                sum = if sum & 1 == 1 { (sum >> 1) ^ 0x82f6_3b78 } else { sum >> 1 };
            }
        }
        assert_eq!((!sum).to_le_bytes(), sent, "{message:?}");
    }
}

#[test]
fn every_type_has_its_code_version_and_length() {
    for (kind, message) in Kind::ALL.into_iter().zip(examples()) {
        let bytes = bytes_of(&message);
        assert_eq!(Kind::from_code(bytes[5]), Some(kind));
        assert_eq!((bytes.len(), bytes[4]), (kind.length(), kind.version()), "{kind:?}");
        assert_eq!(decode(&bytes), Ok(message));
    }
    let known = (0..=u8::MAX).filter(|&c| Kind::from_code(c).is_some()).count();
    assert_eq!(known, Kind::ALL.len());
}

#[test]
fn codes_of_enums_are_one_to_one() {
    for code in 0..=u8::MAX {
        assert_eq!(CloseReason::from_code(code).code(), code);
        assert_eq!(ErrorCode::from_code(code).code(), code);
        assert_eq!(CorrectionState::from_code(code).map_or(code, CorrectionState::code), code);
        assert_eq!(AxisUnit::from_code(code).map_or(code, AxisUnit::code), code);
    }
    assert_eq!((0..=u8::MAX).filter(|&c| CorrectionState::from_code(c).is_some()).count(), 8);
}
