//! Collects the reports of the cycle thread into the status. Belongs to the service thread.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::AtomicI64;
use std::sync::atomic::Ordering::Relaxed;

use hdrhistogram::CreationError;

use super::channels::{CycleRecord, Progress};
use super::clock::Clock;
use super::handshake;
use super::latency::{Histograms, Latency, percentile_us};
use super::link_session::UNLISTED_MIN;
use super::load::Loaded;
use super::realtime::RealtimeReport;
use super::status::{
    AxisLimitStatus, Fault, LinkStatus, RealtimeStatus, ShadowAxis, ShadowStatus, StateReason, Status,
};
use volcomp_config::AxisConfig;
use volcomp_engine::fault::{self, Code, Entry};
use volcomp_engine::{Detail, Event, Quantity, Reason, ShadowScore, State};
use volcomp_model::ModelSpec;
use volcomp_protocol::{ControlHello, MachineState};
use volcomp_units::axes::{AxisKind, AxisName, MAX_AXES};
use volcomp_units::{MonoTime, NS_PER_S};

/// A latched fault.
#[derive(Debug, Clone)]
struct Latched {
    code: String,
    reason: &'static str,
    text: &'static str,
    numbers: Option<String>,
    since: MonoTime,
}

/// Everything known about the daemon's work.
#[derive(Debug)]
pub(super) struct StatusCollector {
    loaded: Arc<Loaded>,
    /// The model in use.
    spec: ModelSpec,
    progress: Arc<Progress>,
    clock: Clock,
    hello: Option<ControlHello>,
    up: bool,
    changed: MonoTime,
    links: u64,
    error: Option<(Code, String)>,
    entered: MonoTime,
    reason: Option<(&'static Entry, Option<String>)>,
    last: Option<CycleRecord>,
    latency: Latency,
    fault: Option<Latched>,
    realtime: RealtimeStatus,
}

impl StatusCollector {
    pub(super) fn new(
        loaded: Arc<Loaded>,
        progress: Arc<Progress>,
        clock: Clock,
    ) -> Result<Self, CreationError> {
        Ok(Self {
            spec: loaded.model.spec.clone(),
            loaded,
            progress,
            clock,
            hello: None,
            up: false,
            changed: clock.now(),
            links: 0,
            error: None,
            entered: clock.now(),
            reason: None,
            last: None,
            latency: Latency::new()?,
            fault: None,
            realtime: RealtimeStatus::default(),
        })
    }

    /// Another model is in use.
    pub(super) fn model(&mut self, spec: &ModelSpec) {
        self.spec = spec.clone();
    }

    pub(super) fn realtime(&mut self, report: &RealtimeReport) {
        self.realtime = report.status();
    }

    pub(super) fn link_up(&mut self, hello: &ControlHello) {
        self.hello = Some(*hello);
        self.up = true;
        self.changed = self.clock.now();
        self.links += 1;
        self.error = None;
        self.last = None;
        self.latency.reset();
    }

    pub(super) fn link_down(&mut self, code: Code, why: String) {
        self.up = false;
        self.changed = self.clock.now();
        self.error = Some((code, why));
    }

    pub(super) fn connect_failed(&mut self, code: Code, why: String) {
        self.error = Some((code, why));
    }

    pub(super) fn event(&mut self, event: &Event) {
        let Event::StateChanged { reason, detail, .. } = event;
        self.entered = self.clock.now();
        // in words at once: another model has another travel
        let numbers = self.numbers(detail.as_ref());
        let entry = fault::of_reason(*reason);
        self.reason = Some((entry, numbers.clone()));
        match event {
            Event::StateChanged { to: State::Faulted, .. } => {
                self.latch(entry.code.to_string(), entry.name, entry.text, numbers);
            }
            Event::StateChanged { .. } => self.fault = None,
        }
    }

