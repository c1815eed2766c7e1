//! What few runs do to the figures of a positioning test: bias and 95 % interval.
//!
//! Figures of ISO 230-2 are largest values and ranges of noisy means and standard deviations: with few runs they lie above the
//! values of endlessly many runs, the more so the more targets compete for the largest value. The interval is therefore not
//! symmetric about the figure.
//!
//! Upper end: the target that truly decides reads at most the largest value, so that the figure plus twice the standard
//! uncertainty at the deciding targets (first order) holds. Lower end: simulated tests of the least favourable curve that the readings
//! leave possible, the one on which all targets share the largest value that
//! are nearer to it than the noise of a difference times `sqrt(2 ln k)` (the largest of k noises); `figure - d(97.5 %)`
//! with `d` the simulated figure minus the figure of that curve. Standard deviations are shrunk towards their mean square by what
//! their own scatter explains. The seed is fixed: same readings, same numbers.
//!
//! Source: Andrews and Guggenberger 2009 (least favourable cases of maxima); Efron and Tibshirani 1993, 6.5 (parametric simulation).

use volcomp_model::random::SplitMix64;

use super::positioning::{AtTarget, Bidirectional, Spread, Unidirectional, bidirectional, unidirectional};
use super::uncertainty::of_mean;

/// Simulated tests at most, and at least where targets are many.
const TESTS: [usize; 2] = [1000, 300];
/// Simulated cells (target and direction) in all.
const CELLS: usize = 400_000;
const SEED: u64 = 2302;
/// Share of the simulated figures below the one that gives the lower end.
const LOWER: f64 = 0.975;
const COVERAGE: f64 = 2.0;
/// Degrees of freedom above which a chi-square is drawn by its cube root.
const FEW: usize = 8;

/// Bias and half width of the 95 % interval of a figure.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct FewRuns {
    /// Figure minus the middle of the interval.
    pub(super) bias: f64,
    /// Half of the interval.
    pub(super) half: f64,
}

/// Variances of the figures: of both directions B R E M A, of one E A R.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Variances {
    pub(super) both: Option<[f64; 5]>,
    pub(super) forward: Option<[f64; 3]>,
    pub(super) backward: Option<[f64; 3]>,
}

/// The same of the intervals.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Intervals {
    pub(super) both: Option<[FewRuns; 5]>,
    pub(super) forward: Option<[FewRuns; 3]>,
    pub(super) backward: Option<[FewRuns; 3]>,
}

/// Random figures of readings.
struct Random(SplitMix64);

impl Random {
    /// Root of chi-square over its degrees of freedom.
    fn relative_s(&mut self, dof: usize) -> f64 {
        let k = dof as f64;
        if dof <= FEW {
            return ((0..dof).map(|_| self.0.normal().powi(2)).sum::<f64>() / k).sqrt();
        }
        // Wilson and Hilferty
        (1.0 - 2.0 / (9.0 * k) + (2.0 / (9.0 * k)).sqrt() * self.0.normal()).max(0.0).powf(1.5)
    }

    fn noise(&mut self, of: Option<&Spread>) -> Noise {
        of.map_or((0.0, 1.0), |p| (of_mean(p).sqrt() * self.0.normal(), self.relative_s(p.n.max(2) - 1)))
    }
}

const fn of_both(b: &Bidirectional) -> [f64; 5] {
    [b.b, b.r, b.e, b.m, b.a]
}

const fn of_one(u: &Unidirectional) -> [f64; 3] {
    [u.e, u.a, u.r]
}

