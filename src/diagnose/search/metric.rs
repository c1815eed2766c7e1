//! The columns of a problem in the metric of all its noise: whitened by the filter once, and by noise of low rank as it joins and leaves,
//! by way of their products.

use std::collections::BTreeMap;
use std::ops::Range;

use nalgebra::{DMatrix, DMatrixView, DVector, DVectorView};

use super::super::library::Shape;
use super::super::noise::Filter;
use super::super::session::Session;
use super::beside::Columns;
use super::low_rank::{Joined, product};
use super::problem::{LEAST, Problem};
use super::raw_columns::raw;
use super::structure::Structure;
use super::variation::Variation;

/// Columns and gap, whitened by the filter alone.
pub(super) struct Plain {
    /// Columns of length 1, one matrix column per row of the problem.
    pub(super) w: DMatrix<f64>,
    pub(super) y: DVector<f64>,
    pub(super) norm: Vec<f64>,
    pub(super) b: DVector<f64>,
    pub(super) own: Vec<Vec<f64>>,
    pub(super) cross: BTreeMap<usize, DMatrix<f64>>,
}

impl Problem {
    /// Products of the columns of some variants with all columns, in one pass over the columns.
    pub fn prepare(&mut self, variants: &[usize]) {
        let mut missing: Vec<usize> =
            variants.iter().copied().filter(|v| !self.plain.cross.contains_key(v)).collect();
        missing.sort_unstable();
        missing.dedup();
        let columns: Vec<usize> = missing.iter().flat_map(|v| self.columns(*v)).collect();
        if !columns.is_empty() {
            let products = product(&self.plain.w.as_view(), &self.plain.w.select_rows(&columns).transpose());
            let mut at = 0;
            for v in missing {
                let k = self.span[v].1;
                self.plain.cross.insert(v, products.columns(at, k).into_owned());
                at += k;
            }
        }
        for v in variants {
            if !self.cross.contains_key(v) {
                self.cross.insert(*v, self.cross_of(*v, 0..self.unit.len()));
            }
        }
    }

    /// Products of the columns of a variant, whose plain ones are known, with some columns beside the noise that joined.
    fn cross_of(&self, variant: usize, some: Range<usize>) -> DMatrix<f64> {
        let (plain, own) = (&self.plain.cross[&variant], self.columns(variant));
        DMatrix::from_fn(some.len(), own.len(), |i, j| {
            let (a, b) = (some.start + i, own.start + j);
            self.unit[a] * self.unit[b] * (plain[(a, j)] - self.taken([a, b]))
        })
    }

    /// What the noise that joined takes of the plain product of two columns.
    fn taken(&self, columns: [usize; 2]) -> f64 {
        self.joined.iter().map(|n| n.of_columns(columns)).sum()
    }

    /// Whitens columns by the noise that joined, a row of values per row of the problem, in place.
    fn turn(&self, data: &mut [f64]) {
        self.joined.iter().for_each(|n| n.turn(data));
    }

    /// Length, products with the gap and Gram matrix of the columns of a variant beside the noise that joined.
    fn measure(&mut self, variant: usize) {
        let (at, k) = self.span[variant];
        let plain = &self.plain.own[variant];
        let mut own: Vec<f64> = (0..k * k).map(|n| plain[n] - self.taken([at + n / k, at + n % k])).collect();
        for i in 0..k {
            let c = at + i;
            let length = if own[i * k + i] > LEAST { own[i * k + i].sqrt() } else { 0.0 };
            self.norm[c] = self.plain.norm[c] * length;
            self.unit[c] = if length > 0.0 { 1.0 / length } else { 0.0 };
            let of_gap: f64 = self.joined.iter().map(|n| n.of_gap(c)).sum();
            self.b[c] = self.unit[c] * (self.plain.b[c] - of_gap);
        }
        own.iter_mut().enumerate().for_each(|(n, g)| *g *= self.unit[at + n / k] * self.unit[at + n % k]);
        self.own[variant] = own;
    }

    pub(super) fn measure_all(&mut self) {
        (0..self.span.len()).for_each(|v| self.measure(v));
    }

    /// Products of some whitened vectors, a value per row of the problem each, with all columns; a matrix column each.
    pub fn products(&self, some: &DMatrix<f64>) -> DMatrix<f64> {
        let mut turned = some.transpose();
        self.joined.iter().rev().for_each(|n| n.turn(turned.as_mut_slice()));
        let mut products = product(&self.plain.w.as_view(), &turned.transpose());
        products.row_iter_mut().zip(&self.unit).for_each(|(mut row, unit)| row *= *unit);
        products
    }

    /// Whitened columns of length 1, a matrix row each and a matrix column per row of the problem.
    #[must_use]
    pub fn whitened_rows(&self, columns: &[usize]) -> DMatrix<f64> {
        let (mut rows, _) = self.filtered(columns);
        self.turn(rows.as_mut_slice());
        rows
    }

