//! What a real `volcompd` leaves on the disk: recordings, counters, audit log; and what the tools make of them.

#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "a test program: it fails by panicking")]

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use crate::support::{Daemon, Port, Session, Setup, eventually};
use rustix::process::Signal;
use volcomp::protocol::record::{EXTENSION, Recording};

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// `[recording]` and `[state]` beside the machine file.
fn kept(more: &'static str) -> Setup {
    Setup { more, ..Setup::default() }
}

const KEPT: &str = "[recording]\ndirectory = \"rec\"\nflush-ms = 50.0\n[state]\ndirectory = \"state\"\n";

fn volcomp(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_volcomp")).args(arguments).output().expect("volcomp runs")
}

fn ok(output: &Output) -> String {
    assert!(output.status.success(), "{}{}", text(&output.stdout), text(&output.stderr));
    text(&output.stdout)
}

/// Recordings of a daemon, oldest first.
fn recordings(daemon: &Daemon) -> Vec<PathBuf> {
    recordings_in(&daemon.dir.path().join("rec"))
}

fn recordings_in(folder: &Path) -> Vec<PathBuf> {
    let Ok(folder) = fs::read_dir(folder) else { return Vec::new() };
    let mut found: Vec<PathBuf> = folder
        .filter_map(Result::ok)
        .map(|e| e.path())
        .filter(|p| p.extension().is_some_and(|e| e == EXTENSION))
        .collect();
    found.sort();
    found
}

fn name(path: &Path) -> &str {
    path.to_str().expect("a path that is text")
}

/// Moves X to and fro while it cycles.
fn work(session: &mut Session, cycles: u32) {
    for _ in 0..cycles {
        session.program += 1;
        let k = session.program;
        session.commanded[0] = 50.0 * (f64::from(k) * 5e-3).sin();
        session.commanded[1] = f64::from(32 - (k % 64).abs_diff(32)) * 0.125;
        let _ = session.cycle();
    }
}

fn replay(files: &[PathBuf], more: &[&str]) -> (Option<i32>, serde_json::Value, String) {
    let mut arguments = vec!["replay", "--json"];
    arguments.extend(files.iter().map(|f| name(f)));
    arguments.extend(more);
    let output = volcomp(&arguments);
    let json = serde_json::from_slice(&output.stdout).unwrap_or_default();
    (output.status.code(), json, text(&output.stderr))
}

#[test]
fn what_was_recorded_replays_bit_for_bit_and_exports() {
    let port = Port::open();
    let mut daemon = Daemon::start(&port.address(), kept(KEPT));
    let mut session = port.link();
    session.run_until_corrected();
    work(&mut session, 1500);
    let status = daemon.status();
    assert_eq!(status["recording"]["error"], serde_json::Value::Null, "{status}");
    assert!(eventually(|| daemon.status()["recording"]["records"].as_u64() > Some(1000)));
    session.close();
    daemon.signal(Signal::TERM);
    assert!(daemon.wait().success());
    let files = recordings(&daemon);
    assert_eq!(files.len(), 1);

    // the recording stands alone: model and machine file are inside
    let (code, report, stderr) = replay(&files, &[]);
    assert_eq!(code, Some(0), "{report} {stderr}");
    assert!(report["compared"].as_u64() > Some(1500) && report["compared"] == report["cycles"], "{report}");
    assert_eq!((&report["gaps"], &report["notes"]), (&serde_json::json!([]), &serde_json::json!([])));
    let model = daemon.dir.path().join("model.toml");
    let config = daemon.dir.path().join("machine.toml");
    let (code, _, stderr) = replay(&files, &["--model", name(&model), "--config", name(&config)]);
    assert_eq!((code, stderr.as_str()), (Some(0), ""));

    // another model is told, with the cycle and both values
    let other = daemon.dir.path().join("other.toml");
    fs::write(&other, fs::read_to_string(&model).expect("model").replace("10.0", "10.5")).expect("written");
    let (code, report, stderr) = replay(&files, &["--model", name(&other)]);
    assert_eq!(code, Some(1), "{stderr}");
    assert!(stderr.contains("is not the model of the recording") && stderr.contains("differ"), "{stderr}");
    let first = &report["differences"][0];
    assert!(first["sequence"].is_u64() && first["recorded"] != first["replayed"], "{first}");

    exports_agree(&daemon, &files[0]);
    empty_selections_are_refused(&daemon, &files[0]);
}

