//! Words to segments: modal state, planes, arcs.

use core::f64::consts::TAU;

use volcomp_units::axes::{AxisArray, AxisName};

use super::super::axes::MachineAxes;
use super::super::segment::{Arc, SHORTEST, Segment, Shape};
use super::lex::{self, Mark, Word};
use super::{GcodeError, MAX_DWELL_S, MAX_RADIUS_DIFFERENCE_MM, MAX_SEGMENTS, Problem, Program};

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Motion {
    Rapid,
    Line,
    Clockwise,
    CounterClockwise,
}

/// A plane: its first and second axis, and the letters of the centre.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Plane {
    name: &'static str,
    axes: [AxisName; 2],
    centre: [char; 2],
    offsets: &'static str,
}

const XY: Plane = Plane { name: "XY", axes: [AxisName::X, AxisName::Y], centre: ['I', 'J'], offsets: "I J" };
const ZX: Plane = Plane { name: "ZX", axes: [AxisName::Z, AxisName::X], centre: ['K', 'I'], offsets: "K I" };
const YZ: Plane = Plane { name: "YZ", axes: [AxisName::Y, AxisName::Z], centre: ['J', 'K'], offsets: "J K" };

/// Interprets a whole program that starts at `start` (mm or deg, wire order).
///
/// # Errors
/// The first thing that is wrong, with line and column.
pub fn interpret(text: &str, axes: &MachineAxes, start: AxisArray) -> Result<Program, GcodeError> {
    let mut state = Interpreter {
        axes,
        segments: Vec::new(),
        position: start,
        motion: None,
        plane: XY,
        incremental: false,
        exact_stop: false,
        feed: None,
        mark: None,
        line: 0,
        tool_centre: false,
    };
    for (number, line) in text.strip_prefix('\u{feff}').unwrap_or(text).lines().enumerate() {
        state.line = u32::try_from(number + 1).unwrap_or(u32::MAX);
        let block = lex::block(line, state.line)?;
        state.mark = block.mark.or(state.mark);
        if state.block(&block.words)? {
            break;
        }
    }
    if state.mark.is_none() {
        for segment in &mut state.segments {
            segment.scored = !segment.rapid && !matches!(segment.shape, Shape::Dwell(_));
        }
    }
    state.switch_tool_centre(false);
    Ok(Program { segments: state.segments, end: state.position })
}

struct Interpreter<'a> {
    axes: &'a MachineAxes,
    segments: Vec<Segment>,
    position: AxisArray,
    motion: Option<Motion>,
    plane: Plane,
    incremental: bool,
    exact_stop: bool,
    feed: Option<f64>,
    mark: Option<Mark>,
    line: u32,
    /// X, Y and Z are those of the tool tip; so is `position`.
    tool_centre: bool,
}

/// What one block asks for besides modal changes.
#[derive(Default)]
struct Request {
    dwell: Option<Word>,
    end: bool,
}

