//! Whether all is well: the verdict of the status, its exit code and what to do.

use std::collections::BTreeSet;

use serde::{Deserialize, Serialize};

use super::recent::{CodeCount, is_counted_per_cycle};
use super::sensor_status::MapStatus;
use super::status::Status;
use volcomp_engine::fault::Code;

/// Time since the last count after which a condition that is counted in every cycle is over, s: late cycles are judged
/// every 2 s.
const OVER_S: f64 = 3.0;

/// The verdict on a status.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Health {
    /// `ok`, `warning`, `held`, `disconnected` or `faulted`.
    pub verdict: String,
    /// Exit code of `volcomp status`: 0, 1, 2, 3 or 4 in the same order.
    pub exit_code: u8,
    /// Number of the cause, where it has one.
    pub code: Option<String>,
    /// The cause in one line; empty where all is well.
    pub cause: String,
    /// What to do; empty where nothing is to be done.
    pub remedy: String,
}

/// Judges a status and what lasts beside it; the most serious cause decides.
pub(super) fn health(status: &Status, lasting: &BTreeSet<(Code, String)>) -> Health {
    if let Some(fault) = status.faults.first() {
        let numbers = fault.numbers.as_ref().map_or_else(String::new, |numbers| format!(": {numbers}"));
        return of_code("faulted", 4, &fault.code, &format!("{}{numbers}", fault.text));
    }
    let reason = status.state_reason.as_ref();
    match status.state.as_str() {
        "faulted" => return of_code("faulted", 4, "", "a fault is latched"),
        "disconnected" => {
            let cause = status.link.error.as_deref().unwrap_or("connecting to the control");
            return of_code("disconnected", 3, status.link.error_code.as_deref().unwrap_or(""), cause);
        }
        state => {
            if let Some(waits) = &status.waits_for {
                let what =
                    if state == "armed" { "compensation waits" } else { "the offset is held or led out" };
                return of_code("held", 2, &waits.code, &format!("{what}: {}", waits.text));
            }
            if state == "holding" {
                let (code, text) = reason.map_or(("", "the offset is held"), |r| (r.code.as_str(), &r.text));
                return of_code("held", 2, code, text);
            }
            if state == "armed" {
                return of_code("held", 2, "", "compensation waits for ten good position frames in a row");
            }
        }
    }
    if let Some(worst) = status.recent.warnings.iter().max_by_key(|w| rank(w)) {
        let text = if worst.present { worst.text.clone() } else { format!("{} (over)", worst.text) };
        return of_code("warning", 1, &worst.code, &text);
    }
    let sensor = status.sensors.iter().find_map(|sensor| {
        let code = sensor.code.as_deref()?;
        Some((code, format!("sensor {} {}", sensor.name, sensor.state)))
    });
    if let Some((code, text)) = sensor {
        return of_code("warning", 1, code, &text);
    }
    if let Some((map, code)) = status.maps.iter().find_map(|map| Some((map, map.codes().next()?))) {
        let text = code.entry().map_or("", |entry| entry.text);
        return of_code("warning", 1, &code.to_string(), &format!("map {}: {text}", map.name));
    }
    let standing = status.hindrances.first().or(status.start_inhibit.as_ref());
    if let Some((code, text)) = lasting.first().filter(|_| standing.is_none()) {
        return of_code("warning", 1, &code.to_string(), text);
    }
    let note = status.lifetime.note.as_ref().filter(|note| note.starts_with("VC-"));
    if let Some(text) = standing.or(note) {
        let code = text.get(..7).filter(|code| code.starts_with("VC-")).unwrap_or_default().to_owned();
        return of_code("warning", 1, &code, text);
    }
    Health { verdict: "ok".to_owned(), ..Health::default() }
}

/// Present ones first, then by severity and count.
fn rank(warning: &CodeCount) -> (bool, bool, u64) {
    (warning.present, warning.severity == "fault", warning.count)
}

