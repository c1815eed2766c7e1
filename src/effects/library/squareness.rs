//! Axis-to-axis error of two linear axes.

use crate::prelude::*;

/// What is known of it.
pub(crate) static SQUARENESS: Effect = Effect {
    name: "squareness",
    title: "squareness error of {}",
    synonyms: "ec0y eb0z ea0z perpendicularity",
    kind: Kind::Machine,
    subjects: Subjects::Pairs,
    cause: "Two axes are not square: foundation, alignment, a crash.",
    formula: "d_x = angle y (pairs xy, yz, zx)",
    looks_like: "A circle becomes an ellipse at 45 deg that is the same in both directions and at every feed; body diagonals differ in length.",
    confused_with: "a linear angular error (until a second tool length or lever is used), a straightness, a rotation of a tracker's frame",
    settles: "A circle in the plane of the pair in both directions, or the four face diagonals.",
    changes_with: &[Measurement::SecondPlace],
    remedy: "align the guideways, or compensate the axis-to-axis error",
    variants: |data, of| {
        if [of.first, of.axis].iter().any(|a| data.range[a.slot()].is_none()) {
            return Err("both axes must move".into());
        }
        // the angle of the later axis of the pair: of Y against X, of Z against Y, of Z against X
        let (along, over) = if of.first == Axis::Z { (of.axis, of.first) } else { (of.first, of.axis) };
        data.structural(vec![
            Squareness { along, over }.into(),
            Squareness { along: over, over: along }.into(),
        ])
    },
};

/// `d_along = angle x_over`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[expect(missing_docs, reason = "the symbols of the formula")]
pub struct Squareness {
    pub along: Axis,
    pub over: Axis,
}

impl Form for Squareness {
    fn parameters(&self) -> Vec<String> {
        plain(&["angle_arcsec"])
    }

    fn evaluate(&self, m: &MachineState, _: &Read<'_>, out: &mut [Vec3]) {
        out[0] = unit(self.along.direction()) * (UM_PER_ARCSEC_MM * m.position[self.over.slot()]);
    }

    fn columns(&self) -> Vec<String> {
        vec![self.over.column()]
    }

    fn drawing(&self) -> Drawing {
        Over::Position(self.over).into()
    }

    fn becomes(&self, model: &Extended, entry: &Entry) -> Becomes {
        displacements(model, entry, self.over, Sampling::Line)
    }

    fn acts_along(&self) -> Option<Axis> {
        Some(self.along)
    }

    fn over(&self) -> Option<Axis> {
        Some(self.over)
    }
}
