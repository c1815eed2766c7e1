//! An MTConnect agent, a Mosquitto broker, a Prometheus server and an OPC UA client read the running daemon.

#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "a test program: it fails by panicking")]

use std::fs;
use std::io::{BufRead, BufReader, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use serde_json::Value;

use crate::support::{Daemon, PATIENCE, Port, Session, Setup, eventually};

/// A program that is killed when dropped.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        // already gone where it failed
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn free_port() -> SocketAddr {
    TcpListener::bind("127.0.0.1:0").expect("port").local_addr().expect("address")
}

fn with_tables(port: &Port, more: String) -> Daemon {
    Daemon::start(&port.address(), Setup { more: more.leak(), ..Setup::default() })
}

fn gateway(daemon: &Daemon) -> Running {
    let log = fs::File::create(daemon.dir.path().join("gateway.log")).expect("log");
    let child = Command::new(env!("CARGO_BIN_EXE_volcomp"))
        .args(["gateway", "--config"])
        .arg(daemon.dir.path().join("machine.toml"))
        .stderr(log)
        .spawn()
        .expect("starts");
    Running(child)
}

/// Lines that a stream says, as they come.
fn lines(stream: impl std::io::Read + Send + 'static) -> Receiver<String> {
    let (sender, receiver) = channel();
    std::thread::spawn(move || {
        for line in BufReader::new(stream).lines().map_while(Result::ok) {
            if sender.send(line).is_err() {
                return;
            }
        }
    });
    receiver
}

/// The same while the control cycles.
fn cycle_until(
    session: &mut Session,
    lines: &Receiver<String>,
    wanted: impl Fn(&str) -> bool,
) -> Vec<String> {
    let mut seen: Vec<String> = Vec::new();
    let deadline = Instant::now() + PATIENCE * 4;
    while !seen.last().is_some_and(|line| wanted(line)) {
        assert!(Instant::now() < deadline, "not said, after\n{}", seen.join("\n"));
        let _ = session.cycle();
        seen.extend(lines.try_recv());
    }
    seen
}

/// Waits for a line; gives those before it, too.
fn wait_for(lines: &Receiver<String>, wanted: impl Fn(&str) -> bool) -> Vec<String> {
    let mut seen = Vec::new();
    let deadline = Instant::now() + PATIENCE * 4;
    loop {
        let left = deadline.saturating_duration_since(Instant::now());
        match lines.recv_timeout(left) {
            Ok(line) => seen.push(line),
            Err(_) => panic!("not said, after\n{}", seen.join("\n")),
        }
        if seen.last().is_some_and(|line| wanted(line)) {
            return seen;
        }
    }
}

fn agent(address: SocketAddr) -> (TcpStream, Receiver<String>) {
    let mut stream = None;
    assert!(eventually(|| {
        stream = TcpStream::connect(address).ok();
        stream.is_some()
    }));
    let stream = stream.expect("connected");
    let said = lines(stream.try_clone().expect("two ends"));
    (stream, said)
}

#[test]
fn an_agent_reads_offsets_health_and_the_end_of_the_daemon() {
    let (port, address) = (Port::open(), free_port());
    let mut daemon = with_tables(&port, format!("[mtconnect]\nlisten = \"{address}\"\n"));
    let mut session = port.link();
    session.run_until_corrected();
    let _gateway = gateway(&daemon);
    let (mut stream, said) = agent(address);
    stream.write_all(b"* PING\r\n").expect("sent");
    let mut seen = wait_for(&said, |line| line == "* PONG 10000");
    // one sample is several lines: what is awaited comes in any order
    for end in [
        "|vc_avail|AVAILABLE",
        "|vc_state|ACTIVE",
        "|vc_model|model.toml",
        "|vc_enabled|ON",
        "|vc_x_offset|-0.0100000",
    ] {
        if !seen.iter().any(|line| line.ends_with(end)) {
            seen.extend(cycle_until(&mut session, &said, |line| line.ends_with(end)));
        }
    }
    drop(session);
    let _ = wait_for(&said, |line| line.contains("|vc_health|FAULT|"));
    daemon.child.kill().expect("killed");
    let _ = daemon.child.wait();
    let _ = wait_for(&said, |line| line.ends_with("|vc_avail|UNAVAILABLE"));
    port.close_pending();
    daemon.restart();
    let _ = wait_for(&said, |line| line.ends_with("|vc_avail|AVAILABLE"));
    // a client that sends no lines is let go; others stay
    let (mut flood, closed) = agent(address);
    let _ = flood.write_all(&[b'x'; 4096]);
    assert!(eventually(|| closed.recv_timeout(Duration::from_millis(50)).is_err()));
    stream.write_all(b"* PING\n").expect("sent");
    let _ = wait_for(&said, |line| line == "* PONG 10000");
}

/// What an agent of another make reads in some seconds, by the device file; the control goes on meanwhile.
fn read_as_agent(address: SocketAddr, seconds: &str, session: &mut Session) -> Value {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut child = Command::new("python3")
        .arg(root.join("tests/daemon/mtconnect_agent.py"))
        .arg(root.join("config/monitoring/mtconnect-device.xml"))
        .args([&address.to_string(), seconds])
        .stdout(Stdio::piped())
        .spawn()
        .expect("python3");
    while child.try_wait().expect("child").is_none() {
        let _ = session.cycle();
    }
    let output = child.wait_with_output().expect("output");
    assert!(output.status.success(), "a line that an agent does not take");
    serde_json::from_slice(&output.stdout).expect("JSON")
}

#[test]
#[ignore = "needs python3: .ci/nightly outputs"]
fn an_agent_with_the_device_file_understands_every_line_of_the_running_daemon() {
    let (port, address) = (Port::open(), free_port());
    let daemon = with_tables(&port, format!("[mtconnect]\nlisten = \"{address}\"\n"));
    let mut session = port.link();
    session.run_until_corrected();
    let _gateway = gateway(&daemon);
    drop(agent(address));
    let mut read = Value::Null;
    let deadline = Instant::now() + PATIENCE * 6;
    // the ramp, and the first status of the gateway
    while read["current"]["vc_x_offset"] != -0.01 {
        assert!(Instant::now() < deadline, "{read:#}");
        read = read_as_agent(address, "3", &mut session);
    }
    assert_eq!(read["heartbeat_ms"], 10_000);
    let hash = daemon.status()["model_hash"].clone();
    for (name, value) in [
        ("vc_avail", "AVAILABLE".into()),
        ("vc_state", "ACTIVE".into()),
        ("vc_enabled", "ON".into()),
        ("vc_gain", 100.0.into()),
        ("vc_model", "model.toml".into()),
        ("vc_model_hash", hash),
        ("vc_y_offset", 0.0.into()),
        // an axis of the file that this machine does not have
        ("vc_c_offset", "UNAVAILABLE".into()),
    ] {
        assert_eq!(read["current"][name], value, "{name} in {read:#}");
    }
    assert!(
        read["current"]["vc_tip_without"].as_f64().is_some_and(|mm| (mm - 0.01).abs() < 1e-6),
        "{read:#}"
    );
    assert!(read["current"]["vc_health"][0].is_string(), "{read:#}");
}

#[test]
fn a_gateway_without_an_output_or_with_a_port_in_use_says_what_to_do() {
    let port = Port::open();
    let taken = TcpListener::bind("127.0.0.1:0").expect("port");
    let address = taken.local_addr().expect("address");
    for (more, code, words) in [
        (String::new(), 78, "nothing to do"),
        (format!("[mtconnect]\nlisten = \"{address}\"\n"), 74, "mtconnect.listen"),
    ] {
        let daemon = with_tables(&port, more);
        let mut gateway = gateway(&daemon);
        let mut ended = None;
        assert!(eventually(|| {
            ended = gateway.0.try_wait().expect("child");
            ended.is_some()
        }));
        let log = fs::read_to_string(daemon.dir.path().join("gateway.log")).expect("log");
        assert_eq!(ended.and_then(|status| status.code()), Some(code), "{log}");
        assert!(log.contains(words) && log.contains("hint: "), "{log}");
    }
}

#[test]
fn the_device_file_names_every_item() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let file = fs::read_to_string(root.join("config/monitoring/mtconnect-device.xml")).expect("device file");
    let source = fs::read_to_string(root.join("src/gateway/mtconnect.rs")).expect("source");
    let keys: Vec<&str> =
        source.split('"').filter(|word| word.starts_with("vc_") && !word.contains('{')).collect();
    assert!(keys.len() > 10);
    for key in keys.iter().filter(|key| key.chars().all(|c| c.is_ascii_lowercase() || c == '_')) {
        assert!(file.contains(&format!("name=\"{key}\"")), "{key}");
    }
}

