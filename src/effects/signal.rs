//! What drives an effect behind a lag or a dead time: followed along a log, from entry to entry.

use std::collections::VecDeque;

use serde::{Deserialize, Serialize};

use crate::machine_state::Source;

/// A source behind a lag: `tau s' = source^power - u`, `inner u' = s - u`; of first order where nothing lags inside (`u = s`).
///
/// Behind a dead time `d` it is what a position is behind by, over `d + tau`: `(INT_(t-d)^t source + tau s(t - d)) / (d + tau)`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct Signal {
    /// What drives it.
    pub source: Source,
    /// Time constant, s; 0 takes the source as it is.
    pub tau_s: f64,
    /// Exponent of the speed of a spindle: its friction heats by more than the speed.
    #[serde(default = "plain", skip_serializing_if = "is_plain")]
    pub power: f64,
    /// Time constant of the velocity loop inside a position loop, s.
    #[serde(default, skip_serializing_if = "is_none")]
    pub inner_s: f64,
    /// Dead time before the lag, s.
    #[serde(default, skip_serializing_if = "is_none")]
    pub dead_time_s: f64,
}

const fn plain() -> f64 {
    1.0
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde hands over a reference")]
#[expect(clippy::float_cmp, reason = "the very value that stands for none")]
fn is_plain(power: &f64) -> bool {
    *power == plain()
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde hands over a reference")]
fn is_none(time_s: &f64) -> bool {
    *time_s <= 0.0
}

/// `s` and `u` of a [`Signal`].
type Lagged = [f64; 2];

impl Signal {
    /// A source behind a lag of first order.
    #[must_use]
    pub const fn of(source: Source, tau_s: f64) -> Self {
        Self { source, tau_s, power: plain(), inner_s: 0.0, dead_time_s: 0.0 }
    }

    /// True where the value now depends on those before.
    #[must_use]
    pub fn looks_back(&self) -> bool {
        self.tau_s > 0.0 || self.dead_time_s > 0.0
    }

    /// In equilibrium with a value of the source.
    fn start(&self, value: f64) -> Lagged {
        [self.drive(value); 2]
    }

    /// What a value of the source drives the lag towards.
    fn drive(&self, value: f64) -> f64 {
        if is_plain(&self.power) { value } else { value.abs().powf(self.power) }
    }

    /// One step of the lag over `dt_s`; exact where the source drives it from `before` to `now` at one rate.
    fn step(&self, state: Lagged, dt_s: f64, before: f64, now: f64) -> Lagged {
        if self.tau_s <= 0.0 {
            return self.start(now);
        }
        if dt_s <= 0.0 {
            return state;
        }
        let (before, now) = (self.drive(before), self.drive(now));
        let rate = (now - before) / dt_s;
        // behind a source that goes at this rate for ever: how far `u` and `s` are away from it
        let (outer, inner) = (-self.tau_s * rate, self.inner_s * rate);
        let off = [state[0] - before - outer - inner, state[1] - before - outer];
        let [s, u] = self.decayed(off, dt_s);
        [now + outer + inner + s, now + outer + u]
    }

    /// What is left after `dt_s` of a state off its equilibrium.
    fn decayed(&self, [s, u]: Lagged, dt_s: f64) -> Lagged {
        if is_none(&self.inner_s) {
            return [s * (-dt_s / self.tau_s).exp(); 2];
        }
        // exp(A t) = e^(m t) (c I + z (A - m I)), m half the trace of A, c and z the (hyperbolic) cosine and sine over the root
        let (outer, inner) = (1.0 / self.tau_s, 1.0 / self.inner_s);
        let m = -0.5 * inner;
        let square = m * m - outer * inner;
        let root = square.abs().sqrt();
        let (c, z) = if square > 0.0 {
            let [up, down] = [(m + root) * dt_s, (m - root) * dt_s].map(f64::exp);
            (0.5 * (up + down), 0.5 * (up - down) / root)
        } else {
            let fade = (m * dt_s).exp();
            let sine = if root > 0.0 { (root * dt_s).sin() / root } else { dt_s };
            (fade * (root * dt_s).cos(), fade * sine)
        };
        [c * s + z * (-m * s - outer * u), c * u + z * (inner * s + (-inner - m) * u)]
    }
}

/// A [`Signal`] on its way along the entries of a log; in equilibrium before the first.
#[derive(Debug, Clone)]
pub struct Follower {
    signal: Signal,
    /// At the first entry kept.
    state: Lagged,
    /// Times, s, and values of the source, from the last entry that lies back by the dead time.
    entries: VecDeque<(f64, f64)>,
}

impl Follower {
    /// A signal that has seen no entry.
    #[must_use]
    pub const fn new(signal: Signal) -> Self {
        Self { signal, state: [f64::NAN; 2], entries: VecDeque::new() }
    }

    /// The next entry of the log; between entries the source goes straight from one to the other.
    pub fn push(&mut self, t_s: f64, value: f64) {
        if self.entries.is_empty() {
            self.state = self.signal.start(value);
        }
        self.entries.push_back((t_s, value));
        while self.entries.len() > 1 && self.entries[1].0 <= t_s - self.signal.dead_time_s {
            let ((t0, before), (t1, now)) = (self.entries[0], self.entries[1]);
            self.state = self.signal.step(self.state, t1 - t0, before, now);
            self.entries.pop_front();
        }
    }

    /// The signal at `t_s`, not before the last entry, where the source has the value `now`; NaN before any entry.
    #[must_use]
    pub fn at(&self, t_s: f64, now: f64) -> f64 {
        let Some(&first) = self.entries.front() else { return f64::NAN };
        let dead_s = self.signal.dead_time_s.max(0.0);
        let from_s = t_s - dead_s;
        let (mut here, mut state) = (first, self.state);
        let mut area = first.1 * (first.0.min(t_s) - from_s).max(0.0);
        for &next in self.entries.iter().skip(1).chain(&[(t_s, now)]) {
            if here.0 < from_s {
                let at = next.0.min(from_s);
                let part = if next.0 > here.0 { (at - here.0) / (next.0 - here.0) } else { 1.0 };
                let value = here.1 + (next.1 - here.1) * part;
                state = self.signal.step(state, at - here.0, here.1, value);
                here = (at, value);
            }
            area += 0.5 * (here.1 + next.1) * (next.0 - here.0).max(0.0);
            here = next;
        }
        if dead_s <= 0.0 {
            return state[0];
        }
        (area + self.signal.tau_s * state[0]) / (dead_s + self.signal.tau_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The lag integrated in small steps, its source going from `before` to `now` at one rate.
    fn integrated(signal: &Signal, mut state: Lagged, dt_s: f64, before: f64, now: f64) -> Lagged {
        let n = 200_000;
        let h = dt_s / f64::from(n);
        for k in 0..n {
            let v = before + (now - before) * (f64::from(k) + 0.5) / f64::from(n);
            let [s, u] = state;
            let inner = signal.inner_s;
            state[0] += h / signal.tau_s * (v - if inner > 0.0 { u } else { s });
            state[1] = if inner > 0.0 { u + h / inner * (s - u) } else { state[0] };
        }
        state
    }

    #[test]
    fn a_step_of_a_lag_is_exact_for_a_source_that_goes_at_one_rate() {
        // none inside, overdamped, critically damped, oscillating
        for inner_s in [0.0, 0.5, 1.0, 1.9] {
            let signal = Signal { inner_s, ..Signal::of(Source::Spindle, 4.0) };
            let start = if inner_s > 0.0 { [0.3, -0.2] } else { [0.3; 2] };
            for dt_s in [0.01, 1.0, 30.0] {
                let exact = signal.step(start, dt_s, 1.0, 3.0);
                let slow = integrated(&signal, start, dt_s, 1.0, 3.0);
                for (a, b) in exact.into_iter().zip(slow) {
                    assert!((a - b).abs() < 2e-3, "{inner_s} {dt_s}: {exact:?} {slow:?}");
                }
                let halfway = signal.step(signal.step(start, 0.5 * dt_s, 1.0, 2.0), 0.5 * dt_s, 2.0, 3.0);
                assert!((halfway[0] - exact[0]).abs() < 1e-9, "{halfway:?} {exact:?}");
            }
        }
    }

    #[test]
    fn behind_a_dead_time_the_signal_is_what_the_position_is_behind_by() {
        // s(t) = t^2 / 2 + sin(2 t), its velocity sampled finely
        let position = |t: f64| 0.5 * t * t + (2.0 * t).sin();
        let velocity = |t: f64| t + 2.0 * (2.0 * t).cos();
        let of = |tau_s, dead_time_s| Signal { dead_time_s, ..Signal::of(Source::Spindle, tau_s) };
        let mut followers = [of(0.0, 0.25), of(0.3, 0.25), of(0.3, 0.0)].map(Follower::new);
        for k in 0..=5000 {
            let t = f64::from(k) * 1e-3;
            followers.iter_mut().for_each(|f| f.push(t, velocity(t)));
        }
        let [delay, both, late] = followers.each_ref().map(|f| f.at(5.0, velocity(5.0)));
        assert!((delay * 0.25 - (position(5.0) - position(4.75))).abs() < 1e-6, "{delay}");
        // behind both, the position is that of the lag a dead time ago
        let mut lag = Follower::new(of(0.3, 0.0));
        (0..=4750).for_each(|k| lag.push(f64::from(k) * 1e-3, velocity(f64::from(k) * 1e-3)));
        let ago = lag.at(4.75, velocity(4.75));
        assert!((both * 0.55 - (position(5.0) - position(4.75) + 0.3 * ago)).abs() < 1e-6, "{both}");
        // between entries
        let mut sparse = Follower::new(of(0.3, 0.0));
        (0..=4999).for_each(|k| sparse.push(f64::from(k) * 1e-3, velocity(f64::from(k) * 1e-3)));
        assert!((sparse.at(5.0, velocity(5.0)) - late).abs() < 1e-12);
        assert!(Follower::new(of(0.3, 0.1)).at(1.0, 2.0).is_nan());
        // at rest before its first entry
        let mut young = Follower::new(of(0.3, 0.25));
        young.push(1.0, 2.0);
        assert!((young.at(1.1, 2.0) - 2.0).abs() < 1e-12);
    }

    #[test]
    fn a_lag_rests_in_equilibrium_and_takes_the_power_of_its_source() {
        let signal = Signal { power: 1.5, ..Signal::of(Source::Spindle, 60.0) };
        let rest = signal.start(4.0);
        assert!((rest[0] - 8.0).abs() < 1e-12);
        assert!((signal.step(rest, 10.0, 4.0, 4.0)[0] - 8.0).abs() < 1e-12);
        assert!((signal.step(rest, 1e6, 0.0, 0.0)[0]).abs() < 1e-12);
    }
}