/// An export that selects nothing is an error, and makes no file.
fn empty_selections_are_refused(daemon: &Daemon, file: &Path) {
    let out = daemon.dir.path().join("nothing");
    for format in ["csv", "parquet"] {
        for (range, code, said) in [
            (["5", "1"], 64, "--from-s 5 is behind --to-s 1"),
            (["1e6", "2e6"], 65, "no row selected; the cycles are between 0 s and"),
            (["-9", "-1"], 65, "no row selected"),
        ] {
            let [from, to] = range;
            let from_to = [&format!("--from-s={from}"), &format!("--to-s={to}")];
            let words = ["export", name(file), "--to", format, "--out", name(&out), from_to[0], from_to[1]];
            let output = volcomp(&words);
            assert_eq!(output.status.code(), Some(code), "{}", text(&output.stderr));
            assert!(text(&output.stderr).contains(said), "{}", text(&output.stderr));
            assert!(!out.exists(), "{words:?}");
        }
    }
}

/// EXX = `um` everywhere, for the machine of these tests.
fn constant_model(daemon: &Daemon, name: &str, um: f64) -> String {
    let path = daemon.dir.path().join(name);
    let text = format!(
        "format = \"volcomp-model/1\"\nmachine = \"test-mill\"\nchain = \"[w X' b Y Z t]\"\n\
         [axes.x]\ntravel-mm = [0, 400]\n[errors.exx.constant]\nvalue-um = {um}\n"
    );
    fs::write(&path, text).expect("written");
    path.display().to_string()
}

/// Gives an order while the machine goes on.
fn order_while_working(session: &mut Session, daemon: &Daemon, arguments: &[&str]) {
    std::thread::scope(|scope| {
        let order = scope.spawn(|| daemon.volcomp(arguments));
        while !order.is_finished() {
            work(session, 10);
        }
        let _ = ok(&order.join().expect("the order"));
    });
    work(session, 500);
}

#[test]
fn models_loaded_and_rolled_back_stand_in_the_recording_and_replay() {
    let port = Port::open();
    // the hello waits for the load, however long a busy disk keeps that
    let setup = Setup { connect_timeout_s: 60.0, ..kept(KEPT) };
    let mut daemon = Daemon::start(&port.address(), setup);
    // before there is an engine
    let _ = daemon.status();
    let first = constant_model(&daemon, "first.toml", 20.0);
    let _ = ok(&daemon.volcomp(&["load", &first, "--reason", "test"]));
    let mut session = port.link();
    work(&mut session, 500);
    let second = constant_model(&daemon, "second.toml", 35.0);
    order_while_working(&mut session, &daemon, &["load", &second, "--reason", "test"]);
    order_while_working(&mut session, &daemon, &["gain", "0.5"]);
    order_while_working(&mut session, &daemon, &["rollback", "--reason", "test"]);
    session.close();
    daemon.signal(Signal::TERM);
    assert!(daemon.wait().success());
    let files = recordings(&daemon);
    let bytes = fs::read(&files[0]).expect("there");
    let found = Recording::parse(&bytes).expect("a recording").models;
    assert_eq!(found.len(), 3, "the one that the first engine was made with, then each switch");
    assert!(found[0].1.contains("= 20") && found[1].1.contains("= 35") && found[2] == found[0]);
    let (code, report, stderr) = replay(&files, &[]);
    let whole = report["gaps"].as_array().is_some_and(Vec::is_empty);
    assert_eq!(code, Some(if whole { 0 } else { 2 }), "{report} {stderr}");
    // a disk that a busy computer keeps waiting costs records, and the engine catches up behind the gap
    let caught_up: u64 = report["gaps"]
        .as_array()
        .expect("a list")
        .iter()
        .filter_map(|g| g["caught_up_cycles"].as_u64())
        .sum();
    let compared = report["compared"].as_u64().expect("a number");
    assert!(compared > 2000 && Some(compared + caught_up) == report["cycles"].as_u64(), "{report}");
    assert_eq!(report["differing"], 0, "{report}");

    // the model that was in use last is the one that the next recording begins with
    daemon.restart();
    let mut session = port.link();
    work(&mut session, 1000);
    session.close();
    daemon.signal(Signal::TERM);
    assert!(daemon.wait().success());
    let files = recordings(&daemon);
    let bytes = fs::read(&files[1]).expect("there");
    let found = Recording::parse(&bytes).expect("a recording");
    assert!(
        found.models[0].1.contains("= 20") && found.meta.model.ends_with("first.toml"),
        "{:?}",
        found.meta
    );
    let (code, report, stderr) = replay(&files[1..], &[]);
    assert_eq!(code, Some(0), "{report} {stderr}");
}

