//! The whitened problem: every candidate column and the gap as independent innovations of unit variance.

use std::collections::BTreeMap;
use std::ops::Range;

use nalgebra::{DMatrix, DMatrixView, DVector};
use rayon::prelude::*;

use super::super::constants::{BLOCKS_MIN, MOVES, SEEN};
use super::super::library::{Blind, Library};
use super::super::moment::{Axis, SLOTS};
use super::super::noise::Filter;
use super::super::session::{Session, is_encoder};
use super::data_partition::{Places, blocks, programs};
use super::low_rank::Joined;
use super::metric::Plain;
use super::pivoted_cholesky::{Factor, Rest, dot};
use super::raw_columns::{RawColumns, raw_columns};
use super::structure::Structure;

/// Fewest readings that one processor takes at a time, and most parts into which they are divided: each has sums of its own.
const ROWS: usize = 512;
const PARTS: usize = 64;
/// Share of the square of a column that whitening must leave.
pub(super) const LEAST: f64 = 1e-9;

/// Readings, columns and what was computed of them.
pub struct Problem {
    /// Row of the session behind each row of the problem.
    pub rows: Vec<usize>,
    /// Whitened gap.
    pub y: DVector<f64>,
    /// Columns and gap before noise of low rank joined.
    pub(super) plain: Plain,
    /// Its noise, in the order in which it joined.
    pub(super) joined: Vec<Joined>,
    /// By what a column is multiplied for unit length; 0 of one that is taken for none.
    pub(super) unit: Vec<f64>,
    /// First column and number of columns of each variant.
    pub span: Vec<(usize, usize)>,
    /// Length of each whitened column before it was scaled to 1.
    pub norm: Vec<f64>,
    /// Share of each variant that offsets and drift leave.
    pub seen: Vec<f64>,
    /// `W y`.
    pub b: DVector<f64>,
    /// Gram matrix of each variant, row by row.
    pub own: Vec<Vec<f64>>,
    /// Program of each row: same setup, axes that move, feed and tool.
    pub cell: Vec<usize>,
    /// Number of programs.
    pub cells: usize,
    /// Place of each row within its program, for effects that are no function of a position and for those of each axis.
    pub places: Vec<Places>,
    /// Block of each row for tests across runs.
    pub block: Vec<usize>,
    /// Number of blocks.
    pub blocks: usize,
    /// All readings are the control's own encoders: the formulas of the servo hold to a small share.
    pub precise: bool,
    /// What has joined the noise.
    pub(super) structure: Structure,
    /// Products of the columns of a variant with all columns, computed when first needed.
    pub(super) cross: BTreeMap<usize, DMatrix<f64>>,
}

impl Problem {
    /// Filters gap and columns.
    #[must_use]
    pub fn new(session: &Session, library: &Library, filter: &Filter, gap: &[f64], white_um: &[f64]) -> Self {
        let raw = raw_columns(session, library, &filter.members());
        Self::of_raw(raw, session, library, filter, (gap, white_um))
    }

    /// The same, with raw columns that are known.
    #[must_use]
    pub fn next(
        session: &Session,
        library: &Library,
        raw: &mut RawColumns,
        filter: &Filter,
        gap: &[f64],
        white_um: &[f64],
    ) -> Self {
        let raw = raw.of(session, library, &filter.members());
        Self::of_raw(raw, session, library, filter, (gap, white_um))
    }

    fn of_raw(
        raw: Vec<f64>,
        session: &Session,
        library: &Library,
        filter: &Filter,
        (gap, white_um): (&[f64], &[f64]),
    ) -> Self {
        let rows = filter.order().to_vec();
        let width = library.width();
        let mut data = filter.mean(raw, width);
        let mut before = vec![0.0; width];
        for (row, i) in data.chunks_exact(width.max(1)).zip(&rows) {
            let s = white_um[session.readings[*i].instrument];
            for (b, v) in before.iter_mut().zip(row) {
                *b += (v / s).powi(2);
            }
        }
        filter.apply(&mut data, width);
        let mut w = DMatrix::from_vec(width, rows.len(), data);
        let span = library.spans();
        let y = DVector::from_vec(filter.column(gap));
        let Scaled { length, b, own } =
            Scaled::to_unit_length(&mut w, &y, &span, |j, square| square > LEAST * before[j]);
        let share = |(at, k): &(usize, usize)| {
            let left: f64 = length[*at..at + k].iter().map(|l| l * l).sum();
            let all: f64 = before[*at..at + k].iter().sum();
            if all > 0.0 { left / all } else { 0.0 }
        };
        let seen = span.iter().map(share).collect();
        let (cell, cells) = programs(session, &rows);
        let places = (0..=SLOTS).map(|own| Places::new(session, &rows, &cell, own)).collect();
        let (block, blocks) = blocks(session, &rows, BLOCKS_MIN);
        let precise = session.instruments.iter().all(|n| is_encoder(n));
        let plain = Plain { w, y, norm: length, b, own, cross: BTreeMap::new() };
        Self { rows, seen, cell, cells, places, block, blocks, precise, ..Self::of_plain(plain, span) }
    }

