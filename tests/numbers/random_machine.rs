//! Random machines of every type, for tests of what must hold for all of them.

#![expect(clippy::unwrap_used, reason = "helpers of tests")]

use volcomp::model::axes::{AxisKind, AxisName, MAX_AXES};
use volcomp::model::curve::{Curve, ErrorFunction, Interpolation, Table};
use volcomp::model::geometry::Vec3;
use volcomp::model::{AxisSpec, Chain, Component, ErrorSymbol, Model, ModelSpec, Pose};

/// Machine types.
pub(crate) const CHAINS: &[&str] = &[
    "[w b X Y Z t]",
    "[w X' b Y Z t]",
    "[w X' Y' b Z t]",
    "[w X' Y' Z' b t]",
    "[w b X Y Z C A (S) t]",
    "[w C' A' b X Y Z t]",
    "[w C' B' Y' b X Z (S) t]",
    "[w A' b X Y B t]",
    "[w B' X' b Z t]",
];

/// One random number in [-1, 1] for anything that has a name.
pub(crate) fn noise(seed: u64, what: &str) -> f64 {
    let mut h = seed ^ 0x9e37_79b9_7f4a_7c15;
    for b in what.bytes() {
        h = (h ^ u64::from(b)).wrapping_mul(0x0100_0000_01b3);
        h ^= h >> 29;
    }
    (h.wrapping_mul(0xbf58_476d_1ce4_e5b9) >> 11) as f64 / (1u64 << 52) as f64 - 1.0
}

pub(crate) fn point(seed: u64, what: &str, size: f64) -> Vec3 {
    Vec3::from_fn(|i, _| size * noise(seed, &format!("{what}{i}")))
}

/// A random machine; lengths to 20 um, angles to 60 urad times `scale`.
pub(crate) fn machine(chain: &str, seed: u64, scale: f64) -> ModelSpec {
    let mut spec = ModelSpec::new("random", Chain::parse(chain).unwrap());
    spec.workpiece_origin = point(seed, "w", 300.0);
    spec.tool_tip = point(seed, "t", 300.0);
    let axes: Vec<_> = spec.chain.axes().to_vec();
    for axis in &axes {
        let name = axis.name;
        let mut entry = AxisSpec::new(name);
        entry.point = point(seed, &format!("p{name}"), 300.0);
        for (i, r) in entry.reference_points.iter_mut().enumerate() {
            r.point = point(seed, &format!("r{name}{i}"), 200.0);
        }
        spec.axes.push(entry);
        for component in Component::ALL {
            let size = if component.is_angle() { 6e-5 } else { 0.02 } * scale;
            let reach = if axis.kind() == AxisKind::Linear { 600.0 } else { 4.0 };
            let at = |i: i32| size * noise(seed, &format!("e{name}{component:?}{i}"));
            let x = (-2..=2).map(|i| reach * f64::from(i) / 2.0).collect();
            let table = Table::new(x, (-2..=2).map(at).collect(), None, Interpolation::Linear).unwrap();
            let motion = ErrorSymbol::Motion { component, axis: name };
            spec.errors.push((motion, ErrorFunction::single(Curve::Table(table))));
            let location = ErrorSymbol::parse(&format!("e{}0{name}", component.letter()));
            if let Some(symbol) = location.filter(|s| spec.chain.index_of(s.axis()).is_some()) {
                let partner_missing = matches!(symbol, ErrorSymbol::Squareness { .. })
                    && [AxisName::X, AxisName::Y].iter().any(|p| spec.chain.index_of(*p).is_none());
                if !partner_missing {
                    let value = size * noise(seed, &format!("l{symbol}"));
                    spec.errors.push((symbol, ErrorFunction::single(Curve::Constant(value))));
                }
            }
        }
    }
    spec
}

pub(crate) fn pose(spec: &ModelSpec, seed: u64) -> Pose {
    let mut position = [0.0; MAX_AXES];
    for (k, axis) in spec.chain.axes().iter().enumerate() {
        let reach = if axis.kind() == AxisKind::Linear { 500.0 } else { 3.0 };
        position[k] = reach * noise(seed, &format!("q{k}"));
    }
    Pose::at(position)
}

pub(crate) fn compile(spec: &ModelSpec) -> Model {
    Model::new(spec).unwrap()
}
