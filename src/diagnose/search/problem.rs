//! The whitened problem: every candidate column and the gap as independent innovations of unit variance.

use std::collections::BTreeMap;
use std::ops::Range;

use nalgebra::{DMatrix, DVector};

use super::super::constants::{BLOCKS_MIN, MOVES, SEEN};
use super::super::library::{Blind, Library, Shape};
use super::super::moment::{Axis, SLOTS};
use super::super::noise::Filter;
use super::super::session::{Session, is_encoder};
use super::data_partition::{Places, blocks, programs};
use super::low_rank::LowRank;
use super::pivoted_cholesky::{Factor, ROWS, add_multiples};
use super::raw_columns::{RawColumns, raw, raw_columns};
use super::variation::Variation;

/// Readings, columns and what was computed of them.
pub struct Problem {
    /// Row of the session behind each row of the problem.
    pub rows: Vec<usize>,
    /// Whitened gap.
    pub y: DVector<f64>,
    /// Whitened columns of length 1, one matrix column per row of the problem.
    pub w: DMatrix<f64>,
    /// First column and number of columns of each variant.
    pub span: Vec<(usize, usize)>,
    /// Length of each whitened column before it was scaled.
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
    /// What varies smoothly over the volume and no effect describes, whitened as noise is.
    discrepancy: Option<LowRank>,
    /// How far effects vary over the volume, whitened beside it.
    variation: Option<Variation>,
    /// Products of the columns of a variant with all columns, computed when first needed.
    cross: BTreeMap<usize, DMatrix<f64>>,
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
            Scaled::to_unit_length(&mut w, &y, &span, |j, square| square > 1e-9 * before[j]);
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
        Self {
            rows,
            y,
            w,
            span,
            norm: length,
            seen,
            b,
            own,
            cell,
            cells,
            places,
            block,
            blocks,
            precise,
            discrepancy: None,
            variation: None,
            cross: BTreeMap::new(),
        }
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

    /// Products of the columns of some variants with all columns, in one pass over the columns.
    pub fn prepare(&mut self, variants: &[usize]) {
        let mut missing: Vec<usize> =
            variants.iter().copied().filter(|v| !self.cross.contains_key(v)).collect();
        missing.sort_unstable();
        missing.dedup();
        let columns: Vec<usize> = missing.iter().flat_map(|v| self.columns(*v)).collect();
        if columns.is_empty() {
            return;
        }
        let width = self.b.len();
        let mut products = DMatrix::zeros(width, columns.len());
        for rows in self.w.as_slice().chunks(ROWS * width) {
            for (mut product, c) in products.column_iter_mut().zip(&columns) {
                let mut own = [0.0; ROWS];
                own.iter_mut().zip(rows[*c..].iter().step_by(width)).for_each(|(own, v)| *own = *v);
                // most effects act in some of the programs
                if own != [0.0; ROWS] {
                    add_multiples(product.as_mut_slice(), rows, &own[..rows.len() / width]);
                }
            }
        }
        let mut at = 0;
        for v in missing {
            let k = self.span[v].1;
            self.cross.insert(v, products.columns(at, k).into_owned());
            at += k;
        }
    }

    /// The columns of a variant.
    pub(super) fn columns(&self, variant: usize) -> Range<usize> {
        let (at, k) = self.span[variant];
        at..at + k
    }

    /// Puts another shape in the place of a variant.
    pub fn replace(&mut self, session: &Session, filter: &Filter, variant: usize, shape: &Shape) {
        let columns = self.whitened(session, filter, shape);
        let (at, k) = self.span[variant];
        for (j, column) in columns.iter().enumerate().take(k) {
            let norm = column.iter().map(|v| v * v).sum::<f64>().sqrt();
            self.norm[at + j] = norm;
            let scale = if norm > 0.0 { 1.0 / norm } else { 0.0 };
            for (i, v) in column.iter().enumerate() {
                self.w[(at + j, i)] = v * scale;
            }
        }
        let changed = self.w.rows(at, k).transpose();
        self.b.rows_mut(at, k).copy_from(&changed.tr_mul(&self.y));
        self.own[variant] = changed.tr_mul(&changed).as_slice().to_vec();
        // of the products of the others those with these columns alone are new
        self.cross.remove(&variant);
        for (other, products) in &mut self.cross {
            let (first, n) = self.span[*other];
            let others = self.w.rows(first, n).transpose();
            products.rows_mut(at, k).copy_from(&changed.tr_mul(&others));
        }
    }

