//! Invariant monitor at the socket: checks every correction against the promises of `docs/explanation/safety.md`.
//!
//! The monitor sees frames only: every Position that the control sent and every Correction that the daemon sent. It shares
//! no code with the engine; limits and permitted changes of state are restated here. It holds no clock and does no I/O:
//! time is the control time of the positions. A missing answer is always permitted and is counted.
//!
//! Reading order: [`Settings`] (limits), [`Invariant`] and [`Report`] (what is checked and found), [`Monitor`] (from frames to violations),
//! `rules` (braking distance, permitted changes of state), [`settings`] (limits from a machine file), [`tap`] (bytes of a
//! connection to frames).

mod report;
mod rules;
pub mod settings;
pub mod tap;

use std::collections::VecDeque;

use volcomp_protocol::{Correction, CorrectionState, MachineState, Position};
use volcomp_units::NS_PER_S;
use volcomp_units::axes::{AxisArray, AxisKind, MAX_AXES};

pub use report::{Figures, Invariant, Report, Violation};
use rules::{AxisTrack, may_be_first, may_follow, never_grows};
pub use settings::{AxisLimits, Settings, SettingsError};
pub use tap::{DirectionTap, SharedMonitor};

/// Rounding: share of a value, and mm or deg.
const RELATIVE: f64 = 1e-9;
const ABSOLUTE: f64 = 1e-9;
/// The most control time that one answer may use, cycles.
const STEP_CYCLES_MAX: f64 = 2.0;
/// Positions out of order that follow one another and then are the valid count.
const NEW_COUNT: u32 = 5;
/// Bounds of an axis without limits: mm, deg.
const UNLISTED_MAX_MM: f64 = 1.0;
const UNLISTED_MAX_DEG: f64 = 0.1;
/// Answers that may start from the read-back without an own way of the control; one more for every so many answers.
const FOLLOWS_MAX: u32 = 10;
const FOLLOW_EVERY: u64 = 10;
/// Positions kept for answers to come.
const SENT_MAX: usize = 8192;

/// A position that was sent to the daemon.
#[derive(Debug, Clone, Copy)]
struct Sent {
    index: u64,
    sequence: u32,
    control_ns: i64,
    /// Positions that followed each other, since the count last went back.
    run: u32,
    /// It belongs to a count that is proven.
    proven: bool,
    state: MachineState,
    /// The read-back in it, where it is finite in every used axis.
    applied: Option<AxisArray>,
    /// The newest finite read-back of the link up to this one.
    held: Option<AxisArray>,
}

/// The answer before.
#[derive(Debug, Clone, Copy)]
struct Answer {
    index: u64,
    sequence: u32,
    control_ns: i64,
    state: CorrectionState,
    offset: AxisArray,
    /// Range of the offsets in all answers to this position, where there were several: with no new position, none of
    /// them is known to have taken effect.
    unconfirmed: Option<[AxisArray; 2]>,
}

/// How an answer follows on the one before.
#[derive(Debug, Clone, Copy)]
struct Transition {
    /// Control time that the answer may use, s.
    dt: f64,
    /// The offset that the control reports, where it may have moved it by itself since the answer before.
    moved_to: Option<AxisArray>,
    /// Drives off or emergency stop in the answered position.
    immobile: bool,
    /// The answer is to a newer position, or to none since the answer before.
    makes_time: bool,
}

/// Checks corrections against the invariants.
#[derive(Debug, Clone)]
pub struct Monitor {
    settings: Settings,
    link: Option<u64>,
    sent: VecDeque<Sent>,
    /// The newest number of a count that at least [`NEW_COUNT`] positions have proven.
    count: Option<u32>,
    last: Option<Answer>,
    axes: [AxisTrack; MAX_AXES],
    /// Control time since ramping out or a fault began, s; `None` in other states.
    to_zero_s: Option<f64>,
    report: Report,
}

