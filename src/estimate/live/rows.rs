//! What a reading says about the components of a map: rows of the observation, made from the model itself.
//!
//! The deviation is linear in the live values, so that the effect of one is the difference of two evaluations of the
//! model: levers, heads and workpiece-side axes come from the chain and from nowhere else. A pose sees
//! `dp = SUM_c J_c x_c` and `da = SUM_c (T_c x a) x_c`, with `J_c`, `T_c` displacement and turn per unit of component
//! `c` and `a` the tool's direction: of `da` only the two directions across the tool carry anything (equations 5.5).
//!
//! Readings that name the deviation from the commanded position hold the applied offset, which is no error of the
//! machine: it is taken out with the nominal chain. Absolute ones are compared with where the encoders are.

use nalgebra::Matrix6;

use super::history::MotionSample;
use super::reading::{Body, PointReading, Seen, ToolReading};
use crate::filter::COMPONENTS_MAX;
use crate::{Kind, Row};
use volcomp_model::geometry::{Mat3, Vec3};
use volcomp_model::kinematics::NominalTool;
use volcomp_model::{Model, Pose, SENSORS_MAX};

/// Live value used to ask the model for effects, mm and rad: below every limit, far above rounding.
const PROBE: f64 = 1e-7;

/// Prediction of the model for one motion sample.
#[derive(Debug, Clone, PartialEq)]
pub struct Expected {
    commanded: NominalTool,
    actual: NominalTool,
    /// Deviation and turn by the model without the map.
    shift: Vec3,
    turn: Vec3,
    /// The same per unit of each component of the map.
    effects: Vec<(Vec3, Vec3)>,
    /// How the tool moves.
    rates: Rates,
    /// How its offset from the command changes.
    offset_rates: Rates,
}

/// Changes per second.
#[derive(Debug, Clone, PartialEq)]
struct Rates {
    tip: Vec3,
    direction: Vec3,
    rotation: Mat3,
}

impl Rates {
    fn rest() -> Self {
        Self { tip: Vec3::zeros(), direction: Vec3::zeros(), rotation: Mat3::zeros() }
    }
}

/// A reading as differences from the model, not yet of unit variance.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Gap {
    /// Measured minus expected, the effect of each component, what one second of delay adds; mm or rad.
    pub rows: Vec<Row>,
    /// Covariance: row, column, value.
    pub covariance: Vec<(usize, usize, f64)>,
    /// The tool's direction points the other way: its rows across the tool would not show it.
    pub reversed: bool,
}

/// Standard deviations for readings that state none.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DefaultStd {
    /// Of a length, mm.
    pub mm: f64,
    /// Of an angle, rad.
    pub rad: f64,
}

impl Expected {
    /// Asks the model: `live` are the values of everything but the map, `channels` those of the map.
    #[must_use]
    pub fn new(model: &Model, sample: &MotionSample, live: &[f64; SENSORS_MAX], channels: &[usize]) -> Self {
        let at = |position| Pose { tool_tip: sample.tool_tip, live: *live, ..Pose::at(position) };
        let commanded = at(sample.commanded);
        let mut base = commanded;
        channels.iter().for_each(|c| base.live[*c] = 0.0);
        let deviation = model.deviation(&base);
        let effects = channels
            .iter()
            .map(|c| {
                let mut probe = base;
                probe.live[*c] = PROBE;
                let moved = model.deviation(&probe);
                ((moved.position - deviation.position) / PROBE, (moved.rotation - deviation.rotation) / PROBE)
            })
            .collect();
        Self {
            commanded: model.nominal_tool(&commanded),
            actual: model.nominal_tool(&at(sample.actual)),
            shift: deviation.position,
            turn: deviation.rotation,
            effects,
            rates: Rates::rest(),
            offset_rates: Rates::rest(),
        }
    }

    /// The tool moved from one place to another within `seconds` about the moment; each as nominal at the encoders and
    /// at the command.
    #[must_use]
    pub fn moving(mut self, from: &[NominalTool; 2], to: &[NominalTool; 2], seconds: f64) -> Self {
        if seconds > 0.0 {
            let rate = |k: usize| Rates {
                tip: (to[k].tip - from[k].tip) / seconds,
                direction: (to[k].direction - from[k].direction) / seconds,
                rotation: (to[k].rotation - from[k].rotation) / seconds,
            };
            let (actual, commanded) = (rate(0), rate(1));
            self.offset_rates = Rates {
                tip: actual.tip - commanded.tip,
                direction: actual.direction - commanded.direction,
                rotation: actual.rotation - commanded.rotation,
            };
            self.rates = actual;
        }
        self
    }

    /// What changes while a reading is late: where the tool is, or by how much it is offset from the command.
    const fn rates_of(&self, seen: Seen) -> &Rates {
        match seen {
            Seen::Absolute(_) => &self.rates,
            Seen::Deviation(_) => &self.offset_rates,
        }
    }

