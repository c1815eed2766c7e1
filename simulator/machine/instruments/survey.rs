//! A 6D instrument on every axis in turn: all six error motions at positions, squareness, and where rotary axes lie.
//!
//! One axis moves, the others stand at home (coordinate 0). The instrument sees the pose of the tool relative to the
//! workpiece; the drawing of the machine (chain, points, tool tip, workpiece origin) is known, so the pose of the
//! moved joint follows by taking the nominal factors of the chain away on both sides. Convention of the result
//! (equations 1.3 to 1.8), which makes it a complete model:
//! - motions in the relative sense, at the reference points of the axis, zero at home, mean of both directions;
//! - straightness about its end-point line; the slopes s go to squareness, C0Y = -(sYX + sXY), B0Z = sXZ + sZX,
//!   A0Z = -(sYZ + sZY). Where EYX, EZX, EZY have slopes of their own at these points, the result differs from the
//!   machine by a rigid rotation of the workpiece frame, which nobody can observe;
//! - location errors of rotary axes, in the frame of the lines of X and Y: least squares over all positions of all
//!   rotary axes, exact at home. A first harmonic of an error motion counts as location; what no pose can tell apart
//!   (a shift between two rotary axes along which no linear axis moves) is shared evenly.

use nalgebra::{DMatrix, DVector, Matrix4, Vector3};
use volcomp_units::axes::{AxisArray, AxisKind, AxisName, MAX_AXES};
use volcomp_units::{arcsec_from_rad, mm_from_um, rad_from_arcsec, rad_from_deg, um_from_mm};

use super::{InstrumentError, Noise, at_most};
use crate::truth::TruthMachine;
use crate::truth::chain::Side;
use crate::truth::kinematics::{Deviation, Joint, JointState, Kinematics, Sense, Squareness};
use crate::truth::transform::{
    about_point, angles_zyx, inverse, rotation_about, rotation_part, rotation_zyx, translation,
    translation_part,
};

/// How the survey is done.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurveyPlan {
    /// Distance of positions on linear axes; home and both ends are always measured.
    pub step_mm: f64,
    /// Distance of positions on rotary axes.
    pub step_deg: f64,
    /// Standard deviation of a linear reading.
    pub noise_um: f64,
    /// Standard deviation of an angular reading.
    pub noise_arcsec: f64,
    /// Seed of the noise.
    pub seed: u64,
    /// One point at which all components of linear axes are stated, in M at home; `None`: each axis' own points.
    pub reference_mm: Option<[f64; 3]>,
}

/// The whole machine, measured.
#[derive(Debug, Clone, PartialEq)]
pub struct Survey {
    /// In wire order.
    pub axes: Vec<AxisSurvey>,
    /// `ec0y`, 0 where the machine lacks an axis of the pair.
    pub ec0y_arcsec: f64,
    /// `eb0z`.
    pub eb0z_arcsec: f64,
    /// `ea0z`.
    pub ea0z_arcsec: f64,
}

/// One axis, measured.
#[derive(Debug, Clone, PartialEq)]
pub struct AxisSurvey {
    /// The axis.
    pub axis: AxisName,
    /// The points at which the x, y and z components hold, in M at home.
    pub reference_mm: [[f64; 3]; 3],
    /// A point on the axis as drawn (rotary axes).
    pub point_mm: [f64; 3],
    /// Rising positions.
    pub rows: Vec<MotionRow>,
    /// Location errors of a rotary axis: XO YO ZO in um, AO BO CO in arcsec; zero on linear axes.
    pub location_um_arcsec: [f64; 6],
}

/// The six error motions at one position.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MotionRow {
    /// mm or deg.
    pub position: f64,
    /// Along x, y, z.
    pub shift_um: [f64; 3],
    /// About x, y, z.
    pub tilt_arcsec: [f64; 3],
}

impl Default for SurveyPlan {
    fn default() -> Self {
        Self { step_mm: 25.0, step_deg: 10.0, noise_um: 0.2, noise_arcsec: 0.1, seed: 1, reference_mm: None }
    }
}

