//! Drift over the cycles of a test, which a curve of both directions takes for reversal.
//!
//! Cycles last equally long and go out and back, the targets of a cycle at equal times: at the `g`-th of `N` targets a reading
//! stands `(g + 1/2)/(2N)` of a cycle after its begin, and as long before its end on the way back. A drift of `d` per cycle
//! then adds `d (1 - s)` to the difference of the directions at share `s` of the travel.
//!
//! Model: `y = mean of target and direction + z w + e`. Courses of the drift: offsets of the cycles (steps between them, which
//! leave the reversal as it is), a linear trend beside such offsets, a random walk (increments between knots). The means of the
//! targets are free, so that nothing is assumed about curve and reversal. A drift that repeats in every cycle alike is the one thing
//! that no course can tell from reversal.
//!
//! Start-up outliers take no part in the estimate.
//!
//! The variances of the courses follow from restricted likelihood (REML); the course of lowest `-2 log L + 2 p` is subtracted,
//! where the trend of the cycles (F test) or the random walk (likelihood ratio against offsets) is significant.
//!
//! Source: Searle, Casella and McCulloch 1992, 6.6 (REML), 7.4 (mixed model equations); Self and Liang 1987 (ratio at the bound).

use crate::prelude::*;
use core::ops::Range;

use nalgebra::{Cholesky, Dyn};

use super::request::Drift;
use crate::start_up::start_up_outliers;

/// Probability below which a drift is no chance.
const SIGNIFICANT: f64 = 0.01;
/// Fewest cycles that show a trend.
const CYCLES_MIN: usize = 3;
/// Knots of a random walk in a cycle at most, and in a test.
const KNOTS: usize = 8;
const KNOTS_MAX: usize = 96;
/// More readings than this are a record and no test by targets.
const READINGS_MAX: usize = 1 << 14;
/// Decades of the ratio of variances that are searched, and steps in each.
const DECADES: [i32; 2] = [-3, 7];
const STEPS: i32 = 4;
/// Ratio of variances that leaves an effect free.
const FREE: f64 = 1e9;

/// The course of a drift.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Course {
    /// Steps between the cycles: the reversal stays as it is.
    Steps,
    /// Evenly in time.
    Linear,
    /// Unevenly, inside the cycles too.
    Walk,
}

/// A drift over the cycles of a test.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CycleDrift {
    /// Mean change from one cycle to the next, in the unit of the readings.
    pub per_cycle: f64,
    /// Its standard uncertainty (k = 1).
    pub per_cycle_std: f64,
    /// Probability of such a drift by chance.
    pub p_value: f64,
    /// Its course.
    pub course: Course,
    /// By how much it changes the mean of forward minus reverse, in the unit of the readings.
    pub in_reversal: f64,
    /// True where it was subtracted.
    pub subtracted: bool,
}

/// What the cycles of a test have in common.
#[derive(Debug, Clone, Default)]
pub(super) struct Effects {
    /// A significant drift, or one that was subtracted as asked.
    pub(super) drift: Option<CycleDrift>,
    /// What is to be subtracted from each reading; empty where nothing is.
    pub(super) offsets: Vec<f64>,
    /// Errors that readings share: their covariance beside independent noise is that of `shared * shared^T`, a row per reading.
    pub(super) shared: DMatrix<f64>,
    /// Degrees of freedom that the subtraction uses.
    pub(super) used: f64,
}

