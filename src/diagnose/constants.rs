//! The constants of the diagnosis: meaning, source, and what moves when one is halved or doubled. Grids of the library stand with
//! their effects.

/// Log odds of an effect in campaigns of several programs.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Calibration {
    /// Log odds of an effect without evidence.
    pub(crate) base: f64,
    /// Per unit of the logarithm of the evidence.
    pub(crate) evidence: f64,
    /// Per unit of the deviation between parts, relative to the effect.
    pub(crate) between: f64,
    /// Per unit of the deviation from its formula beyond [`DEVIATION_EXPECTED`], relative to the effect.
    pub(crate) misform: f64,
    /// Per unit of the cosine with what the others do, where it is negative.
    pub(crate) against: f64,
}

/// Logistic regression over blind cases of two generators, judged on a third one (docs/development/ablation.md). `between` or
/// `misform` halved: names of effects outside the library; doubled: effects that vary over the volume are not declared.
pub(crate) const CALIBRATION: Calibration =
    Calibration { base: -2.5, evidence: 0.84, between: 5.5, misform: 9.0, against: 4.4 };
/// Group probability from which an effect is declared. Halved: one more wrong name in three; doubled: nothing.
pub(crate) const DECLARED: f64 = 0.6;
/// Own probability from which it is: below, its name is one of many. Halved: little; doubled: one of three clocks goes unnamed.
pub(crate) const NAMED: f64 = 0.15;
/// What is left of a probability where a pattern forbids an effect: one in ten of those was at work in blind cases.
pub(crate) const UNSURE: f64 = 0.1;
/// Least probability of what was chosen, and of what is listed: in blind cases one in thirty of those that fail is at work.
pub(crate) const LEAST_PROBABILITY: f64 = 0.03;
/// Mean relative deviation of an effect before anything is known (exponential prior): what nothing shows twice counts by it.
/// Halved: one program is believed like many; doubled: what only one program shows is not declared.
pub(crate) const DEVIATION_EXPECTED: f64 = 0.25;
/// Relative deviations over which the likelihood is averaged; a finer ladder changes nothing.
pub(crate) const DEVIATIONS: [f64; 7] = [0.0, 0.1, 0.2, 0.35, 0.7, 1.0, 1.4];
/// Evidence is divided by one plus this share of the gain: no model is exact. The second where the variation over the volume
/// stands among the noise. Halved: rivals with nearly the same column are excluded; doubled: more set answers.
pub(crate) const INEXACT: [f64; 2] = [0.008, 0.001];
/// Share of its gain that a swapped effect must keep to count as the same column. Nearer to 1: fewer set answers.
pub(crate) const SAME: f64 = 0.97;
/// The same for a table of positions and a worn place of one axis, whose form nobody knows so well.
pub(crate) const CURVE_SAME: f64 = 0.85;
/// Share below which something is little beside something else: what a table says beside a worn place, where an effect acts, the
/// forecast shrink that explains anything, the chance that there is no discrepancy, readings that may be wild. Halved: worn places
/// become tables; doubled: single curves are taken for worn places.
pub(crate) const LITTLE: f64 = 0.05;
/// Standard deviations from which a value is sure of its sign. Halved: rams whose weights are small are refused.
pub(crate) const SURE: f64 = 3.0;
/// Standard deviations of a sum over all readings from which it is no chance, and size in those of the noise from which an effect
/// is large. Halved: heavy tails are called unexplained.
pub(crate) const SIGNIFICANT: f64 = 5.0;
/// Fewest products from which structure is told. Halved: nothing changes in the generators; doubled: small setups stay silent.
pub(crate) const COUNT_MIN: usize = 20;
/// Least share of a column that offsets, rotation and drift of the mounting must leave.
pub(crate) const SEEN: f64 = 1e-4;
/// Drift, in standard deviations of the noise, from which it is something to explain. Halved: every tracker drifts.
pub(crate) const LARGE_DRIFT: f64 = 1.7;
/// Random draws of an interval: 400 leave its ends sure to 0.2 of a standard deviation.
pub(crate) const DRAWS: usize = 400;
/// Most outlying readings listed in the report.
pub(crate) const LISTED: usize = 40;
/// Standard deviations on either side of an interval of 90 %.
pub(crate) const NINETY: f64 = 1.645;

// Comparison of all sets of effects (sessions of one program).

/// Programs up to which the comparison is exact.
pub(crate) const PROGRAMS_MAX: usize = 1;
/// Readings that carry the comparison. Halved: effects below some 3 standard deviations are lost in long captures. Doubled:
/// eight times the time.
pub(crate) const ROWS_MAX: usize = 200;
/// Correlation lengths of the discrepancy, as shares of the travel seen. At most a quarter: a longer one is itself a scale or
/// a straightness and takes the cause's place.
pub(crate) const LENGTHS: [f64; 2] = [0.08, 0.25];
/// Correlation times of the drift, as shares of the longest setup.
pub(crate) const TIMES: [f64; 3] = [0.03, 0.3, 3.0];
/// Scales of each component of the covariance, in standard deviations of the white noise.
pub(crate) const NOISE_SCALES: [f64; 8] = [0.0, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0];
/// Log prior of a component that is not zero against one that is.
pub(crate) const PRESENT: f64 = -1.0;
/// Scales of the effect sizes, in standard deviations of the white noise.
pub(crate) const EFFECT_SCALES: [f64; 5] = [1.0, 4.0, 16.0, 64.0, 256.0];
/// Distinct places of an axis from which direction and place together may form a discrepancy: with fewer, a width per place is
/// a backlash that varies, and stays among lack of fit.
pub(crate) const PLACES_MIN: usize = 12;
/// Steps of the ascent over the scales of the covariance.
pub(crate) const ASCENT_MAX: usize = 12;
/// Components at zero that are tried in one step, those whose likelihood rises most steeply.
pub(crate) const ASCENDED: usize = 3;
/// Log evidence below the best at which a set of effects no longer counts.
pub(crate) const WINDOW: f64 = 7.0;
/// Sets of effects whose neighbours are visited.
pub(crate) const EXPANDED: usize = 12;
/// Effects in one set.
pub(crate) const SET_MAX: usize = 8;
/// Standard deviations of a leave-one-out residual from which a reading counts less.
pub(crate) const TAIL: f64 = 3.5;
/// One minus the cosine below which two columns are one.
pub(crate) const ALIKE: f64 = 1e-6;
/// Probability from which another effect is named as one that the data do not exclude.
pub(crate) const RIVAL: f64 = 0.03;
/// Rounds of sets and scales in turn.
pub(crate) const SETTLING_MAX: usize = 4;
/// Repetitions from which each may have an offset of its own.
pub(crate) const CYCLES_MIN: usize = 3;
/// Place among the scales at which the misform of effects begins in a search of its own.
pub(crate) const MISFORM_RUNG: usize = 2;
