//! What is measured: motions in order and the readings taken in them. It is the same for every machine and every day.

use nalgebra::Vector3;

use crate::machine::{TABLE_MM, TOOL_MM, reach};
use crate::path::{Command, Motion};

/// Time step of scanning and of the dynamics, s.
pub const STEP_S: f64 = 2e-3;
/// Speed between readings, mm/s.
const RAPID: f64 = 200.0;
/// The log begins so long before the first motion, s.
pub const BEFORE_S: f64 = 9000.0;

/// A stretch of the day with one state of machine and surroundings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Segment {
    /// Begin, s.
    pub begin_s: f64,
    /// Commanded motion.
    pub motion: Motion,
    /// Spindle speed, 1/min.
    pub rpm: f64,
    /// Share of the time in which the axes move for other work.
    pub busy: f64,
    /// Force on the tool, N.
    pub force: [f64; 3],
    /// Tool length, mm.
    pub tool_mm: f64,
}

/// One scalar reading to be taken.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// Index of its segment.
    pub segment: usize,
    /// Time of the reading, s.
    pub t_s: f64,
    /// Instrument.
    pub instrument: &'static str,
    /// Setup, run, repeat, pair.
    pub place: [i64; 4],
    /// Commanded state.
    pub command: Command,
    /// Direction of sensitivity.
    pub u: Vector3<f64>,
    /// Direction of travel since the last reversal; 0 before the axis has moved.
    pub direction: [f64; 4],
    /// Way and time since that reversal, mm and s.
    pub since: [[f64; 2]; 3],
    /// The machine moves.
    pub moving: bool,
    /// Target on the table at home, mm.
    pub target: Option<Vector3<f64>>,
    /// Where the instrument stands, mm.
    pub station: Option<Vector3<f64>>,
    /// Instrument to target, mm.
    pub range_mm: Option<f64>,
}

/// The program.
#[derive(Debug, Clone, Default)]
pub struct Program {
    /// Segments in order.
    pub segments: Vec<Segment>,
    /// Readings in order.
    pub samples: Vec<Sample>,
}

/// Along what a reading is taken.
#[derive(Clone, Copy)]
enum Look {
    Along(usize),
    Space,
    Radial([f64; 3]),
}

struct Builder {
    program: Program,
    t_s: f64,
    q: [f64; 4],
    rpm: f64,
    busy: f64,
    force: [f64; 3],
    tool_mm: f64,
    target: Option<Vector3<f64>>,
    station: Option<Vector3<f64>>,
    mounted: (&'static str, i64),
    run: i64,
    repeat: i64,
    next_pair: i64,
    direction: [f64; 4],
    reversal: [[f64; 2]; 4],
}

const MIDDLE: [f64; 4] = [300.0, 225.0, 200.0, 0.0];
const LOW: [f64; 3] = [12.0, 12.0, 12.0];
const HIGH: [f64; 3] = [588.0, 438.0, 388.0];

/// The program of a day.
pub fn program() -> Program {
    let mut b = Builder {
        program: Program::default(),
        t_s: 0.0,
        q: MIDDLE,
        rpm: 0.0,
        busy: 0.0,
        force: [0.0; 3],
        tool_mm: TOOL_MM,
        target: None,
        station: None,
        mounted: ("laser", 1),
        run: 0,
        repeat: 1,
        next_pair: 0,
        direction: [0.0; 4],
        reversal: [[0.0; 2]; 4],
    };
    b.lines(1);
    b.flights(11);
    b.grid(21);
    for (n, plane) in [[0, 1], [1, 2], [2, 0]].into_iter().enumerate() {
        for speed in [25.0, 95.0] {
            b.circles(31 + n as i64, plane, [300.0, 225.0, 200.0], 100.0, speed);
        }
        b.circles(34 + n as i64, plane, [420.0, 120.0, 290.0], 55.0, 45.0);
    }
    b.starts(41);
    b.capture(45);
    b.loads(51);
    b.busy = 0.7;
    b.spindle(55);
    b.turning(61);
    b.wait(2500.0);
    b.lines(71);
    b.program
}

impl Builder {
    fn pairs(&mut self, n: usize) -> i64 {
        let first = self.next_pair;
        self.next_pair += n as i64;
        first
    }

