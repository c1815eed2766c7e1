//! Numbers as short as they can be without losing anything.

/// Digits that every f64 has; more are tried only where these are not enough.
const SURE_DIGITS: usize = 15;

/// The shortest decimal that `read` turns back into `inside`; `wire` is the same number in the unit of the file.
pub(super) fn shortest(inside: f64, wire: f64, read: fn(f64) -> f64) -> String {
    for digits in SURE_DIGITS..=17 {
        let text = format!("{wire:.*e}", digits - 1);
        if let Ok(number) = text.parse::<f64>()
            && read(number) == inside
        {
            return plain(number);
        }
    }
    plain(wire)
}

/// A number as TOML reads it.
pub(super) fn plain(number: f64) -> String {
    let size = number.abs();
    // far from 1 an exponent is shorter; TOML integers end at 2^63
    if number != 0.0 && !(1e-5..1e15).contains(&size) { format!("{number:e}") } else { format!("{number}") }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use volcomp_units::{mm_from_um, rad_from_arcsec, um_from_mm};

    #[test]
    fn numbers_come_back_as_they_were_written() {
        for (um, text) in
            [(1.1, "1.1"), (0.7, "0.7"), (-3.13, "-3.13"), (0.0, "0"), (1e-9, "1e-9"), (250.0, "250")]
        {
            let mm = mm_from_um(um);
            assert_eq!(shortest(mm, um_from_mm(mm), mm_from_um), text);
            let rad = rad_from_arcsec(um);
            assert_eq!(shortest(rad, volcomp_units::arcsec_from_rad(rad), rad_from_arcsec), text);
        }
    }

    proptest! {
        #[test]
        fn any_number_survives(mm in prop::num::f64::NORMAL | prop::num::f64::ZERO) {
            prop_assume!(mm.abs() < 1e300);
            let back = mm_from_um(shortest(mm, um_from_mm(mm), mm_from_um).parse::<f64>().unwrap());
            prop_assert!((back - mm).abs() <= 1e-15 * mm.abs());
        }
    }
}
