//! The heat of a day: hall, screws and spindle nose as series over time; lags are filters over them.

use super::chance::Chance;
use super::course::Course;

/// Step of the series, s.
const STEP_S: f64 = 15.0;
/// Distance of two entries in the log, s.
const LOG_S: f64 = 45.0;
/// Reference temperature of lengths, degC (ISO 1).
pub const REFERENCE_DEGC: f64 = 20.0;

/// Values in equal steps of time from 0 on.
#[derive(Debug, Clone, PartialEq)]
pub struct Series(Vec<f64>);

impl Series {
    fn of(end_s: f64, f: impl Fn(f64) -> f64) -> Self {
        Self((0..=(end_s / STEP_S).ceil() as usize).map(|k| f(k as f64 * STEP_S)).collect())
    }

    /// The value at a time, s; held at the ends.
    #[must_use]
    pub fn at(&self, t: f64) -> f64 {
        let last = self.0.len().saturating_sub(1);
        let place = (t / STEP_S).clamp(0.0, last as f64);
        let k = (place as usize).min(last.saturating_sub(1));
        let get = |k: usize| self.0.get(k).copied().unwrap_or_default();
        get(k) + (get(k + 1) - get(k)) * (place - k as f64)
    }

    /// What follows it with a time constant, s; at rest in the beginning.
    #[must_use]
    pub fn lagged(&self, tau_s: f64) -> Self {
        let keep = (-STEP_S / tau_s).exp();
        let mut state = self.0.first().copied().unwrap_or_default();
        let mut before = state;
        let follow = |v: &f64| {
            state = keep * state + (1.0 - keep) * 0.5 * (before + v);
            before = *v;
            state
        };
        Self(self.0.iter().map(follow).collect())
    }

    /// Its first value.
    #[must_use]
    pub fn first(&self) -> f64 {
        self.0.first().copied().unwrap_or_default()
    }

    /// Every value through a function.
    #[must_use]
    pub fn map(&self, f: impl Fn(f64) -> f64) -> Self {
        Self(self.0.iter().map(|v| f(*v)).collect())
    }

    fn plus(&self, other: &Self) -> Self {
        Self(self.0.iter().zip(&other.0).map(|(a, b)| a + b).collect())
    }
}

/// The temperatures of a day, degC, and the speed of the spindle.
#[derive(Debug, Clone, PartialEq)]
pub struct Heat {
    /// The hall.
    pub hall: Series,
    /// The screws of X, Y, Z where their sensors sit.
    pub screws: [Series; 3],
    /// The nose of the spindle.
    pub nose: Series,
    /// Speed of the spindle, 1000/min.
    pub spindle: Series,
    /// Speeds of the spindle from times on, rpm.
    changes: Vec<[f64; 2]>,
    end_s: f64,
    day: u64,
}

/// The value of a list of `[time, value]` that is in force at a time.
fn in_force(list: &[[f64; 2]], t: f64) -> f64 {
    list.iter().rev().find(|e| e[0] <= t).map_or(0.0, |e| e[1])
}

impl Heat {
    /// The heat while a course is run; `day` draws the weather.
    #[must_use]
    pub fn new(course: &Course, day: u64) -> Self {
        let mut chance = Chance::new(day, "weather");
        let end_s = course.time_s() + 300.0;
        let mean = REFERENCE_DEGC + chance.within(-0.8, 1.0);
        let (swing, period, phase) =
            (chance.within(0.5, 1.1), chance.within(9000.0, 20_000.0), chance.angle());
        // someone opens a gate, or the heating comes on
        let (jump, when, slow) = (
            chance.either() * chance.within(0.6, 1.4),
            chance.within(0.3, 0.8) * end_s,
            chance.within(900.0, 2200.0),
        );
        let hall = Series::of(end_s, |t| {
            mean + swing * (std::f64::consts::TAU * t / period + phase).sin()
                + 0.5 * jump * ((t - when) / slow).tanh()
        });
        let busy = Series::of(end_s, |t| in_force(&course.busy, t));
        let slow_hall = hall.lagged(2100.0);
        let screws = [[4.6, 1300.0], [5.4, 1700.0], [4.0, 2200.0]]
            .map(|[kelvin, tau]| slow_hall.plus(&busy.lagged(tau).map(|share| kelvin * share)));
        let spindle = Series::of(end_s, |t| in_force(&course.spindle, t) * 1e-3);
        let nose = hall.plus(&spindle.map(|v| 9.0 * (v / 8.5).powf(1.2)).lagged(520.0));
        Self { hall, screws, nose, spindle, changes: course.spindle.clone(), end_s, day }
    }

    /// The machine's log, from the beginning: time, speed of the spindle (rpm), sensors of X, Y, Z, nose and room (degC).
    #[must_use]
    pub fn log(&self) -> Vec<[f64; 7]> {
        let mut chance = Chance::new(self.day, "sensors");
        let mut times: Vec<f64> = (0..(self.end_s / LOG_S) as usize).map(|k| k as f64 * LOG_S).collect();
        // a change of speed is logged, too
        times.extend(self.changes.iter().skip(1).flat_map(|[t, _]| [t - 0.05, *t]));
        times.sort_by(f64::total_cmp);
        let [x, y, z] = &self.screws;
        let mut sensor = |s: &Series, t: f64| ((s.at(t) + 0.015 * chance.normal()) / 0.02).round() * 0.02;
        times
            .into_iter()
            .map(|t| {
                [
                    t,
                    in_force(&self.changes, t),
                    sensor(x, t),
                    sensor(y, t),
                    sensor(z, t),
                    sensor(&self.nose, t),
                    sensor(&self.hall, t),
                ]
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::super::programs;
    use super::*;

    #[test]
    fn screws_warm_up_and_the_log_begins_two_hours_before() {
        let course = programs::all(4);
        let heat = Heat::new(&course, 4);
        let (first, last) = (course.rows[0].t_s, course.rows[course.rows.len() - 1].t_s);
        for s in &heat.screws {
            assert!(s.at(last - 4000.0) - s.at(first) > 2.0);
        }
        let log = heat.log();
        assert!(first - log[0][0] >= 7200.0 && log.windows(2).all(|w| w[1][0] - w[0][0] <= 60.0));
        assert!(log.last().is_some_and(|e| e[0] + 60.0 > last));
        assert!(log.iter().any(|e| e[1] == 8500.0));
    }

    #[test]
    fn a_lag_follows_with_its_time_constant() {
        let step = Series::of(4000.0, |t| f64::from(u8::from(t >= 1000.0)));
        let lagged = step.lagged(600.0);
        assert!((lagged.at(1600.0) - (1.0 - (-1f64).exp())).abs() < 0.02 && lagged.at(990.0) == 0.0);
    }
}
