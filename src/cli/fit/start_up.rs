//! Start-up outliers that a fit keeps, in the words of `volcomp evaluate iso230-2`.

use super::report::Fitted;
use crate::prelude::*;
use crate::start_up::{self, Marked, words_in};
use volcomp_identify::start_up::StartUpOutlier;

/// The start-up outliers that the fit keeps, with their file, in the units of the report.
fn kept(f: &Fitted) -> Vec<(&str, Marked)> {
    let Units { of_value, of_position, .. } = Units::of(f.symbol);
    let is_kept = |o: &&StartUpOutlier| f.fit.outliers.iter().all(|out| out.index != o.reading);
    let one = |o: &StartUpOutlier| {
        let (r, (file, line)) = (&f.measured.readings[o.reading], f.measured.place(o.reading));
        let marked = Marked {
            line: u64::from(line),
            target: of_position(r.position),
            travel: r.travel,
            cycle: r.cycle,
            deviation: of_value(r.value),
            apart: of_value(o.apart),
            limit: of_value(o.limit),
        };
        (file, marked)
    };
    f.measured.start_up.iter().filter(is_kept).map(one).collect()
}

/// What to do about them; `None` where there are none.
pub(super) fn remedy(f: &Fitted) -> Option<String> {
    let kept = kept(f);
    let cycle = kept.first()?.1.cycle;
    Some(format!(
        "{} kept in the fit: leave out with --robust or without cycle {cycle} (--cycles), or repeat the test after a warm-up",
        counted(kept.len(), "start-up outlier")
    ))
}

/// The outliers and the remedy on stderr.
pub(super) fn print(f: &Fitted) {
    let Units { value, position, .. } = Units::of(f.symbol);
    let unit = if value == "um" { "µm" } else { value };
    for (file, m) in kept(f) {
        let place = if m.line > 0 { format!("{file}:{}", m.line) } else { file.to_owned() };
        note!("warning: {place}: {}: {}; kept in the fit", f.symbol, words_in(&m, (position, unit)));
    }
    if let Some(text) = remedy(f) {
        note!("note: {}: {text}", f.symbol);
    }
}

/// The keys of `volcomp evaluate iso230-2`, and the file.
pub(super) fn as_json(f: &Fitted) -> Vec<Value> {
    let Units { value, position, .. } = Units::of(f.symbol);
    let one = |(file, m): (&str, Marked)| {
        let mut json = start_up::as_json(&m, (position, value));
        json["file"] = json!(file);
        json["line"] = json!((m.line > 0).then_some(m.line));
        json
    };
    kept(f).into_iter().map(one).collect()
}
