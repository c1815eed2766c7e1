//! The course of a campaign: where the axes are, how fast, and since when they go which way, from closed formulas.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use nalgebra::Vector3;

use super::chance::Chance;
use super::machine::TOOL_MM;
use super::row::{Ramped, Row};

/// A circle to be measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Circle {
    /// The two axes, in the sense of turning.
    pub plane: [usize; 2],
    /// Its centre, mm.
    pub centre: [f64; 3],
    /// Its radius, mm.
    pub radius: f64,
    /// Feed, mm/s; negative is clockwise.
    pub feed: f64,
    /// Number of readings.
    pub count: usize,
}

/// The course up to now.
#[derive(Debug, Clone)]
pub struct Course {
    /// Everything read.
    pub rows: Vec<Row>,
    /// Speeds of the spindle from times on.
    pub spindle: Vec<[f64; 2]>,
    /// How busy the axes are from times on, 0 to 1.
    pub busy: Vec<[f64; 2]>,
    now: Row,
    turned_mm: [f64; 3],
    turned_s: [f64; 3],
    jolted_s: f64,
    runs: i64,
    pairs: i64,
    dwell: Chance,
}

/// Three directions.
pub const ALL: [Vector3<f64>; 3] =
    [Vector3::new(1.0, 0.0, 0.0), Vector3::new(0.0, 1.0, 0.0), Vector3::new(0.0, 0.0, 1.0)];

impl Course {
    /// A machine that has just been referenced, at `begin_s`.
    #[must_use]
    pub fn new(begin_s: f64, day: u64) -> Self {
        let now = Row {
            t_s: begin_s,
            instrument: "none",
            place: [0; 4],
            position: [0.0; 3],
            speed: [0.0; 3],
            acceleration: [0.0; 3],
            turn: [0.0; 2],
            direction: [1.0; 5],
            since_mm: [40.0; 3],
            since_s: [20.0; 3],
            u: ALL[0],
            moving: false,
            tool_mm: TOOL_MM,
            range_mm: None,
            target_mm: None,
            station_mm: None,
            force_n: [0.0; 3],
            rpm: 0.0,
            since_jolt_s: 10.0,
            jolt: [0.0; 3],
        };
        Self {
            rows: Vec::new(),
            spindle: vec![[0.0, 0.0]],
            busy: vec![[0.0, 0.0]],
            now,
            // referenced 40 mm below
            turned_mm: [-40.0; 3],
            turned_s: [begin_s - 20.0; 3],
            jolted_s: begin_s - 10.0,
            runs: 0,
            pairs: 0,
            dwell: Chance::new(day, "dwell"),
        }
    }

    /// A new mounting of an instrument, some minutes later.
    pub fn mount(&mut self, instrument: &'static str, setup: i64) {
        self.now.instrument = instrument;
        self.now.place[0] = setup;
        (self.now.target_mm, self.now.station_mm) = (None, None);
        let minutes = self.dwell.within(3.0, 9.0);
        self.wait(60.0 * minutes);
    }

    /// A new pass.
    pub fn run(&mut self, repeat: i64) {
        self.runs += 1;
        self.now.place[1] = self.runs;
        self.now.place[2] = repeat;
    }

    /// A block of numbers for programmed points; gives the first.
    pub fn pairs(&mut self, count: usize) -> i64 {
        let first = self.pairs;
        self.pairs += count as i64;
        first
    }

    /// Time passes.
    pub fn wait(&mut self, seconds: f64) {
        self.now.t_s += seconds;
    }

    /// A dwell that is never twice the same.
    pub fn dwell(&mut self, low: f64, high: f64) {
        let seconds = self.dwell.within(low, high);
        self.wait(seconds);
    }

    /// The time, s.
    #[must_use]
    pub const fn time_s(&self) -> f64 {
        self.now.t_s
    }

    /// Another tool, mm.
    pub const fn tool(&mut self, length_mm: f64) {
        self.now.tool_mm = length_mm;
    }

