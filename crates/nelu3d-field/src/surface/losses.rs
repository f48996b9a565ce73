//! The losses of one step.

use super::config::SurfaceLoss;
use serde::Serialize;

/// Losses of one step, before their weights, and the whole.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct SurfaceLosses {
    /// Weighted sum of the others.
    pub total: f64,
    /// The image loss, Eq. 4.
    pub image: f64,
    /// The mask loss, Eq. 5.
    pub mask: f64,
    /// L_eik of Eq. 6.
    pub eikonal: f64,
    /// L_sp of Eq. 6.
    pub sparsity: f64,
}

impl SurfaceLosses {
    /// Adds the losses of other rays, all but the total.
    pub(super) fn add(&mut self, other: &Self) {
        self.image += other.image;
        self.mask += other.mask;
        self.eikonal += other.eikonal;
        self.sparsity += other.sparsity;
    }

    /// Writes the total.
    pub(super) fn sum(&mut self, weights: &SurfaceLoss) {
        self.total = self.image
            + weights.mask_weight * self.mask
            + weights.eikonal_weight * self.eikonal
            + weights.sparsity_weight * self.sparsity;
    }
}
