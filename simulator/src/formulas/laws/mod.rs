//! The effects: each one a formula of the state, none of them the tool's.

mod beam;
mod geometry;
mod motion;
mod outside;
mod rotary;
mod warmth;

use nalgebra::Vector3;

use super::chance::Chance;
use super::curve::Field;
use super::heat::Heat;
use super::row::Row;
use super::truth::{Fault, FormulaError, FormulaTruth};

/// What a law may know of the day.
#[derive(Debug, Clone, Copy)]
pub struct World<'a> {
    /// All readings.
    pub rows: &'a [Row],
    /// The heat.
    pub heat: &'a Heat,
    /// Draws what does not come back on another day.
    pub day: u64,
}

/// Deviation of the tool against the workpiece in machine axes, um.
pub type Law = Box<dyn Fn(&Row) -> Vector3<f64>>;

/// Effects of chance: [`super::instrument`] has them.
pub const OF_CHANCE: [&str; 4] = ["vibration", "outliers", "quantisation", "range-noise"];
/// Effects that do not vary with the place: those of instruments and control, and shifts of the whole volume. Of a shift the
/// mounting takes nearly all, so that its variation would be the larger part of what is seen.
const ALIKE_EVERYWHERE: [&str; 8] = [
    "dead-path",
    "tracker-scale",
    "clock-skew",
    "latency",
    "spindle-tilt",
    "tool-length",
    "spindle-growth",
    "ambient-drift",
];
/// Share by which effects vary over the volume in hard mode.
const VARIATION: f64 = 0.2;

/// An effect while its formula is made.
struct Making<'a, 'b> {
    /// Its size, um; the sign counts.
    size: f64,
    /// Its subject.
    subject: &'a str,
    /// Draws its constants.
    chance: &'b mut Chance,
    /// The day.
    world: &'a World<'a>,
}

impl Making<'_, '_> {
    /// The linear axis of the subject.
    fn axis(&self) -> Option<usize> {
        ["x", "y", "z"].iter().position(|a| *a == self.subject)
    }
}

/// The law of every effect of a machine that is no chance.
///
/// # Errors
/// An effect without a formula.
pub fn all(truth: &FormulaTruth, world: &World<'_>) -> Result<Vec<Law>, FormulaError> {
    truth
        .faults
        .iter()
        .filter(|f| !OF_CHANCE.contains(&f.name.as_str()))
        .map(|fault| {
            let law =
                law(fault, truth.seed, world).ok_or_else(|| FormulaError::Effect { label: fault.label() })?;
            if !truth.hard || ALIKE_EVERYWHERE.contains(&fault.name.as_str()) {
                return Ok(law);
            }
            let field = Field::new(&mut Chance::new(truth.seed, &format!("varies {}", fault.label())));
            let varied: Law =
                Box::new(move |r| law(r) * (1.0 + VARIATION * field.at(&Vector3::from(r.position))));
            Ok(varied)
        })
        .collect()
}

fn law(fault: &Fault, seed: u64, world: &World<'_>) -> Option<Law> {
    // an effect has the same constants whatever stands beside it
    let mut chance = Chance::new(seed, &fault.label());
    let mut making = Making { size: fault.size_um, subject: &fault.subject, chance: &mut chance, world };
    let name = fault.name.as_str();
    geometry::law(name, &mut making)
        .or_else(|| motion::law(name, &mut making))
        .or_else(|| warmth::law(name, &mut making))
        .or_else(|| rotary::law(name, &mut making))
        .or_else(|| beam::law(name, &mut making))
        .or_else(|| outside::law(name, &mut making))
}

/// A unit vector along an axis.
fn along(axis: usize) -> Vector3<f64> {
    let mut v = Vector3::zeros();
    if let Some(e) = v.get_mut(axis) {
        *e = 1.0;
    }
    v
}

/// um in a mm.
const UM: f64 = 1e3;

#[cfg(test)]
mod tests;
