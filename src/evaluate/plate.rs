//! A hole plate or ball plate measured in a plane: offset, rotation, scale and squareness of the coordinate system in
//! which it was made or measured.
//!
//! `measured = o + M nominal + r`, `M` a rotation (rigid), a rotation times a scale (similarity) or any matrix (affine).
//! The columns of `M` are the lines X and Y: their lengths are the scales, their directions give the rotation (that
//! of X) and the squareness C0Y (positive: the angle from X to Y is above 90 deg, equations 1.7).
//!
//! Minimised is `SUM |r|^2`, or `SUM |r|^4`, which published fits of drilled plates use: it cares for the worst holes. Both
//! are convex in `o, M`; Newton's method with step halving. Standard uncertainties: from the residuals, `s^2 (J'J)^-1`
//! for squares, the sandwich `A^-1 B A^-1` for the fourth power.

use nalgebra::{DMatrix, DVector, Matrix2, Matrix2xX, Vector2};

use volcomp_model::statistics::chi_square_upper;

/// One hole or ball.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlatePoint {
    /// Nominal (or calibrated) place.
    pub nominal: [f64; 2],
    /// Measured place.
    pub measured: [f64; 2],
}

/// What may differ between the two coordinate systems.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum PlateModel {
    /// Offset and rotation.
    Rigid,
    /// And a common scale.
    Similarity,
    /// And a scale for each axis, and squareness.
    #[default]
    Affine,
}

/// What is minimised.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum PlateNorm {
    /// The sum of squares.
    #[default]
    Squares,
    /// The sum of fourth powers.
    Fourth,
}

/// A value with its standard uncertainty (k = 1).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// The value.
    pub value: f64,
    /// Standard uncertainty.
    pub std: f64,
}

/// A fitted plate. Lengths in the unit of the points, angles rad, scales as deviations from 1.
#[derive(Debug, Clone, PartialEq)]
pub struct PlateFit {
    /// Offset of the origin of the nominal places.
    pub offset: [Estimate; 2],
    /// Rotation of the X line.
    pub rotation: Estimate,
    /// Mean scale minus 1, where it was free.
    pub scale: Option<Estimate>,
    /// Scale of X and of Y minus 1, where they were free.
    pub scales: Option<[Estimate; 2]>,
    /// Scale of X minus scale of Y, where they were free.
    pub differential: Option<Estimate>,
    /// Squareness C0Y, where it was free.
    pub squareness: Option<Estimate>,
    /// Measured minus fitted.
    pub residuals: Vec<[f64; 2]>,
    /// Root mean square of measured minus nominal.
    pub rms_before: f64,
    /// Root mean square of the residuals, radial.
    pub rms: f64,
    /// The same with every point predicted by the others (squares only).
    pub rms_left_out: Option<f64>,
    /// Index and size of the largest residual.
    pub largest: (usize, f64),
    /// Degrees of freedom.
    pub dof: usize,
    /// Where an uncertainty of the coordinates was stated: chi-square and the probability to exceed it.
    pub chi_square: Option<(f64, f64)>,
}

/// Why a plate cannot be fitted.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum PlateError {
    /// Not enough points.
    #[error("{found} points; {what} needs at least {needed}")]
    TooFewPoints {
        /// Points found.
        found: usize,
        /// Points needed.
        needed: usize,
        /// The model.
        what: &'static str,
    },
    /// A number that is none.
    #[error("point {row} is not finite")]
    NotFinite {
        /// 1-based point.
        row: usize,
    },
    /// All points on a line or in one place.
    #[error(
        "the nominal places spread {ratio:.1e} times as far across as along their longest direction; {what} needs at least {limit:.0e}: take places in two directions{}", if matches!(.what, &"an affine fit") { ", or --model similarity" } else { "" }
    )]
    Degenerate {
        /// Spread across over spread along.
        ratio: f64,
        /// Least ratio.
        limit: f64,
        /// The model.
        what: &'static str,
    },
    /// The stated uncertainty is none.
    #[error("standard uncertainty {value} is not above 0")]
    BadStd {
        /// The value.
        value: f64,
    },
}

