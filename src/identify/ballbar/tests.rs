use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::*;
use volcomp_model::{Curve, ErrorSymbol};

const R: f64 = 150.0;
const CENTRE: [f64; 2] = [300.0, 200.0];

/// A machine whose axes are moved along the circle in time: what the tool does, not what the analysis thinks.
#[derive(Clone, Copy, Default)]
struct Machine {
    /// Angle between the axes above 90 deg.
    square: f64,
    /// Scale errors.
    scale: [f64; 2],
    /// Lag behind the programmed path, s.
    lag: [f64; 2],
    /// Lost motion at the positive and negative end.
    backlash: [[f64; 2]; 2],
    /// The carriage rests behind a reversal until the drive has gone the way that is lost.
    rests: bool,
    /// Sideways shift between travel towards plus and minus, at both ends.
    play: [[f64; 2]; 2],
    /// Height of a parabola over the diameter, towards plus of the other axis.
    bow: [f64; 2],
    /// Height of the spikes at both ends.
    spike: [[f64; 2]; 2],
    /// Amplitude and phase of the cyclic error.
    cyclic: [[f64; 2]; 2],
    /// Where the instrument stands beside the centre.
    off: [f64; 2],
    /// Instrument longer than said.
    long: f64,
    noise: f64,
}

const PITCH: f64 = 10.0;
const SPIKE_TIME: f64 = 0.03;

impl Machine {
    /// Place of the tool when the program is at `angle` and goes in `direction`.
    fn tool(&self, angle: f64, direction: f64, feed: f64) -> [f64; 2] {
        let programmed = [R * angle.cos(), R * angle.sin()];
        let speed = [-direction * feed * angle.sin(), direction * feed * angle.cos()];
        let mut tool = programmed;
        for k in 0..2 {
            let other = 1 - k;
            let sense = speed[k].signum();
            let share = (programmed[k] / R + 1.0) / 2.0;
            let between = |ends: [f64; 2]| share * ends[0] + (1.0 - share) * ends[1];
            let way = R - (programmed[k] * -sense);
            let end = usize::from(sense > 0.0);
            let crossed = if self.rests { (way / self.backlash[k][end]).min(1.0) } else { 1.0 };
            let screw = core::f64::consts::TAU * (CENTRE[k] + programmed[k]) / PITCH;
            tool[k] += self.scale[k] * programmed[k]
                - self.lag[k] * speed[k]
                - sense * (2.0 * crossed - 1.0) * between(self.backlash[k]) / 2.0
                + self.cyclic[k][0] * (screw + self.cyclic[k][1]).sin();
            tool[other] +=
                sense * between(self.play[k]) / 2.0 + self.bow[k] * (1.0 - (programmed[k] / R).powi(2));
            // the axis sticks behind its reversal: too far outwards for a while
            for (end, outwards) in [(0, 1.0), (1, -1.0)] {
                let reversal =
                    if k == 0 { 0.0 } else { 90.0f64.to_radians() } + f64::from(end) * core::f64::consts::PI;
                let way = (direction * (angle - reversal)).rem_euclid(core::f64::consts::TAU) * R;
                let x = way / feed / SPIKE_TIME;
                tool[k] += outwards * self.spike[k][end as usize] * x * (1.0 - x).exp();
            }
        }
        [tool[0] - self.square * programmed[1], tool[1]]
    }

