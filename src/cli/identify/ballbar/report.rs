//! What `volcomp identify ballbar` says: JSON with the names and units of ballbar result files, a table for people.

use super::{Plan, reading};
use crate::prelude::*;
use volcomp_evaluate::circular::CircularError;
use volcomp_evaluate::{CircularReading, Circularity};
use volcomp_identify::ballbar::{
    Effect, End, Estimate, Feature, Harmonic, LengthChange, Note, Plane, Reason, Sample,
};

/// Circular errors at one feed, ISO 230-4: of the readings, and of what no effect explains.
pub(crate) struct Circle {
    /// Path speed in mm/min, where stated.
    pub(crate) feed: Option<f64>,
    pub(crate) readings: Vec<CircularReading>,
    pub(crate) result: Circularity,
    residual: Option<Circularity>,
}

impl Circle {
    /// ` at 1000 mm/min`; nothing where the feed is not stated.
    pub(crate) fn at_feed(&self) -> String {
        self.feed.map_or_else(String::new, |f| format!(" at {f:.0} mm/min"))
    }

    /// Circular error of what no effect explains, um, as text.
    pub(crate) fn unexplained(&self) -> String {
        or_dash(self.residual.as_ref().map(|c| um_from_mm(c.widest())), 2)
    }
}

/// The circles of a test by their feeds, slowest first, about the centre that the causes were fitted with: an arc cannot be centred.
pub(crate) fn circles(plan: &Plan) -> Result<Vec<Circle>, CircularError> {
    let mut feeds: Vec<Option<f64>> = plan.circles.samples.iter().map(|s| s.feed).collect();
    feeds.sort_by(|a, b| a.unwrap_or(0.0).total_cmp(&b.unwrap_or(0.0)));
    feeds.dedup();
    let offset = plan.analysis.offset.map(|(v, _)| v);
    let one = |feed: Option<f64>| {
        let of = |samples: &[Sample]| -> Vec<CircularReading> {
            samples.iter().filter(|s| s.feed == feed).map(reading).collect()
        };
        let (readings, left) = (of(&plan.circles.samples), of(&plan.analysis.residuals));
        let result = Circularity::about(&readings, plan.circles.radius, offset)?;
        let residual = Circularity::about(&left, plan.circles.radius, [0.0; 2]).ok();
        // mm/s in the analysis, mm/min for people, without the rounding of the way there and back
        Ok(Circle { feed: feed.map(|f| (60e6 * f).round() / 1e6), readings, result, residual })
    };
    feeds.into_iter().map(one).collect()
}

/// Circularity of all readings together, whatever their feeds, and of what no effect explains.
fn pooled(plan: &Plan) -> [Option<Circularity>; 2] {
    let of = |samples: &[Sample], offset: [f64; 2]| {
        let readings: Vec<CircularReading> = samples.iter().map(reading).collect();
        Circularity::about(&readings, plan.circles.radius, offset).ok()
    };
    let offset = plan.analysis.offset.map(|(v, _)| v);
    [of(&plan.circles.samples, offset), of(&plan.analysis.residuals, [0.0; 2])]
}

pub(crate) fn note_text(note: &Note) -> String {
    match note {
        Note::OneDirection => "one direction only: servo mismatch and squareness are confounded; run both".into(),
        Note::OneFeed => "one feed: the servo mismatch is all of its shape that changes sign with the direction, lag or not; a second feed tells".into(),
        Note::NoFeed => "no feed: the servo mismatch has no value in ms; give --feed-mm-per-min".into(),
        Note::NotWhite { factor } => format!("residuals are autocorrelated along the circle: uncertainties are up to {factor:.1} times wider than from white noise"),
        Note::LengthChange(change) => length_text(change),
        Note::Arc { covered } => format!("the readings cover {:.0} deg; what happens on the rest of the circle is unknown", deg_from_rad(*covered)),
    }
}

fn length_text(change: &LengthChange) -> String {
    let (value, u, p) = (plain(um_from_mm(change.value), 2), um_from_mm(2.0 * change.std), change.p_value);
    let p = if p < 0.01 { small(p) } else { format!("{p:.2}") };
    let found =
        format!("the length of the bar changes by {value} um during the runs, U {u:.2} um (k = 2), p {p}");
    if change.is_subtracted {
        format!(
            "{found}: subtracted, with a step between runs; let bar and machine come to the temperature of the room, and repeat"
        )
    } else {
        format!("{found}: not significant, not subtracted")
    }
}

