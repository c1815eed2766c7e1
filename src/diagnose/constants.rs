//! The figures of the method that are chosen and neither derived nor measured: meaning, source, and what moves when one is halved
//! or doubled (where no run is cited: by reasoning). A rule takes its limit from the first section; one of its own needs a
//! verdict that changes without it (docs/development/ablation.md). Grids of non-linear parameters live with their effects
//! (`volcomp_effects::library`).

use super::noise::ClassNoise;

// Limits of every rule

/// Standard deviations from which a value is sure of its sign, and a leave-one-out residual counts less. Halved: rams whose weights
/// are small are refused.
pub(crate) const SURE: f64 = 3.0;
/// Standard deviations from which a value is no chance: a sum over all readings, an effect that is large; robust ones at which
/// single values are clipped (normal noise loses nothing). Halved: heavy tails are called unexplained.
pub(crate) const SIGNIFICANT: f64 = 5.0;
/// Twice a log-likelihood, or a log evidence, by which one description is preferred: drift, variation over the volume, a line in a
/// spectrum, a set of effects. Strong to very strong (Kass, Raftery 1995). Halved: drift below the noise passes for effects;
/// doubled: slow effects are swallowed.
pub(crate) const STRONG: f64 = 8.0;
/// Share below which something is little beside something else: what a table says beside a worn place, where an effect acts, the
/// forecast shrink that explains anything, the chance that there is no discrepancy, readings that may be outliers, what is left of the
/// probability of an effect that makes readings left out worse. Halved: worn places become tables; doubled: single curves
/// are taken for worn places.
pub(crate) const LITTLE: f64 = 0.05;
/// Share (or cosine) from which one thing says nearly what another says: a swapped effect, one in the place of two, two directions,
/// lines of a table. Nearer to 1: fewer set answers, circles without neighbours.
pub(crate) const NEARLY: f64 = 1.0 - LITTLE;
/// Share from which a part matters beside the rest of a whole.
pub(crate) const HALF: f64 = 0.5;
/// Share of a column or an eigenvalue below which it is a numerical combination of the others. Ten times smaller or larger: nothing.
pub(crate) const DEGENERATE: f64 = 1e-6;
/// Fewest values from which a scatter is estimated: its standard uncertainty is then 20 %, 1/sqrt(2 n). Halved: noise and
/// outlier limits of small classes off by 30 %; doubled: classes below 24 readings fall back on coarser estimates.
pub(crate) const FEW: usize = 12;
/// Fewest values from which a spectrum, a power law or a pattern is estimated: 10 %. Halved: chance lines and powers in
/// captures below 48; doubled: short captures say nothing of vibration.
pub(crate) const MANY: usize = 4 * FEW;
/// Repeats that know a slow change or a scatter of their own. Halved: two repeats close in time hide a drift; doubled: ISO 230-2
/// tests of five passes do not count.
pub(crate) const REPEATS: usize = 3;
/// Rounds of two estimates that depend on each other.
pub(crate) const ROUNDS: usize = 3;
/// Candidates that are refined, those that come nearest.
pub(crate) const TRIED: usize = 3;
/// Effects of one session, candidates and partners looked at in turn, steps of an ascent, bins of a factor: bounds the work.
pub(crate) const MOST: usize = 12;
/// Blocks of runs over which the agreement of an effect is judged. Twelve: a capture of a real drive, one program, loses its inertial
/// effects.
pub(crate) const BLOCKS_MIN: usize = 8;
/// Share of a column's size that is added to its own product when a fold is left out. A tenth of it: the same.
pub(crate) const FOLD_RIDGE: f64 = 1e-5;
/// Travel that makes an axis one that moves, mm and rad; a change of tool length or range that shows their effects.
pub(crate) const MOVES: [f64; 2] = [1.0, 0.01];

// Decision

/// Log odds of an effect in campaigns of several programs.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Calibration {
    /// Log odds of an effect without evidence.
    pub(crate) base: f64,
    /// Per unit of the logarithm of the evidence.
    pub(crate) evidence: f64,
    /// Per unit of its own deviation: between parts, or from its formula beyond [`DEVIATION_EXPECTED`].
    pub(crate) deviation: f64,
    /// Per unit of the mean deviation, with the variation over the volume, of all effects chosen in the session.
    pub(crate) session: f64,
    /// Per unit of the cosine with what the others do, where it is negative.
    pub(crate) against: f64,
}

/// Logistic regression over 892 claims in campaigns of three generators (docs/development/ablation.md), moved to values by which what differs by
/// most of itself from program to program is no cause: a second lag of a real capture, a spike in the place of a reversal error. `evidence`
/// halved: a quarter of the names lost; doubled: seven times those of effects outside the library. `session` halved: twice those; doubled:
/// one name in sixteen lost.
pub(crate) const CALIBRATION: Calibration =
    Calibration { base: -1.0, evidence: 0.8, deviation: 4.0, session: 6.0, against: 5.0 };
