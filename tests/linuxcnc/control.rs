//! LinuxCNC itself: built, started, homed and driven through linuxcncrsh.

use std::fs;
use std::io::{BufRead, BufReader, Write};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use tempfile::TempDir;

use crate::namespaces::run;
use crate::trace::Trace;

/// Longest wait for anything LinuxCNC does; the circle takes 19 s.
const PATIENCE: Duration = Duration::from_secs(90);
const MODULES: &str = "/usr/lib/linuxcnc/modules";
/// LinuxCNC's real-time part refuses to run as root.
const NOBODY: &str = "65534";

/// Where the correction is added.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Wiring {
    /// By the motion controller.
    ExternalOffsets,
    /// Behind it.
    Injection,
}

impl Wiring {
    pub(crate) const fn ini(self) -> &'static str {
        match self {
            Self::ExternalOffsets => "eoffset.ini",
            Self::Injection => "inject.ini",
        }
    }

    pub(crate) const fn example(self) -> &'static str {
        match self {
            Self::ExternalOffsets => "config/examples/linuxcnc",
            Self::Injection => "config/examples/linuxcnc-inject",
        }
    }
}

/// A line to linuxcncrsh: strictly one answer at a time.
pub(crate) struct Rsh {
    stream: TcpStream,
    answers: BufReader<TcpStream>,
}

impl Rsh {
    /// `None` where nothing listens in time. `wait` is when a command is answered: `received` or `done`.
    pub(crate) fn connect(wait: &str) -> Option<Self> {
        let stream = connect(5007)?;
        let answers = BufReader::new(stream.try_clone().expect("socket"));
        let mut rsh = Self { stream, answers };
        rsh.say("hello EMC test 1.0");
        for line in ["set verbose on", "set echo off", "set enable EMCTOO"] {
            rsh.say(line);
        }
        rsh.say(&format!("set set_wait {wait}"));
        Some(rsh)
    }

    /// Sends a line; gives its answer.
    pub(crate) fn say(&mut self, line: &str) -> String {
        self.stream.write_all(format!("{line}\r\n").as_bytes()).expect("linuxcncrsh takes a line");
        loop {
            let mut answer = String::new();
            self.answers.read_line(&mut answer).expect("linuxcncrsh answers");
            assert!(!answer.is_empty(), "linuxcncrsh is gone");
            let answer = answer.trim();
            if !answer.is_empty() && answer != line {
                return answer.to_owned();
            }
        }
    }

    /// A command that must be carried out.
    pub(crate) fn order(&mut self, line: &str) {
        let answer = self.say(line);
        assert!(answer.contains("ACK"), "{line}: {answer}");
    }
}

/// A running LinuxCNC, homed and ready for commands.
pub(crate) struct Cnc {
    pub(crate) dir: TempDir,
    rsh: Rsh,
    recorder: Child,
    linuxcnc: Child,
}

impl Cnc {
    /// Starts LinuxCNC with bridge and plant, and homes it. `adapt` may change any file of the machine first.
    pub(crate) fn start(wiring: Wiring, adapt: impl FnOnce(&Path)) -> Self {
        let dir = tempfile::tempdir().expect("directory");
        let machine = dir.path().join("sim");
        install(dir.path());
        adapt(&machine);
        run("chmod", &["-R", "a+rwX", &text(dir.path())]);
        let log = fs::File::create(dir.path().join("linuxcnc.log")).expect("log");
        // with the right to real-time priority, so that what else the computer does costs no cycles
        let linuxcnc = Command::new("setsid")
            .args(["setpriv", "--reuid", NOBODY, "--regid", NOBODY, "--clear-groups"])
            .args(["--inh-caps=+sys_nice,+ipc_lock", "--ambient-caps=+sys_nice,+ipc_lock"])
            .args(["env", "-i", "PATH=/usr/sbin:/usr/bin:/sbin:/bin"])
            .arg(format!("HOME={}", text(dir.path())))
            .args(["linuxcnc", "-r", wiring.ini()])
            .current_dir(&machine)
            .stdin(Stdio::null())
            .stdout(log.try_clone().expect("log"))
            .stderr(log)
            .spawn()
            .expect("LinuxCNC starts");
        let Some(rsh) = Rsh::connect("done") else {
            panic!(
                "LinuxCNC did not start:\n{}",
                fs::read_to_string(dir.path().join("linuxcnc.log")).unwrap_or_default()
            );
        };
        let records = fs::File::create(dir.path().join("records")).expect("records");
        let recorder = Command::new("halsampler")
            .args(["-c", "1", "-t"])
            .stdin(Stdio::null())
            .stdout(records)
            .spawn()
            .expect("halsampler starts");
        hurry("rtapi_app");
        let mut cnc = Self { dir, rsh, recorder, linuxcnc };
        cnc.home();
        cnc
    }

