//! Initialisation of a sensor before anything is learned from it: its noise, and whether it agrees with the map.
//!
//! A filter that starts with a noise five times too small takes every honest reading for an outlier, and one that
//! starts five times too large learns from lies. So the first readings are only looked at. What changes from one
//! reading to the next is noise, for the map's error hardly changes: the variance is half the median of the squared
//! differences, over 0.4549 (the median of chi-square with one degree of freedom), which half of all readings may
//! spoil before it is wrong. Noise that changes slowly hides from that, so the scatter about the median counts where it is
//! larger: too much noise to begin with is learned away, too little locks an honest sensor out. Then the median
//! innovation must fit the uncertainty of the map.
//!
//! The same decides about the return of a sensor that was excluded for disagreeing. Lengths and angles are judged apart:
//! of what is stated one may be too small while the other is too large.

use super::noise::Kind;
use volcomp_model::statistics;

/// Median of chi-square with one degree of freedom.
const CHI2_MEDIAN: f64 = 0.454_936_4;
/// Variance of a median over that of a mean, for normal noise.
const MEDIAN_COST: f64 = core::f64::consts::FRAC_PI_2;

/// What was found out about a sensor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NoiseAssessment {
    /// Variance of its noise (lengths, angles), in units of the stated one: what changes from one reading to the next.
    /// 1 of what it does not measure.
    pub variance: [f64; 2],
    /// Variance about the median, where that is larger: what the filter may begin with.
    pub begin_with: [f64; 2],
    /// Largest squared median innovation over its variance: above the gate it disagrees with the map.
    pub disagreement: f64,
}

/// One number of a reading that is only looked at.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InnovationSample {
    /// What it differs by from the map, in units of the stated noise.
    pub innovation: f64,
    /// Variance of the map there, in the square of that.
    pub uncertainty: f64,
    /// The same of the offline map.
    pub prior: f64,
    /// What it is.
    pub kind: Kind,
}

/// Readings that are only looked at.
#[derive(Debug, Clone, PartialEq)]
pub struct SensorInitialisation {
    wanted: usize,
    /// What each row of a reading is.
    rows: Vec<Kind>,
    /// Innovations, reading by reading.
    innovations: Vec<f64>,
    /// Sum over the readings of what the map is uncertain by, row by row.
    uncertainty: Vec<f64>,
}

impl SensorInitialisation {
    /// Looks at `wanted` readings, at least three.
    #[must_use]
    pub fn new(wanted: usize) -> Self {
        Self { wanted: wanted.max(3), rows: Vec::new(), innovations: Vec::new(), uncertainty: Vec::new() }
    }

    /// Readings seen, and wanted.
    #[must_use]
    pub fn progress(&self) -> (usize, usize) {
        (self.innovations.len().checked_div(self.rows.len()).unwrap_or(0), self.wanted)
    }

    /// One more reading, row by row. The opinion, once there are enough; it then starts over.
    pub fn add(&mut self, rows: &[InnovationSample]) -> Option<NoiseAssessment> {
        if rows.is_empty() || rows.iter().any(|r| !(r.innovation.is_finite() && r.uncertainty.is_finite())) {
            return None;
        }
        if !self.rows.iter().eq(rows.iter().map(|r| &r.kind)) {
            self.rows = rows.iter().map(|r| r.kind).collect();
            self.innovations.clear();
            self.uncertainty = vec![0.0; rows.len()];
        }
        self.innovations.extend(rows.iter().map(|r| r.innovation));
        for (sum, row) in self.uncertainty.iter_mut().zip(rows) {
            *sum += row.uncertainty;
        }
        let readings = self.innovations.len() / self.rows.len();
        if readings < self.wanted {
            return None;
        }
        let assessment = self.assessment(readings);
        self.innovations.clear();
        self.uncertainty.fill(0.0);
        Some(assessment)
    }

