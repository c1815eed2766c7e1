//! The two answering programs, each a process of its own, and the tool that asks the daemon.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Command, Stdio};

use super::echo::EchoSettings;
use super::error::BenchError;

/// Where the programs are.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Programs {
    /// `cncsim`, which is echo, daemon and tool by hidden verbs.
    pub cncsim: PathBuf,
    /// `volcompd`, where it is to be another file.
    pub volcompd: Option<PathBuf>,
}

/// A process that ends with this value.
#[derive(Debug)]
pub struct Running {
    child: Child,
}

impl Programs {
    /// Starts the bare echo.
    ///
    /// # Errors
    /// It does not start.
    pub fn echo(&self, settings: &EchoSettings) -> Result<Running, BenchError> {
        let mut command = Command::new(&self.cncsim);
        command.arg("bench-echo").arg("--control").arg(settings.address.to_string());
        command.arg("--priority").arg(settings.thread.priority.to_string());
        command.arg("--busy-poll-us").arg(settings.busy_poll.as_micros().to_string());
        command.arg("--cycle-us").arg(settings.cycle.as_micros().to_string());
        if let Some(cpu) = settings.thread.cpu {
            command.arg("--cpu").arg(cpu.to_string());
        }
        if settings.thread.lock_memory {
            command.arg("--lock-memory");
        }
        start(command.stdin(Stdio::null()).stdout(Stdio::null()), "the bare echo")
    }

    /// Starts the daemon.
    ///
    /// # Errors
    /// It does not start, or its log cannot be written.
    pub fn volcompd(&self, config: &Path, log: &Path) -> Result<Running, BenchError> {
        let file = File::options()
            .create(true)
            .append(true)
            .open(log)
            .map_err(|source| BenchError::File { path: log.to_owned(), source })?;
        let mut command = match &self.volcompd {
            Some(program) => Command::new(program),
            None => {
                let mut command = Command::new(&self.cncsim);
                command.arg("volcompd");
                command
            }
        };
        command.arg("--config").arg(config).env_remove("NOTIFY_SOCKET").env_remove("WATCHDOG_USEC");
        start(command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(file), "volcompd")
    }

    /// Runs `volcomp VERB ..` and reads the JSON object that it prints.
    ///
    /// # Errors
    /// It fails, or prints something else.
    pub fn volcomp(&self, verb: &'static str, args: &[&str]) -> Result<serde_json::Value, BenchError> {
        let output = Command::new(&self.cncsim)
            .arg("volcomp")
            .arg(verb)
            .args(args)
            .stdin(Stdio::null())
            .output()
            .map_err(|source| BenchError::Start { what: "volcomp", source })?;
        let failed = |said: String| BenchError::Tool { verb, said };
        // below the codes for failures a verb tells a verdict by its exit code, as `status` does
        if output.status.code().is_none_or(|code| code >= 64) {
            return Err(failed(String::from_utf8_lossy(&output.stderr).trim_end().to_owned()));
        }
        serde_json::from_slice(&output.stdout).map_err(|e| failed(e.to_string()))
    }
}

impl Running {
    /// The process id.
    #[must_use]
    pub fn id(&self) -> u32 {
        self.child.id()
    }

    /// Its stdout, where that is a pipe that nobody has taken.
    pub(super) const fn stdout(&mut self) -> Option<ChildStdout> {
        self.child.stdout.take()
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        // nothing is left to be done where the process is already gone
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

pub(super) fn start(command: &mut Command, what: &'static str) -> Result<Running, BenchError> {
    command.spawn().map(|child| Running { child }).map_err(|source| BenchError::Start { what, source })
}
