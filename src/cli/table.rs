//! CSV tables, row by row in bounded memory, with errors that name file, line, column, value and remedy.
//!
//! A BOM, CRLF, blank lines and `#` comments are accepted (`docs/reference/files.md` 2). Lines are split here, because every
//! error must name the physical line and `predict` copies it; lines with quotes go through the csv crate.

use std::io::{BufRead, Read};
use std::ops::Range;

use super::input::ROWS_MAX;
use super::positioning_data::no_rows;
use super::progress::Progress;
use crate::prelude::*;
use volcomp_formats::text::finite;
use volcomp_units::conversion;

/// Longest line accepted; bounds the memory whatever the input is.
const LINE_LIMIT: u64 = 1 << 20;

/// Lines between two looks at the clock of the progress bar.
const LINES_PER_LOOK: u64 = 4096;

/// A table being read, with a progress bar where it takes long: the current row and its place.
pub(super) struct Table {
    source: Box<dyn BufRead>,
    file: String,
    columns: Vec<String>,
    /// 1-based line of the current row.
    line: u64,
    /// Bytes read so far.
    bytes: u64,
    /// The current line without its end.
    text: Vec<u8>,
    /// The fields of a line with quotes, joined; unused otherwise.
    unquoted: Vec<u8>,
    /// Where each field of the current row stands, in `text` or `unquoted`.
    fields: Vec<Range<usize>>,
    has_quotes: bool,
    progress: Progress,
    /// Rows that may still come.
    rows_left: u64,
    /// The columns that were asked for by [`column`](Self::column) and its like.
    pub(super) known: Vec<String>,
}

/// What stands for the name of standard input.
pub(super) const STDIN: &str = "<stdin>";

/// Opens a file whose rows are kept in memory, or standard input for `-`.
pub(super) fn open(path: &Path) -> Result<Table> {
    open_as(path, InputKind::Table)
}

/// Opens a file whose rows are not kept, or standard input for `-`.
pub(super) fn open_stream(path: &Path) -> Result<Table> {
    let mut table = open_as(path, InputKind::Stream)?;
    table.rows_left = u64::MAX;
    Ok(table)
}

fn open_as(path: &Path, kind: InputKind) -> Result<Table> {
    Table::new(input::open(path, kind)?.buffered(), name_of(path))
}

/// The name of a file in messages.
pub(super) fn name_of(path: &Path) -> String {
    if path.as_os_str() == "-" { STDIN.to_owned() } else { path.display().to_string() }
}

impl Table {
    /// Reads the header.
    pub(super) fn new(source: impl BufRead + 'static, file: String) -> Result<Self> {
        let progress = Progress::of_file(Path::new(&file));
        let mut table = Self {
            source: Box::new(source),
            file,
            columns: Vec::new(),
            line: 0,
            bytes: 0,
            text: Vec::new(),
            unquoted: Vec::new(),
            fields: Vec::new(),
            has_quotes: false,
            progress,
            rows_left: ROWS_MAX,
            known: Vec::new(),
        };
        if !table.next_line()? {
            return Err(data!(table.file, "the file is empty; the first line names the columns"));
        }
        table.split();
        for i in 0..table.fields.len() {
            let Ok(name) = std::str::from_utf8(table.field(i)).map(str::to_owned) else {
                return Err(table.fail(i, "the column name is not UTF-8 text; is this a CSV file?"));
            };
            if name.is_empty() {
                return Err(table.fail(i, "a column without a name; name it or remove the comma"));
            }
            if name.contains([';', '\t']) {
                let delimiter = if name.contains(';') { "';'" } else { "tab" };
                return Err(table.fail(
                    i,
                    format_args!(
                        "{name:?} holds a {delimiter}; separate columns by commas, with decimal points, or convert the table: \
                         volcomp import {} --columns OUT=COLUMN:UNIT,.. --delimiter {delimiter} --out NEW.csv, with --decimal-comma \
                         where decimals are commas",
                        table.file
                    ),
                ));
            }
            if table.columns.contains(&name) {
                return Err(table.fail(i, format_args!("column {name} occurs twice; remove one")));
            }
            table.columns.push(name);
        }
        Ok(table)
    }

    /// The columns in their order.
    pub(super) fn columns(&self) -> &[String] {
        &self.columns
    }

