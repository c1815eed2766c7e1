//! Renishaw `.rtx`: dynamic laser tests. A text header, then 64-bit numbers.
//!
//! `HEADER::`, lines `key: text` (Filename, Owner, Version no, File Type, Velocity, Sample rate, Sample no, Trigger
//! point, Trigger interval, Actual sample rate, Flags, Machine, Serial No, Date, By, Axis, Location), `Data:`, then
//! `Sample no` little-endian f64, then `EOF::`. Line ends are CR LF; the header is shorter than 8 KiB. The numbers are
//! displacements in mm, or angles in mrad where an angular optic was used: the header does not tell which.
//!
//! Source: two public converters. The header is read in full, the samples one block at a time.

use std::io::{Read, Write};

use super::error::{FormatError, FormatErrorKind, Place, ReadError, short};
use super::rtl::{Entry, text_of};
use super::text::{NUMBER_LIMIT, decode, lines, number};

/// Longest header accepted, bytes.
pub const HEADER_MAX: usize = 8192;
const FIRST_LINE: &[u8] = b"HEADER::";
const DATA_LINE: &[u8] = b"Data:\r\n";
const END: &[u8] = b"\r\nEOF::";
/// Samples per block.
const BLOCK: usize = 8192;

/// What the header says.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Header {
    /// Its lines in their order.
    pub entries: Vec<Entry>,
    /// Samples that follow.
    pub samples: u64,
    /// Samples per second.
    pub rate_hz: f64,
    /// Bytes up to the first sample.
    pub length: usize,
}

impl Header {
    /// A text of the header, where it is not empty.
    #[must_use]
    pub fn text(&self, key: &str) -> Option<&str> {
        text_of(&self.entries, key)
    }
}

/// True where the beginning of a file looks like this format.
#[must_use]
pub fn recognises(head: &[u8]) -> bool {
    head.starts_with(FIRST_LINE) && find(head, b"Sample no").is_some()
}

fn find(bytes: &[u8], what: &[u8]) -> Option<usize> {
    bytes.windows(what.len()).position(|w| w == what)
}

/// Reads the header from the beginning of a file (at least [`HEADER_MAX`] bytes of it, or all).
///
/// # Errors
/// What is missing or wrong, with its line.
pub fn header(head: &[u8]) -> Result<Header, FormatError> {
    if !head.starts_with(FIRST_LINE) {
        let found = short(&decode(&head[..head.len().min(16)]).text);
        return Err(FormatError::at(1, 1, FormatErrorKind::Expected { expected: "HEADER::", found }));
    }
    let head = &head[..head.len().min(HEADER_MAX)];
    let Some(end) = find(head, DATA_LINE) else {
        return Err(FormatError::missing(
            1,
            "the line 'Data:'",
            "the first 8192 bytes hold none; is this an .rtx file?",
        ));
    };
    let decoded = decode(&head[..end]);
    let mut header = Header { length: end + DATA_LINE.len(), ..Header::default() };
    let (mut samples, mut rate, mut actual) = (None, None, None);
    let mut last = 1;
    for line in lines(&decoded.text).skip(1).filter(|l| !l.text.is_empty()) {
        last = line.line;
        let Some((key, _)) = line.text.split_once(':') else {
            return Err(line.unexpected("a line 'key: text'"));
        };
        let text = line.tail(key.len() + 1);
        match key.trim() {
            "Sample no" => {
                let count = text.number("a number of samples")?;
                if count.fract() != 0.0 || !(1.0..=1e15).contains(&count) {
                    let what = "the number of samples";
                    return Err(text.fail(FormatErrorKind::Range {
                        what,
                        value: count,
                        low: 1.0,
                        high: 1e15,
                    }));
                }
                samples = Some(count as u64);
            }
            // the rate that was asked for is only used where the one that came out is missing
            "Sample rate" if !text.text.is_empty() => rate = Some((text, text.number("samples per second")?)),
            "Actual sample rate" if !text.text.is_empty() => {
                actual = Some((text, text.number("samples per second")?));
            }
            _ => {}
        }
        header.entries.push(Entry { key: key.trim().to_owned(), text: text.text.to_owned() });
    }
    header.samples =
        samples.ok_or_else(|| FormatError::missing(last, "'Sample no'", "add the number of samples"))?;
    let usable = actual.filter(|(_, r)| *r != 0.0).or(rate);
    let (word, rate) =
        usable.ok_or_else(|| FormatError::missing(last, "'Actual sample rate'", "add samples per second"))?;
    if !(1e-6..=1e9).contains(&rate) {
        let what = "the sample rate in Hz";
        return Err(word.fail(FormatErrorKind::Range { what, value: rate, low: 1e-6, high: 1e9 }));
    }
    header.rate_hz = rate;
    Ok(header)
}

