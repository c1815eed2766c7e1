//! What is recorded: five machines at work, each driven in a closed loop by a control in simulated time.

use std::fmt::Write as _;

use simulated_machine::motion::paths::{RotaryTilt, SPath, Tilt, s_path};
use volcomp_engine::Command;
use volcomp_protocol::record::Entry;
use volcomp_protocol::{MachineState, Position};

use crate::control::Control;
use crate::live_loop::LiveLoop;
use crate::machine::{Machine, hash_of, model_of};

/// A simulated recording.
#[derive(Debug)]
pub(crate) struct Simulated {
    pub(crate) machine: Machine,
    /// Texts of the models that the engine goes on with.
    pub(crate) more_models: Vec<String>,
    pub(crate) entries: Vec<Entry>,
}

/// Simulates a recording.
pub(crate) type Simulation = fn() -> Simulated;

/// Every recording by its name.
pub(crate) const CATALOGUE: [(&str, Simulation); 5] = [
    ("three-axes", three_axes),
    ("five-axes", five_axes),
    ("grinder", grinder),
    ("live-filter", live_filter),
    ("faults", faults),
];

/// A machining centre: ramp in, a circle, a line there and back, another tool, other gains, another model.
fn three_axes() -> Simulated {
    const PROGRAM: &str = "G21 G90 G64 G17\nG1 X320 F6000\nG2 X320 I-20 J0\nG1 X240 Y150 Z-230 F9000\nG1 X330 Y150\n\
                           G1 X235\nG0 Z-60\nG4 P0.2\nG0 X300 Y250 Z-220\nG1 Z-235 F2000\nG3 X300 I15 J0 F4000\nM30\n";
    let machine = Machine::example("vmc-850", &[("ramp-s = 2.0", "ramp-s = 0.5")], ["", ""]);
    let other = machine.model_text.replace("[-11.5, -5.5]", "[-8.5, -2.5]");
    assert_ne!(other, machine.model_text);
    let mut control = Control::new(&machine, PROGRAM, &[300.0, 200.0, -200.0], 3);
    control.run(2600);
    control.tool(2, [0.0, 0.0, -180.0]);
    control.run(400);
    control.command(Command::SetGain(0.5));
    control.run(400);
    control.command(Command::SetGain(1.0));
    control.run(500);
    let now = control.now();
    control.session.switch_model(now, model_of(&other), hash_of(&other)).expect("the same axes");
    control.run(700);
    control.command(Command::Disable);
    control.run(400);
    Simulated { machine, more_models: vec![other], entries: control.finish() }
}

/// A gantry with a two-axis head along an S with changing tilt.
fn five_axes() -> Simulated {
    let path = s_path(&SPath {
        centre_mm: [5000.0, 1500.0, -600.0],
        feed_mm_per_min: 5000.0,
        blocks: 200,
        rotary: Tilt::AndC(RotaryTilt::A),
        ..SPath::default()
    });
    let machine = Machine::example("gantry-5ax", &[("ramp-s = 5.0", "ramp-s = 1.0")], ["", ""]);
    let mut control = Control::new(&machine, &path, &[4895.0, 1505.0, -605.0, 0.0, -10.0], 4);
    control.ideal = true;
    control.run(2000);
    control.tool(7, [0.0, 0.0, -350.0]);
    control.run(1500);
    Simulated { machine, more_models: Vec::new(), entries: control.finish() }
}

/// A gear grinder: the workpiece turns, the head follows the flanks, the errors are looked up at the encoders.
fn grinder() -> Simulated {
    let mut program = String::from("G21 G90 G64\nG1 X121 Y80 F1500\n");
    for k in 1..=60_u32 {
        let phase = f64::from(k) * 0.4;
        let [x, y] = [120.0 + phase.cos(), 80.0 + 0.8 * phase.sin()];
        let [a, b] = [20.0 + 2.0 * f64::from(k), 3.0 * (0.5 * phase).sin()];
        // writing to a String cannot fail
        let _ = writeln!(program, "G1 X{x:.4} Y{y:.4} A{a:.3} B{b:.4}");
    }
    let engine = [("stale-ms = 10.0", "stale-ms = 10.0\nramp-s = 0.3")];
    let machine = Machine::example("grinder-xyba", &engine, ["", ""]);
    let mut control = Control::new(&machine, &program, &[20.0, 120.0, 80.0, 0.0], 2);
    control.run(4000);
    Simulated { machine, more_models: Vec::new(), entries: control.finish() }
}

