//! The product's own programs as processes of this one: `cncsim` started again with a hidden verb.
//!
//! So the demo needs nothing but its own file, and daemon and tool run as separate processes, as they do in a shop.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};

use anyhow::{Context, bail};

/// Where the programs are: the file of `cncsim`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Programs {
    cncsim: PathBuf,
}

impl Programs {
    /// This process' own file, which must be `cncsim`.
    ///
    /// # Errors
    /// The system does not tell which file it is.
    pub fn this() -> anyhow::Result<Self> {
        Ok(Self::at(std::env::current_exe().context("cannot find this program's own file")?))
    }

    /// Another file of `cncsim`, as tests have it.
    #[must_use]
    pub fn at(cncsim: impl Into<PathBuf>) -> Self {
        Self { cncsim: cncsim.into() }
    }

    /// Runs `volcomp ARGS..` to its end and returns what it printed.
    ///
    /// # Errors
    /// It could not be started, or failed; the message holds what it said.
    pub fn volcomp(&self, args: &[&str]) -> anyhow::Result<String> {
        let output = Command::new(&self.cncsim).arg("volcomp").args(args).stdin(Stdio::null()).output()?;
        if !output.status.success() {
            bail!("volcomp {}: {}", args.join(" "), String::from_utf8_lossy(&output.stderr).trim_end());
        }
        Ok(String::from_utf8_lossy(&output.stdout).into_owned())
    }

    /// Runs `volcomp ARGS..` to its end and returns its exit code and what it said on stderr.
    ///
    /// # Errors
    /// It could not be started.
    pub fn exit_of(&self, args: &[&str]) -> anyhow::Result<(i32, String)> {
        let output = Command::new(&self.cncsim).arg("volcomp").args(args).stdin(Stdio::null()).output()?;
        let said = String::from_utf8_lossy(&output.stderr).trim_end().to_owned();
        Ok((output.status.code().unwrap_or(-1), said))
    }

    /// Starts `volcompd --config FILE`, its log going to a file.
    ///
    /// # Errors
    /// It could not be started.
    pub fn volcompd(&self, config: &Path, log: &Path) -> anyhow::Result<Daemon> {
        self.daemon("volcompd", config, log)
    }

    /// The same without any permission to take real-time priority or to lock memory.
    ///
    /// # Errors
    /// It could not be started.
    pub fn humble_volcompd(&self, config: &Path, log: &Path) -> anyhow::Result<Daemon> {
        self.daemon("humble-volcompd", config, log)
    }

    /// The same where no file may become longer than so many units of 1024 bytes, as if the disk were full.
    ///
    /// # Errors
    /// It could not be started.
    pub fn cramped_volcompd(&self, config: &Path, log: &Path, kib: u32) -> anyhow::Result<Daemon> {
        let mut shell = Command::new("sh");
        // without the signal, the system call itself says that there is no room
        let script = format!("trap '' XFSZ; ulimit -f {}; exec \"$@\"", 2 * u64::from(kib));
        shell.args(["-c", &script, "sh"]).arg(&self.cncsim);
        Self::spawn(shell, "volcompd", config, log)
    }

    fn daemon(&self, verb: &str, config: &Path, log: &Path) -> anyhow::Result<Daemon> {
        Self::spawn(Command::new(&self.cncsim), verb, config, log)
    }

    fn spawn(mut command: Command, verb: &str, config: &Path, log: &Path) -> anyhow::Result<Daemon> {
        let log = File::options()
            .create(true)
            .append(true)
            .open(log)
            .with_context(|| format!("cannot write {}", log.display()))?;
        let child = command
            .arg(verb)
            .arg("--config")
            .arg(config)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(log)
            .spawn()
            .context("cannot start the daemon")?;
        Ok(Daemon { child })
    }
}

/// A running daemon; it is ended when this is dropped.
#[derive(Debug)]
pub struct Daemon {
    child: Child,
}

impl Daemon {
    /// The process id.
    #[must_use]
    pub fn id(&self) -> u32 {
        self.child.id()
    }

    /// Ends it without any chance to say goodbye, as a crash or a power cut would.
    ///
    /// # Errors
    /// The system refused.
    pub fn kill(&mut self) -> anyhow::Result<()> {
        self.child.kill()?;
        self.child.wait()?;
        Ok(())
    }

    /// Waits until it has ended by itself.
    ///
    /// # Errors
    /// The system does not tell.
    pub fn wait(&mut self) -> anyhow::Result<ExitStatus> {
        Ok(self.child.wait()?)
    }

    /// True while it runs.
    pub fn is_running(&mut self) -> bool {
        matches!(self.child.try_wait(), Ok(None))
    }
}

impl Drop for Daemon {
    fn drop(&mut self) {
        // nothing is left to be done where the process is already gone
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
