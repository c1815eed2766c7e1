//! Scheduling class, processor and memory lock of the cycle thread, each where permitted.
//!
//! Nothing here is required: what the system refuses is reported in one line and the daemon works on.

use std::path::Path;

use rustix::io::Errno;
use rustix::mm::{MlockAllFlags, mlockall};
use rustix::process::{Resource, geteuid, getrlimit};
use rustix::thread::{CpuSet, sched_setaffinity};
use thread_priority::{
    RealtimeThreadSchedulePolicy, ThreadPriority, ThreadPriorityValue, ThreadSchedulePolicy,
    set_thread_priority_and_policy, thread_native_id,
};

use super::status::RealtimeStatus;
use volcomp_config::RealtimeConfig;

/// Locked memory below which the lock is not even tried: once it is on, running out of it ends the process.
const MEMLOCK_BYTES_MIN: u64 = 128 << 20;

/// One setting, asked for and got or not.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Granted {
    NotAsked,
    Yes,
    Refused { what: Refusal },
}

/// Why a setting was refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub(super) enum Refusal {
    /// The system's own error.
    #[error("{0}")]
    System(Errno),
    /// The limit on locked memory is too low, bytes.
    #[error("the limit on locked memory is {} MiB, {} MiB are needed", .0 >> 20, MEMLOCK_BYTES_MIN >> 20)]
    MemoryLimit(u64),
    /// The number is none that the system knows.
    #[error("out of range")]
    OutOfRange,
    /// A processor beyond the last one.
    #[error(
        "processor {cpu} does not exist, the last one is {last}; correct cpu in [realtime] of the machine file"
    )]
    NoProcessor {
        /// Asked for.
        cpu: u16,
        /// The last one that there is.
        last: u16,
    },
}

/// What the cycle thread got.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct RealtimeReport {
    pub(super) priority: Option<u8>,
    pub(super) fifo: Granted,
    pub(super) cpu: Option<u16>,
    pub(super) affinity: Granted,
    pub(super) memory_lock: Granted,
}

impl Granted {
    /// One word and a reason, for status and log.
    pub(super) fn text(self) -> String {
        match self {
            Self::NotAsked => "not asked for".to_owned(),
            Self::Yes => "yes".to_owned(),
            Self::Refused { what } => format!("refused: {what}"),
        }
    }

    pub(super) const fn is_refused(self) -> bool {
        matches!(self, Self::Refused { .. })
    }
}

impl RealtimeReport {
    /// True where something that was asked for was not granted.
    pub(super) const fn has_refusal(&self) -> bool {
        self.fifo.is_refused() || self.affinity.is_refused() || self.memory_lock.is_refused()
    }

    /// In words, for the status.
    pub(super) fn status(&self) -> RealtimeStatus {
        RealtimeStatus {
            fifo: self.fifo.text(),
            affinity: self.affinity.text(),
            memory_lock: self.memory_lock.text(),
        }
    }
}

/// Applies the settings to the calling thread (memory: to the process).
pub(super) fn apply(config: &RealtimeConfig) -> RealtimeReport {
    RealtimeReport {
        priority: config.priority,
        fifo: config.priority.map_or(Granted::NotAsked, fifo),
        cpu: config.cpu,
        affinity: config.cpu.map_or(Granted::NotAsked, affinity),
        memory_lock: if config.lock_memory { lock_memory() } else { Granted::NotAsked },
    }
}

fn fifo(priority: u8) -> Granted {
    let Ok(value) = ThreadPriorityValue::try_from(priority) else {
        return Granted::Refused { what: Refusal::OutOfRange };
    };
    let policy = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo);
    match set_thread_priority_and_policy(thread_native_id(), ThreadPriority::Crossplatform(value), policy) {
        Ok(()) => Granted::Yes,
        Err(thread_priority::Error::OS(code)) => {
            Granted::Refused { what: Refusal::System(Errno::from_raw_os_error(code)) }
        }
        Err(_) => Granted::Refused { what: Refusal::OutOfRange },
    }
}

fn affinity(cpu: u16) -> Granted {
    if usize::from(cpu) >= CpuSet::MAX_CPU {
        return Granted::Refused { what: Refusal::OutOfRange };
    }
    let mut set = CpuSet::new();
    set.set(usize::from(cpu));
    match (system(sched_setaffinity(None, &set)), last_processor()) {
        (Granted::Refused { .. }, Some(last)) if cpu > last => {
            Granted::Refused { what: Refusal::NoProcessor { cpu, last } }
        }
        (granted, _) => granted,
    }
}

/// The highest number of a processor of this computer; `None` where the system does not say.
#[must_use]
pub fn last_processor() -> Option<u16> {
    let list = volcomp_state::bounded_read::read_bounded(Path::new("/sys/devices/system/cpu/online"), 4096);
    // ranges such as `0-3,8-11`
    let list = String::from_utf8(list.ok()?).ok()?;
    list.trim().rsplit([',', '-']).next()?.parse().ok()
}

/// Locks what has come since, such as another model; asked for by the service after a switch.
pub(super) fn lock_again(config: &RealtimeConfig) -> Granted {
    if config.lock_memory { lock_memory() } else { Granted::NotAsked }
}

/// Locks the memory that there is. Not what is yet to come: a large model on its way in would then run into the limit,
/// and an allocation that fails ends the daemon in the middle of a part.
fn lock_memory() -> Granted {
    // the superuser is exempt from the limit
    if !geteuid().is_root()
        && let Some(limit) = getrlimit(Resource::Memlock).current
        && limit < MEMLOCK_BYTES_MIN
    {
        return Granted::Refused { what: Refusal::MemoryLimit(limit) };
    }
    system(mlockall(MlockAllFlags::CURRENT))
}

fn system(result: Result<(), Errno>) -> Granted {
    match result {
        Ok(()) => Granted::Yes,
        Err(errno) => Granted::Refused { what: Refusal::System(errno) },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_asked_for_changes_nothing() {
        let config = RealtimeConfig { priority: None, cpu: None, lock_memory: false, busy_poll_s: 0.0 };
        let report = apply(&config);
        assert_eq!(report.fifo, Granted::NotAsked);
        assert_eq!(report.affinity, Granted::NotAsked);
        assert_eq!(report.memory_lock, Granted::NotAsked);
        assert!(!report.has_refusal());
    }

    #[test]
    fn a_processor_that_does_not_exist_is_refused_with_a_reason() {
        let handle = std::thread::spawn(|| affinity(1023));
        let granted = handle.join().expect("thread ends");
        assert!(granted.is_refused());
        let last = last_processor().expect("the system lists its processors");
        let said = format!(
            "refused: processor 1023 does not exist, the last one is {last}; correct cpu in [realtime]"
        );
        assert!(granted.text().starts_with(&said), "{}", granted.text());
        assert_eq!(affinity(u16::MAX), Granted::Refused { what: Refusal::OutOfRange });
    }

    #[test]
    fn a_priority_beyond_the_range_is_refused() {
        assert_eq!(fifo(200), Granted::Refused { what: Refusal::OutOfRange });
    }
}
