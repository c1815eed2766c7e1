//! Names and units of ballbar result files (.b5r, `docs/reference/formats.md`) for what was found.

use super::{Analysis, Effect, End, Estimate, Note};

/// A feature in the vocabulary of ballbar result files.
#[derive(Debug, Clone, PartialEq)]
pub struct Feature {
    /// Its name, such as `AF_BACKLASH_A_POS`.
    pub name: String,
    /// The name of its unit there, such as `UT_LENGTH_UM`.
    pub unit: &'static str,
    /// The value in that unit.
    pub value: f64,
    /// Its standard uncertainty (k = 1).
    pub std: f64,
}

impl Feature {
    /// The end of travel where it holds; none of what holds everywhere.
    #[must_use]
    pub fn end(&self) -> Option<&'static str> {
        let ends = [("_POS", "positive end"), ("_NEG", "negative end")];
        ends.into_iter().find(|(ending, _)| self.name.ends_with(ending)).map(|(_, end)| end)
    }

    /// The unit as it stands in keys.
    #[must_use]
    pub fn unit_in_words(&self) -> &'static str {
        match self.unit {
            "UT_SQUARENESS" => "um/m",
            "UT_SERVO_MISMATCH" => "ms",
            "UT_SCALE_ERROR" => "ppm",
            _ => "um",
        }
    }
}

impl Analysis {
    /// Values of an effect with name and unit.
    #[must_use]
    pub fn features(&self, e: &Estimate) -> Vec<Feature> {
        let letter = |axis: usize| if axis == 0 { "A" } else { "B" };
        let end = |end: Option<End>| match end {
            Some(End::Positive) => "_POS",
            Some(End::Negative) => "_NEG",
            None => "",
        };
        let of = |name: String, unit: &'static str, scale: f64, index: usize| {
            let v = e.values[index];
            Feature { name, unit, value: v.value * scale, std: v.std * scale }
        };
        let per_end = |name: &str, axis: usize| {
            let one = |i: usize| {
                of(format!("AF_{name}_{}{}", letter(axis), end(e.values[i].end)), "UT_LENGTH_UM", 1e3, i)
            };
            (0..e.values.len()).map(one).collect::<Vec<Feature>>()
        };
        match e.effect {
            Effect::Squareness => vec![of("AF_SQUARENESS".into(), "UT_SQUARENESS", 1e6, 0)],
            // difference of the diameters along the two axes
            Effect::ScaleMismatch => {
                vec![of("AF_SCALE_MISMATCH".into(), "UT_LENGTH_UM", 2e3 * self.radius, 0)]
            }
            Effect::ServoMismatch if self.notes.contains(&Note::NoFeed) => Vec::new(),
            Effect::ServoMismatch => vec![of("AF_SERVO_MISMATCH".into(), "UT_SERVO_MISMATCH", 1e3, 0)],
            Effect::Straightness(k) => {
                vec![of(format!("AF_STRAIGHTNESS_{}", letter(k)), "UT_LENGTH_UM", 1e3, 0)]
            }
            // one travel direction of the axis is not told from the other: the error is one of place
            Effect::Cyclic(k) => {
                vec![of(format!("AF_CYCLIC_ERROR_{}_FWD", letter(k)), "UT_LENGTH_UM", 1e3, 0)]
            }
            Effect::Backlash(k) => per_end("BACKLASH", k),
            Effect::LateralPlay(k) => per_end("LATERAL_PLAY", k),
            Effect::ReversalSpike(k) => per_end("REVERSAL_SPIKES", k),
        }
    }

    /// Scale errors of both axes in ppm, where the length of the instrument is known to a standard uncertainty.
    #[must_use]
    pub fn scale_features(&self, length_std_mm: Option<f64>) -> Vec<Feature> {
        let (Some(length), Some((_, radius, std)), Some(e)) =
            (length_std_mm, self.radius_deviation.first(), self.estimate(Effect::ScaleMismatch))
        else {
            return Vec::new();
        };
        let mismatch = e.values[0];
        let mean_std = std.hypot(length) / self.radius;
        [("A", 0.5), ("B", -0.5)]
            .map(|(letter, sign)| Feature {
                name: format!("AF_SCALE_ERROR_{letter}"),
                unit: "UT_SCALE_ERROR",
                value: 1e6 * (radius / self.radius + sign * mismatch.value),
                std: 1e6 * mean_std.hypot(0.5 * mismatch.std),
            })
            .into()
    }

    /// Pairs of effects that these data hardly separate, each once, with their correlation.
    #[must_use]
    pub fn confounded(&self) -> Vec<(Effect, Effect, f64)> {
        let mut pairs: Vec<(Effect, Effect, f64)> = Vec::new();
        for e in &self.estimates {
            for (other, c) in &e.confounded {
                if !pairs.iter().any(|(one, two, _)| *one == *other && *two == e.effect) {
                    pairs.push((e.effect, *other, *c));
                }
            }
        }
        pairs
    }
}