/// Bias and interval of every figure of a test; `first_order` gives the variances of the figures at the deciding targets.
pub(super) fn intervals(targets: &[AtTarget], first_order: impl Fn(&[AtTarget]) -> Variances) -> Intervals {
    let spreads = targets.iter().flat_map(AtTarget::spreads).collect::<Vec<_>>();
    let mut scatter = shrunk_scatter(&spreads).into_iter();
    let mut shrink = |p: Option<Spread>| p.map(|p| Spread { s: scatter.next().unwrap_or(p.s), ..p });
    let shrunk: Vec<AtTarget> = targets
        .iter()
        .map(|t| AtTarget { forward: shrink(t.forward), backward: shrink(t.backward), ..*t })
        .collect();
    let variances = first_order(&shrunk);
    let is_both = targets.iter().all(|t| t.forward.is_some() && t.backward.is_some());
    let by_reversal = if is_both { level_reversals(&shrunk) } else { Vec::new() };
    let by_mean = if is_both { level_means(&shrunk) } else { Vec::new() };
    let by_direction = level_all(&shrunk);
    let tests = (CELLS / spreads.len().max(1)).clamp(TESTS[1], TESTS[0]);
    let mut random = Random(SplitMix64(SEED));
    let mut simulated = Simulated::default();
    for _ in 0..tests {
        let noise: Vec<[Noise; 2]> =
            shrunk.iter().map(|t| [t.forward, t.backward].map(|p| random.noise(p.as_ref()))).collect();
        if is_both {
            let [of_reversal, of_mean, of_all] = [&by_reversal, &by_mean, &by_direction]
                .map(|truth| bidirectional(&noisy(truth, &noise, 0), &noisy(truth, &noise, 1)));
            simulated.both.push([of_reversal.b, of_reversal.r, of_all.e, of_mean.m, of_all.a]);
        }
        for side in 0..2 {
            let spreads = noisy(&by_direction, &noise, side);
            if !spreads.is_empty() {
                simulated.one[side].push(of_one(&unidirectional(&spreads)));
            }
        }
    }
    let one = |side: usize, variances: [f64; 3]| {
        let [measured, truth] =
            [targets, &by_direction[..]].map(|of| of_one(&unidirectional(&of_side(of, side))));
        interval(measured, truth, variances, &simulated.one[side])
    };
    let both = |targets: &[AtTarget]| bidirectional(&of_side(targets, 0), &of_side(targets, 1));
    Intervals {
        both: variances.both.filter(|_| is_both).map(|v| {
            let [r, m, d] = [&by_reversal, &by_mean, &by_direction].map(|t| both(t));
            interval(of_both(&both(targets)), [r.b, r.r, d.e, m.m, d.a], v, &simulated.both)
        }),
        forward: variances.forward.map(|v| one(0, v)),
        backward: variances.backward.map(|v| one(1, v)),
    }
}

/// Figures of the simulated tests.
#[derive(Default)]
struct Simulated {
    both: Vec<[f64; 5]>,
    one: [Vec<[f64; 3]>; 2],
}

/// Noise of a mean, and the factor of a standard deviation.
type Noise = (f64, f64);

fn side(t: &AtTarget, side: usize) -> Option<Spread> {
    if side == 0 { t.forward } else { t.backward }
}

fn of_side(targets: &[AtTarget], which: usize) -> Vec<Spread> {
    targets.iter().filter_map(|t| side(t, which)).collect()
}

fn noisy(truth: &[AtTarget], noise: &[[Noise; 2]], which: usize) -> Vec<Spread> {
    let cells = truth.iter().zip(noise).filter_map(|(t, n)| Some((side(t, which)?, n[which])));
    cells.map(|(p, (mean, s))| Spread { mean: p.mean + mean, s: p.s * s, ..p }).collect()
}

fn interval<const N: usize>(
    measured: [f64; N],
    truth: [f64; N],
    variances: [f64; N],
    simulated: &[[f64; N]],
) -> [FewRuns; N] {
    core::array::from_fn(|k| {
        let mut off: Vec<f64> = simulated.iter().map(|s| s[k] - truth[k]).collect();
        off.sort_by(f64::total_cmp);
        let above = off[((off.len() - 1) as f64 * LOWER).round() as usize].max(0.0);
        let low = (measured[k] - above).max(0.0);
        let high = measured[k] + COVERAGE * variances[k].max(0.0).sqrt();
        FewRuns { bias: measured[k] - f64::midpoint(low, high), half: 0.5 * (high - low) }
    })
}