#[test]
#[ignore = "needs mosquitto and mosquitto_sub: .ci/nightly outputs"]
fn a_broker_gets_retained_state_events_and_the_last_will() {
    let (port, broker) = (Port::open(), free_port());
    let mut daemon =
        with_tables(&port, format!("[mqtt]\nbroker = \"{broker}\"\ntopic = \"cell/a\"\ninterval-s = 0.2\n"));
    let mut session = port.link();
    session.run_until_corrected();
    // the gateway comes first: it waits for the broker
    let mut gate = gateway(&daemon);
    let start = || {
        let mut command = Command::new("mosquitto");
        command.args(["-p", &broker.port().to_string()]).stderr(Stdio::null());
        Running(command.spawn().expect("mosquitto"))
    };
    let mosquitto = start();
    let subscribe = || {
        let mut said = None;
        assert!(eventually(|| TcpStream::connect(broker).is_ok()));
        let mut command = Command::new("mosquitto_sub");
        command.args(["-p", &broker.port().to_string(), "-t", "cell/a/#", "-v"]).stdout(Stdio::piped());
        let mut child = command.spawn().expect("mosquitto_sub");
        said.replace(lines(child.stdout.take().expect("piped")));
        (Running(child), said.expect("lines"))
    };
    let (_subscriber, said) = subscribe();
    let is_active = |line: &str| line.starts_with("cell/a/status ") && line.contains("\"state\":\"active\"");
    let seen = cycle_until(&mut session, &said, is_active);
    assert!(seen.iter().any(|line| line == "cell/a/availability online"), "{}", seen.join("\n"));
    let text = seen.last().and_then(|l| l.strip_prefix("cell/a/status ")).expect("a status");
    let status: Value = serde_json::from_str(text).expect("JSON");
    assert_eq!(status["machine"], "test-mill");
    // a link that breaks is an event and another health
    drop(session);
    let seen = wait_for(&said, |line| line.starts_with("cell/a/event "));
    let _ =
        (seen, wait_for(&said, |line| line.starts_with("cell/a/health ") && line.contains("disconnected")));
    // a broker that restarts without memory is told everything again
    drop(mosquitto);
    let _mosquitto = start();
    let (_again, said) = subscribe();
    let _ = wait_for(&said, |line| line == "cell/a/availability online");
    let _ = wait_for(&said, |line| line.starts_with("cell/a/status "));
    // the daemon ends: not available; it comes back; the gateway dies: the last will
    daemon.child.kill().expect("killed");
    let _ = daemon.child.wait();
    let _ = wait_for(&said, |line| line == "cell/a/availability offline");
    daemon.restart();
    let _ = wait_for(&said, |line| line == "cell/a/availability online");
    gate.0.kill().expect("killed");
    let _ = wait_for(&said, |line| line == "cell/a/availability offline");
}

