//! A TOML document with the place of everything, read section by section.
//!
//! What a derived deserialiser cannot do is why this exists: it stops at the first mistake, while a person
//! wants all of them at once, each under its caret. A [`Section`] is asked for the keys it may have; what nobody
//! asked for is an unknown key, so the keys in the code, in the messages and in `known_keys` are the same by
//! construction. A value that is wrong is reported and then counts as absent.

mod values;

use crate::prelude::*;
use std::cell::RefCell;
use std::ops::Range;

use toml::de::{DeTable, DeValue};

use values::{kind_of, number_of};

use super::key_names::{in_words, stem};
use super::syntax;

/// A value and where it stands.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Placed<T> {
    pub(super) value: T,
    pub(super) place: Range<usize>,
}

impl<T> Placed<T> {
    pub(super) fn new(value: T, place: Range<usize>) -> Self {
        Self { value, place }
    }
}

/// The numbers that a key may have.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Allowed {
    /// Any finite number.
    Finite,
    /// `0 < v <= high`.
    Positive {
        /// Highest.
        high: f64,
    },
    /// `low <= v <= high`.
    Within {
        /// Lowest.
        low: f64,
        /// Highest.
        high: f64,
    },
}

impl Allowed {
    fn admits(self, v: f64) -> bool {
        match self {
            Self::Finite => true,
            Self::Positive { high } => v > 0.0 && v <= high,
            Self::Within { low, high } => (low..=high).contains(&v),
        }
    }

    fn in_words(self, unit: &str) -> String {
        match self {
            Self::Finite => "any finite number".to_owned(),
            Self::Positive { high } => format!("above 0 up to {high}{unit}"),
            Self::Within { low, high } => format!("{low} to {high}{unit}"),
        }
    }
}

/// Value of a key, as the code that reads it states.
#[derive(Debug, Clone, PartialEq, Default)]
pub enum Shape {
    /// Of several types, or read by a rule of its own.
    #[default]
    Any,
    /// A number.
    Number(Allowed),
    /// A whole number, lowest and highest.
    Whole(u32, u32),
    /// A list of numbers; of this length, or of any.
    Numbers(Option<usize>),
    /// A text.
    Text,
    /// A list of texts.
    Texts,
    /// True or false.
    Flag,
    /// One of these words.
    Words(Vec<String>),
    /// A table.
    Table,
    /// One table, or a list of tables.
    Tables,
}

/// A key that a file may have: a row of the key table.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Key {
    /// Its values.
    pub shape: Shape,
    /// It must be written where its table is.
    pub required: bool,
    /// Value where it is not written, in the unit of the key.
    pub default: Option<f64>,
}

/// Collects what is wrong and which keys were asked for.
#[derive(Debug, Default)]
struct Reader {
    found: RefCell<Vec<Diagnostic>>,
    keys: RefCell<BTreeMap<String, Key>>,
}

impl Reader {
    fn report(&self, diagnostic: Diagnostic) {
        let mut found = self.found.borrow_mut();
        if found.len() < FOUND_MAX {
            found.push(diagnostic);
        }
    }

    /// True where no further mistake is kept.
    fn is_full(&self) -> bool {
        self.found.borrow().len() >= FOUND_MAX
    }

    pub(super) fn is_clean(&self) -> bool {
        self.found.borrow().is_empty()
    }
}

