//! Noise of each instrument class.
//!
//! First from repeats: what differs between repetitions of a point is noise and drift, whatever the machine does. Then
//! from what the effects leave, because repeats close in time cannot see slow drift. White noise comes from repeats only,
//! where there are any: systematic errors that nobody knows must not pass for noise.

use std::collections::{BTreeMap, BTreeSet};

use super::super::constants::{DECIMALS_UM, FEW, MANY, NEARLY, NOISE_SHARE, REPEATS, ROWS, STRONG};
use super::super::session::{Session, is_encoder};
use super::{ClassNoise, Filter, by_pair, clipped_deviation};

/// Ratios of drift to white noise that are tried.
const RATIOS: [f64; 12] = [0.0, 0.2, 0.35, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 5.0, 8.0, 14.0];
/// Number of correlation times that are tried.
const TIMES: usize = 7;
/// The shortest of them, in times of reading.
const SHORTEST: f64 = 10.0;

/// What differs between repeats, scaled to the size of the noise; NaN where a reading has no partner.
#[must_use]
pub fn pair_residuals(session: &Session, values: &[f64], used: &[bool]) -> Vec<f64> {
    let mut out = vec![f64::NAN; values.len()];
    for rows in by_pair(session, used).iter().filter(|g| g.len() > 1) {
        let mean = rows.iter().map(|i| values[*i]).sum::<f64>() / rows.len() as f64;
        let scale = (rows.len() as f64 / (rows.len() - 1) as f64).sqrt();
        for i in rows {
            out[*i] = (values[*i] - mean) * scale;
        }
    }
    out
}

/// White noise from differences of neighbours: of repeat differences where there are repeats, else of neighbours in space
/// (readings out of order) or third differences in time.
fn white(session: &Session, class: usize, residuals: &[f64], gap: &[f64], used: &[bool]) -> f64 {
    let rows: Vec<usize> =
        (0..gap.len()).filter(|i| used[*i] && session.readings[*i].instrument == class).collect();
    let paired: Vec<usize> = rows.iter().copied().filter(|i| residuals[*i].is_finite()).collect();
    let similar = |a: usize, b: usize| {
        let [m, n] = [a, b].map(|i| &session.moments[i]);
        // the direction of a ballbar turns with its path
        session.readings[a].run == session.readings[b].run
            && (m.is_ballbar && n.is_ballbar || m.u.dot(&n.u) > NEARLY)
    };
    if paired.len() >= 16 && repeats_tell(paired.len(), rows.len()) {
        // rows of one direction follow each other at most three apart (a reading in three directions)
        let mut differences = Vec::new();
        for (k, a) in paired.iter().enumerate() {
            if let Some(b) = paired[k + 1..].iter().take(3).find(|b| similar(*a, **b)) {
                differences.push(residuals[*b] - residuals[*a]);
            }
        }
        if differences.len() >= FEW {
            return clipped_deviation(&differences) / core::f64::consts::SQRT_2;
        }
        let values: Vec<f64> = paired.iter().map(|i| residuals[*i]).collect();
        return clipped_deviation(&values);
    }
    let apart = super::neighbours(session, &rows);
    if apart.len() >= MANY {
        let mut sizes: Vec<f64> = apart.iter().map(|(a, b)| (gap[*a] - gap[*b]).abs()).collect();
        return super::MAD * super::median(&mut sizes) / core::f64::consts::SQRT_2;
    }
    let mut third = Vec::new();
    for stride in [1, 2, 3] {
        for w in rows.windows(3 * stride + 1) {
            let i = [w[0], w[stride], w[2 * stride], w[3 * stride]];
            if i[1..].iter().all(|b| similar(i[0], *b)) {
                third.push(gap[i[3]] - 3.0 * gap[i[2]] + 3.0 * gap[i[1]] - gap[i[0]]);
            }
        }
        if third.len() >= FEW {
            break;
        }
        third.clear();
    }
    if third.len() < FEW {
        let values: Vec<f64> = rows.iter().map(|i| gap[*i]).collect();
        let mean = values.iter().sum::<f64>() / values.len().max(1) as f64;
        return clipped_deviation(&values.iter().map(|v| v - mean).collect::<Vec<_>>());
    }
    let mut sizes: Vec<f64> = third.iter().map(|v: &f64| v.abs()).collect();
    super::MAD * super::median(&mut sizes) / 20f64.sqrt()
}

