//! The largest values of something in a working volume: a grid over all axes that have a travel, then a search from
//! the best grid poses along every axis and in ever smaller steps.
//!
//! Deviations are sums of functions with many local maxima, so a largest value is found to the resolution of the
//! line scans; what is reported is reached by the pose that is reported with it.

use super::dynamics::Law;
use crate::prelude::*;

/// Poses of the grid, about.
const GRID_POSES: usize = 100_000;
/// Most grid planes per axis.
const PLANES_MAX: usize = 101;
/// Starts of the search for each goal.
const STARTS: usize = 4;
/// Points of a scan along one axis.
const SCAN: u32 = 400;
/// Step, as a share of the travel, at which the search ends.
const STEP_END: f64 = 1e-8;

/// The poses that are searched: every axis over its domain ([`ModelSpec::domain`]), those without one where they stand.
#[derive(Debug, Clone, PartialEq)]
pub struct Volume {
    home: Pose,
    ranges: Vec<[f64; 2]>,
    /// Axes that move.
    free: Vec<usize>,
    /// Axes whose errors depend on the direction of travel.
    directed: Vec<usize>,
}

/// What a search found.
#[derive(Debug, Clone, PartialEq)]
pub struct Found<T> {
    /// For every goal what was found where it is largest.
    pub best: Vec<T>,
    /// Poses evaluated.
    pub poses: u64,
}

/// Home, or the end of the domain nearest to it.
#[must_use]
pub fn reference_pose(spec: &ModelSpec) -> Pose {
    let mut pose = Pose::at([0.0; MAX_AXES]);
    for (q, axis) in pose.position.iter_mut().zip(spec.chain.axes()) {
        if let Some([low, high]) = spec.domain(axis.name) {
            *q = 0.0f64.clamp(low, high);
        }
    }
    pose
}

impl Volume {
    /// The working volume of a model.
    #[must_use]
    pub fn of(spec: &ModelSpec) -> Self {
        let home = reference_pose(spec);
        let axes = spec.chain.axes();
        let domain = |k: usize| spec.domain(axes[k].name).filter(|_| !axes[k].spindle);
        let ranges: Vec<_> = (0..axes.len()).map(|k| domain(k).unwrap_or([home.position[k]; 2])).collect();
        let directed = |k: &usize| {
            spec.errors.iter().filter(|(s, _)| s.axis() == axes[*k].name).any(|(_, f)| {
                let reversal = |d: &DynamicTerm| matches!(d.law, Law::Reversal { .. });
                f.curves.iter().any(|c| matches!(c, Curve::Table(t) if t.columns().2.is_some()))
                    || f.dynamics.iter().any(reversal)
            })
        };
        let directed = (0..axes.len()).filter(directed).collect();
        Self::new(home, ranges, directed)
    }

    /// A volume from one range per axis of the chain; an axis whose range is a point stays there.
    #[must_use]
    pub fn new(home: Pose, ranges: Vec<[f64; 2]>, directed: Vec<usize>) -> Self {
        let free = (0..ranges.len()).filter(|&k| ranges[k][0] < ranges[k][1]).collect();
        Self { home, ranges, free, directed }
    }

    /// The range of every axis of the chain, mm or rad.
    #[must_use]
    pub fn ranges(&self) -> &[[f64; 2]] {
        &self.ranges
    }

    /// Chain indices of the axes that are moved in both directions.
    #[must_use]
    pub fn directed(&self) -> &[usize] {
        &self.directed
    }

