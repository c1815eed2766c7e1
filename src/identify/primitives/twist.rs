//! Six error motions from linear equations: the one solver behind points, lines and poses.
//!
//! A body that moves by `d` (mm) and turns by the small vector `eps` (rad) displaces its point p by `d + eps x p`.
//! Every instrument here delivers components of such displacements; each is one row `design . (d, eps) = value`,
//! divided by its standard deviation. The unknowns are ordered EX EY EZ EA EB EC.
//!
//! Assumptions: first order in `eps` (100 urad at 0.5 m leave 3 nm), noise normal with the stated covariance.
//! Source: equations 5.1, 5.5, 5.7.

use crate::prelude::*;

/// One equation, whitened: its noise has unit variance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Row {
    /// Coefficients of EX EY EZ (1/mm at unit variance) and EA EB EC.
    pub design: Vector6<f64>,
    /// Right-hand side.
    pub value: f64,
}

/// Where a point of the body was found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sighting {
    /// The point in body coordinates, mm.
    pub point: Vec3,
    /// Measured displacement, mm.
    pub displacement: Vec3,
    /// Its covariance, mm2.
    pub covariance: Mat3,
}

/// The solution.
#[derive(Debug, Clone, PartialEq)]
pub struct TwistFit {
    /// EX EY EZ in mm, EA EB EC in rad.
    pub value: Vector6<f64>,
    /// Covariance of these.
    pub covariance: Matrix6<f64>,
    /// Sum of squared whitened residuals.
    pub chi2: f64,
    /// Equations minus unknowns.
    pub dof: usize,
    /// Whitened residuals, value minus fit.
    pub residuals: Vec<f64>,
}

/// The equations do not determine all six.
#[derive(Debug, Clone, PartialEq)]
pub struct Deficient {
    /// How many combinations they do determine.
    pub rank: usize,
    /// Combinations of the six that change no reading, orthonormal in columns of equal size.
    pub unobservable: Vec<Vector6<f64>>,
}

/// Singular values below this share of the largest count as zero: rounding of coordinates, not geometry.
const RANK_TOLERANCE: f64 = 1e-9;

/// Coefficients of the displacement of `point` along `direction`.
#[must_use]
pub fn design(direction: &Vec3, point: &Vec3) -> Vector6<f64> {
    // u . (eps x p) = eps . (p x u)
    let turn = point.cross(direction);
    Vector6::new(direction.x, direction.y, direction.z, turn.x, turn.y, turn.z)
}

impl Row {
    /// The displacement of `point` along `direction` was `value` mm, with standard deviation `sigma` mm.
    #[must_use]
    pub fn along(direction: &Vec3, point: &Vec3, value: f64, sigma: f64) -> Self {
        Self { design: design(direction, point) / sigma, value: value / sigma }
    }
}

/// Three whitened rows per sighting; the index of a sighting whose covariance cannot be inverted.
///
/// # Errors
/// A covariance that is not positive definite.
pub fn rows_of(sightings: &[Sighting]) -> Result<Vec<Row>, usize> {
    let mut rows = Vec::with_capacity(3 * sightings.len());
    for (i, s) in sightings.iter().enumerate() {
        let whiten = whitener(&s.covariance).ok_or(i)?;
        let value = whiten * s.displacement;
        for k in 0..3 {
            let direction = whiten.row(k).transpose();
            rows.push(Row { design: design(&direction, &s.point), value: value[k] });
        }
    }
    Ok(rows)
}

/// `L^-1` with `L L^T` the covariance.
fn whitener(covariance: &Mat3) -> Option<Mat3> {
    let l = covariance.cholesky()?.l();
    let inverse = l.try_inverse()?;
    inverse.iter().all(|v| v.is_finite()).then_some(inverse)
}

/// Least squares.
///
/// # Errors
/// What cannot be determined, where the rows leave a combination of the six free.
pub fn solve(rows: &[Row]) -> Result<TwistFit, Deficient> {
    let (design, scale) = equilibrated(rows);
    let n = rows.len();
    let svd = jacobi::svd(&design);
    let known: Vec<bool> = svd.values.iter().map(|s| *s > RANK_TOLERANCE * svd.values[0]).collect();
    let rank = known.iter().filter(|k| **k).count();
    if rank < 6 {
        let unobservable = (0..6)
            .filter(|k| !known[*k])
            .map(|k| Vector6::from_fn(|j, _| svd.v[(j, k)] * scale[j]))
            .collect();
        return Err(Deficient { rank, unobservable });
    }
    let value = DVector::from_iterator(n, rows.iter().map(|r| r.value));
    let mut scaled = svd.solve(&value, 0.0);
    // one refinement takes out the rounding of the first solution
    scaled += svd.solve(&(&value - &design * &scaled), 0.0);
    let residuals = &value - &design * &scaled;
    let covariance = Matrix6::from_fn(|i, j| svd.cofactor(i, j) * scale[i] * scale[j]);
    Ok(TwistFit {
        value: Vector6::from_fn(|i, _| scaled[i] * scale[i]),
        covariance,
        chi2: residuals.norm_squared(),
        dof: n - 6,
        residuals: residuals.iter().copied().collect(),
    })
}

