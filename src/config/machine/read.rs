//! Reading the machine file: keys, ranges, defaults.

use crate::prelude::*;

use super::gateway::{read_mqtt, read_mtconnect};
use super::http::read_http;
use super::sensors::read_sensors;
use super::tls::{check_remote, read_tls};
use super::{
    AxisConfig, FORMAT, GuardConfig, Interface, LinkConfig, LogConfig, LogTarget, MachineConfig,
    NO_SOFT_LIMITS, Policy, RealtimeConfig, RecordingConfig, StartMode, StateConfig, StatusConfig, WhenFull,
};
use crate::diagnostic::figure;
use crate::reader::{self, Key};
use volcomp_engine::{
    AfterLoss, AxisLimits, EngineConfig, LAG_CYCLES_MAX, Lag, LimitTime, OutOfTravel, PositionSource,
    RestOffset,
};
use volcomp_units::axes::MAX_AXES;

/// The key table of machine files, by `section.key`; `axes.x` stands for any linear, `axes.c` for any rotary axis.
#[must_use]
pub fn known_keys() -> BTreeMap<String, Key> {
    // empty tables show what is required; written keys, the values of those that are not read without
    const SAMPLES: [&str; 2] = [
        "axes = {x = {}, c = {}}\nlink = {tls = {}}\nsensor = [{}]\nmap = [{}]",
        "machine = \"m\"\nmodel = \"m\"\naxes = {x = {}}\nlink.tls = {ca = \"\", certificate = \"\", key = \"\"}\n\
         sensor = [{name = \"a\"}]\nmap = [{name = \"m\", x-mm = [0], y-mm = [0], z-mm = [0]}]",
    ];
    reader::keys_of(&SAMPLES, |top, _| read(top))
}

pub(super) fn read(top: &Section<'_>) -> Option<MachineConfig> {
    if !crate::read_format(top, FORMAT) {
        return None;
    }
    let machine = crate::read_machine_id(top).map(|m| m.value.to_owned());
    top.require("model", "add model = \"model.toml\", a path seen from this file");
    let model = top.path("model", "the model file, seen from this file");
    let additions = read_additions(top);
    let link = read_link(&top.section("link"));
    let cycle_ms = link.as_ref().map_or(DEFAULT_CYCLE_MS, |l| l.cycle_s * 1e3);
    let is_remote = link.as_ref().is_some_and(LinkConfig::is_remote);
    let (start, engine) = top.read("engine", |engine| read_engine(engine, cycle_ms, is_remote));
    let axes = read_axes(top, cycle_ms / 1e3);
    let realtime = top.read("realtime", read_realtime);
    let status = top.read("status", read_status);
    let log = top.read("log", read_log);
    let recording = top.read("recording", read_recording);
    let state = top.read("state", |state| StateConfig { directory: read_directory(state) });
    let guard = top.read("guard", read_guard);
    let sensors = read_sensors(top);
    if sensors.lock_step && is_remote {
        let general = top.section("sensors");
        general.report_at(
            general.value("time").map(|v| v.place).unwrap_or_default(),
            "sensors.time = \"control\" has each frame wait for the estimator, and the control is on another computer",
            "write \"computer\": only a simulated control on this computer can be in lock step with the estimator",
        );
    }
    let http = top.read("http", read_http);
    let mqtt = top.read("mqtt", read_mqtt);
    let mtconnect = top.read("mtconnect", read_mtconnect);
    top.finish();
    Some(MachineConfig {
        machine: machine?,
        model: model?,
        additions,
        link: link?,
        start,
        engine,
        axes,
        realtime,
        status,
        log,
        recording,
        state,
        guard,
        sensors,
        http,
        mqtt,
        mtconnect,
    })
}

fn read_additions(top: &Section<'_>) -> Vec<PathBuf> {
    let Some(paths) = top.texts("additions") else { return Vec::new() };
    for path in paths.value.iter().filter(|p| p.value.trim().is_empty()) {
        top.report_at(
            path.place.clone(),
            "an addition has an empty name",
            "write the paths of addition.toml files, seen from this file",
        );
    }
    paths.value.iter().map(|p| PathBuf::from(p.value)).collect()
}

