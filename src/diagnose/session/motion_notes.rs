//! Notes on the motion that was derived from the rows, and on what is not known of it.

use std::collections::BTreeMap;

use super::super::moment::Axis;
use super::Note;

/// What a file does not state of the motion of its axes.
#[derive(Debug, Default)]
pub(super) struct Motion {
    /// What was derived from the rows, and for which axes.
    derived: BTreeMap<String, Vec<Axis>>,
    /// Axes whose samples are too slow for velocities.
    slow: Vec<Axis>,
}

/// What the columns of a file state of an axis in every row.
#[derive(Debug, Clone, Copy)]
pub(super) struct Stated {
    pub(super) velocity: bool,
    pub(super) acceleration: bool,
    pub(super) direction: bool,
    pub(super) since: bool,
    pub(super) since_s: bool,
}

impl Motion {
    /// Notes what was derived of an axis, from rows in motion or not.
    pub(super) fn tell(&mut self, axis: Axis, in_motion: bool, on_circle: bool, stated: Stated) {
        let derived: Vec<&str> = [
            (in_motion && !stated.velocity, "velocity"),
            (in_motion && !stated.acceleration, "acceleration"),
            (!stated.direction, "direction of travel"),
            (!stated.since, "distance since reversal"),
            (!stated.since_s, "time since reversal"),
        ]
        .into_iter()
        .filter_map(|(is_derived, what)| is_derived.then_some(what))
        .collect();
        let mut words = derived.join(", ");
        if derived.contains(&"distance since reversal") && derived.contains(&"time since reversal") {
            words = words.replace("distance since reversal, time", "distance and time");
        }
        if !words.is_empty() {
            let from = if on_circle { "the angle on the circle" } else { "the rows" };
            self.derived.entry(format!("{words} of {{axes}} derived from {from}")).or_default().push(axis);
        }
        if !in_motion && !stated.velocity {
            self.slow.push(axis);
        }
    }
}

/// Notes on the motion of all files: what holds of several axes or files is said once.
pub(super) fn of(files: &[(&str, Motion)]) -> Vec<Note> {
    let words = |axes: &[Axis]| axes.iter().map(Axis::to_string).collect::<Vec<_>>().join(", ");
    let mut derived: BTreeMap<String, Vec<&str>> = BTreeMap::new();
    let mut slow: BTreeMap<&[Axis], Vec<&str>> = BTreeMap::new();
    for (file, motion) in files {
        for (what, axes) in &motion.derived {
            derived.entry(what.replace("{axes}", &words(axes))).or_default().push(file);
        }
        if !motion.slow.is_empty() {
            slow.entry(&motion.slow).or_default().push(file);
        }
    }
    let derived = derived.into_iter().map(|(what, files)| Note::new(format!("{}: {what}", files.join(", "))));
    let slow = slow.into_iter().map(|(axes, files)| {
        let linear = axes.iter().filter(|a| a.is_linear());
        let of = |a: &Axis| {
            ["reversal-spike", "servo-mismatch", "inertial", "inertial-cross"].map(|e| format!("{e}:{a}"))
        };
        let mut unidentifiable: Vec<String> = linear.flat_map(of).collect();
        if !unidentifiable.is_empty() {
            unidentifiable.extend(["latency".to_owned(), "clock-skew".to_owned()]);
        }
        let text = format!(
            "{}: samples of {} are too slow for velocities and none are stated: taken as standing still",
            files.join(", "),
            words(axes)
        );
        Note { text, unidentifiable }
    });
    derived.chain(slow).collect()
}
