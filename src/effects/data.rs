//! What the data of a session hold, as far as it decides which effects they can show.

use crate::frame::RotaryFrame;
use crate::lever::Lever;
use crate::machine_state::{Axis, Light, Machine, MachineState, SLOTS, Source};
use crate::polynomial::stable_degree;
use crate::shape::Shape;
use volcomp_model::geometry::Vec3;
use volcomp_model::spec::ReferenceBody;

/// Smallest change of a temperature that its effects are looked for with, K.
const WARMER_K: f64 = 0.2;
/// The same of the speed of the spindle, 1000 per minute.
const FASTER_KRPM: f64 = 0.05;
/// Words in the name of a sensor of the air.
const AIR: [&str; 4] = ["air", "ambient", "lab", "room"];

/// The columns of a session in a few figures.
#[derive(Debug, Clone, PartialEq)]
pub struct Data {
    /// The chain.
    pub machine: Machine,
    /// Axes with a column.
    pub axes: Vec<Axis>,
    /// Smallest and largest position of each axis that moves, mm or rad.
    pub range: [Option<[f64; 2]>; SLOTS],
    /// Readings were taken while the axis moved.
    pub moves: [bool; SLOTS],
    /// The acceleration of the axis changes.
    pub accelerates: [bool; SLOTS],
    /// The axis was measured in both directions of travel.
    pub reverses: [bool; SLOTS],
    /// Shortest time between a reversal and a reading in motion, s; 0 without any.
    pub soonest_s: [f64; SLOTS],
    /// The same of the way, mm or rad.
    pub nearest: [f64; SLOTS],
    /// The force along an axis changes.
    pub forces: [bool; 3],
    /// Some reading looks along the axis.
    pub sees: [bool; 3],
    /// Different positions of each linear axis, in order, mm.
    pub positions: [Vec<f64>; 3],
    /// Those at which some reading looks along an axis: `[axis that moves][axis looked along]`.
    pub looked_at: [[Vec<f64>; 3]; 3],
    /// Those at which some reading looks along a linear axis itself, and those of a rotary axis, in order, mm or rad.
    pub targets: [Vec<f64>; SLOTS],
    /// Targets of the tests of an axis, in order, mm or rad: `[axis that moves][direction looked along]`. They are those at rest
    /// where nothing else moves in the set-up, along the axis itself all where there is none; empty unless looked at twice in the
    /// mean, because a value of its own for every reading is noise.
    pub tested: [[Vec<f64>; 3]; SLOTS],
    /// Tool lengths differ.
    pub tools: bool,
    /// A tool length is stated.
    pub lengths: bool,
    /// Distances from instrument to target differ.
    pub ranges: bool,
    /// Instruments of each kind of light.
    pub lights: Vec<Light>,
    /// Some reading is of an angle.
    pub angular: bool,
    /// All readings are of angles.
    pub only_angles: bool,
    /// Set-ups of a ballbar.
    pub ballbar_setups: Vec<usize>,
    /// An instrument has a known station.
    pub stations: bool,
    /// All readings were taken in one setup.
    pub one_setup: bool,
    /// All readings are of the encoders of the control, which do not see the structure.
    pub encoders_only: bool,
    /// Files in motion on a clock of the instrument's own, with start and duration of their motion, s.
    pub clocks: Vec<(usize, f64, f64)>,
    /// Logged sources with their range and first value.
    pub sources: Vec<(Source, [f64; 2], f64)>,
    /// Temperatures that go with the speed of the spindle.
    pub follow_spindle: Vec<Source>,
    /// State at the first reading.
    pub first: MachineState,
}

/// Why data cannot show an effect.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Hidden {
    /// In words.
    pub because: String,
    /// Directions of the displacement by which alone an angular error shows in these data.
    pub one_lever: [bool; 3],
    /// It may be at work in these data: they do not record the quantity on which it depends.
    pub is_unrecorded: bool,
}

impl Hidden {
    /// The quantity on which the effect depends was not recorded.
    pub(crate) fn unrecorded(because: &str) -> Self {
        Self { is_unrecorded: true, ..because.into() }
    }
}

impl<T: Into<String>> From<T> for Hidden {
    fn from(because: T) -> Self {
        Self { because: because.into(), one_lever: [false; 3], is_unrecorded: false }
    }
}

/// Variants of an effect.
pub type Variants = Result<Vec<Shape>, Hidden>;

/// The variants of an effect that is found by a test of its own and has no formula.
pub(crate) fn no_formula(_: &Data, _: &crate::Subject) -> Variants {
    Ok(Vec::new())
}

impl Data {
    /// The range of a linear axis that moves; an axis of the machine that does not is said to stand still.
    pub(crate) fn moved(&self, axis: Axis) -> Result<Option<[f64; 2]>, Hidden> {
        match self.range[axis.slot()] {
            None if axis.is_linear() && self.machine.axis(axis).is_some() => Err(self.stands(axis)),
            range => Ok(range),
        }
    }