    /// A fault of the run before is still latched, with its numbers as they were shown then.
    pub(super) fn latched_before(&mut self, code: &str, numbers: Option<String>) {
        let (name, text) = Code::parse(code)
            .and_then(Code::entry)
            .map_or(("unknown", "a fault of another version of volcomp"), |entry| (entry.name, entry.text));
        self.latch(code.to_owned(), name, text, numbers);
    }

    fn latch(&mut self, code: String, reason: &'static str, text: &'static str, numbers: Option<String>) {
        self.fault = Some(Latched { code, reason, text, numbers, since: self.clock.now() });
    }

    /// The newest answered cycle of the present link.
    pub(super) fn last(&self) -> Option<&CycleRecord> {
        self.last.as_ref().filter(|last| self.up && last.answered)
    }

    pub(super) fn record(&mut self, record: &CycleRecord) {
        self.last = Some(*record);
        if !record.answered {
            return;
        }
        self.latency.record(record, (self.loaded.config.link.cycle_s * NS_PER_S).round() as i64);
    }

    /// Every latency of the present link in full.
    pub(super) fn histograms(&self) -> Histograms {
        self.latency.histograms()
    }

    /// One line for `systemctl status`.
    pub(super) fn headline(&self) -> String {
        match (self.up, self.progress.state()) {
            (true, Some(state)) => format!(
                "{}, {} cycles, {} late",
                state.name(),
                self.progress.cycles.load(Relaxed),
                self.progress.late.load(Relaxed)
            ),
            _ => format!("disconnected, trying {}", self.loaded.config.link.address),
        }
    }

    /// The present state, as in [`Status`].
    pub(super) fn state(&self) -> &'static str {
        self.progress.state().map_or("disconnected", State::name)
    }

    pub(super) fn status(&self) -> Status {
        let now = self.clock.now();
        let last = self.last.filter(|_| self.up);
        let axes = self.axes();
        let asked =
            last.filter(|r| r.answered).map(|r| axis_maps(&axes, |k| axes[k].kind().offset_out(r.offset[k])));
        let applied = last.map(|r| axis_maps(&axes, |k| wire(axes[k], r.applied[k])));
        let position = last.map(|r| axis_maps(&axes, |k| r.position[k]));
        let (position_mm, position_deg) = position.unwrap_or_default();
        let (correction_um, correction_arcsec) = asked.unwrap_or_default();
        let (applied_um, applied_arcsec) = applied.unwrap_or_default();
        let letters = |bits: u8| -> Vec<String> {
            axes.iter().enumerate().filter(|(k, _)| bits >> k & 1 == 1).map(|(_, a)| letter(*a)).collect()
        };
        Status {
            state: self.state().to_owned(),
            enabled: self.progress.wanted.load(Relaxed),
            machine: self.loaded.config.machine.clone(),
            model: self.loaded.model.origin.clone(),
            model_hash: self.loaded.model.hash.clone(),
            version: env!("CARGO_PKG_VERSION").to_owned(),
            pid: std::process::id(),
            uptime_s: now.seconds_since(MonoTime::ZERO),
            link: self.link_status(now),
            cycles: self.progress.cycles.load(Relaxed),
            late_cycles: self.progress.late.load(Relaxed),
            skipped_cycles: self.progress.skipped.load(Relaxed),
            age_us_p50: percentile_us(&self.latency.age, 50.0),
            age_us_p99: percentile_us(&self.latency.age, 99.0),
            roundtrip_us_p50: percentile_us(&self.latency.turnaround, 50.0),
            roundtrip_us_p99: percentile_us(&self.latency.turnaround, 99.0),
            compute_us_p50: percentile_us(&self.latency.compute, 50.0),
            compute_us_p99: percentile_us(&self.latency.compute, 99.0),
            lateness_us_p50: percentile_us(&self.latency.lateness, 50.0),
            lateness_us_p99: percentile_us(&self.latency.lateness, 99.0),
            position_mm,
            position_deg,
            correction_um,
            correction_arcsec,
            applied_um,
            applied_arcsec,
            limited: letters(last.map_or(0, |r| r.limited)),
            warning: letters(last.map_or(0, |r| r.warning)),
            out_of_range: letters(last.map_or(0, |r| r.out_of_range)),
            unlisted: self.unlisted().into_iter().map(letter).collect(),
            lagging: letters(last.map_or(0, |r| r.lagging)),
            lag_cycles: last.and_then(|r| r.lag_cycles),
            machine_state: last.map_or_else(Vec::new, |r| machine_state(r.machine_state)),
            faults: self.faults(now),
            records_dropped: self.progress.records_dropped.load(Relaxed),
            reports_dropped: self.progress.reports_dropped.load(Relaxed),
            realtime: self.realtime.clone(),
            state_since_s: now.seconds_since(if self.up {
                self.entered.max(self.changed)
            } else {
                self.changed
            }),
            state_reason: self
                .reason
                .as_ref()
                .filter(|_| self.up)
                .map(|(entry, numbers)| StateReason::new(entry, numbers.clone())),
            waits_for: self.waits_for(),
            limits: self.limits(),
            // the service knows the rest
            ..Status::default()
        }
    }

