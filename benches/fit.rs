//! Curve fitting beside numpy's least squares on the same data in one run: `cargo bench --bench fit [-- --check]`.
//!
//! numpy gets its design matrix for nothing in the first column of figures (`numpy.linalg.lstsq` alone); in the second it
//! builds it (`chebvander`), as a fit from positions and values must. Ours starts from readings and ends with
//! coefficients, band, residual figures and leave-one-out. The two take turns, so that both meet the same host; the
//! ratio is the median over the rounds. `--check` exits with 1 where ours is slower than `lstsq` alone or numpy is missing.
//! The interpreter is `python3`, or what `PYTHON` names; without numpy only our own figures are printed.

#![expect(clippy::disallowed_methods, reason = "a benchmark reads the clock and writes its data")]
#![expect(
    clippy::expect_used,
    clippy::print_stdout,
    clippy::print_stderr,
    reason = "a benchmark is a program for people"
)]

use std::hint::black_box;
use std::io::{BufRead as _, BufReader, Write as _};
use std::path::Path;
use std::process::{Child, ChildStdin, ChildStdout, Command, ExitCode, Stdio};
use std::time::Instant;

use volcomp::identify::Reading;
use volcomp::identify::curve::{Basis, Request, fit};
use volcomp::model::axes::Travel;

const ORDER: usize = 10;
/// With `--check`, a size fails when ours is slower this many times in a row.
const ATTEMPTS: usize = 2;
/// Turns that both take at each size.
const ROUNDS: usize = 11;
/// Readings, and runs of each in a round.
const SIZES: [(usize, usize); 6] =
    [(41, 181), (200, 91), (1000, 45), (10_000, 9), (100_000, 3), (1_000_000, 1)];

const NUMPY: &str = r"
import sys, time, numpy as np
from numpy.polynomial.chebyshev import chebvander
order = int(sys.argv[1])
def median(f, runs):
    times = []
    for _ in range(runs):
        t = time.perf_counter(); f(); times.append(time.perf_counter() - t)
    return sorted(times)[runs // 2]
read = None
for line in sys.stdin:
    runs, path = line.rstrip('\n').split(' ', 1)
    if path != read:
        x, y = np.fromfile(path).reshape(2, -1)
        low, high = x[0], x[-1]
        design = lambda: chebvander((2 * x - low - high) / (high - low), order)
        a, read = design(), path
        c = np.linalg.lstsq(a, y, rcond=None)[0]
    bare = lambda: np.linalg.lstsq(a, y, rcond=None)
    whole = lambda: np.linalg.lstsq(design(), y, rcond=None)
    print(median(bare, int(runs)), median(whole, int(runs)), c[3], flush=True)
";

fn readings(n: usize) -> Vec<Reading> {
    (0..n)
        .map(|i| {
            let x = 400.0 * i as f64 / (n - 1) as f64;
            let wobble =
                ((i as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 40) as f64 / f64::from(1 << 24) - 0.5;
            Reading {
                cycle: 1,
                travel: Travel::Forward,
                position: x,
                value: 5e-3 * (x / 60.0).sin() + 1e-3 * wobble,
            }
        })
        .collect()
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// Median time of our fit, ms, and its fourth coefficient.
fn own(all: &[Reading], runs: usize) -> (f64, f64) {
    let request = Request { basis: Some(Basis::Chebyshev), order: Some(ORDER), ..Request::default() };
    let mut coefficient = f64::NAN;
    let times = (0..runs).map(|_| {
        let start = Instant::now();
        let fitted = black_box(fit(black_box(all), &request).expect("a fit"));
        let time = start.elapsed().as_secs_f64();
        coefficient = fitted.coefficients[3];
        time
    });
    (median(times.collect()) * 1e3, coefficient)
}

/// numpy waiting for its turns.
struct Numpy {
    child: Child,
    turns: ChildStdin,
    answers: BufReader<ChildStdout>,
}

impl Numpy {
    fn start() -> Option<Self> {
        let python = std::env::var("PYTHON").unwrap_or_else(|_| "python3".to_owned());
        let mut command = Command::new(python);
        command.args(["-c", NUMPY, &ORDER.to_string()]).stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut child = command.stderr(Stdio::null()).spawn().ok()?;
        let (turns, answers) = (child.stdin.take()?, BufReader::new(child.stdout.take()?));
        Some(Self { child, turns, answers })
    }

    /// Median times of `lstsq` without and with making the matrix, ms, and the same coefficient; `None` without numpy.
    fn turn(&mut self, path: &Path, runs: usize) -> Option<[f64; 3]> {
        writeln!(self.turns, "{runs} {}", path.display()).ok()?;
        let mut line = String::new();
        self.answers.read_line(&mut line).ok()?;
        let mut words = line.split_whitespace().filter_map(|w| w.parse().ok());
        Some([words.next()?, words.next()?, words.next()?])
            .map(|[bare, whole, c]| [bare * 1e3, whole * 1e3, c])
    }
}

impl Drop for Numpy {
    fn drop(&mut self) {
        // a child that has ended needs no end
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn write(path: &Path, all: &[Reading]) {
    let values = all.iter().map(|r| r.position).chain(all.iter().map(|r| r.value));
    std::fs::write(path, values.flat_map(f64::to_le_bytes).collect::<Vec<u8>>()).expect("scratch file");
}

fn main() -> ExitCode {
    let check = std::env::args().any(|a| a == "--check");
    let directory = tempfile::tempdir().expect("scratch folder");
    let mut numpy = Numpy::start();
    let (mut slower, mut compared) = (false, true);
    println!("Chebyshev polynomials of order {ORDER}; median times in ms over {ROUNDS} rounds");
    println!(
        "{:>9}{:>11}{:>16}{:>22}{:>8}",
        "readings", "volcomp", "numpy lstsq", "lstsq with matrix", "ratio"
    );
    for (n, runs) in SIZES {
        let all = readings(n);
        let path = directory.path().join(format!("{n}.f64"));
        write(&path, &all);
        // a busy machine may hit one of the two
        for attempt in 1..=if check { ATTEMPTS } else { 1 } {
            let (mut ours, mut theirs) = (Vec::new(), Vec::new());
            for _ in 0..ROUNDS {
                let (time, coefficient) = own(&all, runs);
                ours.push(time);
                if let Some(turn) = numpy.as_mut().and_then(|numpy| numpy.turn(&path, runs)) {
                    let off = (coefficient - turn[2]).abs();
                    assert!(off < 1e-9, "the two disagree: {coefficient} and {}", turn[2]);
                    theirs.push(turn);
                }
            }
            if theirs.len() < ROUNDS {
                println!("{n:>9}{:>11.3}{:>16}", median(ours), "no numpy");
                compared = false;
                break;
            }
            let of = |which: usize| median(theirs.iter().map(|turn| turn[which]).collect());
            let ratio = median(ours.iter().zip(&theirs).map(|(own, turn)| own / turn[0]).collect());
            println!("{n:>9}{:>11.3}{:>16.3}{:>22.3}{ratio:>8.2}", median(ours), of(0), of(1));
            if ratio <= 1.0 {
                break;
            }
            slower |= attempt == ATTEMPTS;
            if check && !slower {
                eprintln!("retried: bench fit, {n} readings");
            }
        }
    }
    if check && !compared {
        eprintln!("not compared: python3, or the program that PYTHON names, has no numpy");
        return ExitCode::FAILURE;
    }
    if check && slower {
        eprintln!("slower than numpy.linalg.lstsq");
        return ExitCode::FAILURE;
    }
    ExitCode::SUCCESS
}
