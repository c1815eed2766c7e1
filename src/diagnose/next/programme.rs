//! G-code of a measurement. It moves one linear axis, at feed, between positions where that axis was measured already: how the
//! machine gets to the beginning of the line is up to who stands beside it (`M0`). What moves several axes at once, turns a
//! table or starts a spindle is said in words: the session does not tell what stands in the way.

use std::fmt::Write as _;

use super::super::moment::{Axis, SLOTS};
use super::super::session::Session;
use volcomp_units::RAD_PER_DEG;

/// Feed where none is known from the readings, mm/min, and the least and most that is asked for.
const FEED: f64 = 1000.0;
const FEED_RANGE: [f64; 2] = [100.0, 10_000.0];
/// Shortest way that is worth a line, mm or deg.
const WAY: f64 = 2.0;
/// Share of the way that the points take; the rest is for coming from outside.
const LINE_SHARE: f64 = 0.98;
/// Points of a line.
const POINTS: usize = 21;
/// Step of a fine line, mm, as a share of the way at most, and steps.
const FINE_MM: f64 = 0.37;
const FINE_STEPS: usize = 40;

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
    /// A line from one end of the travel to the other.
    WholeTravel,
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
        match motion {
            Motion::Circles => return self.circles(),
            Motion::Turn => return self.turn(about),
            Motion::WholeTravel => {
                return "(by hand: a line from one end of the travel to the other, way still free?)"
                    .to_owned();
            }
            Motion::Spindle => {
                return "(by hand, with a probe at the tool, a reading a second:)\n(spindle on for an hour at a usual \
                        speed, off for an hour, on for an hour)"
                    .to_owned();
            }
            _ => {}
        }
        let Some(axis) = self.axis(about, true) else {
            return "(the same programmes again)".to_owned();
        };
        let (line, letter) = (self.points(axis), word(axis));
        let halves = |first: &str, second: &str| {
            format!("{}\n{line}\n({second})\nM0\n{line}\nM2", self.head(axis, first))
        };
        match motion {
            Motion::SecondPlace => halves(
                "the other axes where this line was measured",
                "by hand: the other axes to their second place, way still free?",
            ),
            Motion::ColdAndWarm => halves(
                "machine cold",
                "warm up for an hour, spindle and axes at work, instrument taken out; then as before",
            ),
            Motion::TwoTools => {
                halves("shorter tool", "longer tool, same setup of the instrument, way still free?")
            }
            Motion::SecondInstrument => halves("instrument as before", "instrument at its second station"),
            Motion::FineSteps => format!("{}\n{}\nM2", self.head(axis, "uneven steps"), self.fine(axis)),
            Motion::StartAndStop => {
                let head = self.head(axis, "instrument and control on one trigger");
                format!("{head}\n{}\nM2", self.start_and_stop(axis))
            }
            _ => format!("{}\n{line}\nM2", self.head(axis, &format!("{letter} from both sides"))),
        }
    }

    /// The first of the axes named that was moved, otherwise the one with the longest way.
    fn axis(&self, about: &[char], linear: bool) -> Option<Axis> {
        let moved = || Axis::ALL.into_iter().filter(|a| a.is_linear() == linear && self.way(*a) >= WAY);
        about
            .iter()
            .find_map(|l| moved().find(|a| word(*a).eq_ignore_ascii_case(l)))
            .or_else(|| moved().max_by(|a, b| self.way(*a).total_cmp(&self.way(*b))))
    }

    fn way(&self, axis: Axis) -> f64 {
        let way = self.high[axis.slot()] - self.low[axis.slot()];
        if way.is_finite() { way } else { 0.0 }
    }

    /// Position at a share of the way.
    fn at(&self, axis: Axis, share: f64) -> f64 {
        let (low, high) = (self.low[axis.slot()], self.high[axis.slot()]);
        (low + share * (high - low)).clamp(low, high)
    }

    /// What is said before anything moves.
    fn head(&self, axis: Axis, what: &str) -> String {
        let (letter, low, high) = (word(axis), self.at(axis, 0.0), self.at(axis, 1.0));
        format!(
            "({what})\n(positions as the control showed them in the session: same zero, same tool length?)\n(by hand to \
             {letter}{low:.3}; {letter} alone will move, from {low:.3} to {high:.3}: is the way free?)\nG21 G90 G94\nM0"
        )
    }

    fn circles(&self) -> String {
        let slow = self.feed.min(FEED_RANGE[1] / 3.0);
        format!(
            "(the circles of the session again, same centre and radius, G2 and G3, at F{slow:.0} and at F{:.0})",
            3.0 * slow
        )
    }

    fn points(&self, axis: Axis) -> String {
        let letter = word(axis);
        let share = |i: usize| 0.5 + LINE_SHARE * (i as f64 / (POINTS - 1) as f64 - 0.5);
        let mut out = format!("G1 {letter}{:.3} F{:.0}", self.at(axis, 0.0), self.feed);
        let mut stop = |s: f64| {
            let _ = write!(out, "\nG1 {letter}{:.3}\nG4 P3", self.at(axis, s));
        };
        (0..POINTS).for_each(|i| stop(share(i)));
        // past the last point, so that it is met from the other side, too
        stop(1.0);
        (0..POINTS).rev().for_each(|i| stop(share(i)));
        out
    }

    fn fine(&self, axis: Axis) -> String {
        let letter = word(axis);
        let step = FINE_MM.min(0.4 * self.way(axis) / FINE_STEPS as f64) / self.way(axis);
        let mut out = format!("G1 {letter}{:.3} F{:.0}", self.at(axis, 0.5), self.feed);
        for i in 1..=FINE_STEPS {
            // uneven: even steps would show a period under another name
            let uneven = 0.3 * ((i * 7) % 5) as f64 / 5.0;
            let _ = write!(out, "\nG1 {letter}{:.3}\nG4 P1", self.at(axis, 0.5 + step * (i as f64 + uneven)));
        }
        out
    }

    fn start_and_stop(&self, axis: Axis) -> String {
        let letter = word(axis);
        let mut out = format!("G1 {letter}{:.3} F{:.0}", self.at(axis, 0.25), self.feed);
        for share in [0.75, 0.25, 0.75, 0.25] {
            let _ = write!(out, "\nG4 P2\nG1 {letter}{:.3}", self.at(axis, share));
        }
        out + "\nG4 P2"
    }

    fn turn(&self, about: &[char]) -> String {
        let Some(axis) = self.axis(about, false) else {
            return "(the rotary axis once round in uneven steps, both ways)".to_owned();
        };
        let points = 13;
        let angles: Vec<String> = (0..points)
            .map(|i| {
                let uneven = if i == 0 || i == points - 1 { 0.0 } else { 0.3 * ((i * 5) % 3) as f64 / 3.0 };
                format!("{:.0}", self.at(axis, (i as f64 + uneven) / (points - 1) as f64))
            })
            .collect();
        format!(
            "(the R-test of the session again, ball at a second radius and height, {} at {} and back)",
            word(axis),
            angles.join(" ")
        )
    }
}