    /// The header or the current row as written.
    pub(super) fn text(&self) -> &[u8] {
        &self.text
    }

    /// 1-based line of the current row.
    pub(super) const fn line(&self) -> u64 {
        self.line
    }

    /// The file as the user named it.
    pub(super) fn file(&self) -> &str {
        &self.file
    }

    /// Index of a column.
    pub(super) fn find(&self, name: &str) -> Option<usize> {
        self.columns.iter().position(|c| c == name)
    }

    /// Index of a column that must be there.
    pub(super) fn require(&self, name: &str) -> Result<usize> {
        self.find(name).ok_or_else(|| {
            let of_other_unit = || self.columns.iter().find_map(|column| other_unit(column, name));
            let near = || nearest(name, self.columns.iter().map(String::as_str));
            let hint = of_other_unit()
                .or_else(|| near().map(|near| format!("is column {near} meant? rename it")))
                .unwrap_or_else(|| format!("found {}", self.columns.join(", ")));
            self.fail_row(format_args!("column {name} is missing; {hint}"))
        })
    }

    /// Refuses columns that are not known.
    pub(super) fn only(&self, known: &[&str]) -> Result<()> {
        match self.columns.iter().position(|c| !known.contains(&c.as_str())) {
            Some(i) => Err(self.fail(i, format_args!("unknown column; columns are {}", known.join(", ")))),
            None => Ok(()),
        }
    }

    /// Goes to the next row; false at the end.
    pub(super) fn advance(&mut self) -> Result<bool> {
        if !self.next_line()? {
            self.progress.finish();
            return Ok(false);
        }
        if self.line.is_multiple_of(LINES_PER_LOOK) {
            self.progress.update(self.bytes);
        }
        let Some(left) = self.rows_left.checked_sub(1) else {
            return Err(self.fail_row(format_args!(
                "more than {ROWS_MAX} rows; split the table, or keep every n-th row"
            )));
        };
        self.rows_left = left;
        self.split();
        let (found, expected) = (self.fields.len(), self.columns.len());
        if found != expected {
            let hint = if found > expected { "is there a decimal comma?" } else { "is the line cut?" };
            return Err(
                self.fail_row(format_args!("{found} fields, the header has {expected} columns; {hint}"))
            );
        }
        Ok(true)
    }

    /// What `read` makes of every row.
    pub(super) fn rows<T>(&mut self, mut read: impl FnMut(&Self) -> Result<T>) -> Result<Vec<T>> {
        let mut rows = Vec::new();
        while self.advance()? {
            rows.push(read(self)?);
        }
        Ok(rows)
    }

    /// The same, and there must be one.
    pub(super) fn some_rows<T>(&mut self, read: impl FnMut(&Self) -> Result<T>) -> Result<Vec<T>> {
        let rows = self.rows(read)?;
        if rows.is_empty() { Err(no_rows(&self.file)) } else { Ok(rows) }
    }

    /// A finite number.
    #[inline]
    pub(super) fn number(&self, column: impl Into<usize>) -> Result<f64> {
        let column = column.into();
        let parsed = std::str::from_utf8(self.field(column)).ok().and_then(finite);
        parsed.ok_or_else(|| self.bad_number(column))
    }

    /// A finite number; none where the field is empty.
    pub(super) fn number_if_known(&self, column: usize) -> Result<Option<f64>> {
        if self.field(column).is_empty() { Ok(None) } else { self.number(column).map(Some) }
    }

    /// A finite number, or NaN where the field is empty.
    #[cfg(feature = "diagnosis")]
    pub(super) fn number_or_empty(&self, column: usize) -> Result<f64> {
        Ok(self.number_if_known(column)?.unwrap_or(f64::NAN))
    }

    /// A whole number from 0 up.
    pub(super) fn count(&self, column: usize) -> Result<u32> {
        let value = self.number(column)?;
        if value.fract() == 0.0 && (0.0..=f64::from(u32::MAX)).contains(&value) {
            Ok(value as u32)
        } else {
            Err(self.fail(column, format_args!("{value} is not a whole number from 0 to {}", u32::MAX)))
        }
    }

