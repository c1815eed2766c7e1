//! `[http]`: metrics, status, event streams; hostile clients; alert rules and dashboard.

#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "a test program: it fails by panicking")]

use std::collections::BTreeSet;
use std::io::{ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;

use crate::support::{Daemon, PATIENCE, Port, Session, Setup, eventually};

/// Event streams that are served at the same time.
const STREAMS: usize = 224;

/// A daemon with the HTTP service on a free port of loopback.
pub(crate) fn served(port: &Port, setup: Setup) -> (Daemon, SocketAddr) {
    served_with(port, setup, "")
}

/// The same with more keys of `[http]`.
pub(crate) fn served_with(port: &Port, setup: Setup, keys: &str) -> (Daemon, SocketAddr) {
    let free = TcpListener::bind("127.0.0.1:0").expect("port").local_addr().expect("address");
    let more: &'static str = format!("{}[http]\nlisten = \"{free}\"\n{keys}", setup.more).leak();
    let daemon = Daemon::start(&port.address(), Setup { more, ..setup });
    assert!(eventually(|| TcpStream::connect(free).is_ok()), "{}", daemon.log());
    (daemon, free)
}

pub(crate) fn connect(address: SocketAddr) -> TcpStream {
    let stream = TcpStream::connect(address).expect("connected");
    stream.set_read_timeout(Some(PATIENCE * 3)).expect("option");
    stream
}

/// Sends bytes and reads until the service closes the connection.
pub(crate) fn exchange(address: SocketAddr, request: &str) -> String {
    let mut stream = connect(address);
    // the service may answer and close before it has read everything
    let _ = stream.write_all(request.as_bytes());
    let mut answer = Vec::new();
    let _ = stream.read_to_end(&mut answer);
    String::from_utf8_lossy(&answer).into_owned()
}

/// Head and body of the answer to GET.
pub(crate) fn get(address: SocketAddr, path: &str, headers: &str) -> (String, String) {
    let request = format!("GET {path} HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\n{headers}\r\n");
    let answer = exchange(address, &request);
    let (head, body) = answer.split_once("\r\n\r\n").unwrap_or((&answer, ""));
    (head.to_ascii_lowercase(), body.to_owned())
}

/// The value of a sample without labels, or with these.
fn sample(metrics: &str, name: &str) -> Option<f64> {
    metrics.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(' ')?.parse().ok())
}

/// Cycles until a condition on `/metrics` holds.
fn cycle_until(session: &mut Session, address: SocketAddr, wanted: impl Fn(&str) -> bool) -> String {
    let mut metrics = String::new();
    let found = eventually(|| {
        for _ in 0..50 {
            let _ = session.cycle();
        }
        metrics = get(address, "/metrics", "").1;
        wanted(&metrics)
    });
    assert!(found, "{metrics}");
    metrics
}

fn with_input(program: &str, arguments: &[&str], input: &str) -> Output {
    let mut child = Command::new(program)
        .args(arguments)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("starts");
    child.stdin.take().expect("piped").write_all(input.as_bytes()).expect("taken");
    child.wait_with_output().expect("ends")
}

