//! A hostile control: any sequence of frames, read-backs included, at any time, against the real engine in simulated time.
//!
//! A script of bytes is the whole test case, so that a fuzzer can mutate it and a random generator can write it. The
//! oracle is `volcomp-monitor`, which sees frames only. Any script is valid; one that ends early ends the test.
//!
//! Reading order: [`run`] (a script to an [`Outcome`]), `script` (bytes to operations), `control` (what the control holds
//! and what it reports).

mod control;
mod script;

use control::Control;
use script::{Operation, Script};
use volcomp_engine::{
    AfterLoss, AxisLimits, Command, Compensator, CycleOutput, EngineConfig, Lag, LimitTime, OutOfTravel,
    PositionSource, RestOffset,
};
use volcomp_model::axes::AxisName;
use volcomp_model::curve::{Fourier, Live};
use volcomp_model::geometry::Vec3;
use volcomp_model::units::{MonoTime, RAD_PER_DEG};
use volcomp_model::{AxisSpec, Chain, Curve, ErrorFunction, ErrorSymbol, Model, ModelSpec};
use volcomp_monitor::{Monitor, Report, Settings};
use volcomp_protocol::MachineState;

const CYCLE_S: f64 = 1e-3;
const CYCLE_NS: i64 = 1_000_000;
/// The control cycles that one script may take.
const CYCLES_MAX: u64 = 50_000;
/// X and Y with limits, Z without, C in degrees.
const AXES: [AxisName; 4] = [AxisName::X, AxisName::Y, AxisName::Z, AxisName::C];

/// What a script led to.
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome {
    /// What the monitor has found.
    pub report: Report,
    /// Control cycles that the script took.
    pub cycles: u64,
    /// Corrections that were sent although a latched fault forbids them.
    pub answers_while_silenced: u64,
}

impl Outcome {
    /// True where every invariant held.
    #[must_use]
    pub const fn is_clean(&self) -> bool {
        self.report.is_clean() && self.answers_while_silenced == 0
    }
}

/// Runs a script. `None` where its first bytes choose a configuration that the engine refuses.
#[must_use]
pub fn run(script: &[u8]) -> Option<Outcome> {
    let mut script = Script::new(script);
    let mut world = World::new(&mut script)?;
    while world.cycles < CYCLES_MAX
        && let Some(operation) = script.next()
    {
        world.carry_out(operation);
    }
    Some(Outcome {
        report: world.monitor.report().clone(),
        cycles: world.cycles,
        answers_while_silenced: world.answers_while_silenced,
    })
}

struct World {
    engine: Compensator,
    models: Vec<Model>,
    model: usize,
    monitor: Monitor,
    link: u64,
    linked: bool,
    now: MonoTime,
    control: Control,
    cycles: u64,
    answers_while_silenced: u64,
}

impl World {
    fn new(script: &mut Script<'_>) -> Option<Self> {
        let config = config(script);
        let models = models();
        let engine = Compensator::new(&config, models.first()?).ok()?;
        let mut world = Self {
            engine,
            models,
            model: 0,
            monitor: Monitor::new(settings(&config)),
            link: 0,
            linked: false,
            now: MonoTime::ZERO,
            control: Control::new(AXES.len(), CYCLE_NS),
            cycles: 0,
            answers_while_silenced: 0,
        };
        world.connect();
        Some(world)
    }

    fn connect(&mut self) {
        self.link += 1;
        self.linked = true;
        self.engine.on_link_up(self.now);
        self.monitor.link_opened(self.link);
    }

    fn disconnect(&mut self) {
        self.linked = false;
        self.engine.on_link_down(self.now);
    }

