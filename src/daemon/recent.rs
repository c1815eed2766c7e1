//! The last minute: latency, late cycles, drop-outs, warnings and faults by number. Belongs to the service thread.
//!
//! Five-second slots in bounded memory; the oldest is cleared and used again. Latencies have two significant digits.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::time::SystemTime;

use hdrhistogram::{CreationError, Histogram};
use serde::{Deserialize, Serialize};
use volcomp_state::utc;

use super::channels::{CycleRecord, Progress};
use super::latency::LONGEST_NS;
use volcomp_engine::fault::{CATALOGUE, Code, Severity};
use volcomp_units::MonoTime;

/// Length of a slot, s.
const SLOT_S: f64 = 5.0;
/// Complete slots and the one being filled.
const SLOTS: usize = 13;
/// Length of the window, s: the complete slots.
const WINDOW_S: f64 = SLOT_S * (SLOTS - 1) as f64;
/// Entries of the event list.
const EVENTS: usize = 32;
/// Nanoseconds in a microsecond.
const NS_PER_US: f64 = 1e3;
/// Nanoseconds in a millisecond.
const NS_PER_MS: f64 = 1e6;
/// Kinds of latency: age, round trip, computation.
const KINDS: usize = 3;

/// Latency, lateness and warnings of the last minute.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct RecentStatus {
    /// Length of the window, s: 60 to 65, shorter in the first minute of the daemon.
    pub window_s: f64,
    /// Position frames handled.
    pub cycles: u64,
    /// Of these: late.
    pub late_cycles: u64,
    /// Of the late ones: not answered.
    pub skipped_cycles: u64,
    /// Late cycles over cycles, 0 to 1; `null` without a cycle.
    pub late_share: Option<f64>,
    /// Median age, us; `null` without a cycle.
    pub age_us_p50: Option<f64>,
    /// 99th percentile of the same, us.
    pub age_us_p99: Option<f64>,
    /// Median round trip, us.
    pub roundtrip_us_p50: Option<f64>,
    /// 99th percentile of the same, us.
    pub roundtrip_us_p99: Option<f64>,
    /// Median computation time, us.
    pub compute_us_p50: Option<f64>,
    /// 99th percentile of the same, us.
    pub compute_us_p99: Option<f64>,
    /// Links that ended other than by a stop of this daemon.
    pub drop_outs: u64,
    /// Warnings and faults, by number.
    pub warnings: Vec<CodeCount>,
}

/// A number of the catalogue and how often it occurred.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct CodeCount {
    /// Its number, e.g. `VC-6006`.
    pub code: String,
    /// Its name, e.g. `late-cycles`.
    pub name: String,
    /// `warning` or `fault`.
    pub severity: String,
    /// In one line.
    pub text: String,
    /// Occurrences; cycles where it is counted per cycle.
    pub count: u64,
    /// Time since the last one, s.
    pub age_s: f64,
    /// Whether it lasts; `false` where it is over.
    #[serde(default)]
    pub present: bool,
}

/// An entry of the event list; repetitions within a minute are one entry.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct EventStatus {
    /// First occurrence, RFC 3339 in UTC.
    pub time: String,
    /// Last occurrence, likewise; empty from a daemon before this key.
    #[serde(default)]
    pub last_time: String,
    /// Time since the last occurrence, s.
    pub age_s: f64,
    /// Its number.
    pub code: String,
    /// Its name.
    pub name: String,
    /// `notice`, `warning` or `fault`.
    pub severity: String,
    /// Occurrences.
    pub count: u64,
    /// Axis, value and limit of the first occurrence, where there are any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub numbers: Option<String>,
}

/// Five seconds.
#[derive(Debug)]
struct Slot {
    begun: MonoTime,
    cycles: u64,
    late: u64,
    skipped: u64,
    drop_outs: u64,
    counts: [u64; CATALOGUE.len()],
    latency: [Histogram<u32>; KINDS],
}

/// A listed event.
#[derive(Debug)]
struct Listed {
    index: usize,
    time: String,
    last_time: String,
    last: MonoTime,
    count: u64,
    numbers: Option<String>,
}

