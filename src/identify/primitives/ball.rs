//! Circle and sphere of least squared distances.
//!
//! Minimises `SUM (|x_i - c| - r)^2`. For a given centre the best radius is the mean distance, so only the centre is
//! searched: `f_i = d_i - mean d`, a Levenberg-Marquardt iteration with the exact Jacobian `-(u_i - mean u)`,
//! `u_i = (x_i - c)/d_i`. It starts from several places (algebraic circle, centroid, both mixed) because the algebraic
//! start can lie in the basin of another minimum; the lowest sum wins.
//!
//! Source: Gander, Golub, Strebel 1994 (figure 1 is the test case); equations 5.4.

use nalgebra::{DMatrix, DVector, SMatrix, SVector};

use super::jacobi;

/// A circle (`D` = 2) or sphere (`D` = 3) with its uncertainty. Lengths in the unit of the points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ball<const D: usize> {
    /// Centre.
    pub centre: SVector<f64, D>,
    /// Radius.
    pub radius: f64,
    /// Covariance of the centre for coordinates of unit variance; times sigma^2 for coordinates of that variance.
    pub centre_cofactor: SMatrix<f64, D, D>,
    /// Covariance of centre and radius for unit variance.
    pub centre_radius_cofactor: SVector<f64, D>,
    /// Variance of the radius for unit variance.
    pub radius_cofactor: f64,
    /// Root of the mean squared distance of the points from the figure.
    pub rms: f64,
    /// Noise of a coordinate estimated from the distances, `sqrt(SSE/(n - D - 1))`; `None` without redundancy.
    pub sigma: Option<f64>,
    /// Condition number of the design (unit directions and 1): 1.4 to 1.7 for points all around, large for short arcs.
    pub condition: f64,
}

/// A circle in a plane.
pub type Circle2 = Ball<2>;
/// A sphere.
pub type Sphere = Ball<3>;

/// Why no circle or sphere can be found.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum BallError {
    /// Fewer points than unknowns.
    #[error("{found} points; a {} needs at least {needed}", if *needed == 3 { "circle" } else { "sphere" })]
    TooFewPoints {
        /// Points given.
        found: usize,
        /// Points needed.
        needed: usize,
    },
    /// A coordinate that is no number.
    #[error("point {point} is not finite")]
    NotFinite {
        /// 1-based point.
        point: usize,
    },
    /// All points in one place, on a line, on a plane or on a very short arc.
    #[error(
        "the points do not determine a centre (condition {condition:.1e}, limit {limit:.0e}): they lie nearly on a {}; measure a longer arc",
        if *dimensions == 2 { "straight line" } else { "plane, or all around one circle" },
        limit = CONDITION_LIMIT
    )]
    Degenerate {
        /// 2 for a circle, 3 for a sphere.
        dimensions: usize,
        /// Condition number of the design.
        condition: f64,
    },
}

/// Condition number above which a centre is refused; an arc of half a degree has 2e5.
pub const CONDITION_LIMIT: f64 = 1e6;
/// Iterations after which a start is given up; good starts need less than ten.
const ITERATIONS: usize = 300;
/// Distance of the centre, in rms radii of the points, from which on the figure is a straight line.
const FARTHEST: f64 = 1e5;

/// The circle of least squared distances through points of a plane.
///
/// # Errors
/// Fewer than three points, numbers that are not finite, points on a line.
///
/// # Source  equations 5.4; Gander, Golub, Strebel 1994
pub fn circle_2d(points: &[[f64; 2]]) -> Result<Circle2, BallError> {
    fit(points)
}

/// The sphere of least squared distances.
///
/// # Errors
/// Fewer than four points, numbers that are not finite, points in a plane.
pub fn sphere(points: &[[f64; 3]]) -> Result<Sphere, BallError> {
    fit(points)
}

impl<const D: usize> Ball<D> {
    /// Standard deviation (k = 1) of the radius for points with standard deviation `sigma`.
    #[must_use]
    pub fn radius_std(&self, sigma: f64) -> f64 {
        sigma * self.radius_cofactor.sqrt()
    }
}

fn fit<const D: usize>(points: &[[f64; D]]) -> Result<Ball<D>, BallError> {
    if points.len() < D + 1 {
        return Err(BallError::TooFewPoints { found: points.len(), needed: D + 1 });
    }
    if let Some(i) = points.iter().position(|p| p.iter().any(|v| !v.is_finite())) {
        return Err(BallError::NotFinite { point: i + 1 });
    }
    let n = points.len() as f64;
    let raw: Vec<SVector<f64, D>> = points.iter().map(|p| SVector::from(*p)).collect();
    let mean = raw.iter().sum::<SVector<f64, D>>() / n;
    let scale = (raw.iter().map(|p| (p - mean).norm_squared()).sum::<f64>() / n).sqrt();
    if scale == 0.0 {
        return Err(BallError::Degenerate { dimensions: D, condition: f64::INFINITY });
    }
    let scaled: Vec<SVector<f64, D>> = raw.iter().map(|p| (p - mean) / scale).collect();
    let best = starts(&scaled)
        .into_iter()
        .map(|start| descend(&scaled, start))
        .filter(|(_, sum)| sum.is_finite())
        .min_by(|a, b| a.1.total_cmp(&b.1));
    let Some((centre, sum)) = best else {
        return Err(BallError::Degenerate { dimensions: D, condition: f64::INFINITY });
    };
    finish(&scaled, centre, sum, mean, scale)
}

