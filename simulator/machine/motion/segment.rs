//! Geometry of one block: a line over all axes or an arc (helix), and where it is after a length of path.
//!
//! Path length is that of the linear axes in mm; where a block only moves rotary axes it is that of the rotary
//! axes in degrees. All other axes follow in proportion.

use volcomp_units::axes::{AxisArray, MAX_AXES};

use super::axes::MachineAxes;

/// Shorter than this is no movement, mm or deg.
pub const SHORTEST: f64 = 1e-9;

/// A circular movement of two axes; the others follow in proportion to the angle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Arc {
    /// Wire index of the first and second axis of the plane.
    pub plane: [usize; 2],
    /// Centre in the plane, mm.
    pub centre: [f64; 2],
    /// Radius at start and end, mm (equal but for rounding in the program).
    pub radius: [f64; 2],
    /// Angle of the start, rad, from the first axis towards the second.
    pub from: f64,
    /// Angle swept, rad; positive from the first axis towards the second.
    pub sweep: f64,
}

/// How a segment moves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Shape {
    /// Straight over all axes.
    Line,
    /// Along a circle or helix.
    Arc(Arc),
    /// Standing still for so many seconds.
    Dwell(f64),
}

/// What the path length counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Measure {
    /// Millimetres of the linear axes.
    Linear,
    /// Degrees of the rotary axes.
    Rotary,
    /// Nothing moves.
    None,
}

/// One block of motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Segment {
    /// Axis positions at its start, mm or deg.
    pub start: AxisArray,
    /// Axis positions at its end, mm or deg.
    pub end: AxisArray,
    /// How it moves.
    pub shape: Shape,
    /// Rapid: as fast as the axes allow.
    pub rapid: bool,
    /// Programmed feed, mm/min or deg/min.
    pub feed_per_min: f64,
    /// The path comes to rest at its end.
    pub exact_stop: bool,
    /// Counts for results.
    pub scored: bool,
    /// Line of the program, 1-based.
    pub line: u32,
    /// X, Y and Z are those of the tool tip ([`super::tool_centre`]), not of the axes.
    pub tool_centre: bool,
}

impl Segment {
    /// Length of the path and what it counts.
    #[must_use]
    pub fn length(&self, axes: &MachineAxes) -> (f64, Measure) {
        let (mut linear, mut rotary) = (0.0, 0.0);
        for k in 0..axes.len() {
            let square = (self.end[k] - self.start[k]).powi(2);
            match (self.shape, axes.is_linear(k)) {
                (Shape::Arc(arc), true) if arc.plane.contains(&k) => {}
                (_, true) => linear += square,
                (_, false) => rotary += square,
            }
        }
        if let Shape::Arc(arc) = self.shape {
            let mean = 0.5 * (arc.radius[0] + arc.radius[1]);
            linear += (mean * arc.sweep).powi(2);
        }
        match (self.shape, linear.sqrt(), rotary.sqrt()) {
            (Shape::Dwell(_), ..) => (0.0, Measure::None),
            (_, l, _) if l > SHORTEST => (l, Measure::Linear),
            (_, _, r) if r > SHORTEST => (r, Measure::Rotary),
            _ => (0.0, Measure::None),
        }
    }

    /// Axis positions at a fraction 0 to 1 of the path; the ends are exact.
    #[must_use]
    pub fn point(&self, fraction: f64) -> AxisArray {
        if fraction >= 1.0 {
            return self.end;
        }
        if fraction <= 0.0 {
            return self.start;
        }
        let mut q = self.start;
        for (value, (start, end)) in q.iter_mut().zip(self.start.iter().zip(&self.end)) {
            *value += (end - start) * fraction;
        }
        if let Shape::Arc(arc) = self.shape {
            let (sin, cos) = (arc.from + arc.sweep * fraction).sin_cos();
            let radius = arc.radius[0] + (arc.radius[1] - arc.radius[0]) * fraction;
            q[arc.plane[0]] = arc.centre[0] + radius * cos;
            q[arc.plane[1]] = arc.centre[1] + radius * sin;
        }
        q
    }

