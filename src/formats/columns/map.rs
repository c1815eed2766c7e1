//! The map: text to validated columns and units.

use serde::Deserialize;

use super::Delimiter;
use super::stamp;
use crate::error::{FormatError, FormatErrorKind, short};
use crate::text::{Encoding, Word};
use volcomp_units::{RAD_PER_ARCSEC, RAD_PER_DEG};

/// Which column of a table means what.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ColumnMap {
    /// What separates columns; guessed from the first line where missing.
    pub delimiter: Option<Delimiter>,
    /// True where numbers have a decimal comma.
    pub decimal_comma: bool,
    /// Lines above the table.
    pub skip_lines: usize,
    /// True where the first line of the table names the columns.
    pub header: bool,
    /// The encoding; guessed line by line where missing.
    pub encoding: Option<Encoding>,
    /// Outputs and where they come from.
    pub columns: Vec<(String, Source)>,
}

/// Where an output comes from.
#[derive(Debug, Clone, PartialEq)]
pub struct Source {
    pub(super) column: ColumnRef,
    /// The unit of the column, and what its numbers are multiplied by for the output.
    pub(super) unit: Conversion,
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum ColumnRef {
    Name(String),
    /// From 1 up.
    Index(usize),
}

/// A unit of a column or of an output.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Unit {
    name: &'static str,
    dimension: Dimension,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Dimension {
    Length,
    Angle,
    Time,
    Stamp,
    Plain,
}

/// Units, their dimension and their size in mm, rad or s, as numerator and denominator: thousandths stay exact.
const UNITS: [(&str, Dimension, [f64; 2]); 23] = [
    ("mm", Dimension::Length, [1.0, 1.0]),
    ("um", Dimension::Length, [1.0, 1e3]),
    ("nm", Dimension::Length, [1.0, 1e6]),
    ("m", Dimension::Length, [1e3, 1.0]),
    ("inch", Dimension::Length, [25.4, 1.0]),
    ("rad", Dimension::Angle, [1.0, 1.0]),
    ("mrad", Dimension::Angle, [1.0, 1e3]),
    ("urad", Dimension::Angle, [1.0, 1e6]),
    ("deg", Dimension::Angle, [RAD_PER_DEG, 1.0]),
    ("arcsec", Dimension::Angle, [RAD_PER_ARCSEC, 1.0]),
    ("s", Dimension::Time, [1.0, 1.0]),
    ("ms", Dimension::Time, [1.0, 1e3]),
    ("us", Dimension::Time, [1.0, 1e6]),
    ("min", Dimension::Time, [60.0, 1.0]),
    // time stamps become seconds since the first
    ("dmy", Dimension::Stamp, [1.0, 1.0]),
    ("ymd", Dimension::Stamp, [1.0, 1.0]),
    ("filetime", Dimension::Stamp, [1.0, 1.0]),
    ("1", Dimension::Plain, [1.0, 1.0]),
    ("n", Dimension::Plain, [1.0, 1.0]),
    ("degc", Dimension::Plain, [1.0, 1.0]),
    ("rpm", Dimension::Plain, [1.0, 1.0]),
    ("percent", Dimension::Plain, [1.0, 1.0]),
    ("a", Dimension::Plain, [1.0, 1.0]),
];

/// From the unit of a column to that of its output.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Conversion {
    Factor { times: f64, per: f64, angle: bool },
    Stamp(stamp::Form),
}

impl Conversion {
    const PLAIN: Self = Self::Factor { times: 1.0, per: 1.0, angle: false };

    pub(super) fn read(
        self,
        field: &Word<'_>,
        decimal_comma: bool,
        origin: &mut Option<i128>,
    ) -> Result<f64, FormatError> {
        match self {
            Self::Factor { times, per, .. } => {
                if !decimal_comma {
                    return Ok(field.number("a number with a decimal point")? * times / per);
                }
                let what = "a number with a decimal comma and no other point or comma";
                let plain = field.text.replace(',', ".");
                let wrong = || field.fail(FormatErrorKind::Number { text: short(field.text), what });
                if field.text.contains('.') {
                    return Err(wrong());
                }
                Ok(Word { text: &plain, ..*field }.number(what).map_err(|_| wrong())? * times / per)
            }
            Self::Stamp(form) => {
                let ticks = form.ticks(field)?;
                let first = *origin.get_or_insert(ticks);
                Ok((ticks - first) as f64 / 1e7)
            }
        }
    }
}

