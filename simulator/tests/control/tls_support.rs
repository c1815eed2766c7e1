//! A control, a daemon as a process, and the certificates between them.

#![expect(clippy::disallowed_methods, reason = "helpers of tests with processes, sockets and files")]
#![expect(clippy::unwrap_used, reason = "helpers of tests")]

use std::cell::RefCell;
use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::rc::Rc;
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process};
use simulator::certificates::{Authority, Issued, Role, Validity};
use simulator::control::{Control, ControlConfig, ControlIdentity, Flow, IdealMachine, LinkEvent, Pacing};
use simulator::motion::MachineAxes;
use tempfile::TempDir;

pub(crate) const CNCSIM: &str = env!("CARGO_BIN_EXE_cncsim");
pub(crate) const PATIENCE: Duration = Duration::from_secs(20);

const MODEL: &str = "format = \"volcomp-model/1\"\nmachine = \"tls-mill\"\nchain = \"[w X' b Y Z t]\"\n\
    [errors.exx.constant]\nvalue-um = 10.0\n";
/// Offset of X that takes the model's error out, mm.
pub(crate) const OFFSET_MM: f64 = -0.010;

/// A folder with the daemon's files and certificates.
pub(crate) struct Folder {
    pub(crate) dir: TempDir,
    pub(crate) authority: Authority,
}

impl Folder {
    /// With `ca`, `control` and `daemon` of one authority, valid and for loopback.
    pub(crate) fn new() -> Self {
        let dir = tempfile::tempdir().unwrap();
        let authority = Authority::new("test", Validity::days(2)).unwrap();
        let folder = Self { dir, authority };
        folder.keep("ca", &folder.authority.own());
        folder.keep("control", &folder.issue(Role::Control, "127.0.0.1", Validity::days(1)));
        folder.keep("daemon", &folder.issue(Role::Daemon, "volcompd", Validity::days(1)));
        folder
    }

    pub(crate) fn issue(&self, role: Role, name: &str, validity: Validity) -> Issued {
        self.authority.issue(role, &[name], validity).unwrap()
    }

    /// Writes `stem.pem` and `stem.key`.
    pub(crate) fn keep(&self, stem: &str, issued: &Issued) {
        fs::write(self.path(&format!("{stem}.pem")), &issued.certificate).unwrap();
        fs::write(self.path(&format!("{stem}.key")), &issued.key).unwrap();
        self.mode(&format!("{stem}.key"), 0o600);
    }

    pub(crate) fn mode(&self, name: &str, mode: u32) {
        fs::set_permissions(self.path(name), fs::Permissions::from_mode(mode)).unwrap();
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    pub(crate) fn text(&self, name: &str) -> String {
        fs::read_to_string(self.path(name)).unwrap()
    }

    /// What the control of this folder shows and trusts.
    pub(crate) fn control_identity(&self) -> ControlIdentity {
        ControlIdentity::from_files(
            &self.path("ca.pem"),
            &self.path("control.pem"),
            &self.path("control.key"),
        )
        .unwrap()
    }

    /// The machine file and its model; `tls` are the lines of `[link.tls]`, where there are any.
    pub(crate) fn machine_file(&self, address: &str, tls: &str) -> PathBuf {
        let tls = if tls.is_empty() { String::new() } else { format!("[link.tls]\n{tls}\n") };
        let socket = self.path("sock").display().to_string();
        let state = self.path("state").display().to_string();
        let limits = "limit-um = 150.0\nrate-um-per-s = 2000.0\nacceleration-um-per-s2 = 40000.0\n";
        let text = format!(
            "format = \"volcomp-machine/1\"\nmachine = \"tls-mill\"\nmodel = \"model.toml\"\n\
             [link]\naddress = \"{address}\"\nconnect-timeout-s = 1.0\nreconnect-min-s = 0.05\nreconnect-max-s = 0.2\n\
             {tls}[engine]\nstart = \"on-connect\"\nramp-s = 0.1\nstale-ms = 5000.0\n\
             [axes.x]\n{limits}[axes.y]\n{limits}[axes.z]\n{limits}\
             [realtime]\npriority = 0\nlock-memory = false\n[status]\nsocket = \"{socket}\"\n\
             [state]\ndirectory = \"{state}\"\n[recording]\ndirectory = \"{state}/recordings\"\n\
             [log]\ntarget = \"stderr\"\nlevel = \"trace\"\n"
        );
        fs::write(self.path("model.toml"), MODEL).unwrap();
        fs::write(self.path("machine.toml"), text).unwrap();
        self.path("machine.toml")
    }

    /// Starts the daemon on the machine file that was written last.
    pub(crate) fn daemon(&self) -> Daemon {
        let log = fs::File::options().create(true).append(true).open(self.path("log")).unwrap();
        let child = Command::new(CNCSIM)
            .args(["volcompd", "--config"])
            .arg(self.path("machine.toml"))
            .env_remove("NOTIFY_SOCKET")
            .stdout(Stdio::null())
            .stderr(log)
            .spawn()
            .unwrap();
        Daemon { child, log: self.path("log") }
    }

    /// `volcomp ARGUMENTS`.
    pub(crate) fn volcomp(&self, arguments: &[&str]) -> Output {
        Command::new(CNCSIM).arg("volcomp").args(arguments).current_dir(self.dir.path()).output().unwrap()
    }
}

/// The lines of `[link.tls]` for the usual files.
pub(crate) const TLS: &str = "ca = \"ca.pem\"\ncertificate = \"daemon.pem\"\nkey = \"daemon.key\"";

/// A running daemon; killed when dropped.
pub(crate) struct Daemon {
    child: Child,
    log: PathBuf,
}

impl Daemon {
    pub(crate) fn log(&self) -> String {
        fs::read_to_string(&self.log).unwrap()
    }

