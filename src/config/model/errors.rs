//! `[errors.exx.table]` and its kin: curves by symbol.

use core::ops::Range;

use super::keys::{PositionKeys, ValueKeys, grid_key};
use super::{Provenance, dynamics, provenance, remedy};
use crate::prelude::*;
use volcomp_model::curve::{Chebyshev, CurveError, Fourier, Grid, HalfRange, Interpolation, Live, Table};
use volcomp_model::{Component, Curve};

/// Largest standard uncertainty taken for real, um or arcsec.
const STD: Allowed = Allowed::Within { low: 0.0, high: 5000.0 };
const SPAN: Allowed = Allowed::Positive { high: 1e6 };
const INTERPOLATIONS: [(&str, Interpolation); 2] =
    [("linear", Interpolation::Linear), ("cubic", Interpolation::MonotoneCubic)];

/// Reads one table of a kind.
type ReadKind = fn(&mut Kind<'_, '_>) -> Option<Curve>;

/// The kinds of curves by their keys.
const KINDS: [(&str, ReadKind); 5] = [
    ("constant", read_constant),
    ("table", read_table),
    ("fourier", read_fourier),
    ("half-range", read_half_range),
    ("chebyshev", read_chebyshev),
];

/// Standard uncertainty for every error that states none of its own.
pub(super) struct DefaultStd {
    length: Option<f64>,
    angle: Option<f64>,
}

impl DefaultStd {
    /// From `[provenance]`.
    pub(super) fn read(section: &Section<'_>) -> Self {
        Self {
            length: section.number("std-um", STD).map(|n| mm_from_um(n.value)),
            angle: section.number("std-arcsec", STD).map(|n| rad_from_arcsec(n.value)),
        }
    }

    fn of(&self, symbol: ErrorSymbol) -> Option<f64> {
        if symbol.is_angle() { self.angle } else { self.length }
    }
}

/// Reads all errors; `chain` is absent where it could not be read.
pub(super) fn read(
    errors: &Section<'_>,
    chain: Option<&Chain>,
    std: &DefaultStd,
    spec: &mut ModelSpec,
) -> Vec<(ErrorSymbol, Provenance)> {
    let mut origins = Vec::new();
    for name in errors.names() {
        let Some(symbol) = symbol_of_key(errors, &name, chain) else { continue };
        let Some(section) = errors.named(&name) else { continue };
        let (function, origin, largest) = read_error(section, symbol, std);
        if !origin.is_empty() {
            origins.push((symbol, origin));
        }
        if let (Some(function), Some(chain)) = (function, chain) {
            check_alone(errors, chain, (symbol, function), [largest, Some(name.place)], spec);
        }
    }
    origins
}

/// Adds an error to the model where it keeps the rules; else reports it at its largest number or its name.
fn check_alone(
    errors: &Section<'_>,
    chain: &Chain,
    entry: (ErrorSymbol, ErrorFunction),
    [largest, name]: [Option<Range<usize>>; 2],
    spec: &mut ModelSpec,
) {
    let mut alone = ModelSpec::new("", chain.clone());
    alone.errors.push(entry);
    let Err(e) = alone.validate() else {
        spec.errors.append(&mut alone.errors);
        return;
    };
    let too_large = matches!(e, ModelError::AngleTooLarge { .. } | ModelError::LengthTooLarge { .. });
    let span = largest.filter(|_| too_large).or(name);
    errors.report(Diagnostic { span, message: e.to_string(), remedy: Some(remedy(&e, &chain.to_string())) });
}

/// The symbol of a key, or a report of what is wrong with it.
fn symbol_of_key(errors: &Section<'_>, name: &Placed<&str>, chain: Option<&Chain>) -> Option<ErrorSymbol> {
    let lower = name.value.to_ascii_lowercase();
    let remedy = match ErrorSymbol::parse(name.value) {
        Some(symbol) if lower == name.value => return Some(symbol),
        Some(_) => format!("symbols are lower case in keys: write {lower}"),
        None => match lower.as_bytes() {
            [b'e', b'x', b'0', b'a'] | [b'e', b'y', b'0', b'b'] | [b'e', b'z', b'0', b'c'] => {
                "a shift of a rotary axis along itself has no effect: take it out".to_owned()
            }
            [b'e', _, b'0', b'x' | b'y' | b'z'] => {
                "squarenesses are ec0y (Y to X), eb0z (Z to X) and ea0z (Z to Y)".to_owned()
            }
            _ => {
                let known = symbols(chain);
                let known: Vec<&str> = known.iter().map(String::as_str).collect();
                suggestion(&lower, &known, "errors of this chain are: ")
            }
        },
    };
    errors.refuse(name.place.clone(), format!("{} is not an error symbol of ISO 230-1", name.value), remedy)
}