    fn mount(&mut self, instrument: &'static str, setup: i64) {
        self.mounted = (instrument, setup);
        self.wait(120.0);
    }

    fn pass(&mut self, repeat: i64) {
        self.run += 1;
        self.repeat = repeat;
    }

    fn push(&mut self, motion: Motion) -> usize {
        let segment = Segment {
            begin_s: self.t_s,
            motion,
            rpm: self.rpm,
            busy: self.busy,
            force: self.force,
            tool_mm: self.tool_mm,
        };
        self.program.segments.push(segment);
        self.program.segments.len() - 1
    }

    fn wait(&mut self, seconds: f64) {
        self.push(Motion::rest(self.q, seconds));
        self.t_s += seconds;
    }

    /// Moves; readings at the times given (s after the start).
    fn go(&mut self, motion: Motion, reads: &[f64], look: Look, first_pair: i64) {
        let segment = self.push(motion);
        let mut next = 0;
        let steps = (motion.duration / STEP_S).ceil() as usize;
        for n in 0..=steps {
            let t = (n as f64 * STEP_S).min(motion.duration);
            let c = motion.at(t);
            for k in 0..4 {
                let way = if c.v[k].abs() > 1e-6 { c.v[k].signum() } else { 0.0 };
                if way != 0.0 && way != self.direction[k] {
                    self.direction[k] = way;
                    self.reversal[k] = [c.q[k], self.t_s + t];
                }
            }
            while let Some(at) = reads.get(next).filter(|at| **at <= t) {
                self.read(segment, self.t_s + at, motion.at(*at), true, look, first_pair + next as i64);
                next += 1;
            }
        }
        self.q = motion.at(motion.duration).q;
        self.t_s += motion.duration;
    }

    fn to(&mut self, q: [f64; 4], speed: f64) {
        if (0..4).any(|k| (q[k] - self.q[k]).abs() > 1e-9) {
            self.go(Motion::line(self.q, q, speed), &[], Look::Space, 0);
        }
    }

    /// A reading at rest, after a wait.
    fn stop(&mut self, wait: f64, look: Look, pair: i64) {
        let segment = self.push(Motion::rest(self.q, wait));
        self.t_s += wait;
        let rest = Command { q: self.q, ..Command::default() };
        self.read(segment, self.t_s, rest, false, look, pair);
    }

    fn read(&mut self, segment: usize, t_s: f64, command: Command, moving: bool, look: Look, pair: i64) {
        let unit = |k: usize| Vector3::from_fn(|i, _| if i == k { 1.0 } else { 0.0 });
        let mut directions = Vec::new();
        match look {
            Look::Along(k) => directions.push(unit(k)),
            Look::Space => directions.extend([0, 1, 2].map(unit)),
            Look::Radial(centre) => {
                directions.push(Vector3::from_fn(|i, _| command.q[i] - centre[i]).normalize());
            }
        }
        let (instrument, setup) = self.mounted;
        // tool tip in M, as the reflector
        let tip = Vector3::new(0.0, command.q[1], command.q[2] - self.tool_mm);
        let range_mm = match (instrument, self.station) {
            ("laser" | "flight", _) => match look {
                Look::Along(k) => Some(command.q[k] + 250.0),
                _ => None,
            },
            (_, Some(station)) => Some((tip - station - Vector3::new(-command.q[0], 0.0, 0.0)).norm()),
            _ => None,
        };
        for u in directions {
            self.program.samples.push(Sample {
                segment,
                t_s,
                instrument,
                place: [setup, self.run, self.repeat, pair],
                command,
                u,
                direction: self.direction,
                since: std::array::from_fn(|k| {
                    [(command.q[k] - self.reversal[k][0]).abs(), t_s - self.reversal[k][1]]
                }),
                moving,
                target: self.target,
                station: self.station,
                range_mm,
            });
        }
    }