const DEFAULT_ADDRESS: &str = "127.0.0.1:7878";
const DEFAULT_CYCLE_MS: f64 = 1.0;

/// `low <= v <= high`.
pub(super) const fn within(low: f64, high: f64) -> Allowed {
    Allowed::Within { low, high }
}

fn read_link(link: &Section<'_>) -> Option<LinkConfig> {
    let (address, place) = match link.text("address") {
        None => (DEFAULT_ADDRESS.parse().ok(), 0..0),
        Some(text) => (read_address(link, &text), text.place),
    };
    let tls = read_tls(link, address);
    let plain_remote = link.flag("plain-remote").unwrap_or(false);
    if let Some(value) = address {
        let secured = link.value("tls").is_some();
        check_remote(link, &Placed { value, place }, secured, plain_remote);
    }
    let reconnect = [
        link.number_or("reconnect-min-s", within(0.01, 3600.0), 0.2),
        link.number_or("reconnect-max-s", within(0.01, 3600.0), 10.0),
    ];
    at_least(link, "reconnect-max-s", reconnect[1], "reconnect-min-s", reconnect[0]);
    let heartbeat_s = link.number_or("heartbeat-s", within(0.02, 60.0), 0.5);
    let silence_s = link.number_or("silence-s", within(0.05, 600.0), 3.0);
    // one lost heartbeat is no silence
    at_least(link, "silence-s", silence_s, "twice heartbeat-s", 2.0 * heartbeat_s);
    let cycle_ms = link.number_or("cycle-ms", within(0.25, 10.0), DEFAULT_CYCLE_MS);
    let interface = read_interface(link, cycle_ms);
    let config = LinkConfig {
        address: address?,
        cycle_s: cycle_ms / 1e3,
        connect_timeout_s: link.number_or("connect-timeout-s", within(0.1, 300.0), 5.0),
        reconnect_s: reconnect,
        heartbeat_s,
        silence_s,
        tls: tls?,
        plain_remote,
        interface,
    };
    link.finish();
    Some(config)
}

fn read_interface(link: &Section<'_>, cycle_ms: f64) -> Interface {
    let calls = link.choice("interface", &[("frames", false), ("read-write", true)]).unwrap_or(false);
    let poll_ms = link.number("poll-ms", within(0.0, 100.0));
    match (calls, poll_ms) {
        (true, poll_ms) => Interface::ReadWrite { poll_s: poll_ms.map_or(cycle_ms, |n| n.value) / 1e3 },
        (false, Some(poll_ms)) => {
            link.report_at(
                poll_ms.place,
                "link.poll-ms is for controls that are read and written by calls",
                "add interface = \"read-write\" to [link], or leave poll-ms out",
            );
            Interface::Frames
        }
        (false, None) => Interface::Frames,
    }
}

fn read_address(link: &Section<'_>, text: &Placed<&str>) -> Option<SocketAddr> {
    text.value.parse::<SocketAddr>().ok().filter(|a| a.port() != 0).or_else(|| {
        link.refuse(
            text.place.clone(),
            format!("link.address \"{}\" is not an address with port", text.value),
            "write the number of the control and its port, for example \"192.168.0.10:7878\" or \"[::1]:7878\"",
        )
    })
}

/// Reports `key` where it is below what it must reach; both may be defaults.
fn at_least(section: &Section<'_>, key: &'static str, value: f64, floor: &str, least: f64) {
    if value < least {
        let place = section.value(key).map(|v| v.place).or(section.place());
        let message = format!("{} is {value}, below {floor} ({least})", section.named_key(key));
        let remedy = Some(format!("write at least {least}, or lower the other"));
        section.report(Diagnostic { span: place, message, remedy });
    }
}

