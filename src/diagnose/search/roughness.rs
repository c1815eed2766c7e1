//! Roughness: what a curve over the position of an axis is beyond its polynomial. The errors of a screw, a scale or a guideway add up
//! along it, so that few are smooth, and what the polynomial leaves at the positions of one program must not pass for effects of others.
//!
//! Beside its polynomial each positioning or straightness error has the waves of a random walk along its axis: amplitudes that fall with
//! the wave number (Karhunen-Loeve), normal coefficients, a size for each curve. Sizes, and with them the effects that are left of those
//! chosen, are compared as models ([`super::size_comparison`]). Source: `docs/explanation/diagnosis.md` (roughness).

use core::f64::consts::PI;
use std::sync::Arc;

use nalgebra::{DMatrix, DVector};

use volcomp_model::geometry::Vec3;

use super::super::constants::{ROUNDS, STRONG};
use super::super::library::{Library, Shape, WIDTH_MAX};
use super::super::moment::{Axis, Moment, SLOTS};
use super::super::noise::Filter;
use super::super::session::Session;
use super::discrepancy::SCALES;
use super::low_rank::LowRank;
use super::problem::Problem;
use super::select::Selection;
use super::size_comparison::{Sets, Sized};

/// Waves of a curve: from twice the way of its axis to a fortieth of it; what is finer has 9 % of the RMS of a random walk.
pub(crate) const WAVES: usize = 80;
/// Factors of the size of one curve that are tried beside those of the others.
const FACTORS: [f64; 2] = [0.5, 2.0];

/// Roughness of some curves.
#[derive(Debug, Clone)]
pub struct Roughness {
    /// What joins the noise.
    pub(crate) noise: LowRank,
    /// The curves that are rough.
    pub(crate) curves: Vec<Rough>,
    /// Their waves, whitened by the filter alone, a matrix row per row of the problem. Shared, for structure is cloned.
    pub(crate) waves: Arc<DMatrix<f64>>,
    /// Standard deviation of the coefficient of each wave.
    pub(crate) sizes: Vec<f64>,
}

/// A curve that is rough.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Rough {
    /// Direction of the displacement.
    pub(crate) along: Axis,
    /// The axis over whose positions it goes.
    pub(crate) over: Axis,
    /// Its name, an index into the labels of the library.
    pub(crate) label: usize,
    /// Middle and half of the way of its axis, mm.
    pub(crate) middle_mm: f64,
    pub(crate) half_mm: f64,
    /// The shapes beside which its waves stand, and how much of their parameters (rows) each wave (columns) is without.
    beside: Vec<Shape>,
    taken: DMatrix<f64>,
}

impl Rough {
    /// True for an effect that describes it.
    pub(crate) fn is(&self, shape: &Shape) -> bool {
        shape.is_free_curve() && shape.acts_along() == Some(self.along) && shape.over() == Some(self.over)
    }

    /// How much of its displacement a reading shows; `None` of one that shows nothing of it.
    pub(crate) fn seen_by(&self, m: &Moment) -> Option<f64> {
        let along = m.u[self.along.slot()];
        (along != 0.0 && !m.is_angular() && !m.is_encoder).then_some(along)
    }

    /// What its waves displace at a position of its axis, um per unit of their coefficients.
    pub(crate) fn waves_at(&self, position_mm: f64) -> DVector<f64> {
        let mut waves = DVector::from_iterator(WAVES, self.plain_at(position_mm));
        let mut m = Moment { direction: [0.0; SLOTS], ..Moment::default() };
        m.position[self.over.slot()] = position_mm;
        let mut columns = self.taken.row_iter();
        for shape in &self.beside {
            let mut out = [Vec3::zeros(); WIDTH_MAX];
            let out = &mut out[..shape.width()];
            shape.evaluate_with(&m, &|_| None, out);
            for (displacement, taken) in out.iter().zip(&mut columns) {
                waves.axpy(-displacement[self.along.direction()], &taken.transpose(), 1.0);
            }
        }
        waves
    }

    /// The same without what its shapes say: as large as the curve would be, RMS over the way, at size 1 um.
    fn plain_at(&self, position_mm: f64) -> impl Iterator<Item = f64> {
        let at = 0.5 * ((position_mm - self.middle_mm) / self.half_mm + 1.0);
        let mean_square: f64 = (1..=WAVES).map(|h| 0.5 / (h * h) as f64).sum();
        (1..=WAVES).map(move |h| (PI * h as f64 * at).cos() / (h as f64 * mean_square.sqrt()))
    }
}

