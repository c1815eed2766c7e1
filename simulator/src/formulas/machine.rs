//! The machine: `[w C' A' b X Y Z t]`, a table C on a swivel A, and three linear axes that carry the tool.

use std::fmt::Write;

use nalgebra::{Rotation3, Vector3};

/// Its name.
pub const MACHINE: &str = "trunnion-5ax";
/// Travels of X, Y, Z, mm.
pub const TRAVEL_MM: [[f64; 2]; 3] = [[-300.0, 380.0], [-240.0, 300.0], [-20.0, 460.0]];
/// Spindle nose at home, mm.
pub const NOSE_MM: [f64; 3] = [0.0, 0.0, 120.0];
/// The tool that is in the spindle where nothing else is said, mm.
pub const TOOL_MM: f64 = 130.0;
/// A point on the swivel A at home, mm.
pub const SWIVEL_MM: [f64; 3] = [0.0, 25.0, 60.0];
/// A point on the table's axis C at home, mm.
pub const TABLE_MM: [f64; 3] = [30.0, 40.0, 0.0];

/// Length of the travel of an axis, mm.
#[must_use]
pub fn span(axis: usize) -> f64 {
    TRAVEL_MM.get(axis).map_or(1.0, |[low, high]| high - low)
}

/// Turn of what the swivel carries, for a coordinate in rad: a table turns against its coordinate.
#[must_use]
pub fn swivel(a: f64) -> Rotation3<f64> {
    Rotation3::from_axis_angle(&Vector3::x_axis(), -a)
}

/// Turn of what the table carries, before the swivel turns it.
#[must_use]
pub fn table(c: f64) -> Rotation3<f64> {
    Rotation3::from_axis_angle(&Vector3::z_axis(), -c)
}

/// Where a point on the table stands that is at `home` when both coordinates (rad) are zero, mm.
#[must_use]
pub fn on_table([a, c]: [f64; 2], home: Vector3<f64>) -> Vector3<f64> {
    let (pa, pc) = (Vector3::from(SWIVEL_MM), Vector3::from(TABLE_MM));
    swivel(a) * (table(c) * (home - pc) + pc - pa) + pa
}

/// Coordinates of X, Y, Z that bring the tip of a tool to a point, mm.
#[must_use]
pub fn reach(point: Vector3<f64>, tool_mm: f64) -> [f64; 3] {
    (point - Vector3::from(NOSE_MM) + Vector3::new(0.0, 0.0, tool_mm)).into()
}

/// From where the carriage of a linear axis turns to the tool tip, mm: all that lies between it and the tool.
#[must_use]
pub fn lever(axis: usize, position: [f64; 3], tool_mm: f64) -> Vector3<f64> {
    let mut arm = Vector3::from(NOSE_MM) - Vector3::new(0.0, 0.0, tool_mm);
    for (beyond, q) in position.into_iter().enumerate().skip(axis + 1) {
        arm[beyond] += q;
    }
    arm
}

/// The nominal model, `volcomp-model/1`: no errors.
#[must_use]
pub fn nominal_model() -> String {
    let [nx, ny, nz] = NOSE_MM;
    let mut text = format!(
        "# The drawing of the machine: no errors.\nformat = \"volcomp-model/1\"\nmachine = \"{MACHINE}\"\n\
         chain = \"[w C' A' b X Y Z t]\"\n\n[frame]\nworkpiece-origin-mm = [0, 0, 0]\n\
         tool-tip-mm = [{nx:?}, {ny:?}, {:?}]\ngauge-point-mm = [{nx:?}, {ny:?}, {nz:?}]\n",
        nz - TOOL_MM
    );
    for (letter, [low, high]) in ["x", "y", "z"].into_iter().zip(TRAVEL_MM) {
        // writing to a String cannot fail
        let _ = write!(text, "\n[axes.{letter}]\ntravel-mm = [{low:?}, {high:?}]\n");
    }
    for (letter, [low, high], [x, y, z]) in
        [("a", [-110.0, 40.0], SWIVEL_MM), ("c", [-360.0, 360.0], TABLE_MM)]
    {
        let _ = write!(
            text,
            "\n[axes.{letter}]\ntravel-deg = [{low:?}, {high:?}]\npoint-mm = [{x:?}, {y:?}, {z:?}]\n"
        );
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_tool_follows_a_ball_on_the_table() {
        let home = Vector3::new(115.0, 40.0, 130.0);
        assert!((on_table([0.0, 0.0], home) - home).norm() < 1e-12);
        // at 90 deg of C the ball stands where -90 deg of rotation bring it
        let turned = on_table([0.0, std::f64::consts::FRAC_PI_2], home);
        assert!((turned - Vector3::new(30.0, -45.0, 130.0)).norm() < 1e-9, "{turned}");
        let [x, y, z] = reach(home, TOOL_MM);
        assert!((Vector3::new(x, y, z) + lever(3, [x, y, z], TOOL_MM) - home).norm() < 1e-12);
    }
}