fn read_engine(engine: &Section<'_>, cycle_ms: f64, is_remote: bool) -> (StartMode, EngineConfig) {
    let stale_ms = engine.number_or("stale-ms", within(0.5, 10_000.0), 20.0);
    at_least(engine, "stale-ms", stale_ms, "two cycles", 2.0 * cycle_ms);
    let starts = [StartMode::OnCommand, StartMode::OnConnect].map(|start| (start.name(), start));
    let start = engine.choice("start", &starts).unwrap_or_default();
    let config = EngineConfig {
        cycle_s: cycle_ms / 1e3,
        // a simulated control may run faster than real time, and is on this computer
        limit_time: engine
            .choice("limit-time", &[("control", LimitTime::Control), ("computer", LimitTime::Computer)])
            .unwrap_or(if is_remote { LimitTime::Computer } else { LimitTime::Control }),
        ramp_s: engine.number_or("ramp-s", within(0.01, 120.0), 2.0),
        stale_s: stale_ms / 1e3,
        hold_s: engine.number_or("hold-s", within(0.0, 60.0), 0.2),
        after_loss: engine
            .choice("after-loss", &[("latch", AfterLoss::Latch), ("resume", AfterLoss::Resume)])
            .unwrap_or_default(),
        gain: engine.number_or("gain", within(0.0, 1.0), 1.0),
        position_source: engine
            .choice(
                "position-source",
                &[("commanded", PositionSource::Commanded), ("actual", PositionSource::Actual)],
            )
            .unwrap_or_default(),
        out_of_travel: engine
            .choice("out-of-travel", &[("hold", OutOfTravel::Hold), ("ramp-out", OutOfTravel::RampOut)])
            .unwrap_or_default(),
        rest: engine
            .choice("rest", &[("zero", RestOffset::Zero), ("hold", RestOffset::Hold)])
            .unwrap_or_default(),
        read_back_cycles: engine.whole("read-back-cycles", 1, 10_000).map_or(10, |n| n.value),
        lag: engine
            .number("lag-cycles", within(0.0, LAG_CYCLES_MAX as f64))
            .map_or(Lag::Measured, |n| Lag::Cycles(n.value)),
        lag_uncertainty_cycles: engine.number_or("lag-uncertainty-cycles", within(0.0, 100.0), 0.5),
        live_max_age_s: engine.number_or("live-max-age-ms", within(1.0, 600_000.0), 500.0) / 1e3,
        ..EngineConfig::default()
    };
    (start, config)
}

