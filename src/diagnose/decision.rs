//! The decision: from the evidence of every chosen effect to its probability, to what is declared, and to the reasons against the
//! rest. Pure: no data are looked at, nothing is decided elsewhere.
//!
//! The log odds of an effect are linear in the logarithm of its evidence, in its deviation (random effects between programs,
//! places and runs, and its misform), in the mean deviation of all effects chosen in the session and in how far it takes back
//! what the others say; times its share among the effects that explain nearly as much. Where most of what was chosen deviates,
//! something is at work that the library lacks, and each of the chosen is a part of it. The coefficients come from claims
//! in campaigns of three generators (docs/development/ablation.md).

use super::constants::{
    ALIASED, CALIBRATION, DECLARED, DEVIATION_EXPECTED, LEAST_PROBABILITY, LITTLE, NAMED,
};
use super::evidence::Contender;
use super::library::{Kind, Label};
use super::search::{Figures, Found};

/// Why an effect is not declared.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Reason {
    /// The gap of readings left out, um RMS, with and without it.
    HeldOut {
        /// With it.
        with_um: f64,
        /// Without it.
        without_um: f64,
    },
    /// The gap of the readings themselves, um RMS, corrected by it and not: slow drift takes back what it says.
    Harms {
        /// With it.
        with_um: f64,
        /// Without it.
        without_um: f64,
    },
    /// Readings left out fit worse with it, whatever else is chosen.
    Worse,
    /// All causes together take out this share of a gap that is no larger than the noise allows.
    Little {
        /// Forecast shrink.
        shrink: f64,
    },
    /// Its probability is too small: what costs it most.
    Improbable {
        /// Of the effect itself.
        probability: f64,
        /// Of its group.
        group: f64,
        /// What speaks against it most.
        cost: Cost,
    },
}

/// What lowers the log odds of an effect most.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Cost {
    /// Little evidence, or rivals that explain nearly as much.
    Evidence,
    /// It differs between programs, places or runs by this share of itself.
    Between(f64),
    /// One program alone shows it, so that its deviation is hardly more than what is expected before anything is known.
    OneProgram,
    /// It differs from its formula by this share of itself.
    Misform(f64),
    /// It takes back what the others say.
    TakesBack,
    /// The effects chosen in the session deviate by this share of themselves in the mean.
    Company(f64),
    /// Beside it stands a discrepancy of so many um RMS, of which it may be a part.
    Discrepancy(f64),
}

/// What is known of one chosen effect.
#[derive(Debug, Clone)]
pub struct Evidence {
    /// The variant.
    pub variant: usize,
    /// Its label.
    pub label: Label,
    /// Who is to blame.
    pub kind: Kind,
    /// Its gain and evidence beside the others.
    pub found: Found,
    /// How far it agrees with itself and with the others.
    pub figures: Figures,
    /// Labels that the data cannot tell from it.
    pub same: Vec<Label>,
    /// Pairs of labels that say the same together.
    pub sums: Vec<[Label; 2]>,
    /// Its share among the effects that explain nearly as much, 0 to 1.
    pub share: f64,
    /// The share of its group.
    pub group_share: f64,
    /// Effects in its place, with their weight relative to its own.
    pub rivals: Vec<(Label, f64)>,
    /// Taken out because it makes readings that were left out worse.
    pub is_pruned: bool,
}

/// Mean products of the readings left out, um^2: of the gap (first) and of what each effect says of it, fitted without them.
#[derive(Debug, Clone, Default)]
pub struct HeldOut {
    /// Row by row, one more than there are effects.
    pub products: Vec<Vec<f64>>,
}

impl HeldOut {
    /// RMS of the gap without the effects taken, um.
    fn rms_um(&self, taken: impl Fn(usize) -> bool) -> f64 {
        let sign = |k: usize| if k == 0 { 1.0 } else { -f64::from(u8::from(taken(k - 1))) };
        let row = |(i, row): (usize, &Vec<f64>)| {
            row.iter().enumerate().map(|(j, v)| sign(i) * sign(j) * v).sum::<f64>()
        };
        self.products.iter().enumerate().map(row).sum::<f64>().max(0.0).sqrt()
    }
}

