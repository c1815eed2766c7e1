//! Thermal displacement: what temperatures and the spindle's speed of the last hours say about a displacement now.
//!
//! `y = offset + SUM_i SUM_l c_il (s_il - ref_i^p)`, `s_il` = input `i` (to the power `p`) behind a first-order lag
//! of time constant `tau_l`. A body warms through as `1 - exp(-t / tau)`; several lags of one input stand for a body
//! that warms in several steps. Assumes that the past before the first reading was at rest (a lag starts where its
//! input does). Nothing is extrapolated: an input outside of the range that the fit has seen counts as the end of the range,
//! and far outside of it the thermal displacement fades to zero.
//!
//! Time is an argument (seconds that passed); nothing is allocated after construction.

use volcomp_model::ModelSpec;
use volcomp_model::curve::Live;

/// The most inputs, and the most terms, of one thermal displacement.
pub const TERMS_MAX: usize = 256;

/// What an input is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Quantity {
    /// A temperature, degC.
    Temperature,
    /// A speed of a spindle, 1/min; only its size counts.
    Speed,
}

/// One input with all of its lags.
#[derive(Debug, Clone, PartialEq)]
pub struct ThermalInput {
    /// The sensor by name.
    pub sensor: String,
    /// What it measures.
    pub quantity: Quantity,
    /// The range that the fit has seen, degC or 1/min.
    pub range: [f64; 2],
    /// The value at which it contributes nothing, degC or 1/min.
    pub reference: f64,
    /// Power of the input, of a speed in 1000/min; 1 for temperatures.
    pub power: f64,
    /// Time constants, s; 0 is the input itself.
    pub lags_s: Vec<f64>,
    /// Growth per kelvin, or per (1000/min) to the power, mm; one per lag.
    pub coefficients: Vec<f64>,
}

/// A thermal displacement.
#[derive(Debug, Clone, PartialEq)]
pub struct Thermal {
    /// Its name; the live value of a model's error names the same.
    pub name: String,
    /// True: an expansion, a strain in mm/mm in the place of each mm below; false: a length.
    pub expansion: bool,
    /// Growth where all inputs have been at their references for long, mm.
    pub offset: f64,
    /// Beyond either end of an input's range the end counts over this share of the range; over as much again it fades to zero.
    pub fade_share: f64,
    /// Standard uncertainty of a forecast (k = 1), mm, where known.
    pub std: Option<f64>,
    /// What it depends on.
    pub inputs: Vec<ThermalInput>,
}

/// Why a thermal displacement cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ThermalError {
    /// Without inputs it is a constant.
    #[error("thermal \"{name}\" has no input")]
    NoInput {
        /// The thermal displacement.
        name: String,
    },
    /// Too many of them.
    #[error("thermal \"{name}\" has {found} terms; the limit is {TERMS_MAX}")]
    TooMany {
        /// The thermal displacement.
        name: String,
        /// Terms.
        found: usize,
    },
    /// A number that cannot be.
    #[error("thermal \"{name}\", input \"{sensor}\": {what} {value} {rule}")]
    Value {
        /// The thermal displacement.
        name: String,
        /// The input, empty for the thermal displacement itself.
        sensor: String,
        /// Which number.
        what: &'static str,
        /// The number.
        value: f64,
        /// What it must be.
        rule: &'static str,
    },
    /// One coefficient per lag.
    #[error("thermal \"{name}\", input \"{sensor}\": {lags} lags but {coefficients} coefficients")]
    Length {
        /// The thermal displacement.
        name: String,
        /// The input.
        sensor: String,
        /// Time constants.
        lags: usize,
        /// Coefficients.
        coefficients: usize,
    },
}

/// Shortest distance over which the end of a range counts, and shortest over which a thermal displacement fades: a sensor that
/// stood still in the fit may move by that much, degC or 1/min.
const FADE_MIN: [f64; 2] = [1.0, 50.0];
/// Speeds count in thousands per minute.
const SPEED_UNIT: f64 = 1000.0;
/// Beyond this a number that was kept cannot be, degC and 1/min.
const TEMPERATURE_MAX: f64 = 1000.0;
const SPEED_MAX: f64 = 1e6;
/// A thermal displacement beyond this is a mistake of units, mm.
const COEFFICIENT_MAX: f64 = 100.0;