    fn circles(&self, plan: &[(f64, f64, f64, f64)], per_turn: f64, seed: u64) -> Circles {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut samples = Vec::new();
        for (run, (from_deg, to_deg, direction, feed)) in plan.iter().enumerate() {
            let count = ((to_deg - from_deg) / 360.0 * per_turn).round() as usize;
            for i in 0..count {
                let way = (to_deg - from_deg) * (i as f64 + 0.5) / count as f64;
                let at = if *direction > 0.0 { from_deg + way } else { to_deg - way };
                let angle = at.to_radians();
                let [x, y] = self.tool(angle, *direction, *feed);
                let unit: f64 = StandardNormal.sample(&mut random);
                let length = (x - self.off[0]).hypot(y - self.off[1]);
                samples.push(Sample {
                    angle: angle.rem_euclid(core::f64::consts::TAU),
                    deviation: length - R - self.long + self.noise * unit,
                    travel: if *direction > 0.0 { Travel::Forward } else { Travel::Reverse },
                    feed: Some(*feed),
                    run: run as u32,
                });
            }
        }
        Circles { plane: Plane::Xy, radius: R, centre: CENTRE, samples }
    }
}

const BOTH: [(f64, f64, f64, f64); 2] = [(0.0, 360.0, 1.0, 50.0), (0.0, 360.0, -1.0, 50.0)];
const REQUEST: Request =
    Request { pitch: [Pitch::Given(PITCH), Pitch::Given(PITCH)], spike_time: Some(SPIKE_TIME) };

/// |sin| of one direction is nearly cos 2 phi: beside a mismatch of scales it took tens of micrometres.
#[test]
fn one_direction_shows_no_lateral_play() {
    let machine = Machine { scale: [40e-6, -30e-6], off: [0.02, -0.03], noise: 0.0008, ..all() };
    for seed in 1..=8 {
        let found = analyse(&machine.circles(&BOTH[..1], 360.0, seed), &REQUEST).unwrap();
        let is_play = |e: &Effect| matches!(e, Effect::LateralPlay(_));
        assert!(!found.estimates.iter().any(|e| is_play(&e.effect)), "{:?}", found.estimates);
        assert_eq!(found.missing.iter().filter(|(e, _)| is_play(e)).count(), 2, "{:?}", found.missing);
        let mismatch = found.estimates.iter().find(|e| e.effect == Effect::ScaleMismatch).unwrap();
        assert!(
            (mismatch.values[0].value - 70e-6).abs() < 4.0 * mismatch.values[0].std + 15e-6,
            "{mismatch:?}"
        );
    }
}

/// A step is taken for it at every reading, play while it is crossed for a reversal spike.
#[test]
fn play_that_is_crossed_is_no_reversal_spike() {
    let request = Request { spike_time: None, ..Request::default() };
    for (width, per_turn) in [(0.004, 3600.0), (0.012, 1440.0), (0.02, 720.0)] {
        for seed in 0..4 {
            let machine = Machine {
                backlash: [[width; 2], [0.5 * width; 2]],
                rests: true,
                noise: 1e-4,
                ..Machine::default()
            };
            let found = analyse(&machine.circles(&BOTH, per_turn, seed), &request).unwrap();
            for axis in 0..2 {
                for end in [End::Positive, End::Negative] {
                    let value = found.value(Effect::Backlash(axis), Some(end)).unwrap();
                    let truth = machine.backlash[axis][0];
                    assert!(
                        (value.value - truth).abs() < 4.0 * value.std + 2e-5,
                        "{width} {axis}: {value:?}"
                    );
                }
                let spike = found.estimate(Effect::ReversalSpike(axis)).unwrap();
                assert!(!spike.significant || spike.contribution < 2e-4, "{width} {seed}: {spike:?}");
            }
        }
    }
}

/// At a reversal an axis stands: rounding of the angle would say from which side it came.
#[test]
fn readings_at_a_reversal_say_nothing_of_backlash() {
    let machine = Machine { backlash: [[0.01; 2], [0.006; 2]], noise: 0.0003, ..Machine::default() };
    let plan = BOTH.map(|(from, to, direction, feed)| (from - 0.5, to - 0.5, direction, feed));
    let circles = machine.circles(&plan, 360.0, 3);
    let of = |at_reversals: f64| {
        let mut circles = circles.clone();
        let at = circles.samples.iter_mut().filter(|s| (2.0 * s.angle).sin().abs() < 1e-9);
        at.for_each(|s| s.deviation = at_reversals);
        analyse(&circles, &REQUEST).unwrap()
    };
    let [before, behind] = [-0.005, 0.005].map(of);
    assert_eq!(before.estimates, behind.estimates);
    assert_eq!(before.residuals.len(), circles.samples.len() - 8);
    let value = before.value(Effect::Backlash(0), Some(End::Positive)).unwrap();
    assert!((value.value - 0.01).abs() < 4.0 * value.std && value.std < 0.0003, "{value:?}");
}

