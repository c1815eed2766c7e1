//! A trace and its deviations.

use super::{Direction, Flank, Gear, GearError, Part, Quantity, class};

/// Fewest readings in the evaluation length.
const LEAST: usize = 5;
/// Largest share of the evaluation length without a reading.
const GAP_SHARE: f64 = 0.2;

/// Deviations of one flank along one direction.
#[derive(Debug, Clone, PartialEq)]
pub struct GearTrace {
    /// Along what.
    pub direction: Direction,
    /// Number of the tooth.
    pub tooth: u32,
    /// Which of its flanks.
    pub flank: Flank,
    /// Position (mm) and deviation (um), in order of position.
    pub readings: Vec<(f64, f64)>,
}

/// Deviations by the standard, um.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Deviations {
    /// Total deviation `F`: distance of two design lines that enclose the trace.
    pub total_um: f64,
    /// Form deviation `f_f`: distance of two lines parallel to the mean line that enclose the trace.
    pub form_um: f64,
    /// Slope deviation `f_H`: rise of the mean line over the functional length; plus where material grows with the
    /// position.
    pub slope_um: f64,
    /// Mean line: value at position 0 (um) and slope (um/mm).
    pub mean_line: [f64; 2],
}

/// Evaluates a trace.
///
/// # Errors
/// Too few readings, a gap in the evaluation length, or a reading that is no number.
pub fn evaluate(gear: &Gear, trace: &GearTrace) -> Result<Deviations, GearError> {
    let Part { functional, evaluation } = gear.part(trace.direction);
    let tooth = trace.tooth;
    if trace.readings.iter().any(|(p, d)| !(p.is_finite() && d.is_finite())) {
        return Err(GearError::NotFinite { tooth });
    }
    // positions computed from rolled angles meet the ends only to rounding
    let within = |[low, high]: [f64; 2], p: f64| (low - 1e-6..=high + 1e-6).contains(&p);
    let inside: Vec<(f64, f64)> =
        trace.readings.iter().copied().filter(|r| within(evaluation, r.0)).collect();
    check_cover(tooth, evaluation, &inside)?;
    let n = inside.len() as f64;
    let (x, y) = inside.iter().fold((0.0, 0.0), |(x, y), r| (x + r.0 / n, y + r.1 / n));
    let (xx, xy) =
        inside.iter().fold((0.0, 0.0), |(xx, xy), r| (xx + (r.0 - x).powi(2), xy + (r.0 - x) * (r.1 - y)));
    let slope = xy / xx;
    let mean_line = [y - slope * x, slope];
    let in_zone = |r: &&(f64, f64)| within(functional, r.0) && !within(evaluation, r.0);
    let zone: Vec<(f64, f64)> = trace.readings.iter().filter(in_zone).copied().collect();
    let width = |slope: f64| {
        let off = |r: &(f64, f64)| r.1 - slope * r.0;
        let low = inside.iter().map(off).fold(f64::INFINITY, f64::min);
        // in the zones only excess of material counts
        let high = inside.iter().chain(&zone).map(off).fold(f64::NEG_INFINITY, f64::max);
        high - low
    };
    Ok(Deviations {
        total_um: width(0.0),
        form_um: width(slope),
        slope_um: slope * (functional[1] - functional[0]),
        mean_line,
    })
}

fn check_cover(tooth: u32, [from, to]: [f64; 2], inside: &[(f64, f64)]) -> Result<(), GearError> {
    if inside.len() < LEAST {
        return Err(GearError::TooFew { tooth, found: inside.len(), from, to, needed: LEAST });
    }
    let limit = GAP_SHARE * (to - from);
    let mut before = from;
    for at in inside.iter().map(|r| r.0).chain([to]) {
        if at - before > limit {
            return Err(GearError::Gap { tooth, gap: at - before, from: before, length: to - from, limit });
        }
        before = at;
    }
    Ok(())
}