impl Interpreter<'_> {
    fn error(&self, word: &Word, problem: Problem) -> GcodeError {
        GcodeError { line: self.line, column: word.column, problem }
    }

    /// Carries one block out; true where it ends the program.
    fn block(&mut self, words: &[Word]) -> Result<bool, GcodeError> {
        self.check_once(words)?;
        let request = self.codes(words)?;
        if let Some(f) = words.iter().find(|w| w.letter == 'F') {
            if f.value <= 0.0 || f.value > 1e6 {
                return Err(self.error(f, Problem::Feed { value: f.value }));
            }
            self.feed = Some(f.value);
        }
        let target = self.target(words)?;
        if let Some(dwell) = &request.dwell {
            self.dwell(words, dwell)?;
        } else if let Some(p) = words.iter().find(|w| w.letter == 'P') {
            return Err(self.error(p, Problem::Meaningless { letter: 'P', belongs_to: "G4" }));
        }
        self.motion(words, target, request.dwell.is_some())?;
        Ok(request.end)
    }

    /// No letter twice, no two codes of one group.
    fn check_once(&self, words: &[Word]) -> Result<(), GcodeError> {
        for (k, word) in words.iter().enumerate() {
            let group = group(word);
            for other in &words[..k] {
                if other.letter != word.letter {
                    continue;
                }
                match word.letter {
                    'G' | 'M' => {
                        if group.is_some() && self::group(other) == group {
                            let (letter, first, second) = (word.letter, other.value, word.value);
                            return Err(self.error(word, Problem::SameGroup { letter, first, second }));
                        }
                    }
                    letter => return Err(self.error(word, Problem::Twice { letter })),
                }
            }
        }
        Ok(())
    }

    fn codes(&mut self, words: &[Word]) -> Result<Request, GcodeError> {
        let mut request = Request::default();
        for word in words {
            let unsupported = Problem::Unsupported { letter: word.letter, value: word.value };
            match (word.letter, code(word.value)) {
                ('G', Some(0)) => self.motion = Some(Motion::Rapid),
                ('G', Some(1)) => self.motion = Some(Motion::Line),
                ('G', Some(2)) => self.motion = Some(Motion::Clockwise),
                ('G', Some(3)) => self.motion = Some(Motion::CounterClockwise),
                ('G', Some(4)) => request.dwell = Some(*word),
                ('G', Some(17)) => self.plane = XY,
                ('G', Some(18)) => self.plane = ZX,
                ('G', Some(19)) => self.plane = YZ,
                ('G', Some(20)) => return Err(self.error(word, Problem::Inch)),
                ('G', Some(49)) => self.switch_tool_centre(false),
                ('G', None) if word.value == TOOL_CENTRE => {
                    if self.axes.tool_centre().is_none() {
                        return Err(self.error(word, Problem::NoToolCentre { axes: self.axes.letters() }));
                    }
                    self.switch_tool_centre(true);
                }
                ('G', Some(21 | 40 | 80 | 94)) | ('M', Some(0 | 1 | 3 | 4 | 5 | 7 | 8 | 9)) => {}
                ('G', Some(61)) => self.exact_stop = true,
                ('G', Some(64)) => self.exact_stop = false,
                ('G', Some(90)) => self.incremental = false,
                ('G', Some(91)) => self.incremental = true,
                ('M', Some(2 | 30)) => request.end = true,
                ('G' | 'M', _) => return Err(self.error(word, unsupported)),
                // the number of the tool length; the control has one tool
                ('H', _) if words.iter().any(|w| w.letter == 'G' && w.value == TOOL_CENTRE) => {}
                ('N' | 'F' | 'S' | 'P' | 'I' | 'J' | 'K' | 'R', _) => {}
                (letter, _) => {
                    let axis = AxisName::from_letter(letter).and_then(|a| self.axes.index(a));
                    if axis.is_none() {
                        let known = AxisName::from_letter(letter).is_some();
                        let axes = self.axes.letters();
                        return Err(self.error(
                            word,
                            if known { Problem::NoAxis { letter, axes } } else { unsupported },
                        ));
                    }
                }
            }
        }
        Ok(request)
    }

    /// Switches tool-centre-point motion on or off where the axes stand.
    fn switch_tool_centre(&mut self, on: bool) {
        if let Some(kinematics) = self.axes.tool_centre()
            && on != self.tool_centre
        {
            self.position =
                if on { kinematics.programmed(&self.position) } else { kinematics.axes(&self.position) };
            self.tool_centre = on;
        }
    }

    /// The end of the block's motion; `None` where it names no axis.
    fn target(&self, words: &[Word]) -> Result<Option<AxisArray>, GcodeError> {
        let mut target = self.position;
        let mut any = false;
        for word in words.iter().filter(|w| w.letter != 'S') {
            if let Some(k) = AxisName::from_letter(word.letter).and_then(|a| self.axes.index(a)) {
                target[k] = if self.incremental { target[k] + word.value } else { word.value };
                any = true;
                let travel = self.axes.as_slice()[k].travel;
                if self.tool_centre && self.axes.is_linear(k) {
                    // where the axis goes depends on the head: checked along the path
                    continue;
                }
                if target[k] < travel[0] - 1e-9 || target[k] > travel[1] + 1e-9 {
                    return Err(self.error(word, self.outside(k, target[k])));
                }
            }
        }
        Ok(any.then_some(target))
    }

    fn outside(&self, k: usize, value: f64) -> Problem {
        let axis = &self.axes.as_slice()[k];
        Problem::Travel { axis: axis.name, value, low: axis.travel[0], high: axis.travel[1] }
    }

    fn dwell(&mut self, words: &[Word], g4: &Word) -> Result<(), GcodeError> {
        let Some(p) = words.iter().find(|w| w.letter == 'P') else {
            return Err(self.error(g4, Problem::NoDwell));
        };
        if !(0.0..=MAX_DWELL_S).contains(&p.value) {
            return Err(self.error(p, Problem::Dwell { value: p.value }));
        }
        self.push(self.position, Shape::Dwell(p.value), false, g4)
    }

    fn motion(
        &mut self,
        words: &[Word],
        target: Option<AxisArray>,
        dwelling: bool,
    ) -> Result<(), GcodeError> {
        let centre_words = words.iter().filter(|w| matches!(w.letter, 'I' | 'J' | 'K' | 'R'));
        let centre = centre_words.clone().next();
        let arc = matches!(self.motion, Some(Motion::Clockwise | Motion::CounterClockwise));
        if let Some(word) = centre
            && (!arc || dwelling)
        {
            let problem = Problem::Meaningless { letter: word.letter, belongs_to: "G2 and G3" };
            return Err(self.error(word, problem));
        }
        let Some(first) = words.iter().find(|w| is_axis(w)).or(centre) else { return Ok(()) };
        if dwelling {
            let problem = Problem::Meaningless { letter: first.letter, belongs_to: "a block without G4" };
            return Err(self.error(first, problem));
        }
        let target = target.unwrap_or(self.position);
        let Some(motion) = self.motion else {
            let problem = Problem::Meaningless { letter: first.letter, belongs_to: "G0, G1, G2 or G3" };
            return Err(self.error(first, problem));
        };
        if motion != Motion::Rapid && self.feed.is_none() {
            return Err(self.error(first, Problem::NoFeed));
        }
        let shape = match motion {
            Motion::Rapid | Motion::Line => Shape::Line,
            Motion::Clockwise => self.arc(words, &target, true, first)?,
            Motion::CounterClockwise => self.arc(words, &target, false, first)?,
        };
        self.push(target, shape, motion == Motion::Rapid, first)?;
        self.position = target;
        Ok(())
    }

    fn arc(
        &self,
        words: &[Word],
        target: &AxisArray,
        clockwise: bool,
        first: &Word,
    ) -> Result<Shape, GcodeError> {
        let plane = self.plane;
        let index = |n: usize| self.axes.index(plane.axes[n]);
        let (Some(u), Some(v)) = (index(0), index(1)) else {
            let problem = Problem::NoPlane { plane: plane.name, axes: self.axes.letters() };
            return Err(self.error(first, problem));
        };
        let start = [self.position[u], self.position[v]];
        let end = [target[u], target[v]];
        let chord = (end[0] - start[0]).hypot(end[1] - start[1]);
        let offset = |letter: char| words.iter().find(|w| w.letter == letter);
        let radius = offset('R');
        let given = words.iter().find(|w| matches!(w.letter, 'I' | 'J' | 'K'));
        let centre = match (given, radius) {
            (Some(word), Some(_)) => return Err(self.error(word, Problem::CentreAndRadius)),
            (None, None) => return Err(self.error(first, Problem::NoCentre { offsets: plane.offsets })),
            (None, Some(r)) => {
                if chord <= SHORTEST {
                    return Err(self.error(r, Problem::FullByRadius { offsets: plane.offsets }));
                }
                if r.value.abs() < 0.5 * chord - 1e-6 {
                    let problem = Problem::ShortRadius { radius_mm: r.value, chord_mm: chord };
                    return Err(self.error(r, problem));
                }
                centre_of_radius(start, end, r.value, clockwise)
            }
            (Some(_), None) => {
                if let Some(w) = words
                    .iter()
                    .find(|w| matches!(w.letter, 'I' | 'J' | 'K') && !plane.centre.contains(&w.letter))
                {
                    let problem = Problem::NotInPlane { letter: w.letter, offsets: plane.offsets };
                    return Err(self.error(w, problem));
                }
                let add = |n: usize| start[n] + offset(plane.centre[n]).map_or(0.0, |w| w.value);
                [add(0), add(1)]
            }
        };
        let radii = [
            (start[0] - centre[0]).hypot(start[1] - centre[1]),
            (end[0] - centre[0]).hypot(end[1] - centre[1]),
        ];
        if (radii[1] - radii[0]).abs() > MAX_RADIUS_DIFFERENCE_MM || radii[0] <= 1e-6 {
            let problem = Problem::Radius { start_mm: radii[0], end_mm: radii[1] };
            return Err(self.error(given.or(radius).unwrap_or(first), problem));
        }
        let from = (start[1] - centre[1]).atan2(start[0] - centre[0]);
        let to = (end[1] - centre[1]).atan2(end[0] - centre[0]);
        let sweep = if chord <= SHORTEST { TAU } else { turn(if clockwise { from - to } else { to - from }) };
        let sweep = if clockwise { -sweep } else { sweep };
        Ok(Shape::Arc(Arc { plane: [u, v], centre, radius: radii, from, sweep }))
    }

    fn push(&mut self, end: AxisArray, shape: Shape, rapid: bool, word: &Word) -> Result<(), GcodeError> {
        if self.segments.len() >= MAX_SEGMENTS {
            return Err(self.error(word, Problem::TooLong));
        }
        let segment = Segment {
            start: self.position,
            end,
            shape,
            rapid,
            feed_per_min: self.feed.unwrap_or(0.0),
            exact_stop: self.exact_stop,
            scored: self.mark == Some(Mark::On),
            line: self.line,
            tool_centre: self.tool_centre,
        };
        let [low, high] = match self.axes.tool_centre().filter(|_| segment.tool_centre) {
            Some(kinematics) => kinematics.extent(&segment),
            None => segment.extent(),
        };
        if let Some((k, value)) = self.axes.outside(&low).or_else(|| self.axes.outside(&high)) {
            return Err(self.error(word, self.outside(k, value)));
        }
        self.segments.push(segment);
        Ok(())
    }
}

