//! `cncsim dev blind`: does the diagnosis find what it was not told?

use std::collections::BTreeSet;
use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::sync::{Mutex, PoisonError};

use super::campaign::{save, write_all};
use super::tool::Tool;
use super::{EX_DATAERR, EX_IOERR, EX_SOFTWARE, EX_USAGE, Failure};
use crate::blind::cases::{many, pool};
use crate::blind::generator::GeneratorError;
use crate::blind::judge::Report;
use crate::blind::score::Of;
use crate::blind::{Case, Draw, Generator, Judged, Kind, Mode, Origin, Score, judge};
use crate::campaign::Plan;

mod case_files;
mod text_report;

use case_files::Source;

#[derive(Debug, clap::Args)]
#[command(
    after_help = "Labels lie in OUT/sealed and are opened only after the tool has answered; the tool runs as a process \
    of its own, in a folder that holds the session files alone.\n\nExamples:\n  \
    cncsim dev blind --out blind                               the whole set, plain noise\n  \
    cncsim dev blind --out hard --hard                         heavy tails, drift with waves and trend, varying effects\n  \
    cncsim dev blind --out removed --without-truth             the true effect taken out of the tool's library\n  \
    cncsim dev blind --out all-but-one --leave-one-out         the model is given all effects but one\n  \
    cncsim dev blind --out other --generator trunnion          another machine, plan, formulas and noise\n  \
    cncsim dev blind --out third --generator multibody         a third one, simulated by a program of its own\n  \
    cncsim dev blind --out some --effect wear --effect positioning --singles 24\n                                                         how sure a few names are\n  \
    cncsim dev blind --out plan --plan one-feed-ballbar        a plan that cannot see everything\n  \
    cncsim dev blind --out ablation --ablation                 proof that the tests can fail\n\n\
    Exit code 70 with --check where a bar is not reached."
)]
pub(super) struct Args {
    /// Folder for cases, sealed labels and blind.json; made where it is missing.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Seed of all draws; the same seed gives the same cases.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Where the machines come from.
    #[arg(long, value_enum, default_value = "twin")]
    generator: Generator,
    /// The program of the multibody generator [default: multibody beside this program].
    #[arg(long, value_name = "PROGRAM")]
    generator_program: Option<PathBuf>,
    /// What is measured; trunnion and multibody have one plan of their own, full.
    #[arg(long, value_enum, default_value = "full")]
    plan: Plan,
    /// Cases with one effect [default: each effect once].
    #[arg(long, value_name = "N")]
    singles: Option<usize>,
    /// Draw cases with one effect from these only (name or name:subject); no pairs, may be repeated.
    #[arg(long = "effect", value_name = "EFFECT", conflicts_with_all = ["leave_one_out", "ablation"])]
    effects: Vec<String>,
    /// Cases with two effects.
    #[arg(long, value_name = "N", default_value_t = 30)]
    pairs: usize,
    /// Cases with five to eight effects at once, at most twice the noise each.
    #[arg(long, value_name = "N", default_value_t = 20)]
    several: usize,
    /// Cases without an effect.
    #[arg(long, value_name = "N", default_value_t = 50)]
    nulls: usize,
    /// Cases with an effect that no library knows.
    #[arg(long, value_name = "N", default_value_t = 30)]
    outside: usize,
    /// Heavy-tailed noise, setup drift with waves and trend, effects that vary over the volume.
    #[arg(long)]
    hard: bool,
    /// Take the true effect out of the tool's library; uses the single effects.
    #[arg(long, conflicts_with_all = ["leave_one_out", "ablation"])]
    without_truth: bool,
    /// A machine with many effects, the model given all but one, for each in turn.
    #[arg(long, conflicts_with = "ablation")]
    leave_one_out: bool,
    /// Run the nulls and the effects outside the library without gates, without drift, and with plain forward selection.
    #[arg(long)]
    ablation: bool,
    /// Only this case.
    #[arg(long, value_name = "N")]
    only: Option<usize>,
    /// Cases at a time [default: as many as there are processors].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(1..=64))]
    jobs: Option<u8>,
    /// The tool to test [default: the one of this program].
    #[arg(long, value_name = "VOLCOMP")]
    tool: Option<PathBuf>,
    /// Keep the session files of the cases.
    #[arg(long)]
    keep: bool,
    /// Ask the tool again about cases whose session files were kept in OUT.
    #[arg(long, requires = "keep")]
    again: bool,
    /// Print the figures as JSON, too.
    #[arg(long)]
    json: bool,
    /// Fail with exit code 70 where a bar is not reached.
    #[arg(long)]
    check: bool,
}