    /// A direction of travel.
    #[inline]
    pub(super) fn travel(&self, column: usize) -> Result<Travel> {
        match self.number(column) {
            Ok(1.0) => Ok(Travel::Forward),
            Ok(-1.0) => Ok(Travel::Reverse),
            Err(e) if self.field(column).is_empty() => Err(e),
            found => {
                let text = found.map_or_else(|_| format!("'{}'", self.word(column)), |v| v.to_string());
                let text: String = text.chars().take(40).collect();
                let what = format!("{text} is no direction; write 1 (towards plus) or -1 (towards minus)");
                Err(self.fail(column, what))
            }
        }
    }

    /// A direction of travel; none where the field is empty, or 0: before the axis has moved.
    #[inline]
    pub(super) fn travel_if_known(&self, column: usize) -> Result<Option<Travel>> {
        if self.field(column).is_empty() {
            return Ok(None);
        }
        match self.travel(column) {
            Err(_) if matches!(self.number(column), Ok(0.0)) => Ok(None),
            found => found.map(Some),
        }
    }

    /// A word.
    pub(super) fn word(&self, column: impl Into<usize>) -> String {
        String::from_utf8_lossy(self.field(column.into())).into_owned()
    }

    /// An error about the current line.
    #[cold]
    pub(super) fn fail_row(&self, what: impl core::fmt::Display) -> Failure {
        failure!(EX_DATAERR, "{}:{}: {what}", self.file, self.line)
    }

    /// An error about a field of the current row.
    #[cold]
    pub(super) fn fail(&self, column: impl Into<usize>, what: impl core::fmt::Display) -> Failure {
        let column = column.into();
        let start = match self.fields.get(column) {
            Some(_) if self.has_quotes => self.quoted_start(column),
            Some(range) => range.start,
            None => 0,
        };
        let at = String::from_utf8_lossy(&self.text[..start]).chars().count() + 1;
        let name = self.columns.get(column).map_or(String::new(), |c| format!("{c}: "));
        failure!(EX_DATAERR, "{}:{}:{at}: {name}{what}", self.file, self.line)
    }

    #[cold]
    fn bad_number(&self, column: usize) -> Failure {
        let text: String = String::from_utf8_lossy(self.field(column)).chars().take(40).collect();
        let what = if text.is_empty() {
            "the field is empty; write a number or leave the row out".to_owned()
        } else if let Ok(value) = text.parse::<f64>() {
            let what = if value.is_finite() { "beyond 1e30" } else { "not finite" };
            format!("{text} is {what}; leave the row out")
        } else {
            format!("'{text}' is not a number; write digits with a decimal point, such as 12.5")
        };
        self.fail(column, what)
    }

    fn field(&self, column: usize) -> &[u8] {
        let source = if self.has_quotes { &self.unquoted } else { &self.text };
        &source[self.fields[column].clone()]
    }

    /// Reads lines until one holds data; false at the end of the file.
    fn next_line(&mut self) -> Result<bool> {
        loop {
            self.text.clear();
            let read = (&mut self.source)
                .take(LINE_LIMIT)
                .read_until(b'\n', &mut self.text)
                .map_err(|e| Failure::io(Path::new(&self.file), &e))?;
            if read == 0 {
                return Ok(false);
            }
            self.bytes += read as u64;
            self.line += 1;
            if read as u64 == LINE_LIMIT {
                return Err(self.fail_row(format_args!(
                    "the line has more than {LINE_LIMIT} bytes; is this a CSV file?"
                )));
            }
            if self.line == 1 && self.text.starts_with(b"\xef\xbb\xbf") {
                self.text.drain(..3);
            }
            let end = self.text.iter().rposition(|b| !b.is_ascii_whitespace()).map_or(0, |i| i + 1);
            self.text.truncate(end);
            match self.text.iter().find(|b| !b.is_ascii_whitespace()) {
                None | Some(b'#') => {}
                Some(_) => return Ok(true),
            }
        }
    }

    fn split(&mut self) {
        self.fields.clear();
        self.has_quotes = self.text.contains(&b'"');
        if self.has_quotes {
            self.split_quoted();
            return;
        }
        let mut start = 0;
        for (i, b) in self.text.iter().enumerate() {
            if *b == b',' {
                self.fields.push(trimmed(&self.text, start..i));
                start = i + 1;
            }
        }
        self.fields.push(trimmed(&self.text, start..self.text.len()));
    }

