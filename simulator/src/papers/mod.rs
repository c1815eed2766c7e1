//! The experiments of the source papers, each as one run: simulated instruments, the commands a user has, `volcompd` over
//! TCP, and the compensated machine measured again with the instrument of the paper.
//!
//! To add an experiment: a folder of its own with a type that implements [`Experiment`], and a line in [`EXPERIMENTS`].
//! Reading order: [`figure`] (rows, limits, spread), [`run()`], [`report`] (HTML), then the papers.

#![expect(clippy::disallowed_methods, reason = "the experiments write files and start programs")]

pub mod figure;
pub mod machine;
pub mod paper000;
pub mod paper001;
pub mod paper002;
pub mod paper003;
pub mod paper004;
pub mod report;
mod scales;

use core::time::Duration;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::Context;
use serde_json::{Value, json};
use volcomp_cli::report_page::Plot;
use volcomp_units::axes::AxisArray;

use self::figure::{Limit, Row, Share, Spread, Truth, Values};
use crate::control::{Absent, ControlConfig, Interface, OffsetConfig, OffsetLimits, Pacing};
use crate::demo::programs::Programs;
use crate::demo::shop::Shop;
use crate::motion::MachineAxes;
use crate::truth::TruthMachine;

/// One run of an experiment: seed, truth and a folder of its own.
#[derive(Debug, Clone)]
pub struct Setting {
    /// Seed of machine, instruments and conditions.
    pub seed: u64,
    /// Which truth.
    pub truth: Truth,
    /// Folder for all files of the run; it exists.
    pub folder: PathBuf,
    /// The programs of the product.
    pub programs: Programs,
    /// Whether the shares of the causes are wanted; they need further runs.
    pub shares: bool,
}

impl Setting {
    /// True where the run finds what causes the rest: with the hard truth, where it is wanted.
    #[must_use]
    pub fn finds_shares(&self) -> bool {
        self.shares && self.truth == Truth::Hard
    }

    /// The same run in a folder of its own below this one, with copies of the files named.
    ///
    /// # Errors
    /// The folder cannot be made or a file not be copied.
    pub fn below(&self, name: &str, files: &[&str]) -> anyhow::Result<Self> {
        let folder = self.path(name);
        fs::create_dir_all(&folder).with_context(|| format!("cannot make {}", folder.display()))?;
        for file in files {
            fs::copy(self.path(file), folder.join(file)).with_context(|| format!("cannot copy {file}"))?;
        }
        Ok(Self { folder, ..self.clone() })
    }

    /// Path of a file of the run.
    #[must_use]
    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    /// Path of a file of the run as an argument.
    #[must_use]
    pub fn arg(&self, name: &str) -> String {
        self.path(name).display().to_string()
    }

    /// Writes a file of the run.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write(&self, name: &str, text: &str) -> anyhow::Result<()> {
        let path = self.path(name);
        fs::write(&path, text).with_context(|| format!("cannot write {}", path.display()))
    }

    /// Runs `volcomp ARGS..`, records the command line in `commands.txt` and returns what it printed.
    ///
    /// # Errors
    /// The command fails; the message holds its stderr.
    pub fn volcomp(&self, args: &[String]) -> anyhow::Result<String> {
        use std::io::Write as _;
        let mut log = fs::File::options().create(true).append(true).open(self.path("commands.txt"))?;
        writeln!(log, "volcomp {}", args.iter().map(|a| quoted(a)).collect::<Vec<_>>().join(" "))?;
        self.programs.volcomp(&args.iter().map(String::as_str).collect::<Vec<_>>())
    }

    /// Runs a command that prints JSON.
    ///
    /// # Errors
    /// The command fails, or prints something else.
    pub fn json(&self, args: &[String]) -> anyhow::Result<Value> {
        let text = self.volcomp(args)?;
        serde_json::from_str(&text).with_context(|| format!("volcomp {}: no JSON on stdout", args.join(" ")))
    }
}

fn quoted(arg: &str) -> String {
    if arg.contains([' ', '[', '\'']) { format!("\"{arg}\"") } else { arg.to_owned() }
}

/// Words of a command line.
#[must_use]
pub fn words(args: &[&str]) -> Vec<String> {
    args.iter().map(|a| (*a).to_owned()).collect()
}

/// Results of one run.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Measured {
    /// Figures by the names of the rows.
    pub values: Values,
    /// The plots of the paper.
    pub plots: Vec<Plot>,
    /// What causes the rest.
    pub shares: Vec<Share>,
    /// Remarks for the report.
    pub notes: Vec<String>,
}

/// The control waits for each answer for so long: a computer that stalls is no part of an experiment.
const ANSWER: Duration = Duration::from_secs(60);

