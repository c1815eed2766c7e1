//! What turns the tool about something: levers, and beams that bend under it.

use serde::{Deserialize, Serialize};

use crate::machine_state::{Axis, MachineState};
use volcomp_model::geometry::{Vec3, unit};

/// What lies between an angular error and the tool tip.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct Lever {
    /// The linear axes whose travel counts.
    pub axes: [bool; 3],
    /// Tool tip (or spindle nose, where the tool length is known) at home, mm.
    pub home_mm: [f64; 3],
    /// The tool length counts, too.
    pub tool: bool,
}

impl Lever {
    /// The vector to the tool tip as the head has turned it, mm.
    #[must_use]
    pub fn at(&self, m: &MachineState) -> Vec3 {
        let mut home = Vec3::from(self.home_mm);
        if self.tool && m.tool_length_mm.is_finite() {
            home.z -= m.tool_length_mm;
        }
        let mut r = m.head.carries(home);
        for (i, counts) in self.axes.iter().enumerate() {
            if *counts {
                r[i] += m.position[i];
            }
        }
        r
    }
}

/// A beam from `start` on that is so long: its drop and, where there is an arm to the tool, what its slope does there.
pub(super) fn sag(
    axis: Axis,
    start: f64,
    length: f64,
    arm: Option<Vec3>,
    m: &MachineState,
    out: &mut [Vec3],
) {
    let s = m.position[axis.slot()] - start;
    let cube = 2.0 * length.powi(3);
    out[0] = Vec3::new(0.0, 0.0, -s * s * (3.0 * length - s) / cube);
    if let Some(arm) = arm {
        let slope = (6.0 * length * s - 3.0 * s * s) / cube;
        let about = unit(axis.direction()).cross(&unit(2));
        out[1] = about.cross(&arm) * slope;
    }
}

/// A cantilever of length s: a weight at its end bends it by `s^3`, its own by `s^4`, a moment by `s^2`; `slopes` are those of its
/// end as multiples of the drop per length: 3/2, 4/3 and 2.
pub(super) fn ram(
    axis: Axis,
    start: f64,
    reach: f64,
    lever: &Lever,
    slopes: [f64; 3],
    m: &MachineState,
    out: &mut [Vec3],
) {
    let s = (m.position[axis.slot()] - start).max(0.0) / reach;
    // turns what points along the axis down
    let about = unit(axis.direction()).cross(&unit(2));
    let arm = about.cross(&lever.at(m));
    for (k, (power, slope)) in [3, 4, 2].into_iter().zip(slopes).enumerate().take(out.len()) {
        out[k] = unit(2) * -s.powi(power) - arm * (slope * s.powi(power - 1) / reach);
    }
}
