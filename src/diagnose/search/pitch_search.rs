//! The pitch of a screw, rack or scale that is in no catalogue: over a long travel the right one is a narrow peak between the
//! pitches that are tried.

use core::f64::consts::{LN_2, TAU};

use super::super::constants::{MANY, NEARLY, STRONG};
use super::super::library::{Library, Shape, forms};
use super::super::moment::Axis;
use super::super::noise::{Filter, median};
use super::super::session::Session;
use super::problem::Problem;
use super::select::Selection;

/// Fewest waves over the travel.
const WAVES_MIN: f64 = 4.0;
/// Steps of the frequency in the width of a peak.
const FINE: f64 = 4.0;
/// Readings times frequencies at most: bounds the work.
const WORK: f64 = 4e6;

/// Puts the pitch that what is left asks for in the place of the nearest one of the catalogue; true where there is one.
pub fn find_pitches(
    problem: &mut Problem,
    session: &Session,
    filter: &Filter,
    library: &mut Library,
    selection: &Selection,
) -> bool {
    let mut found = false;
    for axis in Axis::LINEAR {
        let own: Vec<(usize, f64)> = pitches(library, axis).collect();
        let beside: Vec<usize> =
            selection.chosen.iter().copied().filter(|v| own.iter().all(|o| o.0 != *v)).collect();
        let given = Selection::given(problem, &beside);
        let beta = problem.fit(&given);
        let left = &problem.y - problem.contribution(&given.columns, &beta);
        let samples: Vec<(f64, f64)> = problem
            .rows
            .iter()
            .zip(left.iter())
            .map(|(i, e)| (&session.moments[*i], e))
            .filter(|(m, _)| m.u[axis.slot()].abs() > NEARLY)
            .map(|(m, e)| (m.position[axis.slot()], e * m.u[axis.slot()].signum()))
            .collect();
        let shortest = own.iter().map(|o| o.1).fold(f64::INFINITY, f64::min);
        let Some((pitch, width)) = peak(&samples, shortest) else { continue };
        if own.iter().any(|(_, p)| (1.0 / p - 1.0 / pitch).abs() < 0.5 * width) {
            continue;
        }
        let nearest = own.iter().map(|o| o.1).min_by(|a, b| (a - pitch).abs().total_cmp(&(b - pitch).abs()));
        for (v, p) in &own {
            if Some(*p) == nearest
                && let Shape::Cyclic(forms::Cyclic { pitch_mm, .. }) = &mut library.variants[*v].shape
            {
                *pitch_mm = pitch;
                let shape = library.variants[*v].shape.clone();
                problem.replace(session, filter, *v, &shape);
                found = true;
            }
        }
    }
    found
}

/// The variants of the periodic error of an axis and their pitches, mm.
fn pitches(library: &Library, axis: Axis) -> impl Iterator<Item = (usize, f64)> {
    library.variants.iter().enumerate().filter_map(move |(v, variant)| match variant.shape {
        Shape::Cyclic(forms::Cyclic { axis: a, pitch_mm, .. }) if a == axis => Some((v, pitch_mm)),
        _ => None,
    })
}

/// The wave that stands out of samples (position mm, value): its length, mm, and the width of its peak, 1/mm.
fn peak(samples: &[(f64, f64)], shortest: f64) -> Option<(f64, f64)> {
    let places = samples.iter().map(|s| s.0);
    let (low, high) = places.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(x), h.max(x)));
    let span = high - low;
    if samples.len() < MANY || span <= 0.0 || !shortest.is_finite() {
        return None;
    }
    let step = 1.0 / (FINE * span);
    let first = WAVES_MIN / span;
    let count = ((1.0 / shortest - first) / step).min(WORK / samples.len() as f64);
    if count < 3.0 * FINE {
        return None;
    }
    let count = count as usize;
    let (mut re, mut im) = (vec![0.0; count], vec![0.0; count]);
    for (x, value) in samples {
        let (mut s, mut c) = (TAU * first * (x - low)).sin_cos();
        let (ds, dc) = (TAU * step * (x - low)).sin_cos();
        for (re, im) in re.iter_mut().zip(&mut im) {
            *re += value * c;
            *im += value * s;
            (s, c) = (s * dc + c * ds, c * dc - s * ds);
        }
    }
    let power: Vec<f64> = re.iter().zip(&im).map(|(a, b)| a * a + b * b).collect();
    let top = (0..count).max_by(|a, b| power[*a].total_cmp(&power[*b]))?;
    // the power of noise is spread exponentially: its median is ln 2 of its mean
    let mean = median(&mut power.clone()) / LN_2;
    let stands_out = power[top] > mean * ((count as f64).ln() + STRONG);
    let between = if (1..count - 1).contains(&top) {
        vertex([power[top - 1], power[top], power[top + 1]])
    } else {
        0.0
    };
    stands_out.then(|| (1.0 / (first + step * (top as f64 + between)), 1.0 / span))
}

/// Place of the vertex of the parabola through three values of which the middle one is the largest, in steps from it.
fn vertex([before, at, after]: [f64; 3]) -> f64 {
    let curvature = before - 2.0 * at + after;
    if curvature < 0.0 { 0.5 * (before - after) / curvature } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use core::f64::consts::{PI, TAU};

    use super::super::super::noise::Random;
    use super::peak;

    #[test]
    fn a_pitch_of_no_catalogue_is_found_over_a_long_travel_and_none_in_noise() {
        let mut random = Random::new(3);
        let mut samples = |amplitude: f64| -> Vec<(f64, f64)> {
            (0..500)
                .map(|i| {
                    let x = 8.0 * f64::from(i) + 3.0 * (f64::from(i) * 2.4).sin();
                    (x, amplitude * (TAU * x / (10.0 * PI)).sin() + random.normal())
                })
                .collect()
        };
        let (pitch, width) = peak(&samples(1.0), 5.0).unwrap();
        assert!((1.0 / pitch - 0.1 / PI).abs() < 0.5 * width, "{pitch}");
        assert_eq!(peak(&samples(0.0), 5.0), None);
    }
}