/// Analyses the cycles; nothing is found with fewer than three or without repeated targets.
pub(super) fn analyse(readings: &[Reading], wanted: Drift) -> Effects {
    let Some(test) = Test::of(readings) else { return Effects::default() };
    let steps = test.fitted(vec![test.cycle_columns()], &[true]);
    let offsets_only = || Effects { shared: steps.shared(test.cycles - 1), ..Effects::default() };
    if !test.is_bidirectional {
        return offsets_only();
    }
    let trend = vec![test.cycle_columns(), test.trend_column()];
    let walk = test.fitted(vec![test.walk_columns()], &[true]);
    let p_trend = test.p_trend();
    let p_walk = 0.5 * chi_square_upper((steps.criterion - walk.criterion).max(0.0), 1);
    let significant = p_trend.min(p_walk) < SIGNIFICANT;
    if !(significant || wanted == Drift::Subtract) {
        return offsets_only();
    }
    let mut courses = vec![(Course::Linear, test.fitted(trend.clone(), &[true, true])), (Course::Walk, walk)];
    if wanted != Drift::Subtract {
        courses.push((Course::Steps, steps.clone()));
    }
    let best = courses.into_iter().min_by(|a, b| a.1.score().total_cmp(&b.1.score()));
    let Some((course, mut fitted)) = best else { return offsets_only() };
    let (per_cycle, std) = test.slope();
    let mut dof = None;
    if course == Course::Linear {
        fitted = test.freed(trend, &fitted);
        dof = (fitted.ratios[0] > 0.0).then_some(test.cycles - 2);
    }
    let values = fitted.values();
    let is_kept = wanted == Drift::Keep;
    let drift = CycleDrift {
        per_cycle,
        per_cycle_std: std,
        p_value: p_trend.min(p_walk),
        course,
        in_reversal: test.mean_reversal(&values),
        subtracted: !is_kept,
    };
    if is_kept {
        return Effects { drift: Some(drift), ..offsets_only() };
    }
    let dof = if course == Course::Steps { Some(test.cycles - 1) } else { dof };
    let shared = dof.map_or_else(|| fitted.loads(1.0), |dof| fitted.shared(dof));
    Effects { drift: Some(drift), used: fitted.used(), offsets: values, shared }
}

/// Readings of a test by cell (target and direction) and time.
struct Test<'a> {
    readings: &'a [Reading],
    /// Cell of each reading.
    cell: Vec<usize>,
    /// False for start-up outliers: they are no drift and take no part in the estimate.
    counted: Vec<bool>,
    /// Readings that count in each cell.
    counts: Vec<f64>,
    /// Cycle of each reading, counted from 0 without gaps.
    cycle: Vec<usize>,
    cycles: usize,
    /// Time of each reading, in cycles.
    time: Vec<f64>,
    targets: usize,
    is_bidirectional: bool,
}

impl<'a> Test<'a> {
    fn of(readings: &'a [Reading]) -> Option<Self> {
        let of_one_cycle = readings.iter().all(|r| r.cycle == readings[0].cycle);
        if of_one_cycle || readings.len() > READINGS_MAX {
            return None;
        }
        if readings.iter().any(|r| !(r.position.is_finite() && r.value.is_finite())) {
            return None;
        }
        let is_reverse = |r: &Reading| r.travel == Travel::Reverse;
        // the cycle, and the direction that its first reading has
        let mut numbers: BTreeMap<u32, (usize, bool)> = BTreeMap::new();
        for r in readings {
            numbers.entry(r.cycle).or_insert((0, is_reverse(r)));
        }
        let cycles = numbers.len();
        if !(CYCLES_MIN..=KNOTS_MAX).contains(&cycles) {
            return None;
        }
        let back_first = 2 * numbers.values().filter(|(_, back)| *back).count() > cycles;
        numbers.values_mut().enumerate().for_each(|(i, number)| number.0 = i);
        let is_bidirectional = readings.iter().any(is_reverse) && !readings.iter().all(is_reverse);
        let back_first = back_first && is_bidirectional;
        let (positions, group) = group_by_position(readings);
        let targets = positions.len();
        let cell: Vec<usize> =
            readings.iter().zip(&group).map(|(r, g)| 2 * g + usize::from(is_reverse(r))).collect();
        let mut counts = vec![0.0; 2 * targets];
        let mut counted = vec![true; readings.len()];
        start_up_outliers(readings).iter().for_each(|o| counted[o.reading] = false);
        cell.iter().zip(&counted).filter(|(_, counted)| **counted).for_each(|(c, _)| counts[*c] += 1.0);
        let time = readings.iter().zip(&group).map(|(r, g)| {
            let share = (*g as f64 + 0.5) / (2 * targets) as f64;
            let out = if back_first { 0.5 - share } else { share };
            let within = if is_reverse(r) == back_first { out } else { 1.0 - out };
            f64::from(r.cycle) + within
        });
        let time = time.collect();
        let cycle = readings.iter().map(|r| numbers[&r.cycle].0).collect();
        let test = Self { readings, cell, counted, counts, cycle, cycles, time, targets, is_bidirectional };
        (test.free() > cycles + 1).then_some(test)
    }

