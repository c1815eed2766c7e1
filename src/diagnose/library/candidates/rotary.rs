//! Effects of the rotary axes.

use super::super::super::moment::Axis;
use super::super::{Kind, Label};
use super::Builder;
use volcomp_effects::RotaryFrame;
use volcomp_effects::Shape;
use volcomp_model::geometry::Vec3;

impl Builder<'_> {
    pub(super) fn rotary(&mut self) {
        let machine = self.session.machine.clone();
        for axis in [Axis::A, Axis::B, Axis::C] {
            if self.facts.range[axis.slot()].is_none() {
                if self.session.axes.contains(&axis) {
                    self.blind(&Label::new("rotary-location", axis), "the axis stands still in these data");
                }
                continue;
            }
            let entry = machine.axis(axis);
            let (outer, inner) = machine.around(axis);
            let point = |a: &Axis| machine.axis(*a).map_or([0.0; 3], |e| e.point_mm.into());
            let frame = RotaryFrame {
                axis,
                workpiece_side: entry.is_some_and(|e| e.workpiece_side),
                point_mm: point(&axis),
                outer_points_mm: outer.iter().map(point).collect(),
                outer,
                inner_points_mm: inner.iter().map(point).collect(),
                inner,
                tip_mm: machine.tool_tip_mm.into(),
                nose_mm: machine.gauge_point_mm.filter(|_| self.facts.lengths).map(Vec3::into),
            };
            let mut shapes = vec![Shape::RotaryLocation { frame: frame.clone(), tied: false }];
            // where the head stands at the zero of the axis either counts as right, or is wrong with the axis
            if !frame.workpiece_side {
                shapes.push(Shape::RotaryLocation { frame: frame.clone(), tied: true });
            }
            self.add(Kind::Machine, Label::new("rotary-location", axis), shapes);
            let mut shapes = Vec::new();
            // what stands on another rotary axis turns with it
            let turns = Some(frame.clone()).filter(|f| !f.outer.is_empty());
            for along in [vec![Axis::X], vec![Axis::Y], vec![Axis::Z], Axis::LINEAR.to_vec()] {
                for (low, high) in [(2, 2), (2, 3), (2, 5)] {
                    shapes.push(Shape::RotaryMotion {
                        axis,
                        along: along.clone(),
                        low,
                        high,
                        frame: turns.clone(),
                    });
                }
            }
            self.add(Kind::Machine, Label::new("rotary-motion", axis), shapes);
            self.add(
                Kind::Machine,
                Label::new("rotary-eccentricity", axis),
                [1, 2]
                    .map(|harmonics| Shape::RotaryEccentricity { frame: frame.clone(), harmonics })
                    .to_vec(),
            );
            let lag = vec![Shape::RotaryLag { frame: frame.clone() }];
            let label = Label::new("servo-mismatch", axis);
            if self.facts.moves[axis.slot()] {
                // alone in motion, it cannot be told from a delay of all axes
                if self.facts.moves.iter().filter(|m| **m).count() == 1 {
                    self.add(Kind::Machine, Label::new("latency", ""), lag.clone());
                }
                self.add(Kind::Machine, label, lag);
            } else {
                self.blind(&label, "no readings while the axis moves");
            }
            self.add(
                Kind::Machine,
                Label::new("scale", axis),
                vec![Shape::RotaryScale { frame: frame.clone() }],
            );
            if self.facts.reverses[axis.slot()] {
                self.add(Kind::Machine, Label::new("backlash", axis), vec![Shape::RotaryBacklash { frame }]);
            }
        }
    }
}
