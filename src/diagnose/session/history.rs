//! Logs of spindle and temperatures, and their lagged values at the readings.
//!
//! Before the first value of a log the source is taken to have stood at that value for long: thermal states need logs
//! that begin early.

use std::collections::BTreeMap;

use super::super::moment::{Follower, Moment, Signal, Source};

/// Per file and source: times and values, in order.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct History {
    series: BTreeMap<(usize, Source), Vec<(f64, f64)>>,
}

impl History {
    /// Adds values of a source on the clock of a file; times go up.
    pub fn add(&mut self, file: usize, source: Source, points: impl IntoIterator<Item = (f64, f64)>) {
        let series = self.series.entry((file, source)).or_default();
        series.extend(points.into_iter().filter(|(t, v)| t.is_finite() && v.is_finite()));
        series.sort_by(|a, b| a.0.total_cmp(&b.0));
        series.dedup_by(|b, a| a.0 == b.0);
        if series.is_empty() {
            self.series.retain(|_, s| !s.is_empty());
        }
    }

    /// Every source that some file has.
    #[must_use]
    pub fn sources(&self) -> Vec<Source> {
        let mut all: Vec<Source> = self.series.keys().map(|(_, s)| s.clone()).collect();
        all.sort();
        all.dedup();
        all
    }

    /// First value of a source in the first file that has it.
    #[must_use]
    pub fn first(&self, source: &Source) -> Option<f64> {
        self.series.iter().find(|((_, s), _)| s == source).and_then(|(_, p)| p.first()).map(|p| p.1)
    }

    /// Smallest and largest value of a source.
    #[must_use]
    pub fn range(&self, source: &Source) -> Option<[f64; 2]> {
        let values = self.series.iter().filter(|((_, s), _)| s == source).flat_map(|(_, p)| p).map(|p| p.1);
        values.fold(None, |r: Option<[f64; 2]>, v| Some(r.map_or([v, v], |[l, h]| [l.min(v), h.max(v)])))
    }

    /// The signal at every moment; `None` where a file of the moments lacks the source.
    #[must_use]
    pub fn lagged(&self, signal: &Signal, moments: &[Moment]) -> Option<Vec<f64>> {
        let mut out = Vec::with_capacity(moments.len());
        let mut at = 0;
        while at < moments.len() {
            let file = moments[at].file;
            let end = moments[at..].iter().position(|m| m.file != file).map_or(moments.len(), |n| at + n);
            let series = self.series.get(&(file, signal.source.clone()))?;
            out.extend(along_log(series, signal, moments[at..end].iter().map(|m| m.t_s)));
            at = end;
        }
        Some(out)
    }
}

/// A signal along a log, at times that do not go back.
pub(super) fn along_log(
    series: &[(f64, f64)],
    signal: &Signal,
    times: impl IntoIterator<Item = f64>,
) -> Vec<f64> {
    let mut follower = Follower::new(signal.clone());
    let (mut last, mut next) = ((f64::NEG_INFINITY, f64::NAN), 0);
    let value = |t_s: f64| {
        while next < series.len() && (next == 0 || series[next].0 <= t_s) {
            last = series[next];
            follower.push(last.0, last.1);
            next += 1;
        }
        // between two entries of the log the source goes straight from one to the other
        let now = match series.get(next) {
            Some(&(t1, v1)) if t1 > last.0 && t_s > last.0 => {
                last.1 + (v1 - last.1) * (t_s - last.0) / (t1 - last.0)
            }
            _ => last.1,
        };
        follower.at(t_s, now)
    };
    times.into_iter().map(value).collect()
}
