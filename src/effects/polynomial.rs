//! Legendre polynomials, and what angular errors are made of.

use crate::shape::WIDTH_MAX;

/// `P_0(s)` to `P_n(s)`, as many as `values` holds.
pub fn legendre(s: f64, values: &mut [f64]) {
    for k in 0..values.len() {
        values[k] = match k {
            0 => 1.0,
            1 => s,
            _ => {
                let n = k as f64;
                ((2.0 * n - 1.0) * s * values[k - 1] - (n - 1.0) * values[k - 2]) / n
            }
        };
    }
}

/// Highest degree, at most `most`, of a least-squares polynomial whose standard deviation between ascending `positions` is nowhere
/// more than [`LEAST_CERTAIN`] times that of a single value at one of them. Where there are few, or wide gaps, one of a higher degree fits the values and swings
/// in between; of evenly spaced ones the degree grows with the root of their number.
///
/// The variance of the fitted value is `K(s) = SUM q_k(s)^2` of that of a value (Christoffel function), q_k the polynomials
/// orthonormal over the positions (Stieltjes).
#[must_use]
pub(crate) fn stable_degree(positions: &[f64], most: usize) -> usize {
    let [Some(&low), Some(&high)] = [positions.first(), positions.last()] else { return 0 };
    if low >= high {
        return 0;
    }
    let scaled = |x: f64| (2.0 * x - low - high) / (high - low);
    let mut nodes: Vec<Orthonormal> = positions.iter().map(|x| Orthonormal::at(scaled(*x))).collect();
    let between = positions.windows(2).map(|w| 0.5 * (w[0] + w[1])).chain([low, high]);
    let mut grid: Vec<Orthonormal> = between.map(|x| Orthonormal::at(scaled(x))).collect();
    let norm = (nodes.len() as f64).sqrt();
    let mut scale = norm;
    for degree in 0..=most {
        let centre = nodes.iter().map(|p| p.s * (p.next / scale).powi(2)).sum::<f64>();
        for p in nodes.iter_mut().chain(&mut grid) {
            p.advance(scale, centre);
        }
        if scale < RANK * norm || grid.iter().any(|p| p.variance > LEAST_CERTAIN * LEAST_CERTAIN) {
            return degree.saturating_sub(1);
        }
        scale = nodes.iter().map(|p| p.next * p.next).sum::<f64>().sqrt();
    }
    most
}

/// Standard deviation of a curve between positions, in those of a value: beyond it an error of a value returns there enlarged. One:
/// a table of 21 targets loses the degrees from 10; ten: corrections swing by several times the effect.
const LEAST_CERTAIN: f64 = 3.0;
/// Norms below this share of that of a constant are those of polynomials that vanish at all positions.
const RANK: f64 = 1e-10;

/// The recurrence of orthonormal polynomials at one place.
struct Orthonormal {
    s: f64,
    /// The polynomial of the present degree, and the next one before it is normalised.
    now: f64,
    next: f64,
    /// Sum of the squares so far.
    variance: f64,
}

impl Orthonormal {
    const fn at(s: f64) -> Self {
        Self { s, now: 0.0, next: 1.0, variance: 0.0 }
    }

    /// Normalises the next polynomial by its norm `scale`, and forms the one after it: `(s - centre) q_k - scale q_(k-1)`.
    fn advance(&mut self, scale: f64, centre: f64) {
        let now = self.next / scale;
        self.variance += now * now;
        self.next = (self.s - centre) * now - scale * self.now;
        self.now = now;
    }
}

