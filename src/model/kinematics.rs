//! First-order deviation of the tool tip and tool direction for any serial chain.
//!
//! The product of all joint transforms in string order, linearised in the errors; rotations by the axis
//! coordinates themselves stay exact.
//!
//! `e     = SUM G_k [E_k + eps_k x (v_k - r_k)] + SUM_lin q_k G_k (s_k x u_k) + SUM_rot (+-) G_k [l_k + Lam_k x (v_k - P_k)]`
//! `theta = SUM G_k eps_k + SUM_rot (+-) G_k Lam_k`                      (+ tool side, - workpiece side)
//!
//! Source: equations 2 (general chain), 1.4 to 1.9 for the terms.

use super::chain_notation::ChainAxis;
use super::compiled_basis::{CompiledBasis, Lanes};
use super::curve::Grid;
use super::dynamics::{AxisMotion, DYNAMIC_MAX};
use super::spec::{ReferencePoint, SENSORS_MAX, Sense};
use crate::prelude::*;

/// Share of the shortest wave by which a position may be off without any fading (the weight would be above 0.995).
const FREE_SPREAD: f64 = 1.0 / 64.0;

/// Where the machine stands: one entry per axis in chain order, mm and rad.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// Programmed coordinates.
    pub position: AxisArray,
    /// Direction of travel of each axis.
    pub travel: [Travel; MAX_AXES],
    /// Tool tip in M at home, mm, where it replaces that of the model.
    pub tool_tip: Option<Vec3>,
    /// Values of the sensors in the order of [`Model::sensors`], mm or rad; zero where there is none.
    pub live: [f64; SENSORS_MAX],
    /// Signals of the dynamic terms in the order of [`Model::dynamics`]; where there are none, those of an axis at rest after
    /// long travel in its direction.
    pub dynamic: Option<[f64; DYNAMIC_MAX]>,
    /// Distance by which each position may be off, mm or rad: harmonics too short for it fade. Zero: all in full.
    pub spread: AxisArray,
    /// Bit k: axis k is never offset; what it would correct is left to the others, or stays.
    pub fixed: u16,
}

impl Pose {
    /// A pose at the given coordinates, travelling forward, with the tool of the model.
    #[must_use]
    pub fn at(position: AxisArray) -> Self {
        Self {
            position,
            travel: [Travel::Forward; MAX_AXES],
            tool_tip: None,
            live: [0.0; SENSORS_MAX],
            dynamic: None,
            spread: [0.0; MAX_AXES],
            fixed: 0,
        }
    }

    /// True where axis `index` is never offset.
    pub(crate) const fn is_fixed(&self, index: usize) -> bool {
        self.fixed >> index & 1 == 1
    }
}

/// What is to be said about a point beside its numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct PointFlags {
    /// Bit k: axis k of the chain is outside its travel; the errors at its end are held.
    pub out_of_travel: u16,
    /// Bit k: axis k is outside the range of one of its curves; the end value is held.
    pub out_of_range: u16,
    /// Bit k: harmonics of axis k have faded because its position may be off by too much ([`Pose::spread`]).
    pub faded: u16,
}

impl PointFlags {
    /// True where the curves were evaluated inside their ranges.
    #[must_use]
    pub const fn is_clear(self) -> bool {
        self.out_of_travel == 0 && self.out_of_range == 0
    }
}

/// Actual minus nominal position and orientation of the tool relative to the workpiece, in W.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Deviation {
    /// Position error of the tool tip, mm.
    pub position: Vec3,
    /// Rotation vector of `R_act R_nom^T`, rad.
    pub rotation: Vec3,
    /// What held where.
    pub flags: PointFlags,
}

/// A model compiled for the cycle: no look-up by name, nothing allocated when evaluated.
#[derive(Debug, Clone)]
pub struct Model {
    pub(super) joints: Vec<Joint>,
    /// True where an axis turns.
    pub(super) rotary: bool,
    machine: String,
    workpiece_origin: Vec3,
    tool_tip: Vec3,
    gauge_point: Option<Vec3>,
    sensors: Vec<String>,
    dynamics: Vec<AxisTerm>,
    tool: Option<ToolErrors>,
    /// Deviation at the workpiece datum, first order and exact; zero without one.
    datum: [Vec3; 2],
}

