//! Thermal displacement through a real `volcompd`: temperatures and a speed on a sensor link reach the axes.

#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "a test program: it fails by panicking")]

use std::fs;
use std::io::Write;
use std::net::{TcpListener, TcpStream};
use std::time::{Duration, Instant};

use crate::support::{Daemon, EXX_MM, PATIENCE, Port, Session, Setup, eventually};
use rustix::process::Signal;

/// The nose grows by 1 um/K at once and 1 um/K behind 2 s, and by -1 um per 1000/min; X expands by 10 um/(m K) about 100 mm.
const MODEL: &str = r#"
format = "volcomp-model/1"
machine = "test-mill"
chain = "[w X' b Y Z t]"
[errors.exx]
constant = { value-um = 10.0 }
live = { sensor = "scale-x", limit-um = 80, reference-mm = 100 }
[errors.ezz.live]
sensor = "spindle-z"
limit-um = 40
[thermal.spindle-z]
std-um = 2
[[thermal.spindle-z.input]]
sensor = "box.2"
range-degc = [20, 30]
lags-s = [0, 2]
growth-um-per-k = [1, 1]
[[thermal.spindle-z.input]]
sensor = "spindle"
range-rpm = [0, 6000]
growth-um-per-krpm = [-1]
[thermal.scale-x]
kind = "expansion"
[[thermal.scale-x.input]]
sensor = "box"
range-degc = [10, 35]
strain-um-per-m-k = [10]
"#;

/// A machine file's tables, with a port that is free.
fn tables() -> (String, &'static str) {
    let port = TcpListener::bind("127.0.0.1:0").expect("a port").local_addr().expect("address");
    let text = format!(
        "[state]\ndirectory = \"state\"\n[sensors]\nlisten = \"{port}\"\nkeep-s = 1\n\
         [[sensor]]\nname = \"box\"\nkind = \"temperature\"\nage-limit-ms = 1500\njump-degc = 50\n\
         [[sensor]]\nname = \"spindle\"\nkind = \"speed\"\n"
    );
    (port.to_string(), Box::leak(text.into_boxed_str()))
}

struct Shop {
    session: Session,
    sensors: TcpStream,
    begin: Instant,
    control_ns: i64,
    /// Box: guide, nose.
    degc: [f64; 2],
    rpm: f64,
    there: bool,
}

impl Shop {
    fn open(port: &Port, address: &str) -> Self {
        let mut sensors = None;
        assert!(eventually(|| {
            sensors = TcpStream::connect(address).ok();
            sensors.is_some()
        }));
        let session = port.link();
        session.stream.set_nodelay(true).expect("option");
        let control_ns = session.control_ns;
        let sensors = sensors.expect("sensors connect");
        Self { session, sensors, begin: Instant::now(), control_ns, degc: [20.0; 2], rpm: 0.0, there: true }
    }

    /// Cycles in real time for so long, readings every 100 ms.
    fn work(&mut self, time: Duration) {
        let until = Instant::now() + time;
        let mut said = Instant::now();
        while Instant::now() < until {
            let elapsed = self.begin.elapsed();
            self.session.control_ns = self.control_ns + i64::try_from(elapsed.as_nanos()).expect("fits");
            self.session.commanded[0] = 80.0 * (0.5 * elapsed.as_secs_f64()).sin();
            let _ = self.session.cycle();
            if said.elapsed() > Duration::from_millis(100) {
                said = Instant::now();
                self.speak(elapsed.as_secs_f64());
            }
            std::thread::sleep(Duration::from_micros(600));
        }
    }

    fn speak(&mut self, t: f64) {
        let mut lines = format!("{{\"sensor\": \"spindle\", \"t_s\": {t}, \"speed_rpm\": {}}}\n", self.rpm);
        if self.there {
            let [guide, nose] = self.degc;
            lines +=
                &format!("{{\"sensor\": \"box\", \"t_s\": {t}, \"temperature_degc\": [{guide}, {nose}]}}\n");
        }
        self.sensors.write_all(lines.as_bytes()).expect("sent");
    }

    /// What is applied, as errors that are taken out, um: X where the axis stands now, Z.
    fn taken_out_um(&self) -> [f64; 2] {
        [-1e3 * (self.session.applied[0] + EXX_MM), -1e3 * self.session.applied[2]]
    }

    /// Waits until what is taken out is this: a strain of X, the growth of Z.
    fn settle(&mut self, strain_um_per_m: f64, growth_um: f64, daemon: &Daemon) {
        let begin = Instant::now();
        loop {
            self.work(Duration::from_millis(200));
            let wanted = [strain_um_per_m * 1e-3 * (self.session.commanded[0] - 100.0), growth_um];
            let found = self.taken_out_um();
            if (0..2).all(|k| (found[k] - wanted[k]).abs() < 0.8) {
                return;
            }
            assert!(begin.elapsed() < 2 * PATIENCE, "{found:?}, not {wanted:?}; {}", daemon.status());
        }
    }
}

