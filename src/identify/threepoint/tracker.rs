//! Range, azimuth, elevation to points, with covariance.
//!
//! `P = l (cos el cos az, cos el sin az, sin el)` in the frame of the tracker; `Sigma = J diag(sl^2, sa^2, sa^2) J^T`.
//! Beyond 2 m the angles dominate: across the beam the noise is about `l sa`.
//!
//! Source: equations 4.0 ((10)) and 5.1.

use volcomp_model::geometry::{Mat3, Vec3};

/// One observation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Observation {
    /// Distance, mm.
    pub range: f64,
    /// Angle about the standing axis of the tracker, rad.
    pub azimuth: f64,
    /// Angle above its horizontal plane, rad.
    pub elevation: f64,
}

/// Standard deviations of an observation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackerNoise {
    /// Of the distance, mm.
    pub range: f64,
    /// Part of the distance's that grows with it (1e-6 = 1 um/m).
    pub range_share: f64,
    /// Of either angle, rad.
    pub angle: f64,
}

impl Observation {
    /// The point in the frame of the tracker, mm.
    #[must_use]
    pub fn point(&self) -> Vec3 {
        let (sa, ca) = self.azimuth.sin_cos();
        let (se, ce) = self.elevation.sin_cos();
        Vec3::new(ce * ca, ce * sa, se) * self.range
    }

    /// Its covariance, mm2.
    #[must_use]
    pub fn covariance(&self, noise: &TrackerNoise) -> Mat3 {
        let (sa, ca) = self.azimuth.sin_cos();
        let (se, ce) = self.elevation.sin_cos();
        let along = Vec3::new(ce * ca, ce * sa, se);
        let across = Vec3::new(-sa, ca, 0.0) * (self.range * ce);
        let up = Vec3::new(-se * ca, -se * sa, ce) * self.range;
        let range_variance = noise.range.powi(2) + (noise.range_share * self.range).powi(2);
        along * along.transpose() * range_variance
            + (across * across.transpose() + up * up.transpose()) * noise.angle.powi(2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_covariance_is_that_of_small_changes() {
        let o = Observation { range: 3400.0, azimuth: -1.9, elevation: 0.4 };
        let noise = TrackerNoise { range: 0.002, range_share: 1e-6, angle: 3e-6 };
        let h = 1e-6;
        let d = |a: Observation, b: Observation| (a.point() - b.point()) / (2.0 * h);
        let dr = d(Observation { range: o.range + h, ..o }, Observation { range: o.range - h, ..o });
        let da = d(Observation { azimuth: o.azimuth + h, ..o }, Observation { azimuth: o.azimuth - h, ..o });
        let de = d(
            Observation { elevation: o.elevation + h, ..o },
            Observation { elevation: o.elevation - h, ..o },
        );
        let expected = dr * dr.transpose() * (4e-6 + (0.0034f64).powi(2))
            + (da * da.transpose() + de * de.transpose()) * 9e-12;
        assert!((o.covariance(&noise) - expected).norm() < 1e-6 * expected.norm());
        assert!((o.point().norm() - 3400.0).abs() < 1e-9);
    }
}