    /// Readings beyond the means of the cells.
    fn free(&self) -> usize {
        let counted = self.counted.iter().filter(|c| **c).count();
        counted - self.counts.iter().filter(|c| **c > 0.0).count()
    }

    /// One column per cycle.
    fn cycle_columns(&self) -> DMatrix<f64> {
        DMatrix::from_fn(self.readings.len(), self.cycles, |i, j| f64::from(u8::from(self.cycle[i] == j)))
    }

    /// The time, in cycles.
    fn trend_column(&self) -> DMatrix<f64> {
        DMatrix::from_fn(self.readings.len(), 1, |i, _| self.time[i] - self.time[0])
    }

    /// Increments between knots at equal times.
    fn walk_columns(&self) -> DMatrix<f64> {
        let [first, last] = hull(self.time.iter().copied());
        let per_cycle = KNOTS.min(2 * self.targets);
        let knots = (per_cycle * self.cycles).min(KNOTS_MAX);
        let step = (last - first) / knots as f64;
        DMatrix::from_fn(self.readings.len(), knots, |i, j| {
            ((self.time[i] - first) / step - j as f64).clamp(0.0, 1.0)
        })
    }

    /// Means of the cells over the readings that count.
    fn cell_means(&self, values: impl Iterator<Item = f64>) -> Vec<f64> {
        let mut means = vec![0.0; self.counts.len()];
        for ((c, v), counted) in self.cell.iter().zip(values).zip(&self.counted) {
            if *counted {
                means[*c] += v / self.counts[*c];
            }
        }
        means
    }

    /// Values without the mean of their cell; zero where they do not count.
    fn centred(&self, values: impl Iterator<Item = f64> + Clone) -> Vec<f64> {
        let means = self.cell_means(values.clone());
        let one = |((c, v), counted): ((&usize, f64), &bool)| if *counted { v - means[*c] } else { 0.0 };
        self.cell.iter().zip(values).zip(&self.counted).map(one).collect()
    }

    /// Mean over the targets of forward minus reverse.
    fn mean_reversal(&self, values: &[f64]) -> f64 {
        let means = self.cell_means(values.iter().copied());
        let pairs = (0..self.targets).filter(|g| self.counts[2 * g] * self.counts[2 * g + 1] > 0.0);
        let (sum, count) = pairs.fold((0.0, 0.0), |(s, n), g| (s + means[2 * g] - means[2 * g + 1], n + 1.0));
        if count > 0.0 { sum / count } else { 0.0 }
    }

    /// Means of the cycles about the cells: number, mean.
    fn cycle_means(&self) -> Vec<(f64, f64)> {
        let centred = self.centred(self.readings.iter().map(|r| r.value));
        let mut sums = vec![(0.0, 0.0, 0.0); self.cycles];
        for (i, v) in centred.into_iter().enumerate() {
            let sum = &mut sums[self.cycle[i]];
            *sum =
                (f64::from(self.readings[i].cycle), sum.1 + v, sum.2 + f64::from(u8::from(self.counted[i])));
        }
        sums.into_iter().map(|(number, sum, count)| (number, sum / f64::max(count, 1.0))).collect()
    }