impl Monitor {
    /// A monitor with the limits that the daemon is configured with.
    #[must_use]
    pub fn new(settings: Settings) -> Self {
        Self {
            settings,
            link: None,
            sent: VecDeque::with_capacity(SENT_MAX),
            count: None,
            last: None,
            axes: [AxisTrack::default(); MAX_AXES],
            to_zero_s: None,
            report: Report::default(),
        }
    }

    /// The daemon has other limits from the next link on.
    pub fn set_settings(&mut self, settings: Settings) {
        self.settings = settings;
    }

    /// A new link, after the hellos. Frames of any other link are ignored from now on.
    pub fn link_opened(&mut self, link: u64) {
        self.link = Some(link);
        self.sent.clear();
        self.count = None;
        self.last = None;
        self.axes = [AxisTrack::default(); MAX_AXES];
        self.to_zero_s = None;
        self.report.figures.links += 1;
    }

    /// What has been found so far.
    #[must_use]
    pub const fn report(&self) -> &Report {
        &self.report
    }

    /// The control has sent a position.
    pub fn position(&mut self, link: u64, frame: &Position) {
        if self.link != Some(link) {
            return;
        }
        let before = self.sent.back();
        let step = before.map_or(-1, |b| frame.sequence.wrapping_sub(b.sequence).cast_signed());
        if step == 0 && self.last.is_some_and(|last| last.sequence == frame.sequence) {
            // a number that was answered says nothing new when it is repeated, whatever else the frame carries
            self.report.figures.positions += 1;
            return;
        }
        let used = &frame.applied[..self.settings.axes.len()];
        let applied = used.iter().all(|v| v.is_finite()).then_some(frame.applied);
        let sent = Sent {
            index: before.map_or(0, |b| b.index + 1),
            sequence: frame.sequence,
            control_ns: frame.control_ns,
            run: match step {
                1 => before.map_or(1, |b| b.run.saturating_add(1)),
                // a repeated frame or a gap proves nothing and disproves nothing
                0.. => before.map_or(1, |b| b.run),
                _ => 1,
            },
            proven: false,
            state: frame.state,
            applied,
            held: applied.or(before.and_then(|b| b.held)),
        };
        let sent = Sent {
            proven: sent.run >= NEW_COUNT
                || self.count.is_some_and(|c| frame.sequence.wrapping_sub(c).cast_signed() > 0),
            ..sent
        };
        if step == 1 && sent.run >= NEW_COUNT {
            self.count = Some(frame.sequence);
        }
        if self.sent.len() == SENT_MAX {
            self.sent.pop_front();
        }
        self.sent.push_back(sent);
        self.report.figures.positions += 1;
        self.report.figures.unanswered += 1;
    }

