//! The real `volcompd` beside LinuxCNC, with the files of the example.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process};
use tempfile::TempDir;

use crate::control::Wiring;

const PATIENCE: Duration = Duration::from_secs(60);

/// A running `volcompd`; killed when dropped.
pub(crate) struct Daemon {
    dir: TempDir,
    child: Child,
}

impl Daemon {
    /// With the example of a wiring, compensating as soon as the machine is ready. `adapt` may change the machine file.
    pub(crate) fn start(wiring: Wiring, adapt: impl FnOnce(String) -> String) -> Self {
        let model = Path::new(env!("CARGO_MANIFEST_DIR")).join("config/examples/linuxcnc/model.toml");
        Self::start_with(wiring, &model, adapt)
    }

    /// The same with another model.
    pub(crate) fn start_with(wiring: Wiring, model: &Path, adapt: impl FnOnce(String) -> String) -> Self {
        let dir = tempfile::tempdir().expect("directory");
        let example = Path::new(env!("CARGO_MANIFEST_DIR")).join(wiring.example());
        let text = fs::read_to_string(example.join("machine.toml")).expect("example");
        let text = text.replace("../linuxcnc/model.toml", "model.toml");
        let text = text.replace("[engine]", "[engine]\nstart = \"on-connect\"");
        let socket = dir.path().join("sock");
        let text =
            format!("{text}\n[status]\nsocket = \"{}\"\n[log]\ntarget = \"stderr\"\n", socket.display());
        fs::write(dir.path().join("machine.toml"), adapt(text)).expect("written");
        fs::copy(model, dir.path().join("model.toml")).expect("copied");
        let child = spawn(dir.path());
        Self { dir, child }
    }

    /// Gone without a word.
    pub(crate) fn kill(&mut self) {
        self.child.kill().expect("killed");
        let _ = self.child.wait();
    }

    /// Once more, in a new process.
    pub(crate) fn restart(&mut self) {
        self.child = spawn(self.dir.path());
    }

    /// Asked to stop; waits for its end.
    pub(crate) fn stop(&mut self) {
        kill_process(Pid::from_child(&self.child), Signal::TERM).expect("signal sent");
        let status = self.child.wait().expect("child");
        assert!(status.success(), "volcompd ended with {status}:\n{}", self.log());
    }

    pub(crate) fn volcomp(&self, arguments: &[&str]) -> Output {
        Command::new(program("volcomp"))
            .args(arguments)
            .arg("--socket")
            .arg(self.dir.path().join("sock"))
            .output()
            .expect("volcomp runs")
    }

    pub(crate) fn status(&self) -> serde_json::Value {
        let output = self.volcomp(&["status", "--json"]);
        serde_json::from_slice(&output.stdout).unwrap_or_default()
    }

    pub(crate) fn state(&self) -> String {
        self.status()["state"].as_str().unwrap_or_default().to_owned()
    }

    pub(crate) fn wait_for_state(&self, wanted: &str) {
        let deadline = Instant::now() + PATIENCE;
        loop {
            let state = self.state();
            if state == wanted {
                return;
            }
            // a fault stays until someone takes it back: no use in waiting
            let over = state == "faulted" || Instant::now() >= deadline;
            assert!(!over, "never {wanted}: {}\n{}", self.status(), self.log());
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    pub(crate) fn log(&self) -> String {
        fs::read_to_string(self.dir.path().join("log")).unwrap_or_default()
    }

    pub(crate) fn id(&self) -> u32 {
        self.child.id()
    }
}

impl Drop for Daemon {
    fn drop(&mut self) {
        // already gone where the test ended it
        let _ = self.child.kill();
        let _ = self.child.wait();
        if std::thread::panicking() {
            println!("log of volcompd:\n{}", self.log());
        }
    }
}

/// The program under test: that of this build, or of the folder in `VOLCOMP_LINUXCNC_PROGRAMS` (a release build).
pub(crate) fn program(name: &str) -> PathBuf {
    match (std::env::var_os("VOLCOMP_LINUXCNC_PROGRAMS"), name) {
        (Some(folder), _) => PathBuf::from(folder).join(name),
        (None, "volcompd") => PathBuf::from(env!("CARGO_BIN_EXE_volcompd")),
        (None, _) => PathBuf::from(env!("CARGO_BIN_EXE_volcomp")),
    }
}

fn spawn(dir: &Path) -> Child {
    let log = fs::File::options().create(true).append(true).open(dir.join("log")).expect("log");
    Command::new(program("volcompd"))
        .arg("--config")
        .arg(dir.join("machine.toml"))
        .env_remove("STATE_DIRECTORY")
        .env_remove("NOTIFY_SOCKET")
        .env_remove("WATCHDOG_USEC")
        .env_remove("WATCHDOG_PID")
        .stdout(Stdio::null())
        .stderr(log)
        .spawn()
        .expect("volcompd starts")
}