/// CSV and Parquet say the same, with the columns of sessions and histories.
fn exports_agree(daemon: &Daemon, file: &Path) {
    use parquet::file::reader::{FileReader, SerializedFileReader};

    let (csv, packed) = (daemon.dir.path().join("out.csv"), daemon.dir.path().join("out.parquet"));
    for (format, out) in [("csv", &csv), ("parquet", &packed)] {
        let done = volcomp(&["export", name(file), "--to", format, "--out", name(out)]);
        let _ = ok(&done);
        assert!(text(&done.stderr).contains("deviation_um is empty"), "{}", text(&done.stderr));
    }
    let table = fs::read_to_string(&csv).expect("csv");
    let header: Vec<&str> = table.lines().next().expect("header").split(',').collect();
    for column in [
        "t_s",
        "instrument",
        "setup",
        "run",
        "repeat",
        "x_mm",
        "y_mm",
        "z_mm",
        "u_x",
        "u_y",
        "u_z",
        "deviation_um",
        "vx_mm_per_s",
        "dir_x",
        "since_reversal_x_mm",
        "since_reversal_x_s",
        "moving",
        "actual_x_mm",
        "offset_x_um",
        "applied_x_um",
        "wanted_x_um",
        "limited_x",
        "faded_x",
        "state",
        "cause",
        "lag_cycles",
        "feed_mm_per_min",
        "sequence",
    ] {
        assert!(header.contains(&column), "no {column} in {header:?}");
    }
    let at = |name: &str| header.iter().position(|c| *c == name).expect("column");
    let rows: Vec<Vec<&str>> = table.lines().skip(1).map(|l| l.split(',').collect()).collect();
    assert!(rows.len() > 1500);
    let last = rows.last().expect("rows");
    assert_eq!((last[at("deviation_um")], last[at("state")]), ("", "active"));
    assert!((last[at("offset_x_um")].parse::<f64>().expect("number") + 10.0).abs() < 1e-9);
    assert_eq!(last[at("wanted_x_um")], last[at("offset_x_um")], "active and not limited");
    let causes: Vec<&str> =
        rows.iter().map(|row| row[at("cause")]).filter(|cause| !cause.is_empty()).collect();
    assert_eq!(causes, ["machine-ready", "ramp-done"]);
    assert_eq!((rows[0][at("lag_cycles")], last[at("lag_cycles")]), ("", "1"));
    let number = |row: &Vec<&str>, name: &str| row[at(name)].parse::<f64>().unwrap_or(f64::NAN);
    for pair in rows[1000..].windows(2) {
        let dt = number(&pair[1], "t_s") - number(&pair[0], "t_s");
        assert!((dt - 1e-3).abs() < 1e-9, "time of the control: {dt}");
        let v = (number(&pair[1], "x_mm") - number(&pair[0], "x_mm")) / dt;
        assert!((number(&pair[1], "vx_mm_per_s") - v).abs() < 1e-6);
        if v.abs() > 5.0 {
            assert_eq!(number(&pair[1], "dir_x"), v.signum());
        }
    }

    let reader =
        SerializedFileReader::new(fs::File::open(&packed).expect("parquet")).expect("a Parquet file");
    let about = reader.metadata().file_metadata();
    assert_eq!(about.num_rows(), rows.len() as i64);
    let keys = about.key_value_metadata().expect("about");
    assert!(keys.iter().any(|kv| kv.key == "volcomp.machine" && kv.value.as_deref() == Some("test-mill")));
    for (row, expected) in reader.get_row_iter(None).expect("rows").zip(&rows) {
        for (name, field) in row.expect("row").get_column_iter() {
            use parquet::record::Field;
            let found = match field {
                Field::Null => String::new(),
                Field::Double(v) => v.to_string(),
                Field::Long(v) => v.to_string(),
                Field::Str(v) => v.clone(),
                other => panic!("{name}: {other:?}"),
            };
            assert_eq!(found, expected[at(name)], "{name}");
        }
    }
}

