//! SIGTERM and SIGINT, on a thread of their own: a stop works and the process ends, whatever the service does.
//!
//! The first signal asks for a clean stop, the second for an immediate one, the third ends the process. The wish is an
//! atomic that the cycle thread reads. Once that thread has ended, or has not ended in time, the service has
//! [`END_LIMIT`] to finish; then this thread ends the process.

use std::io;
use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::mpsc::{Sender, channel};
use std::time::{Duration, Instant};

use tokio::signal::unix::{Signal, SignalKind, signal};
use tracing::{error, warn};

use super::channels::{Progress, StopWish};

/// Time for the cycle thread to end after its own limit for a clean stop (60 s) has passed.
pub(super) const STOP_LIMIT: Duration = Duration::from_secs(65);
/// Time for the service to write what is left once the cycle thread has ended.
const END_LIMIT: Duration = Duration::from_secs(10);
/// Interval at which the end of the cycle thread is looked for.
const LOOK: Duration = Duration::from_millis(50);
/// Time for the last line of the log.
const LOG_LIMIT: Duration = Duration::from_millis(200);
/// Exit code where the service does not end by itself.
const EX_SOFTWARE: i32 = 70;
/// SIGXFSZ of Linux.
const FILE_SIZE: i32 = 25;

/// Signals that mean something here.
struct Signals {
    terminate: Signal,
    interrupt: Signal,
    hangup: Signal,
    /// A file that has reached the limit of its size is an error of that file and not the end of the daemon.
    _file_size: Signal,
}

impl Signals {
    fn install() -> io::Result<Self> {
        Ok(Self {
            terminate: signal(SignalKind::terminate())?,
            interrupt: signal(SignalKind::interrupt())?,
            hangup: signal(SignalKind::hangup())?,
            _file_size: signal(SignalKind::from_raw(FILE_SIZE))?,
        })
    }
}

/// Installs the handlers and starts the thread that waits for signals.
pub(super) fn watch(progress: Arc<Progress>) -> io::Result<()> {
    let (installed, result) = channel();
    std::thread::Builder::new()
        .name("volcomp-signal".to_owned())
        .spawn(move || run(&progress, &installed))?;
    result.recv().unwrap_or_else(|_| Err(io::Error::other("the thread of the signals has ended")))
}

fn run(progress: &Progress, installed: &Sender<io::Result<()>>) {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
    let outcome = runtime.and_then(|runtime| {
        let signals = runtime.block_on(async { Signals::install() })?;
        Ok((runtime, signals))
    });
    match outcome {
        Ok((runtime, signals)) => {
            let _ = installed.send(Ok(()));
            runtime.block_on(wait(progress, signals));
        }
        Err(problem) => {
            let _ = installed.send(Err(problem));
        }
    }
}

async fn wait(progress: &Progress, mut signals: Signals) {
    let mut deadline = Deadline::default();
    let mut look = tokio::time::interval(LOOK);
    loop {
        tokio::select! {
            _ = signals.terminate.recv() => stop(progress),
            _ = signals.interrupt.recv() => stop(progress),
            _ = signals.hangup.recv() => {
                // on a thread of its own: a log that hangs must not keep SIGTERM waiting
                std::thread::spawn(|| warn!(
                    "SIGHUP: nothing is re-read and nothing changes; configuration and model are read at start only. \
                     After `volcomp check`, restart the daemon: the offset is ramped out, then the new files apply"
                ));
            }
            _ = look.tick() => {
                let (stopping, ended) = (progress.stop() != StopWish::No, progress.cycle_ended.load(Relaxed));
                if deadline.is_over(Instant::now(), stopping, ended) {
                    end("the service does not end by itself, so the process is ended");
                }
            }
        }
    }
}

/// Each signal asks for more than the one before.
fn stop(progress: &Progress) {
    match progress.stop() {
        StopWish::No => progress.ask_stop(StopWish::Clean),
        StopWish::Clean => progress.ask_stop(StopWish::Now),
        StopWish::Now => end("a third signal: the process is ended"),
    }
}

/// Ends the process, after an attempt to say why.
fn end(why: &'static str) {
    std::thread::spawn(move || error!("{why}; the control's watchdog removes the remaining offset"));
    std::thread::sleep(LOG_LIMIT);
    std::process::exit(EX_SOFTWARE);
}

/// When the process is ended.
#[derive(Debug, Default)]
struct Deadline {
    asked: Option<Instant>,
    ended: Option<Instant>,
}

impl Deadline {
    fn is_over(&mut self, now: Instant, stopping: bool, ended: bool) -> bool {
        if ended {
            self.ended.get_or_insert(now);
        }
        if stopping {
            self.asked.get_or_insert(now);
        }
        let over = |since: Option<Instant>, limit| since.is_some_and(|at| now.duration_since(at) >= limit);
        over(self.ended, END_LIMIT) || over(self.asked, STOP_LIMIT + END_LIMIT)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_process_ends_some_time_after_the_cycle_thread_or_after_the_limit_for_a_stop() {
        let start = Instant::now();
        let mut deadline = Deadline::default();
        assert!(!deadline.is_over(start + Duration::from_secs(10_000), false, false), "nobody asked");
        let mut deadline = Deadline::default();
        assert!(!deadline.is_over(start, true, false));
        assert!(!deadline.is_over(start + STOP_LIMIT, true, false));
        assert!(deadline.is_over(start + STOP_LIMIT + END_LIMIT, true, false));
        let mut deadline = Deadline::default();
        assert!(!deadline.is_over(start, true, true));
        assert!(deadline.is_over(start + END_LIMIT, true, true));
    }

    #[test]
    fn each_signal_asks_for_more() {
        let progress = Progress::default();
        stop(&progress);
        assert_eq!(progress.stop(), StopWish::Clean);
        stop(&progress);
        assert_eq!(progress.stop(), StopWish::Now);
    }
}
