//! The gap from its size down to the noise, cause by cause, and what the correction of each cause alone achieves.
//!
//! Rule of combination: the share of a cause is its Shapley value of the mean square of the readings held out. For mean squares
//! that is the mean of what its correction takes out alone and of what it takes out beside all others, so the shares depend on
//! no order and add up to what all causes take out. What the causes leave is divided into noise, drift and the rest, in this
//! order. Where few readings were compared by evidence, the readings are those of the fit, and discrepancy and drift their
//! posterior means.

use super::super::Analysis;
use super::super::decision::Assessed;
use super::super::forecast::minus;
use super::super::offsets::{peak99, rms, without_offsets};
use super::super::report::{Cause, Value};
use super::super::session::Session;
use super::{Fitted, drift_rms, white_rms};

/// RMS and 99th percentile of the size of some readings, um.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Level {
    /// RMS.
    pub rms_um: f64,
    /// Size that 99 % of the readings do not exceed.
    pub peak99_um: f64,
}

/// A declared cause: its size and what its correction achieves on readings held out.
#[derive(Debug, Clone, PartialEq)]
pub struct Correction {
    /// `effect:subject`.
    pub label: String,
    /// RMS of the effect over the readings, um.
    pub size_um: Value,
    /// The gap where this cause alone is corrected.
    pub alone: Level,
    /// The gap where all other declared causes are corrected and this one is not.
    pub all_others: Level,
    /// The gap where this cause and all with a larger share are corrected.
    pub cumulative: Level,
    /// Its share of the mean square of the gap; negative where it compensates for more of another cause than it adds.
    pub share: f64,
}

/// The gap from its size down to the noise.
#[derive(Debug, Clone, PartialEq)]
pub struct Budget {
    /// The gap as measured.
    pub before: Level,
    /// The gap without all declared causes.
    pub after: Level,
    /// Part of `after` that is neither roughness of declared curves nor noise nor drift, RMS, um.
    pub unexplained_um: f64,
    /// Part that is roughness of declared curves, RMS, um.
    pub roughness_um: f64,
    /// Part that is drift, RMS, um.
    pub drift_um: f64,
    /// Part that is noise, RMS, um.
    pub noise_um: f64,
    /// Each declared cause, the largest share first.
    pub corrections: Vec<Correction>,
}

/// Shares of the mean square of the gap that no correction takes out: what is unexplained, roughness, drift and noise. With those of
/// the causes they add up to 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shares {
    /// Neither cause nor drift nor noise.
    pub unexplained: f64,
    /// Roughness of declared curves.
    pub roughness: f64,
    /// Drift.
    pub drift: f64,
    /// Noise.
    pub noise: f64,
}

impl Budget {
    /// The shares of what no cause explains.
    #[must_use]
    pub fn shares(&self) -> Shares {
        let of = |rms_um: f64| rms_um.powi(2) / self.before.rms_um.powi(2).max(1e-18);
        Shares {
            unexplained: of(self.unexplained_um),
            roughness: of(self.roughness_um),
            drift: of(self.drift_um),
            noise: of(self.noise_um),
        }
    }

    /// Causes in the order of their shares, largest first; those without one as they come, behind.
    #[must_use]
    pub fn sorted<'a>(&self, causes: impl Iterator<Item = &'a Cause>) -> Vec<&'a Cause> {
        let share = |c: &Cause| self.correction(&c.label()).map_or(f64::NEG_INFINITY, |x| x.share);
        let mut all: Vec<&Cause> = causes.collect();
        all.sort_by(|a, b| share(b).total_cmp(&share(a)));
        all
    }

    /// True where no cause is declared, so that what is left is the gap.
    #[must_use]
    pub const fn names_no_cause(&self) -> bool {
        self.corrections.is_empty()
    }

    /// What the correction of a declared cause achieves, by its label.
    #[must_use]
    pub fn correction(&self, label: &str) -> Option<&Correction> {
        self.corrections.iter().find(|c| c.label == label)
    }

    /// True where the correction of a declared cause makes readings held out worse once all others are corrected.
    #[must_use]
    pub fn does_harm(&self, label: &str) -> bool {
        self.correction(label).is_some_and(|c| c.all_others.rms_um < self.after.rms_um)
    }
}

/// A part program: readings of one setup, with the same moving axes, feed and tool.
#[derive(Debug, Clone, PartialEq)]
pub struct ProgramResidual {
    /// `file:setup`.
    pub setup: String,
    /// Instrument.
    pub instrument: String,
    /// Letters of the axes that move.
    pub axes: String,
    /// Fastest feed, mm/min; none at rest or where it is unknown.
    pub feed_mm_per_min: Option<f64>,
    /// Length of the tool, mm.
    pub tool_length_mm: Option<f64>,
    /// Readings used.
    pub readings: usize,
    /// RMS of the gap, um.
    pub before_um: f64,
    /// RMS of the gap without the declared causes, um.
    pub after_um: f64,
}

