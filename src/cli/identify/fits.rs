//! `volcomp identify fits`: a curve through x and y, in the units of the file, with every figure.

use std::path::{Path, PathBuf};

use clap::ValueEnum;
use serde::Deserialize;
use serde_json::{Map, Value, json};

use super::case::{CaseArgs, print_json};
use crate::table;
use crate::{EX_DATAERR, EX_USAGE, Failure};
use volcomp_identify::Reading;
use volcomp_identify::curve::monomial::polynomial;
use volcomp_identify::curve::{Basis, CurveFit, Figures, Period, Request, fit, highest_order};
use volcomp_units::axes::Travel;

/// Error curves through plain numbers.
///
/// For error motions of a machine use volcomp fit: it knows units, directions and model files. This method fits one
/// column over another without units and prints coefficients with standard deviations: for checking against other
/// programs, and for calibration curves.
///
/// A case is a JSON object with x, y and basis (fourier, chebyshev, half-range, polynomial), optional order, period or
/// periods (null: fitted), period_search, linear, x0 and travel, ridge {lam, weights}, intercept.
///
///   volcomp identify fits --data enso.csv --x month --y pressure --basis fourier --order 1 --periods 12,auto,auto
///
///   volcomp identify fits --data load.csv --x load --y deflection --basis polynomial --order 2
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    #[command(flatten)]
    case: CaseArgs,
    /// A table with named columns.
    #[arg(long, value_name = "FILE", conflicts_with = "input", required_unless_present_any = ["input", "file"])]
    data: Option<PathBuf>,
    /// Column of the abscissa.
    #[arg(long, value_name = "COLUMN", default_value = "x")]
    x: String,
    /// Column of the values.
    #[arg(long, value_name = "COLUMN", default_value = "y")]
    y: String,
    /// Family of curves.
    #[arg(long, value_enum, default_value = "chebyshev")]
    basis: BasisArg,
    /// Degree, half waves or harmonics; without it the order of lowest AICc up to 10.
    #[arg(long)]
    order: Option<usize>,
    /// Periods of a Fourier series: numbers or auto.
    #[arg(long, value_name = "P|auto", value_delimiter = ',')]
    periods: Vec<String>,
    /// Limits for fitted periods.
    #[arg(long, value_name = "LOW,HIGH", value_delimiter = ',', num_args = 2)]
    period_search: Vec<f64>,
    /// Where the phase of a Fourier series counts from; default: the first x.
    #[arg(long, allow_negative_numbers = true)]
    x0: Option<f64>,
    /// A polynomial through the origin.
    #[arg(long)]
    no_intercept: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum BasisArg {
    /// Harmonics of one or several periods.
    Fourier,
    /// Chebyshev polynomials.
    Chebyshev,
    /// Mean, linear part and sine half waves.
    HalfRange,
    /// Powers of x.
    Polynomial,
}

/// A case of the reference vectors.
#[derive(Debug, Deserialize)]
struct Case {
    basis: BasisArg,
    x: Vec<f64>,
    y: Vec<f64>,
    x0: Option<f64>,
    travel: Option<f64>,
    order: Option<usize>,
    order_fit: Option<usize>,
    linear: Option<bool>,
    period: Option<f64>,
    #[serde(default)]
    periods: Vec<Option<f64>>,
    period_search: Option<[f64; 2]>,
    ridge: Option<Ridge>,
    intercept: Option<bool>,
}

#[derive(Debug, Deserialize)]
struct Ridge {
    lam: f64,
    weights: Option<Vec<f64>>,
}

