//! A neural signed distance field, trained by volume rendering against measured codewords (NeLU3D, Eq. 1 to 6).
//!
//! A ray's codeword is Ĩ = Σ_j w_j c(x_j) with the weights of [`crate::volrend`]; with ambient share A the residual is
//! r = Ĩ (1 − A) + A − P (Eq. 1 divided by I_white). The loss of a step is
//!
//! ```text
//! (1 − α) L_pattern + α L_lookup + mask_weight L_mask + eikonal_weight L_eik + sparsity_weight L_sp
//! ```
//!
//! each as in [`crate::loss`]: image losses a mean over rays and channels (0 for a background ray, which has no codeword), L_mask over rays, L_sp over samples, and L_eik over
//! [`eikonal_samples`]. The color field c is frozen, so the samples' codewords come with the batch, whoever knows them;
//! likewise the ambient light, whose gradient goes back to the caller.
//!
//! [`mod@reference`] is the plain form; [`NeuralSurface::train_step`] the fast one. A method with another image formation
//! brings its own [`RayLoss`] to [`NeuralSurface::step`]; L_eik and L_sp, the field and the optimizer stay the same.

mod codeword;
mod cpu;
pub mod reference;

use crate::adam::MomentBuffers;
use crate::field::{FieldError, HashField, HashFieldConfig};
use crate::loss::Norms;
use crate::mlp::Activation;
use crate::mlp::cpu::BLOCK;
use crate::volrend::cpu::Step;
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Weights of the losses; the defaults are the paper's.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SurfaceLoss {
    /// Norms of both image losses.
    pub norms: Norms,
    /// α of Eq. 4: 1 for the lookup loss alone, 0 for the pattern loss alone.
    pub lookup_loss_weight: f64,
    /// Weight of Eq. 5.
    pub mask_weight: f64,
    /// Whether the opacity of Eq. 5 is clamped to [1e-3, 1 − 1e-3], as published. A ray that is blocked for certain then has
    /// no gradient at all: a background ray behind which a start lies is never carved.
    pub clamped_mask: bool,
    /// Weight of L_eik, Eq. 6.
    pub eikonal_weight: f64,
    /// Weight of L_sp, Eq. 6.
    pub sparsity_weight: f64,
    /// Which samples L_eik takes, see [`eikonal_samples`]; 0 for none.
    pub eikonal_every: usize,
}

impl Default for SurfaceLoss {
    fn default() -> Self {
        Self {
            norms: Norms::default(),
            lookup_loss_weight: 0.1,
            mask_weight: 0.1,
            clamped_mask: true,
            eikonal_weight: 0.1,
            sparsity_weight: 0.01,
            eikonal_every: 1,
        }
    }
}

/// Everything that determines a surface apart from its parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SurfaceConfig {
    /// The signed distance as a function on the unit cube, and how its parameters are trained. One linear output.
    pub field: HashFieldConfig<3>,
    /// Length of the unit cube's axes, in the unit of the signed distance.
    pub extent: [f32; 3],
    /// v of inv_s = exp(10 v), at the start.
    pub sharpness: f64,
    /// Learning rate of v; 0 to leave it.
    pub sharpness_learning_rate: f64,
    /// The loss.
    #[serde(default)]
    pub loss: SurfaceLoss,
}

/// Why a surface cannot be made.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum SurfaceError {
    /// The field is out of range.
    #[error(transparent)]
    Field(#[from] FieldError),
    /// Not a signed distance.
    #[error("a signed distance field has one linear output")]
    Outputs,
    /// A side of the volume.
    #[error("the volume's extent along axis {axis} must be positive, not {value}")]
    Extent {
        /// Index of the axis.
        axis: usize,
        /// Given extent.
        value: f32,
    },
}

/// Rays of one step. Ray r owns the samples `offsets[r]..offsets[r + 1]`, front to back, any number of them.
#[derive(Clone, Copy, Debug)]
pub struct SurfaceBatch<'a> {
    /// First sample of every ray and, last, the number of samples.
    pub offsets: &'a [usize],
    /// Where the samples lie, in the unit cube.
    pub points: &'a [[f32; 3]],
    /// Their codewords c, `[sample][k]`.
    pub colors: &'a [f32],
    /// Measured codewords P, `[ray][k]`.
    pub measured: &'a [f32],
    /// I_white, `[ray][k]`; empty for 1.
    pub white: &'a [f32],
    /// Ambient share A, `[ray][k]`; empty for 0.
    pub ambient: &'a [f32],
    /// M of every ray, 0 or 1.
    pub mask: &'a [f32],
}

impl SurfaceBatch<'_> {
    /// Number of rays.
    pub fn n_rays(&self) -> usize {
        self.offsets.len() - 1
    }

    /// Length of a codeword.
    fn k(&self) -> usize {
        self.measured.len() / self.n_rays().max(1)
    }

    fn check(&self, d_ambient: &[f32]) {
        let (n_rays, n_samples, k) = (self.n_rays(), self.points.len(), self.k());
        assert!(self.offsets[0] == 0 && self.offsets[n_rays] == n_samples && self.offsets.is_sorted());
        assert!(self.measured.len() == n_rays * k && self.colors.len() == n_samples * k && self.mask.len() == n_rays);
        assert!(self.white.is_empty() || self.white.len() == n_rays * k);
        assert!(self.ambient.is_empty() || self.ambient.len() == n_rays * k);
        assert!(d_ambient.is_empty() || d_ambient.len() == n_rays * k);
    }
}

/// What a ray's samples should be, apart from a distance: an image formation and its losses.
pub trait RayLoss: Sync {
    /// Whether it looks at the distances' gradients. They are then computed for every sample, and
    /// [`SurfaceLoss::eikonal_every`] must be 1.
    fn needs_gradients(&self) -> bool;