/// A chosen effect with its probability and what was decided.
#[derive(Debug, Clone)]
pub struct Assessed {
    /// The variant.
    pub variant: usize,
    /// Its label.
    pub label: Label,
    /// Who is to blame.
    pub kind: Kind,
    /// Its gain and evidence beside the others.
    pub found: Found,
    /// How far it agrees with itself and with the others.
    pub figures: Figures,
    /// Labels that the data cannot tell from it.
    pub same: Vec<Label>,
    /// Pairs of labels that say the same together.
    pub sums: Vec<[Label; 2]>,
    /// Its share among the effects that explain nearly as much.
    pub share: f64,
    /// Probability that this effect, or one of `same`, is at work.
    pub group_probability: f64,
    /// Probability of this very effect.
    pub probability: f64,
    /// Alternatives and their probability, best first.
    pub alternatives: Vec<(Label, f64)>,
    /// Why it is not declared; none where it is.
    pub reason: Option<Reason>,
}

impl Assessed {
    /// The tool stands by it.
    #[must_use]
    pub const fn is_declared(&self) -> bool {
        self.reason.is_none()
    }

    /// Declares it no more, `because`.
    pub fn withdraw(&mut self, because: Reason) {
        self.reason.get_or_insert(because);
    }

    fn new(e: Evidence, real: f64, reason: Option<Reason>) -> Self {
        let probability = real * e.share;
        Self {
            variant: e.variant,
            label: e.label,
            kind: e.kind,
            found: e.found,
            figures: e.figures,
            same: e.same,
            sums: e.sums,
            share: e.share,
            group_probability: real * e.group_share,
            probability,
            alternatives: e.rivals.into_iter().map(|(l, w)| (l, probability * w)).collect(),
            reason,
        }
    }
}

/// Decides on all chosen effects.
#[must_use]
pub fn decide(all: Vec<Evidence>, held_out: &HeldOut) -> Vec<Assessed> {
    let company = mean_deviation(&all);
    let is_alone = all.len() == 1;
    let reason =
        |e: &Evidence| if e.is_pruned { Some(Reason::Worse) } else { improbable(e, company, is_alone) };
    let reasons: Vec<Option<Reason>> = all.iter().map(reason).collect();
    let because = |[with_um, without_um]: [f64; 2]| Reason::HeldOut { with_um, without_um };
    let reasons = worth(reasons, held_out, because);
    all.into_iter()
        .zip(reasons)
        .map(|(e, reason)| {
            let is_doubted = matches!(reason, Some(r) if !matches!(r, Reason::Improbable { .. }));
            let real = real(&e, company, is_doubted);
            Assessed::new(e, real, reason)
        })
        .collect()
}

/// Declares whatever was chosen: to show what the decision is good for.
#[must_use]
pub fn declare_all(all: Vec<Evidence>) -> Vec<Assessed> {
    let sure = |e: Evidence| Evidence { share: 1.0, group_share: 1.0, rivals: Vec::new(), ..e };
    all.into_iter().map(|e| Assessed::new(sure(e), 1.0, None)).collect()
}

/// Decides on the members of the likeliest set, whose probabilities are posteriors of the library already: a label is declared where
/// its group is likely, nothing in the group is likelier, and the gap is no larger without it (`left`: products of the gap itself).
/// What is small beside a discrepancy (of this probability) may be the part of an unknown effect that its formula describes.
#[must_use]
pub fn decide_by_posterior(
    all: Vec<(Evidence, &Contender)>,
    left: &HeldOut,
    discrepancy: f64,
) -> Vec<Assessed> {
    let real: Vec<f64> = all.iter().map(|(_, c)| no_alias(c, discrepancy)).collect();
    let reason = |((_, c), real): (&(Evidence, &Contender), &f64)| {
        let (probability, group) = (real * c.probability, real * c.group_probability);
        let is_top = c.rivals.iter().all(|(_, p)| *p <= c.probability);
        let is_sure = group >= DECLARED && probability >= NAMED && is_top;
        let is_aliased = is_top && *real < c.group_probability;
        let cost = if is_aliased { Cost::Discrepancy(c.beside_um2.sqrt()) } else { Cost::Evidence };
        (!is_sure).then_some(Reason::Improbable { probability, group, cost })
    };
    let because = |[with_um, without_um]: [f64; 2]| Reason::Harms { with_um, without_um };
    let reasons = worth(all.iter().zip(&real).map(reason).collect(), left, because);
    let decided = all.into_iter().zip(real).zip(reasons);
    decided.map(|(((e, _), real), reason)| Assessed::new(e, real, reason)).collect()
}

