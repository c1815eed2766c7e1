//! Legendre polynomials, and what angular errors are made of.

use crate::shape::WIDTH_MAX;

/// `P_0(s)` to `P_n(s)`, as many as `values` holds.
pub fn legendre(s: f64, values: &mut [f64]) {
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

/// The functions of a position that make up an angular error, all zero at the zero of its axis: `x/half`, then Legendre
/// polynomials about the middle of the data less their value at zero, held beyond the data; powers of `x/half` where no
/// middle is given.
pub fn twist(x_mm: f64, half_mm: f64, centre_mm: Option<f64>, values: &mut [f64]) {
    let Some(centre_mm) = centre_mm else {
        let mut power = 1.0;
        for v in values {
            power *= x_mm / half_mm;
            *v = power;
        }
        return;
    };
    let degree = values.len();
    let at = |x: f64| {
        let mut p = [0.0; WIDTH_MAX + 1];
        legendre(((x - centre_mm) / half_mm).clamp(-1.2, 1.2), &mut p[..=degree]);
        p
    };
    let (here, zero) = (at(x_mm), at(0.0));
    for (k, v) in values.iter_mut().enumerate() {
        *v = if k == 0 { x_mm / half_mm } else { here[k + 1] - zero[k + 1] };
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

    #[test]
    fn an_angle_is_zero_at_the_zero_of_its_axis_and_held_beyond_the_data() {
        for centre in [Some(250.0), Some(-40.0), None] {
            let mut v = [1.0; 8];
            twist(0.0, 240.0, centre, &mut v);
            assert!(v.iter().all(|v| v.abs() < 1e-14), "{centre:?}: {v:?}");
        }
        let (mut a, mut b) = ([0.0; 4], [0.0; 4]);
        twist(600.0, 200.0, Some(250.0), &mut a);
        twist(900.0, 200.0, Some(250.0), &mut b);
        assert_eq!((a[0], b[0]), (3.0, 4.5));
        assert_eq!(a[1..], b[1..]);
        // additions of before: powers
        twist(100.0, 200.0, None, &mut a);
        assert_eq!(a, [0.5, 0.25, 0.125, 0.0625]);
    }
}