impl Unit {
    fn find(name: &str) -> Option<(Self, [f64; 2])> {
        let entry = UNITS.into_iter().find(|(n, ..)| *n == name)?;
        Some((Self { name: entry.0, dimension: entry.1 }, entry.2))
    }
}

/// The file of a map.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
struct Wire {
    delimiter: Option<String>,
    #[serde(default)]
    decimal_comma: bool,
    #[serde(default)]
    skip_lines: usize,
    #[serde(default = "yes")]
    header: bool,
    encoding: Option<String>,
    columns: toml::Table,
}

const fn yes() -> bool {
    true
}

/// Outputs that make a positioning test, and the unit in which they come out: mm or rad, um and arcsec are for the
/// writer of the product's table.
const TEST: [&str; 5] = ["target", "actual", "deviation", "cycle", "direction"];

impl ColumnMap {
    /// Reads a map from TOML.
    ///
    /// # Errors
    /// The first mistake, with its place.
    pub fn from_toml(text: &str) -> Result<Self, FormatError> {
        let text = text.trim_start_matches('\u{feff}');
        let wire: Wire = toml::from_str(text).map_err(|e| {
            let at = e.span().map_or(0, |s| s.start.min(text.len()));
            let before = text.get(..at).unwrap_or("");
            let line = before.matches('\n').count() + 1;
            let column = before.rsplit('\n').next().unwrap_or("").chars().count() + 1;
            FormatError::at(line, column, FormatErrorKind::Syntax { message: e.message().to_owned() })
        })?;
        let mut map = Self {
            delimiter: wire.delimiter.as_deref().map(str::parse).transpose()?,
            decimal_comma: wire.decimal_comma,
            skip_lines: wire.skip_lines,
            header: wire.header,
            encoding: wire.encoding.as_deref().map(str::parse).transpose()?,
            columns: Vec::new(),
        };
        for (name, source) in &wire.columns {
            match source {
                toml::Value::String(source) => map.add(name, source)?,
                other => {
                    return Err(wrong(
                        &format!("{name} = {other}"),
                        "a text such as \"Soll:mm\" or \"#3:um\"",
                    ));
                }
            }
        }
        Ok(map)
    }

    /// Adds an output, from a source such as `Soll:mm` or `#3:um`.
    ///
    /// # Errors
    /// An output without a unit, a unit that is not known or does not suit.
    pub fn add(&mut self, output: &str, source: &str) -> Result<(), FormatError> {
        if self.columns.iter().any(|(n, _)| n == output) {
            let what = format!("output {output}");
            return Err(FormatError::of_file(FormatErrorKind::Twice { what, first: self.columns.len() }));
        }
        let (column, unit) = match source.rsplit_once(':') {
            Some((column, unit)) => (column.trim(), Some(unit.trim())),
            None => (source.trim(), None),
        };
        let column = match column.strip_prefix('#').map(str::parse::<usize>) {
            Some(Ok(i)) if (1..=10_000).contains(&i) => ColumnRef::Index(i),
            Some(_) => return Err(wrong(column, "a column number such as #1")),
            None if column.is_empty() => return Err(wrong(source, "the name or #number of a column")),
            None => ColumnRef::Name(column.to_owned()),
        };
        let unit = conversion(output, unit)?;
        self.columns.push((output.to_owned(), Source { column, unit }));
        Ok(())
    }

    /// Index of an output.
    #[must_use]
    pub fn output(&self, name: &str) -> Option<usize> {
        self.columns.iter().position(|(n, _)| n == name)
    }

    /// True where an output is an angle.
    #[must_use]
    pub fn is_angle(&self, name: &str) -> bool {
        let found = self.columns.iter().find(|(n, _)| n == name);
        found.is_some_and(|(_, s)| matches!(s.unit, Conversion::Factor { angle: true, .. }))
    }

    /// True where the outputs make a positioning test.
    #[must_use]
    pub fn is_test(&self) -> bool {
        self.output("target").is_some()
    }

