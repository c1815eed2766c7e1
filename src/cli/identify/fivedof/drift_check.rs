//! What the drift compensation is worth on the run at hand: scatter of the runs at each position with the compensation,
//! without it, and with the factor printed in paper 002 (half of d theta).
//!
//! Source: paper 002, 3.1 (standard deviations of the five errors over runs); equations 4.2, (4).

use serde::{Serialize, Serializer};

use super::Run;
use crate::prelude::*;
use volcomp_identify::fivedof::align::align;
use volcomp_identify::fivedof::{FiveDof, Head, to_machine};

/// Largest and mean standard deviation over the positions.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
struct Scatter {
    max: f64,
    mean: f64,
}

/// One error motion with its scatter, in um or arcsec.
#[derive(Debug, Clone, PartialEq, Serialize)]
struct Row {
    #[serde(serialize_with = "as_key")]
    error: ErrorSymbol,
    unit: &'static str,
    /// With the drift compensation.
    on: Scatter,
    /// Without it.
    off: Scatter,
    printed_factor: Scatter,
}

fn as_key<S: Serializer>(symbol: &ErrorSymbol, to: S) -> Result<S::Ok, S::Error> {
    to.serialize_str(&key(*symbol))
}

/// The table.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct DriftCheck {
    /// Runs at each position.
    runs: usize,
    std: Vec<Row>,
}

/// The head as the printed formula has it: half of the distance times pointing.
fn with_printed_factor(head: &Head) -> Head {
    let half = |pairs: [[f64; 2]; 2]| pairs.map(|pair| pair.map(|v| v / 2.0));
    Head { gain: half(head.gain), path: half(head.path), ..*head }
}

impl DriftCheck {
    /// The check of a run; none where no position was read twice in one direction.
    pub(super) fn of(axis: AxisName, run: &Run, head: &Head) -> Option<Self> {
        let mut places: BTreeMap<(i64, bool), Vec<usize>> = BTreeMap::new();
        for (i, r) in run.rows.iter().enumerate() {
            let place = ((r.position * 1e3).round() as i64, r.travel == Travel::Reverse);
            places.entry(place).or_default().push(i);
        }
        let runs = places.values().map(Vec::len).max().filter(|n| *n > 1)?;
        let heads = [*head, head.without_drift_compensation(), with_printed_factor(head)];
        let positions: Vec<f64> = run.rows.iter().map(|r| r.position).collect();
        let mut motions = Vec::with_capacity(heads.len());
        for head in &heads {
            let reduced: Vec<FiveDof> = run.readings.iter().map(|r| head.reduce(r)).collect();
            let aligned = align(head, &positions, &reduced, run.level).ok()?;
            motions.push(aligned.motion.iter().map(|m| to_machine(axis, *m)).collect::<Vec<_>>());
        }
        let scatter = |motion: &[[f64; 6]], component: Component| {
            let stds: Vec<f64> = places
                .values()
                .filter(|rows| rows.len() > 1)
                .map(|rows| standard_deviation(rows.iter().map(|i| motion[*i][component.index()])))
                .map(Units::of_component(component).of_value)
                .collect();
            let max = stds.iter().copied().fold(0.0, f64::max);
            Scatter { max, mean: stds.iter().sum::<f64>() / stds.len().max(1) as f64 }
        };
        let row = |component: Component| {
            let [on, off, printed_factor] = core::array::from_fn(|k| scatter(&motions[k], component));
            let unit = Units::of_component(component).value;
            Row { error: ErrorSymbol::Motion { component, axis }, unit, on, off, printed_factor }
        };
        let across = Component::ALL.into_iter().filter(|c| c.index() != axis.direction());
        Some(Self { runs, std: across.map(row).collect() })
    }

    pub(super) fn print(&self) {
        say!();
        say!(
            "standard deviation over {} runs, largest / mean over the positions (paper 002, table of 3.1)",
            self.runs
        );
        say!("{:<14}{:>22}{:>22}{:>22}", "", "drift compensated", "not compensated", "half of d theta");
        for Row { error, unit, on, off, printed_factor } in &self.std {
            let unit = if *unit == "um" { "µm" } else { unit };
            let [on, off, half] = [on, off, printed_factor].map(|s| format!("{:.2} / {:.2}", s.max, s.mean));
            say!("{:<14}{on:>22}{off:>22}{half:>22}", format!("{error} {unit}"));
        }
    }
}

fn standard_deviation(values: impl Iterator<Item = f64> + Clone) -> f64 {
    let n = values.clone().count() as f64;
    let mean = values.clone().sum::<f64>() / n;
    (values.map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0).max(1.0)).sqrt()
}