    /// Positioning tests at rest along the three axes, both directions, three times, unequal steps.
    fn lines(&mut self, setup: i64) {
        let n = 27;
        for axis in 0..3 {
            self.mount("laser", setup + axis as i64);
            let at = |x: f64| {
                let mut q = [250.0, 180.0, 160.0, 0.0];
                q[axis] = x;
                q
            };
            let pairs = self.pairs(2 * n);
            let target = |k: usize| {
                let share = (k as f64 + 0.35 * (k as f64 * 1.9).sin()) / (n - 1) as f64;
                LOW[axis] + (HIGH[axis] - LOW[axis]) * share.clamp(0.0, 1.0)
            };
            for repeat in 1..=2 {
                for back in [false, true] {
                    self.pass(repeat);
                    self.to(at(if back { HIGH[axis] + 9.0 } else { LOW[axis] - 9.0 }), RAPID);
                    for i in 0..n {
                        let k = if back { n - 1 - i } else { i };
                        self.to(at(target(k)), RAPID);
                        self.stop(3.0, Look::Along(axis), pairs + (k + if back { n } else { 0 }) as i64);
                    }
                }
                self.wait(90.0);
            }
        }
    }

    /// Times of equally spaced readings within the constant speed of a motion.
    fn evenly(motion: &Motion, n: usize, whole: bool) -> Vec<f64> {
        let margin = if whole { 0.0 } else { motion.ramp_s() };
        let span = motion.duration - 2.0 * margin;
        (0..n).map(|k| margin + span * (k as f64 + 0.5) / n as f64).collect()
    }

    /// The laser reads in flight at two speeds, back and forth, on a clock of its own.
    fn flights(&mut self, setup: i64) {
        let n = 16;
        for axis in 0..3 {
            self.mount("flight", setup + axis as i64);
            for speed in [40.0, 120.0] {
                let pairs = self.pairs(2 * n);
                let ends = [LOW, HIGH].map(|e| {
                    let mut q = MIDDLE;
                    q[axis] = e[axis];
                    q
                });
                for repeat in 1..=2 {
                    for back in 0..2 {
                        self.to(ends[back], RAPID);
                        self.wait(2.0);
                        self.pass(repeat);
                        let motion = Motion::line(ends[back], ends[1 - back], speed);
                        let reads = Self::evenly(&motion, n, false);
                        self.go(motion, &reads, Look::Along(axis), pairs + (back * n) as i64);
                        self.wait(2.0);
                    }
                }
            }
        }
    }

    /// A tracker looks at a grid with two tools in one setup.
    fn grid(&mut self, setup: i64) {
        self.station = Some(Vector3::new(1900.0, 350.0, -1400.0));
        self.mount("tracker", setup);
        let counts = [5, 4, 3];
        let n = counts.iter().product::<usize>();
        let pairs = self.pairs(2 * n);
        for repeat in 1..=2 {
            for (t, tool) in [90.0, 240.0].into_iter().enumerate() {
                self.tool_mm = tool;
                self.pass(repeat);
                for m in 0..n {
                    let (mut i, mut j, k) =
                        (m % counts[0], (m / counts[0]) % counts[1], m / (counts[0] * counts[1]));
                    if j % 2 == 1 {
                        i = counts[0] - 1 - i;
                    }
                    if k % 2 == 1 {
                        j = counts[1] - 1 - j;
                    }
                    let cell = [i, j, k];
                    let mut q = [0.0; 4];
                    for a in 0..3 {
                        let (low, high) = (LOW[a] + 20.0, HIGH[a] - 20.0);
                        q[a] = low + (high - low) * cell[a] as f64 / (counts[a] - 1) as f64;
                    }
                    self.to(q, RAPID);
                    self.stop(2.0, Look::Space, pairs + (t * n + m) as i64);
                }
            }
            self.wait(120.0);
        }
        self.tool_mm = TOOL_MM;
        self.station = None;
    }

    fn circles(&mut self, setup: i64, plane: [usize; 2], centre: [f64; 3], radius: f64, speed: f64) {
        let n = 72;
        self.mount("ballbar", setup);
        let pairs = self.pairs(2 * n);
        let centre4 = [centre[0], centre[1], centre[2], 0.0];
        for repeat in 1..=2 {
            for (way, sense) in [1.0, -1.0].into_iter().enumerate() {
                let motion = Motion::circle(plane, centre4, radius, sense, speed);
                self.to(motion.at(0.0).q, 60.0);
                self.wait(3.0);
                self.pass(repeat);
                let reads = Self::evenly(&motion, n, false);
                self.go(motion, &reads, Look::Radial(centre), pairs + (way * n) as i64);
                self.wait(3.0);
            }
        }
    }

