//! Fits against a truth that is known: coverage of the confidence bands, the fourth paper's wave, outliers, reversal,
//! smoothing, whole turns. The truths are written here, with their own formulas.
//!
//! `cargo test --release --test numbers fit_truth -- --nocapture` prints the distributions.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
#![expect(clippy::print_stderr, reason = "the distributions are the result")]

use core::f64::consts::{PI, TAU};

use volcomp::identify::Reading;
use volcomp::identify::curve::{Basis, FitError, Note, Period, Request, Reversal, Smoothing, fit};
use volcomp::model::axes::Travel;
use volcomp::model::random::SplitMix64 as Random;

fn at(position: f64, value: f64, travel: Travel, cycle: u32) -> Reading {
    Reading { cycle, travel, position, value }
}

fn forward(x: &[f64], mut y: impl FnMut(f64) -> f64) -> Vec<Reading> {
    x.iter().map(|&x| at(x, y(x), Travel::Forward, 1)).collect()
}

fn every(n: usize, step: f64) -> Vec<f64> {
    (0..n).map(|i| i as f64 * step).collect()
}

fn request(basis: Basis, order: usize) -> Request {
    Request { basis: Some(basis), order: Some(order), ..Request::default() }
}

const SEEDS: u64 = 2000;

/// Share of seeds (and places) where the band holds the truth; the places of a seed are drawn, one per seed counts.
fn coverage(name: &str, mut one: impl FnMut(&mut Random) -> bool) {
    let held = (0..SEEDS).filter(|seed| one(&mut Random(seed.wrapping_mul(7919) + 11))).count();
    let share = held as f64 / SEEDS as f64;
    eprintln!("{name:<42} {:.2} % of {SEEDS} seeds", 100.0 * share);
    // 95 % +- 3 standard deviations of a binomial share
    assert!((share - 0.95).abs() < 3.0 * (0.95f64 * 0.05 / SEEDS as f64).sqrt(), "{name}: {share}");
}

#[test]
fn the_bands_hold_the_truth_at_95_percent() {
    let x = every(41, 10.0);
    let sigma = 0.5e-3;
    coverage("chebyshev of order 4", |random| {
        let c: Vec<f64> = (0..5).map(|_| 2e-3 * random.normal()).collect();
        let truth = |x: f64| {
            let angle = (x / 200.0 - 1.0).clamp(-1.0, 1.0).acos();
            c.iter().enumerate().map(|(k, c)| c * (k as f64 * angle).cos()).sum::<f64>()
        };
        let found =
            fit(&forward(&x, |x| truth(x) + sigma * random.normal()), &request(Basis::Chebyshev, 4)).unwrap();
        let (x, band) = (random.between(0.0, 400.0), found.band.as_ref().unwrap());
        (found.value(x, Travel::Forward) - truth(x)).abs()
            <= band.factor_95() * band.std_at(x, Travel::Forward)
    });
    coverage("half-range of order 3 with reversal", |random| {
        let c: Vec<f64> = (0..5).map(|_| 2e-3 * random.normal()).collect();
        // large enough that no one doubts that it is there
        let half = [random.between(1e-3, 2e-3), random.between(1e-3, 2e-3)];
        let truth = |x: f64, travel: Travel| {
            let u = x / 400.0;
            let sign = if travel == Travel::Forward { 1.0 } else { -1.0 };
            let waves: f64 = (1..=3).map(|k| c[k + 1] * (f64::from(k as u32) * PI * u).sin()).sum();
            c[0] + c[1] * (2.0 * u - 1.0) + waves + sign * (half[0] + half[1] * (2.0 * u - 1.0))
        };
        let mut all = Vec::new();
        for travel in [Travel::Forward, Travel::Reverse] {
            all.extend(x.iter().map(|&x| at(x, truth(x, travel) + sigma * random.normal(), travel, 1)));
        }
        let found = fit(&all, &request(Basis::HalfRange, 3)).unwrap();
        let travel = if random.even() < 0.5 { Travel::Forward } else { Travel::Reverse };
        let (x, band) = (random.between(0.0, 400.0), found.band.as_ref().unwrap());
        (found.value(x, travel) - truth(x, travel)).abs() <= band.factor_95() * band.std_at(x, travel)
    });
    coverage("fourier with a fitted period", |random| {
        let (period, phase) = (random.between(140.0, 220.0), random.between(0.0, TAU));
        let truth = |x: f64| 1e-3 + 4e-3 * (TAU * x / period + phase).sin();
        let wanted = Request {
            period: Period::Within([100.0, 300.0]),
            linear: Some(false),
            ..request(Basis::Fourier, 1)
        };
        let found = fit(&forward(&x, |x| truth(x) + sigma * random.normal()), &wanted).unwrap();
        let (x, band) = (random.between(0.0, 400.0), found.band.as_ref().unwrap());
        (found.value(x, Travel::Forward) - truth(x)).abs()
            <= band.factor_95() * band.std_at(x, Travel::Forward)
    });
    coverage("the fitted period itself", |random| {
        let (period, phase) = (random.between(140.0, 220.0), random.between(0.0, TAU));
        let wanted = Request {
            period: Period::Within([100.0, 300.0]),
            linear: Some(false),
            ..request(Basis::Fourier, 1)
        };
        let all = forward(&x, |x| 4e-3 * (TAU * x / period + phase).sin() + sigma * random.normal());
        let found = fit(&all, &wanted).unwrap();
        let band = found.band.as_ref().unwrap();
        let std = *band.parameter_std().last().unwrap();
        (found.period.unwrap() - period).abs() <= band.factor_95() * std
    });
    coverage("a table at its targets", |random| {
        let values: Vec<f64> = (0..11).map(|_| 5e-3 * random.normal()).collect();
        let mut all = Vec::new();
        for cycle in 1..=4 {
            for (i, value) in values.iter().enumerate() {
                all.push(at(i as f64 * 20.0, value + sigma * random.normal(), Travel::Forward, cycle));
            }
        }
        let found = fit(&all, &Request { basis: Some(Basis::Table), ..Request::default() }).unwrap();
        let i = (random.even() * 11.0) as usize;
        let (x, band) = (i as f64 * 20.0, found.band.as_ref().unwrap());
        (found.value(x, Travel::Forward) - values[i]).abs()
            <= band.factor_95() * band.std_at(x, Travel::Forward)
    });
}