    /// The daemon has sent a correction.
    pub fn correction(&mut self, link: u64, correction: &Correction) {
        if self.link != Some(link) {
            return;
        }
        self.report.figures.answers += 1;
        let Some(sent) = self.sent.iter().rev().find(|s| s.sequence == correction.sequence).copied() else {
            let newest = self.sent.back().map_or(f64::NAN, |s| f64::from(s.sequence));
            let what = "answers a position that was not sent on this link";
            self.violation(
                Invariant::Sequence,
                correction,
                None,
                [f64::from(correction.sequence), newest],
                what,
            );
            self.check_finite(correction);
            for k in 0..self.settings.axes.len() {
                let limit = self.settings.limits[k].size.max(self.axes[k].ceiling);
                if correction.offset[k].abs() > limit * (1.0 + RELATIVE) + ABSOLUTE {
                    let values = [correction.offset[k], limit];
                    self.violation(Invariant::Size, correction, Some(k), values, "offset beyond the limit");
                }
            }
            return;
        };
        self.check_sequence(correction, &sent);
        if sent.held.is_none() {
            let what = "answer before the first finite read-back of the link";
            self.violation(Invariant::ReadBack, correction, None, [f64::NAN; 2], what);
        }
        let finite = self.check_finite(correction);
        self.check_transition(correction, &sent);
        if finite {
            let transition = self.transition(&sent);
            let mut anew = transition.moved_to.is_some();
            for k in 0..self.settings.axes.len() {
                anew |= self.check_axis(k, correction, &sent, &transition);
            }
            self.check_time_to_zero(correction, &transition, anew);
        }
        if self.last.is_none_or(|last| last.index != sent.index) {
            self.report.figures.unanswered = self.report.figures.unanswered.saturating_sub(1);
        }
        // an offset that is not finite is none to go on from
        let offset = if finite { correction.offset } else { self.last.map_or([0.0; MAX_AXES], |l| l.offset) };
        let repeated = self.last.filter(|last| last.index == sent.index);
        let unconfirmed = repeated.map(|last| {
            let [low, high] = last.unconfirmed.unwrap_or([last.offset; 2]);
            core::array::from_fn(|end| {
                core::array::from_fn(
                    |k| if end == 0 { low[k].min(offset[k]) } else { high[k].max(offset[k]) },
                )
            })
        });
        self.last = Some(Answer {
            index: sent.index,
            sequence: sent.sequence,
            // a repeated number has not used the time of its frame
            control_ns: match self.last {
                Some(last) if last.sequence == sent.sequence => last.control_ns,
                _ => sent.control_ns,
            },
            state: correction.state,
            offset,
            unconfirmed,
        });
    }

    /// Never older than the answer before, unless five positions in unbroken order have set a new count.
    fn check_sequence(&mut self, correction: &Correction, sent: &Sent) {
        let Some(last) = self.last else { return };
        let older = sent.sequence.wrapping_sub(last.sequence).cast_signed() < 0;
        if older && (!sent.proven || sent.index < last.index) {
            let values = [sent.sequence, last.sequence].map(f64::from);
            let what = "answers an older position than the answer before";
            self.violation(Invariant::Sequence, correction, None, values, what);
        }
    }

    /// True where every entry is what it must be.
    fn check_finite(&mut self, correction: &Correction) -> bool {
        let axes = self.settings.axes.len();
        let mut all = true;
        for (k, value) in correction.offset.into_iter().enumerate() {
            if k < axes && !value.is_finite() {
                self.violation(Invariant::Finite, correction, Some(k), [value, f64::NAN], "not finite");
                all = false;
            } else if k >= axes && value != 0.0 {
                self.violation(Invariant::Finite, correction, None, [value, 0.0], "unused entry is not zero");
            }
        }
        all
    }

    fn check_transition(&mut self, correction: &Correction, sent: &Sent) {
        let to = correction.state;
        let permitted = match self.last {
            None => may_be_first(to),
            Some(last) => may_follow(last.state, to) || (self.is_resumed(&last, sent) && may_be_first(to)),
        };
        let code = |state: CorrectionState| f64::from(state.code());
        if !permitted {
            let from = self.last.map_or(f64::NAN, |l| code(l.state));
            let what = "change of state that is not permitted (codes: found, state before)";
            self.violation(Invariant::State, correction, None, [code(to), from], what);
        }
        let cleared = self.last.filter(|l| l.state == CorrectionState::Faulted && to != l.state);
        if let Some(last) = cleared
            && let Some(k) = (0..self.settings.axes.len())
                .find(|k| self.settings.limits[*k].size > 0.0 && last.offset[*k].abs() > ABSOLUTE)
        {
            let what = "a fault is left before the offset is at zero";
            self.violation(Invariant::State, correction, Some(k), [last.offset[k], 0.0], what);
        }
    }

    /// Control time from the answer before to this position, s: by count and by clock.
    fn elapsed(&self, last: &Answer, sent: &Sent) -> [f64; 2] {
        let cycles = f64::from(sent.sequence.wrapping_sub(last.sequence).cast_signed());
        [cycles * self.settings.cycle_s, sent.control_ns.saturating_sub(last.control_ns) as f64 / NS_PER_S]
    }

