//! The configured sensors as the listener knows them: kind and unit of each, so that a message of another kind or unit is
//! rejected at once.

use std::sync::atomic::{AtomicU8, Ordering::Relaxed};

use volcomp_estimate::Kind;
use volcomp_estimate::live::{Body, Reading, SensorKind, SensorSpec};

/// A sensor.
#[derive(Debug)]
pub(crate) struct ConfiguredSensor {
    pub(crate) name: String,
    kind: SensorKind,
    /// What a sensor of kind value tells, by the model in use: 0 not known, 1 a length, 2 an angle.
    unit: AtomicU8,
}

impl ConfiguredSensor {
    pub(super) fn new(spec: &SensorSpec) -> Self {
        Self { name: spec.name.clone(), kind: spec.kind, unit: AtomicU8::new(0) }
    }

    /// By the model in use it tells this; `None`: not known.
    pub(super) fn set_unit(&self, unit: Option<Kind>) {
        let code = match unit {
            None => 0,
            Some(Kind::Length) => 1,
            Some(Kind::Angle) => 2,
        };
        self.unit.store(code, Relaxed);
    }

    /// Why a reading is none of this sensor; `None` where it is one.
    pub(super) fn objection(&self, reading: &Reading) -> Option<String> {
        let name = &self.name;
        let fits = match (&self.kind, &reading.body) {
            (SensorKind::Tool { .. }, Body::Tool(_) | Body::Points(_) | Body::Deviation { .. })
            | (SensorKind::FiveDof { .. }, Body::FiveDof(_))
            | (SensorKind::FiveDof { head: Some(_), .. }, Body::FiveDofRaw(_))
            | (SensorKind::Temperature, Body::Temperatures(_))
            | (SensorKind::Speed, Body::Speed(_)) => true,
            (SensorKind::FiveDof { head: None, .. }, Body::FiveDofRaw(_)) => {
                return Some(format!(
                    "sensor \"{name}\" has no focal-mm, beam-1-mm and beam-2-mm in the machine file, which raw \
                     readings need"
                ));
            }
            (SensorKind::Value, Body::Value { unit, .. }) => {
                let (wanted, key) = match self.unit.load(Relaxed) {
                    1 => (Kind::Length, "a length; send value_um"),
                    2 => (Kind::Angle, "an angle; send value_arcsec"),
                    _ => return None,
                };
                return unit
                    .is_some_and(|unit| unit != wanted)
                    .then(|| format!("sensor \"{name}\" tells {key}"));
            }
            _ => false,
        };
        (!fits).then(|| {
            let (kind, said) = (self.kind.name(), word_for(&reading.body));
            format!("sensor \"{name}\" is of kind {kind}, and {said} is of another kind")
        })
    }
}

/// What a reading is called in an answer.
const fn word_for(body: &Body) -> &'static str {
    match body {
        Body::Tool(_) => "a pose",
        Body::Points(_) => "a list of points",
        Body::Deviation { .. } => "a deviation",
        Body::FiveDof(_) | Body::FiveDofRaw(_) => "a 5-DOF reading",
        Body::Value { .. } => "a value",
        Body::Temperatures(_) => "a temperature",
        Body::Speed(_) => "a speed",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn reading(body: Body) -> Reading {
        Reading { stamp_ns: 0, quality: 1.0, body }
    }

    #[test]
    fn what_does_not_belong_to_a_sensor_is_answered_with_what_does() {
        let known = |kind| ConfiguredSensor::new(&SensorSpec::new("s", kind));
        let speed = reading(Body::Speed(100.0));
        assert_eq!(known(SensorKind::Speed).objection(&speed), None);
        let words = known(SensorKind::Temperature).objection(&speed).unwrap();
        assert!(words.contains("kind temperature") && words.contains("a speed"), "{words}");
        let value = known(SensorKind::Value);
        let arcsec = reading(Body::Value { value: 1e-5, unit: Some(Kind::Angle) });
        assert_eq!(value.objection(&arcsec), None, "as long as no model says what it is");
        value.set_unit(Some(Kind::Length));
        assert!(value.objection(&arcsec).unwrap().contains("value_um"));
        assert_eq!(value.objection(&reading(Body::Value { value: 1e-5, unit: None })), None);
        value.set_unit(Some(Kind::Angle));
        assert_eq!(value.objection(&arcsec), None);
    }
}
