//! Sensors that talk to a real `volcompd`: what they teach reaches the axes, the status, the recording and the disk.

#![allow(clippy::expect_used, clippy::disallowed_methods, reason = "a test program: it fails by panicking")]

use std::fs;
use std::io::{BufRead, BufReader, Write};
use std::net::{TcpListener, TcpStream};
use std::process::Command;
use std::time::{Duration, Instant};

use crate::support::{Daemon, EXX_MM, PATIENCE, Port, Session, Setup, eventually};
use rustix::process::Signal;

const MODEL: &str = r#"
format = "volcomp-model/1"
machine = "test-mill"
chain = "[w X' b Y Z t]"
[errors.exx.constant]
value-um = 10.0
[errors.exz.live]
sensor = "ram.exz"
limit-um = 40
[errors.eyz.live]
sensor = "ram.eyz"
limit-um = 40
[errors.ezz.live]
sensor = "growth"
limit-um = 30
"#;

/// What the sensors of every kind tell, beside that.
const EVERY_KIND: &str = r#"
[axes.y]
travel-mm = [-100, 100]
[errors.exy.table]
position-mm = [-100, 0, 100]
value-um = [12, 0, 12]
[errors.exy.live]
sensor = "laser.exy"
limit-um = 40
[errors.eaz.live]
sensor = "tilt"
limit-arcsec = 10
"#;

/// What the ram is off by and the model does not know, mm.
const RAM_MM: f64 = 0.020;
/// What the spindle has grown by, mm.
const GROWTH_MM: f64 = 0.008;

/// Tables of the machine file, with a port that is free.
pub(crate) fn tables() -> (String, &'static str) {
    let port = TcpListener::bind("127.0.0.1:0").expect("a port").local_addr().expect("address");
    let text = format!(
        "[recording]\ndirectory = \"rec\"\nflush-ms = 50.0\n[state]\ndirectory = \"state\"\n\
         [sensors]\nlisten = \"{port}\"\nkeep-s = 1\n\
         [[map]]\nname = \"ram\"\nx-mm = [-100, 0, 100]\ny-mm = [-100, 100]\nz-mm = [-100, 100]\nlimit-um = 30\n\
         [[sensor]]\nname = \"tracker\"\nkind = \"tool\"\nstd-um = 3\nacquaintance = 10\nreturn-s = 0.3\n\
         [[sensor]]\nname = \"growth\"\nkind = \"value\"\n[[sensor]]\nname = \"air\"\nkind = \"temperature\"\n"
    );
    (port.to_string(), Box::leak(text.into_boxed_str()))
}

/// The same with a sensor of every kind.
fn every_kind() -> (String, Setup) {
    let (port, more) = tables();
    let text = format!(
        "{more}[[sensor]]\nname = \"laser\"\nkind = \"five-dof\"\naxis = \"y\"\nsmooth-s = 0.02\nage-limit-ms = 200\n\
         focal-mm = [230, 250, 210]\nbeam-1-mm = [-35, 8]\nbeam-2-mm = [33, 8]\n\
         [[sensor]]\nname = \"tilt\"\nkind = \"value\"\n[[sensor]]\nname = \"spindle\"\nkind = \"speed\"\n"
    );
    let setup = Setup {
        more: Box::leak(text.into_boxed_str()),
        model: format!("{MODEL}{EVERY_KIND}"),
        ..Setup::default()
    };
    (port, setup)
}

pub(crate) fn setup(more: &'static str) -> Setup {
    Setup { more, model: MODEL.to_owned(), ..Setup::default() }
}

/// Control, daemon and sensors, in real time.
pub(crate) struct Shop {
    session: Session,
    sensors: TcpStream,
    begin: Instant,
    /// Where the control's clock began.
    control_ns: i64,
    readings: u32,
    pub(crate) tracker: bool,
    /// What the tracker is wrong by, um.
    bias_um: f64,
    /// What the laser along Y sees of the straightness, um, as a function of Y; `None`: it says nothing.
    laser: Option<fn(f64) -> f64>,
    /// Share of the usual speed.
    pace: f64,
    /// Largest change of the offset in X from one cycle to the next, mm.
    step_mm: f64,
}

