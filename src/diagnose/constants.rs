//! The figures of the method that are chosen and neither derived nor measured, with what depends on each. Grids of non-linear
//! parameters live with their effects (`volcomp_effects::library`).
//!
//! "Halved" and "doubled" say what moves (by reasoning, not by a run of each); of a bound of the input only its message moves.

use super::noise::ClassNoise;

// Size of the sample

/// Readings looked at where the cost grows faster than their number. Source: 6,000 readings in 2 s. Halved: noise of large
/// sessions 1.4 times less certain; doubled: up to four times the time.
pub(crate) const ROWS: usize = 4000;
/// Fewest values from which a scatter is estimated: its standard uncertainty is then 20 %, 1/sqrt(2 n). Halved: noise and
/// outlier limits of small classes off by 30 %; doubled: classes below 24 readings fall back on coarser estimates.
pub(crate) const FEW: usize = 12;
/// Fewest values from which a spectrum, a power law or a pattern is estimated: 10 %. Halved: chance lines and powers in
/// captures below 48; doubled: short captures say nothing of vibration.
pub(crate) const MANY: usize = 4 * FEW;

// False alarms

/// Standard deviations beyond which something is no chance: 3 in 10 million, in some thousand tests per session. Halved: false
/// places and false growth of noise with the range; doubled: both only where they are large.
pub(crate) const SURE: f64 = 5.0;
/// Robust standard deviations from which a reading is an outlier; the shoulders of the noise begin at half of it (`TAILS` is
/// tabulated for these two). Halved: tails of normal noise are left out; doubled: outliers widen the noise.
pub(crate) const OUTLYING: f64 = 5.5;
/// Robust standard deviations at which values are clipped: normal noise loses 0.006 %. Halved: noise 4 % too small;
/// doubled: single outliers count.
pub(crate) const CLIPPED: f64 = 4.0;
/// Probability of a line in the spectrum of noise alone. Halved or doubled: lines within 2 % of the limit in power.
pub(crate) const LINE_CHANCE: f64 = 1e-5;
/// Twice the log-likelihood by which a drift must be better than none: two parameters, chance 5 %. Halved: drift swallows
/// slow effects; doubled: drift below the noise passes for effects.
pub(crate) const DRIFT_GAIN: f64 = 6.0;
/// Twice the log-likelihood by which repeats contradict a drift: chance 0.7 %. Halved: the drift of a tracker is refused;
/// doubled: what comes back with every repeat passes for drift.
pub(crate) const CONTRADICTED: f64 = 10.0;
/// Repeats of a point that know its slow changes without the effects. Halved: two repeats close in time hide a drift; doubled:
/// ISO 230-2 tests of five passes do not count.
pub(crate) const REPEATS: usize = 3;

// Directions and places

/// Cosine from which two readings look the same way. Halved: a circle's readings are compared across directions (their
/// difference is no noise); closer to 1: circles have no neighbours.
pub(crate) const SAME_WAY: f64 = 0.9;
/// The same for a line or a hole of a table, where the direction stands still. Halved: a circle is one line; closer to 1: nothing.
pub(crate) const SAME_LINE: f64 = 0.99;
/// Smallest component of the direction of measurement along an axis that it sees. Halved or doubled: effects of an axis that
/// only oblique readings see are searched for or not.
pub(crate) const SEES: f64 = 0.2;
/// Share of a whole below which nothing is told of a part: of the gap at a place, of the gap that is rounding, of a
/// probability. Halved or doubled: length of the report.
pub(crate) const TOLD: f64 = 0.02;

// Decimals

/// What the last decimal of a file may hide, um: files have four decimals. Halved: no step is found in files of three;
/// doubled: steps below 6 nm are none.
pub(crate) const DECIMALS_UM: f64 = 1.5e-4;
/// How often each value of two must have been read to prove a step. Halved: chance; doubled: short logs of coarse displays have
/// no step.
pub(crate) const READ_EACH: usize = 40;
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
/// The same where a column says that the machine moves.
pub(crate) const FAST_MOVING_S: f64 = 5.0 * FAST_S;
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

/// Fewest readings left out that are a cause. Halved: two chips on a scale are a cause; doubled: rare dropouts are none.
pub(crate) const OUTLIERS_MIN: usize = 8;
/// Their least share of all readings. Halved or doubled: rare dropouts in sessions above 5,000 readings.
pub(crate) const OUTLIERS_SHARE: f64 = 0.0015;
/// Outliers are a cause where they are this many times as many as heavy tails of the noise would bring, and this many standard
/// deviations more, and so many. Halved: heavy tails are called outliers; doubled: outliers in heavy-tailed noise are not named.
pub(crate) const BEYOND_TAILS: [f64; 3] = [2.0, 3.0, 5.0];
/// Share of the outliers that look along one axis, and share of all others that do not, from which that axis is to blame.
/// Halved: mixed outliers are blamed on an axis; doubled: no meaning (at most 1).
pub(crate) const ONE_AXIS: [f64; 2] = [0.9, 0.6];
/// Standard deviations by which noise must grow with the range, and the least power. Halved: uneven noise is called range noise;
/// doubled: only long ranges show it.
pub(crate) const RANGE_GROWTH: [f64; 2] = [6.0, 0.2];
/// Log-likelihood from which the noise of a tracker's angles is a cause. Halved: named beside other noise; doubled: only trackers
/// with angles far above their length.
pub(crate) const ANGLE_EVIDENCE: f64 = 24.0;
/// Least step that is called rounding, um. Halved or doubled: displays of 10 to 40 nm.
pub(crate) const STEP_UM: f64 = 0.02;
/// Readings differ from one neighbour by less than this share of what they differ from the other where something has jumped.
/// Halved: jumps are called outliers; doubled: outliers beside each other are called jumps.
pub(crate) const ONE_SIDED: f64 = 0.4;
/// Size in standard deviations of the noise from which rounding and vibration are causes beside it: they then add 8 % and 1 %
/// to it (amplitude against standard deviation). Halved: both named where nobody sees them; doubled: only where they rule.
pub(crate) const BESIDE_NOISE: f64 = 0.4;
/// Probability of a chance effect that has passed its test, and of one whose pattern contradicts it; neither is a posterior.
/// Halved or doubled: the probability printed.
pub(crate) const PASSED: [f64; 2] = [0.95, 0.3];

// Plans and programs

/// Noise that is assumed before anything is measured: white, drift, um, and the drift's time, s. Halved or doubled: nothing but
/// the share of drift in what a plan sees.
pub(crate) const ASSUMED: ClassNoise = ClassNoise { white_um: 1.0, drift_um: 0.6, drift_s: 600.0 };
/// Overlap from which two effects are one to a plan. Halved: all polynomials are one; doubled: no meaning (at most 1).
pub(crate) const SAME: f64 = 0.95;
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
