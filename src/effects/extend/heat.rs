//! Effects of heat as thermal displacements of the model.

use super::{Becomes, Candidate, Extended, Part, shift};
use crate::Signal;
use crate::addition::Entry;
use crate::machine_state::{Axis, Source};
use volcomp_estimate::{Quantity, Thermal, ThermalInput};
use volcomp_model::curve::Live;
use volcomp_units::mm_from_um;

/// Strain per um of expansion on a metre.
const STRAIN_PER_UM_PER_M: f64 = 1e-6;
/// Revolutions in the unit of a spindle's signal.
const PER_THOUSAND: f64 = 1000.0;
/// A thermal displacement fades to zero over this share of its range beyond either end.
const FADE_SHARE: f64 = 0.25;
/// A live value is kept within so many times what it reaches inside its range.
const ROOM: f64 = 1.5;
/// Smallest limit of a live value, mm.
const LIMIT_MIN_MM: f64 = 0.001;

const NO_RANGE: &str = "the addition does not say which temperatures or speeds it was seen at";

fn input(
    entry: &Entry,
    signal: &Signal,
    reference: f64,
    coefficient: f64,
) -> Result<ThermalInput, &'static str> {
    let range = *entry.valid.get(&signal.source.to_string()).ok_or(NO_RANGE)?;
    if range[0] >= range[1] || range.iter().any(|v| v.is_nan()) {
        return Err(NO_RANGE);
    }
    // the sensor has the name of the column without the unit, as `volcomp fit thermal` names it
    let (sensor, quantity, reference) = match &signal.source {
        Source::Spindle => ("spindle".to_owned(), Quantity::Speed, reference * PER_THOUSAND),
        Source::Temperature(name) => (format!("temp_{name}"), Quantity::Temperature, reference),
        Source::Velocity(_) => return Err("a thermal displacement follows no velocity"),
    };
    Ok(ThermalInput {
        sensor,
        quantity,
        range,
        reference,
        power: signal.power,
        lags_s: vec![signal.tau_s],
        coefficients: vec![coefficient],
    })
}

/// The most that an input contributes inside its range, in its coefficient's unit.
fn reach(input: &ThermalInput) -> f64 {
    let per = if input.quantity == Quantity::Speed { PER_THOUSAND } else { 1.0 };
    let away = input.range.map(|end| ((end - input.reference).abs() / per).powf(input.power));
    let coefficient: f64 = input.coefficients.iter().map(|c| c.abs()).sum();
    coefficient * away[0].max(away[1])
}

fn thermal(
    model: &Extended,
    taken: &[Thermal],
    name: &str,
    expansion: bool,
    inputs: Vec<ThermalInput>,
) -> Thermal {
    let free = |name: &String| {
        !model.thermal.iter().chain(taken).any(|t| t.name == *name)
            && !model.spec.sensors().contains(&name.as_str())
    };
    let names = (1..).map(|n: u32| if n == 1 { name.to_owned() } else { format!("{name}-{n}") });
    let name = names.into_iter().find(free).unwrap_or_else(|| name.to_owned());
    Thermal { name, expansion, offset: 0.0, fade_share: FADE_SHARE, std: None, inputs }
}

/// An expansion by a temperature.
pub(crate) fn expansion(
    model: &Extended,
    entry: &Entry,
    axis: Axis,
    signal: &Signal,
    reference_degc: f64,
) -> Becomes {
    if signal.source == Source::Spindle {
        return Err("an expansion by spindle speed is not an expansion by temperature");
    }
    let symbol = shift(axis, axis);
    let mut made = Candidate::default();
    let [low, high] = super::curves::travel(&model.spec, entry, axis)
        .ok_or("the model does not say how far the axis travels; add travel-mm to [axes]")?;
    let add =
        |made: &mut Candidate, name: &str, strain: bool, coefficient: f64| -> Result<(), &'static str> {
            let input = input(entry, signal, reference_degc, coefficient)?;
            let arm_mm = if strain { low.abs().max(high.abs()) } else { 1.0 };
            let limit = (ROOM * reach(&input) * arm_mm).max(LIMIT_MIN_MM);
            let thermal = thermal(model, &made.thermal, name, strain, vec![input]);
            let live = Live { sensor: thermal.name.clone(), limit, reference: strain.then_some(0.0) };
            made.parts.push(Part { symbol, curve: None, live: Some(live), dynamic: None });
            made.thermal.push(thermal);
            Ok(())
        };
    add(&mut made, &format!("expansion-{axis}"), true, entry.value(0) * STRAIN_PER_UM_PER_M)?;
    if entry.value(1) != 0.0 {
        add(&mut made, &format!("shift-{axis}"), false, mm_from_um(entry.value(1)))?;
    }
    Ok(made)
}

/// A displacement that follows temperatures or the spindle.
pub(crate) fn growth(
    model: &Extended,
    entry: &Entry,
    signals: &[Signal],
    along: &[Axis],
    reference: f64,
) -> Becomes {
    let mut made = Candidate::default();
    for (j, axis) in along.iter().enumerate() {
        let mut inputs = Vec::new();
        for (i, signal) in signals.iter().enumerate() {
            let value = entry.value(i * along.len() + j);
            inputs.push(input(entry, signal, reference, mm_from_um(value))?);
        }
        let limit = (ROOM * inputs.iter().map(reach).sum::<f64>()).max(LIMIT_MIN_MM);
        let stem = if entry.name.starts_with("spindle") { "spindle" } else { "drift" };
        let thermal = thermal(model, &made.thermal, &format!("{stem}-{axis}"), false, inputs);
        let live = Live { sensor: thermal.name.clone(), limit, reference: None };
        made.parts.push(Part { symbol: shift(*axis, *axis), curve: None, live: Some(live), dynamic: None });
        made.thermal.push(thermal);
    }
    Ok(made)
}
