//! Counting: recall, false alarms, honesty, calibration; each bar with the interval that so few cases leave.

use std::collections::BTreeMap;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::Serialize;
use statrs::distribution::{Beta, ContinuousCDF};

use super::cases::Kind;
use super::judge::{CONFIDENT, Judged};

/// Confidence of the interval beside a share.
const CONFIDENCE: f64 = 0.95;
/// Draws for the calibration error that perfectly calibrated claims show by chance.
const DRAWS: usize = 400;

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

    /// Clopper-Pearson interval of the share (95 %).
    #[must_use]
    pub fn interval(self) -> [f64; 2] {
        let tail = 0.5 * (1.0 - CONFIDENCE);
        let (hits, misses) = (self.hits as f64, self.of.saturating_sub(self.hits) as f64);
        let quantile = |a: f64, b: f64, p: f64, end: f64| {
            Beta::new(a, b).map_or(end, |beta| beta.inverse_cdf(p).clamp(0.0, 1.0))
        };
        let low = if hits > 0.0 { quantile(hits, misses + 1.0, tail, 0.0) } else { 0.0 };
        let high = if misses > 0.0 { quantile(hits + 1.0, misses, 1.0 - tail, 1.0) } else { 1.0 };
        [low, high]
    }
}

/// What the cases say of a bar.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Standing {
    /// The value is within the limits.
    Reached,
    /// The value is outside, its interval is not: too few cases to tell.
    Undecided,
    /// The interval lies outside.
    Missed,
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
    /// Interval of the value: of a share by Clopper and Pearson (95 %), of a calibration error what chance alone gives.
    pub interval: [f64; 2],
    /// What the cases say.
    pub standing: Standing,
    /// It is not missed.
    pub holds: bool,
}

impl Bar {
    fn new(what: &'static str, value: f64, of: usize, limits: [f64; 2], interval: [f64; 2]) -> Self {
        let [low, high] = limits;
        let standing = if (low..=high).contains(&value) {
            Standing::Reached
        } else if interval[1] >= low && interval[0] <= high {
            Standing::Undecided
        } else {
            Standing::Missed
        };
        Self { what, value, limits, of, interval, standing, holds: standing != Standing::Missed }
    }
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

/// A kind of case in one row.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct KindRow {
    /// The kind.
    pub kind: Kind,
    /// Cases, those refused among them.
    pub cases: usize,
    /// True causes that are declared.
    pub found: Of,
    /// The most probable cause is true.
    pub first: usize,
    /// All causes and nothing else.
    pub exact: usize,
    /// Something is misattributed.
    pub misattributed: usize,
    /// Declared causes that the judge finds to say again what is true.
    pub re_expressions: usize,
    /// Honest.
    pub honest: usize,
    /// Silent.
    pub silent: usize,
    /// Not as the kind wants it.
    pub failed: usize,
}

