use super::*;

/// The gear of 001: z 31, m 4, 20 deg, b 30, tip diameter 132.
fn gear() -> Gear {
    Gear {
        teeth: 31,
        module_mm: 4.0,
        pressure_angle: 20f64.to_radians(),
        helix_angle: 0.0,
        face_width_mm: 30.0,
        tip_diameter_mm: 132.0,
        control_diameter_mm: 118.4,
    }
}

/// A trace over the functional length: position and deviation by the share of the length.
fn trace(direction: Direction, f: impl Fn(f64) -> f64) -> GearTrace {
    let [low, high] = gear().part(direction).functional;
    let at = |i: u32| {
        let share = f64::from(i) / 400.0;
        (low + share * (high - low), f(share))
    };
    GearTrace { direction, tooth: 1, flank: Flank::Left, readings: (0..=400).map(at).collect() }
}

#[test]
fn lengths_of_the_sample_gear() {
    let gear = gear();
    gear.check().unwrap();
    assert!((gear.base_radius_mm() - 58.260_942_5).abs() < 1e-6);
    let [from, to] = gear.part(Direction::Profile).functional;
    assert!((from - 10.502_5).abs() < 1e-3 && (to - 31.010_7).abs() < 1e-3, "{from} {to}");
    assert_eq!(gear.part(Direction::Helix).evaluation, [1.5, 28.5]);
    // a wide gear: one module at either end
    let wide = Gear { face_width_mm: 200.0, ..gear };
    assert_eq!(wide.part(Direction::Helix).evaluation, [4.0, 196.0]);
}

#[test]
fn tolerances_follow_the_formulas_and_rounding() {
    let t = |direction, quantity, class| tolerance_um(&gear(), direction, quantity, class);
    use Direction::{Helix, Profile};
    use Quantity::{Form, Slope, Total};
    // by hand: f_HaT 5.724, f_faT 7.2, F_aT 9.198; f_HbT 6.474, f_fbT 7.244, F_bT 9.716 at class 5
    for (direction, quantity, class, um) in [
        (Profile, Slope, 5, 5.5),
        (Profile, Form, 5, 7.0),
        (Profile, Total, 5, 9.0),
        (Profile, Slope, 4, 4.0),
        (Profile, Form, 4, 5.0),
        (Profile, Total, 4, 6.5),
        (Profile, Total, 8, 26.0),
        (Helix, Slope, 5, 6.5),
        (Helix, Form, 5, 7.0),
        (Helix, Total, 5, 9.5),
        (Helix, Slope, 4, 4.6),
        (Helix, Total, 4, 7.0),
        (Helix, Total, 11, 78.0),
    ] {
        assert!((t(direction, quantity, class) - um).abs() < 1e-9, "{direction:?} {quantity:?} {class}");
    }
    assert_eq!(class(&gear(), Profile, Total, 6.5), Some(4));
    assert_eq!(class(&gear(), Profile, Total, 6.6), Some(5));
    assert_eq!(class(&gear(), Profile, Slope, -4.1), Some(5));
    assert_eq!(class(&gear(), Profile, Total, 80.0), None);
}

#[test]
fn a_slope_is_extrapolated_over_the_functional_length() {
    let result = evaluate(&gear(), &trace(Direction::Profile, |s| 10.0 * s - 3.0)).unwrap();
    assert!((result.slope_um - 10.0).abs() < 1e-9, "{result:?}");
    assert!(result.form_um < 1e-9);
    // the tip zone is excess of material and counts
    assert!((result.total_um - 10.0).abs() < 1e-9);
    let relieved = evaluate(&gear(), &trace(Direction::Profile, |s| -10.0 * s)).unwrap();
    assert!((relieved.slope_um + 10.0).abs() < 1e-9);
    // here the tip zone lacks material: it does not count
    assert!((relieved.total_um - 9.5).abs() < 0.03, "{relieved:?}");
    let helix = evaluate(&gear(), &trace(Direction::Helix, |s| 6.0 * s)).unwrap();
    assert!((helix.slope_um - 6.0).abs() < 1e-9 && (helix.total_um - 5.7).abs() < 1e-9, "{helix:?}");
}

#[test]
fn a_wave_is_form_and_a_burr_in_the_end_zone_counts() {
    let wave = |s: f64| 2.0 * (std::f64::consts::TAU * 8.0 * s).sin();
    let result = evaluate(&gear(), &trace(Direction::Helix, wave)).unwrap();
    assert!((result.form_um - 4.0).abs() < 0.5 && (result.total_um - 4.0).abs() < 0.01, "{result:?}");
    assert!(result.slope_um.abs() < 0.7);
    let burr =
        |depth: f64| evaluate(&gear(), &trace(Direction::Helix, |s| if s < 0.02 { depth } else { 0.0 }));
    assert!((burr(3.0).unwrap().total_um - 3.0).abs() < 1e-9);
    assert!(burr(-3.0).unwrap().total_um.abs() < 1e-9);
}

#[test]
fn passes_are_averaged_and_slopes_keep_their_sign() {
    let line = |tooth: u32, slope: f64, noise: f64| {
        (0..=40u32).flat_map(move |i| {
            let p = f64::from(i) * 0.75;
            [noise, -noise].map(|n| (Direction::Helix, Flank::Right, tooth, p, slope * p + n))
        })
    };
    let readings: Vec<_> = line(2, 0.1, 0.5).chain(line(1, -0.1, 0.7)).collect();
    let traces = passes_averaged(&readings);
    assert_eq!(traces.iter().map(|t| t.tooth).collect::<Vec<_>>(), [1, 2]);
    let each: Vec<Deviations> = traces.iter().map(|t| evaluate(&gear(), t).unwrap()).collect();
    assert!((each[0].slope_um + 3.0).abs() < 1e-9 && each[0].form_um < 1e-9);
    assert!(mean_of(&each).unwrap().slope_um.abs() < 1e-9);
    assert!(mean_of(&each).unwrap().total_um > 2.0);
    assert!(mean_of(&[]).is_none());
}

#[test]
fn what_cannot_be_evaluated_is_refused() {
    let short = GearTrace { readings: vec![(2.0, 0.0); 4], ..trace(Direction::Helix, |_| 0.0) };
    assert!(matches!(evaluate(&gear(), &short), Err(GearError::TooFew { found: 4, .. })));
    let mut holed = trace(Direction::Helix, |_| 0.0);
    holed.readings.retain(|r| !(8.0..16.0).contains(&r.0));
    assert!(matches!(evaluate(&gear(), &holed), Err(GearError::Gap { .. })));
    let mut none = trace(Direction::Helix, |_| 0.0);
    none.readings[7].1 = f64::NAN;
    assert!(matches!(evaluate(&gear(), &none), Err(GearError::NotFinite { tooth: 1 })));
    assert!(Gear { control_diameter_mm: 114.0, ..gear() }.check().is_err(), "below the base circle");
    assert!(Gear { teeth: 4, ..gear() }.check().is_err());
    assert!(Gear { tip_diameter_mm: f64::NAN, ..gear() }.check().is_err());
}
