//! The program `cncsim` as a user meets it: output, messages, exit codes.

#![expect(clippy::disallowed_methods, reason = "the test runs the program on files")]
#![expect(clippy::unwrap_used, reason = "helpers of tests")]

use std::path::Path;
use std::process::{Command, Output};

fn cncsim(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_cncsim")).args(args).output().unwrap()
}

fn fails(args: &[&str], code: i32, says: &str) {
    let out = cncsim(args);
    let message = String::from_utf8_lossy(&out.stderr).into_owned();
    assert_eq!(out.status.code(), Some(code), "{args:?}: {message}");
    assert!(message.contains(says), "{args:?}: {message}");
    assert!(out.stdout.is_empty(), "{args:?}: data on stdout");
}

fn file(dir: &Path, name: &str, text: &str) -> String {
    let path = dir.join(name);
    std::fs::write(&path, text).unwrap();
    path.to_str().unwrap().to_owned()
}

fn contents(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap()
}

#[test]
fn help_is_there_and_says_what_units_are() {
    for args in [&["--help"][..], &["serve", "--help"], &["replay", "--help"], &["path", "circle", "--help"]]
    {
        let out = cncsim(args);
        assert_eq!(out.status.code(), Some(0));
        assert!(!out.stdout.is_empty());
    }
    let help = String::from_utf8(cncsim(&["path", "circle", "--help"]).stdout).unwrap();
    assert!(help.contains("mm/min"));
}

#[test]
fn every_path_is_a_program_that_runs() {
    let dir = tempfile::tempdir().unwrap();
    for kind in ["circle", "rectangle", "s-path", "cone"] {
        let text = String::from_utf8(cncsim(&["path", kind, "--feed", "20000"]).stdout).unwrap();
        assert!(text.contains("(SCORE ON)") && text.ends_with("M30\n"), "{kind}");
        let program = file(dir.path(), kind, &text);
        let out = cncsim(&[
            "serve",
            "--program",
            &program,
            "--listen",
            "127.0.0.1:0",
            "--as-fast-as-possible",
            "--settle-s",
            "0",
            "--cycle-ms",
            "4",
        ]);
        let message = String::from_utf8_lossy(&out.stderr).into_owned();
        assert_eq!(out.status.code(), Some(0), "{kind}: {message}");
        assert!(message.contains("listening on 127.0.0.1:") && message.contains("cycles"), "{message}");
    }
}

#[test]
fn the_same_seed_writes_the_same_bytes() {
    let dir = tempfile::tempdir().unwrap();
    let program = file(dir.path(), "p.nc", "F6000 G1 X435\nG2 X435 Y250 I5 J0\n");
    let trace = |name: &str, seed: &str| {
        let out = dir.path().join(name);
        let run = cncsim(&[
            "serve",
            "--program",
            &program,
            "--listen",
            "127.0.0.1:0",
            "--as-fast-as-possible",
            "--settle-s",
            "0.01",
            "--seed",
            seed,
            "--out",
            out.to_str().unwrap(),
        ]);
        assert_eq!(run.status.code(), Some(0), "{}", String::from_utf8_lossy(&run.stderr));
        contents(&out)
    };
    let (a, b, c) = (trace("a", "1"), trace("b", "1"), trace("c", "2"));
    assert_eq!(a, b);
    assert_ne!(a, c);
    assert!(a.lines().count() > 500);
}

#[test]
fn the_shipped_recording_replays() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("trace.csv");
    let run = cncsim(&[
        "replay",
        "--listen",
        "127.0.0.1:0",
        "--as-fast-as-possible",
        "--cycle-ms",
        "2",
        "--settle-s",
        "0",
        "--out",
        out.to_str().unwrap(),
    ]);
    assert_eq!(run.status.code(), Some(0), "{}", String::from_utf8_lossy(&run.stderr));
    let text = contents(&out);
    let scored = text.lines().skip(1).filter(|l| l.split(',').nth(4) == Some("1")).count();
    assert_eq!(scored, 3818);
}

#[test]
fn mistakes_have_their_exit_code_and_place() {
    let dir = tempfile::tempdir().unwrap();
    let bad = file(dir.path(), "bad.nc", "G1 X5 F100\nG1 X10 B4\n");
    let toml = file(dir.path(), "bad.toml", "format = \"volcomp-truth/1\"\nmachin = 3\n");
    let replay = file(dir.path(), "replay.toml", "format = \"cncsim-replay/1\"\nfile = 3\n");
    let lost = dir.path().join("none.nc");
    fails(&[], 64, "Usage");
    fails(&["serve", "--cycle-ms", "abc"], 64, "invalid value");
    fails(&["serve", "--cycle-ms", "20", "--listen", "127.0.0.1:0"], 64, "0.25 to 10 ms");
    fails(&["serve", "--delay-cycles", "0", "--listen", "127.0.0.1:0"], 64, "1 to 1000 cycles");
    fails(&["path", "circle", "--radius-mm", "-5"], 64, "");
    fails(&["path", "circle", "--centre-mm", "1,2"], 64, "three");
    fails(&["serve", "--program", &bad], 65, "bad.nc: line 2, column 8: axis B is not on this machine");
    fails(&["serve", "--program", lost.to_str().unwrap()], 74, "none.nc");
    fails(&["serve", "--machine", &toml], 78, "bad.toml");
    fails(&["replay", "--recording", &replay], 78, "line 2, column");
    let taken = std::net::TcpListener::from(taken_socket());
    let address = taken.local_addr().unwrap().to_string();
    fails(&["serve", "--listen", &address], 74, "in use");
}

fn taken_socket() -> socket2::Socket {
    let socket = socket2::Socket::new(socket2::Domain::IPV4, socket2::Type::STREAM, None).unwrap();
    socket.bind(&std::net::SocketAddr::from(([127, 0, 0, 1], 0)).into()).unwrap();
    socket.listen(1).unwrap();
    socket
}
