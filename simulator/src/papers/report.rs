//! The report of an experiment: the table, the plots of the first seed with each truth, what causes the rest, and the
//! commands to repeat it.

use volcomp_cli::report_page::{Page, Table};

use super::Outcome;
use super::figure::{Row, Spread, Truth};

/// A number with the decimals of its row.
#[must_use]
pub fn shown(row: &Row, value: f64) -> String {
    let text = format!("{value:.*}", row.decimals);
    if text.trim_start_matches('-').chars().all(|c| c == '0' || c == '.') {
        text.trim_start_matches('-').to_owned()
    } else {
        text
    }
}

/// The unit as a person reads it.
#[must_use]
pub fn unit(row: &Row) -> &'static str {
    match row.unit {
        "um" => "µm",
        other => other,
    }
}

/// Value of one seed, or median and 5 % worst of many.
#[must_use]
pub fn cell(row: &Row, spread: Option<Spread>, seeds: usize) -> String {
    match spread {
        None => String::new(),
        Some(s) if seeds == 1 => shown(row, s.median),
        Some(s) if row.limit.is_none() => {
            format!("{} ({} to {})", shown(row, s.median), shown(row, s.min), shown(row, s.max))
        }
        Some(s) => format!("{} (worst {})", shown(row, s.median), shown(row, s.worst_5_percent)),
    }
}

/// A share as a person reads it; a cause that takes back a part of another one has none.
#[must_use]
pub fn share(value: f64) -> String {
    if value > -0.005 {
        format!("{:.0} %", 100.0 * value.max(0.0))
    } else {
        format!("none, {:.0} % more without", -100.0 * value)
    }
}

/// `passed`, `MISSED` or nothing.
#[must_use]
pub const fn verdict(pass: Option<bool>) -> &'static str {
    match pass {
        Some(true) => "passed",
        Some(false) => "MISSED",
        None => "",
    }
}

/// The report as HTML.
#[must_use]
pub fn html(outcome: &Outcome) -> String {
    let e = outcome.experiment;
    let seeds = outcome.seeds.len();
    let mut page = Page::new(&format!("Paper {}: {}", e.number(), e.title()));
    let limits: Vec<Option<bool>> = e.rows().iter().map(|row| outcome.pass(row)).collect();
    let (kept, all) =
        (limits.iter().filter(|p| **p == Some(true)).count(), limits.iter().filter(|p| p.is_some()).count());
    page.lead(format_args!(
        "{kept} of {all} limits kept over {seeds} {}.",
        if seeds == 1 { "seed" } else { "seeds" }
    ));
    page.paragraph(e.procedure());
    let mut head = vec!["figure", "unit", ">paper"];
    head.extend(outcome.truths.iter().map(|truth| match truth {
        Truth::Kind => ">kind truth",
        Truth::Hard => ">hard truth",
    }));
    head.extend([">limit", ""]);
    Table::new(head).rows(rows(outcome)).put_stacked(&mut page);
    page.note(
        "Kind truth: the machine of the survey is the machine of the test, and instruments have noise only. Hard truth: heat, \
         load, axis interaction and wear between survey and test, and instruments with systematic errors. Over several \
         seeds: median, and in brackets the worst value after leaving out one seed in 20. Limits apply to both truths.",
    );
    let shares = outcome.shares();
    if !shares.is_empty() {
        page.heading("Causes of what is left, hard truth");
        page.bars(shares.iter().map(|s| (s.cause.clone(), s.share.max(0.0), share(s.share))));
        page.note(
            "Drop of the mean square of what is left when a cause alone is switched off, mean over the seeds. Causes \
             interact: the shares need not add up to 100 %, and a cause that takes back a part of another one has none: \
             without it more is left.",
        );
    }
    if let Some(first) = outcome.seeds.first() {
        for truth in [Truth::Kind, Truth::Hard] {
            let Some(run) = first.runs.get(&truth) else { continue };
            page.heading(format_args!("Seed {}, {} truth", first.seed, truth.name()));
            page.charts(&run.plots);
            for note in &run.notes {
                page.note(note);
            }
        }
    }
    let [first, last] = [outcome.seeds.first(), outcome.seeds.last()].map(|s| s.map_or(0, |s| s.seed));
    let only = match outcome.truths[..] {
        [one] => format!(" --truth {}", one.name()),
        _ => String::new(),
    };
    page.note(format_args!(
        "{}. Repeat: cncsim dev paper {} --seed {first} --seeds {seeds}{only}. The folder of each run holds its files and \
         commands.txt with every command.",
        if seeds == 1 { format!("Seed {first}") } else { format!("Seeds {first} to {last}") },
        e.number(),
    ));
    page.finish()
}

fn rows(outcome: &Outcome) -> Vec<Vec<String>> {
    let seeds = outcome.seeds.len();
    let or_nothing = |v: Option<String>| v.unwrap_or_default();
    let row = |row: &Row| {
        let paper = or_nothing(row.paper.map(|v| shown(row, v)));
        let mut cells = vec![row.name.to_owned(), unit(row).to_owned(), paper];
        cells.extend(outcome.truths.iter().map(|truth| cell(row, outcome.spread(row, *truth), seeds)));
        cells.push(or_nothing(row.limit.map(|l| l.to_string())));
        cells.push(verdict(outcome.pass(row)).to_owned());
        cells
    };
    outcome.experiment.rows().iter().map(row).collect()
}
