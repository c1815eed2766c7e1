//! The keys of one error shape, read one by one so that every mistake can be named.

use super::error::{Place, TruthError};

/// The shapes that a truth file may use.
const KINDS: &str = "slope, bow, wave, pitch, bump, step, samples or waviness";

/// The keys of one shape that have not been read yet.
pub(super) struct Params {
    place: Place,
    keys: toml::Table,
    coordinate_unit: &'static str,
    value_unit: &'static str,
    asked: Vec<String>,
}

impl Params {
    pub(super) fn new(
        place: Place,
        keys: toml::Table,
        coordinate_unit: &'static str,
        value_unit: &'static str,
    ) -> Self {
        Self { place, keys, coordinate_unit, value_unit, asked: Vec::new() }
    }

    /// A size of the error: um or arcsec.
    pub(super) fn value(&mut self, name: &str) -> Result<f64, TruthError> {
        let key = format!("{name}-{}", self.value_unit);
        self.number(&key)?.ok_or_else(|| self.missing(name))
    }

    pub(super) fn value_or(&mut self, name: &str, default: f64) -> Result<f64, TruthError> {
        let key = format!("{name}-{}", self.value_unit);
        Ok(self.number(&key)?.unwrap_or(default))
    }

    /// A coordinate: mm or deg.
    pub(super) fn coordinate(&mut self, name: &str) -> Result<f64, TruthError> {
        let key = format!("{name}-{}", self.coordinate_unit);
        self.number(&key)?.ok_or_else(|| TruthError::Missing { place: self.place.clone(), key })
    }

    /// A length along the axis, above zero.
    pub(super) fn length(&mut self, name: &str) -> Result<f64, TruthError> {
        let value = self.coordinate(name)?;
        if value > 0.0 {
            return Ok(value);
        }
        let key = format!("{name}-{}", self.coordinate_unit);
        Err(TruthError::Range { place: self.place.clone(), key, value, limit: "above 0" })
    }

    pub(super) fn plain_or(&mut self, key: &str, default: f64) -> Result<f64, TruthError> {
        Ok(self.number(key)?.unwrap_or(default))
    }

    /// At least two coordinates, rising.
    pub(super) fn rising(&mut self, name: &str) -> Result<Vec<f64>, TruthError> {
        let key = format!("{name}-{}", self.coordinate_unit);
        let at = self
            .list(&key)?
            .ok_or_else(|| TruthError::Missing { place: self.place.clone(), key: key.clone() })?;
        if at.len() < 2 {
            return Err(TruthError::Length { place: self.place.clone(), key, count: at.len(), wanted: 2 });
        }
        for (index, pair) in at.windows(2).enumerate() {
            if pair[1] <= pair[0] {
                let (place, row) = (self.place.clone(), index + 2);
                return Err(TruthError::NotRising { place, key, row, value: pair[1], before: pair[0] });
            }
        }
        Ok(at)
    }

    /// Sizes of the error, as many as wanted.
    pub(super) fn values(&mut self, name: &str, wanted: usize) -> Result<Option<Vec<f64>>, TruthError> {
        let key = format!("{name}-{}", self.value_unit);
        match self.list(&key)? {
            Some(list) if list.len() != wanted => {
                Err(TruthError::Length { place: self.place.clone(), key, count: list.len(), wanted })
            }
            found => Ok(found),
        }
    }

    pub(super) fn missing(&self, name: &str) -> TruthError {
        let key = format!("{name}-{}", self.value_unit);
        TruthError::Missing { place: self.place.clone(), key }
    }

    pub(super) fn unknown_kind(&self) -> TruthError {
        let key = match &self.place {
            Place::Shape { kind, .. } => kind.clone(),
            place => place.to_string(),
        };
        TruthError::UnknownKey { place: self.place.clone(), key, expected: KINDS.to_owned() }
    }

    /// Refuses what nobody has asked for.
    pub(super) fn finish(self) -> Result<(), TruthError> {
        match self.keys.into_iter().next() {
            Some((key, _)) => {
                Err(TruthError::UnknownKey { place: self.place, key, expected: self.asked.join(", ") })
            }
            None => Ok(()),
        }
    }

    fn number(&mut self, key: &str) -> Result<Option<f64>, TruthError> {
        self.asked.push(key.to_owned());
        let Some(found) = self.keys.remove(key) else { return Ok(None) };
        match as_number(&found) {
            Some(number) => Ok(Some(number)),
            None => Err(self.not_a_number(key, "a finite number")),
        }
    }

    fn list(&mut self, key: &str) -> Result<Option<Vec<f64>>, TruthError> {
        self.asked.push(key.to_owned());
        let Some(found) = self.keys.remove(key) else { return Ok(None) };
        let numbers =
            found.as_array().and_then(|list| list.iter().map(as_number).collect::<Option<Vec<_>>>());
        match numbers {
            Some(numbers) => Ok(Some(numbers)),
            None => Err(self.not_a_number(key, "a list of finite numbers")),
        }
    }

    fn not_a_number(&self, key: &str, wanted: &'static str) -> TruthError {
        TruthError::NotANumber { place: self.place.clone(), key: key.to_owned(), wanted }
    }
}

fn as_number(value: &toml::Value) -> Option<f64> {
    value.as_float().or_else(|| value.as_integer().map(|i| i as f64)).filter(|v| v.is_finite())
}
