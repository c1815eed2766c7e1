//! The machine as it stands in the shop: exact poses at rest, and what happens in a control cycle.
//!
//! Coordinates are programmed coordinates in mm or deg in wire order, which is the order of the `[[axes]]` entries.
//! No clock, no global state: the same file, seed and calls give the same numbers bit for bit.

use volcomp_units::axes::{AxisArray, AxisKind, AxisName, MAX_AXES};
use volcomp_units::{mm_from_um, rad_from_arcsec, rad_from_deg};

use nalgebra::Matrix4;

use super::Sample;
use super::axis_drift::AxisDrift;
use super::chain::Chain;
use super::conditions::Conditions;
use super::drift::RamDrift;
use super::drive::{Drive, DriveSpec};
use super::error::TruthError;
use super::file::{AxisPlan, Plan};
use super::kinematics::{Deviation, Joint, JointState, Kinematics, Pose, Squareness};

/// The default machine, a vertical machining centre: `[w X' Y' b Z t]`.
pub const VMC_850: &str = include_str!("../../machines/vmc-850.toml");
/// A five-axis gantry: `[w b X Y Z C A (S) t]`.
pub const GANTRY_5AX: &str = include_str!("../../machines/gantry-5ax.toml");
/// A gear-grinder-like chain with a rotary table and a swivelling head: `[w A' b X Y B t]`.
pub const GRINDER_AB: &str = include_str!("../../machines/grinder-ab.toml");

/// A machine with errors, drives and encoders.
#[derive(Debug, Clone)]
pub struct TruthMachine {
    plan: Plan,
    drives: Vec<Drive>,
    /// What the ram (the carriage of Z) does beyond its surveyed errors.
    ram: Option<RamDrift>,
    /// What the linear axes do beyond their surveyed errors.
    axis_drift: Option<AxisDrift>,
    /// What happened to the machine since its survey.
    conditions: Option<Conditions>,
    /// Time since the last reset, s.
    time_s: f64,
}

impl TruthMachine {
    /// A machine from the text of a truth file, at rest at home.
    /// # Errors
    /// [`TruthError`] says what in the file is wrong.
    pub fn from_toml(text: &str) -> Result<Self, TruthError> {
        let plan = Plan::read(text)?;
        let mut machine =
            Self { drives: Vec::new(), plan, ram: None, axis_drift: None, conditions: None, time_s: 0.0 };
        machine.reset(machine.plan.seed, &[0.0; MAX_AXES]);
        Ok(machine)
    }

    /// The machine's id.
    #[must_use]
    pub fn machine(&self) -> &str {
        &self.plan.machine
    }

    /// The chain from workpiece to tool.
    #[must_use]
    pub const fn chain(&self) -> &Chain {
        &self.plan.chain
    }

    /// The axes in wire order.
    #[must_use]
    pub fn axes(&self) -> Vec<AxisName> {
        self.plan.axes.iter().map(|axis| axis.name).collect()
    }

    /// Travel of axis `k`, mm or deg; empty (0, 0) for an axis that is not there.
    #[must_use]
    pub fn travel(&self, k: usize) -> [f64; 2] {
        self.plan.axes.get(k).map_or([0.0; 2], |axis| axis.travel)
    }

    /// Wire index of an axis.
    #[must_use]
    pub fn index_of(&self, axis: AxisName) -> Option<usize> {
        self.plan.axes.iter().position(|a| a.name == axis)
    }

    /// The seed of the file.
    #[must_use]
    pub const fn seed(&self) -> u64 {
        self.plan.seed
    }

    /// Origin of the workpiece frame, in the machine frame at home.
    #[must_use]
    pub const fn workpiece_origin_mm(&self) -> [f64; 3] {
        self.plan.kinematics.workpiece_origin_mm
    }

    /// Tool tip, in the machine frame at home.
    #[must_use]
    pub const fn tool_tip_mm(&self) -> [f64; 3] {
        self.plan.kinematics.tool_tip_mm
    }

