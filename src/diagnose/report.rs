//! What the diagnosis says: `volcomp-gap/1`.

use std::collections::BTreeMap;

use serde::Serialize;

use super::library::Kind;

/// The whole report.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Report {
    /// `volcomp-gap/1`.
    pub format: &'static str,
    /// Rows in the files.
    pub rows: usize,
    /// Rows that were used.
    pub rows_used: usize,
    /// All sets of effects were compared, as of few readings: the fit holds all of them, and none is held out.
    #[serde(skip)]
    pub is_compared: bool,
    /// Root mean square of what is structured and has no name, um; where all sets of effects were compared, and where it joined the
    /// noise of a campaign.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub discrepancy_um: Option<f64>,
    /// The answer in one word.
    pub verdict: Verdict,
    /// Size of the gap.
    pub gap: Size,
    /// Where it lies, without any library.
    #[serde(rename = "where")]
    pub places: Vec<Place>,
    /// Which effects, most probable first.
    pub causes: Vec<Cause>,
    /// How far the gap shrinks.
    pub shrink: Shrink,
    /// What was really seen on fresh data.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fresh: Option<Fresh>,
    /// What nothing explains.
    pub unexplained: Unexplained,
    /// What to measure next, most telling first.
    pub next_measurement: Vec<Next>,
    /// Noise and drift of each instrument.
    pub noise: Vec<InstrumentNoise>,
    /// Readings far from their repeats, which were left out.
    pub outlying_readings: Vec<Outlying>,
    /// Effects that these data cannot show.
    pub cannot_be_seen: Vec<Unseen>,
    /// What was derived, dropped or is missing.
    pub notes: Vec<String>,
    /// Seed of the random draws.
    pub seed: u64,
}

/// The answer in one word.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// The causes declared explain it.
    Explained,
    /// Causes are declared, but something is left.
    PartlyExplained,
    /// There is something, and no cause is declared.
    Unexplained,
    /// Nothing above the noise.
    NoGap,
}

impl Verdict {
    /// In words.
    #[must_use]
    pub const fn words(self) -> &'static str {
        match self {
            Self::Explained => "explained",
            Self::PartlyExplained => "partly explained",
            Self::Unexplained => "unexplained",
            Self::NoGap => "no gap",
        }
    }
}

/// Size of the gap, without the offsets of the setups.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Size {
    /// RMS, um.
    pub rms_um: f64,
    /// White noise of the readings, um.
    pub noise_um: f64,
    /// Their ratio.
    pub rms_over_noise: f64,
    /// RMS that would be left by the best possible explanation: noise and drift, um.
    pub floor_um: f64,
    /// Share of the gap's mean square that is not noise or drift.
    pub explainable: f64,
}

/// Where the gap lies.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Place {
    /// axis, direction, position, speed ..
    pub by: &'static str,
    /// Which axis, sensor, instrument or setup.
    pub of: String,
    /// Share of the structured gap.
    pub share: f64,
    /// In words.
    pub detail: String,
}

/// A value with its uncertainty.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Value {
    /// The value; the unit stands in its name.
    pub value: f64,
    /// One standard deviation.
    pub std: f64,
}

/// An effect.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Cause {
    /// Name (`docs/reference/session-files.md` 4.1).
    pub effect: String,
    /// Axis, pair or symbol.
    pub subject: String,
    /// Who is to blame.
    pub kind: Kind,
    /// That it is this effect.
    pub probability: f64,
    /// The tool stands by it.
    pub declared: bool,
    /// What these data cannot tell apart from it.
    pub confounded_with: Vec<String>,
    /// That it is this effect or one of those.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub group_probability: Option<f64>,
    /// Effects that this cause says again, alone or together with other causes marked so: equal lags of all axes a common
    /// delay, and whatever was taken out of the library.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub re_expression_of: Vec<String>,
    /// Columns of the log that drive it, such as a thermometer.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub sources: Vec<String>,
    /// Fitted values; names end in their unit.
    pub parameters: BTreeMap<String, Value>,
    /// Share by which the gap shrinks when this alone is added.
    pub shrink: f64,
    /// Why it is not declared, where it is not.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub remark: String,
    /// Figures of the tests.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tests: Option<Tests>,
}