/// The band of a smoothed table is one across the table: on average over the targets.
#[test]
fn the_band_of_a_smoothed_table_holds_on_average() {
    let sigma = 0.8e-3;
    let (mut held, mut all) = (0usize, 0usize);
    for seed in 0..200 {
        let mut random = Random(seed + 5);
        let phase = random.between(0.0, TAU);
        let truth = |x: f64| 3e-3 * (TAU * x / 350.0 + phase).sin() + 1e-5 * x;
        let readings = forward(&every(61, 10.0), |x| truth(x) + sigma * random.normal());
        let wanted = Request { basis: Some(Basis::Table), smoothing: Smoothing::Auto, ..Request::default() };
        let found = fit(&readings, &wanted).unwrap();
        let band = found.band.as_ref().unwrap();
        for r in &readings {
            let off = (found.value(r.position, r.travel) - truth(r.position)).abs();
            held += usize::from(off <= band.factor_95() * band.std_at(r.position, r.travel));
            all += 1;
        }
    }
    let share = held as f64 / all as f64;
    eprintln!("smoothed table, targets of 200 seeds          {:.2} %", 100.0 * share);
    assert!((0.90..0.985).contains(&share), "{share}");
}

fn quartiles(mut values: Vec<f64>) -> [f64; 3] {
    values.sort_by(f64::total_cmp);
    [1, 2, 3].map(|q| values[(values.len() - 1) * q / 4])
}

/// 41 points every 10 mm, a wave of so many periods over the travel with its overtones (um), noise of 0.93 um as in
/// table 4 of the paper. The largest residuals of three harmonics of a fitted period and of the polynomial of order 7:
/// eight numbers each.
fn wave_and_polynomial(waves: [f64; 2], amplitude: [f64; 3], seed: u64) -> [f64; 2] {
    let mut random = Random(seed.wrapping_mul(104_729) + 3);
    let period = 400.0 / random.between(waves[0], waves[1]);
    let phase = [random.between(0.0, TAU), random.between(0.0, TAU), random.between(0.0, TAU)];
    let readings = forward(&every(41, 10.0), |x| {
        let wave: f64 =
            (0..3).map(|n| amplitude[n] * ((n + 1) as f64 * TAU * x / period + phase[n]).sin()).sum();
        1e-3 * wave + 0.93e-3 * random.normal()
    });
    let wave = Request { linear: Some(false), ..request(Basis::Fourier, 3) };
    let (wave, polynomial) =
        (fit(&readings, &wave).unwrap(), fit(&readings, &request(Basis::Chebyshev, 7)).unwrap());
    assert_eq!((wave.figures.m, polynomial.figures.m), (8, 8));
    [wave.figures.e_max, polynomial.figures.e_max]
}

