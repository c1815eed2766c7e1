//! Positioning tests from files: the CSV of `docs/reference/tables.md` 3 and the formats of instruments that their beginning
//! gives away (`.dat` of ecmc loggers, Renishaw `.rtl`, API `.pos`).

use std::io::Cursor;
use std::ops::RangeInclusive;

use super::input::text_of;
use super::table::Table;
use crate::prelude::*;
use volcomp_formats::detect;
use volcomp_formats::iso230_dat;
use volcomp_formats::positioning_test::PositioningTest;
use volcomp_formats::rtl::DeviationUnit;
use volcomp_formats::{FormatError, FormatErrorKind, Place, ReadError, api_pos, rtl, text};

/// How the data file is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub(super) enum TestFormat {
    /// Look at the file.
    Auto,
    /// `cycle,direction,target_mm,deviation_um`.
    #[value(alias = "iso230-2")]
    Csv,
    /// `TGT_DATA[i]=`, `REF_DATA_FWD[i,j]=`, `REF_DATA_BWD[i,j]=`.
    Iso230Dat,
}

/// A mistake in a file of an instrument or a control.
pub(super) fn format_failure(file: &str, e: &FormatError) -> Failure {
    // what only the user can state is a matter of arguments
    let code = if matches!(e.kind, FormatErrorKind::NotStated { .. }) { EX_USAGE } else { EX_DATAERR };
    let separator = if e.place == Place::File { ": " } else { ":" };
    Failure::new(code, format_args!("error: {file}{separator}{e}"))
}

/// A mistake or failure of a source read row by row.
pub(super) fn read_failure(path: &Path, e: &ReadError) -> Failure {
    match e {
        ReadError::Io(e) => Failure::io(path, e),
        ReadError::Format(e) => format_failure(&path.display().to_string(), e),
    }
}

/// True where the beginning of a file gives away the format of an instrument.
pub(super) fn is_instrument(head: &[u8]) -> bool {
    use detect::Format::{ApiPos, Iso230Dat, Rtl};
    matches!(detect::format(head), Some(Iso230Dat | Rtl | ApiPos))
}

/// A positioning test with what its file states beside the readings.
#[cfg_attr(
    not(feature = "diagnosis"),
    expect(dead_code, reason = "the diagnosis tells where each reading comes from")
)]
pub(super) struct Test {
    pub(super) test: PositioningTest,
    /// The format, in words.
    pub(super) format: &'static str,
    /// The axis, where the file names it.
    pub(super) axis: Option<AxisName>,
    /// What is worth knowing.
    pub(super) notes: Vec<String>,
    /// Time from start to end, s, where the file states it.
    pub(super) span_s: Option<f64>,
    /// Machine, day and conditions, where the file states them.
    pub(super) stated: Stated,
}

impl Test {
    /// A test whose file states nothing beside the readings.
    pub(super) fn new(test: PositioningTest, format: &'static str) -> Self {
        Self { test, format, axis: None, notes: Vec::new(), span_s: None, stated: Stated::default() }
    }
}

/// The positioning test of an instrument's file; `None` where its beginning gives no such format away. `axis` and `unit` are
/// those of the user, where stated: an .rtl of a rotary axis does not say the unit of its deviations.
pub(super) fn instrument_test(
    file: &str,
    bytes: &[u8],
    axis: Option<AxisName>,
    unit: Option<DeviationUnit>,
) -> Result<Option<Test>> {
    let fail = |e: FormatError| format_failure(file, &e);
    let decoded = || text::decode(bytes).text;
    let found = match detect::format(bytes) {
        Some(detect::Format::Iso230Dat) => Test::new(parse_dat(file, &decoded())?, "ISO 230-2 test (.dat)"),
        Some(detect::Format::Rtl) => {
            let (rtl, mut notes) = rtl::parse(&decoded()).map_err(fail)?;
            let named = rtl.user("Axis").and_then(|a| a.chars().next()).and_then(AxisName::from_letter);
            let rotary = axis.or(named).filter(|a| a.kind() == AxisKind::Rotary);
            if let (Some(axis), None) = (rotary, unit) {
                return Err(usage!(
                    "{file}: a test of rotary axis {axis}; the format does not say the unit of its deviations: \
                         convert it first with volcomp import --axis {} --deviation-unit mrad|urad|arcsec",
                    axis.lower()
                ));
            }
            let (test, more) = rtl.test(unit.unwrap_or(DeviationUnit::Um));
            notes.extend(more);
            let mut notes: Vec<String> = notes.iter().map(ToString::to_string).collect();
            if let (Some(start), Some(length)) = (rtl.environment("Mat temp 1"), rtl.environment("Exp coeff"))
            {
                notes.push(format!(
                    "material at {:.2} to {:.2} degC, compensated to 20 degC by the instrument with {} µm/(m degC)",
                    start.start, start.end, length.start
                ));
            }
            let (span_s, stated) = (rtl.duration_s(), stated(&rtl));
            Test { axis: named, notes, span_s, stated, ..Test::new(test, "Renishaw laser test (.rtl)") }
        }
        Some(detect::Format::ApiPos) => {
            let means = api_pos::parse(&decoded()).map_err(fail)?;
            let notes =
                vec!["the file holds means: repeatability and drift cannot be judged from it".to_owned()];
            Test { notes, ..Test::new(means.test, "API laser test (.pos)") }
        }
        _ => return Ok(None),
    };
    Ok(Some(found))
}