    fn carry_out(&mut self, operation: Operation) {
        match operation {
            Operation::Cycles { count, speed } => (0..count).for_each(|_| self.cycle(speed)),
            Operation::Lie(lie) => self.control.lie = lie,
            Operation::State(bits) => self.control.frame.state = MachineState::from_bits(bits),
            Operation::Value { place, value } => {
                self.control.set(place, value);
                self.deliver();
            }
            Operation::Hold { axis, value } => self.control.held[axis] = value,
            Operation::Sequence(by) => {
                let sequence = &mut self.control.frame.sequence;
                *sequence = sequence.wrapping_add(by.cast_unsigned());
            }
            Operation::Clock(by_ns) => {
                let time = &mut self.control.frame.control_ns;
                *time = time.saturating_add(by_ns);
            }
            Operation::Silence { cycles, deadlines } => {
                for _ in 0..cycles {
                    self.pass();
                    self.control.advance();
                    if deadlines {
                        self.deadline();
                    }
                }
            }
            Operation::Repeat => self.deliver(),
            Operation::Reconnect { cycles } => {
                self.disconnect();
                for _ in 0..cycles {
                    self.pass();
                    self.control.advance();
                }
                self.connect();
            }
            Operation::Command(command) => self.engine.on_command(self.now, command),
            Operation::Feed(feed) => self.control.frame.feed_mm_per_min = feed,
            Operation::Tool(z_mm) => self.engine.on_tool(Vec3::new(0.0, 0.0, z_mm)),
            Operation::Live(value_mm) => self.engine.on_live(self.now, 0, value_mm),
            Operation::Model(index) => {
                let index = index % self.models.len();
                if self.engine.on_model(&self.models[index]).is_ok() {
                    self.model = index;
                }
            }
        }
    }

    fn pass(&mut self) {
        self.now = self.now.plus_seconds(CYCLE_S);
        self.cycles += 1;
    }

    fn cycle(&mut self, speed: f64) {
        self.pass();
        self.control.frame.commanded[0] += speed;
        self.control.advance();
        self.deliver();
    }

    fn deliver(&mut self) {
        if !self.linked {
            return;
        }
        let frame = self.control.frame;
        self.monitor.position(self.link, &frame);
        let silenced = self.engine.is_silenced();
        let output = self.engine.on_position(self.now, &frame, &self.models[self.model]);
        self.answer(output, silenced);
        if self.engine.needs_new_link() {
            self.disconnect();
            self.connect();
        }
    }

    fn deadline(&mut self) {
        if self.linked && self.engine.next_deadline().is_some_and(|due| self.now >= due) {
            let silenced = self.engine.is_silenced();
            let output = self.engine.on_deadline(self.now);
            self.answer(output, silenced);
        }
    }

    fn answer(&mut self, output: Option<CycleOutput>, silenced: bool) {
        let Some(output) = output else { return };
        self.answers_while_silenced += u64::from(silenced);
        let correction = self.engine.message(&output);
        self.monitor.correction(self.link, &correction);
        self.control.receive(&correction);
    }
}

