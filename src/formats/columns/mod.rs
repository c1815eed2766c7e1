//! Any table of numbers, through a map that says which column means what.
//!
//! A map names the outputs and where each comes from: `target = "Soll:mm"` is the column with the header `Soll`, in
//! mm; `deviation = "#3:um"` is the third column. With `target` and `deviation` (or `actual`) the table is a positioning
//! test, whose `cycle` and `direction` are derived from the order of the positions where they have no column. Any other
//! outputs are a series; their names end in the unit that comes out (`t_s`, `x_mm`, `force_n`).
//!
//! Rows are read one by one in bounded memory.

mod map;
mod order;
mod stamp;

pub use map::{ColumnMap, Source, Unit};
pub use order::{Placed, Runs};

use std::io::BufRead;

use super::error::{FormatError, FormatErrorKind, ReadError, short};
use super::text::{Lines, Word};

/// A table being read.
#[derive(Debug)]
pub struct Columns<R> {
    lines: Lines<R>,
    map: ColumnMap,
    delimiter: Delimiter,
    /// By output: index of its column.
    indices: Vec<usize>,
    /// Columns of the header, or of the first row where there is none.
    width: usize,
    /// By output: the first time stamp, from which the others count.
    origins: Vec<Option<i128>>,
    /// A table without a header: its first row was read to find the delimiter.
    pending: bool,
    values: Vec<f64>,
}

/// What stands between fields.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Delimiter {
    /// One character.
    Character(char),
    /// Any blanks.
    Blanks,
}

impl<R: BufRead> Columns<R> {
    /// Skips the lines above the table and reads its header.
    ///
    /// # Errors
    /// The source fails, the header is missing or does not have a column of the map.
    pub fn new(source: R, map: ColumnMap) -> Result<Self, ReadError> {
        let mut lines = Lines::new(source, map.encoding);
        for skipped in 0..map.skip_lines {
            if !lines.advance()? {
                let what = "lines above the table";
                let (announced, found) = (map.skip_lines as u64, skipped as u64);
                let kind = FormatErrorKind::Count { what, announced, found };
                return Err(FormatError::at(lines.line(), 1, kind).into());
            }
        }
        let origins = vec![None; map.columns.len()];
        let mut table = Self {
            lines,
            delimiter: Delimiter::Blanks,
            indices: Vec::new(),
            width: 0,
            origins,
            pending: false,
            values: Vec::new(),
            map,
        };
        if !table.next_line()? {
            let remedy = "the file ends above it; check skip-lines";
            return Err(FormatError::missing(table.lines.line(), "the table", remedy).into());
        }
        table.find_columns()?;
        table.pending = !table.map.header;
        Ok(table)
    }

