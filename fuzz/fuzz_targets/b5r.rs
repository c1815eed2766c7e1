//! A ballbar's figures: never a panic, and only finite figures.

#![no_main]
#![expect(clippy::disallowed_methods, reason = "the macro of libFuzzer reads its input file")]

use libfuzzer_sys::fuzz_target;
use volcomp::formats::b5r::parse;
use volcomp::formats::text::decode;

fuzz_target!(|data: &[u8]| {
    match parse(&decode(data).text) {
        Ok(ballbar) => {
            assert!(ballbar.features.iter().all(|f| f.value.is_finite()) && !ballbar.features.is_empty())
        }
        Err(error) => drop(error.to_string()),
    }
});
