//! Motion on a circle: velocity, acceleration and reversals of each axis from the angle of its samples.
//!
//! Differences of coordinates are least certain at the vertices, where an axis turns round between two samples. The angle has no
//! vertex, so any number of samples per turn and any phase to the quadrants serve.

use core::f64::consts::{PI, TAU};

use nalgebra::{Matrix3, SymmetricEigen};
use volcomp_model::geometry::Vec3;

use super::super::constants::{ARC, BEND, ON_CIRCLE};
use super::motion::{self, MOVED, Sample, Travel};

/// A run along a circle in any plane of the linear axes.
#[derive(Debug, Clone)]
pub(super) struct Circle {
    /// Radius times the unit vectors of the plane, mm.
    cosine: Vec3,
    sine: Vec3,
    radius: f64,
    /// Angle of each sample, rad, without jumps.
    angle: Vec<f64>,
    /// Its first and second derivative, rad/s, rad/s^2.
    rate: Vec<f64>,
    gain: Vec<f64>,
}

/// One axis on a circle: `cosine cos(angle) + sine sin(angle)` from the centre, mm.
#[derive(Debug, Clone, Copy)]
pub(super) struct Component<'a> {
    circle: &'a Circle,
    cosine: f64,
    sine: f64,
}

impl Circle {
    /// The circle through the samples, whose places are in mm; `None` where they leave it, see less than a quadrant, or
    /// are so far apart that the way between them is not known.
    pub(super) fn of(samples: &[Sample], places: &[Vec3]) -> Option<Self> {
        let count = places.len() as f64;
        let mean = places.iter().sum::<Vec3>() / count;
        let scatter: Matrix3<f64> =
            places.iter().map(|p| (p - mean) * (p - mean).transpose()).sum::<Matrix3<f64>>() / count;
        let eigen = SymmetricEigen::new(scatter);
        let normal = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned();
        let first = eigen.eigenvectors.column(eigen.eigenvalues.imax()).into_owned();
        let second = normal.cross(&first);
        let size = eigen.eigenvalues.max().sqrt();
        if size <= MOVED {
            return None;
        }
        // Kasa: linear in the centre and in radius^2 - centre^2
        let flat: Vec<[f64; 2]> =
            places.iter().map(|p| [(p - mean).dot(&first) / size, (p - mean).dot(&second) / size]).collect();
        let (mut normal_matrix, mut right) = (Matrix3::zeros(), Vec3::zeros());
        for [a, b] in &flat {
            let row = Vec3::new(2.0 * a, 2.0 * b, 1.0);
            normal_matrix += row * row.transpose();
            right += row * (a * a + b * b);
        }
        let solved = normal_matrix.try_inverse()? * right;
        let radius = (solved.z + solved.x.powi(2) + solved.y.powi(2)).sqrt();
        let stays = |(p, [a, b]): (&Vec3, &[f64; 2])| {
            let across = (p - mean).dot(&normal) / size;
            let along = (a - solved.x).hypot(b - solved.y) - radius;
            along.abs().max(across.abs()) <= ON_CIRCLE * radius
        };
        if !places.iter().zip(&flat).all(stays) {
            return None;
        }
        let mut angle: Vec<f64> = flat.iter().map(|[a, b]| (b - solved.y).atan2(a - solved.x)).collect();
        for k in 1..angle.len() {
            let step = (angle[k] - angle[k - 1] + PI).rem_euclid(TAU) - PI;
            if step.abs() > BEND {
                return None;
            }
            angle[k] = angle[k - 1] + step;
        }
        let extent = |of: fn(f64, f64) -> f64, from: f64| angle.iter().copied().fold(from, of);
        if extent(f64::max, f64::NEG_INFINITY) - extent(f64::min, f64::INFINITY) < ARC {
            return None;
        }
        let radius = radius * size;
        let (rate, gain) = rates(samples, &angle, radius, motion::resolution_of(places));
        Some(Self { cosine: first * radius, sine: second * radius, radius, angle, rate, gain })
    }

    /// The part of a linear axis, by its place; `None` for one that does not take part.
    pub(super) fn component(&self, slot: usize) -> Option<Component<'_>> {
        let [cosine, sine] = [self.cosine[slot], self.sine[slot]];
        (cosine.hypot(sine) > ON_CIRCLE * self.radius).then_some(Component { circle: self, cosine, sine })
    }
}

