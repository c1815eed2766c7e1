//! Causes that do not repeat: outliers, rounding, vibration, noise that grows with the range. They belong to the
//! simulator, never to the compensator.

use std::collections::BTreeMap;

use super::library::{Effect, Kind, Label, Without};
use super::noise::{ClassNoise, Tone, angle_noise, pair_residuals, range_noise, tails, tone};
use super::report::{Cause, Value};
use super::session::Session;

/// Fewest outliers that are a cause, and their least share: 0.3 % of the pairs of repeats.
const OUTLIERS: (usize, f64) = (8, 0.0015);
/// Outliers must be this many times as many as heavy tails of the noise would bring, this many standard deviations, and so
/// many of them (of two repeats one counts).
const BEYOND_TAILS: (f64, f64, f64) = (2.0, 3.0, 5.0);
/// Share of the readings left out that look along one axis, and share of all others, from which to which that axis is to blame.
const ONE_AXIS: [f64; 2] = [0.9, 0.6];
/// Probability of outliers that look along one axis.
const ONE_AXIS_PROBABILITY: f64 = 0.3;
/// Share of the readings left out that follow a jump from which they are no single ones.
const IN_BLOCKS: f64 = 0.5;
/// Rounding is a cause where its own scatter is at least this share of the noise.
const ROUNDING: f64 = 0.4;
/// Least step that is called rounding, um, and its least share of the gap.
const STEP: (f64, f64) = (0.02, 0.02);
/// Largest chance of a line in the spectrum.
const CHANCE: f64 = 1e-5;
/// Least amplitude of a vibration, in standard deviations of the noise.
const AMPLITUDE: f64 = 0.2;
/// Least amplitude beside rounding, in steps: between two steps a slow change looks like a line.
const AMPLITUDE_STEPS: f64 = 0.5;
/// Standard deviations by which noise must grow with the range, and the least power.
const GROWTH: (f64, f64) = (6.0, 0.2);
/// Evidence from which the noise of a tracker's angles is a cause: five standard deviations.
const ANGLE_EVIDENCE: f64 = 24.0;

/// What the tests look at.
pub(super) struct Evidence<'a> {
    pub(super) session: &'a Session,
    pub(super) gap: &'a [f64],
    pub(super) used: &'a [bool],
    /// Readings left out.
    pub(super) outlying: &'a [usize],
    pub(super) lattice_um: &'a [f64],
    pub(super) noise: &'a [ClassNoise],
    /// Rows and whitened remainder.
    pub(super) rows: &'a [usize],
    pub(super) left: &'a [f64],
    /// What of it does not come back with repeats, whitened.
    pub(super) beside: &'a [f64],
    pub(super) rms_um: f64,
}

impl Evidence<'_> {
    /// False where an instrument always reads the same: that shows no step.
    fn varies(&self, class: usize) -> bool {
        let mut of = self.session.readings.iter().filter(|r| r.instrument == class).map(|r| r.deviation_um);
        of.next().is_some_and(|first| of.any(|v| (v - first).abs() > 1e-9))
    }
}

/// What shakes the machine, by what is left of its readings beside all that was found.
pub(super) fn shaking(session: &Session, rows: &[usize], left: &[f64], beside: &[f64]) -> Option<Tone> {
    tone(session, rows, left, beside).filter(|t| t.chance < CHANCE && t.amplitude > AMPLITUDE)
}

/// Scatter by the rounding of a display with this step, um, where it is a cause beside the noise.
pub(super) fn rounding(step_um: f64, noise: &ClassNoise) -> Option<f64> {
    let own = step_um / 12f64.sqrt();
    (step_um >= STEP.0 && own >= ROUNDING * noise.white_um).then_some(own)
}

fn cause(effect: &'static str, probability: f64, parameters: &[(&str, f64, f64)]) -> Cause {
    Cause {
        effect: effect.to_owned(),
        subject: String::new(),
        kind: Kind::Stochastic,
        probability,
        declared: true,
        confounded_with: Vec::new(),
        re_expression_of: Vec::new(),
        parameters: parameters
            .iter()
            .map(|(n, value, std)| ((*n).to_owned(), Value { value: *value, std: *std }))
            .collect::<BTreeMap<_, _>>(),
        shrink: 0.0,
        remark: String::new(),
        tests: None,
    }
}

/// False where the noise is merely heavy-tailed, of all readings and of each class: then single wild readings are its tails
/// and no cause of their own.
fn beyond_tails(e: &Evidence<'_>) -> bool {
    let (times, deviations, least) = BEYOND_TAILS;
    tails(e.session, e.gap, e.lattice_um).iter().any(|t| {
        t.beyond >= least && t.beyond > (times * t.expected).max(t.expected + deviations * t.expected.sqrt())
    })
}

/// A reading is no single one where it differs from one neighbour by less than this share of what it differs from the other.
const ONE_SIDED: f64 = 0.4;