impl ThermalInput {
    /// The input as it enters the lags.
    #[must_use]
    pub fn shaped(&self, value: f64) -> f64 {
        match self.quantity {
            Quantity::Temperature => value,
            Quantity::Speed => (value.abs() / SPEED_UNIT).powf(self.power),
        }
    }

    /// What counts of a reading: a speed by its size.
    fn size(&self, value: f64) -> f64 {
        if self.quantity == Quantity::Speed { value.abs() } else { value }
    }

    /// The reading as it enters the lags: never beyond the range.
    fn held(&self, value: f64) -> f64 {
        self.shaped(self.size(value).max(self.range[0]).min(self.range[1]))
    }

    /// How far a reading lies outside of the range that the fit has seen, degC or 1/min.
    fn beyond(&self, value: f64) -> f64 {
        let value = self.size(value);
        (self.range[0] - value).max(value - self.range[1]).max(0.0)
    }

    /// 1 within the range that the fit has seen and near it, 0 far outside, smooth between.
    fn share(&self, value: f64, fade_share: f64) -> f64 {
        let least = FADE_MIN[usize::from(self.quantity == Quantity::Speed)];
        let near = (fade_share * (self.range[1] - self.range[0])).max(least);
        let at = 2.0 - (self.beyond(value) / near).clamp(1.0, 2.0);
        at * at * (3.0 - 2.0 * at)
    }

    fn check(&self, name: &str) -> Result<(), ThermalError> {
        let wrong = |what, value, rule| {
            Err(ThermalError::Value { name: name.to_owned(), sensor: self.sensor.clone(), what, value, rule })
        };
        if self.lags_s.len() != self.coefficients.len() {
            return Err(ThermalError::Length {
                name: name.to_owned(),
                sensor: self.sensor.clone(),
                lags: self.lags_s.len(),
                coefficients: self.coefficients.len(),
            });
        }
        let [low, high] = self.range;
        if !(low.is_finite() && high.is_finite() && low <= high) {
            return wrong("end of the range", high, "is below its begin or not finite");
        }
        if !self.reference.is_finite() {
            return wrong("reference", self.reference, "is not finite");
        }
        if !(self.power > 0.0 && self.power <= 4.0) {
            return wrong("power", self.power, "is not above 0 and at most 4");
        }
        if let Some(lag) = self.lags_s.iter().find(|l| !(0.0..=1e6).contains(*l)) {
            return wrong("lag", *lag, "is not from 0 to 1e6 s");
        }
        if let Some(c) = self.coefficients.iter().find(|c| !c.is_finite() || c.abs() > COEFFICIENT_MAX) {
            return wrong("coefficient", *c, "is not a finite number of at most 100 mm per unit");
        }
        Ok(())
    }
}

impl Thermal {
    /// How many terms it has: the lags of all inputs.
    #[must_use]
    pub fn terms(&self) -> usize {
        self.inputs.iter().map(|i| i.lags_s.len()).sum()
    }

    /// Most by which two thermal displacements differ, whatever their inputs do, mm (expansions: mm/mm). Every lag counts for
    /// itself at the ends of the ranges.
    #[must_use]
    pub fn largest_difference(&self, other: &Self) -> f64 {
        let size = |[low, high]: [f64; 2]| low.abs().max(high.abs());
        let both = size(extent(&[(1.0, self), (-1.0, other)]));
        let ranges = |t: &Self| t.inputs.iter().map(|i| (i.sensor.clone(), i.range)).collect::<Vec<_>>();
        if ranges(self) == ranges(other) && self.fade_share == other.fade_share {
            return both;
        }
        // where only one of them fades, the other counts as a whole
        both.max(size(extent(&[(1.0, self)]))).max(size(extent(&[(1.0, other)])))
    }

