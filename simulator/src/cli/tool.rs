//! `volcomp` as a process of its own: the simulator's programs ask it and share no code with it.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use super::{EX_DATAERR, EX_SOFTWARE, EX_USAGE, Failure};

/// The tool as a process.
pub(super) struct Tool {
    program: PathBuf,
    verb: Option<&'static str>,
}

impl Tool {
    /// A program that was named, or the one inside this program.
    pub(super) fn new(named: Option<&Path>) -> Result<Self, Failure> {
        Ok(match named {
            // it may run in another folder
            Some(path) => Self {
                program: path.canonicalize().map_err(|e| Failure::in_file(EX_USAGE, path, e))?,
                verb: None,
            },
            None => Self {
                program: std::env::current_exe().map_err(|e| Failure::new(EX_SOFTWARE, e))?,
                verb: Some("volcomp"),
            },
        })
    }

    /// Runs a verb in a folder to its end; gives what it printed. A failure tells what it said.
    #[expect(clippy::disallowed_methods, reason = "the tool is a program of its own")]
    pub(super) fn run(&self, folder: &Path, arguments: &[String]) -> Result<String, Failure> {
        let output = Command::new(&self.program)
            .args(self.verb)
            .args(arguments)
            .current_dir(folder)
            .stdin(Stdio::null())
            .output()
            .map_err(|e| Failure::in_file(EX_SOFTWARE, &self.program, e))?;
        if !output.status.success() {
            let said = String::from_utf8_lossy(&output.stderr);
            // what the tool refuses is an answer, too
            let refused = output.status.code() == Some(i32::from(EX_DATAERR));
            let code = if refused { EX_DATAERR } else { EX_SOFTWARE };
            return Err(Failure::new(code, format_args!("{}: {}", folder.display(), said.trim_end())));
        }
        Ok(String::from_utf8_lossy(&output.stdout).into_owned())
    }
}