    /// Columns in the scale of [`Problem::whitened_rows`], a matrix row each, and the gap, whitened by the filter alone.
    #[must_use]
    pub fn filtered(&self, columns: &[usize]) -> (DMatrix<f64>, &DVector<f64>) {
        let mut rows = self.plain.w.select_rows(columns);
        rows.row_iter_mut().zip(columns).for_each(|(mut row, c)| row *= self.unit[*c]);
        (rows, &self.plain.y)
    }

    /// Columns that the filter has whitened, a matrix column each, whitened by the noise that joined as well.
    #[must_use]
    pub fn turned(&self, filtered: &DMatrix<f64>) -> DMatrix<f64> {
        let mut rows = filtered.transpose();
        self.turn(rows.as_mut_slice());
        rows.transpose()
    }

    /// Puts another shape in the place of a variant.
    pub fn replace(&mut self, session: &Session, filter: &Filter, variant: usize, shape: &Shape) {
        let width = shape.width();
        let mut data = filter.mean(raw(session, &filter.members(), &[shape]), width);
        filter.apply(&mut data, width);
        let (at, k) = self.span[variant];
        let mut changed = DMatrixView::from_slice(&data, width, self.len()).rows(0, k).transpose();
        for (j, mut column) in changed.column_iter_mut().enumerate() {
            let norm = column.norm();
            if norm > 0.0 {
                column /= norm;
            }
            self.plain.norm[at + j] = norm;
            self.plain.w.set_row(at + j, &column.transpose());
            self.joined.iter_mut().for_each(|n| n.replace(at + j, &column.as_view()));
        }
        self.plain.b.rows_mut(at, k).copy_from(&changed.tr_mul(&self.plain.y));
        self.plain.own[variant] = changed.tr_mul(&changed).as_slice().to_vec();
        // of the products of the others those with these columns alone are new
        self.plain.cross.remove(&variant);
        for (other, products) in &mut self.plain.cross {
            let (first, n) = self.span[*other];
            let others = self.plain.w.rows(first, n).transpose();
            products.rows_mut(at, k).copy_from(&changed.tr_mul(&others));
        }
        self.measure(variant);
        self.cross.remove(&variant);
        let known: Vec<usize> = self.cross.keys().copied().collect();
        for other in known {
            let new = self.cross_of(other, at..at + k);
            if let Some(products) = self.cross.get_mut(&other) {
                products.rows_mut(at, k).copy_from(&new);
            }
        }
    }

    /// How far effects vary.
    #[must_use]
    pub const fn variation(&self) -> Option<&Variation> {
        self.structure.variation.as_ref()
    }

    /// What has joined the noise.
    #[must_use]
    pub const fn structure(&self) -> &Structure {
        &self.structure
    }

    /// Takes the variation of effects for noise, in the place of the one before.
    pub fn vary(&mut self, variation: Option<Variation>) {
        self.join(Structure { variation, ..self.structure.clone() });
    }

    /// Adds to the gap what a variant contributes, `amounts` of its parameters in their units. Products of the columns are to be prepared
    /// anew.
    pub fn add_to_gap(&mut self, variant: usize, amounts: &[f64]) {
        let (at, k) = self.span[variant];
        let scaled = DVector::from_fn(k, |j, _| amounts[j] * self.plain.norm[at + j]);
        self.plain.y.gemv_tr(1.0, &self.plain.w.rows(at, k), &scaled, 1.0);
        let y = DMatrix::from_column_slice(self.len(), 1, self.plain.y.as_slice());
        self.plain.b.copy_from(&product(&self.plain.w.as_view(), &y).column(0));
        self.joined.clear();
        self.join(self.structure.clone());
    }

    /// Takes structure for noise, in the place of that before.
    pub fn join(&mut self, structure: Structure) {
        let stay = self.joined.iter().zip(structure.noises()).take_while(|(j, noise)| j.noise() == *noise);
        let stay = stay.count();
        self.joined.truncate(stay);
        for noise in structure.noises().skip(stay) {
            let joined = Joined::new(noise.clone(), &self.joined, &self.plain.w, &self.plain.y);
            self.joined.push(joined);
        }
        self.structure = structure;
        let mut y = self.plain.y.clone();
        self.turn(y.as_mut_slice());
        self.y = y;
        self.measure_all();
        self.cross.clear();
    }

    /// The columns of some shapes, to compare beside effects that stay.
    #[must_use]
    pub(super) fn columns_of(&self, session: &Session, filter: &Filter, shapes: &[&Shape]) -> Columns {
        let width = shapes.iter().map(|s| s.width()).sum();
        let mut data = filter.mean(raw(session, &filter.members(), shapes), width);
        filter.apply(&mut data, width);
        for noise in &self.joined {
            let along = noise.along(&DMatrixView::from_slice(&data, width, self.len()));
            data.extend_from_slice(along.as_slice());
        }
        Columns::from_vec(width, data.len() / width.max(1), data)
    }

