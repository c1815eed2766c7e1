//! Causes of the deviations on ballbar circles, all effects at once by linear least squares.
//!
//! A plane has a first axis u and a second axis v (XY, YZ, ZX); the tool stands at `(R cos t, R sin t)` about the
//! centre, `d` = +1 from u towards v (counter-clockwise), -1 back, path speed F. A displacement `(du, dv)` of the tool
//! is seen as `du cos t + dv sin t`. Effects and what they add to the reading:
//!
//! | effect | positive means | column per unit |
//! |---|---|---|
//! | squareness, rad | the angle from u to v is above 90 deg | `-R sin t cos t` |
//! | scale mismatch, 1 | u moves too far against v | `R/2 cos 2t` |
//! | servo mismatch, s | u leads v (v's lag minus u's) | `-d F/2 sin 2t` |
//! | backlash of u, v, mm | lost motion: the axis turns back too late, a step outwards | `d/2 sgn(sin t) cos t w`, `-d/2 sgn(cos t) sin t w` |
//! | lateral play of u, v, mm | travel towards plus shifts the tool towards plus of the other axis | `-d/2 abs(sin t) w`, `d/2 abs(cos t) w` |
//! | straightness of u, v, mm | the middle of the line bows towards plus of the other axis | `sin^3 t`, `cos^3 t` |
//! | reversal spike, mm | outwards behind the reversal, height at its peak | `x exp(1 - x)`, x = time since the reversal over t0 |
//! | cyclic of u, v, mm | | `cos t`, `sin t` times sine and cosine of the coordinate over the pitch |
//!
//! `w = (1 +- cos t)/2` (v: `sin t`) leads from the value at the positive end of travel to that at the negative end. What
//! is seen of one end only is taken as equal all along. Where less is left so, backlash is crossed over its own width behind a reversal instead of
//! being a step there: times `2 min(1, s/b) - 1`, s = way of the axis since the reversal. Beside them: centre offset of the instrument, a radius per feed, and, where
//! both directions were run, whatever stands around a reversal alike in both of them (it is no spike); and a change of the
//! instrument's length, linear in time with steps between runs, where it is significant: it looks like play otherwise.
//!
//! Assumptions: first order (the eccentricity's second order is taken out); readings equally noisy. Residuals that are
//! not white widen the uncertainties by their autocorrelation along the circle, and by a wander in time that the directions do not share. What the data cannot show is left out and named, with
//! what it is confounded with.
//!
//! Source: names and units of ballbar files (.b5r, `docs/reference/formats.md`); ISO 230-4; equations 1.7. Reading order: this file, `columns`, `solve`,
//! `covariance`, `wander`, `pitch`, `model`.

mod check;
mod columns;
mod covariance;
mod features;
mod model;
mod pitch;
mod runs;
mod solve;
mod wander;

pub use features::Feature;
pub use model::{Assembled, assemble};
pub use runs::{cut_overshoot, run_starts, travelled, within_overshoot};
pub use solve::analyse;

use volcomp_units::axes::{AxisName, Travel};

/// Plane of a circle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Plane {
    /// From X towards Y.
    Xy,
    /// From Y towards Z.
    Yz,
    /// From Z towards X.
    Zx,
}

/// One reading. Angles rad, lengths mm, s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// Angle on the circle, from the first axis towards the second.
    pub angle: f64,
    /// Actual minus nominal length of the ballbar.
    pub deviation: f64,
    /// Sense of travel: forward from the first axis towards the second.
    pub travel: Travel,
    /// Path speed, mm/s, where known.
    pub feed: Option<f64>,
    /// Which run of the program.
    pub run: u32,
}

/// Circles of one plane in one mounting of the instrument, in the order they were taken.
#[derive(Debug, Clone, PartialEq)]
pub struct Circles {
    /// The plane.
    pub plane: Plane,
    /// Nominal radius, mm.
    pub radius: f64,
    /// Coordinates of the first and second axis at the centre, mm.
    pub centre: [f64; 2],
    /// The readings.
    pub samples: Vec<Sample>,
}

/// Pitch of a cyclic error.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Pitch {
    /// No cyclic error is looked for.
    #[default]
    None,
    /// Known, mm.
    Given(f64),
    /// Looked for within these limits, mm.
    Search([f64; 2]),
}

/// What is asked for.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Request {
    /// Pitch of the cyclic error of the first and second axis.
    pub pitch: [Pitch; 2],
    /// Time from a reversal to the peak of its spike, s; fitted where not given.
    pub spike_time: Option<f64>,
}

