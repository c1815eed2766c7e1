//! What another model would change, error by error, for a picture before it is taken into use.

use serde::{Deserialize, Serialize};

use super::{Prepared, guard};
use crate::socket::ModelChange;
use volcomp_config::GuardConfig;
use volcomp_estimate::largest_change;
use volcomp_model::compare::{Change, Comparison, ErrorDifference, compare, relative_values};
use volcomp_units::axes::Travel;
use volcomp_units::{arcsec_from_rad, um_from_mm};

/// Intervals of a curve.
const POINTS: usize = 120;

/// What another model would change.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct ModelComparison {
    /// Where the other model came from.
    pub origin: String,
    /// Hashes and largest change in the working volume.
    pub change: ModelChange,
    /// Why it needs the name of a person and a reason; `null` where it needs none.
    pub confirmation: Option<String>,
    /// Why it would be refused now; `null` where it would not.
    pub refusal: Option<String>,
    /// What changes of machine, chain, frame and axes.
    pub changes: Vec<String>,
    /// Errors that differ.
    pub errors: Vec<ErrorCurves>,
}

/// An error that differs: its curves in the model in use and in the other one, in relative sense.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct ErrorCurves {
    /// Its symbol, for example `EXX`.
    pub symbol: String,
    /// `um` or `arcsec`.
    pub unit: String,
    /// Unit of the positions: `mm` or `deg`.
    pub position_unit: String,
    /// Largest difference, other minus in use.
    pub largest: f64,
    /// Root mean square of the difference.
    pub rms: f64,
    /// Positions of the axis; empty for a constant.
    pub positions: Vec<f64>,
    /// The model in use, travel towards plus; one value of a constant.
    pub old: Vec<f64>,
    /// The other model, likewise.
    pub new: Vec<f64>,
    /// The model in use, travel towards minus, where that differs.
    pub old_reverse: Option<Vec<f64>>,
    /// The other model, likewise.
    pub new_reverse: Option<Vec<f64>>,
}

impl ModelChange {
    /// What is known of a change once two models are compared.
    pub(crate) fn new(old: &Prepared, new: &Prepared, size: &guard::Size) -> Self {
        let finite = |value: f64| Some(value).filter(|v| v.is_finite());
        Self {
            old_hash: old.hash.clone(),
            new_hash: new.hash.clone(),
            largest_um: finite(size.largest_um),
            largest_arcsec: finite(size.largest_arcsec),
        }
    }
}

impl ModelComparison {
    /// Compares; takes up to seconds. Whether the model may be used now is for the caller to say.
    ///
    /// # Errors
    /// One of the models breaks a rule, in words.
    pub(crate) fn of(old: &Prepared, new: &Prepared, guard: &GuardConfig) -> Result<Self, String> {
        let found = compare(&old.spec, &new.spec, |_, _| {}).map_err(|e| e.to_string())?;
        let thermal = largest_change([&old.spec, &new.spec], [&old.thermal, &new.thermal]);
        let size = guard::size_of(&found, thermal);
        Ok(Self {
            origin: new.origin.clone(),
            change: ModelChange::new(old, new, &size),
            confirmation: guard::judge(&size, guard).err().map(|why| why.to_string()),
            refusal: None,
            changes: changes(&found),
            errors: found.errors.iter().map(|error| curves(old, new, error)).collect(),
        })
    }
}

fn changes(found: &Comparison) -> Vec<String> {
    let words = |change: &Change| match change {
        Change::Machine([a, b]) => format!("machine: {a} -> {b}"),
        Change::Chain([a, b]) => format!("chain: {a} -> {b}"),
        Change::WorkpieceOrigin(_) => "origin of the workpiece".to_owned(),
        Change::ToolTip(_) => "tool tip".to_owned(),
        Change::GaugePoint(_) => "gauge point".to_owned(),
        Change::Vertical(_) => "vertical axis".to_owned(),
        Change::Tool(_) => "errors of the spindle".to_owned(),
        Change::Datum(_) => "datum".to_owned(),
        Change::Travel { axis, .. } => format!("travel of {axis}"),
        Change::AxisPoint { axis, .. } => format!("point on the axis {axis}"),
        Change::Sense { axis, .. } => format!("sense of {axis}"),
        Change::Reference { axis, .. } => format!("reference point of {axis}"),
        Change::CorrectionLimit { axis, .. } => format!("correction limit of {axis}"),
    };
    found.changes.iter().map(words).collect()
}

