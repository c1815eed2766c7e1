//! Values of a section by their kind: numbers, lists, texts, words. One that is wrong is reported and counts as absent.

use std::path::PathBuf;

use toml::de::DeValue;

use super::{Allowed, Placed, Section, Shape};
use crate::diagnostic::figure;
use crate::key_names::{in_words, suggestion, unit_of};

impl<'r> Section<'r> {
    /// Reports a value of the wrong shape.
    pub(crate) fn wrong_shape<T>(
        &self,
        key: &str,
        value: &Placed<&DeValue<'_>>,
        expected: &str,
    ) -> Option<T> {
        self.refuse(
            value.place.clone(),
            format!("{} must be {expected}, found {}", self.named_key(key), kind_of(value.value)),
            match value.value {
                DeValue::String(text)
                    if expected.contains("number") && text.trim().parse::<f64>().is_ok() =>
                {
                    format!("write {} without quotes", text.trim())
                }
                _ => format!("write {expected} behind {key} ="),
            },
        )
    }

    /// A finite number.
    pub(crate) fn number(&self, key: &'static str, allowed: Allowed) -> Option<Placed<f64>> {
        self.shape(key, Shape::Number(allowed));
        let value = self.value(key)?;
        let number = self.finite(key, &value, None)?;
        if !allowed.admits(number) {
            let unit = unit_of(key).map_or(String::new(), |u| format!(" {}", in_words(u)));
            return self.refuse(
                value.place,
                format!("{} is {}{unit}", self.named_key(key), figure(number)),
                format!("allowed is {}", allowed.in_words(&unit)),
            );
        }
        Some(Placed::new(number, value.place))
    }

    /// A whole number.
    pub(crate) fn whole(&self, key: &'static str, low: u32, high: u32) -> Option<Placed<u32>> {
        self.shape(key, Shape::Whole(low, high));
        let value = self.value(key)?;
        let Some(integer) = value.value.as_integer() else {
            return self.wrong_shape(key, &value, "a whole number");
        };
        match u32::from_str_radix(integer.as_str(), integer.radix()) {
            Ok(v) if (low..=high).contains(&v) => Some(Placed::new(v, value.place)),
            _ => {
                let unit = unit_of(key).map_or(String::new(), |u| format!(" {}", in_words(u)));
                let message = format!("{} is {integer}{unit}", self.named_key(key));
                self.refuse(value.place, message, format!("allowed is {low} to {high}{unit}"))
            }
        }
    }

    /// A list of finite numbers.
    pub(crate) fn numbers(&self, key: &'static str) -> Option<Placed<Vec<Placed<f64>>>> {
        self.shape(key, Shape::Numbers(None));
        let value = self.value(key)?;
        let Some(items) = value.value.as_array() else {
            return self.wrong_shape(key, &value, "a list of numbers");
        };
        let mut numbers = Vec::with_capacity(items.len());
        for (i, item) in items.iter().enumerate() {
            let item = Placed::new(item.get_ref(), item.span());
            // every bad number of the list is reported
            if let Some(number) = self.finite(key, &item, Some(i + 1)) {
                numbers.push(Placed::new(number, item.place));
            }
        }
        (numbers.len() == items.len()).then(|| Placed::new(numbers, value.place))
    }

    /// A list of exactly `N` finite numbers.
    pub(crate) fn fixed<const N: usize>(&self, key: &'static str, shape: &str) -> Option<Placed<[f64; N]>> {
        let list = self.numbers(key);
        self.shape(key, Shape::Numbers(Some(N)));
        let list = list?;
        let found = list.value.len();
        let plain: Vec<f64> = list.value.iter().map(|n| n.value).collect();
        let Ok(array) = <[f64; N]>::try_from(plain) else {
            return self.refuse(
                list.place,
                format!("{} has {found} numbers", self.named_key(key)),
                format!("write {N} numbers: {shape}"),
            );
        };
        Some(Placed::new(array, list.place))
    }

    /// Two numbers of which the second is larger.
    pub(crate) fn interval(&self, key: &'static str) -> Option<Placed<[f64; 2]>> {
        let pair = self.fixed::<2>(key, "[lower end, upper end]")?;
        let [low, high] = pair.value;
        if low < high {
            return Some(pair);
        }
        let message = format!("{} from {low} to {high} is empty", self.named_key(key));
        self.refuse(pair.place, message, "write the lower end first and a larger upper end behind it")
    }

