//! Volumetric compensation tables of ISG and Beckhoff controls, "ISG CSV".
//!
//! Blanks separate columns, `//` starts a comment, `#` ends a block; the first line of a block names its columns. A block has
//! columns of arguments (X Y Z in mm, A B C in deg) and of errors (`EXX`, `EAX`: component errors; `C0Y`, `X0C`: position
//! errors; mm and rad). Errors that depend on several axes have several argument columns and a row for every combination.
//!
//! Values are actual - nominal. Of an axis on the workpiece side the format does not say whether the values are the
//! motion of the carriage or of the tool relative to the workpiece: that has to be stated ([`Body`]). Arguments are programmed
//! coordinates in both. Component errors are referred to the origin; the format has no place for reference points,
//! uncertainties, two directions of travel or live values.
//!
//! Source: the vendors' manuals (ISG CSV format; units of measure; list of parameters supported).

use crate::prelude::*;
use std::fmt::Write as _;

use super::axis_table::possible;
use super::sample::{Way, positions};
use volcomp_model::Chain;
use volcomp_model::chain_notation::Side;
use volcomp_model::curve::{Grid, Table};

/// Whose motion the values of a workpiece-side axis are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Body {
    /// The tool relative to the workpiece, as the model stores it.
    Relative,
    /// The carriage itself.
    Carriage,
}

/// What was read.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Tables {
    /// The errors, relative sense, mm and rad.
    pub errors: Vec<(ErrorSymbol, ErrorFunction)>,
    /// Columns of the control's kinematics, which are no errors and were left out.
    pub kinematics: Vec<String>,
}

const AXES: [AxisName; 6] = [AxisName::X, AxisName::Y, AxisName::Z, AxisName::A, AxisName::B, AxisName::C];
const AXES_TEXT: &str = "X Y Z A B C";
const FORMAT: &str = "isg";
const LIMITS: Limits = Limits {
    format: FORMAT,
    equidistant: false,
    points: 10_000,
    two_directions: false,
    decimals: DECIMALS_MAX,
};
/// Most values of a file.
const VALUES_MAX: usize = 6_000_000;