/// A cause; 0 is the first axis of the plane, 1 the second.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Effect {
    /// The angle between the axes.
    Squareness,
    /// The axes' scales differ.
    ScaleMismatch,
    /// The axes follow with different lags.
    ServoMismatch,
    /// Lost motion.
    Backlash(usize),
    /// Sideways shift on reversal.
    LateralPlay(usize),
    /// Bow of the line of motion.
    Straightness(usize),
    /// Friction at reversal.
    ReversalSpike(usize),
    /// Error that repeats with a pitch.
    Cyclic(usize),
}

/// The end of travel at which something holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum End {
    /// Largest coordinate.
    Positive,
    /// Smallest coordinate.
    Negative,
}

/// A number of an effect. Units as in the table above.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Value {
    /// Where it holds; `None` all over.
    pub end: Option<End>,
    /// The value.
    pub value: f64,
    /// Standard uncertainty (k = 1).
    pub std: f64,
}

/// An effect found.
#[derive(Debug, Clone, PartialEq)]
pub struct Estimate {
    /// Which.
    pub effect: Effect,
    /// Its numbers; of a cyclic error the peak-to-peak value, then sine and cosine amplitude.
    pub values: Vec<Value>,
    /// Range of what it adds to the circle, once centre and radius are taken out, mm.
    pub contribution: f64,
    /// Standard uncertainty of that.
    pub contribution_std: f64,
    /// Share of the sum of all contributions.
    pub share: f64,
    /// Whether it differs from zero with 99.9 % confidence.
    pub significant: bool,
    /// Effects that these data hardly tell from it (correlation above 0.9), strongest first.
    pub confounded: Vec<(Effect, f64)>,
}

/// Why an effect is not among the estimates.
#[derive(Debug, Clone, PartialEq)]
pub enum Reason {
    /// These data show it exactly like others that were kept.
    LooksLike(Vec<Effect>),
    /// It shows at a reversal that the path does not have, at one end of travel or at both, or between the readings.
    NoReversal(Option<End>),
    /// No pitch stands out; nothing above this amplitude, mm.
    NoPitch {
        /// Smallest amplitude that would have been seen.
        limit: f64,
    },
}

/// What the user should know.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Note {
    /// One direction only.
    OneDirection,
    /// One feed only: the servo mismatch is everything of its shape that changes sign with the direction.
    OneFeed,
    /// No feed: the servo mismatch has no value in ms.
    NoFeed,
    /// The residuals are not white: the uncertainties follow from their autocorrelation.
    NotWhite {
        /// Largest factor on a standard uncertainty against white noise.
        factor: f64,
    },
    /// An arc: what happens on the rest of the circle is unknown.
    Arc {
        /// Angle covered, rad.
        covered: f64,
    },
    /// Change of the instrument's length during the test.
    LengthChange(LengthChange),
}

/// Change of the length of the instrument along the runs, linear in time beside free steps between runs. Uniform growth of the
/// machine looks alike.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LengthChange {
    /// Over the time of all runs, without their pauses, mm.
    pub value: f64,
    /// Standard uncertainty (k = 1).
    pub std: f64,
    /// Probability of a larger one where there is none.
    pub p_value: f64,
    /// Whether it is significant (p below 0.01) and was estimated jointly with the effects; else it is no part of the fit.
    pub is_subtracted: bool,
}

/// Amplitude of a wave on the circle, mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Harmonic {
    /// Waves per turn.
    pub order: usize,
    /// In the readings, centre and radius taken out.
    pub measured: f64,
    /// In what no effect explains.
    pub residual: f64,
}

/// The result for one plane. Lengths mm, k = 1.
#[derive(Debug, Clone, PartialEq)]
pub struct Analysis {
    /// The plane.
    pub plane: Plane,
    /// Nominal radius.
    pub radius: f64,
    /// Coordinates of the axes at the centre.
    pub centre: [f64; 2],
    /// Offset of the instrument's centre with its uncertainty.
    pub offset: [(f64, f64); 2],
    /// Mean radius minus nominal radius per feed (mm/s) with its uncertainty: mean scale, or length of the instrument.
    pub radius_deviation: Vec<(Option<f64>, f64, f64)>,
    /// The effects, largest contribution first.
    pub estimates: Vec<Estimate>,
    /// Effects that are not among them.
    pub missing: Vec<(Effect, Reason)>,
    /// Pitch of the cyclic error of each axis where there is one.
    pub pitch: [Option<f64>; 2],
    /// Time from reversal to the peak of a spike, s (without feed: travelled angle, rad).
    pub spike_time: Option<f64>,
    /// Waves on the circle; empty on an arc.
    pub harmonics: Vec<Harmonic>,
    /// Change of the instrument's length during the test; `None` where these data do not show it: one run, or no time beside the effects.
    pub length_change: Option<LengthChange>,
    /// The readings of the fit, each with what no effect explains as its deviation; those at which an axis reverses are not among them.
    pub residuals: Vec<Sample>,
    /// Root mean square of it over the degrees of freedom.
    pub sigma: f64,
    /// Condition number of the columns, each of unit length.
    pub condition: f64,
    /// What the user should know.
    pub notes: Vec<Note>,
}

