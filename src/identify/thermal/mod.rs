//! Thermal displacement from a recording: temperatures and speeds of hours beside a measured displacement.
//!
//! Every input enters through several first-order lags; the coefficients of all of them are found together and shrunk
//! towards zero as much as forecasts ask for: the strength is the one that forecasts best when each later part of the
//! training rows is predicted from what came before (never from rows around it, which would flatter). Forecasts are
//! what counts: a fit that explains the past by many nearly parallel sensors goes wrong in the next hour.

mod ridge;

use ridge::{Line, Sums};
use volcomp_estimate::thermal::TERMS_MAX;
use volcomp_estimate::{Quantity, Thermal, ThermalInput, ThermalState};
use volcomp_model::statistics::hull;

/// A recorded input.
#[derive(Debug, Clone, PartialEq)]
pub struct Input {
    /// The sensor by name.
    pub sensor: String,
    /// What it measures.
    pub quantity: Quantity,
    /// One reading per row, degC or 1/min.
    pub values: Vec<f64>,
}

/// What is fitted and how.
#[derive(Debug, Clone, PartialEq)]
pub struct Request {
    /// Name of the growth.
    pub name: String,
    /// Time constants of temperatures, s; 0 is the reading itself.
    pub temperature_lags_s: Vec<f64>,
    /// Time constants of speeds, s.
    pub speed_lags_s: Vec<f64>,
    /// Powers in which a speed enters.
    pub speed_powers: Vec<f64>,
    /// Share of the rows, from the end, that is kept back and forecast; 0 for none.
    pub hold_out: f64,
    /// Strength of the shrinking, where it is not to be found.
    pub lambda: Option<f64>,
    /// Beyond either end of an input's range the end counts over this share of the range; over as much again it fades to zero.
    pub fade_share: f64,
}

impl Default for Request {
    fn default() -> Self {
        Self {
            name: "thermal".to_owned(),
            temperature_lags_s: vec![0.0, 600.0, 1800.0, 5400.0],
            speed_lags_s: vec![60.0, 600.0, 1800.0, 5400.0, 14400.0],
            speed_powers: vec![1.0, 1.5],
            hold_out: 0.3,
            lambda: None,
            fade_share: 0.25,
        }
    }
}

/// Why there is no growth.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ThermalFitError {
    /// Nothing to depend on.
    #[error("no temperature and no speed given; name their columns")]
    NoInput,
    /// Too little to fit and to try forecasts on.
    #[error("{found} rows; a fit with forecasts needs {needed}")]
    TooFewRows {
        /// Rows.
        found: usize,
        /// Rows needed.
        needed: usize,
    },
    /// Time must go on.
    #[error(
        "row {row}: time {found_s} s is not after {before_s} s; sort the recording, and give one run at a time"
    )]
    Time {
        /// Row, from 1.
        row: usize,
        /// Its time.
        found_s: f64,
        /// The time before.
        before_s: f64,
    },
    /// Too many columns.
    #[error(
        "{found} terms ({inputs} inputs with their lags); the limit is {TERMS_MAX}: leave out sensors or lags"
    )]
    TooManyTerms {
        /// Terms.
        found: usize,
        /// Inputs.
        inputs: usize,
    },
    /// Nothing that changes.
    #[error("no input changes over the training rows: nothing can be learned from them")]
    NothingChanges,
    /// The displacement does not change.
    #[error("the displacement does not change over the training rows")]
    Flat,
    /// The share kept back is not usable.
    #[error("hold-out {found} is not from 0 to 0.8")]
    HoldOut {
        /// The share.
        found: f64,
    },
}

