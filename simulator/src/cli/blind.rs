//! `cncsim blind`: does the diagnosis find what it was not told?

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
use crate::blind::{Case, Draw, Generator, Judged, Kind, Mode, Origin, Score, Truth, judge};
use crate::campaign::Plan;

#[derive(Debug, clap::Args)]
#[command(
    after_help = "Labels lie in OUT/sealed and are opened only after the tool has answered; the tool runs as a process \
    of its own, in a folder that holds the session files alone.\n\nExamples:\n  \
    cncsim blind --out blind                               the whole set, plain noise\n  \
    cncsim blind --out hard --hard                         heavy tails, drift with waves and trend, varying effects\n  \
    cncsim blind --out removed --without-truth             the true effect taken out of the tool's library\n  \
    cncsim blind --out all-but-one --leave-one-out         the model is given all effects but one\n  \
    cncsim blind --out other --generator trunnion          another machine, plan, formulas and noise\n  \
    cncsim blind --out some --effect wear --effect positioning --singles 24\n                                                         how sure a few names are\n  \
    cncsim blind --out plan --plan one-feed-ballbar        a plan that cannot see everything\n  \
    cncsim blind --out ablation --ablation                 proof that the tests can fail\n\n\
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
    /// What is measured; the trunnion has one plan of its own, full.
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
    if args.generator == Generator::Trunnion && args.plan != Plan::Full {
        return Err(Failure::new(
            EX_USAGE,
            "--generator trunnion has one plan of its own: leave --plan out, or give --plan full; the other plans \
             are the twin's",
        ));
    }
    let tool = Tool::new(args.tool.as_deref())?;
    let mode = if args.hard { Mode::Hard } else { Mode::Plain };
    let drawn = draw(args, mode)?;
    let cases: Vec<Case> =
        drawn.iter().filter(|c| args.only.is_none_or(|n| c.number == n)).cloned().collect();
    let additions = if args.leave_one_out { Some(calibrate(args, &tool, &drawn)?) } else { None };
    let started = cases.len();
    let judged = all(args, &cases, &|case| play(args, &tool, case, &drawn, additions.as_deref()))?;
    let mut ablations = Vec::new();
    if args.ablation {
        for what in ABLATIONS {
            let some = all(args, &cases, &|case| {
                let more = vec!["--ablate".to_owned(), what.to_owned()];
                answer(args, &tool, case, &format!("{what}-{:04}", case.number), &more, false)
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
        report(&outcome, started);
    }
    let missed: Vec<&str> = outcome.score.bars.iter().filter(|b| !b.holds).map(|b| b.what).collect();
    if args.check && !missed.is_empty() {
        return Err(Failure::new(EX_SOFTWARE, format_args!("bars not reached: {}", missed.join("; "))));
    }
    Ok(())
}

fn draw(args: &Args, mode: Mode) -> Result<Vec<Case>, Failure> {
    let failed =
        |e| Failure::new(if matches!(e, GeneratorError::Unknown { .. }) { EX_USAGE } else { EX_SOFTWARE }, e);
    let origin = Origin { generator: args.generator, plan: args.plan, mode };
    if args.leave_one_out {
        return many(origin, args.seed).map_err(failed);
    }
    let pool = pool(args.generator, &args.effects).map_err(failed)?;
    let singles = args.singles.unwrap_or(pool.len());
    let counts = if args.without_truth {
        Draw { singles, pairs: 0, nulls: 0, outside: 0 }
    } else if args.ablation {
        Draw { singles: 0, pairs: 0, nulls: args.nulls, outside: args.outside }
    } else if args.effects.is_empty() {
        Draw { singles, pairs: args.pairs, nulls: args.nulls, outside: args.outside }
    } else {
        // what is asked of some effects says nothing of the others
        Draw { singles, pairs: 0, nulls: 0, outside: 0 }
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
        return answer(args, tool, &whole, &name, &more, true);
    }
    if args.without_truth {
        let full = answer(args, tool, case, &format!("{name}-full"), &[], false)?;
        let more: Vec<String> =
            case.labels.iter().flat_map(|l| ["--without".to_owned(), l.clone()]).collect();
        let removed = Case { kind: Kind::Removed, ..case.clone() };
        let mut judged = answer(args, tool, &removed, &name, &more, false)?;
        // what the whole library cannot tell from the truth is no innocent
        let group: Vec<&String> = full.said.iter().filter(|s| s.in_group).flat_map(|s| &s.group).collect();
        for s in &mut judged.said {
            s.in_group |=
                group.contains(&&s.label) || full.said.iter().any(|f| f.in_group && f.label == s.label);
        }
        return Ok(judged);
    }
    answer(args, tool, case, &name, &[], true)
}

/// Measures, seals the label, asks the tool, and only then opens the label again.
fn answer(
    args: &Args,
    tool: &Tool,
    case: &Case,
    name: &str,
    more: &[String],
    with_fresh: bool,
) -> Result<Judged, Failure> {
    let folder = args.out.join("cases").join(name);
    let files = write(&folder, &case.truth, args.plan, case.days[0])?;
    let mut words: Vec<String> = files.iter().flat_map(|f| ["--data".to_owned(), f.clone()]).collect();
    if with_fresh {
        words.extend(["--fresh-history", "fresh/history.csv"].map(str::to_owned));
        for f in write(&folder.join("fresh"), &case.truth, args.plan, case.days[1])? {
            words.extend(["--fresh".to_owned(), format!("fresh/{f}")]);
        }
    }
    words.extend(more.iter().cloned());
    let sealed = args.out.join("sealed").join(format!("{name}.toml"));
    let label = toml::to_string(case).map_err(|e| Failure::new(EX_SOFTWARE, e))?;
    crate::cli::make_folder(args.out.join("sealed")).map_err(|e| Failure::in_file(EX_IOERR, &sealed, e))?;
    save(&sealed, &label)?;
    let answer: Result<Report, String> = match diagnose(tool, &folder, "gap", &words) {
        Err(f) if f.code == EX_DATAERR => Err(f.message),
        said => Ok(serde_json::from_str(&said?).map_err(|e| Failure::new(EX_SOFTWARE, e))?),
    };
    let opened = super::read(&sealed, super::InputKind::Description)?;
    let truth: Case = toml::from_str(&opened).map_err(|e| Failure::in_file(EX_SOFTWARE, &sealed, e))?;
    if !args.keep {
        // the reports stay, the readings can be made again from the label
        let other = with_fresh.then_some("fresh");
        for f in files.iter().map(String::as_str).chain(["history.csv"]).chain(other) {
            let path = folder.join(f);
            crate::cli::remove(&path).map_err(|e| Failure::in_file(EX_IOERR, &path, e))?;
        }
    }
    Ok(answer.map_or_else(|why| Judged::refused(&truth, why), |r| judge(&truth, &r)))
}

/// What a careful workshop knows of its machine: each effect measured alone, with little noise, as an addition.
fn calibrate(args: &Args, tool: &Tool, cases: &[Case]) -> Result<Vec<PathBuf>, Failure> {
    cases
        .iter()
        .map(|case| {
            let folder = args.out.join("known").join(format!("{:04}", case.number));
            let files = write(&folder, &case.truth.quiet(), args.plan, case.days[1])?;
            let words: Vec<String> = files.iter().flat_map(|f| ["--data".to_owned(), f.clone()]).collect();
            diagnose(tool, &folder, "gap", &words)?;
            let path = folder.join("gap").join("addition.toml");
            path.canonicalize().map_err(|e| Failure::in_file(EX_IOERR, &path, e))
        })
        .collect()
}

/// Measures a machine on a day and writes what the tool is given; the names of the session files.
fn write(folder: &Path, truth: &Truth, plan: Plan, day: u64) -> Result<Vec<String>, Failure> {
    let files = truth.files(plan, day).map_err(|e| Failure::new(EX_SOFTWARE, e))?;
    write_all(folder, files)
}

fn report(outcome: &Outcome, cases: usize) {
    let s = &outcome.score;
    say!("{cases} cases of the {}, plan {}, seed {}", outcome.generator, outcome.plan, outcome.seed);
    for why in outcome.cases.iter().filter_map(|j| j.refused.as_deref()) {
        say!("  refused, no answer: {why}");
    }
    for b in &s.bars {
        let holds = if b.holds { "holds" } else { "MISSED" };
        let [low, high] = b.limits;
        say!("  {:46} {:6.3}  of {:4}  limits {low:.2} to {high:.2}  {holds}", b.what, b.value, b.of);
    }
    let of = |what: &str, o: Of| {
        if o.of > 0 {
            say!("  {what:46} {} of {}", o.hits, o.of);
        }
    };
    of("single: declared alone", s.single_exact);
    for (level, o) in &s.by_level {
        of(&format!("single named first at {level} times the noise"), *o);
    }
    of("pairs: both found", s.pair_both);
    of("pairs: both found up to groups, nothing else", s.pair_in_group);
    of("outside: given a name", s.outside_named);
    of("outside: silent", s.outside_silent);
    of("removed: nothing declared with confidence", s.removed_honest);
    of("all but one: inside its group", s.left_out_in_group);
    of("claims outside the group of the truth", s.claims_outside_group);
    if s.coverage.of > 0 {
        say!("  mean half width of the shrink interval         {:.3}", s.half_width);
    }
    for a in &outcome.ablations {
        of(&format!("{}: no effect, declared anyway", a.what), a.null_alarms);
        of(&format!("{}: outside, given a name", a.what), a.outside_named);
    }
    if !s.confusion.is_empty() {
        say!("what was taken for what (everything else is right):");
    }
    for c in &s.confusion {
        say!("  {:34} said {:28} {}", c.truth, c.said, c.count);
    }
}
