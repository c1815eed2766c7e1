//! The diagnosis beside the bare work in one run: `cargo bench --bench diagnose [-- --check]`.
//!
//! The bare work is forming the Gram matrix of every candidate column of the library for the same readings, with the same
//! linear algebra on one core. Sessions are made up: lines along three axes, circles at two feeds, a grid with two tools,
//! temperatures and a spindle, with a backlash, a scale and a growth to be found. From a session that was read to report,
//! pictures' data and addition. `--check` exits with 1 where 6000 readings take more than [`RATIO`] times the bare work,
//! where a million take more than [`GROWTH`] times what ten times fewer take, or more than [`MEMORY_GB`].

#![expect(clippy::disallowed_methods, reason = "a benchmark reads the clock")]
#![expect(
    clippy::expect_used,
    clippy::print_stdout,
    clippy::print_stderr,
    reason = "a benchmark is a program for people"
)]

use std::hint::black_box;
use std::process::ExitCode;
use std::time::Instant;

use nalgebra::DMatrix;
use volcomp::diagnose::library::Library;
use volcomp::diagnose::machine_state::{Machine, Source};
use volcomp::diagnose::search::raw_columns;
use volcomp::diagnose::session::{History, Raw, Session};
use volcomp::diagnose::{Options, diagnose};

const RATIO: f64 = 5.0;
/// For ten times the readings: linear, and a fifth more.
const GROWTH: f64 = 12.0;
const MEMORY_GB: f64 = 2.0;
/// With `--check`, a size fails when it is missed this many times in a row.
const ATTEMPTS: usize = 2;
const NAMES: [&str; 12] = [
    "t_s",
    "setup",
    "run",
    "repeat",
    "x_mm",
    "y_mm",
    "z_mm",
    "u_x",
    "u_y",
    "u_z",
    "feed_mm_per_min",
    "tool_length_mm",
];

/// A table that grows by readings.
struct Program {
    raw: Raw,
    rows: Vec<[f64; NAMES.len()]>,
    t_s: f64,
    /// Where X is, and which way it went last.
    x: [f64; 2],
    dice: u64,
}

