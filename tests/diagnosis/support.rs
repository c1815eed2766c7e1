//! A measurement campaign on a made-up machine, written without the diagnosis: its own formulas, its own noise.

#![allow(clippy::unwrap_used, reason = "a test stops where its own set-up is wrong")]

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal};
use volcomp::diagnose::machine_state::{Machine, Source};
use volcomp::diagnose::report::Report;
use volcomp::diagnose::session::{History, Raw, Session};
use volcomp::diagnose::{Diagnosis, Options, diagnose};

/// State of the machine when a reading is taken.
#[derive(Clone, Debug, Default)]
pub(crate) struct State {
    pub(crate) t: f64,
    pub(crate) instrument: &'static str,
    pub(crate) setup: i64,
    pub(crate) run: i64,
    pub(crate) repeat: i64,
    pub(crate) p: [f64; 3],
    pub(crate) c: f64,
    pub(crate) v: [f64; 3],
    pub(crate) a: [f64; 3],
    pub(crate) dir: [f64; 3],
    pub(crate) dir_c: f64,
    pub(crate) since: [f64; 3],
    pub(crate) since_s: [f64; 3],
    pub(crate) tool: f64,
    pub(crate) range: f64,
    pub(crate) station: [f64; 3],
    pub(crate) target: [f64; 3],
    pub(crate) force: [f64; 3],
    pub(crate) u: [f64; 3],
    pub(crate) pair: i64,
}

/// Where the rotary axis stands, mm.
pub(crate) const CENTRE: [f64; 2] = [250.0, 200.0];
/// Time constant of the spindle's heat, s.
pub(crate) const SPINDLE_TAU: f64 = 1000.0;

pub(crate) struct Campaign {
    pub(crate) states: Vec<State>,
    t: f64,
    run: i64,
}

const BIG: f64 = 1e6;

impl Campaign {
    fn new(start: f64) -> Self {
        Self { states: Vec::new(), t: start, run: 0 }
    }

    fn base(&self, instrument: &'static str, setup: i64, repeat: i64) -> State {
        State {
            t: self.t,
            instrument,
            setup,
            run: self.run,
            repeat,
            since: [BIG; 3],
            since_s: [BIG; 3],
            tool: 120.0,
            range: 1000.0,
            dir: [1.0; 3],
            dir_c: 1.0,
            ..State::default()
        }
    }

    /// A laser line of one axis, both directions, static; `places` are where the other axes stand.
    fn line(&mut self, axis: usize, setup: i64, repeats: i64, from: f64, to: f64, pairs: i64) {
        for repeat in 1..=repeats {
            for direction in [1.0, -1.0] {
                self.run += 1;
                for k in 0..41 {
                    let along = if direction > 0.0 { k } else { 40 - k };
                    // steps are not equal, so that no wave is aliased
                    let f = (along as f64 + 0.3 * (f64::from(along) * 2.4).sin()) / 40.0;
                    self.t += 4.0;
                    let mut s = self.base("laser", setup, repeat);
                    s.p = [200.0, 150.0, 250.0];
                    s.p[axis] = from + (to - from) * f;
                    s.dir[axis] = direction;
                    s.since[axis] = if k == 0 { 5.0 } else { 5.0 + (to - from) * f64::from(k) / 40.0 };
                    s.u[axis] = 1.0;
                    s.range = 600.0 + s.p[axis];
                    s.pair = pairs + if direction > 0.0 { 0 } else { 100 } + i64::from(along);
                    self.states.push(s);
                }
            }
            self.t += 120.0;
        }
    }