impl Shop {
    pub(crate) fn open(port: &Port, address: &str) -> Self {
        let mut sensors = None;
        assert!(eventually(|| {
            sensors = TcpStream::connect(address).ok();
            sensors.is_some()
        }));
        let session = port.link();
        session.stream.set_nodelay(true).expect("option");
        let control_ns = session.control_ns;
        let sensors = sensors.expect("sensors connect");
        Self {
            session,
            sensors,
            begin: Instant::now(),
            control_ns,
            readings: 0,
            tracker: true,
            bias_um: 0.0,
            laser: None,
            pace: 1.0,
            step_mm: 0.0,
        }
    }

    /// Cycles in real time for so long, a reading of each sensor every 10 ms.
    pub(crate) fn work(&mut self, time: Duration) {
        let until = Instant::now() + time;
        while Instant::now() < until {
            let elapsed = self.begin.elapsed();
            self.session.control_ns = self.control_ns + i64::try_from(elapsed.as_nanos()).expect("fits");
            let t = elapsed.as_secs_f64();
            let phase = self.pace * t;
            self.session.commanded[0] = 80.0 * (1.3 * phase).sin();
            self.session.commanded[1] = 80.0 * (1.7 * phase).sin();
            self.session.commanded[2] = 80.0 * (0.9 * phase).sin();
            let before = self.session.applied[0];
            let _ = self.session.cycle();
            self.step_mm = self.step_mm.max((self.session.applied[0] - before).abs());
            if t > 0.01 * f64::from(self.readings) {
                self.readings += 1;
                self.speak(t);
            }
            std::thread::sleep(Duration::from_micros(600));
        }
    }

    /// What is measured: the error of the machine and the offset that was applied.
    fn speak(&mut self, t: f64) {
        // even noise without any memory
        let noise = 2.0 * ((f64::from(self.readings) * 12.9898).sin() * 43_758.545_3).rem_euclid(1.0) - 1.0;
        let x_um = 1e3 * (EXX_MM + RAM_MM + self.session.applied[0]) + self.bias_um + 5.0 * noise;
        let quiet = 0.1 * noise;
        let mut lines = format!(
            "{{\"sensor\": \"growth\", \"t_s\": {t}, \"value_um\": {}}}\n\
             {{\"sensor\": \"air\", \"t_s\": {t}, \"temperature_degc\": [20.5]}}\n",
            1e3 * GROWTH_MM + quiet,
        );
        if self.tracker {
            lines += &format!(
                "{{\"sensor\": \"tracker\", \"t_s\": {}, \"deviation\": {{\"direction\": [1, 0, 0], \"value_um\": {x_um}}}}}\n",
                t + 777.0
            );
        }
        if let Some(sees) = self.laser {
            // its line and its zero are its own
            let y = self.session.commanded[1];
            let ez = sees(y) + 80.0 + 0.015 * y + quiet;
            lines += &format!(
                "{{\"sensor\": \"laser\", \"t_s\": {}, \"five_dof\": {{\"ey_um\": {quiet}, \"ez_um\": {ez}, \
                 \"ea_arcsec\": {quiet}, \"eb_arcsec\": {quiet}, \"ec_arcsec\": {quiet}}}}}\n",
                t + 4711.0
            );
        }
        self.sensors.write_all(lines.as_bytes()).expect("sent");
    }

    /// Cycles go on while something else is done.
    pub(crate) fn meanwhile<T: Send>(&mut self, what: impl FnOnce() -> T + Send) -> T {
        std::thread::scope(|scope| {
            let other = scope.spawn(what);
            while !other.is_finished() {
                self.work(Duration::from_millis(20));
            }
            other.join().expect("it ends")
        })
    }

    /// Works until a condition holds.
    pub(crate) fn until(&mut self, words: &str, mut holds: impl FnMut(&Self) -> bool) {
        let begin = Instant::now();
        while !holds(self) {
            assert!(begin.elapsed() < 4 * PATIENCE, "{words}");
            self.work(Duration::from_millis(50));
        }
    }

    fn off(&self) -> [f64; 2] {
        [self.session.applied[0] + EXX_MM + RAM_MM, self.session.applied[2] + GROWTH_MM]
    }
}