    /// Changes the tool.
    pub fn set_tool_tip_mm(&mut self, tool_tip_mm: [f64; 3]) {
        self.plan.kinematics.tool_tip_mm = tool_tip_mm;
    }

    /// Geometry of axis `k` as on the drawing (side, point on a rotary axis, reference points), without its errors.
    #[must_use]
    pub fn drawing(&self, k: usize) -> Option<Joint> {
        let joint = self.plan.kinematics.joints.get(self.plan.axes.get(k)?.joint)?;
        Some(Joint { location: [0.0; 6], ..joint.clone() })
    }

    /// The spindle nose in the machine frame at home, from which the length of the tool counts.
    #[must_use]
    pub const fn gauge_point_mm(&self) -> [f64; 3] {
        self.plan.tool.gauge_point_mm
    }

    /// Puts the machine at rest at `start` and restarts its randomness.
    pub fn reset(&mut self, seed: u64, start: &AxisArray) {
        self.time_s = 0.0;
        self.drives = self
            .plan
            .axes
            .iter()
            .zip(start)
            .map(|(axis, start)| Drive::new(axis.drive, seed, axis.name as u64, *start))
            .collect();
    }

    /// One control cycle: the drives follow `drive` (commanded position plus applied offset, mm or deg).
    pub fn step(&mut self, dt_s: f64, drive: &AxisArray) -> Sample {
        self.time_s += dt_s;
        for (axis, set_point) in self.drives.iter_mut().zip(drive) {
            axis.follow(dt_s, *set_point);
        }
        let mut sample = self.sample();
        for (reported, axis) in sample.encoder.iter_mut().zip(&mut self.drives) {
            *reported = axis.read_encoder();
        }
        sample
    }

    /// One control cycle of a recorded motion: the axes stand at `axis` (recorded encoder position plus applied
    /// offset, mm or deg); no servo, and the encoders repeat what was recorded.
    pub fn step_measured(&mut self, dt_s: f64, axis: &AxisArray) -> Sample {
        self.time_s += dt_s;
        for (drive, position) in self.drives.iter_mut().zip(axis) {
            drive.place(dt_s, *position);
        }
        let mut sample = self.sample();
        sample.encoder = sample.axis;
        sample
    }

    /// Lets the ram drift away from its surveyed errors, or not any more.
    pub fn set_ram_drift(&mut self, drift: Option<RamDrift>) {
        self.ram = drift;
    }

    /// Lets the linear axes drift away from their surveyed errors, or not any more.
    pub fn set_axis_drift(&mut self, drift: Option<AxisDrift>) {
        self.axis_drift = drift;
    }

    /// Sets the time since the last reset, s, which drifts depend on.
    pub const fn set_time_s(&mut self, time_s: f64) {
        self.time_s = time_s;
    }

    /// How axis `k` alone moves its tool-side body relative to its workpiece-side body with the axes at `position` (mm or
    /// deg) and this one arrived in `direction`, at the present time: actual, and without errors. Home points to where they
    /// went, in M.
    ///
    /// An instrument between the two bodies of one axis sees this.
    #[must_use]
    pub fn joint_poses(&self, k: usize, position: &AxisArray, direction: i8) -> [Matrix4<f64>; 2] {
        let Some(axis) = self.plan.axes.get(k) else { return [Matrix4::identity(); 2] };
        let q = position[k];
        let slack = f64::from(direction.signum());
        let at = q - slack * axis.drive.backlash / 2.0;
        let mut motion = self.motion_now(k, axis, at, slack);
        if let Some(conditions) = &self.conditions {
            let xyz = [AxisName::X, AxisName::Y, AxisName::Z]
                .map(|name| self.index_of(name).map_or(0.0, |k| position[k]));
            let more = conditions.motion(axis.name, xyz, slack);
            motion.iter_mut().zip(more).for_each(|(own, more)| *own += more);
        }
        let state = JointState { q: internal(axis.name, at), motion };
        let nominal = JointState { q: internal(axis.name, q), motion: [0.0; 6] };
        let joint = &self.plan.kinematics.joints[axis.joint];
        let plain = Joint { point_mm: joint.point_mm, ..Joint::plain(joint.axis, joint.side) };
        [
            joint.transform(&state, self.plan.kinematics.squareness),
            plain.transform(&nominal, Squareness::default()),
        ]
    }

