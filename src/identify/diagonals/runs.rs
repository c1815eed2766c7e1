//! Readings along diagonals to end-to-end displacements, with closed runs and their noise.
//!
//! One run is the readings of one diagonal and cycle in the order they were taken: out, and where it was measured
//! back. The mean of out and back takes a drift out that is linear in time. A run that only ends with one reading at
//! its start (a closing reading) has the drift interpolated in time and subtracted. A run that is not closed keeps
//! its drift; [`EndToEnd::open_runs`] counts these.
//!
//! Source: equations 5.3 d.

use super::NAMES;
use crate::prelude::*;

/// One reading along a diagonal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RunReading {
    /// Diagonal, index into [`super::SIGNS`].
    pub diagonal: usize,
    /// Position along the diagonal from its start, displacement error in any zero; mm.
    pub reading: Reading,
    /// When it was taken, any unit; the row number where no time is known.
    pub time: f64,
}

/// End-to-end displacements; mm.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct EndToEnd {
    /// Mean displacement error of each diagonal.
    pub displacement: [f64; 4],
    /// Standard deviation of the displacement of one run, pooled over the diagonals, where runs were repeated.
    pub run_std: Option<f64>,
    /// Degrees of freedom of `run_std`.
    pub dof: usize,
    /// Runs per diagonal.
    pub runs: [usize; 4],
    /// Mean change of the reading at the start of a closed run from its beginning to its end.
    pub closure: [Option<f64>; 4],
    /// Runs that were not closed: their drift is in the result.
    pub open_runs: usize,
    /// True where readings in both directions were averaged.
    pub both_directions: bool,
    /// Per diagonal: the distinct targets and the mean reading there relative to the start, drift taken out.
    pub steps: [Vec<(f64, f64)>; 4],
}

/// Why readings do not make displacements.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum RunsError {
    /// A diagonal is missing.
    #[error(
        "diagonal {name} has no readings: three diagonals give rank 3 for 4 unknowns (three squarenesses and the common part); measure all four: ppp npp pnp ppn"
    )]
    Missing {
        /// The diagonal.
        name: &'static str,
    },
    /// A run lacks one of its ends.
    #[error(
        "diagonal {name}, cycle {cycle}: no reading at {target_mm:.3} mm; squareness comes from the ends of the diagonal, at 0 and at its length"
    )]
    EndMissing {
        /// The diagonal.
        name: &'static str,
        /// The cycle.
        cycle: u32,
        /// The end.
        target_mm: f64,
    },
}

/// One run, evaluated.
struct Run {
    displacement: f64,
    closure: Option<f64>,
    both: bool,
    steps: Vec<(f64, f64)>,
}

/// Displacements of the four diagonals of `length`.
///
/// # Errors
/// A diagonal or an end is missing.
pub fn end_to_end(readings: &[RunReading], length: f64) -> Result<EndToEnd, RunsError> {
    let mut result = EndToEnd::default();
    let mut squares = 0.0;
    for (d, name) in NAMES.into_iter().enumerate() {
        let own: Vec<&RunReading> = readings.iter().filter(|r| r.diagonal == d).collect();
        let mut cycles: Vec<u32> = own.iter().map(|r| r.reading.cycle).collect();
        cycles.sort_unstable();
        cycles.dedup();
        if cycles.is_empty() {
            return Err(RunsError::Missing { name });
        }
        let mut runs = Vec::with_capacity(cycles.len());
        for &cycle in &cycles {
            let run: Vec<&RunReading> = own.iter().copied().filter(|r| r.reading.cycle == cycle).collect();
            runs.push(evaluate(&run, length).map_err(|target_mm| RunsError::EndMissing {
                name,
                cycle,
                target_mm,
            })?);
        }
        let n = runs.len() as f64;
        let mean = runs.iter().map(|r| r.displacement).sum::<f64>() / n;
        squares += runs.iter().map(|r| (r.displacement - mean).powi(2)).sum::<f64>();
        result.dof += runs.len() - 1;
        result.displacement[d] = mean;
        result.runs[d] = runs.len();
        let closures: Vec<f64> = runs.iter().filter_map(|r| r.closure).collect();
        result.open_runs += runs.len() - closures.len();
        if !closures.is_empty() {
            result.closure[d] = Some(closures.iter().sum::<f64>() / closures.len() as f64);
        }
        result.both_directions |= runs.iter().any(|r| r.both);
        result.steps[d] = mean_steps(&runs);
    }
    result.run_std = (result.dof > 0).then(|| (squares / result.dof as f64).sqrt());
    Ok(result)
}