/// A bar that warms up reads less and less in the order of time, which looks like play of both axes.
#[test]
fn a_bar_that_grows_is_no_play() {
    let plain = Machine { noise: 0.00025, off: [0.008, -0.005], ..Machine::default() };
    let turns = |runs: usize| -> Vec<_> { (0..runs).map(|i| BOTH[i % 2]).collect() };
    let mut wrong = 0;
    for (seed, (runs, growth)) in
        [(2, 0.005), (2, -0.005), (4, 0.005), (2, 0.0), (4, 0.0)].into_iter().enumerate()
    {
        for seed in 10 * seed as u64..10 * seed as u64 + 10 {
            let mut circles = plain.circles(&turns(runs), 720.0, seed);
            let times = runs::elapsed(&circles.samples);
            assert!((times[0] + 0.5).abs() < 1e-9 && (times[times.len() - 1] - 0.5).abs() < 1e-9);
            // a pause of a tenth of the test between the runs
            let pauses = |s: &Sample| 0.1 * f64::from(s.run);
            circles.samples.iter_mut().zip(&times).for_each(|(s, t)| s.deviation += growth * (t + pauses(s)));
            let found =
                analyse(&circles, &Request { spike_time: Some(SPIKE_TIME), ..Request::default() }).unwrap();
            let change = found.length_change.unwrap();
            assert!((change.value - growth).abs() < 4.5 * change.std, "{runs} {seed}: {change:?}");
            if growth == 0.0 {
                wrong += usize::from(change.is_subtracted);
            } else {
                assert!(change.is_subtracted && change.p_value < 1e-6, "{runs} {seed}: {change:?}");
            }
            let play = |e: &&Estimate| matches!(e.effect, Effect::LateralPlay(_) | Effect::Backlash(_));
            for e in found.estimates.iter().filter(play) {
                assert!(e.values.iter().all(|v| v.value.abs() < 4.5 * v.std), "{runs} {seed}: {e:?}");
            }
        }
    }
    assert!(wrong <= 2, "{wrong} of 20 changes that are not there");
}

fn all() -> Machine {
    Machine {
        rests: false,
        square: 45e-6,
        scale: [30e-6, -12e-6],
        lag: [0.00050, 0.00054],
        backlash: [[0.006, 0.004], [0.003, 0.0025]],
        play: [[0.002, 0.003], [-0.0015, 0.001]],
        bow: [0.0035, -0.0022],
        spike: [[0.004, 0.005], [0.003, 0.0035]],
        cyclic: [[0.0006, 0.4], [0.0004, 2.0]],
        off: [0.02, -0.035],
        long: 0.001,
        noise: 0.0,
    }
}

/// Every number of the machine that the analysis should find: effect, end, truth, relative tolerance.
fn truths(m: &Machine) -> Vec<(Effect, Option<End>, f64)> {
    let mut list = vec![
        (Effect::Squareness, None, m.square),
        (Effect::ScaleMismatch, None, m.scale[0] - m.scale[1]),
        (Effect::ServoMismatch, None, m.lag[1] - m.lag[0]),
    ];
    for k in 0..2 {
        list.push((Effect::Straightness(k), None, m.bow[k]));
        for (i, end) in [End::Positive, End::Negative].into_iter().enumerate() {
            list.push((Effect::Backlash(k), Some(end), m.backlash[k][i]));
            list.push((Effect::LateralPlay(k), Some(end), m.play[k][i]));
            list.push((Effect::ReversalSpike(k), Some(end), m.spike[k][i]));
        }
        list.push((Effect::Cyclic(k), None, 2.0 * m.cyclic[k][0].abs()));
    }
    list
}

