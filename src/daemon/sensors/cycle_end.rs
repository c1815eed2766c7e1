//! The cycle's end of live estimation: positions out, tables in, live values to the engine.

use std::sync::Arc;

use crossbeam_channel::{Receiver, Sender, bounded};

use super::super::clock::Clock;
use super::super::link_session::LinkSession;
use super::lock_step::{CycleLockStep, EstimatorLockStep, EstimatorTime, lock_step};
use volcomp_estimate::live::{LiveEvaluator, LiveTable};
use volcomp_model::SENSORS_MAX;
use volcomp_protocol::{AxisUnit, ControlHello, Position, Tool};
use volcomp_units::MonoTime;
use volcomp_units::axes::{AxisArray, AxisName, MAX_AXES};

/// Positions in flight: two seconds at 4 kHz.
const MOTIONS: usize = 8192;
/// Tables in flight.
const TABLES: usize = 4;

/// What the cycle tells the estimator. `Copy`: it crosses the queue as it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Motion {
    /// A link came up with these axes.
    Axes {
        /// In wire order.
        axes: [Option<AxisName>; MAX_AXES],
    },
    /// The link is gone.
    Down,
    /// A tool: its tip in M at home, mm.
    Tool([f64; 3]),
    /// A position frame; mm and deg, wire order.
    At {
        /// When it was received.
        now: MonoTime,
        /// When the control took it, on its own clock, ns.
        control_ns: i64,
        /// Commanded.
        commanded: AxisArray,
        /// Encoders, with the applied offset.
        actual: AxisArray,
    },
}

/// The cycle's end.
#[derive(Debug)]
pub struct LiveEnd {
    motions: Sender<Motion>,
    tables: Receiver<Arc<LiveTable>>,
    evaluator: LiveEvaluator,
    /// Wire index of X, Y, Z.
    linear: [Option<usize>; 3],
    /// Hash of the model in use.
    model: [u8; 32],
    lock_step: Option<CycleLockStep>,
    /// In lock step: the last value of each channel, and when its reading arrived.
    held: [Option<(f64, MonoTime)>; SENSORS_MAX],
}

/// The estimator's end.
#[derive(Debug)]
pub struct EstimatorEnd {
    /// What the cycle tells.
    pub motions: Receiver<Motion>,
    /// What it evaluates. Whoever sends a table keeps a copy until it is out of use, so that nothing is freed on the
    /// cycle.
    pub tables: Sender<Arc<LiveTable>>,
    /// Where the cycle waits: its time, and whom to tell.
    pub lock_step: Option<EstimatorLockStep>,
}

impl EstimatorEnd {
    /// The estimator's time; without lock step that of the daemon.
    pub(crate) fn time(&self, clock: Clock) -> EstimatorTime {
        self.lock_step.as_ref().map_or(EstimatorTime::Computer(clock), EstimatorLockStep::time)
    }
}

/// Both ends, the cycle waiting for the estimator; `model` is the hash of the model in use.
#[must_use]
pub fn live_ends_in_lock_step(model: [u8; 32]) -> (LiveEnd, EstimatorEnd) {
    let ((mut cycle, mut estimator), (waits, tells)) = (live_ends(model), lock_step());
    (cycle.lock_step, estimator.lock_step) = (Some(waits), Some(tells));
    (cycle, estimator)
}

/// Both ends; `model` is the hash of the model in use.
#[must_use]
pub fn live_ends(model: [u8; 32]) -> (LiveEnd, EstimatorEnd) {
    let (motion_sender, motions) = bounded(MOTIONS);
    let (tables, table_receiver) = bounded(TABLES);
    let cycle = LiveEnd {
        motions: motion_sender,
        tables: table_receiver,
        evaluator: LiveEvaluator::default(),
        linear: [None; 3],
        model,
        lock_step: None,
        held: [None; SENSORS_MAX],
    };
    (cycle, EstimatorEnd { motions, tables, lock_step: None })
}

impl LiveEnd {
    /// A link has come up.
    pub fn link_up(&mut self, hello: &ControlHello) {
        let mut axes = [None; MAX_AXES];
        for (slot, axis) in axes.iter_mut().zip(hello.used_axes()) {
            *slot = Some(axis.name);
        }
        self.linear = [AxisName::X, AxisName::Y, AxisName::Z].map(|name| {
            let used = hello.used_axes();
            used.iter().position(|axis| axis.name == name && axis.unit == AxisUnit::Millimetre)
        });
        self.held = [None; SENSORS_MAX];
        let _ = self.motions.try_send(Motion::Axes { axes });
        if let Some(lock_step) = &mut self.lock_step {
            lock_step.link_up();
        }
    }

    /// True where a frame waits for the estimator before it is answered.
    #[must_use]
    pub const fn is_in_lock_step(&self) -> bool {
        self.lock_step.is_some()
    }

    /// The link is gone.
    pub fn link_down(&mut self) {
        let _ = self.motions.try_send(Motion::Down);
    }

    /// Another tool.
    ///
    /// # Cycle   no allocation, no wait, no panic
    pub fn tool(&mut self, tool: &Tool) {
        let _ = self.motions.try_send(Motion::Tool(tool.tip));
    }

    /// Another model is in use.
    ///
    /// # Cycle   no allocation, no wait, no panic
    pub const fn model(&mut self, hash: [u8; 32]) {
        self.model = hash;
        self.held = [None; SENSORS_MAX];
    }

