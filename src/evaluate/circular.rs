//! ISO 230-4: circular error G and radial error F from a circular test.
//!
//! The path is `radius + deviation` at its angle. Centring takes out where the instrument stood: the centre is that
//! of the geometric least-squares circle (orthogonal distances, Gauss-Newton). `G` = range of the distances from
//! that centre; `F` = distance minus nominal radius. G of one direction uses the centre of its own path; G of both
//! directions and F use the common centre.
//!
//! Without a nominal radius the distances are linear in the eccentricity (`dev = r0 + a cos + b sin`), which for an
//! eccentricity `e` is short by `e^2/(2 radius)`: 0.03 um for 0.1 mm on 150 mm.
//!
//! Source: ISO 230-4:2022, clause 3 (2005: "deviation" for "error"); `docs/reference/json-output.md` 3.

use core::f64::consts::TAU;

use nalgebra::{Matrix3, Vector3};

use volcomp_model::geometry::largest_gap;
use volcomp_model::statistics::hull;
use volcomp_units::axes::Travel;

/// One reading on the circle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CircularReading {
    /// Angle on the circle, rad; may run over more than one turn.
    pub angle: f64,
    /// Radial deviation.
    pub deviation: f64,
    /// Sense of travel: forward counter-clockwise (+1), reverse clockwise (-1).
    pub travel: Travel,
}

/// How the centre is found.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Centring {
    /// Geometric least-squares circle; `radius` in the unit of the deviations makes it exact.
    LeastSquares {
        /// Nominal radius.
        radius: Option<f64>,
    },
    /// The instrument's own centre.
    #[default]
    None,
}

/// The result of a circular test, in the unit of the deviations.
#[derive(Debug, Clone, PartialEq)]
pub struct Circularity {
    /// Circular error of the forward path.
    pub g_forward: Option<f64>,
    /// Circular error of the backward path.
    pub g_backward: Option<f64>,
    /// Circular error of both paths about their common centre.
    pub g_both: Option<f64>,
    /// Largest radial error.
    pub f_max: f64,
    /// Smallest radial error.
    pub f_min: f64,
    /// Common centre taken out.
    pub centre: [f64; 2],
    /// Radial error of every reading about the common centre, in the order of the readings.
    pub radial: Vec<f64>,
}

/// Why a test cannot be evaluated.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum CircularError {
    /// Too few readings.
    #[error("{found} of at least {needed} readings in one direction that a circle needs")]
    TooFewReadings {
        /// Readings found.
        found: usize,
        /// Readings needed.
        needed: usize,
    },
    /// A reading that is no number.
    #[error("reading {row} is not finite")]
    NotFinite {
        /// 1-based reading.
        row: usize,
    },
    /// An arc cannot be centred.
    #[error(
        "the path has a gap of {gap_deg:.0} deg; a circle with a gap above {limit_deg:.0} deg cannot be centred, evaluate it with the instrument's own centre (--centring none)"
    )]
    Arc {
        /// Largest gap, degrees.
        gap_deg: f64,
        /// Largest gap allowed, degrees.
        limit_deg: f64,
    },
    /// The radius is none or smaller than the deviations.
    #[error("radius {radius} is not above the largest deviation {deviation}; is its unit right?")]
    Radius {
        /// The radius.
        radius: f64,
        /// Largest absolute deviation.
        deviation: f64,
    },
}

/// Fewest readings per direction.
pub const READINGS_NEEDED: usize = 8;
/// Largest gap in angle that can be centred, rad.
const GAP_LIMIT: f64 = TAU / 4.0;

impl Circularity {
    /// The widest of a circular test.
    #[must_use]
    pub fn widest(&self) -> f64 {
        self.g_both.or(self.g_forward).or(self.g_backward).unwrap_or(0.0)
    }