/// Highest order of the table of orders.
const TABLE_ORDER: usize = 10;
/// Where the curve is evaluated, as shares of the range.
const EVALUATED: [f64; 7] = [0.0, 0.013, 0.27, 0.515, 0.777, 0.99, 1.0];

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    let (case, name) = match (args.case.file(), args.case.data(&args.data)) {
        (Some(file), _) => (file.read()?, file.path().display().to_string()),
        (None, Some(path)) => (args.read_table(path)?, path.display().to_string()),
        (None, None) => return Err(Failure::new(EX_USAGE, "error: neither --input nor --data is given")),
    };
    let failed =
        |what: &dyn core::fmt::Display| Failure::new(EX_DATAERR, format_args!("error: {name}: {what}"));
    if case.x.len() != case.y.len() {
        return Err(failed(&format_args!(
            "{} x but {} y; every point needs both",
            case.x.len(),
            case.y.len()
        )));
    }
    let result = if case.basis == BasisArg::Polynomial {
        powers(&case).map_err(|e| failed(&e))?
    } else {
        curve(&case).map_err(|e| failed(&e))?
    };
    if args.case.json {
        print_json(&Value::Object(result))
    } else {
        report(&result)
    }
    Ok(())
}

impl Args {
    fn read_table(&self, path: &Path) -> Result<Case, Failure> {
        let mut table = table::open(path)?;
        let (cx, cy) = (table.require(&self.x)?, table.require(&self.y)?);
        let (mut x, mut y) = (Vec::new(), Vec::new());
        while table.advance()? {
            x.push(table.number(cx)?);
            y.push(table.number(cy)?);
        }
        let period = |text: &String| match text.as_str() {
            "auto" => Ok(None),
            _ => text.parse::<f64>().map(Some).map_err(|_| {
                Failure::new(
                    EX_USAGE,
                    format_args!("error: --periods: '{text}' is neither a number nor auto"),
                )
            }),
        };
        Ok(Case {
            basis: self.basis,
            x,
            y,
            x0: self.x0,
            travel: None,
            order: self.order,
            order_fit: None,
            linear: None,
            period: None,
            periods: self.periods.iter().map(period).collect::<Result<_, _>>()?,
            period_search: (self.period_search.len() == 2)
                .then(|| [self.period_search[0], self.period_search[1]]),
            ridge: None,
            intercept: Some(!self.no_intercept),
        })
    }
}

impl Case {
    fn readings(&self) -> Vec<Reading> {
        let reading = |(&position, &value)| Reading { cycle: 0, travel: Travel::Forward, position, value };
        self.x.iter().zip(&self.y).map(reading).collect()
    }

    fn order(&self) -> Option<usize> {
        self.order_fit.or(self.order)
    }

    fn request(&self) -> Request {
        let fitted = self.period_search.map_or(Period::Auto, Period::Within);
        let mut periods: Vec<Period> = self.periods.iter().map(|p| p.map_or(fitted, Period::Given)).collect();
        if periods.is_empty() {
            periods.push(self.period.map_or(fitted, Period::Given));
        }
        let basis = match self.basis {
            BasisArg::Fourier => Basis::Fourier,
            BasisArg::HalfRange => Basis::HalfRange,
            BasisArg::Chebyshev | BasisArg::Polynomial => Basis::Chebyshev,
        };
        // the origin of the harmonics belongs to the case, the other bases run over the data
        let last = self.x.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let range = match (self.basis, self.x0, self.travel) {
            (BasisArg::Fourier, Some(low), Some(travel)) => Some([low, low + travel]),
            (BasisArg::Fourier, Some(low), None) => Some([low, last]),
            _ => None,
        };
        let weights = self.ridge.as_ref().and_then(|r| r.weights.as_ref().map(|w| (r.lam, w)));
        Request {
            basis: Some(basis),
            order: self.order(),
            period: periods[0],
            further_periods: periods[1..].to_vec(),
            linear: self.linear,
            ridge: self.ridge.as_ref().filter(|r| r.weights.is_none()).map(|r| r.lam),
            penalties: weights.map(|(lam, w)| w.iter().map(|w| lam * w).collect()),
            range,
            ..Request::default()
        }
    }
}

