//! ISO 1328-1: profile and helix (lead) deviations of an involute gear, their tolerances and classes.
//!
//! A trace is the deviation of a flank, normal to the design flank in the transverse plane (along the base tangent),
//! plus = excess of material, over its position: roll length from the base circle for a profile, distance from a datum
//! face for a helix. [`Part`] says between which positions it counts:
//! - profile: the functional length runs from the control diameter `d_Cf` to the tip; the outer 5 % are the tip zone;
//! - helix: the functional length is the face width `b`; end zones are the smaller of 5 % of `b` and one module.
//!
//! The mean line is fitted by least squares over the evaluation length (functional length less the zones). In a zone a
//! reading counts only where it is excess of material.
//!
//! Deviations in um, positions in mm. Source: ISO 1328-1:2013, 3.3 and 3.4 (definitions), 5.3 (tolerances; not yet
//! compared with the printed text). Reading order: this file, [`trace`], [`tolerance`].

pub mod tolerance;
pub mod trace;

pub use tolerance::{CLASSES, Quantity, class, tolerance_um};
pub use trace::{Deviations, GearTrace, OfFlank, class_of, evaluate, flanks, mean_of, passes_averaged};

/// A cylindrical involute gear.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gear {
    /// Number of teeth.
    pub teeth: u32,
    /// Normal module, mm.
    pub module_mm: f64,
    /// Normal pressure angle, rad.
    pub pressure_angle: f64,
    /// Helix angle at the reference diameter, rad.
    pub helix_angle: f64,
    /// Face width, mm.
    pub face_width_mm: f64,
    /// Tip diameter, mm.
    pub tip_diameter_mm: f64,
    /// Profile control diameter, mm: where the functional profile begins.
    pub control_diameter_mm: f64,
}

/// What a trace runs along.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Direction {
    /// From root to tip.
    Profile,
    /// Along the face width.
    Helix,
}

impl Direction {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Profile, Self::Helix];

    /// The word in files: `profile` or `lead`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Profile => "profile",
            Self::Helix => "lead",
        }
    }

    /// Greek letter of the symbols of ISO 1328-1, in Latin ones.
    #[must_use]
    pub const fn letter(self) -> &'static str {
        match self {
            Self::Profile => "alpha",
            Self::Helix => "beta",
        }
    }
}

/// The two flanks of a tooth, seen from the datum face with the tip upwards.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Flank {
    /// Left.
    Left,
    /// Right.
    Right,
}

impl Flank {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Left, Self::Right];

    /// The word in files: `left` or `right`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Left => "left",
            Self::Right => "right",
        }
    }
}

/// Positions between which a trace counts, mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Part {
    /// Functional length.
    pub functional: [f64; 2],
    /// Evaluation length, within the functional length.
    pub evaluation: [f64; 2],
}

/// Why a gear or its traces cannot be evaluated.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[expect(missing_docs, reason = "the fields are what the message prints")]
pub enum GearError {
    /// A number of the gear that the tolerances do not cover.
    #[error("{what} {value} is outside of {low} to {high}, the range of ISO 1328-1:2013; correct it")]
    Range { what: &'static str, value: f64, low: f64, high: f64 },
    /// Diameters in the wrong order.
    #[error(
        "base diameter {base_mm:.3} mm, control diameter {control_mm:.3} mm, tip diameter {tip_mm:.3} mm: each must be above the one before"
    )]
    Diameters { base_mm: f64, control_mm: f64, tip_mm: f64 },
    /// A reading that is no number.
    #[error("a reading of tooth {tooth} is not finite")]
    NotFinite { tooth: u32 },
    /// Too few readings.
    #[error(
        "tooth {tooth}: too few readings between {from:.3} and {to:.3} mm: {found}; a mean line needs at least {needed}"
    )]
    TooFew { tooth: u32, found: usize, from: f64, to: f64, needed: usize },
    /// Readings that leave out a piece of the evaluation length.
    #[error(
        "tooth {tooth}: no reading within {gap:.3} mm from {from:.3} mm on, of an evaluation length of {length:.3} mm; measure at steps below {limit:.3} mm"
    )]
    Gap { tooth: u32, gap: f64, from: f64, length: f64, limit: f64 },
}

impl Gear {
    /// Checks the numbers against the scope of the standard.
    ///
    /// # Errors
    /// A number out of range, or diameters that do not follow each other.
    pub fn check(&self) -> Result<(), GearError> {
        let degrees = volcomp_units::deg_from_rad;
        let ranges = [
            ("number of teeth", f64::from(self.teeth), 5.0, 1000.0),
            ("module (mm)", self.module_mm, 0.5, 70.0),
            ("reference diameter (mm)", self.reference_diameter_mm(), 5.0, 15_000.0),
            ("face width (mm)", self.face_width_mm, 4.0, 1200.0),
            ("helix angle (deg)", degrees(self.helix_angle).abs(), 0.0, 45.0),
            ("pressure angle (deg)", degrees(self.pressure_angle), 5.0, 45.0),
        ];
        for (what, value, low, high) in ranges {
            if !(low..=high).contains(&value) {
                return Err(GearError::Range { what, value, low, high });
            }
        }
        let (base_mm, control_mm, tip_mm) =
            (2.0 * self.base_radius_mm(), self.control_diameter_mm, self.tip_diameter_mm);
        // also where one of them is no number
        if !(base_mm < control_mm && control_mm < tip_mm && tip_mm.is_finite()) {
            return Err(GearError::Diameters { base_mm, control_mm, tip_mm });
        }
        Ok(())
    }

    /// Reference diameter `d = z m_n / cos(beta)`, mm.
    #[must_use]
    pub fn reference_diameter_mm(&self) -> f64 {
        f64::from(self.teeth) * self.module_mm / self.helix_angle.cos()
    }

    /// Radius of the base circle `r_b = d/2 cos(alpha_t)`, mm.
    #[must_use]
    pub fn base_radius_mm(&self) -> f64 {
        let transverse = (self.pressure_angle.tan() / self.helix_angle.cos()).atan();
        0.5 * self.reference_diameter_mm() * transverse.cos()
    }

    /// Roll length at a diameter, mm; zero within the base circle.
    #[must_use]
    pub fn roll_length_mm(&self, diameter_mm: f64) -> f64 {
        let (r, base) = (0.5 * diameter_mm, self.base_radius_mm());
        (r * r - base * base).max(0.0).sqrt()
    }

    /// Where traces of a direction count.
    #[must_use]
    pub fn part(&self, direction: Direction) -> Part {
        match direction {
            Direction::Profile => {
                let from = self.roll_length_mm(self.control_diameter_mm);
                let to = self.roll_length_mm(self.tip_diameter_mm);
                Part { functional: [from, to], evaluation: [from, to - 0.05 * (to - from)] }
            }
            Direction::Helix => {
                let zone = (0.05 * self.face_width_mm).min(self.module_mm);
                let evaluation = [zone, self.face_width_mm - zone];
                Part { functional: [0.0, self.face_width_mm], evaluation }
            }
        }
    }
}

#[cfg(test)]
mod tests;
