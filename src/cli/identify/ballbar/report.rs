//! What `volcomp identify ballbar` says: JSON with the names and units of ballbar result files, a table for people.

use serde_json::{Map, Value, json};

use super::Plan;
use crate::numerals::{counted, plain};
use volcomp_evaluate::{Centring, CircularReading, Circularity};
use volcomp_identify::ballbar::{Analysis, Effect, End, Estimate, Note, Plane, Reason, Sample};
use volcomp_units::{deg_from_rad, mm_from_um, um_from_mm};

/// A feature in the vocabulary of ballbar result files.
pub(crate) struct Feature {
    pub(crate) name: String,
    pub(crate) unit: &'static str,
    pub(crate) value: f64,
    pub(crate) std: f64,
}

/// Circularity by ISO 230-4 of the readings and of what no effect explains.
pub(crate) struct Roundness {
    pub(crate) measured: Option<Circularity>,
    pub(crate) residual: Option<Circularity>,
}

pub(crate) fn roundness(plan: &Plan) -> Roundness {
    // an arc cannot be centred by ISO 230-4: the centre found with the effects is taken out instead
    let evaluate = |deviation: &dyn Fn(usize) -> f64, [x, y]: [f64; 2]| {
        let read = |off: [f64; 2]| -> Vec<CircularReading> {
            let one = |(i, s): (usize, &Sample)| CircularReading {
                angle: s.angle,
                deviation: deviation(i) - off[0] * s.angle.cos() - off[1] * s.angle.sin(),
                travel: s.travel,
            };
            plan.circles.samples.iter().enumerate().map(one).collect()
        };
        let centred = Centring::LeastSquares { radius: Some(plan.circles.radius) };
        Circularity::evaluate(&read([0.0; 2]), centred)
            .or_else(|_| Circularity::evaluate(&read([x, y]), Centring::None))
            .ok()
    };
    let offset = plan.analysis.offset.map(|(v, _)| v);
    let measured = evaluate(&|i| plan.circles.samples[i].deviation, offset);
    Roundness { measured, residual: evaluate(&|i| plan.analysis.residuals[i], [0.0; 2]) }
}

/// The widest of a circular test.
pub(crate) fn widest(c: &Circularity) -> f64 {
    c.g_both.or(c.g_forward).or(c.g_backward).unwrap_or(0.0)
}

/// Values of an effect with name and unit.
pub(crate) fn features(a: &Analysis, e: &Estimate) -> Vec<Feature> {
    let letter = |axis: usize| if axis == 0 { "A" } else { "B" };
    let end = |end: Option<End>| match end {
        Some(End::Positive) => "_POS",
        Some(End::Negative) => "_NEG",
        None => "",
    };
    let of = |name: String, unit: &'static str, scale: f64, index: usize| {
        let v = e.values[index];
        Feature { name, unit, value: v.value * scale, std: v.std * scale }
    };
    let per_end = |name: &str, axis: usize| {
        let one = |i: usize| {
            of(format!("AF_{name}_{}{}", letter(axis), end(e.values[i].end)), "UT_LENGTH_UM", 1e3, i)
        };
        (0..e.values.len()).map(one).collect::<Vec<Feature>>()
    };
    match e.effect {
        Effect::Squareness => vec![of("AF_SQUARENESS".into(), "UT_SQUARENESS", 1e6, 0)],
        // difference of the diameters along the two axes
        Effect::ScaleMismatch => vec![of("AF_SCALE_MISMATCH".into(), "UT_LENGTH_UM", 2e3 * a.radius, 0)],
        Effect::ServoMismatch if a.notes.contains(&Note::NoFeed) => Vec::new(),
        Effect::ServoMismatch => vec![of("AF_SERVO_MISMATCH".into(), "UT_SERVO_MISMATCH", 1e3, 0)],
        Effect::Straightness(k) => vec![of(format!("AF_STRAIGHTNESS_{}", letter(k)), "UT_LENGTH_UM", 1e3, 0)],
        // one travel direction of the axis is not told from the other: the error is one of place
        Effect::Cyclic(k) => vec![of(format!("AF_CYCLIC_ERROR_{}_FWD", letter(k)), "UT_LENGTH_UM", 1e3, 0)],
        Effect::Backlash(k) => per_end("BACKLASH", k),
        Effect::LateralPlay(k) => per_end("LATERAL_PLAY", k),
        Effect::ReversalSpike(k) => per_end("REVERSAL_SPIKES", k),
    }
}

