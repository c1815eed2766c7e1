//! A control in simulated time: a part program with jerk-limited profiles, servo lag, encoders, and offsets that take
//! effect some cycles after the position that they answer.

use std::collections::VecDeque;
use std::sync::Arc;

use crossbeam_channel::Receiver;
use simulated_machine::motion::gcode::interpret;
use simulated_machine::motion::{AxisSetup, Dynamics, MachineAxes, MotionCycle, MotionSource, Trajectory};
use volcomp_daemon::{LinkSession, Reaction, tap};
use volcomp_engine::Command;
use volcomp_protocol::record::Entry;
use volcomp_protocol::{MachineState, Message, Position, Tool};
use volcomp_units::axes::{AxisArray, AxisKind, AxisName, MAX_AXES};
use volcomp_units::{MonoTime, NS_PER_S, deg_from_rad};

use crate::live_loop::LiveLoop;
use crate::machine::Machine;

/// Room for the entries of one recording.
const ENTRIES: usize = 40_000;
/// Time constant of the position loop, s.
const SERVO_S: f64 = 0.004;
/// Steps of the encoders per mm or deg.
const ENCODER_STEPS: f64 = 1e5;
/// Cycles without an answer after which the control ramps its offset out.
const HOLD_CYCLES: u32 = 25;
/// Change of the offset per cycle in that ramp, mm or deg.
const RAMP_STEP: f64 = 2e-4;

/// Pseudo-random numbers of a fixed seed (SplitMix64).
#[derive(Debug, Clone)]
pub(crate) struct Noise(pub(crate) u64);

impl Noise {
    /// Symmetric about zero, between -1.5 and 1.5, standard deviation 0.5.
    pub(crate) fn next(&mut self) -> f64 {
        let mut uniform = || {
            self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
            let mut z = self.0;
            z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
            z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
            ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
        };
        uniform() + uniform() + uniform() - 1.5
    }
}

/// The control with the daemon's cycle on its link.
#[derive(Debug)]
pub(crate) struct Control {
    pub(crate) session: LinkSession,
    pub(crate) live: Option<LiveLoop>,
    /// The axes follow without a lag, and the encoders have no noise: a recording takes fewer bytes.
    pub(crate) ideal: bool,
    entries: Receiver<Entry>,
    trajectory: Trajectory,
    motion: MotionCycle,
    axes: usize,
    cycle_ns: i64,
    cycle: u32,
    /// Offsets on their way to the axes, the next one first.
    pending: VecDeque<AxisArray>,
    unanswered: u32,
    /// Where the axes are.
    servo: AxisArray,
    noise: Noise,
}

impl Control {
    /// A control at `start` (mm and deg, wire order) that runs `program`; an offset takes effect `lag` cycles after
    /// the position that it answers. The link is up, compensation is enabled.
    pub(crate) fn new(machine: &Machine, program: &str, start: &[f64], lag: usize) -> Self {
        let mut at = [0.0; MAX_AXES];
        at[..start.len()].copy_from_slice(start);
        let axes = MachineAxes::new(machine.axis_names().map(|name| setup(machine, name)).collect())
            .expect("axes of a control");
        let cycle_s = machine.config.link.cycle_s;
        let segments = interpret(program, &axes, at).unwrap_or_else(|error| panic!("{error}")).segments;
        let trajectory = Trajectory::new(at, &segments, &axes, &Dynamics::default(), cycle_s)
            .expect("limits of a control");
        let hello = machine.hello();
        let config = machine.config.engine_config(&hello).expect("the hello fits the machine file");
        let mut session = LinkSession::new(&config, Arc::clone(&machine.model)).expect("an engine");
        let (tap, entries) = tap(ENTRIES);
        session.record_to(tap, MonoTime::ZERO, &hello);
        session.link_up(MonoTime::ZERO);
        session.command(MonoTime::ZERO, Command::Enable);
        Self {
            session,
            live: None,
            ideal: false,
            entries,
            trajectory,
            motion: MotionCycle { commanded: at, ..MotionCycle::default() },
            axes: start.len(),
            cycle_ns: (cycle_s * NS_PER_S).round() as i64,
            cycle: 0,
            pending: VecDeque::from(vec![[0.0; MAX_AXES]; lag]),
            unanswered: 0,
            servo: at,
            noise: Noise(1),
        }
    }

    /// When the daemon receives the frame of this cycle; the frames jitter by up to 16 us.
    pub(crate) fn now(&self) -> MonoTime {
        MonoTime::from_ns(i64::from(self.cycle) * self.cycle_ns + i64::from(self.cycle % 17) * 1000)
    }

    pub(crate) fn command(&mut self, command: Command) {
        self.session.command(self.now(), command);
    }

