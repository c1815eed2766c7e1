//! Effects that no library of causes knows.

use std::collections::BTreeMap;
use std::f64::consts::TAU;

use nalgebra::Vector3;

use super::super::chance::Chance;
use super::super::row::Row;
use super::{Law, Making, along};

pub(super) fn law(name: &str, m: &mut Making<'_, '_>) -> Option<Law> {
    let (size, heat) = (m.size, m.world.heat);
    Some(match name {
        "outside-warm-bend" => {
            let (screw, hall) = (heat.screws.first()?.clone(), heat.hall.clone());
            Box::new(move |r| {
                let x = (r.position[0] - 40.0) / 340.0;
                along(2) * (2.0 * size * x * x * (screw.at(r.t_s) - hall.at(r.t_s)))
            })
        }
        "outside-speed-place" => Box::new(move |r| {
            let v = r.speed[0] / 50.0;
            along(1) * (4.0 * size * v * r.position[0] / 200.0)
        }),
        "outside-volume" => Box::new(move |r| {
            let y = r.position[1] / 200.0;
            along(2) * (size * (r.position[0] - 300.0) / 200.0 * y * y)
        }),
        "outside-creep" => {
            let after = creep(m.world.rows, m.chance.within(120.0, 400.0));
            let way = m.chance.direction();
            Box::new(move |r| way * (10.0 * size * after.get(&r.t_s.to_bits()).copied().unwrap_or_default()))
        }
        "outside-ripple" => {
            let [a, b] = [(); 2].map(|()| TAU / m.chance.within(110.0, 190.0));
            let [p, q] = [(); 2].map(|()| m.chance.angle());
            Box::new(move |r| {
                let [x, y, _] = r.position;
                along(2) * (2.0 * size * (a * x + p).sin() * (b * y + q).sin())
            })
        }
        "outside-sawtooth" => {
            let (period, begin) = (m.chance.within(1300.0, 2600.0), m.chance.unit());
            let way = m.chance.direction();
            Box::new(move |r| way * (3.0 * size * ((r.t_s / period + begin).fract() - 0.5)))
        }
        "outside-ringing" => {
            let (hertz, decay) = (m.chance.within(4.0, 9.0), m.chance.within(0.15, 0.5));
            Box::new(move |r| {
                let t = r.since_jolt_s;
                let swing = (TAU * hertz * t).sin() * (-t / decay).exp();
                Vector3::from(r.jolt) * (size * swing / 60.0)
            })
        }
        "outside-gear" => {
            let (wave, begin) = (TAU / m.chance.within(60.0, 110.0), m.chance.angle());
            Box::new(move |r| {
                let phase = wave * (r.position[0] - 1.37 * r.position[1]) + begin;
                along(2) * (1.4 * size * phase.sin())
            })
        }
        "outside-joint" => {
            let slips = walk(m.world);
            Box::new(move |r| {
                let slip = slips.get(&r.place[1]).copied().unwrap_or_default();
                along(2) * (size * slip * (0.4 + r.position[0] / 200.0))
            })
        }
        "outside-warm-speed" => {
            let hall = heat.hall.map(|t| t - heat.hall.first());
            Box::new(move |r| {
                let v2 = r.speed.iter().map(|v| v * v).sum::<f64>() / 3000.0;
                along(2) * (4.0 * size * v2 * hall.at(r.t_s))
            })
        }
        "outside-unbalance" => {
            let begin = m.chance.angle();
            Box::new(move |r| {
                let [a, c] = r.turn;
                along(2) * (4.0 * size * (2.0 * a).sin() * (c + begin).cos())
            })
        }
        "outside-spindle-whirl" => {
            let way = m.chance.direction();
            Box::new(move |r| way * (6.0 * size * (-((r.rpm - 5500.0) / 900.0).powi(2)).exp()))
        }
        "outside-stick" => {
            let step = m.chance.within(11.0, 23.0);
            Box::new(move |r| {
                let saw = (r.since_mm[0] / step).fract() - 0.5;
                along(0) * (3.0 * size * r.direction[0] * saw)
            })
        }
        "outside-root" => Box::new(move |r| {
            let [x, _, z] = r.position;
            along(1) * (size * (x * z).abs().sqrt() / 100.0)
        }),
        _ => return None,
    })
}

/// What is left of the forces of the last while, 1000 N, by the bits of the time of each reading.
fn creep(rows: &[Row], tau_s: f64) -> BTreeMap<u64, f64> {
    let (mut state, mut last, mut force) = (0.0, f64::NEG_INFINITY, 0.0);
    rows.iter()
        .map(|r| {
            let keep = (-(r.t_s - last) / tau_s).exp();
            state = keep * state + (1.0 - keep) * force;
            (last, force) = (r.t_s, 1e-3 * r.force_n.iter().sum::<f64>());
            (r.t_s.to_bits(), state)
        })
        .collect()
}

/// A walk by chance from pass to pass, anew every day; it does not go far.
fn walk(world: &super::World<'_>) -> BTreeMap<i64, f64> {
    let mut chance = Chance::new(world.day, "joint");
    let mut at = 0.0;
    let mut slips = BTreeMap::new();
    for r in world.rows {
        slips.entry(r.place[1]).or_insert_with(|| {
            // a spring brings it back slowly
            at = 0.9 * at + 0.6 * chance.normal();
            at
        });
    }
    slips
}
