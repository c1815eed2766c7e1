//! LinuxCNC as a machine whose errors nobody knows: measured, diagnosed, corrected and measured again.
//!
//! Between motor command and tool tip stands `withheld/withheld_machine.comp` with errors drawn from a seed. volcompd
//! records a part program in LinuxCNC through the bridge; an instrument reads the tip at its stops. The diagnosis sees that
//! session and an ideal model. Its addition becomes the model with which volcompd corrects the same program.

#[path = "withheld/errors.rs"]
mod errors;
#[path = "withheld/program.rs"]
mod program;
#[path = "withheld/session.rs"]
mod session;

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

use errors::{Truth, Withheld};
use program::Program;
use serde_json::Value;
use session::{Recording, Session};

use crate::control::{Cnc, Wiring};
use crate::daemon::{Daemon, program};
use crate::namespaces::{in_namespaces, must_hold, run};

/// Draws another machine; the nightly run sets a new one every time.
const SEED: &str = "VOLCOMP_WITHHELD_SEED";
/// Folder that keeps session, report and model of the run.
const KEPT: &str = "VOLCOMP_WITHHELD_OUT";
const USUAL_SEED: u64 = 24;
const PROGRAM_AT_MOST: Duration = Duration::from_secs(900);
/// What the shrink may stay below the lower end of its forecast: the stops of the second passage are read anew, by an
/// instrument mounted anew.
const SHRINK_ALLOWANCE: f64 = 0.02;
/// Where the second diagnosis still sees a gap, its largest share in the first.
const GAP_LEFT: f64 = 0.15;
/// The linear scale stands behind the lost motion and shows it to LinuxCNC: within the dead travel at a stop.
const FEEDBACK_UM: f64 = 0.05;

/// What the builder of the machine states: chain and travels, and no errors.
const NOMINAL: &str = r#"format = "volcomp-model/1"
machine = "linuxcnc-mill"
chain = "[w b X Y Z t]"

[axes.x]
travel-mm = [-250, 250]

[axes.y]
travel-mm = [-250, 250]

[axes.z]
travel-mm = [-200, 200]
"#;

fn volcomp(arguments: &[&str]) -> String {
    run(&program("volcomp").display().to_string(), arguments)
}

fn text(path: &Path) -> String {
    path.display().to_string()
}

fn json(text: &str) -> Value {
    serde_json::from_str(text).expect("JSON")
}

/// Puts the withheld machine in the place of the plant; the trace records the tip in place of the feedback.
fn replace_machine(sim: &Path, wiring: Wiring, withheld: &Withheld) {
    let plant = match wiring {
        Wiring::ExternalOffsets => "plant-eoffset.hal",
        Wiring::Injection => "plant-inject.hal",
    };
    for name in ["machine.hal", plant, "record.hal"] {
        let file = sim.join(name);
        let mut hal = fs::read_to_string(&file).expect("HAL file");
        hal = hal.replace("volcomp_plant", "withheld_machine").replace("volcomp-plant", "withheld-machine");
        if name == "record.hal" {
            for (joint, axis) in ["x", "y", "z"].iter().enumerate() {
                hal = hal.replace(
                    &format!("net volcomp-feedback-{joint} =>"),
                    &format!("net tool-{axis} withheld-machine.tool-{axis} =>"),
                );
            }
            hal.push_str(&withheld.hal());
        }
        fs::write(file, hal).expect("HAL file");
    }
}

/// The machine, the files of the run, and the program that measures.
struct Bench {
    cnc: Cnc,
    wiring: Wiring,
    dir: PathBuf,
    program: Program,
    seed: u64,
}

