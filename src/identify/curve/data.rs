//! Readings gathered by target and direction: all that a least-squares fit needs, in memory that does not grow
//! with repetition.
//!
//! Readings at one place have one row of the design matrix. Their mean with its count, and the scatter about it,
//! give the same coefficients, residual sum of squares, leverages and left-out errors as the single readings do.
//! Records of more than [`MANY`] readings are gathered in `MANY` equal bins of the range: positions inside a bin
//! (4e-6 of the range) are replaced by their mean, which moves a wave of 64 periods by 1e-7 of its amplitude.

use crate::prelude::*;

use super::cycle_drift::Effects;
use super::error::FitError;
use super::fitted::MeanReversal;

/// More readings than this are gathered in bins instead of being sorted.
const MANY: usize = 1 << 18;
/// A rotary axis was measured over the whole turn where no more than this many spacings are missing.
const GAP_SPACINGS: f64 = 1.5;
/// Share of a turn by which a last target may miss the first one and still be the same place.
const SAME_PLACE: f64 = 1e-6;

/// The readings at one position in one direction.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cell {
    /// Index of the position.
    pub(super) group: usize,
    pub(super) travel: Travel,
    pub(super) count: f64,
    pub(super) mean: f64,
    /// Sum of squares about the mean.
    pub(super) within: f64,
    pub(super) low: f64,
    pub(super) high: f64,
}

impl Cell {
    /// `+1` forward, `-1` reverse.
    pub(super) const fn sign(&self) -> f64 {
        match self.travel {
            Travel::Forward => 1.0,
            Travel::Reverse => -1.0,
        }
    }

    /// This cell with the readings of another one.
    fn with(&self, other: &Self) -> Self {
        let count = self.count + other.count;
        let step = other.mean - self.mean;
        Self {
            count,
            mean: self.mean + step * other.count / count,
            within: self.within + other.within + step * step * self.count * other.count / count,
            low: self.low.min(other.low),
            high: self.high.max(other.high),
            ..*self
        }
    }

    /// Largest distance of a reading from `value`.
    pub(super) fn farthest(&self, value: f64) -> f64 {
        (self.low - value).abs().max((self.high - value).abs())
    }
}

/// Readings made ready for fitting.
#[derive(Debug, Clone)]
pub(super) struct Data {
    /// Distinct positions, increasing.
    pub(super) positions: Vec<f64>,
    /// Lowest and highest position.
    pub(super) ends: [f64; 2],
    /// By position, forward before reverse.
    pub(super) cells: Vec<Cell>,
    /// Readings.
    pub(super) n: usize,
    /// The turn after which a rotary axis is where it was, where the readings cover all of it.
    pub(super) turn: Option<f64>,
    /// Range of the basis, where it is not that of the positions.
    pub(super) given_range: Option<[f64; 2]>,
    /// Largest absolute value.
    pub(super) scale: f64,
    /// Sum of squares of the values about their mean.
    pub(super) spread: f64,
    /// Errors that the means of the cells share, a row per cell; without columns where they share none.
    pub(super) shared: DMatrix<f64>,
    /// Degrees of freedom that were used before.
    pub(super) used: f64,
}

impl Data {
    /// Gathers readings; `turn` is the full turn of a rotary axis, where closing it is wanted.
    pub(super) fn new(readings: &[Reading], turn: Option<f64>) -> Result<Self, FitError> {
        Self::with_effects(readings, &Effects::default(), turn)
    }

    /// The same with what the readings share.
    pub(super) fn with_effects(
        readings: &[Reading],
        effects: &Effects,
        turn: Option<f64>,
    ) -> Result<Self, FitError> {
        if let Some(i) = readings.iter().position(|r| !(r.position.is_finite() && r.value.is_finite())) {
            return Err(FitError::NotFinite { row: i + 1 });
        }
        let (mut positions, groups) = Groups::of(readings);
        if positions.len() < 2 {
            return Err(FitError::TooFewPositions { found: positions.len(), needed: 2 });
        }
        let turn = turn.filter(|t| covers(&positions, *t));
        // a bin's mean position is not the end of the range
        let ends = groups.ends(&positions);
        // the last target may be the first one, a turn later
        let last = positions.len() - 1;
        let repeated = turn.is_some_and(|t| positions[last] - positions[0] > t * (1.0 - SAME_PLACE));
        if repeated {
            positions.pop();
        }
        let count = positions.len();
        let group = |i: usize| match groups.of_reading(i, &readings[i]) {
            last if last == count => 0,
            group => group,
        };
        let cells = gather(readings, count, group);
        let shared = shared_by_cells(readings, &cells, group, &effects.shared);
        let (scale, spread) = size_and_spread(&cells, readings.len());
        let n = readings.len();
        Ok(Self {
            positions,
            ends,
            cells,
            n,
            turn,
            given_range: None,
            scale,
            spread,
            shared,
            used: effects.used,
        })
    }

