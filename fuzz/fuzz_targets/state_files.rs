//! What others can write for volcompd: a line on the status socket, the files of the state directory. Never a panic; a
//! request that is understood is written and read back to the same.

#![no_main]
#![expect(clippy::disallowed_methods, reason = "the macro of libFuzzer reads its input file")]

use libfuzzer_sys::fuzz_target;
use volcomp::daemon::socket::Ask;
use volcomp::daemon::{audit, state_validation};

fuzz_target!(|data: &[u8]| {
    let Some((kind, text)) = data.split_first() else { return };
    match kind % 4 {
        0 => request(text),
        1 => {
            let _ = state_validation::counters(text, "m");
        }
        2 => {
            let _ = state_validation::models(text, "m");
        }
        _ => log(text),
    }
});

fn request(text: &[u8]) {
    let Ok(ask) = serde_json::from_slice::<Ask>(text) else { return };
    let again = serde_json::to_string(&ask).expect("written");
    assert_eq!(serde_json::from_str::<Ask>(&again).expect("read back"), ask);
}

/// A log that is whole has as many lines as it says; one that is not names a line that exists or the one after.
fn log(text: &[u8]) {
    let lines = text.split_inclusive(|b| *b == b'\n').count() as u64;
    match audit::verify(text) {
        Ok(summary) => assert_eq!(summary.lines, lines),
        Err(broken) => {
            assert!((1..=lines + 1).contains(&broken.line), "{broken:?}");
            let _ = broken.fault.to_string();
        }
    }
}
