//! Motion from the order of the rows: velocities, accelerations, direction of travel, distance and time since reversal.
//!
//! A sample is a group of consecutive rows of one run with the same time (a reading in three directions is one sample of
//! three rows). Speeds are differences of commanded positions, on circles of the angle, and only taken where the samples show
//! the path between them; other rows are readings at standstill. Nothing is differentiated across a gap.

use volcomp_model::geometry::Vec3;

use super::super::constants::{
    ACCELERATION_NOISE, BEND, FAST_MOVING_S, FAST_S, FEW, LITTLE, ROWS, SIGNIFICANT,
};
use super::super::moment::{Axis, Signal, Source};
use super::circle::Circle;
use super::history::along_log;

/// A step of time above so many medians is a gap.
const GAP: f64 = 4.0;

/// Width of a step of the velocity, in samples.
const STEP: f64 = 1e-6;

/// Rows of one sample.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sample {
    pub(super) first: usize,
    pub(super) end: usize,
    pub(super) t: f64,
}

/// The samples of rows `first..end`, which belong to one run.
pub(super) fn samples(t: &[f64], first: usize, end: usize) -> Vec<Sample> {
    let mut found: Vec<Sample> = Vec::new();
    for (i, t) in t.iter().enumerate().take(end).skip(first) {
        match found.last_mut() {
            Some(s) if s.t == *t => s.end = i + 1,
            _ => found.push(Sample { first: i, end: i + 1, t: *t }),
        }
    }
    found
}

/// Whether the machine moves at the rows of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Moves {
    /// The file states it, by `moving` or by velocities.
    Stated,
    /// The instrument is read in motion on circles, at rest elsewhere.
    OnCircles,
    /// Only fast samples are taken in motion.
    Unknown,
}

/// One run: its samples, and how the machine moves at them.
#[derive(Debug)]
pub(super) struct Run {
    pub(super) samples: Vec<Sample>,
    /// Per sample: no axis is elsewhere than at the sample before.
    pub(super) stays: Vec<bool>,
    /// Its path has corners, as those of a grid, or of what follows a turning table, have.
    pub(super) has_corners: bool,
    /// The samples show the path between them.
    pub(super) in_motion: bool,
    /// The circle that the linear axes move along.
    pub(super) circle: Option<Circle>,
}

impl Run {
    /// The run of rows `first..end`, with the position of each axis per row.
    pub(super) fn of(
        t: &[f64],
        [first, end]: [usize; 2],
        positions: &[(Axis, &[f64])],
        moves: Moves,
    ) -> Self {
        let samples = samples(t, first, end);
        let stays = stays(&samples, positions);
        let has_corners = has_corners(&samples, positions);
        let step = median_step(&samples);
        if samples.len() < FEWEST || moves == Moves::Unknown && step > FAST_S {
            return Self { samples, stays, has_corners, in_motion: false, circle: None };
        }
        let place = |s: &Sample| {
            let mut place = Vec3::zeros();
            for (axis, position) in positions.iter().filter(|(axis, _)| axis.is_linear()) {
                place[axis.slot()] = position[s.first];
            }
            place
        };
        let circle = Circle::of(&samples, &samples.iter().map(place).collect::<Vec<_>>());
        let in_motion = step <= FAST_S
            || circle.is_some()
            || moves == Moves::Stated && (step <= FAST_MOVING_S || is_smooth(&samples, positions));
        Self { circle: circle.filter(|_| in_motion), samples, stays, has_corners, in_motion }
    }
}

/// Per sample: every axis is where it was at the sample before.
fn stays(samples: &[Sample], positions: &[(Axis, &[f64])]) -> Vec<bool> {
    let stays = |k: usize| {
        let Some(before) = k.checked_sub(1) else { return false };
        positions.iter().all(|(_, p)| (p[samples[k].first] - p[samples[before].first]).abs() <= MOVED)
    };
    (0..samples.len()).map(stays).collect()
}

/// True where the linear axes leave the straight line through the first sample and the one farthest from it.
fn has_corners(samples: &[Sample], positions: &[(Axis, &[f64])]) -> bool {
    let Some(first) = samples.first() else { return false };
    let from_first = |s: &Sample| {
        let mut from = Vec3::zeros();
        for (axis, p) in positions.iter().filter(|(axis, _)| axis.is_linear()) {
            from[axis.slot()] = p[s.first] - p[first.first];
        }
        from
    };
    let all = || samples.iter().map(from_first);
    let farthest = all().fold(Vec3::zeros(), |most, p| if p.norm() > most.norm() { p } else { most });
    let length = farthest.norm();
    length > MOVED && all().any(|p| p.cross(&farthest).norm() > LITTLE * length * length)
}

