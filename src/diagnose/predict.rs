//! Predictions of model and additions at the readings of a session, along their directions of sensitivity.

use volcomp_effects::addition::{Addition, AdditionError, Evaluator};
use volcomp_effects::prediction::deviation_um;
use volcomp_model::Model;
use volcomp_model::geometry::Vec3;

use crate::session::Session;

/// Fills in the predictions of model (zero without one) and additions.
///
/// # Errors
/// An effect of an addition that lacks a column at some reading: a prediction without it would be a wrong one.
pub fn predict(
    session: &mut Session,
    model: Option<&Model>,
    additions: &[Addition],
) -> Result<(), PredictError> {
    let evaluator = Evaluator::new(additions);
    let mut signals = Vec::new();
    for e in additions.iter().flat_map(Addition::machine_effects) {
        signals.extend(e.shape.signals().into_iter().cloned());
    }
    for s in &signals {
        session.add_signal(s);
    }
    // the evaluator numbers the signals by itself
    let own: Vec<Option<usize>> = {
        let mut unique = Vec::new();
        for s in signals {
            if !unique.contains(&s) {
                unique.push(s);
            }
        }
        unique.iter().map(|s| session.signal(s)).collect()
    };
    for i in 0..session.moments.len() {
        let m = &session.moments[i];
        let mut copy = m.clone();
        copy.signals =
            own.iter().map(|p| p.and_then(|p| m.signals.get(p)).copied().unwrap_or(f64::NAN)).collect();
        let d = model.map_or_else(Vec3::zeros, |model| deviation_um(model, m)) + evaluator.at(&copy);
        if !d.dot(&m.u).is_finite() {
            let (file, line) = (session.files[m.file].clone(), session.readings[i].line);
            return Err(PredictError { file, line, source: evaluator.lacks(&copy) });
        }
        session.readings[i].prediction_um = d;
    }
    Ok(())
}

/// A reading for which there is no prediction.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{file}:{line}: {}", .source.as_ref().map_or_else(|| "the model has no prediction here".to_owned(), ToString::to_string))]
pub struct PredictError {
    /// The file.
    pub file: String,
    /// The line.
    pub line: u64,
    /// The effect that cannot be evaluated; none where it is the model.
    pub source: Option<AdditionError>,
}