#[test]
fn killed_in_full_work_it_loses_less_than_a_second_and_nothing_that_was_there() {
    let port = Port::open();
    let mut daemon = Daemon::start(&port.address(), kept(KEPT));
    let mut session = port.link();
    session.run_until_corrected();
    work(&mut session, 1000);
    let mut safe = Some(1000);
    for _ in 0..2 {
        // two blocks at least
        let mut records = None;
        assert!(eventually(|| {
            work(&mut session, 10);
            records = daemon.status()["recording"]["records"].as_u64();
            records > safe
        }));
        safe = records;
    }
    daemon.signal(Signal::KILL);
    let _ = daemon.wait();
    let files = recordings(&daemon);
    // all that is there is the same, and that the end may be missing is told
    let (code, report, stderr) = replay(&files, &[]);
    assert_eq!((code, &report["complete"]), (Some(2), &serde_json::json!(false)), "{report}");
    assert!(stderr.contains("it was not closed"), "{stderr}");
    assert!(report["records"].as_u64() >= safe, "{report}");
    // torn as a power loss would tear it: everything before the last block is as good as ever
    let bytes = fs::read(&files[0]).expect("recording");
    fs::write(&files[0], &bytes[..bytes.len() - 7]).expect("written");
    let (code, report, stderr) = replay(&files, &[]);
    assert_eq!((code, &report["damaged"]), (Some(2), &serde_json::json!(1)), "{report}");
    assert!(stderr.contains("the last block is torn"), "{stderr}");
    // a new daemon begins a new file and touches the old one not
    let before = fs::read(&files[0]).expect("recording");
    daemon.restart();
    let mut session = port.link();
    for _ in 0..200 {
        let _ = session.cycle();
    }
    assert!(eventually(|| recordings(&daemon).len() == 2));
    assert_eq!(fs::read(&files[0]).expect("recording"), before);
}

#[test]
fn files_of_one_run_continue_each_other() {
    let port = Port::open();
    let setup = kept("[recording]\ndirectory = \"rec\"\nflush-ms = 20.0\nfile-max-s = 1.0\n");
    let mut daemon = Daemon::start(&port.address(), setup);
    let mut session = port.link();
    session.run_until_corrected();
    assert!(eventually(|| {
        work(&mut session, 50);
        recordings(&daemon).len() >= 2
    }));
    work(&mut session, 1000);
    session.close();
    daemon.signal(Signal::TERM);
    assert!(daemon.wait().success());
    let mut files = recordings(&daemon);
    files.reverse();
    let (code, report, stderr) = replay(&files, &[]);
    assert_eq!((code, &report["gaps"]), (Some(0), &serde_json::json!([])), "{report} {stderr}");
    assert_eq!(report["compared"], report["cycles"]);
    // the newest one alone begins in the middle of things: it says so, and catches up
    let (code, report, _) = replay(&files[..1], &[]);
    assert_eq!(report["gaps"].as_array().map(Vec::len), Some(1), "{report}");
    let nothing = report["compared"] == 0;
    assert_eq!(code, Some(if nothing { 65 } else { 2 }), "{report}");
    assert_eq!(report["differing"], 0);
}

#[test]
fn a_disk_without_room_costs_records_and_never_a_cycle() {
    let port = Port::open();
    // a file where the folder should be: every attempt to write fails until it is gone
    let place = tempfile::tempdir().expect("directory");
    let way = place.path().join("rec");
    fs::write(&way, "in the way").expect("written");
    let more = KEPT.replace("\"rec\"", &format!("{:?}", name(&way)));
    let daemon = Daemon::start(&port.address(), kept(Box::leak(more.into_boxed_str())));
    let mut session = port.link();
    session.run_until_corrected();
    work(&mut session, 500);
    let mut status = daemon.status();
    assert!(eventually(|| {
        work(&mut session, 20);
        status = daemon.status();
        status["records_dropped"].as_u64() > Some(0)
    }));
    assert!(status["recording"]["error"].is_string(), "{status}");
    assert_eq!(status["state"], "active", "the cycle does not care");
    assert!(text(&daemon.volcomp(&["status"]).stdout).contains("NOT RECORDED"));
    fs::remove_file(&way).expect("room made");
    assert!(eventually(|| {
        work(&mut session, 20);
        let status = daemon.status();
        status["recording"]["error"].is_null() && status["recording"]["records"].as_u64() > Some(0)
    }));
    let bytes = fs::read(&recordings_in(&way)[0]).expect("recording");
    assert!(Recording::parse(&bytes).expect("a recording").records() > 0);
}

/// A tmpfs of 200 KiB, unmounted when dropped.
struct SmallDisk(tempfile::TempDir);

impl SmallDisk {
    fn mount() -> Self {
        let place = tempfile::tempdir().expect("directory");
        let options = ["-t", "tmpfs", "-o", "size=200k", "tmpfs"];
        ok(&Command::new("mount").args(options).arg(place.path()).output().expect("mount runs"));
        Self(place)
    }
}

