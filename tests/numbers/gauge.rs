//! The normal form of a model says the same as the model, up to the rigid motion that it reports.

#![expect(clippy::unwrap_used, reason = "a test may stop at what it does not expect")]

use proptest::prelude::*;
use volcomp::config::model::{self, ModelFile};
use volcomp::model::axes::{AxisKind, AxisName, MAX_AXES, Travel};
use volcomp::model::curve::{
    Chebyshev, Curve, ErrorFunction, Fourier, Grid, HalfRange, Interpolation, Table,
};
use volcomp::model::gauge::{Gauged, Part, Untouched, normalise};
use volcomp::model::geometry::{Mat3, Vec3, rotation_about, unit};
use volcomp::model::spec::ReferenceBody;
use volcomp::model::{
    AxisSpec, Chain, Component, Deviation, ErrorSymbol, Model, ModelSpec, Pose, Sense, Side,
};

const CHAINS: &[&str] = &[
    "[w b X Y Z t]",
    "[w X' b Y Z t]",
    "[w X' Y' b Z t]",
    "[w X' Y' Z' b t]",
    "[w Z' b X Y t]",
    "[w Y' b Z X (S) t]",
    "[w b X Y Z C A (S) t]",
    "[w C' A' b X Y Z t]",
    "[w C' B' Y' b X Z (S) t]",
    "[w A' b X Y B t]",
    "[w B' X' b Z t]",
    "[w C' X' b Y Z A t]",
    "[w X' C' b Y Z t]",
    "[w X' b Y Z C W t]",
    "[w X' b Y Z W t]",
    "[w U' b X Y Z t]",
    "[w b Y Z t]",
    "[w Z' b t]",
    "[w b U V W t]",
    "[w C' A' b B (S) t]",
];

struct Random(u64);

