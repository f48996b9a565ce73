//! Losses of NeLU3D (Eq. 2, 3, 5, 6), each with its gradient: a mean over all elements of its first argument, 0 (and no
//! gradient) for none.
//!
//! Image losses act on the residual r = Ĩ (1 − A) + A − P. The paper's norms are read as `l1`·|r| + `l2`·r², with the
//! constants of TurboSL's published configuration as the default.

pub mod cpu;
pub mod reference;

use serde::{Deserialize, Serialize};

/// Opacities are clamped to `[MASK_CLAMP, 1 − MASK_CLAMP]` before the mask loss.
pub const MASK_CLAMP: f64 = 1e-3;
/// The least opacity of the unclamped mask loss, whose logarithm must stay finite.
pub const MIN_OPACITY: f64 = 1e-6;

/// Weights of the two norms of an image loss.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Norms {
    /// Weight of |r|.
    pub l1: f64,
    /// Weight of r².
    pub l2: f64,
}

impl Default for Norms {
    fn default() -> Self {
        Self { l1: 1.0, l2: 10.0 }
    }
}