/// Scale errors of both axes in ppm, where the length of the instrument is known.
fn scale_features(a: &Analysis, length_std_um: Option<f64>) -> Vec<Feature> {
    let (Some(length), Some((_, radius, std)), Some(e)) =
        (length_std_um, a.radius_deviation.first(), a.estimate(Effect::ScaleMismatch))
    else {
        return Vec::new();
    };
    let mismatch = e.values[0];
    let mean_std = std.hypot(mm_from_um(length)) / a.radius;
    [("A", 0.5), ("B", -0.5)]
        .map(|(letter, sign)| Feature {
            name: format!("AF_SCALE_ERROR_{letter}"),
            unit: "UT_SCALE_ERROR",
            value: 1e6 * (radius / a.radius + sign * mismatch.value),
            std: 1e6 * mean_std.hypot(0.5 * mismatch.std),
        })
        .into()
}

pub(crate) fn unit_text(unit: &str) -> &'static str {
    match unit {
        "UT_SQUARENESS" => "um/m",
        "UT_SERVO_MISMATCH" => "ms",
        "UT_SCALE_ERROR" => "ppm",
        _ => "um",
    }
}

pub(crate) fn note_text(note: &Note) -> String {
    match note {
        Note::OneDirection => "one direction only: servo mismatch and squareness are confounded; run both".into(),
        Note::OneFeed => "one feed: the servo mismatch is all of its shape that changes sign with the direction, lag or not; a second feed tells".into(),
        Note::NoFeed => "no feed: the servo mismatch has no value in ms; give --feed-mm-per-min".into(),
        Note::NotWhite { factor } => format!("residuals are autocorrelated along the circle: uncertainties are up to {factor:.1} times wider than from white noise"),
        Note::Arc { covered } => format!("the readings cover {:.0} deg; what happens on the rest of the circle is unknown", deg_from_rad(*covered)),
    }
}

pub(crate) fn reason_text(reason: &Reason, plane: Plane) -> String {
    match reason {
        Reason::LooksLike(others) if others.is_empty() => {
            "looks like the circle's centre and radius in these data".into()
        }
        Reason::LooksLike(others) => {
            let names: Vec<String> = others.iter().map(|e| e.name(plane)).collect();
            format!("confounded with {} in these data", names.join(" and "))
        }
        Reason::NoReversal => {
            "shows at reversals that the path does not have, or between the readings".into()
        }
        Reason::NoPitch { limit } => {
            format!("no pitch stands out; {:.2} um peak to peak would have been seen", um_from_mm(*limit))
        }
    }
}

/// One plane for machines.
pub(crate) fn as_json(plan: &Plan, length_std_um: Option<f64>) -> Value {
    let a = &plan.analysis;
    let round = roundness(plan);
    let g = |f: &dyn Fn(&Circularity) -> Option<f64>| round.measured.as_ref().and_then(f).map(um_from_mm);
    let mut all = Map::new();
    let mut put = |f: Feature| {
        all.insert(f.name, json!({"value": f.value, "std": f.std, "dt": f.unit, "unit": unit_text(f.unit)}));
    };
    a.estimates.iter().flat_map(|e| features(a, e)).for_each(&mut put);
    scale_features(a, length_std_um).into_iter().for_each(&mut put);
    if let Some(c) = &round.measured {
        let entry = json!({"value": um_from_mm(widest(c)), "dt": "UT_LENGTH_UM", "unit": "um"});
        all.insert("AF_CIRCULARITY".to_owned(), entry);
    }
    let ranking: Vec<Value> = a
        .estimates
        .iter()
        .enumerate()
        .map(|(i, e)| {
            let confounded: Vec<Value> = e
                .confounded
                .iter()
                .map(|(other, c)| json!({"effect": other.name(a.plane), "correlation": c}))
                .collect();
            json!({
                "rank": i + 1,
                "effect": e.effect.name(a.plane),
                "contribution_um": um_from_mm(e.contribution),
                "std_um": um_from_mm(e.contribution_std),
                "share_percent": 100.0 * e.share,
                "significant": e.significant,
                "confounded_with": confounded,
            })
        })
        .collect();
    let missing: Vec<Value> = a
        .missing
        .iter()
        .map(|(e, r)| json!({"effect": e.name(a.plane), "reason": reason_text(r, a.plane)}))
        .collect();
    let radii: Vec<Value> = a
        .radius_deviation
        .iter()
        .map(|(feed, value, std)| {
            let feed = feed.map(|f| f * 60.0);
            json!({"feed_mm_per_min": feed, "value_um": um_from_mm(*value), "std_um": um_from_mm(*std)})
        })
        .collect();
    let waves: Vec<Value> = a
        .harmonics
        .iter()
        .map(|h| json!({"order": h.order, "measured_um": um_from_mm(h.measured), "residual_um": um_from_mm(h.residual)}))
        .collect();
    let spike_ms = a.spike_time.filter(|_| !a.notes.contains(&Note::NoFeed)).map(|t| 1e3 * t);
    json!({
        "plane": a.plane.name(),
        "radius_mm": a.radius,
        "readings": plan.circles.samples.len(),
        "centre_um": a.offset.map(|(v, _)| um_from_mm(v)),
        "centre_std_um": a.offset.map(|(_, s)| um_from_mm(s)),
        "radius_deviation": radii,
        "circularity_um": round.measured.as_ref().map(|c| um_from_mm(widest(c))),
        "circularity_fwd_um": g(&|c| c.g_forward),
        "circularity_bwd_um": g(&|c| c.g_backward),
        "residual_circularity_um": round.residual.as_ref().map(|c| um_from_mm(widest(c))),
        "residual_rms_um": um_from_mm(a.sigma),
        "features": all,
        "ranking": ranking,
        "not_determined": missing,
        "pitch_mm": a.pitch,
        "spike_ms": spike_ms,
        "harmonics": waves,
        "condition": a.condition,
        "notes": a.notes.iter().map(note_text).collect::<Vec<_>>(),
    })
}

