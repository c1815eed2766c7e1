//! The main job, end to end: survey a machine, fit a model, compensate, and look at the difference.
//!
//! Reading order: [`run`], [`shop`] (machine, control and daemon), [`survey`] (the files that are fitted),
//! [`figures`] (what the instruments make of the recorded cycles), [`picture`] and `page` (what is shown).

#![expect(clippy::disallowed_methods, reason = "the demo writes files and starts programs")]

pub mod figures;
mod page;
pub mod picture;
pub mod programs;
pub mod shop;
pub mod survey;

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::Context;

use self::figures::{Pair, ballbar, ballbar_curve, deviation_along, diagonal, rms, thinned};
use self::picture::{Curves, Picture};
use self::programs::Programs;
use self::shop::Shop;
use crate::control::CycleRecord;
use crate::instruments::ballbar::Trace;
use crate::instruments::diagonal::Diagonal;
use crate::instruments::survey::SurveyPlan;
use crate::motion::MotionSource;
use crate::motion::paths::{Circle, Plane, Targets, Turn, circle, line_with_targets};
use crate::motion::recorded::Replay;
use crate::truth::{TruthMachine, VMC_850};

/// Radius of the circle, mm.
const RADIUS_MM: f64 = 100.0;
/// Feed on the circle, mm/min.
const CIRCLE_FEED: f64 = 2000.0;
/// Feed along the diagonals, mm/min.
const DIAGONAL_FEED: f64 = 10_000.0;

/// Time without a scored cycle that is shown as a gap, s.
const PAUSE_S: f64 = 0.1;

/// What to do and where to leave it.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Folder for everything that is written.
    pub folder: PathBuf,
    /// Seed of the machine's and the instruments' noise.
    pub seed: u64,
    /// Control cycle, s.
    pub cycle_s: f64,
    /// Daemon and tool.
    pub programs: Programs,
}

/// The demo's figures.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Outcome {
    /// Circularity G, both directions.
    pub circle: Pair,
    /// Range of the deviation along the worst body diagonal.
    pub diagonal: Pair,
    /// RMS deviation of the tool tip along recorded motion.
    pub real_motion: Pair,
    /// Circularity that stays where the drives are ideal.
    pub circle_with_ideal_drives_um: f64,
    /// Simulated time, s.
    pub simulated_s: f64,
    /// The picture.
    pub picture: PathBuf,
    /// The page.
    pub page: PathBuf,
}

/// What the page says about the run.
pub(crate) struct Scene {
    machine: String,
    seed: u64,
    cycle_s: f64,
}

/// One round of measuring.
struct Round {
    circle: Trace,
    diagonals: Vec<Diagonal>,
    real_motion: Vec<(f64, f64)>,
    cycles: usize,
}

/// Runs the demo; `say` receives each step.
///
/// # Errors
/// A file cannot be written, a program does not start, or does not do what it should.
pub fn run(options: &Options, say: &mut dyn FnMut(&str)) -> anyhow::Result<Outcome> {
    let folder = &options.folder;
    fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
    let folder = &folder.canonicalize()?;
    let truth = TruthMachine::from_toml(VMC_850)?;

    say("surveying the machine: six error motions of each axis, three squarenesses");
    let plan = SurveyPlan { seed: options.seed, ..SurveyPlan::default() };
    let files = survey::survey_to(&truth, &plan, folder)?;
    say("fitting a model to the survey");
    let model = folder.join("model.toml");
    let args = files.fit_arguments(&model);
    options.programs.volcomp(&args.iter().map(String::as_str).collect::<Vec<_>>())?;

    let mut shop = Shop::open(truth, options.seed, options.cycle_s)?;
    say(&format!("control of {} listens on {}", shop.machine().machine(), shop.address()));
    let before = measure(&mut shop, "without compensation", say)?;

    let config = folder.join("machine.toml");
    survey::write(&config, &machine_file(&shop, options))?;
    options.programs.volcomp(&["check", &config.display().to_string()])?;
    let log = folder.join("volcompd.log");
    survey::write(&log, "")?;
    let daemon = shop.start_daemon(&options.programs, &config, &log)?;
    say(&format!("volcompd (process {}) is connected and active", daemon.id()));
    let after = measure(&mut shop, "with compensation", say)?;
    shop.control().close();
    drop(daemon);

    say("the same circle with ideal drives, to see what the model itself leaves");
    let ideal = ideal_drives(options, folder, &log)?;

    let worst = |round: &Round| round.diagonals.iter().map(Diagonal::range_um).fold(0.0, f64::max);
    let outcome = Outcome {
        circle: Pair {
            before_um: before.circle.circularity()?.bidirectional_um,
            after_um: after.circle.circularity()?.bidirectional_um,
        },
        diagonal: Pair { before_um: worst(&before), after_um: worst(&after) },
        real_motion: Pair { before_um: rms(&before.real_motion), after_um: rms(&after.real_motion) },
        circle_with_ideal_drives_um: ideal.circularity()?.bidirectional_um,
        simulated_s: (before.cycles + after.cycles) as f64 * options.cycle_s,
        picture: folder.join("demo.svg"),
        page: folder.join("demo.html"),
    };
    let svg = draw(&before, &after).svg().map_err(|e| anyhow::anyhow!("cannot draw: {e}"))?;
    let scene =
        Scene { machine: shop.machine().machine().to_owned(), seed: options.seed, cycle_s: options.cycle_s };
    survey::write(&outcome.picture, &svg)?;
    survey::write(&outcome.page, &page::html(&outcome, &scene, &svg))?;
    Ok(outcome)
}

