//! What comes back after a restart, and what does not.

use std::fs;

use super::*;
use crate::disk::real;

fn retained(off: bool, fault: Option<&str>) -> RetainedState {
    RetainedState { off, fault: fault.map(str::to_owned), ..RetainedState::default() }
}

#[test]
fn an_empty_directory_is_a_first_start_and_what_was_saved_is_known() {
    let dir = tempfile::tempdir().expect("directory");
    let disk = real();
    assert_eq!(recall(&*disk, dir.path(), "m"), Recalled::First);
    for name in NO_TRACES {
        fs::write(dir.path().join(name), "").expect("written");
    }
    assert_eq!(recall(&*disk, dir.path(), "m"), Recalled::First, "a lock is no trace");
    let mut counters = Counters::new("m");
    counters.retained = retained(true, Some("VC-4001"));
    counters.retained.fault_numbers = Some("x: 5.0000 um, limit 2.0000 um".to_owned());
    counters.save(&*disk, dir.path()).expect("saved");
    let Recalled::Known(found) = recall(&*disk, dir.path(), "m") else { panic!("known") };
    assert_eq!(found.retained, counters.retained);
    assert!(!found.since.is_empty() && found.saved >= found.since, "saved when: {:?}", found.saved);
}

#[test]
fn a_directory_with_traces_but_no_counters_is_unknown() {
    for trace in ["audit.jsonl", "models.json", "counters.json.tmp", "counters.json.damaged-x", "live.json"] {
        let dir = tempfile::tempdir().expect("directory");
        fs::write(dir.path().join(trace), "x").expect("written");
        let Recalled::Unknown(why) = recall(&*real(), dir.path(), "m") else { panic!("{trace}") };
        assert!(why.contains("is missing") && why.contains(trace), "{why}");
    }
    let missing = tempfile::tempdir().expect("directory").path().join("gone");
    assert!(matches!(recall(&*real(), &missing, "m"), Recalled::Unknown(_)));
}

#[test]
fn what_is_damaged_foreign_or_unreadable_is_unknown_and_kept_aside() {
    let dir = tempfile::tempdir().expect("directory");
    let disk = real();
    Counters::new("m").save(&*disk, dir.path()).expect("saved");
    let text = fs::read_to_string(dir.path().join(FILE)).expect("there");
    let cases = [
        ("EOF", text[..text.len() / 2].to_owned()),
        ("EOF", String::new()),
        ("expected value", "\0\0\0\0".to_owned()),
        ("below zero", text.replace("\"limited_s\": {}", "\"limited_s\": {\"x\": -1.0}")),
        ("of machine", text.replace("\"m\"", "\"n\"")),
        ("format is", text.replace("counters/1", "counters/2")),
        ("missing field `off`", text.replace("\"off\": false,", "")),
        ("missing field `fault`", text.replace("\"fault\": null,", "")),
        ("missing field `gain`", text.replace("\"gain\": null,", "")),
        ("unknown field", text.replace("\"hold\"", "\"hole\"")),
        ("unknown field", text.replace("\"fault\"", "\"fbult\"")),
        ("a gain", text.replace("\"gain\": null", "\"gain\": 1.5")),
        ("the limit is", " ".repeat(usize::try_from(BYTES_MAX).expect("fits")) + &text),
    ];
    for (why, bytes) in &cases {
        assert_ne!(bytes, &text, "{why}");
        fs::write(dir.path().join(FILE), bytes).expect("written");
        let Recalled::Unknown(found) = recall(&*disk, dir.path(), "m") else { panic!("{why}") };
        assert!(found.contains(why), "{why}: {found}");
        if !why.contains("limit") {
            assert!(found.contains("counters.json.damaged-") && !dir.path().join(FILE).exists(), "{found}");
        }
    }
    // a file without the keys of later versions is still read
    assert!(!text.contains("fault_numbers"), "{text}");
    let older = text.replace(",\n    \"hold\": null", "");
    assert_ne!(older, text);
    assert!(Counters::parse(older.as_bytes(), "m").is_ok());
}

#[test]
fn faults_holds_and_orders_object_in_this_order() {
    assert_eq!(retained(false, None).objection(), None);
    assert!(retained(true, None).objection().expect("off").contains("switched off"));
    let hold = RetainedState { hold: Some("state unknown: x".to_owned()), ..retained(true, None) };
    assert_eq!(hold.objection().expect("held"), "state unknown: x");
    let fault = RetainedState { fault: Some("VC-4001".to_owned()), ..hold };
    assert!(fault.objection().expect("latched").contains("VC-4001"));
}

#[test]
fn what_is_unknown_after_a_failed_save_is_what_was_there_before() {
    let dir = tempfile::tempdir().expect("directory");
    let disk = real();
    Counters::new("m").save(&*disk, dir.path()).expect("saved");
    // the temporary file cannot be written
    fs::create_dir(dir.path().join("counters.json.tmp")).expect("made");
    let mut other = Counters::new("m");
    other.retained = retained(true, None);
    assert!(other.save(&*disk, dir.path()).is_err());
    let Recalled::Known(found) = recall(&*disk, dir.path(), "m") else { panic!("known") };
    assert_eq!(found.retained, retained(false, None));
}
