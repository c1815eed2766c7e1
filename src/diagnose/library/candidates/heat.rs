//! Effects of heat, and of the instruments that measure through air.

use super::super::super::moment::{Axis, Light, Signal, Source};
use super::super::{Kind, Label};
use super::Builder;
use volcomp_effects::{REFERENCE_DEGC, Shape};

/// Time constants of structures and spindles, s.
const TAUS: [f64; 10] = [0.0, 120.0, 300.0, 600.0, 1200.0, 2400.0, 3600.0, 5400.0, 9000.0, 14400.0];

impl Builder<'_> {
    /// Sources whose value changes by at least `least`.
    fn changing(&self, least: f64) -> Vec<Source> {
        let history = &self.session.history;
        history
            .sources()
            .into_iter()
            .filter(|s| history.range(s).is_some_and(|[l, h]| h - l >= least))
            .collect()
    }

    pub(super) fn heat(&mut self) {
        let temperatures: Vec<Source> =
            self.changing(0.2).into_iter().filter(|s| matches!(s, Source::Temperature(_))).collect();
        let spindle = self.changing(0.05).contains(&Source::Spindle);
        for (axis, _) in self.linear() {
            let label = Label::new("thermal-expansion", axis);
            if temperatures.is_empty() {
                self.blind(&label, "no temperature that changes by 0.2 K is logged");
                continue;
            }
            let mut shapes = Vec::new();
            // the spindle's own temperature says nothing of a scale where others are logged
            let others = temperatures.iter().filter(|s| !is_spindle(s)).count();
            for source in temperatures.iter().filter(|s| others == 0 || !is_spindle(s)) {
                let signal = Signal { source: source.clone(), tau_s: 0.0 };
                let first = self.session.history.first(source).unwrap_or(REFERENCE_DEGC);
                for (reference_degc, with_offset) in
                    [(REFERENCE_DEGC, false), (first, false), (REFERENCE_DEGC, true)]
                {
                    shapes.push(Shape::Thermal { axis, signal: signal.clone(), reference_degc, with_offset });
                }
            }
            self.add(Kind::Machine, label, shapes);
        }
        let ways =
            [vec![Axis::Z], vec![Axis::Y], vec![Axis::X], vec![Axis::Y, Axis::Z], Axis::LINEAR.to_vec()];
        let seen: Vec<Vec<Axis>> = ways.into_iter().filter(|w| w.iter().all(|a| self.sees(*a))).collect();
        if spindle {
            let mut shapes = Vec::new();
            for along in &seen {
                for tau_s in &TAUS[1..] {
                    let signals = vec![Signal { source: Source::Spindle, tau_s: *tau_s }];
                    shapes.push(Shape::Growth { signals, along: along.clone(), reference: 0.0 });
                }
                for (fast, slow) in
                    [(120.0, 1200.0), (300.0, 2400.0), (600.0, 5400.0), (1200.0, 9000.0), (2400.0, 14400.0)]
                {
                    let signals = [fast, slow].map(|tau_s| Signal { source: Source::Spindle, tau_s }).into();
                    shapes.push(Shape::Growth { signals, along: along.clone(), reference: 0.0 });
                }
            }
            shapes.extend(self.spindle_sensors(&temperatures, &seen));
            self.add(Kind::Machine, Label::new("spindle-growth", ""), shapes);
        } else {
            self.blind(
                &Label::new("spindle-growth", ""),
                "no speed of the spindle is logged, or it does not change",
            );
        }
        let mut shapes = Vec::new();
        for source in temperatures.iter().filter(|s| !is_spindle(s)) {
            let reference = self.session.history.first(source).unwrap_or(REFERENCE_DEGC);
            for tau_s in [0.0, 600.0, 1200.0, 2400.0, 5400.0, 14400.0] {
                let along: Vec<Axis> = Axis::LINEAR.into_iter().filter(|a| self.sees(*a)).collect();
                let signals = vec![Signal { source: source.clone(), tau_s }];
                shapes.push(Shape::Growth { signals, along, reference });
            }
        }
        if shapes.is_empty() {
            self.blind(&Label::new("ambient-drift", ""), "no temperature that changes by 0.2 K is logged");
        }
        self.add(Kind::Machine, Label::new("ambient-drift", ""), shapes);
    }

    fn spindle_sensors(&self, temperatures: &[Source], seen: &[Vec<Axis>]) -> Vec<Shape> {
        let mut shapes = Vec::new();
        for source in temperatures.iter().filter(|s| is_spindle(s)) {
            let reference = self.session.history.first(source).unwrap_or(REFERENCE_DEGC);
            for along in seen {
                let signals = vec![Signal { source: source.clone(), tau_s: 0.0 }];
                shapes.push(Shape::Growth { signals, along: along.clone(), reference });
            }
        }
        shapes
    }

    /// True where some reading looks along an axis.
    fn sees(&self, axis: Axis) -> bool {
        self.session.moments.iter().any(|m| m.u[axis.direction()].abs() > 0.2)
    }

    pub(super) fn instruments(&mut self) {
        let air: Vec<Source> = self
            .changing(0.2)
            .into_iter()
            .filter(|s| matches!(s, Source::Temperature(n) if ["air", "ambient", "lab", "room"].iter().any(|w| n.contains(w))))
            .collect();
        let label = Label::new("dead-path", "");
        let both = Light::ALL.iter().all(|l| self.session.moments.iter().any(|m| m.light == Some(*l)));
        if self.facts.ranges && !air.is_empty() {
            let shapes = air
                .iter()
                .flat_map(|s| {
                    [None, Some(Light::Laser), Some(Light::Tracker)].map(|light| Shape::DeadPath {
                        signal: Signal { source: s.clone(), tau_s: 0.0 },
                        light,
                        station: None,
                    })
                })
                .filter(|s| matches!(s, Shape::DeadPath { light, .. } if light.is_none() || both))
                .collect();
            self.add(Kind::Instrument, label, shapes);
        } else {
            self.blind(&label, "needs range_mm and the temperature of the air, both changing");
        }
        let label = Label::new("tracker-scale", "");
        let stations = self.session.moments.iter().any(|m| m.station_mm.iter().all(|v| v.is_finite()));
        if self.facts.ranges && stations {
            let mut shapes = [false, true].map(|zero| Shape::TrackerScale { signal: None, zero }).to_vec();
            shapes.extend(
                air.iter()
                    .map(|s| Signal { source: s.clone(), tau_s: 0.0 })
                    .map(|s| Shape::TrackerScale { signal: Some(s), zero: false }),
            );
            self.add(Kind::Instrument, label, shapes);
        } else {
            self.blind(&label, "needs range_mm and station_x_mm .. of a tracker");
        }
    }
}

fn is_spindle(source: &Source) -> bool {
    matches!(source, Source::Temperature(n) if n.contains("spindle"))
}
