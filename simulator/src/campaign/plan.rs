//! What is measured, as a list of steps.

use crate::twin::machine::TABLE_MM;

/// A campaign.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Plan {
    /// Lines cold and warm, circles, tracker grid with two tools, warm-up, R-test, load, dynamics.
    Full,
    /// The same programs with fewer points: for tests.
    Small,
    /// Circles in three planes at two feeds, and lines.
    BallbarLaser,
    /// Circles in three planes at one feed.
    OneFeedBallbar,
}

/// What one reading looks at.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Look {
    /// Along one direction.
    Along(usize),
    /// All three, one row each.
    All,
    /// From the centre of a circle, mm, outwards.
    Radial([f64; 3]),
}

/// A step of the campaign.
#[derive(Debug, Clone, PartialEq)]
pub enum Step {
    /// From here on: this instrument in this setup.
    Mount {
        /// Its name.
        instrument: &'static str,
        /// The setup.
        setup: i64,
    },
    /// A new pass, this repetition of its program.
    Run(i64),
    /// Move there (X Y Z mm, C rad) at mm/s.
    Go([f64; 4], f64),
    /// Stand still, s.
    Wait(f64),
    /// A reading at rest.
    Read(Look, i64),
    /// Move there with readings on the way: to, mm/s, how many, look, first pair.
    Glide([f64; 4], f64, usize, Look, i64),
    /// A circle with readings: plane, centre, radius, mm/s with the sense of turning as sign, how many, first pair.
    Circle([usize; 2], [f64; 3], f64, f64, usize, i64),
    /// Readings in quick succession at rest: how many per s, how many, look, first pair.
    Still(f64, usize, usize, i64),
    /// Spindle on, rpm.
    Spindle(f64),
    /// The drives of the axes are kept busy in between, or not.
    Busy(bool),
    /// A force on the tool, N.
    Force([f64; 3]),
    /// Another tool, mm.
    Tool(f64),
    /// The target on the workpiece side at home, mm.
    Target(Option<[f64; 3]>),
}

/// Speed of moves between readings, mm/s.
const RAPID: f64 = 150.0;

/// Whether the laser reads in flight, too.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Flight {
    Yes,
    No,
}

struct Builder {
    steps: Vec<Step>,
    /// Share of the points of the full plan.
    density: f64,
    pair: i64,
}

impl Plan {
    /// Its steps.
    #[must_use]
    pub fn steps(self) -> Vec<Step> {
        let density = if self == Self::Small { 0.55 } else { 1.0 };
        let mut b = Builder { steps: Vec::new(), density, pair: 0 };
        match self {
            Self::OneFeedBallbar => {
                for (n, plane) in PLANES.into_iter().enumerate() {
                    b.circles(plane, 10 + n as i64, 40.0, MIDDLE, 120.0);
                }
            }
            Self::BallbarLaser => {
                b.all_circles();
                b.lines(1, Flight::No);
                b.steps.extend([Step::Busy(true), Step::Wait(7200.0)]);
                b.lines(41, Flight::No);
            }
            Self::Full | Self::Small => {
                b.all_circles();
                b.lines(1, Flight::Yes);
                b.grid(30);
                b.dynamics(50);
                b.steps.push(Step::Busy(true));
                b.warm_up(31);
                b.table(32);
                b.loads(34);
                b.lines(41, Flight::No);
            }
        }
        b.steps
    }
}

const PLANES: [[usize; 2]; 3] = [[0, 1], [1, 2], [2, 0]];
const MIDDLE: [f64; 3] = [250.0, 200.0, 220.0];
const LOW: [f64; 3] = [8.0, 8.0, 8.0];
const HIGH: [f64; 3] = [492.0, 392.0, 442.0];

fn place([x, y, z]: [f64; 3]) -> [f64; 4] {
    [x, y, z, 0.0]
}

impl Builder {
    fn count(&self, full: usize) -> usize {
        ((full as f64 * self.density).round() as usize).max(8)
    }

    /// A block of pair numbers.
    fn pairs(&mut self, n: usize) -> i64 {
        let first = self.pair;
        self.pair += n as i64;
        first
    }

    fn all_circles(&mut self) {
        for (n, plane) in PLANES.into_iter().enumerate() {
            for feed in [18.0, 75.0] {
                self.circles(plane, 10 + n as i64, feed, MIDDLE, 120.0);
            }
            self.circles(plane, 20 + n as i64, 40.0, [330.0, 140.0, 300.0], 60.0);
        }
    }

