use super::super::catalogue::CATALOGUE;
use super::super::{FormulaTruth, Measurement, files, measure};

fn measured(name: &str, subject: &str, size_um: f64) -> Measurement {
    measure(&FormulaTruth::perfect(11).only(name, subject, size_um), 7).unwrap()
}

/// The instrument whose rows show an effect best, where not all do.
fn seen_by(name: &str) -> &'static [&'static str] {
    match name {
        "load" | "outside-creep" => &["load"],
        "tracker-scale" | "range-noise" | "spindle-tilt" | "tool-length" => &["tracker"],
        "dead-path" => &["laser", "laser-flight"],
        "spindle-growth" => &["probe"],
        "outside-spindle-whirl" => &["probe"],
        "latency" | "servo-mismatch" => &["dynamic", "laser-flight"],
        "reversal-spike" => &["ballbar"],
        "inertial" | "inertial-cross" | "outside-ringing" => &["dynamic"],
        "rotary-location" | "rotary-motion" | "rotary-eccentricity" | "outside-unbalance" => &["rtest"],
        _ => &[],
    }
}

#[test]
fn every_effect_moves_its_rows_and_none_without_a_size() {
    for entry in CATALOGUE {
        for subject in entry.subjects {
            let m = measured(entry.name, subject, 2.0);
            let of = seen_by(entry.name);
            let largest = |inside: bool| {
                m.rows
                    .iter()
                    .zip(&m.readings)
                    .filter(|(r, _)| of.is_empty() || of.contains(&r.instrument) == inside)
                    .map(|(_, d)| d.effects_um.abs())
                    .fold(0.0, f64::max)
            };
            assert!(
                largest(true) > 0.4 && largest(true) < 200.0,
                "{}:{subject} {}",
                entry.name,
                largest(true)
            );
            let none = measured(entry.name, subject, 0.0);
            assert!(none.readings.iter().all(|d| d.effects_um == 0.0), "{}:{subject}", entry.name);
        }
    }
}

#[test]
fn the_same_seed_gives_the_same_bytes_and_another_day_does_not() {
    let truth = FormulaTruth { hard: true, ..FormulaTruth::perfect(3) }.only("backlash", "y", 3.0);
    let text = |day: u64| {
        let m = measure(&truth, day).unwrap();
        let mut all = files::sessions(&m);
        all.push(files::history(&m));
        all
    };
    assert_eq!(text(5), text(5));
    assert_ne!(text(5)[0], text(6)[0]);
}

#[test]
fn effects_have_the_signs_of_the_conventions() {
    let law = |name: &str, subject: &str| measured(name, subject, 3.0);
    let check = |m: &Measurement, holds: &dyn Fn(&super::Row, f64) -> bool| {
        for (r, d) in m.rows.iter().zip(&m.readings) {
            assert!(holds(r, d.effects_um), "{r:?} {d:?}");
        }
    };
    // Y turned about +Z by 10 urad: d_x = -angle y; a longer grating: away from zero
    check(&law("squareness", "xy"), &|r, d| (d + 0.01 * r.position[1] * r.u[0]).abs() < 0.01);
    check(&law("scale", "z"), &|r, d| (d - 0.015 * r.position[2] * r.u[2]).abs() < 1e-9);
    // a longer tool reaches further down
    check(&law("tool-length", ""), &|r, d| (d + 0.03 * r.tool_mm * r.u[2]).abs() < 1e-9);
    // late: behind the way it goes
    check(&law("servo-mismatch", "x"), &|r, d| d * r.speed[0] * r.u[0] <= 0.0);
}

#[test]
fn an_angular_error_is_zero_at_home_and_nothing_turns_at_zero() {
    for (name, subject) in
        [("angular", "eay"), ("angular", "ebx"), ("rotary-location", "a"), ("rotary-eccentricity", "c")]
    {
        let mut m = measured(name, subject, 3.0);
        let world = super::World { rows: &m.rows, heat: &m.heat, day: 7 };
        let truth = FormulaTruth::perfect(11).only(name, subject, 3.0);
        let laws = super::all(&truth, &world).unwrap();
        let mut home = m.rows.swap_remove(0);
        (home.position, home.turn) = ([0.0; 3], [0.0; 2]);
        assert!(laws[0](&home).norm() < 1e-9, "{name}:{subject}");
    }
}

#[test]
fn an_unknown_effect_is_refused() {
    for (name, subject) in [("nothing", ""), ("backlash", "q"), ("sag", "z")] {
        let message = measure(&FormulaTruth::perfect(1).only(name, subject, 1.0), 1).unwrap_err().to_string();
        assert!(message.contains(name), "{message}");
    }
}