/// Asks the tool about the files of a case.
fn diagnose(tool: &Tool, folder: &Path, out: &str, more: &[String]) -> Result<String, Failure> {
    let words = ["diagnose", "--model", "model.toml", "--history", "history.csv", "--json", "--out", out];
    let words: Vec<String> = words.iter().map(|w| (*w).to_owned()).chain(more.iter().cloned()).collect();
    tool.run(folder, &words)
}

/// What stands in blind.json.
#[derive(serde::Serialize)]
struct Outcome {
    format: &'static str,
    seed: u64,
    generator: Generator,
    plan: String,
    mode: Mode,
    score: Score,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    ablations: Vec<Ablated>,
    cases: Vec<Judged>,
}

/// One ablation.
#[derive(serde::Serialize)]
struct Ablated {
    what: &'static str,
    null_alarms: Of,
    outside_named: Of,
}

/// The ways to take something away from the tool.
const ABLATIONS: [&str; 3] = ["no-gates", "no-drift", "plain"];

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    if args.generator.has_its_own_plan() && args.plan != Plan::Full {
        return Err(Failure::new(
            EX_USAGE,
            format_args!(
                "--generator {} has one plan of its own: leave --plan out, or give --plan full; the other plans \
                 are the twin's",
                args.generator
            ),
        ));
    }
    if args.generator == Generator::Multibody && args.leave_one_out {
        let why =
            "--leave-one-out needs machines without noise, which --generator multibody does not simulate";
        return Err(Failure::new(EX_USAGE, why));
    }
    let tool = Tool::new(args.tool.as_deref())?;
    let mode = if args.hard { Mode::Hard } else { Mode::Plain };
    let source = Source::open(args)?;
    let drawn = draw(args, &source, mode)?;
    let cases: Vec<Case> =
        drawn.iter().filter(|c| args.only.is_none_or(|n| c.number == n)).cloned().collect();
    let additions = if args.leave_one_out { Some(calibrate(args, &tool, &drawn)?) } else { None };
    let started = cases.len();
    let judged = all(args, &cases, &|case| play(args, &tool, &source, case, &drawn, additions.as_deref()))?;
    let mut ablations = Vec::new();
    if args.ablation {
        for what in ABLATIONS {
            let some = all(args, &cases, &|case| {
                let more = vec!["--ablate".to_owned(), what.to_owned()];
                answer(args, &tool, &source, case, &format!("{what}-{:04}", case.number), &more, false)
            })?;
            let score = Score::of(&some, args.hard);
            let any = Of {
                hits: some
                    .iter()
                    .filter(|j| j.kind == Kind::Outside && j.declared().next().is_some())
                    .count(),
                of: some.iter().filter(|j| j.kind == Kind::Outside).count(),
            };
            ablations.push(Ablated { what, null_alarms: score.null_alarms, outside_named: any });
        }
    }
    let score = Score::of(&judged, args.hard);
    let outcome = Outcome {
        format: "volcomp-blind/1",
        seed: args.seed,
        generator: args.generator,
        plan: format!("{:?}", args.plan),
        mode,
        score,
        ablations,
        cases: judged,
    };
    let text = serde_json::to_string_pretty(&outcome).map_err(|e| Failure::new(EX_SOFTWARE, e))?;
    save(&args.out.join("blind.json"), &format!("{text}\n"))?;
    if args.json {
        say!("{text}");
    } else {
        text_report::report(&outcome, started);
    }
    let missed: Vec<&str> = outcome.score.bars.iter().filter(|b| !b.holds).map(|b| b.what).collect();
    if args.check && !missed.is_empty() {
        return Err(Failure::new(EX_SOFTWARE, format_args!("bars not reached: {}", missed.join("; "))));
    }
    Ok(())
}