    /// True where the control has had no answer for longer than its hold time, by its clock and by its count, and may
    /// have taken the offset back.
    fn is_resumed(&self, last: &Answer, sent: &Sent) -> bool {
        let [cycles_s, clock_s] = self.elapsed(last, sent);
        sent.index != last.index && cycles_s.min(clock_s) > self.settings.hold_s
    }

    /// True where answers without a new position came before, and the control holds one of them: the way starts there.
    fn is_unconfirmed(&self, last: &Answer, sent: &Sent) -> bool {
        let (Some([low, high]), Some(applied)) = (last.unconfirmed, sent.applied) else { return false };
        let within = |(k, l): (usize, &AxisLimits)| {
            applied[k] >= low[k] - l.step - ABSOLUTE && applied[k] <= high[k] + l.step + ABSOLUTE
        };
        sent.index != last.index && self.settings.limits.iter().enumerate().all(within)
    }

    fn transition(&self, sent: &Sent) -> Transition {
        let immobile = is_immobile(sent.state);
        let Some(last) = self.last else {
            return Transition { dt: 0.0, moved_to: sent.held, immobile, makes_time: false };
        };
        let cycle = self.settings.cycle_s;
        // an answer without a new position holds or ramps out by one cycle at a time
        let [cycles_s, clock_s] = self.elapsed(&last, sent);
        let dt = cycles_s.max(clock_s).clamp(cycle, STEP_CYCLES_MAX * cycle);
        let own_way = |s: &Sent| !s.state.is_ready() || s.state.has(MachineState::OFFSET_RAMPING_OUT);
        let newer = self.sent.iter().rev().skip_while(|s| s.index > sent.index);
        let moved = self.is_resumed(&last, sent)
            || self.is_unconfirmed(&last, sent)
            || newer.take_while(|s| s.index >= last.index).any(own_way);
        let newer = sent.sequence.wrapping_sub(last.sequence).cast_signed() > 0;
        let makes_time = newer || self.sent.back().is_some_and(|newest| newest.index == last.index);
        Transition { dt, moved_to: sent.applied.filter(|_| moved), immobile, makes_time }
    }

    /// True where the way to zero starts anew: the answer has gone further out, to what the control reports.
    fn check_axis(
        &mut self,
        k: usize,
        correction: &Correction,
        sent: &Sent,
        transition: &Transition,
    ) -> bool {
        let limits = self.settings.limits[k];
        let offset = correction.offset[k];
        let before = self.last.map(|l| (l.offset[k], l.state));
        let moved_to = transition.moved_to.map(|applied| applied[k]);
        if limits.size <= 0.0 {
            // never touched: what the control reports there goes back to it, within what it can have been sent
            let reported = self.sent.iter().rev().any(|s| s.applied.is_some_and(|a| near(a[k], offset)));
            let kept = before.is_some_and(|(o, _)| near(o, offset));
            let bound = match self.settings.axes[k].kind() {
                AxisKind::Linear => UNLISTED_MAX_MM,
                AxisKind::Rotary => UNLISTED_MAX_DEG,
            };
            if sent.held.is_some() && !(kept || reported) || offset.abs() > bound {
                let what = "an axis without limits is moved";
                self.violation(Invariant::Size, correction, Some(k), [offset, bound], what);
            }
            return false;
        }
        self.check_size(k, correction, moved_to, transition.dt);
        // the way from the offset before, or from where the control has moved it, or from between them
        let ends = [before.map(|(o, _)| o), moved_to];
        let low = ends.iter().flatten().copied().fold(f64::INFINITY, f64::min);
        let high = ends.iter().flatten().copied().fold(f64::NEG_INFINITY, f64::max);
        if low > high {
            return false;
        }
        let change = (low - offset).max(offset - high).max(0.0);
        let slack = ABSOLUTE + RELATIVE * low.abs().max(high.abs());
        // whatever the control reports: only the first answer of a link starts at its offset
        let whole = before.map_or(change, |(o, _)| (offset - o).abs());
        let first = before.is_none();
        let step = if first { 0.0 } else { limits.step };
        let figures = &mut self.report.figures;
        figures.step = figures.step.max(whole);
        if whole > step * (1.0 + RELATIVE) + slack {
            let what = if first { "first answer is not the read-back" } else { "step between answers" };
            self.violation(Invariant::Step, correction, Some(k), [whole, step], what);
        }
        if !first {
            let rate = whole / transition.dt;
            let figures = &mut self.report.figures;
            figures.rate = figures.rate.max(rate);
            if whole > limits.rate * transition.dt * (1.0 + RELATIVE) + slack {
                self.violation(Invariant::Rate, correction, Some(k), [rate, limits.rate], "rate of change");
            }
        }
        if transition.immobile && change > slack {
            let what = "moved with drives off or emergency stop";
            self.violation(Invariant::ReadBack, correction, Some(k), [change, 0.0], what);
        }
        let followed = moved_to.or_else(|| self.follows(k, offset, sent));
        let repeated = self.last.is_some_and(|l| l.sequence == sent.sequence);
        self.check_rest(k, correction, before, (followed, repeated));
        followed.is_some() && before.is_some_and(|(o, _)| offset.abs() > o.abs() + ABSOLUTE)
    }