/// A machine under a control that waits for its daemon, however slow the computer is.
fn shop(
    machine: &TruthMachine,
    seed: u64,
    cycle_s: f64,
    interface: Interface,
    start: impl FnOnce(&MachineAxes) -> AxisArray,
) -> anyhow::Result<Shop> {
    let axes = MachineAxes::of(machine)?;
    let start = start(&axes);
    // above the limits in the machine files of the experiments: the control must not clip what it is sent
    let usual = OffsetConfig::default();
    let rotary = OffsetLimits { size: 0.3, ..usual.rotary };
    let config = ControlConfig {
        offset: OffsetConfig { rotary, ..usual },
        cycle_s,
        listen: ([127, 0, 0, 1], 0).into(),
        pacing: Pacing::LockStep { answer_timeout: ANSWER, absent: Absent::GoOn },
        interface,
        ..ControlConfig::new(machine.machine(), axes)
    };
    Shop::with_control(machine.clone(), seed, config, &start)
}

/// An experiment of a paper.
pub trait Experiment: Sync {
    /// Number of the paper, three digits.
    fn number(&self) -> &'static str;
    /// What is measured.
    fn title(&self) -> &'static str;
    /// Machine, instruments and procedure in a few sentences, for the report.
    fn procedure(&self) -> &'static str;
    /// Rows of the table.
    fn rows(&self) -> &'static [Row];
    /// Runs the experiment; progress goes to `progress`.
    ///
    /// # Errors
    /// A program fails, a file cannot be written, or a measurement is impossible.
    fn run(&self, setting: &Setting, progress: &mut dyn FnMut(&str)) -> anyhow::Result<Measured>;
}

/// All experiments that exist, by number.
pub const EXPERIMENTS: &[&dyn Experiment] = &[
    &paper000::Paper000,
    &paper001::Paper001,
    &paper002::Paper002,
    &paper003::Paper003,
    &paper004::Paper004,
];

/// What to run.
#[derive(Debug, Clone)]
pub struct Options {
    /// Folder for reports and files.
    pub folder: PathBuf,
    /// First seed.
    pub seed: u64,
    /// Number of seeds.
    pub seeds: u32,
    /// Truths in the order of the columns.
    pub truths: Vec<Truth>,
    /// The programs of the product.
    pub programs: Programs,
    /// Whether the shares of the causes are wanted.
    pub shares: bool,
}

/// One seed of an experiment with every truth.
#[derive(Debug, Clone, PartialEq)]
pub struct SeedRun {
    /// The seed.
    pub seed: u64,
    /// Results by truth.
    pub runs: BTreeMap<Truth, Measured>,
}

/// An experiment over all seeds.
pub struct Outcome {
    /// The experiment.
    pub experiment: &'static dyn Experiment,
    /// Truths in the order of the columns.
    pub truths: Vec<Truth>,
    /// Seed by seed.
    pub seeds: Vec<SeedRun>,
    /// The report.
    pub report: PathBuf,
}

/// Runs an experiment over all seeds and truths and writes its report.
///
/// # Errors
/// A run fails; the message names seed and truth.
pub fn run(
    experiment: &'static dyn Experiment,
    options: &Options,
    progress: &mut dyn FnMut(&str),
) -> anyhow::Result<Outcome> {
    let folder = options.folder.join(format!("paper-{}", experiment.number()));
    let mut seeds = Vec::new();
    for seed in options.seed..options.seed + u64::from(options.seeds) {
        let mut runs = BTreeMap::new();
        for truth in &options.truths {
            let place = format!("paper {}, seed {seed}, {} truth", experiment.number(), truth.name());
            let setting = Setting {
                seed,
                truth: *truth,
                folder: fresh(&folder.join(format!("seed-{seed}-{}", truth.name())))?,
                programs: options.programs.clone(),
                shares: options.shares,
            };
            let measured = experiment
                .run(&setting, &mut |step| progress(&format!("{place}: {step}")))
                .with_context(|| place.clone())?;
            runs.insert(*truth, measured);
        }
        seeds.push(SeedRun { seed, runs });
    }
    let outcome =
        Outcome { experiment, truths: options.truths.clone(), seeds, report: folder.join("report.html") };
    fs::write(&outcome.report, report::html(&outcome))
        .with_context(|| format!("cannot write {}", outcome.report.display()))?;
    Ok(outcome)
}

/// An empty folder; files of an earlier run with the same name are removed one by one.
fn fresh(folder: &Path) -> anyhow::Result<PathBuf> {
    fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
    let commands = folder.join("commands.txt");
    if commands.exists() {
        fs::remove_file(&commands)?;
    }
    Ok(folder.canonicalize()?)
}

