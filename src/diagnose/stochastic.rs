//! Causes that do not repeat: outliers, rounding, vibration, noise that grows with the range. They belong to the
//! simulator, never to the compensator.

use std::collections::BTreeMap;

use super::constants::{
    BEYOND_TAILS, FEW, HALF, LINE_CHANCE, ONE_AXIS, OUTLIERS_SHARE, PASSED, STEP_UM, STRONG, TOLD,
};
use super::library::{Effect, Kind, Label, Without};
use super::noise::{ClassNoise, Tone, angle_noise, pair_residuals, range_noise, tails, tone};
use super::report::{Cause, Value};
use super::session::Session;

/// What the tests look at.
pub(super) struct Evidence<'a> {
    pub(super) session: &'a Session,
    /// The gap without the causes declared.
    pub(super) left_um: &'a [f64],
    pub(super) used: &'a [bool],
    /// Readings left out.
    pub(super) outlying: &'a [usize],
    pub(super) lattice_um: &'a [f64],
    /// Noise of a reading of each instrument class.
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
fn shaking(session: &Session, rows: &[usize], left: &[f64], beside: &[f64]) -> Option<Tone> {
    tone(session, rows, left, beside).filter(|t| t.chance < LINE_CHANCE && 2.0 * t.amplitude > HALF)
}

/// Scatter by the rounding of a display with this step, um, where it is a cause beside the noise.
fn rounding(step_um: f64, reading_um: f64) -> Option<f64> {
    let own = step_um / 12f64.sqrt();
    (step_um >= STEP_UM && own >= HALF * reading_um).then_some(own)
}

fn cause(effect: &'static str, probability: f64, parameters: &[(&str, f64, f64)]) -> Cause {
    Cause {
        effect: effect.to_owned(),
        subject: String::new(),
        kind: Kind::Stochastic,
        probability,
        declared: true,
        confounded_with: Vec::new(),
        group_probability: None,
        re_expression_of: Vec::new(),
        sources: Vec::new(),
        parameters: parameters
            .iter()
            .map(|(n, value, std)| ((*n).to_owned(), Value { value: *value, std: *std }))
            .collect::<BTreeMap<_, _>>(),
        shrink: 0.0,
        remark: String::new(),
        tests: None,
    }
}

/// False where the noise is merely heavy-tailed, of all readings and of each class: then single outliers are its tails
/// and no cause of their own.
fn beyond_tails(e: &Evidence<'_>) -> bool {
    let [times, deviations, least] = BEYOND_TAILS;
    let tails = tails(e.session, e.left_um, e.lattice_um, e.used);
    tails.iter().flat_map(|t| t.beyond.into_iter().zip(t.expected)).any(|(beyond, expected)| {
        beyond >= least && beyond > (times * expected).max(expected + deviations * expected.sqrt())
    })
}

/// Share of the readings left out that one of their neighbours in the same run and direction resembles: what differs from its
/// repeats jumps there and stays.
fn in_blocks(e: &Evidence<'_>) -> f64 {
    let apart = pair_residuals(e.session, e.left_um, &vec![true; e.left_um.len()]);
    let mut rows: BTreeMap<(usize, usize), Vec<usize>> = BTreeMap::new();
    for (i, r) in e.session.readings.iter().enumerate().filter(|(i, _)| apart[*i].is_finite()) {
        rows.entry((r.run, e.session.moments[i].u.iamax())).or_default().push(i);
    }
    let is_jump = |w: &&[usize]| {
        let [before, after] = [w[0], w[2]].map(|j| (apart[w[1]] - apart[j]).abs());
        !e.used[w[1]] && before.min(after) < HALF * before.max(after)
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
    let kept = along(&mut (0..e.left_um.len()).filter(|i| e.used[*i]));
    (0..3).find(|k| out[*k] > ONE_AXIS[0] && kept[*k] < ONE_AXIS[1]).map(|k| ['x', 'y', 'z'][k])
}

/// The stochastic causes that are there.
pub(super) fn causes(e: &Evidence<'_>, without: &[Without]) -> Vec<Cause> {
    let mut found = Vec::new();
    let n = e.left_um.len();
    let outlying = e.outlying.len();
    // a few are listed, many are a cause
    let least = (OUTLIERS_SHARE * n as f64).max((TOLD * n as f64).min(FEW as f64));
    if outlying as f64 >= least && beyond_tails(e) {
        let share = outlying as f64 / n as f64;
        let std = (share / n as f64).sqrt();
        let mut cause = cause("outliers", PASSED[0], &[("share_percent", 100.0 * share, 100.0 * std)]);
        if 2.0 * in_blocks(e) > 1.0 {
            (cause.declared, cause.probability) = (false, PASSED[1]);
            cause.remark =
                "most of them follow each other: something jumps and stays, no outliers".to_owned();
        } else if let Some(axis) = along_one(e) {
            (cause.declared, cause.probability) = (false, PASSED[1]);
            cause.remark = format!("nearly all along {axis}: an axis that does not repeat, no outliers");
        }
        found.push(cause);
    }
    for (class, step) in e.lattice_um.iter().enumerate() {
        if e.varies(class) && *step >= TOLD * e.rms_um && rounding(*step, e.noise[class].white_um).is_some() {
            found.push(cause("quantisation", PASSED[0], &[("step_um", *step, 0.0)]));
            break;
        }
    }
    let white = e.noise.iter().map(|c| c.white_um).fold(0.0, f64::max);
    let rounding =
        found.iter().filter_map(|c| c.parameters.get("step_um")).map(|v| v.value).fold(0.0, f64::max);
    if let Some(t) = shaking(e.session, e.rows, e.left, e.beside)
        && 2.0 * t.amplitude * white > rounding
    {
        let amplitude = t.amplitude * white;
        found.push(cause(
            "vibration",
            if t.chance < 1e-8 { PASSED[0] } else { 0.85 },
            &[("frequency_hz", t.frequency_hz, 0.0), ("amplitude_um", amplitude, 0.2 * amplitude)],
        ));
    }
    let residuals = pair_residuals(e.session, e.left_um, e.used);
    let by_range = range_noise(e.session, &residuals)
        .filter(|r| r.evidence > STRONG)
        .map(|r| ("exponent_1", r.exponent, r.exponent / r.evidence.sqrt()));
    let by_angle = || {
        let a = angle_noise(e.session, &residuals).filter(|a| a.evidence > STRONG)?;
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
