//! The state of the machine and of the instrument at one reading.
//!
//! Positions are commanded ones, mm and rad; a quantity that is not known is NaN, and no effect that needs it is tried
//! (`docs/reference/session-files.md` 1 lists the columns).

use core::f64::consts::TAU;
use core::fmt;

use serde::{Deserialize, Serialize};

use volcomp_model::ReferencePoint;
use volcomp_model::geometry::{Mat3, Vec3, rotation_about};
use volcomp_units::RAD_PER_DEG;
use volcomp_units::axes::AxisName;

/// Number of axes that session files know.
pub const SLOTS: usize = 6;

/// An axis of a session file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[expect(missing_docs, reason = "the letters are their own description")]
pub enum Axis {
    X,
    Y,
    Z,
    A,
    B,
    C,
}

impl Axis {
    /// All of them, in the order of their slots.
    pub const ALL: [Self; SLOTS] = [Self::X, Self::Y, Self::Z, Self::A, Self::B, Self::C];
    /// Those that move along a line.
    pub const LINEAR: [Self; 3] = [Self::X, Self::Y, Self::Z];
    /// Those that turn, about X, Y and Z.
    pub const ROTARY: [Self; 3] = [Self::A, Self::B, Self::C];

    /// Place in the arrays of a [`MachineState`].
    #[must_use]
    pub const fn slot(self) -> usize {
        self as usize
    }

    /// 0 = x, 1 = y, 2 = z: the direction along or about which it moves.
    #[must_use]
    pub const fn direction(self) -> usize {
        self as usize % 3
    }

    /// True for X, Y, Z.
    #[must_use]
    pub const fn is_linear(self) -> bool {
        (self as usize) < 3
    }

    /// The axis of the model.
    #[must_use]
    pub const fn name(self) -> AxisName {
        match self {
            Self::X => AxisName::X,
            Self::Y => AxisName::Y,
            Self::Z => AxisName::Z,
            Self::A => AxisName::A,
            Self::B => AxisName::B,
            Self::C => AxisName::C,
        }
    }

    /// The axis of a model, where session files know it.
    #[must_use]
    pub fn from_name(name: AxisName) -> Option<Self> {
        Self::ALL.into_iter().find(|a| a.name() == name)
    }

    /// The column of its position.
    #[must_use]
    pub fn column(self) -> String {
        format!("{self}_{}", self.name().kind().position_unit())
    }

    /// The column of its velocity.
    #[must_use]
    pub fn velocity_column(self) -> String {
        format!("v{self}_{}_per_s", self.name().kind().position_unit())
    }

    /// The column of its acceleration.
    pub(crate) fn acceleration_column(self) -> String {
        format!("a{self}_mm_per_s2")
    }

    /// The linear axes but this one.
    #[must_use]
    pub fn others(self) -> Vec<Self> {
        Self::LINEAR.into_iter().filter(|a| *a != self).collect()
    }
}

impl fmt::Display for Axis {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.name().lower())
    }
}

/// An instrument that measures lengths by light through air; each kind has an air of its own.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Light {
    /// A laser interferometer.
    Laser,
    /// A laser tracker.
    Tracker,
}

impl Light {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Laser, Self::Tracker];

    /// By the name of the instrument.
    #[must_use]
    pub fn of(instrument: &str) -> Option<Self> {
        let name = instrument.to_ascii_lowercase();
        if name.contains("tracker") || name.contains("tracer") {
            Some(Self::Tracker)
        } else {
            ["laser", "interferom"].iter().any(|w| name.contains(w)).then_some(Self::Laser)
        }
    }
}

