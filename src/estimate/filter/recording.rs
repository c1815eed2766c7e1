//! A recording of one component through the filter.

use super::{COMPONENTS_MAX, NodeFilter, Observation, Verdict};
use crate::grid::{NodeGrid, NodePlace};
use crate::noise::MeasurementNoise;

/// A reading of a recording.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// Since the reading before it, s; 0 where the times are not known.
    pub passed_s: f64,
    /// Where, in the coordinates of the grid.
    pub at: [f64; 3],
    /// The reading, in the unit of the state.
    pub value: f64,
}

/// What the filter made of a recording; sizes in the unit of the state.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Run {
    /// Readings.
    pub readings: usize,
    /// Those beyond the gate.
    pub rejected: usize,
    /// So many were rejected in a row that something is wrong.
    pub alarm: bool,
    /// Mean of `nu^2 / S` over the readings that were accepted; one that is far off says nothing about the noise of the others.
    pub mean_ratio: f64,
    /// RMS of the readings that were accepted, before the recording.
    pub before: f64,
    /// The same less the map found.
    pub after: f64,
    /// Readings beyond the grid, which count at its edge.
    pub outside: usize,
}

impl Observation {
    /// A reading of the first component alone.
    #[must_use]
    pub fn alone(place: NodePlace, value: f64) -> Self {
        let mut weights = [0.0; COMPONENTS_MAX];
        weights[0] = 1.0;
        Self { place, weights, value, nuisance: None }
    }
}

impl NodeFilter {
    /// Takes in a recording, in the order of the readings.
    pub fn run(&mut self, noise: &mut MeasurementNoise, grid: &NodeGrid, samples: &[Sample]) -> Run {
        let mut accepted: Vec<&Sample> = Vec::new();
        let mut run = Run { readings: samples.len(), ..Run::default() };
        for sample in samples {
            self.predict(sample.passed_s);
            let reading = Observation::alone(grid.place(sample.at), sample.value);
            run.outside += usize::from(reading.place.outside);
            let update = self.update(&reading, noise);
            run.alarm |= self.alarm();
            if update.verdict == Verdict::Accepted {
                run.mean_ratio += update.ratio();
                run.before += sample.value * sample.value;
                accepted.push(sample);
            }
        }
        run.rejected = run.readings - accepted.len();
        let n = accepted.len() as f64;
        let squares = |s: &&Sample| (s.value - self.value(0, &grid.place(s.at))).powi(2);
        run.after = (accepted.iter().map(squares).sum::<f64>() / n).sqrt();
        run.before = (run.before / n).sqrt();
        run.mean_ratio /= n;
        run
    }
}
