//! Drives, clearances, friction and compliance: a tree of bodies in reduced coordinates (rapier), driven by a sampled servo.
//!
//! Units inside: m, kg, s, N. An ideal drive follows its command to 0.02 um: feed-forward is computed from the set points
//! of the sampling instants. Everything that deviates comes from a body, a joint or a parameter of the servo.

use nalgebra::Vector3;
use rapier::{
    JointAxis, MassProperties, MultibodyJointHandle, PhysicsWorld, PrismaticJointBuilder,
    RevoluteJointBuilder,
};
use rapier::{RigidBody, RigidBodyBuilder, RigidBodyHandle};
use rapier3d_f64::prelude as rapier;

use crate::path::Shape;
use crate::program::{Program, STEP_S};

/// Position loop, 1/s.
const POSITION_GAIN: f64 = 40.0;
/// Velocity loop, 1/s.
const VELOCITY_GAIN: f64 = 150.0;
/// Integral of the velocity loop, 1/s^2.
const INTEGRAL_GAIN: f64 = 1500.0;
/// Inertia of motor and screw, reflected to the linear axis, kg.
const ARMATURE_KG: f64 = 8000.0;
/// Mass of a carriage, kg.
const CARRIAGE_KG: f64 = 40.0;
/// Friction of guideways where it is compensated by the drive, N.
const GUIDE_N: f64 = 120.0;
/// Speed at which the friction of a loose slide is fully developed, m/s.
const DEVELOPED_M_PER_S: f64 = 4e-3;
/// Steps after a motion, in which the machine settles.
const SETTLE_STEPS: usize = 150;

/// What one axis has.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Drive {
    /// Clearance between screw and slide, mm.
    pub gap_mm: f64,
    /// Clearance across the guideway, mm; signed: to which side a positive velocity pushes.
    pub side_mm: f64,
    /// Friction that the drive does not know, N.
    pub friction_n: f64,
    /// Share of the velocity feed-forward that is missing.
    pub lag: f64,
    /// Compliance of what the slide carries, um per N.
    pub carry_um_per_n: f64,
    /// Tilting compliance of what the slide carries, urad per N m.
    pub tilt_urad_per_nm: f64,
    /// Compliance of the tool under forces, um per N.
    pub load_um_per_n: f64,
}

/// What the machine has.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Drives {
    /// X, Y, Z.
    pub axes: [Drive; 3],
    /// Age of the set points on which all drives act, s.
    pub latency_s: f64,
    /// Clocks of the instruments behind that of the control: offset, s, per instrument in the order of [`CLOCKS`].
    pub clocks_s: [f64; CLOCKS.len()],
}

/// Instruments that read moving axes on clocks of their own.
pub const CLOCKS: [&str; 3] = ["ballbar", "dynamic", "flight"];

/// One axis in the tree of bodies.
struct Axis {
    guide: MultibodyJointHandle,
    guide_body: RigidBodyHandle,
    slide: Option<MultibodyJointHandle>,
    slide_body: RigidBodyHandle,
    side: Option<RigidBodyHandle>,
    direction: rapier::Vector,
    sideways: rapier::Vector,
    drive: Drive,
    carried_kg: f64,
    planned: f64,
    integral_n: f64,
    /// Direction of its last motion.
    way: f64,
}

struct World {
    world: PhysicsWorld,
    axes: Vec<Axis>,
    table: RigidBodyHandle,
    ram: RigidBodyHandle,
    tool: RigidBodyHandle,
    loads: Vec<MultibodyJointHandle>,
}

fn body(world: &mut PhysicsWorld, kg: f64, centre: rapier::Vector) -> RigidBodyHandle {
    let inertia = 0.02 * kg;
    world.insert_body(
        RigidBodyBuilder::dynamic()
            .additional_mass_properties(MassProperties::new(
                centre,
                kg,
                rapier::Vector::new(inertia, inertia, inertia),
            ))
            .can_sleep(false),
    )
}

