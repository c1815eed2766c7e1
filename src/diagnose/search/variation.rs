//! Effects that are not the same everywhere: a real one varies by some share over the volume, and what its formula leaves
//! there must pass for no further effect.
//!
//! Each effect is multiplied by `1 + v(x, y, z)`, `v` a smooth function of the linear axes (products of Legendre polynomials
//! up to the fourth degree) with normal coefficients of unknown common size, the variation. Its most likely value is found
//! as that of the noise is, and the products join the noise: whitening by a matrix of low rank, `(1 + U U')^-1/2`.
//! Source: discrepancy as a process beside parameters (Kennedy, O'Hagan); `docs/explanation/diagnosis.md` (variation).

use super::super::constants::{DEGENERATE, STRONG};
use super::super::dense::product;
use nalgebra::{DMatrix, DVector, SymmetricEigen};

use super::super::library::legendre;
use super::super::moment::Axis;
use super::super::noise::Filter;
use super::super::session::Session;
use super::low_rank::{LowRank, TELLS};
use super::problem::Problem;

/// Variations that are tried, relative.
const SHARES: [f64; 8] = [0.015, 0.03, 0.05, 0.08, 0.12, 0.16, 0.2, 0.25];
/// Standard deviations that are taken off before an effect is said to grow.
const GROWS: f64 = 2.0;
/// Coefficients by degree, as a share of the variation: a wave as long as the travel has about these.
pub(super) const DEGREES: [f64; 8] = [1.0, 0.8, 0.6, 0.4, 0.3, 0.25, 0.2, 0.15];
/// Highest degree of products over several axes.
pub(super) const DEGREE: usize = 4;

/// What is known of one effect.
#[derive(Debug, Clone, PartialEq)]
pub struct Varying {
    /// Its effect, as an index into the labels of the library.
    pub label: usize,
    /// Drop of the sum of squares by it beside the others, before its variation joined the noise.
    pub gain: f64,
    /// Relative, RMS over the volume; of a curve beside that along its own axis.
    pub rms: f64,
    /// How much it surely grows from the middle of each linear axis to its end (two standard deviations are taken off).
    pub grows: Vec<(Axis, f64)>,
}

impl Varying {
    /// The larger of its variation and of its growth along axes but one, relative.
    #[must_use]
    pub fn most(&self, but: Option<Axis>) -> f64 {
        let others = self.grows.iter().filter(|(axis, _)| Some(*axis) != but);
        others.map(|(_, growth)| *growth).fold(self.rms, f64::max)
    }
}

/// A variation with the directions in which it acts.
#[derive(Debug, Clone, PartialEq)]
pub struct Variation {
    /// The effects that were asked.
    effects: Vec<Varying>,
    /// What joins the noise.
    pub(crate) noise: LowRank,
}

impl Variation {
    /// The most likely variation of effects that contribute `parts` (per effect, per row of the session, um; the first ones of
    /// `chosen`) beside the columns of `chosen`, in a problem that knows of none; `None` where the likelihood does not ask
    /// for one. `of` gives the label of a variant and the axis over whose positions it is a curve. `zeros` (place in
    /// `chosen`, per row of the session, um) is what may stand beside a part without showing, as long as it does not vary.
    #[must_use]
    pub fn find(
        session: &Session,
        filter: &Filter,
        problem: &Problem,
        chosen: &[usize],
        parts: &[Vec<f64>],
        zeros: &[(usize, Vec<f64>)],
        of: &dyn Fn(usize) -> (usize, Option<Axis>),
    ) -> Option<Self> {
        let ways = ways(session, problem);
        let powers = powers(ways.len());
        let all: Vec<&[f64]> = parts.iter().chain(zeros.iter().map(|z| &z.1)).map(Vec::as_slice).collect();
        let mut products = products(session, filter, problem, &all, (&ways, &powers))?;
        // what its own parameters can say is no variation of an effect
        for (k, place) in (0..parts.len()).chain(zeros.iter().map(|z| z.0)).enumerate() {
            let own = products.columns(k * powers.len(), powers.len()).into_owned();
            let rest = problem.beside(&problem.given(&chosen[place..=place]), &own);
            products.columns_mut(k * powers.len(), powers.len()).copy_from(&rest);
        }
        let left = Left::new(problem, chosen, &products);
        let share = left.most_likely()?;
        let noise = LowRank::of(&products, &vec![share; products.ncols()]);
        let size_of = |degrees: &Vec<usize>| DEGREES[degrees.iter().sum::<usize>() - 1];
        let coefficients = left.terms(share);
        let single = left.single(&coefficients, powers.len());
        let terms: Vec<f64> =
            coefficients.iter().zip(powers.iter().cycle()).map(|(c, p)| c * size_of(p)).collect();
        let effects = chosen[..parts.len()]
            .iter()
            .zip(terms.chunks(powers.len()).zip(single.chunks(powers.len())))
            .map(|(v, terms)| {
                let others: Vec<usize> = chosen.iter().copied().filter(|o| o != v).collect();
                let gain = problem.gain_beside(&others, *v).0;
                let (label, own_axis) = of(*v);
                let own = ways.iter().position(|w| Some(w.0) == own_axis);
                let (rms, grows) = varying(terms, own, &ways, &powers);
                Varying { label, gain, rms, grows }
            })
            .collect();
        Some(Self { effects, noise })
    }