/// Least spread across the points, as a share of that along them, for scales and squareness.
const SPREAD_LIMIT: f64 = 1e-2;
/// Largest difference from nominal taken for real, as a share of the size of the plate.
const STEPS_MAX: usize = 100;

/// Parameters: the place of the centre, then those of M.
struct Problem<'a> {
    points: &'a [PlatePoint],
    model: PlateModel,
    centre: Vector2<f64>,
}

impl PlateModel {
    const fn parameters(self) -> usize {
        match self {
            Self::Rigid => 3,
            Self::Similarity => 4,
            Self::Affine => 6,
        }
    }

    const fn what(self) -> &'static str {
        match self {
            Self::Rigid => "a rigid fit",
            Self::Similarity => "a similarity fit",
            Self::Affine => "an affine fit",
        }
    }
}

impl PlateFit {
    /// Fits a plate; `std` is the standard uncertainty of a coordinate, where known.
    ///
    /// # Errors
    /// Too few points, points on a line, numbers that are not finite.
    pub fn new(
        points: &[PlatePoint],
        model: PlateModel,
        norm: PlateNorm,
        std: Option<f64>,
    ) -> Result<Self, PlateError> {
        let problem = Problem::new(points, model)?;
        if let Some(value) = std.filter(|s| !(s.is_finite() && *s > 0.0)) {
            return Err(PlateError::BadStd { value });
        }
        let start = problem.minimise(problem.start(), PlateNorm::Squares);
        let best = match norm {
            PlateNorm::Squares => start,
            PlateNorm::Fourth => problem.minimise(start, norm),
        };
        let covariance = problem.covariance(&best, norm);
        Ok(problem.result(&best, &covariance, norm, std))
    }
}

impl<'a> Problem<'a> {
    fn new(points: &'a [PlatePoint], model: PlateModel) -> Result<Self, PlateError> {
        let finite = |p: &PlatePoint| p.nominal.iter().chain(&p.measured).all(|v| v.is_finite());
        if let Some(i) = points.iter().position(|p| !finite(p)) {
            return Err(PlateError::NotFinite { row: i + 1 });
        }
        let (needed, what) = (model.parameters() / 2 + 1, model.what());
        if points.len() < needed {
            return Err(PlateError::TooFewPoints { found: points.len(), needed, what });
        }
        let nominal = || points.iter().map(|p| Vector2::from(p.nominal));
        let centre = nominal().sum::<Vector2<f64>>() / points.len() as f64;
        let spread = nominal().map(|p| (p - centre) * (p - centre).transpose()).sum::<Matrix2<f64>>();
        let values = spread.symmetric_eigenvalues();
        let (small, large) = (values.min().max(0.0).sqrt(), values.max().sqrt());
        let ratio = if large > 0.0 { small / large } else { 0.0 };
        let limit = if model == PlateModel::Affine { SPREAD_LIMIT } else { 0.0 };
        if large <= 0.0 || ratio < limit {
            return Err(PlateError::Degenerate { ratio, limit, what });
        }
        Ok(Self { points, model, centre })
    }

    fn start(&self) -> DVector<f64> {
        let mut p = DVector::zeros(self.model.parameters());
        p[0] = self.centre.x;
        p[1] = self.centre.y;
        match self.model {
            PlateModel::Rigid => {
                // a plate may lie in any direction on its table: start from the similarity
                let n = self.points.len() as f64;
                let mean = self.points.iter().map(|q| Vector2::from(q.measured)).sum::<Vector2<f64>>() / n;
                let (mut dot, mut cross) = (0.0, 0.0);
                for q in self.points {
                    let (a, b) = (Vector2::from(q.nominal) - self.centre, Vector2::from(q.measured) - mean);
                    dot += a.dot(&b);
                    cross += a.perp(&b);
                }
                p[2] = cross.atan2(dot);
            }
            PlateModel::Similarity => p[2] = 1.0,
            PlateModel::Affine => {
                p[2] = 1.0;
                p[5] = 1.0;
            }
        }
        p
    }