/// The functions of a position that make up an angular error, all zero at the zero of its axis: `x/half`, then Legendre
/// polynomials about the middle of the data less their value at zero, held beyond the data; powers of `x/half` where no
/// middle is given.
pub fn twist(x_mm: f64, half_mm: f64, centre_mm: Option<f64>, values: &mut [f64]) {
    let Some(centre_mm) = centre_mm else {
        let mut power = 1.0;
        for v in values {
            power *= x_mm / half_mm;
            *v = power;
        }
        return;
    };
    let degree = values.len();
    let at = |x: f64| {
        let mut p = [0.0; WIDTH_MAX + 1];
        legendre(((x - centre_mm) / half_mm).clamp(-1.2, 1.2), &mut p[..=degree]);
        p
    };
    let (here, zero) = (at(x_mm), at(0.0));
    for (k, v) in values.iter_mut().enumerate() {
        *v = if k == 0 { x_mm / half_mm } else { here[k + 1] - zero[k + 1] };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Highest variance between the positions of a least-squares polynomial, by the normal equations of Legendre polynomials.
    fn variance_between(positions: &[f64], degree: usize) -> f64 {
        let (low, high) = (positions[0], positions[positions.len() - 1]);
        let row = |x: f64| {
            let mut p = vec![0.0; degree + 1];
            legendre((2.0 * x - low - high) / (high - low), &mut p);
            nalgebra::DVector::from_vec(p)
        };
        let normal = positions
            .iter()
            .fold(nalgebra::DMatrix::zeros(degree + 1, degree + 1), |n, x| n + row(*x) * row(*x).transpose());
        let inverse = normal.try_inverse().unwrap();
        let at = |x: f64| (row(x).transpose() * &inverse * row(x))[(0, 0)];
        positions.windows(2).map(|w| at(0.5 * (w[0] + w[1]))).fold(at(low).max(at(high)), f64::max)
    }

    #[test]
    fn a_stable_degree_is_the_highest_that_does_not_swing_between_the_positions() {
        let even = |n: u32| (0..n).map(|i| f64::from(i) * 25.0).collect::<Vec<f64>>();
        let gap =
            |n: u32| (0..n).map(|i| f64::from(i) + if i > n / 2 { 500.0 } else { 0.0 }).collect::<Vec<f64>>();
        for positions in [even(5), even(11), even(21), even(41), gap(41)] {
            let degree = stable_degree(&positions, 20);
            assert!(variance_between(&positions, degree) <= 9.0 + 1e-6, "{} {degree}", positions.len());
            if degree + 2 < positions.len() && degree < 20 {
                assert!(
                    variance_between(&positions, degree + 1) > 9.0 - 1e-6,
                    "{} {degree}",
                    positions.len()
                );
            }
        }
        let of_even = [5, 11, 21, 41, 101].map(|n| stable_degree(&even(n), 20));
        assert!(of_even.is_sorted() && of_even[0] >= 2 && of_even[1] < 9 && of_even[4] == 20, "{of_even:?}");
        assert!(stable_degree(&gap(41), 20) < 8);
        assert_eq!((stable_degree(&[], 20), stable_degree(&[3.0, 3.0], 20)), (0, 0));
    }

    #[test]
    fn the_first_four_by_their_formulas() {
        for s in [-1.0, -0.3, 0.0, 0.7, 1.0] {
            let mut p = [0.0; 4];
            legendre(s, &mut p);
            assert!((p[2] - 0.5 * (3.0 * s * s - 1.0)).abs() < 1e-14);
            assert!((p[3] - 0.5 * (5.0 * s * s * s - 3.0 * s)).abs() < 1e-14);
        }
    }

    #[test]
    fn an_angle_is_zero_at_the_zero_of_its_axis_and_held_beyond_the_data() {
        for centre in [Some(250.0), Some(-40.0), None] {
            let mut v = [1.0; 8];
            twist(0.0, 240.0, centre, &mut v);
            assert!(v.iter().all(|v| v.abs() < 1e-14), "{centre:?}: {v:?}");
        }
        let (mut a, mut b) = ([0.0; 4], [0.0; 4]);
        twist(600.0, 200.0, Some(250.0), &mut a);
        twist(900.0, 200.0, Some(250.0), &mut b);
        assert_eq!((a[0], b[0]), (3.0, 4.5));
        assert_eq!(a[1..], b[1..]);
        // additions of before: powers
        twist(100.0, 200.0, None, &mut a);
        assert_eq!(a, [0.5, 0.25, 0.125, 0.0625]);
    }
}