#[test]
fn the_fitted_wave_beats_the_polynomial_of_equal_size_by_15_percent() {
    // with overtones as a wave of a guideway has them, and the bare sine
    for (name, amplitude, needed) in [
        ("overtones", [3.1, 0.8, 0.4], [0.15, 0.15, 0.15]),
        ("bare sine", [3.3, 0.0, 0.0], [0.15, 0.10, 0.15]),
    ] {
        for (waves, needed) in [[2.0, 3.0], [2.0, 2.5], [2.5, 3.0]].into_iter().zip(needed) {
            let pairs: Vec<[f64; 2]> =
                (0..400).map(|seed| wave_and_polynomial(waves, amplitude, seed)).collect();
            let gains: Vec<f64> = pairs.iter().map(|[w, p]| 1.0 - w / p).collect();
            let better = gains.iter().filter(|g| **g >= 0.15).count() as f64 / gains.len() as f64;
            let [low, median, high] = quartiles(gains);
            let e_max = |i: usize| 1e3 * quartiles(pairs.iter().map(|p| p[i]).collect())[1];
            eprintln!(
                "{name}, {} to {} waves: largest residual {:.2} against {:.2} um, {:.0} % lower in the median (quartiles {:.0}, {:.0} %), 15 % or more in {:.0} % of 400 seeds",
                waves[0],
                waves[1],
                e_max(0),
                e_max(1),
                100.0 * median,
                100.0 * low,
                100.0 * high,
                100.0 * better
            );
            assert!(median >= needed, "{name} {waves:?}: {median}");
        }
    }
}

#[test]
fn several_periods_are_found_at_once() {
    let mut random = Random(5);
    let truth = |x: f64| {
        2e-3 * (TAU * x / 10.0 + 0.3).sin()
            + 3e-3 * (TAU * x / 87.0).cos()
            + 1e-3 * (TAU * x / 31.0 + 2.0).sin()
    };
    let readings = forward(&every(301, 1.3), |x| truth(x) + 0.2e-3 * random.normal());
    let wanted = Request {
        period: Period::Given(10.0),
        further_periods: vec![Period::Within([15.0, 200.0]), Period::Within([15.0, 200.0])],
        linear: Some(false),
        ..request(Basis::Fourier, 1)
    };
    let found = fit(&readings, &wanted).unwrap();
    assert_eq!(found.periods.len(), 3);
    for (got, want) in found.periods.iter().zip([10.0, 87.0, 31.0]) {
        assert!((got / want - 1.0).abs() < 2e-3, "{:?}", found.periods);
    }
    assert!(every(390, 1.0).iter().all(|x| (found.value(*x, Travel::Forward) - truth(*x)).abs() < 0.15e-3));
    // a sum of three curves in the model says the same
    let function = found.function();
    assert_eq!(function.curves.len(), 3);
    assert!((function.value(55.5, Travel::Forward) - found.value(55.5, Travel::Forward)).abs() < 1e-15);
}

#[test]
fn a_period_is_taken_only_where_aicc_falls_by_more_than_4() {
    // a parabola needs no wave
    let mut taken = 0;
    for seed in 0..60 {
        let mut random = Random(seed + 900);
        let readings = forward(&every(41, 10.0), |x| 1e-7 * (x - 150.0).powi(2) + 0.5e-3 * random.normal());
        taken += usize::from(fit(&readings, &Request::default()).unwrap().basis == Basis::Fourier);
    }
    assert!(taken <= 6, "{taken} of 60");
}