/// Keys of an axis, in its unit, with the way inside.
struct AxisKeys {
    warning: &'static str,
    limit: &'static str,
    stop: &'static str,
    step: &'static str,
    soft: &'static str,
    rate: &'static str,
    acceleration: &'static str,
    jump: &'static str,
    /// Fastest motion, and its default, per minute.
    feed: (&'static str, f64),
    deadband: &'static str,
    tolerance: &'static str,
    kind: AxisKind,
    /// Largest offset that is no unit mistake.
    highest: f64,
}

static LINEAR: AxisKeys = AxisKeys {
    warning: "warning-um",
    limit: "limit-um",
    stop: "stop-um",
    step: "step-um",
    soft: "soft-limit-mm",
    rate: "rate-um-per-s",
    acceleration: "acceleration-um-per-s2",
    jump: "jump-mm",
    feed: ("feed-max-mm-per-min", 60_000.0),
    deadband: "reversal-deadband-um",
    tolerance: "read-back-tolerance-um",
    kind: AxisKind::Linear,
    highest: 5000.0,
};

static ROTARY: AxisKeys = AxisKeys {
    warning: "warning-arcsec",
    limit: "limit-arcsec",
    stop: "stop-arcsec",
    step: "step-arcsec",
    soft: "soft-limit-deg",
    rate: "rate-arcsec-per-s",
    acceleration: "acceleration-arcsec-per-s2",
    jump: "jump-deg",
    feed: ("feed-max-deg-per-min", 36_000.0),
    deadband: "reversal-deadband-arcsec",
    tolerance: "read-back-tolerance-arcsec",
    kind: AxisKind::Rotary,
    highest: 2000.0,
};

/// Share of the limit at which a warning is given where none is configured.
const DEFAULT_WARNING: f64 = 0.8;
/// Correction at which something must be wrong where no stop limit is configured, in limits.
const DEFAULT_STOP: f64 = 3.0;
/// Default of the largest plausible change of position per cycle: so many cycles at the fastest motion, because a control
/// may report a position late.
const DEFAULT_JUMP_CYCLES: f64 = 2.0;
const SECONDS_PER_MINUTE: f64 = 60.0;
/// Default of the travel after which a reversal counts, um or arcsec.
const DEFAULT_DEADBAND: f64 = 1.0;
/// Default of the step limit: so many cycles at the full rate.
const DEFAULT_STEP_CYCLES: f64 = 2.0;
/// Default of the tolerated difference between offset sent and read back, um or arcsec.
const DEFAULT_TOLERANCE: f64 = 0.5;

fn read_axes(top: &Section<'_>, cycle_s: f64) -> Vec<AxisConfig> {
    let axes = top.section("axes");
    let names = axes.names();
    if names.is_empty() && (axes.place().is_some() || top.value("axes").is_none()) {
        let message = "no axis has limits, so nothing could be corrected";
        axes.report_here(
            message,
            "add [axes.x] with limit-um, rate-um-per-s and acceleration-um-per-s2, and so on",
        );
    }
    if let Some(extra) = names.get(MAX_AXES) {
        let message = format!("{} axes, but the link carries {MAX_AXES}", names.len());
        axes.report_at(extra.place.clone(), message, "take some out");
    }
    names
        .iter()
        .filter_map(|name| {
            let axis = crate::axis_of_key(&axes, name)?;
            if axis == AxisName::S {
                let why = "axes.s: the spindle is never offset";
                return axes.refuse(name.place.clone(), why, "take [axes.s] out");
            }
            read_axis(axes.named(name)?, axis, cycle_s)
        })
        .collect()
}

fn read_axis(section: Section<'_>, name: AxisName, cycle_s: f64) -> Option<AxisConfig> {
    let keys = if name.kind().is_rotary() { &ROTARY } else { &LINEAR };
    let why = format!("axis {name} is {}", name.kind().name());
    let section =
        &section.because(keys.kind.offset_unit(), why.clone()).because(keys.kind.position_unit(), why);
    let [limit, rate, acceleration] =
        [(keys.limit, keys.highest), (keys.rate, 1e6), (keys.acceleration, 1e9)].map(|(key, high)| {
            section.require(key, &format!("add {key}: an axis without all its limits is never offset"));
            section.number(key, Allowed::Positive { high }).map(|n| n.value)
        });
    let warning = section.number(keys.warning, Allowed::Positive { high: keys.highest });
    let stop = section.number(keys.stop, Allowed::Positive { high: 1e6 });
    let tolerance = section.number(keys.tolerance, Allowed::Positive { high: 1000.0 });
    against_limit(section, keys, limit, [&warning, &stop, &tolerance]);
    let two_cycles = rate.map_or(f64::INFINITY, |rate| DEFAULT_STEP_CYCLES * rate * cycle_s);
    let step = section.number_or(keys.step, Allowed::Positive { high: keys.highest }, two_cycles);
    let soft = read_soft_limits(section, keys);
    let feed = section.number_or(keys.feed.0, Allowed::Positive { high: 1e7 }, keys.feed.1);
    let two_cycles = DEFAULT_JUMP_CYCLES * feed / SECONDS_PER_MINUTE * cycle_s;
    let jump = section.number_or(keys.jump, Allowed::Positive { high: 1000.0 }, two_cycles);
    let deadband = section.number_or(keys.deadband, within(0.0, 1000.0), DEFAULT_DEADBAND);
    section.finish();
    let limit = limit?;
    Some(AxisConfig {
        name,
        limits: AxisLimits {
            warning: keys.kind.offset_in(warning.map_or(DEFAULT_WARNING * limit, |w| w.value)),
            size: keys.kind.offset_in(limit),
            stop: keys.kind.offset_in(stop.map_or(DEFAULT_STOP * limit, |s| s.value)),
            step: keys.kind.offset_in(step),
            rate: keys.kind.offset_in(rate?),
            acceleration: keys.kind.offset_in(acceleration?),
        },
        jump_limit: keys.kind.position_in(jump),
        reversal_deadband: keys.kind.offset_in(deadband),
        read_back_tolerance: keys
            .kind
            .offset_in(tolerance.map_or(DEFAULT_TOLERANCE.min(0.5 * limit), |t| t.value)),
        soft_limits: soft,
    })
}

/// The warning lies below the limit, the stop above it; an offset applied twice, or with the wrong sign, leaves the tolerance.
fn against_limit(
    section: &Section<'_>,
    keys: &AxisKeys,
    limit: Option<f64>,
    [warning, stop, tolerance]: [&Option<Placed<f64>>; 3],
) {
    let Some(limit) = limit else { return };
    let unit = keys.kind.offset_unit();
    let wrong = |found: &Placed<f64>, key: &'static str, where_: &str, remedy: &str| {
        let message = format!(
            "{} is {} {unit}, {where_} {} ({limit} {unit})",
            section.named_key(key),
            found.value,
            keys.limit
        );
        section.report_at(found.place.clone(), message, remedy);
    };
    if let Some(warning) = warning.as_ref().filter(|w| w.value > limit) {
        wrong(warning, keys.warning, "above", "warn at or below the limit");
    }
    if let Some(stop) = stop.as_ref().filter(|s| s.value < limit) {
        wrong(stop, keys.stop, "below", "stop at or above the limit");
    }
    if let Some(tolerance) = tolerance.as_ref().filter(|t| t.value >= limit) {
        let remedy = "tolerate less than the limit, or no wrong offset is ever noticed; the resolution of the control is enough";
        wrong(tolerance, keys.tolerance, "not below", remedy);
    }
}