/// Samples from which a motion is derived at least.
const FEWEST: usize = 5;

/// True where the velocity changes little from step to step.
fn is_smooth(samples: &[Sample], positions: &[(Axis, &[f64])]) -> bool {
    let is_steady = |w: &&[Sample]| {
        let [mut change, mut square] = [0.0; 2];
        for (_, p) in positions {
            let velocity = |k: usize| (p[w[k + 1].first] - p[w[k].first]) / (w[k + 1].t - w[k].t);
            let (before, after) = (velocity(0), velocity(1));
            change += (after - before).powi(2);
            square += f64::midpoint(before * before, after * after);
        }
        change.sqrt() < BEND * square.sqrt()
    };
    let steady = samples.windows(3).filter(is_steady).count();
    (samples.len() - 2 - steady) as f64 <= LITTLE * samples.len() as f64
}

fn median_step(samples: &[Sample]) -> f64 {
    let mut steps: Vec<f64> = samples.windows(2).map(|w| w[1].t - w[0].t).collect();
    if steps.is_empty() {
        return f64::INFINITY;
    }
    steps.sort_by(f64::total_cmp);
    steps[steps.len() / 2]
}

/// Velocity and acceleration per sample from positions per sample.
pub(super) fn derivatives(samples: &[Sample], position: &[f64]) -> (Vec<f64>, Vec<f64>) {
    derivatives_to(samples, position, resolution(position))
}

/// The same, of positions that are rounded to a `resolution`.
pub(super) fn derivatives_to(samples: &[Sample], position: &[f64], resolution: f64) -> (Vec<f64>, Vec<f64>) {
    let n = samples.len();
    let (mut velocity, mut acceleration) = (vec![0.0; n], vec![0.0; n]);
    let step = median_step(samples);
    let h = span(resolution, step);
    let mut first = 0;
    while first < n {
        let mut end = first + 1;
        while end < n && samples[end].t - samples[end - 1].t <= GAP * step {
            end += 1;
        }
        for i in first..end {
            let k = h.min(i - first).min(end - 1 - i);
            if k == 0 {
                continue;
            }
            let (a, b) = (i - k, i + k);
            let (dt0, dt1) = (samples[i].t - samples[a].t, samples[b].t - samples[i].t);
            let (s0, s1) = ((position[i] - position[a]) / dt0, (position[b] - position[i]) / dt1);
            velocity[i] = (position[b] - position[a]) / (dt0 + dt1);
            acceleration[i] = 2.0 * (s1 - s0) / (dt0 + dt1);
        }
        if end - first > 2 {
            // the parabola through the first three samples, and through the last
            for (i, next) in [(first, first + 1), (end - 1, end - 2)] {
                acceleration[i] = acceleration[next];
                velocity[i] = velocity[next] + acceleration[next] * (samples[i].t - samples[next].t);
            }
        }
        first = end;
    }
    (velocity, acceleration)
}

/// Velocity over time: of set points of a control, `linear` from cycle to cycle, a step at each; else straight lines between
/// the mean velocities of each two samples.
pub(super) fn velocities(samples: &[Sample], position: &[f64], linear: bool) -> Vec<(f64, f64)> {
    let between = samples.windows(2).zip(position.windows(2));
    between
        .flat_map(|(s, p)| {
            let step = s[1].t - s[0].t;
            let ends = if linear { [STEP, 1.0] } else { [0.5, 0.5] };
            ends.map(|share| (s[0].t + share * step, (p[1] - p[0]) / step))
        })
        .collect()
}

/// Half width of the differences: wide enough that the rounding of positions does not drown the acceleration.
fn span(resolution: f64, step: f64) -> usize {
    let needed = (resolution / ACCELERATION_NOISE).sqrt() / step.max(1e-9);
    (needed.ceil() as usize).clamp(1, FEW)
}

/// The coarsest of the coordinates.
pub(super) fn resolution_of(places: &[Vec3]) -> f64 {
    let of = |slot: usize| resolution(&places.iter().map(|p| p[slot]).collect::<Vec<_>>());
    let moves = |slot: &usize| places.iter().any(|p| (p[*slot] - places[0][*slot]).abs() > MOVED);
    (0..3).filter(moves).map(of).fold(1e-9, f64::max)
}

