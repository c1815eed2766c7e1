//! Weighted linear least squares over cells: a triangular factor that serves every leading set of columns at once.
//!
//! `W A = Q R`, `z = Q^T W y`: the first `k` columns have the coefficients `R_k^-1 z_k`, residuals `y - Q_k z_k` and
//! leverages `|q_k|^2`. Few cells are factored by Householder reflections. Many are gathered in `A^T A`, which needs
//! no memory per row: the bases have conditions below 10 where targets are spread sensibly, and where the
//! pivots show more than [`GRAM_CONDITION`], the reflections do it after all.

use nalgebra::{DMatrix, DVector};

use super::basis::{Shape, chebyshev};
use super::data::{Cell, Data};
use super::error::CONDITION_LIMIT;
use super::lanes::{LANES, Lane, add_chebyshev, blocks, chebyshev_lanes, shared_out};
use super::request::Basis;

/// Up to this many cells the orthogonal factor is kept.
const FEW: usize = 128;
/// Condition (by pivots) up to which `A^T A` is trusted: its square costs four digits.
const GRAM_CONDITION: f64 = 1e2;
/// Pivots up to which the solution from `A^T A` has lost nothing that a step of refinement could bring back.
const WELL_CONDITIONED: f64 = 10.0;
/// Pivots closer than this need no singular values to be called sound.
const SOUND_PIVOTS: f64 = 1e3;

/// The columns of one least-squares problem.
#[derive(Debug, Clone, Copy)]
pub(super) struct Design<'a> {
    pub(super) shape: &'a Shape,
    /// Chebyshev columns times the direction of travel: half of the reversal.
    pub(super) reversal: usize,
    /// True where these stand before the columns of the shape.
    pub(super) reversal_first: bool,
    /// Coefficients of the shape and number of first period that is fitted: adds derivative columns.
    pub(super) slopes: Option<(&'a [f64], usize)>,
}

impl<'a> Design<'a> {
    /// The shape alone.
    pub(super) const fn of(shape: &'a Shape) -> Self {
        Self { shape, reversal: 0, reversal_first: false, slopes: None }
    }

    /// Number of columns.
    pub(super) fn len(&self) -> usize {
        let slopes = self.slopes.map_or(0, |(_, first)| self.shape.periods.len() - first);
        self.shape.len() + self.reversal + slopes
    }

    /// The columns at `x`, travelling in the direction of `sign`.
    #[inline]
    pub(super) fn row(&self, x: f64, sign: f64, row: &mut [f64]) {
        let own = self.shape.len();
        let (at, reversal_at) = if self.reversal_first { (self.reversal, 0) } else { (0, own) };
        self.shape.row(x, &mut row[at..at + own]);
        if self.reversal > 0 {
            let [low, high] = self.shape.range;
            let columns = &mut row[reversal_at..reversal_at + self.reversal];
            chebyshev((2.0 * x - low - high) / (high - low), columns);
            columns.iter_mut().for_each(|v| *v *= sign);
        }
        if let Some((c, first)) = self.slopes {
            for (value, which) in row[own + self.reversal..].iter_mut().zip(first..) {
                *value = self.shape.by_period(x, c, which);
            }
        }
    }

    /// Several places reduced to `[-1, 1]`.
    pub(super) fn reduced(&self, x: &Lane) -> Lane {
        let [low, high] = self.shape.range;
        x.map(|x| (2.0 * x - low - high) / (high - low))
    }

    /// The columns of several places side by side; `row` is scratch space for one.
    pub(super) fn rows(&self, x: &Lane, sign: &Lane, row: &mut [f64], columns: &mut [Lane]) {
        if self.shape.basis != Basis::Chebyshev {
            for lane in 0..LANES {
                self.row(x[lane], sign[lane], row);
                columns.iter_mut().zip(&*row).for_each(|(column, value)| column[lane] = *value);
            }
            return;
        }
        let s = self.reduced(x);
        let own = self.shape.len();
        let (at, reversal_at) = if self.reversal_first { (self.reversal, 0) } else { (0, own) };
        chebyshev_lanes(&s, &[1.0; LANES], &mut columns[at..at + own]);
        chebyshev_lanes(&s, sign, &mut columns[reversal_at..reversal_at + self.reversal]);
    }
}

