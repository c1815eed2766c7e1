//! What the comparison of all sets of effects says.

use super::super::constants::SURE;
use super::covariance::{Component, Covariance};

/// An effect that some likely set holds.
#[derive(Debug, Clone, PartialEq)]
pub struct Contender {
    /// Its label, an index into the library.
    pub label: usize,
    /// Its best variant.
    pub variant: usize,
    /// Posterior probability.
    pub probability: f64,
    /// Probability that it or one of its rivals is at work.
    pub group_probability: f64,
    /// Labels that take its place in a set, with the posterior probability of those sets.
    pub rivals: Vec<(usize, f64)>,
    /// Pairs of labels that say together what it says.
    pub sums: Vec<[usize; 2]>,
    /// Labels with the same column.
    pub aliases: Vec<usize>,
    /// A member of the likeliest set.
    pub chosen: bool,
    /// Log evidence that the likeliest set loses without it (or the best set with it lacks of the likeliest).
    pub log_evidence: f64,
    /// Mean square of what it says of the gap in the setups in which it acts, as a member of the likeliest set, um^2; 0 of others.
    pub own_um2: f64,
    /// Mean square of the discrepancy there, but for its own misform, um^2.
    pub beside_um2: f64,
}

/// Mean squares of the parts of the gap, um^2: posterior means.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Shares {
    /// Named effects.
    pub named_um2: f64,
    /// Discrepancy and lack of fit.
    pub discrepancy_um2: f64,
    /// Drift and offsets of runs.
    pub drift_um2: f64,
    /// The rest.
    pub noise_um2: f64,
}

/// What the comparison says.
#[derive(Debug, Clone, PartialEq)]
pub struct Comparison {
    /// Rows of the session behind each reading or mean of readings that carried it.
    pub groups: Vec<Vec<usize>>,
    /// Logarithm of the marginal likelihood of all sets.
    pub log_evidence: f64,
    /// All effects in likely sets, the likeliest first.
    pub contenders: Vec<Contender>,
    /// Probability of a discrepancy.
    pub discrepancy: f64,
    /// Its parts.
    pub shares: Shares,
    /// Scales of the components in the likeliest case, in units of the white noise.
    pub scales: Vec<(Component, f64)>,
    /// White noise, um.
    pub white_um: f64,
    /// White noise of a reading by those that were averaged, um, where enough were.
    pub within_um: Option<f64>,
    /// Drift, um, and its correlation time, s.
    pub drift: (f64, f64),
    /// Independent readings that the covariance amounts to.
    pub effective: f64,
    /// Rows of the session that count less, with their weight.
    pub outlying: Vec<(usize, f64)>,
    /// Whitening of the likeliest case, in units of the white noise.
    pub covariance: Covariance,
}

impl Comparison {
    /// White noise of a reading, um.
    #[must_use]
    pub fn reading_um(&self) -> f64 {
        self.within_um.unwrap_or(self.white_um)
    }

    /// Mean square of what is no white noise and shorter than the means that were compared, um^2.
    #[must_use]
    pub fn finer_um2(&self) -> f64 {
        let beyond = |within_um: f64| (self.white_um > SURE * within_um).then_some(within_um);
        self.within_um.and_then(beyond).map_or(0.0, |within_um| self.white_um.powi(2) - within_um.powi(2))
    }
}
