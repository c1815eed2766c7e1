//! Axis letters and the fixed-size arrays that hold one value per axis.

use core::fmt;

use crate::{arcsec_from_rad, deg_from_rad, mm_from_um, rad_from_arcsec, rad_from_deg, um_from_mm};

/// The most axes a machine may have on the link and in a model.
pub const MAX_AXES: usize = 8;

/// One value per axis; entries beyond the number of axes are zero.
pub type AxisArray = [f64; MAX_AXES];

/// Letters of ISO 841: linear X Y Z and their parallels U V W, rotary A B C, spindle S (turns about z).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[expect(missing_docs, reason = "the letters are their own description")]
pub enum AxisName {
    X,
    Y,
    Z,
    U,
    V,
    W,
    A,
    B,
    C,
    S,
}

/// How an axis moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum AxisKind {
    /// Along a line; coordinates in mm.
    Linear,
    /// About a line; coordinates in rad inside, in degrees at every boundary.
    Rotary,
}

impl AxisKind {
    /// True for an axis that turns.
    #[must_use]
    pub const fn is_rotary(self) -> bool {
        matches!(self, Self::Rotary)
    }

    /// The word for it: `linear` or `rotary`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        if self.is_rotary() { "rotary" } else { "linear" }
    }

    /// Unit of positions at every boundary: `mm` or `deg`.
    #[must_use]
    pub const fn position_unit(self) -> &'static str {
        if self.is_rotary() { "deg" } else { "mm" }
    }

    /// Unit of offsets and deviations at every boundary: `um` or `arcsec`.
    #[must_use]
    pub const fn offset_unit(self) -> &'static str {
        if self.is_rotary() { "arcsec" } else { "um" }
    }

    /// A position in mm or deg, from mm or rad.
    #[must_use]
    pub fn position_out(self, v: f64) -> f64 {
        if self.is_rotary() { deg_from_rad(v) } else { v }
    }

    /// A position in mm or rad, from mm or deg.
    #[must_use]
    pub fn position_in(self, v: f64) -> f64 {
        if self.is_rotary() { rad_from_deg(v) } else { v }
    }

    /// An offset or deviation in um or arcsec, from mm or rad.
    #[must_use]
    pub fn offset_out(self, v: f64) -> f64 {
        if self.is_rotary() { arcsec_from_rad(v) } else { um_from_mm(v) }
    }

    /// An offset or deviation in mm or rad, from um or arcsec.
    #[must_use]
    pub fn offset_in(self, v: f64) -> f64 {
        if self.is_rotary() { rad_from_arcsec(v) } else { mm_from_um(v) }
    }
}

impl AxisName {
    /// Every axis letter, in the order of the enum.
    pub const ALL: [Self; 10] =
        [Self::X, Self::Y, Self::Z, Self::U, Self::V, Self::W, Self::A, Self::B, Self::C, Self::S];

    /// The axis of a letter, upper or lower case.
    #[must_use]
    pub fn from_letter(letter: char) -> Option<Self> {
        Self::ALL.into_iter().find(|a| a.letter() == letter.to_ascii_uppercase())
    }

    /// The upper-case letter.
    #[must_use]
    pub const fn letter(self) -> char {
        match self {
            Self::X => 'X',
            Self::Y => 'Y',
            Self::Z => 'Z',
            Self::U => 'U',
            Self::V => 'V',
            Self::W => 'W',
            Self::A => 'A',
            Self::B => 'B',
            Self::C => 'C',
            Self::S => 'S',
        }
    }

    /// The lower-case letter, as used in keys and columns.
    #[must_use]
    pub const fn lower(self) -> char {
        self.letter().to_ascii_lowercase()
    }

    /// Linear or rotary.
    #[must_use]
    pub const fn kind(self) -> AxisKind {
        match self {
            Self::X | Self::Y | Self::Z | Self::U | Self::V | Self::W => AxisKind::Linear,
            Self::A | Self::B | Self::C | Self::S => AxisKind::Rotary,
        }
    }

    /// Index of the direction in M along or about which the axis moves: 0 = x, 1 = y, 2 = z.
    #[must_use]
    pub const fn direction(self) -> usize {
        match self {
            Self::X | Self::U | Self::A => 0,
            Self::Y | Self::V | Self::B => 1,
            Self::Z | Self::W | Self::C | Self::S => 2,
        }
    }
}

impl fmt::Display for AxisName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.letter())
    }
}

/// Direction of travel of an axis; decides between the forward and the reverse curve of a table.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Travel {
    /// Towards plus, or not known.
    #[default]
    Forward,
    /// Towards minus.
    Reverse,
}

impl Travel {
    /// The opposite direction.
    #[must_use]
    pub const fn reversed(self) -> Self {
        match self {
            Self::Forward => Self::Reverse,
            Self::Reverse => Self::Forward,
        }
    }

    /// +1 towards plus, -1 towards minus.
    #[must_use]
    pub const fn sign(self) -> f64 {
        match self {
            Self::Forward => 1.0,
            Self::Reverse => -1.0,
        }
    }
}