/// Probability that what a formula says is no part of an unknown effect, whose share in what both say is large by beta(1, 3).
fn no_alias(c: &Contender, discrepancy: f64) -> f64 {
    let share = c.beside_um2 / (c.beside_um2 + c.own_um2).max(f64::MIN_POSITIVE);
    1.0 - discrepancy + discrepancy / (1.0 + ALIASED * share.powi(3))
}

fn improbable(e: &Evidence, company: f64, is_alone: bool) -> Option<Reason> {
    let real = real(e, company, false);
    let (probability, group) = (real * e.share, real * e.group_share);
    (group < DECLARED || probability < NAMED).then(|| Reason::Improbable {
        probability,
        group,
        cost: cost(&e.figures, company, is_alone),
    })
}

/// Takes back, one by one and the worst first, what makes the gap worse, `because` of the gaps with and without it, um RMS.
fn worth(
    mut reasons: Vec<Option<Reason>>,
    held_out: &HeldOut,
    because: impl Fn([f64; 2]) -> Reason,
) -> Vec<Option<Reason>> {
    let nothing_um = held_out.rms_um(|_| false);
    loop {
        let is_in = |p: usize| reasons.get(p).is_some_and(Option::is_none);
        let without = |place: usize| held_out.rms_um(|p| is_in(p) && p != place);
        let places = (0..reasons.len()).filter(|p| is_in(*p)).map(|p| (p, without(p)));
        let Some((place, without_um)) = places.min_by(|(_, a), (_, b)| a.total_cmp(b)) else {
            return reasons;
        };
        let with_um = held_out.rms_um(is_in);
        // each may help beside the others while all of them together do not
        if without_um > with_um && with_um < nothing_um {
            return reasons;
        }
        if let Some(reason) = reasons.get_mut(place) {
            *reason = Some(because([with_um, without_um]));
        }
    }
}

/// What each figure costs in log odds, and the largest of them.
fn cost(g: &Figures, company: f64, is_alone: bool) -> Cost {
    let own = CALIBRATION.deviation + CALIBRATION.session;
    // what one program shows has little more than the prior of a deviation
    let is_alone_seen = g.breadth < 1.0 + LITTLE && g.between <= DEVIATION_EXPECTED;
    let of_between = if is_alone_seen { Cost::OneProgram } else { Cost::Between(g.between) };
    let between = (own * g.between, of_between);
    let misform = (own * excess(g.misform), Cost::Misform(g.misform));
    let against = (CALIBRATION.against * (-g.against).max(0.0), Cost::TakesBack);
    // the mean over one effect is its own
    let of_company = if is_alone { Cost::Misform(company) } else { Cost::Company(company) };
    let company = (CALIBRATION.session * company, of_company);
    // the mean holds the effect's own share, so its own deviation is named first
    let most = [company, between, misform, against].into_iter().max_by(|a, b| a.0.total_cmp(&b.0));
    most.filter(|m| m.0 > 1.0).map_or(Cost::Evidence, |m| m.1)
}

/// What a deviation has beyond that of an effect of which nothing is known.
fn excess(deviation: f64) -> f64 {
    (deviation - DEVIATION_EXPECTED).max(0.0)
}

/// Deviation of an effect: between parts, or from its formula.
fn deviation(g: &Figures) -> f64 {
    g.between.max(excess(g.misform))
}

/// Mean deviation of effects, each with its variation over the volume and at most 1. Not weighted: on a real drive what is barely
/// seen and deviates tells that the formulas do not hold.
fn mean_deviation(all: &[Evidence]) -> f64 {
    let of = |e: &Evidence| (deviation(&e.figures) + e.figures.varies).min(1.0);
    all.iter().map(of).sum::<f64>() / all.len().max(1) as f64
}

/// Probability that an effect of this evidence and these figures is at work, whatever may stand for it.
fn real(e: &Evidence, company: f64, is_doubted: bool) -> f64 {
    let (c, g) = (CALIBRATION, &e.figures);
    let z = c.base + c.evidence * e.found.evidence.max(1.0).ln()
        - c.deviation * deviation(g)
        - c.session * company
        - c.against * (-g.against).max(0.0);
    let share = if is_doubted { LITTLE } else { 1.0 } / (1.0 + (-z).exp());
    LEAST_PROBABILITY + (1.0 - LEAST_PROBABILITY) * share
}