/// One axis with everything that belongs to it.
#[derive(Debug, Clone)]
pub(super) struct Joint {
    pub(super) axis: ChainAxis,
    /// Direction of a linear axis, rotation axis of a rotary one.
    pub(super) direction: Vec3,
    pub(super) travel: Option<[f64; 2]>,
    /// A point on the axis (rotary).
    pub(super) point: Vec3,
    /// Largest correction (rotary), rad.
    pub(super) correction_limit: f64,
    /// True where the stored curves are carriage motions of a primed axis and change sign.
    pub(super) inverted: bool,
    /// EX EY EZ EA EB EC over the stored coordinate.
    pub(super) motions: CompiledBasis,
    /// Wavelength of the shortest harmonic among them, mm or rad.
    shortest_wave: f64,
    /// Parts of them that depend on other axes, too.
    grids: Vec<JointGrid>,
    /// Parts of them that sensors tell.
    live: Vec<JointLive>,
    /// Parts of them that follow the motion of the axis.
    dynamics: Vec<JointDynamic>,
    pub(super) reference_points: [ReferencePoint; 3],
    /// Rotation of the line of motion (linear).
    pub(super) squareness: Vec3,
    /// Sideways motion per unit of travel that follows from it, `s x u`.
    line_tilt: Vec3,
    /// True where a reference point stays with the bed, so that it moves in carriage coordinates.
    bed_reference: bool,
    /// XO. YO. ZO. (rotary), mm.
    pub(super) location_shift: Vec3,
    /// AO. BO. CO. (rotary), rad.
    pub(super) location_turn: Vec3,
}

/// A grid that adds to one motion of a joint.
#[derive(Debug, Clone)]
struct JointGrid {
    /// Position in EX EY EZ EA EB EC.
    lane: usize,
    grid: Grid,
    /// Chain index of each axis of the grid.
    axes: [usize; 3],
}

/// A sensor value that adds to one motion of a joint.
#[derive(Debug, Clone, Copy)]
struct JointLive {
    lane: usize,
    channel: usize,
    limit: f64,
    reference: Option<f64>,
}

/// A dynamic term of a model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisTerm {
    /// Index of its axis in the chain.
    pub axis: usize,
    /// The error motion that it is part of.
    pub component: Component,
    /// The term.
    pub term: DynamicTerm,
}

/// A dynamic term that adds to one motion of a joint.
#[derive(Debug, Clone, Copy)]
struct JointDynamic {
    lane: usize,
    /// Index in [`Model::dynamics`].
    channel: usize,
    term: DynamicTerm,
}

/// Where the tool nominally is, in W.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NominalTool {
    /// Tool tip, mm.
    pub tip: Vec3,
    /// Unit vector along the tool, from the tip to the spindle.
    pub direction: Vec3,
    /// Rotation from machine axes with all axes at zero to W, for what rides on the tool.
    pub rotation: Mat3,
    /// Rotation from machine axes M to W, for what stands on the bed.
    pub bed: Mat3,
}

/// Nominal geometry of a chain at a pose; index k stands left of joint k, index n behind the last.
pub(super) struct Nominal {
    /// Tool tip in the home-frame coordinates left of joint k.
    pub(super) tip: [Vec3; MAX_AXES + 1],
    /// Own rotation of joint k; identity for linear axes.
    pub(super) turn: [Mat3; MAX_AXES],
    /// Rotation from the home frame left of joint k to W.
    pub(super) left: [Mat3; MAX_AXES + 1],
}

/// The six error motions of a joint at a pose, in the sense in which they were stored.
#[derive(Debug, Clone, Copy)]
pub(super) struct MotionValues {
    pub(super) shift: Vec3,
    pub(super) turn: Vec3,
}

impl Model {
    /// Compiles a model.
    ///
    /// # Errors
    /// A rule of [`ModelSpec::validate`] is broken.
    pub fn new(spec: &ModelSpec) -> Result<Self, ModelError> {
        spec.validate()?;
        let mut sensors: Vec<String> = Vec::new();
        for live in spec.errors.iter().flat_map(|(_, f)| &f.live) {
            if !sensors.contains(&live.sensor) {
                sensors.push(live.sensor.clone());
            }
        }
        let mut dynamics = Vec::new();
        let joints: Vec<Joint> =
            spec.chain.axes().iter().map(|axis| Joint::new(*axis, spec, &sensors, &mut dynamics)).collect();
        let mut model = Self {
            rotary: joints.iter().any(|j| j.axis.kind() == AxisKind::Rotary),
            joints,
            machine: spec.machine.clone(),
            workpiece_origin: spec.workpiece_origin,
            tool_tip: spec.tool_tip,
            gauge_point: spec.gauge_point,
            sensors,
            dynamics,
            tool: (!spec.tool.is_zero()).then_some(spec.tool),
            datum: [Vec3::zeros(); 2],
        };
        if !spec.datum.is_empty() {
            let at = model.pose_of(&spec.datum);
            model.datum = [model.deviation(&at).position, model.deviation_exact(&at).position];
        }
        Ok(model)
    }