    /// Names of the outputs, in the order of [`values`](Self::values).
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.map.columns.iter().map(|(name, _)| name.as_str())
    }

    /// 1-based number of the current line.
    pub const fn line(&self) -> usize {
        self.lines.line()
    }

    /// Bytes read so far.
    pub const fn bytes(&self) -> u64 {
        self.lines.bytes()
    }

    /// The current row: one number per output.
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// Reads the next row; false at the end.
    ///
    /// # Errors
    /// The source fails, a field is missing or no number.
    pub fn advance(&mut self) -> Result<bool, ReadError> {
        if !std::mem::take(&mut self.pending) && !self.next_line()? {
            return Ok(false);
        }
        let (map, indices, origins, delimiter, width) =
            (&self.map, &self.indices, &mut self.origins, self.delimiter, self.width);
        let values = &mut self.values;
        values.clear();
        self.lines.with_line(|line| {
            let fields = split(line, delimiter);
            // many writers end every row with a delimiter
            if fields.iter().skip(width).any(|field| !field.text.is_empty()) {
                let found = fields.len();
                return Err(line.fail(FormatErrorKind::Surplus { columns: width, found }));
            }
            for (i, (index, (_, source))) in indices.iter().zip(&map.columns).enumerate() {
                let Some(field) = fields.get(*index) else {
                    return Err(line.count("fields", index + 1, fields.len()));
                };
                values.push(source.unit.read(field, map.decimal_comma, &mut origins[i])?);
            }
            Ok(())
        })?;
        Ok(true)
    }

    /// Goes to the next line that holds data; false at the end.
    fn next_line(&mut self) -> Result<bool, ReadError> {
        while self.lines.advance()? {
            if self.lines.with_line(|l| Ok(!l.text.is_empty() && !l.text.starts_with('#')))? {
                return Ok(true);
            }
        }
        Ok(false)
    }

    fn find_columns(&mut self) -> Result<(), FormatError> {
        let map = &self.map;
        let (delimiter, width, indices) = self.lines.with_line(|line| {
            let delimiter = map.delimiter.unwrap_or_else(|| guess(line.text, map.decimal_comma));
            let header = split(line, delimiter);
            let find = |source: &Source| match &source.column {
                map::ColumnRef::Index(i) if *i <= header.len() => Ok(i - 1),
                map::ColumnRef::Index(i) => Err(line.count("columns", *i, header.len())),
                map::ColumnRef::Name(name) if map.header => {
                    // case decides only where it has to
                    let exact = header.iter().any(|w| w.text == name);
                    let same = |w: &Word<'_>| w.text == name || (!exact && w.text.eq_ignore_ascii_case(name));
                    let mut found = header.iter().enumerate().filter(|(_, w)| same(w));
                    match (found.next(), found.next()) {
                        (Some((i, _)), None) => Ok(i),
                        (Some(_), Some((_, word))) => Err(word.twice(format!("column {name}"), line.line)),
                        _ => {
                            let why =
                                "the header has no such column; check the map, the delimiter and skip-lines";
                            Err(line.fail(FormatErrorKind::NotRead {
                                name: format!("column {}", short(name)),
                                why,
                            }))
                        }
                    }
                }
                map::ColumnRef::Name(name) => {
                    let why = "the table has no header; give its number as #1, #2 ..";
                    Err(line.fail(FormatErrorKind::NotRead { name: format!("column {}", short(name)), why }))
                }
            };
            let indices = map.columns.iter().map(|(_, s)| find(s)).collect::<Result<Vec<_>, _>>()?;
            Ok((delimiter, header.len(), indices))
        })?;
        (self.delimiter, self.width, self.indices) = (delimiter, width, indices);
        Ok(())
    }
}

/// The delimiter of a line: the rarest in plain text that occurs.
fn guess(line: &str, decimal_comma: bool) -> Delimiter {
    let found = ['\t', ';', ','].into_iter().find(|c| line.contains(*c) && !(*c == ',' && decimal_comma));
    found.map_or(Delimiter::Blanks, Delimiter::Character)
}

/// The fields of a line; quotes around a field hide delimiters and are taken off.
fn split(line: Word<'_>, delimiter: Delimiter) -> Vec<Word<'_>> {
    let is_end = |c: char| match delimiter {
        Delimiter::Character(d) => c == d,
        Delimiter::Blanks => c.is_whitespace(),
    };
    let mut fields = Vec::new();
    let mut take = |from: usize, to: usize, column: usize| {
        let field = &line.text[from..to];
        if field.trim().is_empty() && delimiter == Delimiter::Blanks {
            return;
        }
        let blanks = field.chars().take_while(|c| c.is_whitespace()).count();
        let text = field.trim().trim_matches('"').trim();
        fields.push(Word { line: line.line, column: column + blanks, text });
    };
    let (mut quoted, mut start, mut column) = (false, 0, line.column);
    for (n, (i, c)) in line.text.char_indices().enumerate() {
        quoted ^= c == '"';
        if is_end(c) && !quoted {
            take(start, i, column);
            start = i + c.len_utf8();
            column = line.column + n + 1;
        }
    }
    take(start, line.text.len(), column);
    fields
}

/// Days since 1970 of a day such as `2022-11-08`; `None` for any other text.
#[must_use]
pub fn day(text: &str) -> Option<i64> {
    const TICKS: i128 = 864_000_000_000;
    let ticks = (!text.contains([' ', 'T'])).then(|| stamp::date_time(&format!("{text} 00:00"), false))??;
    i64::try_from(ticks.div_euclid(TICKS)).ok()
}

/// Seconds since 1970 of a stamp such as `2022-11-08 15:23:24.953`; `None` for any other text.
#[must_use]
pub fn date_time_s(text: &str) -> Option<f64> {
    date_time_ticks(text).map(|ticks| ticks as f64 * 1e-7)
}

/// A stamp such as `2022-11-08 15:23:24.953` in steps of 100 ns.
pub(crate) fn date_time_ticks(text: &str) -> Option<i128> {
    stamp::date_time(text, false)
}

#[cfg(test)]
mod tests;