/// The last minute and the last events.
#[derive(Debug)]
pub(super) struct Recent {
    /// Oldest first; the last one is being filled.
    slots: VecDeque<Slot>,
    last: [Option<MonoTime>; CATALOGUE.len()],
    /// By their last occurrence, newest last.
    events: VecDeque<Listed>,
    seen: [u64; COUNTERS.len()],
    /// Occurrences since the start.
    totals: [u64; CATALOGUE.len()],
}

/// Whether a number is counted in every cycle for as long as it lasts.
pub(super) fn is_counted_per_cycle(code: Code) -> bool {
    code == Code::LATE_CYCLES || COUNTERS.iter().any(|(_, counted)| *counted == Some(code))
}

/// The interval between frames that is not the announced one, in words.
pub(super) fn interval(progress: &Progress) -> String {
    format!("{:.3} ms between position frames", progress.interval_ns.load(Relaxed) as f64 / NS_PER_MS)
}

/// A counter of the cycle thread.
type Counter = fn(&Progress) -> &AtomicU64;

/// Counters whose increments are counted; those with a number appear among the warnings.
const COUNTERS: [(Counter, Option<Code>); 11] = [
    (|p| &p.cycles, None),
    (|p| &p.late, None),
    (|p| &p.skipped, None),
    (|p| &p.out_of_order, Some(Code::SEQUENCE)),
    (|p| &p.limited, Some(Code::LIMITED)),
    (|p| &p.at_soft_limit, Some(Code::SOFT_LIMIT)),
    (|p| &p.out_of_travel, Some(Code::OUT_OF_TRAVEL)),
    (|p| &p.control_limited, Some(Code::CONTROL_LIMITED)),
    (|p| &p.lagging, Some(Code::OFFSET_BEHIND)),
    (|p| &p.unlisted, Some(Code::UNLISTED_OFFSET)),
    (|p| &p.off_cycle, Some(Code::CYCLE_TIME)),
];

impl Slot {
    fn new(begun: MonoTime) -> Result<Self, CreationError> {
        let histogram = || Histogram::new_with_bounds(1, LONGEST_NS, 2);
        Ok(Self {
            begun,
            cycles: 0,
            late: 0,
            skipped: 0,
            drop_outs: 0,
            counts: [0; CATALOGUE.len()],
            latency: [histogram()?, histogram()?, histogram()?],
        })
    }

    fn clear(&mut self, begun: MonoTime) {
        (self.begun, self.cycles, self.late, self.skipped, self.drop_outs) = (begun, 0, 0, 0, 0);
        self.counts = [0; CATALOGUE.len()];
        self.latency.iter_mut().for_each(Histogram::reset);
    }
}

impl Recent {
    pub(super) fn new(now: MonoTime) -> Result<Self, CreationError> {
        let slots = (0..SLOTS).map(|_| Slot::new(now)).collect::<Result<_, _>>()?;
        Ok(Self {
            slots,
            last: [None; CATALOGUE.len()],
            events: VecDeque::with_capacity(EVENTS),
            seen: [0; COUNTERS.len()],
            totals: [0; CATALOGUE.len()],
        })
    }

    /// Begins a new slot where the present one is over.
    fn advance(&mut self, now: MonoTime) {
        let begun = self.slots.back().map_or(now, |slot| slot.begun);
        let over = (now.seconds_since(begun) / SLOT_S) as usize;
        for k in over.saturating_sub(SLOTS)..over {
            let at = begun.plus_seconds((k + 1) as f64 * SLOT_S);
            if let Some(mut slot) = self.slots.pop_front() {
                slot.clear(at);
                self.slots.push_back(slot);
            }
        }
    }

