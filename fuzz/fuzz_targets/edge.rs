//! A SINUMERIK Edge capture: never a panic; time goes up, segments never down, rows have one value per signal.

#![no_main]
#![expect(clippy::disallowed_methods, reason = "the macro of libFuzzer reads its input file")]

use libfuzzer_sys::fuzz_target;
use volcomp::formats::edge::{Header, Row, Sink, read};

#[derive(Default)]
struct Check {
    signals: usize,
    last: Option<(f64, u32)>,
    rows: u64,
}

impl Sink for Check {
    fn header(&mut self, header: &Header) -> bool {
        self.signals = header.signals.len();
        true
    }
    fn row(&mut self, row: Row<'_>) -> bool {
        assert_eq!(row.values.len(), self.signals);
        if let Some((t_s, segment)) = self.last {
            assert!(row.t_s >= t_s && row.segment >= segment);
        }
        self.last = Some((row.t_s, row.segment));
        self.rows += 1;
        true
    }
}

fuzz_target!(|data: &[u8]| {
    let mut check = Check::default();
    match read(data, &mut check) {
        Ok(summary) => assert_eq!(summary.rows, check.rows),
        Err(error) => drop(error.to_string()),
    }
});
