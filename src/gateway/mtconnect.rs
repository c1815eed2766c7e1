//! An MTConnect adapter: SHDR lines (`time|key|value`) over TCP for an agent, `* PING` answered with `* PONG`.
//!
//! Keys as in `config/monitoring/mtconnect-device.xml`. A client first gets all items, then those that change;
//! `UNAVAILABLE` where the daemon does not answer. Lengths mm, angles deg, as MTConnect has it.

use std::fmt::Write as _;
use std::time::{Duration, SystemTime};

use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::watch;
use tokio::task::JoinSet;
use tokio::time::timeout;
use volcomp_daemon::Status;
use volcomp_state::utc;

use super::Reading;

/// Agents at the same time; one too many is closed.
const CLIENTS: usize = 8;
/// Longest line of a client, bytes.
const LINE_MAX: usize = 256;
/// Time in which a client must take a line.
const PATIENCE: Duration = Duration::from_secs(10);
/// Interval that `PONG` promises: an agent closes a connection that is silent for twice as long, ms.
const HEARTBEAT_MS: u32 = 10_000;
/// Arcseconds in a degree.
const ARCSEC_PER_DEG: f64 = 3600.0;

/// The items that every machine has, in the order of the lines.
pub const ITEMS: [&str; 10] = [
    "vc_avail",
    "vc_state",
    "vc_enabled",
    "vc_gain",
    "vc_model",
    "vc_model_hash",
    "vc_tip_without",
    "vc_tip_with",
    "vc_late_share",
    "vc_temperature",
];
/// The condition.
pub const CONDITION: &str = "vc_health";

/// Key and value of every item; the condition is written as its fields.
fn items(reading: &Reading, axes: &[String]) -> Vec<(String, String)> {
    let unavailable = || "UNAVAILABLE".to_owned();
    let Some(status) = reading else {
        let mut all: Vec<(String, String)> = ITEMS.map(|key| (key.to_owned(), unavailable())).into();
        all.extend(axes.iter().map(|axis| (offset_key(axis), unavailable())));
        all.push((CONDITION.to_owned(), "UNAVAILABLE||||".to_owned()));
        return all;
    };
    let number =
        |value: Option<f64>| value.filter(|v| v.is_finite()).map_or_else(unavailable, |v| format!("{v:.7}"));
    let benefit = status.benefit.as_ref();
    let values = [
        "AVAILABLE".to_owned(),
        status.state.to_ascii_uppercase(),
        if status.enabled { "ON" } else { "OFF" }.to_owned(),
        number(Some(100.0 * status.gain)),
        plain(std::path::Path::new(&status.model).file_name().map_or("", |n| n.to_str().unwrap_or(""))),
        plain(&status.model_hash),
        number(benefit.map(|b| 1e-3 * b.without_um)),
        number(benefit.map(|b| 1e-3 * b.with_um)),
        number(status.recent.late_share.map(|share| 100.0 * share)),
        number(status.temperature_degc),
    ];
    let mut all: Vec<(String, String)> = ITEMS.map(str::to_owned).into_iter().zip(values).collect();
    for axis in axes {
        let linear = status.correction_um.get(axis).map(|um| 1e-3 * um);
        let rotary = status.correction_arcsec.get(axis).map(|arcsec| arcsec / ARCSEC_PER_DEG);
        all.push((offset_key(axis), number(linear.or(rotary))));
    }
    all.push((CONDITION.to_owned(), condition(status)));
    all
}

fn offset_key(axis: &str) -> String {
    format!("vc_{}_offset", axis.to_ascii_lowercase())
}

/// Axes that have an item: those of the last status with a link.
fn axes(reading: &Reading) -> Option<Vec<String>> {
    let status = reading.as_ref()?;
    let axes: Vec<String> =
        status.correction_um.keys().chain(status.correction_arcsec.keys()).cloned().collect();
    (!axes.is_empty()).then_some(axes)
}

/// Level, native code, native severity, qualifier, text.
fn condition(status: &Status) -> String {
    let health = &status.health;
    let level = match health.verdict.as_str() {
        "ok" => return "NORMAL||||".to_owned(),
        "warning" | "held" => "WARNING",
        _ => "FAULT",
    };
    let text = if health.cause.is_empty() { &health.verdict } else { &health.cause };
    format!("{level}|{}|{}||{}", plain(health.code.as_deref().unwrap_or("")), health.exit_code, plain(text))
}

/// Without what separates fields and lines.
fn plain(text: &str) -> String {
    text.chars().map(|c| if c == '|' || c.is_control() { ' ' } else { c }).collect()
}

/// What a client has been told.
#[derive(Debug, Default)]
struct Told {
    axes: Vec<String>,
    items: Vec<(String, String)>,
}

impl Told {
    /// Lines for what has changed.
    fn lines(&mut self, reading: &Reading, now: SystemTime) -> String {
        if let Some(axes) = axes(reading) {
            self.axes = axes;
        }
        let new = items(reading, &self.axes);
        let time = utc::text(now);
        let mut text = String::new();
        for (key, value) in new.iter().filter(|item| !self.items.contains(item)) {
            // writing into a string cannot fail
            let _ = writeln!(text, "{time}|{key}|{value}");
        }
        self.items = new;
        text
    }
}

/// Serves agents until `stopped`.
pub async fn serve(
    listener: TcpListener,
    readings: watch::Receiver<Reading>,
    mut stopped: watch::Receiver<bool>,
) {
    let mut clients = JoinSet::new();
    loop {
        tokio::select! {
            accepted = listener.accept() => match accepted {
                Ok((stream, _)) if clients.len() < CLIENTS => {
                    clients.spawn(client(stream, readings.clone()));
                }
                Ok(_) => {}
                // out of descriptors or the like: not in a busy loop
                Err(_) => tokio::time::sleep(Duration::from_secs(1)).await,
            },
            _ = clients.join_next(), if !clients.is_empty() => {}
            () = super::wish(&mut stopped) => return,
        }
    }
}