/// One reading's state.
#[derive(Debug, Clone, PartialEq)]
pub struct MachineState {
    /// Time on the clock of the file, s.
    pub t_s: f64,
    /// Which file of several.
    pub file: usize,
    /// Commanded positions, mm or rad.
    pub position: [f64; SLOTS],
    /// Commanded velocities, mm/s or rad/s.
    pub velocity: [f64; SLOTS],
    /// Commanded accelerations, mm/s^2 or rad/s^2.
    pub acceleration: [f64; SLOTS],
    /// Travel since the last reversal: +1, -1, or 0 before the axis has moved.
    pub direction: [f64; SLOTS],
    /// Distance since the last reversal, mm or rad; infinite where it was long ago.
    pub since_mm: [f64; SLOTS],
    /// Time since the last reversal, s; infinite where it was long ago.
    pub since_s: [f64; SLOTS],
    /// Direction of sensitivity, a unit vector in machine axes.
    pub u: Vec3,
    /// Tool length, mm.
    pub tool_length_mm: f64,
    /// Distance from instrument to target, mm.
    pub range_mm: f64,
    /// Target on the workpiece side at home, mm.
    pub target_mm: Vec3,
    /// Where the instrument stands, mm.
    pub station_mm: Vec3,
    /// What it looks at, mm; known where it has a station.
    pub reflector_mm: Vec3,
    /// Of an angular reading: from the axis of rotation to the point at which the angle is given as displacement along `u`,
    /// in machine axes, mm; NaN elsewhere.
    pub lever_mm: Vec3,
    /// The instrument measures lengths by light through air: which one.
    pub light: Option<Light>,
    /// The reading is of a ballbar.
    pub is_ballbar: bool,
    /// The reading is of the control's own encoder, which does not see the structure.
    pub is_encoder: bool,
    /// The set-up of its instrument.
    pub setup: usize,
    /// Forces per linear axis, N.
    pub force_n: [f64; 3],
    /// Where the rotary axes that carry the tool have taken it.
    pub head: Head,
    /// Lagged signals, in the order of the library's list of signals.
    pub signals: Vec<f64>,
}

impl Default for MachineState {
    fn default() -> Self {
        let none = [f64::NAN; SLOTS];
        Self {
            t_s: 0.0,
            file: 0,
            position: [0.0; SLOTS],
            velocity: none,
            acceleration: none,
            direction: none,
            since_mm: none,
            since_s: none,
            u: Vec3::zeros(),
            tool_length_mm: f64::NAN,
            range_mm: f64::NAN,
            target_mm: Vec3::repeat(f64::NAN),
            station_mm: Vec3::repeat(f64::NAN),
            reflector_mm: Vec3::repeat(f64::NAN),
            lever_mm: Vec3::repeat(f64::NAN),
            light: None,
            is_ballbar: false,
            is_encoder: false,
            setup: 0,
            force_n: [f64::NAN; 3],
            head: Head::default(),
            signals: Vec::new(),
        }
    }
}

/// Where the value of a column goes.
pub type Field = Box<dyn Fn(&mut MachineState, f64)>;

impl MachineState {
    /// The columns of a table of states, each with where its values go.
    #[must_use]
    pub fn fields() -> Vec<(String, Field)> {
        let mut all: Vec<(String, Field)> = Vec::new();
        let mut add = |name: String, field: Field| all.push((name, field));
        for axis in Axis::ALL {
            let (i, linear) = (axis.slot(), axis.is_linear());
            let (unit, factor) = if linear { ("mm", 1.0) } else { ("deg", RAD_PER_DEG) };
            add(axis.column(), Box::new(move |m, v| m.position[i] = v * factor));
            add(axis.velocity_column(), Box::new(move |m, v| m.velocity[i] = v * factor));
            add(format!("a{axis}_{unit}_per_s2"), Box::new(move |m, v| m.acceleration[i] = v * factor));
            add(format!("dir_{axis}"), Box::new(move |m, v| m.direction[i] = v));
            add(format!("since_reversal_{axis}_{unit}"), Box::new(move |m, v| m.since_mm[i] = v * factor));
            add(format!("since_reversal_{axis}_s"), Box::new(move |m, v| m.since_s[i] = v));
            if linear {
                add(format!("target_{axis}_mm"), Box::new(move |m, v| m.target_mm[i] = v));
                add(format!("force_{axis}_n"), Box::new(move |m, v| m.force_n[i] = v));
            }
        }
        add("t_s".to_owned(), Box::new(|m, v| m.t_s = v));
        add("tool_length_mm".to_owned(), Box::new(|m, v| m.tool_length_mm = v));
        add("range_mm".to_owned(), Box::new(|m, v| m.range_mm = v));
        all
    }

    /// The reading is of a rotation, given as displacement at the end of a lever.
    #[must_use]
    pub fn is_angular(&self) -> bool {
        self.lever_mm.iter().all(|v| v.is_finite())
    }

    /// An angular reading seen at the opposite end of its lever: half the difference of both is the rotation alone.
    pub(crate) fn opposite(&self) -> Self {
        Self { lever_mm: -self.lever_mm, u: -self.u, ..self.clone() }
    }

