//! Squareness of a machine from its displacements: what a model says is taken out of them, and the steps between the ends
//! test the result.
//!
//! Source: equations 5.3.

use super::runs::EndToEnd;
use super::{AXES, DiagonalsError, SQUARENESS, Setup, Squareness};
use crate::prelude::*;
use volcomp_model::spec::ANGLE_LIMIT;
use volcomp_model::statistics::{ChiSquare, SIGNIFICANT};
use volcomp_units::arcsec_from_rad;

/// Degrees of freedom that uncertain curves have among the steps: one for each axis.
const CURVES_DOF: f64 = 3.0;

/// Squareness with what it was made from; lengths mm.
#[derive(Debug, Clone, PartialEq)]
pub struct Measurement {
    /// The squareness with the displacement by the model subtracted; its covariance holds the noise, the stated uncertainties of
    /// the model's curves, and the enlargement by the steps.
    pub found: Squareness,
    /// The same without the subtraction.
    pub raw: Squareness,
    /// Displacements by the model.
    pub subtracted: [f64; 4],
    /// Standard deviation of the displacements and degrees of freedom, where known.
    pub noise: Option<([f64; 4], Option<usize>)>,
    /// The scatter of the runs against the stated noise, where both are known.
    pub repeats: Option<ChiSquare>,
    /// The steps about model, squareness and a common scale; only where the model has positioning.
    pub steps: Option<Steps>,
}

/// How the steps between the ends agree with the model; mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Steps {
    /// Root mean square of the residuals.
    pub rms: f64,
    /// Steps.
    pub count: usize,
    /// The step that lies farthest off: diagonal, target, residual.
    pub worst: (usize, f64, f64),
    /// The test against what noise and the uncertainty of the model let expect, where the noise is known.
    pub test: Option<StepTest>,
}

/// The test of the steps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StepTest {
    /// Expected root mean square, mm.
    pub expected_rms: f64,
    /// Probability of residuals at least as large.
    pub p_value: f64,
}

impl Steps {
    /// True where the test has failed.
    #[must_use]
    pub fn failed(&self) -> bool {
        self.test.is_some_and(|t| t.p_value < SIGNIFICANT)
    }

    /// By what the uncertainties are enlarged.
    #[must_use]
    pub fn enlarged(&self) -> f64 {
        self.test.filter(|_| self.failed()).map_or(1.0, |t| (self.rms / t.expected_rms).max(1.0))
    }
}

/// One squareness with what is known about it, arcsec.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Line {
    /// The squareness.
    pub arcsec: f64,
    /// Its standard deviation (k = 1), where the noise is known.
    pub std_arcsec: Option<f64>,
    /// Half of its 95 % interval, the bound of the bias added.
    pub half_width_95_arcsec: Option<f64>,
    /// True where it lies beyond that.
    pub significant: Option<bool>,
    /// The squareness with nothing subtracted.
    pub without_subtraction_arcsec: f64,
}

impl Measurement {
    /// C0Y, B0Z, A0Z; `bias_arcsec` bounds what missing angles may do to them.
    #[must_use]
    pub fn lines(&self, bias_arcsec: Option<f64>) -> [Line; 3] {
        core::array::from_fn(|i| {
            let value = arcsec_from_rad(self.found.value[i]);
            let uncertainty = self.noise.map(|(_, dof)| {
                let std = arcsec_from_rad(self.found.covariance[(i, i)].sqrt());
                // stated noise counts as well known
                (std, dof.map_or(1.959_964, student_95) * std + bias_arcsec.unwrap_or(0.0))
            });
            Line {
                arcsec: value,
                std_arcsec: uncertainty.map(|u| u.0),
                half_width_95_arcsec: uncertainty.map(|u| u.1),
                significant: uncertainty.map(|(_, half)| value.abs() > half),
                without_subtraction_arcsec: arcsec_from_rad(self.raw.value[i]),
            }
        })
    }

