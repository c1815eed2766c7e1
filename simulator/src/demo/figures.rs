//! Recorded cycles to the figures and curves of the demo.

use crate::control::CycleRecord;
use crate::instruments::InstrumentError;
use crate::instruments::ballbar::{Ballbar, CirclePoint, Trace};
use crate::instruments::diagonal::{Diagonal, DiagonalPoint};
use crate::truth::TruthMachine;

/// A figure without and with compensation.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Pair {
    /// Without.
    pub before_um: f64,
    /// With.
    pub after_um: f64,
}

impl Pair {
    /// Share that is gone, 0 to 1.
    #[must_use]
    pub fn reduction(&self) -> f64 {
        1.0 - self.after_um / self.before_um
    }
}

/// Tip where it should have been, in the workpiece frame.
fn nominal_tip(machine: &TruthMachine, record: &CycleRecord) -> [f64; 3] {
    machine.nominal(&record.commanded).tip_mm
}

/// What a ballbar of 100 mm sees of a circle in XY.
///
/// # Errors
/// Too few cycles were recorded.
pub fn ballbar(
    machine: &TruthMachine,
    centre_commanded: [f64; 3],
    radius_mm: f64,
    cycles: &[CycleRecord],
) -> Result<Trace, InstrumentError> {
    let mut at = [0.0; volcomp_units::axes::MAX_AXES];
    at[..3].copy_from_slice(&centre_commanded);
    let centre_mm = machine.nominal(&at).tip_mm;
    let points: Vec<CirclePoint> = cycles
        .iter()
        .map(|r| CirclePoint { commanded_mm: nominal_tip(machine, r), actual_mm: r.sample.tip_mm })
        .collect();
    Ballbar { centre_mm, radius_mm, plane: [0, 1], noise_um: 0.0, seed: 1 }.trace(&points)
}

/// The curve of a ballbar trace about its least-squares centre: (angle in rad, deviation in um), thinned.
#[must_use]
pub fn ballbar_curve(trace: &Trace) -> Vec<(f64, f64)> {
    let n = trace.readings.len().max(1) as f64;
    // the eccentricity is setting-up of the instrument, not form: taken out for the picture as for G
    let mean = |f: &dyn Fn(f64) -> f64| {
        trace.readings.iter().map(|r| r.deviation_um * f(r.angle_deg.to_radians())).sum::<f64>() / n
    };
    let (cx, cy) = (2.0 * mean(&f64::cos), 2.0 * mean(&f64::sin));
    let step = (trace.readings.len() / 720).max(1);
    let point = |r: &crate::instruments::ballbar::Reading| {
        let angle = r.angle_deg.to_radians();
        (angle, r.deviation_um - cx * angle.cos() - cy * angle.sin())
    };
    trace.readings.iter().step_by(step).map(point).collect()
}

/// The stops of a positioning run: the last cycle of every dwell.
fn stops(cycles: &[CycleRecord]) -> Vec<&CycleRecord> {
    let standing: Vec<&CycleRecord> = cycles.iter().filter(|r| r.feed_mm_per_min == 0.0).collect();
    let last_of_line = |i: &usize| standing.get(i + 1).is_none_or(|next| next.line != standing[*i].line);
    (0..standing.len()).filter(last_of_line).map(|i| standing[i]).collect()
}

/// What an interferometer sees along a diagonal, on the way there.
///
/// # Errors
/// Too few stops were recorded.
pub fn diagonal(machine: &TruthMachine, cycles: &[CycleRecord]) -> Result<Diagonal, InstrumentError> {
    let stops = stops(cycles);
    let there = stops.len().div_ceil(2);
    let points: Vec<DiagonalPoint> = stops[..there]
        .iter()
        .map(|r| DiagonalPoint { nominal_mm: nominal_tip(machine, r), actual_mm: r.sample.tip_mm })
        .collect();
    Diagonal::of_points(&points, 0.0, 1)
}

/// Size of the deviation of the tool tip along recorded motion: (time in s, um), one entry per scored cycle.
///
/// The axes stand where the recording says plus the offset; the tip belongs where an ideal machine would have it
/// with the axes where the recording says. So the following error of the real machine is no part of it.
#[must_use]
pub fn deviation_along(machine: &TruthMachine, cycles: &[CycleRecord]) -> Vec<(f64, f64)> {
    let Some(first) = cycles.first() else { return Vec::new() };
    cycles
        .iter()
        .map(|r| {
            let mut recorded = r.sample.axis;
            for (q, offset) in recorded.iter_mut().zip(r.applied) {
                *q -= offset;
            }
            let nominal = machine.nominal(&recorded).tip_mm;
            let square: f64 = (0..3).map(|i| (r.sample.tip_mm[i] - nominal[i]).powi(2)).sum();
            (r.time_s - first.time_s, square.sqrt() * 1e3)
        })
        .collect()
}

/// Root mean square of the second entries.
#[must_use]
pub fn rms(curve: &[(f64, f64)]) -> f64 {
    (curve.iter().map(|p| p.1 * p.1).sum::<f64>() / curve.len().max(1) as f64).sqrt()
}

/// Every `n`-th point so that at most about 1500 are drawn, with a gap wherever nothing was recorded for `gap`.
#[must_use]
pub fn thinned(curve: &[(f64, f64)], gap: f64) -> Vec<(f64, f64)> {
    let step = (curve.len() / 1500).max(1);
    let mut out = Vec::new();
    let mut last = None;
    for (i, &point) in curve.iter().enumerate() {
        let paused = last.is_some_and(|x| point.0 - x > gap);
        if paused {
            out.push((point.0, f64::NAN));
        }
        if paused || i % step == 0 {
            out.push(point);
        }
        last = Some(point.0);
    }
    out
}
