//! G-code of a measurement, in the dialect of a control. It moves one linear axis, at feed, between positions where that axis was measured already: how the
//! machine gets to the beginning of the line is up to who stands beside it (`M0`). What moves several axes at once, turns a
//! table or starts a spindle is said in words: the session does not tell what stands in the way.

use std::fmt::Write as _;

use super::super::library::Measurement as Motion;
use super::super::moment::{Axis, SLOTS};
use super::super::session::Session;
use volcomp_units::RAD_PER_DEG;

/// Feed where none is known from the readings, mm/min, and the least and most that is asked for.
const FEED: f64 = 1000.0;
const FEED_RANGE: [f64; 2] = [100.0, 10_000.0];
/// Least speed that counts as feed, mm/s.
const SLOWEST_MM_PER_S: f64 = 0.1;
/// Shortest way that is worth a line, mm or deg.
const WAY: f64 = 2.0;
/// Share of the way that the points take; the rest is for coming from outside.
const LINE_SHARE: f64 = 0.98;
/// Points of a line where the session was measured in motion, and most points where it was measured at rest.
const POINTS: usize = 21;
/// Positions that differ by less are one, mm or deg.
const SAME: f64 = 0.01;
/// Motions that are said in words, min: circles in three planes; a rotary axis; the spindle on, off and on.
const WORDS_MIN: [f64; 3] = [15.0, 15.0, 0.0];
/// Step of a fine line, mm, as a share of the way at most, and steps.
const FINE_MM: f64 = 0.37;
const FINE_STEPS: usize = 40;

/// Control for which part programs are written; they differ in how a dwell is written.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Dialect {
    /// LinuxCNC and other controls on which `G4 P` is in seconds.
    #[default]
    LinuxCnc,
    /// Fanuc and other controls on which `G4 P` is in milliseconds.
    Fanuc,
    /// SINUMERIK: `G4 F` in seconds.
    Sinumerik,
}

impl Dialect {
    /// What the head of a program says about it.
    const fn words(self) -> &'static str {
        match self {
            Self::LinuxCnc => "dialect LinuxCNC: G4 P in seconds",
            Self::Fanuc => "dialect Fanuc: G4 P in milliseconds",
            Self::Sinumerik => "dialect SINUMERIK: G4 F in seconds",
        }
    }

    /// The block of a dwell.
    fn dwell(self, seconds: u32) -> String {
        match self {
            Self::LinuxCnc => format!("G4 P{seconds}"),
            Self::Fanuc => format!("G4 P{}", 1000 * seconds),
            Self::Sinumerik => format!("G4 F{seconds}"),
        }
    }

    /// Seconds of a dwell block.
    fn dwell_s(self, block: &str) -> Option<f64> {
        let value: f64 = block.strip_prefix("G4 ")?.get(1..)?.parse().ok()?;
        Some(if self == Self::Fanuc { 1e-3 * value } else { value })
    }
}

/// Where and how fast the machine was measured.
pub(super) struct Program {
    low: [f64; SLOTS],
    high: [f64; SLOTS],
    /// Positions of each axis at which it was measured, where they are few.
    places: [Vec<f64>; SLOTS],
    feed: f64,
    /// Two linear axes moved at once.
    has_circles: bool,
    dialect: Dialect,
}

impl Program {
    /// The places and the usual feed of a session.
    pub(super) fn of(session: &Session, dialect: Dialect) -> Self {
        let (mut low, mut high) = ([f64::INFINITY; SLOTS], [f64::NEG_INFINITY; SLOTS]);
        let mut speeds: Vec<f64> = Vec::new();
        let mut has_circles = false;
        for m in &session.moments {
            for axis in &session.axes {
                let k = axis.slot();
                let p = if axis.is_linear() { m.position[k] } else { m.position[k] / RAD_PER_DEG };
                (low[k], high[k]) = (low[k].min(p), high[k].max(p));
            }
            let speed = (0..3).map(|k| m.velocity[k].powi(2)).sum::<f64>().sqrt();
            has_circles |= (0..3).filter(|k| m.velocity[*k].abs() > SLOWEST_MM_PER_S).count() > 1;
            if speed.is_finite() && speed > SLOWEST_MM_PER_S {
                speeds.push(60.0 * speed);
            }
        }
        speeds.sort_by(f64::total_cmp);
        let usual = speeds.get(speeds.len() / 2).copied().unwrap_or(FEED);
        // a round figure
        let feed = ((usual / 100.0).round() * 100.0).clamp(FEED_RANGE[0], FEED_RANGE[1]);
        Self { low, high, places: places(session), feed, has_circles, dialect }
    }