/// All figures.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Score {
    /// Each kind of case.
    pub kinds: Vec<KindRow>,
    /// Single effects whose most probable cause is the truth.
    pub single_top1: Of,
    /// The same up to set answers and re-expressions.
    pub single_in_group: Of,
    /// Single effects declared, and nothing else.
    pub single_exact: Of,
    /// Top-1 by level.
    pub by_level: BTreeMap<String, Of>,
    /// Pairs found, and nothing else.
    pub pair_exact: Of,
    /// The same up to set answers and re-expressions.
    pub pair_in_group: Of,
    /// Of pairs, both are among the causes declared.
    pub pair_both: Of,
    /// Several effects: causes of at least the noise that are declared.
    pub several_found: Of,
    /// Several effects: smaller ones.
    pub several_found_small: Of,
    /// Several effects: cases in which something is misattributed.
    pub several_misattributed: Of,
    /// Declared on machines without an effect.
    pub null_alarms: Of,
    /// Effects outside the library: honest.
    pub outside_honest: Of,
    /// Something misattributed with a probability of at least one half.
    pub outside_named: Of,
    /// Nothing declared and nothing said.
    pub outside_silent: Of,
    /// True effect taken out: something misattributed.
    pub removed_misattributed: Of,
    /// True effect taken out: honest.
    pub removed_honest: Of,
    /// The effect that the model lacks is named.
    pub left_out_named: Of,
    /// The same up to set answers and re-expressions.
    pub left_out_in_group: Of,
    /// Effects that the plan cannot see: nothing declared.
    pub invisible_silent: Of,
    /// Misattributed causes of all declared in cases with an effect of the library.
    pub misattributed: Of,
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
        let finds = |k: Kind| matches!(k, Kind::Single | Kind::Pair | Kind::Several | Kind::LeftOut);
        let counts = move |j: &Judged| j.refused.is_none() || finds(j.kind);
        let kind = move |k: Kind| {
            all.iter().filter(move |j| j.kind == k && (j.visible || k == Kind::Several) && counts(j))
        };
        let singles = || kind(Kind::Single);
        let wrong = |j: &Judged| j.misattributed().next().is_some();
        let mut by_level: BTreeMap<String, Of> = BTreeMap::new();
        for j in singles() {
            let o =
                by_level.entry(format!("{:.1}", j.levels.first().copied().unwrap_or_default())).or_default();
            *o = Of { hits: o.hits + usize::from(j.top_right()), of: o.of + 1 };
        }
        let inside = || all.iter().filter(|j| finds(j.kind));
        let several = |wanted: fn(f64) -> bool| Of {
            hits: kind(Kind::Several).flat_map(Judged::found).filter(|(_, l)| wanted(*l)).count(),
            of: kind(Kind::Several).flat_map(|j| &j.levels).filter(|l| wanted(**l)).count(),
        };
        let (claims, truths) = probabilities(all);
        let (ece, brier) = calibration(&claims, &truths);
        let shrinks: Vec<[f64; 4]> = all.iter().filter_map(|j| j.shrink).collect();
        let held = shrinks.iter().filter(|[_, low, high, seen]| seen >= low && seen <= high).count();
        let half = shrinks.iter().map(|[_, low, high, _]| 0.5 * (high - low)).sum::<f64>();
        let mut score = Self {
            kinds: kinds(all),
            single_top1: Of::count(singles(), Judged::top_right),
            single_in_group: Of::count(singles(), Judged::top_in_group),
            single_exact: Of::count(singles(), Judged::exact),
            by_level,
            pair_exact: Of::count(kind(Kind::Pair), Judged::exact),
            pair_in_group: Of::count(kind(Kind::Pair), Judged::exact_in_group),
            pair_both: Of::count(kind(Kind::Pair), |j| j.found().count() == j.labels.len()),
            several_found: several(|l| l >= 1.0),
            several_found_small: several(|l| l < 1.0),
            several_misattributed: Of::count(kind(Kind::Several), wrong),
            null_alarms: Of::count(kind(Kind::Null), |j| j.declared().next().is_some()),
            outside_honest: Of::count(kind(Kind::Outside), Judged::honest),
            outside_named: Of::count(kind(Kind::Outside), |j| {
                j.misattributed().any(|s| s.probability >= CONFIDENT)
            }),
            outside_silent: Of::count(kind(Kind::Outside), Judged::silent),
            removed_misattributed: Of::count(kind(Kind::Removed), wrong),
            removed_honest: Of::count(kind(Kind::Removed), Judged::honest),
            left_out_named: Of::count(kind(Kind::LeftOut), Judged::top_right),
            left_out_in_group: Of::count(kind(Kind::LeftOut), Judged::top_in_group),
            // of several effects the others may be seen
            invisible_silent: Of::count(
                all.iter().filter(|j| {
                    !j.visible && !matches!(j.kind, Kind::Pair | Kind::Several) && j.refused.is_none()
                }),
                |j| j.declared().next().is_none(),
            ),
            misattributed: Of {
                hits: inside().map(|j| j.misattributed().count()).sum(),
                of: inside().flat_map(Judged::declared).count(),
            },
            ece,
            brier,
            claims: claims.len(),
            coverage: Of { hits: held, of: shrinks.len() },
            half_width: half / shrinks.len().max(1) as f64,
            confusion: confusion(all),
            bars: Vec::new(),
        };
        score.bars = score.bars(hard, &claims);
        score
    }

    fn bars(&self, hard: bool, claims: &[f64]) -> Vec<Bar> {
        let mut bars = Vec::new();
        let mut bar = |what, of: Of, low: f64, high: f64| {
            if let Some(value) = of.share() {
                bars.push(Bar::new(what, value, of.of, [low, high], of.interval()));
            }
        };
        bar("single effect named first", self.single_top1, if hard { 0.92 } else { 0.95 }, 1.0);
        bar("single effect first or set answer", self.single_in_group, 0.97, 1.0);
        bar("pairs: both found and nothing else", self.pair_exact, if hard { 0.80 } else { 0.88 }, 1.0);
        bar("several: causes of at least the noise found", self.several_found, 0.85, 1.0);
        bar("several: cases with a misattributed cause", self.several_misattributed, 0.0, 0.08);
        bar("no effect: declared anyway", self.null_alarms, 0.0, 0.02);
        bar("outside the library: honest", self.outside_honest, 0.95, 1.0);
        bar("outside the library: named at one half", self.outside_named, 0.0, 0.0);
        bar("true effect removed: misattributed", self.removed_misattributed, 0.0, 0.05);
        bar("model given all but one: it is named", self.left_out_named, 0.9, 1.0);
        bar("invisible to the plan: nothing declared", self.invisible_silent, 1.0, 1.0);
        bar("shrink interval holds another day", self.coverage, 0.86, 0.95);
        if !claims.is_empty() {
            let chance = by_chance(claims);
            for (what, value, limit, [low, high]) in [
                ("probability: ECE", self.ece, 0.04, chance[0]),
                ("probability: Brier", self.brier, 0.06, chance[1]),
            ] {
                // what well calibrated claims show by chance is no fault of theirs
                let of = claims.len();
                let standing = if value <= limit {
                    Standing::Reached
                } else if value <= high {
                    Standing::Undecided
                } else {
                    Standing::Missed
                };
                let holds = standing != Standing::Missed;
                let (limits, interval) = ([0.0, limit], [low, high]);
                bars.push(Bar { what, value, limits, of, interval, standing, holds });
            }
        }
        bars
    }
}

