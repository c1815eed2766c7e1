//! Damaged recordings: `volcomp replay` compares what is there, and never says that all is the same.

#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "a test program: it fails by panicking")]

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::time::Duration;

use crate::support::{Daemon, Port, Session, Setup, eventually};
use rustix::process::Signal;
use serde_json::Value;
use volcomp::protocol::record::block::{BLOCK_HEADER, FILE_HEADER, Found, look, seal};
use volcomp::protocol::record::{BlockKind, EXTENSION};

const KEPT: &str = "[recording]\ndirectory = \"rec\"\nflush-ms = 20.0\n[state]\ndirectory = \"state\"\n";

fn work(session: &mut Session, cycles: u32) {
    for _ in 0..cycles {
        session.program += 1;
        let k = session.program;
        session.commanded[0] = 50.0 * (f64::from(k) * 5e-3).sin();
        let _ = session.cycle();
        if k.is_multiple_of(20) {
            // no faster than 4 kHz: a slow disk must not cost records here
            std::thread::sleep(Duration::from_millis(5));
        }
    }
}

/// The bytes of a recording with two models and at least eight blocks of entries.
fn recorded() -> Vec<u8> {
    let port = Port::open();
    let mut daemon = Daemon::start(&port.address(), Setup { more: KEPT, ..Setup::default() });
    let mut session = port.link();
    session.run_until_corrected();
    let folder = daemon.dir.path().join("rec");
    let file = || -> Option<PathBuf> {
        let entries = fs::read_dir(&folder).ok()?.filter_map(Result::ok).map(|e| e.path());
        entries.filter(|p| p.extension().is_some_and(|e| e == EXTENSION)).min()
    };
    // the folder and the file appear with the first block
    let blocks = || file().map_or(0, |file| entries(&fs::read(file).unwrap_or_default()).len());
    assert!(eventually(|| {
        work(&mut session, 100);
        blocks() >= 4
    }));
    let model = daemon.dir.path().join("second.toml");
    fs::write(
        &model,
        "format = \"volcomp-model/1\"\nmachine = \"test-mill\"\nchain = \"[w X' b Y Z t]\"\n\
         [axes.x]\ntravel-mm = [-100, 400]\n[errors.exx.constant]\nvalue-um = 14\n",
    )
    .expect("written");
    let arguments = ["load", model.to_str().expect("text"), "--reason", "test"];
    let loaded = std::thread::scope(|scope| {
        let order = scope.spawn(|| daemon.volcomp(&arguments));
        while !order.is_finished() {
            work(&mut session, 10);
        }
        order.join().expect("the order")
    });
    assert!(loaded.status.success(), "{}", String::from_utf8_lossy(&loaded.stderr));
    assert!(eventually(|| {
        work(&mut session, 100);
        blocks() >= 8
    }));
    session.close();
    daemon.signal(Signal::TERM);
    assert!(daemon.wait().success());
    fs::read(file().expect("a recording")).expect("there")
}

/// Every whole block: kind, place and length.
fn blocks(bytes: &[u8]) -> Vec<(BlockKind, usize, usize)> {
    let (mut at, mut found) = (FILE_HEADER, Vec::new());
    while let Some(Found::Block(block, length)) = bytes.get(at..).map(look) {
        found.push((block.kind, at, length));
        at += length;
    }
    found
}

/// Place and length of every block of entries.
fn entries(bytes: &[u8]) -> Vec<(usize, usize)> {
    let of = blocks(bytes).into_iter().filter(|(kind, _, _)| *kind == BlockKind::Entries);
    of.map(|(_, at, length)| (at, length)).collect()
}

fn run(path: &Path, more: &[&str]) -> Output {
    let volcomp = env!("CARGO_BIN_EXE_volcomp");
    Command::new(volcomp).arg("replay").arg(path).args(more).output().expect("volcomp runs")
}

