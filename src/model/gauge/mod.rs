//! The gauge: which of many equal descriptions of one machine is the normal one.
//!
//! A constant in an error motion, or a slope in a straightness, says the same as a squareness, a location error or
//! a rigid motion of the workpiece frame W. In the normal form
//! - all six error motions of every axis are zero at one reference pose: home, or the end of travel nearest to it;
//! - the straightnesses of X, Y, Z have no slope under one rule, the line through their end points over the travel;
//! - what was removed stands in the squarenesses and in the location errors of the rotary axes, and what these
//!   cannot hold is one rigid motion of W (and one turn of the tool in its holder), which is reported.
//!
//! Covered are the linear axes that are joined to the bed without a rotary axis between (on usual machines all of
//! them), and the constants of rotary axes. The rest is left as it is and listed.
//!
//! Assumptions: first order. Where a table has a reverse branch, the forward branch decides and both are moved
//! alike. Reference points stay as given: the slope is that of the line on which the straightness was measured.
//!
//! Source: equations 1.8; where constants go follows from the sum of equations 2, see `effect`.

mod effect;
mod line;

use self::effect::Layout;
use self::line::{Line, add_constant, subtract, tidy};
use crate::prelude::*;

/// Below this a length is taken for zero, mm.
const LENGTH_ZERO: f64 = 1e-12;
/// Below this an angle is taken for zero, rad.
const ANGLE_ZERO: f64 = 1e-15;

/// A model in normal form, and how it came about.
#[derive(Debug, Clone, PartialEq)]
pub struct Gauged {
    /// The model in normal form; equal to the original where nothing was moved.
    pub spec: ModelSpec,
    /// What was removed from the error motions, each with where it went.
    pub moved: Vec<Moved>,
    /// The sum of where it all went.
    pub total: Effect,
    /// What has no place to go and stays.
    pub untouched: Vec<Untouched>,
}

/// Something removed from an error motion.
#[derive(Debug, Clone, PartialEq)]
pub struct Moved {
    /// The error motion.
    pub symbol: ErrorSymbol,
    /// Which part of it.
    pub part: Part,
    /// How much, in relative sense: mm or rad; a slope in mm per mm.
    pub amount: f64,
    /// Where it went.
    pub effect: Effect,
}

/// A part of an error motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Part {
    /// Its value at the reference pose.
    Value {
        /// Coordinate of the axis at the reference pose, mm or rad.
        at: f64,
    },
    /// Its slope.
    Slope {
        /// The coordinates between which the line is drawn, mm.
        over: [f64; 2],
    },
}

/// Where removed parts went.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Effect {
    /// Amounts added to squarenesses and location errors, mm or rad.
    pub errors: Vec<(ErrorSymbol, f64)>,
    /// Slopes added to straightnesses of axes that are parallel to X, Y or Z, mm per mm.
    pub slopes: Vec<(ErrorSymbol, f64)>,
    /// What no error can hold.
    pub rigid: RigidShare,
}

/// The part of the original deviation that the normal form leaves out: original minus normal form is
/// `shift + turn x p + G tool_turn x (t - t_model)` in position and `turn + G tool_turn` in rotation, with `p` the
/// nominal tool tip in W, `t` the tool tip in use (M at home) and `G` the turn of the rotary axes on the workpiece
/// side.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct RigidShare {
    /// Shift of W, mm.
    pub shift: Vec3,
    /// Turn of W, rad.
    pub turn: Vec3,
    /// Turn of the tool in its holder, rad, in M; seen in the tool direction and where the tool is changed.
    pub tool_turn: Vec3,
}

/// Something that is not in normal form and stays so.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Untouched {
    /// A linear axis that a rotary axis separates from the bed: its constants are its place on that axis.
    BehindRotary {
        /// The axis.
        axis: AxisName,
    },
    /// A constant of a rotary axis along itself, for which there is no location error.
    AlongItself {
        /// The error motion.
        symbol: ErrorSymbol,
    },
    /// Slopes of an axis parallel to X, Y or Z, for which there is no squareness.
    Parallelism {
        /// The axis.
        axis: AxisName,
    },
    /// No travel and no curve says over which range the lines of this axis are drawn.
    NoRange {
        /// The axis.
        axis: AxisName,
    },
}

impl Effect {
    fn add(&mut self, other: &Self) {
        for (symbol, amount) in &other.errors {
            add_to(&mut self.errors, *symbol, *amount);
        }
        for (symbol, amount) in &other.slopes {
            add_to(&mut self.slopes, *symbol, *amount);
        }
        self.rigid.shift += other.rigid.shift;
        self.rigid.turn += other.rigid.turn;
        self.rigid.tool_turn += other.rigid.tool_turn;
    }
}

/// Adds an amount to the entry of a symbol; nothing where it is zero.
fn add_to(list: &mut Vec<(ErrorSymbol, f64)>, symbol: ErrorSymbol, amount: f64) {
    if amount == 0.0 {
        return;
    }
    match list.iter_mut().find(|(s, _)| *s == symbol) {
        Some((_, sum)) => *sum += amount,
        None => list.push((symbol, amount)),
    }
}

/// Brings a model into its normal form. Doing it twice is the same as doing it once.
///
/// # Errors
/// The model, or its normal form, breaks a rule of [`ModelSpec::validate`].
pub fn normalise(spec: &ModelSpec) -> Result<Gauged, ModelError> {
    let model = Model::new(spec)?;
    let layout = Layout::new(&model, spec);
    let (moved, untouched) = removable(&layout);
    let mut total = Effect::default();
    for m in &moved {
        total.add(&m.effect);
    }
    let mut normal = spec.clone();
    if !moved.is_empty() {
        rewrite(&mut normal, &layout, &moved, &total);
        normal.validate()?;
    }
    Ok(Gauged { spec: normal, moved, total, untouched })
}

