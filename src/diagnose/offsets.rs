//! The offsets of the mountings: removed before a gap is called large or small, because they say nothing of the machine.

use super::session::Session;
use nalgebra::{DMatrix, DVector};
use volcomp_model::geometry::Vec3;

/// `values` without the best offset of each setup (and rotation of a tracker), um; NaN where not used.
#[must_use]
pub(super) fn without_offsets(session: &Session, values: &[f64], used: &[bool]) -> Vec<f64> {
    let mut out = residuals(session, values, used);
    out.iter_mut().zip(used).filter(|(_, u)| !**u).for_each(|(v, _)| *v = f64::NAN);
    out
}

/// `values` without the offset of each setup (and rotation of a tracker) that is best for those used, um; NaN where none is.
#[must_use]
pub(super) fn residuals(session: &Session, values: &[f64], used: &[bool]) -> Vec<f64> {
    let mut by_setup: Vec<Vec<usize>> = vec![Vec::new(); session.setups.len()];
    for (i, r) in session.readings.iter().enumerate() {
        by_setup[r.setup].push(i);
    }
    let mut out = vec![f64::NAN; values.len()];
    for all in by_setup {
        let rows: Vec<usize> = all.iter().copied().filter(|i| used[*i]).collect();
        if rows.is_empty() {
            continue;
        }
        let rotates = session.rotates(rows[0], false);
        let centre = rows.iter().fold(Vec3::zeros(), |c, i| c + place(session, *i)) / rows.len() as f64;
        let width = if rotates { 6 } else { 3 };
        let mut g = DMatrix::<f64>::zeros(width, width);
        let mut b = DVector::<f64>::zeros(width);
        let line = |i: usize| {
            let u = session.moments[i].u;
            let arm = ((place(session, i) - centre) * 1e-3).cross(&u);
            DVector::from_iterator(width, [u.x, u.y, u.z, arm.x, arm.y, arm.z].into_iter().take(width))
        };
        for i in &rows {
            let h = line(*i);
            g.ger(1.0, &h, &h, 1.0);
            b.axpy(values[*i], &h, 1.0);
        }
        let scale = g.diagonal().max().max(1e-12);
        let offset = g.svd(true, true).solve(&b, 1e-9 * scale).unwrap_or_else(|_| DVector::zeros(width));
        for i in all {
            out[i] = values[i] - line(i).dot(&offset);
        }
    }
    out
}

fn place(session: &Session, i: usize) -> Vec3 {
    let p = &session.moments[i].position;
    Vec3::new(p[0], p[1], p[2])
}

/// Root of the mean square of the finite values.
#[must_use]
pub(super) fn rms(values: &[f64]) -> f64 {
    let (sum, n) =
        values.iter().filter(|v| v.is_finite()).fold((0.0, 0usize), |(s, n), v| (s + v * v, n + 1));
    if n == 0 { 0.0 } else { (sum / n as f64).sqrt() }
}

/// The size that 99 % of the finite values do not exceed.
#[must_use]
pub(super) fn peak99(values: &[f64]) -> f64 {
    let mut sizes: Vec<f64> = values.iter().filter(|v| v.is_finite()).map(|v| v.abs()).collect();
    sizes.sort_by(f64::total_cmp);
    sizes.get((sizes.len() * 99) / 100).or(sizes.last()).copied().unwrap_or(0.0)
}
