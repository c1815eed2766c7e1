//! `cncsim dev paper`: the experiments of the source papers.

use std::path::PathBuf;

use super::{EX_SOFTWARE, EX_USAGE, Failure};
use crate::demo::programs::Programs;
use crate::papers::figure::Truth;
use crate::papers::report::{cell, share, shown, unit, verdict};
use crate::papers::{EXPERIMENTS, Experiment, Options, Outcome, json, run};

/// Exit code where a limit is missed.
const EX_MISSED: u8 = 1;

#[derive(Debug, clap::Args)]
#[command(
    after_help = "Examples:\n  cncsim dev paper 004                        one seed, kind and hard truth\n  \
    cncsim dev paper all --seed 501 --seeds 20  every experiment on 20 seeds\n  \
    cncsim dev paper 000 --truth hard --json    figures of one truth, for a script\n\n\
    Exit code 0 where every limit holds, 1 where the 5 % worst of the seeds miss one."
)]
pub(super) struct Args {
    /// Number of the paper (000 to 004), or all.
    #[arg(value_name = "PAPER", value_parser = ["000", "001", "002", "003", "004", "all"])]
    paper: String,
    /// First seed of machine, instruments and conditions.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Number of seeds.
    #[arg(long, value_name = "K", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=1000))]
    seeds: u32,
    /// Truth of machine and instruments.
    #[arg(long, value_enum, default_value = "both")]
    truth: TruthArg,
    /// Do not find which share of the rest each cause has (saves the repetitions without it; two minutes a seed for 002).
    #[arg(long)]
    no_shares: bool,
    /// Folder for reports and all files; created where it does not exist.
    #[arg(long, value_name = "DIR", default_value = "papers-output")]
    out: PathBuf,
    /// Print the figures as JSON (volcomp-paper/1).
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum TruthArg {
    /// The machine of the survey is the machine of the test; instruments have noise only.
    Kind,
    /// Heat, load, axis interaction and wear between survey and test; instruments with systematic errors.
    Hard,
    /// Both, as two columns.
    Both,
}

impl TruthArg {
    fn truths(self) -> Vec<Truth> {
        match self {
            Self::Kind => vec![Truth::Kind],
            Self::Hard => vec![Truth::Hard],
            Self::Both => vec![Truth::Kind, Truth::Hard],
        }
    }
}

pub(super) fn paper(args: &Args) -> Result<(), Failure> {
    let chosen: Vec<&'static dyn Experiment> =
        EXPERIMENTS.iter().copied().filter(|e| args.paper == "all" || e.number() == args.paper).collect();
    if args.seed.checked_add(u64::from(args.seeds)).is_none() {
        return Err(Failure::new(EX_USAGE, "--seed plus --seeds is beyond the largest seed"));
    }
    let options = Options {
        folder: args.out.clone(),
        seed: args.seed,
        seeds: args.seeds,
        truths: args.truth.truths(),
        programs: Programs::this().map_err(|e| Failure::new(EX_SOFTWARE, format_args!("{e:#}")))?,
        shares: !args.no_shares,
    };
    let mut outcomes = Vec::new();
    for experiment in chosen {
        let outcome = run(experiment, &options, &mut |step| note!("{step}"))
            .map_err(|e| Failure::new(EX_SOFTWARE, format_args!("{e:#}")))?;
        outcomes.push(outcome);
    }
    if args.json {
        say!("{}", json(&outcomes));
    } else {
        outcomes.iter().for_each(print);
    }
    judge(&outcomes)
}

/// Exit code 1 where a limit is missed.
fn judge(outcomes: &[Outcome]) -> Result<(), Failure> {
    let missed: Vec<&str> = outcomes.iter().filter(|o| !o.holds()).map(|o| o.experiment.number()).collect();
    if missed.is_empty() {
        return Ok(());
    }
    Err(Failure::new(EX_MISSED, format_args!("limits missed: paper {}", missed.join(", "))))
}

fn print(outcome: &Outcome) {
    let seeds = outcome.seeds.len();
    say!();
    say!("Paper {}: {}", outcome.experiment.number(), outcome.experiment.title());
    say!("{:<58} {:>8} {:>20} {:>20} {:>8}", "figure", "paper", "kind truth", "hard truth", "limit");
    for row in outcome.experiment.rows() {
        let of = |truth| cell(row, outcome.spread(row, truth), seeds);
        let name =
            if row.unit.is_empty() { row.name.to_owned() } else { format!("{}, {}", row.name, unit(row)) };
        let line = format!(
            "{name:<58} {:>8} {:>20} {:>20} {:>8}  {}",
            row.paper.map_or_else(String::new, |v| shown(row, v)),
            of(Truth::Kind),
            of(Truth::Hard),
            row.limit.map_or_else(String::new, |l| l.to_string()),
            verdict(outcome.pass(row))
        );
        say!("{}", line.trim_end());
    }
    for s in outcome.shares() {
        say!("  of what is left, hard truth: {:<44} {:>6}", s.cause, share(s.share));
    }
    say!("report: {}", outcome.report.display());
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::papers::figure::{Limit, Row};
    use crate::papers::{Measured, SeedRun, Setting};

    struct OneLimit;

    impl Experiment for OneLimit {
        fn number(&self) -> &'static str {
            "009"
        }
        fn title(&self) -> &'static str {
            "a figure of its own"
        }
        fn procedure(&self) -> &'static str {
            ""
        }
        fn rows(&self) -> &'static [Row] {
            const ROWS: &[Row] = &[
                Row::limited("circle", "um", Some(4.0), Limit::AtMost(4.0), 1),
                Row::reported("circle before", "um", None, 1),
            ];
            ROWS
        }
        fn run(&self, _: &Setting, _: &mut dyn FnMut(&str)) -> anyhow::Result<Measured> {
            anyhow::bail!("it is not run")
        }
    }

    /// Outcome of one seed with these circles, kind and hard truth.
    fn outcome(circles: [f64; 2]) -> Outcome {
        let measured = |v| Measured { values: [("circle", v)].into(), ..Measured::default() };
        let truths = vec![Truth::Kind, Truth::Hard];
        let runs = truths.iter().copied().zip(circles.map(measured)).collect();
        Outcome {
            experiment: &OneLimit,
            truths,
            seeds: vec![SeedRun { seed: 7, runs }],
            report: PathBuf::from("report.html"),
        }
    }

    #[test]
    fn a_missed_limit_is_exit_code_1_and_stands_in_the_entry_of_its_truth() {
        assert!(judge(&[outcome([1.0, 4.0])]).is_ok());
        let missed = outcome([1.0, 4.5]);
        let entries = missed.json();
        let of = |i: usize| (entries[i]["truth"].clone(), entries[i]["figures"][0]["pass"].clone());
        assert_eq!([of(0), of(1)], [("kind".into(), true.into()), ("hard".into(), false.into())]);
        let figure = &entries[1]["figures"][0];
        assert_eq!(
            (&figure["ours"], &figure["limit"], &figure["paper"]),
            (&4.5.into(), &4.0.into(), &4.0.into())
        );
        assert_eq!(entries[1]["reported"][0]["ours"], serde_json::Value::Null);
        let failure = judge(&[outcome([1.0, 1.0]), missed]).unwrap_err();
        assert_eq!((failure.code, failure.message.contains("009")), (1, true));
    }

    #[test]
    fn every_experiment_has_a_number_of_its_own_and_limits() {
        let mut numbers: Vec<&str> = EXPERIMENTS.iter().map(|e| e.number()).collect();
        let count = numbers.len();
        numbers.sort_unstable();
        numbers.dedup();
        assert_eq!(numbers.len(), count);
        for e in EXPERIMENTS {
            assert!(e.rows().iter().any(|r| r.limit.is_some()), "{}", e.number());
        }
        assert_eq!(count, 5);
    }
}
