//! Squareness from the displacements along four body diagonals.
//!
//! `L D_s = C' + sx sy (-ab C0Y) + sx sz (ac B0Z) + sy sz (-bc A0Z)` for a box a, b, c with `L = |(a, b, c)|`; `D_s`
//! is the end-to-end displacement error. Positioning errors of any shape enter `C'` alone. Straightness has the
//! signature of squareness, so that the result is the squareness of the end-point lines over the box, or of the
//! lines of the model whose displacement was subtracted. Angular errors have other signatures: what they do must be
//! subtracted first, `D_s := D_s - u . (e(end) - e(start))` with squareness 0.
//!
//! The signatures come from the kinematic chain itself (unit squarenesses put into the first-order model), so that
//! they hold for every chain that has X, Y and Z.
//!
//! Assumptions: rotary axes stand at 0; the beam lies along the nominal diagonal; a scale error of the laser is
//! common to the four and drops. Four equations, four unknowns: there is no residual; steps between the ends are
//! the only check ([`Setup::displacement`]).
//!
//! Source: equations 5.3. Reading order: this file, [`runs`] (readings to end-to-end displacements), [`measurement`].

pub mod measurement;
pub mod runs;

use nalgebra::{Matrix3, Matrix4, Vector4};

use crate::prelude::*;
use volcomp_model::Chain;
use volcomp_model::spec::{ANGLE_LIMIT, ModelError};
use volcomp_units::arcsec_from_rad;

/// The three linear axes that span the box.
pub const AXES: [AxisName; 3] = [AxisName::X, AxisName::Y, AxisName::Z];

/// The squarenesses in the order of all results: C0Y, B0Z, A0Z.
pub const SQUARENESS: [ErrorSymbol; 3] = [
    ErrorSymbol::Squareness { component: Component::C, axis: AxisName::Y },
    ErrorSymbol::Squareness { component: Component::B, axis: AxisName::Z },
    ErrorSymbol::Squareness { component: Component::A, axis: AxisName::Z },
];

/// Signs with which X, Y, Z move along the diagonals, in the order of all results.
pub const SIGNS: [[f64; 3]; 4] = [[1.0, 1.0, 1.0], [-1.0, 1.0, 1.0], [1.0, -1.0, 1.0], [1.0, 1.0, -1.0]];

/// Names of the diagonals in the order of [`SIGNS`].
pub const NAMES: [&str; 4] = ["ppp", "npp", "pnp", "ppn"];

/// Longest side of the box over the shortest, above which the squarenesses are not determined.
pub const CONDITION_LIMIT: f64 = 1e3;

/// A rotation so small that the model is linear in it, and so large that rounding does not matter, rad.
const PROBE: f64 = 1e-4;

/// Where four diagonals run and on which machine.
#[derive(Debug, Clone)]
pub struct Setup {
    /// Lower corner, programmed coordinates of X, Y, Z, mm.
    low: [f64; 3],
    /// Sides, mm.
    size: [f64; 3],
    /// Reflector in M at home, mm.
    reflector: Vec3,
    /// Displacement per unit of common, C0Y, B0Z, A0Z (mm per mm, mm per rad), one row per diagonal.
    design: Matrix4<f64>,
}

/// The result; angles rad, lengths mm.
#[derive(Debug, Clone, PartialEq)]
pub struct Squareness {
    /// C0Y, B0Z, A0Z.
    pub value: [f64; 3],
    /// Mean of the four displacements.
    pub common: f64,
    /// Covariance of C0Y, B0Z, A0Z from the noise of the displacements; zero where none was given.
    pub covariance: Matrix3<f64>,
}

/// An angular error that the model does not have, and what a change of 1 rad over the box would do.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MissingAngle {
    /// The error motion.
    pub symbol: ErrorSymbol,
    /// Bias of C0Y, B0Z, A0Z, rad per rad of change from the lower to the upper end of the box.
    pub bias: [f64; 3],
}

