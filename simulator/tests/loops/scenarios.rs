//! A part of the scenarios against the real programs, and that the page about them says what the list says.
//!
//! All of them: `cncsim dev scenarios` (`docs/reference/faults.md`). The part here takes one or two of each kind and runs in lock step,
//! so that a loaded computer changes nothing, and two of those with sensors; the others in real time are left to the whole list.

#![expect(clippy::disallowed_methods, reason = "a test of processes and files")]
#![expect(clippy::unwrap_used, reason = "helpers of tests")]

use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

use simulator::demo::programs::Programs;
use simulator::scenarios::{Pacing, Plan, Scenario, Verdict, run};

/// Numbers of the part.
const PART: &[u32] = &[
    103, 111, 119, 120, // processes
    212, // time
    302, 304, 314, 322, // bytes
    402, 405, 407, 409, 422, // what the control says
    424, 425, 426, 427, 428, 429, 430, 431, 432, 433, 434, 435, 436, 437, 438, // a read-back that lies
    502, 507, 514, // states and limits
    601, 609, 611, 618, // orders and models
    702, 703, 706, 709, 710, // the computer
];
/// In real time, one after the other: sensors live in the daemon's time.
const IN_TIME: &[u32] = &[804, 808];

fn programs() -> Programs {
    Programs::at(env!("CARGO_BIN_EXE_cncsim"))
}

fn play(chosen: &[Scenario]) -> Vec<Verdict> {
    let (next, verdicts) = (AtomicUsize::new(0), Mutex::new(Vec::new()));
    // they wait for timeouts most of the time, and in lock step nothing depends on how fast they run
    let threads = 4 * std::thread::available_parallelism().map_or(1, core::num::NonZero::get);
    std::thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(|| {
                while let Some(scenario) = chosen.get(next.fetch_add(1, Relaxed)) {
                    let verdict =
                        run(scenario, &programs()).unwrap_or_else(|e| Verdict::impossible(scenario, &e));
                    verdicts.lock().unwrap().push(verdict);
                }
            });
        }
    });
    verdicts.into_inner().unwrap()
}

#[test]
fn the_daemon_does_what_it_must_in_a_part_of_the_scenarios() {
    let mut chosen = Plan::shipped().unwrap().scenarios;
    chosen.retain(|s| PART.contains(&s.number));
    assert_eq!(chosen.len(), PART.len(), "a number that the list does not have");
    assert!(chosen.iter().all(|s| s.pacing == Pacing::LockStep));
    let failed: Vec<Verdict> = play(&chosen).into_iter().filter(|v| !v.ok).collect();
    assert!(failed.is_empty(), "{failed:#?}");
}

#[test]
fn a_sensor_that_jumps_and_one_whose_clock_steps_do_no_harm() {
    let _alone = crate::processors();
    let mut chosen = Plan::shipped().unwrap().scenarios;
    chosen.retain(|s| IN_TIME.contains(&s.number));
    assert_eq!(chosen.len(), IN_TIME.len(), "a number that the list does not have");
    for scenario in &chosen {
        let verdict = run(scenario, &programs()).unwrap_or_else(|e| Verdict::impossible(scenario, &e));
        assert!(verdict.ok, "{verdict:#?}");
    }
}

#[test]
fn a_scenario_that_does_not_hold_is_found_out() {
    // the same as 101, with limits that nothing can keep, and a fault that nothing meets
    let text = r#"
        [[scenario]]
        number = 1
        name = "cannot hold"
        turns = 1
        relay = true
        do = [{ at = 3900, what = "link", fault = "reset", every = 1000000 }]
        [scenario.accept]
        largest-um = 0.001
        step-um = 0.001
        state = "faulted"
        log = ["words that no daemon says"]
    "#;
    let shipped = include_str!("../../src/scenarios/catalogue.toml");
    let defaults = &shipped[..shipped.find("[[scenario]]").unwrap()];
    let plan = Plan::parse(&format!("{defaults}{text}")).unwrap();
    let verdict = run(&plan.scenarios[0], &programs()).unwrap();
    assert!(!verdict.ok);
    let found = verdict.failures.join("; ");
    for wanted in ["residual", "step", "state active at the end", "the log does not say", "no frame has met"]
    {
        assert!(found.contains(wanted), "{wanted}: {found}");
    }
}

#[test]
fn the_page_lists_every_scenario_with_its_name() {
    let page =
        std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/reference/faults.md")).unwrap();
    let (_, rest) = page.split_once("<!-- begin -->").expect("begin of the table");
    let (table, _) = rest.split_once("<!-- end -->").expect("end of the table");
    let rows: Vec<[String; 2]> = table
        .lines()
        .filter(|line| line.starts_with("| ") && !line.starts_with("| number"))
        .map(|line| {
            let mut cells = line.split('|').skip(1).map(|cell| cell.trim().to_owned());
            [cells.next().unwrap(), cells.next().unwrap()]
        })
        .collect();
    let plan = Plan::shipped().unwrap();
    let wanted: Vec<_> = plan.scenarios.iter().map(|s| [s.number.to_string(), s.name.clone()]).collect();
    assert_eq!(rows, wanted, "docs/reference/faults.md: `cncsim dev scenarios --table` prints it anew");
    assert!(!table.contains("does not hold"), "a measured outcome that was not good");
}