/// One agent; ends where it leaves, takes nothing for too long, or sends what is no line.
async fn client(mut stream: TcpStream, mut readings: watch::Receiver<Reading>) {
    let _ = stream.set_nodelay(true);
    let (mut reader, mut writer) = stream.split();
    let mut told = Told::default();
    let mut buffer = [0; LINE_MAX];
    let mut used = 0;
    let mut text = told.lines(&readings.borrow_and_update().clone(), SystemTime::now());
    loop {
        if !text.is_empty()
            && !matches!(timeout(PATIENCE, writer.write_all(text.as_bytes())).await, Ok(Ok(())))
        {
            return;
        }
        text.clear();
        tokio::select! {
            changed = readings.changed() => {
                if changed.is_err() {
                    return;
                }
                text = told.lines(&readings.borrow_and_update().clone(), SystemTime::now());
            }
            read = reader.read(&mut buffer[used..]) => {
                match read {
                    Ok(n) if n > 0 => used += n,
                    _ => return,
                }
                while let Some(end) = buffer[..used].iter().position(|b| *b == b'\n') {
                    if buffer[..end].trim_ascii() == b"* PING" {
                        let _ = writeln!(text, "* PONG {HEARTBEAT_MS}");
                    }
                    buffer.copy_within(end + 1..used, 0);
                    used -= end + 1;
                }
                if used == buffer.len() {
                    return;
                }
            }
        }
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use std::sync::Arc;

    use volcomp_daemon::EventStatus;

    use super::*;

    pub(crate) fn event(time: &str, code: &str) -> EventStatus {
        EventStatus { time: time.into(), code: code.into(), ..EventStatus::default() }
    }

    pub(crate) fn status() -> Status {
        let text = r#"{"state":"active","enabled":true,"machine":"m","model":"a|b.toml","model_hash":"d6","version":"0","pid":1,
            "uptime_s":1,"link":{"address":"a","up":true,"control":null,"axes":["X","C"],"cycle_s":0.001,"since_s":1,"links":1,
            "error":null},"cycles":1,"late_cycles":0,"skipped_cycles":0,"age_us_p50":null,"age_us_p99":null,
            "roundtrip_us_p50":null,"roundtrip_us_p99":null,"compute_us_p50":null,"compute_us_p99":null,
            "lateness_us_p50":null,"lateness_us_p99":null,"correction_um":{"X":12.5},"correction_arcsec":{"C":-7.2},
            "applied_um":{},"applied_arcsec":{},"limited":[],"warning":[],"out_of_range":[],"machine_state":[],
            "gain":0.5,"faults":[],"sensors":[],"records_dropped":0,"reports_dropped":0,
            "realtime":{"fifo":"","affinity":"","memory_lock":""},
            "health":{"verdict":"ok","exit_code":0,"code":null,"cause":"","remedy":""}}"#;
        let mut status: Status = serde_json::from_str(text).unwrap();
        status.events = vec![event("2026-11-24T10:00:00.000Z", "VC-3001")];
        status
    }

    #[test]
    fn all_items_first_then_what_changes() {
        let now = SystemTime::UNIX_EPOCH;
        let mut told = Told::default();
        let first = told.lines(&Some(Arc::new(status())), now);
        assert_eq!(first.lines().count(), ITEMS.len() + 3, "{first}");
        for line in [
            "1970-01-01T00:00:00.000Z|vc_avail|AVAILABLE",
            "1970-01-01T00:00:00.000Z|vc_state|ACTIVE",
            "1970-01-01T00:00:00.000Z|vc_gain|50.0000000",
            "1970-01-01T00:00:00.000Z|vc_model|a b.toml",
            "1970-01-01T00:00:00.000Z|vc_tip_with|UNAVAILABLE",
            "1970-01-01T00:00:00.000Z|vc_x_offset|0.0125000",
            "1970-01-01T00:00:00.000Z|vc_c_offset|-0.0020000",
            "1970-01-01T00:00:00.000Z|vc_health|NORMAL||||",
        ] {
            assert!(first.lines().any(|l| l == line), "{line} in\n{first}");
        }
        assert_eq!(told.lines(&Some(Arc::new(status())), now), "");
        let mut faulted = status();
        faulted.state = "faulted".into();
        faulted.health.verdict = "faulted".into();
        faulted.health.code = Some("VC-4001".into());
        faulted.health.exit_code = 4;
        faulted.health.cause = "read-back\nx | y".into();
        let next = told.lines(&Some(Arc::new(faulted)), now);
        assert_eq!(
            next,
            "1970-01-01T00:00:00.000Z|vc_state|FAULTED\n\
             1970-01-01T00:00:00.000Z|vc_health|FAULT|VC-4001|4||read-back x   y\n"
        );
    }

    #[test]
    fn nothing_is_available_without_the_daemon() {
        let mut told = Told::default();
        let _ = told.lines(&Some(Arc::new(status())), SystemTime::UNIX_EPOCH);
        let gone = told.lines(&None, SystemTime::UNIX_EPOCH);
        assert!(gone.lines().all(|l| l.contains("|UNAVAILABLE")), "{gone}");
        assert!(gone.contains("vc_x_offset|UNAVAILABLE") && gone.contains("vc_health|UNAVAILABLE||||"));
    }
}
