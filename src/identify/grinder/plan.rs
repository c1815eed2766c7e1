//! Where to measure next: poses for one axis that keep the axes not yet known at rest.
//!
//! The axes known so far go through their own measured positions in a staggered order, so that what was left over of
//! them shows up as scatter (and in the test of the fit) instead of becoming part of the axis measured. Everything
//! refers to the reference position: it is visited several times.

use super::{Chain, GrinderError};
use volcomp_model::geometry::{Vec3, unit};
use volcomp_units::axes::{AxisArray, AxisName, MAX_AXES};

/// One point of a plan.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Planned {
    /// Programmed coordinates, mm and rad, in chain order.
    pub position: AxisArray,
    /// Tool tip in M at home, mm.
    pub tip: Vec3,
}

/// How often the reference position is visited.
const REFERENCE_VISITS: usize = 5;

/// Poses for `axis`: `positions` over its travel and home, each with four tips, `lever` mm apart.
///
/// # Errors
/// The axis is not in the chain, was measured before or has no travel.
pub fn plan(
    chain: &Chain,
    axis: AxisName,
    positions: usize,
    lever: f64,
) -> Result<Vec<Planned>, GrinderError> {
    let spec = chain.spec();
    let index = spec.chain.index_of(axis).ok_or(GrinderError::NotInChain { axis })?;
    if chain.steps().iter().any(|s| s.axis == axis) {
        return Err(GrinderError::Twice { axis });
    }
    if positions < 2 {
        return Err(GrinderError::TooFewPositions { axis, found: positions });
    }
    let [low, high] = spec.axis(axis).travel.ok_or(GrinderError::NoTravel { axis })?;
    let home = 0.0f64.clamp(low, high);
    let spacing = (high - low) / (positions - 1) as f64;
    let mut visits = vec![home; REFERENCE_VISITS];
    let at = (0..positions).map(|i| low + spacing * i as f64);
    visits.extend(at.filter(|q| (q - home).abs() > 1e-6 * spacing));
    let tips = [Vec3::zeros(), unit(0), unit(1), unit(2)].map(|d| spec.tool_tip + d * lever);
    let mut planned = Vec::with_capacity(visits.len() * tips.len());
    for (i, q) in visits.into_iter().enumerate() {
        let mut position = [0.0; MAX_AXES];
        position[index] = q;
        for (j, known) in chain.steps().iter().enumerate() {
            if let Some(k) = spec.chain.index_of(known.axis) {
                position[k] = known.positions[staggered(i, j, known.positions.len())];
            }
        }
        planned.extend(tips.map(|tip| Planned { position, tip }));
    }
    Ok(planned)
}

/// Goes through `0..n` by steps that have no factor in common with `n`, different for every axis.
fn staggered(i: usize, axis: usize, n: usize) -> usize {
    let wanted = (n as f64 * [0.382, 0.276, 0.171, 0.447][axis % 4]).round() as usize;
    let step = (wanted.max(1)..).find(|s| gcd(*s, n) == 1).unwrap_or(1);
    (i * step + axis) % n
}

const fn gcd(a: usize, b: usize) -> usize {
    if b == 0 { a } else { gcd(b, a % b) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_position_of_a_known_axis_is_visited() {
        for axis in 0..6 {
            for n in 2..40 {
                let mut seen: Vec<usize> = (0..n).map(|i| staggered(i, axis, n)).collect();
                seen.sort_unstable();
                assert_eq!(seen, (0..n).collect::<Vec<_>>());
            }
        }
    }
}
