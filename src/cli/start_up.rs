//! Start-up outliers of a positioning test in words: by line, with the figures of the test with and without them.

use crate::prelude::*;
use volcomp_evaluate::{Positioning, PositioningReading};
use volcomp_formats::positioning_test::PositioningTest;
pub(crate) use volcomp_formats::start_up::{Marked, StartUp, in_report_units};

/// Units of targets and deviations.
pub(crate) const fn units(kind: AxisKind) -> (&'static str, &'static str) {
    match kind {
        AxisKind::Linear => ("mm", "µm"),
        AxisKind::Rotary => ("deg", "arcsec"),
    }
}

/// A start-up outlier by its keys, with the units of targets and deviations in them.
pub(crate) fn as_json(m: &Marked, (position, value): (&str, &str)) -> Value {
    json!({
        "line": m.line,
        format!("target_{position}"): m.target,
        "direction": if m.travel == Travel::Forward { 1 } else { -1 },
        "cycle": m.cycle,
        format!("deviation_{value}"): m.deviation,
        format!("apart_{value}"): m.apart,
        format!("limit_{value}"): m.limit,
    })
}

/// A start-up outlier in a sentence.
pub(crate) fn words(m: &Marked, kind: AxisKind) -> String {
    words_in(m, units(kind))
}

/// The same with the units of targets and deviations.
pub(crate) fn words_in(m: &Marked, (length, unit): (&str, &str)) -> String {
    let way = if m.travel == Travel::Reverse { "backward" } else { "forward" };
    let (target, Marked { cycle, deviation, apart, limit, .. }) = ((m.target * 1e6).round() / 1e6, m);
    format!(
        "start-up outlier at {target} {length} {way}, cycle {cycle}: {deviation:.1} {unit}, {apart:+.1} {unit} from the median of \
         the other cycles (limit {limit:.1} {unit})"
    )
}

/// Reports the start-up outliers of a file on stderr.
pub(crate) fn report(file: &str, test: &PositioningTest) {
    let Some(start_up) = StartUp::of(test) else { return };
    for m in &start_up.marked {
        note!("warning: {file}:{}: {}", m.line, words(m, test.kind));
    }
    let all: Vec<PositioningReading> = test.readings.iter().map(|r| in_report_units(test.kind, r)).collect();
    let accuracy = |p: &Positioning| p.both.map(|b| b.a).or(p.forward.or(p.backward).map(|d| d.a));
    let (_, unit) = units(test.kind);
    let with = Positioning::evaluate(&all).ok().as_ref().and_then(accuracy);
    if let (Some(with), Some(without)) = (with, start_up.without.as_ref().and_then(accuracy)) {
        note!(
            "  kept; accuracy A {with:.1} {unit} with them, {without:.1} {unit} without; repeat the test after a warm-up"
        );
    }
}
