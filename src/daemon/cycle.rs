//! Cycling over a link that is up.
//!
//! **Latest wins.** Where several position frames have come together, only the newest goes through the engine and
//! is answered: a correction for an older one would be overwritten before it could act, and the steps of several
//! cycles would reach the machine as one. The engine sees the gap in the sequence and bounds the control time of
//! its step. Frames that show the machine not ready are never passed over. The others count as skipped and late. A
//! control in lock step has only one frame on the way and always gets its answer; one that keeps several on the
//! way takes an answer to `n` as the answer to everything up to `n`.
//!
//! **Late** is a cycle whose correction was handed to the kernel more than one control cycle after the sample
//! (see [`super::age`]), or a skipped one.

use std::io::{self, ErrorKind};
use std::sync::atomic::Ordering::Relaxed;
use std::time::Duration;

use super::age::AgeEstimator;
use super::channels::{CycleRecord, Progress, Report};
use super::clock::Clock;
use super::control::{Control, Stop};
use super::cycle_time::CycleTimeMonitor;
use super::link::{ControlLink, Received};
use super::link_end::LinkEnd;
use super::link_session::{LinkSession, Reaction};
use super::sensors::LiveEnd;
use volcomp_config::LinkConfig;
use volcomp_engine::State;
use volcomp_engine::fault::Code;
use volcomp_protocol::{CloseReason, ErrorCode, MachineState, Message, Position};
use volcomp_units::{MonoTime, NS_PER_S};

/// Longest wait for bytes: requests and the watchdog are looked after this often.
pub(super) const SLICE: Duration = Duration::from_millis(20);
/// Fullest buffers taken in before anything else gets its turn.
const READS_MAX: usize = 64;

/// What one reading of the socket has brought.
#[derive(Debug, Clone, Copy, Default)]
struct Batch {
    /// The newest position frame, not yet handled, and when its bytes were in hand.
    newest: Option<(Position, MonoTime)>,
    /// Older frames passed over.
    skipped: u64,
}

/// One link from up to down.
#[derive(Debug)]
pub(super) struct Cycle<'a> {
    pub(super) control: &'a mut Control,
    pub(super) session: &'a mut LinkSession,
    pub(super) clock: Clock,
    pub(super) limits: &'a LinkConfig,
    pub(super) ages: AgeEstimator,
    pub(super) cycle_time: CycleTimeMonitor,
    /// Position frames of this link.
    pub(super) cycles: u64,
}