/// What was found.
#[derive(Debug, Clone, PartialEq)]
pub struct ThermalFit {
    /// The growth, fitted to all rows.
    pub thermal: Thermal,
    /// Strength of the shrinking.
    pub lambda: f64,
    /// Rows, and how many of them were used for training when forecasts were tried.
    pub rows: usize,
    /// Training rows.
    pub training_rows: usize,
    /// RMS of the displacement about its mean, all rows, mm.
    pub raw_rms: f64,
    /// RMS of what the growth leaves in the rows that it was fitted to (all rows), mm.
    pub fit_rms: f64,
    /// RMS of forecasts of each later part of the training rows from what came before, mm: the uncertainty of a forecast.
    pub rolling_rms: f64,
    /// RMS of the forecast over the rows kept back, by a fit to the others, mm.
    pub forecast: Option<Forecast>,
    /// Inputs that never changed and say nothing.
    pub constant: Vec<String>,
    /// Deviation left, row by row, by the growth of the training rows: what the picture shows, mm.
    pub predicted: Vec<f64>,
}

/// How well the rows kept back were predicted, mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Forecast {
    /// By this method, as the daemon would use it: inputs held at the ends of what was seen.
    pub rms: f64,
    /// Largest error.
    pub largest: f64,
    /// By the mean of the training rows.
    pub by_mean_rms: f64,
    /// By plain regression on the temperatures, without lags and without shrinking; `None` without temperatures.
    pub by_regression_rms: Option<f64>,
    /// Share of the rows in which an input was outside of what training had seen.
    pub outside_share: f64,
}

/// Fewest training rows per block of forecasts.
const BLOCK_ROWS: usize = 5;
/// Ends of the parts of the training rows: the first is never forecast.
const PARTS: [f64; 4] = [0.4, 0.6, 0.8, 1.0];
/// Strengths tried: three per factor of ten, from 1e-5 to 1.
const STRENGTHS: core::ops::RangeInclusive<i32> = -15..=0;
/// Plain regression still needs a unique answer where two sensors are the same.
const PLAIN: f64 = 1e-12;

/// Fits a growth to rows in the order of time: `time_s` and `displacement_mm`, one per row of every input.
///
/// # Errors
/// The recording cannot determine it; the message says what to give instead.
pub fn fit(
    time_s: &[f64],
    inputs: &[Input],
    displacement_mm: &[f64],
    request: &Request,
) -> Result<ThermalFit, ThermalFitError> {
    let rows = time_s.len().min(displacement_mm.len());
    if !(0.0..=0.8).contains(&request.hold_out) {
        return Err(ThermalFitError::HoldOut { found: request.hold_out });
    }
    let training_rows = ((1.0 - request.hold_out) * rows as f64).round() as usize;
    let needed = (BLOCK_ROWS * PARTS.len()).max(20);
    if training_rows < needed {
        return Err(ThermalFitError::TooFewRows { found: rows, needed });
    }
    if let Some(k) = (1..rows).find(|k| time_s[*k] <= time_s[k - 1]) {
        return Err(ThermalFitError::Time { row: k + 1, found_s: time_s[k], before_s: time_s[k - 1] });
    }
    let log = Log { time_s: &time_s[..rows], inputs, y: &displacement_mm[..rows] };
    let (trained, constant) = log.frame(request, training_rows)?;
    // what is written knows all rows, about the same references
    let mut whole = trained.clone();
    for input in &mut whole.inputs {
        input.range = log.range(&input.sensor, rows);
    }
    let sums = log.sums(&whole, training_rows);
    let training = sums.parts.iter().fold(Sums::new(trained.terms()), |a, b| a.plus(b));
    if spread(&log.y[..training_rows]) <= 0.0 {
        return Err(ThermalFitError::Flat);
    }
    let (lambda, rolling_rms) = strength(&sums.parts, request.lambda);
    let of_training = training.ridge(lambda).ok_or(ThermalFitError::NothingChanges)?;
    let forecaster = with_coefficients(Thermal { std: Some(rolling_rms), ..trained }, &of_training);
    let predicted = log.predict(&forecaster);
    let forecast = (training_rows < rows).then(|| log.forecast(&forecaster, &predicted, training_rows));
    let all = training.plus(&sums.rest);
    let line = all.ridge(lambda).ok_or(ThermalFitError::NothingChanges)?;
    let fit_rms = (all.left(&line) / all.rows()).sqrt();
    Ok(ThermalFit {
        thermal: with_coefficients(Thermal { std: Some(rolling_rms), ..whole }, &line),
        lambda,
        rows,
        training_rows,
        raw_rms: spread(log.y),
        fit_rms,
        rolling_rms,
        forecast,
        constant,
        predicted,
    })
}

