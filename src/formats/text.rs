//! Text of files that do not say how they are encoded: decoding, words with their columns, lines in bounded memory.

use std::borrow::Cow;
use std::io::{BufRead, Read};

use encoding_rs::{Encoding as Codec, GBK, UTF_8, WINDOWS_1250, WINDOWS_1252};

use super::error::{FormatError, FormatErrorKind, ReadError, short};

/// How the characters of a file are stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Encoding {
    /// UTF-8, with or without a mark.
    #[default]
    Utf8,
    /// UTF-16 with a mark.
    Utf16,
    /// Windows code page of Central Europe.
    Cp1250,
    /// Windows code page of Western Europe.
    Cp1252,
    /// Simplified Chinese.
    Gbk,
}

impl Encoding {
    /// The name as people know it.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Utf8 => "UTF-8",
            Self::Utf16 => "UTF-16",
            Self::Cp1250 => "cp1250",
            Self::Cp1252 => "cp1252",
            Self::Gbk => "GBK",
        }
    }

    const fn codec(self) -> &'static Codec {
        match self {
            Self::Utf8 | Self::Utf16 => UTF_8,
            Self::Cp1250 => WINDOWS_1250,
            Self::Cp1252 => WINDOWS_1252,
            Self::Gbk => GBK,
        }
    }

    /// The bytes of a text; `None` where the encoding lacks one of its characters.
    #[cfg(test)]
    pub(crate) fn encode(self, text: &str) -> Option<Vec<u8>> {
        if self == Self::Utf16 {
            let marked = core::iter::once(0xfeff).chain(text.encode_utf16());
            return Some(marked.flat_map(u16::to_le_bytes).collect());
        }
        let (bytes, _, lossy) = self.codec().encode(text);
        (!lossy).then(|| bytes.into_owned())
    }
}

/// A text and how it was stored.
#[derive(Debug, Clone, PartialEq)]
pub struct Decoded<'a> {
    /// The text without a mark.
    pub text: Cow<'a, str>,
    /// Its encoding.
    pub encoding: Encoding,
    /// True where the encoding is a guess from the bytes; digits are the same in all of them.
    pub guessed: bool,
}

/// Decodes a file in a stated encoding.
///
/// # Errors
/// Bytes that the encoding does not have.
pub fn decode_as(bytes: &[u8], encoding: Encoding) -> Result<Decoded<'_>, FormatError> {
    let text = match encoding {
        Encoding::Utf16 => {
            Codec::for_bom(bytes).filter(|(codec, _)| codec.name().starts_with("UTF-16")).and_then(
                |(codec, mark)| codec.decode_without_bom_handling_and_without_replacement(&bytes[mark..]),
            )
        }
        _ => encoding
            .codec()
            .decode_without_bom_handling_and_without_replacement(bytes.strip_prefix(MARK).unwrap_or(bytes)),
    };
    text.map(|text| Decoded { text, encoding, guessed: false }).ok_or_else(|| {
        // the place of the first byte that is no UTF-8; other encodings name none
        let end = match core::str::from_utf8(bytes) {
            Err(e) if encoding == Encoding::Utf8 => e.valid_up_to(),
            _ => bytes.len(),
        };
        let line = bytes[..end].iter().filter(|b| **b == b'\n').count() + 1;
        FormatError::at(line, 1, FormatErrorKind::Encoding { encoding: encoding.name() })
    })
}

const MARK: &[u8] = b"\xef\xbb\xbf";

/// Decodes a file: by its mark, as UTF-8, else by a guess between GBK, cp1250 and cp1252.
///
/// Every byte string decodes: cp1252 is the last resort.
#[must_use]
pub fn decode(bytes: &[u8]) -> Decoded<'_> {
    if matches!(bytes, [0xff, 0xfe, ..] | [0xfe, 0xff, ..])
        && let Ok(text) = decode_as(bytes, Encoding::Utf16)
    {
        return text;
    }
    if let Ok(text) = decode_as(bytes, Encoding::Utf8) {
        return text;
    }
    let encoding = guess(bytes);
    let (text, _) = encoding.codec().decode_without_bom_handling(bytes);
    Decoded { text, encoding, guessed: true }
}

