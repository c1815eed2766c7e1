//! Effects of the geometry: squareness, scales, curves over a position, sag, the tool.

use core::f64::consts::PI;

use super::super::super::moment::Axis;
use super::super::{Kind, Label};
use super::Builder;
use volcomp_effects::{BELL, Shape};
use volcomp_model::geometry::{Vec3, unit};

/// Pitches of screws, racks and scales, mm.
const PITCHES: [f64; 33] = [
    0.008,
    0.01,
    0.02,
    0.04,
    0.1,
    0.2,
    0.5,
    1.0,
    2.0,
    2.5,
    2.54,
    3.0,
    PI,
    4.0,
    5.0,
    5.08,
    6.0,
    2.0 * PI,
    6.35,
    8.0,
    3.0 * PI,
    10.0,
    12.0,
    4.0 * PI,
    12.7,
    15.0,
    16.0,
    20.0,
    25.0,
    25.4,
    30.0,
    32.0,
    40.0,
];

/// Steps shorter than a quarter of a period that show it.
const FINE_STEPS: usize = 24;

/// Shortest lever through which an angle is said to act, mm.
const LEVER_MM: f64 = 1.0;

/// Effects of one linear axis that only its motion shows.
const OF_AN_AXIS: [&str; 11] = [
    "scale",
    "positioning",
    "backlash",
    "lateral-play",
    "reversal-spike",
    "cyclic",
    "servo-mismatch",
    "inertial",
    "inertial-cross",
    "sag",
    "wear",
];

/// The curves and the same with slopes of their own: the line from which a curve is counted is a choice (see
/// `Selection::absorb`).
fn with_slopes(mut shapes: Vec<Shape>) -> Vec<Shape> {
    shapes.extend(shapes.clone().iter().map(|s| s.with_line(true)));
    shapes
}

