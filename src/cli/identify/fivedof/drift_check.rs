//! What the drift compensation is worth on the run at hand: scatter of the runs at each position with the compensation,
//! without it, and with the factor printed in paper 002 (half of d theta).
//!
//! Source: paper 002, 3.1 (standard deviations of the five errors over runs); equations 4.2, (4).

use serde::{Serialize, Serializer};

use super::Run;
use crate::prelude::*;
use volcomp_identify::fivedof::Head;
use volcomp_identify::fivedof::scatter::Scatter as RunScatter;

/// Largest and mean standard deviation over the positions.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
struct Scatter {
    max: f64,
    mean: f64,
}

impl Scatter {
    fn of(std: &[f64], of_value: fn(f64) -> f64) -> Self {
        let std = || std.iter().copied().map(of_value);
        Self { max: std().fold(0.0, f64::max), mean: std().sum::<f64>() / std().len().max(1) as f64 }
    }
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

impl DriftCheck {
    /// The check of a run; none where no position was read twice in one direction.
    pub(super) fn of(axis: AxisName, run: &Run, head: &Head) -> Option<Self> {
        let found = RunScatter::of(axis, &run.rows, &run.readings, run.level, head)?;
        let row = |component: Component| {
            let Units { value: unit, of_value, .. } = Units::of_component(component);
            let [on, off, printed_factor] = found.std(component).map(|std| Scatter::of(&std, of_value));
            Row { error: ErrorSymbol::Motion { component, axis }, unit, on, off, printed_factor }
        };
        let across = Component::ALL.into_iter().filter(|c| c.index() != axis.direction());
        Some(Self { runs: found.runs, std: across.map(row).collect() })
    }

    pub(super) fn print(&self) {
        say!();
        let what = "largest / mean over the positions (paper 002, table of 3.1)";
        say!("standard deviation over {} runs, {what}", self.runs);
        say!("{:<14}{:>22}{:>22}{:>22}", "", "drift compensated", "not compensated", "half of d theta");
        for Row { error, unit, on, off, printed_factor } in &self.std {
            let [on, off, half] = [on, off, printed_factor].map(|s| format!("{:.2} / {:.2}", s.max, s.mean));
            say_text!("{:<14}{on:>22}{off:>22}{half:>22}", format!("{error} {unit}"));
        }
    }
}
