//! An ISG volumetric table: never a panic, and what is accepted can be written and read again.

#![no_main]
#![expect(clippy::disallowed_methods, reason = "the macro of libFuzzer reads its input file")]

use libfuzzer_sys::fuzz_target;
use volcomp::formats::isg::{Body, parse, recognises, write};
use volcomp::formats::sample::Sampling;
use volcomp::formats::text::decode;
use volcomp::model::{Chain, ModelSpec};

fuzz_target!(|data: &[u8]| {
    let decoded = decode(data);
    let _ = recognises(&decoded.text);
    let chain = Chain::parse("[w X' C' b Y Z A t]").expect("a chain");
    match parse(&decoded.text, &chain, Some(Body::Carriage)) {
        Ok(tables) => {
            let mut spec = ModelSpec::new("m", chain.clone());
            spec.errors = tables.errors;
            let (text, _) = match write(&spec, &[], Some(Body::Carriage), &Sampling::default()) {
                Ok(written) => written,
                Err(error) => return drop(error.to_string()),
            };
            let back = parse(&text, &chain, Some(Body::Carriage)).map(|t| t.errors.len());
            // numbers closer than what is written fall together; nothing else may be lost
            if let Ok(count) = back {
                assert!(count >= spec.errors.len());
            }
        }
        Err(error) => drop(error.to_string()),
    }
});
