//! The shadow engine beside a machine that is never offset.

use super::*;

/// Frames of a machine that moves along X at `feed` mm/s and holds no offset.
fn drive(shadow: &mut Shadow, model: &Model, feed: f64, cycles: u32) -> Option<CycleOutput> {
    let mut frame = Position { state: READY, ..Position::default() };
    let mut last = None;
    for cycle in 1..=cycles {
        frame.sequence = cycle;
        frame.control_ns = i64::from(cycle) * 1_000_000;
        frame.commanded[0] = 100.0 + feed * f64::from(cycle) * CYCLE_S;
        frame.actual[0] = frame.commanded[0];
        let now = MonoTime::ZERO.plus_seconds(f64::from(cycle) * CYCLE_S);
        last = shadow.on_position(now, &frame, model);
    }
    last
}

fn switched_on(config: &EngineConfig, model: &Model) -> Shadow {
    let mut shadow = Shadow::new(config, model).unwrap();
    shadow.set(MonoTime::ZERO, true);
    shadow
}

/// EXX = 10 um sin(2 pi x / 10 mm): a screw.
fn screw() -> Model {
    let mut spec = ModelSpec::new("m", Chain::parse("[w b X Y Z t]").unwrap());
    let mut x = AxisSpec::new(AxisName::X);
    x.travel = Some([0.0, 500.0]);
    spec.axes.push(x);
    let wave = volcomp_model::curve::Fourier::new(0.0, 500.0, 10.0, 0.0, 0.0, &[0.0], &[0.010]).unwrap();
    spec.errors.push((ErrorSymbol::parse("exx").unwrap(), ErrorFunction::single(Curve::Fourier(wave))));
    Model::new(&spec).unwrap()
}

#[test]
fn it_believes_that_its_offset_is_applied_and_scores_what_is_left() {
    for source in [PositionSource::Commanded, PositionSource::Actual] {
        let config = EngineConfig { position_source: source, ..config() };
        let model = model();
        let mut shadow = switched_on(&config, &model);
        let last = drive(&mut shadow, &model, 0.0, 2000).unwrap();
        assert_eq!((last.state, shadow.state()), (State::Active, State::Active));
        // the correction of +10 um is -10 um, though the machine reads back zero all the time
        assert!((last.offset[0] + 0.010).abs() < 1e-9);
        let score = shadow.score();
        assert_eq!((score.cycles, score.faults, score.interruptions), (2000, 0, 0));
        assert!((score.before_rms(0).unwrap() - 0.010).abs() < 1e-9);
        assert!(score.after_rms(0).unwrap() < 1e-9, "{:?}", score.after_rms(0));
        assert!(score.active_cycles > 1000);
        assert_eq!(score.before_rms(MAX_AXES), None);
    }
}

#[test]
fn a_gain_leaves_its_part_of_what_the_model_knows() {
    let model = model();
    for (gain, left) in [(1.0, 0.0), (0.5, 0.005), (0.0, 0.010)] {
        let mut shadow = switched_on(&EngineConfig { gain, ..config() }, &model);
        drive(&mut shadow, &model, 0.0, 2000);
        let score = shadow.score();
        assert!((score.before_rms(0).unwrap() - 0.010).abs() < 1e-9, "gain {gain}");
        assert!((score.after_rms(0).unwrap() - left).abs() < 1e-9, "gain {gain}: {:?}", score.after_rms(0));
    }
}

#[test]
fn limits_that_cannot_follow_show_in_the_score() {
    let model = screw();
    // 10 um at 200 mm/s over 10 mm: 1.26 mm/s is asked for
    let left = |rate: f64| {
        let limits = AxisLimits { rate, acceleration: 1000.0, ..LIMITS };
        let config = EngineConfig {
            limits: vec![limits; 3],
            lag: Lag::Cycles(0.0),
            lag_uncertainty_cycles: 0.0,
            ..config()
        };
        let mut shadow = switched_on(&config, &model);
        drive(&mut shadow, &model, 200.0, 1500);
        let score = shadow.score();
        assert!((score.before_rms(0).unwrap() - 0.010 / 2f64.sqrt()).abs() < 2e-4);
        (score.after_rms(0).unwrap(), score.axes[0].limited_cycles)
    };
    let (free, limited) = (left(3.0), left(0.3));
    assert!(free.0 < 2e-4 && free.1 == 0, "{free:?}");
    assert!(limited.0 > 10.0 * free.0.max(1e-5) && limited.1 > 100, "{limited:?}");
}

#[test]
fn what_would_stop_the_machine_is_counted() {
    let model = constant_model(1.0);
    let mut shadow = switched_on(&config(), &model);
    drive(&mut shadow, &model, 0.0, 500);
    assert_eq!((shadow.state(), shadow.score().faults), (State::Faulted, 1));
}

#[test]
fn off_it_does_nothing_and_on_again_it_starts_over() {
    let model = constant_model(1.0);
    let mut shadow = Shadow::new(&config(), &model).unwrap();
    assert_eq!((drive(&mut shadow, &model, 0.0, 100), shadow.score().cycles), (None, 0));
    shadow.set(MonoTime::ZERO, true);
    drive(&mut shadow, &model, 0.0, 500);
    assert_eq!(shadow.state(), State::Faulted);
    shadow.set(MonoTime::ZERO, true);
    assert_eq!((shadow.state(), shadow.score()), (State::Armed, &ShadowScore::default()));
    drive(&mut shadow, &model, 0.0, 500);
    assert_eq!((shadow.state(), shadow.score().faults), (State::Faulted, 1));
}
