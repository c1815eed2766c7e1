//! What the daemon says about itself: the object that `volcomp status --json` prints.
//!
//! Keys that scripts rely on: `state model_hash machine cycles late_cycles age_us_p50 age_us_p99 roundtrip_us_p50
//! roundtrip_us_p99 correction_um limited faults sensors`. Keys may be added, never taken away. Percentiles are
//! over the present link (or the last one) and `null` before its first cycle.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::benefit::BenefitStatus;
use super::health::Health;
use super::recent::{EventStatus, RecentStatus};
use super::sensor_status::{MapStatus, SensorStatus, ThermalDisplacementStatus};

/// State of the daemon.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Status {
    /// `disconnected`, or the engine's state: `off armed ramping-in active holding ramping-out faulted`.
    pub state: String,
    /// Whether compensation is wanted (by the operator or the configuration).
    pub enabled: bool,
    /// Machine id.
    pub machine: String,
    /// The model file.
    pub model: String,
    /// BLAKE3 of the model file.
    pub model_hash: String,
    /// Version of the daemon.
    pub version: String,
    /// Process id.
    pub pid: u32,
    /// Time since the daemon was started, s.
    pub uptime_s: f64,
    /// The link to the control.
    pub link: LinkStatus,
    /// Position frames handled since the start.
    pub cycles: u64,
    /// Of these: answered more than one cycle after the sample, or not answered because a newer one was there.
    pub late_cycles: u64,
    /// Of the late ones: not answered.
    pub skipped_cycles: u64,
    /// Age of the position when its correction left, relative to the quickest frame of the last 10 to 20 s, us.
    pub age_us_p50: Option<f64>,
    /// 99th percentile of the same, us.
    pub age_us_p99: Option<f64>,
    /// From a frame's bytes in hand to its correction handed to the kernel, us.
    pub roundtrip_us_p50: Option<f64>,
    /// 99th percentile of the same, us.
    pub roundtrip_us_p99: Option<f64>,
    /// From a frame's bytes in hand to its correction computed, us.
    pub compute_us_p50: Option<f64>,
    /// 99th percentile of the same, us.
    pub compute_us_p99: Option<f64>,
    /// Of the late corrections: how much later than one cycle after the sample they left, us; `null` without any.
    pub lateness_us_p50: Option<f64>,
    /// 99th percentile of the same, us.
    pub lateness_us_p99: Option<f64>,
    /// Commanded position per linear axis, mm; empty without a link.
    #[serde(default)]
    pub position_mm: BTreeMap<String, f64>,
    /// Commanded position per rotary axis, deg; empty without a link.
    #[serde(default)]
    pub position_deg: BTreeMap<String, f64>,
    /// Offset asked for per linear axis, um; empty without a link.
    pub correction_um: BTreeMap<String, f64>,
    /// Offset asked for per rotary axis, arcsec; empty without a link.
    pub correction_arcsec: BTreeMap<String, f64>,
    /// Offset read back per linear axis, um.
    pub applied_um: BTreeMap<String, f64>,
    /// Offset read back per rotary axis, arcsec.
    pub applied_arcsec: BTreeMap<String, f64>,
    /// Axes whose offset is limited in size, rate or acceleration.
    pub limited: Vec<String>,
    /// Axes above their warning limit.
    pub warning: Vec<String>,
    /// Axes outside the travel or a curve's range of the model.
    pub out_of_range: Vec<String>,
    /// Axes whose offset has stayed away from the correction for longer than its limits explain.
    #[serde(default)]
    pub lagging: Vec<String>,
    /// Axes that the machine file does not list and of which the control holds an offset.
    #[serde(default)]
    pub unlisted: Vec<String>,
    /// Control cycles from a position to the effect of its correction, measured from the read-back; `null` where it could
    /// not be told (a read-back coarser than what the offset changes in a cycle).
    #[serde(default)]
    pub lag_cycles: Option<u32>,
    /// Bits of the machine's state that are set: `homed enabled estop moving offset-limited offset-ramping-out`.
    pub machine_state: Vec<String>,
    /// Share of the correction that is applied, 0 to 1, as ordered.
    #[serde(default)]
    pub gain: f64,
    /// Which model is used, by whose choice.
    #[serde(default)]
    pub model_choice: ModelStatus,
    /// What speaks against compensating now: code and words.
    #[serde(default)]
    pub hindrances: Vec<String>,
    /// Why compensation does not begin by itself although `start = "on-connect"`; lifted by an operator's enable.
    #[serde(default)]
    pub start_inhibit: Option<String>,
    /// Temperature of the machine as stated, degrees Celsius.
    #[serde(default)]
    pub temperature_degc: Option<f64>,
    /// Shadow mode, where it is on.
    #[serde(default)]
    pub shadow: Option<ShadowStatus>,
    /// Faults that are latched now.
    pub faults: Vec<Fault>,
    /// Sensors: how each stands, how noisy it is, whether it agrees.
    pub sensors: Vec<SensorStatus>,
    /// Maps that are learned, without their nodes (`volcomp filter show` has these).
    #[serde(default)]
    pub maps: Vec<MapStatus>,
    /// Thermal displacements that the model takes from temperatures and speeds.
    #[serde(default)]
    pub growths: Vec<ThermalDisplacementStatus>,
    /// What should be known about live estimation.
    #[serde(default)]
    pub sensor_notes: Vec<String>,
    /// Readings that found the estimator's queue full.
    #[serde(default)]
    pub readings_dropped: u64,
    /// Messages of sensors that were answered with an error.
    #[serde(default)]
    pub readings_refused: u64,
    /// Records lost: those of the recording that found its queue or the disk full, and those of the statistics.
    pub records_dropped: u64,
    /// Log reports that found their queue full.
    pub reports_dropped: u64,
    /// Real-time settings.
    pub realtime: RealtimeStatus,
    /// The recording of every cycle; `null` where none is asked for.
    #[serde(default)]
    pub recording: Option<RecordingStatus>,
    /// Counters that outlive the daemon; since the start of this daemon where they cannot be kept.
    #[serde(default)]
    pub lifetime: Lifetime,
    /// Time since the state was entered, s.
    #[serde(default)]
    pub state_since_s: f64,
    /// Why the state was entered, where the engine has said so.
    #[serde(default)]
    pub state_reason: Option<StateReason>,
    /// Why an enabled compensation waits or is held now; `null` while it follows the correction.
    #[serde(default)]
    pub waits_for: Option<StateReason>,
    /// Whether all is well, and what to do.
    #[serde(default)]
    pub health: Health,
    /// The last minute.
    #[serde(default)]
    pub recent: RecentStatus,
    /// The last events by number, the latest occurrence first.
    #[serde(default)]
    pub events: Vec<EventStatus>,
    /// Predicted error of the tool tip without and with compensation; `null` without a position.
    #[serde(default)]
    pub benefit: Option<BenefitStatus>,
    /// Which of the error motions the model covers.
    #[serde(default)]
    pub model_errors: ModelErrors,
    /// Warning threshold and limit of each axis that is corrected.
    #[serde(default)]
    pub limits: BTreeMap<String, AxisLimitStatus>,
}

