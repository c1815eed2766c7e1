//! Effects made by formulas written here are found again by the diagnosis, alone, in pairs and not at all.

use std::collections::BTreeMap;

use volcomp::diagnose::addition::{Addition, Evaluator};
use volcomp::diagnose::machine_state::MachineState;

use crate::support::*;

const ARCSEC_UM_PER_MM: f64 = 4.848_136_811e-3;

type Case<'a> = (&'static str, Box<dyn Fn(&State) -> [f64; 3] + 'a>);

/// Every case: the label expected, and what the machine does at about twice the noise where it shows.
fn cases(lagged: &Lagged) -> Vec<Case<'_>> {
    let poly = |s: f64| 3.0 * (2.0 * s * s - 1.0) + 2.0 * (4.0 * s * s * s - 3.0 * s);
    vec![
        ("squareness:xy", Box::new(|s: &State| [4.0 * ARCSEC_UM_PER_MM * s.p[1], 0.0, 0.0])),
        ("squareness:zx", Box::new(|s: &State| [-4.0 * ARCSEC_UM_PER_MM * s.p[2], 0.0, 0.0])),
        ("scale:y", Box::new(|s: &State| [0.0, 15e-3 * s.p[1], 0.0])),
        ("positioning:x", Box::new(move |s: &State| [poly((s.p[0] - 250.0) / 250.0), 0.0, 0.0])),
        (
            "thermal-expansion:x",
            Box::new(|s: &State| [11.5e-3 * (temperatures(s.t)[0] - 20.0) * s.p[0], 0.0, 0.0]),
        ),
        ("spindle-growth", Box::new(|s: &State| [0.0, 0.0, 2.0 * lagged.at(s.t)])),
        ("backlash:x", Box::new(|s: &State| [-2.5 * s.dir[0], 0.0, 0.0])),
        ("backlash:z", Box::new(|s: &State| [0.0, 0.0, -3.0 * s.dir[2] * (1.0 - (-s.since[2] / 0.4).exp())])),
        ("lateral-play:y", Box::new(|s: &State| [3.0 * s.dir[1], 0.0, 0.0])),
        (
            "reversal-spike:x",
            Box::new(|s: &State| {
                let on = if s.since_s[0] < 1e5 { 1.0 } else { 0.0 };
                [on * 9.0 * s.dir[0] * ((-s.since_s[0] / 0.6).exp() - (-s.since_s[0] / 0.05).exp()), 0.0, 0.0]
            }),
        ),
        (
            "cyclic:y",
            Box::new(|s: &State| [0.0, 3.0 * (std::f64::consts::TAU * s.p[1] / 20.0 + 0.7).sin(), 0.0]),
        ),
        ("servo-mismatch:x", Box::new(|s: &State| [-0.12 * s.v[0], 0.0, 0.0])),
        ("inertial:y", Box::new(|s: &State| [0.0, 0.25 * s.a[1], 0.0])),
        (
            "inertial-cross:x",
            Box::new(|s: &State| {
                let tilt = 0.15 * s.a[0] * ARCSEC_UM_PER_MM;
                [tilt * (s.p[2] - s.tool), 0.0, -tilt * s.p[0]]
            }),
        ),
        (
            "sag:y",
            Box::new(|s: &State| {
                let (l, y) = (600.0, s.p[1]);
                [0.0, 0.0, -20.0 * y * y * (3.0 * l - y) / (2.0 * l * l * l)]
            }),
        ),
        (
            "straightness:eyx",
            Box::new(|s: &State| [0.0, 4.0 * (std::f64::consts::PI * s.p[0] / 500.0).sin(), 0.0]),
        ),
        (
            "angular:eax",
            Box::new(|s: &State| {
                // roll of X turns Y, Z and the tool
                let e = 4.0 * (s.p[0] / 500.0) * ARCSEC_UM_PER_MM;
                [0.0, -e * (s.p[2] - s.tool), e * s.p[1]]
            }),
        ),
        (
            "spindle-tilt",
            Box::new(|s: &State| [30.0 * ARCSEC_UM_PER_MM * s.tool, -20.0 * ARCSEC_UM_PER_MM * s.tool, 0.0]),
        ),
        ("tool-length", Box::new(|s: &State| [0.0, 0.0, 0.08 * s.tool])),
        (
            "tracker-scale",
            Box::new(|s: &State| {
                if s.instrument != "tracker" {
                    return [0.0; 3];
                }
                [0, 1, 2].map(|i| 15e-3 * (s.p[i] - s.station[i]))
            }),
        ),
        (
            "rotary-location:c",
            Box::new(|s: &State| {
                // the axis stands off by (4, -3) um: the ball describes a shifted circle
                let off = [4.0, -3.0, 0.0];
                let back = turned(off, -s.c);
                [-(off[0] - back[0]), -(off[1] - back[1]), 0.0]
            }),
        ),
        (
            "rotary-motion:c",
            Box::new(|s: &State| [0.0, 0.0, 3.0 * (2.0 * s.c).sin() + 2.0 * ((3.0 * s.c).cos() - 1.0)]),
        ),
        ("load:y", Box::new(|s: &State| [0.0, 4e-3 * s.force[1], 0.0])),
        ("wear:x", Box::new(|s: &State| [8.0 * (-0.5 * ((s.p[0] - 180.0) / 22.0).powi(2)).exp(), 0.0, 0.0])),
    ]
}

