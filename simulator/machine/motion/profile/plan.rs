//! How fast each block may go and how blocks join: limits per segment, corner speeds, spans, look-ahead.
//!
//! Blocks that meet without a corner worth slowing down for form one span with one speed profile, so that lists of
//! short blocks run smoothly. Where spans meet the speed is that of the corner (zero at a sharp one) and the
//! acceleration zero.

use core::f64::consts::FRAC_1_SQRT_2;

use volcomp_units::axes::{AxisArray, MAX_AXES};

use super::super::axes::MachineAxes;
use super::super::segment::{Measure, Segment, Shape};
use super::Dynamics;
use super::scurve::{Limits, Profile, reachable};

/// Directions that differ by more than this length of unit-vector difference (20 degrees) are a sharp corner.
const SHARP: f64 = 0.347;
/// Segments whose speed limits differ by more than this share do not share a span.
const SAME_SPEED: f64 = 0.05;

/// A segment with its place on the path and its limits.
#[derive(Debug, Clone, Copy)]
pub(super) struct Planned {
    pub(super) segment: Segment,
    pub(super) length: f64,
    /// Length from the start of its span to its start.
    pub(super) from: f64,
    measure: Measure,
    limits: Limits,
}

/// Segments with one speed profile, or a dwell.
#[derive(Debug, Clone, Copy)]
pub(super) struct Span {
    /// First and one past the last segment.
    pub(super) segments: [usize; 2],
    pub(super) from_s: f64,
    pub(super) profile: Profile,
    pub(super) dwell_s: f64,
    length: f64,
    limits: Limits,
    entry: f64,
    exit: f64,
}

impl Span {
    pub(super) fn duration_s(&self) -> f64 {
        self.profile.duration_s() + self.dwell_s
    }
}

/// Segments and spans of a whole program.
pub(super) fn plan(
    segments: &[Segment],
    axes: &MachineAxes,
    dynamics: &Dynamics,
) -> (Vec<Planned>, Vec<Span>) {
    let mut planned: Vec<Planned> = segments
        .iter()
        .map(|&segment| {
            let (length, measure) = segment.length(axes);
            let limits = limits(&segment, length, measure, axes, dynamics);
            Planned { segment, length, from: 0.0, measure, limits }
        })
        .filter(|p| p.measure != Measure::None || matches!(p.segment.shape, Shape::Dwell(_)))
        .collect();
    let mut spans = join(&mut planned, axes, dynamics);
    look_ahead(&mut spans);
    let mut time = 0.0;
    for span in &mut spans {
        span.profile = Profile::new(span.length, span.entry, span.exit, &span.limits);
        span.from_s = time;
        time += span.duration_s();
    }
    (planned, spans)
}

/// Speed, acceleration and jerk that a segment allows along its path.
fn limits(
    segment: &Segment,
    length: f64,
    measure: Measure,
    axes: &MachineAxes,
    dynamics: &Dynamics,
) -> Limits {
    if measure == Measure::None {
        return Limits { velocity: 1.0, acceleration: 1.0, jerk: 1.0 };
    }
    let mut limits = Limits {
        velocity: if segment.rapid { f64::INFINITY } else { segment.feed_per_min / 60.0 },
        acceleration: if measure == Measure::Linear {
            dynamics.acceleration_mm_per_s2
        } else {
            f64::INFINITY
        },
        jerk: if measure == Measure::Linear { dynamics.jerk_mm_per_s3 } else { f64::INFINITY },
    };
    let steepest = match axes.tool_centre().filter(|_| segment.tool_centre) {
        Some(kinematics) => kinematics.steepest(segment, length),
        None => segment.steepest(length),
    };
    for (axis, &u) in axes.as_slice().iter().zip(&steepest).filter(|(_, u)| **u > 1e-12) {
        limits.velocity = limits.velocity.min(axis.rapid_per_min / 60.0 / u);
        limits.acceleration = limits.acceleration.min(axis.acceleration / u);
        limits.jerk = limits.jerk.min(axis.jerk / u);
    }
    if let Shape::Arc(arc) = segment.shape {
        // share the acceleration between the path and the centre: together never more than the limit
        limits.acceleration *= FRAC_1_SQRT_2;
        let radius = arc.radius[0].min(arc.radius[1]).max(1e-6);
        let in_plane = (0.5 * (arc.radius[0] + arc.radius[1]) * arc.sweep / length).abs().clamp(1e-6, 1.0);
        limits.velocity = limits.velocity.min((limits.acceleration * radius).sqrt() / in_plane);
        limits.velocity = limits.velocity.min((limits.jerk * radius * radius).cbrt() / in_plane);
    }
    limits
}

