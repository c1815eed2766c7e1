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
//! Source: equations 5.8; James and Stein 1961 for the weight.

use super::filter::{COMPONENTS_MAX, FilterError, NodeFilter, Observation, Process, Rules, Update, Verdict};
use super::grid::{NodeGrid, NodePlace};
use super::noise::MeasurementNoise;

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
}

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

/// The map.
#[derive(Debug, Clone, PartialEq)]
pub struct LiveMap {
    rules: MapRules,
    filter: NodeFilter,
    evidence: f64,
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
        let process = match rules.tau_s {
            Some(tau_s) => {
                positive("time constant of the map", tau_s)?;
                Process::MeanReverting { tau_s }
            }
            None => Process::CorrelatedWalk { variance_per_s: rates },
        };
        let prior = vec![0.0; nodes * components];
        let gates = Rules { gate: f64::INFINITY, cap_at_prior: true, ..Rules::default() };
        let sigma = vec![1.0; components];
        let filter = NodeFilter::new(&rules.grid, &prior, &sigma, rules.correlation_mm, process, gates)?;
        Ok(Self { rules, filter, evidence: 0.0 })
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

    /// Lets time pass.
    pub fn predict(&mut self, seconds: f64) {
        self.filter.predict(seconds);
    }

    /// Compares a batch with the map; nothing is changed.
    pub fn judge(
        &mut self,
        sensor: usize,
        place: &NodePlace,
        rows: &[Row],
        noise: &MeasurementNoise,
    ) -> Batch {
        let mut batch = Batch::default();
        for row in rows {
            let (innovation, variance) = self.filter.compare(&self.observation(sensor, place, row), noise);
            batch.add(innovation, variance, noise.variance());
        }
        batch.finish()
    }

    /// What a batch differs by and how uncertain the map is there, row by row, in units of the stated noise.
    pub fn innovations(&mut self, sensor: usize, place: &NodePlace, rows: &[Row]) -> Vec<(f64, f64)> {
        let mut found = Vec::with_capacity(rows.len());
        for row in rows {
            let observation = self.observation(sensor, place, row);
            found.push(self.filter.expect(&observation));
        }
        found
    }

    /// True where a batch may be used.
    #[must_use]
    pub fn is_inside_gate(&self, batch: &Batch) -> bool {
        batch.rows > 0 && batch.worst <= self.rules.gate
    }

    /// Takes a batch that was judged fit; gives its consistency as the filter saw it, row after row.
    pub fn update(
        &mut self,
        sensor: usize,
        place: &NodePlace,
        rows: &[Row],
        noise: &mut MeasurementNoise,
    ) -> Batch {
        let mut batch = Batch::default();
        for row in rows {
            let before = noise.variance();
            let Update { verdict, innovation, innovation_variance, .. } =
                self.filter.update(&self.observation(sensor, place, row), noise);
            if verdict == Verdict::Accepted {
                batch.add(innovation, innovation_variance, before);
            }
        }
        if let Some(seen) = self.filter.evidence_at(place) {
            self.evidence += EVIDENCE_SHARE * (seen - self.evidence);
        }
        batch.finish()
    }