impl AxisSurvey {
    /// The rows as a table for `volcomp fit`: `position_mm,exx_um,eyx_um,ezx_um,eax_arcsec,ebx_arcsec,ecx_arcsec`.
    #[must_use]
    pub fn csv(&self) -> String {
        let letter = self.axis.lower();
        let unit = match self.axis.kind() {
            AxisKind::Linear => "mm",
            AxisKind::Rotary => "deg",
        };
        let mut text = format!("position_{unit}");
        for (component, unit) in
            [('x', "um"), ('y', "um"), ('z', "um"), ('a', "arcsec"), ('b', "arcsec"), ('c', "arcsec")]
        {
            text.push_str(&format!(",e{component}{letter}_{unit}"));
        }
        for row in &self.rows {
            text.push_str(&format!("\n{}", row.position));
            for value in row.shift_um.iter().chain(&row.tilt_arcsec) {
                text.push_str(&format!(",{value:.6}"));
            }
        }
        text.push('\n');
        text
    }
}

/// Most positions on an axis.
const POSITIONS_MAX: f64 = 100_000.0;

impl Survey {
    /// Measures a machine at rest.
    /// # Errors
    /// [`InstrumentError`] for steps that are not positive or when the locations cannot be fitted.
    pub fn of(machine: &TruthMachine, plan: &SurveyPlan) -> Result<Self, InstrumentError> {
        for (what, value) in [("step-mm", plan.step_mm), ("step-deg", plan.step_deg)] {
            if !value.is_finite() || value <= 0.0 {
                return Err(InstrumentError::Plan { what, value, limit: "above 0" });
            }
        }
        let mut noise = Noise::new(plan.seed);
        let mut setup = Setup::new(machine);
        for k in 0..setup.axes.len() {
            let [low, high] = machine.travel(k);
            let step = if setup.axes[k].kind() == AxisKind::Linear { plan.step_mm } else { plan.step_deg };
            at_most((high - low) / step, POSITIONS_MAX, "positions on an axis", "enlarge the step")?;
        }
        setup.find_locations(plan, &mut noise)?;
        let mut axes = Vec::with_capacity(setup.axes.len());
        for k in 0..setup.axes.len() {
            axes.push(setup.measure(k, plan, &mut noise));
        }
        let slopes = remove_end_point_lines(&mut axes);
        let slope = |component: usize, axis: AxisName| {
            slopes.iter().find(|(name, _)| *name == axis).map_or(0.0, |(_, s)| s[component])
        };
        let has = |axis: AxisName| setup.axes.contains(&axis);
        let pair = |a: AxisName, b: AxisName, value: f64| if has(a) && has(b) { value } else { 0.0 };
        let (x, y, z) = (AxisName::X, AxisName::Y, AxisName::Z);
        Ok(Self {
            ec0y_arcsec: pair(x, y, -arcsec_from_slope(slope(1, x) + slope(0, y))),
            eb0z_arcsec: pair(x, z, arcsec_from_slope(slope(0, z) + slope(2, x))),
            ea0z_arcsec: pair(y, z, -arcsec_from_slope(slope(1, z) + slope(2, y))),
            axes,
        })
    }
}

/// Angles count like the lengths they make at this radius.
const RADIUS_MM: f64 = 300.0;
/// Weight of what must be met exactly.
const EXACT: f64 = 1e3;
/// Step of the differences by which the effect of a location is found.
const NUDGE_MM: f64 = 1e-2;

/// Rows of a least-squares problem: what was seen, and per unknown what it does.
struct Equations {
    seen: Vec<f64>,
    columns: Vec<Vec<f64>>,
}

/// Lengths are fitted in mm, angles in the length they make at [`RADIUS_MM`].
const fn unit_of(component: usize) -> f64 {
    if component < 3 { 1.0 } else { 1.0 / RADIUS_MM }
}

/// The machine on the bench, with what the drawing says of it.
#[derive(Clone)]
struct Setup<'a> {
    machine: &'a TruthMachine,
    /// Wire order.
    axes: Vec<AxisName>,
    /// The drawing with the locations found so far, joints in chain order.
    drawing: Kinematics,
    /// Joint of each wire axis.
    joints: Vec<usize>,
}

