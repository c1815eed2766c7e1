//! Tolerances of ISO 1328-1:2013 and the class that a deviation keeps.
//!
//! Class 5, um, lengths in mm; each class is wider by `sqrt 2` than the one before:
//! `f_HaT = 0.4 m_n + 0.001 d + 4`, `f_faT = 0.55 m_n + 5`, `f_HbT = 0.05 sqrt d + 0.35 sqrt b + 4`,
//! `f_fbT = 0.07 sqrt d + 0.45 sqrt b + 4`; the totals `F_aT`, `F_bT` are the roots of the sums of squares of their two,
//! unrounded. Rounding: above 10 um to 1 um, from 5 to 10 um to 0.5 um, below 5 um to 0.1 um.

use super::{Direction, Gear};

/// Tolerance classes of the standard: first and last.
pub const CLASSES: [u8; 2] = [1, 11];

/// What a tolerance is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Quantity {
    /// F: total deviation.
    Total,
    /// f_f: form deviation.
    Form,
    /// f_H: slope deviation.
    Slope,
}

/// Tolerance of a class, um.
#[must_use]
pub fn tolerance_um(gear: &Gear, direction: Direction, quantity: Quantity, class: u8) -> f64 {
    let (m, d, b) = (gear.module_mm, gear.reference_diameter_mm(), gear.face_width_mm);
    let [slope, form] = match direction {
        Direction::Profile => [0.4 * m + 0.001 * d + 4.0, 0.55 * m + 5.0],
        Direction::Helix => {
            [0.05 * d.sqrt() + 0.35 * b.sqrt() + 4.0, 0.07 * d.sqrt() + 0.45 * b.sqrt() + 4.0]
        }
    };
    let at_five = match quantity {
        Quantity::Total => slope.hypot(form),
        Quantity::Form => form,
        Quantity::Slope => slope,
    };
    rounded(at_five * 2f64.powf(0.5 * (f64::from(class) - 5.0)))
}

fn rounded(um: f64) -> f64 {
    if um > 10.0 {
        um.round()
    } else if um >= 5.0 {
        0.5 * (2.0 * um).round()
    } else {
        0.1 * (10.0 * um).round()
    }
}

/// The finest class whose tolerance a deviation keeps, by its size; `None` beyond the last class.
#[must_use]
pub fn class(gear: &Gear, direction: Direction, quantity: Quantity, deviation_um: f64) -> Option<u8> {
    let [first, last] = CLASSES;
    // a tolerance is a decimal number, the deviation is not: rounding of doubles must not cost a class
    (first..=last).find(|c| deviation_um.abs() <= tolerance_um(gear, direction, quantity, *c) + 1e-9)
}
