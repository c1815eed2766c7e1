use proptest::prelude::*;

use super::*;
use volcomp_model::Chain;
use volcomp_model::Curve;
use volcomp_model::compare::compare;
use volcomp_model::curve::{Chebyshev, Fourier, Interpolation, Table};
use volcomp_model::geometry::Vec3;
use volcomp_model::spec::ReferenceBody;

fn symbol(text: &str) -> ErrorSymbol {
    ErrorSymbol::parse(text).unwrap()
}

fn empty(chain: &str) -> ModelSpec {
    let mut spec = ModelSpec::new("m", Chain::parse(chain).unwrap());
    spec.tool_tip = Vec3::new(0.0, 0.0, -100.0);
    for axis in spec.chain.clone().axes() {
        spec.axes.push(AxisSpec { travel: Some([0.0, 400.0]), ..AxisSpec::new(axis.name) });
    }
    spec
}

fn source(name: &str, spec: ModelSpec) -> Source {
    Source { name: name.to_owned(), spec, absolute: false }
}

fn table(f: impl Fn(f64) -> f64, low: f64, high: f64, n: usize) -> Curve {
    let x: Vec<f64> = (0..n).map(|i| low + (high - low) * i as f64 / (n - 1) as f64).collect();
    let y = x.iter().map(|x| f(*x)).collect();
    Curve::Table(Table::new(x, y, None, Interpolation::Linear).unwrap())
}

fn with(chain: &str, errors: &[(&str, Curve, f64)]) -> ModelSpec {
    let mut spec = empty(chain);
    for (name, curve, std) in errors {
        let function = ErrorFunction { std: Some(*std), ..ErrorFunction::single(curve.clone()) };
        spec.errors.push((symbol(name), function));
    }
    spec
}

const CHAIN: &str = "[w X' b Y Z t]";

fn wave(x: f64) -> f64 {
    0.004 * (x / 60.0).sin() + 1e-5 * x
}

#[test]
fn files_about_different_errors_are_put_side_by_side() {
    let a = source("a", with(CHAIN, &[("exx", table(wave, 0.0, 400.0, 41), 2e-4)]));
    let b = with(CHAIN, &[("eyy", table(wave, 0.0, 400.0, 41), 2e-4), ("ec0y", Curve::Constant(2e-5), 1e-6)]);
    let b = source("b", ModelSpec { vertical: Some(AxisName::Y), ..b });
    let done = assemble(&[a, b], &Options::default()).unwrap();
    assert_eq!(done.spec.vertical, Some(AxisName::Y), "said by the second alone");
    let named: Vec<String> = done.spec.errors.iter().map(|(s, _)| s.to_string()).collect();
    assert_eq!(named, ["EXX", "EYY", "EC0Y"]);
    assert!(done.errors.iter().all(|e| e.how == How::Only));
    assert!(done.checks.is_empty() && done.gauge.moved.iter().all(|m| m.amount.abs() < 1e-12));
}

#[test]
fn the_slope_of_a_straight_edge_is_no_squareness() {
    // the straight edge lay 50 urad askew; the square was measured apart
    let askew = |x: f64| 0.003 * (x / 70.0).sin() + 50e-6 * x + 0.02;
    let a = source("edge", with(CHAIN, &[("eyx", table(askew, 0.0, 400.0, 41), 2e-4)]));
    let b = source("square", with(CHAIN, &[("ec0y", Curve::Constant(20e-6), 1e-6)]));
    let done = assemble(&[a.clone(), b.clone()], &Options::default()).unwrap();
    let (_, square) = done.spec.errors.iter().find(|(s, _)| *s == symbol("ec0y")).unwrap();
    assert!((square.value(0.0, Default::default()) - 20e-6).abs() < 1e-12);
    let slope = done.dropped.iter().find(|d| matches!(d.part, Part::Slope { .. })).unwrap();
    let ends = (askew(400.0) - askew(0.0)) / 400.0;
    assert!((slope.amount - ends).abs() < 1e-12 && slope.unstated == [symbol("ec0y")]);
    // measured in one set-up the slope is the squareness
    let all = Source { absolute: true, ..a };
    let done = assemble(&[all], &Options::default()).unwrap();
    let (_, square) = done.spec.errors.iter().find(|(s, _)| *s == symbol("ec0y")).unwrap();
    assert!((square.value(0.0, Default::default()) + ends).abs() < 1e-12);
    assert!(done.dropped.is_empty());
}

