//! Figures by which an effect is judged: its agreement between programs, places and runs, what it is worth on runs left out, and
//! whether it takes back what the others say.
//!
//! Source: `docs/explanation/diagnosis.md` (agreement); invariance between programs as evidence: Peters, Buhlmann, Meinshausen.

use nalgebra::DVector;
use rayon::prelude::*;

use super::super::constants::{DEVIATION_EXPECTED, FOLD_RIDGE};
use super::super::library::Library;
use super::super::moment::{Axis, SLOTS};
use super::agreement::{between, lack_of_fit};
use super::joint::Joint;
use super::pivoted_cholesky::Factor;
use super::problem::Problem;

/// Folds of the cross-validation.
pub const FOLDS: usize = 6;

/// What was measured of an effect.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Figures {
    /// Its deviation between programs and the places within, or the runs within, relative to itself: the larger of both.
    pub between: f64,
    /// Share of the gain that runs left out of the fit show.
    pub held_out: f64,
    /// Cosine between what it does and what all others do, whitened by the noise alone: near -1 where it takes
    /// back what they say.
    pub against: f64,
    /// In how many programs it shows, each counted by its share (inverse of the sum of the squared shares).
    pub breadth: f64,
    /// Its deviation from its formula, relative to itself: what its products with everything else that changes say of what is
    /// left; found later.
    pub misform: f64,
    /// How far it varies over the volume, relative, RMS; 0 where it was not asked.
    pub varies: f64,
}

impl Figures {
    /// Of an effect that was compared as a model and not asked further.
    pub const UNASKED: Self =
        Self { between: 0.0, held_out: 1.0, against: 0.0, breadth: 1.0, misform: 0.0, varies: 0.0 };
}

/// Products of some columns and the gap over a part of the rows.
#[derive(Clone)]
pub(super) struct Part {
    pub(super) g: Vec<f64>,
    pub(super) b: Vec<f64>,
    pub(super) yy: f64,
    pub(super) rows: usize,
}

impl Part {
    pub(super) fn new(n: usize) -> Self {
        Self { g: vec![0.0; n * n], b: vec![0.0; n], yy: 0.0, rows: 0 }
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

    pub(super) fn factor(&self) -> Factor {
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

/// Products by part; `of` gives the part of a row.
fn parts(
    problem: &Problem,
    columns: &[usize],
    y: &DVector<f64>,
    of: impl Fn(usize) -> usize,
    count: usize,
) -> Vec<Part> {
    let mut rows = vec![Vec::new(); count];
    (0..problem.len()).for_each(|i| rows[of(i)].push(i));
    let own = problem.whitened_rows(columns);
    let part = |rows: &Vec<usize>| {
        let (x, y) = (own.select_columns(rows), y.select_rows(rows));
        let (g, b) = (&x * x.transpose(), &x * &y);
        Part { g: g.data.into(), b: b.data.into(), yy: y.norm_squared(), rows: rows.len() }
    };
    rows.par_iter().map(part).collect()
}

fn total(parts: &[Part]) -> Part {
    let none = Part::new(parts.first().map_or(0, |p| p.b.len()));
    parts.iter().fold(none, |sum, p| {
        let add = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a + b).collect();
        Part { g: add(&sum.g, &p.g), b: add(&sum.b, &p.b), yy: sum.yy + p.yy, rows: sum.rows + p.rows }
    })
}

/// All effects chosen, fitted together, and the products of all their columns by fold.
pub struct Whole {
    pub(crate) joint: Joint,
    folds: Vec<Part>,
}

impl Whole {
    /// Of variants (prepared).
    #[must_use]
    pub fn new(problem: &Problem, chosen: &[usize]) -> Self {
        let joint = Joint::of(problem, chosen);
        let fold = |i: usize| fold_of(problem.block[i], problem.blocks);
        let folds = parts(problem, &joint.given.columns, &problem.y, fold, FOLDS.min(problem.blocks.max(2)));
        Self { joint, folds }
    }
}

/// Figures of one of the effects; `gain` is its own beside the others.
#[must_use]
pub fn figures(
    problem: &Problem,
    library: &Library,
    Whole { joint: Joint { given, beta, .. }, folds }: &Whole,
    variant: usize,
    gain: f64,
) -> Figures {
    let (at, k) = problem.span[variant];
    let mine: Vec<usize> = (at..at + k).collect();
    let is_mine = |c: &usize| (at..at + k).contains(c);
    let (others, other_beta): (Vec<usize>, Vec<f64>) =
        given.columns.iter().zip(beta).filter(|(c, _)| !is_mine(c)).map(|(c, b)| (*c, *b)).unzip();
    let beside = problem.contribution(&others, &other_beta);
    let partial = &problem.y - &beside;
    let fit = problem.part(given, beta, variant);
    // two are no opposites because the variation takes what they say alike
    let plain = |part: &DVector<f64>| {
        let mut part = part.clone();
        if let Some(v) = problem.variation() {
            v.noise.turn(part.as_mut_slice(), true);
        }
        part
    };
    let own_axis = library.variants[variant].shape.over();
    let places = &problem.places[own_axis.map_or(SLOTS, Axis::slot)];
    let within = |of: &[usize], count: usize| {
        let all = parts(problem, &mine, &partial, |i| of[i], count);
        let mut program = vec![0; count];
        of.iter().zip(&problem.cell).for_each(|(part, cell)| program[*part] = *cell);
        let pairs: Vec<(usize, &Part)> = program.into_iter().zip(&all).collect();
        let lack = if problem.precise { lack_of_fit(&pairs) } else { 1.0 };
        between(&pairs, lack).unwrap_or(0.0)
    };
    Figures {
        between: within(&places.of, places.count).max(within(&problem.block, problem.blocks)),
        held_out: held_out(folds, &given.columns, &mine, gain),
        against: against(&plain(&fit), &plain(&beside)),
        breadth: breadth(problem, &fit),
        misform: DEVIATION_EXPECTED,
        varies: problem
            .variation()
            .and_then(|v| v.of(library.variants[variant].label))
            .map_or(0.0, |e| e.rms),
    }
}

fn held_out(folds: &[Part], all: &[usize], mine: &[usize], gain: f64) -> f64 {
    let whole = total(folds);
    let other: Vec<usize> = (0..all.len()).filter(|i| !mine.contains(&all[*i])).collect();
    let kept = |p: &Part| {
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
        p.left(&without) - p.left(&with)
    };
    let kept: Vec<f64> = folds.par_iter().map(kept).collect();
    kept.iter().sum::<f64>() / gain.max(1e-9)
}

fn against(fit: &DVector<f64>, others: &DVector<f64>) -> f64 {
    let size = fit.norm() * others.norm();
    if size > 0.0 { fit.dot(others) / size } else { 0.0 }
}

fn breadth(problem: &Problem, fit: &DVector<f64>) -> f64 {
    let mut energy = vec![0.0; problem.cells];
    for (cell, f) in problem.cell.iter().zip(fit.iter()) {
        energy[*cell] += f * f;
    }
    let squares: f64 = energy.iter().map(|e| e * e).sum();
    if squares > 0.0 { energy.iter().sum::<f64>().powi(2) / squares } else { 0.0 }
}