/// The answer of Prometheus to a query of its HTTP interface.
fn ask(address: SocketAddr, path: &str) -> Option<Value> {
    let mut stream = TcpStream::connect(address).ok()?;
    stream.set_read_timeout(Some(PATIENCE)).ok()?;
    write!(stream, "GET {path} HTTP/1.0\r\nHost: {address}\r\n\r\n").ok()?;
    let mut answer = String::new();
    std::io::Read::read_to_string(&mut stream, &mut answer).ok()?;
    serde_json::from_str(answer.split_once("\r\n\r\n")?.1).ok()
}

#[test]
#[ignore = "needs prometheus: .ci/nightly outputs"]
fn prometheus_scrapes_the_daemon_and_the_shipped_alerts_fire() {
    let (port, listen) = (Port::open(), free_port());
    let (daemon, metrics) = crate::http::served(&port, Setup::default());
    let mut session = port.link();
    session.run_until_corrected();
    let folder = tempfile::tempdir().expect("folder");
    let rules = Path::new(env!("CARGO_MANIFEST_DIR")).join("config/monitoring/volcomp.rules.yml");
    let config = format!(
        "global: {{ scrape_interval: 1s, evaluation_interval: 1s }}\nrule_files: [\"{}\"]\n\
         scrape_configs:\n  - job_name: volcomp\n    static_configs: [{{ targets: [\"{metrics}\"] }}]\n",
        rules.display()
    );
    fs::write(folder.path().join("prometheus.yml"), config).expect("written");
    let _prometheus = Running(
        Command::new("prometheus")
            .arg(format!("--config.file={}", folder.path().join("prometheus.yml").display()))
            .arg(format!("--storage.tsdb.path={}", folder.path().join("data").display()))
            .arg(format!("--web.listen-address={listen}"))
            .stderr(Stdio::null())
            .spawn()
            .expect("prometheus"),
    );
    let until = |wanted: &dyn Fn() -> bool, what: &str, work: &mut dyn FnMut(), limit: Duration| {
        let deadline = Instant::now() + limit;
        while !wanted() {
            assert!(Instant::now() < deadline, "{what}: {:?}", ask(listen, "/api/v1/alerts"));
            work();
            std::thread::sleep(Duration::from_millis(50));
        }
    };
    let mut cycle = || {
        for _ in 0..200 {
            let _ = session.cycle();
        }
    };
    let cycles = || {
        let answer = ask(listen, "/api/v1/query?query=volcomp_cycles_total")?;
        answer["data"]["result"][0]["value"][1].as_str()?.parse::<f64>().ok()
    };
    until(&|| cycles().is_some_and(|c| c > 100.0), "no cycles", &mut cycle, PATIENCE * 6);
    let fires = |name: &str| {
        let alerts = ask(listen, "/api/v1/alerts").unwrap_or_default();
        let all = alerts["data"]["alerts"].as_array().cloned().unwrap_or_default();
        all.iter().any(|a| a["labels"]["alertname"] == name && a["state"] == "firing")
    };
    for name in ["VolcompDaemonDown", "VolcompFaulted", "VolcompNewFault"] {
        assert!(!fires(name), "{name}");
    }
    // the control holds an offset that was never sent
    session.deceive(0.05);
    for name in ["VolcompFaulted", "VolcompNewFault"] {
        until(&|| fires(name), name, &mut || {}, PATIENCE * 6);
    }
    drop(daemon);
    // its rule waits for a minute
    until(&|| fires("VolcompDaemonDown"), "no alert", &mut || {}, Duration::from_secs(100));
}