/// Span of each setup of a class, s, its readings, and how many of them are at times of their own.
fn spans(session: &Session, class: usize) -> Vec<(f64, usize, usize)> {
    let mut span: BTreeMap<usize, (f64, f64, usize, usize)> = BTreeMap::new();
    for (r, m) in session.readings.iter().zip(&session.moments).filter(|(r, _)| r.instrument == class) {
        let e = span.entry(r.setup).or_insert((m.t_s, m.t_s, 0, 1));
        e.2 += 1;
        e.3 += usize::from(m.t_s != e.1);
        e.1 = m.t_s;
    }
    span.into_values().map(|(from, to, all, times)| (to - from, all, times)).collect()
}

/// Correlation times between the step and the length of the setups of a class, s.
fn times(session: &Session, class: usize) -> Vec<f64> {
    let spans = spans(session, class);
    let longest = spans.iter().map(|s| s.0).fold(0.0, f64::max).max(1e-3);
    let step = spans.iter().map(|(span, all, _)| span / *all as f64).fold(f64::INFINITY, f64::min);
    let (low, high) = ((SHORTEST * step).max(longest * 1e-3).max(1e-4), longest);
    (0..TIMES).map(|i| low * (high / low).max(1.0).powf(i as f64 / (TIMES - 1) as f64)).collect()
}

/// What is faster than a few readings follow each other, several directions at one time, is their noise and no drift, s.
fn shortest_s(session: &Session, class: usize) -> f64 {
    let steps = spans(session, class).into_iter().map(|(span, _, times)| span / times as f64);
    SHORTEST * steps.fold(f64::INFINITY, f64::min)
}

/// From which values a drift is found.
enum Values<'a> {
    /// What differs between repeats: its scale is free.
    Repeats,
    /// What the effects leave: no drift faster than repeats follow each other, s, and none that repeats contradict.
    Left { shortest_s: f64, known: Option<Repeated<'a>> },
}

/// The most likely drift of a class for readings `values`; rows of other classes are left out.
fn drift(
    session: &Session,
    class: usize,
    values: &[f64],
    used: &[bool],
    start: ClassNoise,
    of: &Values<'_>,
) -> ClassNoise {
    let (scaled, shortest_s, known) = match of {
        Values::Repeats => (true, shortest_s(session, class), None),
        Values::Left { shortest_s, known } => (false, *shortest_s, known.as_ref()),
    };
    let mut rows: Vec<bool> = (0..values.len())
        .map(|i| used[i] && values[i].is_finite() && session.readings[i].instrument == class)
        .collect();
    thin_runs(session, &mut rows);
    let n = rows.iter().filter(|r| **r).count();
    if n < FEW {
        return start;
    }
    let weight = if scaled { weight_of_repeats(session, &rows) } else { 1.0 };
    let times = times(session, class);
    let mut noise = vec![start; session.instruments.len()];
    let mut best = (f64::INFINITY, start);
    if !scaled {
        noise[class] = start;
        let filter = Filter::new(session, &noise, &rows);
        best.0 = filter.minus_two_log(&filter.column(values));
    }
    for ratio in RATIOS {
        for time in times.iter().copied().filter(|t| ratio == 0.0 || *t >= shortest_s) {
            let trial = ClassNoise { drift_um: ratio * start.white_um, drift_s: time, ..start };
            noise[class] = trial;
            let filter = Filter::new(session, &noise, &rows);
            let e = filter.column(values);
            let (score, scale) = if scaled {
                let s = clipped_deviation(&e).max(1e-12);
                let shifted: Vec<f64> = e.iter().map(|v| v / s).collect();
                (weight * (filter.minus_two_log(&shifted) + 2.0 * n as f64 * s.ln()), s)
            } else {
                (filter.minus_two_log(&e), 1.0)
            };
            let wanted = if ratio > 0.0 && best.1.drift_um == 0.0 { STRONG } else { 1e-9 };
            if score < best.0 - wanted && known.is_none_or(|k| k.allow(trial)) {
                best = (
                    score,
                    ClassNoise {
                        white_um: trial.white_um * scale,
                        drift_um: trial.drift_um * scale,
                        drift_s: time,
                    },
                );
            }
            if ratio == 0.0 {
                break;
            }
        }
    }
    best.1
}

