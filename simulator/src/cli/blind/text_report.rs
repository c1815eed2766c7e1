//! The result of blind tests as text.

use super::Outcome;
use crate::blind::score::Of;
use crate::blind::{Judged, Kind, Standing};

/// Prints bars, kinds, failures and what was taken for what.
pub(super) fn report(outcome: &Outcome, cases: usize) {
    let s = &outcome.score;
    say!("{cases} cases of the {}, plan {}, seed {}", outcome.generator, outcome.plan, outcome.seed);
    for why in outcome.cases.iter().filter_map(|j| j.refused.as_deref()) {
        say!("  refused, no answer: {why}");
    }
    say!(
        "  {:<9} {:>5} {:>9} {:>5} {:>5} {:>13} {:>12} {:>6} {:>6} {:>6}",
        "kind",
        "cases",
        "found",
        "first",
        "exact",
        "misattributed",
        "re-expressed",
        "honest",
        "silent",
        "failed"
    );
    for k in &s.kinds {
        let found = format!("{}/{}", k.found.hits, k.found.of);
        say!(
            "  {:<9} {:>5} {found:>9} {:>5} {:>5} {:>13} {:>12} {:>6} {:>6} {:>6}",
            name(k.kind),
            k.cases,
            k.first,
            k.exact,
            k.misattributed,
            k.re_expressions,
            k.honest,
            k.silent,
            k.failed
        );
    }
    for b in &s.bars {
        let [low, high] = b.limits;
        let [from, to] = b.interval;
        let standing = match b.standing {
            Standing::Reached => "reached",
            Standing::Undecided => "undecided",
            Standing::Missed => "MISSED",
        };
        say!(
            "  {:47} {:6.3}  of {:4}  (95 %: {from:.2} to {to:.2})  limits {low:.2} to {high:.2}  {standing}",
            b.what,
            b.value,
            b.of
        );
    }
    let of = |what: &str, o: Of| {
        if o.of > 0 {
            say!("  {what:47} {} of {}", o.hits, o.of);
        }
    };
    of("single: declared alone", s.single_exact);
    for (level, o) in &s.by_level {
        of(&format!("single named first at {level} times the noise"), *o);
    }
    of("pairs: both found", s.pair_both);
    of("pairs: both found up to set answers", s.pair_in_group);
    of("several: causes below the noise found", s.several_found_small);
    of("outside: silent", s.outside_silent);
    of("true effect removed: honest", s.removed_honest);
    of("all but one: first or set answer", s.left_out_in_group);
    of("misattributed of all declared causes", s.misattributed);
    if s.coverage.of > 0 {
        say!("  mean half width of the shrink interval          {:.3}", s.half_width);
    }
    for a in &outcome.ablations {
        of(&format!("{}: no effect, declared anyway", a.what), a.null_alarms);
        of(&format!("{}: outside, something declared", a.what), a.outside_named);
    }
    if !s.confusion.is_empty() {
        say!("truth and what was declared instead (right answers are left out):");
    }
    for c in &s.confusion {
        say!("  {:34} {:28} {}", c.truth, c.said, c.count);
    }
    let failed: Vec<&Judged> = outcome.cases.iter().filter(|j| j.failed()).collect();
    if !failed.is_empty() {
        say!("failed cases (--only N --keep repeats one):");
    }
    for j in failed {
        say!("  {}", failure(j));
    }
}

const fn name(kind: Kind) -> &'static str {
    match kind {
        Kind::Single => "single",
        Kind::Pair => "pair",
        Kind::Several => "several",
        Kind::Null => "none",
        Kind::Outside => "outside",
        Kind::Removed => "removed",
        Kind::LeftOut => "left out",
    }
}

/// Case, truth, and what was said.
fn failure(j: &Judged) -> String {
    let truth: Vec<String> =
        j.labels.iter().zip(&j.levels).map(|(l, level)| format!("{l} ({level:.1})")).collect();
    let said: Vec<String> = j
        .said
        .iter()
        .filter(|s| s.declared || s.right)
        .map(|s| {
            let mark = match (s.declared, s.right, s.in_group, s.re_expression) {
                (false, ..) => " not declared",
                (_, true, ..) => "",
                (_, _, true, _) => " set answer",
                (_, _, _, true) => " re-expression",
                _ => " misattributed",
            };
            format!("{} {:.2}{mark}", s.label, s.probability)
        })
        .collect();
    let list = |all: Vec<String>| if all.is_empty() { "nothing".to_owned() } else { all.join(", ") };
    let unseen = if j.visible { "" } else { " (not all visible)" };
    let rest = if j.unexplained { "; something unexplained" } else { "" };
    format!(
        "{:4} {:8} truth: {}{unseen}; said: {}; {}{rest}",
        j.number,
        name(j.kind),
        list(truth),
        list(said),
        j.verdict
    )
}
