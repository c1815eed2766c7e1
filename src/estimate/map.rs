//! A live map: what the machine's errors differ by from the offline map, on the nodes of a grid.
//!
//! The state of the [`NodeFilter`] is the difference from the offline map, each component in units of its prior
//! standard deviation, so that lengths and angles go together in one covariance. The prior is therefore zero, and what
//! a process of return goes back to is the offline map.
//!
//! A reading is a batch of rows that belong together (a pose gives three of position and two of direction), already of
//! unit variance and independent of each other ([`mod@super::whiten`]). The batch is judged as a whole before any of it is
//! used: an outlier is seldom wrong in one row only. Rows that share what they see update only that combination: of a
//! single pose five of six.
//!
//! **Evidence.** What is learned is used in the measure in which it is more than noise: `w = max(0, 1 - 2 / E)`, E the
//! running mean of `x^T P^-1 x / m` over the m components at the places of the readings (the positive-part rule of James
//! and Stein, with a margin). One weight for all components: errors of a shift and of a turn oppose each other at the
//! tip, and different weights would set them free.
//! Where the offline map is right E is about 1 and nothing is used; where it is wrong E is large and w is near 1.
//!
//! **Age.** Without readings the uncertainty grows back to that of the offline map, and what was learned fades with it:
//! a walk that gains the variance q per second within a prior of variance P0 is a process of memory 2 P0 / q, the
//! longest of the components ([`LiveMap::memory_s`]). The evidence fades as the square of what it is about. So a map
//! that was kept for months, or whose sensors are silent for hours, is used less and less, and in the end not at all.
//!
//! Source: equations 5.8 (Gauss-Markov); James and Stein 1961 for the weight.

mod innovation_gate;

use super::filter::{
    COMPONENTS_MAX, FilterError, NodeFilter, Observation, Process, Rules, Snapshot, Update, Verdict,
};
use super::grid::{NodeGrid, NodePlace};
use super::noise::{Kind, MeasurementNoise};
use super::sensor_initialisation::InnovationSample;

pub use innovation_gate::Batch;

/// Most numbers in the state of one map: its covariance has the square of this many.
pub const STATE_MAX: usize = 1536;
/// Share of each reading in the evidence.
const EVIDENCE_SHARE: f64 = 0.02;
/// Evidence of noise alone, with a margin of one more.
const EVIDENCE_OF_NOISE: f64 = 2.0;

/// One component of a map (an angle in rad, a position in mm).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ComponentRules {
    /// Standard deviation of the offline map.
    pub std: f64,
    /// Variance that a random walk gains per second; not used where the map returns.
    pub variance_per_s: f64,
    /// The output stays within plus and minus this of the offline map.
    pub limit: f64,
}

/// What a map is made of.
#[derive(Debug, Clone, PartialEq)]
pub struct MapRules {
    /// Its nodes.
    pub grid: NodeGrid,
    /// Its components, at most six.
    pub components: Vec<ComponentRules>,
    /// Distance over which the errors of the offline map go together, mm; 0: not at all.
    pub correlation_mm: f64,
    /// Time constant of the return to the offline map, s; `None` is a random walk.
    pub tau_s: Option<f64>,
    /// A batch with a row of `nu^2 / S` above this is not used.
    pub gate: f64,
}

/// Why a map cannot be made.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum MapError {
    /// Too large.
    #[error("{nodes} nodes with {components} components are {found} numbers, the limit is {limit}; take fewer nodes", found = nodes * components, limit = STATE_MAX)]
    TooLarge {
        /// Nodes of the grid.
        nodes: usize,
        /// Components.
        components: usize,
    },
    /// The filter says why.
    #[error(transparent)]
    Filter(#[from] FilterError),
    /// A limit or a rate that is none.
    #[error("{what} {value:e} is not a number above 0")]
    NotPositive {
        /// Which number.
        what: &'static str,
        /// Its value.
        value: f64,
    },
}

/// One number of a batch: what it sees of each component (per mm or rad) and the reading, at unit variance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Row {
    /// Weight of each component.
    pub weights: [f64; COMPONENTS_MAX],
    /// Measured minus the static model.
    pub value: f64,
    /// What one second of delay adds to it.
    pub delay: f64,
    /// Which noise it has.
    pub kind: Kind,
}

/// What a map knew at some time.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Checkpoint {
    snapshot: Snapshot,
    evidence: f64,
    idle_s: f64,
}

/// The map.
#[derive(Debug, Clone, PartialEq)]
pub struct LiveMap {
    rules: MapRules,
    filter: NodeFilter,
    evidence: f64,
    memory_s: f64,
    /// Time since the last reading that was used.
    idle_s: f64,
}

/// Standard deviation of a sensor's unknown delay, s.
pub const DELAY_STD_S: f64 = 5e-3;
/// What its variance grows by, s2/s: 50 us in a minute.
const DELAY_WALK: f64 = 4e-11;