/// Chinese text stands in runs of at least two characters of two high bytes; a letter with an accent stands between
/// plain letters. Between the European pages the letters that only one of them has decide.
fn guess(bytes: &[u8]) -> Encoding {
    let (mut longest, mut even) = (0, true);
    for run in bytes.split(u8::is_ascii) {
        longest = longest.max(run.len());
        even &= run.len().is_multiple_of(2)
            && run.chunks_exact(2).all(|p| (0xa1..=0xf7).contains(&p[0]) && (0xa1..=0xfe).contains(&p[1]));
    }
    if even && longest >= 4 {
        return Encoding::Gbk;
    }
    // Polish, Czech, Slovak and Hungarian letters that are signs in cp1252
    const EASTERN: [u8; 14] =
        [0x8a, 0x8c, 0x8d, 0x8f, 0x9a, 0x9c, 0x9d, 0x9f, 0xa3, 0xa5, 0xaf, 0xb3, 0xb9, 0xbf];
    if bytes.iter().any(|b| EASTERN.contains(b)) { Encoding::Cp1250 } else { Encoding::Cp1252 }
}

/// Numbers beyond this are no measurements; below it squares and sums stay finite.
pub const NUMBER_LIMIT: f64 = 1e30;

/// A number that can have been measured.
#[must_use]
pub fn finite(text: &str) -> Option<f64> {
    text.parse().ok().filter(|v: &f64| v.abs() <= NUMBER_LIMIT)
}

/// A word of a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Word<'a> {
    /// 1-based line.
    pub line: usize,
    /// 1-based column, in characters.
    pub column: usize,
    /// The word.
    pub text: &'a str,
}

impl<'a> Word<'a> {
    /// A mistake here.
    #[must_use]
    pub fn fail(&self, kind: FormatErrorKind) -> FormatError {
        FormatError::at(self.line, self.column, kind)
    }

    /// Something else was expected here.
    #[must_use]
    pub fn unexpected(&self, expected: &'static str) -> FormatError {
        self.fail(FormatErrorKind::Expected { expected, found: short(self.text) })
    }

    /// A count that is not the announced one.
    pub(super) fn count(&self, what: &'static str, announced: usize, found: usize) -> FormatError {
        let (announced, found) = (announced as u64, found as u64);
        self.fail(FormatErrorKind::Count { what, announced, found })
    }

    /// Given before, on line `first`.
    pub(super) fn twice(&self, what: impl Into<String>, first: usize) -> FormatError {
        self.fail(FormatErrorKind::Twice { what: what.into(), first })
    }

    /// More than the limit.
    pub(super) fn too_many(&self, what: &'static str, found: usize, limit: usize) -> FormatError {
        self.fail(FormatErrorKind::TooMany { what, found, limit })
    }

    /// A finite number, at most 1e30.
    ///
    /// # Errors
    /// Anything else.
    pub fn number(&self, what: &'static str) -> Result<f64, FormatError> {
        finite(self.text).ok_or_else(|| self.fail(FormatErrorKind::Number { text: short(self.text), what }))
    }

    /// A whole number from `low` to `high`.
    ///
    /// # Errors
    /// Anything else.
    pub fn whole(&self, what: &'static str, low: u32, high: u32) -> Result<u32, FormatError> {
        let value = self.number(what)?;
        if value.fract() == 0.0 && (f64::from(low)..=f64::from(high)).contains(&value) {
            return Ok(value as u32);
        }
        Err(self.fail(FormatErrorKind::Range { what, value, low: f64::from(low), high: f64::from(high) }))
    }

    /// The part of the word from byte `from` on.
    #[must_use]
    pub fn tail(&self, from: usize) -> Word<'a> {
        let (head, text) = self.text.split_at_checked(from).unwrap_or((self.text, ""));
        let blanks = text.chars().take_while(|c| c.is_whitespace()).count();
        Word { line: self.line, column: self.column + head.chars().count() + blanks, text: text.trim() }
    }
}

/// The lines of a text with their numbers, as words without blanks around them.
pub fn lines(text: &str) -> impl Iterator<Item = Word<'_>> {
    text.trim_start_matches('\u{feff}').lines().enumerate().map(|(i, line)| {
        let column = line.chars().take_while(|c| c.is_whitespace()).count() + 1;
        Word { line: i + 1, column, text: line.trim() }
    })
}

/// The words of a line, separated by blanks.
pub fn words<'a>(line: Word<'a>) -> impl Iterator<Item = Word<'a>> + Clone {
    fields(line, char::is_whitespace).filter(|w| !w.text.is_empty())
}

/// The fields of a line between separators, trimmed; empty ones are kept.
pub fn fields<'a>(
    line: Word<'a>,
    separator: impl Fn(char) -> bool + Clone,
) -> impl Iterator<Item = Word<'a>> + Clone {
    let mut column = line.column;
    line.text.split(separator).map(move |field| {
        let blanks = field.chars().take_while(|c| c.is_whitespace()).count();
        let word = Word { line: line.line, column: column + blanks, text: field.trim() };
        column += field.chars().count() + 1;
        word
    })
}

/// Longest line accepted; bounds the memory whatever the input is.
pub const LINE_LIMIT: usize = 1 << 20;