/// The strength that forecasts best, and how well it does: RMS over all parts but the first.
fn strength(parts: &[Sums], given: Option<f64>) -> (f64, f64) {
    let rms = |lambda: f64| {
        let mut before = parts[0].clone();
        let (mut left, mut rows) = (0.0, 0.0);
        for part in &parts[1..] {
            left += before.ridge(lambda).map_or(f64::INFINITY, |line| part.left(&line));
            rows += part.rows();
            before = before.plus(part);
        }
        (left / rows).sqrt()
    };
    let tried = STRENGTHS.map(|k| 10f64.powf(f64::from(k) / 3.0));
    let candidates: Vec<f64> = given.map_or_else(|| tried.collect(), |lambda| vec![lambda]);
    candidates
        .into_iter()
        .map(|lambda| (lambda, rms(lambda)))
        .min_by(|a, b| a.1.total_cmp(&b.1))
        .unwrap_or((1.0, f64::INFINITY))
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

/// RMS about the mean.
fn spread(values: &[f64]) -> f64 {
    let mean = mean(values);
    rms(values.iter().map(|v| v - mean))
}

fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0.0), |(s, n), v| (v.mul_add(v, s), n + 1.0));
    if count > 0.0 { (sum / count).sqrt() } else { 0.0 }
}

/// The recording.
struct Log<'a> {
    time_s: &'a [f64],
    inputs: &'a [Input],
    y: &'a [f64],
}

/// Sums over the parts of the training rows, and over the rows kept back.
struct Parted {
    parts: Vec<Sums>,
    rest: Sums,
}

impl Input {
    /// The range of the first rows; of a speed, of its size.
    fn range(&self, rows: usize) -> [f64; 2] {
        let speed = self.quantity == Quantity::Speed;
        hull(self.values[..rows].iter().map(|v| if speed { v.abs() } else { *v }))
    }
}