/// Speed at which one segment may run into the next.
fn corner(a: &Planned, b: &Planned, axes: &MachineAxes, dynamics: &Dynamics) -> f64 {
    let stop = a.measure != b.measure
        || a.measure == Measure::None
        || a.segment.rapid != b.segment.rapid
        || a.segment.tool_centre != b.segment.tool_centre
        || a.segment.exact_stop;
    if stop {
        return 0.0;
    }
    let (before, after) = (a.segment.tangent(1.0, a.length), b.segment.tangent(0.0, b.length));
    let of_axes = |p: &Planned, fraction: f64, programmed: AxisArray| match axes.tool_centre() {
        Some(kinematics) if p.segment.tool_centre => kinematics.tangent(&p.segment, fraction, p.length),
        _ => programmed,
    };
    let (axes_before, axes_after) = (of_axes(a, 1.0, before), of_axes(b, 0.0, after));
    let mut speed = f64::INFINITY;
    let mut turn = 0.0;
    let between = a.length.min(b.length);
    for (k, axis) in axes.as_slice().iter().enumerate().take(MAX_AXES) {
        let step = (after[k] - before[k]).abs();
        if axes.is_linear(k) == (a.measure == Measure::Linear) {
            turn += step * step;
        }
        let step = (axes_after[k] - axes_before[k]).abs();
        if step > 1e-9 {
            // a step of speed that the axis can take, and no more curvature than its acceleration follows
            let acceleration = axis.acceleration.min(dynamics.acceleration_mm_per_s2.max(1.0));
            speed = speed.min(axis.corner_step / step).min((acceleration * between / step).sqrt());
        }
    }
    if turn.sqrt() > SHARP { 0.0 } else { speed }
}

/// Groups segments into spans; `exit` of each holds the corner speed to the next for the look-ahead.
fn join(planned: &mut [Planned], axes: &MachineAxes, dynamics: &Dynamics) -> Vec<Span> {
    let mut spans: Vec<Span> = Vec::new();
    for k in 0..planned.len() {
        let here = planned[k];
        let meeting = if k > 0 { corner(&planned[k - 1], &here, axes, dynamics) } else { 0.0 };
        if let Some(span) = spans.last_mut() {
            let (slow, fast) = ordered(span.limits.velocity, here.limits.velocity);
            let same_feed = planned[k - 1].segment.rapid == here.segment.rapid
                && (here.segment.rapid || planned[k - 1].segment.feed_per_min == here.segment.feed_per_min);
            let (soft, hard) = ordered(span.limits.acceleration, here.limits.acceleration);
            if same_feed && meeting >= slow && fast <= slow * (1.0 + SAME_SPEED) && hard <= 2.0 * soft {
                planned[k].from = span.length;
                span.length += here.length;
                span.segments[1] = k + 1;
                span.limits = Limits {
                    velocity: slow,
                    acceleration: soft,
                    jerk: span.limits.jerk.min(here.limits.jerk),
                };
                continue;
            }
            span.exit = meeting.min(slow);
        }
        let dwell_s = if let Shape::Dwell(seconds) = here.segment.shape { seconds } else { 0.0 };
        spans.push(Span {
            segments: [k, k + 1],
            from_s: 0.0,
            profile: Profile::new(0.0, 0.0, 0.0, &here.limits),
            dwell_s,
            length: here.length,
            limits: here.limits,
            entry: 0.0,
            exit: 0.0,
        });
    }
    spans
}

fn ordered(a: f64, b: f64) -> (f64, f64) {
    if a < b { (a, b) } else { (b, a) }
}

/// Lowers the speeds between spans to what can be reached from both sides: last to first, then first to last.
fn look_ahead(spans: &mut [Span]) {
    let mut after = 0.0;
    for span in spans.iter_mut().rev() {
        span.exit = span.exit.min(after).min(span.limits.velocity);
        span.entry = reachable(span.exit, span.length, &span.limits);
        after = span.entry;
    }
    let mut before = 0.0_f64;
    for span in spans.iter_mut() {
        span.entry = span.entry.min(before);
        span.exit = span.exit.min(reachable(span.entry, span.length, &span.limits));
        before = span.exit;
    }
}