impl<'a> Setup<'a> {
    fn new(machine: &'a TruthMachine) -> Self {
        let axes = machine.axes();
        let order = |axis: AxisName| machine.chain().links().iter().position(|l| l.axis == axis);
        let mut sorted: Vec<usize> = (0..axes.len()).collect();
        sorted.sort_by_key(|k| order(axes[*k]));
        let mut joints = vec![0; axes.len()];
        for (joint, k) in sorted.iter().enumerate() {
            joints[*k] = joint;
        }
        let drawing = Kinematics {
            joints: sorted
                .iter()
                .filter_map(|k| machine.drawing(*k))
                .map(|joint| Joint { sense: Sense::Relative, ..joint })
                .collect(),
            squareness: Squareness::default(),
            workpiece_origin_mm: machine.workpiece_origin_mm(),
            tool_tip_mm: machine.tool_tip_mm(),
        };
        Self { machine, axes, drawing, joints }
    }

    /// Positions of axis `k`: whole steps from home, and the ends of its travel.
    fn positions(&self, k: usize, plan: &SurveyPlan) -> Vec<f64> {
        let step = match self.axes[k].kind() {
            AxisKind::Linear => plan.step_mm,
            AxisKind::Rotary => plan.step_deg,
        };
        let [low, high] = self.machine.travel(k);
        let (first, last) = ((low / step).ceil() as i64, (high / step).floor() as i64);
        let mut positions: Vec<f64> = (first..=last).map(|n| n as f64 * step).collect();
        if positions.first().is_none_or(|p| *p > low) {
            positions.insert(0, low);
        }
        if positions.last().is_none_or(|p| *p < high) {
            positions.push(high);
        }
        positions
    }

    fn directions(&self, k: usize, direction: i8) -> ([i8; MAX_AXES], impl Fn(f64) -> AxisArray) {
        let mut directions = [0; MAX_AXES];
        directions[k] = direction;
        let alone = move |position: f64| {
            let mut q = AxisArray::default();
            q[k] = position;
            q
        };
        (directions, alone)
    }

    fn states(&self, k: usize, position: f64) -> Vec<JointState> {
        let mut states = vec![JointState::default(); self.drawing.joints.len()];
        states[self.joints[k]].q = internal(self.axes[k], position);
        states
    }

    /// Fits the location errors of all rotary axes to the poses seen while each turns alone and to the lines of the
    /// linear axes, which span the frame in which the rotary axes lie.
    fn find_locations(&mut self, plan: &SurveyPlan, noise: &mut Noise) -> Result<(), InstrumentError> {
        let unknowns: Vec<(usize, usize)> = (0..self.drawing.joints.len())
            .filter(|j| self.drawing.joints[*j].axis.kind() == AxisKind::Rotary)
            .flat_map(|j| (0..6).map(move |component| (j, component)))
            .filter(|(j, component)| component % 3 != self.drawing.joints[*j].axis.direction())
            .collect();
        if unknowns.is_empty() {
            return Ok(());
        }
        let mut equations = Equations { seen: Vec::new(), columns: vec![Vec::new(); unknowns.len()] };
        for k in (0..self.axes.len()).filter(|k| self.axes[*k].kind() == AxisKind::Rotary) {
            for position in self.positions(k, plan) {
                self.add_pose(&mut equations, &unknowns, k, position, plan, noise);
            }
        }
        self.add_lines(&mut equations, &unknowns, plan);
        let Equations { seen, columns } = equations;
        let matrix = DMatrix::from_fn(seen.len(), unknowns.len(), |row, column| columns[column][row]);
        // What the readings cannot tell apart (singular values of rounding size) is shared evenly.
        let found = matrix
            .svd(true, true)
            .solve(&DVector::from_vec(seen), 1e-3)
            .map_err(|_| InstrumentError::Degenerate { what: "the locations of the rotary axes" })?;
        for ((joint, component), value) in unknowns.iter().zip(found.iter()) {
            self.drawing.joints[*joint].location[*component] = value * unit_of(*component);
        }
        Ok(())
    }

