//! The head of a report as a file in TOML (`docs/how-to/reports.md`); every key is optional.

use crate::prelude::*;

/// Figures of one test with their limits or uncertainties, by their keys such as `a-um`.
pub(crate) type Numbers = BTreeMap<String, f64>;

/// Tests whose figures may have tolerances.
const TESTS: [&str; 3] = ["iso230-2", "iso230-4", "iso230-6"];

/// A text, a day of TOML, or a whole number such as a serial number.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Text(pub(crate) String);

impl<'de> Deserialize<'de> for Text {
    fn deserialize<D: serde::Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        #[derive(Deserialize)]
        #[serde(untagged, expecting = "expected a text, a date or a whole number")]
        enum Either {
            Date(toml::value::Datetime),
            Number(i64),
            Text(String),
        }
        Ok(Self(match Either::deserialize(from)? {
            Either::Date(date) => date.to_string(),
            Either::Number(number) => number.to_string(),
            Either::Text(text) => text,
        }))
    }
}

/// `[machine]`.
#[derive(Debug, Clone, Default, PartialEq, Eq, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub(crate) struct Machine {
    /// Type or name.
    pub(crate) name: Option<String>,
    /// Manufacturer.
    pub(crate) manufacturer: Option<String>,
    /// Serial number.
    pub(crate) serial_number: Option<Text>,
    /// Control with its software version.
    pub(crate) control: Option<String>,
    /// Where it stands.
    pub(crate) location: Option<String>,
}

/// `[test]`.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub(crate) struct TestRun {
    /// Who measured.
    pub(crate) operator: Option<String>,
    /// For whom.
    pub(crate) customer: Option<String>,
    /// Day of the test.
    pub(crate) date: Option<Text>,
    /// Feed, mm/min; deg/min for a rotary axis.
    pub(crate) feed_mm_per_min: Option<f64>,
    /// Warm-up before the test.
    pub(crate) warm_up: Option<String>,
    /// Temperature at the start, degrees Celsius.
    pub(crate) temperature_start_degc: Option<f64>,
    /// Temperature at the end, degrees Celsius.
    pub(crate) temperature_end_degc: Option<f64>,
    /// Anything else.
    pub(crate) note: Option<String>,
}

/// `[instrument]`.
#[derive(Debug, Clone, Default, PartialEq, Eq, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub(crate) struct Instrument {
    /// Type or name.
    pub(crate) name: Option<String>,
    /// Serial number.
    pub(crate) serial_number: Option<Text>,
    /// Number of its calibration certificate.
    pub(crate) certificate: Option<Text>,
    /// Day of the calibration.
    pub(crate) calibrated: Option<Text>,
}

/// `[[compensation.validation]]`: a measurement with the compensation active.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub(crate) struct Validation {
    /// What was measured.
    pub(crate) measurement: Option<String>,
    /// Day.
    pub(crate) date: Option<Text>,
    /// With what.
    pub(crate) instrument: Option<String>,
    /// Number of points.
    pub(crate) points: Option<u32>,
    /// Figure without compensation, um.
    pub(crate) before_um: Option<f64>,
    /// The same figure with it, um.
    pub(crate) after_um: Option<f64>,
}

/// `[compensation]`, for `volcomp model report`.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub(crate) struct Compensation {
    /// Compensations of the control that stay active; an empty list states that there is none.
    pub(crate) native: Option<Vec<String>>,
    /// Errors that are known and not compensated, beside those that follow from the model.
    pub(crate) not_compensated: Vec<String>,
    /// Day of the next check.
    pub(crate) re_check: Option<Text>,
    /// Measurements with the compensation active.
    pub(crate) validation: Vec<Validation>,
}

/// The file.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub(crate) struct HeadFile {
    pub(crate) machine: Machine,
    pub(crate) test: TestRun,
    pub(crate) instrument: Instrument,
    /// Limits by test and figure.
    pub(crate) tolerance: BTreeMap<String, Numbers>,
    /// Expanded uncertainties (k = 2) by test and figure, where the tool computes none.
    pub(crate) uncertainty: BTreeMap<String, Numbers>,
    pub(crate) compensation: Compensation,
}

impl HeadFile {
    /// Reads a head.
    pub(crate) fn read(path: &Path) -> Result<Self> {
        let text = input::read_text(path, InputKind::Description)?;
        let head: Self = from_toml(path, &text)?;
        for (section, tests) in [("tolerance", &head.tolerance), ("uncertainty", &head.uncertainty)] {
            for (test, figures) in tests {
                if !TESTS.contains(&test.as_str()) {
                    let known = TESTS.map(|t| format!("[{section}.{t}]")).join(", ");
                    let what = format_args!("unknown section [{section}.{test}]; expected one of {known}");
                    return Err(Failure::mistake(path, what));
                }
                let wrong = |(key, v): &(&String, &f64)| {
                    !v.is_finite() || **v < 0.0 && (section == "uncertainty" || !is_lower(key))
                };
                if let Some((key, v)) = figures.iter().find(wrong) {
                    let what =
                        format_args!("[{section}.{test}] {key} = {v}: expected a finite number, 0 or above");
                    return Err(Failure::mistake(path, what));
                }
            }
        }
        let numbers = [
            ("feed-mm-per-min", head.test.feed_mm_per_min, 0.0),
            ("temperature-start-degc", head.test.temperature_start_degc, -273.15),
            ("temperature-end-degc", head.test.temperature_end_degc, -273.15),
        ];
        for (key, value, least) in numbers {
            if let Some(v) = value.filter(|v| !v.is_finite() || *v < least) {
                return Err(mistake!(path, "[test] {key} = {v}: expected a finite number above {least}"));
            }
        }
        Ok(head)
    }
}

/// True for figures whose limit is a lower one.
pub(super) fn is_lower(key: &str) -> bool {
    key == "fmin-um"
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<HeadFile, String> {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("head.toml");
        std::fs::write(&file, text).unwrap();
        HeadFile::read(&file).map_err(|e| e.message)
    }

    #[test]
    fn days_are_texts_or_dates_and_every_key_is_optional() {
        assert_eq!(read("").unwrap(), HeadFile::default());
        let head = read(
            "[instrument]\ncalibrated = 2026-03-01\ncertificate = \"4711\"\n[test]\ndate = \"12 March\"\n",
        )
        .unwrap();
        assert_eq!(head.instrument.calibrated.unwrap().0, "2026-03-01");
        assert_eq!(head.test.date.unwrap().0, "12 March");
    }

    #[test]
    fn mistakes_have_their_place() {
        for (text, wanted) in [
            ("[machine]\nname = \"a\"\nserial = \"b\"\n", "line 3"),
            ("[tolerance.iso230]\na-um = 1\n", "[tolerance.iso230-2]"),
            ("[tolerance.iso230-2]\na-um = -1\n", "a-um = -1"),
            ("[uncertainty.iso230-4]\nfmin-um = -1\n", "fmin-um = -1"),
            ("[test]\nfeed-mm-per-min = nan\n", "feed-mm-per-min"),
        ] {
            let message = read(text).unwrap_err();
            assert!(message.contains(wanted), "{message}");
        }
        assert!(read("[tolerance.iso230-4]\nfmin-um = -5\n").is_ok());
    }
}
