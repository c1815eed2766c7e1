//! Whether a model has the terms of an effect already.

use core::mem::discriminant;

use super::{Candidate, Part};
use volcomp_estimate::{Thermal, ThermalInput};
use volcomp_model::axes::Travel;
use volcomp_model::{Curve, DynamicTerm, ModelSpec};

/// Relative difference of two numbers that are the same; a model file in um and arcsec keeps 15 digits.
const SAME: f64 = 1e-9;
/// Places at which two curves are compared.
const PLACES: u32 = 64;

/// True where some part of the candidate is in the model.
pub(super) fn is_held(candidate: &Candidate, spec: &ModelSpec, thermal: &[Thermal]) -> bool {
    let part = |part: &Part| {
        spec.errors.iter().filter(|(symbol, _)| *symbol == part.symbol).any(|(_, function)| {
            part.dynamic.is_some_and(|new| function.dynamics.iter().any(|old| dynamic(&new, old)))
                || part.curve.as_ref().is_some_and(|new| function.curves.iter().any(|old| curve(new, old)))
        })
    };
    let growth = |new: &Thermal| {
        let same = |old: &Thermal| {
            new.inputs.len() == old.inputs.len()
                && new.inputs.iter().zip(&old.inputs).all(|(n, o)| input(n, o))
        };
        thermal.iter().any(|old| new.expansion == old.expansion && same(old))
    };
    let tool = candidate.tool.is_some_and(|new| {
        let pairs = [
            [new.length, spec.tool.length],
            [new.tilt[0], spec.tool.tilt[0]],
            [new.tilt[1], spec.tool.tilt[1]],
        ];
        pairs.iter().all(|[n, o]| *n == 0.0 || same(*n, *o)) && pairs.iter().any(|[n, _]| *n != 0.0)
    });
    tool || candidate.parts.iter().any(part) || candidate.thermal.iter().any(growth)
}

fn same(a: f64, b: f64) -> bool {
    a != 0.0 && (a - b).abs() <= SAME * a.abs().max(b.abs())
}

fn dynamic(new: &DynamicTerm, old: &DynamicTerm) -> bool {
    discriminant(&new.law) == discriminant(&old.law) && same(new.gain, old.gain) && same(new.limit, old.limit)
}

fn input(new: &ThermalInput, old: &ThermalInput) -> bool {
    new.sensor == old.sensor
        && new.lags_s == old.lags_s
        && new.coefficients.len() == old.coefficients.len()
        && new.coefficients.iter().zip(&old.coefficients).all(|(n, o)| same(*n, *o))
}

fn curve(new: &Curve, old: &Curve) -> bool {
    if let (Curve::Constant(new), Curve::Constant(old)) = (new, old) {
        return same(*new, *old);
    }
    let (Some([low, high]), Some(range)) = (new.range(), old.range()) else { return false };
    let size = SAME * (high - low);
    if (low - range[0]).abs() > size || (high - range[1]).abs() > size {
        return false;
    }
    let at = |k: u32| low + (high - low) * f64::from(k) / f64::from(PLACES);
    let both =
        |k: u32| [Travel::Forward, Travel::Reverse].map(|t| [new.value(at(k), t), old.value(at(k), t)]);
    let values: Vec<[f64; 2]> = (0..=PLACES).flat_map(both).collect();
    let most = values.iter().fold(0.0f64, |m, [n, _]| m.max(n.abs()));
    most > 0.0 && values.iter().all(|[n, o]| (n - o).abs() <= SAME * most)
}