    fn check_size(&mut self, k: usize, correction: &Correction, moved_to: Option<f64>, dt: f64) {
        let Settings { found_factor, ramp_s, margin_s, .. } = self.settings;
        let limits = self.settings.limits[k];
        let size = correction.offset[k].abs();
        self.report.figures.size = self.report.figures.size.max(size);
        let track = &mut self.axes[k];
        if self.last.is_none() {
            let found = moved_to.map_or(0.0, f64::abs);
            let led_back = found > limits.size && found <= found_factor * limits.size;
            track.ceiling = if led_back { found } else { limits.size };
            track.beyond_s = 0.0;
        }
        let ceiling = track.ceiling;
        track.ceiling = limits.size.max(ceiling.min(size));
        let rate = limits.rate.min(limits.step / self.settings.cycle_s);
        let allowed = ramp_s + ceiling / rate + 2.0 * limits.rate / limits.acceleration + margin_s;
        use CorrectionState::{Armed, Holding, Off};
        let moves = !matches!(correction.state, Off | Armed | Holding);
        track.beyond_s =
            if size <= limits.size { 0.0 } else { track.beyond_s + if moves { dt } else { 0.0 } };
        let late = track.beyond_s > allowed;
        if size > ceiling * (1.0 + RELATIVE) + ABSOLUTE {
            let what = "offset beyond the limit";
            self.violation(Invariant::Size, correction, Some(k), [correction.offset[k], ceiling], what);
        } else if late {
            let what = "an offset found beyond the limit is not led back in time";
            self.violation(Invariant::Size, correction, Some(k), [size, limits.size], what);
            self.axes[k].beyond_s = 0.0;
        }
    }

    /// Frames that could not be used leave a gap of their own: answers after it may start from the read-back, a few times.
    fn follows(&mut self, k: usize, offset: f64, sent: &Sent) -> Option<f64> {
        let applied = sent.applied.map(|a| a[k]).filter(|a| near(*a, offset))?;
        let answers = self.report.figures.answers;
        let moves = self.last.is_some_and(|l| !near(l.offset[k], offset));
        let track = &mut self.axes[k];
        if answers >= track.followed + FOLLOW_EVERY {
            (track.follows, track.followed) = (track.follows.saturating_sub(1), answers);
        }
        if moves {
            track.follows += 1;
        }
        (track.follows <= FOLLOWS_MAX).then_some(applied)
    }

