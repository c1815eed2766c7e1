//! Part programs with corrected positions: block by block, by the correction that the daemon applies (static model).
//!
//! A block with motion (`G0`, `G1`) gets every corrected axis at its end, because the corrections of all axes change with the
//! position. A feed block in which the correction leaves a straight line between its ends by more than the tolerance is
//! divided into equal parts; where reversals change it by more, a block at the place of the reversal comes before. Comments, block numbers, feeds, M words and other words stay as they are. What would
//! move by other rules than straight lines in absolute coordinates is refused with line and remedy: the list is
//! [`REFUSED`].
//!
//! Source: equations 2.4 (offset added to the uncorrected programmed coordinate).

mod lex;

use core::fmt::Write as _;

use volcomp_model::geometry::Vec3;
use volcomp_model::{AxisCorrection, Model, Pose};
use volcomp_units::axes::{AxisArray, AxisKind, AxisName, MAX_AXES, Travel};
use volcomp_units::{arcsec_from_rad, deg_from_rad, rad_from_deg, um_from_mm};

use lex::{Word, words};

/// Most parts of a block.
const PARTS_MAX: u32 = 4096;
/// Largest file that may come out, bytes.
const OUT_MAX: usize = 1 << 30;

/// G codes that pass unchanged; times 10.
const PASSED: [u32; 19] =
    [0, 10, 40, 170, 180, 190, 210, 400, 490, 540, 550, 560, 570, 580, 590, 610, 640, 900, 940];

/// G codes that are refused: first and last times 10, name, remedy.
pub const REFUSED: [(u32, u32, &str, &str); 11] = [
    (20, 39, "arc", "let the CAM system output straight lines"),
    (50, 59, "curve", "let the CAM system output straight lines"),
    (200, 209, "inch units", "convert the program to mm"),
    (280, 309, "reference point return", "move it into a program of its own that is not corrected"),
    (410, 429, "cutter compensation", "let the CAM system output compensated paths, with G40"),
    (430, 439, "tool length offset or tool-centre-point motion", "program the axes, or give --work-offset"),
    (520, 539, "shifted or machine coordinates", "use one work offset, given by --work-offset"),
    (730, 769, "canned cycle", "let the CAM system expand the cycle into blocks"),
    (810, 899, "canned cycle", "let the CAM system expand the cycle into blocks"),
    (910, 919, "incremental mode", "use absolute positions (G90)"),
    (920, 939, "set position or inverse-time feed", "use absolute positions and feed per minute (G94)"),
];

/// How a program is corrected. Axes in chain order, mm and rad.
#[derive(Debug, Clone)]
pub struct Request<'a> {
    /// The model.
    pub model: &'a Model,
    /// Axes that may be moved.
    pub corrected: [bool; MAX_AXES],
    /// Where the machine stands at the start, programmed; `None` where unknown.
    pub start: [Option<f64>; MAX_AXES],
    /// Machine coordinate minus programmed coordinate.
    pub work_offset: AxisArray,
    /// Largest distance of the correction within a block from the straight line between its ends: linear and rotary axes.
    pub tolerance: [f64; 2],
    /// Largest correction: linear and rotary axes.
    pub limit: [f64; 2],
}

/// The corrected program and what is to be said about it.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Corrected {
    /// The program.
    pub text: String,
    /// Blocks with motion before.
    pub blocks: usize,
    /// Blocks with motion after.
    pub blocks_out: usize,
    /// Largest correction of each axis by size, mm or rad.
    pub largest: AxisArray,
    /// Largest position error that stays, by size, mm in W.
    pub rest: Vec3,
    /// Line of the largest rest of any direction; 0 without motion.
    pub rest_line: usize,
    /// Of each axis the blocks that end where a curve of the model does not reach, so that its end value is held, and the line of
    /// the first of them.
    pub held: [Option<(usize, usize)>; MAX_AXES],
}

/// Why a program is not corrected.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{line}:{column}: {what}")]
pub struct ProgramError {
    /// Line, 1-based.
    pub line: usize,
    /// Column in bytes, 1-based.
    pub column: usize,
    /// What is wrong and what to do.
    pub what: String,
}

