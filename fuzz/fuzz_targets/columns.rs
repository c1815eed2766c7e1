//! Any table through any map: the bytes are the map, a line `---`, and the table. Never a panic, only finite numbers.

#![no_main]
#![expect(clippy::disallowed_methods, reason = "the macro of libFuzzer reads its input file")]

use libfuzzer_sys::fuzz_target;
use volcomp::formats::columns::{ColumnMap, Columns, Runs};
use volcomp::formats::text::decode;

fuzz_target!(|data: &[u8]| {
    let cut = data.windows(5).position(|w| w == b"\n---\n").unwrap_or(data.len());
    let table = data.get(cut + 5..).unwrap_or(b"");
    let map = match ColumnMap::from_toml(&decode(&data[..cut]).text) {
        Ok(map) => map,
        Err(error) => return drop(error.to_string()),
    };
    if let Err(error) = map.check() {
        drop(error.to_string());
    }
    let outputs = map.columns.len();
    let Ok(mut columns) = Columns::new(table, map) else { return };
    let (mut runs, mut pushed, mut placed) = (Runs::default(), 0u64, 0u64);
    loop {
        match columns.advance() {
            Ok(true) => {
                assert_eq!(columns.values().len(), outputs);
                if let [first, ..] = columns.values() {
                    placed += u64::from(runs.push(*first, 0.0, None, None).is_some());
                    pushed += 1;
                }
            }
            Ok(false) => break,
            Err(error) => {
                drop(error.to_string());
                break;
            }
        }
    }
    placed += u64::from(runs.finish().is_some());
    assert_eq!(placed, pushed);
});
