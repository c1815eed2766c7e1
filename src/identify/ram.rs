//! Errors of the ram (the carriage that bears the head) from tool poses at several positions of the head.
//!
//! Per pose the tip was found off by dp and the tool direction by da: `dp = E + eps x l`, `da = eps x a`, with l from
//! the Z reference point to the tip and a the tool direction. One pose leaves the turn about the tool axis free;
//! poses with other C or A see it, or a prior fixes it.
//!
//! Assumptions: the head's own errors are taken off before; noise is isotropic. Of `da` only the two components across
//! a carry information, the third is left out.
//! Source: equations 5.5, 2.2, 4.3 ((3), (4)).

use crate::prelude::*;

use super::twist::{self, Row, Sighting};
use volcomp_model::geometry::rotation_about;
use volcomp_model::statistics::ChiSquare;

/// The head.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Head {
    /// From the Z reference point to the A axis at home, mm.
    pub a_axis: Vec3,
    /// From the Z reference point to a point on the C axis, mm; zero where it lies on it.
    pub c_axis: Vec3,
    /// From the A axis to the tip, mm.
    pub tool_length: f64,
}

/// One pose of the head and what was found there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HeadPose {
    /// C, rad.
    pub c: f64,
    /// A, rad.
    pub a: f64,
    /// Tip actual minus nominal, mm.
    pub tip_error: Vec3,
    /// Unit vector along the tool (tip to spindle), actual minus nominal.
    pub direction_error: Vec3,
}

/// Standard deviations per component.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RamNoise {
    /// Of the tip, mm.
    pub position: f64,
    /// Of the direction, rad.
    pub direction: f64,
}

/// What is known before: mean and standard deviation of the six; infinite where nothing is known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Prior {
    /// EX EY EZ (mm) EA EB EC (rad).
    pub mean: Vector6<f64>,
    /// Standard deviations.
    pub std: Vector6<f64>,
}

/// The ram's errors.
#[derive(Debug, Clone, PartialEq)]
pub struct RamFit {
    /// EX EY EZ (mm, at the Z reference point) EA EB EC (rad).
    pub motion: Vector6<f64>,
    /// Covariance of these, prior included.
    pub covariance: Matrix6<f64>,
    /// How many of the six the poses alone determine.
    pub rank: usize,
    /// Sum of squared weighted residuals.
    pub chi2: f64,
    /// Its degrees of freedom.
    pub dof: usize,
    /// Probability that noise alone exceeds it.
    pub p_value: f64,
    /// Weighted residuals of each pose: tip (3) and direction (2), in standard deviations.
    pub residuals: Vec<[f64; 5]>,
}

/// Why the six are not determined.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RamError {
    /// A combination stays free.
    #[error(
        "{poses} head pose{} determine{} {rank} of six ram errors: {}is not observable, it is {}; measure at another C or A, or give a prior",
        if *poses == 1 { "" } else { "s" }, if *poses == 1 { "s" } else { "" },
        if *rank == 5 { "rotation about the tool axis " } else { "more than one combination " },
        twist::words(unobservable)
    )]
    Deficient {
        /// Poses given.
        poses: usize,
        /// Combinations determined.
        rank: usize,
        /// A combination that changes no reading.
        unobservable: Vector6<f64>,
    },
    /// A standard deviation that is not above zero.
    #[error("standard deviation of the {what} {value} is not above 0")]
    Sigma {
        /// Which.
        what: &'static str,
        /// The value.
        value: f64,
    },
}

impl Prior {
    /// At a position of the ram: means from the curves of a model, zero without one; `std` as in [`Prior`].
    #[must_use]
    pub fn of_model(
        model: Option<&ModelSpec>,
        std: [f64; 6],
        axis: AxisName,
        position: f64,
        travel: Travel,
    ) -> Self {
        let mut mean = [0.0; 6];
        for (symbol, function) in model.iter().flat_map(|m| &m.errors) {
            if symbol.axis() == axis && !symbol.is_constant() {
                mean[symbol.component().index()] = function.value(position, travel);
            }
        }
        Self { mean: mean.into(), std: std.into() }
    }
}

impl RamFit {
    /// Residuals over stated noise, where larger; 1 without a degree of freedom.
    #[must_use]
    pub fn misfit(&self) -> f64 {
        let fit = ChiSquare { sum: self.chi2, dof: self.dof };
        fit.noise_factor().map_or(1.0, |factor| factor.max(1.0))
    }
}

impl HeadPose {
    /// Takes off what the rotary axes of a model do: first order, ram at home.
    pub fn take_off(&mut self, model: &Model, head: &Head) {
        let pose = model.pose_of(&[(AxisName::C, self.c), (AxisName::A, self.a)]);
        let of_head = model.deviation(&pose);
        self.tip_error -= of_head.position;
        self.direction_error -= of_head.rotation.cross(&head.at(self.c, self.a).0);
    }
}

