//! Benchmark of one cycle on this computer: frame in to frame out, without socket.
//!
//! The daemon's own frame reader, [`LinkSession`] and frame writer, fed with frames of an invented tour through the
//! travel of the model and, where the model names sensors, with a live value of each in every cycle. As in the daemon,
//! live values for the next frame and the record of this one come behind the answer; they are measured apart. What the
//! two readings of the clock cost is measured the same way and taken off. Caches are warm, as in a daemon that cycles
//! back to back; a daemon that sleeps between cycles takes longer (`volcomp status` shows its compute time).

use std::time::Instant;

use hdrhistogram::Histogram;

use super::link_session::{LinkSession, Reaction};
use super::load::Loaded;
use super::realtime;
use super::recorder::tap;
use super::status::RealtimeStatus;
use volcomp_config::machine::HelloMismatch;
use volcomp_engine::{Command, EngineError};
use volcomp_model::Model;
use volcomp_protocol::{
    Axis, ControlHello, CorrectionState, FrameReader, MAX_FRAME, MachineState, Message, Name,
    PROTOCOL_VERSION, Position, encode,
};
use volcomp_units::axes::{AxisArray, MAX_AXES};
use volcomp_units::{MonoTime, NS_PER_S};

/// Live values that are fed, mm or rad: a fraction of what models believe.
const LIVE: f64 = 1e-6;
/// Longest time that the histograms hold, ns.
const LONGEST_NS: u64 = 60_000_000_000;
/// Room for the entries of a cycle.
const ENTRIES: usize = 64;
/// Cycles of one block; a computer is left in peace for that long, where it is at all.
const BLOCK: u64 = 1000;
/// Share of the blocks that counts as calm.
const CALM: f64 = 0.1;
/// Cycles before the first that counts, in ramps.
const SETTLE_RAMPS: f64 = 2.0;

/// What a cycle costs.
#[derive(Debug, Clone)]
pub struct SelfBenchmark {
    /// Axes of the model, the spindle not among them.
    pub axes: usize,
    /// Sensors whose live values the model adds.
    pub sensors: usize,
    /// From a frame's bytes in hand to the answer's bytes in hand, ns; the clock's own time taken off.
    pub compute_ns: Histogram<u64>,
    /// What the cycle does behind its answer: live values for the next frame, the record handed to its queue, ns.
    pub behind_ns: Histogram<u64>,
    /// 99th percentile of the calmest tenth of the blocks of a thousand cycles, ns: what a cycle costs where neighbours on
    /// the same core and the host leave it alone. 0 with less than one block.
    pub calm_p99_ns: u64,
    /// Two readings of the clock with nothing in between, median, ns.
    pub clock_ns: u64,
    /// Real-time settings of the thread that measured.
    pub realtime: RealtimeStatus,
}

