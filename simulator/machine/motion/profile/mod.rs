//! Segments to positions in time: a jerk-limited speed profile along the path, sampled at the control cycle.
//!
//! Speed, acceleration and jerk along the path keep their limits everywhere; on arcs the acceleration towards the
//! centre is included. Two blocks that meet at an angle of less than 20 degrees are run through at a speed whose
//! step every axis can take (`corner_step`); at sharper corners, and after G61, the path comes to rest. A change
//! of curvature (line to tangent arc) is a step of acceleration across the path, as on any control without
//! blending.

mod plan;
mod scurve;

use volcomp_units::axes::AxisArray;

use super::axes::MachineAxes;
use super::segment::{Segment, Shape};
use super::{MotionCycle, MotionSource};
use plan::{Planned, Span};

pub use scurve::{Along, Limits, Profile, reachable};

/// Limits along the path of the linear axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Dynamics {
    /// Largest acceleration, mm/s^2.
    pub acceleration_mm_per_s2: f64,
    /// Largest jerk, mm/s^3.
    pub jerk_mm_per_s3: f64,
}

impl Default for Dynamics {
    fn default() -> Self {
        Self { acceleration_mm_per_s2: 2_000.0, jerk_mm_per_s3: 40_000.0 }
    }
}

/// Why no trajectory can be made.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum ProfileError {
    /// The cycle time is outside what a control has.
    #[error("cycle time {cycle_ms} ms; a control has 0.25 to 10 ms")]
    Cycle {
        /// What was given.
        cycle_ms: f64,
    },
    /// A limit that makes no sense.
    #[error("{what} {value}; give a finite number above 0")]
    Limit {
        /// Which.
        what: &'static str,
        /// What was given.
        value: f64,
    },
}

/// A cycle time in seconds.
///
/// # Errors
/// Outside 0.25 to 10 ms.
pub fn checked_cycle_s(cycle_s: f64) -> Result<f64, ProfileError> {
    // a little room for values that went through ms and back
    if (0.000_249_999..=0.010_000_001).contains(&cycle_s) {
        Ok(cycle_s)
    } else {
        Err(ProfileError::Cycle { cycle_ms: cycle_s * 1e3 })
    }
}

/// A program as positions in time.
#[derive(Debug, Clone)]
pub struct Trajectory {
    planned: Vec<Planned>,
    spans: Vec<Span>,
    axes: MachineAxes,
    start: AxisArray,
    end: AxisArray,
    duration_s: f64,
    cycle_s: f64,
    cycle: u64,
    span: usize,
    segment: usize,
    done: bool,
}

impl Trajectory {
    /// Plans the whole program.
    ///
    /// # Errors
    /// A cycle time or limit that makes no sense.
    pub fn new(
        start: AxisArray,
        segments: &[Segment],
        axes: &MachineAxes,
        dynamics: &Dynamics,
        cycle_s: f64,
    ) -> Result<Self, ProfileError> {
        let cycle_s = checked_cycle_s(cycle_s)?;
        for (what, value) in [
            ("path acceleration, mm/s^2,", dynamics.acceleration_mm_per_s2),
            ("path jerk, mm/s^3,", dynamics.jerk_mm_per_s3),
        ] {
            if !value.is_finite() || value <= 0.0 {
                return Err(ProfileError::Limit { what, value });
            }
        }
        let (planned, spans) = plan::plan(segments, axes, dynamics);
        let end = segments.last().map_or(start, |s| axes_at(s, 1.0, axes));
        let duration_s = spans.last().map_or(0.0, |s| s.from_s + s.duration_s());
        Ok(Self {
            planned,
            spans,
            axes: axes.clone(),
            start,
            end,
            duration_s,
            cycle_s,
            cycle: 0,
            span: 0,
            segment: 0,
            done: false,
        })
    }

    /// A rapid from one position to another; it does not count for results.
    ///
    /// # Errors
    /// A cycle time or limit that makes no sense.
    pub fn rapid(
        from: AxisArray,
        to: AxisArray,
        axes: &MachineAxes,
        dynamics: &Dynamics,
        cycle_s: f64,
    ) -> Result<Self, ProfileError> {
        let segment = Segment {
            start: from,
            end: to,
            shape: Shape::Line,
            rapid: true,
            feed_per_min: 0.0,
            exact_stop: true,
            scored: false,
            line: 0,
            tool_centre: false,
        };
        Self::new(from, &[segment], axes, dynamics, cycle_s)
    }

    /// How long it takes, s.
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        self.duration_s
    }

    /// Where it ends, mm or deg.
    #[must_use]
    pub fn end(&self) -> AxisArray {
        self.end
    }

    /// Motion along the path at a time, for inspection.
    #[must_use]
    pub fn along(&self, time_s: f64) -> Along {
        match self.spans.iter().rev().find(|s| s.from_s <= time_s) {
            Some(span) => span.profile.at(time_s - span.from_s),
            None => Along::default(),
        }
    }

    fn sample(&mut self, time_s: f64) -> MotionCycle {
        while self.span + 1 < self.spans.len() && self.spans[self.span + 1].from_s <= time_s {
            self.span += 1;
        }
        let Some(span) = self.spans.get(self.span) else {
            return MotionCycle { commanded: self.start, ..MotionCycle::default() };
        };
        let along = span.profile.at(time_s - span.from_s);
        self.segment = self.segment.clamp(span.segments[0], span.segments[1] - 1);
        while self.segment + 1 < span.segments[1] && self.planned[self.segment + 1].from <= along.length {
            self.segment += 1;
        }
        let here = &self.planned[self.segment];
        let fraction = if here.length > 0.0 { (along.length - here.from) / here.length } else { 1.0 };
        MotionCycle {
            commanded: axes_at(&here.segment, fraction, &self.axes),
            measured: None,
            feed_mm_per_min: along.velocity * 60.0,
            moving: along.velocity > 0.0 || along.acceleration != 0.0,
            scored: here.segment.scored,
            line: here.segment.line,
        }
    }
}

/// Positions of the axes at a fraction of a segment: those programmed, or those that lead the tool tip there.
fn axes_at(segment: &Segment, fraction: f64, axes: &MachineAxes) -> AxisArray {
    let programmed = segment.point(fraction);
    match axes.tool_centre().filter(|_| segment.tool_centre) {
        Some(kinematics) => kinematics.axes(&programmed),
        None => programmed,
    }
}

impl MotionSource for Trajectory {
    fn start(&self) -> AxisArray {
        self.start
    }

    fn next_cycle(&mut self) -> Option<MotionCycle> {
        if self.done {
            return None;
        }
        let time_s = self.cycle as f64 * self.cycle_s;
        self.cycle += 1;
        let mut cycle = self.sample(time_s);
        if time_s >= self.duration_s {
            self.done = true;
            cycle = MotionCycle {
                commanded: self.end,
                feed_mm_per_min: 0.0,
                moving: false,
                scored: false,
                ..cycle
            };
        }
        Some(cycle)
    }

    fn rewind(&mut self) {
        (self.cycle, self.span, self.segment, self.done) = (0, 0, 0, false);
    }
}

#[cfg(test)]
mod tests;
