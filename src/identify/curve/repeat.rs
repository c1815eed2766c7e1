//! Curves of a whole turn over a travel of more than one: the same pose has the same value at every turn.
//!
//! A rotary axis at 270 deg and at -90 deg is in the same pose. A Fourier series whose periods divide the turn already
//! repeats: its range grows. The points of a table are repeated; the two ends of the turn are one place and get their mean.
//! Other curves (polynomials, periods that do not divide the turn) become a table of one turn first.

use core::iter;

use crate::prelude::*;
use volcomp_model::curve::{CurveError, Fourier};

/// Relative tolerance of a turn and of the number of periods in it.
const SAME: f64 = 1e-9;
/// Points of a turn of a curve that cannot repeat by itself.
const POINTS: usize = 720;
/// Most turns over which a table is repeated.
const TURNS_MAX: f64 = 1000.0;

/// True where every curve that has a range covers exactly one turn, and one does.
#[must_use]
pub fn covers_turn(curves: &[Curve], turn: f64) -> bool {
    let mut ranges = curves.iter().filter_map(Curve::range).peekable();
    ranges.peek().is_some() && ranges.all(|[low, high]| (high - low - turn).abs() <= SAME * turn)
}

/// The curves over `travel`; `None` where they do not cover a turn, or hold all over the travel already.
///
/// # Errors
/// Travel of no extent or of more than 1000 turns.
pub fn repeated(curves: &[Curve], turn: f64, travel: [f64; 2]) -> Result<Option<Vec<Curve>>, CurveError> {
    let within = |c: &Curve| {
        c.range().is_none_or(|[low, high]| low <= travel[0] + SAME * turn && high >= travel[1] - SAME * turn)
    };
    if !covers_turn(curves, turn) || curves.iter().all(within) {
        return Ok(None);
    }
    if travel[1] - travel[0] > TURNS_MAX * turn {
        return Err(CurveError::TooManyTerms {
            found: ((travel[1] - travel[0]) / turn) as usize,
            limit: TURNS_MAX as usize,
        });
    }
    curves.iter().map(|c| one(c, turn, travel)).collect::<Result<_, _>>().map(Some)
}

fn one(curve: &Curve, turn: f64, travel: [f64; 2]) -> Result<Curve, CurveError> {
    let Some([start, end]) = curve.range() else { return Ok(curve.clone()) };
    // whole turns to either side, so that no phase changes
    let before = ((start - travel[0]) / turn - SAME).ceil().max(0.0);
    let after = ((travel[1] - end) / turn - SAME).ceil().max(0.0);
    match curve {
        Curve::Fourier(f) if repeats(f, turn) => {
            let (mean, linear) = f.mean_and_linear();
            let [cos, sin] = [0, 1].map(|i| f.harmonics().iter().map(|h| h[i]).collect::<Vec<f64>>());
            let origin = start - before * turn;
            let span = travel[1].max(end) - origin;
            Ok(Curve::Fourier(Fourier::new(origin, span, f.period(), mean, linear, &cos, &sin)?))
        }
        Curve::Table(t) => {
            let (positions, forward, reverse) = t.columns();
            table(positions, forward, reverse, t.interpolation(), turn, travel, [before, after])
        }
        other => {
            let step = turn / POINTS as f64;
            let positions: Vec<f64> = (0..=POINTS).map(|i| start + step * i as f64).collect();
            let values: Vec<f64> = positions.iter().map(|x| other.value(*x, Travel::Forward)).collect();
            table(&positions, &values, None, Interpolation::Linear, turn, travel, [before, after])
        }
    }
}

/// True for a series that comes back after the turn.
fn repeats(f: &Fourier, turn: f64) -> bool {
    let periods = turn / f.period();
    f.mean_and_linear().1 == 0.0 && (periods - periods.round()).abs() <= SAME * periods
}

/// The points of a turn, `before` and `after` times more.
fn table(
    positions: &[f64],
    forward: &[f64],
    reverse: Option<&[f64]>,
    interpolation: Interpolation,
    turn: f64,
    travel: [f64; 2],
    [before, after]: [f64; 2],
) -> Result<Curve, CurveError> {
    let last = positions.len() - 1;
    let turns = (before + after) as usize + 1;
    let values = |of: &[f64]| -> Vec<f64> {
        let joint = f64::midpoint(of[0], of[last]);
        let inner: Vec<f64> = iter::once(joint).chain(of[1..last].iter().copied()).collect();
        (0..turns).flat_map(|_| inner.iter().copied()).chain([joint]).collect()
    };
    let shift = |k: usize| (k as f64 - before) * turn;
    let places = (0..turns)
        .flat_map(|k| positions[..last].iter().map(move |x| x + shift(k)))
        .chain([positions[0] + shift(turns)])
        // a rounding must not leave the end of the travel outside
        .map(|x| travel.into_iter().find(|end| (x - end).abs() <= SAME * turn).unwrap_or(x))
        .collect();
    Ok(Curve::Table(Table::new(places, values(forward), reverse.map(values), interpolation)?))
}