impl Bench {
    /// Runs the program with volcompd on `model`, correcting or not, and reads the instrument. `number` is that of the
    /// measurement.
    fn measure(&mut self, model: &Path, correcting: bool, number: u32) -> Session {
        let recordings = self.dir.join(format!("recordings-{number}"));
        let daemon = Daemon::start_with(self.wiring, model, |config| {
            let config = if correcting { config } else { config.replace("start = \"on-connect\"", "") };
            format!("{config}\n[recording]\ndirectory = \"{}\"\n", recordings.display())
        });
        self.cnc.wait_for("connected", |cnc| cnc.pin("volcomp.connected") == "TRUE");
        daemon.wait_for_state(if correcting { "active" } else { "off" });
        let mark = i32::try_from(number).expect("a small number");
        self.cnc.mark(mark);
        self.cnc.run_program(&self.program.text, PROGRAM_AT_MOST);
        self.cnc.mark(0);
        daemon.wait_for_state(if correcting { "active" } else { "off" });
        let mut daemon = daemon;
        daemon.stop();
        let mut files: Vec<String> =
            fs::read_dir(&recordings).expect("recordings").flatten().map(|f| text(&f.path())).collect();
        files.sort();
        let export = text(&self.dir.join(format!("recording-{number}.csv")));
        let mut arguments: Vec<&str> = vec!["export"];
        arguments.extend(files.iter().map(String::as_str));
        arguments.extend(["--format", "csv", "--out", &export]);
        volcomp(&arguments);
        let recording = Recording::parse(&fs::read_to_string(&export).expect("export"));
        fs::remove_file(&export).expect("removed");
        let trace = self.cnc.trace().moving(mark);
        let seed = self.seed.wrapping_mul(1000) + u64::from(number);
        let session = Session::take(&trace, &recording, &self.program.targets, seed);
        println!(
            "measurement {number}: {} cycles recorded by volcompd of {} in motion, {} readings, RMS {:.2} um",
            recording.cycles(),
            trace.rows.len(),
            self.program.targets.len(),
            session.rms_um()
        );
        session
    }

    fn diagnose(&self, model: &Path, session: &Session, number: u32) -> (PathBuf, Value) {
        let data = self.dir.join(format!("session-{number}.csv"));
        fs::write(&data, &session.csv).expect("session");
        let out = self.dir.join(format!("diagnosis-{number}"));
        volcomp(&["diagnose", "--model", &text(model), "--data", &text(&data), "--out", &text(&out)]);
        let report = json(&fs::read_to_string(out.join("report.json")).expect("report"));
        println!("diagnosis {number}: {}, gap {}", report["verdict"], report["gap"]);
        for cause in report["causes"].as_array().expect("causes") {
            println!(
                "  {} p {:.2} declared {} confounded {} parameters {}",
                label(cause),
                number_of(&cause["probability"]),
                cause["declared"],
                cause["confounded_with"],
                shown(&cause["parameters"])
            );
        }
        (out, report)
    }
}

fn number_of(value: &Value) -> f64 {
    value.as_f64().expect("a number")
}

fn label(cause: &Value) -> String {
    let (effect, subject) = (&cause["effect"], &cause["subject"]);
    match (effect.as_str().expect("effect"), subject.as_str().unwrap_or_default()) {
        (effect, "") => effect.to_owned(),
        (effect, subject) => format!("{effect}:{subject}"),
    }
}

/// The first few parameters.
fn shown(parameters: &Value) -> String {
    let parameters = parameters.as_object().expect("parameters");
    let one = |(name, p): (&String, &Value)| {
        format!("{name} {:.2} ± {:.2}", number_of(&p["value"]), number_of(&p["std"]))
    };
    parameters.iter().take(3).map(one).collect::<Vec<_>>().join(", ")
}

/// Whether a cause states an effect: by its own label, or by one that the report names as the same answer.
fn states(cause: &Value, wanted: &str) -> bool {
    let named = |key: &str| cause[key].as_array().is_some_and(|l| l.iter().any(|v| v == wanted));
    label(cause) == wanted || named("confounded_with") || named("re_expression_of")
}

/// Every truth is declared and nothing else is.
fn judge(report: &Value, truths: &[Truth]) -> Vec<String> {
    let causes = report["causes"].as_array().expect("causes");
    let declared: Vec<&Value> = causes.iter().filter(|c| c["declared"] == true).collect();
    let mut wrong = Vec::new();
    for truth in truths {
        let found = declared.iter().find(|c| states(c, &truth.label));
        println!(
            "withheld: {} of {}: {}",
            truth.label,
            truth.size,
            found.map_or("not declared".to_owned(), |c| label(c))
        );
        if found.is_none() {
            wrong.push(format!("{} is not declared", truth.label));
        }
    }
    for cause in declared {
        if !truths.iter().any(|t| states(cause, &t.label)) {
            wrong.push(format!("{} is declared and not there", label(cause)));
        }
    }
    wrong
}

