//! LinuxCNC has fixed keys, a lock file and a port: each run gets namespaces of its own, in which the test starts itself.

use std::io::Write;
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use crate::control::{COMPILED, compile};
use crate::stalls::Stalls;

/// Set inside the namespaces.
const INSIDE: &str = "VOLCOMP_LINUXCNC_INSIDE";
const PROGRAMS: [&str; 12] = [
    "linuxcnc",
    "halcmd",
    "halsampler",
    "halcompile",
    "gcc",
    "unshare",
    "setpriv",
    "chrt",
    "pgrep",
    "pkill",
    "ip",
    "mount",
];
const UNSHARE: [&str; 7] = ["--fork", "--pid", "--kill-child", "--ipc", "--net", "--mount", "--mount-proc"];

/// A host that takes a processor away for so long disturbs a servo thread of 1 ms, its bridge and volcompd: a test that fails
/// meanwhile is repeated once. One that fails without, or that shows a value that no stall excuses, is a failure at once.
const DISTURBED: Duration = Duration::from_millis(5);
const RUNS: u32 = 2;
/// Exit code of a run in which [`must_hold`] failed.
const VIOLATED: i32 = 86;

/// Ends the run for good where a bound on a motor or an offset is exceeded: such a run is never repeated.
pub(crate) fn must_hold(holds: bool, what: std::fmt::Arguments<'_>) {
    if !holds {
        let _ = writeln!(std::io::stderr(), "violated: {what}");
        std::process::exit(VIOLATED);
    }
}

/// One machine at a time: two would take each other's processor.
static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());

/// Runs `body` in namespaces of its own.
pub(crate) fn in_namespaces(test: &str, body: impl FnOnce()) {
    if std::env::var_os(INSIDE).is_some() {
        run("ip", &["link", "set", "lo", "up"]);
        body();
        return;
    }
    if let Some(missing) = missing() {
        panic!("{missing}; see adapters/linuxcnc/README.md");
    }
    let _alone = ONE_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner);
    let compiled = compile();
    let known = Command::new(std::env::current_exe().expect("this test's own path"))
        .args(["--exact", test, "--list", "--include-ignored"])
        .output()
        .expect("this test program lists its tests");
    assert!(String::from_utf8_lossy(&known.stdout).contains(": test"), "no test has the name {test}");
    for run in 1..=RUNS {
        let stalls = Stalls::watch();
        let status = Command::new("unshare")
            .args(UNSHARE)
            .arg(std::env::current_exe().expect("this test's own path"))
            .args(["--exact", test, "--nocapture", "--include-ignored"])
            .env(INSIDE, "1")
            .env(COMPILED, compiled)
            .status()
            .expect("unshare runs");
        if status.success() {
            return;
        }
        let longest = stalls.longest();
        let what =
            format!("{test} failed inside its namespaces; a processor was away for {longest:.1?} at most");
        assert!(status.code() != Some(VIOLATED) && longest >= DISTURBED && run < RUNS, "{what}");
        // past the capture of tests: the gate lists every line that begins with `retried:`
        writeln!(std::io::stderr(), "retried: {what}").expect("stderr");
    }
}

/// What keeps LinuxCNC from being started here.
fn missing() -> Option<String> {
    let path = std::env::var("PATH").unwrap_or_default();
    let found = |name: &&str| path.split(':').any(|dir| Path::new(dir).join(name).exists());
    if let Some(name) = PROGRAMS.iter().find(|name| !found(name)) {
        return Some(format!(
            "no `{name}` (Debian: linuxcnc-uspace, linuxcnc-uspace-dev, iproute2, procps, gcc)"
        ));
    }
    let tried = Command::new("unshare").args(UNSHARE).arg("true").output();
    match tried {
        Ok(output) if output.status.success() => None,
        Ok(output) => Some(format!("no namespaces: {}", String::from_utf8_lossy(&output.stderr).trim())),
        Err(e) => Some(format!("no namespaces: {e}")),
    }
}

/// Runs a program to its end; gives what it printed.
pub(crate) fn run(program: &str, arguments: &[&str]) -> String {
    let output = Command::new(program).args(arguments).output().expect("program starts");
    let (out, err) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert!(output.status.success(), "{program} {}: {out}{err}", arguments.join(" "));
    out.trim().to_owned()
}

/// Loads a userspace component into HAL and waits until it is ready; it goes on, with streams of its own.
pub(crate) fn load_component(arguments: &[&str]) {
    let status = Command::new("halcmd")
        .args(["loadusr", "-Wn"])
        .args(arguments)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .status()
        .expect("halcmd runs");
    assert!(status.success(), "{} does not become ready", arguments.join(" "));
}
