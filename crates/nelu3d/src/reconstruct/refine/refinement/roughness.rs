//! How rough the surface is, place by place.
//!
//! A wall is smoother than any prior that keeps the features of a face. What second differences are left in the solution
//! beside those that noise makes tells how rough the surface is, and the prior's floor is set to that: a step of
//! expectation and maximization for the variance of a Gaussian prior (MacKay, *Bayesian interpolation*, 1992), place by
//! place. Never above what was asked for: errors that neighbors share, as those of interreflection, look like shape.

use rayon::prelude::*;

use super::Refinement;
use crate::reconstruct::refine::uncertainty::noise_ratio;

/// Independent second differences as rough as the prior allows that are assumed beside those of each place.
const ASSUMED: f32 = 1.0;

impl Refinement<'_> {
    /// Sets the prior's floor to the roughness of the present surface, at the linear system that was set up last.
    pub(in crate::reconstruct::refine) fn measure_roughness(&mut self) {
        let mut scale = Vec::with_capacity(self.x.len());
        for strip in self.strips() {
            let mut noise = noise_ratio(&strip.prior, &strip.information);
            noise.par_iter_mut().enumerate().with_min_len(self.window.w).for_each(|(i, noise)| {
                if strip.prior.active[i] {
                    *noise *= self.depth_noise_factor(strip.start + i, strip.posterior.pixels[i]);
                }
            });
            let x = &self.x[strip.start..strip.start + noise.len()];
            scale.extend_from_slice(strip.own(&strip.posterior.prior_scale(&strip.prior, x, &noise, ASSUMED)));
        }
        self.prior.scale_floor(&scale);
    }
}
