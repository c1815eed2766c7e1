//! Compensation value tables of Heidenhain controls, `*.COM`.
//!
//! Columns by name: `AXISPOS` (position against the machine datum, equally spaced), one column per axis that is
//! corrected over the axis to which the table is assigned (the column of that axis itself is its positioning error,
//! `Z` in a table of Y is sag), and `BACKLASH`, the value of the table's own axis for travel towards minus. Values in
//! mm and deg, at most 256 rows. Which axis a table belongs to stands in the `*.CMA` file, not here.
//!
//! Not documented anywhere found, hence stated by the user or refused by name: the sign of the values; units and signs
//! of the columns C1 to C6 of KinematicsComp; tables with a structure block (`#STRUCTBEGIN`).
//! Source: technical manuals of the MANUALplus 620 and the iTNC 530 (columns, limits, assignment).

use super::axis_table::{Row, curve, equidistant};
use crate::prelude::*;

/// What the values of a table are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sign {
    /// Actual - nominal.
    Deviation,
    /// What is added to the command: nominal - actual.
    Correction,
}

impl Sign {
    fn apply(self, value: f64) -> f64 {
        match self {
            Self::Deviation => value,
            // 0 - 0 is not -0
            Self::Correction => 0.0 - value,
        }
    }
}

/// Most rows of a table.
pub const ROWS_MAX: usize = 256;
const LIMITS: Limits = Limits {
    format: "heidenhain",
    equidistant: true,
    points: ROWS_MAX,
    two_directions: true,
    decimals: DECIMALS_MAX,
};

