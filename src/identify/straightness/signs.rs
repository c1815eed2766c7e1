//! From the six channels of an instrument to the axes of the machine: sign table, parity, tilt test.
//!
//! A set-up of the instrument assigns each channel a direction of the machine with a sign. Directions follow from
//! looking at the set-up; the signs of the angles do not. Where the instrument is right-handed, its angles follow its
//! lengths like those of any frame: a change of axes D takes lengths by D and angles by det(D) D. The *parity* of
//! a channel pair (distance and roll, horizontal and pitch, vertical and yaw) is the sign by which the angle differs
//! from that. It belongs to the instrument, not to the set-up: all set-ups of one instrument must have the same, a
//! right-handed one has (+, +, +). A table with another parity is either wrong or that of an instrument that is not
//! right-handed (as in table 2 of 004), and only a tilt test can tell.
//!
//! A tilt test applies known small rotations (and, where wanted, displacements) and compares: each channel must follow
//! one of them with a gain near +1 or -1.
//!
//! Source: equations 4.4 (table 2), 8 (decision 11).

use crate::prelude::*;

/// A channel of the instrument.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Channel {
    /// Along the beam, measured minus target.
    Distance,
    /// Sideways, horizontal as the instrument calls it.
    Horizontal,
    /// Sideways, vertical as the instrument calls it.
    Vertical,
    /// About the beam.
    Roll,
    /// About the horizontal direction.
    Pitch,
    /// About the vertical direction.
    Yaw,
}

impl Channel {
    /// All six; an angle stands three behind the length about whose direction it turns.
    pub const ALL: [Self; 6] =
        [Self::Distance, Self::Horizontal, Self::Vertical, Self::Roll, Self::Pitch, Self::Yaw];

    /// Its name in files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Distance => "distance",
            Self::Horizontal => "horizontal",
            Self::Vertical => "vertical",
            Self::Roll => "roll",
            Self::Pitch => "pitch",
            Self::Yaw => "yaw",
        }
    }

    /// True for roll, pitch, yaw.
    #[must_use]
    pub const fn is_angle(self) -> bool {
        matches!(self, Self::Roll | Self::Pitch | Self::Yaw)
    }
}

/// What a channel measures: a component, with the sign of its reading.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Assignment {
    /// Direction in the machine.
    pub component: Component,
    /// True where the reading has the opposite sign.
    pub negative: bool,
}

impl Assignment {
    /// Reads `+x`, `-b`.
    #[must_use]
    pub fn parse(text: &str) -> Option<Self> {
        let mut chars = text.trim().chars();
        let negative = match chars.next()? {
            '+' => false,
            '-' | '\u{2212}' => true,
            _ => return None,
        };
        let component = Component::from_letter(chars.next()?)?;
        chars.next().is_none().then_some(Self { component, negative })
    }

    /// +1 or -1.
    #[must_use]
    pub const fn sign(self) -> f64 {
        if self.negative { -1.0 } else { 1.0 }
    }
}

impl core::fmt::Display for Assignment {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let sign = if self.negative { '-' } else { '+' };
        write!(f, "{sign}{}", self.component.letter().to_ascii_lowercase())
    }
}

/// The assignments of one set-up; `None` for a channel that the instrument does not have.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SignTable {
    /// In the order of [`Channel::ALL`].
    pub channels: [Option<Assignment>; 6],
}

/// Sign of each angle against a right-handed frame, where the table says enough.
pub type Parity = [Option<bool>; 3];

/// Why a table is no mapping.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum SignError {
    /// A length on an angle or the other way round.
    #[error("{} is assigned {assignment}: {}", channel.name(), if channel.is_angle() { "an angle takes a, b or c" } else { "a length takes x, y or z" })]
    Kind {
        /// The channel.
        channel: Channel,
        /// What it was assigned.
        assignment: Assignment,
    },
    /// Two channels on one component.
    #[error("{} and {} are both assigned {}; a mapping takes every direction once", first.name(), second.name(), component.letter().to_ascii_lowercase())]
    Twice {
        /// One channel.
        first: Channel,
        /// The other.
        second: Channel,
        /// The component.
        component: Component,
    },
    /// The beam does not run along the axis.
    #[error("distance is assigned {assignment}, but axis {axis} is measured: the beam runs along the axis, write +{0} or -{0}", axis.lower())]
    Beam {
        /// What it was assigned.
        assignment: Assignment,
        /// The axis.
        axis: AxisName,
    },
    /// An angle about another direction than its partner's.
    #[error("{} is assigned {assignment}, {} is along {along}: {0} turns about that direction", angle.name(), length.name())]
    Partner {
        /// The angle.
        angle: Channel,
        /// What it was assigned.
        assignment: Assignment,
        /// Its partner.
        length: Channel,
        /// The partner's direction.
        along: Assignment,
    },
}