const ORIGIN: rapier::Vector = rapier::Vector::ZERO;
/// Direction of motion of the body that carries X, Y, Z: the table moves against its coordinate.
const DIRECTIONS: [rapier::Vector; 3] = [
    rapier::Vector::new(-1.0, 0.0, 0.0),
    rapier::Vector::new(0.0, 1.0, 0.0),
    rapier::Vector::new(0.0, 0.0, 1.0),
];
/// Where play across the guideway shows.
const SIDEWAYS: [rapier::Vector; 3] = [
    rapier::Vector::new(0.0, 0.0, 1.0),
    rapier::Vector::new(1.0, 0.0, 0.0),
    rapier::Vector::new(0.0, 1.0, 0.0),
];
/// Axis about which what an axis carries tilts, pivot and centre of mass, m.
const TILTS: [(rapier::Vector, rapier::Vector, rapier::Vector); 3] = [
    (
        rapier::Vector::new(0.0, 0.0, 1.0),
        rapier::Vector::new(0.3, -0.25, 0.08),
        rapier::Vector::new(0.3, 0.0, 0.08),
    ),
    (
        rapier::Vector::new(1.0, 0.0, 0.0),
        rapier::Vector::new(0.0, 0.0, 0.3),
        rapier::Vector::new(0.0, 0.0, 0.05),
    ),
    (
        rapier::Vector::new(1.0, 0.0, 0.0),
        rapier::Vector::new(0.0, -0.2, 0.1),
        rapier::Vector::new(0.0, 0.05, 0.1),
    ),
];

impl World {
    fn new(d: &Drives) -> Option<Self> {
        let mut world = PhysicsWorld::new();
        world.gravity = ORIGIN;
        world.integration_parameters.dt = STEP_S;
        world.integration_parameters.num_solver_iterations = 1;
        world.integration_parameters.num_internal_pgs_iterations = 8;
        let bed = world.insert_body(RigidBodyBuilder::fixed());
        let mut axes = Vec::new();
        let mut ends = [bed, bed];
        for (k, drive) in d.axes.iter().enumerate() {
            let branch = usize::from(k > 0);
            let parent = *ends.get(branch)?;
            let (axis, end) = Self::axis(&mut world, parent, k, *drive)?;
            axes.push(axis);
            *ends.get_mut(branch)? = end;
        }
        let [table, ram] = ends;
        let mut tool = ram;
        let mut loads = Vec::new();
        for (k, drive) in d.axes.iter().enumerate().filter(|(_, d)| d.load_um_per_n != 0.0) {
            let next = body(&mut world, 3.0, ORIGIN);
            let unit = rapier::Vector::new(f64::from(k == 0), f64::from(k == 1), f64::from(k == 2));
            let joint = world.insert_multibody_joint(tool, next, PrismaticJointBuilder::new(unit))?;
            Self::spring(&mut world, joint, 0, 1e6 / drive.load_um_per_n.abs());
            loads.push(joint);
            tool = next;
        }
        // the tree has its degrees of freedom only after a step
        world.step();
        for axis in &axes {
            let d = &axis.drive;
            let friction = if d.side_mm == 0.0 { d.friction_n } else { d.friction_n + GUIDE_N };
            Self::dof(&mut world, axis.guide, |mb, id| {
                mb.armature_mut()[id] = ARMATURE_KG;
                mb.frictions_mut()[id] = friction;
            })?;
        }
        let springs: Vec<MultibodyJointHandle> = world.multibody_joints.iter().map(|(h, ..)| h).collect();
        for handle in springs {
            Self::dof(&mut world, handle, |mb, id| {
                let stiffness = mb
                    .links()
                    .find(|l| l.assembly_id() == id && l.joint().ndofs() > 0)
                    .map_or(0.0, |l| (0..6).map(|a| l.joint().spring(a).0).fold(0.0, f64::max));
                if stiffness > 0.0 {
                    // a tenth of critical for 40 kg; in rotation the same number times a lever of 0.25 m squared
                    mb.damping_mut()[id] = 0.2 * (stiffness * CARRIAGE_KG).sqrt();
                }
            })?;
        }
        Some(Self { world, axes, table, ram, tool, loads })
    }

    fn spring(world: &mut PhysicsWorld, joint: MultibodyJointHandle, axis: usize, stiffness: f64) {
        if let Some((mb, link)) = world.multibody_joints.get_mut(joint)
            && let Some(link) = mb.link_mut(link)
        {
            link.joint.set_spring(axis, stiffness, 0.0);
        }
    }

    fn dof(
        world: &mut PhysicsWorld,
        joint: MultibodyJointHandle,
        set: impl FnOnce(&mut rapier::Multibody, usize),
    ) -> Option<()> {
        let (mb, link) = world.multibody_joints.get_mut(joint)?;
        let id = mb.link(link)?.assembly_id();
        set(mb, id);
        Some(())
    }