#[cfg(test)]
mod tests {
    use super::super::evidence::Contender;
    use super::{Cost, Evidence, HeldOut, Reason, decide, decide_by_posterior};
    use crate::library::{Kind, Label};
    use crate::search::{Figures, Found};

    const GOOD: Figures = Figures { between: 0.05, misform: 0.25, breadth: 10.0, ..Figures::UNASKED };

    fn effect(evidence: f64, figures: Figures) -> Evidence {
        Evidence {
            variant: 0,
            label: Label::new("scale", "x"),
            kind: Kind::Machine,
            found: Found { variant: 0, gain: evidence, rank: 1, evidence },
            figures,
            same: Vec::new(),
            sums: Vec::new(),
            share: 1.0,
            group_share: 1.0,
            rivals: Vec::new(),
            is_pruned: false,
        }
    }

    /// A gap of 10 um^2 of which each effect takes its share, the more the better it fits what was left out.
    fn held_out(shares: &[f64]) -> HeldOut {
        let n = shares.len();
        let mut products = vec![vec![0.0; n + 1]; n + 1];
        products[0][0] = 10.0;
        for (k, s) in shares.iter().enumerate() {
            (products[0][k + 1], products[k + 1][0], products[k + 1][k + 1]) = (*s, *s, 1.0);
        }
        HeldOut { products }
    }

    fn alone(e: Evidence) -> (f64, Option<Reason>) {
        let decided = decide(vec![e], &held_out(&[2.0]));
        (decided[0].probability, decided[0].reason)
    }

    #[test]
    fn whatever_speaks_against_an_effect_lowers_its_probability() {
        let (best, reason) = alone(effect(500.0, GOOD));
        assert!(best > 0.8 && reason.is_none(), "{best}");
        for worse in [
            Figures { between: 0.5, ..GOOD },
            Figures { misform: 0.8, ..GOOD },
            Figures { against: -0.5, ..GOOD },
        ] {
            assert!(alone(effect(500.0, worse)).0 < best - 0.03, "{worse:?}");
        }
        assert!(alone(effect(30.0, GOOD)).0 < best - 0.03);
    }

    #[test]
    fn an_effect_that_is_not_declared_says_what_costs_it_most() {
        let with = |evidence: f64, figures| match alone(effect(evidence, figures)).1 {
            Some(Reason::Improbable { cost, .. }) => cost,
            other => panic!("{other:?}"),
        };
        let of = |figures| with(300.0, figures);
        assert_eq!(of(Figures { between: 1.2, ..GOOD }), Cost::Between(1.2));
        assert_eq!(with(20.0, Figures { between: 0.2, breadth: 1.0, ..GOOD }), Cost::OneProgram);
        assert_eq!(with(20.0, Figures { between: 0.2, ..GOOD }), Cost::Between(0.2));
        assert_eq!(of(Figures { between: 0.4, breadth: 1.0, ..GOOD }), Cost::Between(0.4));
        assert_eq!(of(Figures { misform: 1.3, ..GOOD }), Cost::Misform(1.3));
        assert_eq!(of(Figures { against: -1.0, between: 0.3, ..GOOD }), Cost::TakesBack);
    }

    #[test]
    fn an_effect_among_others_that_deviate_is_not_declared() {
        let good = || effect(700.0, GOOD);
        let odd = || effect(500.0, Figures { between: 0.9, ..GOOD });
        assert!(alone(good()).1.is_none());
        let decided = decide(vec![good(), odd(), odd(), odd()], &held_out(&[2.0, 0.5, 0.5, 0.5]));
        assert!(
            matches!(decided[0].reason, Some(Reason::Improbable { cost: Cost::Company(_), .. })),
            "{:?}",
            decided[0].reason
        );
        // of many effects one that deviates says little
        let mut many = vec![odd()];
        many.extend((0..9).map(|_| good()));
        let decided = decide(many, &held_out(&[1.0; 10]));
        assert!(decided[1].is_declared() && decided[1].probability > 0.9);
        assert!(matches!(decided[0].reason, Some(Reason::Improbable { cost: Cost::Between(_), .. })));
    }