    /// Both senses of turning, twice.
    fn circles(&mut self, plane: [usize; 2], setup: i64, feed: f64, centre: [f64; 3], radius: f64) {
        let n = self.count(90);
        self.steps.push(Step::Mount { instrument: "ballbar", setup });
        let pairs = self.pairs(2 * n);
        for repeat in 1..=2 {
            for (way, sense) in [1.0, -1.0].into_iter().enumerate() {
                self.steps.push(Step::Run(repeat));
                self.steps.push(Step::Circle(
                    plane,
                    centre,
                    radius,
                    sense * feed,
                    n,
                    pairs + (way * n) as i64,
                ));
                self.steps.push(Step::Wait(5.0));
            }
        }
    }

    /// Targets of each axis at rest and in unequal steps, both ways, twice; in flight, too, where a second instrument is to
    /// see moving axes: a delay of the control is the same to all of them, the clock of each is its own.
    fn lines(&mut self, first_setup: i64, flight: Flight) {
        let n = self.count(33);
        for axis in 0..3 {
            self.steps.push(Step::Mount { instrument: "laser", setup: first_setup + axis as i64 });
            let pairs = self.pairs(2 * n);
            let at = |x: f64| {
                let mut p = [200.0, 150.0, 220.0];
                p[axis] = x;
                place(p)
            };
            let (low, high) = (LOW[axis], HIGH[axis]);
            let target = |k: usize| {
                let f = (k as f64 + 0.3 * (k as f64 * 2.4).sin()) / (n - 1) as f64;
                low + (high - low) * f.clamp(0.0, 1.0)
            };
            for repeat in 1..=2 {
                for up in [true, false] {
                    self.steps.push(Step::Run(repeat));
                    // beyond the first target, so that all are approached from one side
                    self.steps.push(Step::Go(at(if up { low - 7.0 } else { high + 7.0 }), RAPID));
                    for i in 0..n {
                        let k = if up { i } else { n - 1 - i };
                        self.steps.push(Step::Go(at(target(k)), RAPID));
                        self.steps.push(Step::Wait(3.0));
                        let pair = pairs + (k + if up { 0 } else { n }) as i64;
                        self.steps.push(Step::Read(Look::Along(axis), pair));
                    }
                }
                self.steps.push(Step::Wait(60.0));
            }
            if flight == Flight::Yes {
                let n = self.count(16);
                self.back_and_forth([low, high].map(at), 80.0, n, Look::Along(axis));
            }
        }
    }

    /// From end to end and back at one speed (mm/s), twice; `n` readings on each way.
    fn back_and_forth(&mut self, [low, high]: [[f64; 4]; 2], speed: f64, n: usize, look: Look) {
        let pairs = self.pairs(2 * n);
        for repeat in 1..=2 {
            for (way, [from, to]) in [[low, high], [high, low]].into_iter().enumerate() {
                let first = pairs + (way * n) as i64;
                self.steps.extend([
                    Step::Go(from, RAPID),
                    Step::Run(repeat),
                    Step::Glide(to, speed, n, look, first),
                    Step::Wait(2.0),
                ]);
            }
        }
    }

    /// A tracker looks at a grid, with two tools in one setup.
    fn grid(&mut self, setup: i64) {
        self.steps.push(Step::Mount { instrument: "tracker", setup });
        let counts = if self.density < 1.0 { [4, 3, 3] } else { [5, 4, 3] };
        let n = counts[0] * counts[1] * counts[2];
        let pairs = self.pairs(2 * n);
        for repeat in 1..=2 {
            for (t, tool) in [80.0, 220.0].into_iter().enumerate() {
                self.steps.push(Step::Tool(tool));
                self.steps.push(Step::Run(repeat));
                for m in 0..n {
                    let (i, j, k) = (m % counts[0], (m / counts[0]) % counts[1], m / (counts[0] * counts[1]));
                    // back and forth, so that axes come from both sides
                    let i = if j % 2 == 1 { counts[0] - 1 - i } else { i };
                    let j = if k % 2 == 1 { counts[1] - 1 - j } else { j };
                    let cell = [i, j, k];
                    let p: [f64; 3] = std::array::from_fn(|a| {
                        let (low, high) = (LOW[a] + 12.0, HIGH[a] - 12.0);
                        low + (high - low) * cell[a] as f64 / (counts[a] - 1) as f64
                    });
                    self.steps.push(Step::Go(place(p), RAPID));
                    self.steps.push(Step::Wait(2.0));
                    self.steps.push(Step::Read(Look::All, pairs + (t * n + m) as i64));
                }
            }
            self.steps.push(Step::Wait(60.0));
        }
        self.steps.push(Step::Tool(120.0));
    }

