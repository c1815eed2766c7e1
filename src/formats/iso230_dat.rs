//! The `.dat` files of ISO 230-2 tests written by ecmc loggers: shell-like assignments, one per line.
//!
//! `TGT_DATA[i]=` target, `REF_DATA_FWD[i,j]=` and `REF_DATA_BWD[i,j]=` reference position approached forward and
//! backward, `i` target, `j` cycle (both from 1), `UNIT=` (mm where missing), `CYCLES=` and `POSITIONS=` as counts.
//! Deviation = reference - target. Other keys are ignored; `#` starts a comment. The file does not state the order between the
//! directions: the readings are given in the order of the standard test cycle of ISO 230-2.

use std::collections::BTreeMap;

use super::positioning_test::{Order, PositioningTest};
use super::text::finite;
use volcomp_identify::Reading;
use volcomp_units::axes::{AxisKind, Travel};
use volcomp_units::{mm_from_um, rad_from_arcsec, rad_from_deg};

/// What is wrong, and where: 1-based line and column; line 0 where the file as a whole is wrong.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{line}:{column}: {kind}")]
pub struct DatError {
    /// 1-based line.
    pub line: usize,
    /// 1-based column, in characters.
    pub column: usize,
    /// What is wrong.
    pub kind: DatErrorKind,
}

/// What is wrong with a `.dat` file.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum DatErrorKind {
    /// Not an assignment.
    #[error("invalid assignment '{text}'; a line reads KEY=VALUE or starts with #")]
    NotAnAssignment {
        /// The line, shortened.
        text: String,
    },
    /// An index that is none.
    #[error("invalid index '{text}'; write {form} with whole numbers from 1 up")]
    BadIndex {
        /// What stands there.
        text: String,
        /// What should stand there.
        form: &'static str,
    },
    /// Not a finite number.
    #[error("'{text}' is not a finite number up to 1e30")]
    BadNumber {
        /// What stands there.
        text: String,
    },
    /// The same entry again.
    #[error("this entry was given before, on line {first}; remove one")]
    Twice {
        /// Line of the first.
        first: usize,
    },
    /// A reference position without its target.
    #[error("position {position} has readings but no TGT_DATA[{position}]; add the target")]
    NoTarget {
        /// Its index.
        position: usize,
    },
    /// A unit that is not known.
    #[error("unit '{text}' is not known; use mm, um, deg or arcsec")]
    UnknownUnit {
        /// The unit.
        text: String,
    },
    /// Counts that differ from what the file announces.
    #[error("{key} says {announced}, the data have {found}; the file is cut or the count wrong")]
    Count {
        /// CYCLES or POSITIONS.
        key: &'static str,
        /// The number announced.
        announced: usize,
        /// The number found.
        found: usize,
    },
    /// No data at all.
    #[error("no REF_DATA_FWD or REF_DATA_BWD; is this an ISO 230-2 .dat file?")]
    Empty,
}

/// One number with the place at which it stood.
struct Entry {
    line: usize,
    column: usize,
    value: f64,
}

/// A number of the file to mm or rad.
type ToInner = fn(f64) -> f64;

#[derive(Default)]
struct Raw {
    targets: BTreeMap<usize, Entry>,
    /// By target, cycle, direction (0 forward, 1 backward).
    references: BTreeMap<(usize, usize, u8), Entry>,
    unit: Option<(usize, usize, String)>,
    cycles: Option<Entry>,
    positions: Option<Entry>,
}

/// True where a text looks like such a file.
#[must_use]
pub fn recognises(text: &str) -> bool {
    text.lines().any(|l| l.contains("REF_DATA_FWD[") || l.contains("REF_DATA_BWD["))
}

/// Reads a file.
///
/// # Errors
/// The first mistake, with its line.
pub fn parse(text: &str) -> Result<PositioningTest, DatError> {
    let mut raw = Raw::default();
    for (i, line) in text.trim_start_matches('\u{feff}').lines().enumerate() {
        raw.read_line(i + 1, line)?;
    }
    raw.finish()
}

