//! Text of `diagnose` on stdout: the summary, the effects, what a plan can detect.

use crate::exit;
use crate::prelude::*;
use volcomp_diagnose::Diagnosis;
use volcomp_diagnose::library::{EFFECTS, Effect, Kind};
use volcomp_diagnose::plan::PlanReport;
use volcomp_diagnose::report::Cause;
use volcomp_diagnose::session::Session;

use super::terms::{
    Compensable, headline, name, of_group, parameters, peak_to_valley, percent, remedy, um, with_uncertainty,
};

/// Drift below this share of the noise hides nothing.
const DRIFT_TOLD: f64 = 0.1;

const fn kind(kind: Kind) -> &'static str {
    match kind {
        Kind::Machine => "machine",
        Kind::Instrument => "instrument",
        Kind::Stochastic => "stochastic",
    }
}

/// The name of an effect with what may stand behind its colon.
fn with_subject(e: &Effect) -> String {
    let words = e.subjects.words();
    if words.is_empty() { e.name.to_owned() } else { format!("{}:<{words}>", e.name) }
}

/// All effects in a line each, or the page of one.
pub(super) fn list_effects(name: &str) -> Result<()> {
    if name.is_empty() {
        for e in EFFECTS {
            say!("{:38} {:10} {}", with_subject(e), kind(e.kind), e.cause);
        }
        say!();
        let such = "ram-sag or pige";
        say!("volcomp diagnose --list-effects NAME explains one; synonyms count, such as {such}.");
        return Ok(());
    }
    let stem = name.split(':').next().unwrap_or(name).to_ascii_lowercase();
    let Some(e) = Effect::find(&stem) else {
        let names = EFFECTS.iter().map(|e| e.name).joined(", ");
        return Err(usage!("--list-effects {name}: no such effect; effects are {names}"));
    };
    say!("{}", with_subject(e));
    say!("  also called     {}", e.synonyms.split(' ').joined(", "));
    say!("  kind            {}", kind(e.kind));
    say!("  cause           {}", e.cause);
    say!("  formula         {}", e.formula);
    say!("  looks like      {}", e.looks_like);
    say!("  confused with   {}", e.confused_with);
    say!("  settled by      {}", e.settles);
    Ok(())
}

/// Causes that are not established and are listed on stdout, at most.
const CANDIDATES: usize = 5;
/// Reasons for which effects cannot be identified that are listed on stdout, at most.
const REASONS: usize = 4;
/// Width of the column of names.
const NAME: usize = 44;

/// The report in a few lines; the first `stated` notes stand on stderr already.
pub(super) fn summary(
    session: &Session,
    found: &Diagnosis,
    compensable: &Compensable,
    stated: usize,
    out: Option<&Path>,
) -> Result<()> {
    let r = &found.report;
    say!("{}: {}", r.verdict.words(), headline(found));
    say!("{} of {} used", r.rows_used, counted(r.rows, "reading"));
    table(found, compensable);
    if let Some(f) = &r.fresh {
        let ([before, after], less) = ([f.rms_before_um, f.rms_after_um].map(um), percent(f.fraction));
        say!("observed on fresh data: {before} -> {after} µm RMS, {less} less");
    }
    let drifts = r.noise.iter().filter(|n| n.drift_um > DRIFT_TOLD * n.white_um);
    for all in drifts.collect::<Vec<_>>().chunk_by(|a, b| (a.drift_um, a.drift_s) == (b.drift_um, b.drift_s))
    {
        let names = all.iter().map(|n| n.instrument.as_str()).joined(", ");
        let whites = all.iter().map(|n| um(n.white_um)).joined(", ");
        let (drift, span) = (um(all[0].drift_um), session.span(all[0].drift_s));
        say!("drift of {names}: {drift} µm over {span}, noise {whites} µm; slow effects may be hidden by it");
    }
    for p in r.places.iter().take(4) {
        let of = if p.of.is_empty() { String::new() } else { format!(" {}", p.of) };
        let (by, share, detail) = (&p.by, percent(p.share), &p.detail);
        say!("where (shares overlap): {by}{of}, {share} of the structured gap ({detail})");
    }
    if r.unexplained.significant {
        say!("unexplained: {} µm RMS; {}", um(r.unexplained.rms_um), r.unexplained.looks_like);
    }
    for o in r.outlying_readings.iter().take(6) {
        say!("outlier left out: {}", o.words(um));
    }
    for n in r.next_measurement.iter().take(2) {
        say!("next measurement, about {:.0} min: {}; it {}", n.minutes, n.action, n.decides);
    }
    unidentifiable(found);
    for n in r.notes.iter().skip(stated) {
        say!("note: {n}");
    }
    match out {
        Some(out) => say!("written: {}", out.join("report.html").display()),
        None => say!("nothing written; --out DIR writes report.html, report.json and addition.toml"),
    }
    Ok(())
}