/// What `read` makes of a file and its text, or everything that is wrong in it.
pub(super) fn read_file<T>(
    file: &str,
    text: &str,
    read: impl FnOnce(&Section<'_>, &str) -> Option<T>,
) -> Result<T, ConfigErrors> {
    let text = without_mark(text);
    let document = document(file, text)?;
    let reader = Reader::default();
    match read(&Section::top(&reader, &document), text) {
        Some(found) if reader.is_clean() => Ok(found),
        _ => Err(ConfigErrors::new(file, text, reader.found.into_inner())),
    }
}

/// Every key that `read` asks for in the samples, as `section.key`.
pub(super) fn keys_of<T>(
    samples: &[&str],
    read: impl Fn(&Section<'_>, &str) -> Option<T>,
) -> BTreeMap<String, Key> {
    let reader = Reader::default();
    for text in samples {
        if let Ok(document) = document("", text) {
            read(&Section::top(&reader, &document), text);
        }
    }
    reader.keys.into_inner()
}

/// The text without the byte order mark that some editors put first.
fn without_mark(text: &str) -> &str {
    text.strip_prefix('\u{feff}').unwrap_or(text)
}

/// Longest text whose mistakes in syntax are all looked for, bytes; in a longer one the first is reported. Each costs
/// several hundred bytes of memory, and two bytes of text can make one.
const RECOVERED_MAX: usize = 256 << 10;
/// Most mistakes kept of one file.
const FOUND_MAX: usize = 1000;

/// The document, or every mistake in its syntax.
fn document<'t>(file: &str, text: &'t str) -> Result<DeTable<'t>, ConfigErrors> {
    let (table, errors) = if text.len() <= RECOVERED_MAX {
        DeTable::parse_recoverable(text)
    } else {
        match DeTable::parse(text) {
            Ok(table) => (table, Vec::new()),
            Err(first) => return Err(ConfigErrors::new(file, text, vec![not_toml(text, &first)])),
        }
    };
    if errors.is_empty() {
        return Ok(table.into_inner());
    }
    if let Some(found) = syntax::data_table(text) {
        return Err(ConfigErrors::new(file, text, vec![found]));
    }
    Err(ConfigErrors::new(file, text, errors.iter().take(FOUND_MAX).map(|e| not_toml(text, e)).collect()))
}

fn not_toml(text: &str, error: &toml::de::Error) -> Diagnostic {
    let known = error.span().and_then(|span| syntax::known_mistake(text, span.start, error.message()));
    let (message, remedy) = known.unwrap_or_else(|| {
        let remedy = "write key = value; text in \"quotes\", lists in [brackets], # before a comment";
        (error.message().to_owned(), remedy.to_owned())
    });
    Diagnostic { span: error.span(), message: format!("not TOML: {message}"), remedy: Some(remedy) }
}

/// The place of the value of `path`, for mistakes that only show when files are compared; a key that has no value
/// of its own (a table) gives the place of the key.
#[must_use]
pub fn place_of(text: &str, path: &[&str]) -> Option<Range<usize>> {
    let (document, _) = DeTable::parse_recoverable(text);
    let (last, parents) = path.split_last()?;
    let (key, value) = table_at(document.get_ref(), parents)?.get_key_value(*last)?;
    Some(if value.get_ref().is_table() { key.span() } else { value.span() })
}

/// The text of a key, whatever else is wrong in the file; `None` where it states none.
#[must_use]
pub fn text_at(text: &str, path: &[&str]) -> Option<String> {
    let (document, _) = DeTable::parse_recoverable(without_mark(text));
    let (last, parents) = path.split_last()?;
    table_at(document.get_ref(), parents)?.get(*last)?.get_ref().as_str().map(str::to_owned)
}

/// The table below a table.
fn table_at<'t, 'd>(table: &'t DeTable<'d>, path: &[&str]) -> Option<&'t DeTable<'d>> {
    path.iter().try_fold(table, |table, key| table.get(*key)?.get_ref().as_table())
}

/// One table of the document, or its absence.
#[derive(Debug)]
pub(super) struct Section<'r> {
    reader: &'r Reader,
    /// Dotted, for messages; empty at the top.
    path: String,
    table: Option<&'r DeTable<'r>>,
    place: Option<Range<usize>>,
    asked: RefCell<Vec<&'static str>>,
    /// Why keys that end in a unit have this unit and no other.
    reasons: Vec<(&'static str, String)>,
}

impl<'r> Section<'r> {
    fn top(reader: &'r Reader, table: &'r DeTable<'r>) -> Self {
        Self {
            reader,
            path: String::new(),
            table: Some(table),
            place: None,
            asked: RefCell::default(),
            reasons: Vec::new(),
        }
    }

    /// States why keys of this section that end in `-unit` do so.
    pub(super) fn because(mut self, unit: &'static str, reason: String) -> Self {
        self.reasons.push((unit, reason));
        self
    }

    pub(super) fn report(&self, diagnostic: Diagnostic) {
        self.reader.report(diagnostic);
    }

    /// Where the section's name stands.
    pub(super) fn place(&self) -> Option<Range<usize>> {
        self.place.clone()
    }

    pub(super) fn report_at(&self, at: Range<usize>, message: impl Into<String>, remedy: impl Into<String>) {
        self.report(Diagnostic::at(at, message, remedy));
    }

    /// Reports a mistake for which a value is missing.
    pub(super) fn refuse<T>(
        &self,
        at: Range<usize>,
        message: impl Into<String>,
        remedy: impl Into<String>,
    ) -> Option<T> {
        self.report_at(at, message, remedy);
        None
    }

