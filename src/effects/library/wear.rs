//! A worn place of a guide or screw.

use core::f64::consts::LN_2;

use crate::prelude::*;

/// Power of a worn place that is a bell.
const BELL: f64 = 2.0;
/// Widths that are tried, as shares of the travel, and how densely they lie.
const WIDTHS: [f64; 3] = [0.03, 0.06, 0.12];
const DENSITY: f64 = 1.7;
/// Places of the grid: from the first share of the travel on, over the second.
const PLACES: [f64; 2] = [0.08, 0.84];
/// Fewest positions, and fewest in the width of a place.
const POSITIONS_MIN: usize = 12;
const IN_WIDTH_MIN: f64 = 0.7;
/// How flat the bottom of a worn place may be: from a dent to a trough.
const POWERS: [f64; 2] = [1.5, 6.0];
/// How sharply it may end: from a step at its rim to nearly a bell.
const ORDERS: [f64; 2] = [0.5, 8.0];
/// Half the width at half the depth, as a share of the travel: wider it is a table, narrower a wave.
const WIDTH_RANGE: [f64; 2] = [0.026, 0.142];

/// Variants of `wear`.
pub(super) fn wear(data: &Data, of: &Subject) -> Variants {
    let axis = of.axis;
    let Some([low, high]) = data.moved(axis)? else { return Ok(Vec::new()) };
    let (span, different) = (high - low, data.positions[axis.slot()].len());
    if different < POSITIONS_MIN {
        return Err(format!("fewer than {POSITIONS_MIN} positions").into());
    }
    let mut shapes = Vec::new();
    for width in WIDTHS.into_iter().filter(|w| w * different as f64 >= IN_WIDTH_MIN) {
        let count = (DENSITY / width).round() as usize;
        for k in 0..=count {
            let centre_mm = low + span * (PLACES[0] + PLACES[1] * k as f64 / count as f64);
            shapes.push(Wear { axis, centre_mm, width_mm: width * span, power: BELL, order: None }.into());
        }
    }
    data.structural(shapes)
}

/// A worn place: `d_a = h (1 - |(x - centre)/width|^power / (2 order))^order` where that is above zero, or
/// `h exp(-|(x - centre)/width|^power / 2)`, its limit, without an order.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct Wear {
    pub axis: Axis,
    pub centre_mm: f64,
    pub width_mm: f64,
    /// 2 is a bell, more has a flat bottom.
    #[serde(default = "bell", skip_serializing_if = "is_bell")]
    pub power: f64,
    /// A place with an end: the lower, the sharper it ends.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub order: Option<f64>,
}

const fn bell() -> f64 {
    BELL
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes references")]
fn is_bell(power: &f64) -> bool {
    (power - BELL).abs() < 1e-12
}

impl Form for Wear {
    fn parameters(&self) -> Vec<String> {
        plain(&["height_um"])
    }

    fn evaluate(&self, m: &MachineState, _: &Read<'_>, out: &mut [Vec3]) {
        let s = ((m.position[self.axis.slot()] - self.centre_mm) / self.width_mm).abs().powf(self.power);
        let with_end = |order: f64| (1.0 - 0.5 * s / order).max(0.0).powf(order);
        out[0] = unit(self.axis.direction()) * self.order.map_or_else(|| (-0.5 * s).exp(), with_end);
    }

    fn becomes(&self, model: &Extended, entry: &Entry) -> Becomes {
        displacements(model, entry, self.axis, Sampling::Even)
    }

    fn fixed(&self) -> Vec<(String, f64)> {
        let mut fixed =
            named(&[("centre_mm", self.centre_mm), ("width_mm", self.width_mm), ("exponent_1", self.power)]);
        fixed.extend(self.order.map(|order| ("order_1".to_owned(), order)));
        fixed
    }

    fn is_valid(&self) -> bool {
        self.width_mm > 0.0 && self.power > 0.0 && self.order.is_none_or(|o| o > 0.0)
    }

    fn changed(&self, f: f64) -> Vec<Shape> {
        vec![
            with(self, |s| s.width_mm *= f),
            with(self, |s| s.centre_mm += self.width_mm * (f - 1.0) * 2.0),
            with(self, |s| s.power *= f),
            // a bell has no end; from here on one is looked for
            with(self, |s| s.order = Some(s.order.map_or(ORDERS[1], |order| order * f * f))),
        ]
    }

    fn is_itself(&self) -> bool {
        let is_within = |range: [f64; 2], v: &f64| (range[0]..=range[1]).contains(v);
        is_within(POWERS, &self.power) && self.order.as_ref().is_none_or(|o| is_within(ORDERS, o))
    }

    fn is_within(&self, span: &Span<'_>, _: [f64; 3]) -> bool {
        let [low, high] = span(self.axis);
        let depth = self.order.map_or(LN_2, |n| n * (1.0 - 0.5f64.powf(1.0 / n)));
        let half_mm = self.width_mm * (2.0 * depth).powf(1.0 / self.power);
        (low..=high).contains(&self.centre_mm)
            && (WIDTH_RANGE[0]..=WIDTH_RANGE[1]).contains(&(half_mm / (high - low)))
    }

    fn traits(&self) -> Traits {
        Traits { is_free_curve: true, ..Traits::motion(self.axis, self.axis) }
    }
}