impl Builder<'_> {
    pub(super) fn geometry(&mut self) {
        let linear = self.linear();
        for axis in Axis::LINEAR.into_iter().filter(|a| self.session.machine.axis(*a).is_some()) {
            if self.facts.range[axis.slot()].is_none() {
                let because = if self.session.axes.contains(&axis) {
                    "the axis stands still in these data".to_owned()
                } else {
                    format!("no column {}", axis.column())
                };
                for effect in OF_AN_AXIS {
                    self.blind(&Label::new(effect, axis), &because);
                }
            }
        }
        for (first, second) in [(Axis::X, Axis::Y), (Axis::Y, Axis::Z), (Axis::Z, Axis::X)] {
            let mut shapes = Vec::new();
            // the angle of the later axis of the pair: of Y against X, of Z against Y, of Z against X
            let (along, over) = if first == Axis::Z { (Axis::X, Axis::Z) } else { (first, second) };
            for (along, over) in [(along, over), (over, along)] {
                if self.facts.range[over.slot()].is_some() {
                    shapes.push(Shape::Squareness { along, over });
                }
            }
            let both = [first, second].iter().all(|a| self.facts.range[a.slot()].is_some());
            let label = Label::new("squareness", format!("{first}{second}"));
            if both {
                self.add(Kind::Machine, label, shapes);
            } else {
                self.blind(&label, "both axes must move");
            }
        }
        for (axis, [low, high]) in &linear {
            let (axis, centre, half) = (*axis, 0.5 * (low + high), 0.5 * (high - low));
            self.add(Kind::Machine, Label::new("scale", axis), vec![Shape::Scale { axis }]);
            let poly = |along: Axis, degrees: &[usize]| -> Vec<Shape> {
                degrees
                    .iter()
                    .map(|high| Shape::Polynomial {
                        along,
                        over: axis,
                        low: 2,
                        high: *high,
                        centre_mm: centre,
                        half_mm: half,
                    })
                    .collect()
            };
            let positions = self.positions(axis);
            let different = positions.len();
            let degrees = |all: &[usize]| all.iter().copied().filter(|d| *d < different).collect::<Vec<_>>();
            let mut table = with_slopes(poly(axis, &degrees(&[3, 4, 5, 8, 13, 20])));
            // with more than one setup, other programmes tell lost motion from a table: then the two stay apart
            if self.facts.reverses[axis.slot()] && self.session.setups.len() == 1 {
                let pairs = degrees(&[3, 4, 5, 8, 13]).into_iter().flat_map(|high| {
                    [1, 3, high].into_iter().filter(move |r| *r <= high).map(move |r| (high, r))
                });
                table.extend(pairs.map(|(high, reverse)| Shape::Reverse {
                    axis,
                    high,
                    reverse,
                    centre_mm: centre,
                    half_mm: half,
                }));
            }
            self.add(Kind::Machine, Label::new("positioning", axis), table);
            for along in Axis::LINEAR.into_iter().filter(|a| *a != axis) {
                let shapes = with_slopes(poly(along, &degrees(&[2, 3, 5, 8])));
                self.add(Kind::Machine, Label::new("straightness", format!("e{along}{axis}")), shapes);
            }
            self.angular(axis, centre, half, &degrees(&[1, 2, 3, 5, 8]));
            self.periodic(axis, half, &positions);
            self.bumps(axis, [*low, *high], different);
            if axis != Axis::Z {
                let lever = self.lever(axis);
                let ram = |(moment, beam): (bool, bool)| Shape::Ram {
                    axis,
                    start_mm: low.min(0.0),
                    reach_mm: 2.0 * half,
                    lever,
                    moment,
                    beam,
                };
                let mut shapes: Vec<Shape> = [1.0, 1.5, 2.5]
                    .into_iter()
                    .flat_map(|f| {
                        let (length_mm, tools) = (2.0 * half * f, self.facts.tools);
                        // under a head the slope turns all that hangs on it
                        let under = self.facts.head.then_some(lever);
                        [false, true].into_iter().filter(move |t| !t || tools || under.is_some()).map(
                            move |tool| Shape::Sag {
                                axis,
                                start_mm: *low,
                                length_mm,
                                tool,
                                lever: under.filter(|_| tool),
                            },
                        )
                    })
                    .collect();
                shapes.extend([(false, false), (true, false), (true, true)].map(ram));
                self.add(Kind::Machine, Label::new("sag", axis), shapes);
            }
        }
        if self.facts.tools || self.facts.head && self.facts.lengths {
            self.add(Kind::Machine, Label::new("spindle-tilt", ""), vec![Shape::SpindleTilt]);
            self.add(Kind::Machine, Label::new("tool-length", ""), vec![Shape::ToolLength]);
        } else {
            for effect in ["spindle-tilt", "tool-length"] {
                self.blind(&Label::new(effect, ""), "one tool length only; measure two in one setup");
            }
        }
    }

    /// The positions of an axis, mm, in order, each once.
    fn positions(&self, axis: Axis) -> Vec<f64> {
        let mut seen: Vec<i64> =
            self.session.moments.iter().map(|m| (m.position[axis.slot()] * 1e3).round() as i64).collect();
        seen.sort_unstable();
        seen.dedup();
        seen.into_iter().map(|um| um as f64 * 1e-3).collect()
    }

    fn angular(&mut self, axis: Axis, centre_mm: f64, half_mm: f64, degrees: &[usize]) {
        let lever = self.lever(axis);
        for (letter, about) in [('a', Axis::X), ('b', Axis::Y), ('c', Axis::Z)] {
            let crosses = (0..3).filter(|i| *i != about.direction());
            let arm = crosses.clone().any(|i| lever.axes[i] && self.facts.range[i].is_some());
            let tool = lever.tool && about != Axis::Z || self.facts.head;
            let label = Label::new("angular", format!("e{letter}{axis}"));
            if !(arm || tool) {
                let at = self.session.moments.first().map_or_else(Vec3::zeros, |m| lever.at(m));
                let moved: [f64; 3] = unit(about.direction()).cross(&at).into();
                self.one_lever(&label, axis, moved.map(|d| d.abs() > LEVER_MM));
                self.blind(
                    &label,
                    "no lever changes: move an axis between it and the tool, or use a second tool length",
                );
                continue;
            }
            let shapes = degrees
                .iter()
                .map(|degree| Shape::Angular {
                    about,
                    over: axis,
                    degree: *degree,
                    half_mm,
                    centre_mm: Some(centre_mm),
                    lever,
                })
                .collect();
            self.add(Kind::Machine, label, shapes);
        }
    }

    fn periodic(&mut self, axis: Axis, half: f64, positions: &[f64]) {
        let label = Label::new("cyclic", axis);
        let mut steps: Vec<f64> = positions.windows(2).map(|w| w[1] - w[0]).collect();
        steps.sort_by(f64::total_cmp);
        // some of the positions must lie close together, wherever
        let step = steps.get(FINE_STEPS).copied().unwrap_or(f64::INFINITY);
        let shapes: Vec<Shape> = PITCHES
            .into_iter()
            .filter(|p| *p < 0.8 * half && *p > 4.0 * step)
            .flat_map(|pitch_mm| {
                [1, 2].into_iter().map(move |harmonics| Shape::Cyclic {
                    axis,
                    along: axis,
                    pitch_mm,
                    harmonics,
                })
            })
            .collect();
        if shapes.is_empty() {
            self.blind(&label, "positions are too far apart for a screw's pitch");
        }
        self.add(Kind::Machine, label, shapes);
    }

    fn bumps(&mut self, axis: Axis, [low, high]: [f64; 2], different: usize) {
        let label = Label::new("wear", axis);
        if different < 12 {
            self.blind(&label, "fewer than 12 positions");
            return;
        }
        let span = high - low;
        let mut shapes = Vec::new();
        for width in [0.03, 0.06, 0.12] {
            if width * span * different as f64 / span < 0.7 {
                continue;
            }
            let count = (1.7 / width).round() as usize;
            for k in 0..=count {
                let centre_mm = low + span * (0.08 + 0.84 * k as f64 / count as f64);
                shapes.push(Shape::Wear {
                    axis,
                    centre_mm,
                    width_mm: width * span,
                    power: BELL,
                    order: None,
                });
            }
        }
        self.add(Kind::Machine, label, shapes);
    }
}
