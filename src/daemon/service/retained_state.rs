//! The operator's last commands and the latched fault: state that a restart must not undo, and its copy on the disk.
//!
//! An order that switches off is written down when it is given, one that switches on when the engine has taken it. Orders
//! count by the number of their request, so that one that was overtaken changes nothing.

use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use tracing::{error, info, warn};
use volcomp_state::counters::{Recalled, RetainedState};

use super::Service;
use crate::channels::{Request, Ticket};
use crate::counters::unknown;
use crate::sensors::Sensors;
use crate::sync;
use crate::write_queue::Saved;
use volcomp_config::StartMode;
use volcomp_engine::fault::{self, Code};
use volcomp_engine::{Command, Event, State};

/// Time after which a request that does not switch off is not carried out any more, s; shorter than its client waits.
const REQUEST_LIFE_S: f64 = 1.5;
/// Polls of [`FIRST_POLL`] until the first counters are durable.
const FIRST_POLLS: u32 = 1000;
const FIRST_POLL: core::time::Duration = core::time::Duration::from_millis(2);

/// What is known about the word.
#[derive(Debug)]
pub(super) struct RetentionState {
    /// Why compensation does not begin by itself.
    objection: Option<String>,
    /// Number of the newest request that switches off or on.
    switched: u64,
    /// Number by which the state writer knows the newest change.
    saved: AtomicU64,
}

impl RetentionState {
    pub(super) fn new(retained: &RetainedState) -> Self {
        Self { objection: retained.objection(), switched: 0, saved: AtomicU64::new(0) }
    }
}

impl Service {
    /// Takes up what the run before has left.
    pub(super) fn recall(&mut self) {
        let RetainedState { fault, fault_numbers, gain, .. } = self.tally.retained().clone();
        if let Some(code) = fault {
            self.status_collector.latched_before(&code, fault_numbers);
            // known before the cycle thread runs
            self.channels.progress.set_state(State::Faulted);
        }
        let file = self.gain;
        if let Some(gain) = gain.filter(|gain| *gain > file) {
            // the machine file may have been changed since: nothing applies a larger share than it says
            info!(gain, file, "the gain ordered before the restart is above [engine] gain, which counts");
        }
        if let Some(gain) = gain.filter(|gain| *gain < file) {
            info!(gain, "the gain ordered before the restart");
            self.gain = gain;
            self.request(Request::Engine(Command::SetGain(gain)));
        }
    }

    /// What a restart must not undo.
    #[cfg(test)]
    pub(crate) fn retained(&self) -> RetainedState {
        self.tally.retained().clone()
    }

    /// Whether a fault of the run before is latched.
    pub(crate) fn has_kept_fault(&self) -> bool {
        self.tally.retained().fault.is_some()
    }

    /// Why compensation does not begin by itself, where it should.
    pub(super) fn start_inhibit(&self) -> Option<String> {
        self.retained.objection.clone().filter(|_| self.config.start == StartMode::OnConnect)
    }

    /// Whether compensation begins by itself; `permitted` where the model allows it.
    pub(crate) fn begins(&mut self, permitted: bool) -> bool {
        if self.config.start != StartMode::OnConnect || !permitted {
            return false;
        }
        if self.retained.objection.is_none() && self.state_writer.recalled() == Some(&Recalled::First) {
            self.retained.objection = self.first_not_kept();
        }
        let begins = self.retained.objection.is_none();
        match &self.retained.objection {
            Some(why) => warn!("compensation stays off until an operator enables it: {why}"),
            None => self.tally.enabled(),
        }
        let why = self.retained.objection.clone().unwrap_or_else(|| "start = \"on-connect\"".to_owned());
        self.audit_own("enable", why, if begins { "ordered" } else { "not done" }, None);
        begins
    }

    /// Why the first counters of all are not durable: a later start would look like the first one.
    fn first_not_kept(&mut self) -> Option<String> {
        let number = self.save();
        for _ in 0..FIRST_POLLS {
            match self.state_writer.saved(number) {
                Saved::Yes | Saved::Nowhere => return None,
                Saved::No(why) => return Some(unknown(&why)),
                Saved::Waiting => sync::pause(FIRST_POLL),
            }
        }
        Some(unknown("the state directory takes nothing"))
    }

    /// Passes a request to the cycle thread; gives its number, `None` where the queue is full.
    pub(crate) fn request(&mut self, request: Request) -> Option<u64> {
        // what has happened before this request must not count as having happened after it
        self.settle_all();
        let number = self.ticket + 1;
        let expires = self.clock.now().plus_seconds(REQUEST_LIFE_S);
        self.channels.requests.try_send(Ticket { number, request: request.clone(), expires }).ok()?;
        self.ticket = number;
        if matches!(request, Request::Engine(Command::Disable)) {
            self.retained.switched = number;
            self.retained.objection = None;
            self.change(|retained| retained.off = true);
        }
        self.waiting.push_back((number, request));
        Some(number)
    }