    /// The error motion of axis `k` at the present time, in the sense of its file.
    fn motion_now(&self, k: usize, axis: &AxisPlan, q: f64, slack: f64) -> [f64; 6] {
        let mut sum = motion(axis, q, slack);
        if let Some(drift) = self.axis_drift.as_ref().filter(|_| axis.name.kind() == AxisKind::Linear) {
            let [low, high] = axis.travel;
            let more = drift.motion(k, axis.name.direction(), (q - low) / (high - low), self.time_s);
            sum.iter_mut().zip(more).for_each(|(own, more)| *own += more);
        }
        sum
    }

    /// Sets what happened to the machine since its survey, or restores the machine of its file.
    pub fn set_conditions(&mut self, conditions: Option<Conditions>) {
        self.conditions = conditions;
    }

    /// The exact pose at rest at `q` (mm or deg) after arriving in `direction` (-1, +1; 0: lost motion not taken up).
    #[must_use]
    pub fn pose(&self, q: &AxisArray, direction: &[i8; MAX_AXES]) -> Pose {
        self.pose_of(
            |k, axis| {
                let slack = f64::from(direction[k].signum());
                (q[k] - slack * axis.drive.backlash / 2.0, slack)
            },
            |_| &[0.0; 6],
        )
    }

    /// The pose at `q` of the machine without errors.
    #[must_use]
    pub fn nominal(&self, q: &AxisArray) -> Pose {
        let mut states = [JointState::default(); MAX_AXES];
        for (k, axis) in self.plan.axes.iter().enumerate() {
            states[axis.joint].q = internal(axis.name, q[k]);
        }
        self.plan.kinematics.nominal(&states[..self.plan.kinematics.joints.len()])
    }

    /// The exact pose with the axes at `q` (mm or deg) and `more` (EX EY EZ in mm, EA EB EC in rad, relative sense)
    /// added to the error motions of each, the tool tip at `tool_tip_mm` in the machine frame at home.
    ///
    /// For machines whose bodies do more than their surveyed errors say: they heat up, bend and wind up.
    #[must_use]
    pub fn pose_with(&self, q: &AxisArray, more: &[[f64; 6]; MAX_AXES], tool_tip_mm: [f64; 3]) -> Pose {
        let mut states = [JointState::default(); MAX_AXES];
        for (k, axis) in self.plan.axes.iter().enumerate() {
            let mut sum = motion(axis, q[k], 0.0);
            sum.iter_mut().zip(more[k]).for_each(|(own, more)| *own += more);
            states[axis.joint] = JointState { q: internal(axis.name, q[k]), motion: sum };
        }
        let kinematics = Kinematics { tool_tip_mm, ..self.plan.kinematics.clone() };
        kinematics.pose(&states[..kinematics.joints.len()])
    }

    /// Actual minus nominal pose at rest.
    #[must_use]
    pub fn deviation(&self, q: &AxisArray, direction: &[i8; MAX_AXES]) -> Deviation {
        self.pose(q, direction).minus(&self.nominal(q))
    }

    /// The true error motion of axis `k` at coordinate `q`: EX EY EZ in mm, EA EB EC in rad, in the sense of its file.
    ///
    /// For writing reference answers; instruments do not look here.
    #[must_use]
    pub fn true_motion(&self, k: usize, q: f64, direction: i8) -> [f64; 6] {
        let slack = f64::from(direction.signum());
        self.plan.axes.get(k).map_or([0.0; 6], |axis| self.motion_now(k, axis, q, slack))
    }

