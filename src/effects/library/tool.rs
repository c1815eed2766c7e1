//! Spindle and tool.

use crate::extend::tool;
use crate::prelude::*;
use volcomp_model::ToolErrors;

/// Variants of `spindle-tilt`.
pub(super) fn spindle_tilt(data: &Data, _: &Subject) -> Variants {
    of_lengths(data, SpindleTilt {}.into())
}

/// Variants of `tool-length`.
pub(super) fn tool_length(data: &Data, _: &Subject) -> Variants {
    of_lengths(data, ToolLength {}.into())
}

fn of_lengths(data: &Data, shape: Shape) -> Variants {
    if data.tools || data.head() && data.lengths {
        return data.structural(vec![shape]);
    }
    Err("one tool length only; measure two in one setup".into())
}

/// `d = (b L, -a L)`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SpindleTilt {}

impl Form for SpindleTilt {
    fn parameters(&self) -> Vec<String> {
        plain(&["tilt_x_arcsec", "tilt_y_arcsec"])
    }

    fn width(&self) -> usize {
        2
    }

    fn evaluate(&self, m: &MachineState, _: &Read<'_>, out: &mut [Vec3]) {
        let l = m.tool_length_mm * UM_PER_ARCSEC_MM;
        out[0] = m.head.turns(Vec3::new(0.0, l, 0.0));
        out[1] = m.head.turns(Vec3::new(-l, 0.0, 0.0));
    }

    fn drawing(&self) -> Drawing {
        Over::ToolLength.into()
    }

    fn becomes(&self, model: &Extended, entry: &Entry) -> Becomes {
        let tilt = [0, 1].map(|k| entry.value(k) * RAD_PER_ARCSEC);
        tool(model, ToolErrors { tilt, ..ToolErrors::default() })
    }
}

/// `d_z = -c L`: a tool that is longer than stated ends lower.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ToolLength {}

impl Form for ToolLength {
    fn parameters(&self) -> Vec<String> {
        plain(&["tool_length_ppm"])
    }

    fn evaluate(&self, m: &MachineState, _: &Read<'_>, out: &mut [Vec3]) {
        out[0] = m.head.turns(Vec3::new(0.0, 0.0, -m.tool_length_mm * 1e-3));
    }

    fn drawing(&self) -> Drawing {
        Over::ToolLength.into()
    }

    fn becomes(&self, model: &Extended, entry: &Entry) -> Becomes {
        tool(model, ToolErrors { length: entry.value(0) * 1e-6, ..ToolErrors::default() })
    }

    fn traits(&self) -> Traits {
        Traits { acts_along: Some(Axis::Z), ..Traits::default() }
    }
}