#[test]
fn each_effect_is_named_alone() {
    let campaign = Campaign::full();
    let lagged = Lagged::of_the_campaign();
    let mut wrong = Vec::new();
    for (label, truth) in cases(&lagged) {
        let d = run(&campaign, &*truth, NOISE, &[]);
        let named = declared(&d.report);
        if named != [label] {
            wrong.push(format!("{label}: {named:?}\n{}", table(&d.report)));
        }
    }
    assert!(wrong.is_empty(), "{} wrong\n{}", wrong.len(), wrong.join("\n"));
}

#[test]
fn nothing_is_found_in_noise() {
    let campaign = Campaign::full();
    for seed in 1..4 {
        let d = run(&campaign, &|_| [0.0; 3], Noise { seed, ..NOISE }, &[]);
        assert!(
            d.report.verdict == volcomp::diagnose::report::Verdict::NoGap && declared(&d.report).is_empty(),
            "{}",
            table(&d.report)
        );
    }
}

#[test]
fn two_effects_are_both_named() {
    let campaign = Campaign::full();
    let lagged = Lagged::of_the_campaign();
    let all = cases(&lagged);
    let of = |label: &str| &all.iter().find(|c| c.0 == label).unwrap().1;
    for (a, b) in
        [("backlash:x", "squareness:xy"), ("servo-mismatch:x", "scale:y"), ("spindle-growth", "cyclic:y")]
    {
        let (first, second) = (of(a), of(b));
        let truth = |s: &State| {
            let (p, q) = (first(s), second(s));
            [p[0] + q[0], p[1] + q[1], p[2] + q[2]]
        };
        let d = run(&campaign, &truth, NOISE, &[]);
        let mut named = declared(&d.report);
        named.sort();
        let mut wanted = vec![a, b];
        wanted.sort_unstable();
        assert_eq!(named, wanted, "{}", table(&d.report));
    }
}

#[test]
fn the_length_of_the_ballbar_hides_no_cause_of_a_campaign() {
    let campaign = Campaign::full();
    let lagged = Lagged::of_the_campaign();
    let all = cases(&lagged);
    let of = |label: &str| &all.iter().find(|c| c.0 == label).unwrap().1;
    let (first, second) = (of("backlash:x"), of("squareness:xy"));
    for length_um in [20.0, 60.0] {
        let truth = |s: &State| {
            let (p, q) = (first(s), second(s));
            let length = if s.instrument == "ballbar" { length_um } else { 0.0 };
            core::array::from_fn(|k| p[k] + q[k] + length * s.u[k])
        };
        let d = run(&campaign, &truth, NOISE, &[]);
        let mut named = declared(&d.report);
        named.sort();
        let all = ["backlash:x", "ballbar-length", "squareness:xy"];
        assert_eq!(named, all, "{length_um}: {}", table(&d.report));
        let length = d.report.causes.iter().find(|c| c.effect == "ballbar-length").unwrap();
        let found_um = length.parameters["length_error_um"].value;
        assert!((found_um - length_um).abs() < 2.0, "{found_um}");
        assert!(d.report.shrink.fraction > 0.8, "{}", d.report.shrink.fraction);
    }
}

