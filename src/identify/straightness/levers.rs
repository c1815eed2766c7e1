//! Moving linear components to other reference points with the angles that were measured beside them.
//!
//! Component i of an error motion is the displacement of the point `r_i`. At the point `b` it is
//! `E_i + [eps x (b - r_i)]_i`: the terms of Abbe (positioning) and Bryan (straightness). Dropping them, as one does by
//! calling every point of a set-up "the base point", costs 5 um per 100 mm and 10 arcsec. A point that stays with
//! the bed side moves on the carriage: `r_i + sigma q u`, sigma = +1 for a primed, -1 for an unprimed axis.
//!
//! Source: equations 1.5, 4.4 (base-point simplification).

use volcomp_model::geometry::Vec3;

/// The linear components of `motion` (EX EY EZ in mm, EA EB EC in rad) at the point `to` instead of `from[i]`; all points in
/// home-frame coordinates at this pose.
#[must_use]
pub fn moved(motion: &[f64; 6], from: &[Vec3; 3], to: &[Vec3; 3]) -> [f64; 3] {
    let eps = Vec3::new(motion[3], motion[4], motion[5]);
    std::array::from_fn(|i| motion[i] + eps.cross(&(to[i] - from[i]))[i])
}

#[cfg(test)]
mod tests {
    use super::*;
    use volcomp_model::geometry::small_rotation;

    #[test]
    fn moving_agrees_with_the_exact_rotation() {
        let motion = [0.01, -0.02, 0.005, 2e-5, -3e-5, 4e-5];
        let from = [Vec3::new(10.0, 20.0, 30.0), Vec3::new(-5.0, 0.0, 80.0), Vec3::new(0.0, 300.0, 0.0)];
        let to = [Vec3::new(163.626, -212.772, -290.704); 3];
        let turn = small_rotation(&Vec3::new(motion[3], motion[4], motion[5]));
        let moved = moved(&motion, &from, &to);
        for i in 0..3 {
            let exact = motion[i] + (turn * (to[i] - from[i]) - (to[i] - from[i]))[i];
            assert!((moved[i] - exact).abs() < 1e-6, "{i}");
        }
        // there and back
        let motion_there = [moved[0], moved[1], moved[2], 2e-5, -3e-5, 4e-5];
        let back = super::moved(&motion_there, &to, &from);
        assert!(back.iter().zip(motion).all(|(a, b)| (a - b).abs() < 1e-15));
    }

    #[test]
    fn ten_arcsec_at_a_hundred_millimetres_are_five_micrometres() {
        let motion = [0.0, 0.0, 0.0, 0.0, 10.0 * volcomp_units::RAD_PER_ARCSEC, 0.0];
        let moved = moved(&motion, &[Vec3::zeros(); 3], &[Vec3::new(0.0, 0.0, 100.0); 3]);
        assert!((moved[0] - 4.85e-3).abs() < 1e-5 && moved[1] == 0.0);
    }
}
