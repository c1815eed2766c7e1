//! What came of a scenario, against what must hold.

use serde::Serialize;
use volcomp_units::UM_PER_MM;
use volcomp_units::axes::MAX_AXES;

use super::plan::{Accept, Scenario};
use crate::control::CycleRecord;
use crate::monitor::Report;

/// The state at the end where a scenario does not judge it: a daemon that sends nothing tells none.
const ANY_STATE: &str = "any";

/// The outcome of a scenario.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Verdict {
    /// Its number.
    pub number: u32,
    /// Its name.
    pub name: String,
    /// The seed that it ran with.
    pub seed: u64,
    /// True where everything held.
    pub ok: bool,
    /// Largest radial deviation over the last second of motion.
    pub largest_um: Option<f64>,
    /// RMS of the same.
    pub rms_um: Option<f64>,
    /// Largest change of an offset from one cycle to the next.
    pub step_um: f64,
    /// Largest offset of any axis.
    pub offset_um: f64,
    /// Answers that said that an axis is limited.
    pub limited: usize,
    /// Lines of the daemons' log.
    pub lines: usize,
    /// Control time from the last thing that happened to the final state.
    pub settle_s: f64,
    /// Cycles with a daemon but without an answer.
    pub unanswered: u64,
    /// State at the end.
    pub state: String,
    /// Cycles run.
    pub cycles: usize,
    /// What the monitor at the daemon's end of the link has seen.
    pub monitor: Report,
    /// What did not hold.
    pub failures: Vec<String>,
    /// Runs that it took.
    pub runs: u32,
    /// The last lines of the log, where something did not hold.
    pub last_words: Vec<String>,
}

impl Verdict {
    /// A scenario that could not be run.
    #[must_use]
    pub fn impossible(scenario: &Scenario, error: &anyhow::Error) -> Self {
        Self {
            number: scenario.number,
            name: scenario.name.clone(),
            seed: scenario.seed,
            ok: false,
            largest_um: None,
            rms_um: None,
            step_um: 0.0,
            offset_um: 0.0,
            limited: 0,
            lines: 0,
            settle_s: 0.0,
            unanswered: 0,
            state: "none".to_owned(),
            cycles: 0,
            monitor: Report::default(),
            failures: vec![format!("{error:#}")],
            runs: 0,
            last_words: Vec::new(),
        }
    }

    /// Something did not hold.
    pub(super) fn fail(&mut self, what: String) {
        self.ok = false;
        self.failures.push(what);
    }
}

/// What a cycle shows of the daemon.
fn state_of(r: &CycleRecord) -> Option<&'static str> {
    if r.connected { r.correction.map(|c| c.state.name()) } else { Some("none") }
}

/// What is judged.
pub(super) struct Seen<'a> {
    /// Every cycle.
    pub(super) records: &'a [CycleRecord],
    /// Radial deviations of the last second.
    pub(super) residual_um: &'a [f64],
    /// Of every correction that the daemon has sent.
    pub(super) monitor: Report,
}

/// Judges the cycles of a scenario.
pub(super) fn judge(
    scenario: &Scenario,
    &Seen { records, residual_um, ref monitor }: &Seen<'_>,
    last_action: u64,
    cycle_s: f64,
    log: &str,
) -> Verdict {
    let accept = &scenario.accept;
    let mut verdict = Verdict {
        number: scenario.number,
        name: scenario.name.clone(),
        seed: scenario.seed,
        ok: true,
        largest_um: residual_um.iter().map(|v| v.abs()).reduce(f64::max),
        rms_um: rms(residual_um),
        step_um: largest_step_um(records),
        offset_um: records.iter().flat_map(|r| r.applied).map(f64::abs).fold(0.0, f64::max) * UM_PER_MM,
        limited: records.iter().filter(|r| r.correction.is_some_and(|c| c.limited != 0)).count(),
        lines: log.lines().count(),
        settle_s: 0.0,
        unanswered: records.iter().filter(|r| r.connected && r.correction.is_none()).count() as u64,
        state: records.iter().rev().find_map(state_of).unwrap_or("none").to_owned(),
        cycles: records.len(),
        monitor: monitor.clone(),
        failures: Vec::new(),
        runs: 1,
        last_words: Vec::new(),
    };
    let settled = records.iter().rposition(|r| state_of(r).is_some_and(|s| s != verdict.state));
    let settled = settled.and_then(|at| records.get(at + 1)).map_or(0, |r| r.cycle);
    verdict.settle_s = settled.saturating_sub(last_action) as f64 * cycle_s;
    verdict.failures = failures(&verdict, accept, log);
    verdict.ok = verdict.failures.is_empty();
    verdict
}

fn failures(v: &Verdict, accept: &Accept, log: &str) -> Vec<String> {
    let mut found = Vec::new();
    let mut at_most = |what: &str, value: Option<f64>, limit: f64| {
        if let Some(value) = value
            && (value.is_nan() || value > limit)
        {
            found.push(format!("{what} {value:.3}, at most {limit}"));
        }
    };
    at_most("largest residual (um)", v.largest_um, accept.largest_um);
    at_most("RMS residual (um)", v.rms_um, accept.rms_um);
    at_most("largest step (um)", Some(v.step_um), accept.step_um);
    at_most("largest offset (um)", Some(v.offset_um), accept.offset_um);
    at_most("lines of the log", Some(v.lines as f64), accept.lines as f64);
    at_most("settling (s)", Some(v.settle_s), accept.settle_s);
    at_most("cycles without an answer", Some(v.unanswered as f64), accept.unanswered as f64);
    if accept.state != ANY_STATE && v.state != accept.state {
        found.push(format!("state {} at the end, not {}", v.state, accept.state));
    }
    if (v.limited > accept.limited_cycles) != accept.limited {
        let which = if accept.limited { "more than" } else { "at most" };
        let most = accept.limited_cycles;
        found.push(format!("{} answers say that an axis is limited, expected {which} {most}", v.limited));
    }
    for words in &accept.log {
        if !log.contains(words) {
            found.push(format!("the log does not say \"{words}\""));
        }
    }
    found.extend(v.monitor.lines());
    found
}

fn rms(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| (values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64).sqrt())
}

/// Over consecutive cycles of one control.
fn largest_step_um(records: &[CycleRecord]) -> f64 {
    let step = |p: &[CycleRecord]| {
        (0..MAX_AXES).map(|k| (p[1].applied[k] - p[0].applied[k]).abs()).fold(0.0, f64::max)
    };
    records.windows(2).filter(|p| p[1].cycle == p[0].cycle + 1).map(step).fold(0.0, f64::max) * UM_PER_MM
}
