//! Two models of one machine: what changed, each curve by how much, and by how much in the working volume.
//!
//! Differences are second minus first, in relative sense. The volume is the hull of both domains
//! ([`ModelSpec::domain`]): where one model ends, its end value is held, as it would be on the machine. Largest
//! values are attained by the pose given with them (grid and search); [`VolumeDifference::bound_position`] is never
//! exceeded, whatever the search has missed.
//!
//! Source: equations 2 (the deviation is linear in the errors). Reading order: this file, `curves`
//! (error by error), `volume` (in the working volume), `bound`.

mod bound;
mod curves;
mod volume;

pub use curves::{ErrorDifference, relative_values};
pub use volume::{Difference, VolumeDifference};

use super::chain_notation::Chain;
use super::spec::{ReferencePoint, Sense};
use crate::prelude::*;

/// What is different between two models.
#[derive(Debug, Clone, PartialEq)]
pub struct Comparison {
    /// Changes of the chain, the frame and the axes.
    pub changes: Vec<Change>,
    /// Errors that only one has, or that have other values.
    pub errors: Vec<ErrorDifference>,
    /// The difference in the working volume; `None` where the chains have different axes.
    pub volume: Option<VolumeDifference>,
    /// What transient and live terms that differ may add to position, mm, and rotation, rad: the search of the volume sees
    /// none of them. By their limits; angles over the size of the volume.
    pub unsearched: [f64; 2],
}

/// Something that changed beside the errors: before, after.
#[derive(Debug, Clone, PartialEq)]
#[expect(missing_docs, reason = "the variants are their own description")]
pub enum Change {
    Machine([String; 2]),
    Chain([Chain; 2]),
    WorkpieceOrigin([Vec3; 2]),
    ToolTip([Vec3; 2]),
    GaugePoint([Option<Vec3>; 2]),
    Vertical([Option<AxisName>; 2]),
    Tool([ToolErrors; 2]),
    Datum([Vec<(AxisName, f64)>; 2]),
    Travel {
        axis: AxisName,
        values: [Option<[f64; 2]>; 2],
    },
    AxisPoint {
        axis: AxisName,
        values: [Vec3; 2],
    },
    Sense {
        axis: AxisName,
        values: [Sense; 2],
    },
    Reference {
        axis: AxisName,
        component: Component,
        values: [ReferencePoint; 2],
    },
    /// Largest correction of a rotary axis, rad.
    CorrectionLimit {
        axis: AxisName,
        values: [f64; 2],
    },
}

impl Comparison {
    /// True where both say the same.
    #[must_use]
    pub fn is_same(&self) -> bool {
        self.changes.is_empty() && self.errors.is_empty()
    }
}

/// Compares two models; `progress` receives how many of about how many poses are done.
///
/// # Errors
/// One of the models breaks a rule.
pub fn compare(
    first: &ModelSpec,
    second: &ModelSpec,
    progress: impl FnMut(u64, u64),
) -> Result<Comparison, ModelError> {
    let models = [Model::new(first)?, Model::new(second)?];
    let specs = [first, second];
    let pair = Pair::new(specs, &models);
    let errors = curves::differences(&pair);
    let volume = pair.same_axes().then(|| volume::difference(&pair, progress));
    let sum = |angle: bool| -> f64 {
        errors.iter().filter(|e| e.symbol.is_angle() == angle).map(|e| e.unsearched).fold(0.0, |a, b| a + b)
    };
    let [length, angle] = [sum(false), sum(true)];
    let size: f64 = volume.iter().flat_map(|v| &v.ranges).map(|[low, high]| high - low).sum();
    let unsearched = [length + angle * (size + second.tool_tip.norm()), angle];
    Ok(Comparison { changes: changes(specs), errors, unsearched, volume })
}

/// Two models, and which axis of the one is which of the other.
struct Pair<'a> {
    specs: [&'a ModelSpec; 2],
    models: &'a [Model; 2],
    /// For every axis of the first chain its index in the second.
    index: Vec<Option<usize>>,
}

impl<'a> Pair<'a> {
    fn new(specs: [&'a ModelSpec; 2], models: &'a [Model; 2]) -> Self {
        let index = specs[0].chain.axes().iter().map(|a| specs[1].chain.index_of(a.name)).collect();
        Self { specs, models, index }
    }

    /// True where both chains have the same axes, in whatever order.
    fn same_axes(&self) -> bool {
        self.index.iter().all(Option::is_some) && self.index.len() == self.specs[1].chain.axes().len()
    }

    /// The hull of both domains of an axis: a travel or, where none is stated, the range of its curves.
    fn travel(&self, axis: AxisName) -> Option<[f64; 2]> {
        let domains = self.specs.iter().filter_map(|s| s.domain(axis));
        domains.reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])])
    }
}

/// Both values where they differ.
fn changed<T: Clone + PartialEq>(a: &T, b: &T) -> Option<[T; 2]> {
    (a != b).then(|| [a.clone(), b.clone()])
}

fn changes([a, b]: [&ModelSpec; 2]) -> Vec<Change> {
    let whole = [
        changed(&a.machine, &b.machine).map(Change::Machine),
        changed(&a.chain, &b.chain).map(Change::Chain),
        changed(&a.workpiece_origin, &b.workpiece_origin).map(Change::WorkpieceOrigin),
        changed(&a.tool_tip, &b.tool_tip).map(Change::ToolTip),
        changed(&a.gauge_point, &b.gauge_point).map(Change::GaugePoint),
        changed(&a.vertical, &b.vertical).map(Change::Vertical),
        changed(&a.tool, &b.tool).map(Change::Tool),
        changed(&a.datum, &b.datum).map(Change::Datum),
    ];
    let mut out: Vec<Change> = whole.into_iter().flatten().collect();
    for entry in a.chain.axes().iter().filter(|x| b.chain.index_of(x.name).is_some()) {
        let axis = entry.name;
        let (x, y) = (a.axis(axis), b.axis(axis));
        out.extend(changed(&x.travel, &y.travel).map(|values| Change::Travel { axis, values }));
        out.extend(changed(&x.point, &y.point).map(|values| Change::AxisPoint { axis, values }));
        out.extend(changed(&x.sense, &y.sense).map(|values| Change::Sense { axis, values }));
        out.extend(
            changed(&x.correction_limit, &y.correction_limit)
                .map(|values| Change::CorrectionLimit { axis, values }),
        );
        for ((component, x), y) in
            Component::ALL.into_iter().zip(&x.reference_points).zip(&y.reference_points)
        {
            out.extend(changed(x, y).map(|values| Change::Reference { axis, component, values }));
        }
    }
    out
}

#[cfg(test)]
mod tests;
