//! Exact sums, the filter against the batch solution, gates, caps, consistency.

use super::super::noise::Adaptation;
use super::*;
use volcomp_model::random::SplitMix64 as Random;

fn grid() -> NodeGrid {
    NodeGrid::new(vec![0.0, 400.0, 800.0], vec![0.0, 300.0], vec![0.0, 250.0]).unwrap()
}

fn open() -> Rules {
    Rules { gate: f64::INFINITY, cap_at_prior: false, ..Rules::default() }
}

fn point(random: &mut Random) -> [f64; 3] {
    [800.0 * random.even(), 300.0 * random.even(), 250.0 * random.even()]
}

fn seen(grid: &NodeGrid, point: [f64; 3], weights: &[f64], value: f64) -> Observation {
    let mut all = [0.0; COMPONENTS_MAX];
    all[..weights.len()].copy_from_slice(weights);
    Observation { place: grid.place(point), weights: all, value, nuisance: None }
}

#[test]
fn one_reading_after_the_other_is_the_least_squares_of_all() {
    let g = grid();
    let (n, sigma, r) = (2 * g.nodes(), [2.0, 3.0], 0.25);
    let prior: Vec<f64> = (0..n).map(|i| (i as f64).sin()).collect();
    let process = Process::RandomWalk { variance_per_s: 0.0 };
    let mut filter = NodeFilter::new(&g, &prior, &sigma, 300.0, process, open()).unwrap();
    let p0 = DMatrix::from_row_slice(n, n, &filter.p);
    let mut noise = MeasurementNoise::new(r, None).unwrap();
    let mut random = Random(3);
    let (mut information, mut right) = (p0.clone().try_inverse().unwrap(), DVector::zeros(n));
    for i in 0..40 {
        let weights = [random.normal(), random.normal()];
        let o = seen(&g, point(&mut random), &weights, 3.0 * random.normal());
        let mut h = DVector::zeros(n);
        for (c, w) in weights.iter().enumerate() {
            for (node, shape) in o.place.nodes.iter().zip(&o.place.shape) {
                h[c * g.nodes() + node] += w * shape;
            }
        }
        information += &h * h.transpose() / r;
        right += &h * (o.value - h.dot(&DVector::from_column_slice(&prior))) / r;
        let update = filter.update(&o, &mut noise);
        assert_eq!((update.verdict, update.rejections), (Verdict::Accepted, 0), "{i}");
        filter.predict(1.0);
    }
    let p = information.try_inverse().unwrap();
    let x = DVector::from_column_slice(&prior) + &p * right;
    for i in 0..n {
        assert!((filter.state()[i] - x[i]).abs() < 1e-10, "{i}");
        for j in 0..n {
            assert!((filter.p[i * n + j] - p[(i, j)]).abs() < 1e-10);
        }
    }
}

#[test]
fn the_covariance_stays_symmetric_and_positive_over_many_updates() {
    let g = grid();
    let process = Process::RandomWalk { variance_per_s: 1e-4 };
    let mut filter = NodeFilter::new(&g, &[0.0; 12], &[1.0], 400.0, process, Rules::default()).unwrap();
    let mut noise = MeasurementNoise::new(1e-6, None).unwrap();
    let mut random = Random(9);
    for i in 0..3000 {
        let o = seen(&g, point(&mut random), &[1.0], 1e-3 * random.normal());
        filter.update(&o, &mut noise);
        filter.predict(0.1);
        if i % 500 == 0 {
            let p = DMatrix::from_row_slice(12, 12, &filter.p);
            assert_eq!(p, p.transpose());
            assert!(p.symmetric_eigenvalues().min() > 0.0);
            assert!(filter.variances().all(|v| v <= 1.0));
        }
    }
}