    /// First position and last, or a whole turn, or what was given.
    pub(super) fn range(&self) -> [f64; 2] {
        if let Some(range) = self.given_range {
            return range;
        }
        [self.ends[0], self.turn.map_or(self.ends[1], |t| self.ends[0] + t)]
    }

    /// True where leaving the position out leaves neighbours on both sides.
    pub(super) fn is_inner(&self, group: usize) -> bool {
        self.turn.is_some() || group > 0 && group + 1 < self.positions.len()
    }

    /// Readings were taken in both directions.
    pub(super) fn both_directions(&self) -> bool {
        [Travel::Forward, Travel::Reverse].iter().all(|t| self.cells.iter().any(|c| c.travel == *t))
    }

    /// The cells, one slice per position.
    pub(super) fn by_position(&self) -> impl Iterator<Item = &[Cell]> {
        self.cells.chunk_by(|a, b| a.group == b.group)
    }

    /// The cell of each position in one direction.
    pub(super) fn of(&self, travel: Travel) -> Vec<Option<&Cell>> {
        let mut found = vec![None; self.positions.len()];
        for cell in self.cells.iter().filter(|c| c.travel == travel) {
            found[cell.group] = Some(cell);
        }
        found
    }

    /// Forward minus reverse at the positions that have both, with the weight of the difference.
    pub(super) fn reversals(&self) -> Vec<(f64, f64)> {
        self.by_position()
            .filter_map(|cells| match cells {
                [f, r] => Some((f.mean - r.mean, 1.0 / (1.0 / f.count + 1.0 / r.count))),
                _ => None,
            })
            .collect()
    }

    /// The same with both directions taken for one.
    pub(super) fn one_direction(&self) -> Self {
        let merged = |cells: &[Cell]| {
            let sum = cells[1..].iter().fold(cells[0], |sum, c| sum.with(c));
            Cell { travel: Travel::Forward, ..sum }
        };
        let mut row = 0;
        let mut rows = Vec::new();
        for cells in self.by_position() {
            let counts = cells.iter().map(|c| c.count).sum::<f64>();
            let mut mean = DVector::zeros(self.shared.ncols());
            for cell in cells {
                if !mean.is_empty() {
                    mean += self.shared.row(row).transpose() * (cell.count / counts);
                }
                row += 1;
            }
            rows.push(mean.transpose());
        }
        let shared = if self.shared.is_empty() { self.shared.clone() } else { DMatrix::from_rows(&rows) };
        Self { cells: self.by_position().map(merged).collect(), shared, ..self.clone() }
    }

    /// Neighbouring positions averaged until about `wanted` are left: for searches, whatever the length of the record.
    pub(super) fn coarsened(&self, wanted: usize) -> Self {
        let width = self.positions.len().div_ceil(wanted.max(1));
        let count = self.positions.len().div_ceil(width);
        let mut positions = vec![(0.0, 0.0); count];
        let mut cells: Vec<Option<Cell>> = vec![None; 2 * count];
        for cell in &self.cells {
            let group = cell.group / width;
            positions[group].0 += cell.count * self.positions[cell.group];
            positions[group].1 += cell.count;
            let slot = &mut cells[2 * group + usize::from(cell.travel == Travel::Reverse)];
            *slot = Some(match slot {
                None => Cell { group, ..*cell },
                Some(sum) => sum.with(cell),
            });
        }
        Self {
            positions: positions.into_iter().map(|(sum, count)| sum / count).collect(),
            cells: cells.into_iter().flatten().collect(),
            shared: DMatrix::zeros(0, 0),
            ..*self
        }
    }

    /// Standard deviation of the readings about the mean of their own target and direction, pooled; `None` where no
    /// target was repeated.
    pub(super) fn repeatability(&self) -> Option<f64> {
        let free = (self.n - self.cells.len()) as f64 - self.used;
        (free > 0.0).then(|| (self.cells.iter().map(|c| c.within).sum::<f64>() / free).sqrt())
    }

