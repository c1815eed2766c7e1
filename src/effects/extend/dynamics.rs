//! Effects of direction, velocity, acceleration and tool length as dynamic terms and tool errors of a model.

use super::parts::{seen, travel};
use super::{Candidate, Part};
use crate::Shape;
use crate::addition::Entry;
use crate::machine_state::Axis;
use volcomp_model::geometry::{Vec3, unit};
use volcomp_model::{Component, DynamicTerm, ErrorSymbol, Law, ModelSpec, ToolErrors};
use volcomp_units::{RAD_PER_ARCSEC, mm_from_um, rad_from_deg};

/// A term is kept within so many times what it reaches inside the range of the data.
const ROOM: f64 = 1.5;
/// Smallest limit of a term, mm or rad.
const LIMIT_MIN: f64 = 1e-9;
/// Speed from which kinetic friction has about its full size, mm/s.
const CREEP_MM_PER_S: f64 = 0.1;
/// Shortest friction peak that offsets of 1 ms can follow, s.
const PEAK_MIN_S: f64 = 0.005;
/// mm per m, and mm/s^2 per m/s^2.
const PER_M: f64 = 1e-3;
const PER_MS: f64 = 1e-3;
const PER_MILLION: f64 = 1e-6;

const NO_SPEEDS: &str = "the addition does not say at which speeds it was seen; diagnose again";
const NO_ACCELERATIONS: &str = "the addition does not say at which accelerations it was seen; diagnose again";
const NO_GAUGE: &str = "the model does not say from where tool lengths count; add gauge-point-mm to [frame]";

/// The candidate of an effect of direction, velocity, acceleration or tool length; `None` for other effects.
pub(super) fn candidate(spec: &ModelSpec, entry: &Entry) -> Option<Result<Candidate, &'static str>> {
    Some(match &entry.shape {
        Shape::Backlash { axis, along, length_mm, slope } => {
            let each = 1 + usize::from(*slope);
            let law = Law::Reversal { build_up: *length_mm };
            let mut made = Candidate::default();
            for (j, a) in along.iter().enumerate() {
                let symbol = shift(*a, *axis);
                push(&mut made, spec, entry, *axis, symbol, law, 0.5, (each * j, *slope), mm_from_um(1.0));
            }
            Ok(made)
        }
        Shape::RotaryBacklash { frame } => {
            let mut made = Candidate::default();
            let (symbol, law) = (turn(frame.axis, frame.axis), Law::Reversal { build_up: 0.0 });
            push(&mut made, spec, entry, frame.axis, symbol, law, 0.5, (0, false), RAD_PER_ARCSEC);
            Ok(made)
        }
        Shape::RotaryLag { frame } => {
            let Some(range) = entry.valid.get(&format!("v{}_deg_per_s", frame.axis)) else {
                return Some(Err(NO_SPEEDS));
            };
            let most = range.iter().fold(0.0f64, |m, v| m.max(rad_from_deg(*v).abs()));
            let mut made = Candidate::default();
            let symbol = turn(frame.axis, frame.axis);
            push(&mut made, spec, entry, frame.axis, symbol, Law::Velocity, most, (0, false), -PER_MS);
            Ok(made)
        }
        Shape::Spike { rise_s, fall_s, .. } if rise_s.max(*fall_s) < PEAK_MIN_S => {
            Err("it lasts less than 5 ms: the friction compensation of the drive takes it out")
        }
        Shape::Spike { axis, rise_s, fall_s, slope } => {
            let law = Law::FrictionPeak { rise_s: *rise_s, fall_s: *fall_s };
            let mut made = Candidate::default();
            push(&mut made, spec, entry, *axis, shift(*axis, *axis), law, 1.0, (0, *slope), mm_from_um(1.0));
            Ok(made)
        }
        Shape::Friction { axis } => {
            let law = Law::Friction { speed: CREEP_MM_PER_S };
            let mut made = Candidate::default();
            push(&mut made, spec, entry, *axis, shift(*axis, *axis), law, 1.0, (0, false), mm_from_um(1.0));
            Ok(made)
        }
        Shape::Lag { axes, tie_ms } => lag(spec, entry, axes, *tie_ms),
        Shape::Inertial { axis, along, slope } => acceleration_of(entry, *axis).map(|most| {
            let mut made = Candidate::default();
            let unit = mm_from_um(PER_M);
            push(
                &mut made,
                spec,
                entry,
                *axis,
                shift(*along, *axis),
                Law::Acceleration,
                most,
                (0, *slope),
                unit,
            );
            made
        }),
        Shape::InertialTilt { axis, about, lever } => acceleration_of(entry, *axis).map(|most| {
            let mut made = Candidate::default();
            for (i, b) in about.iter().enumerate() {
                let angle = value(entry, i) * RAD_PER_ARCSEC * PER_M;
                made.parts.push(term(turn(*b, *axis), Law::Acceleration, angle, 0.0, angle.abs() * most));
                // the model turns about the reference points of the axis, the structure about a point of its own
                let mut home = Vec3::from(lever.home_mm);
                if let Some(gauge) = spec.gauge_point.filter(|_| lever.tool) {
                    home.z -= gauge.z - spec.tool_tip.z;
                }
                for (k, along) in Axis::LINEAR.into_iter().enumerate() {
                    let reference = spec.axis(axis.name()).reference_points[k].point;
                    let gain = angle * unit(b.direction()).cross(&(home - spec.tool_tip + reference))[k];
                    if gain.abs() * most > LIMIT_MIN {
                        made.parts.push(term(
                            shift(along, *axis),
                            Law::Acceleration,
                            gain,
                            0.0,
                            gain.abs() * most,
                        ));
                    }
                }
            }
            made
        }),
        Shape::ToolLength => {
            tool(spec, ToolErrors { length: value(entry, 0) * PER_MILLION, ..ToolErrors::default() })
        }
        Shape::SpindleTilt => {
            let tilt = [0, 1].map(|k| value(entry, k) * RAD_PER_ARCSEC);
            tool(spec, ToolErrors { tilt, ..ToolErrors::default() })
        }
        _ => return None,
    })
}

