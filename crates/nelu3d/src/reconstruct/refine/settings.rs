//! Settings of the narrow-band refinement.

use serde::Serialize;

/// Steps at which the surface's roughness is measured, as parts of all.
const ROUGHNESS_MEASURED: [f32; 3] = [1.0 / 3.0, 0.6, 0.8];

/// Settings of the narrow-band refinement. Depths are solved for as inverse depths in units of the spacing of depth
/// hypotheses ("steps of depth" below), about 0.7 px of disparity.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct RefineSettings {
    /// Largest number of Gauss-Newton steps: in a reduced image, if the surface is large and there are any in the full
    /// one behind them.
    pub steps: usize,
    /// Largest number of steps in the full image that follow on those in a reduced one; 0 if all are in the full image,
    /// as they are where that is small.
    pub fine_steps: usize,
    /// Mean change of depth in a step, steps of depth, below which the refinement ends early; 0 for never.
    pub settled: f32,
    /// Width 1/inv_s of the surface at the first step, mm.
    pub first_width_mm: f32,
    /// Width 1/inv_s of the surface at the last step, mm.
    pub last_width_mm: f32,
    /// Factor by which the prior's roughness exceeds [`Self::roughness`] at the first step; it falls to 1 over
    /// [`Self::loose_steps`]. Otherwise a surface that was smoothed before would decide how smooth the new one is,
    /// whatever the data say.
    pub loosened: f32,
    /// Number of steps after which the prior is no longer loosened.
    pub loose_steps: f32,
    /// Largest number of patches that the surface reflects light from; 0 for no interreflection.
    pub patches: usize,
    /// Number of times that interreflection is gathered.
    pub gathers: usize,
    /// Step before which interreflection is gathered first.
    pub first_gather: usize,
    /// Divisor of the image's width that gives the radius over which light fractions are smooth, at least 2 px.
    pub ambient_radius_divisor: usize,
    /// Roughness that the prior allows any surface: standard deviation of second differences between neighboring pixels,
    /// steps of depth. Where the surface proves smoother, that counts.
    pub roughness: f32,
    /// Number of times that the surface's own roughness is measured, at most three.
    pub roughness_measurements: usize,
    /// Second difference, steps of depth, beyond which there is a crease or jump and the prior breaks.
    pub crease: f32,
    /// Half side of the square over which a surface's local roughness is pooled, px.
    pub roughness_radius: usize,
    /// Factor by which the residual of one step's linear system is reduced in every tile.
    pub solver_reduction: f64,
    /// What is left to be gained per pixel, χ², below which a tile's linear system counts as solved.
    pub solver_settled: f64,
    /// Largest number of iterations of one step's solver in a tile.
    pub solver_iterations: usize,
    /// χ² per measurement at which a pixel's weight has fallen to a quarter (Geman-McClure).
    pub robust_chi2: f32,
}

impl Default for RefineSettings {
    fn default() -> Self {
        Self {
            steps: 20,
            fine_steps: 8,
            settled: 0.0,
            first_width_mm: 0.7,
            last_width_mm: 0.1,
            loosened: 1.0,
            loose_steps: 2.0,
            patches: 4000,
            gathers: 6,
            first_gather: 2,
            ambient_radius_divisor: 80,
            roughness: 0.2,
            roughness_measurements: ROUGHNESS_MEASURED.len(),
            crease: 0.5,
            roughness_radius: 3,
            solver_reduction: 1e-2,
            solver_settled: 0.0,
            solver_iterations: 120,
            robust_chi2: 6.0,
        }
    }
}

impl RefineSettings {
    /// Returns the width 1/inv_s of the surface at a step, mm: it shrinks over the first two thirds of the steps.
    pub(super) fn width_mm(&self, step: usize) -> f32 {
        let done = step as f32 / (self.steps - 1).max(1) as f32;
        self.first_width_mm * (self.last_width_mm / self.first_width_mm).powf((done * 1.5).min(1.0))
    }

    /// Returns the roughness that the prior allows at a step, steps of depth.
    pub(super) fn roughness_at(&self, step: usize) -> f32 {
        self.roughness * (1.0 + (self.loosened - 1.0) * (1.0 - step as f32 / self.loose_steps).max(0.0))
    }

    /// Returns whether interreflection is gathered before this step: first when the surface has lost the decoder's
    /// noise (if it has any), then at even distances.
    pub(super) fn gathers_at(&self, step: usize) -> bool {
        let first = self.first_gather.min(self.steps.saturating_sub(2));
        (0..self.gathers).any(|g| step == first + g * (self.steps - first) / self.gathers)
    }

    /// Returns whether the surface's roughness is measured at this step: when it has lost the decoder's noise, and again,
    /// since it is told apart from noise the better, the nearer the prior is to it.
    pub(super) fn measures_roughness_at(&self, step: usize) -> bool {
        let mut at = ROUGHNESS_MEASURED.iter().take(self.roughness_measurements);
        step > 0 && at.any(|part| step == (part * self.steps as f32).round() as usize)
    }

    /// Returns whether from this step on the surface alone changes: it has its last width, no gathering follows, nor a
    /// measurement of its roughness.
    pub(super) fn is_final(&self, step: usize) -> bool {
        let changes = |later: usize| self.gathers_at(later) || self.measures_roughness_at(later);
        self.width_mm(step) <= self.last_width_mm && !(step + 1..self.steps).any(changes)
    }
}
