//! Pieces of a session between which effects must not change: programs, places within them, blocks of runs.

use std::collections::{BTreeMap, BTreeSet};

use super::super::constants::{FEW, MOVES};
use super::super::moment::SLOTS;
use super::super::session::Session;

/// What makes two runs one program: setup, axes that move, feed (in steps of a factor 1.5), tool length in whole mm.
type Program = (usize, [bool; SLOTS], i64, i64);

/// Program of each run; `None` where no row is of it.
fn program_of_runs(session: &Session, rows: impl Iterator<Item = usize>) -> Vec<Option<Program>> {
    #[derive(Clone, Copy)]
    struct Run {
        low: [f64; SLOTS],
        high: [f64; SLOTS],
        speed: f64,
        tool: f64,
        setup: Option<usize>,
    }
    let start = Run {
        low: [f64::INFINITY; SLOTS],
        high: [f64::NEG_INFINITY; SLOTS],
        speed: 0.0,
        tool: f64::NAN,
        setup: None,
    };
    let mut runs = vec![start; session.runs];
    for i in rows {
        let (r, m) = (&session.readings[i], &session.moments[i]);
        let run = &mut runs[r.run];
        run.setup = Some(r.setup);
        run.tool = m.tool_length_mm;
        let speed = (0..3).map(|k| m.velocity[k].powi(2)).sum::<f64>().sqrt();
        run.speed = run.speed.max(if speed.is_finite() { speed } else { 0.0 });
        for k in 0..SLOTS {
            run.low[k] = run.low[k].min(m.position[k]);
            run.high[k] = run.high[k].max(m.position[k]);
        }
    }
    let program = |r: &Run| {
        let moves = |k: usize| r.high[k] - r.low[k] > MOVES[usize::from(k > 2)];
        let feed = if r.speed > 1e-6 { (r.speed.ln() / 0.4).round() as i64 } else { i64::MIN };
        let tool = if r.tool.is_finite() { r.tool.round() as i64 } else { i64::MIN };
        Some((r.setup?, core::array::from_fn(moves), feed, tool))
    };
    runs.iter().map(program).collect()
}

/// Number of programs, whatever the setup.
pub fn count_programs(session: &Session) -> usize {
    let programs = program_of_runs(session, 0..session.readings.len());
    programs
        .into_iter()
        .flatten()
        .map(|(_, axes, feed, tool)| (axes, feed, tool))
        .collect::<BTreeSet<_>>()
        .len()
}

/// Program of every row, and their number.
pub(super) fn programs(session: &Session, rows: &[usize]) -> (Vec<usize>, usize) {
    let of_runs = program_of_runs(session, rows.iter().copied());
    let mut known = BTreeMap::new();
    let cell = rows
        .iter()
        .map(|i| {
            let next = known.len();
            *known.entry(of_runs[session.readings[*i].run]).or_insert(next)
        })
        .collect();
    (cell, known.len())
}

/// Places of the axes within each program.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Places {
    /// Place of each row.
    pub of: Vec<usize>,
    /// Number of places.
    pub count: usize,
}

/// Most places along one, two, three axes.
const PLACES: [usize; 3] = [8, 4, 3];
impl Places {
    /// Divides the travel of each axis but `own` (a slot, or none) in every program.
    pub(super) fn new(session: &Session, rows: &[usize], cell: &[usize], own: usize) -> Self {
        let cells = cell.iter().max().map_or(0, |c| c + 1);
        let mut range = vec![[[f64::INFINITY, f64::NEG_INFINITY]; SLOTS]; cells];
        let mut counts = vec![0usize; cells];
        for (i, c) in rows.iter().zip(cell) {
            counts[*c] += 1;
            for (r, p) in range[*c].iter_mut().zip(&session.moments[*i].position) {
                *r = [r[0].min(*p), r[1].max(*p)];
            }
        }
        let parts: Vec<[usize; SLOTS]> = range
            .iter()
            .zip(&counts)
            .map(|(r, n)| {
                let moves = |k: &usize| *k != own && r[*k][1] - r[*k][0] > MOVES[usize::from(*k > 2)];
                let axes: Vec<usize> = (0..SLOTS).filter(moves).collect();
                let share = ((n / FEW) as f64).powf(1.0 / axes.len().max(1) as f64) as usize;
                let parts = share.clamp(1, PLACES[axes.len().clamp(1, 3) - 1]);
                let mut all = [1; SLOTS];
                for k in axes {
                    all[k] = parts;
                }
                all
            })
            .collect();
        let mut known = BTreeMap::new();
        let of = rows
            .iter()
            .zip(cell)
            .map(|(i, c)| {
                let m = &session.moments[*i];
                let place: [usize; SLOTS] = core::array::from_fn(|k| {
                    let [low, high] = range[*c][k];
                    let n = parts[*c][k];
                    if n < 2 {
                        return 0;
                    }
                    (((m.position[k] - low) / (high - low) * n as f64) as usize).min(n - 1)
                });
                let next = known.len();
                *known.entry((*c, place)).or_insert(next)
            })
            .collect();
        Self { of, count: known.len() }
    }
}

/// Runs, or pieces of runs where there are few in all or one in a set-up: what it alone shows no other run can confirm.
pub(super) fn blocks(session: &Session, rows: &[usize], least: usize) -> (Vec<usize>, usize) {
    let mut counts: BTreeMap<usize, usize> = BTreeMap::new();
    let mut runs: BTreeMap<usize, BTreeSet<usize>> = BTreeMap::new();
    for i in rows {
        let r = &session.readings[*i];
        *counts.entry(r.run).or_default() += 1;
        runs.entry(r.setup).or_default().insert(r.run);
    }
    let few = least.div_ceil(counts.len().max(1));
    let pieces_of = |setup: usize| if runs[&setup].len() == 1 { least } else { few };
    let mut seen: BTreeMap<usize, usize> = BTreeMap::new();
    let mut known: BTreeMap<(usize, usize), usize> = BTreeMap::new();
    let block = rows
        .iter()
        .map(|i| {
            let run = session.readings[*i].run;
            let k = seen.entry(run).or_default();
            let piece = (*k * pieces_of(session.readings[*i].setup)) / counts[&run];
            *k += 1;
            let next = known.len();
            *known.entry((run, piece)).or_insert(next)
        })
        .collect();
    (block, known.len())
}
