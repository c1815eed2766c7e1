use proptest::prelude::*;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::*;
use volcomp_model::statistics::student_95;
use volcomp_units::{arcsec_from_rad, rad_from_arcsec};

const CHAINS: [&str; 4] = ["[w b X Y Z t]", "[w X' b Y Z t]", "[w X' Y' b Z t]", "[w X' Y' Z' b t]"];

fn setup(chain: &str, size: [f64; 3]) -> Setup {
    Setup::new(&Chain::parse(chain).unwrap(), [0.0; 3], size, Vec3::zeros()).unwrap()
}

/// Length of a diagonal between tips that lie where skew axes take them, computed from vectors alone.
fn exact_displacement(signs: [f64; 3], size: [f64; 3], [c0y, b0z, a0z]: [f64; 3]) -> f64 {
    let tip = |q: [f64; 3]| {
        let x = Vec3::new(q[0], 0.0, 0.0);
        let y = Vec3::new(-c0y.sin(), c0y.cos(), 0.0) * q[1];
        // Ry(B0Z) Rx(A0Z) z
        let z = Vec3::new(b0z.sin() * a0z.cos(), -a0z.sin(), b0z.cos() * a0z.cos()) * q[2];
        x + y + z
    };
    let ends = [0.0, 1.0].map(|share| {
        tip(std::array::from_fn(|i| size[i] * if signs[i] > 0.0 { share } else { 1.0 - share }))
    });
    (ends[1] - ends[0]).norm() - Vec3::from(size).norm()
}

#[test]
fn the_signatures_are_those_of_the_equations_on_every_chain() {
    let [a, b, c] = [3000.0, 1500.0, 780.0];
    let length = f64::sqrt(a * a + b * b + c * c);
    for chain in CHAINS.into_iter().chain(["[w C' X' b Y Z (S) t]"]) {
        let s = setup(chain, [a, b, c]);
        for (row, [sx, sy, sz]) in SIGNS.into_iter().enumerate() {
            let expected =
                [1.0, -sx * sy * a * b / length, sx * sz * a * c / length, -sy * sz * b * c / length];
            for (column, e) in expected.into_iter().enumerate() {
                assert!((s.design[(row, column)] - e).abs() < 1e-6 * length, "{chain} {row} {column}");
            }
        }
    }
}

#[test]
fn figures_of_the_equations_and_of_the_paper() {
    let s = setup("[w X' b Y Z t]", [3000.0, 1500.0, 780.0]);
    // 0.079, 0.152, 0.304 arcsec per um
    for (per_mm, expected) in s.sensitivity().into_iter().zip([0.079, 0.152, 0.304]) {
        assert!((arcsec_from_rad(per_mm * 1e-3) - expected).abs() < 5e-4);
    }
    // 002: theta (-3.13, 22.33, -1.37) arcsec, with the signs of equations 1.7
    let d = [-51.5e-3, 56.0e-3, -95.7e-3, 91.1e-3];
    let r = s.squareness(&d, &[5e-3; 4]).unwrap();
    for (value, expected) in r.value.into_iter().zip([-3.13, -22.33, -1.37]) {
        assert!((arcsec_from_rad(value) - expected).abs() < 0.02, "{} {expected}", arcsec_from_rad(value));
    }
    // the last one drowns in 5 um repeatability, the others do not
    let significant = |i: usize| r.value[i].abs() > student_95(1000) * r.covariance[(i, i)].sqrt();
    assert!(significant(0) && significant(1) && !significant(2));
    // the range 186.8 um
    assert!((d[3] - d[2] - 186.8e-3).abs() < 1e-9);
}

#[test]
fn an_angle_that_grows_along_x_feigns_half_of_it_in_squareness() {
    for (chain, sign) in [("[w b X Y Z t]", 0.5), ("[w X' b Y Z t]", -0.5)] {
        let s = setup(chain, [900.0, 700.0, 500.0]);
        let spec = ModelSpec::new("m", Chain::parse(chain).unwrap());
        let missing = s.missing_angles(&spec).unwrap();
        let of = |text: &str| missing.iter().find(|m| m.symbol == ErrorSymbol::parse(text).unwrap()).unwrap();
        assert!((of("ebx").bias[1] - sign).abs() < 1e-6, "{chain} {:?}", of("ebx"));
        assert!((of("ecx").bias[0].abs() - 0.5).abs() < 1e-6);
    }
    // the last axis before the tool has no lever to a reflector at the origin of M
    let s = setup("[w b X Y Z t]", [900.0, 700.0, 500.0]);
    let spec = ModelSpec::new("m", Chain::parse("[w b X Y Z t]").unwrap());
    assert!(s.missing_angles(&spec).unwrap().iter().all(|m| m.symbol.axis() != AxisName::Z));
}

#[test]
fn stated_uncertainties_of_angles_arrive_in_the_result() {
    let chain = Chain::parse("[w b X Y Z t]").unwrap();
    let s = Setup::new(&chain, [0.0; 3], [900.0, 700.0, 500.0], Vec3::zeros()).unwrap();
    let mut spec = ModelSpec::new("m", chain);
    let symbol = ErrorSymbol::parse("ebx").unwrap();
    spec.errors
        .push((symbol, ErrorFunction { std: Some(1e-6), ..ErrorFunction::single(Curve::Constant(0.0)) }));
    // at either end the lever is that of the end alone: half the effect each way
    let covariance = s.covariance_of_model(&spec).unwrap();
    assert!((covariance[(1, 1)].sqrt() - 0.5e-6 * 2f64.sqrt()).abs() < 1e-9, "{covariance}");
}