/// No carriage turns about the zero of the axes: what a pivot elsewhere adds is no straightness.
#[test]
fn an_angular_error_about_a_guideway_is_one_effect() {
    for pivot in [[120.0, -500.0], [-80.0, 350.0]] {
        let roll = |s: &State| {
            let x = s.p[0] / 500.0;
            let e = (5.0 * x - 7.0 * x * x) * ARCSEC_UM_PER_MM;
            [0.0, -e * (s.p[2] - s.tool - pivot[1]), e * (s.p[1] - pivot[0])]
        };
        let d = run(&Campaign::full(), &roll, NOISE, &[]);
        assert_eq!(declared(&d.report), ["angular:eax"], "{}", table(&d.report));
    }
}

/// A bar is set to zero, and is warmer, at each mounting.
#[test]
fn a_length_of_the_ballbar_for_each_mounting_hides_no_cause() {
    let lagged = Lagged::of_the_campaign();
    let all = cases(&lagged);
    let backlash = &all.iter().find(|c| c.0 == "backlash:x").unwrap().1;
    let truth = |s: &State| {
        let length = if s.instrument == "ballbar" { 9.0 * (s.setup as f64 * 2.4).sin() } else { 0.0 };
        let p = backlash(s);
        core::array::from_fn(|k| p[k] + length * s.u[k])
    };
    let d = run(&Campaign::full(), &truth, NOISE, &[]);
    let mut named = declared(&d.report);
    named.sort();
    assert_eq!(named, ["backlash:x", "ballbar-length"], "{}", table(&d.report));
    let length = d.report.causes.iter().find(|c| c.effect == "ballbar-length").unwrap();
    assert!(length.parameters.len() > 1, "one for each set-up: {:?}", length.parameters);
}

/// A display that truncates makes every reading too small by half a step in the mean, and so does a bar of another length.
#[test]
fn a_length_of_half_a_step_is_not_separable_from_truncation() {
    let lagged = Lagged::of_the_campaign();
    let all = cases(&lagged);
    let backlash = &all.iter().find(|c| c.0 == "backlash:x").unwrap().1;
    for (length_um, is_truncation) in [(0.0, true), (-8.0, false)] {
        let mut s = session(&Campaign::full(), backlash, NOISE);
        let step_um = 4.0;
        for (r, _) in s.readings.iter_mut().zip(&s.moments).filter(|(_, m)| m.is_ballbar) {
            r.deviation_um = ((r.deviation_um + length_um) / step_um).floor() * step_um;
        }
        let report =
            volcomp::diagnose::diagnose(&mut s, None, &volcomp::diagnose::Options::default(), &mut |_, _| {})
                .report;
        let length = report.causes.iter().find(|c| c.effect == "ballbar-length" && c.declared);
        let length = length.unwrap_or_else(|| panic!("{}", table(&report)));
        let instead = length.confounded_with.contains(&"quantisation".to_owned());
        assert_eq!(instead, is_truncation, "{length_um}: {}", table(&report));
    }
}

#[test]
fn an_effect_that_varies_over_the_volume_is_one_effect() {
    let campaign = Campaign::full();
    let lagged = Lagged::of_the_campaign();
    let all = cases(&lagged);
    // three times as large as elsewhere, so that a fifth of it is far above the noise
    for label in ["squareness:xy", "backlash:x", "inertial:y"] {
        let same = &all.iter().find(|c| c.0 == label).unwrap().1;
        let varying = |s: &State| {
            let factor = 3.0 * (1.0 + 0.2 * ((s.p[0] - 2.0 * s.p[1] + s.p[2]) / 170.0).sin());
            same(s).map(|d| factor * d)
        };
        let d = run(&campaign, &varying, NOISE, &[]);
        assert_eq!(declared(&d.report), [label], "{}", table(&d.report));
        let tests = d.report.causes.iter().find(|c| c.declared).and_then(|c| c.tests).unwrap();
        assert!((0.06..0.35).contains(&tests.varies), "{label}: {}", tests.varies);
        let d = run(&campaign, &|s| same(s).map(|d| 3.0 * d), NOISE, &[]);
        let tests = d.report.causes.iter().find(|c| c.declared).and_then(|c| c.tests).unwrap();
        assert!(tests.varies < 0.03, "{label}: {}", tests.varies);
    }
}

