//! Whitening: the readings of a setup see white noise, a drift of the instrument against the machine
//! (Ornstein-Uhlenbeck in each direction), the unknown offset of the mounting, and for a tracker a small rotation.
//!
//! All of it is one linear-Gaussian state, so a Kalman filter turns readings and columns into independent innovations of
//! unit variance in one pass: the cost is rows times columns. The gains do not depend on the data and are computed once.
//! Source: `docs/explanation/diagnosis.md` (whitening); equations 5.8.

use nalgebra::DMatrix;
use rayon::prelude::*;

use super::super::evidence::{Covariance, mean_of_members};
use super::super::session::Session;
use volcomp_model::geometry::Vec3;

/// Most states: drift, offset, rotation in three directions each.
const STATES: usize = 9;
/// Columns that are filtered together, so that their states stay near the processor.
const BLOCK: usize = 192;

/// Noise of an instrument class.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClassNoise {
    /// White noise, 1 standard deviation, um.
    pub white_um: f64,
    /// Drift, 1 standard deviation, um.
    pub drift_um: f64,
    /// Correlation time of the drift, s.
    pub drift_s: f64,
}

#[derive(Debug, Clone, Copy)]
struct Gain {
    /// Decay of the drift since the row before; negative where a setup begins.
    decay: f64,
    /// One over the standard deviation of the innovation.
    weight: f64,
    h: [f64; STATES],
    k: [f64; STATES],
}

/// The gains of every row, setup after setup.
#[derive(Debug, Clone)]
pub struct Filter {
    gains: Vec<Gain>,
    /// Row of the session at each place.
    order: Vec<usize>,
    drift_states: Vec<usize>,
    states: Vec<usize>,
    /// Sum of the logarithms of the innovations' variances.
    log_variance: f64,
    /// A dense covariance in the place of the gains.
    dense: Option<Dense>,
}

/// Whitening by a dense covariance of readings or of means of them.
#[derive(Debug, Clone)]
struct Dense {
    covariance: Covariance,
    groups: Vec<Vec<usize>>,
    white_um: f64,
}

/// How far a mounting may be off, um, and um per m for its rotation: large against anything measured.
const OFFSET_UM: f64 = 3e4;
/// Rotation of a tracker, um per m.
const ROTATION_UM_PER_M: f64 = 3e3;

impl Filter {
    /// The gains for the rows of `session` that `used` marks.
    #[must_use]
    pub fn new(session: &Session, noise: &[ClassNoise], used: &[bool]) -> Self {
        let mut by_setup: Vec<Vec<usize>> = vec![Vec::new(); session.setups.len()];
        for (i, r) in session.readings.iter().enumerate() {
            if used[i] {
                by_setup[r.setup].push(i);
            }
        }
        let mut filter = Self {
            gains: Vec::with_capacity(session.readings.len()),
            order: Vec::with_capacity(session.readings.len()),
            drift_states: Vec::new(),
            states: Vec::new(),
            log_variance: 0.0,
            dense: None,
        };
        for rows in by_setup.iter().filter(|r| !r.is_empty()) {
            filter.setup(session, noise, rows);
        }
        filter
    }

    /// Whitening by the covariance of a comparison, white noise `white_um`; each place stands for the mean of a group of rows.
    #[must_use]
    pub fn dense(covariance: Covariance, groups: Vec<Vec<usize>>, white_um: f64) -> Self {
        Self {
            gains: Vec::new(),
            order: groups.iter().map(|g| g[0]).collect(),
            drift_states: Vec::new(),
            states: Vec::new(),
            log_variance: 0.0,
            dense: Some(Dense { covariance, groups, white_um }),
        }
    }

    /// Rows of the session whose values [`Filter::mean`] takes, in order.
    #[must_use]
    pub fn members(&self) -> Vec<usize> {
        self.dense.as_ref().map_or_else(|| self.order.clone(), |d| d.groups.concat())
    }