    /// Mean of forward minus reverse over the positions that have both.
    pub(super) fn mean_reversal(&self) -> Option<MeanReversal> {
        let (mut row, mut pairs, mut value, mut of_noise) = (0, 0.0, 0.0, 0.0);
        let mut shared = DVector::zeros(self.shared.ncols());
        for cells in self.by_position() {
            if let [f, r] = cells {
                pairs += 1.0;
                value += f.mean - r.mean;
                of_noise += 1.0 / f.count + 1.0 / r.count;
                if !shared.is_empty() {
                    shared += (self.shared.row(row) - self.shared.row(row + 1)).transpose();
                }
            }
            row += cells.len();
        }
        let std = self.repeatability().map(|sigma| (sigma * of_noise.sqrt()).hypot(shared.norm()) / pairs);
        (pairs > 0.0).then(|| MeanReversal { value: value / pairs, std })
    }
}

/// True where distinct, increasing positions cover a whole turn but for the step that closes it.
fn covers(positions: &[f64], turn: f64) -> bool {
    let n = positions.len();
    let span = positions[n - 1] - positions[0];
    let spacing = span / (n - 1) as f64;
    n > 3 && span <= turn * (1.0 + SAME_PLACE) && span + GAP_SPACINGS * spacing >= turn
}

/// Which position each reading belongs to.
enum Groups {
    /// By sorting.
    Sorted(Vec<usize>),
    /// Equal bins of the range; for each its position.
    Bins { low: f64, high: f64, per_width: f64, index: Vec<u32> },
}

impl Groups {
    /// The distinct positions, increasing, and who belongs where.
    fn of(readings: &[Reading]) -> (Vec<f64>, Self) {
        if readings.len() <= MANY {
            let (positions, group) = group_by_position(readings);
            return (positions, Self::Sorted(group));
        }
        let [low, high] = hull(readings.iter().map(|r| r.position));
        let per_width = if high > low { MANY as f64 / (high - low) } else { 0.0 };
        let mut sums = vec![(0.0, 0u32); MANY];
        for r in readings {
            let sum = &mut sums[bin(r, low, per_width)];
            // about the lower end: a target that repeats keeps its position to the last digit or two
            sum.0 += r.position - low;
            sum.1 += 1;
        }
        let mut positions = Vec::new();
        let index = sums
            .into_iter()
            .map(|(sum, count)| {
                if count > 0 {
                    positions.push(low + sum / f64::from(count));
                }
                positions.len().saturating_sub(1) as u32
            })
            .collect();
        (positions, Self::Bins { low, high, per_width, index })
    }

    fn of_reading(&self, i: usize, reading: &Reading) -> usize {
        match self {
            Self::Sorted(group) => group[i],
            Self::Bins { low, per_width, index, .. } => index[bin(reading, *low, *per_width)] as usize,
        }
    }

    fn ends(&self, positions: &[f64]) -> [f64; 2] {
        match self {
            Self::Sorted(_) => [positions[0], positions[positions.len() - 1]],
            Self::Bins { low, high, .. } => [*low, *high],
        }
    }
}

fn bin(reading: &Reading, low: f64, per_width: f64) -> usize {
    (((reading.position - low) * per_width) as usize).min(MANY - 1)
}

fn gather(readings: &[Reading], positions: usize, group: impl Fn(usize) -> usize) -> Vec<Cell> {
    const EMPTY: Cell = Cell {
        group: 0,
        travel: Travel::Forward,
        count: 0.0,
        mean: 0.0,
        within: 0.0,
        low: f64::INFINITY,
        high: f64::NEG_INFINITY,
    };
    let directions = if readings.iter().all(|r| r.travel == readings[0].travel) { 1 } else { 2 };
    let slot = |group: usize, r: &Reading| {
        directions * group + usize::from(directions == 2 && r.travel == Travel::Reverse)
    };
    let mut cells = vec![EMPTY; directions * positions];
    for (i, r) in readings.iter().enumerate() {
        let g = group(i);
        let cell = &mut cells[slot(g, r)];
        if cell.count == 0.0 {
            (cell.group, cell.travel) = (g, r.travel);
        }
        cell.count += 1.0;
        cell.mean += r.value;
        cell.low = cell.low.min(r.value);
        cell.high = cell.high.max(r.value);
    }
    for cell in &mut cells {
        // equal readings have their own value as mean, not a rounded one
        cell.mean = if cell.low == cell.high { cell.low } else { cell.mean / cell.count };
    }
    let repeated = cells.iter().any(|c| c.count > 1.0);
    for (i, r) in readings.iter().enumerate().filter(|_| repeated) {
        let cell = &mut cells[slot(group(i), r)];
        cell.within += (r.value - cell.mean).powi(2);
    }
    cells.retain(|c| c.count > 0.0);
    cells
}

