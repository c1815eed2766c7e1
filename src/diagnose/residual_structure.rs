//! What is left and is not noise: products of repeats where there are repeats, else neighbours in time or space.

use std::collections::BTreeMap;

use super::constants::{FEW, MOST, SIGNIFICANT};
use super::noise::repeats_tell;
use super::search::Problem;
use super::session::Session;

/// Structure in what is left, in units of the noise variance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Structure {
    /// Mean of the structured variance, 1 is the noise.
    pub(super) variance: f64,
    /// Standard deviations above nothing.
    pub(super) z: f64,
    /// Standard deviations above nothing in the setup that shows most.
    pub(super) local_z: f64,
    /// From repeats; otherwise from neighbours in time.
    pub(super) from_repeats: bool,
}

/// A sum of products.
#[derive(Debug, Clone, Copy, Default)]
struct Sum {
    sum: f64,
    square: f64,
    n: usize,
}

impl Sum {
    fn add(&mut self, p: f64) {
        self.sum += p;
        self.square += p * p;
        self.n += 1;
    }

    fn mean(&self) -> f64 {
        self.sum / self.n.max(1) as f64
    }

    /// The same against what noise of unit variance gives, doubled for heavy tails: few large products count in full.
    fn z_of_noise(&self) -> f64 {
        self.sum / (2.0 * self.n.max(1) as f64).sqrt()
    }

    fn z(&self) -> f64 {
        self.sum / self.square.max(1e-12).sqrt()
    }
}

/// The structure in `e`, whitened, in the problem's order.
#[must_use]
pub(super) fn structure(session: &Session, problem: &Problem, e: &[f64]) -> Structure {
    let clipped: Vec<f64> = e.iter().map(|v| v.clamp(-SIGNIFICANT, SIGNIFICANT)).collect();
    let mut all = Sum::default();
    let mut each = vec![Sum::default(); session.setups.len()];
    repeated(session, problem, e, &mut |k, p| {
        all.add(p);
        each[session.readings[problem.rows[k]].setup].add(p);
    });
    if repeats_tell(all.n, e.len()) && all.n >= FEW {
        // what one setup alone shows must not drown in the others
        let local = each.iter().filter(|s| s.n >= FEW).map(Sum::z_of_noise).fold(0.0, f64::max);
        return Structure { variance: all.mean(), z: all.z(), local_z: local, from_repeats: true };
    }
    let (in_time, in_space) = (neighbours(session, problem, &clipped), beside(session, problem, &clipped));
    if in_space.z > in_time.z { in_space } else { in_time }
}

/// Hands over the product of `e`, whitened, of every two repeats of a point, with the place of the first of them.
pub(super) fn repeated(session: &Session, problem: &Problem, e: &[f64], take: &mut dyn FnMut(usize, f64)) {
    let mut groups: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for (k, i) in problem.rows.iter().enumerate() {
        if let Some(p) = session.readings[*i].pair {
            groups.entry(p).or_default().push(k);
        }
    }
    for rows in groups.values() {
        for (a, k) in rows.iter().enumerate() {
            for j in rows[a + 1..].iter().take(MOST) {
                let (first, second) = (problem.rows[*k], problem.rows[*j]);
                if session.readings[first].repeat != session.readings[second].repeat {
                    take(*k, e[*k].clamp(-SIGNIFICANT, SIGNIFICANT) * e[*j].clamp(-SIGNIFICANT, SIGNIFICANT));
                }
            }
        }
    }
}

/// Products of neighbours in space.
fn beside(session: &Session, problem: &Problem, e: &[f64]) -> Structure {
    let mut place = vec![usize::MAX; session.readings.len()];
    for (k, i) in problem.rows.iter().enumerate() {
        place[*i] = k;
    }
    let (mut sum, mut square) = (0.0, 0.0);
    let pairs = super::noise::neighbours(session, &problem.rows);
    for (a, b) in &pairs {
        let p = e[place[*a]] * e[place[*b]];
        sum += p;
        square += p * p;
    }
    if pairs.len() < FEW {
        return Structure { variance: 0.0, z: 0.0, local_z: 0.0, from_repeats: false };
    }
    Structure {
        variance: sum / pairs.len() as f64,
        z: sum / square.max(1e-12).sqrt(),
        local_z: 0.0,
        from_repeats: false,
    }
}

/// Products of readings of one run that follow each other.
fn neighbours(session: &Session, problem: &Problem, e: &[f64]) -> Structure {
    let (mut sum, mut square, mut n) = (0.0, 0.0, 0usize);
    for lag in 1..=4 {
        for k in lag..e.len() {
            let (a, b) = (problem.rows[k - lag], problem.rows[k]);
            let alike = session.readings[a].run == session.readings[b].run
                && session.moments[a].u.dot(&session.moments[b].u) > 0.9;
            if alike {
                let p = e[k - lag] * e[k];
                sum += p;
                square += p * p;
                n += 1;
            }
        }
    }
    if n < FEW {
        return Structure { variance: 0.0, z: 0.0, local_z: 0.0, from_repeats: false };
    }
    Structure {
        variance: sum / n as f64,
        z: sum / square.max(1e-12).sqrt(),
        local_z: 0.0,
        from_repeats: false,
    }
}
