//! Several measurements of one machine into one model.
//!
//! 1. Every source is brought to relative sense and, with the core's gauge, to its own normal form. What the gauge
//!    would put into a squareness or a location error that the source does not state is the set-up of its instrument
//!    (how the straight edge lay, how the level stood): it is dropped and reported, never added to somebody else's
//!    squareness. A source that is `absolute` measured all lines in one set-up: there it is kept.
//! 2. An error that several sources state is compared where their ranges overlap, after transfer to one reference
//!    point with the angular errors (Abbe and Bryan levers, equations 1.5). The constant of the set-up, and for
//!    straightness the line, are fitted out; `chi2 = SUM d^2/(u1^2 + u2^2)` over as many places as the coarser curve has
//!    numbers.
//! 3. What agrees becomes one curve: the mean weighted by `1/u^2`, tapered where one source ends inside the other.
//!    What does not agree is refused, unless one source is preferred or the mean is asked for; the mean then carries
//!    the uncertainty that its scatter shows (Birge).
//! 4. Squarenesses and locations belong to the lines of their source (range, reference points, reference pose). Each is
//!    transferred to the lines of the assembled model by what the gauge says about the assembled motions in the
//!    source's layout, and only then compared and averaged (equations 1.8). No slope is counted twice.
//!
//! Assumptions: first order; uncertainties of different sources are independent; a stated uncertainty holds for each of
//! the compared places.
//!
//! Source: equations 1.4, 1.5, 1.8. Reading order: this file, `curves` (sense, reference points), `overlap`
//! (comparison and mean of curves), `constants`, `error`.

mod constants;
mod curves;
mod error;
mod overlap;

pub use curves::mirrored_curve;
pub use error::AssembleError;

use volcomp_model::gauge::{Gauged, Part, normalise};
use volcomp_model::spec::{ReferencePoint, Sense};
use volcomp_model::{AxisSpec, Component, ErrorFunction, ErrorSymbol, ModelError, ModelSpec};
use volcomp_units::axes::{AxisKind, AxisName};

/// One measurement, as a model that states some errors.
#[derive(Debug, Clone, PartialEq)]
pub struct Source {
    /// What it is called in messages.
    pub name: String,
    /// What it states.
    pub spec: ModelSpec,
    /// All its lines and angles were measured in one set-up, so that constants and slopes mean squareness and location.
    pub absolute: bool,
}

/// What to do where sources overlap.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Chain, frame and axes of the result; those of the first source where absent.
    pub base: Option<ModelSpec>,
    /// Sources to take where several state an error: index, and for which error (all where absent).
    pub prefer: Vec<(usize, Option<ErrorSymbol>)>,
    /// Errors whose mean is taken even where the sources do not agree; `Some(None)` for all.
    pub average: Option<Option<Vec<ErrorSymbol>>>,
    /// Probability below which sources are said to disagree.
    pub significance: f64,
    /// Standard uncertainty of lengths for sources that state none, mm.
    pub std_length: Option<f64>,
    /// The same for angles, rad.
    pub std_angle: Option<f64>,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            base: None,
            prefer: Vec::new(),
            average: None,
            significance: 0.01,
            std_length: None,
            std_angle: None,
        }
    }
}

/// The assembled model and how it came about.
#[derive(Debug, Clone, PartialEq)]
pub struct Assembled {
    /// The model, in normal form.
    pub spec: ModelSpec,
    /// Where each error came from.
    pub errors: Vec<Origin>,
    /// Every comparison of two sources.
    pub checks: Vec<Check>,
    /// Set-ups of instruments that were taken out.
    pub dropped: Vec<Dropped>,
    /// The gauge of the result: nothing is left to be moved.
    pub gauge: Gauged,
}

/// Where an error of the result came from.
#[derive(Debug, Clone, PartialEq)]
pub struct Origin {
    /// The error.
    pub symbol: ErrorSymbol,
    /// How it was made.
    pub how: How,
    /// The sources by index, each with its share.
    pub from: Vec<(usize, f64)>,
}

