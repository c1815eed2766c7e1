//! The whitened problem: every candidate column and the gap as independent innovations of unit variance.

use std::borrow::Cow;
use std::collections::BTreeMap;

use nalgebra::{DMatrix, DVector};

use super::super::constants::{BLOCKS_MIN, MOVES, SEEN};
use super::super::library::{Blind, Library, Shape, WIDTH_MAX};
use super::super::moment::{Axis, Moment, SLOTS, Signal};
use super::super::noise::Filter;
use super::super::session::{Session, is_encoder};
use super::data_partition::{Places, blocks, programs};
use super::low_rank::LowRank;
use super::pivoted_cholesky::Factor;
use super::variation::Variation;
use volcomp_model::geometry::Vec3;

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

/// Raw columns of a library, um per unit of each parameter, a row of values per reading.
pub fn raw_columns(session: &Session, library: &Library, rows: &[usize]) -> Vec<f64> {
    let shapes: Vec<&Shape> = library.variants.iter().map(|v| &v.shape).collect();
    raw(session, rows, &shapes)
}

/// Most values of raw columns that are kept: 256 MB.
const KEPT_MAX: usize = 1 << 25;

/// Raw columns that are the same from one round to the next.
#[derive(Debug, Clone, Default)]
pub struct RawColumns {
    shapes: Vec<Shape>,
    data: Vec<f64>,
}

impl RawColumns {
    /// The columns of a library at the same rows as before; only those of new shapes are computed.
    fn of(&mut self, session: &Session, library: &Library, rows: &[usize]) -> Vec<f64> {
        let width = library.width();
        if self.data.len() != rows.len() * width || self.shapes.len() != library.variants.len() {
            let data = raw_columns(session, library, rows);
            if data.len() <= KEPT_MAX {
                self.shapes = library.variants.iter().map(|v| v.shape.clone()).collect();
                self.data.clone_from(&data);
            }
            return data;
        }
        let mut at = 0;
        for (known, v) in self.shapes.iter_mut().zip(&library.variants) {
            let k = v.shape.width();
            if *known != v.shape {
                let own = raw(session, rows, &[&v.shape]);
                for (row, values) in self.data.chunks_exact_mut(width).zip(own.chunks_exact(k)) {
                    row[at..at + k].copy_from_slice(values);
                }
                *known = v.shape.clone();
            }
            at += k;
        }
        self.data.clone()
    }
}

impl Problem {
    /// Filters gap and columns.
    #[must_use]
    pub fn new(session: &Session, library: &Library, filter: &Filter, gap: &[f64], white_um: &[f64]) -> Self {
        let raw = raw_columns(session, library, &filter.members());
        Self::of_raw(raw, session, library, filter, (gap, white_um))
    }