    /// What the instrument looks at, mm: the carriage where nothing tells more.
    #[must_use]
    pub fn seen_mm(&self) -> Vec3 {
        if self.reflector_mm.iter().all(|v| v.is_finite()) { self.reflector_mm } else { self.carriage_mm() }
    }

    /// Positions of the linear axes, mm.
    #[must_use]
    pub fn carriage_mm(&self) -> Vec3 {
        Vec3::new(self.position[0], self.position[1], self.position[2])
    }
}

/// What the rotary axes that carry the tool do to a point at home, without the linear axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Head {
    rotation: Mat3,
    shift_mm: Vec3,
}

impl Default for Head {
    fn default() -> Self {
        Self { rotation: Mat3::identity(), shift_mm: Vec3::zeros() }
    }
}

impl Head {
    /// Where a point at home is now, mm.
    #[must_use]
    pub fn carries(&self, home_mm: Vec3) -> Vec3 {
        self.rotation * home_mm + self.shift_mm
    }

    /// Where a direction at home points now.
    #[must_use]
    pub fn turns(&self, home: Vec3) -> Vec3 {
        self.rotation * home
    }
}

/// What moves or tells something beside the axes.
#[derive(Debug, Clone, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Source {
    /// Revolutions of the spindle, in 1000 per minute.
    Spindle,
    /// The column `temp_<name>_degc`.
    Temperature(String),
    /// Commanded velocity of a linear axis, mm/s.
    Velocity(Axis),
}

impl Source {
    /// The source that a column of a log or of a session tells of, and what one of the column's units is of it.
    #[must_use]
    pub fn of_column(name: &str) -> Option<(Self, f64)> {
        let sensor = name.strip_prefix("temp_").and_then(|n| n.strip_suffix("_degc"));
        match sensor {
            _ if name == "spindle_rpm" => Some((Self::Spindle, 1e-3)),
            Some(sensor) => Some((Self::Temperature(sensor.to_owned()), 1.0)),
            None => None,
        }
    }

    /// False for a motion of the axes, which the readings tell by themselves.
    #[must_use]
    pub const fn is_logged(&self) -> bool {
        !matches!(self, Self::Velocity(_))
    }
}

impl fmt::Display for Source {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Spindle => write!(f, "spindle_rpm"),
            Self::Temperature(name) => write!(f, "temp_{name}_degc"),
            Self::Velocity(axis) => f.write_str(&axis.velocity_column()),
        }
    }
}

/// The machine's chain as far as effects need it.
#[derive(Debug, Clone, PartialEq)]
pub struct Machine {
    /// Its axes from the workpiece through the bed to the tool.
    pub axes: Vec<MachineAxis>,
    /// Tool tip at home, mm.
    pub tool_tip_mm: Vec3,
    /// Spindle nose at home, mm, where known.
    pub gauge_point_mm: Option<Vec3>,
    /// The linear axis that points up, where the model says it.
    pub vertical: Option<Axis>,
}

/// An axis of the chain.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MachineAxis {
    /// Its letter.
    pub axis: Axis,
    /// It carries the workpiece.
    pub workpiece_side: bool,
    /// A point on a rotary axis, mm.
    pub point_mm: Vec3,
    /// Reference points of the linear components of a linear axis.
    pub reference_points: [ReferencePoint; 3],
    /// Its travel, mm or rad, where the model says it.
    pub travel: Option<[f64; 2]>,
}

impl Machine {
    /// A machine whose axes all carry the tool, where no model says more.
    #[must_use]
    pub fn plain() -> Self {
        let axes = Axis::ALL
            .into_iter()
            .map(|axis| MachineAxis {
                axis,
                workpiece_side: false,
                point_mm: Vec3::zeros(),
                reference_points: Default::default(),
                travel: None,
            })
            .collect();
        Self { axes, tool_tip_mm: Vec3::zeros(), gauge_point_mm: None, vertical: None }
    }

    /// The axis that points up. Where the model does not say it, Z; Y where a table turns all the way about Y and no other about Z:
    /// a horizontal spindle.
    #[must_use]
    pub fn up(&self) -> Axis {
        let turns = |a: &MachineAxis| a.travel.is_some_and(|[low, high]| high - low > 0.99 * TAU);
        let is_horizontal = self.table_about_y().is_some_and(turns);
        self.vertical.unwrap_or(if is_horizontal { Axis::Y } else { Axis::Z })
    }