#[test]
fn metrics_tell_cycles_latency_state_offsets_and_model() {
    let port = Port::open();
    let (daemon, address) = served(&port, Setup::default());
    let mut session = port.link();
    session.run_until_corrected();
    let offset = "volcomp_offset_meters{axis=\"x\",kind=\"applied\"}";
    let text = cycle_until(&mut session, address, |text| {
        sample(text, offset).is_some_and(|m| (m + 10e-6).abs() < 1e-12)
            && sample(text, "volcomp_state{state=\"active\"}") == Some(1.0)
    });
    let cycles = sample(&text, "volcomp_cycles_total").expect("cycles");
    assert!(cycles > 100.0);
    let count = sample(&text, "volcomp_age_seconds_count").expect("a histogram");
    assert_eq!(sample(&text, "volcomp_age_seconds_bucket{le=\"+Inf\"}"), Some(count));
    assert!(count > 0.0 && count <= cycles);
    for (name, value) in [
        ("volcomp_link_up", 1.0),
        ("volcomp_enabled", 1.0),
        ("volcomp_state{state=\"faulted\"}", 0.0),
        ("volcomp_readings_refused_total", 0.0),
        ("volcomp_readings_dropped_total", 0.0),
        ("volcomp_model_error_motions{kind=\"covered\"}", 1.0),
        ("volcomp_model_error_motions{kind=\"possible\"}", 21.0),
        ("volcomp_faults_total{code=\"VC-4001\",name=\"read-back\"}", 0.0),
    ] {
        assert_eq!(sample(&text, name), Some(value), "{name}\n{text}");
    }
    let limit = sample(&text, "volcomp_offset_limit_meters{axis=\"x\",kind=\"limit\"}").expect("a limit");
    assert!((limit - 150e-6).abs() < 1e-12);
    for line in text.lines().filter(|line| !line.starts_with('#')) {
        assert!(line.starts_with("volcomp_"), "{line}");
    }
    // the two formats have the same samples
    let (head, open) = get(address, "/metrics", "Accept: application/openmetrics-text; version=1.0.0\r\n");
    assert!(head.contains("content-type: application/openmetrics-text; version=1.0.0"), "{head}");
    assert!(open.ends_with("# EOF\n") && open.contains("# TYPE volcomp_cycles counter\n"), "{open}");
    let names = |text: &str| -> BTreeSet<String> {
        let samples = text.lines().filter(|line| !line.starts_with('#'));
        samples.filter_map(|line| Some(line.rsplit_once(' ')?.0.to_owned())).collect()
    };
    assert_eq!(names(&open), names(&text));
    // a fault is counted by its number
    session.deceive(0.05);
    let mut faults = String::new();
    let counted = eventually(|| {
        faults = get(address, "/metrics", "").1;
        sample(&faults, "volcomp_faults_total{code=\"VC-4001\",name=\"read-back\"}") == Some(1.0)
    });
    assert!(counted, "{faults}\n{}", daemon.log());
}

#[test]
#[cfg_attr(not(tool_promtool), ignore = "needs promtool (Debian package prometheus)")]
fn promtool_accepts_the_metrics() {
    let port = Port::open();
    let (_daemon, address) = served(&port, Setup::default());
    let mut session = port.link();
    session.run_until_corrected();
    let text = cycle_until(&mut session, address, |text| text.contains("volcomp_offset_meters"));
    let output = with_input("promtool", &["check", "metrics"], &text);
    let said = [output.stdout, output.stderr].map(|bytes| String::from_utf8_lossy(&bytes).into_owned());
    assert!(output.status.success() && said.iter().all(|said| said.trim().is_empty()), "{said:?}\n{text}");
}

#[test]
#[cfg_attr(not(tool_promtool), ignore = "needs promtool (Debian package prometheus)")]
fn promtool_accepts_the_alert_rules_and_sees_them_fire() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("config/monitoring");
    for arguments in [["check", "rules", "volcomp.rules.yml"], ["test", "rules", "volcomp.rules.test.yml"]] {
        let output = Command::new("promtool").args(arguments).current_dir(&folder).output().expect("runs");
        let said = [output.stdout, output.stderr].map(|bytes| String::from_utf8_lossy(&bytes).into_owned());
        assert!(output.status.success(), "{said:?}");
    }
}

#[test]
fn every_alert_has_a_case_in_which_it_fires() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("config/monitoring");
    let read = |name: &str| std::fs::read_to_string(folder.join(name)).expect("rules");
    let (rules, cases) = (read("volcomp.rules.yml"), read("volcomp.rules.test.yml"));
    let alerts: Vec<&str> = rules.lines().filter_map(|line| line.trim().strip_prefix("- alert: ")).collect();
    assert!(alerts.len() >= 10, "{alerts:?}");
    for alert in alerts {
        let fires = format!("        alertname: {alert}\n        exp_alerts:\n          - exp_labels:");
        assert!(cases.contains(&fires), "{alert} has no case in which it fires");
        assert!(cases.contains(&format!("alertname: {alert}, exp_alerts: []")), "{alert} has no quiet case");
    }
}