impl Log<'_> {
    /// A growth with the inputs that change over the first rows, its coefficients yet unknown; and the others' names.
    fn frame(&self, request: &Request, rows: usize) -> Result<(Thermal, Vec<String>), ThermalFitError> {
        if self.inputs.is_empty() {
            return Err(ThermalFitError::NoInput);
        }
        let mut inputs = Vec::new();
        let mut constant = Vec::new();
        for input in self.inputs {
            let speed = input.quantity == Quantity::Speed;
            let range = input.range(rows);
            if range[0] >= range[1] {
                constant.push(input.sensor.clone());
                continue;
            }
            let (powers, lags) = match input.quantity {
                Quantity::Temperature => (&[1.0][..], &request.temperature_lags_s),
                Quantity::Speed => (&request.speed_powers[..], &request.speed_lags_s),
            };
            inputs.extend(powers.iter().map(|power| ThermalInput {
                sensor: input.sensor.clone(),
                quantity: input.quantity,
                range,
                reference: if speed { 0.0 } else { mean(&input.values[..rows]) },
                power: *power,
                lags_s: lags.clone(),
                coefficients: vec![0.0; lags.len()],
            }));
        }
        let fade_share = request.fade_share;
        let thermal = Thermal {
            name: request.name.clone(),
            expansion: false,
            offset: 0.0,
            fade_share,
            std: None,
            inputs,
        };
        match thermal.terms() {
            0 => Err(ThermalFitError::NothingChanges),
            found if found > TERMS_MAX => {
                Err(ThermalFitError::TooManyTerms { found, inputs: self.inputs.len() })
            }
            _ => Ok((thermal, constant)),
        }
    }

    /// What the first rows have seen of a sensor.
    fn range(&self, sensor: &str, rows: usize) -> [f64; 2] {
        self.inputs.iter().find(|i| i.sensor == sensor).map_or([0.0; 2], |i| i.range(rows))
    }

    /// Calls with every row: its index and its readings, one per input of the growth.
    fn each(&self, thermal: &Thermal, mut visit: impl FnMut(usize, f64, &[f64])) {
        // an input may occur several times, with several powers
        let columns: Vec<&[f64]> = thermal
            .inputs
            .iter()
            .filter_map(|i| self.inputs.iter().find(|c| c.sensor == i.sensor))
            .map(|c| c.values.as_slice())
            .collect();
        let mut readings = vec![0.0; columns.len()];
        for (k, t) in self.time_s.iter().enumerate() {
            for (reading, column) in readings.iter_mut().zip(&columns) {
                *reading = column[k];
            }
            let dt_s = if k == 0 { 0.0 } else { t - self.time_s[k - 1] };
            visit(k, dt_s, &readings);
        }
    }

    fn sums(&self, thermal: &Thermal, training_rows: usize) -> Parted {
        let ends = PARTS.map(|share| (share * training_rows as f64).round() as usize);
        let terms = thermal.terms();
        let mut parts = vec![Sums::new(terms); PARTS.len()];
        let mut rest = Sums::new(terms);
        let mut state = ThermalState::new(thermal);
        let mut columns = vec![0.0; terms];
        self.each(thermal, |k, dt_s, readings| {
            state.advance(thermal, dt_s, readings);
            state.terms(thermal, &mut columns);
            let part = ends.iter().position(|end| k < *end);
            part.map_or(&mut rest, |p| &mut parts[p]).add(&columns, self.y[k]);
        });
        Parted { parts, rest }
    }

    /// What a growth says in every row.
    fn predict(&self, thermal: &Thermal) -> Vec<f64> {
        let mut state = ThermalState::new(thermal);
        let mut out = Vec::with_capacity(self.y.len());
        self.each(thermal, |_, dt_s, readings| {
            state.advance(thermal, dt_s, readings);
            out.push(state.growth(thermal).value);
        });
        out
    }

    fn forecast(&self, thermal: &Thermal, predicted: &[f64], from: usize) -> Forecast {
        let errors = || self.y[from..].iter().zip(&predicted[from..]).map(|(y, p)| y - p);
        let mean = mean(&self.y[..from]);
        let mut outside = 0usize;
        let mut state = ThermalState::new(thermal);
        self.each(thermal, |k, dt_s, readings| {
            state.advance(thermal, dt_s, readings);
            outside += usize::from(k >= from && state.growth(thermal).outside.is_some());
        });
        Forecast {
            rms: rms(errors()),
            largest: errors().fold(0.0, |a: f64, e| a.max(e.abs())),
            by_mean_rms: rms(self.y[from..].iter().map(|y| y - mean)),
            by_regression_rms: self.regression(from),
            outside_share: outside as f64 / (self.y.len() - from) as f64,
        }
    }

    /// RMS of the forecast by plain regression on the temperatures.
    fn regression(&self, from: usize) -> Option<f64> {
        let columns: Vec<&Input> =
            self.inputs.iter().filter(|i| i.quantity == Quantity::Temperature).collect();
        if columns.is_empty() {
            return None;
        }
        let (mut before, mut after) = (Sums::new(columns.len()), Sums::new(columns.len()));
        let mut row = vec![0.0; columns.len()];
        for (k, y) in self.y.iter().enumerate() {
            for (value, column) in row.iter_mut().zip(&columns) {
                *value = column.values[k] - column.values[0];
            }
            if k < from { &mut before } else { &mut after }.add(&row, *y);
        }
        let line = before.ridge(PLAIN)?;
        Some((after.left(&line) / after.rows()).sqrt())
    }
}

/// The thermal displacement with the coefficients of a regression on its terms.
fn with_coefficients(mut thermal: Thermal, line: &Line) -> Thermal {
    thermal.offset = line.constant;
    let mut coefficients = line.coefficients.iter();
    for c in thermal.inputs.iter_mut().flat_map(|i| &mut i.coefficients) {
        *c = coefficients.next().copied().unwrap_or_default();
    }
    thermal
}

#[cfg(test)]
mod tests;
