//! `cncsim dev scenarios`: everything that can go wrong, by number, against the real daemon.

use std::path::PathBuf;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::sync::{Mutex, PoisonError};

use rustix::process::{Resource, Rlimit, setrlimit};
use rustix::thread::{CapabilitySet, capabilities, set_capabilities};

use super::{EX_DATAERR, EX_SOFTWARE, EX_USAGE, Failure, InputKind, read};
use crate::demo::programs::Programs;
use crate::scenarios::{Pacing, Plan, Scenario, Verdict, run};

#[derive(Debug, clap::Args)]
#[command(
    after_help = "Examples:\n  cncsim dev scenarios                      all of them (about ten minutes on two processors)\n  \
    cncsim dev scenarios --list               numbers and names\n  \
    cncsim dev scenarios --only 101,300-399   one, and all about bytes on the link\n  \
    cncsim dev scenarios --seed 7 --json      with other noise and other damage, for a script\n  \
    cncsim dev scenarios --file mine.toml     a list of one's own (docs/reference/faults.md shows its keys)\n\n\
    Exit code 70 where a scenario does not hold; its number and the seed bring the same run back."
)]
pub(super) struct Args {
    /// Scenarios of one's own instead of the shipped ones.
    #[arg(long, value_name = "FILE")]
    file: Option<PathBuf>,
    /// Only these numbers: 101,205,300-399.
    #[arg(long, value_name = "N", value_delimiter = ',', value_parser = numbers)]
    only: Vec<[u32; 2]>,
    /// Numbers and names only.
    #[arg(long, conflicts_with_all = ["json", "table"])]
    list: bool,
    /// Seed of machine and link for all of them, instead of each one's own.
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    /// Scenarios at a time [default: as many as there are processors]. Those in real time run one by one, after the
    /// others.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(1..=64))]
    jobs: Option<u8>,
    /// One JSON list on stdout.
    #[arg(long)]
    json: bool,
    /// A Markdown table on stdout: number, what, what must hold, what was measured.
    #[arg(long, conflicts_with = "json")]
    table: bool,
}

/// `205` or `300-399`.
fn numbers(text: &str) -> Result<[u32; 2], String> {
    let number = |t: &str| t.trim().parse::<u32>().map_err(|_| format!("{text:?} is no number or range"));
    let (first, last) = text.split_once('-').unwrap_or((text, text));
    let range = [number(first)?, number(last)?];
    if range[0] > range[1] { Err(format!("{text:?} ends before it begins")) } else { Ok(range) }
}

pub(super) fn run_all(args: &Args) -> Result<(), Failure> {
    let chosen = choose(args)?;
    if args.list {
        for s in &chosen {
            say!("{:>4}  {}", s.number, s.name);
        }
        return Ok(());
    }
    let programs = Programs::this().map_err(|e| Failure::new(EX_SOFTWARE, format_args!("{e:#}")))?;
    let processors = std::thread::available_parallelism().map_or(1, core::num::NonZero::get);
    let jobs = args.jobs.map_or(processors, usize::from);
    // what runs in real time must not be disturbed by what runs as fast as it can
    let (in_time, fast): (Vec<_>, Vec<_>) = chosen.iter().partition(|s| s.pacing == Pacing::RealTime);
    let mut verdicts = play(&fast, &programs, jobs);
    verdicts.extend(play(&in_time, &programs, 1));
    verdicts.sort_by_key(|v| v.number);
    let failed: Vec<String> = verdicts.iter().filter(|v| !v.ok).map(|v| v.number.to_string()).collect();
    if args.json {
        let json = serde_json::to_string_pretty(&verdicts).map_err(|e| Failure::new(EX_SOFTWARE, e))?;
        say!("{json}");
    } else if args.table {
        table(&chosen, &verdicts);
    } else {
        say!("{} of {} scenarios hold", verdicts.len() - failed.len(), verdicts.len());
    }
    if failed.is_empty() {
        return Ok(());
    }
    Err(Failure::new(EX_SOFTWARE, format_args!("these scenarios do not hold: {}", failed.join(", "))))
}

