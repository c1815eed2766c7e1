//! What `volcomp fit` reads: motion tables and positioning tests, turned into readings per error symbol.

use std::collections::BTreeMap;
use std::io::{BufRead, Cursor};
use std::path::Path;

use super::files::{read_bytes, text_of};
use super::positioning_data::{Cycles, instrument_test, no_rows, parse_csv, parse_dat};
use super::table::{Table, nearest};
use super::{EX_DATAERR, Failure};
use crate::core::axes::{AxisKind, AxisName, Travel};
use crate::core::model::{Component, ErrorSymbol};
use crate::core::units::{mm_from_um, rad_from_arcsec, rad_from_deg};
use crate::formats::iso230_dat;
use crate::identify::Reading;

/// How a data file is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub(super) enum Format {
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
pub(super) enum Direction {
    /// Both.
    Both,
    /// Towards plus.
    Forward,
    /// Towards minus.
    Reverse,
}

/// The readings of each symbol.
pub(super) type BySymbol = BTreeMap<ErrorSymbol, Vec<Reading>>;

/// Reads one file for one axis and adds its readings.
pub(super) fn read(
    path: &Path,
    axis: AxisName,
    format: Format,
    cycles: Option<&Cycles>,
    direction: Direction,
    into: &mut BySymbol,
) -> Result<(), Failure> {
    let file = path.display().to_string();
    let bytes = read_bytes(path)?;
    let test = if format == Format::Auto { instrument_test(&file, &bytes)? } else { None };
    let found = match (format, test) {
        (_, Some(test)) => positioning(&file, axis, test)?,
        (Format::Iso230Dat, None) => positioning(&file, axis, parse_dat(&file, &text_of(path, bytes)?)?)?,
        _ => {
            let text = text_of(path, bytes)?;
            let table = Table::new(Cursor::new(text), file.clone())?;
            let is_test =
                table.columns().iter().any(|c| c.starts_with("target_") || c.starts_with("deviation_"));
            match format {
                Format::Iso230_2 => positioning(&file, axis, parse_csv(table)?)?,
                Format::Auto if is_test => positioning(&file, axis, parse_csv(table)?)?,
                _ => motion(table, axis)?,
            }
        }
    };
    for (symbol, mut readings) in found {
        if let Some(cycles) = cycles {
            cycles.select(&file, &mut readings)?;
        }
        readings.retain(|r| match direction {
            Direction::Both => true,
            Direction::Forward => r.travel == Travel::Forward,
            Direction::Reverse => r.travel == Travel::Reverse,
        });
        if readings.is_empty() {
            return Err(Failure::new(
                EX_DATAERR,
                format_args!("error: {file}: {symbol}: no reading in the selected direction"),
            ));
        }
        into.entry(symbol).or_default().extend(readings);
    }
    Ok(())
}

/// A positioning test is the positioning error of the axis itself.
fn positioning(file: &str, axis: AxisName, test: iso230_dat::PositioningTest) -> Result<BySymbol, Failure> {
    if test.kind != axis.kind() {
        let (is, has) = match axis.kind() {
            AxisKind::Linear => ("linear", "degrees"),
            AxisKind::Rotary => ("rotary", "millimetres"),
        };
        return Err(Failure::new(
            EX_DATAERR,
            format_args!("error: {file}: axis {axis} is {is}, the test is in {has}; check --axis"),
        ));
    }
    let offset = if axis.kind() == AxisKind::Rotary { 3 } else { 0 };
    let component = Component::ALL[axis.direction() + offset];
    Ok(BTreeMap::from([(ErrorSymbol::Motion { component, axis }, test.readings)]))
}

/// A motion table.
fn motion<R: BufRead>(mut table: Table<R>, axis: AxisName) -> Result<BySymbol, Failure> {
    let position_name = match axis.kind() {
        AxisKind::Linear => "position_mm",
        AxisKind::Rotary => "position_deg",
    };
    let position = table.require(position_name)?;
    let (cycle, direction) = (table.find("cycle"), table.find("direction"));
    let mut symbols = Vec::new();
    for (i, column) in table.columns().iter().enumerate() {
        if i != position && Some(i) != cycle && Some(i) != direction {
            let symbol = symbol_column(column, axis, position_name)
                .map_err(|what| table.fail(i, format_args!("{what}")))?;
            symbols.push((i, symbol));
        }
    }
    if symbols.is_empty() {
        let lower = axis.lower();
        return Err(Failure::new(
            EX_DATAERR,
            format_args!(
                "error: {}: no column with an error of axis {axis}, such as e{}{lower}_um or ea{lower}_arcsec",
                table.file(),
                if axis.kind() == AxisKind::Linear { lower } else { 'x' },
            ),
        ));
    }
    let mut found = BySymbol::new();
    while table.advance()? {
        let x = table.number(position)?;
        let reading = Reading {
            cycle: cycle.map_or(Ok(0), |c| table.count(c))?,
            travel: direction.map_or(Ok(Travel::Forward), |c| table.travel(c))?,
            position: if axis.kind() == AxisKind::Rotary { rad_from_deg(x) } else { x },
            value: 0.0,
        };
        for (column, symbol) in &symbols {
            let value = table.number(*column)?;
            let value = if symbol.is_angle() { rad_from_arcsec(value) } else { mm_from_um(value) };
            found.entry(*symbol).or_default().push(Reading { value, ..reading });
        }
    }
    if found.is_empty() {
        return Err(no_rows(table.file()));
    }
    Ok(found)
}