/// Mean of the runs at each target.
fn mean_steps(runs: &[Run]) -> Vec<(f64, f64)> {
    let readings: Vec<Reading> = runs
        .iter()
        .flat_map(|r| &r.steps)
        .map(|&(position, value)| Reading { cycle: 0, travel: Travel::Forward, position, value })
        .collect();
    let (positions, group) = group_by_position(&readings);
    let mut sums = vec![(0.0, 0usize); positions.len()];
    for (r, &g) in readings.iter().zip(&group) {
        sums[g].0 += r.value;
        sums[g].1 += 1;
    }
    positions.into_iter().zip(sums).map(|(x, (sum, n))| (x, sum / n as f64)).collect()
}

/// One run; the error is the end that is missing.
fn evaluate(run: &[&RunReading], length: f64) -> Result<Run, f64> {
    let near = 1e-3_f64.max(1e-6 * length);
    let of = |travel: Travel| -> Vec<&RunReading> {
        run.iter().copied().filter(|r| r.reading.travel == travel).collect()
    };
    let at = |pass: &[&RunReading], target: f64| -> Option<(f64, f64)> {
        let found: Vec<_> = pass.iter().filter(|r| (r.reading.position - target).abs() <= near).collect();
        let n = found.len() as f64;
        (!found.is_empty()).then(|| {
            (
                found.iter().map(|r| r.reading.value).sum::<f64>() / n,
                found.iter().map(|r| r.time).sum::<f64>() / n,
            )
        })
    };
    let end_to_end = |pass: &[&RunReading]| -> Result<f64, f64> {
        let start = at(pass, 0.0).ok_or(0.0)?;
        let end = at(pass, length).ok_or(length)?;
        Ok(end.0 - start.0)
    };
    let (out, back) = (of(Travel::Forward), of(Travel::Reverse));
    let has_end = |pass: &[&RunReading]| at(pass, length).is_some();
    if has_end(&out) && has_end(&back) {
        let (d_out, d_back) = (end_to_end(&out)?, end_to_end(&back)?);
        let closure = at(&back, 0.0).zip(at(&out, 0.0)).map(|(b, a)| b.0 - a.0);
        let mut steps = relative(&out, &at);
        steps.extend(relative(&back, &at));
        return Ok(Run { displacement: f64::midpoint(d_out, d_back), closure, both: true, steps });
    }
    let (pass, rest, from, to) =
        if has_end(&out) || !has_end(&back) { (out, back, 0.0, length) } else { (back, out, length, 0.0) };
    let displacement = end_to_end(&pass)?;
    // a single reading back at the point where the pass began closes the run
    let begun = at(&pass, from).ok_or(from)?;
    let ended = at(&pass, to).ok_or(to)?;
    let mut steps = relative(&pass, &at);
    let Some((value, time)) = at(&rest, from).filter(|(_, t)| *t > ended.1) else {
        return Ok(Run { displacement, closure: None, both: false, steps });
    };
    let closure = value - begun.0;
    let rate = closure / (time - begun.1);
    // the displacement is the reading at the far end minus that at 0, whichever came first
    let lapse = if from == 0.0 { ended.1 - begun.1 } else { begun.1 - ended.1 };
    for ((_, step), r) in steps.iter_mut().zip(&pass) {
        *step -= rate * (r.time - at(&pass, 0.0).map_or(begun.1, |s| s.1));
    }
    Ok(Run { displacement: displacement - rate * lapse, closure: Some(closure), both: false, steps })
}

