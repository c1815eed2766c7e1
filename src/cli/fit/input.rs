//! What `volcomp fit` reads: motion tables and positioning tests, turned into readings per error symbol.

use std::io::{BufRead, Cursor, Read};

use crate::identify::columns::hint;
use crate::positioning_data::{Cycles, instrument_test, is_instrument, parse_csv, parse_dat};
use crate::prelude::*;
use crate::table::Table;
use crate::units;
use volcomp_formats::positioning_test::PositioningTest;
use volcomp_identify::start_up::{StartUpOutlier, start_up_outliers};

/// How a data file is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum Format {
    /// Look at the file.
    Auto,
    /// Columns position_mm (or position_deg) and symbols such as `exx_um`, `eax_arcsec`; optional cycle, direction.
    Motion,
    /// Columns cycle, direction, target_mm, deviation_um (rotary: target_deg, deviation_arcsec).
    #[value(name = "iso230-2")]
    Iso230_2,
    /// `TGT_DATA[i]=`, `REF_DATA_FWD[i,j]=`, `REF_DATA_BWD[i,j]=`.
    Iso230Dat,
}

/// Which direction of travel is used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum Direction {
    /// Both.
    Both,
    /// Towards plus.
    Forward,
    /// Towards minus.
    Reverse,
}

/// The readings of one symbol, and where they stood.
#[derive(Debug, Default)]
pub(crate) struct Measured {
    pub(crate) readings: Vec<Reading>,
    /// 1-based lines of the file, where a row is a reading; else empty or 0.
    lines: Vec<u32>,
    /// Index of the first reading of each file.
    files: Vec<(usize, String)>,
    /// Start-up outliers of the files, by the index of the reading.
    pub(crate) start_up: Vec<StartUpOutlier>,
}

impl From<Vec<Reading>> for Measured {
    fn from(readings: Vec<Reading>) -> Self {
        Self { readings, ..Self::default() }
    }
}

impl Measured {
    fn push(&mut self, reading: Reading, line: u32) {
        self.readings.push(reading);
        self.lines.push(line);
    }

    fn retain(&mut self, keep: impl Fn(&Reading) -> bool) {
        let mut kept = self.readings.iter().map(&keep);
        self.lines.retain(|_| kept.next().unwrap_or(true));
        self.start_up.retain(|o| keep(&self.readings[o.reading]));
        for o in &mut self.start_up {
            o.reading = self.readings[..o.reading].iter().filter(|r| keep(r)).count();
        }
        self.readings.retain(&keep);
    }

    fn append(&mut self, mut other: Self, file: &str) {
        let first = self.readings.len();
        self.files.push((first, file.to_owned()));
        self.start_up
            .extend(other.start_up.iter().map(|o| StartUpOutlier { reading: first + o.reading, ..*o }));
        if self.readings.is_empty() {
            // the usual case: one file, and nothing is copied
            (self.readings, self.lines) = (other.readings, other.lines);
            return;
        }
        // a file without lines leaves none to the readings before the next one
        self.lines.resize(self.readings.len(), 0);
        self.readings.append(&mut other.readings);
        self.lines.append(&mut other.lines);
    }

    /// The readings of each file.
    pub(crate) fn by_file(&self) -> impl Iterator<Item = (&str, &[Reading])> {
        let ends = self.files.iter().skip(1).map(|(first, _)| *first).chain([self.readings.len()]);
        self.files.iter().zip(ends).map(|((first, file), end)| (file.as_str(), &self.readings[*first..end]))
    }

    /// File and line of a reading; line 0 where the file has no row per reading.
    pub(crate) fn place(&self, index: usize) -> (&str, u32) {
        let file = self.files.iter().rev().find(|(first, _)| *first <= index).map_or("", |(_, f)| f.as_str());
        (file, self.lines.get(index).copied().unwrap_or(0))
    }
}

/// The readings of each symbol.
pub(crate) type BySymbol = BTreeMap<ErrorSymbol, Measured>;

/// Bytes looked at to tell the formats apart.
const HEAD: u64 = 1 << 16;