/// How an error of the result was made.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum How {
    /// One source states it.
    Only,
    /// Several state the same.
    Same,
    /// Mean over the same range.
    Mean,
    /// Ranges joined, mean where they overlap.
    Joined,
    /// One source was preferred.
    Preferred,
}

/// A comparison of two sources, second minus first.
#[derive(Debug, Clone, PartialEq)]
pub struct Check {
    /// The error.
    pub symbol: ErrorSymbol,
    /// The sources by index.
    pub sources: [usize; 2],
    /// Range that both cover, mm or rad, relative sense; `None` for a constant.
    pub over: Option<[f64; 2]>,
    /// Places compared.
    pub places: usize,
    /// Constant of the set-up that was fitted out, mm or rad.
    pub constant: f64,
    /// Slope of the set-up that was fitted out, per mm or rad.
    pub slope: f64,
    /// Largest difference that is left, mm or rad, with its sign.
    pub largest: f64,
    /// Where.
    pub at: f64,
    /// Root mean square of what is left, mm or rad.
    pub rms: f64,
    /// Uncertainty (k = 1) of a single difference, where both are known, mm or rad.
    pub std: Option<f64>,
    /// Sum of squares over `std^2`.
    pub chi_square: Option<f64>,
    /// Degrees of freedom.
    pub dof: usize,
    /// Probability of at least this chi-square where both are right.
    pub p: Option<f64>,
}

impl Check {
    /// True where both say the same number by number.
    #[must_use]
    pub fn is_identical(&self) -> bool {
        self.largest.abs() <= if self.symbol.is_angle() { 1e-12 } else { 1e-9 }
    }
}

/// Something that says how an instrument stood, and nothing about the machine.
#[derive(Debug, Clone, PartialEq)]
pub struct Dropped {
    /// The source by index.
    pub source: usize,
    /// The error in which it was.
    pub symbol: ErrorSymbol,
    /// Its value at the reference pose, or its slope.
    pub part: Part,
    /// How much, mm or rad; a slope in mm per mm.
    pub amount: f64,
    /// Where it would have gone, had the source stated that error.
    pub unstated: Vec<ErrorSymbol>,
}

/// A source brought to relative sense and normal form.
struct Ready {
    spec: ModelSpec,
    /// Range of every axis.
    travel: Vec<(AxisName, [f64; 2])>,
    /// What the curves of each error motion cover, before the gauge put a line beside them.
    covered: Vec<(ErrorSymbol, [f64; 2])>,
}

/// Puts sources together.
///
/// # Errors
/// Sources of different machines, sources that contradict each other, overlaps that nothing decides.
pub fn assemble(sources: &[Source], options: &Options) -> Result<Assembled, AssembleError> {
    let base = base(sources, options)?;
    let mut dropped = Vec::new();
    let mut ready = Vec::with_capacity(sources.len());
    for (i, source) in sources.iter().enumerate() {
        agrees_with(source, &base)?;
        ready.push(prepare(i, source, &mut dropped)?);
    }
    let mut motions = relative(&base);
    motions.errors.clear();
    let mut assembly = Assembly {
        sources,
        options,
        ready: &ready,
        checks: Vec::new(),
        errors: Vec::new(),
        conflicts: Vec::new(),
    };
    assembly.motions(&mut motions)?;
    let motions = without_set_up(&motions)?;
    let constants = assembly.constants(&motions)?;
    if !assembly.conflicts.is_empty() {
        let names = sources.iter().map(|s| s.name.clone()).collect();
        return Err(AssembleError::Inconsistent { checks: assembly.conflicts, names });
    }
    let mut whole = motions;
    whole.errors.extend(constants);
    let gauge = normalise(&whole).map_err(result_error)?;
    let spec = in_sense_of(&gauge.spec, &base);
    spec.validate().map_err(result_error)?;
    let (errors, checks) = (assembly.errors, assembly.checks);
    if errors.is_empty() {
        return Err(AssembleError::Empty);
    }
    Ok(Assembled { spec, errors, checks, dropped, gauge })
}

