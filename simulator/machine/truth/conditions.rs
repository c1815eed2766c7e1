//! The machine between survey and test: heat, load with axis interaction, and wear, as additional error motions of the axes.
//!
//! A rigid-body model of single-axis curves cannot hold what interaction adds, and a survey cannot hold what changes after
//! it. Each part is switched by itself, so that its share of an error can be measured. Relative sense, as error motions.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use volcomp_units::axes::AxisName;

/// Expansion coefficient of screws and scales, 1/K.
const EXPANSION: f64 = 11.5e-6;
/// Height of a guideway body, mm: a temperature difference over it bends the body.
const BODY_MM: f64 = 450.0;
/// Length over which an axis interaction is stated, mm.
const INTERACTION_MM: f64 = 500.0;

/// Sizes of the parts, each the standard deviation over seeds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ConditionSizes {
    /// Temperature rise of each screw or scale since the survey, K.
    pub rise_k: f64,
    /// Temperature difference over the height of a guideway, K.
    pub gradient_k: f64,
    /// Tilt of the column by uneven heat, arcsec.
    pub column_arcsec: f64,
    /// Roll and pitch of a carriage over [`INTERACTION_MM`] of another axis, arcsec: at survey and test alike.
    pub interaction_arcsec: f64,
    /// Additional interaction by the workpiece, which is on the table in the test only, as a share of the machine's own.
    pub load_share: f64,
    /// Sag of the table over its half travels in the middle of both axes under load, um.
    pub sag_um: f64,
    /// Depth of a worn stretch of a screw, um.
    pub wear_um: f64,
    /// Growth of the lost motion, um.
    pub lost_um: f64,
}

impl ConditionSizes {
    /// A machining centre in a shop without air conditioning: half a shift between survey and cut, a month of wear.
    pub const SHOP: Self = Self {
        rise_k: 1.0,
        gradient_k: 0.3,
        column_arcsec: 1.0,
        interaction_arcsec: 0.8,
        load_share: 0.5,
        sag_um: 0.8,
        wear_um: 0.6,
        lost_um: 0.2,
    };
}

/// Which parts act.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Acting {
    /// Heat since the survey.
    pub heat: bool,
    /// Workpiece on the table.
    pub load: bool,
    /// Interaction of the axes without a workpiece.
    pub interaction: bool,
    /// Wear since the survey.
    pub wear: bool,
}

impl Acting {
    /// The machine of the survey: it has its interaction, and nothing has happened since.
    pub const SURVEY: Self = Self { heat: false, load: false, interaction: true, wear: false };
    /// The machine of the test.
    pub const TEST: Self = Self { heat: true, load: true, interaction: true, wear: true };
}

/// One axis.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct AxisConditions {
    /// Temperature rise, K, and the coordinate that stays.
    rise: [f64; 2],
    /// Curvature of the guideway by heat in its two planes, 1/mm.
    curvature: [f64; 2],
    /// Angles per length of the next axis in the cycle x, y, z: about the two directions across, rad/mm.
    interaction: [f64; 2],
    /// Worn stretch: depth (mm), middle, half length.
    worn: [f64; 3],
    /// Half of the growth of the lost motion, mm.
    lost: f64,
}

/// Conditions of a machine with linear axes X, Y, Z.
#[derive(Debug, Clone, PartialEq)]
pub struct Conditions {
    axes: [AxisConditions; 3],
    travel: [[f64; 2]; 3],
    /// Tilt of the line of Z by heat about x and y, rad.
    column: [f64; 2],
    load_share: f64,
    sag_mm: f64,
    /// Which parts act.
    pub acting: Acting,
}