/// The factors of a design over some data.
pub(super) struct Factor {
    pub(super) r: DMatrix<f64>,
    pub(super) z: DVector<f64>,
    /// Rows of the orthogonal factor, where kept.
    pub(super) q: Option<DMatrix<f64>>,
    /// Inverse of `r`, where they are not.
    pub(super) inverse: DMatrix<f64>,
    /// How each column of the orthogonal factor follows from the two before it; empty where it does not.
    pub(super) recurrence: Vec<Recurrence>,
}

/// `q_(j+1) = (scale s + shift) q_j - before q_(j-1)`: Chebyshev polynomials made orthogonal over the cells.
pub(super) struct Recurrence {
    scale: f64,
    shift: f64,
    before: f64,
}

impl Recurrence {
    /// From the coefficients `b_ij` of `q_j = SUM_i b_ij T_i(s)`.
    fn of(b: &DMatrix<f64>) -> Vec<Self> {
        let mut found: Vec<Self> = Vec::new();
        for j in 0..b.ncols().saturating_sub(1) {
            // s T_0 = T_1, 2 s T_j = T_(j+1) + T_(j-1)
            let share = |j: usize| if j == 0 { 1.0 } else { 0.5 };
            let scale = b[(j + 1, j + 1)] / (share(j) * b[(j, j)]);
            let second = if j > 0 { share(j - 1) * b[(j - 1, j)] } else { 0.0 };
            let shift = (b[(j, j + 1)] - scale * second) / b[(j, j)];
            let before = found.last().map_or(0.0, |last| scale / last.scale);
            found.push(Self { scale, shift, before });
        }
        found
    }

    /// The column after `q`, which `before` precedes.
    pub(super) fn next(&self, s: &Lane, q: &Lane, before: &Lane) -> Lane {
        core::array::from_fn(|lane| {
            (self.scale * s[lane] + self.shift) * q[lane] - self.before * before[lane]
        })
    }
}

impl Factor {
    /// Factors the design; `penalty` holds `p_j` of `SUM p_j c_j^2`, or is empty.
    pub(super) fn new(data: &Data, design: &Design<'_>, penalty: &[f64]) -> Self {
        let penalised = penalty.iter().any(|p| *p > 0.0);
        if data.cells.len() > FEW
            && !penalised
            && let Some(factor) = gram(data, design)
        {
            return factor;
        }
        reflections(data, design, penalty)
    }

    /// Condition number of the first `k` columns: by pivots where these are sound, else by singular values.
    pub(super) fn condition(&self, k: usize) -> f64 {
        if k == 0 || self.r.nrows() < k {
            return f64::INFINITY;
        }
        let values = self.r.view((0, 0), (k, k)).clone_owned().svd(false, false).singular_values;
        let condition = values.max() / values.min();
        if condition.is_nan() { f64::INFINITY } else { condition }
    }

    /// True where the first `k` columns can be told apart.
    pub(super) fn is_sound(&self, k: usize) -> bool {
        if self.r.nrows() < k {
            return false;
        }
        self.pivots(k) <= SOUND_PIVOTS || self.condition(k) <= CONDITION_LIMIT
    }

    /// Ratio of the largest to the smallest pivot of the first `k` columns.
    fn pivots(&self, k: usize) -> f64 {
        let pivots = (0..k).map(|i| self.r[(i, i)].abs());
        let (high, low) = pivots.fold((0.0f64, f64::INFINITY), |(h, l), p| (h.max(p), l.min(p)));
        high / low
    }

    /// Coefficients of the first `k` columns.
    pub(super) fn coefficients(&self, k: usize) -> Option<DVector<f64>> {
        self.r.view((0, 0), (k, k)).clone_owned().solve_upper_triangular(&self.z.rows(0, k).clone_owned())
    }