    /// The pose at named coordinates (mm and rad); axes that are not named stand at 0.
    #[must_use]
    pub fn pose_of(&self, coordinates: &[(AxisName, f64)]) -> Pose {
        let mut position = [0.0; MAX_AXES];
        for (k, axis) in self.axes().enumerate() {
            position[k] = coordinates.iter().find(|(name, _)| *name == axis.name).map_or(0.0, |(_, at)| *at);
        }
        Pose::at(position)
    }

    /// The sensors whose live values the model uses; [`Pose::live`] is indexed alike.
    #[must_use]
    pub fn sensors(&self) -> &[String] {
        &self.sensors
    }

    /// The terms that follow the motion of an axis; [`Pose::dynamic`] is indexed alike.
    #[must_use]
    pub fn dynamics(&self) -> &[AxisTerm] {
        &self.dynamics
    }

    /// True where some term returns to zero when its axis comes to rest.
    #[must_use]
    pub fn has_transients(&self) -> bool {
        self.dynamics.iter().any(|d| d.term.law.is_transient())
    }

    /// Shift of the tool tip and turn of the tool by the errors of tool and spindle, in M at home.
    pub(super) fn tool_error(&self, pose: &Pose) -> Option<(Vec3, Vec3)> {
        let (errors, gauge) = (self.tool?, self.gauge_point?);
        let tool = pose.tool_tip.unwrap_or(self.tool_tip) - gauge;
        let turn = Vec3::new(errors.tilt[0], errors.tilt[1], 0.0);
        Some((turn.cross(&tool) + tool * errors.length, turn))
    }

    /// Deviation at the workpiece datum with full rotations.
    pub(super) const fn datum_exact(&self) -> &Vec3 {
        &self.datum[1]
    }

    /// The machine to which the model belongs.
    #[must_use]
    pub fn machine(&self) -> &str {
        &self.machine
    }