impl LiveMap {
    /// A map that is the offline map.
    ///
    /// # Errors
    /// Too many nodes; a deviation, limit, length or time that is none.
    pub fn new(rules: MapRules) -> Result<Self, MapError> {
        let (nodes, components) = (rules.grid.nodes(), rules.components.len());
        if nodes * components > STATE_MAX {
            return Err(MapError::TooLarge { nodes, components });
        }
        positive("gate", rules.gate)?;
        let mut rates = [0.0; COMPONENTS_MAX];
        for (c, rate) in rules.components.iter().zip(&mut rates) {
            positive("standard deviation of the offline map", c.std)?;
            positive("limit of the map", c.limit)?;
            if !(c.variance_per_s.is_finite() && c.variance_per_s >= 0.0) {
                return Err(MapError::NotPositive { what: "drift of the map", value: c.variance_per_s });
            }
            *rate = c.variance_per_s / (c.std * c.std);
        }
        let (process, memory_s) = match rules.tau_s {
            Some(tau_s) => {
                positive("time constant of the map", tau_s)?;
                (Process::MeanReverting { tau_s }, tau_s)
            }
            None => {
                // rates are in units of the prior's variance; one that is zero never forgets
                let slowest = rates[..components].iter().copied().fold(f64::INFINITY, f64::min);
                let forget_s = 2.0 / slowest;
                (Process::CorrelatedWalk { variance_per_s: rates, forget_s }, forget_s)
            }
        };
        let prior = vec![0.0; nodes * components];
        let gates = Rules { gate: f64::INFINITY, cap_at_prior: true, ..Rules::default() };
        let sigma = vec![1.0; components];
        let filter = NodeFilter::new(&rules.grid, &prior, &sigma, rules.correlation_mm, process, gates)?;
        Ok(Self { rules, filter, evidence: 0.0, memory_s, idle_s: 0.0 })
    }

    /// One more sensor: its delay is estimated with the map, for the error of a map looks like a delay as long as the
    /// machine moves one way. Gives the number by which the sensor's readings are known.
    pub fn add_sensor(&mut self) -> usize {
        // in units of its own standard deviation, like everything else
        self.filter.add_nuisance(1.0, DELAY_WALK / (DELAY_STD_S * DELAY_STD_S))
    }

    /// How much later than its stamp a reading of a sensor is taken, and the standard deviation of that, s.
    #[must_use]
    pub fn delay(&self, sensor: usize) -> [f64; 2] {
        let (value, std) = self.filter.nuisance(sensor);
        [DELAY_STD_S * value, DELAY_STD_S * std]
    }

    /// What it was made of.
    #[must_use]
    pub const fn rules(&self) -> &MapRules {
        &self.rules
    }

    /// Where a point (mm) lies among the nodes.
    #[must_use]
    pub fn place(&self, point: [f64; 3]) -> NodePlace {
        self.rules.grid.place(point)
    }

    /// Lets time pass: the map grows less certain, and what was learned fades.
    pub fn predict(&mut self, seconds: f64) {
        self.filter.predict(seconds);
        self.idle_s += seconds.max(0.0);
    }

    /// Time in which what was learned falls to 1/e where no sensor confirms it, s.
    #[must_use]
    pub const fn memory_s(&self) -> f64 {
        self.memory_s
    }

    /// What a batch differs by and how uncertain the map is there, row by row, in units of the rows' noise.
    pub fn innovations(&mut self, sensor: usize, place: &NodePlace, rows: &[Row]) -> Vec<InnovationSample> {
        let mut found = Vec::with_capacity(rows.len());
        for row in rows {
            let observation = self.observation(sensor, place, row);
            let (innovation, uncertainty) = self.filter.expect(&observation);
            let prior = observation.weights.iter().map(|w| w * w).sum();
            found.push(InnovationSample { innovation, uncertainty, prior, kind: row.kind });
        }
        found
    }

    /// Takes a batch that was judged fit; gives its consistency as the filter saw it, row after row.
    pub fn update(
        &mut self,
        sensor: usize,
        place: &NodePlace,
        rows: &[Row],
        noise: &mut [MeasurementNoise; 2],
    ) -> Batch {
        let mut batch = Batch::default();
        for row in rows {
            let noise = &mut noise[row.kind.index()];
            let before = noise.variance();
            let Update { verdict, innovation, innovation_variance, .. } =
                self.filter.update(&self.observation(sensor, place, row), noise);
            if verdict == Verdict::Accepted {
                batch.add(innovation, innovation_variance, before);
            }
        }
        if let Some(seen) = self.filter.evidence_at(place) {
            // after a long silence the new reading counts for more than what was there before
            let share = 1.0 - (1.0 - EVIDENCE_SHARE) * (-self.idle_s / self.memory_s).exp();
            self.evidence += share * (seen - self.evidence);
            self.idle_s = 0.0;
        }
        batch.finish()
    }

    /// Time since the last reading that was used, s.
    #[must_use]
    pub const fn idle_s(&self) -> f64 {
        self.idle_s
    }