    /// Where a field of a line with quotes begins.
    fn quoted_start(&self, column: usize) -> usize {
        // only at the beginning of a field does a quote open one
        let (mut is_quoted, mut begins) = (false, true);
        let commas = self.text.iter().enumerate().filter(|(_, b)| {
            is_quoted ^= **b == b'"' && (is_quoted || begins);
            begins = **b == b',' && !is_quoted;
            **b == b',' && !is_quoted
        });
        let before = column.checked_sub(1).and_then(|k| commas.map(|(at, _)| at + 1).nth(k));
        before.unwrap_or(0)
    }

    fn split_quoted(&mut self) {
        self.unquoted.clear();
        let mut reader = csv::ReaderBuilder::new().has_headers(false).from_reader(self.text.as_slice());
        let mut record = csv::ByteRecord::new();
        // reading bytes from memory cannot fail, and a row of the wrong length is found by its caller
        if matches!(reader.read_byte_record(&mut record), Ok(true)) {
            for field in &record {
                let start = self.unquoted.len();
                self.unquoted.extend_from_slice(field);
                self.fields.push(trimmed(&self.unquoted, start..self.unquoted.len()));
            }
        }
    }
}

fn trimmed(text: &[u8], range: Range<usize>) -> Range<usize> {
    let field = &text[range.clone()];
    let front = field.iter().take_while(|b| b.is_ascii_whitespace()).count();
    let back = field[front..].iter().rev().take_while(|b| b.is_ascii_whitespace()).count();
    range.start + front..range.end - back
}

/// What to do with a column that is the `wanted` one in another unit, or without one.
pub(super) fn other_unit(column: &str, wanted: &str) -> Option<String> {
    let (stem, unit) = wanted.rsplit_once('_')?;
    conversion(unit, unit)?;
    let Some(found) = column.strip_prefix(stem)?.strip_prefix('_') else {
        return (column == stem)
            .then(|| format!("{column} states no unit: name it {wanted} if it is in {unit}"));
    };
    conversion(found, found)?;
    Some(match conversion(found, unit) {
        Some(1.0) => return None,
        Some(factor) => {
            let (verb, factor) = if factor < 1.0 { ("divide", 1.0 / factor) } else { ("multiply", factor) };
            let factor = format!("{factor:.6}");
            let factor = factor.trim_end_matches('0').trim_end_matches('.');
            format!("{column} is in {found}: {verb} by {factor} and name it {wanted}")
        }
        None => format!("{column} is in {found}, {unit} is needed"),
    })
}

