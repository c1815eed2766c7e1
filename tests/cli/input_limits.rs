//! Every command form that reads a file refuses one without an end, in bounded memory and with a message that names
//! the file. The forms come from the command tree, so that a new one cannot be forgotten.

#![expect(
    clippy::expect_used,
    clippy::disallowed_methods,
    reason = "a test of processes and files, which stops where its own set-up is wrong"
)]

use std::collections::BTreeSet;
use std::fs::{self, File};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::thread;
use std::time::Duration;

use rustix::fs::{CWD, FileType, Mode};
use volcomp::cli::input::InputKind;

/// Address space of the program under test, KiB.
const MEMORY_KIB: u64 = 2 << 20;

/// Command, argument, and command line of each form that reads a file: `{}` is that file. `{name}` is one of the files
/// of [`Stage`]. An empty line: the argument only names a file that another argument reads.
const INPUTS: &[(&str, &str, &str)] = &[
    ("bench", "config", "bench --config {}"),
    ("check", "files", "check {}"),
    ("predict", "model", "predict --model {} --points {points} --out {out}"),
    ("predict", "add", "predict --model {model} --add {} --points {points} --out {out}"),
    ("predict", "points", "predict --model {model} --points {} --out {out}"),
    ("predict", "circle", "predict --model {model} --circle {} --centre-mm 100,100,-100 --radius-mm 50"),
    ("correct", "model", "correct --model {} --gcode {program} --out {out}"),
    ("correct", "gcode", "correct --model {model} --gcode {} --out {out}"),
    ("fit", "errors", "fit --axis x --errors {} --out {out}"),
    ("fit", "into", "fit --axis x --errors {motion} --screw-pitch-mm none --into {}"),
    ("fit thermal", "file", "fit thermal {} --displacement z_um"),
    (
        "fit thermal",
        "into",
        "fit thermal {warmth} --displacement z_um --name spindle-z --symbol ezz --limit-um 80 --into {}",
    ),
    ("identify threepoint", "input", "identify threepoint --input {}"),
    (
        "identify threepoint",
        "data",
        "identify threepoint --axis x --points {carriage} --data {} --noise-um 1 --motions {out}",
    ),
    (
        "identify threepoint",
        "points",
        "identify threepoint --axis x --points {} --data {motion} --noise-um 1 --motions {out}",
    ),
    (
        "identify threepoint",
        "registration",
        "identify threepoint --axis x --points {carriage} --data {motion} --registration {} --noise-um 1 --motions {out}",
    ),
    ("identify threepoint", "into", ""),
    ("identify nineline", "input", "identify nineline --input {}"),
    (
        "identify nineline",
        "data",
        "identify nineline --axis x --lines {lines} --data {} --noise-um 1 --motions {out}",
    ),
    (
        "identify nineline",
        "lines",
        "identify nineline --axis x --lines {} --data {motion} --noise-um 1 --motions {out}",
    ),
    ("identify nineline", "compare", ""),
    ("identify nineline", "into", ""),
    ("identify fivedof", "input", "identify fivedof --input {}"),
    ("identify fivedof", "data", "identify fivedof --axis x --data {} --calibration {head} --out {out}"),
    (
        "identify fivedof",
        "resting",
        "identify fivedof --axis x --resting {} --calibration {head} --write-calibration {out}",
    ),
    (
        "identify fivedof",
        "calibration",
        "identify fivedof --axis x --data {motion} --calibration {} --out {out}",
    ),
    ("identify fivedof", "into", ""),
    ("identify straightness", "input", "identify straightness --input {}"),
    ("identify straightness", "data", "identify straightness --axis x --data {} --out {out}"),
    (
        "identify straightness",
        "signs",
        "identify straightness --axis x --data {motion} --signs {} --out {out}",
    ),
    (
        "identify straightness",
        "tilt_test",
        "identify straightness --axis x --data {motion} --signs {signs} --tilt-test {} --out {out}",
    ),
    ("identify straightness", "into", ""),
    ("identify diagonals", "input", "identify diagonals --input {}"),
    ("identify diagonals", "data", "identify diagonals --data {} --box-mm 800,450,400"),
    (
        "identify diagonals",
        "model",
        "identify diagonals --data {diagonals} --box-mm 800,450,400 --low-mm 0,0,0 --model {}",
    ),
    ("identify diagonals", "into", ""),
    ("identify circles", "input", "identify circles --input {}"),
    ("identify circles", "data", "identify circles --data {} --tip-beyond-mm 120"),
    ("identify circles", "data_2", ""),
    ("identify circles", "registration_2", ""),
    ("identify circles", "add_pose", ""),
    (
        "identify circles",
        "registration",
        "identify circles --data {motion} --registration {} --tip-beyond-mm 120",
    ),
    ("identify circles", "into", ""),
    ("identify ram", "input", "identify ram --input {}"),
    (
        "identify ram",
        "data",
        "identify ram --data {} --a-axis-mm 0,0,-180 --tool-length-mm 320 --sigma-position-um 2 --sigma-direction-arcsec 2 --motions {out}",
    ),
    ("identify ram", "head", ""),
    ("identify ram", "prior", ""),
    ("identify ram", "into", ""),
    ("identify probe", "input", "identify probe --input {}"),
    ("identify probe", "data", "identify probe --data {} --arm-mm 173 --arm-zero-deg=-39 --bar-radius-mm 15"),
    ("identify probe", "into", ""),
    ("identify grinder", "drawing", "identify grinder --drawing {} --next a={out}"),
    ("identify grinder", "step", "identify grinder --drawing {model} --step a={} --out {out}"),
    ("identify grinder", "into", ""),
    ("identify ballbar", "data", "identify ballbar --data xy={} --radius-mm 150 --centre-mm=0,0,0"),
    ("identify ballbar", "into", ""),
    ("identify fits", "input", "identify fits --input {}"),
    (
        "identify fits",
        "data",
        "identify fits --data {} --x position_mm --y exx_um --basis polynomial --order 1",
    ),
    ("identify kalman", "input", "identify kalman --input {}"),
    (
        "identify kalman",
        "data",
        "identify kalman --data {} --first 0,100 --second 0,100 --third 0,100 --sigma 5 --noise 1 --limit 50 --into {model} --out {out}",
    ),
    (
        "identify kalman",
        "into",
        "identify kalman --data {lattice} --first 0,100 --second 0,100 --third 0,100 --sigma 5 --noise 1 --limit 50 --into {}",
    ),
    ("import", "files", "import {} --format iso230-dat --out {out}"),
    ("import", "into", "import {screw} --format linuxcnc --axis x --comp-type 0 --into {}"),
    ("import", "map", "import {motion} --map {} --out {out}"),
    ("export", "files", "export {} --format csv --axis x --step 10 --out {out}"),
    ("evaluate iso230-2", "data", "evaluate iso230-2 --data {}"),
    ("evaluate iso230-2", "before", "evaluate iso230-2 --data {positioning} --before {}"),
    ("evaluate iso230-2", "head", "evaluate iso230-2 --data {positioning} --head {}"),
    ("evaluate iso230-2", "active_model", "evaluate iso230-2 --data {positioning} --active-model {}"),
    ("evaluate iso230-4", "data", "evaluate iso230-4 --data {} --radius-mm 100"),
    ("evaluate iso230-4", "before", "evaluate iso230-4 --data {circle} --before {} --radius-mm 100"),
    ("evaluate iso230-4", "head", "evaluate iso230-4 --data {circle} --radius-mm 100 --head {}"),
    ("evaluate iso230-4", "active_model", ""),
    ("evaluate ballbar", "data", "evaluate ballbar --data {} --radius-mm 100"),
    ("evaluate ballbar", "head", ""),
    ("evaluate ballbar", "active_model", ""),
    ("evaluate iso230-6", "data", "evaluate iso230-6 --data {}"),
    ("evaluate iso230-6", "before", "evaluate iso230-6 --data {diagonals} --before {}"),
    ("evaluate iso230-6", "head", "evaluate iso230-6 --data {diagonals} --head {}"),
    ("evaluate iso230-6", "active_model", ""),
    ("evaluate plate", "data", "evaluate plate --data {}"),
    (
        "evaluate gear",
        "data",
        "evaluate gear --data {} --teeth 31 --module-mm 4 --face-width-mm 30 --tip-diameter-mm 132 --control-diameter-mm 118",
    ),
    (
        "evaluate gear",
        "before",
        "evaluate gear --data {gear} --before {} --teeth 31 --module-mm 4 --face-width-mm 30 --tip-diameter-mm 132 --control-diameter-mm 118",
    ),
    ("evaluate plate", "head", ""),
    ("evaluate plate", "active_model", ""),
    ("evaluate gear", "head", ""),
    ("evaluate gear", "active_model", ""),
    ("verify", "head", "verify --before {positioning} --after {later} --head {}"),
    ("verify", "active_model", ""),
    ("verify", "before", "verify --before {} --after {positioning}"),
    ("verify", "after", "verify --before {positioning} --after {}"),
    (
        "verify",
        "model",
        "verify --before {positioning} --after {later} --record {out} --date 2026-05-03 --instrument laser --model {}",
    ),
    ("diagnose", "model", "diagnose --model {} --data {session} --out {out}"),
    ("diagnose", "add", "diagnose --model {model} --add {} --data {session} --out {out}"),
    ("diagnose", "data", "diagnose --data {} --out {out}"),
    ("diagnose", "fresh", "diagnose --data {session} --fresh {} --out {out}"),
    ("diagnose", "history", "diagnose --data {session} --history {} --out {out}"),
    (
        "diagnose",
        "fresh_history",
        "diagnose --data {session} --fresh {session} --fresh-history {} --out {out}",
    ),
    ("model show", "file", "model show {}"),
    ("model report", "file", "model report {} --html {out}"),
    ("model report", "config", "model report {model} --config {} --html {out}"),
    ("model report", "head", "model report {model} --head {} --html {out}"),
    ("model report", "validation", "model report {model} --validation {} --html {out}"),
    ("model assemble", "models", "model assemble {} {model} --out {out}"),
    ("model assemble", "motion", "model assemble {model} --motion x={} --out {out}"),
    ("model assemble", "measured_at", ""),
    ("model assemble", "prefer", ""),
    ("model assemble", "absolute", ""),
    ("model assemble", "base", "model assemble --base {} --motion x={motion} --out {out}"),
    ("model extend", "model", "model extend --model {} --add {model} --out {out}"),
    ("model extend", "add", "model extend --model {model} --add {} --out {out}"),
    ("model normalise", "file", "model normalise {} --out {out}"),
    ("diff", "first", "diff {} {model}"),
    ("diff", "second", "diff {model} {}"),
    ("status", "config", "status --config {}"),
    ("watch", "config", "watch --config {}"),
    ("enable", "config", "enable --config {}"),
    ("disable", "config", "disable --config {}"),
    ("gain", "config", "gain 0.5 --config {}"),
    ("load", "model", "load {}"),
    ("load", "config", "load {model} --config {}"),
    ("rollback", "config", "rollback --config {}"),
    ("replay", "recordings", "replay {}"),
    ("replay", "model", ""),
    ("replay", "config", ""),
    ("gateway", "config", "gateway --config {}"),
    ("audit verify", "file", "audit verify {}"),
    ("audit verify", "config", "audit verify --config {}"),
    ("audit show", "file", "audit show {}"),
    ("audit show", "config", "audit show --config {}"),
    ("filter show", "config", "filter show --config {}"),
    ("filter show", "recording", "filter show --recording {}"),
    ("filter forget", "config", "filter forget MAP --config {}"),
];

