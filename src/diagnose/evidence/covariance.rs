//! The covariance of what is no effect: white noise, drift, discrepancy, lack of fit; and the offsets of the mountings.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{DMatrix, DVector};

use super::super::constants::{FEW, LENGTHS, NAMED_RUNG, NOISE_SCALES, REPEATS, TIMES};
use super::super::dense::{cholesky, inverse_lower, product};
use super::super::library::Shape;
use super::super::moment::{Moment, SLOTS};
use super::super::session::Session;
use super::grouping;
use volcomp_model::geometry::Vec3;

/// Way within which an axis stays, mm or rad.
const STAYS: f64 = 1e-6;

/// A component of the covariance beside white noise.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Component {
    /// Ornstein-Uhlenbeck drift of a setup with the correlation time of this index.
    Drift(usize),
    /// An offset of each repetition of the program.
    Run,
    /// Discrepancy over the place with the correlation length of this index.
    Place(usize),
    /// Discrepancy over place and direction of travel.
    Direction(usize),
    /// Discrepancy over place and velocity.
    Speed(usize),
    /// Lack of fit: the same at every visit of a programmed point.
    LackOfFit,
    /// The effect of this label is not the same everywhere, or not of the form of its formula.
    Misform(usize),
}

impl Component {
    /// What the component stands for in the shares of the gap: false for drift and offsets of runs.
    #[must_use]
    pub const fn is_discrepancy(self) -> bool {
        !matches!(self, Self::Drift(_) | Self::Run)
    }
}

/// Readings of the comparison and the components that their plan allows.
#[derive(Debug, Clone)]
pub struct Structure {
    /// Rows of the session behind each reading or mean of readings, in order.
    pub groups: Vec<Vec<usize>>,
    /// White noise of the best instrument, um.
    pub white_um: f64,
    /// Variance of the white noise of each, relative to it.
    pub white: Vec<f64>,
    /// Components with their matrices, unit variance.
    pub components: Vec<(Component, DMatrix<f64>)>,
    /// Offsets of the mountings, and rotations of those of a tracker or CMM, a column each.
    pub offsets: DMatrix<f64>,
    /// Setup of each group.
    pub(super) setup: Vec<usize>,
    /// Longest setup, s.
    pub duration_s: f64,
    /// Correlation over the place with the longest length.
    near: DMatrix<f64>,
    /// Mean state of each group.
    means: Vec<Moment>,
    /// Number of distinct places.
    places: usize,
    /// What goes with the place is an error of one axis.
    named: bool,
}

impl Structure {
    /// Highest place of the scale of a component in [`NOISE_SCALES`].
    pub(super) fn top(&self, component: usize) -> usize {
        match self.components[component].0 {
            Component::Place(_) if self.named => NAMED_RUNG,
            _ => NOISE_SCALES.len() - 1,
        }
    }

    /// `diag(weights) + SUM scale^2 component`, in units of the white variance.
    pub(super) fn sum(&self, scales: &[f64], weights: &[f64]) -> DMatrix<f64> {
        let mut c = DMatrix::from_diagonal(&DVector::from_column_slice(weights));
        for ((_, m), s) in self.components.iter().zip(scales).filter(|(_, s)| **s > 0.0) {
            c.zip_apply(m, |a, b| *a += s * s * b);
        }
        c
    }

    /// Allows an effect to differ from its formula: a free curve by any rougher function of the same position in the same
    /// direction, anything else by a factor that varies smoothly over the place. `part` is what it does at each reading.
    pub fn misform(&mut self, label: usize, shape: &Shape, part: &DVector<f64>) {
        // at one place a factor over the place is the size of the effect itself
        if self.places <= FEW {
            return;
        }
        let n = part.len();
        let curve = shape.acts_along().zip(shape.over()).filter(|_| shape.is_free_curve());
        let m = if let Some((along, over)) = curve {
            let at = |k: usize| self.means[k].position[over.slot()];
            let (low, high) =
                (0..n).map(at).fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
            let length = LENGTHS[0] * (high - low).max(f64::MIN_POSITIVE);
            let u = |k: usize| self.means[k].u[along.direction()];
            DMatrix::from_fn(n, n, |i, j| u(i) * u(j) * (-(at(i) - at(j)).abs() / length).exp())
        } else {
            let size = part.norm() / (n as f64).sqrt();
            if size <= 0.0 {
                return;
            }
            // the mean of the factor where the effect acts is its size, which has a name
            let weights = part.component_mul(part);
            let with_mean = &self.near * &weights;
            let of_mean = weights.dot(&with_mean);
            let factor = |i: usize, j: usize| self.near[(i, j)] - with_mean[i] * with_mean[j] / of_mean;
            DMatrix::from_fn(n, n, |i, j| part[i] * part[j] * factor(i, j) / (size * size))
        };
        self.components.push((Component::Misform(label), m));
    }