fn thin_runs(session: &Session, rows: &mut [bool]) {
    let n = rows.iter().filter(|r| **r).count();
    let every = n.div_ceil(ROWS);
    if every < 2 {
        return;
    }
    // whole setups stay whole in time: every k-th sample, so that slow drift is still seen
    let mut last = f64::NAN;
    let mut count = 0usize;
    for (i, keep) in rows.iter_mut().enumerate().filter(|(_, r)| **r) {
        if session.moments[i].t_s != last {
            count += 1;
            last = session.moments[i].t_s;
        }
        *keep = count.is_multiple_of(every);
    }
}

/// Values of the readings of one class.
fn of_class(session: &Session, class: usize, values: &[f64]) -> Vec<f64> {
    let all = session.readings.iter().zip(values);
    all.filter(|(r, _)| r.instrument == class).map(|(_, v)| *v).collect()
}

/// Noise from repeats, or from neighbours where there are none. `lattice_um` is the rounding of the readings.
#[must_use]
pub fn from_repeats(session: &Session, gap: &[f64], used: &[bool], lattice_um: &[f64]) -> Vec<ClassNoise> {
    let residuals = pair_residuals(session, gap, used);
    let centred = super::super::offsets::without_offsets(session, gap, used);
    let rms = (gap.iter().map(|v| v * v).sum::<f64>() / gap.len().max(1) as f64).sqrt();
    (0..session.instruments.len())
        .map(|class| {
            let floor = (NOISE_SHARE * rms).max(DECIMALS_UM).max(lattice_um[class] / 12f64.sqrt());
            // noise is part of the gap: neighbours that differ by a mounting's rotation must not make it larger
            let own = super::super::offsets::rms(&of_class(session, class, &centred));
            let white_um = white(session, class, &residuals, gap, used).min(own).max(floor);
            let of_class = (0..gap.len()).filter(|i| used[*i] && session.readings[*i].instrument == class);
            let paired = of_class.clone().filter(|i| residuals[*i].is_finite()).count();
            let time = times(session, class);
            let drift_um = if is_encoder(&session.instruments[class]) { 0.0 } else { white_um };
            let start = ClassNoise { white_um, drift_um, drift_s: time[TIMES / 2 + 1] };
            if paired < 2 * FEW || !repeats_tell(paired, of_class.count()) || drift_um == 0.0 {
                return start;
            }
            let found = drift(session, class, &residuals, used, start, &Values::Repeats);
            ClassNoise { white_um: found.white_um.max(floor), ..found }
        })
        .collect()
}

/// True where enough of some readings are repeats for these to speak for all.
pub fn repeats_tell(repeated: usize, all: usize) -> bool {
    5 * repeated >= all
}

/// True where most readings of a class have partners all over their setup: what then comes back with every repeat is no
/// drift, however much of it the effects leave.
fn repeats_know(session: &Session, class: usize, used: &[bool]) -> bool {
    let mut members: BTreeMap<usize, usize> = BTreeMap::new();
    let (mut all, mut many) = (0usize, 0usize);
    let of_class =
        || session.readings.iter().zip(used).filter(|(r, u)| **u && r.instrument == class).map(|(r, _)| r);
    for p in of_class().filter_map(|r| r.pair) {
        *members.entry(p).or_default() += 1;
    }
    for r in of_class() {
        all += 1;
        many += usize::from(r.pair.is_some_and(|p| members[&p] >= REPEATS));
    }
    2 * many > all
}

/// Share of the residuals of `rows` that counts: those of two partners are one another's mirror.
fn weight_of_repeats(session: &Session, rows: &[bool]) -> f64 {
    let pairs = || session.readings.iter().zip(rows).filter(|(_, row)| **row).filter_map(|(r, _)| r.pair);
    1.0 - pairs().collect::<BTreeSet<usize>>().len() as f64 / pairs().count().max(1) as f64
}

/// What repeats of a class say of its drift: not how large its slow part is, which all repeats share, but how rough it is.
struct Repeated<'a> {
    session: &'a Session,
    class: usize,
    residuals: &'a [f64],
    rows: Vec<bool>,
    /// Median time between partners, s.
    apart_s: f64,
    /// [`weight_of_repeats`] of the rows.
    weight: f64,
    /// Best score that some drift reaches.
    best: f64,
}