    /// Checks it.
    ///
    /// # Errors
    /// What cannot be used, by name.
    pub fn validate(&self) -> Result<(), ThermalError> {
        let name = || self.name.clone();
        if self.inputs.is_empty() {
            return Err(ThermalError::NoInput { name: name() });
        }
        let found = self.terms();
        if found > TERMS_MAX {
            return Err(ThermalError::TooMany { name: name(), found });
        }
        let own = [
            ("offset", self.offset, self.offset.is_finite()),
            ("fade-share", self.fade_share, self.fade_share > 0.0 && self.fade_share <= 10.0),
            ("std", self.std.unwrap_or(0.0), self.std.is_none_or(|s| s.is_finite() && s >= 0.0)),
        ];
        if let Some((what, value, _)) = own.into_iter().find(|(.., good)| !good) {
            let rule = "is out of its range";
            return Err(ThermalError::Value { name: name(), sensor: String::new(), what, value, rule });
        }
        self.inputs.iter().try_for_each(|i| i.check(&self.name))
    }
}

/// Lowest and highest value of a sum of thermal displacements, each with a factor, mm or mm/mm.
fn extent(sum: &[(f64, &Thermal)]) -> [f64; 2] {
    let terms: Vec<(f64, &ThermalInput, f64)> = sum
        .iter()
        .flat_map(|(factor, t)| t.inputs.iter().map(move |i| (*factor, i)))
        .flat_map(|(factor, i)| i.lags_s.iter().zip(&i.coefficients).map(move |(l, c)| (factor * c, i, *l)))
        .collect();
    // the same reading behind the same lag: these terms change together
    let together = |a: &(f64, &ThermalInput, f64), b: &(f64, &ThermalInput, f64)| {
        a.1.sensor == b.1.sensor && a.1.quantity == b.1.quantity && a.1.power == b.1.power && a.2 == b.2
    };
    let mut out = [sum.iter().map(|(factor, t)| factor * t.offset).sum(); 2];
    for (n, first) in terms.iter().enumerate() {
        if terms[..n].iter().any(|before| together(before, first)) {
            continue;
        }
        let group: Vec<_> = terms.iter().filter(|t| together(t, first)).collect();
        // linear between the ends of the ranges
        let values = group.iter().flat_map(|t| t.1.range).map(|reading| -> f64 {
            group.iter().map(|(c, i, _)| c * (i.held(reading) - i.shaped(i.reference))).sum()
        });
        let [low, high] = values.fold([f64::INFINITY, f64::NEG_INFINITY], |[l, h], v| [l.min(v), h.max(v)]);
        out = [out[0] + low, out[1] + high];
    }
    out
}

/// Most by which live values of two models differ because their thermal displacements do, mm. A strain counts over the distance
/// from its reference to the far end of the axis; no value counts beyond its limits.
#[must_use]
pub fn largest_change(specs: [&ModelSpec; 2], thermals: [&[Thermal]; 2]) -> f64 {
    let named = |k: usize, name: &str| thermals[k].iter().find(|t| t.name == name);
    let mut sum = 0.0;
    for (symbol, function) in &specs[0].errors {
        let Some(other) = specs[1].error(*symbol) else { continue };
        for live in &function.live {
            let same = |o: &&Live| o.sensor == live.sensor && o.reference == live.reference;
            let Some(twin) = other.live.iter().find(same) else { continue };
            let limit = live.limit.abs() + twin.limit.abs();
            let ends = specs.iter().filter_map(|s| s.domain(symbol.axis())).flatten();
            // the carriage of a mirrored axis is at -q
            let far = |at: f64| ends.flat_map(|q| [q, -q]).fold(0.0, |far: f64, q| far.max((q - at).abs()));
            sum += match (named(0, &live.sensor), named(1, &live.sensor)) {
                (None, None) => 0.0,
                (Some(a), Some(b)) if a == b => 0.0,
                (Some(a), Some(b)) => (a.largest_difference(b) * live.reference.map_or(1.0, far)).min(limit),
                _ => limit,
            };
        }
    }
    sum
}

