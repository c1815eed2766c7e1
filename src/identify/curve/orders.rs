//! The figures of every order of a basis, for comparison with other programs.

use super::{Basis, Figures, Request, fit, highest_order};
use crate::Reading;

/// Orders that were tried.
#[derive(Debug, Clone, PartialEq)]
pub struct Orders {
    /// Each order with its figures.
    pub tried: Vec<(usize, Figures)>,
    /// The order of lowest AICc.
    pub best: usize,
}

impl Orders {
    /// Of the basis of a request (Chebyshev where it has none), up to an order.
    ///
    /// # Errors
    /// In words: no order has an AICc, because the first one cannot be fitted or there are too few points.
    pub fn of(readings: &[Reading], request: &Request, up_to: usize) -> Result<Self, String> {
        let basis = request.basis.unwrap_or(Basis::Chebyshev);
        let mut positions: Vec<f64> = readings.iter().map(|r| r.position).collect();
        positions.sort_by(f64::total_cmp);
        positions.dedup();
        let (mut tried, mut best, mut problem) = (Vec::new(), None, None);
        for order in usize::from(basis == Basis::Fourier)..=highest_order(basis, positions.len()).min(up_to) {
            match fit(readings, &Request { order: Some(order), ..request.clone() }) {
                Ok(found) => {
                    tried.push((order, found.figures));
                    if let Some(aicc) = found.figures.aicc
                        && best.is_none_or(|(_, lowest)| aicc < lowest)
                    {
                        best = Some((order, aicc));
                    }
                }
                Err(e) => {
                    problem = Some(e.to_string());
                    break;
                }
            }
        }
        let too_few = || "too few points for an order; give one".to_owned();
        let (best, _) = best.ok_or_else(|| problem.unwrap_or_else(too_few))?;
        Ok(Self { tried, best })
    }
}