#[test]
fn two_measurements_that_agree_become_their_mean() {
    let noisy = |x: f64, k: f64| wave(x) + 1e-4 * (k * x).sin();
    let a = source("a", with(CHAIN, &[("exx", table(|x| noisy(x, 1.3), 0.0, 400.0, 41), 1e-4)]));
    let b = source("b", with(CHAIN, &[("exx", table(|x| noisy(x, 0.7) + 0.05, 0.0, 400.0, 41), 2e-4)]));
    let done = assemble(&[a, b], &Options::default()).unwrap();
    let [origin] = &done.errors[..] else { panic!("{done:?}") };
    assert_eq!(origin.how, How::Mean);
    assert!((origin.from[0].1 - 0.8).abs() < 1e-9, "{origin:?}");
    let [check] = &done.checks[..] else { panic!() };
    assert!(check.p.unwrap() > 0.01 && check.places == 41 && check.dof == 40, "{check:?}");
    let (_, function) = &done.spec.errors[0];
    assert!((function.std.unwrap() - (1.0 / (1e8 + 0.25e8f64)).sqrt()).abs() < 1e-9);
    // zero at the reference pose, both shapes in it
    assert!(function.value(0.0, Default::default()).abs() < 1e-12);
}

#[test]
fn contradictions_are_refused_unless_decided() {
    let a = source("laser", with(CHAIN, &[("exx", table(wave, 0.0, 400.0, 41), 1e-4)]));
    let b = source("comb", with(CHAIN, &[("exx", table(|x| wave(x) + 8e-6 * x, 0.0, 400.0, 41), 1e-4)]));
    let both = [a, b];
    let refused = assemble(&both, &Options::default()).unwrap_err();
    assert!(matches!(&refused, AssembleError::Inconsistent { checks, .. } if checks.len() == 1));
    let text = refused.to_string();
    assert!(
        text.contains("EXX: laser and comb differ by up to 1.60 um")
            && text.contains("degrees of freedom, p "),
        "{text}"
    );
    let prefer = Options { prefer: vec![(1, None)], ..Options::default() };
    let done = assemble(&both, &prefer).unwrap();
    assert_eq!((done.errors[0].how, done.errors[0].from[0].0), (How::Preferred, 1));
    assert_eq!(done.checks.len(), 1, "the contradiction is still reported");
    let mean = Options { average: Some(None), ..Options::default() };
    let done = assemble(&both, &mean).unwrap();
    // the scatter of the two is in the uncertainty of the mean
    assert!(done.spec.errors[0].1.std.unwrap() > 4e-4, "{:?}", done.spec.errors[0].1.std);
}

#[test]
fn without_uncertainties_nothing_is_decided_silently() {
    let bare = |f: fn(f64) -> f64| {
        let mut spec = with(CHAIN, &[("eax", table(f, 0.0, 400.0, 41), 1e-6)]);
        spec.errors[0].1.std = None;
        spec
    };
    let both = [source("a", bare(|x| 1e-7 * x)), source("b", bare(|x| 1.1e-7 * x))];
    assert!(matches!(assemble(&both, &Options::default()).unwrap_err(), AssembleError::Untested { .. }));
    let assumed = Options { std_angle: Some(5e-6), ..Options::default() };
    assert_eq!(assemble(&both, &assumed).unwrap().errors[0].how, How::Mean);
    let same = [both[0].clone(), both[0].clone()];
    assert_eq!(assemble(&same, &Options::default()).unwrap().errors[0].how, How::Same);
}

#[test]
fn ranges_are_joined_over_their_overlap() {
    // straightness: the second set-up has its own line
    let shape = |x: f64| 0.006 * (x / 90.0).sin();
    let a = source("left", with(CHAIN, &[("ezx", table(shape, 0.0, 250.0, 51), 1e-4)]));
    let b = source(
        "right",
        with(CHAIN, &[("ezx", table(|x| shape(x) + 0.3 - 4e-4 * x, 150.0, 400.0, 51), 1e-4)]),
    );
    let done = assemble(&[a.clone(), b], &Options::default()).unwrap();
    assert_eq!(done.errors[0].how, How::Joined);
    let (_, f) = &done.spec.errors[0];
    let line = |x: f64| shape(0.0) + (shape(400.0) - shape(0.0)) * x / 400.0;
    for i in 0..=80 {
        let x = 5.0 * f64::from(i);
        assert!((f.value(x, Default::default()) - (shape(x) - line(x))).abs() < 1e-5, "{x}");
    }
    let apart = source("far", with(CHAIN, &[("ezx", table(shape, 300.0, 400.0, 11), 1e-4)]));
    assert!(matches!(
        assemble(&[a, apart], &Options::default()).unwrap_err(),
        AssembleError::Disjoint { .. }
    ));
}