impl Head {
    /// Tool direction and lever from the Z reference point to the tip at a pose.
    ///
    /// # Source  equations 2.2: `l = c0 + Rz(C) (a0 - c0 + Rx(A) (0, 0, -L))`
    #[must_use]
    pub fn at(&self, c: f64, a: f64) -> (Vec3, Vec3) {
        let (turn_c, turn_a) = (rotation_about(2, c), rotation_about(0, a));
        let direction = turn_c * turn_a * Vec3::z();
        let from_c = self.a_axis - self.c_axis + turn_a * Vec3::new(0.0, 0.0, -self.tool_length);
        let lever = self.c_axis + turn_c * from_c;
        (direction, lever)
    }
}

/// Solves for the six errors.
///
/// # Errors
/// A combination that poses and prior leave free, standard deviations that are not above zero.
///
/// # Source  equations 5.5
pub fn solve(
    head: &Head,
    poses: &[HeadPose],
    noise: &RamNoise,
    prior: Option<&Prior>,
) -> Result<RamFit, RamError> {
    for (what, value) in [("tip", noise.position), ("direction", noise.direction)] {
        if !(value.is_finite() && value > 0.0) {
            return Err(RamError::Sigma { what, value });
        }
    }
    let mut rows: Vec<Row> = Vec::with_capacity(5 * poses.len() + 6);
    for pose in poses {
        rows.extend(rows_of(head, pose, noise)?);
    }
    let mut solved = twist::solve(&rows);
    let rank = solved.as_ref().map_or_else(|d| d.rank, |_| 6);
    if let Some(prior) = prior {
        rows.extend(prior_rows(prior)?);
        solved = twist::solve(&rows);
    }
    let fit = solved.map_err(|d| RamError::Deficient {
        poses: poses.len(),
        rank: d.rank,
        unobservable: d.unobservable.first().copied().unwrap_or_else(Vector6::zeros),
    })?;
    Ok(RamFit {
        motion: fit.value,
        covariance: fit.covariance,
        rank,
        chi2: fit.chi2,
        dof: fit.dof,
        p_value: chi_square_upper(fit.chi2, fit.dof),
        residuals: (0..poses.len()).map(|i| core::array::from_fn(|k| fit.residuals[5 * i + k])).collect(),
    })
}

/// Three rows of the tip, two of the direction across the tool.
fn rows_of(head: &Head, pose: &HeadPose, noise: &RamNoise) -> Result<[Row; 5], RamError> {
    let (a, l) = head.at(pose.c, pose.a);
    let tip = Sighting {
        point: l,
        displacement: pose.tip_error,
        covariance: Mat3::identity() * noise.position.powi(2),
    };
    let tip = twist::rows_of(&[tip]).map_err(|_| RamError::Sigma { what: "tip", value: noise.position })?;
    let other = if a.x.abs() < 0.6 { Vec3::x() } else { Vec3::y() };
    let u = a.cross(&other).normalize();
    let across = [u, a.cross(&u)].map(|e| {
        // e . (eps x a) = eps . (a x e)
        let turn = a.cross(&e) / noise.direction;
        Row {
            design: Vector6::new(0.0, 0.0, 0.0, turn.x, turn.y, turn.z),
            value: e.dot(&pose.direction_error) / noise.direction,
        }
    });
    Ok([tip[0], tip[1], tip[2], across[0], across[1]])
}