/// Causes with size, share, probability and remedy, then what is left.
fn table(found: &Diagnosis, compensable: &Compensable) {
    let r = &found.report;
    let shares = found.budget.shares();
    let declared = found.budget.sorted(r.causes.iter().filter(|c| c.declared));
    let others = || r.causes.iter().filter(|c| !c.declared).take(CANDIDATES);
    if !declared.is_empty() {
        say!();
        say!("  {:NAME$} {:>15} {:>6}  {:>5}  remedy", "cause", "size, µm (k=2)", "share", "prob.");
        for c in declared {
            let label = c.label();
            let correction = found.budget.correction(&label);
            let size = correction.map_or_else(|| "-".to_owned(), |x| with_uncertainty(x.size_um));
            let share = correction.map_or_else(|| "-".to_owned(), |x| percent(x.share));
            let (name, p) = (format!("{} ({label})", name(&c.effect, &c.subject)), c.probability);
            say!("  {name:NAME$} {size:>15} {share:>6}  {p:>5.2}  {}", remedy(c, found));
            let mut values = parameters(found, c);
            if values.is_empty() {
                values.extend(peak_to_valley(found, &label));
            }
            if !values.is_empty() {
                say!("      {}", values.join(", "));
            }
            if c.kind != Kind::Stochastic {
                say!("      volcompd: {}", compensable.words(c, found));
            }
            doubts(c);
        }
        let rest = [
            ("not explained", found.budget.unexplained_um, shares.unexplained),
            ("roughness of curves", found.budget.roughness_um, shares.roughness),
            ("drift", found.budget.drift_um, shares.drift),
            ("noise", found.budget.noise_um, shares.noise),
        ];
        for (what, size, share) in rest.into_iter().filter(|r| r.2 > 5e-4) {
            say!("  {what:NAME$} {:>15} {:>6}", um(size), percent(share));
        }
        say!();
    }
    for c in others() {
        let (name, label, p) = (name(&c.effect, &c.subject), c.label(), c.probability);
        say!("not established: {name} ({label}), probability {p:.2}");
        doubts(c);
    }
}

/// What the data cannot show: the reasons with most effects, each effect named once with all of its subjects.
fn unidentifiable(found: &Diagnosis) {
    let unseen = &found.report.cannot_be_seen;
    if unseen.is_empty() {
        return;
    }
    let mut reasons: BTreeMap<&str, BTreeMap<&str, Vec<&str>>> = BTreeMap::new();
    for u in unseen {
        let (name, subject) = u.effect.split_once(':').unwrap_or((&u.effect, ""));
        reasons.entry(&u.because).or_default().entry(name).or_default().push(subject);
    }
    let mut reasons: Vec<_> = reasons.into_iter().collect();
    let count = |names: &BTreeMap<&str, Vec<&str>>| names.values().map(Vec::len).sum::<usize>();
    reasons.sort_by_key(|(_, names)| core::cmp::Reverse(count(names)));
    let effects = counted(unseen.len(), "effect");
    say!("not identifiable from these data: {effects} (all in report.json, cannot_be_seen)");
    for (because, names) in reasons.iter().take(REASONS) {
        let named =
            |(name, of): (&&str, &Vec<&str>)| format!("{name} {}", of.join(" ")).trim_end().to_owned();
        say!("      {}: {because}", names.iter().map(named).joined(", "));
    }
}

fn doubts(c: &Cause) {
    if !c.confounded_with.is_empty() {
        say!("      not separable from {}{}", c.confounded_with.join(", "), of_group(c));
    }
    if !c.re_expression_of.is_empty() {
        say!("      equivalent here to {}", c.re_expression_of.join(" or "));
    }
    if !c.remark.is_empty() {
        say!("      {}", c.remark);
    }
}

/// What a plan sees.
pub(super) fn plan(p: &PlanReport, json: bool) -> Result<()> {
    if json {
        let text = serde_json::to_string_pretty(p).map_err(|e| failure!(crate::EX_SOFTWARE, "{e}"))?;
        return exit::print(&format!("{text}\n"));
    }
    let (rows, setups, seen) =
        (counted(p.rows, "row"), counted(p.setups, "setup"), counted(p.seen.len(), "effect"));
    say!("{rows} in {setups}; {seen} can be seen");
    for class in &p.confounded {
        say!("confounded: {}", class.join(" = "));
    }
    for b in &p.blind_spots {
        say!("cannot be seen: {:28} {}", b.effect, b.because);
    }
    for n in &p.notes {
        say!("note: {n}");
    }
    Ok(())
}