impl SignTable {
    /// Checks that the table maps the channels properly for a run of `axis`.
    ///
    /// # Errors
    /// The first entry that is impossible.
    pub fn check(&self, axis: AxisName) -> Result<(), SignError> {
        for (i, channel) in Channel::ALL.into_iter().enumerate() {
            let Some(assignment) = self.channels[i] else { continue };
            if assignment.component.is_angle() != channel.is_angle() {
                return Err(SignError::Kind { channel, assignment });
            }
            for (j, other) in Channel::ALL.into_iter().enumerate().take(i) {
                if self.channels[j].is_some_and(|o| o.component == assignment.component) {
                    return Err(SignError::Twice {
                        first: other,
                        second: channel,
                        component: assignment.component,
                    });
                }
            }
        }
        if let Some(assignment) = self.channels[0].filter(|a| a.component.index() != axis.direction()) {
            return Err(SignError::Beam { assignment, axis });
        }
        if let Some(assignment) = self.channels[3].filter(|a| a.component.index() != axis.direction() + 3) {
            let along = Assignment { component: Component::ALL[axis.direction()], negative: false };
            return Err(SignError::Partner {
                angle: Channel::Roll,
                assignment,
                length: Channel::Distance,
                along: self.channels[0].unwrap_or(along),
            });
        }
        for i in 0..3 {
            let (Some(along), Some(assignment)) = (self.channels[i], self.channels[i + 3]) else { continue };
            if assignment.component.index() != along.component.index() + 3 {
                let (angle, length) = (Channel::ALL[i + 3], Channel::ALL[i]);
                return Err(SignError::Partner { angle, assignment, length, along });
            }
        }
        Ok(())
    }

    /// True where an angle has the sign of a right-handed frame.
    ///
    /// The sign of a missing length is taken as that of a right-handed instrument would be only where nothing depends on
    /// it: without all three lengths there is no parity.
    #[must_use]
    pub fn parity(&self) -> Parity {
        let [Some(a), Some(b), Some(c), ..] = self.channels else { return [None; 3] };
        let index = [a, b, c].map(|x| x.component.index());
        let even = matches!(index, [0, 1, 2] | [1, 2, 0] | [2, 0, 1]);
        let negatives = [a, b, c].iter().filter(|x| x.negative).count();
        let determinant = even == (negatives % 2 == 0);
        std::array::from_fn(|i| {
            let (length, angle) = (self.channels[i]?, self.channels[i + 3]?);
            Some((length.negative == angle.negative) == determinant)
        })
    }

    /// Takes in what a tilt test found.
    ///
    /// # Errors
    /// The first channel that the table assigns otherwise, with its assignment there and what was found.
    pub fn confirm(
        &mut self,
        found: &[Option<TiltFound>; 6],
    ) -> Result<(), (Channel, Assignment, TiltFound)> {
        for ((channel, slot), f) in Channel::ALL.into_iter().zip(&mut self.channels).zip(found) {
            match (*slot, f) {
                (Some(a), Some(f)) if a != f.assignment => return Err((channel, a, *f)),
                (_, Some(f)) => *slot = Some(f.assignment),
                (_, None) => {}
            }
        }
        Ok(())
    }

    /// The angles that would turn against a right-handed frame.
    pub fn left_handed(&self) -> impl Iterator<Item = Channel> + use<> {
        Channel::ALL.into_iter().skip(3).zip(self.parity()).filter(|(_, p)| *p == Some(false)).map(|(c, _)| c)
    }

