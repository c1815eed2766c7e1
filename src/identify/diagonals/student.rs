//! The two-sided 95 % quantile of Student's t distribution.
//!
//! Tabulated up to 4 degrees of freedom, above by the asymptotic series (error below 0.002).
//!
//! Source: Abramowitz and Stegun 26.7.5; table 26.10.

/// How many standard deviations the 95 % interval spans to either side; infinite without a degree of freedom.
#[must_use]
pub fn t95(degrees_of_freedom: usize) -> f64 {
    const Z: f64 = 1.959_963_984_540_054;
    let n = degrees_of_freedom as f64;
    match degrees_of_freedom {
        0 => f64::INFINITY,
        1 => 12.706_204_736,
        2 => 4.302_652_730,
        3 => 3.182_446_305,
        4 => 2.776_445_105,
        _ => {
            let z2 = Z * Z;
            let g1 = (z2 + 1.0) * Z / 4.0;
            let g2 = ((5.0 * z2 + 16.0) * z2 + 3.0) * Z / 96.0;
            let g3 = (((3.0 * z2 + 19.0) * z2 + 17.0) * z2 - 15.0) * Z / 384.0;
            let g4 = ((((79.0 * z2 + 776.0) * z2 + 1482.0) * z2 - 1920.0) * z2 - 945.0) * Z / 92_160.0;
            Z + g1 / n + g2 / n.powi(2) + g3 / n.powi(3) + g4 / n.powi(4)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_of_the_tables() {
        for (n, t) in [(5, 2.570_582), (8, 2.306_004), (16, 2.119_905), (30, 2.042_272), (1000, 1.962_339)] {
            assert!((t95(n) - t).abs() < 2e-3, "{n}: {}", t95(n));
        }
        assert!(t95(0).is_infinite());
    }
}