    /// Regression of the cycle means: slope, sum of squares of the numbers, of the residuals, explained one.
    fn regression(&self) -> (f64, f64, f64, f64) {
        let cycles = self.cycle_means();
        let count = cycles.len() as f64;
        let centre = cycles.iter().map(|c| c.0).sum::<f64>() / count;
        let mean = cycles.iter().map(|c| c.1).sum::<f64>() / count;
        let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
        for (cycle, value) in &cycles {
            let (x, y) = (cycle - centre, value - mean);
            xx += x * x;
            xy += x * y;
            yy += y * y;
        }
        let slope = xy / xx;
        (slope, xx, (yy - slope * xy).max(f64::MIN_POSITIVE), slope * xy)
    }

    /// Probability of the trend of the cycle means by chance.
    fn p_trend(&self) -> f64 {
        let (_, _, residual, explained) = self.regression();
        let dof = self.cycles - 2;
        f_upper(explained * dof as f64 / residual, 1, dof)
    }

    /// Change from cycle to cycle with its standard uncertainty.
    fn slope(&self) -> (f64, f64) {
        let (slope, xx, residual, _) = self.regression();
        (slope, (residual / (self.cycles - 2) as f64 / xx).sqrt())
    }

    /// Fits the variances of groups of effects (one matrix each, of independent effects of equal size).
    fn fitted(&self, groups: Vec<DMatrix<f64>>, searched: &[bool]) -> Fitted {
        let mut fitted = Fitted::new(self, groups);
        // each variance in turn: there are two at most
        for _ in 0..if searched.len() > 1 { 3 } else { 1 } {
            for (group, _) in searched.iter().enumerate().filter(|(_, s)| **s) {
                fitted.search(group);
            }
        }
        fitted.solve();
        fitted
    }

    /// The same with the trend left free, so that it is not shrunk towards zero.
    fn freed(&self, groups: Vec<DMatrix<f64>>, fitted: &Fitted) -> Fitted {
        let mut free = Fitted::new(self, groups);
        free.ratios = vec![fitted.ratios[0], FREE];
        free.solve();
        free
    }
}

/// Effects with their variances in units of that of the noise.
#[derive(Debug, Clone)]
struct Fitted {
    columns: DMatrix<f64>,
    groups: Vec<Range<usize>>,
    /// `Z^T M Z`, `Z^T M y`, `y^T M y` with `M` taking off the means of the cells.
    products: DMatrix<f64>,
    right: DVector<f64>,
    squares: f64,
    /// Readings beyond the means of the cells.
    free: f64,
    /// Mean square of a column, by group.
    sizes: Vec<f64>,
    ratios: Vec<f64>,
    /// `-2 log L` but for a constant.
    criterion: f64,
    variance: f64,
    effects: DVector<f64>,
    /// `T` with `T T^T` the covariance of the effects in units of that of the noise.
    root: DMatrix<f64>,
}

impl Fitted {
    fn new(test: &Test<'_>, groups: Vec<DMatrix<f64>>) -> Self {
        let mut ranges = Vec::new();
        let mut count = 0;
        for group in &groups {
            ranges.push(count..count + group.ncols());
            count += group.ncols();
        }
        let n = test.readings.len();
        let mut columns = DMatrix::zeros(n, count);
        for (group, range) in groups.iter().zip(&ranges) {
            columns.columns_mut(range.start, range.len()).copy_from(group);
        }
        let mut centred = columns.clone();
        for mut column in centred.column_iter_mut() {
            let values = test.centred(column.as_slice().iter().copied());
            column.copy_from_slice(&values);
        }
        let y = DVector::from_vec(test.centred(test.readings.iter().map(|r| r.value)));
        let products = centred.tr_mul(&centred);
        let sizes = ranges
            .iter()
            .map(|r| r.clone().map(|j| products[(j, j)]).sum::<f64>() / r.len() as f64)
            .map(|s| s.max(f64::MIN_POSITIVE))
            .collect();
        Self {
            right: centred.tr_mul(&y),
            squares: y.norm_squared(),
            free: test.free() as f64,
            ratios: vec![0.0; ranges.len()],
            criterion: f64::INFINITY,
            variance: 0.0,
            effects: DVector::zeros(count),
            root: DMatrix::zeros(count, count),
            columns,
            groups: ranges,
            products,
            sizes,
        }
    }