    /// Rows of the session behind a place of the filtered columns.
    #[must_use]
    pub fn members_of(&self, place: usize) -> &[usize] {
        self.dense.as_ref().map_or_else(|| &self.order[place..=place], |d| &d.groups[place])
    }

    /// Rows of `width` values of every member to one row per place.
    #[must_use]
    pub fn mean(&self, data: Vec<f64>, width: usize) -> Vec<f64> {
        match &self.dense {
            Some(d) => mean_of_members(&d.groups, &data, width),
            None => data,
        }
    }

    /// Row of the session at each place of the filtered columns.
    #[must_use]
    pub fn order(&self) -> &[usize] {
        &self.order
    }

    fn setup(&mut self, session: &Session, noise: &[ClassNoise], rows: &[usize]) {
        let first = &session.moments[rows[0]];
        let one_line = rows.iter().all(|i| session.moments[*i].u.dot(&first.u).abs() > 0.9999);
        let rotates = session.rotates(rows[0], one_line);
        let drifts = rows.iter().any(|i| noise[session.readings[*i].instrument].drift_um > 0.0);
        let each = if one_line { 1 } else { 3 };
        let d = if drifts { each } else { 0 };
        let n = d + each + if rotates { 3 } else { 0 };
        let centre = rows.iter().map(|i| session.moments[*i].seen_mm()).sum::<Vec3>() / rows.len() as f64;
        let mut p = [[0.0; STATES]; STATES];
        let start = noise[session.readings[rows[0]].instrument];
        for (i, row) in p.iter_mut().enumerate().take(n) {
            row[i] = if i < d {
                start.drift_um * start.drift_um
            } else if i < d + each {
                OFFSET_UM * OFFSET_UM
            } else {
                ROTATION_UM_PER_M * ROTATION_UM_PER_M
            };
        }
        let mut t = first.t_s;
        for (at, i) in rows.iter().enumerate() {
            let (m, r) = (&session.moments[*i], &session.readings[*i]);
            let class = noise[r.instrument];
            let mut h = [0.0; STATES];
            let u = if one_line { [m.u.dot(&first.u).signum(), 0.0, 0.0] } else { [m.u.x, m.u.y, m.u.z] };
            for j in 0..each {
                h[d + j] = u[j];
                if d > 0 {
                    h[j] = u[j];
                }
            }
            if rotates {
                let arm = (m.seen_mm() - centre) * 1e-3;
                let c = arm.cross(&m.u);
                h[d + each..d + each + 3].copy_from_slice(&[c.x, c.y, c.z]);
            }
            let decay = if d > 0 { (-(m.t_s - t).max(0.0) / class.drift_s.max(1e-9)).exp() } else { 1.0 };
            t = m.t_s;
            if at > 0 && d > 0 && decay < 1.0 {
                propagate(&mut p, n, d, decay, class.drift_um);
            }
            let (k, s) = update(&mut p, n, &h, class.white_um * class.white_um);
            self.log_variance += s.ln();
            self.gains.push(Gain { decay: if at == 0 { -1.0 } else { decay }, weight: 1.0 / s.sqrt(), h, k });
            self.order.push(*i);
            self.drift_states.push(d);
            self.states.push(n);
        }
    }

    /// Filters columns in place: `data` holds a row of `width` values per place of [`Filter::order`].
    pub fn apply(&self, data: &mut [f64], width: usize) {
        if let Some(d) = &self.dense {
            let columns = DMatrix::from_row_slice(self.order.len(), width, data);
            let w = d.covariance.whiten(&columns) / d.white_um;
            data.copy_from_slice(w.transpose().as_slice());
            return;
        }
        let begins = |i: &usize| *i == 0 || self.gains[*i].decay < 0.0;
        let begins: Vec<usize> = (0..self.gains.len()).filter(begins).chain([self.gains.len()]).collect();
        let (mut setups, mut rest) = (Vec::with_capacity(begins.len()), data);
        for ends in begins.windows(2) {
            let setup;
            (setup, rest) = rest.split_at_mut((ends[1] - ends[0]) * width);
            setups.push((ends[0], setup));
        }
        setups.into_par_iter().for_each(|(first, data)| self.apply_to_setup(first, data, width));
    }