    /// Circles of a plane at a feed, both directions; the ballbar measures along the radius.
    fn circles(
        &mut self,
        plane: [usize; 2],
        setup: i64,
        feed: f64,
        centre: [f64; 3],
        radius: f64,
        pairs: i64,
    ) {
        const N: usize = 60;
        for repeat in 1..=2 {
            for (way, direction) in [1.0f64, -1.0].into_iter().enumerate() {
                self.run += 1;
                let omega = direction * feed / radius;
                let start = self.t;
                for k in 0..N {
                    let t = start + (k as f64 + 0.5) * std::f64::consts::TAU / omega.abs() / N as f64;
                    let phi = 0.4 + omega * (t - start);
                    let mut s = self.base("ballbar", setup, repeat);
                    s.t = t;
                    s.p = centre;
                    let (sin, cos) = phi.sin_cos();
                    let (i, j) = (plane[0], plane[1]);
                    s.p[i] += radius * cos;
                    s.p[j] += radius * sin;
                    s.v[i] = -radius * omega * sin;
                    s.v[j] = radius * omega * cos;
                    s.a[i] = -radius * omega * omega * cos;
                    s.a[j] = -radius * omega * omega * sin;
                    s.u[i] = cos;
                    s.u[j] = sin;
                    for (axis, speed) in [(i, s.v[i]), (j, s.v[j])] {
                        s.dir[axis] = speed.signum();
                        // phase since the speed last changed its sign
                        let turn = if axis == i { 0.0 } else { 0.5 * std::f64::consts::PI };
                        let since = (phi - turn).rem_euclid(std::f64::consts::PI);
                        let since = if direction > 0.0 { since } else { std::f64::consts::PI - since };
                        s.since_s[axis] = since / omega.abs();
                        s.since[axis] = radius * (1.0 - since.cos());
                    }
                    s.range = radius;
                    s.pair = pairs + (way * N + k) as i64;
                    self.states.push(s);
                }
                self.t = start + std::f64::consts::TAU / omega.abs() + 5.0;
            }
        }
    }

    /// A grid seen by a tracker in three directions, with two tools in one setup.
    fn grid(&mut self, setup: i64, pairs: i64) {
        let station = [-1500.0, -900.0, 400.0];
        for repeat in 1..=2 {
            for (tool_number, tool) in [80.0, 220.0].into_iter().enumerate() {
                self.run += 1;
                for n in 0..60 {
                    self.t += 3.0;
                    let (i, j, k) = (n % 5, (n / 5) % 4, n / 20);
                    let p = [
                        20.0 + 115.0 * f64::from(i),
                        10.0 + 95.0 * f64::from(j),
                        30.0 + 190.0 * f64::from(k),
                    ];
                    for axis in 0..3 {
                        let mut s = self.base("tracker", setup, repeat);
                        s.p = p;
                        s.tool = tool;
                        s.u[axis] = 1.0;
                        s.station = station;
                        s.range = (0..3).map(|a| (p[a] - station[a]).powi(2)).sum::<f64>().sqrt();
                        s.pair = pairs + tool_number as i64 * 1000 + i64::from(n);
                        self.states.push(s);
                    }
                }
            }
            self.t += 60.0;
        }
    }

    /// Readings at one point in three directions while the spindle is on, off, on.
    fn warm_up(&mut self, setup: i64, pairs: i64) {
        for repeat in 1..=2 {
            self.run += 1;
            for k in 0..90 {
                self.t += 60.0;
                for axis in 0..3 {
                    let mut s = self.base("probe", setup, repeat);
                    s.p = [250.0, 200.0, 100.0];
                    s.u[axis] = 1.0;
                    s.pair = pairs + k;
                    self.states.push(s);
                }
            }
        }
    }

    /// The rotary axis turns; a ball at two radii is measured in three directions.
    fn turns(&mut self, setup: i64, pairs: i64) {
        for repeat in 1..=2 {
            for (ball, target) in [[90.0, 0.0, 60.0], [0.0, 180.0, 180.0]].into_iter().enumerate() {
                for direction in [1.0, -1.0] {
                    self.run += 1;
                    for k in 0..24 {
                        self.t += 2.0;
                        let along = if direction > 0.0 { k } else { 23 - k };
                        let c = f64::from(along) * 15.0 + 2.0 * (f64::from(along) * 1.7).sin();
                        for axis in 0..3 {
                            let mut s = self.base("rtest", setup + ball as i64, repeat);
                            s.c = c.to_radians();
                            s.dir_c = direction;
                            s.target = [CENTRE[0] + target[0], CENTRE[1] + target[1], target[2]];
                            s.p = turned(target, -s.c);
                            s.p[0] += CENTRE[0];
                            s.p[1] += CENTRE[1];
                            s.u[axis] = 1.0;
                            s.pair = pairs
                                + ball as i64 * 1000
                                + if direction > 0.0 { 0 } else { 100 }
                                + i64::from(along);
                            self.states.push(s);
                        }
                    }
                }
            }
        }
    }

