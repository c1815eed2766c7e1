//! The largest deviations and corrections in the working volume: a grid over all axes that have a travel, then a
//! search from the best grid poses along every axis and in ever smaller steps.
//!
//! The deviation is a sum of smooth functions with many local maxima, so a largest value is found to the resolution
//! of the line scans; what is reported is reached by the pose that is reported with it.

use crate::core::axes::{AxisKind, MAX_AXES, Travel};
use crate::core::model::{AxisCorrection, Curve, Deviation, Model, ModelSpec, Pose};

/// Poses of the grid, about.
const GRID_POSES: usize = 100_000;
/// Most grid planes per axis.
const PLANES_MAX: usize = 101;
/// Starts of the search for each goal.
const STARTS: usize = 4;
/// Points of a scan along one axis.
const SCAN: u32 = 400;

/// What is to be as large as possible.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Goal {
    Position,
    Rotation,
    /// The correction of one axis of the chain.
    Offset(usize),
}

/// A pose with what the model says there.
#[derive(Debug, Clone, Copy)]
pub(super) struct Extreme {
    pub(super) pose: Pose,
    pub(super) deviation: Deviation,
    pub(super) correction: AxisCorrection,
}

/// What the search found.
#[derive(Debug)]
pub(super) struct Found {
    /// Largest position error.
    pub(super) position: Extreme,
    /// Largest error of orientation.
    pub(super) rotation: Extreme,
    /// Largest correction of every axis of the chain; none for a spindle.
    pub(super) offsets: Vec<Option<Extreme>>,
    /// Root mean square of the position error over the grid, mm.
    pub(super) rms: f64,
    /// Poses evaluated.
    pub(super) poses: u64,
}

/// The volume that is searched.
struct Volume<'a> {
    model: &'a Model,
    ranges: Vec<[f64; 2]>,
    /// Axes that move.
    free: Vec<usize>,
    /// Axes with tables that depend on the direction of travel.
    directed: Vec<usize>,
    poses: u64,
}

/// Home, or the end of travel nearest to it.
pub(super) fn reference_pose(spec: &ModelSpec) -> Pose {
    let mut pose = Pose::at([0.0; MAX_AXES]);
    for (q, axis) in pose.position.iter_mut().zip(spec.chain.axes()) {
        if let Some([low, high]) = spec.axis(axis.name).travel {
            *q = 0.0f64.clamp(low, high);
        }
    }
    pose
}

/// Searches the volume; `progress` is told how many of how many steps are done.
pub(super) fn search(spec: &ModelSpec, model: &Model, mut progress: impl FnMut(u64, u64)) -> Found {
    let mut volume = Volume::new(spec, model);
    let axes = spec.chain.axes();
    let mut goals = vec![Goal::Position, Goal::Rotation];
    goals.extend((0..axes.len()).filter(|&k| !axes[k].spindle).map(Goal::Offset));
    let (starts, rms) = volume.grid(spec, &goals, &mut progress);
    let best: Vec<(Goal, Extreme)> = goals
        .iter()
        .zip(starts)
        .map(|(goal, starts)| {
            let refined = starts.into_iter().map(|s| volume.refine(*goal, s));
            let best = refined.reduce(|a, b| if goal.of(&b) > goal.of(&a) { b } else { a });
            (*goal, best.unwrap_or_else(|| volume.at(reference_pose(spec))))
        })
        .collect();
    let of = |goal: Goal| best.iter().find(|(g, _)| *g == goal).map(|(_, e)| *e);
    let home = volume.at(reference_pose(spec));
    Found {
        position: of(Goal::Position).unwrap_or(home),
        rotation: of(Goal::Rotation).unwrap_or(home),
        offsets: (0..axes.len()).map(|k| of(Goal::Offset(k))).collect(),
        rms,
        poses: volume.poses,
    }
}

impl Goal {
    fn of(self, at: &Extreme) -> f64 {
        match self {
            Self::Position => at.deviation.position.norm(),
            Self::Rotation => at.deviation.rotation.norm(),
            Self::Offset(k) => at.correction.offset[k].abs(),
        }
    }
}

