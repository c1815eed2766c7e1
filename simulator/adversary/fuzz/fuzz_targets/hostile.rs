//! A hostile control against the real engine in simulated time: whatever it reports, no answer breaks an invariant.

#![no_main]
#![expect(clippy::disallowed_methods, reason = "the macro of libFuzzer reads its input file")]

use libfuzzer_sys::fuzz_target;

fuzz_target!(|script: &[u8]| {
    if let Some(outcome) = volcomp_adversary::run(script) {
        assert!(outcome.is_clean(), "{:#?}", outcome.report);
    }
});
