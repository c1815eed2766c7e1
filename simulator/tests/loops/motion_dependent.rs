//! Effects of motion and tool length, one kind per test: the machine has the effect, an addition states it, `volcomp model
//! extend` puts it into the nominal model, the daemon corrects it over TCP in lock step. The gap is measured before and after.
//!
//! Kind truth: the machine follows the law of the addition. Hard truth: another law (Dahl presliding, a sprung mass, a pure
//! delay in place of a first-order lag), parameters 10 % off, corrections three cycles late, commanded positions rounded to
//! 1 um, errors of position looked up at encoders that count in 0.5 um with noise, and axes that repeat to 0.3 um.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
#![expect(clippy::disallowed_methods, reason = "the test reads and writes files")]
#![allow(clippy::print_stderr, reason = "measured figures")]

use std::fmt::Write as _;
use std::path::Path;

use simulator::control::{ControlConfig, CycleRecord, OffsetConfig, OffsetLimits, Pacing};
use simulator::demo::programs::Programs;
use simulator::demo::shop::Shop;
use simulator::motion::{MachineAxes, MotionCycle, MotionSource, Trajectory};
use simulator::truth::TruthMachine;
use volcomp::model::axes::AxisArray;
use volcomp::protocol::Tool;

/// Tool tip and gauge point of the nominal model, mm.
const TIP_MM: [f64; 3] = [0.0, 0.0, -150.0];