    fn stands(&self, axis: Axis) -> Hidden {
        if self.axes.contains(&axis) {
            "the axis stands still in these data".into()
        } else {
            format!("no column {}", axis.column()).into()
        }
    }

    /// Variants of an effect of the structure: encoders of the control do not see it.
    pub(crate) fn structural(&self, shapes: Vec<Shape>) -> Variants {
        if self.encoders_only && !shapes.is_empty() {
            return Err("the control's own encoders do not see the structure; measure at the tool".into());
        }
        Ok(shapes)
    }

    /// A rotary axis turns the tool.
    pub(crate) fn head(&self) -> bool {
        self.machine.head_axes().any(|a| self.range[a.axis.slot()].is_some())
    }

    /// Those of some degrees for which the positions of an axis suffice, so that a curve does not swing between them; with
    /// `along`, the positions at which readings look along that axis.
    pub(crate) fn degrees(&self, axis: Axis, along: Option<Axis>, all: &[usize]) -> Vec<usize> {
        let positions = match along {
            Some(along) => &self.looked_at[axis.slot()][along.slot()],
            None => &self.positions[axis.slot()],
        };
        let most = stable_degree(positions, all.iter().copied().max().unwrap_or(0));
        all.iter().copied().filter(|d| *d <= most).collect()
    }

    /// What lies between an angular error of an axis and the tool.
    pub(crate) fn lever(&self, axis: Axis) -> Lever {
        let home = match (self.tools, self.machine.gauge_point_mm) {
            (true, Some(g)) => g,
            _ => self.machine.tool_tip_mm,
        };
        Lever { axes: self.machine.levers_of(axis), home_mm: home.into(), tool: self.tools }
    }

    /// From the nose to where levers with the tool begin, mm: to the tip of the model's tool where lengths are not stated.
    pub(crate) fn below_nose(&self) -> Vec3 {
        let nose = self.machine.gauge_point_mm.filter(|_| !self.tools);
        nose.map_or_else(Vec3::zeros, |nose| self.machine.tool_tip_mm - nose)
    }

    /// What lies between the reference points of a linear axis and the tool, for its angular error about a direction.
    pub(crate) fn arm(&self, axis: Axis, about: Axis) -> Lever {
        let mut lever = self.lever(axis);
        let Some(entry) = self.machine.axis(axis) else { return lever };
        for k in (0..3).filter(|k| *k != about.direction()) {
            // the k-th coordinate of a lever displaces along the third direction
            let reference = entry.reference_points[3 - k - about.direction()];
            lever.home_mm[k] -= reference.point[k];
            if k == axis.slot() && reference.body == ReferenceBody::Bed {
                lever.axes[k] = !lever.axes[k];
            }
        }
        lever
    }

    /// Where a rotary axis that turns stands.
    pub(crate) fn frame(&self, axis: Axis) -> Option<RotaryFrame> {
        self.range[axis.slot()]?;
        let machine = &self.machine;
        let (outer, inner) = machine.around(axis);
        let point = |a: &Axis| machine.axis(*a).map_or([0.0; 3], |e| e.point_mm.into());
        Some(RotaryFrame {
            axis,
            workpiece_side: machine.axis(axis).is_some_and(|e| e.workpiece_side),
            point_mm: point(&axis),
            outer_points_mm: outer.iter().map(point).collect(),
            outer,
            inner_points_mm: inner.iter().map(point).collect(),
            inner,
            tip_mm: machine.tool_tip_mm.into(),
            nose_mm: machine.gauge_point_mm.filter(|_| self.lengths).map(Into::into),
        })
    }

    /// True where the speed of the spindle is logged and changes.
    pub(crate) fn spindle_runs(&self) -> bool {
        self.sources.iter().any(|(s, [low, high], _)| *s == Source::Spindle && high - low >= FASTER_KRPM)
    }

    /// Temperatures that change, with their first value.
    pub(crate) fn temperatures(&self) -> impl Iterator<Item = (&Source, f64)> {
        let changes = |[low, high]: &[f64; 2]| high - low >= WARMER_K;
        let of = move |(s, range, first): &'_ (Source, [f64; 2], f64)| {
            (matches!(s, Source::Temperature(_)) && changes(range)).then_some(*first)
        };
        self.sources.iter().filter_map(move |e| Some((&e.0, of(e)?)))
    }

    /// True for the temperature of a spindle, by its name, or by its course where its name does not say air.
    pub(crate) fn is_of_spindle(&self, source: &Source) -> bool {
        is_spindle(source) || self.follow_spindle.contains(source) && !names(source, &AIR)
    }

    /// Temperatures of the air that change.
    pub(crate) fn air(&self) -> impl Iterator<Item = &Source> {
        self.temperatures().map(|t| t.0).filter(|s| names(s, &AIR))
    }
}

/// True for the temperature of a spindle by its name.
pub(crate) fn is_spindle(source: &Source) -> bool {
    names(source, &["spindle"])
}

fn names(source: &Source, words: &[&str]) -> bool {
    matches!(source, Source::Temperature(name) if words.iter().any(|w| name.contains(w)))
}
