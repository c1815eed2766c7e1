//! G-code of a measurement, at the places and speeds where the machine was measured already.

use std::fmt::Write as _;

use super::super::moment::{Axis, SLOTS};
use super::super::session::Session;
use crate::core::units::RAD_PER_DEG;

/// Circles take this share of the shorter way of their plane, lines this share of the way of their axis.
const CIRCLE_SHARE: f64 = 0.4;
const LINE_SHARE: f64 = 0.98;
/// The second place of a line, as a share of the way from the middle of the other axes.
const SECOND_PLACE: f64 = 0.6;
/// Feed where none is known from the readings, mm/min, and the least and most that is asked for.
const FEED: f64 = 1000.0;
const FEED_RANGE: [f64; 2] = [100.0, 10_000.0];
/// Points of a line.
const POINTS: usize = 21;
/// Dwell at a point, and one that is long enough for a machine to grow warm in, s.
const DWELL_S: f64 = 3.0;
const WARM_S: f64 = 600.0;

/// Where and how fast the machine was measured.
pub(super) struct Programme {
    low: [f64; SLOTS],
    high: [f64; SLOTS],
    feed: f64,
}

/// What a measurement runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Motion {
    /// Circles in every plane, both ways, at two feeds.
    Circles,
    /// An axis from point to point with dwells, to and fro.
    Points,
    /// The same with uneven steps shorter than a period of the screw.
    FineSteps,
    /// The same at a second place of the other axes.
    SecondPlace,
    /// The same cold and warm.
    ColdAndWarm,
    /// The same with two tools.
    TwoTools,
    /// Spindle on, off and on.
    Spindle,
    /// Moves with a clear beginning and end.
    StartAndStop,
    /// The same line, the instrument elsewhere.
    SecondInstrument,
    /// A rotary axis in uneven steps.
    Turn,
}

impl Programme {
    /// The places and the usual feed of a session.
    pub(super) fn of(session: &Session) -> Self {
        let (mut low, mut high) = ([f64::INFINITY; SLOTS], [f64::NEG_INFINITY; SLOTS]);
        let mut speeds: Vec<f64> = Vec::new();
        for m in &session.moments {
            for axis in &session.axes {
                let k = axis.slot();
                let p = if axis.is_linear() { m.position[k] } else { m.position[k] / RAD_PER_DEG };
                (low[k], high[k]) = (low[k].min(p), high[k].max(p));
            }
            let speed = (0..3).map(|k| m.velocity[k].powi(2)).sum::<f64>().sqrt();
            if speed.is_finite() && speed > 0.1 {
                speeds.push(60.0 * speed);
            }
        }
        speeds.sort_by(f64::total_cmp);
        let usual = speeds.get(speeds.len() / 2).copied().unwrap_or(FEED);
        // a round figure
        let feed = ((usual / 100.0).round() * 100.0).clamp(FEED_RANGE[0], FEED_RANGE[1]);
        Self { low, high, feed }
    }

    /// The programme; `about` are the letters of the axes that it is about, the first that moves is taken.
    pub(super) fn text(&self, motion: Motion, about: &[char]) -> String {
        let linear = self.moving(true);
        let axis = about
            .iter()
            .find_map(|l| linear.iter().find(|a| letter(**a) == *l))
            .or_else(|| linear.iter().max_by(|a, b| self.way(**a).total_cmp(&self.way(**b))))
            .copied();
        let Some(axis) = axis else {
            return if motion == Motion::Turn {
                self.turn(about)
            } else {
                "(the same programme again)".to_owned()
            };
        };
        let line = || self.points(axis, None);
        let two = |first: &str, second: &str| format!("({first})\n{}\n({second})\n{}", line(), line());
        match motion {
            Motion::Circles => self.circles(&linear),
            Motion::Points => line(),
            Motion::FineSteps => self.fine(axis),
            Motion::SecondPlace => format!(
                "(first place)\n{}\n(second place)\n{}",
                self.points(axis, Some(0.0)),
                self.points(axis, Some(SECOND_PLACE))
            ),
            Motion::ColdAndWarm => {
                let warm = format!("M3 S6000\n{}M5", format!("G4 P{WARM_S:.0}\n").repeat(6));
                format!("(cold)\n{}\n{warm}\n(warm)\n{}", line(), line())
            }
            Motion::TwoTools => two("shorter tool", "longer tool, same setup of the instrument"),
            Motion::Spindle => {
                let hour = format!("G4 P{WARM_S:.0}\n").repeat(6);
                format!(
                    "(probe at the tool, one reading a second)\nM3 S8000\n{hour}M5\n{hour}M3 S8000\n{hour}M5"
                )
            }
            Motion::StartAndStop => self.start_and_stop(axis),
            Motion::SecondInstrument => two("instrument as before", "instrument at its second station"),
            Motion::Turn => self.turn(about),
        }
    }