/// A thermal displacement at a moment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ThermalDisplacement {
    /// The thermal displacement, mm, with its share.
    pub value: f64,
    /// 1 where all inputs are where the fit has seen them, falling to 0 outside.
    pub share: f64,
    /// The input that is furthest outside, by index.
    pub outside: Option<usize>,
}

/// The lags of a thermal displacement while time passes.
#[derive(Debug, Clone)]
pub struct ThermalState {
    /// By input and lag, in order; empty of meaning until begun.
    lagged: Vec<f64>,
    /// By input: the last finite reading.
    last: Vec<Option<f64>>,
}

impl ThermalState {
    /// Lags that have seen nothing yet.
    #[must_use]
    pub fn new(thermal: &Thermal) -> Self {
        Self { lagged: vec![0.0; thermal.terms()], last: vec![None; thermal.inputs.len()] }
    }

    /// What is to be kept of it: the lags in order, and the last reading of each input; `None` until all have spoken.
    #[must_use]
    pub fn kept(&self) -> Option<(Vec<f64>, Vec<f64>)> {
        let last: Option<Vec<f64>> = self.last.iter().copied().collect();
        Some((self.lagged.clone(), last?))
    }

    /// Puts back what was kept; `None` where it is of another thermal displacement or cannot be.
    #[must_use]
    pub fn restored(thermal: &Thermal, lagged: &[f64], last: &[f64]) -> Option<Self> {
        if lagged.len() != thermal.terms() || last.len() != thermal.inputs.len() {
            return None;
        }
        let mut states = lagged.iter();
        for (input, last) in thermal.inputs.iter().zip(last) {
            let most = match input.quantity {
                Quantity::Temperature => TEMPERATURE_MAX,
                Quantity::Speed => SPEED_MAX,
            };
            let can_be = |state: &f64| state.is_finite() && state.abs() <= input.shaped(most);
            if !(last.abs() <= most && states.by_ref().take(input.lags_s.len()).all(can_be)) {
                return None;
            }
        }
        Some(Self { lagged: lagged.to_vec(), last: last.iter().copied().map(Some).collect() })
    }

    /// Takes the readings after `dt_s` seconds, one per input; one that is not finite leaves the last one standing.
    pub fn advance(&mut self, thermal: &Thermal, dt_s: f64, readings: &[f64]) {
        let dt_s = if dt_s.is_finite() { dt_s.max(0.0) } else { 0.0 };
        let mut lagged = self.lagged.iter_mut();
        for ((input, last), reading) in thermal.inputs.iter().zip(&mut self.last).zip(readings) {
            let begun = last.is_some();
            if reading.is_finite() {
                *last = Some(*reading);
            }
            let Some(value) = *last else {
                lagged.by_ref().take(input.lags_s.len()).for_each(drop);
                continue;
            };
            let shaped = input.held(value);
            for (lag_s, state) in input.lags_s.iter().zip(lagged.by_ref()) {
                let keep = if begun && *lag_s > 0.0 { (-dt_s / lag_s).exp() } else { 0.0 };
                *state = shaped + (*state - shaped) * keep;
            }
        }
    }

    /// What each coefficient multiplies now, in order: for fitting them.
    pub fn terms(&self, thermal: &Thermal, out: &mut [f64]) {
        let references = thermal.inputs.iter().flat_map(|input| {
            let reference = input.shaped(input.reference);
            input.lags_s.iter().map(move |_| reference)
        });
        for ((out, state), reference) in out.iter_mut().zip(&self.lagged).zip(references) {
            *out = state - reference;
        }
    }