/// One kind of effect.
struct Case {
    /// Keys of the axis entries X, Y, Z of the truth.
    axes: [&'static str; 3],
    /// Further tables of the truth.
    tables: &'static str,
    /// Effects of the addition.
    effects: String,
    /// Feed, mm/min.
    feed: u32,
    /// The tool in the spindle, where it is not that of the model.
    tip_mm: Option<[f64; 3]>,
    /// Corrections come three cycles late, commanded positions are rounded to 1 um, positions come from encoders.
    hard: bool,
    /// Dead band of reversals, um.
    dead_band_um: f64,
}

impl Case {
    fn new(axes: [&'static str; 3], effects: String) -> Self {
        Self { axes, tables: "", effects, feed: 2000, tip_mm: None, hard: false, dead_band_um: 1.0 }
    }

    /// The truth of the machine: nothing but the effect is wrong with it.
    fn truth(&self) -> String {
        let mut text = format!(
            "format = \"volcomp-truth/1\"\nmachine = \"bench\"\nchain = \"[w X' b Y Z t]\"\nseed = 1\n\
             [frame]\nworkpiece-origin-mm = [0, 0, 0]\ntool-tip-mm = {TIP_MM:?}\n{}\n",
            self.tables
        );
        let encoder = if self.hard {
            "encoder-step-um = 0.5\nencoder-noise-um = 0.1\nrepeatability-um = 0.3\nrepeatability-s = 3.0\n"
        } else {
            ""
        };
        for (name, keys) in ["X", "Y", "Z"].into_iter().zip(self.axes) {
            write!(text, "[[axes]]\nname = \"{name}\"\ntravel-mm = [-300, 300]\n{encoder}{keys}\n").unwrap();
        }
        text
    }

    fn addition(&self) -> String {
        format!("format = \"volcomp-addition/1\"\nmachine = \"bench\"\nsense = \"\"\n{}", self.effects)
    }
}

/// An effect of an addition, seen over circles of 20 mm at up to 100 mm/s.
fn effect(name: &str, subject: &str, values: &[f64], shape: &str) -> String {
    let names = "\"p\", ".repeat(values.len());
    format!(
        "[[effect]]\nname = \"{name}\"\nsubject = \"{subject}\"\nkind = \"machine\"\nprobability = 0.99\n\
         confounded-with = []\nparameter-names = [{names}]\nvalues = {values:?}\ncovariance = []\n[effect.valid]\n\
         x_mm = [-300, 300]\ny_mm = [-300, 300]\nz_mm = [-300, 300]\ntool_length_mm = [50, 300]\n\
         vx_mm_per_s = [-100, 100]\nvy_mm_per_s = [-100, 100]\nvz_mm_per_s = [-100, 100]\n\
         ax_mm_per_s2 = [-1000, 1000]\nay_mm_per_s2 = [-1000, 1000]\naz_mm_per_s2 = [-1000, 1000]\n\
         [effect.shape]\n{shape}\n"
    )
}

fn backlash(axis: &str, along: &str, width_um: f64, length_mm: f64) -> String {
    let name = if axis == along { "backlash" } else { "lateral-play" };
    let shape = format!(
        "form = \"backlash\"\naxis = \"{axis}\"\nalong = [\"{along}\"]\nlength-mm = {length_mm:?}\nslope = false"
    );
    effect(name, axis, &[width_um], &shape)
}

fn lag(name: &str, axes: &str, ms: f64) -> String {
    let subject = if name == "latency" { "" } else { "y" };
    effect(name, subject, &[ms], &format!("form = \"lag\"\naxes = {axes}\ntie-ms = 0.0"))
}

const MODEL: &str = "format = \"volcomp-model/1\"\nmachine = \"bench\"\nchain = \"[w X' b Y Z t]\"\n\
    [frame]\nworkpiece-origin-mm = [0, 0, 0]\ntool-tip-mm = [0, 0, -150]\ngauge-point-mm = [0, 0, 0]\n\
    [axes.x]\ntravel-mm = [-300, 300]\n[axes.y]\ntravel-mm = [-300, 300]\n[axes.z]\ntravel-mm = [-300, 300]\n";

fn machine_file(address: &str, case: &Case) -> String {
    let source = if case.hard { "actual" } else { "commanded" };
    let mut text = format!(
        "format = \"volcomp-machine/1\"\nmachine = \"bench\"\nmodel = \"better.toml\"\n[link]\naddress = \"{address}\"\n\
         [engine]\nstart = \"on-connect\"\nramp-s = 0.5\nstale-ms = 10000.0\nposition-source = \"{source}\"\n\
         [realtime]\npriority = 0\nlock-memory = false\n[status]\nsocket = \"\"\n[log]\ntarget = \"stderr\"\n"
    );
    for axis in ["x", "y", "z"] {
        write!(
            text,
            "[axes.{axis}]\nlimit-um = 600.0\nrate-um-per-s = 2000.0\nacceleration-um-per-s2 = 200000.0\nstep-um = 4.0\n\
             reversal-deadband-um = {:?}\n",
            case.dead_band_um
        )
        .unwrap();
    }
    text
}

/// Circles of 20 mm in both directions in XY and XZ, from a point that every axis has been led to.
fn program(feed: u32) -> String {
    format!(
        "G21 G90 G64 G17\n(SCORE OFF)\nG0 X10 Y-5 Z-5\nG0 X20 Y0 Z0\nF{feed}\nG3 X-20 Y0 I-20 J0\nG3 X20 Y0 I20 J0\n\
         (SCORE ON)\nG3 X-20 Y0 I-20 J0\nG3 X20 Y0 I20 J0\nG2 X-20 Y0 I-20 J0\nG2 X20 Y0 I20 J0\n\
         G18\nG3 X-20 Z0 I-20 K0\nG3 X20 Z0 I20 K0\n(SCORE OFF)\nM30\n"
    )
}

fn rms_um(machine: &TruthMachine, cycles: &[CycleRecord]) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for r in cycles {
        let nominal = machine.nominal(&r.commanded);
        for (actual, wanted) in r.sample.tip_mm.iter().zip(nominal.tip_mm) {
            sum += (1e3 * (actual - wanted)).powi(2);
            count += 1.0;
        }
    }
    f64::sqrt(sum / f64::max(count, 1.0))
}

fn shop(case: &Case) -> Shop {
    let mut machine = TruthMachine::from_toml(&case.truth()).unwrap();
    if let Some(tip) = case.tip_mm {
        machine.set_tool_tip_mm(tip);
    }
    let axes = MachineAxes::of(&machine).unwrap();
    let fast = OffsetLimits { size: 1.0, rate: 3.0, acceleration: 1000.0 };
    let config = ControlConfig {
        listen: ([127, 0, 0, 1], 0).into(),
        pacing: Pacing::lock_step(),
        tool: case.tip_mm.map(|tip_mm| Tool { number: 7, tip: tip_mm }),
        offset: OffsetConfig {
            linear: fast,
            delay_cycles: if case.hard { 3 } else { 1 },
            ..OffsetConfig::default()
        },
        ..ControlConfig::new("bench", axes)
    };
    Shop::with_control(machine, 1, config, &[0.0; 8]).unwrap()
}

/// A motion whose commanded positions are rounded to a step, mm; 0 leaves them as they are.
struct Rounded {
    motion: Trajectory,
    step: f64,
}

impl MotionSource for Rounded {
    fn start(&self) -> AxisArray {
        self.motion.start()
    }