/// Why the benchmark cannot run.
#[derive(Debug, thiserror::Error)]
pub enum SelfBenchmarkError {
    /// The machine file and its own axes do not fit.
    #[error(transparent)]
    Hello(#[from] HelloMismatch),
    /// The engine refuses the configuration.
    #[error(transparent)]
    Engine(#[from] EngineError),
    /// The engine did not compensate, so its time would mean nothing.
    #[error("internal: the engine is {0:?} where it should be active")]
    NotActive(CorrectionState),
    /// The histogram cannot be made.
    #[error("internal: histogram: {0}")]
    Histogram(#[from] hdrhistogram::CreationError),
    /// The measuring thread panicked.
    #[error("internal: the measuring thread panicked")]
    Panicked,
}

/// Measures `cycles` cycles of an active engine, on a thread with the real-time settings of the machine file.
///
/// # Errors
/// See [`SelfBenchmarkError`].
pub fn run_self_benchmark(loaded: &Loaded, cycles: u64) -> Result<SelfBenchmark, SelfBenchmarkError> {
    std::thread::scope(|scope| {
        scope.spawn(|| on_this_thread(loaded, cycles)).join().unwrap_or(Err(SelfBenchmarkError::Panicked))
    })
}

fn on_this_thread(loaded: &Loaded, cycles: u64) -> Result<SelfBenchmark, SelfBenchmarkError> {
    let realtime = realtime::apply(&loaded.config.realtime).status();
    let hello = hello(loaded);
    let config = loaded.config.engine_config(&hello)?;
    let mut session = LinkSession::new(&config, loaded.model.model.clone())?;
    let (tap, entries) = tap(ENTRIES);
    session.record_to(tap, MonoTime::ZERO, &hello);
    session.link_up(MonoTime::ZERO);
    session.command(MonoTime::ZERO, Command::Enable);
    let sensors = loaded.model.model.sensors().len();
    let mut stage = Stage {
        session,
        sensors,
        reader: FrameReader::default(),
        out: [0; MAX_FRAME],
        applied: [0.0; MAX_AXES],
    };

    let clock_ns = clock_cost(cycles.clamp(1_000, 100_000))?;
    let settle = (SETTLE_RAMPS * config.ramp_s / config.cycle_s).ceil() as u64 + 100;
    let mut compute_ns = Histogram::new_with_bounds(1, LONGEST_NS, 3)?;
    let mut behind_ns = Histogram::new_with_bounds(1, LONGEST_NS, 3)?;
    let mut blocks = Blocks::new()?;
    let mut state = CorrectionState::Off;
    for cycle in 1..=settle + cycles {
        let time_s = cycle as f64 * config.cycle_s;
        let frame = position(&loaded.model.model, &hello, cycle, time_s, &stage.applied);
        let live = LIVE * (cycle as f64 * 0.01).sin();
        let took = stage.cycle(&frame, MonoTime::ZERO.plus_seconds(time_s), live);
        if cycle > settle {
            let ns = took.ns.saturating_sub(clock_ns).max(1);
            compute_ns.saturating_record(ns);
            behind_ns.saturating_record(took.behind_ns.saturating_sub(clock_ns).max(1));
            blocks.record(ns);
        }
        state = took.state.unwrap_or(state);
        // the daemon's recorder does this elsewhere
        while entries.try_recv().is_ok() {}
    }
    if state != CorrectionState::Active {
        return Err(SelfBenchmarkError::NotActive(state));
    }
    Ok(SelfBenchmark {
        axes: usize::from(hello.axis_count),
        sensors,
        compute_ns,
        behind_ns,
        calm_p99_ns: blocks.calm(),
        clock_ns,
        realtime,
    })
}

/// The 99th percentiles of the blocks.
struct Blocks {
    block: Histogram<u64>,
    p99_ns: Histogram<u64>,
}

impl Blocks {
    fn new() -> Result<Self, hdrhistogram::CreationError> {
        let empty = || Histogram::new_with_bounds(1, LONGEST_NS, 3);
        Ok(Self { block: empty()?, p99_ns: empty()? })
    }

    fn record(&mut self, ns: u64) {
        self.block.saturating_record(ns);
        if self.block.len() == BLOCK {
            self.p99_ns.saturating_record(self.block.value_at_quantile(0.99));
            self.block.reset();
        }
    }

    fn calm(&self) -> u64 {
        self.p99_ns.value_at_quantile(CALM)
    }
}

/// The daemon's cycle without its socket.
struct Stage {
    session: LinkSession,
    sensors: usize,
    reader: FrameReader,
    out: [u8; MAX_FRAME],
    applied: AxisArray,
}

struct Took {
    ns: u64,
    behind_ns: u64,
    state: Option<CorrectionState>,
}

impl Stage {
    fn cycle(&mut self, frame: &Message, now: MonoTime, live: f64) -> Took {
        let mut bytes = [0; MAX_FRAME];
        let length = encode(frame, &mut bytes);
        self.reader.space()[..length].copy_from_slice(&bytes[..length]);
        let start = Instant::now();
        self.reader.advance(length);
        let mut answer = None;
        if let Ok(Some(message)) = self.reader.next()
            && let Reaction::Answer(correction) = self.session.handle(now, &message)
        {
            let length = encode(&Message::Correction(correction), &mut self.out);
            core::hint::black_box(&self.out[..length]);
            answer = Some(correction);
        }
        let ns = since(start);
        let start = Instant::now();
        self.session.record();
        for channel in 0..self.sensors {
            self.session.live(now, channel, live);
        }
        let behind_ns = since(start);
        if let Some(correction) = answer {
            self.applied = correction.offset;
        }
        Took { ns, behind_ns, state: answer.map(|a| a.state) }
    }
}

fn since(start: Instant) -> u64 {
    u64::try_from(start.elapsed().as_nanos()).unwrap_or(u64::MAX)
}

/// Median time between two readings of the clock, ns.
fn clock_cost(readings: u64) -> Result<u64, hdrhistogram::CreationError> {
    let mut times: Histogram<u64> = Histogram::new_with_bounds(1, LONGEST_NS, 3)?;
    for _ in 0..readings {
        let start = Instant::now();
        times.saturating_record(since(start).max(1));
    }
    Ok(times.value_at_quantile(0.5))
}

/// A control with the axes of the model, in its order.
fn hello(loaded: &Loaded) -> ControlHello {
    let axes: Vec<Axis> =
        loaded.model.model.axes().filter(|a| !a.spindle).map(|a| Axis::new(a.name)).collect();
    let last = axes.len().saturating_sub(1);
    let fallback = Axis::new(volcomp_units::axes::AxisName::X);
    ControlHello {
        version: PROTOCOL_VERSION,
        machine: Name::new(&loaded.config.machine),
        software: Name::new("rehearsal"),
        cycle_ns: (loaded.config.link.cycle_s * NS_PER_S).round() as u64,
        axis_count: u8::try_from(axes.len()).unwrap_or(u8::MAX),
        axes: core::array::from_fn(|k| axes.get(k.min(last)).copied().unwrap_or(fallback)),
    }
}

/// Fastest that an axis goes on its tour: mm/s and rad/s.
const TOUR_SPEED: [f64; 2] = [200.0, 0.35];

/// Where the axes are at a time: a tour through nine tenths of the travel at speeds of cutting, begun off the middle,
/// where many rotary axes have their singular place.
fn position(model: &Model, hello: &ControlHello, cycle: u64, time_s: f64, applied: &AxisArray) -> Message {
    let mut commanded = [0.0; MAX_AXES];
    let joints = model.axes().enumerate().filter(|(_, a)| !a.spindle);
    for (k, (joint, axis)) in joints.enumerate().take(usize::from(hello.axis_count)) {
        // without a travel in the model any will do
        let [low, high] = model.travel(joint).unwrap_or([0.0, 1.0]);
        let fastest = TOUR_SPEED[usize::from(axis.name.kind().is_rotary())];
        let rate = (fastest / (0.45 * (high - low))).min(1.0 / (1.0 + 0.37 * k as f64));
        let phase = 0.6 + k as f64 + rate * time_s;
        let at = low + (high - low) * (0.5 + 0.45 * phase.sin());
        commanded[k] = axis.name.kind().position_out(at);
    }
    Message::Position(Position {
        sequence: u32::try_from(cycle % (1 << 32)).unwrap_or_default(),
        control_ns: (time_s * NS_PER_S) as i64,
        state: MachineState::from_bits(MachineState::HOMED | MachineState::ENABLED | MachineState::MOVING),
        feed_mm_per_min: 1000.0,
        commanded,
        actual: commanded,
        applied: *applied,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn calm_is_the_calmest_tenth_of_the_blocks() {
        let mut blocks = Blocks::new().unwrap();
        assert_eq!(blocks.calm(), 0, "less than one block");
        for block in 0..10 {
            // one calm block among ten, and it has its own slow cycles
            let ns = if block == 4 { 700 } else { 1400 };
            for cycle in 0..BLOCK {
                blocks.record(if cycle % 50 == 0 { ns + 100 } else { ns });
            }
        }
        let calm = blocks.calm() as f64;
        assert!((calm - 800.0).abs() < 2.0, "{calm}");
    }
}