pub(crate) fn named<'a>(status: &'a serde_json::Value, list: &str, name: &str) -> &'a serde_json::Value {
    let all = status[list].as_array().expect("a list");
    all.iter().find(|entry| entry["name"] == name).expect("listed")
}

#[test]
fn what_sensors_teach_reaches_axes_status_recording_and_disk() {
    let port = Port::open();
    let (address, more) = tables();
    let mut daemon = Daemon::start(&port.address(), setup(more));
    let mut shop = Shop::open(&port, &address);
    let begin = Instant::now();
    shop.work(Duration::from_millis(2500));
    while shop.off().iter().any(|off| off.abs() > 2.5e-3) {
        assert!(begin.elapsed() < 3 * PATIENCE, "{:?} {}", shop.off(), daemon.status());
        shop.work(Duration::from_millis(200));
    }
    let status = daemon.status();
    let tracker = named(&status, "sensors", "tracker");
    assert_eq!(tracker["state"], "good", "{tracker}");
    assert!(
        (tracker["clock_offset_s"].as_f64().expect("known")).abs() > 100.0,
        "its clock is its own: {tracker}"
    );
    assert_eq!(named(&status, "sensors", "air")["values"][0], 20.5);
    let map = named(&status, "maps", "ram");
    assert_eq!((&map["state"], map.get("nodes").is_none()), (&"learning".into(), true), "{map}");
    let text = daemon.volcomp(&["status"]);
    assert!(String::from_utf8_lossy(&text.stdout).contains("tracker (tool) good"), "{text:?}");
    // nodes and picture
    let picture = daemon.dir.path().join("filter.svg");
    let shown = daemon.volcomp(&["filter", "show", "--json", "--picture", picture.to_str().expect("text")]);
    let filter: serde_json::Value = serde_json::from_slice(&shown.stdout).expect("JSON");
    assert_eq!(filter["maps"][0]["nodes"].as_array().expect("nodes").len(), 12);
    assert!(fs::read_to_string(&picture).expect("drawn").contains("ram.exz"));

    // a tracker that falls silent is told by name; what was learned stays, and so does what others say
    shop.tracker = false;
    shop.work(Duration::from_millis(900));
    let status = daemon.status();
    let tracker = named(&status, "sensors", "tracker");
    assert_eq!((&tracker["state"], &tracker["cause"]), (&"excluded".into(), &"silent".into()), "{tracker}");
    assert_eq!(tracker["code"], "VC-8002");
    assert!(shop.off()[0].abs() < 3.5e-3 && shop.off()[1].abs() < 1.5e-3, "{:?}", shop.off());
    shop.tracker = true;
    shop.work(Duration::from_millis(900));
    assert_eq!(named(&daemon.status(), "sensors", "tracker")["state"], "good");
    drop(shop);
    daemon.signal(Signal::TERM);
    assert!(daemon.wait().success());

    // bit for bit the same from the recording
    let recording = fs::read_dir(daemon.dir.path().join("rec")).expect("folder").next().expect("a file");
    let replayed = Command::new(env!("CARGO_BIN_EXE_volcomp"))
        .arg("replay")
        .arg(recording.expect("entry").path())
        .output()
        .expect("volcomp runs");
    assert!(replayed.status.success(), "{}", String::from_utf8_lossy(&replayed.stdout));
    // what was learned goes on
    daemon.restart();
    daemon.wait_for_log("the map saved at");
    daemon.signal(Signal::TERM);
    let _ = daemon.wait();
    // and what is damaged is kept aside
    let state = daemon.dir.path().join("state");
    fs::write(state.join("live.json"), "{\"format\": \"volcomp-live/1\", ").expect("written");
    daemon.restart();
    daemon.wait_for_log("VC-8013");
    assert!(eventually(|| is_counted(&daemon.status(), "VC-8013")), "{}", daemon.status());
    let aside = fs::read_dir(&state).expect("folder").filter_map(Result::ok);
    assert!(aside.into_iter().any(|e| e.file_name().to_string_lossy().starts_with("live.json.damaged")));
}

/// Whether a number is among the warnings of the last minute and among the events.
pub(crate) fn is_counted(status: &serde_json::Value, code: &str) -> bool {
    let has = |list: &serde_json::Value| list.as_array().expect("a list").iter().any(|e| e["code"] == code);
    has(&status["recent"]["warnings"]) && has(&status["events"])
}

