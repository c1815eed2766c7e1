//! Units at the edges, and the axes that values belong to ([`axes`]). Inside the core every length is in mm, every angle
//! in rad, every time in s; a name without a suffix means one of these. Conversions live here and nowhere else. The
//! simulated machine shares nothing with the compensator but this crate and the protocol.

#![forbid(unsafe_code)]
#![cfg_attr(not(test), forbid(clippy::disallowed_methods))]

pub mod axes;

/// Micrometres in a millimetre.
pub const UM_PER_MM: f64 = 1e3;
/// Radians in one second of arc.
pub const RAD_PER_ARCSEC: f64 = core::f64::consts::PI / (180.0 * 3600.0);
/// Radians in one degree.
pub const RAD_PER_DEG: f64 = core::f64::consts::PI / 180.0;
/// Nanoseconds in a second.
pub const NS_PER_S: f64 = 1e9;

/// Micrometres to millimetres.
#[must_use]
pub fn mm_from_um(um: f64) -> f64 {
    um / UM_PER_MM
}

/// Millimetres to micrometres.
#[must_use]
pub fn um_from_mm(mm: f64) -> f64 {
    mm * UM_PER_MM
}

/// Seconds of arc to radians.
#[must_use]
pub fn rad_from_arcsec(arcsec: f64) -> f64 {
    arcsec * RAD_PER_ARCSEC
}

/// Radians to seconds of arc.
#[must_use]
pub fn arcsec_from_rad(rad: f64) -> f64 {
    rad / RAD_PER_ARCSEC
}

/// Degrees to radians.
#[must_use]
pub fn rad_from_deg(deg: f64) -> f64 {
    deg * RAD_PER_DEG
}

/// Radians to degrees.
#[must_use]
pub fn deg_from_rad(rad: f64) -> f64 {
    rad / RAD_PER_DEG
}

/// A point on a monotonic time line, in nanoseconds since an arbitrary origin.
///
/// Never read inside the core: the shell (or a test, or a recording) passes it in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default, Hash)]
pub struct MonoTime {
    /// Nanoseconds since the origin of the time line.
    pub ns: i64,
}

impl MonoTime {
    /// The origin of the time line.
    pub const ZERO: Self = Self { ns: 0 };

    /// A time from nanoseconds.
    #[must_use]
    pub const fn from_ns(ns: i64) -> Self {
        Self { ns }
    }

    /// Seconds from `earlier` to `self`; negative where `earlier` is later.
    #[must_use]
    pub fn seconds_since(self, earlier: Self) -> f64 {
        self.ns.saturating_sub(earlier.ns) as f64 / NS_PER_S
    }

    /// This time plus `seconds`, saturating at the ends of the line.
    #[must_use]
    pub fn plus_seconds(self, seconds: f64) -> Self {
        Self { ns: self.ns.saturating_add((seconds * NS_PER_S) as i64) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_arcsec_over_one_metre_is_4_85_um() {
        assert!((um_from_mm(rad_from_arcsec(1.0) * 1000.0) - 4.848_136_811).abs() < 1e-8);
    }

    #[test]
    fn conversions_invert() {
        for v in [-3.5, 0.0, 1e-9, 12_345.6] {
            assert!((mm_from_um(um_from_mm(v)) - v).abs() <= 1e-12 * v.abs());
            assert!((rad_from_arcsec(arcsec_from_rad(v)) - v).abs() <= 1e-12 * v.abs());
            assert!((rad_from_deg(deg_from_rad(v)) - v).abs() <= 1e-12 * v.abs());
        }
    }

    #[test]
    fn time_saturates_instead_of_wrapping() {
        let end = MonoTime::from_ns(i64::MAX);
        assert_eq!(end.plus_seconds(10.0), end);
        assert!(end.seconds_since(MonoTime::from_ns(i64::MIN)) > 0.0);
    }
}
