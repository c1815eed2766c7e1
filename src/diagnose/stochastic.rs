//! Causes that do not repeat: outliers, rounding, vibration, noise that grows with the range. They belong to the
//! simulator, never to the compensator.

use std::collections::BTreeMap;

use super::library::{Kind, Label, Without};
use super::noise::{ClassNoise, pair_residuals, range_noise, tails, tone};
use super::report::{Cause, Value};
use super::session::Session;

/// Fewest outliers that are a cause, and their least share.
const OUTLIERS: (usize, f64) = (8, 0.003);
/// Outliers must be this many times as many as heavy tails of the noise would bring, and this many standard deviations.
const BEYOND_TAILS: (f64, f64) = (2.0, 3.0);
/// Rounding is a cause where its own scatter is at least this share of the noise.
const ROUNDING: f64 = 0.5;
/// Least step that is called rounding, um, and its least share of the gap.
const STEP: (f64, f64) = (0.02, 0.02);
/// Largest chance of a line in the spectrum.
const CHANCE: f64 = 1e-5;
/// Least amplitude of a vibration, in standard deviations of the noise.
const AMPLITUDE: f64 = 0.2;
/// Standard deviations by which noise must grow with the range, and the least power.
const GROWTH: (f64, f64) = (6.0, 0.2);

/// What the tests look at.
pub(super) struct Evidence<'a> {
    pub(super) session: &'a Session,
    pub(super) gap: &'a [f64],
    pub(super) used: &'a [bool],
    pub(super) outlying: usize,
    pub(super) lattice_um: &'a [f64],
    pub(super) noise: &'a [ClassNoise],
    /// Rows and whitened remainder.
    pub(super) rows: &'a [usize],
    pub(super) left: &'a [f64],
    pub(super) rms_um: f64,
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

/// False where the noise is merely heavy-tailed: then single wild readings are its tails and no cause of their own.
fn beyond_tails(e: &Evidence<'_>) -> bool {
    let t = tails(e.session, e.gap);
    t.beyond > (BEYOND_TAILS.0 * t.expected).max(t.expected + BEYOND_TAILS.1 * t.expected.sqrt())
}

/// The stochastic causes that are there.
pub(super) fn causes(e: &Evidence<'_>, without: &[Without]) -> Vec<Cause> {
    let mut found = Vec::new();
    let n = e.gap.len();
    let many = e.outlying >= OUTLIERS.0 && e.outlying as f64 >= OUTLIERS.1 * n as f64;
    if many && beyond_tails(e) {
        let share = e.outlying as f64 / n as f64;
        let std = (share / n as f64).sqrt();
        found.push(cause("outliers", 0.95, &[("share_percent", 100.0 * share, 100.0 * std)]));
    }
    for (class, step) in e.lattice_um.iter().enumerate() {
        let own = step / 12f64.sqrt();
        if *step >= STEP.0 && *step >= STEP.1 * e.rms_um && own >= ROUNDING * e.noise[class].white_um {
            found.push(cause("quantisation", 0.95, &[("step_um", *step, 0.0)]));
            break;
        }
    }
    if let Some(t) = tone(e.session, e.rows, e.left)
        && t.chance < CHANCE
        && t.amplitude > AMPLITUDE
    {
        let white = e.noise.iter().map(|c| c.white_um).fold(0.0, f64::max);
        let probability = if t.chance < 1e-8 { 0.95 } else { 0.85 };
        let amplitude = t.amplitude * white;
        found.push(cause(
            "vibration",
            probability,
            &[("frequency_hz", t.frequency_hz, 0.0), ("amplitude_um", amplitude, 0.2 * amplitude)],
        ));
    }
    let residuals = pair_residuals(e.session, e.gap, e.used);
    if let Some(r) = range_noise(e.session, &residuals)
        && r.exponent > GROWTH.1
        && r.exponent > GROWTH.0 * r.std
    {
        found.push(cause("range-noise", 0.9, &[("exponent_1", r.exponent, r.std)]));
    }
    found.retain(|c| {
        super::library::page(&c.effect)
            .is_some_and(|p| !without.iter().any(|w| w.covers(&Label::new(p.effect, ""))))
    });
    found
}