#[test]
fn what_is_wrong_with_a_map_is_counted_and_is_a_warning() {
    let port = Port::open();
    let (address, more) = tables();
    let more = more.replace("limit-um = 30", "limit-um = 6\nalarm-hold-s = 0.5");
    let daemon = Daemon::start(&port.address(), setup(Box::leak(more.into_boxed_str())));
    let mut shop = Shop::open(&port, &address);
    // the ram is off by more than the limit
    shop.until("the map is at its limit", |_| is_counted(&daemon.status(), "VC-8019"));
    // health is shown every 200 ms
    shop.until("the status says so", |_| daemon.status()["maps"][0]["limited"] == true);
    assert_eq!(daemon.status()["health"]["exit_code"], 1);
    // an exclusion of less than a second
    shop.tracker = false;
    shop.work(Duration::from_millis(600));
    shop.tracker = true;
    shop.until("a short silence is counted", |_| is_counted(&daemon.status(), "VC-8002"));
    shop.until("it is believed again", |_| named(&daemon.status(), "sensors", "tracker")["state"] == "good");
    shop.work(Duration::from_millis(800));
    // and a tracker that is suddenly wrong contradicts it, until it is given up
    shop.bias_um = 150.0;
    shop.until("the map is given up", |_| is_counted(&daemon.status(), "VC-8012"));
    let status = daemon.status();
    assert!(["VC-8010", "VC-8011"].iter().all(|code| is_counted(&status, code)), "{status}");
}

#[test]
fn what_is_no_reading_is_answered_and_costs_nothing_else() {
    let port = Port::open();
    let (address, more) = tables();
    let daemon = Daemon::start(&port.address(), setup(more));
    let shop = Shop::open(&port, &address);
    let mut stream = TcpStream::connect(&address).expect("connects");
    stream.set_read_timeout(Some(PATIENCE)).expect("option");
    stream
        .write_all(b"nonsense\n{\"sensor\": \"nobody\", \"t_s\": 1, \"value_um\": 1}\n{\"sensor\": \"growth\", \"t_s\": 1, \"value_um\": 1}\n")
        .expect("sent");
    let mut reader = BufReader::new(stream.try_clone().expect("a stream"));
    let mut answers = String::new();
    reader.read_line(&mut answers).expect("an answer");
    reader.read_line(&mut answers).expect("an answer");
    assert!(
        answers.contains("line 1") && answers.contains("nobody") && answers.contains("tracker"),
        "{answers}"
    );
    stream.write_all(b"VCS1\x08\x06\x01\x00AAAAAAAABBBBgrowthXXXXXXXXYYYY").expect("sent");
    let mut end = String::new();
    reader.read_line(&mut end).expect("an answer");
    assert!(end.contains("check sum"), "{end}");
    assert!(eventually(|| named(&daemon.status(), "sensors", "growth")["readings"] == 1));
    // another unit, another kind: answered, and the sensor is named
    let mut stream = TcpStream::connect(&address).expect("connects");
    stream.set_read_timeout(Some(PATIENCE)).expect("option");
    stream
        .write_all(b"{\"sensor\": \"growth\", \"t_s\": 2, \"value_arcsec\": 1}\n{\"sensor\": \"air\", \"t_s\": 1, \"speed_rpm\": 1}\n{\"sync\": 41}\n")
        .expect("sent");
    let mut reader = BufReader::new(stream);
    for words in ["value_um", "kind temperature", "{\"sync\":41}"] {
        let mut answer = String::new();
        reader.read_line(&mut answer).expect("an answer");
        assert!(answer.contains(words), "{answer}");
    }
    for sensor in ["growth", "air"] {
        assert!(eventually(|| named(&daemon.status(), "sensors", sensor)["code"] == "VC-8017"), "{sensor}");
    }
    // what nobody has, nobody forgets
    let forgotten = daemon.volcomp(&["filter", "forget", "rom"]);
    assert_eq!(forgotten.status.code(), Some(65), "{forgotten:?}");
    assert!(String::from_utf8_lossy(&forgotten.stderr).contains("unknown map \"rom\""), "{forgotten:?}");
    let forgotten = daemon.volcomp(&["filter", "forget", "ram", "--reason", "a test"]);
    assert!(forgotten.status.success(), "{forgotten:?}");
    drop(shop);
}

