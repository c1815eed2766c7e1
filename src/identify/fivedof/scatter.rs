//! What the drift compensation is worth on a run: scatter of the repeats at each position with the compensation, without it, and
//! with the factor printed in paper 002 (half of d theta).
//!
//! Source: paper 002, 3.1 (standard deviations of the five errors over runs); equations 4.2, (4).

use crate::prelude::*;

use super::align::{Level, align};
use super::{FiveDof, Head, Readings, to_machine};

/// Standard deviations of the error motions over the repeats.
#[derive(Debug, Clone, PartialEq)]
pub struct Scatter {
    /// Most repeats of a position.
    pub runs: usize,
    /// Rows of the run that are repeats of each other, in the order of places.
    repeats: Vec<Vec<usize>>,
    /// The motions of every row: compensated, not compensated, with the printed factor.
    motions: [Vec<[f64; 6]>; 3],
}

/// The head as the printed formula has it: half of the distance times pointing.
fn with_printed_factor(head: &Head) -> Head {
    let half = |pairs: [[f64; 2]; 2]| pairs.map(|pair| pair.map(|v| v / 2.0));
    Head { gain: half(head.gain), path: half(head.path), ..*head }
}

impl Scatter {
    /// Of a run (mm); none where no position was read twice in one direction.
    #[must_use]
    pub fn of(
        axis: AxisName,
        rows: &[Reading],
        readings: &[Readings],
        level: Level,
        head: &Head,
    ) -> Option<Self> {
        let mut places: BTreeMap<(i64, bool), Vec<usize>> = BTreeMap::new();
        for (i, r) in rows.iter().enumerate() {
            let place = ((r.position * 1e3).round() as i64, r.travel == Travel::Reverse);
            places.entry(place).or_default().push(i);
        }
        let runs = places.values().map(Vec::len).max().filter(|n| *n > 1)?;
        let positions: Vec<f64> = rows.iter().map(|r| r.position).collect();
        let motions = |head: &Head| {
            let reduced: Vec<FiveDof> = readings.iter().map(|r| head.reduce(r)).collect();
            let aligned = align(head, &positions, &reduced, level).ok()?;
            Some(aligned.motion.iter().map(|m| to_machine(axis, *m)).collect())
        };
        let without = head.without_drift_compensation();
        let motions = [motions(head)?, motions(&without)?, motions(&with_printed_factor(head))?];
        let repeats = places.into_values().filter(|rows| rows.len() > 1).collect();
        Some(Self { runs, repeats, motions })
    }

    /// Standard deviations of an error at the places, mm or rad: compensated, not compensated, with the printed factor.
    #[must_use]
    pub fn std(&self, component: Component) -> [Vec<f64>; 3] {
        self.motions.each_ref().map(|motion| {
            let of =
                |rows: &Vec<usize>| standard_deviation(rows.iter().map(|i| motion[*i][component.index()]));
            self.repeats.iter().map(of).collect()
        })
    }
}

fn standard_deviation(values: impl Iterator<Item = f64> + Clone) -> f64 {
    let n = values.clone().count() as f64;
    let mean = values.clone().sum::<f64>() / n;
    (values.map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0).max(1.0)).sqrt()
}