/// Every symbol that the axes of a chain can have.
pub(super) fn symbols(chain: Option<&Chain>) -> Vec<String> {
    let mut out = Vec::new();
    for axis in chain.map_or(&[][..], Chain::axes) {
        for zero in ["", "0"] {
            for component in Component::ALL {
                let text = format!("e{}{zero}{}", component.letter().to_ascii_lowercase(), axis.name.lower());
                if ErrorSymbol::parse(&text).is_some() {
                    out.push(text);
                }
            }
        }
    }
    out
}

/// One symbol: its curves in the order of the text, its origin, and where its largest number stands.
fn read_error(
    section: Section<'_>,
    symbol: ErrorSymbol,
    std: &DefaultStd,
) -> (Option<ErrorFunction>, Provenance, Option<Range<usize>>) {
    let (at, of) = (PositionKeys::of(symbol.axis()), ValueKeys::of(symbol));
    let section = section
        .because(at.unit, PositionKeys::reason(symbol.axis()))
        .because(of.unit, ValueKeys::reason(symbol));
    let mut curves = Vec::new();
    let mut largest: Option<Placed<f64>> = None;
    for (key, read) in KINDS {
        curves.extend(section.read_all(key, |part| {
            let start = part.place().map_or(0, |p| p.start);
            (start, read(&mut Kind { section: part, at, of, largest: &mut largest }))
        }));
    }
    let mut grids = Vec::new();
    for part in section.sections("grid") {
        let part = part
            .because("mm", "linear axes are in mm".to_owned())
            .because("deg", "rotary axes are in deg".to_owned());
        grids.push(read_grid(&mut Kind { section: &part, at, of, largest: &mut largest }));
        part.finish();
    }
    let live = section.read_all("live", |part| read_live(part, symbol));
    let own = section.number(of.std, STD).map(|n| (of.read)(n.value));
    let origin = provenance::read(&section);
    let dynamics = dynamics::read(&section, symbol);
    let no_dynamics = dynamics.as_ref().is_some_and(Vec::is_empty);
    if curves.is_empty() && grids.is_empty() && live.is_empty() && no_dynamics {
        let name = symbol.to_string().to_lowercase();
        section.report_here(
            format!("errors.{name} has no curve"),
            format!("add [errors.{name}.table], .fourier, .half-range, .chebyshev, .grid, .live, .reversal, .velocity, .acceleration or .constant; a missing error is zero"),
        );
    }
    section.finish();
    curves.sort_by_key(|(start, _)| *start);
    let curves: Option<Vec<Curve>> = curves.into_iter().map(|(_, curve)| curve).collect();
    let grids: Option<Vec<Grid>> = grids.into_iter().collect();
    let live: Option<Vec<Live>> = live.into_iter().collect();
    let parts = curves.zip(grids).zip(live).zip(dynamics);
    let function = parts.map(|(((curves, grids), live), dynamics)| ErrorFunction {
        curves,
        grids,
        live,
        dynamics,
        std: own.or(std.of(symbol)),
    });
    (function, origin, largest.map(|l| l.place))
}

/// One table of one kind while it is read.
struct Kind<'a, 'r> {
    section: &'a Section<'r>,
    at: &'static PositionKeys,
    of: &'static ValueKeys,
    largest: &'a mut Option<Placed<f64>>,
}

impl Kind<'_, '_> {
    fn note(&mut self, number: &Placed<f64>) {
        if self.largest.as_ref().is_none_or(|l| number.value.abs() > l.value.abs()) {
            *self.largest = Some(number.clone());
        }
    }

    /// One error value in mm or rad; absent counts as zero.
    fn value(&mut self, key: &'static str) -> Option<f64> {
        if self.section.value(key).is_none() {
            return Some(0.0);
        }
        let number = self.section.number(key, Allowed::Finite)?;
        self.note(&number);
        Some((self.of.read)(number.value))
    }

    /// Error values in mm or rad; absent counts as none.
    fn values(&mut self, key: &'static str) -> Option<Placed<Vec<f64>>> {
        if self.section.value(key).is_none() {
            return Some(Placed::new(Vec::new(), 0..0));
        }
        let list = self.section.numbers(key)?;
        for number in &list.value {
            self.note(number);
        }
        let values = list.value.iter().map(|n| (self.of.read)(n.value)).collect();
        Some(Placed::new(values, list.place))
    }

    /// Reports what the curve itself refuses.
    fn built<T>(&self, curve: Result<T, CurveError>, place: Option<Range<usize>>) -> Option<T> {
        curve
            .map_err(|e| {
                let remedy = match e {
                    CurveError::TooManyTerms { limit, .. } => {
                        format!("keep the first {limit} terms, or use a table for finer structure")
                    }
                    _ => "see the error curves in docs/reference/model-keys.md".to_owned(),
                };
                let message = format!("{}: {e}", self.section.title());
                self.section.report(Diagnostic {
                    span: place.or(self.section.place()),
                    message,
                    remedy: Some(remedy),
                });
            })
            .ok()
    }
}