    fn finite(&self, key: &str, value: &Placed<&DeValue<'_>>, row: Option<usize>) -> Option<f64> {
        let number = match value.value {
            DeValue::Float(v) => v.as_str().parse::<f64>().ok(),
            DeValue::Integer(v) if v.radix() == 10 => v.as_str().parse::<f64>().ok(),
            DeValue::Integer(v) => i64::from_str_radix(v.as_str(), v.radix()).ok().map(|i| i as f64),
            _ if row.is_some() => return self.wrong_shape(key, value, "a list of numbers only"),
            _ => return self.wrong_shape(key, value, "a number"),
        };
        number.filter(|v| v.is_finite()).or_else(|| {
            let row = row.map_or(String::new(), |r| format!(", row {r},"));
            self.refuse(
                value.place.clone(),
                format!("{}{row} is not a finite number", self.named_key(key)),
                "write a finite number; a value that was not measured is left out with its row",
            )
        })
    }

    /// A text.
    pub(crate) fn text(&self, key: &'static str) -> Option<Placed<&'r str>> {
        self.shape(key, Shape::Text);
        let value = self.value(key)?;
        match value.value {
            DeValue::String(text) => Some(Placed::new(text.as_ref(), value.place)),
            _ => self.wrong_shape(key, &value, "a text in quotes"),
        }
    }

    /// A path, which must not be empty.
    pub(crate) fn path(&self, key: &'static str, what: &str) -> Option<PathBuf> {
        let path = self.text(key)?;
        if path.value.trim().is_empty() {
            let message = format!("{} is empty", self.named_key(key));
            return self.refuse(path.place, message, format!("write the path of {what}"));
        }
        Some(PathBuf::from(path.value))
    }

    /// A list of texts.
    pub(crate) fn texts(&self, key: &'static str) -> Option<Placed<Vec<Placed<&'r str>>>> {
        self.shape(key, Shape::Texts);
        let value = self.value(key)?;
        let texts: Option<Vec<_>> = value.value.as_array().and_then(|list| {
            list.iter().map(|item| Some(Placed::new(item.get_ref().as_str()?, item.span()))).collect()
        });
        let texts = texts.or_else(|| self.wrong_shape(key, &value, "a list of texts in quotes"))?;
        Some(Placed::new(texts, value.place))
    }

    /// True or false.
    pub(crate) fn flag(&self, key: &'static str) -> Option<bool> {
        self.shape(key, Shape::Flag);
        let value = self.value(key)?;
        value.value.as_bool().or_else(|| self.wrong_shape(key, &value, "true or false"))
    }

    /// One of several words.
    pub(crate) fn choice<T: Copy>(&self, key: &'static str, words: &[(&str, T)]) -> Option<T> {
        let text = self.text(key);
        self.shape(key, Shape::Words(words.iter().map(|(word, _)| (*word).to_owned()).collect()));
        self.word(key, &text?, words)
    }

    /// The meaning of a word.
    pub(crate) fn word<T: Copy>(&self, key: &str, text: &Placed<&str>, words: &[(&str, T)]) -> Option<T> {
        if let Some((_, meaning)) = words.iter().find(|(word, _)| *word == text.value) {
            return Some(*meaning);
        }
        let known: Vec<&str> = words.iter().map(|(word, _)| *word).collect();
        self.refuse(
            text.place.clone(),
            format!("{} does not know \"{}\"", self.named_key(key), text.value),
            suggestion(text.value, &known, "write one of: "),
        )
    }
}

/// A number as it is written.
pub(super) fn number_of(value: &DeValue<'_>) -> Option<f64> {
    match value {
        DeValue::Integer(i) => i.as_str().parse().ok(),
        DeValue::Float(f) => f.as_str().parse().ok(),
        _ => None,
    }
}

pub(super) fn kind_of(value: &DeValue<'_>) -> &'static str {
    match value {
        DeValue::String(_) => "a text",
        DeValue::Integer(_) | DeValue::Float(_) => "a number",
        DeValue::Boolean(_) => "true or false",
        DeValue::Datetime(_) => "a date",
        DeValue::Array(_) => "a list",
        DeValue::Table(_) => "a table",
    }
}