/// Why circles cannot be analysed.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum BallbarError {
    /// Too few readings.
    #[error("{found} of at least {needed} readings in plane {plane} (one per 3 degrees)")]
    TooFewReadings {
        /// The plane.
        plane: Plane,
        /// Readings found.
        found: usize,
        /// Readings needed.
        needed: usize,
    },
    /// A reading that is no number.
    #[error("reading {row} of plane {plane} is not finite")]
    NotFinite {
        /// The plane.
        plane: Plane,
        /// 1-based reading.
        row: usize,
    },
    /// The radius is none or smaller than the deviations.
    #[error(
        "radius {radius} mm is not above ten times the largest deviation, {deviation} mm; is its unit right?"
    )]
    Radius {
        /// The radius.
        radius: f64,
        /// Largest deviation.
        deviation: f64,
    },
    /// Too little of the circle.
    #[error(
        "plane {plane}: the readings cover {covered_deg:.0} deg; below {limit_deg:.0} deg centre, radius and shape are confounded"
    )]
    ArcTooShort {
        /// The plane.
        plane: Plane,
        /// Angle covered.
        covered_deg: f64,
        /// Least angle.
        limit_deg: f64,
    },
    /// A pitch, time or feed that is none.
    #[error("{what} is {value}; it must be above 0")]
    NotPositive {
        /// Which number.
        what: &'static str,
        /// Its value.
        value: f64,
    },
    /// Readings that have a feed beside readings that have none.
    #[error("some readings of plane {plane} have a feed and some have none; give it for all")]
    FeedMissing {
        /// The plane.
        plane: Plane,
    },
}

impl Plane {
    /// First and second axis.
    #[must_use]
    pub const fn axes(self) -> [AxisName; 2] {
        match self {
            Self::Xy => [AxisName::X, AxisName::Y],
            Self::Yz => [AxisName::Y, AxisName::Z],
            Self::Zx => [AxisName::Z, AxisName::X],
        }
    }

    /// Lower-case name, such as `xy`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Xy => "xy",
            Self::Yz => "yz",
            Self::Zx => "zx",
        }
    }

    /// The plane of a name in either case.
    #[must_use]
    pub fn parse(text: &str) -> Option<Self> {
        [Self::Xy, Self::Yz, Self::Zx].into_iter().find(|p| p.name().eq_ignore_ascii_case(text))
    }
}

impl core::fmt::Display for Plane {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(self.name())
    }
}

impl Effect {
    /// Name with subject, such as `backlash:x`, `straightness:eyx`, `squareness:xy`.
    #[must_use]
    pub fn name(self, plane: Plane) -> String {
        let axes = plane.axes();
        let of = |what: &str, a: usize| format!("{what}:{}", axes[a].lower());
        match self {
            Self::Squareness => format!("squareness:{plane}"),
            Self::ScaleMismatch => format!("scale-mismatch:{plane}"),
            Self::ServoMismatch => format!("servo-mismatch:{plane}"),
            Self::Backlash(a) => of("backlash", a),
            Self::LateralPlay(a) => of("lateral-play", a),
            Self::Straightness(a) => {
                format!("straightness:e{}{}", axes[1 - a].lower(), axes[a].lower())
            }
            Self::ReversalSpike(a) => of("reversal-spike", a),
            Self::Cyclic(a) => of("cyclic", a),
        }
    }
}

impl Analysis {
    /// The estimate of an effect.
    #[must_use]
    pub fn estimate(&self, effect: Effect) -> Option<&Estimate> {
        self.estimates.iter().find(|e| e.effect == effect)
    }

    /// The value of an effect at an end of travel, or all over.
    #[must_use]
    pub fn value(&self, effect: Effect, end: Option<End>) -> Option<Value> {
        self.estimate(effect)?.values.iter().find(|v| v.end == end).copied()
    }
}

#[cfg(test)]
mod tests;