/// Centre and uncertainty in the units of the points.
fn finish<const D: usize>(
    scaled: &[SVector<f64, D>],
    centre: SVector<f64, D>,
    sum: f64,
    mean: SVector<f64, D>,
    scale: f64,
) -> Result<Ball<D>, BallError> {
    let n = scaled.len();
    let radius = mean_distance(scaled, &centre);
    let design = DMatrix::from_fn(n, D + 1, |i, j| {
        let from_centre = scaled[i] - centre;
        if j < D { from_centre[j] / from_centre.norm() } else { 1.0 }
    });
    let svd = jacobi::svd(&design);
    let condition = svd.condition();
    if condition.is_nan() || condition > CONDITION_LIMIT {
        return Err(BallError::Degenerate { dimensions: D, condition });
    }
    let cofactor = |i: usize, j: usize| svd.cofactor(i, j);
    let redundancy = n - D - 1;
    Ok(Ball {
        centre: mean + centre * scale,
        radius: radius * scale,
        centre_cofactor: SMatrix::from_fn(cofactor),
        centre_radius_cofactor: SVector::from_fn(|i, _| cofactor(i, D)),
        radius_cofactor: cofactor(D, D),
        rms: (sum / n as f64).sqrt() * scale,
        sigma: (redundancy > 0).then(|| (sum / redundancy as f64).sqrt() * scale),
        condition,
    })
}

/// Where the search begins: the algebraic centre, the centroid, and places between and beyond.
fn starts<const D: usize>(points: &[SVector<f64, D>]) -> Vec<SVector<f64, D>> {
    let algebraic = algebraic_centre(points);
    vec![SVector::zeros(), algebraic, algebraic * 0.5, algebraic * 1.5]
}

/// Centre of the circle `|x|^2 = 2 c.x + k` in least squares (Kasa).
fn algebraic_centre<const D: usize>(points: &[SVector<f64, D>]) -> SVector<f64, D> {
    let design = DMatrix::from_fn(points.len(), D + 1, |i, j| if j < D { 2.0 * points[i][j] } else { 1.0 });
    let squares = DVector::from_fn(points.len(), |i, _| points[i].norm_squared());
    let solution = jacobi::svd(&design).solve(&squares, 1e-12);
    SVector::from_fn(|i, _| solution[i])
}

fn mean_distance<const D: usize>(points: &[SVector<f64, D>], centre: &SVector<f64, D>) -> f64 {
    points.iter().map(|p| (p - centre).norm()).sum::<f64>() / points.len() as f64
}

fn sum_of_squares<const D: usize>(points: &[SVector<f64, D>], centre: &SVector<f64, D>) -> f64 {
    let radius = mean_distance(points, centre);
    points.iter().map(|p| ((p - centre).norm() - radius).powi(2)).sum()
}

/// Levenberg-Marquardt on the centre.
fn descend<const D: usize>(points: &[SVector<f64, D>], start: SVector<f64, D>) -> (SVector<f64, D>, f64) {
    let n = points.len() as f64;
    let mut centre = start;
    let mut sum = sum_of_squares(points, &centre);
    let mut damping = 1e-3;
    for _ in 0..ITERATIONS {
        let radius = mean_distance(points, &centre);
        let directions: Vec<SVector<f64, D>> = points.iter().map(|p| direction(p, &centre)).collect();
        let mean = directions.iter().sum::<SVector<f64, D>>() / n;
        let mut normal = SMatrix::<f64, D, D>::zeros();
        let mut slope = SVector::<f64, D>::zeros();
        for (p, u) in points.iter().zip(&directions) {
            let row = u - mean;
            normal += row * row.transpose();
            slope += row * ((p - centre).norm() - radius);
        }
        let mut moved = false;
        while damping < 1e12 {
            let damped = normal + SMatrix::<f64, D, D>::identity() * (damping * normal.trace() / D as f64);
            let Some(cholesky) = damped.cholesky() else {
                damping *= 10.0;
                continue;
            };
            let step = cholesky.solve(&slope);
            let candidate = centre + step;
            if candidate.norm() > FARTHEST {
                return (candidate, f64::INFINITY);
            }
            let lower = sum_of_squares(points, &candidate);
            if lower <= sum {
                let small = step.norm() <= 1e-15 * (1.0 + centre.norm());
                centre = candidate;
                moved = !(small || lower == 0.0);
                sum = lower;
                damping = (damping * 0.1).max(1e-15);
                break;
            }
            damping *= 10.0;
        }
        if !moved {
            break;
        }
    }
    (centre, sum)
}