/// What was read.
#[derive(Debug, Clone, PartialEq)]
pub struct ComTable {
    /// Errors of the table's axis.
    pub errors: Vec<(ErrorSymbol, ErrorFunction)>,
    /// True where a column BACKLASH holds zeros only, taken as not filled in.
    pub backlash_empty: bool,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum ColumnKind {
    /// Row number.
    Number,
    Position,
    Backlash,
    Axis(AxisName),
}

/// True where the beginning of a file looks like this format.
#[must_use]
pub fn recognises(text: &str) -> bool {
    lines(text).take(20).any(|l| words(l).any(|w| w.text == "AXISPOS"))
}

/// Reads the table of an axis.
///
/// # Errors
/// The first mistake, with its line and column; what is not documented, by name.
pub fn parse(text: &str, axis: AxisName, sign: Option<Sign>) -> Result<ComTable, FormatError> {
    let mut header: Option<Vec<(Word<'_>, ColumnKind)>> = None;
    let mut rows: Vec<(usize, Vec<f64>)> = Vec::new();
    // a table between BEGIN and [END] without its end is cut, maybe in the middle of a number
    let (mut begun, mut ended, mut last) = (false, false, 1);
    for line in lines(text).filter(|l| !l.text.is_empty()) {
        if line.text.starts_with('#') {
            let name = line.text.split_whitespace().next().unwrap_or("").to_owned();
            let why = "the structure block of this table is not documented; save the table as plain columns";
            return Err(line.fail(FormatErrorKind::NotRead { name, why }));
        }
        last = line.line;
        if line.text.eq_ignore_ascii_case("[END]") {
            ended = true;
            break;
        }
        match &header {
            None if line.text.starts_with("BEGIN") => {
                begun = true;
                if words(line).any(|w| w.text.eq_ignore_ascii_case("INCH")) {
                    let why =
                        "its values are in inches, and no document says which columns are; save it in mm";
                    return Err(line.fail(FormatErrorKind::NotRead { name: "the table".to_owned(), why }));
                }
            }
            None => header = Some(read_header(line, axis)?),
            Some(columns) => rows.push((line.line, read_row(line, columns, rows.len())?)),
        }
    }
    if begun && !ended {
        return Err(FormatError::missing(last, "[END]", "the file is cut"));
    }
    let missing = || FormatError::missing(1, "the header with AXISPOS", "is this a .COM table?");
    let columns = header.ok_or_else(missing)?;
    let Some(sign) = sign else {
        let what = "what its values are: no document found states their sign";
        let remedy = "give --sign deviation (actual - nominal) or --sign correction, after a look into the control's manual";
        return Err(columns[0].0.fail(FormatErrorKind::NotStated { what, remedy }));
    };
    if rows.is_empty() {
        let (what, remedy) = ("a row below the header", "is the file cut?");
        return Err(columns[0].0.fail(FormatErrorKind::Missing { what, remedy }));
    }
    build(axis, &columns, &rows, sign)
}

fn read_header(line: Word<'_>, axis: AxisName) -> Result<Vec<(Word<'_>, ColumnKind)>, FormatError> {
    let mut columns = Vec::new();
    for word in words(line) {
        let mut letters = word.text.chars();
        let kind = match (word.text, letters.next(), letters.next()) {
            ("NR", ..) => ColumnKind::Number,
            ("AXISPOS", ..) => ColumnKind::Position,
            ("BACKLASH", ..) => ColumnKind::Backlash,
            ("C1" | "C2" | "C3" | "C4" | "C5" | "C6", ..) => {
                let why = "units and signs of the columns of KinematicsComp are not documented; take the column out";
                return Err(word.fail(FormatErrorKind::NotRead { name: word.text.to_owned(), why }));
            }
            (_, Some(letter), None) if letter.is_ascii_uppercase() && letter != 'S' => {
                match AxisName::from_letter(letter) {
                    Some(name) => ColumnKind::Axis(name),
                    None => return Err(word.unexpected("a column NR, AXISPOS, BACKLASH or an axis letter")),
                }
            }
            _ => return Err(word.unexpected("a column NR, AXISPOS, BACKLASH or an axis letter")),
        };
        if columns.iter().any(|(_, k)| *k == kind) {
            return Err(word.twice(format!("column {}", word.text), line.line));
        }
        if let ColumnKind::Axis(name) = kind
            && component(axis, name).is_none()
        {
            let why = "a motion of this axis over the table's axis is none of the six error motions that the model has";
            return Err(word.fail(FormatErrorKind::NotRead { name: word.text.to_owned(), why }));
        }
        columns.push((word, kind));
    }
    let has = |wanted: fn(&ColumnKind) -> bool| columns.iter().any(|(_, k)| wanted(k));
    if !has(|k| *k == ColumnKind::Position) || !has(|k| matches!(k, ColumnKind::Axis(_))) {
        return Err(line.unexpected("a header with AXISPOS and at least one axis"));
    }
    Ok(columns)
}

/// The error motion of `axis` that a motion along or about `corrected` makes up for.
fn component(axis: AxisName, corrected: AxisName) -> Option<Component> {
    let plain = matches!(corrected, AxisName::X | AxisName::Y | AxisName::Z) || corrected == axis;
    match (axis.kind(), corrected.kind()) {
        _ if corrected == axis => Some(positioning(axis)),
        (_, AxisKind::Linear) if plain => Some(Component::ALL[corrected.direction()]),
        _ => None,
    }
}

fn read_row(
    line: Word<'_>,
    columns: &[(Word<'_>, ColumnKind)],
    rows: usize,
) -> Result<Vec<f64>, FormatError> {
    if rows == ROWS_MAX {
        return Err(line.too_many("rows", ROWS_MAX + 1, ROWS_MAX));
    }
    let numbers = words(line).map(|w| w.number("a value in mm or deg")).collect::<Result<Vec<f64>, _>>()?;
    if numbers.len() == columns.len() {
        return Ok(numbers);
    }
    Err(line.count("columns", columns.len(), numbers.len()))
}

fn build(
    axis: AxisName,
    columns: &[(Word<'_>, ColumnKind)],
    rows: &[(usize, Vec<f64>)],
    sign: Sign,
) -> Result<ComTable, FormatError> {
    let find = |kind| columns.iter().position(|(_, k)| *k == kind);
    let position = find(ColumnKind::Position).unwrap_or(0);
    let backlash = find(ColumnKind::Backlash);
    let backlash_empty = backlash.is_some_and(|c| rows.iter().all(|(_, r)| r[c] == 0.0));
    let mut errors = Vec::new();
    for (i, (_, kind)) in columns.iter().enumerate() {
        let ColumnKind::Axis(corrected) = *kind else { continue };
        let Some(component) = component(axis, corrected) else { continue };
        let reverse = backlash.filter(|_| corrected == axis && !backlash_empty).unwrap_or(i);
        let table: Vec<Row> = rows
            .iter()
            .map(|(line, r)| Row {
                line: *line,
                position: axis.kind().position_in(r[position]),
                forward: sign.apply(corrected.kind().position_in(r[i])),
                reverse: sign.apply(corrected.kind().position_in(r[reverse])),
            })
            .collect();
        let function = curve(&table, corrected.kind())?;
        equidistant(&table)?;
        errors.push((ErrorSymbol::Motion { component, axis }, function));
    }
    if backlash.is_some() && !backlash_empty && find(ColumnKind::Axis(axis)).is_none() {
        let word = columns[backlash.unwrap_or(0)].0;
        let why = "it belongs to the column of the table's own axis, which is missing; check --axis";
        return Err(word.fail(FormatErrorKind::NotRead { name: "BACKLASH".to_owned(), why }));
    }
    Ok(ComTable { errors, backlash_empty })
}

/// Writes the table of an axis: its positioning error and its straightnesses.
///
/// # Errors
/// What the format cannot hold.
pub fn write(
    spec: &ModelSpec,
    axis: AxisName,
    sign: Option<Sign>,
    sampling: &Sampling,
) -> Result<(String, AxisTable), ExportError> {
    let sign = sign.ok_or(ExportError::SignNotStated)?;
    let motions = Motions::new(spec, axis, false)?;
    let own = positioning(axis);
    let linear = [(AxisName::X, Component::X), (AxisName::Y, Component::Y), (AxisName::Z, Component::Z)];
    let present = motions.present();
    let others = linear
        .into_iter()
        .filter(|(a, c)| *c != own && present.contains(c) && spec.chain.index_of(*a).is_some());
    let mut columns: Vec<(AxisName, Component)> = others.collect();
    if present.contains(&own) {
        columns.insert(0, (axis, own));
    }
    if columns.is_empty() {
        return Err(ExportError::NoError { what: "positioning error or straightness", axis });
    }
    let components: Vec<Component> = columns.iter().map(|(_, c)| *c).collect();
    // only the axis itself has a second direction
    if sampling.way.is_none()
        && let Some(symbol) =
            motions.first_two_way(if components[0] == own { &components[1..] } else { &components })
    {
        return Err(ExportError::TwoDirections { symbol, format: LIMITS.format });
    }
    let table = sample_axis(&motions, &components, sampling, &LIMITS)?;
    let backlash = table.columns[0].reverse.as_ref().filter(|_| components[0] == own);
    let mut header = vec!["NR".to_owned(), "AXISPOS".to_owned()];
    header.extend(backlash.map(|_| "BACKLASH".to_owned()));
    header.extend(columns.iter().map(|(a, _)| a.to_string()));
    let mut out = format!("BEGIN {}.COM MM\r\n{}\r\n", axis.letter(), header.join(" "));
    for (i, q) in table.positions.iter().enumerate() {
        let mut row = vec![i.to_string(), rounded(axis.kind().position_out(*q), 4)];
        row.extend(backlash.map(|b| rounded(sign.apply(axis.kind().position_out(b[i])), 4)));
        for ((corrected, _), column) in columns.iter().zip(&table.columns) {
            row.push(rounded(sign.apply(corrected.kind().position_out(column.forward[i])), 4));
        }
        out.push_str(&row.join(" "));
        out.push_str("\r\n");
    }
    out.push_str("[END]\r\n");
    Ok((out, table))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use volcomp_model::Chain;
    use volcomp_units::axes::Travel;

    const GOOD: &str = "BEGIN Y.COM MM\r\nNR AXISPOS BACKLASH Y Z\r\n0 -90 0.002 0.001 0.01\r\n1 -85 0.003 0.002 0.02\r\n2 -80 0.001 -0.001 0.03\r\n[END]\r\n";

    fn read(text: &str) -> Result<ComTable, FormatError> {
        parse(text, AxisName::Y, Some(Sign::Deviation))
    }

    #[test]
    fn positioning_sag_and_backlash() {
        let table = read(GOOD).unwrap();
        assert!(recognises(GOOD) && !recognises("X EXX\n0 0\n"));
        let names: Vec<String> = table.errors.iter().map(|(s, _)| s.to_string()).collect();
        assert_eq!(names, ["EYY", "EZY"]);
        let eyy = &table.errors[0].1;
        assert_eq!((eyy.value(-85.0, Travel::Forward), eyy.value(-85.0, Travel::Reverse)), (0.002, 0.003));
        assert_eq!(table.errors[1].1.value(-82.5, Travel::Reverse), 0.025);
        let turned = parse(GOOD, AxisName::Y, Some(Sign::Correction)).unwrap();
        assert_eq!(turned.errors[1].1.value(-80.0, Travel::Forward), -0.03);
        let empty =
            GOOD.replace(" 0.002 0.001 ", " 0 0.001 ").replace(" 0.003 ", " 0 ").replace(" 0.001 -", " 0 -");
        let empty = read(&empty).unwrap();
        assert!(empty.backlash_empty && empty.errors[0].1.value(-85.0, Travel::Reverse) == 0.002);
    }

    #[test]
    fn what_is_not_documented_is_refused_by_name() {
        let fails = |from: &str, to: &str| read(&GOOD.replace(from, to)).unwrap_err().to_string();
        assert!(
            parse(GOOD, AxisName::Y, None)
                .unwrap_err()
                .to_string()
                .contains("no document found states their sign")
        );
        assert!(fails("Y Z", "Y C4").starts_with("2:23: C4 is not read: units and signs"));
        assert!(fails("NR AX", "#STRUCTBEGIN\nNR AX").starts_with("2:1: #STRUCTBEGIN is not read"));
        assert!(fails(" MM", " INCH").contains("in inches"));
        assert!(fails("Y Z", "Y C").contains("C is not read: a motion of this axis"));
    }

    #[test]
    fn mistakes_name_their_place() {
        let fails = |from: &str, to: &str| read(&GOOD.replace(from, to)).unwrap_err().to_string();
        assert!(fails("-85 ", "-84 ").starts_with("5:1: position -80 breaks the equal spacing of 6"));
        assert!(fails("-80 ", "-86 ").starts_with("5:1: position -86 is not above -85"));
        assert!(fails("[END]\r\n", "").starts_with("5:1: [END] is missing; the file is cut"));
        assert!(fails(" 0.02\r", " 7\r").starts_with("4:1: 7 is larger than any error of a machine (5 mm)"));
        assert!(fails(" 0.02\r", " 0.0.2\r").starts_with("4:19: '0.0.2' is not a finite number"));
        assert!(fails(" 0.02\r", "\r").starts_with("4:1: columns: 5 announced, 4 found"));
        assert!(fails("AXISPOS", "POS").starts_with("2:4: found 'POS', expected a column"));
        assert!(fails("Y Z", "Y Y").contains("column Y was given before"));
        assert!(
            fails("Y Z", "X Z")
                .contains("BACKLASH is not read: it belongs to the column of the table's own axis")
        );
        assert!(read("").unwrap_err().to_string().contains("the header with AXISPOS is missing"));
        assert!(read("AXISPOS Y\n").unwrap_err().to_string().contains("a row below the header is missing"));
        let many: String = (0..257).map(|i| format!("{i} 0\n")).collect();
        assert!(read(&format!("AXISPOS Y\n{many}")).unwrap_err().to_string().contains("rows: 257 found"));
    }

    proptest! {
        #[test]
        fn what_is_written_reads_back(
            values in prop::collection::vec((-0.5..0.5f64, -0.5..0.5f64, -0.5..0.5f64), 2..256), deviation: bool,
        ) {
            let sign = if deviation { Sign::Deviation } else { Sign::Correction };
            let rows: String = values.iter().enumerate().map(|(i, (b, y, z))| format!("{} {b} {y} {z}\n", i * 5)).collect();
            let first = read(&format!("AXISPOS BACKLASH Y Z\n{rows}")).unwrap();
            let mut spec = ModelSpec::new("m", Chain::parse("[w b X Y Z t]").unwrap());
            spec.errors = first.errors.clone();
            let (text, table) = write(&spec, AxisName::Y, Some(sign), &Sampling::default()).unwrap();
            prop_assert_eq!(table.positions.len(), values.len());
            let back = parse(&text, AxisName::Y, Some(sign)).unwrap();
            for ((_, a), (_, b)) in first.errors.iter().zip(&back.errors) {
                for i in 0..=values.len() * 5 {
                    for travel in [Travel::Forward, Travel::Reverse] {
                        prop_assert!((a.value(i as f64, travel) - b.value(i as f64, travel)).abs() < 1e-11);
                    }
                }
            }
            spec.errors = back.errors;
            prop_assert_eq!(write(&spec, AxisName::Y, Some(sign), &Sampling::default()).unwrap().0, text);
        }

        #[test]
        fn damaged_files_never_panic(at in 0..GOOD.len(), with in "[A-Z0-9#.\\- \n]{0,6}", cut in 0usize..9) {
            let end = (at + cut).min(GOOD.len());
            let _ = read(&format!("{}{with}{}", &GOOD[..at], &GOOD[end..]));
        }
    }
}