impl<'a> Volume<'a> {
    fn new(spec: &ModelSpec, model: &'a Model) -> Self {
        let home = reference_pose(spec);
        let axes = spec.chain.axes();
        let travel = |k: usize| spec.axis(axes[k].name).travel.filter(|_| !axes[k].spindle);
        let ranges: Vec<_> = (0..axes.len()).map(|k| travel(k).unwrap_or([home.position[k]; 2])).collect();
        let directed = |k: &usize| {
            spec.errors.iter().filter(|(s, _)| s.axis() == axes[*k].name).any(|(_, f)| {
                f.curves.iter().any(|c| matches!(c, Curve::Table(t) if t.columns().2.is_some()))
            })
        };
        Self {
            model,
            free: (0..axes.len()).filter(|&k| ranges[k][0] < ranges[k][1]).collect(),
            directed: (0..axes.len()).filter(directed).collect(),
            ranges,
            poses: 0,
        }
    }

    fn at(&mut self, pose: Pose) -> Extreme {
        self.poses += 1;
        let (deviation, correction) = self.model.correct(&pose);
        Extreme { pose, deviation, correction }
    }

    /// The grid: for each goal the best pose of each of the best planes of the first axis, and the rms.
    fn grid(
        &mut self,
        spec: &ModelSpec,
        goals: &[Goal],
        progress: &mut impl FnMut(u64, u64),
    ) -> (Vec<Vec<Extreme>>, f64) {
        let n = self.free.len();
        let planes = match n {
            0 => 1,
            _ => ((GRID_POSES as f64).powf(1.0 / n as f64) as usize).clamp(2, PLANES_MAX),
        };
        let total = planes.pow(n as u32);
        let per_slab = total / if n == 0 { 1 } else { planes };
        let mut best: Vec<Vec<Extreme>> = vec![Vec::new(); goals.len()];
        let mut sum = 0.0;
        for index in 0..total {
            let mut pose = reference_pose(spec);
            let mut rest = index;
            for &k in self.free.iter().rev() {
                let [low, high] = self.ranges[k];
                pose.position[k] = low + (high - low) * (rest % planes) as f64 / (planes - 1) as f64;
                rest /= planes;
            }
            let mut found = [Some(self.at(pose)), None];
            if !self.directed.is_empty() {
                for &k in &self.directed {
                    pose.travel[k] = Travel::Reverse;
                }
                found[1] = Some(self.at(pose));
            }
            for one in found.into_iter().flatten() {
                sum += one.deviation.position.norm_squared();
                for (goal, best) in goals.iter().zip(&mut best) {
                    let slab = index / per_slab;
                    if best.len() <= slab {
                        best.push(one);
                    } else if goal.of(&one) > goal.of(&best[slab]) {
                        best[slab] = one;
                    }
                }
            }
            if index % 1024 == 0 {
                progress(index as u64, total as u64);
            }
        }
        let rms = (sum / self.poses as f64).sqrt();
        for (goal, best) in goals.iter().zip(&mut best) {
            best.sort_by(|a, b| goal.of(b).total_cmp(&goal.of(a)));
            best.truncate(STARTS);
        }
        (best, rms)
    }

    /// From a pose to a local maximum: scans along every axis, both directions of travel, then smaller steps.
    fn refine(&mut self, goal: Goal, start: Extreme) -> Extreme {
        let mut best = start;
        for _ in 0..3 {
            let before = goal.of(&best);
            for k in self.free.clone() {
                let [low, high] = self.ranges[k];
                for i in 0..=SCAN {
                    let q = low + (high - low) * f64::from(i) / f64::from(SCAN);
                    self.improve(goal, &mut best, |p| p.position[k] = q);
                }
            }
            for k in self.directed.clone() {
                self.improve(goal, &mut best, |p| p.travel[k] = p.travel[k].reversed());
            }
            if goal.of(&best) <= before {
                break;
            }
        }
        let mut share = 1.0 / f64::from(SCAN);
        while share > 1e-8 {
            let before = goal.of(&best);
            for k in self.free.clone() {
                let [low, high] = self.ranges[k];
                for step in [-share, share] {
                    let q = (best.pose.position[k] + step * (high - low)).clamp(low, high);
                    self.improve(goal, &mut best, |p| p.position[k] = q);
                }
            }
            if goal.of(&best) <= before {
                share *= 0.5;
            }
        }
        best
    }

