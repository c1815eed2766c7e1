//! Every write of the state directory, cut at every byte and without its data, followed by a restart: fail-closed.
//!
//! The writes are those that the crate really does, recorded by a disk in memory. A crash leaves the changes before it,
//! and of the last one any number of bytes; a rename may survive without the data of its file (zero length, or zeros).

#[path = "support/memory_disk.rs"]
mod memory_disk;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use volcomp_state::audit::chain::{AuditFile, verify};
use volcomp_state::audit::{AUDIT_FILE, AuditEntry, Who};
use volcomp_state::counters::{self, Counters, Recalled, RetainedState, recall};
use volcomp_state::disk::Disk;
use volcomp_state::models::{Choice, Store};

use memory_disk::{Change, MemoryDisk};

type Files = BTreeMap<PathBuf, Vec<u8>>;

/// The state directory.
fn directory() -> &'static Path {
    Path::new("/state")
}

fn apply(files: Files, change: Change) -> Files {
    let disk = MemoryDisk::with(files);
    disk.apply(change);
    disk.files()
}

/// What a crash in the middle of `change` may leave of `before`.
fn torn(before: &Files, change: &Change) -> Vec<Files> {
    match change {
        Change::Write(path, bytes) => (0..=bytes.len())
            .map(|k| apply(before.clone(), Change::Write(path.clone(), bytes[..k].to_vec())))
            .collect(),
        Change::Append(path, bytes) => (0..=bytes.len())
            .map(|k| apply(before.clone(), Change::Append(path.clone(), bytes[..k].to_vec())))
            .collect(),
        Change::Rename(..) | Change::Cut(..) => vec![before.clone()],
    }
}

/// What a crash right after `change` may leave although the change itself is durable.
fn without_data(after: &Files, change: &Change) -> Vec<Files> {
    let Change::Rename(_, to) = change else { return Vec::new() };
    let length = after[to].len();
    [0, length / 2, length]
        .into_iter()
        .map(|kept| {
            let mut files = after.clone();
            // the first bytes of a block that never reached the disk are zeros as well
            let bytes = if kept == 0 { Vec::new() } else { vec![0; kept] };
            files.insert(to.clone(), bytes);
            files
        })
        .collect()
}

/// Calls `check` with every state that a crash may leave, and the number of changes that were complete before it.
fn crashes(changes: &[Change], mut check: impl FnMut(usize, bool, Files)) -> usize {
    let (mut files, mut states) = (Files::new(), 0);
    for (done, change) in changes.iter().enumerate() {
        for left in torn(&files, change) {
            check(done, false, left);
            states += 1;
        }
        files = apply(files, change.clone());
        for left in without_data(&files, change) {
            check(done, true, left);
            states += 1;
        }
    }
    check(changes.len(), false, files);
    states + 1
}

#[test]
fn a_torn_counters_file_never_loses_an_order_or_a_fault() {
    let disk = MemoryDisk::new();
    let off = RetainedState { off: true, ..RetainedState::default() };
    let fault = RetainedState { fault: Some("VC-4001".to_owned()), ..RetainedState::default() };
    let words = [
        RetainedState::default(),
        off.clone(),
        RetainedState::default(),
        fault,
        off,
        RetainedState::default(),
    ];
    // the number of changes after which each word was answered as durable
    let mut durable = Vec::new();
    for retained in &words {
        let mut counters = Counters::new("m");
        counters.retained = retained.clone();
        counters.save(&disk, directory()).expect("saved");
        durable.push(disk.changes().len());
    }
    let changes = disk.changes();
    assert_eq!(changes.len(), 2 * words.len(), "a temporary file and a rename each");
    let states = crashes(&changes, |done, lost, files| {
        let newest = durable.iter().take_while(|after| **after <= done).count();
        let again = recall(&MemoryDisk::with(files.clone()), directory(), "m");
        match again {
            Recalled::First => {
                assert!(newest == 0 && files.is_empty(), "{done}: taken for a first start");
            }
            Recalled::Known(found) => {
                let known = newest.checked_sub(1).map(|k| &words[k]);
                let next = words.get(newest);
                let is = |retained: Option<&RetainedState>| retained == Some(&found.retained);
                assert!(!lost && (is(known) || is(next)), "{done}: {:?}", found.retained);
            }
            Recalled::Unknown(why) => assert!(!why.is_empty()),
        }
        if newest > 0 && !lost {
            let found = recall(&MemoryDisk::with(files), directory(), "m");
            assert!(matches!(found, Recalled::Known(_)), "{done}: a complete file is not lost: {found:?}");
        }
    });
    assert!(states > 1000, "{states} states");
}