#[cfg(test)]
mod tests {
    use core::f64::consts::TAU;

    use super::*;

    const TRAVEL: [f64; 2] = [-TAU, 1.5 * TAU];

    /// The same value at every turn of the travel, held nowhere; the value within the turn is that of the curve.
    fn same_at_every_turn(curve: &Curve, tolerance: f64) {
        let more = repeated(core::slice::from_ref(curve), TAU, TRAVEL).unwrap().unwrap();
        let [low, high] = more[0].range().unwrap();
        assert!(low <= TRAVEL[0] + 1e-9 && high >= TRAVEL[1] - 1e-9, "{low} {high}");
        for travel in [Travel::Forward, Travel::Reverse] {
            for k in 1..40 {
                let x = f64::from(k) * TAU / 40.0;
                let within = curve.value(x, travel);
                for turns in [-1.0, 0.0, 1.0] {
                    let at = x + turns * TAU;
                    if at <= TRAVEL[1] {
                        let value = more[0].value(at, travel);
                        assert!((value - within).abs() < tolerance, "{at}: {value} instead of {within}");
                    }
                }
            }
        }
        assert_eq!(repeated(&more, TAU, TRAVEL).unwrap(), None);
    }

    #[test]
    fn a_series_of_the_turn_grows_its_range() {
        let series = |period: f64, linear: f64| {
            Curve::Fourier(
                Fourier::new(0.0, TAU, period, 1e-6, linear, &[2e-6, -1e-6], &[3e-6, 5e-7]).unwrap(),
            )
        };
        same_at_every_turn(&series(TAU, 0.0), 1e-15);
        same_at_every_turn(&series(TAU / 3.0, 0.0), 1e-15);
        assert!(matches!(repeated(&[series(TAU, 0.0)], TAU, TRAVEL).unwrap().unwrap()[0], Curve::Fourier(_)));
        // what does not come back becomes a table
        assert!(matches!(repeated(&[series(TAU, 1e-6)], TAU, TRAVEL).unwrap().unwrap()[0], Curve::Table(_)));
    }

    #[test]
    fn the_points_of_a_table_are_repeated_and_its_ends_are_one_place() {
        let positions: Vec<f64> = (0..=12).map(|i| f64::from(i) * TAU / 12.0).collect();
        let forward: Vec<f64> = (0..=12).map(|i| f64::from(i % 5) * 1e-6).collect();
        let mut reverse = forward.clone();
        reverse.iter_mut().for_each(|v| *v += 1e-6);
        let closed = {
            let (mut forward, mut reverse) = (forward.clone(), reverse.clone());
            (forward[12], reverse[12]) = (forward[0], reverse[0]);
            Table::new(positions.clone(), forward, Some(reverse), Interpolation::Linear).unwrap()
        };
        same_at_every_turn(&Curve::Table(closed), 1e-15);
        let open = Curve::Table(Table::new(positions, forward, None, Interpolation::Linear).unwrap());
        let more = repeated(&[open], TAU, TRAVEL).unwrap().unwrap();
        for turns in [-1.0, 0.0, 1.0] {
            let joint = more[0].value(turns * TAU, Travel::Forward);
            assert!((joint - 1e-6).abs() < 1e-12, "{joint}");
        }
    }

    #[test]
    fn less_than_a_turn_and_a_travel_that_is_covered_stay() {
        let table = |end: f64| {
            Curve::Table(
                Table::new(vec![0.0, 1.0, end], vec![0.0, 1e-6, 0.0], None, Interpolation::Linear).unwrap(),
            )
        };
        assert_eq!(repeated(&[table(5.0)], TAU, TRAVEL).unwrap(), None);
        assert_eq!(repeated(&[table(TAU)], TAU, [0.0, TAU]).unwrap(), None);
        assert_eq!(repeated(&[Curve::Constant(1.0)], TAU, TRAVEL).unwrap(), None);
        assert!(repeated(&[table(TAU)], TAU, [0.0, 2000.0 * TAU]).is_err());
    }
}
