//! A 5-DOF laser along an axis: what its live readings differ by from the stored curves of that axis.
//!
//! A laser does not know where its zero and its straight line are: each straightness is free by an offset and a slope,
//! each angle by an offset, roll from detectors by a slope as well, because beams that are not parallel look like roll
//! that grows. These are found while the axis goes through its travel for the first time, each part of the travel as it was
//! seen last, so that it does not matter where the axis rests meanwhile:
//!
//! - [`LaserAlignment::StoredCurves`]: a least-squares fit to the stored curves. What the readings differ by from then on is
//!   change.
//! - [`LaserAlignment::EndPoint`]: straightness is zero at both ends of the travel, an angle at home (or at the end nearest to
//!   it), roll rises by what a level says. The readings are absolute: they replace the stored curves.
//!
//! The difference from the stored curves is smoothed with a first-order lag and added to them as a live value, so that a
//! laser that drops out leaves them as they are (the engine fades to them).
//!
//! Pointing drift is taken out by the reduction ([`crate::fivedof`]). Reference points of the stored
//! curves and of the laser must be the same.
//!
//! Source: equations 5.2, 1.4 (sense), 1.8 and 5.6 (which line is a convention); paper 002, 3.4 (absolute readings).

use crate::fivedof::to_machine;
use volcomp_model::axes::{AxisName, Travel};
use volcomp_model::{Component, ErrorFunction, ErrorSymbol, ModelSpec, Sense};

/// Parts of the travel that are ticked off as seen.
const PARTS: usize = 20;
/// Share of the travel within which an end counts as reached.
const END_SHARE: f64 = 0.005;
/// Readings of one part that count.
const PART_READINGS: f64 = 50.0;
/// Way within which an axis rests, mm: its own corrections and its encoder's noise.
const REST_MM: f64 = 0.05;
/// Growth of the time constant per time of rest: what was read in motion is forgotten with the square of the time.
const REST_GROWTH: f64 = 0.5;

/// What the readings of a laser refer to.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum LaserAlignment {
    /// The stored curves: the laser tells what has changed since the first pass.
    #[default]
    StoredCurves,
    /// The end points of the travel: the laser tells the error motions themselves.
    EndPoint {
        /// Change of roll of the carriage from the lower to the upper end of the travel by a level, rad.
        roll_rise: f64,
    },
}

/// How a laser becomes live values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LaserRules {
    /// Time constant of smoothing, s.
    pub smooth_s: f64,
    /// What it grows to while the axis rests, s.
    pub rest_smooth_s: f64,
    /// Share of the travel that must have been seen before the alignment counts as known.
    pub reference_share: f64,
    /// What the readings refer to.
    pub alignment: LaserAlignment,
    /// Roll has an unknown slope.
    pub is_raw: bool,
}

/// One error that the laser corrects.
#[derive(Debug, Clone, PartialEq)]
struct Lane {
    /// Live value of the model.
    channel: usize,
    /// Index in EX EY EZ EA EB EC.
    component: usize,
    curves: ErrorFunction,
    kind: LaneKind,
    /// Sums of 1, u, u^2, d, u d over the last time in each part of the travel.
    sums: [[f64; 5]; PARTS],
    line: Option<[f64; 2]>,
    value: Option<f64>,
}

/// What is unknown of an error motion.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum LaneKind {
    /// Offset and slope.
    Straightness,
    /// Offset; of readings of detectors a slope as well.
    Roll,
    /// Offset.
    Tilt,
}

/// The laser of one axis.
#[derive(Debug, Clone, PartialEq)]
pub struct AxisLaser {
    axis: AxisName,
    /// Index of the axis in the chain.
    index: usize,
    travel: [f64; 2],
    /// Stored curves are carriage motions over the carriage's own displacement.
    inverted: bool,
    /// Sign from carriage motion to the stored sense.
    sign: f64,
    rules: LaserRules,
    /// Home as a share of the travel, within it.
    home: f64,
    seen: [bool; PARTS],
    /// The ends of the travel were reached.
    ends: [bool; 2],
    /// Part of the travel in which the axis is.
    part: Option<usize>,
    /// Where the axis rests, mm, and for how long, s.
    rest: (f64, f64),
    lanes: Vec<Lane>,
}

