//! The interface of an image formation.

use super::losses::SurfaceLosses;
use crate::volrend::cpu::Step;
use crate::volrend::midpoint::Midpoint;

/// An image formation and its losses: what the samples of a ray should be, apart from a distance.
pub trait RayLoss: Sync {
    /// Returns whether it needs the distances' gradients. They are then computed for every sample, and
    /// [`SurfaceLoss::eikonal_every`](super::SurfaceLoss::eikonal_every) must be 1.
    fn needs_gradients(&self) -> bool;

    /// Returns the number of values per ray that it sends back to the caller.
    fn n_ray_outputs(&self) -> usize;

    /// Returns the number of values per sample that it sends back to the caller.
    fn n_sample_outputs(&self) -> usize;

    /// Computes the loss of ray `ray` and its gradients. `sdf` are the signed distances of its samples, front to back,
    /// `gradients` their gradients in space (empty unless [`Self::needs_gradients`]).
    fn ray(
        &self,
        ray: usize,
        sdf: &[f32],
        gradients: &[[f32; 3]],
        inv_s: f64,
        scratch: &mut RayScratch,
        out: RayGradient<'_>,
    );
}

/// The outputs of a [`RayLoss`].
#[derive(Debug)]
pub struct RayGradient<'a> {
    /// Losses of the step so far, image and mask: to be added to, already divided by the number of rays.
    pub losses: &'a mut SurfaceLosses,
    /// Gradient by inv_s, to be added to.
    pub d_inv_s: &'a mut f64,
    /// Gradients by the distances, to be written.
    pub d_sdf: &'a mut [f32],
    /// Gradients by the distances' gradients, to be written; empty unless [`RayLoss::needs_gradients`].
    pub d_gradients: &'a mut [[f32; 3]],
    /// The ray's values for the caller, to be written.
    pub ray: &'a mut [f32],
    /// Its samples' values for the caller, `[sample][value]`, to be written.
    pub samples: &'a mut [f32],
}

/// Memory that a [`RayLoss`] finds again at the next ray.
#[derive(Debug, Default)]
pub struct RayScratch {
    /// Scratch memory of the image formation, of any length.
    pub buffers: [Vec<f32>; 4],
    pub(crate) steps: Vec<Step>,
    pub(crate) midpoints: Vec<Midpoint<f32>>,
}