    #[test]
    fn rivals_share_the_probability_and_what_was_pruned_keeps_a_tenth() {
        let rival = Evidence {
            share: 0.5,
            group_share: 1.0,
            rivals: vec![(Label::new("wear", "x"), 1.0)],
            ..effect(500.0, GOOD)
        };
        let decided = decide(vec![rival], &held_out(&[2.0]));
        let x = &decided[0];
        assert!(x.is_declared() && (x.probability - 0.5 * x.group_probability).abs() < 1e-12);
        assert!((x.alternatives[0].1 - x.probability).abs() < 1e-12);
        let pruned = Evidence { is_pruned: true, ..effect(500.0, GOOD) };
        let (p, reason) = alone(pruned);
        assert!(p < 0.15 && reason == Some(Reason::Worse));
    }

    #[test]
    fn what_makes_readings_left_out_worse_is_taken_back_and_the_rest_stays() {
        let two = || vec![effect(500.0, GOOD), effect(500.0, GOOD)];
        let both = decide(two(), &held_out(&[2.0, 1.5]));
        assert!(both.iter().all(super::Assessed::is_declared));
        let one = decide(two(), &held_out(&[2.0, 0.2]));
        assert!(one[0].is_declared());
        let Some(Reason::HeldOut { with_um, without_um }) = one[1].reason else {
            panic!("{:?}", one[1].reason)
        };
        assert!((with_um.powi(2) - (10.0 - 4.0 + 1.0 - 0.4 + 1.0)).abs() < 1e-9 && without_um < with_um);
    }

    fn likely(label: usize) -> Contender {
        Contender {
            label,
            variant: 0,
            probability: 0.99,
            group_probability: 0.99,
            rivals: Vec::new(),
            sums: Vec::new(),
            aliases: Vec::new(),
            chosen: true,
            log_evidence: 200.0,
            own_um2: 1.0,
            beside_um2: 0.0,
        }
    }

    #[test]
    fn a_likely_effect_whose_correction_makes_the_gap_larger_is_not_declared() {
        let contenders = [likely(0), likely(1)];
        let all = || contenders.iter().map(|c| (effect(400.0, Figures::UNASKED), c)).collect();
        let both = decide_by_posterior(all(), &held_out(&[2.0, 1.5]), 0.0);
        assert!(both.iter().all(super::Assessed::is_declared));
        // a part of the gap that drift takes back
        let one = decide_by_posterior(all(), &held_out(&[2.0, 0.3]), 0.0);
        assert!(one[0].is_declared());
        assert!(matches!(one[1].reason, Some(Reason::Harms { with_um, without_um }) if with_um > without_um));
    }

    #[test]
    fn what_is_small_beside_a_discrepancy_may_be_a_part_of_it() {
        let beside = |um2: f64, discrepancy: f64| {
            let contender = Contender { beside_um2: um2, ..likely(0) };
            let rival = (Label::new("wear", "x"), 0.5);
            let e = Evidence { rivals: vec![rival], ..effect(400.0, Figures::UNASKED) };
            decide_by_posterior(vec![(e, &contender)], &held_out(&[2.0]), discrepancy).swap_remove(0)
        };
        let all = [0.0, 0.1, 0.5, 2.0, 100.0].map(|um2| beside(um2, 1.0));
        assert!(all.is_sorted_by(|a, b| a.probability > b.probability), "{all:?}");
        for x in &all {
            assert!((x.group_probability - x.probability).abs() < 1e-12);
            assert!((x.alternatives[0].1 - 0.5 * x.probability).abs() < 1e-12);
        }
        assert!((all[0].probability - 1.0).abs() < 1e-12 && all[4].probability < 0.2, "{all:?}");
        assert!(beside(0.9, 1.0).is_declared() && !beside(4.0, 1.0).is_declared());
        // whether there is a discrepancy may be open
        assert!(beside(4.0, 0.3).is_declared() && beside(4.0, 0.3).probability < 0.9);
        let Some(Reason::Improbable { cost: Cost::Discrepancy(um), .. }) = beside(4.0, 1.0).reason else {
            panic!("{:?}", beside(4.0, 1.0).reason)
        };
        assert_eq!(um, 2.0);
    }
}