impl Drop for SmallDisk {
    fn drop(&mut self) {
        let released = Command::new("umount").arg(self.0.path()).status().is_ok_and(|s| s.success());
        assert!(released || std::thread::panicking(), "{} stays mounted", self.0.path().display());
    }
}

#[test]
#[ignore = "needs the right to mount a tmpfs"]
fn a_small_tmpfs_that_runs_full_costs_records_only() {
    let disk = SmallDisk::mount();
    let place = disk.0.path();
    let port = Port::open();
    let more = format!("[recording]\ndirectory = \"{}\"\nflush-ms = 20.0\n", place.display());
    let daemon = Daemon::start(&port.address(), kept(Box::leak(more.into_boxed_str())));
    let mut session = port.link();
    session.run_until_corrected();
    let filled = eventually(|| {
        work(&mut session, 300);
        daemon.status()["records_dropped"].as_u64() > Some(0)
    });
    // somebody else's file goes, and there is room again
    let status = daemon.status();
    let files: Vec<PathBuf> =
        fs::read_dir(place).expect("tmpfs").filter_map(Result::ok).map(|e| e.path()).collect();
    let bytes: Vec<Vec<u8>> = files.iter().map(|f| fs::read(f).expect("recording")).collect();
    drop(daemon);
    drop(disk);
    assert!(filled, "{status}");
    assert_eq!(status["state"], "active", "{status}");
    let text = status["recording"]["error"].as_str().expect("told").to_owned();
    assert!(text.contains("No space left"), "{text}");
    let recording = Recording::parse(&bytes[0]).expect("a recording");
    assert!(recording.records() > 1000 && recording.reader(0).count() as u64 == recording.records());
}

#[test]
fn counters_and_audit_log_survive_a_restart_and_tell_tampering() {
    let port = Port::open();
    let mut daemon = Daemon::start(&port.address(), Setup { start: "on-command", ..kept(KEPT) });
    let mut session = port.link();
    for _ in 0..50 {
        let _ = session.cycle();
    }
    let enabled = daemon.volcomp(&["enable", "--reason", "first part of the day"]);
    let _ = ok(&enabled);
    session.run_until_corrected();
    assert!(eventually(|| daemon.status()["lifetime"]["largest_um"]["x"].as_f64() > Some(9.9)));
    let cycles = u64::from(session.sequence);
    drop(session);
    daemon.signal(Signal::TERM);
    assert!(daemon.wait().success());

    daemon.restart();
    let status = daemon.status();
    let lifetime = &status["lifetime"];
    assert_eq!((&lifetime["starts"], &lifetime["enables"]), (&2.into(), &1.into()), "{lifetime}");
    assert_eq!(lifetime["cycles"].as_u64(), Some(cycles), "{lifetime}");
    assert!(lifetime["note"].is_null() && status["cycles"] == 0, "{lifetime}");
    assert!(text(&daemon.volcomp(&["status"]).stdout).contains("largest offset 10.000 µm"));

    let log = daemon.dir.path().join("state/audit.jsonl");
    let _ = ok(&volcomp(&["audit", "verify", name(&log)]));
    let machine = daemon.dir.path().join("machine.toml");
    let _ = ok(&volcomp(&["audit", "verify", "--config", name(&machine)]));
    head_is_needed(&log);
    let shown = ok(&volcomp(&["audit", "show", name(&log)]));
    for word in ["start: ok", "model: loaded", "enable: armed (why: first part of the day)", "stop: ok"] {
        assert!(shown.contains(word), "no `{word}` in:\n{shown}");
    }
    let raw = fs::read_to_string(&log).expect("log");
    let uid = rustix::process::getuid().as_raw();
    assert!(raw.contains(&format!("\"who\":{{\"uid\":{uid},")), "the client of the socket is named:\n{raw}");

    daemon.signal(Signal::TERM);
    assert!(daemon.wait().success());
    tampering_is_told(&mut daemon, &log);
}

/// Lines cut off together with the head file would not be seen: its absence is told.
fn head_is_needed(log: &Path) {
    let copy = tempfile::tempdir().expect("directory");
    let alone = copy.path().join("audit.jsonl");
    fs::copy(log, &alone).expect("copied");
    let verdict = volcomp(&["audit", "verify", name(&alone)]);
    assert_eq!(verdict.status.code(), Some(65), "{}", text(&verdict.stderr));
    assert!(text(&verdict.stderr).contains("audit.head"), "{}", text(&verdict.stderr));
    let _ = ok(&volcomp(&["audit", "verify", "--without-head", name(&alone)]));
}

