//! What lies between an angular error and the tool.

use serde::{Deserialize, Serialize};

use crate::machine_state::{Axis, MachineState};
use crate::shape::{Span, UM_PER_ARCSEC_MM};
use volcomp_model::ModelSpec;
use volcomp_model::geometry::{Vec3, unit};

/// Step with which a pivot is looked for, mm.
const PIVOT_STEP_MM: f64 = 1000.0;

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
    /// The vector to the tool tip as the head has turned it, mm; the lever of an angular reading.
    #[must_use]
    pub fn at(&self, m: &MachineState) -> Vec3 {
        if m.is_angular() {
            return m.lever_mm;
        }
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

    /// Displacements at the tool by turns about a direction, um for each turn in arcsec.
    pub(crate) fn turn_by(
        &self,
        about: Axis,
        m: &MachineState,
        turns_arcsec: impl IntoIterator<Item = f64>,
        out: &mut [Vec3],
    ) {
        let arm = unit(about.direction()).cross(&self.at(m)) * UM_PER_ARCSEC_MM;
        out.iter_mut().zip(turns_arcsec).for_each(|(o, v)| *o = arm * v);
    }

    /// Moves a coordinate of the pivot by the share of a step by which a factor differs from 1.
    pub(crate) fn move_pivot(&mut self, k: usize, factor: f64) {
        self.home_mm[k] += PIVOT_STEP_MM * (factor - 1.0);
    }

    /// True where the pivot is no further from the zero of the axes than `most` of the longest travel in the data.
    pub(crate) fn is_from_zero(&self, span: &Span<'_>, tip_mm: [f64; 3], most: f64) -> bool {
        let longest = longest(&Axis::LINEAR.map(span));
        (0..3).all(|k| (self.home_mm[k] - tip_mm[k]).abs() <= most * longest)
    }

    /// True where the pivot is no further from where the travels in the data take the tip than `most` of the longest of them.
    pub(crate) fn is_within(&self, span: &Span<'_>, most: f64) -> bool {
        let travels = Axis::LINEAR.map(span);
        let longest = longest(&travels);
        (0..3).all(|k| {
            let [low, high] = if self.axes[k] { travels[k] } else { [0.0; 2] };
            let (nearest, farthest) = (self.home_mm[k] + low, self.home_mm[k] + high);
            nearest <= most * longest && farthest >= -most * longest
        })
    }

    /// The tip of the model's own tool, or what stands for it, at home, mm.
    pub(crate) fn home_at_tip(&self, spec: &ModelSpec) -> Vec3 {
        let mut home = Vec3::from(self.home_mm);
        if let Some(gauge) = spec.gauge_point.filter(|_| self.tool) {
            home.z -= gauge.z - spec.tool_tip.z;
        }
        home
    }

    /// The column of the tool length, where that counts.
    pub(crate) fn columns(&self) -> Option<String> {
        self.tool.then(|| "tool_length_mm".to_owned())
    }
}

fn longest(travels: &[[f64; 2]]) -> f64 {
    travels.iter().map(|[low, high]| high - low).fold(0.0, f64::max)
}