/// Readings of a pass relative to its own reading at 0.
fn relative(
    pass: &[&RunReading],
    at: &impl Fn(&[&RunReading], f64) -> Option<(f64, f64)>,
) -> Vec<(f64, f64)> {
    let zero = at(pass, 0.0).map_or(0.0, |z| z.0);
    pass.iter().map(|r| (r.reading.position, r.reading.value - zero)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const LENGTH: f64 = 300.0;

    /// Out over three steps with a displacement error of `d`, `back` of the way back, drifting by `rate` per row.
    fn run(diagonal: usize, cycle: u32, d: f64, rate: f64, back: &[f64]) -> Vec<RunReading> {
        let out = [0.0, 100.0, 200.0, 300.0].map(|t| (t, Travel::Forward));
        let all = out.into_iter().chain(back.iter().map(|t| (*t, Travel::Reverse)));
        all.enumerate()
            .map(|(k, (position, travel))| RunReading {
                diagonal,
                reading: Reading {
                    cycle,
                    travel,
                    position,
                    value: 7.0 + d * position / LENGTH + rate * k as f64,
                },
                time: k as f64,
            })
            .collect()
    }

    fn four(each: impl FnMut(usize) -> Vec<RunReading>) -> Vec<RunReading> {
        (0..4).flat_map(each).collect()
    }

    #[test]
    fn out_and_back_closes_the_run() {
        let all = four(|d| run(d, 1, d as f64, 0.01, &[300.0, 200.0, 100.0, 0.0]));
        let r = end_to_end(&all, LENGTH).unwrap();
        for d in 0..4 {
            assert!((r.displacement[d] - d as f64).abs() < 1e-12);
            assert!((r.closure[d].unwrap() - 0.07).abs() < 1e-12);
        }
        assert_eq!((r.open_runs, r.run_std, r.dof), (0, None, 0));
        assert!(r.both_directions);
    }

    #[test]
    fn one_closing_reading_is_enough_and_none_leaves_the_drift() {
        let closed = end_to_end(&four(|d| run(d, 1, 0.5, 0.01, &[0.0])), LENGTH).unwrap();
        assert!((closed.displacement[2] - 0.5).abs() < 1e-12);
        assert!((closed.closure[2].unwrap() - 0.04).abs() < 1e-12);
        assert_eq!(closed.open_runs, 0);
        for (i, (x, v)) in closed.steps[0].iter().enumerate() {
            assert!((v - 0.5 * x / LENGTH).abs() < 1e-12, "step {i}");
        }
        let open = end_to_end(&four(|d| run(d, 1, 0.5, 0.01, &[])), LENGTH).unwrap();
        assert!((open.displacement[2] - 0.53).abs() < 1e-12);
        assert_eq!(open.open_runs, 4);
    }

    #[test]
    fn repeated_runs_give_the_noise() {
        let all = four(|d| {
            [0.1, 0.3].into_iter().zip(1..).flat_map(|(v, cycle)| run(d, cycle, v, 0.0, &[])).collect()
        });
        let r = end_to_end(&all, LENGTH).unwrap();
        assert_eq!((r.dof, r.runs), (4, [2; 4]));
        assert!((r.run_std.unwrap() - 0.02f64.sqrt()).abs() < 1e-12);
    }

    #[test]
    fn what_is_missing_is_named() {
        let mut all = four(|d| run(d, 1, 0.1, 0.0, &[]));
        all.retain(|r| r.diagonal != 2);
        assert_eq!(end_to_end(&all, LENGTH), Err(RunsError::Missing { name: "pnp" }));
        let mut all = four(|d| run(d, 3, 0.1, 0.0, &[]));
        all.retain(|r| r.diagonal != 1 || r.reading.position < 250.0);
        let e = end_to_end(&all, LENGTH).unwrap_err();
        assert_eq!(e, RunsError::EndMissing { name: "npp", cycle: 3, target_mm: 300.0 });
        assert!(e.to_string().contains("no reading at 300.000 mm"));
    }
}
