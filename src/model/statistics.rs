//! Probabilities for tests of fit and consistency, the width of intervals, medians and ranges: the one place for them.

use statrs::distribution::{ChiSquared, ContinuousCDF, FisherSnedecor, StudentsT};

/// Probability below which a test of fit has failed.
pub const SIGNIFICANT: f64 = 1e-3;

/// Degrees of freedom above which the first correction to the normal quantile is enough.
const MANY: usize = 2000;
/// Two-sided 95 % quantile of the normal distribution.
const NORMAL_95: f64 = 1.959_963_984_540_054;

/// Lowest and highest of some values; infinite where there is none.
pub fn hull(values: impl IntoIterator<Item = f64>) -> [f64; 2] {
    let ends = (f64::INFINITY, f64::NEG_INFINITY);
    values.into_iter().fold(ends, |(l, h), v| (l.min(v), h.max(v))).into()
}

/// Median; none of no values.
#[must_use]
pub fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    let n = values.len();
    (n > 0).then(|| 0.5 * (values[(n - 1) / 2] + values[n / 2]))
}

/// Probability that a chi-square of `dof` degrees of freedom exceeds `value`; 1 where there is no degree of freedom or no
/// deviation.
#[must_use]
pub fn chi_square_upper(value: f64, dof: usize) -> f64 {
    if dof == 0 || value.is_nan() || value <= 0.0 {
        return 1.0;
    }
    if value.is_infinite() {
        return 0.0;
    }
    ChiSquared::new(dof as f64).map_or(1.0, |d| d.sf(value).clamp(0.0, 1.0))
}

/// A sum of squared weighted residuals with its degrees of freedom: the test of fit against stated noise.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ChiSquare {
    /// The sum.
    pub sum: f64,
    /// Degrees of freedom.
    pub dof: usize,
}

impl ChiSquare {
    /// A scatter of `dof` degrees of freedom against the stated standard deviation.
    #[must_use]
    pub fn of_scatter(scatter: f64, stated: f64, dof: usize) -> Self {
        Self { sum: dof as f64 * (scatter / stated).powi(2), dof }
    }

    /// Probability of a sum at least as large by the stated noise; none without a degree of freedom.
    #[must_use]
    pub fn p_value(self) -> Option<f64> {
        (self.dof > 0).then(|| chi_square_upper(self.sum, self.dof))
    }

    /// True where the test of fit has failed.
    #[must_use]
    pub fn has_failed(self) -> bool {
        self.p_value().is_some_and(|p| p < SIGNIFICANT)
    }

    /// Noise of the residuals over stated noise; none without a degree of freedom.
    #[must_use]
    pub fn noise_factor(self) -> Option<f64> {
        (self.dof > 0).then(|| (self.sum / self.dof as f64).sqrt())
    }

    /// By what stated uncertainties are enlarged: the noise factor where the test has failed, else 1.
    #[must_use]
    pub fn enlarged(self) -> f64 {
        self.noise_factor().filter(|_| self.has_failed()).unwrap_or(1.0)
    }
}

/// Probability that a normal variable lies further than `z` standard deviations from its mean.
#[must_use]
pub fn normal_two_sided(z: f64) -> f64 {
    chi_square_upper(z * z, 1)
}

/// Probability that the ratio of two variances of `above` and `below` degrees of freedom exceeds `ratio`; 1 where one of
/// them has none.
#[must_use]
pub fn f_upper(ratio: f64, above: usize, below: usize) -> f64 {
    if above == 0 || below == 0 || ratio.is_nan() || ratio <= 0.0 {
        return 1.0;
    }
    if ratio.is_infinite() {
        return 0.0;
    }
    FisherSnedecor::new(above as f64, below as f64).map_or(1.0, |d| d.sf(ratio).clamp(0.0, 1.0))
}

