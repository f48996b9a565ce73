//! Records of a training, and the iterations after which its surface is shown.

use nelu3d_field::surface::SurfaceLosses;
use serde::Serialize;

use crate::reconstruct::error::Failure;

/// Losses and counts of one iteration.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct TrainingRecord {
    /// Number of the iteration, from 1.
    pub iteration: usize,
    /// Image loss (paper, Eq. 4).
    pub image: f64,
    /// Mask loss (paper, Eq. 5).
    pub mask: f64,
    /// Eikonal loss (paper, Eq. 6).
    pub eikonal: f64,
    /// Sparsity loss (paper, Eq. 6).
    pub sparsity: f64,
    /// Sharpness of the surface, 1/mm.
    pub inv_s_per_mm: f64,
    /// Number of rays of the iteration.
    pub rays: usize,
    /// Number of samples on the rays.
    pub samples: usize,
    /// Occupied fraction of the occupancy grid.
    pub occupied: f64,
}

/// Sharpness and counts of one iteration, as in [`TrainingRecord`].
pub(super) struct IterationCounts {
    pub(super) inv_s_per_mm: f64,
    pub(super) rays: usize,
    pub(super) samples: usize,
    pub(super) occupied: f64,
}

impl TrainingRecord {
    /// Makes the record of an iteration from its losses and counts.
    pub(super) fn new(iteration: usize, losses: &SurfaceLosses, counts: IterationCounts) -> Self {
        let IterationCounts { inv_s_per_mm, rays, samples, occupied } = counts;
        Self {
            iteration,
            image: losses.image,
            mask: losses.mask,
            eikonal: losses.eikonal,
            sparsity: losses.sparsity,
            inv_s_per_mm,
            rays,
            samples,
            occupied,
        }
    }
}

/// Returns the failure of a training whose loss is not a number.
pub(super) fn diverged(iteration: usize) -> Failure {
    Failure::Nothing(format!(
        "training diverged at iteration {iteration}: the loss is not a number; try another seed or another start"
    ))
}

/// Returns whether an observer is shown the surface after this many iterations: a few times at first, then every
/// thousand.
pub(super) fn is_observed_after(done: usize, n_steps: usize) -> bool {
    matches!(done, 10 | 25 | 50 | 100 | 200 | 350 | 500 | 700) || done.is_multiple_of(1000) || done == n_steps
}