/// Reads one file for one axis and adds its readings; tables row by row.
pub(crate) fn read(
    path: &Path,
    axis: AxisName,
    format: Format,
    cycles: Option<&Cycles>,
    direction: Direction,
    into: &mut BySymbol,
) -> Result<()> {
    let io = |e: &std::io::Error| Failure::io(path, e);
    let file = table::name_of(path);
    let mut source = input::open(path, InputKind::Table)?.buffered();
    let mut head = Vec::new();
    (&mut source).take(HEAD).read_to_end(&mut head).map_err(|e| io(&e))?;
    let whole = format == Format::Iso230Dat || format == Format::Auto && is_instrument(&head);
    let found = if whole {
        // files of instruments are small; tables may be long and are read row by row
        source.read_to_end(&mut head).map_err(|e| io(&e))?;
        let found = if format == Format::Auto { instrument_test(&file, &head, None, None)? } else { None };
        let test = found
            .map(|f| f.test)
            .map_or_else(|| parse_dat(&file, &input::text_of(Path::new(&file), head)?), Ok)?;
        positioning(&file, axis, test)?
    } else {
        let source: Box<dyn BufRead> = Box::new(Cursor::new(head).chain(source));
        let table = Table::new(source, file.clone())?;
        let is_test = table.columns().iter().any(|c| c.starts_with("target_") || c.starts_with("deviation_"));
        match format {
            Format::Iso230_2 => positioning(&file, axis, parse_csv(table)?)?,
            Format::Auto if is_test => positioning(&file, axis, parse_csv(table)?)?,
            _ => motion(table, axis)?,
        }
    };
    for (symbol, mut measured) in found {
        // of the whole test: the first of the cycles selected is not its start
        measured.start_up = start_up_outliers(&measured.readings);
        if let Some(cycles) = cycles {
            cycles.check(&file, &measured.readings)?;
            measured.retain(|r| cycles.contains(r.cycle));
        }
        measured.retain(|r| match direction {
            Direction::Both => true,
            Direction::Forward => r.travel == Travel::Forward,
            Direction::Reverse => r.travel == Travel::Reverse,
        });
        if measured.readings.is_empty() {
            return Err(data!(file, "{symbol}: no reading in the selected direction"));
        }
        into.entry(symbol).or_default().append(measured, &file);
    }
    Ok(())
}

/// A positioning test is the positioning error of the axis itself.
fn positioning(file: &str, axis: AxisName, test: PositioningTest) -> Result<BySymbol> {
    if test.kind != axis.kind() {
        let (is, has) = match axis.kind() {
            AxisKind::Linear => ("linear", "degrees"),
            AxisKind::Rotary => ("rotary", "millimetres"),
        };
        return Err(data!(file, "axis {axis} is {is}, the test is in {has}; give the axis that moved"));
    }
    let offset = if axis.kind() == AxisKind::Rotary { 3 } else { 0 };
    let component = Component::ALL[axis.direction() + offset];
    let lines = (0..test.readings.len()).map(|i| u32::try_from(test.line(i)).unwrap_or(0)).collect();
    let measured = Measured { readings: test.readings, lines, ..Measured::default() };
    Ok(BTreeMap::from([(ErrorSymbol::Motion { component, axis }, measured)]))
}

/// A motion table.
fn motion(mut table: Table, axis: AxisName) -> Result<BySymbol> {
    let position_name = &format!("position_{}", axis.kind().position_unit());
    let run = table.run(position_name)?;
    let mut symbols = Vec::new();
    for (i, column) in table.columns().to_vec().iter().enumerate() {
        if !table.known.contains(column) {
            let symbol = symbol_column(column, axis, position_name).map_err(|what| table.fail(i, what))?;
            symbols.extend(table.find_column(column).map(|column| (column, symbol)));
        }
    }
    if symbols.is_empty() {
        let lower = axis.lower();
        let first = if axis.kind() == AxisKind::Linear { lower } else { 'x' };
        return Err(table.file_error(format_args!(
            "no column with an error of axis {axis}, such as e{first}{lower}_um or ea{lower}_arcsec"
        )));
    }
    let mut found: Vec<Measured> = symbols.iter().map(|_| Measured::default()).collect();
    table.some_rows(|row| {
        let reading = row.reading(&run)?;
        let line = u32::try_from(row.line()).unwrap_or(0);
        for ((column, _), measured) in symbols.iter().zip(&mut found) {
            measured.push(Reading { value: row.value(*column)?, ..reading }, line);
        }
        Ok(())
    })?;
    for ((_, symbol), measured) in symbols.iter().zip(&found) {
        if is_swapped(&measured.readings) {
            note!(
                "warning: {}: {symbol} rises in equal steps and {position_name} does not: are the two columns exchanged?",
                table.file()
            );
        }
    }
    Ok(symbols.into_iter().map(|(_, symbol)| symbol).zip(found).collect())
}

