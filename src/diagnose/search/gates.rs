//! Gates that an effect passes before it is called a cause: the same in all programmes, at all places (an effect that is
//! no function of a position must not depend on it), in all runs, it holds on runs that were left out, and nothing else explains clearly more. What fails is shown, but never a cause.
//!
//! Source: `docs/diagnosis.md` (gates); the first is invariant causal prediction (Peters, Buhlmann, Meinshausen).

use nalgebra::DVector;

use super::super::library::{Library, Shape};
use super::super::moment::{Axis, SLOTS};
use super::agreement::{Agreement, agreement};
use super::problem::Problem;
use super::select::{Found, Selection};
use super::small::Factor;

/// Folds of the cross-validation.
pub const FOLDS: usize = 6;

/// Share of a column's size that is added to its own product when a fold is left out.
pub const FOLD_RIDGE: f64 = 1e-5;

/// What the gates measured.
#[derive(Debug, Clone, PartialEq)]
pub struct Gates {
    /// Joint gain over the sum of the gains of each programme by itself.
    pub invariance: f64,
    /// Joint gain over the sum of the gains of each place by itself.
    pub place: f64,
    /// Student's t of the slopes of single runs.
    pub run_t: f64,
    /// Share of the gain that runs left out of the fit show.
    pub held_out: f64,
    /// Largest gain of another effect in its place, as a share of its own.
    pub rival: f64,
    /// Cosine between what it does and what all others do, whitened: near -1 where it takes back what they say.
    pub against: f64,
    /// What it explains by itself, as a share of what it explains beside the others.
    pub alone: f64,
    /// Share that is surely missing in the programme, and at the place, that shows least of what is expected there.
    pub absent: [f64; 2],
    /// In how many programmes it shows, each counted by its share (inverse of the sum of the squared shares).
    pub breadth: f64,
    /// What repeats and stays where it acts, as a share of what it explains; found after the gates.
    pub misfit: f64,
    /// Its share of what is explained where it acts; found after the gates.
    pub weight: f64,
    /// How much it grows from the middle of another linear axis to its end, as a share of itself and surely (two standard
    /// deviations are taken off); found after the gates.
    pub grows: f64,
    /// Decades of its gain per reading.
    pub size: f64,
    /// How far it varies over the volume, relative, RMS; 0 where it was not asked.
    pub varies: f64,
    /// A temperature drives it: heat comes with more than one time constant, and places are measured at different times.
    pub is_heat: bool,
    /// What nobody stands by in its direction, as a multiple of what it explains; found after the gates.
    pub company: f64,
    /// Agreement between programs with the places within, and with the runs within: the lesser of both.
    pub agreement: Agreement,
}

/// Least invariance.
pub const INVARIANCE: f64 = 0.8;
/// Least agreement of the places.
pub const PLACE: f64 = 0.85;
/// Largest share that may be missing in a programme or at a place: effects vary over the volume, but do not vanish.
pub const ABSENT: f64 = 0.75;
/// Least t of the runs.
pub const RUN_T: f64 = 4.5;
/// Least share on runs left out.
pub const HELD_OUT: f64 = 0.4;
/// Least cosine with the others: nearer to -1 two large effects cancel each other to look like a third.
pub const AGAINST: f64 = -0.85;
/// Squares of standard deviations by which a part of the readings must be expected to show an effect, to miss it there, and
/// their least share of all of them: what a large effect leaves in its tails is its misform.
const EXPECTED: (f64, f64) = (25.0, 0.02);
/// Largest gain of another effect.
pub const RIVAL: f64 = 1.6;

impl Gates {
    /// Its gain per reading.
    #[must_use]
    pub fn gain_per_reading(&self) -> f64 {
        10f64.powf(self.size)
    }

    /// The larger of the shares that are missing.
    #[must_use]
    pub fn missing(&self) -> f64 {
        self.absent[0].max(self.absent[1])
    }