/// A polynomial in powers of x.
fn powers(case: &Case) -> Result<Map<String, Value>, String> {
    let order = case.order().ok_or("a polynomial needs an order (--order)")?;
    let intercept = case.intercept.unwrap_or(true);
    let found = polynomial(&case.x, &case.y, order, intercept).map_err(|e| e.to_string())?;
    let n = case.x.len() as f64;
    // through the origin the total is about zero, as usual
    let mean = if intercept { case.y.iter().sum::<f64>() / n } else { 0.0 };
    let total: f64 = case.y.iter().map(|y| (y - mean).powi(2)).sum();
    let mut map = Map::new();
    map.insert("basis".into(), json!("polynomial"));
    map.insert("order".into(), json!(order));
    map.insert("intercept".into(), json!(intercept));
    map.insert("coefficients".into(), json!(found.coefficients));
    map.insert("coefficients_std".into(), json!(found.std));
    map.insert("sse".into(), json!(found.sse));
    map.insert("rmse_n".into(), json!((found.sse / n).sqrt()));
    map.insert("rmse_dof".into(), json!(found.sigma));
    map.insert("r2".into(), json!((total > 0.0).then(|| 1.0 - found.sse / total)));
    map.insert("e_max".into(), json!(found.residuals.iter().fold(0.0f64, |a, r| a.max(r.abs()))));
    map.insert("n".into(), json!(case.x.len()));
    map.insert("m".into(), json!(found.coefficients.len()));
    Ok(map)
}

/// A curve of the model's families.
fn curve(case: &Case) -> Result<Map<String, Value>, String> {
    let (readings, mut request) = (case.readings(), case.request());
    let mut map = Map::new();
    if request.order.is_none() {
        let (table, best) = orders(&readings, &request)?;
        map.insert("aicc_table".into(), table);
        map.insert("best_order".into(), json!(best));
        request.order = Some(best);
    }
    let found = fit(&readings, &request).map_err(|e| e.to_string())?;
    map.insert("basis".into(), json!(found.basis.name()));
    map.insert("order".into(), json!(found.order));
    map.insert("linear".into(), json!(found.basis == Basis::Fourier && found.coefficients.len() % 2 == 0));
    map.insert("coefficients".into(), json!(found.coefficients));
    if found.basis == Basis::Fourier {
        map.insert("period".into(), json!(found.period));
        map.insert("periods".into(), json!(found.periods));
    }
    figures(&mut map, &found.figures);
    map.insert("loo_rmse".into(), json!(found.figures.loo_rmse));
    map.insert("condition".into(), json!(found.condition));
    uncertainty(&mut map, &found);
    if found.period_fitted && found.periods.len() == 1 {
        compare_with_polynomial(&mut map, &found, &readings);
    }
    let [low, high] = found.curve.range().unwrap_or([0.0, 1.0]);
    let at = EVALUATED.map(|share| low + share * (high - low));
    map.insert("eval".into(), json!(at.map(|x| [x, found.value(x, Travel::Forward)])));
    Ok(map)
}

/// SSE and AICc of every order, and the order of lowest AICc.
fn orders(readings: &[Reading], request: &Request) -> Result<(Value, usize), String> {
    let basis = request.basis.unwrap_or(Basis::Chebyshev);
    let mut positions: Vec<f64> = readings.iter().map(|r| r.position).collect();
    positions.sort_by(f64::total_cmp);
    positions.dedup();
    let lowest = usize::from(basis == Basis::Fourier);
    let (mut table, mut best, mut problem) = (Vec::new(), None, None);
    for order in lowest..=highest_order(basis, positions.len()).min(TABLE_ORDER) {
        match fit(readings, &Request { order: Some(order), ..request.clone() }) {
            Ok(found) => {
                let figures = found.figures;
                table.push(json!({"order": order, "sse": figures.sse, "aicc": figures.aicc}));
                if let Some(aicc) = figures.aicc
                    && best.is_none_or(|(_, lowest)| aicc < lowest)
                {
                    best = Some((order, aicc));
                }
            }
            Err(e) => {
                problem.get_or_insert(e);
                break;
            }
        }
    }
    match (best, problem) {
        (Some((order, _)), _) => Ok((Value::Array(table), order)),
        (None, Some(e)) => Err(e.to_string()),
        (None, None) => Err("too few points for an order; give one".to_owned()),
    }
}

