//! The same machine with volcompd's engine beside its control: what it takes out, and what it leaves.
//!
//! Each millisecond the engine sees the set points that the control tells, and its offset is added to those of the next
//! millisecond, as `docs/protocol.md` says. It knows the model file that it was given and nothing of the truth.

#![expect(clippy::unwrap_used, reason = "helpers of tests")]

use std::collections::VecDeque;

use volcomp::config::model::parse_file;
use volcomp::engine::{
    AfterLoss, AxisLimits, Command as Order, Compensator, EngineConfig, Lag, LimitTime, OutOfTravel,
    PositionSource, RestOffset,
};
use volcomp::estimate::{Quantity, Thermal, ThermalState};
use volcomp::model::Model;
use volcomp::model::axes::{AxisArray, AxisKind, AxisName, MAX_AXES};
use volcomp::model::units::MonoTime;
use volcomp::protocol::{MachineState, Position};

use simulator::campaign::Beside;
use simulator::twin::Command;
use simulator::twin::heat::Heat;

/// Control cycle, s.
const CYCLE_S: f64 = 1e-3;
const CYCLE_NS: i64 = 1_000_000;
/// mm/min per mm/s.
const PER_MINUTE: f64 = 60.0;
/// Cycles for the ramp in, before anything is measured.
const RAMP_CYCLES: usize = 400;
/// Cycles until an offset is in force, and step of the set points told, mm, in a hard loop.
const HARD_DELAY: usize = 3;
const HARD_TOLD_MM: f64 = 1e-3;
/// The engine's ramp, s.
const RAMP_S: f64 = 0.2;
/// A growth goes on for so long without news, s; news come with every stretch of heat.
const LIVE_MAX_AGE_S: f64 = 1e6;

/// A growth of the model and the live value that it tells.
#[derive(Debug, Clone)]
struct Growth {
    thermal: Thermal,
    state: ThermalState,
    channel: usize,
}

/// How near to a workshop the loop is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Loop {
    /// Wide limits, set points as they are, an offset in force a cycle later.
    Kind,
    /// Limits as in `docs/explanation/dynamic.md`, set points told in steps of 1 um, an offset in force three cycles later.
    Hard,
}

/// An engine in the loop.
#[derive(Debug)]
pub(crate) struct Corrected {
    engine: Compensator,
    model: Model,
    growths: Vec<Growth>,
    sequence: u32,
    ns: i64,
    applied: AxisArray,
    /// Offsets on their way, the oldest first.
    under_way: VecDeque<AxisArray>,
    /// Step of the set points that the control tells, mm.
    told_mm: f64,
    /// X Y Z C of the twin among the axes of the wire.
    places: [Option<usize>; 4],
}

impl Corrected {
    /// An engine with the model of a file, compensating.
    pub(crate) fn new(text: &str, nature: Loop) -> Self {
        let file = parse_file("model.toml", text).unwrap();
        let model = Model::new(&file.spec).unwrap();
        let axes: Vec<AxisName> = model.axes().filter(|a| !a.spindle).map(|a| a.name).collect();
        let places = [AxisName::X, AxisName::Y, AxisName::Z, AxisName::C]
            .map(|wanted| axes.iter().position(|name| *name == wanted));
        let config = config(&axes, nature);
        let (late, told_mm) = match nature {
            Loop::Kind => (0, 0.0),
            Loop::Hard => (HARD_DELAY - 1, HARD_TOLD_MM),
        };
        let mut engine = Compensator::new(&config, &model).unwrap();
        let growths = file
            .growths_in_use()
            .filter_map(|thermal| {
                let channel = model.sensors().iter().position(|s| *s == thermal.name)?;
                Some(Growth { state: ThermalState::new(thermal), thermal: thermal.clone(), channel })
            })
            .collect();
        engine.on_link_up(MonoTime::ZERO);
        engine.on_command(MonoTime::ZERO, Order::Enable);
        Self {
            engine,
            model,
            growths,
            sequence: 0,
            ns: 0,
            applied: [0.0; MAX_AXES],
            under_way: VecDeque::from(vec![[0.0; MAX_AXES]; late]),
            told_mm,
            places,
        }
    }
}

impl Beside for Corrected {
    fn begin(&mut self, at: &Command) {
        for _ in 0..RAMP_CYCLES {
            self.step(at);
        }
    }

    fn tool(&mut self, length_mm: f64) {
        self.engine.on_tool([0.0, 0.0, -length_mm].into());
    }

