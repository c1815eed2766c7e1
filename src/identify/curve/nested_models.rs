//! Figures of every leading set of columns from one factorisation: residuals and left-out errors in one pass.

use super::data::{Cell, Data};
use super::figures::Sums;
use super::lanes::{Block, LANES, Lane, blocks, shared_out};
use super::solve::{Design, Factor};

/// Figures of the fit with the first `columns` columns.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rung {
    pub(super) columns: usize,
    pub(super) sums: Sums,
}

/// Running products of the rows of the orthogonal factor, per reading: they grow with the columns.
#[derive(Default)]
struct Products {
    /// Each with itself: the leverage.
    own: Lane,
    /// Each with the one after it.
    next: Lane,
    fitted: Lane,
}

impl Products {
    fn add(&mut self, q: &Lane, z: f64) {
        self.own.iter_mut().zip(q).for_each(|(own, q)| *own += q * q);
        self.fitted.iter_mut().zip(q).for_each(|(fitted, q)| *fitted += q * z);
        self.next.iter_mut().zip(q).zip(&q[1..]).for_each(|((next, a), b)| *next += a * b);
    }
}

impl Factor {
    /// Goes through the data once; for each rung, in growing order, the sums of its residuals and left-out errors.
    pub(super) fn nested_fits(&self, data: &Data, design: &Design<'_>, rungs: &[usize]) -> Vec<Rung> {
        let parts = shared_out(data, |first, cells| self.nested_sums(data, design, rungs, first, cells));
        let mut found: Vec<Rung> =
            rungs.iter().map(|&columns| Rung { columns, sums: Sums::default() }).collect();
        for part in parts {
            found.iter_mut().zip(part).for_each(|(rung, sums)| rung.sums.join(&sums));
        }
        found
    }

    /// The same over some cells, the first of which is `first`.
    fn nested_sums(
        &self,
        data: &Data,
        design: &Design<'_>,
        rungs: &[usize],
        mut first: usize,
        cells: &[Cell],
    ) -> Vec<Sums> {
        let mut found = vec![Sums::default(); rungs.len()];
        // a recurrence needs the first polynomial alone, which is 1
        let (mut row, mut columns) = (vec![0.0; design.len()], vec![[1.0; LANES]; design.len()]);
        for block in blocks(data, cells) {
            let s = design.reduced(&block.positions);
            if self.q.is_none() && self.recurrence.is_empty() {
                design.rows(&block.positions, &block.signs, &mut row, &mut columns);
            }
            let (mut before, mut q) = ([0.0; LANES], [0.0; LANES]);
            let mut products = Products::default();
            let mut done = 0;
            for (sums, &end) in found.iter_mut().zip(rungs) {
                for j in done..end {
                    let next = match j.checked_sub(1).and_then(|last| self.recurrence.get(last)) {
                        Some(recurrence) => recurrence.next(&s, &q, &before),
                        None => self.orthogonal(&block, first, &columns, j),
                    };
                    (before, q) = (q, next);
                    products.add(&q, self.z[j]);
                }
                done = done.max(end);
                add_block(data, &block, &products, sums);
            }
            first += block.cells.len();
        }
        found
    }

    /// Column `j` of the orthogonal factor for the cells of a block, the first of which is `first`, per reading.
    #[inline]
    fn orthogonal(&self, block: &Block<'_>, first: usize, columns: &[Lane], j: usize) -> Lane {
        if let Some(all) = &self.q {
            return core::array::from_fn(|lane| match block.cells.get(lane) {
                Some(cell) => all[(first + lane, j)] / cell.count.sqrt(),
                None => 0.0,
            });
        }
        let mut sum = [0.0; LANES];
        let n = self.inverse.nrows();
        let factors = &self.inverse.as_slice()[j * n..j * n + j + 1];
        for (factor, column) in factors.iter().zip(columns) {
            sum.iter_mut().zip(column).for_each(|(sum, value)| *sum += factor * value);
        }
        sum
    }
}

/// Adds the positions of a block, their readings left out one by one and all together.
fn add_block(data: &Data, block: &Block<'_>, products: &Products, sums: &mut Sums) {
    let mut lane = 0;
    for cells in block.cells.chunk_by(|a, b| a.group == b.group) {
        for (i, cell) in cells.iter().enumerate() {
            sums.add(cell, products.fitted[lane + i], products.own[lane + i]);
        }
        if data.is_inner(cells[0].group) {
            leave_position_out(cells, lane, products, sums);
        }
        lane += cells.len();
    }
}

fn leave_position_out(cells: &[Cell], lane: usize, products: &Products, sums: &mut Sums) {
    let error = |i: usize| cells[i].mean - products.fitted[lane + i];
    let own = |i: usize| -> f64 { products.own[lane + i] };
    let [a, b] = cells else {
        sums.left_out(&cells[0], error(0) / (1.0 - own(0) * cells[0].count).max(0.0));
        return;
    };
    // d = (I - K W)^-1 e with the two cells of this position
    let across = products.next[lane];
    let (m00, m01) = (1.0 - own(0) * a.count, -across * b.count);
    let (m10, m11) = (-across * a.count, 1.0 - own(1) * b.count);
    let det = m00 * m11 - m01 * m10;
    sums.left_out(a, (m11 * error(0) - m01 * error(1)) / det);
    sums.left_out(b, (m00 * error(1) - m10 * error(0)) / det);
}