fn read_constant(kind: &mut Kind<'_, '_>) -> Option<Curve> {
    let key = kind.of.value;
    let there = kind.section.require(key, &format!("add {key} = the value"));
    kind.value(key).filter(|_| there.is_some()).map(Curve::Constant)
}

fn read_table(kind: &mut Kind<'_, '_>) -> Option<Curve> {
    let (at, of) = (kind.at, kind.of);
    let there = [
        kind.section.require(at.position, &format!("add {} = [...], at least two positions", at.position)),
        kind.section.require(of.value, &format!("add {} = [...], one value per position", of.value)),
    ];
    let positions = kind.section.numbers(at.position);
    let values = kind.values(of.value);
    let has_reverse = kind.section.value(of.reverse).is_some();
    let reverse = kind.values(of.reverse);
    let rule = match kind.section.value("interpolation") {
        None => Some(Interpolation::default()),
        Some(_) => kind.section.choice("interpolation", &INTERPOLATIONS),
    };
    if there.contains(&None) {
        return None;
    }
    let positions = positions?;
    let rows = positions.value.len();
    let sorted = check_positions(kind.section, at.position, &positions);
    let mut complete = true;
    for (key, list) in [(of.value, &values), (of.reverse, &reverse)] {
        let Some(list) = list.as_ref().filter(|_| key == of.value || has_reverse) else { continue };
        if list.value.len() != rows {
            let message = format!(
                "{} has {} values for {rows} positions",
                kind.section.named_key(key),
                list.value.len()
            );
            kind.section.report_at(list.place.clone(), message, "give one value per position");
            complete = false;
        }
    }
    let (values, reverse, rule) = (values?, reverse?, rule?);
    if !(sorted && complete) {
        return None;
    }
    let inside = positions.value.iter().map(|p| (at.read)(p.value)).collect();
    let table = Table::new(inside, values.value, has_reverse.then_some(reverse.value), rule);
    kind.built(table, Some(positions.place)).map(Curve::Table)
}

/// At least two positions, strictly increasing; said in the unit of the file.
fn check_positions(section: &Section<'_>, key: &str, positions: &Placed<Vec<Placed<f64>>>) -> bool {
    let (key, unit) = (section.named_key(key), unit_of(key).unwrap_or_default());
    if positions.value.len() < 2 {
        let message = format!("{key}: a table needs at least 2 positions, found {}", positions.value.len());
        section.report_at(positions.place.clone(), message, "add rows, or write a constant");
        return false;
    }
    let bad = positions.value.windows(2).enumerate().find(|(_, pair)| pair[1].value <= pair[0].value);
    let Some((i, [previous, this])) = bad.and_then(|(i, pair)| Some((i, <&[_; 2]>::try_from(pair).ok()?)))
    else {
        return true;
    };
    let (row, before) = (i + 2, i + 1);
    let (message, remedy) = if this.value == previous.value {
        (
            format!("{key}: {} {unit} occurs twice (rows {before} and {row})", this.value),
            "keep one row per position; values for the other direction go into the reverse list",
        )
    } else {
        (
            format!(
                "{key}: {} {unit} (row {row}) is not above {} {unit} (row {before})",
                this.value, previous.value
            ),
            "sort the rows so that positions increase, and move their values with them",
        )
    };
    section.report_at(this.place.clone(), message, remedy);
    false
}

fn read_fourier(kind: &mut Kind<'_, '_>) -> Option<Curve> {
    let (at, of) = (kind.at, kind.of);
    let there = [
        kind.section.require(at.span, &format!("add {} = the length over which the series holds", at.span)),
        kind.section
            .require(at.period, &format!("add {} = the wave length of the first harmonic", at.period)),
    ];
    let origin = match kind.section.value(at.origin) {
        None => Some(0.0),
        Some(_) => kind.section.number(at.origin, Allowed::Finite).map(|n| n.value),
    };
    let span = kind.section.number(at.span, SPAN);
    let period = kind.section.number(at.period, SPAN);
    let (mean, linear) = (kind.value(of.mean), kind.value(of.linear));
    let (cos, sin) = (kind.values(of.cos), kind.values(of.sin));
    if there.contains(&None) {
        return None;
    }
    let (cos, sin) = (cos?, sin?);
    let longest = if cos.value.len() > sin.value.len() { &cos } else { &sin };
    let place = (!longest.value.is_empty()).then(|| longest.place.clone());
    let [origin, span, period] = [origin?, span?.value, period?.value].map(at.read);
    let series = Fourier::new(origin, span, period, mean?, linear?, &cos.value, &sin.value);
    kind.built(series, place).map(Curve::Fourier)
}

