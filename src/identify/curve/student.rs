//! Quantiles of Student's t, for intervals whose noise was estimated from the same data.

use core::f64::consts::{FRAC_PI_2, PI};

/// Degrees of freedom above which the first correction to the normal quantile is enough.
const MANY: usize = 2000;
/// Two-sided 95 % quantile of the normal distribution.
const NORMAL: f64 = 1.959_963_984_540_054;

/// Two-sided 95 % quantile for `dof` degrees of freedom (at least 1).
///
/// # Source  Abramowitz and Stegun 26.7.3 and 26.7.4, exact for whole degrees of freedom
pub(super) fn two_sided_95(dof: usize) -> f64 {
    let nu = dof.max(1) as f64;
    if dof > MANY {
        return NORMAL * (1.0 + (NORMAL * NORMAL + 1.0) / (4.0 * nu));
    }
    // the share inside grows with the angle, t = sqrt(nu) tan(angle)
    let (mut low, mut high) = (0.0, FRAC_PI_2);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if inside(middle, dof.max(1)) < 0.95 {
            low = middle;
        } else {
            high = middle;
        }
    }
    nu.sqrt() * (0.5 * (low + high)).tan()
}

fn inside(angle: f64, dof: usize) -> f64 {
    let (sin, cos) = angle.sin_cos();
    let odd = dof % 2 == 1;
    let (mut term, mut sum, mut k) = if odd { (cos, 0.0, 1) } else { (1.0, 0.0, 0) };
    while k + 2 <= dof {
        sum += term;
        k += 2;
        term *= cos * cos * (k - 1) as f64 / k as f64;
    }
    if odd { 2.0 / PI * (angle + sin * sum) } else { sin * sum }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_of_the_tables() {
        for (dof, t) in [
            (1, 12.706_204_736),
            (2, 4.302_652_730),
            (3, 3.182_446_305),
            (4, 2.776_445_105),
            (5, 2.570_581_836),
            (10, 2.228_138_852),
            (33, 2.034_515_297),
            (120, 1.979_930_405),
            (2001, 1.961_150_2),
        ] {
            assert!((two_sided_95(dof) - t).abs() < 1e-6, "{dof}: {}", two_sided_95(dof));
        }
    }
}
