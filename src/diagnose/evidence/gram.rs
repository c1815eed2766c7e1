//! Products of all columns and the gap under one covariance, and the evidence of a set of effects from them.

use std::cell::{OnceCell, RefCell};
use std::collections::{BTreeMap, BTreeSet};
use std::rc::Rc;

use nalgebra::{Cholesky, DMatrix, DVector};

use super::super::constants::{DEGENERATE, EFFECT_SCALES, SEEN, SURE};
use super::super::dense::{Tridiagonal, product, solve_lower};
use super::covariance::Covariance;

/// Added to the diagonal of a Gram matrix, relative to it.
const ROUNDING: f64 = 1e-9;

/// Columns of all variants before whitening, each scaled to a root mean square of 1 um.
#[derive(Clone)]
pub(super) struct Columns {
    /// A column each; zero where the readings do not show it.
    pub(super) values: DMatrix<f64>,
    /// First column and number of columns of each variant.
    pub(super) span: Vec<(usize, usize)>,
    /// Largest scale of the effect size of each variant, in standard deviations of the white noise: what mechanics allow.
    pub(super) largest: Vec<f64>,
    /// Label of each variant.
    pub(super) label: Vec<usize>,
    /// The columns of each variant keep their proportions.
    process: Vec<bool>,
    /// Column of the line from which each variant is counted, where with that line it says all that goes with a position.
    pub(super) line: Vec<Option<usize>>,
    /// Number of labels.
    pub(super) labels: usize,
    /// Variants of each label that are seen at all.
    pub(super) variants: Vec<Vec<usize>>,
    /// Number of labels that are seen at all.
    pub(super) visible: usize,
    /// Labels whose only column is that of another label, with the label that stands for both.
    pub(super) aliases: Vec<(usize, usize)>,
}

/// Products under one covariance; those between variants when first needed.
pub(super) struct Gram {
    w: DMatrix<f64>,
    cross: RefCell<BTreeMap<usize, Rc<DVector<f64>>>>,
    b: DVector<f64>,
    /// Gram matrix of each variant.
    own: Vec<DMatrix<f64>>,
    /// The same with the line from which a variant is counted, when first needed.
    own_with_line: RefCell<BTreeMap<usize, DMatrix<f64>>>,
    /// What each label adds to the sets asked for, by the variants and scales of their members.
    additions: RefCell<BTreeMap<Vec<(usize, usize)>, Additions>>,
    /// The columns of each variant are independent.
    is_full: Vec<bool>,
    yy: f64,
    freedom: f64,
    /// Log evidence of "none".
    pub(super) none: f64,
}

/// One effect of a set: its variant, and the place of its scale among [`EFFECT_SCALES`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Member {
    /// The variant.
    pub(super) variant: usize,
    /// Place of its scale.
    pub(super) scale: usize,
    /// Log evidence averaged over all variants and scales of its label, against that of this one.
    pub(super) average: f64,
}

/// A set of effects prepared for comparison with those that differ by one.
#[derive(Default)]
pub(super) struct Conditioned {
    columns: Vec<usize>,
    /// Products of each of them with all columns.
    products: Vec<Rc<DVector<f64>>>,
    factors: Vec<f64>,
    chol: Option<Cholesky<f64, nalgebra::Dyn>>,
    /// Its columns and the lines from which some of them are counted, the products of each, and their Gram matrix without priors.
    known: Vec<usize>,
    known_products: Vec<Rc<DVector<f64>>>,
    flat: Option<Cholesky<f64, nalgebra::Dyn>>,
    /// A random process is among its members.
    has_process: bool,
    /// `A^-1 Z'y`.
    solved: DVector<f64>,
    /// Products with all columns over the Cholesky factors of `chol` and of `flat`, when first needed.
    half: OnceCell<DMatrix<f64>>,
    flat_half: OnceCell<DMatrix<f64>>,
    /// Products of all columns with what the set leaves of the gap, when first needed.
    seen: OnceCell<DVector<f64>>,
    /// Whitened sum of squares that the set leaves.
    pub(super) left: f64,
    log_volume: f64,
}