    /// A table that turns about Y, without one about Z: of a horizontal spindle, or a rotary attachment of an upright machine.
    #[must_use]
    pub fn table_about_y(&self) -> Option<&MachineAxis> {
        let on_table = |turn: Axis| self.axes.iter().find(move |a| a.axis == turn && a.workpiece_side);
        on_table(Axis::B).filter(|_| on_table(Axis::C).is_none())
    }

    /// The linear axes whose travel is a lever of the angular errors of `axis`: those between it and the tool, and itself
    /// where it carries the workpiece, because its error then acts on the tool as it stands over the moved table.
    #[must_use]
    pub fn levers_of(&self, axis: Axis) -> [bool; 3] {
        let mut lever = [false; 3];
        let at = self.axes.iter().position(|a| a.axis == axis).unwrap_or(0);
        if self.axes.get(at).is_some_and(|a| a.axis == axis && axis.is_linear() && a.workpiece_side) {
            lever[axis.slot()] = true;
        }
        for beyond in self.axes.iter().skip(at + 1).filter(|a| a.axis.is_linear()) {
            lever[beyond.axis.slot()] = true;
        }
        lever
    }

    /// The tip at home of the tool that is in, mm; of the model's own where no length is stated.
    #[must_use]
    pub fn tip_of(&self, m: &MachineState) -> Vec3 {
        match self.gauge_point_mm {
            Some(nose) if m.tool_length_mm.is_finite() => nose - Vec3::new(0.0, 0.0, m.tool_length_mm),
            _ => self.tool_tip_mm,
        }
    }

    /// The rotary axes that carry the workpiece, from the bed outwards.
    pub fn table_axes(&self) -> impl Iterator<Item = Axis> {
        self.axes.iter().rev().filter(|a| !a.axis.is_linear() && a.workpiece_side).map(|a| a.axis)
    }

    /// How the workpiece stands, turned from where it is with all axes at zero: a table turns the other way than its coordinate
    /// counts.
    #[must_use]
    pub fn table_turn(&self, m: &MachineState) -> Mat3 {
        let turn = |r: Mat3, a: Axis| r * rotation_about(a.direction(), -m.position[a.slot()]);
        self.table_axes().fold(Mat3::identity(), turn)
    }

    /// The rotary axes that carry the tool, from the bed outwards; none where nothing says where they stand.
    pub fn head_axes(&self) -> impl DoubleEndedIterator<Item = &MachineAxis> {
        let known = self.gauge_point_mm.is_some() || self.tool_tip_mm != Vec3::zeros();
        self.axes.iter().filter(move |a| known && !a.axis.is_linear() && !a.workpiece_side)
    }

    /// What the head does to the tool at some positions of the axes (mm, rad).
    #[must_use]
    pub fn head(&self, position: &[f64; SLOTS]) -> Head {
        self.head_axes().rev().fold(Head::default(), |beyond, a| {
            let turn = rotation_about(a.axis.direction(), position[a.axis.slot()]);
            let about = a.point_mm;
            Head { rotation: turn * beyond.rotation, shift_mm: about + turn * (beyond.shift_mm - about) }
        })
    }

    /// The entry of an axis.
    #[must_use]
    pub fn axis(&self, axis: Axis) -> Option<&MachineAxis> {
        self.axes.iter().find(|a| a.axis == axis)
    }

    /// Rotary axes between the bed and `axis`, from the bed outwards, and those beyond it.
    #[must_use]
    pub fn around(&self, axis: Axis) -> (Vec<Axis>, Vec<Axis>) {
        let Some(at) = self.axes.iter().position(|a| a.axis == axis) else {
            return (Vec::new(), Vec::new());
        };
        let side = self.axes[at].workpiece_side;
        let rotary = |a: &&MachineAxis| !a.axis.is_linear() && a.workpiece_side == side;
        let before: Vec<Axis> = self.axes[..at].iter().filter(rotary).map(|a| a.axis).rev().collect();
        let after: Vec<Axis> = self.axes[at + 1..].iter().filter(rotary).map(|a| a.axis).collect();
        if side {
            (after.into_iter().rev().collect(), before)
        } else {
            (before.into_iter().rev().collect(), after)
        }
    }
}