/// A unit of an effect as a range on the circle, mm: brings all errors to the same size.
fn reach(effect: Effect) -> f64 {
    match effect {
        Effect::Squareness | Effect::ScaleMismatch => R,
        Effect::ServoMismatch => 50.0,
        _ => 1.0,
    }
}

#[test]
fn each_effect_alone_is_found_and_nothing_else() {
    let whole = all();
    let bare = Machine::default();
    let alone: Vec<(&str, Machine)> = vec![
        ("squareness", Machine { square: whole.square, ..bare }),
        ("scale-mismatch", Machine { scale: whole.scale, ..bare }),
        ("servo-mismatch", Machine { lag: [0.0, 0.0001], ..bare }),
        ("backlash:x", Machine { backlash: [whole.backlash[0], [0.0; 2]], ..bare }),
        ("backlash:y", Machine { backlash: [[0.0; 2], whole.backlash[1]], ..bare }),
        ("lateral-play:x", Machine { play: [whole.play[0], [0.0; 2]], ..bare }),
        ("lateral-play:y", Machine { play: [[0.0; 2], whole.play[1]], ..bare }),
        ("straightness:eyx", Machine { bow: [whole.bow[0], 0.0], ..bare }),
        ("straightness:exy", Machine { bow: [0.0, whole.bow[1]], ..bare }),
        ("reversal-spike:x", Machine { spike: [whole.spike[0], [0.0; 2]], ..bare }),
        ("reversal-spike:y", Machine { spike: [[0.0; 2], whole.spike[1]], ..bare }),
        ("cyclic:x", Machine { cyclic: [whole.cyclic[0], [0.0; 2]], ..bare }),
        ("cyclic:y", Machine { cyclic: [[0.0; 2], whole.cyclic[1]], ..bare }),
    ];
    for (name, machine) in alone {
        let found = analyse(&machine.circles(&BOTH, 2000.0, 1), &REQUEST).unwrap();
        assert!(
            found.estimates[0].effect.name(Plane::Xy).starts_with(name),
            "{name}: {:?}",
            found.estimates[0]
        );
        assert!(found.estimates[0].share > 0.97, "{name}: {:?}", found.estimates[0].share);
        for (effect, end, truth) in truths(&machine) {
            let got = found.value(effect, end).unwrap().value;
            let off = (got - truth).abs() * reach(effect);
            assert!(off < 3e-5, "{name}: {effect:?} {end:?}: {got} for {truth}");
        }
    }
}

#[test]
fn all_effects_together_come_back() {
    let machine = all();
    let found = analyse(&machine.circles(&BOTH, 3000.0, 1), &REQUEST).unwrap();
    for (effect, end, truth) in truths(&machine) {
        let got = found.value(effect, end).unwrap().value;
        let off = (got - truth).abs() * reach(effect);
        assert!(off < 5e-5, "{effect:?} {end:?}: {got} for {truth}");
    }
    assert!((found.offset[0].0 + 0.02).abs() < 1e-4 && (found.offset[1].0 - 0.035).abs() < 1e-4);
    let mean = R * (machine.scale[0] + machine.scale[1]) / 2.0 - machine.long;
    assert!((found.radius_deviation[0].1 - mean).abs() < 1e-4);
    assert!(found.sigma < 3e-5 && found.missing.is_empty(), "{} {:?}", found.sigma, found.missing);
    let share: f64 = found.estimates.iter().map(|e| e.share).sum();
    assert!((share - 1.0).abs() < 1e-12);
    assert!(found.harmonics[0].measured > 3e-3 && found.harmonics.iter().all(|h| h.residual < 2e-5));
}

