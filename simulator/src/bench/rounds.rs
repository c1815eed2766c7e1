//! Who has its turn when: short blocks in alternating order, or both sides in every cycle.

use core::time::Duration;
use std::time::Instant;

use super::error::BenchError;
use super::partner::{Partner, Times};

/// How frames follow each other.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mode {
    /// The next frame as soon as the answer is there; sides take turns in blocks.
    BackToBack,
    /// One frame per cycle; sides take turns in blocks.
    Paced(Duration),
    /// One frame per cycle for both sides all the time, half a cycle apart.
    Sustained(Duration),
}

/// The measured times of both sides.
#[derive(Debug, Clone)]
pub struct Round {
    /// How.
    pub mode: Mode,
    /// The daemon's outputs were read meanwhile.
    pub outputs: bool,
    /// The bare echo.
    pub echo: Times,
    /// volcompd.
    pub daemon: Times,
    /// How long it took, s.
    pub seconds: f64,
    /// Blocks of each side; 1 where both ran all the time.
    pub blocks: u32,
}

/// The two sides, bare echo first.
#[derive(Debug)]
pub struct Pair<'a> {
    /// The bare echo.
    pub echo: &'a mut Partner,
    /// volcompd.
    pub daemon: &'a mut Partner,
}

impl Mode {
    /// Name in figures.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::BackToBack => "back_to_back",
            Self::Paced(_) => "paced",
            Self::Sustained(_) => "sustained",
        }
    }

    /// The cycle, where there is one.
    #[must_use]
    pub const fn cycle(self) -> Option<Duration> {
        match self {
            Self::BackToBack => None,
            Self::Paced(cycle) | Self::Sustained(cycle) => Some(cycle),
        }
    }
}

impl Round {
    /// Nothing measured.
    ///
    /// # Errors
    /// A histogram cannot be made.
    pub fn new(mode: Mode, outputs: bool) -> Result<Self, BenchError> {
        Ok(Self { mode, outputs, echo: Times::new()?, daemon: Times::new()?, seconds: 0.0, blocks: 0 })
    }
}

/// Measures for about `length` more; `tick` is called now and then with the share that is done.
///
/// # Errors
/// A link ends.
pub fn measure(
    pair: &mut Pair<'_>,
    round: &mut Round,
    length: Duration,
    block: Duration,
    tick: &mut dyn FnMut(f64),
) -> Result<(), BenchError> {
    let mode = round.mode;
    let start = Instant::now();
    while start.elapsed() < length {
        // who begins changes every time, so that neither always follows the other's traces in the caches
        let daemon_first = round.blocks.is_multiple_of(2);
        round.blocks += 1;
        match mode {
            Mode::Sustained(cycle) => both(pair, round, cycle, block, daemon_first)?,
            Mode::BackToBack | Mode::Paced(_) => {
                for turn in 0..2 {
                    let (side, times) = if (turn == 0) == daemon_first {
                        (&mut *pair.daemon, &mut round.daemon)
                    } else {
                        (&mut *pair.echo, &mut round.echo)
                    };
                    match mode.cycle() {
                        None => back_to_back(side, times, block)?,
                        Some(cycle) => paced(side, times, cycle, block)?,
                    }
                }
            }
        }
        tick((start.elapsed().as_secs_f64() / length.as_secs_f64()).min(1.0));
    }
    round.seconds += start.elapsed().as_secs_f64();
    Ok(())
}

fn back_to_back(side: &mut Partner, times: &mut Times, block: Duration) -> Result<(), BenchError> {
    let until = Instant::now() + block;
    loop {
        side.prepare();
        let (end, took_ns) = side.exchange()?;
        times.roundtrip.saturating_record(took_ns);
        if end >= until {
            return Ok(());
        }
    }
}

fn paced(side: &mut Partner, times: &mut Times, cycle: Duration, block: Duration) -> Result<(), BenchError> {
    let mut due = Instant::now() + cycle;
    let until = due + block;
    while due < until {
        due = one_cycle(side, times, cycle, due)?;
    }
    Ok(())
}

/// Both sides in every cycle, the second one half a cycle after the first.
fn both(
    pair: &mut Pair<'_>,
    round: &mut Round,
    cycle: Duration,
    block: Duration,
    daemon_first: bool,
) -> Result<(), BenchError> {
    let start = Instant::now() + cycle;
    let until = start + block;
    let (mut daemon_due, mut echo_due) =
        if daemon_first { (start, start + cycle / 2) } else { (start + cycle / 2, start) };
    while daemon_due.min(echo_due) < until {
        if daemon_due < echo_due {
            daemon_due = one_cycle(pair.daemon, &mut round.daemon, cycle, daemon_due)?;
        } else {
            echo_due = one_cycle(pair.echo, &mut round.echo, cycle, echo_due)?;
        }
    }
    Ok(())
}

/// One cycle that begins at `due`; gives when the next one begins.
fn one_cycle(
    side: &mut Partner,
    times: &mut Times,
    cycle: Duration,
    due: Instant,
) -> Result<Instant, BenchError> {
    sleep_until(due);
    side.prepare();
    let (end, took_ns) = side.exchange()?;
    times.roundtrip.saturating_record(took_ns);
    let mut next = due + cycle;
    times.late += u64::from(end > next);
    // cycles that are over already: a control goes on with the present one
    while next + cycle < end {
        next += cycle;
        times.skipped += 1;
    }
    Ok(next)
}

fn sleep_until(due: Instant) {
    let left = due.saturating_duration_since(Instant::now());
    if !left.is_zero() {
        std::thread::sleep(left);
    }
}