/// What one label adds to a set.
#[derive(Debug, Clone, Copy)]
pub(super) struct Addition {
    /// Best variant with its scale.
    pub(super) member: Member,
    /// Log evidence of the set with the label, averaged over its variants and scales.
    pub(super) log_evidence: f64,
}

/// What each label adds to a set.
type Additions = Rc<Vec<Option<Addition>>>;

impl Gram {
    pub(super) fn new(covariance: &Covariance, columns: &Columns, y: &DVector<f64>) -> Self {
        let w = covariance.whiten(&columns.values);
        let y =
            covariance.whiten(&DMatrix::from_column_slice(y.len(), 1, y.as_slice())).column(0).into_owned();
        let b = w.tr_mul(&y);
        let (yy, freedom) = (y.norm_squared().max(f64::MIN_POSITIVE), covariance.freedom() as f64);
        let none = -0.5 * covariance.log_determinant - 0.5 * freedom * yy.ln();
        let own: Vec<DMatrix<f64>> =
            columns.span.iter().map(|(at, k)| w.columns(*at, *k).tr_mul(&w.columns(*at, *k))).collect();
        let is_full = own.iter().map(|own| is_full(own, own)).collect();
        Self {
            w,
            cross: RefCell::default(),
            b,
            own,
            own_with_line: RefCell::default(),
            additions: RefCell::default(),
            is_full,
            yy,
            freedom,
            none,
        }
    }

    /// Products of one column with all of them.
    fn products(&self, column: usize) -> Rc<DVector<f64>> {
        let mut known = self.cross.borrow_mut();
        known.entry(column).or_insert_with(|| Rc::new(self.w.tr_mul(&self.w.column(column)))).clone()
    }

    /// White noise that is most likely beside a set, um.
    pub(super) fn sigma(&self, set: &Conditioned) -> f64 {
        (set.left / self.freedom.max(1.0)).sqrt()
    }

    /// Twice the log-likelihood that one set has less than another.
    pub(super) fn likelihood_loss(&self, set: &Conditioned, other: &Conditioned) -> f64 {
        self.freedom * (set.left / other.left).ln()
    }

    pub(super) fn condition(&self, columns: &Columns, set: &[Member]) -> Conditioned {
        let (mut at, mut factors) = (Vec::new(), Vec::new());
        for m in set {
            let (first, width) = columns.span[m.variant];
            at.extend(first..first + width);
            factors.extend(std::iter::repeat_n(columns.factor(*m), width));
        }
        let k = at.len();
        if k == 0 {
            return Conditioned { left: self.yy, ..Conditioned::default() };
        }
        let products: Vec<Rc<DVector<f64>>> = at.iter().map(|c| self.products(*c)).collect();
        let a = DMatrix::from_fn(k, k, |i, j| {
            products[i][at[j]] * factors[i] * factors[j] + f64::from(u8::from(i == j))
        });
        let mut known = at.clone();
        known.extend(set.iter().filter_map(|m| columns.line[m.variant]).filter(|line| !at.contains(line)));
        let known_products: Vec<Rc<DVector<f64>>> = known.iter().map(|c| self.products(*c)).collect();
        let flat = DMatrix::from_fn(known.len(), known.len(), |i, j| {
            known_products[i][known[j]] * if i == j { 1.0 + ROUNDING } else { 1.0 }
        });
        let flat = Cholesky::new(flat);
        let b = DVector::from_fn(k, |i, _| self.b[at[i]] * factors[i]);
        let chol = Cholesky::new(a);
        let solved = chol.as_ref().map_or_else(|| DVector::zeros(k), |c| c.solve(&b));
        let left = (self.yy - b.dot(&solved)).max(1e-12 * self.yy);
        let log_volume =
            chol.as_ref().map_or(0.0, |c| 2.0 * c.l_dirty().diagonal().iter().map(|d| d.ln()).sum::<f64>());
        Conditioned {
            columns: at,
            products,
            factors,
            chol,
            known,
            known_products,
            flat,
            has_process: set.iter().any(|m| columns.process[m.variant]),
            solved,
            left,
            log_volume,
            ..Conditioned::default()
        }
    }