    /// Reports at the section's name.
    pub(super) fn report_here(&self, message: impl Into<String>, remedy: impl Into<String>) {
        self.report(Diagnostic { span: self.place(), message: message.into(), remedy: Some(remedy.into()) });
    }

    /// The section in words.
    pub(super) fn title(&self) -> String {
        if self.path.is_empty() { "the top level".to_owned() } else { format!("[{}]", self.path) }
    }

    /// A table below this one; absent where not written.
    pub(super) fn section(&self, key: &'static str) -> Section<'r> {
        self.shape(key, Shape::Table);
        let found = self.table.and_then(|t| t.get_key_value(key));
        let table = found.and_then(|(k, v)| self.as_table(key, k.span(), v.get_ref()));
        self.below(key, table, found.map(|(k, _)| k.span()))
    }

    /// Reads a table below this one to its end: a key in it that `read` does not ask for is unknown.
    pub(super) fn read<T>(&self, key: &'static str, read: impl FnOnce(&Section<'r>) -> T) -> T {
        self.section(key).whole_by(read)
    }

    /// Reads every table of a key to its end.
    pub(super) fn read_all<T>(&self, key: &'static str, mut read: impl FnMut(&Section<'r>) -> T) -> Vec<T> {
        self.sections(key).iter().map(|part| part.whole_by(&mut read)).collect()
    }

    fn whole_by<T>(&self, read: impl FnOnce(&Self) -> T) -> T {
        let found = read(self);
        self.finish();
        found
    }

    /// The names written in this section, in the order of the text: for tables whose keys are data (axes, errors).
    pub(super) fn names(&self) -> Vec<Placed<&'r str>> {
        let mut names: Vec<_> = self
            .table
            .into_iter()
            .flat_map(|t| t.keys())
            .map(|k| Placed::new(k.get_ref().as_ref(), k.span()))
            .collect();
        names.sort_by_key(|n| n.place.start);
        names
    }

    /// The table of a name from [`Section::names`].
    pub(super) fn named(&self, name: &Placed<&'r str>) -> Option<Section<'r>> {
        let value = self.table?.get(name.value)?;
        let table = self.as_table(name.value, name.place.clone(), value.get_ref())?;
        Some(self.below(name.value, Some(table), Some(name.place.clone())))
    }

    /// The tables written as `[key]` or `[[key]]`.
    pub(super) fn sections(&self, key: &'static str) -> Vec<Section<'r>> {
        self.shape(key, Shape::Tables);
        let Some((name, value)) = self.table.and_then(|t| t.get_key_value(key)) else { return Vec::new() };
        match value.get_ref() {
            DeValue::Array(list) => list
                .iter()
                .filter_map(|item| {
                    let table = self.as_table(key, item.span(), item.get_ref())?;
                    Some(self.below(key, Some(table), Some(item.span())))
                })
                .collect(),
            other => self
                .as_table(key, name.span(), other)
                .map(|table| self.below(key, Some(table), Some(name.span())))
                .into_iter()
                .collect(),
        }
    }

    fn below(&self, key: &str, table: Option<&'r DeTable<'r>>, place: Option<Range<usize>>) -> Section<'r> {
        let path = if self.path.is_empty() { key.to_owned() } else { format!("{}.{key}", self.path) };
        let reader = self.reader;
        Section { reader, path, table, place, asked: RefCell::default(), reasons: self.reasons.clone() }
    }

    fn as_table(&self, key: &str, place: Range<usize>, value: &'r DeValue<'r>) -> Option<&'r DeTable<'r>> {
        value.as_table().or_else(|| {
            self.refuse(
                place,
                format!("{} must be a table, found {}", self.named_key(key), kind_of(value)),
                format!("write a heading [{}] and its keys below it", self.named_key(key)),
            )
        })
    }

    fn prefix(&self) -> String {
        if self.path.is_empty() { String::new() } else { format!("{}.", self.path) }
    }

    /// A key with its section.
    pub(super) fn named_key(&self, key: &str) -> String {
        format!("{}{key}", self.prefix())
    }

    fn ask(&self, key: &'static str) {
        let mut asked = self.asked.borrow_mut();
        if !asked.contains(&key) {
            asked.push(key);
            self.reader.keys.borrow_mut().entry(self.named_key(key)).or_default();
        }
    }

    /// Completes the row of a key in the key table.
    fn note(&self, key: &'static str, change: impl FnOnce(&mut Key)) {
        self.ask(key);
        if let Some(row) = self.reader.keys.borrow_mut().get_mut(&self.named_key(key)) {
            change(row);
        }
    }

    /// States the values of a key that is read by [`Section::value`].
    pub(super) fn shape(&self, key: &'static str, shape: Shape) {
        self.note(key, |row| row.shape = shape);
    }

    /// The same for a key that is known already.
    /// A number, or its default where it is not written or wrong.
    pub(super) fn number_or(&self, key: &'static str, allowed: Allowed, default: f64) -> f64 {
        self.note(key, |row| row.default = Some(default));
        self.number(key, allowed).map_or(default, |n| n.value)
    }

    /// The raw value of a key.
    pub(super) fn value(&self, key: &'static str) -> Option<Placed<&'r DeValue<'r>>> {
        self.ask(key);
        self.table?.get(key).map(|v| Placed::new(v.get_ref(), v.span()))
    }

    /// Reports that a key is missing, unless it is there under another unit (which is reported by itself).
    pub(super) fn missing(&self, key: &'static str, remedy: &str) {
        self.note(key, |row| row.required = true);
        let disguised = self
            .names()
            .iter()
            .any(|n| n.value != key && stem(n.value) == stem(key) && !self.asked.borrow().contains(&n.value));
        if !disguised {
            self.report_here(format!("{} is missing", self.named_key(key)), remedy);
        }
    }

    /// Reports a key that is not written; `None` then.
    pub(super) fn require(&self, key: &'static str, remedy: &str) -> Option<()> {
        let written = self.value(key).map(|_| ());
        if written.is_none() {
            self.missing(key, remedy);
        }
        written
    }

    /// True while nothing has been reported anywhere in the document.
    pub(super) fn is_clean(&self) -> bool {
        self.reader.is_clean()
    }

    /// Reports every key that nobody asked for.
    pub(super) fn finish(&self) {
        let asked = self.asked.borrow();
        for name in self.names() {
            if asked.contains(&name.value) {
                continue;
            }
            if self.reader.is_full() {
                break;
            }
            let other_unit = asked.iter().find(|k| unit_of(k).is_some() && stem(k) == stem(name.value));
            let place = name.place.clone();
            self.report(match other_unit {
                Some(right) => self.wrong_unit(place, name.value, right),
                None => Diagnostic::at(
                    place,
                    format!("unknown key `{}` in {}", name.value, self.title()),
                    suggestion(name.value, &asked, "expected one of: "),
                ),
            });
        }
    }

    fn wrong_unit(&self, place: Range<usize>, written: &str, right: &str) -> Diagnostic {
        let unit = unit_of(right).unwrap_or_default();
        if let Some(wrong) = unit_of(written)
            && let Some(factor) = volcomp_units::conversion(wrong, unit)
        {
            let what = format!("{} has the wrong unit {}", self.named_key(written), in_words(wrong));
            let what = format!("{what}: it is read in {}", in_words(unit));
            let number = self.table.and_then(|t| number_of(t.get(written)?.get_ref()));
            let remedy = match number {
                Some(value) => format!("write {right} = {}", rounded(value * factor)),
                None => format!("write {right} and multiply the values by {}", rounded(factor)),
            };
            return Diagnostic::at(place, what, remedy);
        }
        let reason = self
            .reasons
            .iter()
            .rev()
            .find(|(u, _)| unit == *u || unit.starts_with(&format!("{u}-")))
            .map_or(String::new(), |(_, reason)| format!(": {reason}"));
        let what = match unit_of(written) {
            Some(wrong) => {
                format!("{} has the wrong unit {}{reason}", self.named_key(written), in_words(wrong))
            }
            None => format!("{} lacks its unit{reason}", self.named_key(written)),
        };
        Diagnostic::at(place, what, format!("write {right} and give the values in {}", in_words(unit)))
    }
}

/// Without the noise of a conversion.
fn rounded(v: f64) -> f64 {
    format!("{v:.9e}").parse().unwrap_or(v)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_of_values_and_tables() {
        let text = "machine = \"m\"\n[axes.x]\nlimit-um = 30\n";
        assert_eq!(&text[place_of(text, &["machine"]).unwrap()], "\"m\"");
        assert_eq!(&text[place_of(text, &["axes", "x"]).unwrap()], "x");
        assert_eq!(&text[place_of(text, &["axes", "x", "limit-um"]).unwrap()], "30");
        assert_eq!(place_of(text, &["axes", "y"]), None);
    }
}
