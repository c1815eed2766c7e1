//! How well a curve fits: the figures of the report.
//!
//! `rmse_n = sqrt(SSE/n)`, `rmse_dof = sqrt(SSE/(n - m))`, `AICc = n ln(SSE/n) + 2k + 2k(k+1)/(n-k-1)`, `k = m + 1`.

/// Figures of a fit, in mm or rad and their squares.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Figures {
    /// Readings.
    pub n: usize,
    /// Fitted numbers, a fitted period among them.
    pub m: usize,
    /// Sum of squared residuals.
    pub sse: f64,
    /// Root of the mean square over the readings.
    pub rmse_n: f64,
    /// The same over the degrees of freedom; `None` where there are none.
    pub rmse_dof: Option<f64>,
    /// Share of the variance explained; `None` where the readings are all equal.
    pub r2: Option<f64>,
    /// Largest absolute residual.
    pub e_max: f64,
    /// Corrected information criterion; `None` for an exact fit or too few readings.
    pub aicc: Option<f64>,
    /// RMS error of each reading predicted from all others (a fitted period is kept); `None` where undefined.
    pub loo_rmse: Option<f64>,
    /// The same with all readings of a position left out together, first and last position kept: no curve is
    /// used beyond its range. Decides between orders; `None` where undefined.
    pub position_rmse: Option<f64>,
}

/// Residuals below this share of the largest value are rounding.
const ROUNDING: f64 = 64.0 * f64::EPSILON;

impl Figures {
    pub(super) fn new(values: &[f64], residuals: &[f64], m: usize) -> Self {
        let n = values.len();
        let sse: f64 = residuals.iter().map(|r| r * r).sum();
        let mean = values.iter().sum::<f64>() / n as f64;
        let spread: f64 = values.iter().map(|v| (v - mean).powi(2)).sum();
        let scale = values.iter().fold(0.0f64, |a, v| a.max(v.abs()));
        let rmse_n = (sse / n as f64).sqrt();
        Self {
            n,
            m,
            sse,
            rmse_n,
            rmse_dof: (n > m).then(|| (sse / (n - m) as f64).sqrt()),
            r2: (spread > 0.0).then(|| 1.0 - sse / spread),
            e_max: residuals.iter().fold(0.0, |a: f64, r| a.max(r.abs())),
            aicc: if rmse_n > ROUNDING * scale { aicc(sse, n, m) } else { None },
            loo_rmse: None,
            position_rmse: None,
        }
    }

    /// True where nothing but rounding is left.
    #[must_use]
    pub(super) fn is_exact(&self, values: impl Iterator<Item = f64>) -> bool {
        self.rmse_n <= ROUNDING * values.fold(0.0f64, |a, v| a.max(v.abs()))
    }

    /// AICc with the squares in another unit: `scale` = units per mm or per rad.
    #[must_use]
    pub fn aicc_in_unit(&self, scale: f64) -> Option<f64> {
        self.aicc.map(|a| a + 2.0 * self.n as f64 * scale.ln())
    }
}

fn aicc(sse: f64, n: usize, m: usize) -> Option<f64> {
    let k = m + 1;
    let rest = n.checked_sub(k + 1).filter(|r| *r > 0)?;
    let (n, k) = (n as f64, k as f64);
    Some(n * (sse / n).ln() + 2.0 * k + 2.0 * k * (k + 1.0) / rest as f64)
}

/// RMS of an iterator of residuals; `None` where one is not finite.
pub(super) fn rms(residuals: impl Iterator<Item = f64>) -> Option<f64> {
    let (mut sum, mut n) = (0.0, 0usize);
    for r in residuals {
        sum += r * r;
        n += 1;
    }
    let rms = (sum / n as f64).sqrt();
    rms.is_finite().then_some(rms)
}