    /// What comes after the answer to a frame: its position goes out, live values for the next one come in. In lock step
    /// it comes before the answer, and the values are for this frame.
    ///
    /// # Cycle   no allocation, no panic, bounded time; no wait but in lock step with a simulated control
    pub fn after(&mut self, received: MonoTime, frame: &Position, session: &mut LinkSession) {
        let now = self.lock_step.as_mut().map_or(received, |lock_step| lock_step.frame(frame.control_ns));
        // a full queue costs the estimator a position, and nobody else anything
        let _ = self.motions.try_send(Motion::At {
            now,
            control_ns: frame.control_ns,
            commanded: frame.commanded,
            actual: frame.actual,
        });
        if let Some(lock_step) = &self.lock_step {
            lock_step.wait(now);
        }
        let at = self.linear.map(|k| k.map_or(0.0, |k| frame.commanded[k]));
        // no more than the queue holds, whatever comes in meanwhile
        for table in self.tables.try_iter().take(TABLES) {
            // the sender holds every table that is in use here
            drop(self.evaluator.swap(Some(table), at));
        }
        let Some(told) = self.evaluator.evaluate(now, &self.model, at) else { return };
        for (channel, held) in self.held.iter_mut().enumerate() {
            let new = (told.told >> channel & 1 == 1).then(|| (told.values[channel], told.heard[channel]));
            // the engine counts time by the computer: in lock step it is told again how old a value is by now
            let kept = if self.lock_step.is_some() { new.or(*held) } else { new };
            *held = kept;
            if let Some((value, heard)) = kept {
                let age_ns = now.ns.saturating_sub(heard.ns).max(0);
                session.live(MonoTime::from_ns(received.ns.saturating_sub(age_ns)), channel, value);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::{load, tap};
    use volcomp_config::model::parse;
    use volcomp_estimate::live::table::Source;
    use volcomp_model::Model;
    use volcomp_protocol::record::Entry;
    use volcomp_protocol::{Axis, MachineState, Name, PROTOCOL_VERSION};

    const MODEL: [u8; 32] = [7; 32];

    fn at(ms: i64) -> MonoTime {
        MonoTime::from_ns(ms * 1_000_000)
    }

    /// When the engine was told a live value of a reading that arrived 300 ms ago, in two frames 200 ms of the control
    /// apart; the sensor is excluded between them.
    fn told((mut cycle, estimator): (LiveEnd, EstimatorEnd), received: [i64; 2]) -> Vec<i64> {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/examples/vmc-850/machine.toml");
        let loaded = load(&file).expect("the example loads");
        let text = loaded.model.text + "[errors.exx.live]\nsensor = \"ram\"\nlimit-um = 50\n";
        let model = Model::new(&parse("model", &text).expect("valid")).expect("a model");
        let axes = &loaded.config.axes;
        let hello = ControlHello {
            version: PROTOCOL_VERSION,
            machine: Name::new(&loaded.config.machine),
            software: Name::new("test"),
            cycle_ns: 1_000_000,
            axis_count: u8::try_from(axes.len()).expect("few"),
            axes: core::array::from_fn(|k| Axis {
                name: axes[k.min(axes.len() - 1)].name,
                unit: AxisUnit::Millimetre,
            }),
        };
        let config = loaded.config.engine_config(&hello).expect("fits");
        let mut session = LinkSession::new(&config, Arc::new(model)).expect("an engine");
        let (tap, entries) = tap(100);
        session.record_to(tap, MonoTime::ZERO, &hello);
        let first = Source::Value { value: 0.01, heard: at(700) };
        let frames = [(0, at(1000), first), (1, at(1200), Source::None)];
        for ((sequence, made, source), received) in frames.into_iter().zip(received) {
            let mut sources = [Source::None; SENSORS_MAX];
            sources[0] = source;
            let table = Arc::new(LiveTable { model: MODEL, made, sources, maps: Vec::new() });
            estimator.tables.try_send(Arc::clone(&table)).expect("room");
            if let Some(lock_step) = &estimator.lock_step {
                lock_step.tell(MonoTime::from_ns(i64::MAX));
            }
            let frame = Position {
                sequence,
                control_ns: made.ns,
                state: MachineState::from_bits(0),
                feed_mm_per_min: 0.0,
                commanded: [0.0; MAX_AXES],
                actual: [0.0; MAX_AXES],
                applied: [0.0; MAX_AXES],
            };
            cycle.after(at(received), &frame, &mut session);
            session.record();
        }
        let live = |entry| match entry {
            Entry::Live { now, told: 1, values } if values[0] == 0.01 => Some(now.ns / 1_000_000),
            _ => None,
        };
        entries.try_iter().filter_map(live).collect()
    }

    #[test]
    fn a_live_value_counts_from_its_reading() {
        assert_eq!(told(live_ends(MODEL), [1000, 1200]), [700], "the engine holds it from there");
    }

    #[test]
    fn in_lock_step_a_live_value_ages_by_the_controls_time() {
        let (mut cycle, estimator) = live_ends_in_lock_step(MODEL);
        if let Some(lock_step) = &mut cycle.lock_step {
            // the estimator's time is that of the control from here on
            let _ = lock_step.frame(0);
        }
        // 200 ms of the control in 2 ms of the computer
        assert_eq!(told((cycle, estimator), [5000, 5002]), [4700, 4502]);
    }
}
