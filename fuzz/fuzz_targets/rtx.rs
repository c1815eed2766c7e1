//! A Renishaw dynamic test: never a panic, and what is accepted writes and reads back the same.

#![no_main]
#![expect(clippy::disallowed_methods, reason = "the macro of libFuzzer reads its input file")]

use libfuzzer_sys::fuzz_target;
use volcomp::formats::ReadError;
use volcomp::formats::rtx::{Header, Samples, write};

fn read(data: &[u8]) -> Result<(Header, Vec<f64>), ReadError> {
    let mut samples = Samples::new(data)?;
    let mut all = Vec::new();
    while samples.read(&mut all)? {}
    Ok((samples.header().clone(), all))
}

fuzz_target!(|data: &[u8]| {
    match read(data) {
        Ok((header, samples)) => {
            assert_eq!(header.samples, samples.len() as u64);
            let mut bytes = Vec::new();
            write(&mut bytes, &header, &samples).expect("memory takes it");
            // a header that grows past its limit by being written is no failure of reading
            if let Ok((_, back)) = read(&bytes) {
                assert_eq!(back, samples);
            }
        }
        Err(error) => drop(error.to_string()),
    }
});