impl Program {
    fn uniform(&mut self) -> f64 {
        self.dice = self.dice.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.dice >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// A reading: where, along what, by which instrument, at which feed and with which tool.
    fn read(&mut self, what: (&str, f64, f64, f64), at: [f64; 3], u: [f64; 3], feed: [f64; 2]) {
        let (instrument, setup, run, repeat) = what;
        if at[0] != self.x[0] {
            self.x = [at[0], (at[0] - self.x[0]).signum()];
        }
        let noise: f64 = (0..6).map(|_| self.uniform()).sum::<f64>() - 3.0;
        let warm = 1.0 - (-self.t_s / 3600.0).exp();
        let error = [
            if self.x[1] < 0.0 { 3.0 } else { 0.0 },
            12e-3 * (at[1] - 250.0) + 4.0 * warm,
            2.0 * (at[2] / 90.0).sin(),
        ];
        let deviation = (0..3).map(|k| error[k] * u[k]).sum::<f64>() + 0.5 * noise;
        let row = [self.t_s, setup, run, repeat, at[0], at[1], at[2], u[0], u[1], u[2], feed[0], feed[1]];
        self.rows.push(row);
        self.raw.instruments.push(instrument.into());
        self.raw.lines.push(self.rows.len() as u64 + 1);
        self.raw.columns[NAMES.len()].push(deviation);
    }
}

/// A session of about `n` readings.
fn session(n: usize) -> (Raw, History) {
    let mut names: Vec<String> = NAMES.map(String::from).into();
    names.push("deviation_um".into());
    let columns = vec![Vec::new(); names.len()];
    let raw = Raw { file: "made-up.csv".into(), names, columns, ..Raw::default() };
    let mut p = Program { raw, rows: Vec::with_capacity(n), t_s: 0.0, x: [0.0, 1.0], dice: 1 };
    let share = (n / 24).max(10);
    let (mut run, mut setup) = (0.0, 0.0);
    // lines, both ways, twice each
    for axis in 0..3 {
        setup += 1.0;
        for repeat in 0..4 {
            run += 1.0;
            let way = if repeat % 2 == 0 { 1.0 } else { -1.0 };
            for k in 0..share {
                let along = 500.0 * k as f64 / (share - 1) as f64;
                let mut at = [250.0; 3];
                at[axis] = if way > 0.0 { along } else { 500.0 - along };
                let mut u = [0.0; 3];
                u[axis] = 1.0;
                p.t_s += 600.0 / share as f64;
                p.read(("laser", setup, run, (repeat / 2 + 1) as f64), at, u, [3000.0, 100.0]);
            }
        }
    }
    // circles at two feeds, both ways
    setup += 1.0;
    for pass in 0..4 {
        run += 1.0;
        let feed = if pass < 2 { 500.0 } else { 3000.0 };
        let step_s = std::f64::consts::TAU * 100.0 / (feed / 60.0) / share as f64;
        for k in 0..share {
            let turn = std::f64::consts::TAU * k as f64 / share as f64;
            let turn = if pass % 2 == 0 { turn } else { -turn };
            let u = [turn.cos(), turn.sin(), 0.0];
            let at = [250.0 + 100.0 * u[0], 250.0 + 100.0 * u[1], 250.0];
            p.t_s += step_s;
            p.read(("ballbar", setup, run, 1.0), at, u, [feed, 100.0]);
        }
    }
    // a grid with two tools, twice
    setup += 1.0;
    for tool in [100.0, 250.0] {
        for repeat in 1..=2 {
            run += 1.0;
            let mut dice = p.dice;
            for k in 0..2 * share / 3 {
                p.dice = dice;
                let at = [500.0 * p.uniform(), 500.0 * p.uniform(), 500.0 * p.uniform()];
                dice = p.dice;
                p.dice ^= run as u64 * 77 + k as u64;
                p.t_s += 1800.0 / share as f64;
                for axis in 0..3 {
                    let mut u = [0.0; 3];
                    u[axis] = 1.0;
                    p.read(("tracker", setup, run, f64::from(repeat)), at, u, [0.0, tool]);
                }
            }
        }
    }
    for (k, name) in NAMES.iter().enumerate() {
        let i = p.raw.names.iter().position(|n| n == name).expect("column");
        p.raw.columns[i] = p.rows.iter().map(|r| r[k]).collect();
    }
    let mut history = History::default();
    let minutes = (p.t_s / 60.0) as usize + 120;
    let at = |k: usize| 60.0 * k as f64 - 7200.0;
    let log = |value: fn(f64) -> f64| (0..=minutes).map(move |k| (at(k), value(at(k))));
    history.add(0, Source::Temperature("air".into()), log(|t| 20.0 + (t / 5000.0).sin()));
    history.add(0, Source::Spindle, log(|t| if (t / 1800.0) as i64 % 2 == 1 { 8.0 } else { 0.0 }));
    (p.raw, history)
}

struct Figures {
    read: usize,
    /// Those that are left where there are too many.
    readings: usize,
    columns: usize,
    gram_s: f64,
    whole_s: f64,
    causes: Vec<String>,
}

/// Seconds for the bare work.
fn gram(session: &Session, library: &Library) -> f64 {
    let rows: Vec<usize> = (0..session.readings.len()).collect();
    let w = DMatrix::from_vec(library.width(), rows.len(), raw_columns(session, library, &rows));
    let start = Instant::now();
    black_box(&w * w.transpose());
    start.elapsed().as_secs_f64()
}

/// The bare work is done where it is asked for: for a million readings its columns would fill the memory.
fn measure(n: usize, is_compared: bool) -> Figures {
    let (raw, history) = session(n);
    let (read, raws) = (raw.len(), [raw]);
    let start = Instant::now();
    let mut session = Session::build(&raws, history, Machine::plain()).expect("a session");
    let built_s = start.elapsed().as_secs_f64();
    let library = Library::new(&session, &[]);
    for signal in library.signals() {
        session.add_signal(&signal);
    }
    let gram_s = if is_compared { gram(&session, &library) } else { f64::NAN };
    let (readings, columns) = (session.readings.len(), library.width());
    let start = Instant::now();
    let found = diagnose(&mut session, None, &Options::default(), &mut |_, _| {});
    let whole_s = built_s + start.elapsed().as_secs_f64();
    let causes = found
        .report
        .causes
        .iter()
        .filter(|c| c.declared)
        .map(|c| format!("{} {}", c.effect, c.subject))
        .collect();
    Figures { read, readings, columns, gram_s, whole_s, causes }
}

/// The most memory this process has had, GB; nothing where the system does not tell.
fn memory_gb() -> Option<f64> {
    let text = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = text.lines().find(|l| l.starts_with("VmHWM:"))?;
    line.split_whitespace().nth(1)?.parse::<f64>().ok().map(|kb| kb / 1e6)
}

/// The gate and the nightly run list every line that begins so.
fn retried(attempt: usize) {
    if attempt > 0 {
        eprintln!("retried: bench diagnose");
    }
}

fn ratio() -> bool {
    (0..ATTEMPTS).any(|attempt| {
        retried(attempt);
        let f = measure(6000, true);
        let ratio = f.whole_s / f.gram_s;
        println!(
            "{} readings, {} columns: diagnosis {:.2} s, bare Gram matrix {:.2} s, {ratio:.1} times; causes {}",
            f.readings,
            f.columns,
            f.whole_s,
            f.gram_s,
            f.causes.join(", ")
        );
        ratio <= RATIO
    })
}

fn growth() -> bool {
    (0..ATTEMPTS).any(|attempt| {
        retried(attempt);
        let [small, large] = [100_000, 1_000_000].map(|n| measure(n, false));
        for f in [&small, &large] {
            println!(
                "{} readings, {} used: diagnosis {:.2} s; causes {}",
                f.read,
                f.readings,
                f.whole_s,
                f.causes.join(", ")
            );
        }
        let memory = memory_gb();
        println!("most memory {}", memory.map_or("not known".into(), |gb| format!("{gb:.2} GB")));
        large.whole_s <= GROWTH * small.whole_s && memory.is_none_or(|gb| gb < MEMORY_GB)
    })
}

fn main() -> ExitCode {
    let check = std::env::args().any(|a| a == "--check");
    let good = [ratio(), growth()];
    if check && good.contains(&false) { ExitCode::FAILURE } else { ExitCode::SUCCESS }
}