    /// The components that the readings can show.
    #[must_use]
    pub fn new(session: &Session, groups: Vec<Vec<usize>>, white_um: &[f64]) -> Self {
        let n = groups.len();
        let means = grouping::means(session, &groups);
        let at = |k: usize| &means[k];
        let reading = |k: usize| &session.readings[groups[k][0]];
        let least = (0..n).map(|k| white_um[reading(k).instrument]).fold(f64::INFINITY, f64::min);
        let white: Vec<f64> = (0..n)
            .map(|k| (white_um[reading(k).instrument] / least).powi(2) / groups[k].len() as f64)
            .collect();
        let ranges: Vec<(f64, f64)> = (0..SLOTS)
            .map(|s| {
                (0..n).map(|k| at(k).position[s]).fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| {
                    if v.is_finite() { (l.min(v), h.max(v)) } else { (l, h) }
                })
            })
            .collect();
        let moving: Vec<usize> = (0..SLOTS).filter(|s| ranges[*s].1 - ranges[*s].0 > STAYS).collect();
        let distance = |i: usize, j: usize| {
            let square = |s: &usize| {
                ((at(i).position[*s] - at(j).position[*s]) / (ranges[*s].1 - ranges[*s].0)).powi(2)
            };
            moving.iter().map(square).sum::<f64>().sqrt()
        };
        let same_setup = |i: usize, j: usize| reading(i).setup == reading(j).setup;
        let u = |i: usize, j: usize| at(i).u.dot(&at(j).u);
        // mounting and length of a ballbar drift, the former as a vector
        let drifting = |i: usize, j: usize| {
            if at(i).is_ballbar && at(j).is_ballbar { 0.5 * (1.0 + u(i, j)) } else { u(i, j) }
        };
        let build = |f: &dyn Fn(usize, usize) -> f64| {
            let mut m = DMatrix::zeros(n, n);
            for i in 0..n {
                for j in 0..=i {
                    let v = f(i, j);
                    m[(i, j)] = v;
                    m[(j, i)] = v;
                }
            }
            m
        };
        let mut components = Vec::new();
        let setups = by_setup(session, &groups);
        let spans = setups.values().map(|of| {
            let times = of.iter().map(|k| at(*k).t_s);
            times.clone().fold(f64::NEG_INFINITY, f64::max) - times.fold(f64::INFINITY, f64::min)
        });
        let duration_s = spans.fold(0.0, f64::max);
        if duration_s > 0.0 {
            for (t, share) in TIMES.iter().enumerate() {
                let tau = share * duration_s;
                components.push((
                    Component::Drift(t),
                    build(&|i, j| {
                        if same_setup(i, j) {
                            drifting(i, j) * (-(at(i).t_s - at(j).t_s).abs() / tau).exp()
                        } else {
                            0.0
                        }
                    }),
                ));
            }
        }
        // repetitions hold both directions; passes of their own would take a reversal for offsets
        let cycles: BTreeSet<(usize, i64)> = (0..n).map(|k| (reading(k).setup, reading(k).repeat)).collect();
        if cycles.len() > REPEATS {
            let same = |i: usize, j: usize| {
                if same_setup(i, j) && reading(i).repeat == reading(j).repeat { u(i, j) } else { 0.0 }
            };
            components.push((Component::Run, build(&same)));
        }
        let named = setups.values().all(|of| shows_one_axis(&means, of, &moving));
        let point = points(&means);
        let count = point.iter().max().map_or(0, |p| p + 1);
        let places = places(&means, &moving);
        for (l, length) in LENGTHS.iter().enumerate() {
            let near = |i: usize, j: usize| (-distance(i, j) / length).exp();
            if places > FEW {
                components.push((Component::Place(l), build(&|i, j| u(i, j) * near(i, j))));
            }
            let directed = |s: &usize| {
                let signs: Vec<f64> = (0..n).map(|k| at(k).direction[*s]).collect();
                signs.iter().any(|v| *v > 0.0) && signs.iter().any(|v| *v < 0.0)
            };
            let turning: Vec<usize> = moving.iter().copied().filter(directed).collect();
            if !turning.is_empty() && places > FEW {
                let product = |i: usize, j: usize| {
                    turning.iter().map(|s| at(i).direction[*s] * at(j).direction[*s]).sum::<f64>()
                        / turning.len() as f64
                };
                let m = build(&|i, j| u(i, j) * product(i, j) * near(i, j));
                components.push((Component::Direction(l), beside_means(m, &reversals(&means, &turning))));
            }
            let fastest: Vec<(usize, f64)> = moving
                .iter()
                .map(|s| (*s, (0..n).map(|k| at(k).velocity[*s].abs()).fold(0.0, f64::max)))
                .filter(|(_, v)| *v > 1e-6)
                .collect();
            if !fastest.is_empty() && places > FEW {
                let product = |i: usize, j: usize| {
                    fastest
                        .iter()
                        .map(|(s, v)| at(i).velocity[*s] * at(j).velocity[*s] / (v * v))
                        .sum::<f64>()
                        / fastest.len() as f64
                };
                components.push((Component::Speed(l), build(&|i, j| u(i, j) * product(i, j) * near(i, j))));
            }
        }
        if 2 * n >= 3 * count && count > 1 {
            let same = |i: usize, j: usize| f64::from(u8::from(point[i] == point[j]));
            components.push((Component::LackOfFit, build(&same)));
        }
        let offsets = offsets(session, &groups, setups.values());
        let near = build(&|i, j| (-distance(i, j) / LENGTHS[LENGTHS.len() - 1]).exp());
        let setup = (0..n).map(|k| reading(k).setup).collect();
        Self {
            groups,
            white_um: least,
            white,
            components,
            offsets,
            setup,
            duration_s,
            near,
            means,
            places,
            named,
        }
    }
}