#[test]
fn the_unseen_zero_of_a_curve_that_varies_is_no_squareness() {
    // its mean over the travel is 25 um, which every mounting hides; what varies of it does not hide
    let varying = |s: &State| {
        let curve = 25.0 + 12.0 * (s.p[2] / 70.0).sin();
        [0.0, curve * (1.0 + 0.15 * ((s.p[0] - 0.6 * s.p[1] + 40.0) / 210.0).sin()), 0.0]
    };
    let d = run(&Campaign::full(), &varying, NOISE, &[]);
    assert_eq!(declared(&d.report), ["straightness:eyz"], "{}", table(&d.report));
}

#[test]
fn a_curve_that_comes_with_the_warmth_is_no_positioning_error() {
    // flat in the morning
    let bend = |s: &State| {
        let along = (s.p[0] - 220.0) / 200.0;
        [3.0 * (temperatures(s.t)[0] - 20.6) * along * along, 0.0, 0.0]
    };
    let d = run(&Campaign::full(), &bend, NOISE, &[]);
    assert!(declared(&d.report).is_empty(), "{}", table(&d.report));
    assert!(d.report.unexplained.significant, "{}", table(&d.report));
}

#[test]
fn a_worn_place_ends_and_a_wide_hill_is_a_table_of_positions() {
    let campaign = Campaign::full();
    let worn = |s: &State| {
        let way = (s.p[0] - 190.0) / 55.0;
        [14.0 * (1.0 - way * way).max(0.0).powi(2), 0.0, 0.0]
    };
    let hill = |s: &State| {
        let way: f64 = (s.p[0] - 230.0) / 210.0;
        [7.0 * (1.0 - way * way).max(0.0).powi(2), 0.0, 0.0]
    };
    let d = run(&campaign, &worn, NOISE, &[]);
    assert_eq!(declared(&d.report), ["wear:x"], "{}", table(&d.report));
    let d = run(&campaign, &hill, NOISE, &[]);
    assert_eq!(declared(&d.report), ["positioning:x"], "{}", table(&d.report));
}

#[test]
fn a_test_of_minutes_says_nothing_of_the_warmth_of_a_day() {
    let campaign = Campaign::full();
    let rtest = |s: &&State| s.instrument == "rtest";
    let [from, to] = campaign
        .states
        .iter()
        .filter(rtest)
        .fold([f64::INFINITY, 0.0], |[l, h]: [f64; 2], s| [l.min(s.t), h.max(s.t)]);
    // a little larger at its end than at its beginning, as nothing is quite the same twice
    let lifts = |s: &State| {
        let more = if s.instrument == "rtest" { 0.2 * (s.t - from) / (to - from) } else { 0.0 };
        [0.0, 0.0, 9.0 * (2.0 * s.c).sin() * (1.0 + more)]
    };
    let d = run(&campaign, &lifts, NOISE, &[]);
    assert_eq!(declared(&d.report), ["rotary-motion:c"], "{}", table(&d.report));
}

/// Instrument, setup and direction of sensitivity.
type Mounting<'a> = (&'a str, i64, [i64; 3]);