/// Group probability from which an effect is declared. Halved: one more wrong name in three; doubled: nothing.
pub(crate) const DECLARED: f64 = 0.6;
/// Own probability from which it is: below, its name is one of many. Halved: little; doubled: one of three clocks goes unnamed.
pub(crate) const NAMED: f64 = 0.15;
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
/// Share of its gain that a swapped curve must keep where one is a table of positions and the other a worn place of the same axis,
/// whose form nobody knows so well.
pub(crate) const CURVE_SAME: f64 = 0.85;
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
pub(crate) const PROGRAMS_MAX: usize = 2;
/// Readings that carry the comparison. Halved: effects below some 3 standard deviations are lost in long captures. Doubled:
/// eight times the time.
pub(crate) const ROWS_MAX: usize = 200;
/// Odds that what a formula says is a part of what no formula says, where it is small beside it; what is as large is declared only
/// just. Halved: a third more wrong names where something outside the library is at work; doubled: the scales of a real plate, and
/// the backlash of a real axis whose width varies, are doubted.
pub(crate) const ALIASED: f64 = 5.0;
/// Correlation lengths of the discrepancy, as shares of the travel seen. At most a quarter: a longer one is itself a scale or
/// a straightness and takes the cause's place.
pub(crate) const LENGTHS: [f64; 2] = [0.08, 0.25];
/// Correlation times of the drift, as shares of the longest setup.
pub(crate) const TIMES: [f64; 3] = [0.03, 0.3, 3.0];
/// Scales of each component of the covariance, in standard deviations of the white noise.
pub(crate) const NOISE_SCALES: [f64; 8] = [0.0, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0];
/// Scales of the effect sizes, in standard deviations of the white noise; a random process has all of them, other effects every
/// second one. Halved: a table of 15 values between two of them loses up to 10 in log evidence, and a worn place takes a part of it.
pub(crate) const EFFECT_SCALES: [f64; 9] = [1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0, 256.0];
/// Place among the scales at which the misform of effects begins in a search of its own.
pub(crate) const MISFORM_RUNG: usize = 2;
/// Highest place among the scales of a discrepancy over the place where each setup moves one axis: half the white noise.
pub(crate) const NAMED_RUNG: usize = 1;

// Size of the sample

/// Readings looked at where the cost grows faster than their number. Source: 6,000 readings in 2 s. Halved: noise of large
/// sessions 1.4 times less certain; doubled: up to four times the time.
pub(crate) const ROWS: usize = 4000;

// False alarms

/// Robust standard deviations from which a reading is an outlier; the shoulders of the noise begin at half of it, the far
/// tails at twice it (`TAILS` is tabulated for these three). Halved: tails of normal noise are left out; doubled: outliers widen the noise.
pub(crate) const OUTLYING: f64 = 5.5;
/// Probability of a line in the spectrum of noise alone. Halved or doubled: lines within 2 % of the limit in power.
pub(crate) const LINE_CHANCE: f64 = 1e-5;

// Directions and places

/// Smallest component of the direction of measurement along an axis that it sees. Halved or doubled: effects of an axis that
/// only oblique readings see are searched for or not.
pub(crate) const SEES: f64 = 0.2;
/// Share of a whole below which a part is not told: of the gap at a place, of the gap that is rounding, of a probability, of the
/// noise that a further effect explains or that varies, of the shrink that a forecast can promise. Halved or doubled: length of
/// the report.
pub(crate) const TOLD: f64 = 0.02;

// Decimals

/// What the last decimal of a file may hide, um: files have four decimals. Halved: no step is found in files of three;
/// doubled: steps below 6 nm are none.
pub(crate) const DECIMALS_UM: f64 = 1.5e-4;
/// Least step, in such decimals: below, everything is a multiple. Halved: steps by chance; doubled: 5 nm encoders are not seen
/// as such.
pub(crate) const STEP_DECIMALS: f64 = 20.0;
/// Noise below this share of the gap is not believed: files are rounded and models are never perfect. Halved or doubled: only
/// sessions without noise.
pub(crate) const NOISE_SHARE: f64 = 1e-3;

// Motion