    /// Square roots of the ratios, one per column.
    fn scales(&self) -> DVector<f64> {
        let mut scales = DVector::zeros(self.columns.ncols());
        for ((range, ratio), size) in self.groups.iter().zip(&self.ratios).zip(&self.sizes) {
            scales.rows_mut(range.start, range.len()).fill((ratio / size).sqrt());
        }
        scales
    }

    /// Factor of `I + S A S`, with `S b`.
    fn factor(&self, scales: &DVector<f64>) -> Option<(Cholesky<f64, Dyn>, DVector<f64>)> {
        let k = scales.len();
        let matrix = DMatrix::from_fn(k, k, |i, j| {
            scales[i] * self.products[(i, j)] * scales[j] + f64::from(u8::from(i == j))
        });
        Some((matrix.cholesky()?, scales.component_mul(&self.right)))
    }

    /// Criterion, variance of the noise, scaled effects.
    fn evaluate(&self) -> Option<(f64, f64, DVector<f64>)> {
        let scales = self.scales();
        let (factor, right) = self.factor(&scales)?;
        let scaled = factor.solve(&right);
        let squares = (self.squares - right.dot(&scaled)).max(f64::MIN_POSITIVE);
        let determinant = 2.0 * factor.l_dirty().diagonal().map(f64::ln).sum();
        let criterion = self.free * squares.ln() + determinant;
        Some((criterion, squares / self.free, scales.component_mul(&scaled)))
    }

    /// The ratio of a group that lowers the criterion most.
    fn search(&mut self, group: usize) {
        let mut best = (f64::INFINITY, 0.0);
        let [low, high] = DECADES;
        let ratios = (low * STEPS..=high * STEPS).map(|i| 10f64.powf(f64::from(i) / f64::from(STEPS)));
        for ratio in core::iter::once(0.0).chain(ratios) {
            self.ratios[group] = ratio;
            if let Some((criterion, ..)) = self.evaluate()
                && criterion < best.0
            {
                best = (criterion, ratio);
            }
        }
        self.ratios[group] = best.1;
    }

    fn solve(&mut self) {
        let Some((criterion, variance, effects)) = self.evaluate() else { return };
        (self.criterion, self.variance, self.effects) = (criterion, variance, effects);
        let scales = self.scales();
        let Some((factor, _)) = self.factor(&scales) else { return };
        let k = scales.len();
        let inverse = factor.l().solve_lower_triangular(&DMatrix::identity(k, k));
        if let Some(inverse) = inverse {
            self.root = DMatrix::from_fn(k, k, |i, j| scales[i] * inverse[(j, i)]);
        }
    }

    /// The criterion with a penalty of two for each variance.
    fn score(&self) -> f64 {
        self.criterion + 2.0 * self.ratios.iter().filter(|r| **r > 0.0).count() as f64
    }

    /// The effects at every reading, zero in the mean.
    fn values(&self) -> Vec<f64> {
        let values = &self.columns * &self.effects;
        let mean = values.mean();
        values.iter().map(|v| v - mean).collect()
    }

    /// Degrees of freedom of the effects: trace of `A C`.
    fn used(&self) -> f64 {
        (&self.products * (&self.root * self.root.transpose())).trace()
    }

    /// Errors that the effects leave at every reading, times `factor`.
    fn loads(&self, factor: f64) -> DMatrix<f64> {
        &self.columns * &self.root * (self.variance.sqrt() * factor)
    }