    /// Why an enabled compensation waits or is held; positions are waited for until the first frame of a link.
    fn waits_for(&self) -> Option<StateReason> {
        let waits = matches!(self.progress.state()?, State::Armed | State::Holding | State::RampingOut);
        if !waits || !self.progress.wanted.load(Relaxed) {
            return None;
        }
        let none_yet = self.last.is_none().then_some(Reason::Stale);
        self.progress.waits_for().or(none_yet).map(|reason| StateReason::new(fault::of_reason(reason), None))
    }

    /// Shadow mode for the status.
    pub(super) fn shadow(&self, state: State, score: &ShadowScore) -> ShadowStatus {
        let axis = |(k, name): (usize, &AxisName)| {
            let (found, of) = (score.axes[k], |v| name.kind().offset_out(v));
            let values = ShadowAxis {
                unit: name.kind().offset_unit().to_owned(),
                before_rms: of(score.before_rms(k)?),
                before_max: of(found.before_max),
                after_rms: of(score.after_rms(k)?),
                after_max: of(found.after_max),
                limited_cycles: found.limited_cycles,
            };
            Some((letter(*name), values))
        };
        ShadowStatus {
            state: state.name().to_owned(),
            cycles: score.cycles,
            active_cycles: score.active_cycles,
            faults: score.faults,
            interruptions: score.interruptions,
            axes: self.axes().iter().enumerate().filter_map(axis).collect(),
        }
    }

    fn link_status(&self, now: MonoTime) -> LinkStatus {
        let call = |ns: &AtomicI64| Some(ns.load(Relaxed)).filter(|ns| *ns > 0).map(|ns| ns as f64 / 1e3);
        LinkStatus {
            tls: self.loaded.identity.is_some(),
            address: self.loaded.config.link.address.to_string(),
            up: self.up,
            control: self.hello.map(|h| h.software.as_str().to_owned()),
            axes: self.axes().into_iter().map(letter).collect(),
            cycle_s: self.loaded.config.link.cycle_s,
            since_s: now.seconds_since(self.changed),
            links: self.links,
            error: self.error.as_ref().map(|(_, why)| why.clone()),
            error_code: self.error.as_ref().map(|(code, _)| code.to_string()),
            read_us: call(&self.progress.read_ns),
            write_us: call(&self.progress.write_ns),
        }
    }

    fn faults(&self, now: MonoTime) -> Vec<Fault> {
        // an acknowledged fault leaves without an event
        let latched = self.fault.as_ref().filter(|_| self.progress.is_faulted());
        let fault = latched.map(|latched| Fault {
            code: latched.code.clone(),
            reason: latched.reason.to_owned(),
            text: latched.text.to_owned(),
            numbers: latched.numbers.clone(),
            age_s: now.seconds_since(latched.since),
        });
        fault.into_iter().collect()
    }