impl AxisLaser {
    /// The laser of `axis`, whose live values are `channels` (index and symbol). `None` where the axis has no travel.
    #[must_use]
    pub fn new(
        spec: &ModelSpec,
        axis: AxisName,
        channels: &[(usize, ErrorSymbol)],
        rules: LaserRules,
    ) -> Option<Self> {
        let index = spec.chain.index_of(axis)?;
        let entry = spec.axis(axis);
        let travel @ [low, high] = entry.travel?;
        let workpiece = spec.is_workpiece_side(axis);
        let carriage = entry.sense == Sense::Carriage;
        let lanes = channels
            .iter()
            .map(|(channel, symbol)| Lane {
                channel: *channel,
                component: symbol.component().index(),
                curves: spec
                    .errors
                    .iter()
                    .find(|(s, _)| s == symbol)
                    .map(|(_, f)| f.clone())
                    .unwrap_or_default(),
                kind: match symbol.component().index() {
                    0..=2 => LaneKind::Straightness,
                    c if c == 3 + axis.direction() => LaneKind::Roll,
                    _ => LaneKind::Tilt,
                },
                sums: [[0.0; 5]; PARTS],
                line: None,
                value: None,
            })
            .collect();
        Some(Self {
            axis,
            index,
            travel,
            home: (-low / (high - low)).clamp(0.0, 1.0),
            inverted: workpiece && carriage,
            // equations 1.4: relative is minus carriage where primed
            sign: if workpiece && !carriage { -1.0 } else { 1.0 },
            rules,
            seen: [false; PARTS],
            ends: [false; 2],
            part: None,
            rest: (f64::INFINITY, 0.0),
            lanes,
        })
    }

    /// The axis' place in the chain.
    #[must_use]
    pub const fn index(&self) -> usize {
        self.index
    }

    /// A reading (EY EZ EA EB EC in laser coordinates) with the axis at `q`, `dt` after the one before.
    pub fn take(&mut self, q: f64, travel: Travel, motion: [f64; 5], dt: f64) {
        let machine = to_machine(self.axis, motion);
        let [low, high] = self.travel;
        let u = (q - low) / (high - low);
        let smooth_s = self.time_constant_s(q, dt);
        let share = if smooth_s > 0.0 { 1.0 - (-dt.max(0.0) / smooth_s).exp() } else { 1.0 };
        let part = ((u.clamp(0.0, 1.0) * PARTS as f64) as usize).min(PARTS - 1);
        let entered = self.part != Some(part);
        self.seen[part] = true;
        self.ends = [self.ends[0] || u <= END_SHARE, self.ends[1] || u >= 1.0 - END_SHARE];
        self.part = Some(part);
        let known = self.is_seen();
        let (x, travel) = if self.inverted { (-q, travel.reversed()) } else { (q, travel) };
        for lane in &mut self.lanes {
            let stored = lane.curves.value(x, travel);
            let measured = self.sign * machine[lane.component];
            let difference = measured - stored;
            match lane.line {
                None => {
                    let aligned = match self.rules.alignment {
                        LaserAlignment::StoredCurves => difference,
                        LaserAlignment::EndPoint { .. } => measured,
                    };
                    let terms = [1.0, u, u * u, aligned, u * aligned];
                    let sums = &mut lane.sums[part];
                    if entered {
                        *sums = [0.0; 5];
                    } else if sums[0] >= PART_READINGS {
                        // an axis that rests in a part is known as it was last
                        sums.iter_mut().for_each(|sum| *sum *= 1.0 - 1.0 / PART_READINGS);
                    }
                    sums.iter_mut().zip(terms).for_each(|(sum, term)| *sum += term);
                    if known {
                        lane.line = match self.rules.alignment {
                            LaserAlignment::StoredCurves => lane.fit(self.rules.is_raw),
                            LaserAlignment::EndPoint { roll_rise } => {
                                lane.ends(self.home, self.sign * roll_rise)
                            }
                        };
                    }
                }
                Some([offset, slope]) => {
                    let change = difference - offset - slope * u;
                    let before = lane.value.unwrap_or(0.0);
                    lane.value = Some(before + share * (change - before));
                }
            }
        }
    }

    /// Time constant of smoothing with the axis at `q`, `dt` after the reading before: it grows while the axis rests.
    fn time_constant_s(&mut self, q: f64, dt: f64) -> f64 {
        let LaserRules { smooth_s, rest_smooth_s, .. } = self.rules;
        let (place, rested_s) = self.rest;
        self.rest = if (q - place).abs() <= REST_MM { (place, rested_s + dt.max(0.0)) } else { (q, 0.0) };
        (smooth_s + REST_GROWTH * self.rest.1).min(rest_smooth_s.max(smooth_s))
    }

    /// True where enough of the travel was seen to find the alignment.
    fn is_seen(&self) -> bool {
        let needs_ends = matches!(self.rules.alignment, LaserAlignment::EndPoint { .. });
        self.coverage() >= self.rules.reference_share && (self.ends == [true; 2] || !needs_ends)
    }