impl Outcome {
    /// Rows of the table: what, how, figures.
    #[must_use]
    pub fn table(&self) -> [(&'static str, &'static str, Pair); 3] {
        [
            ("circle", "circular error G, R 100 mm in XY, F2000, both directions", self.circle),
            ("body diagonal", "range of the deviation, worst of four, whole volume", self.diagonal),
            ("real motion", "RMS deviation of the tool tip along recorded motion", self.real_motion),
        ]
    }

    /// What is left of the circle, and why.
    #[must_use]
    pub fn what_is_left(&self) -> Vec<String> {
        let model = self.circle_with_ideal_drives_um;
        vec![
            format!(
                "{:.1} µm of circularity are left. With ideal drives and encoders it would be {model:.1} µm: that part is the \
                 model's, from a survey every 25 mm with 0.2 µm and 0.1 arcsec of noise.",
                self.circle.after_um
            ),
            "The rest is no geometry and no map can remove it: servo lags that differ by 0.02 ms (0.7 µm on this circle), \
             0.3 µm of lost motion and 0.1 µm of wander behind the encoders."
                .to_owned(),
            "The following error of the drives themselves (the lag along the path) is not a geometric error and is not \
             touched."
                .to_owned(),
        ]
    }
}

impl Scene {
    /// What lies beside the page.
    fn files(&self) -> [(&'static str, &'static str); 6] {
        [
            ("survey-x.csv", "what the instruments saw of X (Y and Z alike)"),
            ("geometry.toml", "the machine as drawn"),
            ("model.toml", "the model that volcomp fit made of both"),
            ("machine.toml", "the configuration of the daemon"),
            ("volcompd.log", "what the daemon said"),
            ("demo.svg", "the picture"),
        ]
    }
}

/// The three measurements, from the middle of the machine.
fn measure(shop: &mut Shop, how: &str, say: &mut dyn FnMut(&str)) -> anyhow::Result<Round> {
    say(&format!("circle R {RADIUS_MM} mm at F{CIRCLE_FEED}, {how}"));
    let trace = measure_circle(shop)?;
    say(&format!("four body diagonals, {how}"));
    let [low, high] = shop.corners();
    let mut diagonals = Vec::new();
    let mut cycles = trace.readings.len();
    for flip in [[false, false], [true, false], [false, true], [true, true]] {
        let (mut from, mut to) = (low, high);
        for k in 0..2 {
            if flip[k] {
                std::mem::swap(&mut from[k], &mut to[k]);
            }
        }
        let targets = Targets { count: 18, dwell_s: 0.1, cycles: 1, feed_mm_per_min: DIAGONAL_FEED };
        let run = shop.program(&line_with_targets(from, to, &targets))?;
        cycles += run.len();
        diagonals.push(diagonal(shop.machine(), &run)?);
    }
    say(&format!("recorded motion of a real part program, {how}"));
    let run = measure_recorded(shop)?;
    cycles += run.len();
    let real_motion = deviation_along(shop.machine(), &run);
    let middle = shop.middle();
    shop.go_to(&middle)?;
    Ok(Round { circle: trace, diagonals, real_motion, cycles })
}

