//! Uncertainty of the figures of a positioning test, expanded with k = 2.
//!
//! Two parts are kept apart. *Measurement*: what instrument, alignment, temperature and drift can do to the figure, from
//! what the operator states. *Sampling*: what so few runs can do to it, from the readings: the variance of the means
//! is `s^2/n`, that of the standard deviations `s^2/(2(n-1))`, carried to the figure at the targets that decide it
//! (first order). The largest of many noisy values lies above the true one: bias and lower end follow from `few_runs`.
//!
//! Contributions that lie anywhere within limits are taken as rectangular. A distance over length L gets device,
//! misalignment (`R^2/(2L)` at most, always short), material temperature and expansion; it enters E, M and A.
//! Drift moves single readings: the difference of two means of n runs gets `sqrt(2/n)` of it, A and R `sqrt(2)`, M
//! `sqrt(2/2n)`. B compares two readings at one place, so that length errors drop out.
//!
//! Source: GUM (JCGM 100:2008) 4.3.7, 5.1, 6.2; kinds of contributions as in ISO/TR 230-9:2005.

use super::few_runs::{self, FewRuns, Variances};
use super::positioning::{AtTarget, Positioning, Spread};

/// What is known about the measurement; everything is optional. Positions mm, deviations um (rotary: only `device`
/// and `drift`, in the unit of the deviations).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Conditions {
    /// Expanded uncertainty (k = 2) of the instrument, independent of length.
    pub device: Option<f64>,
    /// The part that grows with length, per metre.
    pub device_per_m: Option<f64>,
    /// Largest lateral offset between beam and axis over the measured length, mm.
    pub misalignment_mm: Option<f64>,
    /// Expanded uncertainty (k = 2) of the material temperature, degC.
    pub temperature_degc: Option<f64>,
    /// Coefficient of thermal expansion of the machine's scale, um/(m degC).
    pub expansion_um_per_m_degc: Option<f64>,
    /// Its expanded uncertainty (k = 2), um/(m degC).
    pub expansion_uncertainty_um_per_m_degc: Option<f64>,
    /// Material temperature minus 20 degC.
    pub from_20_degc: Option<f64>,
    /// Range of the drift of a resting axis over the time of the test.
    pub drift: Option<f64>,
}

/// One contribution to a distance over the whole range or to a reading, standard uncertainty.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contribution {
    /// What it is.
    pub name: &'static str,
    /// Standard uncertainty (k = 1).
    pub std: f64,
}

/// Expanded uncertainty (k = 2) of one figure.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Expanded {
    /// From instrument and conditions.
    pub measurement: f64,
    /// From the number of runs: half of the interval that holds the figure of endlessly many runs with 95 %.
    pub sampling: f64,
    /// By how much the figure lies above the middle of that interval.
    pub bias: f64,
}

/// Expanded uncertainties (k = 2) of the figures of a test.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Uncertainties {
    /// What went in.
    pub contributions: Vec<Contribution>,
    /// Bidirectional B R E M A, where both directions were measured.
    pub both: Option<[Expanded; 5]>,
    /// Forward E A R.
    pub forward: Option<[Expanded; 3]>,
    /// Backward E A R.
    pub backward: Option<[Expanded; 3]>,
}

/// A rectangular distribution of this full width has this standard deviation: `1/(2 sqrt 3)`.
const RECTANGULAR: f64 = 0.288_675_134_594_812_9;
const COVERAGE: f64 = 2.0;

impl Conditions {
    /// Contributions to a distance over `length_mm`.
    #[must_use]
    pub fn of_length(&self, length_mm: f64) -> Vec<Contribution> {
        let metres = length_mm * 1e-3;
        let half = |v: Option<f64>| v.map(|v| v.abs() / COVERAGE);
        let misalignment = self.misalignment_mm.map(|r| 1e3 * r * r / (2.0 * length_mm) * RECTANGULAR);
        let temperature = half(self.temperature_degc)
            .zip(self.expansion_um_per_m_degc)
            .map(|(u, alpha)| alpha.abs() * metres * u);
        let expansion = half(self.expansion_uncertainty_um_per_m_degc)
            .zip(self.from_20_degc)
            .map(|(u, t)| u * metres * t.abs());
        [
            ("instrument", half(self.device)),
            ("instrument, with length", half(self.device_per_m).map(|u| u * metres)),
            ("misalignment", misalignment),
            ("material temperature", temperature),
            ("coefficient of expansion", expansion),
        ]
        .into_iter()
        .filter_map(|(name, std)| std.map(|std| Contribution { name, std }))
        .collect()
    }