    /// Share of the travel that was seen, 0 to 1.
    #[must_use]
    pub fn coverage(&self) -> f64 {
        self.seen.iter().filter(|s| **s).count() as f64 / PARTS as f64
    }

    /// True once the alignment is known.
    #[must_use]
    pub fn is_referenced(&self) -> bool {
        self.lanes.iter().all(|lane| lane.line.is_some())
    }

    /// Live values: channel, and what to add to the stored curve there.
    pub fn values(&self) -> impl Iterator<Item = (usize, f64)> + '_ {
        self.lanes.iter().filter_map(|lane| Some((lane.channel, lane.value?)))
    }

    /// The laser was moved or away: its alignment must be found anew.
    pub fn forget(&mut self) {
        (self.seen, self.ends, self.part) = ([false; PARTS], [false; 2], None);
        for lane in &mut self.lanes {
            lane.sums = [[0.0; 5]; PARTS];
            (lane.line, lane.value) = (None, None);
        }
    }
}

impl Lane {
    /// Offset and slope by least squares; no slope for angles, but for roll of detectors.
    fn fit(&self, is_raw: bool) -> Option<[f64; 2]> {
        let mut mean = [0.0; 5];
        for part in self.sums.iter().filter(|part| part[0] > 0.0) {
            mean.iter_mut().zip(part).for_each(|(sum, term)| *sum += term / part[0]);
        }
        let [n, u, uu, d, ud] = mean;
        let has_slope = match self.kind {
            LaneKind::Straightness => true,
            LaneKind::Roll => is_raw,
            LaneKind::Tilt => false,
        };
        if !has_slope {
            return (n > 0.0).then(|| [d / n, 0.0]);
        }
        let determinant = n * uu - u * u;
        (determinant > 1e-9 * n * n)
            .then(|| [(uu * d - u * ud) / determinant, (n * ud - u * d) / determinant])
    }

    /// Offset and slope that make a straightness zero at both ends of the travel, let roll rise by `roll_rise`, and make
    /// every angle zero at `home`.
    fn ends(&self, home: f64, roll_rise: f64) -> Option<[f64; 2]> {
        let ([u_low, low], [u_high, high]) = (self.near(0.0)?, self.near(1.0)?);
        let between = if u_high > u_low { (high - low) / (u_high - u_low) } else { 0.0 };
        let (slope, [u, zero]) = match self.kind {
            LaneKind::Straightness => (between, [u_low, low]),
            LaneKind::Roll => (between - roll_rise, self.near(home)?),
            LaneKind::Tilt => (0.0, self.near(home)?),
        };
        // roll that rises is zero at home, not where it was read
        let rise = if self.kind == LaneKind::Roll { roll_rise * (u - home) } else { 0.0 };
        Some([zero - rise - slope * u, slope])
    }

    /// The readings at `u` by the straight line through those of the part in which it lies, or of the nearest that was
    /// seen; of readings all at one place their mean there. Place and value.
    fn near(&self, u: f64) -> Option<[f64; 2]> {
        let middle = |part: usize| (part as f64 + 0.5) / PARTS as f64;
        let (_, part) = self
            .sums
            .iter()
            .enumerate()
            .filter(|(_, part)| part[0] > 0.0)
            .min_by(|(a, _), (b, _)| (middle(*a) - u).abs().total_cmp(&(middle(*b) - u).abs()))?;
        let [n, su, suu, sd, sud] = *part;
        let (mean_u, mean) = (su / n, sd / n);
        let spread = suu / n - mean_u * mean_u;
        let least = (0.1 / PARTS as f64).powi(2);
        if spread < least {
            return Some([mean_u, mean]);
        }
        let slope = (sud / n - mean_u * mean) / spread;
        Some([u, mean + slope * (u - mean_u)])
    }
}

/// The symbols that a laser along `axis` sees: the two straightnesses, roll, pitch, yaw.
#[must_use]
pub fn sees(axis: AxisName, symbol: ErrorSymbol) -> bool {
    let own = matches!(symbol, ErrorSymbol::Motion { axis: of, .. } if of == axis);
    let positioning = match symbol.component() {
        Component::X => axis.direction() == 0,
        Component::Y => axis.direction() == 1,
        Component::Z => axis.direction() == 2,
        _ => false,
    };
    own && !positioning
}

#[cfg(test)]
mod tests {
    use super::*;
    use volcomp_model::{AxisSpec, Chain, Curve};

