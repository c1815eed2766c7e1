//! Kalman filter on the node values of a grid, one or several components (angles, positions) stacked.
//!
//! State: for each component all nodes. An observation is one number: a weighted sum of components at one place
//! (a pose that shows five of six combinations is five observations), `z = SUM_c w_c N(place) x_c + v`. Scalar updates
//! in Joseph form, `P = (I - K h) P- (I - K h)^T + K R K^T`, kept symmetric.
//!
//! Source: equations 5.8. Gate, alarm, caps and the bounded output are there, too.

mod recording;

use nalgebra::{DMatrix, DVector};

use super::grid::{NodeGrid, NodePlace};
use super::noise::MeasurementNoise;
use volcomp_model::ErrorFunction;
use volcomp_model::axes::AxisName;
use volcomp_model::curve::{CurveError, Grid};

pub use recording::{Run, Sample};

/// Most components of one filter: three angles and three positions.
pub const COMPONENTS_MAX: usize = 6;

/// How the map may change between measurements.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Process {
    /// Every node wanders: its variance grows by this much per second.
    RandomWalk {
        /// Square of the state's unit per second.
        variance_per_s: f64,
    },
    /// Every node returns to the prior map with this time constant; uncertainty never grows beyond the prior's.
    MeanReverting {
        /// Seconds.
        tau_s: f64,
    },
    /// The map wanders as a whole: neighbours move together as the prior says, so that nodes nobody visits go on
    /// following those that are measured. What was learned is forgotten meanwhile, for a map that has wandered as far
    /// as the prior is wide says nothing about today.
    CorrelatedWalk {
        /// Square of the state's unit per second, of each component.
        variance_per_s: [f64; COMPONENTS_MAX],
        /// Seconds in which what was learned falls to 1/e; infinite: it is kept. One for all components, for errors
        /// of a shift and of a turn that oppose each other must go together.
        forget_s: f64,
    },
}

/// Why a filter cannot be built.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum FilterError {
    /// Components are at least one and few.
    #[error("{found} components; a filter has 1 to {limit}", limit = COMPONENTS_MAX)]
    Components {
        /// Components found.
        found: usize,
    },
    /// The prior map must have one value per node and component.
    #[error("the prior map has {found} values, the grid needs {expected}")]
    PriorSize {
        /// Values found.
        found: usize,
        /// Values needed.
        expected: usize,
    },
    /// A value of the prior map is no number.
    #[error("value {} of the prior map is not finite", index + 1)]
    PriorNotFinite {
        /// 0-based index.
        index: usize,
    },
    /// A standard deviation must be a positive number.
    #[error("standard deviation {value:e} of the prior map is not a number above 0")]
    BadSigma {
        /// The value.
        value: f64,
    },
    /// A correlation length must not be negative.
    #[error("correlation length {value} mm is not a number from 0 up")]
    BadCorrelation {
        /// The value.
        value: f64,
    },
}

/// Bounds within which measurements may act.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rules {
    /// A reading with `nu^2 / S` above this is not used; infinite: no gate.
    pub gate: f64,
    /// After this many rejections in a row the alarm is raised.
    pub rejections_to_alarm: u32,
    /// The output stays within plus and minus this of the prior map; infinite: no limit.
    pub limit: f64,
    /// The uncertainty of a node never grows beyond that of the prior.
    pub cap_at_prior: bool,
}

impl Default for Rules {
    /// 99.9 % gate, alarm after five rejections, covariance capped, output not limited.
    fn default() -> Self {
        Self { gate: 10.8, rejections_to_alarm: 5, limit: f64::INFINITY, cap_at_prior: true }
    }
}

/// One number that was measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Observation {
    /// Where.
    pub place: NodePlace,
    /// Weight of each component; entries beyond the filter's components are ignored.
    pub weights: [f64; COMPONENTS_MAX],
    /// The reading, in the unit of the state.
    pub value: f64,
    /// A number beside the map that the reading depends on, too ([`NodeFilter::add_nuisance`]): which, and its weight.
    pub nuisance: Option<(usize, f64)>,
}

