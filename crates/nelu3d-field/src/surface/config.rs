//! Settings of a surface.

use crate::field::{FieldError, HashFieldConfig};
use crate::loss::Norms;
use serde::{Deserialize, Serialize};

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
    /// Whether the opacity of Eq. 5 is clamped to [1e-3, 1 − 1e-3], as published. A ray that is blocked for certain
    /// then has no gradient at all: a background ray behind which a start lies is never carved.
    pub clamped_mask: bool,
    /// Weight of L_eik, Eq. 6.
    pub eikonal_weight: f64,
    /// Weight of L_sp, Eq. 6.
    pub sparsity_weight: f64,
    /// Which samples L_eik takes, see `eikonal_samples`; 0 for none. Alphas at midpoints need all: 1.
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