/// Samples further apart than this are readings at standstill, s, unless the rows say that they move. Halved: logs at 10 Hz have
/// no velocities; doubled: readings with short dwells get false ones.
pub(crate) const FAST_S: f64 = 0.12;
/// The same where a column says that the machine moves, unless the path between the samples is known.
pub(crate) const FAST_MOVING_S: f64 = 5.0 * FAST_S;
/// Change of a velocity from sample to sample, relative or in rad, up to which the path between them is known: 12 samples per turn
/// of a circle. Halved: circles of 12 to 25 samples per turn stand still; doubled: readings here and there are a path.
pub(crate) const BEND: f64 = 0.55;
/// Samples of a circle stay within this share of its radius: 0.15 mm of 150 mm. Halved or doubled: only circles of measured
/// positions, or with few decimals.
pub(crate) const ON_CIRCLE: f64 = 1e-3;
/// Least arc, rad, a quadrant. Halved: slightly bent lines are circles; doubled: partial circles of a quadrant are not.
pub(crate) const ARC: f64 = 0.49 * core::f64::consts::PI;
/// Error of an acceleration by the rounding of positions that is accepted, mm/s^2 or deg/s^2. Halved: accelerations are
/// smoothed over more samples; doubled: they scatter.
pub(crate) const ACCELERATION_NOISE: f64 = 10.0;
/// Slower than this is standstill to a vibration, mm/s and rad/s. Halved: encoder noise counts as motion; doubled: creeping
/// readings count as rest.
pub(crate) const CREEP: f64 = 0.05;
/// Lowest frequency of a vibration of a machine, Hz: the rigid-body modes of its mounts lie at 2 to 30 Hz. What is slower is
/// drift, and readings too slow for it show vibration as noise. Halved: drift of captures is called vibration; doubled: soft
/// mounts are not found.
pub(crate) const LOWEST_HZ: f64 = 1.0;

// Chance effects

/// Their least share of all readings. Halved or doubled: rare dropouts in sessions above 5,000 readings.
pub(crate) const OUTLIERS_SHARE: f64 = 0.0015;
/// Outliers are a cause where they are this many times as many as heavy tails of the noise would bring, and this many standard
/// deviations more, and so many. Halved: heavy tails are called outliers; doubled: outliers in heavy-tailed noise are not named.
pub(crate) const BEYOND_TAILS: [f64; 3] = [2.0, 3.0, 5.0];
/// Share of the outliers that look along one axis, and share of all others that do not, from which that axis is to blame.
/// Halved: mixed outliers are blamed on an axis; doubled: no meaning (at most 1).
pub(crate) const ONE_AXIS: [f64; 2] = [0.9, 0.6];
/// Least step that is called rounding, um. Halved or doubled: displays of 10 to 40 nm.
pub(crate) const STEP_UM: f64 = 0.02;
/// Probability of a chance effect that has passed its test, and of one whose pattern contradicts it; neither is a posterior.
/// Halved or doubled: the probability printed.
pub(crate) const PASSED: [f64; 2] = [0.95, 0.3];

// Plans and programs

/// Noise that is assumed before anything is measured: white, drift, um, and the drift's time, s. Halved or doubled: nothing but
/// the share of drift in what a plan sees.
pub(crate) const ASSUMED: ClassNoise = ClassNoise { white_um: 1.0, drift_um: 0.6, drift_s: 600.0 };
/// Share of the travel below which an axis is seen in part only, where a line may be the slope of a curve. Halved: scales over
/// half of a travel are believed; doubled: no meaning.
pub(crate) const WHOLE: f64 = 0.75;

/// Physical bounds of the input: what is beyond them is in another unit.
pub(crate) mod bounds {
    /// RMS of deviations, um: below the first or above the last they cannot be in um, outside the inner two they are odd.
    pub(crate) const DEVIATION_UM: [f64; 4] = [0.03, 0.2, 500.0, 50_000.0];
    /// Scatter of a setup, um: above it only the lag of servos (encoders) and the rotation of a frame (trackers) remain.
    pub(crate) const SCATTER_UM: f64 = 3000.0;
    /// Setups whose deviations differ by this factor are in two units (1000 apart).
    pub(crate) const TWO_UNITS: f64 = 300.0;
    /// Travel of a machine, mm.
    pub(crate) const TRAVEL_MM: [f64; 2] = [2.0, 60_000.0];
    /// Shortest tool, mm.
    pub(crate) const TOOL_MM: f64 = 5.0;
    /// Temperatures, degC: nearer to zero or hotter.
    pub(crate) const DEGC: [f64; 2] = [2.0, 200.0];
    /// Time between readings of a run, s.
    pub(crate) const STEP_S: f64 = 1000.0;
    /// Pause within a file that is odd (a week), and that only two clocks explain (a year), s.
    pub(crate) const PAUSE_S: [f64; 2] = [7.0 * 86_400.0, 3.2e7];
    /// Speed between readings, mm/s.
    pub(crate) const SPEED_MM_PER_S: f64 = 5000.0;
}