    /// True where every angle that can be judged is right-handed.
    #[must_use]
    pub fn is_right_handed(&self) -> bool {
        self.left_handed().next().is_none()
    }

    /// Channel readings to EX EY EZ EA EB EC; components without a channel are `None`.
    #[must_use]
    pub fn apply(&self, readings: &[f64; 6]) -> [Option<f64>; 6] {
        let mut motion = [None; 6];
        for (assignment, reading) in self.channels.iter().zip(readings) {
            if let Some(a) = assignment {
                motion[a.component.index()] = Some(a.sign() * reading);
            }
        }
        motion
    }
}

/// One state of a tilt test: what was applied (EX .. EC, mm and rad) and what the channels said.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TiltReading {
    /// Applied motion; components that were not applied are 0 throughout.
    pub applied: [f64; 6],
    /// Channels in the order of [`Channel::ALL`].
    pub channels: [f64; 6],
}

/// What a tilt test says about one channel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TiltFound {
    /// Component and sign.
    pub assignment: Assignment,
    /// Reading over applied motion, absolute.
    pub gain: f64,
    /// Standard deviation of `gain`.
    pub gain_std: f64,
}

/// Why a tilt test determines nothing.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum TiltError {
    /// Too few states.
    #[error(
        "{found} states, {components} applied components need at least {needed}; apply each tilt both ways and return to zero"
    )]
    TooFew {
        /// States.
        found: usize,
        /// Components that were applied.
        components: usize,
        /// States needed.
        needed: usize,
    },
    /// The applied motions are confounded.
    #[error("the applied motions are not independent (condition {condition:.1e}, limit {limit:.0e}); apply them one after the other", limit = TILT_CONDITION_LIMIT)]
    NotIndependent {
        /// Condition number.
        condition: f64,
    },
    /// A tilt that was not applied.
    #[error("no tilt about {} was applied, so the sign of {} stays unknown; tilt about all three directions", about.letter().to_ascii_lowercase(), channel.name())]
    NotApplied {
        /// The channel.
        channel: Channel,
        /// The missing rotation.
        about: Component,
    },
    /// A channel follows none of the applied motions, or several.
    #[error("{} follows no applied motion: largest gain {gain:.2} +- {gain_std:.2} (must be 0.7 to 1.3 in size and 5 times its uncertainty), next {second:.2} (must be below 0.3)", channel.name())]
    NoResponse {
        /// The channel.
        channel: Channel,
        /// Its largest gain.
        gain: f64,
        /// Its uncertainty.
        gain_std: f64,
        /// The second largest gain.
        second: f64,
    },
}

/// Condition number of the applied motions above which they are not told apart.
pub const TILT_CONDITION_LIMIT: f64 = 100.0;