    pub(crate) fn terminate(&self) {
        kill_process(Pid::from_child(&self.child), Signal::TERM).unwrap();
    }

    /// Its exit code, within the time that anybody has.
    pub(crate) fn wait(&mut self) -> Option<i32> {
        let deadline = Instant::now() + PATIENCE;
        loop {
            if let Some(status) = self.child.try_wait().unwrap() {
                return status.code();
            }
            assert!(Instant::now() < deadline, "the daemon did not end:\n{}", self.log());
            std::thread::sleep(Duration::from_millis(5));
        }
    }
}

impl Drop for Daemon {
    fn drop(&mut self) {
        // already gone where the test ended it
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// A control and what it noticed.
pub(crate) struct Machine {
    pub(crate) control: Control,
    pub(crate) events: Rc<RefCell<Vec<LinkEvent>>>,
}

impl Machine {
    pub(crate) fn new(edit: impl FnOnce(&mut ControlConfig)) -> Self {
        let axes = MachineAxes::three_axis([0.0, 850.0], [0.0, 500.0], [-500.0, 0.0]).unwrap();
        let start = axes.middle();
        let mut config = ControlConfig::new("tls-mill", axes);
        config.listen = ([127, 0, 0, 1], 0).into();
        config.pacing = Pacing::LockStep { answer_timeout: PATIENCE, absent: Default::default() };
        edit(&mut config);
        let mut control = Control::bind(config).unwrap();
        control.set_position(start);
        let events = Rc::new(RefCell::new(Vec::new()));
        let heard = Rc::clone(&events);
        control.set_listener(move |event| heard.borrow_mut().push(event.clone()));
        Self { control, events }
    }

    pub(crate) fn address(&self) -> String {
        self.control.address().to_string()
    }

    /// Everything it noticed, in words.
    pub(crate) fn said(&self) -> String {
        self.events.borrow().iter().map(|e| format!("{e}\n")).collect()
    }

    /// Cycles until X has the offset that is due.
    pub(crate) fn until_corrected(&mut self) -> bool {
        let mut reached = false;
        let mut observer = |r: &simulator::control::CycleRecord| {
            reached = (r.applied[0] - OFFSET_MM).abs() < 1e-6;
            Ok(if reached { Flow::Stop } else { Flow::GoOn })
        };
        self.control.run_until(&mut IdealMachine, 5.0, &mut observer).unwrap();
        reached
    }

    /// Keeps the control alive until both ends have said what they should.
    pub(crate) fn expect(&mut self, daemon: &Daemon, daemon_says: &str, control_says: &str) {
        let deadline = Instant::now() + PATIENCE;
        loop {
            self.control.idle(Duration::from_millis(20));
            let (log, said) = (daemon.log(), self.said());
            if log.contains(daemon_says) && said.contains(control_says) {
                assert!(!said.contains("daemon connected"), "{said}");
                return;
            }
            assert!(
                Instant::now() < deadline,
                "expected of the daemon: {daemon_says}\n{log}\nexpected of the control: {control_says}\n{said}"
            );
        }
    }
}

/// Every file below a folder: those that hold a private key, and the others.
pub(crate) fn keys_and_others(dir: &Path) -> (Vec<PathBuf>, Vec<PathBuf>) {
    let (mut files, mut open) = (Vec::new(), vec![dir.to_owned()]);
    while let Some(dir) = open.pop() {
        for path in fs::read_dir(dir).unwrap().map(|e| e.unwrap().path()) {
            if path.is_dir() { open.push(path) } else { files.push(path) }
        }
    }
    files.into_iter().partition(|p| p.extension().is_some_and(|e| e == "key"))
}