/// Everything that the rules remove, and what they cannot.
fn removable(layout: &Layout<'_>) -> (Vec<Moved>, Vec<Untouched>) {
    let mut moved = Vec::new();
    let mut untouched = Vec::new();
    let without_range = layout.parallel_without_range();
    untouched.extend(without_range.map(|axis| Untouched::NoRange { axis }));
    for (k, joint) in layout.model.joints.iter().enumerate() {
        let axis = joint.axis.name;
        if joint.axis.kind() == AxisKind::Linear {
            if !layout.group.contains(&k) {
                if layout.has_motions(axis) {
                    untouched.push(Untouched::BehindRotary { axis });
                }
                continue;
            }
            if without_range.is_some() {
                continue;
            }
            if !is_main(axis) && layout.has_motions(axis) {
                untouched.push(Untouched::Parallelism { axis });
            }
        }
        let (shift, turn) = layout.at_reference(k);
        for component in Component::ALL {
            let i = component.index();
            let (amount, zero) =
                if component.is_angle() { (turn[i - 3], ANGLE_ZERO) } else { (shift[i], LENGTH_ZERO) };
            if amount.abs() <= zero {
                continue;
            }
            let symbol = ErrorSymbol::Motion { component, axis };
            match layout.effect_of_value(k, component, amount) {
                Some(effect) => {
                    let part = Part::Value { at: layout.reference.position[k] };
                    moved.push(Moved { symbol, part, amount, effect });
                }
                None => untouched.push(Untouched::AlongItself { symbol }),
            }
        }
        if joint.axis.kind() == AxisKind::Linear && is_main(axis) {
            moved.extend(removable_slopes(layout, k, axis));
        }
    }
    (moved, untouched)
}

/// The slopes of the two straightnesses of an axis.
fn removable_slopes(layout: &Layout<'_>, k: usize, axis: AxisName) -> Vec<Moved> {
    let Some(over) = layout.spans[k] else { return Vec::new() };
    let length = over[1] - over[0];
    let (low, high) = (layout.shift_at(k, over[0]), layout.shift_at(k, over[1]));
    let straightness = (0..3).filter(|i| *i != axis.direction());
    let slopes = straightness.map(|i| (Component::ALL[i], (high[i] - low[i]) / length));
    slopes
        .filter(|(_, slope)| (slope * length).abs() > LENGTH_ZERO)
        .map(|(component, amount)| Moved {
            symbol: ErrorSymbol::Motion { component, axis },
            part: Part::Slope { over },
            amount,
            effect: layout.effect_of_slope(k, component, amount),
        })
        .collect()
}

/// Takes everything out of the motions and puts it where it goes.
fn rewrite(spec: &mut ModelSpec, layout: &Layout<'_>, moved: &[Moved], total: &Effect) {
    for m in moved {
        let Some(k) = spec.chain.index_of(m.symbol.axis()) else { continue };
        let line = match m.part {
            Part::Value { at } => Line { at, value: m.amount, slope: 0.0 },
            Part::Slope { .. } => Line { at: layout.reference.position[k], value: 0.0, slope: m.amount },
        };
        subtract_relative(spec, layout, k, m.symbol, line);
    }
    for (symbol, slope) in &total.slopes {
        let Some(k) = spec.chain.index_of(symbol.axis()) else { continue };
        let line = Line { at: layout.reference.position[k], value: 0.0, slope: -slope };
        subtract_relative(spec, layout, k, *symbol, line);
    }
    for (symbol, amount) in &total.errors {
        add_constant(function_mut(spec, *symbol), *amount);
    }
    let touched: Vec<ErrorSymbol> = moved
        .iter()
        .map(|m| m.symbol)
        .chain(total.errors.iter().map(|(s, _)| *s))
        .chain(total.slopes.iter().map(|(s, _)| *s))
        .collect();
    spec.errors.retain_mut(|(symbol, function)| {
        if !touched.contains(symbol) {
            return true;
        }
        tidy(function, if symbol.is_angle() { ANGLE_ZERO } else { LENGTH_ZERO });
        !(function.curves.is_empty() && function.grids.is_empty())
    });
}

/// Subtracts a line given in relative sense over the programmed coordinate from a stored function.
fn subtract_relative(spec: &mut ModelSpec, layout: &Layout<'_>, k: usize, symbol: ErrorSymbol, line: Line) {
    let span = layout.spans[k];
    let function = function_mut(spec, symbol);
    if layout.model.joints[k].inverted {
        // E_stored(x) = -E_relative(-x): the value changes its sign, the slope does not
        let mirrored = Line { at: -line.at, value: -line.value, slope: line.slope };
        subtract(function, &mirrored, span.map(|[low, high]| [-high, -low]));
    } else {
        subtract(function, &line, span);
    }
}

/// The function of a symbol, added where the model has none.
fn function_mut(spec: &mut ModelSpec, symbol: ErrorSymbol) -> &mut ErrorFunction {
    let at = spec.errors.iter().position(|(s, _)| *s == symbol).unwrap_or_else(|| {
        spec.errors.push((symbol, ErrorFunction::default()));
        spec.errors.len() - 1
    });
    &mut spec.errors[at].1
}

/// X, Y, Z, whose lines define the squarenesses.
const fn is_main(axis: AxisName) -> bool {
    matches!(axis, AxisName::X | AxisName::Y | AxisName::Z)
}
