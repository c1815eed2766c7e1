//! Writes the audit log and the counters on a thread of its own.
//!
//! A disk that hangs stops this thread and nobody else: the queue fills, audit entries are counted as lost, and of the
//! counters only the newest wait. Whoever must not answer before an order is durable asks [`StateWriter::saved`].

use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;
use std::time::Duration;

use tracing::{error, info, warn};
use volcomp_state::counters::{Counters, LOCK_FILE, Recalled, recall};
use volcomp_state::disk::{Disk, real};

use super::audit::chain::AuditFile;
use super::audit::{self, AUDIT_FILE, Audit, AuditEntry};
use super::counters::unknown;
use super::load::Loaded;
use super::models::Prepared;
use super::sync;
use super::write_queue::{Saved, WriteQueue, WriteRequest};
use volcomp_config::StartMode;
use volcomp_engine::fault::Code;

/// Time for the last entries when the daemon ends.
const FINISH_LIMIT: Duration = Duration::from_secs(3);
/// Interval at which the end is looked for.
const POLL: Duration = Duration::from_millis(2);

/// The state writer thread, seen from the service.
#[derive(Debug)]
pub(super) struct StateWriter {
    pub(super) audit: Audit,
    write_queue: Option<Arc<WriteQueue>>,
    /// Why nothing is kept in a directory that was asked for.
    unusable: Option<String>,
    disk: Arc<dyn Disk>,
    directory: Option<PathBuf>,
    /// What the run before has left; `None` where there is no state directory.
    recalled: Option<Recalled>,
    /// Hash of the model that the audit log named last.
    known_model: Option<String>,
    /// What the chain of the audit log lacked at the start.
    broken_audit: Option<String>,
    /// Held while this daemon runs, so that no second one keeps its things in the same place.
    _owner: Option<File>,
}

/// The state directory: the configured one, else the one that systemd gives the service.
fn directory(config_path: &Path, loaded: &Loaded) -> Option<PathBuf> {
    if let Some(directory) = &loaded.config.state.directory {
        return Some(config_path.with_file_name(directory));
    }
    let given = std::env::var("STATE_DIRECTORY").ok()?;
    // systemd separates several by colons; the first is ours
    given.split(':').next().filter(|d| !d.is_empty()).map(PathBuf::from)
}

impl StateWriter {
    /// Starts to keep, where there is a directory to keep things in. One that cannot be used is an unknown state.
    pub(super) fn start(config_path: &Path, loaded: &Loaded) -> Self {
        let Some(directory) = directory(config_path, loaded) else {
            let lost = "no state directory ([state] directory): orders, a latched fault, counters and audit log do not \
                        outlive the daemon";
            match loaded.config.start {
                StartMode::OnConnect => {
                    warn!(
                        "{lost}; with start = \"on-connect\" a restart undoes `disable` and a latched fault"
                    );
                }
                StartMode::OnCommand => info!("{lost}"),
            }
            return Self::nowhere(None, None);
        };
        match Self::open(&directory, &loaded.config.machine) {
            Ok(state_writer) => state_writer,
            Err(problem) => {
                let directory = directory.display();
                warn!(%directory, code = %Code::COUNTERS_NOT_SAVED, "counters and audit log are not kept: {problem}");
                let problem = format!("{directory}: {problem}");
                Self::nowhere(Some(Recalled::Unknown(problem.clone())), Some(problem))
            }
        }
    }

    fn nowhere(recalled: Option<Recalled>, unusable: Option<String>) -> Self {
        Self {
            audit: Audit::default(),
            write_queue: None,
            unusable,
            disk: real(),
            directory: None,
            recalled,
            known_model: None,
            broken_audit: None,
            _owner: None,
        }
    }

    fn open(directory: &Path, machine: &str) -> io::Result<Self> {
        std::fs::create_dir_all(directory)?;
        let owner = File::create(directory.join(LOCK_FILE))?;
        // two daemons would write their lines into one chain
        owner.try_lock().map_err(|_| {
            io::Error::other("in use by another volcompd; give each its own [state] directory")
        })?;
        Ok(Self { _owner: Some(owner), ..Self::on(real(), directory, machine)? })
    }

    /// Keeps things in a directory that is nobody else's.
    pub(super) fn on(disk: Arc<dyn Disk>, directory: &Path, machine: &str) -> io::Result<Self> {
        // before anything else is written: whatever is in the directory later is of an earlier run
        let mut recalled = recall(&*disk, directory, machine);
        if recalled == Recalled::First
            && let Err(e) = Counters::new(machine).save(&*disk, directory)
        {
            recalled = Recalled::Unknown(format!("{} cannot be written: {e}", directory.display()));
        }
        let path = directory.join(AUDIT_FILE);
        let (file, broken) = AuditFile::open(Arc::clone(&disk), &path)?;
        let broken_audit = broken.map(|broken| broken.to_string());
        if let Some(broken) = &broken_audit {
            let path = path.display();
            error!(%path, code = %Code::AUDIT_BROKEN, "the audit log is broken: {broken}; it was set aside and a new one names it");
        }
        let known_model = file.model().map(str::to_owned);
        let write_queue = Arc::new(WriteQueue::default());
        let (theirs, folder, its_disk) = (Arc::clone(&write_queue), directory.to_owned(), Arc::clone(&disk));
        sync::spawn("volcomp-keep", move || run(&Running(theirs), file, &*its_disk, &folder))?;
        Ok(Self {
            audit: Audit::new(Arc::clone(&write_queue)),
            write_queue: Some(write_queue),
            unusable: None,
            disk,
            directory: Some(directory.to_owned()),
            recalled: Some(recalled),
            known_model,
            broken_audit,
            _owner: None,
        })
    }

