//! Counting: recall, false alarms, honesty, calibration.

use std::collections::BTreeMap;

use serde::Serialize;

use super::cases::Kind;
use super::judge::{CONFIDENT, Judged};

/// So many of so many.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Default)]
pub struct Of {
    /// How many.
    pub hits: usize,
    /// Of how many.
    pub of: usize,
}

impl Of {
    fn count<'a>(all: impl IntoIterator<Item = &'a Judged>, hit: impl Fn(&Judged) -> bool) -> Self {
        all.into_iter()
            .fold(Self::default(), |c, j| Self { hits: c.hits + usize::from(hit(j)), of: c.of + 1 })
    }

    /// The share.
    #[must_use]
    pub fn share(self) -> Option<f64> {
        (self.of > 0).then(|| self.hits as f64 / self.of as f64)
    }
}

/// A bar, and whether it is reached.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Bar {
    /// What is measured.
    pub what: &'static str,
    /// The value.
    pub value: f64,
    /// Limits.
    pub limits: [f64; 2],
    /// Number of cases behind it.
    pub of: usize,
    /// It is within.
    pub holds: bool,
}

/// How often a truth got a name.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize)]
pub struct Confusion {
    /// What was true.
    pub truth: String,
    /// What was declared; `-` for nothing.
    pub said: String,
    /// How often.
    pub count: usize,
}

/// All figures.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Score {
    /// Single effects whose most probable cause is the truth.
    pub single_top1: Of,
    /// The same up to what the tool says it cannot tell apart.
    pub single_in_group: Of,
    /// Single effects declared, and nothing else.
    pub single_exact: Of,
    /// Top-1 by level.
    pub by_level: BTreeMap<String, Of>,
    /// Pairs found, and nothing else.
    pub pair_exact: Of,
    /// The same up to groups.
    pub pair_in_group: Of,
    /// Of pairs, both are among the causes declared.
    pub pair_both: Of,
    /// Declared on machines without an effect.
    pub null_alarms: Of,
    /// Effects outside the library: nothing declared with confidence, and said to be unexplained.
    pub outside_honest: Of,
    /// A name given with confidence.
    pub outside_named: Of,
    /// Neither.
    pub outside_silent: Of,
    /// True effect taken out: an innocent one declared with confidence.
    pub removed_innocent: Of,
    /// True effect taken out: said to be unexplained, or nothing.
    pub removed_honest: Of,
    /// The effect that the model lacks is named.
    pub left_out_named: Of,
    /// The same up to groups.
    pub left_out_in_group: Of,
    /// Effects that the plan cannot see: silence.
    pub invisible_silent: Of,
    /// Claims outside the group of the truth, in cases with an effect of the library.
    pub claims_outside_group: Of,
    /// Expected calibration error of the probability of declared and shown causes.
    pub ece: f64,
    /// Their Brier score.
    pub brier: f64,
    /// Causes behind it.
    pub claims: usize,
    /// The 90 % interval of the shrink holds what another day showed.
    pub coverage: Of,
    /// Mean half width of that interval.
    pub half_width: f64,
    /// What was taken for what, everything that is not on the diagonal.
    pub confusion: Vec<Confusion>,
    /// The bars.
    pub bars: Vec<Bar>,
}

impl Score {
    /// Counts; `hard` has bars of its own.
    #[must_use]
    pub fn of(all: &[Judged], hard: bool) -> Self {
        // a refusal is a miss where something is to be found, and no answer where silence is right
        let finds = |k: Kind| matches!(k, Kind::Single | Kind::Pair | Kind::LeftOut);
        let counts = move |j: &Judged| j.refused.is_none() || finds(j.kind);
        let kind = move |k: Kind| all.iter().filter(move |j| j.kind == k && j.visible && counts(j));
        let singles = || kind(Kind::Single);
        let confident = |j: &Judged| j.declared().any(|s| s.probability >= CONFIDENT);
        let mut by_level: BTreeMap<String, Of> = BTreeMap::new();
        for j in singles() {
            let o =
                by_level.entry(format!("{:.1}", j.levels.first().copied().unwrap_or_default())).or_default();
            *o = Of { hits: o.hits + usize::from(j.top_right()), of: o.of + 1 };
        }
        let inside = || all.iter().filter(|j| matches!(j.kind, Kind::Single | Kind::Pair | Kind::LeftOut));
        let claims = inside().flat_map(|j| j.declared()).count();
        let false_attributions = inside().map(|j| j.false_attributions().count()).sum();
        let (ece, brier, counted) = calibration(all);
        let shrinks: Vec<[f64; 4]> = all.iter().filter_map(|j| j.shrink).collect();
        let held = shrinks.iter().filter(|[_, low, high, seen]| seen >= low && seen <= high).count();
        let half = shrinks.iter().map(|[_, low, high, _]| 0.5 * (high - low)).sum::<f64>();
        let innocent = |j: &Judged| j.false_attributions().any(|s| s.probability >= CONFIDENT);
        let mut score = Self {
            single_top1: Of::count(singles(), Judged::top_right),
            single_in_group: Of::count(singles(), Judged::top_in_group),
            single_exact: Of::count(singles(), Judged::exact),
            by_level,
            pair_exact: Of::count(kind(Kind::Pair), Judged::exact),
            pair_in_group: Of::count(kind(Kind::Pair), Judged::exact_in_group),
            pair_both: Of::count(kind(Kind::Pair), |j| {
                j.labels.iter().all(|l| j.declared().any(|s| s.label == *l))
            }),
            null_alarms: Of::count(kind(Kind::Null), |j| j.declared().next().is_some()),
            outside_honest: Of::count(kind(Kind::Outside), |j| !confident(j) && j.unexplained),
            outside_named: Of::count(kind(Kind::Outside), confident),
            outside_silent: Of::count(kind(Kind::Outside), |j| !confident(j) && !j.unexplained),
            removed_innocent: Of::count(kind(Kind::Removed), innocent),
            removed_honest: Of::count(kind(Kind::Removed), |j| !confident(j)),
            left_out_named: Of::count(kind(Kind::LeftOut), Judged::top_right),
            left_out_in_group: Of::count(kind(Kind::LeftOut), Judged::top_in_group),
            // of a pair the other effect may be seen
            invisible_silent: Of::count(
                all.iter().filter(|j| !j.visible && j.kind != Kind::Pair && j.refused.is_none()),
                |j| !confident(j),
            ),
            claims_outside_group: Of { hits: false_attributions, of: claims },
            ece,
            brier,
            claims: counted,
            coverage: Of { hits: held, of: shrinks.len() },
            half_width: half / shrinks.len().max(1) as f64,
            confusion: confusion(all),
            bars: Vec::new(),
        };
        score.bars = score.bars(hard);
        score
    }