    fn rules(smooth_s: f64, reference_share: f64) -> LaserRules {
        let alignment = LaserAlignment::StoredCurves;
        LaserRules { smooth_s, rest_smooth_s: smooth_s, reference_share, alignment, is_raw: false }
    }

    fn spec(primed: bool, sense: Sense) -> ModelSpec {
        let chain = if primed { "[w X' b Y Z t]" } else { "[w b X Y Z t]" };
        let mut spec = ModelSpec::new("m", Chain::parse(chain).unwrap());
        spec.axes.push(AxisSpec { travel: Some([0.0, 1000.0]), sense, ..AxisSpec::new(AxisName::X) });
        let eyx = ErrorSymbol::parse("eyx").unwrap();
        spec.errors.push((eyx, ErrorFunction::single(Curve::Constant(0.004))));
        spec
    }

    /// Runs to and fro; the machine's own change of EYX (relative sense) is 5 um, roll 1e-5, after two runs.
    fn run(primed: bool, sense: Sense) -> Vec<(usize, f64)> {
        let symbols = ["eyx", "eax"].map(|s| ErrorSymbol::parse(s).unwrap());
        let channels = [(3, symbols[0]), (7, symbols[1])];
        let mut laser =
            AxisLaser::new(&spec(primed, sense), AxisName::X, &channels, rules(0.5, 0.8)).unwrap();
        assert_eq!(laser.index(), 0);
        let carriage = if primed { -1.0 } else { 1.0 };
        for k in 0..400 {
            let q = 1000.0 * (1.0 - (f64::from(k) * 0.01 - 1.0).abs().rem_euclid(1.0));
            let changed = if k > 200 { 1.0 } else { 0.0 };
            // in the laser: offset 0.1 mm and 20 urad of misalignment
            let stored = if sense == Sense::Carriage { 0.004 } else { carriage * 0.004 };
            let ey = stored + carriage * 0.005 * changed + 0.1 + 2e-5 * q;
            let roll = carriage * 1e-5 * changed + 3e-4;
            laser.take(q, Travel::Forward, [ey, 0.0, roll, 0.0, 0.0], 0.1);
            assert!(laser.is_referenced() || laser.values().next().is_none());
        }
        laser.values().collect()
    }

    #[test]
    fn only_what_changed_after_the_first_pass_is_added_in_the_stored_sense() {
        for (primed, sense, sign) in
            [(false, Sense::Relative, 1.0), (true, Sense::Relative, 1.0), (true, Sense::Carriage, -1.0)]
        {
            let values = run(primed, sense);
            assert_eq!(values.len(), 2);
            assert_eq!((values[0].0, values[1].0), (3, 7));
            assert!((values[0].1 - sign * 0.005).abs() < 1e-6, "{primed} {sense:?} {values:?}");
            assert!((values[1].1 - sign * 1e-5).abs() < 1e-9, "{values:?}");
        }
    }

    #[test]
    fn a_laser_sees_everything_but_positioning() {
        let of = |s: &str| sees(AxisName::Y, ErrorSymbol::parse(s).unwrap());
        assert!(["exy", "ezy", "eay", "eby", "ecy"].iter().all(|s| of(s)));
        assert!(!of("eyy") && !of("exx") && !of("ec0y"));
    }

    #[test]
    fn where_the_axis_rests_while_it_is_referenced_does_not_matter() {
        let channels = ["eyx", "eax"].map(|s| ErrorSymbol::parse(s).unwrap());
        let channels = [(0, channels[0]), (1, channels[1])];
        let found = |rest: u32| -> Vec<f64> {
            let mut laser =
                AxisLaser::new(&spec(false, Sense::Relative), AxisName::X, &channels, rules(0.0, 1.0))
                    .unwrap();
            // bent by what neither offset nor slope can follow; resting at the beginning, still warming up there
            let bent = |q: f64| 0.004 + 1e-8 * (q - 500.0).powi(2);
            for k in 0..rest {
                let warm = 0.02 * (1.0 - f64::from(k) / f64::from(rest));
                laser.take(0.0, Travel::Forward, [bent(0.0) + warm, 0.0, 1e-4 + warm * 1e-3, 0.0, 0.0], 0.1);
            }
            for k in (0..1000).chain((0..1000).rev()) {
                let q = f64::from(k);
                laser.take(q, Travel::Forward, [bent(q), 0.0, 1e-4, 0.0, 0.0], 0.1);
            }
            laser.values().map(|(_, v)| v).collect()
        };
        for (straight, rested) in found(0).iter().zip(found(100_000)) {
            assert!((straight - rested).abs() < 1e-4, "{straight} {rested}");
        }
    }