/// The OPC UA server beside a daemon, once it listens.
fn opcua(daemon: &Daemon, address: SocketAddr) -> Running {
    let program = Path::new(env!("CARGO_MANIFEST_DIR")).join("adapters/opcua/target/release/volcomp-opcua");
    let log = fs::File::create(daemon.dir.path().join("opcua.log")).expect("log");
    let child = Command::new(program)
        .args(["--serial-number", "4711", "--listen", &address.to_string(), "--socket"])
        .arg(daemon.socket())
        .stderr(log)
        .spawn()
        .expect("volcomp-opcua is built");
    let running = Running(child);
    assert!(
        eventually(|| TcpStream::connect(address).is_ok()),
        "{}",
        fs::read_to_string(daemon.dir.path().join("opcua.log")).expect("log")
    );
    running
}

/// What asyncua, an independent client, reads; the control goes on meanwhile.
fn asyncua(address: SocketAddr, session: Option<&mut Session>) -> Value {
    let python = std::env::var("VOLCOMP_ASYNCUA_PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("adapters/opcua/read.py");
    let mut child = Command::new(python)
        .arg(script)
        .arg(format!("opc.tcp://{address}/"))
        .stdout(Stdio::piped())
        .spawn()
        .expect("python with asyncua");
    if let Some(session) = session {
        while child.try_wait().expect("child").is_none() {
            let _ = session.cycle();
        }
    }
    let output = child.wait_with_output().expect("output");
    assert!(output.status.success());
    serde_json::from_slice(&output.stdout).expect("JSON")
}

#[test]
#[ignore = "needs adapters/opcua and asyncua: .ci/nightly outputs"]
fn asyncua_reads_the_machine_tool_its_compensation_and_the_end_of_the_daemon() {
    let (port, address) = (Port::open(), free_port());
    let mut daemon = Daemon::start(&port.address(), Setup::default());
    let mut session = port.link();
    session.run_until_corrected();
    let _opcua = opcua(&daemon, address);
    let mut read = Value::Null;
    let deadline = Instant::now() + PATIENCE * 12;
    // its first reading of the daemon, and the ramp
    while read["values"]["Monitoring/Compensation/Offsets/X"][0] != -10.0 {
        assert!(Instant::now() < deadline, "{read:#}");
        read = asyncua(address, Some(&mut session));
    }
    assert_eq!(read["machine"], "test-mill");
    assert_eq!((&read["type"], &read["type_is_of_40501"]), (&"MachineToolType".into(), &true.into()));
    assert_eq!(read["element_of"], "Monitoring");
    assert_eq!(read["subscribed"].as_array().and_then(|all| all.last()), Some(&"active".into()));
    let good = |path: &str, value: Value| {
        assert_eq!(read["values"][path], serde_json::json!([value, "Good"]), "{path} in {read:#}");
    };
    let here = "Monitoring/Compensation";
    good(&format!("{here}/State"), "active".into());
    good(&format!("{here}/DaemonAnswers"), true.into());
    good(&format!("{here}/Enabled"), true.into());
    good(&format!("{here}/Model"), "model.toml".into());
    good(&format!("{here}/Offsets/X/EngineeringUnits"), "µm".into());
    good("Identification/SerialNumber", "4711".into());
    let software = "Identification/SoftwareIdentification/volcompd/SoftwareRevision";
    good(software, env!("CARGO_PKG_VERSION").into());
    let status = |path: &str| read["values"][path][1].clone();
    // mandatory in the model, unknown to volcompd: there, and not made up
    assert_eq!(status("Monitoring/MachineTool/OperationMode"), "BadNotSupported");
    assert_eq!(status("Production/ActiveProgram/Name"), "BadNotSupported");
    assert_eq!(status("Identification/Manufacturer"), "BadNotSupported");
    // read-only
    assert_eq!((&read["written"], &read["methods"]), (&"BadUserAccessDenied".into(), &0.into()));
    drop(session);
    daemon.child.kill().expect("killed");
    let _ = daemon.child.wait();
    while read["values"]["Monitoring/Compensation/DaemonAnswers"][0] != false {
        assert!(Instant::now() < deadline, "{read:#}");
        read = asyncua(address, None);
    }
    assert_eq!(
        read["values"]["Monitoring/Compensation/State"],
        serde_json::json!([null, "BadNoCommunication"])
    );
    assert_eq!(read["values"]["Monitoring/Compensation/Offsets/X"][1], "BadNoCommunication");
}