/// One plane for people.
pub(crate) fn print(plan: &Plan) {
    let a = &plan.analysis;
    let round = roundness(plan);
    say!("plane {}, radius {} mm: {}", a.plane, a.radius, counted(plan.circles.samples.len(), "reading"));
    let show = |v: Option<f64>| v.map_or_else(|| "-".to_owned(), |v| format!("{:.2}", um_from_mm(v)));
    if let Some(c) = &round.measured {
        let residual = round.residual.as_ref().map(widest);
        say!(
            "circularity {} um (counter-clockwise {}, clockwise {}); {} um without the effects below",
            show(Some(widest(c))),
            show(c.g_forward),
            show(c.g_backward),
            show(residual)
        );
    }
    let [(x, sx), (y, sy)] = a.offset.map(|(v, s)| (um_from_mm(v), um_from_mm(s)));
    say!(
        "centre offset {} +- {sx:.2}, {} +- {sy:.2} um; rms left over {:.3} um",
        plain(x, 2),
        plain(y, 2),
        um_from_mm(a.sigma)
    );
    say!(
        "{:>4} {:<20}{:>12}{:>8}  {:<34}{:<6}",
        "rank",
        "effect",
        "adds/um",
        "share",
        "values (k = 1)",
        "unit"
    );
    for (i, e) in a.estimates.iter().enumerate() {
        let features = features(a, e);
        let unit = features.first().map_or("", |f| unit_text(f.unit));
        let values: Vec<String> = features.iter().map(value_text).collect();
        let mark = if e.significant { "" } else { "  not significant" };
        say!(
            "{:>4} {:<20}{:>6.2}+-{:<4.2}{:>7.1}%  {:<34}{unit:<6}{mark}",
            i + 1,
            e.effect.name(a.plane),
            um_from_mm(e.contribution),
            um_from_mm(e.contribution_std),
            100.0 * e.share,
            values.join(", ")
        );
    }
    for e in a.estimates.iter().filter(|e| !e.confounded.is_empty()) {
        let others: Vec<String> =
            e.confounded.iter().map(|(o, c)| format!("{} (correlation {c:.2})", o.name(a.plane))).collect();
        note!("note: {} is strongly correlated with {}", e.effect.name(a.plane), others.join(", "));
    }
    for (effect, reason) in &a.missing {
        note!("note: {}: {}", effect.name(a.plane), reason_text(reason, a.plane));
    }
    for n in &a.notes {
        note!("note: {}", note_text(n));
    }
    let loud: Vec<String> = a
        .harmonics
        .iter()
        .filter(|h| h.residual > a.sigma)
        .map(|h| format!("{} waves per turn: {:.2} um", h.order, um_from_mm(h.residual)))
        .collect();
    if !loud.is_empty() {
        note!("note: not explained by any effect: {}", loud.join(", "));
    }
    say!();
}

fn value_text(f: &Feature) -> String {
    let end = if f.name.ends_with("_POS") {
        "+ "
    } else if f.name.ends_with("_NEG") {
        "- "
    } else {
        ""
    };
    format!("{end}{}+-{:.3}", plain(f.value, 3), f.std)
}