    /// The poses of a grid of about `wanted` places, in both directions of travel where it matters.
    pub fn grid(&self, wanted: usize) -> impl Iterator<Item = Pose> + '_ {
        let planes = self.planes(wanted);
        (0..planes.pow(self.free.len() as u32)).flat_map(move |index| self.at_index(index, planes))
    }

    /// Grid planes per axis.
    fn planes(&self, wanted: usize) -> usize {
        match self.free.len() {
            0 => 1,
            n => ((wanted as f64).powf(1.0 / n as f64) as usize).clamp(2, PLANES_MAX),
        }
    }

    fn at_index(&self, index: usize, planes: usize) -> impl Iterator<Item = Pose> + use<> {
        let mut pose = self.home;
        let mut rest = index;
        for &k in self.free.iter().rev() {
            let [low, high] = self.ranges[k];
            pose.position[k] = low + (high - low) * (rest % planes) as f64 / (planes - 1) as f64;
            rest /= planes;
        }
        let mut back = pose;
        for &k in &self.directed {
            back.travel[k] = Travel::Reverse;
        }
        let back = (!self.directed.is_empty()).then_some(back);
        core::iter::once(pose).chain(back)
    }

    /// Finds where each of `goals` is largest.
    ///
    /// `evaluate` says what there is at a pose, `value` how large a goal is there. `visit` receives every pose of
    /// the grid (for means over the volume), and how many of about how many grid poses are done.
    pub fn search<T: Copy, G: Copy>(
        &self,
        goals: &[G],
        mut evaluate: impl FnMut(&Pose) -> T,
        value: impl Fn(G, &T) -> f64,
        mut visit: impl FnMut(&T, u64, u64),
    ) -> Found<T> {
        let places = self.planes(GRID_POSES).pow(self.free.len() as u32) as u64;
        let total = places * if self.directed.is_empty() { 1 } else { 2 };
        let mut best: Vec<Vec<(Pose, T)>> = vec![Vec::new(); goals.len()];
        let mut slab = (f64::NAN, 0usize);
        let mut done = 0;
        for pose in self.grid(GRID_POSES) {
            let found = evaluate(&pose);
            done += 1;
            visit(&found, done, total);
            // one start per plane of the first axis, so that starts are spread out
            let first = self.free.first().map_or(0.0, |&k| pose.position[k]);
            if first != slab.0 {
                slab = (first, slab.1 + usize::from(!slab.0.is_nan()));
            }
            for (goal, best) in goals.iter().zip(&mut best) {
                match best.get_mut(slab.1) {
                    None => best.push((pose, found)),
                    Some(old) if value(*goal, &found) > value(*goal, &old.1) => *old = (pose, found),
                    Some(_) => {}
                }
            }
        }
        let mut search = Search { volume: self, poses: done, evaluate };
        let best = goals.iter().zip(best).map(|(goal, mut starts)| {
            let size = |of: &T| value(*goal, of);
            starts.sort_by(|a, b| size(&b.1).total_cmp(&size(&a.1)));
            starts.truncate(STARTS);
            let refined = starts.into_iter().map(|s| search.refine(&size, s));
            let best = refined.reduce(|a, b| if size(&b.1) > size(&a.1) { b } else { a });
            best.map_or_else(|| (search.evaluate)(&self.home), |(_, found)| found)
        });
        let best = best.collect();
        Found { best, poses: search.poses }
    }
}

struct Search<'a, E> {
    volume: &'a Volume,
    poses: u64,
    evaluate: E,
}

impl<T: Copy, E: FnMut(&Pose) -> T> Search<'_, E> {
    /// From a pose to a local maximum: scans along every axis, both directions of travel, then smaller steps.
    fn refine(&mut self, size: &impl Fn(&T) -> f64, start: (Pose, T)) -> (Pose, T) {
        let volume = self.volume;
        let mut best = start;
        for _ in 0..3 {
            let before = size(&best.1);
            for &k in &volume.free {
                let [low, high] = volume.ranges[k];
                for i in 0..=SCAN {
                    let q = low + (high - low) * f64::from(i) / f64::from(SCAN);
                    self.improve(size, &mut best, |p| p.position[k] = q);
                }
            }
            for &k in &volume.directed {
                self.improve(size, &mut best, |p| p.travel[k] = p.travel[k].reversed());
            }
            if size(&best.1) <= before {
                break;
            }
        }
        let mut share = 1.0 / f64::from(SCAN);
        while share > STEP_END {
            let before = size(&best.1);
            for &k in &volume.free {
                let [low, high] = volume.ranges[k];
                for step in [-share, share] {
                    let q = (best.0.position[k] + step * (high - low)).clamp(low, high);
                    self.improve(size, &mut best, |p| p.position[k] = q);
                }
            }
            if size(&best.1) <= before {
                share *= 0.5;
            }
        }
        best
    }

    fn improve(&mut self, size: &impl Fn(&T) -> f64, best: &mut (Pose, T), change: impl FnOnce(&mut Pose)) {
        let mut pose = best.0;
        change(&mut pose);
        let candidate = (self.evaluate)(&pose);
        self.poses += 1;
        if size(&candidate) > size(&best.1) {
            *best = (pose, candidate);
        }
    }
}