/// Why squareness cannot be found.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum DiagonalsError {
    /// The chain lacks an axis.
    #[error("the chain has no axis {axis}; body diagonals need X, Y and Z")]
    NoAxis {
        /// The axis.
        axis: AxisName,
    },
    /// A side that is no length.
    #[error("side {axis} of the box is {size_mm} mm; it must be above 0")]
    EmptyBox {
        /// Direction of the side.
        axis: AxisName,
        /// Its length.
        size_mm: f64,
    },
    /// A box too flat or too thin.
    #[error(
        "the sides of the box differ by a factor of {condition:.0}, limit {limit:.0}: the diagonals nearly coincide and do not tell the squarenesses apart; take a box with more equal sides",
        limit = CONDITION_LIMIT
    )]
    Flat {
        /// Longest over shortest side.
        condition: f64,
    },
    /// The model cannot be used.
    #[error("the model cannot be used: {0}")]
    Model(#[from] ModelError),
    /// A squareness that no machine has.
    #[error(
        "the squareness {symbol} would be {arcsec:.0} arcsec; the limit is {limit:.0} arcsec (10 mrad): were the readings in nm, not in um, \
         or is a sign or --box-mm wrong?",
        limit = arcsec_from_rad(ANGLE_LIMIT)
    )]
    TooLarge {
        /// The squareness.
        symbol: ErrorSymbol,
        /// Its value.
        arcsec: f64,
    },
    /// A displacement that is no number.
    #[error("the displacement along {name} is not finite")]
    NotFinite {
        /// The diagonal.
        name: &'static str,
    },
}

impl Setup {
    /// A box with its lower corner at `low` (programmed coordinates of X, Y, Z) and the sides `size`, measured with a
    /// reflector that stands at `reflector` in M at home.
    ///
    /// # Errors
    /// The chain lacks an axis, or the box determines nothing.
    pub fn new(
        chain: &Chain,
        low: [f64; 3],
        size: [f64; 3],
        reflector: Vec3,
    ) -> Result<Self, DiagonalsError> {
        for (axis, side) in AXES.into_iter().zip(size) {
            if chain.index_of(axis).is_none() {
                return Err(DiagonalsError::NoAxis { axis });
            }
            if !(side.is_finite() && side > 0.0) {
                return Err(DiagonalsError::EmptyBox { axis, size_mm: side });
            }
        }
        let (longest, shortest) =
            size.iter().fold((0.0f64, f64::INFINITY), |(high, low), s| (high.max(*s), low.min(*s)));
        let condition = longest / shortest;
        if condition > CONDITION_LIMIT {
            return Err(DiagonalsError::Flat { condition });
        }
        let mut setup = Self { low, size, reflector, design: Matrix4::zeros() };
        setup.design.fill_column(0, 1.0);
        for (column, symbol) in SQUARENESS.into_iter().enumerate() {
            let mut spec = ModelSpec::new("box", chain.clone());
            spec.errors.push((symbol, ErrorFunction::single(Curve::Constant(PROBE))));
            let seen = setup.displacements(&spec, Travel::Forward)?;
            for (row, d) in seen.into_iter().enumerate() {
                setup.design[(row, column + 1)] = d / PROBE;
            }
        }
        Ok(setup)
    }

    /// Length of a diagonal, mm.
    #[must_use]
    pub fn length(&self) -> f64 {
        self.size.iter().map(|s| s * s).sum::<f64>().sqrt()
    }

    /// Lower corner and sides, mm.
    #[must_use]
    pub const fn cuboid(&self) -> ([f64; 3], [f64; 3]) {
        (self.low, self.size)
    }

