//! Columns of effects before whitening: what each parameter displaces along the direction in which a reading measures.

use std::borrow::Cow;
use std::collections::BTreeMap;

use rayon::prelude::*;
use volcomp_model::geometry::Vec3;

use super::super::library::{Library, Shape};
use super::super::moment::{Moment, Signal};
use super::super::session::Session;

/// Raw columns of a library, um per unit of each parameter, a row of values per reading.
pub fn raw_columns(session: &Session, library: &Library, rows: &[usize]) -> Vec<f64> {
    let shapes: Vec<&Shape> = library.variants.iter().map(|v| &v.shape).collect();
    raw(session, rows, &shapes)
}

/// Most values of raw columns that are kept: 256 MB.
const KEPT_MAX: usize = 1 << 25;

/// Readings that one processor takes at a time.
const ROWS: usize = 256;

/// Raw columns that are the same from one round to the next.
#[derive(Debug, Clone, Default)]
pub struct RawColumns {
    rows: Vec<usize>,
    shapes: Vec<Shape>,
    data: Vec<f64>,
}

impl RawColumns {
    /// The columns of a library; at the same rows as before only those of new shapes are computed.
    pub(super) fn of(&mut self, session: &Session, library: &Library, rows: &[usize]) -> Vec<f64> {
        let width = library.width();
        let widths = |shapes: &[Shape]| shapes.iter().map(Shape::width).collect::<Vec<_>>();
        let is_known = self.rows == rows
            && widths(&self.shapes) == library.variants.iter().map(|v| v.shape.width()).collect::<Vec<_>>();
        if !is_known {
            let data = raw_columns(session, library, rows);
            if data.len() <= KEPT_MAX {
                self.rows = rows.to_vec();
                self.shapes = library.variants.iter().map(|v| v.shape.clone()).collect();
                self.data.clone_from(&data);
            }
            return data;
        }
        let mut at = 0;
        for (known, v) in self.shapes.iter_mut().zip(&library.variants) {
            let k = v.shape.width();
            if *known != v.shape {
                let own = raw(session, rows, &[&v.shape]);
                for (row, values) in self.data.chunks_exact_mut(width).zip(own.chunks_exact(k)) {
                    row[at..at + k].copy_from_slice(values);
                }
                *known = v.shape.clone();
            }
            at += k;
        }
        self.data.clone()
    }

    /// The same once some readings count from the zero of a ball: those of all others are known.
    #[must_use]
    pub fn from_ball_zero(&self, session: &Session) -> Self {
        let mut from_zero = self.clone();
        let shapes: Vec<&Shape> = self.shapes.iter().collect();
        let width: usize = shapes.iter().map(|s| s.width()).sum();
        let counts = |i: &usize| session.ball_zero.as_ref().is_some_and(|z| z.at(*i).is_some());
        let rows: Vec<usize> = self.rows.iter().copied().filter(counts).collect();
        let changed = raw(session, &rows, &shapes);
        let all = from_zero.data.chunks_exact_mut(width.max(1)).zip(&self.rows).filter(|(_, i)| counts(i));
        all.zip(changed.chunks_exact(width.max(1))).for_each(|((row, _), new)| row.copy_from_slice(new));
        from_zero
    }
}

/// The columns of some shapes, a row of values per reading, um per unit of each parameter.
pub(crate) fn raw(session: &Session, rows: &[usize], shapes: &[&Shape]) -> Vec<f64> {
    let width: usize = shapes.iter().map(|s| s.width()).sum();
    let mut data = vec![0.0; rows.len() * width];
    // what a refined shape reads beyond the signals of the library
    let mut own: Vec<Signal> = shapes.iter().flat_map(|s| s.signals()).cloned().collect();
    own.retain(|s| session.signal(s).is_none());
    let lagged: Vec<Option<Vec<f64>>> =
        own.iter().map(|s| session.history.lagged(s, &session.moments)).collect();
    let known = session.signals.len();
    let at = |s: &Signal| session.signal(s).or_else(|| own.iter().position(|o| o == s).map(|k| known + k));
    let with_own = |i: usize| {
        let m = &session.moments[i];
        if own.is_empty() {
            return Cow::Borrowed(m);
        }
        let values = lagged.iter().map(|l| l.as_ref().map_or(f64::NAN, |l| l[i]));
        let signals = m.signals.iter().copied().chain(values).collect();
        Cow::Owned(Moment { signals, ..m.clone() })
    };
    let displacements = |i: usize, out: &mut [Vec3]| {
        let m = &*with_own(i);
        let mut rest = out;
        for shape in shapes {
            let own;
            (own, rest) = rest.split_at_mut(shape.width());
            own.fill(Vec3::zeros());
            shape.evaluate_with(m, &at, own);
        }
    };
    let zero_of = |i: usize| session.ball_zero.as_ref().and_then(|z| z.at(i));
    let mut at_zero: BTreeMap<usize, Vec<Vec3>> = BTreeMap::new();
    for (zero, _) in rows.iter().filter_map(|i| zero_of(*i)) {
        at_zero.entry(zero).or_insert_with(|| {
            let mut out = vec![Vec3::zeros(); width];
            displacements(zero, &mut out);
            out
        });
    }
    let width = width.max(1);
    data.par_chunks_mut(ROWS * width).zip(rows.par_chunks(ROWS)).for_each(|(data, rows)| {
        let mut out = vec![Vec3::zeros(); width];
        for (row, i) in data.chunks_exact_mut(width).zip(rows) {
            displacements(*i, &mut out);
            if let Some((zero, turn)) = zero_of(*i) {
                out.iter_mut().zip(&at_zero[&zero]).for_each(|(d, z)| *d -= turn * z);
            }
            for (value, d) in row.iter_mut().zip(&out) {
                let seen = d.dot(&session.moments[*i].u);
                *value = if seen.is_finite() { seen } else { 0.0 };
            }
        }
    });
    data
}