    /// The axes in chain order; positions and corrections are indexed alike.
    pub fn axes(&self) -> impl ExactSizeIterator<Item = ChainAxis> + '_ {
        self.joints.iter().map(|j| j.axis)
    }

    /// Travel of axis `index`, mm or rad, where given.
    #[must_use]
    pub fn travel(&self, index: usize) -> Option<[f64; 2]> {
        self.joints.get(index).and_then(|j| j.travel)
    }

    /// Tool tip of the model in M at home, mm.
    #[must_use]
    pub const fn tool_tip(&self) -> Vec3 {
        self.tool_tip
    }

    /// Origin of the workpiece frame in M at home, mm.
    #[must_use]
    pub const fn workpiece_origin(&self) -> Vec3 {
        self.workpiece_origin
    }

    /// The tool tip for a tool of `length_mm` along z, where the model has a gauge point.
    #[must_use]
    pub fn tool_tip_for_length(&self, length_mm: f64) -> Option<Vec3> {
        self.gauge_point.map(|g| g - Vec3::new(0.0, 0.0, length_mm))
    }

    /// Deviation of the tool at `pose`, first order in the errors.
    ///
    /// # Source  equations 2
    /// # Cycle   no allocation
    #[must_use]
    pub fn deviation(&self, pose: &Pose) -> Deviation {
        if self.rotary {
            self.deviation_at(&self.nominal(pose), pose)
        } else {
            self.deviation_without_rotation(pose)
        }
    }

    /// The same sum where no axis turns: every `G` is the identity.
    pub(super) fn deviation_without_rotation(&self, pose: &Pose) -> Deviation {
        let mut tip = pose.tool_tip.unwrap_or(self.tool_tip);
        let mut position = Vec3::zeros();
        let mut rotation = Vec3::zeros();
        let mut flags = PointFlags::default();
        for (k, joint) in self.joints.iter().enumerate().rev() {
            let q = pose.position[k];
            let right = tip;
            tip += joint.direction * q;
            let v = if joint.axis.side == Side::Tool { &right } else { &tip };
            let (shift, turn) = joint.linear_error(k, pose, v, &mut flags);
            position += shift;
            rotation += turn;
        }
        if let Some((shift, turn)) = self.tool_error(pose) {
            position += shift;
            rotation += turn;
        }
        Deviation { position: position - self.datum[0], rotation, flags }
    }

    /// Where the tool nominally is at `pose`.
    #[must_use]
    pub fn nominal_tool(&self, pose: &Pose) -> NominalTool {
        let nominal = self.nominal(pose);
        let rotation = nominal.left[self.joints.len()];
        let workpiece_side = self.joints.iter().filter(|j| j.axis.side == Side::Workpiece).count();
        NominalTool {
            tip: nominal.tip[0] - self.workpiece_origin,
            direction: rotation * unit(2),
            rotation,
            bed: nominal.left[workpiece_side],
        }
    }

    /// The nominal geometry of the chain at `pose`.
    pub(super) fn nominal(&self, pose: &Pose) -> Nominal {
        let n = self.joints.len();
        let mut nominal = Nominal {
            tip: [Vec3::zeros(); MAX_AXES + 1],
            turn: [Mat3::identity(); MAX_AXES],
            left: [Mat3::identity(); MAX_AXES + 1],
        };
        nominal.tip[n] = pose.tool_tip.unwrap_or(self.tool_tip);
        for (k, joint) in self.joints.iter().enumerate().rev() {
            let q = pose.position[k];
            let direction = joint.axis.name.direction();
            nominal.tip[k] = nominal.tip[k + 1];
            match joint.axis.kind() {
                AxisKind::Linear => nominal.tip[k][direction] += q,
                AxisKind::Rotary => {
                    nominal.turn[k] = rotation_about(direction, q);
                    nominal.tip[k] = joint.point + nominal.turn[k] * (nominal.tip[k + 1] - joint.point);
                }
            }
        }
        for (k, joint) in self.joints.iter().enumerate() {
            nominal.left[k + 1] = match joint.axis.kind() {
                AxisKind::Linear => nominal.left[k],
                AxisKind::Rotary => nominal.left[k] * nominal.turn[k],
            };
        }
        nominal
    }

    /// The sum of equations 2 over the joints.
    pub(super) fn deviation_at(&self, nominal: &Nominal, pose: &Pose) -> Deviation {
        let mut position = Vec3::zeros();
        let mut rotation = Vec3::zeros();
        let mut flags = PointFlags::default();
        for (k, joint) in self.joints.iter().enumerate() {
            let (left, right) = (&nominal.left[k], &nominal.left[k + 1]);
            // linear: the error sits with the carriage; rotary: with the stator
            let (g, (shift, turn)) = match (joint.axis.kind(), joint.axis.side) {
                (AxisKind::Linear, Side::Tool) => {
                    (left, joint.linear_error(k, pose, &nominal.tip[k + 1], &mut flags))
                }
                (AxisKind::Linear, Side::Workpiece) => {
                    (left, joint.linear_error(k, pose, &nominal.tip[k], &mut flags))
                }
                (AxisKind::Rotary, Side::Tool) => {
                    (left, joint.rotary_error(k, pose, &nominal.tip[k], &mut flags))
                }
                (AxisKind::Rotary, Side::Workpiece) => {
                    (right, joint.rotary_error(k, pose, &nominal.tip[k + 1], &mut flags))
                }
            };
            position += g * shift;
            rotation += g * turn;
        }
        if let Some((shift, turn)) = self.tool_error(pose) {
            let g = &nominal.left[self.joints.len()];
            position += g * shift;
            rotation += g * turn;
        }
        Deviation { position: position - self.datum[0], rotation, flags }
    }
}

impl Joint {
    /// True for X, Y and Z, which bring the tool tip back.
    pub(super) const fn moves_tip(&self) -> bool {
        matches!(self.axis.name, AxisName::X | AxisName::Y | AxisName::Z)
    }