    /// The same, with raw columns of a round before.
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
        let mut square = vec![0.0; width];
        for column in w.column_iter() {
            for (s, v) in square.iter_mut().zip(column.iter()) {
                *s += v * v;
            }
        }
        let norm: Vec<f64> = square
            .iter()
            .zip(&before)
            .map(|(s, b)| if *s > 1e-9 * b && *s > 0.0 { s.sqrt() } else { 0.0 })
            .collect();
        let scale: Vec<f64> = norm.iter().map(|n| if *n > 0.0 { 1.0 / n } else { 0.0 }).collect();
        for mut column in w.column_iter_mut() {
            for (v, s) in column.iter_mut().zip(&scale) {
                *v *= s;
            }
        }
        let mut span = Vec::with_capacity(library.variants.len());
        let mut seen = Vec::with_capacity(library.variants.len());
        let mut at = 0;
        for v in &library.variants {
            let k = v.shape.width();
            span.push((at, k));
            let (s, b): (f64, f64) = (square[at..at + k].iter().sum(), before[at..at + k].iter().sum());
            seen.push(if b > 0.0 { s / b } else { 0.0 });
            at += k;
        }
        let y = DVector::from_vec(filter.column(gap));
        let b = &w * &y;
        let own = own_grams(&w, &span);
        let (cell, cells) = programs(session, &rows);
        let places = (0..=SLOTS).map(|own| Places::new(session, &rows, &cell, own)).collect();
        let (block, blocks) = blocks(session, &rows, BLOCKS_MIN);
        let precise = session.instruments.iter().all(|n| is_encoder(n));
        Self {
            rows,
            y,
            w,
            span,
            norm,
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

    /// Products of the columns of a variant with all columns.
    pub fn prepare(&mut self, variant: usize) {
        if self.cross.contains_key(&variant) {
            return;
        }
        let (at, k) = self.span[variant];
        let own = self.w.rows(at, k).transpose();
        let product = &self.w * own;
        self.cross.insert(variant, product);
    }

    /// After the columns of a variant have changed.
    fn forget(&mut self) {
        self.cross.clear();
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
        for j in at..at + k {
            self.b[j] = self.w.row(j).iter().zip(self.y.iter()).map(|(a, b)| a * b).sum();
        }
        self.own[variant] = own_grams(&self.w, &self.span[variant..=variant]).swap_remove(0);
        self.forget();
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
        let discrepancy = self.discrepancy.clone();
        self.join(discrepancy, variation);
    }

    /// Takes a discrepancy and a variation of effects beside it for noise, in the place of those before.
    pub fn join(&mut self, discrepancy: Option<LowRank>, variation: Option<Variation>) {
        if let Some(old) = self.variation.take() {
            old.noise.turn_all(&mut self.w, &mut self.y, true);
        }
        if self.discrepancy != discrepancy {
            if let Some(old) = self.discrepancy.take() {
                old.turn_all(&mut self.w, &mut self.y, true);
            }
            if let Some(new) = &discrepancy {
                new.turn_all(&mut self.w, &mut self.y, false);
            }
            self.discrepancy = discrepancy;
        }
        if let Some(new) = &variation {
            new.noise.turn_all(&mut self.w, &mut self.y, false);
        }
        self.variation = variation;
        let mut square = vec![0.0; self.norm.len()];
        for column in self.w.column_iter() {
            for (s, v) in square.iter_mut().zip(column.iter()) {
                *s += v * v;
            }
        }
        let length: Vec<f64> =
            square.iter().zip(&self.norm).map(|(s, n)| if *n > 0.0 { s.sqrt() } else { 0.0 }).collect();
        let scale: Vec<f64> = length.iter().map(|l| if *l > 0.0 { 1.0 / l } else { 0.0 }).collect();
        for mut column in self.w.column_iter_mut() {
            for (v, s) in column.iter_mut().zip(&scale) {
                *v *= s;
            }
        }
        self.norm.iter_mut().zip(&length).for_each(|(n, l)| *n *= l);
        self.b = &self.w * &self.y;
        self.own = own_grams(&self.w, &self.span);
        self.forget();
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
        let columns: Vec<usize> =
            chosen.iter().flat_map(|v| self.span[*v].0..self.span[*v].0 + self.span[*v].1).collect();
        let n = columns.len();
        let width = self.b.len();
        // rows of `g`: products of one chosen column with all columns
        let mut g: Vec<Vec<f64>> = Vec::with_capacity(n);
        for v in chosen {
            if let Some(c) = self.cross.get(v) {
                g.extend(c.column_iter().map(|c| c.iter().copied().collect::<Vec<f64>>()));
            }
        }
        let mut small = vec![0.0; n * n];
        for (row, products) in small.chunks_exact_mut(n.max(1)).zip(&g) {
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
        for (i, products) in g.iter().enumerate() {
            let (before, rest) = a.split_at_mut(i * width);
            let row = &mut rest[..width];
            factor.row_forward(i, products, before, row, width);
        }
        let mut b: Vec<f64> = self.b.iter().copied().collect();
        for i in 0..n {
            for (b, a) in b.iter_mut().zip(&a[i * width..(i + 1) * width]) {
                *b -= a * z[i];
            }
        }
        Given { columns, factor, a, b, width, explained: z.iter().map(|v| v * v).sum() }
    }

    /// Drop of the sum of squares by a variant beside what is given, and the number of its independent columns.
    #[must_use]
    pub fn gain(&self, given: &Given, variant: usize) -> (f64, usize) {
        let (at, k) = self.span[variant];
        let g = self.conditional(given, variant);
        let full: Vec<f64> = (at..at + k).map(|c| if self.norm[c] > 0.0 { 1.0 } else { 0.0 }).collect();
        let factor = Factor::new(k, &g, &full);
        (factor.gain(&given.b[at..at + k]), factor.rank())
    }

    /// Drop of the sum of squares of any signal by a variant alone; `products` are those of all columns with the signal.
    #[must_use]
    pub fn gain_of(&self, variant: usize, products: &[f64]) -> f64 {
        let (at, k) = self.span[variant];
        let full: Vec<f64> = (at..at + k).map(|c| if self.norm[c] > 0.0 { 1.0 } else { 0.0 }).collect();
        Factor::new(k, &self.own[variant], &full).gain(&products[at..at + k])
    }

    fn conditional(&self, given: &Given, variant: usize) -> Vec<f64> {
        let (at, k) = self.span[variant];
        let mut g = self.own[variant].clone();
        for row in given.a.chunks_exact(given.width.max(1)) {
            let a = &row[at..at + k];
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

/// The columns of some shapes, a row of values per reading, um per unit of each parameter.
fn raw(session: &Session, rows: &[usize], shapes: &[&Shape]) -> Vec<f64> {
    let width: usize = shapes.iter().map(|s| s.width()).sum();
    let mut data = vec![0.0; rows.len() * width];
    let (mut out, mut at_zero) = ([Vec3::zeros(); WIDTH_MAX], [Vec3::zeros(); WIDTH_MAX]);
    // what a refined shape reads beyond the signals of the library
    let mut own: Vec<Signal> = shapes.iter().flat_map(|s| s.signals()).cloned().collect();
    own.retain(|s| session.signal(s).is_none());
    let lagged: Vec<Option<Vec<f64>>> =
        own.iter().map(|s| session.history.lagged(s, &session.moments)).collect();
    let known = session.signals.len();
    let at = |s: &Signal| session.signal(s).or_else(|| own.iter().position(|o| o == s).map(|k| known + k));
    let with_own = |i: usize| {
        let m = &session.moments[i];
        if own.is_empty() {
            return Cow::Borrowed(m);
        }
        let values = lagged.iter().map(|l| l.as_ref().map_or(f64::NAN, |l| l[i]));
        let signals = m.signals.iter().copied().chain(values).collect();
        Cow::Owned(Moment { signals, ..m.clone() })
    };
    for (row, i) in data.chunks_exact_mut(width.max(1)).zip(rows) {
        let m = &*with_own(*i);
        let mut values = row.iter_mut();
        for shape in shapes {
            let out = &mut out[..shape.width()];
            out.fill(Vec3::zeros());
            shape.evaluate_with(m, &at, out);
            if let Some((zero, turn)) = session.ball_zero.as_ref().and_then(|z| z.at(*i)) {
                let at_zero = &mut at_zero[..shape.width()];
                at_zero.fill(Vec3::zeros());
                shape.evaluate_with(&with_own(zero), &at, at_zero);
                out.iter_mut().zip(&*at_zero).for_each(|(d, z)| *d -= turn * z);
            }
            // the shorter one first: it must not take a value and then find that it is at its end
            for (d, value) in out.iter().zip(values.by_ref()) {
                let seen = d.dot(&m.u);
                *value = if seen.is_finite() { seen } else { 0.0 };
            }
        }
    }
    data
}

/// What is left of everything once some columns are in.
pub struct Given {
    /// The columns that are in.
    pub columns: Vec<usize>,
    pub(super) factor: Factor,
    a: Vec<f64>,
    b: Vec<f64>,
    width: usize,
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

fn own_grams(w: &DMatrix<f64>, span: &[(usize, usize)]) -> Vec<Vec<f64>> {
    let mut own: Vec<Vec<f64>> = span.iter().map(|(_, k)| vec![0.0; k * k]).collect();
    for row in w.column_iter() {
        let row = row.as_slice();
        for (g, (at, k)) in own.iter_mut().zip(span) {
            let v = &row[*at..at + k];
            for i in 0..*k {
                for j in 0..=i {
                    g[i * k + j] += v[i] * v[j];
                }
            }
        }
    }
    for (g, (_, k)) in own.iter_mut().zip(span) {
        for i in 0..*k {
            for j in 0..i {
                g[j * k + i] = g[i * k + j];
            }
        }
    }
    own
}

#[cfg(test)]
impl Problem {
    /// A problem of columns made up for a test, those of each variant together; one program, one block.
    pub(super) fn made_up(variants: &[Vec<DVector<f64>>], y: DVector<f64>) -> Self {
        let columns: Vec<DVector<f64>> = variants.iter().flatten().map(|c| c / c.norm()).collect();
        let w = DMatrix::from_columns(&columns).transpose();
        let n = y.len();
        let ends = variants.iter().scan(0, |at, v| {
            *at += v.len();
            Some(*at)
        });
        let span: Vec<(usize, usize)> = ends.zip(variants).map(|(end, v)| (end - v.len(), v.len())).collect();
        Self {
            rows: (0..n).collect(),
            b: &w * &y,
            own: own_grams(&w, &span),
            norm: variants.iter().flatten().map(DVector::norm).collect(),
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
