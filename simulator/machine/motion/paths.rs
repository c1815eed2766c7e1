//! Standard test programs as part program text: circle, diagonals, rectangle, line with targets, cone, S-path.
//!
//! Every program begins with a rapid to its start and marks with `(SCORE ON)` what counts. Circles run as in
//! ISO 230-4: feed-in along the radius, an arc before and behind the measured turn, feed-out. Programmed positions are those
//! of the axes: where rotary axes turn the tool (cone, S-path) no pivot length is taken out.

use core::f64::consts::{PI, TAU};
use core::fmt::Write;

use volcomp_units::axes::AxisName;

/// The plane of a circle or rectangle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Plane {
    /// G17: X and Y.
    #[default]
    Xy,
    /// G18: Z and X.
    Zx,
    /// G19: Y and Z.
    Yz,
}

impl Plane {
    /// Indices of the first and second axis in `[x, y, z]`.
    #[must_use]
    pub const fn indices(self) -> [usize; 2] {
        match self {
            Self::Xy => [0, 1],
            Self::Zx => [2, 0],
            Self::Yz => [1, 2],
        }
    }

    const fn code(self) -> &'static str {
        match self {
            Self::Xy => "G17",
            Self::Zx => "G18",
            Self::Yz => "G19",
        }
    }
}

/// Sense of turning in a plane.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Turn {
    /// G2.
    Clockwise,
    /// G3.
    #[default]
    CounterClockwise,
}

/// A ballbar circle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Circle {
    /// Its plane.
    pub plane: Plane,
    /// Centre, mm.
    pub centre_mm: [f64; 3],
    /// Radius, mm.
    pub radius_mm: f64,
    /// Feed, mm/min.
    pub feed_mm_per_min: f64,
    /// Sense.
    pub turn: Turn,
    /// Where the measured turn starts, from the first axis of the plane towards the second, deg.
    pub start_deg: f64,
    /// Arc before and behind the measured turn, deg (ISO 230-4: 180).
    pub overshoot_deg: f64,
    /// Feed-in and feed-out along the radius, mm.
    pub feed_in_mm: f64,
}

impl Default for Circle {
    fn default() -> Self {
        Self {
            plane: Plane::Xy,
            centre_mm: [0.0; 3],
            radius_mm: 100.0,
            feed_mm_per_min: 1000.0,
            turn: Turn::CounterClockwise,
            start_deg: 0.0,
            overshoot_deg: 180.0,
            feed_in_mm: 1.5,
        }
    }
}

/// Digits of a coordinate; rounding of 0.1 nm is far below every sensor.
fn n(value: f64) -> String {
    let text = format!("{value:.7}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".to_owned() } else { text.to_owned() }
}

fn xyz(p: [f64; 3]) -> String {
    format!("X{} Y{} Z{}", n(p[0]), n(p[1]), n(p[2]))
}

fn line(text: &mut String, block: &str) {
    text.push_str(block);
    text.push('\n');
}

/// A ballbar circle: feed-in, overshoot, one measured turn, overshoot, feed-out.
#[must_use]
pub fn circle(c: &Circle) -> String {
    let [u, v] = c.plane.indices();
    let centre_words = ["I", "J", "K"];
    let sign = if c.turn == Turn::Clockwise { -1.0 } else { 1.0 };
    let code = if c.turn == Turn::Clockwise { "G2" } else { "G3" };
    let at = |deg: f64, radius: f64| {
        let mut p = c.centre_mm;
        p[u] += radius * deg.to_radians().cos();
        p[v] += radius * deg.to_radians().sin();
        p
    };
    let arc = |from_deg: f64, to_deg: f64| {
        let start = at(from_deg, c.radius_mm);
        format!(
            "{code} {} {}{} {}{}",
            xyz(at(to_deg, c.radius_mm)),
            centre_words[u],
            n(c.centre_mm[u] - start[u]),
            centre_words[v],
            n(c.centre_mm[v] - start[v])
        )
    };
    let begin = c.start_deg - sign * c.overshoot_deg;
    let end = c.start_deg + sign * c.overshoot_deg;
    let mut text = String::new();
    line(&mut text, "(circle, ISO 230-4)");
    line(&mut text, "(SCORE OFF)");
    line(&mut text, &format!("G21 G90 G64 {}", c.plane.code()));
    line(&mut text, &format!("G0 {}", xyz(at(begin, c.radius_mm + c.feed_in_mm))));
    line(&mut text, &format!("F{}", n(c.feed_mm_per_min)));
    line(&mut text, &format!("G1 {}", xyz(at(begin, c.radius_mm))));
    if c.overshoot_deg > 0.0 {
        line(&mut text, &arc(begin, c.start_deg));
    }
    line(&mut text, "(SCORE ON)");
    // two halves: the ends of a whole turn would be equal only to rounding
    line(&mut text, &arc(c.start_deg, c.start_deg + sign * 180.0));
    line(&mut text, &arc(c.start_deg + sign * 180.0, c.start_deg));
    line(&mut text, "(SCORE OFF)");
    if c.overshoot_deg > 0.0 {
        line(&mut text, &arc(c.start_deg, end));
    }
    line(&mut text, &format!("G1 {}", xyz(at(end, c.radius_mm + c.feed_in_mm))));
    line(&mut text, "M30");
    text
}