/// Which component each channel follows; angles about the three directions must all be applied where the instrument
/// has the channel. Lengths are judged where displacements were applied, else left out.
///
/// # Errors
/// The test does not determine the channels.
pub fn tilt_test(readings: &[TiltReading], has: [bool; 6]) -> Result<[Option<TiltFound>; 6], TiltError> {
    let n = readings.len();
    let mean = |f: &dyn Fn(&TiltReading) -> f64| readings.iter().map(f).sum::<f64>() / n.max(1) as f64;
    let applied: Vec<(usize, f64)> = (0..6)
        .map(|c| (c, mean(&|r| r.applied[c])))
        .filter(|(c, m)| readings.iter().any(|r| (r.applied[*c] - m).abs() > 0.0))
        .collect();
    for (i, channel) in Channel::ALL.into_iter().enumerate().filter(|(i, _)| has[*i]) {
        if channel.is_angle()
            && let Some(c) = (3..6).find(|c| !applied.iter().any(|(a, _)| a == c))
        {
            return Err(TiltError::NotApplied { channel: Channel::ALL[i], about: Component::ALL[c] });
        }
    }
    let needed = applied.len() + 2;
    if n < needed || applied.is_empty() {
        return Err(TiltError::TooFew { found: n, components: applied.len(), needed });
    }
    let scale = |c: usize, m: f64| {
        (readings.iter().map(|r| (r.applied[c] - m).powi(2)).sum::<f64>() / n as f64).sqrt()
    };
    let scales: Vec<f64> = applied.iter().map(|&(c, m)| scale(c, m)).collect();
    let design = DMatrix::from_fn(n, applied.len(), |row, k| {
        let (c, m) = applied[k];
        (readings[row].applied[c] - m) / scales[k]
    });
    let svd = design.clone().svd(true, true);
    let (high, low) = (svd.singular_values.max(), svd.singular_values.min());
    let condition = if low > 0.0 { high / low } else { f64::INFINITY };
    if condition > TILT_CONDITION_LIMIT {
        return Err(TiltError::NotIndependent { condition });
    }
    let mut found = [None; 6];
    for (i, channel) in Channel::ALL.into_iter().enumerate().filter(|(i, _)| has[*i]) {
        let same: Vec<usize> =
            (0..applied.len()).filter(|k| (applied[*k].0 >= 3) == channel.is_angle()).collect();
        if same.is_empty() {
            continue;
        }
        let centre = mean(&|r| r.channels[i]);
        let seen = DVector::from_fn(n, |row, _| readings[row].channels[i] - centre);
        let Ok(gains) = svd.solve(&seen, 0.0) else { continue };
        let rest = &seen - &design * &gains;
        let sigma = (rest.norm_squared() / (n - applied.len() - 1) as f64).sqrt();
        let mut sorted: Vec<(f64, usize)> = same.iter().map(|&k| (gains[k] / scales[k], k)).collect();
        sorted.sort_by(|a, b| b.0.abs().total_cmp(&a.0.abs()));
        let (gain, k) = sorted[0];
        let second = sorted.get(1).map_or(0.0, |s| s.0);
        // the smallest singular value bounds the uncertainty of every gain
        let gain_std = sigma / (low * scales[k]);
        if !((0.7..=1.3).contains(&gain.abs()) && gain.abs() > 5.0 * gain_std && second.abs() < 0.3) {
            return Err(TiltError::NoResponse { channel, gain, gain_std, second });
        }
        let assignment = Assignment { component: Component::ALL[applied[k].0], negative: gain < 0.0 };
        found[i] = Some(TiltFound { assignment, gain: gain.abs(), gain_std });
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;
    use volcomp_units::RAD_PER_ARCSEC;

    fn table(text: [&str; 6]) -> SignTable {
        SignTable { channels: text.map(Assignment::parse) }
    }

    /// Every proper mapping of a right-handed instrument onto axis X.
    fn proper() -> Vec<SignTable> {
        let mut all = Vec::new();
        for (h, v) in [("y", "z"), ("z", "y")] {
            for signs in 0..8u32 {
                let sign = |k: u32| if signs >> k & 1 == 1 { "-" } else { "+" };
                let lengths = [format!("{}x", sign(0)), format!("{}{h}", sign(1)), format!("{}{v}", sign(2))];
                let odd = (h == "z") != (signs.count_ones() % 2 == 1);
                let angle = |t: &String| {
                    let flip = (t.starts_with('-')) != odd;
                    let letter = match &t[1..] {
                        "x" => 'a',
                        "y" => 'b',
                        _ => 'c',
                    };
                    format!("{}{letter}", if flip { '-' } else { '+' })
                };
                let angles = [angle(&lengths[0]), angle(&lengths[1]), angle(&lengths[2])];
                all.push(table([&lengths[0], &lengths[1], &lengths[2], &angles[0], &angles[1], &angles[2]]));
            }
        }
        all
    }

    #[test]
    fn all_set_ups_of_a_right_handed_instrument_are_right_handed() {
        for t in proper() {
            t.check(AxisName::X).unwrap();
            assert_eq!(t.parity(), [Some(true); 3], "{t:?}");
            let mut wrong = t;
            if let Some(a) = wrong.channels[4].as_mut() {
                a.negative = !a.negative;
            }
            assert_eq!(wrong.parity(), [Some(true), Some(false), Some(true)]);
        }
        // table 2 of 004: + + + for lengths, - - + for yaw, pitch, roll
        let paper = table(["+x", "+y", "+z", "+a", "-b", "-c"]);
        paper.check(AxisName::X).unwrap();
        assert!(!paper.is_right_handed());
        assert_eq!(paper.parity(), [Some(true), Some(false), Some(false)]);
        // without roll the others are still judged, without a length nothing is
        assert_eq!(table(["+x", "+y", "+z", "", "+b", "+c"]).parity(), [None, Some(true), Some(true)]);
        assert_eq!(table(["+x", "+y", "", "+a", "+b", "+c"]).parity(), [None; 3]);
    }

    #[test]
    fn improper_mappings_are_refused() {
        for (text, message) in [
            (["+x", "+y", "+y", "+a", "+b", "+c"], "horizontal and vertical are both assigned y"),
            (["+x", "+y", "+b", "+a", "", "+c"], "vertical is assigned +b: a length takes x, y or z"),
            (["+y", "+x", "+z", "+b", "+a", "+c"], "the beam runs along the axis, write +x or -x"),
            (["+x", "+y", "+z", "+a", "-c", "+b"], "pitch is assigned -c, horizontal is along +y"),
            (["", "+y", "+z", "+b", "", "+c"], "roll is assigned +b, distance is along +x"),
        ] {
            let error = table(text).check(AxisName::X).unwrap_err().to_string();
            assert!(error.contains(message), "{error}");
        }
        assert_eq!(Assignment::parse("x"), None);
        assert_eq!(Assignment::parse("+xy"), None);
    }

    /// Tilts about each direction both ways as an instrument of `truth` reads them, with 0.2 arcsec of noise that
    /// alternates.
    fn tilts(truth: &SignTable, about: &[usize]) -> Vec<TiltReading> {
        let mut all = Vec::new();
        let noise = 0.2 * RAD_PER_ARCSEC;
        for &c in about {
            for tilt in [0.0, 20.0, 0.0, -20.0] {
                let mut applied = [0.0; 6];
                applied[c] = if c < 3 { tilt * 1e-3 } else { tilt * RAD_PER_ARCSEC };
                let channels = std::array::from_fn(|i| {
                    let wiggle = if (all.len() + i) % 2 == 0 { noise } else { -noise };
                    truth.channels[i].map_or(0.0, |a| a.sign() * applied[a.component.index()] + wiggle)
                });
                all.push(TiltReading { applied, channels });
            }
        }
        all
    }

    #[test]
    fn a_tilt_test_finds_every_table() {
        for truth in proper().into_iter().chain([table(["+x", "+y", "+z", "+a", "-b", "-c"])]) {
            let found = tilt_test(&tilts(&truth, &[0, 1, 2, 3, 4, 5]), [true; 6]).unwrap();
            for (f, t) in found.iter().zip(truth.channels) {
                assert_eq!(f.map(|f| f.assignment), t);
                assert!((f.unwrap().gain - 1.0).abs() < 0.1);
            }
            let angles = tilt_test(&tilts(&truth, &[3, 4, 5]), [true; 6]).unwrap();
            assert!(angles[..3].iter().all(Option::is_none) && angles[3..].iter().all(Option::is_some));
        }
    }

    #[test]
    fn a_tilt_test_that_says_too_little_is_refused() {
        let truth = table(["+x", "+y", "+z", "+a", "+b", "+c"]);
        let e = tilt_test(&tilts(&truth, &[3, 4]), [true; 6]).unwrap_err();
        assert_eq!(e, TiltError::NotApplied { channel: Channel::Roll, about: Component::C });
        assert!(matches!(tilt_test(&[], [false; 6]), Err(TiltError::TooFew { .. })));
        let mut deaf = tilts(&truth, &[3, 4, 5]);
        for r in &mut deaf {
            r.channels[4] = 0.1 * r.applied[4];
        }
        let e = tilt_test(&deaf, [true; 6]).unwrap_err();
        assert!(matches!(e, TiltError::NoResponse { channel: Channel::Pitch, .. }), "{e}");
        let mut tied = tilts(&truth, &[3, 4, 5]);
        for r in &mut tied {
            r.applied[4] = r.applied[3];
        }
        assert!(matches!(tilt_test(&tied, [true; 6]), Err(TiltError::NotIndependent { .. })));
    }
}