#[test]
fn intervals_hold_the_truth_at_their_rate() {
    let machine = Machine { noise: 0.5e-3, lag: [0.0; 2], off: [0.0; 2], ..all() };
    let machine = Machine { lag: [0.0, 0.00004], ..machine };
    let truths = truths(&machine);
    // first order only, so that what is tested is the interval
    let exact = analyse(&Machine { noise: 0.0, ..machine }.circles(&BOTH, 200.0, 0), &REQUEST).unwrap();
    let mut inside = vec![0u32; truths.len()];
    for seed in 0..2000 {
        let found = analyse(&machine.circles(&BOTH, 200.0, seed), &REQUEST).unwrap();
        for (count, (effect, end, truth)) in inside.iter_mut().zip(&truths) {
            let v = found.value(*effect, *end).unwrap();
            *count += u32::from((v.value - truth).abs() < 1.96 * v.std);
        }
    }
    for (count, (effect, end, truth)) in inside.iter().zip(&truths) {
        assert!((1860..=1940).contains(count), "{effect:?} {end:?}: {count}");
        let bias = (exact.value(*effect, *end).unwrap().value - truth).abs() * reach(*effect);
        assert!(bias < 2e-5, "{effect:?} {end:?}: {bias}");
    }
}

#[test]
fn nothing_but_noise_is_no_cause() {
    let machine = Machine { noise: 1e-3, ..Machine::default() };
    let mut false_alarms = 0;
    for seed in 0..200 {
        let found = analyse(&machine.circles(&BOTH, 400.0, seed), &REQUEST).unwrap();
        false_alarms += found.estimates.iter().filter(|e| e.significant).count();
        assert!(found.notes.iter().all(|n| !matches!(n, Note::NotWhite { .. })));
    }
    // 13 effects at 0.1 %: 2.6 in 200
    assert!(false_alarms <= 9, "{false_alarms}");
}

#[test]
fn one_direction_cannot_tell_servo_mismatch_from_squareness_and_says_so() {
    let machine = Machine { noise: 0.2e-3, ..all() };
    let found = analyse(&machine.circles(&BOTH[..1], 3000.0, 4), &REQUEST).unwrap();
    assert!(found.estimate(Effect::ServoMismatch).is_none());
    let why = found.missing.iter().find(|(e, _)| *e == Effect::ServoMismatch).unwrap();
    assert_eq!(why.1, Reason::LooksLike(vec![Effect::Squareness]));
    assert!(found.notes.contains(&Note::OneDirection));
    // the squareness found is the sum of both
    let both = machine.square + 50.0 * (machine.lag[1] - machine.lag[0]) / R;
    let got = found.value(Effect::Squareness, None).unwrap();
    assert!((got.value - both).abs() < 4.0 * got.std, "{got:?} {both}");
}

#[test]
fn two_feeds_are_told_apart() {
    let plan = [
        (0.0, 360.0, 1.0, 20.0),
        (0.0, 360.0, -1.0, 20.0),
        (0.0, 360.0, 1.0, 100.0),
        (0.0, 360.0, -1.0, 100.0),
    ];
    let machine = Machine { spike: [[0.0; 2]; 2], lag: [0.005, 0.00504], ..all() };
    let found = analyse(&machine.circles(&plan, 1500.0, 4), &REQUEST).unwrap();
    let got = found.value(Effect::ServoMismatch, None).unwrap().value;
    assert!((got - (machine.lag[1] - machine.lag[0])).abs() < 1e-6, "{got}");
    assert_eq!(found.radius_deviation.len(), 2);
    assert!(!found.notes.contains(&Note::OneFeed));
    // a lag draws the circle wider when it is added to the path instead of filtered: v^2 tau^2 / 2R
    let wider = found.radius_deviation[1].1 - found.radius_deviation[0].1;
    assert!((wider - (0.5f64.powi(2) - 0.1f64.powi(2)) / (2.0 * R)).abs() < 2e-5, "{wider}");
}