/// Measured stretch from one point to another with stops at targets.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Targets {
    /// Number of targets, both ends included; fewer than two: no stops between the ends.
    pub count: u32,
    /// Standstill at each, s.
    pub dwell_s: f64,
    /// Runs there and back.
    pub cycles: u32,
    /// Feed, mm/min.
    pub feed_mm_per_min: f64,
}

impl Default for Targets {
    fn default() -> Self {
        Self { count: 0, dwell_s: 0.0, cycles: 1, feed_mm_per_min: 2000.0 }
    }
}

fn there_and_back(text: &mut String, from: [f64; 3], to: [f64; 3], t: &Targets) {
    line(text, "(SCORE OFF)");
    line(text, &format!("G21 G90 G0 {}", xyz(from)));
    line(text, &format!("F{}", n(t.feed_mm_per_min)));
    let steps = t.count.max(2) - 1;
    let at = |k: u32| {
        let share = f64::from(k) / f64::from(steps);
        [0, 1, 2].map(|i| from[i] + (to[i] - from[i]) * share)
    };
    let stop = |text: &mut String, k: u32| {
        line(text, &format!("G1 {}", xyz(at(k))));
        if t.dwell_s > 0.0 {
            line(text, &format!("G4 P{}", n(t.dwell_s)));
        }
    };
    line(text, "(SCORE ON)");
    for _ in 0..t.cycles.max(1) {
        (0..=steps).for_each(|k| stop(text, k));
        (0..steps).rev().for_each(|k| stop(text, k));
    }
    line(text, "(SCORE OFF)");
}

/// There and back between two points, with targets: a positioning test (ISO 230-2) or a plain line.
#[must_use]
pub fn line_with_targets(from_mm: [f64; 3], to_mm: [f64; 3], targets: &Targets) -> String {
    let mut text = String::from("(line)\n");
    there_and_back(&mut text, from_mm, to_mm, targets);
    line(&mut text, "M30");
    text
}

/// The four body diagonals of a volume (ISO 230-6), each there and back.
#[must_use]
pub fn body_diagonals(low_mm: [f64; 3], high_mm: [f64; 3], targets: &Targets) -> String {
    let mut text = String::from("(body diagonals, ISO 230-6)\n");
    for (number, flip) in [[false, false], [true, false], [false, true], [true, true]].iter().enumerate() {
        let (mut from, mut to) = (low_mm, high_mm);
        for k in 0..2 {
            if flip[k] {
                core::mem::swap(&mut from[k], &mut to[k]);
            }
        }
        line(&mut text, &format!("(diagonal {})", number + 1));
        there_and_back(&mut text, from, to, targets);
    }
    line(&mut text, "M30");
    text
}

