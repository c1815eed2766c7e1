//! How much of a forecast shrink of the gap a model can deliver: the report of a diagnosis against what became of its effects.

use crate::input::read_text;
use crate::prelude::*;
use volcomp_effects::extend::Fate;

/// The forecast of one diagnosis, `report.json`.
#[derive(Debug, Clone)]
pub(super) struct Forecast {
    before_um: f64,
    after_um: f64,
    /// Label and shrink of every declared cause of the machine.
    causes: Vec<(String, f64)>,
}

/// What a model can deliver of a forecast.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Delivered {
    before_um: f64,
    forecast_um: f64,
    deliverable_um: f64,
}

impl Delivered {
    const fn shrink(before_um: f64, after_um: f64) -> f64 {
        if before_um > 0.0 { 1.0 - after_um / before_um } else { 0.0 }
    }

    /// One line of text.
    pub(super) fn line(&self) -> String {
        let Self { before_um, forecast_um, deliverable_um } = *self;
        let [deliverable, forecast] =
            [deliverable_um, forecast_um].map(|after| Self::shrink(before_um, after));
        format!(
            "shrink of the gap: {deliverable:.2} of {forecast:.2} forecast ({before_um:.2} µm RMS; {deliverable_um:.2} µm left, forecast {forecast_um:.2} µm)"
        )
    }

    /// An object of the report.
    pub(super) fn json(&self) -> Value {
        json!({
            "forecast": Self::shrink(self.before_um, self.forecast_um),
            "deliverable": Self::shrink(self.before_um, self.deliverable_um),
            "rms_before_um": self.before_um,
            "rms_after_forecast_um": self.forecast_um,
            "rms_after_deliverable_um": self.deliverable_um,
        })
    }
}

impl Forecast {
    /// Reads the report named by the user, or `report.json` beside an addition; `None` where none of a diagnosis is beside it.
    pub(super) fn read(named: Option<&PathBuf>, addition: &Path) -> Result<Option<Self>> {
        if let Some(path) = named {
            return Self::read_file(path).map(Some);
        }
        let beside = addition.with_file_name("report.json");
        let found = beside.is_file().then(|| Self::read_file(&beside)).transpose();
        // nobody named this file
        found.or_else(|failure| {
            note!("note: {}; the forecast is left out", failure.message.trim_start_matches("error: "));
            Ok(None)
        })
    }

    fn read_file(path: &Path) -> Result<Self> {
        let text = read_text(path, InputKind::Model)?;
        let wrong = |what: &str| data!(path, "{what}; expected report.json of volcomp diagnose");
        let report: Value = serde_json::from_str(&text).map_err(|e| wrong(&e.to_string()))?;
        Self::of(&report).ok_or_else(|| wrong("no shrink and causes"))
    }

    fn of(report: &Value) -> Option<Self> {
        let number = |key: &str| report["shrink"][key].as_f64().filter(|v| v.is_finite());
        let causes = report["causes"].as_array()?;
        let declared = causes.iter().filter(|c| c["declared"] == true && c["kind"] == "machine");
        let causes = declared
            .map(|c| {
                let (effect, subject) = (c["effect"].as_str()?, c["subject"].as_str().unwrap_or(""));
                let label =
                    if subject.is_empty() { effect.to_owned() } else { format!("{effect}:{subject}") };
                Some((label, c["shrink"].as_f64()?.clamp(0.0, 1.0)))
            })
            .collect::<Option<_>>()?;
        Some(Self { before_um: number("rms_before_um")?, after_um: number("rms_after_um")?, causes })
    }

    /// The shrink that was forecast for an effect alone.
    pub(super) fn of_effect(&self, label: &str) -> Option<f64> {
        self.causes.iter().find(|(l, _)| l == label).map(|(_, shrink)| *shrink)
    }

    /// What is left where only some effects are taken out: those that stay out keep their share of the mean square that the
    /// forecast explains, in proportion to what each explains alone.
    pub(super) fn delivered(&self, fates: &[(String, Fate)]) -> Delivered {
        let alone = |shrink: f64| 1.0 - (1.0 - shrink).powi(2);
        let all: f64 = self.causes.iter().map(|(_, s)| alone(*s)).sum();
        let taken = |label: &str| fates.iter().any(|(l, fate)| l == label && fate.is_taken());
        let out: f64 = self.causes.iter().filter(|(l, _)| !taken(l)).map(|(_, s)| alone(*s)).sum();
        let share = if all > 0.0 { out / all } else { 0.0 };
        let (before, after) = (self.before_um.powi(2), self.after_um.powi(2));
        Delivered {
            before_um: self.before_um,
            forecast_um: self.after_um,
            deliverable_um: (after + share * (before - after).max(0.0)).sqrt(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn forecast() -> Forecast {
        Forecast {
            before_um: 5.0,
            after_um: 1.0,
            causes: vec![("backlash:x".to_owned(), 0.4), ("load:z".to_owned(), 0.1)],
        }
    }

    fn fate(label: &str, taken: bool) -> (String, Fate) {
        let fate = if taken { Fate::Taken(vec!["EXX".to_owned()]) } else { Fate::Left("no term") };
        (label.to_owned(), fate)
    }

    #[test]
    fn what_is_all_taken_delivers_the_forecast_and_nothing_taken_delivers_nothing() {
        let all = forecast().delivered(&[fate("backlash:x", true), fate("load:z", true)]);
        assert_eq!(all.deliverable_um, 1.0);
        let none = forecast().delivered(&[fate("backlash:x", false), fate("load:z", false)]);
        assert_eq!(none.deliverable_um, 5.0);
        let some = forecast().delivered(&[fate("backlash:x", true), fate("load:z", false)]);
        // 0.64 and 0.19 of the mean square alone
        assert!((some.deliverable_um.powi(2) - (1.0 + 24.0 * 0.19 / 0.83)).abs() < 1e-9);
    }
}
