//! Legendre polynomials.

/// `P_0(s)` to `P_n(s)`, as many as `values` holds.
pub(in super::super) fn legendre(s: f64, values: &mut [f64]) {
    for k in 0..values.len() {
        values[k] = match k {
            0 => 1.0,
            1 => s,
            _ => {
                let n = k as f64;
                ((2.0 * n - 1.0) * s * values[k - 1] - (n - 1.0) * values[k - 2]) / n
            }
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_four_by_their_formulas() {
        for s in [-1.0, -0.3, 0.0, 0.7, 1.0] {
            let mut p = [0.0; 4];
            legendre(s, &mut p);
            assert!((p[2] - 0.5 * (3.0 * s * s - 1.0)).abs() < 1e-14);
            assert!((p[3] - 0.5 * (5.0 * s * s * s - 3.0 * s)).abs() < 1e-14);
        }
    }
}
