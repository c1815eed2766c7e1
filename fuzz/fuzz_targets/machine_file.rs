//! A machine file: never a panic, and every mistake can be shown.

#![no_main]
#![expect(clippy::disallowed_methods, reason = "the macro of libFuzzer reads its input file")]

use libfuzzer_sys::fuzz_target;
use volcomp::config::MachineConfig;

fuzz_target!(|data: &[u8]| {
    let Ok(text) = core::str::from_utf8(data) else { return };
    if let Err(errors) = MachineConfig::parse("m.toml", text) {
        drop(errors.to_string());
    }
});
