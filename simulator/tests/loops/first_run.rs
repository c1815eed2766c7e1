//! `docs/tutorial/first-run.md`, as a new user types it.

#![expect(clippy::unwrap_used, clippy::expect_used, reason = "a test fails by panicking")]
#![expect(clippy::disallowed_methods, reason = "the test starts programs and writes files")]

use std::os::unix::fs::MetadataExt as _;
use std::os::unix::process::CommandExt as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output};
use std::time::{Duration, Instant};

/// A program that runs until the test ends.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        // already gone where it failed
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// The lines of all shells below a step, without comments behind them.
fn commands(step: usize) -> Vec<String> {
    let page = std::fs::read_to_string(root().join("docs/tutorial/first-run.md")).unwrap();
    let section = page.split("## Steps").nth(1).unwrap().split("\n## ").next().unwrap();
    let step_on = section.split(&format!("\n{step}. ")).nth(1).expect("the step");
    let step = step_on.split(&format!("\n{}. ", step + 1)).next().unwrap();
    let blocks = step.split("```sh\n").skip(1).map(|block| block.split("```").next().unwrap());
    blocks
        .flat_map(str::lines)
        .map(|l| l.split("  #").next().unwrap().trim().to_owned())
        .filter(|l| !l.is_empty())
        .collect()
}

pub(crate) fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().to_owned()
}

/// The user `nobody`: a tutorial needs no rights, and the tests may run as root.
const NOBODY: u32 = 65_534;

/// A directory with what a clone has in it, and the programs on the path of an ordinary user.
pub(crate) struct Clone {
    pub(crate) folder: tempfile::TempDir,
    port: u16,
    as_root: bool,
}

impl Clone {
    pub(crate) fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let free = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
        let as_root = folder.path().metadata().unwrap().uid() == 0;
        let clone = Self { port: free.local_addr().unwrap().port(), folder, as_root: false };
        let programs = Path::new(env!("CARGO_BIN_EXE_cncsim")).parent().unwrap().display();
        // copies: the clone itself may lie where others may not look
        clone.run(&format!("cp -r {}/config .", root().display()));
        clone.run(&format!("mkdir bin && cp {programs}/cncsim {programs}/volcomp {programs}/volcompd bin"));
        if as_root {
            clone.run(&format!("chown -R {NOBODY}:{NOBODY} ."));
        }
        Self { as_root, ..clone }
    }

    fn shell(&self, line: &str) -> Command {
        let folder = self.folder.path();
        let path = format!("{}/bin:{}", folder.display(), std::env::var("PATH").unwrap());
        let mut command = Command::new("sh");
        // a process of its own, so that it can be killed
        command.args(["-c", line]).current_dir(folder).env("PATH", path);
        if self.as_root {
            command.uid(NOBODY).gid(NOBODY);
        }
        command
    }

    pub(crate) fn run(&self, line: &str) -> Output {
        let output = self.shell(line).output().unwrap();
        assert!(output.status.success(), "{line}\n{}", String::from_utf8_lossy(&output.stderr));
        output
    }

    /// Gives a machine file a port that is free here: the usual one may be in use.
    pub(crate) fn move_port(&self, machine: &str) {
        self.run(&format!("sed -i 's/127.0.0.1:7878/127.0.0.1:{}/' {machine}", self.port));
    }

    fn start(&self, line: &str) -> Running {
        Running(self.shell(&format!("exec {line}")).spawn().unwrap())
    }
}

#[test]
fn the_three_steps_lead_to_a_compensated_machine() {
    let _processors = crate::processors();
    let clone = Clone::new();
    for line in commands(1).iter().chain(&commands(2)) {
        clone.run(line);
    }
    let mut running = Vec::new();
    let mut status = String::new();
    for line in commands(3) {
        if line.starts_with("cncsim serve") {
            // the control's usual port may be in use here
            running.push(clone.start(&format!("{line} --listen 127.0.0.1:{}", clone.port)));
        } else if line.starts_with("volcompd ") {
            clone.move_port("my-machine/machine.toml");
            running.push(clone.start(&line));
            let deadline = Instant::now() + Duration::from_secs(20);
            while !clone.folder.path().join("my-machine/volcompd.sock").exists() {
                assert!(Instant::now() < deadline, "no status socket");
                std::thread::sleep(Duration::from_millis(50));
            }
        } else if line.starts_with("volcomp status") {
            let deadline = Instant::now() + Duration::from_secs(30);
            while !status.contains("active (compensation enabled)") {
                assert!(Instant::now() < deadline, "{status}");
                std::thread::sleep(Duration::from_millis(200));
                // exit code 1: late cycles on a busy computer
                status = String::from_utf8(clone.shell(&line).output().unwrap().stdout).unwrap();
            }
        } else {
            clone.run(&line);
        }
    }
    assert_eq!(running.len(), 2, "control and daemon");
    // the model of the example, not what the second step left behind
    assert!(status.contains("21 of 21 error motions"), "{status}");
}