    /// Guideway with screw; where there are: a loose slide, play across, a spring along, a tilting spring; the carriage.
    fn axis(
        world: &mut PhysicsWorld,
        parent: RigidBodyHandle,
        k: usize,
        drive: Drive,
    ) -> Option<(Axis, RigidBodyHandle)> {
        let (direction, sideways) = (*DIRECTIONS.get(k)?, *SIDEWAYS.get(k)?);
        let (about, pivot, centre) = *TILTS.get(k)?;
        let guide_body = body(world, 5.0, ORIGIN);
        let guide =
            world.insert_multibody_joint(parent, guide_body, PrismaticJointBuilder::new(direction))?;
        let (mut last, mut slide_body, mut slide, mut side) = (guide_body, guide_body, None, None);
        if drive.gap_mm != 0.0 {
            let half = 0.5e-3 * drive.gap_mm.abs();
            slide_body = body(world, 5.0, ORIGIN);
            let joint = PrismaticJointBuilder::new(direction).limits([-half, half]);
            slide = Some(world.insert_multibody_joint(last, slide_body, joint)?);
            last = slide_body;
        }
        if drive.side_mm != 0.0 {
            let half = 0.5e-3 * drive.side_mm.abs();
            let next = body(world, 5.0, ORIGIN);
            world.insert_multibody_joint(
                last,
                next,
                PrismaticJointBuilder::new(sideways).limits([-half, half]),
            )?;
            side = Some(next);
            last = next;
        }
        if drive.carry_um_per_n != 0.0 {
            let next = body(world, 1.0, ORIGIN);
            let joint = world.insert_multibody_joint(last, next, PrismaticJointBuilder::new(direction))?;
            Self::spring(world, joint, 0, 1e6 / drive.carry_um_per_n.abs());
            last = next;
        }
        let carriage = body(world, CARRIAGE_KG, centre);
        if drive.tilt_urad_per_nm == 0.0 {
            let fixed = rapier::FixedJointBuilder::new();
            world.insert_multibody_joint(last, carriage, fixed)?;
        } else {
            let hinge = RevoluteJointBuilder::new(about).local_anchor1(pivot).local_anchor2(pivot);
            let joint = world.insert_multibody_joint(last, carriage, hinge)?;
            Self::spring(world, joint, JointAxis::AngX as usize, 1e6 / drive.tilt_urad_per_nm.abs());
        }
        let carried_kg = if k == 1 { 2.0 * CARRIAGE_KG + 15.0 } else { CARRIAGE_KG + 10.0 };
        let axis = Axis {
            guide,
            guide_body,
            slide,
            slide_body,
            side,
            direction,
            sideways,
            drive,
            carried_kg,
            planned: 0.0,
            integral_n: 0.0,
            way: 0.0,
        };
        Some((axis, carriage))
    }

    fn coordinate(&self, joint: MultibodyJointHandle) -> (f64, f64) {
        let found = self.world.multibody_joints.get(joint).and_then(|(mb, id)| {
            let link = mb.link(id)?;
            let velocity = mb.generalized_velocity().get(link.assembly_id()).copied()?;
            Some((link.joint().coords()[0], velocity))
        });
        found.unwrap_or_default()
    }

