//! Which periodic errors a set of positions takes for slower ones: its spectral window.

use core::f64::consts::TAU;

/// Share of a wave below which it passes for a slower one.
const ALIASED: f64 = 0.1;
/// Slower waves that are tried per wave over the range.
const DENSITY: f64 = 8.0;
/// Positions looked at: of more, as many in the middle.
const POSITIONS_MAX: usize = 200;
/// Share of a column below which it is a combination of others.
const DEPENDENT: f64 = 1e-6;

/// Some positions with the waves that they show without doubt: those longer than two mean distances.
#[derive(Debug, Clone)]
pub struct SpectralWindow {
    positions: Vec<f64>,
    span: f64,
    /// Orthonormal columns of constant, slope and a wave, with the frequency of the wave, ascending from 0 (none).
    slower: Vec<(f64, Vec<Vec<f64>>)>,
}

impl SpectralWindow {
    /// The window of distinct `positions` in ascending order.
    #[must_use]
    pub fn new(positions: &[f64]) -> Self {
        let first = positions.len().saturating_sub(POSITIONS_MAX) / 2;
        let positions = positions[first..positions.len().min(first + POSITIONS_MAX)].to_vec();
        let span = positions.last().zip(positions.first()).map_or(0.0, |(b, a)| b - a);
        let shown = 0.5 * positions.len().saturating_sub(1) as f64;
        let count = if span > 0.0 { (DENSITY * shown + 1e-9) as usize } else { 0 };
        let mut line = Vec::new();
        add(&mut line, vec![1.0; positions.len()]);
        add(&mut line, positions.clone());
        let with = |k: usize| {
            let frequency = k as f64 / (DENSITY * span);
            let mut basis = line.clone();
            if k > 0 {
                wave(&positions, frequency).into_iter().for_each(|column| add(&mut basis, column));
            }
            (frequency, basis)
        };
        let slower = (0..=count).map(with).collect();
        Self { positions, span, slower }
    }

    /// Share of the mean square of a wave, at its least favourable phase, that constant, slope and any one slower wave leave.
    #[must_use]
    pub fn share_left(&self, period: f64) -> f64 {
        if self.span <= 0.0 || period <= 0.0 {
            return 0.0;
        }
        let own = wave(&self.positions, 1.0 / period);
        let whole = products(&own);
        let resolved = 1.0 / period - 1.0 / self.span;
        let shares = self.slower.iter().take_while(|(f, _)| *f <= resolved.max(0.0)).map(|(_, basis)| {
            let left = own.clone().map(|column| beside(basis, column));
            least_share(products(&left), whole)
        });
        shares.fold(1.0, f64::min)
    }

    /// True where a wave of this period looks like a slower one, or vanishes at all positions.
    #[must_use]
    pub fn is_aliased(&self, period: f64) -> bool {
        self.share_left(period) < ALIASED
    }
}

fn wave(positions: &[f64], frequency: f64) -> [Vec<f64>; 2] {
    let phases = positions.iter().map(|x| (TAU * (x * frequency).fract()).sin_cos());
    let (sin, cos) = phases.unzip();
    [cos, sin]
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

/// `[a.a, a.b, b.b]`
fn products([a, b]: &[Vec<f64>; 2]) -> [f64; 3] {
    [dot(a, a), dot(a, b), dot(b, b)]
}

/// A column without what an orthonormal basis says of it.
fn beside(basis: &[Vec<f64>], mut column: Vec<f64>) -> Vec<f64> {
    for b in basis {
        let p = dot(b, &column);
        column.iter_mut().zip(b).for_each(|(c, b)| *c -= p * b);
    }
    column
}

fn add(basis: &mut Vec<Vec<f64>>, column: Vec<f64>) {
    let before = dot(&column, &column).sqrt();
    // twice, for rounding
    let mut column = beside(basis, beside(basis, column));
    let own = dot(&column, &column).sqrt();
    if own > DEPENDENT * before {
        column.iter_mut().for_each(|c| *c /= own);
        basis.push(column);
    }
}

/// Smallest root of `|left - share whole| = 0`; 0 where some phase of the whole vanishes.
fn least_share([a, b, c]: [f64; 3], [p, q, r]: [f64; 3]) -> f64 {
    let determinant = p * r - q * q;
    if determinant <= DEPENDENT * (p + r) * (p + r) {
        return 0.0;
    }
    let sum = a * r + c * p - 2.0 * b * q;
    let product = (a * c - b * b).max(0.0);
    let root = (sum * sum - 4.0 * determinant * product).max(0.0).sqrt();
    if sum > 0.0 { 2.0 * product / (sum + root) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_distances_alias_what_unequal_ones_show() {
        let equal: Vec<f64> = (0..21).map(|i| 20.0 * f64::from(i) + 3.3).collect();
        let unequal: Vec<f64> =
            (0..21).map(|i| equal[i] + 20.0 * (i * i * 7919 % 1009) as f64 / 1009.0).collect();
        let (equal, unequal) = (SpectralWindow::new(&equal), SpectralWindow::new(&unequal));
        for period in [2.0, 5.0, 6.0, 8.0, 10.0, 12.0, 16.0, 20.0, 30.0, 40.0] {
            assert!(equal.share_left(period) < 0.03, "{period}: {}", equal.share_left(period));
            assert!(!unequal.is_aliased(period), "{period}: {}", unequal.share_left(period));
        }
        // what two positions per wave show
        for window in [&equal, &unequal] {
            assert!([50.0, 80.0, 160.0].iter().all(|p| !window.is_aliased(*p)));
        }
        assert!(SpectralWindow::new(&[]).is_aliased(10.0) && SpectralWindow::new(&[1.0]).is_aliased(10.0));
    }

    #[test]
    fn a_fine_line_over_three_waves_shows_them_and_over_a_part_of_one_does_not() {
        let fine: Vec<f64> = (0..25).map(|i| 0.625 * f64::from(i)).collect();
        let window = SpectralWindow::new(&fine);
        assert!(window.share_left(5.0) > 0.8);
        assert!(window.is_aliased(60.0));
    }
}
