//! A bound of the difference that holds everywhere in the volume.
//!
//! With the same geometry the difference is the deviation of a chain whose errors are the differences, so that
//! `|e| <= SUM_k |m_k|`, `m_k,i = |dE_i| + |deps_j| |v - r_i|_l + |deps_l| |v - r_i|_j` with the largest of every factor
//! taken for itself. Levers come
//! from boxes that hold the tool tip: a linear axis lengthens the box by its range, a rotary axis turns it into the box
//! of a full turn. Largest values of curves are exact for linear tables and grids at their support points, and
//! to the sampling of `curves` (24 per shortest wave: 1 %) for the rest.

use super::curves::{each, samples};
use super::{Change, Pair, changes};
use crate::kinematics::Joint;
use crate::prelude::*;
use crate::search::Volume;

/// What sampling may miss of a smooth curve.
const SAMPLING_MARGIN: f64 = 1.01;

/// A box that holds a point.
#[derive(Clone, Copy)]
struct Box3 {
    low: Vec3,
    high: Vec3,
}

impl Box3 {
    fn point(p: Vec3) -> Self {
        Self { low: p, high: p }
    }

    fn moved(mut self, direction: usize, [low, high]: [f64; 2]) -> Self {
        self.low[direction] += low;
        self.high[direction] += high;
        self
    }

    /// The box of a full turn about a line.
    fn turned(self, direction: usize, point: &Vec3) -> Self {
        let far = self.farthest(point);
        let [i, j] = [(direction + 1) % 3, (direction + 2) % 3];
        let radius = far[i].hypot(far[j]);
        let mut out = self;
        for i in [i, j] {
            out.low[i] = point[i] - radius;
            out.high[i] = point[i] + radius;
        }
        out
    }

    /// Largest distances from a point along x, y, z.
    fn farthest(&self, point: &Vec3) -> Vec3 {
        Vec3::from_fn(|i, _| (self.low[i] - point[i]).abs().max((self.high[i] - point[i]).abs()))
    }
}

/// Bounds of position, mm, and rotation, rad; `None` where more than errors and travels changed, or a datum is set.
pub(super) fn bounds(pair: &Pair<'_>, volume: &Volume) -> Option<[f64; 2]> {
    let harmless = |c: &Change| {
        matches!(
            c,
            Change::Machine(_)
                | Change::Travel { .. }
                | Change::Sense { .. }
                | Change::GaugePoint(_)
                | Change::Vertical(_)
                | Change::CorrectionLimit { .. }
        )
    };
    if !changes(pair.specs).iter().all(harmless) {
        return None;
    }
    let [a, b] = pair.models;
    let boxes = boxes(pair, volume);
    let mut out = [0.0; 2];
    for (k, (first, second)) in a.joints.iter().zip(&b.joints).enumerate() {
        let mut largest = [0.0f64; 6];
        each(pair, first.axis.name, &samples(pair, first.axis.name), |_, _, d| {
            for (m, v) in largest.iter_mut().zip(d) {
                *m = m.max(v.abs());
            }
        });
        let turn = SAMPLING_MARGIN * Vec3::new(largest[3], largest[4], largest[5]);
        let place = error_place(first, &boxes, k);
        let mut moved = Vec3::zeros();
        for i in 0..3 {
            let reference = &first.reference_points[i];
            let mut tip = place;
            if reference.body == ReferenceBody::Bed {
                // the lever holds the axis' own coordinate, too; either sign is covered
                let far = volume.ranges()[k].iter().fold(0.0f64, |m, q| m.max(q.abs()));
                tip = tip.moved(first.axis.name.direction(), [-far, far]);
            }
            let lever = tip.farthest(&reference.point);
            let [j, m] = [(i + 1) % 3, (i + 2) % 3];
            moved[i] = SAMPLING_MARGIN * largest[i] + turn[j] * lever[m] + turn[m] * lever[j];
        }
        out[0] += moved.norm() + constants(first, second, &place, volume.ranges()[k]);
        out[1] += turn.norm() + (second.location_turn - first.location_turn).norm();
    }
    // deviations are relative to the one at the datum, which is one of the bounded ones
    if !pair.specs[0].datum.is_empty() {
        out[0] *= 2.0;
    }
    Some(out)
}

/// Squareness and location.
fn constants(first: &Joint, second: &Joint, place: &Box3, range: [f64; 2]) -> f64 {
    match first.axis.kind() {
        AxisKind::Linear => {
            let far = range.iter().fold(0.0f64, |m, q| m.max(q.abs()));
            (second.squareness - first.squareness).norm() * far
        }
        AxisKind::Rotary => {
            let lever = place.farthest(&first.point).norm();
            (second.location_shift - first.location_shift).norm()
                + (second.location_turn - first.location_turn).norm() * lever
        }
    }
}

/// Where the error of joint k meets the tool tip: behind its own motion or before it (equations 2).
fn error_place(joint: &Joint, boxes: &[Box3], k: usize) -> Box3 {
    match (joint.axis.kind(), joint.axis.side) {
        (AxisKind::Linear, Side::Tool) | (AxisKind::Rotary, Side::Workpiece) => boxes[k + 1],
        (AxisKind::Linear, Side::Workpiece) | (AxisKind::Rotary, Side::Tool) => boxes[k],
    }
}

/// Boxes of the tool tip left of every joint, and behind the last.
fn boxes(pair: &Pair<'_>, volume: &Volume) -> Vec<Box3> {
    let model = &pair.models[0];
    let mut here = Box3::point(model.tool_tip());
    let mut out = vec![here];
    for (k, joint) in model.joints.iter().enumerate().rev() {
        let direction = joint.axis.name.direction();
        here = match joint.axis.kind() {
            AxisKind::Linear => here.moved(direction, volume.ranges()[k]),
            AxisKind::Rotary => here.turned(direction, &joint.point),
        };
        out.push(here);
    }
    out.reverse();
    out
}