#[test]
fn outliers_are_named_and_do_not_move_the_curve() {
    for seed in 0..40 {
        let mut random = Random(seed + 300);
        let truth = |x: f64| 4e-3 * (x / 90.0).sin() + 1e-5 * x;
        let mut readings = forward(&every(60, 10.0), |x| truth(x) + 0.4e-3 * random.normal());
        let wrong = [0usize, 17, 18, 41];
        for i in wrong {
            readings[i].value += if i == 18 { -0.03 } else { 0.02 };
        }
        for basis in [None, Some(Basis::Chebyshev), Some(Basis::HalfRange)] {
            let found = fit(&readings, &Request { basis, robust: true, ..Request::default() }).unwrap();
            let named: Vec<usize> = found.outliers.iter().map(|o| o.index).collect();
            assert!(wrong.iter().all(|i| named.contains(i)), "seed {seed} {basis:?}: {named:?}");
            assert!(named.len() <= 6, "seed {seed} {basis:?}: {named:?}");
            let size = found.outliers.iter().find(|o| o.index == 18).unwrap().deviation;
            assert!((size + 0.03).abs() < 2e-3, "{size}");
            let worst = readings
                .iter()
                .map(|r| (found.value(r.position, r.travel) - truth(r.position)).abs())
                .fold(0.0, f64::max);
            assert!(worst < 1.6e-3, "seed {seed} {basis:?}: {worst}");
        }
    }
}

#[test]
fn honest_readings_are_rarely_called_outliers_and_a_mess_is_refused() {
    let mut named = 0;
    for seed in 0..200 {
        let mut random = Random(seed + 40);
        let readings = forward(&every(60, 10.0), |x| 4e-3 * (x / 90.0).sin() + 0.4e-3 * random.normal());
        let found = fit(&readings, &Request { robust: true, ..request(Basis::Chebyshev, 8) }).unwrap();
        named += found.outliers.len();
    }
    eprintln!("{named} of 12000 honest readings called outliers");
    assert!(named < 40, "{named}");
    let mut random = Random(1);
    let mess =
        forward(&every(60, 10.0), |x| if random.even() < 0.4 { 10.0 * random.normal() } else { 1e-4 * x });
    assert!(matches!(
        fit(&mess, &Request { robust: true, ..request(Basis::Chebyshev, 2) }),
        Err(FitError::TooManyOutliers { .. })
    ));
    let single = Request { robust: true, basis: Some(Basis::Table), ..Request::default() };
    assert_eq!(fit(&mess, &single).unwrap_err(), FitError::NoRepeats);
}

/// Both directions, three cycles.
fn both_ways(random: &mut Random, half: impl Fn(f64) -> f64) -> Vec<Reading> {
    let mut all = Vec::new();
    for cycle in 1..=3 {
        for x in every(31, 15.0) {
            for (travel, sign) in [(Travel::Forward, 1.0), (Travel::Reverse, -1.0)] {
                let value = 5e-3 * (x / 120.0).sin() + sign * half(x) + 0.3e-3 * random.normal();
                all.push(at(x, value, travel, cycle));
            }
        }
    }
    all
}

#[test]
fn smooth_curves_keep_the_reversal_that_the_data_show() {
    let mut random = Random(8);
    for (basis, half) in [
        (Basis::Chebyshev, (|_| 2e-3) as fn(f64) -> f64),
        (Basis::HalfRange, |x| 1e-3 + 2e-3 * x / 450.0),
        (Basis::Fourier, |x| 2e-3 - 4e-3 * (x / 450.0 - 0.5).powi(2)),
    ] {
        let all = both_ways(&mut random, half);
        let found = fit(&all, &Request { basis: Some(basis), ..Request::default() }).unwrap();
        assert!(found.reversal.is_some(), "{basis:?}");
        assert!(found.notes.iter().any(|n| matches!(n, Note::ReversalKept { .. })));
        for x in every(46, 10.0) {
            let got = found.value(x, Travel::Forward) - found.value(x, Travel::Reverse);
            assert!((got - 2.0 * half(x)).abs() < 0.4e-3, "{basis:?} at {x}: {got}");
        }
        // the whole function stands in the model format: a curve and a table
        let function = found.function();
        for travel in [Travel::Forward, Travel::Reverse] {
            assert!((function.value(77.0, travel) - found.value(77.0, travel)).abs() < 1e-15);
        }
        let mean = fit(&all, &Request { basis: Some(basis), reversal: Reversal::Mean, ..Request::default() })
            .unwrap();
        assert!(mean.reversal.is_none() && mean.more.is_empty());
    }
    let mut kept = 0;
    for seed in 0..100 {
        let all = both_ways(&mut Random(seed), |_| 0.0);
        let found = fit(&all, &Request { basis: Some(Basis::Chebyshev), ..Request::default() }).unwrap();
        kept += usize::from(found.reversal.is_some());
    }
    assert!(kept <= 8, "a reversal that is not there was kept {kept} times of 100");
}