#[test]
fn reference_points_are_tied_together_by_the_angles() {
    // EXX measured at two heights: a pitch of 20 urad over the travel makes 200 mm of height 4 um
    let pitch = Curve::Chebyshev(Chebyshev::new(0.0, 400.0, vec![10e-6, 10e-6]).unwrap());
    let mut low =
        with("[w b X Y Z t]", &[("exx", table(wave, 0.0, 400.0, 41), 1e-4), ("ebx", pitch.clone(), 1e-8)]);
    let mut high = with(
        "[w b X Y Z t]",
        &[("exx", table(|x| wave(x) + 200.0 * 20e-6 * x / 400.0, 0.0, 400.0, 41), 1e-4)],
    );
    low.axes[0].reference_points[0].point.z = -200.0;
    high.axes[0].reference_points[0].point.z = 0.0;
    let done =
        assemble(&[source("low", low.clone()), source("high", high.clone())], &Options::default()).unwrap();
    let check = done.checks.iter().find(|c| c.symbol == symbol("exx")).unwrap();
    assert!(check.largest.abs() < 1e-9, "{check:?}");
    let kept = done.spec.axis(AxisName::X).reference_points[0].point.z;
    assert!((kept + 200.0).abs() < 1e-12, "the point of the first source is kept");
    // without the pitch they cannot be compared
    low.errors.retain(|(s, _)| *s != symbol("ebx"));
    let refused = assemble(&[source("low", low), source("high", high)], &Options::default()).unwrap_err();
    assert!(matches!(refused, AssembleError::NoAngle { .. }));
    assert!(
        refused.to_string().contains("200.0 mm away") && refused.to_string().contains("EBX"),
        "{refused}"
    );
}

#[test]
fn squareness_of_another_range_is_transferred_before_it_is_compared() {
    // a curved axis: its end-point line over the first half is another one than over the whole travel
    let bow = |x: f64| 0.02 * (1.0 - ((x - 200.0) / 200.0).powi(2));
    let edge = source("edge", with(CHAIN, &[("eyx", table(bow, 0.0, 400.0, 81), 1e-4)]));
    let mut half = with(CHAIN, &[("ec0y", Curve::Constant(0.0), 1e-6)]);
    half.axes[0].travel = Some([0.0, 200.0]);
    // the line of the first half rises by 20 um over 200 mm: EYX slope +100 urad, angle X-Y smaller by as much
    half.errors[0].1.curves = vec![Curve::Constant(30e-6 - 100e-6)];
    let mut whole = with(CHAIN, &[("ec0y", Curve::Constant(30e-6), 1e-6)]);
    whole.axes[0].travel = Some([0.0, 400.0]);
    let done = assemble(&[edge, source("half", half), source("whole", whole)], &Options::default()).unwrap();
    let check = done.checks.iter().find(|c| c.symbol == symbol("ec0y")).unwrap();
    assert!(check.largest.abs() < 1e-9, "{check:?}");
    let (_, square) = done.spec.errors.iter().find(|(s, _)| *s == symbol("ec0y")).unwrap();
    assert!((square.value(0.0, Default::default()) - 30e-6).abs() < 1e-9);
}

