use super::*;
use crate::error::FormatErrorKind;
use crate::text::{Encoding, decode};
use proptest::prelude::*;

/// Rows of run 2 before those of run 1, a missed target, a negative target, sensors 2 and 3 absent.
const GOOD: &str = "HEADER::\r\nFile type  : rtl\r\nOwner      : Renishaw plc\r\nVersion no : 20.2\r\n\r\nTARGET DATA::\r\nFiletype  : ISO\r\nTarget-count: 3\r\nTargets :\r\n-50.000000  0.000000\r\n  50.000000\r\nFlags: 0 0 2 0\r\n\r\nUSER-TEXT::\r\nMachine: VMC 850\r\nSerial No:17:4\r\nDate: 12 Dec 2016\r\nBy:\r\nAxis: X\r\nLocation: hall\r\nTITLE: first\r\n\r\nRUNS::\r\nRun-count:4\r\n\r\nDEVIATIONS::\r\nRun Target Data:\r\n2 3 -1.500\r\n2 2 -0.250\r\n2 1 1.000\r\n1 1 0.000\r\n1 2 1.250\r\n1 3 2.500\r\n3 3 2.6\r\n3 1 0.1\r\n4 1 1.1\r\n4 2 -.2\r\n4 3 -1.4\r\n\r\nENVIRONMENT::\r\nAir temp   : 20.337280 20.384956 0\r\nAir press  : 99.039005 99.049346 1\r\nMat temp 1 : 20.203292 20.321342 0\r\nMat temp 2 : -10.000000 -10.000000 0\r\nMat temp 3 : -10.000000 -10.000000 0\r\nExp coeff  : 8.000000 8.000000 0\r\nDate Time  : \"10:46 Dec 12 2016\" \"11:01 Dec 12 2016\"\r\nEOF::\r\n";

fn readings(text: &str) -> Vec<(u32, Travel, f64, f64)> {
    let (test, _) = parse(text).unwrap().0.test(DeviationUnit::Um);
    test.readings.iter().map(|r| (r.cycle, r.travel, r.position, (r.value * 1e6).round() / 1e3)).collect()
}

#[test]
fn the_index_decides_not_the_order_of_rows() {
    let (rtl, notes) = parse(GOOD).unwrap();
    assert!(recognises(GOOD) && notes.is_empty());
    assert_eq!(rtl.targets, [-50.0, 0.0, 50.0]);
    assert_eq!((rtl.user("Axis"), rtl.user("Serial No"), rtl.user("By")), (Some("X"), Some("17:4"), None));
    let found = readings(GOOD);
    // the runs in their order, each along its travel
    assert_eq!(found[0], (1, Travel::Forward, -50.0, 0.0));
    assert_eq!(found[3], (1, Travel::Reverse, 50.0, -1.5));
    assert_eq!(found[8], (2, Travel::Reverse, 50.0, -1.4));
    assert_eq!(found[9], (2, Travel::Reverse, 0.0, -0.2));
    let lines = rtl.test(DeviationUnit::Um).0.lines;
    assert_eq!(lines, [31, 32, 33, 28, 29, 30, 35, 34, 38, 37, 36]);
    assert_eq!(rtl.test(DeviationUnit::Um).1, [Note::Missed { readings: 1 }]);
}

#[test]
fn the_environment_knows_absent_sensors() {
    let (rtl, _) = parse(GOOD).unwrap();
    assert_eq!(rtl.environment("Air temp"), Some(Span { start: 20.33728, end: 20.384956 }));
    assert_eq!(rtl.environment("Mat temp 2"), None);
    assert_eq!(rtl.absent_sensors().collect::<Vec<_>>(), ["Mat temp 2", "Mat temp 3"]);
    assert_eq!(rtl.environment("Exp coeff").unwrap().end, 8.0);
}

#[test]
fn the_duration_is_that_of_the_stamps() {
    let of = |from: &str, to: &str| parse(&GOOD.replace(from, to)).unwrap().0.duration_s();
    assert_eq!(of("", ""), Some(900.0));
    assert_eq!(of("11:01 Dec 12", "00:10 Dec 13"), Some(48_240.0));
    assert_eq!(of("11:01", "10:46"), None, "no time has passed");
    assert_eq!(of("Dec 12 2016", "sometime"), None);
    assert_eq!(of("Date Time", "Date"), None);
}

