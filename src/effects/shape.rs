//! A formula: deviation of the tool against the workpiece, in machine axes and um, per unit of each parameter.
//!
//! Assumptions: small errors, so that effects add; references at zero (angular and rotary errors vanish at the zero of
//! their axis), so that none of them carries a squareness or a location error. Everything is linear in the parameters;
//! what is not (time constants, lengths, pitches) belongs to the shape itself and is searched over a grid.
//! Source: the catalogue of the diagnosis; equations 1 for squareness, angular errors and locations.

use crate::Signal;
use crate::addition::Entry;
use crate::drawing::{Drawing, Over};
use crate::extend::{Becomes, Extended, OF_THE_INSTRUMENT};
use crate::machine_state::{Axis, MachineState};
use volcomp_model::geometry::Vec3;
use volcomp_units::{RAD_PER_ARCSEC, UM_PER_MM};

pub use crate::library::Shape;

/// Most parameters of one shape.
pub const WIDTH_MAX: usize = 40;
/// Movement below this is standstill, mm/s or rad/s.
pub const STILL: f64 = 1e-6;
/// um per arcsec and mm of lever.
pub(crate) const UM_PER_ARCSEC_MM: f64 = RAD_PER_ARCSEC * UM_PER_MM;
/// Reference temperature of lengths, ISO 1.
pub const REFERENCE_DEGC: f64 = 20.0;

/// Value of a lagged signal; NaN where it is not known.
pub(crate) type Read<'a> = dyn Fn(&Signal) -> f64 + 'a;
/// Smallest and largest position of an axis in the data, mm or rad.
pub type Span<'a> = dyn Fn(Axis) -> [f64; 2] + 'a;

/// How a deviation lies in the machine.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Traits {
    /// The direction of the deviation, where it is a single one.
    pub(crate) acts_along: Option<Axis>,
    /// The axis of whose position it is a function, where there is one.
    pub(crate) over: Option<Axis>,
    /// The rotary axis about whose direction it turns, where it does.
    pub(crate) turns: Option<Axis>,
    /// False for what happens behind the control's own encoders, which do not see it.
    pub(crate) is_of_drive: bool,
    /// True for curves that bend to anything smooth.
    pub(crate) is_free_curve: bool,
    /// True where the columns keep their proportions: the parameters of a random process are all equally large.
    pub(crate) is_process: bool,
}

impl Traits {
    /// A deviation along one axis that is a function of the position of one.
    pub(crate) fn motion(along: Axis, over: Axis) -> Self {
        Self { acts_along: Some(along), over: Some(over), ..Self::default() }
    }

    /// A turn of a rotary axis that is a function of its own position, and that its encoder sees.
    pub(crate) fn rotation(axis: Axis) -> Self {
        Self { over: Some(axis), turns: Some(axis), is_of_drive: true, ..Self::default() }
    }
}

/// What the formula of a shape says.
pub(crate) trait Form {
    /// The name of each parameter; it ends in its unit.
    fn parameters(&self) -> Vec<String>;

    /// Number of parameters.
    fn width(&self) -> usize {
        1
    }

    /// The deviation per unit of each parameter, um.
    fn evaluate(&self, m: &MachineState, read: &Read<'_>, out: &mut [Vec3]);

    /// Columns (`docs/reference/session-files.md` 1) that it needs: those over which it is drawn.
    fn columns(&self) -> Vec<String> {
        self.drawing().columns()
    }

    /// How it is drawn: over the position of its axis, or over time.
    fn drawing(&self) -> Drawing {
        self.traits().over.map_or(Over::Time, Over::Position).into()
    }

    /// What it becomes in a model, or why it stays out, as all that belongs to the instrument does.
    fn becomes(&self, _model: &Extended, _entry: &Entry) -> Becomes {
        Err(OF_THE_INSTRUMENT)
    }

    /// The non-linear parameters, for a person to read.
    fn fixed(&self) -> Vec<(String, f64)> {
        Vec::new()
    }

    /// Largest deviation per unit of the first parameter where that is a peak over time; none elsewhere.
    fn peak(&self) -> Option<f64> {
        None
    }

    /// False where a length or time is not above zero or a place is not finite.
    fn is_valid(&self) -> bool {
        true
    }

    /// Copies with each of the parameters that refine it changed by a factor near 1.
    fn changed(&self, _factor: f64) -> Vec<Shape> {
        Vec::new()
    }

    /// False where a parameter has left the range in which the effect is what its name says.
    fn is_itself(&self) -> bool {
        true
    }

    /// The same against the positions in the data and the place of the tool at home, mm.
    fn is_within(&self, _span: &Span<'_>, _tip_mm: [f64; 3]) -> bool {
        true
    }

    /// How its deviation lies in the machine.
    fn traits(&self) -> Traits {
        Traits::default()
    }

    /// The lagged signals that it reads.
    fn signals(&self) -> Vec<&Signal> {
        Vec::new()
    }

    /// Distance (mm) and time (s) since a reversal over which it builds up.
    fn builds_up(&self) -> (f64, f64) {
        (f64::INFINITY, f64::INFINITY)
    }
}

impl Shape {
    /// Number of parameters.
    #[must_use]
    pub fn width(&self) -> usize {
        self.form().width()
    }