fn kinds(all: &[Judged]) -> Vec<KindRow> {
    let mut by_kind: BTreeMap<Kind, Vec<&Judged>> = BTreeMap::new();
    for j in all {
        by_kind.entry(j.kind).or_default().push(j);
    }
    let row = |(kind, cases): (Kind, Vec<&Judged>)| {
        let count = |is: fn(&Judged) -> bool| cases.iter().filter(|j| is(j)).count();
        KindRow {
            kind,
            cases: cases.len(),
            found: Of {
                hits: cases.iter().map(|j| j.found().count()).sum(),
                of: cases.iter().map(|j| j.labels.len()).sum(),
            },
            first: count(Judged::top_right),
            exact: count(Judged::exact),
            misattributed: count(|j| j.misattributed().next().is_some()),
            re_expressions: cases
                .iter()
                .flat_map(|j| j.declared())
                .filter(|s| !s.right && s.re_expression)
                .count(),
            honest: count(Judged::honest),
            silent: count(Judged::silent),
            failed: count(Judged::failed),
        }
    };
    by_kind.into_iter().map(row).collect()
}

/// Probabilities of all causes that were chosen and tested, and whether they are right.
fn probabilities(all: &[Judged]) -> (Vec<f64>, Vec<bool>) {
    all.iter()
        .filter(|j| !matches!(j.kind, Kind::Removed | Kind::LeftOut))
        .flat_map(|j| &j.said)
        .filter(|s| s.declared || s.tests.is_some())
        .map(|s| (s.probability, s.right))
        .unzip()
}