    /// True where all are passed.
    #[must_use]
    pub fn pass(&self) -> bool {
        self.invariance >= INVARIANCE
            && self.place >= PLACE
            && self.missing() <= ABSENT
            && self.run_t >= RUN_T
            && self.held_out >= HELD_OUT
            && self.rival <= RIVAL
            && self.against >= AGAINST
    }
}

/// Products of some columns and the gap over a part of the rows.
#[derive(Clone)]
pub(super) struct Part {
    pub(super) g: Vec<f64>,
    pub(super) b: Vec<f64>,
    yy: f64,
    pub(super) rows: usize,
}

impl Part {
    pub(super) fn new(n: usize) -> Self {
        Self { g: vec![0.0; n * n], b: vec![0.0; n], yy: 0.0, rows: 0 }
    }

    pub(super) fn add(&mut self, x: &[f64], y: f64) {
        let n = self.b.len();
        for i in 0..n {
            for j in 0..n {
                self.g[i * n + j] += x[i] * x[j];
            }
            self.b[i] += x[i] * y;
        }
        self.yy += y * y;
        self.rows += 1;
    }

    fn minus(&self, other: &Self) -> Self {
        let take = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a - b).collect();
        Self {
            g: take(&self.g, &other.g),
            b: take(&self.b, &other.b),
            yy: self.yy - other.yy,
            rows: self.rows - other.rows,
        }
    }

    fn factor(&self) -> Factor {
        let n = self.b.len();
        let full: Vec<f64> = (0..n).map(|i| self.g[i * n + i].max(1e-12)).collect();
        Factor::new(n, &self.g, &full)
    }

    /// Sum of squares left with parameters `beta`.
    fn left(&self, beta: &[f64]) -> f64 {
        let n = self.b.len();
        let mut v = self.yy;
        for i in 0..n {
            v -= 2.0 * beta[i] * self.b[i];
            for j in 0..n {
                v += beta[i] * beta[j] * self.g[i * n + j];
            }
        }
        v
    }
}

/// Fold of every block: blocks of a setup go round.
#[must_use]
pub fn fold_of(block: usize, blocks: usize) -> usize {
    let folds = FOLDS.min(blocks.max(2));
    block % folds
}

fn parts(
    problem: &Problem,
    columns: &[usize],
    y: &DVector<f64>,
    of: impl Fn(usize) -> usize,
    count: usize,
) -> Vec<Part> {
    let mut parts = vec![Part::new(columns.len()); count];
    let mut x = vec![0.0; columns.len()];
    for (i, row) in problem.w.column_iter().enumerate() {
        for (x, c) in x.iter_mut().zip(columns) {
            *x = row[*c];
        }
        parts[of(i)].add(&x, y[i]);
    }
    parts
}

fn total(parts: &[Part]) -> Part {
    let none = Part::new(parts.first().map_or(0, |p| p.b.len()));
    parts.iter().fold(none, |sum, p| {
        let add = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a + b).collect();
        Part { g: add(&sum.g, &p.g), b: add(&sum.b, &p.b), yy: sum.yy + p.yy, rows: sum.rows + p.rows }
    })
}