/// The design with columns of unit length, and the factors that undo it.
fn equilibrated(rows: &[Row]) -> (DMatrix<f64>, Vector6<f64>) {
    let norm = Vector6::from_fn(|j, _| rows.iter().map(|r| r.design[j].powi(2)).sum::<f64>().sqrt());
    let scale = norm.map(|v| if v > 0.0 { 1.0 / v } else { 1.0 });
    let matrix = DMatrix::from_fn(rows.len(), 6, |i, j| rows[i].design[j] * scale[j]);
    (matrix, scale)
}

/// Moves the point at which EX EY EZ hold by `lever`: `d' = d + eps x lever`; with its covariance.
#[must_use]
pub fn moved(value: &Vector6<f64>, covariance: &Matrix6<f64>, lever: &Vec3) -> (Vector6<f64>, Matrix6<f64>) {
    let mut step = Matrix6::identity();
    // eps x lever = -[lever]x eps
    step.fixed_view_mut::<3, 3>(0, 3).copy_from(&-cross_matrix(lever));
    (step * value, step * covariance * step.transpose())
}

/// A combination of the six in words: which motion together with which turn changes no reading.
///
/// Parts below a hundredth of the largest of their kind are left out.
#[must_use]
pub fn words(v: &Vector6<f64>) -> String {
    let (d, eps) = (v.fixed_rows::<3>(0).into_owned(), v.fixed_rows::<3>(3).into_owned());
    let letters = |v: &Vec3, names: [&str; 3]| {
        let largest = v.amax();
        let parts: Vec<String> = (0..3)
            .filter(|i| v[*i].abs() > 0.01 * largest)
            .map(|i| format!("{:+.3} {}", v[i], names[i]))
            .collect();
        parts.join(" ")
    };
    if eps.norm() == 0.0 {
        return match d.try_normalize(0.0) {
            Some(direction) => format!("the displacement {}", letters(&direction, ["EX", "EY", "EZ"])),
            None => "none".to_owned(),
        };
    }
    let (axis, size) = (eps / eps.norm(), eps.norm());
    let turn = format!("the rotation {}", letters(&axis, ["EA", "EB", "EC"]));
    let shift = d / size;
    if shift.norm() < 1e-6 {
        return turn;
    }
    format!("{turn} together with {} mm per rad", letters(&shift, ["EX", "EY", "EZ"]))
}

/// `[v]x`: the matrix of the cross product `v x`.
pub(crate) fn cross_matrix(v: &Vec3) -> Mat3 {
    Mat3::new(0.0, -v.z, v.y, v.z, 0.0, -v.x, -v.y, v.x, 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sightings(points: &[[f64; 3]], truth: &Vector6<f64>) -> Vec<Sighting> {
        let (d, eps) = (Vec3::new(truth[0], truth[1], truth[2]), Vec3::new(truth[3], truth[4], truth[5]));
        points
            .iter()
            .map(|p| {
                let point = Vec3::from(*p);
                Sighting { point, displacement: d + eps.cross(&point), covariance: Mat3::identity() * 1e-6 }
            })
            .collect()
    }

    #[test]
    fn exact_displacements_give_the_six_back_and_the_lever_moves_them() {
        let truth = Vector6::new(0.01, -0.02, 0.003, 3e-5, -1e-5, 8e-5);
        let points = [[100.0, 0.0, 5.0], [-80.0, 90.0, 0.0], [0.0, -70.0, 60.0]];
        let fit = solve(&rows_of(&sightings(&points, &truth)).unwrap()).unwrap();
        assert!((fit.value - truth).norm() < 1e-15 && fit.dof == 3 && fit.chi2 < 1e-18);
        let lever = Vec3::new(0.0, 1000.0, 0.0);
        let (there, covariance) = moved(&fit.value, &fit.covariance, &lever);
        assert!((there[0] - (0.01 - 8e-5 * 1000.0)).abs() < 1e-14);
        assert!((there[2] - (0.003 + 3e-5 * 1000.0)).abs() < 1e-14);
        assert!(covariance[(0, 0)] > fit.covariance[(0, 0)]);
        let (back, again) = moved(&there, &covariance, &-lever);
        assert!((back - truth).norm() < 1e-14 && (again - fit.covariance).norm() < 1e-14);
    }

    #[test]
    fn two_points_leave_the_turn_about_their_line() {
        let rows = rows_of(&sightings(&[[0.0, 0.0, 0.0], [0.0, 0.0, 300.0]], &Vector6::zeros())).unwrap();
        let deficient = solve(&rows).unwrap_err();
        assert_eq!(deficient.rank, 5);
        let free = deficient.unobservable[0];
        assert!(free[5].abs() > 1e3 * (free.norm() - free[5].abs()).abs(), "{free}");
        assert_eq!(solve(&rows[..3]).unwrap_err().rank, 3);
        assert_eq!(solve(&[]).unwrap_err().rank, 0);
    }
}