/// What became of an observation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// The state was updated.
    Accepted,
    /// Beyond the gate.
    Rejected,
    /// No number, or nothing of the state in it.
    Unusable,
}

/// Record of one update.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Update {
    /// What became of it.
    pub verdict: Verdict,
    /// Reading minus expectation.
    pub innovation: f64,
    /// Variance of that, the sensor's included.
    pub innovation_variance: f64,
    /// Measurement variance after the update.
    pub measurement_variance: f64,
    /// Rejections in a row; at the rules' number and above there is an alarm.
    pub rejections: u32,
}

impl Update {
    /// `nu^2 / S`: about 1 in the mean where everything is right.
    #[must_use]
    pub fn ratio(&self) -> f64 {
        self.innovation * self.innovation / self.innovation_variance
    }
}

/// A state of the filter, to go back to.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Snapshot {
    x: Vec<f64>,
    p: Vec<f64>,
}

/// The filter. All storage is made at construction.
#[derive(Debug, Clone, PartialEq)]
pub struct NodeFilter {
    nodes: usize,
    components: usize,
    process: Process,
    rules: Rules,
    /// The offline map.
    prior: Vec<f64>,
    /// Its covariance, row by row.
    prior_covariance: Vec<f64>,
    x: Vec<f64>,
    p: Vec<f64>,
    /// `P h^T`, the gain, and a column of work.
    ph: Vec<f64>,
    k: Vec<f64>,
    work: Vec<f64>,
    rejections: u32,
    /// What the variance of each number beside the map grows by, per second.
    nuisance_rates: Vec<f64>,
}

impl NodeFilter {
    /// A filter that starts from the offline map `prior` (components one after the other, nodes in the grid's order)
    /// with standard deviation `sigma[c]` per component; nodes of a component are correlated by
    /// `exp(-|ri - rj|^2 / (2 l^2))`, not at all where `correlation_mm` is 0.
    ///
    /// # Errors
    /// No component or too many, a prior of another size than the grid's, numbers that are no lengths or deviations.
    pub fn new(
        grid: &NodeGrid,
        prior: &[f64],
        sigma: &[f64],
        correlation_mm: f64,
        process: Process,
        rules: Rules,
    ) -> Result<Self, FilterError> {
        let nodes = grid.nodes();
        let components = sigma.len();
        if !(1..=COMPONENTS_MAX).contains(&components) {
            return Err(FilterError::Components { found: components });
        }
        if prior.len() != nodes * components {
            return Err(FilterError::PriorSize { found: prior.len(), expected: nodes * components });
        }
        if let Some(i) = prior.iter().position(|x| !x.is_finite()) {
            return Err(FilterError::PriorNotFinite { index: i });
        }
        if let Some(value) = sigma.iter().find(|s| !(s.is_finite() && **s > 0.0)) {
            return Err(FilterError::BadSigma { value: *value });
        }
        if !(correlation_mm.is_finite() && correlation_mm >= 0.0) {
            return Err(FilterError::BadCorrelation { value: correlation_mm });
        }
        let n = prior.len();
        let mut covariance = vec![0.0; n * n];
        for (c, sigma) in sigma.iter().enumerate() {
            for i in 0..nodes {
                for j in 0..nodes {
                    let correlation = if i == j {
                        1.0
                    } else if correlation_mm > 0.0 {
                        let (a, b) = (grid.node(i), grid.node(j));
                        let squared: f64 = a.iter().zip(&b).map(|(a, b)| (a - b) * (a - b)).sum();
                        (-squared / (2.0 * correlation_mm * correlation_mm)).exp()
                    } else {
                        0.0
                    };
                    covariance[(c * nodes + i) * n + c * nodes + j] = sigma * sigma * correlation;
                }
            }
        }
        Ok(Self {
            nodes,
            components,
            process,
            rules,
            prior: prior.to_vec(),
            x: prior.to_vec(),
            p: covariance.clone(),
            prior_covariance: covariance,
            ph: vec![0.0; n],
            k: vec![0.0; n],
            work: vec![0.0; n],
            rejections: 0,
            nuisance_rates: Vec::new(),
        })
    }