fn result_error(error: ModelError) -> AssembleError {
    AssembleError::Model { source_name: "the assembled model".to_owned(), error }
}

/// Chain, frame and axes of the result without errors; the travel is the hull of all.
fn base(sources: &[Source], options: &Options) -> Result<ModelSpec, AssembleError> {
    let first =
        options.base.as_ref().or_else(|| sources.first().map(|s| &s.spec)).ok_or(AssembleError::Empty)?;
    let mut base = ModelSpec { errors: Vec::new(), ..first.clone() };
    if base.machine == UNNAMED
        && let Some(named) = sources.iter().find(|s| s.spec.machine != UNNAMED)
    {
        base.machine.clone_from(&named.spec.machine);
    }
    base.vertical = base.vertical.or_else(|| sources.iter().find_map(|s| s.spec.vertical));
    for axis in base.chain.clone().axes() {
        let stating = sources.iter().find(|s| states(&s.spec, axis.name));
        let mut entry = base.axis(axis.name);
        if options.base.is_none() {
            // what the measurements of this axis refer to, not what another file has as its default
            if let Some(source) = stating {
                entry = source.spec.axis(axis.name);
            }
            let travels = sources.iter().filter_map(|s| s.spec.axis(axis.name).travel);
            entry.travel = travels.reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])]);
        }
        base.axes.retain(|a| a.name != axis.name);
        // a spindle has an entry only where somebody says something about it
        if !axis.spindle || entry != AxisSpec::new(axis.name) {
            base.axes.push(entry);
        }
    }
    Ok(base)
}

/// Machine id of files that were written without one.
const UNNAMED: &str = "unnamed";

/// True where a source has an error of an axis.
fn states(spec: &ModelSpec, axis: AxisName) -> bool {
    spec.errors.iter().any(|(s, _)| s.axis() == axis)
}

fn agrees_with(source: &Source, base: &ModelSpec) -> Result<(), AssembleError> {
    let source_name = source.name.clone();
    let spec = &source.spec;
    if spec.chain != base.chain {
        return Err(AssembleError::Chain {
            source_name,
            found: spec.chain.clone(),
            expected: base.chain.clone(),
        });
    }
    if spec.machine != base.machine && spec.machine != UNNAMED && base.machine != UNNAMED {
        return Err(AssembleError::Machine {
            source_name,
            found: spec.machine.clone(),
            expected: base.machine.clone(),
        });
    }
    for axis in base.chain.axes().iter().filter(|a| base.is_workpiece_side(a.name)).map(|a| a.name) {
        let live = spec.errors.iter().any(|(s, f)| s.axis() == axis && !f.live.is_empty());
        if live && spec.axis(axis).sense != base.axis(axis).sense {
            return Err(AssembleError::LiveSense { source_name, axis });
        }
    }
    for axis in base.chain.axes().iter().filter(|a| a.kind() == AxisKind::Rotary && states(spec, a.name)) {
        let (found, expected) = (spec.axis(axis.name).point, base.axis(axis.name).point);
        if (found - expected).amax() > POINT_TOLERANCE {
            return Err(AssembleError::AxisPoint { source_name, axis: axis.name, found, expected });
        }
    }
    Ok(())
}

/// Points on a rotary axis closer than this are the same, mm.
const POINT_TOLERANCE: f64 = 1e-6;

/// A specification with all axes in relative sense.
fn relative(spec: &ModelSpec) -> ModelSpec {
    let mut out = spec.clone();
    for axis in spec.chain.axes() {
        turn_sense(&mut out, axis.name, Sense::Relative);
    }
    out
}