    /// A target on the table, at home, mm.
    pub const fn target(&mut self, home_mm: Option<[f64; 3]>) {
        self.now.target_mm = home_mm;
    }

    /// Where the instrument stands, mm.
    pub const fn station(&mut self, at_mm: [f64; 3]) {
        self.now.station_mm = Some(at_mm);
    }

    /// A force on the tool, N.
    pub const fn force(&mut self, newton: [f64; 3]) {
        self.now.force_n = newton;
    }

    /// The spindle, rpm.
    pub fn spin(&mut self, rpm: f64) {
        if self.now.rpm.to_bits() != rpm.to_bits() {
            self.now.rpm = rpm;
            self.spindle.push([self.now.t_s, rpm]);
        }
    }

    /// The axes are kept busy from now on, 0 to 1.
    pub fn work(&mut self, share: f64) {
        self.busy.push([self.now.t_s, share]);
    }

    /// Remembers that an axis begins to move one way.
    fn turn_round(&mut self, axis: usize, way: f64) {
        if way.abs() > 1e-9
            && let Some(d) = self.now.direction.get_mut(axis)
            && *d != way.signum()
        {
            *d = way.signum();
            if let Some(from) = self.now.position.get(axis) {
                self.turned_mm[axis] = *from;
                self.turned_s[axis] = self.now.t_s;
            }
        }
    }

    /// Goes to a place (mm, rad) at mm/s, or as much in deg/s, and stands there.
    pub fn go(&mut self, to: [f64; 3], turn: [f64; 2], speed: f64) {
        let mut longest = 0.0f64;
        for (axis, q) in to.into_iter().enumerate() {
            let way = q - self.now.position[axis];
            self.turn_round(axis, way);
            longest = longest.max(way.abs());
        }
        for (axis, q) in turn.into_iter().enumerate() {
            let way = q - self.now.turn[axis];
            self.turn_round(3 + axis, way);
            longest = longest.max(way.abs().to_degrees());
        }
        (self.now.position, self.now.turn) = (to, turn);
        self.wait(longest / speed + 0.2);
        (self.jolted_s, self.now.jolt) = (self.now.t_s, [0.0; 3]);
    }

    /// Reads at rest.
    pub fn read(&mut self, looks: &[Vector3<f64>], pair: i64) {
        (self.now.speed, self.now.acceleration, self.now.moving) = ([0.0; 3], [0.0; 3], false);
        self.take(looks, pair);
    }

    fn take(&mut self, looks: &[Vector3<f64>], pair: i64) {
        let n = &mut self.now;
        n.place[3] = pair;
        n.since_mm = std::array::from_fn(|k| (n.position[k] - self.turned_mm[k]).abs());
        n.since_s = std::array::from_fn(|k| n.t_s - self.turned_s[k]);
        n.since_jolt_s = n.t_s - self.jolted_s;
        n.range_mm = n.station_mm.map(|s| (n.tip() - Vector3::from(s)).norm());
        for u in looks {
            n.u = *u;
            self.rows.push(n.clone());
        }
    }

    /// Moves along one axis to `to` with readings after the times given (s); some may lie after the stop.
    pub fn glide(
        &mut self,
        axis: usize,
        to: f64,
        [speed, ramp_s]: [f64; 2],
        times: &[f64],
        looks: &[Vector3<f64>],
        first: i64,
    ) {
        let from = self.now.position[axis];
        let sense = (to - from).signum();
        let line = Ramped { way_mm: (to - from).abs(), speed, ramp_s };
        self.turn_round(axis, sense);
        let (begin, end) = (self.now.t_s, line.seconds());
        let mut jolt = [0.0; 3];
        jolt[axis] = sense * 0.5 * speed * PI / ramp_s;
        for (k, t) in times.iter().enumerate() {
            let [way, v, a] = line.at(*t);
            self.now.t_s = begin + t;
            self.now.position[axis] = from + sense * way;
            self.now.speed[axis] = sense * v;
            self.now.acceleration[axis] = sense * a;
            self.now.moving = v > 1e-6;
            let stopped = *t >= end;
            self.jolted_s = if stopped { begin + end } else { begin };
            self.now.jolt = if stopped { jolt.map(|j| -j) } else { jolt };
            self.take(looks, first + k as i64);
        }
        self.now.t_s = begin + end.max(times.last().copied().unwrap_or_default());
        (self.now.speed, self.now.acceleration, self.now.moving) = ([0.0; 3], [0.0; 3], false);
        self.now.position[axis] = to;
        self.jolted_s = begin + end;
    }