    /// Columns of variants whose readings are of one program and one block.
    fn of_plain(plain: Plain, span: Vec<(usize, usize)>) -> Self {
        let (n, width) = (plain.y.len(), plain.norm.len());
        let mut problem = Self {
            rows: (0..n).collect(),
            y: plain.y.clone(),
            norm: vec![0.0; width],
            unit: vec![0.0; width],
            b: DVector::zeros(width),
            own: plain.own.clone(),
            plain,
            joined: Vec::new(),
            seen: vec![1.0; span.len()],
            span,
            cell: vec![0; n],
            cells: 1,
            places: Vec::new(),
            block: vec![0; n],
            blocks: 1,
            precise: false,
            structure: Structure::default(),
            cross: BTreeMap::new(),
        };
        problem.measure_all();
        problem
    }

    /// Effects of which offsets and drift leave nothing, and those whose columns are all zero.
    #[must_use]
    pub fn unseen(&self, library: &Library) -> Vec<Blind> {
        library
            .by_label()
            .iter()
            .enumerate()
            .filter(|(_, variants)| variants.iter().all(|v| self.seen[*v] < SEEN))
            .map(|(l, _)| Blind {
                label: library.labels[l].to_string(),
                because:
                    "offsets of the setups and drift take all of it; let its cause change inside one setup"
                        .to_owned(),
                is_unrecorded: false,
            })
            .collect()
    }

    /// Middle and half of the way of a linear axis over the readings, mm; `None` where it hardly moves.
    #[must_use]
    pub fn way(&self, session: &Session, axis: Axis) -> Option<(f64, f64)> {
        let positions = self.rows.iter().map(|i| session.moments[*i].position[axis.slot()]);
        let (low, high) =
            positions.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
        (high - low > MOVES[0]).then_some((0.5 * (high + low), 0.5 * (high - low)))
    }

    /// Number of readings.
    #[must_use]
    pub fn len(&self) -> usize {
        self.rows.len()
    }

    /// True without readings.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// The columns of a variant.
    pub(super) fn columns(&self, variant: usize) -> Range<usize> {
        let (at, k) = self.span[variant];
        at..at + k
    }

    /// Some vectors without what the given columns say.
    #[must_use]
    pub fn beside(&self, given: &Given, some: &DMatrix<f64>) -> DMatrix<f64> {
        self.divided(given, some).0
    }

    /// The same, and what the columns say of each: their parameters (rows, in the units of these).
    #[must_use]
    pub(super) fn divided(&self, given: &Given, some: &DMatrix<f64>) -> (DMatrix<f64>, DMatrix<f64>) {
        let columns = self.whitened_rows(&given.columns);
        let (mut out, mut taken) = (some.clone(), &columns * some);
        for (mut o, mut t) in out.column_iter_mut().zip(taken.column_iter_mut()) {
            let known = DVector::from_vec(given.factor.solve(t.as_slice()));
            o.gemv_tr(-1.0, &columns, &known, 1.0);
            t.copy_from(&known);
        }
        for (mut t, c) in taken.row_iter_mut().zip(&given.columns) {
            t *= if self.norm[*c] > 0.0 { 1.0 / self.norm[*c] } else { 0.0 };
        }
        (out, taken)
    }

    /// What is known once the columns of `chosen` (prepared) are in.
    #[must_use]
    pub fn given(&self, chosen: &[usize]) -> Given {
        let columns: Vec<usize> = chosen.iter().flat_map(|v| self.columns(*v)).collect();
        let n = columns.len();
        let mut small = Vec::with_capacity(n * n);
        for products in chosen.iter().filter_map(|v| self.cross.get(v)).flat_map(DMatrix::column_iter) {
            small.extend(columns.iter().map(|c| products[*c]));
        }
        let factor = Factor::new(n, &small, &self.full(columns.iter().copied()));
        let z = factor.forward(&columns.iter().map(|c| self.b[*c]).collect::<Vec<_>>());
        Given { explained: dot(&z, &z), chosen: chosen.to_vec(), columns, factor, z }
    }

