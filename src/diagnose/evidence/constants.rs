//! Constants of the comparison, each with its meaning and what moves when it is halved or doubled.

/// Programs up to which the comparison is exact.
pub const PROGRAMS_MAX: usize = 3;
/// Readings that carry the comparison. Halved: effects below some 3 standard deviations are lost in long captures. Doubled:
/// eight times the time.
pub const ROWS_MAX: usize = 300;
/// Correlation lengths of the discrepancy, as shares of the travel seen. At most a quarter: a longer one is itself a scale or
/// a straightness and takes the cause's place.
pub const LENGTHS: [f64; 2] = [0.08, 0.25];
/// Correlation times of the drift, as shares of the longest setup.
pub const TIMES: [f64; 3] = [0.03, 0.3, 3.0];
/// Scales of each component of the covariance, in standard deviations of the white noise.
pub const SCALES: [f64; 8] = [0.0, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0];
/// Log prior of a component that is not zero against one that is.
pub const PRESENT: f64 = -1.0;
/// Scales of the effect sizes, in standard deviations of the white noise.
pub const EFFECT_SCALES: [f64; 5] = [1.0, 4.0, 16.0, 64.0, 256.0];
/// Distinct places of an axis from which direction and place together may form a discrepancy: with fewer, a width per place is
/// a backlash that varies, and stays among lack of fit.
pub const PLACES_MIN: usize = 12;
/// Sweeps over the scales of the covariance.
pub const SWEEPS: usize = 3;
/// Log evidence below the best at which a set of effects no longer counts.
pub const WINDOW: f64 = 7.0;
/// Sets of effects whose neighbours are visited.
pub const EXPANDED: usize = 40;
/// Effects in one set.
pub const EFFECTS_MAX: usize = 8;
/// Standard deviations of a leave-one-out residual from which a reading counts less.
pub const TAIL: f64 = 3.5;
/// Largest share of the readings that may count less as outliers: more of them are a discrepancy.
pub const TAIL_SHARE: f64 = 0.05;
/// Least share of a column that offsets and rotation of the mounting must leave.
pub const SEEN: f64 = 1e-4;
/// One minus the cosine below which two columns are one.
pub const ALIKE: f64 = 1e-6;