/// Names of metrics in a text.
fn named(text: &str) -> BTreeSet<String> {
    let words = text.split(|c: char| !(c.is_ascii_alphanumeric() || c == '_'));
    words.filter(|word| word.starts_with("volcomp_") && word.len() > 8).map(str::to_owned).collect()
}

#[test]
fn rules_and_dashboard_name_metrics_that_exist() {
    let port = Port::open();
    let setup = Setup::default();
    let model = format!("{}[provenance]\nexpiry = \"2099-01-01\"\n", setup.model);
    let more = "[sensors]\nlisten = \"\"\n[[sensor]]\nname = \"air\"\nkind = \"temperature\"\n";
    let (_daemon, address) = served(&port, Setup { model, more, ..setup });
    let mut session = port.link();
    session.run_until_corrected();
    let text = cycle_until(&mut session, address, |text| {
        text.contains("volcomp_predicted_tool_tip_error_meters") && text.contains("volcomp_sensor_good")
    });
    let exist = named(&text);
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("config/monitoring");
    let rules = std::fs::read_to_string(folder.join("volcomp.rules.yml")).expect("rules");
    let dashboard = std::fs::read_to_string(folder.join("grafana-dashboard.json")).expect("dashboard");
    let object: Value = serde_json::from_str(&dashboard).expect("JSON");
    assert!(object["panels"].as_array().is_some_and(|panels| panels.len() > 5));
    for name in named(&rules).union(&named(&dashboard)) {
        assert!(exist.contains(name), "{name} is not among the metrics:\n{text}");
    }
}

#[test]
fn the_status_is_that_of_the_tool_and_events_carry_it() {
    let port = Port::open();
    let (daemon, address) = served(&port, Setup::default());
    let (head, body) = get(address, "/api/v1/status", "");
    assert!(head.starts_with("http/1.1 200") && head.contains("content-type: application/json"), "{head}");
    let keys = |value: &Value| value.as_object().expect("object").keys().cloned().collect::<Vec<_>>();
    let status: Value = serde_json::from_str(&body).expect("JSON");
    assert_eq!(keys(&status), keys(&daemon.status()));
    for header in [
        "content-security-policy: default-src 'none'",
        "x-content-type-options: nosniff",
        "cache-control: no-store",
    ] {
        assert!(head.contains(header), "no {header} in {head}");
    }
    let mut stream = connect(address);
    write!(stream, "GET /api/v1/events HTTP/1.1\r\nHost: localhost\r\n\r\n").expect("sent");
    let mut seen = String::new();
    let mut buffer = [0; 65536];
    while seen.matches("\ndata: {").count() < 2 {
        let count = stream.read(&mut buffer).expect("events");
        assert!(count > 0, "the stream has ended: {seen}");
        seen += &String::from_utf8_lossy(&buffer[..count]);
    }
    assert!(seen.to_ascii_lowercase().contains("content-type: text/event-stream"), "{seen}");
    assert!(seen.contains("event: status\n"));
}