/// The last decimal that values use, 1e-9 to 0.01.
pub(super) fn resolution(position: &[f64]) -> f64 {
    (2..9)
        .map(|d| 10f64.powi(-d))
        .find(|q| position.iter().take(ROWS / 2).all(|p| ((p / q) - (p / q).round()).abs() < 1e-4))
        .unwrap_or(1e-9)
}

/// How long after its command an axis gets there: the least-squares slope of its following error over the velocity, s.
pub(super) fn lag_s(following: &[f64], velocity: &[f64]) -> f64 {
    let seen = following.iter().zip(velocity).filter(|(f, _)| f.is_finite());
    let [product, square] = seen.fold([0.0; 2], |[p, s], (f, v)| [p + f * v, s + v * v]);
    if square > 0.0 { (product / square).max(0.0) } else { 0.0 }
}

/// Responses that are tried: shares of the dead time in the lag, and of the lag of a velocity loop in that of its position loop.
const RESPONSES: [[f64; 2]; 9] = [
    [0.0, 0.0],
    [0.0, 0.15],
    [0.0, 0.3],
    [0.3, 0.0],
    [0.3, 0.15],
    [0.3, 0.3],
    [0.6, 0.0],
    [0.6, 0.2],
    [1.0, 0.0],
];

/// Where a linear axis is that follows its set points with a lag of `lag_s`: behind them as the response says that leaves least of
/// `following`, what it was seen behind by in the unit of the positions (NaN where it was not seen) from `settled_s` on. With it,
/// whether it moves before then as the response says for an axis that went on at its first velocity.
pub(super) fn reached(
    axis: Axis,
    samples: &[Sample],
    position: &[f64],
    following: &[f64],
    [lag_s, settled_s]: [f64; 2],
) -> (Vec<f64>, bool) {
    let entries = velocities(samples, position, true);
    let mut best = (f64::INFINITY, position.to_vec(), true);
    for [dead, inner] in RESPONSES {
        let (dead_time_s, tau_s) = (dead * lag_s, (1.0 - dead) * lag_s);
        let signal =
            Signal { inner_s: inner * tau_s, dead_time_s, ..Signal::of(Source::Velocity(axis), tau_s) };
        let behind = along_log(&entries, &signal, samples.iter().map(|s| s.t));
        let seen = || samples.iter().zip(following).zip(&behind).filter(|((_, f), _)| f.is_finite());
        let settled = || seen().filter(|((s, _), _)| s.t >= settled_s);
        let [product, square, count] = settled().fold([0.0; 3], |[p, s, n], ((_, following), behind)| {
            [p + following * behind, s + behind * behind, n + 1.0]
        });
        let lag_s = if square > 0.0 { product / square } else { 0.0 };
        let left = |((_, following), behind): ((&Sample, &f64), &f64)| (following - lag_s * behind).powi(2);
        let sum: f64 = settled().map(left).sum();
        if sum < best.0 {
            let most = SIGNIFICANT.powi(2) * sum / f64::max(count, 1.0);
            let goes_on =
                seen().take_while(|((s, _), _)| s.t < settled_s).map(left).all(|square| square <= most);
            best = (sum, position.iter().zip(&behind).map(|(p, v)| p - lag_s * v).collect(), goes_on);
        }
    }
    (best.1, best.2)
}

/// Direction of travel (0 before the first move), distance and time since the last reversal, per sample.
pub(super) struct Travel {
    pub(super) direction: Vec<f64>,
    pub(super) since: Vec<f64>,
    pub(super) since_s: Vec<f64>,
}

impl Travel {
    /// Nothing is known of any sample.
    pub(super) fn unknown(n: usize) -> Self {
        Self { direction: vec![0.0; n], since: vec![f64::INFINITY; n], since_s: vec![f64::INFINITY; n] }
    }
}

/// Movement below this is none: mm, deg.
pub(super) const MOVED: f64 = 2e-5;

/// A step this many times as long as the next one towards a vertex is part of a curve; on a parabola it is 2, on a line 1.
const SLOWS: f64 = 1.5;

/// Time and position at which the parabola through three samples turns round; `None` where they go one way.
fn turning_point(samples: &[Sample], position: &[f64], middle: usize) -> Option<[f64; 2]> {
    let (before, after) = (middle.checked_sub(1)?, middle + 1);
    let [t0, t, t1] = [samples.get(before)?.t, samples[middle].t, samples.get(after)?.t];
    let slopes =
        [(position[middle] - position[before]) / (t - t0), (position[after] - position[middle]) / (t1 - t)];
    if slopes[0] * slopes[1] > 0.0 || slopes[0] == slopes[1] {
        return None;
    }
    let velocity = (slopes[0] * (t1 - t) + slopes[1] * (t - t0)) / (t1 - t0);
    let half = (slopes[1] - slopes[0]) / (t1 - t0);
    let since_s = -0.5 * velocity / half;
    Some([t + since_s, position[middle] + 0.5 * velocity * since_s])
}