    /// The weight with which the map is used, 0 to 1.
    #[must_use]
    pub fn weight(&self) -> f64 {
        1.0 - EVIDENCE_OF_NOISE / self.evidence.max(EVIDENCE_OF_NOISE)
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

    /// How much more than noise the map is.
    #[must_use]
    pub const fn evidence(&self) -> f64 {
        self.evidence
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
        self.evidence = evidence;
        true
    }

    /// Back to the offline map.
    pub fn forget(&mut self) {
        self.filter.forget();
        self.evidence = 0.0;
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

impl Batch {
    fn add(&mut self, innovation: f64, variance: f64, noise: f64) {
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

    fn finish(mut self) -> Self {
        if self.rows > 0 {
            self.innovation = (self.innovation / f64::from(self.rows)).sqrt();
            self.expected = (self.expected / f64::from(self.rows)).sqrt();
        }
        self
    }
}

fn positive(what: &'static str, value: f64) -> Result<(), MapError> {
    if value.is_finite() && value > 0.0 { Ok(()) } else { Err(MapError::NotPositive { what, value }) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::core::estimate::Adaptation;

    fn rules() -> MapRules {
        MapRules {
            grid: NodeGrid::new(vec![0.0, 500.0, 1000.0], vec![0.0, 400.0], vec![0.0, 300.0]).unwrap(),
            components: vec![
                ComponentRules { std: 0.02, variance_per_s: 1e-9, limit: 0.05 },
                ComponentRules { std: 2e-5, variance_per_s: 1e-15, limit: 4e-5 },
            ],
            correlation_mm: 400.0,
            tau_s: None,
            gate: 10.8,
        }
    }

    /// One row of the length, one of the length plus a lever times the angle; sensor of 1 um.
    fn rows(length: f64, angle: f64) -> [Row; 2] {
        let (lever, sigma) = (500.0, 1e-3);
        let row = |w: [f64; 2]| {
            let mut weights = [0.0; COMPONENTS_MAX];
            weights[..2].copy_from_slice(&w.map(|w| w / sigma));
            Row { weights, value: (w[0] * length + w[1] * angle) / sigma, delay: 0.0 }
        };
        [row([1.0, 0.0]), row([1.0, lever])]
    }

    fn unit_noise() -> MeasurementNoise {
        MeasurementNoise::new(1.0, Some(Adaptation { share: 0.005, low: 0.01, high: 100.0 })).unwrap()
    }

    /// The numbers of a tour through the volume.
    fn points() -> impl Iterator<Item = [f64; 3]> {
        (0..400).map(|i| {
            let f = |k: f64| (f64::from(i) * k).fract();
            [1000.0 * f(0.618), 400.0 * f(0.414), 300.0 * f(0.732)]
        })
    }

    #[test]
    fn what_is_there_is_learned_and_used_what_is_not_is_left_alone() {
        let mut map = LiveMap::new(rules()).unwrap();
        let mut noise = unit_noise();
        for (i, point) in points().enumerate() {
            map.predict(0.1);
            let place = map.place(point);
            // an alternating micrometre of noise, and nothing in the angle
            let wobble = if i % 2 == 0 { 1e-3 } else { -1e-3 };
            let mut rows = rows(0.015, 0.0);
            rows.iter_mut().for_each(|row| row.value += wobble / 1e-3);
            assert!(map.judge(0, &place, &rows, &noise).rows == 2);
            map.update(0, &place, &rows, &mut noise);
        }
        let place = map.place([500.0, 200.0, 150.0]);
        assert!((map.output(0, &place) - 0.015).abs() < 1e-3, "{}", map.output(0, &place));
        assert!(map.output(1, &place).abs() < 4e-7, "{}", map.output(1, &place));
        assert!(map.weight() > 0.95, "{:?}", map.evidence());
        let (_, std) = map.estimate(0, &place);
        assert!(std < 1e-3);
    }

    #[test]
    fn noise_about_a_map_that_is_right_is_not_used() {
        let mut map = LiveMap::new(rules()).unwrap();
        let mut noise = unit_noise();
        for (i, point) in points().enumerate() {
            let place = map.place(point);
            let mut rows = rows(0.0, 0.0);
            for (k, row) in rows.iter_mut().enumerate() {
                // without memory, of unit variance
                row.value =
                    3.46 * (((i * 2 + k) as f64 * 12.9898).sin() * 43_758.545_3).rem_euclid(1.0) - 1.73;
            }
            map.update(0, &place, &rows, &mut noise);
        }
        assert!(map.weight() < 0.2, "{}", map.evidence());
    }

    #[test]
    fn the_output_is_limited_and_an_outlier_is_told_from_a_reading() {
        let mut map = LiveMap::new(rules()).unwrap();
        let mut noise = MeasurementNoise::new(1.0, None).unwrap();
        for point in points() {
            let place = map.place(point);
            map.update(0, &place, &rows(0.08, 0.0), &mut noise);
        }
        let place = map.place([300.0, 100.0, 100.0]);
        assert!((map.estimate(0, &place).0 - 0.08).abs() < 1e-3);
        assert!(map.output(0, &place) <= 0.05 + 1e-15);
        let good = map.judge(0, &place, &rows(0.08, 0.0), &noise);
        assert!(map.is_inside_gate(&good));
        let bad = map.judge(0, &place, &rows(0.2, 0.0), &noise);
        assert!(!map.is_inside_gate(&bad) && bad.worst > 1000.0);
        let blind = [Row { weights: [0.0; COMPONENTS_MAX], value: 5.0, delay: 0.0 }];
        let blind = map.judge(0, &place, &blind, &noise);
        assert!(blind.rows == 0 && !map.is_inside_gate(&blind), "what sees nothing updates nothing");
    }

    #[test]
    fn what_was_kept_comes_back_and_nonsense_is_refused() {
        let mut map = LiveMap::new(rules()).unwrap();
        let mut noise = unit_noise();
        points().for_each(|point| {
            let place = map.place(point);
            map.update(0, &place, &rows(0.01, 1e-5), &mut noise);
        });
        let kept: Vec<_> = map.nodes().collect();
        let evidence = map.evidence();
        let mut other = LiveMap::new(rules()).unwrap();
        assert!(other.restore(&kept, evidence));
        for (a, b) in other.outputs().zip(map.outputs()) {
            assert!((a - b).abs() < 1e-12, "{a} {b}");
        }
        let mut bad = kept.clone();
        bad[1].0 = 0.6;
        assert!(!other.restore(&bad, evidence), "far beyond the limit");
        bad[1] = (0.0, -1.0);
        assert!(!other.restore(&bad, evidence));
        assert!(!other.restore(&kept[1..], evidence) && !other.restore(&kept, f64::NAN));
        other.forget();
        assert!(other.outputs().all(|v| v == 0.0));
    }

    #[test]
    fn impossible_maps_are_refused() {
        let mut large = rules();
        large.grid =
            NodeGrid::new((0..30).map(f64::from).collect(), (0..30).map(f64::from).collect(), vec![0.0, 1.0])
                .unwrap();
        let error = LiveMap::new(large).unwrap_err().to_string();
        assert!(error.contains("1800 nodes") && error.contains("fewer"), "{error}");
        let mut wrong = rules();
        wrong.components[1].limit = 0.0;
        assert!(matches!(LiveMap::new(wrong), Err(MapError::NotPositive { what: "limit of the map", .. })));
        let mut wrong = rules();
        wrong.tau_s = Some(-1.0);
        assert!(LiveMap::new(wrong).is_err());
        let mut none = rules();
        none.components.clear();
        assert!(matches!(LiveMap::new(none), Err(MapError::Filter(_))));
    }
}