/// Means by cell of what single readings share.
fn shared_by_cells(
    readings: &[Reading],
    cells: &[Cell],
    group: impl Fn(usize) -> usize,
    shared: &DMatrix<f64>,
) -> DMatrix<f64> {
    if shared.is_empty() {
        return DMatrix::zeros(0, 0);
    }
    let slot = |group: usize, travel: Travel| 2 * group + usize::from(travel == Travel::Reverse);
    let rows: BTreeMap<usize, usize> =
        cells.iter().enumerate().map(|(i, c)| (slot(c.group, c.travel), i)).collect();
    let mut means = DMatrix::zeros(cells.len(), shared.ncols());
    for (i, r) in readings.iter().enumerate() {
        let Some(cell) = rows.get(&slot(group(i), r.travel)) else { continue };
        let mut row = means.row_mut(*cell);
        row += shared.row(i) / cells[*cell].count;
    }
    means
}

fn size_and_spread(cells: &[Cell], n: usize) -> (f64, f64) {
    let mean = cells.iter().map(|c| c.count * c.mean).sum::<f64>() / n as f64;
    let spread = cells.iter().map(|c| c.within + c.count * (c.mean - mean).powi(2)).sum();
    (cells.iter().fold(0.0, |a, c| a.max(c.farthest(0.0))), spread)
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f64::consts::TAU;

    fn at(position: f64, value: f64, travel: Travel) -> Reading {
        Reading { cycle: 0, travel, position, value }
    }

    #[test]
    fn cells_hold_the_sums_of_their_readings() {
        let all: Vec<Reading> = (0..60)
            .map(|i| {
                let travel = if i % 3 == 0 { Travel::Reverse } else { Travel::Forward };
                at(f64::from(i % 5), f64::from(i * i % 17), travel)
            })
            .collect();
        let data = Data::new(&all, None).unwrap();
        assert_eq!((data.positions.len(), data.cells.len()), (5, 10));
        let mean = all.iter().map(|r| r.value).sum::<f64>() / 60.0;
        let spread: f64 = all.iter().map(|r| (r.value - mean).powi(2)).sum();
        assert!((data.spread - spread).abs() < 1e-9);
        for cell in &data.cells {
            let own: Vec<f64> = all
                .iter()
                .filter(|r| r.position == data.positions[cell.group] && r.travel == cell.travel)
                .map(|r| r.value)
                .collect();
            assert_eq!(cell.count, own.len() as f64);
            assert!((cell.mean - own.iter().sum::<f64>() / cell.count).abs() < 1e-12);
            assert_eq!(cell.high, own.iter().copied().fold(f64::MIN, f64::max));
        }
    }

    #[test]
    fn a_whole_turn_is_recognised_and_closes() {
        let turn = |n: u32, step: f64| -> Vec<Reading> {
            (0..n).map(|i| at((f64::from(i) * step).to_radians(), 0.0, Travel::Forward)).collect()
        };
        let open = Data::new(&turn(12, 30.0), Some(TAU)).unwrap();
        assert_eq!((open.turn, open.positions.len()), (Some(TAU), 12));
        assert_eq!(open.range(), [0.0, TAU]);
        let closed = Data::new(&turn(13, 30.0), Some(TAU)).unwrap();
        assert_eq!((closed.turn, closed.positions.len()), (Some(TAU), 12));
        assert_eq!(closed.cells[0].count, 2.0);
        assert_eq!(Data::new(&turn(10, 30.0), Some(TAU)).unwrap().turn, None);
        assert_eq!(Data::new(&turn(14, 30.0), Some(TAU)).unwrap().turn, None);
        assert_eq!(Data::new(&turn(12, 30.0), None).unwrap().turn, None);
    }

    #[test]
    fn readings_of_one_direction_keep_it() {
        for travel in [Travel::Forward, Travel::Reverse] {
            let all: Vec<Reading> = (0..9).map(|i| at(f64::from(i % 3), f64::from(i), travel)).collect();
            let data = Data::new(&all, None).unwrap();
            assert_eq!(data.cells.len(), 3);
            assert!(data.cells.iter().all(|c| c.travel == travel && c.count == 3.0));
        }
    }

    #[test]
    fn bins_keep_targets_and_sums() {
        let all: Vec<Reading> = (0..MANY + 5)
            .map(|i| at((i % 7) as f64 * 50.0 + 0.1, (i % 11) as f64, Travel::Forward))
            .collect();
        let data = Data::new(&all, None).unwrap();
        assert_eq!(data.positions.len(), 7);
        for (i, x) in data.positions.iter().enumerate() {
            assert!((x - (i as f64 * 50.0 + 0.1)).abs() < 1e-9, "{x}");
        }
        assert_eq!(data.cells.iter().map(|c| c.count).sum::<f64>(), (MANY + 5) as f64);
    }
}