/// True for the second of two samples at the same place of which the axis approached the first ever slower: it turned round midway.
fn is_past_vertex(position: &[f64], i: usize) -> bool {
    let step = |k: usize| k.checked_sub(1).and_then(|before| Some(position.get(k)? - position[before]));
    let Some([before, here, after]) = step(i - 1).and_then(|before| Some([before, step(i)?, step(i + 1)?]))
    else {
        return false;
    };
    let slows_down = |outer: Option<f64>, inner: f64| outer.is_none_or(|o| o.abs() > SLOWS * inner.abs());
    here.abs() <= MOVED
        && before.abs().min(after.abs()) > MOVED
        && before * after < 0.0
        && slows_down(i.checked_sub(2).and_then(step), before)
        && slows_down(step(i + 2), after)
}

/// True for the second of two readings at the end of a line whose other targets are read once: between them the axis went past the
/// target and came back (ISO 230-2, standard test cycle).
fn is_read_from_both_sides(position: &[f64], i: usize) -> bool {
    let step = |k: usize| position.get(k + 1).map(|next| next - position[k]);
    let Some([before, here, after]) =
        i.checked_sub(2).and_then(|k| Some([step(k)?, step(k + 1)?, step(k + 2)?]))
    else {
        return false;
    };
    let is_doubled_there = step(i + 1).is_some_and(|next| next.abs() <= MOVED);
    here.abs() <= MOVED
        && before.abs() > MOVED
        && after.abs() > MOVED
        && before * after < 0.0
        && !is_doubled_there
}

/// Follows one axis through a run, at rest at each sample or in motion; `given` are directions that the file states, `came` is the way
/// that the axis took to the first sample from where the run before left it (0: unknown).
pub(super) fn travel(run: &Run, position: &[f64], given: Option<&[f64]>, came: f64) -> Travel {
    let Run { samples, stays, has_corners, in_motion, .. } = run;
    let in_motion = *in_motion;
    let n = samples.len();
    let mut t = Travel::unknown(n);
    // a file that states no direction anywhere does not know them: the order of its rows is not that of the machine
    if given.is_some_and(|g| g.iter().all(|d| *d == 0.0)) {
        return t;
    }
    let first_move = position.windows(2).map(|w| w[1] - w[0]).find(|d| d.abs() > MOVED);
    let mut direction = match given {
        Some(g) if g.first().is_some_and(|d| *d != 0.0) => g[0].signum(),
        // a straight line begins with an overrun (standard test cycle), a path with corners where the axes come from
        _ if *has_corners && !in_motion && came != 0.0 => came,
        _ => first_move.map_or(came, f64::signum),
    };
    let (mut since, mut start) = (f64::INFINITY, f64::NEG_INFINITY);
    for i in 0..n {
        let moved = if i > 0 { position[i] - position[i - 1] } else { 0.0 };
        let next = position.get(i + 1).map_or(0.0, |p| p - position[i]);
        // in motion the larger of the steps about a turning point lies on the side of the sample
        let turned = in_motion
            && (moved.abs() > MOVED && moved * next < 0.0 && next.abs() > moved.abs()
                || i > 0 && is_past_vertex(position, i));
        let now = match given {
            Some(g) if g[i] != 0.0 && g[i].is_finite() => g[i].signum(),
            _ if turned => next.signum(),
            _ if moved.abs() > MOVED => moved.signum(),
            // while another axis goes to the next line this one need not leave
            _ if !in_motion && stays[i] && is_read_from_both_sides(position, i) => next.signum(),
            _ => direction,
        };
        if now != direction && direction != 0.0 {
            let middle = if turned { i } else { i.saturating_sub(1) };
            let [t, x] = turning_point(samples, position, middle)
                .filter(|_| in_motion)
                .unwrap_or_else(|| [samples[i.saturating_sub(1)].t, position[i] - moved]);
            (start, since) = (t, (position[i] - x).abs());
        } else {
            since += moved.abs();
        }
        direction = now;
        t.direction[i] = direction;
        t.since[i] = since;
        t.since_s[i] = samples[i].t - start;
    }
    t
}