    /// Squares of columns: 1, or 0 of those that are zero.
    pub(super) fn full(&self, columns: impl Iterator<Item = usize>) -> Vec<f64> {
        columns.map(|c| if self.norm[c] > 0.0 { 1.0 } else { 0.0 }).collect()
    }

    /// What a variant brings beside those of `chosen` (prepared): drop of the sum of squares, and the number of its independent columns.
    #[must_use]
    pub fn gain_beside(&self, chosen: &[usize], variant: usize) -> (f64, usize) {
        self.gain(&self.given(chosen), variant)
    }

    /// Drop of the sum of squares by a variant beside what is given, and the number of its independent columns.
    #[must_use]
    pub fn gain(&self, given: &Given, variant: usize) -> (f64, usize) {
        let rest = self.rest(given, variant);
        self.gain_in(variant, &rest.g, &rest.b)
    }

    /// The same from the products of its columns with each other and with the gap, beside what is in.
    pub(super) fn gain_in(&self, variant: usize, g: &[f64], b: &[f64]) -> (f64, usize) {
        let factor = Factor::new(b.len(), g, &self.full(self.columns(variant)));
        (factor.gain(b), factor.rank())
    }

    /// Drop of the sum of squares of any signal by a variant alone; `products` are those of all columns with the signal.
    #[must_use]
    pub fn gain_of(&self, variant: usize, products: &[f64]) -> f64 {
        self.gain_in(variant, &self.own[variant], &products[self.columns(variant)]).0
    }

    /// What is left of a variant beside what is given.
    pub(super) fn rest(&self, given: &Given, variant: usize) -> Rest {
        let own = self.columns(variant);
        let cross = || given.chosen.iter().filter_map(|v| self.cross.get(v)).flat_map(DMatrix::column_iter);
        let with = own.clone().flat_map(|c| cross().map(move |products| products[c])).collect();
        let b = self.b.as_slice()[own].to_vec();
        Rest::new(&given.factor, &given.z, with, self.own[variant].clone(), b)
    }

    /// Products of all columns with those that are in, a column each.
    pub(super) fn products_with(&self, given: &Given) -> DMatrix<f64> {
        let mut rows: Vec<f64> = Vec::with_capacity(given.columns.len() * self.norm.len());
        given.chosen.iter().filter_map(|v| self.cross.get(v)).for_each(|p| rows.extend(p.as_slice()));
        DMatrix::from_row_slice(given.columns.len(), self.norm.len(), &rows)
    }

    /// Parameters of the chosen variants, in the whitened scale, in the order of their columns.
    #[must_use]
    pub fn fit(&self, given: &Given) -> Vec<f64> {
        let own: Vec<f64> = given.columns.iter().map(|c| self.b[*c]).collect();
        given.factor.solve(&own)
    }

    /// What one of the effects of a joint fit contributes to every row.
    #[must_use]
    pub fn part(&self, given: &Given, beta: &[f64], variant: usize) -> DVector<f64> {
        let (at, k) = self.span[variant];
        let (mine, values): (Vec<usize>, Vec<f64>) =
            given.columns.iter().zip(beta).filter(|(c, _)| (at..at + k).contains(*c)).unzip();
        self.contribution(&mine, &values)
    }

    /// Cosine of what two effects of a joint fit (prepared) contribute: negative where each takes back what the other says.
    #[must_use]
    pub fn cosine(&self, given: &Given, pair: [usize; 2]) -> f64 {
        let beta = self.fit(given);
        let of = |v: usize| beta.iter().zip(&given.columns).filter(move |(_, c)| self.columns(v).contains(c));
        let product = |[a, b]: [usize; 2]| -> f64 {
            let products = &self.cross[&b];
            let with = |(of_b, d): (&f64, &usize)| {
                of(a).map(|(of_a, c)| of_a * products[(*c, d - self.span[b].0)]).sum::<f64>() * of_b
            };
            of(b).map(with).sum()
        };
        let [a, b] = pair;
        product(pair) / (product([a, a]) * product([b, b])).sqrt().max(f64::MIN_POSITIVE)
    }
}

/// The columns that are in.
pub struct Given {
    chosen: Vec<usize>,
    /// The columns of the problem.
    pub columns: Vec<usize>,
    pub(super) factor: Factor,
    /// `L^-1` times their products with the gap.
    pub(super) z: Vec<f64>,
    /// Drop of the sum of squares by all of them.
    pub explained: f64,
}

impl Given {
    /// Covariance of the parameters in the whitened scale, row by row.
    #[must_use]
    pub fn covariance(&self, problem: &Problem) -> Vec<f64> {
        let left = (problem.y.norm_squared() - self.explained) / problem.len().max(1) as f64;
        // more scatter than the noise model knows widens what is said of the parameters
        self.factor.inverse().into_iter().map(|v| v * left.max(1.0)).collect()
    }
}