impl Random {
    /// In [-1, 1].
    fn number(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let mut h = self.0;
        h = (h ^ (h >> 31)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((h ^ (h >> 29)) >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    fn below(&mut self, n: usize) -> usize {
        ((self.number() + 1.0) * 0.5 * n as f64) as usize % n
    }

    fn point(&mut self, size: f64) -> Vec3 {
        Vec3::from_fn(|_, _| size * self.number())
    }

    fn list(&mut self, n: usize, size: f64) -> Vec<f64> {
        (0..n).map(|_| size * self.number()).collect()
    }

    /// Any kind of curve over `[low, high]`, sometimes wider or narrower.
    fn curve(&mut self, [low, high]: [f64; 2], size: f64) -> Curve {
        let length = high - low;
        let [low, high] = match self.below(4) {
            0 => [low - 0.3 * length, high + 0.1 * length],
            1 => [low + 0.2 * length, high - 0.3 * length],
            _ => [low, high],
        };
        let (a, b) = (size * self.number(), size * self.number());
        match self.below(6) {
            0 => Curve::Constant(a),
            1 => {
                let (cos, sin) = (self.list(3, 0.2 * size), self.list(2, 0.2 * size));
                Curve::Fourier(Fourier::new(low, high - low, 0.7 * length, a, b, &cos, &sin).unwrap())
            }
            2 => {
                let sin = self.list(3, 0.2 * size);
                Curve::HalfRange(HalfRange::new(low, high, a, b, &sin).unwrap())
            }
            3 => {
                let n = self.below(5);
                Curve::Chebyshev(Chebyshev::new(low, high, self.list(n, size)).unwrap())
            }
            rule => {
                let x = vec![low, low + 0.1 * length, low + 0.3 * length, high];
                let v = self.list(4, size);
                let reverse = (self.below(2) == 0).then(|| self.list(4, size));
                let rule = if rule == 4 { Interpolation::Linear } else { Interpolation::MonotoneCubic };
                Curve::Table(Table::new(x, v, reverse, rule).unwrap())
            }
        }
    }
}

fn travel_of(random: &mut Random, kind: AxisKind) -> [f64; 2] {
    let size = if kind == AxisKind::Linear { 500.0 } else { 3.0 };
    match random.below(4) {
        0 => [0.0, size],
        1 => [-size, 0.0],
        2 => [-0.4 * size, 0.6 * size],
        // home outside the travel
        _ => [0.1 * size, size],
    }
}

/// A random machine with everything a model can have.
fn machine(chain: &str, seed: u64) -> ModelSpec {
    let random = &mut Random(seed);
    let mut spec = ModelSpec::new("random", Chain::parse(chain).unwrap());
    spec.workpiece_origin = random.point(300.0);
    spec.tool_tip = random.point(300.0);
    for axis in spec.chain.clone().axes() {
        let name = axis.name;
        let mut entry = AxisSpec::new(name);
        let travel = travel_of(random, axis.kind());
        entry.travel = Some(travel);
        entry.point = random.point(300.0);
        entry.sense = if random.below(3) == 0 { Sense::Carriage } else { Sense::Relative };
        for r in &mut entry.reference_points {
            r.point = random.point(200.0);
            r.body = if random.below(2) == 0 { ReferenceBody::Bed } else { ReferenceBody::Carriage };
        }
        let mirrored = entry.sense == Sense::Carriage && axis.side == Side::Workpiece;
        let stored = if mirrored { [-travel[1], -travel[0]] } else { travel };
        spec.axes.push(entry);
        for component in Component::ALL {
            let size = if component.is_angle() { 4e-5 } else { 0.02 };
            let mut function = ErrorFunction::default();
            for _ in 0..random.below(3) {
                function.curves.push(random.curve(stored, size));
            }
            if random.below(6) == 0 {
                function.grids.extend(grid(random, &spec.chain, name, stored, size));
            }
            spec.errors.push((ErrorSymbol::Motion { component, axis: name }, function));
            let constant = ErrorSymbol::parse(&format!("e{}0{name}", component.letter()));
            if let Some(symbol) = constant.filter(|_| random.below(3) > 0) {
                let curve = Curve::Constant(size * random.number());
                spec.errors.push((symbol, ErrorFunction::single(curve)));
                if spec.validate().is_err() {
                    spec.errors.pop();
                }
            }
        }
    }
    spec
}

/// A grid over an axis and another one of the chain.
fn grid(random: &mut Random, chain: &Chain, name: AxisName, stored: [f64; 2], size: f64) -> Option<Grid> {
    let other = chain.axes().iter().find(|a| a.name != name)?;
    let reach = if other.kind() == AxisKind::Linear { 400.0 } else { 2.0 };
    let axes = vec![(name, stored.to_vec()), (other.name, vec![-reach, 0.2 * reach, reach])];
    Grid::new(axes, random.list(6, size)).ok()
}

fn pose(spec: &ModelSpec, random: &mut Random) -> Pose {
    let mut pose = Pose::at([0.0; MAX_AXES]);
    for (k, axis) in spec.chain.axes().iter().enumerate() {
        let [low, high] = spec.axis(axis.name).travel.unwrap();
        pose.position[k] = low + (high - low) * 0.5 * (random.number() + 1.0);
        pose.travel[k] = if random.below(2) == 0 { Travel::Forward } else { Travel::Reverse };
    }
    pose
}

/// Nominal tip in W, and the turn of the workpiece-side rotary axes, from their definition.
fn nominal(spec: &ModelSpec, pose: &Pose) -> (Vec3, Mat3) {
    let mut tip = pose.tool_tip.unwrap_or(spec.tool_tip);
    let mut turn = Mat3::identity();
    for (k, axis) in spec.chain.axes().iter().enumerate().rev() {
        let q = pose.position[k];
        let direction = axis.name.direction();
        if axis.kind() == AxisKind::Linear {
            tip += unit(direction) * q;
            continue;
        }
        let p = spec.axis(axis.name).point;
        let rotation = rotation_about(direction, q);
        tip = p + rotation * (tip - p);
        if axis.side == Side::Workpiece {
            turn = rotation * turn;
        }
    }
    (tip - spec.workpiece_origin, turn)
}

/// What the report says that the normal form leaves out.
fn left_out(gauged: &Gauged, spec: &ModelSpec, pose: &Pose) -> (Vec3, Vec3) {
    let rigid = &gauged.total.rigid;
    let (tip, turn) = nominal(spec, pose);
    let other_tool = pose.tool_tip.unwrap_or(spec.tool_tip) - spec.tool_tip;
    let tool_turn = turn * rigid.tool_turn;
    (rigid.shift + rigid.turn.cross(&tip) + turn * rigid.tool_turn.cross(&other_tool), rigid.turn + tool_turn)
}

fn deviation(spec: &ModelSpec, pose: &Pose) -> Deviation {
    Model::new(spec).unwrap().deviation(pose)
}

fn value_at(spec: &ModelSpec, symbol: ErrorSymbol, q: f64) -> f64 {
    let inverted = spec.axis(symbol.axis()).sense == Sense::Carriage && spec.is_workpiece_side(symbol.axis());
    let found = spec.errors.iter().find(|(s, _)| *s == symbol);
    found.map_or(
        0.0,
        |(_, f)| {
            if inverted { -f.value(-q, Travel::Reverse) } else { f.value(q, Travel::Forward) }
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, ..ProptestConfig::default() })]

    /// Every chain, every kind of curve, both senses, both bodies of reference points, other tools, both directions.
    #[test]
    fn the_normal_form_differs_by_the_reported_rigid_motion(c in 0..CHAINS.len(), seed in any::<u64>()) {
        let spec = machine(CHAINS[c], seed);
        let gauged = normalise(&spec).unwrap();
        let random = &mut Random(seed ^ 77);
        for i in 0..12 {
            let mut p = pose(&spec, random);
            p.tool_tip = (i % 3 == 2).then(|| random.point(400.0));
            let (before, after) = (deviation(&spec, &p), deviation(&gauged.spec, &p));
            let (shift, turn) = left_out(&gauged, &spec, &p);
            let position = before.position - after.position - shift;
            prop_assert!(position.amax() < 1e-12, "{} {position}", CHAINS[c]);
            let rotation = before.rotation - after.rotation - turn;
            prop_assert!(rotation.amax() < 1e-15, "{} {rotation}", CHAINS[c]);
        }
    }

    /// With full rotations the two still agree but for the second order.
    #[test]
    fn the_exact_evaluation_agrees_to_second_order(c in 0..CHAINS.len(), seed in any::<u64>()) {
        let spec = machine(CHAINS[c], seed);
        let gauged = normalise(&spec).unwrap();
        let p = pose(&spec, &mut Random(seed ^ 78));
        let before = Model::new(&spec).unwrap().deviation_exact(&p).position;
        let after = Model::new(&gauged.spec).unwrap().deviation_exact(&p).position;
        prop_assert!((before - after - left_out(&gauged, &spec, &p).0).amax() < 1e-3);
    }

    #[test]
    fn a_second_time_changes_nothing(c in 0..CHAINS.len(), seed in any::<u64>()) {
        let once = normalise(&machine(CHAINS[c], seed)).unwrap();
        let twice = normalise(&once.spec).unwrap();
        prop_assert_eq!(&twice.moved, &vec![]);
        let rest = &twice.total.rigid;
        prop_assert!(rest.shift.amax() <= 1e-12 && rest.turn.amax().max(rest.tool_turn.amax()) <= 1e-15);
        prop_assert_eq!(&twice.spec, &once.spec);
        // and not through a file either
        let text = model::write_file(&ModelFile::new(once.spec.clone()), &[]);
        let read = model::parse("normal.toml", &text).unwrap();
        prop_assert_eq!(normalise(&read).unwrap().moved, vec![]);
    }

    /// The parts of the report add up to its total.
    #[test]
    fn what_each_part_does_adds_up(c in 0..CHAINS.len(), seed in any::<u64>()) {
        let gauged = normalise(&machine(CHAINS[c], seed)).unwrap();
        let shift: Vec3 = gauged.moved.iter().map(|m| m.effect.rigid.shift).sum();
        prop_assert!((shift - gauged.total.rigid.shift).amax() < 1e-12);
        for (symbol, amount) in &gauged.total.errors {
            let parts = gauged.moved.iter().flat_map(|m| &m.effect.errors).filter(|(s, _)| s == symbol);
            prop_assert!((parts.map(|(_, a)| a).sum::<f64>() - amount).abs() < 1e-12);
        }
    }

    /// Equations 1.8: nothing left at the reference pose, no slope left in a straightness.
    #[test]
    fn the_rules_are_kept(c in 0..6usize, seed in any::<u64>()) {
        let mut spec = machine(CHAINS[c], seed);
        for (_, f) in &mut spec.errors {
            f.grids.clear();
        }
        let normal = normalise(&spec).unwrap().spec;
        for axis in spec.chain.axes().iter().filter(|a| a.kind() == AxisKind::Linear) {
            let [low, high] = spec.axis(axis.name).travel.unwrap();
            let at = 0.0f64.clamp(low, high);
            for component in Component::ALL {
                let symbol = ErrorSymbol::Motion { component, axis: axis.name };
                prop_assert!(value_at(&normal, symbol, at).abs() < 1e-12, "{symbol}");
                if !component.is_angle() && component.index() != axis.name.direction() {
                    let rise = value_at(&normal, symbol, high) - value_at(&normal, symbol, low);
                    prop_assert!(rise.abs() < 2e-12, "{symbol} {rise}");
                }
            }
        }
    }
}

fn three_axes(errors: &[(&str, Curve)]) -> ModelSpec {
    let mut spec = ModelSpec::new("m", Chain::parse("[w X' b Y Z t]").unwrap());
    for (name, travel) in
        [(AxisName::X, [0.0, 500.0]), (AxisName::Y, [0.0, 400.0]), (AxisName::Z, [-300.0, 0.0])]
    {
        spec.axes.push(AxisSpec { travel: Some(travel), ..AxisSpec::new(name) });
    }
    for (symbol, curve) in errors {
        spec.errors.push((ErrorSymbol::parse(symbol).unwrap(), ErrorFunction::single(curve.clone())));
    }
    spec
}

/// `slope * x` over `[low, high]`.
fn straight(slope: f64, low: f64, high: f64) -> Curve {
    let (middle, half) = (0.5 * (low + high), 0.5 * (high - low));
    Curve::Chebyshev(Chebyshev::new(low, high, vec![slope * middle, slope * half]).unwrap())
}

fn amount(gauged: &Gauged, symbol: &str) -> f64 {
    let symbol = ErrorSymbol::parse(symbol).unwrap();
    gauged.total.errors.iter().find(|(s, _)| *s == symbol).map_or(0.0, |(_, a)| *a)
}

/// The signs of equations 1.8 (`docs/reference/equations.md`), one slope at a time.
#[test]
fn slopes_go_to_squareness_with_the_signs_of_the_specification() {
    let s = 1e-5;
    for (symbol, low, high, c0y, b0z, a0z) in [
        ("eyx", 0.0, 500.0, -s, 0.0, 0.0),
        ("exy", 0.0, 400.0, -s, 0.0, 0.0),
        ("ezx", 0.0, 500.0, 0.0, s, 0.0),
        ("exz", -300.0, 0.0, 0.0, s, 0.0),
        ("ezy", 0.0, 400.0, 0.0, 0.0, -s),
        ("eyz", -300.0, 0.0, 0.0, 0.0, -s),
    ] {
        let gauged = normalise(&three_axes(&[(symbol, straight(s, low, high))])).unwrap();
        for (name, expected) in [("ec0y", c0y), ("eb0z", b0z), ("ea0z", a0z)] {
            assert!((amount(&gauged, name) - expected).abs() < 1e-18, "{symbol} {name}");
        }
        assert!(matches!(gauged.moved[0].part, Part::Slope { .. }));
        // the straightness had nothing but its slope
        assert!(gauged.spec.errors.iter().all(|(e, _)| e.is_constant()), "{:?}", gauged.spec.errors);
    }
}

/// A constant yaw of a carriage under everything is a rigid turn of W; of one that carries only Z it is not.
#[test]
fn constant_angles_go_where_their_levers_say() {
    let yaw = |symbol| normalise(&three_axes(&[(symbol, Curve::Constant(2e-5))])).unwrap();
    let x = yaw("ecx");
    assert!(x.total.errors.is_empty(), "{:?}", x.total);
    assert!((x.total.rigid.turn - Vec3::new(0.0, 0.0, 2e-5)).amax() < 1e-18);
    assert_eq!(x.total.rigid.tool_turn, Vec3::zeros());
    // pitch of Y tilts the line of Z: a squareness, and the tool stays turned
    let y = yaw("eay");
    assert!((amount(&y, "ea0z") - 2e-5).abs() < 1e-18, "{:?}", y.total);
    assert_eq!(y.total.rigid.turn, Vec3::zeros());
    assert!((y.total.rigid.tool_turn - Vec3::new(2e-5, 0.0, 0.0)).amax() < 1e-18);
    // yaw of Z moves no line at all
    let z = yaw("ecz");
    assert!(z.total.errors.is_empty() && z.total.rigid.turn == Vec3::zeros());
    assert!((z.total.rigid.tool_turn.z - 2e-5).abs() < 1e-18);
}

#[test]
fn files_that_mean_the_same_predict_the_same() {
    let s = 2e-5;
    let same = [
        three_axes(&[("eyx", straight(s, 0.0, 500.0))]),
        three_axes(&[("ec0y", Curve::Constant(-s))]),
        three_axes(&[("exy", straight(s, 0.0, 400.0)), ("ecy", Curve::Constant(0.0))]),
        three_axes(&[("ec0y", Curve::Constant(-s)), ("exx", Curve::Constant(0.01))]),
        three_axes(&[("ec0y", Curve::Constant(-s)), ("ecx", Curve::Constant(3e-5))]),
    ]
    .map(|spec| normalise(&spec).unwrap().spec);
    let random = &mut Random(1);
    for _ in 0..50 {
        let p = pose(&same[0], random);
        let first = deviation(&same[0], &p).position;
        assert!((first.x - s * p.position[1]).abs() < 1e-12);
        for other in &same[1..] {
            assert!((deviation(other, &p).position - first).amax() < 1e-12);
        }
    }
}

/// What a rotary table or head can hold goes there, so that nothing is left out.
#[test]
fn rotary_axes_take_up_what_the_linear_axes_lose() {
    let head = machine("[w b X Y Z C A (S) t]", 5);
    let rigid = normalise(&head).unwrap().total.rigid;
    assert!(rigid.tool_turn == Vec3::zeros() && rigid.turn.amax() > 1e-6);
    let table = machine("[w C' A' b X Y Z t]", 5);
    let rigid = normalise(&table).unwrap().total.rigid;
    assert_eq!(rigid.turn, Vec3::zeros());
    assert!(rigid.shift.amax() <= 0.0 && rigid.tool_turn.amax() > 1e-6, "{rigid:?}");
}

#[test]
fn what_cannot_be_moved_is_said() {
    let untouched = |chain: &str| normalise(&machine(chain, 3)).unwrap().untouched;
    assert!(untouched("[w X' C' b Y Z t]").contains(&Untouched::BehindRotary { axis: AxisName::X }));
    assert!(untouched("[w X' b Y Z W t]").contains(&Untouched::Parallelism { axis: AxisName::W }));
    let mut head = machine("[w b X C t]", 3);
    let shift = ErrorSymbol::parse("ezc").unwrap();
    head.errors.retain(|(s, _)| *s != shift);
    head.errors.push((shift, ErrorFunction::single(Curve::Constant(1e-3))));
    assert!(normalise(&head).unwrap().untouched.contains(&Untouched::AlongItself { symbol: shift }));
    let mut quill = ModelSpec::new("m", Chain::parse("[w b X W t]").unwrap());
    quill.errors.push((ErrorSymbol::parse("ebw").unwrap(), ErrorFunction::single(Curve::Constant(1e-5))));
    let gauged = normalise(&quill).unwrap();
    assert_eq!(gauged.untouched, [Untouched::NoRange { axis: AxisName::W }]);
    assert_eq!(gauged.spec, quill);
}

#[test]
fn a_normal_model_stays_as_it_is() {
    let spec = three_axes(&[("ec0y", Curve::Constant(1e-5)), ("exx", straight(1e-5, 0.0, 500.0))]);
    let gauged = normalise(&spec).unwrap();
    assert_eq!((gauged.moved, gauged.spec), (vec![], spec));
    let mut broken = three_axes(&[]);
    broken.axes.push(AxisSpec::new(AxisName::A));
    assert!(normalise(&broken).is_err());
}
