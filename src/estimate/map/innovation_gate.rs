//! The innovation gate: whether a batch of readings may be used, judged as a whole before any of it is.

use super::super::grid::NodePlace;
use super::super::noise::MeasurementNoise;
use super::{LiveMap, Row};

/// What became of a batch.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Batch {
    /// Rows that say something about the map.
    pub rows: u32,
    /// Sum of `nu^2 / S` over them: about their number where everything is right.
    pub nis: f64,
    /// The largest of them.
    pub worst: f64,
    /// RMS innovation in standard deviations of the sensor.
    pub innovation: f64,
    /// RMS of its expected value.
    pub expected: f64,
}

impl Batch {
    pub(super) fn add(&mut self, innovation: f64, variance: f64, noise: f64) {
        // a row that sees nothing of the map says nothing about it
        if !(innovation.is_finite() && variance.is_finite() && variance > noise) {
            return;
        }
        let ratio = innovation * innovation / variance;
        self.rows += 1;
        self.nis += ratio;
        self.worst = self.worst.max(ratio);
        self.innovation += innovation * innovation;
        self.expected += variance;
    }

    pub(super) fn finish(mut self) -> Self {
        if self.rows > 0 {
            self.innovation = (self.innovation / f64::from(self.rows)).sqrt();
            self.expected = (self.expected / f64::from(self.rows)).sqrt();
        }
        self
    }
}

impl LiveMap {
    /// Compares a batch with the map, at the noise of lengths and of angles; nothing is changed.
    pub fn judge(
        &mut self,
        sensor: usize,
        place: &NodePlace,
        rows: &[Row],
        noise: &[MeasurementNoise; 2],
    ) -> Batch {
        let mut batch = Batch::default();
        for row in rows {
            let noise = &noise[row.kind.index()];
            let (innovation, variance) = self.filter.compare(&self.observation(sensor, place, row), noise);
            batch.add(innovation, variance, noise.variance());
        }
        batch.finish()
    }

    /// True where a batch may be used.
    #[must_use]
    pub fn is_inside_gate(&self, batch: &Batch) -> bool {
        batch.rows > 0 && batch.worst <= self.rules.gate
    }
}
