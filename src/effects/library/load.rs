//! Compliance under forces.

use crate::data::Hidden;
use crate::prelude::*;

/// Powers of the force: a spring, and one that stiffens.
const POWERS: [f64; 2] = [1.0, 0.8];

/// Variants of `load`.
pub(super) fn load(data: &Data, of: &Subject) -> Variants {
    let axis = of.axis;
    if !data.forces[axis.direction()] {
        return Err(Hidden::unrecorded("no force is logged, or it does not change"));
    }
    let shapes = Axis::LINEAR.into_iter().flat_map(|along| POWERS.map(|power| (along, power)));
    Ok(shapes.map(|(along, power)| Load { axis, along, power }.into()).collect())
}

/// `d_along = c sign(F) |F|^power` of one axis.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Load {
    pub axis: Axis,
    pub along: Axis,
    pub power: f64,
}

impl Form for Load {
    fn parameters(&self) -> Vec<String> {
        let is_spring = (self.power - 1.0).abs() < 1e-12;
        plain(&[if is_spring { "compliance_um_per_n" } else { "compliance_um_per_n_to_the_power" }])
    }

    fn evaluate(&self, m: &MachineState, _: &Read<'_>, out: &mut [Vec3]) {
        let f = m.force_n[self.axis.direction()];
        out[0] = unit(self.along.direction()) * (f.signum() * f.abs().powf(self.power));
    }

    fn drawing(&self) -> Drawing {
        Over::Force(self.axis).into()
    }

    fn becomes(&self, _: &Extended, _: &Entry) -> Becomes {
        Err("it follows forces, which are not reported while the machine works")
    }

    fn fixed(&self) -> Vec<(String, f64)> {
        named(&[("exponent_1", self.power)])
    }

    fn traits(&self) -> Traits {
        Traits { acts_along: Some(self.along), ..Traits::default() }
    }
}
