//! Where the reflector is that an instrument looks at: the range that it states tells.

use super::super::moment::{Machine, Moment};
use super::super::noise::median;
use volcomp_model::geometry::Vec3;

/// Sets the place of the reflector of every reading, and the range of an instrument with a station where none is stated: the
/// reflector is at the tip of the tool that is in, whose deviation is measured, or at the axis positions where the stated ranges
/// say so.
pub(super) fn aim(moments: &mut [Moment], machine: &Machine) {
    let places: [&dyn Fn(&Moment) -> Vec3; 2] =
        [&Moment::carriage_mm, &|m| m.carriage_mm() + m.head.carries(machine.tip_of(m))];
    let miss = |place: &dyn Fn(&Moment) -> Vec3| {
        let mut misses: Vec<f64> = moments
            .iter()
            .map(|m| ((place(m) - m.station_mm).norm() - m.range_mm).abs())
            .filter(|v| v.is_finite())
            .collect();
        if misses.is_empty() { f64::INFINITY } else { median(&mut misses) }
    };
    let place = if miss(places[0]) < miss(places[1]) { places[0] } else { places[1] };
    for m in moments.iter_mut() {
        m.reflector_mm = place(m);
        if m.range_mm.is_nan() {
            m.range_mm = (m.reflector_mm - m.station_mm).norm();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_stated_range_says_whether_it_goes_to_the_carriage_or_to_the_tip() {
        let machine = Machine { gauge_point_mm: Some(Vec3::new(0.0, 0.0, 120.0)), ..Machine::plain() };
        let at = |x: f64, long: f64, to_tip: bool| {
            let mut m = Moment {
                station_mm: Vec3::new(-900.0, 300.0, 500.0),
                tool_length_mm: long,
                ..Moment::default()
            };
            m.position[..3].copy_from_slice(&[x, 20.0, 30.0]);
            let target = m.carriage_mm() + if to_tip { machine.tip_of(&m) } else { Vec3::zeros() };
            m.range_mm = (target - m.station_mm).norm();
            (m, target)
        };
        for to_tip in [false, true] {
            let (mut moments, targets): (Vec<Moment>, Vec<Vec3>) =
                [(0.0, 70.0), (150.0, 200.0), (300.0, 70.0)]
                    .map(|(x, l)| at(x, l, to_tip))
                    .into_iter()
                    .unzip();
            aim(&mut moments, &machine);
            for (m, target) in moments.iter().zip(targets) {
                assert!((m.reflector_mm - target).norm() < 1e-9, "{to_tip}");
            }
        }
        let (stated, target) = at(10.0, 70.0, true);
        let mut without = vec![Moment { range_mm: f64::NAN, ..stated.clone() }];
        aim(&mut without, &machine);
        assert_eq!((without[0].reflector_mm, without[0].range_mm), (target, stated.range_mm));
    }
}