#[test]
fn smoothing_takes_noise_out_of_a_table_and_leaves_waves_in() {
    let (mut better, mut before, mut after) = (0, 0.0, 0.0);
    for seed in 0..100 {
        let mut random = Random(seed + 70);
        let truth = |x: f64| 4e-3 * (TAU * x / 160.0).sin();
        let readings = forward(&every(61, 10.0), |x| truth(x) + 1e-3 * random.normal());
        let error = |smoothing| {
            let wanted = Request { basis: Some(Basis::Table), smoothing, ..Request::default() };
            let found = fit(&readings, &wanted).unwrap();
            let squares =
                readings.iter().map(|r| (found.value(r.position, r.travel) - truth(r.position)).powi(2));
            (squares.sum::<f64>() / 61.0).sqrt()
        };
        let (raw, smooth) = (error(Smoothing::None), error(Smoothing::Auto));
        better += usize::from(smooth < raw);
        before += raw / 100.0;
        after += smooth / 100.0;
    }
    eprintln!(
        "table of single readings: {:.2} um off the truth, smoothed {:.2} um",
        1e3 * before,
        1e3 * after
    );
    assert!(better >= 95 && after < 0.7 * before, "{better}, {before} to {after}");
}

#[test]
fn a_whole_turn_closes() {
    let mut random = Random(4);
    let turn = Request { turn: Some(TAU), ..Request::default() };
    let truth = |a: f64| 3e-5 * (a + 0.4).sin() + 1e-5 * (3.0 * a).cos();
    let mut readings = Vec::new();
    for cycle in 1..=3 {
        for i in 0..24 {
            let a = f64::from(i) * TAU / 24.0;
            readings.push(at(a, truth(a) + 1e-6 * random.normal(), Travel::Forward, cycle));
        }
    }
    for basis in [None, Some(Basis::Fourier), Some(Basis::Table)] {
        for smoothing in [Smoothing::None, Smoothing::Auto] {
            let found = fit(&readings, &Request { basis, smoothing, ..turn.clone() }).unwrap();
            let range = found.curve.range().unwrap();
            assert!((range[1] - range[0] - TAU).abs() < 1e-12, "{basis:?}");
            let [low, high] = range.map(|a| found.value(a, Travel::Forward));
            assert!((low - high).abs() < 1e-12, "{basis:?}");
            // the gap between the last target and the first is no blind spot
            let a = TAU * 23.5 / 24.0;
            assert!((found.value(a, Travel::Forward) - truth(a)).abs() < 4e-6, "{basis:?}");
        }
    }
    assert_eq!(fit(&readings, &turn).unwrap().basis, Basis::Fourier);
    assert_eq!(fit(&readings, &turn).unwrap().order, Some(3));
    let open = fit(&readings, &Request { basis: Some(Basis::Chebyshev), ..turn.clone() }).unwrap();
    assert!(open.notes.iter().any(|n| matches!(n, Note::TurnLeftOpen { .. })));
    // half a turn is no whole one
    readings.retain(|r| r.position < 3.2);
    let half = fit(&readings, &Request { basis: Some(Basis::Table), ..turn }).unwrap();
    assert!(half.curve.range().unwrap()[1] < 3.2);
}

#[test]
fn a_record_of_a_million_readings_gives_what_its_truth_says() {
    let mut random = Random(6);
    let readings: Vec<Reading> = (0..1_000_000)
        .map(|i| {
            let x = 500.0 * f64::from(i) / 999_999.0;
            at(x, 3e-3 * (x / 70.0).sin() + 1e-3 * random.normal(), Travel::Forward, 1)
        })
        .collect();
    let found = fit(&readings, &request(Basis::Chebyshev, 20)).unwrap();
    assert_eq!(found.figures.n, 1_000_000);
    assert!((found.figures.rmse_dof.unwrap() / 1e-3 - 1.0).abs() < 0.005);
    let worst = every(501, 1.0)
        .iter()
        .map(|x| (found.value(*x, Travel::Forward) - 3e-3 * (x / 70.0).sin()).abs())
        .fold(0.0, f64::max);
    // 21 numbers from a million readings: some micrometre hundredths at the ends
    assert!(worst < 3e-5, "{worst}");
}
