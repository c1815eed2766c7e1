//! `volcomp identify fits`: a curve through x and y, in the units of the file, with every figure.

use clap::ValueEnum;

use crate::fit::AutoOr;
use crate::identify::prelude::*;
use volcomp_identify::curve::monomial::polynomial;
use volcomp_identify::curve::{Basis, Figures, Orders, Period, Request, fit};

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
pub(crate) struct Args {
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
    periods: Vec<AutoOr<f64>>,
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

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum BasisArg {
    /// Harmonics of one or several periods.
    Fourier,
    /// Chebyshev polynomials.
    #[default]
    Chebyshev,
    /// Mean, linear part and sine half waves.
    HalfRange,
    /// Powers of x.
    Polynomial,
}

/// A case of the reference vectors.
#[derive(Debug, Default, Deserialize)]
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

impl Method for Args {
    fn front(&self) -> Front<'_> {
        self.case.front(None)
    }

    fn of_case(&self, file: CaseFile<'_>) -> Result<Box<dyn Found + '_>> {
        found(&file.read()?, file.path)
    }

    fn of_data(&self) -> Result<Option<Box<dyn Found + '_>>> {
        let path = self.case.required(&self.data)?;
        found(&self.read_table(path)?, path).map(Some)
    }
}

fn found(case: &Case, path: &Path) -> Result<Box<dyn Found>> {
    let [x, y] = [case.x.len(), case.y.len()];
    if x != y {
        return Err(data!(path, "{x} x but {y} y; every point needs both"));
    }
    let result = if case.basis == BasisArg::Polynomial { powers(case) } else { curve(case) };
    let result = result.map_err(|e| Failure::data(path, e))?;
    if result["rmse_dof"].is_null() {
        note!(
            "note: {}: {} coefficients for {} points leave no degree of freedom: the curve runs through the points, its coefficients \
             have no standard deviation; take a lower order",
            path.display(),
            result["m"],
            result["n"]
        );
    }
    Ok(printed(result.clone(), move || report(&result)))
}