/// Derivatives of the angle: a constant feed where it explains all times but for their rounding, else differences.
fn rates(samples: &[Sample], angle: &[f64], radius: f64, resolution: f64) -> (Vec<f64>, Vec<f64>) {
    let n = samples.len() as f64;
    let [mean_t, mean_angle] = [samples.iter().map(|s| s.t).sum::<f64>() / n, angle.iter().sum::<f64>() / n];
    let pairs = || samples.iter().zip(angle).map(|(s, a)| (s.t - mean_t, a - mean_angle));
    let [product, square] = pairs().fold([0.0; 2], |[p, q], (t, a)| [p + t * a, q + a * a]);
    let slope = product / square;
    let times: Vec<f64> = samples.iter().map(|s| s.t).collect();
    if slope != 0.0 && pairs().all(|(t, a)| (t - slope * a).abs() <= motion::resolution(&times)) {
        return (vec![1.0 / slope; samples.len()], vec![0.0; samples.len()]);
    }
    let arc: Vec<f64> = angle.iter().map(|a| a * radius).collect();
    let (mut rate, mut gain) = motion::derivatives_to(samples, &arc, resolution);
    rate.iter_mut().chain(&mut gain).for_each(|v| *v /= radius);
    (rate, gain)
}

impl Component<'_> {
    /// Velocity and acceleration at each sample, mm/s, mm/s^2.
    pub(super) fn derivatives(&self) -> (Vec<f64>, Vec<f64>) {
        let c = self.circle;
        let of = |k: usize| {
            let (sine, cosine) = c.angle[k].sin_cos();
            let (radial, tangent) =
                (self.cosine * cosine + self.sine * sine, self.sine * cosine - self.cosine * sine);
            (tangent * c.rate[k], tangent * c.gain[k] - radial * c.rate[k].powi(2))
        };
        (0..c.angle.len()).map(of).unzip()
    }

    /// Distance from the centre along the axis, mm.
    fn position(&self, angle: f64) -> f64 {
        self.cosine * angle.cos() + self.sine * angle.sin()
    }

    /// The vertex nearest to an angle, where the axis turns round.
    fn vertex(&self, angle: f64) -> f64 {
        let first = self.sine.atan2(self.cosine);
        first + ((angle - first) / PI).round() * PI
    }

    /// Follows the axis; `given` are directions that the file states. At a vertex an axis has not turned yet.
    pub(super) fn travel(&self, samples: &[Sample], given: Option<&[f64]>) -> Travel {
        let (c, n) = (self.circle, samples.len());
        let mut t = Travel::unknown(n);
        if given.is_some_and(|g| g.iter().all(|d| *d == 0.0)) {
            return t;
        }
        let way = |k: usize| {
            let (from, to) = if k == 0 { (0, 1) } else { (k - 1, k) };
            (c.angle[to] - c.angle[from]).signum()
        };
        // none at a vertex, and none where the run pauses
        let at = |k: usize| {
            let vertex = self.vertex(c.angle[k]);
            let is_vertex = (self.position(c.angle[k]) - self.position(vertex)).abs() <= MOVED;
            let tangent = self.sine * c.angle[k].cos() - self.cosine * c.angle[k].sin();
            let moves = k == 0 || (c.angle[k] - c.angle[k - 1]).abs() * c.radius > MOVED;
            (!is_vertex && moves).then(|| tangent.signum() * way(k))
        };
        let (mut since, mut start) = (f64::INFINITY, f64::NEG_INFINITY);
        let stated = |k: usize| given.map(|g| g[k]).filter(|d| *d != 0.0 && d.is_finite()).map(f64::signum);
        let mut direction = stated(0).or_else(|| (0..n).find_map(at)).unwrap_or(0.0);
        for k in 0..n {
            let now = stated(k).or_else(|| at(k)).unwrap_or(direction);
            let before = k.saturating_sub(1);
            if now != direction && direction != 0.0 {
                let [low, high] = [c.angle[before].min(c.angle[k]), c.angle[before].max(c.angle[k])];
                let vertex = self.vertex(c.angle[k]);
                // a run that goes back the same way turns round at its last sample
                let turn = if (low..=high).contains(&vertex) { vertex } else { c.angle[before] };
                let share = (turn - c.angle[before]) / (c.angle[k] - c.angle[before]);
                let share = if share.is_finite() { share } else { 1.0 };
                start = samples[before].t + share * (samples[k].t - samples[before].t);
                since = (self.position(c.angle[k]) - self.position(turn)).abs();
            } else if k > 0 {
                since += (self.position(c.angle[k]) - self.position(c.angle[before])).abs();
            }
            direction = now;
            (t.direction[k], t.since[k], t.since_s[k]) = (direction, since, samples[k].t - start);
        }
        t
    }
}