    /// Starts and stops in space at two places along each axis.
    fn starts(&mut self, setup: i64) {
        let n = 22;
        for axis in 0..3 {
            self.mount("dynamic", setup + axis as i64);
            for other in [0.25, 0.75] {
                let pairs = self.pairs(2 * n);
                let ends = [0.2, 0.8].map(|share| {
                    let mut q = MIDDLE;
                    for a in 0..3 {
                        let share = if a == axis { share } else { other };
                        q[a] = LOW[a] + share * (HIGH[a] - LOW[a]);
                    }
                    q
                });
                for repeat in 1..=2 {
                    for back in 0..2 {
                        self.to(ends[back], RAPID);
                        self.wait(2.0);
                        self.pass(repeat);
                        let motion = Motion::line(ends[back], ends[1 - back], 150.0);
                        // half of the readings in the two ramps
                        let mut reads: Vec<f64> =
                            (0..n / 4).map(|k| motion.ramp_s() * (k as f64 + 0.5) / (n / 4) as f64).collect();
                        let begins: Vec<f64> = reads.iter().map(|t| motion.duration - t).rev().collect();
                        reads.extend(Self::evenly(&motion, n - 2 * (n / 4), false));
                        reads.extend(begins);
                        self.go(motion, &reads, Look::Space, pairs + (back * n) as i64);
                        self.wait(2.0);
                    }
                }
            }
        }
    }

    /// Fast readings at rest in three directions.
    fn capture(&mut self, setup: i64) {
        let n = 120;
        self.mount("capture", setup);
        self.to(MIDDLE, RAPID);
        let pairs = self.pairs(3 * n);
        for repeat in 1..=2 {
            for axis in 0..3 {
                self.wait(4.0);
                self.pass(repeat);
                for k in 0..n {
                    self.stop(4e-3, Look::Along(axis), pairs + (axis * n + k) as i64);
                }
            }
        }
    }

    /// Forces in steps along each axis, the axes clamped.
    fn loads(&mut self, setup: i64) {
        let n = 42;
        self.mount("load", setup);
        self.to(MIDDLE, RAPID);
        let pairs = self.pairs(n);
        for repeat in 1..=2 {
            self.pass(repeat);
            for k in 0..n {
                let way = if k < n / 2 { 1.0 } else { -1.0 };
                self.force = [0.0; 3];
                self.force[k % 3] = way * 320.0 * ((k / 3) % 7) as f64;
                self.stop(5.0, Look::Space, pairs + k as i64);
            }
            self.force = [0.0; 3];
            self.wait(30.0);
        }
    }

    /// Spindle off, on, off, faster: three displacements at one point; twice, cold again in between.
    fn spindle(&mut self, setup: i64) {
        let n = 54;
        self.mount("probe", setup);
        self.to(MIDDLE, RAPID);
        let pairs = self.pairs(n);
        for repeat in 1..=2 {
            self.pass(repeat);
            for k in 0..n {
                self.rpm = match 54 * k / n {
                    0..6 | 26..36 => 0.0,
                    6..26 => 5000.0,
                    _ => 8000.0,
                };
                self.stop(70.0, Look::Space, pairs + k as i64);
            }
            self.rpm = 0.0;
            self.wait(9000.0);
        }
    }

    /// The table turns, the tool follows a ball on it: two balls, both directions, twice.
    fn turning(&mut self, setup: i64) {
        let n = 20;
        for (ball, from_axis) in [[110.0, 130.0, 0.0], [0.0, 240.0, 140.0]].into_iter().enumerate() {
            let home = Vector3::from(TABLE_MM) + Vector3::from(from_axis);
            self.target = Some(home);
            self.mount("rtest", setup + ball as i64);
            let pairs = self.pairs(2 * n);
            for repeat in 1..=2 {
                for back in [false, true] {
                    self.pass(repeat);
                    self.to(reach(home, if back { 366.0_f64 } else { -6.0 }.to_radians(), TOOL_MM), 60.0);
                    for i in 0..n {
                        let k = if back { n - 1 - i } else { i };
                        let deg = 360.0 * k as f64 / n as f64 + 2.5 * (k as f64 * 1.3).sin();
                        self.to(reach(home, deg.to_radians(), TOOL_MM), 60.0);
                        self.stop(2.0, Look::Space, pairs + (k + if back { n } else { 0 }) as i64);
                    }
                }
            }
        }
        self.target = None;
        self.to(MIDDLE, RAPID);
    }
}
