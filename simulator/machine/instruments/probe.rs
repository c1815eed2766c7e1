//! A touch probe on an arm that swings about B, touching a round gauge bar in the A axis.
//!
//! The probe goes to a Y, swings until its ball touches the bar, and reads B. Contact is where the true distance of the
//! ball's centre from the true axis of A is the bar's radius plus the ball's.

use volcomp_units::axes::{AxisArray, AxisName, MAX_AXES};
use volcomp_units::{deg_from_rad, mm_from_um};

use super::{InstrumentError, Noise, at_most};
use crate::truth::TruthMachine;

/// Bar and ball.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GaugeBar {
    /// Radius of the bar.
    pub bar_radius_mm: f64,
    /// Effective radius of the ball: what the calibration should find.
    pub ball_radius_mm: f64,
    /// Distance of neighbouring contacts in Y.
    pub spacing_mm: f64,
    /// Whether both sides of the bar (above and below) are touched.
    pub both_sides: bool,
    /// Standard deviation of a contact along its normal.
    pub noise_um: f64,
    /// Seed of the noise.
    pub seed: u64,
}

/// One contact.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Touch {
    /// Programmed Y.
    pub y_mm: f64,
    /// Programmed B.
    pub b_deg: f64,
}

/// The arm as on the drawing, and where the bar should be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Arm {
    /// Distance of the ball's centre from the B axis.
    pub length_mm: f64,
    /// B at which the ball stands level with the B axis.
    pub zero_deg: f64,
    /// Y at which the ball stands over the bar's axis.
    pub bar_y_mm: f64,
    /// Height of the bar's axis over the B axis.
    pub bar_z_mm: f64,
}

/// Contacts stay this far inside the edge of the bar, where swinging would no longer touch.
const INSIDE: f64 = 0.97;

impl Arm {
    /// The arm of a machine with axes A, Y and B.
    /// # Errors
    /// [`InstrumentError::NoLinearAxis`] or [`InstrumentError::Degenerate`] where an axis or the arm is missing.
    pub fn of(machine: &TruthMachine) -> Result<Self, InstrumentError> {
        let point = |axis: AxisName| {
            let k =
                machine.index_of(axis).ok_or(InstrumentError::Degenerate { what: "a probe arm about B" })?;
            let joint =
                machine.drawing(k).ok_or(InstrumentError::Degenerate { what: "a probe arm about B" })?;
            Ok::<[f64; 3], InstrumentError>(joint.point_mm)
        };
        if machine.index_of(AxisName::Y).is_none() {
            return Err(InstrumentError::NoLinearAxis { axis: AxisName::Y });
        }
        let (a, b, tip) = (point(AxisName::A)?, point(AxisName::B)?, machine.tool_tip_mm());
        let (x, z) = (tip[0] - b[0], tip[2] - b[2]);
        let length_mm = x.hypot(z);
        if length_mm < 1.0 {
            return Err(InstrumentError::Degenerate { what: "a probe arm about B" });
        }
        // height of the tip at B: z cos B - x sin B = length sin(B - zero)
        let zero_deg = deg_from_rad((-z).atan2(-x));
        Ok(Self { length_mm, zero_deg, bar_y_mm: a[1] - tip[1], bar_z_mm: a[2] - b[2] })
    }
}

/// Most contacts from the top of the bar to one side.
const CONTACTS_MAX: f64 = 100_000.0;