    /// Log evidence of a set.
    pub(super) fn log_evidence(&self, set: &Conditioned) -> f64 {
        self.none - 0.5 * set.log_volume - 0.5 * self.freedom * (set.left / self.yy).ln()
    }

    /// Posterior mean and covariance (in units of the white variance) of the coefficients of a set, in the scale of
    /// [`Columns`], in the order of its members.
    pub(super) fn coefficients(&self, set: &Conditioned) -> (Vec<usize>, DVector<f64>, DMatrix<f64>) {
        let k = set.columns.len();
        let mean = DVector::from_fn(k, |i, _| set.solved[i] * set.factors[i]);
        let inverse = set.chol.as_ref().map_or_else(|| DMatrix::identity(k, k), Cholesky::inverse);
        let covariance = DMatrix::from_fn(k, k, |i, j| inverse[(i, j)] * set.factors[i] * set.factors[j]);
        (set.columns.clone(), mean, covariance)
    }

    /// What each label adds to a set; nothing where none of its variants is seen, and for those in the set.
    pub(super) fn additions(&self, columns: &Columns, members: &[Member]) -> Additions {
        let mut key: Vec<(usize, usize)> = members.iter().map(|m| (m.variant, m.scale)).collect();
        key.sort_unstable();
        let known = self.additions.borrow().get(&key).cloned();
        known.unwrap_or_else(|| {
            let set = self.condition(columns, members);
            let is_member = |label: usize| members.iter().any(|m| columns.label[m.variant] == label);
            let of = |label| if is_member(label) { None } else { self.addition(columns, &set, label) };
            let all: Additions = Rc::new((0..columns.labels).map(of).collect());
            self.additions.borrow_mut().insert(key, all.clone());
            all
        })
    }

    /// What a label adds to a set; nothing where none of its variants is seen.
    pub(super) fn addition(&self, columns: &Columns, set: &Conditioned, label: usize) -> Option<Addition> {
        let base = self.log_evidence(set);
        let variants = &columns.variants[label];
        let mut best: Option<(Member, f64)> = None;
        let mut all = Vec::with_capacity(variants.len() * EFFECT_SCALES.len());
        for variant in variants {
            let (first, k) = columns.span[*variant];
            // what the set can say already has no name of its own
            if !self.is_independent(columns, set, *variant) {
                continue;
            }
            let beside = self.beside(set, *variant, (first, k));
            for scale in columns.scales(*variant) {
                let member = Member { variant: *variant, scale, average: 0.0 };
                let factor = columns.factor(member).powi(2);
                let (drop, volume) = beside.evidence(factor);
                let left = (set.left - drop).max(1e-12 * self.yy);
                let e = base - 0.5 * volume - 0.5 * self.freedom * (left / set.left).ln();
                all.push(e);
                if best.is_none_or(|(_, b)| e > b) {
                    best = Some((member, e));
                }
            }
        }
        let (member, most) = best?;
        let average = (all.iter().map(|e| (e - most).exp()).sum::<f64>() / all.len() as f64).ln();
        Some(Addition { member: Member { average, ..member }, log_evidence: most + average })
    }

