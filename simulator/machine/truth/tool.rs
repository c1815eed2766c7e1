//! The tool as it really is: longer than the presetter says, and leaning with the spindle.

use nalgebra::Vector3;

use super::transform::{rotation_part, rotation_zyx};

/// What is wrong with spindle and presetter.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ToolTruth {
    /// The spindle nose in the machine frame at home.
    pub gauge_point_mm: [f64; 3],
    /// Relative error of the length of every tool: positive is longer.
    pub length_error: f64,
    /// Lean of the spindle about x and y, rad.
    pub lean_rad: [f64; 2],
}

impl ToolTruth {
    /// Where a tool whose tip ought to be at `nominal_mm` really ends.
    #[must_use]
    pub fn tip_mm(&self, nominal_mm: [f64; 3]) -> [f64; 3] {
        if *self == (Self { gauge_point_mm: self.gauge_point_mm, ..Self::default() }) {
            return nominal_mm;
        }
        let nose = Vector3::from(self.gauge_point_mm);
        let tool = (Vector3::from(nominal_mm) - nose) * (1.0 + self.length_error);
        let [a, b] = self.lean_rad;
        (nose + rotation_part(&rotation_zyx([a, b, 0.0])) * tool).into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_longer_tool_reaches_further_and_a_leaning_one_aside() {
        let long = ToolTruth { length_error: 1e-3, ..ToolTruth::default() };
        assert_eq!(long.tip_mm([0.0, 0.0, -100.0]), [0.0, 0.0, -100.0 * 1.001]);
        let lean = ToolTruth { lean_rad: [1e-4, 0.0], ..ToolTruth::default() };
        let [x, y, _] = lean.tip_mm([0.0, 0.0, -100.0]);
        // a turn about plus x takes minus z to plus y
        assert!(x.abs() < 1e-12 && (y - 0.01).abs() < 1e-8, "{x} {y}");
    }
}