    /// Takes over what has become of every request that was looked at, in their order.
    pub(super) fn settle_all(&mut self) {
        // the number first: what was reported before is then in the queue of the reports
        let done = self.waiting.iter().take_while(|(number, _)| self.is_done(*number)).count();
        self.drain_reports();
        for (number, request) in self.waiting.drain(..done).collect::<Vec<_>>() {
            if !self.channels.progress.is_refused(number) {
                self.settle(number, &request);
            }
        }
    }

    /// Whether a request that was looked at was carried out.
    pub(crate) fn is_carried_out(&mut self, number: u64) -> bool {
        self.settle_all();
        !self.channels.progress.is_refused(number)
    }

    /// Takes over that a request was carried out.
    fn settle(&mut self, number: u64, request: &Request) {
        match request {
            Request::Engine(Command::Enable) if number > self.retained.switched => {
                self.retained.switched = number;
                self.retained.objection = None;
                self.tally.enabled();
                self.change(|retained| (retained.off, retained.hold) = (false, None));
            }
            // where no fault was latched the engine goes on as it is; another one may have been latched since
            Request::Engine(Command::ClearFault)
                if self.tally.retained().fault.is_some() && !self.channels.progress.is_faulted() =>
            {
                self.retained.objection = None;
                let newest = number > self.retained.switched;
                self.retained.switched = self.retained.switched.max(number);
                self.change(|retained| {
                    retained.off |= newest;
                    (retained.fault, retained.fault_numbers) = (None, None);
                });
            }
            Request::Engine(Command::SetGain(gain)) => {
                self.gain = *gain;
                let gain = Some(*gain);
                self.change(|retained| retained.gain = gain);
            }
            Request::Shadow(on) => self.shadowing = *on,
            _ => {}
        }
    }

    /// Changes the word and has it written.
    fn change(&mut self, change: impl FnOnce(&mut RetainedState)) {
        change(self.tally.retained_mut());
        let number = self.save();
        self.retained.saved.store(number, Relaxed);
    }

    /// Whether the newest change of the word is durable.
    pub(crate) fn retained_state_saved(&self) -> Saved {
        self.state_writer.saved(self.retained.saved.load(Relaxed))
    }

    /// Whether that a map was forgotten is durable; `number` is that of the state of the maps.
    pub(crate) fn forgotten_saved(&self, number: u64) -> Saved {
        match self.sensors.as_ref().and_then(Sensors::saving) {
            Some(saving) => saving.saved(number),
            // no state directory, or one that cannot be used: a later start may find what an earlier one has kept there
            None => self.state_writer.saved(0),
        }
    }

    /// Whether a restart of a daemon without a state directory would undo a request to the worse.
    pub(crate) fn is_undone(&self, request: &Request) -> bool {
        match request {
            Request::Engine(Command::Disable | Command::ClearFault) => {
                self.config.start == StartMode::OnConnect
            }
            Request::Engine(Command::SetGain(_)) => true,
            _ => false,
        }
    }

    /// Whether the cycle thread has looked at a request.
    pub(crate) fn is_done(&self, number: u64) -> bool {
        self.channels.progress.is_done(number)
    }

    /// The cycle thread has switched compensation off because this service gave no sign of life.
    pub(super) fn was_silent(&mut self) {
        let code = Code::SERVICE_SILENT;
        let text = code.entry().map_or("", |entry| entry.text);
        error!(%code, "{text}; compensation was switched off until an operator enables it");
        // no request of before may lift this
        self.retained.switched = self.ticket;
        let why = format!("{code}: {text}");
        self.retained.objection = Some(why.clone());
        self.change(|retained| retained.hold = Some(why));
        self.audit_own("disable", format!("{code} {text}"), "ordered", None);
    }

    /// A fault is counted and goes into the audit log; it is latched, so it cannot come often.
    pub(super) fn fault(&mut self, event: &Event) {
        let Event::StateChanged { from, to: State::Faulted, reason, detail } = event else { return };
        let entry = fault::of_reason(*reason);
        self.tally.fault(entry.name);
        let numbers = self.status_collector.numbers(detail.as_ref());
        self.change(|retained| {
            (retained.fault, retained.fault_numbers) = (Some(entry.code.to_string()), numbers.clone());
        });
        let numbers = numbers.map_or_else(String::new, |numbers| format!(": {numbers}"));
        let detail = format!("{} {}, in state {}{numbers}", entry.code, entry.name, from.name());
        self.audit_own("fault", entry.text.to_owned(), "faulted", Some(detail));
    }
}
