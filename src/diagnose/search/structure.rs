//! Structure: what of a gap is no effect and no independent noise either. It joins the noise of a problem in the order in which it stands
//! here.

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

    /// That beside which variations of effects are compared.
    pub(super) fn lasting(&self) -> impl DoubleEndedIterator<Item = &LowRank> {
        self.roughness.iter().map(|r| &r.noise).chain(&self.discrepancy)
    }
}