fn growth(daemon: &Daemon, name: &str) -> serde_json::Value {
    let status = daemon.status();
    let all = status["growths"].as_array().expect("a list");
    all.iter().find(|g| g["name"] == name).expect("listed").clone()
}

#[test]
fn temperatures_and_speeds_on_a_sensor_link_move_the_axes() {
    let port = Port::open();
    let (address, more) = tables();
    let mut daemon =
        Daemon::start(&port.address(), Setup { more, model: MODEL.to_owned(), ..Setup::default() });
    let mut shop = Shop::open(&port, &address);
    assert_eq!(growth(&daemon, "spindle-z")["state"], "waiting");
    shop.settle(0.0, 0.0, &daemon);
    // warm: 5 K at the nose, 8 K at the guide, 3000/min
    (shop.degc, shop.rpm) = ([28.0, 25.0], 3000.0);
    shop.settle(80.0, 10.0 - 3.0, &daemon);
    let spindle = growth(&daemon, "spindle-z");
    assert_eq!(
        (&spindle["state"], &spindle["unit"], &spindle["std"]),
        (&"used".into(), &"um".into(), &2.0.into())
    );
    let scale = growth(&daemon, "scale-x");
    assert_eq!(scale["unit"], "um/m");
    assert!((scale["value"].as_f64().expect("a number") - 80.0).abs() < 0.5, "{scale}");

    // half way out of what the fit has seen: 2.5 K of 25 % of 10 K would be all, 1.25 K is half
    shop.degc[1] = 31.25;
    shop.settle(80.0, 0.5 * (22.5 - 3.0), &daemon);
    let spindle = growth(&daemon, "spindle-z");
    assert_eq!((&spindle["state"], &spindle["code"]), (&"outside".into(), &"VC-8014".into()), "{spindle}");
    assert_eq!(spindle["input"], "box.2");
    daemon.wait_for_log("VC-8014");
    let text = daemon.volcomp(&["status"]);
    let text = String::from_utf8_lossy(&text.stdout).into_owned();
    assert!(text.contains("box.2 is outside of what the fit has seen"), "{text}");

    // a box that falls silent leaves its last word for a minute
    shop.degc[1] = 25.0;
    shop.settle(80.0, 7.0, &daemon);
    shop.there = false;
    shop.work(Duration::from_secs(3));
    let spindle = growth(&daemon, "spindle-z");
    assert_eq!((&spindle["state"], &spindle["code"]), (&"lost".into(), &"VC-8015".into()), "{spindle}");
    shop.settle(80.0, 7.0, &daemon);
    shop.there = true;
    shop.work(Duration::from_secs(1));
    drop(shop);

    // lags go on after a restart
    daemon.signal(Signal::TERM);
    assert!(daemon.wait().success());
    let kept = fs::read_to_string(daemon.dir.path().join("state/live.json")).expect("kept");
    assert!(kept.contains("spindle-z"), "{kept}");
    daemon.restart();
    daemon.wait_for_log("the map saved at");
}

#[test]
fn check_names_inputs_that_nobody_measures() {
    let port = Port::open();
    let (_, more) = tables();
    let missing = more.replace("name = \"spindle\"", "name = \"spindel\"");
    let model = MODEL.to_owned();
    let setup = Setup { more: Box::leak(missing.into_boxed_str()), model, ..Setup::default() };
    let daemon = Daemon::start(&port.address(), setup);
    let config = daemon.dir.path().join("machine.toml");
    let check = |config: &std::path::Path| {
        let done = std::process::Command::new(env!("CARGO_BIN_EXE_volcomp"))
            .arg("check")
            .arg(config)
            .output()
            .expect("volcomp runs");
        String::from_utf8_lossy(&done.stdout).into_owned() + &String::from_utf8_lossy(&done.stderr)
    };
    let said = check(&config);
    assert!(
        said.contains("thermal spindle-z depends on \"spindle\"") && said.contains("kind = \"speed\""),
        "{said}"
    );
    let text = fs::read_to_string(&config).expect("readable");
    let at = text.find("[sensors]").expect("listed");
    fs::write(&config, &text[..at]).expect("written");
    let said = check(&config);
    assert!(
        said.contains("thermal scale-x, spindle-z stays zero")
            || said.contains("thermal spindle-z, scale-x stays zero"),
        "{said}"
    );
}
