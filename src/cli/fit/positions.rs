//! Checks of the positions and of repeated files before anything is fitted.

use super::Result;
use super::input::{BySymbol, Measured};
use super::report::Fitted;
use crate::prelude::*;
use volcomp_model::ModelError;

/// Widest gap between neighbouring positions, in ranges of all others.
const GAP: f64 = 20.0;
/// Fewest positions beside a gap that is judged.
const OTHERS: usize = 3;
/// Share of the travel by which positions may lie outside it, or that a curve may leave out.
const OUTSIDE: f64 = 0.01;
/// Largest value of a curve, in largest readings, that the readings themselves explain.
const SWING: f64 = 3.0;
/// Fewest readings of a file that are compared with those of another.
const COMPARED: usize = 5;

/// Refuses positions far from all others and files given twice; notes positions outside the `travel` of their axis and
/// positions that seem to be in metres.
pub(super) fn check(by_symbol: &BySymbol, travel: impl Fn(AxisName) -> Option<[f64; 2]>) -> Result<()> {
    let mut noted = BTreeSet::new();
    for (symbol, measured) in by_symbol {
        check_repeated(*symbol, measured)?;
        let axis = symbol.axis();
        let unit = Unit::of(axis);
        check_gap(measured, &unit)?;
        check_sizes(*symbol, measured)?;
        let outside = travel(axis).and_then(|travel| outside(measured, axis, &unit, travel));
        noted.extend([outside, metres(measured, axis)].into_iter().flatten());
    }
    noted.iter().for_each(|line| note!("note: {line}"));
    Ok(())
}

/// How positions of an axis are written.
struct Unit {
    name: &'static str,
    scale: f64,
}

impl Unit {
    fn of(axis: AxisName) -> Self {
        let scale = if axis.kind() == AxisKind::Rotary { deg_from_rad(1.0) } else { 1.0 };
        Self { name: axis.kind().position_unit(), scale }
    }

    /// A position in this unit, without the digits of rounding.
    fn show(&self, position: f64) -> String {
        figure((1e6 * self.scale * position).round() / 1e6)
    }
}

/// The place of a reading in words.
fn place(measured: &Measured, reading: usize) -> String {
    match measured.place(reading) {
        (file, 0) => file.to_owned(),
        (file, line) => format!("{file}:{line}"),
    }
}

/// A few positions at one end, far beyond the range of all others, are wrong numbers.
fn check_gap(measured: &Measured, unit: &Unit) -> Result<()> {
    let mut x: Vec<f64> = measured.readings.iter().map(|r| r.position).collect();
    x.sort_by(f64::total_cmp);
    x.dedup();
    let widest = (1..x.len()).max_by(|a, b| (x[*a] - x[a - 1]).total_cmp(&(x[*b] - x[b - 1])));
    let Some(split) = widest.filter(|_| x.len() > OTHERS) else { return Ok(()) };
    let (below, above) = x.split_at(split);
    let (far, others) = if below.len() < above.len() { (below, above) } else { (above, below) };
    let gap = x[split] - x[split - 1];
    let rest = x[x.len() - 1] - x[0] - gap;
    if others.len() < OTHERS || gap <= GAP * rest {
        return Ok(());
    }
    let reading = measured.readings.iter().position(|r| far.contains(&r.position)).unwrap_or(0);
    let position = unit.show(measured.readings[reading].position);
    let [low, high] = [others[0], others[others.len() - 1]].map(|v| unit.show(v));
    let name = unit.name;
    Err(data!(
        place(measured, reading),
        "position {position} {name} lies far from all others, {low} to {high} {name}; correct it or remove the row"
    ))
}

/// Readings outside the travel of their axis.
fn outside(measured: &Measured, axis: AxisName, unit: &Unit, [low, high]: [f64; 2]) -> Option<String> {
    let allowed = OUTSIDE * (high - low);
    let is_outside = |p: f64| p < low - allowed || p > high + allowed;
    let first = measured.readings.iter().position(|r| is_outside(r.position))?;
    let count = measured.readings.iter().filter(|r| is_outside(r.position)).count();
    let (name, place, all) = (unit.name, place(measured, first), measured.readings.len());
    let [position, low, high] = [measured.readings[first].position, low, high].map(|v| unit.show(v));
    Some(format!(
        "{place}: position {position} {name} is outside the travel of axis {axis}, {low} to {high} {name} ({count} of {all} readings are)"
    ))
}

/// What a curve over `range` does at the rest of the travel of its axis, mm or rad.
pub(super) fn uncovered(symbol: ErrorSymbol, range: [f64; 2], travel: [f64; 2]) -> Option<String> {
    let allowed = OUTSIDE * (travel[1] - travel[0]);
    if range[0] <= travel[0] + allowed && range[1] >= travel[1] - allowed {
        return None;
    }
    let (axis, unit) = (symbol.axis(), Unit::of(symbol.axis()));
    let ([from, to], [low, high], name) =
        (range.map(|v| unit.show(v)), travel.map(|v| unit.show(v)), unit.name);
    Some(format!(
        "{symbol}: the curve covers {from} to {to} {name} of the travel of axis {axis}, {low} to {high} {name}; beyond its ends their \
         values are held and the positions flagged: measure the rest of the travel"
    ))
}