fn draw(args: &Args, source: &Source, mode: Mode) -> Result<Vec<Case>, Failure> {
    let failed =
        |e| Failure::new(if matches!(e, GeneratorError::Unknown { .. }) { EX_USAGE } else { EX_SOFTWARE }, e);
    let origin = Origin { generator: args.generator, effects: &source.effects, plan: args.plan, mode };
    if args.leave_one_out {
        return many(origin, args.seed).map_err(failed);
    }
    let pool = pool(origin, &args.effects).map_err(failed)?;
    let singles = args.singles.unwrap_or(pool.len());
    let counts = if args.without_truth {
        Draw { singles, pairs: 0, several: 0, nulls: 0, outside: 0 }
    } else if args.ablation {
        Draw { singles: 0, pairs: 0, several: 0, nulls: args.nulls, outside: args.outside }
    } else if args.effects.is_empty() {
        Draw { singles, pairs: args.pairs, several: args.several, nulls: args.nulls, outside: args.outside }
    } else {
        // what is asked of some effects says nothing of the others
        Draw { singles, pairs: 0, several: 0, nulls: 0, outside: 0 }
    };
    crate::blind::cases::draw(counts, origin, &args.effects, args.seed).map_err(failed)
}

/// Runs something for all cases, several at a time; progress on stderr.
#[expect(clippy::disallowed_methods, reason = "cases run on several threads")]
fn all(
    args: &Args,
    cases: &[Case],
    one: &(dyn Fn(&Case) -> Result<Judged, Failure> + Sync),
) -> Result<Vec<Judged>, Failure> {
    let processors = std::thread::available_parallelism().map_or(1, core::num::NonZero::get);
    let jobs = args.jobs.map_or(processors, usize::from);
    let (next, done) = (AtomicUsize::new(0), AtomicUsize::new(0));
    let results = Mutex::new(Vec::with_capacity(cases.len()));
    let terminal = std::io::stderr().is_terminal();
    std::thread::scope(|scope| {
        for _ in 0..jobs.min(cases.len()) {
            scope.spawn(|| {
                while let Some(case) = cases.get(next.fetch_add(1, Relaxed)) {
                    let result = one(case);
                    let n = done.fetch_add(1, Relaxed) + 1;
                    if terminal {
                        volcomp_cli::note_text(format_args!("\r{n} of {} cases", cases.len()));
                    } else if n % 20 == 0 || n == cases.len() {
                        note!("{n} of {} cases", cases.len());
                    }
                    results.lock().unwrap_or_else(PoisonError::into_inner).push(result);
                }
            });
        }
    });
    if terminal {
        note!();
    }
    let mut judged: Vec<Judged> =
        results.into_inner().unwrap_or_else(PoisonError::into_inner).into_iter().collect::<Result<_, _>>()?;
    judged.sort_by_key(|j| j.number);
    Ok(judged)
}

/// One case with what its kind asks of the tool.
fn play(
    args: &Args,
    tool: &Tool,
    source: &Source,
    case: &Case,
    cases: &[Case],
    additions: Option<&[PathBuf]>,
) -> Result<Judged, Failure> {
    let name = format!("{:04}", case.number);
    if let Some(additions) = additions {
        let mut whole = case.clone();
        whole.truth = case.truth.with_effects_of(cases.iter().map(|c| &c.truth));
        let mut more = Vec::new();
        for (other, path) in cases.iter().zip(additions) {
            if other.number != case.number {
                more.extend(["--add".to_owned(), path.display().to_string()]);
            }
        }
        return answer(args, tool, source, &whole, &name, &more, true);
    }
    if args.without_truth {
        let full = answer(args, tool, source, case, &format!("{name}-full"), &[], false)?;
        let more: Vec<String> =
            case.labels.iter().flat_map(|l| ["--without".to_owned(), l.clone()]).collect();
        let removed = Case { kind: Kind::Removed, ..case.clone() };
        let mut judged = answer(args, tool, source, &removed, &name, &more, false)?;
        // with the effect in its library the tool answers with a set: any member of it is a set answer
        let group: Vec<&String> = full.said.iter().filter(|s| s.right).flat_map(|s| &s.group).collect();
        for s in &mut judged.said {
            s.in_group |= group.contains(&&s.label)
                || full.said.iter().any(|f| f.in_group && !f.right && f.label == s.label);
        }
        return Ok(judged);
    }
    answer(args, tool, source, case, &name, &[], true)
}

