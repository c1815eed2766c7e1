//! Paper 000: six error motions of a carriage from points that a laser tracker sees, against the nine-line method.

mod instruments;

use anyhow::Context;
use serde_json::Value;
use volcomp_cli::report_page::{Plot, Style};
use volcomp_units::axes::AxisName;

use self::instruments::{NineLine, STATION_MM, TRACKER, TrackerRun, corner_points, stops, triangle};
use super::figure::{Limit, Row, Share, Truth};
use super::machine::{travels, varied};
use super::{Experiment, Measured, Setting, words};
use crate::instruments::tracker::{TrackerErrors, points_csv};
use crate::truth::conditions::{Acting, ConditionSizes, Conditions};
use crate::truth::{TruthMachine, VMC_850};
use crate::twin::Dice;

/// Bound of the paper, arcsec.
const PAPER_ARCSEC: f64 = 0.74;
/// Target of the plan, arcsec: what 0.7 leave for the tracker beside 0.28 (k = 2) of the reference, which are air and
/// expansion from line to line (0.2 um/m) and heat between both measurements (0.05 K over a guideway).
const TARGET_ARCSEC: &str = "0.64";
/// Probability with which all positions keep it; at 95 % one measurement in twenty misses.
const CONFIDENCE_PERCENT: &str = "99.9";

const THREE: &str = "yaw, largest difference to nine lines, 3 points, 1 run";
const PLANNED: &str = "yaw, largest difference to nine lines, as planned";
const TRUE: &str = "yaw, largest error, as planned";
const POINTS: &str = "points of the plan";
const RUNS: &str = "runs of the plan";
const RUNS_OF_THREE: &str = "runs that 3 points need";
const RUNS_OBLIQUE: &str = "runs that 3 points need, tracker beside the machine";

/// The experiment.
pub struct Paper000;

impl Experiment for Paper000 {
    fn number(&self) -> &'static str {
        "000"
    }

    fn title(&self) -> &'static str {
        "laser tracker, points on a carriage to six error motions"
    }

    fn procedure(&self) -> &'static str {
        "A tracker with 0.75 arcsec of angle noise and 0.5 µm + 0.2 µm/m of range noise sees points on the table of a \
         machining centre at 21 stops of X (850 mm). First three points 300 mm apart in one run with the tracker beside the \
         machine, as in the paper. Then volcomp identify threepoint --plan chooses among eight points of the table and \
         states the runs for 0.64 arcsec with 99.9 % (what 0.7 leave beside the reference), the tracker in the line of X, and the planned measurement is taken. The reference \
         is an interferometer along three lines (volcomp identify nineline --compare). Hard truth: error of the refractive \
         index and bending of the beam, encoder errors and warm-up of the tracker, air and expansion that change from line \
         to line, heat between both measurements."
    }

    fn rows(&self) -> &'static [Row] {
        const ROWS: &[Row] = &[
            Row::limited(PLANNED, "arcsec", Some(PAPER_ARCSEC), Limit::AtMost(PAPER_ARCSEC), 2),
            Row::reported(TRUE, "arcsec", None, 2),
            Row::reported(THREE, "arcsec", Some(PAPER_ARCSEC), 2),
            Row::reported(POINTS, "", Some(3.0), 0),
            Row::reported(RUNS, "", None, 0),
            Row::reported(RUNS_OF_THREE, "", None, 0),
            Row::reported(RUNS_OBLIQUE, "", None, 0),
        ];
        ROWS
    }

    fn run(&self, setting: &Setting, progress: &mut dyn FnMut(&str)) -> anyhow::Result<Measured> {
        let world = World::new(setting)?;
        let mut measured = Measured::default();
        progress("three points, tracker beside the machine");
        let beside = TrackerRun { points: triangle(&world.machine), ..world.tracker(STATION_MM[0], 1, &ALL) };
        beside.write(&world.machine, setting, "three")?;
        identify_tracker(setting, &world.machine, "three", "three-motions.csv")?;
        progress("plan of points and runs");
        let plan = world.plan(setting, STATION_MM[1], "plan", &corner_points(&world.machine))?;
        let oblique = world.plan(setting, STATION_MM[0], "plan-beside", &triangle(&world.machine))?;
        let names: Vec<String> = plan["best"]["points"]
            .as_array()
            .context("the plan reaches the target with no number of points")?
            .iter()
            .filter_map(|n| n.as_str().map(str::to_owned))
            .collect();
        let runs = plan["best"]["runs"].as_u64().context("the plan has no runs")?;
        progress(&format!("{} points, {runs} runs", names.len()));
        let chosen: Vec<(String, [f64; 3])> =
            corner_points(&world.machine).into_iter().filter(|(n, _)| names.contains(n)).collect();
        let found = world.difference(setting, &chosen, runs as u32, &ALL)?;
        let three = compare(setting, &world.machine, "three-motions.csv", "nineline-three")?;
        measured.values.insert(PLANNED, found.largest);
        measured.values.insert(THREE, three.largest);
        measured.values.insert(POINTS, names.len() as f64);
        measured.values.insert(RUNS, runs as f64);
        for (name, plan) in [(RUNS_OF_THREE, &plan), (RUNS_OBLIQUE, &oblique)] {
            if let Some(runs) = plan["rows"][0]["runs"][2].as_f64() {
                measured.values.insert(name, runs);
            }
        }
        measured.values.insert(TRUE, world.error(&found)?);
        measured.plots = plots(&found, &three, &world);
        if setting.finds_shares() {
            progress("shares of the causes");
            for (cause, without) in CAUSES {
                let rest = world.difference(setting, &chosen, runs as u32, &without)?;
                let share = 1.0 - (rest.rms / found.rms).powi(2);
                measured.shares.push(Share { cause: cause.to_owned(), share });
            }
            // the figures and files above are those of all causes
            world.difference(setting, &chosen, runs as u32, &ALL)?;
        }
        measured.notes.push(format!(
            "Points of the plan: {}. Three points beside the machine: noise of the angles acts across the beam, on yaw \
             over 300 mm. In the line of X the range carries yaw.",
            names.join(", ")
        ));
        Ok(measured)
    }
}