/// The name that `wanted` may be a slip of: equal but for case and punctuation, or one or two letters off.
pub(super) fn nearest<'a>(wanted: &str, names: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    let plain = |s: &str| s.replace(|c: char| !c.is_ascii_alphanumeric(), "").to_ascii_lowercase();
    let target = plain(wanted);
    let limit = if target.len() > 5 { 2 } else { 1 };
    let near = names.map(|n| (strsim::levenshtein(&target, &plain(n)), n)).filter(|(d, _)| *d <= limit);
    near.min_by_key(|(d, _)| *d).map(|(_, n)| n)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Cursor;

    fn table(text: &str) -> Result<Table> {
        Table::new(Cursor::new(text.to_owned()), "t.csv".to_owned())
    }

    fn error(text: &str) -> String {
        let mut t = match table(text) {
            Ok(t) => t,
            Err(f) => return f.message,
        };
        loop {
            match t.advance() {
                Ok(false) => return String::new(),
                Ok(true) => {}
                Err(f) => return f.message,
            }
            for i in 0..t.columns().len() {
                if let Err(f) = t.number(i) {
                    assert_eq!(f.code, EX_DATAERR);
                    return f.message;
                }
            }
        }
    }

    #[test]
    fn bom_crlf_blanks_comments_and_quotes() {
        let mut t = table("\u{feff}# made by hand\r\n\r\n a ,\"b\"\r\n1, 2 \r\n  # note\r\n\r\n\"3\",\" 4\"")
            .unwrap();
        assert_eq!(t.columns(), ["a", "b"]);
        let mut rows = Vec::new();
        while t.advance().unwrap() {
            rows.push((t.line, t.number(0usize).unwrap(), t.number(1usize).unwrap()));
        }
        assert_eq!(rows, [(4, 1.0, 2.0), (7, 3.0, 4.0)]);
    }

    #[test]
    fn errors_name_the_place() {
        for (text, expected) in [
            ("", "t.csv: the file is empty"),
            ("# only a comment\n", "t.csv: the file is empty"),
            ("a,b\n1,2\n3,x4\n", "t.csv:3:3: b: 'x4' is not a number"),
            ("a,b\n1,nan\n", "t.csv:2:3: b: nan is not finite"),
            ("a,b\n1e999,2\n", "t.csv:2:1: a: 1e999 is not finite"),
            ("a,b\n1,\n", "t.csv:2:3: b: the field is empty"),
            ("a,b\n1\n", "t.csv:2: 1 fields, the header has 2 columns; is the line cut?"),
            ("a,b\n\n#\n1,5,2\n", "t.csv:4: 3 fields, the header has 2 columns; is there a decimal comma?"),
            ("a,b,a\n", "t.csv:1:5: column a occurs twice"),
            ("a,,b\n", "t.csv:1:3: a column without a name"),
            ("a;b\n", "t.csv:1:1: \"a;b\" holds a ';'; separate columns by commas"),
            (
                "a\tb\n",
                "--columns OUT=COLUMN:UNIT,.. --delimiter tab --out NEW.csv, with --decimal-comma where decimals are commas",
            ),
        ] {
            let message = error(text);
            assert!(message.contains(expected), "{text:?} gives {message:?}");
        }
    }

    #[test]
    fn binary_and_endless_lines_are_refused() {
        let t = Table::new(&b"\xff\xfe\x00,b\n"[..], "t.csv".to_owned());
        assert!(t.err().unwrap().message.contains("not UTF-8"));
        let endless = vec![b'7'; 3 << 20];
        let t = Table::new(Cursor::new(endless), "t.csv".to_owned());
        assert!(t.err().unwrap().message.contains("more than 1048576 bytes"));
    }

    #[test]
    fn slips_are_recognised() {
        let names = ["position_mm", "exx_um", "x_mm"];
        assert_eq!(nearest("Position-mm", names.into_iter()), Some("position_mm"));
        assert_eq!(nearest("positon_mm", names.into_iter()), Some("position_mm"));
        assert_eq!(nearest("X_mm", names.into_iter()), Some("x_mm"));
        assert_eq!(nearest("operator", names.into_iter()), None);
    }

    #[test]
    fn a_column_in_another_unit_is_to_be_converted_not_renamed() {
        for (column, wanted, words) in [
            (
                "deviation_mm",
                "deviation_um",
                "deviation_mm is in mm: multiply by 1000 and name it deviation_um",
            ),
            ("target_um", "target_mm", "target_um is in um: divide by 1000 and name it target_mm"),
            ("target_in", "target_mm", "target_in is in in: multiply by 25.4 and name it target_mm"),
            ("angle_rad", "angle_deg", "angle_rad is in rad: multiply by 57.29578 and name it angle_deg"),
            ("deviation_um", "deviation_arcsec", "deviation_um is in um, arcsec is needed"),
            ("deviation", "deviation_um", "deviation states no unit: name it deviation_um if it is in um"),
        ] {
            assert_eq!(other_unit(column, wanted).as_deref(), Some(words));
        }
        for (column, wanted) in
            [("exx_um", "eyx_um"), ("cycle", "deviation_um"), ("position_x", "position_mm")]
        {
            assert_eq!(other_unit(column, wanted), None);
        }
    }

    #[test]
    fn counts_and_directions() {
        let mut t = table("cycle,direction\n3,-1\n1.5,0\n-1,1\n").unwrap();
        t.advance().unwrap();
        assert_eq!((t.count(0).unwrap(), t.travel(1).unwrap()), (3, Travel::Reverse));
        t.advance().unwrap();
        assert!(t.count(0).is_err() && t.travel(1).is_err());
        t.advance().unwrap();
        assert!(t.count(0).is_err());
        assert_eq!(t.travel(1).unwrap(), Travel::Forward);
    }
}
