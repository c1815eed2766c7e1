//! What a plan can see, before anyone measures: blind spots, and effects that it cannot tell apart.

use nalgebra::{DMatrix, DVector};
use serde::Serialize;

use super::constants::{ASSUMED, NEARLY};
use super::library::{Library, Without};
use super::noise::Filter;
use super::report::Unseen;
use super::search::Problem;
use super::session::Session;

/// What a plan can see.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PlanReport {
    /// `volcomp-plan/1`.
    pub format: &'static str,
    /// Rows of the plan.
    pub rows: usize,
    /// Setups of the plan.
    pub setups: usize,
    /// Effects that it can see.
    pub seen: Vec<String>,
    /// Effects that it cannot see.
    pub blind_spots: Vec<Unseen>,
    /// Classes of effects that it cannot tell apart.
    pub confounded: Vec<Vec<String>>,
    /// What was derived or is missing.
    pub notes: Vec<String>,
}

/// Looks at the rows of a plan; their deviations do not matter.
#[must_use]
pub fn plan(session: &mut Session, without: &[Without]) -> PlanReport {
    let mut library = Library::new(session, without);
    super::take_signals(session, &mut library);
    let noise = vec![ASSUMED; session.instruments.len()];
    let used = vec![true; session.readings.len()];
    let filter = Filter::new(session, &noise, &used);
    let white = vec![ASSUMED.white_um; session.instruments.len()];
    let problem = Problem::new(session, &library, &filter, &session.gap(), &white);
    let mut blind = library.blind.clone();
    blind.extend(problem.unseen(&library));
    let hidden = |l: &str| blind.iter().any(|b| b.label == l);
    let names: Vec<String> = library.labels.iter().map(ToString::to_string).collect();
    let seen: Vec<usize> = (0..names.len()).filter(|l| !hidden(&names[*l])).collect();
    PlanReport {
        format: "volcomp-plan/1",
        rows: session.rows_read,
        setups: session.setups.len(),
        seen: seen.iter().map(|l| names[*l].clone()).collect(),
        confounded: classes(&problem, &library, &seen)
            .into_iter()
            .map(|c| c.into_iter().map(|l| names[l].clone()).collect())
            .collect(),
        blind_spots: blind.into_iter().map(|b| Unseen { effect: b.label, because: b.because }).collect(),
        notes: session.notes.iter().map(|n| n.text.clone()).collect(),
    }
}

/// Groups of labels whose simplest signal another label reproduces.
fn classes(problem: &Problem, library: &Library, seen: &[usize]) -> Vec<Vec<usize>> {
    let by_label = library.by_label();
    let mut root: Vec<usize> = (0..by_label.len()).collect();
    for a in seen {
        let Some(first) = by_label[*a].iter().find(|v| problem.seen[**v] > 0.0) else { continue };
        let (at, k) = problem.span[*first];
        let beta: Vec<f64> = (0..k).map(|i| if i % 2 == 0 { 1.0 } else { 0.7 }).collect();
        let columns: Vec<usize> = (at..at + k).collect();
        let signal: DVector<f64> = problem.contribution(&columns, &beta);
        let size = signal.norm_squared();
        if size <= 0.0 {
            continue;
        }
        let products = problem.products(&DMatrix::from_column_slice(signal.len(), 1, signal.as_slice()));
        for b in seen.iter().filter(|b| *b != a) {
            let best = by_label[*b]
                .iter()
                .filter(|v| !library.variants[**v].shape.has_slope())
                .map(|v| problem.gain_of(*v, products.as_slice()))
                .fold(0.0, f64::max);
            if best > NEARLY * size {
                let (x, y) = (find(&root, *a), find(&root, *b));
                root[x.max(y)] = x.min(y);
            }
        }
    }
    let mut groups: Vec<Vec<usize>> = vec![Vec::new(); by_label.len()];
    for l in seen {
        groups[find(&root, *l)].push(*l);
    }
    groups.into_iter().filter(|g| g.len() > 1).collect()
}

fn find(root: &[usize], mut l: usize) -> usize {
    while root[l] != l {
        l = root[l];
    }
    l
}