    /// About the least-squares circle of this nominal radius (mm); an arc, which cannot be centred so, about `offset` (mm).
    ///
    /// # Errors
    /// See [`Self::evaluate`].
    pub fn about(readings: &[CircularReading], radius: f64, offset: [f64; 2]) -> Result<Self, CircularError> {
        Self::evaluate(readings, Centring::LeastSquares { radius: Some(radius) }).or_else(|_| {
            let off = |a: f64| offset[0] * a.cos() + offset[1] * a.sin();
            let about = |r: &CircularReading| CircularReading { deviation: r.deviation - off(r.angle), ..*r };
            Self::evaluate(&readings.iter().map(about).collect::<Vec<_>>(), Centring::None)
        })
    }

    /// Evaluates a test.
    ///
    /// # Errors
    /// Fewer than 8 readings in a direction, an arc that cannot be centred, a radius that is none.
    pub fn evaluate(readings: &[CircularReading], centring: Centring) -> Result<Self, CircularError> {
        if let Some(i) = readings.iter().position(|r| !(r.angle.is_finite() && r.deviation.is_finite())) {
            return Err(CircularError::NotFinite { row: i + 1 });
        }
        let of = |travel: Travel| {
            readings.iter().filter(|r| r.travel == travel).copied().collect::<Vec<CircularReading>>()
        };
        let (forward, backward) = (of(Travel::Forward), of(Travel::Reverse));
        let g = |path: &[CircularReading]| -> Result<Option<f64>, CircularError> {
            if path.is_empty() {
                return Ok(None);
            }
            let centred = centred(path, centring)?;
            Ok(Some(centred.largest - centred.smallest))
        };
        let (g_forward, g_backward) = (g(&forward)?, g(&backward)?);
        let all = centred(readings, centring)?;
        Ok(Self {
            g_forward,
            g_backward,
            g_both: (g_forward.is_some() && g_backward.is_some()).then_some(all.largest - all.smallest),
            f_max: all.largest,
            f_min: all.smallest,
            centre: all.centre,
            radial: readings.iter().map(|r| residual(r, all.centre, radius_of(centring)).0).collect(),
        })
    }
}

const fn radius_of(centring: Centring) -> Option<f64> {
    match centring {
        Centring::None => None,
        Centring::LeastSquares { radius } => radius,
    }
}

struct Centred {
    largest: f64,
    smallest: f64,
    centre: [f64; 2],
}

/// Distances from the centre minus the nominal radius: their extremes.
fn centred(path: &[CircularReading], centring: Centring) -> Result<Centred, CircularError> {
    if path.len() < READINGS_NEEDED {
        return Err(CircularError::TooFewReadings { found: path.len(), needed: READINGS_NEEDED });
    }
    let radius = radius_of(centring);
    let largest = path.iter().fold(0.0f64, |m, r| m.max(r.deviation.abs()));
    if let Some(radius) = radius
        && !(radius.is_finite() && radius > largest)
    {
        return Err(CircularError::Radius { radius, deviation: largest });
    }
    let centre = match centring {
        Centring::None => [0.0; 2],
        Centring::LeastSquares { .. } => {
            let gap = largest_gap(path.iter().map(|r| r.angle));
            if gap > GAP_LIMIT {
                let (gap_deg, limit_deg) = (gap.to_degrees(), GAP_LIMIT.to_degrees());
                return Err(CircularError::Arc { gap_deg, limit_deg });
            }
            find_centre(path, radius)
        }
    };
    let [smallest, largest] = hull(path.iter().map(|r| residual(r, centre, radius).0));
    Ok(Centred { largest, smallest, centre })
}

/// Radial deviation about `centre`, and the unit vector from the centre to the reading.
fn residual(r: &CircularReading, [cx, cy]: [f64; 2], radius: Option<f64>) -> (f64, f64, f64) {
    let (sin, cos) = r.angle.sin_cos();
    let Some(radius) = radius else { return (r.deviation - cx * cos - cy * sin, cos, sin) };
    let (x, y) = ((radius + r.deviation) * cos - cx, (radius + r.deviation) * sin - cy);
    let distance = x.hypot(y);
    (distance - radius, x / distance, y / distance)
}