/// Unit vector from the centre; zero in the centre itself, where no direction is better than another.
fn direction<const D: usize>(point: &SVector<f64, D>, centre: &SVector<f64, D>) -> SVector<f64, D> {
    (point - centre).try_normalize(1e-300).unwrap_or_else(SVector::zeros)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// The six points of Gander, Golub and Strebel, for which the algebraic circle is far off.
    const GANDER: [[f64; 2]; 6] = [[1.0, 7.0], [2.0, 6.0], [5.0, 8.0], [7.0, 7.0], [9.0, 5.0], [3.0, 7.0]];

    #[test]
    fn the_case_with_a_bad_algebraic_start() {
        let circle = circle_2d(&GANDER).unwrap();
        assert!((circle.centre[0] - 4.739_782).abs() < 1e-6, "{circle:?}");
        assert!((circle.centre[1] - 2.983_533).abs() < 1e-6);
        assert!((circle.radius - 4.714_226).abs() < 1e-6);
        let algebraic = algebraic_centre(&GANDER.map(SVector::from));
        assert!((algebraic - circle.centre).norm() > 0.5, "{algebraic}");
    }

    #[test]
    fn no_start_of_a_grid_finds_a_lower_sum() {
        let points = GANDER.map(SVector::from);
        let best = 6.0 * circle_2d(&GANDER).unwrap().rms.powi(2);
        for x in -10..20 {
            for y in -10..20 {
                let (_, sum) = descend(&points, SVector::from([f64::from(x), f64::from(y)]));
                assert!(sum > best * (1.0 - 1e-12), "{x} {y}: {sum} below {best}");
            }
        }
    }

    #[test]
    fn three_points_are_met_exactly_and_leave_no_noise_estimate() {
        let c = circle_2d(&[[2000.0, 0.0], [2003.0, 3.0], [2006.0, 0.0]]).unwrap();
        assert!((c.centre - SVector::from([2003.0, 0.0])).norm() < 1e-12 && (c.radius - 3.0).abs() < 1e-12);
        assert_eq!(c.sigma, None);
    }

    #[test]
    fn what_is_no_circle_is_refused() {
        let line: Vec<[f64; 2]> = (0..9).map(|i| [f64::from(i), 3.0 + 0.5 * f64::from(i)]).collect();
        assert!(matches!(circle_2d(&line), Err(BallError::Degenerate { .. })));
        assert!(matches!(circle_2d(&[[1.0, 2.0]; 5]), Err(BallError::Degenerate { .. })));
        assert!(matches!(circle_2d(&[[1.0, 2.0]; 2]), Err(BallError::TooFewPoints { found: 2, needed: 3 })));
        assert_eq!(
            circle_2d(&[[1.0, 2.0], [f64::NAN, 0.0], [3.0, 3.0]]),
            Err(BallError::NotFinite { point: 2 })
        );
        let flat = [[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.6, 0.8, 0.0]];
        assert!(matches!(sphere(&flat), Err(BallError::Degenerate { dimensions: 3, .. })));
        let short: Vec<[f64; 2]> = (0..20).map(|i| (1e-5 * f64::from(i)).sin_cos().into()).collect();
        let message = circle_2d(&short).unwrap_err().to_string();
        assert!(message.contains("measure a longer arc"), "{message}");
    }

    #[test]
    fn a_full_circle_has_the_uncertainty_of_the_formula() {
        let n = 72;
        let points: Vec<[f64; 2]> = (0..n)
            .map(|i| {
                let (s, c) = (f64::from(i) * core::f64::consts::TAU / f64::from(n)).sin_cos();
                [169.0 + 40.0 * c, -7.0 + 40.0 * s]
            })
            .collect();
        let circle = circle_2d(&points).unwrap();
        let expected = (2.0 / f64::from(n)).sqrt();
        assert!((0..2).all(|i| (circle.centre_cofactor[(i, i)].sqrt() - expected).abs() < 1e-12));
        assert!((circle.radius_std(1.0) - (1.0 / f64::from(n)).sqrt()).abs() < 1e-12);
    }

    proptest! {
        #[test]
        fn exact_points_give_their_circle(
            x in -3e3..3e3f64, y in -3e3..3e3f64, r in 1.0..500.0f64, from in 0.0..6.0f64, arc in 0.3..6.2f64, n in 4usize..40,
        ) {
            let points: Vec<[f64; 2]> = (0..n)
                .map(|i| {
                    let (s, c) = (from + arc * i as f64 / n as f64).sin_cos();
                    [x + r * c, y + r * s]
                })
                .collect();
            let circle = circle_2d(&points).unwrap();
            prop_assert!((circle.centre - SVector::from([x, y])).norm() < 1e-7, "{circle:?}");
            prop_assert!((circle.radius - r).abs() < 1e-7);
        }
    }
}