/// The samples of a file, block by block.
#[derive(Debug)]
pub struct Samples<R> {
    source: R,
    header: Header,
    buffer: Vec<u8>,
    done: u64,
}

impl<R: Read> Samples<R> {
    /// Reads the header.
    ///
    /// # Errors
    /// The source fails, or the header is wrong.
    pub fn new(mut source: R) -> Result<Self, ReadError> {
        let mut buffer = Vec::with_capacity(HEADER_MAX);
        (&mut source).take(HEADER_MAX as u64).read_to_end(&mut buffer)?;
        let header = header(&buffer)?;
        buffer.drain(..header.length);
        Ok(Self { source, header, buffer, done: 0 })
    }

    /// The header.
    pub const fn header(&self) -> &Header {
        &self.header
    }

    /// Offset of the next sample in the file.
    pub const fn position(&self) -> u64 {
        self.header.length as u64 + self.done * 8
    }

    /// The next samples, appended to `into`; false at the end, when the end mark has been seen.
    ///
    /// # Errors
    /// The source fails, samples are missing or not finite, or something else than the end mark follows.
    pub fn read(&mut self, into: &mut Vec<f64>) -> Result<bool, ReadError> {
        let left = self.header.samples - self.done;
        if left == 0 {
            self.end()?;
            return Ok(false);
        }
        let wanted = (left.min(BLOCK as u64) * 8) as usize;
        if self.buffer.len() < wanted {
            let missing = (wanted - self.buffer.len()) as u64;
            (&mut self.source).take(missing).read_to_end(&mut self.buffer)?;
        }
        let whole = self.buffer.len().min(wanted) / 8 * 8;
        for chunk in self.buffer[..whole].chunks_exact(8) {
            let value = f64::from_le_bytes(chunk.try_into().unwrap_or_default());
            if value.is_nan() || value.abs() > NUMBER_LIMIT {
                let kind =
                    FormatErrorKind::Number { text: format!("{value:e}"), what: "a sample in mm or mrad" };
                return Err(FormatError { place: Place::Byte(self.position()), kind }.into());
            }
            into.push(value);
            self.done += 1;
        }
        self.buffer.drain(..whole);
        if whole < wanted {
            let (announced, found) = (self.header.samples, self.done);
            let kind = FormatErrorKind::Count { what: "samples", announced, found };
            return Err(FormatError { place: Place::Byte(self.position()), kind }.into());
        }
        Ok(true)
    }

    /// The end mark may be missing, but nothing else may stand there.
    fn end(&mut self) -> Result<(), ReadError> {
        (&mut self.source).take(64).read_to_end(&mut self.buffer)?;
        let rest = self.buffer.trim_ascii();
        if rest.is_empty() || (self.buffer.starts_with(END) && rest.starts_with(b"EOF::") && rest.len() == 5)
        {
            return Ok(());
        }
        let kind = FormatErrorKind::Expected {
            expected: "EOF:: behind the last sample",
            found: short(&decode(rest).text),
        };
        Err(FormatError { place: Place::Byte(self.position()), kind }.into())
    }
}