/// Where a case goes.
struct Outputs {
    /// Its session files.
    folder: PathBuf,
    /// Its label.
    sealed: PathBuf,
}

/// Measures, seals the label, asks the tool, and only then opens the label again.
fn answer(
    args: &Args,
    tool: &Tool,
    source: &Source,
    case: &Case,
    name: &str,
    more: &[String],
    with_fresh: bool,
) -> Result<Judged, Failure> {
    let folder = args.out.join("cases").join(name);
    let sealed = args.out.join("sealed").join(format!("{name}.toml"));
    for made in [folder.as_path(), &args.out.join("sealed")] {
        crate::cli::make_folder(made).map_err(|e| Failure::in_file(EX_IOERR, made, e))?;
    }
    let outputs = Outputs { folder, sealed };
    let (case, written) = source.write(args, case, &outputs, with_fresh)?;
    let Outputs { folder, sealed } = outputs;
    let files = &written.sessions;
    let mut words: Vec<String> = files.iter().flat_map(|f| ["--data".to_owned(), f.clone()]).collect();
    if with_fresh {
        words.extend(["--fresh-history", "fresh/history.csv"].map(str::to_owned));
        words.extend(files.iter().flat_map(|f| ["--fresh".to_owned(), format!("fresh/{f}")]));
    }
    words.extend(more.iter().cloned());
    let label = toml::to_string(&case).map_err(|e| Failure::new(EX_SOFTWARE, e))?;
    save(&sealed, &label)?;
    let answer: Result<Report, String> = match diagnose(tool, &folder, "gap", &words) {
        Err(f) if f.code == EX_DATAERR => Err(f.message),
        said => Ok(serde_json::from_str(&said?).map_err(|e| Failure::new(EX_SOFTWARE, e))?),
    };
    let opened = super::read(&sealed, super::InputKind::Description)?;
    let truth: Case = toml::from_str(&opened).map_err(|e| Failure::in_file(EX_SOFTWARE, &sealed, e))?;
    let again = match &answer {
        Ok(report) => {
            let declared: Vec<String> = report.declared().collect();
            case_files::re_expressions(args, tool, &truth, &written, &folder, &declared)?
        }
        Err(_) => BTreeSet::new(),
    };
    if !args.keep {
        // the reports stay, the readings can be made again from the label
        for f in files.iter().map(String::as_str).chain(["history.csv", "fresh"]) {
            let path = folder.join(f);
            if path.exists() {
                crate::cli::remove(&path).map_err(|e| Failure::in_file(EX_IOERR, &path, e))?;
            }
        }
    }
    Ok(answer.map_or_else(|why| Judged::refused(&truth, why), |r| judge(&truth, &r, &again)))
}

/// What a careful workshop knows of its machine: each effect measured alone, with little noise, as an addition.
fn calibrate(args: &Args, tool: &Tool, cases: &[Case]) -> Result<Vec<PathBuf>, Failure> {
    cases
        .iter()
        .map(|case| {
            let folder = args.out.join("known").join(format!("{:04}", case.number));
            let quiet = case.truth.quiet().files(args.plan, case.days[1]);
            let files = write_all(&folder, quiet.map_err(|e| Failure::new(EX_SOFTWARE, e))?)?;
            let words: Vec<String> = files.iter().flat_map(|f| ["--data".to_owned(), f.clone()]).collect();
            diagnose(tool, &folder, "gap", &words)?;
            let path = folder.join("gap").join("addition.toml");
            path.canonicalize().map_err(|e| Failure::in_file(EX_IOERR, &path, e))
        })
        .collect()
}