/// Expected calibration error (ten bins) and Brier score.
fn calibration(claims: &[f64], truths: &[bool]) -> (f64, f64) {
    let mut bins = [(0.0, 0.0); 10];
    let mut brier = 0.0;
    for (p, right) in claims.iter().zip(truths) {
        let truth = f64::from(u8::from(*right));
        brier += (p - truth).powi(2);
        if let Some(b) = bins.get_mut(((p * 10.0) as usize).min(9)) {
            *b = (b.0 + p, b.1 + truth);
        }
    }
    let total = claims.len().max(1) as f64;
    (bins.iter().map(|(p, t)| (p - t).abs() / total).sum(), brier / total)
}

/// Range (up to 95 %) of ECE and Brier score of claims that are right as often as they say.
fn by_chance(claims: &[f64]) -> [[f64; 2]; 2] {
    let mut random = ChaCha8Rng::seed_from_u64(claims.len() as u64);
    let (mut eces, mut briers) = (Vec::with_capacity(DRAWS), Vec::with_capacity(DRAWS));
    for _ in 0..DRAWS {
        let truths: Vec<bool> = claims.iter().map(|p| random.random::<f64>() < *p).collect();
        let (ece, brier) = calibration(claims, &truths);
        eces.push(ece);
        briers.push(brier);
    }
    [eces, briers].map(|mut values| {
        values.sort_by(f64::total_cmp);
        let high = (CONFIDENCE * DRAWS as f64) as usize;
        [values.first(), values.get(high)].map(|v| v.copied().unwrap_or_default())
    })
}

fn confusion(all: &[Judged]) -> Vec<Confusion> {
    let mut counts: BTreeMap<(String, String), usize> = BTreeMap::new();
    for j in all {
        let truth = match j.kind {
            Kind::Removed => format!("({})", j.labels.join(" + ")),
            Kind::Several => "several".to_owned(),
            _ if j.labels.is_empty() => "none".to_owned(),
            _ => j.labels.join(" + "),
        };
        for s in j.declared().filter(|s| !s.right) {
            *counts.entry((truth.clone(), s.label.clone())).or_default() += 1;
        }
        if matches!(j.kind, Kind::Single | Kind::Pair | Kind::Several | Kind::LeftOut) && j.visible {
            for l in j.labels.iter().filter(|l| !j.declared().any(|s| s.label == **l)) {
                *counts.entry((l.clone(), "-".to_owned())).or_default() += 1;
            }
        }
    }
    counts.into_iter().map(|((truth, said), count)| Confusion { truth, said, count }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_interval_is_that_of_clopper_and_pearson() {
        let is = |of: Of, low: f64, high: f64| {
            let [a, b] = of.interval();
            assert!((a - low).abs() < 5e-4 && (b - high).abs() < 5e-4, "{of:?}: {a} {b}");
        };
        // printed tables of exact binomial limits, 95 %
        is(Of { hits: 7, of: 7 }, 0.5904, 1.0);
        is(Of { hits: 0, of: 10 }, 0.0, 0.3085);
        is(Of { hits: 8, of: 10 }, 0.4439, 0.9748);
    }

    #[test]
    fn seven_of_seven_do_not_miss_a_bar_and_forty_of_hundred_do() {
        let bar = |hits, of, limits| {
            let o = Of { hits, of };
            Bar::new("coverage", o.share().unwrap(), of, limits, o.interval()).standing
        };
        assert_eq!(bar(7, 7, [0.86, 0.95]), Standing::Undecided);
        assert_eq!(bar(9, 10, [0.86, 0.95]), Standing::Reached);
        assert_eq!(bar(400, 400, [0.86, 0.95]), Standing::Missed);
        assert_eq!(bar(40, 100, [0.86, 0.95]), Standing::Missed);
        assert_eq!(bar(1, 10, [0.0, 0.02]), Standing::Undecided);
        assert_eq!(bar(8, 10, [0.0, 0.02]), Standing::Missed);
    }

    #[test]
    fn a_calibration_error_of_few_claims_is_judged_beside_that_of_chance() {
        let claims = vec![0.7; 10];
        let [[_, ece], _] = by_chance(&claims);
        // seven of ten are expected; five to nine are nothing unusual
        assert!((0.15..0.35).contains(&ece), "{ece}");
        let (all_wrong, _) = calibration(&claims, &[false; 10]);
        assert!(all_wrong > ece);
    }
}