    /// Standard uncertainty of a reading by drift.
    #[must_use]
    pub fn of_drift(&self) -> f64 {
        self.drift.map_or(0.0, |d| d.abs() * RECTANGULAR)
    }
}

/// Expanded uncertainties (k = 2) of a circular test, as far as they were stated.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CircularUncertainties {
    /// Of the circular errors G.
    pub g: Option<f64>,
    /// Of the radial errors F.
    pub f: Option<f64>,
}

impl CircularUncertainties {
    /// `device` is the expanded uncertainty (k = 2) of a change of the reading over the circle, `radius` that of the calibrated length,
    /// `drift` the range of the reading of a resting machine over the time of the test; one unit for all.
    ///
    /// `G` compares two readings, so that a constant length cancels; `F` is one reading against the nominal radius and is not
    /// stated without the uncertainty of the length.
    #[must_use]
    pub fn of(device: Option<f64>, radius: Option<f64>, drift: Option<f64>) -> Self {
        let reading = device.map(|u| (u / COVERAGE).powi(2) + (drift.unwrap_or(0.0) * RECTANGULAR).powi(2));
        let expanded = |variance: f64| COVERAGE * variance.sqrt();
        Self {
            g: reading.map(|v| expanded(2.0 * v)),
            f: reading.zip(radius).map(|(v, r)| expanded(v + (r / COVERAGE).powi(2))),
        }
    }
}

/// A figure of a test with its uncertainty.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OfFigure {
    /// Key, such as `a_fwd`.
    pub key: &'static str,
    /// Symbol and direction in words, such as `A, forward`.
    pub name: &'static str,
    /// The uncertainty, whether or not something was stated of the measurement.
    pub expanded: Expanded,
    /// That of the measurement. Reversal and repeatability compare readings at one place: only drift belongs to them, and
    /// without it theirs is not stated; nothing is where nothing went in.
    pub measurement: Option<f64>,
}

/// Keys and names of the figures, in the order of [`Uncertainties`].
const BOTH: [(&str, &str); 5] = [("b", "B"), ("r", "R"), ("e", "E"), ("m", "M"), ("a", "A")];
const FORWARD: [(&str, &str); 3] =
    [("e_fwd", "E, forward"), ("a_fwd", "A, forward"), ("r_fwd", "R, forward")];
const BACKWARD: [(&str, &str); 3] =
    [("e_bwd", "E, backward"), ("a_bwd", "A, backward"), ("r_bwd", "R, backward")];

impl Uncertainties {
    /// All figures with an uncertainty, those of both directions first.
    pub fn figures(&self) -> impl Iterator<Item = OfFigure> + '_ {
        let both = self.both.into_iter().flat_map(|of| BOTH.into_iter().zip(of));
        let sides = [(self.forward, FORWARD), (self.backward, BACKWARD)];
        let sides = sides
            .into_iter()
            .flat_map(|(of, names)| of.into_iter().flat_map(move |of| names.into_iter().zip(of)));
        let has_drift = self.contributions.iter().any(|c| c.name == "drift");
        both.chain(sides).map(move |((key, name), expanded)| {
            let is_stated =
                if key.starts_with(['b', 'r']) { has_drift } else { !self.contributions.is_empty() };
            OfFigure { key, name, expanded, measurement: is_stated.then_some(expanded.measurement) }
        })
    }

    /// The uncertainty of a figure by its key.
    #[must_use]
    pub fn figure(&self, key: &str) -> Option<OfFigure> {
        self.figures().find(|f| f.key == key)
    }

    /// Uncertainties of an evaluated test; `length_mm` is the range of its targets.
    #[must_use]
    pub fn of(test: &Positioning, conditions: &Conditions, length_mm: f64) -> Self {
        let mut contributions = conditions.of_length(length_mm);
        let length = contributions.iter().map(|c| c.std * c.std).sum::<f64>();
        let drift = conditions.of_drift();
        if conditions.drift.is_some() {
            contributions.push(Contribution { name: "drift", std: drift });
        }
        let n = test.cycles.max(1) as f64;
        // variances of the measurement: with length and share of the drift
        let measured = |with_length: bool, share: f64| {
            COVERAGE * (f64::from(u8::from(with_length)) * length + share * drift * drift).sqrt()
        };
        let few = few_runs::intervals(&test.targets, variances);
        let figure =
            |measurement: f64, few: FewRuns| Expanded { measurement, sampling: few.half, bias: few.bias };
        let both = few.both.map(|[b, r, e, m, a]| {
            [
                figure(measured(false, 2.0 / n), b),
                figure(measured(false, 2.0), r),
                figure(measured(true, 2.0 / n), e),
                figure(measured(true, 1.0 / n), m),
                figure(measured(true, 2.0), a),
            ]
        });
        let one = |few: [FewRuns; 3]| {
            let [e, a, r] = few;
            [
                figure(measured(true, 2.0 / n), e),
                figure(measured(true, 2.0), a),
                figure(measured(false, 2.0), r),
            ]
        };
        Self { contributions, both, forward: few.forward.map(one), backward: few.backward.map(one) }
    }
}