/// True where the values stand at equal steps, as targets do, and the positions do not.
fn is_swapped(readings: &[Reading]) -> bool {
    const FEWEST: usize = 5;
    let equal_steps = |of: fn(&Reading) -> f64| {
        let mut all: Vec<f64> = readings.iter().map(of).collect();
        all.sort_by(f64::total_cmp);
        let range = all.last().zip(all.first()).map_or(0.0, |(b, a)| b - a);
        all.dedup_by(|b, a| *b - *a <= 1e-9 * range);
        let step = range / (all.len().max(2) - 1) as f64;
        all.len() >= FEWEST && all.windows(2).all(|w| (w[1] - w[0] - step).abs() <= 1e-6 * step)
    };
    equal_steps(|r| r.value) && !equal_steps(|r| r.position)
}

/// The symbol of a column such as `exx_um`, or what is wrong with it.
fn symbol_column(column: &str, axis: AxisName, position_name: &str) -> Result<ErrorSymbol, String> {
    let (name, unit) = column.rsplit_once('_').unwrap_or((column, ""));
    let Some(symbol) = ErrorSymbol::parse(name).filter(|_| name.chars().all(|c| !c.is_ascii_uppercase()))
    else {
        let error = |c: Component| units::column(ErrorSymbol::Motion { component: c, axis });
        let known = [position_name, "cycle", "direction"].map(str::to_owned).into_iter();
        let known: Vec<String> = known.chain(Component::ALL.map(error)).collect();
        return Err(format!("unknown column; {}", hint(column, &known, known.join(", "))));
    };
    if symbol.is_constant() {
        return Err(format!("{symbol} is one number, not a curve; give it as --squareness {name}=.."));
    }
    if symbol.axis() != axis {
        return Err(format!("{symbol} is an error of axis {}, but the axis given is {axis}", symbol.axis()));
    }
    let expected = Units::of(symbol).value;
    if unit != expected {
        return Err(format!(
            "unit '{unit}'; {symbol} is read in {expected}: convert it and name it {name}_{expected}"
        ));
    }
    Ok(symbol)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read_motion(text: &str, axis: AxisName) -> Result<BySymbol> {
        let source: Box<dyn BufRead> = Box::new(Cursor::new(text.to_owned()));
        motion(Table::new(source, "m.csv".to_owned())?, axis)
    }

    #[test]
    fn symbols_units_and_directions() {
        let text = "position_mm,exx_um,eax_arcsec,cycle,direction\n10,2,3.6,1,1\n10,4,0,1,-1\n";
        let found = read_motion(text, AxisName::X).unwrap();
        let measured = &found[&ErrorSymbol::parse("exx").unwrap()];
        assert_eq!(measured.place(1), ("", 3));
        let exx = &measured.readings;
        assert!((exx[1].value - 0.004).abs() < 1e-18);
        assert_eq!((exx[1].travel, exx[1].cycle), (Travel::Reverse, 1));
        let eax = &found[&ErrorSymbol::parse("eax").unwrap()].readings;
        assert!((eax[0].value - 1e-3f64.to_radians()).abs() < 1e-18);
        let rotary = read_motion("position_deg,ecc_arcsec\n180,1\n", AxisName::C).unwrap();
        let ecc = &rotary[&ErrorSymbol::parse("ecc").unwrap()].readings;
        assert!((ecc[0].position - core::f64::consts::PI).abs() < 1e-15);
    }

    #[test]
    fn columns_are_checked_one_by_one() {
        for (text, expected) in [
            ("exx_um\n1\n", "column position_mm is missing"),
            ("Position_mm,exx_um\n", "is column Position_mm meant? rename it"),
            ("position_mm\n1\n", "no column with an error of axis X, such as exx_um"),
            ("position_mm,eyy_um\n", "eyy_um: EYY is an error of axis Y, but the axis given is X"),
            ("position_mm,exx_mm\n", "exx_mm: unit 'mm'; EXX is read in um"),
            ("position_mm,eax_um\n", "EAX is read in arcsec"),
            ("position_mm,exx\n", "unit ''"),
            ("position_mm,EXX_um\n", "is exx_um meant?"),
            ("position_mm,comment\n", "comment: unknown column; columns are position_mm"),
            ("position_mm,ec0y_arcsec\n", "is one number, not a curve"),
            ("position_mm,exx_um\n", "no data rows"),
            ("position_mm,exx_um\n1,one\n", "m.csv:2:3: exx_um: 'one' is not a number"),
            ("position_mm,exx_um,direction\n1,1,2\n", "2 is no direction"),
        ] {
            let failure = read_motion(text, AxisName::X).unwrap_err();
            assert_eq!(failure.code, EX_DATAERR);
            assert!(failure.message.contains(expected), "{text:?} gives {:?}", failure.message);
        }
    }
}