    /// A tool whose tip is at `tip` in M, mm.
    pub(crate) fn tool(&mut self, number: u32, tip: [f64; 3]) {
        if let Some(live) = &mut self.live {
            live.tool(&Tool { number, tip });
        }
        assert_eq!(self.session.handle(self.now(), &Message::Tool(Tool { number, tip })), Reaction::Nothing);
    }

    /// So many ordinary cycles.
    pub(crate) fn run(&mut self, cycles: u32) {
        self.run_with(cycles, |_, _| ());
    }

    /// So many cycles whose frames `change` falsifies; it is given the number of the cycle from 0.
    pub(crate) fn run_with(&mut self, cycles: u32, mut change: impl FnMut(u32, &mut Position)) {
        for k in 0..cycles {
            let mut frame = self.next_frame();
            change(k, &mut frame);
            let now = self.now();
            let answer = match self.session.handle(now, &Message::Position(frame)) {
                Reaction::Answer(correction) => Some(correction.offset),
                _ => None,
            };
            self.session.record();
            self.take(answer);
            if let Some(live) = &mut self.live {
                live.after(now, &frame, &mut self.session);
            }
        }
    }

    /// So many cycles whose frames are lost on the way to the daemon.
    pub(crate) fn lose(&mut self, cycles: u32) {
        for _ in 0..cycles {
            let _ = self.next_frame();
            let now = self.now();
            let mut answer = None;
            while let Some(due) = self.session.next_deadline().filter(|due| *due <= now) {
                let Some(correction) = self.session.deadline(due) else { break };
                answer = Some(correction.offset);
                self.session.record();
            }
            self.session.record();
            self.take(answer);
        }
    }

    /// The link ends, and the next one begins some cycles later.
    pub(crate) fn new_link(&mut self, cycles: u32) {
        self.session.link_down(self.now());
        for _ in 0..cycles {
            let _ = self.next_frame();
            self.take(None);
        }
        self.session.link_up(self.now());
    }

    /// Everything that was recorded.
    pub(crate) fn finish(mut self) -> Vec<Entry> {
        self.session.record();
        drop(self.session);
        let entries: Vec<Entry> = self.entries.try_iter().collect();
        assert!(entries.len() < ENTRIES, "more entries than the queue holds");
        entries
    }

    /// An answer, or none, takes its place among the offsets on their way.
    fn take(&mut self, answer: Option<AxisArray>) {
        self.unanswered = if answer.is_some() { 0 } else { self.unanswered + 1 };
        let last = self.pending.back().copied().unwrap_or_default();
        let ramped = last.map(|offset| offset - offset.clamp(-RAMP_STEP, RAMP_STEP));
        self.pending.push_back(match answer {
            Some(offset) => offset,
            None if self.unanswered > HOLD_CYCLES => ramped,
            None => last,
        });
    }

    fn next_frame(&mut self) -> Position {
        self.cycle += 1;
        match self.trajectory.next_cycle() {
            Some(motion) => self.motion = motion,
            None => self.motion = MotionCycle { commanded: self.motion.commanded, ..MotionCycle::default() },
        }
        let commanded = self.motion.commanded;
        let applied = self.pending.pop_front().expect("one per cycle");
        let share = (self.cycle_ns as f64 / NS_PER_S / SERVO_S).min(1.0);
        let mut actual = [0.0; MAX_AXES];
        for k in 0..self.axes {
            self.servo[k] += (commanded[k] + applied[k] - self.servo[k]) * share;
            actual[k] = if self.ideal {
                commanded[k] + applied[k]
            } else {
                (self.servo[k] * ENCODER_STEPS + self.noise.next()).round() / ENCODER_STEPS
            };
        }
        let ramping = self.unanswered > HOLD_CYCLES && applied != [0.0; MAX_AXES];
        let mut bits = MachineState::HOMED | MachineState::ENABLED;
        bits |= if self.motion.moving { MachineState::MOVING } else { 0 };
        bits |= if ramping { MachineState::OFFSET_RAMPING_OUT } else { 0 };
        Position {
            sequence: self.cycle,
            control_ns: i64::from(self.cycle) * self.cycle_ns,
            state: MachineState::from_bits(bits),
            feed_mm_per_min: self.motion.feed_mm_per_min,
            commanded,
            actual,
            applied,
        }
    }
}

/// An axis with the travel of the model.
fn setup(machine: &Machine, name: AxisName) -> AxisSetup {
    let joint = machine.model.axes().position(|axis| axis.name == name).expect("an axis of the model");
    let travel = machine.model.travel(joint).expect("a travel in the model");
    AxisSetup::new(
        name,
        match name.kind() {
            AxisKind::Linear => travel,
            AxisKind::Rotary => travel.map(|end| deg_from_rad(end).round()),
        },
    )
}
