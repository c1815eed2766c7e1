//! Entries as recorded against entries as they come out now.

use std::collections::BTreeMap;
use std::fmt;

use volcomp_daemon::{LinkSession, command_of, tap};
use volcomp_protocol::Message;
use volcomp_protocol::record::{Answer, Entry, LIVE_MAX};
use volcomp_units::axes::AxisName;

use crate::committed::{Committed, shown, unit};

/// Whether every bit counts: x86_64 Linux with glibc on a processor with FMA and AVX2. Elsewhere, and in the variants of
/// glibc for older processors, sines and cosines round otherwise in the last bit.
pub(crate) fn is_bit_for_bit() -> bool {
    #[cfg(all(target_arch = "x86_64", target_os = "linux", target_env = "gnu"))]
    return is_x86_feature_detected!("fma") && is_x86_feature_detected!("avx2");
    #[cfg(not(all(target_arch = "x86_64", target_os = "linux", target_env = "gnu")))]
    return false;
}

/// Largest difference elsewhere, um or arcsec.
const TOLERANCE: f64 = 1e-9;

/// Runs the recorded inputs through the daemon's cycle; returns one entry for each of the recording.
pub(crate) fn replay(committed: &Committed) -> Vec<Entry> {
    let [Entry::Engine { now, hello }, rest @ ..] = committed.entries.as_slice() else {
        panic!("a recording begins with an engine")
    };
    let machine = &committed.machine;
    let config = machine.config.engine_config(hello).expect("the hello fits the machine file");
    let mut session = LinkSession::new(&config, machine.model.clone()).expect("an engine");
    let (tap, recorded) = tap(2 * committed.entries.len());
    session.record_to(tap, *now, hello);
    let mut replayed: Vec<Entry> = recorded.try_iter().collect();
    for entry in rest {
        match entry {
            Entry::Cycle(cycle) => drop(session.handle(cycle.now, &Message::Position(cycle.frame))),
            Entry::Deadline { now, .. } => drop(session.deadline(*now)),
            Entry::Tool { now, tool } => drop(session.handle(*now, &Message::Tool(*tool))),
            Entry::Request { now, request } => session.command(*now, command_of(*request).expect("known")),
            Entry::LinkUp { now } => session.link_up(*now),
            Entry::LinkDown { now } => session.link_down(*now),
            Entry::Model { now, hash } => {
                session.switch_model(*now, committed.models[hash].clone(), *hash).expect("the same axes");
            }
            Entry::Live { now, told, values } => {
                for channel in (0..LIVE_MAX).filter(|channel| told >> channel & 1 == 1) {
                    session.live(*now, channel, values[channel]);
                }
            }
            Entry::Engine { .. } | Entry::Gap { .. } => panic!("an entry that no recording here has"),
        }
        session.record();
        // a deadline that was not due is not recorded
        let none = match entry {
            Entry::Deadline { now, .. } => Entry::Deadline { now: *now, enabled: false, answer: None },
            other => *other,
        };
        replayed.push(recorded.try_iter().last().unwrap_or(none));
    }
    replayed
}

/// An offset that differs.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Largest {
    record: usize,
    axis: AxisName,
    recorded: f64,
    now: f64,
}

impl Largest {
    fn size(&self) -> f64 {
        (shown(self.axis, self.now) - shown(self.axis, self.recorded)).abs()
    }
}

impl fmt::Display for Largest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (axis, unit) = (self.axis, unit(self.axis));
        let [recorded, now] = [self.recorded, self.now].map(|value| shown(axis, value));
        let difference = now - recorded;
        write!(
            f,
            "axis {axis}, offset recorded {recorded} {unit}, now {now} {unit} (difference {difference:.3e} {unit})"
        )
    }
}

/// What a comparison found.
#[derive(Debug, Default)]
pub(crate) struct Differences {
    /// Cycles and deadlines.
    pub(crate) cycles: usize,
    pub(crate) differing: usize,
    pub(crate) first: Option<String>,
    pub(crate) largest: Option<Largest>,
}

