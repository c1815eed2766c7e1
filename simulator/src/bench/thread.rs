//! Scheduling class, processor and memory lock of the echo and of the measuring thread, as volcompd's own.

use rustix::mm::{MlockAllFlags, mlockall};
use rustix::thread::{CpuSet, sched_setaffinity, set_current_timer_slack};
use thread_priority::{
    RealtimeThreadSchedulePolicy, ThreadPriority, ThreadPriorityValue, ThreadSchedulePolicy,
    set_thread_priority_and_policy, thread_native_id,
};

/// What a thread asks the system for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ThreadSettings {
    /// SCHED_FIFO priority, 0 for none.
    pub priority: u8,
    /// Processor to run on.
    pub cpu: Option<u16>,
    /// Lock the memory of the process.
    pub lock_memory: bool,
}

/// What it got, in words.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize)]
pub struct Granted {
    /// SCHED_FIFO.
    pub fifo: String,
    /// Processor affinity.
    pub affinity: String,
    /// Memory lock.
    pub memory_lock: String,
}

impl ThreadSettings {
    /// Applies them to the calling thread; refused settings are reported and left out.
    #[must_use]
    pub fn apply(self) -> Granted {
        let Self { priority, cpu, lock_memory } = self;
        // wake up when asked to: threads without real-time priority are woken up to 50 us late otherwise
        let _ = set_current_timer_slack(core::num::NonZeroU64::new(1));
        Granted {
            fifo: asked(priority > 0, || fifo(priority)),
            affinity: asked(cpu.is_some(), || affinity(cpu.unwrap_or_default())),
            memory_lock: asked(lock_memory, || {
                mlockall(MlockAllFlags::CURRENT | MlockAllFlags::FUTURE).map_err(|e| e.to_string())
            }),
        }
    }
}

fn asked(asked: bool, what: impl FnOnce() -> Result<(), String>) -> String {
    if !asked {
        return "not asked for".to_owned();
    }
    what().map_or_else(|why| format!("refused: {why}"), |()| "yes".to_owned())
}

fn fifo(priority: u8) -> Result<(), String> {
    let value = ThreadPriorityValue::try_from(priority).map_err(|e| e.to_owned())?;
    let policy = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo);
    set_thread_priority_and_policy(thread_native_id(), ThreadPriority::Crossplatform(value), policy)
        .map_err(|e| e.to_string())
}

fn affinity(cpu: u16) -> Result<(), String> {
    let mut set = CpuSet::new();
    if usize::from(cpu) >= CpuSet::MAX_CPU {
        return Err("out of range".to_owned());
    }
    set.set(usize::from(cpu));
    sched_setaffinity(None, &set).map_err(|e| e.to_string())
}