/// Mean of the deviations of several traces, slopes with their sign: an eccentric gear turns the slopes of opposite teeth
/// the other way.
#[must_use]
pub fn mean_of(all: &[Deviations]) -> Option<Deviations> {
    let mean = |f: fn(&Deviations) -> f64| all.iter().map(f).sum::<f64>() / all.len() as f64;
    (!all.is_empty()).then(|| Deviations {
        total_um: mean(|d| d.total_um),
        form_um: mean(|d| d.form_um),
        slope_um: mean(|d| d.slope_um),
        mean_line: [mean(|d| d.mean_line[0]), mean(|d| d.mean_line[1])],
    })
}

/// One trace per tooth, flank and direction from the readings of all its passes: readings at one position are averaged.
/// The traces come in the order of direction, flank, tooth.
#[must_use]
pub fn passes_averaged(readings: &[(Direction, Flank, u32, f64, f64)]) -> Vec<GearTrace> {
    let mut sorted = readings.to_vec();
    sorted.sort_by(|a, b| (a.0, a.1, a.2).cmp(&(b.0, b.1, b.2)).then(a.3.total_cmp(&b.3)));
    let mut traces: Vec<GearTrace> = Vec::new();
    for of_trace in sorted.chunk_by(|a, b| (a.0, a.1, a.2) == (b.0, b.1, b.2)) {
        let (direction, flank, tooth, ..) = of_trace[0];
        let at_one_place = of_trace.chunk_by(|a, b| (b.3 - a.3).abs() < 1e-6);
        let mean = |chunk: &[(Direction, Flank, u32, f64, f64)]| {
            (chunk[0].3, chunk.iter().map(|r| r.4).sum::<f64>() / chunk.len() as f64)
        };
        traces.push(GearTrace { direction, tooth, flank, readings: at_one_place.map(mean).collect() });
    }
    traces
}

impl Deviations {
    /// One of the three deviations, um.
    #[must_use]
    pub const fn of(&self, quantity: Quantity) -> f64 {
        match quantity {
            Quantity::Total => self.total_um,
            Quantity::Form => self.form_um,
            Quantity::Slope => self.slope_um,
        }
    }
}

/// One direction of one flank.
#[derive(Debug, Clone, PartialEq)]
pub struct OfFlank {
    /// Profile or helix.
    pub direction: Direction,
    /// Which flank.
    pub flank: Flank,
    /// Its teeth.
    pub teeth: Vec<(GearTrace, Deviations)>,
    /// Means over the teeth.
    pub mean: Deviations,
}

/// The class of a direction over both flanks; `Some(None)` beyond the last one, `None` where it was not measured.
#[must_use]
pub fn class_of(gear: &Gear, flanks: &[OfFlank], direction: Direction) -> Option<Option<u8>> {
    let mut measured = flanks.iter().filter(|f| f.direction == direction).peekable();
    measured.peek()?;
    Some(measured.try_fold(0, |worst, f| Some(worst.max(f.class(gear)?))))
}

impl OfFlank {
    /// The class that all three quantities keep; `None` beyond the last one.
    #[must_use]
    pub fn class(&self, gear: &Gear) -> Option<u8> {
        let of = |q: Quantity| class(gear, self.direction, q, self.mean.of(q));
        let all = [Quantity::Total, Quantity::Form, Quantity::Slope];
        all.into_iter().map(of).try_fold(0, |worst, c| Some(worst.max(c?)))
    }
}

/// All flanks of a gear, profiles first, from readings as for [`passes_averaged`].
///
/// # Errors
/// A trace cannot be evaluated; with its direction.
pub fn flanks(
    gear: &Gear,
    readings: &[(Direction, Flank, u32, f64, f64)],
) -> Result<Vec<OfFlank>, (Direction, GearError)> {
    let mut flanks = Vec::new();
    for group in passes_averaged(readings).chunk_by(|a, b| (a.direction, a.flank) == (b.direction, b.flank)) {
        let mut teeth = Vec::new();
        for trace in group {
            teeth.push((trace.clone(), evaluate(gear, trace).map_err(|e| (trace.direction, e))?));
        }
        let all: Vec<Deviations> = teeth.iter().map(|t| t.1).collect();
        if let Some(mean) = mean_of(&all) {
            flanks.push(OfFlank { direction: group[0].direction, flank: group[0].flank, teeth, mean });
        }
    }
    Ok(flanks)
}