pub(crate) fn reason_text(reason: &Reason, plane: Plane) -> String {
    match reason {
        Reason::LooksLike(others) if others.is_empty() => {
            "looks like the circle's centre and radius in these data".into()
        }
        Reason::LooksLike(others) => {
            let names = others.iter().map(|e| e.name(plane)).joined(" and ");
            format!("confounded with {names} in these data")
        }
        Reason::NoReversal(None) => {
            "shows at reversals that the path does not have, or between the readings".into()
        }
        Reason::NoReversal(Some(end)) => {
            let end = if *end == End::Positive { "positive" } else { "negative" };
            format!("unknown at the {end} end of travel: the path does not have that reversal")
        }
        Reason::NoPitch { limit } => {
            format!("no pitch stands out; {:.2} um peak to peak would have been seen", um_from_mm(*limit))
        }
    }
}

/// One plane for machines.
pub(crate) fn as_json(plan: &Plan, length_std_um: Option<f64>) -> Value {
    let (a, um, [measured, residual]) = (&plan.analysis, um_from_mm, pooled(plan));
    let g = |f: fn(&Circularity) -> Option<f64>| measured.as_ref().and_then(f).map(um);
    let circle = |c: &Circle| {
        json!({
            "feed_mm_per_min": c.feed,
            "circularity_um": um(c.result.widest()),
            "circularity_fwd_um": c.result.g_forward.map(um),
            "circularity_bwd_um": c.result.g_backward.map(um),
            "residual_circularity_um": c.residual.as_ref().map(|c| um(c.widest())),
        })
    };
    let name = |e: Effect| e.name(a.plane);
    let mut all = json!({});
    let own = a.estimates.iter().flat_map(|e| a.features(e));
    for f in own.chain(a.scale_features(length_std_um.map(mm_from_um))) {
        all[f.name] = json!({"value": f.value, "std": f.std, "dt": f.unit, "unit": f.unit_in_words()});
    }
    if let Some(c) = &measured {
        all["AF_CIRCULARITY"] = json!({"value": um(c.widest()), "dt": "UT_LENGTH_UM", "unit": "um"});
    }
    let confounded = |e: &Estimate| -> Value {
        let one = |(other, c): &(Effect, f64)| json!({"effect": name(*other), "correlation": c});
        e.confounded.iter().map(one).collect()
    };
    let ranked = |(i, e): (usize, &Estimate)| {
        json!({
            "rank": i + 1,
            "effect": name(e.effect),
            "contribution_um": um(e.contribution),
            "std_um": um(e.contribution_std),
            "share_percent": 100.0 * e.share,
            "significant": e.significant,
            "confounded_with": confounded(e),
        })
    };
    let missing = |(e, r): &(Effect, Reason)| json!({"effect": name(*e), "reason": reason_text(r, a.plane)});
    let radius = |(feed, value, std): &(Option<f64>, f64, f64)| json!({"feed_mm_per_min": feed.map(|f| f * 60.0), "value_um": um(*value), "std_um": um(*std)});
    let wave = |h: &Harmonic| json!({"order": h.order, "measured_um": um(h.measured), "residual_um": um(h.residual)});
    let spike_ms = a.spike_time.filter(|_| !a.notes.contains(&Note::NoFeed)).map(|t| 1e3 * t);
    json!({
        "plane": a.plane.name(),
        "radius_mm": a.radius,
        "readings": plan.circles.samples.len(),
        "centre_um": a.offset.map(|(v, _)| um(v)),
        "centre_std_um": a.offset.map(|(_, s)| um(s)),
        "radius_deviation": a.radius_deviation.iter().map(radius).collect::<Vec<_>>(),
        "circles": circles(plan).unwrap_or_default().iter().map(circle).collect::<Vec<_>>(),
        "circularity_um": measured.as_ref().map(|c| um(c.widest())),
        "circularity_fwd_um": g(|c| c.g_forward),
        "circularity_bwd_um": g(|c| c.g_backward),
        "residual_circularity_um": residual.as_ref().map(|c| um(c.widest())),
        "residual_rms_um": um(a.sigma),
        "length_change": a.length_change.map(|c| json!({
            "value_um": um(c.value),
            "std_um": um(c.std),
            "p_value": c.p_value,
            "subtracted": c.is_subtracted,
        })),
        "features": all,
        "ranking": a.estimates.iter().enumerate().map(ranked).collect::<Vec<_>>(),
        "not_determined": a.missing.iter().map(missing).collect::<Vec<_>>(),
        "pitch_mm": a.pitch,
        "spike_ms": spike_ms,
        "harmonics": a.harmonics.iter().map(wave).collect::<Vec<_>>(),
        "condition": a.condition,
        "notes": a.notes.iter().map(note_text).collect::<Vec<_>>(),
    })
}