impl Expanded {
    /// Both parts together.
    #[must_use]
    pub fn total(&self) -> f64 {
        self.measurement.hypot(self.sampling)
    }

    /// The 95 % interval about a figure: `figure - bias`, plus and minus both parts; not below zero.
    #[must_use]
    pub fn interval(&self, figure: f64) -> [f64; 2] {
        let (middle, half) = (figure - self.bias, self.total());
        [(middle - half).max(0.0), middle + half]
    }
}

/// Variances of the figures at the targets that decide them, first order.
pub(super) fn variances(targets: &[AtTarget]) -> Variances {
    let all: Vec<Spread> = targets.iter().flat_map(AtTarget::spreads).collect();
    let one = |side: fn(&AtTarget) -> Option<Spread>| {
        let spreads: Vec<Spread> = targets.iter().filter_map(side).collect();
        (!spreads.is_empty()).then(|| {
            let widest = largest_by(&spreads, |p| p.s);
            [range_variance(&spreads), accuracy_variance(&spreads), 16.0 * of_s(&widest)]
        })
    };
    let (forward, backward) = (one(|t| t.forward), one(|t| t.backward));
    let both = forward.is_some() && backward.is_some();
    let both = both.then(|| {
        [
            reversal_variance(targets),
            repeatability_variance(targets),
            range_variance(&all),
            mean_variance(targets),
            accuracy_variance(&all),
        ]
    });
    Variances { both, forward, backward }
}

/// Variance of a mean.
pub(super) fn of_mean(p: &Spread) -> f64 {
    p.s * p.s / p.n as f64
}

/// Variance of a standard deviation.
fn of_s(p: &Spread) -> f64 {
    p.s * p.s / (2.0 * (p.n.max(2) - 1) as f64)
}

fn largest_by<T: Copy>(list: &[T], of: impl Fn(&T) -> f64) -> T {
    list.iter().copied().reduce(|a, b| if of(&b) > of(&a) { b } else { a }).unwrap_or(list[0])
}

fn range_variance(spreads: &[Spread]) -> f64 {
    of_mean(&largest_by(spreads, |p| p.mean)) + of_mean(&largest_by(spreads, |p| -p.mean))
}

fn accuracy_variance(spreads: &[Spread]) -> f64 {
    let ends = [largest_by(spreads, |p| p.mean + 2.0 * p.s), largest_by(spreads, |p| 2.0 * p.s - p.mean)];
    ends.iter().map(|p| of_mean(p) + 4.0 * of_s(p)).sum()
}

fn reversal_variance(targets: &[AtTarget]) -> f64 {
    let at = largest_by(targets, |t| t.reversal().map_or(0.0, f64::abs));
    at.spreads().map(|p| of_mean(&p)).sum()
}

fn mean_variance(targets: &[AtTarget]) -> f64 {
    let ends = [1.0, -1.0].map(|sign| largest_by(targets, |t| sign * t.mean().unwrap_or(0.0)));
    ends.iter().map(|t| t.spreads().map(|p| 0.25 * of_mean(&p)).sum::<f64>()).sum()
}