/// A curve with the variants that describe it as a whole.
struct Curve {
    rough: Rough,
    variants: Vec<usize>,
}

/// The curves over positions of linear axes among the effects chosen. A periodic error or a worn place may stand for a curve: of such a
/// one the curve that says most of the gap by itself is what describes it as a whole.
fn curves(session: &Session, problem: &Problem, library: &Library, selection: &Selection) -> Vec<Curve> {
    let alone = problem.given(&[]);
    let mut all: Vec<Curve> = Vec::new();
    for variant in &selection.chosen {
        let shape = &library.variants[*variant].shape;
        let of = shape.acts_along().zip(shape.over());
        let of = of.filter(|(_, over)| shape.is_free_curve() && over.is_linear());
        let Some((along, over)) = of.filter(|of| all.iter().all(|c| (c.rough.along, c.rough.over) != *of))
        else {
            continue;
        };
        let Some((middle_mm, half_mm)) = problem.way(session, over) else { continue };
        let (label, taken) = (library.variants[*variant].label, DMatrix::zeros(0, WAVES));
        let mut rough = Rough { along, over, label, middle_mm, half_mm, beside: Vec::new(), taken };
        let name = |v: &usize| library.labels[library.variants[*v].label].effect;
        let is_whole = |v: &usize| {
            let shape = &library.variants[*v].shape;
            // waves have no direction of travel
            let is_one_way = !matches!(shape, Shape::Reverse(_));
            ["positioning", "straightness"].contains(&name(v)) && is_one_way && rough.is(shape)
        };
        let mut variants: Vec<usize> = selection.chosen.iter().copied().filter(is_whole).collect();
        if variants.is_empty() {
            let brings = |v: &usize| selection.brings(library, *v, problem.gain(&alone, *v)).evidence;
            let others = (0..library.variants.len()).filter(is_whole);
            variants.extend(others.max_by(|a, b| brings(a).total_cmp(&brings(b))));
        }
        rough.label = variants.first().map_or(rough.label, |v| library.variants[*v].label);
        all.push(Curve { rough, variants });
    }
    all
}

/// Whitened waves of every curve, beside what its own variants say.
fn waves(
    session: &Session,
    filter: &Filter,
    problem: &Problem,
    library: &Library,
    curves: &mut [Curve],
) -> DMatrix<f64> {
    let width = curves.len() * WAVES;
    let mut data = vec![0.0; problem.rows.len() * width];
    for (row, i) in data.chunks_exact_mut(width).zip(&problem.rows) {
        let m = &session.moments[*i];
        for (c, to) in curves.iter().zip(row.chunks_exact_mut(WAVES)) {
            let Some(along) = c.rough.seen_by(m) else { continue };
            let plain = c.rough.plain_at(m.position[c.rough.over.slot()]);
            to.iter_mut().zip(plain).for_each(|(to, wave)| *to = along * wave);
        }
    }
    problem.whiten(filter, &mut data, width);
    let mut waves = DMatrix::from_row_slice(problem.rows.len(), width, &data);
    for (k, curve) in curves.iter_mut().enumerate() {
        let own = waves.columns(k * WAVES, WAVES).into_owned();
        let (rest, taken) = problem.divided(&problem.given(&curve.variants), &own);
        waves.columns_mut(k * WAVES, WAVES).copy_from(&rest);
        curve.rough.beside = curve.variants.iter().map(|v| library.variants[*v].shape.clone()).collect();
        curve.rough.taken = taken;
    }
    waves
}

/// The roughness that, with those of the effects chosen that it leaves (returned with it), says more than all of them without
/// one; `None` where there is no such. `least_um` is the white noise of the best instrument.
#[must_use]
pub fn roughness(
    session: &Session,
    filter: &Filter,
    problem: &mut Problem,
    library: &Library,
    selection: &Selection,
    least_um: f64,
) -> Option<(Roughness, Vec<usize>)> {
    let mut curves = curves(session, problem, library, selection);
    if curves.is_empty() {
        return None;
    }
    problem.prepare(&curves.iter().flat_map(|c| c.variants.iter().copied()).collect::<Vec<_>>());
    let waves = waves(session, filter, problem, library, &mut curves);
    let sets = Sets::new(problem, library, selection, &waves);
    let found = one_by_one(&sets, sets.most_likely(&SCALES.map(|s| s * least_um))?);
    let kept = sets.kept(&found)?;
    let noise = LowRank::of(&waves, &found.sizes);
    let is_rough = |k: usize| found.sizes[k * WAVES] > 0.0;
    let rough: Vec<usize> = (0..waves.ncols()).filter(|wave| is_rough(wave / WAVES)).collect();
    let sizes = rough.iter().map(|wave| found.sizes[*wave]).collect();
    let waves = Arc::new(waves.select_columns(&rough));
    let curves = curves.into_iter().enumerate().filter(|(k, _)| is_rough(*k)).map(|(_, curve)| curve.rough);
    let curves: Vec<Rough> = curves.collect();
    (!curves.is_empty()).then_some((Roughness { noise, curves, waves, sizes }, kept))
}