/// Corrects a program.
///
/// # Errors
/// Something that is not understood and could move an axis, an axis whose position is unknown, or a correction beyond
/// its limit or the travel.
pub fn correct(text: &str, request: &Request<'_>) -> Result<Corrected, ProgramError> {
    let mut run = Run {
        request,
        axes: request.model.axes().map(|a| a.name).collect(),
        position: request.start,
        travel: [Travel::Forward; MAX_AXES],
        motion: None,
        work: None,
        line: 0,
        out: Corrected { text: String::with_capacity(2 * text.len()), ..Corrected::default() },
        begun: false,
        next_tool: None,
        tool: None,
        by_m6: false,
    };
    let program = text.strip_prefix('\u{feff}').unwrap_or(text);
    run.by_m6 = program.lines().any(|l| words(l).is_ok_and(|w| w.iter().any(|w| w.is('M', 6.0))));
    run.out.text.push_str(&text[..text.len() - program.len()]);
    for (n, line) in program.split_inclusive('\n').enumerate() {
        run.line = n + 1;
        let body = line.trim_end_matches(['\n', '\r']);
        run.block(body, &line[body.len()..])?;
        if run.out.text.len() > OUT_MAX {
            return Err(run.fail(
                0,
                "the corrected program exceeds 1 GiB; enlarge --tolerance-um or --tolerance-arcsec",
            ));
        }
    }
    Ok(run.out)
}

/// Correction at a position.
struct At {
    offset: AxisArray,
    rest: Vec3,
    /// Axes beyond the range of a curve, a bit each.
    held: u16,
}

struct Run<'a> {
    request: &'a Request<'a>,
    axes: Vec<AxisName>,
    /// Programmed, mm and rad.
    position: [Option<f64>; MAX_AXES],
    travel: [Travel; MAX_AXES],
    /// G0 (false) or G1 (true).
    motion: Option<bool>,
    /// Work offset in use.
    work: Option<u32>,
    /// A block with words has been read.
    begun: bool,
    /// Tool named last, and tool in the spindle.
    next_tool: Option<f64>,
    tool: Option<Option<f64>>,
    /// `M6` changes the tool; without it the T word does (turret).
    by_m6: bool,
    line: usize,
    out: Corrected,
}

