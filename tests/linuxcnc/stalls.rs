//! How long the host takes the processors away: nothing here can be judged while it does.
//!
//! One thread per processor sleeps for a millisecond and sees when it wakes, above the priority of LinuxCNC's servo thread
//! and of volcompd, so that neither of them can be what it sees.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};
use thread_priority::{
    RealtimeThreadSchedulePolicy, ThreadPriority, ThreadPriorityValue, ThreadSchedulePolicy,
    set_thread_priority_and_policy, thread_native_id,
};

/// LinuxCNC's servo thread has 50, volcompd 40.
const PRIORITY: u8 = 60;
const NAP: Duration = Duration::from_millis(1);

/// Watches until it is dropped.
pub(crate) struct Stalls {
    longest_us: Arc<AtomicU64>,
    end: Arc<AtomicBool>,
    threads: Vec<JoinHandle<()>>,
}

impl Stalls {
    pub(crate) fn watch() -> Self {
        let (longest_us, end) = (Arc::new(AtomicU64::new(0)), Arc::new(AtomicBool::new(false)));
        let allowed = sched_getaffinity(None).expect("the processors of this process");
        let threads = (0..CpuSet::MAX_CPU)
            .filter(|&cpu| allowed.is_set(cpu))
            .map(|cpu| {
                let (longest_us, end) = (Arc::clone(&longest_us), Arc::clone(&end));
                std::thread::spawn(move || watch(cpu, &longest_us, &end))
            })
            .collect();
        Self { longest_us, end, threads }
    }

    /// The longest time that a processor was away so far.
    pub(crate) fn longest(&self) -> Duration {
        Duration::from_micros(self.longest_us.load(Ordering::Relaxed))
    }
}

impl Drop for Stalls {
    fn drop(&mut self) {
        self.end.store(true, Ordering::Relaxed);
        for thread in self.threads.drain(..) {
            let _ = thread.join();
        }
    }
}

fn watch(cpu: usize, longest_us: &AtomicU64, end: &AtomicBool) {
    let mut set = CpuSet::new();
    set.set(cpu);
    let policy = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo);
    let priority = ThreadPriorityValue::try_from(PRIORITY).expect("a priority");
    let raised =
        set_thread_priority_and_policy(thread_native_id(), ThreadPriority::Crossplatform(priority), policy);
    // without the right to a priority, what is seen may be any program's doing: then nothing is excused
    if sched_setaffinity(None, &set).is_err() || raised.is_err() {
        return;
    }
    while !end.load(Ordering::Relaxed) {
        let asleep = Instant::now();
        std::thread::sleep(NAP);
        let late = asleep.elapsed().saturating_sub(NAP);
        longest_us.fetch_max(u64::try_from(late.as_micros()).unwrap_or(u64::MAX), Ordering::Relaxed);
    }
}