/// Gates of the effect at `place` of the selection; `ranking` are the alternatives beside the others.
#[must_use]
pub fn gates(
    problem: &Problem,
    library: &Library,
    selection: &Selection,
    place: usize,
    own: &Found,
    ranking: &[Found],
) -> Gates {
    let given = problem.given(&selection.chosen);
    let beta = problem.fit(&given);
    let (at, k) = problem.span[selection.chosen[place]];
    let mine: Vec<usize> = (at..at + k).collect();
    let is_mine = |c: &usize| (at..at + k).contains(c);
    let (others, other_beta): (Vec<usize>, Vec<f64>) =
        given.columns.iter().zip(&beta).filter(|(c, _)| !is_mine(c)).map(|(c, b)| (*c, *b)).unzip();
    let partial = &problem.y - problem.contribution(&others, &other_beta);
    let fit = problem.part(&given, &beta, selection.chosen[place]);
    let label = library.variants[selection.chosen[place]].label;
    let rival = ranking
        .iter()
        .filter(|f| library.variants[f.variant].label != label)
        .map(|f| f.gain / own.gain)
        .fold(0.0, f64::max);
    let varying = problem.variation().and_then(|v| v.of(label));
    // its variation may have been asked beside something like it that is gone
    let gain = varying.map_or(own.gain, |e| e.gain.max(own.gain));
    let own_axis = library.variants[selection.chosen[place]].shape.over();
    let places = &problem.places[own_axis.map_or(SLOTS, Axis::slot)];
    Gates {
        invariance: invariance(problem, &mine, &partial, &problem.cell, problem.cells),
        place: invariance(problem, &mine, &partial, &places.of, places.count),
        run_t: run_t(problem, &fit, &partial),
        held_out: held_out(problem, &given.columns, &mine, own.gain),
        rival,
        against: against(&fit, &problem.contribution(&others, &other_beta)),
        alone: problem.gain(&problem.given(&[]), selection.chosen[place]).0 / own.gain.max(1e-9),
        breadth: breadth(problem, &fit),
        absent: [(&problem.cell, problem.cells), (&places.of, places.count)]
            // beside the servo's thousandfold effects every misform looks like something missing
            .map(|(of, count)| if problem.precise { 0.0 } else { absent(&fit, &partial, of, count) }),
        misfit: 0.0,
        weight: 1.0,
        grows: 0.0,
        size: (gain.max(1e-9) / problem.len().max(1) as f64).log10(),
        varies: varying.map_or(0.0, |e| e.rms),
        is_heat: matches!(library.variants[selection.chosen[place]].shape, Shape::Thermal { .. }),
        company: 0.0,
        agreement: {
            let by_place = within(problem, &mine, &partial, (&places.of, places.count));
            by_place.and(within(problem, &mine, &partial, (&problem.block, problem.blocks)))
        },
    }
}

/// Agreement of an effect between programs and the parts within them.
fn within(
    problem: &Problem,
    mine: &[usize],
    partial: &DVector<f64>,
    (of, count): (&[usize], usize),
) -> Agreement {
    let all = parts(problem, mine, partial, |i| of[i], count);
    let mut program = vec![0; count];
    of.iter().zip(&problem.cell).for_each(|(part, cell)| program[*part] = *cell);
    let pairs: Vec<(usize, &Part)> = program.into_iter().zip(&all).collect();
    agreement(&pairs).unwrap_or_default()
}

fn invariance(problem: &Problem, mine: &[usize], partial: &DVector<f64>, of: &[usize], count: usize) -> f64 {
    let cells = parts(problem, mine, partial, |i| of[i], count);
    let joint = total(&cells);
    let f = joint.factor();
    let together = f.gain(&joint.b);
    let (mut apart, mut rank) = (0.0, 0usize);
    for c in &cells {
        let f = c.factor();
        apart += f.gain(&c.b);
        rank += f.rank();
    }
    let free = rank.saturating_sub(f.rank()) as f64;
    // what separate fits gain by noise alone, with two standard deviations
    let noise = free + 2.0 * (2.0 * free).sqrt();
    let apart = apart - noise;
    if apart <= together { 1.0 } else { together / apart }
}

fn run_t(problem: &Problem, fit: &DVector<f64>, partial: &DVector<f64>) -> f64 {
    let mut ff = vec![0.0; problem.pieces];
    let mut fy = vec![0.0; problem.pieces];
    for i in 0..problem.len() {
        ff[problem.piece[i]] += fit[i] * fit[i];
        fy[problem.piece[i]] += fit[i] * partial[i];
    }
    let total: f64 = ff.iter().sum();
    if total <= 0.0 {
        return 0.0;
    }
    let slope = fy.iter().sum::<f64>() / total;
    let telling: Vec<usize> = (0..problem.pieces).filter(|b| ff[*b] > 1e-3 * total).collect();
    if telling.len() < 2 {
        return slope * total.sqrt() * 0.2;
    }
    // scatter of the blocks' slopes about the common one, at least what noise gives
    let scatter: f64 = telling.iter().map(|b| (fy[*b] - slope * ff[*b]).powi(2)).sum();
    let n = telling.len() as f64;
    let cluster = (scatter * n / (n - 1.0)).sqrt() / total;
    let noise = 1.0 / total.sqrt();
    slope / cluster.max(noise)
}