impl Cycle<'_> {
    /// Cycles until the link ends.
    ///
    /// # Cycle   between the first frame and the return: no allocation, no lock, no log, no disk
    pub(super) fn run(&mut self, link: &mut dyn ControlLink) -> LinkEnd {
        // frames that came in one piece with the hello are already here
        let mut turn = self.frames(link, self.clock.now(), false);
        loop {
            match turn {
                Ok(None) => turn = self.turn(link),
                Ok(Some(end)) => return end,
                // a correction that waits would arrive late, and the cycle must not wait for it
                Err(e) if e.kind() == ErrorKind::WouldBlock => return LinkEnd::Congested,
                Err(e) => return LinkEnd::Io(e.kind()),
            }
        }
    }

    fn turn(&mut self, link: &mut dyn ControlLink) -> io::Result<Option<LinkEnd>> {
        self.control.channels.progress.beat();
        let now = self.clock.now();
        self.control.take_requests(now, Some(self.session));
        if let Some(end) = self.stopped(now) {
            return Ok(Some(end));
        }
        if let Some(end) = self.timers(now, link)? {
            return Ok(Some(end));
        }
        let wait = self.wait(now, link);
        match link.receive(wait)? {
            Received::Bytes { at, more, .. } => self.frames(link, at, more),
            Received::Nothing => Ok(None),
            Received::Closed => Ok(Some(LinkEnd::Closed)),
        }
    }

    /// Whether a stop has come to its end.
    fn stopped(&self, now: MonoTime) -> Option<LinkEnd> {
        let done = match self.control.stop {
            Stop::No => false,
            Stop::By(limit) => {
                self.session.engine().is_stopped() && !self.session.is_unanswered() || now >= limit
            }
            Stop::Now => true,
        };
        done.then(|| LinkEnd::Stopped { at_rest: self.session.is_at_rest() })
    }

    /// What is due because time has passed: the engine's deadline, the life sign, the end of patience.
    fn timers(&mut self, now: MonoTime, link: &mut dyn ControlLink) -> io::Result<Option<LinkEnd>> {
        if now.seconds_since(link.life_signs().received) >= self.limits.silence_s {
            return Ok(Some(LinkEnd::Silent { limit_s: self.limits.silence_s }));
        }
        if self.session.next_deadline().is_some_and(|due| now >= due) {
            let correction = self.session.deadline(now);
            self.control.report(self.session, correction.is_some());
            if let Some(correction) = correction {
                link.send(&Message::Correction(correction))?;
            }
            self.session.record();
        }
        link.show(self.session.engine().state())?;
        self.session.run_shadow_on_deadline(now);
        if now.seconds_since(link.life_signs().sent) >= self.limits.heartbeat_s {
            link.send_heartbeat()?;
        }
        Ok(None)
    }

    fn wait(&self, now: MonoTime, link: &mut dyn ControlLink) -> Duration {
        let heartbeat = link.life_signs().sent.plus_seconds(self.limits.heartbeat_s);
        let silence = link.life_signs().received.plus_seconds(self.limits.silence_s);
        let due = heartbeat.min(silence);
        let due = self.session.next_deadline().map_or(due, |deadline| due.min(deadline));
        let wait = u64::try_from(due.ns.saturating_sub(now.ns)).unwrap_or(0);
        Duration::from_nanos(wait).min(SLICE)
    }

    /// Takes in every frame that has arrived, then answers the newest position.
    fn frames(
        &mut self,
        link: &mut dyn ControlLink,
        mut at: MonoTime,
        mut more: bool,
    ) -> io::Result<Option<LinkEnd>> {
        let mut batch = Batch::default();
        // a peer that never stops sending must not keep timers and requests from their turn
        for reads in 0.. {
            loop {
                let skipped = link.skipped();
                let next = link.next_message();
                if link.skipped() != skipped {
                    // an optional frame that is not known is a life sign all the same
                    link.life_signs().received = at;
                }
                let message = match next {
                    Ok(Some(message)) => message,
                    Ok(None) => break,
                    Err(e) => return Ok(Some(LinkEnd::BadFrame(e))),
                };
                link.life_signs().received = at;
                if let Some(end) = self.message(link, at, &message, &mut batch)? {
                    return Ok(Some(end));
                }
            }
            // what is left stays in the socket until the next turn: a read now would find the buffer full
            if !more || reads == READS_MAX {
                break;
            }
            // the buffer was full: newer frames may be waiting, and they make these ones old
            match link.receive(Duration::ZERO)? {
                Received::Bytes { at: later, more: again, .. } => (at, more) = (later, again),
                Received::Nothing => break,
                Received::Closed => return Ok(Some(LinkEnd::Closed)),
            }
        }
        if let Some((frame, received)) = batch.newest {
            self.answer(link, frame, received, batch.skipped)?;
        }
        Ok(self.new_link())
    }

    /// Why the link must end so that the next one can start from what the control holds.
    fn new_link(&self) -> Option<LinkEnd> {
        let silenced = self.session.engine().state() == State::Faulted;
        self.session.engine().needs_new_link().then_some(if silenced {
            LinkEnd::Silenced
        } else {
            LinkEnd::OffsetMoved
        })
    }

    fn message(
        &mut self,
        link: &mut dyn ControlLink,
        at: MonoTime,
        message: &Message,
        batch: &mut Batch,
    ) -> io::Result<Option<LinkEnd>> {
        if let Message::Position(frame) = message {
            self.cycles += 1;
            match batch.newest.replace((*frame, at)) {
                // an answer that is computed is sent, or the next one would be two steps away from the last
                Some((older, received)) if !older.state.is_ready() => {
                    self.answer(link, older, received, 0)?;
                }
                Some(_) => batch.skipped += 1,
                None => {}
            }
            return Ok(None);
        }
        if let (Message::Tool(tool), Some(live)) = (message, &mut self.control.live) {
            live.tool(tool);
        }
        Ok(match self.session.handle(at, message) {
            Reaction::Answer(_) | Reaction::Nothing => None,
            Reaction::Closed(reason) => Some(LinkEnd::ClosedByControl(reason)),
            Reaction::Refused(report) => Some(LinkEnd::Refused(report)),
            Reaction::Unexpected(found) => Some(LinkEnd::Unexpected(found)),
            Reaction::Malformed(what) => Some(LinkEnd::Malformed(what)),
        })
    }

    fn answer(
        &mut self,
        link: &mut dyn ControlLink,
        frame: Position,
        received: MonoTime,
        skipped: u64,
    ) -> io::Result<()> {
        let message = Message::Position(frame);
        let lock_step = self.control.live.as_ref().is_some_and(LiveEnd::is_in_lock_step);
        if lock_step {
            self.live(received, &frame);
        }
        // a simulated control that waits for the estimator has no pace of its own
        if let Some(interval_ns) = self.cycle_time.look(received, &frame).filter(|_| !lock_step) {
            let progress = &self.control.channels.progress;
            progress.interval_ns.store(interval_ns, Relaxed);
            Progress::add(&progress.off_cycle, 1);
        }
        let unlisted = self.session.has_unlisted_offset(&frame.applied);
        Progress::add(&self.control.channels.progress.unlisted, u64::from(unlisted));
        let strays = self.session.strays();
        let reaction = self.session.handle(received, &message);
        let strays = self.session.strays().saturating_sub(strays);
        Progress::add(&self.control.channels.progress.out_of_order, strays);
        let Reaction::Answer(correction) = reaction else {
            self.session.record();
            if !lock_step {
                self.live(received, &frame);
            }
            self.control.report(self.session, false);
            self.control.channels.record(CycleRecord {
                state: self.session.engine().state(),
                machine_state: frame.state,
                position: frame.commanded,
                applied: frame.applied,
                ..CycleRecord::default()
            });
            return Ok(());
        };
        let computed = self.clock.now();
        link.send(&Message::Correction(correction))?;
        self.session.record();
        if !lock_step {
            self.live(received, &frame);
        }
        self.control.report(self.session, true);
        let turnaround_ns = link.life_signs().sent.ns - received.ns;
        let age_ns = self.ages.age_ns(received, frame.control_ns).saturating_add(turnaround_ns);
        let late = u64::from(age_ns as f64 > self.limits.cycle_s * NS_PER_S);
        let progress = &self.control.channels.progress;
        Progress::add(&progress.cycles, 1 + skipped);
        Progress::add(&progress.late, late + skipped);
        Progress::add(&progress.skipped, skipped);
        if let Some(times) = link.call_times() {
            progress.read_ns.store(times.read_ns, Relaxed);
            progress.write_ns.store(times.write_ns, Relaxed);
        }
        let Some(output) = self.session.output() else { return Ok(()) };
        Progress::add(&progress.limited, u64::from(output.limited & !output.at_soft_limit != 0));
        Progress::add(&progress.at_soft_limit, u64::from(output.at_soft_limit != 0));
        Progress::add(&progress.out_of_travel, u64::from(output.out_of_travel != 0));
        Progress::add(&progress.lagging, u64::from(output.lagging != 0));
        let control_limited = frame.state.has(MachineState::OFFSET_LIMITED);
        Progress::add(&progress.control_limited, u64::from(control_limited));
        self.control.channels.record(CycleRecord {
            answered: true,
            state: output.state,
            machine_state: frame.state,
            limited: output.limited,
            warning: output.warning,
            out_of_range: output.out_of_range,
            lagging: output.lagging,
            lag_cycles: output.lag_cycles,
            offset: output.offset,
            wanted: output.wanted,
            position: frame.commanded,
            applied: frame.applied,
            age_ns,
            turnaround_ns,
            compute_ns: computed.ns - received.ns,
        });
        self.run_shadow(received, &frame);
        Ok(())
    }

    /// Live values for the next frame, and this one for the estimator.
    fn live(&mut self, received: MonoTime, frame: &Position) {
        if let Some(live) = &mut self.control.live {
            live.after(received, frame, self.session);
        }
    }

    /// The shadow engine, when all else is done; its score goes out once a second.
    fn run_shadow(&mut self, now: MonoTime, frame: &Position) {
        self.session.run_shadow(now, frame);
        let Some((state, score)) = self.session.shadow() else { return };
        if score.cycles.is_multiple_of((1.0 / self.limits.cycle_s) as u64) {
            self.control.channels.report(Report::Shadow(Some((state, *score))));
        }
    }
}