/// The word of an axis in a programme.
fn word(axis: Axis) -> char {
    ['X', 'Y', 'Z', 'A', 'B', 'C'][axis.slot()]
}

#[cfg(test)]
mod tests {
    use super::{Motion, Programme};

    const MILL: Programme = Programme {
        low: [0.0, 100.0, -200.0, 0.0, 0.0, -90.0],
        high: [500.0, 400.0, -197.6, 0.0, 0.0, 90.0],
        feed: 1500.0,
    };
    const ALL: [Motion; 11] = [
        Motion::Circles,
        Motion::Points,
        Motion::FineSteps,
        Motion::SecondPlace,
        Motion::ColdAndWarm,
        Motion::TwoTools,
        Motion::Spindle,
        Motion::StartAndStop,
        Motion::SecondInstrument,
        Motion::Turn,
        Motion::WholeTravel,
    ];

    /// The blocks that a control carries out.
    fn blocks(text: &str) -> Vec<&str> {
        text.lines().filter(|l| !l.starts_with('(')).collect()
    }

    /// Every value of a word in a programme.
    fn words(text: &str, letter: char) -> Vec<f64> {
        blocks(text)
            .into_iter()
            .flat_map(str::split_whitespace)
            .filter_map(|w| w.strip_prefix(letter)?.parse().ok())
            .collect()
    }

    #[test]
    fn one_axis_moves_at_feed_where_it_was_measured_and_waits_for_a_hand_first() {
        for (about, own) in [('x', 0), ('y', 1), ('z', 2)] {
            for motion in ALL {
                let text = MILL.text(motion, &[about]);
                for (k, letter) in ['X', 'Y', 'Z', 'A', 'B', 'C'].into_iter().enumerate() {
                    let values = words(&text, letter);
                    assert!(k == own || values.is_empty(), "{motion:?} moves {letter}:\n{text}");
                    for v in values {
                        assert!((MILL.low[k]..=MILL.high[k]).contains(&v), "{motion:?} {letter}{v}:\n{text}");
                    }
                }
                let own: Vec<&str> = blocks(&text);
                assert!(own.iter().all(|b| !b.starts_with("G0") && !b.starts_with("M3")), "{text}");
                let moves = own.iter().position(|b| b.starts_with("G1"));
                let waits = own.iter().position(|b| *b == "M0");
                assert!(moves.is_none() || waits < moves, "{motion:?}:\n{text}");
            }
        }
    }

    #[test]
    fn every_point_of_a_line_is_met_from_both_sides() {
        let y = words(&MILL.text(Motion::Points, &['y', 'x']), 'Y');
        assert_eq!(y.len(), 1 + 21 + 1 + 21, "{y:?}");
        assert!(y[0] < y[1] && y[22] > y[21] && y[22] > y[23], "{y:?}");
        assert!(y[1..22].iter().zip(y[23..].iter().rev()).all(|(a, b)| (a - b).abs() < 1e-9), "{y:?}");
    }

    #[test]
    fn halves_are_kept_apart_by_a_stop() {
        for motion in [Motion::SecondPlace, Motion::ColdAndWarm, Motion::TwoTools, Motion::SecondInstrument] {
            let text = MILL.text(motion, &['x']);
            assert_eq!(blocks(&text).iter().filter(|b| **b == "M0").count(), 2, "{text}");
        }
    }

    #[test]
    fn fine_steps_are_finer_than_a_screw_and_differ() {
        let x = words(&MILL.text(Motion::FineSteps, &['x']), 'X');
        let steps: Vec<f64> = x.windows(2).map(|w| w[1] - w[0]).collect();
        assert!(steps.iter().all(|s| (0.1..0.6).contains(s)), "{steps:?}");
        assert!(steps.iter().any(|s| (s - steps[0]).abs() > 0.02), "{steps:?}");
    }

    #[test]
    fn nothing_measured_gives_words_and_no_motion() {
        let nowhere = Programme { low: [f64::INFINITY; 6], high: [f64::NEG_INFINITY; 6], feed: 1000.0 };
        for motion in ALL {
            assert!(blocks(&nowhere.text(motion, &['x'])).is_empty(), "{motion:?}");
        }
    }
}