/// Tells the warnings and faults that last from those that are over, and puts the most serious first.
pub(super) fn mark_present(status: &mut Status, lasting: &BTreeSet<(Code, String)>) {
    let reasons =
        [status.state_reason.as_ref().filter(|_| is_interrupted(&status.state)), status.waits_for.as_ref()];
    let mut present: Vec<String> = reasons.into_iter().flatten().map(|reason| reason.code.clone()).collect();
    present.extend(status.faults.iter().map(|fault| fault.code.clone()));
    present.extend(status.sensors.iter().filter_map(|sensor| sensor.code.clone()));
    present.extend(status.growths.iter().filter_map(|growth| growth.code.clone()));
    present.extend(status.maps.iter().flat_map(MapStatus::codes).map(|code| code.to_string()));
    present.extend(lasting.iter().map(|(code, _)| code.to_string()));
    present.extend(status.lifetime.note.as_deref().and_then(|note| note.get(..7)).map(str::to_owned));
    present.extend(status.link.error_code.clone().filter(|_| !status.link.up));
    for warning in &mut status.recent.warnings {
        let counted = warning.age_s < OVER_S && Code::parse(&warning.code).is_some_and(is_counted_per_cycle);
        warning.present = counted || present.contains(&warning.code);
    }
    status.recent.warnings.sort_by_key(|warning| core::cmp::Reverse(rank(warning)));
}

/// Whether the reason of a state is why the offset does not follow its correction.
fn is_interrupted(state: &str) -> bool {
    matches!(state, "holding" | "ramping-out" | "faulted" | "fading-to-static")
}

fn of_code(verdict: &str, exit_code: u8, code: &str, cause: &str) -> Health {
    let remedy = Code::parse(code).and_then(Code::entry).map_or("", |entry| entry.remedy);
    Health {
        verdict: verdict.to_owned(),
        exit_code,
        code: (!code.is_empty()).then(|| code.to_owned()),
        cause: cause.to_owned(),
        remedy: remedy.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_map_that_is_contradicted_or_at_its_limit_is_a_warning_for_as_long_as_it_lasts() {
        let map = |state: &str, limited| MapStatus {
            name: "ram".to_owned(),
            state: state.to_owned(),
            limited,
            ..MapStatus::default()
        };
        for (map, code) in [
            (map("alarm", false), Some("VC-8011")),
            (map("static", true), Some("VC-8012")),
            (map("learning", true), Some("VC-8019")),
            (map("held", false), None),
        ] {
            let mut status = Status { maps: vec![map], ..Status::default() };
            let verdict = health(&status, &BTreeSet::new());
            assert_eq!((verdict.code.as_deref(), verdict.exit_code), (code, u8::from(code.is_some())));
            assert_eq!(verdict.cause.starts_with("map ram: "), code.is_some(), "{}", verdict.cause);
            let counted = CodeCount { code: "VC-8019".to_owned(), age_s: 50.0, ..CodeCount::default() };
            status.recent.warnings.push(counted);
            mark_present(&mut status, &BTreeSet::new());
            assert_eq!(status.recent.warnings[0].present, status.maps[0].limited);
        }
    }

    #[test]
    fn what_cannot_be_saved_is_a_warning_for_as_long_as_it_lasts() {
        let mut status = Status { state: "off".to_owned(), ..Status::default() };
        let text = "maps are not saved: live.json: no space".to_owned();
        let lasting = BTreeSet::from([(Code::COUNTERS_NOT_SAVED, text.clone())]);
        // the count of the minute is over long since
        let verdict = health(&status, &lasting);
        assert_eq!((verdict.code.as_deref(), verdict.exit_code), (Some("VC-7006"), 1));
        assert!(verdict.cause == text && !verdict.remedy.is_empty(), "{verdict:?}");
        let counted = CodeCount { code: "VC-7006".to_owned(), age_s: 50.0, ..CodeCount::default() };
        status.recent.warnings.push(counted);
        mark_present(&mut status, &lasting);
        assert!(status.recent.warnings[0].present);
        mark_present(&mut status, &BTreeSet::new());
        assert!(!status.recent.warnings[0].present);
        assert_eq!(health(&Status::default(), &BTreeSet::new()).exit_code, 0);
    }
}