fn measure_circle(shop: &mut Shop) -> anyhow::Result<Trace> {
    let middle = shop.middle();
    let centre_mm = [middle[0], middle[1], middle[2]];
    let mut whole: Option<Trace> = None;
    for turn in [Turn::CounterClockwise, Turn::Clockwise] {
        let program = circle(&Circle {
            plane: Plane::Xy,
            centre_mm,
            radius_mm: RADIUS_MM,
            feed_mm_per_min: CIRCLE_FEED,
            turn,
            ..Circle::default()
        });
        let run = shop.program(&program)?;
        let trace = ballbar(shop.machine(), centre_mm, RADIUS_MM, &run)?;
        whole = Some(match whole {
            Some(first) => first.joined(trace),
            None => trace,
        });
    }
    whole.context("no circle was run")
}

fn measure_recorded(shop: &mut Shop) -> anyhow::Result<Vec<CycleRecord>> {
    let replay = Replay::shipped(shop.axes(), shop.cycle_s())?;
    shop.go_to(&replay.start())?;
    shop.dwell(0.5)?;
    shop.motion(replay)
}

/// The compensated circle on the same machine with drives that follow without any lag, noise or lost motion.
fn ideal_drives(options: &Options, folder: &Path, log: &Path) -> anyhow::Result<Trace> {
    let truth = TruthMachine::from_toml(VMC_850)?.with_ideal_drives();
    let mut shop = Shop::open(truth, options.seed, options.cycle_s)?;
    let config = folder.join("machine-ideal-drives.toml");
    survey::write(&config, &machine_file(&shop, options))?;
    let daemon = shop.start_daemon(&options.programs, &config, log)?;
    let trace = measure_circle(&mut shop)?;
    shop.control().close();
    drop(daemon);
    Ok(trace)
}

/// The daemon's configuration for this control.
fn machine_file(shop: &Shop, options: &Options) -> String {
    let mut text = format!(
        "# The daemon's configuration for the demo; every key is explained in config/machine.toml.\n\
         format = \"volcomp-machine/1\"\n\
         machine = \"{}\"\n\
         model = \"model.toml\"\n\n\
         [link]\n\
         address = \"{}\"\n\
         cycle-ms = {}\n\n\
         [engine]\n\
         start = \"on-connect\"\n\
         ramp-s = 1.0\n\
         stale-ms = 1000.0  # the demo runs as fast as it can: its pauses are none of the machine's\n\n\
         [realtime]\n\
         priority = 0\n\
         lock-memory = false\n\n\
         [status]\n\
         socket = \"\"\n\n\
         [log]\n\
         target = \"stderr\"\n",
        shop.machine().machine(),
        shop.address(),
        options.cycle_s * 1e3,
    );
    for axis in shop.machine().axes() {
        text.push_str(&format!(
            "\n[axes.{}]\nlimit-um = 150.0\nrate-um-per-s = 2000.0\nacceleration-um-per-s2 = 40000.0\n",
            axis.lower()
        ));
    }
    text
}

fn draw(before: &Round, after: &Round) -> Picture {
    let worst = (0..before.diagonals.len())
        .max_by(|a, b| before.diagonals[*a].range_um().total_cmp(&before.diagonals[*b].range_um()))
        .unwrap_or_default();
    let line = |d: &Diagonal| d.rows.iter().map(|r| (r.position_mm, r.deviation_um)).collect();
    Picture {
        circle_title: format!("Ballbar, R {RADIUS_MM} mm, XY, F{CIRCLE_FEED}"),
        circle: Curves { before: ballbar_curve(&before.circle), after: ballbar_curve(&after.circle) },
        diagonal: Curves { before: line(&before.diagonals[worst]), after: line(&after.diagonals[worst]) },
        real_motion: Curves {
            before: thinned(&before.real_motion, PAUSE_S),
            after: thinned(&after.real_motion, PAUSE_S),
        },
    }
}