    fn next_cycle(&mut self) -> Option<MotionCycle> {
        let mut cycle = self.motion.next_cycle()?;
        if self.step > 0.0 {
            for v in &mut cycle.commanded {
                *v = (*v / self.step).round() * self.step;
            }
        }
        Some(cycle)
    }

    fn rewind(&mut self) {
        self.motion.rewind();
    }
}

/// The gap without and with compensation, um RMS; the share that is removed.
fn gap(what: &str, case: &Case) -> f64 {
    let programs = Programs::at(env!("CARGO_BIN_EXE_cncsim"));
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let write = |name: &str, text: &str| std::fs::write(at(name), text).unwrap();
    write("nominal.toml", MODEL);
    write("addition.toml", &case.addition());
    let said = programs
        .volcomp(&[
            "model",
            "extend",
            "--model",
            &at("nominal.toml"),
            "--add",
            &at("addition.toml"),
            "--out",
            &at("better.toml"),
        ])
        .unwrap();
    assert!(!said.contains("not in the model"), "{said}");

    let text = program(case.feed);
    let run = |shop: &mut Shop| {
        let motion = shop.trajectory(&text).unwrap();
        let step = if case.hard { 1e-3 } else { 0.0 };
        shop.motion(Rounded { motion, step }).unwrap()
    };
    let before = rms_um(&shop(case).machine().clone(), &run(&mut shop(case)));
    let mut with = shop(case);
    write("machine.toml", &machine_file(&with.address(), case));
    programs.volcomp(&["check", &at("machine.toml")]).unwrap();
    let daemon = with
        .start_daemon(&programs, Path::new(&at("machine.toml")), Path::new(&at("log")))
        .unwrap_or_else(|e| panic!("{e:#}: {}", std::fs::read_to_string(at("log")).unwrap_or_default()));
    let cycles = run(&mut with);
    let after = rms_um(&shop(case).machine().clone(), &cycles);
    let is_limited = |r: &&CycleRecord| r.correction.is_some_and(|c| c.limited != 0);
    let limited = 100.0 * cycles.iter().filter(is_limited).count() as f64 / cycles.len() as f64;
    let free: Vec<CycleRecord> = cycles.iter().filter(|r| !is_limited(r)).copied().collect();
    let unlimited = rms_um(&shop(case).machine().clone(), &free);
    with.control().close();
    drop(daemon);
    let share = 1.0 - after / before;
    eprintln!(
        "{what}: {before:.2} -> {after:.2} um RMS, {:.0} % removed; limited in {limited:.1} % of the cycles, {unlimited:.2} um in the others",
        100.0 * share
    );
    assert!(before > 1.0, "{what}: the effect does not show: {before}");
    share
}

#[test]
fn backlash_is_removed_by_the_direction_of_command_and_offset() {
    let kind = gap(
        "backlash, kind",
        &Case::new(["backlash-um = 8", "backlash-um = 6", ""], {
            backlash("x", "x", 8.0, 0.0) + &backlash("y", "y", 6.0, 0.0)
        }),
    );
    let hard = Case {
        hard: true,
        ..Case::new(
            [
                "backlash-um = 2\nstructure = { wind-up-um = 6, wind-up-length-mm = 0.15 }",
                "structure = { wind-up-um = 6, wind-up-length-mm = 0.3 }",
                "",
            ],
            backlash("x", "x", 8.8, 0.1) + &backlash("y", "y", 5.4, 0.2),
        )
    };
    let hard = gap("backlash, hard", &hard);
    assert!(kind > 0.90 && hard > 0.65, "{kind} {hard}");
}

#[test]
fn lost_motion_is_removed_as_it_builds_up() {
    let half = "backlash-um = 4\nstructure = { wind-up-um = 4, wind-up-length-mm = 1.0 }";
    let kind = gap(
        "lost motion, kind",
        &Case::new([half, "", half], backlash("x", "x", 8.0, 1.0) + &backlash("z", "z", 8.0, 1.0)),
    );
    let all = "structure = { wind-up-um = 8, wind-up-length-mm = 0.8 }";
    let hard = Case {
        hard: true,
        ..Case::new([all, "", all], backlash("x", "x", 8.8, 1.0) + &backlash("z", "z", 7.2, 1.0))
    };
    let hard = gap("lost motion, hard", &hard);
    assert!(kind > 0.90 && hard > 0.60, "{kind} {hard}");
}

#[test]
fn lateral_play_is_removed_by_the_axis_across() {
    let kind = gap(
        "lateral play, kind",
        &Case::new(
            ["structure = { lateral-um = [0, 6, 3] }", "", ""],
            backlash("x", "y", -6.0, 0.0) + &backlash("x", "z", -3.0, 0.0),
        ),
    );
    let hard = Case {
        hard: true,
        ..Case::new(
            ["structure = { lateral-um = [0, 6, 3], wind-up-length-mm = 0.2 }", "", ""],
            backlash("x", "y", -6.6, 0.0) + &backlash("x", "z", -2.7, 0.0),
        )
    };
    let hard = gap("lateral play, hard", &hard);
    assert!(kind > 0.75 && hard > 0.50, "{kind} {hard}");
}

#[test]
fn a_friction_peak_is_removed_as_far_as_the_limits_allow() {
    let spike = |axis: &str, height: f64, rise_s: f64, fall_s: f64| {
        let shape = format!(
            "form = \"spike\"\naxis = \"{axis}\"\nrise-s = {rise_s}\nfall-s = {fall_s}\nslope = false"
        );
        effect("reversal-spike", axis, &[height], &shape)
    };
    let truth = "structure = { peak-um = 30, rise-ms = 10, fall-ms = 60 }";
    let kind = gap(
        "friction peak, kind",
        &Case::new([truth, truth, ""], {
            spike("x", -30.0, 0.010, 0.060) + &spike("y", -30.0, 0.010, 0.060)
        }),
    );
    let hard = Case {
        hard: true,
        ..Case::new([truth, truth, ""], spike("x", -33.0, 0.012, 0.055) + &spike("y", -27.0, 0.008, 0.070))
    };
    let hard = gap("friction peak, hard", &hard);
    // a control whose positions are exact needs no wide dead band, and the reversal is seen earlier
    let narrow = Case {
        dead_band_um: 0.1,
        ..Case::new([truth, truth, ""], spike("x", -30.0, 0.010, 0.060) + &spike("y", -30.0, 0.010, 0.060))
    };
    let narrow = gap("friction peak, kind, dead band 0.1 um", &narrow);
    assert!(kind > 0.40 && narrow > 0.50 && hard > 0.30, "{kind} {narrow} {hard}");
}

#[test]
fn a_delay_is_led_by_the_velocity() {
    let axes = "[\"x\", \"y\", \"z\"]";
    let truth = "servo = { delay-ms = 4 }";
    let kind = gap("latency, kind", &Case::new([truth; 3], lag("latency", axes, 4.0)));
    let truth = "servo = { delay-ms = 2, lag-ms = 2 }";
    let hard = Case { hard: true, ..Case::new([truth; 3], lag("latency", axes, 4.4)) };
    let hard = gap("latency, hard", &hard);
    assert!(kind > 0.93 && hard > 0.75, "{kind} {hard}");
}

#[test]
fn a_servo_that_lags_more_than_the_others_is_led_by_its_velocity() {
    let kind = gap(
        "servo mismatch, kind",
        &Case::new(["", "servo = { lag-ms = 1.5 }", ""], lag("servo-mismatch", "[\"y\"]", 1.5)),
    );
    let hard = Case {
        hard: true,
        ..Case::new(
            ["", "servo = { lag-ms = 2.5, feed-forward = 0.4 }", ""],
            lag("servo-mismatch", "[\"y\"]", 1.65),
        )
    };
    let hard = gap("servo mismatch, hard", &hard);
    assert!(kind > 0.95 && hard > 0.75, "{kind} {hard}");
}

#[test]
fn a_compliance_is_met_by_the_acceleration() {
    let inertial = |axis: &str, along: &str, value: f64| {
        let shape = format!("form = \"inertial\"\naxis = \"{axis}\"\nalong = \"{along}\"\nslope = false");
        effect("inertial", axis, &[value], &shape)
    };
    let stiff = "structure = { compliance-um-per-m-per-s2 = 40, frequency-hz = 60, damping = 0.7 }";
    let kind = Case {
        feed: 4000,
        ..Case::new([stiff, stiff, ""], inertial("x", "x", -40.0) + &inertial("y", "y", -40.0))
    };
    let kind = gap("compliance, kind", &kind);
    let soft = "structure = { compliance-um-per-m-per-s2 = 40, frequency-hz = 15, damping = 0.2 }";
    let hard = Case {
        hard: true,
        feed: 4000,
        ..Case::new([soft, soft, ""], inertial("x", "x", -44.0) + &inertial("y", "y", -36.0))
    };
    let hard = gap("compliance, hard", &hard);
    assert!(kind > 0.75 && hard > 0.55, "{kind} {hard}");
}

#[test]
fn a_tilt_under_acceleration_is_met_at_the_tool() {
    let tilt = |value: f64| {
        let lever = "lever = { axes = [true, true, true], home-mm = [0, 0, -150], tool = false }";
        let shape = format!("form = \"inertial-tilt\"\naxis = \"x\"\nabout = [\"b\"]\n{lever}");
        effect("inertial-cross", "x", &[value], &shape)
    };
    let truth = "structure = { tilt-arcsec-per-m-per-s2 = [0, 60, 0], frequency-hz = 60, damping = 0.7 }";
    let kind = Case { feed: 4000, ..Case::new([truth, "", ""], tilt(60.0)) };
    let kind = gap("tilt, kind", &kind);
    let truth = "structure = { tilt-arcsec-per-m-per-s2 = [0, 60, 0], frequency-hz = 15, damping = 0.2 }";
    let hard = Case { hard: true, feed: 4000, ..Case::new([truth, "", ""], tilt(66.0)) };
    let hard = gap("tilt, hard", &hard);
    assert!(kind > 0.90 && hard > 0.65, "{kind} {hard}");
}

#[test]
fn errors_of_the_tool_follow_the_tool_that_the_control_reports_or_the_model_states() {
    let tables = "[tool]\nlength-error-um-per-m = 150\nlean-arcsec = [12, -9]\n";
    let effects = |share: f64| {
        effect("tool-length", "", &[150.0 * share], "form = \"tool-length\"")
            + &effect("spindle-tilt", "", &[12.0 * share, -9.0 * share], "form = \"spindle-tilt\"")
    };
    let of_the_model = Case { tables, ..Case::new([""; 3], effects(1.0)) };
    let stated = gap("tool of the model, kind", &of_the_model);
    let long = Some([0.0, 0.0, -280.0]);
    let reported =
        gap("tool of the control, kind", &Case { tip_mm: long, tables, ..Case::new([""; 3], effects(1.0)) });
    let hard = Case { hard: true, tip_mm: long, tables, ..Case::new([""; 3], effects(0.9)) };
    let hard = gap("tool, hard", &hard);
    assert!(stated > 0.97 && reported > 0.97 && hard > 0.80, "{stated} {reported} {hard}");
}
