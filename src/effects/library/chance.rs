//! Effects that do not repeat: tests of their own find them, and no formula predicts them.

use crate::data::no_formula;
use crate::prelude::*;

/// What is known of vibration.
pub(crate) static VIBRATION: Effect = Effect {
    name: "vibration",
    title: "vibration",
    synonyms: "tonal tone chatter",
    kind: Kind::Stochastic,
    subjects: Subjects::Whole,
    cause: "A rotating part or the hall shakes the machine.",
    formula: "A sin(2 pi f t + phase)",
    looks_like: "A line in the spectrum of a capture, with another phase in each run.",
    confused_with: "harmonics of a rotary axis, where readings are timed evenly",
    settles: "A fast capture at rest; random dwell between readings.",
    changes_with: &[],
    remedy: "find the source at this frequency; isolate, balance or damp it",
    variants: no_formula,
};

/// What is known of outliers.
pub(crate) static OUTLIERS: Effect = Effect {
    name: "outliers",
    title: "outliers",
    synonyms: "dropouts spikes",
    kind: Kind::Stochastic,
    subjects: Subjects::Whole,
    cause: "Single readings are wrong: chips, a lost beam, start-up.",
    formula: "rare, large",
    looks_like: "Few readings far from their repeats.",
    confused_with: "heavy-tailed noise",
    settles: "Clean the optics and repeat; look at the listed readings.",
    changes_with: &[],
    remedy: "check mounting, beam and trigger; repeat these readings",
    variants: no_formula,
};

/// What is known of rounding.
pub(crate) static QUANTISATION: Effect = Effect {
    name: "quantisation",
    title: "quantisation of the readings",
    synonyms: "quantization rounding resolution",
    kind: Kind::Stochastic,
    subjects: Subjects::Whole,
    cause: "Readings are rounded to a step that is large against the noise.",
    formula: "multiples of q",
    looks_like: "Steps in the readings.",
    confused_with: "cyclic errors of an encoder",
    settles: "Another resolution of the instrument.",
    changes_with: &[Measurement::FineSteps],
    remedy: "finer resolution of display or file",
    variants: no_formula,
};

/// What is known of noise that depends on the distance.
pub(crate) static RANGE_NOISE: Effect = Effect {
    name: "range-noise",
    title: "noise that grows with the range",
    synonyms: "tracker-noise angular-noise",
    kind: Kind::Stochastic,
    subjects: Subjects::Whole,
    cause: "The scatter grows with the distance.",
    formula: "std ~ range^k",
    looks_like: "Noise at far points.",
    confused_with: "noise of the instrument as such",
    settles: "Repeats at two ranges.",
    changes_with: &[],
    remedy: "shorter range, longer averaging",
    variants: no_formula,
};
