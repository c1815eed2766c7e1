//! Structure: what of a gap is no effect and no independent noise either. It joins the noise of a problem in the order in which it stands
//! here.

use nalgebra::DVector;

use super::low_rank::LowRank;
use super::roughness::Roughness;
use super::variation::Variation;

/// What has joined the noise.
#[derive(Debug, Clone, Default)]
pub struct Structure {
    /// Of curves beyond their polynomials.
    pub roughness: Option<Roughness>,
    /// What varies smoothly over the volume and no effect describes.
    pub discrepancy: Option<LowRank>,
    /// How far effects vary over the volume.
    pub variation: Option<Variation>,
}

impl Structure {
    /// The noise of each.
    pub(crate) fn noises(&self) -> impl DoubleEndedIterator<Item = &LowRank> {
        self.lasting().chain(self.variation.iter().map(|v| &v.noise))
    }

    /// Posterior mean of the part at a place among the noises, per row, from what is left whitened by all of them: each acts among rows
    /// that those before it have whitened.
    #[must_use]
    pub fn posterior_mean(&self, place: usize, left: &DVector<f64>) -> DVector<f64> {
        let noises: Vec<&LowRank> = self.noises().collect();
        let mut rows = left.clone();
        noises[place..].iter().rev().for_each(|noise| noise.turn(rows.as_mut_slice(), false));
        let mut mean = noises[place].times(&rows);
        noises[..place].iter().rev().for_each(|noise| noise.turn(mean.as_mut_slice(), true));
        mean
    }

    /// That beside which variations of effects are compared.
    pub(super) fn lasting(&self) -> impl DoubleEndedIterator<Item = &LowRank> {
        self.roughness.iter().map(|r| &r.noise).chain(&self.discrepancy)
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{DMatrix, DVector};

    use super::super::super::noise::Random;
    use super::super::low_rank::LowRank;
    use super::Structure;
    use crate::search::Roughness;

    const N: usize = 30;

    #[test]
    fn the_posterior_mean_of_each_part_is_its_covariance_over_that_of_all() {
        let mut random = Random::new(5);
        let mut columns = |n: usize| DMatrix::from_fn(N, n, |_, _| random.normal());
        let (first, second, left) = (columns(4), columns(3), columns(1).column(0).into_owned());
        let rough = LowRank::of(&first, &[0.7; 4]);
        let mut white = second.transpose();
        rough.turn(white.as_mut_slice(), false);
        let discrepancy = LowRank::of(&white.transpose(), &[1.3; 3]);
        let structure = Structure {
            roughness: Some(Roughness::made_up(rough)),
            discrepancy: Some(discrepancy),
            variation: None,
        };
        let parts = [0.49 * &first * first.transpose(), 1.69 * &second * second.transpose()];
        let all = DMatrix::identity(N, N) + &parts[0] + &parts[1];
        let precise = all.clone().cholesky().unwrap().solve(&left);
        let mut whitened = left;
        structure.noises().for_each(|noise| noise.turn(whitened.as_mut_slice(), false));
        for (place, part) in parts.iter().enumerate() {
            let wanted: DVector<f64> = part * &precise;
            let found = structure.posterior_mean(place, &whitened);
            assert!((found - &wanted).norm() < 1e-9 * wanted.norm(), "{place}");
        }
    }
}