impl<'a> Repeated<'a> {
    /// `None` where a class has few repeats.
    fn of(
        session: &'a Session,
        class: usize,
        residuals: &'a [f64],
        used: &[bool],
        start: ClassNoise,
    ) -> Option<Self> {
        let apart_s = 2.0 * separation(session, class, used);
        if apart_s <= 0.0 {
            return None;
        }
        let mut rows: Vec<bool> = (0..residuals.len())
            .map(|i| used[i] && residuals[i].is_finite() && session.readings[i].instrument == class)
            .collect();
        thin_runs(session, &mut rows);
        let weight = weight_of_repeats(session, &rows);
        let mut known = Self { session, class, residuals, rows, apart_s, weight, best: 0.0 };
        known.best = known.score(start).min(known.score(ClassNoise { drift_um: 0.0, ..start }));
        Some(known)
    }

    /// Twice the negative logarithm of the likelihood of the residuals under a drift.
    fn score(&self, drift: ClassNoise) -> f64 {
        // between partners a drift loses what they share, and keeps its roughness
        let change = 1.0 - (-self.apart_s / drift.drift_s).exp();
        let between =
            ClassNoise { drift_um: drift.drift_um * change.sqrt(), drift_s: drift.drift_s * change, ..drift };
        let mut noise = vec![drift; self.session.instruments.len()];
        noise[self.class] = between;
        let filter = Filter::new(self.session, &noise, &self.rows);
        self.weight * filter.minus_two_log(&filter.column(self.residuals))
    }

    /// True where the repeats do not contradict a drift.
    fn allow(&self, drift: ClassNoise) -> bool {
        self.score(drift) <= self.best + STRONG
    }
}

/// Half the median time between partners of a class, s; 0 where it has few. Faster changes show between repeats, so what
/// the effects leave of them and repeats do not show is no drift.
fn separation(session: &Session, class: usize, used: &[bool]) -> f64 {
    let mut last: BTreeMap<usize, (usize, f64)> = BTreeMap::new();
    let mut apart = Vec::new();
    for (i, r) in session.readings.iter().enumerate().filter(|(i, r)| used[*i] && r.instrument == class) {
        let (Some(p), t) = (r.pair, session.moments[i].t_s) else { continue };
        if let Some((run, before)) = last.insert(p, (r.run, t))
            && run != r.run
        {
            apart.push(t - before);
        }
    }
    if apart.len() < 2 * FEW { 0.0 } else { 0.5 * super::median(&mut apart) }
}

/// Drift from what the effects leave, unless repeats tell it or contradict it; white noise stays.
#[must_use]
pub fn from_remainder(
    session: &Session,
    remainder: &[f64],
    used: &[bool],
    noise: &[ClassNoise],
) -> Vec<ClassNoise> {
    let residuals = pair_residuals(session, remainder, used);
    noise
        .iter()
        .enumerate()
        .map(|(class, start)| {
            if is_encoder(&session.instruments[class]) || repeats_know(session, class, used) {
                return *start;
            }
            let known = Repeated::of(session, class, &residuals, used, *start);
            let left = Values::Left { shortest_s: separation(session, class, used), known };
            drift(session, class, remainder, used, *start, &left)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::super::super::machine_state::Machine;
    use super::super::super::session::{History, Raw, Session};
    use super::{shortest_s, weight_of_repeats};

    /// Two repeats of ten points 20 s apart, each read along some directions at one time.
    fn points(directions: usize) -> Session {
        let names = ["t_s", "setup", "run", "repeat", "x_mm", "u_x", "u_y", "u_z", "deviation_um"];
        let mut raw = Raw::made_up("s.csv", &names);
        for k in 0..20 {
            for d in 0..directions {
                let u = [0, 1, 2].map(|axis| if axis == d { 1.0 } else { 0.0 });
                let (repeat, x) = (f64::from(1 + k / 10), f64::from(k % 10));
                let row = [20.0 * f64::from(k), 1.0, repeat, repeat, x, u[0], u[1], u[2], f64::from(k % 3)];
                raw.push("probe", raw.lines.len() as u64 + 2, &row);
            }
        }
        Session::build(&[raw], History::default(), Machine::plain()).expect("a session")
    }

    #[test]
    fn directions_read_at_one_time_make_no_faster_drift() {
        for directions in 1..=3 {
            assert_eq!(shortest_s(&points(directions), 0), 190.0);
        }
    }

    #[test]
    fn of_two_repeats_one_counts() {
        let session = points(3);
        assert_eq!(weight_of_repeats(&session, &vec![true; session.readings.len()]), 0.5);
    }
}