impl Cause {
    /// `effect:subject`.
    #[must_use]
    pub fn label(&self) -> String {
        if self.subject.is_empty() {
            self.effect.clone()
        } else {
            format!("{}:{}", self.effect, self.subject)
        }
    }
}

/// Figures by which a cause was judged.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Tests {
    /// Twice the logarithm of the Bayes factor.
    pub evidence: f64,
    /// What noise alone reaches.
    pub threshold: f64,
    /// Posterior mean of its deviation between programs, places and runs, as a share of itself.
    pub between: f64,
    /// Share that holds on runs left out.
    pub held_out: f64,
    /// Cosine between what it does and what the others do.
    pub against: f64,
    /// Posterior mean of its deviation from its formula, as a share of itself.
    pub misform: f64,
    /// How far it varies over the volume, relative, RMS; 0 where the data ask for no variation.
    pub varies: f64,
    /// In how many programs it shows, each counted by its share.
    pub breadth: f64,
    /// Its share among the effects that explain nearly as much.
    pub share: f64,
}

/// How far the gap shrinks.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Shrink {
    /// RMS now, um.
    pub rms_before_um: f64,
    /// RMS expected on new data of the same program, um.
    pub rms_after_um: f64,
    /// 1 - after/before.
    pub fraction: f64,
    /// 90 % interval of the fraction.
    pub ci90: [f64; 2],
    /// How it was found.
    pub how: String,
    /// The same on the data of the fit: too good.
    pub in_sample_fraction: f64,
    /// 99 % of the sizes of the gap, before and after, um.
    pub peak99_before_um: f64,
    /// See before.
    pub peak99_after_um: f64,
}

/// What fresh data show.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Fresh {
    /// RMS without the causes, um.
    pub rms_before_um: f64,
    /// RMS with them, um.
    pub rms_after_um: f64,
    /// 1 - after/before.
    pub fraction: f64,
    /// The forecast's interval holds it.
    pub within_forecast: bool,
}

/// What nothing explains.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Unexplained {
    /// There is something.
    pub significant: bool,
    /// Its size, um.
    pub rms_um: f64,
    /// Share of the structured gap.
    pub share: f64,
    /// Standard deviations above nothing.
    pub z: f64,
    /// Where it lies.
    #[serde(rename = "where")]
    pub places: Vec<Place>,
    /// In words.
    pub looks_like: String,
    /// It comes back at each programmed point and has no other structure.
    #[serde(skip)]
    pub is_pointwise: bool,
}

/// A measurement that would tell.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Next {
    /// What to do.
    #[serde(rename = "do")]
    pub action: String,
    /// What it tells apart.
    pub separates: Vec<String>,
    /// Expected information, nats.
    pub information: f64,
    /// What its result decides.
    pub decides: String,
    /// Estimate of its duration, preparation and motion, min.
    pub minutes: f64,
    /// The program to run.
    pub gcode: String,
}

/// Noise of an instrument class.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct InstrumentNoise {
    /// The class.
    pub instrument: String,
    /// White noise, um.
    pub white_um: f64,
    /// Drift, um.
    pub drift_um: f64,
    /// Correlation time of the drift, s.
    pub drift_s: f64,
    /// Rounding of the readings, um; 0 where none is seen.
    pub resolution_um: f64,
}

/// A reading that was left out.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Outlying {
    /// File and line.
    pub at: String,
    /// The gap there, um.
    pub gap_um: f64,
    /// The axis that it looks along; empty where it looks along none.
    pub along: String,
    /// How far from the median of its repeats, um; where it has none, from the fit without it.
    pub apart_um: f64,
    /// From what: `repeats` or `fit`.
    pub apart_from: String,
}

impl Outlying {
    /// Where it is and how far it lies from what.
    #[must_use]
    pub fn words(&self, um: impl Fn(f64) -> String) -> String {
        let along = if self.along.is_empty() { String::new() } else { format!(" ({})", self.along) };
        let from =
            if self.apart_from == "repeats" { "the median of its repeats" } else { "the fit of all others" };
        format!("{}{along}, {} µm from {from}", self.at, um(self.apart_um))
    }
}

/// An effect that these data cannot show.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Unseen {
    /// `effect:subject`.
    pub effect: String,
    /// Why.
    pub because: String,
}
