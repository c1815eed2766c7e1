//! Answers to clients, in order, and what must follow from it.

use std::path::Path;
use std::sync::Mutex as Notes;
use std::sync::atomic::Ordering::Relaxed;

use super::memory_disk::MemoryDisk;
use volcomp_state::counters::{Counters, FILE, RetainedState};

use crate::channels::Progress;
use crate::models::Models;
use crate::socket::{Answer, Verb};

#[derive(Debug, Clone)]
struct Order {
    verb: Verb,
    begin: u64,
    /// `None` while it is under way, and for ever where its daemon was killed.
    end: Option<u64>,
    ok: bool,
    durable: bool,
}

#[derive(Debug, Default)]
struct Log {
    time: u64,
    orders: Vec<Order>,
    /// The state was damaged at this time.
    damaged: Option<u64>,
    /// Compensation began by itself at this time.
    begun: Option<u64>,
}

/// Every request of all lives.
#[derive(Debug, Default)]
pub(super) struct History(Notes<Log>);

impl Log {
    fn tick(&mut self) -> u64 {
        self.time += 1;
        self.time
    }

    /// An enable may have taken effect after `time`.
    fn enabled_after(&self, time: u64, only_ok: bool) -> bool {
        self.orders.iter().any(|order| {
            order.verb == Verb::Enable
                && order.end.is_none_or(|end| end > time)
                && (order.ok || !only_ok || order.end.is_none())
        })
    }
}

impl History {
    pub(super) fn begin(&self, verb: Verb) -> usize {
        let mut log = self.0.lock().expect("notes");
        let begin = log.tick();
        log.orders.push(Order { verb, begin, end: None, ok: false, durable: false });
        log.orders.len() - 1
    }

    pub(super) fn end(&self, number: usize, answer: &Answer, progress: &Progress) {
        assert!(answer.ok || answer.error.is_some(), "an answer says why");
        let mut log = self.0.lock().expect("notes");
        let end = log.tick();
        let order = &mut log.orders[number];
        order.end = Some(end);
        order.ok = answer.ok;
        order.durable = answer.ok && answer.notes.is_empty();
        let order = order.clone();
        if order.verb == Verb::Disable && order.ok && !log.enabled_after(order.begin, true) {
            assert!(
                !progress.wanted.load(Relaxed),
                "on although `disable` was answered and nobody has enabled since"
            );
        }
    }

    /// A life begins; `permitted`: compensation with it.
    pub(super) fn begins(&self, permitted: bool) {
        let mut log = self.0.lock().expect("notes");
        let time = log.tick();
        log.begun = permitted.then_some(time);
    }

    /// What is on the disk was damaged.
    pub(super) fn damaged(&self) {
        let mut log = self.0.lock().expect("notes");
        log.damaged = Some(log.time);
    }

    /// Everything on the disk is gone: a first start.
    pub(super) fn forgotten(&self) {
        *self.0.lock().expect("notes") = Log::default();
    }

    /// Whether compensation must not begin by itself after what was answered.
    pub(super) fn forbids(&self) -> Option<String> {
        let log = self.0.lock().expect("notes");
        let off = log.orders.iter().rev().find(|order| order.verb == Verb::Disable && order.durable);
        if let Some(off) = off.filter(|off| !log.enabled_after(off.begin, false)) {
            return Some(format!("{off:?} was answered: {:#?}", log.orders));
        }
        let damaged = log.damaged.filter(|time| !log.enabled_after(*time, false));
        damaged.map(|time| format!("the disk was damaged at {time}: {:#?}", log.orders))
    }

    /// Nothing is under way, and compensation is wanted or not.
    pub(super) fn check(&self, wanted: bool) {
        let log = self.0.lock().expect("notes");
        let since_start = |order: &&Order| log.begun.is_none_or(|begun| order.begin > begun);
        let off = log.orders.iter().filter(since_start).rev().find(|o| o.verb == Verb::Disable && o.ok);
        if wanted {
            assert!(log.begun.is_some() || log.enabled_after(0, true), "on, and nobody has enabled");
            if let Some(off) = off {
                assert!(log.enabled_after(off.begin, true), "on against the last order that was answered");
            }
        }
    }
}

/// The file of the counters as the next life would find it.
pub(super) fn retained_on(disk: &MemoryDisk) -> Option<RetainedState> {
    let text = disk.files().remove(&Path::new(super::DIRECTORY).join(FILE))?;
    Counters::parse(&text, super::MACHINE).ok().map(|counters| counters.retained)
}

/// Whether what is on the disk forbids to begin: an order, a fault, or a state that nobody knows.
pub(super) fn must_not_begin(disk: &MemoryDisk) -> Option<String> {
    if disk.files().is_empty() {
        return None;
    }
    let Some(retained) = retained_on(disk) else { return Some("nobody knows the state".to_owned()) };
    let held = retained.off || retained.hold.is_some() || retained.fault.is_some();
    held.then(|| format!("the disk has {retained:?}"))
}

/// The book of the models names the one in use.
pub(super) fn check_model(disk: &MemoryDisk, models: &Models) {
    let files = disk.files();
    let book = &files[&Path::new(super::DIRECTORY).join("models.json")];
    let book: serde_json::Value = serde_json::from_slice(book).expect("a book");
    if models.notes.is_empty() {
        assert_eq!(book["active"]["hash"], models.active.hash.as_str(), "the book names the model in use");
    }
}