    /// One more number that readings may depend on: zero with this variance, which grows by `rate` per second and never
    /// beyond what it was. It stands behind the nodes and is estimated with them, so that neither takes what belongs to
    /// the other. Gives its number.
    pub fn add_nuisance(&mut self, variance: f64, rate: f64) -> usize {
        let old = self.x.len();
        let n = old + 1;
        for matrix in [&mut self.p, &mut self.prior_covariance] {
            let mut grown = vec![0.0; n * n];
            for i in 0..old {
                grown[i * n..i * n + old].copy_from_slice(&matrix[i * old..(i + 1) * old]);
            }
            grown[n * n - 1] = variance;
            *matrix = grown;
        }
        for list in [&mut self.prior, &mut self.x, &mut self.ph, &mut self.k, &mut self.work] {
            list.push(0.0);
        }
        self.nuisance_rates.push(rate);
        self.nuisance_rates.len() - 1
    }

    /// A number beside the map, and its standard deviation.
    #[must_use]
    pub fn nuisance(&self, index: usize) -> (f64, f64) {
        let (n, i) = (self.x.len(), self.nodes * self.components + index);
        (self.x[i], self.p[i * n + i].max(0.0).sqrt())
    }

    /// Lets time pass.
    ///
    /// # Cycle   no allocation; grows with the square of the state where the process reverts, else with the state
    pub fn predict(&mut self, seconds: f64) {
        if seconds.is_nan() || seconds <= 0.0 {
            return;
        }
        let n = self.x.len();
        let map = self.nodes * self.components;
        for (i, rate) in self.nuisance_rates.iter().enumerate() {
            self.p[(map + i) * (n + 1)] += rate * seconds;
        }
        match self.process {
            Process::RandomWalk { variance_per_s } => {
                for i in 0..map {
                    self.p[i * n + i] += variance_per_s * seconds;
                }
            }
            Process::MeanReverting { tau_s } => {
                let stays = (-seconds / tau_s).exp();
                for (x, prior) in self.x.iter_mut().zip(&self.prior).take(map) {
                    *x = prior + stays * (*x - prior);
                }
                // what was forgotten is as uncertain as the prior
                let (old, new) = (stays * stays, 1.0 - stays * stays);
                for (i, line) in self.p.chunks_exact_mut(n).enumerate() {
                    let prior = &self.prior_covariance[i * n..(i + 1) * n];
                    for (j, (p, prior)) in line.iter_mut().zip(prior).enumerate() {
                        *p = match (i < map, j < map) {
                            (true, true) => old * *p + new * prior,
                            (false, false) => *p,
                            _ => stays * *p,
                        };
                    }
                }
            }
            Process::CorrelatedWalk { variance_per_s, forget_s } => {
                let stays = (-seconds / forget_s).exp();
                for (x, prior) in self.x.iter_mut().zip(&self.prior).take(map) {
                    *x = prior + stays * (*x - prior);
                }
                for (c, rate) in variance_per_s.iter().enumerate().take(self.components) {
                    let first = c * self.nodes;
                    let share = rate * seconds / self.prior_covariance[first * n + first];
                    for i in first..first + self.nodes {
                        let block = i * n + first..i * n + first + self.nodes;
                        let prior = &self.prior_covariance[block.clone()];
                        self.p[block].iter_mut().zip(prior).for_each(|(p, prior)| *p += share * prior);
                    }
                }
            }
        }
        self.cap();
    }