    /// The name of each parameter; it ends in its unit.
    #[must_use]
    pub fn parameters(&self) -> Vec<String> {
        self.form().parameters()
    }

    /// The non-linear parameters, for a person to read.
    #[must_use]
    pub fn fixed(&self) -> Vec<(String, f64)> {
        self.form().fixed()
    }

    /// Largest deviation per unit of the first parameter where that is a peak over time.
    #[must_use]
    pub fn peak(&self) -> Option<f64> {
        self.form().peak()
    }

    /// How it is drawn.
    #[must_use]
    pub fn drawing(&self) -> Drawing {
        self.form().drawing()
    }

    /// The deviation per unit of each parameter, um; `at` gives the place of a signal in [`MachineState::signals`].
    pub fn evaluate_with(&self, m: &MachineState, at: &dyn Fn(&Signal) -> Option<usize>, out: &mut [Vec3]) {
        if m.is_encoder && !self.form().traits().is_of_drive {
            return out.fill(Vec3::zeros());
        }
        let read = |s: &Signal| at(s).and_then(|i| m.signals.get(i)).copied().unwrap_or(f64::NAN);
        self.form().evaluate(m, &read, out);
        if m.is_angular() {
            let mut opposite = [Vec3::zeros(); WIDTH_MAX];
            let opposite = &mut opposite[..out.len()];
            self.form().evaluate(&m.opposite(), &read, opposite);
            out.iter_mut().zip(opposite).for_each(|(d, o)| *d = 0.5 * (*d - *o));
        }
    }

    /// True where all that the effect needs is known: no part of its deviation is NaN.
    #[must_use]
    pub fn is_known_at(&self, m: &MachineState, at: &dyn Fn(&Signal) -> Option<usize>) -> bool {
        let mut out = [Vec3::zeros(); WIDTH_MAX];
        let out = &mut out[..self.width()];
        self.evaluate_with(m, at, out);
        out.iter().flatten().all(|v| v.is_finite())
    }

    /// Copies whose non-linear parameters are a little larger or smaller.
    #[must_use]
    pub fn neighbours(&self, step: f64) -> Vec<Self> {
        let [up, down] = [1.0 + step, 1.0 / (1.0 + step)].map(|factor| self.form().changed(factor));
        let pairs = up.into_iter().zip(down).flat_map(|(up, down)| [up, down]);
        pairs.filter(|s| s != self && s.form().is_itself()).collect()
    }

    /// False where a parameter has left the range in which the data and the machine (tool tip at home, mm) let the effect be
    /// what its name says.
    #[must_use]
    pub fn is_within(&self, span: &Span<'_>, tip_mm: [f64; 3]) -> bool {
        self.form().is_within(span, tip_mm)
    }

    /// The direction of the deviation, where it is a single one.
    #[must_use]
    pub fn acts_along(&self) -> Option<Axis> {
        self.form().traits().acts_along
    }

    /// The axis of whose position it is a function, where there is one.
    #[must_use]
    pub fn over(&self) -> Option<Axis> {
        self.form().traits().over
    }

    /// Direction and axis of an error motion that is a function of that axis's position alone; of an angle the rotary axis about its
    /// direction.
    #[must_use]
    pub fn error_motion(&self) -> Option<(Axis, Axis)> {
        let Traits { acts_along, turns, over, .. } = self.form().traits();
        acts_along.or(turns).zip(over)
    }

    /// True for curves that bend to anything smooth.
    #[must_use]
    pub fn is_free_curve(&self) -> bool {
        self.form().traits().is_free_curve
    }

    /// True where the columns keep their proportions: the parameters of a random process are all equally large.
    #[must_use]
    pub fn is_process(&self) -> bool {
        self.form().traits().is_process
    }

    /// The lagged signals that it reads.
    #[must_use]
    pub fn signals(&self) -> Vec<&Signal> {
        self.form().signals()
    }
}

/// The unit vector from station to target, where an instrument has a station.
#[must_use]
pub fn line_of_sight(m: &MachineState) -> Option<Vec3> {
    let line = m.reflector_mm - m.station_mm;
    let length = line.norm();
    (length > 0.0 && length.is_finite()).then(|| line / length)
}
