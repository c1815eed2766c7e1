//! A 5-DOF laser along an axis: what its live readings differ by from the stored curves of that axis.
//!
//! A laser does not know where its zero and its straight line are: each straightness is free by an offset and a slope,
//! each angle by an offset. While the axis goes through its travel for the first time these are fitted to the stored
//! curves by least squares, each part of the travel with the same weight and as it was seen last, so that it does not
//! matter where the axis rests meanwhile; once enough of the travel has been seen they are fixed, and what the readings
//! differ by from then on is change. It is smoothed with a first-order lag and added to the stored curves as a live value, so
//! that a laser that drops out leaves them as they are (the engine fades to them).
//!
//! Pointing drift is taken out by the reduction ([`crate::fivedof`]). Reference points of the stored
//! curves and of the laser must be the same.
//!
//! Source: equations 5.2, 1.4 (sense), 5.6 (which line is a convention).

use crate::fivedof::to_machine;
use volcomp_model::axes::{AxisName, Travel};
use volcomp_model::{Component, ErrorFunction, ErrorSymbol, ModelSpec, Sense};

/// Parts of the travel that are ticked off as seen.
const PARTS: usize = 20;
/// Readings of one part that count.
const PART_READINGS: f64 = 50.0;

/// One error that the laser corrects.
#[derive(Debug, Clone, PartialEq)]
struct Lane {
    /// Live value of the model.
    channel: usize,
    /// Index in EX EY EZ EA EB EC.
    component: usize,
    curves: ErrorFunction,
    /// An angle is free by an offset only.
    slope: bool,
    /// Sums of 1, u, u^2, d, u d over the last time in each part of the travel.
    sums: [[f64; 5]; PARTS],
    line: Option<[f64; 2]>,
    value: Option<f64>,
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
    smooth_s: f64,
    share: f64,
    seen: [bool; PARTS],
    /// Part of the travel in which the axis is.
    part: Option<usize>,
    lanes: Vec<Lane>,
}

impl AxisLaser {
    /// The laser of `axis`, whose live values are `channels` (index and symbol). `None` where the axis has no travel.
    #[must_use]
    pub fn new(
        spec: &ModelSpec,
        axis: AxisName,
        channels: &[(usize, ErrorSymbol)],
        smooth_s: f64,
        share: f64,
    ) -> Option<Self> {
        let index = spec.chain.index_of(axis)?;
        let entry = spec.axis(axis);
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
                slope: !symbol.is_angle(),
                sums: [[0.0; 5]; PARTS],
                line: None,
                value: None,
            })
            .collect();
        Some(Self {
            axis,
            index,
            travel: entry.travel?,
            inverted: workpiece && carriage,
            // equations 1.4: relative is minus carriage where primed
            sign: if workpiece && !carriage { -1.0 } else { 1.0 },
            smooth_s,
            share,
            seen: [false; PARTS],
            part: None,
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
        let share = if self.smooth_s > 0.0 { 1.0 - (-dt.max(0.0) / self.smooth_s).exp() } else { 1.0 };
        let part = ((u.clamp(0.0, 1.0) * PARTS as f64) as usize).min(PARTS - 1);
        let entered = self.part != Some(part);
        self.seen[part] = true;
        self.part = Some(part);
        let known = self.coverage() >= self.share;
        let (x, travel) = if self.inverted { (-q, travel.reversed()) } else { (q, travel) };
        for lane in &mut self.lanes {
            let stored = lane.curves.value(x, travel);
            let difference = self.sign * machine[lane.component] - stored;
            match lane.line {
                None => {
                    let terms = [1.0, u, u * u, difference, u * difference];
                    let sums = &mut lane.sums[part];
                    if entered {
                        *sums = [0.0; 5];
                    } else if sums[0] >= PART_READINGS {
                        // an axis that rests in a part is known as it was last
                        sums.iter_mut().for_each(|sum| *sum *= 1.0 - 1.0 / PART_READINGS);
                    }
                    sums.iter_mut().zip(terms).for_each(|(sum, term)| *sum += term);
                    if known {
                        lane.line = lane.fit();
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
        (self.seen, self.part) = ([false; PARTS], None);
        for lane in &mut self.lanes {
            lane.sums = [[0.0; 5]; PARTS];
            (lane.line, lane.value) = (None, None);
        }
    }
}

impl Lane {
    /// Offset and slope by least squares; no slope for angles.
    fn fit(&self) -> Option<[f64; 2]> {
        let mut mean = [0.0; 5];
        for part in self.sums.iter().filter(|part| part[0] > 0.0) {
            mean.iter_mut().zip(part).for_each(|(sum, term)| *sum += term / part[0]);
        }
        let [n, u, uu, d, ud] = mean;
        if !self.slope {
            return (n > 0.0).then(|| [d / n, 0.0]);
        }
        let determinant = n * uu - u * u;
        (determinant > 1e-9 * n * n)
            .then(|| [(uu * d - u * ud) / determinant, (n * ud - u * d) / determinant])
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
        let mut laser = AxisLaser::new(&spec(primed, sense), AxisName::X, &channels, 0.5, 0.8).unwrap();
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
                AxisLaser::new(&spec(false, Sense::Relative), AxisName::X, &channels, 0.0, 1.0).unwrap();
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
    fn what_was_forgotten_is_found_anew() {
        let channels = [(0, ErrorSymbol::parse("eyx").unwrap())];
        let mut laser =
            AxisLaser::new(&spec(false, Sense::Relative), AxisName::X, &channels, 0.0, 0.5).unwrap();
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
}