/// Models with straightness curves of 1 um standard uncertainty, as fitted: the interval holds the truth in 95 % of them.
#[test]
fn uncertain_straightness_widens_the_interval_as_it_must() {
    let size = [900.0, 700.0, 500.0];
    let chain = Chain::parse("[w X' b Y Z t]").unwrap();
    let s = Setup::new(&chain, [0.0; 3], size, Vec3::zeros()).unwrap();
    let (std, noise_mm, runs) = (1e-3, 1e-3, 4_000);
    let mut inside = [0; 3];
    for seed in 0..runs {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
        // the truth is straight and square; the model is not
        let mut spec = ModelSpec::new("m", chain.clone());
        for symbol in ["eyx", "ezx", "exy", "ezy", "exz", "eyz"].map(|t| ErrorSymbol::parse(t).unwrap()) {
            let side = size[symbol.axis().direction()];
            let ends = vec![std * normal(), std * normal()];
            let table = Table::new(vec![0.0, side], ends, None, Interpolation::Linear).unwrap();
            let curve = ErrorFunction::single(Curve::Table(table));
            spec.errors.push((symbol, ErrorFunction { std: Some(std), ..curve }));
        }
        let model = s.displacements(&spec, Travel::Forward).unwrap();
        let corrected = model.map(|d| noise_mm * normal() - d);
        let found = s.squareness(&corrected, &[noise_mm; 4]).unwrap();
        let covariance = found.covariance + s.covariance_of_model(&spec).unwrap();
        for i in 0..3 {
            inside[i] += u32::from(found.value[i].abs() < 1.959_964 * covariance[(i, i)].sqrt());
        }
    }
    // 95 % +- 4 standard deviations of a binomial
    for count in inside {
        let share = f64::from(count) / runs as f64;
        assert!((0.936..0.964).contains(&share), "{inside:?} of {runs}");
    }
}

#[test]
fn what_cannot_be_determined_is_refused() {
    let chain = |t: &str| Chain::parse(t).unwrap();
    let new = |c: &Chain, size| Setup::new(c, [0.0; 3], size, Vec3::zeros()).map(|_| ()).unwrap_err();
    assert_eq!(new(&chain("[w b X Z t]"), [1.0; 3]), DiagonalsError::NoAxis { axis: AxisName::Y });
    assert!(matches!(
        new(&chain("[w b X Y Z t]"), [100.0, 0.0, 100.0]),
        DiagonalsError::EmptyBox { axis: AxisName::Y, .. }
    ));
    let flat = new(&chain("[w b X Y Z t]"), [5000.0, 1000.0, 2.0]);
    assert!(matches!(flat, DiagonalsError::Flat { .. }));
    assert!(flat.to_string().contains("factor of 2500, limit 1000"), "{flat}");
    let s = setup("[w b X Y Z t]", [1.0; 3]);
    assert!(s.squareness(&[f64::NAN, 0.0, 0.0, 0.0], &[0.0; 4]).is_err());
}

proptest! {
    #[test]
    fn skew_axes_of_any_chain_are_found_with_unknown_positioning(
        chain in 0usize..4,
        size in prop::array::uniform3(50.0..4000.0f64),
        truth in prop::array::uniform3(-2e-4..2e-4f64),
        common in -0.2..0.2f64,
    ) {
        let s = setup(CHAINS[chain], size);
        let d = SIGNS.map(|signs| exact_displacement(signs, size, truth) + common);
        let found = s.squareness(&d, &[0.0; 4]).unwrap();
        // second order: squares of the angles times the ratio of the sides
        let ratio = size.iter().copied().fold(0.0, f64::max) / size.iter().copied().fold(f64::INFINITY, f64::min);
        for i in 0..3 {
            prop_assert!((found.value[i] - truth[i]).abs() < 8e-8 * ratio, "{:?} {truth:?}", found.value);
        }
        prop_assert!((found.common - common).abs() < 4e-8 * s.length());
    }
}

#[test]
fn the_stated_interval_holds_the_truth() {
    let size = [800.0, 500.0, 450.0];
    let s = setup("[w X' Y' b Z t]", size);
    let truth = [rad_from_arcsec(11.0), rad_from_arcsec(-7.0), rad_from_arcsec(3.0)];
    let exact = SIGNS.map(|signs| exact_displacement(signs, size, truth));
    let bias = s.squareness(&exact, &[0.0; 4]).unwrap().value;
    let (mut inside, mut all) = ([0; 3], 0);
    for seed in 0..2000 {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut readings = Vec::new();
        for (diagonal, d) in exact.into_iter().enumerate() {
            for cycle in 1..=3 {
                for (position, value) in [(0.0, 0.0), (s.length(), d + 0.03)] {
                    let noise: f64 = StandardNormal.sample(&mut random);
                    let reading = crate::Reading {
                        cycle,
                        travel: Travel::Forward,
                        position,
                        value: value + 2e-3 * noise,
                    };
                    readings.push(runs::RunReading { diagonal, reading, time: readings.len() as f64 });
                }
            }
        }
        let ends = runs::end_to_end(&readings, s.length()).unwrap();
        let std = ends.run_std.unwrap() / 3f64.sqrt();
        let r = s.squareness(&ends.displacement, &[std; 4]).unwrap();
        all += 1;
        for i in 0..3 {
            let half = student_95(ends.dof) * r.covariance[(i, i)].sqrt();
            inside[i] += usize::from((r.value[i] - truth[i] - (bias[i] - truth[i])).abs() < half);
        }
    }
    // 95 % +- 3 standard deviations of a binomial of 2000
    for count in inside {
        let share = count as f64 / f64::from(all);
        assert!((0.935..0.965).contains(&share), "{share}");
    }
}