    fn moving(&self, linear: bool) -> Vec<Axis> {
        Axis::ALL.into_iter().filter(|a| a.is_linear() == linear && self.way(*a) > 1.0).collect()
    }

    fn way(&self, axis: Axis) -> f64 {
        let way = self.high[axis.slot()] - self.low[axis.slot()];
        if way.is_finite() { way } else { 0.0 }
    }

    fn middle(&self, axis: Axis) -> f64 {
        0.5 * (self.high[axis.slot()] + self.low[axis.slot()])
    }

    /// To the middle of all linear axes but `not`, or by a share of half their way beside it.
    fn away(&self, not: Option<Axis>, share: f64) -> String {
        let mut out = "G90 G0".to_owned();
        for a in self.moving(true).into_iter().filter(|a| Some(*a) != not) {
            let _ = write!(out, " {}{:.3}", word(a), self.middle(a) + 0.5 * share * self.way(a));
        }
        out
    }

    fn circles(&self, linear: &[Axis]) -> String {
        let mut out = String::new();
        // plane, its axes in the order of the arc, and the words of the centre
        for (code, first, second, centre) in
            [("G17", 'X', 'Y', 'I'), ("G18", 'Z', 'X', 'K'), ("G19", 'Y', 'Z', 'J')]
        {
            let find = |l: char| linear.iter().find(|a| word(**a) == l).copied();
            let (Some(a), Some(b)) = (find(first), find(second)) else { continue };
            let radius = (CIRCLE_SHARE * self.way(a).min(self.way(b))).floor().max(1.0);
            let _ = writeln!(out, "{}\n{code}", self.away(None, 0.0));
            let start = self.middle(a) + radius;
            for feed in [self.feed, (3.0 * self.feed).min(FEED_RANGE[1])] {
                let _ = writeln!(out, "G1 {first}{start:.3} {second}{:.3} F{feed:.0}", self.middle(b));
                for turn in ["G2", "G3", "G2", "G3"] {
                    let _ = writeln!(
                        out,
                        "{turn} {first}{start:.3} {second}{:.3} {centre}-{radius:.3}",
                        self.middle(b)
                    );
                }
            }
        }
        if out.is_empty() {
            "(the same circles at three times the feed)".to_owned()
        } else {
            out.trim_end().to_owned()
        }
    }

    fn points(&self, axis: Axis, place: Option<f64>) -> String {
        let mut out = self.away(Some(axis), place.unwrap_or(0.0));
        let way = LINE_SHARE * self.way(axis);
        let first = self.middle(axis) - 0.5 * way;
        let at = |i: usize| first + way * i as f64 / (POINTS - 1) as f64;
        // past both ends first, so that the first point is approached from outside
        let beyond = 0.01 * self.way(axis);
        let _ = write!(out, "\nG0 {}{:.3}", word(axis), at(0) - beyond);
        for i in 0..POINTS {
            let _ = write!(out, "\nG1 {}{:.3} F{:.0}\nG4 P{DWELL_S:.0}", word(axis), at(i), self.feed);
        }
        let _ = write!(out, "\nG0 {}{:.3}", word(axis), at(POINTS - 1) + beyond);
        for i in (0..POINTS).rev() {
            let _ = write!(out, "\nG1 {}{:.3} F{:.0}\nG4 P{DWELL_S:.0}", word(axis), at(i), self.feed);
        }
        out
    }

    fn fine(&self, axis: Axis) -> String {
        let mut out = self.away(Some(axis), 0.0);
        let start = self.middle(axis);
        let _ = write!(out, "\nG0 {}{start:.3}", word(axis));
        let steps = (0.1 * self.way(axis)).clamp(10.0, 40.0).min(0.45 * self.way(axis)) as usize;
        // uneven: even steps would show a period under another name
        for i in 1..=steps {
            let at = start + i as f64 + 0.3 * ((i * 7) % 5) as f64 / 5.0;
            let _ = write!(out, "\nG1 {}{at:.3} F{:.0}\nG4 P1", word(axis), self.feed);
        }
        out
    }