    fn home(&mut self) {
        self.machine_on();
        self.order("set mode manual");
        self.order("set home -1");
        self.wait_for("homed", |cnc| cnc.say("get joint_homed").contains("YES YES YES"));
        self.order("set mode mdi");
    }

    /// Emergency stop released, drives on.
    pub(crate) fn machine_on(&mut self) {
        // one connection at a time may command, and a second panel may have taken that
        self.say("set enable EMCTOO");
        // right after something was broken off linuxcncrsh may refuse, and takes the order all the same
        self.wait_for("out of emergency stop", |cnc| {
            cnc.say("set estop off");
            cnc.say("get estop").contains("OFF")
        });
        self.wait_for("on", |cnc| {
            cnc.say("set machine on");
            cnc.say("get machine").contains("ON")
        });
    }

    pub(crate) fn say(&mut self, line: &str) -> String {
        self.rsh.say(line)
    }

    pub(crate) fn order(&mut self, line: &str) {
        self.rsh.order(line);
    }

    /// A line of G-code, to its end.
    pub(crate) fn mdi(&mut self, code: &str) {
        self.order(&format!("set mdi {code}"));
    }

    /// A line of G-code that takes a while, and what happens meanwhile, from `after` into it.
    pub(crate) fn mdi_while(&mut self, code: &str, after: Duration, what: impl FnOnce(&Self)) {
        let line = format!("set mdi {code}");
        self.rsh.stream.write_all(format!("{line}\r\n").as_bytes()).expect("linuxcncrsh takes a line");
        std::thread::sleep(after);
        what(self);
        // done, or broken off by what happened
        let mut answer = String::new();
        while answer.trim().is_empty() || answer.trim() == line {
            answer.clear();
            self.rsh.answers.read_line(&mut answer).expect("linuxcncrsh answers");
        }
    }

    /// A part program, from its first line to its end.
    pub(crate) fn run_program(&mut self, text: &str, longest: Duration) {
        let file = self.dir.path().join("program.ngc");
        fs::write(&file, text).expect("part program");
        self.order("set mode auto");
        self.order(&format!("set open {}", file.display()));
        // the answer to the command does not wait for the end of the program
        self.order("set set_wait received");
        self.order("set run");
        let deadline = Instant::now() + longest;
        let mut running = false;
        loop {
            std::thread::sleep(Duration::from_millis(200));
            let idle = self.say("get program_status").contains("IDLE");
            if idle && running {
                break;
            }
            running |= !idle;
            assert!(Instant::now() < deadline, "the part program does not end:\n{}", self.log());
        }
        self.order("set set_wait done");
        self.order("set mode mdi");
    }

    /// The rows recorded from now on carry this number.
    pub(crate) fn mark(&self, number: i32) {
        run("halcmd", &["sets", "mark", &number.to_string()]);
    }

    /// The value of a pin, a parameter or a signal.
    pub(crate) fn pin(&self, name: &str) -> String {
        run("halcmd", &["getp", name])
    }

