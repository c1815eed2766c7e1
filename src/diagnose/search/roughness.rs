//! Roughness: what a curve over the position of an axis is beyond its polynomial. The errors of a screw or a scale add up along it, so
//! that none is smooth, and what the polynomial leaves must pass for no further effect of other programs or positions.
//!
//! Each straightness or positioning error chosen has, beside its polynomial, the waves of a random walk along its axis: amplitudes that
//! fall with the wave number (Karhunen-Loeve), normal coefficients of a common size. Sizes, and with each of them the effects that are
//! left of those chosen, are compared as models, as those of a discrepancy are ([`super::discrepancy`]).

use core::f64::consts::PI;

use nalgebra::DMatrix;

use super::super::library::Library;
use super::super::moment::{Axis, Moment};
use super::super::noise::Filter;
use super::super::session::Session;
use super::discrepancy::{SCALES, Sets};
use super::low_rank::LowRank;
use super::problem::Problem;
use super::select::Selection;

/// Waves of half the travel and its parts down to a fortieth.
const WAVES: usize = 40;

/// A displacement along a direction as a function of the position of an axis, the variant that describes it, and the middle and half of
/// the way of the axis, mm.
struct Curve {
    along: Axis,
    over: Axis,
    variant: usize,
    middle_mm: f64,
    half_mm: f64,
}

fn curves(session: &Session, problem: &Problem, library: &Library, chosen: &[usize]) -> Vec<Curve> {
    let of = |variant: &usize| {
        let shape = &library.variants[*variant].shape;
        let (along, over) = shape.acts_along().zip(shape.over()).filter(|_| shape.is_free_curve())?;
        let (middle_mm, half_mm) = problem.way(session, over).filter(|_| over.is_linear())?;
        Some(Curve { along, over, variant: *variant, middle_mm, half_mm })
    };
    chosen.iter().filter_map(of).collect()
}

/// Whitened waves of every curve, each beside what its own variant says.
fn waves(session: &Session, filter: &Filter, problem: &Problem, curves: &[Curve]) -> DMatrix<f64> {
    let width = curves.len() * WAVES;
    let square: f64 = (1..=WAVES).map(|h| 0.5 / (h * h) as f64).sum();
    let sees = |m: &Moment| !m.is_angular() && !m.is_encoder;
    let mut data = vec![0.0; problem.rows.len() * width];
    for (row, i) in data.chunks_exact_mut(width).zip(&problem.rows) {
        let m = &session.moments[*i];
        for (c, to) in curves.iter().zip(row.chunks_exact_mut(WAVES)).filter(|_| sees(m)) {
            let at = 0.5 * ((m.position[c.over.slot()] - c.middle_mm) / c.half_mm + 1.0);
            for (h, v) in (1..=WAVES).zip(to) {
                *v = m.u[c.along.slot()] * (PI * h as f64 * at).cos() / (h as f64 * square.sqrt());
            }
        }
    }
    problem.whiten(filter, &mut data, width);
    let mut waves = DMatrix::from_row_slice(problem.rows.len(), width, &data);
    for (k, c) in curves.iter().enumerate() {
        let own = waves.columns(k * WAVES, WAVES).into_owned();
        let rest = problem.beside(&problem.given(&[c.variant]), &own);
        waves.columns_mut(k * WAVES, WAVES).copy_from(&rest);
    }
    waves
}

/// The roughness that, with those of the effects chosen (prepared) that it leaves (returned with it), says more than all of them without
/// one; `None` where there is no such. `least_um` is the white noise of the best instrument.
#[must_use]
pub fn roughness(
    session: &Session,
    filter: &Filter,
    problem: &Problem,
    library: &Library,
    selection: &Selection,
    least_um: f64,
) -> Option<(LowRank, Vec<usize>)> {
    let curves = curves(session, problem, library, &selection.chosen);
    if curves.is_empty() {
        return None;
    }
    let waves = waves(session, filter, problem, &curves);
    let scales = SCALES.map(|s| s * least_um);
    let (scale, kept) = Sets::new(problem, library, selection, &waves).most_likely(&scales)?;
    if std::env::var("ROUGH_SAY").is_ok() {
        let name = |v: &usize| library.labels[library.variants[*v].label].to_string();
        eprintln!("rough {scale} um of {least_um}: curves {:?} chosen {:?} kept {:?}",
            curves.iter().map(|c| name(&c.variant)).collect::<Vec<_>>(),
            selection.chosen.iter().map(name).collect::<Vec<_>>(), kept.iter().map(name).collect::<Vec<_>>());
    }
    Some((LowRank::of(&waves, scale), kept))
}