impl LinkEnd {
    /// Its number.
    pub(super) const fn fault(&self) -> Code {
        match self {
            Self::BadFrame(_) | Self::Unexpected(_) | Self::Malformed(_) => Code::BAD_FRAME,
            Self::OffsetMoved => Code::CONTROL_TOOK_OVER,
            _ => Code::LINK_LOST,
        }
    }

    /// How to close the link: an error to name, and the reason; `None` where the other side is gone.
    pub(super) const fn close_frame(&self) -> Option<(Option<(ErrorCode, &'static str)>, CloseReason)> {
        match self {
            Self::BadFrame(error) => Some((Some((ErrorCode::BadFrame, error.word())), CloseReason::Error)),
            Self::Unexpected(found) => Some((Some((ErrorCode::Unexpected, found)), CloseReason::Error)),
            Self::Malformed(what) => Some((Some((ErrorCode::BadFrame, what)), CloseReason::Error)),
            // after `Error` the control takes its offset out
            Self::OffsetMoved | Self::Silenced => Some((None, CloseReason::Error)),
            // after `Shutdown` the control keeps the offset, after `Error` it takes it out
            Self::Stopped { at_rest: true } => Some((None, CloseReason::Shutdown)),
            Self::Stopped { at_rest: false } => Some((None, CloseReason::Error)),
            Self::Silent { .. } | Self::ClosedByControl(_) => None,
            Self::Closed | Self::Congested | Self::Refused(_) | Self::Io(_) => None,
        }
    }
}