    fn start_and_stop(&self, axis: Axis) -> String {
        let mut out = self.away(Some(axis), 0.0);
        let ends = [self.middle(axis) - 0.25 * self.way(axis), self.middle(axis) + 0.25 * self.way(axis)];
        let _ = write!(out, "\nG0 {}{:.3}", word(axis), ends[0]);
        for at in [ends[1], ends[0], ends[1], ends[0]] {
            let _ =
                write!(out, "\nG4 P2\nG1 {}{at:.3} F{:.0}", word(axis), (3.0 * self.feed).min(FEED_RANGE[1]));
        }
        out + "\nG4 P2"
    }

    fn turn(&self, about: &[char]) -> String {
        let rotary = self.moving(false);
        let axis = about
            .iter()
            .find_map(|l| rotary.iter().find(|a| letter(**a) == *l))
            .or_else(|| rotary.iter().max_by(|a, b| self.way(**a).total_cmp(&self.way(**b))));
        let Some(axis) = axis else {
            return "(the rotary axis once round in uneven steps, both ways)".to_owned();
        };
        let (low, way) = (self.low[axis.slot()], self.way(*axis));
        let points = 13;
        let at = |i: usize| {
            let uneven = if i == 0 || i == points - 1 { 0.0 } else { 0.3 * ((i * 5) % 3) as f64 / 3.0 };
            low + way * (i as f64 + uneven) / (points - 1) as f64
        };
        let mut out = "(ball at its second radius and height)\nG90".to_owned();
        for i in (0..points).chain((0..points).rev()) {
            let dwell = 1 + i % 3;
            let _ = write!(out, "\nG0 {}{:.3}\nG4 P{dwell}", word(*axis), at(i));
        }
        out
    }
}

/// The letter of an axis in the subject of an effect.
fn letter(axis: Axis) -> char {
    ['x', 'y', 'z', 'a', 'b', 'c'][axis.slot()]
}

/// Its word in a programme.
fn word(axis: Axis) -> char {
    letter(axis).to_ascii_uppercase()
}

#[cfg(test)]
mod tests {
    use super::{Motion, Programme};

    const MILL: Programme = Programme {
        low: [0.0, 100.0, -200.0, 0.0, 0.0, -90.0],
        high: [500.0, 400.0, -100.0, 0.0, 0.0, 90.0],
        feed: 1500.0,
    };

    /// Every value of a word in a programme.
    fn words(text: &str, letter: char) -> Vec<f64> {
        text.lines()
            .filter(|l| !l.starts_with('('))
            .flat_map(str::split_whitespace)
            .filter_map(|w| w.strip_prefix(letter)?.parse().ok())
            .collect()
    }

    #[test]
    fn every_programme_stays_where_the_machine_was_measured() {
        for motion in [
            Motion::Circles,
            Motion::Points,
            Motion::FineSteps,
            Motion::SecondPlace,
            Motion::ColdAndWarm,
            Motion::TwoTools,
            Motion::StartAndStop,
            Motion::SecondInstrument,
            Motion::Turn,
        ] {
            let text = MILL.text(motion, &['x']);
            for (k, letter) in ['X', 'Y', 'Z', 'A', 'B', 'C'].into_iter().enumerate() {
                for v in words(&text, letter) {
                    assert!((MILL.low[k]..=MILL.high[k]).contains(&v), "{motion:?} {letter}{v}:\n{text}");
                }
            }
        }
    }

    #[test]
    fn a_line_is_that_of_the_effect_and_comes_from_both_sides() {
        let x = words(&MILL.text(Motion::Points, &['y', 'x']), 'Y');
        let (low, high) = (x[1], x[21]);
        assert!(low < 110.0 && high > 390.0, "{x:?}");
        assert!(x[0] < low && x[22] > high && x.len() == 44, "{x:?}");
    }

    #[test]
    fn circles_have_two_feeds_and_both_ways_in_every_plane() {
        let text = MILL.text(Motion::Circles, &[]);
        assert_eq!(words(&text, 'F'), [1500.0, 4500.0].repeat(3));
        assert_eq!(text.lines().filter(|l| l.starts_with("G3")).count(), 12);
        let planes = ["G17", "G18", "G19"];
        assert!(planes.iter().all(|p| text.lines().any(|l| l == *p)), "{text}");
    }

    #[test]
    fn nothing_measured_gives_words_and_no_motion() {
        let nowhere = Programme { low: [f64::INFINITY; 6], high: [f64::NEG_INFINITY; 6], feed: 1000.0 };
        assert!(nowhere.text(Motion::Points, &['x']).starts_with('('));
        assert!(nowhere.text(Motion::Turn, &['c']).starts_with('('));
    }
}