/// Causes of a difference that can be switched off.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Causes {
    noise: bool,
    tracker: bool,
    lines: bool,
    heat: bool,
}

const ALL: Causes = Causes { noise: true, tracker: true, lines: true, heat: true };
const CAUSES: [(&str, Causes); 4] = [
    ("noise of the tracker", Causes { noise: false, ..ALL }),
    ("refraction, encoders and warm-up of the tracker", Causes { tracker: false, ..ALL }),
    ("air and expansion between the nine lines", Causes { lines: false, ..ALL }),
    ("heat between both measurements", Causes { heat: false, ..ALL }),
];

/// Yaw of both methods.
#[derive(Debug, Clone, Default)]
struct Compared {
    /// Largest difference without its mean, arcsec.
    largest: f64,
    /// RMS of the difference, arcsec.
    rms: f64,
    /// Six motions of the tracker: position, um or arcsec.
    tracker: Vec<(f64, [f64; 6])>,
    /// The same of the nine lines.
    lines: Vec<(f64, [f64; 6])>,
}

struct World {
    machine: TruthMachine,
    later: TruthMachine,
    seed: u64,
    errors: TrackerErrors,
    lines: NineLine,
}

impl World {
    fn new(setting: &Setting) -> anyhow::Result<Self> {
        let mut machine = varied(VMC_850, setting.seed)?;
        let mut later = machine.clone();
        let mut dice = Dice::new(setting.seed, "paper 000");
        let (mut errors, mut lines) = (TrackerErrors::NONE, NineLine::ideal(setting.seed));
        if setting.truth == Truth::Hard {
            // both on one day: a tenth of a kelvin over the guideways' height lies between them
            let sizes = ConditionSizes { rise_k: 0.2, gradient_k: 0.05, ..ConditionSizes::SHOP };
            let conditions = Conditions::new(&sizes, travels(&machine), Acting::SURVEY, setting.seed);
            machine.set_conditions(Some(conditions.clone()));
            later.set_conditions(Some(conditions.with(Acting { heat: true, ..Acting::SURVEY })));
            errors = TrackerErrors::shop(setting.seed);
            lines.scale_ppm = [0; 3].map(|_| 0.2 * dice.normal());
        }
        Ok(Self { machine, later, seed: setting.seed, errors, lines })
    }