impl Outcome {
    /// All values of a figure with one truth, seed by seed.
    #[must_use]
    pub fn values(&self, row: &Row, truth: Truth) -> Vec<f64> {
        self.seeds.iter().filter_map(|s| s.runs.get(&truth)?.values.get(row.name).copied()).collect()
    }

    /// Distribution of a figure over the seeds.
    #[must_use]
    pub fn spread(&self, row: &Row, truth: Truth) -> Option<Spread> {
        Spread::of(&self.values(row, truth), row.limit)
    }

    /// Whether the 5 % worst keep the limit with every truth; none without a limit. A figure that a run did not yield
    /// keeps no limit.
    #[must_use]
    pub fn pass(&self, row: &Row) -> Option<bool> {
        let limit = row.limit?;
        let keeps = |truth: &Truth| {
            let values = self.values(row, *truth);
            let complete = values.len() == self.seeds.len();
            complete && Spread::of(&values, row.limit).is_some_and(|s| limit.holds(s.worst_5_percent))
        };
        Some(self.truths.iter().all(keeps))
    }

    /// True where every limit holds.
    #[must_use]
    pub fn holds(&self) -> bool {
        self.experiment.rows().iter().all(|row| self.pass(row) != Some(false))
    }

    /// Mean shares of the causes over all seeds, with the hard truth.
    #[must_use]
    pub fn shares(&self) -> Vec<Share> {
        let mut sums: Vec<(String, f64, u32)> = Vec::new();
        let all = self.seeds.iter().filter_map(|s| s.runs.get(&Truth::Hard)).flat_map(|m| &m.shares);
        for share in all {
            match sums.iter_mut().find(|s| s.0 == share.cause) {
                Some(sum) => {
                    sum.1 += share.share;
                    sum.2 += 1;
                }
                None => sums.push((share.cause.clone(), share.share, 1)),
            }
        }
        sums.into_iter().map(|(cause, sum, n)| Share { cause, share: sum / f64::from(n) }).collect()
    }

    /// The entries of `papers` in `volcomp-paper/1`, one per seed and truth: figures with a limit, and those that are
    /// reported only.
    #[must_use]
    pub fn json(&self) -> Vec<Value> {
        let entry = |seed: u64, truth: Truth, measured: &Measured| {
            let (limited, reported): (Vec<&Row>, Vec<&Row>) =
                self.experiment.rows().iter().partition(|row| row.limit.is_some());
            let of = |rows: Vec<&Row>| -> Vec<Value> {
                rows.into_iter().map(|row| figure_json(row, measured.values.get(row.name).copied())).collect()
            };
            json!({
                "paper": self.experiment.number(),
                "seed": seed,
                "truth": truth,
                "figures": of(limited),
                "reported": of(reported),
                "report": self.report,
            })
        };
        self.seeds
            .iter()
            .flat_map(|s| self.truths.iter().filter_map(|t| s.runs.get(t).map(|m| entry(s.seed, *t, m))))
            .collect()
    }

    /// The entry of `summary` in `volcomp-paper/1`: distributions over the seeds.
    #[must_use]
    pub fn summary_json(&self) -> Value {
        let figures: Vec<Value> = self
            .experiment
            .rows()
            .iter()
            .map(|row| {
                json!({
                    "name": row.name,
                    "unit": row.unit,
                    "paper": row.paper,
                    "limit": row.limit.map(Limit::value),
                    "sense": row.limit.map(Limit::sense),
                    "kind": self.spread(row, Truth::Kind),
                    "hard": self.spread(row, Truth::Hard),
                    "pass": self.pass(row),
                })
            })
            .collect();
        json!({
            "paper": self.experiment.number(),
            "seeds": self.seeds.len(),
            "figures": figures,
            "shares_of_what_is_left": self.shares(),
            "pass": self.holds(),
        })
    }
}

/// A figure of one run; one with a limit that the run did not yield has not passed.
fn figure_json(row: &Row, ours: Option<f64>) -> Value {
    let mut figure = json!({ "name": row.name, "unit": row.unit, "paper": row.paper, "ours": ours });
    if let (Some(limit), Some(object)) = (row.limit, figure.as_object_mut()) {
        object.insert("limit".into(), limit.value().into());
        object.insert("sense".into(), limit.sense().into());
        object.insert("pass".into(), ours.is_some_and(|v| limit.holds(v)).into());
    }
    figure
}

/// The whole of `volcomp-paper/1`.
#[must_use]
pub fn json(outcomes: &[Outcome]) -> Value {
    json!({
        "format": "volcomp-paper/1",
        "papers": outcomes.iter().flat_map(Outcome::json).collect::<Vec<_>>(),
        "summary": outcomes.iter().map(Outcome::summary_json).collect::<Vec<_>>(),
    })
}