#[test]
fn a_torn_store_names_the_old_model_the_new_one_or_none_and_never_a_wrong_text() {
    let disk = MemoryDisk::new();
    let choice = |text: &str| Choice {
        hash: blake3::hash(text.as_bytes()).to_hex().to_string(),
        origin: format!("{text}.toml"),
        since: "2026-11-21T00:00:00.000Z".to_owned(),
        who: None,
        why: None,
    };
    let texts = ["first model", "second model", "third model"];
    let (mut store, _) = Store::open(Arc::new(disk.clone()), directory(), "m");
    let mut durable = Vec::new();
    for text in texts {
        store.choose(choice(text), text, "0").expect("kept");
        durable.push(disk.changes().len());
    }
    store.swap(choice(texts[1])).expect("kept");
    durable.push(disk.changes().len());
    let active = [texts[0], texts[1], texts[2], texts[1]];
    let states = crashes(&disk.changes(), |done, lost, files| {
        let newest = durable.iter().take_while(|after| **after <= done).count();
        let (store, problem) = Store::open(Arc::new(MemoryDisk::with(files)), directory(), "m");
        let Some(found) = store.active() else {
            // a store that cannot be read says so; one that is missing is the caller's to judge
            assert!(problem.is_some() || newest == 0, "{done}: {lost}");
            return;
        };
        let known = newest.checked_sub(1).map(|k| active[k]);
        let expected = [known, active.get(newest).copied()];
        assert!(expected.iter().flatten().any(|text| choice(text) == *found), "{done}: {found:?}");
        match store.text(found) {
            Ok(text) => assert_eq!(choice(&text).hash, found.hash),
            // only where the file system has lost the data of a file that it had renamed
            Err(e) => assert!(lost, "{done}: {e}"),
        }
    });
    assert!(states > 1000, "{states} states");
}

#[test]
fn a_torn_audit_log_keeps_every_line_that_was_answered_or_is_set_aside_and_named() {
    let disk = MemoryDisk::new();
    let path = directory().join(AUDIT_FILE);
    let entry = |what: &str| AuditEntry {
        who: Who::default(),
        what: what.to_owned(),
        result: "ok".to_owned(),
        ..AuditEntry::default()
    };
    let (mut file, _) = AuditFile::open(Arc::new(disk.clone()), &path).expect("opens");
    let mut durable = Vec::new();
    for what in ["start", "enable", "disable"] {
        file.write(&entry(what)).expect("written");
        durable.push(disk.changes().len());
    }
    let states = crashes(&disk.changes(), |done, lost, files| {
        let newest = durable.iter().take_while(|after| **after <= done).count() as u64;
        let disk = MemoryDisk::with(files.clone());
        let (mut file, broken) = AuditFile::open(Arc::new(disk.clone()), &path).expect("opens");
        if broken.is_none() {
            let before = files.get(&path).map(Vec::as_slice).unwrap_or_default();
            assert!(!lost && verify(before).expect("intact").lines >= newest, "{done}");
        } else {
            let kept = disk.list(directory()).expect("listed");
            assert!(kept.iter().any(|name| name.contains("broken-")), "{done}: {kept:?}");
        }
        file.write(&entry("start")).expect("it goes on");
        let text = disk.files()[&path].clone();
        verify(&text).expect("what is written from now on is intact");
    });
    assert!(states > 500, "{states} states");
}

#[test]
fn a_directory_of_temporary_files_only_is_no_first_start() {
    for name in [counters::FILE, "models.json", "audit.head"] {
        let path = directory().join(format!("{name}.tmp"));
        for bytes in [Vec::new(), vec![0; 64], b"{".to_vec()] {
            let disk = MemoryDisk::with([(path.clone(), bytes)].into());
            assert!(matches!(recall(&disk, directory(), "m"), Recalled::Unknown(_)), "{name}");
        }
    }
}