    fn improve(&mut self, goal: Goal, best: &mut Extreme, change: impl FnOnce(&mut Pose)) {
        let mut pose = best.pose;
        change(&mut pose);
        let candidate = self.at(pose);
        if goal.of(&candidate) > goal.of(best) {
            *best = candidate;
        }
    }
}

/// The axes that the search keeps in place, because nothing says how far they go.
pub(super) fn kept_in_place(spec: &ModelSpec) -> Vec<String> {
    let axes = spec.chain.axes().iter();
    axes.filter(|a| !a.spindle && spec.axis(a.name).travel.is_none())
        .map(|a| format!("{} at 0 {}", a.name, if a.kind() == AxisKind::Linear { "mm" } else { "deg" }))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::core::axes::AxisName;
    use crate::core::model::curve::{ErrorFunction, Fourier, Interpolation, Table};
    use crate::core::model::{AxisSpec, Chain, ErrorSymbol};

    fn spec() -> ModelSpec {
        let mut spec = ModelSpec::new("m", Chain::parse("[w b X Y t]").unwrap());
        for axis in [AxisName::X, AxisName::Y] {
            spec.axes.push(AxisSpec { travel: Some([0.0, 400.0]), ..AxisSpec::new(axis) });
        }
        spec
    }

    fn add(spec: &mut ModelSpec, symbol: &str, curve: Curve) {
        spec.errors.push((ErrorSymbol::parse(symbol).unwrap(), ErrorFunction::single(curve)));
    }

    #[test]
    fn the_crest_of_a_short_wave_is_found() {
        let mut spec = spec();
        let wave = Fourier::new(0.0, 400.0, 37.0, 0.0, 0.001, &[], &[0.005]).unwrap();
        add(&mut spec, "exx", Curve::Fourier(wave.clone()));
        add(&mut spec, "ec0y", Curve::Constant(1e-5));
        let model = Model::new(&spec).unwrap();
        let found = search(&spec, &model, |_, _| {});
        // positive waves against -C0Y y, negative ones with it: the worst stands at y = 400
        let lowest = (0..=400_000).map(|i| wave.value(f64::from(i) * 1e-3)).fold(f64::INFINITY, f64::min);
        let expected = lowest - 1e-5 * 400.0;
        assert!((found.position.deviation.position.x - expected).abs() < 1e-9);
        assert!((found.position.pose.position[1] - 400.0).abs() < 1e-9);
        let x = found.offsets[0].unwrap();
        assert!((x.correction.offset[0] + expected).abs() < 1e-9);
        assert!(found.rms > 0.0 && found.rms < -expected);
    }

    #[test]
    fn both_directions_of_travel_are_searched() {
        let mut spec = spec();
        let table =
            Table::new(vec![0.0, 400.0], vec![0.001, 0.002], Some(vec![0.0, -0.009]), Interpolation::Linear);
        add(&mut spec, "exx", Curve::Table(table.unwrap()));
        let model = Model::new(&spec).unwrap();
        let worst = search(&spec, &model, |_, _| {}).position;
        assert_eq!(worst.pose.travel[0], Travel::Reverse);
        assert!((worst.deviation.position.x + 0.009).abs() < 1e-12);
    }

    #[test]
    fn a_model_without_travel_is_looked_at_where_it_stands() {
        let mut spec = ModelSpec::new("m", Chain::parse("[w b X C (S) t]").unwrap());
        add(&mut spec, "exx", Curve::Constant(0.003));
        let found = search(&spec, &Model::new(&spec).unwrap(), |_, _| {});
        assert!((found.position.deviation.position.x - 0.003).abs() < 1e-15);
        assert!(found.offsets[2].is_none());
        assert_eq!(kept_in_place(&spec), ["X at 0 mm", "C at 0 deg"]);
    }
}
