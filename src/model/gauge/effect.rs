//! Where a removed constant or slope goes.
//!
//! Let the linear axes of the group at the bed stand between the workpiece-side rotary axis `a` (or W) and the
//! tool-side rotary axis `b` (or the tool), and `V`, `V_L` be the nominal tip right and left of the group,
//! `V_L = V + SUM q_j u_j`. A constant turn `A` of axis k displaces the tip by `A x (v_k - r_k)`, that is by
//! `A x V` plus a constant plus tilts `q_j tau_j` of the lines of the axes nearer to the tool (`tau_j = A x u_j`) and,
//! where its reference points do not follow, of its own. With the slopes removed from the straightnesses,
//!
//! `F = A x V + c + SUM q_j tau_j = d + R x V_L + T x (V - V_0)`,  `T = A - R`,  `d = c + T x V_0`.
//!
//! `R` makes the X line the primary line and XY the secondary plane; what is left of the tilts of Y and Z is what
//! `C0Y, B0Z, A0Z` can hold: `C0Y -= R_z + tau_Y,x`, `B0Z += tau_Z,x - R_y`, `A0Z -= R_x + tau_Z,y`. `T` becomes the
//! location error (angles) of `b` with `V_0` on its axis, or a turn of the tool; `d, R` the location error of `a`
//! with the sign of the workpiece side, or a rigid motion of W. A shift along the axis of `a` passes through it.
//!
//! Source: equations 2, 1.5, 1.7, 1.9.

use core::ops::Range;

use super::super::kinematics::{Joint, PointFlags};
use super::{Effect, is_main};
use crate::prelude::*;

/// The model with what the rules refer to.
pub(super) struct Layout<'a> {
    pub(super) model: &'a Model,
    spec: &'a ModelSpec,
    /// The linear axes that are joined to the bed without a rotary axis between.
    pub(super) group: Range<usize>,
    /// The reference pose.
    pub(super) reference: Pose,
    /// Range over which the lines of an axis are drawn, programmed coordinates.
    pub(super) spans: Vec<Option<[f64; 2]>>,
}

/// Displacement by removed parts: `turn x V + constant + SUM q_j tilt_j`.
#[derive(Default)]
struct Field {
    turn: Vec3,
    constant: Vec3,
    tilt: [Vec3; MAX_AXES],
}

impl<'a> Layout<'a> {
    pub(super) fn new(model: &'a Model, spec: &'a ModelSpec) -> Self {
        let linear = |j: &&Joint| j.axis.kind() == AxisKind::Linear;
        let bed = model.joints.iter().filter(|j| j.axis.side == Side::Workpiece).count();
        let start = bed - model.joints[..bed].iter().rev().take_while(linear).count();
        let end = bed + model.joints[bed..].iter().take_while(linear).count();
        let spans: Vec<_> = model.joints.iter().map(|j| span_of(j, spec)).collect();
        let mut position: AxisArray = [0.0; MAX_AXES];
        for (q, span) in position.iter_mut().zip(&spans) {
            if let Some([low, high]) = span {
                *q = 0.0f64.clamp(*low, *high);
            }
        }
        Self { model, spec, group: start..end, reference: Pose::at(position), spans }
    }

    /// True where an axis has an error motion at all.
    pub(super) fn has_motions(&self, axis: AxisName) -> bool {
        self.spec.errors.iter().any(|(s, _)| !s.is_constant() && s.axis() == axis)
    }

    /// A parallel axis at the bed that says nowhere how far its line goes.
    pub(super) fn parallel_without_range(&self) -> Option<AxisName> {
        let name = |k: usize| self.model.joints[k].axis.name;
        self.group.clone().find(|&k| !is_main(name(k)) && self.spans[k].is_none()).map(name)
    }

    /// Shift and turn of axis k at the reference pose, relative sense.
    pub(super) fn at_reference(&self, k: usize) -> (Vec3, Vec3) {
        self.at(k, self.reference.position[k])
    }

    /// Shift of axis k at coordinate `q`, all other axes at the reference pose, relative sense.
    pub(super) fn shift_at(&self, k: usize, q: f64) -> Vec3 {
        self.at(k, q).0
    }

    fn at(&self, k: usize, q: f64) -> (Vec3, Vec3) {
        let joint = &self.model.joints[k];
        let mut pose = self.reference;
        pose.position[k] = q;
        let values = joint.motions_at(k, &pose, &mut PointFlags::default());
        let sign = if joint.inverted { -1.0 } else { 1.0 };
        (values.shift * sign, values.turn * sign)
    }

    /// Where the value of a motion at the reference pose goes; `None` where it has to stay.
    pub(super) fn effect_of_value(&self, k: usize, component: Component, amount: f64) -> Option<Effect> {
        let joint = &self.model.joints[k];
        if joint.axis.kind() == AxisKind::Rotary {
            return rotary_value(joint, component, amount);
        }
        let i = component.index();
        let mut field = Field::default();
        if component.is_angle() {
            let turn = unit(i - 3) * amount;
            field.turn = turn;
            field.constant = -Vec3::from_fn(|i, _| turn.cross(&joint.reference_points[i].point)[i]);
            for j in k + 1..self.group.end {
                field.tilt[j] = turn.cross(&self.direction(j));
            }
            // the lever grows with the own coordinate where the point is not carried along (equations 1.5)
            let own = turn.cross(&self.direction(k));
            let follows = match joint.axis.side {
                Side::Workpiece => ReferenceBody::Bed,
                Side::Tool => ReferenceBody::Carriage,
            };
            let grows = |i: usize| joint.reference_points[i].body != follows;
            field.tilt[k] = Vec3::from_fn(|i, _| if grows(i) { own[i] } else { 0.0 });
        } else {
            field.constant[i] = amount;
        }
        Some(self.effect_of(field))
    }

