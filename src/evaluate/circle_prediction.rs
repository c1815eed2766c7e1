//! A measured circle against the circle that a model predicts.
//!
//! Both are radial errors at the same angles. The centre of a ballbar is where it was mounted, so eccentricities are taken
//! out; the mean radius stays. The residual is what an ideal correction with the model leaves.
//!
//! Source: ISO 230-4:2022, clause 3, applied to measured, predicted and their difference.

use core::f64::consts::{FRAC_PI_2, PI};

use volcomp_model::geometry::Vec3;
use volcomp_model::{Model, Pose, SENSORS_MAX};
use volcomp_units::axes::{AxisKind, AxisName, MAX_AXES, Travel};

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

/// Predicted radial error of every reading, mm.
///
/// `live` holds the values of the model's sensors, `plane` the axes of the circle; `None` where the chain lacks one of them.
#[must_use]
pub fn predict(
    model: &Model,
    live: &[f64; SENSORS_MAX],
    readings: &[CircularReading],
    (centre, radius): (Vec3, f64),
    plane: [AxisName; 2],
    exact: bool,
) -> Option<Vec<f64>> {
    let index = |name: AxisName| model.axes().position(|a| a.name == name);
    let [Some(first), Some(second)] = plane.map(index) else { return None };
    let mut home = [0.0; MAX_AXES];
    for (k, axis) in model.axes().enumerate().filter(|(_, a)| a.name.kind() == AxisKind::Linear) {
        if [AxisName::X, AxisName::Y, AxisName::Z].contains(&axis.name) {
            home[k] = centre[axis.name.direction()];
        }
    }
    let [u, v] = plane.map(AxisName::direction);
    let travel = |speed: f64| if speed < 0.0 { Travel::Reverse } else { Travel::Forward };
    let of = |r: &CircularReading| {
        let (sin, cos) = r.angle.sin_cos();
        let sense = if r.travel == Travel::Reverse { -1.0 } else { 1.0 };
        let mut pose = Pose::at(home);
        pose.live = *live;
        pose.position[first] += radius * cos;
        pose.position[second] += radius * sin;
        pose.travel[first] = travel(-sense * sin);
        pose.travel[second] = travel(sense * cos);
        let deviation = |pose: &Pose| {
            let (deviation, _) = if exact { model.correct_exact(pose) } else { model.correct(pose) };
            deviation.position
        };
        let settled = deviation(&pose);
        let mut now = settled;
        for (axis, direction, reversal) in [(first, u, 0.0), (second, v, FRAC_PI_2)] {
            let mut before = pose;
            before.travel[axis] = pose.travel[axis].reversed();
            let change = deviation(&before) - settled;
            let since = (sense * r.angle - reversal).rem_euclid(PI);
            let (moved, lost) = (radius * (1.0 - since.cos()), change[direction].abs());
            // behind a reversal the carriage rests until the drive has made up the lost motion
            if moved < lost {
                now += change * (1.0 - moved / lost);
            }
        }
        now[u] * cos + now[v] * sin
    };
    Some(readings.iter().map(of).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use volcomp_model::curve::{Curve, ErrorFunction, Interpolation, Table};
    use volcomp_model::{Chain, ErrorSymbol, ModelSpec};

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

    #[test]
    fn lost_motion_builds_up_behind_a_reversal() {
        let mut spec = ModelSpec::new("m", Chain::parse("[w b X Y Z t]").unwrap());
        let (places, way_back) = (vec![-200.0, 200.0], Some(vec![0.004, 0.004]));
        let lost = Table::new(places, vec![0.0, 0.0], way_back, Interpolation::Linear).unwrap();
        spec.errors.push((ErrorSymbol::parse("exx").unwrap(), ErrorFunction::single(Curve::Table(lost))));
        let model = Model::new(&spec).unwrap();
        // 4 um of 100 mm (1 - cos): half of the lost motion is made up 0.36 deg behind the reversal, all of it 0.51 deg behind
        let [half, whole] = [2e-5f64, 4e-5].map(|share| (1.0 - share).acos());
        let at = |angle: f64, travel| CircularReading { angle, deviation: 0.0, travel };
        let readings = [
            at(1e-6, Travel::Forward),
            at(half, Travel::Forward),
            at(1.01 * whole, Travel::Forward),
            at(-half, Travel::Reverse),
            at(PI + half, Travel::Forward),
            at(-1e-6, Travel::Forward),
        ];
        let live = [0.0; SENSORS_MAX];
        let plane = [AxisName::X, AxisName::Y];
        let found = predict(&model, &live, &readings, (Vec3::zeros(), 100.0), plane, false).unwrap();
        for (value, expected) in found.iter().zip([0.0, 2e-3, 4e-3, 2e-3, -2e-3, 0.0]) {
            assert!((value - expected).abs() < 1e-6, "{found:?}");
        }
    }
}