    /// The true squareness and, per joint in chain order, the true location errors within the geometry.
    ///
    /// For writing reference answers; instruments do not look here.
    #[must_use]
    pub fn true_geometry(&self) -> (Squareness, &[Joint]) {
        (self.plan.kinematics.squareness, &self.plan.kinematics.joints)
    }

    /// The same machine with ideal drives and encoders: only its geometry is wrong.
    #[must_use]
    pub fn with_ideal_drives(mut self) -> Self {
        for axis in &mut self.plan.axes {
            axis.drive = DriveSpec::IDEAL;
        }
        self.reset(self.plan.seed, &[0.0; MAX_AXES]);
        self
    }

    fn sample(&self) -> Sample {
        let still = [0.0; 6];
        let structure = |k: usize| self.drives.get(k).map_or(&still, Drive::structure_motion);
        let pose = self.pose_of(
            |k, _| {
                let drive = &self.drives[k];
                (drive.carriage(), drive.slack())
            },
            |k| structure(k),
        );
        let mut axis = [0.0; MAX_AXES];
        for (value, drive) in axis.iter_mut().zip(&self.drives) {
            *value = drive.position();
        }
        Sample { axis, encoder: [0.0; MAX_AXES], tip_mm: pose.tip_mm, direction: pose.direction }
    }

    /// The pose with each axis at the carriage coordinate and slack that `place` names, plus the motions of its structure.
    fn pose_of<'a>(
        &self,
        place: impl Fn(usize, &AxisPlan) -> (f64, f64),
        structure: impl Fn(usize) -> &'a [f64; 6],
    ) -> Pose {
        let kinematics: &Kinematics = &self.plan.kinematics;
        let mut states = [JointState::default(); MAX_AXES];
        for (k, axis) in self.plan.axes.iter().enumerate() {
            let (q, slack) = place(k, axis);
            let mut sum = self.motion_now(k, axis, q, slack);
            sum.iter_mut().zip(structure(k)).for_each(|(own, more)| *own += more);
            states[axis.joint] = JointState { q: internal(axis.name, q), motion: sum };
        }
        if let Some(conditions) = &self.conditions {
            let at = [AxisName::X, AxisName::Y, AxisName::Z]
                .map(|name| self.index_of(name).map_or(0.0, |k| states[self.plan.axes[k].joint].q));
            for (k, axis) in self.plan.axes.iter().enumerate() {
                let more = conditions.motion(axis.name, at, place(k, axis).1);
                states[axis.joint].motion.iter_mut().zip(more).for_each(|(own, more)| *own += more);
            }
        }
        if let (Some(ram), Some(z)) = (&self.ram, self.index_of(AxisName::Z)) {
            let at = |name| self.index_of(name).map_or(0.0, |k| states[self.plan.axes[k].joint].q);
            let extra = ram.motion([AxisName::X, AxisName::Y, AxisName::Z].map(at), self.time_s);
            let motion = &mut states[self.plan.axes[z].joint].motion;
            motion.iter_mut().zip(extra).for_each(|(own, more)| *own += more);
        }
        kinematics
            .pose_with_tip(&states[..kinematics.joints.len()], self.plan.tool.tip_mm(kinematics.tool_tip_mm))
    }
}

fn motion(axis: &AxisPlan, q: f64, slack: f64) -> [f64; 6] {
    let [x, y, z, a, b, c] =
        axis.curves.each_ref().map(|curve| curve.value(axis.curve_sign * q, axis.curve_sign * slack));
    [mm_from_um(x), mm_from_um(y), mm_from_um(z), rad_from_arcsec(a), rad_from_arcsec(b), rad_from_arcsec(c)]
}

/// mm stay mm, degrees become radians.
fn internal(axis: AxisName, q: f64) -> f64 {
    match axis.kind() {
        AxisKind::Linear => q,
        AxisKind::Rotary => rad_from_deg(q),
    }
}
