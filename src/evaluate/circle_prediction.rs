//! A measured circle against the circle that a model predicts.
//!
//! Both are radial errors at the same angles. The centre of a ballbar is where it was mounted, so eccentricities are taken
//! out; the mean radius stays. The residual is what an ideal correction with the model leaves.
//!
//! Source: ISO 230-4:2022, clause 3, applied to measured, predicted and their difference.

use crate::circular::{Centring, CircularError, CircularReading, Circularity};

/// Measured, predicted and what is left, in the unit of the deviations.
#[derive(Debug, Clone, PartialEq)]
pub struct CirclePrediction {
    /// The measured circle.
    pub measured: Circularity,
    /// The predicted circle.
    pub predicted: Circularity,
    /// Measured minus predicted: the circle after an ideal correction.
    pub residual: Circularity,
    /// Mean of the residual: difference of the mean radius.
    pub radius: f64,
    /// Root mean square of the residual about its centre, mean radius included.
    pub rms: f64,
    /// Largest absolute residual about its centre, mean radius included.
    pub largest: f64,
}

impl CirclePrediction {
    /// Compares; `predicted` holds the predicted deviation of every reading.
    ///
    /// # Errors
    /// Those of [`Circularity::evaluate`].
    pub fn new(readings: &[CircularReading], predicted: &[f64], radius: f64) -> Result<Self, CircularError> {
        let centring = Centring::LeastSquares { radius: Some(radius) };
        let with = |value: &dyn Fn(usize, &CircularReading) -> f64| -> Vec<CircularReading> {
            readings
                .iter()
                .enumerate()
                .map(|(i, r)| CircularReading { deviation: value(i, r), ..*r })
                .collect()
        };
        let of = |i: usize| predicted.get(i).copied().unwrap_or(f64::NAN);
        let measured = Circularity::evaluate(readings, centring)?;
        let foreseen = Circularity::evaluate(&with(&|i, _| of(i)), centring)?;
        let residual = Circularity::evaluate(&with(&|i, r| r.deviation - of(i)), centring)?;
        let n = residual.radial.len() as f64;
        Ok(Self {
            radius: residual.radial.iter().sum::<f64>() / n,
            rms: (residual.radial.iter().map(|r| r * r).sum::<f64>() / n).sqrt(),
            largest: residual.f_max.abs().max(residual.f_min.abs()),
            measured,
            predicted: foreseen,
            residual,
        })
    }

    /// Circular error of both directions, or of the one that was measured.
    #[must_use]
    pub fn g(circle: &Circularity) -> f64 {
        circle.g_both.or(circle.g_forward).or(circle.g_backward).unwrap_or(f64::NAN)
    }

    /// Share of the circular error that an ideal correction takes away, 0 to 1; negative where the model makes it larger.
    #[must_use]
    pub fn ideal_reduction(&self) -> f64 {
        1.0 - Self::g(&self.residual) / Self::g(&self.measured)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use volcomp_units::axes::Travel;

    fn readings(of: impl Fn(f64) -> f64) -> Vec<CircularReading> {
        (0..360)
            .map(|i| f64::from(i).to_radians())
            .map(|angle| CircularReading { angle, deviation: of(angle), travel: Travel::Forward })
            .collect()
    }

    #[test]
    fn an_eccentric_mounting_does_not_count_and_the_radius_does() {
        let oval = |a: f64| 0.01 * (2.0 * a).cos();
        let measured = readings(|a| oval(a) + 0.002 * (3.0 * a).sin() + 0.03 * a.cos() + 0.001);
        let predicted: Vec<f64> = measured.iter().map(|r| oval(r.angle)).collect();
        let p = CirclePrediction::new(&measured, &predicted, 100.0).unwrap();
        assert!((p.radius - 0.001).abs() < 1e-5, "{}", p.radius);
        assert!((p.largest - 0.003).abs() < 2e-5, "{}", p.largest);
        assert!((CirclePrediction::g(&p.residual) - 0.004).abs() < 2e-5);
        assert!((CirclePrediction::g(&p.predicted) - 0.02).abs() < 2e-5);
        let expected = 1.0 - 0.004 / CirclePrediction::g(&p.measured);
        assert!((p.ideal_reduction() - expected).abs() < 2e-3);
    }

    #[test]
    fn a_prediction_with_too_few_values_is_refused() {
        let measured = readings(|_| 0.0);
        assert!(CirclePrediction::new(&measured, &[0.0; 10], 100.0).is_err());
    }
}