    /// False where, with a random process on either side, a combination of the columns of a variant is one of those of a set: only the
    /// priors tell the two apart. What a table leaves of a position is its line, and that has a name of its own.
    fn is_independent(&self, columns: &Columns, set: &Conditioned, variant: usize) -> bool {
        let (first, k) = columns.span[variant];
        let is_line = set.known.contains(&first) && !set.columns.contains(&first);
        let is_asked = (set.has_process || columns.process[variant]) && self.is_full[variant] && !is_line;
        let Some(flat) = set.flat.as_ref().filter(|_| is_asked) else { return true };
        let mut at: Vec<usize> = (first..first + k).collect();
        at.extend(columns.line[variant].filter(|line| !set.known.contains(line)));
        let half = set
            .flat_half
            .get_or_init(|| solve_products(flat, &set.known_products, &vec![1.0; set.known.len()]));
        let half = half.select_columns(&at);
        let beside = |own: &DMatrix<f64>| is_full(&(own - half.tr_mul(&half)), own);
        if at.len() == k {
            return beside(&self.own[variant]);
        }
        let mut known = self.own_with_line.borrow_mut();
        beside(known.entry(variant).or_insert_with(|| {
            let w = self.w.select_columns(&at);
            product(&w, &w)
        }))
    }

    /// The conditional Gram matrix of some columns beside a set, and the gap along them.
    fn beside(&self, set: &Conditioned, variant: usize, (first, k): (usize, usize)) -> Tridiagonal {
        let mut own = self.own[variant].clone();
        let Some(chol) = &set.chol else { return Tridiagonal::new(own, self.b.rows(first, k).into_owned()) };
        let seen = set.seen.get_or_init(|| {
            let mut seen = self.b.clone();
            let parts = set.products.iter().zip(&set.factors).zip(set.solved.iter());
            parts.for_each(|((products, factor), solved)| seen.axpy(-factor * solved, products, 1.0));
            seen
        });
        let half =
            set.half.get_or_init(|| solve_products(chol, &set.products, &set.factors)).columns(first, k);
        own -= half.tr_mul(&half);
        Tridiagonal::new(own, seen.rows(first, k).into_owned())
    }
}

impl Columns {
    /// Standard deviation of each coefficient of a member, in units of the white noise.
    pub(super) fn factor(&self, member: Member) -> f64 {
        let (_, width) = self.span[member.variant];
        EFFECT_SCALES[member.scale].min(self.largest[member.variant]) / (width.max(1) as f64).sqrt()
    }

    /// Places of the scales that a variant can have; above its largest they are all alike.
    fn scales(&self, variant: usize) -> impl Iterator<Item = usize> {
        let step = if self.process[variant] { 1 } else { 2 };
        let places = (0..EFFECT_SCALES.len()).step_by(step);
        let below = places.clone().filter(|at| EFFECT_SCALES[*at] < self.largest[variant]).count();
        places.take(below + 1)
    }

    /// Labels with the same column as another that mechanics let be as large (in standard deviations of the white noise).
    pub(super) fn aliases_of(&self, label: usize, size: f64) -> Vec<usize> {
        let reaches = |alias: usize| {
            let mut of = self.label.iter().zip(&self.largest).filter(|(l, _)| **l == alias);
            of.any(|(_, largest)| size <= SURE * largest)
        };
        let own = self.aliases.iter().filter(|(_, other)| *other == label).map(|(alias, _)| *alias);
        own.filter(|alias| reaches(*alias)).collect()
    }

    /// The same with the columns of some variants only.
    pub(super) fn only(&self, variants: &BTreeSet<usize>) -> Self {
        let mut span = vec![(0, 0); self.span.len()];
        let mut kept = Vec::new();
        for v in variants {
            let (at, k) = self.span[*v];
            span[*v] = (kept.len(), k);
            kept.extend(at..at + k);
        }
        Self {
            values: self.values.select_columns(&kept),
            span,
            largest: self.largest.clone(),
            label: self.label.clone(),
            process: self.process.clone(),
            line: vec![None; self.line.len()],
            labels: self.labels,
            variants: self.variants.clone(),
            visible: self.visible,
            aliases: self.aliases.clone(),
        }
    }