    /// What a reading differs by from the expectation, and the variance of that; nothing is changed.
    ///
    /// # Cycle   no allocation
    pub fn compare(&mut self, observation: &Observation, noise: &MeasurementNoise) -> (f64, f64) {
        let (innovation, variance) = self.expect(observation);
        (innovation, variance + noise.variance())
    }

    /// The same without the sensor's own noise.
    ///
    /// # Cycle   no allocation
    pub fn expect(&mut self, observation: &Observation) -> (f64, f64) {
        (observation.value - self.expected(observation), self.project(observation))
    }

    /// Puts a state back that was kept, with the standard deviations of its nodes; how nodes go together is the
    /// prior's again. Nothing is changed, and false given, where a number is none or beyond what the prior allows.
    pub fn restore(&mut self, state: &[f64], std: &[f64]) -> bool {
        let n = self.x.len();
        let map = self.nodes * self.components;
        let sane = state.len() == map
            && std.len() == map
            && state.iter().all(|x| x.is_finite())
            && (0..map).all(|i| std[i].is_finite() && std[i] > 0.0)
            && (0..map).all(|i| (state[i] - self.prior[i]).abs() <= self.rules.limit);
        if !sane {
            return false;
        }
        self.x[..map].copy_from_slice(state);
        self.x[map..].fill(0.0);
        self.p.copy_from_slice(&self.prior_covariance);
        self.work.fill(1.0);
        for (i, (work, std)) in self.work.iter_mut().zip(std).enumerate() {
            *work = (std / self.prior_covariance[i * n + i].sqrt()).min(1.0);
        }
        self.scale_by_work();
        self.rejections = 0;
        true
    }

    /// Back to the prior map.
    pub fn forget(&mut self) {
        self.x.copy_from_slice(&self.prior);
        self.p.copy_from_slice(&self.prior_covariance);
        self.rejections = 0;
    }

    /// Remembers the state; the memory of an older one is used again.
    pub fn save_to(&self, snapshot: &mut Snapshot) {
        snapshot.x.clone_from(&self.x);
        snapshot.p.clone_from(&self.p);
    }

    /// Back to a state of this filter; one of another size changes nothing.
    pub fn load(&mut self, snapshot: &Snapshot) {
        if snapshot.x.len() == self.x.len() && snapshot.p.len() == self.p.len() {
            self.x.copy_from_slice(&snapshot.x);
            self.p.copy_from_slice(&snapshot.p);
        }
    }

    /// Takes a reading.
    ///
    /// # Cycle   no allocation; grows with the square of the state (meant to run beside the cycle)
    pub fn update(&mut self, observation: &Observation, noise: &mut MeasurementNoise) -> Update {
        let innovation = observation.value - self.expected(observation);
        let hph = self.project(observation);
        let variance = hph + noise.variance();
        let mut record = Update {
            verdict: Verdict::Accepted,
            innovation,
            innovation_variance: variance,
            measurement_variance: noise.variance(),
            rejections: self.rejections,
        };
        if !(innovation.is_finite() && variance.is_finite() && hph > 0.0) {
            record.verdict = Verdict::Unusable;
            return record;
        }
        if innovation * innovation > self.rules.gate * variance {
            self.rejections = self.rejections.saturating_add(1);
            record.verdict = Verdict::Rejected;
            record.rejections = self.rejections;
            return record;
        }
        self.rejections = 0;
        for ((k, ph), x) in self.k.iter_mut().zip(&self.ph).zip(&mut self.x) {
            *k = ph / variance;
            *x += *k * innovation;
        }
        self.joseph(observation, noise.variance());
        self.cap();
        let residual = observation.value - self.expected(observation);
        let hph = self.project(observation);
        noise.learn(residual, hph);
        record.measurement_variance = noise.variance();
        record.rejections = 0;
        record
    }

    /// True after as many rejections in a row as the rules name.
    #[must_use]
    pub const fn alarm(&self) -> bool {
        self.rejections >= self.rules.rejections_to_alarm
    }