    /// How far effects vary.
    #[must_use]
    pub const fn variation(&self) -> Option<&Variation> {
        self.variation.as_ref()
    }

    /// What varies smoothly over the volume and no effect describes.
    #[must_use]
    pub const fn discrepancy(&self) -> Option<&LowRank> {
        self.discrepancy.as_ref()
    }

    /// Takes the variation of effects for noise, in the place of the one before.
    pub fn vary(&mut self, variation: Option<Variation>) {
        self.leave_variation();
        self.join_variation(variation);
    }

    /// Takes a discrepancy and a variation of effects beside it for noise, in the place of those before.
    pub fn join(&mut self, discrepancy: Option<LowRank>, variation: Option<Variation>) {
        self.leave_variation();
        if self.discrepancy != discrepancy {
            if let Some(old) = self.discrepancy.take() {
                old.turn_all(&mut self.w, &mut self.y, true);
            }
            if let Some(new) = &discrepancy {
                new.turn_all(&mut self.w, &mut self.y, false);
            }
            self.discrepancy = discrepancy;
        }
        self.join_variation(variation);
    }

    /// Columns and gap as they were before the variation; of unit length once another one has joined.
    fn leave_variation(&mut self) {
        if let Some(old) = self.variation.take() {
            old.noise.turn_all(&mut self.w, &mut self.y, true);
        }
    }

    fn join_variation(&mut self, variation: Option<Variation>) {
        if let Some(new) = &variation {
            new.noise.turn_all(&mut self.w, &mut self.y, false);
        }
        self.variation = variation;
        let norm = &self.norm;
        let scaled = Scaled::to_unit_length(&mut self.w, &self.y, &self.span, |j, _| norm[j] > 0.0);
        self.norm.iter_mut().zip(&scaled.length).for_each(|(n, l)| *n *= l);
        (self.b, self.own) = (scaled.b, scaled.own);
        self.cross.clear();
    }

    /// The columns of one shape, whitened.
    #[must_use]
    pub fn whitened(&self, session: &Session, filter: &Filter, shape: &Shape) -> Vec<Vec<f64>> {
        let k = shape.width();
        let mut data = filter.mean(raw(session, &filter.members(), &[shape]), k);
        self.whiten(filter, &mut data, k);
        (0..k).map(|j| data.iter().skip(j).step_by(k).copied().collect()).collect()
    }

    /// Whitens columns, a row of `width` values per row of the problem, in place.
    pub fn whiten(&self, filter: &Filter, data: &mut [f64], width: usize) {
        self.whiten_beside(filter, data, width);
        self.whiten_by(self.variation.as_ref().map(|v| &v.noise), data, width);
    }

    /// The same without the variation of effects.
    pub(super) fn whiten_beside(&self, filter: &Filter, data: &mut [f64], width: usize) {
        filter.apply(data, width);
        self.whiten_by(self.discrepancy.as_ref(), data, width);
    }

    fn whiten_by(&self, noise: Option<&LowRank>, data: &mut [f64], width: usize) {
        let Some(noise) = noise else { return };
        for j in 0..width {
            let mut column = DVector::from_iterator(self.len(), data.iter().skip(j).step_by(width).copied());
            noise.apply(&mut column);
            data.iter_mut().skip(j).step_by(width).zip(column.iter()).for_each(|(d, c)| *d = *c);
        }
    }

    /// Some vectors without what the given columns say.
    #[must_use]
    pub fn beside(&self, given: &Given, some: &DMatrix<f64>) -> DMatrix<f64> {
        let columns = self.w.select_rows(&given.columns);
        let products = &columns * some;
        let mut out = some.clone();
        for (mut o, p) in out.column_iter_mut().zip(products.column_iter()) {
            let known = DVector::from_vec(given.factor.solve(p.as_slice()));
            o.gemv_tr(-1.0, &columns, &known, 1.0);
        }
        out
    }