/// Gauss-Newton on centre and radius; one step where the problem is linear.
fn find_centre(path: &[CircularReading], radius: Option<f64>) -> [f64; 2] {
    let mut centre = [0.0; 2];
    for _ in 0..20 {
        let mut normal = Matrix3::zeros();
        let mut right = Vector3::zeros();
        for r in path {
            let (d, ux, uy) = residual(r, centre, radius);
            let row = Vector3::new(ux, uy, 1.0);
            normal += row * row.transpose();
            right += row * d;
        }
        let Some(step) = normal.cholesky().map(|c| c.solve(&right)) else { break };
        centre = [centre[0] + step.x, centre[1] + step.y];
        if step.x.hypot(step.y) <= 1e-12 * right.norm().max(centre[0].hypot(centre[1])) {
            break;
        }
    }
    centre
}

#[cfg(test)]
mod tests {
    use super::*;

    fn circle(travel: Travel, deviation: impl Fn(f64) -> f64) -> Vec<CircularReading> {
        (0..720)
            .map(|i| f64::from(i).to_radians() / 2.0)
            .map(|angle| CircularReading { angle, deviation: deviation(angle), travel })
            .collect()
    }

    const GEOMETRIC: Centring = Centring::LeastSquares { radius: Some(150_000.0) };

    #[test]
    fn an_eccentric_perfect_circle_has_no_deviation() {
        let (radius, ex, ey) = (150_000.0f64, 300.0f64, -200.0f64);
        // distance of the circle about (ex, ey) seen from the origin
        let seen = |t: f64| {
            let along = ex * t.cos() + ey * t.sin();
            along + (radius * radius - (ex * ex + ey * ey) + along * along).sqrt() - radius
        };
        let c = Circularity::evaluate(&circle(Travel::Forward, seen), GEOMETRIC).unwrap();
        assert!(c.g_forward.unwrap() < 1e-6, "{c:?}");
        assert!((c.centre[0] - ex).abs() < 1e-6 && (c.centre[1] - ey).abs() < 1e-6);
        assert!(c.f_max.abs() < 1e-6);
        let rough = Centring::LeastSquares { radius: None };
        let rough = Circularity::evaluate(&circle(Travel::Forward, seen), rough).unwrap();
        assert!(rough.g_forward.unwrap() < 2.0 * (ex * ex + ey * ey) / (2.0 * radius));
    }

    #[test]
    fn squareness_gives_an_ellipse_of_known_size() {
        // dev = -theta R sin cos: range theta R
        let c = Circularity::evaluate(
            &circle(Travel::Reverse, |t| 2.0 - 10.0 * t.sin() * t.cos()),
            Centring::LeastSquares { radius: None },
        )
        .unwrap();
        assert!((c.g_backward.unwrap() - 10.0).abs() < 1e-9);
        assert!((c.f_max - 7.0).abs() < 1e-9 && (c.f_min + 3.0).abs() < 1e-9);
        assert_eq!((c.g_forward, c.g_both), (None, None));
    }

    #[test]
    fn two_directions_share_a_centre() {
        let mut both = circle(Travel::Forward, |t| 5.0 + 3.0 * (2.0 * t).cos());
        both.extend(circle(Travel::Reverse, |t| -5.0 + 3.0 * (2.0 * t).cos()));
        let c = Circularity::evaluate(&both, Centring::LeastSquares { radius: None }).unwrap();
        assert!((c.g_forward.unwrap() - 6.0).abs() < 1e-9);
        assert!((c.g_both.unwrap() - 16.0).abs() < 1e-9);
    }

    #[test]
    fn arcs_and_nonsense_are_refused() {
        let arc: Vec<_> = circle(Travel::Forward, |_| 1.0).into_iter().take(360).collect();
        assert!(matches!(Circularity::evaluate(&arc, GEOMETRIC).unwrap_err(), CircularError::Arc { .. }));
        assert!(Circularity::evaluate(&arc, Centring::None).is_ok());
        assert_eq!(
            Circularity::evaluate(&arc[..7], Centring::None).unwrap_err(),
            CircularError::TooFewReadings { found: 7, needed: 8 }
        );
        let wrong_unit = Centring::LeastSquares { radius: Some(0.15) };
        let full = circle(Travel::Forward, |_| 1.0);
        assert!(matches!(
            Circularity::evaluate(&full, wrong_unit).unwrap_err(),
            CircularError::Radius { .. }
        ));
    }
}
