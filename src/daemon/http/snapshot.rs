//! What the service hands over, and the answers made from it.

use std::collections::{BTreeMap, VecDeque};
use std::path::Path;
use std::sync::Arc;

use axum::body::Bytes;
use serde::Serialize;

use super::{metrics, verification, volume};
use crate::channels::CycleRecord;
use crate::models::Prepared;
use crate::status::Status;
use volcomp_engine::fault::CATALOGUE;
use volcomp_units::NS_PER_S;

/// Upper bounds of the buckets, s; one more holds all above.
pub(super) const BOUNDS_S: [f64; 12] =
    [5e-6, 1e-5, 2e-5, 5e-5, 1e-4, 2e-4, 5e-4, 1e-3, 2e-3, 5e-3, 1e-2, 1e-1];
/// Samples of the trace: two minutes.
const SAMPLES: usize = 120;
/// Snapshots between two looks at the file of the verification.
const VERIFICATION_EVERY: u64 = 10;

/// All that the HTTP service shows.
#[derive(Debug, Clone)]
pub(crate) struct Snapshot {
    pub(crate) status: Status,
    /// The model in use.
    pub(crate) model: Arc<Prepared>,
    /// Occurrences since the start, in the order of the catalogue.
    pub(crate) codes: [u64; CATALOGUE.len()],
    pub(crate) latency: LatencyTotals,
    pub(crate) limited_cycles: u64,
    pub(crate) soft_limited_cycles: u64,
}

/// Latency since the start of the daemon.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct LatencyTotals {
    pub(super) age: Buckets,
    pub(super) round_trip: Buckets,
    pub(super) computation: Buckets,
}

/// A histogram with fixed buckets.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Buckets {
    pub(super) counts: [u64; BOUNDS_S.len() + 1],
    pub(super) sum_s: f64,
}

impl Buckets {
    fn add(&mut self, ns: i64) {
        let seconds = ns.max(0) as f64 / NS_PER_S;
        let bucket = BOUNDS_S.iter().position(|bound| seconds <= *bound).unwrap_or(BOUNDS_S.len());
        self.counts[bucket] += 1;
        self.sum_s += seconds;
    }
}

impl LatencyTotals {
    pub(crate) fn record(&mut self, record: &CycleRecord) {
        self.age.add(record.age_ns);
        self.round_trip.add(record.turnaround_ns);
        self.computation.add(record.compute_ns);
    }
}

/// Offsets of one axis, oldest first; `null` without a link.
#[derive(Debug, Default, Serialize)]
struct Trace {
    sent: VecDeque<Option<f64>>,
    applied: VecDeque<Option<f64>>,
}

/// The last two minutes, one sample a second; um or arcsec.
#[derive(Debug, Default, Serialize)]
pub(super) struct History {
    axes: BTreeMap<String, Trace>,
}

impl History {
    pub(super) fn push(&mut self, status: &Status) {
        for (sent, applied) in
            [(&status.correction_um, &status.applied_um), (&status.correction_arcsec, &status.applied_arcsec)]
        {
            for axis in sent.keys().chain(applied.keys()) {
                self.axes.entry(axis.clone()).or_default();
            }
        }
        for (axis, trace) in &mut self.axes {
            let of = |um: &BTreeMap<String, f64>, arcsec: &BTreeMap<String, f64>| {
                um.get(axis).or_else(|| arcsec.get(axis)).copied()
            };
            for (samples, value) in [
                (&mut trace.sent, of(&status.correction_um, &status.correction_arcsec)),
                (&mut trace.applied, of(&status.applied_um, &status.applied_arcsec)),
            ] {
                if samples.len() == SAMPLES {
                    samples.pop_front();
                }
                samples.push_back(value);
            }
        }
    }
}

/// Answers that change rarely.
#[derive(Debug, Default)]
pub(super) struct Slow {
    /// Hash of the model of `volume`.
    hash: String,
    volume: Bytes,
    verification: Bytes,
    snapshots: u64,
}

impl Slow {
    /// Brings them up to date; reads the file of the verification now and then.
    pub(super) fn look(&mut self, model: &Prepared, verification: Option<&Path>) {
        if self.hash != model.hash {
            self.hash.clone_from(&model.hash);
            self.volume = volume::volume(model).into();
        }
        if self.snapshots.is_multiple_of(VERIFICATION_EVERY) {
            self.verification = verification::shown(verification).into();
        }
        self.snapshots += 1;
    }
}

/// The answers that change with each snapshot.
#[derive(Debug, Default)]
pub(super) struct Rendered {
    /// The object of `volcomp status --json`.
    pub(super) status: Bytes,
    /// The same as a server-sent event.
    pub(super) event: Bytes,
    pub(super) history: Bytes,
    /// OpenMetrics text.
    pub(super) open_metrics: Bytes,
    /// The text format of Prometheus.
    pub(super) prometheus: Bytes,
    /// The distorted volume.
    pub(super) volume: Bytes,
    /// The last verification.
    pub(super) verification: Bytes,
}

impl Rendered {
    pub(super) fn new(snapshot: &Snapshot, history: &History, slow: &Slow) -> Self {
        // both are plain data: they can always be written
        let status = serde_json::to_string(&snapshot.status).unwrap_or_default();
        let open_metrics = metrics::open_metrics(snapshot).unwrap_or_default();
        Self {
            event: format!("event: status\ndata: {status}\n\n").into(),
            status: status.into(),
            history: serde_json::to_vec(history).unwrap_or_default().into(),
            prometheus: metrics::prometheus(&open_metrics).into(),
            open_metrics: open_metrics.into(),
            volume: slow.volume.clone(),
            verification: slow.verification.clone(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn buckets_hold_every_time() {
        let mut buckets = Buckets::default();
        for ns in [-1, 0, 5_000, 5_001, 99_999_999, 100_000_001, i64::MAX] {
            buckets.add(ns);
        }
        assert_eq!(buckets.counts.iter().sum::<u64>(), 7);
        assert_eq!((buckets.counts[0], buckets.counts[1], buckets.counts[BOUNDS_S.len()]), (3, 1, 2));
    }
}