/// Once around a rectangle in a plane, from a corner; stops at the corners.
#[must_use]
pub fn rectangle(plane: Plane, corner_mm: [f64; 3], size_mm: [f64; 2], feed_mm_per_min: f64) -> String {
    let [u, v] = plane.indices();
    let mut text = String::from("(rectangle)\n(SCORE OFF)\n");
    line(&mut text, &format!("G21 G90 G0 {}", xyz(corner_mm)));
    line(&mut text, &format!("F{}", n(feed_mm_per_min)));
    line(&mut text, "(SCORE ON)");
    for (a, b) in [(1.0, 0.0), (1.0, 1.0), (0.0, 1.0), (0.0, 0.0)] {
        let mut p = corner_mm;
        p[u] += a * size_mm[0];
        p[v] += b * size_mm[1];
        line(&mut text, &format!("G1 {}", xyz(p)));
    }
    line(&mut text, "(SCORE OFF)\nM30");
    text
}

/// Which rotary axes tilt the tool.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Tilt {
    /// None: a three-axis machine.
    #[default]
    None,
    /// C turns, A tilts.
    AndC(RotaryTilt),
}

/// The tilting axis beside C.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RotaryTilt {
    /// About x.
    A,
    /// About y.
    B,
}

impl Tilt {
    /// Words that point the tool along a unit vector (`[0, 0, 1]`: upright); C follows its last value without jumps.
    fn words(self, direction: [f64; 3], last_c_deg: &mut f64) -> String {
        let Self::AndC(axis) = self else { return String::new() };
        let [i, j, k] = direction;
        let tilt_deg = i.hypot(j).atan2(k).to_degrees();
        let mut c_deg = *last_c_deg;
        if i.hypot(j) > 1e-9 {
            // B tilts towards +x, A (negative) towards +y; C then turns that into the direction wanted
            let heading = j.atan2(i).to_degrees();
            c_deg = if axis == RotaryTilt::B { heading } else { heading - 90.0 };
            c_deg += 360.0 * ((*last_c_deg - c_deg) / 360.0).round();
        }
        *last_c_deg = c_deg;
        let (letter, value) = match axis {
            RotaryTilt::B => (AxisName::B, tilt_deg),
            RotaryTilt::A => (AxisName::A, -tilt_deg),
        };
        format!(" {letter}{} C{}", n(value), n(c_deg))
    }
}

/// A cone frustum test path in the manner of NAS 979: the tool lies along the flank of a tilted cone.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cone {
    /// Centre of the circle, mm.
    pub centre_mm: [f64; 3],
    /// Radius, mm.
    pub radius_mm: f64,
    /// Half angle of the cone, deg.
    pub half_angle_deg: f64,
    /// Tilt of its axis about x, deg.
    pub tilt_deg: f64,
    /// Feed, mm/min.
    pub feed_mm_per_min: f64,
    /// Blocks of the turn.
    pub blocks: u32,
    /// Rotary axes to use.
    pub rotary: Tilt,
}

impl Default for Cone {
    fn default() -> Self {
        Self {
            centre_mm: [0.0; 3],
            radius_mm: 80.0,
            half_angle_deg: 15.0,
            tilt_deg: 10.0,
            feed_mm_per_min: 1000.0,
            blocks: 720,
            rotary: Tilt::None,
        }
    }
}

/// The cone test path, as a list of short lines.
#[must_use]
pub fn cone(c: &Cone) -> String {
    let (sin_tilt, cos_tilt) = c.tilt_deg.to_radians().sin_cos();
    let tilted = |p: [f64; 3]| [p[0], p[1] * cos_tilt - p[2] * sin_tilt, p[1] * sin_tilt + p[2] * cos_tilt];
    let (sin_half, cos_half) = c.half_angle_deg.to_radians().sin_cos();
    let points = (0..=c.blocks).map(|k| {
        let (sin, cos) = (TAU * f64::from(k) / f64::from(c.blocks.max(1))).sin_cos();
        let p = tilted([c.radius_mm * cos, c.radius_mm * sin, 0.0]);
        // the flank leans towards the axis of the cone
        let direction = tilted([-sin_half * cos, -sin_half * sin, cos_half]);
        ([0, 1, 2].map(|i| c.centre_mm[i] + p[i]), direction)
    });
    list("(cone)", points, c.rotary, c.feed_mm_per_min)
}