    /// Where the slope of a straightness goes.
    pub(super) fn effect_of_slope(&self, k: usize, component: Component, slope: f64) -> Effect {
        let mut field = Field::default();
        let i = component.index();
        field.tilt[k][i] = slope;
        field.constant[i] = -slope * self.reference.position[k];
        self.effect_of(field)
    }

    fn direction(&self, k: usize) -> Vec3 {
        unit(self.model.joints[k].axis.name.direction())
    }

    /// Tilt of the line of an axis of the group.
    fn tilt_of(&self, field: &Field, axis: AxisName) -> Option<Vec3> {
        self.group.clone().find(|&k| self.model.joints[k].axis.name == axis).map(|k| field.tilt[k])
    }

    fn effect_of(&self, mut field: Field) -> Effect {
        let mut out = Effect::default();
        let [x, y, z] = [AxisName::X, AxisName::Y, AxisName::Z].map(|axis| self.tilt_of(&field, axis));
        let a = field.turn;
        // a line that is missing leaves its turn to the next, and at last to the turn itself
        let turn = Vec3::new(
            y.map(|t| t.z).or(z.map(|t| -t.y)).unwrap_or(a.x),
            x.map(|t| -t.z).or(z.map(|t| t.x)).unwrap_or(a.y),
            x.map(|t| t.y).or(y.map(|t| -t.x)).unwrap_or(a.z),
        );
        let mut squareness = |component, axis, amount| {
            super::add_to(&mut out.errors, ErrorSymbol::Squareness { component, axis }, amount);
        };
        if let (Some(_), Some(y)) = (x, y) {
            squareness(Component::C, AxisName::Y, -turn.z - y.x);
        }
        if let (Some(_), Some(z)) = (x, z) {
            squareness(Component::B, AxisName::Z, z.x - turn.y);
        }
        if let (Some(_), Some(z)) = (y, z) {
            squareness(Component::A, AxisName::Z, -turn.x - z.y);
        }
        for k in self.group.clone() {
            let axis = self.model.joints[k].axis.name;
            if is_main(axis) {
                continue;
            }
            let left_over = field.tilt[k] - turn.cross(&self.direction(k));
            field.constant += left_over * self.reference.position[k];
            for i in (0..3).filter(|i| *i != axis.direction()) {
                let symbol = ErrorSymbol::Motion { component: Component::ALL[i], axis };
                super::add_to(&mut out.slopes, symbol, left_over[i]);
            }
        }
        let rest = field.turn - turn;
        let mut shift = field.constant;
        match self.model.joints.get(self.group.end) {
            Some(rotary) => {
                shift += rest.cross(&rotary.point);
                locate(&mut out, rotary.axis.name, &Vec3::zeros(), &rest);
            }
            None => {
                shift += rest.cross(&self.spec.tool_tip);
                out.rigid.tool_turn = rest;
            }
        }
        self.to_workpiece(&mut out, shift, turn);
        out
    }

    /// A rigid motion `shift + turn x V_L` left of the group: location of the rotary axes there, the rest in W.
    fn to_workpiece(&self, out: &mut Effect, mut shift: Vec3, turn: Vec3) {
        let rotary = self.model.joints[..self.group.start].iter().rev();
        let mut turn = Some(turn);
        for joint in rotary.filter(|j| j.axis.kind() == AxisKind::Rotary) {
            let turn = turn.take().unwrap_or_default();
            shift += turn.cross(&joint.point);
            // there is no location error along the axis: such a shift commutes with its rotation
            let along = unit(joint.axis.name.direction()) * shift[joint.axis.name.direction()];
            locate(out, joint.axis.name, &(along - shift), &-turn);
            shift = along;
        }
        if let Some(turn) = turn {
            shift += turn.cross(&self.spec.workpiece_origin);
            out.rigid.turn = turn;
        }
        out.rigid.shift = shift;
    }
}

/// A constant of a rotary axis is its location error.
fn rotary_value(joint: &Joint, component: Component, amount: f64) -> Option<Effect> {
    if component.index() == joint.axis.name.direction() {
        return None;
    }
    let sign = match joint.axis.side {
        Side::Tool => 1.0,
        Side::Workpiece => -1.0,
    };
    let symbol = ErrorSymbol::Location { component, axis: joint.axis.name };
    Some(Effect { errors: vec![(symbol, sign * amount)], ..Effect::default() })
}

/// Adds to the location errors of a rotary axis.
fn locate(out: &mut Effect, axis: AxisName, shift: &Vec3, turn: &Vec3) {
    for component in Component::ALL {
        let i = component.index();
        let amount = if component.is_angle() { turn[i - 3] } else { shift[i] };
        super::add_to(&mut out.errors, ErrorSymbol::Location { component, axis }, amount);
    }
}

/// The travel of an axis, else what its curves cover, in programmed coordinates.
fn span_of(joint: &Joint, spec: &ModelSpec) -> Option<[f64; 2]> {
    if joint.travel.is_some() {
        return joint.travel;
    }
    let name = joint.axis.name;
    let functions = spec.errors.iter().filter(|(s, _)| s.axis() == name).map(|(_, f)| f);
    let curves = functions.clone().flat_map(|f| f.curves.iter().filter_map(|c| c.range()));
    let grids = functions.flat_map(|f| f.grids.iter()).flat_map(|g| {
        let own = g.axes().enumerate().filter(|(_, a)| *a == name).map(|(i, _)| g.positions(i));
        own.map(|p| [p[0], p[p.len() - 1]]).collect::<Vec<_>>()
    });
    let [low, high] = curves.chain(grids).reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])])?;
    Some(if joint.inverted { [-high, -low] } else { [low, high] })
}