    /// The value of one component at a place, held within the limit about the prior map.
    ///
    /// # Cycle   no allocation
    #[must_use]
    pub fn value(&self, component: usize, place: &NodePlace) -> f64 {
        let first = component * self.nodes;
        place.nodes.iter().zip(&place.shape).map(|(node, shape)| shape * self.bounded(first + node)).sum()
    }

    /// Standard deviation of that (k = 1), before the limit.
    #[must_use]
    pub fn std_at(&self, component: usize, place: &NodePlace) -> f64 {
        let (n, first) = (self.x.len(), component * self.nodes);
        let mut sum = 0.0;
        for (a, sa) in place.nodes.iter().zip(&place.shape) {
            for (b, sb) in place.nodes.iter().zip(&place.shape) {
                sum += sa * sb * self.p[(first + a) * n + first + b];
            }
        }
        sum.max(0.0).sqrt()
    }

    /// How much more than noise the state is at a place: `x^T P^-1 x` over the number of components, about 1 where it is
    /// noise alone. All components at once, for their errors oppose each other (a shift and a turn with a lever).
    #[must_use]
    pub fn evidence_at(&self, place: &NodePlace) -> Option<f64> {
        let (n, count) = (self.x.len(), self.components);
        let at = |c: usize, corner: usize| (c * self.nodes + place.nodes[corner], place.shape[corner]);
        let x = DVector::from_fn(count, |c, _| (0..8).map(|k| at(c, k)).map(|(i, s)| s * self.x[i]).sum());
        let p = DMatrix::from_fn(count, count, |c, d| {
            let mut sum = 0.0;
            for (i, si) in (0..8).map(|k| at(c, k)) {
                for (j, sj) in (0..8).map(|k| at(d, k)) {
                    sum += si * sj * self.p[i * n + j];
                }
            }
            sum
        });
        let evidence = x.dot(&p.cholesky()?.solve(&x)) / count as f64;
        evidence.is_finite().then_some(evidence)
    }

    /// The state: components one after the other.
    #[must_use]
    pub fn state(&self) -> &[f64] {
        &self.x[..self.nodes * self.components]
    }