/// The symbol of a column such as `exx_um`, or what is wrong with it.
fn symbol_column(column: &str, axis: AxisName, position_name: &str) -> Result<ErrorSymbol, String> {
    let lower = axis.lower();
    let (name, unit) = column.rsplit_once('_').unwrap_or((column, ""));
    let Some(symbol) = ErrorSymbol::parse(name).filter(|_| name.chars().all(|c| !c.is_ascii_uppercase()))
    else {
        let known = [position_name.to_owned(), "cycle".to_owned(), "direction".to_owned()]
            .into_iter()
            .chain(Component::ALL.map(|c| {
                let unit = if c.is_angle() { "arcsec" } else { "um" };
                format!("e{}{lower}_{unit}", c.letter().to_ascii_lowercase())
            }))
            .collect::<Vec<_>>();
        let hint = match nearest(column, known.iter().map(String::as_str)) {
            Some(near) => format!("is {near} meant?"),
            None => format!("columns are {}", known.join(", ")),
        };
        return Err(format!("unknown column; {hint}"));
    };
    if symbol.is_constant() {
        return Err(format!("{symbol} is one number, not a curve; give it as --squareness {name}=.."));
    }
    if symbol.axis() != axis {
        return Err(format!("{symbol} is an error of axis {}, but --axis says {lower}", symbol.axis()));
    }
    let expected = if symbol.is_angle() { "arcsec" } else { "um" };
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

    fn read_motion(text: &str, axis: AxisName) -> Result<BySymbol, Failure> {
        motion(Table::new(text.as_bytes(), "m.csv".to_owned())?, axis)
    }

    #[test]
    fn symbols_units_and_directions() {
        let text = "position_mm,exx_um,eax_arcsec,cycle,direction\n10,2,3.6,1,1\n10,4,0,1,-1\n";
        let found = read_motion(text, AxisName::X).unwrap();
        let exx = &found[&ErrorSymbol::parse("exx").unwrap()];
        assert!((exx[1].value - 0.004).abs() < 1e-18);
        assert_eq!((exx[1].travel, exx[1].cycle), (Travel::Reverse, 1));
        let eax = &found[&ErrorSymbol::parse("eax").unwrap()];
        assert!((eax[0].value - 1e-3f64.to_radians()).abs() < 1e-18);
        let rotary = read_motion("position_deg,ecc_arcsec\n180,1\n", AxisName::C).unwrap();
        let ecc = &rotary[&ErrorSymbol::parse("ecc").unwrap()];
        assert!((ecc[0].position - core::f64::consts::PI).abs() < 1e-15);
    }

    #[test]
    fn columns_are_checked_one_by_one() {
        for (text, expected) in [
            ("exx_um\n1\n", "column position_mm is missing"),
            ("Position_mm,exx_um\n", "is column Position_mm meant? rename it"),
            ("position_mm\n1\n", "no column with an error of axis X, such as exx_um"),
            ("position_mm,eyy_um\n", "eyy_um: EYY is an error of axis Y, but --axis says x"),
            ("position_mm,exx_mm\n", "exx_mm: unit 'mm'; EXX is read in um"),
            ("position_mm,eax_um\n", "EAX is read in arcsec"),
            ("position_mm,exx\n", "unit ''"),
            ("position_mm,EXX_um\n", "is exx_um meant?"),
            ("position_mm,comment\n", "comment: unknown column; columns are position_mm"),
            ("position_mm,ec0y_arcsec\n", "is one number, not a curve"),
            ("position_mm,exx_um\n", "no rows below the header"),
            ("position_mm,exx_um\n1,one\n", "m.csv:2:3: exx_um: 'one' is not a number"),
            ("position_mm,exx_um,direction\n1,1,2\n", "2 is no direction"),
        ] {
            let failure = read_motion(text, AxisName::X).unwrap_err();
            assert_eq!(failure.code, EX_DATAERR);
            assert!(failure.message.contains(expected), "{text:?} gives {:?}", failure.message);
        }
    }
}
