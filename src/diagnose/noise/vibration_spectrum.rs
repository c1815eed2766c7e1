//! Vibration as a line in the spectrum of what is left, and noise that grows with the range.

use core::f64::consts::TAU;
use std::collections::{BTreeMap, BTreeSet};

use super::super::constants::{CREEP, LINE_CHANCE, LOWEST_HZ, MANY, NEARLY};
use super::super::moment::SLOTS;
use super::super::session::{Session, Times, is_encoder};
use super::moves;
use super::path::is_same_state;
use volcomp_model::statistics::chi_square_upper;

/// A vibration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tone {
    /// Frequency, Hz.
    pub frequency_hz: f64,
    /// Amplitude in the noise's own unit (1 is one standard deviation).
    pub amplitude: f64,
    /// Probability that noise alone has such a line anywhere.
    pub chance: f64,
}

/// Samples of a run that are looked at.
const SAMPLES_MAX: usize = 2048;
/// Times samples and frequencies at most: bounds the work.
const WORK: usize = 40_000_000;
/// Periods of the slowest line in a run, and for each turn of its motion: what comes back differently in the next pass
/// of a circle (it has grown warm) has the waves of the circle.
const PERIODS: f64 = 4.0;

/// Time, s, value and row of a sample.
type Sample = (f64, f64, usize);

/// A run whose samples follow each other evenly, and the slowest line that it can hold.
struct Even {
    step: f64,
    /// 0 where a sample is lost: it says nothing of any line.
    values: Vec<f64>,
    /// Rows of the samples that are not lost.
    rows: Vec<usize>,
    slowest_hz: f64,
}

/// Frequency of a cycle, at least, in slowest ones that the runs can hold.
const EDGE: f64 = 1.1;

/// Lost samples in a row up to which a run goes on.
const LOST_MAX: f64 = 100.0;

/// Which lines are looked for.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Band {
    /// Those of a vibration of the machine.
    Vibration,
    /// Slower ones, of readings that stay at one place: a motion has lines of its own.
    Slow,
}

fn even_runs(
    session: &Session,
    order: &[usize],
    (filtered, beside): (&[f64], &[f64]),
    band: Band,
) -> Vec<Even> {
    let mut runs: Vec<Vec<Sample>> = vec![Vec::new(); session.runs];
    for (e, i) in restless(session, order, filtered, beside).into_iter().zip(order) {
        // without a clock there is no frequency
        let Some(e) = e.filter(|_| session.times_of(*i) == Times::Measured) else { continue };
        runs[session.readings[*i].run].push((session.moments[*i].t_s, e, *i));
    }
    let mut even = Vec::new();
    let lines = runs.iter().filter(|r| r.len() >= MANY).flat_map(|run| directions(session, run));
    for line in lines {
        let mut steps: Vec<f64> = line.windows(2).map(|w| w[1].0 - w[0].0).collect();
        let step = super::median(&mut steps);
        let steps = |w: &[&Sample]| ((w[1].0 - w[0].0) / step).round().clamp(1.0, LOST_MAX);
        let is_regular = |w: &&[&Sample]| (w[1].0 - w[0].0 - steps(w) * step).abs() < 0.05 * step;
        let regular = line.windows(2).filter(is_regular).count();
        let holds = match band {
            Band::Vibration => step > 0.0 && 0.5 / step > LOWEST_HZ,
            Band::Slow => step > 0.0 && stays(session, &line),
        };
        if holds && regular * 20 >= 19 * (line.len() - 1) {
            let slowest_hz = (PERIODS + turns(session, &line) * PERIODS) / (line.len() as f64 * step);
            let own: Vec<f64> = line.iter().map(|s| s.1).collect();
            let own = if band == Band::Slow { standardised(own) } else { own };
            let mut values = vec![own[0]];
            for (w, value) in line.windows(2).zip(&own[1..]) {
                values.resize(values.len() + steps(w) as usize - 1, 0.0);
                values.push(*value);
            }
            even.push(Even { step, values, rows: line.iter().map(|s| s.2).collect(), slowest_hz });
        }
    }
    even
}

/// True where the machine stays in one state.
fn stays(session: &Session, line: &[&Sample]) -> bool {
    let moment = |s: &Sample| &session.moments[s.2];
    line.iter().all(|s| !moves(moment(s)) && is_same_state(moment(line[0]), moment(s)))
}

/// Values without their mean and slope, with unit variance; zeros where they have none.
fn standardised(mut values: Vec<f64>) -> Vec<f64> {
    let n = values.len() as f64;
    let at = |k: usize| k as f64 - 0.5 * (n - 1.0);
    let mean = values.iter().sum::<f64>() / n;
    let moment: f64 = values.iter().enumerate().map(|(k, v)| at(k) * v).sum();
    let slope = moment / (n * (n * n - 1.0) / 12.0);
    values.iter_mut().enumerate().for_each(|(k, v)| *v -= mean + slope * at(k));
    let size = (values.iter().map(|v| v * v).sum::<f64>() / n).sqrt();
    let scale = if size > 0.0 { 1.0 / size } else { 0.0 };
    values.iter_mut().for_each(|v| *v *= scale);
    values
}