    fn matrix(&self, p: &DVector<f64>) -> Matrix2<f64> {
        match self.model {
            PlateModel::Rigid => {
                let (s, c) = p[2].sin_cos();
                Matrix2::new(c, -s, s, c)
            }
            PlateModel::Similarity => Matrix2::new(p[2], -p[3], p[3], p[2]),
            PlateModel::Affine => Matrix2::new(p[2], p[3], p[4], p[5]),
        }
    }

    /// Residual of a point and how the fitted place changes with the parameters.
    fn row(&self, p: &DVector<f64>, q: &PlatePoint) -> (Vector2<f64>, Matrix2xX<f64>) {
        let v = Vector2::from(q.nominal) - self.centre;
        let fitted = Vector2::new(p[0], p[1]) + self.matrix(p) * v;
        let mut j = Matrix2xX::zeros(self.model.parameters());
        j[(0, 0)] = 1.0;
        j[(1, 1)] = 1.0;
        match self.model {
            PlateModel::Rigid => {
                let turned = self.matrix(p) * Vector2::new(-v.y, v.x);
                j.set_column(2, &turned);
            }
            PlateModel::Similarity => {
                j.set_column(2, &v);
                j.set_column(3, &Vector2::new(-v.y, v.x));
            }
            PlateModel::Affine => {
                (j[(0, 2)], j[(0, 3)], j[(1, 4)], j[(1, 5)]) = (v.x, v.y, v.x, v.y);
            }
        }
        (Vector2::from(q.measured) - fitted, j)
    }

    fn cost(&self, p: &DVector<f64>, norm: PlateNorm) -> f64 {
        let of = |q: &PlatePoint| self.row(p, q).0.norm_squared();
        match norm {
            PlateNorm::Squares => self.points.iter().map(of).sum(),
            PlateNorm::Fourth => self.points.iter().map(|q| of(q).powi(2)).sum(),
        }
    }

    /// Half the Hessian and the downhill gradient of the squares; a quarter of those of the fourth power.
    fn normal(&self, p: &DVector<f64>, norm: PlateNorm) -> (DMatrix<f64>, DVector<f64>) {
        let m = self.model.parameters();
        let (mut a, mut g) = (DMatrix::zeros(m, m), DVector::zeros(m));
        for q in self.points {
            let (r, j) = self.row(p, q);
            let (weight, gradient) = match norm {
                PlateNorm::Squares => (Matrix2::identity(), r),
                PlateNorm::Fourth => {
                    (Matrix2::identity() * r.norm_squared() + 2.0 * r * r.transpose(), r * r.norm_squared())
                }
            };
            a += j.transpose() * weight * &j;
            g += j.transpose() * gradient;
        }
        (a, g)
    }

    fn minimise(&self, mut p: DVector<f64>, norm: PlateNorm) -> DVector<f64> {
        let mut cost = self.cost(&p, norm);
        for _ in 0..STEPS_MAX {
            let (a, g) = self.normal(&p, norm);
            let Some(step) = solve(&a, &g) else { break };
            let mut share = 1.0;
            let better = loop {
                let candidate = &p + &step * share;
                let c = self.cost(&candidate, norm);
                if c <= cost {
                    break Some((candidate, c));
                }
                share *= 0.5;
                if share < 1e-12 {
                    break None;
                }
            };
            let Some((candidate, c)) = better else { break };
            let done = (cost - c) <= 1e-15 * cost && step.amax() * share <= 1e-13 * p.amax().max(1.0);
            (p, cost) = (candidate, c);
            if done {
                break;
            }
        }
        p
    }

