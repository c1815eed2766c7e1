//! Causes over the data, for pictures.

use super::super::Analysis;
use super::super::assess::Assessed;
use super::super::forecast::{Contributions, minus};
use super::super::library::Shape;
use super::super::moment::{Axis, Moment};
use super::super::noise::Random;
use super::super::offsets::{rms, without_offsets};
use super::super::session::Session;
use super::Curve;

/// Points of a picture at most.
const POINTS: usize = 1500;

pub(super) fn curves(
    session: &Session,
    a: &Analysis,
    assessed: &[Assessed],
    parts: &Contributions,
    owner: &[usize],
) -> Vec<Curve> {
    let mut random = Random::new(1);
    assessed
        .iter()
        .enumerate()
        .map(|(place, x)| {
            let others = minus(&a.gap, &parts.in_sample, |j| owner[j] != place);
            let partial = without_offsets(session, &others, &a.used);
            let alone: Vec<f64> = (0..a.gap.len())
                .map(|i| {
                    parts.in_sample.iter().zip(owner).filter(|(_, o)| **o == place).map(|(p, _)| p[i]).sum()
                })
                .collect();
            let fit = without_offsets(session, &alone, &a.used);
            let (x_label, of) = abscissa(&a.library.variants[x.variant].shape);
            let along = a.library.variants[x.variant].shape.acts_along();
            // an effect of one direction is drawn in it, whichever way the instrument looked
            let share_of_u = |i: usize| along.map_or(1.0, |a| session.moments[i].u[a.direction()]);
            let y_label = along.map_or_else(|| "along u, um".to_owned(), |a| format!("along {a}, um"));
            let size = rms(&fit);
            let seen: Vec<usize> = (0..a.gap.len())
                .filter(|i| {
                    partial[*i].is_finite() && fit[*i].abs() > 0.05 * size && share_of_u(*i).abs() > 0.5
                })
                .collect();
            let share = POINTS as f64 / seen.len().max(1) as f64;
            let points = seen
                .into_iter()
                .filter(|_| random.uniform() < share)
                .map(|i| {
                    [of(&session.moments[i], session), partial[i] / share_of_u(i), fit[i] / share_of_u(i)]
                })
                .filter(|p| p[0].is_finite())
                .collect();
            Curve { label: x.label.to_string(), x_label, y_label, points }
        })
        .collect()
}

type Abscissa = Box<dyn Fn(&Moment, &Session) -> f64>;

/// What an effect is drawn over.
fn abscissa(shape: &Shape) -> (String, Abscissa) {
    let position = |axis: Axis| -> (String, Abscissa) {
        let i = axis.slot();
        if axis.is_linear() {
            (format!("{axis}, mm"), Box::new(move |m, _| m.position[i]))
        } else {
            (format!("{axis}, deg"), Box::new(move |m, _| m.position[i].to_degrees()))
        }
    };
    match shape {
        Shape::Squareness { over, .. } | Shape::Polynomial { over, .. } | Shape::Angular { over, .. } => {
            position(*over)
        }
        Shape::Scale { axis }
        | Shape::Reverse { axis, .. }
        | Shape::Cyclic { axis, .. }
        | Shape::Wear { axis, .. }
        | Shape::Sag { axis, .. }
        | Shape::Ram { axis, .. }
        | Shape::Thermal { axis, .. }
        | Shape::Backlash { axis, .. }
        | Shape::RotaryMotion { axis, .. } => position(*axis),
        Shape::RotaryLocation { frame, .. }
        | Shape::RotaryEccentricity { frame, .. }
        | Shape::RotaryScale { frame }
        | Shape::RotaryBacklash { frame } => position(frame.axis),
        Shape::RotaryLag { frame } => {
            let i = frame.axis.slot();
            (
                format!("velocity of {}, deg/s", frame.axis),
                Box::new(move |m, _| m.velocity[i] / volcomp_units::RAD_PER_DEG),
            )
        }
        Shape::Spike { axis, .. } => {
            let i = axis.slot();
            (format!("time since {axis} turned round, s"), Box::new(move |m, _| m.since_s[i].min(2.0)))
        }
        Shape::Lag { axes, .. } => {
            let i = axes.first().map_or(0, |a| a.slot());
            let name = axes.first().map_or_else(String::new, ToString::to_string);
            (format!("velocity of {name}, mm/s"), Box::new(move |m, _| m.velocity[i]))
        }
        Shape::Friction { axis } => {
            let i = axis.slot();
            (format!("velocity of {axis}, mm/s"), Box::new(move |m, _| m.velocity[i]))
        }
        Shape::Inertial { axis, .. } | Shape::InertialTilt { axis, .. } => {
            let i = axis.slot();
            (format!("acceleration of {axis}, mm/s2"), Box::new(move |m, _| m.acceleration[i]))
        }
        Shape::SpindleTilt | Shape::ToolLength => {
            ("tool length, mm".to_owned(), Box::new(|m, _| m.tool_length_mm))
        }
        Shape::DeadPath { .. } | Shape::TrackerScale { .. } => {
            ("range, mm".to_owned(), Box::new(|m, _| m.range_mm))
        }
        Shape::Load { axis, .. } => {
            let i = axis.direction();
            (format!("force along {axis}, N"), Box::new(move |m, _| m.force_n[i]))
        }
        Shape::Growth { .. } | Shape::ClockSkew { .. } | Shape::Step { .. } => {
            ("time, s".to_owned(), Box::new(|m, _| m.t_s))
        }
    }
}