    /// The squareness from end-to-end displacements; `model` has no squareness of its own, `noise_mm` is the standard deviation of
    /// one displacement where it is stated. Where the runs scatter by significantly more, their scatter takes its place.
    ///
    /// # Errors
    /// The model breaks a rule, a displacement is not finite, or a squareness is larger than any machine's.
    pub fn new(
        setup: &Setup,
        model: &ModelSpec,
        ends: &EndToEnd,
        noise_mm: Option<f64>,
    ) -> Result<Self, DiagonalsError> {
        let directions = &[Travel::Forward, Travel::Reverse][..1 + usize::from(ends.both_directions)];
        let mut subtracted = [0.0; 4];
        for travel in directions {
            for (sum, d) in subtracted.iter_mut().zip(setup.displacements(model, *travel)?) {
                *sum += d / directions.len() as f64;
            }
        }
        let of_runs = |std: f64| ends.runs.map(|n| std / (n as f64).sqrt());
        let against = |(stated, std): (f64, f64)| ChiSquare::of_scatter(std, stated, ends.dof);
        let repeats = noise_mm.zip(ends.run_std).map(against);
        let noise = match noise_mm.filter(|_| !repeats.is_some_and(ChiSquare::has_failed)) {
            Some(stated) => Some((of_runs(stated), None)),
            None => ends.run_std.map(|std| (of_runs(std), Some(ends.dof))),
        };
        let std = noise.map_or([0.0; 4], |n| n.0);
        let corrected = core::array::from_fn(|i| ends.displacement[i] - subtracted[i]);
        let mut found = setup.squareness(&corrected, &std)?;
        let mut values = SQUARENESS.into_iter().zip(found.value);
        if let Some((symbol, rad)) = values.find(|(_, rad)| rad.abs() > ANGLE_LIMIT) {
            return Err(DiagonalsError::TooLarge { symbol, arcsec: arcsec_from_rad(rad) });
        }
        found.covariance += setup.covariance_of_model(model)?;
        let raw = setup.squareness(&ends.displacement, &std)?;
        let mut measurement = Self { found, raw, subtracted, noise, repeats, steps: None };
        let knows = |(component, axis)| model.error(ErrorSymbol::Motion { component, axis }).is_some();
        if Component::ALL.into_iter().zip(AXES).all(knows) {
            measurement.steps = measurement.steps(setup, model, ends, directions)?;
        }
        if let Some(steps) = &measurement.steps {
            measurement.found.covariance *= steps.enlarged().powi(2);
        }
        Ok(measurement)
    }

    /// The intermediate steps about the model with the squareness found and a common scale.
    ///
    /// The ends are fitted exactly, so that the residual at share `t` of the length has the variance `s^2 (1 + t^2 + (1 - t)^2) / 2`
    /// for displacements of standard deviation `s`, and alike from the uncertainties that the curves of the model state.
    fn steps(
        &self,
        setup: &Setup,
        model: &ModelSpec,
        ends: &EndToEnd,
        directions: &[Travel],
    ) -> Result<Option<Steps>, DiagonalsError> {
        let mut spec = model.clone();
        let squareness = SQUARENESS.into_iter().zip(self.found.value);
        spec.errors.extend(squareness.map(|(s, v)| (s, ErrorFunction::single(Curve::Constant(v)))));
        let length = setup.length();
        let (mut sum, mut n) = (0.0, 0usize);
        let (mut from_noise, mut from_model) = (0.0, 0.0);
        let mut worst = (0, 0.0, 0.0f64);
        for (index, steps) in ends.steps.iter().enumerate() {
            let is_inner = |(t, _): &&(f64, f64)| *t > 1e-3 * length && *t < (1.0 - 1e-3) * length;
            let inner: Vec<&(f64, f64)> = steps.iter().filter(is_inner).collect();
            let shares: Vec<f64> = inner.iter().map(|(t, _)| t / length).collect();
            let mut expected = vec![0.0; shares.len()];
            for travel in directions {
                for (e, v) in expected.iter_mut().zip(setup.displacement(&spec, index, &shares, *travel)?) {
                    *e += v / directions.len() as f64;
                }
            }
            let variance_of_model = setup.step_variance_of_model(model, index)?;
            for ((step, share), e) in inner.iter().zip(shares).zip(expected) {
                let residual = step.1 - e - self.found.common * share;
                if residual.abs() >= worst.2.abs() {
                    worst = (index, step.0, residual);
                }
                sum += residual.powi(2);
                n += 1;
                let growth = 1.0 + share.powi(2) + (1.0 - share).powi(2);
                from_noise += self.noise.map_or(0.0, |(std, _)| std[index].powi(2) / 2.0) * growth;
                from_model += variance_of_model * growth;
            }
        }
        if n == 0 {
            return Ok(None);
        }
        let expected = from_noise + from_model;
        let test = self.noise.filter(|_| from_noise > 0.0).map(|(_, dof)| {
            // what the model has wrong is wrong in many steps alike
            let (noise, curves) = (from_noise / expected, from_model / expected);
            let effective = 1.0 / (noise * noise / n as f64 + curves * curves / CURVES_DOF);
            let effective = effective.floor().max(1.0) as usize;
            let ratio = sum / expected;
            let p_value = match dof {
                None => chi_square_upper(ratio * effective as f64, effective),
                Some(dof) => f_upper(ratio, effective, dof),
            };
            StepTest { expected_rms: (expected / n as f64).sqrt(), p_value }
        });
        Ok(Some(Steps { rms: (sum / n as f64).sqrt(), count: n, worst, test }))
    }
}