    fn warm(&mut self, seconds: f64, heat: &Heat) {
        let now = MonoTime::from_ns(self.ns);
        for growth in &mut self.growths {
            let reading = |sensor: &str, quantity: Quantity| match quantity {
                Quantity::Speed => heat.spindle_rpm,
                Quantity::Temperature => {
                    let told = heat
                        .sensors()
                        .into_iter()
                        .find(|(name, _)| sensor.strip_prefix("temp_") == Some(name));
                    told.map_or(f64::NAN, |(_, value)| value)
                }
            };
            let readings: Vec<f64> =
                growth.thermal.inputs.iter().map(|i| reading(&i.sensor, i.quantity)).collect();
            growth.state.advance(&growth.thermal, seconds, &readings);
            self.engine.on_live(now, growth.channel, growth.state.growth(&growth.thermal).value);
        }
    }

    // the engine sees the set points, and what it answers is in force from the next cycle on
    fn step(&mut self, command: &Command) -> Command {
        self.sequence = self.sequence.wrapping_add(1);
        self.ns += CYCLE_NS;
        let mut commanded = [0.0; MAX_AXES];
        let mut feed = 0.0f64;
        for (place, set) in self.places.iter().zip(command.linear.iter().chain([&command.table])) {
            if let Some(slot) = place.and_then(|k| commanded.get_mut(k)) {
                *slot =
                    if self.told_mm > 0.0 { (set.q / self.told_mm).round() * self.told_mm } else { set.q };
            }
            feed = feed.hypot(set.v);
        }
        // the wire counts rotary axes in degrees
        if let Some(slot) = self.places[3].and_then(|k| commanded.get_mut(k)) {
            *slot = command.table.q.to_degrees();
        }
        let moving = if feed > 0.0 { MachineState::MOVING } else { 0 };
        let frame = Position {
            sequence: self.sequence,
            control_ns: self.ns,
            state: MachineState::from_bits(MachineState::HOMED | MachineState::ENABLED | moving),
            feed_mm_per_min: feed * PER_MINUTE,
            commanded,
            actual: commanded,
            applied: self.applied,
        };
        let in_force = self.applied;
        if let Some(output) = self.engine.on_position(MonoTime::from_ns(self.ns), &frame, &self.model) {
            self.under_way.push_back(self.engine.message(&output).offset);
            self.applied = self.under_way.pop_front().unwrap_or(in_force);
        }
        let mut with = *command;
        for (place, set) in self.places.iter().zip(with.linear.iter_mut()) {
            set.q += place.and_then(|k| in_force.get(k)).copied().unwrap_or(0.0);
        }
        with.table.q += self.places[3].and_then(|k| in_force.get(k)).copied().unwrap_or(0.0).to_radians();
        with
    }
}

/// Generous limits where it is asked what a correction can do; those of a workshop where it is asked what it does there.
fn config(axes: &[AxisName], nature: Loop) -> EngineConfig {
    let each = |linear: f64, rotary: f64| -> Vec<f64> {
        axes.iter().map(|a| if a.kind() == AxisKind::Linear { linear } else { rotary }).collect()
    };
    let limits = |size: &f64| AxisLimits {
        warning: *size,
        size: *size,
        stop: f64::INFINITY,
        rate: 100.0 * size,
        acceleration: 1e4 * size,
        step: f64::INFINITY,
    };
    // of 1 mm: 2 mm/s, 200 mm/s^2, steps of 4 um
    let workshop = |size: &f64| AxisLimits {
        rate: 2.0 * size,
        acceleration: 200.0 * size,
        step: 4e-3 * size,
        ..limits(size)
    };
    let sizes = each(1.0, 5e-3);
    EngineConfig {
        axes: axes.to_vec(),
        limits: match nature {
            Loop::Kind => sizes.iter().map(limits).collect(),
            Loop::Hard => sizes.iter().map(workshop).collect(),
        },
        cycle_s: CYCLE_S,
        limit_time: LimitTime::Control,
        ramp_s: RAMP_S,
        stale_s: 1.0,
        hold_s: 1.0,
        after_loss: AfterLoss::Latch,
        jump_limit: each(1000.0, 10.0),
        gain: 1.0,
        position_source: PositionSource::Commanded,
        out_of_travel: OutOfTravel::Hold,
        rest: RestOffset::Zero,
        reversal_deadband: each(0.001, 1e-5),
        read_back_tolerance: each(1e-6, 1e-6),
        read_back_cycles: 50,
        soft_limits: vec![[f64::NEG_INFINITY, f64::INFINITY]; axes.len()],
        lag: Lag::Measured,
        lag_uncertainty_cycles: 0.5,
        live_max_age_s: LIVE_MAX_AGE_S,
    }
}