    /// Axis, value and limit of a change of state, in words; of an axis outside its travel, the travel.
    pub(super) fn numbers(&self, detail: Option<&Detail>) -> Option<String> {
        let detail = detail?;
        let axis = detail.axis.and_then(|k| self.axes().get(usize::from(k)).copied());
        // what has no limit of its own and is a number is a position beyond the travel
        let is_place = detail.quantity == Quantity::Axis && detail.limit.is_nan() && detail.value.is_finite();
        let travel = axis.filter(|_| is_place);
        let travel = travel.and_then(|axis| Some((axis, self.spec.axis(axis).travel?)));
        if let Some((axis, ends)) = travel {
            let [low, high] = ends.map(|end| axis.kind().position_out(end));
            if detail.value < low || detail.value > high {
                let unit = axis.kind().position_unit();
                let place = words_apart(detail.value, if detail.value < low { low } else { high }, unit);
                let [low, high] = [low, high].map(|end| figure((end * 1e6).round() / 1e6));
                return Some(format!("{}: {place}, travel {low} to {high} {unit}", letter(axis)));
            }
        }
        Some(in_words(axis, detail))
    }

    /// The fault that is latched now, in a line.
    pub(super) fn latched(&self) -> Option<String> {
        let fault = self.faults(self.clock.now()).pop()?;
        let numbers = fault.numbers.map_or_else(String::new, |numbers| format!(" ({numbers})"));
        Some(format!("faulted: {} {}: {}{numbers}", fault.code, fault.reason, fault.text))
    }

    /// Axes that the machine file does not list and of which the control holds an offset.
    fn unlisted(&self) -> Vec<AxisName> {
        let Some(last) = self.last.filter(|_| self.up) else { return Vec::new() };
        let listed = |name: AxisName| self.loaded.config.axes.iter().any(|axis| axis.name == name);
        let axes = self.axes().into_iter().enumerate();
        axes.filter(|(k, name)| !listed(*name) && last.applied[*k].abs() > UNLISTED_MIN)
            .map(|(_, name)| name)
            .collect()
    }

    /// The offsets that the control keeps of axes that the machine file does not list, in words.
    pub(super) fn left_unlisted(&self) -> Option<String> {
        let last = self.last?;
        let axes = self.axes();
        let words = self.unlisted().into_iter().filter_map(|name| {
            let k = axes.iter().position(|axis| *axis == name)?;
            let detail = Detail {
                axis: u8::try_from(k).ok(),
                quantity: Quantity::Axis,
                value: last.applied[k],
                limit: f64::NAN,
            };
            Some(in_words(Some(name), &detail))
        });
        let words: Vec<String> = words.collect();
        (!words.is_empty()).then(|| words.join(", "))
    }

    /// Why a latched fault cannot be cleared yet: the link, or the first axis that still has an offset.
    pub(super) fn not_clearable(&self) -> String {
        let Some(last) = self.last.filter(|_| self.up) else {
            let what = if self.up {
                "no position frame has come on this link"
            } else {
                "there is no link to the control"
            };
            return what.to_owned();
        };
        let offset = |(k, name): (usize, &AxisName)| {
            let listed = self.loaded.config.axes.iter().find(|axis| axis.name == *name)?;
            let scale = name.kind().position_in(1.0);
            let (value, limit) = if last.answered {
                (last.offset[k] / scale, 0.0)
            } else {
                (last.applied[k], listed.read_back_tolerance / scale)
            };
            let detail = Detail { axis: u8::try_from(k).ok(), quantity: Quantity::Axis, value, limit };
            let at_zero = value.abs() <= limit;
            self.numbers(Some(&detail)).filter(|_| !at_zero)
        };
        match self.axes().iter().enumerate().find_map(offset) {
            Some(numbers) if last.answered => format!("the offset is still led to zero, {numbers}"),
            Some(numbers) => format!("the control reports an offset, {numbers}"),
            None => "the offset has only just become zero".to_owned(),
        }
    }