/// Soft limits in mm or rad.
fn read_soft_limits(section: &Section<'_>, keys: &AxisKeys) -> [f64; 2] {
    let Some(list) = section.fixed::<2>(keys.soft, "[lower, upper]") else { return NO_SOFT_LIMITS };
    lower_first(section, keys.soft, &list);
    list.value.map(|end| keys.kind.position_in(end))
}

/// Reports two ends in the wrong order.
fn lower_first(section: &Section<'_>, key: &str, ends: &Placed<[f64; 2]>) {
    let [low, high] = ends.value;
    if low >= high {
        let (key, low, high) = (section.named_key(key), figure(low), figure(high));
        let message = format!("{key} is [{low}, {high}]: the lower end is not below the upper");
        section.report_at(ends.place.clone(), message, "write the lower end first");
    }
}

fn read_realtime(realtime: &Section<'_>) -> RealtimeConfig {
    let priority = realtime.whole("priority", 0, 99).map_or(DEFAULT_PRIORITY, |n| n.value);
    RealtimeConfig {
        priority: u8::try_from(priority).ok().filter(|p| *p > 0),
        cpu: realtime.whole("cpu", 0, 1023).and_then(|n| u16::try_from(n.value).ok()),
        lock_memory: realtime.flag("lock-memory").unwrap_or(true),
        busy_poll_s: realtime.number_or("busy-poll-us", within(0.0, 10_000.0), 0.0) / 1e6,
    }
}

/// In the middle of the range: above ordinary real-time services, below the kernel's own threads.
const DEFAULT_PRIORITY: u32 = 40;

const DEFAULT_SOCKET: &str = "/run/volcomp/volcompd.sock";

fn read_status(status: &Section<'_>) -> StatusConfig {
    let path = status.text("socket").map_or(DEFAULT_SOCKET, |t| t.value);
    StatusConfig { socket: (!path.is_empty()).then(|| PathBuf::from(path)) }
}

/// Bytes in the megabyte of the keys that end in `-mb`.
const BYTES_PER_MB: u64 = 1_000_000;

/// A path, or nothing where it is left out or empty.
fn read_directory(section: &Section<'_>) -> Option<PathBuf> {
    section.text("directory").map(|t| t.value).filter(|path| !path.trim().is_empty()).map(PathBuf::from)
}