#[test]
fn outliers_are_rejected_and_five_of_them_raise_the_alarm() {
    let g = grid();
    let process = Process::RandomWalk { variance_per_s: 0.0 };
    let mut filter = NodeFilter::new(&g, &[0.0; 12], &[1.0], 400.0, process, Rules::default()).unwrap();
    let mut noise =
        MeasurementNoise::new(0.01, Some(Adaptation { share: 0.05, low: 1e-4, high: 1.0 })).unwrap();
    let middle = [400.0, 150.0, 125.0];
    for i in 1..=5 {
        assert!(!filter.alarm());
        let update = filter.update(&seen(&g, middle, &[1.0], 50.0), &mut noise);
        assert_eq!((update.verdict, update.rejections), (Verdict::Rejected, i));
        assert!(update.ratio() > 10.8);
    }
    assert!(filter.alarm());
    // what was rejected taught nothing
    assert_eq!((noise.variance(), filter.state()), (0.01, &[0.0; 12][..]));
    filter.update(&seen(&g, middle, &[1.0], 0.1), &mut noise);
    assert!(!filter.alarm());
    for value in [f64::NAN, f64::INFINITY] {
        let update = filter.update(&seen(&g, middle, &[1.0], value), &mut noise);
        assert_eq!(update.verdict, Verdict::Unusable);
    }
    assert_eq!(filter.update(&seen(&g, middle, &[0.0], 1.0), &mut noise).verdict, Verdict::Unusable);
    assert!(filter.state().iter().all(|x| x.is_finite()));
}

#[test]
fn without_readings_a_reverting_map_comes_home() {
    let g = grid();
    let prior: Vec<f64> = (0..12).map(f64::from).collect();
    let process = Process::MeanReverting { tau_s: 100.0 };
    let mut filter = NodeFilter::new(&g, &prior, &[2.0], 300.0, process, open()).unwrap();
    let start = filter.clone();
    let mut noise = MeasurementNoise::new(0.01, None).unwrap();
    filter.update(&seen(&g, [100.0, 100.0, 100.0], &[1.0], 9.0), &mut noise);
    assert!(filter.state()[0] > 1.0);
    filter.predict(1e4);
    assert!(filter.state().iter().zip(&prior).all(|(x, p)| (x - p).abs() < 1e-12));
    for (a, b) in filter.p.iter().zip(&start.p) {
        assert!((a - b).abs() < 1e-12);
    }
    let before = filter.clone();
    filter.predict(-5.0);
    filter.predict(f64::NAN);
    assert_eq!(filter, before);
}

#[test]
fn the_output_stays_near_the_prior_map() {
    let g = grid();
    let rules = Rules { limit: 0.5, ..open() };
    let process = Process::RandomWalk { variance_per_s: 0.0 };
    let mut filter = NodeFilter::new(&g, &[1.0; 12], &[10.0], 0.0, process, rules).unwrap();
    let mut noise = MeasurementNoise::new(1e-4, None).unwrap();
    let corner = [0.0, 0.0, 0.0];
    filter.update(&seen(&g, corner, &[1.0], 7.0), &mut noise);
    assert!((filter.state()[0] - 7.0).abs() < 1e-3);
    assert_eq!(filter.value(0, &g.place(corner)), 1.5);
    assert_eq!(filter.map().next(), Some(1.5));
    // without correlation the other nodes did not move
    assert!(filter.state()[1..].iter().all(|x| *x == 1.0));
    assert!(filter.std_at(0, &g.place(corner)) < 0.011);
    assert!((filter.std_at(0, &g.place([800.0, 300.0, 250.0])) - 10.0).abs() < 1e-12);
}