    /// A circle, read along its radius, after more than half a turn to get up to speed.
    pub fn circle(&mut self, c: &Circle, first: i64) {
        /// Angle from which readings begin, rad.
        const BEGIN: f64 = 0.55;
        /// Way before it, rad.
        const BEFORE: f64 = 3.6;
        let sense = c.feed.signum();
        let omega = c.feed.abs() / c.radius;
        let at = |theta: f64| {
            let mut p = c.centre;
            p[c.plane[0]] += c.radius * theta.cos();
            p[c.plane[1]] += c.radius * theta.sin();
            p
        };
        self.go(at(BEGIN - sense * BEFORE), [0.0; 2], 120.0);
        let begin = self.now.t_s + 0.8;
        self.jolted_s = begin;
        for k in 0..c.count {
            let even = TAU * (k as f64 + 0.5) / c.count as f64;
            // readings stand close where an axis turns round
            let mark = |phi: f64| phi - 0.2 * (4.0 * phi).sin();
            let theta = mark(BEGIN + sense * even);
            let gone = sense * (theta - BEGIN) + BEFORE;
            let (sin, cos) = theta.sin_cos();
            self.now.t_s = begin + gone / omega;
            self.now.position = at(theta);
            self.now.moving = true;
            let mut u = Vector3::zeros();
            for (axis, [place, tangent], turns_at) in
                [(c.plane[0], [cos, -sin], 0.0), (c.plane[1], [sin, cos], FRAC_PI_2)]
            {
                self.now.speed[axis] = sense * c.radius * omega * tangent;
                self.now.acceleration[axis] = -c.radius * omega * omega * place;
                self.now.direction[axis] = self.now.speed[axis].signum();
                // the axis turns round at every half turn from there
                let since = (sense * (theta - turns_at)).rem_euclid(PI);
                self.turned_s[axis] = self.now.t_s - since / omega;
                self.turned_mm[axis] = at(theta - sense * since)[axis];
                u[axis] = place;
            }
            self.take(&[u], first + k as i64);
        }
        (self.now.speed, self.now.acceleration, self.now.moving) = ([0.0; 3], [0.0; 3], false);
        self.wait(2.0);
        self.jolted_s = self.now.t_s;
    }

    /// Readings at rest in quick and even succession, `rate` per s.
    pub fn capture(&mut self, rate: f64, count: usize, first: i64) {
        let begin = self.now.t_s;
        for k in 0..count {
            self.now.t_s = begin + k as f64 / rate;
            self.read(&ALL, first + k as i64);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_circle_turns_round_where_it_is_furthest_out() {
        let mut course = Course::new(0.0, 1);
        let c = Circle { plane: [1, 2], centre: [0.0, 10.0, 200.0], radius: 100.0, feed: -40.0, count: 200 };
        course.circle(&c, 0);
        for r in &course.rows {
            let out = (r.position[1] - 10.0).abs() + r.since_mm[1];
            let back = (r.position[1] - 10.0) * r.direction[1] < 0.0;
            assert!(!back || (out - 100.0).abs() < 1e-9, "{r:?}");
            assert!(
                (r.speed[1].hypot(r.speed[2]) - 40.0).abs() < 1e-9 && r.direction[1] == r.speed[1].signum()
            );
            // further than half a turn ago no axis has turned round
            assert!(r.since_s[1] <= PI * 100.0 / 40.0 + 1e-9 && r.since_s[2] >= 0.0);
        }
        assert!(course.rows.windows(2).all(|w| w[1].t_s > w[0].t_s));
    }
}