/// Lines of a source one by one, in bounded memory.
#[derive(Debug)]
pub struct Lines<R> {
    source: R,
    encoding: Option<Encoding>,
    /// The current line; of UTF-16 with the mark before it, by which it is decoded.
    buffer: Vec<u8>,
    line: usize,
    bytes: u64,
    /// The byte-order mark of UTF-16 in which the source is, where it is.
    wide: Option<[u8; 2]>,
}

impl<R: BufRead> Lines<R> {
    /// Lines in an encoding; each line is guessed for itself where it is not stated.
    pub const fn new(source: R, encoding: Option<Encoding>) -> Self {
        Self { source, encoding, buffer: Vec::new(), line: 0, bytes: 0, wide: None }
    }

    /// Bytes read so far.
    pub const fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Reads the next line; false at the end.
    ///
    /// # Errors
    /// The source fails, or a line without end.
    pub fn advance(&mut self) -> Result<bool, ReadError> {
        self.buffer.clear();
        if self.line == 0 && self.encoding.is_none_or(|e| e == Encoding::Utf16) {
            let (wide, mark) = match self.source.fill_buf()? {
                [a @ (0xff | 0xfe), b @ (0xff | 0xfe), ..] if a != b => (Some([*a, *b]), 2),
                // without a mark: the zero byte of a plain character
                [1..=0xff, 0, ..] => (Some([0xff, 0xfe]), 0),
                [0, 1..=0xff, ..] => (Some([0xfe, 0xff]), 0),
                _ => (None, 0),
            };
            self.wide = wide;
            self.source.consume(mark);
            self.bytes += mark as u64;
        }
        let read = match self.wide {
            Some(mark) => self.read_wide(mark)?,
            None => self.read_until_newline()?,
        };
        self.bytes += read as u64;
        self.line += 1;
        if self.buffer.len() > LINE_LIMIT {
            return Err(
                FormatError::at(self.line, 1, FormatErrorKind::LineTooLong { limit: LINE_LIMIT }).into()
            );
        }
        if self.line == 1 && self.buffer.starts_with(MARK) {
            self.buffer.drain(..MARK.len());
        }
        Ok(read > 0)
    }

    /// Appends what comes up to the next byte of a newline; number of bytes read.
    fn read_until_newline(&mut self) -> std::io::Result<usize> {
        let limit = (LINE_LIMIT + 1).saturating_sub(self.buffer.len()) as u64;
        Read::take(&mut self.source, limit).read_until(b'\n', &mut self.buffer)
    }

    /// A line of UTF-16 behind its mark; number of bytes read.
    fn read_wide(&mut self, mark: [u8; 2]) -> std::io::Result<usize> {
        let newline = if mark[0] == 0xff { [b'\n', 0] } else { [0, b'\n'] };
        self.buffer.extend(mark);
        while self.read_until_newline()? > 0 {
            // the byte found may be one half of another character
            if !self.buffer.len().is_multiple_of(2) {
                Read::take(&mut self.source, 1).read_to_end(&mut self.buffer)?;
            }
            if self.buffer.ends_with(&newline) {
                break;
            }
        }
        Ok(self.buffer.len() - mark.len())
    }

