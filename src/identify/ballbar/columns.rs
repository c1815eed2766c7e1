//! Columns of the design: what a unit of each effect adds to each reading.

use core::f64::consts::{FRAC_PI_2, PI, TAU};

use super::runs::{elapsed, run_starts, sign};
use super::{Circles, Effect, End, Pitch, Reason, Sample};

/// What a column stands for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum What {
    /// Radius at a feed (index), or centre.
    Radius(usize),
    /// Centre along the first or second axis.
    Centre(usize),
    /// A shape of place around a reversal, equal in both directions: no effect, but no spike either.
    Place,
    /// The change of the instrument's length along the runs.
    LengthChange,
    /// A step of its length between two runs.
    LengthStep,
    /// A number of an effect.
    Of(Effect, Option<End>),
}

/// A column with what it stands for.
#[derive(Debug, Clone)]
pub(super) struct Column {
    pub(super) what: What,
    pub(super) values: Vec<f64>,
}

/// A reversal counts as seen where there are readings this close behind and before it, rad.
const NEAR: f64 = 8.0 * PI / 180.0;
/// A spike has faded after this many times to its peak.
const FADED: f64 = 15.0;

/// The angle of the reversal of an axis at an end of its travel.
fn reversal(axis: usize, end: End) -> f64 {
    let first = if axis == 0 { 0.0 } else { FRAC_PI_2 };
    if end == End::Positive { first } else { first + PI }
}

/// Angle travelled since the reversal at `at`, 0 to 2 pi.
fn since(s: &Sample, at: f64) -> f64 {
    (sign(s.travel) * (s.angle - at)).rem_euclid(TAU)
}

/// Speed of both axes, as a share of that along the path and in the sense of the angle.
fn speeds(angle: f64) -> [f64; 2] {
    [-angle.sin(), angle.cos()]
}

/// Coordinate of an axis about the centre, in radii.
fn along(axis: usize, s: &Sample) -> f64 {
    if axis == 0 { s.angle.cos() } else { s.angle.sin() }
}

/// Below this share of the speed along the path an axis stands: a reading there is from before its reversal or from behind it.
const STANDS: f64 = 1e-6;

/// The circles without the readings at which an axis reverses.
pub(super) fn away_from_reversals(circles: &Circles) -> Circles {
    let moves = |s: &&Sample| speeds(s.angle).iter().all(|v| v.abs() > STANDS);
    Circles { samples: circles.samples.iter().filter(moves).copied().collect(), ..circles.clone() }
}

/// True where the path has this reversal.
pub(super) fn is_seen(samples: &[Sample], axis: usize, end: End) -> bool {
    let at = reversal(axis, end);
    [true, false].into_iter().any(|forward| {
        let mut behind = false;
        let mut before = false;
        for s in samples.iter().filter(|s| (sign(s.travel) > 0.0) == forward) {
            let travelled = since(s, at);
            behind |= travelled < NEAR;
            before |= travelled > TAU - NEAR;
        }
        behind && before
    })
}

/// True where circles of both senses are among the readings.
fn goes_both_ways(samples: &[Sample]) -> bool {
    [1.0, -1.0].into_iter().all(|sense| samples.iter().any(|s| sign(s.travel) == sense))
}

/// The feeds, increasing; one entry without feed where none is known.
pub(super) fn feeds(samples: &[Sample]) -> Vec<Option<f64>> {
    let mut feeds: Vec<Option<f64>> = samples.iter().map(|s| s.feed).collect();
    feeds.sort_by(|a, b| a.unwrap_or(0.0).total_cmp(&b.unwrap_or(0.0)));
    feeds.dedup();
    feeds
}

/// Centre and radius: what a circle has without any error of the machine.
pub(super) fn of_circle(circles: &Circles) -> Vec<Column> {
    let samples = &circles.samples;
    let radii = feeds(samples).into_iter().enumerate().map(|(i, feed)| Column {
        what: What::Radius(i),
        values: samples.iter().map(|s| f64::from(u8::from(s.feed == feed))).collect(),
    });
    let centre = [f64::cos as fn(f64) -> f64, f64::sin]
        .into_iter()
        .enumerate()
        .map(|(i, f)| Column { what: What::Centre(i), values: samples.iter().map(|s| f(s.angle)).collect() });
    radii.chain(centre).collect()
}