/// The result in the senses of the base.
fn in_sense_of(spec: &ModelSpec, base: &ModelSpec) -> ModelSpec {
    let mut out = spec.clone();
    for axis in base.chain.axes() {
        turn_sense(&mut out, axis.name, base.axis(axis.name).sense);
    }
    out
}

fn turn_sense(spec: &mut ModelSpec, axis: AxisName, to: Sense) {
    let from = spec.axis(axis).sense;
    if from == to {
        return;
    }
    if spec.is_workpiece_side(axis) {
        for (_, function) in spec.errors.iter_mut().filter(|(s, _)| s.axis() == axis && !s.is_constant()) {
            *function = curves::mirrored(function, axis);
        }
    }
    if let Some(entry) = spec.axes.iter_mut().find(|a| a.name == axis) {
        entry.sense = to;
    }
}

/// Relative sense and normal form; what is only set-up goes to `dropped`.
fn prepare(index: usize, source: &Source, dropped: &mut Vec<Dropped>) -> Result<Ready, AssembleError> {
    let error = |error| AssembleError::Model { source_name: source.name.clone(), error };
    let spec = relative(&source.spec);
    let travel = ranges(&spec);
    let covered = spec.errors.iter().filter_map(|(s, f)| Some((*s, hull(f)?))).collect();
    let gauged = normalise(&spec).map_err(error)?;
    let mut normal = gauged.spec;
    if !source.absolute {
        let stated = |symbol: &ErrorSymbol| spec.error(*symbol).is_some();
        let unstated = |s: &ErrorSymbol| s.is_constant() && !stated(s);
        normal.errors.retain(|(s, _)| !unstated(s));
        for moved in gauged.moved {
            let lost: Vec<ErrorSymbol> =
                moved.effect.errors.iter().map(|(s, _)| *s).filter(unstated).collect();
            if !lost.is_empty() {
                let (symbol, part, amount) = (moved.symbol, moved.part, moved.amount);
                dropped.push(Dropped { source: index, symbol, part, amount, unstated: lost });
            }
        }
    }
    Ok(Ready { spec: normal, travel, covered })
}

/// What the curves of a function cover in all.
fn hull(f: &ErrorFunction) -> Option<[f64; 2]> {
    f.curves.iter().filter_map(|c| c.range()).reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])])
}

/// Range of every axis: its travel, else what its curves cover.
fn ranges(spec: &ModelSpec) -> Vec<(AxisName, [f64; 2])> {
    let of = |axis: AxisName| {
        let curves = spec.errors.iter().filter(|(s, _)| s.axis() == axis).filter_map(|(_, f)| hull(f));
        spec.axis(axis).travel.or(curves.reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])]))
    };
    spec.chain.axes().iter().filter_map(|a| Some((a.name, of(a.name)?))).collect()
}

/// The motions in normal form, whatever constants that would make: they are those of the lines chosen, and the
/// squarenesses are transferred to these lines.
fn without_set_up(motions: &ModelSpec) -> Result<ModelSpec, AssembleError> {
    let mut spec = normalise(motions).map_err(result_error)?.spec;
    spec.errors.retain(|(s, _)| !s.is_constant());
    Ok(spec)
}

/// The work on the errors.
struct Assembly<'a> {
    sources: &'a [Source],
    options: &'a Options,
    ready: &'a [Ready],
    checks: Vec<Check>,
    errors: Vec<Origin>,
    conflicts: Vec<Check>,
}

/// An error as one source states it.
struct Candidate {
    source: usize,
    function: ErrorFunction,
}