/// Arguments that name files and folders to write, or a socket.
const OUTPUTS: &[&str] = &[
    "out",
    "json",
    "picture",
    "motions",
    "write_calibration",
    "write_signs",
    "next",
    "record",
    "report",
    "svg",
    "html",
    "socket",
];

/// Small files that are right, or that are read before the one under test.
struct Stage(tempfile::TempDir);

impl Stage {
    fn new() -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let write = |name: &str, text: &str| fs::write(folder.path().join(name), text).expect("written");
        let model = concat!(env!("CARGO_MANIFEST_DIR"), "/config/examples/vmc-850/model.toml");
        fs::copy(model, folder.path().join("model")).expect("the example");
        write("points", "x_mm,y_mm,z_mm\n1,2,-3\n");
        write("motion", "position_mm,exx_um\n0,0\n50,1\n100,0\n150,2\n200,1\n250,3\n300,2\n");
        write("carriage", "point,x_mm,y_mm,z_mm\np1,0,0,0\np2,100,0,0\np3,0,100,0\n");
        write("lines", "line,x_mm,y_mm,z_mm\n1,0,0,0\n2,0,100,0\n3,0,0,100\n");
        write(
            "head",
            "format = \"volcomp-fivedof/1\"\nfocal-mm = { psd1 = 200, psd2 = 200, psd3 = 200 }\n\
             beam-1-mm = [-30, 0]\nbeam-2-mm = [30, 0]\n",
        );
        let cycles = |row: &dyn Fn(u32, i32, u32) -> String| {
            let each = |c| [1, -1].into_iter().flat_map(move |d| (0..6).map(move |k| (c, d, k)));
            (1..=5).flat_map(each).map(|(c, d, k)| row(c, d, k)).collect::<String>()
        };
        let row = |c: u32, d: i32, k: u32| format!("{c},{d},{},{}\n", 100 * k, k * c);
        write("positioning", &format!("cycle,direction,target_mm,deviation_um\n{}", cycles(&row)));
        let later = |c: u32, d: i32, k: u32| format!("{c},{d},{},{c}\n", 100 * k);
        write("later", &format!("cycle,direction,target_mm,deviation_um\n{}", cycles(&later)));
        let diagonal = |name: &str| cycles(&|c, d, k| format!("{name},{}", row(c, d, k)));
        let all = ["ppp", "npp", "pnp", "ppn"].map(diagonal).concat();
        write("diagonals", &format!("diagonal,cycle,direction,target_mm,deviation_um\n{all}"));
        let turn: String = (0..=360).map(|k| format!("{k},{},1\n", k % 3)).collect();
        write("circle", &format!("angle_deg,deviation_um,direction\n{turn}"));
        let lead: String =
            (0..=60).map(|k| format!("lead,left,1,{},{}\n", 0.5 * f64::from(k), k % 3)).collect();
        write("gear", &format!("direction,flank,tooth,position_mm,deviation_um\n{lead}"));
        write("program", "G1 X1 Y1 Z-1 F100\n");
        let session: String = (0..200).map(|k| format!("{k},laser,1,1,1,{k},1,0,0,{}\n", k % 7)).collect();
        write(
            "session",
            &format!("t_s,instrument,setup,run,repeat,x_mm,u_x,u_y,u_z,deviation_um\n{session}"),
        );
        let warmth: String =
            (0..200).map(|k| format!("{k},{},{}\n", k % 9, 20.0 + 0.01 * f64::from(k))).collect();
        write("warmth", &format!("t_s,z_um,temp_a_degc\n{warmth}"));
        write("lattice", "x_mm,y_mm,z_mm,exx_um\n1,1,1,2\n50,50,50,1\n");
        write("screw", "0 0.001 0.001\n100 0.002 0.002\n200 0.001 0.001\n");
        Self(folder)
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// The words of a command line with the file under test in its place.
    fn words(&self, line: &str, file: &Path) -> Vec<String> {
        let mut line = line.replace("{}", file.to_str().expect("text"));
        while let Some((before, rest)) = line.split_once('{') {
            let (name, after) = rest.split_once('}').expect("closed");
            line = format!("{before}{}{after}", self.path(name).display());
        }
        line.split(' ').map(str::to_owned).collect()
    }
}