/// An angle in (0, 2 pi].
fn turn(angle: f64) -> f64 {
    let angle = angle.rem_euclid(TAU);
    if angle < 1e-12 { TAU } else { angle }
}

/// The centre of an arc given by its radius; a negative radius takes the long way round.
fn centre_of_radius(start: [f64; 2], end: [f64; 2], radius: f64, clockwise: bool) -> [f64; 2] {
    let (dx, dy) = (end[0] - start[0], end[1] - start[1]);
    let chord = dx.hypot(dy);
    let height = (radius * radius - 0.25 * chord * chord).max(0.0).sqrt();
    // to the left of the chord for a short counter-clockwise arc
    let side = if clockwise == (radius < 0.0) { 1.0 } else { -1.0 };
    [
        0.5 * (start[0] + end[0]) - side * height * dy / chord,
        0.5 * (start[1] + end[1]) + side * height * dx / chord,
    ]
}

fn is_axis(word: &Word) -> bool {
    word.letter != 'S' && AxisName::from_letter(word.letter).is_some()
}

/// A whole code number.
fn code(value: f64) -> Option<u32> {
    (value.fract() == 0.0 && (0.0..1000.0).contains(&value)).then_some(value as u32)
}

/// Tool-centre-point motion on.
const TOOL_CENTRE: f64 = 43.4;

/// Modal group: codes of one group exclude each other in a block.
fn group(word: &Word) -> Option<u8> {
    if word.letter == 'G' && word.value == TOOL_CENTRE {
        return Some(8);
    }
    match (word.letter, code(word.value)?) {
        ('G', 0..=3 | 80) => Some(1),
        ('G', 17..=19) => Some(2),
        ('G', 90 | 91) => Some(3),
        ('G', 4) => Some(4),
        ('G', 94) => Some(5),
        ('G', 20 | 21) => Some(6),
        ('G', 40) => Some(7),
        ('G', 49) => Some(8),
        ('G', 61 | 64) => Some(13),
        ('M', 0..=2 | 30) => Some(20),
        ('M', 3..=5) => Some(21),
        ('M', 7..=9) => Some(22),
        _ => None,
    }
}

#[cfg(test)]
mod tests;