    /// One step: set points now and one step later, m.
    fn step(&mut self, now: [f64; 3], later: [f64; 3], force: [f64; 3]) {
        let mut pushes: Vec<(RigidBodyHandle, rapier::Vector)> = Vec::new();
        for k in 0..self.axes.len() {
            let (q, v) = self.axes.get(k).map_or((0.0, 0.0), |a| self.coordinate(a.guide));
            let slide_v =
                self.axes.get(k).and_then(|a| a.slide).map(|s| self.coordinate(s).1).unwrap_or_default() + v;
            let (Some(a), Some(now), Some(later)) = (self.axes.get_mut(k), now.get(k), later.get(k)) else {
                continue;
            };
            let planned = (later - now) / STEP_S;
            let acceleration = (planned - a.planned) / STEP_S;
            let asked = POSITION_GAIN * (now - q) + (1.0 - a.drive.lag) * a.planned;
            let mass = ARMATURE_KG + a.carried_kg;
            let way = if planned.abs() > 1e-9 { planned.signum() } else { 0.0 };
            if a.drive.friction_n > 0.0 && way != 0.0 {
                a.integral_n += mass * INTEGRAL_GAIN * (asked - v) * STEP_S;
            }
            let known = match (a.slide.is_some(), a.side.is_some()) {
                (false, false) => 0.0,
                (true, true) => 2.0 * GUIDE_N,
                _ => GUIDE_N,
            };
            // the drive knows the friction law of its guideways
            let known = known * (planned / DEVELOPED_M_PER_S).clamp(-1.0, 1.0);
            let push = mass * (acceleration + VELOCITY_GAIN * (asked - v)) + a.integral_n + known;
            a.planned = planned;
            pushes.push((a.guide_body, push * a.direction));
            if a.slide.is_some() {
                let friction = GUIDE_N * (slide_v / DEVELOPED_M_PER_S).clamp(-1.0, 1.0);
                pushes.push((a.slide_body, -friction * a.direction));
            }
            if way != 0.0 {
                a.way = way;
            }
            if let Some(side) = a.side {
                // at rest friction holds the carriage where the drive pushed it
                pushes.push((side, 0.2 * GUIDE_N * a.way * a.drive.side_mm.signum() * a.sideways));
            }
        }
        for (handle, push) in &pushes {
            if let Some(b) = self.world.bodies.get_mut(*handle) {
                b.reset_forces(false);
                b.add_force(*push, true);
            }
        }
        let force = rapier::Vector::new(force[0], force[1], force[2]);
        if !self.loads.is_empty() && force != ORIGIN {
            self.load(force);
        }
        self.world.step();
        for handle in pushes.iter().map(|p| p.0).chain([self.tool, self.ram]) {
            if let Some(b) = self.world.bodies.get_mut(handle) {
                b.reset_forces(false);
                b.reset_torques(false);
            }
        }
    }

    /// A loading frame that stands on the ram: both forces on one line, so that nothing below the ram feels it.
    fn load(&mut self, force: rapier::Vector) {
        let bodies = &mut self.world.bodies;
        let Some(at) = bodies.get(self.tool).map(RigidBody::center_of_mass) else { return };
        for (body, force) in [(self.tool, force), (self.ram, -force)] {
            if let Some(b) = bodies.get_mut(body) {
                b.add_force_at_point(force, at, true);
            }
        }
    }

    /// Tip against table beside the command (mm), mm.
    fn error(&self, command: [f64; 4], tool_mm: f64) -> Vector3<f64> {
        let pose = |h: RigidBodyHandle| self.world.bodies.get(h).map(|b| *b.position()).unwrap_or_default();
        let tip = pose(self.tool) * rapier::Vector::new(0.0, 0.0, -1e-3 * tool_mm);
        let relative = pose(self.table).inverse() * tip;
        let nominal = Vector3::new(command[0], command[1], command[2] - tool_mm);
        1e3 * Vector3::new(relative.x, relative.y, relative.z) - nominal
    }
}