impl Conditions {
    /// Conditions drawn from a seed for travels of X, Y, Z (mm).
    #[must_use]
    pub fn new(sizes: &ConditionSizes, travel: [[f64; 2]; 3], acting: Acting, seed: u64) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed ^ 0x00c0_4d17_1045);
        let axes = std::array::from_fn(|k| {
            let [low, high] = travel[k];
            let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
            let rise = sizes.rise_k * normal();
            let curvature = [normal(), normal()].map(|n| EXPANSION * sizes.gradient_k * n / BODY_MM);
            let interaction = [normal(), normal()]
                .map(|n| (sizes.interaction_arcsec * n / 3600.0).to_radians() / INTERACTION_MM);
            let depth = 1e-3 * sizes.wear_um * normal().abs();
            let lost = 0.5e-3 * sizes.lost_um * normal().abs();
            let place = |share: f64| low + share * (high - low);
            let fixed = place(if random.random::<bool>() { 0.0 } else { 1.0 });
            let worn = place(0.3 + 0.4 * random.random::<f64>());
            AxisConditions {
                rise: [rise, fixed],
                curvature,
                interaction,
                worn: [depth, worn, 0.12 * (high - low)],
                lost,
            }
        });
        let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
        let column = [normal(), normal()].map(|n| (sizes.column_arcsec * n / 3600.0).to_radians());
        let sag_mm = 1e-3 * sizes.sag_um * normal().abs();
        Self { axes, travel, column, load_share: sizes.load_share, sag_mm, acting }
    }

    /// The same machine with other parts acting.
    #[must_use]
    pub const fn with(mut self, acting: Acting) -> Self {
        self.acting = acting;
        self
    }

    /// Additional EX EY EZ (mm) and EA EB EC (rad) of an axis with X, Y, Z at `at` (mm) and the slack of the axis, -1 to 1.
    #[must_use]
    pub fn motion(&self, axis: AxisName, at: [f64; 3], slack: f64) -> [f64; 6] {
        let Some(k) = [AxisName::X, AxisName::Y, AxisName::Z].iter().position(|a| *a == axis) else {
            return [0.0; 6];
        };
        let own = &self.axes[k];
        let (first, second) = ((k + 1) % 3, (k + 2) % 3);
        let middle = |i: usize| f64::midpoint(self.travel[i][0], self.travel[i][1]);
        let (q, from_middle) = (at[k], at[k] - middle(k));
        let mut motion = [0.0; 6];
        if self.acting.heat {
            let [rise, fixed] = own.rise;
            motion[k] += EXPANSION * rise * (q - fixed);
            // a bent guideway: the straightness is the integral of the angle
            let [c, d] = own.curvature;
            motion[first] += 0.5 * c * from_middle * from_middle;
            motion[3 + second] += c * from_middle;
            motion[second] += 0.5 * d * from_middle * from_middle;
            motion[3 + first] -= d * from_middle;
            if axis == AxisName::Z {
                motion[1] -= self.column[0] * q;
                motion[0] += self.column[1] * q;
            }
        }
        let mut share = 0.0;
        if self.acting.interaction {
            share += 1.0;
        }
        if self.acting.load {
            share += self.load_share;
            if axis == AxisName::Y {
                // the saddle sinks with the table off its middle
                let half = |i: usize| 0.5 * (self.travel[i][1] - self.travel[i][0]).max(1.0);
                let (x, y) = ((at[0] - middle(0)) / half(0), (at[1] - middle(1)) / half(1));
                motion[2] += self.sag_mm * x * y * y;
            }
        }
        if axis != AxisName::Z {
            // the place of the next axis turns this carriage, the more the further both are from their middles
            let other = at[first] - middle(first);
            let both = share * other * from_middle / INTERACTION_MM;
            let [a, b] = own.interaction;
            motion[3 + k] += a * both;
            motion[3 + first] += b * both;
        }
        if self.acting.wear {
            let [depth, worn, half] = own.worn;
            motion[k] -= depth * (-0.5 * ((q - worn) / half).powi(2)).exp();
            motion[k] -= own.lost * slack;
        }
        motion
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TRAVEL: [[f64; 2]; 3] = [[0.0, 850.0], [0.0, 500.0], [-500.0, 0.0]];

    fn conditions(acting: Acting) -> Conditions {
        Conditions::new(&ConditionSizes::SHOP, TRAVEL, acting, 7)
    }

    #[test]
    fn parts_add_up_and_are_seeded() {
        let none = Acting { heat: false, load: false, interaction: false, wear: false };
        let at = [100.0, 400.0, -100.0];
        for axis in [AxisName::X, AxisName::Y, AxisName::Z] {
            assert_eq!(conditions(none).motion(axis, at, 1.0), [0.0; 6]);
            let one = |acting| conditions(acting).motion(axis, at, 1.0);
            let parts = [
                Acting { heat: true, ..none },
                Acting { load: true, ..none },
                Acting { interaction: true, ..none },
                Acting { wear: true, ..none },
            ]
            .map(one);
            let all = one(Acting::TEST);
            for i in 0..6 {
                let sum: f64 = parts.iter().map(|p| p[i]).sum();
                assert!((sum - all[i]).abs() < 1e-15, "{axis} {i}");
            }
        }
        assert_eq!(conditions(Acting::TEST), conditions(Acting::TEST));
    }

    #[test]
    fn heat_lengthens_a_screw_and_bends_a_guideway_consistently() {
        let heat = conditions(Acting { heat: true, load: false, interaction: false, wear: false });
        let at = |x: f64| heat.motion(AxisName::X, [x, 250.0, -250.0], 0.0);
        let growth = at(850.0)[0] - at(0.0)[0];
        assert!((growth / (850.0 * EXPANSION * heat.axes[0].rise[0]) - 1.0).abs() < 1e-9);
        // slope of EYX is ECX
        let slope = (at(601.0)[1] - at(599.0)[1]) / 2.0;
        assert!((slope - at(600.0)[5]).abs() < 1e-12);
        let slope = (at(601.0)[2] - at(599.0)[2]) / 2.0;
        assert!((slope + at(600.0)[4]).abs() < 1e-12);
    }

    #[test]
    fn interaction_vanishes_in_the_middle_of_either_axis() {
        let own = conditions(Acting::SURVEY);
        assert_eq!(own.motion(AxisName::X, [100.0, 250.0, 0.0], 1.0), [0.0; 6]);
        assert_ne!(own.motion(AxisName::X, [100.0, 400.0, 0.0], 1.0), [0.0; 6]);
    }
}