/// Writes a file: the header's lines with the counts set right, then the samples.
///
/// # Errors
/// The target fails.
pub fn write(target: &mut impl Write, header: &Header, samples: &[f64]) -> std::io::Result<()> {
    target.write_all(b"HEADER::\r\n")?;
    let mut entries = header.entries.clone();
    for (key, text) in
        [("Sample no", samples.len().to_string()), ("Actual sample rate", number(header.rate_hz, 0))]
    {
        match entries.iter_mut().find(|e| e.key == key) {
            Some(entry) => entry.text = text,
            None => entries.push(Entry { key: key.to_owned(), text }),
        }
    }
    for e in entries {
        let clean = |t: &str| t.replace(['\r', '\n'], " ");
        write!(target, "{}: {}\r\n", clean(&e.key), clean(&e.text))?;
    }
    target.write_all(DATA_LINE)?;
    for value in samples {
        target.write_all(&value.to_le_bytes())?;
    }
    target.write_all(END)?;
    target.write_all(b"\r\n")
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn entry(key: &str, text: &str) -> Entry {
        Entry { key: key.into(), text: text.into() }
    }

    fn file(samples: &[f64]) -> Vec<u8> {
        let entries = vec![
            entry("Filename", "C:\\data\\a.rtx"),
            entry("Owner", "CARTO-Dynamic"),
            entry("Sample rate", "50000"),
            entry("Flags", "0 1 2 0 2"),
            entry("Axis", ""),
        ];
        let mut out = Vec::new();
        write(&mut out, &Header { entries, rate_hz: 49_999.5, ..Header::default() }, samples).unwrap();
        out
    }

    fn read(bytes: &[u8]) -> Result<(Header, Vec<f64>), ReadError> {
        let mut samples = Samples::new(bytes)?;
        let mut all = Vec::new();
        while samples.read(&mut all)? {}
        Ok((samples.header().clone(), all))
    }

    #[test]
    fn what_is_written_reads_back() {
        let samples: Vec<f64> = (0..20_000).map(|i| f64::from(i).sin()).collect();
        let (header, back) = read(&file(&samples)).unwrap();
        assert_eq!(back, samples);
        assert_eq!((header.rate_hz, header.samples), (49_999.5, 20_000));
        assert_eq!((header.text("owner"), header.text("Axis")), (Some("CARTO-Dynamic"), None));
        let mut again = Vec::new();
        write(&mut again, &header, &back).unwrap();
        assert_eq!(again, file(&samples));
        assert!(recognises(&again));
    }

    #[test]
    fn the_end_mark_may_be_missing_but_no_sample() {
        let whole = file(&[1.0, 2.0, 3.0]);
        let end = whole.len() - 9;
        assert_eq!(read(&whole[..end]).unwrap().1, [1.0, 2.0, 3.0]);
        let cut = read(&whole[..end - 3]).unwrap_err().to_string();
        assert!(cut.contains("samples: 3 announced, 2 found") && cut.starts_with("byte "), "{cut}");
        let mut more = whole[..end].to_vec();
        more.extend_from_slice(&[7; 24]);
        assert!(read(&more).unwrap_err().to_string().contains("expected EOF:: behind the last sample"));
        let mut nan = whole.clone();
        nan[end - 16..end - 8].copy_from_slice(&f64::NAN.to_le_bytes());
        assert!(read(&nan).unwrap_err().to_string().contains("'NaN' is not a finite number"));
    }

    #[test]
    fn damaged_headers_name_the_line() {
        let whole = file(&[1.0]);
        let fails = |from: &str, to: &str| {
            let at = find(&whole, from.as_bytes()).unwrap();
            let mut bytes = whole.clone();
            bytes.splice(at..at + from.len(), to.bytes());
            read(&bytes).unwrap_err().to_string()
        };
        assert!(fails("Sample no: 1", "Sample no: x").starts_with("7:12: 'x' is not a finite number"));
        assert!(fails("Sample no: 1", "Sample no: 0").starts_with("7:12: the number of samples is 0"));
        assert!(fails("Sample no: 1", "Samples: 1").contains("'Sample no' is missing"));
        assert!(
            fails("Actual sample rate: 49999.5", "Actual sample rate: -3")
                .contains("the sample rate in Hz is -3")
        );
        assert!(fails("Data:\r\n", "Date:\r\n").contains("the line 'Data:' is missing"));
        assert!(fails("HEADER::", "HEADEX::").starts_with("1:1: found 'HEADEX::"));
        assert!(fails("Owner: CARTO", "Owner CARTO").starts_with("3:1: found 'Owner CARTO-Dynamic'"));
    }

    proptest! {
        #[test]
        fn damaged_files_never_panic(at in 0usize..260, with in prop::collection::vec(any::<u8>(), 0..9), cut in 0usize..9) {
            let mut bytes = file(&[0.5, -0.25]);
            let at = at.min(bytes.len());
            let end = (at + cut).min(bytes.len());
            bytes.splice(at..end, with);
            let _ = read(&bytes);
        }
    }
}