fn tampering_is_told(daemon: &mut Daemon, log: &Path) {
    let raw = fs::read_to_string(log).expect("log");
    fs::write(log, raw.replace("first part of the day", "second part of the day")).expect("written");
    let verdict = volcomp(&["audit", "verify", name(log)]);
    assert_eq!(verdict.status.code(), Some(65));
    let line = raw.lines().position(|l| l.contains("first part")).expect("there") + 2;
    assert!(text(&verdict.stderr).contains(&format!("audit.jsonl:{line}:")), "{}", text(&verdict.stderr));
    // cut off at the end
    let shorter: String = raw.lines().take(3).map(|l| format!("{l}\n")).collect();
    fs::write(log, shorter).expect("written");
    let verdict = volcomp(&["audit", "verify", name(log)]);
    assert!(text(&verdict.stderr).contains("audit.jsonl:4:"), "{}", text(&verdict.stderr));
    // the daemon tells, keeps what it found and begins anew; counters that are damaged alike
    fs::write(log.with_file_name("counters.json"), "{").expect("written");
    daemon.restart();
    daemon.wait_for_log("the audit log is broken: line 4");
    daemon.wait_for_log("counters restart at zero");
    let status = daemon.status();
    assert_eq!(status["lifetime"]["starts"], 1);
    assert!(status["lifetime"]["note"].as_str().is_some_and(|n| n.contains("damaged-")), "{status}");
    // what the start has found is counted as what comes later
    let warnings = status["recent"]["warnings"].as_array().expect("warnings");
    for code in ["VC-7003", "VC-7004"] {
        assert!(warnings.iter().any(|w| w["code"] == code && w["count"] == 1), "{code}: {status}");
    }
    let _ = ok(&volcomp(&["audit", "verify", name(log)]));
    assert!(fs::read_to_string(log).expect("log").contains("\"what\":\"segment\""));
}

#[test]
fn without_a_place_for_its_state_the_daemon_works_and_says_so() {
    let port = Port::open();
    let daemon = Daemon::start(&port.address(), kept("[state]\ndirectory = \"model.toml/state\"\n"));
    let mut session = port.link();
    work(&mut session, 300);
    daemon.wait_for_log("counters and audit log are not kept");
    let status = daemon.status();
    // nobody knows what was ordered before: an operator has to say that it may begin
    assert_eq!(status["state"], "off");
    assert!(status["start_inhibit"].is_string(), "{status}");
    assert!(status["lifetime"]["note"].is_string() && status["recording"].is_null(), "{status}");
    let enabled = daemon.volcomp(&["enable"]);
    assert!(
        enabled.status.success() && text(&enabled.stderr).contains("not kept"),
        "{}",
        text(&enabled.stderr)
    );
    session.run_until_corrected();
    // and goes on saying so
    let told = || daemon.status()["recent"]["warnings"].to_string().contains("VC-7006");
    assert!(
        eventually(|| {
            let _ = session.cycle();
            told()
        }),
        "{}",
        daemon.status()
    );
    let status = daemon.status();
    assert_eq!(status["health"]["code"], "VC-7006", "{status}");
    assert_eq!(status["recent"]["warnings"][0]["present"], true, "{status}");
}

#[test]
fn a_recording_whose_folder_is_deleted_is_told_and_goes_on_in_a_new_one() {
    let port = Port::open();
    let daemon = Daemon::start(&port.address(), kept(KEPT));
    let mut session = port.link();
    session.run_until_corrected();
    let folder = daemon.dir.path().join("rec");
    assert!(eventually(|| {
        work(&mut session, 20);
        daemon.status()["recording"]["records"].as_u64() > Some(0)
    }));
    fs::remove_dir_all(&folder).expect("removed");
    assert!(eventually(|| {
        work(&mut session, 20);
        daemon.status()["records_dropped"].as_u64() > Some(0)
    }));
    daemon.wait_for_log("VC-7002");
    daemon.wait_for_log("was deleted while it was written");
    assert!(eventually(|| {
        work(&mut session, 20);
        folder.exists() && daemon.status()["recording"]["error"].is_null()
    }));
    work(&mut session, 200);
    assert!(eventually(|| {
        work(&mut session, 20);
        let found = recordings(&daemon);
        let bytes = found.first().map(|path| fs::read(path).expect("recording")).unwrap_or_default();
        Recording::parse(&bytes).is_ok_and(|recording| recording.records() > 0)
    }));
}