/// How often a motion goes forth and back, by the axis that turns round most.
fn turns(session: &Session, line: &[&Sample]) -> f64 {
    let reversals = (0..SLOTS).map(|slot| {
        let ways = line.iter().map(|s| session.moments[s.2].velocity[slot]);
        let signs: Vec<bool> = ways.filter(|v| v.abs() > CREEP).map(|v| v > 0.0).collect();
        signs.windows(2).filter(|w| w[0] != w[1]).count()
    });
    reversals.max().unwrap_or(0) as f64 / 2.0
}

/// The samples of a run by the direction in which they look; all of them where no direction has enough.
fn directions<'a>(session: &Session, run: &'a [Sample]) -> Vec<Vec<&'a Sample>> {
    let mut lines: Vec<Vec<&Sample>> = Vec::new();
    for sample in run {
        let u = session.moments[sample.2].u;
        let same = lines.iter().position(|l| session.moments[l[0].2].u.dot(&u) > NEARLY);
        match same {
            Some(line) => lines[line].push(sample),
            // a capture looks along three
            None if lines.len() < 3 => lines.push(vec![sample]),
            None => {}
        }
    }
    // a circle turns its direction with it: then every reading counts
    let held: usize = lines.iter().map(Vec::len).sum();
    if held < run.len() {
        lines.truncate(1);
    }
    lines.retain(|l| l.len() >= MANY);
    if lines.is_empty() {
        lines.push(run.iter().collect());
    }
    lines.iter_mut().for_each(|l| l.truncate(SAMPLES_MAX));
    lines
}

/// What does not come back with the repeats of each reading, um; 0 for readings without repeats.
#[must_use]
pub fn beside_repeats(session: &Session, used: &[bool], left_um: &[f64]) -> Vec<f64> {
    let mut groups: BTreeMap<usize, (f64, usize)> = BTreeMap::new();
    let of = |i: usize| session.readings[i].pair.filter(|_| used[i]);
    for (i, e) in left_um.iter().enumerate() {
        if let Some(p) = of(i) {
            let g = groups.entry(p).or_default();
            *g = (g.0 + e, g.1 + 1);
        }
    }
    let alone = |i: usize, e: f64| {
        let (sum, n) = *groups.get(&of(i)?)?;
        (n > 1).then(|| (e - sum / n as f64) * (n as f64 / (n - 1) as f64).sqrt())
    };
    left_um.iter().enumerate().map(|(i, e)| alone(i, *e).unwrap_or(0.0)).collect()
}

/// What may hold a vibration: readings at rest as they are; of moving ones only what does not come back with their repeats,
/// because a motion has lines of its own, and of two repeats, which then say the same, the first. `None` for moving readings
/// without repeats.
fn restless(session: &Session, order: &[usize], filtered: &[f64], beside: &[f64]) -> Vec<Option<f64>> {
    let moves = |i: usize| moves(&session.moments[i]);
    // an encoder at rest between two moves shows how its servo settles
    let servo: BTreeSet<usize> = order
        .iter()
        .filter(|i| is_encoder(&session.instruments[session.readings[**i].instrument]) && moves(**i))
        .map(|i| session.readings[*i].run)
        .collect();
    let repeats = super::repeats_of(session, order.iter().copied());
    let tells = |i: usize| {
        let of = session.readings[i].pair.and_then(|p| repeats.get(&p));
        of.is_some_and(|(n, first)| *n > 2 || *n == 2 && *first == i)
    };
    filtered
        .iter()
        .zip(beside)
        .zip(order)
        .map(|((e, beside), i)| match (servo.contains(&session.readings[*i].run), moves(*i)) {
            (true, _) => None,
            (false, false) => Some(*e),
            (false, true) => tells(*i).then_some(*beside),
        })
        .collect()
}

/// The strongest line over all evenly sampled runs, whatever its phase in each. `filtered` is what is left, whitened, and
/// `beside` what of it does not come back with the repeats ([`beside_repeats`], whitened after that: a large remainder that
/// does come back would leave the swing of the filter in the first of two passes).
#[must_use]
pub fn tone(session: &Session, order: &[usize], filtered: &[f64], beside: &[f64]) -> Option<Tone> {
    strongest(even_runs(session, order, (filtered, beside), Band::Vibration), LOWEST_HZ, f64::INFINITY)
}

/// A cycle in time of readings at one place, slower than a vibration, such as that of a cooling unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cycle {
    /// Period, s.
    pub period_s: f64,
    /// Largest amplitude of a run along one direction, um.
    pub amplitude_um: f64,
    /// Its mean square over all readings, um^2.
    pub mean_square_um2: f64,
}