/// Deviation of the tip relative to the table at each reading, mm.
pub fn run(program: &Program, d: &Drives) -> Option<Vec<Vector3<f64>>> {
    let mut out = vec![Vector3::zeros(); program.samples.len()];
    if *d == Drives::default() {
        return Some(out);
    }
    let moves = d.axes != Drives::default().axes || d.latency_s != 0.0;
    let mut world = World::new(d)?;
    let mut next = 0;
    let mut settle = SETTLE_STEPS;
    let mut held = [0.0; 3];
    let mut at_rest = Vector3::zeros();
    let mut first = true;
    for (index, s) in program.segments.iter().enumerate() {
        let rest = matches!(s.motion.shape, Shape::Rest(_));
        if !rest || s.force != held {
            settle = SETTLE_STEPS;
            held = s.force;
        }
        let planned = (s.motion.duration / STEP_S).ceil() as usize;
        let steps = match (moves, rest) {
            (false, _) => 0,
            (true, true) => planned.min(settle),
            (true, false) => planned,
        };
        if rest {
            settle -= steps;
        }
        let command = |t: f64| s.motion.at(t - d.latency_s).q;
        let metres = |t: f64| {
            let q = command(t);
            [0, 1, 2].map(|k| 1e-3 * q[k])
        };
        if first && moves {
            // the carriages stand where the day begins
            first = false;
            let begin = metres(0.0);
            for n in 0..4000 {
                let share = |n: f64| {
                    let x = n / 4000.0;
                    x * x * x * (10.0 + x * (6.0 * x - 15.0))
                };
                let [a, b] = [f64::from(n), f64::from(n + 1)].map(|n| begin.map(|q| q * share(n)));
                world.step(a, b, [0.0; 3]);
            }
        }
        let mut errors = vec![at_rest];
        for n in 0..steps {
            let t = n as f64 * STEP_S;
            world.step(metres(t), metres(t + STEP_S), s.force);
            errors.push(world.error(s.motion.at(t + STEP_S).q, s.tool_mm));
        }
        if steps == 0 && moves {
            errors = vec![world.error(s.motion.at(0.0).q, s.tool_mm)];
        }
        at_rest = errors.last().copied().unwrap_or(at_rest);
        while let Some(sample) = program.samples.get(next).filter(|r| r.segment == index) {
            let clock = CLOCKS.iter().position(|c| *c == sample.instrument);
            let late = clock.and_then(|c| d.clocks_s.get(c)).copied().unwrap_or_default();
            let local = sample.t_s - s.begin_s;
            let t = local + late;
            let place = (t / STEP_S).clamp(0.0, (errors.len() - 1) as f64);
            let (low, share) = (place.floor() as usize, place.fract());
            let get = |n: usize| errors.get(n.min(errors.len() - 1)).copied().unwrap_or_default();
            let mut e = get(low) * (1.0 - share) + get(low + 1) * share;
            if late != 0.0 {
                let (then, now) = (s.motion.at(t).q, s.motion.at(local).q);
                e += Vector3::from_fn(|k, _| then[k] - now[k]);
            }
            if let Some(o) = out.get_mut(next) {
                *o = e;
            }
            next += 1;
        }
    }
    Some(out)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::program::program;

    fn rms(d: &Drives, of: impl Fn(&crate::program::Sample, Vector3<f64>) -> Option<f64>) -> f64 {
        let program = program();
        let errors = run(&program, d).unwrap();
        let values: Vec<f64> = program.samples.iter().zip(errors).filter_map(|(s, e)| of(s, e)).collect();
        assert!(values.len() > 20);
        (values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64).sqrt()
    }

    #[test]
    fn drives_without_faults_follow_to_hundredths_of_a_micrometre_and_a_gap_shows_half_of_itself() {
        // a spring that does not give: the tree is simulated and shows the drive alone
        let mut stiff = Drives::default();
        stiff.axes[1].carry_um_per_n = 1e-6;
        let shown = rms(&stiff, |_, e| Some(e.norm()));
        assert!(shown < 2e-5, "{shown} mm");
        let mut loose = Drives::default();
        loose.axes[0].gap_mm = 8e-3;
        let moving = |s: &crate::program::Sample, e: Vector3<f64>| {
            (s.instrument == "flight" && s.command.v[0].abs() > 1.0).then_some(e.x)
        };
        let shown = rms(&loose, moving);
        assert!((shown - 4e-3).abs() < 2e-4, "{shown}");
    }

    #[test]
    fn missing_feed_forward_lags_by_the_speed_over_the_gain() {
        let mut late = Drives::default();
        late.axes[1].lag = 0.01;
        let at_speed = |s: &crate::program::Sample, e: Vector3<f64>| {
            (s.instrument == "flight" && s.command.v[1].abs() > 39.9 && s.command.a[1] == 0.0)
                .then(|| e.y * POSITION_GAIN / (0.01 * s.command.v[1]))
        };
        let shown = rms(&late, at_speed);
        assert!((shown - 1.0).abs() < 0.05, "{shown}");
    }

    #[test]
    fn a_carriage_with_play_stays_where_it_was_pushed_while_others_move() {
        let mut loose = Drives::default();
        loose.axes[2].side_mm = 8e-3;
        loose.axes[1].load_um_per_n = 0.01;
        let at_rest = |s: &crate::program::Sample, e: Vector3<f64>| {
            let way = s.direction[2];
            (s.instrument == "flight" && s.command.v[2] == 0.0 && way != 0.0).then(|| e.y - 4e-3 * way)
        };
        let shown = rms(&loose, at_rest);
        // the tool swings on its spring
        assert!(shown < 1e-3, "{shown} mm");
    }
    #[test]
    fn a_load_between_tool_and_ram_tilts_no_axis_below() {
        let mut soft = Drives::default();
        soft.axes[0].load_um_per_n = 0.01;
        soft.axes[1].tilt_urad_per_nm = 3.0;
        let program = program();
        let force = |s: &crate::program::Sample| program.segments[s.segment].force;
        let loaded = |s: &crate::program::Sample, e: Vector3<f64>| {
            (s.instrument == "load" && force(s)[0] == 0.0).then(|| e.y.hypot(e.z))
        };
        let shown = rms(&soft, loaded);
        assert!(shown < 1e-3, "{shown} mm");
    }
}