    /// Scales raw columns (a row of `width` values per reading), those of a `process` in proportion, and finds those that offsets
    /// leave under white noise; `largest` is the largest standard deviation of each coefficient in units of the white noise.
    pub(super) fn new(
        raw: &[f64],
        rows: usize,
        (span, label, process): (Vec<(usize, usize)>, Vec<usize>, Vec<bool>),
        largest: &[f64],
        rank: &[usize],
        white: &Covariance,
    ) -> Self {
        let labels = rank.len();
        let width = span.last().map_or(0, |(at, k)| at + k);
        let mut values = DMatrix::from_row_slice(rows, width, raw);
        let mut norms: Vec<f64> =
            values.column_iter().map(|c| (c.norm_squared() / rows.max(1) as f64).sqrt()).collect();
        for ((at, k), _) in span.iter().zip(&process).filter(|(_, is_process)| **is_process) {
            let own = &mut norms[*at..at + k];
            let mean = own.iter().map(|n| n * n).sum::<f64>() / *k as f64;
            own.fill(mean.sqrt());
        }
        for (mut c, norm) in values.column_iter_mut().zip(&norms).filter(|(_, norm)| **norm > 0.0) {
            c /= *norm;
        }
        let of = |(at, k): &(usize, usize)| (*at..at + k).map(|c| largest[c] * norms[c]).fold(0.0, f64::max);
        let largest = span.iter().map(of).collect();
        let seen = white.whiten(&values);
        let is_seen = |(at, k): &(usize, usize)| {
            let left: f64 = (*at..at + k).map(|c| seen.column(c).norm_squared()).sum();
            left > SEEN * (rows * k) as f64 && left.is_finite()
        };
        let mut variants = vec![Vec::new(); labels];
        for (v, s) in span.iter().enumerate() {
            if is_seen(s) {
                variants[label[v]].push(v);
            }
        }
        let mut aliases = Vec::new();
        // one column under two names: the name of all axes stands for that of one
        for l in 0..labels {
            let kept: Vec<usize> = variants[l]
                .iter()
                .copied()
                .filter(|v| {
                    let other = (0..labels)
                        .filter(|o| rank[*o] < rank[l])
                        .find(|o| variants[*o].iter().any(|w| is_alike(&seen, span[*v], span[*w])));
                    if let Some(other) = other {
                        aliases.push((l, other));
                    }
                    other.is_none()
                })
                .collect();
            variants[l] = kept;
        }
        aliases.dedup();
        let visible = variants.iter().filter(|v| !v.is_empty()).count();
        let line = vec![None; span.len()];
        Self { values, span, largest, label, process, line, labels, variants, visible, aliases }
    }
}

/// `L^-1 F P` for the products `P` of some columns with all columns, a row each, and their factors `F`.
fn solve_products(
    chol: &Cholesky<f64, nalgebra::Dyn>,
    products: &[Rc<DVector<f64>>],
    factors: &[f64],
) -> DMatrix<f64> {
    let width = products.first().map_or(0, |p| p.len());
    let mut half = DMatrix::zeros(products.len(), width);
    for ((mut row, products), factor) in half.row_iter_mut().zip(products).zip(factors) {
        row.tr_copy_from(products);
        row *= *factor;
    }
    solve_lower(&chol.l(), &mut half);
    half
}

/// True where no combination of columns with this Gram matrix vanishes against the mean square of the whole columns.
fn is_full(gram: &DMatrix<f64>, whole: &DMatrix<f64>) -> bool {
    let n = gram.nrows();
    let least = DEGENERATE * whole.trace() / n.max(1) as f64;
    // its least eigenvalue is above that where this is positive definite
    n > 0 && Cholesky::new(gram - DMatrix::identity(n, n) * least).is_some()
}

/// True for two single columns that are the same but for their size.
fn is_alike(seen: &DMatrix<f64>, (a, k): (usize, usize), (b, l): (usize, usize)) -> bool {
    if k != 1 || l != 1 {
        return false;
    }
    let (a, b) = (seen.column(a), seen.column(b));
    let size = a.norm() * b.norm();
    size > 0.0 && a.dot(&b).abs() > (1.0 - DEGENERATE) * size
}