    /// What the run before has left; `None` where there is no state directory.
    pub(super) const fn recalled(&self) -> Option<&Recalled> {
        self.recalled.as_ref()
    }

    /// What the chain of the audit log lacked at the start.
    pub(super) fn broken_audit(&self) -> Option<&str> {
        self.broken_audit.as_deref()
    }

    /// Makes durable that compensation must not begin by itself, before anything is written that would hide why.
    pub(super) fn hold(&mut self, why: &str) -> io::Result<()> {
        let (Some(Recalled::Known(counters)), Some(directory)) = (&mut self.recalled, &self.directory) else {
            return Ok(());
        };
        counters.retained.hold.get_or_insert_with(|| unknown(why));
        counters.save(&*self.disk, directory)
    }

    /// The first lines of a run: the start, and the model where it is another one than before.
    pub(super) fn announce(&self, loaded: &Loaded, active: &Prepared) {
        let hash = Some(active.hash.clone());
        self.audit.write(AuditEntry {
            new_model: hash.clone(),
            detail: Some(format!(
                "volcompd {}, machine {}, machine file blake3 {}",
                env!("CARGO_PKG_VERSION"),
                loaded.config.machine,
                blake3::hash(loaded.config_text.as_bytes()).to_hex()
            )),
            ..audit::own("start", "ok")
        });
        if self.known_model != hash {
            self.audit.write(AuditEntry {
                old_model: self.known_model.clone(),
                new_model: hash,
                detail: Some(active.origin.clone()),
                ..audit::own("model", "loaded")
            });
        }
    }

    /// Where things are kept.
    pub(super) fn directory(&self) -> Option<&Path> {
        self.directory.as_deref()
    }

    /// The disk that they are kept on.
    pub(super) fn disk(&self) -> Arc<dyn Disk> {
        Arc::clone(&self.disk)
    }

    /// Hands the counters over to be saved; gives a number to ask [`StateWriter::saved`] with.
    pub(super) fn save(&self, counters: Counters) -> u64 {
        self.write_queue.as_ref().map_or(0, |write_queue| write_queue.save(counters))
    }

    /// What has become of counters that were handed over.
    pub(super) fn saved(&self, number: u64) -> Saved {
        match (&self.write_queue, &self.unusable) {
            (Some(write_queue), _) => write_queue.saved(number),
            (None, Some(problem)) => Saved::No(problem.clone()),
            (None, None) => Saved::Nowhere,
        }
    }

    /// Why things are not kept.
    pub(super) fn problem(&self) -> Option<String> {
        let Some(write_queue) = &self.write_queue else { return self.unusable.clone() };
        write_queue.waiting.lock().problems.iter().flatten().next().cloned()
    }

    /// Waits until everything is kept; gives up where the disk does not answer.
    pub(super) fn finish(&self) {
        let Some(write_queue) = &self.write_queue else { return };
        write_queue.waiting.lock().end = true;
        write_queue.wake.notify_all();
        let mut left = FINISH_LIMIT;
        while !write_queue.waiting.lock().ended {
            if left.is_zero() {
                warn!("the disk does not take counters and audit log within {} s", FINISH_LIMIT.as_secs());
                return;
            }
            sync::pause(POLL);
            left = left.saturating_sub(POLL);
        }
    }
}

/// The queue of the thread; says on return and on panic alike that the thread has ended.
struct Running(Arc<WriteQueue>);

impl Drop for Running {
    fn drop(&mut self) {
        self.0.waiting.lock().ended = true;
    }
}

fn run(write_queue: &Running, mut file: AuditFile, disk: &dyn Disk, directory: &Path) {
    let write_queue = &write_queue.0;
    while let Some(request) = write_queue.next() {
        let (slot, result) = match &request {
            WriteRequest::Audit(entry) => (
                0,
                file.write(entry).map(|(seq, hash)| {
                    info!(seq, hash, what = entry.what, result = entry.result, "audit");
                }),
            ),
            WriteRequest::Counters(_, counters) => (1, counters.save(disk, directory)),
        };
        let what = ["audit log", "counters"][slot];
        let text = result.err().map(|e| format!("{what} in {}: {e}", directory.display()));
        let mut waiting = write_queue.waiting.lock();
        match (&request, &text) {
            (WriteRequest::Counters(number, _), None) => waiting.saved = *number,
            (WriteRequest::Counters(number, _), Some(text)) => waiting.refused = (*number, text.clone()),
            (WriteRequest::Audit(_), None) => {}
            (WriteRequest::Audit(_), Some(_)) => {
                write_queue.lost.fetch_add(1, Relaxed);
            }
        }
        let before = std::mem::replace(&mut waiting.problems[slot], text.clone());
        drop(waiting);
        if let (Some(text), None) = (text, before) {
            warn!(code = %Code::COUNTERS_NOT_SAVED, "not kept: {text}");
        }
    }
}