/// Runs `volcomp` with bounded memory.
fn bounded(words: &[String], stdin: Stdio) -> Output {
    Command::new("prlimit")
        .arg(format!("--as={}", MEMORY_KIB << 10))
        .arg(env!("CARGO_BIN_EXE_volcomp"))
        .args(words)
        .stdin(stdin)
        .output()
        .expect("prlimit runs")
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Every argument of the command tree that names a file: command and argument.
fn file_arguments(command: &clap::Command, path: &str, found: &mut BTreeSet<(String, String)>) {
    for argument in command.get_arguments() {
        let is_path = argument.get_value_parser().type_id() == std::any::TypeId::of::<std::path::PathBuf>();
        let names = argument.get_value_names().unwrap_or_default().iter();
        let said = names.map(|n| n.as_str()).collect::<String>();
        let is_file = ["FILE", "CSV", "TOML", "RECORDING"].iter().any(|word| said.contains(word));
        // the positional form of --data is read as --data is
        let is_data = argument.is_positional()
            && command.get_arg_conflicts_with(argument).iter().any(|other| other.get_id() == "data");
        if (is_path || is_file && argument.get_action().takes_values()) && !is_data {
            found.insert((path.to_owned(), argument.get_id().to_string()));
        }
    }
    for command in command.get_subcommands() {
        let name = command.get_name();
        file_arguments(
            command,
            if path.is_empty() { name.to_owned() } else { format!("{path} {name}") }.as_str(),
            found,
        );
    }
}

#[test]
fn every_form_that_reads_a_file_is_listed() {
    let mut tree = BTreeSet::new();
    file_arguments(&volcomp::cli::command(), "", &mut tree);
    let read: BTreeSet<_> =
        tree.into_iter().filter(|(_, argument)| !OUTPUTS.contains(&argument.as_str())).collect();
    let listed: BTreeSet<_> = INPUTS.iter().map(|(c, a, _)| ((*c).to_owned(), (*a).to_owned())).collect();
    assert_eq!(read, listed);
}

#[test]
fn an_endless_file_is_refused_in_bounded_memory() {
    let stage = Stage::new();
    let formats = "rtl rtx b5r edge iso230-dat isg isg-lis linuxcnc heidenhain api-pos camonitor";
    let mut forms: Vec<String> = INPUTS.iter().map(|(_, _, line)| (*line).to_owned()).collect();
    forms.retain(|line| !line.is_empty());
    forms.extend(formats.split(' ').map(|f| format!("import {{}} --format {f} --axis x --out {{out}}")));
    forms.push("import {} --columns x_mm=1:mm --out {out}".to_owned());
    forms.push("import {} --columns target=1:mm,deviation=2:um --out {out}".to_owned());
    let wrong: Vec<String> = thread::scope(|scope| {
        let half = forms.len().div_ceil(2);
        let runs: Vec<_> = forms
            .chunks(half)
            .map(|forms| {
                scope.spawn(|| {
                    let one = |line: &str| {
                        let output = bounded(&stage.words(line, Path::new("/dev/zero")), Stdio::null());
                        let said = stderr(&output);
                        let refused = matches!(output.status.code(), Some(65 | 78));
                        let named = said.lines().any(|l| l.starts_with("error: ") && l.contains("/dev/zero"));
                        (!refused || !named).then(|| format!("{line}: {}\n{said}", output.status))
                    };
                    forms.iter().filter_map(|line| one(line)).collect::<Vec<_>>()
                })
            })
            .collect();
        runs.into_iter().flat_map(|run| run.join().expect("no panic")).collect()
    });
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// A file of zeros without blocks on the disk.
fn sparse(path: &Path, length: u64) {
    File::create(path).and_then(|f| f.set_len(length)).expect("a sparse file");
}

#[test]
fn a_file_of_the_limit_is_read_and_one_byte_more_is_refused_unread() {
    let stage = Stage::new();
    let limit = InputKind::Model.limit();
    let valid = fs::read_to_string(stage.path("model")).expect("the example");
    let file = stage.path("large.toml");
    let padded = |length: u64| {
        let comment = usize::try_from(length).expect("small") - valid.len() - 1;
        fs::write(&file, format!("{valid}#{}", "x".repeat(comment))).expect("written");
    };
    padded(limit);
    let output = bounded(&stage.words("check {}", &file), Stdio::null());
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    padded(limit + 1);
    let output = bounded(&stage.words("check {}", &file), Stdio::null());
    assert_eq!(output.status.code(), Some(65));
    let said = stderr(&output);
    for part in ["large.toml: 4194305 bytes", "the limit for a model file is 4 MiB", "hint: "] {
        assert!(said.contains(part), "{said}");
    }
    // by the length alone: a table that would not fit into memory
    sparse(&file, 1 << 40);
    let output = bounded(&stage.words("evaluate plate --data {}", &file), Stdio::null());
    assert_eq!(output.status.code(), Some(65));
    assert!(stderr(&output).contains("the limit for a table is 256 MiB"), "{}", stderr(&output));
}

#[test]
fn what_is_no_file_is_named() {
    let stage = Stage::new();
    let fifo = stage.path("fifo");
    rustix::fs::mknodat(CWD, &fifo, FileType::Fifo, Mode::RUSR | Mode::WUSR, 0).expect("a FIFO");
    fs::write(stage.path("empty"), "").expect("written");
    for (file, code, said) in [
        (stage.0.path().to_owned(), 74, "is a directory; expected a model file"),
        (fifo, 74, "nothing was written into this FIFO for 5 s"),
        (stage.path("none"), 74, "no such file"),
        (stage.path("empty"), 78, "format is missing"),
        (PathBuf::from("/dev/null"), 78, "format is missing"),
    ] {
        let output = bounded(&stage.words("check {}", &file), Stdio::null());
        assert_eq!(output.status.code(), Some(code), "{}: {}", file.display(), stderr(&output));
        assert!(stderr(&output).contains(said), "{}", stderr(&output));
    }
    for empty in ["/dev/null", stage.path("empty").to_str().expect("text")] {
        let line = "predict --model {model} --points {} --out -";
        let output = bounded(&stage.words(line, Path::new(empty)), Stdio::null());
        assert_eq!(output.status.code(), Some(65));
        assert!(stderr(&output).contains("the file is empty"), "{}", stderr(&output));
    }
}

#[test]
fn pipes_of_the_shell_and_late_writers_are_read() {
    let stage = Stage::new();
    let line = stage.words("predict --model {model} --points {points} --out -", Path::new(""));
    let expected = bounded(&line, Stdio::null());
    assert!(expected.status.success(), "{}", stderr(&expected));
    let script = r#""$1" predict --model "$2" --points <(sleep 0.3; cat "$3") --out -"#;
    let piped = Command::new("bash")
        .args(["-c", script, "bash", env!("CARGO_BIN_EXE_volcomp")])
        .args([stage.path("model"), stage.path("points")])
        .output()
        .expect("bash runs");
    assert_eq!((piped.status.code(), &piped.stdout), (Some(0), &expected.stdout), "{}", stderr(&piped));

    let fifo = stage.path("fifo");
    rustix::fs::mknodat(CWD, &fifo, FileType::Fifo, Mode::RUSR | Mode::WUSR, 0).expect("a FIFO");
    let text = fs::read(stage.path("points")).expect("there");
    let output = thread::scope(|scope| {
        let writer = scope.spawn(|| {
            thread::sleep(Duration::from_millis(300));
            File::options().write(true).open(&fifo).and_then(|mut f| f.write_all(&text)).expect("written");
        });
        let output =
            bounded(&stage.words("predict --model {model} --points {} --out -", &fifo), Stdio::null());
        writer.join().expect("no panic");
        output
    });
    assert_eq!((output.status.code(), output.stdout), (Some(0), expected.stdout));
}

#[test]
fn the_largest_model_file_fits_into_half_a_gigabyte() {
    let stage = Stage::new();
    let limit = usize::try_from(InputKind::Model.limit()).expect("small");
    let valid = fs::read_to_string(stage.path("model")).expect("the example");
    let file = stage.path("large.toml");
    for (unit, head, tail) in [
        ("0,", format!("{valid}\n[more]\na = ["), "]\n"),
        ("[],", "a = [".to_owned(), "]\n"),
        ("[[a]]\n", String::new(), ""),
        ("a\n", String::new(), ""),
        ("= ", String::new(), ""),
        ("[", "a = ".to_owned(), ""),
    ] {
        let count = (limit - head.len() - tail.len()) / unit.len();
        fs::write(&file, format!("{head}{}{tail}", unit.repeat(count))).expect("written");
        let output = Command::new("prlimit")
            .args([&format!("--data={}", 500_u64 << 20), env!("CARGO_BIN_EXE_volcomp"), "check"])
            .arg(&file)
            .output()
            .expect("prlimit runs");
        assert_eq!(output.status.code(), Some(78), "{unit:?}: {}", stderr(&output));
    }
}

#[test]
fn a_table_of_a_million_rows_is_read_and_one_of_too_many_is_refused() {
    let stage = Stage::new();
    let file = stage.path("long.csv");
    let long = |count: usize| {
        let text =
            format!("diagonal,cycle,direction,target_mm,deviation_um\n{}", "ppp,1,1,0,0\n".repeat(count));
        fs::write(&file, text).expect("written");
        stderr(&bounded(&stage.words("evaluate iso230-6 --data {}", &file), Stdio::null()))
    };
    assert!(!long(1_000_000).contains("rows; split"), "a million rows are no reason to refuse");
    let said = long(4_000_001);
    assert!(said.contains("long.csv:4000002: more than 4000000 rows"), "{said}");
}

#[test]
fn the_limits_are_documented() {
    let page = fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/docs/reference/limits.md"))
        .expect("the page");
    for kind in <InputKind as clap::ValueEnum>::value_variants() {
        let row = format!("| {} | {} |", kind.name().split_once(' ').expect("an article").1, kind.size());
        assert!(page.contains(&row), "{row}");
    }
}
