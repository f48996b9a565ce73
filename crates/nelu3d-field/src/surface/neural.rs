//! A signed distance field with its sharpness.

use super::chunk::StepScratch;
use super::config::{SurfaceConfig, SurfaceError};
use crate::adam::MomentBuffers;
use crate::field::HashField;
use crate::mlp::Activation;

/// A signed distance field with its sharpness inv_s.
#[derive(Clone, Debug)]
pub struct NeuralSurface {
    pub(crate) config: SurfaceConfig,
    pub(crate) field: HashField<3>,
    /// v of inv_s = exp(10 v).
    pub(crate) sharpness: f32,
    pub(crate) sharpness_moments: MomentBuffers,
    pub(super) scratch: StepScratch,
}

impl NeuralSurface {
    /// Makes a surface with random parameters: not yet a distance to anything. Fit [`Self::field_mut`] to a start.
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
        Ok(Self { config, field, sharpness, sharpness_moments: MomentBuffers::new(1), scratch: StepScratch::default() })
    }

    /// Makes a surface whose field has given parameters, in the order of [`HashField::params`].
    ///
    /// # Errors
    /// [`SurfaceError`] for a configuration out of range, or parameters that do not belong to it.
    pub fn from_params(config: SurfaceConfig, params: Vec<f32>) -> Result<Self, SurfaceError> {
        let field = HashField::from_params(config.field.clone(), params)?;
        Ok(Self { field, ..Self::new(config, 0)? })
    }

    /// Returns the configuration.
    pub fn config(&self) -> &SurfaceConfig {
        &self.config
    }

    /// Returns the signed distance, to be queried.
    pub fn field(&self) -> &HashField<3> {
        &self.field
    }

    /// Returns the signed distance, to be fitted to known values. Its optimizer's moments are those of
    /// [`Self::train_step`] too.
    pub fn field_mut(&mut self) -> &mut HashField<3> {
        &mut self.field
    }

    /// Returns the sharpness inv_s = exp(10 v).
    pub fn inv_s(&self) -> f64 {
        (10.0 * self.sharpness as f64).exp()
    }

    /// Returns the optimizer's moments of v, one of each; zero before the first step.
    pub fn sharpness_moments(&self) -> &MomentBuffers {
        &self.sharpness_moments
    }

    /// Returns the floating-point operations of the networks in one step of `n` samples: a multiplication and an
    /// addition for each weight in the value, the gradient, the weights' gradient, and the tangents of the eikonal
    /// samples.
    pub fn flops_per_step(&self, n: usize) -> usize {
        let every = self.config.loss.eikonal_every;
        let passes = 3 * n + if every == 0 { 0 } else { n.div_ceil(every) };
        passes * self.field.flops_per_query()
    }
}