    /// What is known once the columns of `chosen` (prepared) are in.
    #[must_use]
    pub fn given(&self, chosen: &[usize]) -> Given {
        self.given_among(chosen, 0..self.b.len())
    }

    /// The same, for questions about some columns alone.
    fn given_among(&self, chosen: &[usize], among: Range<usize>) -> Given {
        let columns: Vec<usize> = chosen.iter().flat_map(|v| self.columns(*v)).collect();
        let n = columns.len();
        let width = among.len();
        // products of each chosen column with all columns
        let products: Vec<&[f64]> = chosen
            .iter()
            .filter_map(|v| self.cross.get(v))
            .flat_map(|c| c.as_slice().chunks_exact(self.b.len()))
            .collect();
        let mut small = vec![0.0; n * n];
        for (row, products) in small.chunks_exact_mut(n.max(1)).zip(&products) {
            for (v, c) in row.iter_mut().zip(&columns) {
                *v = products[*c];
            }
        }
        let full: Vec<f64> = columns.iter().map(|c| if self.norm[*c] > 0.0 { 1.0 } else { 0.0 }).collect();
        let factor = Factor::new(n, &small, &full);
        let own: Vec<f64> = columns.iter().map(|c| self.b[*c]).collect();
        let z = factor.forward(&own);
        // L^-1 G row by row
        let mut a = vec![0.0; n * width];
        for (i, products) in products.iter().enumerate() {
            let (before, rest) = a.split_at_mut(i * width);
            factor.row_forward(i, &products[among.clone()], before, &mut rest[..width]);
        }
        let mut b = self.b.as_slice()[among.clone()].to_vec();
        for (a, z) in a.chunks_exact(width.max(1)).zip(&z) {
            b.iter_mut().zip(a).for_each(|(b, a)| *b -= a * z);
        }
        Given { columns, factor, a, b, among, explained: z.iter().map(|v| v * v).sum() }
    }

    /// What a variant brings beside those of `chosen` (prepared): drop of the sum of squares, and the number of its independent columns.
    #[must_use]
    pub fn gain_beside(&self, chosen: &[usize], variant: usize) -> (f64, usize) {
        self.gain(&self.given_among(chosen, self.columns(variant)), variant)
    }

    /// Drop of the sum of squares by a variant beside what is given, and the number of its independent columns.
    #[must_use]
    pub fn gain(&self, given: &Given, variant: usize) -> (f64, usize) {
        let (at, k) = self.span[variant];
        let first = at - given.among.start;
        self.gain_in(variant, &self.conditional(given, variant), &given.b[first..first + k])
    }

    /// The same from the products of its columns with each other and with the gap, beside what is in.
    pub(super) fn gain_in(&self, variant: usize, g: &[f64], b: &[f64]) -> (f64, usize) {
        let full: Vec<f64> =
            self.columns(variant).map(|c| if self.norm[c] > 0.0 { 1.0 } else { 0.0 }).collect();
        let factor = Factor::new(full.len(), g, &full);
        (factor.gain(b), factor.rank())
    }

    /// Drop of the sum of squares of any signal by a variant alone; `products` are those of all columns with the signal.
    #[must_use]
    pub fn gain_of(&self, variant: usize, products: &[f64]) -> f64 {
        self.gain_in(variant, &self.own[variant], &products[self.columns(variant)]).0
    }

