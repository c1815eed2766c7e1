//! Bodies between the carriages and the tool: guideways, ram, table, contacts, and what no library of causes knows.

use super::file::Effect;
use super::heat::Heat;
use super::random::{Dice, Field, Table};

/// What the bodies do at one moment.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Doing {
    /// Error motions of X, Y, Z, C: EX EY EZ (mm), EA EB EC (rad).
    pub motion: [[f64; 6]; 4],
    /// Tool against workpiece in the machine frame, mm.
    pub shift: [f64; 3],
}

/// A body with its law.
#[derive(Debug, Clone, PartialEq)]
enum Body {
    /// A guideway whose shape moves one component of an axis: axis, component, shape.
    Guideway {
        axis: usize,
        component: usize,
        shape: Table,
    },
    /// The ram: deflection and slope over the way it stands out.
    Ram {
        drop: Table,
        slope: Table,
    },
    /// Wobble of the table: harmonic, component, amplitude, phase.
    Wobble {
        waves: Vec<(f64, usize, f64, f64)>,
    },
    /// Grating disc off its centre: share of its radius, direction.
    Disc {
        share: f64,
        direction: f64,
    },
    /// A contact: axis, mm per 1000 N, stiffening per mm.
    Contact {
        axis: usize,
        compliance: f64,
        hardening: f64,
    },
    /// Outside of libraries, see the catalogue.
    Bimetal {
        size: f64,
    },
    Mass {
        size: f64,
    },
    Film {
        size: f64,
    },
    Volume {
        size: f64,
        fields: Box<[Field; 3]>,
    },
    Coolant {
        size: f64,
        period: f64,
        phase: f64,
        direction: [f64; 3],
    },
}

/// What the bodies need to know.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct State<'a> {
    /// Positions of X, Y, Z (mm) and C (rad).
    pub q: [f64; 4],
    /// Speeds, mm/s.
    pub v: [f64; 3],
    /// Forces on the tool, N.
    pub force_n: [f64; 3],
    /// The heat.
    pub heat: &'a Heat,
}

/// All of them.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Bodies(Vec<Body>);

/// Component of an error motion by its letter.
fn component(letter: u8) -> Option<usize> {
    b"xyzabc".iter().position(|l| *l == letter)
}

/// Deflection and slope of a beam of changing length under its own weight and a weight at its end, per um at `high`.
///
/// The bending moment is integrated twice along the beam; what it does is what the end of the beam does.
fn beam([low, high]: [f64; 2], tip_share: f64) -> (Table, Table) {
    const PARTS: usize = 200;
    let end = |length: f64| -> (f64, f64) {
        let h = length / PARTS as f64;
        let (mut slope, mut drop) = (0.0, 0.0);
        for k in 0..PARTS {
            let to_end = length - (k as f64 + 0.5) * h;
            let moment = tip_share * to_end + (1.0 - tip_share) * to_end * to_end / (2.0 * (high - low));
            let before = slope;
            slope += moment * h;
            drop += 0.5 * (before + slope) * h;
        }
        (drop, slope)
    };
    let (full, _) = end(high - low);
    let table = |of: fn((f64, f64)) -> f64| Table::of(low, high, |x| of(end((x - low).max(0.0))) / full);
    (table(|(drop, _)| drop), table(|(_, slope)| slope))
}

impl Bodies {
    /// Adds an effect; true where it is one of the bodies.
    pub fn add(&mut self, e: &Effect, axis: Option<usize>, travel: &[[f64; 2]; 3], dice: &mut Dice) -> bool {
        let mm = e.size_um * 1e-3;
        let symbol = e.subject.as_bytes();
        match (e.name.as_str(), axis) {
            ("straightness" | "angular", _) => {
                let [_, what, along] = symbol else { return false };
                let (Some(component), Some(axis)) = (component(*what), component(*along)) else {
                    return false;
                };
                let Some(t) = travel.get(axis) else { return false };
                let length = e.constant("length-mm", dice.between(100.0, 300.0));
                let shape = if e.name == "straightness" {
                    Table::integrated(dice, *t, t[0], length, 2).without_line(*t).scaled(*t, mm)
                } else {
                    // 200 mm of lever make the size; the twist adds up from the zero of the axis
                    Table::integrated(dice, *t, 0.0, length, 1).scaled(*t, mm / 200.0)
                };
                self.0.push(Body::Guideway { axis, component, shape });
            }
            ("sag", Some(k)) => {
                let Some(t) = travel.get(k) else { return false };
                let (drop, slope) = beam(*t, e.constant("tip-share", dice.between(0.3, 1.0)).clamp(0.0, 1.0));
                let size = 3.0 * mm;
                self.0.push(Body::Ram { drop: drop.times(size), slope: slope.times(size) });
            }
            ("rotary-motion", _) => {
                let waves = (0..4)
                    .map(|k| {
                        let order = if k < 2 { 2.0 } else { 3.0 };
                        (order, dice.below(3), mm * dice.normal(), dice.between(0.0, std::f64::consts::TAU))
                    })
                    .collect();
                self.0.push(Body::Wobble { waves });
            }
            // 120 mm of radius make the size
            ("rotary-eccentricity", _) => self
                .0
                .push(Body::Disc { share: mm / 120.0, direction: dice.between(0.0, std::f64::consts::TAU) }),
            ("load", Some(axis)) => self.0.push(Body::Contact {
                axis,
                compliance: mm / 1.0,
                hardening: e.constant("hardening", dice.between(0.0, 8.0)).max(0.0),
            }),
            ("outside-bimetal", _) => self.0.push(Body::Bimetal { size: mm }),
            ("outside-mass", _) => self.0.push(Body::Mass { size: mm }),
            ("outside-film", _) => self.0.push(Body::Film { size: mm }),
            ("outside-volume", _) => {
                let length = dice.between(220.0, 380.0);
                let fields = Box::new([(); 3].map(|()| Field::new(dice, length)));
                self.0.push(Body::Volume { size: mm, fields });
            }
            ("outside-coolant", _) => self.0.push(Body::Coolant {
                size: mm,
                period: dice.between(500.0, 1100.0),
                phase: dice.between(0.0, 1.0),
                direction: [(); 3].map(|()| dice.normal()),
            }),
            _ => return false,
        }
        true
    }