    /// Loads in steps along an axis, seen in three directions.
    fn loads(&mut self, setup: i64, pairs: i64) {
        for repeat in 1..=2 {
            self.run += 1;
            for k in 0..48 {
                self.t += 5.0;
                let mut force = [0.0; 3];
                force[k % 3] = 400.0 * f64::from(((k / 3) % 8) as u32) * if k < 24 { 1.0 } else { -1.0 };
                for axis in 0..3 {
                    let mut s = self.base("load", setup, repeat);
                    s.p = [250.0, 200.0, 300.0];
                    s.force = force;
                    s.u[axis] = 1.0;
                    s.pair = pairs + k as i64;
                    self.states.push(s);
                }
            }
        }
    }

    /// The whole campaign.
    pub(crate) fn full() -> Self {
        let mut c = Self::new(8000.0);
        c.everything();
        c
    }

    fn everything(&mut self) {
        for (n, plane) in [[0, 1], [1, 2], [2, 0]].into_iter().enumerate() {
            let centre = [250.0, 200.0, 250.0];
            for (k, feed) in [15.0, 60.0].into_iter().enumerate() {
                self.circles(plane, 10 + n as i64, feed, centre, 120.0, 20_000 + 1000 * (2 * n + k) as i64);
            }
            let second = [330.0, 140.0, 330.0];
            self.circles(plane, 20 + n as i64, 40.0, second, 60.0, 30_000 + 1000 * n as i64);
        }
        for axis in 0..3 {
            self.line(
                axis,
                1 + axis as i64,
                2,
                [5.0, 5.0, 5.0][axis],
                [495.0, 395.0, 445.0][axis],
                1000 * axis as i64,
            );
        }
        self.grid(30, 40_000);
        self.warm_up(31, 50_000);
        self.turns(32, 60_000);
        self.loads(34, 70_000);
        for axis in 0..3 {
            self.line(
                axis,
                41 + axis as i64,
                2,
                5.0,
                [495.0, 395.0, 445.0][axis],
                80_000 + 1000 * axis as i64,
            );
        }
    }

    /// One plane, one feed.
    pub(crate) fn ballbar_only() -> Self {
        let mut c = Self::new(8000.0);
        c.circles([0, 1], 10, 40.0, [250.0, 200.0, 250.0], 120.0, 20_000);
        c
    }
}

/// A vector turned about z.
pub(crate) fn turned(v: [f64; 3], angle: f64) -> [f64; 3] {
    let (s, c) = angle.sin_cos();
    [c * v[0] - s * v[1], s * v[0] + c * v[1], v[2]]
}

/// Speed of the spindle at a time, rpm.
pub(crate) fn rpm(t: f64) -> f64 {
    if t < 12_000.0 {
        0.0
    } else {
        let phase = ((t - 12_000.0) / 1800.0).floor() as i64 % 3;
        [6000.0, 0.0, 9000.0][phase as usize]
    }
}

/// Temperatures at a time, degC: scales, spindle, air.
pub(crate) fn temperatures(t: f64) -> [f64; 3] {
    let warm = (t - 10_000.0).max(0.0) / 6000.0;
    [20.6 + 5.0 * (1.0 - (-warm).exp()), 22.0 + rpm(t) * 1e-3, 20.0 + 1.8 * (t / 5200.0).sin()]
}

/// The spindle's speed behind its lag, by small steps, 1000 rpm.
pub(crate) struct Lagged(Vec<f64>);

impl Lagged {
    pub(crate) fn of_the_campaign() -> Self {
        let (mut state, mut all) = (0.0, Vec::new());
        for k in 0..200_000 {
            let t = f64::from(k) * 0.25;
            state += (rpm(t) * 1e-3 - state) * 0.25 / SPINDLE_TAU;
            if k % 4 == 0 {
                all.push(state);
            }
        }
        Self(all)
    }

    pub(crate) fn at(&self, t: f64) -> f64 {
        self.0[(t as usize).min(self.0.len() - 1)]
    }
}

/// What the machine does: deviation in um.
pub(crate) type Truth<'a> = &'a dyn Fn(&State) -> [f64; 3];