    /// Columns of the problem and the gap, the last, in the same form.
    pub(super) fn columns_and_gap(&self, columns: &[usize]) -> Columns {
        let mut data = self.plain.w.select_rows(columns).insert_row(columns.len(), 0.0);
        data.row_mut(columns.len()).copy_from(&self.plain.y.transpose());
        for noise in &self.joined {
            let along = noise.along_of(columns);
            let at = data.ncols();
            data = data.insert_columns(at, along.ncols(), 0.0);
            data.columns_mut(at, along.ncols()).copy_from(&along);
        }
        data.row_iter_mut().zip(columns).for_each(|(mut row, c)| row *= self.unit[*c]);
        data
    }

    /// Whitens columns, a row of `width` values per row of the problem, in place.
    pub fn whiten(&self, filter: &Filter, data: &mut [f64], width: usize) {
        filter.apply(data, width);
        self.turn(data);
    }

    /// The same without the variation of effects.
    pub(super) fn whiten_beside(&self, filter: &Filter, data: &mut [f64], width: usize) {
        filter.apply(data, width);
        self.structure.lasting().for_each(|noise| noise.turn(data, false));
    }

    /// What the columns contribute to every row.
    #[must_use]
    pub fn contribution(&self, columns: &[usize], beta: &[f64]) -> DVector<f64> {
        let scaled: Vec<(usize, f64)> =
            columns.iter().zip(beta).map(|(c, b)| (*c, b * self.unit[*c])).collect();
        let sum = |row: DVectorView<'_, f64>| scaled.iter().map(|(c, b)| row[*c] * b).sum();
        let mut out = DVector::from_iterator(self.len(), self.plain.w.column_iter().map(sum));
        self.turn(out.as_mut_slice());
        out
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::noise::Random;
    use super::super::beside::Beside;
    use super::super::low_rank::LowRank;
    use super::*;

    const N: usize = 60;

    #[test]
    fn noise_that_joins_changes_products_as_if_every_column_were_turned() {
        let mut random = Random::new(11);
        let mut column = || DVector::from_fn(N, |_, _| random.normal());
        let effects: Vec<Vec<DVector<f64>>> =
            [1, 3, 2].iter().map(|k| (0..*k).map(|_| column()).collect()).collect();
        let y = column();
        let mut noise = |n: usize| {
            LowRank::of(&DMatrix::from_columns(&(0..n).map(|_| column()).collect::<Vec<_>>()), &vec![0.4; n])
        };
        let (first, second) = (noise(4), noise(3));
        let mut problem = Problem::made_up(&effects, y.clone());
        problem.prepare(&[1]);
        problem.join(Structure {
            discrepancy: Some(first.clone()),
            variation: Some(Variation::made_up(second.clone())),
            ..Structure::default()
        });
        problem.prepare(&[1, 2]);
        let turned = |v: &DVector<f64>| {
            let mut v = v.clone();
            [&first, &second].iter().for_each(|n| n.turn(v.as_mut_slice(), false));
            v
        };
        let columns: Vec<DVector<f64>> = effects.iter().flatten().map(|c| turned(c).normalize()).collect();
        let close = |a: f64, b: f64| assert!((a - b).abs() < 1e-9, "{a} {b}");
        let gap = turned(&y);
        (0..N).for_each(|i| close(problem.y[i], gap[i]));
        let rows = problem.whitened_rows(&[0, 4]);
        (0..N).for_each(|i| close(rows[(1, i)], columns[4][i]));
        for (c, column) in columns.iter().enumerate() {
            close(problem.b[c], column.dot(&gap));
            close(problem.norm[c], turned(&effects.iter().flatten().nth(c).unwrap().clone()).norm());
            close(problem.cross[&1][(c, 2)], column.dot(&columns[3]));
            close(problem.cross[&2][(c, 0)], column.dot(&columns[4]));
        }
        close(problem.own[1][1], columns[1].dot(&columns[2]));
        let other = turned(&y);
        let products = problem.products(&DMatrix::from_column_slice(N, 1, other.as_slice()));
        columns.iter().enumerate().for_each(|(c, column)| close(products[(c, 0)], column.dot(&other)));
        problem.prepare(&[0]);
        let columns = problem.columns_and_gap(&[1, 2, 3]).remove_row(3);
        let beside = Beside::new(&problem, &[0]).says(&columns).0;
        let wanted = problem.gain_beside(&[0], 1);
        close(beside.0, wanted.0);
        assert_eq!(beside.1, wanted.1);
        // without it everything is as before
        problem.join(Structure::default());
        problem.prepare(&[1]);
        close(problem.cross[&1][(0, 0)], effects[0][0].normalize().dot(&effects[1][0].normalize()));
        close(problem.b[5], effects[2][1].normalize().dot(&y));
    }
}
