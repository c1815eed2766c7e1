//! Logs of EPICS `camonitor`: `PV  YYYY-MM-DD HH:MM:SS.ffffff value [ALARM SEVERITY]`, one change of one value per line.
//!
//! Values change at their own times; the first stamp of each is that of its last change and may be older than the log.
//! Lines about connections (`*** Not connected`) are counted and left out. Read line by line in bounded memory.

use std::io::BufRead;

use super::columns::date_time_ticks;
use super::error::{FormatError, ReadError};
use super::text::{Encoding, Lines, Word, words};

/// A change of a value.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Change {
    /// Name of the process variable.
    pub pv: String,
    /// Seconds since the first line; negative where older.
    pub t_s: f64,
    /// The value.
    pub value: f64,
    /// Alarm and severity, where there are any.
    pub alarm: String,
}

/// A log being read.
#[derive(Debug)]
pub struct Log<R> {
    lines: Lines<R>,
    origin: Option<i128>,
    change: Change,
    /// Lines about connections.
    pub unconnected: u64,
}

/// True where the beginning of a file looks like this format.
#[must_use]
pub fn recognises(text: &str) -> bool {
    let line = super::text::lines(text).find(|l| !l.text.is_empty());
    line.is_some_and(|line| matches!(read(line), Ok(Some(_))))
}

impl<R: BufRead> Log<R> {
    /// A log.
    pub fn new(source: R) -> Self {
        let lines = Lines::new(source, Some(Encoding::Utf8));
        Self { lines, origin: None, change: Change::default(), unconnected: 0 }
    }

    /// Bytes read so far.
    pub const fn bytes(&self) -> u64 {
        self.lines.bytes()
    }

    /// The current change.
    pub const fn change(&self) -> &Change {
        &self.change
    }

    /// Reads the next change; false at the end.
    ///
    /// # Errors
    /// The source fails, or a line is none of a log.
    pub fn advance(&mut self) -> Result<bool, ReadError> {
        while self.lines.advance()? {
            let found = self
                .lines
                .with_line(|line| if line.text.is_empty() { Ok(None) } else { read(line).map(Some) })?;
            match found {
                None => {}
                Some(None) => self.unconnected += 1,
                Some(Some((ticks, change))) => {
                    let origin = *self.origin.get_or_insert(ticks);
                    self.change = Change { t_s: (ticks - origin) as f64 / 1e7, ..change };
                    return Ok(true);
                }
            }
        }
        Ok(false)
    }
}

/// A line; `None` where it is about a connection.
fn read(line: Word<'_>) -> Result<Option<(i128, Change)>, FormatError> {
    let mut parts = words(line);
    let (Some(pv), Some(date)) = (parts.next(), parts.next()) else {
        return Err(line.unexpected("a line 'PV YYYY-MM-DD HH:MM:SS.ffffff value'"));
    };
    if line.text.contains("***") || date.text == "<undefined>" {
        return Ok(None);
    }
    let (Some(time), Some(value)) = (parts.next(), parts.next()) else {
        return Err(date.unexpected("a date, a time and a value"));
    };
    let stamp = format!("{} {}", date.text, time.text);
    let ticks = date_time_ticks(&stamp)
        .ok_or_else(|| date.unexpected("a date and time such as 2022-11-08 15:23:24.953000"))?;
    let value = value.number("the value of the process variable")?;
    let alarm: Vec<&str> = parts.map(|w| w.text).collect();
    Ok(Some((ticks, Change { pv: pv.text.to_owned(), t_s: 0.0, value, alarm: alarm.join(" ") })))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn all(text: &str) -> Result<(Vec<Change>, u64), ReadError> {
        let mut log = Log::new(text.as_bytes());
        let mut found = Vec::new();
        while log.advance()? {
            found.push(log.change().clone());
        }
        Ok((found, log.unconnected))
    }

    const GOOD: &str = "IOC:X-Pos  2022-11-08 15:23:24.500000 1.25\nIOC:T  2022-11-08 15:23:20.000000 21.5 HIGH MINOR\nIOC:Y *** Not connected (PV not found)\n\nIOC:X-Pos 2022-11-08 15:23:25.000001 1.5\n";

    #[test]
    fn changes_in_their_order() {
        let (found, unconnected) = all(GOOD).unwrap();
        assert!(recognises(GOOD) && !recognises("1 2 3\n"));
        assert_eq!((found[0].t_s, found[1].t_s, found[2].t_s), (0.0, -4.5, 0.500001));
        assert_eq!((found[1].pv.as_str(), found[1].alarm.as_str(), unconnected), ("IOC:T", "HIGH MINOR", 1));
        assert!(
            all(&GOOD.replace("1.25", "on"))
                .unwrap_err()
                .to_string()
                .starts_with("1:39: 'on' is not a finite number")
        );
        assert!(
            all(&GOOD.replace("11-08", "13-08"))
                .unwrap_err()
                .to_string()
                .starts_with("1:12: found '2022-13-08'")
        );
        assert!(all("IOC:X\n").unwrap_err().to_string().contains("expected a line"));
    }

    proptest! {
        #[test]
        fn damaged_logs_never_panic(at in 0..GOOD.len(), with in "[A-Za-z0-9.: \n*-]{0,6}", cut in 0usize..9) {
            let end = (at + cut).min(GOOD.len());
            let _ = all(&format!("{}{with}{}", &GOOD[..at], &GOOD[end..]));
        }
    }
}