#[test]
fn an_arc_of_220_degrees_gives_what_it_can() {
    let arc = [(-20.0, 200.0, 1.0, 50.0), (-20.0, 200.0, -1.0, 50.0)];
    let machine = Machine {
        backlash: [[0.006, 0.004], [0.003, 0.003]],
        play: [[0.0; 2]; 2],
        spike: [[0.0; 2]; 2],
        cyclic: [[0.0; 2]; 2],
        ..all()
    };
    let request = Request { pitch: [Pitch::None; 2], ..REQUEST };
    let circles = Circles { plane: Plane::Zx, ..machine.circles(&arc, 3000.0, 1) };
    let found = analyse(&circles, &request).unwrap();
    for (effect, end, truth) in [
        (Effect::Squareness, None, machine.square),
        (Effect::ServoMismatch, None, machine.lag[1] - machine.lag[0]),
        (Effect::Backlash(0), Some(End::Negative), 0.004),
        (Effect::Backlash(1), Some(End::Positive), 0.003),
    ] {
        let got = found.value(effect, end).unwrap().value;
        assert!((got - truth).abs() * reach(effect) < 1e-4, "{effect:?}: {got} for {truth}");
    }
    assert!(found.value(Effect::Backlash(1), Some(End::Negative)).is_none());
    for effect in [Effect::Backlash(1), Effect::LateralPlay(1), Effect::ReversalSpike(1)] {
        let absent = (effect, Reason::NoReversal(Some(End::Negative)));
        assert!(found.missing.contains(&absent), "{:?}", found.missing);
    }
    let is_arc = |n: &Note| matches!(n, Note::Arc { covered } if (covered.to_degrees() - 220.0).abs() < 1.0);
    assert!(found.notes.iter().any(is_arc), "{:?}", found.notes);
    assert!(found.harmonics.is_empty());
    let dim: Vec<_> = found.estimates.iter().filter(|e| !e.confounded.is_empty()).collect();
    assert!(!dim.is_empty() || !found.missing.is_empty(), "an arc must confound something");
}

#[test]
fn a_pitch_is_found_where_there_is_one_and_only_there() {
    let request = Request { pitch: [Pitch::Search([4.0, 40.0]); 2], spike_time: None };
    let machine = Machine { cyclic: [[0.001, 0.4], [0.0; 2]], noise: 0.5e-3, ..all() };
    let found = analyse(&machine.circles(&BOTH, 3000.0, 8), &request).unwrap();
    assert!((found.pitch[0].unwrap() - PITCH).abs() < 0.02, "{:?}", found.pitch);
    assert_eq!(found.pitch[1], None);
    let limit = found.missing.iter().find_map(|(e, r)| match r {
        Reason::NoPitch { limit } if *e == Effect::Cyclic(1) => Some(*limit),
        _ => None,
    });
    assert!((1e-4..1e-3).contains(&limit.unwrap()), "{limit:?}");
    let got = found.value(Effect::Cyclic(0), None).unwrap();
    assert!((got.value - 0.002).abs() < 4.0 * got.std, "{got:?}");
    assert!((found.spike_time.unwrap() / SPIKE_TIME - 1.0).abs() < 0.4, "{:?}", found.spike_time);
}

#[test]
fn what_is_not_modelled_widens_the_uncertainty() {
    let machine = Machine { noise: 0.1e-3, ..Machine::default() };
    let mut circles = machine.circles(&BOTH, 2000.0, 3);
    for s in &mut circles.samples {
        s.deviation += 0.002 * (7.0 * s.angle).sin();
    }
    let found = analyse(&circles, &REQUEST).unwrap();
    let factor = found.notes.iter().find_map(|n| match n {
        Note::NotWhite { factor } => Some(*factor),
        _ => None,
    });
    assert!(factor.unwrap() > 3.0, "{:?}", found.notes);
    let seventh = found.harmonics.iter().find(|h| h.order == 7).unwrap();
    assert!((1.7e-3..2.05e-3).contains(&seventh.residual), "{seventh:?}");
    // a shape of place is the same in both directions: it cannot feign lost motion, but squareness
    let backlash = found.value(Effect::Backlash(0), Some(End::Positive)).unwrap();
    let square = found.value(Effect::Squareness, None).unwrap();
    assert!(backlash.std < 0.2e-3 && square.std * R > 0.1e-3, "{backlash:?} {square:?}");
    assert!(backlash.value.abs() < 4.0 * backlash.std, "{backlash:?}");
}