#[test]
fn damage_is_told_with_what_was_not_replayed() {
    let whole = recorded();
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("r.vcrec");
    let replay = |bytes: &[u8]| {
        fs::write(&path, bytes).expect("written");
        let json = run(&path, &["--json"]);
        let text = run(&path, &[]);
        assert_eq!(json.status.code(), text.status.code());
        let report: Value = serde_json::from_slice(&json.stdout).expect("JSON");
        let said = String::from_utf8_lossy(&text.stdout) + String::from_utf8_lossy(&text.stderr);
        (text.status.code(), report, said.into_owned())
    };
    let (code, report, said) = replay(&whole);
    assert_eq!((code, &report["complete"]), (Some(0), &Value::from(true)), "{said}");

    let list = entries(&whole);
    let (middle, last) = (list[list.len() / 2], list[list.len() - 1]);
    let flipped = |at: usize| {
        let mut bytes = whole.clone();
        bytes[at] ^= 0x10;
        bytes
    };
    let without = |(at, length): (usize, usize)| [&whole[..at], &whole[at + length..]].concat();
    // how live estimation went is no input of the engine: one damaged report of it costs nothing
    let mut report = seal(BlockKind::Health, 0, 0, 1, b"{\"sensors\": []}").expect("a block");
    report[BLOCK_HEADER + 2] ^= 1;
    let (code, report, said) = replay(&[&whole[..middle.0], &report, &whole[middle.0..]].concat());
    assert_eq!((code, &report["complete"]), (Some(0), &Value::from(true)), "{said}");
    assert!(said.contains("a report of live estimation is damaged"), "{said}");
    let health = "1 record";
    assert!(!said.contains(health));
    for (what, bytes, parts) in [
        (
            "content of a block",
            flipped(middle.0 + BLOCK_HEADER + 5),
            &["not replayed", " before record ", " s to "][..],
        ),
        ("header of a block", flipped(middle.0 + 9), &["not replayed", "are not a block", " s to "]),
        ("a block is gone", without(middle), &["not replayed", " before record ", " s to "]),
        (
            "content of the last block",
            flipped(last.0 + BLOCK_HEADER + 5),
            &["not replayed", " at the end of ", " s on"],
        ),
        ("the last block is gone", without(last), &["not replayed", " at the end of ", " s on"]),
        ("cut in a block", whole[..last.0 + 60].to_vec(), &["not replayed", "torn", " at the end of "]),
        (
            "cut between blocks",
            whole[..last.0].to_vec(),
            &["not replayed", "was not closed", " at the end of "],
        ),
    ] {
        let (code, report, said) = replay(&bytes);
        assert_eq!(code, Some(2), "{what}: {said}");
        assert_eq!(report["differing"], 0, "{what}: {report}");
        assert_eq!(report["complete"], false, "{what}: {report}");
        let missing = &report["missing"][0];
        assert!(missing["from_s"].is_f64(), "{what}: {report}");
        if !what.starts_with("cut") {
            assert!(missing["records"].as_u64() > Some(0), "{what}: {report}");
        }
        for part in parts {
            assert!(said.contains(part), "{what}: no {part:?} in\n{said}");
        }
        assert!(said.contains("error: not everything could be replayed"), "{said}");
    }
}

#[test]
fn a_later_model_never_stands_for_the_first_one() {
    let whole = recorded();
    let models: Vec<_> =
        blocks(&whole).into_iter().filter(|(kind, _, _)| *kind == BlockKind::Model).collect();
    assert_eq!(models.len(), 2);
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("r.vcrec");
    let (_, at, length) = models[0];
    let mut damaged = whole.clone();
    damaged[at + length - 3] ^= 1;
    for bytes in [damaged, [&whole[..at], &whole[at + length..]].concat()] {
        fs::write(&path, &bytes).expect("written");
        let output = run(&path, &[]);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(65), "{said}");
        assert!(said.contains("the model of its beginning") && said.contains("(blake3 "), "{said}");
        assert!(said.contains("hint: name that file with --model"), "{said}");
        assert!(output.stdout.is_empty());
    }
    // the later one is missing: what needs it is not replayed, and that is told
    let (_, at, length) = models[1];
    fs::write(&path, [&whole[..at], &whole[at + length..]].concat()).expect("written");
    let output = run(&path, &[]);
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.contains("a model that is in none of the files (blake3 "), "{said}");
}
