//! Readings over the quantity over which an effect is drawn, and what is divided out so that it is one curve.

use super::super::library::Shape;
use super::super::moment::{Axis, Moment};
use super::super::session::Session;
use volcomp_effects::drawing::{Branch, Drawing, Over, Weight};
use volcomp_effects::shape::line_of_sight;
use volcomp_model::geometry::unit;

/// How an effect is drawn.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct View {
    drawn: Drawing,
    /// The only direction in which it acts.
    pub(super) along: Option<usize>,
    /// It is drawn along the direction of measurement.
    pub(super) is_along_u: bool,
}

impl View {
    /// The view of a formula.
    pub(super) fn of(shape: &Shape) -> Self {
        let drawn = shape.drawing();
        let along = match (&drawn.weight, drawn.over) {
            // an expansion
            (Weight::Warmth(..), Over::Position(axis)) => Some(axis),
            _ => shape.acts_along(),
        };
        let is_along_u = matches!(drawn.weight, Weight::Lever(..))
            || matches!(drawn.over, Over::VelocityAlongU | Over::Range);
        Self { drawn, along: along.map(Axis::direction).filter(|_| !is_along_u), is_along_u }
    }

    /// Quantity and unit of the abscissa.
    pub(super) fn x_label(&self) -> String {
        match self.drawn.over {
            Over::Position(a) if a.is_linear() => format!("{a}, mm"),
            Over::Position(a) => format!("{a}, °"),
            Over::Period(a, pitch) if a.is_linear() => {
                format!("{a} within one period of {} mm, mm", round_4(pitch))
            }
            Over::Period(a, pitch) => format!("{a} within one period of {}°, °", round_4(pitch.to_degrees())),
            Over::SinceReversal(a, _) => format!("distance since the reversal of {a}, mm"),
            Over::TimeSinceReversal(a, _) => format!("time since the reversal of {a}, s"),
            Over::Velocity(a) if a.is_linear() => format!("velocity of {a}, mm/s"),
            Over::Velocity(a) => format!("velocity of {a}, °/s"),
            Over::VelocityAlongU => "velocity along the direction of measurement, mm/s".to_owned(),
            Over::Acceleration(a) => format!("acceleration of {a}, mm/s²"),
            Over::ToolLength => "tool length, mm".to_owned(),
            Over::Range => "range, mm".to_owned(),
            Over::Force(a) => format!("force along {a}, N"),
            Over::Time => "time, h".to_owned(),
        }
    }

    /// The abscissa of a reading.
    pub(super) fn x(&self, m: &Moment) -> f64 {
        match self.drawn.over {
            Over::Position(a) if a.is_linear() => m.position[a.slot()],
            Over::Position(a) => m.position[a.slot()].to_degrees(),
            Over::Period(a, pitch) if a.is_linear() => m.position[a.slot()].rem_euclid(pitch),
            Over::Period(a, pitch) => m.position[a.slot()].rem_euclid(pitch).to_degrees(),
            Over::SinceReversal(a, most) => m.since_mm[a.slot()].abs().min(most),
            Over::TimeSinceReversal(a, most) => m.since_s[a.slot()].min(most),
            Over::Velocity(a) if a.is_linear() => m.velocity[a.slot()],
            Over::Velocity(a) => m.velocity[a.slot()].to_degrees(),
            Over::VelocityAlongU => (0..3).filter(|k| m.u[*k] != 0.0).map(|k| m.velocity[k] * m.u[k]).sum(),
            Over::Acceleration(a) => m.acceleration[a.slot()],
            Over::ToolLength => m.tool_length_mm,
            Over::Range => m.range_mm,
            Over::Force(a) => m.force_n[a.direction()],
            Over::Time => m.t_s / 3600.0,
        }
    }