    fn new(axis: ChainAxis, spec: &ModelSpec, sensors: &[String], dynamics: &mut Vec<AxisTerm>) -> Self {
        let entry = spec.axis(axis.name);
        let function = |wanted: ErrorSymbol| spec.error(wanted).cloned().unwrap_or_default();
        let constant = |wanted: ErrorSymbol| function(wanted).value(0.0, Travel::Forward);
        let name = axis.name;
        let motions = Component::ALL.map(|component| function(ErrorSymbol::Motion { component, axis: name }));
        let basis = CompiledBasis::new(&motions);
        let [sx, sy, sz] = [Component::X, Component::Y, Component::Z]
            .map(|component| constant(ErrorSymbol::Location { component, axis: name }));
        let turn = [Component::A, Component::B, Component::C];
        let [ta, tb, tc] = turn.map(|component| constant(ErrorSymbol::Location { component, axis: name }));
        let [qa, qb, qc] = turn.map(|component| constant(ErrorSymbol::Squareness { component, axis: name }));
        Self {
            axis,
            direction: unit(axis.name.direction()),
            travel: entry.travel,
            point: entry.point,
            correction_limit: entry.correction_limit,
            inverted: entry.sense == Sense::Carriage && axis.side == Side::Workpiece,
            grids: joint_grids(&motions, spec),
            live: joint_live(&motions, sensors),
            dynamics: joint_dynamics(&motions, spec.chain.index_of(name).unwrap_or_default(), dynamics),
            shortest_wave: basis.shortest_wave(),
            motions: basis,
            reference_points: match axis.kind() {
                AxisKind::Linear => entry.reference_points,
                // ISO 230-7: the errors of a rotary axis act at the point on its axis
                AxisKind::Rotary => [ReferencePoint { point: entry.point, body: ReferenceBody::Carriage }; 3],
            },
            squareness: Vec3::new(qa, qb, qc),
            line_tilt: Vec3::new(qa, qb, qc).cross(&unit(axis.name.direction())),
            bed_reference: entry.reference_points.iter().any(|r| r.body == ReferenceBody::Bed),
            location_shift: Vec3::new(sx, sy, sz),
            location_turn: Vec3::new(ta, tb, tc),
        }
    }

    /// Displacement of home-frame point `v` and turn by the errors of a linear axis at `q`.
    #[inline(always)]
    fn linear_error(&self, index: usize, pose: &Pose, v: &Vec3, flags: &mut PointFlags) -> (Vec3, Vec3) {
        let values = self.motions_at(index, pose, flags);
        let sign = if self.inverted { -1.0 } else { 1.0 };
        let q = pose.position[index];
        let shift = values.displacement(v, &self.reference_points_at(q)) * sign + self.line_tilt * q;
        (shift, values.turn * sign)
    }

    /// Displacement of home-frame point `v` and turn by the errors of a rotary axis at `q`.
    fn rotary_error(&self, index: usize, pose: &Pose, v: &Vec3, flags: &mut PointFlags) -> (Vec3, Vec3) {
        let values = self.motions_at(index, pose, flags);
        let sign = if self.inverted { -1.0 } else { 1.0 };
        let location_sign = if self.axis.side == Side::Tool { 1.0 } else { -1.0 };
        let location = self.location_shift + self.location_turn.cross(&(v - self.point));
        let reference = self.reference_points_at(pose.position[index]);
        let shift = values.displacement(v, &reference) * sign + location * location_sign;
        (shift, values.turn * sign + self.location_turn * location_sign)
    }

    /// The stored error motions at coordinate `q`; outside travel or range the end value is held and flagged.
    #[inline(always)]
    pub(super) fn motions_at(&self, index: usize, pose: &Pose, flags: &mut PointFlags) -> MotionValues {
        let (q, travel) = (pose.position[index], pose.travel[index]);
        let mut at = q;
        if let Some([low, high]) = self.travel
            && !(low..=high).contains(&q)
        {
            flags.out_of_travel |= 1 << index;
            at = q.clamp(low, high);
        }
        // the carriage of a primed axis moves by -q, and the other way round
        let (x, travel) = if self.inverted { (-at, travel.reversed()) } else { (at, travel) };
        if self.motions.is_outside(x) {
            flags.out_of_range |= 1 << index;
        }
        // without a margin every motion would leave the short way through the series
        let spread = (pose.spread[index] - FREE_SPREAD * self.shortest_wave).max(0.0);
        if spread > 0.0 {
            flags.faded |= 1 << index;
        }
        let mut v = self.motions.values(x, travel, spread);
        if !(self.grids.is_empty() && self.live.is_empty() && self.dynamics.is_empty()) {
            self.add_grids_and_live(&mut v, index, x, pose, flags);
        }
        let [ex, ey, ez, ea, eb, ec] = v.to_array();
        MotionValues { shift: Vec3::new(ex, ey, ez), turn: Vec3::new(ea, eb, ec) }
    }

