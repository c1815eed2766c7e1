//! Effects of instruments that measure along a beam.

use nalgebra::Vector3;

use super::super::heat::REFERENCE_DEGC;
use super::{Law, Making};

pub(super) fn law(name: &str, m: &mut Making<'_, '_>) -> Option<Law> {
    let size = m.size;
    Some(match name {
        "dead-path" => {
            let (dead, hall) = (m.chance.within(150.0, 450.0), m.world.heat.hall.clone());
            // 1 K over a metre makes the size
            Box::new(move |r| match (r.beam(), r.range_mm) {
                (Some(beam), Some(range)) if r.instrument.starts_with("laser") => {
                    let warm = hall.at(r.t_s) - REFERENCE_DEGC;
                    beam * (size * warm * (1.0 + 0.02 * warm) * (range + dead) * 1e-3)
                }
                _ => Vector3::zeros(),
            })
        }
        "tracker-scale" => Box::new(move |r| match (r.beam(), r.range_mm) {
            (Some(beam), Some(range)) if r.instrument == "tracker" => {
                beam * (size * range / 300.0 * (1.0 + 0.1 * (range / 2000.0 - 1.0)))
            }
            _ => Vector3::zeros(),
        }),
        _ => return None,
    })
}