/// Share of what the machine does (sum of squares, without the offset of each setup along each direction) that the effects of an
/// addition express, at the rows where the table stands at zero.
fn expressed(campaign: &Campaign, truth: &dyn Fn(&State) -> [f64; 3], addition: &Addition) -> f64 {
    let mut evaluator = Evaluator::new([addition]);
    let mut groups: BTreeMap<Mounting<'_>, Vec<[f64; 2]>> = BTreeMap::new();
    for s in campaign.states.iter().filter(|s| s.c == 0.0) {
        let wide = |v: [f64; 3], rest: f64| [v[0], v[1], v[2], rest, rest, rest];
        let mut m = MachineState {
            t_s: s.t,
            position: wide(s.p, 0.0),
            velocity: wide(s.v, 0.0),
            acceleration: wide(s.a, 0.0),
            direction: wide(s.dir, 1.0),
            since_mm: wide(s.since, 1e6),
            since_s: wide(s.since_s, 1e6),
            tool_length_mm: s.tool,
            force_n: s.force,
            ..MachineState::default()
        };
        let said = evaluator.next(&mut m, &[]);
        let said = [said.x, said.y, said.z];
        let true_um = truth(s);
        let along = |d: [f64; 3]| d.iter().zip(s.u).map(|(d, u)| d * u).sum::<f64>();
        let way = s.u.map(|u| (u * 1e3).round() as i64);
        groups.entry((s.instrument, s.setup, way)).or_default().push([along(true_um), along(said)]);
    }
    let (mut tt, mut ts, mut ss) = (0.0, 0.0, 0.0);
    for rows in groups.values() {
        let mean = |k: usize| rows.iter().map(|r| r[k]).sum::<f64>() / rows.len() as f64;
        let (a, b) = (mean(0), mean(1));
        for [t, said] in rows {
            tt += (t - a).powi(2);
            ts += (t - a) * (said - b);
            ss += (said - b).powi(2);
        }
    }
    if tt * ss > 0.0 { ts * ts / (tt * ss) } else { 0.0 }
}

/// Cases `range` in which the diagnosis, without the true effect in its library, declares an innocent one or no gap.
fn pinned_on_an_innocent_one(range: std::ops::RangeInclusive<&str>) -> Vec<(&'static str, String)> {
    let campaign = Campaign::full();
    let lagged = Lagged::of_the_campaign();
    let mut wrong = Vec::new();
    for (label, truth) in cases(&lagged).into_iter().filter(|(label, _)| range.contains(label)) {
        let effect = label.split_once(':').map_or(label, |(effect, _)| effect);
        let d = run(&campaign, &*truth, NOISE, &[effect]);
        let r = &d.report;
        // what says the same by another name, alone or as a sum, is no innocent: it is marked, or the columns tell
        let overlap = expressed(&campaign, &*truth, &d.addition);
        let mut innocent: Vec<String> = r
            .causes
            .iter()
            .filter(|c| c.declared && c.probability > 0.8 && overlap < 0.97)
            .filter(|c| !c.re_expression_of.iter().any(|e| e.starts_with(effect)))
            .map(|c| c.label())
            .collect();
        if !innocent.is_empty() {
            // nor is what the whole library cannot tell from it
            let whole = run(&campaign, &*truth, NOISE, &[]);
            let named = whole.report.causes.iter().find(|c| c.label() == label);
            let group = named.map(|c| c.confounded_with.clone()).unwrap_or_default();
            innocent.retain(|i| !group.contains(i));
        }
        let silent = r.verdict == volcomp::diagnose::report::Verdict::NoGap;
        if !innocent.is_empty() || silent {
            wrong.push((label, format!("{label}: {innocent:?}, overlap {overlap:.3}\n{}", table(r))));
        }
    }
    wrong
}