/// The ratio of two variances of `above` and `below` degrees of freedom that is exceeded with a probability; infinite where one
/// of them has none.
#[must_use]
pub fn f_limit(probability: f64, above: usize, below: usize) -> f64 {
    if above == 0 || below == 0 {
        return f64::INFINITY;
    }
    FisherSnedecor::new(above as f64, below as f64)
        .map_or(f64::INFINITY, |d| d.inverse_cdf((1.0 - probability).clamp(0.0, 1.0)))
}

/// How many standard deviations, known from `dof` degrees of freedom, the 95 % interval spans to either side (Student's
/// t); infinite without a degree of freedom.
#[must_use]
pub fn student_95(dof: usize) -> f64 {
    match dof {
        0 => f64::INFINITY,
        1..=MANY => StudentsT::new(0.0, 1.0, dof as f64).map_or(f64::INFINITY, |d| d.inverse_cdf(0.975)),
        _ => NORMAL_95 * (1.0 + (NORMAL_95 * NORMAL_95 + 1.0) / (4.0 * dof as f64)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_tables_of_chi_square() {
        // percentage points of tables, and closed forms for 2 degrees of freedom
        for (chi, dof, p) in [
            (3.841_458_820_694_124, 1, 0.05),
            (6.634_896_601_021_214, 1, 0.01),
            (18.307_038_053_275_143, 10, 0.05),
            (16.266_236_196_238_13, 3, 0.001),
            (124.342_113_404_004, 100, 0.05),
            (10.827_566_170_662_733, 1, 0.001),
            (2.0, 2, (-1.0f64).exp()),
            (60.0, 2, (-30.0f64).exp()),
            (1200.0, 2, (-600.0f64).exp()),
        ] {
            let got = chi_square_upper(chi, dof);
            assert!((got - p).abs() < 1e-9 * p, "{chi} {dof}: {got} instead of {p}");
        }
        assert!((normal_two_sided(NORMAL_95) - 0.05).abs() < 1e-12);
    }

    #[test]
    fn the_ends_are_quiet() {
        for (value, dof) in [(0.0, 3), (-1.0, 3), (5.0, 0), (f64::NAN, 3)] {
            assert!((chi_square_upper(value, dof) - 1.0).abs() < 1e-15);
        }
        assert!(chi_square_upper(f64::INFINITY, 3).abs() < 1e-300);
        assert!(chi_square_upper(1e5, 3).abs() < 1e-300 && chi_square_upper(1e30, 10).abs() < 1e-300);
        // a large dof is close to its mean
        assert!((chi_square_upper(1e6, 1_000_000) - 0.5).abs() < 1e-3);
        for (ratio, above, below) in [(0.0, 3, 3), (2.0, 0, 3), (2.0, 3, 0), (f64::NAN, 3, 3)] {
            assert!((f_upper(ratio, above, below) - 1.0).abs() < 1e-15);
        }
        assert!(f_upper(f64::INFINITY, 3, 3).abs() < 1e-300 && f_upper(1e30, 5, 50).abs() < 1e-100);
        assert_eq!((student_95(0), f_limit(0.01, 1, 0)), (f64::INFINITY, f64::INFINITY));
    }

    #[test]
    fn the_tables_of_student() {
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
            assert!((student_95(dof) - t).abs() < 1e-6, "{dof}: {}", student_95(dof));
        }
        assert!((student_95(MANY) - student_95(MANY + 1)).abs() < 2e-6);
        assert!((1..3000).all(|n| student_95(n) > student_95(n + 1)));
    }

    #[test]
    fn the_tables_of_f() {
        for (f, above, below, p) in
            [(2.679_6, 11, 44, 0.01), (10.044_3, 1, 10, 0.01), (4.102_7, 5, 20, 0.01), (3.325_8, 5, 10, 0.05)]
        {
            let got = f_upper(f, above, below);
            assert!((got - p).abs() < 2e-3 * p, "{f} {above} {below}: {got}");
            assert!((f_limit(got, above, below) - f).abs() < 1e-6 * f, "{f} {above} {below}");
        }
        // the square of Student's t
        assert!((f_upper(student_95(7).powi(2), 1, 7) - 0.05).abs() < 1e-9);
    }
}