impl Raw {
    fn read_line(&mut self, line: usize, text: &str) -> Result<(), DatError> {
        let body = text.split('#').next().unwrap_or("");
        if body.trim().is_empty() {
            return Ok(());
        }
        let column_of = |part: &str| {
            let offset = part.as_ptr() as usize - text.as_ptr() as usize;
            text[..offset].chars().count() + 1
        };
        let Some((key, value)) = body.split_once('=') else {
            let text: String = body.trim().chars().take(40).collect();
            let column = column_of(body.trim_start());
            return Err(DatError { line, column, kind: DatErrorKind::NotAnAssignment { text } });
        };
        let (key, value) = (key.trim(), value.trim().trim_matches('"').trim());
        let at = (line, column_of(value));
        if let Some(index) = indexed(key, "TGT_DATA") {
            let index = indices::<1>(index, (line, column_of(index)), "TGT_DATA[position]")?;
            insert(&mut self.targets, index[0], number(value, at)?)
        } else if let Some((index, direction)) = indexed(key, "REF_DATA_FWD")
            .map(|i| (i, 0))
            .or_else(|| indexed(key, "REF_DATA_BWD").map(|i| (i, 1)))
        {
            let [i, j] = indices(index, (line, column_of(index)), "REF_DATA_FWD[position,cycle]")?;
            insert(&mut self.references, (i, j, direction), number(value, at)?)
        } else {
            match key {
                "UNIT" => self.unit = Some((at.0, at.1, value.to_lowercase())),
                "CYCLES" => self.cycles = Some(number(value, at)?),
                "POSITIONS" => self.positions = Some(number(value, at)?),
                _ => {}
            }
            Ok(())
        }
    }

    fn finish(self) -> Result<PositioningTest, DatError> {
        if self.references.is_empty() {
            return Err(DatError { line: 0, column: 0, kind: DatErrorKind::Empty });
        }
        let (kind, scale) = self.scale()?;
        let distinct = |pick: fn(&(usize, usize, u8)) -> usize| {
            self.references.keys().map(pick).collect::<std::collections::BTreeSet<_>>().len()
        };
        let counts =
            [("CYCLES", &self.cycles, distinct(|k| k.1)), ("POSITIONS", &self.positions, distinct(|k| k.0))];
        for (key, announced, found) in counts {
            if let Some(entry) = announced
                && entry.value != found as f64
            {
                let announced = entry.value as usize;
                let kind = DatErrorKind::Count { key, announced, found };
                return Err(DatError { line: entry.line, column: entry.column, kind });
            }
        }
        let mut readings = Vec::with_capacity(self.references.len());
        let mut lines = Vec::with_capacity(self.references.len());
        for ((position, cycle, direction), entry) in &self.references {
            let Some(target) = self.targets.get(position) else {
                let kind = DatErrorKind::NoTarget { position: *position };
                return Err(DatError { line: entry.line, column: 1, kind });
            };
            readings.push(Reading {
                cycle: *cycle as u32,
                travel: if *direction == 0 { Travel::Forward } else { Travel::Reverse },
                position: scale(target.value),
                value: scale(entry.value - target.value),
            });
            lines.push(entry.line as u64);
        }
        let test = PositioningTest::new(kind, readings, lines).in_standard_cycle();
        Ok(PositioningTest { order: Order::StandardCycle, ..test })
    }

    fn scale(&self) -> Result<(AxisKind, ToInner), DatError> {
        let Some((line, column, unit)) = &self.unit else { return Ok((AxisKind::Linear, |v| v)) };
        match unit.as_str() {
            "mm" => Ok((AxisKind::Linear, |v| v)),
            "um" => Ok((AxisKind::Linear, mm_from_um)),
            "deg" => Ok((AxisKind::Rotary, rad_from_deg)),
            "arcsec" => Ok((AxisKind::Rotary, rad_from_arcsec)),
            _ => {
                let kind = DatErrorKind::UnknownUnit { text: unit.clone() };
                Err(DatError { line: *line, column: *column, kind })
            }
        }
    }
}

/// What stands in the brackets of `NAME[..]`.
fn indexed<'a>(key: &'a str, name: &str) -> Option<&'a str> {
    key.strip_prefix(name)?.strip_prefix('[')?.strip_suffix(']')
}

fn indices<const N: usize>(
    text: &str,
    (line, column): (usize, usize),
    form: &'static str,
) -> Result<[usize; N], DatError> {
    let parsed: Option<Vec<usize>> = text
        .split(',')
        .map(|p| p.trim().parse().ok().filter(|i| (1..=u32::MAX as usize).contains(i)))
        .collect();
    parsed.and_then(|v| v.try_into().ok()).ok_or_else(|| {
        let kind = DatErrorKind::BadIndex { text: text.chars().take(40).collect(), form };
        DatError { line, column, kind }
    })
}