/// What a reversal of each axis that is the same everywhere does along each coordinate, a column each.
fn reversals(means: &[Moment], turning: &[usize]) -> Vec<DVector<f64>> {
    let of = |s: usize, c: usize| DVector::from_fn(means.len(), |k, _| means[k].direction[s] * means[k].u[c]);
    turning.iter().flat_map(|s| (0..3).map(move |c| (*s, c))).map(|(s, c)| of(s, c)).collect()
}

/// The covariance of what varies about the mean: a mean has a name (backlash, lateral play) and is no discrepancy.
fn beside_means(mut m: DMatrix<f64>, means: &[DVector<f64>]) -> DMatrix<f64> {
    let mut basis = Basis::default();
    means.iter().for_each(|column| basis.add(column.clone()));
    if basis.vectors.is_empty() {
        return m;
    }
    let basis = DMatrix::from_columns(&basis.vectors);
    for _ in 0..2 {
        let known = product(&basis, &m);
        m.gemm(-1.0, &basis, &known, 1.0);
        m.transpose_mut();
    }
    m
}

/// Programmed point of each row: position, directions of travel and direction of sensitivity.
fn points(means: &[Moment]) -> Vec<usize> {
    let mut known: BTreeMap<Vec<i64>, usize> = BTreeMap::new();
    let key = |k: usize| {
        let m = &means[k];
        let position = m.position.iter().map(|p| (p * 1e3).round() as i64);
        let direction = m.direction.iter().map(|d| *d as i64);
        let u = m.u.iter().map(|c| (c * 50.0).round() as i64);
        position.chain(direction).chain(u).collect::<Vec<_>>()
    };
    (0..means.len())
        .map(|k| {
            let next = known.len();
            *known.entry(key(k)).or_insert(next)
        })
        .collect()
}

/// Number of distinct places.
fn places(means: &[Moment], moving: &[usize]) -> usize {
    let place =
        |m: &Moment| -> Vec<i64> { moving.iter().map(|s| (m.position[*s] * 1e3).round() as i64).collect() };
    means.iter().map(place).collect::<BTreeSet<_>>().len()
}

/// The groups of each setup, in order.
fn by_setup(session: &Session, groups: &[Vec<usize>]) -> BTreeMap<usize, Vec<usize>> {
    let mut setups: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for (k, rows) in groups.iter().enumerate() {
        setups.entry(session.readings[rows[0]].setup).or_default().push(k);
    }
    setups
}

/// True where the groups of a setup show one axis along itself or straight across, or its angles: what goes with the place is
/// then a positioning, straightness or angular error.
fn shows_one_axis(means: &[Moment], of_setup: &[usize], moving: &[usize]) -> bool {
    let first = &means[of_setup[0]];
    let moves =
        |s: &&usize| of_setup.iter().any(|k| (means[*k].position[**s] - first.position[**s]).abs() > STAYS);
    match moving.iter().filter(moves).collect::<Vec<_>>()[..] {
        [] => true,
        [one] => *one >= 3 || of_setup.iter().all(|k| means[*k].u.amax() > 0.99),
        _ => false,
    }
}