/// Two positioning tests of X, evaluated by the tool into the file that the daemon reads; what the tool prints.
pub(crate) fn verify(record: &Path, date: &str, model: &Path) -> Value {
    let folder = tempfile::tempdir().expect("directory");
    let measured = |name: &str, curve: &dyn Fn(f64) -> f64| {
        let mut text = String::from("cycle,direction,target_mm,deviation_um\n");
        for cycle in 1..=5 {
            for k in 0..=8 {
                let target = -200.0 + 50.0 * f64::from(k);
                for direction in [1, -1] {
                    // repeatability and a reversal error
                    let scatter = f64::from((7 * cycle + 3 * k) % 5 - 2) * 0.4 + f64::from(direction) * 0.6;
                    text += &format!("{cycle},{direction},{target},{}\n", curve(target) + scatter);
                }
            }
        }
        let file = folder.path().join(name);
        std::fs::write(&file, text).expect("written");
        file
    };
    let before = measured("before.csv", &|x| 0.19 * x + 2.0);
    let after = measured("after.csv", &|x| 1.5 * (x / 60.0).sin());
    let output = Command::new(env!("CARGO_BIN_EXE_volcomp"))
        .args(["verify", "--json", "--title", "X axis, ISO 230-2", "--u-device-um", "0.6", "--date", date])
        .args(["--instrument", "laser interferometer no. 4711"])
        .args([Path::new("--before"), &before, Path::new("--after"), &after])
        .args([Path::new("--record"), record, Path::new("--model"), model])
        .output()
        .expect("runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).expect("JSON")
}

#[test]
fn a_verification_that_the_tool_records_is_shown_while_the_daemon_runs() {
    let port = Port::open();
    let folder = tempfile::tempdir().expect("directory");
    let record = folder.path().join("verification.json");
    let keys = format!("verification = \"{}\"\n", record.display());
    let (daemon, address) = served_with(&port, Setup::default(), &keys);
    let shown =
        || -> Value { serde_json::from_str(&get(address, "/api/v1/verification", "").1).expect("JSON") };
    let mut found = Value::Null;
    let until = |found: &mut Value, date: &str| {
        // the file is looked at every few seconds
        let deadline = Instant::now() + PATIENCE * 6;
        while found["verification"]["date"] != date && Instant::now() < deadline {
            std::thread::sleep(Duration::from_millis(200));
            *found = shown();
        }
        found["verification"]["date"] == date
    };
    assert_eq!((&shown()["configured"], &shown()["verification"]), (&true.into(), &Value::Null));
    assert!(shown()["problem"].as_str().is_some_and(|why| why.contains("verification.json")));
    let said = verify(&record, "2026-05-03", &daemon.dir.path().join("model.toml"));
    assert!(until(&mut found, "2026-05-03"), "{found}");
    let shown = &found["verification"];
    assert_eq!(found["problem"], Value::Null);
    assert_eq!(shown["instrument"], "laser interferometer no. 4711");
    assert_eq!(shown["title"], "X axis, ISO 230-2");
    // the model in use, so that the page can say so
    assert_eq!(shown["model_hash"], daemon.status()["model_hash"]);
    for (i, when) in ["before", "after"].iter().enumerate() {
        for key in ["range", "rms"] {
            assert_eq!(shown[key][i], said[key][format!("{when}_um")], "{key} {when}: {said:#}");
        }
    }
    assert!(shown["reduction"].as_f64().is_some_and(|r| r > 0.9), "{found}");
    assert!(shown["reduction_u95"].as_f64().is_some_and(|u| u > 0.0), "{found}");
    // a later one takes its place
    let other = folder.path().join("other.toml");
    std::fs::write(&other, "other").expect("written");
    let _ = verify(&record, "2026-06-01", &other);
    assert!(until(&mut found, "2026-06-01"), "{found}");
    assert_ne!(found["verification"]["model_hash"], daemon.status()["model_hash"]);
}

#[test]
fn other_names_paths_methods_and_sizes_are_refused() {
    let port = Port::open();
    let (_daemon, address) = served(&port, Setup::default());
    let host = format!("Host: {address}\r\nConnection: close\r\n");
    let long = "x".repeat(20_000);
    let many = (0..100).map(|k| format!("X-{k}: 1\r\n")).collect::<String>();
    for (request, code) in [
        // the name of another site that points here
        ("GET / HTTP/1.1\r\nHost: evil.example\r\nConnection: close\r\n\r\n".to_owned(), "421"),
        ("GET / HTTP/1.1\r\nConnection: close\r\n\r\n".to_owned(), "400"),
        (format!("GET / HTTP/1.1\r\nHost: localhost\r\n{host}\r\n"), "400"),
        (format!("GET /none HTTP/1.1\r\n{host}\r\n"), "404"),
        (format!("GET /../../etc/passwd HTTP/1.1\r\n{host}\r\n"), "404"),
        (format!("POST /api/v1/status HTTP/1.1\r\n{host}Content-Length: 2\r\n\r\n{{}}"), "405"),
        (format!("DELETE / HTTP/1.1\r\n{host}\r\n"), "405"),
        // without a token file nothing can be commanded, whatever is shown
        (format!("POST /api/v1/command HTTP/1.1\r\n{host}Content-Length: 2\r\n\r\n{{}}"), "403"),
        (
            format!(
                "POST /api/v1/command HTTP/1.1\r\n{host}Authorization: Bearer x\r\nContent-Length: 0\r\n\r\n"
            ),
            "403",
        ),
        (format!("GET /{long} HTTP/1.1\r\n{host}\r\n"), "4"),
        (format!("GET / HTTP/1.1\r\n{host}X: {long}\r\n\r\n"), "431"),
        (format!("GET / HTTP/1.1\r\n{host}{many}\r\n"), "431"),
        ("\u{0}\u{1}\r\n\r\n".to_owned(), "400"),
    ] {
        let answer = exchange(address, &request);
        let head = answer.lines().next().unwrap_or_default();
        let shown: String = request.chars().take(60).collect();
        assert!(head.starts_with(&format!("HTTP/1.1 {code}")), "{shown:?}: {answer}");
    }
    assert!(get(address, "/", "").0.starts_with("http/1.1 200"), "it goes on");
}

#[test]
fn hostile_clients_cost_themselves_only() {
    let port = Port::open();
    // this control says nothing while it waits for an answer of the page
    let (daemon, address) = served(&port, Setup { silence_s: 30.0, ..Setup::default() });
    let mut session = port.link();
    session.run_until_corrected();
    // event streams that nobody reads, up to the limit and beyond it
    let mut streams = Vec::new();
    for _ in 0..STREAMS {
        let mut stream = connect(address);
        write!(stream, "GET /api/v1/events HTTP/1.1\r\nHost: localhost\r\n\r\n").expect("sent");
        streams.push(stream);
    }
    for stream in &mut streams {
        let mut head = [0; 12];
        stream.read_exact(&mut head).expect("an answer");
        assert_eq!(&head, b"HTTP/1.1 200");
    }
    assert!(get(address, "/api/v1/events", "").0.starts_with("http/1.1 503"));
    // metrics stay reachable, and so does the cycle
    let begun = Instant::now();
    let mut answers = 0;
    while begun.elapsed() < Duration::from_secs(3) {
        for _ in 0..200 {
            let _ = session.cycle();
        }
        answers += usize::from(get(address, "/metrics", "").0.starts_with("http/1.1 200"));
    }
    assert!(answers > 0);
    // connections that send no request are closed
    let mut silent: Vec<TcpStream> = (0..16).map(|_| connect(address)).collect();
    for stream in &mut silent {
        stream.set_read_timeout(Some(Duration::from_millis(1))).expect("option");
        let _ = write!(stream, "GET / HTTP/1.1\r\nX: ");
    }
    let deadline = Instant::now() + PATIENCE * 4;
    while !silent.is_empty() {
        assert!(Instant::now() < deadline, "{} connections are still open", silent.len());
        let _ = session.cycle();
        // the end of the connection, or a reset; before it perhaps an answer that says so
        silent.retain_mut(|stream| match stream.read(&mut [0; 512]) {
            Ok(count) => count > 0,
            Err(error) => matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut),
        });
    }
    drop(streams);
    let freed = eventually(|| {
        let mut stream = connect(address);
        let _ = write!(stream, "GET /api/v1/events HTTP/1.1\r\nHost: localhost\r\n\r\n");
        let mut head = [0; 12];
        stream.read_exact(&mut head).is_ok() && &head == b"HTTP/1.1 200"
    });
    assert!(freed, "places are given back");
    assert!(!daemon.log().contains("no sign of life"), "{}", daemon.log());
}

#[test]
fn a_port_in_use_ends_the_start_with_a_remedy() {
    let port = Port::open();
    let taken = TcpListener::bind("127.0.0.1:0").expect("port");
    let more: &'static str =
        format!("[http]\nlisten = \"{}\"\n", taken.local_addr().expect("address")).leak();
    let mut daemon = Daemon::start(&port.address(), Setup { more, ..Setup::default() });
    assert_eq!(daemon.wait().code(), Some(74));
    let log = daemon.log();
    assert!(log.contains("http.listen 127.0.0.1:") && log.contains("another program has this port"), "{log}");
}