/// Measured, diagnosed, corrected, measured again; the judgement comes last and lists everything that does not hold.
fn closed_loop(wiring: Wiring) {
    let seed = std::env::var(SEED).map_or(USUAL_SEED, |s| s.parse().expect("a seed"));
    println!("{wiring:?}, seed {seed}");
    let withheld = Withheld::draw(seed);
    let temporary = tempfile::tempdir().expect("directory");
    let dir = std::env::var_os(KEPT).map_or(temporary.path().to_owned(), PathBuf::from);
    fs::create_dir_all(&dir).expect("directory");
    let nominal = dir.join("nominal.toml");
    fs::write(&nominal, NOMINAL).expect("model");
    let cnc = Cnc::start(wiring, |sim| replace_machine(sim, wiring, &withheld));
    let mut bench = Bench { cnc, wiring, dir, program: Program::new(), seed };

    let before = bench.measure(&nominal, false, 1);
    let (diagnosis, report) = bench.diagnose(&nominal, &before, 1);
    let extended = bench.dir.join("extended.toml");
    let addition = text(&diagnosis.join("addition.toml"));
    let (base, out) = (text(&nominal), text(&extended));
    let fates =
        json(&volcomp(&["model", "extend", "--model", &base, "--add", &addition, "--out", &out, "--json"]));
    let after = bench.measure(&extended, true, 2);
    let (_, left) = bench.diagnose(&nominal, &after, 2);

    // the figures of the correction come before the names: no stall of the host excuses a wrong name
    let names = judge(&report, &withheld.open());
    let mut wrong = Vec::new();
    let (scale_on, backlash_um) = withheld.backlash_at_scale();
    let seen = before.feedback_reversal_um();
    println!(
        "reversal in the feedback that volcompd recorded: {seen:.2?} um; linear scale on axis {scale_on}"
    );
    for (axis, um) in seen.iter().enumerate() {
        let there = if axis == scale_on { -backlash_um } else { 0.0 };
        if (um - there).abs() > FEEDBACK_UM {
            wrong.push(format!("feedback of axis {axis} reverses by {um:.3} um instead of {there:.3} um"));
        }
    }
    let fraction = 1.0 - after.rms_um() / before.rms_um();
    let forecast = &report["shrink"];
    println!(
        "deviation RMS {:.2} um before, {:.2} um after: shrink {fraction:.3}",
        before.rms_um(),
        after.rms_um()
    );
    println!("forecast {forecast}; of the model {}", fates["shrink"]);
    for effect in fates["effects"].as_array().expect("effects") {
        println!("  {}: taken {} {}", effect["effect"], effect["taken"], effect["why"]);
    }
    let lower = number_of(&forecast["ci90"][0]);
    if fraction < lower - SHRINK_ALLOWANCE {
        wrong.push(format!("shrink {fraction:.3}, at least {lower:.3} was forecast"));
    }
    let gap = number_of(&left["gap"]["rms_um"]) / number_of(&report["gap"]["rms_um"]);
    println!("gap of the second diagnosis: {}, {:.1} % of the first", left["verdict"], 100.0 * gap);
    if left["verdict"] != "no-gap" && gap > GAP_LEFT {
        wrong.push(format!("{gap:.3} of the gap is left"));
    }
    must_hold(names.is_empty(), format_args!("seed {seed}: {}", [names, wrong.clone()].concat().join("; ")));
    assert!(wrong.is_empty(), "seed {seed}: {}", wrong.join("; "));
}

#[test]
#[ignore = "eight minutes with LinuxCNC: withheld errors, measured twice"]
fn errors_unknown_to_the_diagnosis_are_named_and_corrected_behind_the_motion_controller() {
    in_namespaces(
        "withheld::errors_unknown_to_the_diagnosis_are_named_and_corrected_behind_the_motion_controller",
        || closed_loop(Wiring::Injection),
    );
}

#[test]
#[ignore = "eight minutes with LinuxCNC: withheld errors, measured twice"]
fn errors_unknown_to_the_diagnosis_are_named_and_corrected_on_external_offsets() {
    in_namespaces(
        "withheld::errors_unknown_to_the_diagnosis_are_named_and_corrected_on_external_offsets",
        || closed_loop(Wiring::ExternalOffsets),
    );
}
