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

/// Units of keys and columns by their ends, each with its size in the smallest of its quantity.
const SIZES: [&[(&str, f64)]; 3] = [
    &[("nm", 1.0), ("um", 1e3), ("mm", 1e6), ("cm", 1e7), ("m", 1e9), ("in", 25.4e6), ("inch", 25.4e6)],
    &[
        ("urad", 1e-6 / RAD_PER_ARCSEC),
        ("arcsec", 1.0),
        ("arcmin", 60.0),
        ("mrad", 1e-3 / RAD_PER_ARCSEC),
        ("deg", 3600.0),
        ("rad", 1.0 / RAD_PER_ARCSEC),
    ],
    &[("us", 1.0), ("ms", 1e3), ("s", 1e6), ("min", 6e7), ("h", 3.6e9)],
];

/// The factor from one unit of keys and columns to another (`mm` to `um`: 1000; `mm_per_min` to `mm_per_s`: 1/60); `None`
/// where they are not of one quantity or not known.
#[must_use]
pub fn conversion(from: &str, to: &str) -> Option<f64> {
    let (from, to) = (from.replace('-', "_"), to.replace('-', "_"));
    let part = |from: &str, to: &str| {
        let size =
            |list: &[(&str, f64)], unit| list.iter().find(|(name, _)| *name == unit).map(|(_, size)| *size);
        SIZES.iter().find_map(|list| Some(size(list, from)? / size(list, to)?))
    };
    match (from.split_once("_per_"), to.split_once("_per_")) {
        (None, None) => part(&from, &to),
        (Some((from, below_from)), Some((to, below_to))) => {
            let below = match (below_from.strip_suffix('2'), below_to.strip_suffix('2')) {
                (Some(a), Some(b)) => part(a, b)?.powi(2),
                (None, None) => part(below_from, below_to)?,
                _ => return None,
            };
            Some(part(from, to)? / below)
        }
        _ => None,
    }
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
    fn units_of_keys_and_columns_convert_within_their_quantity() {
        for (from, to, factor) in [
            ("mm", "um", 1000.0),
            ("um", "mm", 0.001),
            ("m", "mm", 1000.0),
            ("in", "mm", 25.4),
            ("deg", "arcsec", 3600.0),
            ("mm-per-s", "um-per-s", 1000.0),
            ("mm_per_min", "mm_per_s", 1.0 / 60.0),
            ("mm_per_s2", "um_per_s2", 1000.0),
            ("s", "ms", 1000.0),
        ] {
            assert!((conversion(from, to).unwrap() / factor - 1.0).abs() < 1e-12, "{from} {to}");
        }
        for (from, to) in [("mm", "deg"), ("um", "arcsec"), ("mm", "mm_per_s"), ("degc", "um"), ("", "um")] {
            assert_eq!(conversion(from, to), None, "{from} {to}");
        }
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
