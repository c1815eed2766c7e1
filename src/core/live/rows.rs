//! What a reading says about the components of a map: rows of the observation, made from the model itself.
//!
//! The deviation is linear in the live values, so that the effect of one is the difference of two evaluations of the
//! model: levers, heads and workpiece-side axes come from the chain and from nowhere else. A pose sees
//! `dp = SUM_c J_c x_c` and `da = SUM_c (T_c x a) x_c`, with `J_c`, `T_c` displacement and turn per unit of component
//! `c` and `a` the tool's direction: of `da` only the two directions across the tool carry anything (equations 5.5).
//!
//! Readings that name the deviation from the commanded position hold the applied offset, which is no error of the
//! machine: it is taken out with the nominal chain. Absolute ones are compared with where the encoders are.

use nalgebra::{DMatrix, Matrix6};

use super::history::Moment;
use super::reading::{Body, PointReading, Seen, ToolReading};
use crate::core::estimate::filter::COMPONENTS_MAX;
use crate::core::geometry::{Vec3, unit};
use crate::core::model::volumetric::NominalTool;
use crate::core::model::{Model, Pose, SENSORS_MAX};

/// Live value used to ask the model for effects, mm and rad: below every limit, far above rounding.
const PROBE: f64 = 1e-7;

/// What the model says about a moment.
#[derive(Debug, Clone, PartialEq)]
pub struct Expected {
    commanded: NominalTool,
    actual: NominalTool,
    /// Deviation and turn by the model without the map.
    shift: Vec3,
    turn: Vec3,
    /// The same per unit of each component of the map.
    effects: Vec<(Vec3, Vec3)>,
}

/// A reading as differences from the model, not yet of unit variance.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Gap {
    /// Measured minus expected.
    pub values: Vec<f64>,
    /// True where the number is a length.
    pub is_length: Vec<bool>,
    /// Effect of each component.
    pub weights: Vec<[f64; COMPONENTS_MAX]>,
    /// Direction in W along which a length is measured; zero for angles.
    pub along: Vec<Vec3>,
    /// Covariance.
    pub covariance: Vec<(usize, usize, f64)>,
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
    pub fn new(model: &Model, moment: &Moment, live: &[f64; SENSORS_MAX], channels: &[usize]) -> Self {
        let at = |position| Pose { tool_tip: moment.tool_tip, live: *live, ..Pose::at(position) };
        let commanded = at(moment.commanded);
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
            actual: model.nominal_tool(&at(moment.actual)),
            shift: deviation.position,
            turn: deviation.rotation,
            effects,
        }
    }

    /// Where the tip should be, W.
    #[must_use]
    pub const fn tip(&self) -> Vec3 {
        self.actual.tip
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
                gap.length(value - expected, along, self.weights(|(shift, _)| along.dot(shift)), variance);
            }
            Body::FiveDofRaw(_) | Body::FiveDof(_) | Body::Value(_) | Body::Temperatures(_) => {}
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
        for i in 0..3 {
            gap.length(tip[i], unit(i), self.weights(|(shift, _)| shift[i]), 0.0);
        }
        let a = self.actual.direction;
        let mut across = Vec::new();
        if let Some(direction) = tool.direction {
            let found = match direction {
                Seen::Absolute(v) => v - a,
                Seen::Deviation(v) => v - (a - self.commanded.direction),
            } - self.turn.cross(&a);
            let other = if a.x.abs() < 0.6 { Vec3::x() } else { Vec3::y() };
            let u = a.cross(&other).normalize();
            across = vec![u, a.cross(&u)];
            for e in &across {
                gap.angle(e.dot(&found), self.weights(|(_, turn)| e.dot(&turn.cross(&a))));
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
        for i in 0..gap.values.len() {
            for j in 0..gap.values.len() {
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
        for i in 0..3 {
            let weights = self.weights(|(shift, turn)| shift[i] + turn.cross(&lever)[i]);
            gap.length(found[i], unit(i), weights, variance);
        }
    }

    fn weights(&self, of: impl Fn(&(Vec3, Vec3)) -> f64) -> [f64; COMPONENTS_MAX] {
        let mut weights = [0.0; COMPONENTS_MAX];
        weights.iter_mut().zip(&self.effects).for_each(|(w, effect)| *w = of(effect));
        weights
    }
}

impl Gap {
    fn length(&mut self, value: f64, along: Vec3, weights: [f64; COMPONENTS_MAX], variance: f64) {
        let i = self.values.len();
        self.push(value, true, along, weights);
        self.covariance.push((i, i, variance));
    }

    fn angle(&mut self, value: f64, weights: [f64; COMPONENTS_MAX]) {
        self.push(value, false, Vec3::zeros(), weights);
    }

    fn push(&mut self, value: f64, is_length: bool, along: Vec3, weights: [f64; COMPONENTS_MAX]) {
        self.values.push(value);
        self.is_length.push(is_length);
        self.along.push(along);
        self.weights.push(weights);
    }

    /// The covariance.
    #[must_use]
    pub fn covariance(&self) -> DMatrix<f64> {
        let n = self.values.len();
        let mut out = DMatrix::zeros(n, n);
        for (i, j, v) in &self.covariance {
            out[(*i, *j)] += v;
        }
        out
    }

    /// What one second of delay adds to each number, the machine moving at `velocity` (mm/s, W).
    #[must_use]
    pub fn delays(&self, velocity: &Vec3) -> Vec<f64> {
        self.along.iter().map(|along| along.dot(velocity)).collect()
    }
}