    /// How what the means of the cells share changes the coefficients: a row per coefficient.
    pub(super) fn shared(&self, data: &Data, design: &Design<'_>) -> DMatrix<f64> {
        let k = design.len();
        let columns = data.shared.ncols();
        if columns == 0 {
            return DMatrix::zeros(k, 0);
        }
        let mut right = DMatrix::zeros(k, columns);
        let mut row = vec![0.0; k];
        for (i, cell) in data.cells.iter().enumerate() {
            design.row(data.positions[cell.group], cell.sign(), &mut row);
            for (j, value) in row.iter().enumerate() {
                let mut line = right.row_mut(j);
                line += data.shared.row(i) * (cell.count * value);
            }
        }
        let half = self.r.tr_solve_upper_triangular(&right);
        half.and_then(|half| self.r.solve_upper_triangular(&half))
            .unwrap_or_else(|| DMatrix::zeros(k, columns))
    }

    /// Coefficients with the rounding of the first solution taken out by one step of refinement.
    pub(super) fn refined(&self, data: &Data, design: &Design<'_>) -> Option<DVector<f64>> {
        let k = design.len();
        let mut c = self.coefficients(k)?;
        if self.q.is_none() && self.pivots(k) < WELL_CONDITIONED {
            return Some(c);
        }
        let mut row = vec![0.0; k];
        let mut gradient = DVector::zeros(k);
        for cell in &data.cells {
            design.row(data.positions[cell.group], cell.sign(), &mut row);
            let residual = cell.count * (cell.mean - dot(&row, c.as_slice()));
            gradient.iter_mut().zip(&row).for_each(|(g, a)| *g += a * residual);
        }
        c += self.r.solve_upper_triangular(&self.r.tr_solve_upper_triangular(&gradient)?)?;
        Some(c)
    }
}

/// Householder reflections, orthogonal factor kept; penalties are further rows.
fn reflections(data: &Data, design: &Design<'_>, penalty: &[f64]) -> Factor {
    let (n, m) = (data.cells.len(), design.len());
    let ridge = penalty.iter().filter(|p| **p > 0.0).count();
    let mut matrix = DMatrix::zeros(n + ridge, m);
    let mut row = vec![0.0; m];
    let mut values = DVector::zeros(n);
    for (i, cell) in data.cells.iter().enumerate() {
        design.row(data.positions[cell.group], cell.sign(), &mut row);
        let root = cell.count.sqrt();
        row.iter().enumerate().for_each(|(j, v)| matrix[(i, j)] = v * root);
        values[i] = cell.mean * root;
    }
    for (i, (j, p)) in penalty.iter().enumerate().filter(|(_, p)| **p > 0.0).enumerate() {
        matrix[(n + i, j)] = p.sqrt();
    }
    let (q, r) = matrix.qr().unpack();
    let z = q.rows(0, n).tr_mul(&values);
    Factor { r, z, q: Some(q), inverse: DMatrix::zeros(0, 0), recurrence: Vec::new() }
}

/// Cholesky factor of `A^T W A`, a block of rows at a time; `None` where the condition asks for reflections.
fn gram(data: &Data, design: &Design<'_>) -> Option<Factor> {
    let m = design.len();
    let of_chebyshev = design.shape.basis == Basis::Chebyshev && design.slopes.is_none();
    let [sums, right] = if of_chebyshev {
        chebyshev_products(data, design)
    } else {
        let parts = shared_out(data, |_, cells| products(data, design, cells));
        added(parts, [vec![0.0; m * m], vec![0.0; m]])
    };
    // columns of length 1: how they are scaled says nothing about how alike they are
    let length: Vec<f64> = (0..m).map(|j| sums[j * m + j].sqrt()).collect();
    let matrix = DMatrix::from_fn(m, m, |i, j| sums[i.min(j) * m + i.max(j)] / (length[i] * length[j]));
    let mut r = matrix.cholesky()?.unpack().transpose();
    let pivots = r.diagonal();
    if pivots.max() > GRAM_CONDITION * pivots.min() {
        return None;
    }
    r.column_iter_mut().zip(&length).for_each(|(mut column, length)| column *= *length);
    let z = r.tr_solve_upper_triangular(&DVector::from_vec(right))?;
    let inverse = r.solve_upper_triangular(&DMatrix::identity(m, m))?;
    let is_one_sequence = of_chebyshev && design.reversal == 0;
    let recurrence = if is_one_sequence { Recurrence::of(&inverse) } else { Vec::new() };
    Some(Factor { r, z, q: None, inverse, recurrence })
}