#[test]
fn foreign_files_are_refused() {
    let a = source("a", with(CHAIN, &[("exx", table(wave, 0.0, 400.0, 11), 1e-4)]));
    let mut other = a.clone();
    other.spec.machine = "other".to_owned();
    assert!(matches!(
        assemble(&[a.clone(), other], &Options::default()).unwrap_err(),
        AssembleError::Machine { .. }
    ));
    let b = source("b", with("[w b X Y Z t]", &[("eyy", table(wave, 0.0, 400.0, 11), 1e-4)]));
    let refused = assemble(&[a, b], &Options::default()).unwrap_err();
    assert!(
        refused.to_string().contains("chain [w b X Y Z t], but [w X' b Y Z t] is assembled"),
        "{refused}"
    );
    assert_eq!(assemble(&[], &Options::default()).unwrap_err(), AssembleError::Empty);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    /// A machine taken apart into files, each with its own set-up, sense and reference points, and put together again,
    /// is the same machine up to a rigid motion.
    #[test]
    fn a_machine_taken_apart_is_put_together_again(
        chain in prop::sample::select(vec!["[w X' b Y Z t]", "[w b X Y Z t]", "[w X' Y' b Z t]"]),
        values in prop::collection::vec(-1.0..1.0f64, 96),
        carriage in any::<bool>(),
    ) {
        let mut next = values.iter().cycle();
        let mut draw = || next.next().copied().unwrap_or_default();
        let mut truth = empty(chain);
        for axis in truth.chain.clone().axes() {
            for component in Component::ALL {
                let size = if component.is_angle() { 30e-6 } else { 0.01 };
                let wave = Fourier::new(0.0, 400.0, 331.0, 0.0, draw() * size, &[draw() * size], &[draw() * size]);
                truth.errors.push((ErrorSymbol::Motion { component, axis: axis.name }, ErrorFunction::single(Curve::Fourier(wave.unwrap()))));
            }
        }
        truth = normalise(&truth).unwrap().spec;
        let mut sources = Vec::new();
        for axis in truth.chain.clone().axes() {
            let mut own = empty(chain);
            let motions: Vec<_> = truth.errors.iter().filter(|(s, _)| !s.is_constant() && s.axis() == axis.name).cloned().collect();
            let angle = |wanted: ErrorSymbol| Some(motions.iter().find(|(s, _)| *s == wanted).map(|(_, f)| f.clone()).unwrap_or_default());
            for (symbol, function) in &motions {
                let mut function = function.clone();
                if !symbol.is_angle() {
                    let i = symbol.component().index();
                    let to = ReferencePoint { point: Vec3::new(300.0 * draw(), 300.0 * draw(), 300.0 * draw()), body: ReferenceBody::Carriage };
                    let entry = own.axes.iter_mut().find(|a| a.name == axis.name).unwrap();
                    let from = entry.reference_points[i];
                    entry.reference_points[i] = to;
                    function = curves::transferred(&function, *symbol, &from, &to, truth.is_workpiece_side(axis.name), angle).unwrap();
                    // the slope at the other point is the machine's; how the straight edge lay is not
                    function.curves.push(Curve::Chebyshev(Chebyshev::new(0.0, 400.0, vec![0.05 * draw()]).unwrap()));
                } else {
                    function.curves.push(Curve::Constant(20e-6 * draw()));
                }
                own.errors.push((*symbol, function));
            }
            if carriage {
                turn_sense(&mut own, axis.name, Sense::Carriage);
            }
            sources.push(Source { name: axis.name.to_string(), spec: own, absolute: false });
        }
        let mut square = empty(chain);
        square.errors = truth.errors.iter().filter(|(s, _)| s.is_constant()).cloned().collect();
        sources.push(source("square", square));
        let done = assemble(&sources, &Options::default()).unwrap();
        // the file of the squareness has its lines at the origin, those of the result are elsewhere
        let found = compare(&truth, &done.spec, |_, _| {}).unwrap().volume.unwrap();
        let size = found.rms_position.max(1e-3);
        prop_assert!(found.without_rigid.without_rigid.norm() < 2e-6 + 1e-6 * size, "{} um", found.without_rigid.without_rigid.norm() * 1e3);
    }
}

/// Normal numbers from a fixed sequence (Box-Muller on an LCG).
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

#[test]
fn right_files_are_refused_at_the_stated_rate_and_the_interval_holds_the_truth() {
    let (truth, runs) = (20e-6, 2000);
    let mut noise = Noise(11);
    let (mut refused, mut inside) = ([0u32; 2], 0u32);
    for _ in 0..runs {
        let mut file = |name: &str, s_length: f64, s_angle: f64| {
            let values: Vec<f64> =
                (0..21).map(|i| wave(20.0 * f64::from(i)) + s_length * noise.normal()).collect();
            let exx = Table::new(
                (0..21).map(|i| 20.0 * f64::from(i)).collect(),
                values,
                None,
                Interpolation::Linear,
            );
            let square = Curve::Constant(truth + s_angle * noise.normal());
            source(
                name,
                with(CHAIN, &[("exx", Curve::Table(exx.unwrap()), s_length), ("ec0y", square, s_angle)]),
            )
        };
        let both = [file("a", 2e-4, 1e-6), file("b", 5e-4, 2e-6)];
        let options = Options { average: Some(None), ..Options::default() };
        let done = assemble(&both, &options).unwrap();
        for (count, name) in refused.iter_mut().zip(["exx", "ec0y"]) {
            let check = done.checks.iter().find(|c| c.symbol == symbol(name)).unwrap();
            *count += u32::from(check.p.unwrap() < 0.01);
        }
        // without growth by the scatter, so that the rate is that of the stated uncertainties
        let (_, square) = done.spec.errors.iter().find(|(s, _)| *s == symbol("ec0y")).unwrap();
        let std = (1.0f64 / (1e12 + 0.25e12)).sqrt();
        inside += u32::from((square.value(0.0, Default::default()) - truth).abs() < 1.96 * std);
    }
    // binomial limits at 99.9 %
    for count in refused {
        assert!((6..=37).contains(&count), "{refused:?} of {runs} refused at 1 %");
    }
    let rate = f64::from(inside) / f64::from(runs);
    assert!((0.935..=0.965).contains(&rate), "{rate}");
}