/// A length of the instrument that changes linearly along the runs, and the steps in the pauses between them, whose length nobody
/// recorded.
pub(super) fn of_length(circles: &Circles) -> Vec<Column> {
    let samples = &circles.samples;
    let step = |first: usize| (0..samples.len()).map(|i| if i < first { -0.5 } else { 0.5 }).collect();
    let steps = run_starts(samples).into_iter().skip(1).map(step);
    let steps = steps.map(|values| Column { what: What::LengthStep, values });
    core::iter::once(Column { what: What::LengthChange, values: elapsed(samples) }).chain(steps).collect()
}

/// Width of the play of each axis at the positive and negative end of its travel, mm: behind a reversal the carriage rests until the drive
/// has crossed it. 0: lost motion is a step.
pub(super) type Play = [[f64; 2]; 2];

/// True where a reading was taken while play of this width was crossed.
pub(super) fn is_crossing(circles: &Circles, play: Play) -> bool {
    let crossing = |s: &Sample| (0..2).any(|axis| crossed(axis, s, circles.radius, play) < 1.0);
    circles.samples.iter().any(crossing)
}

/// Share of the play that an axis has crossed since its reversal.
fn crossed(axis: usize, s: &Sample, radius: f64, play: Play) -> f64 {
    let along = along(axis, s);
    let is_from_positive_end = axis_travel(axis, s) < 0.0;
    let way = radius * if is_from_positive_end { 1.0 - along } else { 1.0 + along };
    let width = play[axis][usize::from(!is_from_positive_end)];
    if way < width { way / width } else { 1.0 }
}

/// All effects without spikes and cyclic errors, most certain first; and those that the path cannot have.
pub(super) fn of_effects(circles: &Circles, play: Play) -> (Vec<Column>, Vec<(Effect, Reason)>) {
    let samples = &circles.samples;
    let r = circles.radius;
    let column =
        |what: What, f: &dyn Fn(&Sample) -> f64| Column { what, values: samples.iter().map(f).collect() };
    let mut columns = vec![
        column(What::Of(Effect::Squareness, None), &|s| -r * s.angle.sin() * s.angle.cos()),
        column(What::Of(Effect::ScaleMismatch, None), &|s| r / 2.0 * (2.0 * s.angle).cos()),
        column(What::Of(Effect::ServoMismatch, None), &|s| {
            // without a feed the unit is that of 1 mm/s
            -sign(s.travel) * s.feed.unwrap_or(1.0) / 2.0 * (2.0 * s.angle).sin()
        }),
    ];
    let mut missing = Vec::new();
    let both = goes_both_ways(samples);
    type Kind<'a> = (fn(usize) -> Effect, &'a dyn Fn(usize, &Sample) -> f64);
    let lost_motion = |axis: usize, s: &Sample| backlash(axis, s) * (2.0 * crossed(axis, s, r, play) - 1.0);
    let kinds: [Kind<'_>; 2] = [(Effect::Backlash, &lost_motion), (Effect::LateralPlay, &lateral_play)];
    for (make, value) in kinds {
        for axis in 0..2 {
            let seen = [End::Positive, End::Negative].map(|end| is_seen(samples, axis, end));
            let effect = make(axis);
            // lateral play is the difference between the directions: in one of them it is nearly an ellipse
            if !both && matches!(effect, Effect::LateralPlay(_)) {
                missing.push((effect, Reason::LooksLike(vec![Effect::ScaleMismatch])));
                continue;
            }
            match seen {
                [true, true] => {
                    for end in [End::Positive, End::Negative] {
                        columns.push(column(What::Of(effect, Some(end)), &|s| {
                            value(axis, s) * towards(axis, end, s)
                        }));
                    }
                }
                [false, false] => missing.push((effect, Reason::NoReversal(None))),
                [positive, _] => {
                    let (end, other) = if positive {
                        (End::Positive, End::Negative)
                    } else {
                        (End::Negative, End::Positive)
                    };
                    missing.push((effect, Reason::NoReversal(Some(other))));
                    columns.push(column(What::Of(effect, Some(end)), &|s| value(axis, s)));
                }
            }
        }
    }
    for axis in 0..2 {
        let f = move |s: &Sample| if axis == 0 { s.angle.sin() } else { s.angle.cos() }.powi(3);
        columns.push(column(What::Of(Effect::Straightness(axis), None), &f));
    }
    (columns, missing)
}