    fn assessment(&self, readings: usize) -> NoiseAssessment {
        let row = |r: usize| -> Vec<f64> {
            self.innovations.chunks_exact(self.rows.len()).map(|line| line[r]).collect()
        };
        let of = |kind: Kind| (0..self.rows.len()).filter(move |r| self.rows[*r] == kind);
        let (mut variance, mut begin_with) = ([1.0; 2], [1.0; 2]);
        for kind in Kind::ALL.into_iter().filter(|kind| self.rows.contains(kind)) {
            let steps = |r| row(r).windows(2).map(|w| (w[0] - w[1]).powi(2)).collect::<Vec<f64>>();
            let fast = median(of(kind).flat_map(steps).collect()) / (2.0 * CHI2_MEDIAN);
            let about = |r: usize| {
                let middle = median(row(r));
                row(r).into_iter().map(move |v| (v - middle).powi(2))
            };
            let scatter = median(of(kind).flat_map(about).collect()) / CHI2_MEDIAN;
            (variance[kind.index()], begin_with[kind.index()]) = (fast, fast.max(scatter));
        }
        let n = readings as f64;
        let disagreement = (0..self.rows.len())
            .map(|r| {
                let (middle, noise) = (median(row(r)), begin_with[self.rows[r].index()]);
                middle * middle / (self.uncertainty[r] / n + MEDIAN_COST * noise / n)
            })
            .fold(0.0, f64::max);
        NoiseAssessment { variance, begin_with, disagreement }
    }
}

fn median(values: Vec<f64>) -> f64 {
    statistics::median(values).unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    fn look(seed: u64, sigma: f64, bias: f64, outliers: bool) -> NoiseAssessment {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut it = SensorInitialisation::new(25);
        for i in 0.. {
            let rows: [InnovationSample; 5] = core::array::from_fn(|r| {
                let z: f64 = StandardNormal.sample(&mut random);
                // angles are as much quieter as lengths are noisier
                let (sigma, kind) = if r < 3 { (sigma, Kind::Length) } else { (1.0 / sigma, Kind::Angle) };
                let wild = if outliers && i % 10 == 4 { 300.0 } else { 0.0 };
                InnovationSample { innovation: bias + sigma * z + wild, uncertainty: 4.0, prior: 4.0, kind }
            });
            if let Some(assessment) = it.add(&rows) {
                assert_eq!(i, 24);
                return assessment;
            }
        }
        unreachable!()
    }

    #[test]
    fn noise_is_found_whatever_was_stated_and_outliers_do_not_matter() {
        for sigma in [0.2, 1.0, 5.0] {
            for (kind, truth) in Kind::ALL.into_iter().zip([sigma, 1.0 / sigma]) {
                let of = |s: u64, outliers: bool| look(s, sigma, 1.0, outliers).variance[kind.index()];
                let mean: f64 = (0..100).map(|s| of(s, false)).sum::<f64>() / 100.0;
                assert!((mean / truth.powi(2) - 1.0).abs() < 0.1, "{sigma} {kind:?}: {mean}");
                let worst = (0..100).map(|s| of(s, true)).fold(0.0, f64::max);
                assert!(worst < 5.5 * truth * truth, "{sigma} {kind:?}: {worst}");
            }
        }
    }

    #[test]
    fn a_bias_beyond_the_map_is_a_disagreement() {
        assert!((0..100).all(|s| look(s, 1.0, 2.0, true).disagreement < 10.8));
        assert!((0..100).all(|s| look(s, 1.0, 10.0, false).disagreement > 10.8));
    }

    #[test]
    fn readings_of_another_shape_start_over_and_nonsense_is_left_out() {
        let row = |innovation: f64| InnovationSample {
            innovation,
            uncertainty: 1.0,
            prior: 1.0,
            kind: Kind::Length,
        };
        let mut it = SensorInitialisation::new(3);
        assert_eq!(it.add(&[row(1.0); 2]), None);
        assert_eq!(it.add(&[row(1.0); 3]), None);
        assert_eq!(it.add(&[row(f64::NAN); 3]), None);
        assert_eq!(it.add(&[]), None);
        assert_eq!(it.progress(), (1, 3));
        assert_eq!(it.add(&[row(2.0); 3]), None);
        assert!(it.add(&[row(1.0); 3]).is_some());
        assert_eq!(it.progress(), (0, 3));
    }
}