    /// Checks that the outputs belong together.
    ///
    /// # Errors
    /// Half a positioning test, or one mixed with a series.
    pub fn check(&self) -> Result<(), FormatError> {
        let missing = |what, remedy| Err(FormatError::of_file(FormatErrorKind::Missing { what, remedy }));
        if self.columns.is_empty() {
            return missing("an output", "give --columns OUTPUT=COLUMN:UNIT,.. or a --map with [columns]");
        }
        let of_test: Vec<&str> = TEST.into_iter().filter(|n| self.output(n).is_some()).collect();
        if of_test.is_empty() {
            return Ok(());
        }
        if of_test.len() < self.columns.len() {
            return missing(
                "a decision",
                "target, actual, deviation, cycle and direction make a positioning test and stand alone; for a series give names such as target_mm",
            );
        }
        if self.output("target").is_none() {
            return missing("the output target", "a positioning test needs it");
        }
        match (self.output("actual"), self.output("deviation")) {
            (None, None) => missing("the output deviation or actual", "a positioning test needs one of them"),
            (Some(_), Some(_)) => missing("a decision", "deviation and actual say the same; keep one"),
            _ => Ok(()),
        }
    }
}

/// The conversion for an output; a positioning test comes out in mm or rad.
fn conversion(output: &str, unit: Option<&str>) -> Result<Conversion, FormatError> {
    let known = "a unit: mm um nm m inch rad mrad urad deg arcsec s ms us min dmy ymd filetime n degc rpm percent a 1";
    let given = unit.map(|u| Unit::find(u).ok_or_else(|| wrong(u, known))).transpose()?;
    if TEST.contains(&output) {
        return match (output, given) {
            ("cycle" | "direction", unit) if unit.is_none_or(|(u, _)| u.name == "1") => Ok(Conversion::PLAIN),
            (_, Some((u, size))) if matches!(u.dimension, Dimension::Length | Dimension::Angle) => {
                Ok(Conversion::Factor {
                    times: size[0],
                    per: size[1],
                    angle: u.dimension == Dimension::Angle,
                })
            }
            _ => Err(wrong(output, "a unit of length or angle behind the column, such as Soll:mm")),
        };
    }
    let Some((out, out_size)) = output.rsplit_once('_').and_then(|(_, unit)| Unit::find(unit)) else {
        return Err(wrong(output, "an output that ends in its unit, such as t_s, x_mm or temp_degc"));
    };
    let Some((given, size)) = given else { return Ok(Conversion::PLAIN) };
    match (given.dimension, out.dimension) {
        (Dimension::Stamp, Dimension::Time) if out.name == "s" => {
            Ok(Conversion::Stamp(stamp::Form::named(given.name)))
        }
        (a, b) if a == b && (a != Dimension::Plain || given.name == out.name) => Ok(Conversion::Factor {
            times: size[0] * out_size[1],
            per: size[1] * out_size[0],
            angle: a == Dimension::Angle,
        }),
        _ => Err(wrong(output, "a unit of the column that the output can be converted from")),
    }
}

fn wrong(found: &str, expected: &'static str) -> FormatError {
    FormatError::of_file(FormatErrorKind::Expected { expected, found: short(found) })
}

impl core::str::FromStr for Delimiter {
    type Err = FormatError;

    /// A delimiter by its name or character.
    fn from_str(text: &str) -> Result<Self, FormatError> {
        match text {
            "tab" | "\t" => Ok(Self::Character('\t')),
            "blank" | "blanks" | " " => Ok(Self::Blanks),
            ";" | "semicolon" => Ok(Self::Character(';')),
            "," | "comma" => Ok(Self::Character(',')),
            "|" => Ok(Self::Character('|')),
            _ => Err(wrong(text, "a delimiter: ; , | tab or blank")),
        }
    }
}

impl core::str::FromStr for Encoding {
    type Err = FormatError;

    /// An encoding by its name.
    fn from_str(text: &str) -> Result<Self, FormatError> {
        let known = [Self::Utf8, Self::Utf16, Self::Cp1250, Self::Cp1252, Self::Gbk];
        let plain = |t: &str| t.to_ascii_lowercase().replace('-', "");
        known
            .into_iter()
            .find(|e| plain(e.name()) == plain(text))
            .ok_or_else(|| wrong(text, "an encoding: utf-8 utf-16 cp1250 cp1252 or gbk"))
    }
}