/// What a laser test states beside its readings.
fn stated(rtl: &rtl::Rtl) -> Stated {
    let user = |key: &str| rtl.user(key).map(str::trim).filter(|t| !t.is_empty()).map(str::to_owned);
    let temperature = rtl.environment("Mat temp 1").or_else(|| rtl.environment("Air temp"));
    Stated {
        machine: user("Machine"),
        serial_number: user("Serial No"),
        location: user("Location"),
        operator: user("By"),
        date: user("Date"),
        instrument: None,
        temperature_degc: temperature.map(|t| [t.start, t.end]),
        feed_mm_per_min: None,
    }
}

/// A selection of cycles such as `1-4,6`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Cycles(Vec<RangeInclusive<u32>>);

impl core::str::FromStr for Cycles {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let bad = || format!("invalid selection of cycles '{text}'; write for example 1-4 or 1,3,5");
        let range = |part: &str| {
            let (from, to) = part.split_once('-').unwrap_or((part, part));
            let range = from.trim().parse().ok()?..=to.trim().parse().ok()?;
            (!range.is_empty()).then_some(range)
        };
        text.split(',').map(range).collect::<Option<_>>().map(Self).ok_or_else(bad)
    }
}

impl Cycles {
    /// True for a selected cycle.
    pub(super) fn contains(&self, cycle: u32) -> bool {
        self.0.iter().any(|range| range.contains(&cycle))
    }

    /// Keeps the readings of the selected cycles.
    pub(super) fn select(&self, file: &str, test: &mut PositioningTest) -> Result<()> {
        self.check(file, &test.readings)?;
        test.retain(|r| self.contains(r.cycle));
        Ok(())
    }

    /// Refuses a selection of cycles that the readings do not have.
    pub(super) fn check(&self, file: &str, readings: &[Reading]) -> Result<()> {
        let mut present: Vec<u32> = readings.iter().map(|r| r.cycle).collect();
        present.sort_unstable();
        present.dedup();
        for range in &self.0 {
            if !present.iter().any(|c| range.contains(c)) {
                let (a, b) = (range.start(), range.end());
                let what = if a == b { format!("cycle {a}") } else { format!("cycles {a}-{b}") };
                return Err(data!(file, "{what} selected, but the file has cycles {present:?}"));
            }
        }
        Ok(())
    }
}

/// Reads a positioning test with what its file states about it.
pub(super) fn read_test(path: &Path, format: TestFormat) -> Result<(PositioningTest, Stated)> {
    let bytes = input::read(path, InputKind::Instrument)?;
    let file = path.display().to_string();
    if format == TestFormat::Auto
        && let Some(found) = instrument_test(&file, &bytes, None, None)?
    {
        return Ok((found.test, found.stated));
    }
    let text = text_of(path, bytes)?;
    let test = match format {
        TestFormat::Iso230Dat => parse_dat(&file, &text),
        _ => parse_csv(Table::new(Cursor::new(text), file)?),
    };
    test.map(|test| (test, Stated::default()))
}

/// The `.dat` of ecmc loggers.
pub(super) fn parse_dat(file: &str, text: &str) -> Result<PositioningTest> {
    iso230_dat::parse(text).map_err(|e| format_failure(file, &e))
}

/// Columns of a positioning test in a table, and their units.
pub(super) struct TestColumns {
    pub(super) kind: AxisKind,
    cycle: usize,
    direction: usize,
    target: usize,
    deviation: usize,
}