#[test]
fn an_effect_that_is_taken_out_is_not_pinned_on_an_innocent_one_a_to_r() {
    let wrong = pinned_on_an_innocent_one("a"..="s");
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn an_effect_that_is_taken_out_is_not_pinned_on_an_innocent_one_s_to_z() {
    let wrong = pinned_on_an_innocent_one("s"..="z");
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn one_circle_at_one_feed_answers_with_a_set() {
    // scale and compliance are one to a circle of one feed
    let truth = |s: &State| [0.0, 20e-3 * s.p[1], 0.0];
    let d = run(&Campaign::ballbar_only(), &truth, NOISE, &[]);
    let r = &d.report;
    // declared or shown: the set is the answer, and there has to be one
    let named: Vec<_> =
        r.causes.iter().filter(|c| ["scale:y", "inertial:y"].contains(&c.label().as_str())).collect();
    assert!(!named.is_empty(), "{}", table(r));
    for c in r.causes.iter().filter(|c| c.declared).chain(named) {
        let class: Vec<String> = c.confounded_with.iter().cloned().chain([c.label()]).collect();
        assert!(class.contains(&"scale:y".to_owned()), "{}", table(r));
        assert!(class.contains(&"inertial:y".to_owned()) && c.probability < 0.9, "{}", table(r));
    }
    let declared = r.causes.iter().find(|c| c.declared).unwrap();
    assert!(declared.group_probability.unwrap() > 0.95, "the set as a whole is sure: {}", table(r));
    let mut s = session(&Campaign::ballbar_only(), &truth, NOISE);
    let p = volcomp::diagnose::plan(&mut s, &[]);
    assert!(
        p.confounded
            .iter()
            .any(|c| c.contains(&"scale:y".to_owned()) && c.contains(&"inertial:y".to_owned())),
        "{:?}",
        p.confounded
    );
    assert!(p.blind_spots.iter().any(|b| b.effect == "scale:z"), "{:?}", p.blind_spots);
}

#[test]
fn what_comes_back_on_a_moving_axis_is_no_vibration() {
    // a coarse pattern that no effect knows
    let truth = |s: &State| {
        let pattern = 9.0 * (s.p[0] / 11.0).sin() * (s.p[1] / 17.0).cos() + 30.0 * (s.p[2] / 60.0).sin();
        [pattern, -0.6 * pattern, 1.3 * pattern]
    };
    let d = run(&Campaign::ballbar_only(), &truth, NOISE, &[]);
    assert!(!declared(&d.report).contains(&"vibration".to_owned()), "{}", table(&d.report));
    // the second pass of each circle is another ellipse: a wave of the circle itself, and none of time
    let warmer = |s: &State| [if s.repeat == 2 { 40e-3 * (s.p[0] - 250.0) } else { 0.0 }, 0.0, 0.0];
    let d = run(&Campaign::ballbar_only(), &warmer, NOISE, &[]);
    assert!(!declared(&d.report).contains(&"vibration".to_owned()), "{}", table(&d.report));
}

#[test]
fn an_angle_through_one_lever_is_named_as_what_cannot_be_told() {
    // the table of Y tilts; with one tool and Z where it stands that is a displacement by the position of Y
    let curve = |y: f64| 12.0 * (y / 55.0).sin();
    let d = run(&Campaign::ballbar_only(), &|s: &State| [curve(s.p[1]), 0.0, 0.0], NOISE, &[]);
    let said = d.report.causes.iter().find(|c| c.declared && c.effect == "straightness");
    let group = said.map(|c| c.confounded_with.clone()).unwrap_or_default();
    assert!(group.iter().any(|l| l.starts_with("angular:e") && l.ends_with('y')), "{}", table(&d.report));
}

#[test]
fn the_same_input_gives_the_same_answer() {
    let campaign = Campaign::ballbar_only();
    let truth = |s: &State| [-2.0 * s.dir[0], 0.0, 0.0];
    let once = || serde_json::to_string(&run(&campaign, &truth, NOISE, &[]).report).unwrap();
    assert_eq!(once(), once());
}

#[test]
fn an_addition_says_what_the_effect_does() {
    let truth = |s: &State| [-2.5 * s.dir[0], 15e-3 * s.p[1], 0.0];
    let d = run(&Campaign::full(), &truth, NOISE, &[]);
    let text = toml::to_string(&d.addition).unwrap();
    let read: Addition = toml::from_str(&text).unwrap();
    read.check().unwrap();
    assert_eq!(read, d.addition);
    let mut e = Evaluator::new([&read]);
    let mut m = MachineState {
        position: [100.0, 300.0, 0.0, 0.0, 0.0, 0.0],
        direction: [1.0; 6],
        ..MachineState::default()
    };
    m.since_mm = [1e6; 6];
    let forward = e.next(&mut m, &[]);
    m.direction[0] = -1.0;
    m.position[1] = 100.0;
    let back = e.next(&mut m, &[]);
    assert!(
        (forward.x - back.x + 5.0).abs() < 0.4 && (forward.y - back.y - 3.0).abs() < 0.3,
        "{forward} {back}"
    );
}
