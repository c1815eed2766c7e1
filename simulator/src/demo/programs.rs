//! The product's own programs as processes of this one: `cncsim` started again with a hidden verb.
//!
//! So the demo needs nothing but its own file, and daemon and tool run as separate processes, as they do in a shop.

use std::fs::File;
use std::path::Path;
use std::process::{Child, Command, Stdio};

use anyhow::{Context, bail};

/// Runs `volcomp ARGS..` to its end and returns what it printed.
///
/// # Errors
/// It could not be started, or failed; the message holds what it said.
pub fn volcomp(args: &[&str]) -> anyhow::Result<String> {
    let output = this_program()?.arg("volcomp").args(args).stdin(Stdio::null()).output()?;
    if !output.status.success() {
        bail!("volcomp {}: {}", args.join(" "), String::from_utf8_lossy(&output.stderr).trim_end());
    }
    Ok(String::from_utf8_lossy(&output.stdout).into_owned())
}

/// A running daemon; it is ended when this is dropped.
#[derive(Debug)]
pub struct Daemon {
    child: Child,
}

impl Daemon {
    /// Starts `volcompd --config FILE`, its log going to a file.
    ///
    /// # Errors
    /// It could not be started.
    pub fn start(config: &Path, log: &Path) -> anyhow::Result<Self> {
        let log = File::options()
            .create(true)
            .append(true)
            .open(log)
            .with_context(|| format!("cannot write {}", log.display()))?;
        let child = this_program()?
            .arg("volcompd")
            .arg("--config")
            .arg(config)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(log)
            .spawn()
            .context("cannot start the daemon")?;
        Ok(Self { child })
    }

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

fn this_program() -> anyhow::Result<Command> {
    // tests name the program; otherwise this is it
    match std::env::var_os("VOLCOMP_CNCSIM") {
        Some(path) => Ok(Command::new(path)),
        None => Ok(Command::new(std::env::current_exe().context("cannot find this program's own file")?)),
    }
}