    #[test]
    fn at_rest_noise_is_averaged_longer_and_motion_is_followed_as_before() {
        let channels = [(0, ErrorSymbol::parse("eyx").unwrap())];
        // standard deviation at rest after half a minute, and what is left of a step 5 s after the axis has moved
        let of = |rest_smooth_s: f64| -> [f64; 2] {
            let rules = LaserRules { rest_smooth_s, ..rules(0.5, 0.5) };
            let mut laser =
                AxisLaser::new(&spec(false, Sense::Relative), AxisName::X, &channels, rules).unwrap();
            let mut take = |q: f64, ey: f64| {
                laser.take(q, Travel::Forward, [0.004 + ey, 0.0, 0.0, 0.0, 0.0], 0.05);
                laser.values().next().map_or(0.0, |(_, v)| v)
            };
            for k in 0..200 {
                take(5.0 * f64::from(k), 0.0);
            }
            let mut squares = 0.0;
            for k in 0..3000_u32 {
                let noise = if k.wrapping_mul(2_654_435_761) >> 31 == 0 { 0.001 } else { -0.001 };
                let value = take(500.0, noise);
                squares += if k >= 600 { value * value } else { 0.0 };
            }
            take(900.0, 0.01);
            let left = (0..100).map(|_| take(900.0, 0.01)).last().unwrap() - 0.01;
            [(squares / 2400.0).sqrt(), left.abs()]
        };
        let ([short, _], [long, left]) = (of(0.5), of(20.0));
        assert!(long < 0.4 * short, "{long} {short}");
        assert!(left < 0.0005, "5 s after a step of 10 um: {left}");
    }

    #[test]
    fn what_was_forgotten_is_found_anew() {
        let channels = [(0, ErrorSymbol::parse("eyx").unwrap())];
        let mut laser =
            AxisLaser::new(&spec(false, Sense::Relative), AxisName::X, &channels, rules(0.0, 0.5)).unwrap();
        let pass = |laser: &mut AxisLaser, offset: f64| {
            for k in 0..100 {
                laser.take(10.0 * f64::from(k), Travel::Forward, [0.004 + offset, 0.0, 0.0, 0.0, 0.0], 0.1);
            }
        };
        pass(&mut laser, 0.0);
        assert!(laser.is_referenced() && laser.values().all(|(_, v)| v.abs() < 1e-12));
        laser.forget();
        assert!(!laser.is_referenced() && laser.values().next().is_none() && laser.coverage() == 0.0);
        pass(&mut laser, 1.0);
        assert!(laser.values().all(|(_, v)| v.abs() < 1e-12));
    }

    #[test]
    fn aligned_to_the_end_points_the_readings_are_absolute() {
        for (primed, sense, sign) in
            [(false, Sense::Relative, 1.0), (true, Sense::Relative, -1.0), (true, Sense::Carriage, 1.0)]
        {
            let channels: Vec<_> = ["eyx", "eax", "ebx"]
                .iter()
                .enumerate()
                .map(|(k, s)| (k, ErrorSymbol::parse(s).unwrap()))
                .collect();
            let rules = LaserRules {
                alignment: LaserAlignment::EndPoint { roll_rise: 4e-5 },
                is_raw: true,
                ..rules(0.0, 1.0)
            };
            let spec = spec(primed, sense);
            let mut laser = AxisLaser::new(&spec, AxisName::X, &channels, rules).unwrap();
            let read = |laser: &mut AxisLaser, q: f64| {
                let u = q / 1000.0;
                // in the laser: lines of its own, beams that are not parallel
                let (bow, roll, pitch) = (0.02 * u * (1.0 - u), 4e-5 * u, 3e-5 * u * u);
                let motion = [bow + 0.3 + 2e-4 * q, 0.0, roll + 1e-4 + 3e-4 * u, pitch - 5e-4, 0.0];
                laser.take(q, Travel::Forward, motion, 0.1);
                [bow, roll, pitch]
            };
            for k in 0..=1000 {
                read(&mut laser, f64::from(k));
            }
            let truth = read(&mut laser, 430.0);
            let values: Vec<f64> = laser.values().map(|(_, v)| v).collect();
            // the stored curve of EYX is 4 um: the live value leaves of it what the laser says
            for ((value, truth), stored) in values.iter().zip(truth).zip([0.004, 0.0, 0.0]) {
                // a straight line through a twentieth of the travel stands for the curve there
                let close = if stored > 0.0 { 3e-5 } else { 2e-7 };
                assert!(
                    (value + stored - sign * truth).abs() < close,
                    "{primed} {sense:?} {values:?} {truth}"
                );
            }
        }
    }
}