    /// The same to the rows of a setup, the first of which is at the place `first`.
    fn apply_to_setup(&self, first: usize, data: &mut [f64], width: usize) {
        let mut innovation = [0.0; BLOCK];
        let n = self.states[first];
        let mut from = 0;
        while from < width {
            let block = BLOCK.min(width - from);
            let mut state = vec![0.0; n * block];
            for (row, gain) in data.chunks_exact_mut(width).zip(&self.gains[first..]) {
                if (0.0..1.0).contains(&gain.decay) {
                    for v in &mut state[..self.drift_states[first] * block] {
                        *v *= gain.decay;
                    }
                }
                let row = &mut row[from..from + block];
                let e = &mut innovation[..block];
                e.copy_from_slice(row);
                for (h, state) in gain.h.iter().zip(state.chunks_exact(block)).filter(|(h, _)| **h != 0.0) {
                    e.iter_mut().zip(state).for_each(|(e, x)| *e -= h * x);
                }
                for (k, state) in gain.k.iter().zip(state.chunks_exact_mut(block)).filter(|(k, _)| **k != 0.0)
                {
                    state.iter_mut().zip(e.iter()).for_each(|(x, e)| *x += k * e);
                }
                row.iter_mut().zip(e.iter()).for_each(|(v, e)| *v = e * gain.weight);
            }
            from += block;
        }
    }

    /// One column in the order of the session's rows, filtered; in the filter's order.
    #[must_use]
    pub fn column(&self, values: &[f64]) -> Vec<f64> {
        let mut data = self.mean(self.members().into_iter().map(|i| values[i]).collect(), 1);
        self.apply(&mut data, 1);
        data
    }

    /// Residual of each reading from what all others predict, in its standard deviations, of a column in the order of the session's
    /// rows; in the filter's order. Source: de Jong, Penzer 1998 (deletion residuals by the smoother's recursions).
    #[must_use]
    pub fn deletion_residuals(&self, values: &[f64]) -> Vec<f64> {
        let mut out = self.column(values);
        let (mut pull, mut weight) = ([0.0; STATES], [[0.0; STATES]; STATES]);
        for (place, g) in self.gains.iter().enumerate().rev() {
            // from the state behind the row after this one to the state behind this row
            match self.gains.get(place + 1) {
                Some(next) if next.decay >= 0.0 => {
                    let d = self.drift_states[place];
                    pull.iter_mut().take(d).for_each(|v| *v *= next.decay);
                    decay_drift(&mut weight, STATES, d, next.decay);
                }
                _ => (pull, weight) = ([0.0; STATES], [[0.0; STATES]; STATES]),
            }
            let product = weight.map(|row| inner(&row, &g.k));
            let smoothed = out[place] * g.weight - inner(&g.k, &pull);
            let precision = g.weight * g.weight + inner(&g.k, &product);
            out[place] = smoothed / precision.sqrt();
            // L' = I - h k'
            pull = core::array::from_fn(|i| pull[i] + g.h[i] * smoothed);
            let of = |i: usize, j: usize| {
                weight[i][j] - g.h[i] * product[j] - product[i] * g.h[j] + g.h[i] * g.h[j] * precision
            };
            weight = core::array::from_fn(|i| core::array::from_fn(|j| of(i, j)));
        }
        out
    }

    /// Twice the negative log-likelihood of filtered readings, large ones clipped so that outliers do not rule.
    #[must_use]
    pub fn minus_two_log(&self, filtered: &[f64]) -> f64 {
        self.log_variance + filtered.iter().map(|e| (e * e).min(9.0 + (e * e).ln_1p())).sum::<f64>()
    }
}