    /// Takes in what the cycle thread has counted since the last call.
    pub(super) fn look(&mut self, now: MonoTime, progress: &Progress) {
        self.advance(now);
        let mut new = [0; COUNTERS.len()];
        for (k, (counter, _)) in COUNTERS.iter().enumerate() {
            let count = counter(progress).load(Relaxed);
            new[k] = count.saturating_sub(self.seen[k]);
            self.seen[k] = count;
        }
        if let Some(slot) = self.slots.back_mut() {
            slot.cycles += new[0];
            slot.late += new[1];
            slot.skipped += new[2];
        }
        for ((_, code), count) in COUNTERS.iter().zip(new) {
            if let (Some(code), 1..) = (code, count) {
                let numbers = (*code == Code::CYCLE_TIME).then(|| interval(progress));
                self.count(now, *code, count, numbers);
            }
        }
    }

    /// One cycle's times.
    pub(super) fn record(&mut self, record: &CycleRecord) {
        let Some(slot) = self.slots.back_mut() else { return };
        let times = [record.age_ns, record.turnaround_ns, record.compute_ns];
        for (histogram, time) in slot.latency.iter_mut().zip(times) {
            histogram.saturating_record(u64::try_from(time).unwrap_or(0).max(1));
        }
    }

    /// A link has ended other than by a stop of this daemon.
    pub(super) fn drop_out(&mut self, now: MonoTime) {
        self.advance(now);
        if let Some(slot) = self.slots.back_mut() {
            slot.drop_outs += 1;
        }
    }

    /// Something with a number happened `count` times.
    pub(super) fn count(&mut self, now: MonoTime, code: Code, count: u64, numbers: Option<String>) {
        let Some(index) = CATALOGUE.iter().position(|entry| entry.code == code) else { return };
        self.advance(now);
        if let Some(slot) = self.slots.back_mut() {
            slot.counts[index] = slot.counts[index].saturating_add(count);
        }
        self.totals[index] = self.totals[index].saturating_add(count);
        self.last[index] = Some(now);
        let last_time = utc::text(SystemTime::now());
        let repeated = |listed: &Listed| listed.index == index && now.seconds_since(listed.last) < WINDOW_S;
        let before = self.events.iter().rposition(repeated).and_then(|at| self.events.remove(at));
        let listed = match before {
            Some(old) => Listed { last_time, last: now, count: old.count.saturating_add(count), ..old },
            None => Listed { index, time: last_time.clone(), last_time, last: now, count, numbers },
        };
        if self.events.len() == EVENTS {
            self.events.pop_front();
        }
        self.events.push_back(listed);
    }

    /// Occurrences since the start, in the order of the catalogue.
    pub(super) const fn totals(&self) -> [u64; CATALOGUE.len()] {
        self.totals
    }

    /// The last minute in figures.
    pub(super) fn status(&mut self, now: MonoTime) -> RecentStatus {
        self.advance(now);
        let sum = |of: fn(&Slot) -> u64| self.slots.iter().map(of).sum::<u64>();
        let (cycles, late_cycles) = (sum(|s| s.cycles), sum(|s| s.late));
        let [age, roundtrip, compute] = core::array::from_fn(|kind| self.percentiles(kind));
        RecentStatus {
            window_s: now.seconds_since(self.slots[0].begun).max(0.0),
            cycles,
            late_cycles,
            skipped_cycles: sum(|s| s.skipped),
            late_share: (cycles > 0).then(|| late_cycles.min(cycles) as f64 / cycles as f64),
            age_us_p50: age[0],
            age_us_p99: age[1],
            roundtrip_us_p50: roundtrip[0],
            roundtrip_us_p99: roundtrip[1],
            compute_us_p50: compute[0],
            compute_us_p99: compute[1],
            drop_outs: sum(|s| s.drop_outs),
            warnings: self.warnings(now),
        }
    }

    fn warnings(&self, now: MonoTime) -> Vec<CodeCount> {
        let counted = |(index, entry): (usize, &volcomp_engine::fault::Entry)| {
            let count = self.slots.iter().map(|s| s.counts[index]).sum::<u64>();
            (count > 0 && entry.severity != Severity::Notice).then(|| CodeCount {
                code: entry.code.to_string(),
                name: entry.name.to_owned(),
                severity: entry.severity.name().to_owned(),
                text: entry.text.to_owned(),
                count,
                age_s: self.last[index].map_or(0.0, |last| now.seconds_since(last)),
                present: false,
            })
        };
        CATALOGUE.iter().enumerate().filter_map(counted).collect()
    }