#[test]
fn a_length_that_is_hardly_known_leaves_the_mismatch_of_the_scales() {
    let mut machine = all();
    machine.scale = [60e-6, 10e-6];
    let xy = analyse(&machine.circles(&BOTH, 3000.0, 1), &REQUEST).unwrap();
    let scale_of = |xy: &Analysis, length_std: Option<f64>, name: &str| {
        let found = assemble(core::slice::from_ref(xy), length_std).unwrap();
        let symbol = ErrorSymbol::parse(name).unwrap();
        let curve = found.into_iter().find(|e| e.symbol == symbol).unwrap().curve;
        // a whole number of pitches apart, both directions
        let [low, high] = [-1.0, 1.0].map(|sign| {
            let at = |travel| curve.value(CENTRE[usize::from(name == "eyy")] + sign * 5.0 * PITCH, travel);
            (at(Travel::Forward) + at(Travel::Reverse)) / 2.0
        });
        (high - low) / (10.0 * PITCH)
    };
    let scale = |length_std, name| scale_of(&xy, length_std, name);
    for length_std in [None, Some(0.0002), Some(0.0025), Some(1.0)] {
        let [x, y] = ["exx", "eyy"].map(|name| scale(length_std, name));
        assert!((x - y - 50e-6).abs() < 1e-6, "{length_std:?}: {x} {y}");
        let mean = if length_std.is_some_and(|s| s < 0.1) { 35e-6 - 0.001 / R } else { 0.0 };
        assert!(((x + y) / 2.0 - mean).abs() < 1e-6, "{length_std:?}: {x} {y}");
    }
    // a mismatch that may be chance is no scale, unless the mean of the two is known
    let mut weak = xy.clone();
    weak.estimates
        .iter_mut()
        .filter(|e| e.effect == Effect::ScaleMismatch)
        .for_each(|e| e.significant = false);
    for name in ["exx", "eyy"] {
        assert!(scale_of(&weak, None, name).abs() < 1e-9);
        assert!((scale_of(&weak, Some(0.0002), name) - scale(Some(0.0002), name)).abs() < 1e-12);
    }
}

#[test]
fn the_model_gets_what_it_can_hold() {
    let machine = all();
    let xy = analyse(&machine.circles(&BOTH, 3000.0, 1), &REQUEST).unwrap();
    let found = assemble(core::slice::from_ref(&xy), Some(0.0005)).unwrap();
    let of = |name: &str| {
        let symbol = ErrorSymbol::parse(name).unwrap();
        found.iter().find(|e| e.symbol == symbol).unwrap_or_else(|| panic!("{name}"))
    };
    assert!(matches!(of("ec0y").curve, Curve::Constant(c) if (c - 45e-6).abs() < 1e-7));
    let half = of("eyx").curve.value(CENTRE[0] + R / 2.0, Travel::Forward);
    assert!((half - 0.0035 * 0.75).abs() < 2e-5, "{half}");
    for (sense, travel) in [(1.0, Travel::Forward), (-1.0, Travel::Reverse)] {
        let x = 90.0;
        let screw = core::f64::consts::TAU * (CENTRE[0] + x) / PITCH;
        let share = (x / R + 1.0) / 2.0;
        // the instrument is 1 um too long: a scale of 1e-3/150 too little
        let truth = (machine.scale[0] - 0.001 / R) * x + 0.0006 * (screw + 0.4).sin()
            - sense * (share * 0.006 + (1.0 - share) * 0.004) / 2.0;
        let got = of("exx").curve.value(CENTRE[0] + x, travel);
        assert!((got - truth).abs() < 1e-4, "{got} for {truth}");
    }
    // the plane ZX turns the sign: above 90 deg is minus for B0Z
    let zx = Analysis { plane: Plane::Zx, ..xy.clone() };
    let both = assemble(&[xy, zx], None).unwrap();
    let b0z = both.iter().find(|e| e.symbol == ErrorSymbol::parse("eb0z").unwrap()).unwrap();
    assert!(matches!(b0z.curve, Curve::Constant(c) if (c + 45e-6).abs() < 1e-7));
    let exx = both.iter().find(|e| e.symbol == ErrorSymbol::parse("exx").unwrap()).unwrap();
    assert!(exx.disagreement.is_some(), "X was seen in two planes");
}