/// An S-shaped test path in the manner of ISO 10791-7 test M4: two opposite bends with changing tilt.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SPath {
    /// Middle of the S, mm.
    pub centre_mm: [f64; 3],
    /// Length along x, mm.
    pub length_mm: f64,
    /// Width along y, mm.
    pub width_mm: f64,
    /// Rise along z, mm.
    pub rise_mm: f64,
    /// Largest tilt of the tool, deg.
    pub tilt_deg: f64,
    /// Feed, mm/min.
    pub feed_mm_per_min: f64,
    /// Blocks.
    pub blocks: u32,
    /// Rotary axes to use.
    pub rotary: Tilt,
}

impl Default for SPath {
    fn default() -> Self {
        Self {
            centre_mm: [0.0; 3],
            length_mm: 200.0,
            width_mm: 100.0,
            rise_mm: 20.0,
            tilt_deg: 15.0,
            feed_mm_per_min: 2000.0,
            blocks: 1000,
            rotary: Tilt::None,
        }
    }
}

/// The S-shaped path, as a list of short lines.
#[must_use]
pub fn s_path(s: &SPath) -> String {
    let points = (0..=s.blocks).map(|k| {
        let u = f64::from(k) / f64::from(s.blocks.max(1));
        let p = [
            s.centre_mm[0] + s.length_mm * (u - 0.5),
            s.centre_mm[1] + 0.5 * s.width_mm * (TAU * u).sin(),
            s.centre_mm[2] + s.rise_mm * (u - 0.5),
        ];
        // tilted across the path, one way in the first bend and the other way in the second, never upright
        let tilt = s.tilt_deg.to_radians() * (0.6 + 0.4 * (TAU * u).cos());
        let heading = PI / 2.0 + (0.5 * s.width_mm * TAU * (TAU * u).cos() / s.length_mm).atan();
        (p, [tilt.sin() * heading.cos(), tilt.sin() * heading.sin(), tilt.cos()])
    });
    list("(S-path)", points, s.rotary, s.feed_mm_per_min)
}