fn read_half_range(kind: &mut Kind<'_, '_>) -> Option<Curve> {
    let (at, of) = (kind.at, kind.of);
    let there = kind.section.require(at.range, &format!("add {} = [lower end, upper end]", at.range));
    let range = kind.section.interval(at.range);
    let (mean, linear, sin) = (kind.value(of.mean), kind.value(of.linear), kind.values(of.sin));
    let sin = sin.filter(|_| there.is_some())?;
    let [low, high] = range?.value.map(at.read);
    let series = HalfRange::new(low, high, mean?, linear?, &sin.value);
    kind.built(series, Some(sin.place)).map(Curve::HalfRange)
}

fn read_chebyshev(kind: &mut Kind<'_, '_>) -> Option<Curve> {
    let (at, of) = (kind.at, kind.of);
    let there = [
        kind.section.require(at.range, &format!("add {} = [lower end, upper end]", at.range)),
        kind.section.require(of.coefficients, &format!("add {} = [c0, c1, ...]", of.coefficients)),
    ];
    let range = kind.section.interval(at.range);
    let coefficients = kind.values(of.coefficients);
    if there.contains(&None) {
        return None;
    }
    let coefficients = coefficients?;
    let [low, high] = range?.value.map(at.read);
    let polynomial = Chebyshev::new(low, high, coefficients.value);
    kind.built(polynomial, Some(coefficients.place)).map(Curve::Chebyshev)
}

/// A value that a sensor tells: `sensor = "ram"` and the limit within which it is believed; with `reference-mm` the sensor
/// tells a strain about that coordinate.
fn read_live(section: &Section<'_>, symbol: ErrorSymbol) -> Option<Live> {
    let of = ValueKeys::of(symbol);
    let sensor = section.text("sensor");
    section.require("sensor", "add sensor = \"name\", the sensor that tells this error");
    section.require(of.limit, &format!("add {} = .., the largest value that is believed", of.limit));
    let limit = section.number(of.limit, Allowed::Positive { high: 5000.0 });
    let reference = match symbol.axis().kind() {
        AxisKind::Linear => section.number("reference-mm", Allowed::Finite).map(|n| n.value),
        AxisKind::Rotary => None,
    };
    Some(Live { sensor: sensor?.value.to_owned(), limit: (of.read)(limit?.value), reference })
}

/// A grid over several axes: `axes = ["y", "z"]`, positions behind `y-mm` and `z-mm`, values with the last axis fastest.
fn read_grid(kind: &mut Kind<'_, '_>) -> Option<Grid> {
    let of = kind.of;
    let there = [
        kind.section.require("axes", "add axes = [\"y\", \"z\"], the axes that it runs over, slowest first"),
        kind.section
            .require(of.value, &format!("add {} = [...], one value per point, last axis fastest", of.value)),
    ];
    let names = kind.section.texts("axes");
    let values = kind.values(of.value);
    let names = names?;
    let edges: Vec<Option<(AxisName, Vec<f64>)>> =
        names.value.iter().map(|name| read_edge(kind, name)).collect();
    if there.contains(&None) {
        return None;
    }
    let (edges, values) = (edges.into_iter().collect::<Option<Vec<_>>>()?, values?);
    let expected: usize = edges.iter().map(|(_, p)| p.len()).fold(1, usize::saturating_mul);
    if (2..=3).contains(&edges.len()) && values.value.len() != expected {
        let sizes: Vec<String> = edges.iter().map(|(_, p)| p.len().to_string()).collect();
        let message = format!(
            "{} has {} values for {} = {expected} points",
            kind.section.named_key(of.value),
            values.value.len(),
            sizes.join(" x ")
        );
        return kind.section.refuse(values.place, message, "give one value per point, last axis fastest");
    }
    kind.built(Grid::new(edges, values.value), Some(names.place))
}

/// The positions of a grid along one of its axes.
fn read_edge(kind: &Kind<'_, '_>, name: &Placed<&str>) -> Option<(AxisName, Vec<f64>)> {
    let Some(axis) = crate::key_axis(name.value) else {
        let message = format!("{} does not know \"{}\"", kind.section.named_key("axes"), name.value);
        return kind.section.refuse(name.place.clone(), message, "axes are x y z u v w a b c");
    };
    let key = grid_key(axis);
    kind.section.require(key, &format!("add {key} = [...], the positions of the grid along {axis}"));
    let positions = kind.section.numbers(key)?;
    let read = PositionKeys::of(axis).read;
    check_positions(kind.section, key, &positions)
        .then(|| (axis, positions.value.iter().map(|p| read(p.value)).collect()))
}