/// Values that compete for the largest get their mean.
fn level(values: &mut [(f64, f64)]) {
    let Some(&(top, variance)) = values.iter().max_by(|a, b| a.0.total_cmp(&b.0)) else { return };
    // the largest of so many noises is about this many standard deviations
    let limit = (2.0 * (values.len() as f64).ln()).sqrt();
    let competes = |v: &(f64, f64)| top - v.0 <= limit * (variance + v.1).sqrt();
    let (sum, count) = values.iter().filter(|v| competes(v)).fold((0.0, 0.0), |(s, n), v| (s + v.0, n + 1.0));
    let mean = sum / count;
    values.iter_mut().filter(|v| competes(v)).for_each(|v| v.0 = mean);
}

/// The same at both ends.
fn level_ends(values: &mut [(f64, f64)]) {
    // where all compete for both ends the range is nil
    level(values);
    values.iter_mut().for_each(|v| v.0 = -v.0);
    level(values);
    values.iter_mut().for_each(|v| v.0 = -v.0);
}

fn level_reversals(targets: &[AtTarget]) -> Vec<AtTarget> {
    let variance = |t: &AtTarget| t.spreads().map(|p| of_mean(&p)).sum::<f64>();
    let reversal = |t: &AtTarget| t.reversal().unwrap_or(0.0);
    let mut sizes: Vec<(f64, f64)> = targets.iter().map(|t| (reversal(t).abs(), variance(t))).collect();
    level(&mut sizes);
    let changed = |(t, (size, _)): (&AtTarget, &(f64, f64))| {
        let half = 0.5 * (size.copysign(reversal(t)) - reversal(t));
        moved(t, [half, -half])
    };
    targets.iter().zip(&sizes).map(changed).collect()
}

fn level_means(targets: &[AtTarget]) -> Vec<AtTarget> {
    let variance = |t: &AtTarget| 0.25 * t.spreads().map(|p| of_mean(&p)).sum::<f64>();
    let mean = |t: &AtTarget| t.mean().unwrap_or(0.0);
    let mut means: Vec<(f64, f64)> = targets.iter().map(|t| (mean(t), variance(t))).collect();
    level_ends(&mut means);
    targets.iter().zip(&means).map(|(t, (m, _))| moved(t, [m - mean(t); 2])).collect()
}

/// Means of each direction, all together.
fn level_all(targets: &[AtTarget]) -> Vec<AtTarget> {
    let mut means: Vec<(f64, f64)> =
        targets.iter().flat_map(AtTarget::spreads).map(|p| (p.mean, of_mean(&p))).collect();
    level_ends(&mut means);
    let mut means = means.into_iter().map(|m| m.0);
    let mut change = |p: Option<Spread>| p.map(|p| Spread { mean: means.next().unwrap_or(p.mean), ..p });
    targets
        .iter()
        .map(|t| AtTarget { forward: change(t.forward), backward: change(t.backward), ..*t })
        .collect()
}

fn moved(t: &AtTarget, by: [f64; 2]) -> AtTarget {
    let shift = |p: Option<Spread>, by: f64| p.map(|p| Spread { mean: p.mean + by, ..p });
    AtTarget { forward: shift(t.forward, by[0]), backward: shift(t.backward, by[1]), ..*t }
}