fn number(text: &str, (line, column): (usize, usize)) -> Result<Entry, DatError> {
    match finite(text) {
        Some(value) => Ok(Entry { line, column, value }),
        None => {
            let kind = DatErrorKind::BadNumber { text: text.chars().take(40).collect() };
            Err(DatError { line, column, kind })
        }
    }
}

fn insert<K: Ord>(map: &mut BTreeMap<K, Entry>, key: K, entry: Entry) -> Result<(), DatError> {
    if let Some(first) = map.get(&key) {
        let kind = DatErrorKind::Twice { first: first.line };
        return Err(DatError { line: entry.line, column: 1, kind });
    }
    map.insert(key, entry);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOOD: &str = "\u{feff}TEST_DATA=# made by a logger\r\n# comment\r\n\r\nREF_PV=IOC:Pos\r\nUNIT=mm\r\nCYCLES=1\r\nPOSITIONS=2\r\nTGT_DATA[1]=-5\r\nREF_DATA_FWD[1,1]=-4.999\r\nTGT_DATA[2]=0\r\nREF_DATA_FWD[2,1]=-.002\r\nREF_DATA_BWD[1,1]=-5.001\r\nREF_DATA_BWD[2,1]=.003 # late\r\n  \r\n";

    #[test]
    fn reads_what_the_loggers_write() {
        let test = parse(GOOD).unwrap();
        assert!(recognises(GOOD) && !recognises("cycle,direction\n"));
        assert_eq!(test.kind, AxisKind::Linear);
        let found: Vec<(f64, f64, Travel)> =
            test.readings.iter().map(|r| (r.position, (r.value * 1e6).round() / 1e6, r.travel)).collect();
        assert_eq!(
            found,
            [
                (-5.0, 0.001, Travel::Forward),
                (0.0, -0.002, Travel::Forward),
                (0.0, 0.003, Travel::Reverse),
                (-5.0, -0.001, Travel::Reverse),
            ]
        );
        assert_eq!((test.lines.as_slice(), test.order), (&[9, 11, 13, 12][..], Order::StandardCycle));
    }

    #[test]
    fn units_are_converted() {
        let um = parse(&GOOD.replace("UNIT=mm", "UNIT=um")).unwrap();
        assert!((um.readings[0].position + 0.005).abs() < 1e-15);
        let deg = parse(&GOOD.replace("UNIT=mm", "UNIT=deg")).unwrap();
        assert_eq!(deg.kind, AxisKind::Rotary);
        assert!((deg.readings[0].position + 5f64.to_radians()).abs() < 1e-15);
    }

    #[test]
    fn mistakes_name_their_line() {
        let fails = |from: &str, to: &str| parse(&GOOD.replace(from, to)).unwrap_err();
        let e = fails("=-4.999", "=-4.9x9");
        assert_eq!((e.line, e.column), (9, 19));
        assert_eq!(e.kind, DatErrorKind::BadNumber { text: "-4.9x9".into() });
        assert_eq!(fails("=-4.999", "=1e308").kind, DatErrorKind::BadNumber { text: "1e308".into() });
        assert_eq!(fails("=-4.999", "=nan").kind, DatErrorKind::BadNumber { text: "nan".into() });
        assert_eq!(fails("=-4.999", "=").kind, DatErrorKind::BadNumber { text: String::new() });
        let e = fails("REF_DATA_BWD[1,1]", "REF_DATA_FWD[1,1]");
        assert_eq!((e.line, e.kind), (12, DatErrorKind::Twice { first: 9 }));
        let e = fails("FWD[1,1]", "FWD[1]");
        assert!(matches!(e.kind, DatErrorKind::BadIndex { .. }));
        assert!(matches!(fails("FWD[1,1]", "FWD[0,1]").kind, DatErrorKind::BadIndex { .. }));
        let e = fails("TGT_DATA[2]=0", "");
        assert_eq!((e.line, e.kind), (11, DatErrorKind::NoTarget { position: 2 }));
        let e = fails("CYCLES=1", "CYCLES=5");
        assert_eq!(e.kind, DatErrorKind::Count { key: "CYCLES", announced: 5, found: 1 });
        assert!(matches!(fails("UNIT=mm", "UNIT=furlong").kind, DatErrorKind::UnknownUnit { .. }));
        assert!(matches!(fails("# comment", "comment").kind, DatErrorKind::NotAnAssignment { .. }));
        assert_eq!(parse("").unwrap_err().kind, DatErrorKind::Empty);
    }
}