/// The sums over all shares.
fn added<const N: usize>(parts: Vec<[Vec<f64>; N]>, mut total: [Vec<f64>; N]) -> [Vec<f64>; N] {
    for part in parts {
        for (total, part) in total.iter_mut().zip(part) {
            total.iter_mut().zip(part).for_each(|(sum, value)| *sum += value);
        }
    }
    total
}

/// `A^T W A` above its diagonal, row by row, and `A^T W y` over some cells.
fn products(data: &Data, design: &Design<'_>, cells: &[Cell]) -> [Vec<f64>; 2] {
    let m = design.len();
    // two partial sums of every product: they keep both halves of a register busy
    let mut sums = vec![[0.0; 2]; m * m];
    let mut right = vec![0.0; m];
    let (mut row, mut columns) = (vec![0.0; m], vec![[0.0; LANES]; m]);
    for block in blocks(data, cells) {
        design.rows(&block.positions, &block.signs, &mut row, &mut columns);
        for (j, column) in columns.iter().enumerate() {
            let weighted: Lane = core::array::from_fn(|lane| block.counts[lane] * column[lane]);
            right[j] += dot(&weighted, &block.means);
            for (sum, other) in sums[j * m + j..(j + 1) * m].iter_mut().zip(&columns[j..]) {
                for (w, v) in weighted.chunks_exact(2).zip(other.chunks_exact(2)) {
                    sum[0] += w[0] * v[0];
                    sum[1] += w[1] * v[1];
                }
            }
        }
    }
    [sums.into_iter().map(|[a, b]| a + b).collect(), right]
}

/// The same of Chebyshev columns from sums of single polynomials: `2 T_i T_j = T_(i+j) + T_|i-j|`.
fn chebyshev_products(data: &Data, design: &Design<'_>) -> [Vec<f64>; 2] {
    let (own, turned, m) = (design.shape.len(), design.reversal, design.len());
    let of_both = if turned > 0 { own + turned - 1 } else { 0 };
    // weights, weights times sign of travel; values, values times sign
    let lengths = [2 * own.max(turned) - 1, of_both, own, turned];
    let parts = shared_out(data, |_, cells| {
        let mut sums = lengths.map(|length| vec![[0.0; LANES]; length]);
        for block in blocks(data, cells) {
            let s = design.reduced(&block.positions);
            let values: Lane = core::array::from_fn(|lane| block.counts[lane] * block.means[lane]);
            let signed = |of: &Lane| core::array::from_fn(|lane| of[lane] * block.signs[lane]);
            let factors = [block.counts, signed(&block.counts), values, signed(&values)];
            factors.iter().zip(&mut sums).for_each(|(factor, sums)| add_chebyshev(&s, factor, sums));
        }
        sums.map(|sums| sums.iter().map(|lanes| lanes.iter().sum()).collect::<Vec<f64>>())
    });
    let [weights, signed, values, turned_values] = added(parts, lengths.map(|length| vec![0.0; length]));
    let mut columns: Vec<(bool, usize)> = (0..own).map(|k| (false, k)).collect();
    columns.extend((0..turned).map(|k| (true, k)));
    if design.reversal_first {
        columns.rotate_left(own);
    }
    let product = |(a, i): (bool, usize), (b, j): (bool, usize)| {
        // the square of a sign is 1
        let of = if a == b { &weights } else { &signed };
        0.5 * (of[i + j] + of[i.abs_diff(j)])
    };
    let sums = (0..m * m).map(|at| product(columns[at / m], columns[at % m])).collect();
    let right = columns.iter().map(|&(is_turned, k)| if is_turned { turned_values[k] } else { values[k] });
    [sums, right.collect()]
}

pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests {
    use super::super::Basis;
    use super::*;
    use crate::Reading;
    use volcomp_units::axes::Travel;

    fn readings(n: usize) -> Vec<Reading> {
        (0..n)
            .map(|i| Reading {
                cycle: 0,
                travel: if i % 3 == 1 { Travel::Reverse } else { Travel::Forward },
                position: 400.0 * i as f64 / (n - 1) as f64,
                value: (i as f64 * 0.37).sin() + 0.1 * (i as f64 * 7.7).cos(),
            })
            .collect()
    }

    fn line() -> Shape {
        Shape { basis: Basis::Chebyshev, order: 1, range: [0.0, 2.0], periods: Vec::new(), linear: false }
    }

    #[test]
    fn a_line_through_three_points() {
        let all: Vec<Reading> = [(0.0, 1.0), (1.0, 2.0), (2.0, 4.0)]
            .map(|(position, value)| Reading { cycle: 0, travel: Travel::Forward, position, value })
            .to_vec();
        let data = Data::new(&all, None).unwrap();
        let shape = line();
        let design = Design::of(&shape);
        let factor = Factor::new(&data, &design, &[]);
        let c = factor.refined(&data, &design).unwrap();
        // 5/6 + 1.5 x in s = x - 1
        assert!((c[0] - (5.0 / 6.0 + 1.5)).abs() < 1e-15 && (c[1] - 1.5).abs() < 1e-15);
        let rungs = factor.nested_fits(&data, &design, &[1, 2]);
        assert!((rungs[1].sums.sse - 1.0 / 6.0).abs() < 1e-15);
        assert!((rungs[0].sums.sse - data.spread).abs() < 1e-14);
    }

    #[test]
    fn a_ridge_holds_coefficients_down() {
        let data = Data::new(&readings(9), None).unwrap();
        let shape = line();
        let design = Design::of(&shape);
        let held = Factor::new(&data, &design, &[0.0, 1e12]);
        assert!(held.coefficients(2).unwrap()[1].abs() < 1e-9);
    }

    #[test]
    fn the_sums_of_many_rows_and_the_reflections_agree() {
        // the second set lies closer towards its end: columns are less alike than they look
        let crowded = |r: Reading| Reading { position: 400.0 * (r.position / 400.0).powf(0.7), ..r };
        // the third has both directions at most targets, repeats at some, several shares and lanes without a cell
        let both = |r: Reading| {
            let turned = if r.travel == Travel::Forward { Travel::Reverse } else { Travel::Forward };
            [r, Reading { travel: turned, value: r.value + 0.3, ..r }, Reading { value: r.value - 0.2, ..r }]
        };
        let many = readings(2803).into_iter().flat_map(both).enumerate();
        let many = many.filter(|(i, _)| i % 7 != 1 && i % 3 != 2 || i % 21 == 2).map(|(_, r)| r).collect();
        for readings in [readings(3000), readings(400).into_iter().map(crowded).collect(), many] {
            let data = Data::new(&readings, None).unwrap();
            for (basis, order) in [
                (Basis::Chebyshev, 0),
                (Basis::Chebyshev, 1),
                (Basis::Chebyshev, 7),
                (Basis::Chebyshev, 24),
                (Basis::HalfRange, 7),
                (Basis::Fourier, 7),
            ] {
                let shape = Shape { basis, order, range: [0.0, 400.0], periods: vec![380.0], linear: false };
                for (reversal, reversal_first) in [(0, false), (1, true), (3, false), (3, true)] {
                    agree(&data, &Design { reversal, reversal_first, ..Design::of(&shape) });
                }
            }
        }
    }

    fn agree(data: &Data, design: &Design<'_>) {
        let (what, k) = ((design.shape, design.reversal), design.len());
        let a = gram(data, design).unwrap();
        let b = reflections(data, design, &[]);
        let is_one_sequence = design.shape.basis == Basis::Chebyshev && design.reversal == 0 && k > 1;
        assert_eq!(a.recurrence.is_empty(), !is_one_sequence);
        let (ca, cb) = (a.refined(data, design).unwrap(), b.refined(data, design).unwrap());
        assert!((ca - &cb).abs().max() < 1e-13, "{what:?}");
        let rungs = [3.min(k), k.saturating_sub(2).max(3.min(k)), k];
        for (x, y) in a.nested_fits(data, design, &rungs).iter().zip(b.nested_fits(data, design, &rungs)) {
            // crowded targets make high orders alike: the square of their condition costs a digit
            let bound = if design.shape.order > 7 { 1e-10 } else { 1e-11 };
            let near = |x: f64, y: f64| assert!((x - y).abs() < bound * y, "{what:?}: {x} for {y}");
            near(x.sums.sse, y.sums.sse);
            near(x.sums.loo, y.sums.loo);
            near(x.sums.position, y.sums.position);
            near(x.sums.e_max, y.sums.e_max);
        }
    }
}