impl Run<'_> {
    fn fail(&self, at: usize, what: impl Into<String>) -> ProgramError {
        ProgramError { line: self.line, column: at + 1, what: what.into() }
    }

    fn axis(&self, word: &Word<'_>) -> Option<usize> {
        let name = AxisName::from_letter(word.letter)?;
        // S is the spindle speed
        (word.letter != 'S').then(|| self.axes.iter().position(|a| *a == name)).flatten()
    }

    /// One line and its line end.
    fn block(&mut self, text: &str, end: &str) -> Result<(), ProgramError> {
        let words = words(text).map_err(|(at, what)| self.fail(at, what))?;
        for word in &words {
            self.code(word)?;
        }
        let has = |letter: char, value: f64| words.iter().any(|w| w.is(letter, value));
        if let Some(p) = words.iter().find(|w| w.letter == 'P')
            && (54..=59).any(|g| has('G', f64::from(g)))
            && !(has('G', 4.0) || has('G', 64.0))
        {
            return Err(self.fail(
                p.from,
                format!("{} (additional work offset) is not corrected; use one of G54 to G59, given by --work-offset", p.text),
            ));
        }
        self.begun |= !words.is_empty();
        let moved: Vec<(usize, &Word<'_>)> = words.iter().filter_map(|w| Some((self.axis(w)?, w))).collect();
        let Some(&(_, last)) = moved.last() else {
            self.out.text.push_str(text);
            self.out.text.push_str(end);
            return Ok(());
        };
        if let Some(dwell) = words.iter().find(|w| w.letter == 'G' && w.value == 4.0) {
            return Err(self.fail(dwell.from, "a dwell with axis words; write them in blocks of their own"));
        }
        let Some(feed) = self.motion else {
            return Err(self.fail(last.from, "axis words before G0 or G1; write the motion before them"));
        };
        let mut target = self.position;
        for (k, word) in &moved {
            if moved.iter().filter(|m| m.0 == *k).count() > 1 {
                return Err(
                    self.fail(word.from, format!("{} stands twice in this block; keep one", word.letter))
                );
            }
            target[*k] = Some(if self.is_rotary(*k) { rad_from_deg(word.value) } else { word.value });
        }
        let from = self.position;
        let to = self.known(&target, last.from)?;
        if let Ok(start) = self.known(&from, last.from) {
            let came = self.travel;
            self.turn(&start, &to);
            if feed && self.travel != came {
                let [before, after] = [came, self.travel].map(|t| self.at_after(&start, t).offset);
                if self.is_bent(|k| after[k] - before[k]).is_some() {
                    self.write_reversal(&words, &moved, &start, end)?;
                }
            }
        }
        let parts = if feed { self.parts(&from, &to, last.from)? } else { 1 };
        if parts > 1
            && let Some(m) = words.iter().find(|w| w.letter == 'M')
        {
            return Err(self
                .fail(m.from, "an M word in a block that must be divided; write it in a block of its own"));
        }
        self.write((text, end), &moved, &from, &to, parts)?;
        self.out.text.push_str(if end.is_empty() && parts > 1 { "" } else { end });
        self.position = target;
        Ok(())
    }

    fn is_rotary(&self, k: usize) -> bool {
        self.axes[k].kind() == AxisKind::Rotary
    }

    /// Takes in a G or M code, or refuses it.
    fn code(&mut self, word: &Word<'_>) -> Result<(), ProgramError> {
        let tenths = (10.0 * word.value).round();
        let code = if (0.0..10_000.0).contains(&tenths) { tenths as u32 } else { u32::MAX };
        match word.letter {
            'G' => {
                if let Some((.., name, remedy)) = REFUSED.iter().find(|r| (r.0..=r.1).contains(&code)) {
                    return Err(
                        self.fail(word.from, format!("{} ({name}) is not corrected; {remedy}", word.text))
                    );
                }
                if !PASSED.contains(&code) && ![800, 950, 960, 970].contains(&code) {
                    return Err(self.fail(
                        word.from,
                        format!("{} is not known and could move an axis; remove it or move it into a program of its own", word.text),
                    ));
                }
                match code {
                    0 => self.motion = Some(false),
                    10 => self.motion = Some(true),
                    540..=590 if self.work.is_some_and(|w| w != code) => {
                        return Err(self.fail(
                            word.from,
                            "a second work offset; split the program, each with its --work-offset",
                        ));
                    }
                    540..=590 => self.work = Some(code),
                    _ => {}
                }
            }
            'M' | 'L' if word.letter == 'L' || (960..=999).contains(&code) => {
                return Err(self.fail(
                    word.from,
                    format!("{} (subprogram) is not corrected; write its blocks out", word.text),
                ));
            }
            'M' if code == 60 => self.change_tool(word)?,
            'T' => {
                self.next_tool = Some(word.value);
                if !self.by_m6 {
                    self.change_tool(word)?;
                }
            }
            // the number of the program
            'O' if !self.begun => {}
            'O' => {
                return Err(self.fail(
                    word.from,
                    "subprograms and flow control are not corrected; write the blocks out",
                ));
            }
            letter => {
                let is_axis = letter != 'S' && AxisName::from_letter(letter).is_some();
                if is_axis && self.axis(word).is_none() {
                    let axes: Vec<String> = self.axes.iter().map(ToString::to_string).collect();
                    return Err(self.fail(
                        word.from,
                        format!(
                            "axis {letter} is not in the chain of the model, which has {}",
                            axes.join(", ")
                        ),
                    ));
                }
            }
        }
        Ok(())
    }

    /// Takes in the tool named last, or refuses it: the lever of the angular errors is that of one tool.
    fn change_tool(&mut self, word: &Word<'_>) -> Result<(), ProgramError> {
        if self.tool.is_some_and(|tool| tool != self.next_tool) {
            return Err(self.fail(
                word.from,
                "a second tool; split the program, each with the model of its tool (tool-tip-mm)",
            ));
        }
        self.tool = Some(self.next_tool);
        Ok(())
    }

    /// A position in full.
    fn known(&self, position: &[Option<f64>; MAX_AXES], at: usize) -> Result<AxisArray, ProgramError> {
        let mut out = [0.0; MAX_AXES];
        for (k, name) in self.axes.iter().enumerate() {
            let spindle = self.request.model.axes().nth(k).is_some_and(|a| a.spindle);
            out[k] = match position[k] {
                Some(v) => v,
                None if spindle => 0.0,
                None => {
                    return Err(self.fail(
                        at,
                        format!("position of axis {name} is unknown here; program it before, or give --start {}=..", name.lower()),
                    ));
                }
            };
        }
        Ok(out)
    }

    /// Correction at a programmed position.
    fn at(&self, programmed: &AxisArray) -> At {
        self.at_after(programmed, self.travel)
    }

    /// The same after other directions of travel.
    fn at_after(&self, programmed: &AxisArray, travel: [Travel; MAX_AXES]) -> At {
        let mut pose = Pose::at(core::array::from_fn(|k| programmed[k] + self.request.work_offset[k]));
        pose.travel = travel;
        for (k, corrected) in self.request.corrected.iter().enumerate() {
            pose.fixed |= u16::from(!corrected) << k;
        }
        let (deviation, AxisCorrection { offset, .. }) = self.request.model.correct(&pose);
        let there = |pose: &Pose| self.request.model.nominal_tool(pose).tip;
        let moved = Pose { position: core::array::from_fn(|k| pose.position[k] + offset[k]), ..pose };
        let held = deviation.flags.out_of_range;
        At { held, offset, rest: deviation.position + there(&moved) - there(&pose) }
    }

    /// Into how many parts a feed block is divided.
    fn parts(
        &self,
        from: &[Option<f64>; MAX_AXES],
        to: &AxisArray,
        column: usize,
    ) -> Result<u32, ProgramError> {
        // the first move of a program comes from somewhere
        let Ok(from) = self.known(from, column) else { return Ok(1) };
        let between = |share: f64| core::array::from_fn(|k| from[k] + share * (to[k] - from[k]));
        let offset = |share: f64| self.at(&between(share)).offset;
        let mut parts = 1;
        loop {
            let n = f64::from(parts);
            let off_line = |part: u32| {
                let (low, high) = (f64::from(part) / n, f64::from(part + 1) / n);
                let (a, b) = (offset(low), offset(high));
                [0.25, 0.5, 0.75].into_iter().find_map(|s| {
                    let there = offset(low + s * (high - low));
                    self.is_bent(|k| there[k] - a[k] - s * (b[k] - a[k]))
                })
            };
            let Some(bent) = (0..parts).find_map(off_line) else { return Ok(parts) };
            parts *= 2;
            if parts > PARTS_MAX {
                let option = if self.is_rotary(bent) { "--tolerance-arcsec" } else { "--tolerance-um" };
                return Err(self.fail(
                    column,
                    format!("more than {PARTS_MAX} parts are needed to follow the correction of {}; enlarge {option}, or look for a step in the model", self.axes[bent]),
                ));
            }
        }
    }

    /// The first axis by which a correction is off by more than the tolerance.
    fn is_bent(&self, off: impl Fn(usize) -> f64) -> Option<usize> {
        let tolerance = |k: usize| self.request.tolerance[usize::from(self.is_rotary(k))];
        (0..self.axes.len()).find(|&k| off(k).abs() > tolerance(k))
    }

    /// Directions of travel of a move; an axis that stands keeps its last one.
    fn turn(&mut self, from: &AxisArray, to: &AxisArray) {
        for (k, travel) in self.travel.iter_mut().enumerate() {
            if to[k] != from[k] {
                *travel = if to[k] > from[k] { Travel::Forward } else { Travel::Reverse };
            }
        }
    }

    /// Writes a block in its parts, without its last line end.
    fn write(
        &mut self,
        (text, end): (&str, &str),
        moved: &[(usize, &Word<'_>)],
        from: &[Option<f64>; MAX_AXES],
        to: &AxisArray,
        parts: u32,
    ) -> Result<(), ProgramError> {
        let column = moved.last().map_or(0, |m| m.1.from);
        self.out.blocks += 1;
        for part in 1..=parts {
            let share = f64::from(part) / f64::from(parts);
            let place: AxisArray = core::array::from_fn(|k| match from[k] {
                Some(start) if part < parts => start + share * (to[k] - start),
                _ => to[k],
            });
            let at = self.at(&place);
            self.check(&place, &at, column)?;
            if part == parts {
                let beyond = |k: &usize| at.held >> k & 1 == 1;
                for k in (0..self.axes.len()).filter(beyond) {
                    self.out.held[k].get_or_insert((0, self.line)).0 += 1;
                }
            }
            let value = |k: usize| self.value(&place, &at, k);
            let mut block = String::new();
            if part == 1 {
                let mut end = 0;
                for (k, word) in moved {
                    block.push_str(&text[end..word.number]);
                    block.push_str(&value(*k));
                    end = word.to;
                    if word.from == column {
                        for k in (0..self.axes.len()).filter(|k| moved.iter().all(|m| m.0 != *k)) {
                            if self.request.corrected[k] {
                                let _ = write!(block, " {}{}", self.axes[k], value(k));
                            }
                        }
                    }
                }
                block.push_str(&text[end..]);
            } else {
                let _ = write!(block, "{}{}", line_end(end), self.all_axes(&place, &at, moved));
            }
            self.out.text.push_str(&block);
            self.out.blocks_out += 1;
        }
        Ok(())
    }

    /// Writes a block that stays where the one before ended, with the correction of the directions that come: its codes and its feed hold
    /// for both.
    fn write_reversal(
        &mut self,
        words: &[Word<'_>],
        moved: &[(usize, &Word<'_>)],
        place: &AxisArray,
        end: &str,
    ) -> Result<(), ProgramError> {
        let at = self.at(place);
        self.check(place, &at, words[0].from)?;
        let modal = words.iter().filter(|w| matches!(w.letter, 'G' | 'F')).map(|w| w.text);
        let all: Vec<&str> = modal.collect();
        let gap = if all.is_empty() { "" } else { " " };
        let axes = self.all_axes(place, &at, moved);
        let _ = write!(self.out.text, "{}{gap}{axes}{}", all.join(" "), line_end(end));
        self.out.blocks_out += 1;
        Ok(())
    }

    /// The corrected value of an axis, mm or deg.
    fn value(&self, place: &AxisArray, at: &At, k: usize) -> String {
        let v = place[k] + at.offset[k];
        if self.is_rotary(k) { format!("{:.7}", deg_from_rad(v)) } else { format!("{v:.6}") }
    }

    /// Words of all axes that are corrected or stand in a block.
    fn all_axes(&self, place: &AxisArray, at: &At, moved: &[(usize, &Word<'_>)]) -> String {
        let written = |k: &usize| self.request.corrected[*k] || moved.iter().any(|m| m.0 == *k);
        let word = |k: usize| format!("{}{}", self.axes[k], self.value(place, at, k));
        (0..self.axes.len()).filter(written).map(word).collect::<Vec<_>>().join(" ")
    }

    /// Refuses what an axis cannot do, and takes note of the largest figures.
    fn check(&mut self, place: &AxisArray, at: &At, column: usize) -> Result<(), ProgramError> {
        for (k, name) in self.axes.iter().enumerate() {
            let rotary = self.is_rotary(k);
            let shown = |v: f64| if rotary { (deg_from_rad(v), "deg") } else { (v, "mm") };
            let limit = self.request.limit[usize::from(rotary)];
            if at.offset[k].abs() > limit {
                let size = |v: f64| {
                    if rotary {
                        format!("{:.1} arcsec", arcsec_from_rad(v))
                    } else {
                        format!("{:.1} µm", um_from_mm(v))
                    }
                };
                let (value, unit) = shown(place[k]);
                let what = format!(
                    "correction of {name} at {value} {unit} is {}, limit {}; check the model, or raise --limit-um or --limit-arcsec",
                    size(at.offset[k]),
                    size(limit)
                );
                return Err(self.fail(column, what));
            }
            if let Some([low, high]) = self.request.model.travel(k) {
                let machine = place[k] + self.request.work_offset[k];
                for (value, with) in [(machine, ""), (machine + at.offset[k], " with its correction")] {
                    if !(low - 1e-9..=high + 1e-9).contains(&value) {
                        let ((v, unit), (l, _), (h, _)) = (shown(value), shown(low), shown(high));
                        let what = format!(
                            "axis {name} reaches {v:.6} {unit}{with}, travel {l} to {h} {unit}; move the program, or correct --work-offset"
                        );
                        return Err(self.fail(column, what));
                    }
                }
            }
        }
        for (largest, offset) in self.out.largest.iter_mut().zip(at.offset) {
            *largest = largest.max(offset.abs());
        }
        if at.rest.abs().max() > self.out.rest.max() {
            self.out.rest_line = self.line;
        }
        self.out.rest = self.out.rest.sup(&at.rest.abs());
        Ok(())
    }
}

/// The end of a line that comes before one with this end.
fn line_end(end: &str) -> &str {
    if end.is_empty() { "\n" } else { end }
}

#[cfg(test)]
mod tests;