    /// Six equations: what the locations would do to this pose is what was seen of it.
    fn add_pose(
        &self,
        equations: &mut Equations,
        unknowns: &[(usize, usize)],
        k: usize,
        position: f64,
        plan: &SurveyPlan,
        noise: &mut Noise,
    ) {
        let mut reading = self.mean_deviation(k, position);
        let is_home = position == 0.0;
        // Home is read often enough that its noise is gone.
        if !is_home {
            for i in 0..3 {
                reading.tip_mm[i] += mm_from_um(noise.draw(plan.noise_um));
                reading.rotation_rad[i] += rad_from_arcsec(noise.draw(plan.noise_arcsec));
            }
        }
        let weight = if is_home { EXACT } else { 1.0 };
        let scaled = |d: &Deviation| -> [f64; 6] {
            std::array::from_fn(|i| {
                weight * if i < 3 { d.tip_mm[i] } else { d.rotation_rad[i - 3] * RADIUS_MM }
            })
        };
        equations.seen.extend(scaled(&reading));
        let states = self.states(k, position);
        let drawn = self.drawing.nominal(&states);
        for (unknown, column) in unknowns.iter().zip(&mut equations.columns) {
            let [plus, minus] = self.nudged(*unknown).map(|m| scaled(&m.drawing.pose(&states).minus(&drawn)));
            column.extend((0..6).map(|i| (plus[i] - minus[i]) / (2.0 * NUDGE_MM)));
        }
    }

    /// One equation per line: with the right locations the end-point lines of X lie along x, that of Y across z.
    fn add_lines(&self, equations: &mut Equations, unknowns: &[(usize, usize)], plan: &SurveyPlan) {
        for (axis, component) in [(AxisName::X, 1), (AxisName::X, 2), (AxisName::Y, 2)] {
            let Some(k) = self.axes.iter().position(|a| *a == axis) else { continue };
            let reference_mm = plan
                .reference_mm
                .map_or(self.drawing.joints[self.joints[k]].reference_mm, |point| [point; 3]);
            let [low, high] = self.machine.travel(k);
            let slope = |setup: &Self| {
                let [at_low, at_high] =
                    [low, high].map(|q| setup.mean_motion(k, q, &reference_mm)[component]);
                EXACT * RADIUS_MM * (at_high - at_low) / (high - low)
            };
            equations.seen.push(-slope(self));
            for (unknown, column) in unknowns.iter().zip(&mut equations.columns) {
                let [plus, minus] = self.nudged(*unknown).map(|setup| slope(&setup));
                column.push((plus - minus) / (2.0 * NUDGE_MM));
            }
        }
    }

    /// The same set-up with one location a little larger and a little smaller.
    fn nudged(&self, (joint, component): (usize, usize)) -> [Self; 2] {
        [NUDGE_MM, -NUDGE_MM].map(|nudge| {
            let mut setup = self.clone();
            setup.drawing.joints[joint].location[component] = nudge * unit_of(component);
            setup
        })
    }

    /// Mean of both directions of travel.
    fn mean_deviation(&self, k: usize, position: f64) -> Deviation {
        let mut mean = Deviation::default();
        for direction in [1, -1] {
            let (directions, alone) = self.directions(k, direction);
            let seen = self.machine.deviation(&alone(position), &directions);
            for i in 0..3 {
                mean.tip_mm[i] += seen.tip_mm[i] / 2.0;
                mean.rotation_rad[i] += seen.rotation_rad[i] / 2.0;
            }
        }
        mean
    }

    fn measure(&self, k: usize, plan: &SurveyPlan, noise: &mut Noise) -> AxisSurvey {
        let joint = &self.drawing.joints[self.joints[k]];
        let axis = self.axes[k];
        let reference_mm = match (axis.kind(), plan.reference_mm) {
            (AxisKind::Linear, Some(point)) => [point; 3],
            _ => joint.reference_mm,
        };
        let at_home = self.mean_motion(k, 0.0, &reference_mm);
        let mut rows: Vec<MotionRow> = self
            .positions(k, plan)
            .into_iter()
            .map(|position| {
                let motion = self.mean_motion(k, position, &reference_mm);
                let relative: [f64; 6] = std::array::from_fn(|i| motion[i] - at_home[i]);
                MotionRow {
                    position,
                    shift_um: std::array::from_fn(|i| um_from_mm(relative[i]) + noise.draw(plan.noise_um)),
                    tilt_arcsec: std::array::from_fn(|i| {
                        arcsec_from_rad(relative[i + 3]) + noise.draw(plan.noise_arcsec)
                    }),
                }
            })
            .collect();
        if let Some(home) = rows.iter().find(|r| r.position == 0.0).copied() {
            for row in &mut rows {
                row.shift_um = std::array::from_fn(|i| row.shift_um[i] - home.shift_um[i]);
                row.tilt_arcsec = std::array::from_fn(|i| row.tilt_arcsec[i] - home.tilt_arcsec[i]);
            }
        }
        let location_um_arcsec = std::array::from_fn(|i| {
            if i < 3 { um_from_mm(joint.location[i]) } else { arcsec_from_rad(joint.location[i]) }
        });
        AxisSurvey { axis, reference_mm, point_mm: joint.point_mm, rows, location_um_arcsec }
    }