    fn limits(&self) -> BTreeMap<String, AxisLimitStatus> {
        let limits = |axis: &AxisConfig| {
            let kind = axis.name.kind();
            let [warning, limit] = [axis.limits.warning, axis.limits.size].map(|v| kind.offset_out(v));
            (letter(axis.name), AxisLimitStatus { unit: kind.offset_unit().to_owned(), warning, limit })
        };
        self.loaded.config.axes.iter().map(limits).collect()
    }

    /// The axes of the control in wire order; empty before its first hello.
    pub(super) fn axes(&self) -> Vec<AxisName> {
        self.hello.as_ref().map_or_else(Vec::new, |hello| {
            handshake::announced(hello).iter().map(|a| a.name).take(MAX_AXES).collect()
        })
    }
}

type AxisMap = BTreeMap<String, f64>;

impl StateReason {
    fn new(entry: &Entry, numbers: Option<String>) -> Self {
        Self {
            code: entry.code.to_string(),
            name: entry.name.to_owned(),
            text: entry.text.to_owned(),
            remedy: entry.remedy.to_owned(),
            numbers,
        }
    }
}

/// Values of the linear axes and of the rotary ones; JSON has no number for those that are not finite.
fn axis_maps(axes: &[AxisName], value: impl Fn(usize) -> f64) -> (AxisMap, AxisMap) {
    let of = |kind: AxisKind| {
        axes.iter()
            .enumerate()
            .filter(|(_, a)| a.kind() == kind)
            .map(|(k, a)| (letter(*a), value(k)))
            .filter(|(_, value)| value.is_finite())
            .collect()
    };
    (of(AxisKind::Linear), of(AxisKind::Rotary))
}

/// From mm or deg to um or arcsec.
fn wire(axis: AxisName, value: f64) -> f64 {
    axis.kind().offset_out(axis.kind().position_in(value))
}

/// Axis, value and limit of a detail; the travel is not looked at.
fn in_words(axis: Option<AxisName>, detail: &Detail) -> String {
    let Detail { quantity, value, limit, .. } = *detail;
    let (unit, small, factor) = match (quantity, axis.map(AxisName::kind)) {
        (Quantity::Time, _) => ("s", "ms", 1e3),
        (Quantity::Axis, Some(AxisKind::Rotary)) => ("deg", "arcsec", 3600.0),
        _ => ("mm", "um", 1e3),
    };
    let words = |v: f64, other: f64| match v.abs() {
        size if size > 0.0 && size < 1.0 => words_apart(v * factor, other * factor, small),
        _ => words_apart(v, other, unit),
    };
    let place = axis.map_or_else(String::new, |axis| format!("{}: ", letter(axis)));
    let bound = if limit.is_nan() { String::new() } else { format!(", limit {}", words(limit, value)) };
    format!("{place}{}{bound}", words(value, limit))
}

/// A number with its unit: four significant digits, or as many as tell it from another; an exponent where it would be long.
fn words_apart(value: f64, other: f64, unit: &str) -> String {
    if value.abs() >= LONG {
        return format!("{value:.4e} {unit}");
    }
    let text = |decimals: usize| format!("{value:.decimals$}");
    let same = |decimals: &usize| {
        value != other && text(*decimals) == format!("{other:.decimals$}", decimals = *decimals)
    };
    let own = (3.0 - value.abs().max(0.1).log10().floor()).clamp(0.0, 4.0) as usize;
    let decimals = [own, 4, 7, 10].into_iter().find(|d| !same(d)).unwrap_or(10);
    let digits = text(decimals);
    let short = if decimals > 0 { digits.trim_end_matches('0').trim_end_matches('.') } else { &digits };
    format!("{short} {unit}")
}