    /// The state as it may be used: within the limit about the prior map.
    pub fn map(&self) -> impl ExactSizeIterator<Item = f64> + '_ {
        (0..self.nodes * self.components).map(|i| self.bounded(i))
    }

    /// An error with the map of the first component as one more grid over `axes`, or in place of a grid over the same nodes.
    ///
    /// # Errors
    /// The nodes make no grid of a model.
    pub fn added_to(
        &self,
        mut function: ErrorFunction,
        axes: [AxisName; 3],
        grid: &NodeGrid,
    ) -> Result<ErrorFunction, CurveError> {
        // the grid of the model has its last axis fastest, the filter its first
        let edges = |i: usize| (axes[i], grid.positions(i).to_vec());
        let mut values: Vec<f64> = self.map().collect();
        let is_same = |g: &Grid| {
            g.axes().eq([axes[2], axes[1], axes[0]])
                && (0..3).all(|i| g.positions(i) == grid.positions(2 - i))
        };
        if let Some(at) = function.grids.iter().position(is_same) {
            let old = function.grids.remove(at);
            values.iter_mut().zip(old.values()).for_each(|(new, old)| *new += old);
        }
        function.grids.push(Grid::new(vec![edges(2), edges(1), edges(0)], values)?);
        let variances: f64 = self.variances().sum();
        function.std = Some((variances / self.state().len() as f64).sqrt());
        Ok(function)
    }

    /// Variances of the state.
    pub fn variances(&self) -> impl ExactSizeIterator<Item = f64> + '_ {
        let n = self.x.len();
        (0..self.nodes * self.components).map(move |i| self.p[i * n + i])
    }

    fn bounded(&self, i: usize) -> f64 {
        let limit = self.rules.limit;
        self.prior[i] + (self.x[i] - self.prior[i]).clamp(-limit, limit)
    }

    /// `h x`.
    fn expected(&self, o: &Observation) -> f64 {
        self.row(o).map(|(i, h)| h * self.x[i]).sum()
    }

    /// `P h^T` into its place; returns `h P h^T`.
    fn project(&mut self, o: &Observation) -> f64 {
        let n = self.x.len();
        self.ph.fill(0.0);
        for (j, h) in Self::row_of(o, self.nodes, self.components) {
            let line = &self.p[j * n..(j + 1) * n];
            self.ph.iter_mut().zip(line).for_each(|(sum, p)| *sum += h * p);
        }
        self.row(o).map(|(i, h)| h * self.ph[i]).sum()
    }

    /// The entries of `h` that are not zero.
    fn row<'a>(&self, o: &'a Observation) -> impl Iterator<Item = (usize, f64)> + use<'a> {
        Self::row_of(o, self.nodes, self.components)
    }

    fn row_of(o: &Observation, nodes: usize, components: usize) -> impl Iterator<Item = (usize, f64)> + '_ {
        (0..components)
            .flat_map(move |c| {
                let weight = o.weights[c];
                o.place
                    .nodes
                    .iter()
                    .zip(&o.place.shape)
                    .filter(move |_| weight != 0.0)
                    .map(move |(node, shape)| (c * nodes + node, weight * shape))
            })
            .chain(o.nuisance.map(|(i, weight)| (nodes * components + i, weight)))
    }

    /// `P <- (I - K h) P (I - K h)^T + K R K^T` with the gain at hand and `P h^T` of before.
    fn joseph(&mut self, o: &Observation, r: f64) {
        let n = self.x.len();
        // M = (I - K h) P, whose rows lose K_i (P h^T)^T
        for (i, line) in self.p.chunks_exact_mut(n).enumerate() {
            let k = self.k[i];
            line.iter_mut().zip(&self.ph).for_each(|(p, ph)| *p -= k * ph);
        }
        // then M - (M h^T) K^T + K R K^T
        for (work, line) in self.work.iter_mut().zip(self.p.chunks_exact(n)) {
            *work = Self::row_of(o, self.nodes, self.components).map(|(j, h)| h * line[j]).sum();
        }
        for (i, line) in self.p.chunks_exact_mut(n).enumerate() {
            let factor = self.k[i] * r - self.work[i];
            line.iter_mut().zip(&self.k).for_each(|(p, k)| *p += factor * k);
        }
        for i in 0..n {
            for j in 0..i {
                let mean = 0.5 * (self.p[i * n + j] + self.p[j * n + i]);
                self.p[i * n + j] = mean;
                self.p[j * n + i] = mean;
            }
        }
    }

    /// Scales rows and columns so that no variance exceeds the prior's; the matrix stays positive.
    fn cap(&mut self) {
        if !self.rules.cap_at_prior {
            return;
        }
        let n = self.x.len();
        let mut any = false;
        for i in 0..n {
            let (now, prior) = (self.p[i * n + i], self.prior_covariance[i * n + i]);
            let over = now > prior;
            self.work[i] = if over { (prior / now).sqrt() } else { 1.0 };
            any |= over;
        }
        if any {
            self.scale_by_work();
            for i in (0..n).filter(|i| self.work[*i] < 1.0) {
                self.p[i * n + i] = self.prior_covariance[i * n + i];
            }
        }
    }

    /// `P <- W P W` with `W` the diagonal that stands in the column of work.
    fn scale_by_work(&mut self) {
        let n = self.x.len();
        for (line, own) in self.p.chunks_exact_mut(n).zip(&self.work) {
            line.iter_mut().zip(&self.work).for_each(|(p, other)| *p *= own * other);
        }
    }
}

#[cfg(test)]
mod tests;