    fn mean_motion(&self, k: usize, position: f64, reference_mm: &[[f64; 3]; 3]) -> [f64; 6] {
        let motions = [1, -1].map(|direction| {
            let (directions, alone) = self.directions(k, direction);
            let seen = self.machine.pose(&alone(position), &directions).matrix;
            motion_at(&self.error_of(k, position, &seen), reference_mm)
        });
        std::array::from_fn(|i| (motions[0][i] + motions[1][i]) / 2.0)
    }

    /// The error motion of axis `k` that explains a pose, all other joints being as drawn.
    fn error_of(&self, k: usize, position: f64, seen: &Matrix4<f64>) -> Matrix4<f64> {
        let index = self.joints[k];
        let part = |joints: &[Joint], workpiece_origin_mm: [f64; 3], tool_tip_mm: [f64; 3]| {
            let joints = joints.to_vec();
            let states = vec![JointState::default(); joints.len()];
            let squareness = Squareness::default();
            Kinematics { joints, squareness, workpiece_origin_mm, tool_tip_mm }.pose(&states).matrix
        };
        let left = part(&self.drawing.joints[..index], self.drawing.workpiece_origin_mm, [0.0; 3]);
        let right = part(&self.drawing.joints[index + 1..], [0.0; 3], self.drawing.tool_tip_mm);
        let moved = inverse(&left) * seen * inverse(&right);
        let joint = &self.drawing.joints[index];
        let [x, y, z, a, b, c] = joint.location;
        let place = about_point(joint.point_mm, &(translation([x, y, z]) * rotation_zyx([a, b, c])));
        let q = internal(joint.axis, position);
        let back = match joint.axis.kind() {
            AxisKind::Linear => translation((Vector3::ith(joint.axis.direction(), 1.0) * -q).into()),
            AxisKind::Rotary => about_point(joint.point_mm, &rotation_about(joint.axis.direction(), -q)),
        };
        match (joint.axis.kind(), joint.side) {
            (AxisKind::Linear, Side::Tool) => back * moved,
            (AxisKind::Linear, Side::Workpiece) => moved * back,
            (AxisKind::Rotary, Side::Tool) => inverse(&place) * moved * back,
            (AxisKind::Rotary, Side::Workpiece) => back * moved * place,
        }
    }
}

/// The six numbers of a small motion, each linear one as the displacement of its reference point.
fn motion_at(error: &Matrix4<f64>, reference_mm: &[[f64; 3]; 3]) -> [f64; 6] {
    let turn = rotation_part(error);
    let shift = translation_part(error);
    let angles = angles_zyx(&turn);
    std::array::from_fn(|i| {
        if i < 3 {
            let point = Vector3::from(reference_mm[i]);
            shift[i] + (turn * point - point)[i]
        } else {
            angles[i - 3]
        }
    })
}

/// Takes the end-point lines out of the straightnesses; returns the slopes (um per mm) per component and axis.
fn remove_end_point_lines(axes: &mut [AxisSurvey]) -> Vec<(AxisName, [f64; 3])> {
    let mut slopes = Vec::new();
    for survey in axes.iter_mut().filter(|s| s.axis.kind() == AxisKind::Linear) {
        let (Some(first), Some(last)) = (survey.rows.first().copied(), survey.rows.last().copied()) else {
            continue;
        };
        let slope: [f64; 3] = std::array::from_fn(|i| {
            if i == survey.axis.direction() {
                0.0
            } else {
                (last.shift_um[i] - first.shift_um[i]) / (last.position - first.position)
            }
        });
        for row in &mut survey.rows {
            row.shift_um = std::array::from_fn(|i| row.shift_um[i] - slope[i] * row.position);
        }
        slopes.push((survey.axis, slope));
    }
    slopes
}

/// A slope in um per mm is an angle in mrad.
fn arcsec_from_slope(um_per_mm: f64) -> f64 {
    arcsec_from_rad(um_per_mm / 1e3)
}

fn internal(axis: AxisName, q: f64) -> f64 {
    match axis.kind() {
        AxisKind::Linear => q,
        AxisKind::Rotary => rad_from_deg(q),
    }
}