pub(super) fn budget(
    session: &Session,
    a: &Analysis,
    assessed: &[Assessed],
    fitted: &Fitted<'_>,
    (undeclared_um2, rough_um): (f64, f64),
) -> Budget {
    let level = |corrected: &[usize]| {
        let take = |j: usize| corrected.contains(&fitted.owner[j]);
        let left = without_offsets(session, &minus(&a.gap, &fitted.parts.held_out, take), &a.used);
        Level { rms_um: rms(&left), peak99_um: peak99(&left) }
    };
    let declared: Vec<usize> = (0..assessed.len()).filter(|p| assessed[*p].is_declared()).collect();
    let before = level(&[]);
    let after = level(&declared);
    let gap_um2 = before.rms_um.powi(2).max(f64::MIN_POSITIVE);
    let mut corrections: Vec<(usize, Correction)> = declared
        .iter()
        .map(|place| {
            let others: Vec<usize> = declared.iter().copied().filter(|p| p != place).collect();
            let (alone, all_others) = (level(&[*place]), level(&others));
            let taken = |from: Level, to: Level| from.rms_um.powi(2) - to.rms_um.powi(2);
            let correction = Correction {
                label: assessed[*place].label.to_string(),
                size_um: fitted.size_um(session, a, *place),
                alone,
                all_others,
                cumulative: after,
                share: 0.5 * (taken(before, alone) + taken(all_others, after)) / gap_um2,
            };
            (*place, correction)
        })
        .collect();
    corrections.sort_by(|a, b| b.1.share.total_cmp(&a.1.share));
    let order: Vec<usize> = corrections.iter().map(|c| c.0).collect();
    for (n, (_, correction)) in corrections.iter_mut().enumerate() {
        correction.cumulative = level(&order[..=n]);
    }
    let whole = after.rms_um.powi(2);
    let [unexplained, rough, drift, noise] = match &a.comparison {
        Some(c) => {
            let unexplained = (c.shares.discrepancy_um2 + c.finer_um2() + undeclared_um2).min(whole);
            let drift = c.shares.drift_um2.min(whole - unexplained);
            [unexplained, 0.0, drift, whole - unexplained - drift]
        }
        None => {
            let noise = white_rms(session, a).powi(2).min(whole);
            let drift = drift_rms(session, a).powi(2).min(whole - noise);
            let rough = rough_um.powi(2).min(whole - noise - drift);
            [whole - noise - drift - rough, rough, drift, noise]
        }
    }
    .map(|v| v.max(0.0).sqrt());
    Budget {
        before,
        after,
        unexplained_um: unexplained,
        roughness_um: rough,
        drift_um: drift,
        noise_um: noise,
        corrections: corrections.into_iter().map(|c| c.1).collect(),
    }
}

/// The gap of each part program before and after, the largest left first.
pub(super) fn programs(
    session: &Session,
    a: &Analysis,
    before: &[f64],
    after: &[f64],
) -> Vec<ProgramResidual> {
    let mut members: Vec<Vec<usize>> = vec![Vec::new(); a.problem.cells];
    for (place, cell) in a.problem.cell.iter().enumerate() {
        members[*cell].extend(a.filter.members_of(place));
    }
    let mut all: Vec<ProgramResidual> = members
        .iter()
        .filter_map(|rows| {
            let first = &session.readings[*rows.first()?];
            let of = |values: &[f64]| rms(&rows.iter().map(|i| values[*i]).collect::<Vec<_>>());
            let moves = |slot: usize, least: f64| {
                let positions = rows.iter().map(|i| session.moments[*i].position[slot]);
                let (low, high) =
                    positions.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), p| (l.min(p), h.max(p)));
                high - low > least
            };
            let axes =
                session.axes.iter().filter(|x| moves(x.slot(), if x.is_linear() { 1.0 } else { 0.01 }));
            let speed = |i: &usize| {
                (0..3)
                    .map(|k| session.moments[*i].velocity[k].powi(2))
                    .filter(|v| v.is_finite())
                    .sum::<f64>()
                    .sqrt()
            };
            let feed = 60.0 * rows.iter().map(speed).fold(0.0, f64::max);
            let tool = session.moments[rows[0]].tool_length_mm;
            Some(ProgramResidual {
                setup: session.setups[first.setup].clone(),
                instrument: session.instruments[first.instrument].clone(),
                axes: axes.map(|x| x.to_string().to_uppercase()).collect(),
                feed_mm_per_min: (feed > 0.1).then_some(feed),
                tool_length_mm: tool.is_finite().then_some(tool),
                readings: rows.len(),
                before_um: of(before),
                after_um: of(after),
            })
        })
        .collect();
    all.sort_by(|x, y| y.after_um.total_cmp(&x.after_um));
    all
}
