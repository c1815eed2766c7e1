//! The machine: a horizontal boring mill `[w B' X' b Y Z t]`. The table B turns on the cross slide X; the headstock climbs
//! the column along Y; the ram comes out along Z with the spindle. Gravity acts along -y.

use nalgebra::{Isometry3, Rotation3, Translation3, UnitQuaternion, Vector3};

/// Its name in the model.
pub const MACHINE: &str = "borer-4ax";
/// Travels of X, Y, Z, mm.
pub const TRAVEL_MM: [[f64; 2]; 3] = [[0.0, 600.0], [0.0, 450.0], [0.0, 400.0]];
/// A point on the axis of the table at home, mm.
pub const TABLE_MM: [f64; 3] = [300.0, 0.0, 80.0];
/// Tool length where nothing else is said, mm.
pub const TOOL_MM: f64 = 120.0;

/// Turn of what the table carries, for a coordinate in rad: the table turns against its coordinate.
pub fn table(b: f64) -> Rotation3<f64> {
    Rotation3::from_axis_angle(&Vector3::y_axis(), -b)
}

/// Coordinates X, Y, Z that bring the tool tip to a point on the table that is at `home` when the machine is at zero.
pub fn reach(home: Vector3<f64>, b: f64, tool_mm: f64) -> [f64; 4] {
    let axis = Vector3::from(TABLE_MM);
    let turned = table(b) * (home - axis) + axis;
    [turned.x, turned.y, turned.z + tool_mm, b]
}

/// Error motion of one body: displacement (mm) and rotation vector (rad).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Twist {
    /// Displacement, mm.
    pub shift: Vector3<f64>,
    /// Rotation, rad.
    pub turn: Vector3<f64>,
}

impl Default for Twist {
    fn default() -> Self {
        Self { shift: Vector3::zeros(), turn: Vector3::zeros() }
    }
}

impl Twist {
    fn frame(&self) -> Isometry3<f64> {
        Isometry3::from_parts(Translation3::from(self.shift), UnitQuaternion::from_scaled_axis(self.turn))
    }
}

/// Where the bodies of the machine really are, beside the command.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Bodies {
    /// Error motions of the carriages X, Y, Z.
    pub carriage: [Twist; 3],
    /// Directions of motion of Y and Z: rotations of the mounted guideways, rad.
    pub mount: [Vector3<f64>; 2],
    /// Location of the table's axis.
    pub axis: Twist,
    /// Error motion of the table.
    pub table: Twist,
    /// Spindle against the ram.
    pub spindle: Twist,
    /// Error of the tool length, mm.
    pub tool_mm: f64,
}

/// Deviation of the tool tip relative to the workpiece, in directions of M, mm: exact transforms, no linearisation.
pub fn deviation(q: [f64; 4], tool_mm: f64, b: &Bodies) -> Vector3<f64> {
    let shift = |v: Vector3<f64>| Isometry3::from_parts(Translation3::from(v), UnitQuaternion::identity());
    let place = |ideal: bool| {
        let none = Bodies::default();
        let e = if ideal { &none } else { b };
        let turn = UnitQuaternion::from_rotation_matrix(&table(q[3]));
        let axis = Vector3::from(TABLE_MM);
        let work = shift(Vector3::new(-q[0], 0.0, 0.0))
            * e.carriage[0].frame()
            * shift(axis)
            * e.axis.frame()
            * e.table.frame()
            * Isometry3::from_parts(Translation3::identity(), turn)
            * shift(-axis);
        let [along_y, along_z] = e.mount.map(Rotation3::from_scaled_axis);
        let tip = shift(along_y * Vector3::new(0.0, q[1], 0.0))
            * e.carriage[1].frame()
            * shift(along_z * Vector3::new(0.0, 0.0, q[2]))
            * e.carriage[2].frame()
            * e.spindle.frame();
        let tip = tip * nalgebra::Point3::new(0.0, 0.0, -tool_mm - e.tool_mm);
        (work.inverse() * tip).coords
    };
    table(q[3]) * (place(false) - place(true))
}

/// The nominal model, `volcomp-model/1`.
pub fn nominal_model() -> String {
    let mut text = format!(
        "# Nominal geometry, no errors.\nformat = \"volcomp-model/1\"\nmachine = \"{MACHINE}\"\nchain = \"[w B' X' b Y Z t]\"\n\n\
         [frame]\nworkpiece-origin-mm = [0, 0, 0]\ntool-tip-mm = [0, 0, {:?}]\ngauge-point-mm = [0, 0, 0]\n",
        -TOOL_MM
    );
    for (letter, [low, high]) in ["x", "y", "z"].into_iter().zip(TRAVEL_MM) {
        text += &format!("\n[axes.{letter}]\ntravel-mm = [{low:?}, {high:?}]\n");
    }
    let [x, y, z] = TABLE_MM;
    text += &format!("\n[axes.b]\ntravel-deg = [-400, 400]\npoint-mm = [{x:?}, {y:?}, {z:?}]\n");
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_tool_reaches_a_ball_on_the_turned_table_and_ideal_bodies_show_nothing() {
        let ball = Vector3::new(410.0, 130.0, 80.0);
        let q = reach(ball, 0.7, 150.0);
        let point = table(0.7) * (ball - Vector3::from(TABLE_MM)) + Vector3::from(TABLE_MM);
        let tip = Vector3::new(0.0, q[1], q[2] - 150.0);
        assert!((point - Vector3::new(q[0], 0.0, 0.0) - tip).norm() < 1e-9);
        assert!(deviation(q, 150.0, &Bodies::default()).norm() < 1e-12);
    }

    #[test]
    fn a_yawing_headstock_turns_ram_and_tool() {
        let mut b = Bodies::default();
        b.carriage[1].turn = Vector3::new(0.0, 1e-5, 0.0);
        let d = deviation([100.0, 50.0, 300.0, 0.0], 100.0, &b);
        assert!((d.x - 1e-5 * 200.0).abs() < 1e-7 && d.y.abs() < 1e-9, "{d}");
    }
}
