//! Cells side by side: what is the same for every row of the design is done for several at once.

use rayon::prelude::*;

use super::data::{Cell, Data};

/// Cells of a block.
pub(super) const LANES: usize = 8;

/// One number of each cell of a block.
pub(super) type Lane = [f64; LANES];

/// A few whole positions, cell by cell; lanes without a cell have the place of the last one and count nothing.
pub(super) struct Block<'a> {
    /// The cells.
    pub(super) cells: &'a [Cell],
    pub(super) positions: Lane,
    /// `+1` forward, `-1` reverse.
    pub(super) signs: Lane,
    pub(super) counts: Lane,
    pub(super) means: Lane,
}

/// Cells of one share of a pass over the data.
const SHARE: usize = 1 << 12;

/// Calls `part` with the first cell and the cells of each share of the data, shares side by side; results in order. Shares do not
/// depend on the number of processors, and no position is divided between two.
pub(super) fn shared_out<T: Send>(data: &Data, part: impl Fn(usize, &[Cell]) -> T + Sync) -> Vec<T> {
    // no thread is started for what one does as fast
    if data.cells.len() <= SHARE {
        return vec![part(0, &data.cells)];
    }
    let mut bounds = vec![0];
    let (mut first, all) = (0, data.cells.len());
    while first < all {
        let end = (first + SHARE).min(all);
        // both directions of a position stay together
        first = end - usize::from(end < all && data.cells[end].group == data.cells[end - 1].group);
        bounds.push(first);
    }
    bounds.par_windows(2).map(|ends| part(ends[0], &data.cells[ends[0]..ends[1]])).collect()
}

/// Some of the cells of `data` in blocks that no position is divided between.
pub(super) fn blocks<'a>(data: &'a Data, cells: &'a [Cell]) -> impl Iterator<Item = Block<'a>> {
    let mut rest = cells;
    core::iter::from_fn(move || {
        let mut count = rest.len().min(LANES);
        if count == 0 {
            return None;
        }
        // both directions of a position stay together
        if rest.get(count).is_some_and(|next| next.group == rest[count - 1].group) {
            count -= 1;
        }
        let (cells, after) = rest.split_at(count);
        rest = after;
        let of = |lane: usize| &cells[lane.min(count - 1)];
        let counted = |lane: usize, value: f64| if lane < count { value } else { 0.0 };
        Some(Block {
            cells,
            positions: core::array::from_fn(|lane| data.positions[of(lane).group]),
            signs: core::array::from_fn(|lane| of(lane).sign()),
            counts: core::array::from_fn(|lane| counted(lane, of(lane).count)),
            means: core::array::from_fn(|lane| counted(lane, of(lane).mean)),
        })
    })
}

/// `T_0(s) f`, `T_1(s) f`, ..
pub(super) fn chebyshev_lanes(s: &Lane, factor: &Lane, columns: &mut [Lane]) {
    each_chebyshev(s, factor, columns, |column, value| *column = value);
}

/// Adds `T_0(s) f`, `T_1(s) f`, .. to as many sums, lane by lane.
pub(super) fn add_chebyshev(s: &Lane, factor: &Lane, sums: &mut [Lane]) {
    each_chebyshev(s, factor, sums, |sum, value| {
        for lane in 0..LANES {
            sum[lane] += value[lane];
        }
    });
}

#[inline]
fn each_chebyshev(s: &Lane, factor: &Lane, to: &mut [Lane], put: impl Fn(&mut Lane, Lane)) {
    let mut a = *factor;
    let mut b: Lane = core::array::from_fn(|lane| s[lane] * factor[lane]);
    let twice = s.map(|s| 2.0 * s);
    for to in to {
        put(to, a);
        let next = core::array::from_fn(|lane| twice[lane] * b[lane] - a[lane]);
        (a, b) = (b, next);
    }
}

#[cfg(test)]
mod tests {
    use super::super::basis::chebyshev;
    use super::*;
    use crate::Reading;
    use volcomp_units::axes::Travel;

    #[test]
    fn every_cell_comes_once_and_positions_stay_whole() {
        // one direction here and there, so that pairs fall on every lane
        let all: Vec<Reading> = (0..61)
            .flat_map(|i| [(i, Travel::Forward), (i, Travel::Reverse)])
            .filter(|(i, travel)| i % 5 != 3 || *travel == Travel::Forward)
            .map(|(i, travel)| Reading { cycle: 0, travel, position: f64::from(i), value: f64::from(i * i) })
            .collect();
        let data = Data::new(&all, None).unwrap();
        let mut next = 0;
        for block in blocks(&data, &data.cells) {
            for (lane, cell) in block.cells.iter().enumerate() {
                let own = &data.cells[next];
                assert_eq!((cell.group, cell.travel), (own.group, own.travel));
                assert_eq!(block.positions[lane], data.positions[own.group]);
                assert_eq!((block.signs[lane], block.means[lane]), (own.sign(), own.mean));
                next += 1;
            }
            assert_eq!(block.counts.iter().sum::<f64>(), block.cells.len() as f64);
            let last = block.cells[block.cells.len() - 1].group;
            assert!(data.cells.get(next).is_none_or(|c| c.group != last));
        }
        assert_eq!(next, data.cells.len());
    }

    #[test]
    fn shares_hold_every_cell_once_and_positions_whole() {
        // an odd cell first, so that pairs lie across the bounds
        let all: Vec<Reading> = (0..3 * SHARE)
            .flat_map(|i| [(i, Travel::Forward), (i, Travel::Reverse)])
            .skip(1)
            .map(|(i, travel)| Reading { cycle: 0, travel, position: i as f64, value: 1.0 })
            .collect();
        let data = Data::new(&all, None).unwrap();
        let shares = shared_out(&data, |first, cells| (first, cells.len(), cells[0].group));
        assert!(shares.len() > 3);
        let mut next = 0;
        for (first, count, group) in shares {
            assert_eq!((first, group), (next, data.cells[next].group));
            next += count;
            assert!(data.cells.get(next).is_none_or(|c| c.group != data.cells[next - 1].group));
        }
        assert_eq!(next, data.cells.len());
    }

    #[test]
    fn lanes_hold_the_polynomials_of_one_place_each() {
        let s: Lane = core::array::from_fn(|i| i as f64 / 4.0 - 1.0);
        let signs: Lane = core::array::from_fn(|i| if i % 2 == 0 { 1.0 } else { -1.0 });
        let mut columns = [[0.0; LANES]; 9];
        chebyshev_lanes(&s, &signs, &mut columns);
        for lane in 0..LANES {
            let mut row = [0.0; 9];
            chebyshev(s[lane], &mut row);
            for (column, value) in columns.iter().zip(row) {
                assert!((column[lane] - signs[lane] * value).abs() < 1e-14);
            }
        }
    }
}