    fn covariance(&self, p: &DVector<f64>, norm: PlateNorm) -> DMatrix<f64> {
        let m = self.model.parameters();
        let dof = (2 * self.points.len() - m).max(1) as f64;
        let (a, _) = self.normal(p, norm);
        let Some(inverse) = a.try_inverse() else { return DMatrix::zeros(m, m) };
        match norm {
            PlateNorm::Squares => inverse * (self.cost(p, PlateNorm::Squares) / dof),
            PlateNorm::Fourth => {
                let mut b = DMatrix::zeros(m, m);
                for q in self.points {
                    let (r, j) = self.row(p, q);
                    let g = j.transpose() * r * r.norm_squared();
                    b += &g * g.transpose();
                }
                &inverse * b * &inverse * (2.0 * self.points.len() as f64 / dof)
            }
        }
    }

    /// Value and uncertainty of a quantity that follows from offset and matrix.
    fn estimate(
        &self,
        p: &DVector<f64>,
        covariance: &DMatrix<f64>,
        of: impl Fn(Vector2<f64>, Matrix2<f64>) -> f64,
    ) -> Estimate {
        let value = |p: &DVector<f64>| {
            let matrix = self.matrix(p);
            of(Vector2::new(p[0], p[1]) - matrix * self.centre, matrix)
        };
        let gradient = DVector::from_fn(p.len(), |i, _| {
            let step = 1e-6 * p[i].abs().max(1.0);
            let [mut up, mut down] = [p.clone(), p.clone()];
            up[i] += step;
            down[i] -= step;
            (value(&up) - value(&down)) / (2.0 * step)
        });
        let variance = (gradient.transpose() * covariance * &gradient)[0];
        Estimate { value: value(p), std: variance.max(0.0).sqrt() }
    }

    fn result(
        &self,
        p: &DVector<f64>,
        covariance: &DMatrix<f64>,
        norm: PlateNorm,
        std: Option<f64>,
    ) -> PlateFit {
        let residuals: Vec<[f64; 2]> = self.points.iter().map(|q| self.row(p, q).0.into()).collect();
        let n = self.points.len() as f64;
        let rms = |v: &mut dyn Iterator<Item = f64>| (v.sum::<f64>() / n).sqrt();
        let sse: f64 = self.cost(p, PlateNorm::Squares);
        let dof = 2 * self.points.len() - self.model.parameters();
        let est = |of: &dyn Fn(Vector2<f64>, Matrix2<f64>) -> f64| self.estimate(p, covariance, of);
        let x = |m: &Matrix2<f64>| m.column(0).norm();
        let y = |m: &Matrix2<f64>| m.column(1).norm();
        let turn = |m: &Matrix2<f64>| m[(1, 0)].atan2(m[(0, 0)]);
        let free = self.model == PlateModel::Affine;
        let largest = residuals.iter().map(|r| r[0].hypot(r[1])).enumerate();
        PlateFit {
            offset: [est(&|o, _| o.x), est(&|o, _| o.y)],
            rotation: est(&|_, m| turn(&m)),
            scale: (self.model != PlateModel::Rigid).then(|| est(&|_, m| 0.5 * (x(&m) + y(&m)) - 1.0)),
            scales: free.then(|| [est(&|_, m| x(&m) - 1.0), est(&|_, m| y(&m) - 1.0)]),
            differential: free.then(|| est(&|_, m| x(&m) - y(&m))),
            squareness: free.then(|| {
                est(&|_, m| {
                    // the angle from X to Y, less 90 degrees
                    let (a, b) = (m.column(0), m.column(1));
                    -(a.dot(&b)).atan2(a[0] * b[1] - a[1] * b[0])
                })
            }),
            rms_before: rms(&mut self
                .points
                .iter()
                .map(|q| (Vector2::from(q.measured) - Vector2::from(q.nominal)).norm_squared())),
            rms: (sse / n).sqrt(),
            rms_left_out: (norm == PlateNorm::Squares).then(|| self.left_out(p)).flatten(),
            largest: largest.reduce(|a, b| if b.1 > a.1 { b } else { a }).unwrap_or((0, 0.0)),
            residuals,
            dof,
            chi_square: std.filter(|_| dof > 0).map(|s| {
                let chi = sse / (s * s);
                (chi, chi_square_upper(chi, dof))
            }),
        }
    }