    /// The same with the variances known from `dof` differences of cycles only: twice the standard uncertainty holds 95 %.
    fn shared(&self, dof: usize) -> DMatrix<f64> {
        self.loads(student_95(dof) / 2.0)
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    /// Five cycles out and back over eleven targets, the drift going on all the time.
    fn readings(per_cycle: f64, noise: f64, seed: u64) -> Vec<Reading> {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut all = Vec::new();
        for cycle in 1..=5u32 {
            for k in 0..22u32 {
                let (travel, target) = if k < 11 { (Travel::Forward, k) } else { (Travel::Reverse, 21 - k) };
                let time = f64::from(cycle) + f64::from(k) / 22.0;
                let value =
                    0.01 * f64::from(target) + per_cycle * time + noise * random.random_range(-1.0..1.0);
                all.push(Reading { cycle, travel, position: 50.0 * f64::from(target), value });
            }
        }
        all
    }

    /// Mean of forward minus reverse of what is left.
    fn mean_reversal(readings: &[Reading], effects: &Effects) -> f64 {
        let rest: Vec<f64> = readings.iter().zip(&effects.offsets).map(|(r, o)| r.value - o).collect();
        Test::of(readings).unwrap().mean_reversal(&rest)
    }

    #[test]
    fn a_linear_drift_is_subtracted_and_chance_is_not() {
        let all = readings(1.2, 0.5, 1);
        let effects = analyse(&all, Drift::Auto);
        let found = effects.drift.unwrap();
        assert!((found.per_cycle - 1.2).abs() < 0.1 && found.p_value < 1e-3, "{found:?}");
        assert_eq!((found.course, found.subtracted), (Course::Linear, true));
        // half a cycle of drift in the mean, and none of it afterwards
        assert!((found.in_reversal + 0.6).abs() < 0.05, "{found:?}");
        assert!(mean_reversal(&all, &effects).abs() < 0.1, "{}", mean_reversal(&all, &effects));
        let false_alarms =
            (0..1000).filter(|seed| analyse(&readings(0.0, 0.5, *seed), Drift::Auto).drift.is_some()).count();
        assert!((2..25).contains(&false_alarms), "{false_alarms}");
    }

    #[test]
    fn a_test_that_begins_at_the_far_end_drifts_the_other_way() {
        let mut all = readings(1.2, 0.2, 1);
        for r in &mut all {
            r.travel = if r.travel == Travel::Forward { Travel::Reverse } else { Travel::Forward };
            r.position = 500.0 - r.position;
        }
        let found = analyse(&all, Drift::Auto).drift.unwrap();
        assert!((found.in_reversal - 0.6).abs() < 0.05, "{found:?}");
    }

    #[test]
    fn readings_of_the_start_are_no_drift() {
        let mut all = readings(0.0, 0.5, 3);
        (all[0].value, all[1].value) = (60.0, 40.0);
        assert_eq!(analyse(&all, Drift::Auto).drift, None);
    }

    #[test]
    fn a_drift_is_kept_where_that_is_asked_for() {
        let effects = analyse(&readings(1.2, 0.5, 1), Drift::Keep);
        assert!(effects.offsets.is_empty() && effects.drift.is_some_and(|d| !d.subtracted));
        let effects = analyse(&readings(0.0, 0.5, 1), Drift::Subtract);
        assert!(!effects.offsets.is_empty() && effects.drift.is_some_and(|d| d.subtracted));
    }

    #[test]
    fn one_direction_or_two_cycles_say_nothing() {
        let all = readings(1.2, 0.1, 1);
        let of = |keep: fn(&Reading) -> bool| {
            analyse(&all.iter().copied().filter(keep).collect::<Vec<_>>(), Drift::Auto).drift
        };
        assert_eq!(of(|r| r.travel == Travel::Forward), None);
        assert_eq!(of(|r| r.cycle < 3), None);
        assert_eq!(analyse(&[], Drift::Auto).drift, None);
    }
}