    /// Change of every axis per unit of path, at a fraction of a path of this length.
    #[must_use]
    pub fn tangent(&self, fraction: f64, length: f64) -> AxisArray {
        let mut u = [0.0; MAX_AXES];
        if length <= SHORTEST {
            return u;
        }
        for (value, (start, end)) in u.iter_mut().zip(self.start.iter().zip(&self.end)) {
            *value = (end - start) / length;
        }
        if let Shape::Arc(arc) = self.shape {
            let (sin, cos) = (arc.from + arc.sweep * fraction).sin_cos();
            let radius = arc.radius[0] + (arc.radius[1] - arc.radius[0]) * fraction;
            let growth = (arc.radius[1] - arc.radius[0]) / length;
            let turn = arc.sweep / length;
            u[arc.plane[0]] = -radius * turn * sin + growth * cos;
            u[arc.plane[1]] = radius * turn * cos + growth * sin;
        }
        u
    }

    /// Largest absolute change of every axis per unit of path, anywhere on it (a bound).
    #[must_use]
    pub fn steepest(&self, length: f64) -> AxisArray {
        let mut u = self.tangent(0.0, length).map(f64::abs);
        if let Shape::Arc(arc) = self.shape
            && length > SHORTEST
        {
            let bound = arc.radius[0].max(arc.radius[1]) * arc.sweep.abs() / length
                + (arc.radius[1] - arc.radius[0]).abs() / length;
            u[arc.plane[0]] = bound;
            u[arc.plane[1]] = bound;
        }
        u
    }

    /// The corners of the box that holds the path: lowest and highest position of every axis.
    #[must_use]
    pub fn extent(&self) -> [AxisArray; 2] {
        let (mut low, mut high) = (self.start, self.start);
        let mut include = |q: AxisArray| {
            for k in 0..MAX_AXES {
                low[k] = low[k].min(q[k]);
                high[k] = high[k].max(q[k]);
            }
        };
        include(self.end);
        if let Shape::Arc(arc) = self.shape {
            let quarter = core::f64::consts::FRAC_PI_2;
            let (a, b) = (arc.from.min(arc.from + arc.sweep), arc.from.max(arc.from + arc.sweep));
            let mut angle = (a / quarter).ceil() * quarter;
            while angle < b {
                include(self.point((angle - arc.from) / arc.sweep));
                angle += quarter;
            }
        }
        [low, high]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f64::consts::{FRAC_PI_2, PI, TAU};

    fn axes() -> MachineAxes {
        MachineAxes::three_axis([0.0, 850.0], [0.0, 500.0], [0.0, 500.0]).unwrap()
    }

    fn arc(sweep: f64) -> Segment {
        let mut start = [0.0; MAX_AXES];
        start[..3].copy_from_slice(&[110.0, 100.0, 0.0]);
        let mut end = start;
        end[0] = 100.0 + 10.0 * sweep.cos();
        end[1] = 100.0 + 10.0 * sweep.sin();
        let shape =
            Shape::Arc(Arc { plane: [0, 1], centre: [100.0, 100.0], radius: [10.0, 10.0], from: 0.0, sweep });
        Segment {
            start,
            end,
            shape,
            rapid: false,
            feed_per_min: 1000.0,
            exact_stop: false,
            scored: true,
            line: 1,
            tool_centre: false,
        }
    }

    #[test]
    fn a_full_circle_is_as_long_as_it_is() {
        let (length, measure) = arc(TAU).length(&axes());
        assert!((length - TAU * 10.0).abs() < 1e-12);
        assert_eq!(measure, Measure::Linear);
    }

    #[test]
    fn a_helix_counts_its_rise() {
        let mut helix = arc(PI);
        helix.end[2] = 5.0;
        let (length, _) = helix.length(&axes());
        assert!((length - (10.0 * PI).hypot(5.0)).abs() < 1e-12);
        let u = helix.tangent(0.3, length);
        assert!((u.iter().map(|c| c * c).sum::<f64>() - 1.0).abs() < 1e-12);
    }

    #[test]
    fn the_tangent_is_the_slope_of_the_points() {
        let s = arc(1.7);
        let (length, _) = s.length(&axes());
        let h = 1e-6;
        let (a, b, u) = (s.point(0.4 - h), s.point(0.4 + h), s.tangent(0.4, length));
        for k in 0..3 {
            assert!(((b[k] - a[k]) / (2.0 * h * length) - u[k]).abs() < 1e-8);
        }
    }

    #[test]
    fn the_extent_of_an_arc_includes_its_quadrants() {
        let [low, high] = arc(PI + 0.1).extent();
        assert!((high[1] - 110.0).abs() < 1e-9 && (low[0] - 90.0).abs() < 1e-9);
        let [low, high] = arc(-FRAC_PI_2).extent();
        assert!((low[1] - 90.0).abs() < 1e-9 && (high[1] - 100.0).abs() < 1e-9);
    }
}