    /// What they do.
    #[must_use]
    pub fn doing(&self, s: &State<'_>) -> Doing {
        let mut d = Doing::default();
        for body in &self.0 {
            body.act(s, &mut d);
        }
        d
    }
}

impl Body {
    fn act(&self, s: &State<'_>, d: &mut Doing) {
        let [x, y, z, c] = s.q;
        match self {
            Self::Guideway { axis, component, shape } => {
                let at = s.q.get(*axis).copied().unwrap_or_default();
                if let Some(m) = d.motion.get_mut(*axis).and_then(|m| m.get_mut(*component)) {
                    *m += shape.at(at);
                }
            }
            Self::Ram { drop, slope } => {
                // it falls, and what it carries at its end leans forward: about X, negative
                d.motion[1][2] -= drop.at(y);
                d.motion[1][3] -= slope.at(y);
            }
            Self::Wobble { waves } => {
                for (order, component, amplitude, phase) in waves {
                    if let Some(m) = d.motion[3].get_mut(*component) {
                        // the table's own zero is where it was aligned
                        *m += amplitude * ((order * c + phase).sin() - phase.sin());
                    }
                }
            }
            Self::Disc { share, direction } => {
                let read = |c: f64| (share * (c + direction).sin()).asin();
                d.motion[3][5] += read(c) - read(0.0);
            }
            Self::Contact { axis, compliance, hardening } => {
                let force = s.force_n.get(*axis).copied().unwrap_or_default() * 1e-3;
                let soft = compliance * force;
                // k (d + h d^3) = F, with h so that the size itself is stiffer by the share given
                let h = hardening / compliance.powi(2).max(1e-18) * 0.01;
                let mut way = soft;
                for _ in 0..12 {
                    let f = way + h * way.powi(3) - soft;
                    way -= f / (1.0 + 3.0 * h * way * way);
                }
                if let Some(m) = d.shift.get_mut(*axis) {
                    *m += way;
                }
            }
            Self::Bimetal { size } => d.shift[2] += size * s.heat.gradient() / 3.0 * (x / 300.0).powi(2),
            Self::Mass { size } => d.shift[2] -= size * (x / 250.0) * (y / 200.0).powi(2),
            Self::Film { size } => {
                let speed = s.v[0].hypot(s.v[1]);
                d.shift[2] += 2.0 * size * speed.powi(2) / (speed.powi(2) + 900.0);
            }
            Self::Volume { size, fields } => {
                for (m, f) in d.shift.iter_mut().zip(fields.iter()) {
                    *m += size * f.at([x, y, z]);
                }
            }
            Self::Coolant { size, period, phase, direction } => {
                // a thermostat: rises while off, falls faster while on
                let place = (s.heat.time_s() / period + phase).fract();
                let saw = if place < 0.7 { place / 0.7 } else { (1.0 - place) / 0.3 } - 0.5;
                for (m, a) in d.shift.iter_mut().zip(direction) {
                    *m += 2.0 * size * a * saw;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_beam_of_growing_length_sinks_with_the_third_and_fourth_power() {
        let (tip, slope) = beam([0.0, 400.0], 1.0);
        assert!((tip.at(400.0) - 1.0).abs() < 1e-3);
        assert!((tip.at(200.0) / tip.at(400.0) - 0.125).abs() < 1e-3, "weight at the end: cube");
        assert!(
            (slope.at(400.0) * 400.0 / 1.5 - 1.0).abs() < 0.01,
            "slope of a cantilever: 3/2 of drop per length"
        );
        let (own, _) = beam([0.0, 400.0], 0.0);
        assert!((own.at(200.0) / own.at(400.0) - 0.0625).abs() < 1e-3, "own weight: fourth power");
    }
}
