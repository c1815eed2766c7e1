//! The machine runs a plan; at each reading its state is taken.

use super::beside::Beside;
use super::legs::Leg;
use super::plan::{Look, Plan, Step};
use crate::twin::{Command, Dice, Twin, TwinError, TwinTruth};

/// Step of the drives, s.
const STEP_S: f64 = 1e-3;
/// Step while coming to rest, s.
const REST_STEP_S: f64 = 2e-3;
/// What stands beside the control has so long to come to rest after a move, s.
const BESIDE_RESTS_S: f64 = 0.3;
/// The campaign begins so long after the machine's log, s.
const BEGIN_S: f64 = 8000.0;
/// Distance of two entries in the log, s.
const LOG_S: f64 = 30.0;
/// Where the tracker stands, mm.
const STATION_MM: [f64; 3] = [-1500.0, -900.0, 400.0];
/// Distance of the laser's head from the machine's zero, mm.
const HEAD_MM: f64 = 600.0;

/// The state of machine and instrument at one reading.
#[derive(Debug, Clone, PartialEq)]
pub struct State {
    /// Time on the instrument's clock, s.
    pub t_s: f64,
    /// The instrument.
    pub instrument: &'static str,
    /// Mounting, pass, repetition, number of the programmed point.
    pub place: [i64; 4],
    /// Set points, mm and rad.
    pub command: Command,
    /// Travel since the last reversal of X, Y, Z, C.
    pub direction: [f64; 4],
    /// Way since then, mm.
    pub since_mm: [f64; 3],
    /// Time since then, s.
    pub since_s: [f64; 3],
    /// Direction of sensitivity.
    pub u: [f64; 3],
    /// An axis moves.
    pub moving: bool,
    /// Tool, mm.
    pub tool_mm: f64,
    /// Instrument to target, mm.
    pub range_mm: f64,
    /// Target on the workpiece side.
    pub target_mm: Option<[f64; 3]>,
    /// Where the instrument stands.
    pub station_mm: Option<[f64; 3]>,
    /// Forces, N.
    pub force_n: [f64; 3],
    /// Spindle, rpm.
    pub spindle_rpm: f64,
    /// Temperature of the air, degC.
    pub air_degc: f64,
    /// What the machine does along u, um; no instrument has touched it yet.
    pub true_um: f64,
}

