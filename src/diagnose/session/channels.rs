//! Channels of one mounting: a laser of several degrees of freedom reads a positioning error, straightness and angles at once. Each
//! angle has a zero of its own, and the straightness a reference line of its own, however they were numbered.

use std::collections::BTreeMap;

use super::super::constants::NEARLY;
use super::super::moment::{Axis, Moment};
use super::{NO_SPAN, only_axis, widen};

/// What a reading of a mounting shares its offset with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Channel {
    /// Displacement, in whatever direction.
    Displacement,
    /// Displacement across the only axis that moves.
    Straightness,
    /// An angle: the direction of measurement and that of the lever, rounded.
    Angle([i64; 6]),
}

impl Channel {
    /// `line`: the only axis that moves in the set-up, where all displacements are along or across it.
    fn of(m: &Moment, line: Option<Axis>) -> Self {
        if m.is_angular() {
            let lever = m.lever_mm.normalize();
            return Self::Angle(core::array::from_fn(|k| {
                let c = if k < 3 { m.u[k] } else { lever[k - 3] };
                (c * 10.0).round() as i64
            }));
        }
        match line {
            Some(axis) if m.u[axis.direction()].abs() < NEARLY => Self::Straightness,
            _ => Self::Displacement,
        }
    }

    fn name(self) -> String {
        match self {
            Self::Displacement => "displacement".to_owned(),
            Self::Straightness => "straightness".to_owned(),
            Self::Angle([x, y, z, a, b, c]) => {
                // axis = lever x u
                let about = [b * z - c * y, c * x - a * z, a * y - b * x];
                let most = (0..3).max_by_key(|k| about[*k].abs()).unwrap_or(0);
                format!("angle about {}", Axis::LINEAR[most])
            }
        }
    }
}

/// The only axis that moves, a linear one, where a beam is the reference and every displacement is read along or across it.
fn line(rows: &[&Moment]) -> Option<Axis> {
    // other instruments state their directions in the machine's
    if !rows.iter().any(|m| m.is_angular() || m.light.is_some()) {
        return None;
    }
    let mut spans = NO_SPAN;
    rows.iter().for_each(|m| widen(&mut spans, m));
    let axis = Axis::ALL[only_axis(&spans)?];
    if !axis.is_linear() {
        return None;
    }
    let is_fixed = |m: &&Moment| {
        let along = m.u[axis.direction()].abs();
        m.is_angular() || !(1.0 - NEARLY..=NEARLY).contains(&along)
    };
    rows.iter().all(is_fixed).then_some(axis)
}

/// Gives each further channel of a mounting a set-up of its own: `setup` and [`Moment::setup`] of the rows, and the names in `setups`.
/// `is_one` marks rows of instruments whose directions belong together (ballbar, tracker, the control's encoders).
pub(super) fn divide(
    setup: &mut [usize],
    moments: &mut [Moment],
    setups: &mut Vec<String>,
    is_one: impl Fn(usize) -> bool,
) {
    let mut mountings: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for (i, s) in setup.iter().enumerate() {
        mountings.entry(*s).or_default().push(i);
    }
    for (mounting, rows) in mountings {
        if rows.iter().any(|i| is_one(*i)) {
            continue;
        }
        let line = line(&rows.iter().map(|i| &moments[*i]).collect::<Vec<_>>());
        let channels: Vec<Channel> = rows.iter().map(|i| Channel::of(&moments[*i], line)).collect();
        let first = channels[0];
        let mut known = BTreeMap::from([(first, mounting)]);
        let name = setups[mounting].clone();
        for (i, channel) in rows.iter().zip(channels) {
            let own = *known.entry(channel).or_insert_with(|| {
                setups.push(format!("{name} {}", channel.name()));
                setups.len() - 1
            });
            (setup[*i], moments[*i].setup) = (own, own);
        }
        if known.len() > 1 {
            setups[mounting] = format!("{name} {}", first.name());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::moment::Light;
    use super::*;
    use volcomp_model::geometry::Vec3;

    /// A reading of a laser at a position along X, of a displacement along `u` or, with a lever, of an angle.
    fn reading(x_mm: f64, u: [f64; 3], lever: Option<[f64; 3]>) -> Moment {
        let mut m = Moment { u: Vec3::from(u), light: Light::of("laser"), ..Moment::default() };
        m.position[Axis::X.slot()] = x_mm;
        m.lever_mm = Vec3::from(lever.unwrap_or([f64::NAN; 3]));
        m
    }

    fn divided(rows: &[([f64; 3], Option<[f64; 3]>)], moves: bool) -> (Vec<usize>, Vec<String>) {
        let at = |k: usize| if moves { 100.0 * k as f64 } else { 0.0 };
        let each = |k: usize| rows.iter().map(move |(u, lever)| reading(at(k), *u, *lever));
        let mut moments: Vec<Moment> = (0..3).flat_map(each).collect();
        let mut setup = vec![0; moments.len()];
        let mut setups = vec!["f.csv:1".to_owned()];
        divide(&mut setup, &mut moments, &mut setups, |_| false);
        assert!(moments.iter().zip(&setup).all(|(m, s)| m.setup == *s));
        (setup[..rows.len()].to_vec(), setups)
    }

    #[test]
    fn each_angle_and_the_straightness_of_a_laser_stand_alone() {
        let [x, y, z] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let lever = |d: [f64; 3]| Some(d.map(|c| 100.0 * c));
        let rows = [(x, None), (y, None), (z, None), (z, lever(y)), (z, lever(x)), (y, lever(x))];
        let (setup, names) = divided(&rows, true);
        assert_eq!(setup, [0, 1, 1, 2, 3, 4]);
        let wanted = ["displacement", "straightness", "angle about x", "angle about y", "angle about z"];
        assert_eq!(names, wanted.map(|w| format!("f.csv:1 {w}")));
    }

    #[test]
    fn a_probe_in_three_directions_and_one_channel_stay_one_mounting() {
        let [x, y, z] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        // nothing moves along a line
        assert_eq!(
            divided(&[(x, None), (y, None), (z, None)], false),
            (vec![0; 3], vec!["f.csv:1".to_owned()])
        );
        assert_eq!(divided(&[(y, None), (z, None)], true).1, ["f.csv:1"]);
        // a beam across the corner sees both at once
        assert_eq!(divided(&[(x, None), ([0.8, 0.6, 0.0], None)], true).1, ["f.csv:1"]);
    }
}