/// A configuration; every choice is one that a machine file can make.
fn config(script: &mut Script<'_>) -> EngineConfig {
    let choices = script.byte();
    let is = |bit: u8| choices >> bit & 1 == 1;
    let limits = |size: f64, rate: f64| AxisLimits {
        warning: 0.6 * size,
        size,
        stop: 3.0 * size,
        rate,
        acceleration: 20.0 * rate,
        step: if is(0) { 0.3 * rate * CYCLE_S } else { 2.0 * rate * CYCLE_S },
    };
    let never = AxisLimits { size: 0.0, ..limits(0.0, 1.0) };
    let rotary = limits(0.01 * RAD_PER_DEG, 0.1 * RAD_PER_DEG);
    EngineConfig {
        axes: AXES.to_vec(),
        limits: vec![limits(0.05, 1.0), limits(0.15, 2.0), never, rotary],
        cycle_s: CYCLE_S,
        limit_time: if choices.count_ones() % 2 == 1 { LimitTime::Computer } else { LimitTime::Control },
        ramp_s: if is(1) { 0.05 } else { 0.2 },
        stale_s: 0.02,
        hold_s: if is(2) { 0.0 } else { 0.1 },
        after_loss: if is(3) { AfterLoss::Resume } else { AfterLoss::Latch },
        jump_limit: vec![1.0, 1.0, 1.0, 1.0 * RAD_PER_DEG],
        gain: 1.0,
        position_source: if is(4) { PositionSource::Actual } else { PositionSource::Commanded },
        out_of_travel: if is(5) { OutOfTravel::RampOut } else { OutOfTravel::Hold },
        reversal_deadband: vec![1e-3, 1e-3, 1e-3, 1e-3 * RAD_PER_DEG],
        rest: if is(6) { RestOffset::Hold } else { RestOffset::Zero },
        read_back_tolerance: vec![1e-4, 1e-4, 1e-4, 1e-4 * RAD_PER_DEG],
        read_back_cycles: if is(7) { 1 } else { 10 },
        soft_limits: vec![
            [-200.0, 200.0],
            [-1e4, 1e4],
            [f64::NEG_INFINITY, f64::INFINITY],
            [f64::NEG_INFINITY, f64::INFINITY],
        ],
        lag: Lag::Measured,
        lag_uncertainty_cycles: 0.5,
        live_max_age_s: 0.1,
    }
}

/// The same limits, in the units of the link, as the monitor needs them.
fn settings(config: &EngineConfig) -> Settings {
    let scale = |axis: &AxisName| if *axis == AxisName::C { RAD_PER_DEG } else { 1.0 };
    let limits = config.axes.iter().zip(&config.limits).map(|(axis, l)| volcomp_monitor::AxisLimits {
        size: l.size / scale(axis),
        rate: l.rate / scale(axis),
        acceleration: l.acceleration / scale(axis),
        step: l.step / scale(axis),
    });
    Settings {
        axes: config.axes.clone(),
        limits: limits.collect(),
        cycle_s: config.cycle_s,
        ramp_s: config.ramp_s,
        hold_s: 0.1,
        found_factor: volcomp_engine::FOUND_FACTOR,
        margin_s: 0.2,
    }
}

/// A constant, a wave, a live value, one that is far too large, and one with a lever.
fn models() -> Vec<Model> {
    type Error = (&'static str, ErrorFunction);
    let constant = |size: f64| ErrorFunction::single(Curve::Constant(size));
    let wave = Fourier::new(0.0, 500.0, 30.0, 0.0, 0.0, &[], &[0.02]).map(Curve::Fourier);
    let live = vec![Live { sensor: "ram".to_owned(), limit: 0.05, reference: None }];
    let all: Vec<Vec<Error>> = vec![
        vec![("exx", constant(0.01)), ("eyx", constant(-0.02)), ("ecc", constant(1e-5))],
        wave.map(|curve| vec![("exx", ErrorFunction::single(curve))]).unwrap_or_default(),
        vec![("exx", ErrorFunction { live, ..constant(0.002) })],
        vec![("exx", constant(5.0))],
        vec![("eax", constant(1e-4)), ("ebx", constant(-1e-4))],
    ];
    let build = |errors: Vec<Error>| {
        let mut spec = ModelSpec::new("m", Chain::parse("[w C' b X Y Z t]").ok()?);
        let mut x = AxisSpec::new(AxisName::X);
        x.travel = Some([0.0, 500.0]);
        spec.axes.push(x);
        for (symbol, function) in errors {
            spec.errors.push((ErrorSymbol::parse(symbol)?, function));
        }
        Model::new(&spec).ok()
    };
    all.into_iter().filter_map(build).collect()
}

#[cfg(test)]
mod tests;

/// Commands by number.
const COMMANDS: [Command; 8] = [
    Command::Enable,
    Command::Enable,
    Command::Disable,
    Command::ClearFault,
    Command::SetGain(0.4),
    Command::SetGain(f64::NAN),
    Command::KeepFault,
    Command::Stop,
];