fn figures(map: &mut Map<String, Value>, f: &Figures) {
    map.insert("sse".into(), json!(f.sse));
    map.insert("rmse_n".into(), json!(f.rmse_n));
    map.insert("rmse_dof".into(), json!(f.rmse_dof));
    map.insert("r2".into(), json!(f.r2));
    map.insert("e_max".into(), json!(f.e_max));
    map.insert("aicc".into(), json!(f.aicc));
    map.insert("n".into(), json!(f.n));
    map.insert("m".into(), json!(f.m));
}

fn uncertainty(map: &mut Map<String, Value>, found: &CurveFit) {
    let Some(band) = &found.band else { return };
    let mut std = band.parameter_std();
    let of_periods = std.split_off(found.coefficients.len().min(std.len()));
    map.insert("coefficients_std".into(), json!(std));
    if found.period_fitted {
        map.insert("periods_std".into(), json!(of_periods));
    }
    map.insert("factor_95".into(), json!(band.factor_95()));
}

/// A polynomial with as many numbers as the Fourier series with its fitted period has.
fn compare_with_polynomial(map: &mut Map<String, Value>, found: &CurveFit, readings: &[Reading]) {
    let degree = found.figures.m - 1;
    let request = Request { basis: Some(Basis::Chebyshev), order: Some(degree), ..Request::default() };
    // too few points for it: nothing to compare
    if let Ok(other) = fit(readings, &request) {
        let mut inner = Map::new();
        figures(&mut inner, &other.figures);
        map.insert(format!("polynomial{degree}"), Value::Object(inner));
    }
}

/// The result for people.
fn report(map: &Map<String, Value>) {
    let text = |key: &str| match map.get(key) {
        None | Some(Value::Null) => "-".to_owned(),
        Some(Value::String(s)) => s.clone(),
        Some(v) => v.to_string(),
    };
    let list = |key: &str| map.get(key).and_then(Value::as_array).cloned().unwrap_or_default();
    say!("{} of order {}: n {}, m {}", text("basis"), text("order"), text("n"), text("m"));
    let (values, std) = (list("coefficients"), list("coefficients_std"));
    for (i, value) in values.iter().enumerate() {
        let std = std.get(i).and_then(Value::as_f64).map_or_else(String::new, |s| format!("  +- {s:.6e}"));
        say!("  c{i:<3} {:>22.14e}{std}", value.as_f64().unwrap_or(f64::NAN));
    }
    let (periods, std) = (list("periods"), list("periods_std"));
    for (i, value) in periods.iter().enumerate() {
        // given periods stand first and have no uncertainty
        let std = (i + std.len())
            .checked_sub(periods.len())
            .and_then(|k| std.get(k)?.as_f64())
            .map_or_else(String::new, |s| format!("  +- {s:.6e}"));
        say!("  period {:>18.12}{std}", value.as_f64().unwrap_or(f64::NAN));
    }
    for key in ["sse", "rmse_n", "rmse_dof", "e_max", "r2", "aicc", "loo_rmse", "condition"] {
        if map.contains_key(key) {
            say!("  {key:<10} {}", text(key));
        }
    }
    if let Some(other) = map.iter().find(|(k, _)| k.starts_with("polynomial") && k.as_str() != "polynomial") {
        say!(
            "  {} of as many numbers: rmse_dof {}, e_max {}",
            other.0,
            other.1["rmse_dof"],
            other.1["e_max"]
        );
    }
}