    /// How much of each part would show if it varied along a line: the energy of its products with each linear axis, whitened.
    #[must_use]
    pub fn would_show(session: &Session, filter: &Filter, problem: &Problem, parts: &[Vec<f64>]) -> Vec<f64> {
        let ways = ways(session, problem);
        let mut lines = powers(ways.len());
        lines.retain(|d| d.iter().sum::<usize>() == 1);
        let all: Vec<&[f64]> = parts.iter().map(Vec::as_slice).collect();
        let products = products(session, filter, problem, &all, (&ways, &lines));
        let energy = |k: usize| {
            products.as_ref().map_or(0.0, |p| p.columns(k * lines.len(), lines.len()).norm_squared())
        };
        (0..parts.len()).map(energy).collect()
    }

    /// What is known of an effect that was asked.
    #[must_use]
    pub fn of(&self, label: usize) -> Option<&Varying> {
        self.effects.iter().find(|e| e.label == label)
    }

    /// The effects that were asked, as indices into the labels of the library.
    pub fn labels(&self) -> impl Iterator<Item = usize> {
        self.effects.iter().map(|e| e.label)
    }
}

/// Degrees in each of `n` axes of all products up to the highest degree, but the constant.
pub(super) fn powers(n: usize) -> Vec<Vec<usize>> {
    let mut all = vec![Vec::new()];
    for _ in 0..n {
        let more = |d: &Vec<usize>| {
            let left = DEGREE - d.iter().sum::<usize>();
            let d = d.clone();
            (0..=left).map(move |k| d.iter().copied().chain([k]).collect::<Vec<usize>>())
        };
        all = all.iter().flat_map(more).collect();
    }
    all.retain(|d| d.iter().sum::<usize>() > 0);
    all
}

/// A linear axis that moves, the middle and half of its way, mm.
pub(super) type Way = (Axis, f64, f64);

pub(super) fn ways(session: &Session, problem: &Problem) -> Vec<Way> {
    let linear = Axis::ALL.into_iter().filter(|a| a.is_linear());
    linear.filter_map(|a| problem.way(session, a).map(|(middle, half)| (a, middle, half))).collect()
}

/// What the coefficients of one effect say (all together, and each by itself with its standard deviation): its variation
/// beside that along its `own` way, which is the form of a curve, and its growth along each way.
fn varying(
    (terms, single): (&[f64], &[(f64, f64)]),
    own: Option<usize>,
    ways: &[Way],
    powers: &[Vec<usize>],
) -> (f64, Vec<(Axis, f64)>) {
    let square = |(degrees, mean): (&Vec<usize>, &f64)| {
        mean * mean / degrees.iter().map(|d| (2 * d + 1) as f64).product::<f64>()
    };
    let beside = powers.iter().zip(terms).filter(|(d, _)| own.is_none_or(|k| d[k] == 0));
    let grows = ways.iter().enumerate().map(|(k, (axis, ..))| {
        let first = |d: &Vec<usize>| d.iter().sum::<usize>() == 1 && d[k] == 1;
        let (mean, std) = powers.iter().position(first).map_or((0.0, 0.0), |at| single[at]);
        (*axis, (mean.abs() - GROWS * std).max(0.0))
    });
    (beside.map(square).sum::<f64>().sqrt(), grows.collect())
}

/// Whitened products of the parts with polynomials of the linear axes, a column each.
pub(super) fn products(
    session: &Session,
    filter: &Filter,
    problem: &Problem,
    parts: &[&[f64]],
    (ways, powers): (&[Way], &[Vec<usize>]),
) -> Option<DMatrix<f64>> {
    let each = powers.len();
    let width = each * parts.len();
    if width == 0 {
        return None;
    }
    let mut data = vec![0.0; problem.rows.len() * width];
    for (row, i) in data.chunks_exact_mut(width).zip(&problem.rows) {
        let at = |(axis, middle, half): &Way| {
            let mut p = [0.0; DEGREES.len() + 1];
            legendre((session.moments[*i].position[axis.slot()] - middle) / half, &mut p);
            p
        };
        let p: Vec<_> = ways.iter().map(at).collect();
        for (k, degrees) in powers.iter().enumerate() {
            let product: f64 = degrees.iter().zip(&p).map(|(d, p)| p[*d]).product();
            let v = DEGREES[degrees.iter().sum::<usize>() - 1] * product;
            for (part, to) in parts.iter().zip(row[k..].iter_mut().step_by(each)) {
                *to = part[*i] * v;
            }
        }
    }
    problem.whiten_beside(filter, &mut data, width);
    Some(DMatrix::from_row_slice(problem.rows.len(), width, &data))
}

/// What the effects leave, seen by the products beside them.
pub(super) struct Left {
    /// Of the products without what the effects themselves can say.
    eigen: SymmetricEigen<f64, nalgebra::Dyn>,
    /// What is left along each of their directions.
    along: DVector<f64>,
    /// Mean square of what is left, at least 1: tails, and what nobody knows.
    noise: f64,
    /// Products of those with each other and with what is left.
    gram: DMatrix<f64>,
    seen: DVector<f64>,
}

