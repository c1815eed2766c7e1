//! Effects of motion: reversals, servo, inertia, delays, loads, clocks.

use std::collections::BTreeMap;

use super::super::super::moment::Axis;
use super::super::super::session::is_encoder;
use super::super::{Kind, Label};
use super::Builder;
use volcomp_effects::Lever;
use volcomp_effects::{STILL, Shape};

/// Transition lengths of backlash, mm.
const LENGTHS: [f64; 6] = [0.0, 0.05, 0.2, 0.6, 2.0, 6.0];
/// Decay times of reversal spikes, s.
const FALLS: [f64; 8] = [0.005, 0.01, 0.02, 0.04, 0.08, 0.15, 0.3, 0.6];

impl Builder<'_> {
    pub(super) fn reversals(&mut self) {
        for axis in Axis::LINEAR {
            let i = axis.slot();
            if self.facts.range[i].is_none() {
                continue;
            }
            if !self.facts.reverses[i] {
                for effect in ["backlash", "lateral-play", "reversal-spike"] {
                    self.blind(&Label::new(effect, axis), "the axis is measured in one direction only");
                }
                continue;
            }
            let backlash = |along: Vec<Axis>, slope: bool| {
                LENGTHS.map(|length_mm| Shape::Backlash { axis, along: along.clone(), length_mm, slope })
            };
            let mut shapes = Vec::from(backlash(vec![axis], false));
            shapes.extend(backlash(vec![axis], true));
            self.add(Kind::Machine, Label::new("backlash", axis), shapes);
            let others: Vec<Axis> = Axis::LINEAR.into_iter().filter(|a| *a != axis).collect();
            let mut play = Vec::new();
            for along in others.iter().map(|o| vec![*o]).chain([others.clone()]) {
                play.extend(backlash(along, false));
            }
            self.add(Kind::Machine, Label::new("lateral-play", axis), play);
            let label = Label::new("reversal-spike", axis);
            if !self.facts.moves[i] {
                self.blind(&label, "no readings while the axis moves");
                continue;
            }
            let mut shapes: Vec<Shape> = FALLS
                .into_iter()
                .flat_map(|fall_s| {
                    [0.0, 0.1, 0.4].into_iter().map(move |f| Shape::Spike {
                        axis,
                        rise_s: (f * fall_s).max(1e-5),
                        fall_s,
                        slope: false,
                    })
                })
                .collect();
            if self.session.instruments.iter().all(|n| is_encoder(n)) {
                // a following error keeps what friction costs for as long as the axis moves
                shapes.push(Shape::Friction { axis });
            }
            self.add(Kind::Machine, label, shapes);
        }
    }

    pub(super) fn dynamics(&mut self) {
        let moving: Vec<Axis> = Axis::LINEAR.into_iter().filter(|a| self.facts.moves[a.slot()]).collect();
        if moving.is_empty() && !self.facts.moves.contains(&true) {
            for effect in ["latency", "clock-skew"] {
                self.blind(&Label::new(effect, ""), "no readings while an axis moves");
            }
        }
        for axis in Axis::LINEAR.into_iter().filter(|a| self.facts.range[a.slot()].is_some()) {
            if !moving.contains(&axis) {
                for effect in ["servo-mismatch", "inertial", "inertial-cross"] {
                    self.blind(&Label::new(effect, axis), "no readings while the axis moves");
                }
                continue;
            }
            let shapes = vec![Shape::Lag { axes: vec![axis], tie_ms: 0.0 }];
            self.add(Kind::Machine, Label::new("servo-mismatch", axis), shapes);
            if !self.facts.accelerates[axis.slot()] {
                continue;
            }
            let shapes = [false, true].map(|slope| Shape::Inertial { axis, along: axis, slope }).into();
            self.add(Kind::Machine, Label::new("inertial", axis), shapes);
            let others: Vec<Axis> = Axis::LINEAR.into_iter().filter(|a| *a != axis).collect();
            // a tilt of the structure turns whatever the travels are, so all of them are levers; or the carriage itself
            // turns, and only what lies behind it is a lever
            let carriage = self.lever(axis);
            let mut levers = vec![Lever { axes: [true; 3], ..carriage }];
            if levers[0] != carriage {
                levers.push(carriage);
            }
            let mut shapes = Vec::new();
            for lever in levers {
                shapes.extend(others.iter().map(|a| Shape::InertialTilt { axis, about: vec![*a], lever }));
                shapes.push(Shape::InertialTilt { axis, about: others.clone(), lever });
            }
            shapes.extend(others.iter().map(|along| Shape::Inertial { axis, along: *along, slope: false }));
            self.add(Kind::Machine, Label::new("inertial-cross", axis), shapes);
        }
        if !moving.is_empty() {
            let shapes = vec![Shape::Lag { axes: moving.clone(), tie_ms: 0.0 }];
            self.add(Kind::Machine, Label::new("latency", ""), shapes);
            self.clock();
        }
        for axis in Axis::LINEAR {
            let label = Label::new("load", axis);
            if self.facts.forces[axis.slot()] {
                let shapes = Axis::LINEAR
                    .into_iter()
                    .flat_map(|along| [1.0, 0.8].map(|power| Shape::Load { axis, along, power }))
                    .collect();
                self.add(Kind::Machine, label, shapes);
            } else {
                self.blind(&label, "no force is logged, or it does not change");
            }
        }
    }

    /// A clock of each file of its own.
    fn clock(&mut self) {
        let mut spans: BTreeMap<usize, (f64, f64)> = BTreeMap::new();
        for (m, r) in self.session.moments.iter().zip(&self.session.readings) {
            // the control's own encoders are on the control's own clock
            let own = is_encoder(&self.session.instruments[r.instrument]);
            if !own && (0..3).any(|i| m.velocity[i].abs() > STILL) {
                let e = spans.entry(m.file).or_insert((m.t_s, m.t_s));
                e.1 = m.t_s;
            }
        }
        let files: Vec<usize> = spans.keys().copied().collect();
        if files.is_empty() || files.len() > 12 {
            return;
        }
        let start_s: Vec<f64> = spans.values().map(|s| s.0).collect();
        let span_s: Vec<f64> = spans.values().map(|s| (s.1 - s.0).max(1e-6)).collect();
        let shapes = [false, true]
            .map(|drift| Shape::ClockSkew {
                files: files.clone(),
                start_s: start_s.clone(),
                span_s: span_s.clone(),
                drift,
            })
            .into();
        self.add(Kind::Instrument, Label::new("clock-skew", ""), shapes);
    }
}
