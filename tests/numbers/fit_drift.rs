//! Drift over the cycles of a test and the standard uncertainty of a curve, against simulated tests whose truth is known.
//!
//! `cargo test --release --test numbers fit_drift -- --nocapture` prints the shares.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
#![expect(clippy::print_stderr, reason = "the shares are the result")]

use core::f64::consts::TAU;

use volcomp::identify::Reading;
use volcomp::identify::curve::{Basis, Course, CurveFit, Drift, Request, fit};
use volcomp::model::axes::Travel;
use volcomp::model::random::SplitMix64 as Random;

const SEEDS: u64 = 200;
const TARGETS: u32 = 11;
const CYCLES: u32 = 5;
/// Standard deviation of a reading, mm.
const SIGMA: f64 = 0.5e-3;

fn truth(x: f64, travel: Travel) -> f64 {
    let half = if travel == Travel::Forward { 1.0 } else { -1.0 } * (0.8e-3 + 1e-6 * x);
    6e-3 * (x / 500.0) + 1.5e-3 * (TAU * x / 400.0).sin() + half
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Kind {
    None,
    Offsets,
    Linear,
    LinearAndOffsets,
    WarmUp,
    Walk,
    Steps,
}

/// Drift at every reading of a test in order of time, without its mean.
fn drift(kind: Kind, random: &mut Random) -> Vec<f64> {
    let per_cycle = 2 * TARGETS;
    let count = per_cycle * CYCLES;
    let mut offset = 0.0;
    let mut walk = 0.0;
    let mut values = Vec::new();
    let slope = 1.2e-3 * (0.7 + 0.6 * random.even());
    for k in 0..count {
        let t = f64::from(k) / f64::from(per_cycle);
        if k % per_cycle == 0 {
            offset = match kind {
                Kind::Offsets | Kind::LinearAndOffsets => 0.4e-3 * random.normal(),
                Kind::Steps => offset + 1.5e-3 * random.normal(),
                _ => 0.0,
            };
        }
        walk += 1.2e-3 / f64::from(per_cycle).sqrt() * random.normal();
        values.push(match kind {
            Kind::None => 0.0,
            Kind::Offsets | Kind::Steps => offset,
            Kind::Linear => slope * t,
            Kind::LinearAndOffsets => slope * t + offset,
            Kind::WarmUp => 4.0 * slope * (1.0 - (-t / 2.0).exp()),
            Kind::Walk => walk,
        });
    }
    let mean = values.iter().sum::<f64>() / f64::from(count);
    values.iter().map(|v| v - mean).collect()
}

fn test(kind: Kind, seed: u64) -> Vec<Reading> {
    let mut random = Random(seed.wrapping_mul(7919) + 11);
    let drift = drift(kind, &mut random);
    let mut all = Vec::new();
    for (k, drift) in drift.into_iter().enumerate() {
        let (cycle, place) = (k as u32 / (2 * TARGETS) + 1, k as u32 % (2 * TARGETS));
        let (travel, target) = if place < TARGETS {
            (Travel::Forward, place)
        } else {
            (Travel::Reverse, 2 * TARGETS - 1 - place)
        };
        let position = 50.0 * f64::from(target);
        let value = truth(position, travel) + drift + SIGMA * random.normal();
        all.push(Reading { cycle, travel, position, value });
    }
    all
}

fn true_mean_reversal() -> f64 {
    2.0 * (0.8e-3 + 1e-6 * 250.0)
}

/// Over the seeds of a course of drift.
struct Shares {
    /// Tests from which a drift inside the cycles was subtracted.
    subtracted: f64,
    /// Mean reversal errors within two standard uncertainties.
    reversal: f64,
    /// Places at which the band holds the curve.
    curve: f64,
    /// Mean deviation of the mean reversal error, um.
    bias_um: f64,
}

fn shares(kind: Kind, mode: Drift) -> Shares {
    let (mut subtracted, mut reversal, mut curve, mut bias, mut places) = (0.0, 0.0, 0.0, 0.0, 0.0);
    let mut squares = 0.0;
    for seed in 0..SEEDS {
        let found: CurveFit = fit(&test(kind, seed), &Request { drift: mode, ..Request::default() }).unwrap();
        let is_subtracted = found.drift.is_some_and(|d| d.subtracted && d.course != Course::Steps);
        subtracted += f64::from(u8::from(is_subtracted));
        let mean = found.mean_reversal.unwrap();
        let error = mean.value - true_mean_reversal();
        bias += error;
        squares += error * error;
        reversal += f64::from(u8::from(error.abs() <= 2.0 * mean.std.unwrap()));
        let band = found.band.as_ref().unwrap();
        for k in 0..=20 {
            let x = 25.0 * f64::from(k);
            for travel in [Travel::Forward, Travel::Reverse] {
                let off = (found.value(x, travel) - truth(x, travel)).abs();
                curve += f64::from(u8::from(off <= band.factor_95() * band.std_at(x, travel)));
                places += 1.0;
            }
        }
    }
    let n = SEEDS as f64;
    let all = Shares {
        subtracted: subtracted / n,
        reversal: reversal / n,
        curve: curve / places,
        bias_um: 1e3 * bias / n,
    };
    let Shares { subtracted, reversal, curve, bias_um } = all;
    eprintln!(
        "{kind:?} {mode:?}: subtracted {subtracted:.3}, mean reversal covered {reversal:.3}, curve covered {curve:.3}, reversal bias \
         {bias_um:.3} um, RMS {:.3} um",
        1e3 * (squares / n).sqrt()
    );
    all
}

#[test]
fn reversal_and_curve_are_covered_whatever_the_course_of_the_drift() {
    for kind in [
        Kind::None,
        Kind::Offsets,
        Kind::Linear,
        Kind::LinearAndOffsets,
        Kind::WarmUp,
        Kind::Walk,
        Kind::Steps,
    ] {
        let found = shares(kind, Drift::Auto);
        // order and reversal are chosen by the data, which the band does not count
        assert!(found.curve >= 0.89, "{kind:?}: curve {}", found.curve);
        assert!(found.reversal >= 0.89, "{kind:?}: reversal {}", found.reversal);
        assert!(found.bias_um.abs() < 0.12, "{kind:?}: bias {} um", found.bias_um);
        match kind {
            Kind::None => assert!(found.subtracted <= 0.03, "{}", found.subtracted),
            Kind::Offsets => assert!(found.subtracted <= 0.045, "{}", found.subtracted),
            Kind::Linear => assert!(found.subtracted >= 0.99, "{}", found.subtracted),
            _ => {}
        }
    }
    // what half a cycle of drift does to the reversal where it stays
    assert!(shares(Kind::Linear, Drift::Keep).bias_um < -0.5);
}

/// Share of places within twice the standard uncertainty that goes into the model, and that over the RMS error.
fn std_of_model(truth: fn(f64, f64) -> f64, cycles: u32, offsets: f64, basis: Option<Basis>) -> [f64; 2] {
    let (targets, seeds) = (if cycles == 1 { 41u32 } else { 21 }, 100u64);
    let (mut held, mut count, mut squares, mut stated) = (0.0, 0.0, 0.0, 0.0);
    for seed in 0..seeds {
        let mut random = Random(seed * 977 + 5);
        let phase = TAU * random.even();
        let mut all = Vec::new();
        for cycle in 1..=cycles {
            let offset = offsets * random.normal();
            for i in 0..targets {
                let position = 500.0 * f64::from(i) / f64::from(targets - 1);
                let value = truth(position, phase) + offset + SIGMA * random.normal();
                all.push(Reading { cycle, travel: Travel::Forward, position, value });
            }
        }
        let found = fit(&all, &Request { basis, ..Request::default() }).unwrap();
        let std = found.function().std.unwrap();
        stated += std / seeds as f64;
        for _ in 0..20 {
            let x = 500.0 * random.even();
            let error = (found.value(x, Travel::Forward) - truth(x, phase)).abs();
            held += f64::from(u8::from(error <= 2.0 * std));
            squares += error * error;
            count += 1.0;
        }
    }
    [held / count, stated / (squares / count).sqrt()]
}

#[test]
fn the_uncertainty_in_the_model_is_that_of_the_curve() {
    let bow = |x: f64, p: f64| 5e-3 * (x / 500.0) + 3e-3 * (x / 500.0 - 0.5).powi(2) * (1.0 + p);
    let wave = |x: f64, p: f64| 4e-3 * (x / 500.0) + 2e-3 * (TAU * x / 370.0 + p).sin();
    let kink = |x: f64, p: f64| 4e-3 * (x / 500.0 - 0.3 - 0.3 * p / TAU).abs();
    for (name, truth) in [("bow", bow as fn(f64, f64) -> f64), ("wave", wave), ("kink", kink)] {
        for (cycles, offsets) in [(1, 0.0), (5, 0.0), (5, 0.5e-3)] {
            for basis in [None, Some(Basis::Chebyshev), Some(Basis::Table)] {
                if basis == Some(Basis::Table) && cycles == 1 {
                    continue;
                }
                let [share, ratio] = std_of_model(truth, cycles, offsets, basis);
                eprintln!(
                    "{name}, {cycles} cycles, offsets {offsets}, {basis:?}: {share:.3} within 2 u, u over RMS error {ratio:.2}"
                );
                assert!((0.88..=0.99).contains(&share), "{name} {cycles} {offsets} {basis:?}: {share}");
                assert!((0.8..=1.6).contains(&ratio), "{name} {cycles} {offsets} {basis:?}: {ratio}");
            }
        }
    }
}
