//! A model file: never a panic; what is accepted is written and read back as the same model.

#![no_main]
#![expect(clippy::disallowed_methods, reason = "the macro of libFuzzer reads its input file")]

use libfuzzer_sys::fuzz_target;
use volcomp::config;
use volcomp::model::Model;

fuzz_target!(|data: &[u8]| {
    let Ok(text) = core::str::from_utf8(data) else { return };
    let _ = config::kind_of_file("m.toml", text);
    match config::model::parse_file("m.toml", text) {
        Ok(model) => {
            let again = config::model::write_file(&model, &[]);
            let back = config::model::parse_file("m.toml", &again).map_err(|e| e.to_string());
            assert_eq!(back.expect("what is written reads back").spec.errors.len(), model.spec.errors.len());
            let _ = Model::new(&model.spec);
        }
        Err(errors) => drop(errors.to_string()),
    }
});
