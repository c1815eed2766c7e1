//! How far a sensor is believed: its measurement variance, learned from what its readings leave behind.
//!
//! `R <- clip((1 - d) R + d (r^2 + h P h^T), R_min, R_max)`, r = residual after the update, P after the update: the
//! residual form is positive by construction, the innovation form is not (equations 5.8).

/// What a number of a reading is. An instrument gets its lengths and its angles in different ways, so that each kind has
/// a noise of its own.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// A length.
    Length,
    /// An angle.
    Angle,
}

impl Kind {
    /// Both, in the order in which numbers of each kind are listed.
    pub const ALL: [Self; 2] = [Self::Length, Self::Angle];

    /// Its place in such a list.
    #[must_use]
    pub const fn index(self) -> usize {
        match self {
            Self::Length => 0,
            Self::Angle => 1,
        }
    }
}

/// Why a measurement noise cannot be used.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum NoiseError {
    /// A variance must be a positive number.
    #[error("{what} {value:e} is not a number above 0")]
    NotPositive {
        /// Which number.
        what: &'static str,
        /// The value.
        value: f64,
    },
    /// The share of each reading in the variance.
    #[error("share d {value} is not between 0 and 1")]
    BadShare {
        /// The value.
        value: f64,
    },
    /// The limits contradict each other.
    #[error("smallest measurement variance {low:e} is above the largest {high:e}")]
    EmptyLimits {
        /// Smallest.
        low: f64,
        /// Largest.
        high: f64,
    },
}

/// How the variance follows the readings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Adaptation {
    /// Share of each reading, 0 to 1.
    pub share: f64,
    /// Smallest variance.
    pub low: f64,
    /// Largest variance.
    pub high: f64,
}

/// Measurement variance of one sensor, in the square of the unit of the state.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeasurementNoise {
    variance: f64,
    adaptation: Option<Adaptation>,
}

impl MeasurementNoise {
    /// A variance, fixed or adapting.
    ///
    /// # Errors
    /// A variance or limit that is not positive, a share outside 0 to 1, limits that contradict each other.
    pub fn new(variance: f64, adaptation: Option<Adaptation>) -> Result<Self, NoiseError> {
        positive("measurement variance", variance)?;
        if let Some(Adaptation { share, low, high }) = adaptation {
            positive("smallest measurement variance", low)?;
            positive("largest measurement variance", high)?;
            if !(0.0..=1.0).contains(&share) {
                return Err(NoiseError::BadShare { value: share });
            }
            if low > high {
                return Err(NoiseError::EmptyLimits { low, high });
            }
        }
        Ok(Self { variance, adaptation })
    }

    /// A fixed variance of 1.
    #[must_use]
    pub const fn unit() -> Self {
        Self { variance: 1.0, adaptation: None }
    }

    /// The variance now.
    #[must_use]
    pub const fn variance(&self) -> f64 {
        self.variance
    }

    /// Learns from the residual after an update and the variance of the estimate there.
    pub(super) fn learn(&mut self, residual: f64, estimate_variance: f64) {
        if let Some(a) = self.adaptation {
            let seen = residual * residual + estimate_variance;
            self.variance = ((1.0 - a.share) * self.variance + a.share * seen).clamp(a.low, a.high);
        }
    }
}

fn positive(what: &'static str, value: f64) -> Result<(), NoiseError> {
    if value.is_finite() && value > 0.0 { Ok(()) } else { Err(NoiseError::NotPositive { what, value }) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_variance_stays_between_its_limits() {
        let adaptation = Some(Adaptation { share: 0.5, low: 1.0, high: 8.0 });
        let mut noise = MeasurementNoise::new(4.0, adaptation).unwrap();
        noise.learn(1.0, 1.0);
        assert_eq!(noise.variance(), 3.0);
        noise.learn(100.0, 0.0);
        assert_eq!(noise.variance(), 8.0);
        (0..20).for_each(|_| noise.learn(0.0, 0.0));
        assert_eq!(noise.variance(), 1.0);
        let mut fixed = MeasurementNoise::new(4.0, None).unwrap();
        fixed.learn(100.0, 0.0);
        assert_eq!(fixed.variance(), 4.0);
    }

    #[test]
    fn impossible_noise_is_refused() {
        let with = |share, low, high| MeasurementNoise::new(1.0, Some(Adaptation { share, low, high }));
        assert!(matches!(MeasurementNoise::new(0.0, None), Err(NoiseError::NotPositive { .. })));
        assert_eq!(with(1.5, 1.0, 2.0), Err(NoiseError::BadShare { value: 1.5 }));
        assert_eq!(with(0.5, 3.0, 2.0), Err(NoiseError::EmptyLimits { low: 3.0, high: 2.0 }));
        assert!(with(0.5, f64::NAN, 2.0).is_err());
    }
}