fn inner(a: &[f64; STATES], b: &[f64; STATES]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// A quadratic form of the first `n` states as the first `d` of them, the drift, decay.
fn decay_drift(p: &mut [[f64; STATES]; STATES], n: usize, d: usize, decay: f64) {
    for (i, row) in p.iter_mut().enumerate().take(n) {
        for (j, v) in row.iter_mut().enumerate().take(n) {
            *v *= match (i < d, j < d) {
                (true, true) => decay * decay,
                (false, false) => 1.0,
                _ => decay,
            };
        }
    }
}

fn propagate(p: &mut [[f64; STATES]; STATES], n: usize, d: usize, decay: f64, drift: f64) {
    decay_drift(p, n, d, decay);
    for (i, row) in p.iter_mut().enumerate().take(d) {
        row[i] += drift * drift * (1.0 - decay * decay);
    }
}

/// The gain and the innovation's variance.
fn update(p: &mut [[f64; STATES]; STATES], n: usize, h: &[f64; STATES], white: f64) -> ([f64; STATES], f64) {
    let mut ph = [0.0; STATES];
    for (v, row) in ph.iter_mut().zip(p.iter()).take(n) {
        *v = row.iter().zip(h).take(n).map(|(a, b)| a * b).sum();
    }
    let s = white + ph.iter().zip(h).take(n).map(|(a, b)| a * b).sum::<f64>().max(0.0);
    let k = ph.map(|v| v / s);
    // Joseph form: (I - k h') P (I - k h')' + k white k'
    for i in 0..n {
        for j in i..n {
            let v = p[i][j] - k[i] * ph[j] - ph[i] * k[j] + k[i] * k[j] * s;
            p[i][j] = v;
            p[j][i] = v;
        }
    }
    (k, s)
}

#[cfg(test)]
mod tests {
    use nalgebra::{DMatrix, DVector};

    use super::super::super::machine_state::Machine;
    use super::super::super::session::{History, Raw, Session};
    use super::super::Random;
    use super::{ClassNoise, Filter};

    /// Two setups of a drifting tracker, which turns: against the inverse of the covariance that the filter stands for.
    #[test]
    fn deletion_residuals_are_those_of_the_dense_covariance() {
        let names = ["t_s", "setup", "run", "repeat", "x_mm", "y_mm", "u_x", "u_y", "u_z", "deviation_um"];
        let (mut raw, mut random) = (Raw::made_up("s.csv", &names), Random::new(5));
        for k in 0..40 {
            let (setup, along) = (f64::from(1 + k / 22), f64::from(k % 3 % 2));
            let (x, y) = (150.0 * f64::from(k % 7), 90.0 * f64::from(k % 5));
            let read_um = 3.0 * random.normal();
            let row = [20.0 * f64::from(k), setup, setup, 1.0, x, y, along, 1.0 - along, 0.0, read_um];
            raw.push("tracker", raw.lines.len() as u64 + 2, &row);
        }
        let session = Session::build(&[raw], History::default(), Machine::plain()).expect("a session");
        let n = session.readings.len();
        let noise = [ClassNoise { white_um: 1.3, drift_um: 2.0, drift_s: 90.0 }];
        let filter = Filter::new(&session, &noise, &vec![true; n]);
        let order = filter.order().to_vec();
        let mut whitened = DMatrix::<f64>::identity(n, n);
        filter.apply(whitened.as_mut_slice(), n);
        // rows lie one behind the other
        let precision = &whitened * whitened.transpose();
        let gap = session.gap();
        let pull = &precision * DVector::from_iterator(n, order.iter().map(|i| gap[*i]));
        for (k, residual) in filter.deletion_residuals(&gap).into_iter().enumerate() {
            let wanted = pull[k] / precision[(k, k)].sqrt();
            // the first readings of a setup are known to no better than its mounting
            assert!((residual - wanted).abs() < 1e-4, "{k}: {residual} {wanted}");
        }
    }
}