    /// The largest of what would be used at the nodes, as a share of its limit: above 1 the limit acts.
    #[must_use]
    pub fn largest_share(&self) -> f64 {
        let (per, weight) = (self.rules.grid.nodes(), self.weight());
        let share = |(i, x): (usize, &f64)| {
            let ComponentRules { std, limit, .. } = self.rules.components[i / per];
            (weight * std * x).abs() / limit
        };
        self.filter.state().iter().enumerate().map(share).fold(0.0, f64::max)
    }

    /// The weight with which the map is used, 0 to 1.
    #[must_use]
    pub fn weight(&self) -> f64 {
        1.0 - EVIDENCE_OF_NOISE / self.evidence().max(EVIDENCE_OF_NOISE)
    }

    /// Difference of component `c` from the offline map as it is to be used: weighted and within the limit.
    #[must_use]
    pub fn output(&self, c: usize, place: &NodePlace) -> f64 {
        let nodes = self.rules.grid.nodes();
        let sum: f64 =
            place.nodes.iter().zip(&place.shape).map(|(n, s)| s * self.node_output(c * nodes + n)).sum();
        sum
    }

    /// Difference of component `c` from the offline map as it is estimated, and its standard deviation.
    #[must_use]
    pub fn estimate(&self, c: usize, place: &NodePlace) -> (f64, f64) {
        let scale = self.rules.components[c].std;
        (scale * self.filter.value(c, place), scale * self.filter.std_at(c, place))
    }

    fn node_output(&self, i: usize) -> f64 {
        let c = i / self.rules.grid.nodes();
        let ComponentRules { std, limit, .. } = self.rules.components[c];
        (self.weight() * std * self.filter.state()[i]).clamp(-limit, limit)
    }

    /// What is to be used at the nodes, components one after the other.
    pub fn outputs(&self) -> impl ExactSizeIterator<Item = f64> + '_ {
        (0..self.filter.state().len()).map(|i| self.node_output(i))
    }

    /// What is estimated at the nodes, and its standard deviation, components one after the other.
    pub fn nodes(&self) -> impl ExactSizeIterator<Item = (f64, f64)> + '_ {
        let per = self.rules.grid.nodes();
        let scale = move |i: usize| self.rules.components[i / per].std;
        let values = self.filter.state().iter().zip(self.filter.variances());
        values.enumerate().map(move |(i, (x, v))| (scale(i) * x, scale(i) * v.max(0.0).sqrt()))
    }

    /// How much more than noise the map is, as old as it is.
    #[must_use]
    pub fn evidence(&self) -> f64 {
        self.evidence * (-2.0 * self.idle_s / self.memory_s).exp()
    }

    /// Puts back what was kept: differences and standard deviations of the nodes, evidence. False,
    /// and nothing changed, where a number is none or beyond the limits.
    pub fn restore(&mut self, nodes: &[(f64, f64)], evidence: f64) -> bool {
        let per = self.rules.grid.nodes();
        let fits = nodes.len() == self.filter.state().len() && evidence.is_finite() && evidence >= 0.0;
        if !fits {
            return false;
        }
        let of = |i: usize| self.rules.components[i / per];
        if nodes.iter().enumerate().any(|(i, (x, _))| x.is_nan() || x.abs() > RESTORED_MAX * of(i).limit) {
            return false;
        }
        let (state, std): (Vec<f64>, Vec<f64>) =
            nodes.iter().enumerate().map(|(i, (x, s))| (x / of(i).std, s / of(i).std)).unzip();
        if !self.filter.restore(&state, &std) {
            return false;
        }
        (self.evidence, self.idle_s) = (evidence, 0.0);
        true
    }

    /// Remembers what is known now; the memory of an older checkpoint is used again.
    pub fn save_to(&self, checkpoint: &mut Checkpoint) {
        self.filter.save_to(&mut checkpoint.snapshot);
        (checkpoint.evidence, checkpoint.idle_s) = (self.evidence, self.idle_s);
    }

    /// Back to what was known `age_s` ago.
    pub fn load(&mut self, checkpoint: &Checkpoint, age_s: f64) {
        self.filter.load(&checkpoint.snapshot);
        (self.evidence, self.idle_s) = (checkpoint.evidence, checkpoint.idle_s);
        self.predict(age_s);
    }

    /// Back to the offline map.
    pub fn forget(&mut self) {
        self.filter.forget();
        (self.evidence, self.idle_s) = (0.0, 0.0);
    }

    fn observation(&self, sensor: usize, place: &NodePlace, row: &Row) -> Observation {
        let mut weights = [0.0; COMPONENTS_MAX];
        for (c, rules) in self.rules.components.iter().enumerate() {
            weights[c] = row.weights[c] * rules.std;
        }
        let nuisance = (row.delay != 0.0).then_some((sensor, row.delay * DELAY_STD_S));
        Observation { place: *place, weights, value: row.value, nuisance }
    }
}

/// An estimate that was kept may lie beyond the limit of the output by this factor; more is damage.
const RESTORED_MAX: f64 = 10.0;

fn positive(what: &'static str, value: f64) -> Result<(), MapError> {
    if value.is_finite() && value > 0.0 { Ok(()) } else { Err(MapError::NotPositive { what, value }) }
}

#[cfg(test)]
mod tests;
