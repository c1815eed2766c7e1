//! How probable a fit is, and how wide an interval: tails of the chi-squared and Student distributions.
//!
//! Source: regularised incomplete gamma function by series and continued fraction; Student's quantile by the
//! Cornish-Fisher expansion, which is right to 3e-3 from five degrees of freedom up.

/// Probability that chi-squared with `dof` degrees of freedom exceeds `value`; 1 without a degree of freedom.
#[must_use]
pub fn chi_squared(value: f64, dof: usize) -> f64 {
    if dof == 0 || value.is_nan() || value <= 0.0 {
        return 1.0;
    }
    gamma_upper(dof as f64 / 2.0, value / 2.0)
}

/// Half width of the 95 % interval in standard deviations, for a standard deviation with `dof` degrees of freedom.
#[must_use]
pub fn coverage_95(dof: usize) -> f64 {
    // exact values where the expansion is not good enough
    const FEW: [f64; 5] = [f64::INFINITY, 12.706_205, 4.302_653, 3.182_446, 2.776_445];
    if let Some(exact) = FEW.get(dof) {
        return *exact;
    }
    let z = 1.959_963_985_f64;
    let n = dof as f64;
    let [z3, z5, z7] = [z.powi(3), z.powi(5), z.powi(7)];
    z + (z3 + z) / (4.0 * n)
        + (5.0 * z5 + 16.0 * z3 + 3.0 * z) / (96.0 * n * n)
        + (3.0 * z7 + 19.0 * z5 + 17.0 * z3 - 15.0 * z) / (384.0 * n.powi(3))
}

/// Regularised upper incomplete gamma function `Q(a, x)`, a > 0, x > 0.
fn gamma_upper(a: f64, x: f64) -> f64 {
    let scale = (a * x.ln() - x - ln_gamma(a)).exp();
    if x < a + 1.0 {
        let (mut term, mut sum, mut k) = (1.0 / a, 1.0 / a, a);
        while term > sum * 1e-16 {
            k += 1.0;
            term *= x / k;
            sum += term;
        }
        return (1.0 - sum * scale).clamp(0.0, 1.0);
    }
    // modified Lentz
    let tiny = 1e-300;
    let mut b = x + 1.0 - a;
    let mut c = 1.0 / tiny;
    let mut d = 1.0 / b;
    let mut h = d;
    for i in 1..10_000 {
        let an = -f64::from(i) * (f64::from(i) - a);
        b += 2.0;
        d = 1.0 / away_from_zero(an * d + b, tiny);
        c = away_from_zero(b + an / c, tiny);
        let step = d * c;
        h *= step;
        if (step - 1.0).abs() < 1e-15 {
            break;
        }
    }
    (scale * h).clamp(0.0, 1.0)
}

fn away_from_zero(value: f64, tiny: f64) -> f64 {
    if value.abs() < tiny { tiny } else { value }
}

/// Lanczos, g = 7.
fn ln_gamma(x: f64) -> f64 {
    const G: [f64; 9] = [
        0.999_999_999_999_809_9,
        676.520_368_121_885_1,
        -1_259.139_216_722_402_8,
        771.323_428_777_653_1,
        -176.615_029_162_140_6,
        12.507_343_278_686_905,
        -0.138_571_095_265_720_12,
        9.984_369_578_019_572e-6,
        1.505_632_735_149_311_6e-7,
    ];
    let x = x - 1.0;
    let t = x + 7.5;
    let sum = G.iter().enumerate().skip(1).fold(G[0], |s, (i, g)| s + g / (x + i as f64));
    0.5 * core::f64::consts::TAU.ln() + (x + 0.5) * t.ln() - t + sum.ln()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chi_squared_has_its_tabulated_values() {
        for (value, dof, tail) in
            [(3.841_459, 1, 0.05), (18.307_038, 10, 0.05), (2.558_212, 10, 0.99), (124.342_1, 100, 0.05)]
        {
            assert!((chi_squared(value, dof) - tail).abs() < 1e-6, "{dof}: {}", chi_squared(value, dof));
        }
        assert_eq!(chi_squared(1.0, 0), 1.0);
        assert_eq!(chi_squared(-1.0, 3), 1.0);
        assert!(chi_squared(1e6, 3) < 1e-300);
    }

    #[test]
    fn intervals_have_their_tabulated_width() {
        for (dof, width) in
            [(1, 12.7062), (4, 2.7764), (5, 2.5706), (10, 2.2281), (30, 2.0423), (1000, 1.9623)]
        {
            assert!((coverage_95(dof) - width).abs() < 4e-3, "{dof}: {}", coverage_95(dof));
        }
        assert_eq!(coverage_95(0), f64::INFINITY);
    }
}