/// A number in as few digits as it has.
fn figure(v: f64) -> String {
    if v.abs() >= LONG { format!("{v:e}") } else { format!("{v}") }
}

/// From here numbers have an exponent.
const LONG: f64 = 1e9;

fn letter(axis: AxisName) -> String {
    axis.lower().to_string()
}

fn machine_state(state: MachineState) -> Vec<String> {
    let names = [
        (MachineState::HOMED, "homed"),
        (MachineState::ENABLED, "enabled"),
        (MachineState::ESTOP, "estop"),
        (MachineState::MOVING, "moving"),
        (MachineState::OFFSET_LIMITED, "offset-limited"),
        (MachineState::OFFSET_RAMPING_OUT, "offset-ramping-out"),
    ];
    names.iter().filter(|(bit, _)| state.has(*bit)).map(|(_, name)| (*name).to_owned()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use volcomp_protocol::{Axis, AxisUnit, Name};

    #[test]
    fn numbers_have_enough_digits_and_no_more() {
        let of = |value, limit| {
            in_words(Some(AxisName::X), &Detail { axis: Some(0), quantity: Quantity::Axis, value, limit })
        };
        assert_eq!(of(0.0215, 0.02), "x: 21.5 um, limit 20 um");
        assert_eq!(of(f64::MAX, 2.0), "x: 1.7977e308 mm, limit 2 mm");
        assert_eq!(of(-1e9, f64::NAN), "x: -1.0000e9 mm");
        assert_eq!(of(2.000_000_1, 2.0), "x: 2.0000001 mm, limit 2 mm");
        assert_eq!(of(0.25, 0.25), "x: 250 um, limit 250 um");
        assert_eq!(of(f64::NAN, f64::NAN), "x: NaN mm");
    }

    #[test]
    fn an_axis_outside_its_travel_is_shown_with_the_travel() {
        let loaded = crate::simulation::loaded();
        let mut collector = StatusCollector::new(loaded, Arc::default(), Clock::start()).unwrap();
        let axis = Axis { name: AxisName::X, unit: AxisUnit::Millimetre };
        collector.link_up(&ControlHello {
            version: 1,
            machine: Name::new("m"),
            software: Name::new("test"),
            cycle_ns: 1_000_000,
            axis_count: 1,
            axes: [axis; MAX_AXES],
        });
        let of = |value| {
            let detail = Detail { axis: Some(0), quantity: Quantity::Axis, value, limit: f64::NAN };
            collector.numbers(Some(&detail)).unwrap()
        };
        assert_eq!(of(400.000_02), "x: 400.00002 mm, travel 0 to 400 mm");
        assert_eq!(of(-2.0), "x: -2 mm, travel 0 to 400 mm");
        assert_eq!(of(1e308), "x: 1.0000e308 mm, travel 0 to 400 mm");
        assert_eq!(of(5.0), "x: 5 mm");
        assert_eq!(of(f64::INFINITY), "x: inf mm");

        // an event keeps the travel of the model that it happened with, later ones show that of the model in use
        let beyond = |value| Event::StateChanged {
            from: State::Active,
            to: State::RampingOut,
            reason: Reason::OutOfTravel,
            detail: Some(Detail { axis: Some(0), quantity: Quantity::Axis, value, limit: f64::NAN }),
        };
        let shown = |collector: &StatusCollector| collector.status().state_reason.unwrap().numbers.unwrap();
        collector.event(&beyond(401.0));
        let mut spec = collector.spec.clone();
        spec.axes.iter_mut().for_each(|axis| axis.travel = Some([0.0, 250.0]));
        collector.model(&spec);
        assert_eq!(shown(&collector), "x: 401 mm, travel 0 to 400 mm");
        collector.event(&beyond(300.0));
        assert_eq!(shown(&collector), "x: 300 mm, travel 0 to 250 mm");
    }
}