    /// Values per ray that it sends back to the caller.
    fn n_ray_outputs(&self) -> usize;

    /// Values per sample that it sends back to the caller.
    fn n_sample_outputs(&self) -> usize;

    /// Loss of ray `ray` and its gradients. `sdf` are the signed distances of its samples, front to back, `gradients` their
    /// gradients in space (empty unless [`Self::needs_gradients`]).
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

/// Where a [`RayLoss`] puts what it found.
#[derive(Debug)]
pub struct RayGradient<'a> {
    /// Losses of the step so far, image and mask: to be added to, already divided by the number of rays.
    pub losses: &'a mut SurfaceLosses,
    /// Gradient by inv_s, to be added to.
    pub d_inv_s: &'a mut f64,
    /// By the distances, to be written.
    pub d_sdf: &'a mut [f32],
    /// By their gradients, to be written; empty unless [`RayLoss::needs_gradients`].
    pub d_gradients: &'a mut [[f32; 3]],
    /// The ray's values for the caller, to be written.
    pub ray: &'a mut [f32],
    /// Its samples' values for the caller, `[sample][value]`, to be written.
    pub samples: &'a mut [f32],
}

/// Memory that a [`RayLoss`] finds again at the next ray.
#[derive(Debug, Default)]
pub struct RayScratch {
    /// For whatever.
    pub buffers: [Vec<f32>; 4],
    pub(crate) steps: Vec<Step>,
}

/// Losses of one step, before their weights, and the whole.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct SurfaceLosses {
    /// Weighted sum of the others.
    pub total: f64,
    /// Eq. 4.
    pub image: f64,
    /// Eq. 5.
    pub mask: f64,
    /// L_eik of Eq. 6.
    pub eikonal: f64,
    /// L_sp of Eq. 6.
    pub sparsity: f64,
}

/// Whole rays that are worked on together: as many as fit into [`BLOCK`] samples, or one longer ray.
fn blocks(offsets: &[usize]) -> impl Iterator<Item = Range<usize>> + '_ {
    let n_rays = offsets.len() - 1;
    let mut start = 0;
    std::iter::from_fn(move || {
        let first = start;
        while start < n_rays && (start == first || offsets[start + 1] - offsets[first] <= BLOCK) {
            start += 1;
        }
        (start > first).then_some(first..start)
    })
}

/// Samples that the eikonal loss takes: in every block of whole rays of up to 96 samples (or one longer ray), each
/// `every`-th, the first included. A network's masks then fall together, and rays share the load evenly.
pub fn eikonal_samples(offsets: &[usize], every: usize) -> impl Iterator<Item = usize> + '_ {
    let some = blocks(offsets).filter(move |_| every > 0);
    some.flat_map(move |rays| (offsets[rays.start]..offsets[rays.end]).step_by(every.max(1)))
}

/// A signed distance field with its sharpness inv_s.
#[derive(Clone, Debug)]
pub struct NeuralSurface {
    pub(crate) config: SurfaceConfig,
    pub(crate) field: HashField<3>,
    pub(crate) sharpness: f32,
    pub(crate) sharpness_moments: MomentBuffers,
    scratch: cpu::StepScratch,
}

impl NeuralSurface {
    /// A surface with random parameters: not yet a distance to anything. Fit [`Self::field_mut`] to a start.
    ///
    /// # Errors
    /// [`SurfaceError`] for a configuration out of range.
    pub fn new(config: SurfaceConfig, seed: u64) -> Result<Self, SurfaceError> {
        if config.field.n_outputs != 1 || config.field.output_activation != Activation::Linear {
            return Err(SurfaceError::Outputs);
        }
        if let Some(axis) = (0..3).find(|&a| !(config.extent[a] > 0.0 && config.extent[a].is_finite())) {
            return Err(SurfaceError::Extent { axis, value: config.extent[axis] });
        }
        let field = HashField::new(config.field.clone(), seed)?;
        let sharpness = config.sharpness as f32;
        Ok(Self {
            config,
            field,
            sharpness,
            sharpness_moments: MomentBuffers::new(1),
            scratch: cpu::StepScratch::default(),
        })
    }

    /// A surface whose field has given parameters, in the order of [`HashField::params`].
    ///
    /// # Errors
    /// [`SurfaceError`] for a configuration out of range, or parameters that do not belong to it.
    pub fn from_params(config: SurfaceConfig, params: Vec<f32>) -> Result<Self, SurfaceError> {
        let field = HashField::from_params(config.field.clone(), params)?;
        Ok(Self { field, ..Self::new(config, 0)? })
    }

    /// The configuration.
    pub fn config(&self) -> &SurfaceConfig {
        &self.config
    }

    /// The signed distance, to be queried.
    pub fn field(&self) -> &HashField<3> {
        &self.field
    }

    /// The signed distance, to be fitted to known values. Its optimizer's moments are those of [`Self::train_step`] too.
    pub fn field_mut(&mut self) -> &mut HashField<3> {
        &mut self.field
    }

    /// exp(10 v)
    pub fn inv_s(&self) -> f64 {
        (10.0 * self.sharpness as f64).exp()
    }

    /// Floating-point operations of the networks in one step of `n` samples: a multiplication and an addition for each
    /// weight in the value, the gradient, the weights' gradient, and the tangents of the eikonal samples.
    pub fn flops_per_step(&self, n: usize) -> usize {
        let every = self.config.loss.eikonal_every;
        let passes = 3 * n + if every == 0 { 0 } else { n.div_ceil(every) };
        passes * self.field.flops_per_query()
    }
}

#[cfg(test)]
pub(crate) mod tests;