    fn bars(&self, hard: bool) -> Vec<Bar> {
        let mut bars = Vec::new();
        let mut bar = |what, of: Of, low: f64, high: f64| {
            if let Some(value) = of.share() {
                bars.push(Bar {
                    what,
                    value,
                    limits: [low, high],
                    of: of.of,
                    holds: value >= low && value <= high,
                });
            }
        };
        bar("single effect named first", self.single_top1, if hard { 0.92 } else { 0.97 }, 1.0);
        bar("single effect inside its group", self.single_in_group, 0.97, 1.0);
        bar("pairs: both found and nothing else", self.pair_exact, if hard { 0.80 } else { 0.85 }, 1.0);
        bar("no effect: declared anyway", self.null_alarms, 0.0, 0.02);
        bar("outside the library: called unexplained", self.outside_honest, 0.90, 1.0);
        bar("true effect removed: innocent one declared", self.removed_innocent, 0.0, 0.05);
        bar("model given all but one: it is named", self.left_out_named, 0.9, 1.0);
        bar("invisible to the plan: silence", self.invisible_silent, 1.0, 1.0);
        bar("shrink interval holds another day", self.coverage, 0.85, 0.95);
        let of = Of { hits: 0, of: self.claims };
        if of.of > 0 {
            for (what, value, limit) in
                [("probability: ECE", self.ece, 0.05), ("probability: Brier", self.brier, 0.06)]
            {
                bars.push(Bar { what, value, limits: [0.0, limit], of: of.of, holds: value <= limit });
            }
        }
        bars
    }
}

/// Expected calibration error (ten bins) and Brier score over all causes that were chosen and tested.
fn calibration(all: &[Judged]) -> (f64, f64, usize) {
    let mut bins = [(0.0, 0.0, 0usize); 10];
    let (mut brier, mut n) = (0.0, 0usize);
    let known =
        all.iter().filter(|j| matches!(j.kind, Kind::Single | Kind::Pair | Kind::Null | Kind::Outside));
    for s in known.flat_map(|j| &j.said).filter(|s| s.declared || s.tests.is_some()) {
        let truth = f64::from(u8::from(s.right));
        brier += (s.probability - truth).powi(2);
        n += 1;
        if let Some(b) = bins.get_mut(((s.probability * 10.0) as usize).min(9)) {
            *b = (b.0 + s.probability, b.1 + truth, b.2 + 1);
        }
    }
    let total = n.max(1) as f64;
    let ece = bins.iter().map(|(p, t, _)| (p - t).abs() / total).sum();
    (ece, brier / total, n)
}

fn confusion(all: &[Judged]) -> Vec<Confusion> {
    let mut counts: BTreeMap<(String, String), usize> = BTreeMap::new();
    for j in all {
        let truth = match j.kind {
            Kind::Removed => format!("({})", j.labels.join(" + ")),
            _ if j.labels.is_empty() => "none".to_owned(),
            _ => j.labels.join(" + "),
        };
        for s in j.declared().filter(|s| !s.right) {
            *counts.entry((truth.clone(), s.label.clone())).or_default() += 1;
        }
        if matches!(j.kind, Kind::Single | Kind::Pair | Kind::LeftOut) && j.visible {
            for l in j.labels.iter().filter(|l| !j.declared().any(|s| s.label == **l)) {
                *counts.entry((l.clone(), "-".to_owned())).or_default() += 1;
            }
        }
    }
    counts.into_iter().map(|((truth, said), count)| Confusion { truth, said, count }).collect()
}
