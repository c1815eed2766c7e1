//! Health, the last minute and the benefit, as a person reads them.

use std::fmt::Write;

use super::Paint;
use super::{duration, latency};
use volcomp_daemon::{CodeCount, Status};

/// The verdict with its cause and remedy, and what compensation gains.
pub(super) fn write_health(f: &mut String, status: &Status, paint: Paint) -> std::fmt::Result {
    let health = &status.health;
    let verdict = match health.verdict.as_str() {
        "ok" => paint.green("ok"),
        "warning" | "held" => paint.yellow(&health.verdict.to_uppercase()),
        other => paint.red(&other.to_uppercase()),
    };
    write!(f, "health      {verdict}, {} for {}", status.state, duration(status.state_since_s))?;
    if let Some(code) = &health.code {
        write!(f, "; {code}")?;
    }
    if !health.cause.is_empty() {
        let cause = health.code.as_ref().and_then(|code| health.cause.strip_prefix(code.as_str()));
        let cause = cause.map_or(health.cause.as_str(), |rest| rest.trim_start_matches([':', ' ']));
        write!(f, ": {cause}")?;
    }
    writeln!(f)?;
    if !health.remedy.is_empty() {
        writeln!(f, "remedy      {}", health.remedy)?;
    }
    if let Some(benefit) = &status.benefit {
        writeln!(
            f,
            "benefit     predicted tool-tip error {:.1} um without, {:.1} um with compensation; last hour {:.1} and {:.1} um rms",
            benefit.without_um, benefit.with_um, benefit.without_rms_um, benefit.with_rms_um
        )?;
    }
    Ok(())
}

/// The rest of the line of the model.
pub(super) fn write_coverage(f: &mut String, status: &Status) -> std::fmt::Result {
    let errors = &status.model_errors;
    if errors.possible > 0 {
        write!(f, ", {} of {} error motions", errors.covered, errors.possible)?;
    }
    writeln!(f)
}

/// Late cycles, drop-outs and latency of the last minute.
pub(super) fn write_latency(f: &mut String, status: &Status) -> std::fmt::Result {
    let recent = &status.recent;
    write!(f, "last {:>2.0} s   {} cycles", recent.window_s, recent.cycles)?;
    if let Some(share) = recent.late_share {
        let (late, skipped) = (recent.late_cycles, recent.skipped_cycles);
        write!(f, ", late {late} ({:.4} %), skipped {skipped}", 100.0 * share)?;
    }
    write!(f, ", drop-outs {}", recent.drop_outs)?;
    let figures = [
        ("age", recent.age_us_p50, recent.age_us_p99),
        ("round trip", recent.roundtrip_us_p50, recent.roundtrip_us_p99),
    ];
    for (name, p50, p99) in figures {
        if let (Some(p50), Some(p99)) = (p50, p99) {
            write!(f, "; {name} p50 {}, p99 {}", latency(p50), latency(p99))?;
        }
    }
    writeln!(f)
}

/// Every warning and fault of the last minute, by number.
pub(super) fn write_warnings(f: &mut String, status: &Status, paint: Paint) -> std::fmt::Result {
    for warning in &status.recent.warnings {
        let label =
            if warning.severity == "fault" { paint.red("faulted ") } else { paint.yellow("warning ") };
        let CodeCount { code, name, count, text, age_s, present, .. } = warning;
        let over = if *present { "" } else { ", over" };
        writeln!(f, "{label}    {code} {name} x {count}, {} ago{over}: {text}", duration(*age_s))?;
    }
    if status.recent.warnings.is_empty() {
        writeln!(f, "warnings    none in the last minute")?;
    }
    Ok(())
}