/// Sizes of single curves: twice or half as large where that says more, none where its own says little.
fn one_by_one(sets: &Sets<'_>, start: Sized) -> Sized {
    let mut best = start;
    for _ in 0..ROUNDS {
        let before = best.sizes.clone();
        for at in (0..best.sizes.len()).step_by(WAVES) {
            let with = |factor: f64, best: &Sized| {
                let mut sizes = best.sizes.clone();
                sizes[at..at + WAVES].iter_mut().for_each(|s| *s *= factor);
                sets.under(sizes)
            };
            for factor in FACTORS {
                best = with(factor, &best).filter(|other| other.evidence > best.evidence).unwrap_or(best);
            }
            best = with(0.0, &best).filter(|none| none.evidence > best.evidence - STRONG).unwrap_or(best);
        }
        if best.sizes == before {
            break;
        }
    }
    best
}

#[cfg(test)]
impl Roughness {
    /// Of no curve.
    pub(super) fn made_up(noise: LowRank) -> Self {
        Self { noise, curves: Vec::new(), waves: Arc::new(DMatrix::zeros(0, 0)), sizes: Vec::new() }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::DVector;

    use super::super::super::library::{Kind, Label, Variant, forms};
    use super::super::super::noise::Random;
    use super::*;

    const N: usize = 200;

    /// Two axes, the readings of one after those of the other; a line over each is an effect. A random walk of so many standard deviations
    /// of the noise along the first.
    fn sizes(walk: f64) -> Option<Vec<f64>> {
        let mut random = Random::new(7);
        let at = |i: usize| (i % N) as f64 / (N - 1) as f64;
        let own = |axis: usize, f: &dyn Fn(f64) -> f64| {
            DVector::from_fn(2 * N, |i, _| if i / N == axis { f(at(i)) } else { 0.0 })
        };
        let effects: Vec<Vec<DVector<f64>>> = (0..2).map(|axis| vec![own(axis, &|x| x - 0.5)]).collect();
        let waves = (0..2).flat_map(|axis| (1..=WAVES).map(move |h| (axis, h as f64)));
        let waves = waves.map(|(axis, h)| own(axis, &|x| (PI * h * x).cos() / h));
        let waves = DMatrix::from_columns(&waves.collect::<Vec<_>>());
        let mut y = DVector::from_fn(2 * N, |_, _| random.normal());
        effects.iter().flatten().for_each(|line| y.axpy(40.0, line, 1.0));
        let coefficients =
            DVector::from_fn(2 * WAVES, |k, _| if k < WAVES { walk * random.normal() } else { 0.0 });
        y += &waves * coefficients;
        let variants =
            (0..2).map(|label| Variant { label, shape: Shape::Scale(forms::Scale { axis: Axis::X }) });
        let library = Library {
            labels: ["x", "y"].map(|axis| Label::new("scale", axis)).to_vec(),
            kinds: vec![Kind::Machine; 2],
            variants: variants.collect(),
            ..Library::default()
        };
        let selection =
            Selection { chosen: vec![0, 1], threshold: 10.0, grid: vec![1; 2], ..Selection::default() };
        let problem = Problem::made_up(&effects, y);
        let sets = Sets::new(&problem, &library, &selection, &waves);
        let found = one_by_one(&sets, sets.most_likely(&SCALES)?);
        assert_eq!(sets.kept(&found).unwrap_or_default(), if walk > 0.0 { vec![0, 1] } else { Vec::new() });
        sets.kept(&found).map(|_| found.sizes.chunks(WAVES).map(|s| s[0]).collect())
    }

    #[test]
    fn a_rough_curve_has_a_size_of_its_own_and_a_smooth_one_has_none() {
        let sizes = sizes(5.0).unwrap();
        assert!((2.0..12.0).contains(&sizes[0]) && sizes[1] == 0.0, "{sizes:?}");
    }

    #[test]
    fn smooth_curves_ask_for_no_roughness() {
        assert_eq!(sizes(0.0), None);
    }
}
