//! Rounding: readings that are whole multiples of one step.

use super::super::constants::{DECIMALS_UM, MANY, ROWS, STEP_DECIMALS};
use super::super::session::{Reading, Session};
use super::pair_residuals;

/// Least number of different readings that prove a step, of readings that differ from their repeats, and the most steps between the
/// closest two.
const DIFFERENT: usize = 4;
/// The same where repeats differ and the class is read often: what has noise and still gives one of a few values is rounded.
const DIFFERENT_OF_MANY: usize = 2;

/// The readings of one instrument class.
#[derive(Debug, Clone, Default, PartialEq)]
struct Class {
    deviations_um: Vec<f64>,
    /// Some differ from their repeats, or from both neighbours, which agree.
    is_restless: bool,
}

/// The step of every instrument class of which all its readings are multiples (from any origin), um; 0 where there is none.
/// Classes that show too few different readings to prove a step have that of the others where it fits them: the readings of
/// one control are rounded alike.
#[must_use]
pub fn lattices(session: &Session) -> Vec<f64> {
    let deviations: Vec<f64> = session.readings.iter().map(|r| r.deviation_um).collect();
    let apart = pair_residuals(session, &deviations, &vec![true; deviations.len()]);
    let mut classes = vec![(Class::default(), 0); session.instruments.len()];
    for (r, apart) in session.readings.iter().zip(apart) {
        let (class, differing) = &mut classes[r.instrument];
        class.deviations_um.push(r.deviation_um);
        *differing += usize::from(apart.abs() > DECIMALS_UM);
        class.is_restless = *differing >= DIFFERENT;
    }
    let mut classes: Vec<Class> = classes.into_iter().map(|(class, _)| class).collect();
    for (k, class) in classes.iter_mut().enumerate() {
        class.is_restless |= flickers(session, k) >= DIFFERENT;
    }
    steps(&classes)
}

/// How many readings of a class differ from the one before and the one after in their run, which agree: no motion does that, noise does.
fn flickers(session: &Session, class: usize) -> usize {
    let of_class: Vec<_> = session.readings.iter().filter(|r| r.instrument == class).collect();
    let same = |a: f64, b: f64| (a - b).abs() <= DECIMALS_UM;
    let flickers = |w: &&[&Reading]| {
        let [before, own, after] = [w[0], w[1], w[2]].map(|r| r.deviation_um);
        w[0].run == w[2].run && same(before, after) && !same(before, own)
    };
    of_class.windows(3).filter(flickers).count()
}

fn steps(classes: &[Class]) -> Vec<f64> {
    let levels: Vec<Vec<f64>> = classes.iter().map(|c| levels(&c.deviations_um)).collect();
    let mut steps: Vec<f64> =
        classes.iter().zip(&levels).map(|(c, l)| step(l, needed(c)).unwrap_or(0.0)).collect();
    let coarsest = steps.iter().copied().fold(0.0, f64::max);
    for (own, levels) in steps.iter_mut().zip(&levels) {
        if *own == 0.0 && coarsest > 0.0 && !levels.is_empty() && fit(levels, coarsest).is_some() {
            *own = coarsest;
        }
    }
    steps
}

/// How many different readings prove a step of a class; it is read often from [`MANY`] readings for each of two on.
fn needed(class: &Class) -> usize {
    let is_read_often = class.deviations_um.len() >= DIFFERENT_OF_MANY * MANY;
    if class.is_restless && is_read_often { DIFFERENT_OF_MANY } else { DIFFERENT }
}

/// The different readings in order; those that differ by decimals only are one.
fn levels(values: &[f64]) -> Vec<f64> {
    let mut sorted: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).take(ROWS).collect();
    sorted.sort_by(f64::total_cmp);
    sorted.dedup_by(|b, a| (*b - *a).abs() < DECIMALS_UM);
    sorted
}

fn step(levels: &[f64], needed: usize) -> Option<f64> {
    if levels.len() < needed {
        return None;
    }
    let least = levels.windows(2).map(|w| w[1] - w[0]).fold(f64::INFINITY, f64::min);
    (1..=DIFFERENT)
        .map(|n| least / n as f64)
        .take_while(|s| *s > STEP_DECIMALS * DECIMALS_UM)
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

    fn class(values: &[f64]) -> Class {
        Class { deviations_um: values.to_vec(), is_restless: false }
    }

    #[test]
    fn steps_are_found_and_free_numbers_have_none() {
        let coarse: Vec<f64> = (0..50).map(|i| f64::from((i * 7) % 23) * 0.5 + 3.1).collect();
        let mixed: Vec<f64> = [0.0, 4.0, 6.0, 10.0, 16.0].to_vec();
        let free: Vec<f64> = (0..50).map(|i| (f64::from(i) * 1.234_567).sin()).collect();
        for (values, wanted) in [(coarse, 0.5), (mixed, 2.0), (free, 0.0)] {
            let found = steps(&[class(&values)])[0];
            assert!((found - wanted).abs() < 1e-6, "{found}, not {wanted}");
        }
    }

    #[test]
    fn a_step_is_known_better_than_the_decimals_of_the_file() {
        let values: Vec<f64> = (-9..30).map(|k| (f64::from(k) * 5.559_32 * 1e4).round() / 1e4).collect();
        assert!((steps(&[class(&values)])[0] - 5.559_32).abs() < 1e-4);
    }

    #[test]
    fn readings_that_prove_no_step_have_that_of_the_others_where_it_fits() {
        let many: Vec<f64> = (0..30).map(|k| f64::from(k) * 0.25).collect();
        let steps = steps(&[class(&many), class(&[1.5, 2.0, 2.0]), class(&[1.5, 1.9, 1.5])]);
        assert!((steps[1] - 0.25).abs() < 1e-9 && steps[2] == 0.0, "{steps:?}");
    }

    #[test]
    fn noise_that_gives_one_of_two_values_is_rounded_and_a_clean_reversal_is_not() {
        let two: Vec<f64> = (0..100).map(|i| if i % 9 == 0 { 21.7 } else { 0.0 }).collect();
        let noisy = Class { deviations_um: two.clone(), is_restless: true };
        assert!((steps(&[noisy])[0] - 21.7).abs() < 1e-9);
        assert!(steps(&[class(&two)])[0] == 0.0, "no repeat differs: this may be lost motion without noise");
        let few = Class { deviations_um: two[..60].to_vec(), is_restless: true };
        assert!(steps(&[few])[0] == 0.0);
        let of_three = |middle: f64| {
            let value = |i: i32| {
                if i % 9 == 0 {
                    0.0
                } else if i % 7 == 0 {
                    10.0
                } else {
                    middle
                }
            };
            Class { deviations_um: (0..110).map(value).collect(), is_restless: true }
        };
        assert!((steps(&[of_three(5.0)])[0] - 5.0).abs() < 1e-9);
        assert!(steps(&[of_three(5.007)])[0] == 0.0, "three values at unequal distances");
    }
}