fn held_out(problem: &Problem, all: &[usize], mine: &[usize], gain: f64) -> f64 {
    let folds = FOLDS.min(problem.blocks.max(2));
    let parts = parts(problem, all, &problem.y, |i| fold_of(problem.block[i], problem.blocks), folds);
    let whole = total(&parts);
    let other: Vec<usize> = (0..all.len()).filter(|i| !mine.contains(&all[*i])).collect();
    let mut kept = 0.0;
    for p in &parts {
        let mut rest = whole.minus(p);
        // what the rest of the runs hardly shows must not be extrapolated
        for i in 0..all.len() {
            rest.g[i * all.len() + i] += FOLD_RIDGE * whole.g[i * all.len() + i];
        }
        let with = rest.factor().solve(&rest.b);
        let n = all.len();
        let m = other.len();
        let mut smaller = Part::new(m);
        for (i, a) in other.iter().enumerate() {
            smaller.b[i] = rest.b[*a];
            for (j, b) in other.iter().enumerate() {
                smaller.g[i * m + j] = rest.g[a * n + b];
            }
        }
        let without_small = smaller.factor().solve(&smaller.b);
        let mut without = vec![0.0; n];
        for (i, a) in other.iter().enumerate() {
            without[*a] = without_small[i];
        }
        kept += p.left(&without) - p.left(&with);
    }
    kept / gain.max(1e-9)
}

fn against(fit: &DVector<f64>, others: &DVector<f64>) -> f64 {
    let size = fit.norm() * others.norm();
    if size > 0.0 { fit.dot(others) / size } else { 0.0 }
}

/// Largest share of the effect that is surely (two standard deviations) missing in one part of the readings.
fn absent(fit: &DVector<f64>, partial: &DVector<f64>, of: &[usize], count: usize) -> f64 {
    let mut sums = vec![(0.0, 0.0); count];
    for ((part, f), y) in of.iter().zip(fit.iter()).zip(partial.iter()) {
        let s = &mut sums[*part];
        *s = (s.0 + f * f, s.1 + f * y);
    }
    let all: f64 = sums.iter().map(|(ff, _)| ff).sum();
    let told = sums.into_iter().filter(|(ff, _)| *ff > EXPECTED.0.max(EXPECTED.1 * all));
    told.map(|(ff, fy)| 1.0 - fy / ff - 2.0 / ff.sqrt()).fold(0.0, f64::max)
}

fn breadth(problem: &Problem, fit: &DVector<f64>) -> f64 {
    let mut energy = vec![0.0; problem.cells];
    for (cell, f) in problem.cell.iter().zip(fit.iter()) {
        energy[*cell] += f * f;
    }
    let squares: f64 = energy.iter().map(|e| e * e).sum();
    if squares > 0.0 { energy.iter().sum::<f64>().powi(2) / squares } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use nalgebra::DVector;

    use super::absent;

    #[test]
    fn what_does_not_show_where_it_must_is_missing_and_noise_is_not() {
        // one part in four of the readings
        let of: Vec<usize> = (0..200).map(|i| i % 4).collect();
        let fit = DVector::from_fn(200, |i, _| 2.0 * (0.3 * i as f64).sin());
        let noise = DVector::from_fn(200, |i, _| (5.3 * (i * i) as f64).sin());
        assert!(absent(&fit, &(&fit + &noise), &of, 4) < 0.2);
        let gone = DVector::from_fn(200, |i, _| if of[i] == 1 { 0.0 } else { fit[i] });
        let missing = absent(&fit, &(gone + &noise), &of, 4);
        assert!((0.6..1.1).contains(&missing), "{missing}");
        // where little is expected nothing is said
        assert!(absent(&(fit * 0.1), &noise, &of, 4) == 0.0);
    }
}