    /// No growth while off, armed or faulted, and rest while holding: but for the distance that braking takes.
    fn check_rest(
        &mut self,
        k: usize,
        correction: &Correction,
        before: Option<(f64, CorrectionState)>,
        (moved_to, repeated): (Option<f64>, bool),
    ) {
        let limits = self.settings.limits[k];
        let cycle_s = self.settings.cycle_s;
        let (offset, state) = (correction.offset[k], correction.state);
        let track = &mut self.axes[k];
        let from = before.map_or(offset, |(o, _)| o);
        let entered = before.is_none_or(|(_, s)| s != state);
        if entered {
            let braking = track.braking_distance(&limits, cycle_s);
            track.rest = rules::Rest::at(from, braking);
        }
        if let Some(moved_to) = moved_to {
            track.rest.move_to(offset, moved_to);
        }
        let rest = track.rest;
        if !(repeated && near(offset, from)) {
            track.note_change(offset - from, &limits, cycle_s);
        }
        let braking = track.braking_distance(&limits, cycle_s);
        track.rest.follow(offset, from, braking);
        let slack = ABSOLUTE + RELATIVE * offset.abs();
        let away = (offset - rest.from).abs();
        let grows = never_grows(state) && offset.abs() > rest.ceiling + slack;
        let moves_on = state == CorrectionState::Holding && away > rest.braking + slack;
        if grows || moves_on {
            // one violation for one movement
            track.rest = rules::Rest::at(offset, 0.0);
        }
        if grows {
            let what = "offset grows while off, armed or faulted";
            self.violation(Invariant::State, correction, Some(k), [offset, rest.ceiling], what);
        }
        if moves_on {
            let what = "offset moves on while holding";
            self.violation(Invariant::State, correction, Some(k), [away, rest.braking], what);
        }
    }

    fn check_time_to_zero(&mut self, correction: &Correction, transition: &Transition, anew: bool) {
        let leaves = matches!(correction.state, CorrectionState::RampingOut | CorrectionState::Faulted);
        let same = self.last.is_some_and(|l| l.state == correction.state);
        if !leaves || !same || transition.immobile || anew {
            self.to_zero_s = leaves.then_some(0.0);
            return;
        }
        // after a violation: not again until the next change of state
        let Some(time_s) = &mut self.to_zero_s else { return };
        // frames that are not used make no time
        *time_s += if transition.makes_time { transition.dt } else { 0.0 };
        let time_s = *time_s;
        let moved = self.settings.limits.iter().enumerate().filter(|(_, l)| l.size > 0.0);
        let cycle_s = self.settings.cycle_s;
        let rate = |l: &AxisLimits| l.rate.min(l.step / cycle_s);
        let way_s = |size: f64, l: &AxisLimits| size.max(l.size) / rate(l) + 2.0 * l.rate / l.acceleration;
        let slowest = moved.clone().map(|(k, l)| way_s(self.axes[k].ceiling, l)).fold(0.0, f64::max);
        let allowed_s = self.settings.ramp_s + slowest + self.settings.margin_s;
        let open = moved.map(|(k, _)| k).find(|k| correction.offset[*k].abs() > ABSOLUTE);
        if let Some(k) = open.filter(|_| time_s > allowed_s) {
            self.to_zero_s = None;
            let what = "not at zero in time (s of control time)";
            self.violation(Invariant::TimeToZero, correction, Some(k), [time_s, allowed_s], what);
        }
    }

    fn violation(
        &mut self,
        invariant: Invariant,
        correction: &Correction,
        axis: Option<usize>,
        [value, limit]: [f64; 2],
        what: &'static str,
    ) {
        let axis = axis.and_then(|k| self.settings.axes.get(k)).map(|a| a.letter());
        let Correction { sequence, state, .. } = *correction;
        self.report.add(Violation { invariant, sequence, state, axis, value, limit, what });
    }
}

/// Drives off or emergency stop: the control cannot move any offset.
const fn is_immobile(state: MachineState) -> bool {
    state.has(MachineState::ESTOP) || !state.has(MachineState::ENABLED)
}

fn near(a: f64, b: f64) -> bool {
    (a - b).abs() <= ABSOLUTE + RELATIVE * a.abs().max(b.abs())
}

#[cfg(test)]
mod tests;