fn list(
    title: &str,
    points: impl Iterator<Item = ([f64; 3], [f64; 3])>,
    rotary: Tilt,
    feed_mm_per_min: f64,
) -> String {
    let mut text = format!("{title}\n(SCORE OFF)\nG21 G90 G64\n");
    let mut c_deg = 0.0;
    for (k, (p, direction)) in points.enumerate() {
        let words = rotary.words(direction, &mut c_deg);
        let code = if k == 0 { "G0" } else { "G1" };
        // writing to a String cannot fail
        let _ = writeln!(text, "{code} {}{words}", xyz(p));
        if k == 0 {
            let _ = writeln!(text, "F{}\n(SCORE ON)", n(feed_mm_per_min));
        }
    }
    line(&mut text, "(SCORE OFF)\nM30");
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motion::axes::{AxisSetup, MachineAxes};
    use crate::motion::gcode::interpret;
    use crate::motion::segment::Shape;

    fn five_axes() -> MachineAxes {
        let linear = [AxisName::X, AxisName::Y, AxisName::Z].map(|n| AxisSetup::new(n, [-500.0, 500.0]));
        let rotary = [AxisName::A, AxisName::B, AxisName::C].map(|n| AxisSetup::new(n, [-800.0, 800.0]));
        MachineAxes::new(linear.into_iter().chain(rotary).collect()).unwrap()
    }

    #[test]
    fn circles_of_every_kind_turn_once_where_it_counts() {
        for plane in [Plane::Xy, Plane::Zx, Plane::Yz] {
            for turn in [Turn::Clockwise, Turn::CounterClockwise] {
                for (overshoot_deg, start_deg) in [(180.0, 0.0), (45.0, 30.0), (0.0, 270.0)] {
                    let c = Circle {
                        plane,
                        turn,
                        overshoot_deg,
                        start_deg,
                        centre_mm: [1.0, 2.0, 3.0],
                        ..Circle::default()
                    };
                    let p = interpret(&circle(&c), &five_axes(), [0.0; 8]).unwrap();
                    let swept: f64 = p
                        .segments
                        .iter()
                        .filter(|s| s.scored)
                        .map(|s| match s.shape {
                            Shape::Arc(arc) => {
                                assert_eq!(arc.plane, plane.indices());
                                assert!((arc.radius[0] - 100.0).abs() < 1e-6);
                                arc.sweep
                            }
                            _ => panic!("only arcs count"),
                        })
                        .sum();
                    let sign = if turn == Turn::Clockwise { -1.0 } else { 1.0 };
                    assert!((swept - sign * TAU).abs() < 1e-6, "{swept}");
                }
            }
        }
    }

    #[test]
    fn diagonals_reach_all_eight_corners() {
        let text =
            body_diagonals([0.0; 3], [100.0, 200.0, 300.0], &Targets { count: 5, ..Targets::default() });
        let p = interpret(&text, &five_axes(), [0.0; 8]).unwrap();
        for corner in 0..8_u32 {
            let at = [0, 1, 2].map(|k| if corner >> k & 1 == 1 { [100.0, 200.0, 300.0][k] } else { 0.0 });
            assert!(p.segments.iter().any(|s| s.end[..3] == at && s.scored), "{at:?}");
        }
    }

    #[test]
    fn targets_are_evenly_spaced_and_dwelt_on() {
        let targets = Targets { count: 3, dwell_s: 0.25, cycles: 2, feed_mm_per_min: 500.0 };
        let text = line_with_targets([0.0; 3], [100.0, 0.0, 0.0], &targets);
        let p = interpret(&text, &five_axes(), [0.0; 8]).unwrap();
        let dwells = p.segments.iter().filter(|s| matches!(s.shape, Shape::Dwell(_))).map(|s| s.end[0]);
        assert_eq!(dwells.collect::<Vec<_>>(), [0.0, 50.0, 100.0, 50.0, 0.0, 0.0, 50.0, 100.0, 50.0, 0.0]);
    }

    #[test]
    fn the_rectangle_closes() {
        let text = rectangle(Plane::Zx, [1.0, 2.0, 3.0], [10.0, 20.0], 100.0);
        let p = interpret(&text, &five_axes(), [0.0; 8]).unwrap();
        assert_eq!(p.end[..3], [1.0, 2.0, 3.0]);
        assert!(p.segments.iter().any(|s| s.end[..3] == [21.0, 2.0, 13.0]));
    }

    #[test]
    fn tilting_axes_point_the_tool_where_it_should() {
        for axis in [RotaryTilt::A, RotaryTilt::B] {
            let text = cone(&Cone { rotary: Tilt::AndC(axis), ..Cone::default() });
            let p = interpret(&text, &five_axes(), [0.0; 8]).unwrap();
            let mut last_c = p.segments[0].end[5];
            for (k, s) in p.segments.iter().enumerate() {
                let [a, b, c] = [s.end[3].to_radians(), s.end[4].to_radians(), s.end[5].to_radians()];
                // Rz(c) Rx(a) Ry(b) z with one of a, b zero
                let tool = [b.sin(), -a.sin() * b.cos(), a.cos() * b.cos()];
                let tool =
                    [tool[0] * c.cos() - tool[1] * c.sin(), tool[0] * c.sin() + tool[1] * c.cos(), tool[2]];
                let phi = TAU * k as f64 / 720.0;
                let (half, tilt) = (15.0_f64.to_radians(), 10.0_f64.to_radians());
                let f = [-half.sin() * phi.cos(), -half.sin() * phi.sin(), half.cos()];
                let expected =
                    [f[0], f[1] * tilt.cos() - f[2] * tilt.sin(), f[1] * tilt.sin() + f[2] * tilt.cos()];
                for i in 0..3 {
                    assert!((tool[i] - expected[i]).abs() < 1e-8, "{k}: {tool:?} {expected:?}");
                }
                assert!((s.end[5] - last_c).abs() < 20.0, "C jumps at {k}");
                last_c = s.end[5];
            }
        }
    }

    #[test]
    fn the_s_path_has_two_opposite_bends() {
        let text = s_path(&SPath { rotary: Tilt::AndC(RotaryTilt::B), ..SPath::default() });
        let p = interpret(&text, &five_axes(), [0.0; 8]).unwrap();
        let y = |share: f64| p.segments[(share * 1000.0) as usize].end[1];
        assert!((y(0.25) - 50.0).abs() < 1e-6 && (y(0.75) + 50.0).abs() < 1e-6);
        assert!(p.segments.iter().all(|s| s.end[4].abs() <= 15.0 + 1e-9));
    }
}
