//! What has to reach the disk and may take its time: the audit log and the counters, on a thread of their own.
//!
//! A disk that hangs stops this thread and nobody else: the queue fills, audit entries are counted as lost, counters
//! are saved the next time.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use crossbeam_channel::{Receiver, RecvTimeoutError, Sender, bounded};
use tracing::{error, info, warn};

use super::audit::chain::AuditFile;
use super::audit::{AUDIT_FILE, Audit, AuditEntry, Who};
use super::counters::Counters;
use super::load::Loaded;
use super::models::Prepared;
use crate::core::fault::Code;

/// Jobs in flight.
const QUEUE: usize = 256;
/// Time for the last jobs when the daemon ends.
const FINISH_LIMIT: Duration = Duration::from_secs(3);
/// Locked by the daemon that keeps its things here.
const LOCK_FILE: &str = "lock";

/// Something to be kept.
#[derive(Debug)]
pub(super) enum Job {
    /// A line of the audit log.
    Audit(Box<AuditEntry>),
    /// The counters as they are now.
    Counters(Box<Counters>),
    /// Nothing more comes.
    End,
}

/// The keeper's thread, seen from the service.
#[derive(Debug, Default)]
pub(super) struct Keeper {
    pub(super) audit: Audit,
    jobs: Option<(Sender<Job>, Receiver<()>)>,
    problem: Arc<Mutex<Option<String>>>,
    directory: Option<PathBuf>,
    /// Hash of the model that the audit log named last.
    known_model: Option<String>,
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

impl Keeper {
    /// Starts to keep, where there is a directory to keep things in. One that cannot be used is told and done without.
    pub(super) fn start(config_path: &Path, loaded: &Loaded) -> Self {
        let Some(directory) = directory(config_path, loaded) else {
            info!("no state directory: counters and audit log are not kept ([state] directory)");
            return Self::default();
        };
        match Self::open(&directory) {
            Ok(keeper) => keeper,
            Err(problem) => {
                let directory = directory.display();
                warn!(%directory, code = %Code::COUNTERS_NOT_SAVED, "counters and audit log are not kept: {problem}");
                let problem = format!("{directory}: {problem}");
                Self { problem: Arc::new(Mutex::new(Some(problem))), ..Self::default() }
            }
        }
    }

    fn open(directory: &Path) -> std::io::Result<Self> {
        std::fs::create_dir_all(directory)?;
        let owner = File::create(directory.join(LOCK_FILE))?;
        // two daemons would write their lines into one chain
        owner.try_lock().map_err(|_| {
            std::io::Error::other("in use by another volcompd; give each its own [state] directory")
        })?;
        let path = directory.join(AUDIT_FILE);
        let (file, broken) = AuditFile::open(&path)?;
        if let Some(broken) = broken {
            let path = path.display();
            error!(%path, code = %Code::AUDIT_BROKEN, "the audit log is broken: {broken}; it was set aside and a new one names it");
        }
        let known_model = file.model().map(str::to_owned);
        let (sender, jobs) = bounded(QUEUE);
        let (end, ended) = bounded::<()>(1);
        let problem = Arc::new(Mutex::new(None));
        let shared = Arc::clone(&problem);
        let folder = directory.to_owned();
        let audit = Audit::new(sender.clone());
        let lost = audit.losses();
        std::thread::Builder::new().name("volcomp-keep".to_owned()).spawn(move || {
            let _end = end;
            run(&jobs, file, &folder, &shared, &lost);
        })?;
        let directory = Some(directory.to_owned());
        Ok(Self { audit, jobs: Some((sender, ended)), problem, directory, known_model, _owner: Some(owner) })
    }

    /// The first lines of a run: the start, and the model where it is another one than before.
    pub(super) fn announce(&self, loaded: &Loaded, active: &Prepared) {
        let hash = Some(active.hash.clone());
        self.audit.write(AuditEntry {
            who: Who::daemon(),
            what: "start".to_owned(),
            new_model: hash.clone(),
            result: "ok".to_owned(),
            detail: Some(format!(
                "volcompd {}, machine {}, machine file blake3 {}",
                env!("CARGO_PKG_VERSION"),
                loaded.config.machine,
                blake3::hash(loaded.config_text.as_bytes()).to_hex()
            )),
            ..AuditEntry::default()
        });
        if self.known_model != hash {
            self.audit.write(AuditEntry {
                who: Who::daemon(),
                what: "model".to_owned(),
                old_model: self.known_model.clone(),
                new_model: hash,
                result: "loaded".to_owned(),
                detail: Some(active.origin.clone()),
                ..AuditEntry::default()
            });
        }
    }

    /// Where things are kept.
    pub(super) fn directory(&self) -> Option<&Path> {
        self.directory.as_deref()
    }

    /// Saves the counters; skipped where the disk does not keep up.
    pub(super) fn save(&self, counters: Counters) {
        if let Some((sender, _)) = &self.jobs {
            let _ = sender.try_send(Job::Counters(Box::new(counters)));
        }
    }

    /// Why things are not kept.
    pub(super) fn problem(&self) -> Option<String> {
        self.problem.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Waits until everything is kept; gives up where the disk does not answer.
    pub(super) fn finish(&self) {
        let Some((sender, ended)) = &self.jobs else { return };
        let asked = sender.send_timeout(Job::End, FINISH_LIMIT).is_ok();
        if !asked || ended.recv_timeout(FINISH_LIMIT) == Err(RecvTimeoutError::Timeout) {
            warn!("the disk does not take counters and audit log within {} s", FINISH_LIMIT.as_secs());
        }
    }
}

fn run(
    jobs: &Receiver<Job>,
    mut file: AuditFile,
    directory: &Path,
    problem: &Mutex<Option<String>>,
    lost: &AtomicU64,
) {
    let mut failing = [false; 2];
    while let Ok(job) = jobs.recv() {
        let (slot, result) = match job {
            Job::End => return,
            Job::Audit(entry) => (
                0,
                file.write(&entry).map(|(seq, hash)| {
                    info!(seq, hash, what = entry.what, result = entry.result, "audit");
                }),
            ),
            Job::Counters(counters) => (1, counters.save(directory)),
        };
        let what = ["audit log", "counters"][slot];
        match result {
            Ok(()) => failing[slot] = false,
            Err(e) => {
                if slot == 0 {
                    lost.fetch_add(1, Relaxed);
                }
                let text = format!("{what} in {}: {e}", directory.display());
                if !std::mem::replace(&mut failing[slot], true) {
                    warn!(code = %Code::COUNTERS_NOT_SAVED, "not kept: {text}");
                }
                *problem.lock().unwrap_or_else(PoisonError::into_inner) = Some(text);
            }
        }
        if failing == [false; 2] {
            *problem.lock().unwrap_or_else(PoisonError::into_inner) = None;
        }
    }
}