#[derive(Clone, Copy)]
pub(crate) struct Noise {
    pub(crate) white: f64,
    pub(crate) drift: f64,
    pub(crate) drift_s: f64,
    pub(crate) seed: u64,
}

pub(crate) const NOISE: Noise = Noise { white: 1.0, drift: 0.6, drift_s: 300.0, seed: 1 };

/// Columns of a session file from states, a truth and noise.
pub(crate) fn raw(campaign: &Campaign, truth: Truth<'_>, noise: Noise) -> Raw {
    let mut rng = ChaCha8Rng::seed_from_u64(noise.seed);
    let normal = Normal::new(0.0, 1.0).unwrap();
    let names = [
        "t_s",
        "setup",
        "run",
        "repeat",
        "pair",
        "x_mm",
        "y_mm",
        "z_mm",
        "c_deg",
        "u_x",
        "u_y",
        "u_z",
        "deviation_um",
        "vx_mm_per_s",
        "vy_mm_per_s",
        "vz_mm_per_s",
        "ax_mm_per_s2",
        "ay_mm_per_s2",
        "az_mm_per_s2",
        "dir_x",
        "dir_y",
        "dir_z",
        "dir_c",
        "since_reversal_x_mm",
        "since_reversal_y_mm",
        "since_reversal_z_mm",
        "since_reversal_x_s",
        "since_reversal_y_s",
        "since_reversal_z_s",
        "tool_length_mm",
        "range_mm",
        "target_x_mm",
        "target_y_mm",
        "target_z_mm",
        "station_x_mm",
        "station_y_mm",
        "station_z_mm",
        "force_x_n",
        "force_y_n",
        "force_z_n",
    ];
    let mut raw =
        Raw { file: "campaign.csv".into(), names: names.map(String::from).to_vec(), ..Raw::default() };
    raw.columns = vec![Vec::new(); names.len()];
    let mut offsets = std::collections::BTreeMap::new();
    let (mut setup, mut drift, mut t) = (-1, [0.0; 3], 0.0);
    for (n, s) in campaign.states.iter().enumerate() {
        if s.setup != setup {
            setup = s.setup;
            drift = [(); 3].map(|()| noise.drift * normal.sample(&mut rng));
        } else {
            let keep: f64 = (-(s.t - t) / noise.drift_s).exp();
            for d in &mut drift {
                *d = keep * *d + noise.drift * (1.0 - keep * keep).sqrt() * normal.sample(&mut rng);
            }
        }
        t = s.t;
        let offset: [f64; 3] = *offsets
            .entry(s.setup)
            .or_insert_with(|| [(); 3].map(|()| 5.0 * noise.white * normal.sample(&mut rng)));
        let d = truth(s);
        let along: f64 = (0..3).map(|a| s.u[a] * (d[a] + offset[a] + drift[a])).sum();
        let value = along + noise.white * normal.sample(&mut rng);
        let moving = s.instrument == "ballbar";
        let station = if s.instrument == "tracker" { s.station } else { [f64::NAN; 3] };
        let target = if s.instrument == "rtest" { s.target } else { [f64::NAN; 3] };
        let since_s = |a: usize| if moving && s.since_s[a] < 1e5 { s.since_s[a] } else { f64::NAN };
        let row = [
            s.t,
            s.setup as f64,
            s.run as f64,
            s.repeat as f64,
            s.pair as f64,
            s.p[0],
            s.p[1],
            s.p[2],
            s.c.to_degrees(),
            s.u[0],
            s.u[1],
            s.u[2],
            value,
            s.v[0],
            s.v[1],
            s.v[2],
            s.a[0],
            s.a[1],
            s.a[2],
            s.dir[0],
            s.dir[1],
            s.dir[2],
            s.dir_c,
            s.since[0],
            s.since[1],
            s.since[2],
            since_s(0),
            since_s(1),
            since_s(2),
            s.tool,
            s.range,
            target[0],
            target[1],
            target[2],
            station[0],
            station[1],
            station[2],
            s.force[0],
            s.force[1],
            s.force[2],
        ];
        for (c, v) in raw.columns.iter_mut().zip(row) {
            c.push(v);
        }
        raw.instruments.push(s.instrument.into());
        raw.lines.push(n as u64 + 2);
    }
    raw
}

