//! A compensated machine measured through its control, and both measurements in one report.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
#![expect(clippy::disallowed_methods, reason = "the test reads and writes files, starts programs and waits")]

use std::io::{BufRead as _, BufReader};
use std::net::TcpListener;
use std::os::unix::net::UnixListener;
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};

use serde_json::Value;
use simulator::demo::programs::Programs;

const CNCSIM: &str = env!("CARGO_BIN_EXE_cncsim");
const MACHINE_FILE: &str = include_str!("../../../config/examples/vmc-850/machine.toml");
const MODEL_FILE: &str = include_str!("../../../config/examples/vmc-850/model.toml");

fn port() -> String {
    TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().to_string()
}

/// The daemon's files with the control at `address`.
fn files(folder: &Path, address: &str, start: &str) {
    let mut file: toml::Table = MACHINE_FILE.parse().unwrap();
    let mut set = |table: &str, key: &str, value: toml::Value| {
        let entry = file.entry(table).or_insert_with(|| toml::Table::new().into());
        entry.as_table_mut().unwrap().insert(key.to_owned(), value);
    };
    set("link", "address", address.into());
    set("link", "silence-s", 60.0.into());
    set("engine", "stale-ms", 10_000.0.into());
    set("engine", "start", start.into());
    set("engine", "ramp-s", 0.5.into());
    set("realtime", "priority", 0.into());
    set("realtime", "lock-memory", false.into());
    set("status", "socket", "".into());
    set("log", "target", "stderr".into());
    std::fs::write(folder.join("machine.toml"), toml::to_string(&file).unwrap()).unwrap();
    std::fs::write(folder.join("model.toml"), MODEL_FILE).unwrap();
}

fn cncsim(folder: &Path, args: &[&str]) -> Output {
    Command::new(CNCSIM).args(args).current_dir(folder).output().unwrap()
}

fn good(out: &Output) -> String {
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    String::from_utf8(out.stdout.clone()).unwrap()
}

fn measure(folder: &Path, what: &str, out: &str, through: Option<&str>, more: &[&str]) {
    let mut args = vec!["measure", what, "--out", out];
    args.extend(through.iter().flat_map(|t| ["--through", *t]));
    args.extend(more);
    good(&cncsim(folder, &args));
}

/// What `volcomp verify` says about a file of both folders.
fn verify(folder: &Path, file: &str, more: &[&str]) -> Value {
    let (before, after) = (format!("before/{file}"), format!("after/{file}"));
    let mut args = vec!["volcomp", "verify", "--json", "--before", &before, "--after", &after];
    args.extend(more);
    serde_json::from_str(&good(&cncsim(folder, &args))).unwrap()
}

fn reduction(report: &Value) -> f64 {
    let range = &report["range"];
    assert!(range["reduction_u95"].as_f64().is_some_and(|u| u < 0.2), "{report}");
    range["reduction"].as_f64().unwrap()
}

#[test]
fn a_machine_file_is_enough_to_measure_before_and_after() {
    let _alone = crate::processors();
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    // a daemon works with this file already: its control's port and its status socket are taken
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    files(at, &taken.local_addr().unwrap().to_string(), "on-connect");
    let socket = at.join("taken.sock");
    let _listening = UnixListener::bind(&socket).unwrap();
    let file = std::fs::read_to_string(at.join("machine.toml")).unwrap();
    let socket = format!("socket = \"{}\"", socket.display());
    std::fs::write(at.join("machine.toml"), file.replace("socket = \"\"", &socket)).unwrap();
    for axis in ["x", "z"] {
        let more = ["--axis", axis, "--cycles", "3", "--targets", "11"];
        measure(at, "positioning", "before", None, &more);
        measure(at, "positioning", "after", Some("machine.toml"), &more);
        let report = verify(at, &format!("positioning-{axis}.csv"), &["--report", "r.html"]);
        assert!(reduction(&report) > 0.7, "{axis}: {report}");
        assert!(report["figures"]["e_um"]["after"].as_f64().unwrap() < 5.0, "{report}");
        let page = std::fs::read_to_string(at.join("r.html")).unwrap();
        assert!(page.contains("After, same scale") && page.contains("ISO 230-2"), "the report");
    }
    let box_of = ["--low-mm", "50,50,-450", "--box-mm", "700,400,400", "--steps", "6", "--cycles", "2"];
    measure(at, "diagonals", "before", None, &box_of);
    measure(at, "diagonals", "after", Some("machine.toml"), &box_of);
    // each file says what was measured
    for (folder, how) in [
        ("before", "# without compensation, machine vmc-850"),
        ("after", "# through the control of machine.toml"),
    ] {
        for file in ["positioning-x.csv", "diagonals.csv"] {
            let text = std::fs::read_to_string(at.join(folder).join(file)).unwrap();
            assert_eq!(text.lines().next(), Some(how), "{folder}/{file}");
        }
    }
    let report = verify(at, "diagonals.csv", &[]);
    assert!(reduction(&report) > 0.7, "{report}");
    for what in ["ballbar", "circle"] {
        let more = ["--radius-mm", "80", "--rate-hz", "100"];
        measure(at, what, "before", None, &more);
        measure(at, what, "after", Some("machine.toml"), &more);
        let report = verify(at, &format!("{what}-xy.csv"), &["--radius-mm", "80", "--report", "c.html"]);
        assert!(reduction(&report) > 0.7, "{what}: {report}");
    }
}