#[test]
fn sections_may_be_missing() {
    let cut = &GOOD[..GOOD.find("ENVIRONMENT::").unwrap()];
    // one reading was missed, so without anything behind the rows the file counts as cut
    let whole = cut.replace("3 3 2.6", "3 3 2.6\r\n3 2 1.3");
    let (rtl, notes) = parse(&whole).unwrap();
    assert_eq!(notes, [Note::NoEof]);
    assert_eq!(rtl.test(DeviationUnit::Um).1, [Note::NoEnvironment]);
    let e = parse(cut).unwrap_err();
    assert_eq!(e.kind, FormatErrorKind::Count { what: "readings", announced: 12, found: 11 });
    let no_runs = GOOD.replace("RUNS::\r\nRun-count:4\r\n", "");
    assert_eq!(parse(&no_runs).unwrap().0.run_count, 4);
}

/// Found by fuzzing: limits that come behind the rows were not held against them.
#[test]
fn sections_in_another_order() {
    let (head, rest) = GOOD.split_once("RUNS::").unwrap();
    let (_, rows) = rest.split_once("DEVIATIONS::").unwrap();
    let (rows, environment) = rows.split_once("ENVIRONMENT::").unwrap();
    let late = |count: u32| {
        format!("{head}DEVIATIONS::{rows}RUNS::\r\nRun-count:{count}\r\nENVIRONMENT::{environment}")
    };
    assert_eq!(parse(&late(4)).unwrap().0, parse(GOOD).unwrap().0);
    assert_eq!(parse(&late(3)).unwrap_err().to_string(), "33:1: a run is 4; it must be from 1 to 3");
    let targets_last = format!(
        "HEADER::\nDEVIATIONS::\nRun Target Data:\n1 1 0\n1 3 2\nTARGET DATA::\nTargets : {}\nEOF::\n",
        "0 10 20"
    );
    assert_eq!(parse(&targets_last).unwrap().0.deviations.len(), 2);
    let e = parse(&targets_last.replace(" 20", "")).unwrap_err().to_string();
    assert_eq!(e, "5:1: the index of a target is 3; it must be from 1 to 2");
}

#[test]
fn one_way_files() {
    let zeros = "TARGET DATA::\nTargets : 0 10\nFlags: 0 1 2 0\nRUNS::\nRun-count:4\nDEVIATIONS::\nRun Target Data:\n1 1 0\n1 2 3\n2 2 0\n2 1 0\n3 1 0.5\n3 2 2\n4 2 0\n4 1 0\nEOF::\n";
    let (test, notes) = parse(zeros).unwrap().0.test(DeviationUnit::Um);
    assert_eq!(notes[0], Note::EmptyReturns { runs: 2 });
    assert_eq!(test.readings.len(), 4);
    assert!(test.readings.iter().all(|r| r.travel == Travel::Forward));
    assert_eq!(readings(zeros).iter().map(|r| r.0).collect::<Vec<_>>(), [1, 1, 2, 2]);
    // the same without the flag: zeros alone in the returns say enough
    assert_eq!(readings(&zeros.replace("0 1 2 0", "0 0 2 0")).len(), 4);
    // a one-way file whose even runs hold readings
    let real = zeros.replace("2 2 0\n2 1 0", "2 2 1\n2 1 2").replace("4 2 0\n4 1 0", "4 2 1\n4 1 1");
    assert_eq!(readings(&real)[2..4], [(2, Travel::Forward, 0.0, 2.0), (2, Travel::Forward, 10.0, 1.0)]);
}

#[test]
fn targets_may_fall() {
    let falling = GOOD.replace("-50.000000  0.000000\r\n  50.000000", "50 0 -50");
    assert_eq!(readings(&falling)[0], (1, Travel::Reverse, 50.0, 0.0));
}

#[test]
fn rotary_units() {
    let (rtl, _) = parse(GOOD).unwrap();
    let (test, _) = rtl.test(DeviationUnit::Mrad);
    assert_eq!(test.kind, AxisKind::Rotary);
    assert!((test.readings[3].position - 50f64.to_radians()).abs() < 1e-15);
    assert!((test.readings[3].value + 1.5e-3).abs() < 1e-18);
    assert!((DeviationUnit::Arcsec.to_inner(3600.0) - 1f64.to_radians()).abs() < 1e-12);
    assert_eq!(DeviationUnit::Urad.to_inner(2.0), 2e-6);
}