/// Standard deviations shrunk towards their mean square by the scatter that so few runs give them.
fn shrunk_scatter(spreads: &[Spread]) -> Vec<f64> {
    let count = spreads.len() as f64;
    let pooled = spreads.iter().map(|p| p.s * p.s).sum::<f64>() / count;
    if pooled <= 0.0 || spreads.len() < 3 {
        return spreads.iter().map(|p| p.s).collect();
    }
    let by_chance = spreads.iter().map(|p| 2.0 / (p.n.max(2) - 1) as f64).sum::<f64>() / count;
    let seen = spreads.iter().map(|p| (p.s * p.s / pooled - 1.0).powi(2)).sum::<f64>() / (count - 1.0);
    let own = ((seen - by_chance) / (1.0 + by_chance)).max(0.0);
    let share = own / (own + by_chance);
    spreads.iter().map(|p| (pooled + share * (p.s * p.s - pooled)).max(0.0).sqrt()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::uncertainty::variances;
    use crate::{Positioning, PositioningReading};
    use core::f64::consts::TAU;
    use volcomp_units::axes::Travel;

    const TARGETS: usize = 11;
    const SEEDS: u64 = 150;

    type Shape = fn(f64) -> [f64; 2];

    /// Shapes of both directions, um, over the share of the travel.
    const SHAPES: [(&str, Shape); 6] = [
        ("flat", |_| [0.0, 0.0]),
        ("line and constant reversal", |u| [6.0 * u + 1.0, 6.0 * u - 1.0]),
        ("wave and growing reversal", |u| [4.0 * (TAU * u).sin() + u, 4.0 * (TAU * u).sin() - u]),
        ("plateau", |u| [5.0 * (8.0 * (u - 0.5)).tanh() + 0.5, 5.0 * (8.0 * (u - 0.5)).tanh() - 0.5]),
        ("one high target", |u| [if (u - 0.3).abs() < 0.01 { 5.0 } else { 0.0 }, -0.3]),
        ("bow", |u| [5.0 * (1.0 - (2.0 * u - 1.0).powi(2)) + 1.5, 5.0 * (1.0 - (2.0 * u - 1.0).powi(2))]),
    ];

    fn truth(shape: Shape, sigma: f64) -> [f64; 5] {
        let of = |side: usize| -> Vec<Spread> {
            (0..TARGETS)
                .map(|i| Spread { mean: shape(i as f64 / (TARGETS - 1) as f64)[side], s: sigma, n: 5 })
                .collect()
        };
        of_both(&bidirectional(&of(0), &of(1)))
    }

    /// Share of tests whose interval holds the true figure: B R E M A.
    fn coverage(shape: Shape, sigma: f64, cycles: usize, seeds: u64) -> [f64; 5] {
        let truth = truth(shape, sigma);
        let mut held = [0.0; 5];
        for seed in 0..seeds {
            let mut random = SplitMix64(seed.wrapping_mul(104_729) + 7);
            let mut readings = Vec::new();
            for _ in 0..cycles {
                for i in 0..TARGETS {
                    let u = i as f64 / (TARGETS - 1) as f64;
                    for (travel, value) in [Travel::Forward, Travel::Reverse].into_iter().zip(shape(u)) {
                        let deviation = value + sigma * random.normal();
                        readings.push(PositioningReading { travel, target: 500.0 * u, deviation });
                    }
                }
            }
            let p = Positioning::evaluate(&readings).unwrap();
            let figures = of_both(&p.both.unwrap());
            for (k, few) in intervals(&p.targets, variances).both.unwrap().iter().enumerate() {
                let inside = (figures[k] - few.bias - truth[k]).abs() <= few.half + 1e-9;
                held[k] += f64::from(u8::from(inside)) / seeds as f64;
            }
        }
        held
    }

    #[test]
    fn the_interval_holds_the_figure_of_endlessly_many_runs() {
        let mut wrong = Vec::new();
        for (name, shape) in SHAPES {
            for sigma in [0.2, 3.0] {
                let held = coverage(shape, sigma, 5, SEEDS);
                eprintln!("{name}, sigma {sigma}: B R E M A {held:.3?}");
                for (figure, share) in ["B", "R", "E", "M", "A"].iter().zip(held) {
                    // 95 % less three standard deviations of a share of so many; many competing targets widen the interval
                    if share < 0.95 - 3.0 * (0.95 * 0.05 / SEEDS as f64).sqrt() {
                        wrong.push(format!("{name}, sigma {sigma}: {figure} {share:.3}"));
                    }
                }
            }
        }
        assert!(wrong.is_empty(), "{wrong:#?}");
    }
}