#[test]
fn a_bump_of_the_guideway_at_the_reversal_is_no_spike() {
    let machine = Machine { noise: 0.1e-3, ..Machine::default() };
    let mut circles = machine.circles(&BOTH, 2000.0, 3);
    for s in &mut circles.samples {
        let from_end =
            (s.angle + core::f64::consts::PI).rem_euclid(core::f64::consts::TAU) - core::f64::consts::PI;
        s.deviation += 0.003 * (-(from_end / 0.03).powi(2)).exp();
    }
    let found = analyse(&circles, &Request { spike_time: None, ..REQUEST }).unwrap();
    let spike = found.value(Effect::ReversalSpike(0), Some(End::Positive)).unwrap();
    assert!(spike.value.abs() < 0.3e-3, "{spike:?}");
}

#[test]
fn coarse_readings_show_no_spike_that_is_shorter_than_their_distance() {
    let machine = Machine { noise: 0.1e-3, ..Machine { spike: [[0.0; 2]; 2], ..all() } };
    let coarse = machine.circles(&BOTH, 120.0, 1);
    for spike_time in [None, Some(1e-4)] {
        let found = analyse(&coarse, &Request { spike_time, pitch: [Pitch::None; 2] }).unwrap();
        for axis in 0..2 {
            let effect = Effect::ReversalSpike(axis);
            let named = found.missing.iter().any(|(e, _)| *e == effect);
            assert!(named || found.estimate(effect).is_some(), "{spike_time:?}");
            assert!(found.estimate(effect).is_none_or(|e| e.values.iter().all(|v| v.std.is_finite())));
        }
    }
}

#[test]
fn what_is_no_circle_is_refused() {
    let good = all().circles(&BOTH, 400.0, 1);
    let with = |f: &dyn Fn(&mut Circles)| {
        let mut circles = good.clone();
        f(&mut circles);
        analyse(&circles, &REQUEST).unwrap_err()
    };
    assert!(matches!(with(&|c| c.samples.truncate(100)), BallbarError::TooFewReadings { found: 100, .. }));
    assert!(matches!(with(&|c| c.samples[3].deviation = f64::NAN), BallbarError::NotFinite { row: 4, .. }));
    assert!(matches!(with(&|c| c.radius = 0.15), BallbarError::Radius { .. }));
    assert!(matches!(with(&|c| c.samples[5].feed = None), BallbarError::FeedMissing { .. }));
    assert!(matches!(with(&|c| c.samples[5].feed = Some(0.0)), BallbarError::NotPositive { .. }));
    let short = all().circles(&[(0.0, 60.0, 1.0, 50.0)], 3000.0, 1);
    assert!(matches!(analyse(&short, &REQUEST), Err(BallbarError::ArcTooShort { .. })));
    let pitch = Request { pitch: [Pitch::Given(0.0), Pitch::None], ..REQUEST };
    assert!(matches!(analyse(&good, &pitch), Err(BallbarError::NotPositive { .. })));
}