    /// The current line without blanks around it, handed to `body`.
    ///
    /// # Errors
    /// Bytes that a stated encoding does not have, or what `body` finds.
    pub fn with_line<T>(
        &self,
        body: impl FnOnce(Word<'_>) -> Result<T, FormatError>,
    ) -> Result<T, FormatError> {
        let text = match self.encoding {
            Some(encoding) => {
                decode_as(&self.buffer, encoding).map_err(|e| FormatError::at(self.line, 1, e.kind))?.text
            }
            None => decode(&self.buffer).text,
        };
        let column = text.chars().take_while(|c| c.is_whitespace()).count() + 1;
        body(Word { line: self.line, column, text: text.trim() })
    }

    /// 1-based number of the current line.
    pub const fn line(&self) -> usize {
        self.line
    }
}

/// The shortest number that reads back the same, with at least `decimals` decimals.
#[must_use]
pub fn number(value: f64, decimals: usize) -> String {
    // a minus before nothing reads back as another zero and helps nobody
    let value = if value == 0.0 { 0.0 } else { value };
    let short = value.to_string();
    let present = short.split_once('.').map_or(0, |(_, d)| d.len());
    if present < decimals { format!("{value:.decimals$}") } else { short }
}

/// Decimals of a number of a control's table at most: far below what matters, mm or rad.
pub(crate) const DECIMALS_MAX: usize = 12;

/// A number of a control's table: rounded to 1e-12, with at least `decimals` decimals.
///
/// Values of a curve carry the rounding of its evaluation; without it, what was read would not be written alike.
#[must_use]
pub fn rounded(value: f64, decimals: usize) -> String {
    let text = format!("{value:.DECIMALS_MAX$}");
    match text.parse::<f64>() {
        Ok(value) => number(value, decimals),
        Err(_) => text,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn tables_are_rounded() {
        assert_eq!(rounded(0.010000000000000002, 1), "0.01");
        assert_eq!(rounded(-1e-14, 2), "0.00");
        assert_eq!(rounded(1e-5, 1), "0.00001");
    }

    #[test]
    fn encodings_are_told_apart() {
        for (text, encoding) in [
            ("Machine: DMG", Encoding::Utf8),
            ("Machine: Fräse", Encoding::Utf8),
            ("Machine: Fräse in Größe 3", Encoding::Cp1252),
            ("Stroj: Obráběcí střed č. 3, Łódź", Encoding::Cp1250),
            ("Machine: 数控机床 A", Encoding::Gbk),
            ("Machine: 铣床", Encoding::Utf16),
        ] {
            let bytes = encoding.encode(text).unwrap();
            let found = decode(&bytes);
            assert_eq!((found.text.as_ref(), found.encoding), (text, encoding));
            assert_eq!(found.guessed, !matches!(encoding, Encoding::Utf8 | Encoding::Utf16));
            assert_eq!(decode_as(&bytes, encoding).unwrap().text, text);
        }
        assert_eq!(Encoding::Cp1252.encode("铣床"), None);
        let e = decode_as(b"a\nb \xff\n", Encoding::Utf8).unwrap_err();
        assert_eq!(e.to_string(), "2:1: the file is not UTF-8 text; name its encoding");
    }

    #[test]
    fn words_know_their_columns() {
        let all: Vec<Word<'_>> = lines("\u{feff} ä  12\r\n\n3;; 4").collect();
        let found: Vec<_> = words(all[0]).map(|w| (w.line, w.column, w.text)).collect();
        assert_eq!(found, [(1, 2, "ä"), (1, 5, "12")]);
        assert!(words(all[1]).next().is_none());
        let found: Vec<_> = fields(all[2], |c| c == ';').map(|w| (w.column, w.text)).collect();
        assert_eq!(found, [(1, "3"), (3, ""), (5, "4")]);
        assert_eq!(all[0].tail(3), Word { line: 1, column: 5, text: "12" });
    }

    #[test]
    fn lines_are_bounded() {
        let endless = vec![b'7'; LINE_LIMIT + 2];
        let mut lines = Lines::new(endless.as_slice(), None);
        assert!(lines.advance().unwrap_err().to_string().contains("more than 1048576 bytes"));
        let mut lines = Lines::new(&b"\xef\xbb\xbfa\r\nb"[..], None);
        let mut found = Vec::new();
        while lines.advance().unwrap() {
            found.push(lines.with_line(|w| Ok(w.text.to_owned())).unwrap());
        }
        assert_eq!((found, lines.bytes()), (vec!["a".to_owned(), "b".to_owned()], 7));
    }

    #[test]
    fn lines_of_utf16_are_read_in_either_order_of_bytes() {
        // U+0A0A and U+0D0A hold the bytes of a newline and end no line
        let text = "Soll;\u{0a0a}\u{0d0a}\r\n1;2\n\nend";
        let little = Encoding::Utf16.encode(text).unwrap();
        let big: Vec<u8> = little.chunks_exact(2).flat_map(|p| [p[1], p[0]]).collect();
        for bytes in [&little[..], &big[..], &little[2..], &big[2..]] {
            for encoding in [None, Some(Encoding::Utf16)] {
                let mut lines = Lines::new(bytes, encoding);
                let mut found = Vec::new();
                while lines.advance().unwrap() {
                    found.push(lines.with_line(|w| Ok((w.column, w.text.to_owned()))).unwrap());
                }
                let texts: Vec<&str> = found.iter().map(|(_, text)| text.as_str()).collect();
                assert_eq!(texts, ["Soll;\u{0a0a}\u{0d0a}", "1;2", "", "end"]);
                assert_eq!((found[0].0, lines.bytes()), (1, bytes.len() as u64));
            }
        }
        let endless: Vec<u8> = [0xff, 0xfe].into_iter().chain(vec![b'7'; LINE_LIMIT + 2]).collect();
        assert!(Lines::new(&endless[..], None).advance().is_err());
    }

    proptest! {
        #[test]
        fn numbers_read_back(value in prop::num::f64::NORMAL, decimals in 0usize..7) {
            prop_assert_eq!(number(value, decimals).parse::<f64>().unwrap(), value);
        }

        #[test]
        fn any_bytes_decode(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
            let _ = decode(&bytes);
        }
    }
}