    pub(crate) fn wait_for(&mut self, what: &str, mut condition: impl FnMut(&mut Self) -> bool) {
        let deadline = Instant::now() + PATIENCE;
        while !condition(self) {
            assert!(Instant::now() < deadline, "never {what}:\n{}", self.log());
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// Everything recorded so far.
    pub(crate) fn trace(&self) -> Trace {
        // what the servo thread has just written reaches the file within a moment
        std::thread::sleep(Duration::from_millis(500));
        Trace::read(&self.dir.path().join("records"))
    }

    pub(crate) fn log(&self) -> String {
        fs::read_to_string(self.dir.path().join("linuxcnc.log")).unwrap_or_default()
    }
}

impl Drop for Cnc {
    fn drop(&mut self) {
        // the next one in this namespace finds everything as it was; at its end the namespace takes what is left
        let _ = self.rsh.stream.write_all(b"shutdown\r\n");
        let _ = self.recorder.kill();
        let _ = self.recorder.wait();
        let deadline = Instant::now() + Duration::from_secs(20);
        while matches!(self.linuxcnc.try_wait(), Ok(None)) && Instant::now() < deadline {
            std::thread::sleep(Duration::from_millis(50));
        }
        let _ = self.linuxcnc.kill();
        let _ = self.linuxcnc.wait();
        let _ = Command::new("umount").args(["--lazy", MODULES]).status();
        if std::thread::panicking() {
            println!("log of LinuxCNC:\n{}", self.log());
        }
    }
}

fn text(path: &Path) -> String {
    path.to_string_lossy().into_owned()
}

fn connect(port: u16) -> Option<TcpStream> {
    let deadline = Instant::now() + PATIENCE;
    while Instant::now() < deadline {
        if let Ok(stream) = TcpStream::connect(("127.0.0.1", port)) {
            stream.set_read_timeout(Some(PATIENCE)).expect("option");
            stream.set_nodelay(true).expect("option");
            return Some(stream);
        }
        std::thread::sleep(Duration::from_millis(100));
    }
    None
}

/// Real-time priority for LinuxCNC's servo thread, which takes it by itself only on a real-time kernel.
fn hurry(program: &str) {
    for process in fs::read_dir("/proc").expect("/proc").flatten() {
        let name = fs::read_to_string(process.path().join("comm")).unwrap_or_default();
        if name.trim() == program {
            let id = text(Path::new(&process.file_name()));
            // refused where the test may not: then a busy computer costs cycles
            let _ = Command::new("chrt").args(["--all-tasks", "--fifo", "--pid", "50", &id]).status();
        }
    }
}

/// Names the folder with what [`compile`] made, inside the namespaces.
pub(crate) const COMPILED: &str = "VOLCOMP_LINUXCNC_COMPILED";

/// Components that simulate the machine.
const MACHINES: [&str; 2] = ["volcomp_plant", "withheld_machine"];

/// The adapter compiled as its README says, and the simulated machines; once for all tests.
pub(crate) fn compile() -> &'static Path {
    static COMPILED: OnceLock<PathBuf> = OnceLock::new();
    COMPILED.get_or_init(|| {
        let dir = Path::new(env!("CARGO_TARGET_TMPDIR")).join("linuxcnc");
        let _ = fs::remove_dir_all(&dir);
        fs::create_dir_all(&dir).expect("directory");
        let adapter = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("adapters/linuxcnc");
        run("cp", &["-r", &format!("{}/.", text(&adapter)), &text(&dir)]);
        let source = fs::read_to_string(adapter.join("README.md")).expect("README");
        let line =
            source.lines().find(|l| l.trim_start().starts_with("gcc ")).expect("README has the build line");
        run("sh", &["-c", &format!("cd '{}' && {line} -Werror", text(&dir))]);
        let machine = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/linuxcnc/withheld/withheld_machine.comp");
        run("cp", &[machine, &text(&dir.join("sim"))]);
        for component in MACHINES {
            let compile = format!("cd '{}' && halcompile --compile sim/{component}.comp", text(&dir));
            run("sh", &["-c", &compile]);
        }
        dir
    })
}

/// Puts a copy of what was compiled into `dir`, the machines beside LinuxCNC's own modules.
fn install(dir: &Path) {
    let compiled = std::env::var(COMPILED).expect("named by the test that started this one");
    run("cp", &["-r", &format!("{compiled}/."), &text(dir)]);
    // a private copy of the modules: nothing is installed outside this namespace
    let modules = dir.join("modules");
    run("cp", &["-r", MODULES, &text(&modules)]);
    for component in MACHINES {
        let module = format!("{component}.so");
        let places = [dir.join(&module), dir.join("sim").join(&module)];
        let made = places.iter().find(|p| p.exists()).expect("halcompile made the component");
        fs::copy(made, modules.join(module)).expect("copied");
    }
    run("mount", &["--bind", &text(&modules), MODULES]);
}
