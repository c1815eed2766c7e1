//! What the errors of one axis do to the tip: columns of the design, from the first-order model itself.
//!
//! The deviation is linear in the errors, so the column of an error motion is the deviation of a model in which it is
//! the only error, divided by its size.

use crate::prelude::*;
use nalgebra::{Matrix3xX, Vector3};

use super::{Found, Row};
use volcomp_model::geometry::rotation_about;
use volcomp_model::{ModelError, Pose, Sense};
use volcomp_units::axes::AxisArray;

/// Size of the only error, within the limits of a model: mm or rad.
const UNIT: f64 = 1e-3;

/// The effects of some errors, each per mm or rad.
pub(super) struct Effects {
    models: Vec<Model>,
}

impl Effects {
    /// Of the given errors on the geometry of `spec`.
    pub(super) fn new(spec: &ModelSpec, symbols: &[ErrorSymbol]) -> Result<Self, ModelError> {
        let alone = |symbol: &ErrorSymbol| {
            let mut spec = spec.clone();
            spec.datum.clear();
            spec.errors = vec![(*symbol, ErrorFunction::single(Curve::Constant(UNIT)))];
            Model::new(&spec)
        };
        Ok(Self { models: symbols.iter().map(alone).collect::<Result<_, _>>()? })
    }

    /// One column per error: displacement of the tip in W.
    pub(super) fn at(&self, row: &Row) -> Matrix3xX<f64> {
        let pose = Pose { tool_tip: Some(row.tip), ..Pose::at(row.position) };
        let columns: Vec<Vec3> = self.models.iter().map(|m| m.deviation(&pose).position / UNIT).collect();
        Matrix3xX::from_columns(&columns)
    }
}

/// The six motions of an axis, of those asked for.
pub(super) fn motions(axis: AxisName, components: &[Component]) -> Vec<ErrorSymbol> {
    components.iter().map(|&component| ErrorSymbol::Motion { component, axis }).collect()
}

/// The location errors of a rotary axis.
pub(super) fn locations(axis: AxisName) -> Vec<ErrorSymbol> {
    if axis.kind() == AxisKind::Linear {
        return Vec::new();
    }
    let across = |c: &Component| c.index() % 3 != axis.direction();
    let of = |component| ErrorSymbol::Location { component, axis };
    Component::ALL.into_iter().filter(across).map(of).collect()
}

/// What corrections do: an axis that goes too far by `c` is an error along itself.
pub(super) fn of_corrections(spec: &ModelSpec) -> Result<Effects, ModelError> {
    let mut relative = spec.clone();
    for axis in &mut relative.axes {
        axis.sense = Sense::Relative;
    }
    let along = |axis: AxisName| {
        let turned = if axis.kind() == AxisKind::Rotary { 3 } else { 0 };
        ErrorSymbol::Motion { component: Component::ALL[axis.direction() + turned], axis }
    };
    let symbols: Vec<ErrorSymbol> = spec.chain.axes().iter().map(|a| along(a.name)).collect();
    Effects::new(&relative, &symbols)
}

/// Columns of all motions found so far, at every position but the reference ones: 3 rows. `effects` holds one per step.
pub(super) fn of_found(spec: &ModelSpec, steps: &[Found], effects: &[Effects], row: &Row) -> DMatrix<f64> {
    let width = steps.iter().map(Found::unknowns).sum();
    let mut columns = DMatrix::zeros(3, width);
    let mut start = 0;
    for (found, effects) in steps.iter().zip(effects) {
        let one = effects.at(row);
        let q = spec.chain.index_of(found.axis).map_or(0.0, |k| row.position[k]);
        for (index, weight) in hat(&found.positions, q) {
            if let Some(at) = found.column_of(index) {
                for c in 0..one.ncols() {
                    for i in 0..3 {
                        columns[(i, start + at + c)] += weight * one[(i, c)];
                    }
                }
            }
        }
        start += found.unknowns();
    }
    columns
}

impl Found {
    /// Values found in this step: none at the reference position.
    pub(super) fn unknowns(&self) -> usize {
        self.motions.len() * (self.positions.len() - 1)
    }

    /// First column of a position; `None` for the reference.
    pub(super) fn column_of(&self, position: usize) -> Option<usize> {
        let before = position - usize::from(position > self.reference);
        (position != self.reference).then_some(before * self.motions.len())
    }
}

/// The positions between which `q` lies and their weights; beyond the ends the end value is held.
fn hat(positions: &[f64], q: f64) -> [(usize, f64); 2] {
    let last = positions.len() - 1;
    let i = positions.partition_point(|p| *p <= q).saturating_sub(1).min(last - 1);
    let share = ((q - positions[i]) / (positions[i + 1] - positions[i])).clamp(0.0, 1.0);
    [(i, 1.0 - share), (i + 1, share)]
}

/// Nominal place of the tip in W.
///
/// # Source  equations 2: Trans(-w0) PROD Trans(P) J Trans(-P) Trans(t0)
pub(super) fn nominal_tip(spec: &ModelSpec, position: &AxisArray, tip: &Vec3) -> Vec3 {
    let mut p = *tip;
    for (k, axis) in spec.chain.axes().iter().enumerate().rev() {
        let direction = axis.name.direction();
        match axis.kind() {
            AxisKind::Linear => p += unit(direction) * position[k],
            AxisKind::Rotary => {
                let point = spec.axis(axis.name).point;
                p = rotation_about(direction, position[k]) * (p - point) + point;
            }
        }
    }
    p - spec.workpiece_origin
}

/// Columns of the artefact's shift and turn: `d + delta x p`.
pub(super) fn set_up(p: &Vec3) -> nalgebra::SMatrix<f64, 3, 6> {
    let mut columns = nalgebra::SMatrix::<f64, 3, 6>::zeros();
    for i in 0..3 {
        columns[(i, i)] = 1.0;
        let turned: Vector3<f64> = unit(i).cross(p);
        columns.set_column(i + 3, &turned);
    }
    columns
}