/// Why a state was entered.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct StateReason {
    /// Its number.
    pub code: String,
    /// Its name.
    pub name: String,
    /// In one line.
    pub text: String,
    /// What a person can do.
    pub remedy: String,
    /// Axis, value and limit, where there are any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub numbers: Option<String>,
}

/// Which error motions, axis-to-axis and location errors a model covers.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ModelErrors {
    /// Symbols that the model has.
    pub symbols: Vec<String>,
    /// Of those that the chain of the machine has: covered.
    pub covered: usize,
    /// Those that the chain of the machine has: 6 per axis, 3 squarenesses of three linear axes, 4 location errors
    /// per rotary axis.
    pub possible: usize,
}

/// Warning threshold and limit of an axis; um for linear, arcsec for rotary axes.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct AxisLimitStatus {
    /// `um` or `arcsec`.
    pub unit: String,
    /// Offset from which a warning is given.
    pub warning: f64,
    /// Largest offset.
    pub limit: f64,
}

/// The recording of every cycle.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct RecordingStatus {
    /// The file being written; `null` before the first block and while the disk refuses.
    pub file: Option<String>,
    /// Records safe on the disk.
    pub records: u64,
    /// Records that found the queue or the disk full.
    pub records_dropped: u64,
    /// Bytes written.
    pub bytes: u64,
    /// Why nothing is recorded at the moment.
    pub error: Option<String>,
}