    /// Products of the columns of a variant with each other beside what is given, row by row.
    pub(super) fn conditional(&self, given: &Given, variant: usize) -> Vec<f64> {
        let (at, k) = self.span[variant];
        let mut g = self.own[variant].clone();
        let first = at - given.among.start;
        for row in given.a.chunks_exact(given.among.len().max(1)) {
            let a = &row[first..first + k];
            for i in 0..k {
                for j in 0..k {
                    g[i * k + j] -= a[i] * a[j];
                }
            }
        }
        g
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

    /// Cosine of what two effects of a joint fit contribute: negative where each takes back what the other says.
    #[must_use]
    pub fn cosine(&self, given: &Given, pair: [usize; 2]) -> f64 {
        let beta = self.fit(given);
        let [a, b] = pair.map(|v| self.part(given, &beta, v));
        a.dot(&b) / (a.norm() * b.norm()).max(f64::MIN_POSITIVE)
    }

    /// What the columns contribute to every row.
    #[must_use]
    pub fn contribution(&self, columns: &[usize], beta: &[f64]) -> DVector<f64> {
        let mut out = DVector::zeros(self.len());
        for (row, o) in self.w.column_iter().zip(out.iter_mut()) {
            *o = columns.iter().zip(beta).map(|(c, b)| row[*c] * b).sum();
        }
        out
    }
}

/// What is left of everything once some columns are in.
pub struct Given {
    /// The columns that are in.
    pub columns: Vec<usize>,
    pub(super) factor: Factor,
    a: Vec<f64>,
    b: Vec<f64>,
    /// Columns of which `a` and `b` tell.
    among: Range<usize>,
    /// Drop of the sum of squares by all of them.
    pub explained: f64,
}

impl Given {
    /// Products of the gap with the columns that it tells of, beside what is in.
    pub(super) fn left(&self) -> &[f64] {
        &self.b
    }

    /// Coefficients of the columns that it tells of on each column that is in, row by row; zero on those that depend on others.
    pub(super) fn coefficients(&self) -> Vec<f64> {
        let mut rows = self.a.clone();
        self.factor.backward_rows(&mut rows, self.among.len());
        rows
    }

    /// Covariance of the parameters in the whitened scale, row by row.
    #[must_use]
    pub fn covariance(&self, problem: &Problem) -> Vec<f64> {
        let left = (problem.y.norm_squared() - self.explained) / problem.len().max(1) as f64;
        // more scatter than the noise model knows widens what is said of the parameters
        self.factor.inverse().into_iter().map(|v| v * left.max(1.0)).collect()
    }
}

/// Most columns of a variant whose products are summed reading by reading.
const WIDE: usize = 5;

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
        // of wide variants a product of matrices, of narrow ones sums in one pass over all
        let product = |(at, k): &(usize, usize)| {
            let columns = w.rows(*at, *k);
            (columns * columns.transpose()).as_slice().to_vec()
        };
        let begin = |s: &(usize, usize)| if s.1 > WIDE { product(s) } else { vec![0.0; s.1 * s.1] };
        let mut own: Vec<Vec<f64>> = span.iter().map(begin).collect();
        let mut b = DVector::zeros(w.nrows());
        for (row, y) in w.column_iter().zip(y.iter()) {
            let row = row.as_slice();
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
        let square = own.iter().zip(span).flat_map(|(g, (_, k))| (0..*k).map(move |i| g[i * k + i]));
        let length: Vec<f64> = square
            .enumerate()
            .map(|(j, square)| if square > 0.0 && seen(j, square) { square.sqrt() } else { 0.0 })
            .collect();
        let scale: Vec<f64> = length.iter().map(|l| if *l > 0.0 { 1.0 / l } else { 0.0 }).collect();
        for mut row in w.column_iter_mut() {
            row.iter_mut().zip(&scale).for_each(|(v, s)| *v *= s);
        }
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
        let n = y.len();
        let ends = variants.iter().scan(0, |at, v| {
            *at += v.len();
            Some(*at)
        });
        let span: Vec<(usize, usize)> = ends.zip(variants).map(|(end, v)| (end - v.len(), v.len())).collect();
        let Scaled { length, b, own } = Scaled::to_unit_length(&mut w, &y, &span, |_, _| true);
        Self {
            rows: (0..n).collect(),
            b,
            own,
            norm: length,
            seen: vec![1.0; span.len()],
            y,
            w,
            span,
            cell: vec![0; n],
            cells: 1,
            places: Vec::new(),
            block: vec![0; n],
            blocks: 1,
            precise: false,
            discrepancy: None,
            variation: None,
            cross: BTreeMap::new(),
        }
    }
}