fn read_recording(recording: &Section<'_>) -> RecordingConfig {
    let megabytes = |key, low, high, default| recording.whole(key, low, high).map_or(default, |n| n.value);
    let file_mb = megabytes("file-max-mb", 1, 4000, 256);
    let total_mb = megabytes("total-max-mb", 1, 100_000_000, 4096);
    // the file being written is never deleted, so there must be room for one and what it follows
    at_least(recording, "total-max-mb", f64::from(total_mb), "twice file-max-mb", 2.0 * f64::from(file_mb));
    let when_full = [("stop", WhenFull::Stop), ("delete-oldest", WhenFull::DeleteOldest)];
    RecordingConfig {
        directory: read_directory(recording),
        file_bytes: u64::from(file_mb) * BYTES_PER_MB,
        file_s: recording.number_or("file-max-s", within(1.0, 604_800.0), 3600.0),
        total_bytes: u64::from(total_mb) * BYTES_PER_MB,
        when_full: recording.choice("when-full", &when_full).unwrap_or_default(),
        flush_s: recording.number_or("flush-ms", within(20.0, 1000.0), 500.0) / 1e3,
    }
}

/// Change of a model that needs no confirmation by default, um and arcsec.
const DEFAULT_CHANGE: [f64; 2] = [50.0, 20.0];

fn read_guard(guard: &Section<'_>) -> GuardConfig {
    let policies = [("warn", Policy::Warn), ("refuse", Policy::Refuse), ("ramp-out", Policy::RampOut)];
    let hash = guard.text("hash");
    if let Some(hash) = &hash
        && !(hash.value.len() == 64 && hash.value.bytes().all(|b| matches!(b, b'0'..=b'9' | b'a'..=b'f')))
    {
        guard.report_at(
            hash.place.clone(),
            format!("guard.hash \"{}\" is not a BLAKE3 hash", hash.value),
            "write the 64 hexadecimal digits that `volcomp check` prints for the model",
        );
    }
    let temperature = guard.fixed::<2>("temperature-degc", "[lowest, highest]");
    if let Some(ends) = &temperature {
        lower_first(guard, "temperature-degc", ends);
    }
    let change = |key, default| guard.number_or(key, within(0.0, 10_000.0), default);
    GuardConfig {
        change_limit: mm_from_um(change("change-limit-um", DEFAULT_CHANGE[0])),
        change_limit_angle: rad_from_arcsec(change("change-limit-arcsec", DEFAULT_CHANGE[1])),
        hash: hash.map(|h| h.value.to_owned()),
        expired: guard.choice("expired", &policies).unwrap_or_default(),
        temperature_degc: temperature.map(|t| t.value),
        temperature_max_age_s: 60.0 * guard.number_or("temperature-max-age-min", within(0.1, 10_000.0), 60.0),
        outside_temperature: guard.choice("outside-temperature", &policies).unwrap_or_default(),
    }
}

const LEVELS: [&str; 5] = ["error", "warn", "info", "debug", "trace"];

fn read_log(log: &Section<'_>) -> LogConfig {
    let targets =
        [("auto", LogTarget::Auto), ("journald", LogTarget::Journald), ("stderr", LogTarget::Stderr)];
    let target = log.choice("target", &targets).unwrap_or_default();
    let level = log.text("level");
    if let Some(level) = &level
        && !level.value.split(',').all(is_directive)
    {
        log.report_at(
            level.place.clone(),
            format!("log.level \"{}\" is not a filter", level.value),
            format!("write one of {}, or room=level pairs such as \"info,volcomp=debug\"", LEVELS.join(", ")),
        );
    }
    LogConfig { target, level: level.map_or("info", |l| l.value).to_owned() }
}

/// `level` or `room=level`.
fn is_directive(text: &str) -> bool {
    let (room, level) = text.trim().rsplit_once('=').unwrap_or(("", text.trim()));
    let named = room.chars().all(|c| c.is_ascii_alphanumeric() || "_:-".contains(c));
    named && (LEVELS.contains(&level.to_ascii_lowercase().as_str()) || level == "off")
}