fn curves(old: &Prepared, new: &Prepared, error: &ErrorDifference) -> ErrorCurves {
    let symbol = error.symbol;
    let value = |v: f64| if symbol.is_angle() { arcsec_from_rad(v) } else { um_from_mm(v) };
    let kind = symbol.axis().kind();
    let places: Vec<f64> = error.over.map_or_else(Vec::new, |[low, high]| {
        (0..=POINTS).map(|k| low + (high - low) * k as f64 / POINTS as f64).collect()
    });
    let sampled = |model: &Prepared, travel: Travel| -> Vec<f64> {
        if places.is_empty() {
            let function = model.spec.error(symbol);
            return vec![value(function.map_or(0.0, |f| f.value(0.0, travel)))];
        }
        let values = relative_values(&model.spec, &model.model, symbol, &places, travel);
        values.into_iter().map(value).collect()
    };
    let [old, new] = [old, new].map(|model| [Travel::Forward, Travel::Reverse].map(|t| sampled(model, t)));
    let reverse = |[forward, reverse]: &[Vec<f64>; 2]| (forward != reverse).then(|| reverse.clone());
    let (old_reverse, new_reverse) = (reverse(&old), reverse(&new));
    let ([old, _], [new, _]) = (old, new);
    ErrorCurves {
        symbol: symbol.to_string(),
        unit: if symbol.is_angle() { "arcsec" } else { "um" }.to_owned(),
        position_unit: kind.position_unit().to_owned(),
        largest: value(error.largest),
        rms: value(error.rms),
        positions: places.iter().map(|q| kind.position_out(*q)).collect(),
        old,
        new,
        old_reverse,
        new_reverse,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use volcomp_config::MachineConfig;

    const MACHINE: &str = "format = \"volcomp-machine/1\"\nmachine = \"m\"\nmodel = \"model.toml\"\n\
        [axes.x]\nlimit-um = 50\nrate-um-per-s = 100\nacceleration-um-per-s2 = 1000\n";

    #[test]
    fn curves_of_both_models_and_what_they_need() {
        let config = MachineConfig::parse("m.toml", MACHINE).expect("a machine file");
        let read = |errors: &str| {
            let text = format!(
                "format = \"volcomp-model/1\"\nmachine = \"m\"\nchain = \"[w X' b Y Z t]\"\n{errors}"
            );
            Prepared::read("model.toml", text, &config).expect("a model")
        };
        let table = |values: &str| {
            format!("[errors.exx.table]\nposition-mm = [0, 100, 200]\nvalue-um = [{values}]\n")
        };
        let old = read(&table("0, 5, 10"));
        let new = read(&(table("0, 5, 80") + "[errors.ec0y.constant]\nvalue-arcsec = 2.0\n"));
        let found = ModelComparison::of(&old, &new, &config.guard).expect("comparable");
        assert_eq!((&found.change.old_hash, &found.change.new_hash), (&old.hash, &new.hash));
        assert!(found.confirmation.as_ref().is_some_and(|why| why.contains("limit is 50.0 um")), "{found:?}");
        let [exx, ec0y] = &found.errors[..] else { panic!("{found:?}") };
        assert_eq!((exx.symbol.as_str(), exx.unit.as_str(), exx.position_unit.as_str()), ("EXX", "um", "mm"));
        assert_eq!((exx.positions.len(), exx.old.len(), exx.new.len()), (POINTS + 1, POINTS + 1, POINTS + 1));
        let ends = |values: &[f64]| values[POINTS] - values[0];
        // relative sense of a workpiece-side axis: the sign is that of the machine's sense in both
        assert!((ends(&exx.old).abs() - 10.0).abs() < 1e-9 && (ends(&exx.new).abs() - 80.0).abs() < 1e-9);
        assert!(exx.old_reverse.is_none() && (exx.largest.abs() - 70.0).abs() < 1e-9);
        assert_eq!(
            (ec0y.unit.as_str(), ec0y.positions.len(), ec0y.old.as_slice()),
            ("arcsec", 0, &[0.0][..])
        );
        assert!((ec0y.new[0] - 2.0).abs() < 1e-9);
        let same = ModelComparison::of(&old, &old, &config.guard).expect("comparable");
        assert!(same.errors.is_empty() && same.confirmation.is_none() && same.changes.is_empty());
    }
}
