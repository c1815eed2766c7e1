//! The difference of two models in the working volume.

use nalgebra::{Matrix6, Vector6};

use super::{Pair, bound};
use crate::prelude::*;
use crate::search::{Volume, reference_pose};

/// Poses from which the best rigid motion is found.
const RIGID_POSES: usize = 4000;

/// The difference at a pose, second minus first, in W.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Difference {
    /// The pose, axes in the order of the first chain.
    pub pose: Pose,
    /// Of the position deviation, mm.
    pub position: Vec3,
    /// Of the rotation, rad.
    pub rotation: Vec3,
    /// Of the corrections, mm or rad, in the order of the first chain.
    pub offset: AxisArray,
    /// What is left of the position where the best rigid motion of the workpiece is taken out, mm.
    pub without_rigid: Vec3,
}

/// How far two models differ in the working volume.
#[derive(Debug, Clone, PartialEq)]
pub struct VolumeDifference {
    /// Range of every axis of the first chain, mm or rad; low = high where an axis has no travel.
    pub ranges: Vec<[f64; 2]>,
    /// Where the position differs most.
    pub position: Difference,
    /// Where the rotation differs most.
    pub rotation: Difference,
    /// For every axis of the first chain where its correction differs most; none for a spindle.
    pub offsets: Vec<Option<Difference>>,
    /// Where the position differs most after the best rigid motion of the workpiece was taken out: the set-up of a
    /// workpiece takes that motion out, so this is what parts see.
    pub without_rigid: Difference,
    /// Root mean square over a grid: position, mm.
    pub rms_position: f64,
    /// The same without the rigid motion, mm.
    pub rms_without_rigid: f64,
    /// Root mean square of the rotation, rad.
    pub rms_rotation: f64,
    /// The rigid motion: shift, mm, and turn about the origin of W, rad.
    pub rigid: [Vec3; 2],
    /// The position differs nowhere by more, mm; `None` where the geometry changed, too.
    pub bound_position: Option<f64>,
    /// The rotation differs nowhere by more, rad; `None` where the geometry changed, too.
    pub bound_rotation: Option<f64>,
    /// Poses evaluated.
    pub poses: u64,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Goal {
    Position,
    Rotation,
    WithoutRigid,
    Offset(usize),
}

impl Goal {
    fn of(self, d: &Difference) -> f64 {
        match self {
            Self::Position => d.position.norm(),
            Self::Rotation => d.rotation.norm(),
            Self::WithoutRigid => d.without_rigid.norm(),
            Self::Offset(k) => d.offset[k].abs(),
        }
    }
}

/// Only for models whose chains have the same axes.
pub(super) fn difference(pair: &Pair<'_>, mut progress: impl FnMut(u64, u64)) -> VolumeDifference {
    let volume = joined(pair);
    let rigid = best_rigid(pair, &volume);
    let axes = pair.specs[0].chain.axes();
    let mut goals = vec![Goal::Position, Goal::Rotation, Goal::WithoutRigid];
    goals.extend((0..axes.len()).filter(|&k| !axes[k].spindle).map(Goal::Offset));
    let (mut sums, mut count) = ([0.0; 3], 0u64);
    let found = volume.search(
        &goals,
        |pose| {
            let mut d = at(pair, pose);
            d.without_rigid = d.position - rigid[0] - rigid[1].cross(&nominal_tip(pair, pose));
            d
        },
        Goal::of,
        |d, done, of| {
            for (sum, v) in sums.iter_mut().zip([d.position, d.without_rigid, d.rotation]) {
                *sum += v.norm_squared();
            }
            count = done;
            if done % 1024 == 0 {
                progress(done, of);
            }
        },
    );
    let of = |goal: Goal| goals.iter().position(|g| *g == goal).map(|i| found.best[i]);
    let [position, without_rigid, rotation] = sums.map(|s| (s / count.max(1) as f64).sqrt());
    let bounds = bound::bounds(pair, &volume);
    VolumeDifference {
        ranges: volume.ranges().to_vec(),
        position: found.best[0],
        rotation: found.best[1],
        without_rigid: found.best[2],
        offsets: (0..axes.len()).map(|k| of(Goal::Offset(k))).collect(),
        rms_position: position,
        rms_without_rigid: without_rigid,
        rms_rotation: rotation,
        rigid,
        bound_position: bounds.map(|b| b[0]),
        bound_rotation: bounds.map(|b| b[1]),
        poses: found.poses,
    }
}

/// The hull of both volumes, in the order of the first chain.
fn joined(pair: &Pair<'_>) -> Volume {
    let volumes = pair.specs.map(Volume::of);
    let axes = pair.specs[0].chain.axes();
    let mut home = reference_pose(pair.specs[0]);
    let mut ranges = Vec::new();
    for (k, axis) in axes.iter().enumerate() {
        let travel = pair.travel(axis.name).filter(|_| !axis.spindle);
        if let Some([low, high]) = travel {
            home.position[k] = 0.0f64.clamp(low, high);
        }
        ranges.push(travel.unwrap_or([home.position[k]; 2]));
    }
    let is_directed = |k: &usize| {
        volumes[0].directed().contains(k)
            || pair.index[*k].is_some_and(|j| volumes[1].directed().contains(&j))
    };
    let directed = (0..axes.len()).filter(is_directed).collect();
    Volume::new(home, ranges, directed)
}

/// The difference at a pose of the first chain.
fn at(pair: &Pair<'_>, pose: &Pose) -> Difference {
    let mut second = Pose::at([0.0; MAX_AXES]);
    for (k, other) in pair.index.iter().enumerate() {
        if let Some(j) = *other {
            second.position[j] = pose.position[k];
            second.travel[j] = pose.travel[k];
        }
    }
    let (a, correction_a) = pair.models[0].correct(pose);
    let (b, correction_b) = pair.models[1].correct(&second);
    let mut offset = [0.0; MAX_AXES];
    for (k, other) in pair.index.iter().enumerate() {
        if let Some(j) = *other {
            offset[k] = correction_b.offset[j] - correction_a.offset[k];
        }
    }
    Difference {
        pose: *pose,
        position: b.position - a.position,
        rotation: b.rotation - a.rotation,
        offset,
        without_rigid: Vec3::zeros(),
    }
}

/// Nominal tool tip in W by the first model.
fn nominal_tip(pair: &Pair<'_>, pose: &Pose) -> Vec3 {
    pair.models[0].nominal(pose).tip[0] - pair.specs[0].workpiece_origin
}

/// Shift and turn of the workpiece that take most of the difference out, by least squares over a grid; directions
/// that the volume does not show are left at zero.
fn best_rigid(pair: &Pair<'_>, volume: &Volume) -> [Vec3; 2] {
    let poses: Vec<(Vec3, Vec3)> =
        volume.grid(RIGID_POSES).map(|pose| (nominal_tip(pair, &pose), at(pair, &pose).position)).collect();
    let n = poses.len() as f64;
    let centre = poses.iter().map(|p| p.0).sum::<Vec3>() / n;
    let size = (poses.iter().map(|p| (p.0 - centre).norm_squared()).sum::<f64>() / n).sqrt().max(1e-9);
    let (mut normal, mut right) = (Matrix6::<f64>::zeros(), Vector6::<f64>::zeros());
    for (p, d) in &poses {
        let lever = (p - centre) / size;
        for i in 0..3 {
            let mut row = Vector6::zeros();
            row[i] = 1.0;
            for j in 0..3 {
                row[3 + j] = crate::geometry::unit(j).cross(&lever)[i];
            }
            normal += row * row.transpose();
            right += row * d[i];
        }
    }
    let solved = normal.svd(true, true).solve(&right, 1e-9 * n).unwrap_or_else(|_| Vector6::zeros());
    let turn = Vec3::new(solved[3], solved[4], solved[5]) / size;
    [Vec3::new(solved[0], solved[1], solved[2]) - turn.cross(&centre), turn]
}
