//! Latency of one link as HDR histograms, and its report. Belongs to the service thread.
//!
//! Three significant digits from 1 ns to 60 s in bounded memory; longer times count as 60 s.

use hdrhistogram::{CreationError, Histogram};
use serde::{Deserialize, Serialize};

use super::channels::CycleRecord;

/// Largest time held, ns.
pub(super) const LONGEST_NS: u64 = 60_000_000_000;
/// Nanoseconds in a microsecond.
const NS_PER_US: f64 = 1e3;

/// Times of the present link, or of the last one.
#[derive(Debug)]
pub(super) struct Latency {
    pub(super) age: Histogram<u64>,
    pub(super) turnaround: Histogram<u64>,
    pub(super) compute: Histogram<u64>,
    /// Of the answers that left late: by how much.
    pub(super) lateness: Histogram<u64>,
}

/// Every histogram of the present link, or of the last one: what `volcomp status --histograms` prints.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Histograms {
    /// Age of the position when its correction left.
    pub age: Bins,
    /// From a frame's bytes in hand to its correction handed to the kernel.
    pub roundtrip: Bins,
    /// From a frame's bytes in hand to its correction computed.
    pub compute: Bins,
    /// How much later than one cycle after the sample late corrections left; skipped positions are not in it.
    pub lateness: Bins,
}

/// One histogram.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Bins {
    /// Cycles in it.
    pub count: u64,
    /// Shortest time, us; `null` where there is none.
    pub min_us: Option<f64>,
    /// Mean time, us.
    pub mean_us: Option<f64>,
    /// Longest time, us.
    pub max_us: Option<f64>,
    /// Bins that are not empty, in rising order: `[largest time in the bin / us, cycles]`.
    pub bins: Vec<(f64, u64)>,
}

impl Latency {
    pub(super) fn new() -> Result<Self, CreationError> {
        let histogram = || Histogram::new_with_bounds(1, LONGEST_NS, 3);
        Ok(Self {
            age: histogram()?,
            turnaround: histogram()?,
            compute: histogram()?,
            lateness: histogram()?,
        })
    }

    /// Forgets everything: a new link.
    pub(super) fn reset(&mut self) {
        for histogram in [&mut self.age, &mut self.turnaround, &mut self.compute, &mut self.lateness] {
            histogram.reset();
        }
    }

    /// Takes the times of an answered cycle.
    pub(super) fn record(&mut self, record: &CycleRecord, cycle_ns: i64) {
        let CycleRecord { age_ns, turnaround_ns, compute_ns, .. } = *record;
        // zero is below what a histogram holds
        let ns = |value: i64| u64::try_from(value).unwrap_or(0).max(1);
        self.age.saturating_record(ns(age_ns));
        self.turnaround.saturating_record(ns(turnaround_ns));
        self.compute.saturating_record(ns(compute_ns));
        if age_ns > cycle_ns {
            self.lateness.saturating_record(ns(age_ns.saturating_sub(cycle_ns)));
        }
    }

    pub(super) fn histograms(&self) -> Histograms {
        Histograms {
            age: bins(&self.age),
            roundtrip: bins(&self.turnaround),
            compute: bins(&self.compute),
            lateness: bins(&self.lateness),
        }
    }
}

/// A percentile, us; `None` where nothing was recorded.
pub(super) fn percentile_us(histogram: &Histogram<u64>, percentile: f64) -> Option<f64> {
    (!histogram.is_empty()).then(|| histogram.value_at_percentile(percentile) as f64 / NS_PER_US)
}

fn bins(histogram: &Histogram<u64>) -> Bins {
    let some = |value: f64| (!histogram.is_empty()).then_some(value / NS_PER_US);
    let bin = |step: hdrhistogram::iterators::IterationValue<u64>| {
        (step.value_iterated_to() as f64 / NS_PER_US, step.count_at_value())
    };
    Bins {
        count: histogram.len(),
        min_us: some(histogram.min() as f64),
        mean_us: some(histogram.mean()),
        max_us: some(histogram.max() as f64),
        bins: histogram.iter_recorded().map(bin).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CYCLE_NS: i64 = 1_000_000;

    fn record(latency: &mut Latency, age_ns: i64) {
        let record = CycleRecord { age_ns, turnaround_ns: 12_000, compute_ns: 700, ..CycleRecord::default() };
        latency.record(&record, CYCLE_NS);
    }

    #[test]
    fn lateness_is_what_is_beyond_one_cycle() {
        let mut latency = Latency::new().expect("histograms");
        for age_ns in [20_000, CYCLE_NS, CYCLE_NS + 250_000] {
            record(&mut latency, age_ns);
        }
        let told = latency.histograms();
        assert_eq!((told.age.count, told.roundtrip.count, told.compute.count), (3, 3, 3));
        assert_eq!(told.lateness.count, 1, "an age of one cycle is in time");
        let late_us = told.lateness.max_us.expect("one");
        assert!((late_us - 250.0).abs() < 0.5, "{late_us}");
        latency.reset();
        assert_eq!(
            latency.histograms().age,
            Bins { count: 0, min_us: None, mean_us: None, max_us: None, bins: vec![] }
        );
    }

    #[test]
    fn bins_hold_every_cycle_in_order() {
        let mut latency = Latency::new().expect("histograms");
        for i in 0..1000 {
            record(&mut latency, 1_000 * (i % 50));
        }
        let Bins { count, bins, min_us, max_us, .. } = latency.histograms().age;
        assert_eq!(bins.iter().map(|(_, n)| n).sum::<u64>(), count);
        assert!(bins.is_sorted_by(|a, b| a.0 < b.0));
        let p50 = percentile_us(&latency.age, 50.0).expect("some");
        assert!((p50 - 24.0).abs() < 0.1, "{p50}");
        assert!(min_us <= Some(0.001) && max_us >= Some(49.0));
    }

    #[test]
    fn nonsense_times_are_bounded() {
        let mut latency = Latency::new().expect("histograms");
        record(&mut latency, i64::MIN);
        record(&mut latency, i64::MAX);
        let age = latency.histograms().age;
        assert_eq!(age.count, 2);
        assert!(age.max_us.is_some_and(|us| us < 61e6), "{age:?}");
        assert_eq!(percentile_us(&latency.lateness, 50.0).map(|us| us > 59e6), Some(true));
    }
}