    /// Every point predicted by the others: `(I - H_i)^-1 r_i` with the leverage of the point.
    fn left_out(&self, p: &DVector<f64>) -> Option<f64> {
        let (a, _) = self.normal(p, PlateNorm::Squares);
        let inverse = a.try_inverse()?;
        let mut sum = 0.0;
        for q in self.points {
            let (r, j) = self.row(p, q);
            let own: Matrix2<f64> = (&j * &inverse * j.transpose()).fixed_view::<2, 2>(0, 0).into_owned();
            sum += ((Matrix2::identity() - own).try_inverse()? * r).norm_squared();
        }
        Some((sum / self.points.len() as f64).sqrt())
    }
}

/// `A^-1 g`; where a fourth power is flat in some direction, the least step.
fn solve(a: &DMatrix<f64>, g: &DVector<f64>) -> Option<DVector<f64>> {
    match a.clone().cholesky() {
        Some(c) => Some(c.solve(g)),
        None => a.clone().svd(true, true).solve(g, 1e-14 * a.amax()).ok(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn places() -> Vec<[f64; 2]> {
        (0..30)
            .map(|i| [37.0 * f64::from(i % 6) - 90.0, 41.0 * f64::from(i / 6) - 110.0 + f64::from(i % 7)])
            .collect()
    }

    /// Rotation, scales and squareness put together from their definitions, not from a matrix.
    fn made(theta: f64, sx: f64, sy: f64, square: f64, noise: impl Fn(usize) -> [f64; 2]) -> Vec<PlatePoint> {
        let line = |angle: f64, scale: f64, q: f64| [q * scale * angle.cos(), q * scale * angle.sin()];
        let of = |(i, p): (usize, [f64; 2])| {
            let x = line(theta, 1.0 + sx, p[0]);
            let y = line(theta + core::f64::consts::FRAC_PI_2 + square, 1.0 + sy, p[1]);
            let d = noise(i);
            PlatePoint { nominal: p, measured: [0.3 + x[0] + y[0] + d[0], -0.2 + x[1] + y[1] + d[1]] }
        };
        places().into_iter().enumerate().map(of).collect()
    }

    #[test]
    fn a_plate_without_noise_gives_back_what_it_was_made_with() {
        let points = made(0.7, 20e-6, -13e-6, 45e-6, |_| [0.0, 0.0]);
        for norm in [PlateNorm::Squares, PlateNorm::Fourth] {
            let f = PlateFit::new(&points, PlateModel::Affine, norm, None).unwrap();
            let [x, y] = f.scales.unwrap();
            for (got, want) in [
                (f.offset[0].value, 0.3),
                (f.offset[1].value, -0.2),
                (f.rotation.value, 0.7),
                (x.value, 20e-6),
                (y.value, -13e-6),
                (f.differential.unwrap().value, 33e-6),
                (f.squareness.unwrap().value, 45e-6),
            ] {
                assert!((got - want).abs() < 1e-10, "{got} instead of {want}");
            }
            assert!(f.rms < 1e-10);
        }
        let f = PlateFit::new(
            &made(-2.5, 0.0, 0.0, 0.0, |_| [0.0; 2]),
            PlateModel::Rigid,
            PlateNorm::Squares,
            None,
        );
        assert!((f.unwrap().rotation.value + 2.5).abs() < 1e-12);
    }

    #[test]
    fn the_fourth_power_cares_for_the_worst() {
        let points = made(0.0, 0.0, 0.0, 0.0, |i| if i == 0 { [0.1, 0.0] } else { [0.0, 0.0] });
        let [two, four] = [PlateNorm::Squares, PlateNorm::Fourth]
            .map(|n| PlateFit::new(&points, PlateModel::Similarity, n, None).unwrap());
        assert!(four.largest.1 < two.largest.1 && four.rms > two.rms);
        assert_eq!(two.largest.0, 0);
        // no small change of any parameter makes the sum of fourth powers smaller
        let sum = |r: &PlateFit| r.residuals.iter().map(|r| (r[0] * r[0] + r[1] * r[1]).powi(2)).sum::<f64>();
        assert!(sum(&four) < sum(&two));
    }

    #[test]
    fn the_interval_holds_the_truth_at_its_rate() {
        let mut state = 99u64;
        let mut normal = || {
            let mut uniform = || {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                ((state >> 11) as f64 + 0.5) / (1u64 << 53) as f64
            };
            let (a, b) = (uniform(), uniform());
            (-2.0 * a.ln()).sqrt() * (core::f64::consts::TAU * b).cos()
        };
        let (mut inside, runs) = ([0u32; 4], 2000);
        for _ in 0..runs {
            let noise: Vec<[f64; 2]> = (0..30).map(|_| [0.005 * normal(), 0.005 * normal()]).collect();
            let points = made(0.01, 20e-6, -10e-6, 15e-6, |i| noise[i]);
            let f = PlateFit::new(&points, PlateModel::Affine, PlateNorm::Squares, Some(0.005)).unwrap();
            let truths = [
                (f.offset[0], 0.3),
                (f.rotation, 0.01),
                (f.differential.unwrap(), 30e-6),
                (f.squareness.unwrap(), 15e-6),
            ];
            for (count, (e, truth)) in inside.iter_mut().zip(truths) {
                // 97.5 % point of Student's t at 54 degrees of freedom
                *count += u32::from((e.value - truth).abs() < 2.0049 * e.std);
            }
        }
        for count in inside {
            let rate = f64::from(count) / f64::from(runs);
            assert!((0.935..0.965).contains(&rate), "{rate}");
        }
    }

    #[test]
    fn the_test_of_fit_knows_the_noise() {
        let points = made(0.0, 0.0, 0.0, 0.0, |i| {
            [
                0.005 * (f64::from(i as u32) * 1.7).sin() * 1.414,
                0.005 * (f64::from(i as u32) * 2.3).cos() * 1.414,
            ]
        });
        let p = |std: f64| {
            PlateFit::new(&points, PlateModel::Similarity, PlateNorm::Squares, Some(std))
                .unwrap()
                .chi_square
                .unwrap()
                .1
        };
        assert!(p(0.005) > 0.01 && p(0.0025) < 1e-6);
    }

    #[test]
    fn what_cannot_be_told_is_refused() {
        let line: Vec<PlatePoint> = (0..9)
            .map(|i| {
                let v = f64::from(i);
                PlatePoint { nominal: [v, 2.0 * v], measured: [v, 2.0 * v] }
            })
            .collect();
        let fit = |points: &[PlatePoint], model| PlateFit::new(points, model, PlateNorm::Squares, None);
        let refused = fit(&line, PlateModel::Affine).unwrap_err();
        assert!(matches!(refused, PlateError::Degenerate { .. }), "{refused}");
        assert!(refused.to_string().contains("--model similarity"), "{refused}");
        assert!(fit(&line, PlateModel::Similarity).is_ok());
        assert!(matches!(
            fit(&line[..3], PlateModel::Affine).unwrap_err(),
            PlateError::TooFewPoints { needed: 4, .. }
        ));
        let one = [line[3]; 5];
        assert!(matches!(fit(&one, PlateModel::Rigid).unwrap_err(), PlateError::Degenerate { .. }));
        let mut bad = line.clone();
        bad[1].measured[0] = f64::NAN;
        assert_eq!(fit(&bad, PlateModel::Rigid).unwrap_err(), PlateError::NotFinite { row: 2 });
        let std = PlateFit::new(&line, PlateModel::Rigid, PlateNorm::Squares, Some(0.0));
        assert!(matches!(std.unwrap_err(), PlateError::BadStd { .. }));
    }
}