    /// What a reading differs by.
    #[must_use]
    pub fn gap(&self, body: &Body, std: DefaultStd) -> Gap {
        let mut gap = Gap::default();
        match body {
            Body::Tool(tool) => self.tool(tool, std, &mut gap),
            Body::Points(points) => points.iter().for_each(|p| self.point(p, std, &mut gap)),
            Body::Deviation { direction, value, std: own } => {
                let along = self.commanded.bed * direction;
                let applied = self.actual.tip - self.commanded.tip;
                let expected = along.dot(&(self.shift + applied));
                let variance = own.unwrap_or(std.mm).powi(2);
                let late = along.dot(&self.offset_rates.tip);
                gap.length(value - expected, late, self.weights(|(shift, _)| along.dot(shift)), variance);
            }
            Body::FiveDofRaw(_)
            | Body::FiveDof(_)
            | Body::Value { .. }
            | Body::Temperatures(_)
            | Body::Speed(_) => {}
        }
        gap
    }

    fn tool(&self, tool: &ToolReading, std: DefaultStd, gap: &mut Gap) {
        let tip = match tool.tip {
            Seen::Absolute(v) => v - self.actual.tip,
            Seen::Deviation(v) => v - (self.actual.tip - self.commanded.tip),
        } - self.shift;
        let covariance = tool.covariance.unwrap_or_else(|| {
            let (p, a) = (std.mm.powi(2), std.rad.powi(2));
            Matrix6::from_diagonal(&[p, p, p, a, a, a].into())
        });
        let late = self.rates_of(tool.tip).tip;
        for i in 0..3 {
            gap.length(tip[i], late[i], self.weights(|(shift, _)| shift[i]), 0.0);
        }
        let a = self.actual.direction;
        let mut across = Vec::new();
        if let Some(direction) = tool.direction {
            let found = match direction {
                Seen::Absolute(v) => v - a,
                Seen::Deviation(v) => v - (a - self.commanded.direction),
            } - self.turn.cross(&a);
            gap.reversed = (a + found).dot(&a) <= 0.0;
            let other = if a.x.abs() < 0.6 { Vec3::x() } else { Vec3::y() };
            let u = a.cross(&other).normalize();
            across = vec![u, a.cross(&u)];
            let late = self.rates_of(direction).direction;
            for e in &across {
                gap.angle(e.dot(&found), e.dot(&late), self.weights(|(_, turn)| e.dot(&turn.cross(&a))));
            }
        }
        // the covariance of the rows: the tip as it stands, the direction projected across the tool
        let axis = |k: usize| -> [f64; 6] {
            let mut v = [0.0; 6];
            match k.checked_sub(3) {
                None => v[k] = 1.0,
                Some(e) => v[3..].copy_from_slice(across[e].as_slice()),
            }
            v
        };
        gap.covariance.clear();
        for i in 0..gap.rows.len() {
            for j in 0..gap.rows.len() {
                let (u, v) = (nalgebra::Vector6::from(axis(i)), nalgebra::Vector6::from(axis(j)));
                gap.covariance.push((i, j, u.dot(&(covariance * v))));
            }
        }
    }

    fn point(&self, point: &PointReading, std: DefaultStd, gap: &mut Gap) {
        let at = |tool: &NominalTool| tool.tip + tool.rotation * point.offset;
        let lever = self.actual.rotation * point.offset;
        let found = match point.position {
            Seen::Absolute(v) => v - at(&self.actual),
            Seen::Deviation(v) => v - (at(&self.actual) - at(&self.commanded)),
        } - self.shift
            - self.turn.cross(&lever);
        let variance = point.std.unwrap_or(std.mm).powi(2);
        let rates = self.rates_of(point.position);
        let late = rates.tip + rates.rotation * point.offset;
        for i in 0..3 {
            let weights = self.weights(|(shift, turn)| shift[i] + turn.cross(&lever)[i]);
            gap.length(found[i], late[i], weights, variance);
        }
    }

    fn weights(&self, of: impl Fn(&(Vec3, Vec3)) -> f64) -> [f64; COMPONENTS_MAX] {
        let mut weights = [0.0; COMPONENTS_MAX];
        weights.iter_mut().zip(&self.effects).for_each(|(w, effect)| *w = of(effect));
        weights
    }
}

impl Gap {
    fn length(&mut self, value: f64, late: f64, weights: [f64; COMPONENTS_MAX], variance: f64) {
        let i = self.rows.len();
        self.rows.push(Row { weights, value, delay: late, kind: Kind::Length });
        self.covariance.push((i, i, variance));
    }

    fn angle(&mut self, value: f64, late: f64, weights: [f64; COMPONENTS_MAX]) {
        self.rows.push(Row { weights, value, delay: late, kind: Kind::Angle });
    }
}