#[test]
fn the_variance_of_the_sensor_is_found_from_starts_wrong_by_five() {
    let g = grid();
    for (truth, start) in [(3.0, 0.6), (3.0, 15.0), (1.0, 0.2), (1.0, 5.0)] {
        let (mut sum, seeds) = (0.0, 40);
        for seed in 0..seeds {
            let mut random = Random(1000 + seed);
            let process = Process::RandomWalk { variance_per_s: 1e-3 };
            let mut filter = NodeFilter::new(&g, &[0.0; 12], &[2.5], 400.0, process, open()).unwrap();
            let adaptation = Some(Adaptation { share: 0.03, low: 1e-4, high: 1e4 });
            let mut noise = MeasurementNoise::new(start * start, adaptation).unwrap();
            let map: Vec<f64> = (0..12).map(|_| random.normal()).collect();
            let mut tail = 0.0;
            for i in 0..600 {
                let place = g.place(point(&mut random));
                let value: f64 = place.nodes.iter().zip(&place.shape).map(|(n, s)| s * map[*n]).sum::<f64>();
                let o = Observation {
                    nuisance: None,
                    place,
                    weights: [1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
                    value: value + truth * random.normal(),
                };
                filter.update(&o, &mut noise);
                filter.predict(1.0);
                if i >= 300 {
                    tail += noise.variance() / 300.0;
                }
            }
            sum += tail.sqrt();
        }
        let mean = sum / seeds as f64;
        assert!((mean / truth - 1.0).abs() < 0.15, "{truth} from {start}: {mean}");
    }
}

#[test]
fn the_innovation_is_as_large_as_the_filter_says() {
    let g = grid();
    let mut random = Random(77);
    let (mut sum, mut count) = (0.0, 0.0);
    for _ in 0..200 {
        // the truth is drawn from the very prior
        let process = Process::RandomWalk { variance_per_s: 0.02 };
        let mut filter = NodeFilter::new(&g, &[0.0; 12], &[2.0], 350.0, process, open()).unwrap();
        let p0 = DMatrix::from_row_slice(12, 12, &filter.p);
        let z = DVector::from_fn(12, |_, _| random.normal());
        let mut map = p0.cholesky().unwrap().l() * z;
        let mut noise = MeasurementNoise::new(0.25, None).unwrap();
        for _ in 0..40 {
            let place = g.place(point(&mut random));
            let value: f64 = place.nodes.iter().zip(&place.shape).map(|(n, s)| s * map[*n]).sum();
            let o = Observation {
                nuisance: None,
                place,
                weights: [1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
                value: value + 0.5 * random.normal(),
            };
            sum += filter.update(&o, &mut noise).ratio();
            count += 1.0;
            filter.predict(0.5);
            map.iter_mut().for_each(|x| *x += 0.1 * random.normal());
        }
    }
    let mean: f64 = sum / count;
    // 8000 ratios of variance 2
    assert!((mean - 1.0).abs() < 4.0 * (2.0 / count).sqrt(), "{mean}");
}

#[test]
fn impossible_filters_are_refused() {
    let build = |prior: &[f64], sigma: &[f64], correlation_mm| {
        let process = Process::RandomWalk { variance_per_s: 0.0 };
        let built = NodeFilter::new(&grid(), prior, sigma, correlation_mm, process, open());
        built.map(|f| f.state().len())
    };
    assert_eq!(build(&[0.0; 24], &[1.0, 1.0], 0.0), Ok(24));
    assert_eq!(build(&[0.0; 12], &[], 0.0), Err(FilterError::Components { found: 0 }));
    assert_eq!(build(&[0.0; 12], &[1.0, 1.0], 0.0), Err(FilterError::PriorSize { found: 12, expected: 24 }));
    assert_eq!(build(&[0.0; 12], &[-1.0], 0.0), Err(FilterError::BadSigma { value: -1.0 }));
    assert_eq!(build(&[0.0; 12], &[1.0], -5.0), Err(FilterError::BadCorrelation { value: -5.0 }));
    let mut prior = [0.0; 12];
    prior[3] = f64::INFINITY;
    assert_eq!(build(&prior, &[1.0], 0.0), Err(FilterError::PriorNotFinite { index: 3 }));
}

#[test]
fn a_walk_that_is_correlated_keeps_neighbours_together() {
    let g = grid();
    let n = g.nodes();
    let process =
        Process::CorrelatedWalk { variance_per_s: [0.1, 0.2, 0.0, 0.0, 0.0, 0.0], forget_s: f64::INFINITY };
    let mut filter = NodeFilter::new(&g, &vec![0.0; 2 * n], &[2.0, 3.0], 300.0, process, open()).unwrap();
    let before = filter.p.clone();
    filter.predict(10.0);
    for (after, before) in filter.p.iter().zip(&before).take(n) {
        // 1 of 4 for the first component
        assert!((after - 1.25 * before).abs() < 1e-12, "{after} {before}");
    }
    let second = n * 2 * n + n;
    assert!((filter.p[second] - (9.0 + 2.0)).abs() < 1e-12);
    assert_eq!(filter.p[n], 0.0, "components stay apart");
}

#[test]
fn what_was_kept_comes_back_and_nonsense_does_not() {
    let g = grid();
    let n = g.nodes();
    let process = Process::MeanReverting { tau_s: 1e6 };
    let rules = Rules { limit: 5.0, ..Rules::default() };
    let mut filter = NodeFilter::new(&g, &vec![1.0; n], &[2.0], 300.0, process, rules).unwrap();
    let mut noise = MeasurementNoise::new(0.01, None).unwrap();
    let mut random = Random(5);
    for _ in 0..50 {
        let o = seen(&g, point(&mut random), &[1.0], 1.5);
        filter.update(&o, &mut noise);
    }
    let state = filter.state().to_vec();
    let std: Vec<f64> = filter.variances().map(f64::sqrt).collect();
    let mut other = NodeFilter::new(&g, &vec![1.0; n], &[2.0], 300.0, process, rules).unwrap();
    assert!(other.restore(&state, &std));
    assert_eq!(other.state(), state);
    for (a, b) in other.variances().zip(filter.variances()) {
        assert!((a - b).abs() < 1e-12 * b, "{a} {b}");
    }
    let mut bad = state.clone();
    bad[3] = 7.0;
    assert!(!other.restore(&bad, &std), "beyond the limit about the map");
    bad[3] = f64::NAN;
    assert!(!other.restore(&bad, &std));
    assert!(!other.restore(&state, &vec![0.0; n]));
    assert!(!other.restore(&state[1..], &std[1..]));
    assert_eq!(other.state(), state, "nothing was changed");
    other.forget();
    assert!(other.state().iter().all(|x| *x == 1.0));
    assert!(other.variances().all(|v| v == 4.0));
}

#[test]
fn comparing_changes_nothing_and_says_what_the_update_says() {
    let g = grid();
    let process = Process::RandomWalk { variance_per_s: 0.0 };
    let mut filter =
        NodeFilter::new(&g, &vec![0.0; g.nodes()], &[2.0], 100.0, process, Rules::default()).unwrap();
    let mut noise = MeasurementNoise::new(0.25, None).unwrap();
    let o = seen(&g, [100.0, 100.0, 100.0], &[1.0], 0.7);
    let (innovation, variance) = filter.compare(&o, &noise);
    let update = filter.update(&o, &mut noise);
    assert_eq!((update.innovation, update.innovation_variance), (innovation, variance));
}

#[test]
fn a_number_beside_the_map_is_told_from_it() {
    let g = grid();
    let n = g.nodes();
    for process in [Process::MeanReverting { tau_s: 1e5 }, Process::RandomWalk { variance_per_s: 1e-6 }] {
        let mut filter = NodeFilter::new(&g, &vec![0.0; n], &[2.0], 300.0, process, open()).unwrap();
        let before = filter.p.clone();
        let delay = filter.add_nuisance(9.0, 1e-6);
        assert_eq!(filter.state().len(), n);
        assert_eq!(filter.p[n + 2], before[n + 1], "the map's own part is as it was");
        assert_eq!(filter.nuisance(delay), (0.0, 3.0));
        let mut noise = MeasurementNoise::new(0.01, None).unwrap();
        let mut random = Random(11);
        for _ in 0..300 {
            filter.predict(0.1);
            let speed = random.normal();
            let value = 1.0 + 2.5 * speed + 0.1 * random.normal();
            let o =
                Observation { nuisance: Some((delay, speed)), ..seen(&g, point(&mut random), &[1.0], value) };
            filter.update(&o, &mut noise);
        }
        let (value, std) = filter.nuisance(delay);
        assert!((value - 2.5).abs() < 4.0 * std && std < 0.02, "{value} {std}");
        let place = g.place([400.0, 150.0, 120.0]);
        assert!((filter.value(0, &place) - 1.0).abs() < 4.0 * filter.std_at(0, &place));
    }
}
