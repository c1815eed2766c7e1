//! Text of `diagnose` on stdout: the summary, the effects, what a plan can detect.

use std::collections::BTreeMap;
use std::path::Path;

use crate::{EX_USAGE, Failure, exit};
use volcomp_diagnose::library::{Kind, PAGES, page};
use volcomp_diagnose::plan::PlanReport;
use volcomp_diagnose::report::Report;

/// Drift below this share of the noise hides nothing.
const DRIFT_TOLD: f64 = 0.1;

const fn kind(kind: Kind) -> &'static str {
    match kind {
        Kind::Machine => "machine",
        Kind::Instrument => "instrument",
        Kind::Stochastic => "stochastic",
    }
}

/// All effects in a line each, or the page of one.
pub(super) fn list_effects(name: &str) -> Result<(), Failure> {
    if name.is_empty() {
        for p in PAGES {
            let subject = if p.subject.is_empty() { String::new() } else { format!(":<{}>", p.subject) };
            say!("{:38} {:10} {}", format!("{}{subject}", p.effect), kind(p.kind), p.cause);
        }
        say!();
        say!(
            "volcomp diagnose --list-effects NAME explains one; synonyms count, such as {}.",
            "ram-sag or pige"
        );
        return Ok(());
    }
    let stem = name.split(':').next().unwrap_or(name).to_ascii_lowercase();
    let Some(p) = page(&stem) else {
        let names: Vec<&str> = PAGES.iter().map(|p| p.effect).collect();
        return Err(Failure::new(
            EX_USAGE,
            format_args!("error: --list-effects {name}: no such effect; effects are {}", names.join(", ")),
        ));
    };
    say!("{}{}", p.effect, if p.subject.is_empty() { String::new() } else { format!(":<{}>", p.subject) });
    say!("  also called     {}", p.synonyms.split(' ').collect::<Vec<_>>().join(", "));
    say!("  kind            {}", kind(p.kind));
    say!("  cause           {}", p.cause);
    say!("  formula         {}", p.formula);
    say!("  looks like      {}", p.looks_like);
    say!("  confused with   {}", p.confused_with);
    say!("  settled by      {}", p.settles);
    Ok(())
}

/// The report in a few lines.
pub(super) fn summary(r: &Report, out: Option<&Path>) -> Result<(), Failure> {
    say!(
        "{}: gap {:.2} um RMS, noise {:.2} um, {} of {} rows used",
        r.verdict.words(),
        r.gap.rms_um,
        r.gap.noise_um,
        r.rows_used,
        r.rows
    );
    for c in &r.causes {
        let mark = if c.declared { "*" } else { " " };
        let values: Vec<String> =
            c.parameters.iter().take(4).map(|(n, v)| format!("{n} {:.4} +- {:.4}", v.value, v.std)).collect();
        say!("{mark} {:24} probability {:.2}  {}", c.label(), c.probability, values.join(", "));
        if !c.confounded_with.is_empty() {
            say!("    cannot be told from {}", c.confounded_with.join(", "));
        }
        if !c.re_expression_of.is_empty() {
            say!("    says here what {} would say", c.re_expression_of.join(" or "));
        }
        if !c.remark.is_empty() {
            say!("    {}", c.remark);
        }
    }
    if r.causes.iter().any(|c| c.declared) {
        say!(
            "expected on new data: {:.2} -> {:.2} um, {:.0} % less (90 %: {:.0} to {:.0} %)",
            r.shrink.rms_before_um,
            r.shrink.rms_after_um,
            100.0 * r.shrink.fraction,
            100.0 * r.shrink.ci90[0],
            100.0 * r.shrink.ci90[1]
        );
    }
    if let Some(f) = &r.fresh {
        say!(
            "seen on fresh data: {:.2} -> {:.2} um, {:.0} % less",
            f.rms_before_um,
            f.rms_after_um,
            100.0 * f.fraction
        );
    }
    for n in r.noise.iter().filter(|n| n.drift_um > DRIFT_TOLD * n.white_um) {
        say!(
            "  drift of {}: {:.2} um over {:.0} s beside noise of {:.2} um; a slow effect may hide in it",
            n.instrument,
            n.drift_um,
            n.drift_s,
            n.white_um
        );
    }
    for p in r.places.iter().take(6) {
        say!("  where: {} {} {:.0} % ({})", p.by, p.of, 100.0 * p.share, p.detail);
    }
    if r.unexplained.significant {
        say!("unexplained: {:.2} um RMS; {}", r.unexplained.rms_um, r.unexplained.looks_like);
    }
    for o in r.outlying_readings.iter().take(6) {
        say!("  left out: {} lies {:.1} um apart from its repeats", o.at, o.apart_um);
    }
    for n in r.next_measurement.iter().take(3) {
        say!("  next: {} (separates {})", n.action, n.separates.join(", "));
    }
    let mut reasons: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    for u in &r.cannot_be_seen {
        reasons.entry(&u.because).or_default().push(&u.effect);
    }
    for (because, effects) in reasons {
        say!("  cannot be seen: {} ({because})", effects.join(", "));
    }
    for n in &r.notes {
        say!("  note: {n}");
    }
    if let Some(out) = out {
        say!("written: {}", out.join("report.html").display());
    }
    Ok(())
}

/// What a plan sees.
pub(super) fn plan(p: &PlanReport, json: bool) -> Result<(), Failure> {
    if json {
        let text = serde_json::to_string_pretty(p)
            .map_err(|e| Failure::new(crate::EX_SOFTWARE, format_args!("error: {e}")))?;
        return exit::print(&format!("{text}\n"));
    }
    say!("{} rows in {} setups; {} effects can be seen", p.rows, p.setups, p.seen.len());
    for class in &p.confounded {
        say!("cannot be told apart: {}", class.join(" = "));
    }
    for b in &p.blind_spots {
        say!("cannot be seen: {:28} {}", b.effect, b.because);
    }
    for n in &p.notes {
        say!("note: {n}");
    }
    Ok(())
}