    fn tracker(&self, station_mm: [f64; 3], runs: u32, causes: &Causes) -> TrackerRun {
        TrackerRun {
            station_mm,
            runs,
            seed: self.seed,
            errors: if causes.tracker { self.errors } else { TrackerErrors::NONE },
            noise: causes.noise,
            points: Vec::new(),
        }
    }

    /// The plan as JSON.
    fn plan(
        &self,
        setting: &Setting,
        station: [f64; 3],
        name: &str,
        points: &[(String, [f64; 3])],
    ) -> anyhow::Result<Value> {
        let file = format!("{name}-points.csv");
        setting.write(&file, &points_csv(points))?;
        let [low, high] = travels(&self.machine)[0];
        let mut args = words(&["identify", "threepoint", "--plan", "--target-arcsec", TARGET_ARCSEC]);
        args.extend(words(&["--confidence-percent", CONFIDENCE_PERCENT]));
        args.extend(words(&["--angles", "ec", "--axis", "x", "--json", "--points"]));
        args.push(setting.arg(&file));
        args.extend(words(&["--travel-mm", &format!("{low},{high}")]));
        args.push(format!("--tracker-mm={}", station.map(|v| v.to_string()).join(",")));
        args.extend(TRACKER.sigmas());
        args.extend(words(&["--chain", self.machine.chain().text()]));
        let plan = setting.json(&args)?;
        setting.write(&format!("{name}.json"), &plan.to_string())?;
        Ok(plan)
    }

    /// Both measurements with some causes, and their difference.
    fn difference(
        &self,
        setting: &Setting,
        points: &[(String, [f64; 3])],
        runs: u32,
        causes: &Causes,
    ) -> anyhow::Result<Compared> {
        let run = TrackerRun { points: points.to_vec(), ..self.tracker(STATION_MM[1], runs, causes) };
        run.write(&self.machine, setting, "planned")?;
        identify_tracker(setting, &self.machine, "planned", "planned-motions.csv")?;
        let lines = if causes.lines { self.lines } else { NineLine { scale_ppm: [0.0; 3], ..self.lines } };
        let machine = if causes.heat { &self.later } else { &self.machine };
        lines.write(machine, setting)?;
        compare(setting, &self.machine, "planned-motions.csv", "nineline")
    }

    /// True yaw at a position, mean of both directions, arcsec.
    fn yaw(&self, q: f64) -> f64 {
        let k = self.machine.index_of(AxisName::X).unwrap_or_default();
        let both = [1, -1].map(|d| self.machine.true_motion(k, q, d)[5]);
        f64::midpoint(both[0], both[1]).to_degrees() * 3600.0
    }

    /// Largest error of the planned yaw, without a constant.
    fn error(&self, found: &Compared) -> anyhow::Result<f64> {
        let errors: Vec<f64> = found.tracker.iter().map(|(q, m)| m[5] - self.yaw(*q)).collect();
        anyhow::ensure!(!errors.is_empty(), "no position");
        let mean = errors.iter().sum::<f64>() / errors.len() as f64;
        Ok(errors.iter().map(|e| (e - mean).abs()).fold(0.0, f64::max))
    }
}

fn identify_tracker(
    setting: &Setting,
    machine: &TruthMachine,
    name: &str,
    motions: &str,
) -> anyhow::Result<()> {
    let mut args = words(&["identify", "threepoint", "--axis", "x", "--json", "--points"]);
    args.push(setting.arg(&format!("{name}-points.csv")));
    args.extend(["--data".to_owned(), setting.arg(&format!("{name}.csv"))]);
    args.extend(["--registration".to_owned(), setting.arg(&format!("{name}-registration.csv"))]);
    args.extend(TRACKER.sigmas());
    args.extend(words(&["--chain", machine.chain().text(), "--machine", machine.machine()]));
    args.extend(["--motions".to_owned(), setting.arg(motions)]);
    setting.volcomp(&args)?;
    Ok(())
}