/// Counters that outlive the daemon.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Lifetime {
    /// When counting began, UTC.
    pub since: String,
    /// Starts of the daemon.
    pub starts: u64,
    /// Position frames handled.
    pub cycles: u64,
    /// Of these: late.
    pub late_cycles: u64,
    /// Times that compensation was switched on.
    pub enables: u64,
    /// Faults by their number or name.
    pub faults: BTreeMap<String, u64>,
    /// Time that the offset of an axis was limited, s.
    pub limited_s: BTreeMap<String, f64>,
    /// Largest offset asked for per linear axis, um.
    pub largest_um: BTreeMap<String, f64>,
    /// Largest offset asked for per rotary axis, arcsec.
    pub largest_arcsec: BTreeMap<String, f64>,
    /// Lines of the audit log of this run that the disk did not take.
    #[serde(default)]
    pub audit_lines_lost: u64,
    /// Where they are kept; `null` where nowhere.
    pub file: Option<String>,
    /// Why they are not kept, or what was wrong with those of before.
    pub note: Option<String>,
}

/// Which model is used, by whose choice.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct ModelStatus {
    /// Since when, RFC 3339 in UTC.
    pub since: String,
    /// Who chose it; `null` for the machine file.
    pub who: Option<String>,
    /// Why.
    pub why: Option<String>,
    /// Last day on which it should be used, where it states one.
    pub expiry: Option<String>,
    /// Day of its newest measurement, where it states one.
    #[serde(default)]
    pub date: Option<String>,
    /// Instruments of its measurements, where stated.
    #[serde(default)]
    pub instruments: Vec<String>,
    /// Temperatures of the machine for which it may be used (`[guard]`), degrees Celsius.
    #[serde(default)]
    pub temperature_degc: Option<[f64; 2]>,
    /// The model that `volcomp rollback` goes back to, and its hash.
    pub previous: Option<String>,
    /// Hash of that model.
    pub previous_hash: Option<String>,
    /// What should be known about the choice.
    pub notes: Vec<String>,
}

/// What compensation would have done, from shadow mode.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct ShadowStatus {
    /// The state that the engine would be in.
    pub state: String,
    /// Frames since it was switched on.
    pub cycles: u64,
    /// Of these: with the correction on.
    pub active_cycles: u64,
    /// Faults that would have been latched.
    pub faults: u64,
    /// Times the correction would have been held.
    pub interruptions: u64,
    /// Per axis, um or arcsec.
    pub axes: BTreeMap<String, ShadowAxis>,
}

/// One axis in shadow mode; um for linear, arcsec for rotary axes.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct ShadowAxis {
    /// `um` or `arcsec`.
    pub unit: String,
    /// RMS of the correction that the model asks for.
    pub before_rms: f64,
    /// Largest of it.
    pub before_max: f64,
    /// RMS of what ramps, limits and fading would leave of it.
    pub after_rms: f64,
    /// Largest of it.
    pub after_max: f64,
    /// Cycles in which the offset would have been limited.
    pub limited_cycles: u64,
}

/// A latched fault.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Fault {
    /// Its number, e.g. `VC-4001`; `volcomp explain` knows more.
    #[serde(default)]
    pub code: String,
    /// Its name, e.g. `read-back`.
    pub reason: String,
    /// In words.
    pub text: String,
    /// Axis, value and limit in words, where there are any: `x: 0.31 mm, limit 0.1 mm`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub numbers: Option<String>,
    /// Time since it came up, s.
    pub age_s: f64,
}

/// The link to the control.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct LinkStatus {
    /// Address of the control.
    pub address: String,
    /// Whether the link is up.
    pub up: bool,
    /// Whether it is mutual TLS; plain TCP where not.
    #[serde(default)]
    pub tls: bool,
    /// Program and version of the control, from its hello.
    pub control: Option<String>,
    /// Axis letters in wire order.
    pub axes: Vec<String>,
    /// Interval between position frames, s.
    pub cycle_s: f64,
    /// Time since the link came up or went down, s.
    pub since_s: f64,
    /// Links that have come up since the start.
    pub links: u64,
    /// Why there is no link, while there is none.
    pub error: Option<String>,
    /// Number of that cause.
    #[serde(default)]
    pub error_code: Option<String>,
    /// Mean time from reading positions to their arrival, us; only with `interface = "read-write"`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub read_us: Option<f64>,
    /// Mean time from writing an offset to its confirmation, us; only with `interface = "read-write"`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub write_us: Option<f64>,
}

/// What the system granted; `not asked for`, `yes`, or `refused: ...`.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct RealtimeStatus {
    /// SCHED_FIFO.
    pub fifo: String,
    /// Processor affinity.
    pub affinity: String,
    /// Memory lock.
    pub memory_lock: String,
}
