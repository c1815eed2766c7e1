//! Rounding: readings that are whole multiples of one step.

/// Readings looked at.
const LOOKED_AT: usize = 4000;
/// Least number of different readings that prove a step.
const DIFFERENT: usize = 4;
/// What the last decimal of a file may hide, um.
const DECIMALS_UM: f64 = 1.5e-4;
/// Least step, in such decimals: below, everything is a multiple.
const LEAST: f64 = 20.0;
/// A step may be the smallest difference between readings over a whole number up to this one.
const DIVISOR_MAX: usize = 4;

/// The step of every instrument class of which all its readings are multiples (from any origin), um; 0 where there is none.
/// Classes that show too few different readings to prove a step have that of the others where it fits them: the readings of
/// one control are rounded alike.
#[must_use]
pub fn lattices(classes: &[Vec<f64>]) -> Vec<f64> {
    let levels: Vec<Vec<f64>> = classes.iter().map(|values| levels(values)).collect();
    let mut steps: Vec<f64> = levels.iter().map(|l| step(l).unwrap_or(0.0)).collect();
    let coarsest = steps.iter().copied().fold(0.0, f64::max);
    for (own, levels) in steps.iter_mut().zip(&levels) {
        if *own == 0.0 && coarsest > 0.0 && !levels.is_empty() && fit(levels, coarsest).is_some() {
            *own = coarsest;
        }
    }
    steps
}

/// The different readings in order; those that differ by decimals only are one.
fn levels(values: &[f64]) -> Vec<f64> {
    let mut sorted: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).take(LOOKED_AT).collect();
    sorted.sort_by(f64::total_cmp);
    sorted.dedup_by(|b, a| (*b - *a).abs() < DECIMALS_UM);
    sorted
}

fn step(levels: &[f64]) -> Option<f64> {
    if levels.len() < DIFFERENT {
        return None;
    }
    let least = levels.windows(2).map(|w| w[1] - w[0]).fold(f64::INFINITY, f64::min);
    (1..=DIVISOR_MAX)
        .map(|n| least / n as f64)
        .take_while(|s| *s > LEAST * DECIMALS_UM)
        .find_map(|s| fit(levels, s))
}

/// The step near `guess` on whose multiples all levels lie.
fn fit(levels: &[f64], guess: f64) -> Option<f64> {
    let origin = levels[0];
    let mut step = guess;
    // nearer levels first: their numbers are sure, and sharpen the step for the next ones
    let mut sums = (0.0, 0.0);
    for v in levels {
        let k = ((v - origin) / step).round();
        sums = (sums.0 + k * (v - origin), sums.1 + k * k);
        if sums.1 > 0.0 {
            step = sums.0 / sums.1;
        }
    }
    let on = levels.iter().all(|v| {
        let k = ((v - origin) / step).round();
        (v - origin - k * step).abs() <= DECIMALS_UM
    });
    // sharper than the guess, not another one
    (on && (step - guess).abs() <= 2.0 * DECIMALS_UM).then_some(step)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_found_and_free_numbers_have_none() {
        let coarse: Vec<f64> = (0..50).map(|i| f64::from((i * 7) % 23) * 0.5 + 3.1).collect();
        let mixed: Vec<f64> = [0.0, 4.0, 6.0, 10.0, 16.0].to_vec();
        let free: Vec<f64> = (0..50).map(|i| (f64::from(i) * 1.234_567).sin()).collect();
        for (values, wanted) in [(coarse, 0.5), (mixed, 2.0), (free, 0.0)] {
            let found = lattices(&[values])[0];
            assert!((found - wanted).abs() < 1e-6, "{found}, not {wanted}");
        }
    }

    #[test]
    fn a_step_is_known_better_than_the_decimals_of_the_file() {
        let values: Vec<f64> = (-9..30).map(|k| (f64::from(k) * 5.559_32 * 1e4).round() / 1e4).collect();
        assert!((lattices(&[values])[0] - 5.559_32).abs() < 1e-4);
    }

    #[test]
    fn readings_that_prove_no_step_have_that_of_the_others_where_it_fits() {
        let many: Vec<f64> = (0..30).map(|k| f64::from(k) * 0.25).collect();
        let steps = lattices(&[many, vec![1.5, 2.0, 2.0], vec![1.5, 1.9, 1.5]]);
        assert!((steps[1] - 0.25).abs() < 1e-9 && steps[2] == 0.0, "{steps:?}");
    }
}
