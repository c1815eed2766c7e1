//! The small text formats (`.dat`, `.pos`, camonitor) and the detection of all: never a panic.

#![no_main]
#![expect(clippy::disallowed_methods, reason = "the macro of libFuzzer reads its input file")]

use libfuzzer_sys::fuzz_target;
use volcomp::formats::camonitor::Log;
use volcomp::formats::text::decode;
use volcomp::formats::{api_pos, detect, iso230_dat};

fuzz_target!(|data: &[u8]| {
    let _ = detect::format(data);
    let decoded = decode(data);
    match iso230_dat::parse(&decoded.text) {
        Ok(test) => assert!(test.readings.iter().all(|r| r.position.is_finite() && r.value.is_finite())),
        Err(error) => drop(error.to_string()),
    }
    match api_pos::parse(&decoded.text) {
        Ok(means) => assert!(!means.test.readings.is_empty()),
        Err(error) => drop(error.to_string()),
    }
    let mut log = Log::new(data);
    while let Ok(true) = log.advance() {
        assert!(log.change().t_s.is_finite() && log.change().value.is_finite());
    }
});