    /// At speed along each axis, and a fast capture at rest.
    fn dynamics(&mut self, setup: i64) {
        let n = self.count(24);
        for axis in 0..3 {
            self.steps.push(Step::Mount { instrument: "dynamic", setup: setup + axis as i64 });
            let mut ends = [place(MIDDLE), place(MIDDLE)];
            ends[0][axis] = LOW[axis];
            ends[1][axis] = HIGH[axis];
            self.back_and_forth(ends, 120.0, n, Look::All);
        }
        let n = self.count(128);
        self.steps.push(Step::Mount { instrument: "capture", setup: setup + 3 });
        self.steps.push(Step::Go(place(MIDDLE), RAPID));
        let pairs = self.pairs(3 * n);
        for repeat in 1..=2 {
            for axis in 0..3 {
                self.steps.push(Step::Wait(3.0));
                self.steps.push(Step::Run(repeat));
                self.steps.push(Step::Still(250.0, n, axis, pairs + (axis * n) as i64));
            }
        }
    }

    /// One point in three directions while the spindle is on, off, on; twice, after it has become cold again.
    fn warm_up(&mut self, setup: i64) {
        let n = self.count(60);
        let minute = 60.0 * 60.0 / n as f64;
        self.steps.push(Step::Mount { instrument: "probe", setup });
        self.steps.push(Step::Go([250.0, 200.0, 100.0, 0.0], RAPID));
        let pairs = self.pairs(n);
        for repeat in 1..=2 {
            self.steps.push(Step::Run(repeat));
            for k in 0..n {
                let rpm = match 60 * k / n {
                    0..6 => 0.0,
                    6..24 => 6000.0,
                    24..36 => 0.0,
                    _ => 9000.0,
                };
                self.steps.push(Step::Spindle(rpm));
                self.steps.push(Step::Wait(minute));
                self.steps.push(Step::Read(Look::All, pairs + k as i64));
            }
            self.steps.extend([Step::Spindle(0.0), Step::Wait(10_000.0)]);
        }
    }

    /// The table turns, the tool stays at a ball on it: two balls, both ways, twice.
    fn table(&mut self, setup: i64) {
        let n = self.count(20);
        for (ball, from_axis) in [[90.0, 0.0, 60.0], [0.0, 150.0, 160.0]].into_iter().enumerate() {
            self.steps.push(Step::Mount { instrument: "rtest", setup: setup + ball as i64 });
            self.steps.push(Step::Target(Some(std::array::from_fn(|i| TABLE_MM[i] + from_axis[i]))));
            let pairs = self.pairs(2 * n);
            let follow = |deg: f64| {
                let c = deg.to_radians();
                // a table under a positive coordinate turns the other way
                let (sin, cos) = (-c).sin_cos();
                [
                    TABLE_MM[0] + cos * from_axis[0] - sin * from_axis[1],
                    TABLE_MM[1] + sin * from_axis[0] + cos * from_axis[1],
                    TABLE_MM[2] + from_axis[2] + 120.0,
                    c,
                ]
            };
            for repeat in 1..=2 {
                for up in [true, false] {
                    self.steps.push(Step::Run(repeat));
                    self.steps.push(Step::Go(follow(if up { -6.0 } else { 366.0 }), 60.0));
                    for i in 0..n {
                        let k = if up { i } else { n - 1 - i };
                        let deg = 360.0 * k as f64 / n as f64 + 2.0 * (k as f64 * 1.7).sin();
                        self.steps.push(Step::Go(follow(deg), 60.0));
                        self.steps.push(Step::Wait(2.0));
                        self.steps.push(Step::Read(Look::All, pairs + (k + if up { 0 } else { n }) as i64));
                    }
                }
            }
        }
        self.steps.push(Step::Target(None));
        self.steps.push(Step::Go(place(MIDDLE), 60.0));
    }

    /// Forces in steps along each axis.
    fn loads(&mut self, setup: i64) {
        let n = self.count(42);
        self.steps.push(Step::Mount { instrument: "load", setup });
        let pairs = self.pairs(n);
        for repeat in 1..=2 {
            self.steps.push(Step::Run(repeat));
            for k in 0..n {
                let mut force = [0.0; 3];
                let sense = if k < n / 2 { 1.0 } else { -1.0 };
                force[k % 3] = sense * 350.0 * ((k / 3) % 7) as f64;
                self.steps.push(Step::Force(force));
                self.steps.push(Step::Wait(5.0));
                self.steps.push(Step::Read(Look::All, pairs + k as i64));
            }
            self.steps.push(Step::Force([0.0; 3]));
        }
    }
}
