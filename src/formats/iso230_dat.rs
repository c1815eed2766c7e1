//! The `.dat` files of ISO 230-2 tests written by ecmc loggers: shell-like assignments, one per line.
//!
//! `TGT_DATA[i]=` target, `REF_DATA_FWD[i,j]=` and `REF_DATA_BWD[i,j]=` reference position approached forward and
//! backward, `i` target, `j` cycle (both from 1), `UNIT=` (mm where missing), `CYCLES=` and `POSITIONS=` as counts.
//! Deviation = reference - target. Other keys are ignored; `#` starts a comment. The file does not state the order between the
//! directions: the readings are given in the order of the standard test cycle of ISO 230-2.

use crate::prelude::*;

use super::positioning_test::{Order, PositioningTest};
use volcomp_units::{mm_from_um, rad_from_arcsec};

/// One number with the place at which it stood.
struct Entry<'a> {
    at: Word<'a>,
    value: f64,
}

/// A number of the file to mm or rad.
type ToInner = fn(f64) -> f64;

#[derive(Default)]
struct Raw<'a> {
    targets: BTreeMap<usize, Entry<'a>>,
    /// By target, cycle, direction (0 forward, 1 backward).
    references: BTreeMap<(usize, usize, u8), Entry<'a>>,
    unit: Option<Word<'a>>,
    cycles: Option<Entry<'a>>,
    positions: Option<Entry<'a>>,
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
pub fn parse(text: &str) -> Result<PositioningTest, FormatError> {
    let mut raw = Raw::default();
    lines(text).try_for_each(|line| raw.read_line(line))?;
    raw.finish()
}

impl<'a> Raw<'a> {
    fn read_line(&mut self, line: Word<'a>) -> Result<(), FormatError> {
        let body = Word { text: line.text.split('#').next().unwrap_or("").trim_end(), ..line };
        if body.text.is_empty() {
            return Ok(());
        }
        let Some((key, _)) = body.text.split_once('=') else {
            return Err(body.unexpected("KEY=VALUE, or a comment behind #"));
        };
        let value = body.tail(key.len() + 1);
        let value = Word { text: value.text.trim_matches('"').trim(), ..value };
        let entry = |what| value.number(what).map(|number| Entry { at: value, value: number });
        let index = |name: &str| {
            let text = key.trim_end().strip_prefix(name)?.strip_prefix('[')?.strip_suffix(']')?;
            Some(Word { text, ..body.tail(name.len() + 1) })
        };
        if let Some(at) = index("TGT_DATA") {
            let [i] = indices(at, "TGT_DATA[position] with whole numbers from 1 up")?;
            return insert(&mut self.targets, i, entry("a position")?);
        }
        let forward = index("REF_DATA_FWD").map(|at| (at, 0));
        if let Some((at, direction)) = forward.or_else(|| Some((index("REF_DATA_BWD")?, 1))) {
            let [i, j] = indices(at, "REF_DATA_FWD[position,cycle] with whole numbers from 1 up")?;
            return insert(&mut self.references, (i, j, direction), entry("a position")?);
        }
        match key.trim_end() {
            "UNIT" => self.unit = Some(value),
            "CYCLES" => self.cycles = Some(entry("a count")?),
            "POSITIONS" => self.positions = Some(entry("a count")?),
            _ => {}
        }
        Ok(())
    }