/// The scenarios that are asked for.
fn choose(args: &Args) -> Result<Vec<Scenario>, Failure> {
    let plan = match &args.file {
        Some(path) => Plan::parse(&read(path, InputKind::Description)?)
            .map_err(|e| Failure::in_file(EX_DATAERR, path, format_args!("{e:#}")))?,
        None => Plan::shipped().map_err(|e| Failure::new(EX_SOFTWARE, format_args!("{e:#}")))?,
    };
    let within = |[first, last]: &[u32; 2], s: &Scenario| (*first..=*last).contains(&s.number);
    if let Some([first, last]) = args.only.iter().find(|r| !plan.scenarios.iter().any(|s| within(r, s))) {
        let what = if first == last { first.to_string() } else { format!("{first}-{last}") };
        return Err(Failure::new(EX_USAGE, format_args!("there is no scenario {what}; --list shows them")));
    }
    let wanted = |s: &Scenario| args.only.is_empty() || args.only.iter().any(|r| within(r, s));
    let mut chosen: Vec<Scenario> = plan.scenarios.into_iter().filter(wanted).collect();
    for scenario in &mut chosen {
        scenario.seed = args.seed.unwrap_or(scenario.seed);
    }
    Ok(chosen)
}

/// Gives up the permissions to take real-time priority and to lock memory.
pub(super) fn renounce() -> rustix::io::Result<()> {
    let none = Rlimit { current: Some(0), maximum: Some(0) };
    setrlimit(Resource::Memlock, none)?;
    setrlimit(Resource::Rtprio, none)?;
    // the superuser is bound by no limit
    let mut sets = capabilities(None)?;
    let gone = CapabilitySet::SYS_NICE | CapabilitySet::IPC_LOCK;
    for set in [&mut sets.effective, &mut sets.permitted, &mut sets.inheritable] {
        set.remove(gone);
    }
    set_capabilities(None, sets)
}

/// Runs the scenarios, `jobs` at a time, and tells of each on stderr when it ends.
#[expect(clippy::disallowed_methods, reason = "scenarios run on several threads")]
fn play(chosen: &[&Scenario], programs: &Programs, jobs: usize) -> Vec<Verdict> {
    let next = AtomicUsize::new(0);
    let verdicts = Mutex::new(Vec::with_capacity(chosen.len()));
    std::thread::scope(|scope| {
        for _ in 0..jobs {
            scope.spawn(|| {
                while let Some(scenario) = chosen.get(next.fetch_add(1, Relaxed)) {
                    let verdict =
                        run(scenario, programs).unwrap_or_else(|e| Verdict::impossible(scenario, &e));
                    report(&verdict);
                    verdicts.lock().unwrap_or_else(PoisonError::into_inner).push(verdict);
                }
            });
        }
    });
    verdicts.into_inner().unwrap_or_else(PoisonError::into_inner)
}

fn report(v: &Verdict) {
    note!(
        "{} {:>4}  {}{}\n           largest {} um, rms {} um, step {:.3} um, settled in {:.2} s, {}",
        if v.ok { "ok  " } else { "FAIL" },
        v.number,
        v.name,
        if v.runs > 1 { format!(" (run {})", v.runs) } else { String::new() },
        figure(v.largest_um),
        figure(v.rms_um),
        v.step_um,
        v.settle_s,
        v.state
    );
    for failure in &v.failures {
        note!("           does not hold: {failure} (seed {})", v.seed);
    }
}

fn figure(value: Option<f64>) -> String {
    value.map_or_else(|| "-".to_owned(), |v| format!("{v:.2}"))
}

/// The table of `docs/reference/faults.md`.
fn table(chosen: &[Scenario], verdicts: &[Verdict]) {
    say!(
        "| number | what goes wrong | must hold: residual, step / um, settled / s, state | told | measured |"
    );
    say!("|---|---|---|---|---|");
    for (s, v) in chosen.iter().zip(verdicts) {
        let a = &s.accept;
        say!(
            "| {} | {} | {}, {}, {}, {} | {} | {}, {:.2}, {:.2}, {}{} |",
            s.number,
            s.name,
            a.largest_um,
            a.step_um,
            a.settle_s,
            a.state,
            a.log.iter().filter(|w| w.starts_with("VC-")).cloned().collect::<Vec<_>>().join(" "),
            figure(v.largest_um),
            v.step_um,
            v.settle_s,
            v.state,
            if v.ok { "" } else { " **does not hold**" },
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_and_ranges_are_read() {
        assert_eq!(numbers("205"), Ok([205, 205]));
        assert_eq!(numbers("300-399"), Ok([300, 399]));
        for wrong in ["", "x", "5-", "-5", "9-3", "1-2-3"] {
            assert!(numbers(wrong).is_err(), "{wrong}");
        }
    }
}
