//! Curve fitting beside numpy's least squares on the same data in one run: `cargo bench --bench fit [-- --check]`.
//!
//! numpy gets its design matrix for nothing in the first column of figures (`numpy.linalg.lstsq` alone); in the second it
//! builds it (`chebvander`), as a fit from positions and values must. Ours starts from readings and ends with
//! coefficients, band, residual figures and leave-one-out. Medians of many runs count. `--check` exits
//! with 1 where ours is slower than `lstsq` alone or numpy is missing. The interpreter is `python3`, or what `PYTHON` names; without numpy
//! only our own figures are printed.

#![expect(clippy::disallowed_methods, reason = "a benchmark reads the clock and writes its data")]
#![expect(
    clippy::expect_used,
    clippy::print_stdout,
    clippy::print_stderr,
    reason = "a benchmark is a program for people"
)]

use std::hint::black_box;
use std::path::Path;
use std::process::{Command, ExitCode};
use std::time::Instant;

use volcomp::identify::Reading;
use volcomp::identify::curve::{Basis, Request, fit};
use volcomp::model::axes::Travel;

const ORDER: usize = 10;
/// With `--check`, a size fails when ours is slower this many times in a row.
const ATTEMPTS: usize = 2;
/// Readings, and runs of each.
const SIZES: [(usize, usize); 6] =
    [(41, 2001), (200, 1001), (1000, 501), (10_000, 101), (100_000, 21), (1_000_000, 7)];

const NUMPY: &str = r"
import sys, time, numpy as np
from numpy.polynomial.chebyshev import chebvander
path, order, runs = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
x, y = np.fromfile(path).reshape(2, -1)
def median(f):
    times = []
    for _ in range(runs):
        t = time.perf_counter(); f(); times.append(time.perf_counter() - t)
    return sorted(times)[runs // 2]
low, high = x[0], x[-1]
design = lambda: chebvander((2 * x - low - high) / (high - low), order)
a = design()
c = np.linalg.lstsq(a, y, rcond=None)[0]
print(median(lambda: np.linalg.lstsq(a, y, rcond=None)), median(lambda: np.linalg.lstsq(design(), y, rcond=None)), c[3])
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

/// Median time of our fit, ms, and its fourth coefficient.
fn own(all: &[Reading], runs: usize) -> (f64, f64) {
    let request = Request { basis: Some(Basis::Chebyshev), order: Some(ORDER), ..Request::default() };
    let mut times: Vec<f64> = (0..runs)
        .map(|_| {
            let start = Instant::now();
            black_box(fit(black_box(all), &request).expect("a fit"));
            start.elapsed().as_secs_f64()
        })
        .collect();
    times.sort_by(f64::total_cmp);
    (times[runs / 2] * 1e3, fit(all, &request).expect("a fit").coefficients[3])
}

/// Median times of `lstsq` without and with making the matrix, ms, and the same coefficient; `None` without numpy.
fn numpy(path: &Path, runs: usize) -> Option<[f64; 3]> {
    let python = std::env::var("PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let (order, runs) = (ORDER.to_string(), runs.to_string());
    let output = Command::new(python).args(["-c", NUMPY]).arg(path).args([order, runs]).output().ok()?;
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let mut words = text.split_whitespace().filter_map(|w| w.parse().ok());
    let mut next = || output.status.success().then(|| words.next()).flatten();
    Some([next()? * 1e3, next()? * 1e3, next()?])
}

fn write(path: &Path, all: &[Reading]) {
    let values = all.iter().map(|r| r.position).chain(all.iter().map(|r| r.value));
    std::fs::write(path, values.flat_map(f64::to_le_bytes).collect::<Vec<u8>>()).expect("scratch file");
}

fn main() -> ExitCode {
    let check = std::env::args().any(|a| a == "--check");
    let directory = tempfile::tempdir().expect("scratch folder");
    let path = directory.path().join("data.f64");
    let (mut slower, mut compared) = (false, true);
    println!("Chebyshev polynomials of order {ORDER}; median times in ms");
    println!(
        "{:>9}{:>11}{:>16}{:>22}{:>8}",
        "readings", "volcomp", "numpy lstsq", "lstsq with matrix", "ratio"
    );
    for (n, runs) in SIZES {
        let all = readings(n);
        write(&path, &all);
        // a busy machine may hit one of the two
        for attempt in 1..=if check { ATTEMPTS } else { 1 } {
            let (time, coefficient) = own(&all, runs);
            let Some([bare, with_matrix, theirs]) = numpy(&path, runs) else {
                println!("{n:>9}{time:>11.3}{:>16}", "no numpy");
                compared = false;
                break;
            };
            assert!((coefficient - theirs).abs() < 1e-9, "the two disagree: {coefficient} and {theirs}");
            println!("{n:>9}{time:>11.3}{bare:>16.3}{with_matrix:>22.3}{:>8.2}", time / bare);
            if time <= bare {
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