#[test]
fn mistakes_name_their_place() {
    let fails = |from: &str, to: &str| parse(&GOOD.replace(from, to)).unwrap_err().to_string();
    assert!(fails("0.000000\r\n  50", "0.0x\r\n  50").starts_with("10:13: '0.0x' is not a finite number"));
    assert!(fails("2 2 -0.250", "2 2").starts_with("29:1: found '2 2', expected a row of three"));
    assert!(fails("2 2 -0.250", "2 2 nan").starts_with("29:5: 'nan' is not a finite number"));
    assert!(fails("2 2 -0.250", "2 4 -0.250").starts_with("29:3: the index of a target is 4; it must be"));
    assert!(fails("2 2 -0.250", "9 2 -0.250").starts_with("29:1: a run is 9; it must be from 1 to 4"));
    assert!(fails("2 2 -0.250", "2 3 -0.250").contains("run 2, target 3 was given before, on line 28"));
    assert!(fails("Target-count: 3", "Target-count: 4").starts_with("8:15: targets: 4 announced, 3 found"));
    assert!(fails("HEADER::", "HEAD").starts_with("1:1: found 'HEAD', expected HEADER::"));
    assert!(fails("Targets :", "Target :").contains("Targets :"));
    assert!(parse("").unwrap_err().to_string().contains("is this an .rtl file"));
    assert!(
        parse("HEADER::\nTARGET DATA::\nTargets : 0 1\nEOF::\n")
            .unwrap_err()
            .to_string()
            .contains("no readings")
    );
}

#[test]
fn every_encoding_gives_the_same_numbers() {
    for (machine, encoding) in [
        ("Fräse Größe 3", Encoding::Cp1252),
        ("střed č. 3, Łódź", Encoding::Cp1250),
        ("数控机床", Encoding::Gbk),
    ] {
        let bytes = encoding.encode(&GOOD.replace("VMC 850", machine)).unwrap();
        let text = decode(&bytes);
        let (rtl, _) = parse(&text.text).unwrap();
        assert_eq!((rtl.user("Machine"), text.encoding), (Some(machine), encoding));
        assert_eq!(rtl.deviations, parse(GOOD).unwrap().0.deviations);
    }
}

fn entries() -> impl Strategy<Value = Vec<Entry>> {
    let word = "[A-Za-z][A-Za-z0-9 ]{0,8}[a-z]";
    prop::collection::vec((word, "([a-zé0-9\"][a-zé0-9:.\"]{0,12})?"), 0..4)
        .prop_map(|v| v.into_iter().map(|(key, text)| Entry { key, text }).collect())
}

prop_compose! {
    fn any_file()(
        targets in prop::collection::vec(-1e4..1e4f64, 1..20),
        run_count in 1u32..6,
    )(
        mask in prop::collection::vec(prop::bool::weighted(0.9), targets.len() * run_count as usize),
        values in prop::collection::vec(-99.0..99.0f64, targets.len() * run_count as usize),
        targets in Just(targets),
        run_count in Just(run_count),
        header in entries(), user_text in entries(), environment in entries(), equipment in entries(),
        flags in prop::collection::vec(0i64..3, 0..5),
        filetype in "([A-Z]{1,4})?",
    ) -> Rtl {
        let mut deviations = Vec::new();
        let n = targets.len();
        for run in 0..run_count as usize {
            for k in 0..n {
                let target = if run % 2 == 1 { n - 1 - k } else { k };
                if mask[run * n + k] || (run == 0 && k == 0) {
                    deviations.push(Deviation { run: run as u32 + 1, target: target as u32 + 1, value: values[run * n + k], line: 0 });
                }
            }
        }
        Rtl { header, filetype, targets, flags, user_text, run_count, deviations, equipment, environment }
    }
}

proptest! {
    #[test]
    fn what_is_written_reads_back(file in any_file()) {
        let text = write(&file);
        let (back, _) = parse(&text).unwrap();
        prop_assert_eq!(&back, &file);
        prop_assert_eq!(write(&back), text);
    }

    /// Damage of any kind gives an answer or an error with a place, never a panic.
    #[test]
    fn damaged_files_never_panic(at in 0..GOOD.len(), with in prop::collection::vec(any::<u8>(), 0..6), cut in 0usize..9) {
        let mut bytes = GOOD.as_bytes().to_vec();
        let end = (at + cut).min(bytes.len());
        bytes.splice(at..end, with);
        if let Ok((rtl, _)) = parse(&decode(&bytes).text) {
            let _ = rtl.test(DeviationUnit::Um);
        }
    }
}