/// An entry of the machine's log.
#[derive(Debug, Clone, PartialEq)]
pub struct Entry {
    /// Time, s.
    pub t_s: f64,
    /// Spindle, rpm.
    pub spindle_rpm: f64,
    /// Temperatures, degC.
    pub temperatures: [(&'static str, f64); 5],
}

/// Everything that a plan took.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Taken {
    /// The states in order.
    pub states: Vec<State>,
    /// The machine's log, from two hours before.
    pub log: Vec<Entry>,
}

/// Clocks of the instruments: seconds late, more of it per second, and the share that each has.
struct Skew {
    late_s: f64,
    rate: f64,
    own: [(&'static str, f64); 3],
}

struct Runner {
    twin: Twin,
    taken: Taken,
    t: f64,
    logged: f64,
    at: [f64; 4],
    instrument: &'static str,
    place: [i64; 4],
    runs: i64,
    tool: f64,
    target: Option<[f64; 3]>,
    direction: [f64; 4],
    turned_mm: [f64; 3],
    turned_s: [f64; 3],
    skew: Option<Skew>,
    sensors: Dice,
    /// What offsets the set points, where anything does.
    beside: Option<Box<dyn Beside>>,
}

/// Runs a plan, with something beside the control that offsets its set points, or without.
///
/// # Errors
/// The truth names something that the twin has no physics for.
pub fn take(
    truth: &TwinTruth,
    plan: Plan,
    seed: u64,
    beside: Option<Box<dyn Beside>>,
) -> Result<Taken, TwinError> {
    let skew = truth.effects.iter().find(|e| e.name == "clock-skew").map(|e| {
        let mut dice = Dice::new(truth.seed, "clock");
        let late = e.size_um * 1e-3 / 30.0;
        let rate = e.constant("rate", dice.between(-0.3, 0.3)) * late / 3600.0;
        let own = ["ballbar", "dynamic", "laser"].map(|i| (i, dice.sign() * dice.between(0.5, 1.3)));
        Skew { late_s: late, rate, own }
    });
    let mut r = Runner {
        twin: Twin::new(truth, seed)?,
        taken: Taken::default(),
        t: 0.0,
        logged: f64::NEG_INFINITY,
        at: [250.0, 200.0, 220.0, 0.0],
        instrument: "none",
        place: [0; 4],
        runs: 0,
        tool: 120.0,
        target: None,
        direction: [1.0; 4],
        turned_mm: [f64::NAN; 3],
        turned_s: [f64::NAN; 3],
        skew,
        sensors: Dice::new(seed, "sensors"),
        beside,
    };
    r.begin();
    r.wait(BEGIN_S);
    for step in plan.steps() {
        r.step(&step);
    }
    r.wait(60.0);
    Ok(r.taken)
}

/// Set points of another moment with the offset that those of this one have.
fn shifted(then: &Command, plain: &Command, with: &Command) -> Command {
    let mut out = *then;
    for ((out, plain), with) in out.linear.iter_mut().zip(&plain.linear).zip(&with.linear) {
        out.q += with.q - plain.q;
    }
    out.table.q += with.table.q - plain.table.q;
    out
}

impl Runner {
    /// The control is switched on, and with it what corrects the machine.
    fn begin(&mut self) {
        let here = Leg::Line { from: self.at, to: self.at, seconds: 1.0 }.at(0.0);
        if let Some(beside) = &mut self.beside {
            beside.begin(&here);
        }
    }

    /// The set points with the offset that is in force.
    fn offset(&mut self, command: &Command) -> Command {
        self.beside.as_mut().map_or(*command, |beside| beside.step(command))
    }

    fn step(&mut self, step: &Step) {
        match step {
            Step::Mount { instrument, setup } => {
                self.instrument = instrument;
                self.place[0] = *setup;
                // someone has to walk there
                self.wait(240.0);
            }
            Step::Run(repeat) => {
                self.runs += 1;
                self.place[1] = self.runs;
                self.place[2] = *repeat;
            }
            Step::Go(to, speed) => {
                let leg = Leg::line(self.at, *to, *speed);
                self.travel(&leg, &[], Look::All, 0);
            }
            Step::Wait(seconds) => self.wait(*seconds),
            Step::Read(look, pair) => {
                let here = Leg::Line { from: self.at, to: self.at, seconds: 1.0 };
                self.read(&here.at(0.0), self.t, *look, *pair);
            }
            Step::Glide(to, speed, n, look, first) => {
                let leg = Leg::line(self.at, *to, *speed);
                let times: Vec<f64> =
                    (0..*n).map(|k| leg.seconds() * (0.06 + 0.88 * (k as f64 + 0.5) / *n as f64)).collect();
                self.travel(&leg, &times, *look, *first);
            }
            Step::Circle(plane, centre, radius, feed, n, first) => {
                self.circle(*plane, *centre, *radius, *feed, *n, *first);
            }
            Step::Still(rate, n, axis, first) => {
                let command = Leg::Line { from: self.at, to: self.at, seconds: 1.0 }.at(0.0);
                for k in 0..*n {
                    self.read(&command, self.t + k as f64 / rate, Look::Along(*axis), first + k as i64);
                }
                self.wait(*n as f64 / rate);
            }
            Step::Spindle(rpm) => {
                self.twin.heat.spindle_rpm = *rpm;
                self.log();
            }
            Step::Busy(busy) => self.twin.heat.busy = *busy,
            Step::Force(force) => self.twin.force_n = *force,
            Step::Tool(length) => {
                self.tool = *length;
                if let Some(beside) = &mut self.beside {
                    beside.tool(*length);
                }
            }
            Step::Target(target) => self.target = *target,
        }
    }

    fn circle(&mut self, plane: [usize; 2], centre: [f64; 3], radius: f64, feed: f64, n: usize, first: i64) {
        const START: f64 = 0.4;
        let omega = feed / radius;
        let turn = std::f64::consts::TAU / omega.abs();
        // half a radian up to speed, and more, so that what a start leaves has died away
        let (ramp, run_in) = (1.0 / omega.abs(), 0.7 / omega.abs());
        let [x, y, z] = centre;
        let leg = Leg::Arc {
            centre: [x, y, z, 0.0],
            plane,
            radius,
            start: START - 1.2 * omega.signum(),
            omega,
            ramp,
            steady: turn + 2.0 * run_in,
        };
        let begin = leg.at(0.0).linear.map(|s| s.q);
        self.travel(&Leg::line(self.at, [begin[0], begin[1], begin[2], 0.0], 150.0), &[], Look::All, 0);
        self.wait(1.0);
        let times: Vec<f64> = (0..n).map(|k| ramp + run_in + turn * (k as f64 + 0.5) / n as f64).collect();
        self.travel(&leg, &times, Look::Radial(centre), first);
    }

    /// Moves along a leg and takes readings at some times of it.
    fn travel(&mut self, leg: &Leg, times: &[f64], look: Look, first: i64) {
        let latency = self.twin.latency_s;
        let steps = (leg.seconds() / STEP_S).ceil() as usize;
        let begin = self.t;
        let mut next = 0;
        let mut taken = 0.0;
        for k in 0..=steps {
            let t = k as f64 * STEP_S;
            // the control asks for where it wanted to be a little earlier
            let with = self.offset(&leg.at(t));
            let late = if latency > 0.0 { shifted(&leg.at(t - latency), &leg.at(t), &with) } else { with };
            self.twin.step(STEP_S, &late);
            self.follow(&leg.at(t), begin + t);
            while times.get(next).is_some_and(|due| *due <= t) {
                // what the clock of the instrument says of this moment
                let late = self.late(begin + t);
                self.read(&leg.at(t - late), begin + t - late, look, first + next as i64);
                next += 1;
            }
            if t - taken >= 1.0 {
                self.heat_up(t - taken);
                taken = t;
            }
        }
        let end = steps as f64 * STEP_S;
        self.heat_up(end - taken);
        self.t = begin + end;
        self.at = leg.end();
    }

    fn late(&self, t: f64) -> f64 {
        self.skew.as_ref().map_or(0.0, |skew| {
            let own = skew.own.iter().find(|(name, _)| *name == self.instrument);
            own.map_or(0.0, |(_, share)| share * (skew.late_s + skew.rate * (t - BEGIN_S)))
        })
    }

    /// Remembers reversals of the set points.
    fn follow(&mut self, command: &Command, t: f64) {
        for (k, (d, set)) in
            self.direction.iter_mut().zip(command.linear.iter().chain([&command.table])).enumerate()
        {
            if set.v.abs() > 1e-9 && set.v.signum() != *d {
                *d = set.v.signum();
                if let (Some(mm), Some(s)) = (self.turned_mm.get_mut(k), self.turned_s.get_mut(k)) {
                    (*mm, *s) = (set.q, t);
                }
            }
        }
    }

    fn heat_up(&mut self, seconds: f64) {
        self.twin.heat.pass(seconds);
        if let Some(beside) = &mut self.beside {
            beside.warm(seconds, &self.twin.heat);
        }
        if self.twin.heat.time_s() - self.logged >= LOG_S {
            self.log();
        }
    }

    fn wait(&mut self, seconds: f64) {
        let command = Leg::Line { from: self.at, to: self.at, seconds: 1.0 }.at(0.0);
        let settling = self.twin.settling_s();
        // without a servo one step says where the machine stands; an offset has a cycle of its own
        let (rest, step) = if self.beside.is_some() {
            (settling.max(BESIDE_RESTS_S), STEP_S)
        } else {
            (settling, REST_STEP_S)
        };
        for _ in 0..((rest.min(seconds) / step) as usize).max(1) {
            let with = self.offset(&command);
            self.twin.step(step, &with);
        }
        let mut left = seconds;
        while left > 0.0 {
            let part = left.min(LOG_S);
            self.heat_up(part);
            left -= part;
        }
        self.t += seconds;
    }

    fn log(&mut self) {
        let heat = &self.twin.heat;
        self.logged = heat.time_s();
        let (t_s, spindle_rpm, mut temperatures) = (heat.time_s(), heat.spindle_rpm, heat.sensors());
        for (_, value) in &mut temperatures {
            *value = ((*value + 0.01 * self.sensors.normal()) * 100.0).round() / 100.0;
        }
        self.taken.log.push(Entry { t_s, spindle_rpm, temperatures });
    }

    fn read(&mut self, nominal: &Command, t_s: f64, look: Look, pair: i64) {
        let d = self.twin.deviation_mm(nominal, self.tool);
        let p = nominal.linear.map(|s| s.q);
        let unit = |k: usize| std::array::from_fn(|i| f64::from(u8::from(i == k)));
        let looks: Vec<[f64; 3]> = match look {
            Look::Along(k) => vec![unit(k)],
            Look::All => (0..3).map(unit).collect(),
            Look::Radial(centre) => {
                let r: [f64; 3] = std::array::from_fn(|i| p[i] - centre[i]);
                let length = r.iter().map(|v| v * v).sum::<f64>().sqrt().max(1e-9);
                vec![r.map(|v| v / length)]
            }
        };
        let moving = nominal.linear.iter().any(|s| s.v.abs() > 1e-6);
        let since_mm = std::array::from_fn(|k| (p[k] - self.turned_mm[k]).abs());
        let since_s = std::array::from_fn(|k| t_s - self.turned_s[k]);
        let (range_mm, station_mm) = self.range(p, look);
        self.place[3] = pair;
        for u in looks {
            self.taken.states.push(State {
                t_s,
                instrument: self.instrument,
                place: self.place,
                command: *nominal,
                direction: self.direction,
                since_mm,
                since_s,
                u,
                moving,
                tool_mm: self.tool,
                range_mm,
                target_mm: self.target,
                station_mm,
                force_n: self.twin.force_n,
                spindle_rpm: self.twin.heat.spindle_rpm,
                air_degc: self.twin.heat.air(),
                true_um: 1e3 * (0..3).map(|i| u[i] * d[i]).sum::<f64>(),
            });
        }
    }

    fn range(&self, p: [f64; 3], look: Look) -> (f64, Option<[f64; 3]>) {
        match (self.instrument, look) {
            ("tracker", _) => {
                let r = (0..3).map(|i| (p[i] - STATION_MM[i]).powi(2)).sum::<f64>().sqrt();
                (r, Some(STATION_MM))
            }
            ("laser", Look::Along(k)) => (HEAD_MM + p.get(k).copied().unwrap_or_default(), None),
            _ => (f64::NAN, None),
        }
    }
}