    /// Median and 99th percentile over the slots, us.
    fn percentiles(&self, kind: usize) -> [Option<f64>; 2] {
        let mut all = Histogram::new_from(&self.slots[0].latency[kind]);
        for slot in &self.slots {
            // the same bounds: it always fits
            let _ = all.add(&slot.latency[kind]);
        }
        [50.0, 99.0].map(|p| (!all.is_empty()).then(|| all.value_at_percentile(p) as f64 / NS_PER_US))
    }

    /// The last events, the latest occurrence first.
    pub(super) fn events(&self, now: MonoTime) -> Vec<EventStatus> {
        let status = |listed: &Listed| {
            let entry = &CATALOGUE[listed.index];
            EventStatus {
                time: listed.time.clone(),
                last_time: listed.last_time.clone(),
                age_s: now.seconds_since(listed.last),
                code: entry.code.to_string(),
                name: entry.name.to_owned(),
                severity: entry.severity.name().to_owned(),
                count: listed.count,
                numbers: listed.numbers.clone(),
            }
        };
        self.events.iter().rev().map(status).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(seconds: f64) -> MonoTime {
        MonoTime::ZERO.plus_seconds(seconds)
    }

    #[test]
    fn a_warning_counts_for_a_minute_and_stays_in_the_list() {
        let mut recent = Recent::new(at(0.0)).expect("histograms");
        recent.count(at(1.0), Code::LINK_LOST, 1, Some("why".to_owned()));
        recent.count(at(2.0), Code::LINK_LOST, 2, None);
        recent.count(at(2.0), Code(1003), 1, None);
        let status = recent.status(at(30.0));
        assert_eq!(status.warnings.len(), 1, "a notice is no warning: {status:?}");
        let warning = &status.warnings[0];
        assert_eq!((warning.code.as_str(), warning.count, warning.age_s), ("VC-6002", 3, 28.0));
        assert!(recent.status(at(59.0)).warnings.len() == 1);
        assert!(recent.status(at(66.0)).warnings.is_empty());
        let events = recent.events(at(66.0));
        assert_eq!(events.len(), 2, "{events:?}");
        assert_eq!((events[1].count, events[1].numbers.as_deref()), (3, Some("why")));
        // one that comes again is the newest, with the time of the first and of the last
        recent.count(at(60.0), Code::LINK_LOST, 1, None);
        let events = recent.events(at(66.0));
        assert_eq!((events[0].code.as_str(), events[0].count, events[0].age_s), ("VC-6002", 4, 6.0));
        assert!(events[0].time <= events[0].last_time && events.len() == 2);
    }

    #[test]
    fn counters_are_taken_as_differences() {
        let mut recent = Recent::new(at(0.0)).expect("histograms");
        let progress = Progress::default();
        for (k, late) in [(1, 0), (2, 10), (70, 10)] {
            progress.cycles.store(1000 * k, Relaxed);
            progress.late.store(late, Relaxed);
            progress.limited.store(5, Relaxed);
            recent.look(at(k as f64), &progress);
        }
        let status = recent.status(at(70.0));
        assert_eq!((status.cycles, status.late_cycles), (68_000, 0), "{status:?}");
        assert!(status.warnings.is_empty() && (WINDOW_S..=WINDOW_S + SLOT_S).contains(&status.window_s));
        let mut recent = Recent::new(at(0.0)).expect("histograms");
        recent.look(at(1.0), &progress);
        let status = recent.status(at(1.0));
        assert_eq!(status.warnings[0].code, "VC-4005");
        assert_eq!(status.late_share, Some(10.0 / 70_000.0));
    }

    #[test]
    fn the_event_list_is_bounded() {
        let mut recent = Recent::new(at(0.0)).expect("histograms");
        for k in 0..1000 {
            recent.count(at(61.0 * f64::from(k)), Code(3001), 1, None);
        }
        assert_eq!(recent.events(at(0.0)).len(), EVENTS);
    }
}