    /// What `spec` says about the displacement error from the start of diagonal `index` to the share `shares[i]` of
    /// its length, for each `i`; mm. `travel`: Forward from start to end, Reverse back.
    ///
    /// # Errors
    /// The model breaks a rule.
    ///
    /// # Source  equations 5.3 c
    pub fn displacement(
        &self,
        spec: &ModelSpec,
        index: usize,
        shares: &[f64],
        travel: Travel,
    ) -> Result<Vec<f64>, DiagonalsError> {
        let model = Model::new(spec)?;
        let signs = SIGNS[index];
        let beam = Vec3::from_fn(|i, _| signs[i] * self.size[i] / self.length());
        let error = |share: f64| {
            let at: Vec<(AxisName, f64)> = (0..3)
                .map(|i| {
                    let along = if signs[i] > 0.0 { share } else { 1.0 - share };
                    (AXES[i], self.low[i] + along * self.size[i])
                })
                .collect();
            let mut pose = model.pose_of(&at);
            pose.tool_tip = Some(self.reflector);
            for (k, axis) in model.axes().enumerate() {
                let i = axis.name.direction();
                let towards_plus = (signs[i] > 0.0) == (travel == Travel::Forward);
                pose.travel[k] = if towards_plus { Travel::Forward } else { Travel::Reverse };
            }
            beam.dot(&model.deviation(&pose).position)
        };
        let start = error(0.0);
        Ok(shares.iter().map(|share| error(*share) - start).collect())
    }

    /// End-to-end displacements of the four diagonals by `spec`, mm.
    ///
    /// # Errors
    /// The model breaks a rule.
    pub fn displacements(&self, spec: &ModelSpec, travel: Travel) -> Result<[f64; 4], DiagonalsError> {
        let mut found = [0.0; 4];
        for (index, value) in found.iter_mut().enumerate() {
            *value = self.displacement(spec, index, &[1.0], travel)?[0];
        }
        Ok(found)
    }

    /// Squareness from end-to-end displacement errors (mm, order of [`SIGNS`]) from which everything else was
    /// subtracted; `noise` is the standard deviation of each.
    ///
    /// # Errors
    /// A displacement is not finite.
    ///
    /// # Source  equations 5.3
    pub fn squareness(
        &self,
        displacement: &[f64; 4],
        noise: &[f64; 4],
    ) -> Result<Squareness, DiagonalsError> {
        if let Some(i) = displacement.iter().zip(noise).position(|(d, s)| !(d.is_finite() && s.is_finite())) {
            return Err(DiagonalsError::NotFinite { name: NAMES[i] });
        }
        let inverse = self.inverse();
        let found = inverse * Vector4::from(*displacement);
        let spread = inverse.fixed_rows::<3>(1) * Matrix4::from_diagonal(&Vector4::from(*noise));
        Ok(Squareness {
            value: [found[1], found[2], found[3]],
            common: found[0],
            covariance: spread * spread.transpose(),
        })
    }

    /// Standard deviation of C0Y, B0Z, A0Z for displacements of standard deviation 1, rad per mm.
    #[must_use]
    pub fn sensitivity(&self) -> [f64; 3] {
        let inverse = self.inverse();
        std::array::from_fn(|i| inverse.row(i + 1).norm())
    }

    /// The design is orthogonal but for the scale of its columns, so its inverse is its scaled transpose.
    fn inverse(&self) -> Matrix4<f64> {
        let mut inverse = self.design.transpose();
        for i in 0..4 {
            let square = self.design.column(i).norm_squared();
            inverse.row_mut(i).scale_mut(1.0 / square);
        }
        inverse
    }

    /// The angular error motions that `spec` lacks although they would change the squareness.
    ///
    /// # Errors
    /// The model breaks a rule.
    pub fn missing_angles(&self, spec: &ModelSpec) -> Result<Vec<MissingAngle>, DiagonalsError> {
        let mut missing = Vec::new();
        for symbol in angles() {
            if spec.error(symbol).is_some() {
                continue;
            }
            let bias = self.bias_of(spec, symbol, [0.0, PROBE])?.map(|b| b / PROBE);
            if bias.iter().any(|b| b.abs() > 1e-9) {
                missing.push(MissingAngle { symbol, bias });
            }
        }
        Ok(missing)
    }

    /// Covariance of the squareness from the standard uncertainties that the angular and straightness curves of `spec`
    /// state: the values at the two ends of the box are taken as independent, so a straightness of standard uncertainty
    /// u over a side a feigns a squareness of sqrt(2) u / a.
    ///
    /// # Errors
    /// The model breaks a rule.
    pub fn covariance_of_model(&self, spec: &ModelSpec) -> Result<Matrix3<f64>, DiagonalsError> {
        let mut covariance = Matrix3::zeros();
        for symbol in angles().chain(straightnesses()) {
            let Some(std) = spec.error(symbol).and_then(|f| f.std) else { continue };
            for ends in [[PROBE, 0.0], [0.0, PROBE]] {
                let effect = Vec3::from(self.bias_of(spec, symbol, ends)?) * (std / PROBE);
                covariance += effect * effect.transpose();
            }
        }
        Ok(covariance)
    }