/// One row per error of which something is known.
fn prior_rows(prior: &Prior) -> Result<Vec<Row>, RamError> {
    let mut rows = Vec::new();
    for i in 0..6 {
        let std = prior.std[i];
        if std.is_nan() || std <= 0.0 {
            return Err(RamError::Sigma { what: "prior", value: std });
        }
        if std.is_finite() {
            let mut design = Vector6::zeros();
            design[i] = 1.0 / std;
            rows.push(Row { design, value: prior.mean[i] / std });
        }
    }
    Ok(rows)
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    use super::*;

    const HEAD: Head =
        Head { a_axis: Vec3::new(-0.2, 0.1, -190.0), c_axis: Vec3::new(0.0, 0.0, 0.0), tool_length: 220.0 };
    const NOISE: RamNoise = RamNoise { position: 0.002, direction: 1e-5 };
    const TRUTH: [f64; 6] = [0.012, -0.02, 0.007, 4e-5, -3e-5, 5e-5];

    /// The pose errors of an exactly turned ram, its rotation written out element by element.
    fn pose(c: f64, a: f64) -> HeadPose {
        let (sc, cc, sa, ca) = (c.sin(), c.cos(), a.sin(), a.cos());
        let direction = Vec3::new(sc * sa, -cc * sa, ca);
        let (x, y, z) = (-0.2, 0.1 + 220.0 * sa, -190.0 - 220.0 * ca);
        let lever = Vec3::new(cc * x - sc * y, sc * x + cc * y, z);
        let [ex, ey, ez, ta, tb, tc] = TRUTH;
        let rx = Mat3::new(1.0, 0.0, 0.0, 0.0, ta.cos(), -ta.sin(), 0.0, ta.sin(), ta.cos());
        let ry = Mat3::new(tb.cos(), 0.0, tb.sin(), 0.0, 1.0, 0.0, -tb.sin(), 0.0, tb.cos());
        let rz = Mat3::new(tc.cos(), -tc.sin(), 0.0, tc.sin(), tc.cos(), 0.0, 0.0, 0.0, 1.0);
        let turn = rz * ry * rx;
        HeadPose {
            c,
            a,
            tip_error: Vec3::new(ex, ey, ez) + turn * lever - lever,
            direction_error: turn * direction - direction,
        }
    }

    fn poses() -> Vec<HeadPose> {
        [(0.0, 0.3), (1.5, -0.6), (-2.4, 0.8), (2.9, 0.1)].map(|(c, a)| pose(c, a)).to_vec()
    }

    #[test]
    fn several_poses_give_the_ram_back() {
        let fit = solve(&HEAD, &poses(), &NOISE, None).unwrap();
        for (i, truth) in TRUTH.iter().enumerate() {
            assert!(
                (fit.motion[i] - truth).abs() < if i < 3 { 3e-6 } else { 5e-9 },
                "{i}: {}",
                fit.motion[i]
            );
        }
        assert_eq!((fit.rank, fit.dof), (6, 14));
    }

    #[test]
    fn the_reference_point_need_not_lie_on_the_c_axis() {
        let off = Vec3::new(40.0, -25.0, 60.0);
        let head = Head { a_axis: HEAD.a_axis + off, c_axis: off, ..HEAD };
        let fit = solve(&head, &poses(), &NOISE, None).unwrap();
        let (shift, turn) =
            (Vec3::new(TRUTH[0], TRUTH[1], TRUTH[2]), Vec3::new(TRUTH[3], TRUTH[4], TRUTH[5]));
        let wanted = shift - turn.cross(&off);
        for i in 0..3 {
            assert!((fit.motion[i] - wanted[i]).abs() < 3e-6, "{i}: {} {wanted}", fit.motion[i]);
            assert!((fit.motion[3 + i] - turn[i]).abs() < 5e-9, "{}", fit.motion);
        }
    }

    #[test]
    fn one_pose_is_refused_in_words_and_a_prior_helps() {
        let error = solve(&HEAD, &poses()[..1], &NOISE, None).unwrap_err();
        let RamError::Deficient { rank, unobservable, .. } = &error else { panic!("{error}") };
        assert_eq!(*rank, 5);
        // the free rotation is about the tool, and it moves the reference point so that the tip stays
        let (a, l) = HEAD.at(0.0, 0.3);
        let eps = Vec3::new(unobservable[3], unobservable[4], unobservable[5]);
        assert!(eps.normalize().cross(&a).norm() < 1e-6);
        let moved = Vec3::new(unobservable[0], unobservable[1], unobservable[2]) + eps.cross(&l);
        assert!(moved.norm() < 1e-6 * eps.norm() * l.norm());
        assert!(
            error
                .to_string()
                .contains("1 head pose determines 5 of six ram errors: rotation about the tool axis"),
            "{error}"
        );
        let mut std = Vector6::repeat(f64::INFINITY);
        std[5] = 1e-9;
        let prior = Prior { mean: Vector6::from(TRUTH), std };
        let fit = solve(&HEAD, &poses()[..1], &NOISE, Some(&prior)).unwrap();
        assert_eq!((fit.rank, fit.dof), (5, 0));
        assert!((fit.motion - Vector6::from(TRUTH)).norm() < 1e-5, "{}", fit.motion);
    }

    #[test]
    fn the_stated_interval_holds_the_truth() {
        let mut inside = [0u32; 6];
        let seeds = 2000;
        for seed in 0..seeds {
            let mut random = ChaCha8Rng::seed_from_u64(seed);
            let mut noisy = poses();
            for p in &mut noisy {
                for i in 0..3 {
                    let (x, y): (f64, f64) =
                        (StandardNormal.sample(&mut random), StandardNormal.sample(&mut random));
                    p.tip_error[i] += NOISE.position * x;
                    p.direction_error[i] += NOISE.direction * y;
                }
            }
            let fit = solve(&HEAD, &noisy, &NOISE, None).unwrap();
            for i in 0..6 {
                inside[i] +=
                    u32::from((fit.motion[i] - TRUTH[i]).abs() < 1.96 * fit.covariance[(i, i)].sqrt());
            }
        }
        for n in inside {
            assert!((0.935..=0.965).contains(&(f64::from(n) / seeds as f64)), "{inside:?}");
        }
    }

    #[test]
    fn equal_poses_and_bad_weights_are_refused() {
        let same = [pose(0.4, 0.2), pose(0.4, 0.2)];
        assert!(matches!(
            solve(&HEAD, &same, &NOISE, None),
            Err(RamError::Deficient { rank: 5, poses: 2, .. })
        ));
        let none = RamNoise { position: 0.0, direction: 1e-5 };
        assert!(matches!(solve(&HEAD, &same, &none, None), Err(RamError::Sigma { what: "tip", .. })));
    }
}
