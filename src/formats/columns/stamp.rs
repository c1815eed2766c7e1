//! Time stamps to ticks of 100 ns, so that differences are exact.

use crate::prelude::*;

/// How a stamp is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Form {
    /// `08.11.2022 15:23:24.953`, day first; a leading apostrophe is skipped.
    DayFirst,
    /// `2022-11-08 15:23:24.953` or with `T`.
    YearFirst,
    /// 100 ns since 1601 as a whole number.
    FileTime,
}

impl Form {
    pub(super) fn named(name: &str) -> Self {
        match name {
            "dmy" => Self::DayFirst,
            "ymd" => Self::YearFirst,
            _ => Self::FileTime,
        }
    }

    pub(super) fn ticks(self, field: &Word<'_>) -> Result<i128, FormatError> {
        let (found, expected) = match self {
            Self::FileTime => (
                field.text.parse::<i64>().ok().map(i128::from),
                "a time stamp in steps of 100 ns, a whole number",
            ),
            Self::DayFirst => (date_time(field.text, true), "a time stamp such as 08.11.2022 15:23:24.953"),
            Self::YearFirst => (date_time(field.text, false), "a time stamp such as 2022-11-08 15:23:24.953"),
        };
        found.ok_or_else(|| field.unexpected(expected))
    }
}

/// Ticks of a date and time since 1970.
pub(super) fn date_time(text: &str, day_first: bool) -> Option<i128> {
    let text = text.trim().trim_start_matches('\'').trim_end_matches('Z');
    let (date, time) = text.split_once([' ', 'T'])?;
    let mut parts = date.split(['.', '-', '/']).map(|p| p.parse::<i64>().ok());
    let (a, month, b) = (parts.next()??, parts.next()??, parts.next()??);
    let (year, day) = if day_first { (b, a) } else { (a, b) };
    if parts.next().is_some()
        || !(1..=12).contains(&month)
        || !(1..=31).contains(&day)
        || !(1600..=9999).contains(&year)
    {
        return None;
    }
    let mut parts = time.trim().split(':');
    let (hour, minute) = (parts.next()?.parse::<i64>().ok()?, parts.next()?.parse::<i64>().ok()?);
    let seconds = parts.next().unwrap_or("0");
    let (whole, fraction) = seconds.split_once(['.', ',']).unwrap_or((seconds, ""));
    let whole = whole.parse::<i64>().ok()?;
    let within = (0..24).contains(&hour) && (0..60).contains(&minute) && (0..=60).contains(&whole);
    if parts.next().is_some() || !within || !fraction.bytes().all(|b| b.is_ascii_digit()) {
        return None;
    }
    let digits: String = fraction.chars().chain("0000000".chars()).take(7).collect();
    let seconds = ((days(year, month, day) * 24 + hour) * 60 + minute) * 60 + whole;
    Some(i128::from(seconds) * 10_000_000 + i128::from(digits.parse::<i64>().ok()?))
}

/// Days since 1970 of a Gregorian date (years are counted from March, so that the leap day is the last).
fn days(year: i64, month: i64, day: i64) -> i64 {
    let year = if month <= 2 { year - 1 } else { year };
    let era = year.div_euclid(400);
    let of_era = year - era * 400;
    let of_year = (153 * ((month + 9) % 12) + 2) / 5 + day - 1;
    era * 146_097 + of_era * 365 + of_era / 4 - of_era / 100 + of_year - 719_468
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stamps() {
        assert_eq!(date_time("1970-01-01 00:00:00", false), Some(0));
        assert_eq!(date_time("2000-03-01T00:00:00.5Z", false), Some(951_868_800 * 10_000_000 + 5_000_000));
        let a = date_time("'08.11.2022 15:23:24.953", true).unwrap();
        assert_eq!(a, date_time("2022-11-08 15:23:24.953000", false).unwrap());
        for bad in ["", "8.11.2022", "2022-13-01 00:00", "2022-11-08 25:00:00", "2022-11-08 1:2:3.x", "a b"] {
            assert_eq!(date_time(bad, false), None, "{bad}");
        }
    }
}