/// Share of the readings left out that one of their neighbours in the same run and direction resembles: what differs from its
/// repeats jumps there and stays.
fn in_blocks(e: &Evidence<'_>) -> f64 {
    let apart = pair_residuals(e.session, e.gap, &vec![true; e.gap.len()]);
    let mut rows: BTreeMap<(usize, usize), Vec<usize>> = BTreeMap::new();
    for (i, r) in e.session.readings.iter().enumerate().filter(|(i, _)| apart[*i].is_finite()) {
        rows.entry((r.run, e.session.moments[i].u.iamax())).or_default().push(i);
    }
    let is_jump = |w: &&[usize]| {
        let [before, after] = [w[0], w[2]].map(|j| (apart[w[1]] - apart[j]).abs());
        !e.used[w[1]] && before.min(after) < ONE_SIDED * before.max(after)
    };
    let jumps = rows.values().flat_map(|r| r.windows(3)).filter(is_jump).count();
    jumps as f64 / e.outlying.len().max(1) as f64
}

/// The direction of nearly all readings that were left out, where those that were kept look elsewhere, too: it is then the
/// motion there that does not come back to the same place, such as an axis that sticks.
fn along_one(e: &Evidence<'_>) -> Option<char> {
    let along = |rows: &mut dyn Iterator<Item = usize>| {
        let mut count = [0usize; 3];
        rows.for_each(|i| count[e.session.moments[i].u.iamax()] += 1);
        count.map(|c| c as f64 / count.iter().sum::<usize>().max(1) as f64)
    };
    let out = along(&mut e.outlying.iter().copied());
    let kept = along(&mut (0..e.gap.len()).filter(|i| e.used[*i]));
    (0..3).find(|k| out[*k] > ONE_AXIS[0] && kept[*k] < ONE_AXIS[1]).map(|k| ['x', 'y', 'z'][k])
}

/// The stochastic causes that are there.
pub(super) fn causes(e: &Evidence<'_>, without: &[Without]) -> Vec<Cause> {
    let mut found = Vec::new();
    let n = e.gap.len();
    let outlying = e.outlying.len();
    let many = outlying >= OUTLIERS.0 && outlying as f64 >= OUTLIERS.1 * n as f64;
    if many && beyond_tails(e) {
        let share = outlying as f64 / n as f64;
        let std = (share / n as f64).sqrt();
        let mut wild = cause("outliers", 0.95, &[("share_percent", 100.0 * share, 100.0 * std)]);
        if in_blocks(e) > IN_BLOCKS {
            (wild.declared, wild.probability) = (false, ONE_AXIS_PROBABILITY);
            wild.remark =
                "most of them follow each other: something jumps and stays, no wild readings".to_owned();
        } else if let Some(axis) = along_one(e) {
            (wild.declared, wild.probability) = (false, ONE_AXIS_PROBABILITY);
            wild.remark = format!("nearly all along {axis}: an axis that does not repeat, no wild readings");
        }
        found.push(wild);
    }
    for (class, step) in e.lattice_um.iter().enumerate() {
        if e.varies(class) && *step >= STEP.1 * e.rms_um && rounding(*step, &e.noise[class]).is_some() {
            found.push(cause("quantisation", 0.95, &[("step_um", *step, 0.0)]));
            break;
        }
    }
    let white = e.noise.iter().map(|c| c.white_um).fold(0.0, f64::max);
    let rounding =
        found.iter().filter_map(|c| c.parameters.get("step_um")).map(|v| v.value).fold(0.0, f64::max);
    if let Some(t) = shaking(e.session, e.rows, e.left, e.beside)
        && t.amplitude * white > AMPLITUDE_STEPS * rounding
    {
        let probability = if t.chance < 1e-8 { 0.95 } else { 0.85 };
        let amplitude = t.amplitude * white;
        found.push(cause(
            "vibration",
            probability,
            &[("frequency_hz", t.frequency_hz, 0.0), ("amplitude_um", amplitude, 0.2 * amplitude)],
        ));
    }
    let residuals = pair_residuals(e.session, e.gap, e.used);
    let by_range = range_noise(e.session, &residuals)
        .filter(|r| r.exponent > GROWTH.1 && r.exponent > GROWTH.0 * r.std)
        .map(|r| ("exponent_1", r.exponent, r.std));
    let by_angle = || {
        let a = angle_noise(e.session, &residuals).filter(|a| a.evidence > ANGLE_EVIDENCE)?;
        Some(("across_um_per_m", a.um_per_m, 0.5 * a.um_per_m / a.evidence.sqrt()))
    };
    if let Some(parameter) = by_range.or_else(by_angle) {
        found.push(cause("range-noise", 0.9, &[parameter]));
    }
    found.retain(|c| {
        Effect::find(&c.effect).is_some_and(|e| !without.iter().any(|w| w.covers(&Label::new(e.name, ""))))
    });
    found
}
