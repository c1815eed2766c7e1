//! Every number that the code raises is tried: by a scenario, whose log must say it, or by a test that is named here.

#![expect(clippy::disallowed_methods, reason = "a test reads files")]
#![expect(clippy::unwrap_used, reason = "a test stops where its own set-up is wrong")]

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use simulator::scenarios::Plan;
use volcomp::engine::Reason;
use volcomp::engine::fault::{CATALOGUE, Code, reason_code};

/// Numbers that no scenario can reach with the programs as they are, and where they are tried instead: file and test.
const TESTED: &[(u16, &str, &str)] = &[
    (4008, "tests/daemon/status.rs", "what_limits_the_correction_is_a_warning_while_it_lasts"),
    (
        4009,
        "src/engine/tests/obstacles.rs",
        "an_offset_that_stays_away_from_its_correction_is_told_after_the_time_that_its_limits_explain",
    ),
    (4010, "tests/daemon/service.rs", "an_axis_that_is_not_listed_keeps_its_offset_and_that_is_told"),
    (
        5001,
        "src/engine/tests/sequences/every_rule.rs",
        "every_rule_is_met_and_no_other_change_of_state_occurs",
    ),
    (
        6008,
        "tests/daemon/status.rs",
        "a_control_at_another_cycle_than_it_announces_is_a_warning_until_it_is_right",
    ),
    (
        7007,
        "tests/daemon/service.rs",
        "a_service_that_hangs_is_seen_by_the_cycle_and_sigterm_works_all_the_same",
    ),
    (8001, "src/engine/tests/setpoint.rs", "a_sensor_that_falls_silent_fades_to_the_static_model"),
    (8014, "tests/daemon/thermal.rs", "temperatures_and_speeds_on_a_sensor_link_move_the_axes"),
    (
        8016,
        "src/estimate/live/estimator/tests.rs",
        "a_direction_that_points_the_other_way_is_refused_by_name",
    ),
    (8017, "tests/daemon/sensors.rs", "what_is_no_reading_is_answered_and_costs_nothing_else"),
    (8018, "tests/daemon/sensors.rs", "an_estimator_that_does_not_keep_up_says_so_and_blames_no_sensor"),
    (8019, "src/estimate/live/estimator/tests.rs", "what_is_larger_than_its_limit_is_told"),
    (8020, "tests/daemon/sensors.rs", "a_model_without_live_values_leaves_the_sensors_listed_as_unused"),
    (8015, "tests/daemon/thermal.rs", "temperatures_and_speeds_on_a_sensor_link_move_the_axes"),
];

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

fn sources(folder: &Path, found: &mut String) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            sources(&path, found);
        } else if path.extension().is_some_and(|e| e == "rs") {
            found.push_str(&std::fs::read_to_string(&path).unwrap());
        }
    }
}

/// `connect-failed` as the constant of its code: `CONNECT_FAILED`.
fn constant(name: &str) -> String {
    format!("Code::{}", name.replace('-', "_").to_uppercase())
}

/// The numbers that the engine or the service can raise: reasons, and entries that the service names by constant, by
/// name, by number, or in the words of a message.
fn raised() -> BTreeSet<Code> {
    let mut text = String::new();
    for room in ["src/daemon", "src/cli"] {
        sources(&root().join(room), &mut text);
    }
    let named = |name: &str, code: Code| {
        text.contains(&constant(name))
            || text.contains(&format!("named(\"{name}\")"))
            || text.contains(&format!("\"{code}"))
            || text.contains(&format!(" {code}: "))
            || text.contains(&format!("Code({})", code.0))
    };
    let service = CATALOGUE.iter().filter(|e| named(e.name, e.code)).map(|e| e.code);
    // a frame out of order makes no change of state; the service counts and tells it
    let engine = Reason::ALL.into_iter().map(reason_code);
    service.chain(engine).collect()
}

#[test]
fn every_number_that_is_raised_is_tried() {
    let plan = Plan::shipped().unwrap();
    let words: Vec<&String> = plan.scenarios.iter().flat_map(|s| &s.accept.log).collect();
    let mut open = Vec::new();
    for code in raised() {
        let in_scenario = words.iter().any(|w| **w == code.to_string());
        let in_test = TESTED.iter().any(|(number, ..)| *number == code.0);
        if !in_scenario && !in_test {
            open.push(format!("{code} {}", code.entry().map_or("", |e| e.name)));
        }
        assert!(!(in_scenario && in_test), "{code}: a scenario reaches it, the test need not be named here");
    }
    assert!(open.is_empty(), "raised but never tried: {open:?}");
}

#[test]
fn the_tests_that_are_named_exist() {
    for (number, file, test) in TESTED {
        let text = std::fs::read_to_string(root().join(file)).unwrap();
        assert!(text.contains(&format!("fn {test}(")), "VC-{number}: {file} has no test {test}");
        assert!(Code(*number).entry().is_some(), "VC-{number} is not in the catalogue");
    }
}

#[test]
fn scenarios_name_no_number_that_does_not_exist() {
    for scenario in Plan::shipped().unwrap().scenarios {
        for words in scenario.accept.log.iter().filter(|w| w.starts_with("VC-")) {
            let known = Code::parse(words).is_some_and(|code| code.entry().is_some());
            assert!(known, "scenario {}: {words}", scenario.number);
        }
    }
}

#[test]
fn numbers_are_found_however_the_code_names_them() {
    // one that an engine's reason raises, one by constant, and those of the models, which are told in answers
    let raised = raised();
    for code in [1001, 3004, 5002, 5003, 5004, 5005, 5006, 5007, 6007, 7001, 7002, 7003, 7004, 7005, 7006] {
        assert!(raised.contains(&Code(code)), "VC-{code}");
    }
}