/// Positions of a linear axis that all lie within 1 mm of zero.
fn metres(measured: &Measured, axis: AxisName) -> Option<String> {
    let within = measured.readings.iter().all(|r| r.position.abs() <= 1.0);
    let several = measured.readings.iter().any(|r| r.position != measured.readings[0].position);
    (axis.kind() == AxisKind::Linear && within && several).then(|| {
        let (file, _) = measured.place(0);
        format!("{file}: all positions of axis {axis} lie within 1 mm of zero; were they in m, not in mm?")
    })
}

/// Looks at the unit of the values of each file.
fn check_sizes(symbol: ErrorSymbol, measured: &Measured) -> Result<()> {
    let of_value = Units::of(symbol).of_value;
    let mut first = 0;
    for (file, readings) in measured.by_file() {
        let line = |i: usize| u64::from(measured.place(first + i).1);
        let values = readings.iter().enumerate().map(|(i, r)| (of_value(r.value), line(i)));
        check_size(file, &column(symbol), values, symbol.is_angle())?;
        first += readings.len();
    }
    Ok(())
}

/// The same readings under two names pass for repeats without scatter.
fn check_repeated(symbol: ErrorSymbol, measured: &Measured) -> Result<()> {
    let mut seen: Vec<(&str, Vec<[u64; 2]>)> = Vec::new();
    for (file, readings) in measured.by_file() {
        let mut own: Vec<[u64; 2]> =
            readings.iter().map(|r| [r.position.to_bits(), r.value.to_bits()]).collect();
        own.sort_unstable();
        if let Some((other, _)) = seen.iter().find(|(_, o)| own.len() >= COMPARED && *o == own) {
            return Err(data!(
                file,
                "all of its {} readings of {symbol} stand in {other}, too; readings given twice look like repeats without \
                 noise: leave {file} out",
                own.len()
            ));
        }
        seen.push((file, own));
    }
    Ok(())
}

/// What is wrong with a curve that is too large for a model, though its readings are not.
pub(super) fn swing(fitted: &[Fitted], error: &ModelError) -> Option<String> {
    let (symbol, value, scale, unit) = match error {
        ModelError::LengthTooLarge { symbol, value_um } => (symbol, value_um, um_from_mm(1.0), "µm"),
        ModelError::AngleTooLarge { symbol, value_arcsec } => {
            (symbol, value_arcsec, arcsec_from_rad(1.0), "arcsec")
        }
        _ => return None,
    };
    let readings = &fitted.iter().find(|f| f.symbol == *symbol)?.measured.readings;
    let largest = scale * readings.iter().map(|r| r.value.abs()).fold(0.0, f64::max);
    (SWING * largest < *value).then(|| {
        format!(
            "{symbol}: the curve reaches {value:.0} {unit} between the positions, the readings {largest:.1} {unit}: measure where \
             positions are far apart, or use --basis table"
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use volcomp_identify::Reading;
    use volcomp_units::axes::Travel;

    fn at(positions: &[f64]) -> Measured {
        let reading = |p: &f64| Reading { cycle: 1, travel: Travel::Forward, position: *p, value: 1e-3 };
        Measured::from(positions.iter().map(reading).collect::<Vec<_>>())
    }

    #[test]
    fn a_position_far_from_all_others_is_refused() {
        let unit = Unit::of(AxisName::X);
        let even: Vec<f64> = (0..21).map(|i| 25.0 * f64::from(i)).collect();
        assert!(check_gap(&at(&even), &unit).is_ok());
        assert!(check_gap(&at(&[0.0, 1.0, 500.0]), &unit).is_ok());
        let failure = check_gap(&at(&[&even[..], &[1e6]].concat()), &unit).unwrap_err();
        assert!(
            failure.message.contains("position 1000000 mm lies far from all others, 0 to 500 mm"),
            "{}",
            failure.message
        );
    }

    #[test]
    fn travel_and_metres_are_noted() {
        let unit = Unit::of(AxisName::X);
        let found = outside(&at(&[0.0, 400.0, 510.0]), AxisName::X, &unit, [0.0, 500.0]).unwrap();
        assert!(
            found.contains(
                "position 510 mm is outside the travel of axis X, 0 to 500 mm (1 of 3 readings are)"
            )
        );
        assert_eq!(outside(&at(&[-1.0, 400.0, 504.0]), AxisName::X, &unit, [0.0, 500.0]), None);
        let exx = ErrorSymbol::parse("exx").unwrap();
        let found = uncovered(exx, [15.0, 977.0], [0.0, 1000.0]).unwrap();
        assert!(
            found.contains("covers 15 to 977 mm of the travel of axis X, 0 to 1000 mm; beyond"),
            "{found}"
        );
        assert_eq!(uncovered(exx, [5.0, 1000.0], [0.0, 1000.0]), None);
        assert!(metres(&at(&[0.0, 0.25, 0.5]), AxisName::X).unwrap().contains("were they in m, not in mm?"));
        assert_eq!(metres(&at(&[0.0, 20.0]), AxisName::X), None);
        assert_eq!(metres(&at(&[0.0, 0.5]), AxisName::C), None);
    }
}