/// A machining centre whose ram has moved since the survey: a tracker teaches a map, a scale says one live value and
/// falls silent, and the tracker is wrong for a while.
fn live_filter() -> Simulated {
    const SENSORS: &str = "\n[[map]]\nname = \"ram\"\nx-mm = [0, 425, 850]\ny-mm = [0, 500]\nz-mm = [-500, 0]\n\
                           [[sensor]]\nname = \"tracker\"\nkind = \"tool\"\nstd-um = 4\nlatency-ms = 8\njump-um = 400\n\
                           [[sensor]]\nname = \"scale\"\nkind = \"value\"\n";
    const LIVE: &str = "\n[errors.exz.live]\nsensor = \"ram.exz\"\nlimit-um = 50\n\
                        [errors.eyz.live]\nsensor = \"ram.eyz\"\nlimit-um = 50\n\
                        [errors.ezz.live]\nsensor = \"ram.ezz\"\nlimit-um = 50\n\
                        [errors.exx.live]\nsensor = \"scale\"\nlimit-um = 30\n";
    const PROGRAM: &str = "G21 G90 G64 G17\nG1 X500 Y300 Z-300 F6000\nG1 X200 Y150 Z-180\nG2 X200 I60 J0\n\
                           G1 X420 Y330 Z-350\nG1 X300 Y200 Z-200\nM30\n";
    let settings = [("cycle-ms = 1.0", "cycle-ms = 4.0"), ("ramp-s = 2.0", "ramp-s = 1.0")];
    let machine = Machine::example("vmc-850", &settings, [SENSORS, LIVE]);
    let mut control = Control::new(&machine, PROGRAM, &[300.0, 200.0, -200.0], 2);
    control.live = Some(LiveLoop::new(&machine, [10.0, 13.0], [14.0, 15.0]));
    control.run(4500);
    Simulated { machine, more_models: Vec::new(), entries: control.finish() }
}

/// A machining centre to which everything happens that a link and a control can do wrong.
fn faults() -> Simulated {
    const PROGRAM: &str = "G21 G90 G64 G17\nG1 X340 F6000\nG2 X340 I-40 J0\nG3 X340 I-40 J0\nG2 X340 I-40 J0\n\
                           G3 X340 I-40 J0\nM30\n";
    let settings = [("cycle-ms = 1.0", "cycle-ms = 2.0"), ("ramp-s = 2.0", "ramp-s = 0.3")];
    let machine = Machine::example("vmc-850", &settings, ["", ""]);
    let mut control = Control::new(&machine, PROGRAM, &[300.0, 200.0, -200.0], 3);
    control.ideal = true;
    let without = |bits: u16| {
        move |_: u32, frame: &mut Position| {
            frame.state = MachineState::from_bits(frame.state.bits & !bits);
        }
    };
    let with = |bits: u16| {
        move |_: u32, frame: &mut Position| {
            frame.state = MachineState::from_bits(frame.state.bits | bits);
        }
    };
    control.run(400);
    // frames are lost, for less and for more than the daemon waits
    control.lose(2);
    control.run(100);
    control.lose(60);
    control.run(300);
    // positions that cannot be right
    control.run_with(1, |_, frame| frame.commanded[0] = f64::NAN);
    control.run(100);
    control.run_with(1, |_, frame| frame.commanded[1] += 100.0);
    control.run(300);
    // the machine cannot move, or does not apply the offset
    control.run_with(60, without(MachineState::ENABLED));
    control.run(300);
    control.run_with(60, with(MachineState::ESTOP));
    control.run(300);
    control.run_with(40, without(MachineState::HOMED));
    control.run(300);
    control.run_with(30, with(MachineState::OFFSET_LIMITED));
    control.run(200);
    // somebody else writes the offset: latched, nothing is sent, the control ramps out
    control.run_with(30, |_, frame| frame.applied[2] += 0.05);
    control.run(300);
    control.new_link(20);
    control.run(100);
    control.command(Command::ClearFault);
    control.command(Command::Enable);
    control.run(300);
    // a read-back that is no number; on a new link one that the control cannot hold: latched, nothing is sent
    control.run_with(20, |_, frame| frame.applied[0] = f64::NAN);
    control.run(250);
    control.new_link(5);
    control.run_with(3, |_, frame| frame.applied[1] = 0.5);
    control.run(200);
    control.new_link(5);
    control.run(50);
    control.command(Command::ClearFault);
    control.command(Command::Enable);
    control.run(300);
    // positions are lost for longer than the offset is held: it ramps to zero, latched
    control.lose(300);
    control.run(100);
    control.command(Command::ClearFault);
    control.command(Command::Enable);
    control.run(300);
    control.command(Command::Stop);
    control.run(250);
    Simulated { machine, more_models: Vec::new(), entries: control.finish() }
}

/// A recording by its name.
pub(crate) fn simulate(name: &str) -> Simulated {
    let (_, simulation) =
        CATALOGUE.iter().find(|(known, _)| *known == name).expect("a recording of the catalogue");
    simulation()
}