/// Compares answer by answer; the numbers of `axes` count.
pub(crate) fn compare(axes: &[AxisName], recorded: &[Entry], now: &[Entry]) -> Differences {
    let mut found = Differences::default();
    for (record, (recorded, now)) in recorded.iter().zip(now).enumerate() {
        let (place, pair) = match (recorded, now) {
            (Entry::Cycle(a), Entry::Cycle(b)) => {
                let time_s = a.frame.control_ns as f64 * 1e-9;
                let place = format!("cycle {} (record {record}, {time_s:.4} s)", a.frame.sequence);
                (place, (a.answer, b.answer))
            }
            (Entry::Deadline { answer: a, .. }, Entry::Deadline { answer: b, .. }) => {
                (format!("deadline (record {record})"), (*a, *b))
            }
            _ => continue,
        };
        found.cycles += 1;
        let difference = match pair {
            (Some(a), Some(b)) => {
                larger(&mut found.largest, record, axes, &a, &b);
                difference(axes, record, &a, &b)
            }
            (None, None) => None,
            (a, b) => {
                let said = |given: bool| if given { "an answer" } else { "no answer" };
                Some(format!("recorded {}, now {}", said(a.is_some()), said(b.is_some())))
            }
        };
        if let Some(difference) = difference {
            found.differing += 1;
            found.first.get_or_insert_with(|| format!("{place}: {difference}"));
        }
    }
    found
}

fn larger(largest: &mut Option<Largest>, record: usize, axes: &[AxisName], a: &Answer, b: &Answer) {
    for (k, axis) in axes.iter().enumerate() {
        let this = Largest { record, axis: *axis, recorded: a.offset[k], now: b.offset[k] };
        if this.size() > largest.map_or(0.0, |largest| largest.size()) {
            *largest = Some(this);
        }
    }
}

fn equal(axis: AxisName, a: f64, b: f64) -> bool {
    a.to_bits() == b.to_bits() || (!is_bit_for_bit() && (shown(axis, a) - shown(axis, b)).abs() <= TOLERANCE)
}

/// The first thing in which two answers differ.
fn difference(axes: &[AxisName], record: usize, a: &Answer, b: &Answer) -> Option<String> {
    for (k, axis) in axes.iter().enumerate() {
        if !equal(*axis, a.offset[k], b.offset[k]) {
            let found = Largest { record, axis: *axis, recorded: a.offset[k], now: b.offset[k] };
            return Some(found.to_string());
        }
    }
    for (k, axis) in axes.iter().enumerate() {
        if !equal(*axis, a.wanted[k], b.wanted[k]) {
            let [recorded, now] = [a.wanted[k], b.wanted[k]].map(|value| shown(*axis, value));
            let unit = unit(*axis);
            return Some(format!(
                "axis {axis}, correction before ramps and limits recorded {recorded} {unit}, now {now} {unit}"
            ));
        }
    }
    // what is no offset is the same everywhere
    let rest = |answer: &Answer| Answer { offset: [0.0; 8], wanted: [0.0; 8], ..*answer };
    (rest(a) != rest(b)).then(|| format!("recorded {:?}, now {:?}", rest(a), rest(b)))
}

/// What a control that applies the offsets of now would see: the largest difference in a closed loop.
pub(crate) fn closed_loop(axes: &[AxisName], recorded: &[Entry], simulated: &[Entry]) -> String {
    // deadlines may have changed in number; frames have the same sequence
    let answer_of = |entry: &Entry| match entry {
        Entry::Cycle(cycle) => Some((cycle.frame.sequence, cycle.answer?)),
        _ => None,
    };
    let by_sequence: BTreeMap<u32, Answer> = simulated.iter().filter_map(answer_of).collect();
    let mut largest = None;
    for (record, entry) in recorded.iter().enumerate() {
        let Entry::Cycle(cycle) = entry else { continue };
        let now = by_sequence.get(&cycle.frame.sequence);
        if let Some((a, b)) = cycle.answer.as_ref().zip(now) {
            larger(&mut largest, record, axes, a, b);
        }
    }
    described(largest)
}

pub(crate) fn described(largest: Option<Largest>) -> String {
    largest.map_or_else(|| "none".to_owned(), |largest| format!("record {}, {largest}", largest.record))
}
