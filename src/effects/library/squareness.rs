//! Axis-to-axis error of two linear axes.

use crate::prelude::*;

/// Variants of `squareness`.
pub(super) fn squareness(data: &Data, of: &Subject) -> Variants {
    if [of.first, of.axis].iter().any(|a| data.range[a.slot()].is_none()) {
        return Err("both axes must move".into());
    }
    // the angle of the later axis of the pair: of Y against X, of Z against Y, of Z against X
    let (along, over) = if of.first == Axis::Z { (of.axis, of.first) } else { (of.first, of.axis) };
    data.structural(vec![Squareness { along, over }.into(), Squareness { along: over, over: along }.into()])
}

/// The symbol of ISO 230-1 of a pair, and the sign by which its value follows from `angle_arcsec`: a right angle that is too wide
/// is a positive EC0Y or EA0Z and a negative EB0Z. `None` for what is no pair.
#[must_use]
pub fn symbol(pair: &str) -> Option<(&'static str, f64)> {
    match pair {
        "xy" => Some(("EC0Y", -1.0)),
        "yz" => Some(("EA0Z", -1.0)),
        "zx" => Some(("EB0Z", 1.0)),
        _ => None,
    }
}

/// `d_along = angle x_over`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
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

    fn becomes(&self, model: &Extended, entry: &Entry) -> Becomes {
        displacements(model, entry, self.over, Sampling::Line)
    }

    fn traits(&self) -> Traits {
        Traits::motion(self.along, self.over)
    }
}