/// Following error and delay: against the velocity, and with the acceleration where the servo has a second time constant.
fn lag(spec: &ModelSpec, entry: &Entry, axes: &[Axis], tie_ms: f64) -> Result<Candidate, &'static str> {
    let mut made = Candidate::default();
    for axis in axes {
        let range = entry.valid.get(&format!("v{axis}_mm_per_s")).ok_or(NO_SPEEDS)?;
        let most = range.iter().fold(0.0f64, |m, v| m.max(v.abs()));
        let symbol = shift(*axis, *axis);
        push(&mut made, spec, entry, *axis, symbol, Law::Velocity, most, (0, false), -mm_from_um(1.0));
        if tie_ms > 0.0 {
            let (most, unit) = (acceleration_of(entry, *axis)?, mm_from_um(tie_ms * PER_MS));
            push(&mut made, spec, entry, *axis, symbol, Law::Acceleration, most, (0, false), unit);
        }
    }
    Ok(made)
}

fn tool(spec: &ModelSpec, errors: ToolErrors) -> Result<Candidate, &'static str> {
    if spec.gauge_point.is_none() {
        return Err(NO_GAUGE);
    }
    Ok(Candidate { tool: Some(errors), ..Candidate::default() })
}

/// Adds a term: its parameter at `at` times `unit`, with the relative growth of the next parameter where there is one;
/// `most` is the largest signal that the data have seen.
#[expect(clippy::too_many_arguments, reason = "one call per law, each in one line")]
fn push(
    made: &mut Candidate,
    spec: &ModelSpec,
    entry: &Entry,
    axis: Axis,
    symbol: ErrorSymbol,
    law: Law,
    most: f64,
    (at, slope): (usize, bool),
    unit: f64,
) {
    let gain = value(entry, at) * unit;
    let growth =
        if slope && value(entry, at) != 0.0 { value(entry, at + 1) * PER_M / value(entry, at) } else { 0.0 };
    let far = travel(spec, entry, axis).or_else(|| seen(entry, axis)).unwrap_or_default();
    let largest = far.iter().fold(1.0f64, |m, x| m.max((1.0 + growth * x).abs()));
    made.parts.push(term(symbol, law, gain, growth, gain.abs() * largest * most));
}

fn term(symbol: ErrorSymbol, law: Law, gain: f64, growth: f64, reach: f64) -> Part {
    let limit = (ROOM * reach).max(LIMIT_MIN);
    Part { symbol, curve: None, live: None, dynamic: Some(DynamicTerm { law, gain, growth, limit }) }
}

/// The largest acceleration of the data, mm/s^2.
fn acceleration_of(entry: &Entry, axis: Axis) -> Result<f64, &'static str> {
    let range = entry.valid.get(&format!("a{axis}_mm_per_s2")).ok_or(NO_ACCELERATIONS)?;
    Ok(range.iter().fold(0.0f64, |m, v| m.max(v.abs())))
}

fn value(entry: &Entry, k: usize) -> f64 {
    entry.values.get(k).copied().unwrap_or(0.0)
}

/// The displacement of an axis in a direction.
const fn shift(along: Axis, axis: Axis) -> ErrorSymbol {
    let component = match along.direction() {
        0 => Component::X,
        1 => Component::Y,
        _ => Component::Z,
    };
    ErrorSymbol::Motion { component, axis: axis.name() }
}

/// The turn of an axis about a direction.
const fn turn(about: Axis, axis: Axis) -> ErrorSymbol {
    let component = match about.direction() {
        0 => Component::A,
        1 => Component::B,
        _ => Component::C,
    };
    ErrorSymbol::Motion { component, axis: axis.name() }
}