impl TestColumns {
    /// Finds the columns; `extra` are allowed beside them.
    pub(super) fn find(table: &Table, extra: &[&str]) -> Result<Self> {
        let rotary = table.find("target_deg").is_some() || table.find("deviation_arcsec").is_some();
        let (kind, target, deviation) = if rotary {
            (AxisKind::Rotary, "target_deg", "deviation_arcsec")
        } else {
            (AxisKind::Linear, "target_mm", "deviation_um")
        };
        let known = ["cycle", "direction", target, deviation];
        // a missing column is the better message where a slip makes a column both missing and unknown
        let found = Self {
            kind,
            cycle: table.require("cycle")?,
            direction: table.require("direction")?,
            target: table.require(target)?,
            deviation: table.require(deviation)?,
        };
        table.only(&[&known[..], extra].concat())?;
        Ok(found)
    }

    /// The reading of the current row.
    pub(super) fn reading(&self, table: &Table) -> Result<Reading> {
        let (target, deviation) = (table.number(self.target)?, table.number(self.deviation)?);
        Ok(Reading {
            cycle: table.count(self.cycle)?,
            travel: table.travel(self.direction)?,
            position: self.kind.position_in(target),
            value: self.kind.offset_in(deviation),
        })
    }
}

/// The CSV of `docs/reference/tables.md` 3.
pub(super) fn parse_csv(mut table: Table) -> Result<PositioningTest> {
    let columns = TestColumns::find(&table, &["t_s"])?;
    let time = table.find("t_s");
    let (mut readings, mut lines, mut times_s) = (Vec::new(), Vec::new(), Vec::new());
    table.some_rows(|table| {
        readings.push(columns.reading(table)?);
        lines.push(table.line());
        times_s.extend(time.map(|c| table.number(c)).transpose()?);
        Ok(())
    })?;
    Ok(PositioningTest { times_s, ..PositioningTest::new(columns.kind, readings, lines) }.of_rows())
}

/// The error for a table that has a header only.
pub(super) fn no_rows(file: &str) -> Failure {
    data!(file, "no data rows")
}

#[cfg(test)]
mod tests {
    use super::*;
    use volcomp_units::axes::Travel;

    #[test]
    fn cycles_are_selected() {
        let readings: Vec<Reading> = (1..=5)
            .map(|cycle| Reading { cycle, travel: Travel::Forward, position: 0.0, value: 0.0 })
            .collect();
        let mut test = PositioningTest::new(AxisKind::Linear, readings, (1..=5).collect());
        "1-2,5".parse::<Cycles>().unwrap().select("f", &mut test).unwrap();
        assert_eq!(test.readings.iter().map(|r| r.cycle).collect::<Vec<_>>(), [1, 2, 5]);
        assert_eq!(test.lines, [1, 2, 5]);
        let missing = "7".parse::<Cycles>().unwrap().select("f", &mut test).unwrap_err();
        assert!(missing.message.contains("cycle 7 selected, but the file has cycles [1, 2, 5]"));
        for bad in ["", "a", "4-1", "1-", "1;2"] {
            assert!(bad.parse::<Cycles>().is_err(), "{bad}");
        }
    }

    #[test]
    fn rotary_tests_are_in_degrees_and_arcsec() {
        let text = "cycle,direction,target_deg,deviation_arcsec\n1,1,180,-3.6\n";
        let test = parse_csv(Table::new(Cursor::new(text), "f".into()).unwrap()).unwrap();
        assert_eq!(test.kind, AxisKind::Rotary);
        assert!((test.readings[0].position - core::f64::consts::PI).abs() < 1e-15);
        assert!((test.readings[0].value + 1e-3f64.to_radians()).abs() < 1e-18);
    }

    #[test]
    fn columns_are_checked() {
        let fails = |text: &str| {
            let table = Table::new(Cursor::new(text.to_owned()), "f.csv".to_owned()).unwrap();
            parse_csv(table).unwrap_err().message
        };
        assert!(fails("cycle,direction,target_mm\n").contains("column deviation_um is missing"));
        assert!(
            fails("cycle,direction,target_mm,deviation_mm\n")
                .contains("deviation_mm is in mm: multiply by 1000 and name it deviation_um")
        );
        assert!(
            fails("cycle,direction,target_mm,deviation_um,operator\n").contains("operator: unknown column")
        );
        assert!(fails("cycle,direction,target_mm,deviation_um\n").contains("no data rows"));
        assert!(fails("cycle,direction,target_mm,deviation_um\n1,2,0,0\n").contains("2 is no direction"));
    }
}