    /// The thermal displacement now; zero share until every input has spoken.
    #[must_use]
    pub fn growth(&self, thermal: &Thermal) -> ThermalDisplacement {
        let mut lagged = self.lagged.iter();
        let mut sum = thermal.offset;
        let mut share = 1.0;
        let mut outside: Option<(usize, f64)> = None;
        for (k, (input, last)) in thermal.inputs.iter().zip(&self.last).enumerate() {
            let reference = input.shaped(input.reference);
            for (coefficient, state) in input.coefficients.iter().zip(lagged.by_ref()) {
                sum += coefficient * (state - reference);
            }
            let Some(value) = *last else {
                share = 0.0;
                continue;
            };
            // sensors of one machine leave their ranges together: the furthest counts, not all of them
            share = input.share(value, thermal.fade_share).min(share);
            let beyond = input.beyond(value) / (input.range[1] - input.range[0]).max(f64::MIN_POSITIVE);
            if beyond > outside.map_or(0.0, |(_, most)| most) {
                outside = Some((k, beyond));
            }
        }
        let value = if sum.is_finite() { share * sum } else { 0.0 };
        ThermalDisplacement { value, share, outside: outside.map(|(k, _)| k) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_largest_difference_is_that_at_the_ends_of_the_ranges() {
        let thermal = |coefficient: f64, range: [f64; 2], reference: f64| Thermal {
            inputs: vec![ThermalInput {
                range,
                reference,
                lags_s: vec![0.0],
                coefficients: vec![coefficient],
                ..spindle().inputs[0].clone()
            }],
            ..spindle()
        };
        let base = thermal(0.003, [15.0, 40.0], 20.0);
        for (other, expected) in [
            (base.clone(), 0.0),
            // 27 um/K over 20 K
            (thermal(0.03, [15.0, 40.0], 20.0), 0.54),
            (thermal(0.003, [15.0, 40.0], 5.0), 0.045),
            // beyond 30 degC one of them fades, the other reaches 75 um
            (thermal(0.003, [15.0, 30.0], 5.0), 0.075),
        ] {
            let found = base.largest_difference(&other);
            assert!((found - expected).abs() < 1e-12, "{found} {expected}");
            assert_eq!(found, other.largest_difference(&base));
        }
        let lagged = Thermal {
            inputs: vec![ThermalInput { lags_s: vec![600.0], ..base.inputs[0].clone() }],
            ..base.clone()
        };
        assert!(
            (base.largest_difference(&lagged) - 0.075).abs() < 1e-12,
            "one may be cold while the other is warm"
        );
    }

    fn spindle() -> Thermal {
        let input = ThermalInput {
            sensor: "t1".to_owned(),
            quantity: Quantity::Temperature,
            range: [20.0, 40.0],
            reference: 20.0,
            power: 1.0,
            lags_s: vec![0.0, 600.0],
            coefficients: vec![0.001, 0.002],
        };
        let speed = ThermalInput {
            sensor: "n".to_owned(),
            quantity: Quantity::Speed,
            range: [0.0, 6000.0],
            reference: 0.0,
            power: 1.5,
            lags_s: vec![1200.0],
            coefficients: vec![-0.0005],
        };
        Thermal {
            name: "z".to_owned(),
            expansion: false,
            offset: 0.0,
            fade_share: 0.25,
            std: None,
            inputs: vec![input, speed],
        }
    }

    #[test]
    fn a_step_of_temperature_warms_through_as_physics_says() {
        let thermal = spindle();
        thermal.validate().unwrap();
        let mut state = ThermalState::new(&thermal);
        assert!(state.growth(&thermal).share == 0.0, "nothing has spoken yet");
        state.advance(&thermal, 0.0, &[20.0, 0.0]);
        assert_eq!(state.growth(&thermal), ThermalDisplacement { value: 0.0, share: 1.0, outside: None });
        // the same moment in one step or in many
        let mut coarse = state.clone();
        coarse.advance(&thermal, 900.0, &[30.0, -4000.0]);
        for _ in 0..900 {
            state.advance(&thermal, 1.0, &[30.0, -4000.0]);
        }
        let warmed = 1.0 - (-900.0f64 / 600.0).exp();
        let spun = 8.0 * (1.0 - (-900.0f64 / 1200.0).exp());
        let wanted = 0.001 * 10.0 + 0.002 * 10.0 * warmed - 0.0005 * spun;
        for s in [&state, &coarse] {
            assert!((s.growth(&thermal).value - wanted).abs() < 1e-12);
        }
    }

    #[test]
    fn outside_of_what_was_seen_the_end_counts_then_it_fades_and_the_input_is_named() {
        let thermal = spindle();
        let at = |celsius: f64| {
            let mut state = ThermalState::new(&thermal);
            state.advance(&thermal, 0.0, &[celsius, 0.0]);
            state.growth(&thermal)
        };
        assert_eq!(at(40.0).outside, None);
        for near in [40.1, 45.0] {
            assert_eq!(at(near), ThermalDisplacement { outside: Some(0), ..at(40.0) }, "{near}");
        }
        assert_eq!(at(18.0).value, at(20.0).value);
        let half = at(47.5);
        assert!((half.share - 0.5).abs() < 1e-12 && half.outside == Some(0));
        assert_eq!(at(51.0).value, 0.0);
        assert_eq!(at(9.0).value, 0.0);
        let steps: Vec<f64> = (0..700).map(|k| at(f64::from(k) * 0.1).value).collect();
        assert!(steps.windows(2).all(|p| (p[1] - p[0]).abs() < 0.003), "no step anywhere");
    }

    #[test]
    fn a_sensor_that_tells_nonsense_leaves_its_last_word() {
        let thermal = spindle();
        let mut state = ThermalState::new(&thermal);
        state.advance(&thermal, 0.0, &[25.0, f64::NAN]);
        assert!(state.growth(&thermal).share == 0.0, "one input has never spoken");
        state.advance(&thermal, 10.0, &[25.0, 0.0]);
        let before = state.growth(&thermal);
        state.advance(&thermal, 10.0, &[f64::NAN, f64::INFINITY]);
        assert_eq!(state.growth(&thermal), before);
        state.advance(&thermal, f64::NAN, &[25.0, 0.0]);
        assert_eq!(state.growth(&thermal), before);
    }

    #[test]
    fn what_is_kept_goes_on_as_if_nothing_had_been() {
        let thermal = spindle();
        let mut state = ThermalState::new(&thermal);
        assert_eq!(state.kept(), None, "nothing has spoken yet");
        state.advance(&thermal, 0.0, &[20.0, 3000.0]);
        state.advance(&thermal, 300.0, &[30.0, 3000.0]);
        let (lagged, last) = state.kept().unwrap();
        let mut other = ThermalState::restored(&thermal, &lagged, &last).unwrap();
        for s in [&mut state, &mut other] {
            s.advance(&thermal, 100.0, &[31.0, 0.0]);
        }
        assert_eq!(state.growth(&thermal), other.growth(&thermal));
        assert!(ThermalState::restored(&thermal, &lagged[1..], &last).is_none());
        assert!(ThermalState::restored(&thermal, &lagged, &[f64::NAN, 0.0]).is_none());
        let wild: Vec<f64> = lagged.iter().map(|v| v * 1e9).collect();
        assert!(ThermalState::restored(&thermal, &wild, &last).is_none());
    }

    #[test]
    fn what_cannot_be_used_is_named() {
        let with = |change: fn(&mut Thermal)| {
            let mut thermal = spindle();
            change(&mut thermal);
            thermal.validate().unwrap_err().to_string()
        };
        assert!(with(|t| t.inputs.clear()).contains("has no input"));
        assert!(with(|t| t.inputs[0].coefficients[0] = f64::NAN).contains("\"t1\": coefficient NaN"));
        assert!(with(|t| t.inputs[0].lags_s[1] = -1.0).contains("lag -1"));
        assert!(with(|t| t.inputs[1].range = [5.0, 1.0]).contains("range"));
        assert!(with(|t| t.inputs[1].lags_s.push(1.0)).contains("2 lags but 1"));
        assert!(with(|t| t.fade_share = 0.0).contains("fade-share"));
        assert!(with(|t| t.inputs[0].lags_s = vec![1.0; 300]).contains("301 terms"));
    }
}
