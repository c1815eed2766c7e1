//! How well a curve fits: the figures of the report.
//!
//! `rmse_n = sqrt(SSE/n)`, `rmse_dof = sqrt(SSE/(n - m))`, `AICc = n ln(SSE/n) + 2k + 2k(k+1)/(n-k-1)`, `k = m + 1`.

use super::data::{Cell, Data};

/// Figures of a fit, in mm or rad and their squares.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Figures {
    /// Readings.
    pub n: usize,
    /// Fitted numbers, fitted periods and the reversal among them.
    pub m: usize,
    /// Sum of squared residuals.
    pub sse: f64,
    /// Root of the mean square over the readings.
    pub rmse_n: f64,
    /// The same over the degrees of freedom, those of a subtracted drift taken off; `None` where there are none.
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
    /// Scatter of the readings about the mean of their own target and direction: what no static curve can remove.
    /// `None` where no target was repeated.
    pub repeatability: Option<f64>,
}

/// Sums over the readings of one fit.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Sums {
    pub(super) sse: f64,
    pub(super) e_max: f64,
    /// Squares of left-out errors, reading by reading.
    pub(super) loo: f64,
    /// Squares of left-out errors, position by position, over `inner` readings.
    pub(super) position: f64,
    pub(super) inner: f64,
}

impl Sums {
    /// A cell with its fitted value and the leverage of each of its readings.
    pub(super) fn add(&mut self, cell: &Cell, fitted: f64, leverage: f64) {
        let squares = cell.within + cell.count * (cell.mean - fitted).powi(2);
        self.sse += squares;
        self.loo += squares / (1.0 - leverage).max(0.0).powi(2);
        self.e_max = self.e_max.max(cell.farthest(fitted));
    }

    /// Adds the sums over other cells.
    pub(super) fn join(&mut self, other: &Self) {
        self.sse += other.sse;
        self.e_max = self.e_max.max(other.e_max);
        self.loo += other.loo;
        self.position += other.position;
        self.inner += other.inner;
    }

    /// A cell whose mean is missed by `error` when its position is left out.
    pub(super) fn left_out(&mut self, cell: &Cell, error: f64) {
        self.position += cell.within + cell.count * error * error;
        self.inner += cell.count;
    }
}

/// Residuals below this share of the largest value are rounding.
const ROUNDING: f64 = 64.0 * f64::EPSILON;

impl Figures {
    pub(super) fn new(data: &Data, sums: &Sums, m: usize) -> Self {
        let n = data.n;
        let rmse_n = (sums.sse / n as f64).sqrt();
        Self {
            n,
            m,
            sse: sums.sse,
            rmse_n,
            rmse_dof: (n as f64 - data.used > m as f64)
                .then(|| (sums.sse / (n as f64 - data.used - m as f64)).sqrt()),
            r2: (data.spread > 0.0).then(|| 1.0 - sums.sse / data.spread),
            e_max: sums.e_max,
            aicc: if rmse_n > ROUNDING * data.scale { aicc(sums.sse, n, m) } else { None },
            loo_rmse: root_mean(sums.loo, n as f64),
            position_rmse: root_mean(sums.position, sums.inner),
            repeatability: data.repeatability(),
        }
    }

    /// True where nothing but rounding is left.
    #[must_use]
    pub(super) fn is_exact(&self, data: &Data) -> bool {
        self.rmse_n <= ROUNDING * data.scale
    }

    /// Degrees of freedom of the residuals, those of a subtracted drift taken off.
    pub(super) fn dof(&self, data: &Data) -> usize {
        (self.n - self.m).saturating_sub(data.used.round() as usize)
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

fn root_mean(sum: f64, n: f64) -> Option<f64> {
    let rms = (sum / n).sqrt();
    rms.is_finite().then_some(rms)
}