pub(crate) fn history() -> History {
    history_of(1)
}

/// The machine's log on the clock of each file.
pub(crate) fn history_of(files: usize) -> History {
    let mut h = History::default();
    let times = || (0..800).map(|k| f64::from(k) * 30.0);
    for file in 0..files {
        h.add(file, Source::Spindle, times().map(|t| (t, rpm(t) * 1e-3)));
        for (i, name) in ["x", "spindle", "ambient"].into_iter().enumerate() {
            h.add(file, Source::Temperature(name.into()), times().map(|t| (t, temperatures(t)[i])));
        }
    }
    h
}

/// The machine of the campaign: X and C carry the workpiece.
pub(crate) fn machine() -> Machine {
    let mut m = Machine::plain();
    use volcomp::diagnose::machine_state::Axis;
    let order = [(Axis::C, true), (Axis::X, true), (Axis::Y, false), (Axis::Z, false)];
    let entry = m.axes[0];
    m.axes = order
        .into_iter()
        .map(|(axis, workpiece_side)| volcomp::diagnose::machine_state::MachineAxis {
            axis,
            workpiece_side,
            ..entry
        })
        .collect();
    m.axes[0].point_mm = [CENTRE[0], CENTRE[1], 0.0].into();
    m.gauge_point_mm = Some([0.0, 0.0, 0.0].into());
    m
}

pub(crate) fn session(campaign: &Campaign, truth: Truth<'_>, noise: Noise) -> Session {
    Session::build(&[raw(campaign, truth, noise)], history(), machine()).unwrap()
}

pub(crate) fn run(campaign: &Campaign, truth: Truth<'_>, noise: Noise, without: &[&str]) -> Diagnosis {
    use volcomp::diagnose::library::{Label, Without};
    let mut s = session(campaign, truth, noise);
    let without = without
        .iter()
        .map(|w| {
            let (effect, subject) = Label::parse(w).unwrap();
            Without { effect, subject }
        })
        .collect();
    diagnose(
        &mut s,
        None,
        &Options { without, seed: 1, machine: "test".into(), ..Options::default() },
        &mut |_, _| {},
    )
}

/// Labels declared.
pub(crate) fn declared(r: &Report) -> Vec<String> {
    r.causes.iter().filter(|c| c.declared).map(|c| c.label()).collect()
}

/// One line per cause.
pub(crate) fn table(r: &Report) -> String {
    use std::fmt::Write;
    let mut s = format!(
        "{:?} rms {:.2} noise {:.2} shrink {:.3} [{:.3} {:.3}] left z {:.1} rms {:.2} share {:.3} {}\n",
        r.verdict,
        r.gap.rms_um,
        r.gap.noise_um,
        r.shrink.fraction,
        r.shrink.ci90[0],
        r.shrink.ci90[1],
        r.unexplained.z,
        r.unexplained.rms_um,
        r.unexplained.share,
        r.unexplained.looks_like
    );
    for n in &r.noise {
        let _ = writeln!(
            s,
            "   {} white {:.3} drift {:.3} over {:.0} s",
            n.instrument, n.white_um, n.drift_um, n.drift_s
        );
    }
    for c in &r.causes {
        let t = c.tests.map_or(String::new(), |t| {
            format!(
                "ev {:.0}/{:.0} between {:.2} cv {:.2} against {:.2} misform {:.2}",
                t.evidence, t.threshold, t.between, t.held_out, t.against, t.misform
            )
        });
        let _ = writeln!(
            s,
            "   {} {:.3} {} {t} {:?} same {:?} {}",
            c.label(),
            c.probability,
            if c.declared { "DECLARED" } else { "" },
            c.parameters
                .iter()
                .take(4)
                .map(|(k, v)| format!("{k}={:.3}+-{:.3}", v.value, v.std))
                .collect::<Vec<_>>(),
            c.confounded_with,
            c.remark
        );
    }
    s
}

/// Normal noise of unit variance.
pub(crate) fn normal(seed: u64) -> impl FnMut() -> f64 {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let normal = Normal::new(0.0, 1.0).unwrap();
    move || normal.sample(&mut rng)
}