/// Sense in which an axis travels: +1 towards plus.
fn axis_travel(axis: usize, s: &Sample) -> f64 {
    (sign(s.travel) * speeds(s.angle)[axis]).signum()
}

/// Lost motion: the axis lags half of it behind, whichever way it goes.
fn backlash(axis: usize, s: &Sample) -> f64 {
    -0.5 * axis_travel(axis, s) * along(axis, s)
}

/// Travel of an axis shifts the tool along the other one.
fn lateral_play(axis: usize, s: &Sample) -> f64 {
    0.5 * axis_travel(axis, s) * if axis == 0 { s.angle.sin() } else { s.angle.cos() }
}

/// 1 at one end of travel, 0 at the other.
fn towards(axis: usize, end: End, s: &Sample) -> f64 {
    let along = along(axis, s);
    if end == End::Positive { (1.0 + along) / 2.0 } else { (1.0 - along) / 2.0 }
}

/// Columns of spikes.
pub(super) struct Spikes {
    /// What static errors around the reversals may look like, where both directions tell them from spikes.
    pub(super) places: Vec<Column>,
    /// The spikes.
    pub(super) spikes: Vec<Column>,
    /// Axes without a reversal at an end of travel.
    pub(super) missing: Vec<(Effect, Reason)>,
}

/// Spikes at all reversals that the path has, `time` s (without feed: rad) from reversal to peak. A spike stands behind
/// its reversal, which is the other side in the other direction; what stands on both sides whatever the direction is
/// a shape of the machine.
pub(super) fn of_spikes(circles: &Circles, time: f64) -> Spikes {
    let samples = &circles.samples;
    let both = goes_both_ways(samples);
    let mut all = Spikes { places: Vec::new(), spikes: Vec::new(), missing: Vec::new() };
    for axis in 0..2 {
        let effect = Effect::ReversalSpike(axis);
        let (ends, absent): (Vec<End>, Vec<End>) =
            [End::Positive, End::Negative].into_iter().partition(|e| is_seen(samples, axis, *e));
        match absent[..] {
            [] => {}
            [end] => all.missing.push((effect, Reason::NoReversal(Some(end)))),
            _ => all.missing.push((effect, Reason::NoReversal(None))),
        }
        for end in ends {
            let at = reversal(axis, end);
            let shape = |s: &Sample, way: f64| {
                let x = s.feed.map_or(way, |f| way * circles.radius / f) / time;
                if x < FADED { x * (1.0 - x).exp() } else { 0.0 }
            };
            let values = samples.iter().map(|s| shape(s, since(s, at))).collect();
            all.spikes.push(Column { what: What::Of(effect, Some(end)), values });
            if both {
                let either = |s: &Sample| {
                    let way = (s.angle - at).rem_euclid(TAU);
                    shape(s, way) + shape(s, TAU - way)
                };
                all.places.push(Column { what: What::Place, values: samples.iter().map(either).collect() });
            }
        }
    }
    all
}

/// Sine and cosine of a cyclic error with this pitch.
pub(super) fn of_cyclic(circles: &Circles, axis: usize, pitch: f64) -> [Column; 2] {
    let along = |s: &Sample| along(axis, s);
    let phase = |s: &Sample| TAU * (circles.centre[axis] + circles.radius * along(s)) / pitch;
    [f64::sin as fn(f64) -> f64, f64::cos].map(|f| Column {
        what: What::Of(Effect::Cyclic(axis), None),
        values: circles.samples.iter().map(|s| along(s) * f(phase(s))).collect(),
    })
}

/// The pitch that is given.
pub(super) const fn given(pitch: Pitch) -> Option<f64> {
    match pitch {
        Pitch::Given(p) => Some(p),
        _ => None,
    }
}