/// Most columns of a variant whose products are summed reading by reading.
pub(super) const WIDE: usize = 5;

/// What scaling whitened columns to unit length gives.
struct Scaled {
    /// Length of each column before; 0 of one that is taken for none.
    length: Vec<f64>,
    /// Products of the columns with the gap.
    b: DVector<f64>,
    /// Gram matrix of each variant, row by row.
    own: Vec<Vec<f64>>,
}

impl Scaled {
    /// Scales the columns (a matrix row each); those whose number and square are not `seen` become zero.
    fn to_unit_length(
        w: &mut DMatrix<f64>,
        y: &DVector<f64>,
        span: &[(usize, usize)],
        seen: impl Fn(usize, f64) -> bool,
    ) -> Self {
        let (rows, width) = (ROWS.max(y.len().div_ceil(PARTS)), w.nrows().max(1));
        let sums = |(data, y): (&[f64], &[f64])| {
            let w = DMatrixView::from_slice(data, width, y.len());
            // of wide variants a product of matrices, of narrow ones sums in one pass over all
            let product = |(at, k): &(usize, usize)| {
                let columns = w.rows(*at, *k);
                (columns * columns.transpose()).as_slice().to_vec()
            };
            let begin = |s: &(usize, usize)| if s.1 > WIDE { product(s) } else { vec![0.0; s.1 * s.1] };
            let mut own: Vec<Vec<f64>> = span.iter().map(begin).collect();
            let mut b = DVector::zeros(width);
            for (row, y) in data.chunks_exact(width).zip(y) {
                b.iter_mut().zip(row).for_each(|(b, v)| *b += v * y);
                for (g, (at, k)) in own.iter_mut().zip(span).filter(|(_, s)| s.1 <= WIDE) {
                    let v = &row[*at..at + k];
                    for i in 0..*k {
                        for j in 0..=i {
                            g[i * k + j] += v[i] * v[j];
                        }
                    }
                }
            }
            (b, own)
        };
        // sums over the same rows whatever the number of processors
        let parts = w.as_slice().par_chunks(rows * width).zip(y.as_slice().par_chunks(rows));
        let parts: Vec<(DVector<f64>, Vec<Vec<f64>>)> = parts.map(sums).collect();
        let mut b = DVector::zeros(w.nrows());
        let mut own: Vec<Vec<f64>> = span.iter().map(|s| vec![0.0; s.1 * s.1]).collect();
        for (of_b, of_own) in &parts {
            b += of_b;
            own.iter_mut().flatten().zip(of_own.iter().flatten()).for_each(|(g, part)| *g += part);
        }
        let square = own.iter().zip(span).flat_map(|(g, (_, k))| (0..*k).map(move |i| g[i * k + i]));
        let length: Vec<f64> = square
            .enumerate()
            .map(|(j, square)| if square > 0.0 && seen(j, square) { square.sqrt() } else { 0.0 })
            .collect();
        let scale: Vec<f64> = length.iter().map(|l| if *l > 0.0 { 1.0 / l } else { 0.0 }).collect();
        let scale_row = |row: &mut [f64]| row.iter_mut().zip(&scale).for_each(|(v, s)| *v *= s);
        w.as_mut_slice().par_chunks_exact_mut(width).for_each(scale_row);
        b.iter_mut().zip(&scale).for_each(|(b, s)| *b *= s);
        for (g, (at, k)) in own.iter_mut().zip(span) {
            for i in 0..*k {
                for j in 0..=i {
                    g[i * k + j] *= scale[at + i] * scale[at + j];
                    g[j * k + i] = g[i * k + j];
                }
            }
        }
        Self { length, b, own }
    }
}

#[cfg(test)]
impl Problem {
    /// A problem of columns made up for a test, those of each variant together; one program, one block.
    pub(super) fn made_up(variants: &[Vec<DVector<f64>>], y: DVector<f64>) -> Self {
        let columns: Vec<DVector<f64>> = variants.iter().flatten().cloned().collect();
        let mut w = DMatrix::from_columns(&columns).transpose();
        let ends = variants.iter().scan(0, |at, v| {
            *at += v.len();
            Some(*at)
        });
        let span: Vec<(usize, usize)> = ends.zip(variants).map(|(end, v)| (end - v.len(), v.len())).collect();
        let Scaled { length, b, own } = Scaled::to_unit_length(&mut w, &y, &span, |_, _| true);
        Self::of_plain(Plain { w, y, norm: length, b, own, cross: BTreeMap::new() }, span)
    }
}