#[test]
fn a_daemon_that_does_not_compensate_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let args = ["measure", "positioning", "--out", ".", "--through", "machine.toml"];
    let message = || {
        let out = cncsim(folder.path(), &args);
        assert_eq!(out.status.code(), Some(74));
        String::from_utf8_lossy(&out.stderr).into_owned()
    };
    // the key is read before anything is started
    files(folder.path(), &port(), "on-command");
    let said = message();
    assert!(said.contains("[engine] start is \"on-command\"; it must be \"on-connect\""), "{said}");
    assert!(!folder.path().join("volcompd.log").exists());
    // what speaks against the model is the daemon's to say, not a key that is as it should be
    files(folder.path(), &port(), "on-connect");
    let model = MODEL_FILE.replace("expiry = 2027", "expiry = 2020");
    std::fs::write(folder.path().join("model.toml"), model).unwrap();
    let said = message();
    assert!(said.contains("does not compensate: ") && said.contains("its log: "), "{said}");
    assert!(said.contains("expired") && !said.contains("on-connect"), "{said}");
    let out = cncsim(folder.path(), &["measure", "circle", "--out", ".", "--through", &port()]);
    assert_eq!(out.status.code(), Some(74));
    let message = String::from_utf8_lossy(&out.stderr).into_owned();
    assert!(message.contains("cncsim serve --measure"), "{message}");
}

/// A running control; ended with the test.
struct Control(Child);

impl Drop for Control {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn serve(folder: &Path, address: &str, more: &[&str]) -> (Control, String) {
    let mut child = Command::new(CNCSIM)
        .args(["serve", "--listen", address, "--measure", "127.0.0.1:0", "--as-fast-as-possible"])
        .args(more)
        .current_dir(folder)
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(child.stderr.take().unwrap()).lines();
    let control = Control(child);
    loop {
        let line = lines.next().unwrap().unwrap();
        if let Some(port) = line.strip_prefix("measuring port ") {
            let port = port.to_owned();
            // whatever it says later must not fill the pipe
            std::thread::spawn(move || lines.for_each(drop));
            return (control, port);
        }
    }
}

#[test]
fn a_running_pair_is_measured_with_and_without_its_daemon() {
    let _alone = crate::processors();
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let address = port();
    files(at, &address, "on-connect");
    let more = ["--axis", "x", "--positions", "12", "--cycles", "2"];
    {
        let (_control, through) = serve(at, &address, &[]);
        measure(at, "straightness", "before", Some(&through), &more);
        // a part program that cannot be run is refused, and the control goes on
        let far = ["--axis", "x", "--at-mm", "0,9000,0"];
        let args = [&["measure", "positioning", "--out", ".", "--through", &through][..], &far].concat();
        let out = cncsim(at, &args);
        assert_eq!(out.status.code(), Some(74));
        assert!(String::from_utf8_lossy(&out.stderr).contains("the control refuses"), "{out:?}");
        measure(at, "straightness", "before", Some(&through), &more);
    }
    let (_control, through) = serve(at, &address, &["--wait-s", "30"]);
    let programs = Programs::at(CNCSIM);
    let _daemon = programs.volcompd(&at.join("machine.toml"), &at.join("log")).unwrap();
    // the first run waits for the daemon and may begin before it compensates in full
    measure(at, "straightness", "warm-up", Some(&through), &more);
    measure(at, "straightness", "after", Some(&through), &more);
    let report = verify(at, "straightness-x.csv", &["--report", "s.html"]);
    assert_eq!(report["test"], "straightness");
    assert!(reduction(&report) > 0.5, "{report}");
}
