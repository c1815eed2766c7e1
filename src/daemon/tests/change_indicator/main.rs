//! The change indicator: committed recordings give the committed offsets.
//!
//! Machines, models and inputs stand in the recordings, so nothing but the engine's own code can change what comes out.
//! `docs/development/change-indicator.md` says what is recorded, how to update it and what an update decides.

#![allow(
    clippy::expect_used,
    clippy::disallowed_methods,
    reason = "a test program: it reads and writes its recordings and fails by panicking"
)]

mod catalogue;
mod committed;
mod compare;
mod control;
mod live_loop;
mod machine;

use std::env;
use std::fs;
use std::sync::LazyLock;

use volcomp_units::axes::AxisName;

use catalogue::{CATALOGUE, simulate};
use committed::{Committed, folder, read, tables, update};
use compare::{closed_loop, compare, described, is_bit_for_bit, replay};

/// The environment variable that asks for new recordings.
const UPDATE: &str = "UPDATE_RECORDINGS";
/// What to do where a change is intended.
const REMEDY: &str = "not intended: find its cause; `git diff` and `git bisect` with this test narrow it down\n  \
     intended: UPDATE_RECORDINGS=1 cargo test -p volcomp-daemon --test change_indicator, review the diff of \
     tests/recordings/*.csv,\n            and state the change in CHANGELOG.md under \"Changes of numbers\"";

/// New recordings, once and before any test reads them.
static UPDATED: LazyLock<()> = LazyLock::new(|| {
    if env::var_os(UPDATE).is_some_and(|value| value == "1") {
        assert!(
            is_bit_for_bit(),
            "{UPDATE}=1: recordings are made on x86_64 Linux (glibc, FMA and AVX2) only"
        );
        update();
    }
});

fn committed(name: &str) -> Committed {
    LazyLock::force(&UPDATED);
    read(name)
}

/// The recorded inputs give the recorded outputs.
#[track_caller]
fn unchanged(name: &str) {
    let committed = committed(name);
    let axes: Vec<AxisName> = committed.machine.axis_names().collect();
    let now = replay(&committed);
    let found = compare(&axes, &committed.entries, &now);
    assert!(found.cycles > 2000, "{name}: {} cycles only", found.cycles);
    let Some(first) = &found.first else { return };
    panic!(
        "the output of the engine has changed: recording {name}, {} of {} cycles\n  \
         first: {first}\n  \
         largest: {}\n  \
         largest where the control applies the changed offsets (closed loop): {}\n  {REMEDY}",
        found.differing,
        found.cycles,
        described(found.largest),
        closed_loop(&axes, &committed.entries, &simulate(name).entries),
    );
}

#[test]
fn three_axes_are_unchanged() {
    unchanged("three-axes");
}

#[test]
fn five_axes_are_unchanged() {
    unchanged("five-axes");
}

#[test]
fn the_grinder_is_unchanged() {
    unchanged("grinder");
}

#[test]
fn the_live_filter_is_unchanged() {
    unchanged("live-filter");
}

#[test]
fn faults_are_unchanged() {
    unchanged("faults");
}

/// The estimator's output is an input of the engine: only the closed loop notices a change of it.
#[test]
fn the_simulation_reproduces_the_recordings() {
    for (name, simulation) in CATALOGUE {
        let committed = committed(name);
        let simulated = simulation().entries;
        let axes: Vec<AxisName> = committed.machine.axis_names().collect();
        let found = compare(&axes, &committed.entries, &simulated);
        // as text: NaN is equal to NaN, and every bit of a number is shown
        let differs = |(a, b): (&_, &_)| is_bit_for_bit() && format!("{a:?}") != format!("{b:?}");
        let record = committed.entries.iter().zip(&simulated).position(differs);
        let [recorded, now] = [committed.entries.len(), simulated.len()];
        assert!(
            found.first.is_none() && record.is_none() && recorded == now,
            "recording {name}: the simulation gives another one ({recorded} records, now {now})\n  \
             first record with another input or output: {record:?}\n  \
             first output: {}\n  largest: {}\n  \
             changed: the engine, the live estimation, an example of config/examples, or the motion of \
             simulator/machine\n  {REMEDY}",
            found.first.as_deref().unwrap_or("none"),
            closed_loop(&axes, &committed.entries, &simulated),
        );
    }
}

#[test]
fn the_tables_show_the_recordings() {
    LazyLock::force(&UPDATED);
    for (path, text) in tables() {
        let found = fs::read_to_string(&path).unwrap_or_default();
        // as git may have checked it out
        let found = found.replace("\r\n", "\n");
        assert!(
            found == text,
            "{} does not show the recording beside it\n  hint: {UPDATE}=1 makes both",
            path.display()
        );
    }
}

#[test]
fn the_recordings_are_few_and_small() {
    LazyLock::force(&UPDATED);
    let sizes = fs::read_dir(folder()).expect("tests/recordings").map(|file| {
        let file = file.expect("a file");
        (file.file_name(), file.metadata().expect("a size").len())
    });
    let sizes: Vec<_> = sizes.collect();
    assert!(sizes.iter().all(|(_, size)| *size <= 300_000), "{sizes:?}");
    assert!(sizes.iter().map(|(_, size)| size).sum::<u64>() <= 1_500_000, "{sizes:?}");
    assert_eq!(sizes.len(), 2 * CATALOGUE.len() + 1, "{sizes:?}");
}
