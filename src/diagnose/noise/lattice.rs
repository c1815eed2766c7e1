//! Rounding: readings that are whole multiples of one step.

/// The step of an instrument class.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lattice {
    /// The step, um.
    pub step_um: f64,
    /// Number of different readings that prove it.
    pub different: usize,
}

/// Readings looked at.
const LOOKED_AT: usize = 4000;
/// Least number of different steps between readings.
const DIFFERENT: usize = 4;

/// The largest step of which all readings are multiples (from any origin); `None` where the numbers have no such step
/// above the last decimals of the file.
#[must_use]
pub fn lattice(values: &[f64]) -> Option<Lattice> {
    let mut sorted: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).take(LOOKED_AT).collect();
    sorted.sort_by(f64::total_cmp);
    sorted.dedup_by(|b, a| (*b - *a).abs() < 1e-9);
    if sorted.len() < DIFFERENT {
        return None;
    }
    let mut step = sorted.windows(2).map(|w| w[1] - w[0]).fold(f64::INFINITY, f64::min);
    // a common divisor of the differences may be smaller than the smallest of them
    for w in sorted.windows(2) {
        let (mut a, mut b) = (step, w[1] - w[0]);
        while b > 1e-7 {
            let r = a - (a / b).floor() * b;
            a = b;
            b = if r > b - 1e-7 || r < 1e-7 { 0.0 } else { r };
        }
        step = a;
        if step < 1e-5 {
            return None;
        }
    }
    let origin = sorted[0];
    let on = sorted.iter().all(|v| {
        let k = (v - origin) / step;
        (k - k.round()).abs() < 1e-3
    });
    on.then_some(Lattice { step_um: step, different: sorted.len() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_found_and_free_numbers_have_none() {
        let coarse: Vec<f64> = (0..50).map(|i| f64::from((i * 7) % 23) * 0.5 + 3.1).collect();
        assert!((lattice(&coarse).unwrap().step_um - 0.5).abs() < 1e-6);
        let mixed: Vec<f64> = [0.0, 4.0, 6.0, 10.0, 16.0].to_vec();
        assert!((lattice(&mixed).unwrap().step_um - 2.0).abs() < 1e-6);
        let free: Vec<f64> = (0..50).map(|i| (f64::from(i) * 1.234_567).sin()).collect();
        assert_eq!(lattice(&free), None);
    }
}