impl GaugeBar {
    /// Contacts from one side of the bar to the other, above and (where wanted) below.
    /// # Errors
    /// The machine has no such arm, or it does not reach the bar.
    pub fn touches(&self, machine: &TruthMachine) -> Result<Vec<Touch>, InstrumentError> {
        if !(self.spacing_mm.is_finite() && self.spacing_mm > 0.0) {
            let (what, value) = ("spacing", self.spacing_mm);
            return Err(InstrumentError::Plan { what, value, limit: "above 0" });
        }
        let arm = Arm::of(machine)?;
        let reach = self.bar_radius_mm + self.ball_radius_mm;
        at_most(INSIDE * reach / self.spacing_mm, CONTACTS_MAX, "contacts on a side", "enlarge the spacing")?;
        let steps = (INSIDE * reach / self.spacing_mm).floor() as i64;
        let mut noise = Noise::new(self.seed);
        let sides: &[f64] = if self.both_sides { &[1.0, -1.0] } else { &[1.0] };
        let mut touches = Vec::new();
        for side in sides {
            for i in -steps..=steps {
                let y_mm = arm.bar_y_mm + self.spacing_mm * i as f64;
                let far = reach + mm_from_um(noise.draw(self.noise_um));
                touches.push(self.touch(machine, &arm, y_mm, *side, far)?);
            }
        }
        Ok(touches)
    }

    /// Swings B until the ball is `far` from the axis of the bar, by the secant from where the drawing says.
    fn touch(
        &self,
        machine: &TruthMachine,
        arm: &Arm,
        y_mm: f64,
        side: f64,
        far: f64,
    ) -> Result<Touch, InstrumentError> {
        let height = arm.bar_z_mm + side * (far.powi(2) - (y_mm - arm.bar_y_mm).powi(2)).max(0.0).sqrt();
        if height.abs() >= arm.length_mm {
            let limit = "low enough for the arm to reach over the bar";
            return Err(InstrumentError::Plan { what: "height of the contact", value: height, limit });
        }
        let beyond = |b_deg: f64| distance(machine, y_mm, b_deg) - far;
        let mut at = arm.zero_deg + deg_from_rad((height / arm.length_mm).asin());
        let mut before = at + 0.01;
        let (mut now, mut last) = (beyond(at), beyond(before));
        for _ in 0..30 {
            if now.abs() < 1e-12 || now == last {
                break;
            }
            let next = at - now * (at - before) / (now - last);
            (before, last) = (at, now);
            (at, now) = (next, beyond(next));
        }
        if now.abs() > 1e-9 {
            return Err(InstrumentError::Degenerate { what: "a contact with the bar" });
        }
        Ok(Touch { y_mm, b_deg: at })
    }
}

/// True distance of the ball's centre from the true axis of A, which the workpiece frame is tied to.
fn distance(machine: &TruthMachine, y_mm: f64, b_deg: f64) -> f64 {
    let mut q = AxisArray::default();
    for (axis, value) in [(AxisName::Y, y_mm), (AxisName::B, b_deg)] {
        if let Some(k) = machine.index_of(axis) {
            q[k] = value;
        }
    }
    let origin = machine.workpiece_origin_mm();
    let on_axis =
        machine.index_of(AxisName::A).and_then(|k| machine.drawing(k)).map_or([0.0; 3], |j| j.point_mm);
    let tip = machine.pose(&q, &[0; MAX_AXES]).tip_mm;
    (tip[1] + origin[1] - on_axis[1]).hypot(tip[2] + origin[2] - on_axis[2])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::truth::{GRINDER_AB, VMC_850};

    #[test]
    fn contacts_lie_around_the_bar() {
        let machine = TruthMachine::from_toml(GRINDER_AB).unwrap();
        let bar = GaugeBar {
            bar_radius_mm: 15.0,
            ball_radius_mm: 1.4935,
            spacing_mm: 0.5,
            both_sides: true,
            noise_um: 0.0,
            seed: 1,
        };
        let touches = bar.touches(&machine).unwrap();
        assert_eq!(touches.len(), 2 * 63);
        let arm = Arm::of(&machine).unwrap();
        for t in &touches {
            let z = arm.length_mm * (t.b_deg - arm.zero_deg).to_radians().sin();
            let far = (t.y_mm - arm.bar_y_mm).hypot(z - arm.bar_z_mm);
            assert!((far - 16.4935).abs() < 0.06, "{far}: the errors of the machine are below 60 um");
        }
        assert!(Arm::of(&TruthMachine::from_toml(VMC_850).unwrap()).is_err());
        assert!(GaugeBar { spacing_mm: 0.0, ..bar }.touches(&machine).is_err());
    }
}