    /// Variance of the displacement half way along diagonal `index` from the standard uncertainties that the curves of `spec`
    /// state, mm^2: the value of a curve between the ends of the box, for ends without error.
    ///
    /// # Errors
    /// The model breaks a rule.
    pub fn step_variance_of_model(&self, spec: &ModelSpec, index: usize) -> Result<f64, DiagonalsError> {
        let mut variance = 0.0;
        for (symbol, function) in &spec.errors {
            let Some(std) = function.std.filter(|_| AXES.contains(&symbol.axis()) && !symbol.is_constant())
            else {
                continue;
            };
            let i = symbol.axis().direction();
            let (low, high) = (self.low[i], self.low[i] + self.size[i]);
            let alone =
                self.alone(spec, *symbol, vec![low, f64::midpoint(low, high), high], vec![0.0, PROBE, 0.0])?;
            let seen = self.displacement(&alone, index, &[0.5], Travel::Forward)?;
            variance += (seen[0] * std / PROBE).powi(2);
        }
        Ok(variance)
    }

    /// Squareness that an angular error with these values at the ends of the box feigns.
    fn bias_of(
        &self,
        spec: &ModelSpec,
        symbol: ErrorSymbol,
        ends: [f64; 2],
    ) -> Result<[f64; 3], DiagonalsError> {
        let i = symbol.axis().direction();
        let positions = vec![self.low[i], self.low[i] + self.size[i]];
        let alone = self.alone(spec, symbol, positions, ends.to_vec())?;
        let seen = self.displacements(&alone, Travel::Forward)?;
        Ok(self.squareness(&seen, &[0.0; 4])?.value)
    }

    /// The geometry of `spec` with one curve over the programmed coordinate, in relative sense.
    fn alone(
        &self,
        spec: &ModelSpec,
        symbol: ErrorSymbol,
        mut positions: Vec<f64>,
        mut values: Vec<f64>,
    ) -> Result<ModelSpec, DiagonalsError> {
        let mut alone = ModelSpec { errors: Vec::new(), datum: Vec::new(), ..spec.clone() };
        // a model in the carriage sense keeps its curves over the carriage's own displacement
        if spec.is_mirrored(symbol.axis()) {
            for list in [&mut positions, &mut values] {
                list.reverse();
                list.iter_mut().for_each(|v| *v = -*v);
            }
        }
        for axis in &mut alone.axes {
            axis.travel = None;
        }
        let size_mm = self.size[symbol.axis().direction()];
        let table = Table::new(positions, values, None, Interpolation::Linear)
            .map_err(|_| DiagonalsError::EmptyBox { axis: symbol.axis(), size_mm })?;
        alone.errors.push((symbol, ErrorFunction::single(Curve::Table(table))));
        Ok(alone)
    }
}

/// The nine angular error motions of X, Y and Z.
fn angles() -> impl Iterator<Item = ErrorSymbol> {
    motions([Component::A, Component::B, Component::C])
}

/// The six straightness error motions of X, Y and Z.
fn straightnesses() -> impl Iterator<Item = ErrorSymbol> {
    let is_across = |s: &ErrorSymbol| s.component().index() != s.axis().direction();
    motions([Component::X, Component::Y, Component::Z]).filter(is_across)
}

fn motions(components: [Component; 3]) -> impl Iterator<Item = ErrorSymbol> {
    AXES.into_iter().flat_map(move |axis| components.map(|component| ErrorSymbol::Motion { component, axis }))
}

/// The model without its squarenesses and without what only sensors tell.
#[must_use]
pub fn without_squareness(spec: &ModelSpec) -> ModelSpec {
    let mut spec = spec.clone();
    spec.errors.retain(|(symbol, _)| !SQUARENESS.contains(symbol));
    spec
}

#[cfg(test)]
mod tests;