    /// What depends on other axes, on sensors or on motion; apart, so that the usual case stays in registers.
    #[inline(never)]
    fn add_grids_and_live(&self, v: &mut Lanes, index: usize, x: f64, pose: &Pose, flags: &mut PointFlags) {
        for g in &self.grids {
            let coordinates = g.axes.map(|k| if k == index { x } else { pose.position[k] });
            let (value, outside) = g.grid.value(&coordinates);
            v.add_to_lane(g.lane, value);
            flags.out_of_range |= u16::from(outside) << index;
        }
        if self.live.is_empty() && self.dynamics.is_empty() {
            return;
        }
        let mut sum = v.to_array();
        // signals are odd in the direction of motion, and the carriage of a primed axis goes the other way
        let sign = if self.inverted { -1.0 } else { 1.0 };
        for d in &self.dynamics {
            let signal = match &pose.dynamic {
                Some(signals) => signals[d.channel],
                None => d.term.law.signal(&AxisMotion::after(pose.travel[index])),
            };
            sum[d.lane] += d.term.value(x, sign * signal);
        }
        for l in &self.live {
            let told = pose.live[l.channel] * l.reference.map_or(1.0, |at| x - at);
            // a sensor that tells nonsense tells nothing
            sum[l.lane] += if told.is_finite() { told.clamp(-l.limit, l.limit) } else { 0.0 };
        }
        *v = sum.into();
    }

    /// Reference points of the three linear components at coordinate `q`, in home-frame coordinates (equations 1.5).
    pub(super) fn reference_points_at(&self, q: f64) -> [Vec3; 3] {
        if !self.bed_reference {
            return self.reference_points.map(|r| r.point);
        }
        let sigma = match self.axis.side {
            Side::Workpiece => 1.0,
            Side::Tool => -1.0,
        };
        self.reference_points.map(|r| match r.body {
            ReferenceBody::Carriage => r.point,
            ReferenceBody::Bed => r.point + unit(self.axis.name.direction()) * (sigma * q),
        })
    }
}

fn joint_grids(motions: &[ErrorFunction; 6], spec: &ModelSpec) -> Vec<JointGrid> {
    let mut out = Vec::new();
    for (lane, function) in motions.iter().enumerate() {
        for grid in &function.grids {
            let mut axes = [0; 3];
            for (slot, name) in axes.iter_mut().zip(grid.axes()) {
                // every axis of a grid is in the chain: the specification was validated
                *slot = spec.chain.index_of(name).unwrap_or_default();
            }
            out.push(JointGrid { lane, grid: grid.clone(), axes });
        }
    }
    out
}

fn joint_live(motions: &[ErrorFunction; 6], sensors: &[String]) -> Vec<JointLive> {
    let mut out = Vec::new();
    for (lane, function) in motions.iter().enumerate() {
        for live in &function.live {
            // every sensor was listed from these very functions
            let channel = sensors.iter().position(|s| *s == live.sensor).unwrap_or_default();
            out.push(JointLive { lane, channel, limit: live.limit.abs(), reference: live.reference });
        }
    }
    out
}

fn joint_dynamics(motions: &[ErrorFunction; 6], axis: usize, all: &mut Vec<AxisTerm>) -> Vec<JointDynamic> {
    let mut out = Vec::new();
    for (lane, (function, component)) in motions.iter().zip(Component::ALL).enumerate() {
        for term in &function.dynamics {
            out.push(JointDynamic { lane, channel: all.len(), term: *term });
            all.push(AxisTerm { axis, component, term: *term });
        }
    }
    out
}

impl MotionValues {
    /// `E_i + [eps x (v - r_i)]_i`, component by component.
    #[inline(always)]
    fn displacement(&self, v: &Vec3, [rx, ry, rz]: &[Vec3; 3]) -> Vec3 {
        let (e, t) = (&self.shift, &self.turn);
        Vec3::new(
            e.x + t.y * (v.z - rx.z) - t.z * (v.y - rx.y),
            e.y + t.z * (v.x - ry.x) - t.x * (v.z - ry.z),
            e.z + t.x * (v.y - rz.y) - t.y * (v.x - rz.x),
        )
    }
}