/// One plane for people.
pub(crate) fn print(plan: &Plan) {
    let (a, um) = (&plan.analysis, um_from_mm);
    let name = |e: Effect| e.name(a.plane);
    say!("plane {}, radius {} mm: {}", a.plane, a.radius, counted(plan.circles.samples.len(), "reading"));
    for c in circles(plan).unwrap_or_default() {
        let (at, unexplained, g) = (c.at_feed(), c.unexplained(), &c.result);
        let [both, left, right] =
            [Some(g.widest()), g.g_forward, g.g_backward].map(|v| or_dash(v.map(um), 2));
        say!(
            "bidirectional circular error G(b){at} {both} µm (G counter-clockwise {left}, clockwise {right}); {unexplained} µm without the effects below"
        );
    }
    let [x, y] = a.offset.map(|(v, std)| with_limits(um(v), um(std)));
    say!("centre offset {x} and {y} µm; residual {:.3} µm RMS", um(a.sigma));
    let rows = a.estimates.iter().enumerate().map(|(i, e)| {
        let values = a.features(e).iter().map(value_text).joined(", ");
        let adds = with_limits(um(e.contribution), um(e.contribution_std));
        let mark = if e.significant { "" } else { "not significant" };
        let share = format!("{:.1} %", 100.0 * e.share);
        [(i + 1).to_string(), name(e.effect), adds, share, values, mark.to_owned()]
    });
    Table::new([">rank", "effect", ">adds / µm", ">share", "value", ""]).rows(rows).print();
    say!("± expanded uncertainty, k = 2; share: of what all effects add to the circle");
    for (one, other, c) in a.confounded() {
        note!("note: {} and {} are strongly correlated ({c:.2})", name(one), name(other));
    }
    for (effect, reason) in &a.missing {
        note!("note: {}: {}", name(*effect), reason_text(reason, a.plane));
    }
    for n in &a.notes {
        note!("note: {}", note_text(n));
    }
    let loud = a.harmonics.iter().filter(|h| h.residual > a.sigma);
    let loud = loud.map(|h| format!("{} waves per turn: {:.2} um", h.order, um(h.residual))).joined(", ");
    if !loud.is_empty() {
        note!("note: not explained by any effect: {loud}");
    }
    say!();
}

/// Coverage factor of the uncertainties of a report.
pub(crate) const COVERAGE: f64 = 2.0;

/// Decimals that show two significant figures of an uncertainty, four at most.
pub(crate) fn decimals_of(u: f64) -> usize {
    (1.0 - u.max(1e-9).log10().floor()).clamp(0.0, 4.0) as usize
}

/// A value with its expanded uncertainty.
pub(crate) fn with_limits(value: f64, std: f64) -> String {
    let u = COVERAGE * std;
    let decimals = decimals_of(u);
    format!("{} ± {u:.decimals$}", plain(value, decimals))
}

/// Unit of a value, as a person writes it.
pub(crate) fn unit_of(f: &Feature) -> String {
    micro(f.unit_in_words())
}

/// A value with its expanded uncertainty, its unit and the end of travel where it holds.
fn value_text(f: &Feature) -> String {
    let end = f.end().map_or_else(String::new, |end| format!("{end} "));
    format!("{end}{} {}", with_limits(f.value, f.std), unit_of(f))
}