    /// Factor that is divided out.
    pub(super) fn weight(&self, m: &Moment, session: &Session) -> f64 {
        match &self.drawn.weight {
            Weight::One => 1.0,
            Weight::Lever(about, lever) => unit(about.direction()).cross(&lever.at(m)).dot(&m.u),
            Weight::Warmth(signal, reference) => {
                session.signal(signal).map_or(f64::NAN, |k| m.signals[k] - reference)
            }
        }
    }

    /// Component of the direction of measurement along that in which the effect is drawn: a machine direction, the line of sight of an
    /// instrument with a station, or the direction of measurement itself.
    pub(super) fn component(&self, m: &Moment, direction: Option<usize>) -> f64 {
        match (direction, self.drawn.over) {
            (Some(d), _) => m.u[d],
            (None, Over::Range) => line_of_sight(m).map_or(1.0, |line| line.dot(&m.u)),
            (None, _) => 1.0,
        }
    }

    /// True where something is divided out.
    pub(super) const fn is_weighted(&self) -> bool {
        !matches!(self.drawn.weight, Weight::One)
    }

    /// True where a lever is, so that a rotation is drawn.
    pub(super) const fn is_rotation(&self) -> bool {
        matches!(self.drawn.weight, Weight::Lever(..))
    }

    /// What is said of the factor; `{}` is its value.
    pub(super) fn weight_text(&self) -> Option<String> {
        match &self.drawn.weight {
            Weight::One | Weight::Lever(..) => None,
            Weight::Warmth(_, reference) => Some(format!("scaled to {{}} K above {reference:.1} °C")),
        }
    }

    /// What is said of readings beyond the end of the abscissa.
    pub(super) const fn end_text(&self) -> &'static str {
        match self.drawn.over {
            Over::SinceReversal(..) | Over::TimeSinceReversal(..) => {
                "readings farther from the reversal stand at the right edge"
            }
            _ => "",
        }
    }

    /// Line of each reading.
    pub(super) fn lines(&self, session: &Session) -> Vec<i64> {
        let of = |m: &Moment| match self.drawn.branch {
            Branch::None => 0,
            Branch::Direction(a) if m.direction[a.slot()] > 0.0 => -1,
            Branch::Direction(a) if m.direction[a.slot()] < 0.0 => -2,
            Branch::Direction(_) => -3,
            Branch::Tool if m.tool_length_mm.is_finite() => 1_000_000 + m.tool_length_mm.round() as i64,
            Branch::Tool => 0,
            Branch::File => 1 + m.file as i64,
        };
        session.moments.iter().map(of).collect()
    }

    /// Name of a line; empty where there is only one.
    pub(super) fn line_name(session: &Session, line: i64) -> String {
        match line {
            0 => String::new(),
            -1 => "travel in + direction".to_owned(),
            -2 => "travel in − direction".to_owned(),
            -3 => "before the first move".to_owned(),
            l if l >= 1_000_000 => format!("tool of {} mm", l - 1_000_000),
            l => {
                let file = usize::try_from(l - 1).ok().and_then(|k| session.files.get(k));
                if session.files.len() > 1 { file.cloned().unwrap_or_default() } else { String::new() }
            }
        }
    }
}

/// Four decimals without trailing zeros.
fn round_4(v: f64) -> f64 {
    (1e4 * v).round() / 1e4
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::library::forms;
    use volcomp_model::geometry::Vec3;

    #[test]
    fn the_scale_of_a_tracker_is_drawn_along_its_line_of_sight() {
        let view = View::of(&forms::TrackerScale { signal: None, zero: false }.into());
        let seen = |u: [f64; 3]| {
            let m = Moment {
                u: Vec3::from(u),
                station_mm: Vec3::new(0.0, -2000.0, 0.0),
                reflector_mm: Vec3::zeros(),
                ..Moment::default()
            };
            view.component(&m, None)
        };
        assert_eq!([seen([0.0, 1.0, 0.0]), seen([0.0, -1.0, 0.0]), seen([1.0, 0.0, 0.0])], [1.0, -1.0, 0.0]);
    }
}
