//! Spindle and tool.

use crate::extend::tool;
use crate::prelude::*;
use volcomp_model::ToolErrors;

/// What is known of the tilt of the spindle.
pub(crate) static SPINDLE_TILT: Effect = Effect {
    name: "spindle-tilt",
    title: "tilt of the spindle",
    synonyms: "abbe bryan head-tilt",
    kind: Kind::Machine,
    subjects: Subjects::Whole,
    cause: "The spindle is not parallel to its axis.",
    formula: "d = (b L, -a L)",
    looks_like: "A sideways shift proportional to the tool length.",
    confused_with: "the offset of a new setup",
    settles: "Two tool lengths, alternately, in one setup.",
    changes_with: &[Measurement::TwoTools],
    remedy: "tram the spindle head",
    variants: |data, _| of_lengths(data, SpindleTilt {}.into()),
};

/// What is known of wrong tool lengths.
pub(crate) static TOOL_LENGTH: Effect = Effect {
    name: "tool-length",
    title: "tool length error",
    synonyms: "tool-length-scale",
    kind: Kind::Machine,
    subjects: Subjects::Whole,
    cause: "Lengths of tools are measured wrong in proportion.",
    formula: "d_z = c L",
    looks_like: "A shift along the spindle proportional to the tool length.",
    confused_with: "the offset of a new setup",
    settles: "Three tool lengths in one setup.",
    changes_with: &[Measurement::TwoTools],
    remedy: "calibrate the tool setter",
    variants: |data, _| of_lengths(data, ToolLength {}.into()),
};

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

    fn columns(&self) -> Vec<String> {
        plain(&["tool_length_mm"])
    }

    fn drawing(&self) -> Drawing {
        Over::ToolLength.into()
    }

    fn becomes(&self, model: &Extended, entry: &Entry) -> Becomes {
        let tilt = [0, 1].map(|k| entry.value(k) * RAD_PER_ARCSEC);
        tool(model, ToolErrors { tilt, ..ToolErrors::default() })
    }
}

/// `d_z = c L`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ToolLength {}

impl Form for ToolLength {
    fn parameters(&self) -> Vec<String> {
        plain(&["tool_length_ppm"])
    }

    fn evaluate(&self, m: &MachineState, _: &Read<'_>, out: &mut [Vec3]) {
        out[0] = m.head.turns(Vec3::new(0.0, 0.0, -m.tool_length_mm * 1e-3));
    }

    fn columns(&self) -> Vec<String> {
        plain(&["tool_length_mm"])
    }

    fn drawing(&self) -> Drawing {
        Over::ToolLength.into()
    }

    fn becomes(&self, model: &Extended, entry: &Entry) -> Becomes {
        tool(model, ToolErrors { length: entry.value(0) * 1e-6, ..ToolErrors::default() })
    }

    fn acts_along(&self) -> Option<Axis> {
        Some(Axis::Z)
    }
}