impl Left {
    pub(super) fn new(problem: &Problem, chosen: &[usize], products: &DMatrix<f64>) -> Self {
        let given = problem.given(chosen);
        let beta = problem.fit(&given);
        let left = &problem.y - problem.contribution(&given.columns, &beta);
        let own = problem.beside(&given, products);
        let (gram, seen) = (product(&own, &own), own.tr_mul(&left));
        let noise = (left.norm_squared() / left.len().max(1) as f64).max(1.0);
        Self::of(gram, seen, noise)
    }

    /// Of products with each other and with what is left, whose mean square is `noise`.
    fn of(gram: DMatrix<f64>, seen: DVector<f64>, noise: f64) -> Self {
        let eigen = SymmetricEigen::new(gram.clone());
        let along = eigen.eigenvectors.tr_mul(&seen);
        Self { eigen, along, noise, gram, seen }
    }

    /// Some of the products beside the rest of them, whatever the size of those.
    pub(super) fn beside_rest(&self, some: &[usize]) -> Self {
        let rest: Vec<usize> = (0..self.seen.len()).filter(|k| !some.contains(k)).collect();
        let part = |rows: &[usize], columns: &[usize]| self.gram.select_rows(rows).select_columns(columns);
        let known = part(&rest, &rest);
        let most = known.diagonal().max();
        let inverse = known
            .pseudo_inverse(DEGENERATE * most)
            .unwrap_or_else(|_| DMatrix::zeros(rest.len(), rest.len()));
        let weights = part(some, &rest) * inverse;
        let gram = part(some, some) - &weights * part(&rest, some);
        let seen = self.seen.select_rows(some) - weights * self.seen.select_rows(&rest);
        Self::of(gram, seen, self.noise)
    }

    /// The value of each product by itself and its standard deviation, once the products of the other effects (`each` of an
    /// effect) have the most likely coefficients.
    fn single(&self, terms: &[f64], each: usize) -> Vec<(f64, f64)> {
        let of = |k: usize| {
            let mine = k / each * each..k / each * each + each;
            let others = (0..terms.len()).filter(|j| !mine.contains(j));
            let rest = self.seen[k] - others.map(|j| self.gram[(k, j)] * terms[j]).sum::<f64>();
            let size = self.gram[(k, k)];
            if size > TELLS { (rest / size, (self.noise / size).sqrt()) } else { (0.0, 0.0) }
        };
        (0..terms.len()).map(of).collect()
    }

    /// Twice the logarithm of the likelihood that a variation gains.
    pub(super) fn gain(&self, share: f64) -> f64 {
        let v = share * share / self.noise;
        let each = self.eigen.eigenvalues.iter().zip(self.along.iter());
        each.map(|(l, a)| {
            let l = l.max(0.0);
            a * a * v / (1.0 + v * l) / self.noise - (v * l).ln_1p()
        })
        .sum()
    }

    /// The share with the highest likelihood.
    fn most_likely(&self) -> Option<f64> {
        SHARES
            .into_iter()
            .map(|s| (s, self.gain(s)))
            .max_by(|a, b| a.1.total_cmp(&b.1))
            .filter(|(_, g)| *g > STRONG)
            .map(|(s, _)| s)
    }

    /// The most likely value of every coefficient, given the share.
    fn terms(&self, share: f64) -> Vec<f64> {
        let variance =
            self.eigen.eigenvalues.map(|l| 1.0 / (l.max(0.0) / self.noise + 1.0 / (share * share)));
        let mean = &self.eigen.eigenvectors * variance.component_mul(&self.along) / self.noise;
        mean.iter().copied().collect()
    }
}

#[cfg(test)]
impl Variation {
    /// Noise of no effect.
    pub(super) const fn made_up(noise: LowRank) -> Self {
        Self { effects: Vec::new(), noise }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn products_are_all_those_up_to_the_highest_degree() {
        assert_eq!(powers(1), [[1], [2], [3], [4]]);
        assert_eq!((powers(2).len(), powers(3).len()), (14, 34));
        assert!(powers(3).iter().all(|d| (1..=4).contains(&d.iter().sum::<usize>())));
    }

    #[test]
    fn the_polynomials_are_one_at_the_end_and_orthogonal() {
        let n = 2000;
        let values = |x: f64| {
            let mut p = [0.0; DEGREES.len() + 1];
            legendre(x, &mut p);
            p
        };
        for a in 0..5 {
            assert!((values(1.0)[a] - 1.0).abs() < 1e-12);
            for b in 0..5 {
                let at = (0..n).map(|k| values((f64::from(k) + 0.5) / 0.5 / f64::from(n) - 1.0));
                let mean: f64 = at.map(|p| p[a] * p[b]).sum::<f64>() / f64::from(n);
                let wanted = if a == b { 1.0 / (2 * a + 1) as f64 } else { 0.0 };
                assert!((mean - wanted).abs() < 1e-5, "{a} {b}: {mean}");
            }
        }
    }
}
