//! A Renishaw laser test: never a panic, and what is accepted writes and reads back the same.

#![no_main]
#![expect(clippy::disallowed_methods, reason = "the macro of libFuzzer reads its input file")]

use libfuzzer_sys::fuzz_target;
use volcomp::formats::rtl::{DeviationUnit, parse, write};
use volcomp::formats::text::decode;

fuzz_target!(|data: &[u8]| {
    match parse(&decode(data).text) {
        Ok((rtl, _)) => {
            let (test, notes) = rtl.test(DeviationUnit::Um);
            assert!(test.readings.len() <= rtl.deviations.len());
            let _ = (notes, rtl.absent_sensors().count(), rtl.environment("Air temp"));
            let (back, _) = parse(&write(&rtl)).expect("what is written reads back");
            assert_eq!(
                (back.targets, back.deviations, back.run_count),
                (rtl.targets, rtl.deviations, rtl.run_count)
            );
        }
        Err(error) => drop(error.to_string()),
    }
});