    /// What is to be done where the catalogue asks to repeat what the session does not have.
    pub(super) fn action(&self, motion: Motion) -> Option<&'static str> {
        (motion == Motion::Circles && !self.has_circles).then_some(
            "run circles in each plane (ballbar) at two feeds, three times apart, in both directions",
        )
    }

    /// The program; `about` are the letters of the axes that it is about, the first that moves is taken.
    pub(super) fn text(&self, motion: Motion, about: &[char]) -> String {
        match motion {
            Motion::Circles => return self.circles(),
            Motion::Turn => return self.turn(about),
            Motion::WholeTravel => {
                return "(by hand: a line from one end of the travel to the other, way still free?)"
                    .to_owned();
            }
            Motion::Spindle => {
                return "(by hand, with a probe at the tool, one reading every second)\n(spindle on for an hour at a usual \
                        speed, off for an hour, on for an hour)"
                    .to_owned();
            }
            _ => {}
        }
        let Some(axis) = self.axis(about, true) else {
            return "(the same part programs again)".to_owned();
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
            "({what}; {})\n(positions as the control showed them in the session: same zero, same tool length?)\n(by hand to \
             {letter}{low:.3}; {letter} alone will move, from {low:.3} to {high:.3}: is the way free?)\nG21 G90 G94\nM0",
            self.dialect.words()
        )
    }

    fn circles(&self) -> String {
        let slow = self.feed.min(FEED_RANGE[1] / 3.0);
        let which = if self.has_circles {
            "the circles of the session again, same centre and radius"
        } else {
            "by hand: circles in each plane, way still free?"
        };
        format!("({which}, G2 and G3, at F{slow:.0} and at F{:.0})", 3.0 * slow)
    }

    /// Positions of a line: those of the session where it was measured at few, the outermost a little inside so that they can
    /// be approached from both sides within the travel that was measured.
    fn stops(&self, axis: Axis) -> Vec<f64> {
        let inside = |share: f64| 0.5 + LINE_SHARE * (share - 0.5);
        let places = &self.places[axis.slot()];
        if places.len() < 2 {
            return (0..POINTS).map(|i| self.at(axis, inside(i as f64 / (POINTS - 1) as f64))).collect();
        }
        let (first, last) = (self.at(axis, inside(0.0)), self.at(axis, inside(1.0)));
        places.iter().map(|p| p.clamp(first, last)).collect()
    }

    fn points(&self, axis: Axis) -> String {
        let letter = word(axis);
        let stops = self.stops(axis);
        let mut out = format!("G1 {letter}{:.3} F{:.0}", self.at(axis, 0.0), self.feed);
        let dwell = self.dialect.dwell(3);
        let mut stop = |p: f64| {
            let _ = write!(out, "\nG1 {letter}{p:.3}\n{dwell}");
        };
        stops.iter().for_each(|p| stop(*p));
        // past the last point, so that it is met from the other side, too
        stop(self.at(axis, 1.0));
        stops.iter().rev().for_each(|p| stop(*p));
        out
    }

    /// Duration of a measurement as written, without its preparation, min.
    pub(super) fn minutes(&self, motion: Motion, text: &str) -> f64 {
        let mut at: Option<f64> = None;
        let mut seconds = 0.0;
        for block in text.lines() {
            seconds += self.dialect.dwell_s(block).unwrap_or(0.0);
            let target: Option<f64> =
                block.strip_prefix("G1 ").and_then(|b| b.split(' ').next()?.get(1..)?.parse().ok());
            if let Some(target) = target {
                seconds += at.map_or(0.0, |from: f64| 60.0 * (target - from).abs() / self.feed);
                at = Some(target);
            }
        }
        let [circles, turn, spindle] = WORDS_MIN;
        seconds / 60.0
            + match motion {
                Motion::Circles => circles,
                Motion::Turn => turn,
                Motion::Spindle => spindle,
                _ => 0.0,
            }
    }

    fn fine(&self, axis: Axis) -> String {
        let letter = word(axis);
        let step = FINE_MM.min(0.4 * self.way(axis) / FINE_STEPS as f64) / self.way(axis);
        let mut out = format!("G1 {letter}{:.3} F{:.0}", self.at(axis, 0.5), self.feed);
        for i in 1..=FINE_STEPS {
            // uneven: even steps would show a period under another name
            let uneven = 0.3 * ((i * 7) % 5) as f64 / 5.0;
            let (at, dwell) = (self.at(axis, 0.5 + step * (i as f64 + uneven)), self.dialect.dwell(1));
            let _ = write!(out, "\nG1 {letter}{at:.3}\n{dwell}");
        }
        out
    }

    fn start_and_stop(&self, axis: Axis) -> String {
        let letter = word(axis);
        let mut out = format!("G1 {letter}{:.3} F{:.0}", self.at(axis, 0.25), self.feed);
        for share in [0.75, 0.25, 0.75, 0.25] {
            let _ = write!(out, "\n{}\nG1 {letter}{:.3}", self.dialect.dwell(2), self.at(axis, share));
        }
        format!("{out}\n{}", self.dialect.dwell(2))
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

/// Positions of each axis in their order, where there are no more than a line has points; none otherwise.
fn places(session: &Session) -> [Vec<f64>; SLOTS] {
    core::array::from_fn(|k| {
        let Some(axis) = session.axes.iter().find(|a| a.slot() == k) else { return Vec::new() };
        let unit = if axis.is_linear() { 1.0 } else { RAD_PER_DEG };
        let mut all: Vec<f64> =
            session.moments.iter().map(|m| m.position[k] / unit).filter(|p| p.is_finite()).collect();
        all.sort_by(f64::total_cmp);
        all.dedup_by(|b, a| (*b - *a).abs() < SAME);
        if all.len() > POINTS { Vec::new() } else { all }
    })
}

/// The word of an axis in a program.
fn word(axis: Axis) -> char {
    ['X', 'Y', 'Z', 'A', 'B', 'C'][axis.slot()]
}

#[cfg(test)]
mod tests {
    use super::{Dialect, Motion, Program};

    const MILL: Program = Program {
        low: [0.0, 100.0, -200.0, 0.0, 0.0, -90.0],
        high: [500.0, 400.0, -197.6, 0.0, 0.0, 90.0],
        places: [const { Vec::new() }; 6],
        has_circles: true,
        feed: 1500.0,
        dialect: Dialect::LinuxCnc,
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

    /// Every value of a word in a program.
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
    fn the_positions_of_the_session_are_measured_where_they_are_few() {
        let places = [const { Vec::new() }; 6].map(|_: Vec<f64>| vec![0.0, 60.0, 130.0, 500.0]);
        let mill = Program { places, ..MILL };
        let x = words(&mill.text(Motion::Points, &['x']), 'X');
        assert_eq!(x[1..5], [5.0, 60.0, 130.0, 495.0], "{x:?}");
        assert_eq!(x.len(), 1 + 4 + 1 + 4, "{x:?}");
    }

    #[test]
    fn every_dialect_names_itself_and_waits_as_long() {
        let mut minutes = Vec::new();
        for (dialect, dwell) in
            [(Dialect::LinuxCnc, "G4 P3"), (Dialect::Fanuc, "G4 P3000"), (Dialect::Sinumerik, "G4 F3")]
        {
            let mill = Program { dialect, ..MILL };
            let text = mill.text(Motion::Points, &['x']);
            assert!(text.lines().any(|l| l == dwell) && text.contains(dialect.words()), "{text}");
            minutes.push(mill.minutes(Motion::Points, &text));
        }
        // 43 dwells of 3 s, and 500 mm there and back at 1500 mm/min
        assert!(
            minutes.iter().all(|m| (m - (43.0 * 3.0 / 60.0 + 1000.0 / 1500.0)).abs() < 0.1),
            "{minutes:?}"
        );
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
        let nowhere = Program { low: [f64::INFINITY; 6], high: [f64::NEG_INFINITY; 6], ..MILL };
        for motion in ALL {
            assert!(blocks(&nowhere.text(motion, &['x'])).is_empty(), "{motion:?}");
        }
    }
}
