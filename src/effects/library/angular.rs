//! Angular error motions of the linear axes.

use super::pitch_table;
use crate::data::Hidden;
use crate::polynomial::twist;
use crate::prelude::*;

/// Degrees of the curves.
const DEGREES: [usize; 5] = [1, 2, 3, 5, 8];
/// Shortest lever through which an angle is said to act, mm.
const LEVER_MM: f64 = 1.0;

/// Furthest pivot, as a share of the longest travel: about a further one an angle is a displacement.
const PIVOT_MAX: f64 = 1.0;

/// Variants of `angular`.
pub(super) fn angular(data: &Data, of: &Subject) -> Variants {
    let over = of.axis;
    let Some([low, high]) = data.range[over.slot()] else { return Ok(Vec::new()) };
    // about a linear direction
    let about = Axis::LINEAR[of.first.direction()];
    let (centre_mm, half_mm, lever) = (0.5 * (low + high), 0.5 * (high - low), data.arm(over, about));
    // a lever along its own axis is a function of the same position, one that nothing looks across shows nothing
    let crosses = |i: &usize| ![about.direction(), over.direction()].contains(i) && lever.axes[*i];
    let shows = |i: usize| data.range[i].is_some() && data.sees[3 - about.direction() - i];
    let arm = (0..3).filter(crosses).any(shows);
    let tool = lever.tool && about != Axis::Z || data.head();
    if !(arm || tool || data.angular) {
        let moved: [f64; 3] = unit(about.direction()).cross(&lever.at(&data.first)).into();
        return Err(Hidden {
            one_lever: moved.map(|d| d.abs() > LEVER_MM),
            ..Hidden::from(
                "no lever changes: move an axis between it and the tool, or use a second tool length",
            )
        });
    }
    let centre_mm = Some(centre_mm);
    let shape = |degree| Angular { about, over, degree, half_mm, centre_mm, lever }.into();
    let mut shapes: Vec<Shape> = data.degrees(over, None, &DEGREES).into_iter().map(shape).collect();
    shapes.extend(pitch_table::tables_of_angles(data, about, over, lever));
    data.structural(shapes)
}

/// `d = eps x lever` about one direction, `eps = SUM e_k p_k(x)` zero at the zero of the axis.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct Angular {
    pub about: Axis,
    pub over: Axis,
    pub degree: usize,
    pub half_mm: f64,
    /// Middle of the data; powers of `x/half` where it does not stand.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub centre_mm: Option<f64>,
    pub lever: Lever,
}

impl Angular {
    fn curve(&self, q: f64) -> [f64; WIDTH_MAX] {
        let mut values = [0.0; WIDTH_MAX];
        twist(q, self.half_mm, self.centre_mm, &mut values[..self.degree]);
        values
    }
}

impl Form for Angular {
    fn parameters(&self) -> Vec<String> {
        (1..=self.degree).map(|k| format!("e{k}_arcsec")).collect()
    }

    fn width(&self) -> usize {
        self.degree
    }

    fn evaluate(&self, m: &MachineState, _: &Read<'_>, out: &mut [Vec3]) {
        self.lever.turn_by(self.about, m, self.curve(m.position[self.over.slot()]), out);
    }

    fn drawing(&self) -> Drawing {
        Drawing::from(Over::Position(self.over)).scaled(Weight::Lever(self.about, self.lever))
    }

    fn becomes(&self, model: &Extended, entry: &Entry) -> Becomes {
        let angle = |q: f64| self.curve(q).iter().zip(&entry.values).map(|(v, e)| v * e).sum();
        rotation(model, entry, self.over, (self.about, Some(&self.lever)), Sampling::Even, &angle)
    }

    fn is_within(&self, span: &Span<'_>, tip_mm: [f64; 3]) -> bool {
        self.lever.is_from_zero(span, tip_mm, PIVOT_MAX)
    }

    fn is_valid(&self) -> bool {
        self.half_mm > 0.0 && self.centre_mm.is_none_or(f64::is_finite)
    }

    fn traits(&self) -> Traits {
        Traits {
            over: Some(self.over),
            turns: Some(Axis::ROTARY[self.about.direction()]),
            is_free_curve: true,
            ..Traits::default()
        }
    }
}