impl Assembly<'_> {
    fn name(&self, source: usize) -> String {
        self.sources[source].name.clone()
    }

    /// The sources that state an error.
    fn stating(&self, symbol: ErrorSymbol) -> Vec<Candidate> {
        let of = |(source, ready): (usize, &Ready)| {
            let function = ready.spec.error(symbol)?;
            Some(Candidate { source, function: function.clone() })
        };
        self.ready.iter().enumerate().filter_map(of).collect()
    }

    /// The source that the user prefers for an error, where it states it; a preference by error comes first.
    fn preferred(&self, symbol: ErrorSymbol, candidates: &[Candidate]) -> Option<usize> {
        let has = |source: usize| candidates.iter().any(|c| c.source == source);
        let by = |wanted: Option<ErrorSymbol>| {
            self.options
                .prefer
                .iter()
                .find(|(source, s)| *s == wanted && has(*source))
                .map(|(source, _)| *source)
        };
        by(Some(symbol)).or_else(|| by(None))
    }

    fn averages(&self, symbol: ErrorSymbol) -> bool {
        match &self.options.average {
            None => false,
            Some(None) => true,
            Some(Some(list)) => list.contains(&symbol),
        }
    }

    /// Uncertainty of an error, stated or assumed.
    fn std(&self, symbol: ErrorSymbol, function: &ErrorFunction) -> Option<f64> {
        let assumed = if symbol.is_angle() { self.options.std_angle } else { self.options.std_length };
        function.std.filter(|s| *s > 0.0).or(assumed)
    }

    /// Fills in all error motions: angles first, because reference points are tied together by them.
    fn motions(&mut self, result: &mut ModelSpec) -> Result<(), AssembleError> {
        for axis in result.chain.clone().axes() {
            let components =
                [Component::A, Component::B, Component::C, Component::X, Component::Y, Component::Z];
            for component in components {
                self.motion(result, ErrorSymbol::Motion { component, axis: axis.name })?;
            }
        }
        result.errors.sort_by_key(|(s, _)| *s);
        Ok(())
    }

    fn motion(&mut self, result: &mut ModelSpec, symbol: ErrorSymbol) -> Result<(), AssembleError> {
        let mut candidates = self.stating(symbol);
        let axis = symbol.axis();
        let preferred = self.preferred(symbol, &candidates);
        let Some(first) = preferred.or(candidates.first().map(|c| c.source)) else { return Ok(()) };
        // each component keeps the point at which it was measured
        if !symbol.is_angle() && axis.kind() == AxisKind::Linear {
            let point = self.point(first, symbol);
            if let Some(entry) = result.axes.iter_mut().find(|a| a.name == axis) {
                entry.reference_points[symbol.component().index()] = point;
            }
            for c in candidates.iter_mut().filter(|c| c.source != first) {
                match self.at_point(result, c, symbol, &point) {
                    Ok(function) => c.function = function,
                    // what is not used need not be transferred
                    Err(_) if preferred.is_some() => c.function = ErrorFunction::default(),
                    Err(e) => return Err(e),
                }
            }
            candidates.retain(|c| c.source == first || c.function != ErrorFunction::default());
        }
        let function = self.combined(symbol, candidates, preferred)?;
        result.errors.push((symbol, function));
        Ok(())
    }

    /// The point at which a source measured a component.
    fn point(&self, source: usize, symbol: ErrorSymbol) -> ReferencePoint {
        self.ready[source].spec.axis(symbol.axis()).reference_points[symbol.component().index()]
    }

    /// A candidate transferred to another reference point with its own angles, else with those of the result.
    fn at_point(
        &self,
        result: &ModelSpec,
        candidate: &Candidate,
        symbol: ErrorSymbol,
        to: &ReferencePoint,
    ) -> Result<ErrorFunction, AssembleError> {
        let own = &self.ready[candidate.source].spec;
        let from = self.point(candidate.source, symbol);
        curves::transferred(
            &candidate.function,
            symbol,
            &from,
            to,
            own.is_workpiece_side(symbol.axis()),
            |angle| own.error(angle).or_else(|| result.error(angle)).cloned(),
        )
        .map_err(|(angle, lever_mm)| AssembleError::NoAngle {
            symbol,
            source_name: self.name(candidate.source),
            angle,
            lever_mm,
        })
    }
}

#[cfg(test)]
mod tests;