/// Columns of the offsets of every setup, three or one along a common line, and three of a small rotation where the mounting of
/// the instrument turns.
fn offsets<'a>(
    session: &Session,
    groups: &[Vec<usize>],
    setups: impl Iterator<Item = &'a Vec<usize>>,
) -> DMatrix<f64> {
    let mut columns: Vec<DVector<f64>> = Vec::new();
    for places in setups {
        let rows: Vec<usize> = places.iter().flat_map(|k| groups[*k].iter().copied()).collect();
        let moment = |i: usize| &session.moments[i];
        let mut add = |f: &dyn Fn(usize) -> f64| {
            let mut c = DVector::zeros(groups.len());
            for k in places {
                c[*k] = groups[*k].iter().map(|i| f(*i)).sum::<f64>() / groups[*k].len() as f64;
            }
            columns.push(c);
        };
        let first = moment(rows[0]).u;
        let one_line = rows.iter().all(|i| moment(*i).u.dot(&first).abs() > 0.9999);
        if one_line {
            add(&|i| moment(i).u.dot(&first).signum());
        } else {
            (0..3).for_each(|d| add(&|i| moment(i).u[d]));
        }
        if session.rotates(rows[0], one_line) {
            let centre = rows.iter().map(|i| moment(*i).seen_mm()).sum::<Vec3>() / rows.len() as f64;
            for d in 0..3 {
                add(&|i| ((moment(i).seen_mm() - centre) * 1e-3).cross(&moment(i).u)[d]);
            }
        }
    }
    DMatrix::from_columns(&columns)
}

/// Orthonormal vectors of what was added, one by one.
#[derive(Debug, Default)]
pub(super) struct Basis {
    pub(super) vectors: Vec<DVector<f64>>,
    /// `ln |F' F|` of the vectors added that are independent.
    pub(super) log_determinant: f64,
}

impl Basis {
    /// Adds a vector, unless those before it say all of it.
    pub(super) fn add(&mut self, v: DVector<f64>) {
        let before = v.norm();
        let v = self.beside(v);
        let own = v.norm();
        if own > 1e-6 * before && own > 0.0 {
            self.log_determinant += 2.0 * own.ln();
            self.vectors.push(v / own);
        }
    }

    /// A vector without what those of the basis say; twice, for rounding.
    pub(super) fn beside(&self, mut v: DVector<f64>) -> DVector<f64> {
        for _ in 0..2 {
            for b in &self.vectors {
                let p = b.dot(&v);
                v.axpy(-p, b, 1.0);
            }
        }
        v
    }
}

/// A covariance with its whitening: `L^-1` and an orthonormal basis of the whitened offsets.
#[derive(Debug, Clone, PartialEq)]
pub struct Covariance {
    /// `L^-1`, lower triangular.
    inverse: DMatrix<f64>,
    basis: DMatrix<f64>,
    /// `ln |C| + ln |F' C^-1 F|`.
    pub log_determinant: f64,
}

impl Covariance {
    /// `C = diag(weights) + SUM scale^2 component`, in units of the white variance; nothing where it is not positive definite.
    #[must_use]
    pub fn new(structure: &Structure, scales: &[f64], weights: &[f64]) -> Option<Self> {
        let c = structure.sum(scales, weights);
        let n = c.nrows();
        let l = cholesky(c)?;
        let mut log_determinant = 2.0 * l.diagonal().iter().map(|d| d.ln()).sum::<f64>();
        let inverse = inverse_lower(&l);
        let whitened = &inverse * &structure.offsets;
        let mut basis = Basis::default();
        whitened.column_iter().for_each(|column| basis.add(column.into_owned()));
        let Basis { vectors: basis, log_determinant: of_offsets } = basis;
        log_determinant += of_offsets;
        let basis = if basis.is_empty() { DMatrix::zeros(n, 0) } else { DMatrix::from_columns(&basis) };
        Some(Self { inverse, basis, log_determinant })
    }

    /// Whitens columns and takes the offsets out of them.
    #[must_use]
    pub fn whiten(&self, columns: &DMatrix<f64>) -> DMatrix<f64> {
        let mut w = &self.inverse * columns;
        let known = product(&self.basis, &w);
        w -= &self.basis * known;
        w
    }

    /// Number of readings.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.inverse.nrows()
    }

    /// Degrees of freedom that the offsets leave.
    #[must_use]
    pub fn freedom(&self) -> usize {
        self.inverse.nrows() - self.basis.ncols()
    }

    /// `W` with `W'W` = `C^-1` with the offsets and the columns `beside` projected out: precision of each reading given all others.
    #[must_use]
    pub fn precision(&self, beside: &DMatrix<f64>) -> DMatrix<f64> {
        let mut w = self.inverse.clone();
        let known = product(&self.basis, &w);
        w -= &self.basis * known;
        let known = product(beside, &w);
        w -= beside * known;
        w
    }

    /// `L^-T v`: from whitened residuals to residuals times the precision matrix.
    #[must_use]
    pub fn back(&self, v: &DVector<f64>) -> DVector<f64> {
        self.inverse.tr_mul(v)
    }
}