fn repeatability_variance(targets: &[AtTarget]) -> f64 {
    let at = largest_by(targets, |t| t.repeatability().unwrap_or(0.0));
    let (Some(f), Some(b), Some(r)) = (at.forward, at.backward, at.repeatability()) else { return 0.0 };
    let widest = if f.s > b.s { f } else { b };
    if r <= 4.0 * widest.s {
        16.0 * of_s(&widest)
    } else {
        [f, b].iter().map(|p| 4.0 * of_s(p) + of_mean(p)).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::PositioningReading;
    use volcomp_units::axes::Travel;

    /// Normal numbers from a fixed sequence (Box-Muller on an LCG), enough for a check of variances.
    struct Noise(u64);

    impl Noise {
        fn uniform(&mut self) -> f64 {
            self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            ((self.0 >> 11) as f64 + 0.5) / (1u64 << 53) as f64
        }

        fn normal(&mut self) -> f64 {
            (-2.0 * self.uniform().ln()).sqrt() * (core::f64::consts::TAU * self.uniform()).cos()
        }
    }

    fn test(noise: &mut Noise, sigma: f64) -> Positioning {
        let mut readings = Vec::new();
        for _ in 0..5 {
            for (travel, reversal) in [(Travel::Forward, 2.0), (Travel::Reverse, -2.0)] {
                for i in 0..11 {
                    let target = f64::from(i) * 50.0;
                    let deviation =
                        0.04 * target + reversal * (1.0 + 0.1 * f64::from(i)) + sigma * noise.normal();
                    readings.push(PositioningReading { travel, target, deviation });
                }
            }
        }
        Positioning::evaluate(&readings).unwrap()
    }

    #[test]
    fn the_scatter_of_repeated_tests_is_what_the_readings_of_one_predict() {
        let mut noise = Noise(7);
        let runs = 2000;
        let mut sums = [[0.0; 2]; 5];
        let mut predicted = [0.0; 5];
        for _ in 0..runs {
            let p = test(&mut noise, 0.1);
            let b = p.both.unwrap();
            for (k, v) in [b.b, b.r, b.e, b.m, b.a].into_iter().enumerate() {
                sums[k][0] += v;
                sums[k][1] += v * v;
            }
            for (f, variance) in predicted.iter_mut().zip(variances(&p.targets).both.unwrap()) {
                *f += variance / f64::from(runs);
            }
        }
        let n = f64::from(runs);
        for (k, name) in ["B", "R", "E", "M", "A"].iter().enumerate() {
            let std = ((sums[k][1] - sums[k][0] * sums[k][0] / n) / (n - 1.0)).sqrt();
            let ratio = predicted[k].sqrt() / std;
            // where the ends of a range are always at the same targets the first order holds well; B and R are the
            // largest of many and scatter less
            let limits = if matches!(*name, "B" | "R") { 0.95..2.2 } else { 0.9..1.15 };
            assert!(limits.contains(&ratio), "{name}: predicted/seen {ratio:.3}");
        }
    }

    #[test]
    fn a_circular_error_compares_two_readings_and_a_radial_error_needs_the_length() {
        let u = CircularUncertainties::of(Some(0.8), Some(1.0), Some(1.2));
        let reading: f64 = 0.16 + 1.44 / 12.0;
        assert!((u.g.unwrap() - 2.0 * (2.0 * reading).sqrt()).abs() < 1e-12);
        assert!((u.f.unwrap() - 2.0 * (reading + 0.25).sqrt()).abs() < 1e-12);
        assert_eq!(CircularUncertainties::of(Some(0.8), None, None).f, None);
        assert_eq!(CircularUncertainties::of(None, Some(1.0), Some(1.0)).g, None);
    }

    #[test]
    fn stated_contributions_follow_their_limits() {
        let c = Conditions {
            device: Some(0.6),
            device_per_m: Some(1.0),
            misalignment_mm: Some(1.0),
            temperature_degc: Some(0.5),
            expansion_um_per_m_degc: Some(12.0),
            expansion_uncertainty_um_per_m_degc: Some(2.0),
            from_20_degc: Some(-3.0),
            drift: Some(1.2),
        };
        let stds: Vec<f64> = c.of_length(500.0).iter().map(|c| c.std).collect();
        // the simplified budget of the standard: U = 0.3 R^2/L um for 1 mm over 500 mm is 0.6 um, here 0.577
        let expected = [0.3, 0.25, 0.288_675, 1.5, 1.5];
        for (got, want) in stds.iter().zip(expected) {
            assert!((got - want).abs() < 1e-5, "{stds:?}");
        }
        let mut noise = Noise(1);
        let p = test(&mut noise, 0.1);
        let u = Uncertainties::of(&p, &c, 500.0);
        let [b, r, e, m, a] = u.both.unwrap().map(|u| u.measurement);
        let length: f64 = stds.iter().map(|s| s * s).sum();
        let drift = (1.2f64 / 12f64.sqrt()).powi(2);
        let close = |got: f64, variance: f64| assert!((got - 2.0 * variance.sqrt()).abs() < 1e-12);
        close(b, 2.0 * drift / 5.0);
        close(r, 2.0 * drift);
        close(e, length + 2.0 * drift / 5.0);
        close(m, length + drift / 5.0);
        close(a, length + 2.0 * drift);
        assert_eq!(u.contributions.len(), 6);
    }
}
