//! A table of hole places from a coordinate measuring machine: never a panic, only finite numbers, one hole per line.

#![no_main]
#![expect(clippy::disallowed_methods, reason = "the macro of libFuzzer reads its input file")]

use libfuzzer_sys::fuzz_target;
use volcomp::formats::Place;
use volcomp::formats::hole_plate::{parse, recognises};
use volcomp::formats::text::decode;

fuzz_target!(|data: &[u8]| {
    let decoded = decode(data);
    match parse(&decoded.text) {
        Ok(plate) => {
            assert!(!plate.holes.is_empty() && plate.holes.len() < decoded.text.lines().count());
            for hole in &plate.holes {
                let places = hole.place.nominal.iter().chain(&hole.place.measured);
                assert!(places.chain([&hole.diameter]).all(|v| v.is_finite()));
            }
        }
        Err(error) => {
            if let Place::Text { line, .. } = error.place {
                assert!(line <= decoded.text.lines().count());
            }
            drop(error.to_string());
        }
    }
    let _ = recognises(&decoded.text);
});