/// First cells of the rows of the first table in `text` whose head begins so, with everything in backticks or all of it.
fn first_cells(text: &str, head: &str) -> Vec<String> {
    let from = text.find(head).expect("the table is on the page");
    text[from..]
        .lines()
        .skip(2)
        .take_while(|line| line.starts_with("| "))
        .map(|line| line.split('|').nth(1).expect("a cell").trim().to_owned())
        .collect()
}

/// A binary message as the page describes it, written here by hand.
fn binary(kind: u8, name: &str, numbers: &[f64]) -> Vec<u8> {
    let mut bytes = b"VCS1".to_vec();
    bytes.push(kind);
    bytes.push(u8::try_from(name.len()).expect("short"));
    bytes.extend(u16::try_from(numbers.len()).expect("few").to_le_bytes());
    bytes.extend(5_000_000_000_i64.to_le_bytes());
    bytes.extend(1.0_f32.to_le_bytes());
    bytes.extend(name.as_bytes());
    numbers.iter().for_each(|v| bytes.extend(v.to_le_bytes()));
    let sum = crc32c::crc32c(&bytes);
    bytes.extend(sum.to_le_bytes());
    bytes
}

#[test]
fn every_key_and_kind_of_the_page_is_understood_and_no_other() {
    let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
    let page = fs::read_to_string(root.join("docs/how-to/sensors.md")).expect("the page");
    let samples = [
        ("pose", r#"{"tip_mm": [1, 2, 3], "direction": [0, 0, 1]}"#),
        ("points", r#"[{"offset_mm": [0, 0, 0], "deviation_um": [1, 2, 3], "std_um": 2}]"#),
        ("circles", r#"[{"height_mm": 20, "centre_mm": [1, 2, 3]}]"#),
        ("deviation", r#"{"direction": [0, 1, 0], "value_um": 3}"#),
        ("probe", r#"{"direction": [0, 1, 0], "value_um": 3, "std_um": 1}"#),
        ("five_dof", r#"{"ey_um": 1, "ez_um": 2, "ea_arcsec": 3, "eb_arcsec": 4, "ec_arcsec": 5}"#),
        (
            "five_dof_raw",
            r#"{"distance_mm": 500, "psd1_um": [1, 2], "psd2_um": [1, 2], "psd3_um": [1, 2], "qd1_um": [1, 2], "qd2_um": [1, 2]}"#,
        ),
        ("value_um", "1.5"),
        ("value_arcsec", "0.5"),
        ("temperature_degc", "[20.5, 21]"),
        ("speed_rpm", "-3000"),
    ];
    let keys: Vec<String> = first_cells(&page, "| key | content |")
        .iter()
        .flat_map(|cell| cell.split('`').skip(1).step_by(2).map(str::to_owned).collect::<Vec<_>>())
        .collect();
    assert_eq!(keys, samples.map(|(key, _)| key), "a key on the page or in this test is missing");
    let numbers: [(u8, Vec<f64>); 10] = [
        (1, vec![1.0, 2.0, 3.0, f64::NAN, f64::NAN, f64::NAN]),
        (2, vec![1e-3; 42]),
        (3, vec![1.0; 7]),
        (4, vec![0.0; 14]),
        (5, vec![1.0, 0.0, 0.0, 0.002, 0.0]),
        (6, vec![1e-3; 5]),
        (7, vec![500.0; 11]),
        (8, vec![0.001]),
        (9, vec![20.5; 16]),
        (10, vec![3000.0]),
    ];
    let kinds: Vec<u8> = first_cells(&page, "| kind | numbers")
        .iter()
        .flat_map(|cell| cell.split(", ").map(|k| k.parse().expect("a number")).collect::<Vec<u8>>())
        .collect();
    assert_eq!(kinds, numbers.each_ref().map(|(kind, _)| *kind));

    let port = Port::open();
    let (address, setup) = every_kind();
    let _daemon = Daemon::start(&port.address(), setup);
    let shop = Shop::open(&port, &address);
    let mut stream = TcpStream::connect(&address).expect("connects");
    stream.set_read_timeout(Some(PATIENCE)).expect("option");
    let mut all = Vec::new();
    for (key, sample) in samples {
        let sensor = match key {
            "five_dof" | "five_dof_raw" => "laser",
            "value_um" => "growth",
            "value_arcsec" => "tilt",
            "temperature_degc" => "air",
            "speed_rpm" => "spindle",
            _ => "tracker",
        };
        all.extend(format!("{{\"sensor\": \"{sensor}\", \"t_s\": 5.5, \"{key}\": {sample}}}\n").bytes());
    }
    let example =
        page.lines().map(str::trim).find(|line| line.starts_with("{\"sensor\"")).expect("an example");
    all.extend(format!("{example}\n").bytes());
    for (kind, n) in &numbers {
        let sensor = match kind {
            6 | 7 => "laser",
            8 => "growth",
            9 => "air",
            10 => "spindle",
            _ => "tracker",
        };
        all.extend(binary(*kind, sensor, n));
    }
    all.extend(binary(11, "air", &[1.0]));
    stream.write_all(&all).expect("sent");
    // the first complaint is about the one that is not on the page
    let mut complaint = String::new();
    BufReader::new(stream).read_line(&mut complaint).expect("an answer");
    assert!(complaint.contains("kind 11") && complaint.contains("not known"), "{complaint}");
    drop(shop);
}

#[test]
fn a_laser_that_sees_another_straightness_is_followed_and_its_loss_ends_at_the_stored_curve() {
    let port = Port::open();
    let (address, setup) = every_kind();
    let daemon = Daemon::start(&port.address(), setup);
    let mut shop = Shop::open(&port, &address);
    (shop.tracker, shop.pace) = (false, 0.5);
    let stored = |y: f64| 0.12 * y.abs();
    // bent by another 8 um, which is neither offset nor slope
    let changed = |y: f64| 0.12 * y.abs() + 8.0 * (y / 40.0).sin();
    let off_um = |shop: &Shop, sees: fn(f64) -> f64| {
        1e3 * (shop.session.applied[0] + EXX_MM) + sees(shop.session.commanded[1])
    };
    // aligned to the stored curve first: nothing is added
    shop.laser = Some(stored);
    let referenced = || named(&daemon.status(), "sensors", "laser")["referenced"] == true;
    shop.until("the laser is aligned", |_| referenced());
    shop.work(Duration::from_millis(1000));
    assert!(off_um(&shop, stored).abs() < 1.0, "{}", off_um(&shop, stored));
    // all along the travel the correction follows what it sees
    shop.laser = Some(changed);
    shop.work(Duration::from_millis(800));
    let (mut largest, mut without) = (0.0f64, 0.0f64);
    for _ in 0..60 {
        shop.work(Duration::from_millis(100));
        largest = largest.max(off_um(&shop, changed).abs());
        without = without.max((changed(shop.session.commanded[1]) - stored(shop.session.commanded[1])).abs());
    }
    assert!(without > 6.0 && largest < 3.0, "{largest} um of {without} um");
    // where it drops out the stored curve is all there is, and nothing steps
    shop.step_mm = 0.0;
    shop.laser = None;
    shop.until("the laser is told to be silent", |_| {
        named(&daemon.status(), "sensors", "laser")["code"] == "VC-8002"
    });
    shop.work(Duration::from_millis(1500));
    for _ in 0..20 {
        shop.work(Duration::from_millis(50));
        assert!(off_um(&shop, stored).abs() < 1.0, "{}", off_um(&shop, stored));
    }
    assert!(shop.step_mm < 5e-4, "{} mm from one cycle to the next", shop.step_mm);
}

#[test]
fn a_connection_that_says_nothing_is_closed_with_a_word() {
    let port = Port::open();
    let (address, more) = tables();
    let more: &'static str =
        Box::leak(more.replace("keep-s = 1\n", "keep-s = 1\nidle-s = 1\n").into_boxed_str());
    let _daemon = Daemon::start(&port.address(), setup(more));
    let shop = Shop::open(&port, &address);
    let stream = TcpStream::connect(&address).expect("connects");
    stream.set_read_timeout(Some(PATIENCE)).expect("option");
    let mut reader = BufReader::new(stream);
    let mut text = String::new();
    reader.read_line(&mut text).expect("an answer");
    assert!(text.contains("nothing was said for 1 s") && text.contains("idle-s"), "{text}");
    assert_eq!(reader.read_line(&mut String::new()).expect("an end"), 0);
    drop(shop);
}

#[test]
fn a_model_without_live_values_leaves_the_sensors_listed_as_unused() {
    let port = Port::open();
    let (address, more) = tables();
    let daemon = Daemon::start(&port.address(), setup(more));
    let mut shop = Shop::open(&port, &address);
    shop.work(Duration::from_millis(300));
    let bare = &MODEL[..MODEL.find("[errors.exz.live]").expect("there")];
    let path = daemon.dir.path().join("bare.toml");
    fs::write(&path, bare).expect("written");
    let path = path.display().to_string();
    let loaded =
        shop.meanwhile(|| daemon.volcomp(&["load", &path, "--confirm", "A. Smith", "--reason", "a test"]));
    assert!(loaded.status.success(), "{}", String::from_utf8_lossy(&loaded.stderr));
    shop.until("the sensors are unused", |_| {
        let status = daemon.status();
        named(&status, "sensors", "tracker")["state"] == "unused"
            && named(&status, "maps", "ram")["state"] == "unused"
            && status["sensor_notes"].to_string().contains("VC-8020")
    });
    let text = daemon.volcomp(&["status"]);
    assert!(String::from_utf8_lossy(&text.stdout).contains("tracker (tool) unused (VC-8020)"), "{text:?}");
}

#[test]
fn an_estimator_that_does_not_keep_up_says_so_and_blames_no_sensor() {
    let port = Port::open();
    let (address, more) = tables();
    // as many nodes as a map may have with two components
    let list = |count: i32| (0..count).map(|k| (20 * k - 120).to_string()).collect::<Vec<_>>().join(", ");
    let large = more
        .replace("x-mm = [-100, 0, 100]", &format!("x-mm = [{}]", list(12)))
        .replace("y-mm = [-100, 100]", &format!("y-mm = [{}]", list(8)))
        .replace("z-mm = [-100, 100]", &format!("z-mm = [{}]", list(8)));
    // where many processes share a processor, a single pose takes the estimator longer than a value may be old by default
    let setup = Setup { live_max_age_ms: 5000.0, ..setup(Box::leak(large.into_boxed_str())) };
    let daemon = Daemon::start(&port.address(), setup);
    let mut shop = Shop::open(&port, &address);
    shop.work(Duration::from_millis(500));
    shop.tracker = false;
    let mut flood = TcpStream::connect(&address).expect("connects");
    let begin = Instant::now();
    let mut k = 0;
    // more poses than any computer can work into so many nodes
    while begin.elapsed() < Duration::from_millis(3000) {
        let t = shop.begin.elapsed().as_secs_f64() + 777.0;
        let lines: String = (0..40)
            .map(|_| {
                k += 1;
                let noise = (f64::from(k) * 12.9898).sin();
                format!(
                    "{{\"sensor\": \"tracker\", \"t_s\": {t}, \"pose\": {{\"tip_deviation_um\": [{noise}, {}, 0.1]}}}}\n",
                    -noise
                )
            })
            .collect();
        flood.write_all(lines.as_bytes()).expect("sent");
        shop.work(Duration::from_millis(10));
    }
    let status = daemon.status();
    assert!(status["sensor_notes"].to_string().contains("VC-8018"), "{status}");
    let skipped = named(&status, "sensors", "tracker")["skipped"].as_u64().expect("a count");
    assert!(skipped > 0, "{status}");
    for sensor in ["tracker", "growth", "air"] {
        let code = &named(&status, "sensors", sensor)["code"];
        assert!(code != "VC-8002" && code != "VC-8003", "{sensor}: {code}");
    }
    // what does not need the map goes on all the while
    assert!((shop.session.applied[2] + GROWTH_MM).abs() < 1.5e-3, "{}", shop.session.applied[2]);
    assert!(!daemon.log().contains("VC-8001"), "{}", daemon.log());
}
