//! Effects of heat.

use nalgebra::Vector3;

use super::super::heat::REFERENCE_DEGC;
use super::super::machine::TRAVEL_MM;
use super::{Law, Making, along};

pub(super) fn law(name: &str, m: &mut Making<'_, '_>) -> Option<Law> {
    let size = m.size;
    let heat = m.world.heat;
    Some(match name {
        "thermal-expansion" => {
            let axis = m.axis()?;
            // where the scale is held
            let held = m.chance.pick(&[0.0, TRAVEL_MM[axis][0], TRAVEL_MM[axis][1]]);
            let sensor = heat.screws.get(axis)?.map(|t| t - REFERENCE_DEGC);
            let late = sensor.lagged(m.chance.within(700.0, 1800.0));
            let at_once = m.chance.within(0.65, 0.9);
            // 3 K over 150 mm make the size
            Box::new(move |r| {
                let warm = at_once * sensor.at(r.t_s) + (1.0 - at_once) * late.at(r.t_s);
                along(axis) * (size * warm / 3.0 * (r.position[axis] - held) / 150.0)
            })
        }
        "spindle-growth" => {
            let power = heat.spindle.map(|v| (v / 8.5).powf(1.25));
            let fast = power.lagged(m.chance.within(150.0, 600.0));
            let slow = power.lagged(m.chance.within(1600.0, 4500.0));
            let share = m.chance.within(0.35, 0.65);
            let lean = if m.chance.unit() < 0.5 { m.chance.within(0.15, 0.45) } else { 0.0 };
            let way = Vector3::new(0.0, lean * m.chance.either(), -1.0);
            Box::new(move |r| way * (4.0 * size * (share * fast.at(r.t_s) + (1.0 - share) * slow.at(r.t_s))))
        }
        "ambient-drift" => {
            let warm = heat.hall.map(|t| t - heat.hall.first());
            let quick = warm.lagged(m.chance.within(500.0, 1500.0));
            let slow = warm.lagged(m.chance.within(2500.0, 6000.0));
            let (share, way) = (m.chance.within(0.4, 0.8), m.chance.direction());
            Box::new(move |r| way * (3.0 * size * (share * quick.at(r.t_s) + (1.0 - share) * slow.at(r.t_s))))
        }
        _ => return None,
    })
}