/// True where the beginning of a file looks like this format: names of arguments and errors, then numbers.
#[must_use]
pub fn recognises(text: &str) -> bool {
    let mut rows =
        lines(text).map(without_comment).filter(|l| !l.text.is_empty() && !l.text.starts_with('#'));
    let Some(header) = rows.next() else { return false };
    let known = words(header).all(|w| column(w.text).is_some());
    let errors = words(header).any(|w| matches!(column(w.text), Some(ColumnKind::Error(_))));
    known && errors && rows.next().is_none_or(|row| words(row).all(|w| w.text.parse::<f64>().is_ok()))
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum ColumnKind {
    Argument(AxisName),
    Error(ErrorSymbol),
    /// Part of the control's kinematics; no error.
    Kinematics,
    /// Changes the motion; the model has no place for it.
    Foreign,
}

fn column(name: &str) -> Option<ColumnKind> {
    let letters: Vec<char> = name.chars().collect();
    let is = |c: char, set: &str| set.contains(c);
    match letters[..] {
        [a] => AXES.into_iter().find(|n| n.letter() == a).map(ColumnKind::Argument),
        ['E', c, a] if is(c, "XYZABC") && is(a, "XYZABC") => ErrorSymbol::parse(name).map(ColumnKind::Error),
        [c, '0', a] if is(c, "XYZABC") && is(a, "XYZABC") => {
            Some(ErrorSymbol::parse(&format!("E{name}")).map_or(ColumnKind::Foreign, ColumnKind::Error))
        }
        ['P', '0', a] if is(a, "XYZ") => Some(ColumnKind::Kinematics),
        ['N', '0', a] if is(a, "XYZ") => Some(ColumnKind::Kinematics),
        ['P', c, a] if is(c, "XYZ") && is(a, "ABC") => Some(ColumnKind::Kinematics),
        ['L', 'N', a] if is(a, "XYZABC") => Some(ColumnKind::Kinematics),
        ['V', c, a] if is(c, "XYZ") && is(a, "XYZABC") => Some(ColumnKind::Foreign),
        ['I', 'D', a] if is(a, "XYZ") => Some(ColumnKind::Foreign),
        _ => None,
    }
}

fn without_comment(line: Word<'_>) -> Word<'_> {
    let text = line.text.split("//").next().unwrap_or("").trim_end();
    Word { text, ..line }
}

/// Arguments in the order of the header, and rows by arguments.
type Key = Vec<AxisName>;
/// Bits of the coordinates, which sort like the numbers: see [`ordered`].
type Coordinates = Vec<i64>;

/// Values by coordinates, and the line of each.
type Values = BTreeMap<Coordinates, (f64, usize)>;

#[derive(Debug, Default)]
struct Gathered {
    /// By symbol: its arguments and its values.
    errors: BTreeMap<ErrorSymbol, (Key, Values)>,
    kinematics: Vec<String>,
    values: usize,
}

/// A number as an integer of the same order.
fn ordered(value: f64) -> i64 {
    // -0 and 0 are one coordinate
    let bits = (value + 0.0).to_bits() as i64;
    bits ^ (((bits >> 63) as u64) >> 1) as i64
}

fn unordered(bits: i64) -> f64 {
    f64::from_bits((bits ^ (((bits >> 63) as u64) >> 1) as i64) as u64)
}

/// Reads a file for a machine with the given chain.
///
/// # Errors
/// The first mistake, with its line and column; columns that the model cannot hold; a grid with holes; an axis on the
/// workpiece side without `body`.
pub fn parse(text: &str, chain: &Chain, body: Option<Body>) -> Result<Tables, FormatError> {
    let mut gathered = Gathered::default();
    let mut header: Option<Vec<(Word<'_>, ColumnKind)>> = None;
    let mut rows = 0;
    let mut last = 1;
    for line in lines(text).map(without_comment) {
        last = line.line;
        if line.text.starts_with('#') {
            empty_block(header.as_deref(), rows)?;
            header = None;
            continue;
        }
        if line.text.is_empty() {
            continue;
        }
        match &header {
            None => {
                header = Some(read_header(line, chain, body, &mut gathered)?);
                rows = 0;
            }
            Some(columns) => {
                gathered.row(line, columns, rows)?;
                rows += 1;
            }
        }
    }
    empty_block(header.as_deref(), rows)?;
    if gathered.errors.is_empty() {
        let what = "a column with an error such as EXX or C0Y";
        return Err(FormatError::missing(last, what, "is this an ISG CSV file?"));
    }
    let kinematics = gathered.kinematics;
    let errors = gathered.errors.into_iter();
    let errors = errors
        .map(|(symbol, (key, values))| {
            let side = chain.axes().iter().find(|a| a.name == symbol.axis()).map(|a| a.side);
            let motion = matches!(symbol, ErrorSymbol::Motion { .. });
            let flip = motion && side == Some(Side::Workpiece) && body == Some(Body::Carriage);
            function(&key, &values, if flip { -1.0 } else { 1.0 }).map(|f| (symbol, f))
        })
        .collect::<Result<Vec<_>, _>>()?;
    Ok(Tables { errors, kinematics })
}

fn empty_block(header: Option<&[(Word<'_>, ColumnKind)]>, rows: usize) -> Result<(), FormatError> {
    match header.and_then(|h| h.first()) {
        Some((word, _)) if rows == 0 => {
            let kind =
                FormatErrorKind::Missing { what: "a row below this header", remedy: "is the file cut?" };
            Err(word.fail(kind))
        }
        _ => Ok(()),
    }
}

fn read_header<'a>(
    line: Word<'a>,
    chain: &Chain,
    body: Option<Body>,
    gathered: &mut Gathered,
) -> Result<Vec<(Word<'a>, ColumnKind)>, FormatError> {
    let mut columns: Vec<(Word<'a>, ColumnKind)> = Vec::new();
    for word in words(line) {
        let kind = column(word.text).ok_or_else(|| word.unexpected("a column such as X, EXX, EAX or C0Y"))?;
        if columns.iter().any(|(w, _)| w.text == word.text) {
            return Err(word.twice(format!("column {}", word.text), line.line));
        }
        columns.push((word, kind));
    }
    let arguments: Key = columns
        .iter()
        .filter_map(|(_, k)| if let ColumnKind::Argument(a) = k { Some(*a) } else { None })
        .collect();
    for (word, kind) in &columns {
        let name = word.text.to_owned();
        let axis = match kind {
            ColumnKind::Foreign => {
                let why = "the model has no place for it and would be wrong without it; take the column out, or put what it says into the model's chain or axes";
                return Err(word.fail(FormatErrorKind::NotRead { name, why }));
            }
            ColumnKind::Kinematics => {
                gathered.kinematics.push(name);
                continue;
            }
            ColumnKind::Argument(axis) => *axis,
            ColumnKind::Error(symbol) => symbol.axis(),
        };
        let Some(found) = chain.axes().iter().find(|a| a.name == axis) else {
            let why = "its axis is not in the chain of the model; give the machine's --chain";
            return Err(word.fail(FormatErrorKind::NotRead { name, why }));
        };
        let ColumnKind::Error(symbol) = kind else { continue };
        if !symbol.is_constant() && found.side == Side::Workpiece && body.is_none() {
            let what = "whose motion the values of a workpiece-side axis are";
            return Err(word.fail(FormatErrorKind::NotStated {
                what,
                remedy: "give --sense relative or --sense carriage",
            }));
        }
        let wrong = |why| Err(word.fail(FormatErrorKind::NotRead { name: name.clone(), why }));
        if symbol.is_constant() && !arguments.is_empty() {
            return wrong("a position error that depends on an axis; the model holds it as one number");
        }
        if !symbol.is_constant() && arguments.len() == 1 && arguments[0] != axis {
            return wrong(
                "a component error over another axis alone; the model holds it over its own axis, or over two or three",
            );
        }
        if arguments.len() > 3 {
            return wrong("it depends on more than three axes; the model holds up to three");
        }
        let entry = gathered.errors.entry(*symbol).or_insert_with(|| (arguments.clone(), BTreeMap::new()));
        if entry.0 != arguments {
            return wrong("it was given before with other arguments; keep one of the two");
        }
    }
    if !columns.iter().any(|(_, k)| !matches!(k, ColumnKind::Argument(_))) {
        return Err(line.unexpected("a header with at least one error such as EXX"));
    }
    Ok(columns)
}

impl Gathered {
    fn row(
        &mut self,
        line: Word<'_>,
        columns: &[(Word<'_>, ColumnKind)],
        rows: usize,
    ) -> Result<(), FormatError> {
        let mut numbers = Vec::with_capacity(columns.len());
        let mut end = line;
        for word in words(line) {
            end = word;
            if numbers.len() == columns.len() {
                return Err(word.count("columns", columns.len(), words(line).count()));
            }
            numbers.push(word.number("a number, mm, deg or rad")?);
        }
        if numbers.len() < columns.len() {
            return Err(end.count("columns", columns.len(), numbers.len()));
        }
        self.values += numbers.len();
        if self.values > VALUES_MAX {
            return Err(line.too_many("values", self.values, VALUES_MAX));
        }
        let coordinates: Coordinates = columns
            .iter()
            .zip(&numbers)
            .filter(|((_, kind), _)| matches!(kind, ColumnKind::Argument(_)))
            .map(|(_, v)| ordered(*v))
            .collect();
        if coordinates.is_empty() && rows > 0 {
            return Err(line.unexpected("one row only: the block has no argument"));
        }
        for (i, ((word, kind), value)) in columns.iter().zip(&numbers).enumerate() {
            let ColumnKind::Error(symbol) = kind else { continue };
            possible(symbol.is_angle(), *value).map_err(|e| words(line).nth(i).unwrap_or(line).fail(e))?;
            let Some((_, values)) = self.errors.get_mut(symbol) else { continue };
            if let Some((_, first)) = values.insert(coordinates.clone(), (*value, line.line)) {
                return Err(line.twice(format!("{} at these arguments", word.text), first));
            }
        }
        Ok(())
    }
}

/// The curve, constant or grid of one error.
fn function(key: &[AxisName], values: &Values, sign: f64) -> Result<ErrorFunction, FormatError> {
    let line = values.values().map(|(_, line)| *line).min().unwrap_or(1);
    let fail = |kind| FormatError::at(line, 1, kind);
    let inner = |axis: AxisName, v: i64| axis.kind().position_in(unordered(v));
    let signed: Vec<f64> = values.values().map(|(v, _)| if sign < 0.0 { -v } else { *v }).collect();
    if signed.len() == 1 {
        return Ok(ErrorFunction::single(Curve::Constant(signed[0])));
    }
    if let [axis] = key {
        let at = values.keys().map(|k| inner(*axis, k[0])).collect();
        let table = Table::new(at, signed, None, Interpolation::Linear).map_err(|e| fail(e.into()))?;
        return Ok(ErrorFunction::single(Curve::Table(table)));
    }
    let mut axes = Vec::new();
    for (i, axis) in key.iter().enumerate() {
        let distinct: std::collections::BTreeSet<i64> = values.keys().map(|k| k[i]).collect();
        axes.push((*axis, distinct.into_iter().map(|v| inner(*axis, v)).collect::<Vec<f64>>()));
    }
    let full = axes.iter().try_fold(1usize, |n, (_, p)| n.checked_mul(p.len()));
    if full != Some(values.len()) {
        let announced = full.map_or(u64::MAX, |n| n as u64);
        let what = "combinations of arguments (a grid needs a row for each)";
        return Err(fail(FormatErrorKind::Count { what, announced, found: values.len() as u64 }));
    }
    let grid = Grid::new(axes, signed).map_err(|e| fail(e.into()))?;
    Ok(ErrorFunction { grids: vec![grid], ..ErrorFunction::default() })
}

/// What was written.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Report {
    /// By axis: rows of its block, largest distance to the model in mm (angles: over one metre).
    pub blocks: Vec<(AxisName, usize, f64)>,
    /// Constants written.
    pub constants: usize,
}

/// Writes the errors of the given axes (all of the chain where empty), and the constants among them.
///
/// # Errors
/// What the format cannot hold.
pub fn write(
    spec: &ModelSpec,
    axes: &[AxisName],
    body: Option<Body>,
    sampling: &Sampling,
) -> Result<(String, Report), ExportError> {
    let chosen: Vec<AxisName> = spec.chain.axes().iter().filter(|a| !a.spindle).map(|a| a.name).collect();
    let chosen = if axes.is_empty() { chosen } else { axes.to_vec() };
    let mut out = String::from("// errors, actual - nominal: mm and rad over mm and deg\n");
    let mut report = Report::default();
    for axis in &chosen {
        if spec.chain.index_of(*axis).is_none() {
            return Err(ExportError::AxisNotInChain { axis: *axis });
        }
        if !AXES.contains(axis) {
            return Err(ExportError::NoSuchAxis { axis: *axis, format: FORMAT, known: AXES_TEXT });
        }
        let motions = Motions::new(spec, *axis, true)?;
        let components = motions.present();
        if components.is_empty() {
            continue;
        }
        let workpiece = spec.is_workpiece_side(*axis);
        let sign = match (workpiece, body) {
            (true, None) => return Err(ExportError::SenseNotStated { axis: *axis }),
            (true, Some(Body::Carriage)) => -1.0,
            _ => 1.0,
        };
        block(&mut out, &motions, *axis, &components, sign, sampling, &mut report)?;
    }
    constants(&mut out, spec, &chosen, &mut report);
    match chosen.first() {
        Some(axis) if report.blocks.is_empty() && report.constants == 0 => {
            Err(ExportError::NoError { what: "errors", axis: *axis })
        }
        _ => Ok((out, report)),
    }
}

fn block(
    out: &mut String,
    motions: &Motions<'_>,
    axis: AxisName,
    components: &[Component],
    sign: f64,
    sampling: &Sampling,
    report: &mut Report,
) -> Result<(), ExportError> {
    let way = match (motions.first_two_way(components), sampling.way) {
        (Some(symbol), None) => return Err(ExportError::TwoDirections { symbol, format: FORMAT }),
        (_, way) => way.unwrap_or(Way::Forward),
    };
    let others: Vec<(AxisName, Vec<f64>)> =
        motions.other_axes().into_iter().map(|a| (a, LIMITS.apart(a, motions.grid_positions(a)))).collect();
    if let Some((other, _)) = others.iter().find(|(a, _)| !AXES.contains(a)) {
        return Err(ExportError::NoSuchAxis { axis: *other, format: FORMAT, known: AXES_TEXT });
    }
    let mut combinations = vec![Vec::new()];
    for (other, at) in &others {
        combinations = combinations
            .iter()
            .flat_map(|c: &Vec<(AxisName, f64)>| {
                at.iter().map(|v| c.iter().copied().chain([(*other, *v)]).collect())
            })
            .collect();
        if combinations.len() > LIMITS.points {
            let (found, limit) = (combinations.len(), LIMITS.points);
            return Err(ExportError::TooManyPoints { found, limit, format: FORMAT, reached_um: f64::NAN });
        }
    }
    let (at, error) = positions(motions, components, &combinations, &[way], sampling, &LIMITS)?;
    let argument = |a: AxisName, v: f64| rounded(a.kind().position_out(v), 1);
    let header = others.iter().map(|(a, _)| a.to_string()).chain([axis.to_string()]);
    let header =
        header.chain(components.iter().map(|c| format!("E{}{axis}", c.letter()))).collect::<Vec<_>>();
    line(out, format_args!("#\n{}", header.join(" ")));
    for combination in &combinations {
        for q in &at {
            let mut row: Vec<String> = combination.iter().map(|(a, v)| argument(*a, *v)).collect();
            row.push(argument(axis, *q));
            row.extend(components.iter().map(|c| rounded(sign * motions.value(*c, *q, combination, way), 1)));
            line(out, format_args!("{}", row.join(" ")));
        }
    }
    report.blocks.push((axis, combinations.len() * at.len(), error));
    Ok(())
}

fn constants(out: &mut String, spec: &ModelSpec, axes: &[AxisName], report: &mut Report) {
    let mut found: Vec<(String, f64)> = Vec::new();
    for (symbol, function) in &spec.errors {
        let value = function.value(0.0, Default::default());
        if symbol.is_constant() && axes.contains(&symbol.axis()) {
            // the letter E in front is the model's
            found.push((symbol.to_string().chars().skip(1).collect(), value));
        }
    }
    if found.is_empty() {
        return;
    }
    report.constants = found.len();
    let names: Vec<&str> = found.iter().map(|(n, _)| n.as_str()).collect();
    let values: Vec<String> = found.iter().map(|(_, v)| rounded(*v, 1)).collect();
    line(out, format_args!("#\n{}\n{}", names.join(" "), values.join(" ")));
}

fn line(out: &mut String, text: core::fmt::Arguments<'_>) {
    // writing to a String cannot fail
    let _ = writeln!(out, "{text}");
}

#[cfg(test)]
mod tests;