/// The strongest cycle that chance does not bring, over all evenly sampled runs at one place. `filtered` is what is left, whitened, for
/// the readings `order`; `left_um` the same in um for all readings of the session.
#[must_use]
pub fn cycle(session: &Session, order: &[usize], filtered: &[f64], left_um: &[f64]) -> Option<Cycle> {
    let mut runs = even_runs(session, order, (filtered, filtered), Band::Slow);
    let span_s = |run: &Even| run.values.len() as f64 * run.step;
    let longest_s = runs.iter().map(span_s).fold(0.0, f64::max);
    runs.retain(|run| 2.0 * span_s(run) >= longest_s);
    let slowest_hz = runs.iter().map(|run| run.slowest_hz).fold(0.0, f64::max);
    let rows: Vec<Vec<usize>> = runs.iter().map(|run| run.rows.clone()).collect();
    let line = strongest(runs, 0.0, LOWEST_HZ)?;
    // what is slower than any cycle has most power at the slowest
    if line.chance >= LINE_CHANCE || line.frequency_hz < EDGE * slowest_hz {
        return None;
    }
    let amplitude_um = |rows: &Vec<usize>| {
        let n = rows.len() as f64;
        let mean = rows.iter().map(|i| left_um[*i]).sum::<f64>() / n;
        let add = |(re, im): (f64, f64), i: &usize| {
            let (sin, cos) = (TAU * line.frequency_hz * session.moments[*i].t_s).sin_cos();
            (re + (left_um[*i] - mean) * cos, im + (left_um[*i] - mean) * sin)
        };
        let (re, im) = rows.iter().fold((0.0, 0.0), add);
        2.0 * re.hypot(im) / n
    };
    let each: Vec<f64> = rows.iter().map(amplitude_um).collect();
    let sum: f64 = rows.iter().zip(&each).map(|(rows, a)| 0.5 * a * a * rows.len() as f64).sum();
    Some(Cycle {
        period_s: 1.0 / line.frequency_hz,
        amplitude_um: each.into_iter().fold(0.0, f64::max),
        mean_square_um2: sum / order.len() as f64,
    })
}

fn strongest(mut runs: Vec<Even>, lowest_hz: f64, highest_hz: f64) -> Option<Tone> {
    let step = runs.iter().map(|r| r.step).fold(f64::INFINITY, f64::min);
    runs.retain(|r| r.step < 1.5 * step);
    let longest = runs.iter().map(|r| r.values.len()).max()?;
    let long = runs.iter().filter(|r| 2 * r.values.len() >= longest);
    let low = long.map(|r| r.slowest_hz).fold(lowest_hz, f64::max);
    let high = (0.5 / step).min(highest_hz);
    if low >= high {
        return None;
    }
    let total: usize = runs.iter().map(|r| r.rows.len()).sum();
    let places: usize = runs.iter().map(|r| r.values.len()).sum();
    let count = longest.min(WORK / places.max(1)).max(16);
    let frequency = |k: usize| low + (high - low) * k as f64 / count as f64;
    let powers: Vec<f64> =
        (0..count).map(|k| runs.iter().map(|r| periodogram(r, frequency(k))).sum()).collect();
    let top = (0..count).max_by(|a, b| powers[*a].total_cmp(&powers[*b]))?;
    let mut best = (frequency(top), powers[top]);
    // a line stands above its neighbourhood; a slope of the spectrum does not
    let reach = (count / 8).max(8);
    let mut around: Vec<f64> = (top.saturating_sub(reach)..(top + reach).min(count))
        .filter(|k| k.abs_diff(top) > 3)
        .map(|k| powers[k])
        .collect();
    let level = (super::median(&mut around) / (runs.len() as f64 - 0.31)).max(1.0);
    // finer, around the strongest
    let width = (high - low) / count as f64;
    for k in -8..=8 {
        let f = best.0 + width * f64::from(k) / 8.0;
        let power: f64 = runs.iter().map(|r| periodogram(r, f)).sum();
        if power > best.1 {
            best = (f, power);
        }
    }
    best.1 /= level;
    let chance = (chi_square_upper(2.0 * best.1, 2 * runs.len()) * (3 * count) as f64).min(1.0);
    // power of a line of amplitude A over n samples: n A^2 / 4 each
    let excess = (best.1 - runs.len() as f64).max(0.0);
    Some(Tone { frequency_hz: best.0, amplitude: (4.0 * excess * level / total as f64).sqrt(), chance })
}

/// Mean 1 for white noise of unit variance.
fn periodogram(run: &Even, f: f64) -> f64 {
    let (ds, dc) = (TAU * f * run.step).sin_cos();
    let (mut s, mut c) = (0.0f64, 1.0f64);
    let (mut re, mut im) = (0.0, 0.0);
    for v in &run.values {
        re += v * c;
        im += v * s;
        (s, c) = (s * dc + c * ds, c * dc - s * ds);
    }
    (re * re + im * im) / run.rows.len() as f64
}