    fn finish(self) -> Result<PositioningTest, FormatError> {
        if self.references.is_empty() {
            let (what, remedy) = ("REF_DATA_FWD or REF_DATA_BWD", "is this an ISO 230-2 .dat file?");
            return Err(FormatError::of_file(FormatErrorKind::Missing { what, remedy }));
        }
        let (kind, scale) = self.scale()?;
        let distinct = |pick: fn(&(usize, usize, u8)) -> usize| {
            self.references.keys().map(pick).collect::<BTreeSet<_>>().len()
        };
        let counts =
            [("CYCLES", &self.cycles, distinct(|k| k.1)), ("POSITIONS", &self.positions, distinct(|k| k.0))];
        for (what, announced, found) in counts {
            if let Some(entry) = announced.as_ref().filter(|entry| entry.value != found as f64) {
                return Err(entry.at.count(what, entry.value as usize, found));
            }
        }
        let mut readings = Vec::with_capacity(self.references.len());
        let mut lines = Vec::with_capacity(self.references.len());
        for ((position, cycle, direction), entry) in &self.references {
            let Some(target) = self.targets.get(position) else {
                let name = format!("position {position} (no TGT_DATA[{position}])");
                let why = "it has readings; add the target";
                return Err(FormatError::at(entry.at.line, 1, FormatErrorKind::NotRead { name, why }));
            };
            readings.push(Reading {
                cycle: *cycle as u32,
                travel: if *direction == 0 { Travel::Forward } else { Travel::Reverse },
                position: scale(target.value),
                value: scale(entry.value - target.value),
            });
            lines.push(entry.at.line as u64);
        }
        let test = PositioningTest::new(kind, readings, lines).in_standard_cycle();
        Ok(PositioningTest { order: Order::StandardCycle, ..test })
    }

    fn scale(&self) -> Result<(AxisKind, ToInner), FormatError> {
        let Some(unit) = &self.unit else { return Ok((AxisKind::Linear, |v| v)) };
        match unit.text.to_lowercase().as_str() {
            "mm" => Ok((AxisKind::Linear, |v| v)),
            "um" => Ok((AxisKind::Linear, mm_from_um)),
            "deg" => Ok((AxisKind::Rotary, rad_from_deg)),
            "arcsec" => Ok((AxisKind::Rotary, rad_from_arcsec)),
            _ => Err(unit.unexpected("a unit: mm, um, deg or arcsec")),
        }
    }
}

/// The whole numbers from 1 up in the brackets of a key.
fn indices<const N: usize>(at: Word<'_>, form: &'static str) -> Result<[usize; N], FormatError> {
    let whole = |p: &str| p.trim().parse().ok().filter(|i| (1..=u32::MAX as usize).contains(i));
    let parsed: Option<Vec<usize>> = at.text.split(',').map(whole).collect();
    parsed.and_then(|v| v.try_into().ok()).ok_or_else(|| at.unexpected(form))
}

fn insert<'a, K: Ord>(map: &mut BTreeMap<K, Entry<'a>>, key: K, entry: Entry<'a>) -> Result<(), FormatError> {
    if let Some(known) = map.get(&key) {
        let kind = FormatErrorKind::Twice { what: "this entry".to_owned(), first: known.at.line };
        return Err(FormatError::at(entry.at.line, 1, kind));
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
        let fails = |from: &str, to: &str| parse(&GOOD.replace(from, to)).unwrap_err().to_string();
        for (from, to, said) in [
            (
                "=-4.999",
                "=-4.9x9",
                "9:19: '-4.9x9' is not a finite number up to 1e30; a position is expected",
            ),
            ("=-4.999", "=1e308", "9:19: '1e308' is not a finite number"),
            ("=-4.999", "=nan", "9:19: 'nan' is not a finite number"),
            ("=-4.999", "=", "9:19: '' is not a finite number"),
            (
                "REF_DATA_BWD[1,1]",
                "REF_DATA_FWD[1,1]",
                "12:1: this entry was given before, on line 9; remove one",
            ),
            ("FWD[1,1]", "FWD[1]", "9:14: found '1', expected REF_DATA_FWD[position,cycle]"),
            ("FWD[1,1]", "FWD[0,1]", "9:14: found '0,1', expected REF_DATA_FWD[position,cycle]"),
            (
                "TGT_DATA[2]=0",
                "",
                "11:1: position 2 (no TGT_DATA[2]) is not read: it has readings; add the target",
            ),
            ("CYCLES=1", "CYCLES=5", "6:8: CYCLES: 5 announced, 1 found; the file is cut or the count wrong"),
            ("UNIT=mm", "UNIT=furlong", "5:6: found 'furlong', expected a unit: mm, um, deg or arcsec"),
            ("# comment", "comment", "2:1: found 'comment', expected KEY=VALUE"),
        ] {
            let error = fails(from, to);
            assert!(error.starts_with(said), "{to}: {error}");
        }
        assert!(parse("").unwrap_err().to_string().starts_with("REF_DATA_FWD or REF_DATA_BWD is missing"));
    }
}