/// Identifies the nine lines and compares them with motions of the tracker.
fn compare(setting: &Setting, machine: &TruthMachine, other: &str, name: &str) -> anyhow::Result<Compared> {
    let own = format!("{name}-motions.csv");
    let mut args = words(&["identify", "nineline", "--axis", "x", "--json", "--lines"]);
    args.push(setting.arg("lines.csv"));
    args.extend(["--data".to_owned(), setting.arg("nineline.csv")]);
    args.extend(words(&[
        "--noise-um",
        "0.1",
        "--chain",
        machine.chain().text(),
        "--machine",
        machine.machine(),
    ]));
    args.extend(["--motions".to_owned(), setting.arg(&own), "--compare".to_owned(), setting.arg(other)]);
    let report = setting.json(&args)?;
    let of = |key: &str| {
        report["compared"][key][5].as_f64().map(|v| v.to_degrees() * 3600.0).context("no comparison")
    };
    Ok(Compared {
        largest: of("largest")?,
        rms: of("rms")?,
        tracker: instruments::read_motions(&setting.path(other))?,
        lines: instruments::read_motions(&setting.path(&own))?,
    })
}

/// Figures 5 and 6 of the paper.
fn plots(found: &Compared, three: &Compared, world: &World) -> Vec<Plot> {
    let of = |rows: &[(f64, [f64; 6])], i: usize| -> Vec<(f64, f64)> {
        rows.iter().map(|(q, m)| (*q, m[i])).collect()
    };
    let x = "position of X, mm";
    let lengths = Plot::new("Figure 5: linear error motions, as planned", x, "error, µm")
        .with(Style::Line, "EXX", of(&found.tracker, 0))
        .with(Style::Line, "EYX", of(&found.tracker, 1))
        .with(Style::Line, "EZX", of(&found.tracker, 2));
    let angles = Plot::new("Figure 5: angular error motions, as planned", x, "error, arcsec")
        .with(Style::Line, "EAX", of(&found.tracker, 3))
        .with(Style::Line, "EBX", of(&found.tracker, 4))
        .with(Style::Line, "ECX", of(&found.tracker, 5));
    let truth: Vec<(f64, f64)> = {
        let [low, high] = travels(&world.machine)[0];
        let zero = world.yaw(low);
        (0..=170)
            .map(|i| low + (high - low) * f64::from(i) / 170.0)
            .map(|q| (q, world.yaw(q) - zero))
            .collect()
    };
    let yaw = Plot::new("Figure 6: yaw by both methods", x, "ECX, arcsec")
        .with(Style::Line, "tracker, as planned", of(&found.tracker, 5))
        .with(Style::Line, "nine lines", of(&found.lines, 5))
        .with(Style::Dots, "tracker, 3 points, 1 run", of(&three.tracker, 5))
        .with(Style::Reference, "true yaw", truth);
    let difference: Vec<(f64, f64)> =
        found.tracker.iter().zip(&found.lines).map(|(t, l)| (t.0, t.1[5] - l.1[5])).collect();
    let mean = difference.iter().map(|d| d.1).sum::<f64>() / difference.len().max(1) as f64;
    let about: Vec<(f64, f64)> = difference.iter().map(|d| (d.0, d.1 - mean)).collect();
    let bound = |v: f64| stops(&world.machine).into_iter().map(|q| (q, v)).collect::<Vec<_>>();
    let rest = Plot::new("Figure 6: difference of both methods", x, "difference of ECX, arcsec")
        .with(Style::Line, "as planned, without its mean", about)
        .with(Style::Reference, "0.74 arcsec of the paper", bound(PAPER_ARCSEC))
        .with(Style::Reference, "", bound(-PAPER_ARCSEC));
    vec![lengths, angles, yaw, rest]
}