impl Args {
    fn read_table(&self, path: &Path) -> Result<Case> {
        let mut table = table::open(path)?;
        let (cx, cy) = (table.column(&self.x)?, table.column(&self.y)?);
        let points = table.rows(|row| Ok((row.number(cx)?, row.number(cy)?)))?;
        let (x, y) = points.into_iter().unzip();
        Ok(Case {
            basis: self.basis,
            x,
            y,
            x0: self.x0,
            order: self.order,
            periods: self.periods.iter().map(|p| p.number()).collect(),
            period_search: self.period_search[..].try_into().ok(),
            intercept: Some(!self.no_intercept),
            ..Case::default()
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
        let range = self.x0.filter(|_| basis == Basis::Fourier);
        let (ridge, penalties) = match &self.ridge {
            Some(Ridge { lam, weights: Some(w) }) => (None, Some(w.iter().map(|w| lam * w).collect())),
            Some(Ridge { lam, weights: None }) => (Some(*lam), None),
            None => (None, None),
        };
        Request {
            basis: Some(basis),
            order: self.order(),
            period: periods[0],
            further_periods: periods[1..].to_vec(),
            linear: self.linear,
            ridge,
            penalties,
            range: range.map(|low| [low, self.travel.map_or(last, |travel| low + travel)]),
            ..Request::default()
        }
    }
}

/// A polynomial in powers of x.
fn powers(case: &Case) -> Result<Value, String> {
    let order = case.order().ok_or("a polynomial needs an order (--order)")?;
    let intercept = case.intercept.unwrap_or(true);
    let found = polynomial(&case.x, &case.y, order, intercept).map_err(|e| e.to_string())?;
    let n = case.x.len() as f64;
    // through the origin the total is about zero, as usual
    let mean = if intercept { case.y.iter().sum::<f64>() / n } else { 0.0 };
    let total: f64 = case.y.iter().map(|y| (y - mean).powi(2)).sum();
    Ok(json!({
        "basis": "polynomial",
        "order": order,
        "intercept": intercept,
        "coefficients": found.coefficients,
        "coefficients_std": found.std,
        "sse": found.sse,
        "rmse_n": (found.sse / n).sqrt(),
        "rmse_dof": found.sigma,
        "r2": (total > 0.0).then(|| 1.0 - found.sse / total),
        "e_max": found.residuals.iter().fold(0.0f64, |a, r| a.max(r.abs())),
        "n": case.x.len(),
        "m": found.coefficients.len(),
    }))
}

/// A curve of the model's families.
fn curve(case: &Case) -> Result<Value, String> {
    let (readings, mut request) = (case.readings(), case.request());
    let orders = request.order.is_none().then(|| Orders::of(&readings, &request, TABLE_ORDER)).transpose()?;
    request.order = request.order.or(orders.as_ref().map(|orders| orders.best));
    let found = fit(&readings, &request).map_err(|e| e.to_string())?;
    let mut json = figures(&found.figures);
    if let Some(Orders { tried, best }) = orders {
        let one = |(order, f): &(usize, Figures)| json!({"order": order, "sse": f.sse, "aicc": f.aicc});
        json["aicc_table"] = tried.iter().map(one).collect();
        json["best_order"] = json!(best);
    }
    json["basis"] = json!(found.basis.name());
    json["order"] = json!(found.order);
    json["linear"] = json!(found.basis == Basis::Fourier && found.coefficients.len() % 2 == 0);
    json["coefficients"] = json!(found.coefficients);
    if found.basis == Basis::Fourier {
        json["period"] = json!(found.period);
        json["periods"] = json!(found.periods);
    }
    json["loo_rmse"] = json!(found.figures.loo_rmse);
    json["condition"] = json!(found.condition);
    if let Some(band) = &found.band {
        let mut std = band.parameter_std();
        let of_periods = std.split_off(found.coefficients.len().min(std.len()));
        json["coefficients_std"] = json!(std);
        if found.period_fitted {
            json["periods_std"] = json!(of_periods);
        }
        json["factor_95"] = json!(band.factor_95());
    }
    if found.period_fitted && found.periods.len() == 1 {
        // a polynomial with as many numbers as the series with its period; with too few points nothing is compared
        let degree = found.figures.m - 1;
        let request = Request { basis: Some(Basis::Chebyshev), order: Some(degree), ..Request::default() };
        if let Ok(other) = fit(&readings, &request) {
            json[format!("polynomial{degree}")] = figures(&other.figures);
        }
    }
    let [low, high] = found.curve.range().unwrap_or([0.0, 1.0]);
    let at = EVALUATED.map(|share| low + share * (high - low));
    json["eval"] = json!(at.map(|x| [x, found.value(x, Travel::Forward)]));
    Ok(json)
}

fn figures(f: &Figures) -> Value {
    fields!(f; sse, rmse_n, rmse_dof, r2, e_max, aicc, n, m)
}

/// The result for people.
fn report(found: &Value) {
    let text = |key: &str| match &found[key] {
        Value::Null => "-".to_owned(),
        Value::String(s) => s.clone(),
        v => v.to_string(),
    };
    let list = |key: &str| -> Vec<f64> {
        found[key].as_array().into_iter().flatten().map(|v| v.as_f64().unwrap_or(f64::NAN)).collect()
    };
    let plus_minus = |std: Option<&f64>| std.map_or_else(String::new, |s| format!("  +- {s:.6e}"));
    say!("{} of order {}: n {}, m {}", text("basis"), text("order"), text("n"), text("m"));
    let std = list("coefficients_std");
    for (i, value) in list("coefficients").iter().enumerate() {
        say!("  c{i:<3} {value:>22.14e}{}", plus_minus(std.get(i)));
    }
    let (periods, std) = (list("periods"), list("periods_std"));
    for (i, value) in periods.iter().enumerate() {
        // given periods stand first and have no uncertainty
        let k = (i + std.len()).checked_sub(periods.len());
        say!("  period {value:>18.12}{}", plus_minus(k.and_then(|k| std.get(k))));
    }
    for key in ["sse", "rmse_n", "rmse_dof", "e_max", "r2", "aicc", "loo_rmse", "condition"] {
        if found.get(key).is_some() {
            say!("  {key:<10} {}", text(key));
        }
    }
    let mut others = found.as_object().into_iter().flatten();
    if let Some((name, other)) = others.find(|(k, _)| k.starts_with("polynomial")) {
        say!("  {name} of as many numbers: rmse_dof {}, e_max {}", other["rmse_dof"], other["e_max"]);
    }
}
