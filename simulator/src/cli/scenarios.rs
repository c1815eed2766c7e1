//! `cncsim scenarios`: everything that can go wrong, by number, against the real daemon.

use std::path::PathBuf;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::sync::{Mutex, PoisonError};

use rustix::process::{Resource, Rlimit, setrlimit};
use rustix::thread::{CapabilitySet, capabilities, set_capabilities};

use super::{EX_DATAERR, EX_SOFTWARE, EX_USAGE, Failure, read};
use crate::demo::programs::Programs;
use crate::scenarios::{Plan, Scenario, Verdict, run};

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n  cncsim scenarios --list\n  cncsim scenarios --only 101,205\n  \
    cncsim scenarios --file mine.toml --json\n\nExit code 70 where a scenario does not hold.")]
pub(super) struct Args {
    /// Scenarios of one's own instead of the shipped ones.
    #[arg(long, value_name = "FILE")]
    file: Option<PathBuf>,
    /// Only these numbers.
    #[arg(long, value_name = "N", value_delimiter = ',')]
    only: Vec<u32>,
    /// Numbers and names only.
    #[arg(long)]
    list: bool,
    /// Scenarios at a time; those in real time disturb each other on a small computer.
    #[arg(long, value_name = "N", default_value = "1")]
    jobs: usize,
    /// One JSON list on stdout.
    #[arg(long)]
    json: bool,
}

pub(super) fn run_all(args: &Args) -> Result<(), Failure> {
    let plan = match &args.file {
        Some(path) => Plan::parse(&read(path)?)
            .map_err(|e| Failure::in_file(EX_DATAERR, path, format_args!("{e:#}")))?,
        None => Plan::shipped().map_err(|e| Failure::new(EX_SOFTWARE, format_args!("{e:#}")))?,
    };
    if let Some(unknown) = args.only.iter().find(|n| plan.scenarios.iter().all(|s| s.number != **n)) {
        let message = format_args!("there is no scenario {unknown}; --list shows them");
        return Err(Failure::new(EX_USAGE, message));
    }
    let wanted = |s: &Scenario| args.only.is_empty() || args.only.contains(&s.number);
    let chosen: Vec<Scenario> = plan.scenarios.into_iter().filter(wanted).collect();
    if args.list {
        for s in &chosen {
            say!("{:>4}  {}", s.number, s.name);
        }
        return Ok(());
    }
    let programs = Programs::this().map_err(|e| Failure::new(EX_SOFTWARE, format_args!("{e:#}")))?;
    let verdicts = play(&chosen, &programs, args.jobs.max(1));
    let failed = verdicts.iter().filter(|v| !v.ok).count();
    if args.json {
        let json = serde_json::to_string_pretty(&verdicts).map_err(|e| Failure::new(EX_SOFTWARE, e))?;
        say!("{json}");
    } else {
        say!("{} of {} scenarios hold", verdicts.len() - failed, verdicts.len());
    }
    if failed > 0 {
        return Err(Failure::new(EX_SOFTWARE, format_args!("{failed} scenarios do not hold")));
    }
    Ok(())
}

/// Gives up the permissions to take real-time priority and to lock memory.
pub(super) fn renounce() -> rustix::io::Result<()> {
    let none = Rlimit { current: Some(0), maximum: Some(0) };
    setrlimit(Resource::Memlock, none.clone())?;
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
fn play(chosen: &[Scenario], programs: &Programs, jobs: usize) -> Vec<Verdict> {
    let next = AtomicUsize::new(0);
    let verdicts = Mutex::new(Vec::with_capacity(chosen.len()));
    std::thread::scope(|scope| {
        for _ in 0..jobs {
            scope.spawn(|| {
                while let Some(scenario) = chosen.get(next.fetch_add(1, Relaxed)) {
                    let verdict =
                        run(scenario, programs).unwrap_or_else(|e| Verdict::impossible(scenario, &e));
                    tell(&verdict);
                    verdicts.lock().unwrap_or_else(PoisonError::into_inner).push(verdict);
                }
            });
        }
    });
    let mut verdicts = verdicts.into_inner().unwrap_or_else(PoisonError::into_inner);
    verdicts.sort_by_key(|v: &Verdict| v.number);
    verdicts
}

fn tell(v: &Verdict) {
    let figure = |v: Option<f64>| v.map_or_else(|| "-".to_owned(), |v| format!("{v:.2}"));
    eprintln!(
        "{} {:>4}  {:<62} largest {:>6} um, rms {:>6} um, step {:.3} um, settled in {:.2} s, {}",
        if v.ok { "ok  " } else { "FAIL" },
        v.number,
        v.name,
        figure(v.largest_um),
        figure(v.rms_um),
        v.step_um,
        v.settle_s,
        v.state
    );
    for failure in &v.failures {
        eprintln!("           {failure}");
    }
}
